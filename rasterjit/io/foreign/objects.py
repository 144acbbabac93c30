"""Convert objects of meshio, PyVista and Open3D, without importing these packages."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import MAX_REASON_LENGTH, LeftOut, MeshFileError
from rasterjit.io.primitives import Cloud, Context, LineSet
from rasterjit.io.resources import MAX_NAME_LENGTH
from rasterjit.io.text import mesh_builder
from rasterjit.io.text.mesh_builder import Geometry, MeshData
from rasterjit.scene.distinct_rows import distinct_rows
from rasterjit.scene.lines import split_into_segments
from rasterjit.scene.mesh import OnInvalid
from rasterjit.scene.normals import is_creased, safe_scale
from rasterjit.scene.scene import Scene

EMPTY_NUMBERS = np.zeros(0, np.int64)


def split_cells(padded: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Split VTK's padded cells: for each its number of corners, then the corners.

    Returns
    -------
    corners : (N,) int64
    counts : (C,) int64
        Number of corners of each cell.
    """
    cells = np.asarray(padded, np.int64).reshape(-1)
    if not len(cells):
        return EMPTY_NUMBERS, EMPTY_NUMBERS
    width = int(cells[0]) + 1
    if len(cells) % width == 0 and (cells[::width] == cells[0]).all():
        rows = cells.reshape(-1, width)
        return rows[:, 1:].reshape(-1), rows[:, 0].copy()
    begins, at = [], 0
    while at < len(cells):
        begins.append(at)
        at += int(cells[at]) + 1
    inner = np.ones(len(cells), bool)
    inner[begins] = False
    return cells[inner], cells[begins]


def check_corners(corners: NDArray[Any], count: int, source: str) -> None:
    """Raise `MeshFileError` if cells refer to points that are not there."""
    if len(corners) and not 0 <= corners.min() <= corners.max() < count:
        wrong = corners[(corners < 0) | (corners >= count)]
        raise MeshFileError(
            f"{source} must have cells of points from 0 to {count - 1}, got {int(wrong[0])}"
        )


def check_count(cell_type: str, counts: NDArray[Any], expected: int, source: str) -> None:
    """Raise `MeshFileError` if cells of a kind have another number of points than expected."""
    wrong = counts[counts != expected]
    if len(wrong):
        raise MeshFileError(
            f"{source} must have {expected} points in each {cell_type} cell, got {int(wrong[0])}"
        )


def are_byte_colors(values: NDArray[Any]) -> bool:
    """Tell whether values are colours in bytes."""
    return values.dtype == np.uint8 and values.ndim == 2 and values.shape[1] in (3, 4)


def is_scalar(values: NDArray[Any]) -> bool:
    """Tell whether values are one number for each row."""
    single = values.ndim == 1 or (values.ndim == 2 and values.shape[1] == 1)
    return single and values.dtype.kind in "buif"


def get_usable_normals(
    points: NDArray[Any], faces: NDArray[np.int64], normals: NDArray[Any] | None
) -> NDArray[Any] | None:
    """Return normals; None if some are missing, or they smooth over sharp edges."""
    if normals is None or not len(faces) or not np.isfinite(normals).all():
        return None
    if not normals.any(axis=1).all() or not np.isfinite(points).all():
        return None
    positions = np.asarray(points, np.float64)
    scale = safe_scale(positions.min(axis=0), positions.max(axis=0))
    return None if is_creased(positions, faces.astype(np.int32), scale) else normals


def take_rows(
    values: Mapping[str, NDArray[Any]], rows: NDArray[np.int64] | None
) -> dict[str, NDArray[Any]]:
    """Return some rows, or all, of named arrays."""
    return {name: one if rows is None else one[rows] for name, one in values.items()}


def drop_nonfinite_shown(
    values: dict[str, NDArray[Any]], shown: str | None
) -> dict[str, NDArray[Any]]:
    """Return named arrays, without the one whose name is ``shown`` if it is not finite."""
    return {
        name: one for name, one in values.items() if name != shown or bool(np.isfinite(one).all())
    }


_FACE_CELLS = {
    "triangle": 3, "triangle6": 3, "triangle7": 3, "triangle10": 3,
    "quad": 4, "quad8": 4, "quad9": 4, "quad16": 4,
}  # fmt: skip
"""Types of cells that are faces, and their numbers of corners."""

