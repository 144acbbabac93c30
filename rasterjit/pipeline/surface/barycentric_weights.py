"""Compute barycentric weights of a block's samples: those of the second and third vertex."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.geometry.setup import (
    CLIPPED,
    GUARD_PIXELS,
    edge,
    get_picture_size,
    narrow_edge,
)
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import get_patch_vertices, round_up_to_vectors
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.intrinsics import part, six_parts, spread, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage

WIDE_EXTENT = 1 << 26
"""Extent of wide faces, sub-pixel units; products of smaller ones are exact in float64."""


@helper
def may_have_wide_faces(viewport):
    """Return whether any face within the guard band may be wide."""
    width, height = get_picture_size(viewport)
    return (max(width, height) + 2 * GUARD_PIXELS) << viewport.grid_bits >= WIDE_EXTENT


@disjoint_helper
def weigh_samples(
    ax, ay, bx, by, cx, cy, wa, wb, wc, xs, ys, count, offset, bits, sample_radius, is_affine,
    front_sign, inexact, backface, second, third,
):  # fmt: skip
    """
    Write the weights of ``count`` samples, each of its own face, and whether this is back-facing.

    ``offset`` is the sample's position in its pixel, sub-pixel units. Returns whether any sample
    needs the exact path: its face was clipped, or its weights may be inaccurate.
    """
    any_inexact = np.int32(0)
    for n in range(ax.shape[0]):
        px = np.int32((xs[n] << bits) + offset[0])
        py = np.int32((ys[n] << bits) + offset[1])
        x0, y0, x1, y1, x2, y2 = ax[n], ay[n], bx[n], by[n], cx[n], cy[n]
        e0, e1, e2 = (
            narrow_edge(x1, y1, x2, y2, px, py), narrow_edge(x2, y2, x0, y0, px, py),
            narrow_edge(x0, y0, x1, y1, px, py),
        )  # fmt: skip
        k0, k1, k2, area = np.float64(e0), np.float64(e1), np.float64(e2), np.float64(e0 + e1 + e2)
        backface[n] = np.int32(area * front_sign < 0.0)
        if sample_radius != 0:
            right, down = (y1 - y2, y2 - y0, y0 - y1), (x2 - x1, x0 - x2, x1 - x0)
            k0, k1, k2 = barycentric.clamp_edges((e0, e1, e2), right, down)
            area = np.float64(k0 + k1 + k2)
        w0, w1, w2 = wa[n], wb[n], wc[n]
        smallest = min(w0, min(w1, w2))
        w0, w1, w2 = k0 * (smallest / w0), k1 * (smallest / w1), k2 * (smallest / w2)
        total, inverse = w0 + w1 + w2, 1.0 / area
        second[n] = k1 * inverse if is_affine else w1 / total
        third[n] = k2 * inverse if is_affine else w2 / total
        is_inexact = inexact[n] | np.int32(not (is_affine or abs(total) > barycentric.UNDERFLOW))
        inexact[n] = is_inexact
        any_inexact |= is_inexact if n < count else np.int32(0)
    return any_inexact


@helper
def narrow_edges(ax, ay, bx, by, cx, cy, column, row, bits, half):
    """Return the edge functions at a pixel of a face that is not wide, in float64: exact."""
    px = np.int32(np.int32(column << bits) + half)
    py = np.int32(np.int32(row << bits) + half)
    x0, y0 = np.float64(np.int32(ax - px)), np.float64(np.int32(ay - py))
    x1, y1 = np.float64(np.int32(bx - px)), np.float64(np.int32(by - py))
    x2, y2 = np.float64(np.int32(cx - px)), np.float64(np.int32(cy - py))
    return x1 * y2 - y1 * x2, x2 * y0 - y2 * x0, x0 * y1 - y0 * x1


@disjoint_helper
def weigh_affine(
    ax, ay, bx, by, cx, cy, xs, ys, bits, front_sign, backface, second, third
):  # fmt: skip
    """Write affine weights of samples on faces that are not wide, as `weigh_samples` does."""
    half = np.int32(np.int32(1) << np.int32(bits - 1))
    for n in range(ax.shape[0]):
        k0, k1, k2 = narrow_edges(
            ax[n], ay[n], bx[n], by[n], cx[n], cy[n], xs[n], ys[n], bits, half
        )
        area = k0 + k1 + k2
        inverse = 1.0 / area
        backface[n] = np.int32(area * front_sign < 0.0)
        second[n], third[n] = k1 * inverse, k2 * inverse


@disjoint_helper
def weigh_perspective(
    ax, ay, bx, by, cx, cy, wa, wb, wc, xs, ys, bits, front_sign, inexact, backface, second, third,
):  # fmt: skip
    """Write perspective-correct weights on faces that are not wide, as `weigh_samples` does."""
    half = np.int32(np.int32(1) << np.int32(bits - 1))
    for n in range(ax.shape[0]):
        k0, k1, k2 = narrow_edges(
            ax[n], ay[n], bx[n], by[n], cx[n], cy[n], xs[n], ys[n], bits, half
        )
        w0, w1, w2 = wa[n], wb[n], wc[n]
        smallest = min(w0, min(w1, w2))
        w0, w1, w2 = k0 * (smallest / w0), k1 * (smallest / w1), k2 * (smallest / w2)
        total = w0 + w1 + w2
        backface[n] = np.int32((k0 + k1 + k2) * front_sign < 0.0)
        second[n], third[n] = w1 / total, w2 / total
        inexact[n] |= np.int32(not abs(total) > barycentric.UNDERFLOW)


@helper
def is_any_inexact(inexact, count):
    """Return not 0 if any of the first ``count`` samples needs the exact path."""
    any_inexact = np.int32(0)
    for n in range(inexact.shape[0]):
        any_inexact |= inexact[n] if np.int32(n) < count else np.int32(0)
    return any_inexact


@helper
def gather_screen(segment, xy, codes, w, ints, doubles):
    """Gather screen positions, clipped flags and w of patches' vertices; w is 1 if affine."""
    is_affine = w.shape[0] == 0
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        n, code = np.uintp(ints[rows.FIRST_SAMPLE, r]), codes[np.uintp(ints[rows.A, r])]
        for k in range(3):
            vertex = np.uintp(ints[rows.A + k, r])
            spread(ints[rows.AX + 2 * k], n, xy[vertex, 0])
            spread(ints[rows.AY + 2 * k], n, xy[vertex, 1])
            spread(doubles[k], n, 1.0 if is_affine else w[vertex])
            code |= codes[vertex]
        spread(ints[rows.INEXACT], n, np.int32(code & CLIPPED))


