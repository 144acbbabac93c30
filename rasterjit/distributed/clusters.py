"""Connect to a Dask cluster, or make one; wait for results, and report when it is lost."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, TypeVar

from rasterjit.runtime.threads import available_processors
from rasterjit.scene.validation import brief, needs_extra

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")

LOGGER = logging.getLogger("rasterjit.distributed")

POLL_SECONDS = 1.0
"""Seconds between two checks of the connection to the scheduler."""

RECONNECT_TIMEOUT = 10.0
"""Seconds within which a client may reconnect to its scheduler."""

TRANSFER_TIMEOUT = 3600.0
"""Seconds within which a result must arrive from a worker."""

CONNECT_TIMEOUT = 20.0
"""Seconds within which a client must connect to a local cluster."""

START_TIMEOUT = 60.0
"""Seconds within which a cluster must start its first worker."""

CLOSED_STATUSES = "closing", "closed"
"""Statuses of a client that will not connect again."""

MAX_ATTEMPTS = 5
"""Most attempts at a task whose data is lost with the workers that held it."""


def require_dask() -> Any:
    """
    Return the module ``distributed``.

    Raises
    ------
    ImportError
        If it is not installed.
    """
    with needs_extra("distributed", "rendering on a Dask cluster needs Dask"):
        import distributed

        return distributed


def check_client(client: Any) -> Client:
    """
    Return a client if it is connected.

    Raises
    ------
    ValueError
        If it is no client, asynchronous or closed.
    ConnectionError
        If its scheduler is lost.
    """
    distributed = require_dask()
    if not isinstance(client, distributed.Client):
        raise ValueError(f"client must be a distributed.Client, got {type(client).__name__}")
    if client.asynchronous:
        raise ValueError("client must not be asynchronous: make it without asynchronous=True")
    if client.status in CLOSED_STATUSES:
        raise ValueError(f"client must be connected to a scheduler; its status is {client.status}")
    check_connected(client)
    return client


def check_pickles(name: str, function: Any) -> None:
    """Raise ``ValueError`` naming an argument that cannot be sent to a cluster."""
    # Comes with Dask, which sends functions of the program itself by it.
    import cloudpickle

    try:
        cloudpickle.dumps(function)
    except Exception as error:
        raise ValueError(
            f"{name} must pickle, to be sent to a cluster, got {brief(function)}: "
            f"{type(error).__name__}: {error}"
        ) from error


@contextmanager
def use_client(client: Client | None) -> Iterator[Client]:
    """Yield the given client, or one of a local cluster that is closed at the end."""
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
        distributed.Client(cluster, timeout=CONNECT_TIMEOUT) as local_client,
    ):  # fmt: skip
        LOGGER.info("dashboard: %s", local_client.dashboard_link)
        yield local_client


def wait_for_result(future: Future, client: Client) -> Any:
    """
    Wait for the result of a task.

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
    deadline = None
    while True:
        _wait(future, client)
        try:
            return future.result(timeout=TRANSFER_TIMEOUT)
        except distributed.KilledWorker as error:
            raise RuntimeError(
                "a task lost one worker after the other, which mostly means that they had too "
                f"little memory (see the workers' memory limit): {error}"
            ) from None
        except CancelledError:
            # The cause may be a lost scheduler, which this reports.
            check_connected(client)
            raise
        except OSError:
            if future.status == "error":
                # The task raised it.
                raise
            # A connection broke; the client soon notices if it was that to the scheduler.
            deadline = deadline or time.monotonic() + RECONNECT_TIMEOUT
            if time.monotonic() > deadline:
                raise _make_lost_error(client) from None
            time.sleep(POLL_SECONDS / 5.0)


def _wait(future: Future, client: Client) -> None:
    """Wait until a task is done, or raise ``ConnectionError`` if its scheduler is lost."""
    is_done = threading.Event()
    future.add_done_callback(lambda _: is_done.set())
    while True:
        finished = is_done.wait(POLL_SECONDS)
        check_connected(client)
        if finished or future.status != "pending":
            return


def check_connected(client: Client) -> None:
    """
    Check that a client is connected; wait a while for one that lost its scheduler.

    Raises
    ------
    ConnectionError
        If the scheduler is lost.
    """
    deadline = time.monotonic() + RECONNECT_TIMEOUT
    while client.status != "running":
        if client.status in CLOSED_STATUSES or time.monotonic() > deadline:
            raise _make_lost_error(client)
        time.sleep(POLL_SECONDS / 5.0)


def _make_lost_error(client: Client) -> ConnectionError:
    """Return the error of a lost scheduler."""
    return ConnectionError(
        f"the Dask scheduler at {address_of(client)} is lost, and what it held with it: start it "
        "again, connect a new client, and render again"
    )


@contextmanager
def report_lost_scheduler(client: Client) -> Iterator[None]:
    """
    Turn errors of a request to a lost scheduler into ``ConnectionError``.

    Raises
    ------
    ConnectionError
        If the scheduler is lost, whatever error Dask raises.
    """
    check_connected(client)
    try:
        yield
    except TimeoutError:
        # The scheduler is connected, and has waited for something.
        raise
    except Exception as error:
        if isinstance(error, OSError) or client.status != "running":
            raise _make_lost_error(client) from None
        raise


