"""Share the time of a whole map out among its cells, so that it ends when it is to end."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from benchmarks.map.cells import Cell

WEIGHT_PIXELS, WEIGHT_FACES = 700_000, 300_000
"""A cell of so many pixels, or of so many faces, takes about twice as long as the smallest."""
AGAIN_SHARE = 0.15
"""Of all time: kept for the lowest cells, which are measured again."""


def weight(cell: Cell) -> float:
    """Return about how long a cell takes, in times of the smallest."""
    return 1.0 + cell.size[0] * cell.size[1] / WEIGHT_PIXELS + cell.faces / WEIGHT_FACES


class Schedule:
    """
    Says of each cell until when it may be measured.

    What one leaves over, or takes too much, is shared by those that follow.

    Parameters
    ----------
    cells : iterable of Cell
        All that are to be measured.
    seconds : float
        Until all must be done, from now on, with what is kept for measuring some again.
    clock : callable, optional
        Returns seconds.
    """

    def __init__(
        self, cells: Iterable[Cell], seconds: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._left = sum(map(weight, cells))
        self._clock, self._started = clock, clock()
        self.end = self._started + seconds
        self._first_end = self.end - AGAIN_SHARE * seconds

    @property
    def passed(self) -> float:
        """Seconds since the beginning."""
        return self._clock() - self._started

    @property
    def is_over(self) -> bool:
        """Whether there is no time for one more of the cells, the first time."""
        return self._clock() >= self._first_end

    def next_end(self, cell: Cell) -> float:
        """Return when a cell, the next one, is to be done; ask once for each, in order."""
        now, share = self._clock(), weight(cell) / self._left
        self._left -= weight(cell)
        return now + max(self._first_end - now, 0.0) * share

    def has(self, seconds: float) -> bool:
        """Tell whether so many seconds are left before the end."""
        return self._clock() + seconds <= self.end
