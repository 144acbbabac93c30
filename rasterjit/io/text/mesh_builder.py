"""Geometries and scenes of readers as plain data; convert them to `Mesh` and `Scene`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rasterjit.io import primitives
from rasterjit.io.load_warnings import LeftOut, MeshFileError
from rasterjit.io.resources import MAX_NAME_LENGTH
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.distinct_rows import distinct_rows
from rasterjit.scene.light import Light
from rasterjit.scene.material import TEXTURE_FIELDS, Material, with_textures
from rasterjit.scene.mesh import Mesh, set_face_scalars, set_face_values
from rasterjit.scene.node import Node, roots_of
from rasterjit.scene.scene import Scene

COLORS_NOTE = "colours beside a material or texture coordinates"
"""Note about colours that are not shown, as trimesh's readers skip them, too."""


_MESH_MEMORY, _VERTEX_MEMORY = 4096, 80
"""Memory of a mesh without its arrays, and of a vertex, while it is read and in the mesh."""

POLYGON_CORNER_MEMORY = 24
"""Memory of a corner of a polygon, before its polygon is triangulated."""

_MEMORY_PER_VALUE = 12
"""Memory of a value of an attribute, in the mesh and while creases are split."""

_FACE_MEMORY, _SPLIT_FACE_MEMORY = 64, 160
"""Memory of a face of a mesh with normals, and of one without, whose creases are split."""


