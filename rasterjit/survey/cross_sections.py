"""
Cut the objects of a scene by the planes of its section, and cap the cuts.

Sections are geometry, computed once for all views. `cut_scene` returns a scene in which each object
that a plane crosses has another mesh, in the same order, and each cap is a mesh behind them all:
shadows, samples, transparency, motion and picking need not know of planes. `Cut` maps the numbers
of the cut scene to the original.

Distances to the planes are measured in world space, in float64; below 2**-46 of the coordinates'
size they are 0, so that points in a plane are neither in front nor behind. Faces are cut by one
plane after the other. A crossing is interpolated from the end of an edge behind the plane towards
the end in front, so that both faces of an edge and the cap get the same bits, in model space and in
all attributes.

Caps close the cut: edges of the remaining faces in the plane, each as often as its directions do
not cancel, are outlines; the area that they wind around is filled
(`pipeline.geometry.cap_triangulation`), and cut by the next planes as faces are. Outlines that
cross, as those of shells that intersect, are split there, and a triangle without area closes the
gap that rounding leaves to the edge of the face. So the outlines of closed meshes close. Only where
thousands of faces intersect may splitting not end: such a cut has no cap, with a warning. Where
caps of several objects overlap, `cap_overlaps` leaves each point to one of them.
"""

from __future__ import annotations

import copy
import math
import operator
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.scene.color import rgba
from rasterjit.scene.edge_twins import edge_keys
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import ATTRIBUTE, Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.normals import compute_area_vectors, dot_rows, unit_rows
from rasterjit.scene.points import Points
from rasterjit.scene.scalar_field import Field
from rasterjit.scene.scene import Scene, with_labels
from rasterjit.scene.section import SectionPlane, planes_in
from rasterjit.scene.texture import UVSet
from rasterjit.scene.transforms import transform_points
from rasterjit.scene.validation import read_only
from rasterjit.scene.warning import REPEATED, warn_caller
from rasterjit.survey.cache import Shapes, are_identical
from rasterjit.survey.cap_outlines import OutlineFiller, VertexRecipe, count_net_edges
from rasterjit.survey.cap_overlaps import Cap, resolve_overlaps, scale_caps
from rasterjit.survey.cap_scalars import spread_scalars
from rasterjit.survey.object_counts import find_base_color
from rasterjit.survey.object_transforms import (
    compute_mesh_boxes,
    transform_boxes,
    transform_objects,
)

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

MAX_PLANE_DISTANCE = 2.0**-46
"""Largest distance from a plane of a point on it, relative to the coordinates."""

SEAM_CELL_SIZE = 2.0**-22
"""Size of the cells in which vertices of open edges are merged, relative to the coordinates."""

PART_COLORS = (
    "#77aadd", "#ee8866", "#eedd88", "#ffaabb", "#99ddff", "#44bb99", "#bbcc33", "#aaaa00",
    "#dddddd",
)  # fmt: skip
"""Colours of parts in turn: Paul Tol's "light" ones, which stay apart where colours are seen less
well, and on which black lines are seen."""

CAP_SHADE = 0.5
"""Factor on an object's colour for its caps."""

NO_WEIGHTS = np.zeros((0, 3, 3))

CORNER_INDICES = np.arange(3)


class CutMesh(Mesh):
    """A cut mesh; its vertex attributes are interpolated from the original."""

    _whole: Mesh
    _recipe: VertexRecipe

    def vertex_normals(self) -> NDArray[np.float32]:
        """Return normals interpolated from the original, (V, 3): not of length 1 in a cut."""
        if self._vertex_normals is None:
            self._vertex_normals = read_only(self._recipe.interpolate(self._whole.vertex_normals()))
        return self._vertex_normals

    def vertex_tangents(
        self, transform: tuple[float, ...] | None = None, uv_set: UVSet = 0
    ) -> NDArray[np.float32]:
        """Return tangents interpolated from the original, (V, 2, 4)."""
        return self._recipe.interpolate(self._whole.vertex_tangents(transform, uv_set))

    def is_closed(self) -> bool:
        """Return False: the cut opens the mesh."""
        return False


class Cut(NamedTuple):
    """Mapping of face, object and vertex numbers of a cut scene to the original scene."""

    planes: tuple[SectionPlane, ...]
    face_starts: Int64
    """(O+1,): first face of each object of the original scene."""
    face_numbers: NDArray[np.int32]
    """(F+1,): original number of each face; numbers of caps follow those of all faces. The last, of
    face -1, is -1."""
    owners: NDArray[np.int32]
    """(N+1,): original object of each object; the last is -1."""
    meshes: tuple[Mesh, ...]
    """Of the original scene."""
    is_piece: NDArray[np.bool_]
    """(F+1,): whether each face is a piece of an original one, or of a cap."""
    weights: NDArray[np.float32]
    """(F+1, 3, 3): barycentric weights of each corner of a piece in its original face; 0 in caps.
    Empty without pieces."""
    edges: tuple[NDArray[np.int32], ...]
    """(E, 2) of each plane: edges where it cuts faces, vertex numbers of the cut scene."""
    sides: tuple[NDArray[np.int32], ...]
    """(E, 3) of each plane: the third vertex of a face at each edge, its object, and 1 if they wind
    outward in that order, else -1. The vertex is -1 if no single face hides the edge."""
    nodes: tuple[Node, ...]
    """Of the original scene."""
    vertices: tuple[Int64 | None, ...]
    """Of each object the numbers of its vertices in the original mesh, -1 of new ones; ``None``:
    unchanged."""
    areas: Float64
    """(O, P): area of the cap of each original object in each plane, with what others cover."""
    hatchings: Int64
    """(O,): of each original object a number that those it meets lack; 0 without hatching."""

    def original_numbers(self, face: int, new: int) -> tuple[int, int]:
        """Return the original numbers of a face and its object, given those in the cut scene."""
        return int(self.face_numbers[face]), int(self.owners[new])

    def edges_of(self, shapes: Shapes) -> NDArray[np.int32]:
        """Return the edges of the cut scene, (N, 2), without those inside an original face."""
        faces, numbers = shapes.arrays.faces.astype(np.int64), self.face_numbers[:-1]
        tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
        keys = edge_keys(tails, heads)
        order = np.argsort(keys, kind="stable")
        keys, owners = keys[order], np.repeat(numbers, 3)[order]
        starts = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
        least, most = np.minimum.reduceat(owners, starts), np.maximum.reduceat(owners, starts)
        counts = np.diff(np.append(starts, len(keys)))
        inner = keys[starts][(counts > 1) & (least == most)]
        return shapes.edges[~np.isin(edge_keys(*shapes.edges.astype(np.int64).T), inner)]

    def vertices_of(self, new: int, numbers: tuple[int, int, int]) -> tuple[int, int, int]:
        """Return the vertices of the original mesh, given those of an object of the cut scene."""
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


