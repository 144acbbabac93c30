"""
Rasterize points as squares, discs and spheres into the visibility buffer.

A pixel keeps the nearest depth, and the lowest face number of equal depths, in any drawing order.
So points are drawn in memory order, without binning. Each thread draws into its own picture; these
are merged by the same rule.

Which pixels a point covers, with the snapped centre (X, Y) and the size D in units of the sub-pixel
grid, both rounded once, and pixels' centres (x, y):

- Square: ``X - D/2 <= x < X + D/2``, the same in y. That is the top-left rule of triangles:
  squares side by side share no pixel. One of a pixel or more always covers a pixel's centre.
- Disc: ``(x - X)^2 + (y - Y)^2 <= (D/2)^2``. One of a pixel or more may hold no pixel's centre;
  then it covers the pixel that a square of one pixel there would.
- Sphere: where the ray through the pixel's centre hits it, in float64, not rounded to the grid; one
  of a pixel or more covers at least one pixel, as a disc does.

Squares and discs have the depth of their centre. A sphere has the depth of the ray's first hit
beyond the near plane: if that plane cuts the sphere, its inside is seen, as of a closed mesh.

References
----------
Haines, Guenther, Akenine-Moeller, "Precision Improvements for Ray/Sphere Intersection", Ray Tracing
Gems, 2019: the distance of the centre from the ray is found as the length of a vector. Lengyel,
"Mathematics for 3D Game Programming", 2012, 10.3.4: where planes through the eye touch a sphere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rasterjit.pipeline.geometry import projection, setup
from rasterjit.pipeline.geometry.barycentric import transform_point
from rasterjit.pipeline.records import Viewport
from rasterjit.runtime.intrinsics import flat, part, prefetch, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float64, int32, int64, stored

NOT_POINTS, SQUARE, DISC, SPHERE = range(4)
"""Shapes, as ``PointRows.shapes`` numbers them."""

IN_PIXELS, IN_UNITS = range(2)
"""Units of sizes: pixels, or scene units, which shrink with distance."""

UNDRAWN_CODES = setup.NEAR | setup.FAR | setup.GUARD | setup.INVALID
"""A point with one of these outcodes is not drawn, unless it is a sphere."""

POINTS_OUTSIDE, POINTS_UNSAMPLED, POINTS_INVALID, POINTS_DRAWN = range(4)
"""Elements of the counts, and outcomes of a point."""

MAX_GRID_SIZE = float(1 << 29)
"""Largest size, sub-pixel units: larger ones cover no more pixels. Squares of twice that, and of
distances between coordinates, fit int64."""


class PointRows(NamedTuple):
    """The points among the objects of a scene, and their sizes."""

    vertex_starts: int64[::1]
    """(O+1,): object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``."""
    face_starts: int64[::1]
    """(O+1,): and faces, one for each vertex if the object consists of points."""
    shapes: int64[:, ::1]
    """(O, 2): shape, `NOT_POINTS` for other objects; unit of the sizes."""
    size_ranges: int64[:, ::1]
    """(O, 2): index of the first size in ``sizes``, and stride between points."""
    sizes: float64[::1]
    """(S,): sides and diameters, in pixels or in units of the model."""
    scales: float64[::1]
    """(O,): factors that turn sizes into pixels of this picture or scene units."""


class PointView(NamedTuple):
    """The camera's rays through pixels."""

    matrix: float64[:, ::1]
    """(4, 4): ``clip_from_relative``."""
    away: float64
    """1 or -1: sign of the ray direction that leads away from the eye."""
    across: float64
    """Width of a scene unit in the picture, pixels, where w is 1."""
    down: float64
    """Height of a scene unit, pixels."""


@helper
def find_holding_pixel(coordinate, grid_bits):
    """Return the column, or row, of the pixel that a square of one pixel around a point covers."""
    return (coordinate - 1) >> grid_bits


