"""Segments with a width, slowly and exactly: corners, coverage, distance, weights."""

from __future__ import annotations

import math
from fractions import Fraction

from rasterjit.inspect import oracle

UNITS = 256
SPARE = Fraction(1, 10**6)


def snapped(point):
    """Return a screen point on the grid, units: half to even."""
    return tuple(round(Fraction(float(value)) * UNITS) for value in point)


def outward(part, half, squared):
    """Return the least whole number of units that ``part * half / sqrt(squared)`` is not above."""
    # (k + spare)^2 squared >= (part half)^2
    wanted = (part * half) ** 2 / Fraction(squared)
    k = max(math.isqrt(math.floor(wanted)) - 1, 0)
    while (k + SPARE) ** 2 < wanted:
        k += 1
    return k if part >= 0 else -k


def body(a, b, width):
    """Return the corners of a segment's body, units, given its ends and its width, pixels."""
    (x0, y0), (x1, y1) = snapped(a), snapped(b)
    dx, dy = x1 - x0, y1 - y0
    half = Fraction(float(width)) * UNITS / 2
    across, down = (outward(part, half, dx * dx + dy * dy) for part in (-dy, dx))
    return [
        (x0 + across, y0 + down), (x0 - across, y0 - down), (x1 - across, y1 - down),
        (x1 + across, y1 + down),
    ]  # fmt: skip


def covered(corners, size):
    """Return the pixels (row, column) whose centres a quadrilateral holds, by the top-left rule."""
    p, q, r, s = corners
    found = set()
    for row in range(size[1]):
        for column in range(size[0]):
            centre = column * UNITS + UNITS // 2, row * UNITS + UNITS // 2
            if oracle.covers((p, q, r), centre) or oracle.covers((p, r, s), centre):
                found.add((row, column))
    return found


def distance(a, b, point):
    """Return how far a point is from a segment, pixels."""
    (ax, ay), (bx, by), (px, py) = a, b, point
    dx, dy = bx - ax, by - ay
    size = dx * dx + dy * dy
    t = 0.0 if size == 0 else min(max(((px - ax) * dx + (py - ay) * dy) / size, 0.0), 1.0)
    return math.hypot(ax + t * dx - px, ay + t * dy - py)


def share(a, b, w, point):
    """Return the weight of the second end at the foot of the perpendicular; w is of both ends."""
    (ax, ay), (bx, by), (px, py) = (tuple(map(Fraction, p)) for p in (a, b, point))
    dx, dy = bx - ax, by - ay
    t = ((px - ax) * dx + (py - ay) * dy) / (dx * dx + dy * dy)
    t = min(max(t, Fraction(0)), Fraction(1))
    wa, wb = map(Fraction, w)
    return (t / wb) / ((1 - t) / wa + t / wb)
