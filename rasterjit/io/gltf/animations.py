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
    finite_numbers_of,
    list_of,
    needed,
    object_of,
    shown,
    whole_of,
)
from rasterjit.io.load_warnings import LeftOut, reason_of
from rasterjit.scene.decomposed_transform import TRS, rows_of
from rasterjit.scene.keyframes import INTERPOLATIONS, PATHS, WIDTHS, Animation, Channel
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene
from rasterjit.scene.skin import WEIGHT_ROUNDING, MorphTargets, Skin, sum_rows
from rasterjit.scene.validation import in_short, one_of


def parent_from_node(node: dict[str, Any]) -> list[list[float]]:
    """Return the rows of a node's own transform: its matrix, or the product of its parts."""
    if "matrix" in node:
        # glTF writes matrices column by column.
        columns = finite_numbers_of(node, "matrix", (0.0,) * 16)
        return [list(columns[row::4]) for row in range(4)]
    return rows_of(trs_of(node))


def trs_of(node: dict[str, Any]) -> TRS:
    """Return a node's translation, rotation and scale."""
    x, y, z, w = finite_numbers_of(node, "rotation", (0.0, 0.0, 0.0, 1.0))
    if ((x * x + y * y) + z * z) + w * w == math.inf:
        raise ValueError(f"rotation must be a unit quaternion, got {shown(node['rotation'])}")
    sx, sy, sz = finite_numbers_of(node, "scale", (1.0, 1.0, 1.0))
    tx, ty, tz = finite_numbers_of(node, "translation", (0.0, 0.0, 0.0))
    return TRS((tx, ty, tz), (x, y, z, w), (sx, sy, sz))


_BYTE = 5121
"""Draco rounds numbers to eight bits or more, whatever their type."""

_ROUNDING = {5120: 4 / 127, _BYTE: 4 / 255, 5122: 4 / 32767, 5123: 4 / 65535}
"""How far four weights may be from 1 in all as whole numbers, by the types of these: each is
rounded by half a step, or cut off. They are scaled all the same."""

_TARGETS = {"POSITION": "positions", "NORMAL": "normals", "TANGENT": "tangents"}
"""What of a target `MorphTargets` has, by its name in glTF."""


def read_posable(
    file: GltfFile, primitive: dict[str, Any], count: int,
    shown_of: tuple[NDArray[Any] | None, NDArray[Any] | None], label: str, left_out: LeftOut,
) -> dict[str, Any]:  # fmt: skip
    """
    Return what `Mesh` takes of a primitive's joints and targets; nothing where it has none.

    Parameters
    ----------
    file : GltfFile
    primitive : dict
    count : int
        How many vertices there are.
    shown_of : (array or None, array or None)
        The normals and the tangents that the mesh has.
    label : str
        What messages call the mesh.
    left_out : LeftOut
        Notes what cannot be used.
    """
    attributes = object_of(primitive, "attributes")
    found = _joints(file, attributes, count, label, left_out)
    targets = list_of(primitive, "targets")
    if targets:
        morphs = _targets(file, targets, count, shown_of, label, left_out)
        if morphs is not None:
            found["morph_targets"] = morphs
    return found