def submit(function: Callable[..., Any], *arguments: Any, client: Client, **options: Any) -> Future:
    """
    Submit a task.

    Raises
    ------
    ConnectionError
        If the scheduler is lost.
    """
    with report_lost_scheduler(client):
        return client.submit(function, *arguments, pure=False, **options)


def count_threads(client: Client) -> int:
    """
    Return the number of threads of all workers of a cluster, at least 1.

    Raises
    ------
    ConnectionError
        If the scheduler is lost.
    """
    with report_lost_scheduler(client):
        return max(1, sum(client.nthreads().values()))


def cancel(futures: Sequence[Future | None], client: Client) -> None:
    """Cancel tasks and release data, if the scheduler is connected."""
    if client.status == "running":
        with suppress(OSError):
            client.cancel([future for future in futures if future is not None], force=True)


def send(data: Any, client: Client) -> Future:
    """
    Send data to all workers; later workers copy it from these.

    Raises
    ------
    ConnectionError
        If no worker comes, or the scheduler is lost.
    """
    return scatter([data], client, broadcast=True)[0]


def scatter(data: list[Any], client: Client, *, broadcast: bool = False) -> list[Future]:
    """Send each item of data to a worker, or to all workers; see `send`."""
    if not data:
        return []
    try:
        with report_lost_scheduler(client):
            return list(
                client.scatter(data, broadcast=broadcast, hash=False, timeout=START_TIMEOUT)
            )
    except TimeoutError:
        raise ConnectionError(
            f"no worker came to the Dask scheduler at {address_of(client)} in {START_TIMEOUT:g} s: "
            "start one (dask worker ADDRESS), or give an adaptive cluster a minimum of 1"
        ) from None


def retry(fetch: Callable[[], T], data_name: str, resend: Callable[[], bool] | None = None) -> T:
    """
    Return the result of ``fetch``, called again if data is lost with its workers.

    Parameters
    ----------
    fetch : callable
        Raises ``CancelledError`` where data is lost.
    data_name : str
        Name of the data in messages.
    resend : callable, optional
        Called before another attempt to send the lost data; returns False if another task had
        sent it already.

    Raises
    ------
    RuntimeError
        If data is lost `MAX_ATTEMPTS` times.
    """
    for attempt in range(1, MAX_ATTEMPTS + 1):
        try:
            return fetch()
        except CancelledError:
            pass
        # Of tasks that lost the same data, one logs it.
        if attempt < MAX_ATTEMPTS and (resend is None or resend()):
            LOGGER.warning("all workers that held %s were lost: it is sent again", data_name)
    raise RuntimeError(
        f"all workers that held {data_name} were lost, {MAX_ATTEMPTS} times: see their logs, and "
        "their memory limit"
    )


class SentTask:
    """A task with arguments, which `TaskFarm` can submit again."""

    def __init__(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> None:
        self.function, self.arguments, self.options = function, arguments, options
        self.future: Future | None = None


class TaskFarm:
    """
    Submits tasks that share a scene, and sends the scene again where it is lost.

    Parameters
    ----------
    client : Client
    shared : SharedScene
    """

    def __init__(self, client: Client, shared: SharedScene) -> None:
        self._client, self._shared = client, shared
        self._sent: Future | None = None

    def begin(self, task: SentTask) -> SentTask:
        """Submit a task with the shared scene, and return it."""
        if self._sent is None:
            self._sent = send(self._shared, self._client)
        task.future = submit(
            task.function, self._sent, *task.arguments, client=self._client, **task.options
        )
        return task

    def result(self, task: SentTask) -> Any:
        """Return the result of a task, submitted again where the scene was lost."""

        def resend() -> bool:
            # An earlier task may have sent it already.
            is_lost = self._sent is not None and self._sent.status != "finished"
            self._sent = None if is_lost else self._sent
            self.begin(task)
            return is_lost

        return retry(lambda: wait_for_result(task.future, self._client), "the scene", resend)

    def end(self, tasks: Iterable[SentTask]) -> None:
        """Cancel tasks, and release the scene."""
        cancel([*(task.future for task in tasks), self._sent], self._client)
        self._sent = None


class SharedScene:
    """
    The arguments that all tasks share; on a worker, also the renderers made of them.

    Renderers are cached for later tasks, one for each thread, as long as the worker has the data.

    Parameters
    ----------
    make_renderer : callable
        Takes the arguments.
    *arguments
    """

    def __init__(self, make_renderer: Callable[..., Any], *arguments: Any) -> None:
        self.make_renderer, self.arguments = make_renderer, arguments
        self._idle: list[Any] = []

    def __reduce__(self) -> tuple[Any, ...]:
        # Renderers are not sent.
        return SharedScene, (self.make_renderer, *self.arguments)

    @contextmanager
    def renderer(self) -> Iterator[Any]:
        """Yield a renderer that no other thread uses."""
        try:
            renderer = self._idle.pop()
        except IndexError:
            renderer = self.make_renderer(*self.arguments)
        yield renderer
        self._idle.append(renderer)


def address_of(client: Client) -> str:
    """Return the address of a client's scheduler, connected or not."""
    return "?" if client.scheduler is None else client.scheduler.address
