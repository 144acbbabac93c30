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

LIGHT, ENDING, RAMP, CONE, LAMP_COLUMNS = 3, 4, 5, 6, 7
"""
Columns of lamps, behind where each lies relative to the eye.

Its light at a distance of one unit; one over the range squared, 0 for no end. At a distance of one,
codes by which the light of its cone moves over the cosine with the axis, and over the angle: on
white, without a highlight.
"""

LIGHT_ERROR = np.float32(8.0)
"""Roundings of a direction that light is worked out with, and of a cosine with it."""

MORE_NORMAL, MORE_BENT, MOST_LIGHT, RANGE_SLOPE, OTHER_SLOPE, CONE_SHARE = range(3, 9)
LIMITS = 12
"""Elements of limits, and how many there are with those of ``steep``: see
``survey.precision.limits_of``."""

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
def lamp_on_face(lamp, first, facing, away, way, limits):
    """
    Return the light of a lamp on a face at most, and roundings of a code that it moves.

    Parameters
    ----------
    lamp : (7,) float32
    first, facing : tuple of 3 float32
        The first vertex, relative to the eye, and the unit normal.
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
    is_in_range = near * near * lamp[ENDING] < ABOVE
    return light if is_in_range else zero, moved if is_in_range else zero


@helper
def is_lit_surely(light, moved, limits):
    """Return whether a face takes float32: given its light of lamps, and roundings of a code."""
    return (light <= limits[MOST_LIGHT]) & (moved <= MOST)


@disjoint_helper
def start_lamps(light, moved):
    """Write that no lamp shines."""
    for n in range(light.shape[0]):
        light[n], moved[n] = np.float32(0.0), np.float32(0.0)
