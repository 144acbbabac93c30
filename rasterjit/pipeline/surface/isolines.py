"""
Draw iso-lines: where the scalars of a face are exactly a level.

A scalar is ``sum e_k r_k s_k / sum e_k r_k``, with the edge functions ``e`` of the face, one over w
as ``r`` and the scalars ``s`` of its vertices. So it is ``level`` where ``g = sum e_k r_k (s_k -
level)`` is 0, and g is linear on the screen, under perspective too: the line is straight, and a
sample's distance from it is ``|g|`` over the length of its gradient, pixels. Of a face that was
clipped, edge functions follow from its clip positions, with w in them already.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import relative_to_sample
from rasterjit.pipeline.geometry.setup import CLIPPED, edge, whole_size
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import get_patch_vertices
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.pipeline.surface.scalar_colors import VALUE, is_finite
from rasterjit.pipeline.surface.texture_lookup import TEXTURE_RED
from rasterjit.runtime.jit import helper, stage
from rasterjit.runtime.state_block import float32, float64, int64

FIRST_LEVEL, LEVELS = 0, 1
"""Columns of ``ranges``: an object's first level, and their number."""

HALF_WIDTH, LINE_RED = 0, 1
"""Columns of ``lines``; LINE_RED is followed by green and blue."""


@helper
def snapped_edges(a, b, c, column, row, xy, w, bits):
    """Return e r, and its steps right and down by a pixel, for a face that was not clipped."""
    ax, ay, bx = np.int64(xy[a, 0]), np.int64(xy[a, 1]), np.int64(xy[b, 0])
    by, cx, cy = np.int64(xy[b, 1]), np.int64(xy[c, 0]), np.int64(xy[c, 1])
    half = np.int64(1) << (bits - 1)
    px, py = (np.int64(column) << bits) + half, (np.int64(row) << bits) + half
    ra, rb, rc = 1.0, 1.0, 1.0
    if w.shape[0] != 0:
        smallest = min(w[a], min(w[b], w[c]))
        ra, rb, rc = smallest / w[a], smallest / w[b], smallest / w[c]
    unit = np.float64(np.int64(1) << bits)
    here = (
        ra * np.float64(edge(bx, by, cx, cy, px, py)),
        rb * np.float64(edge(cx, cy, ax, ay, px, py)),
        rc * np.float64(edge(ax, ay, bx, by, px, py)),
    )
    right = (
        unit * ra * np.float64(by - cy), unit * rb * np.float64(cy - ay),
        unit * rc * np.float64(ay - by),
    )  # fmt: skip
    down = (
        unit * ra * np.float64(cx - bx), unit * rb * np.float64(ax - cx),
        unit * rc * np.float64(bx - ax),
    )  # fmt: skip
    return here, right, down


@helper
def clipped_edges(a, b, c, column, row, clip, viewport):
    """Return e r, and its steps right and down by a pixel, for a clipped face."""
    (ax, bx, cx), (ay, by, cy) = relative_to_sample(a, b, c, column, row, clip, viewport)
    wa, wb, wc = clip[a, 3], clip[b, 3], clip[c, 3]
    width, height = whole_size(viewport)
    right, down = 2.0 / width, -2.0 / height
    return (
        (bx * cy - cx * by, cx * ay - ax * cy, ax * by - bx * ay),
        (right * (wc * by - wb * cy), right * (wa * cy - wc * ay), right * (wb * ay - wa * by)),
        (down * (cx * wb - bx * wc), down * (ax * wc - cx * wa), down * (bx * wa - ax * wb)),
    )


@helper
def dot3(a, b):
    """Return the dot product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@helper
def lies_on_line(level, half, scalars, edges):
    """
    Return whether a sample lies within half a width of a line.

    At exactly half a width it counts on the side of higher values only, so that a line midway
    between two rows of samples covers one of them.
    """
    here, right, down = edges
    differences = scalars[0] - level, scalars[1] - level, scalars[2] - level
    g, x, y = dot3(here, differences), dot3(right, differences), dot3(down, differences)
    steepest = max(abs(x), abs(y))
    if not steepest > 0.0:
        return False
    # Scale them first: squares of very large or very small ones overflow or vanish.
    distance, x, y = abs(g) / steepest, x / steepest, y / steepest
    half_width = half * np.sqrt(x * x + y * y)
    is_above = (g >= 0.0) == (here[0] + here[1] + here[2] > 0.0)
    return distance <= half_width if is_above else distance < half_width


@helper
def upper_bound(value, levels, first, count):
    """Return one past the last of some ascending levels that is not above a value."""
    low, high = first, first + count
    while low < high:
        middle = (low + high) >> 1
        if levels[np.uintp(middle)] <= value:
            low = middle + 1
        else:
            high = middle
    return low


@stage
def draw_contours(
    block: Block, count, values: float64[::1], levels: float64[::1], ranges: int64[:, ::1],
    lines: float32[:, ::1], geometry: Geometry,
):  # fmt: skip
    """
    Replace the colormap's colour by that of iso-lines, where a sample lies on one.

    After `scalar_colors.apply_colormaps`. The levels above and below a sample's scalar are the
    nearest lines. A face of three equal scalars has no line.

    Parameters
    ----------
    values : (V,) float64
    levels : (N,) float64
        Those of each object, ascending.
    ranges : (O, 2) int64
        The first of an object's, and how many it has.
    lines : (O, 4) float32
        Half the width, pixels; red, green, blue, linear.
    geometry : Geometry
    """
    ints, viewport, xy, w = block.ints, geometry.viewport, geometry.xy, geometry.w
    # The segments of objects with lines.
    for k in range(block.counts[rows.SEGMENTS]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        first_level, level_count = ranges[owner, FIRST_LEVEL], ranges[owner, LEVELS]
        if level_count == 0:
            continue
        half = np.float64(lines[owner, HALF_WIDTH])
        # Their faces whose scalars differ.
        for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
            a, b, c = get_patch_vertices(ints, r)
            scalars = values[a], values[b], values[c]
            if scalars[0] == scalars[1] and scalars[1] == scalars[2]:
                continue
            codes = geometry.codes[a] | geometry.codes[b] | geometry.codes[c]
            for n in range(
                np.uintp(ints[rows.FIRST, r]), np.uintp(ints[rows.FIRST, r + np.uintp(1)])
            ):
                value = block.doubles[VALUE, n]
                if not is_finite(value):
                    continue
                column, row = np.int64(ints[rows.COLUMN, n]), np.int64(ints[rows.ROW, n])
                if segment[rows.KIND] == rows.SPAN:
                    row = np.int64(segment[rows.ROW_OF])
                    column = (
                        np.int64(segment[rows.COLUMN_OF])
                        + np.int64(n)
                        - np.int64(segment[rows.START])
                    )
                if codes & CLIPPED:
                    edges = clipped_edges(a, b, c, column, row, geometry.clip_positions, viewport)
                else:
                    edges = snapped_edges(a, b, c, column, row, xy, w, viewport.grid_bits)
                # The level above the sample, then that below it.
                above = upper_bound(value, levels, first_level, level_count)
                is_drawn = False
                if above > first_level:
                    level = levels[np.uintp(above - 1)]
                    is_drawn = lies_on_line(level, half, scalars, edges)
                if not is_drawn and above < first_level + level_count:
                    level = levels[np.uintp(above)]
                    is_drawn = lies_on_line(level, half, scalars, edges)
                if is_drawn:
                    for i in range(3):
                        block.colors[TEXTURE_RED + i, n] = lines[owner, LINE_RED + i]
                    block.colors[TEXTURE_RED + 3, n] = np.float32(1.0)
