"""Clocks for compiling, loading and stages."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rasterjit import forks


class CompileClock:
    """Wall-clock seconds that this process spent compiling, in any thread."""

    def __init__(self) -> None:
        self._lock = forks.lock()
        self._active = 0
        self._since = 0.0
        self._seconds = 0.0

    @property
    def seconds(self) -> float:
        """Seconds of finished compilations; simultaneous ones count once."""
        return self._seconds

    def read(self) -> float:
        """Return the seconds so far, with those of a compilation under way."""
        if self._active == 0:
            return self._seconds
        with self._lock:
            current = time.perf_counter() - self._since if self._active else 0.0
            return self._seconds + current

    @contextmanager
    def running(self) -> Iterator[None]:
        """Let the clock run within a ``with`` block."""
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
    """Measures the seconds of each stage of a frame, and of compiling apart."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {"compile": 0.0}
        self._since = time.perf_counter()
        self._compile_seconds = COMPILE_CLOCK.read()

    def __call__(self, stage: str) -> None:
        """End a stage, given its name."""
        now, compile_seconds = time.perf_counter(), COMPILE_CLOCK.read()
        compiling = compile_seconds - self._compile_seconds
        self.seconds["compile"] += compiling
        # Another thread may compile longer than this stage takes.
        seconds = max(0.0, now - self._since - compiling)
        self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        self._since, self._compile_seconds = now, compile_seconds
