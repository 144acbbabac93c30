"""
Compute screen-space ambient occlusion by horizons (GTAO): the visibility of ambient light.

Planes through the view ray cut the hemisphere above a surface into slices. In each, on both sides
of the ray, depth samples along a line on the screen give the horizon's elevation; light from below
is blocked, and its cosine-weighted integral has a closed form.
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

from typing import NamedTuple

import numpy as np

from rasterjit.pipeline.geometry.barycentric import compute_face_normal, find_object
from rasterjit.pipeline.geometry.setup import get_face_vertices
from rasterjit.pipeline.geometry.unproject import scaled_derivative, unproject_pixel
from rasterjit.pipeline.lighting.light_stages import read_interval
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.sample_block import MAX_VECTOR_SAMPLES, Block
from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.intrinsics import call_bound, flat, part
from rasterjit.runtime.jit import Bound, disjoint_helper, helper, kernel, stage
from rasterjit.runtime.state_block import float32, float64, int32, int64

BLOCK_COLUMNS = 128
"""Columns of a block: their scratch memory stays in a core's own cache."""

SIDE_SAMPLES = 4
"""Samples on each side of a slice."""

MAX_STEP_PX = np.float32(256.0)
"""Longest step on the screen, pixels: beyond, samples would miss most of what lies between."""

PATTERN_SIDE = 4
"""Side of the square of pixels that holds every direction and step length once."""

DEPTH_ROUNDING = np.float32(2.0**-22)
"""Slack for the rounding of a float32 depth and of the arithmetic with it, as a share of it."""

TINY = np.float32(1e-30)
"""Added to divisors and under roots; far below any length in units of the radius."""

PI_HALF = np.float32(1.5707963)

MAX_SLOPES = np.float32(2.0)
MAX_FOOTPRINTS = np.float32(2.0)
"""Pixels average if their depths differ by less than this many slopes and footprints of a pixel."""

ROW_LENGTH = BLOCK_COLUMNS + 16
"""Length of a row of scratch, padded, so that rows are not a power of two apart in a cache."""

(
    COLUMN, DEPTH, PW, NX, NY, NZ, VX, VY, VZ, AX, AY, AZ, BX, BY, BZ, CX, CY, CZ, RISE_A, RISE_B,
    RISE_C, SLACK, ALONG_A, ALONG_B, ALONG_C, N_LENGTH, EYE_COSINE, EYE_SINE, RADIUS, HORIZON_0,
    HORIZON_1, STEP_X, STEP_Y, JITTER, BLOCKED, OPEN, TOLERANCE, INV_LENGTH, DX, DY, DZ, HEIGHT,
) = (row * ROW_LENGTH for row in range(42))  # fmt: skip
"""
Where the rows of scratch begin. They lie a constant apart, so that loops over several vectorize.

- COLUMN, DEPTH, PW: column, stored depth, and how a homogeneous length becomes one in radii.
- N: normal of the face, toward the viewer, world axes. V: unit vector to the viewer.
- A, B, C: way to the surface at the next column, the next row, and the next unit of depth; RISE:
  height of those above the face's plane; ALONG: their length along the slice, in that plane.
- SLACK: height that counts as none.
- N_LENGTH, INV_LENGTH: length of the normal in the slice, and one over it; EYE: elevation of the
  line of sight; RADIUS: radius in pixels.
- HORIZON_0, HORIZON_1: cosine of the horizon's elevation on both sides.
- STEP, JITTER: direction on the screen, and how far into its length a step begins.
- BLOCKED, OPEN: sums over the slices.
- DX, DY, DZ: way to a sample, in columns, rows and stored depth; HEIGHT: how high above the
  plane it is, 0 where it is not.
- TOLERANCE: largest difference of depth to pixels of the same surface.
"""

SCRATCH_SIZE = HEIGHT + ROW_LENGTH


def make_screen_pattern() -> np.ndarray:
    """
    Return direction and step offset of each pixel of a square, (4, 4, 3) float32.

    Directions are (k + 1/2) / 32 of a half turn for k in 0..15; the second slice is at a right
    angle. Offsets are in 0..1, in an order unlike that of the directions.
    """
    cosine, sine = 0.9951847266721969, 0.0980171403295606  # of 1 / 32 of a half turn
    x, y = 0.9987954562051724, 0.049067674327418015  # of half of that
    directions = []
    for _ in range(PATTERN_SIDE * PATTERN_SIDE):
        directions.append((x, y))
        x, y = x * cosine - y * sine, x * sine + y * cosine
    # Neighbours in x, y and on diagonals look in directions that lie far apart.
    order = (0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5)
    step_order = (0, 5, 10, 15, 7, 2, 13, 8, 14, 11, 4, 1, 9, 12, 3, 6)
    table = [(*directions[k], (n + 0.5) / 16.0) for k, n in zip(order, step_order, strict=True)]
    return np.array(table, np.float32).reshape(PATTERN_SIDE, PATTERN_SIDE, 3)


