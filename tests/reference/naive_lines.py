"""Slow, obvious twins of the line and primitive kernels: plain Python integers and fractions."""

from __future__ import annotations

import functools
import itertools
import math
from fractions import Fraction

import numpy as np

from rasterjit.classics import primitives
from rasterjit.inspect import oracle


def draw_line(image, start, end, start_color, end_color, steps=None):
    """
    Draw the steps of a line (all, or those given) that lie inside; image is (H, W, 4) uint8.

    What ``oracle.line_pixels`` and ``oracle.line_colors`` list, in whole numbers: of n steps, step
    k of a change by d is k d / n, rounded half up, which is (2 k d + n) // (2 n).
    """
    height, width = image.shape[:2]
    (x0, y0), dx, dy = start, end[0] - start[0], end[1] - start[1]
    n = max(abs(dx), abs(dy))
    double = 2 * max(n, 1)
    ramp = [(a, b - a) for a, b in zip(start_color, end_color, strict=True)]
    for k in range(n + 1) if steps is None else steps:
        x, y = x0 + (2 * k * dx + n) // double, y0 + (2 * k * dy + n) // double
        if 0 <= x < width and 0 <= y < height:
            image[y, x] = [first + (2 * k * change + n) // double for first, change in ramp]


def triangle_pixels(vertices, colors, size, edges="top-left"):
    """Map (x, y) to the colour of every pixel that a triangle covers; vertices are pixels."""
    found = {}
    if oracle.edge(*vertices) == 0:
        return found
    for pixel in itertools.product(range(size[0]), range(size[1])):
        if edges == "top-left" and not oracle.covers(vertices, pixel):
            continue
        weights = oracle.affine_weights(vertices, pixel)
        if min(weights) >= 0:
            color = oracle.interpolate(weights, colors)
            found[pixel] = tuple(oracle.round_half_up(channel) for channel in color)
    return found


def circle_pixels(center, radius):
    """List the pixels of a circle, in every column or row of an octant the nearest to it."""
    pixels = set()
    for x in range(radius + 1):
        y = (math.isqrt(4 * (radius * radius - x * x)) + 1) // 2
        if x <= y:
            for u, v in ((x, y), (y, x)):
                pixels |= {(u, v), (-u, v), (u, -v), (-u, -v)}
    return {(center[0] + x, center[1] + y) for x, y in pixels}


def bezier_vertices(points, segments):
    """List (t, (x, y)) at equal steps of the parameter, by Bernstein polynomials."""
    degree = len(points) - 1
    vertices = []
    for k in range(segments + 1):
        t = Fraction(k, segments)
        weights = [math.comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in range(degree + 1)]
        vertices.append((t, tuple(oracle.interpolate(weights, points))))
    return vertices


def rounded(value):
    """Round to a whole number; a tie, and what lies barely below one, goes up."""
    return math.floor(value + Fraction(1, 2) + Fraction(primitives.TIE_PX))


def are_neighbours(one, other):
    """Return whether two pixels are one or touch."""
    return max(abs(one[0] - other[0]), abs(one[1] - other[1])) <= 1


class BezierPath:
    """
    The pixels of a curve in the order of its parameter, as (pixel, t), from exact chords.

    ``visits`` begins and ends with the pixels of the end points. Between them lie the pixels
    nearest to where a chord crosses columns or, if it is steep, rows, and turns that are needed.
    """

    def __init__(self, points, segments):
        points = [tuple(map(Fraction, point)) for point in points]
        self.visits = []
        self.turn = None
        self.chord = None
        self.add(0, points[0])
        place = points[0]
        for (t, _), (t_end, end) in itertools.pairwise(bezier_vertices(points, segments)):
            if max(abs(a - b) for a, b in zip(place, end, strict=True)) >= primitives.TIE_PX:
                self.follow((t, place), (t_end, end))
                place = end
        self.visit(1, points[-1])
        self.visits[-1] = (self.visits[-1][0], 1)

    def add(self, t, place):
        """Add the pixel nearest to a place, unless it is the one before."""
        pixel = tuple(map(rounded, place))
        if not self.visits or self.visits[-1][0] != pixel:
            self.visits.append((pixel, t))

    def is_far(self, pixel):
        """Return whether the turn lies far from a pixel's centre."""
        square = sum((a - b) ** 2 for a, b in zip(self.turn[1], pixel, strict=True))
        return square > Fraction(primitives.MAX_TURN_DISTANCE_PX) ** 2

    def visit(self, t, place):
        """Go to the pixel nearest to a place; add the turn if it is needed on the way."""
        last, pixel = self.visits[-1][0], tuple(map(rounded, place))
        if self.turn and (
            not are_neighbours(last, pixel) or (self.is_far(last) and self.is_far(pixel))
        ):
            self.add(*self.turn)
        self.turn = None
        self.add(t, place)

    def pass_joint(self, t, place, is_new, is_back):
        """Remember the place between two chords if there is a turn, new or not yet passed."""
        last = self.visits[-1][0]
        is_needed = self.turn and (
            not are_neighbours(last, tuple(map(rounded, place))) or self.is_far(last)
        )
        if is_new and is_needed:
            self.add(*self.turn)
        if is_new or (self.turn and not is_needed):
            self.turn = (t, place)
        if is_new and is_back:
            self.add(t, place)
            self.turn = None

    def follow(self, start, end):
        """Visit where a chord crosses the lines of pixels along which it runs."""
        (t, place), (t_end, place_end) = start, end
        change = tuple(b - a for a, b in zip(place, place_end, strict=True))
        axis = int(abs(change[0]) < abs(change[1]) * Fraction(primitives.MIN_COLUMN_SHARE))
        heading = axis, change[axis] > 0, change[1 - axis] < -primitives.TIE_PX
        if self.chord:
            product = sum(a * b for a, b in zip(change, self.chord[1], strict=True))
            self.pass_joint(t, place, self.chord[0] != heading, product < 0)
        self.chord = heading, change
        if change[axis] > 0:
            crossed = range(math.floor(place[axis]) + 1, math.floor(place_end[axis]) + 1)
        else:
            crossed = range(math.ceil(place[axis]) - 1, math.ceil(place_end[axis]) - 1, -1)
        for major in crossed:
            part = (major - place[axis]) / change[axis]
            minor = place[1 - axis] + part * change[1 - axis]
            self.visit(t + part * (t_end - t), (minor, major) if axis else (major, minor))


def draw_bezier(image, points, segments, start_color, end_color):
    """Draw a curve into an (H, W, 4) uint8 image; where it comes back, the later colour stays."""
    height, width = image.shape[:2]
    for (x, y), t in BezierPath(points, segments).visits:
        if 0 <= x < width and 0 <= y < height:
            ramp = zip(start_color, end_color, strict=True)
            image[y, x] = [rounded(a + t * (b - a)) for a, b in ramp]


MAX_CHANGE = 255
"""Of a channel, and of a coordinate on a panel."""


@functools.cache
def moved(side):
    """Return k d / n, rounded half up, at [n, k, d + MAX_CHANGE], int32; n and k < side."""
    n, k = np.arange(side)[:, None, None], np.arange(side)[None, :, None]
    change = np.arange(-MAX_CHANGE, MAX_CHANGE + 1)
    return ((2 * k * change + n) // (2 * np.maximum(n, 1))).astype(np.int32)


def lines_on_panels(starts, ends, colors, side):
    """
    Draw line i into panel i of a (N * side, side, 4) picture, all at once.

    The same formulas as in `draw_line`, looked up in a table, for points inside the panel.
    """
    assert side <= MAX_CHANGE
    picture, table = np.zeros((len(starts) * side * side, 4), np.uint8), moved(side)
    change = ends - starts
    n = np.abs(change).max(axis=1)
    first, last = colors[:, 0].astype(np.int32), colors[:, 1].astype(np.int32)
    panel, step = np.nonzero(np.arange(side) <= n[:, None])
    row = (n[panel] * side + step) * table.shape[2] + MAX_CHANGE
    x, y = (starts[panel, axis] + table.take(row + change[panel, axis]) for axis in (0, 1))
    ramp = first[panel] + table.take(row[:, None] + (last - first)[panel])
    picture[(panel * side + y) * side + x] = ramp
    return picture.reshape(-1, side, 4)


def lines_of_bands(ends, size, rows):
    """List for each band of rows the numbers of the lines whose bounding box reaches it."""
    width, height = size
    bands = []
    for top in range(0, height, rows):
        bottom = min(top + rows, height) - 1
        bands.append(
            [
                number
                for number, (x0, y0, x1, y1) in enumerate(ends)
                if max(x0, x1) >= 0
                and min(x0, x1) < width
                and max(y0, y1) >= top
                and min(y0, y1) <= bottom
            ]
        )
    return bands


def cut_polygon(polygon, normal, most):
    """Return what of a convex polygon has ``normal . p <= most``."""
    kept = []
    for (px, py), (qx, qy) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        here, there = (
            normal[0] * x + normal[1] * y - most for x, y in ((px, py), (qx, qy))
        )  # fmt: skip
        if here <= 0.0:
            kept.append((px, py))
        if here * there < 0.0:
            t = here / (here - there)
            kept.append((px + t * (qx - px), py + t * (qy - py)))
    return kept


def polygon_area(polygon):
    """Return the area of a polygon, whichever way it runs."""
    pairs = zip(polygon, polygon[1:] + polygon[:1], strict=True)
    return 0.5 * abs(sum(px * qy - qx * py for (px, py), (qx, qy) in pairs))


def rectangle_of(start, end):
    """Return the half-planes (normal, most) of a line one pixel wide, and its direction."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = math.sqrt(dx * dx + dy * dy)
    x, y = (dx / length, dy / length) if length > 0.0 else (1.0, 0.0)
    middle = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])
    planes = []
    for (nx, ny), half in (((x, y), 0.5 * length + 0.5), ((-y, x), 0.5)):
        place = nx * middle[0] + ny * middle[1]
        planes += [((nx, ny), place + half), ((-nx, -ny), half - place)]
    return planes


def line_share(start, end, column, row):
    """Return the part of a pixel that a line covers: its square, cut along all four sides."""
    square = [(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)]
    for normal, most in rectangle_of(start, end):
        square = cut_polygon(square, normal, most) if square else square
    return polygon_area(square) if square else 0.0


def is_cut_by_end_and_side(start, end, column, row):
    """Return whether an end and a long side of a line both cut a pixel."""
    corners = [(column + i, row + j) for i in (0, 1) for j in (0, 1)]
    cut = [
        min(nx * x + ny * y for x, y in corners) < most - 1e-9
        and max(nx * x + ny * y for x, y in corners) > most + 1e-9
        for (nx, ny), most in rectangle_of(start, end)
    ]
    return (cut[0] or cut[1]) and (cut[2] or cut[3])


def stroke_shares(segments, half_width, size, steps=16):
    """
    Return how much of each pixel lies within half a width of a segment, (H, W), by sampling.

    ``segments`` are (N, 4), x0, y0, x1, y1 in pixels; each pixel has ``steps ** 2`` samples.
    """
    width, height = size
    columns = (np.arange(width * steps) + 0.5) / steps
    rows = (np.arange(height * steps) + 0.5) / steps
    x, y = np.meshgrid(columns, rows)
    nearest = np.full(x.shape, np.inf)
    for x0, y0, x1, y1 in np.asarray(segments, float):
        squared = (x1 - x0) ** 2 + (y1 - y0) ** 2
        share = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / squared
        share = np.clip(share, 0.0, 1.0)
        off_x, off_y = x - x0 - share * (x1 - x0), y - y0 - share * (y1 - y0)
        nearest = np.minimum(nearest, off_x * off_x + off_y * off_y)
    inside = nearest <= half_width * half_width
    return inside.reshape(height, steps, width, steps).mean(axis=(1, 3))
