"""
Deform the meshes of a scene by skins and morph weights.

Deformed meshes are cached with their nodes and stay the same object while the pose is the same, so
that data derived from them is cached, too.

A mesh with a skin is posed in world space. One that is far from the origin for its size is stored
relative to its centre, so that float32 keeps its digits; one that all joints mirror is stored
mirrored, and the node mirrors it back, so that its faces keep their winding.
"""

from __future__ import annotations

import copy
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.meshes import as_scene
from rasterjit.pipeline.passes import Rows, rows_where
from rasterjit.scene.light import AmbientLight, DirectionalLight, PointLight, SpotLight
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.normals import unit_rows
from rasterjit.scene.scene import Scene
from rasterjit.scene.skin import Deformable, Skin
from rasterjit.scene.validation import read_only
from rasterjit.survey.packed_scene import writable

MAX_OFFSET_EXTENTS = 64.0
"""Distance from the origin, in extents of the mesh, beyond which it is stored from its centre:
six of the 24 bits of float32."""

_SCENE_BY_MESH: WeakKeyDictionary[Mesh, Scene] = WeakKeyDictionary()
"""Cached scenes of meshes that are drawn alone; they hold aliases, which keep no mesh alive."""


class Pose(NamedTuple):
    """A posed node with the mesh, matrices and weights that it depends on."""

    mesh: Mesh
    matrices: NDArray[np.float64] | None
    """(J, 4, 4): the same array as long as no joint moves; None without a skin."""
    weights: bytes
    """Weights of morph targets."""
    node: Node


def list_skinning_kernels() -> Rows:
    """Return the kernels of skinning, for `list_kernels`."""
    from rasterjit.pipeline.geometry import skinning

    return rows_where("a joint has moved", skinning.skin_vertices)


def pose_input(source: Any) -> Scene:
    """
    Convert anything that can be drawn to a posed scene, or raise ``ValueError``.

    The scene of a mesh is cached as long as the mesh exists.
    """
    scene = _SCENE_BY_MESH.get(source) if isinstance(source, Mesh) else as_scene(source)
    if scene is None:
        scene = _SCENE_BY_MESH[source] = as_scene(source._alias())
    check_lists(scene)
    return pose_scene(scene)


def check_lists(scene: Scene) -> None:
    """Raise ``ValueError`` if the scene's lists hold anything but nodes and lights, or no mesh."""
    for name, items, kinds in (
        ("nodes", scene.nodes, (Node,)),
        ("lights", scene.lights, (AmbientLight, DirectionalLight, PointLight, SpotLight)),
    ):
        if not isinstance(items, (list, tuple)):
            raise ValueError(f"scene.{name} must be a list, got {items!r}")
        if set(map(type, items)).issubset(kinds):
            continue
        for n, item in enumerate(items):
            if not isinstance(item, kinds):
                expected = " or ".join(kind.__name__ for kind in kinds)
                article = "an" if expected[0] in "AEIOU" else "a"
                raise ValueError(f"scene.{name}[{n}] must be {article} {expected}, got {item!r}")
    if not scene.nodes:
        got = "labels alone" if scene.labelled else "an empty scene"
        raise ValueError(f"scene must hold at least one mesh, got {got}")


def pose_scene(scene: Scene) -> Scene:
    """Return a scene with all skins and morph weights applied; itself where nothing is posed."""
    if not Deformable.any_made:
        return scene
    # Of thousands of nodes, few can be posed.
    posable = [
        number
        for number, node in enumerate(scene.nodes)
        if (mesh := getattr(node, "_mesh", None)) is not None
        and (mesh._joints is not None or mesh._morph_targets is not None)
    ]
    posed = {number: pose_node(scene.nodes[number]) for number in posable}
    if all(node is scene.nodes[number] for number, node in posed.items()):
        return scene
    result = copy.copy(scene)
    result.nodes = list(scene.nodes)
    for number, node in posed.items():
        result.nodes[number] = node
    return result


def pose_node(node: Node) -> Node:
    """Return a node with its mesh posed; the node itself where nothing poses it."""
    mesh = node.mesh
    skin, weights = node._skin, _find_active_weights(node, mesh)
    if skin is None and weights is None:
        return node
    matrices = None if skin is None else skin.joint_matrices()
    key = b"" if weights is None else weights.tobytes()
    cached = node._pose_cache
    if (
        cached is None
        or cached.mesh is not mesh
        or cached.weights != key
        or not _are_same_joints(cached.matrices, matrices)
    ):
        posed, matrix = _pose_mesh(mesh, skin, matrices, weights)
        cached = Pose(mesh, matrices, key, Node(posed, matrix, node.name, section=node._is_cut))
    result = cached.node
    if result._mesh._material is not mesh._material:
        result._mesh.material = mesh._material
    matrix = node._world_from_model if skin is None else result._world_from_model
    if result._world_from_model is not matrix or (result.name, result._section) != (
        node.name,
        node._is_cut,
    ):
        # Earlier frames may still refer to the old node.
        result = Node(result._mesh, None, node.name, section=node._is_cut)
        result._move(matrix, None)
        cached = cached._replace(node=result)
    if node._pose_cache is not cached:
        node._pose_cache = cached
    return result


