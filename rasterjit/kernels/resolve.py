"""
Turn linear light into sRGB ``uint8``.

Exact: code c stands for the values at or above ``decode((c - 1/2) / 255)``, which is rounding half
up. A table over equal steps of linear light gives a code that is never too high; from there the
thresholds are climbed, at most a few. Below zero and NaN give 0, above one gives 255.

References
----------
.. [1] IEC 61966-2-1, "Colour measurement and management: sRGB".
"""

from __future__ import annotations

import bisect
import functools

import numpy as np

from rasterjit.kernels.jit import kernel, stage

TABLE_STEPS = 4096
"""Steps of the first table: at most one threshold in most of them."""


def reaches_code(bits: int, code: int) -> bool:
    """
    Tell exactly whether the float32 with these bits, in 0..1, encodes to a code or a higher one.

    A code c begins at the encoded value e = (2 c - 1) / 510, which decodes to e / 12.92 up to
    0.04045, and above to ((e + 0.055) / 1.055)**(12/5): powers of whole numbers decide.
    """
    numerator, denominator = float(np.uint32(bits).view(np.float32)).as_integer_ratio()
    e = 2 * code - 1
    if 100000 * e <= 4045 * 510:
        return 1292 * 510 * numerator >= 100 * e * denominator
    return (211 * 510) ** 12 * numerator**5 >= (200 * e + 11 * 510) ** 12 * denominator**5


@functools.cache
def encoding_tables() -> tuple[np.ndarray, np.ndarray]:
    """Return (thresholds (257,) float32, first code of each step (TABLE_STEPS + 1,) uint8)."""
    # Positive floats are in the order of their bits.
    bits, one = [0], int(np.float32(1.0).view(np.uint32))
    for code in range(1, 256):
        reaches = functools.partial(reaches_code, code=code)
        bits.append(bits[-1] + bisect.bisect_left(range(bits[-1], one), True, key=reaches))
    thresholds = np.array([*bits, 0], np.uint32).view(np.float32)
    thresholds[0], thresholds[256] = -np.inf, np.inf
    steps = (np.arange(TABLE_STEPS + 1) / TABLE_STEPS).astype(np.float32)
    codes = np.searchsorted(thresholds, steps, side="right") - 1
    return thresholds, codes.astype(np.uint8)


@stage
def unit_range(value):
    """Return a value held in 0..1; NaN gives 0."""
    value = value if value > np.float32(0.0) else np.float32(0.0)
    return value if value < np.float32(1.0) else np.float32(1.0)


@stage
def encode(value, thresholds, codes):
    """Return the sRGB code of a linear value, rounded half up."""
    value = unit_range(value)
    code = np.int32(codes[np.int32(value * np.float32(TABLE_STEPS))])
    while value >= thresholds[code + 1]:
        code = np.int32(code + 1)
    return np.uint32(code)


@stage
def encode_alpha(value):
    """Return alpha, which is linear, as a code, rounded half up."""
    return np.uint32(np.int32(np.float64(unit_range(value)) * 255.0 + 0.5))


@kernel
def encode_rows(linear, tables, color):
    """
    Encode rows of linear colour.

    Parameters
    ----------
    linear : (R, W, 4) float32
    tables : (thresholds (257,) float32, codes (TABLE_STEPS + 1,) uint8)
    color : (R, W) uint32
        Writes red, green, blue, alpha from the lowest byte up: RGBA bytes on a little-endian CPU.
    """
    thresholds, codes = tables
    for row in range(linear.shape[0]):
        for column in range(linear.shape[1]):
            color[row, column] = (
                encode(linear[row, column, 0], thresholds, codes)
                | encode(linear[row, column, 1], thresholds, codes) << np.uint32(8)
                | encode(linear[row, column, 2], thresholds, codes) << np.uint32(16)
                | encode_alpha(linear[row, column, 3]) << np.uint32(24)
            )
