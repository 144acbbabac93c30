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
from rasterjit.io.text.mesh_builder import normalize_names, srgb_rgba
from rasterjit.io.text.number_parser import (
    BINARY_BYTES,
    Damage,
    TextLines,
    line_end,
    number_rows,
    parse_float,
)

_MIN_REFERENCE = 32
"""Control bytes below this precede literal bytes."""

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
            if control < _MIN_REFERENCE:
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


_TYPES = {
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

_ORIGIN = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""Default viewpoint: position and quaternion."""

_HEADER_KEYS = ("VERSION", "FIELDS", "COLUMNS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT",
               "VIEWPOINT", "POINTS", "DATA")  # fmt: skip

_MAX_VALUES = 1 << 20
"""Most values of all fields of a point."""


@dataclass
class _Field:
    """A field of a point: its name, type and number of values."""

    name: str
    kind: np.dtype
    count: int


@dataclass
class _Head:
    """The header of a file."""

    fields: list[_Field]
    points: int
    form: str
    at: int
    """Offset of the points."""
    has_viewpoint: bool
    """Whether the header has another viewpoint than the default."""


def read_pcd(path: Path, resources: Resources, damage: Damage, left_out: LeftOut) -> list[Cloud]:
    """Return the cloud of a PCD file, or raise `MeshFileError`."""
    data = resources.read_mesh_file(path)
    try:
        head = _read_head(data)
        resources.budget.take(
            f"its {head.points} points",
            head.points * BINARY_BYTES * sum(one.kind.itemsize * one.count for one in head.fields),
        )
        left_out.note("viewpoint", int(head.has_viewpoint))
        if head.form == "ascii":
            columns = _text_columns(TextLines(data, resources.budget, head.at), head, damage)
        elif head.form == "binary":
            columns = _binary_columns(data, head, damage)
        else:
            columns = _packed_columns(data, head)
    except MeshFileError:
        raise
    except ValueError as error:
        raise MeshFileError(f"{path} could not be read as .pcd: {error}") from None
    return [_cloud(path, columns, left_out)]


def _read_head(data: bytes) -> _Head:
    """Read the header of a file, or raise ``ValueError``."""
    # Lines of a word and what it says, up to DATA.
    values: dict[str, list[str]] = {}
    at, number, ending = 0, 0, line_end(data)
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
    for name, size, kind, count in zip(names, sizes, types, counts, strict=True):
        dtype = _TYPES.get((kind.upper(), _whole("SIZE", size)))
        if dtype is None:
            raise ValueError(f"field {name[:40]!r} must be of a known type, got {kind} of {size}")
        fields.append(_Field(name, np.dtype(dtype), _whole("COUNT", count)))
    if not 0 < sum(one.count for one in fields) <= _MAX_VALUES:
        raise ValueError(f"COUNT must name 1 to {_MAX_VALUES} values of a point")
    # How many points there are, and how they are written.
    shape = [_whole(key, *values[key]) for key in ("WIDTH", "HEIGHT") if key in values]
    points = _whole("POINTS", *values["POINTS"]) if "POINTS" in values else math.prod(shape or [0])
    if len(shape) == 2 and math.prod(shape) != points:
        raise ValueError(
            f"POINTS must be WIDTH times HEIGHT, got {points}, {shape[0]} and {shape[1]}"
        )
    mode = " ".join(values["DATA"]).lower()
    if mode not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"DATA must be ascii, binary or binary_compressed, got {mode[:40]!r}")
    viewpoint = [parse_float(word) for word in values.get("VIEWPOINT", ())[: len(_ORIGIN)]]
    has_viewpoint = viewpoint != list(_ORIGIN[: len(viewpoint)])
    return _Head(fields, points, mode, at, has_viewpoint)


def _whole(name: str, *words: str) -> int:
    """Return the integer of a header line, or raise ``ValueError``."""
    if len(words) != 1 or not words[0].isdecimal() or len(words[0]) > 15:
        raise ValueError(f"{name} must be a whole number, got {' '.join(words)[:40]!r}")
    return int(words[0])


def _text_columns(lines: TextLines, head: _Head, damage: Damage) -> dict[str, NDArray[Any]]:
    """Return the values of each field, (N,) or (N, count), of a text file."""
    rows = np.flatnonzero((lines.starts < lines.ends) & (lines.char(0) != ord("#")))
    width = sum(one.count for one in head.fields)
    if len(rows) < head.points:
        damage.end(f"{head.points} lines of points, as its head says", str(len(rows)))
    elif len(rows) > head.points:
        damage.line(lines, int(rows[head.points]), "no line behind those that its head says")
    rows = rows[: head.points]
    what = f"a point ({', '.join(one.name for one in head.fields)})"
    values, counts = number_rows(lines, rows, 0, width, what, damage)
    for row in np.flatnonzero(counts > width).tolist():
        damage.line(lines, int(rows[row]), f"{width} numbers of {what}")
    good = counts == width
    begins = (np.cumsum(counts) - counts)[good]
    table = values[begins[:, np.newaxis] + np.arange(width)]
    columns, at = {}, 0
    for one in head.fields:
        with np.errstate(invalid="ignore", over="ignore"):
            part = table[:, at : at + one.count]
            # Whole numbers of 32 bits that stand for a packed colour are no floats.
            is_bits = one.name in _COLORS and bool((part >= 1.0).any())
            columns[one.name] = _squeeze(part.astype("<u4" if is_bits else one.kind), one.count)
        at += one.count
    return columns


def _binary_columns(data: bytes, head: _Head, damage: Damage) -> dict[str, NDArray[Any]]:
    """Return the values of each field, (N,) or (N, count), of a binary file."""
    kind = np.dtype([(f"v{n}", one.kind, (one.count,)) for n, one in enumerate(head.fields)])
    max_points = (len(data) - head.at) // kind.itemsize
    if max_points < head.points:
        damage.end(f"{head.points} points, as its head says", f"room for {max_points}")
    rows = np.frombuffer(data, kind, min(max_points, head.points), head.at)
    return {one.name: _squeeze(rows[f"v{n}"], one.count) for n, one in enumerate(head.fields)}


def _packed_columns(data: bytes, head: _Head) -> dict[str, NDArray[Any]]:
    """Return the values of each field, (N,) or (N, count), of a compressed file."""
    if len(data) < head.at + 8:
        raise ValueError("it is cut short before its points")
    packed, size = struct.unpack_from("<II", data, head.at)
    expected = head.points * sum(one.kind.itemsize * one.count for one in head.fields)
    if size != expected:
        raise ValueError(f"its points must take {expected} bytes, as its head says, got {size}")
    content = data[head.at + 8 : head.at + 8 + packed]
    if len(content) < packed:
        raise ValueError(f"it must have {packed} compressed bytes, got {len(content)}")
    unpacked, at, columns = unpack_lzf(content, size), 0, {}
    for one in head.fields:
        values = np.frombuffer(unpacked, one.kind, head.points * one.count, at)
        columns[one.name] = _squeeze(values.reshape(-1, one.count), one.count)
        at += values.nbytes
    return columns


def _squeeze(values: NDArray[Any], count: int) -> NDArray[Any]:
    """Return columns of one value as (N,)."""
    return values[:, 0] if count == 1 else values


def _cloud(path: Path, columns: dict[str, NDArray[Any]], left_out: LeftOut) -> Cloud:
    """Return the cloud of the columns by the meaning of their names."""
    if any(name not in columns or columns[name].ndim != 1 for name in _POSITION):
        raise MeshFileError(
            f"{path} must have the fields x, y and z, got {', '.join(columns)[:80]}"
        )
    colors, normals = None, None
    for name in _COLORS:
        if name in columns and columns[name].ndim == 1 and columns[name].dtype.itemsize == 4:
            colors = _packed_colors(columns[name], name == "rgba")
        elif name in columns:
            left_out.note(f"field {name!r} that holds no packed colours")
    if all(name in columns and columns[name].ndim == 1 for name in _NORMAL):
        normals = np.column_stack([columns[name] for name in _NORMAL])
    used = {*_POSITION, *(_NORMAL if normals is not None else ()), *_COLORS, _PADDING_FIELD}
    return Cloud(
        path.name, np.column_stack([columns[name] for name in _POSITION]).astype(np.float64),
        colors, normals, {name: values for name, values in columns.items() if name not in used},
    )  # fmt: skip


def _packed_colors(column: NDArray[Any], has_alpha: bool) -> NDArray[np.float32]:
    """Return packed colours as linear RGBA."""
    codes = np.ascontiguousarray(column).view("<u1").reshape(-1, 4)
    # Blue, green, red and alpha; many programs leave the byte of alpha empty.
    return srgb_rgba(codes[:, [2, 1, 0, 3] if has_alpha and codes[:, 3].any() else [2, 1, 0]])