@helper
def find_first_centre(twice, half_and_unit):
    """Return the first column whose centre, doubled, is not below a doubled coordinate."""
    unit, bits = half_and_unit
    # Centres lie at (c + 1/2) units: 2 c unit + unit >= twice.
    return -((unit - twice) >> (bits + 1))


@helper
def depth_test(pixel, depth, face, depths, faces):
    """Depth-test a face at a pixel: nearer wins, and the lower face number at equal depth."""
    stored_depth = depths[pixel]
    if depth >= stored_depth and (depth > stored_depth or face < faces[pixel]):
        depths[pixel] = depth
        faces[pixel] = face


@helper
def to_grid_units(pixels, viewport):
    """Convert pixels to units of the sub-pixel grid, rounded."""
    units = min(pixels * np.float64(np.int64(1) << viewport.grid_bits), MAX_GRID_SIZE)
    return np.int64((units + projection.ROUNDING_OFFSET) - projection.ROUNDING_OFFSET)


@helper
def find_grid_sizes(size, unit, scale, w, view, viewport):
    """Return the width and the height of a point in units of the sub-pixel grid, rounded."""
    if unit == IN_PIXELS:
        side = to_grid_units(size * scale, viewport)
        return side, side
    pixels = size * scale / w
    return to_grid_units(pixels * view.across, viewport), to_grid_units(
        pixels * view.down, viewport
    )


@helper
def draw_square(x, y, sizes, depth, face, frame, viewport):
    """Draw a square; return its outcome."""
    (depths, faces), (wide, high) = frame, sizes
    bits = viewport.grid_bits
    grid = np.int64(1) << bits, bits
    left, right = find_first_centre(2 * x - wide, grid), find_first_centre(2 * x + wide, grid) - 1
    top, bottom = find_first_centre(2 * y - high, grid), find_first_centre(2 * y + high, grid) - 1
    is_empty = left > right or top > bottom
    left, right = max(left, np.int64(0)), min(right, viewport.width - 1)
    top, bottom = max(top, np.int64(0)), min(bottom, viewport.height - 1)
    if left > right or top > bottom:
        return POINTS_UNSAMPLED if is_empty else POINTS_OUTSIDE
    for row in range(top, bottom + 1):
        start = row * viewport.width
        for pixel in range(start + left, start + right + 1):
            depth_test(np.uintp(pixel), depth, face, depths, faces)
    return POINTS_DRAWN


@helper
def integer_sqrt(number):
    """Return the largest whole number whose square is not above a number below 2**61."""
    root = np.int64(np.sqrt(np.float64(number)))
    while root * root > number:
        root -= 1
    while (root + 1) * (root + 1) <= number:
        root += 1
    return root


@helper
def draw_one_pixel(column, row, depth, face, frame, viewport):
    """Draw the only pixel of a point."""
    if not (0 <= column < viewport.width and 0 <= row < viewport.height):
        return POINTS_OUTSIDE
    depth_test(np.uintp(row * viewport.width + column), depth, face, frame[0], frame[1])
    return POINTS_DRAWN


@helper
def is_in_disc(across, down, wide, high):
    """Return whether a doubled offset from the centre lies in a disc of this width and height."""
    if wide == high:
        return across * across + down * down <= wide * wide
    x, y = np.float64(across) / np.float64(wide), np.float64(down) / np.float64(high)
    return x * x + y * y <= 1.0


@helper
def find_half_width(down, wide, high):
    """Return a disc's doubled half width in the row at a doubled offset ``down``."""
    if wide == high:
        return integer_sqrt(wide * wide - down * down)
    y = np.float64(down) / np.float64(high)
    return np.int64(np.float64(wide) * np.sqrt(max(1.0 - y * y, 0.0)))


