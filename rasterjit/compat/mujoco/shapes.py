"""The shapes of MuJoCo's geoms as triangles, divided as MuJoCo divides them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.compat.unit_shapes import (
    Float64,
    Triangulation,
    make_flat_triangles,
    make_grid_faces,
    make_rectangle,
    make_unit_shape,
    merge_vertices,
    revolve,
    scale_and_shift,
)

MAX_PLANE_GRID = 200
"""Lines that MuJoCo divides an infinite plane by."""

MAX_ANGLE_COSINE = 0.8
"""Cosine between the normals of a mesh's vertex and of its face below which the face's is drawn."""

CUBE_SIDES = (
    (0, 1.0, 2, -1.0, 1, -1.0), (0, -1.0, 2, 1.0, 1, -1.0), (1, 1.0, 0, 1.0, 2, 1.0),
    (1, -1.0, 0, 1.0, 2, -1.0), (2, 1.0, 0, 1.0, 1, -1.0), (2, -1.0, 0, -1.0, 1, -1.0),
)  # fmt: skip
"""Of each side of OpenGL's cube maps: its axis and sign, and those along which s and t grow."""


def make_plane(model: Any, number: int) -> Triangulation:
    """Return a plane of the model, by its number; infinite ones reach beyond the far plane."""
    geom = np.flatnonzero(model.geom_type == 0)[number]
    far, halves, places = model.vis.map.zfar * model.stat.extent, [], []
    for k in range(2):
        half = float(model.geom_size[geom, k])
        places.append(np.array([0.0, 1.0, 0.0, 1.0] if k == 0 else [0.0, 0.0, 1.0, 1.0]))
        if half <= 0.0:
            material = model.geom_matid[geom]
            repeat = float(model.mat_texrepeat[material, k]) if material >= 0 else 0.0
            half = 1.05 * far + (2.0 / repeat if repeat > 0.0 else 2.1 * far / (MAX_PLANE_GRID - 2))
            # Along what is infinite, texture coordinates are halves of the positions.
            places[k] = (places[k] - 0.5) * half + k
        halves.append(half)
    x, y = halves
    return make_rectangle((-x, x), (-y, y))._replace(uv=np.stack(places, axis=1))


def make_mesh(model: Any, data_number: int) -> Triangulation:
    """Return a mesh of the model, or its convex hull, by the ``dataid`` of a geom."""
    number, is_hull = divmod(data_number, 2)
    start, has_uv = model.mesh_vertadr[number], model.mesh_texcoordadr[number] >= 0
    if is_hull:
        graph = model.mesh_graph[model.mesh_graphadr[number] :]
        first = 2 + 3 * graph[0] + 3 * graph[1]
        numbers = graph[first : first + 3 * graph[1]].reshape(-1, 3)
        hull = make_flat_triangles(model.mesh_vert[start + numbers].astype(np.float64))
        if has_uv:
            uv = model.mesh_texcoord[model.mesh_texcoordadr[number] + numbers].reshape(-1, 2)
            hull = hull._replace(uv=flip_v(uv))
        return hull
    own = slice(model.mesh_faceadr[number], model.mesh_faceadr[number] + model.mesh_facenum[number])
    corners = make_flat_triangles(model.mesh_vert[start + model.mesh_face[own]].astype(np.float64))
    smooth = model.mesh_normal[model.mesh_normaladr[number] + model.mesh_facenormal[own]]
    smooth = smooth.reshape(-1, 3).astype(np.float64)
    if has_uv:
        places = model.mesh_texcoordadr[number] + model.mesh_facetexcoord[own]
        return merge_vertices(
            corners._replace(normals=smooth, uv=flip_v(model.mesh_texcoord[places].reshape(-1, 2)))
        )
    is_sharp = np.einsum("ij,ij->i", smooth, corners.normals) < MAX_ANGLE_COSINE
    return merge_vertices(
        corners._replace(normals=np.where(is_sharp[:, None], corners.normals, smooth))
    )


def flip_v(uv: NDArray[np.float32]) -> Float64:
    """Return texture coordinates with v up."""
    return np.stack([uv[:, 0], 1.0 - uv[:, 1].astype(np.float64)], axis=1)