@helper
def compute_arc_cosine(x):
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


@helper
def blocked_light(horizon, eye_cosine, eye_sine, eye_angle):
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
    angle = min(compute_arc_cosine(cosine), eye_angle)
    light = np.float32(0.5) * (np.float32(0.5) * swing - angle * eye_cosine)
    return max(light, np.float32(0.0))


@helper
def gather_faces(faces, depth, left, s, geometry, placement):
    """
    Write column, depth and normal of the covered pixels; return how many there are.

    The last one is there once more, until vectors are full.
    """
    count, last_face, owner = np.int64(0), np.int64(-1), np.int64(0)
    x = y = z = np.float32(0.0)
    for column in range(np.uintp(faces.shape[0])):
        face = np.int64(faces[column])
        if face < 0:
            continue
        if face != last_face:
            last_face = face
            owner = find_object(face, placement.face_starts, owner)
            a, b, c = get_face_vertices(geometry.faces, face)
            normal = compute_face_normal(a, b, c, owner, placement)
            x, y, z = np.float32(normal[0]), np.float32(normal[1]), np.float32(normal[2])
        s[COLUMN + count], s[DEPTH + count] = np.float32(left + np.int64(column)), depth[column]
        s[NX + count], s[NY + count], s[NZ + count] = x, y, z
        count += 1
    while count % MAX_VECTOR_SAMPLES != 0:
        s[COLUMN + count], s[DEPTH + count] = s[COLUMN + count - 1], s[DEPTH + count - 1]
        s[NX + count], s[NY + count], s[NZ + count] = x, y, z
        count += 1
    return count


@disjoint_helper
def set_up_block(s, count, row, matrix, viewer, snap_slack, pattern):
    """Find how points and heights change with column (a), row (b) and stored depth (c)."""
    one, two = np.float32(1.0), np.float32(2.0)
    matrix_rows = matrix[0], matrix[1], matrix[2], matrix[3]
    for i in range(min(count, BLOCK_COLUMNS)):
        # Find the point, in radii, relative to the eye.
        depth = s[DEPTH + i]
        x, y, z, s[PW + i] = unproject_pixel(matrix_rows, s[COLUMN + i], row, depth)
        ax, ay, az = scaled_derivative(matrix_rows[0], x, y, z)
        bx, by, bz = scaled_derivative(matrix_rows[1], x, y, z)
        cx, cy, cz = scaled_derivative(matrix_rows[2], x, y, z)
        # Turn the normal toward the viewer.
        ex, ey, ez = viewer[0] - viewer[3] * x, viewer[1] - viewer[3] * y, viewer[2] - viewer[3] * z
        scale = one / np.sqrt(ex * ex + ey * ey + ez * ez + TINY)
        vx, vy, vz = ex * scale, ey * scale, ez * scale
        nx, ny, nz = s[NX + i], s[NY + i], s[NZ + i]
        sign = one if nx * vx + ny * vy + nz * vz >= np.float32(0.0) else -one
        nx, ny, nz = sign * nx, sign * ny, sign * nz
        # Find the heights, and which of them are rounding.
        rise_a = nx * ax + ny * ay + nz * az
        rise_b = nx * bx + ny * by + nz * bz
        rise_c = nx * cx + ny * cy + nz * cz
        slope = (abs(rise_a) + abs(rise_b)) / (abs(rise_c) + TINY)
        step = np.sqrt(ax * ax + ay * ay + az * az)
        deep = np.sqrt(cx * cx + cy * cy + cz * cz) + TINY
        tolerance = MAX_SLOPES * slope + MAX_FOOTPRINTS * step / deep
        s[SLACK + i] = snap_slack * (abs(rise_a) + abs(rise_b))
        s[TOLERANCE + i] = tolerance + two * DEPTH_ROUNDING * abs(depth)
        s[NX + i], s[NY + i], s[NZ + i] = nx, ny, nz
        s[VX + i], s[VY + i], s[VZ + i] = vx, vy, vz
        s[AX + i], s[AY + i], s[AZ + i] = ax, ay, az
        s[BX + i], s[BY + i], s[BZ + i] = bx, by, bz
        s[CX + i], s[CY + i], s[CZ + i] = cx, cy, cz
        s[RISE_A + i], s[RISE_B + i], s[RISE_C + i] = rise_a, rise_b, rise_c
        s[BLOCKED + i], s[OPEN + i] = np.float32(0.0), np.float32(0.0)
        cell = np.uintp(np.int32(s[COLUMN + i]) % np.int32(PATTERN_SIDE) * np.int32(3))
        s[STEP_X + i], s[STEP_Y + i] = pattern[cell], pattern[cell + np.uintp(1)]
        s[JITTER + i] = pattern[cell + np.uintp(2)]


