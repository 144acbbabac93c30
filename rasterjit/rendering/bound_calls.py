"""Kernels and lists of stages that machine code calls one after the other, by their addresses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.runtime.driver import StageList
from rasterjit.runtime.jit import Bound

When = tuple[int, int, int]
"""The address of a word, and the least and the most that it may be."""

ALWAYS: When = (0, 0, 0)


class BoundCalls:
    """What is called, in order; keep it as long as its table is in use."""

    def __init__(self) -> None:
        self.kept: list[Any] = []
        """What lies behind the addresses."""
        self._calls: list[tuple[int, ...]] = []
        self._limits: list[tuple[int, int]] = []

    def bound(self, kernel: Any, *arguments: Any) -> Bound:
        """Return a kernel with its arguments, kept as long as this; it is not called by it."""
        bound = Bound(kernel, *arguments)
        self.kept.append(bound)
        return bound

    def call(self, bound: Bound, number: int = 0, when: When = ALWAYS) -> None:
        """Call a kernel, and tell it the view's number at an address."""
        address, state = bound.words.tolist()
        self._calls.append((address, state, 0, number, *when))

    def run(self, stages: StageList, block: NDArray[np.int64], when: When = ALWAYS) -> None:
        """Run stages over an empty block."""
        bound = stages.bound(block)
        self.kept.append(bound)
        self._calls.append((*bound.words, 0, *when))

    def limit(self, address: int, most: int) -> None:
        """Leave out views in which a word is more than that, when all is called."""
        self._limits.append((address, most))

    def table(self) -> NDArray[np.int64]:
        """Return what is called, (C, 7), as ``pipeline/views.py`` takes it."""
        return np.array(self._calls, np.int64).reshape(-1, 7)

    def limits(self) -> NDArray[np.int64]:
        """Return what must hold then, (L, 2), as ``pipeline/views.py`` takes it."""
        return np.array(self._limits, np.int64).reshape(-1, 2)
