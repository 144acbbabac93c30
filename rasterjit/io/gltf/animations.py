"""
Read what moves and bends a glTF file: places of nodes, skins, morph targets and animations.

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
    return compose_rows(trs_of(node))


def trs_of(node: dict[str, Any]) -> TRS:
    """Return a node's translation, rotation and scale."""
    x, y, z, w = get_numbers(node, "rotation", (0.0, 0.0, 0.0, 1.0))
    if ((x * x + y * y) + z * z) + w * w == math.inf:
        raise ValueError(f"rotation must be a unit quaternion, got {quote(node['rotation'])}")
    sx, sy, sz = get_numbers(node, "scale", (1.0, 1.0, 1.0))
    tx, ty, tz = get_numbers(node, "translation", (0.0, 0.0, 0.0))
    return TRS((tx, ty, tz), (x, y, z, w), (sx, sy, sz))


_UBYTE = 5121
"""Draco rounds numbers to eight bits or more, whatever their type."""

_ROUNDING = {5120: 4 / 127, _UBYTE: 4 / 255, 5122: 4 / 32767, 5123: 4 / 65535}
"""By how much four integer weights may miss a sum of 1, by their component type: each is
rounded by half a step, or cut off. They are scaled all the same."""

_TARGET_FIELDS = {"POSITION": "positions", "NORMAL": "normals", "TANGENT": "tangents"}
"""Fields of `MorphTargets`, by the attribute of a target in glTF."""


def read_joints_and_targets(
    file: GltfFile, primitive: dict[str, Any], count: int,
    vectors: tuple[NDArray[Any] | None, NDArray[Any] | None], label: str, left_out: LeftOut,
) -> dict[str, Any]:  # fmt: skip
    """
    Return what `Mesh` takes of a primitive's joints and targets; nothing where it has none.

    Parameters
    ----------
    file : GltfFile
    primitive : dict
    count : int
        How many vertices there are.
    vectors : (array or None, array or None)
        The normals and the tangents that the mesh has.
    label : str
        What messages call the mesh.
    left_out : LeftOut
        Notes what cannot be used.
    """
    attributes = get_object(primitive, "attributes")
    fields = _joints(file, attributes, count, label, left_out)
    targets = get_list(primitive, "targets")
    if targets:
        morphs = _targets(file, targets, count, vectors, label, left_out)
        if morphs is not None:
            fields["morph_targets"] = morphs
    return fields


