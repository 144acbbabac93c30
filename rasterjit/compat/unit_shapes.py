"""Shapes of unit size as triangles, for the solids that simulators have."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


class Triangulation(NamedTuple):
    """Triangles with normals and texture coordinates, v up."""

    positions: Float64
    faces: NDArray[np.int64]
    normals: Float64
    uv: Float64 | None


def join(surfaces: Iterable[Triangulation]) -> Triangulation:
    """Return several surfaces as one."""
    some = list(surfaces)
    starts = np.cumsum([0, *(len(one.positions) for one in some[:-1])])
    return Triangulation(
        np.concatenate([one.positions for one in some]),
        np.concatenate([one.faces + start for one, start in zip(some, starts, strict=True)]),
        np.concatenate([one.normals for one in some]),
        np.concatenate([one.uv for one in some if one.uv is not None]),
    )


def scale_and_shift(
    surface: Triangulation, scale: tuple[float, float, float], z: float = 0.0
) -> Triangulation:
    """Return a surface that is scaled, and then moved along z; mirrored if two scales are < 0."""
    factors = np.array(scale)
    normals = surface.normals / factors
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return surface._replace(positions=surface.positions * factors + (0.0, 0.0, z), normals=normals)


def make_grid_faces(rows: int, columns: int, rises: bool = False) -> NDArray[np.int64]:
    """Return the triangles between rows and columns of vertices, and which way they are cut."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1, 1)
    low, high = first + (0, 1, columns), first + (1, columns + 1, columns)
    if rises:
        low, high = first + (0, 1, columns + 1), first + (0, columns + 1, columns)
    return np.concatenate([low, high], axis=1).reshape(-1, 3)


def revolve(profile: Float64, slices: int, is_disk: bool = False) -> Triangulation:
    """
    Return a surface around the z axis.

    Parameters
    ----------
    profile : (N, 5) float64
        From below to above, seen from outside: radius, z, the normal's share away from the axis and
        along it, and t, the texture's row from the top.
    slices : int
    is_disk : bool
        Whether the texture lies on it as seen from above.
    """
    radius, z, out, along, t = (column[:, None] for column in profile.T)
    turn = np.arange(slices + 1) / slices
    cosine, sine = np.cos(2.0 * np.pi * turn), np.sin(2.0 * np.pi * turn)
    cosine[-1], sine[-1] = cosine[0], sine[0]
    shape = len(profile), slices + 1
    points = np.stack([radius * cosine, radius * sine, np.broadcast_to(z, shape)], axis=-1)
    normals = np.stack([out * cosine, out * sine, np.broadcast_to(along, shape)], axis=-1)
    if is_disk:
        uv = 0.5 - 0.5 * points[..., :2] * (-1.0, 1.0)
    else:
        # Where slices meet in a point each has its own, in the middle.
        u = turn + 0.5 / slices * (radius == 0.0)
        uv = np.stack([u, np.broadcast_to(1.0 - t, shape)], axis=-1)
    faces = make_grid_faces(*shape)
    corners = points.reshape(-1, 3)[faces]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces = faces[np.linalg.norm(sides, axis=1) > 1e-12]
    return Triangulation(points.reshape(-1, 3), faces, normals.reshape(-1, 3), uv.reshape(-1, 2))


def _make_arc(first: float, last: float, stacks: int, t: Any) -> Float64:
    """Return the profile of a ball of radius 1 between two elevations."""
    up = np.linspace(first, last, stacks + 1)
    radius, z = np.cos(up), np.sin(up)
    radius[np.abs(radius) < 1e-12] = 0.0
    return np.stack([radius, z, radius, z, t(up)], axis=1)


def _make_disk(z: float, sign: float, slices: int, stacks: int) -> Triangulation:
    """Return a disk of radius 1 that is seen from above (1) or below (-1)."""
    radius = np.arange(stacks + 1)[:: -1 if sign > 0.0 else 1] / stacks
    flat = np.zeros_like(radius)
    return revolve(
        np.stack([radius, flat + z, flat, flat + sign, flat], axis=1), slices, is_disk=True
    )


