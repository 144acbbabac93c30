"""
Find the spans of projected edges that faces hide.

Edges and triangles lie on the sub-pixel grid of the screen, with a stored depth at each end or
corner (greater is nearer), which is linear on the screen. A triangle hides the part of an edge that
it covers, its own edges included, and is nearer than, if somewhere there it is nearer by more than
its slack. Whether it covers is decided in whole numbers: edge functions at both ends, of at most 55
bits. How much nearer it is, is computed in float64 with a bound on its rounding; what that leaves
open is left to ``occlusion.exact_span``, in fractions.

References
----------
.. [1] A. Appel, "The Notion of Quantitative Invisibility and the Machine Rendering of Solids", ACM
   National Conference 1967: edges are cut where faces begin and end to hide them.
"""

from __future__ import annotations

import numpy as np

from rasterjit.effects.wireframe.coverage import project_edge
from rasterjit.pipeline.geometry.setup import FRUSTUM, INVALID, edge
from rasterjit.pipeline.records import Geometry
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float64, int32, int64, uint8

ROUNDING = 2.0**-48
"""Bound on the rounding of a depth, relative to the terms that it is the sum of."""

SURE = 2.0**30
"""Least ratio of the change of a lead to its rounding for a crossing to be computed from it."""

TINY = 2.0**-40
"""Largest part of an edge that counts as nothing: rounding of the ends of spans."""

NONE, PART, UNSURE = 0, 1, 2
"""What is known of a triangle and an edge: it hides nothing; a part; not yet."""


@kernel
def project_segments(
    edges: int32[:, ::1], geometry: Geometry, depth_coefficients: (float64, float64, float64),
    ends: int32[:, ::1], depths: float64[:, ::1],
):  # fmt: skip
    """
    Clip edges as faces are, and find their ends on the sub-pixel grid.

    Parameters
    ----------
    edges : (E, 2) int32, vertex numbers
    geometry : Geometry
        With clip positions.
    depth_coefficients : (float, float, float)
        The stored depth is ``(c0 + c1 z + c2 w) / w``; greater is nearer.
    ends : (E, 4) int32, units of the sub-pixel grid
        Writes x0, y0, x1, y1; both ends are one where nothing can be seen.
    depths : (E, 2) float64
        Writes the stored depth at both ends.
    """
    codes = geometry.codes
    for n in range(edges.shape[0]):
        start, stop = edges[n, 0], edges[n, 1]
        for k in range(4):
            ends[n, k] = 0
        either, both = codes[start] | codes[stop], codes[start] & codes[stop]
        if either & INVALID or both & FRUSTUM:
            continue
        project_edge(start, stop, n, ends, depths, depth_coefficients, geometry)


@helper
def find_weights(corners, triangle, x, y):
    """Return the edge functions of a triangle at a point, none negative inside; exactly."""
    ax, ay = np.int64(corners[triangle, 0]), np.int64(corners[triangle, 1])
    bx, by = np.int64(corners[triangle, 2]), np.int64(corners[triangle, 3])
    cx, cy = np.int64(corners[triangle, 4]), np.int64(corners[triangle, 5])
    return edge(bx, by, cx, cy, x, y), edge(cx, cy, ax, ay, x, y), edge(ax, ay, bx, by, x, y)


@helper
def narrow_span(low, high, start, stop):
    """Return the part of a span where a value, linear from start to stop, is not below zero."""
    if start < 0 and stop < 0:
        return 1.0, 0.0
    if start < 0:
        return max(low, start / (start - stop)), high
    if stop < 0:
        return low, min(high, start / (start - stop))
    return low, high


@helper
def find_lead(along, start, stop, area, depths, edge_depths):
    """Return how much nearer than an edge a triangle is, at a part of the edge."""
    b = (start[1] + along * (np.float64(stop[1]) - np.float64(start[1]))) / area
    c = (start[2] + along * (np.float64(stop[2]) - np.float64(start[2]))) / area
    depth = depths[0] + (b * (depths[1] - depths[0]) + c * (depths[2] - depths[0]))
    return depth - (edge_depths[0] + along * (edge_depths[1] - edge_depths[0]))


@helper
def is_corner(x, y, depth, corners, corner_depths, triangle):
    """Return whether a point is a corner of a triangle, where neither is nearer."""
    for k in range(3):
        if (
            corners[triangle, 2 * k] == x
            and corners[triangle, 2 * k + 1] == y
            and corner_depths[triangle, k] == depth
        ):
            return True
    return False