def _joints(
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
        rows = [_rows(file, attributes[name], name, count, 4, label, left_out) for name in names]
        if rows[0] is not None and rows[1] is not None:
            joints.append(rows[0])
            weights.append(rows[1])
            kind = file.entry("accessors", attributes[names[1]])["componentType"]
            if file.is_overridden(attributes[names[1]]):
                kind = _UBYTE
            rounding += _ROUNDING.get(kind, 0.0)
    if not joints:
        return {}
    # Weights are at least 0 and add up to 1.
    shares = np.concatenate(weights, axis=1)
    if (shares < 0.0).any():
        left_out.note(f"weights of {label} below 0")
        shares = np.maximum(shares, 0.0)
    numbers, sums = np.concatenate(joints, axis=1), sum_rows(shares)
    is_zero = sums == 0.0
    if is_zero.any():
        left_out.note(
            f"weights of {label} that are all 0, whose vertices follow their first joint",
            int(np.count_nonzero(is_zero)),
        )
        shares[is_zero, 0] = 1.0
    is_off = np.abs(sums - 1.0) > rounding
    if (is_off & ~is_zero).any():
        left_out.note(
            f"sums of weights of {label}, which are not 1: weights are scaled",
            int(np.count_nonzero(is_off & ~is_zero)),
        )
    # Joints are whole numbers.
    is_wrong = (numbers < 0.0) | (numbers != np.floor(numbers))
    if (is_wrong & (shares > 0.0)).any():
        left_out.note(f"JOINTS of {label}, which are no whole numbers from 0")
        return {}
    return {"joints": np.where(is_wrong, 0.0, numbers), "weights": shares}


def _rows(
    file: GltfFile, number: Any, name: str, count: int, width: int, label: str, left_out: LeftOut
) -> NDArray[np.float64] | None:
    """Return finite rows of all vertices; None, with a note, if they cannot be used."""
    try:
        with np.errstate(invalid="ignore"):
            # A signalling NaN.
            values = file.array(number).astype(np.float64)
    except (ValueError, TypeError, LookupError, OSError) as error:
        left_out.note(f"{name} of {label}, which cannot be read: {reason_of(error)}")
        return None
    if values.shape != (count, width):
        left_out.note(f"{name} of {label}, which does not fit the vertices")
        return None
    if not np.isfinite(values).all():
        left_out.note(f"{name} of {label}, which has NaN or infinity")
        return None
    return values


def _targets(
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
            what = f"{name} of morph target {index}"
            rows = _rows(file, number, what, count, 3, label, left_out)
            if rows is not None:
                if name not in offsets:
                    offsets[name] = _zeros(file, len(targets), count, label)
                with np.errstate(over="ignore"):
                    offsets[name][index] = rows
    if not offsets:
        offsets["POSITION"] = _zeros(file, len(targets), count, label)
    fields: dict[str, Any] = {_TARGET_FIELDS[name]: rows for name, rows in offsets.items()}
    return MorphTargets(**fields)


def _zeros(file: GltfFile, targets: int, count: int, label: str) -> NDArray[np.float32]:
    """Return displacements of 0, (T, V, 3), counted by the file's budget."""
    # They are copied when the mesh is made, and when its creases are split.
    file.budget.take(f"the morph targets of {label}", targets * count * 3 * 12)
    return np.zeros((targets, count, 3), np.float32)


def with_morph_weights(
    entry: dict[str, Any], meshes: Sequence[Mesh], label: str, left_out: LeftOut
) -> list[Mesh]:
    """Return meshes with the morph weights and target names of their entry in the file."""
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
    required_nodes : set of int
        Numbers of the nodes that have to be there, whether anything is seen of them or not.
    animated_nodes : set of int
        Numbers of those that an animation moves.
    """

    def __init__(self, file: GltfFile, left_out: LeftOut) -> None:
        self._file = file
        self._left_out = left_out
        self._skins = _list_of(file.header, "skins", left_out)
        self._animations = _list_of(file.header, "animations", left_out)
        self.animated_nodes = self._find_targets()
        joints = {number for skin in self._skins for number in _numbers(skin, "joints")}
        self.required_nodes = self.animated_nodes | joints
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
        Give nodes their skins and weights, and the scene its animations.

        Parameters
        ----------
        scene : Scene
        nodes : dict of int to Node
            What stands for the nodes of the file; those that are in none of its scenes are added.
        """
        if self._mesh_nodes or self.required_nodes:
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
                skins[key] = self._skin(number, nodes)
            self._set_skin(node, skins[key])
        for number, animation in enumerate(self._animations):
            built = self._animation(number, animation, nodes)
            if built is not None:
                scene.animations.append(built)

    def _find_targets(self) -> set[int]:
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
        """Note nodes that are their own ancestors; each is used where it is met first."""
        children = [
            _numbers(node, "children") for node in _list_of(self._file.header, "nodes", None)
        ]
        state = [0] * len(children)
        for root in range(len(children)):
            waiting = [(root, False)]
            while waiting:
                number, is_done = waiting.pop()
                if is_done:
                    state[number] = 2
                    continue
                if state[number]:
                    continue
                state[number] = 1
                waiting.append((number, True))
                for child in children[number]:
                    if child >= len(children):
                        continue
                    if state[child] == 1:
                        self._left_out.note(f"node {child} below itself")
                    elif state[child] == 0:
                        waiting.append((child, False))

    def _node(self, number: int, nodes: dict[int, Node]) -> Node:
        """Return the node of a number, made with its ancestors if it is in no scene."""
        # A dictionary keeps their order, and finds those of a circle at once.
        missing: dict[int, None] = {}
        at = number
        while at not in nodes:
            missing[at] = None
            above = self._parents.get(at)
            if above is None or above in missing:
                break
            at = above
        node = nodes.get(at)
        for one in reversed(missing):
            entry = self._file.entry("nodes", one)
            name = str(entry.get("name", one))
            node = nodes[one] = Node(None, parent_from_node(entry), name, parent=node)
            if "matrix" not in entry:
                node._trs = trs_of(entry)
        return nodes[number]

    @cached_property
    def _parents(self) -> dict[int, int]:
        """Number of the first parent of each node."""
        parents: dict[int, int] = {}
        for number, node in enumerate(_list_of(self._file.header, "nodes", None)):
            for child in _numbers(node, "children"):
                parents.setdefault(child, number)
        return parents

    def _skin(self, number: Any, nodes: dict[int, Node]) -> Skin | None:
        """Return a skin; None, with a note, if it cannot be used."""
        label = f"skin {quote(number)}"
        try:
            entry = self._file.entry("skins", number)
            label = f"skin {brief(entry.get('name', number))}"
            joints = get_list(entry, "joints")
            if not joints:
                raise ValueError("it has no joints")
            count = len(get_list(self._file.header, "nodes"))
            for joint in joints:
                if get_integer({"joints": joint}, "joints") >= count:
                    raise ValueError(f"joints must be below {count}, got {quote(joint)}")
            binds = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
            if "inverseBindMatrices" in entry:
                binds = self._inverse_binds(entry["inverseBindMatrices"], len(joints))
            nodes_of_joints = [self._node(int(joint), nodes) for joint in joints]
            return Skin(nodes_of_joints, binds, str(entry.get("name", "")))
        except READ_ERRORS as error:
            self._left_out.note(f"{label}, which cannot be used: {reason_of(error)}")
            return None

    def _inverse_binds(self, accessor: Any, count: int) -> NDArray[np.float64]:
        """Return inverse bind matrices, (J, 4, 4), or raise ``ValueError``."""
        with np.errstate(invalid="ignore"):
            rows = self._file.array(accessor).astype(np.float64)
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

    def _animation(self, number: int, entry: Any, nodes: dict[int, Node]) -> Animation | None:
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
        built: list[Channel] = []
        animated: set[tuple[int, str]] = set()
        for index, one in enumerate(channels):
            try:
                for channel in self._channels(one, samplers, nodes):
                    if (id(channel.node), channel.path) in animated:
                        raise ValueError(f"it moves the {channel.path} of a node once more")
                    animated.add((id(channel.node), channel.path))
                    built.append(channel)
            except READ_ERRORS as error:
                self._left_out.note(f"channel {index} of {label}", reason=f": {reason_of(error)}")
        if not built:
            self._left_out.note(f"{label}, which has no channel of use")
            return None
        return Animation(name, built)

    def _channels(self, entry: Any, samplers: list[Any], nodes: dict[int, Node]) -> list[Channel]:
        """Return the channels of an entry, one for each part of the mesh for weights, or raise."""
        # Which property of which node it moves.
        channel = get_object({"channel": entry}, "channel")
        target = get_object(channel, "target")
        if POINTER in get_object(target, "extensions") or target.get("path") == "pointer":
            raise ValueError(f"{POINTER} is not read")
        path = require(target, "path")
        if path not in PATHS:
            raise ValueError(f"path must be one of {', '.join(PATHS)}, got {quote(path)}")
        number = get_integer(target, "node")
        self._file.entry("nodes", number)
        if number not in nodes:
            raise ValueError(f"node {number} is not in the scene")
        # Its keys.
        index = get_integer(channel, "sampler")
        if index >= len(samplers):
            raise ValueError(f"sampler must be below {len(samplers)}, got {index}")
        sampler = get_object({"sampler": samplers[index]}, "sampler")
        kind = one_of("interpolation", sampler.get("interpolation", "LINEAR"), INTERPOLATIONS)
        times, values = (
            self._file.array(require(sampler, key)).astype(np.float64)
            for key in ("input", "output")
        )
        if times.shape[1] != 1:
            raise ValueError(f"input must be numbers, got rows of {times.shape[1]}")
        # Their values: rows for a node, numbers for the targets of each part.
        count, parts = len(times), (3,) if kind == "CUBICSPLINE" else ()
        if path != "weights":
            width = VALUE_WIDTHS[path]
            if values.shape != (count * (3 if parts else 1), width):
                raise ValueError(
                    f"output must be {count * (3 if parts else 1)} rows of {width} for {count} "
                    f"keys, got {len(values)} of {values.shape[1]}"
                )
            animated = [nodes[number]]
        else:
            animated = [
                node for node in self._parts.get(number, ()) if node.mesh.morph_targets is not None
            ]
            if not animated:
                raise ValueError(f"node {number} has no morph targets")
            width = len(animated[0].mesh.morph_targets or ())
            if values.size != count * width * (3 if parts else 1):
                raise ValueError(
                    f"output must be {count * width * (3 if parts else 1)} numbers for {count} "
                    f"keys of {width} morph targets, got {values.size}"
                )
        shaped = values.reshape(count, *parts, width)
        return [Channel(node, path, times[:, 0], shaped, kind) for node in animated]


def _list_of(header: dict[str, Any], key: str, left_out: LeftOut | None) -> list[Any]:
    """Return a list of the header; empty, with a note, if it is none."""
    try:
        return get_list(header, key)
    except ValueError as error:
        if left_out is not None:
            left_out.note(str(error))
        return []


def _numbers(entry: Any, key: str) -> list[int]:
    """Return the non-negative integers that an entry lists under a key."""
    listed = entry.get(key) if isinstance(entry, dict) else None
    listed = listed if isinstance(listed, list) else []
    return [number for number in listed if type(number) is int and number >= 0]
