"""
Compute barycentric weights in float32: faster, and accurate enough for 8-bit pictures.

Edge functions are whole numbers and exact here, too; they have one sign on a face that a sample
lies on, and so has w. The weights

    b_k = e_k (w_0 / w_k) / (e_0 + e_1 (w_0 / w_1) + e_2 (w_0 / w_2))

are therefore quotients of sums without cancellation: each is off by at most `WEIGHT_ERROR` of
itself, however thin or long the face is and however much w differs. Where float32 would leave its
range, and on clipped faces, whose edges are not known, weights are computed in float64 and rounded.

A sample's weights depend on its face and its pixel alone.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import compute_sample_weights
from rasterjit.pipeline.geometry.setup import CLIPPED
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.barycentric_weights import WIDE_EXTENT, evaluate_edges
from rasterjit.pipeline.surface.gather_samples import get_patch_vertices, round_up_to_vectors
from rasterjit.runtime.intrinsics import part, six_parts, spread, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper

WEIGHT_ERROR = 10.0 * 2.0**-24
"""
Relative error of a weight, at most: each step rounds by 2**-24 of its result.

An edge and a ratio are rounded once, their product once more: 3. Their sum adds 2 to what its terms
are off by: 5. Its inverse and the product with it are rounded: 3 + 5 + 2.
"""

MIN_TOTAL, MAX_TOTAL = np.float32(2.0**-64), np.float32(2.0**120)
"""
Sums of weights between these are accurate.

A ratio below the normal range is off by at most 2**-150, times an edge of at most 2**54: nothing
beside 2**-64.
"""

RATIO_B, RATIO_C = 0, 1
EDGE_A, EDGE_B, EDGE_C = 2, 3, 4
"""Rows of ``floats``: w of the first vertex over that of the others; edge functions."""


@helper
def is_wide(a, b, c, xy):
    """Return whether products of a face's extents may exceed what float64 holds exactly."""
    right = abs(xy[b, 0] - xy[a, 0]) | abs(xy[c, 0] - xy[a, 0])
    down = abs(xy[b, 1] - xy[a, 1]) | abs(xy[c, 1] - xy[a, 1])
    return (right | down) >= WIDE_EXTENT


@helper
def gather_screen(segment, geometry, has_wide, ints, floats):
    """
    Gather screen positions of patches' vertices, and ratios of w.

    Returns not 0 if a face was clipped or, tested if ``has_wide``, is wide.
    """
    xy, codes, w = geometry.xy, geometry.codes, geometry.w
    is_affine, code, one = w.shape[0] == 0, np.uint8(0), np.float32(1.0)
    any_wide = False
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        n = np.uintp(ints[rows.FIRST_SAMPLE, r])
        a, b, c = get_patch_vertices(ints, r)
        code |= codes[a] | codes[b] | codes[c]
        spread(ints[rows.AX], n, xy[a, 0])
        spread(ints[rows.AY], n, xy[a, 1])
        spread(ints[rows.BX], n, xy[b, 0])
        spread(ints[rows.BY], n, xy[b, 1])
        spread(ints[rows.CX], n, xy[c, 0])
        spread(ints[rows.CY], n, xy[c, 1])
        spread(floats[RATIO_B], n, one if is_affine else np.float32(w[a] / w[b]))
        spread(floats[RATIO_C], n, one if is_affine else np.float32(w[a] / w[c]))
        if has_wide:
            any_wide |= is_wide(a, b, c, xy)
    return np.int32(code & CLIPPED) | np.int32(any_wide)


@disjoint_helper
def find_edges(ax, ay, bx, by, cx, cy, xs, ys, bits, half, edge_a, edge_b, edge_c):
    """Write the edge functions of samples, each of a face of its own."""
    for n in range(ax.shape[0]):
        px = np.int32((xs[n] << bits) + half)
        py = np.int32((ys[n] << bits) + half)
        # Integers of at most 26 bits: their products, and differences of these, are exact.
        x0, y0 = np.float64(np.int32(ax[n] - px)), np.float64(np.int32(ay[n] - py))
        x1, y1 = np.float64(np.int32(bx[n] - px)), np.float64(np.int32(by[n] - py))
        x2, y2 = np.float64(np.int32(cx[n] - px)), np.float64(np.int32(cy[n] - py))
        edge_a[n] = np.float32(x1 * y2 - y1 * x2)
        edge_b[n] = np.float32(x2 * y0 - y2 * x0)
        edge_c[n] = np.float32(x0 * y1 - y0 * x1)


@helper
def is_accurate(total):
    """Return whether a sum of weights stays within the accurate range of float32."""
    size = abs(total)
    return (size > MIN_TOTAL) & (size < MAX_TOTAL)


@disjoint_helper
def normalize_weights(edge_a, edge_b, edge_c, ratio_b, ratio_c, count, first, second, third):
    """Write the weights; return not 0 if one of ``count`` is inaccurate."""
    any_inexact, one = np.int32(0), np.float32(1.0)
    for n in range(edge_a.shape[0]):
        w0, w1, w2 = edge_a[n], edge_b[n] * ratio_b[n], edge_c[n] * ratio_c[n]
        total = w0 + w1 + w2
        inverse = one / total
        first[n], second[n], third[n] = w0 * inverse, w1 * inverse, w2 * inverse
        is_inexact = np.int32(not is_accurate(total))
        any_inexact |= is_inexact if np.int32(n) < count else np.int32(0)
    return any_inexact


@helper
def weigh_mixed(segment, block, geometry, has_wide):
    """Write the weights of a mixed segment's samples; return not 0 if any is inaccurate."""
    ints, floats, weights = block.ints, block.floats, block.float32_weights
    s = np.int64(segment[rows.START])
    count = np.int32(segment[rows.STOP] - s)
    e = s + round_up_to_vectors(count)
    inexact = gather_screen(segment, geometry, has_wide, ints, floats)
    bits = geometry.viewport.grid_bits
    edge_a, edge_b, edge_c = three_parts(floats, EDGE_A, s, e)
    find_edges(
        *six_parts(ints, rows.AX, s, e), part(ints, rows.COLUMN, s, e), part(ints, rows.ROW, s, e),
        bits, np.int32(1) << (bits - 1), edge_a, edge_b, edge_c,
    )  # fmt: skip
    return inexact | normalize_weights(
        edge_a, edge_b, edge_c, part(floats, RATIO_B, s, e), part(floats, RATIO_C, s, e), count,
        part(weights, 0, s, e), part(weights, 1, s, e), part(weights, 2, s, e),
    )  # fmt: skip


@helper
def weights_at(a, b, c, column, row, geometry):
    """Return the weights at a pixel: float64 ones, rounded once, where float32 is inaccurate."""
    codes, xy, w, bits = geometry.codes, geometry.xy, geometry.w, geometry.viewport.grid_bits
    is_clipped = np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED) != 0
    if not (is_clipped or is_wide(a, b, c, xy)):
        (e0, e1, e2), _, _, _ = evaluate_edges(a, b, c, column, row, bits, xy, w)
        w0, w1, w2 = np.float32(e0), np.float32(e1), np.float32(e2)
        if w.shape[0] != 0:
            w1, w2 = w1 * np.float32(w[a] / w[b]), w2 * np.float32(w[a] / w[c])
        total = w0 + w1 + w2
        if is_accurate(total):
            inverse = np.float32(1.0) / total
            return w0 * inverse, w1 * inverse, w2 * inverse
    exact = compute_sample_weights(a, b, c, column, row, geometry)
    return np.float32(exact[0]), np.float32(exact[1]), np.float32(exact[2])
