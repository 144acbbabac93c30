"""
Count what packages of others find in a file, beside what RasterJIT makes of it.

The file is read once more by the package itself, in this process: it was read before, in a process
with limits, without a word. What the package passes over in silence is in neither number.
"""

from __future__ import annotations

import contextlib
import io
import struct
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from rasterjit.io.foreign.readers import CELL_FORMATS, VTK_FORMATS
from rasterjit.io.point_clouds.las import LAS_FORMATS
from rasterjit.io.resources import extension_of


class Held(NamedTuple):
    """How many of something a file holds."""

    least: int
    is_exact: bool = True
    """Whether it holds no more; curves are cut as finely as they need."""


Counts = dict[str, Held]
"""By ``"triangles"``, ``"segments"`` and ``"points"``; nothing is said of what is missing."""

_CORNERS = {"triangle": 3, "quad": 4}
_SIDES = {
    "tetra": ("012", "013", "023", "123"),
    "pyramid": ("0123", "014", "124", "234", "034"),
    "wedge": ("012", "345", "0143", "1254", "0253"),
    "hexahedron": ("0123", "4567", "0154", "1265", "2376", "0374"),
}
"""Sides of cells, by the numbers of their corners."""


def counts_of(path: Path) -> Counts | None:
    """Return what a file holds, or None if no package of others counts it."""
    extension = extension_of(path)
    with (
        warnings.catch_warnings(),
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()),
    ):
        warnings.simplefilter("ignore")
        if extension in LAS_FORMATS:
            return {"points": Held(_las_points(path.read_bytes()))}
        if extension in VTK_FORMATS:
            return _exactly(_of_pyvista(path))
        if extension in CELL_FORMATS:
            return _of_cells(path, extension)
        if extension == "dxf":
            return _of_dxf(path)
        if extension == "svg":
            return _of_svg(path)
        return _of_trimesh(path, extension)


def _exactly(counts: Counter[str] | None) -> Counts | None:
    if counts is None:
        return None
    return {name: Held(counts[name]) for name in ("triangles", "segments", "points")}


def _las_points(content: bytes) -> int:
    """Return the number of points by the head of a LAS or LAZ file."""
    (old,) = struct.unpack_from("<I", content, 107)
    return int(struct.unpack_from("<Q", content, 247)[0]) if content[25] >= 4 else int(old)


def _of_cells(path: Path, extension: str) -> Counts | None:
    """Count the cells that meshio reads; where it does not, what PyVista reads."""
    import meshio

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            mesh = meshio.read(path)
        if extension not in ("vtk", "vtu") or "cannot handle" not in " ".join(
            said.getvalue().split()
        ):
            return _exactly(_of_blocks(mesh))
    except (Exception, SystemExit):
        if extension not in ("vtk", "vtu"):
            raise
    return _exactly(_of_pyvista(path))


def _of_blocks(mesh: Any) -> Counter[str] | None:
    """
    Count triangles of faces and of the outer sides of solids, lines and lone points.

    None if a corner of a cell comes twice: which side is which is a matter of taste.
    """
    flat, sides, counts = [], Counter[frozenset[int]](), Counter[str]()
    sizes: dict[frozenset[int], int] = {}
    lone, used = set(), set()
    for block in mesh.cells:
        kind = block.type.rstrip("0123456789")
        for row in block.data.tolist():
            corners = row[: _CORNERS.get(kind, len(row))]
            if kind in _SIDES:
                for side in _SIDES[kind]:
                    key = frozenset(row[int(one)] for one in side)
                    sides[key] += 1
                    sizes[key] = len(side)
            elif kind == "line":
                counts["segments"] += len(row) - 1
                used.update(row)
            elif kind == "vertex":
                lone.update(row)
            else:
                flat.append(corners)
    outer = {side for side, count in sides.items() if count == 1}
    shown = [corners for corners in flat if frozenset(corners) not in outer]
    if any(len(side) != sizes[side] for side in sides) or any(
        len(set(corners)) != len(corners) for corners in flat
    ):
        return None
    counts["triangles"] = sum(sizes[side] - 2 for side in outer)
    counts["triangles"] += sum(len(corners) - 2 for corners in shown)
    used = used.union(*outer, *map(set, shown))
    counts["points"] = len(lone - used) if used else len(lone) or len(mesh.points)
    return counts


def _of_pyvista(path: Path) -> Counter[str]:
    """Count the cells of all blocks that PyVista reads."""
    import pyvista

    with pyvista.vtk_verbosity("off"):
        waiting, counts = [pyvista.read(path)], Counter[str]()
    while waiting:
        one = waiting.pop()
        if one is None:
            continue
        if isinstance(one, pyvista.MultiBlock):
            waiting += list(one)
            continue
        surface = one if hasattr(one, "faces") or not one.n_cells else one.extract_surface()
        before = counts.total()
        for name, skipped in (("faces", 2), ("strips", 2), ("lines", 1)):
            what = "segments" if name == "lines" else "triangles"
            counts[what] += sum(size - skipped for size in _sizes(getattr(surface, name, ())))
        points = sum(_sizes(getattr(surface, "verts", ())))
        is_bare = counts.total() == before
        counts["points"] += points or (surface.n_points if is_bare else 0)
    return counts


def _sizes(padded: Any) -> Iterator[int]:
    """Yield the number of corners of each of some cells, before which it stands."""
    cells, at = list(padded), 0
    while at < len(cells):
        yield int(cells[at])
        at += int(cells[at]) + 1


def _of_dxf(path: Path) -> Counts:
    """Count the entities that ezdxf finds, in blocks too."""
    from ezdxf import disassemble, recover

    document, _ = recover.readfile(path)
    kinds = Counter(one.dxftype() for one in disassemble.recursive_decompose(document.modelspace()))
    faces, points = kinds.pop("3DFACE", 0), kinds.pop("POINT", 0)
    return {"triangles": Held(faces, False), "points": Held(points),
            "segments": Held(kinds.total(), False)}  # fmt: skip


def _of_svg(path: Path) -> Counts:
    """Count the lines that trimesh finds, and one for each curve."""
    import trimesh

    with path.open("rb") as file:
        # Processed, points that lie together beside very far ones become one, and lines lost.
        entities = trimesh.load_path(file, file_type="svg", process=False).entities
    straight = [isinstance(one, trimesh.path.entities.Line) for one in entities]
    least = sum(
        len(one.points) - 1 if is_straight else 1
        for one, is_straight in zip(entities, straight, strict=True)
    )
    return {"segments": Held(least, all(straight))}


def _of_trimesh(path: Path, extension: str) -> Counts:
    """Count the triangles of what trimesh reads, at all places where it stands."""
    import trimesh

    kind = "tar.gz" if extension == "tar.bz2" else extension
    with path.open("rb") as file:
        scene = trimesh.load_scene(file, file_type=kind, process=False)
    count = sum(
        len(getattr(scene.geometry[scene.graph[node][1]], "faces", ()))
        for node in scene.graph.nodes_geometry
    )
    return {"triangles": Held(count)}