@helper
def draw_disc(x, y, sizes, depth, face, frame, viewport):
    """Draw a disc; return its outcome."""
    (depths, faces), (wide, high) = frame, sizes
    bits = viewport.grid_bits
    unit = np.int64(1) << bits
    grid = unit, bits
    column, row = find_holding_pixel(x, bits), find_holding_pixel(y, bits)
    # The pixel that holds the disc's centre has the nearest pixel centre.
    across, down = 2 * (column * unit - x) + unit, 2 * (row * unit - y) + unit
    if min(wide, high) < 1 or not is_in_disc(across, down, wide, high):
        if min(wide, high) >= unit:
            return draw_one_pixel(column, row, depth, face, frame, viewport)
        return POINTS_UNSAMPLED
    top = max(find_first_centre(2 * y - high, grid), np.int64(0))
    bottom = min(find_first_centre(2 * y + high + 1, grid) - 1, viewport.height - 1)
    outcome = POINTS_OUTSIDE
    for row in range(top, bottom + 1):
        half_width = find_half_width(2 * (row * unit - y) + unit, wide, high)
        left = max(find_first_centre(2 * x - half_width, grid), np.int64(0))
        right = min(find_first_centre(2 * x + half_width + 1, grid) - 1, viewport.width - 1)
        start = row * viewport.width
        for pixel in range(start + left, start + right + 1):
            depth_test(np.uintp(pixel), depth, face, depths, faces)
            outcome = POINTS_DRAWN
    return outcome


@helper
def dot3(ax, ay, az, bx, by, bz):
    """Return the dot product of two vectors."""
    return ax * bx + ay * by + az * bz


@helper
def get_clip_coordinate(matrix, row, point):
    """Return one clip coordinate of a point relative to the eye."""
    x, y, z = point
    return dot3(matrix[row, 0], matrix[row, 1], matrix[row, 2], x, y, z) + matrix[row, 3]


@helper
def get_ndc(column, row, viewport):
    """Return NDC x and y of a pixel's centre."""
    width, height = setup.get_picture_size(viewport)
    return (
        (2.0 * (viewport.left + column) + 1.0) / width - 1.0,
        1.0 - (2.0 * (viewport.top + row) + 1.0) / height,
    )


@helper
def find_nearest_ray_point(centre, ndc, view):
    """
    Return the offset from a sphere's centre to the nearest point of a ray, and the ray's direction.

    The ray is the intersection of two planes, ``r0 p = x r3 p`` and ``r1 p = y r3 p`` with rows r
    of the matrix; the centre's distances from them are differences of its clip coordinates.
    """
    m, (x, y) = view.matrix, ndc
    ax, ay, az = m[0, 0] - x * m[3, 0], m[0, 1] - x * m[3, 1], m[0, 2] - x * m[3, 2]
    bx, by, bz = m[1, 0] - y * m[3, 0], m[1, 1] - y * m[3, 1], m[1, 2] - y * m[3, 2]
    w = get_clip_coordinate(m, 3, centre)
    beside_a = get_clip_coordinate(m, 0, centre) - x * w
    beside_b = get_clip_coordinate(m, 1, centre) - y * w
    dx, dy, dz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    shrink = -1.0 / dot3(dx, dy, dz, dx, dy, dz)
    to_a, to_b = shrink * beside_a, shrink * beside_b
    offset = (
        to_a * (by * dz - bz * dy) + to_b * (dy * az - dz * ay),
        to_a * (bz * dx - bx * dz) + to_b * (dz * ax - dx * az),
        to_a * (bx * dy - by * dx) + to_b * (dx * ay - dy * ax),
    )
    along = view.away * np.sqrt(-shrink)
    return offset, (dx * along, dy * along, dz * along)


@helper
def is_between_planes(centre, offset, view):
    """Return whether a point is beyond the near plane, and whether before the far one."""
    m = view.matrix
    point = centre[0] + offset[0], centre[1] + offset[1], centre[2] + offset[2]
    z, w = get_clip_coordinate(m, 2, point), get_clip_coordinate(m, 3, point)
    return w > 0.0 and z >= -w, z <= w


