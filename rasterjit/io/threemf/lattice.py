"""Make the surfaces of beams and balls: cones with round or flat ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.angles import sine_cosine

_SIDES = ((5_000, 12), (50_000, 8))
"""Sides of the beams of lattices with up to so many of them."""

_FEWEST_SIDES = 6

_CAP = np.radians([90.0, 60.0, 30.0, 0.0])
"""Latitudes of the rings of a round end, from its pole to where the beam begins."""

_FLAT_RADII = np.array([0.0, 1.0, 1.0, 1.0])
"""Radii of the same rings of a flat end."""


def lengths(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of vectors, (N,), given (N, 3)."""
    x, y, z = vectors.T
    return np.sqrt(x * x + y * y + z * z)


def beam_sides(count: int) -> int:
    """Return how many sides each beam of a lattice has."""
    return next((sides for most, sides in _SIDES if count <= most), _FEWEST_SIDES)


def beam_faces(count: int) -> int:
    """Return how many faces the beams of a lattice have together."""
    return count * 2 * beam_sides(count) * (2 * len(_CAP) - 1)


def beam_surfaces(
    ends: NDArray[np.float64], radii: NDArray[np.float64], is_flat: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """
    Return the surfaces of beams, rings of vertices from one pole to the other.

    Parameters
    ----------
    ends : (N, 2, 3) float64
        Where each begins and ends; one of no length is a ball.
    radii : (N, 2) float64
        There.
    is_flat : (N, 2) bool
        Which ends are cut off; the others have half a ball.

    Returns
    -------
    vertices, normals : (N, R, K, 3) float64
        Of each beam, R rings, half of them of each end, of K sides.
    faces : (F, 3) int64
        Counter-clockwise from outside; flat rings of no width are kept.
    """
    count, sides = len(ends), beam_sides(len(ends))
    along = ends[:, 1] - ends[:, 0]
    length = lengths(along)
    axis = np.where(length[:, None] > 0.0, along, [0.0, 0.0, 1.0])
    axis /= lengths(axis)[:, None]
    # Any direction that is not along the axis.
    least = np.eye(3)[np.abs(axis).argmin(axis=1)]
    across = np.cross(axis, least)
    across /= lengths(across)[:, None]
    other = np.cross(axis, across)
    turn = 2.0 * np.pi * np.arange(sides) / sides
    sine, cosine = (one[None, :, None] for one in sine_cosine(turn))
    around = across[:, None] * cosine + other[:, None] * sine
    rise, width = sine_cosine(_CAP)
    vertices = np.empty((count, 2 * len(_CAP), sides, 3))
    normals = np.empty_like(vertices)
    for end, sign in ((0, -1.0), (1, 1.0)):
        flat = is_flat[:, end, None]
        wide = np.where(flat, _FLAT_RADII, width)
        high = np.where(flat, 0.0, rise)
        # A flat end has its own normals but at its last ring, where the side begins.
        up = np.where(flat, [1.0, 1.0, 1.0, 0.0], rise)
        out = np.where(flat, [0.0, 0.0, 0.0, 1.0], width)
        radius = radii[:, end, None]
        ring = around[:, None] * (wide * radius)[:, :, None, None]
        ring = ring + (axis[:, None] * (sign * high * radius)[:, :, None])[:, :, None]
        normal = around[:, None] * out[:, :, None, None]
        normal = normal + (axis[:, None] * (sign * up)[:, :, None])[:, :, None]
        rows = slice(0, len(_CAP)) if end == 0 else slice(None, len(_CAP) - 1, -1)
        vertices[:, rows] = ring + ends[:, end, None, None]
        normals[:, rows] = normal
    return vertices, normals, _ring_faces(count, sides)


def _ring_faces(count: int, sides: int) -> NDArray[np.int64]:
    """Return the faces between the rings of each beam."""
    rings = 2 * len(_CAP)
    first = np.arange(rings - 1)[:, None] * sides + np.arange(sides)
    after = np.arange(rings - 1)[:, None] * sides + (np.arange(sides) + 1) % sides
    quads = np.stack([first, after, after + sides, first + sides], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return (np.arange(count)[:, None, None] * rings * sides + faces).reshape(-1, 3)
