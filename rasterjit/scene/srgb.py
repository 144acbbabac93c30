"""
The sRGB curve in whole-number arithmetic: the same bits on every machine.

A math library's ``pow`` differs between versions and CPUs in the last bit. But 2.4 is 12/5, so both
directions of the curve are roots of rationals: they are taken as whole-number roots and rounded
once.

References
----------
.. [1] IEC 61966-2-1:1999, "Colour measurement and management: sRGB".
"""

from __future__ import annotations

import functools
import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

ROOT_BITS = 96
"""Fractional bits of a root: 43 more than a float64 keeps."""

LINEAR_CODE = Fraction(4045, 100000)
"""Encoded value up to which the curve is the straight line ``encoded / 12.92``."""

LINEAR_LIGHT = Fraction(31308, 10000000)
"""Linear value up to which the curve is the straight line ``12.92 linear``."""

SLOPE = Fraction(1292, 100)


def whole_root(value: int, degree: int) -> int:
    """Return the largest whole number whose power of this degree is at most ``value`` >= 0."""
    if value == 0:
        return 0
    # Newton's steps fall from above to the root, and stop falling there.
    root = 1 << -(-value.bit_length() // degree)
    while True:
        lower = ((degree - 1) * root + value // root ** (degree - 1)) // degree
        if lower >= root:
            return root
        root = lower


def decode(encoded: Fraction) -> Fraction:
    """Return the linear value of an encoded one >= 0, to 2**-96 below the exact one."""
    if encoded <= LINEAR_CODE:
        return encoded / SLOPE
    power = _shifted(encoded) ** 12
    scaled = (power.numerator << 5 * ROOT_BITS) // power.denominator
    return Fraction(whole_root(scaled, 5), 1 << ROOT_BITS)


def encode(linear: Fraction) -> Fraction:
    """Return the encoded value of a linear one >= 0, to 2**-95 below the exact one."""
    if linear <= LINEAR_LIGHT:
        return SLOPE * linear
    power = linear**5
    scaled = (power.numerator << 12 * ROOT_BITS) // power.denominator
    # The twelfth root is the cube root of a square root of a square root.
    root = whole_root(math.isqrt(math.isqrt(scaled)), 3)
    return Fraction(211 * root, 200 << ROOT_BITS) - Fraction(11, 200)


def _shifted(encoded: Fraction) -> Fraction:
    """Return the base of the curve's power: (encoded + 0.055) / 1.055."""
    return (200 * encoded + 11) / 211


@functools.cache
def decoding_table() -> NDArray[np.float32]:
    """Return the linear value of each of the 256 codes, (256,) float32, read-only."""
    table = np.array([float(decode(Fraction(code, 255))) for code in range(256)], np.float32)
    table.flags.writeable = False
    return table