@helper
def intersect_ray_with_sphere(centre, radius, ndc, view):
    """
    Intersect a ray with a sphere: return the offset from its centre to the visible hit, and a code.

    0: no visible hit; 1: hit; 2: the ray misses, and the offset leads to its nearest point.
    """
    foot, along = find_nearest_ray_point(centre, ndc, view)
    squared = radius * radius - dot3(foot[0], foot[1], foot[2], foot[0], foot[1], foot[2])
    half = np.sqrt(max(squared, 0.0))
    offset = foot[0] - half * along[0], foot[1] - half * along[1], foot[2] - half * along[2]
    is_in_front, is_before_far = is_between_planes(centre, offset, view)
    if not is_in_front:
        offset = foot[0] + half * along[0], foot[1] + half * along[1], foot[2] + half * along[2]
        is_in_front, is_before_far = is_between_planes(centre, offset, view)
    if not (is_in_front and is_before_far):
        return offset, 0
    return offset, 1 if squared >= 0.0 else 2


@helper
def find_sphere_depth(centre, offset, view, depth_coefficients):
    """Return the stored depth of a point of a sphere."""
    m = view.matrix
    point = centre[0] + offset[0], centre[1] + offset[1], centre[2] + offset[2]
    return projection.compute_stored_depth(
        get_clip_coordinate(m, 2, point), get_clip_coordinate(m, 3, point), depth_coefficients
    )


@helper
def bound_sphere(centre, radius, row, view):
    """
    Return a sphere's bounds in NDC x (row 0) or y (row 1), from tangent planes through the eye.

    Unbounded unless the whole sphere is in front of the eye.
    """
    m = view.matrix
    a, w = get_clip_coordinate(m, row, centre), get_clip_coordinate(m, 3, centre)
    aa = dot3(m[row, 0], m[row, 1], m[row, 2], m[row, 0], m[row, 1], m[row, 2])
    ww = dot3(m[3, 0], m[3, 1], m[3, 2], m[3, 0], m[3, 1], m[3, 2])
    aw = dot3(m[row, 0], m[row, 1], m[row, 2], m[3, 0], m[3, 1], m[3, 2])
    square = radius * radius
    below = w * w - square * ww
    if not (w > 0.0 and below > 0.0):
        return -np.inf, np.inf
    within = square * (w * w * aa - 2.0 * a * w * aw + a * a * ww)
    within -= square * square * (aa * ww - aw * aw)
    middle, half_extent = a * w - square * aw, np.sqrt(max(within, 0.0))
    return (middle - half_extent) / below, (middle + half_extent) / below


@helper
def find_pixels_between(low, high, length, before, count):
    """Return the first and the last pixel of a part whose centre may lie between two NDC bounds."""
    first = np.floor(min(max((low + 1.0) * 0.5 * length - before - 1.5, 0.0), np.float64(count)))
    last = np.ceil(min(max((high + 1.0) * 0.5 * length - before + 0.5, -1.0), count - 1.0))
    return np.int64(first), np.int64(last)


@helper
def is_depth_culled(centre, radius, view):
    """Return whether a sphere is wholly behind the near plane, or beyond the far one."""
    m = view.matrix
    z, w = get_clip_coordinate(m, 2, centre), get_clip_coordinate(m, 3, centre)
    nx, ny, nz = m[3, 0] + m[2, 0], m[3, 1] + m[2, 1], m[3, 2] + m[2, 2]
    fx, fy, fz = m[3, 0] - m[2, 0], m[3, 1] - m[2, 1], m[3, 2] - m[2, 2]
    near = radius * np.sqrt(dot3(nx, ny, nz, nx, ny, nz))
    far = radius * np.sqrt(dot3(fx, fy, fz, fx, fy, fz))
    # Twice the radius, for rounding.
    return z + w < -2.0 * near or w - z < -2.0 * far


