"""
Compute shadow receivers: each sample's position and geometric normal, in float64.

Points and normals are computed from the corners of faces, in world axes relative to the eye, once
for all lights.

With smooth shading, a face may be lit by its vertex normals though it turns away from the light
itself. Its neighbours would then shadow it (the shadow terminator problem), so its points are moved
out to the smooth surface that the normals imply [1]_.

References
----------
.. [1] J. Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import get_linear_part
from rasterjit.pipeline.lighting.pbr import is_any_above_zero
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import get_patch_vertices, round_up_to_vectors
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.intrinsics import LANES, nine_parts, part, six_parts, spread, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, kernel, stage
from rasterjit.runtime.state_block import float32, float64, int64

MIN_FACING = 1.0 / 16.0
"""A face turns away from a light if its cosine is below this share of its shading normal's: the
plane of a face seen edge-on says nothing about its neighbours."""

CELL_PIXELS = 16
"""Side of the cells of `find_depth_ranges`, pixels."""


@helper
def gather_corners(patches, values, ints, out):
    """Write three values of each corner of each sample's face."""
    for r in range(np.uintp(patches)):
        a, b, c = get_patch_vertices(ints, r)
        for start in range(
            ints[rows.FIRST_SAMPLE, r], ints[rows.FIRST_SAMPLE, r + np.uintp(1)], LANES
        ):
            n = np.uintp(start)
            for k in range(3):
                spread(out[k], n, values[a, k])
                spread(out[3 + k], n, values[b, k])
                spread(out[6 + k], n, values[c, k])


@disjoint_helper
def compute_points(
    px, py, pz, nx, ny, nz, ax, ay, az, bx, by, bz, cx, cy, cz, wb, wc, m, translation
):  # fmt: skip
    """Write the points of one object's samples, and their faces' normals, any length."""
    for i in range(px.shape[0]):
        x, y, z = bx[i] - ax[i], by[i] - ay[i], bz[i] - az[i]
        ux, uy = m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z
        uz = m[6] * x + m[7] * y + m[8] * z
        x, y, z = cx[i] - ax[i], cy[i] - ay[i], cz[i] - az[i]
        vx, vy = m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z
        vz = m[6] * x + m[7] * y + m[8] * z
        x, y, z = ax[i], ay[i], az[i]
        px[i] = (m[0] * x + m[1] * y + m[2] * z + translation[0]) + (wb[i] * ux + wc[i] * vx)
        py[i] = (m[3] * x + m[4] * y + m[5] * z + translation[1]) + (wb[i] * uy + wc[i] * vy)
        pz[i] = (m[6] * x + m[7] * y + m[8] * z + translation[2]) + (wb[i] * uz + wc[i] * vz)
        nx[i], ny[i], nz[i] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@stage
def find_receivers(
    block: Block, count, positions: float64[:, ::1], relative_from_model: float64[:, :, :],
    has_microfacets: int64,
):  # fmt: skip
    """
    Write the point of each sample and the normal of its face, if any sample is lit.

    Parameters
    ----------
    block : Block
        Writes rows RECEIVER_POINT and RECEIVER_NORMAL, the corners in ``doubles``, and IS_LIT.
    count : int
    positions : (V, 3) float64, model space
    relative_from_model : (O, 3, 4) float64
        World axes, origin at the eye.
    has_microfacets : int
        Not 0: row MICROFACET tells which samples are lit by microfacets.
    """
    ints, doubles, r, w = block.ints, block.doubles, block.receivers, block.weights
    is_lit = is_any_above_zero(part(block.samples, rows.LIT, 0, count))
    if has_microfacets != 0:
        is_lit |= is_any_above_zero(part(block.samples, rows.MICROFACET, 0, count))
    block.counts[rows.IS_LIT] = np.int64(is_lit)
    if block.counts[rows.IS_LIT] == 0:
        return
    gather_corners(block.counts[rows.PATCH_COUNT], positions, ints, doubles)
    m = relative_from_model
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner, s = np.uintp(segment[rows.OWNER]), np.int64(segment[rows.START])
        e = s + round_up_to_vectors(segment[rows.STOP] - s)
        compute_points(
            *six_parts(r, rows.RECEIVER_POINT, s, e), *nine_parts(doubles, 0, s, e),
            part(w, 0, s, e), part(w, 1, s, e), get_linear_part(m, owner),
            (m[owner, 0, 3], m[owner, 1, 3], m[owner, 2, 3]),
        )  # fmt: skip