class CutParts(NamedTuple):
    """The remaining parts of one object."""

    node: Node | None
    caps: tuple[Node | None, ...]
    """Of each plane."""
    recipe: VertexRecipe | None
    """How the vertices follow from those of the mesh; ``None``: unchanged."""
    numbers: Int64 | None
    """(F,): original face of each face; ``None``: unchanged."""
    weights: Float64
    """(P, 3, 3): barycentric weights of the corners of the last faces, which are pieces."""
    edges: tuple[NDArray[np.int32], ...]
    """(E, 2) of each plane."""
    sides: tuple[NDArray[np.int32], ...] = ()
    """(E, 2) of each plane: as `Cut.sides`, without the object; empty where there are no edges."""
    cap_areas: tuple[float, ...] = ()
    """Of each plane; empty without caps."""
    flat_faces: tuple[NDArray[Any], ...] = ()
    """(T, 3) of each plane: the remaining faces that lie in it; empty if none does."""


_CLOSED_MESHES: weakref.WeakKeyDictionary[Mesh, tuple[bool, Int64]] = weakref.WeakKeyDictionary()
"""Cache: whether meshes are closed, and the positions of their vertices."""

_WINDINGS: weakref.WeakKeyDictionary[Mesh, float] = weakref.WeakKeyDictionary()
"""Cache: winding of the faces of meshes: 1, or -1 if inside out."""

_WARNED: weakref.WeakSet[Mesh] = weakref.WeakSet()
"""Open meshes with a warning already issued."""


def cut_scene(scene: Scene) -> Scene:
    """
    Cut a scene by its section; return the scene itself without one.

    Warns
    -----
    UserWarning
        Once for each mesh without a cap, as it is not closed.
    """
    planes = planes_in(scene.section)
    if not planes or isinstance(scene, CutScene):
        return scene
    objects = []
    colors = PART_COLORS if any(plane.cap_color == "parts" for plane in planes) else None
    for number, node in enumerate(scene.nodes):
        is_cut = node._is_cut
        key = (
            node._mesh, node._world_from_model, scene.section, node._mesh._material, node.name,
            is_cut, None if colors is None else colors[number % len(colors)],
        )  # fmt: skip
        # Other threads may replace the cache meanwhile.
        cached = node._section_cache
        if cached is None or not all(map(operator.is_, cached[0], key)):
            cached = node._section_cache = key, _cut_object(node, planes, is_cut, key[-1])
        objects.append(cached[1])
    # The first node caches the cut nodes of the scene.
    first = scene.nodes[0]
    joined = first._scene_section_cache
    if joined is None or not are_identical(joined[0], objects):
        joined = first._scene_section_cache = objects, _join_parts(scene, objects, planes)
    kept_labels = [
        node
        for node in scene.labelled
        if not node._is_cut
        or all((_plane_distances(plane, _label_position(node)) <= 0.0).all() for plane in planes)
    ]
    result = _copy_scene(
        scene if len(kept_labels) == len(scene.labelled) else with_labels(scene, kept_labels)
    )
    result._whole, result.nodes = scene, joined[1]
    return result


