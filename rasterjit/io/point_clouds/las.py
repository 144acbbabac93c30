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
from rasterjit.io.resources import MAX_NAME_LENGTH, Resources
from rasterjit.io.text.mesh_builder import srgb_rgba
from rasterjit.io.text.number_parser import Damage

LAS_FORMATS = ("las", "laz")

_POINT_BYTES = 3
"""Memory of a byte of a point, while it is unpacked and in its columns."""

_COLORS = ("red", "green", "blue")
_READ_RECORDS = ("LASF_Projection", "LASF_Spec", "laszip encoded", "copc")
"""Authors of records on compression and georeferencing, which are not noted."""

_READ_DIMENSIONS = {"X", "Y", "Z", *_COLORS}

_COUNTS, _COUNTS_AT = struct.Struct("<HIIB"), 94
"""Header length, offset of the points, number of variable-length records (VLRs), point format."""

_EVLRS, _EVLRS_AT = struct.Struct("<QI"), 235
"""Offset and number of the extended variable-length records (EVLRs) of version 1.4."""

_VLR_BYTES, _EVLR_BYTES = 54, 60
"""Header bytes of a VLR and of an EVLR."""

_COMPRESSED_BIT = 0x80
"""Bit of the point format in LAZ files."""


def read_las(path: Path, resources: Resources, damage: Damage, left_out: LeftOut) -> list[Cloud]:
    """Return the cloud of a LAS or LAZ file, or raise `MeshFileError`."""
    suffix = path.suffix.lower()
    try:
        import laspy
    except ImportError as error:
        raise MeshFileError(
            f"{path}: reading {suffix} needs a package that is not installed ({error}); "
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
            f"{path} could not be read as {suffix}: {reason_of(error)}{missing}"
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
        if name not in _READ_DIMENSIONS and (values != values[0]).any():
            attributes[name] = values
    return [Cloud(path.name, positions, colors, attributes=attributes)]


def _check_counts(path: Path) -> None:
    """Raise `MeshFileError` if the header counts more records or chunks than the file can hold."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_EVLRS_AT + _EVLRS.size)
        if len(head) < _COUNTS_AT + _COUNTS.size or not head.startswith(b"LASF"):
            # laspy says what is wrong.
            return
        begin, points, count, form = _COUNTS.unpack_from(head, _COUNTS_AT)
        declared = [("records", count, size - begin, _VLR_BYTES)]
        if head[24:26] >= b"\1\4" and len(head) == _EVLRS_AT + _EVLRS.size:
            begin, count = _EVLRS.unpack_from(head, _EVLRS_AT)
            declared.append(("records behind its points", count, size - begin, _EVLR_BYTES))
        if form & _COMPRESSED_BIT:
            declared.append(
                ("chunks of points", _chunk_count(file, points, size), size - points, 1)
            )
    for what, count, bytes_left, entry_bytes in declared:
        max_count = max(bytes_left, 0) // entry_bytes
        if count > max_count:
            raise MeshFileError(
                f"{path} is damaged: its head says {count} {what}, but it has room for {max_count}"
            )


def _chunk_count(file: BinaryIO, points: int, size: int) -> int:
    """Return the number of chunks of points that a LAZ file declares, or 0."""
    for offset in (points, size - 8):
        # A file that was written without going back says it at its end.
        file.seek(max(offset, 0))
        content = file.read(8)
        table_offset = struct.unpack("<q", content)[0] if len(content) == 8 else -1
        if table_offset >= 0:
            file.seek(min(table_offset + 4, size))
            content = file.read(4)
            return int(struct.unpack("<I", content)[0]) if len(content) == 4 else 0
    return 0


def _note_records(reader: Any, left_out: LeftOut) -> None:
    """Note records of unknown authors."""
    header = reader.header
    records = [
        *header.vlrs,
        *(getattr(reader, "evlrs", None) or getattr(header, "evlrs", None) or ()),
    ]
    for one in records:
        if one.user_id not in _READ_RECORDS:
            left_out.note(f"record of {one.user_id[:MAX_NAME_LENGTH]!r}")


def _check_length(path: Path, header: Any, damage: Damage) -> None:
    """Report a file that is too short for its points."""
    fitting = max(0, path.stat().st_size - header.offset_to_point_data) // header.point_format.size
    if fitting < header.point_count:
        damage.end(f"{header.point_count} points, as its head says", f"room for {fitting}")


def _colors(points: Any) -> NDArray[np.float32] | None:
    """Return colours, linear RGBA, of 16 or of 8 bits; None if all are black."""
    codes = np.column_stack([np.asarray(points[name]) for name in _COLORS])
    brightest = int(codes.max())
    if brightest == 0:
        return None
    return srgb_rgba(codes.astype(np.uint8) if brightest <= 255 else codes)
