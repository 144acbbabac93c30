"""
Read PCD files [1]_: text, binary and compressed, organized or not.

References
----------
.. [1] R. B. Rusu and S. Cousins, "3D is here: Point Cloud Library (PCL)", ICRA 2011; "The PCD
   (Point Cloud Data) file format", version 0.7.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError
from rasterjit.io.primitives import Cloud
from rasterjit.io.resources import Resources
from rasterjit.io.text import number_parser
from rasterjit.io.text.mesh_builder import normalize_names, srgb_to_rgba
from rasterjit.io.text.number_parser import Damage, TextLines

_MIN_BACK_REFERENCE = 32
"""Control bytes below this precede literal bytes; others begin a back reference."""

_EXTENDED_LENGTH = 7
"""Length with which a further byte has the rest."""


def unpack_lzf(packed: bytes, size: int) -> bytes:
    """
    Unpack LZF data.

    Parameters
    ----------
    packed : bytes
    size : int
        Bytes of the result.

    Raises
    ------
    ValueError
        If it is damaged, or its result is of another size.
    """
    content, at, end = bytearray(), 0, len(packed)
    try:
        while at < end and len(content) <= size:
            control = packed[at]
            at += 1
            if control < _MIN_BACK_REFERENCE:
                content += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == _EXTENDED_LENGTH:
                length += packed[at]
                at += 1
            distance = ((control & 31) << 8) + packed[at] + 1
            at += 1
            length += 2
            begin = len(content) - distance
            if begin < 0:
                raise ValueError("it refers to bytes before its first")
            if distance >= length:
                content += content[begin : begin + length]
            else:
                # The bytes repeat themselves.
                content += (content[begin:] * (length // distance + 1))[:length]
    except IndexError:
        raise ValueError("it is cut short") from None
    if len(content) != size or at > end:
        raise ValueError(f"it unpacks to {len(content)} bytes in place of {size}")
    return bytes(content)


_DTYPES = {
    ("I", 1): "<i1", ("I", 2): "<i2", ("I", 4): "<i4", ("I", 8): "<i8",
    ("U", 1): "<u1", ("U", 2): "<u2", ("U", 4): "<u4", ("U", 8): "<u8",
    ("F", 2): "<f2", ("F", 4): "<f4", ("F", 8): "<f8",
}  # fmt: skip

_POSITION, _NORMAL = ("x", "y", "z"), ("normal_x", "normal_y", "normal_z")
_COLORS = ("rgb", "rgba")
"""Fields of packed colours: blue, green, red and, of the latter, alpha."""

_PADDING_FIELD = "_"

_KNOWN_NAMES = (_POSITION, _NORMAL, *((name,) for name in _COLORS))
"""Field names that are read in any case."""

_DEFAULT_VIEWPOINT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""Position and quaternion."""

_HEADER_KEYS = ("VERSION", "FIELDS", "COLUMNS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT",
               "VIEWPOINT", "POINTS", "DATA")  # fmt: skip

_MAX_VALUES_PER_POINT = 1 << 20


@dataclass
class _Field:
    """A field of a point: its name, type and number of values."""

    name: str
    dtype: np.dtype
    count: int


@dataclass
class _Header:
    """The header of a file."""

    fields: list[_Field]
    point_count: int
    encoding: str
    points_offset: int
    has_viewpoint: bool
    """Whether the viewpoint is another than the default."""

    @property
    def point_bytes(self) -> int:
        """Bytes of a point in a binary file."""
        return sum(field.dtype.itemsize * field.count for field in self.fields)


def read_pcd(path: Path, resources: Resources, damage: Damage, left_out: LeftOut) -> list[Cloud]:
    """Return the cloud of a PCD file, or raise `MeshFileError`."""
    data = resources.read_mesh_file(path)
    try:
        header = _read_header(data)
        resources.budget.take(
            f"its {header.point_count} points",
            header.point_count * number_parser.MEMORY_PER_BINARY_BYTE * header.point_bytes,
        )
        left_out.note("viewpoint", int(header.has_viewpoint))
        if header.encoding == "ascii":
            columns = _read_text(
                TextLines(data, resources.budget, header.points_offset), header, damage
            )
        elif header.encoding == "binary":
            columns = _read_binary(data, header, damage)
        else:
            columns = _read_compressed(data, header)
    except MeshFileError:
        raise
    except ValueError as error:
        raise MeshFileError(f"{path} could not be read as .pcd: {error}") from None
    return [_make_cloud(path, columns, left_out)]