def _find_active_weights(node: Node, mesh: Mesh) -> NDArray[np.float64] | None:
    """Return the weights of a node's morph targets; None if all are 0."""
    targets = mesh._morph_targets
    if targets is None:
        return None
    weights = targets.weights if node._weights is None else node._weights
    return None if weights is None or not weights.any() else weights


def _are_same_joints(
    cached: NDArray[np.float64] | None, matrices: NDArray[np.float64] | None
) -> bool:
    """Tell whether the matrices of joints are the same arrays as before."""
    if cached is matrices:
        return True
    return cached is not None and matrices is not None and cached.tobytes() == matrices.tobytes()


def _pose_mesh(
    mesh: Mesh, skin: Skin | None, matrices: NDArray[np.float64] | None,
    weights: NDArray[np.float64] | None,
) -> tuple[Mesh, NDArray[np.float64] | None]:  # fmt: skip
    """Return a posed mesh, and its world matrix, None for the node's own."""
    from rasterjit.pipeline.geometry import skinning

    positions = np.array(mesh.vertices)
    # Normals that follow from faces do so after posing.
    normals = None if mesh._derives_normals else np.array(mesh.normals)
    tangents = None if mesh.tangents is None else np.array(mesh.tangents)
    if weights is not None and mesh._morph_targets is not None:
        targets = mesh._morph_targets
        positions = skinning.apply_morph_targets(positions, targets.positions, weights)
        if normals is not None and targets.normals is not None:
            morphed = skinning.apply_morph_targets(
                normals.astype(np.float64), targets.normals, weights
            )
            normals = unit_rows(morphed).astype(np.float32)
        if tangents is not None and targets.tangents is not None:
            morphed = skinning.apply_morph_targets(
                tangents[:, :3].astype(np.float64), targets.tangents, weights
            )
            tangents[:, :3] = unit_rows(morphed)
    matrix = None
    if skin is not None and matrices is not None:
        matrix = np.eye(4)
        if _do_all_mirror(matrices):
            matrix[0, 0] = -1.0
            matrices = matrices.copy()
            matrices[:, 0] = -matrices[:, 0]
        skinning.skin_vertices(
            (0, len(positions)), np.array(matrices), writable(mesh._joints),
            writable(mesh._joint_weights), positions,
            np.empty((0, 3), np.float32) if normals is None else normals,
            np.empty((0, 4), np.float32) if tangents is None else tangents,
        )  # fmt: skip
    posed = copy.copy(mesh)
    posed._rest_mesh, posed._joints, posed._joint_weights = mesh, None, None
    posed._morph_targets = posed._is_closed = posed._all_used = None
    posed._tangents = None if tangents is None else read_only(tangents)
    _store_positions(posed, mesh, positions)
    if normals is not None and not normals.any(axis=1).all():
        # Targets may take a normal away, and joints flatten what it stands on.
        normals = posed._repair_normals(normals, mesh, f"{mesh!r} as it is posed")
    posed._normals = posed._vertex_normals = None if normals is None else read_only(normals)
    if matrix is not None:
        posed._is_in_world, posed._skin_source = True, (mesh, matrices)
        center = _find_offset_center(posed)
        if center is not None:
            _store_positions(posed, mesh, positions - center)
            matrix[:3, 3] = center
            matrix[0, 3] *= matrix[0, 0]
    return posed, matrix


def _store_positions(mesh: Mesh, rest: Mesh, positions: NDArray[np.float64]) -> None:
    """Store the positions of a posed mesh, and compute its bounds."""
    mesh._vertices, mesh._bounds, mesh._invalid_vertices = read_only(positions), None, 0
    if rest._all_used is None:
        rest._all_used = bool(rest.used_vertices().all())
    # Rows in one piece are reduced many times as fast as columns.
    rows = np.ascontiguousarray(positions.T)
    low, high = rows.min(axis=1), rows.max(axis=1)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        mesh._invalid_vertices = int(np.count_nonzero(~np.isfinite(positions).all(axis=1)))
    elif rest._all_used:
        mesh._bounds = low + 0.0, high + 0.0


def _do_all_mirror(matrices: NDArray[np.float64]) -> bool:
    """Tell whether all joints, (J, 4, 4), mirror."""
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(matrices[:, :3, :3], 0, 2)
    with np.errstate(over="ignore", invalid="ignore"):
        determinants = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return bool((determinants < 0.0).all())


def _find_offset_center(mesh: Mesh) -> NDArray[np.float64] | None:
    """Return the centre of a mesh that is far from the origin for its size, (3,), else None."""
    try:
        low, high = mesh.bounds()
    except ValueError:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        center, extent = low / 2.0 + high / 2.0, float((high - low).max())
        is_far = float(np.abs(center).max()) > MAX_OFFSET_EXTENTS * extent
    return center if is_far and np.isfinite(center).all() else None
