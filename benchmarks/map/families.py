"""
The families of meshes that the map draws, of any number of faces, with eight cameras each.

Cameras differ enough that what a frame could keep from the last one is little: they stand around an
object, or turn their heads. Everything is the same numbers on every machine.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks import meshes
from benchmarks.map.cells import IN_CODES
from benchmarks.meshes import SEED, look_at, perspective
from benchmarks.scenes import SIZE, TriangleScene

VIEWS = 8
TO_LIGHT = np.array([0.48, 0.6, 0.64])
TEXTURE_SIDE = 512

KNOT_TUBE, KNOT_ASPECT = 0.5, 8.0
"""Radius of the knot's tube, and rings for each side around it, so that faces are about square."""
KNOT_REPEATS = (12.0, 1.5)
GROUND_HALF, GROUND_REPEATS = 10.0, 10.0
"""Half a side of the terrain, and how often the texture is laid along a side."""
WAVES = ((0.50, 0.31, 0.9), (0.23, -0.74, 0.5), (1.30, 0.90, 0.14), (-1.70, 2.10, 0.07))
"""Of the terrain: along x, along z, and height of each wave."""
EYE_HEIGHT = 0.7
BOX_REPEATS = 2.0
"""How often the texture is laid along a unit of length."""
BOX_HALF = 0.45
"""Half a side of the boxes of the soup, in units of their mean distance, before it varies."""


class Geometry(NamedTuple):
    """A mesh with all that any look asks for, and its cameras."""

    positions: NDArray[np.float32]
    """(V, 3)"""
    faces: NDArray[np.int32]
    """(F, 3)"""
    normals: NDArray[np.float32]
    """(V, 3), unit."""
    uv: NDArray[np.float32]
    """(V, 2), v up."""
    colors: NDArray[np.uint8]
    """(V, 4), linear light, opaque."""
    fov_y: float
    """Degrees, of pictures that are wider than high or square."""
    views: NDArray[np.float64]
    """(VIEWS, 4, 4), view from world."""


def unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors, (..., 3), at length 1."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def grid(columns: int, rows: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return shares of both ways, (V, 2), of a grid of cells and its faces, column by column."""
    u, v = np.meshgrid(np.arange(columns + 1) / columns, np.arange(rows + 1) / rows, indexing="ij")
    i, j = np.meshgrid(
        np.arange(columns, dtype=np.int32), np.arange(rows, dtype=np.int32), indexing="ij"
    )
    a = i * (rows + 1) + j
    b, c, d = a + rows + 1, a + rows + 2, a + 1
    faces = np.stack([a, c, b, a, d, c], axis=-1).reshape(-1, 3)
    return np.stack([u.ravel(), v.ravel()], axis=1), np.ascontiguousarray(faces, np.int32)


def knot(faces: int) -> Geometry:
    """Return a closed tube along a knot, seen from all around: no borders, it hides itself."""
    sides = max(round(math.sqrt(faces / 2.0 / KNOT_ASPECT)), 3)
    shares, triangles = grid(max(round(faces / 2.0 / sides), 3), sides)
    along, across = 2.0 * np.pi * shares.T
    turn, wind = 2.0 * along, 3.0 * along
    outward = np.stack(
        [np.cos(wind) * np.cos(turn), np.cos(wind) * np.sin(turn), np.sin(wind)], axis=1
    )
    around = np.stack([-np.sin(turn), np.cos(turn), np.zeros_like(turn)], axis=1)
    upward = np.stack(
        [-np.sin(wind) * np.cos(turn), -np.sin(wind) * np.sin(turn), np.cos(wind)], axis=1
    )
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    tangent = unit(2.0 * (2.0 + np.cos(wind))[:, None] * around + 3.0 * upward)
    beside = np.cross(tangent, outward)
    normals = np.cos(across)[:, None] * outward + np.sin(across)[:, None] * beside
    positions = 2.0 * ring + outward + KNOT_TUBE * normals
    normals = normals.astype(np.float32)
    turns = 2.0 * np.pi * np.arange(VIEWS) / VIEWS
    eyes = [(9.5 * np.cos(t), 3.0 * np.sin(3.0 * t) + 0.7, 9.5 * np.sin(t)) for t in turns]
    return Geometry(
        positions.astype(np.float32), triangles, normals,
        (shares * KNOT_REPEATS).astype(np.float32), meshes.direction_colors(normals),
        42.0, np.array([look_at(eye) for eye in eyes]),
    )  # fmt: skip