@disjoint_helper
def set_up_slice(s, count, quarter_turns):
    """Set up a slice along each pixel's direction, turned by ``quarter_turns``."""
    one = np.float32(1.0)
    for i in range(min(count, BLOCK_COLUMNS)):
        right = (one - quarter_turns) * s[STEP_X + i] - quarter_turns * s[STEP_Y + i]
        down = (one - quarter_turns) * s[STEP_Y + i] + quarter_turns * s[STEP_X + i]
        nx, ny, nz = s[NX + i], s[NY + i], s[NZ + i]
        vx, vy, vz = s[VX + i], s[VY + i], s[VZ + i]
        ax, ay, az = s[AX + i], s[AY + i], s[AZ + i]
        bx, by, bz = s[BX + i], s[BY + i], s[BZ + i]
        cx, cy, cz = s[CX + i], s[CY + i], s[CZ + i]
        # Find the axis of the slice that is at a right angle to the line of sight.
        ex, ey, ez = right * ax + down * bx, right * ay + down * by, right * az + down * bz
        along = ex * vx + ey * vy + ez * vz
        ex, ey, ez = ex - along * vx, ey - along * vy, ez - along * vz
        length = np.sqrt(ex * ex + ey * ey + ez * ez)
        scale = one / (length + TINY)
        ex, ey, ez = ex * scale, ey * scale, ez * scale
        s[RADIUS + i] = min(s[PW + i] * scale, MAX_STEP_PX)
        # Find the normal in the slice, and the way in the face's plane.
        n_along = nx * ex + ny * ey + nz * ez
        n_toward = nx * vx + ny * vy + nz * vz
        n_length = np.sqrt(n_along * n_along + n_toward * n_toward)
        inverse = one / (n_length + TINY)
        cosine, sine = -n_along * inverse, n_toward * inverse
        tx, ty, tz = sine * ex + cosine * vx, sine * ey + cosine * vy, sine * ez + cosine * vz
        s[N_LENGTH + i], s[INV_LENGTH + i] = n_length, inverse
        s[EYE_COSINE + i], s[EYE_SINE + i] = cosine, sine
        s[ALONG_A + i] = tx * ax + ty * ay + tz * az
        s[ALONG_B + i] = tx * bx + ty * by + tz * bz
        s[ALONG_C + i] = tx * cx + ty * cy + tz * cz
        s[HORIZON_0 + i], s[HORIZON_1 + i] = one, one


@disjoint_helper
def sample_heights(s, count, side, quarter_turns, sample, row, size, depths):
    """Sample one height per pixel, on one side of its slice; return 1 if any is above 0."""
    zero, half, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    any_above = np.int32(0)
    for i in range(min(count, BLOCK_COLUMNS)):
        # Find the pixel to sample.
        part = (sample + s[JITTER + i]) * np.float32(1.0 / SIDE_SAMPLES)
        step = side * (one + max(s[RADIUS + i] - one, zero) * part * part)
        dx, dy, depth = s[STEP_X + i], s[STEP_Y + i], s[DEPTH + i]
        right = np.floor(step * ((one - quarter_turns) * dx - quarter_turns * dy) + half)
        down = np.floor(step * ((one - quarter_turns) * dy + quarter_turns * dx) + half)
        x, y = s[COLUMN + i] + right, row + down
        is_inside = (x >= zero) & (x < size[0]) & (y >= zero) & (y < size[1])
        x, y = clamped(x, zero, size[0] - one), clamped(y, zero, size[1] - one)
        pixel = np.uint32(np.uint32(np.int32(y)) * np.uint32(size[0]) + np.uint32(np.int32(x)))
        other = depths[np.uintp(pixel & np.uint32(0x7FFFFFFF))]
        is_inside = is_inside & (other > np.float32(-np.inf))
        # Find how high above the plane it is.
        dz = other - depth if is_inside else zero
        rise_c = s[RISE_C + i]
        rounding = DEPTH_ROUNDING * (abs(other) + abs(depth)) * abs(rise_c)
        height = right * s[RISE_A + i] + down * s[RISE_B + i] + dz * rise_c
        height = height - s[SLACK + i] - rounding
        is_above = is_inside & (height > zero)
        any_above = np.int32(any_above | np.int32(is_above))
        s[HEIGHT + i] = height if is_above else zero
        s[DX + i], s[DY + i], s[DZ + i] = right, down, dz
    return any_above