def cut_earlier(scene: Scene, now: Scene) -> Scene:
    """
    Cut an earlier scene as a later one was cut.

    Parameters
    ----------
    scene : Scene
        With the same numbers of objects and faces as the later one.
    now : Scene
        The later one, as `cut_scene` returned it.
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
            mesh._vertices = read_only(recipe.interpolate(old.mesh.vertices))
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


def _join_parts(
    scene: Scene, objects: Sequence[CutParts], planes: Sequence[SectionPlane]
) -> CutNodes:
    """Join the remaining parts of all objects."""
    counts = [len(node.mesh.faces) for node in scene.nodes]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    nodes, owners, numbers, weights, edges, vertices = CutNodes(), [], [], [], [], 0
    all_edges: list[list[NDArray[np.int32]]] = [[] for _ in planes]
    sides: list[list[NDArray[np.int32]]] = [[] for _ in planes]

    def add(node: Node, owner: int, faces: Int64, inner: Float64) -> None:
        nodes.append(node)
        owners.append(owner)
        numbers.append(faces)
        weights.append((len(faces) - len(inner), inner))

    for owner, parts in enumerate(objects):
        if parts.node is None:
            continue
        face_numbers = np.arange(counts[owner]) if parts.numbers is None else parts.numbers
        add(parts.node, owner, face_numbers + starts[owner], parts.weights)
        for plane, lines in enumerate(parts.edges):
            all_edges[plane].append(lines + np.int32(vertices))
        for plane, (third, winding) in enumerate(rows.T for rows in parts.sides):
            vertex = np.where(third < 0, -1, third + vertices)
            face_numbers = np.full(len(third), len(nodes) - 1)
            sides[plane].append(np.stack([vertex, face_numbers, winding], axis=1).astype(np.int32))
        vertices += len(parts.node.mesh.vertices)
    areas = np.array([parts.cap_areas or (0.0,) * len(planes) for parts in objects])
    caps = _separate_caps(objects, planes, areas)
    for owner in range(len(objects)):
        for plane, node in enumerate(caps[owner]):
            if node is not None:
                number = starts[-1] + len(planes) * owner + plane
                count = len(node.mesh.faces)
                add(node, owner, np.full(count, number), np.zeros((count, 3, 3)))
    known_outputs = {name for node in nodes for name in _list_custom_outputs(node.mesh)}
    for owner, parts in enumerate(objects):
        whole = scene.nodes[owner]
        outputs = _list_custom_outputs(whole.mesh)
        # Keep an object, and the attributes that outputs may request.
        if parts.node is None and (not nodes or outputs - known_outputs):
            known_outputs |= outputs
            node = Node(_make_degenerate_mesh(whole.mesh), name=whole.name)
            add(node, owner, starts[owner : owner + 1], NO_WEIGHTS)
    is_piece = [np.repeat([False, True], [whole, len(inner)]) for whole, inner in weights]
    joined_weights = np.zeros((0, 3, 3), np.float32)
    if any(len(inner) for _, inner in weights):
        rows = [
            part
            for whole, inner in weights
            for part in (np.broadcast_to(np.eye(3), (whole, 3, 3)), inner)
        ]
        joined_weights = np.concatenate([*rows, np.zeros((1, 3, 3))]).astype(np.float32)
    edges = [np.concatenate(rows) if rows else np.zeros((0, 2), np.int32) for rows in all_edges]
    nodes.cut = Cut(
        tuple(planes),
        starts,
        np.append(np.concatenate(numbers), -1).astype(np.int32),
        np.array([*owners, -1], np.int32),
        tuple(node.mesh for node in scene.nodes),
        np.append(np.concatenate(is_piece), False),
        joined_weights,
        tuple(np.ascontiguousarray(rows, np.int32) for rows in edges),
        tuple(np.concatenate([np.zeros((0, 3), np.int32), *rows]) for rows in sides),
        tuple(scene.nodes),
        tuple(
            _original_vertices(node.mesh, scene.nodes[owner].mesh)
            for node, owner in zip(nodes, owners, strict=True)
        ),
        areas.reshape(-1, len(planes)),
        _number_hatchings(scene, planes, areas),
    )
    return nodes


def _number_hatchings(scene: Scene, planes: Sequence[SectionPlane], areas: Float64) -> Int64:
    """Return for each object the least number that none before it has whose box it meets, (O,)."""
    numbers = np.zeros(len(scene.nodes), np.int64)
    owners = np.flatnonzero((areas > 0.0).any(axis=1))
    if not len(owners) or all(plane.hatch is None for plane in planes):
        return numbers
    corners = np.array([_box_corners(scene.nodes[owner]) for owner in owners.tolist()])
    lows, highs = corners.min(axis=1), corners.max(axis=1)
    slack = MAX_PLANE_DISTANCE * np.abs(corners).max(initial=0.0)
    for row, owner in enumerate(owners.tolist()):
        is_apart = (lows[:row] > highs[row] + slack) | (highs[:row] < lows[row] - slack)
        taken = set(numbers[owners[:row][~is_apart.any(axis=1)]].tolist())
        numbers[owner] = next(number for number in range(row + 1) if number not in taken)
    return numbers


def _box_corners(node: Node) -> Float64:
    """Return the corners of the box of a node's mesh, world space, (8, 3)."""
    boxes = compute_mesh_boxes([node.mesh])
    return transform_boxes(boxes, node.world_from_model[np.newaxis, :3])[0]


def _separate_caps(
    objects: Sequence[CutParts], planes: Sequence[SectionPlane], areas: Float64
) -> list[list[Node | None]]:
    """Return the caps of all objects, without what others in the same plane cover."""
    caps = [list(parts.caps) for parts in objects]
    for plane in range(len(planes)):
        owners = [owner for owner, row in enumerate(caps) if row and row[plane] is not None]
        nodes: list[Any] = [caps[owner][plane] for owner in owners]
        known = [
            _as_cap(node, node.mesh.faces, float(areas[owner, plane]))
            for owner, node in zip(owners, nodes, strict=True)
        ]
        # Faces that lie in the plane hide all caps.
        flat = [
            _as_cap(parts.node, parts.flat_faces[plane], 0.0)
            for parts in objects
            if parts.node is not None and parts.flat_faces and len(parts.flat_faces[plane])
        ]
        if not known:
            continue
        scaled = scale_caps(known + flat)
        found = resolve_overlaps(planes[plane], scaled) if len(scaled) > 1 else scaled
        for owner, node, before, now in zip(owners, nodes, scaled, found, strict=False):
            caps[owner][plane] = _change_cap(node, planes[plane], before, now)
    return caps


def _change_cap(node: Node, plane: SectionPlane, cap: Cap, left: Cap | str | None) -> Node | None:
    """Return a cap as `resolve_overlaps` left it, with its scalars; None if nothing is left."""
    if left is None:
        return None
    if isinstance(left, str):
        warn_caller(f"the cap of {node.name!r} stays where others cover it: {left}", kind=REPEATED)
        left = cap
    mesh: Any = node.mesh
    field, values = _cap_field(mesh._whole, plane), None
    if field is not None and cap.area > 0.0:
        spread = spread_scalars(plane, cap, left, cap.recipe.interpolate(field.values))
        left, values = (left, None) if spread is None else spread
    if left is cap:
        return node
    faces = _face_cut_side(node, plane, left.world, left.faces)
    return _make_cap_node(node, plane, mesh._whole, faces, left.recipe, mesh.material, values)


def _as_cap(node: Node, faces: NDArray[Any], area: float) -> Cap:
    """Return a node's faces in a plane as a cap of some area, to be compared with others'."""
    mesh: Any = node.mesh
    used, corners = np.unique(faces, return_inverse=True)
    world = transform_points(node.world_from_model, mesh.vertices[used])[:, :3]
    whole, recipe = getattr(mesh, "_whole", mesh), getattr(mesh, "_recipe", None)
    numbers = used if recipe is None else recipe.used[used]
    return Cap(
        world, corners.reshape(-1, 3).astype(np.int64),
        VertexRecipe(() if recipe is None else recipe.steps, numbers), len(whole.vertices), area,
    )  # fmt: skip


def _label_position(node: Node) -> Float64:
    """Return the position of a node's label, (1, 3), world space."""
    point = np.array([node.label.position])
    return transform_points(node.world_matrix, point)[:, :3]


