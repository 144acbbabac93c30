"""
Decide which parts of projected edges faces hide.

Candidates come from a grid of cells over the picture. A kernel decides nearly all of them in whole
numbers and bounded float64; the rest are decided by `exact_span`.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from rasterjit.hidden_lines import stage
from rasterjit.hidden_lines.cells import find_pairs, sort_into_cells
from rasterjit.pipeline.geometry.setup import CLIPPED, INVALID
from rasterjit.pipeline.records import Faces, Objects, ScreenVertices
from rasterjit.rendering.planning import PlannedFrame
from rasterjit.runtime.threads import Workers
from rasterjit.scene.arrays import Bool, Float64, Int32, Int64
from rasterjit.scene.normals import dot_rows
from rasterjit.survey.object_counts import is_see_through

DEPTH_ROUNDING = 2.0**-40
"""Slack for the rounding of stored depths, as a share of the depth."""


class Triangles(NamedTuple):
    """The triangles that hide edges, on the sub-pixel grid, with positive edge functions."""

    corners: Int32
    """(T, 6): x and y of three corners."""
    depths: Float64
    """(T, 3): stored depth, greater is nearer."""
    slack: Float64
    """(T,): by how much a triangle must somewhere be nearer than the part that it hides."""


class Pieces(NamedTuple):
    """Visible and hidden parts of edges."""

    edges: Int32
    """(N,): the edge of each piece, ascending."""
    parts: Float64
    """(N, 2): where it begins and ends, 0..1 along the edge."""
    is_hidden: Bool
    """(N,)."""


def find_hiding_triangles(
    planned: PlannedFrame, faces: Faces, objects: Objects, screen: ScreenVertices
) -> Triangles:
    """
    Collect the triangles that hide edges: clipped, and without those that are culled.

    Blended and transmitting objects hide nothing, nor do points and lines.
    """
    cache = planned.cache
    arrays = cache.shapes.arrays
    hides = np.array(
        [not (is_see_through(mesh) or mesh.material.transmits) for mesh in cache.shapes.meshes]
    )
    hides[list(arrays.primitive_numbers)] = False
    owners = cache.shapes.object_numbers[:-1]
    is_whole = ~np.any(screen.codes[faces.faces] & (CLIPPED | INVALID), axis=1)
    vertices = np.concatenate([faces.faces[is_whole], faces.pieces])
    owners = np.concatenate([owners[is_whole], owners[faces.piece_faces]])
    culled = objects.culled_windings[owners]
    vertices, culled = vertices[hides[owners]], culled[hides[owners]]
    return make_triangles(screen.xy[vertices], screen.depth[vertices], culled)


def make_triangles(xy: Int32, depths: Float64, culled: Int64) -> Triangles:
    """
    Collect triangles, leaving out those without area and those of a culled winding.

    Parameters
    ----------
    xy : (T, 3, 2) int, units of the sub-pixel grid
    depths : (T, 3) float64
        Stored depth, greater is nearer.
    culled : (T,) int
        Sign of the edge function of culled triangles; 0 for none.
    """
    points = xy.astype(np.int64)
    (ax, ay), (bx, by), (cx, cy) = (points[:, k].T for k in range(3))
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    is_drawn = (area != 0) & (np.sign(area) * culled <= 0)
    points, depths, area = points[is_drawn], depths[is_drawn], area[is_drawn]
    is_flipped = area < 0
    points[is_flipped], depths[is_flipped] = (
        points[is_flipped][:, ::-1],
        depths[is_flipped][:, ::-1],
    )
    (ax, ay), (bx, by), (cx, cy) = (points[:, k].T for k in range(3))
    rise_b, rise_c = depths[:, 1] - depths[:, 0], depths[:, 2] - depths[:, 0]
    slope_x = (rise_b * (cy - ay) - rise_c * (by - ay)) / np.abs(area)
    slope_y = (rise_c * (bx - ax) - rise_b * (cx - ax)) / np.abs(area)
    # Both the triangle and what it may hide were rounded by half a unit, in x and in y.
    slack = np.minimum(np.abs(slope_x) + np.abs(slope_y), np.ptp(depths, axis=1))
    slack += DEPTH_ROUNDING * np.abs(depths).max(axis=1, initial=0.0)
    return Triangles(
        np.ascontiguousarray(points.reshape(-1, 6).astype(np.int32)),
        np.ascontiguousarray(depths), slack,
    )  # fmt: skip


def hides_point(
    triangles: Triangles, pixel: tuple[float, float], depth: float, subpixel_bits: int
) -> bool:
    """Tell whether a triangle hides a point of a stored depth, by more than it rises in a pixel."""
    x, y = (round(coordinate * (1 << subpixel_bits)) for coordinate in pixel)
    points = triangles.corners.astype(np.int64).reshape(-1, 3, 2) - (x, y)
    after, then = np.roll(points, -1, axis=1), np.roll(points, -2, axis=1)
    weights = after[:, :, 0] * then[:, :, 1] - after[:, :, 1] * then[:, :, 0]
    covers = (weights >= 0).all(axis=1)
    weights, depths = weights[covers], triangles.depths[covers]
    area = (weights[:, 0] + weights[:, 1]) + weights[:, 2]
    lead = dot_rows(weights / area[:, np.newaxis], depths)
    slack = np.minimum(triangles.slack[covers] * (1 << subpixel_bits), np.ptp(depths, axis=1))
    return bool(np.any(lead - depth > slack + DEPTH_ROUNDING * abs(depth)))


def exact_span(
    ends: Sequence[int], edge_depths: Sequence[float], corners: Sequence[int],
    depths: Sequence[float], slack: float,
) -> tuple[Fraction, Fraction] | None:  # fmt: skip
    """
    Return the span of an edge that a triangle hides, in fractions; ``None`` if it hides nothing.

    Parameters
    ----------
    ends : (4,) int
        x0, y0, x1, y1.
    edge_depths : (2,) float
    corners : (6,) int
        With a positive edge function.
    depths : (3,) float
    slack : float
    """
    points = [corners[0:2], corners[2:4], corners[4:6]]
    weights = [
        [_edge_value(points[k - 2], points[k - 1], end) for k in range(3)]
        for end in (ends[:2], ends[2:])
    ]
    exact = [Fraction(depth) for depth in depths]
    area = sum(weights[0])
    lead, last_lead = (
        sum(weight * depth for weight, depth in zip(row, exact, strict=True)) / area
        - Fraction(depth)
        for row, depth in zip(weights, edge_depths, strict=True)
    )
    low, high = Fraction(0), Fraction(1)
    for start, stop in [*zip(*weights, strict=True), (lead, last_lead)]:
        if start < 0 and stop < 0:
            return None
        if start < 0:
            low = max(low, Fraction(start, start - stop))
        elif stop < 0:
            high = min(high, Fraction(start, start - stop))
    most = max(lead + along * (last_lead - lead) for along in (low, high))
    return (low, high) if low < high and most > Fraction(slack) else None


def _edge_value(a: Sequence[int], b: Sequence[int], p: Sequence[int]) -> int:
    """Return the edge function of a -> b at p."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def split_by_visibility(
    ends: Int32, edge_depths: Float64, triangles: Triangles, extent: tuple[int, int],
    workers: Workers,
) -> Pieces:  # fmt: skip
    """
    Split edges into visible and hidden pieces.

    Parameters
    ----------
    ends : (E, 4) int32, units of the sub-pixel grid
        x0, y0, x1, y1.
    edge_depths : (E, 2) float64, stored depth
    triangles : Triangles
    extent : (int, int)
        Width and height of the picture, units of the grid; nothing is hidden outside it.
    workers : Workers
    """
    corners = triangles.corners.reshape(-1, 3, 2)
    cells = sort_into_cells(corners.min(axis=1), corners.max(axis=1), extent)
    grid = *cells.counts, cells.shift
    nearest = triangles.depths.max(axis=1, initial=-np.inf)
    surfaces = triangles.corners, triangles.depths, nearest, triangles.slack

    pairs, spans = find_pairs(
        stage.find_spans, len(ends), (ends, edge_depths, surfaces, cells[:2], grid),
        (len(triangles.corners), 2), workers,
    )  # fmt: skip
    _decide_in_fractions(pairs, spans, ends, edge_depths, triangles)
    # Split the edges where spans begin and end.
    order = np.lexsort((spans[:, 1], spans[:, 0], pairs[:, 0]))
    owners, spans = np.ascontiguousarray(pairs[order, 0]), np.ascontiguousarray(spans[order])
    room = 2 * len(owners) + len(ends)
    pieces, parts = np.empty(room, np.int32), np.empty((room, 2))
    is_hidden = np.empty(room, np.uint8)
    count = stage.split_edges(len(ends), owners, spans, pieces, parts, is_hidden)
    return Pieces(pieces[:count], parts[:count], is_hidden[:count].astype(bool))


def _decide_in_fractions(
    pairs: Int32, spans: Float64, ends: Int32, edge_depths: Float64, triangles: Triangles
) -> None:
    """Write the spans that the kernel left open; an empty one where nothing is hidden."""
    for n in np.flatnonzero(np.isnan(spans[:, 0])).tolist():
        edge, triangle = pairs[n].tolist()
        span = exact_span(
            ends[edge].tolist(), edge_depths[edge].tolist(), triangles.corners[triangle].tolist(),
            triangles.depths[triangle].tolist(), float(triangles.slack[triangle]),
        )  # fmt: skip
        spans[n] = (0.0, 0.0) if span is None else span
