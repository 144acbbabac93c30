"""
Draw the classic primitives: filled triangles, circles and Bezier curves.

Coordinates are integer pixels, x right and y down: the vertex (3, 5) is the centre of that pixel,
so samples on edges and vertices are common and the rule for ties matters.

Targets are ``(H, W) uint32`` views of ``(H, W, 4) uint8`` RGBA, as in ``bresenham``: a *packed*
colour has red in the lowest byte, and so have the colours given. Coordinates and radii are at most
``MAX_COORDINATE`` in magnitude, so twice the area ``A2`` of a triangle is at most 2**42, an edge
function 2**43, and every sum below 2**53.

Filling
-------
``E0``, ``E1`` and ``E2`` are the edge functions opposite the three vertices, positive inside; their
sum is ``A2``. A pixel is covered if every ``E + bias >= 0``. A bias of 0 keeps the pixels on an
edge (the inclusive rule), -1 drops them. The top-left rule has -1 on every edge that is neither a
top edge (horizontal, above the triangle) nor a left one. A triangle of no area covers nothing under
either rule.

A channel is ``floor((E0 c0 + E1 c1 + E2 c2) / A2 + 1/2)``, which is one integer division of
``2 (E0 c0 + E1 c1 + E2 c2) + A2`` by ``2 A2``. The depth is ``d0 + (E1 / A2) (d1 - d0) + (E2 / A2)
(d2 - d0)`` in ``float64``, stored as ``float32``. The vertices are sorted first, so their order and
winding change no bit of the result.

Curves
------
A curve is cut at equal steps of its parameter into chords, which stay within ``FLATNESS_PX`` of it.
Their ends are not rounded. A chord with ``|dx| >= |dy|`` is drawn by columns: for each column that
it crosses the nearest pixel, at most half a pixel from the chord. A steeper one is drawn by rows.
Positions less than ``TIE_PX`` below a tie between two pixels are rounded up like the tie. Rounding
errors are smaller, so they decide nothing.

The *heading* of a chord is the axis that it is drawn along and the signs of its two directions.
From one column to the next, a path moves to a neighbour by a side or a corner, also where chords of
one heading meet. At a *turn*, where the heading changes, the pixel in which the chords meet is the
pixel before or after it, or a neighbour of both. It is drawn if these two do not touch, if the
curve goes back there, or if the point where the chords meet is further than
``MAX_TURN_DISTANCE_PX`` from both. The end points are joined to the path in the same way, and
always drawn.

So the pixels of a curve form one path without gaps. The centre of each is within
``1/2 + FLATNESS_PX`` of the curve, or within ``sqrt(1/2)`` where it holds a turn or an end; and the
curve is nowhere further than a pixel from one of them. No pixel is drawn twice in a row; where the
curve returns to a pixel, the later colour stays.

References
----------
.. [1] J. Pineda, "A Parallel Algorithm for Polygon Rasterization", SIGGRAPH 1988: edge functions.
.. [2] M. L. V. Pitteway, "Algorithm for drawing ellipses or hyperbolae with a digital plotter",
   Computer Journal 10(3), 1967, and J. R. Van Aken, "An Efficient Ellipse-Drawing Algorithm",
   IEEE CG&A 4(9), 1984: the midpoint test.
.. [3] G. Wang, "The subdivision method for finding the intersection between two Bezier curves or
   surfaces", Zhejiang University Journal, 1984: the number of segments.
"""

from __future__ import annotations

import math

import numpy as np

from rasterjit.pipeline.bresenham import (
    FRACTION_BITS,
    draw_gradient_run,
    draw_run,
    get_channel,
    pack_fixed_color,
)
from rasterjit.runtime.intrinsics import flat
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int64, uint32

CORNER = (int64, int64, int64, float64)
"""A triangle's corner: x and y, pixels; packed colour; depth."""

MAX_COORDINATE = 1 << 20
"""Largest magnitude of a coordinate or radius, pixels; see the module's notes."""

