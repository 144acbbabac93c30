"""
Find how much of the light from all around reaches the surface at each pixel.

Planes through the line of sight cut the hemisphere above a surface into slices. In each, and on
both sides of the line of sight, samples of the depth along a line on the screen tell how high the
horizon stands; what is below is blocked, and the cosine-weighted share of it has a closed form.
Each pixel looks along 2 of 32 directions, with steps of 1 of 16 lengths; every square of 4 by 4
pixels holds all of them once. The mean over such a square on the same surface, taken twice, is the
result.

Heights are measured above the plane of the pixel's own face, from differences of pixel numbers and
depths alone: the points of one plane have height 0 but for how vertices are rounded to the
sub-pixel grid, and that much is taken off. So a plane, and whatever bends away from it, gets
exactly 1.

References
----------
.. [1] J. Jimenez et al., "Practical Real-Time Strategies for Accurate Indirect Occlusion",
   SIGGRAPH 2016 courses: slices and their integral.
.. [2] L. Bavoil et al., "Image-Space Horizon-Based Ambient Occlusion", SIGGRAPH 2008 talks.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.kernels.interpolation import face_normal, find_object, lowest_first
from rasterjit.kernels.jit import disjoint_stage, kernel, stage
from rasterjit.kernels.lenses import change, locate
from rasterjit.kernels.records import Geometry, Placement

BLOCK_COLUMNS = 128
"""Columns looked at together: their scratch memory stays in a core's own cache."""

STEPS = 4
"""Samples on each side of a slice."""

FARTHEST_STEP = np.float32(256.0)
"""Longest way on the screen, pixels: beyond, samples would miss most of what lies between."""

PATTERN = 4
"""Side of the square of pixels that holds every direction and step length once."""

SNAP_SLACK = np.float32(2.0)
"""
Units of the sub-pixel grid by which depths of one plane may be displaced on the screen.

A vertex is rounded by up to half a unit in x and in y, and so is the depth between vertices; two
depths are compared: one unit. Twice that, for rounding.
"""

DEPTH_ROUNDING = np.float32(2.0**-22)
"""Slack for the rounding of a float32 depth and of the arithmetic with it, as a share of it."""

LEAST = np.float32(1e-30)
"""Added to what is divided by or taken the root of; far below any length in units of the radius."""

PI_HALF = np.float32(1.5707963)

SLOPES_APART = np.float32(2.0)
FOOTPRINTS_APART = np.float32(2.0)
"""Pixels average if their depths differ by less than this many slopes and footprints of a pixel."""

COLUMN, DEPTH, PW = 0, 1, 2
"""Rows of scratch: column, stored depth, and how a homogeneous length becomes one in radii."""
NORMAL = 3
"""Rows: normal of the face, toward the viewer, world axes."""
TOWARD = 6
"""Rows: unit vector to the viewer."""
ACROSS, DOWN, DEEPER = 9, 12, 15
"""Rows: way to the surface at the next column, the next row, and the next unit of depth."""
RISE_ACROSS, RISE_DOWN, RISE_DEEPER = 18, 19, 20
"""Rows: height of those above the face's plane."""
SLACK = 21
"""Row: height that counts as none."""
WAY_ACROSS, WAY_DOWN, WAY_DEEPER = 22, 23, 24
"""Rows: length of those along the slice, in the face's plane."""
SHARE, EYE_COSINE, EYE_SINE, REACH = 25, 26, 27, 28
"""Rows: length of the normal in the slice, elevation of the line of sight, radius in pixels."""
AHEAD, BEHIND = 29, 30
"""Rows: cosine of the horizon's elevation on both sides."""
STEP_ACROSS, STEP_DOWN, JITTER = 31, 32, 33
"""Rows: direction on the screen, and how far into its length a step begins."""
BLOCKED, OPEN = 34, 35
"""Rows: sums over the slices."""
TOLERANCE = 36
"""Row: largest difference of depth to pixels of the same surface."""
STRETCH = 37
"""Row: one over the length of the normal in the slice."""
SCRATCH_ROWS = 38


