"""
Plain Python that tests every pixel of the screen against every triangle.

The first rasterizer of many a course: three barycentric weights at each pixel, inside where none is
negative. Else as ``pure_python``, whose rules it shares, so that the pictures are the same.
"""

from __future__ import annotations

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import TAKES_PIXELS, refusal
from benchmarks.contestants.pure_python import (
    Point,
    Triangles,
    available,
    environment,
    too_long,
)
from benchmarks.scenes import LineScene, Scene

__all__ = ["NAME", "available", "draws", "environment", "prepare"]

NAME = "plain Python, full screen"

UNABLE = {**TAKES_PIXELS, "lines": "a line fills no area", "edges": "a line fills no area"}


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    reason = refusal(scene, UNABLE)
    if reason is not None or isinstance(scene, LineScene):
        return reason
    return too_long(len(scene.faces) * scene.size[0] * scene.size[1])


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        raise ValueError(UNABLE["lines"])
    return FullScreen(scene)


class FullScreen(Triangles):
    """A loop over the whole screen for each triangle."""

    def _box(self, a: Point, b: Point, c: Point) -> tuple[int, int, int, int]:
        """Return the first and last column, and the first and last row: all there are."""
        return 0, self._width - 1, 0, self._height - 1