INCLUSIVE_BIAS = 0
"""Bias that keeps the pixels on an edge."""

EXCLUSIVE_BIAS = -1
"""Bias that drops the pixels on an edge; edge functions are integers, so -1 is the largest."""

FLATNESS_PX = 0.125
"""Largest distance of a curve from its chords, pixels: a quarter of the distance that rounding to
pixels adds."""

CURVE_BITS = 40
"""Fraction bits of where a chord crosses columns; coordinates and a sign still fit ``int64``."""

TIE_PX = 2.0**-22
"""
Distance below a tie between two pixels that is rounded up like the tie, pixels: above the sum of
rounding errors along a chord of up to 2**18 pixels.
"""

MIN_COLUMN_SHARE = 1.0 - 2.0**-34
"""Least ``|dx| / |dy|`` of chords that are drawn by columns."""

MAX_TURN_DISTANCE_PX = 0.8
"""Pixels from the one before or after it up to which a turn need not be drawn."""


@helper
def is_above(corner, other):
    """Tell whether a corner is above another, or at the same height to the left of it."""
    return corner[1] < other[1] or (corner[1] == other[1] and corner[0] < other[0])


@helper
def order_corners(corners):
    """
    Return the corners sorted, with positive winding, and twice the triangle's area.

    Positive is clockwise on the screen. Any order of the same corners returns the same.
    """
    a, b, c = corners
    if is_above(c, a) and is_above(c, b):
        a, b, c = c, a, b
    elif is_above(b, a):
        a, b, c = b, c, a
    double_area = compute_edge(a, b, c[0], c[1])
    if double_area < 0:
        return a, c, b, -double_area
    return a, b, c, double_area


@helper
def compute_edge(start, end, x, y):
    """Return twice the signed area of (start, end, (x, y)): positive to the right of the edge."""
    return (end[0] - start[0]) * (y - start[1]) - (end[1] - start[1]) * (x - start[0])


@helper
def choose_bias(start, end, other_bias):
    """Return 0 for a top or a left edge, else ``other_bias``."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    if dy < 0 or (dy == 0 and dx > 0):
        return np.int64(INCLUSIVE_BIAS)
    return np.int64(other_bias)


@helper
def make_edge_plane(start, end, other_bias):
    """Return an edge function: its steps along x and along y, its value at (0, 0), its bias."""
    return (
        start[1] - end[1], end[0] - start[0], compute_edge(start, end, 0, 0),
        choose_bias(start, end, other_bias),
    )  # fmt: skip


@helper
def set_up_triangle(corners, other_bias):
    """Return the sorted corners' opposite edges, packed colours and depths, and twice the area."""
    a, b, c, double_area = order_corners(corners)
    planes = (
        make_edge_plane(b, c, other_bias),
        make_edge_plane(c, a, other_bias),
        make_edge_plane(a, b, other_bias),
    )
    return planes, (a[2], b[2], c[2]), (a[3], b[3], c[3]), double_area


@helper
def clip_bounds(corners, width, height):
    """Return the first and the last column and row of the bounding box inside the target."""
    a, b, c = corners
    return (
        max(min(a[0], b[0], c[0]), 0),
        min(max(a[0], b[0], c[0]), width - 1),
        max(min(a[1], b[1], c[1]), 0),
        min(max(a[1], b[1], c[1]), height - 1),
    )


@helper
def evaluate_plane(plane, x, y):
    """Return the edge function at pixel (x, y), without its bias."""
    return plane[0] * x + plane[1] * y + plane[2]


@helper
def compute_numerator(colors, channel, e0, e1, e2):
    """Return ``E0 c0 + E1 c1 + E2 c2`` for one channel."""
    return (
        e0 * get_channel(colors[0], channel)
        + e1 * get_channel(colors[1], channel)
        + e2 * get_channel(colors[2], channel)
    )


