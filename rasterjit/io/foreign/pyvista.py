"""
Objects of PyVista: surfaces, lines, points, grids and blocks of them.

Grids are shown by their surface, which VTK extracts. Active scalars are shown by a colour map, as
PyVista shows them; colours in bytes as they are.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.drawings import LineDrawing
from rasterjit.io.foreign.tables import (
    check_corners,
    check_count,
    is_colors,
    is_scalar,
    kept_by_name,
    own_normals,
    padded_cells,
    rgba_of,
    rows_of,
)
from rasterjit.io.point_clouds.cloud import Cloud
from rasterjit.io.resources import LONGEST_NAME
from rasterjit.io.skipped import LONGEST_REASON, LeftOut, MeshFileError
from rasterjit.io.text.parts import Part, Thing, strip_triangles, triangles
from rasterjit.scene.lines import strip_segments

_INTERNAL = "vtk"
"""What names of values begin with that VTK keeps for itself."""


_LAST_OF_ONE_SIZE = 37
"""The last type of cells, by VTK's numbers, of which each has as many points as all others."""

_ADDRESS = re.compile(r" ?\(0x[0-9a-fA-F]+\)")
"""What VTK writes behind the name of an object."""

_FOLLOWS = "returned failure for request"
"""In what VTK says once more after another error."""


@contextmanager
def noting_what_vtk_says(left_out: LeftOut) -> Iterator[None]:
    """Note the errors and warnings of VTK, which goes on with what it has, in place of printing."""
    import pyvista

    catcher = pyvista.VtkErrorCatcher(send_to_logging=False)
    with warnings.catch_warnings(), pyvista.vtk_verbosity("off"), catcher:
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            for event in catcher.events:
                line = _ADDRESS.sub("", event.alert.strip().partition("\n")[0])[:LONGEST_REASON]
                if _FOLLOWS not in line:
                    left_out.note(f"what VTK says: {line}")


def things_of_pyvista(what: Any, source: str, left_out: LeftOut) -> list[Thing]:
    """Return what a data set of PyVista's, or blocks of them, hold, or raise `MeshFileError`."""
    things = _things(what, "", source, left_out)
    if not things:
        raise MeshFileError(f"{source} holds no faces, lines or points")
    return things


def _things(what: Any, name: str, source: str, left_out: LeftOut) -> list[Thing]:
    """Return what a data set holds, or all blocks of one."""
    for key in getattr(what, "field_data", {}).keys():  # noqa: SIM118 - it is no mapping
        left_out.note(f"field data {str(key)[:LONGEST_NAME]!r}")
    if hasattr(what, "keys") and not hasattr(what, "points"):
        found: list[Thing] = []
        for key in what.keys():  # noqa: SIM118 - it is no mapping
            block = what[key]
            if block is not None:
                found += _things(block, str(key), source, left_out)
        return found
    if not hasattr(what, "faces") and what.n_cells:
        _check_cells(what, source, left_out)
        with noting_what_vtk_says(left_out):
            what = what.extract_surface(pass_pointid=False, pass_cellid=False)
    return _of_surface(what, name, source, left_out) if what.n_points else []


def _check_cells(what: Any, source: str, left_out: LeftOut) -> None:
    """Raise `MeshFileError` if cells do not have the points of their type: VTK reads on behind."""
    if not hasattr(what, "celltypes"):
        return
    from vtkmodules.vtkCommonDataModel import vtkGenericCell

    check_corners(np.asarray(what.cell_connectivity), what.n_points, source)
    types, counts = np.asarray(what.celltypes), np.diff(what.offset)
    for number in np.unique(types).tolist():
        cell, of_type = vtkGenericCell.InstantiateCell(number), types == number
        if cell is None:
            left_out.note(f"cell of type {number}", int(np.count_nonzero(of_type)))
        elif number <= _LAST_OF_ONE_SIZE and cell.GetNumberOfPoints():
            name = cell.GetClassName().removeprefix("vtk")
            check_count(name, counts[of_type], cell.GetNumberOfPoints(), source)


@dataclass
class _Values:
    """Values of points or cells: what shows them, and all but colours by name."""

    colors: NDArray[np.float32] | None
    scalars: NDArray[Any] | None
    others: dict[str, NDArray[Any]]


def _values(data: Any, active: str | None, known: set[str]) -> _Values:
    """Sort the values of points or cells."""
    found = _Values(None, None, {})
    for name in data.keys():  # noqa: SIM118 - it is no mapping
        values = np.asarray(data[name])
        if name == active and is_colors(values):
            found.colors = rgba_of(values)
        elif name == active and is_scalar(values):
            found.scalars = found.others[name] = values.reshape(-1)
        elif name not in known and not name.startswith(_INTERNAL):
            found.others[name] = values
    found.others = kept_by_name(found.others, active)
    return found


