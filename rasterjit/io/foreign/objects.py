"""Objects of meshio, PyVista and Open3D, told without importing these packages, and their parts."""

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

from rasterjit.io.load_warnings import LONGEST_REASON, LeftOut, MeshFileError
from rasterjit.io.primitives import Cloud, LineDrawing, Reading
from rasterjit.io.resources import LONGEST_NAME
from rasterjit.io.text.mesh_builder import (
    Part,
    Thing,
    linear_rgba,
    scene_of_parts,
    srgb_bytes,
    strip_triangles,
    triangles,
)
from rasterjit.scene.lines import strip_segments
from rasterjit.scene.mesh import OnInvalid
from rasterjit.scene.normals import is_creased, safe_scale
from rasterjit.scene.scene import Scene

NONE = np.zeros(0, np.int64)


def padded_cells(padded: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Take apart cells that stand one behind the other, each behind the number of its corners.

    Returns
    -------
    corners : (N,) int64
    counts : (C,) int64
        How many of them each cell has.
    """
    cells = np.asarray(padded, np.int64).reshape(-1)
    if not len(cells):
        return NONE, NONE
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


def check_count(cells: str, counts: NDArray[Any], wanted: int, source: str) -> None:
    """Raise `MeshFileError` if cells of a kind have more or fewer points than all of it have."""
    wrong = counts[counts != wanted]
    if len(wrong):
        raise MeshFileError(
            f"{source} must have {wanted} points in each {cells} cell, got {int(wrong[0])}"
        )


def is_colors(values: NDArray[Any]) -> bool:
    """Tell colours in bytes."""
    return values.dtype == np.uint8 and values.ndim == 2 and values.shape[1] in (3, 4)


def is_scalar(values: NDArray[Any]) -> bool:
    """Tell a number for each of something."""
    single = values.ndim == 1 or (values.ndim == 2 and values.shape[1] == 1)
    return single and values.dtype.kind in "buif"


def rgba_of(values: NDArray[Any]) -> NDArray[np.float32]:
    """Return colours, which are sRGB, as linear RGBA."""
    return linear_rgba(srgb_bytes(values), False)


def own_normals(
    points: NDArray[Any], faces: NDArray[np.int64], normals: NDArray[Any] | None
) -> NDArray[Any] | None:
    """Return normals, or None if one is not there, or they are averages that round off edges."""
    if normals is None or not len(faces) or not np.isfinite(normals).all():
        return None
    if not normals.any(axis=1).all() or not np.isfinite(points).all():
        return None
    places = np.asarray(points, np.float64)
    scale = safe_scale(places.min(axis=0), places.max(axis=0))
    return None if is_creased(places, faces.astype(np.int32), scale) else normals


def rows_of(
    values: Mapping[str, NDArray[Any]], rows: NDArray[np.int64] | None
) -> dict[str, NDArray[Any]]:
    """Return some rows, or all, of values by name."""
    return {name: one if rows is None else one[rows] for name, one in values.items()}


def kept_by_name(values: dict[str, NDArray[Any]], shown: str | None) -> dict[str, NDArray[Any]]:
    """Return values by name: those that are shown only where they are finite, as attributes are."""
    return {
        name: one for name, one in values.items() if name != shown or bool(np.isfinite(one).all())
    }


_FLAT = {
    "triangle": 3, "triangle6": 3, "triangle7": 3, "triangle10": 3,
    "quad": 4, "quad8": 4, "quad9": 4, "quad16": 4,
}  # fmt: skip
"""Cells that are faces, and how many corners they have."""

_HEXAHEDRON = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))
_SIDES = {
    "tetra": ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)),
    "hexahedron": _HEXAHEDRON,
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}
"""Corners of the faces of solids, counter-clockwise seen from outside, as VTK numbers them."""

_STRIPS = {"line": (0, 1), "line3": (0, 2, 1), "line4": (0, 2, 3, 1)}
"""Cells that are lines, and in which order they pass their points."""

_POINTS = {
    "vertex": 1, "line": 2, "triangle": 3, "quad": 4, "tetra": 4, "pyramid": 5, "wedge": 6,
    "hexahedron": 8,
}  # fmt: skip
"""Points of a cell, where the name of its kind does not end in their number."""

_BESIDE = ("point_sets", "cell_sets", "field_data", "gmsh_periodic")
"""What a ``meshio.Mesh`` has besides points, cells and their values."""

_TAG = ":"
"""What names have that readers make up, such as ``gmsh:physical``."""


def things_of_cells(what: Any, source: str, left_out: LeftOut) -> list[Thing]:
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
    of_points = {str(name): np.asarray(values) for name, values in what.point_data.items()}
    of_cells = {
        str(name): _joined([np.asarray(one) for one in values])
        for name, values in what.cell_data.items()
    }
    count = sum(len(data) for _, data in blocks)
    for name in [name for name, values in of_cells.items() if len(values) != count]:
        left_out.note(f"values {name[:LONGEST_NAME]!r} that do not fit all cells")
        del of_cells[name]
    for kind in _BESIDE:
        left_out.note(kind.replace("_", " "), len(getattr(what, kind, None) or ()))
    # Cells by what is drawn of them.
    polygons, strips, lone = _Rows(), _Rows(), _Rows()
    solids = _Rows()
    for (kind, data), begin in zip(blocks, begins, strict=False):
        numbers = np.arange(begin, begin + len(data))
        stem = kind.rstrip("0123456789")
        if stem in _POINTS:
            wanted = int(kind.removeprefix(stem) or _POINTS[stem])
            check_count(kind, np.full(len(data), data.shape[-1]), wanted, source)
        if kind in _FLAT or kind.startswith("polygon"):
            polygons.add(data[:, : _FLAT.get(kind, data.shape[1])], numbers)
        elif stem in _SIDES and data.ndim == 2:
            for side in _SIDES[stem]:
                solids.add(data[:, side], numbers)
        elif kind in _STRIPS:
            order = _STRIPS[kind]
            for first, last in pairwise(order):
                strips.add(data[:, [first, last]], numbers)
        elif kind == "vertex":
            lone.add(data, numbers)
        else:
            left_out.note(f"{kind} cell", len(data))
    # Of solids their outside.
    outer = solids.outer()
    if outer.blocks:
        polygons, before = polygons.without(outer), polygons
        twice = len(before.numbers()) - len(polygons.numbers())
        left_out.note("values of a face that is a side of a solid", twice if of_cells else 0)
    polygons.add_all(outer)
    is_solid = bool(solids.blocks)
    return _parts_of_cells(points, of_points, of_cells, (polygons, strips, lone), is_solid, source)


class _Rows:
    """Corners of polygons, and the numbers of the cells that they are of."""

    def __init__(self) -> None:
        self.blocks: list[tuple[NDArray[Any], NDArray[np.int64]]] = []

    def add(self, corners: NDArray[Any], numbers: NDArray[np.int64]) -> None:
        """Add polygons of as many corners."""
        if len(corners):
            self.blocks.append((corners.astype(np.int64), numbers))

    def add_all(self, other: _Rows) -> None:
        """Add all polygons of others."""
        self.blocks += other.blocks

    def outer(self) -> _Rows:
        """Return the polygons whose corners no second one has."""
        _, which, counts = self._sides()
        return self._some(counts[which] == 1)

    def without(self, other: _Rows) -> _Rows:
        """Return the polygons whose corners no other one has."""
        keys, _, _ = self._sides()
        both, which = np.unique(
            np.concatenate([keys, other._sides()[0]]), axis=0, return_inverse=True
        )
        is_other = np.zeros(len(both), bool)
        is_other[which.reshape(-1)[len(keys) :]] = True
        return self._some(~is_other[which.reshape(-1)[: len(keys)]])

    def _sides(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """
        Return the corners of all polygons, sorted; which of the different ones each is; how often.

        Those of more than four corners are no side of a solid: they have none.
        """
        keys = [np.zeros((0, 4), np.int64)]
        for corners, numbers in self.blocks:
            key = np.full((len(corners), 4), -1, np.int64)
            if corners.shape[1] <= 4:
                key[:, : corners.shape[1]] = np.sort(corners, axis=1)
            else:
                # Each is another one.
                key[:, 0] = -2 - numbers
            keys.append(key)
        every = np.concatenate(keys)
        _, which, counts = np.unique(every, axis=0, return_inverse=True, return_counts=True)
        return every, which.reshape(-1), counts

    def _some(self, kept: NDArray[np.bool_]) -> _Rows:
        """Return some of the polygons, of all blocks one after the other."""
        found, at = _Rows(), 0
        for corners, numbers in self.blocks:
            rows = kept[at : at + len(corners)]
            at += len(corners)
            found.add(corners[rows], numbers[rows])
        return found

    def corners(self) -> NDArray[np.int64]:
        """Return all corners, block by block."""
        return np.concatenate([NONE, *(corners.reshape(-1) for corners, _ in self.blocks)])

    def numbers(self) -> NDArray[np.int64]:
        """Return the numbers of all cells, block by block."""
        return np.concatenate([NONE, *(numbers for _, numbers in self.blocks)])


def _joined(blocks: list[NDArray[Any]]) -> NDArray[Any]:
    """Return values of all blocks of cells; none if they do not fit each other."""
    if not blocks or len({one.shape[1:] for one in blocks}) != 1:
        return np.zeros(0)
    return np.concatenate(blocks)


def _parts_of_cells(
    points: NDArray[Any], of_points: dict[str, NDArray[Any]], of_cells: dict[str, NDArray[Any]],
    rows: tuple[_Rows, _Rows, _Rows], is_solid: bool, source: str,
) -> list[Thing]:  # fmt: skip
    """Return meshes, lines and lone points; a file without cells is a cloud of its points."""
    polygons, strips, lone = rows
    shown = _first_scalar(of_points, len(points))
    scalars = None if shown is None else of_points[shown].reshape(-1)
    of_cell = None if scalars is not None else _first_scalar(of_cells, None)
    cell_scalars = None if of_cell is None else of_cells[of_cell].reshape(-1)
    of_points = kept_by_name(of_points, shown)
    of_cells = {name: values for name, values in of_cells.items() if len(values)}
    cell_own = kept_by_name(of_cells, of_cell)
    found: list[Thing] = []
    if polygons.blocks:
        counts = np.concatenate(
            [np.full(len(corners), corners.shape[1]) for corners, _ in polygons.blocks]
        )
        corners = polygons.corners()
        places, which = triangles(counts, by_size=False)
        check_corners(corners, len(points), source)
        cells, used = polygons.numbers()[which], None
        if is_solid:
            # Most points of a solid lie inside.
            used, corners = np.unique(corners, return_inverse=True)
            corners = corners.reshape(-1)
        found.append(
            Part(
                "", points if used is None else points[used], corners[places], None, None, None,
                None, rows_of(of_points, used), rows_of(cell_own, cells),
                scalars if scalars is None or used is None else scalars[used],
                None if cell_scalars is None else cell_scalars[cells],
            )
        )  # fmt: skip
    if strips.blocks:
        segments, cells = np.concatenate([one for one, _ in strips.blocks]), strips.numbers()
        check_corners(segments, len(points), source)
        found.append(
            LineDrawing(
                "", points, segments, None, False, of_points, rows_of(cell_own, cells), None,
                scalars, None if cell_scalars is None else cell_scalars[cells],
            )
        )  # fmt: skip
    places = lone.corners()
    check_corners(places, len(points), source)
    if found:
        # The others are corners of what is shown.
        places = np.setdiff1d(places, np.concatenate([polygons.corners(), strips.corners()]))
    elif not len(places):
        places = np.arange(len(points))
    if len(places):
        found.append(
            Cloud("", points[places], None, None, rows_of(of_points, places), None,
                  None if scalars is None else scalars[places])
        )  # fmt: skip
    return found


def _first_scalar(values: dict[str, NDArray[Any]], count: int | None) -> str | None:
    """Return the name of the first values that are a number for each and differ, or None."""
    for name, one in values.items():
        if _TAG in name or not is_scalar(one) or not len(one) or len(one) != (count or len(one)):
            continue
        if (one != one[0]).any():
            return name
    return None


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
    things = _things_of_block(what, "", source, left_out)
    if not things:
        raise MeshFileError(f"{source} holds no faces, lines or points")
    return things


def _things_of_block(what: Any, name: str, source: str, left_out: LeftOut) -> list[Thing]:
    """Return what a data set holds, or all blocks of one."""
    for key in getattr(what, "field_data", {}).keys():  # noqa: SIM118 - it is no mapping
        left_out.note(f"field data {str(key)[:LONGEST_NAME]!r}")
    if hasattr(what, "keys") and not hasattr(what, "points"):
        found: list[Thing] = []
        for key in what.keys():  # noqa: SIM118 - it is no mapping
            block = what[key]
            if block is not None:
                found += _things_of_block(block, str(key), source, left_out)
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


_PLACES = {"positions", "normals", "colors", "indices", "texture_uvs"}
"""Values of points, lines and triangles that have a meaning."""


def things_of_open3d(what: Any, source: str, left_out: LeftOut) -> list[Thing]:
    """Return what a geometry of Open3D's holds, or raise `MeshFileError`."""
    kind = type(what).__name__
    if kind not in ("TriangleMesh", "PointCloud", "LineSet"):
        raise MeshFileError(f"{source} must be a TriangleMesh, a PointCloud or a LineSet")
    is_tensor = hasattr(what, "vertex") or hasattr(what, "point")
    thing = (_of_tensors if is_tensor else _of_vectors)(kind, what, left_out)
    if isinstance(thing, Part) and not len(thing.faces):
        raise MeshFileError(f"{source} holds a mesh of {len(thing.vertices)} vertices, no faces")
    if isinstance(thing, LineDrawing) and not len(thing.segments):
        raise MeshFileError(f"{source} holds no lines")
    return [thing]


def _of_vectors(kind: str, what: Any, left_out: LeftOut) -> Thing:
    """Return a geometry of vectors, which NumPy reads where they are."""
    if kind == "PointCloud":
        points = np.asarray(what.points)
        return Cloud("", points, _colors(what.colors, points), _fitting(what.normals, points))
    if kind == "LineSet":
        lines = np.asarray(what.lines).reshape(-1, 2)
        return LineDrawing("", np.asarray(what.points), lines, _colors(what.colors, lines), True)
    vertices = np.asarray(what.vertices)
    if what.has_textures():
        left_out.note("textures of a TriangleMesh")
    faces = np.asarray(what.triangles).reshape(-1, 3)
    normals = own_normals(vertices, faces, _fitting(what.vertex_normals, vertices))
    return Part("", vertices, faces, normals, None, _colors(what.vertex_colors, vertices))


def _of_tensors(kind: str, what: Any, left_out: LeftOut) -> Thing:
    """Return a geometry of tensors."""
    what = what.cpu()
    places = _arrays(what.vertex if kind == "TriangleMesh" else what.point)
    points = places.get("positions", np.zeros((0, 3)))
    colors, normals = places.get("colors"), places.get("normals")
    own = {name: values for name, values in places.items() if name not in _PLACES}
    if kind == "PointCloud":
        return Cloud("", points, _colors(colors, points), _fitting(normals, points), own)
    cells = _arrays(what.triangle if kind == "TriangleMesh" else what.line)
    width = 3 if kind == "TriangleMesh" else 2
    rows = cells.get("indices", np.zeros((0, width), np.int64))
    of_cells = {name: values for name, values in cells.items() if name not in _PLACES}
    rgba = _colors(cells.get("colors"), rows)
    by_cell = rgba is not None
    rgba = rgba if by_cell else _colors(colors, points)
    if kind == "LineSet":
        return LineDrawing("", points, rows, rgba, by_cell, own, of_cells)
    if "texture_uvs" in cells:
        left_out.note("textures of a TriangleMesh")
    normals = own_normals(points, rows, _fitting(normals, points))
    return Part("", points, rows, normals, None, rgba, None, own, of_cells)


def _arrays(tensors: Any) -> dict[str, NDArray[Any]]:
    """Return the values that a map of tensors has."""
    return {name: tensors[name].numpy() for name in tensors}


def _fitting(values: Any, rows: NDArray[Any]) -> NDArray[Any] | None:
    """Return values if there are as many as rows, else None."""
    array = None if values is None else np.asarray(values)
    return array if array is not None and len(array) == len(rows) else None


def _colors(values: Any, rows: NDArray[Any]) -> NDArray[np.float32] | None:
    """Return colours, linear RGBA, if there are as many as rows."""
    array = _fitting(values, rows)
    return None if array is None or not len(array) else rgba_of(array)


_READERS: dict[str, Callable[[Any, str, LeftOut], list[Thing]]] = {
    "pyvista": things_of_pyvista,
    "open3d": things_of_open3d,
    "meshio": things_of_cells,
}
"""What reads the objects of a package."""


def foreign_package(what: Any) -> str | None:
    """Return the package that an object is of: one of PyVista's, Open3D's, meshio's, or None."""
    for kind in type(what).__mro__:
        package = kind.__module__.partition(".")[0]
        if package in _READERS:
            return package
    return None


def foreign_name(what: Any) -> str:
    """Return what messages call an object of another package, such as ``pyvista PolyData``."""
    return f"{foreign_package(what)} {type(what).__name__}"


def scene_of_foreign(
    what: Any, on_invalid: OnInvalid, crease_angle: float, left_out: LeftOut
) -> Scene:
    """
    Return a scene of what an object of another package holds, or raise `MeshFileError`.

    Its arrays are read where they are; each is copied once, into the mesh that owns it.
    """
    source = foreign_name(what)
    things = _READERS[str(foreign_package(what))](what, source, left_out)
    return scene_of_parts(things, Reading(source, on_invalid, crease_angle, left_out))