_HEXAHEDRON = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))
_SOLID_FACES = {
    "tetra": ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)),
    "hexahedron": _HEXAHEDRON,
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}
"""Corners of the faces of solid cells, counter-clockwise from outside, as VTK numbers them."""

_LINE_CELLS = {"line": (0, 1), "line3": (0, 2, 1), "line4": (0, 2, 3, 1)}
"""Types of cells that are lines, and the order of points along them."""

_CELL_POINTS = {
    "vertex": 1, "line": 2, "triangle": 3, "quad": 4, "tetra": 4, "pyramid": 5, "wedge": 6,
    "hexahedron": 8,
}  # fmt: skip
"""Number of points of a cell type, unless a suffix gives it (triangle6)."""

_UNREAD_FIELDS = ("point_sets", "cell_sets", "field_data", "gmsh_periodic")
"""Fields of a ``meshio.Mesh`` that are not read."""

_READER_TAG = ":"
"""Part of the names that meshio's readers make up, such as ``gmsh:physical``."""


def convert_meshio(what: Any, source: str, left_out: LeftOut) -> list[Geometry]:
    """Return the faces, lines and points of a ``meshio.Mesh``, or raise `MeshFileError`."""
    # Points in space; blocks of cells of one kind.
    points = np.asarray(what.points)
    if points.ndim == 2 and points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    if not len(points):
        raise MeshFileError(f"{source} holds no points")
    blocks = [(str(block.type), np.asarray(block.data)) for block in what.cells]
    begins = np.cumsum([0, *(len(data) for _, data in blocks)]).tolist()
    # Values of points and of cells.
    point_arrays = {str(name): np.asarray(values) for name, values in what.point_data.items()}
    cell_arrays = {
        str(name): _concatenate_blocks([np.asarray(one) for one in values])
        for name, values in what.cell_data.items()
    }
    count = sum(len(data) for _, data in blocks)
    for name in [name for name, values in cell_arrays.items() if len(values) != count]:
        left_out.note(f"values {name[:MAX_NAME_LENGTH]!r} that do not fit all cells")
        del cell_arrays[name]
    for kind in _UNREAD_FIELDS:
        left_out.note(kind.replace("_", " "), len(getattr(what, kind, None) or ()))
    # Cells by what is drawn of them.
    polygons, segments, vertex_cells = _CellRows(), _CellRows(), _CellRows()
    solids = _CellRows()
    for (kind, data), begin in zip(blocks, begins, strict=False):
        cell_numbers = np.arange(begin, begin + len(data))
        stem = kind.rstrip("0123456789")
        if stem in _CELL_POINTS:
            expected = int(kind.removeprefix(stem) or _CELL_POINTS[stem])
            check_count(kind, np.full(len(data), data.shape[-1]), expected, source)
        if kind in _FACE_CELLS or kind.startswith("polygon"):
            polygons.add(data[:, : _FACE_CELLS.get(kind, data.shape[1])], cell_numbers)
        elif stem in _SOLID_FACES and data.ndim == 2:
            for side in _SOLID_FACES[stem]:
                solids.add(data[:, side], cell_numbers)
        elif kind in _LINE_CELLS:
            order = _LINE_CELLS[kind]
            for first, last in pairwise(order):
                segments.add(data[:, [first, last]], cell_numbers)
        elif kind == "vertex":
            vertex_cells.add(data, cell_numbers)
        else:
            left_out.note(f"{kind} cell", len(data))
    # Of solids their outside.
    outer = solids.boundary()
    if outer.blocks:
        polygons, all_polygons = polygons.without(outer), polygons
        repeats = len(all_polygons.numbers()) - len(polygons.numbers())
        left_out.note("values of a face that is a side of a solid", repeats if cell_arrays else 0)
    polygons.add_all(outer)
    drawn_cells, is_solid = (polygons, segments, vertex_cells), bool(solids.blocks)
    return _make_geometries(points, point_arrays, cell_arrays, drawn_cells, is_solid, source)


