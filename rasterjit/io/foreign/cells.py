"""
Meshes of meshio, and files that it reads: cells of simulations.

Solids are shown by their outer faces, cells of higher order by their corners.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.drawings import LineDrawing
from rasterjit.io.foreign.tables import (
    NONE,
    check_corners,
    check_count,
    is_scalar,
    kept_by_name,
    rows_of,
)
from rasterjit.io.point_clouds.cloud import Cloud
from rasterjit.io.resources import LONGEST_NAME
from rasterjit.io.skipped import LeftOut, MeshFileError
from rasterjit.io.text.parts import Part, Thing, triangles

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
    return _things(points, of_points, of_cells, (polygons, strips, lone), is_solid, source)


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


def _things(
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
