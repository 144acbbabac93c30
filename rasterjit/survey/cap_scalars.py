"""
Spread the scalars of a mesh over its caps.

A mesh says nothing of its inside: what is known of a cap are the scalars along its outline. They
are spread by mean value coordinates [1]_, which depend on the outline alone, not on triangles;
where the outline's values are a linear function of the place, so are those inside. The cap is cut
along the lines of a grid, so that colours follow.

References
----------
.. [1] K. Hormann and M. S. Floater, "Mean value coordinates for arbitrary planar polygons", ACM
   Transactions on Graphics 25(4), 2006.
"""

from __future__ import annotations

import numpy as np

from rasterjit.scene.arrays import Float64, Int64
from rasterjit.scene.section import SectionPlane
from rasterjit.survey.cap_outlines import OutlineFiller, flatten_points, plane_axes
from rasterjit.survey.cap_overlaps import (
    Cap,
    CapVertices,
    add_points,
    find_outline,
    has_wide_triangle,
)

GRID_CELLS = 32
"""Cells of the grid along the longer side of a cap."""

STRIP_WEIGHT = 2**20
"""Winding number of the strips of the grid; larger than that of outlines."""

MAX_DISTANCE = 2.0**-24
"""Largest distance from an edge of a point on it, relative to the size of the plane."""

POINTS_AT_ONCE = 256
"""Points that values are found of together: their number limits the memory."""


def spread_scalars(
    plane: SectionPlane, cap: Cap, left: Cap, values: Float64
) -> tuple[Cap, Float64] | None:
    """
    Refine a cap, and find the scalars of its vertices.

    Parameters
    ----------
    plane : SectionPlane
    cap : Cap
        As it was cut.
    left : Cap
        What other caps left of it; the same if none covers it.
    values : (V,) float64
        Scalars of the vertices of ``cap``.

    Returns
    -------
    (Cap, (N,) float64) or None
        None if the outlines cannot be laid over the grid, or the cap has no wide triangle.
    """
    flat, left_flat = (flatten_points(one.world, plane.normal) for one in (cap, left))
    if not has_wide_triangle(flat, cap.faces):
        return None
    corners, edges = _make_strips(flat.min(axis=0), flat.max(axis=0), len(left_flat))
    tails, heads, sums = (
        np.concatenate(parts)
        for parts in zip(find_outline(left.faces, left_flat), edges, strict=True)
    )
    # Corners of the grid in the plane.
    across, up = (np.array(axis) for axis in plane_axes(plane.normal))
    squared = (across[0] * across[0] + across[1] * across[1]) + across[2] * across[2]
    moved = (corners - left_flat[0]) / squared
    in_plane = (moved[:, :1] * across + moved[:, 1:] * up) + left.world[0]
    vertices = CapVertices(plane, np.concatenate([left.world, in_plane]))
    filler = OutlineFiller(vertices, 0)
    found = filler.fill(tails, heads, sums)
    if found is None:
        return None
    # Inside of the outline are odd numbers; slivers close gaps beside its edges that were split.
    faces = found[found[:, 3] % STRIP_WEIGHT != 0, :3]
    used, renumbered = np.unique(faces, return_inverse=True)
    old = used[used < len(left_flat)]
    points = flatten_points(vertices.world[used], plane.normal)
    recipe, numbers = add_points(left.recipe, cap, points[len(old) :], flat)
    refined = left._replace(
        world=vertices.world[used], faces=renumbered.reshape(-1, 3).astype(np.int64),
        recipe=recipe._replace(used=np.concatenate([left.recipe.used[old], numbers])),
    )  # fmt: skip
    return refined, _interpolate(points, flat, find_outline(cap.faces, flat), values)


