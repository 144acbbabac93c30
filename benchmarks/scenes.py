"""
The scenes, named by what they stress; every one is the same numbers on every machine.

Positions are float32, faces int32, as OpenGL takes them. Clip space is OpenGL's; screen rows run
down. ``SCENES`` lists them by name; a ``..._sample`` is a part small enough for plain Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SIZE = (1920, 1080)
"""Width and height of the pictures, pixels."""

RINGS, SIDES = 1000, 500
"""Of the torus: twice their product is a million faces."""

QUADS = 20
LINES = 1_000_000
LINE_LENGTH = 50
"""Pixels from end to end."""

SAMPLE_FACES, SAMPLE_LINES = 10_000, 2000
SAMPLE_SIZE = (192, 108)
SEED = 20

TEAPOT = Path(__file__).parent.parent / "models" / "teapot.obj"


@dataclass(frozen=True)
class TriangleScene:
    """Indexed triangles and the matrix that takes them to clip space; the nearer sample wins."""

    positions: NDArray[np.float32]
    """(V, 3), model space."""
    faces: NDArray[np.int32]
    """(F, 3), vertex numbers."""
    clip_from_model: NDArray[np.float64]
    """(4, 4)."""
    size: tuple[int, int]
    """Width and height, pixels."""
    work: int
    """How many units the scene holds: faces, or depth-tested samples."""
    unit: str

    def clip_positions(self) -> NDArray[np.float64]:
        """Return the vertices in clip space, (V, 4)."""
        points = np.column_stack([self.positions, np.ones(len(self.positions))])
        return points @ self.clip_from_model.T


@dataclass(frozen=True)
class LineScene:
    """Lines between pixels, drawn in order, each with a colour ramp."""

    ends: NDArray[np.int64]
    """(N, 4): x and y of the start, x and y of the end, pixels."""
    colors: NDArray[np.uint8]
    """(N, 2, 4): RGBA of the start and of the end."""
    size: tuple[int, int]
    work: int
    unit: str = "line"


Scene = TriangleScene | LineScene


def look_at(eye: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return view from world for an eye that looks at the origin, y up."""
    back = np.array(eye) / np.linalg.norm(eye)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back])
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = axes, -axes @ np.array(eye)
    return view


def perspective(fov_y: float, aspect: float, near: float, far: float) -> NDArray[np.float64]:
    """Return clip from view, as OpenGL's textbooks have it; the angle in degrees."""
    scale = 1.0 / math.tan(math.radians(fov_y) / 2.0)
    clip = np.zeros((4, 4))
    clip[0, 0], clip[1, 1] = scale / aspect, scale
    clip[2, 2], clip[2, 3] = -(far + near) / (far - near), -2.0 * far * near / (far - near)
    clip[3, 2] = -1.0
    return clip


def torus(rings: int, sides: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return a closed torus about the z axis, neighbours in memory near each other in space."""
    u, v = np.meshgrid(
        np.arange(rings) * (2.0 * np.pi / rings),
        np.arange(sides) * (2.0 * np.pi / sides),
        indexing="ij",
    )
    radius = 1.0 + 0.42 * np.cos(v)
    points = np.stack([radius * np.cos(u), radius * np.sin(u), 0.42 * np.sin(v)], axis=-1)
    i, j = np.meshgrid(np.arange(rings), np.arange(sides), indexing="ij")
    after_i, after_j = (i + 1) % rings, (j + 1) % sides
    a, b = i * sides + j, after_i * sides + j
    c, d = after_i * sides + after_j, i * sides + after_j
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return points.reshape(-1, 3).astype(np.float32), faces.astype(np.int32)


def million_triangles() -> TriangleScene:
    """Return a torus of a million faces that fills half of the screen, back faces included."""
    positions, faces = torus(RINGS, SIDES)
    positions = positions * np.float32([1.6, 1.0, 1.0])
    camera = perspective(42.0, SIZE[0] / SIZE[1], 0.5, 20.0) @ look_at((0.4, -1.6, 3.3))
    return TriangleScene(positions, faces, camera, SIZE, len(faces), "triangle")


def million_triangles_sample() -> TriangleScene:
    """Return ten thousand of the million faces, spread evenly over the torus."""
    whole = million_triangles()
    faces = np.ascontiguousarray(whole.faces[:: len(whole.faces) // SAMPLE_FACES])
    return TriangleScene(
        whole.positions, faces, whole.clip_from_model, whole.size, len(faces), "triangle"
    )


def full_screen_quads(
    order: str, size: tuple[int, int] = SIZE, quads: int = QUADS
) -> TriangleScene:
    """Return depth-tested quads over the whole screen, ``back_to_front`` or ``front_to_back``."""
    depths = np.linspace(0.9, -0.9, quads)
    if order == "front_to_back":
        depths = depths[::-1]
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], np.float32)
    positions = np.column_stack([np.tile(corners, (quads, 1)), np.repeat(depths, 4)])
    first = 4 * np.arange(quads, dtype=np.int32)[:, np.newaxis, np.newaxis]
    faces = (first + np.array([(0, 1, 2), (0, 2, 3)], np.int32)).reshape(-1, 3)
    samples = quads * size[0] * size[1]
    return TriangleScene(positions.astype(np.float32), faces, np.eye(4), size, samples, "sample")


def short_lines(count: int = LINES) -> LineScene:
    """Return random fifty-pixel lines, all inside the picture."""
    random = np.random.default_rng(SEED)
    margin = LINE_LENGTH + 1
    highest = (SIZE[0] - margin, SIZE[1] - margin)
    starts = random.integers((margin, margin), highest, (LINES, 2))
    angles = random.uniform(0.0, 2.0 * np.pi, LINES)
    steps = np.rint(LINE_LENGTH * np.column_stack([np.cos(angles), np.sin(angles)]))
    ends = np.column_stack([starts, starts + steps.astype(np.int64)])[:count]
    colors = random.integers(0, 256, (LINES, 2, 4), dtype=np.uint8)[:count]
    colors[:, :, 3] = 255
    return LineScene(np.ascontiguousarray(ends), np.ascontiguousarray(colors), SIZE, count)


def teapot() -> TriangleScene:
    """Return the teapot at 640 by 480."""
    vertices, faces = [], []
    for line in TEAPOT.read_text().splitlines():
        kind, *values = line.split() or [""]
        if kind == "v":
            vertices.append([float(value) for value in values[:3]])
        elif kind == "f":
            faces.append([int(value.split("/")[0]) - 1 for value in values])
    positions, size = np.array(vertices, np.float32), (640, 480)
    positions -= (positions.min(axis=0) + positions.max(axis=0)) / 2
    camera = perspective(40.0, size[0] / size[1], 0.5, 50.0) @ look_at((3.0, 4.0, 8.0))
    return TriangleScene(positions, np.array(faces, np.int32), camera, size, len(faces), "triangle")


SCENES: dict[str, Callable[[], Scene]] = {
    "million_triangles": million_triangles,
    "million_triangles_sample": million_triangles_sample,
    "fill_back_to_front": partial(full_screen_quads, "back_to_front"),
    "fill_front_to_back": partial(full_screen_quads, "front_to_back"),
    "fill_sample": partial(full_screen_quads, "back_to_front", SAMPLE_SIZE, 3),
    "short_lines": short_lines,
    "short_lines_sample": partial(short_lines, SAMPLE_LINES),
    "teapot": teapot,
}
