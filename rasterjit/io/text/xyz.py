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
from rasterjit.io.text.mesh_builder import srgb_rgba
from rasterjit.io.text.number_parser import ROW_BYTES, Damage, TextLines, number_rows, parse_float

ROW_FORMATS = ("xyz", "xyzn", "xyzrgb", "pts", "asc", "txt", "csv")

_SEPARATORS = bytes.maketrans(b",;\t", b"   ")
_DECIMAL_COMMAS = bytes.maketrans(b",;\t", b".  ")

_NAMES = {
    "x": ("x", "px", "pos_x", "position_x", "easting"),
    "y": ("y", "py", "pos_y", "position_y", "northing"),
    "z": ("z", "pz", "pos_z", "position_z", "elevation", "height"),
    "r": ("r", "red", "diffuse_red"), "g": ("g", "green", "diffuse_green"),
    "b": ("b", "blue", "diffuse_blue"), "a": ("a", "alpha"),
    "nx": ("nx", "normal_x", "n_x"), "ny": ("ny", "normal_y", "n_y"),
    "nz": ("nz", "normal_z", "n_z"), INTENSITY: (INTENSITY, "i", "scalar_intensity"),
}  # fmt: skip
_COLUMN_MEANINGS = {name: meant for meant, names in _NAMES.items() for name in names}
"""Meaning of a column, by its name."""

_MAX_COLUMNS = 1 << 12

_NORMAL_TOLERANCE = 0.02
"""Largest difference of the length of normals from 1."""


def read_rows(path: Path, resources: Resources, damage: Damage, left_out: LeftOut) -> list[Cloud]:
    """Return the cloud of a file of `ROW_FORMATS`, or raise `MeshFileError`."""
    original = resources.read_mesh_file(path)
    decimal = _has_decimal_commas(original)
    data = original.translate(_DECIMAL_COMMAS if decimal else _SEPARATORS)
    lines = TextLines(data, resources.budget, 0, original)
    marks = lines.char(0)
    rows = np.flatnonzero(
        (lines.starts < lines.ends)
        & (marks != ord("#")) & (marks != ord("/")) & (marks != ord("\r"))
    )  # fmt: skip
    names, rows, declared_count = _read_head(path, lines, rows)
    if not len(rows):
        raise MeshFileError(f"{path} holds a point cloud of no points")
    width = len(names) if names else len(lines.text(int(rows[0])).split())
    if not 3 <= width <= _MAX_COLUMNS:
        raise MeshFileError(
            f"{path} must have rows of 3 numbers or more, x y z ..., got "
            f"{lines.quote(int(rows[0]))} at {lines.line_label(int(rows[0]))}"
        )
    resources.budget.take(f"its {len(rows)} rows", len(rows) * (ROW_BYTES + 8 * width))
    values, counts = number_rows(lines, rows, 0, width, "a point", damage)
    for row in np.flatnonzero(counts > width).tolist():
        damage.line(lines, int(rows[row]), f"{width} numbers of a point")
    is_whole = counts == width
    if declared_count is not None and declared_count != len(rows):
        damage.end(f"{declared_count} points, as its first line says", str(len(rows)))
    if not is_whole.any():
        raise MeshFileError(f"{path} holds a point cloud of no points")
    begins = (np.cumsum(counts) - counts)[is_whole]
    table = values[begins[:, np.newaxis] + np.arange(width)]
    return [_cloud(path, table, names or _guess_columns(table, path.suffix.lower()), left_out)]


def _has_decimal_commas(data: bytes) -> bool:
    """Tell whether numbers have decimal commas, with semicolons between them."""
    begin = data[: 1 << 16]
    rows = [line for line in begin.splitlines() if line[:1].isdigit() or line[:1] in b"+-."]
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
    rest = list(range(3, width))
    names = ["x", "y", "z", *(f"column {number + 1}" for number in rest)]

    def name(at: int, *new_names: str) -> None:
        names[at : at + len(new_names)] = new_names

    if width == 4:
        name(3, INTENSITY)
    elif width in (6, 9):
        for at in range(3, width, 3):
            three = table[:, at : at + 3]
            if suffix != ".xyzrgb" and (suffix == ".xyzn" or _are_normals(three)):
                name(at, "nx", "ny", "nz")
            elif _are_colors(three) and "r" not in names:
                name(at, "r", "g", "b")
    elif width in (7, 10):
        # Files of scanners have the intensity first, those of others behind the colours.
        if _are_colors(table[:, 4:7]):
            name(3, INTENSITY, "r", "g", "b")
        elif _are_colors(table[:, 3:6]):
            name(3, "r", "g", "b", INTENSITY)
        elif _are_normals(table[:, 3:6]):
            name(3, "nx", "ny", "nz", INTENSITY)
        if width == 10 and _are_normals(table[:, 7:10]):
            name(7, "nx", "ny", "nz")
    return names


def _are_normals(three: NDArray[np.float64]) -> bool:
    """Tell whether vectors are of unit length, or zero."""
    x, y, z = three.T
    with np.errstate(over="ignore"):
        squared = x * x + y * y + z * z
    nonzero = np.isfinite(squared) & (squared != 0.0)
    return bool(nonzero.any() and (np.abs(squared[nonzero] - 1.0) <= 2.0 * _NORMAL_TOLERANCE).all())


def _are_colors(three: NDArray[np.float64]) -> bool:
    """Tell whether values are bytes, or in 0..1."""
    minimum, limit = three.min(initial=np.inf), three.max(initial=-np.inf)
    is_whole = bool((three == np.floor(three)).all())
    return bool(minimum >= 0.0 and (limit <= 1.0 or (is_whole and limit <= 255.0)))


def _cloud(path: Path, table: NDArray[np.float64], names: list[str], left_out: LeftOut) -> Cloud:
    """Return the cloud of the columns by the meaning of their names."""
    columns: dict[str, NDArray[Any]] = {}
    for number, name in enumerate(names):
        if name in columns:
            left_out.note(f"second column {name[:40]!r}")
        else:
            columns[name] = table[:, number]
    colors, normals = None, None
    if {"r", "g", "b"} <= columns.keys():
        three = np.column_stack([columns.pop(name) for name in "rgb"])
        alpha = columns.pop("a", None)
        if alpha is not None:
            three = np.column_stack([three, alpha])
        colors = _colors(three)
    if {"nx", "ny", "nz"} <= columns.keys():
        normals = np.column_stack([columns.pop(name) for name in ("nx", "ny", "nz")])
    positions = np.column_stack([columns.pop(name) for name in "xyz"])
    return Cloud(path.name, positions, colors, normals, columns)


def _colors(codes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return sRGB colours, of 8 or 16 bits or in 0..1, as linear RGBA."""
    finite = np.where(np.isfinite(codes), codes, 0.0)
    limit = finite.max(initial=0.0)
    if limit > 255.0:
        finite = finite / 65535.0
    elif limit > 1.0:
        finite = finite / 255.0
    return srgb_rgba(finite)