def _original_vertices(mesh: Any, whole: Mesh) -> Int64 | None:
    """Return the original number of each vertex, (V,), -1 of new ones; None if unchanged."""
    if mesh is whole:
        return None
    used = mesh._recipe.used if hasattr(mesh, "_recipe") else np.full(3, len(whole.vertices))
    return np.where(used < len(whole.vertices), used, -1)


def _list_custom_outputs(mesh: Mesh) -> set[str]:
    """Return the outputs that depend on a mesh's attributes and scalars."""
    arrays = {"uv": mesh.uv, "scalar": mesh.field}
    names = {f"{ATTRIBUTE}{name}" for name in (*mesh.vertex_attributes, *mesh.face_attributes)}
    return names | {name for name, values in arrays.items() if values is not None}


def _make_degenerate_mesh(mesh: Mesh) -> Mesh:
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
        result._field = mesh.field.select_rows(np.array([0] if mesh.field.of_faces else corners))
    return result


def _plane_distances(plane: SectionPlane, points: Float64) -> Float64:
    """Return the signed distances of points, (N, 3), from a plane, (N,)."""
    (a, b, c), (x, y, z) = plane.normal, plane.point
    with np.errstate(invalid="ignore", over="ignore"):
        return (a * (points[:, 0] - x) + b * (points[:, 1] - y)) + c * (points[:, 2] - z)


def _signed_distances(world: Float64, planes: Sequence[SectionPlane]) -> Float64:
    """Return the signed distances of points from planes, (V, P), exactly 0 on them."""
    finite = np.abs(world[np.isfinite(world).all(axis=1)])
    size = float(finite.max(initial=0.0))
    columns = []
    for plane in planes:
        distances = _plane_distances(plane, world)
        tolerance = MAX_PLANE_DISTANCE * (size + max(map(abs, plane.point)))
        columns.append(np.where(np.abs(distances) <= tolerance, 0.0, distances))
    return np.stack(columns, axis=1)


def _cut_object(
    node: Node, planes: Sequence[SectionPlane], is_cut: bool, part_color: str | None = None
) -> CutParts:
    """Cut an object by planes, or leave it whole; its caps may have a colour as a part."""
    mesh = node.mesh
    empty = (np.zeros((0, 2), np.int32),) * len(planes)
    corner_distances = _signed_distances(_box_corners(node), planes)
    whole = CutParts(node, (), None, None, NO_WEIGHTS, empty)
    is_behind = (corner_distances <= 0.0).all()
    if not is_cut or (is_behind and (corner_distances != 0.0).all()):
        return whole
    if (corner_distances > 0.0).all(axis=0).any():
        return CutParts(None, (), None, None, NO_WEIGHTS, empty)
    world = transform_points(node.world_from_model, mesh.vertices)[:, :3]
    distances = _signed_distances(world, planes)
    used = distances[mesh.used_vertices()]
    if not (used > 0.0).any():
        return whole._replace(flat_faces=_find_flat_faces(mesh, mesh.faces, distances))
    if len(used) and (used.min(axis=0) > 0.0).any():
        return CutParts(None, (), None, None, NO_WEIGHTS, empty)
    if isinstance(mesh, Points):
        return _cut_points(node, mesh, distances, empty)
    if isinstance(mesh, Lines):
        return _cut_lines(node, mesh, distances, empty)
    return _Cutter(node, world, distances, planes, part_color).cut_all()


def _find_flat_faces(
    mesh: Mesh, faces: NDArray[Any], distances: Float64, numbers: NDArray[Any] | None = None
) -> tuple[NDArray[Any], ...]:
    """Return the faces that lie in each plane, their vertices renumbered; empty if none does."""
    if mesh.primitive != "triangles":
        return ()
    is_flat = (distances == 0.0)[faces].all(axis=1)
    if not is_flat.any():
        return ()
    return tuple(
        found if numbers is None else numbers[found]
        for found in (faces[rows].astype(np.int64) for rows in is_flat.T)
    )


def _cut_points(node: Node, mesh: Points, distances: Float64, empty: Any) -> CutParts:
    """Remove the points whose centres a plane cuts off."""
    with np.errstate(invalid="ignore"):
        kept = np.flatnonzero(~(distances > 0.0).any(axis=1))
    if not len(kept):
        return CutParts(None, (), None, None, NO_WEIGHTS, empty)
    copied = _interpolate_mesh(
        mesh, VertexRecipe((), kept), np.arange(len(kept))[:, np.newaxis], kept
    )
    if len(mesh.sizes) > 1:
        copied._sizes = read_only(mesh.sizes[kept])
    return CutParts(node._with_mesh(copied), (), copied._recipe, kept, NO_WEIGHTS, empty)


def _cut_lines(node: Node, mesh: Lines, distances: Float64, empty: Any) -> CutParts:
    """Cut segments by planes."""
    ends, numbers = mesh.segments.astype(np.int64), np.arange(len(mesh))
    steps, count = [], len(mesh.vertices)
    for plane in range(distances.shape[1]):
        signs = np.sign(distances[:, plane])[ends]
        with np.errstate(invalid="ignore"):
            kept = (signs < 0.0).any(axis=1) | (signs == 0.0).all(axis=1) | np.isnan(signs).any(1)
        ends, numbers, signs = ends[kept], numbers[kept], signs[kept]
        rows, outside = np.nonzero((signs > 0.0) & (signs[:, ::-1] < 0.0))
        if not len(rows):
            continue
        start, end = ends[rows, 1 - outside], ends[rows, outside]
        distances, along = _add_crossings(distances, start, end, plane)
        ends[rows, outside] = np.arange(count, count + len(rows))
        steps.append((start, end, along))
        count += len(rows)
    if not len(ends):
        return CutParts(None, (), None, None, NO_WEIGHTS, empty)
    used, inverse = np.unique(ends, return_inverse=True)
    faces = inverse.reshape(-1, 2)[:, [0, 1, 1]]
    copied = _interpolate_mesh(mesh, VertexRecipe(tuple(steps), used), faces, numbers)
    if len(mesh.widths) > 1:
        copied._widths = read_only(mesh.widths[numbers])
    copied._links = None
    return CutParts(node._with_mesh(copied), (), copied._recipe, numbers, NO_WEIGHTS, empty)


