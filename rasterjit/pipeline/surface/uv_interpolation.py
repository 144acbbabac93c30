"""
Interpolate texture coordinates straight from edge functions, in float64.

Used where nothing else reads weights, in place of `barycentric_weights` and `uv_derivatives`. Edge
functions are integers, exact in float64 here, and of one sign on a face that a sample lies on, as w
is. The weights

    b_k = e_k w_i w_j / (e_0 w_1 w_2 + e_1 w_2 w_0 + e_2 w_0 w_1)

are quotients of sums without cancellation, off by some 2**-52 of themselves, for one division a
sample. That moves coordinates by far less than the step that positions on a texture are rounded
to. Edge functions of clipped faces are not known, and those of some others may leave what float64
holds: samples on such faces take weights from `barycentric`.

Patches are processed one by one, even short ones: unused vector lanes cost nothing, while gathering
would write vertices for each sample. Coordinates depend on a sample's face and pixel alone.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.geometry.setup import CLIPPED
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.barycentric_weights import may_have_wide_faces
from rasterjit.pipeline.surface.float32_colors import evaluate_edges_along_row
from rasterjit.pipeline.surface.float32_weights import is_wide
from rasterjit.pipeline.surface.gather_samples import get_patch_vertices, get_pixel
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.pipeline.surface.texture_filters import read_vertex_uvs
from rasterjit.pipeline.surface.texture_lookup import UV_OWNER, U, V
from rasterjit.runtime.intrinsics import interpolate_uv_run, part
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32

MIN_W_PRODUCT, MAX_W_PRODUCT = 2.0**-900, 2.0**900
"""Products of w between these keep sums of weights far from where float64 loses bits."""


@helper
def multiply_other_ws(a, b, c, w):
    """Return for each vertex the product of the other two vertices' w, 1 if affine."""
    if w.shape[0] == 0:
        return 1.0, 1.0, 1.0
    return w[b] * w[c], w[c] * w[a], w[a] * w[b]


@helper
def are_sums_accurate(factors):
    """Return whether float64 sums of edge functions times the factors are accurate on the face."""
    least = min(factors[0], min(factors[1], factors[2]))
    largest = max(factors[0], max(factors[1], factors[2]))
    return (least > MIN_W_PRODUCT) & (largest < MAX_W_PRODUCT)


@helper
def interpolate_uv_exactly(u, v, count, corners, vertex_uvs, column, row, geometry):
    """
    Write texture coordinates of neighbouring samples of a face, the first at a pixel.

    Takes the parts of two rows that hold them.
    """
    for n in range(np.uintp(count)):
        weights = barycentric.compute_sample_weights(
            corners[0], corners[1], corners[2], column + np.int64(n), row, geometry
        )
        u[n] = barycentric.interpolate(
            weights, vertex_uvs[0][0], vertex_uvs[1][0], vertex_uvs[2][0]
        )
        v[n] = barycentric.interpolate(
            weights, vertex_uvs[0][1], vertex_uvs[1][1], vertex_uvs[2][1]
        )


@disjoint_helper
def interpolate_clipped_uv(u, v, corners, vertex_uvs, column, row, clip, viewport):
    """
    Write texture coordinates on a clipped face, with the bits of `interpolate_uv_exactly`.

    Takes the parts of rows U and V that hold the samples. The loop has no branch for faces that
    were not clipped, so that it vectorizes.
    """
    a, b, c = corners
    uv_a, uv_b, uv_c = vertex_uvs
    for n in range(u.shape[0]):
        w0, w1, w2 = barycentric.compute_clipped_face_weights(
            a, b, c, column + np.int64(n), row, clip, viewport
        )
        weights = barycentric.divide_by_sum(w0, w1, w2)
        u[n] = barycentric.interpolate(weights, uv_a[0], uv_b[0], uv_c[0])
        v[n] = barycentric.interpolate(weights, uv_a[1], uv_b[1], uv_c[1])


@helper
def interpolate_patch_uv(first, end, corners, column, row, has_wide, uv_rows, uv, geometry):
    """Write texture coordinates of the samples of a patch, the first at a pixel."""
    codes, xy, w, bits = geometry.codes, geometry.xy, geometry.w, geometry.viewport.grid_bits
    a, b, c = corners
    uv_a, uv_b, uv_c = read_vertex_uvs(uv, a, b, c)
    factors = multiply_other_ws(a, b, c, w)
    is_clipped = np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED) != 0
    u, v = part(uv_rows, U, first, end), part(uv_rows, V, first, end)
    if is_clipped:
        interpolate_clipped_uv(
            u, v, corners, (uv_a, uv_b, uv_c), column, row, geometry.clip_positions,
            geometry.viewport,
        )  # fmt: skip
        return
    if (has_wide and is_wide(a, b, c, xy)) or not are_sums_accurate(factors):
        interpolate_uv_exactly(
            u, v, end - first, corners, (uv_a, uv_b, uv_c), column, row, geometry
        )
        return
    edges, steps = evaluate_edges_along_row(a, b, c, column, row, bits, xy)
    stop = end + rows.MAX_VECTOR_SAMPLES
    interpolate_uv_run(
        part(uv_rows, U, first, stop), part(uv_rows, V, first, stop), end - first, edges, steps,
        factors, uv_a, (uv_b[0] - uv_a[0], uv_b[1] - uv_a[1], uv_c[0] - uv_a[0], uv_c[1] - uv_a[1]),
    )  # fmt: skip


@stage
def interpolate_uv_from_edges(block: Block, count, uv: float32[:, ::1], geometry: Geometry):
    """
    Write the texture coordinates of each sample, which lies on its face, and its object.

    In place of weights and `uv_derivatives.interpolate_uv`, where nothing else reads weights.
    """
    ints, uv_rows, has_wide = block.ints, block.uv_rows, may_have_wide_faces(geometry.viewport)
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
            first = np.int64(ints[rows.FIRST_SAMPLE, r])
            end = np.int64(ints[rows.FIRST_SAMPLE, r + np.uintp(1)])
            corners = get_patch_vertices(ints, r)
            column, row = get_pixel(first, segment, ints)
            interpolate_patch_uv(first, end, corners, column, row, has_wide, uv_rows, uv, geometry)
        owner = np.float64(segment[rows.OWNER])
        for n in range(np.uintp(segment[rows.START]), np.uintp(segment[rows.STOP])):
            uv_rows[UV_OWNER, n] = owner