@helper
def bound_rounding(start, stop, area, depths, edge_depths):
    """Return a bound on the rounding of `find_lead`."""
    far = max(abs(np.float64(start[1])), abs(np.float64(stop[1])))
    far += max(abs(np.float64(start[2])), abs(np.float64(stop[2])))
    span = max(depths[0], max(depths[1], depths[2])) - min(depths[0], min(depths[1], depths[2]))
    largest = max(abs(depths[0]), max(abs(depths[1]), abs(depths[2])))
    largest = max(largest, max(abs(edge_depths[0]), abs(edge_depths[1])))
    return ROUNDING * (far / area * span + largest)


@helper
def find_span(ends, edge_depths, n, corners, corner_depths, slack, triangle):
    """Return what a triangle hides of an edge: ``NONE``, ``PART`` or ``UNSURE``, and the span."""
    start = find_weights(corners, triangle, np.int64(ends[n, 0]), np.int64(ends[n, 1]))
    stop = find_weights(corners, triangle, np.int64(ends[n, 2]), np.int64(ends[n, 3]))
    low, high = 0.0, 1.0
    for k in range(3):
        low, high = narrow_span(low, high, start[k], stop[k])
    if high - low <= TINY:
        return NONE, 0.0, 0.0
    area = np.float64(start[0] + start[1] + start[2])
    depths = corner_depths[triangle, 0], corner_depths[triangle, 1], corner_depths[triangle, 2]
    of_edge = edge_depths[n, 0], edge_depths[n, 1]
    here = find_lead(low, start, stop, area, depths, of_edge)
    there = find_lead(high, start, stop, area, depths, of_edge)
    rounding = bound_rounding(start, stop, area, depths, of_edge)
    if low == 0.0 and is_corner(
        ends[n, 0], ends[n, 1], of_edge[0], corners, corner_depths, triangle
    ):
        here = 0.0
    if high == 1.0 and is_corner(
        ends[n, 2], ends[n, 3], of_edge[1], corners, corner_depths, triangle
    ):
        there = 0.0
    least, most = min(here, there), max(here, there)
    if most < slack[triangle] - rounding or most == 0.0:
        return NONE, 0.0, 0.0
    if most > slack[triangle] + rounding and (least > rounding or least == 0.0):
        return PART, low, high
    if not (most > slack[triangle] + rounding and least < -rounding):
        return UNSURE, 0.0, 0.0
    if most - least < SURE * rounding:
        return UNSURE, 0.0, 0.0
    crossing = low + (high - low) * (here / (here - there))
    if here > 0.0:
        return PART, low, crossing
    return PART, crossing, high


@helper
def find_columns(ends, n, row, shift, columns):
    """Return the first and the last column of cells that an edge may meet in a row of cells."""
    ax, ay = np.float64(ends[n, 0]), np.float64(ends[n, 1])
    bx, by = np.float64(ends[n, 2]), np.float64(ends[n, 3])
    low, high = 0.0, 1.0
    if ay != by:
        top = (np.float64(row << shift) - ay) / (by - ay)
        bottom = (np.float64((row + 1) << shift) - ay) / (by - ay)
        low, high = max(low, min(top, bottom)), min(high, max(top, bottom))
    left, right = ax + low * (bx - ax), ax + high * (bx - ax)
    # A unit of the grid is far more than rounding.
    first = np.int64(np.floor(min(left, right) - 1.0)) >> shift
    last = np.int64(np.floor(max(left, right) + 1.0)) >> shift
    return max(first, np.int64(0)), min(last, np.int64(columns - 1))


