"""
Bound what lamps, the lights that have a place, do to the colours of a face found in float32.

See ``survey.precision``: how bright a lamp is on a face at most, and by how much an error of the
points on it moves a code. Both follow from the least distance between lamp and face. That is at
least the distance of the first vertex, less the longer way from there to another one; and at least
that of the lamp from the plane of the face, if the face is thick enough for float32 to tell where
it faces.
"""

from __future__ import annotations

import numpy as np

from rasterjit.runtime.jit import disjoint_helper, helper

ROUNDING = 2.0**-24
SLOPE = 12.92 * 255.0
"""Codes that linear light of 1 adds at most: in the dark."""

CODES_PER_SHARE = 255.0 * 1.055 / 2.4
"""Codes by which light moves, over the share of itself that it does: where it is white."""

LAMP_SHARE = 3.0 / 128.0
"""Of a code that errors of points may come to by the light of lamps."""

LIGHT, ENDING, RAMP, CONE, PYRAMID, LAMP_COLUMNS = 3, 4, 5, 6, 7, 18
"""
Columns of lamps, behind where each lies relative to the eye.

Its light at a distance of one unit; one over the range squared, 0 for no end. At a distance of one,
codes by which the light of its cone moves over the cosine with the axis, and over the angle: on
white, without a highlight. The pyramid around its cone: two axes at right angles to its own, that
itself, sine and cosine of the angle of the sides; all 0 without a cone.
"""
ACROSS, DOWN, AHEAD, SINE, COSINE = PYRAMID, PYRAMID + 3, PYRAMID + 6, PYRAMID + 9, PYRAMID + 10

DIAGONAL = np.float32(np.sqrt(0.5))

REACH_ROUNDING = np.float32(2.0**-19)
"""Widening of what a lamp reaches, as a share of distances: above what points are off by, and below
that of ``survey.lights``, so that what is out for a whole object is out for its faces."""

LIGHT_ERROR = np.float32(8.0)
"""Roundings of a direction that light is worked out with, and of a cosine with it."""

MORE_NORMAL, MORE_BENT, MOST_LIGHT, RANGE_SLOPE, OTHER_SLOPE, CONE_SHARE = range(3, 9)
LIMITS = 12
"""Elements of limits, and how many there are with those of ``steep``: see
``survey.precision.limits_of``."""
BY_LAMPS, ALL_LIMITS = 3, 3 + LIMITS
"""Of an object: three for faces that no lamp reaches, those behind them for others."""

MOST = np.float32(LAMP_SHARE / ROUNDING)
"""Codes that lamps may move, in roundings."""

BELOW, ABOVE = np.float32(1.0 - 2.0**-12), np.float32(1.0 + 2.0**-12)
"""Distances times these are below and above what they are rounded to, and those of points that are
off by as much as float32 is good for."""

THIN, BESIDE = np.float32(2.0**-20), np.float32(2.0**-9)
"""
A face is thick if the sine of an angle of it is above the root of the first.

Its normal is off by 14 roundings over that sine then, and the distance of a lamp from its plane by
less than the second of the distance.
"""

HALF = np.float32(0.5)

SHORTEST = np.float32(1e-15)
"""Distances below this are taken for it: light is infinite soon after."""


@helper
def square(x, y, z):
    """Return the squared length of a vector."""
    return x * x + y * y + z * z


@helper
def facing_of(u, v):
    """Return the unit normal of a face with two ways from its first vertex; 0 if it is thin."""
    x, y, z = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    squared = square(x, y, z)
    is_thick = squared > THIN * (square(u[0], u[1], u[2]) * square(v[0], v[1], v[2]))
    scale = np.float32(1.0) / np.sqrt(squared if is_thick else np.float32(1.0))
    scale = scale if is_thick else np.float32(0.0)
    return x * scale, y * scale, z * scale


@helper
def gap(a, u, v, slack):
    """Return how far a, a + u and a + v lie on one side of 0; 0 if they do not."""
    least, most = a + min(np.float32(0.0), min(u, v)), a + max(np.float32(0.0), max(u, v))
    return max(max(least, -most) - slack, np.float32(0.0))


@helper
def dot(x, y, z, lamp, axis):
    """Return the scalar product of a vector and an axis of a lamp's pyramid."""
    return x * lamp[axis] + y * lamp[axis + 1] + z * lamp[axis + 2]


@helper
def is_beside(cone, aheads, asides, slack):
    """Return whether three points all lie beyond one side of a pyramid, given its sine, cosine."""
    sine, cosine = cone
    least = min(cosine * asides[0] - sine * aheads[0], cosine * asides[1] - sine * aheads[1])
    return min(least, cosine * asides[2] - sine * aheads[2]) > slack


