"""
Plain Python: the algorithms as textbooks have them, on lists, without NumPy.

Triangles: every pixel of the bounding box, three edge functions, a depth test. Lines: Bresenham's
error term with a colour mixed at every pixel. The rules are RasterJIT's (256 steps a pixel,
top-left edges, ties of lines towards the larger coordinate), so that the pictures can be compared
exactly. Vertices are put on the screen beforehand, untimed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "plain Python"

GRID = 256
"""Steps of the sub-pixel grid in a pixel."""

Point = tuple[int, int]


def available() -> str | None:
    """Return ``None``: there is always a Python."""
    return None


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    return Lines(scene) if isinstance(scene, LineScene) else Triangles(scene)


def screen_corners(scene: TriangleScene) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return each face's corners on the grid, (F, 3, 2), and their depths z / w, (F, 3)."""
    clip = scene.clip_positions()
    normalized = clip[:, :3] / clip[:, 3:]
    half = 0.5 * np.array(scene.size) * GRID
    screen = np.rint((normalized[:, :2] * (1.0, -1.0) + 1.0) * half).astype(np.int64)
    return screen[scene.faces], normalized[:, 2][scene.faces]


def edge(a: Point, b: Point, p: Point) -> int:
    """Return twice the area of the triangle a, b, p; positive if clockwise on the screen."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def is_top_left(a: Point, b: Point) -> bool:
    """Return whether the edge from a to b of a clockwise triangle owns the samples on it."""
    return b[1] < a[1] or (b[1] == a[1] and b[0] > a[0])


class Triangles:
    """A bounding-box loop for each triangle."""

    def __init__(self, scene: TriangleScene) -> None:
        corners, depths = screen_corners(scene)
        self._triangles = [
            ([(x, y) for x, y in triangle], face_depths)
            for triangle, face_depths in zip(corners.tolist(), depths.tolist(), strict=True)
        ]
        self._width, self._height = scene.size
        self._size = scene.size

    def draw(self) -> None:
        """Clear and draw."""
        self._depth = [[float("inf")] * self._width for _ in range(self._height)]
        self._face_id = [[-1] * self._width for _ in range(self._height)]
        for face, (corners, depths) in enumerate(self._triangles):
            self._draw_triangle(face, corners, depths)

    def _draw_triangle(self, face: int, corners: list[Point], depths: list[float]) -> None:
        """Test every pixel of the bounding box."""
        (a, b, c), (za, zb, zc) = corners, depths
        area = edge(a, b, c)
        if area == 0:
            return
        if area < 0:
            b, c, zb, zc, area = c, b, zc, zb, -area
        bias_a = 0 if is_top_left(b, c) else -1
        bias_b = 0 if is_top_left(c, a) else -1
        bias_c = 0 if is_top_left(a, b) else -1
        left = max(min(a[0], b[0], c[0]) // GRID, 0)
        right = min(max(a[0], b[0], c[0]) // GRID, self._width - 1)
        top = max(min(a[1], b[1], c[1]) // GRID, 0)
        bottom = min(max(a[1], b[1], c[1]) // GRID, self._height - 1)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                point = (column * GRID + GRID // 2, row * GRID + GRID // 2)
                wa, wb, wc = edge(b, c, point), edge(c, a, point), edge(a, b, point)
                if wa + bias_a >= 0 and wb + bias_b >= 0 and wc + bias_c >= 0:
                    depth = (wa * za + wb * zb + wc * zc) / area
                    if depth < self._depth[row][column]:
                        self._depth[row][column] = depth
                        self._face_id[row][column] = face

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the face at every pixel."""
        return {"face_id": np.array(self._face_id, np.int32)}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        face_id = self.read()["face_id"]
        return {"covered": face_id >= 0, "face_id": face_id}


class Lines:
    """Bresenham's algorithm, one line after the other."""

    def __init__(self, scene: LineScene) -> None:
        self._lines = list(zip(scene.ends.tolist(), scene.colors.tolist(), strict=True))
        self._width, self._height = scene.size

    def draw(self) -> None:
        """Clear and draw."""
        self._color = [[(0, 0, 0, 0)] * self._width for _ in range(self._height)]
        for (x0, y0, x1, y1), (start, end) in self._lines:
            self._draw_line(x0, y0, x1, y1, start, end)

    def _draw_line(
        self, x0: int, y0: int, x1: int, y1: int, start: list[int], end: list[int]
    ) -> None:
        """Step along the longer axis; the error term tells when to step along the other."""
        dx, dy = abs(x1 - x0), abs(y1 - y0)
        steps, short = max(dx, dy), min(dx, dy)
        step_x, step_y = (1 if x1 >= x0 else -1), (1 if y1 >= y0 else -1)
        is_flat = dx >= dy
        # A tie goes towards the larger coordinate, whichever way the line runs.
        grows = (step_y if is_flat else step_x) > 0
        error = steps if grows else steps - 1
        x, y = x0, y0
        for step in range(steps + 1):
            self._color[y][x] = tuple(
                (2 * (p * steps + step * (q - p)) + steps) // (2 * steps) if steps else p
                for p, q in zip(start, end, strict=True)
            )
            error += 2 * short
            carries = error >= 2 * steps
            if carries:
                error -= 2 * steps
            x += step_x if is_flat or carries else 0
            y += step_y if not is_flat or carries else 0

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the picture."""
        return {"color": np.array(self._color, np.uint8)}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        color = self.read()["color"]
        return {"covered": color[:, :, 3] > 0, "color": color}