@kernel
def find_spans(
    edges: (int64, int64), ends: int32[:, ::1], edge_depths: float64[:, ::1],
    triangles: (int32[:, ::1], float64[:, ::1], float64[::1], float64[::1]),
    cells: (int64[::1], int32[::1]), grid: (int64, int64, int64), stamps: int32[::1],
    pairs: int32[:, ::1], spans: float64[:, ::1], count: int64[::1],
):  # fmt: skip
    """
    Find the spans of edges that triangles hide.

    Parameters
    ----------
    edges : (int, int)
        The first, and one past the last.
    ends : (E, 4) int32, units of the sub-pixel grid
    edge_depths : (E, 2) float64, stored depth
    triangles : (corners (T, 6) int32, depths (T, 3), nearest (T,), slack (T,))
        On the same grid, with positive edge functions; nearest is the greatest depth of each.
    cells : (starts (C+1,) int64, lists (L,) int32)
        The triangles that may meet each cell of the picture.
    grid : (columns, rows, shift)
        Cells are ``2**shift`` units wide.
    stamps : (T,) int32
        Scratch memory, filled with -1.
    pairs : (M, 2) int32
        Writes edge and triangle of each span.
    spans : (M, 2) float64
        Writes where each begins and ends, 0..1 along the edge; NaN where only fractions can tell.
    count : (1,) int64
        Receives the number of spans.

    Returns
    -------
    int
        One past the last edge whose spans had room.
    """
    corners, corner_depths, nearest, slack = triangles
    starts, lists = cells
    columns, rows, shift = grid
    total = np.int64(0)
    for n in range(edges[0], edges[1]):
        count[0] = total
        if ends[n, 0] == ends[n, 2] and ends[n, 1] == ends[n, 3]:
            continue
        farthest = min(edge_depths[n, 0], edge_depths[n, 1])
        top, bottom = min(ends[n, 1], ends[n, 3]), max(ends[n, 1], ends[n, 3])
        first, last = max(np.int64(top) >> shift, np.int64(0)), np.int64(bottom) >> shift
        is_hidden = False
        for row in range(first, min(last, np.int64(rows - 1)) + 1):
            left, right = find_columns(ends, n, row, shift, columns)
            cell = row * columns + left
            end = starts[row * columns + right + 1] if left <= right else np.int64(0)
            k = starts[cell] if left <= right else np.int64(0)
            # The lists of a row of cells follow each other.
            while k < end and not is_hidden:
                triangle = np.int64(lists[k])
                k += 1
                if stamps[triangle] == n or nearest[triangle] <= farthest:
                    continue
                stamps[triangle] = n
                outcome, low, high = find_span(
                    ends, edge_depths, n, corners, corner_depths, slack, triangle
                )
                if outcome == NONE:
                    continue
                is_hidden = outcome == PART and low <= TINY and high >= 1.0 - TINY
                if is_hidden:
                    # Nothing else matters.
                    total = count[0]
                if total == pairs.shape[0]:
                    return np.int64(n)
                pairs[total, 0], pairs[total, 1] = n, triangle
                spans[total, 0] = np.nan if outcome == UNSURE else low
                spans[total, 1] = high
                total += 1
            if is_hidden:
                break
    count[0] = total
    return np.int64(edges[1])


@helper
def write_piece(pieces, parts, is_hidden, n, owner, low, high, hidden):
    """Write a piece of an edge unless it is nothing; return the number of pieces."""
    if high - low <= TINY:
        return n
    pieces[n], is_hidden[n] = owner, hidden
    parts[n, 0], parts[n, 1] = low, high
    return n + 1


@kernel
def split_edges(
    count: int64, owners: int32[::1], spans: float64[:, ::1], pieces: int32[::1],
    parts: float64[:, ::1], is_hidden: uint8[::1],
):  # fmt: skip
    """
    Split edges into visible and hidden pieces.

    Parameters
    ----------
    count : int
        Number of edges.
    owners : (M,) int32, ascending
        The edge of each hidden span.
    spans : (M, 2) float64
        Where each begins and ends, 0..1 along its edge; ascending for each edge.
    pieces : (2 M + count,) int32
        Writes the edge of each piece, ascending.
    parts : (2 M + count, 2) float64
        Writes where each begins and ends.
    is_hidden : (2 M + count,) uint8
        Writes 1 for hidden pieces.

    Returns
    -------
    int
        Number of pieces.
    """
    n, k = np.int64(0), np.int64(0)
    for owner in range(count):
        behind = low = high = 0.0
        while k < owners.shape[0] and owners[k] == owner:
            if spans[k, 0] > high + TINY:
                n = write_piece(pieces, parts, is_hidden, n, owner, behind, low, 0)
                n = write_piece(pieces, parts, is_hidden, n, owner, low, high, 1)
                behind = high if high > low else behind
                low = spans[k, 0]
            high = max(high, spans[k, 1])
            k += 1
        if high >= 1.0 - TINY:
            high = 1.0
        n = write_piece(pieces, parts, is_hidden, n, owner, behind, low, 0)
        n = write_piece(pieces, parts, is_hidden, n, owner, low, high, 1)
        n = write_piece(pieces, parts, is_hidden, n, owner, max(behind, high), 1.0, 0)
    return n
