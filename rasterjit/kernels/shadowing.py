"""
Find which share of a light reaches each sample, by its shadow map.

A map holds the stored depth (greater is nearer to the light) of the first surface along rays from
the light, one for each texel's centre. Over a map the stored depth of a plane is linear: it is the
distance from the far side for a parallel light, and near / w for one that shines from a point. So
the plane of the sample's own face tells its depth at every texel near the sample, and a texel casts
a shadow where what it holds is nearer than that plane, by more than a bias. The plane lies in the
map as it was drawn, but for the rounding of its vertices to the sub-pixel grid, and the bias covers
that at every slope: it is some texels of depth times one plus the slope, up to a limit. Nothing of
this has a unit, so it holds at any scale.

A sample is taken to the light in four steps, each a loop over the samples of a part of a row: the
corners of its face are gathered; its point and the normal of its face are found, in world axes
relative to the eye, once for all lights; for each light the point becomes texels and a depth, and
the normal the gain in depth by a texel right and down; then texels are compared.

A face turned away from the light is dark whatever the map says. One that is shaded smooth is lit
where its vertex normals face the light, though the face itself turns away, and is then in the
shadow of its neighbours: its points are moved out to the surface that the normals mean, by [4]_.

References
----------
.. [1] W. Reeves, D. Salesin, R. Cook, "Rendering Antialiased Shadows with Depth Maps",
   SIGGRAPH 1987: percentage-closer filtering.
.. [2] R. Fernando, "Percentage-Closer Soft Shadows", SIGGRAPH 2005 sketches.
.. [3] J. Isidoro, "Shadow Mapping: GPU-based Tips and Techniques", GDC 2006: receiver planes.
.. [4] J. Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels.interpolation import find_object, lowest_first, matrix_of
from rasterjit.kernels.jit import disjoint_stage, kernel, stage
from rasterjit.kernels.vectors import LANES, spread

HARD, PCF, SOFT = 0, 1, 2
"""Filters, as ``Shadows.filters`` numbers them."""

U, V, DEPTH = lit.SAMPLE_ROWS, lit.SAMPLE_ROWS + 1, lit.SAMPLE_ROWS + 2
"""Rows of samples: place in the map, texels from its left upper corner; stored depth."""
ACROSS, DOWN, BIAS = lit.SAMPLE_ROWS + 3, lit.SAMPLE_ROWS + 4, lit.SAMPLE_ROWS + 5
"""Rows: gain in stored depth by a texel right and down; what is nearer by less casts nothing."""
TURNED = lit.SAMPLE_ROWS + 8
"""Row: 1 where a face turns away from the light at hand, which its shading normal faces."""
FOUND, NEARER = lit.SAMPLE_ROWS + 6, lit.SAMPLE_ROWS + 7
"""Rows: how many texels hold what may shade a sample, and the sum of their stored depths."""
SHADOW_ROWS = lit.SAMPLE_ROWS + 9
"""Rows of samples of a frame with shadows."""

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

ORIGIN, FOCAL, CENTER = 9, 12, 14
"""
Columns of ``Shadows.maps`` behind the axes of a map (across, down, away from the light; three
each, unit length): where the light is along them; texels to a unit (over the depth, if the light
shines from a point), across and down; the texel below the origin, across and down.
"""
NEAR, FAR, SPAN, TEXEL = 16, 17, 18, 19
"""Columns: the stored depth is near / w, or (far - w) / span; how much of it a texel is (times the
stored depth, if the light shines from a point)."""
PARALLEL, BIAS_TEXELS, WIDENING, HIGHEST = 20, 21, 22, 23
"""Columns: 1 for a parallel light, else 0; bias in texels; texels of radius of a penumbra for each
unit of stored depth between the surface and what shades it; greatest stored depth in the map."""
MAP_COLUMNS = 24

FIRST, SIZE, FILTER, SIDES = 0, 1, 2, 3
"""Columns of ``Shadows.places``: first texel of the light's maps, or -1 if it has none; side of
a map, texels; filter; 1 map, or 6 for the sides of a cube."""
PLACE_COLUMNS = 4

STEEPEST = 4096.0
"""Largest slope of a face to the light: light that falls on a steeper one adds less than 1/4096."""

SLOPING = 8.0
"""Slope up to which the bias grows with it: more would let light through what is near."""

SNAPPING = 1.0 / 64.0
"""Bias for the slope beyond that, texels: four times what vertices are rounded by in a map."""

EDGEWISE = 1.0 / 16.0
"""A face turns away from a light if it faces it by less than this share of what its shading normal
does: the plane of one that is seen edgewise says nothing about its neighbours."""

DEPTH_ROUNDING = np.float32(2.0**-20)
"""Share of a stored depth that rounding of it, of the plane and of their difference may reach:
sixteen roundings of float32."""

CELL = 16
"""Side of the cells that `find_depth_ranges` looks at, pixels."""

SEARCHED = np.float32(2.5)
"""Least radius that is searched for what may shade a sample, texels: the narrowest penumbra, and
what lies between the points that are looked at."""

NARROWEST = np.float32(1.5)
"""Least radius of a penumbra, texels: its edge is as smooth as that of 3 x 3 comparisons."""

LARGEST_RADIUS = np.float32(0.25)
"""Largest radius of a penumbra, sides of a map."""


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


@stage
def plane_of(s, t, w, ns, nt, nw, row):
    """
    Return place, stored depth and its gain by a texel right and down, of a point and a normal.

    Parameters
    ----------
    s, t, w, ns, nt, nw : float64
        Along the axes of the map, from the light.
    row : (MAP_COLUMNS,) float64
    """
    is_parallel = row[PARALLEL] != 0.0
    # The plane is ns s + nt t + nw w = k; over the map, with s = S w and t = T w:
    # 1 / w = (ns S + nt T + nw) / k.
    over = 1.0 / (1.0 if is_parallel else w)
    k = -nw if is_parallel else ns * s + nt * t + nw * w
    steep = 1.0 / (k if k != 0.0 else 1.0)
    steep = steep if k != 0.0 else 0.0
    gain = (-1.0 / row[SPAN] if is_parallel else row[NEAR]) * steep
    across, down = gain * ns / row[FOCAL], gain * nt / row[FOCAL + 1]
    depth = (row[FAR] - w) / row[SPAN] if is_parallel else row[NEAR] * over
    return (
        s * over * row[FOCAL] + row[CENTER],
        t * over * row[FOCAL + 1] + row[CENTER + 1],
        depth, across, down,
    )  # fmt: skip


@stage
def held_slope(across, down, texel):
    """Return gains that are no steeper than the steepest face."""
    most, slope = STEEPEST * texel, abs(across) + abs(down)
    share = most / (slope if slope > most else most)
    return across * share, down * share


@stage
def bias_of(texel, gain, texels):
    """Return how much nearer to the light something must be, in stored depth, to shade a plane."""
    return texels * (texel + min(gain, SLOPING * texel)) + SNAPPING * gain


@disjoint_stage
def map_rows(px, py, pz, nx, ny, nz, row, u, v, depth, across, down, bias):
    """Take samples to the map of a light, and write their planes and biases there."""
    for i in range(px.shape[0]):
        x, y, z, a, b, c = px[i], py[i], pz[i], nx[i], ny[i], nz[i]
        s = row[0] * x + row[1] * y + row[2] * z - row[ORIGIN]
        t = row[3] * x + row[4] * y + row[5] * z - row[ORIGIN + 1]
        w = row[6] * x + row[7] * y + row[8] * z - row[ORIGIN + 2]
        ns = row[0] * a + row[1] * b + row[2] * c
        nt = row[3] * a + row[4] * b + row[5] * c
        nw = row[6] * a + row[7] * b + row[8] * c
        # What lies beside or behind the light is outside its map.
        before = (row[PARALLEL] != 0.0) | (w > 0.0)
        w = w if before else 1.0
        at_u, at_v, d, right, below = plane_of(s, t, w, ns, nt, nw, row)
        texel = row[TEXEL] * (1.0 if row[PARALLEL] != 0.0 else d)
        right, below = held_slope(right, below, texel)
        u[i], v[i] = np.float32(at_u if before else -1.0), np.float32(at_v)
        depth[i], across[i], down[i] = np.float32(d), np.float32(right), np.float32(below)
        bias[i] = np.float32(bias_of(texel, abs(right) + abs(below), row[BIAS_TEXELS]))


@disjoint_stage
def map_cube_rows(px, py, pz, nx, ny, nz, row, size, u, v, depth, across, down, bias):
    """
    Take samples to the six maps of a point light; see `map_rows`.

    The maps lie one below the other: +x, -x, +y, -y, +z, -z. A sample goes to the one of its
    longest coordinate; the other two, in cyclic order, run across and down.
    """
    for i in range(px.shape[0]):
        x, y, z = px[i] - row[ORIGIN], py[i] - row[ORIGIN + 1], pz[i] - row[ORIGIN + 2]
        a, b, c = nx[i], ny[i], nz[i]
        is_x = (abs(x) >= abs(y)) & (abs(x) >= abs(z))
        is_y = (abs(y) >= abs(z)) & (not is_x)
        w, nw = (x if is_x else (y if is_y else z)), (a if is_x else (b if is_y else c))
        s, ns = (y if is_x else (z if is_y else x)), (b if is_x else (c if is_y else a))
        t, nt = (z if is_x else (x if is_y else y)), (c if is_x else (a if is_y else b))
        side = np.float32(0.0) if is_x else (np.float32(2.0) if is_y else np.float32(4.0))
        side += np.float32(1.0) if w < 0.0 else np.float32(0.0)
        nw, w = (-nw if w < 0.0 else nw), abs(w)
        before = w > 0.0
        w = w if before else 1.0
        at_u, at_v, d, right, below = plane_of(s, t, w, ns, nt, nw, row)
        texel = row[TEXEL] * d
        right, below = held_slope(right, below, texel)
        u[i] = np.float32(at_u) if before else np.float32(-1.0)
        v[i] = np.float32(at_v) + side * np.float32(size)
        depth[i], across[i], down[i] = np.float32(d), np.float32(right), np.float32(below)
        bias[i] = np.float32(bias_of(texel, abs(right) + abs(below), row[BIAS_TEXELS]))


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
def limits(v, size, sides):
    """Return the first row of the map that a sample lies in, and whether it lies in any."""
    length = np.float32(size)
    side = np.floor(v / length)
    side = min(max(side, np.float32(0.0)), np.float32(sides - np.float32(1.0)))
    return side * length


@stage
def is_nearer(texels, i, j, size, plane):
    """Return 1 where a texel holds something nearer to the light than the plane, else 0."""
    stored = texels[np.uintp(np.int32(j) * np.int32(size) + np.int32(i))]
    return np.float32(1.0) if stored > plane else np.float32(0.0)


@disjoint_stage
def read_hard(u, v, depth, across, down, bias, texels, size, sides, share):
    """Compare each sample with the texel it lies in."""
    half, last = np.float32(0.5), np.float32(size - 1)
    for i in range(share.shape[0]):
        top = limits(v[i], size, sides)
        row, column = np.floor(v[i]), np.floor(u[i])
        inside = (column >= np.float32(0.0)) & (column <= last) & (row >= top) & (row <= top + last)
        column = min(max(column, np.float32(0.0)), last)
        row = min(max(row, top), top + last)
        plane = depth[i] + across[i] * (column + half - u[i]) + down[i] * (row + half - v[i])
        plane += bias[i] + DEPTH_ROUNDING * abs(depth[i])
        shaded = is_nearer(texels, column, row, size, plane)
        share[i] = np.float32(1.0) - (shaded if inside else np.float32(0.0))


@stage
def compare_four(texels, at, plane, step, first, last):
    """Return the weighted comparisons with four texels of a row: weights first, 1, 1, last."""
    zero, one = np.float32(0.0), np.float32(1.0)
    two = np.float32(2.0) * step
    total = first if texels[np.uintp(at)] > plane else zero
    total += one if texels[np.uintp(at + np.int32(1))] > plane + step else zero
    total += one if texels[np.uintp(at + np.int32(2))] > plane + two else zero
    total += last if texels[np.uintp(at + np.int32(3))] > plane + (two + step) else zero
    return total


@disjoint_stage
def read_pcf(u, v, depth, across, down, bias, texels, size, sides, share):
    """Compare each sample with 3 x 3 texels, each between four by their weight."""
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)
    length, last = np.float32(size), np.float32(size - 4)
    for i in range(share.shape[0]):
        top = limits(v[i], size, sides)
        inside = (u[i] >= zero) & (u[i] <= length) & (v[i] >= top) & (v[i] <= top + length)
        left, above = np.floor(u[i] - half), np.floor(v[i] - half)
        right, below = u[i] - half - left, v[i] - half - above
        column = min(max(left - one, zero), last)
        row = min(max(above - one, top), top + last)
        plane = depth[i] + across[i] * (column + half - u[i]) + down[i] * (row + half - v[i])
        plane += bias[i] + DEPTH_ROUNDING * abs(depth[i])
        at = np.int32(row) * np.int32(size) + np.int32(column)
        step, gain = across[i], down[i]
        total = (one - below) * compare_four(texels, at, plane, step, one - right, right)
        at += np.int32(size)
        total += compare_four(texels, at, plane + gain, step, one - right, right)
        at += np.int32(size)
        plane += np.float32(2.0) * gain
        total += compare_four(texels, at, plane, step, one - right, right)
        at += np.int32(size)
        total += below * compare_four(texels, at, plane + gain, step, one - right, right)
        shaded = total * np.float32(1.0 / 9.0)
        share[i] = one - (min(shaded, one) if inside else zero)


@disjoint_stage
def find_shading(
    u, v, depth, across, down, bias, texels, size, sides, widening, highest, dx, dy, found, nearer
):  # fmt: skip
    """
    Look at one texel near each sample for what may shade it.

    It does if it is nearer to the light than the plane of the sample's face, and hides some of the
    light's disk: as seen from the sample no farther aside than the disk reaches.
    """
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)
    last, most = np.float32(size - 1), LARGEST_RADIUS * np.float32(size)
    for i in range(found.shape[0]):
        top = limits(v[i], size, sides)
        radius = min(max(widening * (highest - depth[i]), SEARCHED), most)
        column = min(max(np.floor(u[i] + dx * radius), zero), last)
        row = min(max(np.floor(v[i] + dy * radius), top), top + last)
        right, below = column + half - u[i], row + half - v[i]
        plane = depth[i] + across[i] * right + down[i] * below
        plane += bias[i] + DEPTH_ROUNDING * abs(depth[i])
        stored = texels[np.uintp(np.int32(row) * np.int32(size) + np.int32(column))]
        reach = widening * (stored - depth[i]) + SEARCHED
        shades = (stored > plane) & (right * right + below * below <= reach * reach)
        found[i] += one if shades else zero
        nearer[i] += stored if shades else zero


@stage
def compare_two(texels, at, plane, step, right):
    """Return the comparisons with two texels of a row, the second of weight ``right``."""
    zero, one = np.float32(0.0), np.float32(1.0)
    total = (one - right) if texels[np.uintp(at)] > plane else zero
    return total + (right if texels[np.uintp(at + np.int32(1))] > plane + step else zero)


@disjoint_stage
def read_penumbra(
    u, v, depth, across, down, bias, texels, size, sides, widening, dx, dy, found, nearer, share
):  # fmt: skip
    """Take away what one of the comparisons in the penumbra of each sample finds in shadow."""
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)
    last, most = np.float32(size - 2), LARGEST_RADIUS * np.float32(size)
    for i in range(share.shape[0]):
        top = limits(v[i], size, sides)
        mean = nearer[i] / max(found[i], one)
        radius = min(max(widening * (mean - depth[i]), NARROWEST), most)
        at_u, at_v = u[i] + dx * radius - half, v[i] + dy * radius - half
        left, above = np.floor(at_u), np.floor(at_v)
        right, below = at_u - left, at_v - above
        column, row = min(max(left, zero), last), min(max(above, top), top + last)
        plane = depth[i] + across[i] * (column + half - u[i]) + down[i] * (row + half - v[i])
        plane += bias[i] + DEPTH_ROUNDING * abs(depth[i])
        at = np.int32(row) * np.int32(size) + np.int32(column)
        total = (one - below) * compare_two(texels, at, plane, across[i], right)
        plane += down[i]
        total += below * compare_two(texels, at + np.int32(size), plane, across[i], right)
        share[i] -= total if found[i] > zero else zero


@disjoint_stage
def finish_penumbra(u, v, size, sides, comparisons, share):
    """Turn what is left of the comparisons into a share of light."""
    length, one, zero = np.float32(size), np.float32(1.0), np.float32(0.0)
    for i in range(share.shape[0]):
        top = limits(v[i], size, sides)
        inside = (u[i] >= zero) & (u[i] <= length) & (v[i] >= top) & (v[i] <= top + length)
        share[i] = max(share[i] / comparisons, zero) if inside else one


@stage
def read_soft(
    u, v, depth, across, down, bias, texels, size, sides, widening, highest, pattern, found,
    nearer, share,
):  # fmt: skip
    """Estimate the penumbra of each sample from what shades it, and compare all over it."""
    comparisons = np.float32(pattern.shape[0])
    for i in range(share.shape[0]):
        found[i], nearer[i], share[i] = np.float32(0.0), np.float32(0.0), comparisons
    for k in range(pattern.shape[0]):
        find_shading(
            u, v, depth, across, down, bias, texels, size, sides, widening, highest,
            pattern[k, 0], pattern[k, 1], found, nearer,
        )  # fmt: skip
    shaded = np.float32(0.0)
    for i in range(share.shape[0]):
        shaded = max(shaded, found[i])
    if shaded > np.float32(0.0):
        for k in range(pattern.shape[0]):
            read_penumbra(
                u, v, depth, across, down, bias, texels, size, sides, widening, pattern[k, 0],
                pattern[k, 1], found, nearer, share,
            )  # fmt: skip
    finish_penumbra(u, v, size, sides, comparisons, share)


@stage
def map_samples(samples, weights, count, at, row, size, sides):
    """Take samples, with points and normals from row ``at`` on, to a light's map or its six."""
    w, s = weights[at : at + 6], samples
    if sides == 1:
        map_rows(
            w[0, :count], w[1, :count], w[2, :count], w[3, :count], w[4, :count], w[5, :count],
            row,
            s[U, :count], s[V, :count], s[DEPTH, :count], s[ACROSS, :count], s[DOWN, :count],
            s[BIAS, :count],
        )  # fmt: skip
    else:
        map_cube_rows(
            w[0, :count], w[1, :count], w[2, :count], w[3, :count], w[4, :count], w[5, :count],
            row, size,
            s[U, :count], s[V, :count], s[DEPTH, :count], s[ACROSS, :count], s[DOWN, :count],
            s[BIAS, :count],
        )  # fmt: skip


