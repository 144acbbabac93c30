"""A cluster of our own keeps to this machine, and lost data is sent again a few times."""

from __future__ import annotations

import ipaddress
import pickle
from concurrent.futures import CancelledError

import pytest

from rasterjit.distributed import clusters


def listening(dask_scheduler):
    """Return the addresses that a scheduler's dashboard listens on."""
    return [one.getsockname()[0] for one in dask_scheduler.http_server._sockets.values()]


def test_dashboard_of_our_own_cluster_is_for_this_machine_alone(monkeypatch):
    said = []
    # Dask silences the handlers of pytest, where it is imported while tests are collected.
    monkeypatch.setattr(clusters.LOGGER, "info", lambda text, *rest: said.append(text % rest))
    monkeypatch.setattr(clusters, "available_processors", lambda: 1)
    with clusters.connected(None) as own:
        found = own.run_on_scheduler(listening)
        assert said == [f"dashboard: {own.dashboard_link}"]
    assert found
    assert all(ipaddress.ip_address(one).is_loopback for one in found)


def test_what_is_lost_is_tried_again():
    done = []

    def take():
        done.append("take")
        if done.count("take") < clusters.MOST_ATTEMPTS:
            raise CancelledError
        return 7

    assert clusters.retried(take, "the scene", lambda: done.append("again")) == 7
    assert done == ["take", "again"] * (clusters.MOST_ATTEMPTS - 1) + ["take"]


def test_what_is_lost_again_and_again_is_given_up():
    done = []

    def take():
        done.append("take")
        raise CancelledError

    with pytest.raises(RuntimeError, match=r"held the scene were lost, 5 times.*memory limit"):
        clusters.retried(take, "the scene")
    assert len(done) == clusters.MOST_ATTEMPTS == 5


def test_other_errors_are_not_tried_again():
    done = []

    def take():
        done.append("take")
        raise ConnectionError("lost")

    with pytest.raises(ConnectionError, match="lost"):
        clusters.retried(take, "the scene")
    assert done == ["take"]


def make_list(*arguments):
    return [*arguments]


def test_each_thread_keeps_a_renderer_of_its_own():
    shared = clusters.SharedScene(make_list, 1, 2)
    with shared.renderer() as first, shared.renderer() as second:
        assert first == second == [1, 2]
        assert first is not second
    with shared.renderer() as third, shared.renderer() as fourth:
        assert {id(third), id(fourth)} == {id(first), id(second)}


def test_renderers_stay_where_they_are():
    shared = clusters.SharedScene(make_list, 1, 2)
    with shared.renderer() as first:
        first.append("drawn with")
    sent = pickle.loads(pickle.dumps(shared))
    assert sent.arguments == (1, 2)
    with sent.renderer() as other:
        assert other == [1, 2]
