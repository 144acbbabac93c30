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
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface import texture_filters as texturing
from rasterjit.pipeline.surface.barycentric_weights import evaluate_edges
from rasterjit.pipeline.surface.gather_samples import get_patch_vertices, round_up_to_vectors
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.pipeline.surface.texture_filters import FILTER, FIRST_LEVEL, TRILINEAR
from rasterjit.pipeline.surface.texture_lookup import DOWN_U, DOWN_V, RIGHT_U, RIGHT_V, U, V
from rasterjit.runtime.intrinsics import part, six_parts, spread, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int64


@helper
def has_mipmapped_texture(owner, table):
    """Return whether any texture of an object is mipmapped."""
    for kind in range(np.uintp(table.shape[1])):
        if table[owner, kind, FIRST_LEVEL] >= 0 and table[owner, kind, FILTER] == TRILINEAR:
            return True
    return False


@disjoint_helper
def interpolate_span_uv(u, v, owners, second, third, vertex_uvs, owner):
    """Write texture coordinates of samples of one face, and the object."""
    uv_a, uv_b, uv_c = vertex_uvs
    for n in range(u.shape[0]):
        weights = 0.0, second[n], third[n]
        u[n] = interpolate(weights, uv_a[0], uv_b[0], uv_c[0])
        v[n] = interpolate(weights, uv_a[1], uv_b[1], uv_c[1])
        owners[n] = owner


@helper
def add_up_weights(e0, e1, e2, ratios, is_affine):
    """Return the sum of a face's edge functions, each times the smallest w over its own."""
    total = np.float64(e0) * ratios[0] + np.float64(e1) * ratios[1] + np.float64(e2) * ratios[2]
    return np.float64(e0 + e1 + e2) if is_affine else total


@disjoint_helper
def write_span_uv_steps(
    right_u, right_v, down_u, down_v, u, v, vertex_uvs, row_start, bits, spacing, is_affine
):  # fmt: skip
    """Write the steps of neighbouring samples of one face that was not clipped."""
    (e0, e1, e2), (x0, x1, x2), (y0, y1, y2), ratios = row_start
    uv_a, uv_b, uv_c = vertex_uvs
    units_per_step = spacing * np.float64(np.int64(1) << bits)
    right_steps = np.float64(x0 >> bits), np.float64(x1 >> bits), np.float64(x2 >> bits)
    down_steps = np.float64(y0 >> bits), np.float64(y1 >> bits), np.float64(y2 >> bits)
    for n in range(u.shape[0]):
        total = add_up_weights(e0, e1, e2, ratios, is_affine)
        right, down = texturing.differentiate_weights(
            units_per_step / total, ratios, right_steps, down_steps
        )
        uv = u[n], v[n]
        right_u[n], right_v[n] = texturing.differentiate_uv(right, uv, uv_a, uv_b, uv_c)
        down_u[n], down_v[n] = texturing.differentiate_uv(down, uv, uv_a, uv_b, uv_c)
        e0 += x0
        e1 += x1
        e2 += x2


@helper
def write_clipped_uv_step(uv_rows, n, a, b, c, column, row, uv, clip_positions, viewport):
    """Write the steps of one sample of a face that was clipped."""
    right, down = texturing.differentiate_clipped_weights(
        a, b, c, column, row, clip_positions, viewport
    )
    uv_a, uv_b, uv_c = texturing.read_vertex_uvs(uv, a, b, c)
    sample_uv = uv_rows[U, n], uv_rows[V, n]
    uv_rows[RIGHT_U, n], uv_rows[RIGHT_V, n] = texturing.differentiate_uv(
        right, sample_uv, uv_a, uv_b, uv_c
    )
    uv_rows[DOWN_U, n], uv_rows[DOWN_V, n] = texturing.differentiate_uv(
        down, sample_uv, uv_a, uv_b, uv_c
    )


@disjoint_helper
def write_clipped_uv_steps(
    right_u, right_v, down_u, down_v, u, v, corners, vertex_uvs, column, row, clip, viewport
):  # fmt: skip
    """
    Write the steps of neighbouring samples of one clipped face, the first at a pixel.

    Like `write_clipped_uv_step`, without branches or calls between samples, so that it vectorizes.
    """
    a, b, c = corners
    uv_a, uv_b, uv_c = vertex_uvs
    for n in range(u.shape[0]):
        x = column + np.float64(np.int32(n))
        right, down = texturing.differentiate_clipped_weights(a, b, c, x, row, clip, viewport)
        uv = u[n], v[n]
        right_u[n], right_v[n] = texturing.differentiate_uv(right, uv, uv_a, uv_b, uv_c)
        down_u[n], down_v[n] = texturing.differentiate_uv(down, uv, uv_a, uv_b, uv_c)