@helper
def bound_nearest_depth(centre, radius, view, depth_coefficients):
    """
    Return a stored depth nearer than every point of a sphere; inf where there is no simple bound.

    A pixel whose stored depth is nearer hides the sphere.
    """
    m = view.matrix
    x, y, z = m[3, 0], m[3, 1], m[3, 2]
    sign = -1.0
    if x == 0.0 and y == 0.0 and z == 0.0:
        x, y, z = m[2, 0], m[2, 1], m[2, 2]
        sign = 1.0 if depth_coefficients[1] > 0.0 else -1.0
    elif depth_coefficients[1] != 0.0:
        return np.inf
    # With a margin for rounding, to float32 as well.
    step = sign * radius * (1.0 + 2.0**-20) / np.sqrt(dot3(x, y, z, x, y, z))
    point = centre[0] + step * x, centre[1] + step * y, centre[2] + step * z
    w = get_clip_coordinate(m, 3, point)
    if not w > 0.0:
        return np.inf
    depth = projection.compute_stored_depth(get_clip_coordinate(m, 2, point), w, depth_coefficients)
    return depth + 2.0**-20 * abs(depth)


@helper
def draw_sphere(centre, radius, face, frame, view, depth_coefficients, viewport):
    """Draw the pixels whose rays hit a sphere; return its outcome."""
    depths, faces = frame
    kind = depths.dtype.type
    if is_depth_culled(centre, radius, view):
        return POINTS_OUTSIDE
    width, height = setup.get_picture_size(viewport)
    low_x, high_x = bound_sphere(centre, radius, 0, view)
    low_y, high_y = bound_sphere(centre, radius, 1, view)
    left, right = find_pixels_between(low_x, high_x, width, viewport.left, viewport.width)
    top, bottom = find_pixels_between(-high_y, -low_y, height, viewport.top, viewport.height)
    outcome = POINTS_UNSAMPLED if left <= right and top <= bottom else POINTS_OUTSIDE
    bound = bound_nearest_depth(centre, radius, view, depth_coefficients)
    for row in range(top, bottom + 1):
        start = row * viewport.width
        for column in range(left, right + 1):
            # Only after the sphere is known to cover a pixel: hidden ones count as drawn.
            if outcome == POINTS_DRAWN and depths[np.uintp(start + column)] > bound:
                continue
            ndc = get_ndc(column, row, viewport)
            offset, is_seen = intersect_ray_with_sphere(centre, radius, ndc, view)
            if is_seen == 1:
                depth = find_sphere_depth(centre, offset, view, depth_coefficients)
                depth_test(np.uintp(start + column), kind(depth), face, depths, faces)
                outcome = POINTS_DRAWN
    return outcome


@helper
def draw_sphere_pixel(x, y, centre, radius, face, frame, view, depth_coefficients, viewport):
    """Draw the pixel that holds a sphere's centre, if its ray misses the sphere."""
    column = find_holding_pixel(x, viewport.grid_bits)
    row = find_holding_pixel(y, viewport.grid_bits)
    offset, is_seen = intersect_ray_with_sphere(
        centre, radius, get_ndc(column, row, viewport), view
    )
    if is_seen != 2:
        return POINTS_UNSAMPLED
    depth = find_sphere_depth(centre, offset, view, depth_coefficients)
    return draw_one_pixel(column, row, frame[0].dtype.type(depth), face, frame, viewport)


@helper
def get_radius(points, owner, number):
    """Return the radius of a sphere, scene units, by its number in its object."""
    first, step = points.size_ranges[owner, 0], points.size_ranges[owner, 1]
    return 0.5 * (points.sizes[np.uintp(first + step * number)] * points.scales[owner])


@disjoint_helper
def find_pixels(snapped_x, snapped_y, codes, viewport):
    """
    Write the pixel of each point of one pixel over its outcode, -1 for none.

    Returns the numbers of drawn and of invalid points.
    """
    bits = np.int32(viewport.grid_bits)
    width, height = np.int32(viewport.width), np.int32(viewport.height)
    drawn, invalid = np.int32(0), np.int32(0)
    for i in range(codes.shape[0]):
        column = (snapped_x[i] - np.int32(1)) >> bits
        row = (snapped_y[i] - np.int32(1)) >> bits
        is_inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        is_seen = ((codes[i] & np.int32(UNDRAWN_CODES)) == 0) & is_inside
        drawn += np.int32(is_seen)
        invalid += np.int32((codes[i] & np.int32(setup.INVALID)) != 0)
        codes[i] = row * width + column if is_seen else np.int32(-1)
    return drawn, invalid