@disjoint_helper
def raise_horizon(s, count, side, matrix, horizon):
    """Raise each pixel's horizon to its sample, where that is above its plane."""
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    w_per_column, w_per_row, w_per_depth = matrix[0, 3], matrix[1, 3], matrix[2, 3]
    for i in range(min(count, BLOCK_COLUMNS)):
        height, right, down, dz = s[HEIGHT + i], s[DX + i], s[DY + i], s[DZ + i]
        # Find how far along the plane it is.
        along = side * (right * s[ALONG_A + i] + down * s[ALONG_B + i] + dz * s[ALONG_C + i])
        w = s[PW + i] + right * w_per_column + down * w_per_row + dz * w_per_depth
        above = height * s[INV_LENGTH + i]
        squared = along * along + above * above + TINY
        length = np.sqrt(squared)
        # Ignore samples beyond the radius.
        scale = one / (length * w * w)
        weight = min(one, two - two * squared * length * scale)
        cosine = along * w * w * scale
        is_above = (height > zero) & (weight > zero)
        faded = one - weight * (one - cosine)
        horizon[i] = min(horizon[i], faded) if is_above else horizon[i]


@disjoint_helper
def add_slice(s, count):
    """Add the light that the horizons on both sides block, and the light without them."""
    for i in range(min(count, BLOCK_COLUMNS)):
        cosine, sine, n_length = s[EYE_COSINE + i], s[EYE_SINE + i], s[N_LENGTH + i]
        angle = compute_arc_cosine(cosine)
        back = PI_HALF + PI_HALF - angle
        blocked = s[BLOCKED + i] + n_length * blocked_light(s[HORIZON_0 + i], cosine, sine, angle)
        s[BLOCKED + i] = blocked + n_length * blocked_light(s[HORIZON_1 + i], -cosine, sine, back)
        s[OPEN + i] += n_length * (sine + (PI_HALF - angle) * cosine)


@helper
def write_block(s, faces, occlusion, tolerance):
    """Write visibility and tolerance; 1 and 0 where nothing is, 1 beyond the range of float32."""
    pixel = np.int64(0)
    for column in range(np.uintp(faces.shape[0])):
        occlusion[column], tolerance[column] = np.float32(1.0), np.float32(0.0)
        if faces[column] < 0:
            continue
        blocked, unblocked = s[BLOCKED + pixel], s[OPEN + pixel]
        if unblocked > np.float32(0.0):
            fraction = max(np.float32(0.0), blocked / unblocked)
            occlusion[column] = max(np.float32(1.0) - fraction, np.float32(0.0))
        tolerance[column] = s[TOLERANCE + pixel]
        pixel += 1


