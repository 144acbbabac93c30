"""Compute barycentric weights of a block's samples: those of the second and third vertex."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.geometry.setup import CLIPPED, GUARD_PIXELS, edge, narrow_edge, whole_size
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.surface import sample_block as at
from rasterjit.pipeline.surface.gather_samples import whole_vectors
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.intrinsics import part, six_parts, spread, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage

WIDE = 1 << 26
"""Extents of a face below this have products that are exact in float64, sub-pixel units."""


@helper
def may_be_wide(viewport):
    """Return whether any face within the guard band may be wide."""
    width, height = whole_size(viewport)
    return (max(width, height) + 2 * GUARD_PIXELS) << viewport.grid_bits >= WIDE


@disjoint_helper
def weigh(
    ax, ay, bx, by, cx, cy, wa, wb, wc, columns, rows, count, place, bits, reach, is_affine,
    front_turn, unsure, behind, second, third,
):  # fmt: skip
    """
    Write the weights of ``count`` samples, each of its own face, and whether it is back-facing.

    ``place`` is the sample's position in its pixel, sub-pixel units. Returns whether any sample
    needs the exact path: its face was clipped, or its weights may be inaccurate.
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
            k0, k1, k2 = barycentric.clamped_edges((e0, e1, e2), right, down)
            whole = np.float64(k0 + k1 + k2)
        w0, w1, w2 = wa[n], wb[n], wc[n]
        smallest = min(w0, min(w1, w2))
        w0, w1, w2 = k0 * (smallest / w0), k1 * (smallest / w1), k2 * (smallest / w2)
        total, over = w0 + w1 + w2, 1.0 / whole
        second[n] = k1 * over if is_affine else w1 / total
        third[n] = k2 * over if is_affine else w2 / total
        doubtful = unsure[n] | np.int32(not (is_affine or abs(total) > barycentric.UNDERFLOW))
        unsure[n] = doubtful
        found |= doubtful if n < count else np.int32(0)
    return found


@helper
def edges_inside(ax, ay, bx, by, cx, cy, column, row, bits, half):
    """Return the edge functions of a face that is not wide at a pixel, in float64: exact."""
    px = np.int32(np.int32(column << bits) + half)
    py = np.int32(np.int32(row << bits) + half)
    x0, y0 = np.float64(np.int32(ax - px)), np.float64(np.int32(ay - py))
    x1, y1 = np.float64(np.int32(bx - px)), np.float64(np.int32(by - py))
    x2, y2 = np.float64(np.int32(cx - px)), np.float64(np.int32(cy - py))
    return x1 * y2 - y1 * x2, x2 * y0 - y2 * x0, x0 * y1 - y0 * x1


@disjoint_helper
def weigh_affine(
    ax, ay, bx, by, cx, cy, columns, rows, bits, front_turn, behind, second, third
):  # fmt: skip
    """Do what `weigh` does, for affine weights of samples on faces that are not wide."""
    half = np.int32(np.int32(1) << np.int32(bits - 1))
    for n in range(ax.shape[0]):
        k0, k1, k2 = edges_inside(
            ax[n], ay[n], bx[n], by[n], cx[n], cy[n], columns[n], rows[n], bits, half
        )
        whole = k0 + k1 + k2
        over = 1.0 / whole
        behind[n] = np.int32(whole * front_turn < 0.0)
        second[n], third[n] = k1 * over, k2 * over


@disjoint_helper
def weigh_inside(
    ax, ay, bx, by, cx, cy, wa, wb, wc, columns, rows, bits, front_turn, unsure, behind, second,
    third,
):  # fmt: skip
    """Do what `weigh` does, for perspective-correct weights on faces that are not wide."""
    half = np.int32(np.int32(1) << np.int32(bits - 1))
    for n in range(ax.shape[0]):
        k0, k1, k2 = edges_inside(
            ax[n], ay[n], bx[n], by[n], cx[n], cy[n], columns[n], rows[n], bits, half
        )
        w0, w1, w2 = wa[n], wb[n], wc[n]
        smallest = min(w0, min(w1, w2))
        w0, w1, w2 = k0 * (smallest / w0), k1 * (smallest / w1), k2 * (smallest / w2)
        total = w0 + w1 + w2
        behind[n] = np.int32((k0 + k1 + k2) * front_turn < 0.0)
        second[n], third[n] = w1 / total, w2 / total
        unsure[n] |= np.int32(not abs(total) > barycentric.UNDERFLOW)