@helper
def draw_pixels(first_face, count, frame, viewport, scratch, counts):
    """Draw a block of points of one pixel each."""
    floats, ints, _ = scratch
    depths, faces = frame
    kind = depths.dtype.type
    drawn, invalid = find_pixels(*three_parts(ints, projection.SNAPPED_X, 0, count), viewport)
    counts[POINTS_DRAWN] += drawn
    counts[POINTS_INVALID] += invalid
    counts[POINTS_OUTSIDE] += count - drawn - invalid
    # Prefetch all pixels first.
    for i in range(count):
        pixel = ints[projection.CODE, np.uintp(i)]
        if pixel >= 0:
            prefetch(depths, np.uintp(pixel))
    for i in range(count):
        pixel = ints[projection.CODE, np.uintp(i)]
        if pixel >= 0:
            depth = kind(floats[projection.DEPTH, np.uintp(i)])
            depth_test(np.uintp(pixel), depth, np.int32(first_face + i), depths, faces)


@helper
def draw_shapes(first, count, owner, positions, matrices, points, camera, frame, scratch, counts):
    """Draw a block of points of any size and shape, of one object."""
    view, depth_coefficients, viewport = camera
    floats, ints, _ = scratch
    kind = frame[0].dtype.type
    shape, unit = points.shapes[owner, 0], points.shapes[owner, 1]
    first_size, step = points.size_ranges[owner, 0], points.size_ranges[owner, 1]
    first_number = first - points.vertex_starts[owner]
    first_face = points.face_starts[owner] + first_number
    scale = points.scales[owner]

    # Skip what lies outside, measure, and draw by shape.
    for i in range(count):
        n = np.uintp(i)
        code, w = ints[projection.CODE, n], floats[projection.W, n]
        face = np.int32(first_face + i)
        x, y = np.int64(ints[projection.SNAPPED_X, n]), np.int64(ints[projection.SNAPPED_Y, n])
        if code & setup.INVALID:
            counts[POINTS_INVALID] += 1
            continue
        if shape != SPHERE and (code & UNDRAWN_CODES):
            counts[POINTS_OUTSIDE] += 1
            continue
        size = points.sizes[np.uintp(first_size + step * (first_number + i))]
        depth = kind(floats[projection.DEPTH, n])
        is_ahead = (code & setup.GUARD) == 0
        sizes = find_grid_sizes(size, unit, scale, w if is_ahead else 1.0, view, viewport)
        if shape == SPHERE:
            v = np.uintp(first + i)
            position = positions[v, 0], positions[v, 1], positions[v, 2]
            centre = transform_point(position[0], position[1], position[2], owner, matrices)
            radius = 0.5 * (size * scale)
            outcome = draw_sphere(centre, radius, face, frame, view, depth_coefficients, viewport)
            is_large = min(sizes[0], sizes[1]) >= np.int64(1) << viewport.grid_bits
            if is_ahead and is_large and outcome != POINTS_DRAWN:
                outcome = draw_sphere_pixel(
                    x, y, centre, radius, face, frame, view, depth_coefficients, viewport
                )
        elif shape == SQUARE:
            outcome = draw_square(x, y, sizes, depth, face, frame, viewport)
        else:
            outcome = draw_disc(x, y, sizes, depth, face, frame, viewport)
        counts[outcome] += 1


@helper
def are_one_pixel_squares(owner, points):
    """Return whether all points of an object are squares of one pixel."""
    return (
        points.shapes[owner, 0] == SQUARE and points.shapes[owner, 1] == IN_PIXELS
        and points.size_ranges[owner, 1] == 0
        and points.sizes[np.uintp(points.size_ranges[owner, 0])] * points.scales[owner] == 1.0
    )  # fmt: skip


