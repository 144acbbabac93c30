"""
Read node transforms, skins, morph targets and animations of glTF files.

What cannot be used is left out, with a note: a mesh without its skin stands at its node.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), sections 3.7.2.2, 3.7.3
   and 3.11.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.io.gltf.file import GltfFile
from rasterjit.io.gltf.json_checks import (
    get_integer,
    get_list,
    get_numbers,
    get_object,
    quote,
    require,
)
from rasterjit.io.load_warnings import LeftOut, reason_of
from rasterjit.scene.decomposed_transform import TRS, compose_rows
from rasterjit.scene.keyframes import INTERPOLATIONS, PATHS, VALUE_WIDTHS, Animation, Channel
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene
from rasterjit.scene.skin import WEIGHT_ROUNDING, MorphTargets, Skin, sum_rows
from rasterjit.scene.validation import brief, one_of


def parent_from_node(node: dict[str, Any]) -> list[list[float]]:
    """Return the rows of a node's local transform: its matrix, or the product of its parts."""
    if "matrix" in node:
        # glTF writes matrices column by column.
        columns = get_numbers(node, "matrix", (0.0,) * 16)
        return [list(columns[row::4]) for row in range(4)]
    return compose_rows(read_trs(node))


def read_trs(node: dict[str, Any]) -> TRS:
    """Return a node's translation, rotation and scale."""
    x, y, z, w = get_numbers(node, "rotation", (0.0, 0.0, 0.0, 1.0))
    if ((x * x + y * y) + z * z) + w * w == math.inf:
        raise ValueError(f"rotation must be a unit quaternion, got {quote(node['rotation'])}")
    sx, sy, sz = get_numbers(node, "scale", (1.0, 1.0, 1.0))
    tx, ty, tz = get_numbers(node, "translation", (0.0, 0.0, 0.0))
    return TRS((tx, ty, tz), (x, y, z, w), (sx, sy, sz))


_UBYTE = 5121
"""OpenGL's number of uint8. Draco rounds numbers to eight bits or more, whatever their type."""

_WEIGHT_SUM_TOLERANCES = {5120: 4 / 127, _UBYTE: 4 / 255, 5122: 4 / 32767, 5123: 4 / 65535}
"""Largest rounding error of the sum of four integer weights, by their component type: each is
rounded to the nearest integer, or truncated."""

_TARGET_FIELDS = {"POSITION": "positions", "NORMAL": "normals", "TANGENT": "tangents"}
"""Fields of `MorphTargets`, by the attribute of a target in glTF."""


def read_joints_and_targets(
    file: GltfFile, primitive: dict[str, Any], count: int,
    vectors: tuple[NDArray[Any] | None, NDArray[Any] | None], label: str, left_out: LeftOut,
) -> dict[str, Any]:  # fmt: skip
    """
    Return the arguments of `Mesh` for a primitive's joints, weights and morph targets.

    Parameters
    ----------
    file : GltfFile
    primitive : dict
    count : int
        Number of vertices.
    vectors : (array or None, array or None)
        Normals and tangents of the mesh.
    label : str
        Name of the mesh in messages.
    left_out : LeftOut
        Notes what cannot be used.
    """
    attributes = get_object(primitive, "attributes")
    fields = _read_joints(file, attributes, count, label, left_out)
    targets = get_list(primitive, "targets")
    if targets:
        morphs = _read_targets(file, targets, count, vectors, label, left_out)
        if morphs is not None:
            fields["morph_targets"] = morphs
    return fields


