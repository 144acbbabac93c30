"""
Call kernels and stages at once, or bind them for machine code that calls them for many views.

What draws a picture is written once, for both: it takes `AT_ONCE` or `BoundCalls`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.fragments import weights
from rasterjit.pipeline.views import begin_mix
from rasterjit.rendering.shading import BLOCK, Shading
from rasterjit.runtime.driver import StageList, block_memory
from rasterjit.runtime.jit import Bound
from rasterjit.runtime.state import WORD

When = tuple[NDArray[np.int64], int, int]
"""An array, and the least and the most that its first number may be."""

Sharing = tuple[Any, ...]
"""What ``weights.share_samples`` takes: the faces at all samples, the rows that are mixed, then
what is written: the faces that are shown, their shares, that of no face, scratch memory."""


class DirectCalls:
    """Kernels and stages are called at once."""

    def call(self, kernel: Any, *arguments: Any, when: When | None = None) -> None:
        """Call a kernel, if a number is between two others."""
        if when is None or when[1] <= when[0][0] <= when[2]:
            kernel(*arguments)

    def shade(
        self, shading: Shading, faces: NDArray[np.int32], first_row: int,
        linear: NDArray[np.float32], when: When | None = None,
    ) -> None:  # fmt: skip
        """Write the linear colour of faces, as `Shading.shade` does."""
        self.call(shading.shade, faces, first_row, linear, no_color(linear), when=when)

    def mix(
        self, shading: Shading, first_row: int, sharing: Sharing, behind: NDArray[np.float32],
        mixed: NDArray[np.float32], has_codes: bool,
    ) -> None:  # fmt: skip
        """
        Lay the faces that samples show over what is behind, (R, W, 4) or (1, 1, 4).

        ``mixed``, (R, 4, W), is written: see `Shading.mixing`.
        """
        count = int(weights.share_samples(*sharing))
        mixed[:] = behind.transpose(0, 2, 1)
        _, _, shown, shares, rest, _ = sharing
        shading.mix(shown[:count], first_row, shares, rest, mixed, has_codes)


AT_ONCE = DirectCalls()


class BoundCalls:
    """
    Kernels and stages are bound, and called when the table is, in order.

    Keep it as long as its table is in use.
    """

    threads = 1

    def __init__(self) -> None:
        self.kept: list[Any] = []
        """What lies behind the addresses."""
        self._calls: list[tuple[int, ...]] = []
        self._limits: list[tuple[int, int]] = []
        self._block = block_memory(BLOCK)

    def bound(self, kernel: Any, *arguments: Any) -> Bound:
        """Return a kernel with its arguments, kept as long as this; it is not called by it."""
        bound = Bound(kernel, *arguments)
        self.kept.append(bound)
        return bound

    def add(self, bound: Bound, number: int = 0, when: When | None = None) -> None:
        """Call a kernel that is bound, and tell it the view's number at an address."""
        address, state = bound.words.tolist()
        self._calls.append((address, state, 0, number, *self._watched(when)))

    def call(self, kernel: Any, *arguments: Any, when: When | None = None) -> None:
        """Call a kernel."""
        self.add(self.bound(kernel, *arguments), when=when)

    def run(self, kernel: Any, arguments: Iterable[tuple[Any, ...]]) -> None:
        """Call a kernel with each of some arguments, in place of ``Workers.run``."""
        for some in arguments:
            self.call(kernel, *some)

    def run_stages(self, stages: StageList, when: When | None = None) -> None:
        """Run stages over an empty block."""
        bound = stages.bound(self._block)
        self.kept.append(bound)
        self._calls.append((*bound.words, 0, *self._watched(when)))

    def shade(
        self, shading: Shading, faces: NDArray[np.int32], first_row: int,
        linear: NDArray[np.float32], when: When | None = None,
    ) -> None:  # fmt: skip
        """Do what `DirectCalls.shade` does."""
        own = faces, first_row, len(faces), None, linear, no_color(linear)
        self.run_stages(shading.listed(*own), when)

    def mix(
        self, shading: Shading, first_row: int, sharing: Sharing, behind: NDArray[np.float32],
        mixed: NDArray[np.float32], has_codes: bool,
    ) -> None:  # fmt: skip
        """Do what `DirectCalls.mix` does."""
        _, _, shown, shares, rest, _ = sharing
        stages = shading.mixing(shown, first_row, shares, rest, mixed, has_codes)
        # How many images of faces there are is known when they are listed.
        told = stages.place_of(0) + WORD
        self.call(begin_mix, self.bound(weights.share_samples, *sharing).words, told, behind, mixed)
        self.run_stages(stages)

    def limit(self, watched: NDArray[np.int64], most: int) -> None:
        """Leave out views in which an array's first number is more than that at the end."""
        self.kept.append(watched)
        self._limits.append((watched.ctypes.data, most))

    def table(self) -> NDArray[np.int64]:
        """Return what is called, (C, 7), as ``pipeline/views.py`` takes it."""
        return np.array(self._calls, np.int64).reshape(-1, 7)

    def limits(self) -> NDArray[np.int64]:
        """Return what must hold then, (L, 2), as ``pipeline/views.py`` takes it."""
        return np.array(self._limits, np.int64).reshape(-1, 2)

    def _watched(self, when: When | None) -> tuple[int, int, int]:
        if when is None:
            return 0, 0, 0
        self.kept.append(when[0])
        return when[0].ctypes.data, *when[1:]


AnyCalls = DirectCalls | BoundCalls


def no_color(linear: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Return an empty array in place of codes that are not wanted, beside (..., W, 4)."""
    return np.empty((*linear.shape[:-2], 0), np.uint32)
