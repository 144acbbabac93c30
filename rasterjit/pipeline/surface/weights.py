"""Find where on its face each sample lies: the weights of the second and the third vertex."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import (
    UNDERFLOW,
    clamped_edges,
    clipped_weights,
    has_its_back_turned,
    normalized,
    sample_weights,
)
from rasterjit.pipeline.geometry.setup import CLIPPED, edge, narrow_edge
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.surface.listing import whole_vectors
from rasterjit.pipeline.surface.samples import (
    AX,
    AY,
    BEHIND,
    BX,
    BY,
    COLUMN,
    COLUMN_OF,
    CX,
    CY,
    END_PATCH,
    FIRST,
    FIRST_PATCH,
    KIND,
    OWNER,
    ROW,
    ROW_OF,
    SEGMENTS,
    SPAN,
    START,
    STOP,
    UNSURE,
    A,
    B,
    Block,
    C,
)
from rasterjit.runtime.intrinsics import part, spread
from rasterjit.runtime.jit import disjoint_helper, helper, stage


@disjoint_helper
def weigh(
    ax, ay, bx, by, cx, cy, wa, wb, wc, columns, rows, count, place, bits, reach, is_affine,
    front_turn, unsure, behind, second, third,
):  # fmt: skip
    """
    Write the weights of ``count`` samples, each of a face of its own, and which side is seen.

    ``place`` is where in its pixel the sample lies, sub-pixel units. Returns whether any sample has
    to be weighed in another way: its face was clipped, or its weights are doubtful.
    """
    found = np.int32(0)
    for n in range(ax.shape[0]):
        px = np.int32((columns[n] << bits) + place[0])
        py = np.int32((rows[n] << bits) + place[1])
        x0, y0, x1, y1, x2, y2 = ax[n], ay[n], bx[n], by[n], cx[n], cy[n]
        e0, e1, e2 = (
            narrow_edge(x1, y1, x2, y2, px, py), narrow_edge(x2, y2, x0, y0, px, py),
            narrow_edge(x0, y0, x1, y1, px, py),
        )  # fmt: skip
        k0, k1, k2, whole = np.float64(e0), np.float64(e1), np.float64(e2), np.float64(e0 + e1 + e2)
        behind[n] = np.int32(whole * front_turn < 0.0)
        if reach != 0:
            right, down = (y1 - y2, y2 - y0, y0 - y1), (x2 - x1, x0 - x2, x1 - x0)
            k0, k1, k2 = clamped_edges((e0, e1, e2), right, down)
            whole = np.float64(k0 + k1 + k2)
        w0, w1, w2 = wa[n], wb[n], wc[n]
        smallest = min(w0, min(w1, w2))
        w0, w1, w2 = k0 * (smallest / w0), k1 * (smallest / w1), k2 * (smallest / w2)
        total, over = w0 + w1 + w2, 1.0 / whole
        second[n] = k1 * over if is_affine else w1 / total
        third[n] = k2 * over if is_affine else w2 / total
        doubtful = unsure[n] | np.int32(not (is_affine or abs(total) > UNDERFLOW))
        unsure[n] = doubtful
        found |= doubtful if n < count else np.int32(0)
    return found


@helper
def gather_screen(first, end, xy, codes, w, whole, real):
    """Gather where vertices of patches lie on the screen, what was clipped, and w; 1 without."""
    is_affine = w.shape[0] == 0
    for r in range(np.uintp(first), np.uintp(end)):
        n, code = np.uintp(whole[FIRST, r]), codes[np.uintp(whole[A, r])]
        for k in range(3):
            vertex = np.uintp(whole[A + k, r])
            spread(whole[AX + 2 * k], n, xy[vertex, 0])
            spread(whole[AY + 2 * k], n, xy[vertex, 1])
            spread(real[k], n, 1.0 if is_affine else w[vertex])
            code |= codes[vertex]
        spread(whole[UNSURE], n, np.int32(code & CLIPPED))


@helper
def weigh_mixed(segment, whole, real, weights, xy, codes, w, bits, reach, front_turn):
    """Write what `weigh` does of the samples of a mixed segment; return if any is unsure."""
    s = np.int64(segment[START])
    count = segment[STOP] - s
    e = s + whole_vectors(count)
    gather_screen(segment[FIRST_PATCH], segment[END_PATCH], xy, codes, w, whole, real)
    half = np.int32(1) << (bits - 1)
    return weigh(
        part(whole, AX, s, e), part(whole, AY, s, e), part(whole, BX, s, e), part(whole, BY, s, e),
        part(whole, CX, s, e), part(whole, CY, s, e), part(real, 0, s, e), part(real, 1, s, e),
        part(real, 2, s, e), part(whole, COLUMN, s, e), part(whole, ROW, s, e), count, (half, half),
        bits, reach, w.shape[0] == 0, front_turn, part(whole, UNSURE, s, e),
        part(whole, BEHIND, s, e), part(weights, 0, s, e), part(weights, 1, s, e),
    )  # fmt: skip


@helper
def span_start(a, b, c, column, row, bits, xy, w):
    """
    Return the edge functions of a face at a pixel, and their gains to the right and down.

    Also returns, for each vertex, the smallest w over its own; 1 if affine.
    """
    ax, ay, bx = np.int64(xy[a, 0]), np.int64(xy[a, 1]), np.int64(xy[b, 0])
    by, cx, cy = np.int64(xy[b, 1]), np.int64(xy[c, 0]), np.int64(xy[c, 1])
    half = np.int64(1) << (bits - 1)
    px, py = (column << bits) + half, (row << bits) + half
    edges = (
        edge(bx, by, cx, cy, px, py), edge(cx, cy, ax, ay, px, py), edge(ax, ay, bx, by, px, py)
    )  # fmt: skip
    right = (by - cy) << bits, (cy - ay) << bits, (ay - by) << bits
    down = (cx - bx) << bits, (ax - cx) << bits, (bx - ax) << bits
    if w.shape[0] == 0:
        return edges, right, down, (1.0, 1.0, 1.0)
    smallest = min(w[a], min(w[b], w[c]))
    return edges, right, down, (smallest / w[a], smallest / w[b], smallest / w[c])


@disjoint_helper
def weigh_along_row(second, third, behind, row_start, is_affine, front_turn):
    """Write weights, and which side is seen, along a row of one face; return if any is doubtful."""
    (e0, e1, e2), steps, _, ratios = row_start
    whole, doubtful = np.float64(e0 + e1 + e2), np.int64(0)
    over, is_behind = 1.0 / whole, np.int32(whole * front_turn < 0.0)
    for n in range(second.shape[0]):
        k0, k1, k2 = np.float64(e0), np.float64(e1), np.float64(e2)
        if is_affine:
            second[n], third[n] = k1 * over, k2 * over
        else:
            w0, w1, w2 = k0 * ratios[0], k1 * ratios[1], k2 * ratios[2]
            total = w0 + w1 + w2
            second[n], third[n] = w1 / total, w2 / total
            doubtful |= np.int64(not abs(total) > UNDERFLOW)
        behind[n] = is_behind
        e0 += steps[0]
        e1 += steps[1]
        e2 += steps[2]
    return np.int32(doubtful)


@helper
def doubt_span(s, e, column, row, row_start, doubtful, whole):
    """
    Note which samples of a span are unsure: all if one is, else those beside the face.

    Notes their pixels, too. Returns whether any is unsure.
    """
    (e0, e1, e2), steps, _, _ = row_start
    side, found = np.int64(-1) if e0 + e1 + e2 < 0 else np.int64(1), np.int32(0)
    for n in range(np.uintp(s), np.uintp(e)):
        is_beside = min(side * e0, min(side * e1, side * e2)) < 0
        unsure = doubtful | np.int32(is_beside)
        whole[COLUMN, n], whole[ROW, n], whole[UNSURE, n] = column, row, unsure
        found |= unsure
        column += 1
        e0 += steps[0]
        e1 += steps[1]
        e2 += steps[2]
    return found


@helper
def weigh_span(segment, whole, weights, xy, codes, w, bits, reach, front_turn):
    """Write what `weigh` does of the samples of a span; return if any is unsure."""
    r, s, e = np.uintp(segment[FIRST_PATCH]), np.int64(segment[START]), np.int64(segment[STOP])
    a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
    column, row = np.int64(segment[COLUMN_OF]), np.int64(segment[ROW_OF])
    row_start = span_start(a, b, c, column, row, bits, xy, w)
    doubtful = np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED)
    if doubtful == 0:
        doubtful = weigh_along_row(
            part(weights, 0, s, e), part(weights, 1, s, e), part(whole, BEHIND, s, e), row_start,
            w.shape[0] == 0, front_turn,
        )  # fmt: skip
    if doubtful == 0 and reach == 0:
        return doubtful
    return doubt_span(s, e, column, row, row_start, doubtful, whole)


@disjoint_helper
def weigh_clipped(second, third, behind, corners, column, row, is_behind, clip, viewport):
    """
    Write weights, and which side is seen, along a row of one face that was clipped.

    Those of `sample_weights`, without branches or calls between samples, so that it vectorizes.
    """
    a, b, c = corners
    for n in range(second.shape[0]):
        here = column + np.float64(np.int32(n))
        w0, w1, w2 = clipped_weights(a, b, c, here, row, clip, viewport)
        _, second[n], third[n] = normalized(w0, w1, w2)
        behind[n] = is_behind


@helper
def weigh_unsure(segment, whole, weights, geometry, placement):
    """Write exactly the weights of the unsure samples of a segment, and which side is seen."""
    owner, codes = np.int64(segment[OWNER]), geometry.codes
    for r in range(np.uintp(segment[FIRST_PATCH]), np.uintp(segment[END_PATCH])):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        first, end = np.int64(whole[FIRST, r]), np.int64(whole[FIRST, r + np.uintp(1)])
        if (codes[a] | codes[b] | codes[c]) & CLIPPED:
            column, row = np.float64(whole[COLUMN, first]), np.int64(whole[ROW, first])
            weigh_clipped(
                part(weights, 0, first, end), part(weights, 1, first, end),
                part(whole, BEHIND, first, end), (a, b, c), column, row,
                np.int32(has_its_back_turned(a, b, c, owner, placement)),
                geometry.clip_positions, geometry.viewport,
            )  # fmt: skip
            continue
        for n in range(np.uintp(first), np.uintp(end)):
            if whole[UNSURE, n] != 0:
                exact = sample_weights(a, b, c, whole[COLUMN, n], whole[ROW, n], geometry)
                weights[0, n], weights[1, n] = exact[1], exact[2]


@stage
def find_weights(block: Block, count, geometry: Geometry, placement: Placement):
    """
    Write the weights of the samples of a block, and which side of each face is seen.

    Leaves the pixels of clipped faces and what `weigh_mixed` gathers of the others, for
    `texture_gradients.find_steps`.
    """
    whole, real, weights = block.whole, block.real, block.weights
    xy, codes, w = geometry.xy, geometry.codes, geometry.w
    bits, reach = geometry.viewport.grid_bits, geometry.viewport.reach
    for k in range(block.counts[SEGMENTS]):
        segment = block.segments[k]
        turn = placement.front_turns[np.int64(segment[OWNER])]
        if segment[KIND] == SPAN:
            unsure = weigh_span(segment, whole, weights, xy, codes, w, bits, reach, turn)
        else:
            unsure = weigh_mixed(segment, whole, real, weights, xy, codes, w, bits, reach, turn)
        if unsure != 0:
            weigh_unsure(segment, whole, weights, geometry, placement)
