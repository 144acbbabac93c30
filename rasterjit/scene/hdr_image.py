"""
Read pictures of linear light: Radiance's ``.hdr``, OpenEXR's ``.exr``, and 8-bit ones.

References
----------
.. [1] G. Ward, "Real Pixels", Graphics Gems II, 1991: three mantissas share one exponent.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene import memory_limits
from rasterjit.scene.arrays import Float32, UInt8
from rasterjit.scene.memory_limits import FileSizeError, MemoryBudget
from rasterjit.scene.texture import Texture, check_texels, open_picture
from rasterjit.scene.validation import existing_file, needs_extra

RADIANCE_FORMATS = (".hdr", ".pic", ".rgbe")

EXPONENT_BIAS = 136
"""Bias of the shared exponent: 128, and 8 for the bits of the mantissas."""

MIN_PACKED_WIDTH, MAX_PACKED_WIDTH = 8, 32767
"""Widths of rows that may be packed channel by channel."""

MAX_LITERAL_RUN = 128
"""Largest count of a literal run; a larger count, less this, repeats one byte."""


def read_hdr_image(
    path: str | os.PathLike[str], max_bytes: int = memory_limits.DEFAULT_MAX_BYTES
) -> Float32:
    """
    Read a picture as linear light.

    Parameters
    ----------
    path : str or path-like
        ``.hdr``, ``.pic`` or ``.rgbe`` (Radiance), ``.exr`` (channels R, G and B, or Y alone;
        needs OpenEXR), or a picture as `Texture.from_file` reads it, decoded from sRGB.
    max_bytes : int
        Memory that it may take, told from its header before it is decoded.

    Returns
    -------
    (H, W, 3) float32
        Linear light, row 0 on top; alpha is dropped.

    Raises
    ------
    ValueError
        If the file is missing, holds no such picture, or needs more memory; the message names it.
    """
    file = existing_file("path", path)
    budget = MemoryBudget(str(file), max_bytes)
    budget.take("the file", file.stat().st_size)
    suffix = file.suffix.lower()
    if suffix in RADIANCE_FORMATS:
        return _read_radiance(file, budget)
    if suffix == ".exr":
        return _read_exr(file, budget)
    _reserve_texels(file, budget)
    return np.ascontiguousarray(Texture.from_file(file).image[:, :, :3])


def _reserve_texels(file: Path, budget: MemoryBudget) -> None:
    """Count the memory of an 8-bit picture's texels against the budget."""
    try:
        with open_picture("it", file) as image:
            width, height = image.size
    except Exception:
        # Pillow raises what it likes; who reads the picture says what is wrong.
        return
    budget.take("the picture", width * height * memory_limits.TEXEL_BYTES)


def _read_exr(file: Path, budget: MemoryBudget) -> Float32:
    """Read the colours of the first part of an OpenEXR file."""
    with needs_extra("exr", f"path {str(file)!r}: .exr needs OpenEXR", ValueError):
        import OpenEXR

    try:
        with OpenEXR.File(str(file), header_only=True) as opened:
            needed = sum(_exr_memory(part.header) for part in opened.parts)
        budget.take("the picture", needed)
        with OpenEXR.File(str(file), separate_channels=True) as opened:
            channels = {name: channel.pixels for name, channel in opened.channels().items()}
    except FileSizeError:
        raise
    except Exception as error:
        # OpenEXR's binding raises plain exceptions of several kinds.
        raise ValueError(f"path must be a picture, but {str(file)!r} is not: {error}") from error
    names = ("Y", "Y", "Y") if "Y" in channels and "R" not in channels else ("R", "G", "B")
    missing = sorted(set(names) - set(channels))
    if missing:
        raise ValueError(
            f"path must be a picture with the channels R, G, B or Y, but {str(file)!r} has "
            f"{', '.join(sorted(channels)) or 'none'}"
        )
    return np.stack([channels[name].astype(np.float32) for name in names], axis=-1)


