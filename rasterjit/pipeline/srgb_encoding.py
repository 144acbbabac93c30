"""
Encode linear light as sRGB ``uint8``, or by another transfer function.

Exact: code c stands for the values at or above ``decode((c - 1/2) / 255)``, which is rounding half
up. Positive floats sort like their bits: the high half of the bits is the index of a bucket, which
holds at most one threshold; the low half decides on which side of it a value lies. So encoding is
one table lookup and one addition, without branch or clamping, as every float32 has a bucket. Values
from code 1 up to 1.0 use 6.5 KiB of the table; others are rare. Negative values and NaN give 0,
above one gives 255.

References
----------
.. [1] IEC 61966-2-1, "Colour measurement and management: sRGB".
"""

from __future__ import annotations

import bisect
import functools
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.intrinsics import LANES, encode_lanes, flat
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float32, int32, uint32

BUCKET_BITS = 16
"""Low bits of a float32 that share a bucket: 128 buckets between powers of two."""

BUCKET_COUNT = 1 << (32 - BUCKET_BITS)
"""Number of buckets of all float32, ordered by bits: negative values and NaN last."""

INFINITY_BITS = 0x7F800000

Encoding: TypeAlias = Literal["srgb", "gamma 2.2", "as is"]
"""Transfer functions: sRGB's, the power 1 / 2.2, or none."""


def reaches_code(bits: int, code: int, encoding: Encoding = "srgb") -> bool:
    """
    Tell exactly whether the float32 with these bits, in 0..1, encodes to a code or a higher one.

    A code c begins at the encoded value e = (2 c - 1) / 510. sRGB decodes it to e / 12.92 up to
    0.04045, above to ((e + 0.055) / 1.055)**(12/5); gamma 2.2 to e**(11/5). Powers of whole numbers
    are compared.
    """
    numerator, denominator = float(np.uint32(bits).view(np.float32)).as_integer_ratio()
    e = 2 * code - 1
    if encoding == "as is":
        return 510 * numerator >= e * denominator
    if encoding == "gamma 2.2":
        return 510**11 * numerator**5 >= e**11 * denominator**5
    if 100000 * e <= 4045 * 510:
        return 1292 * 510 * numerator >= 100 * e * denominator
    return (211 * 510) ** 12 * numerator**5 >= (200 * e + 11 * 510) ** 12 * denominator**5


@functools.cache
def find_code_thresholds(encoding: Encoding = "srgb") -> np.ndarray:
    """Find the least float32 of each code from 1 to 255, (255,) float32, ascending."""
    bits, one = [0], int(np.float32(1.0).view(np.uint32))
    for code in range(1, 256):
        reaches = functools.partial(reaches_code, code=code, encoding=encoding)
        bits.append(bits[-1] + bisect.bisect_left(range(bits[-1], one), True, key=reaches))
    return np.array(bits[1:], np.uint32).view(np.float32)


@functools.cache
def make_encoding_table(encoding: Encoding = "srgb") -> np.ndarray:
    """
    Make the table of addends to the low bits of values, by bucket, (65536,) int32.

    After the addition, bits ``BUCKET_BITS`` to ``BUCKET_BITS + 7`` are the code. An entry holds the
    code of the bucket's start there; below, the carry that low bits from a threshold on need, 0 if
    the bucket has one code.
    """
    # After infinity, the last value of code 255, codes are 0: NaN and negative values.
    thresholds = np.append(
        find_code_thresholds(encoding).view(np.int32), np.int32(INFINITY_BITS + 1)
    )
    first_buckets = -(-thresholds.astype(np.int64) >> BUCKET_BITS)
    buckets_of_codes = np.diff(first_buckets, prepend=0, append=BUCKET_COUNT)
    table = np.repeat(np.arange(len(buckets_of_codes)) << BUCKET_BITS, buckets_of_codes)
    buckets, low_bits = thresholds >> BUCKET_BITS, thresholds & ((1 << BUCKET_BITS) - 1)
    is_inside = low_bits != 0
    table[buckets[is_inside]] += (1 << BUCKET_BITS) - low_bits[is_inside]
    return table.astype(np.int32)


def encode_color(color: NDArray[np.float32], encoding: Encoding = "srgb") -> int:
    """Encode a linear RGBA colour, (4,), as a pixel, as `encode_rows` does."""
    *light, alpha = [value if value > 0.0 else 0.0 for value in color.tolist()]
    red, green, blue = [
        bisect.bisect_right(find_code_thresholds(encoding), value) for value in light
    ]
    return red | green << 8 | blue << 16 | int(min(alpha, 1.0) * 255.0 + 0.5) << 24


