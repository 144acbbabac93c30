"""
Convert colours to linear RGBA, and evaluate the sRGB curve with the same bits on every machine.

Colours are given as names, hex strings, sRGB bytes or linear floats.

The sRGB curve [1]_ is evaluated in whole-number arithmetic, for a math library's ``pow`` differs
between versions and CPUs in the last bit. Its exponent 2.4 is 12/5, so both directions of the curve
are roots of rationals: they are taken as whole-number roots and rounded once.

References
----------
.. [1] IEC 61966-2-1:1999, "Colour measurement and management: sRGB".
.. [2] CSS Color Module Level 4, W3C, section 6.1, "Named Colors".
"""

from __future__ import annotations

import functools
import math
import string
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene.validation import ROWS_WORDING, unmasked_array

ColorLike: TypeAlias = str | ArrayLike
"""A name, ``'#rgb'``, ``'#rrggbb'``, ``'#rrggbbaa'``, linear floats or an sRGB ``uint8`` array."""

RGB: TypeAlias = tuple[float, float, float]
"""Linear red, green and blue."""

RGBA: TypeAlias = tuple[float, float, float, float]
"""Linear red, green, blue and alpha."""

# Pillow has the same names, but its import takes longer than most of this package's.
_NAMES = Path(__file__).with_name("css_colors.txt").read_text(encoding="utf-8")
NAMED_COLORS = {**dict(line.split() for line in _NAMES.splitlines()), "transparent": "#00000000"}
"""The sRGB colours known by name: the 148 of CSS [2]_, whatever the case."""

_ADVICE = (
    "floats are linear light in 0..1; for 8-bit sRGB use a string such as '#rrggbb' "
    "or a NumPy uint8 array"
)

ROOT_BITS = 96
"""Fractional bits of a root: 43 more than a float64 keeps."""

ENCODED_THRESHOLD = Fraction(4045, 100000)
"""Encoded value up to which the curve is the straight line ``encoded / 12.92``."""

LINEAR_THRESHOLD = Fraction(31308, 10000000)
"""Linear value up to which the curve is the straight line ``12.92 linear``."""

LINEAR_SLOPE = Fraction(1292, 100)