@disjoint_helper
def interpolate_mixed_uv(u, v, owners, ua, va, ub, vb, uc, vc, second, third, owner):
    """Write texture coordinates of samples, each of a face of its own, and the object."""
    for n in range(u.shape[0]):
        weights = 0.0, second[n], third[n]
        u[n] = interpolate(weights, np.float64(ua[n]), np.float64(ub[n]), np.float64(uc[n]))
        v[n] = interpolate(weights, np.float64(va[n]), np.float64(vb[n]), np.float64(vc[n]))
        owners[n] = owner


@helper
def subtract_int32(a, b):
    """Return the difference of two int32 as float64; the difference fits 32 bits."""
    return np.float64(np.int32(a - b))


@disjoint_helper
def write_mixed_uv_steps(
    right_u, right_v, down_u, down_v, u, v, ua, va, ub, vb, uc, vc, ax, ay, bx, by, cx, cy,
    wa, wb, wc, pixel_columns, pixel_rows, bits, spacing, is_affine,
):  # fmt: skip
    """Write the steps of samples, each of a face of its own that was not clipped."""
    half = np.int32(1) << (bits - 1)
    units_per_step = spacing * np.float64(np.int64(1) << bits)
    for n in range(u.shape[0]):
        px = np.int32((pixel_columns[n] << bits) + half)
        py = np.int32((pixel_rows[n] << bits) + half)
        x0, y0, x1, y1, x2, y2 = ax[n], ay[n], bx[n], by[n], cx[n], cy[n]
        smallest = min(wa[n], min(wb[n], wc[n]))
        ratios = smallest / wa[n], smallest / wb[n], smallest / wc[n]
        total = add_up_weights(
            narrow_edge(x1, y1, x2, y2, px, py), narrow_edge(x2, y2, x0, y0, px, py),
            narrow_edge(x0, y0, x1, y1, px, py), ratios, is_affine,
        )  # fmt: skip
        right, down = texturing.differentiate_weights(
            units_per_step / total,
            ratios,
            (subtract_int32(y1, y2), subtract_int32(y2, y0), subtract_int32(y0, y1)),
            (subtract_int32(x2, x1), subtract_int32(x0, x2), subtract_int32(x1, x0)),
        )
        uv = u[n], v[n]
        uv_a = np.float64(ua[n]), np.float64(va[n])
        uv_b = np.float64(ub[n]), np.float64(vb[n])
        uv_c = np.float64(uc[n]), np.float64(vc[n])
        right_u[n], right_v[n] = texturing.differentiate_uv(right, uv, uv_a, uv_b, uv_c)
        down_u[n], down_v[n] = texturing.differentiate_uv(down, uv, uv_a, uv_b, uv_c)


@helper
def gather_vertex_uv(segment, uv, ints, floats):
    """Gather the texture coordinates of the vertices of some patches."""
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        a, b, c = get_patch_vertices(ints, r)
        n = np.uintp(ints[rows.FIRST_SAMPLE, r])
        spread(floats[0], n, uv[a, 0])
        spread(floats[1], n, uv[a, 1])
        spread(floats[2], n, uv[b, 0])
        spread(floats[3], n, uv[b, 1])
        spread(floats[4], n, uv[c, 0])
        spread(floats[5], n, uv[c, 1])


@helper
def read_span_vertices(segment, ints, uv):
    """Return the vertices of a span's face, and their texture coordinates."""
    a, b, c = get_patch_vertices(ints, np.uintp(segment[rows.FIRST_PATCH]))
    return (a, b, c), texturing.read_vertex_uvs(uv, a, b, c)


@stage
def interpolate_uv(block: Block, count, uv: float32[:, ::1]):
    """
    Write the texture coordinates of each sample, and its object.

    Leaves the coordinates of mixed segments' vertices in ``floats``, for `find_uv_steps`.
    """
    ints, weights, uv_rows, floats = block.ints, block.weights, block.uv_rows, block.floats
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        s, e = np.int64(segment[rows.START]), np.int64(segment[rows.STOP])
        owner = np.float64(segment[rows.OWNER])
        if segment[rows.KIND] == rows.MIXED:
            e = s + round_up_to_vectors(e - s)
            gather_vertex_uv(segment, uv, ints, floats)
            interpolate_mixed_uv(
                *three_parts(uv_rows, U, s, e), *six_parts(floats, 0, s, e), part(weights, 0, s, e),
                part(weights, 1, s, e), owner,
            )  # fmt: skip
        else:
            _, vertex_uvs = read_span_vertices(segment, ints, uv)
            interpolate_span_uv(
                *three_parts(uv_rows, U, s, e), part(weights, 0, s, e), part(weights, 1, s, e),
                vertex_uvs, owner,
            )  # fmt: skip


