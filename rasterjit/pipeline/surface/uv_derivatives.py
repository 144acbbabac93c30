"""
Compute texture coordinates of samples, and their screen-space derivatives ("steps").

In a span they follow from the face's edge functions, in a mixed segment from the vertex data
gathered for each sample. The formulas are those of ``texture_filters``, and give the same bits.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import interpolate
from rasterjit.pipeline.geometry.setup import CLIPPED, narrow_edge
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.surface import sample_block
from rasterjit.pipeline.surface import texture_filters as texturing
from rasterjit.pipeline.surface.barycentric_weights import span_start
from rasterjit.pipeline.surface.gather_samples import whole_vectors
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.pipeline.surface.texture_filters import FILTER, FIRST_LEVEL, TRILINEAR
from rasterjit.pipeline.surface.texture_lookup import DOWN_U, DOWN_V, RIGHT_U, RIGHT_V, U, V
from rasterjit.runtime.intrinsics import part, six_parts, spread, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int64


@helper
def wants_steps(owner, table):
    """Return whether any texture of an object is mipmapped."""
    for kind in range(np.uintp(table.shape[1])):
        if table[owner, kind, FIRST_LEVEL] >= 0 and table[owner, kind, FILTER] == TRILINEAR:
            return True
    return False


@disjoint_helper
def fill_places(u, v, owners, second, third, ends, owner):
    """Write the coordinates of samples of one face, given those of its vertices, and the object."""
    pa, pb, pc = ends
    for n in range(u.shape[0]):
        weights = 0.0, second[n], third[n]
        u[n] = interpolate(weights, pa[0], pb[0], pc[0])
        v[n] = interpolate(weights, pa[1], pb[1], pc[1])
        owners[n] = owner


@helper
def sum_of_weights(e0, e1, e2, ratios, is_affine):
    """Return the sum of a face's edge functions, each times the smallest w over its own."""
    total = np.float64(e0) * ratios[0] + np.float64(e1) * ratios[1] + np.float64(e2) * ratios[2]
    return np.float64(e0 + e1 + e2) if is_affine else total


@disjoint_helper
def fill_steps(
    right_u, right_v, down_u, down_v, u, v, ends, row_start, bits, spacing, is_affine
):  # fmt: skip
    """Write the steps of neighbouring samples of one face that was not clipped."""
    (e0, e1, e2), (x0, x1, x2), downs, ratios = row_start
    unit = spacing * np.float64(np.int64(1) << bits)
    across = np.float64(x0 >> bits), np.float64(x1 >> bits), np.float64(x2 >> bits)
    fall = np.float64(downs[0] >> bits), np.float64(downs[1] >> bits), np.float64(downs[2] >> bits)
    for n in range(u.shape[0]):
        total = sum_of_weights(e0, e1, e2, ratios, is_affine)
        right, down = texturing.scaled_slopes(unit / total, ratios, across, fall)
        place = u[n], v[n]
        right_u[n], right_v[n] = texturing.place_step(right, place, ends[0], ends[1], ends[2])
        down_u[n], down_v[n] = texturing.place_step(down, place, ends[0], ends[1], ends[2])
        e0 += x0
        e1 += x1
        e2 += x2


@helper
def note_clipped_steps(places, n, a, b, c, column, row, uv, clip_positions, viewport):
    """Write the steps of one sample of a face that was clipped."""
    right, down = texturing.clipped_slopes(a, b, c, column, row, clip_positions, viewport)
    pa, pb, pc = (
        texturing.vertex_place(uv, a), texturing.vertex_place(uv, b), texturing.vertex_place(uv, c)
    )  # fmt: skip
    place = places[U, n], places[V, n]
    places[RIGHT_U, n], places[RIGHT_V, n] = texturing.place_step(right, place, pa, pb, pc)
    places[DOWN_U, n], places[DOWN_V, n] = texturing.place_step(down, place, pa, pb, pc)


@disjoint_helper
def fill_clipped_steps(
    right_u, right_v, down_u, down_v, u, v, corners, ends, column, row, clip, viewport
):  # fmt: skip
    """
    Write the steps of neighbouring samples of one face that was clipped, the first at a pixel.

    Those of `note_clipped_steps`, without branches or calls between samples, so that it vectorizes.
    """
    a, b, c = corners
    for n in range(u.shape[0]):
        here = column + np.float64(np.int32(n))
        right, down = texturing.clipped_slopes(a, b, c, here, row, clip, viewport)
        place = u[n], v[n]
        right_u[n], right_v[n] = texturing.place_step(right, place, ends[0], ends[1], ends[2])
        down_u[n], down_v[n] = texturing.place_step(down, place, ends[0], ends[1], ends[2])


