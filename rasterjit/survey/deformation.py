"""
Deform the meshes of a scene by skins and morph weights.

Whatever draws or measures a scene uses deformed meshes. They are cached with their nodes and stay
the same object while the pose is the same, so that data derived from them is cached, too.

A mesh with a skin is posed in world space. So that float32 has all its digits, one that is far from
the origin, beside its size, is stored from its own middle on; one that all joints mirror is stored
mirrored, and the node mirrors it: its faces keep their sides.
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
from rasterjit.scene.skin import Posable, Skin
from rasterjit.scene.validation import read_only
from rasterjit.survey.packed_scene import writable

FAR = 64.0
"""Distance from the origin, in extents of the mesh, from which on it is stored from its middle on:
six of the 24 bits of float32."""


_SCENES: WeakKeyDictionary[Mesh, Scene] = WeakKeyDictionary()
"""Scenes of meshes that were drawn alone: of twins, which do not keep them."""


class Pose(NamedTuple):
    """What a node is drawn as, and what that follows from."""

    mesh: Mesh
    matrices: NDArray[np.float64] | None
    """(J, 4, 4): the same array as long as no joint moves; None without a skin."""
    weights: bytes
    """Of morph targets."""
    node: Node


def kernel_rows() -> Rows:
    """Return the kernels that move vertices by joints."""
    from rasterjit.pipeline.geometry import skinning

    return rows_where("a joint has moved", skinning.skin_vertices)


def scene_to_draw(what: Any) -> Scene:
    """
    Return anything that can be drawn as a scene, posed; raise ``ValueError`` if it cannot.

    That of a mesh is kept as long as the mesh, so that what is known of it is found again.
    """
    scene = _SCENES.get(what) if isinstance(what, Mesh) else as_scene(what)
    if scene is None:
        scene = _SCENES[what] = as_scene(what._twin())
    _check_lists(scene)
    return posed_scene(scene)


def _check_lists(scene: Scene) -> None:
    """Raise ``ValueError`` if something in the scene's lists is not what belongs there."""
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
                wanted = " or ".join(kind.__name__ for kind in kinds)
                article = "an" if wanted[0] in "AEIOU" else "a"
                raise ValueError(f"scene.{name}[{n}] must be {article} {wanted}, got {item!r}")
    if not scene.nodes:
        got = "labels alone" if scene.labelled else "an empty scene"
        raise ValueError(f"scene must hold at least one mesh, got {got}")


def posed_scene(scene: Scene) -> Scene:
    """Return a scene with all skins and morph weights applied; itself where nothing is posed."""
    if not Posable.was_made:
        return scene
    # Of thousands of nodes, few can be posed.
    posable = [
        number
        for number, node in enumerate(scene.nodes)
        if (mesh := getattr(node, "_mesh", None)) is not None
        and (mesh._joints is not None or mesh._morph_targets is not None)
    ]
    posed = {number: posed_node(scene.nodes[number]) for number in posable}
    if all(node is scene.nodes[number] for number, node in posed.items()):
        return scene
    changed = copy.copy(scene)
    changed.nodes = list(scene.nodes)
    for number, node in posed.items():
        changed.nodes[number] = node
    return changed


def posed_node(node: Node) -> Node:
    """Return a node, whose mesh can be posed, as it is drawn; itself where nothing poses it."""
    mesh = node.mesh
    skin, weights = node._skin, _weights_of(node, mesh)
    if skin is None and weights is None:
        return node
    matrices = None if skin is None else skin.joint_matrices()
    key = b"" if weights is None else weights.tobytes()
    known = node._posed
    if (
        known is None
        or known.mesh is not mesh
        or known.weights != key
        or not _are_same(known.matrices, matrices)
    ):
        made, place = _posed_mesh(mesh, skin, matrices, weights)
        known = Pose(mesh, matrices, key, Node(made, place, node.name))
    own = known.node
    if own._mesh._material is not mesh._material:
        own._mesh.material = mesh._material
    place = node._world_from_model if skin is None else own._world_from_model
    if own._world_from_model is not place or own.name != node.name:
        # What was drawn before may still be asked about.
        own = Node(own._mesh, None, node.name)
        own._place(place, None)
        known = known._replace(node=own)
    if node._posed is not known:
        node._posed = known
    return own


def _weights_of(node: Node, mesh: Mesh) -> NDArray[np.float64] | None:
    """Return the weights of a node's morph targets; None if all are 0."""
    targets = mesh._morph_targets
    if targets is None:
        return None
    weights = targets.weights if node._weights is None else node._weights
    return None if weights is None or not weights.any() else weights