@stage
def read_map(samples, weights, count, at, n, shadows):
    """Write the share of light number ``n``, which has a map; points are from row ``at`` on."""
    row, s = shadows.maps[n], samples
    first, size = shadows.places[n, FIRST], shadows.places[n, SIZE]
    kind, sides = shadows.places[n, FILTER], shadows.places[n, SIDES]
    texels = shadows.texels[first : first + sides * size * size]
    map_samples(samples, weights, count, at, row, size, sides)
    u, v, depth = s[U, :count], s[V, :count], s[DEPTH, :count]
    across, down, bias = s[ACROSS, :count], s[DOWN, :count], s[BIAS, :count]
    share, stacked = s[lit.SHADOW, :count], np.float32(sides)
    if kind == HARD:
        read_hard(u, v, depth, across, down, bias, texels, size, stacked, share)
    elif kind == PCF:
        read_pcf(u, v, depth, across, down, bias, texels, size, stacked, share)
    else:
        read_soft(
            u, v, depth, across, down, bias, texels, size, stacked, np.float32(row[WIDENING]),
            np.float32(row[HIGHEST]), shadows.pattern, s[FOUND, :count], s[NEARER, :count], share,
        )  # fmt: skip


@stage
def shadow_row(samples, weights, count, faces, n, lighting, geometry, placement, shadows):
    """
    Return the share of light number ``n`` that reaches each sample, 0..1.

    Parameters
    ----------
    samples : (SHADOW_ROWS, N) float32
        Reads the normals, writes row SHADOW and those from U on.
    weights : (WEIGHT_ROWS, N) float64
        Reads rows POINT, NORMAL and CORNERS, as `find_receivers` leaves them.
    count : int
    faces : (C,) int32
        The visible faces of the part; those of the samples are not negative.
    n : int
    lighting, geometry, placement : records
    shadows : Shadows or None

    Returns
    -------
    (count,) float32, or None if no light casts shadows
    """
    if shadows is None:
        return None
    if shadows.places[n, FIRST] >= 0:
        light = lighting.lights[n]
        at = move_turned(
            samples, weights, count, faces, light, geometry, placement, shadows.normals
        )
        read_map(samples, weights, count, at, n, shadows)
    else:
        fill_lit(samples, count)
    return samples[lit.SHADOW, :count]


@stage
def vertex_shadow_row(samples, weights, count, n, shadows):
    """Return the share of light that reaches vertices, which `note_vertex` has noted."""
    if shadows is None:
        return None
    if shadows.places[n, FIRST] >= 0:
        read_map(samples, weights, count, POINT, n, shadows)
    else:
        fill_lit(samples, count)
    return samples[lit.SHADOW, :count]


@stage
def fill_lit(samples, count):
    """Let all of a light reach each sample."""
    for i in range(count):
        samples[lit.SHADOW, i] = np.float32(1.0)


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
