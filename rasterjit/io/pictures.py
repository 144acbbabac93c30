"""Read the pictures inside mesh files with Pillow: as `Texture` takes them, or not at all."""

from __future__ import annotations

import io
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.color import decoding_table, srgb_to_linear
from rasterjit.scene.memory import TEXEL_BYTES, MemoryBudget
from rasterjit.scene.picture_codes import picture_codes
from rasterjit.scene.texture import opened_picture

if TYPE_CHECKING:
    from PIL import Image

_PACKED_TEXTS = (b"zTXt", b"iTXt", b"iCCP")
"""What a PNG file may hold packed beside its texels."""
TEXT_BYTES, MOST_TEXTS = 1 << 20, 64
"""How large each may be unpacked, and how many of that size there may be, before Pillow refuses."""

_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
TAG_BYTES = 16
"""How much memory a byte of a TIFF file takes as a Python number."""
_LONGEST_VALUE = 8
"""Bytes of a value of a tag, at most."""


def picture_pixels(
    content: bytes,
    what: str = "a picture",
    further: tuple[str, ...] = (),
    budget: MemoryBudget | None = None,
) -> NDArray[Any]:
    """
    Decode a picture's file.

    Parameters
    ----------
    content : bytes
    what : str
        What a message calls it.
    further : tuple of str
        Formats that it may have besides, by Pillow's names.
    budget : MemoryBudget, optional
        Counts what its texels take, by its header.

    Returns
    -------
    (H, W) or (H, W, 2..4) uint8 or uint16

    Raises
    ------
    ValueError
        If it is of no known format; `FileSizeError` for one larger than the budget;
        `PictureSizeError` for one with more texels than `Texture`
        takes.
    Exception
        Whatever Pillow raises about a picture that is damaged.
    """
    beside = _bytes_of_head(content)
    if budget is not None:
        budget.take(what, beside)
    with _opened(content, further) as image:
        if budget is not None:
            # What opening took is free again.
            width, height = image.size
            budget.take(what, max(width * height * TEXEL_BYTES - beside, 0))
        return image_pixels(image)


def _bytes_of_head(content: bytes) -> int:
    """Return how much memory opening a picture takes at most, by what its head says."""
    if content.startswith(b"\x89PNG"):
        packed = sum(map(content.count, _PACKED_TEXTS))
        return min(packed, MOST_TEXTS) * TEXT_BYTES
    if content[:4] in _TIFF:
        return TAG_BYTES * max(len(content), _bytes_of_tags(content))
    return 0


def _bytes_of_tags(content: bytes) -> int:
    """Return how long all tags of a TIFF file are together; several may be the same bytes."""
    order = "<" if content[:1] == b"I" else ">"
    # Large files have places of 8 bytes.
    is_large = content[2:4].strip(b"\0") == b"+"
    first, count, entry = ("8xQ", "Q", "2xHQ8x") if is_large else ("4xI", "H", "2xHI4x")
    try:
        (at,) = struct.unpack_from(order + first, content)
        (tags,) = struct.unpack_from(order + count, content, at)
        at += struct.calcsize(order + count)
        rows = content[at : at + tags * struct.calcsize(order + entry)]
        return sum(_LONGEST_VALUE * n for _, n in struct.iter_unpack(order + entry, rows))
    except struct.error:
        # Pillow says what is wrong with it.
        return 0


def take_texels(size: tuple[int, int], what: str, budget: MemoryBudget) -> None:
    """Count what the texels of a picture, (width, height), take."""
    budget.take(what, size[0] * size[1] * TEXEL_BYTES)


def check_picture(content: bytes) -> None:
    """Raise what `picture_pixels` does about the beginning of a picture's file."""
    with _opened(content):
        pass


@contextmanager
def _opened(content: bytes, further: tuple[str, ...] = ()) -> Iterator[Image.Image]:
    """Open a picture's file, warning of nothing."""
    from PIL import UnidentifiedImageError

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with opened_picture("it", io.BytesIO(content), further) as image:
                yield image
        except UnidentifiedImageError:
            # Pillow names the place in memory.
            raise ValueError("it is empty" if not content else "it is no known picture") from None


def image_pixels(image: Image.Image) -> NDArray[Any]:
    """Return the pixels of a Pillow image as `Texture` takes them."""
    return picture_codes(image.convert("RGBA") if image.mode == "F" else image)


def nearest_codes(linear: NDArray[np.float32], color_space: str) -> tuple[NDArray[np.uint8], bool]:
    """
    Return colours or texels as bytes.

    Parameters
    ----------
    linear : (..., 4) float32
        Linear RGBA; what lies outside 0..1 is clamped.
    color_space : {"srgb", "linear"}
        What bytes of red, green and blue are.

    Returns
    -------
    codes : (..., 4) uint8
    are_exact : bool
        Whether reading the codes gives the very same colours.
    """
    codes = np.floor(np.clip(linear, 0.0, 1.0) * np.float32(255.0) + np.float32(0.5))
    if color_space == "srgb":
        table = decoding_table().astype(np.float64)
        codes[..., :3] = np.searchsorted((table[1:] + table[:-1]) / 2.0, linear[..., :3])
    codes = codes.astype(np.uint8)
    read = codes / np.float32(255.0)
    if color_space == "srgb":
        read[..., :3] = srgb_to_linear(codes[..., :3])
    return codes, bool((read == linear).all())


def in_16_bits(codes: NDArray[Any]) -> NDArray[np.uint16]:
    """Return a picture of 8 or 16 bits as one of 16."""
    return codes if codes.dtype == np.uint16 else codes.astype(np.uint16) * np.uint16(257)


def resized(grey: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """Return a grey picture, uint8 or uint16, in another size, (width, height), or the same."""
    if (grey.shape[1], grey.shape[0]) == size:
        return grey
    from PIL import Image

    if grey.dtype == np.uint8:
        return np.asarray(Image.fromarray(np.ascontiguousarray(grey)).resize(size))
    # Pillow mixes pixels of 16 bits as floats alone.
    mixed = np.asarray(Image.fromarray(grey.astype(np.float32)).resize(size))
    return np.clip(np.rint(mixed), 0, 65535).astype(np.uint16)