@dataclass(frozen=True)
class MeshData:
    """
    The arrays of a mesh, as a file has them.

    Parameters
    ----------
    name : str
        Of its node.
    vertices : (V, 3) float64
    faces : (F, 3) int
    normals : (V, 3) float, optional
    bare : (F,) bool, optional
        Faces of which a corner has no normal, whatever stands there: they get made ones.
    uv : (V, 2) float, optional
    colors : (V, 4) or (F, 4) float32, optional
        Linear RGBA.
    material : Material, optional
    attributes, face_attributes : dict of str to (V, D) and (F, D) array
        Values of one's own.
    scalars, face_scalars : (V,) and (F,) array, optional
        One of them, in the place of colours.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[Any] | None = None
    uv: NDArray[Any] | None = None
    colors: NDArray[np.float32] | None = None
    material: Material | None = None
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    face_attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    scalars: NDArray[Any] | None = None
    face_scalars: NDArray[Any] | None = None
    bare: NDArray[np.bool_] | None = None


Geometry: TypeAlias = MeshData | primitives.Cloud | primitives.LineSet
"""The geometries that readers return."""


def build_scene(parts: Iterable[Geometry], context: primitives.Context) -> Scene:
    """Return a scene with a node for each geometry, or raise `MeshFileError` naming it."""
    scene = Scene()
    for part in parts:
        scene.add(convert_geometry(part, context), name=part.name or None)
    return scene


def convert_geometry(geometry: Geometry, context: primitives.Context) -> Mesh:
    """Return a geometry as a mesh with normals, points or lines, or raise `MeshFileError`."""
    if isinstance(geometry, primitives.Cloud):
        return primitives.make_points(geometry, context)
    if isinstance(geometry, primitives.LineSet):
        return primitives.make_lines(geometry, context)
    return convert_data(geometry, context)


def convert_data(part: MeshData, context: primitives.Context) -> Mesh:
    """Return a `Mesh` with normals, or raise `MeshFileError` naming its source and name."""
    left_out = context.left_out
    face_bytes = _FACE_MEMORY if part.normals is not None else _SPLIT_FACE_MEMORY
    memory = _MESH_MEMORY + _VERTEX_MEMORY * len(part.vertices) + face_bytes * len(part.faces)
    attribute_values = (*part.attributes.values(), *part.face_attributes.values())
    memory += _MEMORY_PER_VALUE * sum(values.size for values in attribute_values)
    context.take(f"the mesh {part.name[:MAX_NAME_LENGTH]!r}", memory)
    uv, material = _check_uv(part.uv, left_out), part.material
    if uv is None and material is not None:
        material = drop_textures(part.name, material, left_out)
    try:
        mesh = primitives.make_mesh(
            f"mesh {part.name[:MAX_NAME_LENGTH]!r}", left_out, vertices=part.vertices,
            faces=part.faces, normals=primitives.zero_infinite(part.normals, left_out), uv=uv,
            material=material, colors=part.colors if part.face_scalars is None else None,
            on_invalid=context.on_invalid, scalars=part.scalars if part.colors is None else None,
            attributes=primitives.select_finite(part.attributes, len(part.vertices), left_out),
        )  # fmt: skip
        of_faces = primitives.select_finite(part.face_attributes, len(part.faces), left_out)
        set_face_values(mesh, mesh.face_colors, of_faces)
        if part.face_scalars is not None:
            set_face_scalars(mesh, part.face_scalars)
        return _fill_normals(mesh, part.bare, context)
    except ValueError as error:
        raise MeshFileError(f"{context.source}: mesh {part.name!r}: {error}") from error


def _fill_normals(mesh: Mesh, bare: NDArray[np.bool_] | None, context: primitives.Context) -> Mesh:
    """Return a mesh with computed normals, for all faces or for the ``bare`` ones."""
    if mesh.normals is None:
        return mesh.split_creases(context.crease_angle)
    if bare is None or not bare.any():
        return mesh
    split = mesh.split_creases(context.crease_angle)
    faces = np.where(bare[:, np.newaxis], split.faces + len(mesh.vertices), mesh.faces)
    used, indices = np.unique(faces, return_inverse=True)

    def take_used(first: NDArray[Any], second: NDArray[Any]) -> NDArray[Any]:
        """Return the used rows of two arrays of vertices."""
        return np.concatenate([first, second])[used]

    def take_if_given(
        first: NDArray[Any] | None, second: NDArray[Any] | None
    ) -> NDArray[Any] | None:
        """Return the used rows of two arrays, or None if the mesh has no such array."""
        return None if first is None or second is None else take_used(first, second)

    attributes = {
        name: take_used(values, split.vertex_attributes[name])
        for name, values in mesh.vertex_attributes.items()
    }
    both = Mesh(
        take_used(mesh.vertices, split.vertices), indices.reshape(-1, 3),
        normals=take_if_given(mesh.normals, split.normals), uv=take_if_given(mesh.uv, split.uv),
        colors=take_if_given(mesh.vertex_colors, split.vertex_colors), attributes=attributes,
        material=mesh.material, on_invalid=context.on_invalid,
    )  # fmt: skip
    return set_face_values(both, mesh.face_colors, mesh.face_attributes)


def _check_uv(values: NDArray[Any] | None, left_out: LeftOut) -> NDArray[Any] | None:
    """Return texture coordinates; None, with a note, if one is not finite."""
    if values is not None and not np.isfinite(values).all():
        left_out.note("uv with NaN or infinity")
        return None
    return values


def drop_textures(name: str, material: Material, left_out: LeftOut) -> Material:
    """Return a material without its textures, for a mesh without texture coordinates."""
    fields = [field for field in TEXTURE_FIELDS if getattr(material, field) is not None]
    if not fields:
        return material
    left_out.note(f"texture image without texture coordinates, of mesh {name!r}")
    return with_textures(material, dict.fromkeys(fields))


def normalize_names(names: Sequence[str], groups: Iterable[Sequence[str]]) -> list[str]:
    """
    Return names, in lower case where they form a complete group in any case.

    Parameters
    ----------
    names : sequence of str
        Of the values of a row, each once.
    groups : iterable of sequence of str
        Names in small letters that mean something together.

    Examples
    --------
    >>> normalize_names(["X", "Y", "z", "T"], [("x", "y", "z"), ("s", "t")])
    ['x', 'y', 'z', 'T']
    """
    by_lower_name = {name.lower(): name for name in reversed(names)}
    by_lower_name |= {name: name for name in names if name == name.lower()}
    complete = (group for group in groups if all(one in by_lower_name for one in group))
    normalized = {by_lower_name[one]: one for group in complete for one in group}
    return [normalized.get(name, name) for name in names]


def to_linear_rgba(colors: NDArray[Any], is_linear: bool) -> NDArray[np.float32]:
    """
    Return sRGB or linear colours, (N, 3|4), as linear RGBA.

    Whole numbers count to the largest of their type. Bytes are sRGB unless ``is_linear``.
    """
    rgba = np.ones((len(colors), 4), dtype=np.float32)
    if colors.dtype == np.uint8 and not is_linear:
        rgba[:, :3] = srgb_to_linear(colors[:, :3])
        rgba[:, 3 : colors.shape[1]] = colors[:, 3:] / np.float32(255.0)
    else:
        most = 1.0 if colors.dtype.kind == "f" else float(np.iinfo(colors.dtype).max)
        rgba[:, : colors.shape[1]] = np.clip(np.nan_to_num(colors / most), 0.0, 1.0)
    return rgba


def srgb_to_rgba(colors: NDArray[Any]) -> NDArray[np.float32]:
    """Return sRGB colours, (N, 3|4), as linear RGBA; floats count from 0 to 1."""
    return to_linear_rgba(to_srgb_bytes(colors), False)


def to_srgb_bytes(colors: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours as bytes; floats count from 0 to 1."""
    if colors.dtype.kind == "f":
        finite = np.where(np.isfinite(colors), colors, 0.0)
        return (np.clip(finite, 0.0, 1.0) * 255.0).round().astype(np.uint8)
    if colors.dtype == np.uint16:
        return (colors >> 8).astype(np.uint8)
    return np.clip(colors, 0, 255).astype(np.uint8)


