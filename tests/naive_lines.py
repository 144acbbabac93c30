"""Slow, obvious twins of the line and primitive kernels: plain Python integers and fractions."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

HALF = Fraction(1, 2)


def round_half_up(value: Fraction) -> int:
    return math.floor(value + HALF)


def line_pixels(start, end, start_color=(0,) * 4, end_color=(0,) * 4, steps=None):
    """List (x, y, color) for the steps of a line (all, or those given)."""
    n = max(abs(end[0] - start[0]), abs(end[1] - start[1]))
    pixels = []
    for k in range(n + 1) if steps is None else steps:
        t = Fraction(k, n) if n else Fraction(0)
        x = round_half_up(start[0] + t * (end[0] - start[0]))
        y = round_half_up(start[1] + t * (end[1] - start[1]))
        color = tuple(
            round_half_up(a + t * (b - a)) for a, b in zip(start_color, end_color, strict=True)
        )
        pixels.append((x, y, color))
    return pixels


def draw_line(image, start, end, start_color, end_color):
    """Draw the whole line and keep what lies inside; image is (H, W, 4) uint8."""
    height, width = image.shape[:2]
    for x, y, color in line_pixels(start, end, start_color, end_color):
        if 0 <= x < width and 0 <= y < height:
            image[y, x] = color


def edge(a, b, p):
    """Twice the signed area of (a, b, p)."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def triangle_weights(vertices, p):
    """The three edge functions at p, positive inside, and twice the area."""
    a, b, c = vertices
    area = edge(a, b, c)
    sign = 1 if area >= 0 else -1
    return [sign * edge(b, c, p), sign * edge(c, a, p), sign * edge(a, b, p)], sign * area


def owns_ties(a, b, third):
    """Whether the edge from a to b of a triangle with this third vertex is a top or left one."""
    if edge(a, b, third) < 0:
        a, b = b, a
    return b[1] < a[1] or (b[1] == a[1] and b[0] > a[0])


def triangle_pixels(vertices, colors, size, edges="top-left"):
    """Map (x, y) to the colour of every pixel that a triangle covers."""
    a, b, c = vertices
    opposite = ((b, c, a), (c, a, b), (a, b, c))
    found = {}
    for y in range(size[1]):
        for x in range(size[0]):
            weights, area = triangle_weights(vertices, (x, y))
            if area == 0 or min(weights) < 0:
                continue
            on_edges = [opposite[i] for i in range(3) if weights[i] == 0]
            if edges == "top-left" and not all(owns_ties(*e) for e in on_edges):
                continue
            found[x, y] = tuple(
                round_half_up(
                    sum(
                        Fraction(w, area) * color[k]
                        for w, color in zip(weights, colors, strict=True)
                    )
                )
                for k in range(4)
            )
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
                round_half_up(
                    sum(w * Fraction(p[axis]) for w, p in zip(weights, points, strict=True))
                )
                for axis in range(2)
            )
        )
    return vertices


def lines_on_panels(starts, ends, colors, side):
    """
    Draw line i into panel i of a (N * side, side, 4) picture, all at once.

    The same formulas as ``line_pixels``, in NumPy integers, for points inside the panel.
    """
    picture = np.zeros((len(starts) * side, side, 4), np.uint8)
    change = ends - starts
    n = np.abs(change).max(axis=1)[:, None, None]
    k = np.arange(side)[None, :, None]
    divisor = 2 * np.maximum(n, 1)
    place = starts[:, None] + (2 * k * change[:, None] + n) // divisor
    first, last = colors[:, None, 0].astype(np.int64), colors[:, None, 1].astype(np.int64)
    ramp = first + (2 * k * (last - first) + n) // divisor
    panel, step = np.nonzero((k <= n)[:, :, 0])
    x, y = place[panel, step].T
    picture[panel * side + y, x] = ramp[panel, step]
    return picture