@helper
def are_all_clipped(segment, ints, codes):
    """Return whether all faces of a segment count as clipped, as those of lines do."""
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        a, b, c = get_patch_vertices(ints, r)
        if (codes[a] | codes[b] | codes[c]) & CLIPPED == 0:
            return False
    return True


@helper
def weigh_mixed(
    segment, ints, doubles, weights, xy, codes, w, bits, sample_radius, is_narrow, front_sign
):
    """
    Write the weights of a mixed segment; return not 0 if any sample needs the exact path.

    ``is_narrow``: samples lie on their faces, none of which is wide.
    """
    s = np.int64(segment[rows.START])
    count = segment[rows.STOP] - s
    e = s + round_up_to_vectors(count)
    if are_all_clipped(segment, ints, codes):
        return np.int32(1)
    gather_screen(segment, xy, codes, w, ints, doubles)
    if is_narrow:
        ax, ay, bx, by, cx, cy, xs, ys = (
            part(ints, rows.AX, s, e), part(ints, rows.AY, s, e), part(ints, rows.BX, s, e),
            part(ints, rows.BY, s, e), part(ints, rows.CX, s, e), part(ints, rows.CY, s, e),
            part(ints, rows.COLUMN, s, e), part(ints, rows.ROW, s, e),
        )  # fmt: skip
        inexact, backface, second, third = (
            part(ints, rows.INEXACT, s, e), part(ints, rows.BACKFACE, s, e), part(weights, 0, s, e),
            part(weights, 1, s, e),
        )  # fmt: skip
        int32_bits = np.int32(bits)
        if w.shape[0] == 0:
            weigh_affine(
                ax, ay, bx, by, cx, cy, xs, ys, int32_bits, front_sign, backface, second, third
            )
        else:
            weigh_perspective(
                ax, ay, bx, by, cx, cy, *three_parts(doubles, 0, s, e), xs, ys, int32_bits,
                front_sign, inexact, backface, second, third,
            )  # fmt: skip
        return is_any_inexact(inexact, np.int32(count))
    half = np.int32(1) << (bits - 1)
    return weigh_samples(
        *six_parts(ints, rows.AX, s, e), *three_parts(doubles, 0, s, e),
        part(ints, rows.COLUMN, s, e), part(ints, rows.ROW, s, e), count, (half, half), bits,
        sample_radius, w.shape[0] == 0, front_sign, part(ints, rows.INEXACT, s, e),
        part(ints, rows.BACKFACE, s, e), part(weights, 0, s, e), part(weights, 1, s, e),
    )  # fmt: skip