def _of_surface(what: Any, name: str, source: str, left_out: LeftOut) -> list[Thing]:
    """Return the faces, lines and points of a ``PolyData``, or a ``PointSet``."""
    points = np.asarray(what.points)
    active, is_of_cells = what.active_scalars_name, False
    if active is not None:
        is_of_cells = active not in what.point_data or (
            int(getattr(what.active_scalars_info.association, "value", 0)) == 1
        )
    known = set()
    for kind in ("normals", "texture_coordinates"):
        said = getattr(what.point_data, f"active_{kind}_name", None)
        known |= {said} if said is not None else set()
    of_points = _values(what.point_data, None if is_of_cells else active, known)
    of_cells = _values(what.cell_data, active if is_of_cells else None, {"Normals"})
    cells = {
        kind: padded_cells(getattr(what, kind, ()))
        for kind in ("verts", "lines", "faces", "strips")
    }
    begins, first = {}, 0
    for kind, (corners, counts) in cells.items():
        check_corners(corners, len(points), source)
        begins[kind] = first
        first += len(counts)
    found: list[Thing] = []
    faces, numbers = _faces(cells, begins, left_out)
    if len(faces):
        found.append(_part(what, name, points, faces, numbers, of_points, of_cells))
    corners, counts = cells["lines"]
    if len(counts):
        segments, lines = strip_segments(corners, counts)
        found.append(_drawing(name, points, segments, lines + begins["lines"], of_points, of_cells))
    corners, counts = cells["verts"]
    if len(counts) or not found:
        rows = corners if len(counts) and len(corners) != len(points) else None
        cells_of_points = np.repeat(np.arange(len(counts)), counts)
        found.append(_cloud(what, name, points, rows, cells_of_points, of_points, of_cells))
    return found


def _faces(
    cells: dict[str, tuple[NDArray[np.int64], NDArray[np.int64]]],
    begins: dict[str, int],
    left_out: LeftOut,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the triangles of polygons and strips, and the numbers of their cells."""
    corners, counts = cells["faces"]
    kept = counts >= 3
    left_out.note("polygon of fewer than 3 corners", int(np.count_nonzero(~kept)))
    corners = corners[np.repeat(kept, counts)]
    numbers = np.flatnonzero(kept) + begins["faces"]
    faces, polygons = np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    if len(numbers):
        places, polygons = triangles(counts[kept], by_size=False)
        faces, polygons = corners[places], numbers[polygons]
    corners, counts = cells["strips"]
    places, strips = strip_triangles(counts)
    faces = np.concatenate([faces, corners[places]])
    return faces, np.concatenate([polygons, strips + begins["strips"]])


def _part(
    what: Any, name: str, points: NDArray[Any], faces: NDArray[np.int64],
    numbers: NDArray[np.int64], of_points: _Values, of_cells: _Values,
) -> Part:  # fmt: skip
    """Return the faces of a surface."""
    normals = own_normals(points, faces, _rows(what, "active_normals", 3))
    uv = _rows(what, "active_texture_coordinates", 2)
    colors, scalars = of_points.colors, of_points.scalars
    if of_cells.colors is not None:
        colors = of_cells.colors[numbers]
    return Part(
        name, points, faces, normals, uv, colors, None, of_points.others,
        rows_of(of_cells.others, numbers), scalars,
        None if of_cells.scalars is None else of_cells.scalars[numbers],
    )  # fmt: skip


def _drawing(
    name: str, points: NDArray[Any], segments: NDArray[np.int64], lines: NDArray[np.int64],
    of_points: _Values, of_cells: _Values,
) -> LineDrawing:  # fmt: skip
    """Return the lines of a surface."""
    colors = of_points.colors if of_cells.colors is None else of_cells.colors[lines]
    return LineDrawing(
        name, points, segments, colors, of_cells.colors is not None, of_points.others,
        rows_of(of_cells.others, lines), None, of_points.scalars,
        None if of_cells.scalars is None else of_cells.scalars[lines],
    )  # fmt: skip


def _cloud(
    what: Any, name: str, points: NDArray[Any], rows: NDArray[np.int64] | None,
    cells: NDArray[np.int64], of_points: _Values, of_cells: _Values,
) -> Cloud:  # fmt: skip
    """Return the points of a surface, all or some, with what their cells have, if they have any."""
    normals = _rows(what, "active_normals", 3)

    def picked(values: NDArray[Any] | None, of_cell: NDArray[Any] | None) -> NDArray[Any] | None:
        """Return values of the points that are shown."""
        if values is None:
            return None if of_cell is None or not len(cells) else of_cell[cells]
        return values if rows is None else values[rows]

    positions = picked(points, None)
    assert positions is not None
    return Cloud(
        name, positions, picked(of_points.colors, of_cells.colors), picked(normals, None),
        rows_of(of_points.others, rows), None, picked(of_points.scalars, of_cells.scalars),
    )  # fmt: skip


def _rows(what: Any, name: str, width: int) -> NDArray[Any] | None:
    """Return rows of numbers for the points that fit them, or None."""
    values = getattr(what, name, None)
    if values is None or np.shape(values) != (what.n_points, width):
        return None
    array = np.asarray(values)
    return array if np.isfinite(array).all() else None
