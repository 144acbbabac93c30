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

from rasterjit.pipeline.geometry.barycentric import offset_from_sample
from rasterjit.pipeline.geometry.setup import CLIPPED, edge, get_picture_size
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import (
    get_patch_samples,
    get_patch_vertices,
    get_pixel,
)
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.pipeline.surface.scalar_colors import SCALAR, find_first_above, is_finite
from rasterjit.pipeline.surface.texture_lookup import TEXTURE_RED
from rasterjit.runtime.jit import helper, stage
from rasterjit.runtime.state_block import float32, float64, int64

FIRST_LEVEL, LEVEL_COUNT = 0, 1
"""Columns of ``ranges``: index of an object's first level, and the number of its levels."""

HALF_WIDTH, LINE_RED = 0, 1
"""Columns of ``lines``: half the width of lines, pixels; red, followed by green and blue."""


@helper
def evaluate_unclipped_edges(a, b, c, column, row, xy, w, bits):
    """
    Evaluate ``e r`` of a face that was not clipped, at a pixel.

    Returns three numbers each: the values, and their steps to the right and down by a pixel.
    """
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
def evaluate_clipped_edges(a, b, c, column, row, clip, viewport):
    """Evaluate ``e r`` of a clipped face, as `evaluate_unclipped_edges` does."""
    (ax, bx, cx), (ay, by, cy) = offset_from_sample(a, b, c, column, row, clip, viewport)
    wa, wb, wc = clip[a, 3], clip[b, 3], clip[c, 3]
    width, height = get_picture_size(viewport)
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
def is_on_line(level, half_width, scalars, edges):
    """
    Return whether a sample lies within half the width of a level's line.

    At exactly half the width only samples with higher values count, so that a line midway between
    two rows of samples covers one of them.
    """
    values, right, down = edges
    differences = scalars[0] - level, scalars[1] - level, scalars[2] - level
    g, x, y = dot3(values, differences), dot3(right, differences), dot3(down, differences)
    steepest = max(abs(x), abs(y))
    if not steepest > 0.0:
        return False
    # Scale first: squares of very large or very small slopes overflow or vanish.
    distance, x, y = abs(g) / steepest, x / steepest, y / steepest
    max_distance = half_width * np.sqrt(x * x + y * y)
    is_above = (g >= 0.0) == (values[0] + values[1] + values[2] > 0.0)
    return distance <= max_distance if is_above else distance < max_distance


@stage
def draw_isolines(
    block: Block, count, values: float64[::1], levels: float64[::1], ranges: int64[:, ::1],
    lines: float32[:, ::1], geometry: Geometry,
):  # fmt: skip
    """
    Replace the colormap's colour by that of an iso-line, where a sample lies on one.

    After `scalar_colors.apply_colormaps`. Only the levels next above and below a sample's scalar
    are tested. A face of three equal scalars has no line.

    Parameters
    ----------
    values : (V,) float64
    levels : (N,) float64
        The levels of each object, ascending.
    ranges : (O, 2) int64
        The index of an object's first level, and the number of its levels.
    lines : (O, 4) float32
        Half the width, pixels; red, green, blue, linear.
    geometry : Geometry
    """
    ints, viewport, xy, w = block.ints, geometry.viewport, geometry.xy, geometry.w
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        first_level, level_count = ranges[owner, FIRST_LEVEL], ranges[owner, LEVEL_COUNT]
        if level_count == 0:
            continue
        half_width = np.float64(lines[owner, HALF_WIDTH])
        for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
            a, b, c = get_patch_vertices(ints, r)
            scalars = values[a], values[b], values[c]
            if scalars[0] == scalars[1] and scalars[1] == scalars[2]:
                continue
            codes = geometry.codes[a] | geometry.codes[b] | geometry.codes[c]
            start, end = get_patch_samples(ints, r)
            for n in range(start, end):
                value = block.doubles[SCALAR, n]
                if not is_finite(value):
                    continue
                column, row = get_pixel(n, segment, ints)
                if codes & CLIPPED:
                    edges = evaluate_clipped_edges(
                        a, b, c, column, row, geometry.clip_positions, viewport
                    )
                else:
                    edges = evaluate_unclipped_edges(
                        a, b, c, column, row, xy, w, viewport.grid_bits
                    )
                is_drawn, above = False, find_first_above(value, levels, first_level, level_count)
                if above > first_level:
                    level = levels[np.uintp(above - 1)]
                    is_drawn = is_on_line(level, half_width, scalars, edges)
                if not is_drawn and above < first_level + level_count:
                    level = levels[np.uintp(above)]
                    is_drawn = is_on_line(level, half_width, scalars, edges)
                if is_drawn:
                    for i in range(3):
                        block.colors[TEXTURE_RED + i, n] = lines[owner, LINE_RED + i]
                    block.colors[TEXTURE_RED + 3, n] = np.float32(1.0)
