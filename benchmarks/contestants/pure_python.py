"""
Plain Python: the algorithms as textbooks have them, on lists, without NumPy.

Triangles: every pixel of the bounding box, three edge functions, a depth test, colours mixed with
perspective. Lines: Bresenham's error term with a colour mixed at every pixel. The rules are
RasterJIT's (256 steps a pixel, top-left edges, ties of lines towards the larger coordinate), so
that the pictures can be compared exactly. Vertices are put on the screen beforehand, untimed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.contestants import Prepared
from benchmarks.contestants.needs import TAKES_PIXELS, refusal
from benchmarks.contestants.screen import edge_lines, screen_points
from benchmarks.scenes import LineScene, Scene, TriangleScene

NAME = "plain Python"

GRID = 256
"""Steps of the sub-pixel grid in a pixel."""

MAX_PIXELS = 20_000_000
"""Visited, of about a microsecond each: with more, a picture takes longer than is of interest."""

Point = tuple[int, int]
Shares = list[tuple[float, float, float, float]]
"""Of each corner: 1 / w and red, green and blue over w, which are linear on the screen."""


def available() -> str | None:
    """Return ``None``: there is always a Python."""
    return None


def environment(threads: int) -> dict[str, str]:
    """Return the environment variables that its process must start with."""
    return {}


def draws(scene: Scene) -> str | None:
    """Return ``None``, or the reason why it cannot draw this scene."""
    reason = refusal(scene, TAKES_PIXELS)
    return too_long(pixels_visited(scene)) if reason is None else reason


def prepare(scene: Scene, threads: int) -> Prepared:
    """Return the scene ready to draw."""
    if isinstance(scene, LineScene):
        return Lines(scene)
    return Lines(edge_lines(scene)) if scene.mode == "edges" else Triangles(scene)


def too_long(pixels: int, most: int = MAX_PIXELS) -> str | None:
    """Return a reason not to draw if too many pixels have to be visited."""
    if pixels <= most:
        return None
    return f"{pixels:.2g} pixels to visit are too many to wait for"


def pixels_visited(scene: Scene) -> int:
    """Return the pixels of all lines, or of the bounding boxes of all faces."""
    if isinstance(scene, TriangleScene) and scene.mode == "fill":
        corners, _ = screen_corners(scene)
        last = GRID * (np.array(scene.size) - 1)
        first, end = (
            bound.clip(0, last) // GRID for bound in (corners.min(axis=1), corners.max(axis=1))
        )
        return int((end - first + 1).prod(axis=1).sum())
    ends = (scene if isinstance(scene, LineScene) else edge_lines(scene)).ends
    return int(np.abs(ends[:, 2:] - ends[:, :2]).max(axis=1).sum())


def screen_corners(scene: TriangleScene) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return each face's corners on the grid, (F, 3, 2), and their depths z / w, (F, 3)."""
    points, depths = screen_points(scene)
    return np.rint(points * GRID).astype(np.int64)[scene.faces], depths[scene.faces]


def corner_shares(scene: TriangleScene) -> NDArray[np.float64] | None:
    """Return 1 / w and the colours over w of each face's corners, (F, 3, 4), if it has colours."""
    if scene.colors is None:
        return None
    values = np.column_stack([np.ones(len(scene.positions)), scene.colors[:, :3]])
    return (values / scene.clip_positions()[:, 3:])[scene.faces]


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
        shares = corner_shares(scene)
        self._triangles = list(
            zip(
                [[(x, y) for x, y in triangle] for triangle in corners.tolist()],
                depths.tolist(),
                [None] * len(corners) if shares is None else shares.tolist(),
                strict=True,
            )
        )
        self._has_colors = shares is not None
        self._width, self._height = scene.size

    def draw(self) -> None:
        """Clear and draw."""
        width, height = self._width, self._height
        self._depth = [[float("inf")] * width for _ in range(height)]
        self._face_id = [[-1] * width for _ in range(height)]
        self._color = [[(0, 0, 0, 0)] * width for _ in range(height)] if self._has_colors else []
        for face, (corners, depths, shares) in enumerate(self._triangles):
            self._draw_triangle(face, corners, depths, shares)

    def _box(self, a: Point, b: Point, c: Point) -> tuple[int, int, int, int]:
        """Return the first and last column, and the first and last row, to look at."""
        return (
            max(min(a[0], b[0], c[0]) // GRID, 0),
            min(max(a[0], b[0], c[0]) // GRID, self._width - 1),
            max(min(a[1], b[1], c[1]) // GRID, 0),
            min(max(a[1], b[1], c[1]) // GRID, self._height - 1),
        )

    def _draw_triangle(
        self, face: int, corners: list[Point], depths: list[float], shares: Shares | None
    ) -> None:
        """Test every pixel of the box."""
        order = (0, 1, 2) if edge(*corners) > 0 else (0, 2, 1)
        a, b, c = (corners[n] for n in order)
        za, zb, zc = (depths[n] for n in order)
        area = edge(a, b, c)
        if area == 0:
            return
        bias_a = 0 if is_top_left(b, c) else -1
        bias_b = 0 if is_top_left(c, a) else -1
        bias_c = 0 if is_top_left(a, b) else -1
        left, right, top, bottom = self._box(a, b, c)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                point = (column * GRID + GRID // 2, row * GRID + GRID // 2)
                wa, wb, wc = edge(b, c, point), edge(c, a, point), edge(a, b, point)
                if wa + bias_a >= 0 and wb + bias_b >= 0 and wc + bias_c >= 0:
                    depth = (wa * za + wb * zb + wc * zc) / area
                    if depth < self._depth[row][column]:
                        self._depth[row][column] = depth
                        self._face_id[row][column] = face
                        if shares is not None:
                            self._color[row][column] = mix((wa, wb, wc), [shares[n] for n in order])

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the colour or the face at every pixel."""
        if self._has_colors:
            return {"color": np.array(self._color, np.uint8)}
        return {"face_id": np.array(self._face_id, np.int32)}

    def picture(self) -> dict[str, NDArray[Any]]:
        """Return what is compared."""
        face_id = np.array(self._face_id, np.int32)
        found = {"covered": face_id >= 0, "face_id": face_id}
        if self._has_colors:
            found["color_linear"] = self.read()["color"][:, :, :3].copy()
        return found


def mix(weights: tuple[int, int, int], shares: Shares) -> tuple[int, int, int, int]:
    """Return the colour between three corners, each byte rounded half up."""
    w, red, green, blue = (
        sum(weight * share[n] for weight, share in zip(weights, shares, strict=True))
        for n in range(4)
    )
    return int(red / w + 0.5), int(green / w + 0.5), int(blue / w + 0.5), 255


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
        return {"covered": color[:, :, 3] > 0, "color_linear": color[:, :, :3].copy()}