@functools.lru_cache(maxsize=64)
def make_unit_shape(name: str, slices: int, stacks: int, quads: int) -> Triangulation:
    """
    Return a shape of size 1 by its name.

    ``ball``, ``top`` and ``bottom`` of one about its centre, ``tube``, ``cylinder``, ``box``,
    ``square``, ``triangle`` and the three arrows.
    """
    half, quarter = max(1, stacks // 2), 0.5 * math.pi
    if name == "ball":
        return revolve(
            _make_arc(-quarter, quarter, 2 * half, lambda up: 0.5 - up / math.pi), slices
        )
    if name == "top":
        return revolve(_make_arc(0.0, quarter, half, lambda up: 1.0 - up / quarter), slices)
    if name == "bottom":
        return revolve(_make_arc(-quarter, 0.0, half, lambda up: -up / quarter), slices)
    if name == "tube":
        z = np.linspace(-1.0, 1.0, stacks + 1)
        one = np.ones_like(z)
        return revolve(np.stack([one, z, one, 0.0 * one, 0.5 - 0.5 * z], axis=1), slices)
    own = functools.partial(make_unit_shape, slices=slices, stacks=stacks, quads=quads)
    if name == "cylinder":
        disks = _make_disk(-1.0, -1.0, slices, half), _make_disk(1.0, 1.0, slices, half)
        return join([own("tube"), *disks])
    if name == "cone":
        radius = np.linspace(1.0, 0.0, stacks + 1)
        slope = np.full_like(radius, math.sqrt(0.5))
        side = revolve(np.stack([radius, 1.0 - radius, slope, slope, radius], axis=1), slices)
        return join([side, _make_disk(0.0, -1.0, slices, stacks)])
    if name in ("arrow", "arrow1"):
        tip = 1.75 if name == "arrow" else 1.0
        head = scale_and_shift(own("cone"), (tip, tip, 1.0 / 6.0), 1.0 / 3.0)
        return join([scale_and_shift(own("cylinder"), (1.0, 1.0, 1.0 / 6.0), 1.0 / 6.0), head])
    if name == "arrow2":
        ends = [scale_and_shift(own("cone"), (1.75, s * 1.75, s / 6), s / 3) for s in (1.0, -1.0)]
        return join([scale_and_shift(own("tube"), (1, 1, 1 / 3)), *ends])
    if name == "box":
        return join(_make_box_side(quads, number) for number in range(6))
    if name == "square":
        return make_rectangle((-1.0, 1.0), (-1.0, 1.0), quads)
    corners = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
    return Triangulation(
        corners, np.array([[0, 1, 2]]), np.tile((0.0, 0.0, 1.0), (3, 1)), corners[:, :2]
    )


def make_rectangle(x: tuple[float, float], y: tuple[float, float], quads: int = 1) -> Triangulation:
    """Return a rectangle in the plane z = 0, its texture once over all of it."""
    share = np.linspace(0.0, 1.0, quads + 1)
    v, u = (part.ravel() for part in np.meshgrid(share, share, indexing="ij"))
    points = np.stack([x[0] + (x[1] - x[0]) * u, y[0] + (y[1] - y[0]) * v, 0.0 * u], axis=1)
    normals = np.tile((0.0, 0.0, 1.0), (len(points), 1))
    return Triangulation(
        points, make_grid_faces(quads + 1, quads + 1), normals, np.stack([u, v], axis=1)
    )


def _make_box_side(quads: int, number: int) -> Triangulation:
    """Return a side of a box: right, left, back, front, top or bottom."""
    axis, sign = number // 2, 1.0 - 2.0 * (number % 2)
    across, up = (1, 2) if axis == 0 else (0, 2) if axis == 1 else (0, 1)
    flat = make_rectangle((-1.0, 1.0), (-1.0, 1.0), quads)
    points = np.empty_like(flat.positions)
    points[:, across], points[:, up], points[:, axis] = *flat.positions[:, :2].T, sign
    normals = np.zeros_like(points)
    normals[:, axis] = sign
    is_front = np.cross(np.eye(3)[across], np.eye(3)[up])[axis] == sign
    faces = flat.faces if is_front else flat.faces[:, ::-1]
    return Triangulation(points, faces, normals, flat.uv)


def make_flat_triangles(positions: Float64) -> Triangulation:
    """Return triangles (F, 3, 3) that share nothing, with the normals of their planes."""
    a, b, c = np.moveaxis(positions, 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)
    faces = np.arange(3 * len(positions)).reshape(-1, 3)
    return Triangulation(positions.reshape(-1, 3), faces, np.repeat(normals, 3, axis=0), None)


def merge_vertices(surface: Triangulation) -> Triangulation:
    """Return a surface whose faces share equal vertices."""
    parts = [surface.positions, surface.normals]
    rows = np.concatenate(parts if surface.uv is None else [*parts, surface.uv], axis=1)
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    uv = None if surface.uv is None else surface.uv[first]
    faces = inverse.reshape(-1)[surface.faces]
    return Triangulation(surface.positions[first], faces, surface.normals[first], uv)
