"""
Tangents: which way the picture of a normal map lies on a surface, vertex by vertex.

A face has one where its texture coordinates have an area: the direction in which u grows. A vertex
gets the mean of those of the faces around it, by their area. Where a picture is laid mirrored on
one side of a seam, u grows the other way there, so a vertex has two means: of the faces that show
the picture as it is, and of those that show it mirrored.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.normals import area_vectors, dot_rows, unit_rows

_CHUNK = 1 << 18
"""Faces handled at once: large enough for NumPy, small beside the mesh."""

GROUPS = 2
"""Of faces: those that show the picture as it is, and those that show it mirrored."""


def vertex_tangents(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    uv: NDArray[np.float32],
    scale: float,
    transform: tuple[float, ...] | None = None,
) -> NDArray[np.float32]:
    """
    Return the tangents of every vertex, one for each group of faces.

    Parameters
    ----------
    vertices : (V, 3) float64, model space
    faces : (F, 3) int32
    uv : (V, 2) float32
        v runs up.
    scale : float
        Factor on the vertices, from `normals.safe_scale`.
    transform : six floats, optional
        What `Texture.transform` makes of the coordinates; the tangents are those of the result.

    Returns
    -------
    (V, 2, 4) float32
        Unit tangents in model space, zero where no face of the group has one; then 1 where v grows
        to the left of the tangent seen from the front of the face, -1 where to the right. The
        group is that of ``uv``, before the transform.
    """
    sums = np.zeros((GROUPS, 3, len(vertices)), np.float64)
    for start in range(0, len(faces), _CHUNK):
        chunk = faces[start : start + _CHUNK]
        tangents, is_mirrored = _face_tangents(vertices, chunk, uv, scale, transform)
        for group in range(GROUPS):
            chosen = is_mirrored == bool(group)
            corners = chunk[chosen].ravel()
            for axis in range(3):
                np.add.at(sums[group, axis], corners, np.repeat(tangents[chosen, axis], 3))
    result = np.empty((len(vertices), GROUPS, 4), np.float32)
    turned = 1.0 if transform is None else _determinant(transform)
    for group in range(GROUPS):
        result[:, group, :3] = unit_rows(np.ascontiguousarray(sums[group].T))
        result[:, group, 3] = (-1.0 if turned < 0.0 else 1.0) * (1.0 - 2.0 * group)
    return result


def _determinant(transform: tuple[float, ...]) -> float:
    """Return by how much a transform of coordinates enlarges areas; below 0 if it mirrors."""
    return transform[0] * transform[4] - transform[1] * transform[3]


def _face_tangents(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    uv: NDArray[np.float32],
    scale: float,
    transform: tuple[float, ...] | None,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return each face's tangent (F, 3), as long as twice its area, and whether it is mirrored."""
    a, b, c = (vertices[corner] * scale for corner in faces.T)
    with np.errstate(invalid="ignore", over="ignore"):
        edge_ab, edge_ac = b - a, c - a
        areas = area_vectors(vertices, faces, scale)
        u, v = uv[:, 0].astype(np.float64), uv[:, 1].astype(np.float64)
        ab, ac = _steps(faces, u, v, 1), _steps(faces, u, v, 2)
        is_mirrored = ab[0] * ac[1] < ac[0] * ab[1]
        if transform is not None:
            ab, ac = _moved(ab, transform), _moved(ac, transform)
        doubled = ab[0] * ac[1] - ac[0] * ab[1]
        tangents = edge_ab * ac[1][:, np.newaxis] - edge_ac * ab[1][:, np.newaxis]
    sizes = np.sqrt(dot_rows(areas, areas)) * np.sign(doubled)
    tangents[~np.isfinite(tangents).all(axis=1) | ~np.isfinite(sizes)] = 0.0
    return unit_rows(tangents) * np.nan_to_num(sizes)[:, np.newaxis], is_mirrored


def _steps(
    faces: NDArray[np.int32], u: NDArray[np.float64], v: NDArray[np.float64], corner: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far u and v move from the first corner of each face to another."""
    first, other = faces[:, 0], faces[:, corner]
    return u[other] - u[first], v[other] - v[first]


def _moved(
    step: tuple[NDArray[np.float64], NDArray[np.float64]], transform: tuple[float, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return steps as a transform of the coordinates makes them."""
    u, v = step
    return transform[0] * u + transform[1] * v, transform[3] * u + transform[4] * v