def height(x: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the height of the terrain at places."""
    return sum(h * np.sin(a * x + b * z + 1.0) for a, b, h in WAVES)  # type: ignore[return-value]


def terrain(faces: int) -> Geometry:
    """Return hills seen along the ground: few large faces near by, all others far and thin."""
    side = max(round(math.sqrt(faces / 2.0)), 1)
    shares, triangles = grid(side, side)
    x, z = (2.0 * shares.T - 1.0) * GROUND_HALF
    steps = [h * np.cos(a * x + b * z + 1.0) for a, b, h in WAVES]
    along_x = sum(a * step for (a, _, _), step in zip(WAVES, steps, strict=True))
    along_z = sum(b * step for (_, b, _), step in zip(WAVES, steps, strict=True))
    normals = unit(np.stack([-along_x, np.ones_like(x), -along_z], axis=1))
    positions = np.stack([x, height(x, z), z], axis=1)
    # Columns on the left are drawn from far to near, those on the right from near to far.
    is_left = positions[triangles[:, 0], 0] < 0.0
    triangles = np.concatenate([triangles[is_left], triangles[~is_left][::-1]])
    turned = meshes.direction_colors(normals.astype(np.float32))
    views = []
    for turn in 2.0 * np.pi * np.arange(VIEWS) / VIEWS:
        place = np.array([1.5 * np.cos(turn), 0.0, 0.8 * GROUND_HALF + np.sin(turn)])
        place[1] = float(height(*place[[0, 2]])) + EYE_HEIGHT
        ahead = place + (0.5 * np.sin(2.0 * turn), -0.12, -1.0)
        views.append(look_at(tuple(place), tuple(ahead)))
    return Geometry(
        positions.astype(np.float32), np.ascontiguousarray(triangles), normals.astype(np.float32),
        (shares * GROUND_REPEATS).astype(np.float32), turned, 55.0, np.array(views),
    )  # fmt: skip


def boxes(faces: int) -> Geometry:
    """Return boxes turned at random that overlap, in no order, in a ball: many layers."""
    count = max(round(faces / 12.0), 1)
    random = np.random.default_rng(SEED)
    centers = unit(random.normal(size=(count, 3))) * np.cbrt(random.uniform(size=(count, 1)))
    halves = random.uniform(0.5, 1.5, (count, 3)) * BOX_HALF * np.cbrt(4.0 * np.pi / 3.0 / count)
    rotations = meshes.random_rotations(random, count)
    corners, normals, uv = box_sides()
    placed = np.einsum("nij,nkj->nki", rotations, corners * halves[:, None]) + centers[:, None]
    turned = np.einsum("nij,kj->nki", rotations, normals).astype(np.float32).reshape(-1, 3)
    base = random.integers(0, 160, (count, 1, 4), np.uint8)
    colors = base + random.integers(0, 96, (count, len(corners), 4), np.uint8)
    colors[..., 3] = meshes.OPAQUE
    # A box shows a piece of the texture, as large as the box, so that texels have one size.
    laid = random.uniform(size=(count, 1, 2)) + BOX_REPEATS * halves[:, :1, None] * uv
    first = 4 * np.arange(6 * count, dtype=np.int32)[:, None, None]
    triangles = (first + np.array([(0, 1, 2), (0, 2, 3)], np.int32)).reshape(-1, 3)
    turns = 2.0 * np.pi * np.arange(VIEWS) / VIEWS
    eyes = [(3.4 * np.cos(t), np.sin(3.0 * t) + 0.3, 3.4 * np.sin(t)) for t in turns]
    return Geometry(
        placed.reshape(-1, 3).astype(np.float32), triangles, turned,
        laid.reshape(-1, 2).astype(np.float32), colors.reshape(-1, 4),
        45.0, np.array([look_at(eye) for eye in eyes]),
    )  # fmt: skip


def box_sides() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return corners, (24, 3), normals, (24, 3), and uv, (24, 2), 0 to 1, of a box from -1 to 1."""
    corners, normals = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            outward, right = np.zeros((2, 3))
            outward[axis], right[(axis + 1) % 3] = sign, 1.0
            up = np.cross(outward, right)
            for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corners.append(outward + x * right + y * up)
                normals.append(outward)
    uv = np.tile(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]), (6, 1))
    return np.array(corners), np.array(normals), uv


def slivers(faces: int) -> Geometry:
    """Return thin triangles 400 pixels long in a picture of 1920x1080, turned a little by turn."""
    positions, triangles = meshes.slivers(faces, 400.0, SIZE)
    colors = meshes.random_colors(np.random.default_rng(SEED), len(positions))
    views = []
    for turn in 0.05 * np.arange(VIEWS):
        views.append(np.eye(4))
        views[-1][:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    normals = np.tile(np.float32([0.0, 0.0, 1.0]), (len(positions), 1))
    return Geometry(
        positions, triangles, normals, positions[:, :2].copy(), colors, 0.0, np.array(views)
    )


FAMILIES: dict[str, Callable[[int], Geometry]] = {
    "knot": knot,
    "terrain": terrain,
    "boxes": boxes,
    "slivers": slivers,
}


@functools.lru_cache(1)
def geometry(family: str, faces: int) -> Geometry:
    """Return a mesh; the last one is kept, for it is drawn in many sizes and looks."""
    return FAMILIES[family](faces)


@functools.cache
def texture() -> NDArray[np.uint8]:
    """Return the picture of the texture, (TEXTURE_SIDE, TEXTURE_SIDE, 3) sRGB."""
    random = np.random.default_rng(SEED)
    y, x = np.mgrid[0:TEXTURE_SIDE, 0:TEXTURE_SIDE]
    fields = (x // 64 + y // 64) % 2
    image = np.empty((TEXTURE_SIDE, TEXTURE_SIDE, 3), np.uint8)
    image[:, :, 0] = 70 + 90 * fields
    image[:, :, 1] = 60 + 120 * x // TEXTURE_SIDE
    image[:, :, 2] = 60 + 120 * y // TEXTURE_SIDE
    return image + random.integers(0, 32, (TEXTURE_SIDE, TEXTURE_SIDE, 1), np.uint8)


def make_scene(family: str, faces: int, look: str, size: tuple[int, int]) -> TriangleScene:
    """Return what contestants draw: a family's mesh of about so many faces in a look of TITLES."""
    mesh = geometry(family, faces)
    lens = np.eye(4)
    if mesh.fov_y:
        lens = perspective(mesh.fov_y, size[0] / size[1], 0.1, 40.0)
    views = lens @ mesh.views
    looks = {
        "colors": {"colors": mesh.colors},
        "phong": {"colors": mesh.colors, "normals": mesh.normals, "to_light": TO_LIGHT},
        "texture": {"uv": mesh.uv, "texture": texture()},
        IN_CODES: {"uv": mesh.uv, "texture": texture(), "in_codes": True},
    }
    return TriangleScene(
        mesh.positions, mesh.faces, views[0], size, len(mesh.faces), "triangle", views=views,
        **looks[look],
    )  # fmt: skip
