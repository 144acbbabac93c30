"""
NumPy: a Python loop over triangles or lines, the pixels of each at once.

Same rules as ``pure_python``, which says them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.pure_python import (
    GRID,
    available,
    corner_shares,
    draws,
    edge,
    environment,
    is_top_left,
    screen_corners,
)
from benchmarks.contestants.screen import edge_lines
from benchmarks.scenes import LineScene, Scene, TriangleScene

__all__ = ["NAME", "available", "draws", "environment", "prepare"]

NAME = "NumPy"


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        return Lines(scene)
    return Lines(edge_lines(scene)) if scene.mode == "edges" else Triangles(scene)


class Triangles:
    """The bounding box of each triangle as one array expression."""

    def __init__(self, scene: TriangleScene) -> None:
        corners, depths = screen_corners(scene)
        self._corners, self._depths = corners.tolist(), depths.tolist()
        self._shares = corner_shares(scene)
        width, height = self._size = scene.size
        self._x = np.arange(width) * GRID + GRID // 2
        self._y = (np.arange(height) * GRID + GRID // 2)[:, np.newaxis]

    def draw(self) -> None:
        """Clear and draw."""
        width, height = self._size
        self._depth = np.full((height, width), np.inf)
        self._face_id = np.full((height, width), -1, np.int32)
        if self._shares is not None:
            self._color = np.zeros((height, width, 4), np.uint8)
        for face, (corners, depths) in enumerate(zip(self._corners, self._depths, strict=True)):
            self._draw_triangle(face, corners, depths)

    def _draw_triangle(self, face: int, corners: list[Any], depths: list[float]) -> None:
        """Test the pixels of the bounding box together."""
        order = [0, 1, 2] if edge(*corners) > 0 else [0, 2, 1]
        a, b, c = (corners[n] for n in order)
        za, zb, zc = (depths[n] for n in order)
        area = edge(a, b, c)
        if area == 0:
            return
        columns = slice(max(min(a[0], b[0], c[0]) // GRID, 0), max(a[0], b[0], c[0]) // GRID + 1)
        rows = slice(max(min(a[1], b[1], c[1]) // GRID, 0), max(a[1], b[1], c[1]) // GRID + 1)
        point = (self._x[columns], self._y[rows])
        wa, wb, wc = edge(b, c, point), edge(c, a, point), edge(a, b, point)
        inside = (
            (wa >= (0 if is_top_left(b, c) else 1))
            & (wb >= (0 if is_top_left(c, a) else 1))
            & (wc >= (0 if is_top_left(a, b) else 1))
        )
        depth = (wa * za + wb * zb + wc * zc) / area
        seen = inside & (depth < self._depth[rows, columns])
        self._depth[rows, columns][seen] = depth[seen]
        self._face_id[rows, columns][seen] = face
        if self._shares is not None:
            weights = np.stack([wa[seen], wb[seen], wc[seen]], axis=1)
            mixed = weights @ self._shares[face][order]
            self._color[rows, columns, :3][seen] = mixed[:, 1:] / mixed[:, :1] + 0.5
            self._color[rows, columns, 3][seen] = 255

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the colour or the face at every pixel."""
        return {"face_id": self._face_id} if self._shares is None else {"color": self._color}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        found = {"covered": self._face_id >= 0, "face_id": self._face_id}
        if self._shares is not None:
            found["color_linear"] = self._color[:, :, :3].copy()
        return found


class Lines:
    """The pixels of each line as one array expression."""

    def __init__(self, scene: LineScene) -> None:
        self._scene = scene

    def draw(self) -> None:
        """Clear and draw."""
        width, height = self._scene.size
        self._color = np.zeros((height, width, 4), np.uint8)
        ends, colors = self._scene.ends, self._scene.colors.astype(np.int64)
        for n in range(len(ends)):
            change = ends[n, 2:] - ends[n, :2]
            steps = max(int(np.abs(change).max()), 1)
            step = np.arange(steps + 1)[:, np.newaxis]
            pixels = ends[n, :2] + (2 * step * change + steps) // (2 * steps)
            ramp = colors[n, 0] + (2 * step * (colors[n, 1] - colors[n, 0]) + steps) // (2 * steps)
            self._color[pixels[:, 1], pixels[:, 0]] = ramp

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture."""
        return {"color": self._color}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        return {
            "covered": self._color[:, :, 3] > 0,
            "color_linear": self._color[:, :, :3].copy(),
        }