class _CellRows:
    """Polygons in blocks of equal numbers of corners, with the numbers of their cells."""

    def __init__(self) -> None:
        self.blocks: list[tuple[NDArray[Any], NDArray[np.int64]]] = []

    def add(self, corners: NDArray[Any], numbers: NDArray[np.int64]) -> None:
        """Add polygons of one number of corners."""
        if len(corners):
            self.blocks.append((corners.astype(np.int64), numbers))

    def add_all(self, other: _CellRows) -> None:
        """Add all polygons of another one."""
        self.blocks += other.blocks

    def boundary(self) -> _CellRows:
        """Return the polygons that occur once: the boundary of solid cells."""
        which, _ = distinct_rows(*self._make_face_keys().T)
        return self._select(np.bincount(which)[which] == 1)

    def without(self, other: _CellRows) -> _CellRows:
        """Return the polygons that another one does not hold."""
        keys = self._make_face_keys()
        which, _ = distinct_rows(*np.concatenate([keys, other._make_face_keys()]).T)
        return self._select(~np.isin(which[: len(keys)], which[len(keys) :]))

    def _make_face_keys(self) -> NDArray[np.int64]:
        """Return the sorted corners of all polygons, (N, 4); larger polygons are unique."""
        keys = [np.zeros((0, 4), np.int64)]
        for corners, numbers in self.blocks:
            key = np.full((len(corners), 4), -1, np.int64)
            if corners.shape[1] <= 4:
                key[:, : corners.shape[1]] = np.sort(corners, axis=1)
            else:
                # Never equal to another polygon.
                key[:, 0] = -2 - numbers
            keys.append(key)
        return np.concatenate(keys)

    def _select(self, selected: NDArray[np.bool_]) -> _CellRows:
        """Return the polygons of a mask over all blocks."""
        result, at = _CellRows(), 0
        for corners, numbers in self.blocks:
            rows = selected[at : at + len(corners)]
            at += len(corners)
            result.add(corners[rows], numbers[rows])
        return result

    def corners(self) -> NDArray[np.int64]:
        """Return all corners, block by block."""
        return np.concatenate([EMPTY_NUMBERS, *(corners.reshape(-1) for corners, _ in self.blocks)])

    def numbers(self) -> NDArray[np.int64]:
        """Return the numbers of all cells, block by block."""
        return np.concatenate([EMPTY_NUMBERS, *(numbers for _, numbers in self.blocks)])


def _concatenate_blocks(blocks: list[NDArray[Any]]) -> NDArray[Any]:
    """Concatenate the values of all blocks of cells; empty if their shapes differ."""
    if not blocks or len({one.shape[1:] for one in blocks}) != 1:
        return np.zeros(0)
    return np.concatenate(blocks)


def _make_geometries(
    points: NDArray[Any], point_arrays: dict[str, NDArray[Any]],
    cell_arrays: dict[str, NDArray[Any]], drawn_cells: tuple[_CellRows, _CellRows, _CellRows],
    is_solid: bool, source: str,
) -> list[Geometry]:  # fmt: skip
    """Return the mesh, lines and points of cells; without cells, a cloud of all points."""
    polygons, segments, vertex_cells = drawn_cells
    point_scalar_name = _first_scalar(point_arrays, len(points))
    scalars = None if point_scalar_name is None else point_arrays[point_scalar_name].reshape(-1)
    cell_scalar_name = None if scalars is not None else _first_scalar(cell_arrays, None)
    cell_scalars = None if cell_scalar_name is None else cell_arrays[cell_scalar_name].reshape(-1)
    point_arrays = drop_nonfinite_shown(point_arrays, point_scalar_name)
    cell_arrays = {name: values for name, values in cell_arrays.items() if len(values)}
    finite_cell_arrays = drop_nonfinite_shown(cell_arrays, cell_scalar_name)
    geometries: list[Geometry] = []
    if polygons.blocks:
        counts = np.concatenate(
            [np.full(len(corners), corners.shape[1]) for corners, _ in polygons.blocks]
        )
        corners = polygons.corners()
        corner_rows, polygon_numbers = mesh_builder.triangulate(counts, by_size=False)
        check_corners(corners, len(points), source)
        cells, used = polygons.numbers()[polygon_numbers], None
        if is_solid:
            # Most points of a solid lie inside.
            used, corners = np.unique(corners, return_inverse=True)
            corners = corners.reshape(-1)
        geometries.append(
            MeshData(
                "", points if used is None else points[used], corners[corner_rows],
                attributes=take_rows(point_arrays, used),
                face_attributes=take_rows(finite_cell_arrays, cells),
                scalars=scalars if scalars is None or used is None else scalars[used],
                face_scalars=None if cell_scalars is None else cell_scalars[cells],
            )
        )  # fmt: skip
    if segments.blocks:
        corners, cells = np.concatenate([one for one, _ in segments.blocks]), segments.numbers()
        check_corners(corners, len(points), source)
        geometries.append(
            LineSet(
                "", points, corners, attributes=point_arrays,
                segment_attributes=take_rows(finite_cell_arrays, cells), scalars=scalars,
                segment_scalars=None if cell_scalars is None else cell_scalars[cells],
            )
        )  # fmt: skip
    shown = vertex_cells.corners()
    check_corners(shown, len(points), source)
    if geometries:
        # The others are corners of what is shown.
        shown = np.setdiff1d(shown, np.concatenate([polygons.corners(), segments.corners()]))
    elif not len(shown):
        shown = np.arange(len(points))
    if len(shown):
        geometries.append(
            Cloud("", points[shown], attributes=take_rows(point_arrays, shown),
                  scalars=None if scalars is None else scalars[shown])
        )  # fmt: skip
    return geometries


