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

from rasterjit.io.load_warnings import (
    LeftOut,
    MeshFileError,
    make_missing_package_error,
    reason_of,
)
from rasterjit.io.primitives import Cloud
from rasterjit.io.resources import MAX_NAME_LENGTH, Resources
from rasterjit.io.text.mesh_builder import srgb_to_rgba
from rasterjit.io.text.number_parser import Damage

LAS_FORMATS = ("las", "laz")

_MEMORY_PER_POINT_BYTE = 3
"""Bytes of memory for a byte of a point, while it is unpacked and in its columns."""

_COLORS = ("red", "green", "blue")
_KNOWN_RECORD_AUTHORS = ("LASF_Projection", "LASF_Spec", "laszip encoded", "copc")
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
        raise make_missing_package_error(path, suffix[1:], error, "'rasterjit[clouds]'") from error
    resources.budget.take("the file", path.stat().st_size)
    _check_counts(path)
    try:
        with laspy.open(path) as reader:
            count = reader.header.point_count
            size = reader.header.point_format.size
            resources.budget.take(f"its {count} points", count * size * _MEMORY_PER_POINT_BYTE)
            if not reader.header.are_points_compressed:
                _check_length(path, reader.header, damage)
            points = reader.read_points(count)
            _note_records(reader, left_out)
            scales, offsets = reader.header.scales, reader.header.offsets
    except MeshFileError:
        raise
    except Exception as error:
        # Readers of compressed points raise what they like about a damaged file.
        lacks_backend = "LazBackend" in str(error)
        remedy = "; pip install 'rasterjit[clouds]' brings it" if lacks_backend else ""
        raise MeshFileError(
            f"{path} could not be read as {suffix}: {reason_of(error)}{remedy}"
        ) from error
    if len(points) < count:
        damage.report_end(f"{count} points, as its head says", str(len(points)))
    if not len(points):
        raise MeshFileError(f"{path} holds a point cloud of no points")
    positions = np.column_stack(
        [np.asarray(points[axis]) * scales[n] + offsets[n] for n, axis in enumerate("XYZ")]
    )
    names = list(points.point_format.dimension_names)
    colors = _decode_colors(points) if set(_COLORS) <= set(names) else None
    attributes = {}
    for name in names:
        values = np.asarray(points[name])
        # Dimensions that the point format always has are mostly unused.
        if name not in _READ_DIMENSIONS and (values != values[0]).any():
            attributes[name] = values
    return [Cloud(path.name, positions, colors, attributes=attributes)]


def _check_counts(path: Path) -> None:
    """Raise `MeshFileError` if the header counts more records or chunks than the file can hold."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_EVLRS_AT + _EVLRS.size)
        if len(head) < _COUNTS_AT + _COUNTS.size or not head.startswith(b"LASF"):
            # laspy reports the problem.
            return
        begin, points_offset, count, point_format = _COUNTS.unpack_from(head, _COUNTS_AT)
        declared = [("records", count, size - begin, _VLR_BYTES)]
        if head[24:26] >= b"\1\4" and len(head) == _EVLRS_AT + _EVLRS.size:
            begin, count = _EVLRS.unpack_from(head, _EVLRS_AT)
            declared.append(("records behind its points", count, size - begin, _EVLR_BYTES))
        if point_format & _COMPRESSED_BIT:
            count = _read_chunk_count(file, points_offset, size)
            declared.append(("chunks of points", count, size - points_offset, 1))
    for what, count, bytes_left, entry_bytes in declared:
        max_count = max(bytes_left, 0) // entry_bytes
        if count > max_count:
            raise MeshFileError(
                f"{path} is damaged: its head says {count} {what}, but it has room for {max_count}"
            )


def _read_chunk_count(file: BinaryIO, points_offset: int, size: int) -> int:
    """Return the number of chunks of points that a LAZ file declares, or 0."""
    for offset in (points_offset, size - 8):
        # A file that was written as a stream has the table's offset at its end.
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
    evlrs = getattr(reader, "evlrs", None) or getattr(header, "evlrs", None) or ()
    for record in (*header.vlrs, *evlrs):
        if record.user_id not in _KNOWN_RECORD_AUTHORS:
            left_out.note(f"record of {record.user_id[:MAX_NAME_LENGTH]!r}")


def _check_length(path: Path, header: Any, damage: Damage) -> None:
    """Report a file that is too short for its points."""
    available = max(0, path.stat().st_size - header.offset_to_point_data)
    capacity = available // header.point_format.size
    if capacity < header.point_count:
        damage.report_end(f"{header.point_count} points, as its head says", f"room for {capacity}")


def _decode_colors(points: Any) -> NDArray[np.float32] | None:
    """Return the colours, of 16 or 8 bits, as linear RGBA; None if all are black."""
    codes = np.column_stack([np.asarray(points[name]) for name in _COLORS])
    brightest = int(codes.max())
    if brightest == 0:
        return None
    return srgb_to_rgba(codes.astype(np.uint8) if brightest <= 255 else codes)
