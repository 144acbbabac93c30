"""
Note where on their textures samples lie, and how far a pixel's steps lead there.

Along a run of one face from its edge functions; along a stretch from what was gathered of each
sample's face. The formulas are those of ``texturing``, and give the same bits.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import texturing
from rasterjit.kernels.interpolation import interpolate, ratios_at
from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.patches import (
    AX,
    AY,
    BX,
    BY,
    COLUMN,
    CX,
    CY,
    FIRST,
    ROW,
    UNSURE,
    A,
    B,
    C,
    gather_coordinates,
)
from rasterjit.kernels.setup import narrow_edge
from rasterjit.kernels.texture_rows import CORNERS, OWNER, STEPS, U, V
from rasterjit.kernels.texturing import FILTER, FIRST_LEVEL, KINDS, TRILINEAR


@stage
def wants_steps(owner, table):
    """Return whether any texture of an object has levels to choose from."""
    for kind in range(np.uintp(KINDS)):
        if table[owner, kind, FIRST_LEVEL] >= 0 and table[owner, kind, FILTER] == TRILINEAR:
            return True
    return False


@disjoint_stage
def fill_places(u, v, owners, second, third, ends, owner):
    """Write the coordinates of samples of one face, given those of its vertices, and the object."""
    pa, pb, pc = ends
    for n in range(u.shape[0]):
        weights = 0.0, second[n], third[n]
        u[n] = interpolate(weights, pa[0], pb[0], pc[0])
        v[n] = interpolate(weights, pa[1], pb[1], pc[1])
        owners[n] = owner


@disjoint_stage
def fill_steps(right_u, right_v, down_u, down_v, u, v, ends, row_start, bits, w):
    """Write the steps of neighbouring samples of one face that was not clipped."""
    (e0, e1, e2), (x0, x1, x2), downs, ratios = row_start
    unit = np.float64(np.int64(1) << bits)
    across = np.float64(x0 >> bits), np.float64(x1 >> bits), np.float64(x2 >> bits)
    fall = np.float64(downs[0] >> bits), np.float64(downs[1] >> bits), np.float64(downs[2] >> bits)
    for n in range(u.shape[0]):
        total = texturing.sum_of_weights(e0, e1, e2, ratios, w)
        right, down = texturing.scaled_slopes(unit / total, ratios, across, fall)
        place = u[n], v[n]
        right_u[n], right_v[n] = texturing.place_step(right, place, ends[0], ends[1], ends[2])
        down_u[n], down_v[n] = texturing.place_step(down, place, ends[0], ends[1], ends[2])
        e0 += x0
        e1 += x1
        e2 += x2


@stage
def note_exact_steps(places, n, a, b, c, column, row, uv, geometry):
    """Write the steps of one sample of any face."""
    right, down = texturing.weight_slopes(a, b, c, column, row, geometry)
    pa, pb, pc = (
        texturing.vertex_place(uv, a), texturing.vertex_place(uv, b), texturing.vertex_place(uv, c)
    )  # fmt: skip
    place = places[U, n], places[V, n]
    places[STEPS, n], places[STEPS + 1, n] = texturing.place_step(right, place, pa, pb, pc)
    places[STEPS + 2, n], places[STEPS + 3, n] = texturing.place_step(down, place, pa, pb, pc)


@stage
def note_corners(places, run, a, b, c, maps):
    """Write the vertices of the samples of one face; nothing without maps."""
    if maps is None:
        return
    for n in range(np.uintp(run[0]), np.uintp(run[1])):
        places[CORNERS, n] = a
        places[CORNERS + 1, n] = b
        places[CORNERS + 2, n] = c


@stage
def note_run(
    places, weights, run, column, row, corners, owner, is_clipped, row_start, textures,
    geometry,
):  # fmt: skip
    """Write what it takes to look up textures along a run of one face."""
    (a, b, c), (start, stop), uv = corners, run, textures.uv
    ends = (
        texturing.vertex_place(uv, a), texturing.vertex_place(uv, b), texturing.vertex_place(uv, c)
    )  # fmt: skip
    u, v = places[U, start:stop], places[V, start:stop]
    fill_places(
        u, v, places[OWNER, start:stop], weights[0, start:stop], weights[1, start:stop], ends,
        np.float64(owner),
    )  # fmt: skip
    if not wants_steps(owner, textures.table):
        return
    if is_clipped:
        for n in range(start, stop):
            note_exact_steps(places, n, a, b, c, column + n - start, row, uv, geometry)
        return
    fill_steps(
        places[STEPS, start:stop], places[STEPS + 1, start:stop], places[STEPS + 2, start:stop],
        places[STEPS + 3, start:stop], u, v, ends, row_start, geometry.viewport.grid_bits,
        geometry.w,
    )  # fmt: skip


@disjoint_stage
def mix_places(u, v, owners, ua, va, ub, vb, uc, vc, second, third, owner):
    """Write the coordinates of samples, each of a face of its own, and the object."""
    for n in range(u.shape[0]):
        weights = 0.0, second[n], third[n]
        u[n] = interpolate(weights, np.float64(ua[n]), np.float64(ub[n]), np.float64(uc[n]))
        v[n] = interpolate(weights, np.float64(va[n]), np.float64(vb[n]), np.float64(vc[n]))
        owners[n] = owner


@stage
def float_difference(one, other):
    """Return the difference of two int32 as float64; it fits 32 bits."""
    return np.float64(np.int32(one - other))


@disjoint_stage
def mix_steps(
    right_u, right_v, down_u, down_v, u, v, ua, va, ub, vb, uc, vc, ax, ay, bx, by, cx, cy,
    wa, wb, wc, columns, rows, bits, w,
):  # fmt: skip
    """Write the steps of samples, each of a face of its own that was not clipped."""
    half = np.int32(1) << (bits - 1)
    unit = np.float64(np.int64(1) << bits)
    for n in range(u.shape[0]):
        px = np.int32((columns[n] << bits) + half)
        py = np.int32((rows[n] << bits) + half)
        x0, y0, x1, y1, x2, y2 = ax[n], ay[n], bx[n], by[n], cx[n], cy[n]
        ratios = ratios_at(wa, wb, wc, n, w)
        total = texturing.sum_of_weights(
            narrow_edge(x1, y1, x2, y2, px, py), narrow_edge(x2, y2, x0, y0, px, py),
            narrow_edge(x0, y0, x1, y1, px, py), ratios, w,
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


@stage
def note_steps(places, run, patches, whole, real, single, textures, geometry):
    """Write what a pixel to the right and a pixel down add to the coordinates of each sample."""
    start, stop = run
    size = stop - start
    mix_steps(
        places[STEPS, start:stop], places[STEPS + 1, start:stop],
        places[STEPS + 2, start:stop], places[STEPS + 3, start:stop],
        places[U, start:stop], places[V, start:stop],
        single[0, :size], single[1, :size], single[2, :size], single[3, :size], single[4, :size],
        single[5, :size], whole[AX, :size], whole[AY, :size], whole[BX, :size], whole[BY, :size],
        whole[CX, :size], whole[CY, :size], real[0, :size], real[1, :size], real[2, :size],
        whole[COLUMN, :size], whole[ROW, :size], geometry.viewport.grid_bits, geometry.w,
    )  # fmt: skip
    if geometry.clip_positions.shape[0] == 0:
        return
    for r in range(patches):
        a, b, c = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        for i in range(whole[FIRST, r], whole[FIRST, r + np.uintp(1)]):
            if whole[UNSURE, i] != 0:
                column, row = whole[COLUMN, i], whole[ROW, i]
                note_exact_steps(places, start + i, a, b, c, column, row, textures.uv, geometry)


@stage
def note_stretch(
    places, run, patches, weights, owner, whole, real, single, geometry, textures
):  # fmt: skip
    """Write what it takes to look up textures at some samples; nothing if there are none."""
    if textures is None:
        return
    start, stop = run
    size = stop - start
    gather_coordinates(patches, textures.uv, whole, single)
    mix_places(
        places[U, start:stop], places[V, start:stop],
        places[OWNER, start:stop], single[0, :size], single[1, :size],
        single[2, :size], single[3, :size], single[4, :size], single[5, :size],
        weights[0, start:stop], weights[1, start:stop], np.float64(owner),
    )  # fmt: skip
    if wants_steps(owner, textures.table):
        note_steps(places, run, patches, whole, real, single, textures, geometry)