def encode_values(light: NDArray[np.float32], encoding: Encoding = "srgb") -> NDArray[np.uint32]:
    """Encode linear values of any shape as codes, uint32, as `encode` does."""
    return find_code_thresholds(encoding).searchsorted(light, side="right").astype(np.uint32)


@helper
def get_float_bits(value):
    """Return the bits of a float32, as an int32."""
    return np.float32(value).view(np.int32)


@helper
def encode(value, table):
    """Encode a linear value as an sRGB code, rounded half up."""
    # Casts to 32 bits halve the registers needed; an unsigned index is not tested for being
    # negative.
    bits = np.uint32(get_float_bits(value))
    entry = np.uint32(table[np.uintp(np.uint32(bits >> np.uint32(BUCKET_BITS)))])
    low = np.uint32(bits & np.uint32((1 << BUCKET_BITS) - 1))
    return np.uint32(np.uint32(np.uint32(entry + low) >> np.uint32(BUCKET_BITS)) & np.uint32(255))


@helper
def encode_alpha(value):
    """Encode alpha, which is linear, as a code, rounded half up."""
    opacity = clamped(value, np.float32(0.0), np.float32(1.0))
    return np.uint32(np.int32(np.float64(opacity) * 255.0 + 0.5))


@helper
def encode_light(red, green, blue, table, alpha, color):
    """Encode a span of pixels, given by channel, with a constant alpha code in the top byte."""
    size = color.shape[0]
    if size < LANES:
        for i in range(size):
            color[i] = (
                encode(red[i], table)
                | encode(green[i], table) << np.uint32(8)
                | encode(blue[i], table) << np.uint32(16)
                | alpha
            )
        return
    for i in range(0, size - LANES, LANES):
        encode_lanes(red, green, blue, table, i, alpha, color)
    # Overlap the last vector, instead of a scalar loop for the rest.
    encode_lanes(red, green, blue, table, size - LANES, alpha, color)


@helper
def encode_span(red, green, blue, table, color):
    """Encode a span of opaque pixels, given by channel."""
    encode_light(red, green, blue, table, np.uint32(0xFF000000), color)


@helper
def encode_pixel(linear, table):
    """Encode one linear RGBA colour as a pixel."""
    return (
        encode(linear[0], table)
        | encode(linear[1], table) << np.uint32(8)
        | encode(linear[2], table) << np.uint32(16)
        | encode_alpha(linear[3]) << np.uint32(24)
    )


@disjoint_helper
def add_alpha_codes(alpha, color):
    """Add the alpha of a span of pixels to their codes."""
    for i in range(color.shape[0]):
        opacity = clamped(alpha[i], np.float32(0.0), np.float32(1.0))
        color[i] |= np.uint32(np.int32(np.float64(opacity) * 255.0 + 0.5)) << np.uint32(24)


@helper
def encode_channels(red, green, blue, alpha, table, color):
    """Encode a span of pixels, given by channel."""
    encode_light(red, green, blue, table, np.uint32(0), color)
    add_alpha_codes(alpha, color)


@disjoint_helper
def encode_row(linear, table, color):
    """Encode a row of linear colour, four numbers each; without branches."""
    for i in range(color.shape[0]):
        at = np.uintp(4 * i)
        alpha = clamped(linear[at + np.uintp(3)], np.float32(0.0), np.float32(1.0))
        color[i] = (
            encode(linear[at], table)
            | encode(linear[at + np.uintp(1)], table) << np.uint32(8)
            | encode(linear[at + np.uintp(2)], table) << np.uint32(16)
            | np.uint32(np.int32(np.float64(alpha) * 255.0 + 0.5)) << np.uint32(24)
        )


@kernel
def encode_rows(linear: float32[:, :, ::1], table: int32[::1], color: uint32[:, :]):
    """
    Encode rows of linear colour.

    Parameters
    ----------
    linear : (R, W, 4) float32
    table : (65536,) int32
        From `make_encoding_table`.
    color : (R, W) uint32
        Writes red, green, blue, alpha from the lowest byte up: RGBA bytes on a little-endian CPU.
    """
    for row in range(linear.shape[0]):
        encode_row(flat(linear[row]), table, color[row])


@helper
def composite_over(alpha, front, behind):
    """Composite a straight-alpha colour over another one; return straight RGBA."""
    one, zero = np.float32(1.0), np.float32(0.0)
    if alpha >= one:
        return front[0], front[1], front[2], one
    if not alpha > zero:
        return behind
    through = (one - alpha) * behind[3]
    total = alpha + through
    return (
        (front[0] * alpha + behind[0] * through) / total,
        (front[1] * alpha + behind[1] * through) / total,
        (front[2] * alpha + behind[2] * through) / total,
        total,
    )