@helper
def mix_pixel(colors, double_area, e0, e1, e2):
    """Interpolate a packed colour by edge functions, each channel rounded half up."""
    color = np.int64(0)
    for channel in range(4):
        numerator = compute_numerator(colors, channel, e0, e1, e2)
        color |= ((2 * numerator + double_area) // (2 * double_area)) << (8 * channel)
    return color


@helper
def update_depth(depth, corner_depths, double_area, e1, e2, x, y):
    """Store a pixel's depth if it is nearer; tell whether it is, or True without a depth test."""
    if depth.shape[0] == 0:
        return True
    d0, d1, d2 = corner_depths
    value = np.float32(d0 + (e1 / double_area) * (d1 - d0) + (e2 / double_area) * (d2 - d0))
    is_nearer = value < depth[y, x]
    if is_nearer:
        depth[y, x] = value
    return is_nearer


@kernel
def fill_triangle(
    target: uint32[:, ::1], depth: float32[:, ::1], corners: (CORNER, CORNER, CORNER),
    other_bias: int64,
):  # fmt: skip
    """
    Fill a triangle by testing every pixel of its bounding box.

    Parameters
    ----------
    target : (H, W) uint32, C-contiguous
        RGBA pixels, red in the lowest byte.
    depth : (H, W) float32, or (0, 0) for no depth test
        Smaller is nearer; only nearer pixels are drawn, and replace the depth.
    corners : three of (x, y, packed colour, depth)
        In either winding. Magnitudes of x and y are at most ``MAX_COORDINATE`` pixels; depths are
        finite, or any without a depth test.
    other_bias : int
        Bias of edges that are neither top nor left: ``EXCLUSIVE_BIAS`` for the top-left rule,
        ``INCLUSIVE_BIAS`` for the inclusive one.

    Writes ``target`` and ``depth``.

    Notes
    -----
    A triangle of no area draws nothing.
    """
    (plane0, plane1, plane2), colors, depths, double_area = set_up_triangle(corners, other_bias)
    if double_area == 0:
        return
    x_min, x_max, y_min, y_max = clip_bounds(corners, target.shape[1], target.shape[0])
    for y in range(y_min, y_max + 1):
        for x in range(x_min, x_max + 1):
            e0 = evaluate_plane(plane0, x, y)
            e1 = evaluate_plane(plane1, x, y)
            e2 = evaluate_plane(plane2, x, y)
            is_covered = e0 + plane0[3] >= 0 and e1 + plane1[3] >= 0 and e2 + plane2[3] >= 0
            if is_covered and update_depth(depth, depths, double_area, e1, e2, x, y):
                target[y, x] = mix_pixel(colors, double_area, e0, e1, e2)


@helper
def clip_span(plane, y, x_first, x_last):
    """Return the part of a row's span on the inner side of an edge; first > last if none."""
    step = plane[0]
    value_at_0 = plane[1] * y + plane[2] + plane[3]
    if step > 0:
        x_first = max(x_first, -(value_at_0 // step))
    elif step < 0:
        x_last = min(x_last, value_at_0 // -step)
    elif value_at_0 < 0:
        x_last = x_first - 1
    return x_first, x_last


@helper
def start_channel(colors, channel, edges, edge_steps, double_area):
    """Return quotient and remainder by ``2 A2`` of a channel, and of its step per pixel."""
    divisor = 2 * double_area
    value = 2 * compute_numerator(colors, channel, edges[0], edges[1], edges[2]) + double_area
    step = 2 * compute_numerator(colors, channel, edge_steps[0], edge_steps[1], edge_steps[2])
    return value // divisor, value % divisor, step // divisor, step % divisor


@helper
def advance_channel(state, divisor):
    """Return a channel's state one pixel to the right: add the step, carry the remainder."""
    quotient, remainder, quotient_step, remainder_step = state
    remainder += remainder_step
    carry = np.int64(remainder >= divisor)
    return (
        quotient + quotient_step + carry,
        remainder - carry * divisor,
        quotient_step,
        remainder_step,
    )


@kernel
def fill_triangle_scanline(
    target: uint32[:, ::1], depth: float32[:, ::1], corners: (CORNER, CORNER, CORNER),
    other_bias: int64,
):  # fmt: skip
    """
    Fill a triangle row by row: divide only at the ends of rows, then add.

    Parameters and bits written are those of ``fill_triangle``. A row's span is where all three edge
    functions are on their inner side. The channels begin with an exact division, then add a
    quotient and a remainder for each pixel.
    """
    (plane0, plane1, plane2), colors, depths, double_area = set_up_triangle(corners, other_bias)
    if double_area == 0:
        return
    divisor = 2 * double_area
    edge_steps = (plane0[0], plane1[0], plane2[0])
    x_min, x_max, y_min, y_max = clip_bounds(corners, target.shape[1], target.shape[0])
    for y in range(y_min, y_max + 1):
        x_first, x_last = clip_span(plane0, y, x_min, x_max)
        x_first, x_last = clip_span(plane1, y, x_first, x_last)
        x_first, x_last = clip_span(plane2, y, x_first, x_last)
        if x_first > x_last:
            continue
        e0 = evaluate_plane(plane0, x_first, y)
        e1 = evaluate_plane(plane1, x_first, y)
        e2 = evaluate_plane(plane2, x_first, y)
        red = start_channel(colors, 0, (e0, e1, e2), edge_steps, double_area)
        green = start_channel(colors, 1, (e0, e1, e2), edge_steps, double_area)
        blue = start_channel(colors, 2, (e0, e1, e2), edge_steps, double_area)
        alpha = start_channel(colors, 3, (e0, e1, e2), edge_steps, double_area)
        for x in range(x_first, x_last + 1):
            if update_depth(depth, depths, double_area, e1, e2, x, y):
                target[y, x] = red[0] | (green[0] << 8) | (blue[0] << 16) | (alpha[0] << 24)
            red = advance_channel(red, divisor)
            green = advance_channel(green, divisor)
            blue = advance_channel(blue, divisor)
            alpha = advance_channel(alpha, divisor)
            e1 += edge_steps[1]
            e2 += edge_steps[2]


@helper
def put_pixel(target, x, y, color):
    """Write a packed colour to a pixel if it lies inside the target."""
    if 0 <= x < target.shape[1] and 0 <= y < target.shape[0]:
        target[y, x] = color


@helper
def put_rotations(target, center_x, center_y, x, y, color):
    """Write the pixels at an offset from the centre, and at it rotated by 90, 180, 270 degrees."""
    put_pixel(target, center_x + x, center_y + y, color)
    put_pixel(target, center_x - y, center_y + x, color)
    put_pixel(target, center_x - x, center_y - y, color)
    put_pixel(target, center_x + y, center_y - x, color)


@kernel
def draw_circle(
    target: uint32[:, ::1], center_x: int64, center_y: int64, radius: int64, color: int64
):  # fmt: skip
    """
    Draw a circle by the midpoint test, clipped to the target, each pixel once.

    Parameters
    ----------
    target : (H, W) uint32
        RGBA pixels, red in the lowest byte.
    center_x, center_y, radius : int, pixels
        Magnitudes up to ``MAX_COORDINATE``; radius >= 0.
    color : int
        Packed.

    Writes ``target``.

    Notes
    -----
    In the octant ``0 <= x <= y`` the pixel of column x is the one whose vertical extent the circle
    crosses: ``(y - 1/2)**2 < r**2 - x**2 < (y + 1/2)**2``, never a tie between integers. Radius 0
    is one pixel.
    """
    if radius == 0:
        put_pixel(target, center_x, center_y, color)
        return
    x = np.int64(0)
    y = np.int64(radius)
    # x**2 + (y - 1/2)**2 - r**2 - 1/4, the midpoint below the pixel, always an integer
    midpoint = -y
    while x <= y:
        put_rotations(target, center_x, center_y, x, y, color)
        # The mirrored octant; rotations of this one have drawn its ends
        if 0 < x < y:
            put_rotations(target, center_x, center_y, -x, y, color)
        midpoint += 2 * x + 1
        x += 1
        if midpoint >= 0:
            midpoint -= 2 * y - 2
            y -= 1


@helper
def count_segments(points):
    """
    Return the number of equal parameter steps whose chords are within ``FLATNESS_PX``.

    For degree ``d`` and ``M`` the largest second difference of the control points, the distance
    with ``n`` segments is at most ``d (d - 1) M / (8 n**2)`` [3]_.
    """
    degree = points.shape[0] - 1
    largest = 0.0
    for i in range(degree - 1):
        second_x = points[i + 2, 0] - 2.0 * points[i + 1, 0] + points[i, 0]
        second_y = points[i + 2, 1] - 2.0 * points[i + 1, 1] + points[i, 1]
        largest = max(largest, math.sqrt(second_x * second_x + second_y * second_y))
    bound = degree * (degree - 1) * largest / (8.0 * FLATNESS_PX)
    return max(1, math.ceil(math.sqrt(bound)))


@helper
def compute_coefficients(points, axis):
    """Return the coefficients of ``t**3``, ``t**2`` and t of one coordinate of a curve."""
    p0, p1, p2 = points[0, axis], points[1, axis], points[2, axis]
    if points.shape[0] == 3:
        return 0.0, p0 - 2.0 * p1 + p2, 2.0 * (p1 - p0)
    p3 = points[3, axis]
    return p3 - p0 + 3.0 * (p1 - p2), 3.0 * (p0 - 2.0 * p1 + p2), 3.0 * (p1 - p0)


@helper
def interpolate_channel(colors, channel, t):
    """Return a channel at ``t`` in 0..1, plus 1/2, in the fixed point of ``bresenham``."""
    start, end = np.float64(get_channel(colors[0], channel)), get_channel(colors[1], channel)
    value = start + t * (np.float64(end) - start) + (0.5 + TIE_PX)
    return np.int64(value * (1 << FRACTION_BITS))


@helper
def interpolate_color(colors, t):
    """Return four channels at ``t`` in 0..1, plus 1/2, in the fixed point of ``bresenham``."""
    return (
        interpolate_channel(colors, 0, t), interpolate_channel(colors, 1, t),
        interpolate_channel(colors, 2, t), interpolate_channel(colors, 3, t),
    )  # fmt: skip


@helper
def compute_channel_gain(colors, channel, step):
    """Return the change of a channel when ``t`` grows by ``step``, in fixed point."""
    difference = get_channel(colors[1], channel) - get_channel(colors[0], channel)
    return np.int64(np.float64(difference) * step * (1 << FRACTION_BITS))


@helper
def round_to_pixel(coordinate):
    """Return the pixel nearest to a coordinate, ties up; pixel centres are at integers."""
    return np.int64(math.floor(coordinate + (0.5 + TIE_PX)))


@helper
def put_color(target, x, y, colors, t):
    """Write the curve's colour at ``t`` in 0..1 to a pixel if it lies inside the target."""
    put_pixel(target, x, y, pack_fixed_color(interpolate_color(colors, t)))


@helper
def are_neighbours(x, y, other_x, other_y):
    """Tell whether two pixels are the same, or share a side or a corner."""
    return abs(x - other_x) <= 1 and abs(y - other_y) <= 1


@helper
def is_far(point_x, point_y, x, y):
    """Tell whether a point is further than ``MAX_TURN_DISTANCE_PX`` from a pixel's centre."""
    dx, dy = point_x - np.float64(x), point_y - np.float64(y)
    return dx * dx + dy * dy > MAX_TURN_DISTANCE_PX * MAX_TURN_DISTANCE_PX


@helper
def find_steps_inside(value, gain, steps, size):
    """
    Return the first and the last step of 0..steps at which a coordinate is in the target.

    The coordinate is ``value + step * gain``, with ``CURVE_BITS`` fraction bits; the target's
    pixels are ``0 .. size - 1``. first > last if there is none.
    """
    stop = size << CURVE_BITS
    end = value + steps * gain
    if 0 <= value < stop and 0 <= end < stop:
        return np.int64(0), steps
    if max(value, end) < 0 or min(value, end) >= stop:
        return np.int64(0), np.int64(-1)
    if gain < 0:
        value, gain = stop - 1 - value, -gain
    return max(-(value // gain), 0), min((stop - 1 - value) // gain, steps)


@kernel
def draw_bezier(target: uint32[:, ::1], points: float64[:, ::1], colors: (int64, int64)):
    """
    Draw a quadratic or cubic Bezier curve, one pixel wide.

    Parameters
    ----------
    target : (H, W) uint32, C-contiguous
        RGBA pixels, red in the lowest byte.
    points : (3, 2) or (4, 2) float64, pixels
        Control points, magnitudes up to ``MAX_COORDINATE``; integers are pixel centres.
    colors : two packed colours
        At the start and at the end; in between, linear in the curve's parameter.

    Writes ``target``.

    Notes
    -----
    The module's notes say which pixels are drawn. Interpolated channels are rounded half up at the
    parameter of each pixel. If all control points coincide, one pixel is drawn, in the end's
    colour.
    """
    height, width = target.shape
    pixels = flat(target)
    has_one_color = colors[0] == colors[1]
    segments = count_segments(points)
    step = 1.0 / segments
    start_x, start_y = points[0, 0], points[0, 1]
    cubic_x, square_x, linear_x = compute_coefficients(points, 0)
    cubic_y, square_y, linear_y = compute_coefficients(points, 1)
    # Path so far: its last pixel, and a turn that may have to be drawn between it and the next
    last_x, last_y = round_to_pixel(start_x), round_to_pixel(start_y)
    put_color(target, last_x, last_y, colors, 0.0)
    is_turn = False
    turn_x, turn_y, turn_t = start_x, start_y, 0.0
    x0, y0, t0 = start_x, start_y, 0.0
    previous_dx, previous_dy, previous_heading = 0.0, 0.0, np.int64(0)
    for segment in range(1, segments + 1):
        # Find the next chord
        t1 = segment * step
        x1 = ((cubic_x * t1 + square_x) * t1 + linear_x) * t1 + start_x
        y1 = ((cubic_y * t1 + square_y) * t1 + linear_y) * t1 + start_y
        dx, dy = x1 - x0, y1 - y0
        if abs(dx) < TIE_PX and abs(dy) < TIE_PX:
            t0 = t1
            continue
        if abs(dx) >= abs(dy) * MIN_COLUMN_SHARE:
            major0, major1, minor0, slope = x0, x1, y0, dy / dx
            sign, heading = (1, 1) if dx > 0.0 else (-1, 2)
        else:
            major0, major1, minor0, slope = y0, y1, x0, dx / dy
            sign, heading = (1, 3) if dy > 0.0 else (-1, 4)
        along_x = heading <= 2
        if (dy if along_x else dx) < -TIE_PX:
            heading += 4
        slope = min(max(slope, -1.0), 1.0)
        # Turn: it joins chords of two headings; keep one point of it until the path has passed it
        has_new_heading = heading != previous_heading and previous_heading != 0
        if has_new_heading or is_turn:
            x, y = round_to_pixel(x0), round_to_pixel(y0)
            is_needed = is_turn and (
                not are_neighbours(x, y, last_x, last_y) or is_far(turn_x, turn_y, last_x, last_y)
            )
            if has_new_heading and is_needed:
                last_x, last_y = round_to_pixel(turn_x), round_to_pixel(turn_y)
                put_color(target, last_x, last_y, colors, turn_t)
            if has_new_heading or not is_needed:
                turn_x, turn_y, turn_t, is_turn = x0, y0, t0, True
            # Draw a turn at which the curve goes back
            if has_new_heading and dx * previous_dx + dy * previous_dy < 0.0:
                if x != last_x or y != last_y:
                    last_x, last_y = x, y
                    put_color(target, x, y, colors, t0)
                is_turn = False
        if not is_turn:
            turn_x, turn_y, turn_t = x0, y0, t0
        previous_dx, previous_dy, previous_heading = dx, dy, heading
        # Find the columns (or rows) that the chord crosses
        if sign > 0:
            first, last = np.int64(math.floor(major0)) + 1, np.int64(math.floor(major1))
        else:
            first, last = np.int64(math.ceil(major0)) - 1, np.int64(math.ceil(major1))
        steps = (last - first) * sign
        if steps >= 0:
            offset = np.float64(first) - major0
            crossing = minor0 + offset * slope + (0.5 + TIE_PX)
            minor = np.int64(math.floor(crossing * (1 << CURVE_BITS)))
            gain = np.int64(slope * sign * (1 << CURVE_BITS))
            # Join the first pixel to the path
            x, y = first, minor >> CURVE_BITS
            if not along_x:
                x, y = y, x
            has_gap = not are_neighbours(x, y, last_x, last_y)
            if has_gap or (
                is_turn and is_far(turn_x, turn_y, last_x, last_y) and is_far(turn_x, turn_y, x, y)
            ):
                last_x, last_y = round_to_pixel(turn_x), round_to_pixel(turn_y)
                put_color(target, last_x, last_y, colors, turn_t)
            is_turn = False
            begin = np.int64(x == last_x and y == last_y)
            last_x, last_y = last, (minor + steps * gain) >> CURVE_BITS
            if not along_x:
                last_x, last_y = last_y, last_x
            # Draw the part inside the target
            major_size, minor_size = (width, height) if along_x else (height, width)
            major_stride, minor_stride = (1, width) if along_x else (width, 1)
            begin = max(begin, -first if sign > 0 else first - major_size + 1)
            end = min(steps, major_size - 1 - first if sign > 0 else first)
            if begin <= end:
                low, high = find_steps_inside(minor, gain, steps, minor_size)
                begin, end = max(begin, low), min(end, high)
            if begin <= end:
                index = (first + sign * begin) * major_stride
                run = (begin, end, index, sign * major_stride, minor_stride)
                shift = FRACTION_BITS - CURVE_BITS
                minor = (minor + begin * gain) << shift
                gain <<= shift
                if has_one_color:
                    draw_run(pixels, run, minor, gain, colors[0])
                else:
                    length = abs(major1 - major0)
                    t = t0 + (t1 - t0) * ((abs(offset) + np.float64(begin)) / length)
                    # A run of one pixel needs no gain, which a short chord would make too large
                    t_step = (t1 - t0) / length if begin < end else 0.0
                    color_gain = (
                        compute_channel_gain(colors, 0, t_step),
                        compute_channel_gain(colors, 1, t_step),
                        compute_channel_gain(colors, 2, t_step),
                        compute_channel_gain(colors, 3, t_step),
                    )
                    draw_gradient_run(
                        pixels, run, minor, gain, interpolate_color(colors, t), color_gain
                    )
        x0, y0, t0 = x1, y1, t1
    # Join the end to the path
    end_point = points.shape[0] - 1
    x, y = round_to_pixel(points[end_point, 0]), round_to_pixel(points[end_point, 1])
    is_turn_far = is_far(turn_x, turn_y, last_x, last_y) and is_far(turn_x, turn_y, x, y)
    if not are_neighbours(x, y, last_x, last_y) or (is_turn and is_turn_far):
        put_color(target, round_to_pixel(turn_x), round_to_pixel(turn_y), colors, turn_t)
    put_pixel(target, x, y, colors[1])
