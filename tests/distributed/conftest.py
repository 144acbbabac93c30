"""A cluster of two processes, and small meshes for it."""

from __future__ import annotations

import os

import pytest

import rasterjit as rj

if os.environ.get("CI") != "true":
    # On continuous integration what is missing is an error.
    pytest.importorskip("dask.distributed", reason="needs Dask: rasterjit[distributed]")

PATIENCE = 60.0
"""Seconds after which something hangs."""


@pytest.fixture(scope="session")
def cluster():
    """Two processes of one thread each, restarted when they die."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None,
        memory_limit=0,
    ) as made:  # fmt: skip
        yield made


@pytest.fixture
def client(cluster):
    """A client of the cluster, with both workers there."""
    from distributed import Client

    with Client(cluster, timeout=PATIENCE) as made:
        made.wait_for_workers(2, timeout=PATIENCE)
        yield made


@pytest.fixture
def view():
    """A camera that sees all of a blob."""
    return rj.PerspectiveCamera(eye=(2.0, 1.5, 3.5), target=(0.0, 0.0, 0.0))
