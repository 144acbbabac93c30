"""
Read points as rows of numbers: XYZ, PTS, ASC, TXT and CSV files.

Rows are separated by blanks, commas or semicolons. A line of words above them names the columns;
without one their number and their values tell what they are.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError
from rasterjit.io.primitives import INTENSITY, Cloud
from rasterjit.io.resources import Resources
from rasterjit.io.text.mesh_builder import srgb_to_rgba
from rasterjit.io.text.number_parser import (
    MEMORY_PER_ROW,
    Damage,
    TextLines,
    parse_equal_rows,
    parse_float,
)

XYZ_FORMATS = ("xyz", "xyzn", "xyzrgb", "pts", "asc", "txt", "csv")

_COMMAS_TO_BLANKS = bytes.maketrans(b",;\t", b"   ")
_DECIMAL_COMMAS_TO_POINTS = bytes.maketrans(b",;\t", b".  ")

_NAMES_BY_MEANING = {
    "x": ("x", "px", "pos_x", "position_x", "easting"),
    "y": ("y", "py", "pos_y", "position_y", "northing"),
    "z": ("z", "pz", "pos_z", "position_z", "elevation", "height"),
    "r": ("r", "red", "diffuse_red"), "g": ("g", "green", "diffuse_green"),
    "b": ("b", "blue", "diffuse_blue"), "a": ("a", "alpha"),
    "nx": ("nx", "normal_x", "n_x"), "ny": ("ny", "normal_y", "n_y"),
    "nz": ("nz", "normal_z", "n_z"), INTENSITY: (INTENSITY, "i", "scalar_intensity"),
}  # fmt: skip
_COLUMN_MEANINGS = {name: meant for meant, names in _NAMES_BY_MEANING.items() for name in names}
"""Meaning of a column, by its name."""

_MAX_COLUMNS = 1 << 12

_NORMAL_TOLERANCE = 0.02
"""Largest difference of the length of normals from 1."""


def read_xyz(path: Path, resources: Resources, damage: Damage, left_out: LeftOut) -> list[Cloud]:
    """Return the cloud of a file of `XYZ_FORMATS`, or raise `MeshFileError`."""
    original = resources.read_mesh_file(path)
    is_decimal_comma = _has_decimal_commas(original)
    data = original.translate(_DECIMAL_COMMAS_TO_POINTS if is_decimal_comma else _COMMAS_TO_BLANKS)
    lines = TextLines(data, resources.budget, 0, original)
    is_comment = np.isin(lines.byte_at(0), np.frombuffer(b"#/\r", np.uint8))
    rows = np.flatnonzero((lines.starts < lines.ends) & ~is_comment)
    names, rows, declared_count = _read_head(path, lines, rows)
    if not len(rows):
        raise MeshFileError(f"{path} holds a point cloud of no points")
    width = len(names) if names else len(lines.text(int(rows[0])).split())
    if not 3 <= width <= _MAX_COLUMNS:
        raise MeshFileError(
            f"{path} must have rows of 3 numbers or more, x y z ..., got "
            f"{lines.quote(int(rows[0]))} at {lines.line_label(int(rows[0]))}"
        )
    resources.budget.take(f"its {len(rows)} rows", len(rows) * (MEMORY_PER_ROW + 8 * width))
    table = parse_equal_rows(lines, rows, width, "a point", damage)
    if declared_count is not None and declared_count != len(rows):
        damage.report_end(f"{declared_count} points, as its first line says", str(len(rows)))
    if not len(table):
        raise MeshFileError(f"{path} holds a point cloud of no points")
    names = names or _guess_columns(table, path.suffix.lower())
    return [_make_cloud(path, table, names, left_out)]


def _has_decimal_commas(data: bytes) -> bool:
    """Tell whether numbers have decimal commas, with semicolons between them."""
    head = data[: 1 << 16]
    rows = [line for line in head.splitlines() if line[:1].isdigit() or line[:1] in b"+-."]
    return bool(rows) and all(b";" in row and b"," in row and b"." not in row for row in rows[:9])


def _read_head(
    path: Path, lines: TextLines, rows: NDArray[np.int64]
) -> tuple[list[str], NDArray[np.int64], int | None]:
    """Return the column names if a line has them, the rows below, and their number if declared."""
    if not len(rows):
        return [], rows, None
    first = lines.text(int(rows[0])).split()
    if first[:1] == ["ncols"]:
        raise MeshFileError(f"{path} holds a grid of heights, no points")
    if len(first) == 1 and first[0].isdecimal() and len(first[0]) < 16:
        after = lines.text(int(rows[1])).split() if len(rows) > 1 else []
        if len(after) < 3 or parse_float(after[0]) is None:
            raise MeshFileError(f"{path} must have rows of points below the number of them")
        return [], rows[1:], int(first[0])
    if first and parse_float(first[0].strip('"')) is None:
        names = [word.strip('"').lstrip("/#").lower() for word in first]
        columns = [_COLUMN_MEANINGS.get(name, name) for name in names]
        if not {"x", "y", "z"} <= set(columns):
            raise MeshFileError(
                f"{path} must begin with a row of numbers, or of names with x, y and z among "
                f"them, got {lines.quote(int(rows[0]))}"
            )
        return columns, rows[1:], None
    return [], rows, None


def _guess_columns(table: NDArray[np.float64], suffix: str) -> list[str]:
    """Guess the meaning of columns without names."""
    width = table.shape[1]
    names = ["x", "y", "z", *(f"column {number + 1}" for number in range(3, width))]

    def set_names(at: int, *new_names: str) -> None:
        names[at : at + len(new_names)] = new_names

    if width == 4:
        set_names(3, INTENSITY)
    elif width in (6, 9):
        for at in range(3, width, 3):
            three = table[:, at : at + 3]
            if suffix != ".xyzrgb" and (suffix == ".xyzn" or _are_unit_vectors(three)):
                set_names(at, "nx", "ny", "nz")
            elif _are_colors(three) and "r" not in names:
                set_names(at, "r", "g", "b")
    elif width in (7, 10):
        # Files of scanners have the intensity first, those of others behind the colours.
        if _are_colors(table[:, 4:7]):
            set_names(3, INTENSITY, "r", "g", "b")
        elif _are_colors(table[:, 3:6]):
            set_names(3, "r", "g", "b", INTENSITY)
        elif _are_unit_vectors(table[:, 3:6]):
            set_names(3, "nx", "ny", "nz", INTENSITY)
        if width == 10 and _are_unit_vectors(table[:, 7:10]):
            set_names(7, "nx", "ny", "nz")
    return names


def _are_unit_vectors(values: NDArray[np.float64]) -> bool:
    """Tell whether vectors are of unit length, or zero."""
    x, y, z = values.T
    with np.errstate(over="ignore"):
        squared = x * x + y * y + z * z
    nonzero = np.isfinite(squared) & (squared != 0.0)
    return bool(nonzero.any() and (np.abs(squared[nonzero] - 1.0) <= 2.0 * _NORMAL_TOLERANCE).all())


def _are_colors(values: NDArray[np.float64]) -> bool:
    """Tell whether values are bytes, or in 0..1."""
    minimum, maximum = values.min(initial=np.inf), values.max(initial=-np.inf)
    is_whole = bool((values == np.floor(values)).all())
    return bool(minimum >= 0.0 and (maximum <= 1.0 or (is_whole and maximum <= 255.0)))


def _make_cloud(
    path: Path, table: NDArray[np.float64], names: list[str], left_out: LeftOut
) -> Cloud:
    """Return a cloud whose columns are used by the meaning of their names."""
    columns: dict[str, NDArray[Any]] = {}
    for number, name in enumerate(names):
        if name in columns:
            left_out.note(f"second column {name[:40]!r}")
        else:
            columns[name] = table[:, number]
    colors, normals = None, None
    if {"r", "g", "b"} <= columns.keys():
        channels = "rgba" if "a" in columns else "rgb"
        colors = _decode_colors(np.column_stack([columns.pop(name) for name in channels]))
    if {"nx", "ny", "nz"} <= columns.keys():
        normals = np.column_stack([columns.pop(name) for name in ("nx", "ny", "nz")])
    positions = np.column_stack([columns.pop(name) for name in "xyz"])
    return Cloud(path.name, positions, colors, normals, columns)


def _decode_colors(codes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return sRGB colours, of 8 or 16 bits or in 0..1, as linear RGBA."""
    finite = np.where(np.isfinite(codes), codes, 0.0)
    maximum = finite.max(initial=0.0)
    if maximum > 255.0:
        finite = finite / 65535.0
    elif maximum > 1.0:
        finite = finite / 255.0
    return srgb_to_rgba(finite)
