"""Clocks for compiling, loading and stages."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rasterjit import forks


class CompileClock:
    """Wall-clock seconds that this process spent on something, in any thread."""

    def __init__(self) -> None:
        self._lock = forks.lock()
        self._active = 0
        self._since = 0.0
        self._seconds = 0.0

    @property
    def seconds(self) -> float:
        """Seconds so far; time that several threads waited for one compiler counts once."""
        return self._seconds

    def read(self) -> float:
        """Return the seconds so far, with those of what is under way."""
        if self._active == 0:
            return self._seconds
        with self._lock:
            going_on = time.perf_counter() - self._since if self._active else 0.0
            return self._seconds + going_on

    @contextmanager
    def running(self) -> Iterator[None]:
        """Let the clock run."""
        with self._lock:
            if self._active == 0:
                self._since = time.perf_counter()
            self._active += 1
        try:
            yield
        finally:
            with self._lock:
                self._active -= 1
                if self._active == 0:
                    self._seconds += time.perf_counter() - self._since


COMPILE_CLOCK = CompileClock()
"""Runs while kernels are compiled or loaded from disk."""

COMPILER_CLOCK = CompileClock()
"""Runs while kernels are compiled, and not while they are loaded."""


class StageClock:
    """Notes how long each stage took; compiling is taken out of the stages and noted apart."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {"compile": 0.0}
        self._since = time.perf_counter()
        self._compiled = COMPILE_CLOCK.read()

    def __call__(self, stage: str) -> None:
        """End a stage."""
        now, compiled = time.perf_counter(), COMPILE_CLOCK.read()
        compiling = compiled - self._compiled
        self.seconds["compile"] += compiling
        # Another thread may compile longer than this stage takes.
        own = max(0.0, now - self._since - compiling)
        self.seconds[stage] = self.seconds.get(stage, 0.0) + own
        self._since, self._compiled = now, compiled
