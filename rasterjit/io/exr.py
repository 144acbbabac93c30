"""
Write named channels to an OpenEXR file, and choose the names by which other programs know them.

References
----------
.. [1] Academy Software Foundation, "Technical Introduction to OpenEXR": R, G, B, A and Z are the
   names of colour, opacity and depth, a layer's channels are ``layer.channel``, and colour is
   multiplied by alpha.
.. [2] Blender Manual, "Passes": multilayer files name vectors X, Y, Z and texture coordinates U, V.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.images import replacing

_PARTS = {1: ("",), 2: ("X", "Y"), 3: ("X", "Y", "Z"), 4: ("R", "G", "B", "A")}
"""Endings of a layer's channels by how many there are."""

_KNOWN = {
    "linear": ("R", "G", "B", "A"),
    "depth": ("Z",),
    "uv": ("uv.U", "uv.V"),
    "barycentric": ("barycentric.A", "barycentric.B", "barycentric.C"),
}
"""Channels that are named otherwise."""


class MissingOpenEXRError(ImportError, ValueError):
    """A file ends in ``.exr`` and OpenEXR is not installed."""


def channel_names(name: str, count: int) -> tuple[str, ...]:
    """
    Return the names of an output's channels.

    Parameters
    ----------
    name : str
        ``linear`` is R, G, B, A; ``depth`` is Z; ``uv`` is uv.U and uv.V; a single channel has the
        name of its output; two and three are X, Y and Z, and four R, G, B, A of their layer.
    count : int
        How many there are, 1..4.

    Raises
    ------
    ValueError
        If there are more.
    """
    if name in _KNOWN and len(_KNOWN[name]) == count:
        return _KNOWN[name]
    if count not in _PARTS:
        raise ValueError(f"outputs must have 1 to 4 channels for .exr, got {count} in {name!r}")
    return tuple(f"{name}.{part}" if part else name for part in _PARTS[count])


def write(
    place: Path, channels: Mapping[str, NDArray[Any]], attributes: Mapping[str, str] | None = None
) -> None:
    """
    Write channels to a scan-line file with lossless ZIP compression, whole or not at all.

    Parameters
    ----------
    place : Path
    channels : mapping of str to (H, W) float32 or uint32
        All of one shape; the file's data window is columns 0..W-1 and rows 0..H-1.
    attributes : mapping of str to str, optional
        What the header says besides.

    Raises
    ------
    MissingOpenEXRError
        An ``ImportError`` and a ``ValueError``: if OpenEXR is not installed.
    OSError
        If the file cannot be written; an existing one is left as it was.
    """
    try:
        import OpenEXR
    except ImportError:
        raise MissingOpenEXRError(
            f'path {str(place)!r}: .exr needs OpenEXR; pip install "rasterjit[exr]"'
        ) from None
    header = {
        **(attributes or {}),
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
    }
    pixels = {name: np.ascontiguousarray(array) for name, array in channels.items()}
    with replacing(place) as temporary, OpenEXR.File(header, pixels) as file:
        try:
            file.write(str(temporary))
        except RuntimeError as error:
            raise _as_os_error(error, temporary, place) from None


def _as_os_error(error: RuntimeError, temporary: Path, place: Path) -> OSError:
    """Return what OpenEXR says in words alone as the system's error, naming the file wanted."""
    said = str(error)
    for code in sorted(errno.errorcode):
        if os.strerror(code) in said:
            return OSError(code, os.strerror(code), str(place))
    return OSError(errno.EIO, said.replace(str(temporary), str(place)), str(place))