def _read_joints(
    file: GltfFile, attributes: dict[str, Any], count: int, label: str, left_out: LeftOut
) -> dict[str, Any]:
    """Return joints and weights, (V, 4 n); empty if there are none that can be used."""
    # Sets of four joints and weights, JOINTS_0 and WEIGHTS_0 and on.
    joints, weights, rounding = [], [], WEIGHT_ROUNDING
    for number in itertools.count():
        names = f"JOINTS_{number}", f"WEIGHTS_{number}"
        missing = [name for name in names if name not in attributes]
        if len(missing) == 2:
            break
        if missing:
            (present,) = set(names) - set(missing)
            left_out.note(f"{present} of {label}, which has no {missing[0]}")
            continue
        rows = [
            _try_read_rows(file, attributes[name], count, 4, f"{name} of {label}", left_out)
            for name in names
        ]
        if rows[0] is not None and rows[1] is not None:
            joints.append(rows[0])
            weights.append(rows[1])
            kind = file.get_entry("accessors", attributes[names[1]])["componentType"]
            if file.is_overridden(attributes[names[1]]):
                kind = _UBYTE
            rounding += _WEIGHT_SUM_TOLERANCES.get(kind, 0.0)
    if not joints:
        return {}
    # Weights are at least 0 and add up to 1.
    joint_weights = np.concatenate(weights, axis=1)
    if (joint_weights < 0.0).any():
        left_out.note(f"weights of {label} below 0")
        joint_weights = np.maximum(joint_weights, 0.0)
    numbers, sums = np.concatenate(joints, axis=1), sum_rows(joint_weights)
    is_zero = sums == 0.0
    left_out.note(
        f"weights of {label} that are all 0, whose vertices follow their first joint",
        int(np.count_nonzero(is_zero)),
    )
    joint_weights[is_zero, 0] = 1.0
    is_off = (np.abs(sums - 1.0) > rounding) & ~is_zero
    left_out.note(
        f"sums of weights of {label}, which are not 1: weights are scaled",
        int(np.count_nonzero(is_off)),
    )
    # Joints are whole numbers.
    is_wrong = (numbers < 0.0) | (numbers != np.floor(numbers))
    if (is_wrong & (joint_weights > 0.0)).any():
        left_out.note(f"JOINTS of {label}, which are no whole numbers from 0")
        return {}
    return {"joints": np.where(is_wrong, 0.0, numbers), "weights": joint_weights}


def _try_read_rows(
    file: GltfFile, number: Any, count: int, width: int, label: str, left_out: LeftOut
) -> NDArray[np.float64] | None:
    """Return the rows of an accessor as float64; None, with a note, if they cannot be used."""
    try:
        return file.read_vertex_rows(number, count, (width,), label, left_out)
    except (ValueError, TypeError, LookupError, OSError) as error:
        left_out.note(f"{label}, which cannot be read: {reason_of(error)}")
        return None


def _read_targets(
    file: GltfFile, targets: list[Any], count: int,
    vectors: tuple[NDArray[Any] | None, NDArray[Any] | None], label: str, left_out: LeftOut,
) -> MorphTargets | None:  # fmt: skip
    """Return the morph targets of a primitive; those that cannot be used move nothing."""
    normals, tangents = vectors
    is_read = {"POSITION": True, "NORMAL": normals is not None, "TANGENT": tangents is not None}
    offsets: dict[str, NDArray[Any]] = {}
    for index, target in enumerate(targets):
        if not isinstance(target, dict):
            left_out.note(f"morph target {index} of {label}, which is no object")
            continue
        for name, number in target.items():
            if name not in _TARGET_FIELDS:
                left_out.note(f"{name[:80]} of morph targets")
                continue
            if not is_read[name]:
                continue
            target_label = f"{name} of morph target {index} of {label}"
            rows = _try_read_rows(file, number, count, 3, target_label, left_out)
            if rows is not None:
                if name not in offsets:
                    offsets[name] = _make_zeros(file, len(targets), count, label)
                with np.errstate(over="ignore"):
                    offsets[name][index] = rows
    if not offsets:
        offsets["POSITION"] = _make_zeros(file, len(targets), count, label)
    fields: dict[str, Any] = {_TARGET_FIELDS[name]: rows for name, rows in offsets.items()}
    return MorphTargets(**fields)


def _make_zeros(file: GltfFile, targets: int, count: int, label: str) -> NDArray[np.float32]:
    """Return displacements of 0, (T, V, 3), and count their memory."""
    # Copied when the mesh is made, and when its creases are split.
    file.budget.take(f"the morph targets of {label}", targets * count * 3 * 12)
    return np.zeros((targets, count, 3), np.float32)