def _are_same(known: NDArray[np.float64] | None, asked: NDArray[np.float64] | None) -> bool:
    """Tell whether joints stand where they stood."""
    if known is asked:
        return True
    return known is not None and asked is not None and known.tobytes() == asked.tobytes()


def _posed_mesh(
    mesh: Mesh, skin: Skin | None, matrices: NDArray[np.float64] | None,
    weights: NDArray[np.float64] | None,
) -> tuple[Mesh, NDArray[np.float64] | None]:  # fmt: skip
    """Return a mesh as it is posed, and where it stands in the world, None for the node's place."""
    from rasterjit.pipeline.geometry import skinning

    positions = np.array(mesh.vertices)
    # Normals that follow from faces do so after posing.
    normals = None if mesh._makes_normals else np.array(mesh.normals)
    tangents = None if mesh.tangents is None else np.array(mesh.tangents)
    if weights is not None and mesh._morph_targets is not None:
        targets = mesh._morph_targets
        positions = skinning.morph(positions, targets.positions, weights)
        if normals is not None and targets.normals is not None:
            moved = skinning.morph(normals.astype(np.float64), targets.normals, weights)
            normals = unit_rows(moved).astype(np.float32)
        if tangents is not None and targets.tangents is not None:
            moved = skinning.morph(tangents[:, :3].astype(np.float64), targets.tangents, weights)
            tangents[:, :3] = unit_rows(moved)
    place = None
    if skin is not None and matrices is not None:
        place = np.eye(4)
        if _all_mirror(matrices):
            place[0, 0] = -1.0
            matrices = matrices.copy()
            matrices[:, 0] = -matrices[:, 0]
        skinning.skin_vertices(
            (0, len(positions)), np.array(matrices), writable(mesh._joints),
            writable(mesh._joint_weights), positions,
            np.empty((0, 3), np.float32) if normals is None else normals,
            np.empty((0, 4), np.float32) if tangents is None else tangents,
        )  # fmt: skip
    made = copy.copy(mesh)
    made._rest, made._joints, made._joint_weights, made._morph_targets = mesh, None, None, None
    made._is_closed, made._uses_all = None, None
    made._tangents = None if tangents is None else read_only(tangents)
    _store_positions(made, mesh, positions)
    if normals is not None and not normals.any(axis=1).all():
        # Targets may take a normal away, and joints flatten what it stands on.
        normals = made._with_repaired(normals, mesh, f"{mesh!r} as it is posed")
    made._normals = made._vertex_normals = None if normals is None else read_only(normals)
    if place is not None:
        made._is_in_world, made._skinned = True, (mesh, matrices)
        center = _far_middle(made)
        if center is not None:
            _store_positions(made, mesh, positions - center)
            place[:3, 3] = center
            place[0, 3] *= place[0, 0]
    return made, place


def _store_positions(mesh: Mesh, rest: Mesh, positions: NDArray[np.float64]) -> None:
    """Let a posed mesh have other positions, and find its bounds."""
    mesh._vertices, mesh._bounds, mesh._invalid_vertices = read_only(positions), None, 0
    if rest._uses_all is None:
        rest._uses_all = bool(rest.used_vertices().all())
    # Long rows are looked through many times as fast as columns.
    rows = np.ascontiguousarray(positions.T)
    low, high = rows.min(axis=1), rows.max(axis=1)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        mesh._invalid_vertices = int(np.count_nonzero(~np.isfinite(positions).all(axis=1)))
    elif rest._uses_all:
        mesh._bounds = low + 0.0, high + 0.0


def _all_mirror(matrices: NDArray[np.float64]) -> bool:
    """Tell whether all joints, (J, 4, 4), turn faces inside out."""
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(matrices[:, :3, :3], 0, 2)
    with np.errstate(over="ignore", invalid="ignore"):
        determinants = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return bool((determinants < 0.0).all())


def _far_middle(mesh: Mesh) -> NDArray[np.float64] | None:
    """Return the middle of a mesh that is far from the origin beside its size, (3,), else None."""
    try:
        low, high = mesh.bounds()
    except ValueError:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        middle, extent = low / 2.0 + high / 2.0, float((high - low).max())
        is_far = float(np.abs(middle).max()) > FAR * extent
    return middle if is_far and np.isfinite(middle).all() else None