def make_height_field(model: Any, number: int) -> Triangulation:
    """Return a height field of the model with its base."""
    rows, columns = int(model.hfield_nrow[number]), int(model.hfield_ncol[number])
    size = model.hfield_size[number].astype(np.float64)
    first = model.hfield_adr[number]
    heights = model.hfield_data[first : first + rows * columns].reshape(rows, columns) * size[2]
    x, y = np.linspace(-size[0], size[0], columns), np.linspace(-size[1], size[1], rows)
    points = np.stack(np.broadcast_arrays(x, y[:, None], heights), axis=-1).astype(np.float64)
    top = points.reshape(-1, 3)[make_grid_faces(rows, columns, rises=True)]
    walls = [
        _make_wall(edge, -size[3])
        for edge in (points[0], points[:, -1], points[-1, ::-1], points[::-1, 0])
    ]
    low = scale_and_shift(
        make_rectangle((-size[0], size[0]), (-size[1], size[1])), (1.0, 1.0, 1.0), -size[3]
    )
    base = low.positions[low.faces[:, ::-1]]
    return make_flat_triangles(np.concatenate([top, *walls, base]))


def _make_wall(edge: Float64, bottom: float) -> Float64:
    """Return the triangles, (F, 3, 3), from an edge, seen from left to right, down to a height."""
    low = edge.copy()
    low[:, 2] = bottom
    return np.concatenate([low, edge])[make_grid_faces(2, len(edge))]


def wrap_in_cube(surface: Triangulation, factors: tuple[float, float, float]) -> Triangulation:
    """
    Return a surface whose uv lead to the sides of a cube, which lie below each other in a picture.

    Parameters
    ----------
    surface : Triangulation
    factors : (float, float, float)
        On its positions, which are the directions in which the cube is seen.
    """
    corners = surface.positions[surface.faces] * factors
    middle = corners.mean(axis=1)
    axis = np.abs(middle).argmax(axis=1)
    side = 2 * axis + (np.take_along_axis(middle, axis[:, None], axis=1)[:, 0] < 0.0)
    uv = np.empty((len(corners), 3, 2))
    for number, (main, _, right, right_sign, down, down_sign) in enumerate(CUBE_SIDES):
        some = corners[side == number]
        depth = np.maximum(np.abs(some[..., main]), 1e-9)
        s = np.clip(0.5 + 0.5 * right_sign * some[..., right] / depth, 0.002, 0.998)
        t = np.clip(0.5 + 0.5 * down_sign * some[..., down] / depth, 0.002, 0.998)
        uv[side == number] = np.stack([s, 1.0 - (number + t) / 6.0], axis=-1)
    return Triangulation(
        surface.positions[surface.faces].reshape(-1, 3),
        np.arange(3 * len(corners)).reshape(-1, 3),
        surface.normals[surface.faces].reshape(-1, 3),
        uv.reshape(-1, 2),
    )


def make_sky(quads: int = 16) -> Triangulation:
    """Return a cylinder seen from inside, of radius and half height 1, that a cube wraps."""
    box = make_unit_shape("box", 8, 8, quads)
    wrapped = wrap_in_cube(box, (1.0, 1.0, 1.0))
    # The cube of the sky lies on its side.
    turned = np.stack(
        [wrapped.positions[:, 0], -wrapped.positions[:, 2], wrapped.positions[:, 1]], axis=1
    )
    across = np.maximum(np.hypot(turned[:, 0], turned[:, 1]), np.abs(turned[:, 2]))
    return wrapped._replace(positions=turned / across[:, None], faces=wrapped.faces[:, ::-1])


def make_haze(spread: float, slices: int) -> tuple[Triangulation, Float64]:
    """Return the cone of haze above the horizon, of height 1, and the alpha of its vertices."""
    slope = math.atan2(1.0, spread)
    bend = math.sqrt(0.5) * spread * math.sin(slope) / math.sin(0.75 * math.pi - slope)
    z = np.array([0.0, bend, 1.0])
    flat = np.zeros_like(z)
    profile = np.stack([1.0 - spread * (1.0 - z), z, flat + 1.0, flat, flat], axis=1)
    return revolve(profile, slices), np.repeat([0.0, 1.0, 0.0], slices + 1)