def _exr_memory(header: dict[str, Any]) -> int:
    """Return the memory of a part of an OpenEXR file: its channels as floats, and the result."""
    (left, top), (right, bottom) = (np.asarray(at).tolist() for at in header["dataWindow"])
    texels = (int(right) - int(left) + 1) * (int(bottom) - int(top) + 1)
    return max(texels, 0) * (4 * len(header["channels"]) + memory_limits.TEXEL_BYTES)


def _read_radiance(file: Path, budget: MemoryBudget) -> Float32:
    """Read a Radiance file, rows from the top."""
    content = file.read_bytes()
    try:
        width, height, start = _radiance_header(content)
        budget.take("the picture", width * height * memory_limits.TEXEL_BYTES)
        rgbe = _unpack_texels(np.frombuffer(content, np.uint8), start, width, height)
    except FileSizeError:
        raise
    except (IndexError, ValueError) as error:
        raise ValueError(f"path must be a picture, but {str(file)!r} is not: {error}") from error
    exponents = rgbe[:, :, 3:].astype(np.int32) - EXPONENT_BIAS
    with np.errstate(under="ignore"):
        linear = np.ldexp(rgbe[:, :, :3].astype(np.float32), exponents)
    return np.where(rgbe[:, :, 3:] == 0, np.float32(0.0), linear)


def _radiance_header(content: bytes) -> tuple[int, int, int]:
    """Return width, height, and the offset of the pixels."""
    if not content.startswith((b"#?", b"\n", b"FORMAT")):
        raise ValueError("it has no Radiance header")
    end = content.index(b"\n\n")
    if b"32-bit_rle_xyze" in content[:end]:
        raise ValueError("its colours are XYZ")
    stop = content.index(b"\n", end + 2)
    words = content[end + 2 : stop].split()
    if len(words) != 4 or (words[0], words[2]) != (b"-Y", b"+X"):
        raise ValueError(f"its rows do not run from the top left: {words}")
    height, width = int(words[1]), int(words[3])
    check_texels("it", width, height)
    return width, height, stop + 1


def _unpack_texels(content: UInt8, start: int, width: int, height: int) -> NDArray[Any]:
    """Return mantissas and exponent of each texel, (H, W, 4) uint8."""
    header = content[start : start + 4].tolist()
    if not MIN_PACKED_WIDTH <= width <= MAX_PACKED_WIDTH or header[:2] != [2, 2] or header[2] > 127:
        flat = content[start : start + 4 * width * height]
        if flat.size < 4 * width * height:
            raise ValueError("it ends too early")
        rgbe = flat.reshape(height, width, 4)
        if (rgbe[:, :, :3] == 1).all(axis=2).any():
            raise ValueError("it is packed in the way of before 1991")
        return rgbe
    rows = np.empty((height, 4 * width), np.uint8)
    expected = [2, 2, width >> 8, width & 255]
    offset = start
    for row in rows:
        if content[offset : offset + 4].tolist() != expected:
            raise ValueError("a row of it does not begin as rows do")
        offset = _unpack_row(content, offset + 4, row)
    return np.moveaxis(rows.reshape(height, 4, width), 1, 2)


def _unpack_row(content: UInt8, offset: int, row: UInt8) -> int:
    """Decode a row, channel after channel, from runs and literals; return the next offset."""
    column, size = 0, len(row)
    while column < size:
        count = int(content[offset])
        if count > MAX_LITERAL_RUN:
            count -= MAX_LITERAL_RUN
            row[column : column + count] = content[offset + 1]
            offset += 2
        else:
            run = content[offset + 1 : offset + 1 + count]
            if count == 0 or len(run) < count:
                raise ValueError("it ends too early")
            row[column : column + count] = run[: size - column]
            offset += 1 + count
        column += count
    if column > size:
        raise ValueError("a run of it is longer than its row")
    return offset