@helper
def evaluate_edges(a, b, c, column, row, grid_bits, xy, w):
    """
    Return the edge functions of a face at a pixel, and their steps to the right and down.

    Also returns, for each vertex, the smallest w over the vertex's; 1 if affine.
    """
    ax, ay, bx = np.int64(xy[a, 0]), np.int64(xy[a, 1]), np.int64(xy[b, 0])
    by, cx, cy = np.int64(xy[b, 1]), np.int64(xy[c, 0]), np.int64(xy[c, 1])
    half = np.int64(1) << (grid_bits - 1)
    px, py = (column << grid_bits) + half, (row << grid_bits) + half
    edges = (
        edge(bx, by, cx, cy, px, py), edge(cx, cy, ax, ay, px, py), edge(ax, ay, bx, by, px, py)
    )  # fmt: skip
    right = (by - cy) << grid_bits, (cy - ay) << grid_bits, (ay - by) << grid_bits
    down = (cx - bx) << grid_bits, (ax - cx) << grid_bits, (bx - ax) << grid_bits
    if w.shape[0] == 0:
        return edges, right, down, (1.0, 1.0, 1.0)
    smallest = min(w[a], min(w[b], w[c]))
    return edges, right, down, (smallest / w[a], smallest / w[b], smallest / w[c])


@helper
def are_edges_exact(edges, steps, count):
    """Return whether float64 holds the edge functions along a row exactly."""
    last, max_edge = np.int64(count - 1), np.int64(1 << 52)
    e0, e1, e2 = edges
    ends = abs(e0 + last * steps[0]) | abs(e1 + last * steps[1]) | abs(e2 + last * steps[2])
    return (abs(e0) | abs(e1) | abs(e2) | ends) < max_edge


@disjoint_helper
def weigh_affine_row(second, third, edges, steps):
    """Write affine weights along a row."""
    scale = 1.0 / (edges[0] + edges[1] + edges[2])
    for n in range(second.shape[0]):
        # Exact within the span.
        k = np.float64(np.int32(n))
        second[n], third[n] = (edges[1] + k * steps[1]) * scale, (edges[2] + k * steps[2]) * scale


@disjoint_helper
def weigh_perspective_row(second, third, count, edges, steps, ratios):
    """Write weights along a row; return whether any may be inaccurate."""
    any_inexact = np.int32(0)
    for n in range(second.shape[0]):
        k = np.float64(np.int32(n))
        w0 = (edges[0] + k * steps[0]) * ratios[0]
        w1 = (edges[1] + k * steps[1]) * ratios[1]
        w2 = (edges[2] + k * steps[2]) * ratios[2]
        total = w0 + w1 + w2
        second[n], third[n] = w1 / total, w2 / total
        any_inexact |= np.int32((not abs(total) > barycentric.UNDERFLOW) & (np.int32(n) < count))
    return any_inexact


@disjoint_helper
def fill_backface(backface, is_backface):
    """Write whether the face of a row of samples is back-facing."""
    for n in range(backface.shape[0]):
        backface[n] = is_backface


@helper
def mark_inexact(s, e, column, row, row_start, is_inexact, front_sign, ints):
    """
    Mark the samples of a span that need the exact path: off the face, or all if ``is_inexact``.

    Also writes their pixels and facing. Returns whether any is marked.
    """
    (e0, e1, e2), steps, _, _ = row_start
    is_backface = np.int32(np.float64(e0 + e1 + e2) * front_sign < 0.0)
    face_sign, any_inexact = np.int64(-1) if e0 + e1 + e2 < 0 else np.int64(1), np.int32(0)
    for n in range(np.uintp(s), np.uintp(e)):
        is_outside = min(face_sign * e0, min(face_sign * e1, face_sign * e2)) < 0
        inexact = is_inexact | np.int32(is_outside)
        ints[rows.COLUMN, n], ints[rows.ROW, n], ints[rows.INEXACT, n] = column, row, inexact
        ints[rows.BACKFACE, n] = is_backface
        any_inexact |= inexact
        column += 1
        e0 += steps[0]
        e1 += steps[1]
        e2 += steps[2]
    return any_inexact