@kernel
def trace_horizons(
    request: int64[::1], depth: float32[:, ::1], matrix: float32[:, ::1], s: float32[::1]
):  # fmt: skip
    """
    Find the light that both slices block at the pixels of a block.

    Parameters
    ----------
    request : (2,) int64
        How many pixels there are, and their row.
    depth, matrix : arrays
        As `find_occlusion` takes them.
    s : float32
        Scratch, as `set_up_block` left it; changes rows BLOCKED and OPEN.
    """
    count, row, depths = request[0], np.float32(request[1]), flat(depth)
    size = np.float32(depth.shape[1]), np.float32(depth.shape[0])
    for slice_number in range(2):
        quarter_turns = np.float32(slice_number)
        set_up_slice(s, count, quarter_turns)
        for n in range(2 * SIDE_SAMPLES):
            side, sample = np.float32(1 - 2 * (n // SIDE_SAMPLES)), np.float32(n % SIDE_SAMPLES)
            horizon = HORIZON_0 + (n // SIDE_SAMPLES) * ROW_LENGTH
            if sample_heights(s, count, side, quarter_turns, sample, row, size, depths) != 0:
                raise_horizon(s, count, side, matrix, s[horizon : horizon + count])
        add_slice(s, count)


class Scratch(NamedTuple):
    """The memory that a thread needs to find occlusion; keep its `Bound` kernel as long."""

    horizons: int64[::1]
    """(2,): address and arguments of a bound `trace_horizons`."""
    request: int64[::1]
    block: float32[::1]
    viewer: float32[::1]


def make_scratch(depth: np.ndarray, matrix: np.ndarray) -> tuple[Bound, Scratch]:
    """Return `trace_horizons`, bound to a picture and this thread's memory, and that memory."""
    request, block = np.empty(2, np.int64), np.empty(SCRATCH_SIZE, np.float32)
    bound = Bound(trace_horizons, request, depth, matrix, block)
    return bound, Scratch(bound.words, request, block, np.empty(4, np.float32))


@kernel
def find_occlusion(
    face_id: int32[:, ::1], rows: (int64, int64), depth: float32[:, ::1], geometry: Geometry,
    placement: Placement, matrix: float32[:, ::1], snap_slack: float64, pattern: float32[:, :, ::1],
    occlusion: float32[:, ::1], tolerance: float32[:, ::1], scratch: Scratch,
):  # fmt: skip
    """
    Compute the ambient visibility of each pixel, before smoothing.

    Parameters
    ----------
    face_id : (H, W) int32
    rows : (int, int)
        The first row, and one past the last.
    depth : (H, W) float32, C-contiguous
        Stored depth; -inf where nothing is.
    geometry, placement : records
    matrix : (4, 4) float32
        See ``unproject``; in units of the radius.
    snap_slack : float
        Height that counts as none, as a share of that from one pixel to the next.
    pattern : (4, 4, 3) float32
        `make_screen_pattern`.
    occlusion : (H, W) float32
        Writes these rows: 1 where all light arrives, and where nothing is; 0 for none.
    tolerance : (H, W) float32
        Writes these rows: how much the stored depth of the same surface may differ nearby.
    scratch : Scratch
        This thread's own, from `make_scratch`.
    """
    s, viewer = scratch.block, scratch.viewer
    for k in range(4):
        viewer[k] = np.float32(placement.toward_viewer[k])
    width = face_id.shape[1]
    for row in range(rows[0], rows[1]):
        for left in range(0, width, BLOCK_COLUMNS):
            right = min(left + BLOCK_COLUMNS, width)
            faces = part(face_id, row, left, right)
            count = gather_faces(faces, part(depth, row, left, right), left, s, geometry, placement)
            pattern_row = flat(pattern[row % PATTERN_SIDE])
            set_up_block(
                s, count, np.float32(row), matrix, viewer, np.float32(snap_slack), pattern_row
            )
            scratch.request[0], scratch.request[1] = count, row
            call_bound(scratch.horizons)
            write_block(
                s, faces, part(occlusion, row, left, right), part(tolerance, row, left, right)
            )


@disjoint_helper
def add_neighbour(depth, tolerance, other_depth, values, total, counts):
    """Add the values of neighbours on the same surface."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(depth.shape[0]):
        is_same = abs(other_depth[i] - depth[i]) <= tolerance[i]
        total[i] += values[i] if is_same else zero
        counts[i] += one if is_same else zero


@disjoint_helper
def add_four_neighbours(depth, tolerance, a, b, c, d, of_a, of_b, of_c, of_d, total, counts):
    """Add four neighbours as `add_neighbour` does, one after the other."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(depth.shape[0]):
        own_depth, own_tolerance, summed, count = depth[i], tolerance[i], total[i], counts[i]
        is_a, is_b = abs(a[i] - own_depth) <= own_tolerance, abs(b[i] - own_depth) <= own_tolerance
        is_c, is_d = abs(c[i] - own_depth) <= own_tolerance, abs(d[i] - own_depth) <= own_tolerance
        summed += of_a[i] if is_a else zero
        summed += of_b[i] if is_b else zero
        summed += of_c[i] if is_c else zero
        summed += of_d[i] if is_d else zero
        count += (one if is_a else zero) + (one if is_b else zero)
        count += (one if is_c else zero) + (one if is_d else zero)
        total[i], counts[i] = summed, count


@helper
def find_covered_columns(depth):
    """Return the first covered column of a row, and one past the last."""
    first, end = np.int64(0), np.int64(depth.shape[0])
    while first < end and depth[np.uintp(first)] == np.float32(-np.inf):
        first += 1
    while end > first and depth[np.uintp(end - 1)] == np.float32(-np.inf):
        end -= 1
    return first, end


@helper
def add_neighbour_row(row, source, first, begin, end, depth, tolerance, occlusion, total, counts):
    """Add the neighbours in row ``source`` of the columns from ``begin`` to ``end``."""
    low, high = max(begin, -first), min(end, depth.shape[1] - first - PATTERN_SIDE + 1)
    if low < high:
        add_four_neighbours(
            part(depth, row, low, high), part(tolerance, row, low, high),
            part(depth, source, low + first, high + first),
            part(depth, source, low + first + 1, high + first + 1),
            part(depth, source, low + first + 2, high + first + 2),
            part(depth, source, low + first + 3, high + first + 3),
            part(occlusion, source, low + first, high + first),
            part(occlusion, source, low + first + 1, high + first + 1),
            part(occlusion, source, low + first + 2, high + first + 2),
            part(occlusion, source, low + first + 3, high + first + 3),
            total[low:high], counts[low:high],
        )  # fmt: skip
    else:
        low = high = end
    # At the sides of the picture, some neighbours are beyond it.
    for start, stop in ((begin, low), (high, end)):
        for offset in range(first, first + PATTERN_SIDE):
            left, right = max(start, -offset), min(stop, depth.shape[1] - offset)
            if left < right:
                add_neighbour(
                    part(depth, row, left, right), part(tolerance, row, left, right),
                    part(depth, source, left + offset, right + offset),
                    part(occlusion, source, left + offset, right + offset),
                    total[left:right], counts[left:right],
                )  # fmt: skip


@disjoint_helper
def write_mean_row(total, counts, strength, smooth):
    """Write the mean visibility of a row."""
    one = np.float32(1.0)
    for i in range(smooth.shape[0]):
        mean = total[i] / max(counts[i], one) if counts[i] > np.float32(0.0) else one
        smooth[i] = one - strength * (one - mean)


@kernel
def smooth_occlusion(
    occlusion: float32[:, ::1], rows: (int64, int64), first: int64, depth: float32[:, ::1],
    tolerance: float32[:, ::1], strength: float64, smooth: float32[:, ::1],
    scratch: float32[:, ::1],
):  # fmt: skip
    """
    Average over the pixels of a square that show the same surface.

    Parameters
    ----------
    occlusion : (H, W) float32
    rows : (int, int)
        The first row, and one past the last.
    first : int
        Where the square begins, in x and in y, relative to the pixel: -2 in one pass and -1 in
        the other, to be symmetrical.
    depth : (H, W) float32, stored depth
    tolerance : (H, W) float32
        How much the depth may differ on one surface.
    strength : float
        Share of the occlusion that is applied, 0..1.
    smooth : (H, W) float32
        Writes these rows.
    scratch : (2, W) float32
        This thread's own.
    """
    height, width = occlusion.shape
    total, counts = scratch[0], scratch[1]
    for row in range(rows[0], rows[1]):
        for i in range(np.uintp(width)):
            total[i], counts[i] = np.float32(0.0), np.float32(0.0)
        begin, end = find_covered_columns(depth[row])
        for source in range(max(row + first, 0), min(row + first + PATTERN_SIDE, height)):
            add_neighbour_row(
                row, source, first, begin, end, depth, tolerance, occlusion, total, counts
            )
        write_mean_row(total, counts, np.float32(strength), smooth[row])


@stage
def occlude_samples(block: Block, count, occlusion: float32[:, ::1]):
    """
    Multiply the share of ambient light that reaches each sample by that of its pixel.

    Parameters
    ----------
    block : Block
        Changes row OCCLUSION.
    count : int
    occlusion : (H, W) float32
        Of the frame, 0..1.
    """
    visibility = block.samples[rows.OCCLUSION]
    for k in range(block.counts[rows.INTERVAL_COUNT]):
        _, column, start, stop = read_interval(block, k)
        row = block.intervals[k, rows.INTERVAL_FRAME_ROW]
        pixels = occlusion[row, column : column + stop - start]
        for i in range(np.uintp(stop - start)):
            visibility[np.uintp(start) + i] = visibility[np.uintp(start) + i] * pixels[i]
