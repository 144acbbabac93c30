"""
Decode KTX 2 textures of Basis Universal, ETC1S and UASTC, with the library opengl_basisu.

References
----------
.. [1] The Khronos Group, "KHR_texture_basisu" and "KTX File Format Specification", version 2.0.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.gltf.extensions import BASIS, check_library
from rasterjit.io.pictures import take_texels
from rasterjit.io.skipped import reason_of
from rasterjit.scene.memory import MemoryBudget
from rasterjit.scene.texture import check_extent

if TYPE_CHECKING:
    from rasterjit.io.foreign.codecs import Decoder

SIGNATURE = b"\xabKTX 20\xbb\r\n\x1a\n"

_SIZE = 20
"""Where the header has the width and the height."""

_UNPACKED = 96
"""Where the index has the bytes of the largest level, unpacked."""

_BLOCK, _BLOCK_BYTES = 4, 16
"""Texels along a side of a block, and bytes of one that is unpacked, at most."""


def ktx2_pixels(content: bytes, what: str, budget: MemoryBudget, decoder: Decoder) -> NDArray[Any]:
    """
    Decode the largest level of a KTX 2 file.

    Parameters
    ----------
    content : bytes
        Begins with ``SIGNATURE``.
    what : str
        What a message calls it.
    budget : MemoryBudget
        Counts what its texels take.
    decoder : Decoder

    Returns
    -------
    (H, W, 3) uint8, or (H, W, 4) with alpha

    Raises
    ------
    MissingLibraryError
        If opengl_basisu is not installed.
    ValueError
        If it is damaged, holds something else than a Basis Universal picture, or is larger than
        the budget or `Texture` allows.
    """
    check_library(BASIS)
    if len(content) < _SIZE + 8:
        raise ValueError("it ends too early")
    size = struct.unpack_from("<II", content, _SIZE)
    check_extent("it", *size)
    take_texels(size, what, budget)
    try:
        pixels: NDArray[Any] = decoder.decode("ktx2", content)
    except Exception as error:
        raise ValueError(f"{BASIS}: {reason_of(error)}") from None
    return pixels


def transcoded(content: bytes, _: MemoryBudget) -> NDArray[Any]:
    """Return what `ktx2_pixels` does, as opengl_basisu finds it."""
    import opengl_basisu

    file = opengl_basisu.open(content)
    if file.faces != 1 or file.is_array or file.is_video:
        raise ValueError("it is no single picture")
    _check_unpacked(content)
    pixels = file.transcode("rgba8").data
    return np.ascontiguousarray(pixels if file.has_alpha else pixels[:, :, :3])


def _check_unpacked(content: bytes) -> None:
    """Raise ``ValueError`` if the largest level is said to be larger, unpacked, than its blocks."""
    width, height = struct.unpack_from("<II", content, _SIZE)
    (told,) = struct.unpack_from("<Q", content, _UNPACKED)
    most = -(-width // _BLOCK) * -(-height // _BLOCK) * _BLOCK_BYTES
    if told > most:
        raise ValueError(
            f"its largest level of {width}×{height} texels must have at most {most} bytes "
            f"unpacked, but says {told}"
        )