def screen_pattern() -> np.ndarray:
    """
    Return direction and step offset of each pixel of a square, (4, 4, 3) float32.

    Directions are (k + 1/2) / 32 of a half turn for k in 0..15; the second slice is at a right
    angle. Offsets are in 0..1, in an order unlike that of the directions.
    """
    cosine, sine = 0.9951847266721969, 0.0980171403295606  # of 1 / 32 of a half turn
    across, down = 0.9987954562051724, 0.049067674327418015  # of half of that
    turns = []
    for _ in range(PATTERN * PATTERN):
        turns.append((across, down))
        across, down = across * cosine - down * sine, across * sine + down * cosine
    # Neighbours in x, y and on diagonals look in directions that lie far apart.
    order = (0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5)
    later = (0, 5, 10, 15, 7, 2, 13, 8, 14, 11, 4, 1, 9, 12, 3, 6)
    table = [(*turns[k], (n + 0.5) / 16.0) for k, n in zip(order, later, strict=True)]
    return np.array(table, np.float32).reshape(PATTERN, PATTERN, 3)


@stage
def arc_cosine(x):
    """
    Return the arc cosine of a float32 in [-1, 1], radians, to 7e-5.

    M. Abramowitz and I. Stegun, "Handbook of Mathematical Functions", 4.4.45.
    """
    positive = min(abs(x), np.float32(1.0))
    series = np.float32(-0.0187293) * positive + np.float32(0.0742610)
    series = series * positive + np.float32(-0.2121144)
    series = series * positive + np.float32(1.5707288)
    angle = np.sqrt(np.float32(1.0) - positive) * series
    return angle if x >= np.float32(0.0) else PI_HALF + PI_HALF - angle


@stage
def blocked_share(horizon, eye_cosine, eye_sine, eye_angle):
    """
    Return the cosine-weighted light of half a slice from below the horizon.

    The integral of ``sin E |sin(V - E)|`` for elevations E from 0 to that of the horizon, V being
    that of the line of sight, beyond which there is no horizon.
    """
    cosine = max(horizon, eye_cosine)
    sine = np.sqrt(max(np.float32(1.0) - cosine * cosine, np.float32(0.0)))
    double_sine = np.float32(2.0) * sine * cosine
    double_cosine = np.float32(1.0) - np.float32(2.0) * sine * sine
    swing = double_sine * eye_cosine - double_cosine * eye_sine + eye_sine
    angle = min(arc_cosine(cosine), eye_angle)
    share = np.float32(0.5) * (np.float32(0.5) * swing - angle * eye_cosine)
    return max(share, np.float32(0.0))


@stage
def gather_faces(faces, depth, left, row, pattern, s, geometry, placement):
    """Write column, depth, pattern and normal of the covered pixels; return how many there are."""
    count, known, owner = np.uintp(0), np.int64(-1), np.int64(0)
    x = y = z = np.float32(0.0)
    for at in range(np.uintp(faces.shape[0])):
        face = np.int64(faces[at])
        if face < 0:
            continue
        if face != known:
            known = face
            owner = find_object(face, placement.face_starts, owner)
            a, b, c = lowest_first(geometry.faces, face)
            normal = face_normal(a, b, c, owner, placement)
            x, y, z = np.float32(normal[0]), np.float32(normal[1]), np.float32(normal[2])
        column = left + np.int64(at)
        s[COLUMN, count], s[DEPTH, count] = np.float32(column), depth[at]
        s[NORMAL, count], s[NORMAL + 1, count], s[NORMAL + 2, count] = x, y, z
        own = pattern[row % PATTERN, column % PATTERN]
        s[STEP_ACROSS, count], s[STEP_DOWN, count], s[JITTER, count] = own[0], own[1], own[2]
        count += np.uintp(1)
    return np.int64(count)