def number_rows(numbers: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Number the distinct rows of a table, sorted lexicographically.

    Parameters
    ----------
    numbers : (N, K) int64
        None below zero.

    Returns
    -------
    rows : (V,) int64
        A row of the table for each number.
    which : (N,) int64
        The number of each row.
    """
    which, rows = distinct_rows(*numbers.T)
    order = np.lexsort(numbers[rows].T[::-1])
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return rows[order], rank.take(which)


def triangulate(
    counts: NDArray[np.int64], by_size: bool
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Triangulate polygons, as trimesh does.

    Parameters
    ----------
    counts : (F,) int64
        Corners of each polygon, at least 3; they stand one polygon after the other.
    by_size : bool
        Whether all triangles come first, then the first halves of all quadrangles, then the second
        ones, then fans of the rest; or each polygon's triangles where it stands.

    Returns
    -------
    corners : (T, 3) int64
        Numbers of corners.
    polygons : (T,) int64
        Of which polygon each triangle is.
    """
    begins = np.cumsum(counts) - counts
    if (counts == 3).all():
        return begins[:, np.newaxis] + np.arange(3), np.arange(len(counts))
    polygons = np.repeat(np.arange(len(counts)), counts - 2)
    first = np.cumsum(counts - 2) - (counts - 2)
    step = np.arange(len(polygons)) - first[polygons]
    begin = begins[polygons]
    corners = np.stack([begin, begin + step + 1, begin + step + 2], axis=1)
    second = (counts[polygons] == 4) & (step == 1)
    corners[second] = begin[second, np.newaxis] + [2, 3, 0]
    if by_size:
        rank = np.where(counts == 3, 0, np.where(counts == 4, 1, 3))[polygons] + second
        order = np.argsort(rank, kind="stable")
        corners, polygons = corners[order], polygons[order]
    return corners, polygons


def triangulate_strips(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Triangulate strips; every second triangle is turned over.

    Parameters
    ----------
    counts : (S,) int64
        Corners of each strip, which stand one strip after the other; fewer than 3 are no triangle.

    Returns
    -------
    corners : (T, 3) int64
        Numbers of corners.
    strips : (T,) int64
        Of which strip each triangle is.
    """
    inside = np.maximum(counts - 2, 0)
    strips = np.repeat(np.arange(len(counts)), inside)
    step = np.arange(len(strips)) - (np.cumsum(inside) - inside)[strips]
    first, odd = (np.cumsum(counts) - counts)[strips] + step, step % 2
    return np.stack([first, first + 1 + odd, first + 2 - odd], axis=1), strips


def select_polygons(
    corners: NDArray[Any],
    counts: NDArray[np.int64],
    is_valid_vertex: NDArray[np.bool_],
    report: Callable[[int], None],
    left_out: LeftOut,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """
    Drop polygons of fewer than 3 corners, and those with corners that are no vertices.

    Parameters
    ----------
    corners : (N,) float or int
        Numbers of vertices, one polygon after the other.
    counts : (F,) int64
        How many of them each polygon has.
    is_valid_vertex : (V,) bool
        Which vertices can be used.
    report : callable
        Told the number of each polygon that refers to none.
    left_out : LeftOut
        Notes those of fewer than 3 corners.

    Returns
    -------
    corners : (M,) int64
    counts, polygons : (G,) int64
        Corners and number of each polygon that is left.
    """
    valid = (corners >= 0) & (corners < len(is_valid_vertex))
    integers = np.where(valid, corners, 0).astype(np.int64)
    if len(is_valid_vertex):
        valid &= (integers == corners) & is_valid_vertex[integers]
    polygon_of_corner = np.repeat(np.arange(len(counts)), counts)
    is_sound = np.ones(len(counts), bool)
    is_sound[polygon_of_corner[~valid]] = False
    for polygon in np.flatnonzero(~is_sound).tolist():
        report(polygon)
    is_degenerate = is_sound & (counts < 3)
    if is_degenerate.any():
        left_out.note("polygon of fewer than 3 corners", int(np.count_nonzero(is_degenerate)))
    is_sound &= ~is_degenerate
    return integers[is_sound[polygon_of_corner]], counts[is_sound], np.flatnonzero(is_sound)


class Names:
    """Makes names unique."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self._next: dict[str, int] = {}

    def unique(self, name: str) -> str:
        """Return a name, with a number appended if it was returned before."""
        candidate = name
        if not name or name in self._taken:
            stem, number = name or "geometry", 0
            parts = name.rsplit("_", 1)
            if len(parts) == 2 and parts[1].isdecimal() and len(parts[1]) < 10:
                stem, number = parts[0], int(parts[1])
            skipped = []
            number += 1
            candidate = f"{stem}_{number}"
            while candidate in self._taken:
                skipped.append(candidate)
                number = self._next.get(candidate, number + 1)
                candidate = f"{stem}_{number}"
            # Who comes this way again goes on from here.
            self._next.update(dict.fromkeys(skipped, number + 1))
        self._taken.add(candidate)
        return candidate


@dataclass(frozen=True)
class NodeRecord:
    """
    A node of a scene as plain data.

    Parameters
    ----------
    name : str
    transform : (4, 4) float64
        Relative to the parent or, without one, to the world.
    parent, geometry : int, optional
        Numbers of an earlier node, and of its geometry.
    """

    name: str
    transform: NDArray[np.float64]
    parent: int | None = None
    geometry: int | None = None


@dataclass(frozen=True)
class SceneRecord:
    """
    A scene as plain data: geometries, nodes, camera and lights.

    Parameters
    ----------
    geometries : list of MeshData, Cloud or LineSet
    nodes : list of NodeRecord
    mesh_nodes : list of int
        Numbers of the nodes with a geometry, in the order of the scene's objects.
    camera : PerspectiveCamera, optional
    lights : list of Light
    """

    geometries: list[Geometry]
    nodes: list[NodeRecord]
    mesh_nodes: list[int]
    camera: PerspectiveCamera | None = None
    lights: list[Light] = field(default_factory=list)


def convert_record(record: SceneRecord, context: primitives.Context) -> Scene:
    """Return a `Scene` of its plain data, or raise `MeshFileError`."""
    meshes = [convert_geometry(one, context) for one in record.geometries]
    scene_nodes: list[Node] = []
    for node_record in record.nodes:
        parent: Any = None if node_record.parent is None else scene_nodes[node_record.parent]
        try:
            scene_nodes.append(Node(None, node_record.transform, node_record.name, parent=parent))
        except ValueError as error:
            raise MeshFileError(f"{context.source}: node {node_record.name!r}: {error}") from error
    mesh_nodes = [scene_nodes[number] for number in record.mesh_nodes]
    for number, node in zip(record.mesh_nodes, mesh_nodes, strict=True):
        geometry = record.nodes[number].geometry
        node.mesh = None if geometry is None else meshes[geometry]
    scene = Scene()
    for top in roots_of(mesh_nodes):
        scene._register(top, is_new=True)
    # Objects are numbered as the file has them, whatever they hang below.
    scene.nodes[:] = mesh_nodes
    scene.camera = record.camera
    scene.lights += record.lights
    return scene
