"""Reach a Dask cluster, or make one; wait for results, and say clearly when it is lost."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rasterjit.workers import available_processors

if TYPE_CHECKING:
    from distributed import Client, Future

LOGGER = logging.getLogger("rasterjit.distributed")

LOOK_EVERY = 1.0
"""Seconds between two looks at whether the scheduler is still there."""

RECONNECT_WITHIN = 10.0
"""Seconds that a client may take to find its scheduler again."""

TRANSFER_WITHIN = 3600.0
"""Seconds that a result may take from a worker to here."""

CONNECT_WITHIN = 20.0
"""Seconds that a client takes to find a cluster of our own."""

WORKER_WITHIN = 60.0
"""Seconds that a cluster has to start its first worker."""


def require_dask() -> Any:
    """
    Return the module ``distributed``.

    Raises
    ------
    ImportError
        If it is not installed, saying how to.
    """
    try:
        import distributed
    except ImportError as error:
        raise ImportError(
            'rendering on a Dask cluster needs: pip install "rasterjit[distributed]"'
        ) from error
    return distributed


def check_client(client: Any) -> Client:
    """Return a client that is connected, or raise ``ValueError``."""
    distributed = require_dask()
    if not isinstance(client, distributed.Client):
        raise ValueError(f"client must be a distributed.Client, got {type(client).__name__}")
    if client.asynchronous:
        raise ValueError("client must not be asynchronous: make it without asynchronous=True")
    if client.status != "running":
        raise ValueError(f"client must be connected to a scheduler; its status is {client.status}")
    return client


@contextmanager
def connected(client: Client | None) -> Iterator[Client]:
    """Give a client: the one given, or one of a local cluster that is closed at the end."""
    if client is not None:
        client = check_client(client)
        LOGGER.info("dashboard: %s", client.dashboard_link)
        yield client
        return
    distributed = require_dask()
    with (
        distributed.LocalCluster(
            n_workers=available_processors(), threads_per_worker=1, processes=True,
            dashboard_address="127.0.0.1:0",
        ) as cluster,
        distributed.Client(cluster, timeout=CONNECT_WITHIN) as own,
    ):  # fmt: skip
        LOGGER.info("dashboard: %s", own.dashboard_link)
        yield own


def result_of(future: Future, client: Client) -> Any:
    """
    Return the result of a task when it is there.

    Raises
    ------
    ConnectionError
        If the scheduler is lost.
    concurrent.futures.CancelledError
        If data that the client sent is lost: it must be sent again.
    RuntimeError
        If the task lost one worker after the other.
    Exception
        What the task raises.
    """
    distributed = require_dask()
    _wait(future, client)
    try:
        return future.result(timeout=TRANSFER_WITHIN)
    except distributed.KilledWorker as error:
        raise RuntimeError(
            "a task lost one worker after the other, which mostly means that they had too little "
            f"memory (see the workers' memory limit): {error}"
        ) from None
    except CancelledError:
        # Of a scheduler that is lost, too: say that.
        _wait(future, client)
        raise


def _wait(future: Future, client: Client) -> None:
    """Return when a task is done, or raise ``ConnectionError`` if its scheduler is lost."""
    address, lost_since = address_of(client), None
    is_done = threading.Event()
    future.add_done_callback(lambda _: is_done.set())
    while True:
        came = is_done.wait(LOOK_EVERY if lost_since is None else LOOK_EVERY / 5.0)
        # A client that lost its scheduler looks for it again for a while.
        if client.status == "running":
            lost_since = None
            if came or future.status != "pending":
                return
            continue
        lost_since = lost_since or time.monotonic()
        is_over = client.status in ("closed", "closing")
        if is_over or time.monotonic() - lost_since > RECONNECT_WITHIN:
            raise ConnectionError(
                f"the Dask scheduler at {address} is lost, and what it held with it: start it "
                "again, connect a new client, and render again"
            )
        if came:
            time.sleep(LOOK_EVERY / 5.0)


def send(data: Any, client: Client) -> Future:
    """
    Send data to every worker that is there; later ones take it from those.

    Raises
    ------
    ConnectionError
        If no worker comes.
    """
    try:
        (sent,) = client.scatter([data], broadcast=True, hash=False, timeout=WORKER_WITHIN)
    except TimeoutError:
        raise ConnectionError(
            f"no worker came to the Dask scheduler at {address_of(client)} in {WORKER_WITHIN:g} s: "
            "start one (dask worker ADDRESS), or give an adaptive cluster a minimum of 1"
        ) from None
    return sent


def address_of(client: Client) -> str:
    """Return where a client's scheduler is, or was."""
    return "?" if client.scheduler is None else client.scheduler.address
