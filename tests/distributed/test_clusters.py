"""A cluster of our own keeps to this machine, and lost data is sent again a few times."""

from __future__ import annotations

import ipaddress

from rasterjit.distributed import clusters


def listening(dask_scheduler):
    """Return the addresses that a scheduler's dashboard listens on."""
    return [one.getsockname()[0] for one in dask_scheduler.http_server._sockets.values()]


def test_dashboard_of_our_own_cluster_is_for_this_machine_alone(monkeypatch, caplog):
    monkeypatch.setattr(clusters, "available_processors", lambda: 1)
    with caplog.at_level("INFO", logger="rasterjit.distributed"), clusters.connected(None) as own:
        found = own.run_on_scheduler(listening)
        assert f"dashboard: {own.dashboard_link}" in caplog.messages
    assert found
    assert all(ipaddress.ip_address(one).is_loopback for one in found)
