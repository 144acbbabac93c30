"""
Encode 16-bit grey and RGB pictures with text as PNG.

Pillow, and with it imageio, writes 16 bits a channel in grey alone; RGB has to be put together
here, and grey is written the same way.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _RGB = 0, 2
"""PNG's colour types."""
_UP = 2
"""PNG's filter that stores the difference from the row above: smooth pictures pack better."""
_LONGEST_KEY = 79


def encode(pixels: NDArray[np.uint16], texts: Mapping[str, str]) -> bytes:
    """
    Return a PNG file of 16-bit grey or RGB pixels.

    Parameters
    ----------
    pixels : (H, W) or (H, W, 3) uint16
    texts : mapping of str to str
        What its ``tEXt`` chunks say: keys of 1 to 79 characters and values, Latin-1.

    Raises
    ------
    ValueError
        If ``pixels`` is not such an array, or ``texts`` cannot be written as Latin-1.

    References
    ----------
    Portable Network Graphics (PNG) Specification (Third Edition), W3C.
    """
    is_rgb = pixels.ndim == 3
    if pixels.dtype != np.uint16 or pixels.size == 0 or pixels.shape[2:] not in ((), (3,)):
        raise ValueError(
            f"pixels must be (H, W) or (H, W, 3) uint16, not empty; got {pixels.shape} "
            f"{pixels.dtype}"
        )
    height, width = pixels.shape[:2]
    header = struct.pack(">IIBBBBB", width, height, 16, _RGB if is_rgb else _GREY, 0, 0, 0)
    chunks = [(b"IHDR", header)]
    chunks += [(b"tEXt", _text(key, value)) for key, value in texts.items()]
    chunks += [(b"IDAT", zlib.compress(_filtered_rows(pixels), 6)), (b"IEND", b"")]
    return _SIGNATURE + b"".join(_chunk(kind, data) for kind, data in chunks)


def _filtered_rows(pixels: NDArray[np.uint16]) -> bytes:
    """Return each row as its filter's number and its bytes less those of the row above."""
    stored = np.ascontiguousarray(pixels, dtype=">u2").reshape(len(pixels), -1).view(np.uint8)
    rows = np.empty((len(stored), stored.shape[1] + 1), np.uint8)
    rows[:, 0] = _UP
    rows[0, 1:] = stored[0]
    np.subtract(stored[1:], stored[:-1], out=rows[1:, 1:])
    return rows.tobytes()


def _text(key: str, value: str) -> bytes:
    """Return the content of a ``tEXt`` chunk."""
    try:
        name, said = key.encode("latin-1"), value.encode("latin-1")
    except UnicodeEncodeError:
        raise ValueError(f"texts must be Latin-1, got {key!r}: {value!r}") from None
    if not 1 <= len(name) <= _LONGEST_KEY or b"\0" in name + said:
        raise ValueError(f"texts must have keys of 1..{_LONGEST_KEY} characters, got {key!r}")
    return name + b"\0" + said


def _chunk(kind: bytes, data: bytes) -> bytes:
    """Return a chunk: its length, name and content, and the check sum of the last two."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