def srgb_to_linear(codes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """
    Decode 8-bit sRGB codes to linear light through a table.

    Parameters
    ----------
    codes : (...) uint8
        sRGB codes; 0 and 255 give exactly 0 and 1.

    Returns
    -------
    (...) float32
        Linear light in 0..1.

    References
    ----------
    IEC 61966-2-1:1999, sRGB.
    """
    return decoding_table()[codes]


def linear_to_srgb(linear: ArrayLike) -> NDArray[np.float64]:
    """
    Encode linear light as sRGB, correctly rounded: the reference for faster encoders.

    It takes some 10 microseconds a value; pictures are encoded by ``pipeline.srgb_encoding``.

    Parameters
    ----------
    linear : (...) float
        Linear light; clipped to 0..1 first, NaN becomes 0.

    Returns
    -------
    (...) float64
        Encoded value in 0..1; times 255 and rounded half up it is the 8-bit code.

    References
    ----------
    IEC 61966-2-1:1999, sRGB.
    """
    value = np.clip(np.nan_to_num(np.asarray(linear, dtype=np.float64), nan=0.0), 0.0, 1.0)
    encoded = [float(encode(Fraction(linear))) for linear in value.ravel().tolist()]
    return np.array(encoded, np.float64).reshape(value.shape)


def opaque_codes(color: ArrayLike) -> NDArray[np.uint8]:
    """Encode a linear colour as opaque sRGB codes, (4,) RGBA; its alpha is ignored."""
    encoded = linear_to_srgb(np.array(color)[:3])
    return np.append(np.floor(255.0 * encoded + 0.5), 255.0).astype(np.uint8)


def linear_color(name: str, value: ColorLike) -> NDArray[np.float32]:
    """
    Convert a colour in any notation to linear RGBA.

    Parameters
    ----------
    name : str
        What the message calls the argument.
    value : str or array_like
        A name of `NAMED_COLORS`; ``'#rgb'``, ``'#rrggbb'`` or ``'#rrggbbaa'`` (sRGB); three or
        four floats in 0..1 (linear light); or a ``uint8`` array of three or four (sRGB). Alpha is
        linear in every form, and 1 where it is not given.

    Returns
    -------
    (4,) float32
        Linear RGBA in 0..1.

    Raises
    ------
    ValueError
        If the value is none of these.
    """
    if isinstance(value, str):
        return _parse_color(name, value).copy()
    array = _color_array(name, value)
    if array.shape not in ((3,), (4,)):
        raise ValueError(
            f"{name} must be three or four numbers or a colour string, got shape {array.shape}"
        )
    return linear_rows(name, array[np.newaxis])[0]


def rgba(name: str, value: ColorLike) -> RGBA:
    """Return a colour as four numbers, linear, or raise as `linear_color` does."""
    red, green, blue, alpha = linear_color(name, value).tolist()
    return red, green, blue, alpha


def rgb(name: str, value: ColorLike) -> RGB:
    """Return a colour as three numbers, linear, or raise as `linear_color` does."""
    return rgba(name, value)[:3]


@functools.lru_cache(maxsize=256)
def _parse_color(name: str, text: str) -> NDArray[np.float32]:
    """Return the linear colour that a string names, cached: programs use few."""
    return linear_rows(name, _parse_hex(name, text)[np.newaxis])[0]


def linear_rows(name: str, value: ArrayLike) -> NDArray[np.float32]:
    """
    Return rows of colours as linear RGBA: ``uint8`` is sRGB, everything else is linear.

    Parameters
    ----------
    name : str
        What the message calls the argument.
    value : (n, 3) or (n, 4) array_like
        ``uint8`` sRGB codes, or numbers in 0..1 of linear light.

    Returns
    -------
    (n, 4) float32
        Linear RGBA in 0..1; alpha is 1 where it is not given.

    Raises
    ------
    ValueError
        If the shape is another, or a number lies outside 0..1 or is not finite.
    """
    array = _color_array(name, value)
    if array.ndim != 2 or array.shape[1] not in (3, 4):
        raise ValueError(f"{name} must have shape (n, 3) or (n, 4), got {array.shape}")
    rgba = np.ones((len(array), 4), dtype=np.float32)
    if array.dtype == np.uint8:
        rgba[:, :3] = srgb_to_linear(array[:, :3])
        if array.shape[1] == 4:
            np.divide(array[:, 3], np.float32(255.0), out=rgba[:, 3])
        return rgba
    # NaN fails both comparisons, so it is caught here too.
    if array.size and not (array.min() >= 0.0 and array.max() <= 1.0):
        with np.errstate(invalid="ignore"):
            is_outside = ~((array >= 0.0) & (array <= 1.0))
        example = array[is_outside][0].item()
        raise ValueError(
            f"{name} must lie in 0..1, got {example!r} "
            f"({int(is_outside.sum())} of {array.size} values outside): {_ADVICE}"
        )
    rgba[:, : array.shape[1]] = array
    return rgba


def _color_array(name: str, value: Any) -> NDArray[Any]:
    """Return ``value`` as a ``uint8`` or real numeric array, or raise ``ValueError``."""
    array = unmasked_array(name, value, *ROWS_WORDING)
    if array.dtype.kind not in "uif":
        raise ValueError(f"{name} must hold numbers, got {value!r}: {_ADVICE}")
    return array


def _parse_hex(name: str, text: str) -> NDArray[np.uint8]:
    """Return the three or four sRGB bytes of a colour string."""
    code = NAMED_COLORS.get(text.strip().lower(), text.strip())
    digits = code[1:]
    if not code.startswith("#") or not set(digits) <= set(string.hexdigits):
        digits = ""
    if len(digits) == 3:
        digits = "".join(digit * 2 for digit in digits)
    if len(digits) not in (6, 8):
        raise ValueError(
            f"{name} must be '#rgb', '#rrggbb', '#rrggbbaa', 'transparent' or a colour name of "
            f"CSS, such as 'steelblue'; got {text!r}{_similar_names(text)}"
        )
    return np.frombuffer(bytes.fromhex(digits), dtype=np.uint8)


def _similar_names(text: str) -> str:
    """Return "; did you mean 'x'?" with similar colour names, or an empty string."""
    import difflib

    word = text.strip().lower().replace(" ", "").replace("-", "").replace("_", "")
    names = difflib.get_close_matches(word, NAMED_COLORS, n=3)
    return f": did you mean {' or '.join(map(repr, names))}?" if names else ""


def integer_root(value: int, degree: int) -> int:
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
    """Decode an sRGB value >= 0 to linear light, at most 2**-96 below the exact value."""
    if encoded <= ENCODED_THRESHOLD:
        return encoded / LINEAR_SLOPE
    power = _power_base(encoded) ** 12
    scaled = (power.numerator << 5 * ROOT_BITS) // power.denominator
    return Fraction(integer_root(scaled, 5), 1 << ROOT_BITS)


def encode(linear: Fraction) -> Fraction:
    """Encode linear light >= 0 as sRGB, at most 2**-95 below the exact value."""
    if linear <= LINEAR_THRESHOLD:
        return LINEAR_SLOPE * linear
    power = linear**5
    scaled = (power.numerator << 12 * ROOT_BITS) // power.denominator
    # The twelfth root is the cube root of a square root of a square root.
    root = integer_root(math.isqrt(math.isqrt(scaled)), 3)
    return Fraction(211 * root, 200 << ROOT_BITS) - Fraction(11, 200)


def _power_base(encoded: Fraction) -> Fraction:
    """Return the base of the curve's power: (encoded + 0.055) / 1.055."""
    return (200 * encoded + 11) / 211


@functools.cache
def decoding_table() -> NDArray[np.float32]:
    """Return the linear value of each of the 256 codes, (256,) float32, read-only."""
    table = np.array([float(decode(Fraction(code, 255))) for code in range(256)], np.float32)
    table.flags.writeable = False
    return table