def _joints(
    file: GltfFile, attributes: dict[str, Any], count: int, label: str, left_out: LeftOut
) -> dict[str, Any]:
    """Return joints and weights, (V, 4 n); empty if there are none of use."""
    # Sets of four joints and weights, JOINTS_0 and WEIGHTS_0 and on.
    joints, weights, rounding = [], [], WEIGHT_ROUNDING
    for number in itertools.count():
        names = f"JOINTS_{number}", f"WEIGHTS_{number}"
        missing = [name for name in names if name not in attributes]
        if len(missing) == 2:
            break
        if missing:
            (given,) = set(names) - set(missing)
            left_out.note(f"{given} of {label}, which has no {missing[0]}")
            continue
        rows = [_rows(file, attributes[name], name, count, 4, label, left_out) for name in names]
        if rows[0] is not None and rows[1] is not None:
            joints.append(rows[0])
            weights.append(rows[1])
            kind = file.entry("accessors", attributes[names[1]])["componentType"]
            if file.is_decoded(attributes[names[1]]):
                kind = _BYTE
            rounding += _ROUNDING.get(kind, 0.0)
    if not joints:
        return {}
    # Weights are at least 0 and add up to 1.
    shares = np.concatenate(weights, axis=1)
    if (shares < 0.0).any():
        left_out.note(f"weights of {label} below 0")
        shares = np.maximum(shares, 0.0)
    numbers, sums = np.concatenate(joints, axis=1), sum_rows(shares)
    is_lost = sums == 0.0
    if is_lost.any():
        left_out.note(
            f"weights of {label} that are all 0, whose vertices follow their first joint",
            int(np.count_nonzero(is_lost)),
        )
        shares[is_lost, 0] = 1.0
    is_off = np.abs(sums - 1.0) > rounding
    if (is_off & ~is_lost).any():
        left_out.note(
            f"sums of weights of {label}, which are not 1: weights are scaled",
            int(np.count_nonzero(is_off & ~is_lost)),
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
    """Return finite rows of all vertices; None, with a note, if they are no use."""
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
    shown_of: tuple[NDArray[Any] | None, NDArray[Any] | None], label: str, left_out: LeftOut,
) -> MorphTargets | None:  # fmt: skip
    """Return the morph targets of a primitive, as many as it says, those of no use as nothing."""
    normals, tangents = shown_of
    is_read = {"POSITION": True, "NORMAL": normals is not None, "TANGENT": tangents is not None}
    found: dict[str, NDArray[Any]] = {}
    for place, target in enumerate(targets):
        if not isinstance(target, dict):
            left_out.note(f"morph target {place} of {label}, which is no object")
            continue
        for name, number in target.items():
            if name not in _TARGETS:
                left_out.note(f"{name[:80]} of morph targets")
                continue
            if not is_read[name]:
                continue
            what = f"{name} of morph target {place}"
            rows = _rows(file, number, what, count, 3, label, left_out)
            if rows is not None:
                if name not in found:
                    found[name] = _nothing(file, len(targets), count, label)
                with np.errstate(over="ignore"):
                    found[name][place] = rows
    if not found:
        found["POSITION"] = _nothing(file, len(targets), count, label)
    fields: dict[str, Any] = {_TARGETS[name]: rows for name, rows in found.items()}
    return MorphTargets(**fields)


def _nothing(file: GltfFile, targets: int, count: int, label: str) -> NDArray[np.float32]:
    """Return displacements of 0, (T, V, 3), that the file's budget has room for."""
    # They are copied when the mesh is made, and when its creases are split.
    file.budget.take(f"the morph targets of {label}", targets * count * 3 * 12)
    return np.zeros((targets, count, 3), np.float32)


def with_morph_weights(
    entry: dict[str, Any], meshes: Sequence[Mesh], label: str, left_out: LeftOut
) -> list[Mesh]:
    """Return meshes of an entry of the file with the weights and the names that it says."""
    if all(mesh.morph_targets is None for mesh in meshes):
        return list(meshes)
    weights: tuple[float, ...] | None = None
    names: tuple[str, ...] = ()
    try:
        if entry.get("weights") is not None:
            given = list_of(entry, "weights")
            weights = finite_numbers_of(entry, "weights", (0.0,) * len(given))
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
                f"{shown(len(weights or ()))}"
            )
        mesh._morph_targets = targets.named(
            weights if fits else None, names if len(names) == len(targets) else ()
        )
    return list(meshes)


POINTER = "KHR_animation_pointer"

ERRORS = (ValueError, TypeError, LookupError, AttributeError, OSError, MemoryError)
"""What reading damaged parts of a file raises."""