@kernel
def draw_points(
    vertices: (int64, int64), positions: float64[:, ::1], relative_from_model: float64[:, :, ::1],
    points: PointRows, view: PointView, depth_coefficients: (float64, float64, float64),
    viewport: Viewport, frame: (stored[:, ::1], int32[:, ::1]), counts: int64[::1],
    scratch: (float64[:, ::1], int32[:, ::1], float64[::1]),
):  # fmt: skip
    """
    Draw the points among some vertices into a picture.

    Parameters
    ----------
    vertices : (int, int)
        The first, and one past the last; they may belong to several objects, of any kind.
    positions : (V, 3) float64, model space
    relative_from_model : (O, 4, 4) float64
        To world axes with the origin at the eye.
    points : PointRows
    view : PointView
    depth_coefficients : (float, float, float)
        The stored depth is ``(c0 + c1 z + c2 w) / w``; greater is nearer.
    viewport : Viewport
    frame : (depth (H, W), face_id (H, W) int32)
        Changed where points are nearer.
    counts : (4,) int64
        Number of points by outcome, added to: see ``POINTS_OUTSIDE``.
    scratch : tuple
        From `projection.allocate_scratch`, not shared with other calls.
    """
    floats, ints, largest = scratch
    pixels = flat(frame[0]), flat(frame[1])
    objects = points.vertex_starts, relative_from_model
    owner, first = setup.find_last_at_most(points.vertex_starts, vertices[0]), vertices[0]
    while first < vertices[1]:
        while first >= points.vertex_starts[np.uintp(owner + 1)]:
            owner += 1
        end = min(vertices[1], points.vertex_starts[np.uintp(owner + 1)])
        o = np.uintp(owner)
        if points.shapes[o, 0] == NOT_POINTS:
            first = end
            continue
        is_pixel = are_one_pixel_squares(o, points)
        while first < end:
            count = min(np.int64(projection.VERTICES_PER_BLOCK), end - first)
            projection.load_eye_relative(positions, first, first + count, objects, owner, floats)
            x, y = part(floats, projection.X, 0, count), part(floats, projection.Y, 0, count)
            z, w = part(floats, projection.Z, 0, count), part(floats, projection.W, 0, count)
            projection.transform_rows_to_clip(view.matrix, x, y, z, w)
            projection.project_rows(
                depth_coefficients, viewport, largest[0], x, y, z, w,
                part(floats, projection.DEPTH, 0, count),
                *three_parts(ints, projection.SNAPPED_X, 0, count),
            )  # fmt: skip
            if is_pixel:
                face = points.face_starts[o] + first - points.vertex_starts[o]
                draw_pixels(face, count, pixels, viewport, scratch, counts)
            else:
                camera = view, depth_coefficients, viewport
                draw_shapes(
                    first, count, o, positions, relative_from_model, points, camera, pixels,
                    scratch, counts,
                )  # fmt: skip
            first += count


@kernel
def merge_pictures(
    row_range: (int64, int64), drawn: (stored[:, :, ::1], int32[:, :, ::1]),
    frame: (stored[:, ::1], int32[:, ::1]),
):  # fmt: skip
    """
    Merge pictures: the nearest sample of each pixel wins.

    Parameters
    ----------
    row_range : (int, int)
        First row, and one past the last.
    drawn : (depth (N, H, W), face_id (N, H, W) int32)
    frame : (depth (H, W) of the same type, face_id (H, W) int32)
        Changed where a picture is nearer, or as near with a lower face number.
    """
    for n in range(drawn[0].shape[0]):
        for row in range(row_range[0], row_range[1]):
            depths, faces = drawn[0][n, row], drawn[1][n, row]
            depth, face_id = frame[0][row], frame[1][row]
            for column in range(depths.shape[0]):
                if faces[column] >= 0:
                    pixel = np.uintp(column)
                    depth_test(pixel, depths[column], faces[column], depth, face_id)