@disjoint_helper
def mark_turned_away(light, px, py, pz, ax, ay, az, nx, ny, nz, is_away):
    """
    Write 1 where a face turns away from a light that its shading normal faces, else 0.

    Return 1 if any does.
    """
    is_any = np.int32(0)
    for i in range(is_away.shape[0]):
        lx = np.float64(light[0]) - np.float64(light[3]) * px[i]
        ly = np.float64(light[1]) - np.float64(light[3]) * py[i]
        lz = np.float64(light[2]) - np.float64(light[3]) * pz[i]
        x, y, z = np.float64(nx[i]), np.float64(ny[i]), np.float64(nz[i])
        side = ax[i] * x + ay[i] * y + az[i] * z
        face = ax[i] * lx + ay[i] * ly + az[i] * lz
        face = face if side >= 0.0 else -face
        length = np.sqrt(ax[i] * ax[i] + ay[i] * ay[i] + az[i] * az[i])
        smooth = x * lx + y * ly + z * lz
        turns = (smooth > 0.0) & (face <= MIN_FACING * smooth * length)
        is_away[i] = np.float32(1.0) if turns else np.float32(0.0)
        is_any |= np.int32(turns)
    return is_any


@disjoint_helper
def offset_points(
    ax, ay, az, bx, by, bz, cx, cy, cz, na, nb, nc, oa, ob, oc, ea, eb, ec, wb, wc, m,
    px, py, pz, nx, ny, nz, is_away, qx, qy, qz,
):  # fmt: skip
    """
    Write the points of one object's samples, moving those turned away out to the smooth surface.

    They move to the mean, by the corners' weights, of their projections to the corners' tangent
    planes.
    """
    for i in range(qx.shape[0]):
        b1, b2 = wb[i], wc[i]
        b0 = 1.0 - b1 - b2
        n0, n1, n2 = np.float64(na[i]), np.float64(nb[i]), np.float64(nc[i])
        o0, o1, o2 = np.float64(oa[i]), np.float64(ob[i]), np.float64(oc[i])
        e0, e1, e2 = np.float64(ea[i]), np.float64(eb[i]), np.float64(ec[i])
        # Vectors from the first corner to the others, and to the point.
        ux, uy, uz = bx[i] - ax[i], by[i] - ay[i], bz[i] - az[i]
        vx, vy, vz = cx[i] - ax[i], cy[i] - ay[i], cz[i] - az[i]
        x, y, z = b1 * ux + b2 * vx, b1 * uy + b2 * vy, b1 * uz + b2 * vz
        sx, sy, sz = n0 + o0 + e0, n1 + o1 + e1, n2 + o2 + e2
        facing = (
            np.float64(nx[i]) * (m[0] * sx + m[1] * sy + m[2] * sz)
            + np.float64(ny[i]) * (m[3] * sx + m[4] * sy + m[5] * sz)
            + np.float64(nz[i]) * (m[6] * sx + m[7] * sy + m[8] * sz)
        )
        side = 1.0 if facing >= 0.0 else -1.0
        d0 = min(side * (x * n0 + y * n1 + z * n2), 0.0)
        d1 = min(side * ((x - ux) * o0 + (y - uy) * o1 + (z - uz) * o2), 0.0)
        d2 = min(side * ((x - vx) * e0 + (y - vy) * e1 + (z - vz) * e2), 0.0)
        w0, w1, w2 = side * b0 * d0, side * b1 * d1, side * b2 * d2
        x = w0 * n0 + w1 * o0 + w2 * e0
        y = w0 * n1 + w1 * o1 + w2 * e1
        z = w0 * n2 + w1 * o2 + w2 * e2
        factor = np.float64(is_away[i])
        qx[i] = px[i] - factor * (m[0] * x + m[1] * y + m[2] * z)
        qy[i] = py[i] - factor * (m[3] * x + m[4] * y + m[5] * z)
        qz[i] = pz[i] - factor * (m[6] * x + m[7] * y + m[8] * z)


@disjoint_helper
def choose_normals(ax, ay, az, nx, ny, nz, is_away, rx, ry, rz):
    """Write the faces' normals, but the shading normals of faces turned away."""
    for i in range(rx.shape[0]):
        turns = is_away[i] > np.float32(0.0)
        rx[i] = np.float64(nx[i]) if turns else ax[i]
        ry[i] = np.float64(ny[i]) if turns else ay[i]
        rz[i] = np.float64(nz[i]) if turns else az[i]