@helper
def reaches(lamp, first, ways, slack):
    """
    Return whether a lamp may reach a face: its range and its cone do not surely end before it.

    It is out of a cone if it lies behind the lamp, or beyond a side of the pyramid around the cone;
    out of a range if the box around it is. Planes and boxes that have a whole object outside have
    each of its faces there: what ``survey.lights`` calls out, this does.

    Parameters
    ----------
    lamp : (18,) float32
    first : tuple of 3 float32
        The first vertex, relative to the lamp.
    ways : two tuples of 3 float32
        From there to the other vertices.
    slack : float32
        What points are off by at most.
    """
    (x, y, z), (u, v) = first, ways
    beyond = square(gap(x, u[0], v[0], slack), gap(y, u[1], v[1], slack), gap(z, u[2], v[2], slack))
    is_out = beyond * lamp[ENDING] >= np.float32(1.0)
    cone = lamp[SINE], lamp[COSINE]
    right, down, ahead = (
        dot(x, y, z, lamp, ACROSS), dot(x, y, z, lamp, DOWN), dot(x, y, z, lamp, AHEAD)
    )  # fmt: skip
    right_u, down_u, ahead_u = (
        right + dot(u[0], u[1], u[2], lamp, ACROSS), down + dot(u[0], u[1], u[2], lamp, DOWN),
        ahead + dot(u[0], u[1], u[2], lamp, AHEAD),
    )  # fmt: skip
    right_v, down_v, ahead_v = (
        right + dot(v[0], v[1], v[2], lamp, ACROSS), down + dot(v[0], v[1], v[2], lamp, DOWN),
        ahead + dot(v[0], v[1], v[2], lamp, AHEAD),
    )  # fmt: skip
    is_out |= max(ahead, max(ahead_u, ahead_v)) < -slack
    aheads, one, d = (ahead, ahead_u, ahead_v), np.float32(1.0), DIAGONAL
    for turn in (one, -one):
        is_out |= is_beside(cone, aheads, (turn * right, turn * right_u, turn * right_v), slack)
        is_out |= is_beside(cone, aheads, (turn * down, turn * down_u, turn * down_v), slack)
        for other in (d, -d):
            asides = (
                turn * d * right + other * down, turn * d * right_u + other * down_u,
                turn * d * right_v + other * down_v,
            )  # fmt: skip
            is_out |= is_beside(cone, aheads, asides, slack)
    return ~is_out


@helper
def lamp_on_face(lamp, first, ways, facing, away, way, limits):
    """
    Return the light of a lamp on a face at most, and roundings of a code that it moves.

    Both are 0 exactly if its range and its cone surely end before the face.

    Parameters
    ----------
    lamp : (18,) float32
    first, facing : tuple of 3 float32
        The first vertex, relative to the eye, and the unit normal.
    ways : two tuples of 3 float32
        From there to the other vertices.
    away, way : float32
        Distance of the first vertex from the eye, and the longer way to another vertex.
    limits : (12,) float32
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    x, y, z = lamp[0] - first[0], lamp[1] - first[1], lamp[2] - first[2]
    distance = np.sqrt(square(x, y, z))
    height = abs(x * facing[0] + y * facing[1] + z * facing[2])
    near = max(BELOW * distance - ABOVE * way, height - BESIDE * distance)
    near = max(near, SHORTEST)
    over, far = one / near, ABOVE * (distance + way)
    gone = min(far * far * lamp[ENDING], one)
    light = lamp[LIGHT] * (over * over)
    gone *= gone
    ending = np.float32(2.0 * CODES_PER_SHARE) if gone <= HALF else limits[RANGE_SLOPE] * light
    slope = np.float32(SLOPE) * light + limits[OTHER_SLOPE]
    slope += np.float32(4.0) * gone * ending
    off = (np.float32(3.0) * away + np.float32(23.0) * way) * over
    share = limits[CONE_SHARE] * over
    moved = (slope + lamp[CONE] * share) * off + (slope + lamp[RAMP] * share) * LIGHT_ERROR
    is_reached = reaches(lamp, (-x, -y, -z), ways, REACH_ROUNDING * (away + way + distance))
    return light if is_reached else zero, moved if is_reached else zero


@helper
def limits_on_face(light, moved, limits):
    """
    Return the limits of normals and points of a face, three, and whether it takes float32 at all.

    Takes its light of lamps, roundings of a code that they move, and all limits of its object.
    """
    plain, by_lamps = limits
    # What is not a number is reached, and not sure.
    is_reached = ~(moved <= np.float32(0.0))
    is_sure = ~is_reached | ((light <= by_lamps[MOST_LIGHT]) & (moved <= MOST))
    return (
        by_lamps[0] if is_reached else plain[0],
        by_lamps[1] if is_reached else plain[1],
        by_lamps[2] if is_reached else plain[2],
        is_sure,
    )


@disjoint_helper
def start_lamps(light, moved):
    """Write that no lamp shines."""
    for n in range(light.shape[0]):
        light[n], moved[n] = np.float32(0.0), np.float32(0.0)
