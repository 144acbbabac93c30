"""
Draw the classic primitives: filled triangles, circles and Bezier curves.

Coordinates are integers that name pixels, x right and y down: the vertex (3, 5) is the centre of
that pixel, so samples on edges and vertices are the common case and the rule for ties matters.

Targets are flat-packed as in ``lines``: ``(H, W) uint32`` views of ``(H, W, 4) uint8`` RGBA, red
in the lowest byte. Coordinates and radii are at most ``MAX_COORDINATE`` in magnitude, so twice the
area ``A2`` of a triangle is at most 2**42, an edge function 2**43, and every sum below 2**53.

Filling
-------
With ``E0 + E1 + E2 = A2`` the edge functions opposite the three vertices, turned such that they are
positive inside, a pixel is covered if every ``E + bias >= 0``. The bias is data: 0 keeps pixels on
the edge (the inclusive rule); -1 drops them, and the top-left rule has it on every edge that is
neither a top edge (horizontal, above the triangle) nor a left one. A triangle of no area covers
nothing under either rule.

A channel is ``floor((E0 c0 + E1 c1 + E2 c2) / A2 + 1/2)``, which is one integer division of
``2 (E0 c0 + E1 c1 + E2 c2) + A2`` by ``2 A2``. The depth is ``d0 + (E1 / A2) (d1 - d0) + (E2 / A2)
(d2 - d0)`` in ``float64``, stored as ``float32``. The vertices are first put in one order, so their
order and winding change no bit of the result.

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

from rasterjit.pipeline.lines import draw_line
from rasterjit.runtime.intrinsics import flat
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state import float32, float64, int64, uint8, uint32

MAX_COORDINATE = 1 << 20
"""Largest magnitude of a coordinate or radius, pixels; see the module's notes."""

INCLUSIVE_BIAS = 0
"""Bias that keeps the pixels on an edge."""

EXCLUSIVE_BIAS = -1
"""Bias that drops them: edge functions are integers."""

FLATNESS = 0.25
"""Largest distance of a curve from its chords, pixels: half of the half pixel that is visible."""


@helper
def ordered_vertices(vertices):
    """
    Return the order of the vertices, topmost then leftmost first and positively turned, and A2.

    Positive is clockwise on the screen. Whatever the order given, the one returned is the same.
    """
    first = 0
    for i in range(1, 3):
        above = vertices[i, 1] < vertices[first, 1]
        beside = vertices[i, 1] == vertices[first, 1] and vertices[i, 0] < vertices[first, 0]
        if above or beside:
            first = i
    second, third = (first + 1) % 3, (first + 2) % 3
    area = edge_function(vertices, first, second, vertices[third, 0], vertices[third, 1])
    if area < 0:
        return first, third, second, -area
    return first, second, third, area


@helper
def edge_function(vertices, start, end, x, y):
    """Return twice the signed area of (start, end, (x, y)): positive to the right of the edge."""
    return (vertices[end, 0] - vertices[start, 0]) * (y - vertices[start, 1]) - (
        vertices[end, 1] - vertices[start, 1]
    ) * (x - vertices[start, 0])


@helper
def edge_bias(vertices, start, end, other_bias):
    """Return 0 for a top or a left edge, ``other_bias`` for the others."""
    dx = vertices[end, 0] - vertices[start, 0]
    dy = vertices[end, 1] - vertices[start, 1]
    if dy < 0 or (dy == 0 and dx > 0):
        return np.int64(INCLUSIVE_BIAS)
    return np.int64(other_bias)


@helper
def edge_plane(vertices, start, end, other_bias):
    """Return an edge function as its gain along x, its gain along y, its value at 0 and bias."""
    return (
        vertices[start, 1] - vertices[end, 1],
        vertices[end, 0] - vertices[start, 0],
        edge_function(vertices, start, end, 0, 0),
        edge_bias(vertices, start, end, other_bias),
    )


@helper
def triangle_setup(vertices, other_bias):
    """Return the vertex order, the edge planes opposite those vertices, and A2."""
    a, b, c, double_area = ordered_vertices(vertices)
    planes = (
        edge_plane(vertices, b, c, other_bias),
        edge_plane(vertices, c, a, other_bias),
        edge_plane(vertices, a, b, other_bias),
    )
    return (a, b, c), planes, double_area