def _first_scalar(values: dict[str, NDArray[Any]], count: int | None) -> str | None:
    """Return the name of the first array that is one number for each row and varies, or None."""
    for name, one in values.items():
        if (
            _READER_TAG in name
            or not is_scalar(one)
            or not len(one)
            or len(one) != (count or len(one))
        ):
            continue
        if (one != one[0]).any():
            return name
    return None


_INTERNAL_PREFIX = "vtk"
"""Prefix of the names of VTK's internal arrays."""


_LAST_FIXED_SIZE_TYPE = 37
"""Last of VTK's cell types with a fixed number of points."""

_ADDRESS = re.compile(r" ?\(0x[0-9a-fA-F]+\)")
"""Address that VTK writes after the name of an object."""

_REPEATED_ERROR = "returned failure for request"
"""Part of a message of VTK that repeats an earlier error."""


@contextmanager
def note_vtk_messages(left_out: LeftOut) -> Iterator[None]:
    """Note the errors and warnings of VTK instead of printing them."""
    import pyvista

    catcher = pyvista.VtkErrorCatcher(send_to_logging=False)
    with warnings.catch_warnings(), pyvista.vtk_verbosity("off"), catcher:
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            for event in catcher.events:
                line = _ADDRESS.sub("", event.alert.strip().partition("\n")[0])[:MAX_REASON_LENGTH]
                if _REPEATED_ERROR not in line:
                    left_out.note(f"what VTK says: {line}")


def convert_pyvista(what: Any, source: str, left_out: LeftOut) -> list[Geometry]:
    """Return the geometries of a data set of PyVista or its blocks, or raise `MeshFileError`."""
    things = _convert_blocks(what, "", source, left_out)
    if not things:
        raise MeshFileError(f"{source} holds no faces, lines or points")
    return things


def _convert_blocks(what: Any, name: str, source: str, left_out: LeftOut) -> list[Geometry]:
    """Return the geometries of a data set, or of all blocks of one."""
    for key in getattr(what, "field_data", {}).keys():  # noqa: SIM118 - it is no mapping
        left_out.note(f"field data {str(key)[:MAX_NAME_LENGTH]!r}")
    if hasattr(what, "keys") and not hasattr(what, "points"):
        geometries: list[Geometry] = []
        for key in what.keys():  # noqa: SIM118 - it is no mapping
            block = what[key]
            if block is not None:
                geometries += _convert_blocks(block, str(key), source, left_out)
        return geometries
    if not hasattr(what, "faces") and what.n_cells:
        _check_cells(what, source, left_out)
        with note_vtk_messages(left_out):
            what = what.extract_surface(pass_pointid=False, pass_cellid=False)
    return _convert_surface(what, name, source, left_out) if what.n_points else []