@stage
def offset_turned_away(
    block: Block, count, light: float32[::1], normals: float32[:, ::1],
    relative_from_model: float64[:, :, :],
):  # fmt: skip
    """
    Move out the samples whose faces turn away from a light that their shading normals face.

    Parameters
    ----------
    block : Block
        After `find_receivers`. Writes rows OFFSET_POINT and OFFSET_NORMAL of ``receivers``: point
        and normal, moved or not.
    count : int
    light : (LIGHT_COLUMNS,) float32
        See ``blinn_phong``.
    normals : (V, 3) float32, model space
    relative_from_model : (O, 3, 4) float64
        World axes, origin at the eye.
    """
    if block.counts[rows.IS_LIT] == 0:
        return
    s, r, w, p, bent = block.samples, block.receivers, block.weights, block.doubles, block.floats
    is_any = mark_turned_away(
        light, *six_parts(r, rows.RECEIVER_POINT, 0, count),
        *three_parts(s, rows.NORMAL_X, 0, count), part(s, rows.TURNED_AWAY, 0, count),
    )  # fmt: skip
    if is_any == 0:
        for k in range(6):
            for n in range(np.uintp(count)):
                r[rows.OFFSET_POINT + k, n] = r[rows.RECEIVER_POINT + k, n]
        return
    gather_corners(block.counts[rows.PATCH_COUNT], normals, block.ints, bent)
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        a = np.int64(segment[rows.START])
        e = a + round_up_to_vectors(segment[rows.STOP] - a)
        offset_points(
            *nine_parts(p, 0, a, e), *nine_parts(bent, 0, a, e), part(w, 0, a, e),
            part(w, 1, a, e), get_linear_part(relative_from_model, np.uintp(segment[rows.OWNER])),
            *three_parts(r, rows.RECEIVER_POINT, a, e), *three_parts(s, rows.NORMAL_X, a, e),
            part(s, rows.TURNED_AWAY, a, e), *three_parts(r, rows.OFFSET_POINT, a, e),
        )  # fmt: skip
    choose_normals(
        *three_parts(r, rows.RECEIVER_NORMAL, 0, count), *three_parts(s, rows.NORMAL_X, 0, count),
        part(s, rows.TURNED_AWAY, 0, count), *three_parts(r, rows.OFFSET_NORMAL, 0, count),
    )  # fmt: skip


@disjoint_helper
def widen_ranges(depth, lowest, highest):
    """Widen the range of each column by the depths of a row."""
    for i in range(depth.shape[0]):
        here = depth[i]
        # Empty pixels do not count as the lowest depth.
        low = here if here > np.float32(-np.inf) else np.float32(np.inf)
        lowest[i] = low if low < lowest[i] else lowest[i]
        highest[i] = here if here > highest[i] else highest[i]


@kernel
def find_depth_ranges(
    depth: float32[:, ::1], cells: (int64, int64), lowest: float32[:, ::1],
    highest: float32[:, ::1], scratch: float32[:, ::1],
):  # fmt: skip
    """
    Find the lowest and the highest stored depth in cells of a frame.

    Parameters
    ----------
    depth : (H, W) float32
        -inf where nothing is.
    cells : (int, int)
        First row of cells, and one past the last.
    lowest, highest : (H / CELL_PIXELS, W / CELL_PIXELS) float32, rounded up
        Written; inf and -inf where nothing is.
    scratch : (2, W) float32
    """
    height, width = depth.shape
    low, high = scratch[0], scratch[1]
    for cell in range(cells[0], cells[1]):
        for i in range(width):
            low[i], high[i] = np.float32(np.inf), np.float32(-np.inf)
        for row in range(cell * CELL_PIXELS, min((cell + 1) * CELL_PIXELS, height)):
            widen_ranges(depth[row], low, high)
        for k in range(lowest.shape[1]):
            least, most = np.float32(np.inf), np.float32(-np.inf)
            for i in range(k * CELL_PIXELS, min((k + 1) * CELL_PIXELS, width)):
                least, most = min(least, low[i]), max(most, high[i])
            lowest[cell, k], highest[cell, k] = least, most