@disjoint_helper
def mix_places(u, v, owners, ua, va, ub, vb, uc, vc, second, third, owner):
    """Write the coordinates of samples, each of a face of its own, and the object."""
    for n in range(u.shape[0]):
        weights = 0.0, second[n], third[n]
        u[n] = interpolate(weights, np.float64(ua[n]), np.float64(ub[n]), np.float64(uc[n]))
        v[n] = interpolate(weights, np.float64(va[n]), np.float64(vb[n]), np.float64(vc[n]))
        owners[n] = owner


@helper
def float_difference(one, other):
    """Return the difference of two int32 as float64; it fits 32 bits."""
    return np.float64(np.int32(one - other))


@disjoint_helper
def mix_steps(
    right_u, right_v, down_u, down_v, u, v, ua, va, ub, vb, uc, vc, ax, ay, bx, by, cx, cy,
    wa, wb, wc, columns, rows, bits, spacing, is_affine,
):  # fmt: skip
    """Write the steps of samples, each of a face of its own that was not clipped."""
    half = np.int32(1) << (bits - 1)
    unit = spacing * np.float64(np.int64(1) << bits)
    for n in range(u.shape[0]):
        px = np.int32((columns[n] << bits) + half)
        py = np.int32((rows[n] << bits) + half)
        x0, y0, x1, y1, x2, y2 = ax[n], ay[n], bx[n], by[n], cx[n], cy[n]
        smallest = min(wa[n], min(wb[n], wc[n]))
        ratios = smallest / wa[n], smallest / wb[n], smallest / wc[n]
        total = sum_of_weights(
            narrow_edge(x1, y1, x2, y2, px, py), narrow_edge(x2, y2, x0, y0, px, py),
            narrow_edge(x0, y0, x1, y1, px, py), ratios, is_affine,
        )  # fmt: skip
        right, down = texturing.scaled_slopes(
            unit / total,
            ratios,
            (float_difference(y1, y2), float_difference(y2, y0), float_difference(y0, y1)),
            (float_difference(x2, x1), float_difference(x0, x2), float_difference(x1, x0)),
        )
        place = u[n], v[n]
        pa = np.float64(ua[n]), np.float64(va[n])
        pb = np.float64(ub[n]), np.float64(vb[n])
        pc = np.float64(uc[n]), np.float64(vc[n])
        right_u[n], right_v[n] = texturing.place_step(right, place, pa, pb, pc)
        down_u[n], down_v[n] = texturing.place_step(down, place, pa, pb, pc)


# The stages


@helper
def gather_vertex_places(first, end, uv, whole, single):
    """Gather the texture coordinates of the vertices of some patches."""
    for r in range(np.uintp(first), np.uintp(end)):
        a, b, c = (
            np.uintp(whole[sample_block.A, r]), np.uintp(whole[sample_block.B, r]),
            np.uintp(whole[sample_block.C, r]),
        )  # fmt: skip
        n = np.uintp(whole[sample_block.FIRST, r])
        spread(single[0], n, uv[a, 0])
        spread(single[1], n, uv[a, 1])
        spread(single[2], n, uv[b, 0])
        spread(single[3], n, uv[b, 1])
        spread(single[4], n, uv[c, 0])
        spread(single[5], n, uv[c, 1])


@helper
def span_places(segment, whole, uv):
    """Return the vertices of a span's face, and their texture coordinates."""
    r = np.uintp(segment[sample_block.FIRST_PATCH])
    a, b, c = (
        np.uintp(whole[sample_block.A, r]), np.uintp(whole[sample_block.B, r]),
        np.uintp(whole[sample_block.C, r])
    )  # fmt: skip
    ends = (
        texturing.vertex_place(uv, a), texturing.vertex_place(uv, b), texturing.vertex_place(uv, c)
    )  # fmt: skip
    return (a, b, c), ends


@stage
def find_coordinates(block: Block, count, uv: float32[:, ::1]):
    """
    Write the texture coordinates of each sample, and its object.

    Leaves those of the vertices of mixed segments in ``floats``, for `find_steps`.
    """
    whole, weights, places, single = block.ints, block.weights, block.places, block.floats
    for k in range(block.counts[sample_block.SEGMENTS]):
        segment = block.segments[k]
        s, e = np.int64(segment[sample_block.START]), np.int64(segment[sample_block.STOP])
        owner = np.float64(segment[sample_block.OWNER])
        if segment[sample_block.KIND] == sample_block.MIXED:
            e = s + whole_vectors(e - s)
            gather_vertex_places(
                segment[sample_block.FIRST_PATCH],
                segment[sample_block.END_PATCH],
                uv,
                whole,
                single,
            )
            mix_places(
                *three_parts(places, U, s, e), *six_parts(single, 0, s, e), part(weights, 0, s, e),
                part(weights, 1, s, e), owner,
            )  # fmt: skip
        else:
            _, ends = span_places(segment, whole, uv)
            fill_places(
                *three_parts(places, U, s, e), part(weights, 0, s, e), part(weights, 1, s, e), ends,
                owner,
            )  # fmt: skip