@disjoint_stage
def place_block(
    row, lens, viewer, snap, column, depth, pw, nx, ny, nz, vx, vy, vz, ax, ay, az, bx, by, bz,
    cx, cy, cz, rise_a, rise_b, rise_c, slack, blocked, full, tolerance,
):  # fmt: skip
    """Find how points and heights change with column (a), row (b) and stored depth (c)."""
    one, two = np.float32(1.0), np.float32(2.0)
    for i in range(column.shape[0]):
        # Find the point, in radii, relative to the eye.
        x, y, z, pw[i] = locate(lens, column[i], row, depth[i])
        ax[i], ay[i], az[i] = change(lens[0], x, y, z)
        bx[i], by[i], bz[i] = change(lens[1], x, y, z)
        cx[i], cy[i], cz[i] = change(lens[2], x, y, z)
        # Turn the normal toward the viewer.
        ex, ey, ez = viewer[0] - viewer[3] * x, viewer[1] - viewer[3] * y, viewer[2] - viewer[3] * z
        scale = one / np.sqrt(ex * ex + ey * ey + ez * ez + LEAST)
        vx[i], vy[i], vz[i] = ex * scale, ey * scale, ez * scale
        turn = one if nx[i] * vx[i] + ny[i] * vy[i] + nz[i] * vz[i] >= np.float32(0.0) else -one
        nx[i], ny[i], nz[i] = turn * nx[i], turn * ny[i], turn * nz[i]
        # Find the heights, and which of them are rounding.
        rise_a[i] = nx[i] * ax[i] + ny[i] * ay[i] + nz[i] * az[i]
        rise_b[i] = nx[i] * bx[i] + ny[i] * by[i] + nz[i] * bz[i]
        rise_c[i] = nx[i] * cx[i] + ny[i] * cy[i] + nz[i] * cz[i]
        slack[i] = snap * (abs(rise_a[i]) + abs(rise_b[i]))
        slope = (abs(rise_a[i]) + abs(rise_b[i])) / (abs(rise_c[i]) + LEAST)
        step = np.sqrt(ax[i] * ax[i] + ay[i] * ay[i] + az[i] * az[i])
        deep = np.sqrt(cx[i] * cx[i] + cy[i] * cy[i] + cz[i] * cz[i]) + LEAST
        tolerance[i] = SLOPES_APART * slope + FOOTPRINTS_APART * step / deep
        tolerance[i] += two * DEPTH_ROUNDING * abs(depth[i])
        blocked[i], full[i] = np.float32(0.0), np.float32(0.0)


@disjoint_stage
def place_slice(
    turned, dx, dy, nx, ny, nz, vx, vy, vz, ax, ay, az, bx, by, bz, cx, cy, cz, pw, way_a, way_b,
    way_c, share, stretch, eye_cosine, eye_sine, reach, ahead, behind,
):  # fmt: skip
    """Lay a slice along the direction of each pixel, or at a right angle to it if ``turned``."""
    one = np.float32(1.0)
    for i in range(dx.shape[0]):
        right = (one - turned) * dx[i] - turned * dy[i]
        low = (one - turned) * dy[i] + turned * dx[i]
        # Find the axis of the slice that is at a right angle to the line of sight.
        ex, ey, ez = (
            right * ax[i] + low * bx[i], right * ay[i] + low * by[i], right * az[i] + low * bz[i]
        )  # fmt: skip
        along = ex * vx[i] + ey * vy[i] + ez * vz[i]
        ex, ey, ez = ex - along * vx[i], ey - along * vy[i], ez - along * vz[i]
        length = np.sqrt(ex * ex + ey * ey + ez * ez)
        scale = one / (length + LEAST)
        ex, ey, ez = ex * scale, ey * scale, ez * scale
        reach[i] = min(pw[i] * scale, FARTHEST_STEP)
        # Find the normal in the slice, and the way in the face's plane.
        n_along = nx[i] * ex + ny[i] * ey + nz[i] * ez
        n_toward = nx[i] * vx[i] + ny[i] * vy[i] + nz[i] * vz[i]
        share[i] = np.sqrt(n_along * n_along + n_toward * n_toward)
        stretch[i] = one / (share[i] + LEAST)
        eye_cosine[i], eye_sine[i] = -n_along * stretch[i], n_toward * stretch[i]
        tx = eye_sine[i] * ex + eye_cosine[i] * vx[i]
        ty = eye_sine[i] * ey + eye_cosine[i] * vy[i]
        tz = eye_sine[i] * ez + eye_cosine[i] * vz[i]
        way_a[i] = tx * ax[i] + ty * ay[i] + tz * az[i]
        way_b[i] = tx * bx[i] + ty * by[i] + tz * bz[i]
        way_c[i] = tx * cx[i] + ty * cy[i] + tz * cz[i]
        ahead[i], behind[i] = one, one


