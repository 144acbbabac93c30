"""
Read LAS and LAZ files [1]_ by laspy, which the extra ``rasterjit[clouds]`` brings.

References
----------
.. [1] ASPRS, "LAS Specification 1.4 - R15", 2019.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
from rasterjit.io.primitives import Cloud
from rasterjit.io.resources import LONGEST_NAME, Resources
from rasterjit.io.text.number_parser import Damage
from rasterjit.scene.color import srgb_to_linear

LAS_FORMATS = ("las", "laz")

_POINT_BYTES = 3
"""What a byte of a point takes, while it is unpacked and in its columns."""

_COLORS = ("red", "green", "blue")
_KNOWN_RECORDS = ("LASF_Projection", "LASF_Spec", "laszip encoded", "copc")
"""What writes records that say how points are packed, and where on Earth they are."""

_KNOWN = {"X", "Y", "Z", *_COLORS}

_COUNTS, _COUNTS_AT = struct.Struct("<HIIB"), 94
"""The head's length, where points begin, how many records are before them, and their form."""

_LATER, _LATER_AT = struct.Struct("<QI"), 235
"""Of version 1.4: where records behind the points begin, and how many there are."""

_RECORD, _LATER_RECORD = 54, 60
"""Bytes at the beginning of a record before the points, and of one behind them."""

_IS_PACKED = 0x80
"""A bit of the form of points in LAZ files."""


def read_las(path: Path, resources: Resources, damage: Damage, left_out: LeftOut) -> list[Cloud]:
    """Return the cloud of a LAS or LAZ file, or raise `MeshFileError`."""
    form = path.suffix.lower()
    try:
        import laspy
    except ImportError as error:
        raise MeshFileError(
            f"{path}: reading {form} needs a package that is not installed ({error}); "
            "pip install 'rasterjit[clouds]' brings it"
        ) from error
    resources.budget.take("the file", path.stat().st_size)
    _check_counts(path)
    try:
        with laspy.open(path) as reader:
            count = reader.header.point_count
            size = reader.header.point_format.size
            resources.budget.take(f"its {count} points", count * size * _POINT_BYTES)
            packed = reader.header.are_points_compressed
            if not packed:
                _check_length(path, reader.header, damage)
            points = reader.read_points(count)
            _note_records(reader, left_out)
            scales, offsets = reader.header.scales, reader.header.offsets
    except MeshFileError:
        raise
    except Exception as error:
        # Readers of compressed points raise what they like about a damaged file.
        missing = (
            "; pip install 'rasterjit[clouds]' brings it" if "LazBackend" in str(error) else ""
        )
        raise MeshFileError(
            f"{path} could not be read as {form}: {reason_of(error)}{missing}"
        ) from error
    if len(points) < count:
        damage.end(f"{count} points, as its head says", str(len(points)))
    if not len(points):
        raise MeshFileError(f"{path} holds a point cloud of no points")
    positions = np.column_stack(
        [np.asarray(points[axis]) * scales[n] + offsets[n] for n, axis in enumerate("XYZ")]
    )
    names = list(points.point_format.dimension_names)
    colors = _colors(points) if set(_COLORS) <= set(names) else None
    attributes = {}
    for name in names:
        values = np.asarray(points[name])
        # Fields that every point has are mostly empty.
        if name not in _KNOWN and (values != values[0]).any():
            attributes[name] = values
    return [Cloud(path.name, positions, colors, attributes=attributes)]


def _check_counts(path: Path) -> None:
    """Raise `MeshFileError` if a file says that it has more of something than it has bytes for."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_LATER_AT + _LATER.size)
        if len(head) < _COUNTS_AT + _COUNTS.size or not head.startswith(b"LASF"):
            # laspy says what is wrong.
            return
        begin, points, count, form = _COUNTS.unpack_from(head, _COUNTS_AT)
        said = [("records", count, size - begin, _RECORD)]
        if head[24:26] >= b"\1\4" and len(head) == _LATER_AT + _LATER.size:
            begin, count = _LATER.unpack_from(head, _LATER_AT)
            said.append(("records behind its points", count, size - begin, _LATER_RECORD))
        if form & _IS_PACKED:
            said.append(("chunks of points", _chunk_count(file, points, size), size - points, 1))
    for what, count, room, each in said:
        most = max(room, 0) // each
        if count > most:
            raise MeshFileError(
                f"{path} is damaged: its head says {count} {what}, but it has room for {most}"
            )


def _chunk_count(file: BinaryIO, points: int, size: int) -> int:
    """Return how many chunks a LAZ file says that its points have; 0 if it says nothing."""
    for place in (points, size - 8):
        # A file that was written without going back says it at its end.
        file.seek(max(place, 0))
        said = file.read(8)
        table = struct.unpack("<q", said)[0] if len(said) == 8 else -1
        if table >= 0:
            file.seek(min(table + 4, size))
            said = file.read(4)
            return int(struct.unpack("<I", said)[0]) if len(said) == 4 else 0
    return 0


def _note_records(reader: Any, left_out: LeftOut) -> None:
    """Note records beside the points that are of no known kind."""
    header = reader.header
    records = [
        *header.vlrs,
        *(getattr(reader, "evlrs", None) or getattr(header, "evlrs", None) or ()),
    ]
    for one in records:
        if one.user_id not in _KNOWN_RECORDS:
            left_out.note(f"record of {one.user_id[:LONGEST_NAME]!r}")


def _check_length(path: Path, header: Any, damage: Damage) -> None:
    """Report a file that is too short for its points."""
    room = max(0, path.stat().st_size - header.offset_to_point_data) // header.point_format.size
    if room < header.point_count:
        damage.end(f"{header.point_count} points, as its head says", f"room for {room}")


def _colors(points: Any) -> NDArray[np.float32] | None:
    """Return colours, linear RGBA; None if all are black. Some programs write bytes."""
    codes = np.column_stack([np.asarray(points[name]) for name in _COLORS])
    high = int(codes.max())
    if high == 0:
        return None
    rgba = np.ones((len(codes), 4), np.float32)
    rgba[:, :3] = srgb_to_linear((codes if high <= 255 else codes >> 8).astype(np.uint8))
    return rgba