def _add_crossings(
    distances: Float64, start: Int64, end: Int64, plane: int
) -> tuple[Float64, Float64]:
    """Return the distances with those of new vertices, and their fractions along the edges."""
    first, last = distances[start], distances[end]
    t = first[:, plane] / (first[:, plane] - last[:, plane])
    new = first + t[:, np.newaxis] * (last - first)
    tolerance = MAX_PLANE_DISTANCE * np.abs(distances[np.isfinite(distances)]).max(initial=0.0)
    new = np.where(np.abs(new) <= tolerance, 0.0, new)
    new[:, plane] = 0.0
    return np.concatenate([distances, new]), t


def _interpolate_mesh(mesh: Any, recipe: VertexRecipe, faces: NDArray[Any], numbers: Int64) -> Any:
    """
    Return a mesh with interpolated vertices, and faces that are parts of the original's.

    Parameters
    ----------
    mesh : Mesh
    recipe : VertexRecipe
    faces : (F, 3) int, or (F, 1) of points
    numbers : (F,) int64
        Original face of each face.
    """
    kind = CutMesh if mesh.primitive == "triangles" else type(mesh)
    result: Any = kind.__new__(kind)
    result.__dict__.update(mesh.__dict__)

    def rows(values: NDArray[Any] | None) -> NDArray[Any] | None:
        return None if values is None else read_only(recipe.interpolate(values))

    result._whole, result._recipe = mesh, recipe
    result._vertices = rows(mesh.vertices)
    wide = np.broadcast_to(faces, (len(faces), 3))
    result._faces = read_only(np.ascontiguousarray(wide, np.int32))
    result._vertex_colors = rows(mesh.vertex_colors)
    if mesh.face_colors is not None:
        result._face_colors = read_only(mesh.face_colors[numbers])
    if mesh.field is not None:
        values = mesh.field.values[numbers] if mesh.field.of_faces else rows(mesh.field.values)
        result._field = replace(mesh.field, values=read_only(values))
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
    result._bounds = result._is_closed = result._drawn_faces = result._edge_twins = None
    if mesh._rest_mesh is not None:
        result._rest_mesh = rest = copy.copy(result)
        rest._vertices, rest._rest_mesh = rows(mesh._rest_mesh.vertices), None
    return result


def _weld_and_check_closed(mesh: Mesh) -> tuple[bool, Int64]:
    """
    Tell whether each edge has as many faces in either direction; return position numbers, (V,).

    Vertices at the same position have the same number; those at open edges also within
    ``SEAM_CELL_SIZE``, as at the seam of a sphere, whose sines are rounded.
    """
    if mesh not in _CLOSED_MESHES:
        points = mesh.vertices + 0.0
        order = np.lexsort(points.T)
        sorted_points = points[order]
        is_new = np.append(False, (sorted_points[1:] != sorted_points[:-1]).any(axis=1))
        position_ids = np.empty(len(points), np.int64)
        position_ids[order] = np.cumsum(is_new)
        tails, heads = _find_open_edges(position_ids[mesh.faces])
        if len(tails):
            loose = np.isin(position_ids, np.concatenate([tails, heads]))
            position_ids = _weld_seams(points, position_ids, np.flatnonzero(loose))
            tails, _ = _find_open_edges(position_ids[mesh.faces])
        is_closed = len(tails) == 0 and not mesh.invalid_vertices
        _CLOSED_MESHES[mesh] = is_closed, read_only(position_ids)
    return _CLOSED_MESHES[mesh]


def _find_open_edges(corners: Int64) -> tuple[Int64, Int64]:
    """Return start and end of the edges of faces, (F, 3), whose directions do not cancel."""
    heads = np.roll(corners, -1, axis=1).ravel()
    return count_net_edges(corners.ravel(), heads, np.int64(1))[:2]


def _explain_open(mesh: Mesh) -> str:
    """Say why a mesh is open: edges of single faces, or faces of opposite winding."""
    _, position_ids = _weld_and_check_closed(mesh)
    face_ids = position_ids[mesh.faces]
    edges = np.stack([face_ids.ravel(), np.roll(face_ids, -1, axis=1).ravel()], axis=1)
    edges = np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    if mesh.invalid_vertices or (counts % 2).any():
        return "its mesh is not closed"
    return "its mesh's faces are not all wound one way"


def _weld_seams(points: Float64, position_ids: Int64, loose_vertices: Int64) -> Int64:
    """Return position numbers, (V,), merged for vertices of open edges that nearly touch."""
    loose_points = points[loose_vertices]
    size = float(np.abs(loose_points).max(initial=0.0))
    if not 0.0 < size < np.inf:
        return position_ids
    # Points nearer than a quarter of a cell share a cell of at least one of the shifted grids.
    cells = loose_points / (SEAM_CELL_SIZE * size)
    merged = np.arange(position_ids.max() + 1)
    for shift in np.ndindex(2, 2, 2):
        cell_numbers = np.floor(cells + 0.5 * np.array(shift)).astype(np.int64)
        _, groups = np.unique(cell_numbers, axis=0, return_inverse=True)
        lowest = np.full(groups.max() + 1, len(merged))
        source = merged[position_ids[loose_vertices]]
        np.minimum.at(lowest, groups.ravel(), source)
        target = np.arange(len(merged))
        np.minimum.at(target, source, lowest[groups.ravel()])
        merged = target[merged]
    return merged[position_ids]