def _check_cells(what: Any, source: str, left_out: LeftOut) -> None:
    """Raise `MeshFileError` if cells lack points: VTK reads out of bounds; note unknown types."""
    if not hasattr(what, "celltypes"):
        return
    from vtkmodules.vtkCommonDataModel import vtkGenericCell

    check_corners(np.asarray(what.cell_connectivity), what.n_points, source)
    types, counts = np.asarray(what.celltypes), np.diff(what.offset)
    for number in np.unique(types).tolist():
        cell, of_type = vtkGenericCell.InstantiateCell(number), types == number
        if cell is None:
            left_out.note(f"cell of type {number}", int(np.count_nonzero(of_type)))
        elif number <= _LAST_FIXED_SIZE_TYPE and cell.GetNumberOfPoints():
            name = cell.GetClassName().removeprefix("vtk")
            check_count(name, counts[of_type], cell.GetNumberOfPoints(), source)


@dataclass
class _DataArrays:
    """Arrays of points or cells: colours, active scalars, and all but colours by name."""

    colors: NDArray[np.float32] | None
    scalars: NDArray[Any] | None
    others: dict[str, NDArray[Any]]


def _read_arrays(data: Any, active: str | None, excluded: set[str]) -> _DataArrays:
    """Sort the arrays of points or cells by their use."""
    arrays = _DataArrays(None, None, {})
    for name in data.keys():  # noqa: SIM118 - it is no mapping
        values = np.asarray(data[name])
        if name == active and are_byte_colors(values):
            arrays.colors = mesh_builder.srgb_to_rgba(values)
        elif name == active and is_scalar(values):
            arrays.scalars = arrays.others[name] = values.reshape(-1)
        elif name not in excluded and not name.startswith(_INTERNAL_PREFIX):
            arrays.others[name] = values
    arrays.others = drop_nonfinite_shown(arrays.others, active)
    return arrays


def _convert_surface(what: Any, name: str, source: str, left_out: LeftOut) -> list[Geometry]:
    """Return the faces, lines and points of a ``PolyData``, or a ``PointSet``."""
    points = np.asarray(what.points)
    active, is_of_cells = what.active_scalars_name, False
    if active is not None:
        is_of_cells = active not in what.point_data or (
            int(getattr(what.active_scalars_info.association, "value", 0)) == 1
        )
    excluded = set()
    for kind in ("normals", "texture_coordinates"):
        array_name = getattr(what.point_data, f"active_{kind}_name", None)
        excluded |= {array_name} if array_name is not None else set()
    point_arrays = _read_arrays(what.point_data, None if is_of_cells else active, excluded)
    cell_arrays = _read_arrays(what.cell_data, active if is_of_cells else None, {"Normals"})
    cells = {
        kind: split_cells(getattr(what, kind, ())) for kind in ("verts", "lines", "faces", "strips")
    }
    begins, first = {}, 0
    for kind, (corners, counts) in cells.items():
        check_corners(corners, len(points), source)
        begins[kind] = first
        first += len(counts)
    geometries: list[Geometry] = []
    faces, cell_numbers = _triangulate_cells(cells, begins, left_out)
    if len(faces):
        geometries.append(
            _make_mesh(what, name, points, faces, cell_numbers, point_arrays, cell_arrays)
        )
    corners, counts = cells["lines"]
    if len(counts):
        segments, lines = split_into_segments(corners, counts)
        geometries.append(
            _make_lines(name, points, segments, lines + begins["lines"], point_arrays, cell_arrays)
        )
    corners, counts = cells["verts"]
    if len(counts) or not geometries:
        rows = corners if len(counts) and len(corners) != len(points) else None
        cells_of_points = np.repeat(np.arange(len(counts)), counts)
        geometries.append(
            _make_points(what, name, points, rows, cells_of_points, point_arrays, cell_arrays)
        )
    return geometries


