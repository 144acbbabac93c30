"""
Pillow: ``ImageDraw.line`` and ``ImageDraw.polygon``, one call for each line or face.

There is no depth test: faces are painted far to near by the mean depth of their corners, an order
made beforehand, which shows the same picture where faces neither cross nor overlap in circles. A
face or a line has one colour, that of its corners on average, or of its start. Polygons are filled
with their borders, so that they cover pixels whose centres lie outside.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import TAKES_PIXELS, painted_picture, refusal
from benchmarks.contestants.screen import edge_lines, painted_faces
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "Pillow"


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    return (
        None if find_spec("PIL") else 'the package pillow is not installed (pip install ".[bench]")'
    )


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    return refusal(scene, TAKES_PIXELS)


def alike(scene: Scene) -> tuple[float, float]:
    """Return the shares of pixels alike that its rules allow for: faces have wider borders."""
    if isinstance(scene, LineScene):
        return 0.99, 0.0
    return (0.85, 0.0) if scene.mode == "edges" else (0.9, 0.0)


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        return Lines(scene)
    if scene.mode == "edges":
        return Lines(edge_lines(scene))
    return Faces(scene)


class Canvas:
    """An image of colours or of 32-bit numbers, and the way to NumPy."""

    def __init__(self, size: tuple[int, int], mode: str) -> None:
        from PIL import Image, ImageDraw

        self._image = Image.new(mode, size)
        self._draw = ImageDraw.Draw(self._image)
        self._everywhere = (0, 0, *size)

    def clear(self) -> None:
        """Set the image to zeros."""
        self._image.paste(0, self._everywhere)

    def pixels(self) -> NDArray[Any]:
        """Return the image, (H, W) int32 or (H, W, 4) uint8."""
        return np.asarray(self._image)


class Faces(Canvas):
    """Faces far to near."""

    def __init__(self, scene: TriangleScene) -> None:
        corners, values = painted_faces(scene)
        super().__init__(scene.size, "I" if values.ndim == 1 else "RGBA")
        self._corners = corners.reshape(-1, 6).tolist()
        self._values = values.tolist() if values.ndim == 1 else list(map(tuple, values.tolist()))

    def draw(self) -> None:
        """Clear and draw."""
        self.clear()
        polygon = self._draw.polygon
        for corners, value in zip(self._corners, self._values, strict=True):
            polygon(corners, value)

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture."""
        pixels = self.pixels()
        return {"face_id" if pixels.ndim == 2 else "color": pixels}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return painted_picture(self.pixels())


class Lines(Canvas):
    """Lines in order, each in the colour of its start."""

    def __init__(self, scene: LineScene) -> None:
        super().__init__(scene.size, "RGBA")
        self._ends = scene.ends.tolist()
        self._colors = list(map(tuple, scene.colors[:, 0].tolist()))

    def draw(self) -> None:
        """Clear and draw."""
        self.clear()
        line = self._draw.line
        for ends, color in zip(self._ends, self._colors, strict=True):
            line(ends, color)

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture."""
        return {"color": self.pixels()}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return {"covered": self.pixels()[:, :, 3] > 0}
