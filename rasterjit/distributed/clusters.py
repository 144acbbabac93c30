"""Reach a Dask cluster, or make one; wait for results, and say clearly when it is lost."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
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

OVER = "closing", "closed"
"""Status of a client that will not be connected any more."""

MAX_ATTEMPTS = 5
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
    """
    Return a client that is connected.

    Raises
    ------
    ValueError
        If it is none, or closed.
    ConnectionError
        If its scheduler is lost.
    """
    distributed = require_dask()
    if not isinstance(client, distributed.Client):
        raise ValueError(f"client must be a distributed.Client, got {type(client).__name__}")
    if client.asynchronous:
        raise ValueError("client must not be asynchronous: make it without asynchronous=True")
    if client.status in OVER:
        raise ValueError(f"client must be connected to a scheduler; its status is {client.status}")
    check_connected(client)
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
    until = None
    while True:
        _wait(future, client)
        try:
            return future.result(timeout=TRANSFER_WITHIN)
        except distributed.KilledWorker as error:
            raise RuntimeError(
                "a task lost one worker after the other, which mostly means that they had too "
                f"little memory (see the workers' memory limit): {error}"
            ) from None
        except CancelledError:
            # Of a scheduler that is lost, too: say that.
            check_connected(client)
            raise
        except OSError:
            if future.status == "error":
                # It is the task's own.
                raise
            # A connection broke; soon the client knows whether it was that to the scheduler.
            until = until or time.monotonic() + RECONNECT_WITHIN
            if time.monotonic() > until:
                raise _lost(client) from None
            time.sleep(LOOK_EVERY / 5.0)


def _wait(future: Future, client: Client) -> None:
    """Return when a task is done, or raise ``ConnectionError`` if its scheduler is lost."""
    is_done = threading.Event()
    future.add_done_callback(lambda _: is_done.set())
    while True:
        came = is_done.wait(LOOK_EVERY)
        check_connected(client)
        if came or future.status != "pending":
            return


def check_connected(client: Client) -> None:
    """
    Return if a client is connected; one that lost its scheduler looks for it again for a while.

    Raises
    ------
    ConnectionError
        If the scheduler is lost.
    """
    until = time.monotonic() + RECONNECT_WITHIN
    while client.status != "running":
        if client.status in OVER or time.monotonic() > until:
            raise _lost(client)
        time.sleep(LOOK_EVERY / 5.0)


def _lost(client: Client) -> ConnectionError:
    """Return the error that says that a scheduler is lost."""
    return ConnectionError(
        f"the Dask scheduler at {address_of(client)} is lost, and what it held with it: start it "
        "again, connect a new client, and render again"
    )


@contextmanager
def reaching(client: Client) -> Iterator[None]:
    """
    Ask a scheduler for something.

    Raises
    ------
    ConnectionError
        If it is lost, whatever Dask says of that.
    """
    check_connected(client)
    try:
        yield
    except TimeoutError:
        # It is there, and has waited for something.
        raise
    except Exception as error:
        if isinstance(error, OSError) or client.status != "running":
            raise _lost(client) from None
        raise


def submit(function: Callable[..., Any], *arguments: Any, client: Client, **how: Any) -> Future:
    """
    Begin a task.

    Raises
    ------
    ConnectionError
        If the scheduler is lost.
    """
    with reaching(client):
        return client.submit(function, *arguments, pure=False, **how)


def count_threads(client: Client) -> int:
    """
    Return how many threads all workers of a cluster have, at least 1.

    Raises
    ------
    ConnectionError
        If the scheduler is lost.
    """
    with reaching(client):
        return max(1, sum(client.nthreads().values()))


def cancel(futures: Sequence[Future | None], client: Client) -> None:
    """End tasks and let data go; a scheduler that is lost holds nothing any more."""
    if client.status == "running":
        with suppress(OSError):
            client.cancel([one for one in futures if one is not None], force=True)


def send(data: Any, client: Client) -> Future:
    """
    Send data to every worker that is there; later ones take it from those.

    Raises
    ------
    ConnectionError
        If no worker comes, or the scheduler is lost.
    """
    return scatter([data], client, broadcast=True)[0]


def scatter(data: list[Any], client: Client, *, broadcast: bool = False) -> list[Future]:
    """Send each of some data to a worker, or to every one; see `send`."""
    if not data:
        return []
    try:
        with reaching(client):
            return list(
                client.scatter(data, broadcast=broadcast, hash=False, timeout=WORKER_WITHIN)
            )
    except TimeoutError:
        raise ConnectionError(
            f"no worker came to the Dask scheduler at {address_of(client)} in {WORKER_WITHIN:g} s: "
            "start one (dask worker ADDRESS), or give an adaptive cluster a minimum of 1"
        ) from None


def retried(take: Callable[[], T], what: str, again: Callable[[], bool] | None = None) -> T:
    """
    Return what ``take`` gives, trying anew where data that was sent is lost with its workers.

    Parameters
    ----------
    take : callable
        Raises ``CancelledError`` where data is lost.
    what : str
        What a message calls the data.
    again : callable, optional
        Called before another attempt: it sends what is lost, and tells whether nobody else had.

    Raises
    ------
    RuntimeError
        If it is lost `MAX_ATTEMPTS` times.
    """
    for attempt in range(1, MAX_ATTEMPTS + 1):
        try:
            return take()
        except CancelledError:
            pass
        # Of tasks that lost the same data one says so.
        if attempt < MAX_ATTEMPTS and (again is None or again()):
            LOGGER.warning("all workers that held %s were lost: it is sent again", what)
    raise RuntimeError(
        f"all workers that held {what} were lost, {MAX_ATTEMPTS} times: see their logs, and their "
        "memory limit"
    )


class SentTask:
    """What a worker does, with what all tasks share; `TaskFarm` begins it anew if need be."""

    def __init__(self, function: Callable[..., Any], *arguments: Any, **how: Any) -> None:
        self.function, self.arguments, self.how = function, arguments, how
        self.future: Future | None = None


class TaskFarm:
    """
    Tasks of a cluster that take the same scene; where it is lost with its workers, it is sent anew.

    Parameters
    ----------
    client : Client
    shared : SharedScene
    """

    def __init__(self, client: Client, shared: SharedScene) -> None:
        self._client, self._shared = client, shared
        self._sent: Future | None = None

    def begin(self, task: SentTask) -> SentTask:
        """Begin a task, with the scene that every worker has, and return it."""
        if self._sent is None:
            self._sent = send(self._shared, self._client)
        task.future = submit(
            task.function, self._sent, *task.arguments, client=self._client, **task.how
        )
        return task

    def result(self, task: SentTask) -> Any:
        """Return what a task gives when it is done, begun anew where the scene was lost."""

        def again() -> bool:
            # An earlier task may have seen to it already.
            is_lost = self._sent is not None and self._sent.status != "finished"
            self._sent = None if is_lost else self._sent
            self.begin(task)
            return is_lost

        return retried(lambda: result_of(task.future, self._client), "the scene", again)

    def end(self, tasks: Iterable[SentTask]) -> None:
        """End tasks, and let the scene go."""
        cancel([*(task.future for task in tasks), self._sent], self._client)
        self._sent = None


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