def _read_header(data: bytes) -> _Header:
    """Read the header of a file, or raise ``ValueError``."""
    # Lines of a keyword and its values, up to DATA.
    values: dict[str, list[str]] = {}
    at, number, ending = 0, 0, number_parser.find_line_ending(data)
    while "DATA" not in values:
        end = data.find(ending, at)
        if end < 0:
            raise ValueError("its head has no DATA")
        words = data[at:end].decode("utf-8", "replace").split()
        at, number = end + 1, number + 1
        if not words or words[0].startswith("#"):
            continue
        words[0] = words[0].upper()
        if words[0] not in _HEADER_KEYS:
            raise ValueError(
                f"line {number}: expected one of {', '.join(_HEADER_KEYS)}, got {words[0][:40]!r}"
            )
        values[words[0]] = words[1:]
    # The fields of a point.
    names = values.get("FIELDS", values.get("COLUMNS", []))
    counts = values.get("COUNT", ["1"] * len(names))
    sizes, types = values.get("SIZE", ["4"] * len(names)), values.get("TYPE", ["F"] * len(names))
    if not names or not len(names) == len(counts) == len(sizes) == len(types):
        raise ValueError(
            f"FIELDS, SIZE, TYPE and COUNT must be as many, got {len(names)}, {len(sizes)}, "
            f"{len(types)} and {len(counts)}"
        )
    fields = []
    names = normalize_names(names, _KNOWN_NAMES)
    for name, size, type_letter, count in zip(names, sizes, types, counts, strict=True):
        dtype = _DTYPES.get((type_letter.upper(), _parse_integer("SIZE", size)))
        if dtype is None:
            raise ValueError(
                f"field {name[:40]!r} must be of a known type, got {type_letter} of {size}"
            )
        fields.append(_Field(name, np.dtype(dtype), _parse_integer("COUNT", count)))
    if not 0 < sum(field.count for field in fields) <= _MAX_VALUES_PER_POINT:
        raise ValueError(f"COUNT must name 1 to {_MAX_VALUES_PER_POINT} values of a point")
    # Number and encoding of the points.
    shape = [_parse_integer(key, *values[key]) for key in ("WIDTH", "HEIGHT") if key in values]
    points = math.prod(shape or [0])
    if "POINTS" in values:
        points = _parse_integer("POINTS", *values["POINTS"])
    if len(shape) == 2 and math.prod(shape) != points:
        raise ValueError(
            f"POINTS must be WIDTH times HEIGHT, got {points}, {shape[0]} and {shape[1]}"
        )
    encoding = " ".join(values["DATA"]).lower()
    if encoding not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"DATA must be ascii, binary or binary_compressed, got {encoding[:40]!r}")
    default = _DEFAULT_VIEWPOINT
    viewpoint = [
        number_parser.parse_float(word) for word in values.get("VIEWPOINT", ())[: len(default)]
    ]
    return _Header(fields, points, encoding, at, viewpoint != list(default[: len(viewpoint)]))


def _parse_integer(name: str, *words: str) -> int:
    """Return the integer of a header line, or raise ``ValueError``."""
    if len(words) != 1 or not words[0].isdecimal() or len(words[0]) > 15:
        raise ValueError(f"{name} must be a whole number, got {' '.join(words)[:40]!r}")
    return int(words[0])