def set_morph_weights(
    entry: dict[str, Any], meshes: Sequence[Mesh], label: str, left_out: LeftOut
) -> list[Mesh]:
    """Set the morph weights and target names of meshes by their entry; return the meshes."""
    if all(mesh.morph_targets is None for mesh in meshes):
        return list(meshes)
    weights: tuple[float, ...] | None = None
    names: tuple[str, ...] = ()
    try:
        if entry.get("weights") is not None:
            listed = get_list(entry, "weights")
            weights = get_numbers(entry, "weights", (0.0,) * len(listed))
        extras = entry.get("extras")
        if isinstance(extras, dict) and isinstance(extras.get("targetNames"), list):
            names = tuple(map(str, extras["targetNames"]))
    except ValueError as error:
        left_out.note(f"weights of {label}: {reason_of(error)}")
    for mesh in meshes:
        targets = mesh.morph_targets
        if targets is None:
            continue
        fits = weights is None or len(weights) == len(targets)
        if not fits:
            left_out.note(
                f"weights of {label}, which has {len(targets)} morph targets, not "
                f"{quote(len(weights or ()))}"
            )
        mesh._morph_targets = targets.with_weights(
            weights if fits else None, names if len(names) == len(targets) else ()
        )
    return list(meshes)


POINTER = "KHR_animation_pointer"

READ_ERRORS = (ValueError, TypeError, LookupError, AttributeError, OSError, MemoryError)
"""Errors that damaged parts of a file raise."""


