"""
scikit-image: ``draw.line`` and ``draw.polygon`` list the pixels, NumPy writes them.

There is no depth test: faces are painted far to near by the mean depth of their corners, an order
made beforehand, which shows the same picture where faces neither cross nor overlap in circles. A
face has one colour, that of its corners on average; a line has a ramp, mixed by NumPy.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import TAKES_PIXELS, painted_picture, refusal
from benchmarks.contestants.pure_python import pixels_visited, too_long
from benchmarks.contestants.screen import edge_lines, painted_faces
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "scikit-image"

MAX_CALLS, MAX_PIXELS = 300_000, 100_000_000
"""Of some ten microseconds and a tenth of one: with more, a picture takes too long to wait for."""


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    if find_spec("skimage") is None:
        return 'the package scikit-image is not installed (pip install ".[bench]")'
    return None


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    calls = len(scene.ends if isinstance(scene, LineScene) else scene.faces)
    if calls > MAX_CALLS:
        return f"{calls} calls, one for each line or face, are too many to wait for"
    reason = refusal(scene, TAKES_PIXELS)
    return too_long(pixels_visited(scene), MAX_PIXELS) if reason is None else reason


def alike(scene: Scene) -> tuple[float, float]:
    """Return the shares of pixels alike that its rules allow for: ties may fall elsewhere."""
    if isinstance(scene, LineScene):
        return 0.99, 0.8
    return (0.85, 0.0) if scene.mode == "edges" else (0.95, 0.0)


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        return Lines(scene)
    if scene.mode == "edges":
        return Lines(edge_lines(scene))
    return Faces(scene)


class Faces:
    """Faces far to near."""

    def __init__(self, scene: TriangleScene) -> None:
        from skimage.draw import polygon

        self._polygon = polygon
        corners, self._values = painted_faces(scene)
        self._columns, self._rows = list(corners[:, :, 0]), list(corners[:, :, 1])
        width, height = scene.size
        self._shape = (height, width)
        shape = self._shape if self._values.ndim == 1 else (height, width, 4)
        self._pixels = np.empty(shape, self._values.dtype)

    def draw(self) -> None:
        """Clear and draw."""
        pixels, polygon, shape = self._pixels, self._polygon, self._shape
        pixels[:] = 0
        for rows, columns, value in zip(self._rows, self._columns, self._values, strict=True):
            pixels[polygon(rows, columns, shape)] = value

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture; it is a NumPy array already."""
        return {"face_id" if self._pixels.ndim == 2 else "color": self._pixels}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return painted_picture(self._pixels)


class Lines:
    """Lines in order, each with a ramp from one colour to the other."""

    def __init__(self, scene: LineScene) -> None:
        from skimage.draw import line

        self._line = line
        self._ends = scene.ends.tolist()
        self._starts = scene.colors[:, 0].astype(np.float32)
        self._changes = scene.colors[:, 1].astype(np.float32) - self._starts
        self._pixels = np.empty((scene.size[1], scene.size[0], 4), np.uint8)

    def draw(self) -> None:
        """Clear and draw."""
        pixels, line = self._pixels, self._line
        pixels[:] = 0
        for (x0, y0, x1, y1), start, change in zip(
            self._ends, self._starts, self._changes, strict=True
        ):
            rows, columns = line(y0, x0, y1, x1)
            share = np.linspace(0.0, 1.0, len(rows), dtype=np.float32)[:, np.newaxis]
            pixels[rows, columns] = start + share * change + np.float32(0.5)

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture; it is a NumPy array already."""
        return {"color": self._pixels}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return {
            "covered": self._pixels[:, :, 3] > 0,
            "color_linear": self._pixels[:, :, :3].copy(),
        }
