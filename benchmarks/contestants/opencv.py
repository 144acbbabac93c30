"""
OpenCV: ``line``, ``polylines`` and ``fillConvexPoly``, one call for each line or face.

There is no depth test: faces are painted far to near by the mean depth of their corners, an order
made beforehand, which shows the same picture where faces neither cross nor overlap in circles. A
face or a line has one colour, that of its corners on average, or of its start. The border of a
filled polygon is drawn as well, so that it covers pixels whose centres lie outside.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import EDGE_COLOR, TAKES_PIXELS, painted_picture, refusal
from benchmarks.contestants.screen import edge_lines, painted_faces
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "OpenCV"

SUBPIXEL_BITS = 8


def available() -> str | None:
    """Return ``None``, or the reason why it cannot draw here."""
    if find_spec("cv2") is None:
        return 'the package opencv-python-headless is not installed (pip install ".[bench]")'
    return None


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
    return Edges(scene) if scene.mode == "edges" else Faces(scene)


class Faces:
    """Faces far to near."""

    def __init__(self, scene: TriangleScene) -> None:
        import cv2

        self._cv2 = cv2
        corners, values = painted_faces(scene)
        self._corners = list(np.rint(corners * 2**SUBPIXEL_BITS).astype(np.int32))
        self._values = values.tolist()
        width, height = scene.size
        shape = (height, width) if values.ndim == 1 else (height, width, 4)
        self._pixels = np.empty(shape, values.dtype)

    def draw(self) -> None:
        """Clear and draw."""
        fill, pixels, plain = self._cv2.fillConvexPoly, self._pixels, self._cv2.LINE_8
        pixels[:] = 0
        for corners, value in zip(self._corners, self._values, strict=True):
            fill(pixels, corners, value, plain, SUBPIXEL_BITS)

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture; it is a NumPy array already."""
        return {"face_id" if self._pixels.ndim == 2 else "color": self._pixels}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return painted_picture(self._pixels)


class Edges:
    """Edges of one colour, in one call."""

    def __init__(self, scene: TriangleScene) -> None:
        import cv2

        self._cv2 = cv2
        self._edges = list(edge_lines(scene).ends.reshape(-1, 2, 2).astype(np.int32))
        self._pixels = np.empty((scene.size[1], scene.size[0], 4), np.uint8)

    def draw(self) -> None:
        """Clear and draw."""
        self._pixels[:] = 0
        self._cv2.polylines(self._pixels, self._edges, False, EDGE_COLOR)

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture; it is a NumPy array already."""
        return {"color": self._pixels}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return {"covered": self._pixels[:, :, 3] > 0}


class Lines:
    """Lines in order, each in the colour of its start."""

    def __init__(self, scene: LineScene) -> None:
        import cv2

        self._cv2 = cv2
        ends = scene.ends.tolist()
        self._lines = [((x0, y0), (x1, y1)) for x0, y0, x1, y1 in ends]
        self._colors = scene.colors[:, 0].tolist()
        self._pixels = np.empty((scene.size[1], scene.size[0], 4), np.uint8)

    def draw(self) -> None:
        """Clear and draw."""
        line, pixels = self._cv2.line, self._pixels
        pixels[:] = 0
        for (start, end), color in zip(self._lines, self._colors, strict=True):
            line(pixels, start, end, color)

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture; it is a NumPy array already."""
        return {"color": self._pixels}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return {"covered": self._pixels[:, :, 3] > 0}
