"""Note how long each stage of a frame takes."""

from __future__ import annotations

import time

from rasterjit.runtime.clocks import COMPILE_CLOCK


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
