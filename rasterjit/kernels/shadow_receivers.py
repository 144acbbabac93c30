"""
Find where the samples of a part of a row lie, and how their faces, for the shadows on them.

The corners of the faces are gathered, and points and normals found in world axes relative to the
eye, once for all lights.

A face turned away from a light is dark whatever its map says. One that is shaded smooth is lit
where its vertex normals face the light, though the face itself turns away, and is then in the
shadow of its neighbours: its points are moved out to the surface that the normals mean [1]_.

References
----------
.. [1] J. Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels.interpolation import find_object, lowest_first, matrix_of
from rasterjit.kernels.jit import disjoint_stage, kernel, stage
from rasterjit.kernels.vectors import LANES, spread

TURNED = lit.SAMPLE_ROWS
"""Row of samples: 1 where a face turns away from the light at hand, which its shading normal
faces."""

POINT, NORMAL, CORNERS = 2, 5, 8
"""Rows behind the two of weights: the point and the normal of the face, three each, world axes;
and what is gathered to find them, nine."""
SECOND, THIRD = CORNERS + 3, CORNERS + 6
MOVED, AWAY = 17, 20
"""Rows: point and normal, three each, as one light finds them that a face turns away from."""
BENT = 23
"""Rows: the normals of the three corners, model space, three each."""
WEIGHT_ROWS = 32
"""Rows of weights of a frame with shadows."""

EDGEWISE = 1.0 / 16.0
"""A face turns away from a light if it faces it by less than this share of what its shading normal
does: the plane of one that is seen edgewise says nothing about its neighbours."""

CELL = 16
"""Side of the cells that `find_depth_ranges` looks at, pixels."""


@stage
def gather_corners(weights, n, face, geometry, placement):
    """Write the corners of a face for some samples, model space, from sample ``n`` on."""
    p = placement.positions
    a, b, c = lowest_first(geometry.faces, np.uintp(face))
    for k in range(3):
        spread(weights[CORNERS + k], n, p[a, k])
        spread(weights[SECOND + k], n, p[b, k])
        spread(weights[THIRD + k], n, p[c, k])


@disjoint_stage
def place_rows(
    px, py, pz, nx, ny, nz, ax, ay, az, bx, by, bz, cx, cy, cz, second, third, m, moved
):  # fmt: skip
    """Write the points of samples of one object, and the normals of their faces, any length."""
    for i in range(px.shape[0]):
        x, y, z = bx[i] - ax[i], by[i] - ay[i], bz[i] - az[i]
        ux, uy, uz = (
            m[0] * x + m[1] * y + m[2] * z,
            m[3] * x + m[4] * y + m[5] * z,
            m[6] * x + m[7] * y + m[8] * z,
        )
        x, y, z = cx[i] - ax[i], cy[i] - ay[i], cz[i] - az[i]
        vx, vy, vz = (
            m[0] * x + m[1] * y + m[2] * z,
            m[3] * x + m[4] * y + m[5] * z,
            m[6] * x + m[7] * y + m[8] * z,
        )
        x, y, z = ax[i], ay[i], az[i]
        px[i] = (m[0] * x + m[1] * y + m[2] * z + moved[0]) + (second[i] * ux + third[i] * vx)
        py[i] = (m[3] * x + m[4] * y + m[5] * z + moved[1]) + (second[i] * uy + third[i] * vy)
        pz[i] = (m[6] * x + m[7] * y + m[8] * z + moved[2]) + (second[i] * uz + third[i] * vz)
        nx[i], ny[i], nz[i] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@stage
def place_samples(weights, start, stop, owner, placement):
    """Find points and normals of gathered samples of one object."""
    m, w = placement.relative_from_model, weights
    moved = m[owner, 0, 3], m[owner, 1, 3], m[owner, 2, 3]
    place_rows(
        w[POINT, start:stop], w[POINT + 1, start:stop], w[POINT + 2, start:stop],
        w[NORMAL, start:stop], w[NORMAL + 1, start:stop], w[NORMAL + 2, start:stop],
        w[CORNERS, start:stop], w[CORNERS + 1, start:stop], w[CORNERS + 2, start:stop],
        w[SECOND, start:stop], w[SECOND + 1, start:stop], w[SECOND + 2, start:stop],
        w[THIRD, start:stop], w[THIRD + 1, start:stop], w[THIRD + 2, start:stop],
        w[0, start:stop], w[1, start:stop], matrix_of(m, owner), moved,
    )  # fmt: skip


@stage
def patch_end(faces, column):
    """Return where the next few samples end that show the face of this one."""
    end = column + 1
    last = min(column + LANES, np.int64(faces.shape[0]))
    while end < last and faces[np.uintp(end)] == faces[np.uintp(column)]:
        end += 1
    return end


@stage
def find_receivers(weights, faces, geometry, placement, shadows):
    """
    Find where the gathered samples of a part of a row lie, and how their faces; for all lights.

    Parameters
    ----------
    weights : (WEIGHT_ROWS, N) float64
        Reads the weights of the second and third vertex, writes rows POINT and NORMAL.
    faces : (C,) int32
        The visible faces of the part; those of the samples are not negative.
    geometry, placement : records
    shadows : Shadows or None
        ``None``: nothing is done.
    """
    if shadows is None:
        return
    n, start, column, owner = np.uintp(0), np.uintp(0), np.int64(0), np.int64(0)
    while column < faces.shape[0]:
        face = np.int64(faces[np.uintp(column)])
        end = column + 1
        if face >= 0:
            end = patch_end(faces, column)
            found = find_object(face, placement.face_starts, owner)
            if found != owner:
                place_samples(weights, start, n, owner, placement)
                start, owner = n, found
            gather_corners(weights, n, face, geometry, placement)
            n += np.uintp(end - column)
        column = end
    place_samples(weights, start, n, owner, placement)


@disjoint_stage
def find_turned(light, px, py, pz, ax, ay, az, nx, ny, nz, turned):
    """
    Write 1 where a face turns away from a light that its shading normal faces, else 0.

    Return whether there is any.
    """
    found = np.int32(0)
    for i in range(turned.shape[0]):
        lx = np.float64(light[0]) - np.float64(light[3]) * px[i]
        ly = np.float64(light[1]) - np.float64(light[3]) * py[i]
        lz = np.float64(light[2]) - np.float64(light[3]) * pz[i]
        x, y, z = np.float64(nx[i]), np.float64(ny[i]), np.float64(nz[i])
        side = ax[i] * x + ay[i] * y + az[i] * z
        face = ax[i] * lx + ay[i] * ly + az[i] * lz
        face = face if side >= 0.0 else -face
        length = np.sqrt(ax[i] * ax[i] + ay[i] * ay[i] + az[i] * az[i])
        smooth = x * lx + y * ly + z * lz
        is_turned = (smooth > 0.0) & (face <= EDGEWISE * smooth * length)
        turned[i] = np.float32(1.0) if is_turned else np.float32(0.0)
        found |= np.int32(is_turned)
    return found


@disjoint_stage
def bulge_rows(
    ax, ay, az, bx, by, bz, cx, cy, cz, na, nb, nc, oa, ob, oc, ea, eb, ec, second, third, m,
    px, py, pz, nx, ny, nz, turned, qx, qy, qz,
):  # fmt: skip
    """
    Write the points of samples of one object, those turned away moved out to the smooth surface.

    The mean, by the weights of the corners, of where the point lies on the corners' tangent planes.
    """
    for i in range(qx.shape[0]):
        b1, b2 = second[i], third[i]
        b0 = 1.0 - b1 - b2
        # The ways from the first corner to the others, and from each corner to the point.
        ux, uy, uz = bx[i] - ax[i], by[i] - ay[i], bz[i] - az[i]
        vx, vy, vz = cx[i] - ax[i], cy[i] - ay[i], cz[i] - az[i]
        x, y, z = b1 * ux + b2 * vx, b1 * uy + b2 * vy, b1 * uz + b2 * vz
        sx, sy, sz = na[i] + oa[i] + ea[i], nb[i] + ob[i] + eb[i], nc[i] + oc[i] + ec[i]
        facing = (
            np.float64(nx[i]) * (m[0] * sx + m[1] * sy + m[2] * sz)
            + np.float64(ny[i]) * (m[3] * sx + m[4] * sy + m[5] * sz)
            + np.float64(nz[i]) * (m[6] * sx + m[7] * sy + m[8] * sz)
        )
        side = 1.0 if facing >= 0.0 else -1.0
        d0 = min(side * (x * na[i] + y * nb[i] + z * nc[i]), 0.0)
        d1 = min(side * ((x - ux) * oa[i] + (y - uy) * ob[i] + (z - uz) * oc[i]), 0.0)
        d2 = min(side * ((x - vx) * ea[i] + (y - vy) * eb[i] + (z - vz) * ec[i]), 0.0)
        w0, w1, w2 = side * b0 * d0, side * b1 * d1, side * b2 * d2
        x = w0 * na[i] + w1 * oa[i] + w2 * ea[i]
        y = w0 * nb[i] + w1 * ob[i] + w2 * eb[i]
        z = w0 * nc[i] + w1 * oc[i] + w2 * ec[i]
        share = np.float64(turned[i])
        qx[i] = px[i] - share * (m[0] * x + m[1] * y + m[2] * z)
        qy[i] = py[i] - share * (m[3] * x + m[4] * y + m[5] * z)
        qz[i] = pz[i] - share * (m[6] * x + m[7] * y + m[8] * z)


@disjoint_stage
def choose_normals(ax, ay, az, nx, ny, nz, turned, rx, ry, rz):
    """Write the normals of the faces, but of those turned away the shading normals."""
    for i in range(rx.shape[0]):
        is_turned = turned[i] > np.float32(0.0)
        rx[i] = np.float64(nx[i]) if is_turned else ax[i]
        ry[i] = np.float64(ny[i]) if is_turned else ay[i]
        rz[i] = np.float64(nz[i]) if is_turned else az[i]


@stage
def gather_bent(weights, n, face, geometry, normals):
    """Write the vertex normals of a face for some samples, from sample ``n`` on."""
    a, b, c = lowest_first(geometry.faces, np.uintp(face))
    for k in range(3):
        spread(weights[BENT + k], n, np.float64(normals[a, k]))
        spread(weights[BENT + 3 + k], n, np.float64(normals[b, k]))
        spread(weights[BENT + 6 + k], n, np.float64(normals[c, k]))


@stage
def bulge_samples(samples, weights, start, stop, owner, placement):
    """Move the turned samples of one object out."""
    w, s = weights, samples
    bulge_rows(
        w[CORNERS, start:stop], w[CORNERS + 1, start:stop], w[CORNERS + 2, start:stop],
        w[SECOND, start:stop], w[SECOND + 1, start:stop], w[SECOND + 2, start:stop],
        w[THIRD, start:stop], w[THIRD + 1, start:stop], w[THIRD + 2, start:stop],
        w[BENT, start:stop], w[BENT + 1, start:stop], w[BENT + 2, start:stop],
        w[BENT + 3, start:stop], w[BENT + 4, start:stop], w[BENT + 5, start:stop],
        w[BENT + 6, start:stop], w[BENT + 7, start:stop], w[BENT + 8, start:stop],
        w[0, start:stop], w[1, start:stop], matrix_of(placement.relative_from_model, owner),
        w[POINT, start:stop], w[POINT + 1, start:stop], w[POINT + 2, start:stop],
        s[lit.NORMAL_X, start:stop], s[lit.NORMAL_Y, start:stop], s[lit.NORMAL_Z, start:stop],
        s[TURNED, start:stop],
        w[MOVED, start:stop], w[MOVED + 1, start:stop], w[MOVED + 2, start:stop],
    )  # fmt: skip


@stage
def move_turned(samples, weights, count, faces, light, geometry, placement, normals):
    """
    Move the samples out whose faces turn away from a light that their shading normals face.

    Returns
    -------
    int
        Where the points and normals are, for that light: row POINT or row MOVED.
    """
    if normals is None:
        return POINT
    w, s = weights, samples
    found = find_turned(
        light, w[POINT, :count], w[POINT + 1, :count], w[POINT + 2, :count],
        w[NORMAL, :count], w[NORMAL + 1, :count], w[NORMAL + 2, :count],
        s[lit.NORMAL_X, :count], s[lit.NORMAL_Y, :count], s[lit.NORMAL_Z, :count],
        s[TURNED, :count],
    )  # fmt: skip
    if found == 0:
        return POINT
    n, start, column, owner = np.uintp(0), np.uintp(0), np.int64(0), np.int64(0)
    while column < faces.shape[0]:
        face = np.int64(faces[np.uintp(column)])
        end = column + 1
        if face >= 0:
            end = patch_end(faces, column)
            now = find_object(face, placement.face_starts, owner)
            if now != owner:
                bulge_samples(samples, weights, start, n, owner, placement)
                start, owner = n, now
            gather_bent(weights, n, face, geometry, normals)
            n += np.uintp(end - column)
        column = end
    bulge_samples(samples, weights, start, n, owner, placement)
    choose_normals(
        w[NORMAL, :count], w[NORMAL + 1, :count], w[NORMAL + 2, :count],
        s[lit.NORMAL_X, :count], s[lit.NORMAL_Y, :count], s[lit.NORMAL_Z, :count],
        s[TURNED, :count], w[AWAY, :count], w[AWAY + 1, :count], w[AWAY + 2, :count],
    )  # fmt: skip
    return MOVED


@stage
def note_vertex(weights, n, point, normal, shadows):
    """Note a vertex to be lit as a sample: its surface is the plane of its normal."""
    if shadows is None:
        return
    for k in range(3):
        weights[POINT + k, n] = point[k]
        weights[NORMAL + k, n] = normal[k]


@disjoint_stage
def widen_range(depth, lowest, highest):
    """Widen the range of each column by the depths of a row."""
    for i in range(depth.shape[0]):
        here = depth[i]
        # Nothing is there: not the lowest depth.
        low = here if here > np.float32(-np.inf) else np.float32(np.inf)
        lowest[i] = low if low < lowest[i] else lowest[i]
        highest[i] = here if here > highest[i] else highest[i]


@kernel
def find_depth_ranges(depth, cells, lowest, highest, scratch):
    """
    Find the lowest and the highest stored depth in cells of a frame.

    Parameters
    ----------
    depth : (H, W) float32
        -inf where nothing is.
    cells : (int, int)
        First row of cells, and one past the last.
    lowest, highest : (H / CELL, W / CELL) float32, rounded up
        Written; inf and -inf where nothing is.
    scratch : (2, W) float32
    """
    height, width = depth.shape
    low, high = scratch[0], scratch[1]
    for cell in range(cells[0], cells[1]):
        for i in range(width):
            low[i], high[i] = np.float32(np.inf), np.float32(-np.inf)
        for row in range(cell * CELL, min((cell + 1) * CELL, height)):
            widen_range(depth[row], low, high)
        for k in range(lowest.shape[1]):
            least, most = np.float32(np.inf), np.float32(-np.inf)
            for i in range(k * CELL, min((k + 1) * CELL, width)):
                least, most = min(least, low[i]), max(most, high[i])
            lowest[cell, k], highest[cell, k] = least, most
