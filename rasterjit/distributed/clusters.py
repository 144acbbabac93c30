"""Reach a Dask cluster, or make one; wait for results, and say clearly when it is lost."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from rasterjit.runtime.threads import available_processors

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")

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

MOST_ATTEMPTS = 5
"""Times that something is tried because data that it needs is lost with the workers that had it."""


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


def retried(take: Callable[[], T], what: str, again: Callable[[], None] | None = None) -> T:
    """
    Return what ``take`` gives, trying anew where data that was sent is lost with its workers.

    Parameters
    ----------
    take : callable
        Raises ``CancelledError`` where data is lost.
    what : str
        What a message calls the data.
    again : callable, optional
        Called before another attempt: it sends what is lost.

    Raises
    ------
    RuntimeError
        If it is lost `MOST_ATTEMPTS` times.
    """
    for attempt in range(1, MOST_ATTEMPTS + 1):
        try:
            return take()
        except CancelledError:
            LOGGER.warning("all workers that held %s were lost: attempt %d", what, attempt)
        if again is not None and attempt < MOST_ATTEMPTS:
            again()
    raise RuntimeError(
        f"all workers that held {what} were lost, {MOST_ATTEMPTS} times: see their logs, and their "
        "memory limit"
    )


class SharedScene:
    """
    What all tasks have in common; on a worker, also the renderers that are made of it.

    They are kept for later tasks, one for each thread, and go when the worker lets the data go.

    Parameters
    ----------
    make : callable
        Makes a renderer of the arguments.
    *arguments
    """

    def __init__(self, make: Callable[..., Any], *arguments: Any) -> None:
        self.make, self.arguments = make, arguments
        self._idle: list[Any] = []

    def __reduce__(self) -> tuple[Any, ...]:
        # Renderers stay where they are.
        return SharedScene, (self.make, *self.arguments)

    @contextmanager
    def renderer(self) -> Iterator[Any]:
        """Give a renderer that no other thread has."""
        try:
            one = self._idle.pop()
        except IndexError:
            one = self.make(*self.arguments)
        yield one
        self._idle.append(one)


def address_of(client: Client) -> str:
    """Return where a client's scheduler is, or was."""
    return "?" if client.scheduler is None else client.scheduler.address