def _read_text(lines: TextLines, header: _Header, damage: Damage) -> dict[str, NDArray[Any]]:
    """Return the values of each field, (N,) or (N, count), of a text file."""
    rows = np.flatnonzero((lines.starts < lines.ends) & (lines.byte_at(0) != ord("#")))
    width = sum(field.count for field in header.fields)
    if len(rows) < header.point_count:
        damage.report_end(f"{header.point_count} lines of points, as its head says", str(len(rows)))
    elif len(rows) > header.point_count:
        damage.report_line(
            lines, int(rows[header.point_count]), "no line behind those that its head says"
        )
    rows = rows[: header.point_count]
    row_name = f"a point ({', '.join(field.name for field in header.fields)})"
    table = number_parser.parse_equal_rows(lines, rows, width, row_name, damage)
    columns, at = {}, 0
    for field in header.fields:
        with np.errstate(invalid="ignore", over="ignore"):
            values = table[:, at : at + field.count]
            # Whole numbers of 32 bits that stand for a packed colour are no floats.
            is_bits = field.name in _COLORS and bool((values >= 1.0).any())
            columns[field.name] = _squeeze(values.astype("<u4" if is_bits else field.dtype))
        at += field.count
    return columns


def _read_binary(data: bytes, header: _Header, damage: Damage) -> dict[str, NDArray[Any]]:
    """Return the values of each field, (N,) or (N, count), of a binary file."""
    row_type = np.dtype([(f"v{n}", one.dtype, (one.count,)) for n, one in enumerate(header.fields)])
    capacity = (len(data) - header.points_offset) // row_type.itemsize
    if capacity < header.point_count:
        damage.report_end(f"{header.point_count} points, as its head says", f"room for {capacity}")
    rows = np.frombuffer(data, row_type, min(capacity, header.point_count), header.points_offset)
    return {field.name: _squeeze(rows[f"v{n}"]) for n, field in enumerate(header.fields)}


def _read_compressed(data: bytes, header: _Header) -> dict[str, NDArray[Any]]:
    """Return the values of each field, (N,) or (N, count), of a compressed file."""
    if len(data) < header.points_offset + 8:
        raise ValueError("it is cut short before its points")
    packed_size, size = struct.unpack_from("<II", data, header.points_offset)
    expected = header.point_count * header.point_bytes
    if size != expected:
        raise ValueError(f"its points must take {expected} bytes, as its head says, got {size}")
    packed = data[header.points_offset + 8 : header.points_offset + 8 + packed_size]
    if len(packed) < packed_size:
        raise ValueError(f"it must have {packed_size} compressed bytes, got {len(packed)}")
    unpacked, at, columns = unpack_lzf(packed, size), 0, {}
    for field in header.fields:
        values = np.frombuffer(unpacked, field.dtype, header.point_count * field.count, at)
        columns[field.name] = _squeeze(values.reshape(-1, field.count))
        at += values.nbytes
    return columns


def _squeeze(values: NDArray[Any]) -> NDArray[Any]:
    """Return a table of one column as (N,)."""
    return values[:, 0] if values.shape[1] == 1 else values


def _make_cloud(path: Path, columns: dict[str, NDArray[Any]], left_out: LeftOut) -> Cloud:
    """Return a cloud whose columns are used by the meaning of their names."""
    if any(name not in columns or columns[name].ndim != 1 for name in _POSITION):
        raise MeshFileError(
            f"{path} must have the fields x, y and z, got {', '.join(columns)[:80]}"
        )
    colors, normals = None, None
    for name in _COLORS:
        if name in columns and columns[name].ndim == 1 and columns[name].dtype.itemsize == 4:
            colors = _unpack_colors(columns[name], name == "rgba")
        elif name in columns:
            left_out.note(f"field {name!r} that holds no packed colours")
    if all(name in columns and columns[name].ndim == 1 for name in _NORMAL):
        normals = np.column_stack([columns[name] for name in _NORMAL])
    used = {*_POSITION, *(_NORMAL if normals is not None else ()), *_COLORS, _PADDING_FIELD}
    return Cloud(
        path.name, np.column_stack([columns[name] for name in _POSITION]).astype(np.float64),
        colors, normals, {name: values for name, values in columns.items() if name not in used},
    )  # fmt: skip


def _unpack_colors(column: NDArray[Any], has_alpha: bool) -> NDArray[np.float32]:
    """Return packed colours as linear RGBA."""
    codes = np.ascontiguousarray(column).view("<u1").reshape(-1, 4)
    # Blue, green, red and alpha; many programs leave the byte of alpha empty.
    return srgb_to_rgba(codes[:, [2, 1, 0, 3] if has_alpha and codes[:, 3].any() else [2, 1, 0]])