class AnimationReader:
    """
    Read the skins and animations of a file.

    Parameters
    ----------
    file : GltfFile
    left_out : LeftOut
        Notes what cannot be used.

    Attributes
    ----------
    joint_or_animated_nodes : set of int
        Numbers of the nodes that must exist even if they show nothing: joints and animated ones.
    animated_nodes : set of int
        Numbers of the nodes that an animation moves.
    """

    def __init__(self, file: GltfFile, left_out: LeftOut) -> None:
        self._file = file
        self._left_out = left_out
        self._skins = _get_list(file.document, "skins", left_out)
        self._animations = _get_list(file.document, "animations", left_out)
        self.animated_nodes = self._find_animated_nodes()
        joints = {number for skin in self._skins for number in _get_integers(skin, "joints")}
        self.joint_or_animated_nodes = self.animated_nodes | joints
        self._mesh_nodes: list[tuple[dict[str, Any], Node]] = []
        self._parts: dict[int, list[Node]] = {}
        """Nodes that show the mesh of a node of the file, by its number."""

    def add_mesh_node(self, number: int, entry: dict[str, Any], node: Node) -> None:
        """Register a node that shows a mesh or a part of one, with its entry in the file."""
        if "skin" in entry or "weights" in entry:
            self._mesh_nodes.append((entry, node))
        if number in self.animated_nodes:
            self._parts.setdefault(number, []).append(node)

    def finish(self, scene: Scene, nodes: dict[int, Node]) -> None:
        """
        Set the skins and weights of nodes, and the animations of the scene.

        Parameters
        ----------
        scene : Scene
        nodes : dict of int to Node
            Nodes by their number in the file; joints outside the scene are added.
        """
        if self._mesh_nodes or self.joint_or_animated_nodes:
            self._note_cycles()
        skins: dict[Any, Skin | None] = {}
        for entry, node in self._mesh_nodes:
            if "weights" in entry and node.mesh.morph_targets is not None:
                self._set_weights(entry, node)
            if "skin" not in entry:
                continue
            number = entry["skin"]
            key = number if isinstance(number, int) else quote(number)
            if key not in skins:
                skins[key] = self._read_skin(number, nodes)
            self._set_skin(node, skins[key])
        for number, animation in enumerate(self._animations):
            read = self._read_animation(number, animation, nodes)
            if read is not None:
                scene.animations.append(read)

    def _find_animated_nodes(self) -> set[int]:
        """Return the numbers of the nodes that animations move."""
        numbers = set()
        for animation in self._animations:
            channels = animation.get("channels") if isinstance(animation, dict) else None
            for channel in channels if isinstance(channels, list) else ():
                target = channel.get("target") if isinstance(channel, dict) else None
                number = target.get("node") if isinstance(target, dict) else None
                if type(number) is int:
                    numbers.add(number)
        return numbers

    def _note_cycles(self) -> None:
        """Note nodes that are their own ancestors; each is used where the walk first meets it."""
        children = [
            _get_integers(node, "children")
            for node in _get_list(self._file.document, "nodes", None)
        ]
        visited: set[int] = set()
        ancestors: set[int] = set()
        for root in range(len(children)):
            pending = [(root, False)]
            while pending:
                number, is_left = pending.pop()
                if is_left:
                    ancestors.discard(number)
                    continue
                if number in visited:
                    continue
                visited.add(number)
                ancestors.add(number)
                pending.append((number, True))
                for child in children[number]:
                    if child in ancestors:
                        self._left_out.note(f"node {child} below itself")
                    elif child < len(children) and child not in visited:
                        pending.append((child, False))

    def _get_node(self, number: int, nodes: dict[int, Node]) -> Node:
        """Return the node of a number, made with its ancestors if it is in no scene."""
        # A dictionary as an ordered set: a circle of parents ends the walk.
        missing: dict[int, None] = {}
        ancestor = number
        while ancestor not in nodes:
            missing[ancestor] = None
            parent = self._parents.get(ancestor)
            if parent is None or parent in missing:
                break
            ancestor = parent
        node = nodes.get(ancestor)
        for missing_number in reversed(missing):
            entry = self._file.get_entry("nodes", missing_number)
            name = str(entry.get("name", missing_number))
            node = nodes[missing_number] = Node(None, parent_from_node(entry), name, parent=node)
            if "matrix" not in entry:
                node._trs = read_trs(entry)
        return nodes[number]

    @cached_property
    def _parents(self) -> dict[int, int]:
        """Number of the first parent of each node."""
        parents: dict[int, int] = {}
        for number, node in enumerate(_get_list(self._file.document, "nodes", None)):
            for child in _get_integers(node, "children"):
                parents.setdefault(child, number)
        return parents

    def _read_skin(self, number: Any, nodes: dict[int, Node]) -> Skin | None:
        """Return a skin; None, with a note, if it cannot be used."""
        label = f"skin {quote(number)}"
        try:
            entry = self._file.get_entry("skins", number)
            label = f"skin {brief(entry.get('name', number))}"
            joints = get_list(entry, "joints")
            if not joints:
                raise ValueError("it has no joints")
            count = len(get_list(self._file.document, "nodes"))
            for joint in joints:
                if get_integer({"joints": joint}, "joints") >= count:
                    raise ValueError(f"joints must be below {count}, got {quote(joint)}")
            binds = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
            if "inverseBindMatrices" in entry:
                binds = self._read_inverse_binds(entry["inverseBindMatrices"], len(joints))
            nodes_of_joints = [self._get_node(int(joint), nodes) for joint in joints]
            return Skin(nodes_of_joints, binds, str(entry.get("name", "")))
        except READ_ERRORS as error:
            self._left_out.note(f"{label}, which cannot be used: {reason_of(error)}")
            return None

    def _read_inverse_binds(self, accessor: Any, count: int) -> NDArray[np.float64]:
        """Return inverse bind matrices, (J, 4, 4), or raise ``ValueError``."""
        with np.errstate(invalid="ignore"):
            rows = self._file.read_array(accessor).astype(np.float64)
        if rows.shape[1] != 16 or len(rows) < count:
            raise ValueError(
                f"inverseBindMatrices must be {count} matrices of 16 numbers, got {len(rows)} of "
                f"{rows.shape[1]}"
            )
        # glTF writes matrices column by column.
        return rows[:count].reshape(-1, 4, 4).transpose(0, 2, 1)

    def _set_skin(self, node: Node, skin: Skin | None) -> None:
        """Set the skin of a node, if it fits."""
        if skin is None:
            return
        try:
            node.skin = skin
        except ValueError as error:
            self._left_out.note(f"skin of node {brief(node.name)}: {reason_of(error)}")

    def _set_weights(self, entry: dict[str, Any], node: Node) -> None:
        """Set the morph weights of a node, if they fit."""
        try:
            count = len(get_list(entry, "weights"))
            if count:
                node.weights = get_numbers(entry, "weights", (0.0,) * count)
        except ValueError as error:
            self._left_out.note(f"weights of node {brief(node.name)}: {reason_of(error)}")

    def _read_animation(self, number: int, entry: Any, nodes: dict[int, Node]) -> Animation | None:
        """Return an animation; None, with a note, if it cannot be used."""
        label = f"animation {number}"
        try:
            animation = get_object({label: entry}, label)
            name = str(animation.get("name", number))
            label = f"animation {brief(name)}"
            channels, samplers = get_list(animation, "channels"), get_list(animation, "samplers")
        except READ_ERRORS as error:
            self._left_out.note(f"{label}, which cannot be read: {reason_of(error)}")
            return None
        read: list[Channel] = []
        animated: set[tuple[int, str]] = set()
        for index, one in enumerate(channels):
            try:
                for channel in self._read_channels(one, samplers, nodes):
                    if (id(channel.node), channel.path) in animated:
                        raise ValueError(f"it moves the {channel.path} of a node once more")
                    animated.add((id(channel.node), channel.path))
                    read.append(channel)
            except READ_ERRORS as error:
                self._left_out.note(f"channel {index} of {label}", reason=f": {reason_of(error)}")
        if not read:
            self._left_out.note(f"{label}, which has no channel of use")
            return None
        return Animation(name, read)

    def _read_channels(
        self, entry: Any, samplers: list[Any], nodes: dict[int, Node]
    ) -> list[Channel]:
        """Return the channels of an entry, one for each part of the mesh for weights, or raise."""
        # The animated property and its node.
        channel = get_object({"channel": entry}, "channel")
        target = get_object(channel, "target")
        if POINTER in get_object(target, "extensions") or target.get("path") == "pointer":
            raise ValueError(f"{POINTER} is not read")
        path = require(target, "path")
        if path not in PATHS:
            raise ValueError(f"path must be one of {', '.join(PATHS)}, got {quote(path)}")
        number = get_integer(target, "node")
        self._file.get_entry("nodes", number)
        if number not in nodes:
            raise ValueError(f"node {number} is not in the scene")
        # The keys.
        index = get_integer(channel, "sampler")
        if index >= len(samplers):
            raise ValueError(f"sampler must be below {len(samplers)}, got {index}")
        sampler = get_object({"sampler": samplers[index]}, "sampler")
        kind = one_of("interpolation", sampler.get("interpolation", "LINEAR"), INTERPOLATIONS)
        times, values = (
            self._file.read_array(require(sampler, key)).astype(np.float64)
            for key in ("input", "output")
        )
        if times.shape[1] != 1:
            raise ValueError(f"input must be numbers, got rows of {times.shape[1]}")
        # Their values: a row for a key, or a number for each morph target. Splines have tangents.
        count, parts = len(times), (3,) if kind == "CUBICSPLINE" else ()
        value_count = count * (3 if parts else 1)
        if path != "weights":
            width = VALUE_WIDTHS[path]
            if values.shape != (value_count, width):
                raise ValueError(
                    f"output must be {value_count} rows of {width} for {count} keys, got "
                    f"{len(values)} of {values.shape[1]}"
                )
            animated = [nodes[number]]
        else:
            animated = [
                node for node in self._parts.get(number, ()) if node.mesh.morph_targets is not None
            ]
            if not animated:
                raise ValueError(f"node {number} has no morph targets")
            width = len(animated[0].mesh.morph_targets or ())
            if values.size != value_count * width:
                raise ValueError(
                    f"output must be {value_count * width} numbers for {count} keys of {width} "
                    f"morph targets, got {values.size}"
                )
        shaped = values.reshape(count, *parts, width)
        return [Channel(node, path, times[:, 0], shaped, kind) for node in animated]


def _get_list(document: dict[str, Any], key: str, left_out: LeftOut | None) -> list[Any]:
    """Return a list of the document; empty, with a note, if its value is no list."""
    try:
        return get_list(document, key)
    except ValueError as error:
        if left_out is not None:
            left_out.note(str(error))
        return []


def _get_integers(entry: Any, key: str) -> list[int]:
    """Return the non-negative integers that an entry lists under a key."""
    listed = entry.get(key) if isinstance(entry, dict) else None
    listed = listed if isinstance(listed, list) else []
    return [number for number in listed if type(number) is int and number >= 0]
