"""
Cut the objects of a scene by the planes of its section, and cap the cuts.

The decision: sections are geometry, made once for all views. `cut_scene` returns a scene in which
each object that a plane crosses is another mesh, in the order of the old ones, and each cap is a
mesh behind them all. So whatever draws a scene draws what is left of it: shadows, samples,
transparency, motion and picking know nothing of planes. `Cut` says what each number of the new
scene means in the old one. A scene without section never comes here.

Distances to the planes are measured in world space, in float64; below 2**-46 of the coordinates'
size they are 0, so that what lies in a plane is neither in front nor behind. Faces are cut by one
plane after the other. A crossing is computed from the end of an edge that stays towards the one
that goes, so that both faces of an edge and the cap get the same point bit for bit, in model space
and for all that belongs to a vertex.

Caps close what the cut opens: sides of what is left that lie in the plane, each as often as it
goes one way more than the other, are outlines; what they wind around is filled
(`pipeline.geometry.cap_triangulation`), and cut by the next planes as faces are. Outlines that
cross, as those of shells that run through each other, are split there, and a triangle without area
fills in what rounding leaves between them and the edge of the face. So the outlines of closed
meshes close, whatever passes through vertices and edges. Only where thousands of faces run through
each other may splitting come to no end: such a cut has no cap, which is warned of.
"""

from __future__ import annotations

import copy
import math
import operator
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import fields
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.pipeline.geometry.cap_triangulation import fill_outlines, find_contacts
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import ATTRIBUTE, Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.normals import unit_rows
from rasterjit.scene.points import Points
from rasterjit.scene.scene import Scene, with_labels
from rasterjit.scene.section import SectionPlane, planes_in
from rasterjit.scene.texture import UVSet
from rasterjit.scene.transforms import transform_points
from rasterjit.scene.validation import read_only
from rasterjit.scene.vectors import cross
from rasterjit.scene.warning import REPEATED, warn_caller
from rasterjit.survey.cache import Shapes, are_identical
from rasterjit.survey.object_counts import find_base_color
from rasterjit.survey.object_transforms import (
    compute_mesh_boxes,
    transform_boxes,
    transform_objects,
)

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

ON_PLANE = 2.0**-46
"""Largest distance from a plane of a point on it, relative to the coordinates."""

SEAM_CELL = 2.0**-22
"""Size of the cells in which loose vertices are merged, relative to the largest coordinate."""

GRID = 2.0**28
"""Steps of the grid that outlines lie on, from the middle of a section to its farthest point."""

CAP_SHADE = 0.5
"""Factor on an object's colour for its caps."""

END_STEPS = 4
"""Most steps of the grid between a crossing and the end of an edge that it is merged with."""

MAX_SPLITS = 16
"""Most times that outlines are split where they meet; rounding rarely makes new contacts."""

NO_WEIGHTS = np.zeros((0, 3, 3))

CORNERS = np.arange(3)


class CutMesh(Mesh):
    """A cut mesh; its vertex attributes are interpolated from the original."""

    _whole: Mesh
    _recipe: CutRecipe

    def vertex_normals(self) -> NDArray[np.float32]:
        """Return normals between those of the whole mesh, (V, 3): not of length 1 in a cut."""
        if self._vertex_normals is None:
            self._vertex_normals = read_only(self._recipe.rows(self._whole.vertex_normals()))
        return self._vertex_normals

    def vertex_tangents(
        self, transform: tuple[float, ...] | None = None, uv_set: UVSet = 0
    ) -> NDArray[np.float32]:
        """Return tangents between those of the whole mesh, (V, 2, 4)."""
        return self._recipe.rows(self._whole.vertex_tangents(transform, uv_set))

    def is_closed(self) -> bool:
        """Tell that it is open."""
        return False


class Cut(NamedTuple):
    """Mapping of face, object and vertex numbers of a cut scene to the original scene."""

    planes: tuple[SectionPlane, ...]
    face_starts: Int64
    """(O+1,): first face of each object of the old scene."""
    face_numbers: NDArray[np.int32]
    """(F+1,): number of each face; of caps one above all faces. The last, of face -1, is -1."""
    owners: NDArray[np.int32]
    """(N+1,): object of each new object; the last is -1."""
    meshes: tuple[Mesh, ...]
    """Of the old scene."""
    is_piece: NDArray[np.bool_]
    """(F+1,): whether each face is a part of another, or a cap."""
    weights: NDArray[np.float32]
    """(F+1, 3, 3): of each corner of a piece in the face that it is cut from; 0 in caps. Empty
    where there are no pieces."""
    edges: tuple[NDArray[np.int32], ...]
    """(E, 2) of each plane: where it cuts faces, vertex numbers of the new scene."""
    sides: tuple[NDArray[np.int32], ...]
    """(E, 3) of each plane: a vertex that makes a face of each edge, its new object, and 1 if the
    face turns outward so, else -1. The vertex is -1 where none tells what hides the edge."""
    nodes: tuple[Node, ...]
    """Of the old scene."""
    vertices: tuple[Int64 | None, ...]
    """Of each new object the numbers of its vertices in the old mesh, -1 of new ones; ``None``:
    they are the same."""

    def original_numbers(self, face: int, new: int) -> tuple[int, int]:
        """Return the numbers of a face and its object, given those in the cut scene."""
        return int(self.face_numbers[face]), int(self.owners[new])

    def edges_of(self, shapes: Shapes) -> NDArray[np.int32]:
        """Return the edges of the faces of a cut scene, (N, 2), without those inside of one."""
        faces, numbers = shapes.arrays.faces.astype(np.int64), self.face_numbers[:-1]
        tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
        keys = np.minimum(tails, heads) << 32 | np.maximum(tails, heads)
        order = np.argsort(keys, kind="stable")
        keys, owners = keys[order], np.repeat(numbers, 3)[order]
        starts = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
        least, most = np.minimum.reduceat(owners, starts), np.maximum.reduceat(owners, starts)
        counts = np.diff(np.append(starts, len(keys)))
        inner = keys[starts][(counts > 1) & (least == most)]
        known = shapes.edges.astype(np.int64)
        return shapes.edges[~np.isin(known[:, 0] << 32 | known[:, 1], inner)]

    def vertices_of(self, new: int, numbers: tuple[int, int, int]) -> tuple[int, int, int]:
        """Return the vertices of the old mesh, given those of a new object."""
        known = self.vertices[new]
        if known is None:
            return numbers
        a, b, c = known[list(numbers)].tolist()
        return a, b, c


class CutNodes(list[Node]):
    """The objects of a cut scene."""

    cut: Cut


