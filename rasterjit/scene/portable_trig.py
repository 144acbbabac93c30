"""
Sines and arc tangents of arrays, with the same bits on every CPU.

They are built from IEEE operations alone, each of its own: a math library rounds as it likes.
`transforms` has those of one angle in degrees, correctly rounded.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rasterjit.scene.arrays import Float64

HALF_PI_HIGH, HALF_PI_LOW = 1.5707963267341256, 6.077100506506192e-11
"""Half pi in two parts: its first 33 bits, whose small multiples are exact, and the rest."""

RADIANS_PER_DEGREE = 0.017453292519943295

SINE_TERMS = tuple((1 - n % 2 * 2) / math.factorial(2 * n + 1) for n in range(9))
COSINE_TERMS = tuple((1 - n % 2 * 2) / math.factorial(2 * n) for n in range(10))
"""Coefficients of the Taylor series: up to 45 degrees the next term is below 1e-18."""

ARC_STEPS = 8
"""Steps of the table of arc tangents: 0, 1/8 ... 1, each ratio at most 1/16 from one."""

ARCS = (
    0.0, 0.12435499454676144, 0.24497866312686414, 0.35877067027057225, 0.4636476090008061,
    0.5585993153435624, 0.6435011087932844, 0.7188299996216245, 0.7853981633974483,
)  # fmt: skip

ARC_TERMS = tuple((1 - n % 2 * 2) / (2 * n + 1) for n in range(8))
"""Coefficients of the Taylor series: up to 1/16 the next term is below 1e-20."""


def polynomial(coefficients: tuple[float, ...], x: Any) -> Any:
    """Evaluate a polynomial at x, its coefficients from the constant one on."""
    total = x * 0.0 + coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        total = total * x + coefficient
    return total


def sin_cos(radians: Any) -> tuple[Float64, Float64]:
    """Return the sines and cosines of angles in -1e5..1e5 radians, to 3e-16."""
    angle = np.asarray(radians, dtype=np.float64)
    quarter = np.floor(angle / (HALF_PI_HIGH + HALF_PI_LOW) + 0.5)
    return _in_quadrant(quarter, (angle - quarter * HALF_PI_HIGH) - quarter * HALF_PI_LOW)


def sin_cos_degrees(degrees: Any) -> tuple[Float64, Float64]:
    """Return the sines and cosines of angles in degrees, to 3e-16; exact at quarter turns."""
    angle = np.asarray(degrees, dtype=np.float64)
    quarter = np.floor(angle / 90.0 + 0.5)
    return _in_quadrant(quarter, (angle - quarter * 90.0) * RADIANS_PER_DEGREE)


def _in_quadrant(quarter: Float64, remainder: Float64) -> tuple[Float64, Float64]:
    """Return sines and cosines of quarter turns and what remains, -45 to 45 degrees in radians."""
    square = remainder * remainder
    sine, cosine = remainder * polynomial(SINE_TERMS, square), polynomial(COSINE_TERMS, square)
    quadrant = quarter - 4.0 * np.floor(quarter * 0.25)
    is_odd = (quadrant == 1.0) | (quadrant == 3.0)
    sines, cosines = np.where(is_odd, cosine, sine), np.where(is_odd, sine, cosine)
    return (
        np.where(quadrant >= 2.0, -sines, sines),
        np.where((quadrant == 1.0) | (quadrant == 2.0), -cosines, cosines),
    )


def polar_angle(y: Any, x: Any) -> Float64:
    """Return the angles of (x, y) from the x axis, radians in -pi..pi, to 5e-16; 0 if both are."""
    rise, run = np.abs(y, dtype=np.float64), np.abs(x, dtype=np.float64)
    low, high = np.minimum(rise, run), np.maximum(rise, run)
    ratio = low / np.where(high > 0.0, high, 1.0)
    step = np.floor(ratio * ARC_STEPS + 0.5)
    nearest = step / ARC_STEPS
    remainder = (ratio - nearest) / (1.0 + ratio * nearest)
    table_angle = np.array(ARCS)[np.where(step == step, step, 0.0).astype(np.int64)]
    angle = table_angle + remainder * polynomial(ARC_TERMS, remainder * remainder)
    half_pi = HALF_PI_HIGH + HALF_PI_LOW
    angle = np.where(rise > run, half_pi - angle, angle)
    angle = np.where(np.asarray(x) < 0.0, 2.0 * half_pi - angle, angle)
    return np.where(np.asarray(y) < 0.0, -angle, angle)
