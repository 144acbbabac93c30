"""A cluster of two processes, and small meshes for it."""

from __future__ import annotations

import os
import time
from contextlib import contextmanager

import pytest

import rasterjit as rj

if os.environ.get("CI") != "true":
    # On continuous integration what is missing is an error.
    pytest.importorskip("dask.distributed", reason="needs Dask: rasterjit[distributed]")

PATIENCE = 60.0
"""Seconds after which something hangs."""


@contextmanager
def two_processes():
    """Give a cluster of two processes of one thread each, restarted when they die."""
    import dask
    from distributed import LocalCluster

    # Who looks for a worker that is dead does not look for half a minute.
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "5s"}),
        LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True,
            dashboard_address="127.0.0.1:0", memory_limit=0,
        ) as cluster,
    ):  # fmt: skip
        yield cluster


@contextmanager
def client_of(cluster):
    """Give a client of a cluster, with both workers there."""
    from distributed import Client

    with Client(cluster, timeout=PATIENCE) as made:
        made.wait_for_workers(2, timeout=PATIENCE)
        yield made


@pytest.fixture(scope="session")
def cluster():
    """The cluster of all tests that do it no harm."""
    with two_processes() as made:
        yield made


@pytest.fixture
def client(cluster):
    """A client of that cluster."""
    with client_of(cluster) as made:
        yield made


@pytest.fixture
def doomed():
    """A client of a cluster whose workers may be killed."""
    with two_processes() as made, client_of(made) as client:
        yield client


@pytest.fixture
def wait_for_no_renderers():
    """Waits until no worker holds a renderer, and returns how many they hold then."""

    # In here Dask sends it as it is, and not as a name that is another module's on the worker.
    def renderers_there():
        import gc

        from rasterjit.rendering.renderer import Renderer

        gc.collect()
        return sum(isinstance(one, Renderer) for one in gc.get_objects())

    def wait(client):
        deadline = time.monotonic() + PATIENCE / 6.0
        while any(left := client.run(renderers_there).values()) and time.monotonic() < deadline:
            time.sleep(0.1)
        return sum(left)

    return wait


@pytest.fixture
def view():
    """A camera that sees all of a blob."""
    return rj.PerspectiveCamera(eye=(2.0, 1.5, 3.5), target=(0.0, 0.0, 0.0))