@disjoint_stage
def raise_horizon(
    side, turned, number, row, lens, size, depths, dx, dy, jitter, column, depth, pw, rise_a,
    rise_b, rise_c, slack, way_a, way_b, way_c, stretch, reach, horizon,
):  # fmt: skip
    """Take one sample for each pixel, on one side of its slice."""
    across, down, deeper, _ = lens
    zero, half, one, two = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
    for i in range(column.shape[0]):
        # Find the pixel to look at.
        part = (number + jitter[i]) * np.float32(1.0 / STEPS)
        step = side * (one + max(reach[i] - one, zero) * part * part)
        right = np.floor(step * ((one - turned) * dx[i] - turned * dy[i]) + half)
        low = np.floor(step * ((one - turned) * dy[i] + turned * dx[i]) + half)
        x, y = column[i] + right, row + low
        is_inside = (x >= zero) & (x < size[0]) & (y >= zero) & (y < size[1])
        x, y = min(max(x, zero), size[0] - one), min(max(y, zero), size[1] - one)
        place = np.uint32(np.uint32(np.int32(y)) * np.uint32(size[0]) + np.uint32(np.int32(x)))
        there = depths[np.uintp(place & np.uint32(0x7FFFFFFF))]
        is_inside = is_inside & (there > np.float32(-np.inf))
        # Find how far along the plane it is, and how high above.
        change = there - depth[i] if is_inside else zero
        flat = side * (right * way_a[i] + low * way_b[i] + change * way_c[i])
        rounding = DEPTH_ROUNDING * (abs(there) + abs(depth[i])) * abs(rise_c[i])
        height = right * rise_a[i] + low * rise_b[i] + change * rise_c[i] - slack[i] - rounding
        high = height * stretch[i]
        squared = flat * flat + high * high + LEAST
        length = np.sqrt(squared)
        # Let what is farther away than the radius count for nothing.
        w = pw[i] + right * across[3] + low * down[3] + change * deeper[3]
        scale = one / (length * w * w)
        weight = min(one, two - two * squared * length * scale)
        cosine = flat * w * w * scale
        is_above = is_inside & (height > zero) & (weight > zero)
        faded = one - weight * (one - cosine)
        horizon[i] = min(horizon[i], faded) if is_above else horizon[i]


@disjoint_stage
def add_slice(ahead, behind, share, eye_cosine, eye_sine, blocked, full):
    """Add up what the horizons on both sides block, and the light there would be without."""
    for i in range(blocked.shape[0]):
        cosine, sine = eye_cosine[i], eye_sine[i]
        angle = arc_cosine(cosine)
        back = PI_HALF + PI_HALF - angle
        blocked[i] += share[i] * blocked_share(ahead[i], cosine, sine, angle)
        blocked[i] += share[i] * blocked_share(behind[i], -cosine, sine, back)
        full[i] += share[i] * (sine + (PI_HALF - angle) * cosine)


