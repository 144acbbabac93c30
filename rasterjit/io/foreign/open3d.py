"""Objects of Open3D: triangle meshes, point clouds and sets of lines, of both its interfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.drawings import LineDrawing
from rasterjit.io.foreign.tables import own_normals, rgba_of
from rasterjit.io.point_clouds.cloud import Cloud
from rasterjit.io.skipped import LeftOut, MeshFileError
from rasterjit.io.text.parts import Part, Thing

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