@helper
def weigh_span(segment, ints, weights, xy, codes, w, bits, sample_radius, front_sign):
    """Write the weights of a span; return not 0 if any sample needs the exact path."""
    r, s = np.uintp(segment[rows.FIRST_PATCH]), np.int64(segment[rows.START])
    e = np.int64(segment[rows.STOP])
    a, b, c = get_patch_vertices(ints, r)
    column, row = np.int64(segment[rows.SPAN_COLUMN]), np.int64(segment[rows.SPAN_ROW])
    row_start = evaluate_edges(a, b, c, column, row, bits, xy, w)
    edges, steps, _, ratios = row_start
    is_inexact = np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED)
    is_inexact |= np.int32(not are_edges_exact(edges, steps, e - s))
    if is_inexact == 0:
        stop = s + round_up_to_vectors(e - s)
        second, third = part(weights, 0, s, stop), part(weights, 1, s, stop)
        float_edges = np.float64(edges[0]), np.float64(edges[1]), np.float64(edges[2])
        float_steps = np.float64(steps[0]), np.float64(steps[1]), np.float64(steps[2])
        if w.shape[0] == 0:
            weigh_affine_row(second, third, float_edges, float_steps)
        else:
            is_inexact = weigh_perspective_row(
                second, third, np.int32(e - s), float_edges, float_steps, ratios
            )
        area = np.float64(edges[0] + edges[1] + edges[2])
        fill_backface(part(ints, rows.BACKFACE, s, stop), np.int32(area * front_sign < 0.0))
    if is_inexact == 0 and sample_radius == 0:
        return is_inexact
    return mark_inexact(s, e, column, row, row_start, is_inexact, front_sign, ints)


@disjoint_helper
def weigh_clipped_row(second, third, backface, corners, column, row, is_backface, clip, viewport):
    """
    Write weights and facing along a row of one clipped face.

    The weights are those of `compute_sample_weights`, without branches or calls between samples,
    so that the loop vectorizes.
    """
    a, b, c = corners
    if b == c:
        for n in range(second.shape[0]):
            x = column + np.float64(np.int32(n))
            w0, w1, w2 = barycentric.compute_clipped_weights(a, b, c, x, row, clip, viewport)
            _, second[n], third[n] = barycentric.divide_by_sum(w0, w1, w2)
            backface[n] = is_backface
        return
    for n in range(second.shape[0]):
        x = column + np.float64(np.int32(n))
        w0, w1, w2 = barycentric.compute_clipped_face_weights(a, b, c, x, row, clip, viewport)
        _, second[n], third[n] = barycentric.divide_by_sum(w0, w1, w2)
        backface[n] = is_backface


@helper
def recompute_inexact_samples(segment, ints, weights, geometry, placement):
    """Recompute weights and facing of a segment's marked samples by the exact path."""
    owner, codes = np.int64(segment[rows.OWNER]), geometry.codes
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        a, b, c = get_patch_vertices(ints, r)
        first = np.int64(ints[rows.FIRST_SAMPLE, r])
        end = np.int64(ints[rows.FIRST_SAMPLE, r + np.uintp(1)])
        if (codes[a] | codes[b] | codes[c]) & CLIPPED:
            column, row = np.float64(ints[rows.COLUMN, first]), np.int64(ints[rows.ROW, first])
            # Segments and points have no back.
            is_backface = b != c and barycentric.is_plane_back_facing(a, b, c, owner, placement)
            weigh_clipped_row(
                part(weights, 0, first, end), part(weights, 1, first, end),
                part(ints, rows.BACKFACE, first, end), (a, b, c), column, row,
                np.int32(is_backface), geometry.clip_positions, geometry.viewport,
            )  # fmt: skip
            continue
        for n in range(np.uintp(first), np.uintp(end)):
            if ints[rows.INEXACT, n] != 0:
                exact = barycentric.compute_sample_weights(
                    a, b, c, ints[rows.COLUMN, n], ints[rows.ROW, n], geometry
                )
                weights[0, n], weights[1, n] = exact[1], exact[2]


@stage
def find_weights(block: Block, count, geometry: Geometry, placement: Placement):
    """
    Write the weights of a block's samples, and whether their faces are back-facing.

    Leaves what `weigh_mixed` gathers, and the pixels of clipped faces, for
    `uv_derivatives.find_uv_steps`.
    """
    ints, doubles, weights = block.ints, block.doubles, block.weights
    xy, codes, w = geometry.xy, geometry.codes, geometry.w
    bits, sample_radius = geometry.viewport.grid_bits, geometry.viewport.sample_radius
    is_narrow = sample_radius == 0 and not may_have_wide_faces(geometry.viewport)
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        winding = placement.front_windings[np.int64(segment[rows.OWNER])]
        if segment[rows.KIND] == rows.SPAN:
            inexact = weigh_span(segment, ints, weights, xy, codes, w, bits, sample_radius, winding)
        else:
            inexact = weigh_mixed(
                segment, ints, doubles, weights, xy, codes, w, bits, sample_radius, is_narrow,
                winding,
            )  # fmt: skip
        if inexact != 0:
            recompute_inexact_samples(segment, ints, weights, geometry, placement)
