"""Slow, obvious twins of the line and primitive kernels: plain Python integers and fractions."""

from __future__ import annotations

import functools
import itertools
import math
from fractions import Fraction

import numpy as np

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
    """List the pixels at equal steps of the parameter, by Bernstein polynomials."""
    degree = len(points) - 1
    vertices = []
    for k in range(segments + 1):
        t = Fraction(k, segments)
        weights = [math.comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in range(degree + 1)]
        vertices.append(
            tuple(
                oracle.round_half_up(coordinate)
                for coordinate in oracle.interpolate(weights, points)
            )
        )
    return vertices


MOST_CHANGE = 255
"""Of a channel, and of a coordinate on a panel."""


@functools.cache
def moved(side):
    """Return k d / n, rounded half up, at [n, k, d + MOST_CHANGE], int32; n and k < side."""
    n, k = np.arange(side)[:, None, None], np.arange(side)[None, :, None]
    change = np.arange(-MOST_CHANGE, MOST_CHANGE + 1)
    return ((2 * k * change + n) // (2 * np.maximum(n, 1))).astype(np.int32)


def lines_on_panels(starts, ends, colors, side):
    """
    Draw line i into panel i of a (N * side, side, 4) picture, all at once.

    The same formulas as in `draw_line`, looked up in a table, for points inside the panel.
    """
    assert side <= MOST_CHANGE
    picture, table = np.zeros((len(starts) * side * side, 4), np.uint8), moved(side)
    change = ends - starts
    n = np.abs(change).max(axis=1)
    first, last = colors[:, 0].astype(np.int32), colors[:, 1].astype(np.int32)
    panel, step = np.nonzero(np.arange(side) <= n[:, None])
    row = (n[panel] * side + step) * table.shape[2] + MOST_CHANGE
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