class _Cutter:
    """
    Cutter of a mesh by one plane after the other.

    Parameters
    ----------
    node : Node
    world : (V, 3) float64
        Its vertices.
    distances : (V, P) float64
        Signed distances of the vertices from the planes.
    planes : sequence of SectionPlane
    part_color : str, optional
        Of its caps, where a plane colours them by parts.
    """

    def __init__(
        self, node: Node, world: Float64, distances: Float64, planes: Sequence[SectionPlane],
        part_color: str | None,
    ) -> None:  # fmt: skip
        self.node, self.planes, self.mesh = node, planes, node.mesh
        self.world, self.distances, self.part_color = world, distances, part_color
        self.is_closed, self.position_ids = _weld_and_check_closed(self.mesh)
        self.steps: list[tuple[Int64, Int64, Float64]] = []
        self.whole = np.arange(len(self.mesh.faces))
        # Pieces and caps: corners, face or -1 - plane, barycentric weights, multiplicity.
        self.corners = np.zeros((0, 3), np.int64)
        self.numbers = np.zeros(0, np.int64)
        self.weights = NO_WEIGHTS
        self.counts = np.zeros(0, np.int64)

    @cached_property
    def _outward(self) -> float:
        """Winding of faces in the world: 1, or -1 if inside out."""
        mirror_sign = float(transform_objects([self.node.world_from_model]).mirrored[0])
        mesh = self.mesh
        if mesh not in _WINDINGS:
            vertices = mesh.vertices / 2.0
            vertices = vertices - vertices[mesh.faces[0, 0]]
            # So that products neither overflow nor vanish.
            vertices /= np.abs(vertices).max() or 1.0
            volume = math.fsum(_triple_products(*(vertices[mesh.faces[:, k]] for k in range(3))))
            _WINDINGS[mesh] = math.copysign(1.0, volume)
        return mirror_sign * _WINDINGS[mesh]

    def cut_all(self) -> CutParts:
        """Cut by all planes; return the remaining parts."""
        for plane in range(len(self.planes)):
            self._cut(plane)
        is_face = self.numbers >= 0
        faces = np.concatenate([self.mesh.faces[self.whole], self.corners[is_face]])
        numbers = np.concatenate([self.whole, self.numbers[is_face]])
        renumbered: Any = np.zeros(0, np.int32)
        node, recipe, edges = None, None, [np.zeros((0, 2), np.int32)] * len(self.planes)
        sides: list[NDArray[np.int32]] = []
        lines = [
            self._find_outline(number) if plane.lines else np.zeros((0, 2), np.int64)
            for number, plane in enumerate(self.planes)
        ]
        ends = np.concatenate(lines)
        if len(ends) and not len(faces):
            # Caps alone are left: a face without area holds the lines.
            faces, numbers = np.full((1, 3), ends[0, 0]), np.zeros(1, np.int64)
        if len(faces):
            # Where caps meet, lines may end at vertices of no face.
            used, renumbered = self._renumber([faces, *lines])
            recipe = VertexRecipe(tuple(self.steps), used)
            mesh = _interpolate_mesh(self.mesh, recipe, renumbered[faces], numbers)
            node = self.node._with_mesh(mesh)
            edges = [renumbered[ends] for ends in lines]
            is_used = np.zeros(len(self.distances), bool)
            is_used[used] = True
            for number, ends in enumerate(lines):
                third, winding = self._find_adjacent_vertices(number, ends)
                third = np.where((third >= 0) & is_used[third], renumbered[third], -1)
                sides.append(np.stack([third, winding], axis=1).astype(np.int32))
        elif not len(self.corners):
            return CutParts(None, (), None, None, NO_WEIGHTS, tuple(edges))
        caps = tuple(self._make_cap(number) for number in range(len(self.planes)))
        areas = tuple(map(_measure_cap, caps))
        flat_faces = _find_flat_faces(self.mesh, faces, self.distances, renumbered)
        return CutParts(
            node, caps, recipe, numbers, self.weights[is_face], tuple(edges), tuple(sides), areas,
            flat_faces,
        )  # fmt: skip

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
        corner_weights = np.broadcast_to(np.eye(3), (np.count_nonzero(crossed), 3, 3))
        cut_faces, cut_numbers = faces[crossed], self.whole[crossed]
        kept_pieces, crossed_pieces = self._classify(plane, self.corners, signs)
        self.whole = self.whole[kept]
        corners = np.concatenate([cut_faces, self.corners[crossed_pieces]])
        numbers = np.concatenate([cut_numbers, self.numbers[crossed_pieces]])
        weights = np.concatenate([corner_weights, self.weights[crossed_pieces]])
        counts = np.concatenate([np.ones(len(cut_faces), np.int64), self.counts[crossed_pieces]])
        removes_solid = not self.is_closed and (
            len(corners) or self._splits_along_edges(plane, faces, kept, signs)
        )
        corners, parents, weights = self._split(plane, corners, signs[corners], weights)
        self.corners = np.concatenate([self.corners[kept_pieces], corners])
        self.numbers = np.concatenate([self.numbers[kept_pieces], numbers[parents]])
        self.weights = np.concatenate([self.weights[kept_pieces], weights])
        self.counts = np.concatenate([self.counts[kept_pieces], counts[parents]])
        if not self.is_closed:
            # Warn once for all poses of a shape.
            shape = getattr(self.mesh, "_rest_mesh", None) or self.mesh
            if removes_solid and self.planes[plane].cap and shape not in _WARNED:
                _WARNED.add(shape)
                warn_caller(
                    f"{self.node.name!r} is cut by a section, but {_explain_open(shape)}: it is "
                    "drawn without a cap"
                )
            return
        tails, heads, sums = self._find_plane_edges(plane)
        if len(tails):
            # The outline of a cap runs in the opposite direction.
            self._add_caps(plane, heads, tails, sums)

    def _splits_along_edges(
        self, plane: int, faces: Int64, kept: NDArray[np.bool_], signs: Float64
    ) -> bool:
        """Tell whether a plane separates kept and removed faces along their shared edges."""
        corner_signs = signs[faces]
        is_ahead = (corner_signs > 0.0).any(axis=1) & ~(corner_signs < 0.0).any(axis=1)
        if not is_ahead.any():
            return False
        keys = []
        for some in (faces[kept], faces[is_ahead]):
            tails, heads = some.ravel(), np.roll(some, -1, axis=1).ravel()
            flat = (signs[tails] == 0.0) & (signs[heads] == 0.0)
            ends = np.sort(self.position_ids[np.stack([tails[flat], heads[flat]], axis=1)], axis=1)
            keys.append(ends[:, 0] << 32 | ends[:, 1])
        return bool(np.isin(*keys).any())

    def _classify(
        self, plane: int, corners: Int64, signs: Float64
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Tell which triangles a plane keeps whole, and which it crosses."""
        corner_signs = signs[corners]
        is_behind, is_before = (corner_signs < 0.0).any(axis=1), (corner_signs > 0.0).any(axis=1)
        is_flat = (corner_signs == 0.0).all(axis=1)
        if self.is_closed and is_flat.any():
            # Faces in the plane are kept if the solid is behind.
            a, b, c = np.moveaxis(self.world[corners[is_flat]], 1, 0)
            normal = np.broadcast_to(np.array(self.planes[plane].normal), a.shape)
            is_flat[is_flat] = self._outward * _triple_products(normal, b - a, c - a) > 0.0
        is_known = ~np.isnan(corner_signs).any(axis=1)
        return (is_behind & ~is_before & is_known) | is_flat, is_behind & is_before & is_known

    def _split(
        self, plane: int, corners: Int64, corner_signs: Float64, weights: Float64
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
        is_pair = np.count_nonzero(corner_signs < 0.0, axis=1) == 2
        # Rotate: a single corner behind comes first, a single corner in front comes last.
        first = np.where(
            is_pair,
            (np.argmax(corner_signs > 0.0, axis=1) + 1) % 3,
            np.argmax(corner_signs < 0.0, axis=1),
        )
        rotated = (first[:, np.newaxis] + CORNER_INDICES) % 3
        rows = np.arange(len(corners))[:, np.newaxis]
        corners, corner_signs, weights = (
            values[rows, rotated] for values in (corners, corner_signs, weights)
        )
        second = np.where(corner_signs[:, 1] == 0.0, 1, 0)
        third = np.where(corner_signs[:, 2] == 0.0, 2, 0)
        zero, one, two = (np.full(len(corners), k) for k in range(3))
        # Each corner of a piece lies between two corners, or at one if both are the same.
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
        self.add_vertices(plane, keys[:, 0], keys[:, 1])
        result = start.copy()
        result[is_new] = count + inverse.ravel()
        fractions = np.zeros(is_new.shape)
        fractions[is_new] = self.steps[-1][2][inverse.ravel()] if len(keys) else 0.0
        low, high = (weights[parents[:, np.newaxis], spans[..., k]] for k in range(2))
        return result, parents, low + fractions[..., np.newaxis] * (high - low)

    def add_vertices(
        self, plane: int, start: Int64, end: Int64, along: Float64 | None = None
    ) -> None:
        """Add vertices in a plane, interpolated between others."""
        first, last = self.distances[start], self.distances[end]
        if along is None:
            along = first[:, plane] / (first[:, plane] - last[:, plane])
        fraction = along[:, np.newaxis]
        new = first + fraction * (last - first)
        size = np.abs(self.world[np.isfinite(self.world)]).max(initial=0.0)
        for number, other in enumerate(self.planes):
            tolerance = MAX_PLANE_DISTANCE * (size + max(map(abs, other.point)))
            new[np.abs(new[:, number]) <= tolerance, number] = 0.0
        new[:, plane] = 0.0
        self.distances = np.concatenate([self.distances, new])
        world = self.world[start] + fraction * (self.world[end] - self.world[start])
        self.world = np.concatenate([self.world, world])
        pairs = np.stack([self.position_ids[start], self.position_ids[end]], axis=1)
        _, numbers = np.unique(pairs, axis=0, return_inverse=True)
        new_ids = self.position_ids.max(initial=-1) + 1 + numbers.ravel()
        self.position_ids = np.concatenate([self.position_ids, new_ids])
        self.steps.append((start, end, along))

    def _find_plane_edges(
        self, plane: int, excluded: int | None = None
    ) -> tuple[Int64, Int64, Int64]:
        """
        Return the edges of the remaining faces in a plane, but for those that cancel.

        Parameters
        ----------
        plane : int
        excluded : int, optional
            Number of caps to leave out.

        Returns
        -------
        tails, heads, sums : (E,) int64
            Vertices, one for each position, and net counts.
        """
        faces = self.mesh.faces[self.whole]
        is_kept = self.numbers != excluded
        is_on_plane = self.distances[:, plane] == 0.0
        edges = []
        for corners, counts in (
            (faces, np.ones(len(faces), np.int64)), (self.corners[is_kept], self.counts[is_kept]),
        ):  # fmt: skip
            corner_on_plane = is_on_plane[corners]
            for k in range(3):
                both = corner_on_plane[:, k] & corner_on_plane[:, (k + 1) % 3]
                edges.append((corners[both, k], corners[both, (k + 1) % 3], counts[both]))
        tails, heads, counts = (
            np.concatenate(part).astype(np.int64) for part in zip(*edges, strict=True)
        )
        vertices = np.concatenate([tails, heads])
        ends, first = np.unique(self.position_ids[vertices], return_index=True)
        vertices = vertices[first]
        tails, heads = (np.searchsorted(ends, self.position_ids[end]) for end in (tails, heads))
        low, high, sums = count_net_edges(tails, heads, counts)
        return vertices[low], vertices[high], sums

    def _find_outline(self, plane: int) -> Int64:
        """Return the outline of a plane's cut, (E, 2), vertices."""
        tails, heads, _ = self._find_plane_edges(plane, -1 - plane)
        return np.stack([tails, heads], axis=1)

    def _find_adjacent_vertices(self, plane: int, ends: Int64) -> tuple[Int64, Int64]:
        """
        Return the third vertex of the face at each line of a cut, (E, 2), and the face's winding.

        The vertex is -1 where the solid may not hide the line from behind: it is open or
        transparent, or another plane shows its inside.
        """
        none = np.full(len(ends), -1), np.ones(len(ends), np.int64)
        is_visible_inside = any(
            not other.cap or _shows_through(self.mesh, other)
            for number, other in enumerate(self.planes)
            if number != plane
        )
        is_solid = self.is_closed and self.mesh.material.alpha_mode == "opaque"
        if not len(ends) or not is_solid or is_visible_inside:
            return none
        faces = self.mesh.faces[self.whole].astype(np.int64)
        faces = np.concatenate([faces, self.corners[self.numbers >= 0]])
        is_on_plane = self.distances[:, plane] == 0.0
        faces = faces[np.count_nonzero(is_on_plane[faces], axis=1) == 2]
        rows = np.concatenate([np.roll(faces, -k, axis=1) for k in range(3)])
        rows = rows[is_on_plane[rows[:, 0]] & is_on_plane[rows[:, 1]] & ~is_on_plane[rows[:, 2]]]
        if not len(rows):
            return none
        tails, heads = self.position_ids[rows[:, 0]], self.position_ids[rows[:, 1]]
        keys = edge_keys(tails, heads)
        order = np.argsort(keys, kind="stable")
        tails, keys, third_vertices = tails[order], keys[order], rows[order, 2]
        line_ids = self.position_ids[ends]
        line_keys = edge_keys(*line_ids.T)
        matches = np.searchsorted(keys, line_keys).clip(max=len(keys) - 1)
        # Where several faces meet, none hides the line alone.
        is_known = (keys[matches] == line_keys) & (
            np.searchsorted(keys, line_keys, "right") == matches + 1
        )
        winding = np.where(tails[matches] == line_ids[:, 0], 1, -1) * int(self._outward)
        return np.where(is_known, third_vertices[matches], -1), winding

    def _add_caps(self, plane: int, tails: Int64, heads: Int64, sums: Int64) -> None:
        """Fill the outlines in a plane with caps."""
        outlines = OutlineFiller(self, plane)
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
        corners = _face_cut_side(self.node, self.planes[plane], self.world, corners)
        used, renumbered = self._renumber([corners])
        recipe = VertexRecipe(tuple(self.steps), used)
        material = _make_cap_material(self.mesh, self.planes[plane], self.part_color)
        return _make_cap_node(
            self.node, self.planes[plane], self.mesh, renumbered[corners], recipe, material
        )


def _face_cut_side(node: Node, plane: SectionPlane, world: Float64, corners: Int64) -> NDArray[Any]:
    """Return triangles of a cap that face the removed side, whatever the winding of the mesh."""
    a, b, c = np.moveaxis(world[corners], 1, 0)
    normal = np.broadcast_to(np.array(plane.normal), a.shape)
    mirror_sign = float(transform_objects([node.world_from_model]).mirrored[0])
    is_behind = mirror_sign * math.fsum(_triple_products(normal, b - a, c - a)) < 0.0
    return corners[:, ::-1] if is_behind else corners


def _make_cap_node(
    node: Node, plane: SectionPlane, whole: Mesh, faces: NDArray[Any], recipe: VertexRecipe,
    material: Material, scalars: Float64 | None = None,
) -> Node:  # fmt: skip
    """Return a cap of a mesh as a node, given its faces, and its scalars if they are known."""
    result: Any = CutMesh.__new__(CutMesh)
    mesh = Mesh(recipe.interpolate(whole.vertices), faces, material=material, on_invalid="drop")
    result.__dict__.update(mesh.__dict__)
    result._whole, result._recipe = whole, recipe
    field = _cap_field(whole, plane)
    if field is not None:
        values = recipe.interpolate(field.values) if scalars is None else scalars
        result._field = replace(field, values=read_only(values))
    # The inverse transpose takes it to world space.
    x, y, z = plane.normal
    rows = node.world_from_model[:3, :3]
    model = (x * rows[0] + y * rows[1]) + z * rows[2]
    normals = np.tile(unit_rows(model[np.newaxis]), (len(recipe.used), 1))
    result._normals = result._vertex_normals = read_only(normals)
    return node._with_mesh(result)


def _measure_cap(cap: Node | None) -> float:
    """Return the area of a cap, world space; 0 without one."""
    if cap is None:
        return 0.0
    points = transform_points(cap.world_from_model, cap.mesh.vertices)[:, :3]
    vectors = compute_area_vectors(points, cap.mesh.faces, 1.0)
    return 0.5 * math.fsum(np.sqrt(dot_rows(vectors, vectors)).tolist())


def _triple_products(a: Float64, b: Float64, c: Float64) -> Float64:
    """Return the triple products of rows of vectors, (N,)."""
    with np.errstate(invalid="ignore", over="ignore"):
        return (
            a[:, 0] * (b[:, 1] * c[:, 2] - b[:, 2] * c[:, 1])
            + a[:, 1] * (b[:, 2] * c[:, 0] - b[:, 0] * c[:, 2])
            + a[:, 2] * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
        )


def _cap_field(mesh: Mesh, plane: SectionPlane) -> Field | None:
    """Return the scalars of a mesh's vertices if its caps show them."""
    return mesh.vertex_field if plane.cap_color == "scalars" else None


def _shows_through(mesh: Mesh, plane: SectionPlane) -> bool:
    """Tell whether a mesh's cap is see-through somewhere."""
    field = _cap_field(mesh, plane)
    if field is not None:
        return bool(field.min_alpha < np.float32(1.0))
    return isinstance(plane.cap_color, tuple) and plane.cap_color[3] < 1.0


def _make_cap_material(mesh: Mesh, plane: SectionPlane, part_color: str | None) -> Material:
    """Return the material of a mesh's caps."""
    material = mesh.material
    if isinstance(plane.cap_color, tuple):
        color = np.array(plane.cap_color)
    elif plane.cap_color == "parts" and part_color is not None:
        color = np.array(rgba("part_color", part_color))
    elif _cap_field(mesh, plane) is not None:
        color = np.append(find_base_color(mesh)[:3], 1.0)
    else:
        color = np.array(find_base_color(mesh), np.float64)
        for colors in (mesh.shown_vertex_colors(), mesh.face_colors):
            if colors is not None:
                color[:3] *= [math.fsum(column) / len(colors) for column in colors[:, :3].T]
        color = np.append(np.clip(CAP_SHADE * color[:3], 0.0, 1.0), 1.0)
    is_see_through = _shows_through(mesh, plane)
    return Material(
        shading=material.shading, base_color=tuple(color.tolist()), specular=material.specular,
        shininess=material.shininess, metallic=material.metallic, roughness=material.roughness,
        double_sided=material.double_sided, alpha_mode="blend" if is_see_through else "opaque",
    )  # fmt: skip
