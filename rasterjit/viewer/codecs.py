"""Pictures as they are sent to a page: as they are, or nearly and smaller."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

QUALITY = 90
"""Of JPEG: of neighbouring pixels no colour is mixed."""

LEVEL = 1
"""Of zlib, the quickest: a picture of 1280 by 800 pixels takes 5 ms, and 26 ms at level 6."""

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_UP = 2
"""The filter of PNG that takes each row as its difference to the one above."""
_RGB = 2


def encode_png(picture: NDArray[np.uint8]) -> bytes:
    """
    Return a picture as a PNG file of its colours, quickly.

    Parameters
    ----------
    picture : (H, W, 4) uint8
        What is transparent in it becomes opaque.

    References
    ----------
    Portable Network Graphics (PNG) Specification (Third Edition), W3C.
    """
    height, width = picture.shape[:2]
    colors = picture[:, :, :3].reshape(height, 3 * width)
    rows = np.empty((height, 1 + 3 * width), dtype=np.uint8)
    rows[:, 0] = _UP
    rows[0, 1:] = colors[0]
    np.subtract(colors[1:], colors[:-1], out=rows[1:, 1:])
    header = struct.pack(">IIBBBBB", width, height, 8, _RGB, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows, LEVEL)), (b"IEND", b""))
    return _SIGNATURE + b"".join(_chunk(kind, data) for kind, data in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    """Return a part of a PNG file."""
    checked = kind + data
    return struct.pack(">I", len(data)) + checked + struct.pack(">I", zlib.crc32(checked))


def encode_jpeg(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture, (H, W, 4) uint8, C-contiguous, as a JPEG file of its colours."""
    import simplejpeg

    return simplejpeg.encode_jpeg(picture, QUALITY, "RGBA", "444", True)