@helper
def find_steps_of_mixed(segment, block, viewport, is_affine):
    """Write the steps of the samples of a mixed segment, as if none of its faces was clipped."""
    whole, real, single, places = block.ints, block.doubles, block.floats, block.places
    s = np.int64(segment[sample_block.START])
    e = s + whole_vectors(segment[sample_block.STOP] - s)
    mix_steps(
        *three_parts(places, RIGHT_U, s, e), part(places, DOWN_V, s, e), part(places, U, s, e),
        part(places, V, s, e), *six_parts(single, 0, s, e),
        *six_parts(whole, sample_block.AX, s, e),
        *three_parts(real, 0, s, e), part(whole, sample_block.COLUMN, s, e),
        part(whole, sample_block.ROW, s, e), viewport.grid_bits, viewport.spacing, is_affine,
    )  # fmt: skip


@helper
def find_steps_of_span(segment, block, uv, viewport, xy, codes, w):
    """Write the steps of the samples of a span, unless its face was clipped."""
    places, bits = block.places, viewport.grid_bits
    s, e = np.int64(segment[sample_block.START]), np.int64(segment[sample_block.STOP])
    column, row = np.int64(segment[sample_block.COLUMN_OF]), np.int64(segment[sample_block.ROW_OF])
    (a, b, c), ends = span_places(segment, block.ints, uv)
    if (codes[a] | codes[b] | codes[c]) & CLIPPED:
        return
    fill_steps(
        *three_parts(places, RIGHT_U, s, e), part(places, DOWN_V, s, e), part(places, U, s, e),
        part(places, V, s, e), ends, span_start(a, b, c, column, row, bits, xy, w), bits,
        viewport.spacing, w.shape[0] == 0,
    )  # fmt: skip


@helper
def find_steps_of_clipped(segment, whole, places, uv, codes, clip_positions, viewport):
    """Write the steps of the samples of a segment whose faces were clipped."""
    for r in range(
        np.uintp(segment[sample_block.FIRST_PATCH]), np.uintp(segment[sample_block.END_PATCH])
    ):
        a, b, c = (
            np.uintp(whole[sample_block.A, r]), np.uintp(whole[sample_block.B, r]),
            np.uintp(whole[sample_block.C, r]),
        )  # fmt: skip
        if (codes[a] | codes[b] | codes[c]) & CLIPPED:
            s, e = (
                np.int64(whole[sample_block.FIRST, r]),
                np.int64(whole[sample_block.FIRST, r + np.uintp(1)]),
            )
            ends = (
                texturing.vertex_place(uv, a), texturing.vertex_place(uv, b),
                texturing.vertex_place(uv, c),
            )  # fmt: skip
            fill_clipped_steps(
                *three_parts(places, RIGHT_U, s, e), part(places, DOWN_V, s, e),
                part(places, U, s, e), part(places, V, s, e), (a, b, c), ends,
                np.float64(whole[sample_block.COLUMN, s]), np.int64(whole[sample_block.ROW, s]),
                clip_positions, viewport,
            )  # fmt: skip


@stage
def find_steps(
    block: Block, count, uv: float32[:, ::1], table: int64[:, :, ::1], geometry: Geometry
):
    """
    Write the texture coordinates' differences to the next sample right and down, for mip levels.

    These lie ``viewport.spacing`` pixels away. Only for objects with mipmapped textures.
    After `find_coordinates`, as long as ``floats``, ``doubles`` and ``ints`` hold what that and the
    weights have gathered.
    """
    xy, codes, w, clip_positions = geometry.xy, geometry.codes, geometry.w, geometry.clip_positions
    viewport = geometry.viewport
    for k in range(block.counts[sample_block.SEGMENTS]):
        segment = block.segments[k]
        if not wants_steps(np.int64(segment[sample_block.OWNER]), table):
            continue
        if segment[sample_block.KIND] == sample_block.MIXED:
            find_steps_of_mixed(segment, block, viewport, w.shape[0] == 0)
        else:
            find_steps_of_span(segment, block, uv, viewport, xy, codes, w)
        if clip_positions.shape[0] != 0:
            find_steps_of_clipped(
                segment, block.ints, block.places, uv, codes, clip_positions, viewport
            )