@helper
def any_unsure(unsure, count):
    """Return not 0 if any of the first samples needs the exact path."""
    found = np.int32(0)
    for n in range(unsure.shape[0]):
        found |= unsure[n] if np.int32(n) < count else np.int32(0)
    return found


@helper
def gather_screen(first, end, xy, codes, w, whole, real):
    """Gather screen positions, clipped flags and w of patches' vertices; w is 1 if affine."""
    is_affine = w.shape[0] == 0
    for r in range(np.uintp(first), np.uintp(end)):
        n, code = np.uintp(whole[at.FIRST, r]), codes[np.uintp(whole[at.A, r])]
        for k in range(3):
            vertex = np.uintp(whole[at.A + k, r])
            spread(whole[at.AX + 2 * k], n, xy[vertex, 0])
            spread(whole[at.AY + 2 * k], n, xy[vertex, 1])
            spread(real[k], n, 1.0 if is_affine else w[vertex])
            code |= codes[vertex]
        spread(whole[at.UNSURE], n, np.int32(code & CLIPPED))


@helper
def are_all_clipped(segment, whole, codes):
    """Return whether all faces of a segment count as clipped, as those of lines do."""
    for r in range(np.uintp(segment[at.FIRST_PATCH]), np.uintp(segment[at.END_PATCH])):
        a, b, c = np.uintp(whole[at.A, r]), np.uintp(whole[at.B, r]), np.uintp(whole[at.C, r])
        if (codes[a] | codes[b] | codes[c]) & CLIPPED == 0:
            return False
    return True


