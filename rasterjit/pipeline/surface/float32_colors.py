"""
Interpolate vertex colours in float32.

Neighbouring samples of one face (a run) are one loop: edge functions step in registers, and weights
are never stored. Where most runs are shorter than `MIN_MEAN_PATCH_SAMPLES`, starting one would cost
more than its samples; there vertices are gathered for each sample. Both follow the arithmetic of
``float32_weights``, so a sample has the same bits either way.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.geometry.setup import CLIPPED, get_picture_size
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.surface import float32_weights
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.attributes import (
    gather_vertex_values,
    interpolate_segment_colors,
    multiply_float32_colors,
    multiply_float32_span,
    read_vertex_color,
)
from rasterjit.pipeline.surface.barycentric_weights import may_have_wide_faces
from rasterjit.pipeline.surface.gather_samples import (
    get_patch_vertices,
    get_pixel,
    round_up_to_vectors,
)
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.intrinsics import (
    LANES,
    blend_clipped_run,
    blend_run,
    nine_parts,
    part,
    three_parts,
)
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, uint8

MIN_MEAN_PATCH_SAMPLES = 4
"""Least average length of patches for processing run by run."""


@disjoint_helper
def fill_color(red, green, blue, color):
    """Write one colour to all samples of three rows."""
    for n in range(red.shape[0]):
        red[n], green[n], blue[n] = color


@helper
def blend_patches(segment, block, geometry, has_wide, base, colors):
    """
    Write the colours of a mixed segment, whose patches are short.

    Returns whether float32 is accurate enough for all weights; else writes none.
    """
    if float32_weights.weigh_mixed(segment, block, geometry, has_wide) != 0:
        return False
    s = np.int64(segment[rows.START])
    e = s + round_up_to_vectors(segment[rows.STOP] - s)
    samples, weights, floats = block.samples, block.float32_weights, block.floats
    gather_vertex_values(segment, colors, block.ints, floats)
    red, green, blue = three_parts(samples, rows.RED, s, e)
    fill_color(red, green, blue, base)
    multiply_float32_colors(
        red, green, blue, *nine_parts(floats, 0, s, e), *three_parts(weights, 0, s, e)
    )
    return True


@disjoint_helper
def weigh_clipped_row(first, second, third, a, b, c, column, row, clip, viewport):
    """Write the weights along a row of one clipped face: computed in float64, rounded once."""
    if b == c:
        for n in range(first.shape[0]):
            x = column + np.float64(np.int32(n))
            w0, w1, w2 = barycentric.compute_clipped_weights(a, b, c, x, row, clip, viewport)
            w0, w1, w2 = barycentric.divide_by_sum(w0, w1, w2)
            first[n], second[n], third[n] = np.float32(w0), np.float32(w1), np.float32(w2)
        return
    for n in range(first.shape[0]):
        x = column + np.float64(np.int32(n))
        w0, w1, w2 = barycentric.compute_clipped_face_weights(a, b, c, x, row, clip, viewport)
        w0, w1, w2 = barycentric.divide_by_sum(w0, w1, w2)
        first[n], second[n], third[n] = np.float32(w0), np.float32(w1), np.float32(w2)


@helper
def blend_clipped_row(corners, out, memory, pixel, geometry, colors, base):
    """Write the colours along a row of one clipped face; return not 0 if any is inexact."""
    (a, b, c), (red, green, blue), (column, row) = corners, out, pixel
    clip, viewport = geometry.clip_positions, geometry.viewport
    across, down = barycentric.offset_from_sample(a, b, c, np.float64(column), row, clip, viewport)
    (u0, u1, u2), (v0, v1, v2) = across, down
    # All sums of weights on a face have the same sign, up to rounding.
    if (u1 * v2 - u2 * v1) + (u2 * v0 - u0 * v2) + (u0 * v1 - u1 * v0) < 0.0:
        down = -v0, -v1, -v2
    return blend_clipped_run(
        red, green, blue, memory, np.float64(2 * (viewport.left + column) + 1),
        np.float64(get_picture_size(viewport)[0]), (clip[a, 0], clip[b, 0], clip[c, 0]),
        (clip[a, 3], clip[b, 3], clip[c, 3]), down, colors, base,
    )  # fmt: skip


@helper
def evaluate_edges_along_row(a, b, c, column, row, bits, xy):
    """Return a narrow face's edge functions at a pixel, and their steps to the right."""
    half = np.int32(1) << (bits - 1)
    px, py = np.int32((column << bits) + half), np.int32((row << bits) + half)
    x0, y0 = np.float64(np.int32(xy[a, 0] - px)), np.float64(np.int32(xy[a, 1] - py))
    x1, y1 = np.float64(np.int32(xy[b, 0] - px)), np.float64(np.int32(xy[b, 1] - py))
    x2, y2 = np.float64(np.int32(xy[c, 0] - px)), np.float64(np.int32(xy[c, 1] - py))
    pixel = np.float64(np.int32(1) << bits)
    return (
        (x1 * y2 - y1 * x2, x2 * y0 - y2 * x0, x0 * y1 - y0 * x1),
        ((y1 - y2) * pixel, (y2 - y0) * pixel, (y0 - y1) * pixel),
    )


