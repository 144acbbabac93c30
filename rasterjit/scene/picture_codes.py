"""
Take the codes of a picture's file from Pillow: 8 or 16 bits, with the holes of a colour key [1]_.

References
----------
.. [1] Portable Network Graphics (PNG) Specification (Third Edition), W3C, section 11.3.1: ``tRNS``.
"""

from __future__ import annotations

import io
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from PIL import Image

_AS_THEY_ARE = ("L", "LA", "RGB", "RGBA", "F")
"""Pillow's kinds of picture that lie in memory as `Texture` takes them; others become RGBA."""

_GREY_16 = ("I", "I;16", "I;16B", "I;16L", "I;16N")
"""Those of 16-bit grey; the first in integers of 32 bits."""

_COLOR_16 = ("RGB;16", "RGBA;16", "RGBX;16")
"""
Ways in which files hold colours of 16 bits; behind each, B, L or N says which byte comes first.

Pillow keeps the upper byte of each. Told that the other one comes first, it keeps the lower.
"""

_OTHER = {"B": "L", "L": "B", "N": "B" if sys.byteorder == "little" else "L"}

_GREY_ALPHA_16 = "LA;16B"
"""The way in which PNG files hold grey and alpha of 16 bits: four bytes, as RGBA of 8 bits has."""

_FEWER_BITS = {"L;2": 85, "L;4": 17}
"""Greys of fewer bits than 8, and by what Pillow multiplies them, but not the key."""


def picture_codes(image: Image.Image, is_turned: bool = False) -> NDArray[Any]:
    """
    Return the codes of a picture that Pillow has opened.

    Parameters
    ----------
    image : PIL.Image.Image
        Colours of 16 bits keep them if it has not been decoded yet.
    is_turned : bool
        Whether it is turned upright, as EXIF data say.

    Returns
    -------
    (H, W) or (H, W, 2..4) uint8 or uint16; (H, W) float32 of TIFF files of floats
    """
    raw = _raw_mode(image)
    key, mode = image.info.get("transparency"), image.mode
    if raw == _GREY_ALPHA_16:
        _decode_as(image, "RGBA")
        codes = np.ascontiguousarray(_pixels(image, is_turned)).view(">u2").astype(np.uint16)
    elif raw[:-1] in _COLOR_16:
        lower = _again(image)
        _decode_as(lower, raw[:-1] + _OTHER[raw[-1]])
        upper = _pixels(image, is_turned).astype(np.uint16)
        codes = upper << 8 | _pixels(lower, is_turned)
    elif mode in _GREY_16:
        codes = np.clip(_pixels(image, is_turned), 0, 65535).astype(np.uint16)
    elif mode == "1" and key is not None:
        codes, key = _pixels(image, is_turned).astype(np.uint8) * np.uint8(255), 255 if key else 0
    elif mode in _AS_THEY_ARE:
        codes = _pixels(image, is_turned)
    else:
        return _pixels(image, is_turned, "RGBA")
    if key is None or isinstance(key, bytes) or codes.ndim != (2 if np.ndim(key) == 0 else 3):
        return codes
    return _with_holes(codes, np.multiply(key, _FEWER_BITS.get(raw, 1)))


def _with_holes(codes: NDArray[Any], key: NDArray[Any]) -> NDArray[Any]:
    """Return a picture, grey or RGB, with an alpha of 0 where it has the codes of a key."""
    layers = codes.reshape(*codes.shape[:2], -1)
    alpha = np.where((layers == key).all(axis=2), 0, np.iinfo(codes.dtype).max)
    return np.dstack([layers, alpha.astype(codes.dtype)])


def _pixels(image: Image.Image, is_turned: bool, mode: str | None = None) -> NDArray[Any]:
    """Return a picture as an array, upright, in another mode."""
    if is_turned:
        from PIL import ImageOps

        ImageOps.exif_transpose(image, in_place=True)
    return np.asarray(image if mode is None else image.convert(mode))


def _raw_mode(image: Image.Image) -> str:
    """Return how the file of a picture holds its codes; nothing of one that is decoded."""
    tiles = getattr(image, "tile", None)
    if not tiles:
        return ""
    said = tiles[0][3]
    name = said[0] if isinstance(said, tuple) and said else said
    return name if isinstance(name, str) else ""


def _decode_as(image: Any, raw: str) -> None:
    """Let a picture be decoded as if its file held the codes in another way."""
    kind = type(image.tile[0])
    tiles = [(*rest, (raw, *said[1:]) if isinstance(said, tuple) else raw)
             for *rest, said in image.tile]  # fmt: skip
    # Newer versions of Pillow have names for the parts.
    image.tile = tiles if kind is tuple else [kind(*one) for one in tiles]


def _again(image: Any) -> Image.Image:
    """Open the file of a picture once more."""
    from PIL import Image

    at = image.fp.tell()
    image.fp.seek(0)
    content = image.fp.read()
    image.fp.seek(at)
    return Image.open(io.BytesIO(content), formats=[image.format])
