"""Grids of vertices, the cube's tables, unit vectors, OBJ files: what several models share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

CUBE_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]) * 2 - 1
"""(8,3) int: corner i has x = ±1 by bit 0 of i, y by bit 1, z by bit 2."""

CUBE_SIDES = np.array(
    [[0, 4, 6, 2], [5, 1, 3, 7], [0, 1, 5, 4], [6, 7, 3, 2], [1, 0, 2, 3], [4, 5, 7, 6]]
)
"""(6,4) int: −x, +x, −y, +y, −z, +z; each from its low left corner, counter-clockwise."""

QUAD = np.array([[0, 1, 2], [0, 2, 3]])

POSITION_DIGITS, NORMAL_DIGITS, UV_DIGITS = 5, 4, 5


def grid_faces(rows: int, columns: int) -> Indices:
    """
    Return the triangles of a grid of vertices numbered row by row.

    Rows run downwards and columns to the right as seen from outside, which makes the triangles
    counter-clockwise from there.

    Returns
    -------
    ndarray (2*(rows-1)*(columns-1), 3) int64
    """
    corner = np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)
    top_left, top_right = corner.ravel(), corner.ravel() + 1
    low_left, low_right = top_left + columns, top_right + columns
    lower = np.stack([top_left, low_left, low_right], axis=1)
    upper = np.stack([top_left, low_right, top_right], axis=1)
    return np.stack([lower, upper], axis=1).reshape(-1, 3)


def unit(vectors: Floats) -> Floats:
    """Scale ``vectors (...,3)`` to length 1."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return vectors / np.sqrt(x * x + y * y + z * z)[..., None]


def decimals(values: Floats, digits: int) -> list[list[str]]:
    """Format each row of ``values (V,n)``, without negative zeros and trailing zeros."""
    rounded = np.round(values, digits) + 0.0
    return [[f"{x:.{digits}f}".rstrip("0").rstrip(".") for x in row] for row in rounded.tolist()]


def write_obj(
    path: Path, title: str, positions: Floats, normals: Floats, uvs: Floats, faces: Indices
) -> None:
    """
    Write a Wavefront OBJ in which vertices that differ only in uv share position and normal.

    Parameters
    ----------
    path : Path
    title : str
        First line, as a comment.
    positions, normals : ndarray (V,3) float64
    uvs : ndarray (V,2) float64
        v up, as OBJ has it.
    faces : ndarray (F,3) int64
        Triangles in which two corners coincide are dropped.
    """
    joined = zip(
        decimals(positions, POSITION_DIGITS), decimals(normals, NORMAL_DIGITS), strict=True
    )
    points, point_of_vertex = _number_distinct([tuple(p + n) for p, n in joined])
    texels, texel_of_vertex = _number_distinct([tuple(uv) for uv in decimals(uvs, UV_DIGITS)])
    lines = [f"# {title}", "# made by models/make_models.py"]
    lines += ["v " + " ".join(point[:3]) for point in points]
    lines += ["vt " + " ".join(texel) for texel in texels]
    lines += ["vn " + " ".join(point[3:]) for point in points]
    for face in faces.tolist():
        corners = [point_of_vertex[vertex] for vertex in face]
        if len({points[corner][:3] for corner in corners}) == 3:
            names = [
                f"{corner + 1}/{texel_of_vertex[vertex] + 1}/{corner + 1}"
                for corner, vertex in zip(corners, face, strict=True)
            ]
            lines.append("f " + " ".join(names))
    path.write_bytes(("\n".join(lines) + "\n").encode("ascii"))


def _number_distinct(
    items: Sequence[tuple[str, ...]],
) -> tuple[list[tuple[str, ...]], list[int]]:
    """Return the distinct items in order of first appearance, and each item's number there."""
    numbers: dict[tuple[str, ...], int] = {}
    number_of_item = [numbers.setdefault(item, len(numbers)) for item in items]
    return list(numbers), number_of_item