@helper
def blend_row(corners, start, stop, pixel, block, geometry, has_wide, base, colors):
    """Write the colours of neighbouring samples of one face."""
    xy, codes, w, samples = geometry.xy, geometry.codes, geometry.w, block.samples
    (a, b, c), (column, row) = corners, pixel
    at_a, at_b = read_vertex_color(colors, a), read_vertex_color(colors, b)
    at_c = read_vertex_color(colors, c)
    is_clipped = np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED) != 0
    end, corner_colors = start + ((stop - start + (LANES - 1)) & -LANES), (at_a, at_b, at_c)
    out = three_parts(samples, rows.RED, start, end)
    if is_clipped and b != c:
        doubles = block.doubles
        memory = (
            part(doubles, 0, start, end), part(doubles, 1, start, end),
            part(doubles, 2, start, end), part(doubles, 3, start, end),
        )  # fmt: skip
        if blend_clipped_row(corners, out, memory, pixel, geometry, corner_colors, base) == 0:
            return
    elif not (is_clipped or (has_wide and float32_weights.is_wide(a, b, c, xy))):
        edges, steps = evaluate_edges_along_row(
            a, b, c, column, row, geometry.viewport.grid_bits, xy
        )
        one = np.float32(1.0)
        ratio_b, ratio_c = one, one
        if w.shape[0] != 0:
            ratio_b, ratio_c = np.float32(w[a] / w[b]), np.float32(w[a] / w[c])
        # Bounds on the sums of weights on the face.
        size = abs(edges[0] + edges[1] + edges[2])
        low = size * min(one, min(ratio_b, ratio_c))
        high = size * max(one, max(ratio_b, ratio_c))
        if low > 2.0 * float32_weights.MIN_TOTAL and high < 0.5 * float32_weights.MAX_TOTAL:
            blend_run(
                out[0], out[1], out[2], edges, steps, (ratio_b, ratio_c), corner_colors, base
            )  # fmt: skip
            return
    weights = block.float32_weights
    first, second, third = three_parts(weights, 0, start, stop)
    if is_clipped:
        weigh_clipped_row(
            first, second, third, a, b, c, np.float64(column), row, geometry.clip_positions,
            geometry.viewport,
        )  # fmt: skip
    else:
        for n in range(stop - start):
            first[n], second[n], third[n] = float32_weights.weights_at(
                a, b, c, column + n, row, geometry
            )
    red, green, blue = three_parts(samples, rows.RED, start, stop)
    fill_color(red, green, blue, base)
    multiply_float32_span(red, green, blue, first, second, third, at_a, at_b, at_c)


@helper
def continues_run(ints, r, following, start):
    """Return whether a patch continues the run of one face that begins with patch ``r``."""
    n = np.uintp(ints[rows.FIRST_SAMPLE, following])
    return (
        ints[rows.FACE, following] == ints[rows.FACE, r]
        and ints[rows.ROW, n] == ints[rows.ROW, start]
        and ints[rows.COLUMN, n] - ints[rows.COLUMN, start] == np.int64(n) - np.int64(start)
    )


@helper
def blend_runs(segment, block, geometry, has_wide, base, colors):
    """Write the colours of a segment, run by run."""
    ints = block.ints
    r, end = np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])
    while r < end:
        start, following = np.uintp(ints[rows.FIRST_SAMPLE, r]), r + np.uintp(1)
        while following < end and continues_run(ints, r, following, start):
            following += np.uintp(1)
        pixel = get_pixel(start, segment, ints)
        corners = get_patch_vertices(ints, r)
        blend_row(
            corners, np.int64(start), np.int64(ints[rows.FIRST_SAMPLE, following]), pixel, block,
            geometry, has_wide, base, colors,
        )  # fmt: skip
        r = following


@stage
def find_float32_colors(
    block: Block, count, geometry: Geometry, materials: float32[:, ::1], colors: float32[:, ::1],
    is_float32: uint8[::1],
):  # fmt: skip
    """
    Write the base colours times the vertex colours, (V, 4), interpolated in float32.

    For objects where ``is_float32``, (O,), is not 0; others in float64, by
    `interpolate_vertex_colors`. One pass for both: vectors write past the end of a segment, which
    the next overwrites.
    """
    has_wide = may_have_wide_faces(geometry.viewport)
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        if is_float32[owner] == 0:
            interpolate_segment_colors(segment, block, colors, materials)
            continue
        base = materials[owner, 0], materials[owner, 1], materials[owner, 2]
        patches = segment[rows.END_PATCH] - segment[rows.FIRST_PATCH]
        is_short = segment[rows.STOP] - segment[rows.START] < MIN_MEAN_PATCH_SAMPLES * patches
        if not (is_short and blend_patches(segment, block, geometry, has_wide, base, colors)):
            blend_runs(segment, block, geometry, has_wide, base, colors)
