"""Slow, exact twin of iso-lines: how far a pixel's centre is from the line of a level."""

from __future__ import annotations

from fractions import Fraction
from math import sqrt

from rasterjit.inspect import oracle


def signed_distance(shares_at, scalars, level, column, row):
    """
    Return how far a pixel's centre lies above a line, pixels; None where a face has no line.

    ``shares_at`` returns three exact shares at a point of the screen, linear in it, to which the
    weights of the vertices are proportional.
    """
    ways = [Fraction(scalar) - Fraction(level) for scalar in scalars]
    x, y = column + Fraction(1, 2), row + Fraction(1, 2)

    def g(x, y):
        return sum(share * way for share, way in zip(shares_at(x, y), ways, strict=True))

    here, right, down = g(x, y), g(x + 1, y) - g(x, y), g(x, y + 1) - g(x, y)
    if right == down == 0 or len({*ways}) == 1:
        return None
    size = max(abs(right), abs(down))
    length = sqrt((right / size) ** 2 + (down / size) ** 2)
    turn = 1 if sum(shares_at(x, y)) > 0 else -1
    return float(turn * here / size) / length


def snapped_shares(corners, ws):
    """Return the shares of a face that was not clipped, by its snapped corners, pixels, and w."""
    a, b, c = corners

    def shares(x, y):
        edges = oracle.edge(b, c, (x, y)), oracle.edge(c, a, (x, y)), oracle.edge(a, b, (x, y))
        return [edge / Fraction(w) for edge, w in zip(edges, ws, strict=True)]

    return shares


def clipped_shares(clip_positions, size):
    """Return the shares of a face of clip positions, which may lie behind the eye."""
    corners = [tuple(map(Fraction, (x, y, w))) for x, y, _, w in clip_positions]
    a, b, c = corners

    def volume(p, q, r):
        return (
            p[0] * (q[1] * r[2] - q[2] * r[1])
            + p[1] * (q[2] * r[0] - q[0] * r[2])
            + p[2] * (q[0] * r[1] - q[1] * r[0])
        )

    def shares(x, y):
        ray = 2 * Fraction(x) / size[0] - 1, 1 - 2 * Fraction(y) / size[1], Fraction(1)
        return [volume(ray, b, c), volume(ray, c, a), volume(ray, a, b)]

    return shares