@helper
def weigh_mixed(segment, whole, real, weights, xy, codes, w, bits, reach, is_narrow, front_turn):
    """
    Do what `weigh` does, for a mixed segment; return whether any sample needs the exact path.

    ``is_narrow``: samples lie on their faces, none of which is wide.
    """
    s = np.int64(segment[at.START])
    count = segment[at.STOP] - s
    e = s + whole_vectors(count)
    if are_all_clipped(segment, whole, codes):
        return np.int32(1)
    gather_screen(segment[at.FIRST_PATCH], segment[at.END_PATCH], xy, codes, w, whole, real)
    if is_narrow:
        ax, ay, bx, by, cx, cy, columns, rows = (
            part(whole, at.AX, s, e), part(whole, at.AY, s, e), part(whole, at.BX, s, e),
            part(whole, at.BY, s, e), part(whole, at.CX, s, e), part(whole, at.CY, s, e),
            part(whole, at.COLUMN, s, e), part(whole, at.ROW, s, e),
        )  # fmt: skip
        unsure, behind, second, third = (
            part(whole, at.UNSURE, s, e), part(whole, at.BEHIND, s, e), part(weights, 0, s, e),
            part(weights, 1, s, e),
        )  # fmt: skip
        narrow = np.int32(bits)
        if w.shape[0] == 0:
            weigh_affine(
                ax, ay, bx, by, cx, cy, columns, rows, narrow, front_turn, behind, second, third
            )
        else:
            weigh_inside(
                ax, ay, bx, by, cx, cy, *three_parts(real, 0, s, e), columns, rows, narrow,
                front_turn, unsure, behind, second, third,
            )  # fmt: skip
        return any_unsure(unsure, np.int32(count))
    half = np.int32(1) << (bits - 1)
    return weigh(
        *six_parts(whole, at.AX, s, e), *three_parts(real, 0, s, e), part(whole, at.COLUMN, s, e),
        part(whole, at.ROW, s, e), count, (half, half), bits, reach, w.shape[0] == 0, front_turn,
        part(whole, at.UNSURE, s, e), part(whole, at.BEHIND, s, e), part(weights, 0, s, e),
        part(weights, 1, s, e),
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


@helper
def are_exact(edges, steps, count):
    """Return whether float64 holds edge functions along a row, and their steps, exactly."""
    last, limit = np.int64(count - 1), np.int64(1 << 52)
    e0, e1, e2 = edges
    ends = abs(e0 + last * steps[0]) | abs(e1 + last * steps[1]) | abs(e2 + last * steps[2])
    return (abs(e0) | abs(e1) | abs(e2) | ends) < limit


@disjoint_helper
def weigh_affine_row(second, third, edges, steps):
    """Write affine weights along a row."""
    over = 1.0 / (edges[0] + edges[1] + edges[2])
    for n in range(second.shape[0]):
        # Exact within the span.
        way = np.float64(np.int32(n))
        second[n], third[n] = (edges[1] + way * steps[1]) * over, (edges[2] + way * steps[2]) * over


@disjoint_helper
def weigh_along_row(second, third, count, edges, steps, ratios):
    """Write weights along a row; return whether any may be inaccurate."""
    found = np.int32(0)
    for n in range(second.shape[0]):
        way = np.float64(np.int32(n))
        w0 = (edges[0] + way * steps[0]) * ratios[0]
        w1 = (edges[1] + way * steps[1]) * ratios[1]
        w2 = (edges[2] + way * steps[2]) * ratios[2]
        total = w0 + w1 + w2
        second[n], third[n] = w1 / total, w2 / total
        found |= np.int32((not abs(total) > barycentric.UNDERFLOW) & (np.int32(n) < count))
    return found


@disjoint_helper
def note_side(behind, is_behind):
    """Write whether a face is back-facing."""
    for n in range(behind.shape[0]):
        behind[n] = is_behind


@helper
def doubt_span(s, e, column, row, row_start, doubtful, front_turn, whole):
    """
    Mark the samples of a span that need the exact path: off the face, or all if ``doubtful``.

    Writes their pixels, too, and whether they are back-facing. Returns whether any is marked.
    """
    (e0, e1, e2), steps, _, _ = row_start
    is_behind = np.int32(np.float64(e0 + e1 + e2) * front_turn < 0.0)
    side, found = np.int64(-1) if e0 + e1 + e2 < 0 else np.int64(1), np.int32(0)
    for n in range(np.uintp(s), np.uintp(e)):
        is_beside = min(side * e0, min(side * e1, side * e2)) < 0
        unsure = doubtful | np.int32(is_beside)
        whole[at.COLUMN, n], whole[at.ROW, n], whole[at.UNSURE, n] = column, row, unsure
        whole[at.BEHIND, n] = is_behind
        found |= unsure
        column += 1
        e0 += steps[0]
        e1 += steps[1]
        e2 += steps[2]
    return found


@helper
def weigh_span(segment, whole, weights, xy, codes, w, bits, reach, front_turn):
    """Do what `weigh` does, for a span; return whether any sample needs the exact path."""
    r, s, e = (
        np.uintp(segment[at.FIRST_PATCH]),
        np.int64(segment[at.START]),
        np.int64(segment[at.STOP]),
    )
    a, b, c = np.uintp(whole[at.A, r]), np.uintp(whole[at.B, r]), np.uintp(whole[at.C, r])
    column, row = np.int64(segment[at.COLUMN_OF]), np.int64(segment[at.ROW_OF])
    row_start = span_start(a, b, c, column, row, bits, xy, w)
    edges, steps, _, ratios = row_start
    doubtful = np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED)
    doubtful |= np.int32(not are_exact(edges, steps, e - s))
    if doubtful == 0:
        stop = s + whole_vectors(e - s)
        second, third = part(weights, 0, s, stop), part(weights, 1, s, stop)
        first = np.float64(edges[0]), np.float64(edges[1]), np.float64(edges[2])
        gains = np.float64(steps[0]), np.float64(steps[1]), np.float64(steps[2])
        if w.shape[0] == 0:
            weigh_affine_row(second, third, first, gains)
        else:
            doubtful = weigh_along_row(second, third, np.int32(e - s), first, gains, ratios)
        area = np.float64(edges[0] + edges[1] + edges[2])
        note_side(part(whole, at.BEHIND, s, stop), np.int32(area * front_turn < 0.0))
    if doubtful == 0 and reach == 0:
        return doubtful
    return doubt_span(s, e, column, row, row_start, doubtful, front_turn, whole)