def _triangulate_cells(
    cells: dict[str, tuple[NDArray[np.int64], NDArray[np.int64]]],
    begins: dict[str, int],
    left_out: LeftOut,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the triangles of polygons and strips, and the numbers of their cells."""
    corners, counts = cells["faces"]
    is_polygon = counts >= 3
    left_out.note("polygon of fewer than 3 corners", int(np.count_nonzero(~is_polygon)))
    corners = corners[np.repeat(is_polygon, counts)]
    cell_numbers = np.flatnonzero(is_polygon) + begins["faces"]
    faces, polygons = np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    if len(cell_numbers):
        corner_rows, polygons = mesh_builder.triangulate(counts[is_polygon], by_size=False)
        faces, polygons = corners[corner_rows], cell_numbers[polygons]
    corners, counts = cells["strips"]
    corner_rows, strips = mesh_builder.triangulate_strips(counts)
    faces = np.concatenate([faces, corners[corner_rows]])
    return faces, np.concatenate([polygons, strips + begins["strips"]])


def _make_mesh(
    what: Any, name: str, points: NDArray[Any], faces: NDArray[np.int64],
    cell_numbers: NDArray[np.int64], point_arrays: _DataArrays, cell_arrays: _DataArrays,
) -> MeshData:  # fmt: skip
    """Return the faces of a surface as mesh data."""
    normals = get_usable_normals(points, faces, _read_rows(what, "active_normals", 3))
    uv = _read_rows(what, "active_texture_coordinates", 2)
    colors, scalars = point_arrays.colors, point_arrays.scalars
    if cell_arrays.colors is not None:
        colors = cell_arrays.colors[cell_numbers]
    return MeshData(
        name, points, faces, normals, uv, colors, None, point_arrays.others,
        take_rows(cell_arrays.others, cell_numbers), scalars,
        None if cell_arrays.scalars is None else cell_arrays.scalars[cell_numbers],
    )  # fmt: skip


def _make_lines(
    name: str, points: NDArray[Any], segments: NDArray[np.int64], lines: NDArray[np.int64],
    point_arrays: _DataArrays, cell_arrays: _DataArrays,
) -> LineSet:  # fmt: skip
    """Return the lines of a surface as a line set."""
    colors = point_arrays.colors if cell_arrays.colors is None else cell_arrays.colors[lines]
    return LineSet(
        name, points, segments, colors, cell_arrays.colors is not None, point_arrays.others,
        take_rows(cell_arrays.others, lines), None, point_arrays.scalars,
        None if cell_arrays.scalars is None else cell_arrays.scalars[lines],
    )  # fmt: skip


def _make_points(
    what: Any, name: str, points: NDArray[Any], rows: NDArray[np.int64] | None,
    cells: NDArray[np.int64], point_arrays: _DataArrays, cell_arrays: _DataArrays,
) -> Cloud:  # fmt: skip
    """Return all or some points of a surface as a cloud, with the values of their cells."""
    normals = _read_rows(what, "active_normals", 3)

    def select(values: NDArray[Any] | None, of_cell: NDArray[Any] | None) -> NDArray[Any] | None:
        """Return the values of the shown points, or those of their cells."""
        if values is None:
            return None if of_cell is None or not len(cells) else of_cell[cells]
        return values if rows is None else values[rows]

    positions = select(points, None)
    assert positions is not None
    return Cloud(
        name, positions, select(point_arrays.colors, cell_arrays.colors), select(normals, None),
        take_rows(point_arrays.others, rows),
        scalars=select(point_arrays.scalars, cell_arrays.scalars),
    )  # fmt: skip


def _read_rows(what: Any, name: str, width: int) -> NDArray[Any] | None:
    """Return an array of points of the given width if it is finite, else None."""
    values = getattr(what, name, None)
    if values is None or np.shape(values) != (what.n_points, width):
        return None
    array = np.asarray(values)
    return array if np.isfinite(array).all() else None


_OPEN3D_FIELDS = {"positions", "normals", "colors", "indices", "texture_uvs"}
"""Arrays of points, lines and triangles that are read; others become attributes."""


def convert_open3d(what: Any, source: str, left_out: LeftOut) -> list[Geometry]:
    """Return a geometry of Open3D, or raise `MeshFileError`."""
    kind = type(what).__name__
    if kind not in ("TriangleMesh", "PointCloud", "LineSet"):
        raise MeshFileError(f"{source} must be a TriangleMesh, a PointCloud or a LineSet")
    is_tensor = hasattr(what, "vertex") or hasattr(what, "point")
    geometry = (_convert_tensors if is_tensor else _convert_legacy)(kind, what, left_out)
    if isinstance(geometry, MeshData) and not len(geometry.faces):
        raise MeshFileError(f"{source} holds a mesh of {len(geometry.vertices)} vertices, no faces")
    if isinstance(geometry, LineSet) and not len(geometry.segments):
        raise MeshFileError(f"{source} holds no lines")
    return [geometry]


def _convert_legacy(kind: str, what: Any, left_out: LeftOut) -> Geometry:
    """Return a geometry of Open3D's legacy classes, which hold vectors."""
    if kind == "PointCloud":
        points = np.asarray(what.points)
        return Cloud(
            "", points, _convert_colors(what.colors, points), _get_if_fits(what.normals, points)
        )
    if kind == "LineSet":
        lines = np.asarray(what.lines).reshape(-1, 2)
        return LineSet(
            "", np.asarray(what.points), lines, _convert_colors(what.colors, lines), True
        )
    vertices = np.asarray(what.vertices)
    if what.has_textures():
        left_out.note("textures of a TriangleMesh")
    faces = np.asarray(what.triangles).reshape(-1, 3)
    normals = get_usable_normals(vertices, faces, _get_if_fits(what.vertex_normals, vertices))
    return MeshData(
        "", vertices, faces, normals, None, _convert_colors(what.vertex_colors, vertices)
    )


def _convert_tensors(kind: str, what: Any, left_out: LeftOut) -> Geometry:
    """Return a geometry of Open3D's tensor classes."""
    what = what.cpu()
    arrays = _get_arrays(what.vertex if kind == "TriangleMesh" else what.point)
    points = arrays.get("positions", np.zeros((0, 3)))
    colors, normals = arrays.get("colors"), arrays.get("normals")
    attributes = {name: values for name, values in arrays.items() if name not in _OPEN3D_FIELDS}
    if kind == "PointCloud":
        return Cloud(
            "", points, _convert_colors(colors, points), _get_if_fits(normals, points), attributes
        )
    cells = _get_arrays(what.triangle if kind == "TriangleMesh" else what.line)
    width = 3 if kind == "TriangleMesh" else 2
    rows = cells.get("indices", np.zeros((0, width), np.int64))
    cell_arrays = {name: values for name, values in cells.items() if name not in _OPEN3D_FIELDS}
    rgba = _convert_colors(cells.get("colors"), rows)
    by_cell = rgba is not None
    rgba = rgba if by_cell else _convert_colors(colors, points)
    if kind == "LineSet":
        return LineSet("", points, rows, rgba, by_cell, attributes, cell_arrays)
    if "texture_uvs" in cells:
        left_out.note("textures of a TriangleMesh")
    normals = get_usable_normals(points, rows, _get_if_fits(normals, points))
    return MeshData("", points, rows, normals, None, rgba, None, attributes, cell_arrays)


def _get_arrays(tensors: Any) -> dict[str, NDArray[Any]]:
    """Return the arrays of a map of tensors."""
    return {name: tensors[name].numpy() for name in tensors}


def _get_if_fits(values: Any, rows: NDArray[Any]) -> NDArray[Any] | None:
    """Return values if there are as many as rows, else None."""
    array = None if values is None else np.asarray(values)
    return array if array is not None and len(array) == len(rows) else None


def _convert_colors(values: Any, rows: NDArray[Any]) -> NDArray[np.float32] | None:
    """Return colours, linear RGBA, if there are as many as rows."""
    array = _get_if_fits(values, rows)
    return None if array is None or not len(array) else mesh_builder.srgb_to_rgba(array)


_CONVERTERS: dict[str, Callable[[Any, str, LeftOut], list[Geometry]]] = {
    "pyvista": convert_pyvista,
    "open3d": convert_open3d,
    "meshio": convert_meshio,
}
"""Converters of objects, by their package."""


def find_package(what: Any) -> str | None:
    """Return the package of an object: pyvista, open3d, meshio, or None."""
    for kind in type(what).__mro__:
        package = kind.__module__.partition(".")[0]
        if package in _CONVERTERS:
            return package
    return None


def describe_object(what: Any) -> str:
    """Return an object's package and type for messages, such as ``pyvista PolyData``."""
    return f"{find_package(what)} {type(what).__name__}"


def convert_foreign(
    what: Any, on_invalid: OnInvalid, crease_angle: float, left_out: LeftOut
) -> Scene:
    """
    Return an object of another package as a scene, or raise `MeshFileError`.

    Its arrays are read where they are; each is copied once, into the mesh that owns it.
    """
    source = describe_object(what)
    things = _CONVERTERS[str(find_package(what))](what, source, left_out)
    return mesh_builder.build_scene(things, Context(source, on_invalid, crease_angle, left_out))
