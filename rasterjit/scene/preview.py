"""
How notebooks show what is no picture itself.

Scenes know nothing of how they are rendered; who does is told here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Painter = Callable[[Any], "bytes | None"]

_PAINTERS: list[Painter] = []


def set_painter(painter: Painter) -> None:
    """Let a function draw the pictures from now on: it takes a scene or mesh, and returns a PNG."""
    _PAINTERS[:] = [painter]


class Previewed:
    """Shows itself in notebooks as a small picture."""

    def _repr_png_(self) -> bytes | None:
        """Return a small picture as PNG; None if there is nothing to see."""
        return _PAINTERS[0](self) if _PAINTERS else None