class MovingReader:
    """
    Read the skins and animations of a file.

    Parameters
    ----------
    file : GltfFile
    left_out : LeftOut
        Notes what cannot be used.

    Attributes
    ----------
    wanted : set of int
        Numbers of the nodes that have to be there, whether anything is seen of them or not.
    targets : set of int
        Numbers of those that an animation moves.
    """

    def __init__(self, file: GltfFile, left_out: LeftOut) -> None:
        self._file = file
        self._left_out = left_out
        self._skins = _list_of(file.header, "skins", left_out)
        self._animations = _list_of(file.header, "animations", left_out)
        self.targets = self._find_targets()
        joints = {number for skin in self._skins for number in _numbers(skin, "joints")}
        self.wanted = self.targets | joints
        self._drawn: list[tuple[dict[str, Any], Node]] = []
        self._parts: dict[int, list[Node]] = {}
        """What shows the mesh of each node, by its number."""

    def know_drawn(self, number: int, entry: dict[str, Any], node: Node) -> None:
        """Take a node that shows a mesh, or a part of one, with what the file says of it."""
        if "skin" in entry or "weights" in entry:
            self._drawn.append((entry, node))
        if number in self.targets:
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
        if self._drawn or self.wanted:
            self._note_circles()
        skins: dict[Any, Skin | None] = {}
        for entry, node in self._drawn:
            if "weights" in entry and node.mesh.morph_targets is not None:
                self._set_weights(entry, node)
            if "skin" not in entry:
                continue
            number = entry["skin"]
            key = number if isinstance(number, int) else shown(number)
            if key not in skins:
                skins[key] = self._skin(number, nodes)
            self._set_skin(node, skins[key])
        for number, animation in enumerate(self._animations):
            made = self._animation(number, animation, nodes)
            if made is not None:
                scene.animations.append(made)

    def _find_targets(self) -> set[int]:
        """Return the numbers of the nodes that animations move."""
        found = set()
        for animation in self._animations:
            channels = animation.get("channels") if isinstance(animation, dict) else None
            for channel in channels if isinstance(channels, list) else ():
                target = channel.get("target") if isinstance(channel, dict) else None
                number = target.get("node") if isinstance(target, dict) else None
                if isinstance(number, int) and not isinstance(number, bool):
                    found.add(number)
        return found

    def _note_circles(self) -> None:
        """Note a node that hangs below itself; it is taken where it is met first."""
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
        """Return what stands for a node, made with all above it if it is in no scene."""
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
        """The node that each node hangs below first, by their numbers."""
        found: dict[int, int] = {}
        for number, node in enumerate(_list_of(self._file.header, "nodes", None)):
            for child in _numbers(node, "children"):
                found.setdefault(child, number)
        return found

    def _skin(self, number: Any, nodes: dict[int, Node]) -> Skin | None:
        """Return a skin, or None, with a note."""
        label = f"skin {shown(number)}"
        try:
            entry = self._file.entry("skins", number)
            label = f"skin {in_short(entry.get('name', number))}"
            joints = list_of(entry, "joints")
            if not joints:
                raise ValueError("it has no joints")
            count = len(list_of(self._file.header, "nodes"))
            for joint in joints:
                if whole_of({"joints": joint}, "joints") >= count:
                    raise ValueError(f"joints must be below {count}, got {shown(joint)}")
            binds = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
            if "inverseBindMatrices" in entry:
                binds = self._binds(entry["inverseBindMatrices"], len(joints))
            found = [self._node(int(joint), nodes) for joint in joints]
            return Skin(found, binds, str(entry.get("name", "")))
        except ERRORS as error:
            self._left_out.note(f"{label}, which cannot be used: {reason_of(error)}")
            return None

    def _binds(self, accessor: Any, count: int) -> NDArray[np.float64]:
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
        """Give a node its skin, if it fits."""
        if skin is None:
            return
        try:
            node.skin = skin
        except ValueError as error:
            self._left_out.note(f"skin of node {in_short(node.name)}: {reason_of(error)}")

    def _set_weights(self, entry: dict[str, Any], node: Node) -> None:
        """Give a node the weights of its morph targets, if they fit."""
        try:
            count = len(list_of(entry, "weights"))
            if count:
                node.weights = finite_numbers_of(entry, "weights", (0.0,) * count)
        except ValueError as error:
            self._left_out.note(f"weights of node {in_short(node.name)}: {reason_of(error)}")

    def _animation(self, number: int, entry: Any, nodes: dict[int, Node]) -> Animation | None:
        """Return an animation, or None, with a note."""
        label = f"animation {number}"
        try:
            animation = object_of({label: entry}, label)
            name = str(animation.get("name", number))
            label = f"animation {in_short(name)}"
            channels, samplers = list_of(animation, "channels"), list_of(animation, "samplers")
        except ERRORS as error:
            self._left_out.note(f"{label}, which cannot be read: {reason_of(error)}")
            return None
        found: list[Channel] = []
        moved: set[tuple[int, str]] = set()
        for place, one in enumerate(channels):
            try:
                for channel in self._channels(one, samplers, nodes):
                    if (id(channel.node), channel.path) in moved:
                        raise ValueError(f"it moves the {channel.path} of a node once more")
                    moved.add((id(channel.node), channel.path))
                    found.append(channel)
            except ERRORS as error:
                self._left_out.note(f"channel {place} of {label}", reason=f": {reason_of(error)}")
        if not found:
            self._left_out.note(f"{label}, which has no channel of use")
            return None
        return Animation(name, found)

    def _channels(self, entry: Any, samplers: list[Any], nodes: dict[int, Node]) -> list[Channel]:
        """Return a channel, of weights one for each part of the mesh, or raise."""
        # Which property of which node it moves.
        channel = object_of({"channel": entry}, "channel")
        target = object_of(channel, "target")
        if POINTER in object_of(target, "extensions") or target.get("path") == "pointer":
            raise ValueError(f"{POINTER} is not read")
        path = needed(target, "path")
        if path not in PATHS:
            raise ValueError(f"path must be one of {', '.join(PATHS)}, got {shown(path)}")
        number = whole_of(target, "node")
        self._file.entry("nodes", number)
        if number not in nodes:
            raise ValueError(f"node {number} is not in the scene")
        # Its keys.
        place = whole_of(channel, "sampler")
        if place >= len(samplers):
            raise ValueError(f"sampler must be below {len(samplers)}, got {place}")
        sampler = object_of({"sampler": samplers[place]}, "sampler")
        kind = one_of("interpolation", sampler.get("interpolation", "LINEAR"), INTERPOLATIONS)
        times, values = (
            self._file.array(needed(sampler, key)).astype(np.float64) for key in ("input", "output")
        )
        if times.shape[1] != 1:
            raise ValueError(f"input must be numbers, got rows of {times.shape[1]}")
        # Their values: rows for a node, numbers for the targets of each part.
        count, parts = len(times), (3,) if kind == "CUBICSPLINE" else ()
        if path != "weights":
            width = WIDTHS[path]
            if values.shape != (count * (3 if parts else 1), width):
                raise ValueError(
                    f"output must be {count * (3 if parts else 1)} rows of {width} for {count} "
                    f"keys, got {len(values)} of {values.shape[1]}"
                )
            moved = [nodes[number]]
        else:
            moved = [
                node for node in self._parts.get(number, ()) if node.mesh.morph_targets is not None
            ]
            if not moved:
                raise ValueError(f"node {number} has no morph targets")
            width = len(moved[0].mesh.morph_targets or ())
            if values.size != count * width * (3 if parts else 1):
                raise ValueError(
                    f"output must be {count * width * (3 if parts else 1)} numbers for {count} "
                    f"keys of {width} morph targets, got {values.size}"
                )
        shaped = values.reshape(count, *parts, width)
        return [Channel(node, path, times[:, 0], shaped, kind) for node in moved]


def _list_of(header: dict[str, Any], key: str, left_out: LeftOut | None) -> list[Any]:
    """Return a list of the header, empty, with a note, if it is none."""
    try:
        return list_of(header, key)
    except ValueError as error:
        if left_out is not None:
            left_out.note(str(error))
        return []


def _numbers(entry: Any, key: str) -> list[int]:
    """Return the whole numbers from 0 that an entry lists, whatever it is."""
    found = entry.get(key) if isinstance(entry, dict) else None
    return [
        number
        for number in (found if isinstance(found, list) else ())
        if isinstance(number, int) and not isinstance(number, bool) and number >= 0
    ]