@helper
def find_mixed_uv_steps(segment, block, viewport, is_affine):
    """Write the steps of the samples of a mixed segment, as if none of its faces was clipped."""
    ints, doubles, floats, uv_rows = block.ints, block.doubles, block.floats, block.uv_rows
    s = np.int64(segment[rows.START])
    e = s + round_up_to_vectors(segment[rows.STOP] - s)
    write_mixed_uv_steps(
        *three_parts(uv_rows, RIGHT_U, s, e), part(uv_rows, DOWN_V, s, e), part(uv_rows, U, s, e),
        part(uv_rows, V, s, e), *six_parts(floats, 0, s, e), *six_parts(ints, rows.AX, s, e),
        *three_parts(doubles, 0, s, e), part(ints, rows.COLUMN, s, e), part(ints, rows.ROW, s, e),
        viewport.grid_bits, viewport.spacing, is_affine,
    )  # fmt: skip


@helper
def find_span_uv_steps(segment, block, uv, viewport, xy, codes, w):
    """Write the steps of the samples of a span, unless its face was clipped."""
    uv_rows, bits = block.uv_rows, viewport.grid_bits
    s, e = np.int64(segment[rows.START]), np.int64(segment[rows.STOP])
    column, row = np.int64(segment[rows.SPAN_COLUMN]), np.int64(segment[rows.SPAN_ROW])
    (a, b, c), vertex_uvs = read_span_vertices(segment, block.ints, uv)
    if (codes[a] | codes[b] | codes[c]) & CLIPPED:
        return
    write_span_uv_steps(
        *three_parts(uv_rows, RIGHT_U, s, e), part(uv_rows, DOWN_V, s, e), part(uv_rows, U, s, e),
        part(uv_rows, V, s, e), vertex_uvs, evaluate_edges(a, b, c, column, row, bits, xy, w), bits,
        viewport.spacing, w.shape[0] == 0,
    )  # fmt: skip


@helper
def find_clipped_uv_steps(segment, ints, uv_rows, uv, codes, clip_positions, viewport):
    """Write the steps of the samples of a segment whose faces were clipped."""
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        a, b, c = get_patch_vertices(ints, r)
        if (codes[a] | codes[b] | codes[c]) & CLIPPED:
            s = np.int64(ints[rows.FIRST_SAMPLE, r])
            e = np.int64(ints[rows.FIRST_SAMPLE, r + np.uintp(1)])
            vertex_uvs = texturing.read_vertex_uvs(uv, a, b, c)
            write_clipped_uv_steps(
                *three_parts(uv_rows, RIGHT_U, s, e), part(uv_rows, DOWN_V, s, e),
                part(uv_rows, U, s, e), part(uv_rows, V, s, e), (a, b, c), vertex_uvs,
                np.float64(ints[rows.COLUMN, s]), np.int64(ints[rows.ROW, s]),
                clip_positions, viewport,
            )  # fmt: skip


@stage
def find_uv_steps(
    block: Block, count, uv: float32[:, ::1], table: int64[:, :, ::1], geometry: Geometry
):
    """
    Write the texture coordinates' differences to the next sample right and down, for mip levels.

    The next sample lies ``viewport.spacing`` pixels away. Only for objects with mipmapped textures.
    After `interpolate_uv`, while ``floats``, ``doubles`` and ``ints`` hold what that stage and
    `find_weights` have gathered.
    """
    xy, codes, w, clip_positions = geometry.xy, geometry.codes, geometry.w, geometry.clip_positions
    viewport = geometry.viewport
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        if not has_mipmapped_texture(np.int64(segment[rows.OWNER]), table):
            continue
        if segment[rows.KIND] == rows.MIXED:
            find_mixed_uv_steps(segment, block, viewport, w.shape[0] == 0)
        else:
            find_span_uv_steps(segment, block, uv, viewport, xy, codes, w)
        if clip_positions.shape[0] != 0:
            find_clipped_uv_steps(
                segment, block.ints, block.uv_rows, uv, codes, clip_positions, viewport
            )
