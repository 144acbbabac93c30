"""Coloured pieces of surface, merged to one mesh, and key frames: for the animated models."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from glb import GlbFile
from numpy.typing import NDArray
from surfaces import Floats, Indices, grid_faces, unit

OPAQUE = 255
DISC_SIDES = 64


class Piece(NamedTuple):
    """A part of a mesh: where its vertices are, its triangles, and one colour or one a vertex."""

    points: Floats
    """(V,3)"""
    faces: Indices
    """(F,3), counter-clockwise from outside"""
    colors: NDArray[np.uint8]
    """(V,3), or (3,) for all, linear"""


def merged(pieces: Sequence[Piece]) -> Piece:
    """Return all pieces as one; each keeps its own vertices."""
    starts = np.cumsum([0, *(len(piece.points) for piece in pieces)])
    colors = [np.broadcast_to(piece.colors, piece.points.shape) for piece in pieces]
    return Piece(
        np.concatenate([piece.points for piece in pieces]),
        np.concatenate([piece.faces + k for piece, k in zip(pieces, starts[:-1], strict=True)]),
        np.concatenate(colors).astype(np.uint8),
    )


def smooth_normals(points: Floats, faces: Indices) -> Floats:
    """Return the normals of vertices, (V,3): of the faces around, in proportion to their areas."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    normals = np.zeros_like(points)
    across = np.cross(b - a, c - a)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    return unit(normals)


def tube(rings: Floats) -> tuple[Floats, Indices]:
    """
    Close a tube by a vertex at either end.

    Parameters
    ----------
    rings : ndarray (R,S,3)
        From one end to the other, each counter-clockwise as seen from before the first.

    Returns
    -------
    points : ndarray (R*S+2,3)
    faces : ndarray (2*R*S,3) int64
    """
    count, sides, _ = rings.shape
    grid = grid_faces(count, sides + 1)
    row, column = grid // (sides + 1), grid % (sides + 1)
    first, last = count * sides, count * sides + 1
    around = np.arange(sides)
    after = (around + 1) % sides
    low = np.column_stack([np.full(sides, first), around, after])
    high = np.column_stack([np.full(sides, last), after, around]) + np.array(
        [0, (count - 1) * sides, (count - 1) * sides]
    )
    points = np.concatenate(
        [rings.reshape(-1, 3), _center(rings[0])[None], _center(rings[-1])[None]]
    )
    return points, np.concatenate([row * sides + column % sides, low, high])


def _center(ring: Floats) -> Floats:
    return np.array([math.fsum(ring[:, axis].tolist()) for axis in range(3)]) / len(ring)


def ball(
    center: Sequence[float], radii: Sequence[float], rows: int = 10, sides: int = 16
) -> tuple[Floats, Indices]:
    """Return an ellipsoid with its axes along x, y and z, and its poles on z."""
    rings = []
    for i in range(1, rows):
        polar = math.pi * i / rows
        ring = [2.0 * math.pi * j / sides for j in range(sides)]
        rings.append(
            [
                (math.sin(polar) * math.cos(a), math.sin(polar) * math.sin(a), math.cos(polar))
                for a in ring
            ]
        )
    points, faces = tube(np.array(rings))
    points[-2:] = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
    return points * np.array(radii) + np.array(center), faces


def add_ground(glb: GlbFile, radius: float, color: Sequence[float]) -> int:
    """Add a round ground at y = 0 that faces up, of a linear colour; return its node."""
    angles = [2.0 * math.pi * j / DISC_SIDES for j in range(DISC_SIDES)]
    rim = [(radius * math.sin(a), 0.0, radius * math.cos(a)) for a in angles]
    points = np.array([(0.0, 0.0, 0.0), *rim], np.float32)
    around = np.arange(DISC_SIDES)
    faces = np.column_stack(
        [np.zeros_like(around), around + 1, (around + 1) % DISC_SIDES + 1]
    ).astype(np.uint16)
    attributes = {"POSITION": points, "NORMAL": np.tile(np.float32([0, 1, 0]), (len(points), 1))}
    mesh = glb.add_mesh("ground", attributes, faces, add_material(glb, "ground", 0.95, color))
    return glb.add("nodes", {"name": "ground", "mesh": mesh})


def add_material(
    glb: GlbFile, name: str, roughness: float, color: Sequence[float] | None = None
) -> int:
    """Add a material that is no metal, of one linear colour or of the colours of vertices."""
    factors: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": roughness}
    if color is not None:
        factors["baseColorFactor"] = [*color, 1.0]
    return glb.add("materials", {"name": name, "pbrMetallicRoughness": factors})


def attributes_of(piece: Piece, normals: Floats) -> dict[str, NDArray[Any]]:
    """Return positions, normals and colours as glTF has them."""
    colors = np.column_stack([piece.colors, np.full(len(piece.points), OPAQUE, np.uint8)])
    return {
        "POSITION": piece.points.astype(np.float32),
        "NORMAL": normals.astype(np.float32),
        "COLOR_0": colors.astype(np.uint8),
    }


def turns(axis: Sequence[float], degrees: Sequence[float]) -> Floats:
    """Return unit quaternions (x, y, z, w), (K,4), of right-handed turns about a unit axis."""
    halves = [math.radians(angle) / 2.0 for angle in degrees]
    return np.array([[*(math.sin(h) * part for part in axis), math.cos(h)] for h in halves])


def turn_slopes(axis: Sequence[float], degrees: Sequence[float], slopes: Sequence[float]) -> Floats:
    """Return how fast those quaternions change, (K,4), where the angles do by degrees a second."""
    return np.array(
        [
            [*(math.cos(a / 2.0) * part * b / 2.0 for part in axis), -math.sin(a / 2.0) * b / 2.0]
            for a, b in (
                (math.radians(angle), math.radians(slope))
                for angle, slope in zip(degrees, slopes, strict=True)
            )
        ]
    )


def after(second: Floats, first: Floats) -> Floats:
    """Return the products of quaternions, (K,4): turns one after the other."""
    ax, ay, az, aw = second.T
    bx, by, bz, bw = first.T
    return np.column_stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


def spline_keys(values: Floats, slopes: Floats) -> NDArray[np.float32]:
    """Return keys of CUBICSPLINE, (3K,n): the same slope before and after each of (K,n) values."""
    return (
        np.stack([slopes, values, slopes], axis=1).reshape(-1, values.shape[1]).astype(np.float32)
    )