class CutScene(Scene):
    """A scene cut by its section."""

    _whole: Scene

    def _world_chunks(self) -> Iterator[tuple[Float64, Float64 | None]]:
        """Yield the vertices of the whole scene."""
        return self._whole._world_chunks()


class Parts(NamedTuple):
    """The parts of one object that are left."""

    node: Node | None
    caps: tuple[Node | None, ...]
    """Of each plane."""
    recipe: CutRecipe | None
    """How its vertices follow from those of its mesh; ``None``: they are the same."""
    numbers: Int64 | None
    """(F,): face that each face is cut from; ``None``: each is its own."""
    weights: Float64
    """(P, 3, 3): of the corners of the last faces, which are pieces."""
    edges: tuple[NDArray[np.int32], ...]
    """(E, 2) of each plane."""
    sides: tuple[NDArray[np.int32], ...] = ()
    """(E, 2) of each plane: as `Cut.sides`, without the object; empty where there are no edges."""


class CutRecipe(NamedTuple):
    """Recipe by which a cut mesh's vertices are interpolated from the original's."""

    steps: tuple[tuple[Int64, Int64, Float64], ...]
    """Of each generation: vertices between which the new ones lie, and how far along."""
    used: Int64
    """The vertices that are kept, of those of the mesh and all generations."""

    def rows(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return what belongs to the vertices, (V, ...), given what belongs to those before."""
        count, made = len(values), np.empty((0, *values.shape[1:]))

        def of(numbers: Int64) -> NDArray[Any]:
            found = np.empty((len(numbers), *values.shape[1:]))
            is_old = numbers < count
            found[is_old], found[~is_old] = values[numbers[is_old]], made[numbers[~is_old] - count]
            return found

        for start, end, along in self.steps:
            share, first = along.reshape(-1, *(1,) * (values.ndim - 1)), of(start)
            with np.errstate(invalid="ignore", over="ignore"):
                made = np.concatenate([made, first + share * (of(end) - first)])
        return of(self.used).astype(values.dtype)


_CLOSED_MESHES: weakref.WeakKeyDictionary[Mesh, tuple[bool, Int64]] = weakref.WeakKeyDictionary()
"""Cache: whether meshes are closed, and the positions of their vertices."""

_WINDINGS: weakref.WeakKeyDictionary[Mesh, float] = weakref.WeakKeyDictionary()
"""Cache: winding of the faces of meshes: 1, or -1 if inside out."""

_WARNED: weakref.WeakSet[Mesh] = weakref.WeakSet()
"""Open meshes that were warned of."""


def cut_scene(scene: Scene) -> Scene:
    """
    Cut a scene by its section; return the scene itself without one.

    Warns
    -----
    UserWarning
        Once for each mesh that has no cap, for it is not closed.
    """
    planes = planes_in(scene.section)
    if not planes or isinstance(scene, CutScene):
        return scene
    objects = []
    for node in scene.nodes:
        key = node._mesh, node._world_from_model, scene.section, node._mesh._material, node.name
        # Other threads may cut it by other planes meanwhile.
        cached = node._section_cache
        if cached is None or not all(map(operator.is_, cached[0], key)):
            cached = node._section_cache = key, _cut_object(node, planes)
        objects.append(cached[1])
    # The first node keeps what all are together.
    first = scene.nodes[0]
    joined = first._scene_section_cache
    if joined is None or not are_identical(joined[0], objects):
        joined = first._scene_section_cache = objects, _assemble(scene, objects, planes)
    kept = [
        node
        for node in scene.labelled
        if all((_distances(plane, _anchor_of(node)) <= 0.0).all() for plane in planes)
    ]
    result = _copy_scene(scene if len(kept) == len(scene.labelled) else with_labels(scene, kept))
    result._whole, result.nodes = scene, joined[1]
    return result


def cut_like(scene: Scene, now: Scene) -> Scene:
    """
    Cut an earlier scene where a later one is cut.

    Parameters
    ----------
    scene : Scene
        Of as many objects, with as many faces, as the one that was cut.
    now : Scene
        What `cut_scene` returned of that.
    """
    if not isinstance(now, CutScene):
        return scene
    mapping: CutNodes = now.nodes
    result = _copy_scene(scene)
    nodes = CutNodes()
    for new, owner in zip(mapping, mapping.cut.owners[:-1].tolist(), strict=True):
        old, mesh, original = scene.nodes[owner], new.mesh, mapping.cut.meshes[owner]
        if mesh is original:
            mesh = old.mesh
        elif old.mesh is not original and hasattr(mesh, "_recipe"):
            # The same points of another shape.
            recipe, mesh = mesh._recipe, copy.copy(mesh)
            mesh._vertices = read_only(recipe.rows(old.mesh.vertices))
            mesh._bounds = None
        nodes.append(Node(mesh, name=new.name, world_from_model=old.world_from_model))
    nodes.cut = mapping.cut
    result.nodes = nodes
    return result


def _copy_scene(scene: Scene) -> CutScene:
    """Return a `CutScene` with the same lists."""
    result = object.__new__(CutScene)
    result.__dict__.update(scene.__dict__)
    result._whole = scene
    return result


def _assemble(scene: Scene, objects: Sequence[Parts], planes: Sequence[SectionPlane]) -> CutNodes:
    """Join the parts that are left of all objects."""
    counts = [len(node.mesh.faces) for node in scene.nodes]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    nodes, owners, numbers, weights, edges, vertices = CutNodes(), [], [], [], [], 0
    all_parts: list[list[NDArray[np.int32]]] = [[] for _ in planes]
    sides: list[list[NDArray[np.int32]]] = [[] for _ in planes]

    def add(node: Node, owner: int, faces: Int64, inner: Float64) -> None:
        nodes.append(node)
        owners.append(owner)
        numbers.append(faces)
        weights.append((len(faces) - len(inner), inner))

    for owner, parts in enumerate(objects):
        if parts.node is None:
            continue
        own = np.arange(counts[owner]) if parts.numbers is None else parts.numbers
        add(parts.node, owner, own + starts[owner], parts.weights)
        for plane, lines in enumerate(parts.edges):
            all_parts[plane].append(lines + np.int32(vertices))
        for plane, (third, turn) in enumerate(rows.T for rows in parts.sides):
            moved = np.where(third < 0, -1, third + vertices)
            own = np.full(len(third), len(nodes) - 1)
            sides[plane].append(np.stack([moved, own, turn], axis=1).astype(np.int32))
        vertices += len(parts.node.mesh.vertices)
    for owner, parts in enumerate(objects):
        for plane, node in enumerate(parts.caps):
            if node is not None:
                number = starts[-1] + len(planes) * owner + plane
                count = len(node.mesh.faces)
                add(node, owner, np.full(count, number), np.zeros((count, 3, 3)))
    known = {name for node in nodes for name in _custom_outputs(node.mesh)}
    for owner, parts in enumerate(objects):
        whole = scene.nodes[owner]
        told = _custom_outputs(whole.mesh)
        # Scenes have an object, and outputs that a mesh is asked for remain.
        if parts.node is None and (not nodes or told - known):
            known |= told
            node = Node(_empty_mesh(whole.mesh), name=whole.name)
            add(node, owner, starts[owner : owner + 1], NO_WEIGHTS)
    is_piece = [np.repeat([False, True], [whole, len(inner)]) for whole, inner in weights]
    joined = np.zeros((0, 3, 3), np.float32)
    if any(len(inner) for _, inner in weights):
        rows = [
            part
            for whole, inner in weights
            for part in (np.broadcast_to(np.eye(3), (whole, 3, 3)), inner)
        ]
        joined = np.concatenate([*rows, np.zeros((1, 3, 3))]).astype(np.float32)
    edges = [np.concatenate(rows) if rows else np.zeros((0, 2), np.int32) for rows in all_parts]
    nodes.cut = Cut(
        tuple(planes),
        starts,
        np.append(np.concatenate(numbers), -1).astype(np.int32),
        np.array([*owners, -1], np.int32),
        tuple(node.mesh for node in scene.nodes),
        np.append(np.concatenate(is_piece), False),
        joined,
        tuple(np.ascontiguousarray(rows, np.int32) for rows in edges),
        tuple(np.concatenate([np.zeros((0, 3), np.int32), *rows]) for rows in sides),
        tuple(scene.nodes),
        tuple(
            _old_vertices(node.mesh, scene.nodes[owner].mesh)
            for node, owner in zip(nodes, owners, strict=True)
        ),
    )
    return nodes


def _anchor_of(node: Node) -> Float64:
    """Return the position of a node's label, (1, 3), world space."""
    point = np.array([node.label.position])
    return transform_points(node.world_matrix, point)[:, :3]


def _old_vertices(mesh: Any, whole: Mesh) -> Int64 | None:
    """Return the number of each vertex in the whole mesh, (V,), -1 if it has none; None if all."""
    if mesh is whole:
        return None
    used = mesh._recipe.used if hasattr(mesh, "_recipe") else np.full(3, len(whole.vertices))
    return np.where(used < len(whole.vertices), used, -1)


def _custom_outputs(mesh: Mesh) -> set[str]:
    """Return the outputs that depend on a mesh's attributes and scalars."""
    arrays = {"uv": mesh.uv, "scalar": mesh.field}
    names = {f"{ATTRIBUTE}{name}" for name in (*mesh.vertex_attributes, *mesh.face_attributes)}
    return names | {name for name, values in arrays.items() if values is not None}


def _empty_mesh(mesh: Mesh) -> Mesh:
    """Return a mesh of one face without area, with the attributes and scalars of another."""
    is_there = mesh.used_vertices() & np.isfinite(mesh.vertices).all(axis=1)
    first = int(np.argmax(is_there))
    corners = [first] * 3
    vertices = mesh.vertices[corners] if is_there.any() else np.zeros((3, 3))
    attributes = {name: values[corners] for name, values in mesh.vertex_attributes.items()}
    attributes |= {name: values[:1] for name, values in mesh.face_attributes.items()}
    result = Mesh(
        vertices, [[0, 1, 2]], uv=None if mesh.uv is None else mesh.uv[corners],
        attributes=attributes, material=Material("unlit"),
    )  # fmt: skip
    if mesh.field is not None:
        result._field = mesh.field.of_rows(np.array([0] if mesh.field.of_faces else corners))
    return result


def _distances(plane: SectionPlane, points: Float64) -> Float64:
    """Return the signed distances of points, (N, 3), from a plane, (N,)."""
    (a, b, c), (x, y, z) = plane.normal, plane.point
    with np.errstate(invalid="ignore", over="ignore"):
        return (a * (points[:, 0] - x) + b * (points[:, 1] - y)) + c * (points[:, 2] - z)


def _all_distances(world: Float64, planes: Sequence[SectionPlane]) -> Float64:
    """Return the signed distances of points from planes, (V, P), exactly 0 on them."""
    finite = np.abs(world[np.isfinite(world).all(axis=1)])
    size = float(finite.max(initial=0.0))
    columns = []
    for plane in planes:
        distances = _distances(plane, world)
        tolerance = ON_PLANE * (size + max(map(abs, plane.point)))
        columns.append(np.where(np.abs(distances) <= tolerance, 0.0, distances))
    return np.stack(columns, axis=1)


def _cut_object(node: Node, planes: Sequence[SectionPlane]) -> Parts:
    """Cut an object by planes."""
    mesh = node.mesh
    empty = (np.zeros((0, 2), np.int32),) * len(planes)
    corners = transform_boxes(compute_mesh_boxes([mesh]), node.world_from_model[np.newaxis, :3])[0]
    corner_distances = _all_distances(corners, planes)
    if (corner_distances <= 0.0).all():
        # Nothing of the box around it is cut away.
        return Parts(node, (), None, None, NO_WEIGHTS, empty)
    if (corner_distances > 0.0).all(axis=0).any():
        return Parts(None, (), None, None, NO_WEIGHTS, empty)
    world = transform_points(node.world_from_model, mesh.vertices)[:, :3]
    distances = _all_distances(world, planes)
    used = distances[mesh.used_vertices()]
    if not (used > 0.0).any():
        return Parts(node, (), None, None, NO_WEIGHTS, empty)
    if len(used) and (used.min(axis=0) > 0.0).any():
        return Parts(None, (), None, None, NO_WEIGHTS, empty)
    if isinstance(mesh, Points):
        return _cut_points(node, mesh, distances, empty)
    if isinstance(mesh, Lines):
        return _cut_lines(node, mesh, distances, empty)
    return _Cutter(node, world, distances, planes).parts()


def _cut_points(node: Node, mesh: Points, distances: Float64, empty: Any) -> Parts:
    """Remove the points whose centres a plane cuts off."""
    with np.errstate(invalid="ignore"):
        kept = np.flatnonzero(~(distances > 0.0).any(axis=1))
    if not len(kept):
        return Parts(None, (), None, None, NO_WEIGHTS, empty)
    copied = _with_rows(mesh, CutRecipe((), kept), np.arange(len(kept))[:, np.newaxis], kept)
    if len(mesh.sizes) > 1:
        copied._sizes = read_only(mesh.sizes[kept])
    return Parts(_with_mesh(node, copied), (), copied._recipe, kept, NO_WEIGHTS, empty)


def _cut_lines(node: Node, mesh: Lines, distances: Float64, empty: Any) -> Parts:
    """Cut segments by planes."""
    ends, numbers = mesh.segments.astype(np.int64), np.arange(len(mesh))
    steps, count = [], len(mesh.vertices)
    for plane in range(distances.shape[1]):
        signs = np.sign(distances[:, plane])[ends]
        with np.errstate(invalid="ignore"):
            kept = (signs < 0.0).any(axis=1) | (signs == 0.0).all(axis=1) | np.isnan(signs).any(1)
        ends, numbers, signs = ends[kept], numbers[kept], signs[kept]
        rows, outer = np.nonzero((signs > 0.0) & (signs[:, ::-1] < 0.0))
        if not len(rows):
            continue
        start, end = ends[rows, 1 - outer], ends[rows, outer]
        distances, along = _crossings(distances, start, end, plane)
        ends[rows, outer] = np.arange(count, count + len(rows))
        steps.append((start, end, along))
        count += len(rows)
    if not len(ends):
        return Parts(None, (), None, None, NO_WEIGHTS, empty)
    used, places = np.unique(ends, return_inverse=True)
    faces = places.reshape(-1, 2)[:, [0, 1, 1]]
    copied = _with_rows(mesh, CutRecipe(tuple(steps), used), faces, numbers)
    if len(mesh.widths) > 1:
        copied._widths = read_only(mesh.widths[numbers])
    copied._links = None
    return Parts(_with_mesh(node, copied), (), copied._recipe, numbers, NO_WEIGHTS, empty)


def _crossings(distances: Float64, start: Int64, end: Int64, plane: int) -> tuple[Float64, Float64]:
    """Return the distances with those of new vertices, and how far these lie along their edges."""
    first, last = distances[start], distances[end]
    t = first[:, plane] / (first[:, plane] - last[:, plane])
    new = first + t[:, np.newaxis] * (last - first)
    tolerance = ON_PLANE * np.abs(distances[np.isfinite(distances)]).max(initial=0.0)
    new = np.where(np.abs(new) <= tolerance, 0.0, new)
    new[:, plane] = 0.0
    return np.concatenate([distances, new]), t


def _with_mesh(node: Node, mesh: Mesh) -> Node:
    """Return a node with another mesh at the same place."""
    return Node(mesh, name=node.name, world_from_model=node.world_from_model)


def _with_rows(mesh: Any, recipe: CutRecipe, faces: NDArray[Any], numbers: Int64) -> Any:
    """
    Return a mesh whose vertices follow a recipe, and whose faces are parts of those before.

    Parameters
    ----------
    mesh : Mesh
    recipe : CutRecipe
    faces : (F, 3) int, or (F, 1) of points
    numbers : (F,) int64
        The face that each is a part of.
    """
    kind = CutMesh if mesh.primitive == "triangles" else type(mesh)
    result: Any = kind.__new__(kind)
    result.__dict__.update(mesh.__dict__)

    def rows(values: NDArray[Any] | None) -> NDArray[Any] | None:
        return None if values is None else read_only(recipe.rows(values))

    result._whole, result._recipe = mesh, recipe
    result._vertices = rows(mesh.vertices)
    wide = np.broadcast_to(faces, (len(faces), 3))
    result._faces = read_only(np.ascontiguousarray(wide, np.int32))
    result._vertex_colors = rows(mesh.vertex_colors)
    if mesh.face_colors is not None:
        result._face_colors = read_only(mesh.face_colors[numbers])
    if mesh.field is not None:
        values = mesh.field.values[numbers] if mesh.field.of_faces else rows(mesh.field.values)
        held = {one.name: getattr(mesh.field, one.name) for one in fields(mesh.field)}
        result._field = type(mesh.field)(**held | {"values": read_only(values)})
    result._uv, result._uv1 = rows(mesh.uv), rows(mesh.uv1)
    result._normals = result._vertex_normals = rows(mesh.normals)
    result._tangents = rows(mesh.tangents)
    result._vertex_attributes = {
        name: rows(values) for name, values in mesh.vertex_attributes.items()
    }
    result._face_attributes = {
        name: read_only(values[numbers]) for name, values in mesh.face_attributes.items()
    }
    result._invalid_vertices = int(np.count_nonzero(~np.isfinite(result.vertices).all(axis=1)))
    result._bounds = result._is_closed = result._drawn_faces = None
    if mesh._rest_mesh is not None:
        result._rest_mesh = rest = copy.copy(result)
        rest._vertices, rest._rest_mesh = rows(mesh._rest_mesh.vertices), None
    return result


def _find_closed(mesh: Mesh) -> tuple[bool, Int64]:
    """
    Tell whether faces close: each edge goes one way as often as the other; return places.

    Vertices at one place, (V,) int64, have one number; as at the seam of a sphere, whose sines are
    rounded, vertices at edges that do not close are at one place within ``SEAM_CELL`` of the mesh.
    """
    if mesh not in _CLOSED_MESHES:
        points = mesh.vertices + 0.0
        order = np.lexsort(points.T)
        sorted_points = points[order]
        is_new = np.append(False, (sorted_points[1:] != sorted_points[:-1]).any(axis=1))
        places = np.empty(len(points), np.int64)
        places[order] = np.cumsum(is_new)
        ends = places[mesh.faces]
        tails, heads, _ = _net(ends.ravel(), np.roll(ends, -1, axis=1).ravel(), np.int64(1))
        if len(tails):
            loose = np.isin(places, np.concatenate([tails, heads]))
            places = _merge_seams(points, places, np.flatnonzero(loose))
            ends = places[mesh.faces]
            tails, _, _ = _net(ends.ravel(), np.roll(ends, -1, axis=1).ravel(), np.int64(1))
        _CLOSED_MESHES[mesh] = len(tails) == 0 and not mesh.invalid_vertices, read_only(places)
    return _CLOSED_MESHES[mesh]


def _open_reason(mesh: Mesh) -> str:
    """Say why a mesh is open: edges of single faces, or faces of opposite winding."""
    _, places = _find_closed(mesh)
    ends = places[mesh.faces]
    edges = np.stack([ends.ravel(), np.roll(ends, -1, axis=1).ravel()], axis=1)
    edges = np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    if mesh.invalid_vertices or (counts % 2).any():
        return "its mesh is not closed"
    return "its mesh's faces are not all wound one way"


def _merge_seams(points: Float64, places: Int64, loose: Int64) -> Int64:
    """Return places, (V,), where those of loose vertices that nearly touch are one."""
    loose_points = points[loose]
    size = float(np.abs(loose_points).max(initial=0.0))
    if not 0.0 < size < np.inf:
        return places
    # Two points nearer than a quarter of a cell share one in one of the grids.
    cells = loose_points / (SEAM_CELL * size)
    merged = np.arange(places.max() + 1)
    for shift in np.ndindex(2, 2, 2):
        own = np.floor(cells + 0.5 * np.array(shift)).astype(np.int64)
        _, groups = np.unique(own, axis=0, return_inverse=True)
        lowest = np.full(groups.max() + 1, len(merged))
        source = merged[places[loose]]
        np.minimum.at(lowest, groups.ravel(), source)
        goal = np.arange(len(merged))
        np.minimum.at(goal, source, lowest[groups.ravel()])
        merged = goal[merged]
    return merged[places]


def _net(tails: Int64, heads: Int64, weights: Any) -> tuple[Int64, Int64, Int64]:
    """Return edges from lower to higher numbers with their net counts, where not 0."""
    weights = np.where(tails < heads, weights, -weights)
    low, high = np.minimum(tails, heads), np.maximum(tails, heads)
    count = np.int64(high.max(initial=0)) + 1
    keys, places = np.unique(low * count + high, return_inverse=True)
    sums = np.zeros(len(keys), np.int64)
    np.add.at(sums, places.ravel(), weights)
    kept = (sums != 0) & (keys // count != keys % count)
    return keys[kept] // count, keys[kept] % count, sums[kept]


class _Cutter:
    """
    Cuts a mesh by one plane after the other.

    Parameters
    ----------
    node : Node
    world : (V, 3) float64
        Its vertices.
    distances : (V, P) float64
        How far they lie in front of the planes.
    planes : sequence of SectionPlane
    """

    def __init__(
        self, node: Node, world: Float64, distances: Float64, planes: Sequence[SectionPlane]
    ) -> None:
        self.node, self.planes, self.mesh = node, planes, node.mesh
        self.world, self.distances = world, distances
        self.is_closed, self.places = _find_closed(self.mesh)
        self.steps: list[tuple[Int64, Int64, Float64]] = []
        self.whole = np.arange(len(self.mesh.faces))
        # Parts of faces, and caps: corners, face or -1 - plane, corners in the face, how often.
        self.corners = np.zeros((0, 3), np.int64)
        self.numbers = np.zeros(0, np.int64)
        self.weights = NO_WEIGHTS
        self.counts = np.zeros(0, np.int64)

    @cached_property
    def _outward(self) -> float:
        """Winding of faces in the world: 1, or -1 if inside out."""
        turned = float(transform_objects([self.node.world_from_model]).mirrored[0])
        mesh = self.mesh
        if mesh not in _WINDINGS:
            vertices = mesh.vertices / 2.0
            vertices = vertices - vertices[mesh.faces[0, 0]]
            # So that products neither overflow nor vanish.
            vertices /= np.abs(vertices).max() or 1.0
            volume = math.fsum(_triple(*(vertices[mesh.faces[:, k]] for k in range(3))))
            _WINDINGS[mesh] = math.copysign(1.0, volume)
        return turned * _WINDINGS[mesh]

    def parts(self) -> Parts:
        """Cut by all planes; return the parts that are left."""
        for plane in range(len(self.planes)):
            self._cut(plane)
        is_face = self.numbers >= 0
        faces = np.concatenate([self.mesh.faces[self.whole], self.corners[is_face]])
        numbers = np.concatenate([self.whole, self.numbers[is_face]])
        node, recipe, edges = None, None, [np.zeros((0, 2), np.int32)] * len(self.planes)
        sides: list[NDArray[np.int32]] = []
        if len(faces):
            lines = [
                self._outline(number) if plane.lines else np.zeros((0, 2), np.int64)
                for number, plane in enumerate(self.planes)
            ]
            # Where caps meet, lines have ends that no face has.
            used, renumbered = self._renumber([faces, *lines])
            recipe = CutRecipe(tuple(self.steps), used)
            mesh = _with_rows(self.mesh, recipe, renumbered[faces], numbers)
            node = _with_mesh(self.node, mesh)
            edges = [renumbered[ends] for ends in lines]
            is_used = np.zeros(len(self.distances), bool)
            is_used[used] = True
            for number, ends in enumerate(lines):
                third, turn = self._adjacent(number, ends)
                third = np.where((third >= 0) & is_used[third], renumbered[third], -1)
                sides.append(np.stack([third, turn], axis=1).astype(np.int32))
        elif not len(self.corners):
            return Parts(None, (), None, None, NO_WEIGHTS, tuple(edges))
        caps = tuple(self._make_cap(number) for number in range(len(self.planes)))
        return Parts(node, caps, recipe, numbers, self.weights[is_face], tuple(edges), tuple(sides))

    def _renumber(self, faces: Sequence[NDArray[Any]]) -> tuple[Int64, NDArray[np.int32]]:
        """Return the vertices of faces or lines, and the new number of each vertex."""
        is_used = np.zeros(len(self.distances), bool)
        for rows in faces:
            is_used[rows.ravel()] = True
        return np.flatnonzero(is_used), (np.cumsum(is_used) - 1).astype(np.int32)

    def _cut(self, plane: int) -> None:
        """Cut the remaining faces by one more plane."""
        signs = np.sign(self.distances[:, plane])
        faces = self.mesh.faces[self.whole].astype(np.int64)
        kept, crossed = self._classify(plane, faces, signs)
        eye = np.broadcast_to(np.eye(3), (np.count_nonzero(crossed), 3, 3))
        cut_faces, cut_numbers = faces[crossed], self.whole[crossed]
        kept_pieces, crossed_pieces = self._classify(plane, self.corners, signs)
        self.whole = self.whole[kept]
        corners = np.concatenate([cut_faces, self.corners[crossed_pieces]])
        numbers = np.concatenate([cut_numbers, self.numbers[crossed_pieces]])
        weights = np.concatenate([eye, self.weights[crossed_pieces]])
        counts = np.concatenate([np.ones(len(cut_faces), np.int64), self.counts[crossed_pieces]])
        touches = not self.is_closed and (
            len(corners) or self._splits_along_edges(plane, faces, kept, signs)
        )
        corners, parents, weights = self._split(plane, corners, signs[corners], weights)
        self.corners = np.concatenate([self.corners[kept_pieces], corners])
        self.numbers = np.concatenate([self.numbers[kept_pieces], numbers[parents]])
        self.weights = np.concatenate([self.weights[kept_pieces], weights])
        self.counts = np.concatenate([self.counts[kept_pieces], counts[parents]])
        if not self.is_closed:
            # One shape has many poses.
            shape = getattr(self.mesh, "_rest_mesh", None) or self.mesh
            if touches and self.planes[plane].cap and shape not in _WARNED:
                _WARNED.add(shape)
                warn_caller(
                    f"{self.node.name!r} is cut by a section, but {_open_reason(shape)}: it is "
                    "drawn without a cap"
                )
            return
        tails, heads, sums = self._plane_sides(plane)
        if len(tails):
            # A cap goes around the other way.
            self._add_caps(plane, heads, tails, sums)

    def _splits_along_edges(
        self, plane: int, faces: Int64, kept: NDArray[np.bool_], signs: Float64
    ) -> bool:
        """Tell whether a plane parts faces along their edges: some stay and others go."""
        at = signs[faces]
        ahead = (at > 0.0).any(axis=1) & ~(at < 0.0).any(axis=1)
        if not ahead.any():
            return False
        keys = []
        for some in (faces[kept], faces[ahead]):
            tails, heads = some.ravel(), np.roll(some, -1, axis=1).ravel()
            flat = (signs[tails] == 0.0) & (signs[heads] == 0.0)
            ends = np.sort(self.places[np.stack([tails[flat], heads[flat]], axis=1)], axis=1)
            keys.append(ends[:, 0] << 32 | ends[:, 1])
        return bool(np.isin(*keys).any())

    def _classify(
        self, plane: int, corners: Int64, signs: Float64
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Tell which triangles stay as they are, and which a plane crosses."""
        at = signs[corners]
        is_behind, is_before = (at < 0.0).any(axis=1), (at > 0.0).any(axis=1)
        is_flat = (at == 0.0).all(axis=1)
        if self.is_closed and is_flat.any():
            # What lies in the plane stays where the solid is behind.
            a, b, c = np.moveaxis(self.world[corners[is_flat]], 1, 0)
            normal = np.broadcast_to(np.array(self.planes[plane].normal), a.shape)
            is_flat[is_flat] = self._outward * _triple(normal, b - a, c - a) > 0.0
        is_known = ~np.isnan(at).any(axis=1)
        return (is_behind & ~is_before & is_known) | is_flat, is_behind & is_before & is_known

    def _split(
        self, plane: int, corners: Int64, at: Float64, weights: Float64
    ) -> tuple[Int64, Int64, Float64]:
        """
        Split triangles that a plane crosses; return the remaining pieces.

        Returns
        -------
        corners : (P, 3) int64
        parents : (P,) int64
            The triangle that each is a part of.
        weights : (P, 3, 3) float64
        """
        is_pair = np.count_nonzero(at < 0.0, axis=1) == 2
        # The corner that is alone behind comes first, or the one that is alone before comes last.
        first = np.where(
            is_pair, (np.argmax(at > 0.0, axis=1) + 1) % 3, np.argmax(at < 0.0, axis=1)
        )
        turned = (first[:, np.newaxis] + CORNERS) % 3
        rows = np.arange(len(corners))[:, np.newaxis]
        corners, at, weights = corners[rows, turned], at[rows, turned], weights[rows, turned]
        second = np.where(at[:, 1] == 0.0, 1, 0)
        third = np.where(at[:, 2] == 0.0, 2, 0)
        zero, one, two = (np.full(len(corners), k) for k in range(3))
        # Each corner of a part lies between two corners; at one of them if both are the same.
        single = np.stack([zero, zero, second, one, third, two], axis=1)
        double = np.stack([zero, zero, one, one, one, two], axis=1)
        rest = np.stack([zero, zero, one, two, zero, two], axis=1)
        spans = np.concatenate([np.where(is_pair[:, np.newaxis], double, single), rest[is_pair]])
        parents = np.concatenate([rows[:, 0], np.flatnonzero(is_pair)])
        order = np.argsort(parents, kind="stable")
        spans, parents = spans[order].reshape(-1, 3, 2), parents[order]
        start, end = (
            corners[parents[:, np.newaxis], spans[..., 0]],
            corners[parents[:, np.newaxis], spans[..., 1]],
        )
        is_new = start != end
        keys, inverse = np.unique(
            np.stack([start[is_new], end[is_new]], axis=1), axis=0, return_inverse=True
        )
        count = len(self.distances)
        self._add_vertices(plane, keys[:, 0], keys[:, 1])
        result = start.copy()
        result[is_new] = count + inverse.ravel()
        along = np.zeros(is_new.shape)
        along[is_new] = self.steps[-1][2][inverse.ravel()] if len(keys) else 0.0
        low, high = (weights[parents[:, np.newaxis], spans[..., k]] for k in range(2))
        return result, parents, low + along[..., np.newaxis] * (high - low)

    def _add_vertices(
        self, plane: int, start: Int64, end: Int64, along: Float64 | None = None
    ) -> None:
        """Add vertices in a plane, interpolated between others."""
        first, last = self.distances[start], self.distances[end]
        if along is None:
            along = first[:, plane] / (first[:, plane] - last[:, plane])
        share = along[:, np.newaxis]
        new = first + share * (last - first)
        size = np.abs(self.world[np.isfinite(self.world)]).max(initial=0.0)
        for number, other in enumerate(self.planes):
            slack = ON_PLANE * (size + max(map(abs, other.point)))
            new[np.abs(new[:, number]) <= slack, number] = 0.0
        new[:, plane] = 0.0
        self.distances = np.concatenate([self.distances, new])
        world = self.world[start] + share * (self.world[end] - self.world[start])
        self.world = np.concatenate([self.world, world])
        pairs = np.stack([self.places[start], self.places[end]], axis=1)
        _, numbers = np.unique(pairs, axis=0, return_inverse=True)
        own = self.places.max(initial=-1) + 1 + numbers.ravel()
        self.places = np.concatenate([self.places, own])
        self.steps.append((start, end, along))

    def _plane_sides(self, plane: int, without: int | None = None) -> tuple[Int64, Int64, Int64]:
        """
        Return the sides of what is left that lie in a plane, but for those that go back as well.

        Parameters
        ----------
        plane : int
        without : int, optional
            What is not looked at: the caps of this number.

        Returns
        -------
        tails, heads, sums : (E,) int64
            Vertices, one of each place, and how often.
        """
        faces = self.mesh.faces[self.whole]
        is_kept = self.numbers != without
        zero = self.distances[:, plane] == 0.0
        found = []
        for corners, counts in (
            (faces, np.ones(len(faces), np.int64)), (self.corners[is_kept], self.counts[is_kept]),
        ):  # fmt: skip
            at = zero[corners]
            for k in range(3):
                both = at[:, k] & at[:, (k + 1) % 3]
                found.append((corners[both, k], corners[both, (k + 1) % 3], counts[both]))
        tails, heads, counts = (
            np.concatenate(part).astype(np.int64) for part in zip(*found, strict=True)
        )
        ends, first = np.unique(self.places[np.concatenate([tails, heads])], return_index=True)
        vertices = np.concatenate([tails, heads])[first]
        tails, heads = (np.searchsorted(ends, self.places[end]) for end in (tails, heads))
        low, high, sums = _net(tails, heads, counts)
        return vertices[low], vertices[high], sums

    def _outline(self, plane: int) -> Int64:
        """Return the outline of a plane's cut, (E, 2), vertices."""
        tails, heads, _ = self._plane_sides(plane, -1 - plane)
        return np.stack([tails, heads], axis=1)

    def _adjacent(self, plane: int, ends: Int64) -> tuple[Int64, Int64]:
        """
        Return a vertex that makes a face of each line of a cut, and the winding of that face.

        Takes the lines, (E, 2). The vertex is -1 where a solid need not hide the line from behind:
        it is not closed, light comes through it, or another plane lets one look into it.
        """
        none = np.full(len(ends), -1), np.ones(len(ends), np.int64)
        lets_in = any(
            not other.cap or (other.cap_color is not None and other.cap_color[3] < 1.0)
            for number, other in enumerate(self.planes)
            if number != plane
        )
        is_solid = self.is_closed and self.mesh.material.alpha_mode == "opaque"
        if not len(ends) or not is_solid or lets_in:
            return none
        faces = self.mesh.faces[self.whole].astype(np.int64)
        faces = np.concatenate([faces, self.corners[self.numbers >= 0]])
        zero = self.distances[:, plane] == 0.0
        faces = faces[np.count_nonzero(zero[faces], axis=1) == 2]
        rows = np.concatenate([np.roll(faces, -k, axis=1) for k in range(3)])
        rows = rows[zero[rows[:, 0]] & zero[rows[:, 1]] & ~zero[rows[:, 2]]]
        if not len(rows):
            return none
        tails, heads = self.places[rows[:, 0]], self.places[rows[:, 1]]
        keys = np.minimum(tails, heads) << 32 | np.maximum(tails, heads)
        order = np.argsort(keys, kind="stable")
        tails, keys, thirds = tails[order], keys[order], rows[order, 2]
        own = self.places[ends]
        wanted = own.min(axis=1) << 32 | own.max(axis=1)
        found = np.searchsorted(keys, wanted).clip(max=len(keys) - 1)
        # Where several faces meet, none tells alone.
        is_known = (keys[found] == wanted) & (np.searchsorted(keys, wanted, "right") == found + 1)
        turn = np.where(tails[found] == own[:, 0], 1, -1) * int(self._outward)
        return np.where(is_known, thirds[found], -1), turn

    def _add_caps(self, plane: int, tails: Int64, heads: Int64, sums: Int64) -> None:
        """Fill the outlines in a plane with caps."""
        outlines = _Outlines(self, plane)
        triangles = outlines.fill(tails, heads, sums)
        if triangles is None:
            warn_caller(
                f"{self.node.name!r} is cut by a section, but the outline of the cut does not "
                "close: it is drawn without a cap",
                kind=REPEATED,
            )
            return
        count = len(triangles)
        self.corners = np.concatenate([self.corners, triangles[:, :3]])
        self.numbers = np.concatenate([self.numbers, np.full(count, -1 - plane)])
        self.weights = np.concatenate([self.weights, np.zeros((count, 3, 3))])
        self.counts = np.concatenate([self.counts, triangles[:, 3]])

    def _make_cap(self, plane: int) -> Node | None:
        """Return the cap of a plane as a mesh."""
        corners = self.corners[self.numbers == -1 - plane]
        if not len(corners) or not self.planes[plane].cap:
            return None
        a, b, c = np.moveaxis(self.world[corners], 1, 0)
        normal = np.broadcast_to(np.array(self.planes[plane].normal), a.shape)
        turned = float(transform_objects([self.node.world_from_model]).mirrored[0])
        if turned * math.fsum(_triple(normal, b - a, c - a)) < 0.0:
            # Caps face what is cut away, whichever way the mesh is wound.
            corners = corners[:, ::-1]
        used, renumbered = self._renumber([corners])
        recipe = CutRecipe(tuple(self.steps), used)
        result: Any = CutMesh.__new__(CutMesh)
        mesh = Mesh(
            recipe.rows(self.mesh.vertices), renumbered[corners],
            material=_cap_material(self.mesh, self.planes[plane]), on_invalid="drop",
        )  # fmt: skip
        result.__dict__.update(mesh.__dict__)
        result._whole, result._recipe = self.mesh, recipe
        # Carried into the world by the inverse transpose.
        x, y, z = self.planes[plane].normal
        rows = self.node.world_from_model[:3, :3]
        model = (x * rows[0] + y * rows[1]) + z * rows[2]
        normals = np.tile(unit_rows(model[np.newaxis]), (len(used), 1))
        result._normals = result._vertex_normals = read_only(normals)
        return _with_mesh(self.node, result)


def _triple(a: Float64, b: Float64, c: Float64) -> Float64:
    """Return the triple products of rows of vectors, (N,)."""
    with np.errstate(invalid="ignore", over="ignore"):
        return (
            a[:, 0] * (b[:, 1] * c[:, 2] - b[:, 2] * c[:, 1])
            + a[:, 1] * (b[:, 2] * c[:, 0] - b[:, 0] * c[:, 2])
            + a[:, 2] * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
        )


def _cap_material(mesh: Mesh, plane: SectionPlane) -> Material:
    """Return the material of a mesh's caps."""
    own = mesh.material
    if plane.cap_color is not None:
        color = np.array(plane.cap_color)
    else:
        color = np.array(find_base_color(mesh), np.float64)
        for colors in (mesh.shown_vertex_colors(), mesh.face_colors):
            if colors is not None:
                color[:3] *= [math.fsum(column) / len(colors) for column in colors[:, :3].T]
        color = np.append(np.clip(CAP_SHADE * color[:3], 0.0, 1.0), 1.0)
    return Material(
        own.shading, tuple(color.tolist()), specular=own.specular, shininess=own.shininess,
        metallic=own.metallic, roughness=own.roughness, double_sided=own.double_sided,
        alpha_mode="blend" if color[3] < 1.0 else "opaque",
    )  # fmt: skip


class _Outlines:
    """
    Fills outlines in a plane.

    Parameters
    ----------
    cutter : _Cutter
        Gets vertices where outlines cross.
    plane : int
    """

    def __init__(self, cutter: _Cutter, plane: int) -> None:
        self.cutter, self.plane = cutter, plane
        self.slivers: list[tuple[int, int, int, int]] = []

    def fill(self, tails: Int64, heads: Int64, sums: Int64) -> Int64 | None:
        """Return triangles of vertices, with how often each counts, (T, 4); None: not closed."""
        vertices, places = np.unique(np.concatenate([tails, heads]), return_inverse=True)
        grid = self._snap(vertices)
        low, high = places.ravel().reshape(2, -1)
        for _ in range(MAX_SPLITS):
            grid, vertices, low, high, sums = self._sort_points(grid, vertices, low, high, sums)
            edges = np.ascontiguousarray(np.stack([low, high, sums], axis=1))
            contacts = _edge_contacts(grid, edges)
            if not len(contacts):
                break
            grid, vertices, low, high, sums = self._split(contacts, grid, vertices, edges)
        triangles = _triangulate(grid, edges)
        if triangles is None:
            return None
        triangles[:, :3] = vertices[triangles[:, :3]]
        return np.concatenate([triangles, np.array(self.slivers, np.int64).reshape(-1, 4)])

    def _snap(self, vertices: Int64) -> Int64:
        """Snap vertices to the grid, (N, 2)."""
        x, y, z = self.cutter.planes[self.plane].normal
        # The axis farthest from the normal makes the first of the plane's.
        least = min(range(3), key=lambda k: abs((x, y, z)[k]))
        axis = tuple(float(k == least) for k in range(3))
        across = cross(axis, (x, y, z))
        up = cross((x, y, z), across)
        points = self.cutter.world[vertices]
        points = points - (points.min(axis=0) / 2.0 + points.max(axis=0) / 2.0)
        flat = np.stack(
            [(a * points[:, 0] + b * points[:, 1]) + c * points[:, 2] for a, b, c in (across, up)],
            axis=1,
        )
        size = float(np.abs(flat).max(initial=0.0)) or 1.0
        return np.rint(flat / size * GRID).astype(np.int64)

    def _sort_points(
        self, grid: Int64, vertices: Int64, low: Int64, high: Int64, sums: Int64
    ) -> tuple[Int64, ...]:
        """Sort points by height, merging equal ones, and edges upward, by their start."""
        order = np.lexsort(grid.T)
        is_new = np.append(True, (grid[order][1:] != grid[order][:-1]).any(axis=1))
        numbers = np.empty(len(grid), np.int64)
        numbers[order] = np.cumsum(is_new) - 1
        chosen = order[is_new]
        # What lies at one place of the grid is one vertex for the planes to come as well.
        places, cutter = self.cutter.places, self.cutter
        merged = np.arange(places.max(initial=0) + 1)
        merged[places[vertices]] = places[vertices[chosen][numbers]]
        cutter.places = merged[places]
        low, high, sums = _net(numbers[low], numbers[high], sums)
        return grid[chosen], vertices[chosen], low, high, sums

    def _split(
        self, contacts: Int64, grid: Int64, vertices: Int64, edges: Int64
    ) -> tuple[Int64, ...]:
        """Split edges where they meet; return points and edges."""
        known = {place: number for number, place in enumerate(map(tuple, grid.tolist()))}
        points, inside = grid.tolist(), {}
        made: list[tuple[int, int, float]] = []
        for edge, other, kind in contacts.tolist():
            if kind < 0:
                inside.setdefault(edge, set()).add(other)
                continue
            a, b = edges[edge, :2].tolist()
            c, d = edges[other, :2].tolist()
            here, there = _signed_area(points, c, d, a), _signed_area(points, c, d, b)
            share = here / (here - there)
            x, y = (round(points[a][k] + share * (points[b][k] - points[a][k])) for k in range(2))
            # Next to an end they meet there, or rounding would make new contacts for ever.
            near = (
                end
                for end in (a, b, c, d)
                if max(abs(points[end][0] - x), abs(points[end][1] - y)) <= END_STEPS
            )
            number = next(near, known.get((x, y), -1))
            if number < 0:
                number = known[x, y] = len(points)
                points.append([x, y])
                made.append((a, b, share))
            for one in (edge, other):
                if number not in edges[one, :2]:
                    inside.setdefault(one, set()).add(number)
        if made:
            first = len(self.cutter.distances)
            starts, ends, along = (np.array(part) for part in zip(*made, strict=True))
            self.cutter._add_vertices(
                self.plane, vertices[starts], vertices[ends], along.astype(np.float64)
            )
            vertices = np.append(vertices, np.arange(first, first + len(made)))
        rows = [row for n, row in enumerate(edges.tolist()) if n not in inside]
        for edge, through in inside.items():
            a, b, count = edges[edge].tolist()
            along = {n: _edge_order(points, a, b, n) for n in through}
            chain = [a, *sorted(through, key=along.__getitem__), b]
            rows += [(one, other, count) for one, other in pairwise(chain)]
            for one, other in pairwise(chain[1:]):
                triple = (a, other, one) if count > 0 else (a, one, other)
                own = (int(vertices[n]) for n in triple)
                self.slivers.append((*own, abs(count)))
        low, high, sums = np.array(rows, np.int64).reshape(-1, 3).T
        return np.array(points, np.int64), vertices, low, high, sums


def _signed_area(points: Sequence[Sequence[int]], a: int, b: int, c: int) -> int:
    """Return twice the area of a triangle, above 0 if it is counter-clockwise."""
    (x, y), (right, up), (other, top) = points[a], points[b], points[c]
    return (right - x) * (top - y) - (up - y) * (other - x)


def _edge_order(points: Sequence[Sequence[int]], a: int, b: int, n: int) -> int:
    """Return a sort key that grows along an edge from a to b."""
    (x, y), (right, up), (here, height) = points[a], points[b], points[n]
    return (right - x) * (here - x) + (up - y) * (height - y)


def _edge_contacts(grid: Int64, edges: Int64) -> Int64:
    """Return where edges meet elsewhere than at their ends, (C, 3)."""
    room = 64
    while True:
        found = np.empty((room, 3), np.int64)
        count = find_contacts(grid, edges, np.empty(len(edges), np.int64), found)
        if count <= room:
            return found[:count]
        room = count


def _triangulate(grid: Int64, edges: Int64) -> Int64 | None:
    """Triangulate the area that edges enclose, (T, 4); None if they are not closed."""
    room = len(edges) + 4 * len(grid)
    triangles = np.empty((room, 4), np.int64)
    count = fill_outlines(
        grid, edges, np.empty(len(edges), np.int64), np.empty((4, len(edges)), np.int64),
        np.empty((3, room), np.int64), np.empty(2, np.int64), triangles,
    )  # fmt: skip
    return None if count < 0 else triangles[:count]
