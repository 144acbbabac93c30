"""Who does the work: this process, others on this machine, or a Dask cluster."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from rasterjit.dataset.mesh import Stopped
from rasterjit.runtime.threads import available_processors

Job = tuple[Any, ...]
Task = Callable[..., Any]

AT_HAND = 2
"""Jobs for each worker that are handed out ahead."""

PATIENCE = 10.0
"""Seconds in which a scheduler must answer."""

_calls_off: Any = None
"""In a process of a crew: the event that calls off its work."""


class LostWorkersError(ConnectionError):
    """Those who do the work are gone, or never were there; what is done is whole."""


def run_here(task: Task, jobs: Iterable[Job]) -> Iterator[tuple[Job, Any]]:
    """Do one job after the other; yield each with its result."""
    for job in jobs:
        yield job, task(*job, None)


def run_in_processes(task: Task, jobs: Sequence[Job], count: int) -> Iterator[tuple[Job, Any]]:
    """
    Share jobs among some processes; yield each with its result, in the order they are done.

    When the iterator is closed, or anything is raised, the processes end after the view at hand.
    """
    count = min(count, len(jobs))
    if count == 0:
        return
    context = multiprocessing.get_context("spawn")
    calls_off = context.Event()
    threads = max(1, available_processors() // count)
    waiting, running = iter(jobs), {}
    pool = futures.ProcessPoolExecutor(
        count, mp_context=context, initializer=_begin, initargs=(calls_off,)
    )
    try:
        while True:
            with _interrupts_for_this_process_alone():
                while len(running) < AT_HAND * count and (job := next(waiting, None)) is not None:
                    running[pool.submit(_call, task, (*job, threads))] = job
            if not running:
                return
            done, _ = futures.wait(running, return_when=futures.FIRST_COMPLETED)
            for future in done:
                yield running.pop(future), future.result()
    except BrokenProcessPool:
        raise LostWorkersError(
            "a worker process died, perhaps for want of memory; run again to go on, "
            "with fewer workers"
        ) from None
    finally:
        calls_off.set()
        pool.shutdown(wait=True, cancel_futures=True)


def need_dask() -> Any:
    """Return ``dask.distributed``, or raise ``ImportError`` naming what to install."""
    try:
        from dask import distributed
    except ImportError:
        raise ImportError(
            'a scheduler\'s workers need Dask; pip install "rasterjit[distributed]"'
        ) from None
    return distributed


def run_on_dask(task: Task, jobs: Iterable[Job], address: str) -> Iterator[tuple[Job, Any]]:
    """
    Share jobs among the workers of a Dask cluster, which see the same files under the same paths.

    Yields each job with its result, in the order in which they are done.
    """
    distributed = need_dask()
    try:
        client = distributed.Client(address, timeout=PATIENCE)
    except (OSError, ValueError, asyncio.TimeoutError) as error:
        said = " ".join(str(error).split()).splitlines()
        raise LostWorkersError(
            f"no scheduler answers at {address}" + (f": {said[0]}" if said else "")
        ) from None
    with client:
        # Whatever has been done before is not kept: the files are what counts.
        submitted = {client.submit(task, *job, 1, pure=False): job for job in jobs}
        try:
            for future in distributed.as_completed(list(submitted)):
                yield submitted[future], future.result()
        except (futures.CancelledError, OSError) as error:
            if isinstance(error, OSError) and error.errno is not None:
                raise
            raise LostWorkersError(
                f"the scheduler at {address} was lost; run again to go on"
            ) from None
        except distributed.scheduler.KilledWorker:
            raise LostWorkersError(
                f"workers of {address} died, perhaps for want of memory; run again to go on"
            ) from None
        finally:
            if client.status == "running":
                client.cancel(list(submitted), force=True)


def _begin(calls_off: Any) -> None:
    """Prepare a process of a crew: Ctrl-C is for the one who gave it its work."""
    global _calls_off
    _calls_off = calls_off
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when the one that gave it its work is gone, however that ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _call(task: Task, arguments: Job) -> Any:
    """Do one job in a process of a crew, unless it is called off."""
    return task(*arguments, _check)


def _check() -> None:
    """Raise `Stopped` if the work has been called off."""
    if _calls_off is not None and _calls_off.is_set():
        raise Stopped


@contextmanager
def _interrupts_for_this_process_alone() -> Iterator[None]:
    """Let processes that are started now never see Ctrl-C, not even while they are starting."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
