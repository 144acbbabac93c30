"""The shapes and cameras that scenes are made of, in NumPy; the same numbers on every machine."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

SEED = 20

Mesh = tuple[NDArray[np.float32], NDArray[np.int32]]
"""Positions, (V, 3), model space, and faces, (F, 3), vertex numbers."""

TUBE_RADIUS = 0.42
"""Of the torus, whose ring has radius 1."""

OPAQUE = 255


def look_at(
    eye: tuple[float, float, float], target: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> NDArray[np.float64]:
    """Return view from world, (4, 4), for an eye that looks at a point, y up."""
    back = np.subtract(eye, target)
    back /= np.linalg.norm(back)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back])
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = axes, -axes @ np.array(eye)
    return view


def perspective(fov_y: float, aspect: float, near: float, far: float) -> NDArray[np.float64]:
    """Return clip from view, (4, 4), as OpenGL's textbooks have it; the angle in degrees."""
    scale = 1.0 / math.tan(math.radians(fov_y) / 2.0)
    clip = np.zeros((4, 4))
    clip[0, 0], clip[1, 1] = scale / aspect, scale
    clip[2, 2], clip[2, 3] = -(far + near) / (far - near), -2.0 * far * near / (far - near)
    clip[3, 2] = -1.0
    return clip


def ring_angles(rings: int, sides: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the angles about the axis and around the tube, (V,) each, of a torus' vertices."""
    u, v = np.meshgrid(
        np.arange(rings) * (2.0 * np.pi / rings),
        np.arange(sides) * (2.0 * np.pi / sides),
        indexing="ij",
    )
    return u.ravel(), v.ravel()


def torus(rings: int, sides: int) -> Mesh:
    """
    Return a closed torus about the z axis, ``2 * rings * sides`` faces, counter-clockwise outside.

    Neighbours in memory are near each other in space.
    """
    u, v = ring_angles(rings, sides)
    radius = 1.0 + TUBE_RADIUS * np.cos(v)
    points = np.stack([radius * np.cos(u), radius * np.sin(u), TUBE_RADIUS * np.sin(v)], axis=-1)
    i, j = np.meshgrid(
        np.arange(rings, dtype=np.int32), np.arange(sides, dtype=np.int32), indexing="ij"
    )
    after_i, after_j = (i + 1) % rings, (j + 1) % sides
    a, b = i * sides + j, after_i * sides + j
    c, d = after_i * sides + after_j, i * sides + after_j
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return points.astype(np.float32), np.ascontiguousarray(faces, np.int32)


def torus_normals(
    rings: int, sides: int, stretch: NDArray[np.float32] | None = None
) -> NDArray[np.float32]:
    """Return the unit normals, (V, 3), of a torus, or of one stretched along the axes."""
    u, v = ring_angles(rings, sides)
    normals = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    if stretch is not None:
        normals /= stretch
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals.astype(np.float32)


def torus_size(faces: int) -> tuple[int, int]:
    """Return the rings and sides of a torus of about so many faces, twice as many rings."""
    sides = max(round(math.sqrt(faces / 4)), 3)
    return max(round(faces / (2 * sides)), 3), sides


def direction_colors(directions: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return opaque colours, (V, 4), linear light, that show unit vectors as RGB."""
    colors = np.full((len(directions), 4), OPAQUE, np.uint8)
    colors[:, :3] = np.rint(127.5 * (directions + 1.0))
    return colors


def random_colors(random: np.random.Generator, count: int) -> NDArray[np.uint8]:
    """Return opaque random colours, (count, 4), linear light."""
    colors = random.integers(0, 256, (count, 4), dtype=np.uint8)
    colors[:, 3] = OPAQUE
    return colors


def slivers(count: int, length: float, size: tuple[int, int]) -> Mesh:
    """
    Return thin triangles in clip space, each alone: w is 1 everywhere.

    Their middles are random points of the picture, their directions and depths random, their
    widths at the base 0.2 to 1 pixel, their lengths ``length`` pixels.
    """
    random = np.random.default_rng(SEED)
    middles = random.uniform((0.0, 0.0), size, (count, 2))
    angles = random.uniform(0.0, 2.0 * np.pi, count)
    along = np.column_stack([np.cos(angles), np.sin(angles)])
    across = np.column_stack([-np.sin(angles), np.cos(angles)])
    half = 0.5 * random.uniform(0.2, 1.0, (count, 1)) * across
    base = middles - 0.5 * length * along
    pixels = np.stack([base + half, base - half, middles + 0.5 * length * along], axis=1)
    depths = np.broadcast_to(random.uniform(-0.9, 0.9, (count, 1, 1)), (count, 3, 1))
    points = np.concatenate([2.0 * pixels / size - 1.0, depths], axis=2)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return points.reshape(-1, 3).astype(np.float32), faces


def quads(depths: NDArray[np.float64]) -> Mesh:
    """Return quads over the whole picture in clip space, one at each depth."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], np.float32)
    positions = np.column_stack([np.tile(corners, (len(depths), 1)), np.repeat(depths, 4)])
    first = 4 * np.arange(len(depths), dtype=np.int32)[:, np.newaxis, np.newaxis]
    faces = (first + np.array([(0, 1, 2), (0, 2, 3)], np.int32)).reshape(-1, 3)
    return positions.astype(np.float32), faces


def random_rotations(random: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Return rotations, (count, 3, 3), about random axes, from random unit quaternions."""
    q = random.normal(size=(count, 4))
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