@stage
def look_around(s, count, row, lens, size, depths, turned):
    """Find what one slice of each pixel blocks."""
    place_slice(
        turned, s[STEP_ACROSS, :count], s[STEP_DOWN, :count],
        s[NORMAL, :count], s[NORMAL + 1, :count], s[NORMAL + 2, :count],
        s[TOWARD, :count], s[TOWARD + 1, :count], s[TOWARD + 2, :count],
        s[ACROSS, :count], s[ACROSS + 1, :count], s[ACROSS + 2, :count],
        s[DOWN, :count], s[DOWN + 1, :count], s[DOWN + 2, :count],
        s[DEEPER, :count], s[DEEPER + 1, :count], s[DEEPER + 2, :count],
        s[PW, :count], s[WAY_ACROSS, :count], s[WAY_DOWN, :count], s[WAY_DEEPER, :count],
        s[SHARE, :count], s[STRETCH, :count], s[EYE_COSINE, :count], s[EYE_SINE, :count],
        s[REACH, :count], s[AHEAD, :count], s[BEHIND, :count],
    )  # fmt: skip
    for side in range(2):
        for number in range(STEPS):
            raise_horizon(
                np.float32(1 - 2 * side), turned, np.float32(number), row, lens, size, depths,
                s[STEP_ACROSS, :count], s[STEP_DOWN, :count], s[JITTER, :count],
                s[COLUMN, :count], s[DEPTH, :count], s[PW, :count],
                s[RISE_ACROSS, :count], s[RISE_DOWN, :count], s[RISE_DEEPER, :count],
                s[SLACK, :count], s[WAY_ACROSS, :count], s[WAY_DOWN, :count],
                s[WAY_DEEPER, :count], s[STRETCH, :count], s[REACH, :count],
                s[AHEAD + side, :count],
            )  # fmt: skip
    add_slice(
        s[AHEAD, :count], s[BEHIND, :count], s[SHARE, :count], s[EYE_COSINE, :count],
        s[EYE_SINE, :count], s[BLOCKED, :count], s[OPEN, :count],
    )  # fmt: skip


@stage
def write_block(s, count, faces, occlusion, tolerance):
    """Write the share of light that gets through; 1 where nothing is."""
    n = np.uintp(0)
    for at in range(np.uintp(faces.shape[0])):
        occlusion[at], tolerance[at] = np.float32(1.0), np.float32(0.0)
        if faces[at] < 0:
            continue
        blocked, full = s[BLOCKED, n], s[OPEN, n]
        if full > np.float32(0.0):
            occlusion[at] = max(np.float32(1.0) - blocked / full, np.float32(0.0))
        tolerance[at] = s[TOLERANCE, n]
        n += np.uintp(1)


def scratch_memory() -> tuple[Any, Any]:
    """Return the memory that a thread needs."""
    # A few columns more, so that rows do not lie a power of two apart in the cache.
    rows = np.empty((SCRATCH_ROWS, BLOCK_COLUMNS + 16), np.float32)
    return rows, np.empty((4, 4), np.float32)


