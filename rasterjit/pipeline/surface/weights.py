"""Find where on its face each sample lies: the weights of the second and the third vertex."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import (
    held_edges,
    ratios_at,
    sample_weights,
    seen_from_behind,
    weights_along_run,
    weights_from_edges,
)
from rasterjit.pipeline.geometry.setup import CLIPPED, edge, narrow_edge
from rasterjit.pipeline.records import Geometry, Placement, Viewport
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
from rasterjit.runtime.intrinsics import spread
from rasterjit.runtime.jit import disjoint_helper, helper, stage


@disjoint_helper
def weigh(
    ax, ay, bx, by, cx, cy, wa, wb, wc, columns, rows, count, bits, reach, w, unsure, second, third
):  # fmt: skip
    """
    Write the weights of ``count`` samples, each of a face of its own.

    Return whether any of them takes another way: its face was clipped, or its weights are doubtful.
    """
    half, found = np.int32(1) << (bits - 1), np.int32(0)
    for n in range(ax.shape[0]):
        px = np.int32((columns[n] << bits) + half)
        py = np.int32((rows[n] << bits) + half)
        edges = (
            narrow_edge(bx[n], by[n], cx[n], cy[n], px, py),
            narrow_edge(cx[n], cy[n], ax[n], ay[n], px, py),
            narrow_edge(ax[n], ay[n], bx[n], by[n], px, py),
        )
        right = by[n] - cy[n], cy[n] - ay[n], ay[n] - by[n]
        down = cx[n] - bx[n], ax[n] - cx[n], bx[n] - ax[n]
        edges = held_edges(edges, right, down, reach)
        ratios = ratios_at(wa, wb, wc, n, w)
        second[n], third[n], doubtful = weights_from_edges(*edges, ratios, w)
        unsure[n] |= np.int32(doubtful)
        found |= unsure[n] if n < count else np.int32(0)
    return found


@disjoint_helper
def find_sides(ax, ay, bx, by, cx, cy, front_turn, behind):
    """Write whether the back of each face is seen, by its turn on the screen."""
    for n in range(ax.shape[0]):
        turn = narrow_edge(ax[n], ay[n], bx[n], by[n], cx[n], cy[n])
        behind[n] = np.int32(np.float64(turn) * front_turn < 0.0)


@helper
def gather_w(first, end, w, whole, real):
    """Gather w of the vertices of patches; nothing where interpolation is affine."""
    if w is None:
        return
    for r in range(np.uintp(first), np.uintp(end)):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        n = np.uintp(whole[FIRST, r])
        spread(real[0], n, w[a])
        spread(real[1], n, w[b])
        spread(real[2], n, w[c])


@helper
def gather_screen(first, end, geometry, whole, real):
    """Gather where the vertices of patches lie on the screen, their w, and what was clipped."""
    xy, codes = geometry.xy, geometry.codes
    for r in range(np.uintp(first), np.uintp(end)):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        n = np.uintp(whole[FIRST, r])
        spread(whole[AX], n, xy[a, 0])
        spread(whole[AY], n, xy[a, 1])
        spread(whole[BX], n, xy[b, 0])
        spread(whole[BY], n, xy[b, 1])
        spread(whole[CX], n, xy[c, 0])
        spread(whole[CY], n, xy[c, 1])
        spread(whole[UNSURE], n, np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED))
    gather_w(first, end, geometry.w, whole, real)


@helper
def weigh_mixed(segment, whole, real, weights, geometry, placement):
    """Write the weights of the samples of a mixed segment, and which side of a face is seen."""
    first, end, owner = segment[FIRST_PATCH], segment[END_PATCH], np.int64(segment[OWNER])
    s = np.int64(segment[START])
    count = segment[STOP] - s
    e = s + whole_vectors(count)
    gather_screen(first, end, geometry, whole, real)
    unsure = weigh(
        whole[AX, s:e], whole[AY, s:e], whole[BX, s:e], whole[BY, s:e], whole[CX, s:e],
        whole[CY, s:e], real[0, s:e], real[1, s:e], real[2, s:e], whole[COLUMN, s:e],
        whole[ROW, s:e], count, geometry.viewport.grid_bits, geometry.viewport.reach, geometry.w,
        whole[UNSURE, s:e], weights[0, s:e], weights[1, s:e],
    )  # fmt: skip
    find_sides(
        whole[AX, s:e], whole[AY, s:e], whole[BX, s:e], whole[BY, s:e], whole[CX, s:e],
        whole[CY, s:e], placement.front_turns[owner], whole[BEHIND, s:e],
    )  # fmt: skip
    if unsure != 0:
        for r in range(np.uintp(first), np.uintp(end)):
            a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
            for i in range(whole[FIRST, r], whole[FIRST, r + np.uintp(1)]):
                if whole[UNSURE, i] != 0:
                    exact = sample_weights(a, b, c, whole[COLUMN, i], whole[ROW, i], geometry)
                    weights[0, i], weights[1, i] = exact[1], exact[2]
                    whole[BEHIND, i] = seen_from_behind(a, b, c, owner, geometry, placement)


@helper
def edge_start(ax, ay, bx, by, column, row, bits):
    """Return the edge function of a -> b at a pixel, and its gains to the right and down."""
    half = np.int64(1) << (bits - 1)
    across, down = (ay - by) << bits, (bx - ax) << bits
    return edge(ax, ay, bx, by, half, half) + column * across + row * down, across, down


@helper
def ratios_of(a, b, c, w):
    """Return the smallest w of a face over each; 1 without w."""
    if w is None:
        return 1.0, 1.0, 1.0
    smallest = min(w[a], min(w[b], w[c]))
    return smallest / w[a], smallest / w[b], smallest / w[c]


@helper
def span_start(a, b, c, column, row, geometry):
    """Return what `interpolation.weights_along_row` takes, from a pixel on."""
    xy, bits = geometry.xy, geometry.viewport.grid_bits
    ax, ay = np.int64(xy[a, 0]), np.int64(xy[a, 1])
    bx, by = np.int64(xy[b, 0]), np.int64(xy[b, 1])
    cx, cy = np.int64(xy[c, 0]), np.int64(xy[c, 1])
    e0, right0, down0 = edge_start(bx, by, cx, cy, column, row, bits)
    e1, right1, down1 = edge_start(cx, cy, ax, ay, column, row, bits)
    e2, right2, down2 = edge_start(ax, ay, bx, by, column, row, bits)
    ratios = ratios_of(a, b, c, geometry.w)
    return (e0, e1, e2), (right0, right1, right2), (down0, down1, down2), ratios


@helper
def weigh_span(segment, whole, weights, geometry, placement):
    """Write the weights of the samples of a span, and which side of its face is seen."""
    r, owner = np.uintp(segment[FIRST_PATCH]), np.int64(segment[OWNER])
    a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
    s, e = np.int64(segment[START]), np.int64(segment[STOP])
    column, row = np.int64(segment[COLUMN_OF]), np.int64(segment[ROW_OF])
    codes = geometry.codes
    doubtful = np.int64((codes[a] | codes[b] | codes[c]) & CLIPPED)
    if doubtful == 0:
        doubtful = weights_along_run(
            weights[0, s:e], weights[1, s:e], span_start(a, b, c, column, row, geometry),
            geometry.viewport.reach, geometry.w,
        )  # fmt: skip
    if doubtful != 0:
        for i in range(e - s):
            exact = sample_weights(a, b, c, column + i, row, geometry)
            weights[0, s + i], weights[1, s + i] = exact[1], exact[2]
    behind = np.int32(seen_from_behind(a, b, c, owner, geometry, placement))
    for n in range(np.uintp(s), np.uintp(e)):
        whole[BEHIND, n] = behind


@helper
def weigh_block(block, geometry, placement):
    """Write the weights of the samples of a block, and which side of each face is seen."""
    whole, weights, real = block.whole, block.weights, block.real
    for k in range(block.counts[SEGMENTS]):
        segment = block.segments[k]
        if segment[KIND] == SPAN:
            weigh_span(segment, whole, weights, geometry, placement)
        else:
            weigh_mixed(segment, whole, real, weights, geometry, placement)


@helper
def centred(geometry):
    """Return a geometry whose pixels have one sample each."""
    v = geometry.viewport
    viewport = Viewport(
        v.width, v.height, v.guard_x, v.guard_y, v.subpixel_bits, v.grid_bits, None, v.left, v.top,
        v.right, v.bottom,
    )  # fmt: skip
    g = geometry
    return Geometry(g.faces, g.xy, g.codes, g.w, g.clip_positions, viewport)


@helper
def affine(geometry):
    """Return a geometry that is interpolated on the screen."""
    g = geometry
    return Geometry(g.faces, g.xy, g.codes, None, g.clip_positions, g.viewport)


@stage
def weigh_centres(block: Block, count, geometry: Geometry, placement: Placement):
    """Find the weights of samples at the centres of pixels, perspective-correct."""
    weigh_block(block, centred(geometry), placement)


@stage
def weigh_near(block: Block, count, geometry: Geometry, placement: Placement):
    """Find the weights of pixels whose samples may lie beside the centre, perspective-correct."""
    weigh_block(block, geometry, placement)


@stage
def weigh_centres_affine(block: Block, count, geometry: Geometry, placement: Placement):
    """Find the weights of samples at the centres of pixels, linear on the screen."""
    weigh_block(block, affine(centred(geometry)), placement)


@stage
def weigh_near_affine(block: Block, count, geometry: Geometry, placement: Placement):
    """Find the weights of pixels whose samples may lie beside the centre, linear on the screen."""
    weigh_block(block, affine(geometry), placement)