def _make_strips(
    low: Float64, high: Float64, first: int
) -> tuple[Float64, tuple[Int64, Int64, Int64]]:
    """
    Return every other strip of a grid over a box, upright ones and level ones.

    Returns
    -------
    corners : (4 S, 2) float64
    tails, heads, weights : (4 S,) int64
        Their edges, the first corner being number ``first``.
    """
    cell = float((high - low).max()) / GRID_CELLS
    boxes, weights = [], []
    for axis in range(2):
        # From beyond the box, so that no line of the grid is a side of it.
        starts = np.arange(low[axis] - 0.37 * cell, high[axis], 2.0 * cell)
        rows = np.empty((len(starts), 2, 2))
        rows[:, :, axis] = np.stack([starts, starts + cell], axis=1)
        rows[:, :, 1 - axis] = low[1 - axis] - cell, high[1 - axis] + cell
        boxes.append(rows)
        weights.append(np.full(len(rows), STRIP_WEIGHT * (axis + 1)))
    (x, y), weight = np.concatenate(boxes).transpose(2, 1, 0), np.concatenate(weights)
    corners = np.stack([x[[0, 1, 1, 0]].T.ravel(), y[[0, 0, 1, 1]].T.ravel()], axis=1)
    tails = np.arange(len(corners)).reshape(-1, 4)
    heads = np.roll(tails, -1, axis=1)
    return corners, (tails.ravel() + first, heads.ravel() + first, np.repeat(weight, 4))


def _interpolate(
    points: Float64, flat: Float64, outline: tuple[Int64, Int64, Int64], values: Float64
) -> Float64:
    """
    Return the values of points, (N,), given those of an outline's vertices.

    Parameters
    ----------
    points : (N, 2) float64
    flat : (V, 2) float64
    outline : tuple of (E,) int64
        As `find_outline` returns it.
    values : (V,) float64
        Where they are not finite, edges do not count.
    """
    tails, heads, sums = outline
    known = np.isfinite(values[tails]) & np.isfinite(values[heads])
    tails, heads, sums = tails[known], heads[known], sums[known]
    result = np.full(len(points), np.nan)
    if not len(tails):
        return result
    ends = values[tails], values[heads]
    for start in range(0, len(points), POINTS_AT_ONCE):
        rows = slice(start, start + POINTS_AT_ONCE)
        result[rows] = _mean_values(points[rows], flat[tails], flat[heads], sums, *ends)
    return result.clip(np.minimum(*ends).min(), np.maximum(*ends).max())


def _mean_values(
    points: Float64, starts: Float64, stops: Float64, counts: Int64, first: Float64, last: Float64
) -> Float64:
    """Return the mean values of points, (N,), between edges and their values, (E,) each."""
    a, b = starts - points[:, np.newaxis], stops - points[:, np.newaxis]
    along, to_point = stops - starts, -a
    # Points on an edge have values along it.
    share = (_dot(to_point, along) / _dot(along, along)).clip(0.0, 1.0)
    beside = to_point - share[..., np.newaxis] * along
    away = np.sqrt(_dot(beside, beside))
    nearest = away.argmin(axis=1)
    rows = np.arange(len(points))
    on_edge = first[nearest] + share[rows, nearest] * (last - first)[nearest]
    # Others by the tangents of half the angles at which edges are seen.
    lengths = [np.sqrt(_dot(end, end)) for end in (a, b)]
    double_area = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        dot = _dot(a, b)
        # Two forms of the tangent: one that does not cancel for each side of a right angle.
        product = lengths[0] * lengths[1]
        narrow, wide = double_area / (product + dot), (product - dot) / double_area
        half = counts * np.where(dot > 0.0, narrow, wide)
        weights = [half / length for length in lengths]
        total = _sum_rows(weights[0] + weights[1])
        inside = _sum_rows(weights[0] * first + weights[1] * last) / total
    return np.where(away[rows, nearest] <= MAX_DISTANCE, on_edge, inside)


def _dot(a: Float64, b: Float64) -> Float64:
    """Return the scalar products of vectors, (..., 2)."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]


def _sum_rows(values: Float64) -> Float64:
    """Return the sums of rows, (N,), added from left to right."""
    return np.cumsum(values, axis=1)[:, -1]
