"""
Share work among threads, and memory among frames.

The tasks write to places of their own, so the result has the same bits for any number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rasterjit.memory import Memory


class Workers:
    """
    A pool of threads for kernels that release the GIL, and the memory that they work in.

    Parameters
    ----------
    threads : int or None
        How many; ``None`` takes the processors this process may run on.
    """

    def __init__(self, threads: int | None = None) -> None:
        self.threads = available_processors() if threads is None else threads
        self.memory = Memory()
        self._pool: ThreadPoolExecutor | None = None
        self._process = os.getpid()

    def run(self, task: Callable[..., Any], arguments: Iterable[tuple]) -> list[Any]:
        """Call ``task(*args)`` for each tuple; return the results in order."""
        calls = list(arguments)
        if self.threads == 1 or len(calls) <= 1:
            return [task(*call) for call in calls]
        if self._process != os.getpid():
            # A forked process has the pool but none of its threads.
            self._pool, self._process = None, os.getpid()
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads, thread_name_prefix="rasterjit")
        return list(self._pool.map(lambda call: task(*call), calls))

    def close(self) -> None:
        """Let the threads go."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
        self.memory.clear()


def available_processors() -> int:
    """Return the number of processors this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