@helper
def clipped_bounds(vertices, width, height):
    """Return the first and the last column and row of the bounding box inside the target."""
    return (
        max(min(vertices[0, 0], vertices[1, 0], vertices[2, 0]), 0),
        min(max(vertices[0, 0], vertices[1, 0], vertices[2, 0]), width - 1),
        max(min(vertices[0, 1], vertices[1, 1], vertices[2, 1]), 0),
        min(max(vertices[0, 1], vertices[1, 1], vertices[2, 1]), height - 1),
    )


@helper
def plane_value(plane, x, y):
    """Return the edge function at pixel (x, y), without its bias."""
    return plane[0] * x + plane[1] * y + plane[2]


@helper
def channel_numerator(colors, order, channel, e0, e1, e2):
    """Return ``E0 c0 + E1 c1 + E2 c2`` for one channel."""
    return (
        e0 * np.int64(colors[order[0], channel])
        + e1 * np.int64(colors[order[1], channel])
        + e2 * np.int64(colors[order[2], channel])
    )


@helper
def packed_mix(colors, order, double_area, e0, e1, e2):
    """Return the RGBA pixel at the given edge functions, each channel rounded half up."""
    pixel = np.int64(0)
    for channel in range(4):
        numerator = channel_numerator(colors, order, channel, e0, e1, e2)
        pixel |= ((2 * numerator + double_area) // (2 * double_area)) << (8 * channel)
    return pixel


@helper
def passes_depth(depth, vertex_depths, order, double_area, e1, e2, x, y):
    """Test a pixel against the stored depth and store its own if it is smaller; true if none."""
    if depth.shape[0] == 0:
        return True
    d0 = vertex_depths[order[0]]
    mixed = (
        d0
        + (e1 / double_area) * (vertex_depths[order[1]] - d0)
        + (e2 / double_area) * (vertex_depths[order[2]] - d0)
    )
    nearer = np.float32(mixed) < depth[y, x]
    if nearer:
        depth[y, x] = np.float32(mixed)
    return nearer


@kernel
def fill_triangle(
    target: uint32[:, ::1], depth: float32[:, ::1], vertices: int64[:, ::1],
    vertex_depths: float64[::1], colors: uint8[:, ::1], other_bias: int64,
):  # fmt: skip
    """
    Fill a triangle by testing every pixel of its bounding box.

    Parameters
    ----------
    target : (H, W) uint32, C-contiguous
        RGBA pixels, red in the lowest byte.
    depth : (H, W) float32, or (0, 0): there is no depth test
        Smaller is nearer; only pixels nearer than it are drawn, and they replace it.
    vertices : (3, 2) int64, pixels
        Magnitudes up to ``MAX_COORDINATE``, in either winding.
    vertex_depths : (3,) float64, finite
        Any, if there is no depth test.
    colors : (3, 4) uint8, RGBA
    other_bias : int
        Of edges that are neither top nor left: ``EXCLUSIVE_BIAS`` is the top-left rule,
        ``INCLUSIVE_BIAS`` the inclusive one.

    Writes ``target`` and ``depth``.

    Notes
    -----
    A triangle of no area draws nothing.
    """
    order, (plane0, plane1, plane2), double_area = triangle_setup(vertices, other_bias)
    if double_area == 0:
        return
    x_min, x_max, y_min, y_max = clipped_bounds(vertices, target.shape[1], target.shape[0])
    for y in range(y_min, y_max + 1):
        for x in range(x_min, x_max + 1):
            e0 = plane_value(plane0, x, y)
            e1 = plane_value(plane1, x, y)
            e2 = plane_value(plane2, x, y)
            covered = e0 + plane0[3] >= 0 and e1 + plane1[3] >= 0 and e2 + plane2[3] >= 0
            if covered and passes_depth(depth, vertex_depths, order, double_area, e1, e2, x, y):
                target[y, x] = packed_mix(colors, order, double_area, e0, e1, e2)


@helper
def cut_span(plane, y, x_first, x_last):
    """Return the part of a row's span on the inner side of one edge; first > last if none."""
    gain = plane[0]
    rest = plane[1] * y + plane[2] + plane[3]
    if gain > 0:
        x_first = max(x_first, -(rest // gain))
    elif gain < 0:
        x_last = min(x_last, rest // -gain)
    elif rest < 0:
        x_last = x_first - 1
    return x_first, x_last


@helper
def channel_walk(colors, order, channel, edges, gains, double_area):
    """Return a channel as quotient and remainder of ``2 A2``, and both of its gain per pixel."""
    divisor = 2 * double_area
    value = 2 * channel_numerator(colors, order, channel, edges[0], edges[1], edges[2])
    gain = 2 * channel_numerator(colors, order, channel, gains[0], gains[1], gains[2])
    value += double_area
    return value // divisor, value % divisor, gain // divisor, gain % divisor


@helper
def next_channel(walk, divisor):
    """Return a channel one pixel to the right: add the gain, carry the remainder."""
    quotient, remainder, quotient_gain, remainder_gain = walk
    remainder += remainder_gain
    carry = np.int64(remainder >= divisor)
    return (
        quotient + quotient_gain + carry,
        remainder - carry * divisor,
        quotient_gain,
        remainder_gain,
    )


@kernel
def fill_triangle_scanline(
    target: uint32[:, ::1], depth: float32[:, ::1], vertices: int64[:, ::1],
    vertex_depths: float64[::1], colors: uint8[:, ::1], other_bias: int64,
):  # fmt: skip
    """
    Fill a triangle row by row: divide for the ends of each row, then only add.

    Takes what ``fill_triangle`` takes and writes the same bits. A row's span is where each edge
    function, a line along x, is on its inner side; the channels start with one exact division and
    then gain a quotient and a remainder per pixel.
    """
    order, (plane0, plane1, plane2), double_area = triangle_setup(vertices, other_bias)
    if double_area == 0:
        return
    divisor = 2 * double_area
    gains = (plane0[0], plane1[0], plane2[0])
    x_min, x_max, y_min, y_max = clipped_bounds(vertices, target.shape[1], target.shape[0])
    for y in range(y_min, y_max + 1):
        x_first, x_last = cut_span(plane0, y, x_min, x_max)
        x_first, x_last = cut_span(plane1, y, x_first, x_last)
        x_first, x_last = cut_span(plane2, y, x_first, x_last)
        if x_first > x_last:
            continue
        e0 = plane_value(plane0, x_first, y)
        e1 = plane_value(plane1, x_first, y)
        e2 = plane_value(plane2, x_first, y)
        red = channel_walk(colors, order, 0, (e0, e1, e2), gains, double_area)
        green = channel_walk(colors, order, 1, (e0, e1, e2), gains, double_area)
        blue = channel_walk(colors, order, 2, (e0, e1, e2), gains, double_area)
        alpha = channel_walk(colors, order, 3, (e0, e1, e2), gains, double_area)
        for x in range(x_first, x_last + 1):
            if passes_depth(depth, vertex_depths, order, double_area, e1, e2, x, y):
                target[y, x] = red[0] | (green[0] << 8) | (blue[0] << 16) | (alpha[0] << 24)
            red = next_channel(red, divisor)
            green = next_channel(green, divisor)
            blue = next_channel(blue, divisor)
            alpha = next_channel(alpha, divisor)
            e1 += gains[1]
            e2 += gains[2]


@helper
def put_pixel(target, x, y, pixel):
    """Write one pixel if it lies inside the target."""
    if 0 <= x < target.shape[1] and 0 <= y < target.shape[0]:
        target[y, x] = pixel


@helper
def put_rotations(target, center_x, center_y, x, y, pixel):
    """Write an offset from the centre and its three quarter turns."""
    put_pixel(target, center_x + x, center_y + y, pixel)
    put_pixel(target, center_x - y, center_y + x, pixel)
    put_pixel(target, center_x - x, center_y - y, pixel)
    put_pixel(target, center_x + y, center_y - x, pixel)


@kernel
def draw_circle(
    target: uint32[:, ::1], center_x: int64, center_y: int64, radius: int64, pixel: int64
):  # fmt: skip
    """
    Draw a circle by the midpoint test, clipped to the target, each pixel once.

    Parameters
    ----------
    target : (H, W) uint32
        RGBA pixels, red in the lowest byte.
    center_x, center_y, radius : int, pixels
        Magnitudes up to ``MAX_COORDINATE``; radius >= 0.
    pixel : int
        The colour, packed.

    Writes ``target``.

    Notes
    -----
    In the octant ``0 <= x <= y`` the pixel of column x is the one whose vertical extent the circle
    crosses: ``(y - 1/2)**2 < r**2 - x**2 < (y + 1/2)**2``, never a tie between integers. Radius 0
    is one pixel.
    """
    if radius == 0:
        put_pixel(target, center_x, center_y, pixel)
        return
    x = np.int64(0)
    y = np.int64(radius)
    # x**2 + (y - 1/2)**2 - r**2 - 1/4, the midpoint below the pixel, always an integer
    midpoint = -y
    while x <= y:
        put_rotations(target, center_x, center_y, x, y, pixel)
        # The mirrored octant; its ends are already there as quarter turns of this one's
        if 0 < x < y:
            put_rotations(target, center_x, center_y, -x, y, pixel)
        midpoint += 2 * x + 1
        x += 1
        if midpoint >= 0:
            midpoint -= 2 * y - 2
            y -= 1


@helper
def bezier_segments(points):
    """
    Return how many equal parameter steps keep the chords within ``FLATNESS`` of the curve.

    For degree ``d`` and ``M`` the largest second difference of the control points, the distance
    with ``n`` segments is at most ``d (d - 1) M / (8 n**2)`` [3]_.
    """
    degree = points.shape[0] - 1
    largest = 0.0
    for i in range(degree - 1):
        second_x = points[i + 2, 0] - 2.0 * points[i + 1, 0] + points[i, 0]
        second_y = points[i + 2, 1] - 2.0 * points[i + 1, 1] + points[i, 1]
        largest = max(largest, math.sqrt(second_x * second_x + second_y * second_y))
    bound = degree * (degree - 1) * largest / (8.0 * FLATNESS)
    return max(1, math.ceil(math.sqrt(bound)))


@helper
def bezier_coordinate(points, axis, t):
    """Return one coordinate of a quadratic or cubic at ``t``, by de Casteljau's mixing."""
    s = 1.0 - t
    a = s * points[0, axis] + t * points[1, axis]
    b = s * points[1, axis] + t * points[2, axis]
    if points.shape[0] == 3:
        return s * a + t * b
    c = s * points[2, axis] + t * points[3, axis]
    return s * (s * a + t * b) + t * (s * b + t * c)


@helper
def ramp_channel(start, end, step, steps):
    """Return ``start + step * (end - start) / steps``, rounded half up, in integers."""
    start, end = np.int64(start), np.int64(end)
    return (2 * (steps * start + step * (end - start)) + steps) // (2 * steps)


@helper
def ramp_color(colors, step, steps):
    """Return the colour at ``step`` of a ramp of ``steps`` as four ``int64``."""
    return (
        ramp_channel(colors[0, 0], colors[1, 0], step, steps),
        ramp_channel(colors[0, 1], colors[1, 1], step, steps),
        ramp_channel(colors[0, 2], colors[1, 2], step, steps),
        ramp_channel(colors[0, 3], colors[1, 3], step, steps),
    )


@helper
def nearest_pixel(coordinate):
    """Return a coordinate rounded half up; pixel centres are at the integers here."""
    return np.int64(math.floor(coordinate + 0.5))


@kernel
def draw_bezier(target: uint32[:, ::1], points: float64[:, ::1], colors: uint8[:, ::1]):
    """
    Draw a quadratic or cubic Bezier curve as connected lines.

    Parameters
    ----------
    target : (H, W) uint32, C-contiguous
        RGBA pixels, red in the lowest byte.
    points : (3, 2) or (4, 2) float64, pixels
        Control points, magnitudes up to ``MAX_COORDINATE``; integers are pixel centres.
    colors : (2, 4) uint8, RGBA
        At the start and at the end; in between they follow the curve's parameter.

    Writes ``target``.

    Notes
    -----
    The chords stay within ``FLATNESS`` of the curve; their ends are rounded half up to pixels. A
    chord that stays in one pixel is left out, but for the last, so both ends have their own
    colour. Control points that coincide draw one pixel of the end's colour.
    """
    height, width = target.shape
    pixels = flat(target)
    segments = bezier_segments(points)
    x0 = nearest_pixel(points[0, 0])
    y0 = nearest_pixel(points[0, 1])
    start = ramp_color(colors, 0, segments)
    for segment in range(1, segments + 1):
        t = segment / segments
        x1 = nearest_pixel(bezier_coordinate(points, 0, t))
        y1 = nearest_pixel(bezier_coordinate(points, 1, t))
        end = ramp_color(colors, segment, segments)
        if x1 == x0 and y1 == y0:
            if segment < segments:
                continue
            start = end
        draw_line(pixels, width, height, (x0, y0, x1, y1), start, end)
        x0, y0, start = x1, y1, end
