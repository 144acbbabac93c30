"""Tessellate the Utah teapot from its bicubic Bézier patches, with analytic normals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from surfaces import Floats, grid_faces, unit, write_obj
from teapot_patches import CONTROL_POINTS, PATCHES

TEAPOT_SEGMENTS = 11
"""Steps along each side of a patch: 7656 triangles."""

TEAPOT_PARTS: dict[str, tuple[list[list[int]], tuple[float, float, float, float]]] = {
    # patches in rows from top to bottom and columns from left to right; uv of the part's rectangle
    # as left, low, right, high. The bottom's patches are numbered the other way round: see below.
    "body": ([[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11], [31, 30, 29, 28]], (0, 0, 1, 0.5)),
    "lid": ([[20, 21, 22, 23], [24, 25, 26, 27]], (0, 0.5, 1, 0.75)),
    "handle": ([[12, 13], [14, 15]], (0, 0.75, 0.5, 1)),
    "spout": ([[16, 17], [18, 19]], (0.5, 0.75, 1, 1)),
}
BOTTOM_PATCHES = range(28, 32)
"""Half a turn in their (row, column) square against the body's: turned back before use."""

COLLAPSED_EDGE = 1e-9
"""Length of a cross product of partial derivatives (units²) below which the patch has a pole."""


def bernstein(parameters: Floats) -> tuple[Floats, Floats]:
    """
    Evaluate the cubic Bernstein polynomials and their derivatives.

    Parameters
    ----------
    parameters : ndarray (N,) float64, 0..1

    Returns
    -------
    weights, slopes : ndarray (4,N) float64

    References
    ----------
    G. Farin, "Curves and Surfaces for CAGD", 5th edition, 2002, chapters 5 and 14.
    """
    t, s = parameters, 1.0 - parameters
    weights = np.stack([s * s * s, 3.0 * (t * s * s), 3.0 * (t * t * s), t * t * t])
    slopes = np.stack(
        [-3.0 * (s * s), 3.0 * (s * s - 2.0 * (s * t)), 3.0 * (2.0 * (s * t) - t * t), 3.0 * t * t]
    )
    return weights, slopes


def evaluate_patch(control: Floats, segments: int) -> tuple[Floats, Floats]:
    """
    Sample a bicubic Bézier patch and its unit normals on a regular grid.

    The normal is the cross product of the partial derivatives by column and by row: the table's
    rows run downwards and its columns to the left, seen from outside. Where a whole edge collapses
    into a point the derivative by column is zero; near that edge it is the mixed derivative times
    the distance in the row parameter, so the limit of the normal is the cross product of the mixed
    derivative and the derivative by row, turned by the sign of that distance.

    Parameters
    ----------
    control : ndarray (4,4,3) float64
        Rows, columns.
    segments : int

    Returns
    -------
    positions, normals : ndarray (segments+1, segments+1, 3) float64
    """
    parameters = np.arange(segments + 1) / segments
    weights, slopes = bernstein(parameters)

    def combine(by_row: Floats, by_column: Floats) -> Floats:
        total = np.zeros((segments + 1, segments + 1, 3))
        for i in range(4):
            for j in range(4):
                total = total + (by_row[i][:, None] * by_column[j])[..., None] * control[i, j]
        return total

    along_rows = combine(slopes, weights)
    normals = np.cross(combine(weights, slopes), along_rows)
    into_patch = np.where(parameters < 0.5, 1.0, -1.0)[:, None, None]
    limits = into_patch * np.cross(combine(slopes, slopes), along_rows)
    collapsed = np.abs(normals).max(axis=-1, keepdims=True) < COLLAPSED_EDGE
    return combine(weights, weights), unit(np.where(collapsed, limits, normals))


def teapot_part(layout: list[list[int]], segments: int) -> tuple[Floats, Floats]:
    """
    Join patches that share borders into one grid, closed around its columns.

    Returns
    -------
    positions, normals : ndarray (rows*segments+1, columns*segments+1, 3) float64
        z up. The last column repeats the first bit for bit.
    """
    control_points = np.array(CONTROL_POINTS)
    shape = (len(layout) * segments + 1, len(layout[0]) * segments + 1, 3)
    positions, normals = np.empty(shape), np.empty(shape)
    for i, row in enumerate(layout):
        for j, number in enumerate(row):
            control = control_points[list(PATCHES[number])].reshape(4, 4, 3)
            if number in BOTTOM_PATCHES:
                control = control[::-1, ::-1]
            block = np.s_[
                i * segments : (i + 1) * segments + 1, j * segments : (j + 1) * segments + 1
            ]
            positions[block], normals[block] = evaluate_patch(control, segments)
    positions[:, -1], normals[:, -1] = positions[:, 0], normals[:, 0]
    return positions, normals


def make_teapot(folder: Path) -> None:
    """Write the Utah teapot, y up, standing on y = 0, the spout along +x, 3.15 units high."""
    positions, normals, uvs, faces, count = [], [], [], [], 0
    for layout, (left, low, right, high) in TEAPOT_PARTS.values():
        part_positions, part_normals = teapot_part(layout, TEAPOT_SEGMENTS)
        rows, columns, _ = part_positions.shape
        # Rows run down the pot but columns to the left, seen from outside: number from the right.
        positions.append(part_positions[:, ::-1].reshape(-1, 3))
        normals.append(part_normals[:, ::-1].reshape(-1, 3))
        u, v = np.meshgrid(np.arange(columns) / (columns - 1), 1 - np.arange(rows) / (rows - 1))
        uvs.append(
            np.stack([left + (right - left) * u, low + (high - low) * v], axis=-1).reshape(-1, 2)
        )
        faces.append(count + grid_faces(rows, columns))
        count += rows * columns
    write_obj(
        folder / "teapot.obj",
        "Utah teapot (Martin Newell, 1975), tessellated from its Bezier patches",
        _y_up(np.concatenate(positions)),
        _y_up(np.concatenate(normals)),
        np.concatenate(uvs),
        np.concatenate(faces),
    )


def _y_up(vectors: Floats) -> Floats:
    """Turn ``vectors (V,3)`` from z up to y up, about the x axis."""
    return vectors[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0])