@disjoint_helper
def weigh_clipped(second, third, behind, corners, column, row, is_behind, clip, viewport):
    """
    Write weights, and which side is seen, along a row of one face that was clipped.

    Those of `sample_weights`, without branches or calls between samples, so that it vectorizes.
    """
    a, b, c = corners
    if b == c:
        for n in range(second.shape[0]):
            here = column + np.float64(np.int32(n))
            w0, w1, w2 = barycentric.clipped_weights(a, b, c, here, row, clip, viewport)
            _, second[n], third[n] = barycentric.normalized(w0, w1, w2)
            behind[n] = is_behind
        return
    for n in range(second.shape[0]):
        here = column + np.float64(np.int32(n))
        w0, w1, w2 = barycentric.clipped_face_weights(a, b, c, here, row, clip, viewport)
        _, second[n], third[n] = barycentric.normalized(w0, w1, w2)
        behind[n] = is_behind


@helper
def weigh_unsure(segment, whole, weights, geometry, placement):
    """Compute the marked samples of a segment by the exact path, with their facing."""
    owner, codes = np.int64(segment[at.OWNER]), geometry.codes
    for r in range(np.uintp(segment[at.FIRST_PATCH]), np.uintp(segment[at.END_PATCH])):
        a, b, c = np.uintp(whole[at.A, r]), np.uintp(whole[at.B, r]), np.uintp(whole[at.C, r])
        first, end = np.int64(whole[at.FIRST, r]), np.int64(whole[at.FIRST, r + np.uintp(1)])
        if (codes[a] | codes[b] | codes[c]) & CLIPPED:
            column, row = np.float64(whole[at.COLUMN, first]), np.int64(whole[at.ROW, first])
            # Segments and points have no sides.
            is_behind = b != c and barycentric.has_its_back_turned(a, b, c, owner, placement)
            weigh_clipped(
                part(weights, 0, first, end), part(weights, 1, first, end),
                part(whole, at.BEHIND, first, end), (a, b, c), column, row,
                np.int32(is_behind), geometry.clip_positions, geometry.viewport,
            )  # fmt: skip
            continue
        for n in range(np.uintp(first), np.uintp(end)):
            if whole[at.UNSURE, n] != 0:
                exact = barycentric.sample_weights(
                    a, b, c, whole[at.COLUMN, n], whole[at.ROW, n], geometry
                )
                weights[0, n], weights[1, n] = exact[1], exact[2]


@stage
def find_weights(block: Block, count, geometry: Geometry, placement: Placement):
    """
    Write the weights of a block's samples, and whether their faces are back-facing.

    Leaves the pixels of clipped faces and what `weigh_mixed` gathers of the others, for
    `uv_derivatives.find_steps`.
    """
    whole, real, weights = block.whole, block.real, block.weights
    xy, codes, w = geometry.xy, geometry.codes, geometry.w
    bits, reach = geometry.viewport.grid_bits, geometry.viewport.reach
    is_narrow = reach == 0 and not may_be_wide(geometry.viewport)
    for k in range(block.counts[at.SEGMENTS]):
        segment = block.segments[k]
        turn = placement.front_turns[np.int64(segment[at.OWNER])]
        if segment[at.KIND] == at.SPAN:
            unsure = weigh_span(segment, whole, weights, xy, codes, w, bits, reach, turn)
        else:
            unsure = weigh_mixed(
                segment, whole, real, weights, xy, codes, w, bits, reach, is_narrow, turn
            )
        if unsure != 0:
            weigh_unsure(segment, whole, weights, geometry, placement)