@kernel
def find_occlusion(
    face_id, rows, depth, geometry: Geometry, placement: Placement, lens, snap, pattern, occlusion,
    tolerance, scratch,
):  # fmt: skip
    """
    Find the share of light from all around that reaches each pixel, before it is smoothed.

    Parameters
    ----------
    face_id : (H, W) int32
    rows : (int, int)
        The first row, and one past the last.
    depth : (H, W) float32, C-contiguous
        Stored depth; -inf where nothing is.
    geometry, placement : records
    lens : (4, 4) float32
        See ``lenses``; in units of the radius.
    snap : float
        Height that counts as none, as a share of that from one pixel to the next.
    pattern : (4, 4, 3) float32
        `screen_pattern`.
    occlusion : (H, W) float32
        Writes these rows: 1 where all light arrives, and where nothing is; 0 for none.
    tolerance : (H, W) float32
        Writes these rows: how much the stored depth of the same surface may differ nearby.
    scratch : tuple
        This thread's own, from `scratch_memory`.
    """
    s, viewer = scratch[0], scratch[1][0]
    for k in range(4):
        viewer[k] = np.float32(placement.toward_viewer[k])
    height, width = face_id.shape
    depths, size = depth.reshape(-1), (np.float32(width), np.float32(height))
    parts = lens[0], lens[1], lens[2], lens[3]
    for row in range(rows[0], rows[1]):
        for left in range(0, width, BLOCK_COLUMNS):
            right = min(left + BLOCK_COLUMNS, width)
            faces = face_id[row, left:right]
            count = gather_faces(
                faces, depth[row, left:right], left, row, pattern, s, geometry, placement
            )
            down = np.float32(row)
            place_block(
                down, parts, viewer, np.float32(snap),
                s[COLUMN, :count], s[DEPTH, :count], s[PW, :count],
                s[NORMAL, :count], s[NORMAL + 1, :count], s[NORMAL + 2, :count],
                s[TOWARD, :count], s[TOWARD + 1, :count], s[TOWARD + 2, :count],
                s[ACROSS, :count], s[ACROSS + 1, :count], s[ACROSS + 2, :count],
                s[DOWN, :count], s[DOWN + 1, :count], s[DOWN + 2, :count],
                s[DEEPER, :count], s[DEEPER + 1, :count], s[DEEPER + 2, :count],
                s[RISE_ACROSS, :count], s[RISE_DOWN, :count], s[RISE_DEEPER, :count],
                s[SLACK, :count], s[BLOCKED, :count], s[OPEN, :count], s[TOLERANCE, :count],
            )  # fmt: skip
            for slice_number in range(2):
                turned = np.float32(slice_number)
                look_around(s, count, down, parts, size, depths, turned)
            write_block(s, count, faces, occlusion[row, left:right], tolerance[row, left:right])


@disjoint_stage
def add_neighbour(mine, tolerance, theirs, found, total, number):
    """Add a neighbour's value where it is on the same surface."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(mine.shape[0]):
        is_same = abs(theirs[i] - mine[i]) <= tolerance[i]
        total[i] += found[i] if is_same else zero
        number[i] += one if is_same else zero


@disjoint_stage
def finish_row(total, number, strength, smooth):
    """Write the means."""
    one = np.float32(1.0)
    for i in range(smooth.shape[0]):
        mean = total[i] / max(number[i], one) if number[i] > np.float32(0.0) else one
        smooth[i] = one - strength * (one - mean)


@kernel
def smooth_occlusion(occlusion, rows, first, depth, tolerance, strength, smooth, scratch):
    """
    Average over the pixels of a square that show the same surface.

    Parameters
    ----------
    occlusion : (H, W) float32
    rows : (int, int)
        The first row, and one past the last.
    first : int
        Where the square begins, in x and in y, relative to the pixel: -2 or -1, one after the
        other to be symmetrical.
    depth : (H, W) float32, stored depth
    tolerance : (H, W) float32
        How much the depth may differ on one surface.
    strength : float
        Share of the effect that is kept, 0..1.
    smooth : (H, W) float32
        Writes these rows.
    scratch : (2, W) float32
        This thread's own.
    """
    height, width = occlusion.shape
    total, number = scratch[0], scratch[1]
    for row in range(rows[0], rows[1]):
        for i in range(np.uintp(width)):
            total[i], number[i] = np.float32(0.0), np.float32(0.0)
        for down in range(first, first + PATTERN):
            there = row + down
            if there < 0 or there >= height:
                continue
            for across in range(first, first + PATTERN):
                begin, end = max(0, -across), max(min(width, width - across), 0)
                add_neighbour(
                    depth[row, begin:end], tolerance[row, begin:end],
                    depth[there, begin + across : end + across],
                    occlusion[there, begin + across : end + across],
                    total[begin:end], number[begin:end],
                )  # fmt: skip
        finish_row(total, number, np.float32(strength), smooth[row])
