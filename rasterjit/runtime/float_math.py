"""
Powers, logarithms and bounds with the same bits on every CPU.

They are built from IEEE operations alone; a math library rounds as it likes, and the last bit may
differ from one machine to the next.
"""

from __future__ import annotations

import numpy as np

from rasterjit.runtime.jit import helper

MANTISSA_BITS = np.int32(0x7FFFFF)
SQRT_HALF_BITS = np.int32(0x3F3504F3)
MIN_NORMAL = np.float32(1.1754944e-38)


@helper
def clamped(value, least, most):
    """Return a value held in least..most; NaN gives the least."""
    value = value if value > least else least
    return value if value < most else most


@helper
def log2(x):
    """
    Return log2 of a float32, x >= 2**-126, to 1.2e-7 of 1 + |log2 x|.

    Splits x = m 2**e with m in [sqrt(1/2), sqrt(2)); then with t = (m - 1) / (m + 1),
    log2 m = (2 / ln 2) (t + t**3/3 + t**5/5 + ...), where |t| < 0.172.
    """
    offset = np.int32(np.float32(x).view(np.int32) - SQRT_HALF_BITS)
    exponent = np.int32(offset >> np.int32(23))
    m = np.int32((offset & MANTISSA_BITS) + SQRT_HALF_BITS).view(np.float32)
    t = (m - np.float32(1.0)) / (m + np.float32(1.0))
    u = t * t
    series = np.float32(0.32059890) * u + np.float32(0.41219858)
    series = series * u + np.float32(0.57707802)
    series = series * u + np.float32(0.96179669)
    series = series * u + np.float32(2.8853901)
    return np.float32(exponent) + t * series


@helper
def exp2(x):
    """
    Return 2**x of a float32 in [-126, 126], to 2e-7 relative; below, and for NaN, 2**-126.

    Splits x = n + f with n whole and |f| <= 1/2; 2**f by its Taylor series.
    """
    held = clamped(np.float32(x), np.float32(-126.0), np.float32(126.0))
    whole = np.floor(held + np.float32(0.5))
    y = (held - whole) * np.float32(0.69314718)
    series = np.float32(1.0 / 5040.0) * y + np.float32(1.0 / 720.0)
    series = series * y + np.float32(1.0 / 120.0)
    series = series * y + np.float32(1.0 / 24.0)
    series = series * y + np.float32(1.0 / 6.0)
    series = series * y + np.float32(0.5)
    series = series * y + np.float32(1.0)
    series = series * y + np.float32(1.0)
    scale = np.int32((np.int32(whole) + np.int32(127)) << np.int32(23)).view(np.float32)
    return series * scale


@helper
def power(x, exponent):
    """Return x**exponent for x in [0, 1] and exponent > 0, float32; 0 and NaN give (nearly) 0."""
    return exp2(exponent * log2(max(MIN_NORMAL, x)))
