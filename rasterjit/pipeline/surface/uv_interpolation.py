"""
Interpolate texture coordinates straight from edge functions, in float64.

Used where nothing else reads weights, in place of `weights` and `texture_gradients`. Edge functions
are integers, exact in float64 here, and of one sign on a face that a sample lies on, as w is. The
weights

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
from rasterjit.pipeline.surface.barycentric_weights import may_be_wide
from rasterjit.pipeline.surface.float32_colors import edges_along_row
from rasterjit.pipeline.surface.float32_weights import is_wide
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.pipeline.surface.texture_filters import vertex_place
from rasterjit.pipeline.surface.texture_lookup import OWNER as OWNERS
from rasterjit.pipeline.surface.texture_lookup import U, V
from rasterjit.runtime.intrinsics import part, place_run
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32

MIN_FACTOR, MAX_FACTOR = 2.0**-900, 2.0**900
"""Products of w between these keep sums of weights far from where float64 loses bits."""


@helper
def factors_of(a, b, c, w):
    """Return the products of w that a face's edge functions are multiplied by, one per vertex."""
    if w.shape[0] == 0:
        return 1.0, 1.0, 1.0
    return w[b] * w[c], w[c] * w[a], w[a] * w[b]


@helper
def are_accurate(factors):
    """Return whether sums of edge functions times the factors are accurate on the face."""
    least = min(factors[0], min(factors[1], factors[2]))
    largest = max(factors[0], max(factors[1], factors[2]))
    return (least > MIN_FACTOR) & (largest < MAX_FACTOR)


@helper
def place_exactly(first, end, corners, ends, column, row, places, geometry):
    """Write the coordinates of some samples of a face, the first of which is at a pixel."""
    for n in range(np.uintp(first), np.uintp(end)):
        exact = barycentric.sample_weights(
            corners[0], corners[1], corners[2], column + np.int64(n) - first, row, geometry
        )
        places[U, n] = barycentric.interpolate(exact, ends[0][0], ends[1][0], ends[2][0])
        places[V, n] = barycentric.interpolate(exact, ends[0][1], ends[1][1], ends[2][1])


@disjoint_helper
def place_clipped(u, v, corners, ends, column, row, clip, viewport):
    """
    Write the coordinates of some samples of a clipped face, with the bits of `place_exactly`.

    Takes the parts of rows U and V that hold these samples. The loop has no branch for faces that
    were not clipped, so that it vectorizes.
    """
    a, b, c = corners
    pa, pb, pc = ends
    for n in range(u.shape[0]):
        w0, w1, w2 = barycentric.clipped_face_weights(
            a, b, c, column + np.int64(n), row, clip, viewport
        )
        weights = barycentric.normalized(w0, w1, w2)
        u[n] = barycentric.interpolate(weights, pa[0], pb[0], pc[0])
        v[n] = barycentric.interpolate(weights, pa[1], pb[1], pc[1])


@helper
def place_patch(first, end, corners, column, row, has_wide, places, uv, geometry):
    """Write the coordinates of the samples of a patch, the first of which is at a pixel."""
    codes, xy, w, bits = geometry.codes, geometry.xy, geometry.w, geometry.viewport.grid_bits
    a, b, c = corners
    pa, pb, pc = vertex_place(uv, a), vertex_place(uv, b), vertex_place(uv, c)
    factors = factors_of(a, b, c, w)
    is_clipped = np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED) != 0
    if is_clipped:
        place_clipped(
            part(places, U, first, end), part(places, V, first, end), corners, (pa, pb, pc), column,
            row, geometry.clip_positions, geometry.viewport,
        )  # fmt: skip
        return
    if (has_wide and is_wide(a, b, c, xy)) or not are_accurate(factors):
        place_exactly(first, end, corners, (pa, pb, pc), column, row, places, geometry)
        return
    edges, steps = edges_along_row(a, b, c, column, row, bits, xy)
    stop = end + rows.VECTOR
    place_run(
        part(places, U, first, stop), part(places, V, first, stop), end - first,
        edges, steps, factors, pa,
        (pb[0] - pa[0], pb[1] - pa[1], pc[0] - pa[0], pc[1] - pa[1]),
    )  # fmt: skip


@stage
def find_places(block: Block, count, uv: float32[:, ::1], geometry: Geometry):
    """
    Write the texture coordinates of each sample, which lies on its face, and its object.

    Instead of weights and `uv_derivatives.find_coordinates`, where nothing else reads weights.
    """
    whole, places, has_wide = block.ints, block.places, may_be_wide(geometry.viewport)
    for k in range(block.counts[rows.SEGMENTS]):
        segment = block.segments[k]
        for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
            first, end = (
                np.int64(whole[rows.FIRST, r]),
                np.int64(whole[rows.FIRST, r + np.uintp(1)]),
            )
            corners = (
                np.uintp(whole[rows.A, r]),
                np.uintp(whole[rows.B, r]),
                np.uintp(whole[rows.C, r]),
            )
            column, row = np.int64(segment[rows.COLUMN_OF]), np.int64(segment[rows.ROW_OF])
            if segment[rows.KIND] != rows.SPAN:
                column, row = np.int64(whole[rows.COLUMN, first]), np.int64(whole[rows.ROW, first])
            place_patch(first, end, corners, column, row, has_wide, places, uv, geometry)
        owner = np.float64(segment[rows.OWNER])
        for n in range(np.uintp(segment[rows.START]), np.uintp(segment[rows.STOP])):
            places[OWNERS, n] = owner
