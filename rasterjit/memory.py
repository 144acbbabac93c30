"""Arrays whose memory is used again once nobody holds them."""

from __future__ import annotations

import math
import sys
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

LEAST_BYTES = 1 << 15
"""Smaller arrays come from NumPy: its own allocator keeps those."""

SIZE_STEPS = 8
"""Sizes of blocks from one power of two to the next."""

KEPT_FRAMES = 2
"""Frames that a size stays unused before its memory is let go."""


class Memory:
    """
    Blocks of memory that go from one frame to the next.

    New memory is slow: the system clears every page of it when it is first touched. An array from
    here is an ordinary array that owns its numbers for as long as anyone holds it or a view of it;
    after that its block serves another array of about the same size.
    """

    def __init__(self) -> None:
        self._shelves: dict[int, list[NDArray[np.uint8]]] = {}
        self._last_used: dict[int, int] = {}
        self._frame = 0
        self._lock = threading.Lock()

    def empty(self, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return a C-contiguous array of any contents."""
        kind = np.dtype(dtype)
        size = math.prod(shape) * kind.itemsize
        if size < LEAST_BYTES:
            return np.empty(shape, kind)
        room = _block_size(size)
        with self._lock:
            self._last_used[room] = self._frame
            shelf = self._shelves.setdefault(room, [])
            number = next((n for n in range(len(shelf)) if _is_idle(shelf, n)), len(shelf))
            if number == len(shelf):
                shelf.append(np.empty(room, np.uint8))
            return shelf[number][:size].view(kind).reshape(shape)

    def next_frame(self) -> None:
        """Let go of what the last frames had no use for."""
        with self._lock:
            self._frame += 1
            for room, used in list(self._last_used.items()):
                if used + KEPT_FRAMES < self._frame:
                    del self._shelves[room], self._last_used[room]

    def clear(self) -> None:
        """Let go of everything; arrays that are held stay as they are."""
        with self._lock:
            self._shelves.clear()
            self._last_used.clear()


def _block_size(size: int) -> int:
    """Return the next of the sizes that blocks have, bytes."""
    step = max((1 << (size - 1).bit_length()) // (2 * SIZE_STEPS), 1)
    return -(-size // step) * step


def _references(shelf: list[NDArray[np.uint8]], number: int) -> int:
    return sys.getrefcount(shelf[number])


IDLE_REFERENCES = _references([np.empty(1, np.uint8)], 0)
"""What is counted of a block that only its shelf holds; a view of it counts one more."""


def _is_idle(shelf: list[NDArray[np.uint8]], number: int) -> bool:
    return _references(shelf, number) == IDLE_REFERENCES
