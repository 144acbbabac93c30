"""
Take the sample values of a picture's file from Pillow: 8 or 16 bits, with its colour key [1]_.

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

_DIRECT_MODES = ("L", "LA", "RGB", "RGBA", "F")
"""Pillow's modes whose arrays `Texture` takes unchanged; others become RGBA."""

_GREY_16 = ("I", "I;16", "I;16B", "I;16L", "I;16N")
"""Pillow's modes of 16-bit grey; ``I`` is int32."""

_COLOR_16 = ("RGB;16", "RGBA;16", "RGBX;16")
"""
Raw modes of 16-bit colours; a letter B, L or N is appended for the byte order.

Pillow keeps the upper byte of each sample; decoded with the byte order swapped, the lower one.
"""

_SWAPPED_ORDER = {"B": "L", "L": "B", "N": "B" if sys.byteorder == "little" else "L"}

_GREY_ALPHA_16 = "LA;16B"
"""Raw mode of grey and alpha of 16 bits in PNG files: four bytes, as 8-bit RGBA."""

_KEY_SCALE = {"L;2": 85, "L;4": 17}
"""Factors by which Pillow scales greys of 2 and 4 bits to 8, but not their colour key."""


def read_codes(image: Image.Image, apply_exif: bool = False) -> NDArray[Any]:
    """
    Return the sample values of a picture that Pillow has opened.

    Parameters
    ----------
    image : PIL.Image.Image
        Not decoded yet: once decoded, colours of 16 bits have only 8.
    apply_exif : bool
        Whether to turn it upright by its EXIF orientation.

    Returns
    -------
    (H, W) or (H, W, 2..4) uint8 or uint16; (H, W) float32 of TIFF files of floats
    """
    raw = _find_raw_mode(image)
    key, mode = image.info.get("transparency"), image.mode
    if raw == _GREY_ALPHA_16:
        _decode_as(image, "RGBA")
        codes = (
            np.ascontiguousarray(_decode_pixels(image, apply_exif)).view(">u2").astype(np.uint16)
        )
    elif raw[:-1] in _COLOR_16:
        lower = _reopen(image)
        _decode_as(lower, raw[:-1] + _SWAPPED_ORDER[raw[-1]])
        upper = _decode_pixels(image, apply_exif).astype(np.uint16)
        codes = upper << 8 | _decode_pixels(lower, apply_exif)
    elif mode in _GREY_16:
        codes = np.clip(_decode_pixels(image, apply_exif), 0, 65535).astype(np.uint16)
    elif mode == "1":
        codes = _decode_pixels(image, apply_exif).astype(np.uint8) * np.uint8(255)
        key = key and 255
    elif mode in _DIRECT_MODES:
        codes = _decode_pixels(image, apply_exif)
    else:
        return _decode_pixels(image, apply_exif, "RGBA")
    if key is None or isinstance(key, bytes) or codes.ndim != (2 if np.ndim(key) == 0 else 3):
        return codes
    return _with_color_key(codes, np.multiply(key, _KEY_SCALE.get(raw, 1)))


def _with_color_key(codes: NDArray[Any], key: NDArray[Any]) -> NDArray[Any]:
    """Return a grey or RGB picture with alpha, 0 where it has the colour key."""
    layers = codes.reshape(*codes.shape[:2], -1)
    alpha = np.where((layers == key).all(axis=2), 0, np.iinfo(codes.dtype).max)
    return np.dstack([layers, alpha.astype(codes.dtype)])


def _decode_pixels(image: Image.Image, apply_exif: bool, mode: str | None = None) -> NDArray[Any]:
    """Convert a picture to an array, turned upright by EXIF if asked for, in a mode."""
    if apply_exif:
        from PIL import ImageOps

        ImageOps.exif_transpose(image, in_place=True)
    return np.asarray(image if mode is None else image.convert(mode))


def _find_raw_mode(image: Image.Image) -> str:
    """Return the raw mode of a picture's file; "" once it is decoded."""
    tiles = getattr(image, "tile", None)
    if not tiles:
        return ""
    decoder_args = tiles[0][3]
    name = decoder_args[0] if isinstance(decoder_args, tuple) and decoder_args else decoder_args
    return name if isinstance(name, str) else ""


def _decode_as(image: Any, raw: str) -> None:
    """Set another raw mode for decoding a picture than its file names."""
    kind = type(image.tile[0])
    tiles = [(*rest, (raw, *decoder_args[1:]) if isinstance(decoder_args, tuple) else raw)
             for *rest, decoder_args in image.tile]  # fmt: skip
    # Newer versions of Pillow have names for the parts.
    image.tile = tiles if kind is tuple else [kind(*one) for one in tiles]


def _reopen(image: Any) -> Image.Image:
    """Open the file of a picture again."""
    from PIL import Image

    position = image.fp.tell()
    image.fp.seek(0)
    content = image.fp.read()
    image.fp.seek(position)
    return Image.open(io.BytesIO(content), formats=[image.format])
