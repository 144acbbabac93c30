"""
Read what moves the nodes of a glTF file: skins and animations.

What cannot be used is left out, with a note: a mesh without its skin stands at its node.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), sections 3.7.3, 3.11.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.io.gltf.file import GltfFile
from rasterjit.io.gltf.placing import parent_from_node, trs_of
from rasterjit.io.gltf.values import finite_numbers_of, list_of, needed, object_of, shown, whole_of
from rasterjit.io.skipped import LeftOut, reason_of
from rasterjit.scene.keyframes import INTERPOLATIONS, PATHS, WIDTHS, Animation, Channel
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene
from rasterjit.scene.skin import Skin
from rasterjit.scene.validation import in_short, one_of

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
