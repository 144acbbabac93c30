"""
Turn a glTF file into a scene: nodes, meshes, materials, cameras and lights, as it says.

Read from the file itself: trimesh drops lights, tangents, samplers and further sets of texture
coordinates, and what hangs on the node of a camera.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022).
.. [2] The Khronos Group, "KHR_lights_punctual".
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.gltf.animations import MovingReader, parent_from_node, trs_of
from rasterjit.io.gltf.extensions import (
    INSTANCING,
    LIGHTS,
    UNDERSTOOD,
    VISIBILITY,
    MissingLibraryError,
    check_library,
)
from rasterjit.io.gltf.file import ONE_OF, GltfFile
from rasterjit.io.gltf.json_checks import (
    extension_of,
    finite_numbers_of,
    finite_of,
    list_of,
    needed,
    object_of,
    shown,
    whole_of,
)
from rasterjit.io.gltf.meshes_materials import MaterialReader, MeshReader
from rasterjit.io.load_warnings import MeshFileError, reason_of
from rasterjit.io.primitives import Reading
from rasterjit.io.resources import Resources
from rasterjit.scene.camera import OrthographicCamera, PerspectiveCamera, mirrors
from rasterjit.scene.light import DirectionalLight, PointLight, SpotLight
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene
from rasterjit.scene.transforms import product_of
from rasterjit.scene.validation import in_short

NODE_BYTES = 4096
"""What a node of a scene takes."""

_IDENTITY = np.eye(4).tolist()

_WIDTHS = {"TRANSLATION": 3, "ROTATION": 4, "SCALE": 3}


def instances_of(file: GltfFile, node: dict[str, Any]) -> list[dict[str, Any]] | None:
    """
    Return what nodes below a node would say of its instances; None if it has no such.

    Parameters
    ----------
    file : GltfFile
    node : dict
        An entry of the file's nodes.

    Returns
    -------
    list of dict, or None
        Each with ``translation``, ``rotation`` and ``scale``, as far as the file has them.

    Raises
    ------
    ValueError, LookupError
        If the arrays are damaged, or of different lengths.
    """
    extensions = object_of(node, "extensions")
    if INSTANCING not in extensions:
        return None
    numbers = object_of(object_of(extensions, INSTANCING), "attributes")
    rows = {name: file.array(number) for name, number in numbers.items() if name in _WIDTHS}
    counts = {name: len(found) for name, found in rows.items()}
    if len(set(counts.values())) != 1:
        raise ValueError(f"attributes must be of one length, got {counts or 'none'}")
    for name, found in rows.items():
        if found.shape[1] != _WIDTHS[name]:
            raise ValueError(f"{name} must be {_WIDTHS[name]} numbers, got {found.shape[1]}")
    count = next(iter(counts.values()))
    file.budget.take("instances", count * NODE_BYTES)
    listed = {name.lower(): found.astype(np.float64).tolist() for name, found in rows.items()}
    return [{name: found[place] for name, found in listed.items()} for place in range(count)]


GLTF_FORMATS = ("gltf", "glb", "vrm")
"""Extensions of their files; a .vrm is a GLB file of an avatar."""


_ENTRIES = {
    *ONE_OF, "animations", "asset", "extensions", "extensionsRequired", "extensionsUsed", "extras",
    "scene", "scenes",
}  # fmt: skip
"""Entries of a file that the standard knows."""

_ATTRIBUTE = re.compile(r"POSITION|NORMAL|TANGENT|COLOR_0|(?:TEXCOORD|JOINTS|WEIGHTS)_\d+|_.*")
"""Attributes of vertices that are read where they are needed."""


def load_gltf(path: Path, resources: Resources, reading: Reading) -> Scene:
    """
    Read a ``.gltf`` or ``.glb`` file.

    Parameters
    ----------
    path : Path
    resources : Resources
        The files that it may name.
    reading : Reading

    Raises
    ------
    MeshFileError
        If the file cannot be read or shows nothing.
    """
    try:
        return _GltfScene(GltfFile(path, resources), reading).scene
    except MeshFileError:
        raise
    except Exception as error:
        # A damaged file can put anything in the place of anything.
        reason = " ".join(str(error).split())[:300] or type(error).__name__
        kind = path.suffix.lower()
        raise MeshFileError(f"{path} could not be read as {kind}: {reason}") from error


class _GltfScene:
    """Turns the file's default scene into ``scene``."""

    def __init__(self, file: GltfFile, reading: Reading) -> None:
        self.scene = Scene()
        self._file = file
        self._source, self._left_out = reading.source, reading.left_out
        self._meshes = MeshReader(file, MaterialReader(file, self._left_out), reading)
        self.scene.name_variants(self._meshes.variants)
        self._refuse_what_is_required()
        self._note_what_is_not_read()
        self._groups: dict[int, Node] = {}
        """What stands for nodes of the file that others may hang below, by their numbers."""
        self._places: dict[int, tuple[list[list[float]], bool]] = {}
        """Rows of ``world_from_node`` where lights and cameras stand, and whether that moves."""
        self._moving = MovingReader(file, self._left_out)
        for place in walk_nodes(file.header):
            try:
                self._add_node(place)
            except MeshFileError:
                raise
            except ValueError as error:
                raise ValueError(f"node {place.number}: {error}") from error
        self._moving.finish(self.scene, self._groups)
        if not self.scene.nodes:
            held = (
                "no faces, lines or points"
                if self._meshes.is_empty
                else "meshes but places none in its scene"
            )
            named = f" ({self._left_out})" if str(self._left_out) else ""
            raise MeshFileError(f"{self._source} holds {held}{named}")

    def _refuse_what_is_required(self) -> None:
        """Raise `MeshFileError` if the file says that it makes no sense without an extension."""
        required = dict.fromkeys(map(str, list_of(self._file.header, "extensionsRequired")))
        unknown = [name for name in required if name not in UNDERSTOOD]
        if unknown:
            raise MeshFileError(
                f"{self._source} must require no extension that is not read, but "
                f"extensionsRequired names {', '.join(name[:80] for name in unknown)}"
            )
        for name in required:
            try:
                check_library(name)
            except MissingLibraryError as error:
                raise MeshFileError(f"{self._source}: {error}") from None

    def _note_what_is_not_read(self) -> None:
        """Note the extensions, attributes, entries and scenes that are not shown, by name."""
        header = self._file.header
        for name, count in count_extensions(header).items():
            if name not in UNDERSTOOD:
                self._left_out.note(f"extension {name[:80]}", count)
        for key in header.keys() - _ENTRIES:
            self._left_out.note(f"entry {in_short(key)}")
        for name in _attributes_of(header):
            if not _ATTRIBUTE.fullmatch(name):
                self._left_out.note(f"attribute {in_short(name)}")
        default = header.get("scene", 0)
        for number, scene in enumerate(list_of(header, "scenes")):
            if number != default and scene != {}:
                called = scene.get("name", number) if isinstance(scene, dict) else number
                self._left_out.note(f"scene {in_short(called)}", reason=" beside the one shown")

    def _add_node(self, place: FileNode) -> None:
        """Add what stands at a node."""
        if "camera" in place.entry:
            self._add_camera(place.entry["camera"], self._standing(place, "camera"))
        light = extension_of(place.entry, LIGHTS).get("light")
        if light is not None and not place.is_hidden:
            self._add_light(light, self._standing(place, "light"))
        if "mesh" in place.entry and not place.is_hidden:
            self._add_meshes(place)
        if place.number in self._moving.wanted and place.number not in self._groups:
            self._group_at(place)
        if place.number in self._moving.targets and "matrix" not in place.entry:
            self._groups[place.number]._trs = trs_of(place.entry)

    def _standing(self, place: FileNode, what: str) -> NDArray[np.float64]:
        """
        Return ``world_from_node``, the product from the topmost on, where something stands.

        Note that what is no node does not move with one that an animation moves.
        """
        missing: list[FileNode] = []
        above: FileNode | None = place
        while above is not None and above.number not in self._places:
            missing.append(above)
            above = above.above
        rows, is_moved = (_IDENTITY, False) if above is None else self._places[above.number]
        for one in reversed(missing):
            rows = product_of(rows, one.parent_from_node)
            is_moved = is_moved or one.number in self._moving.targets
            self._places[one.number] = rows, is_moved
        if is_moved:
            self._left_out.note(f"movement of a {what}")
        return np.array(rows)

    def _add_meshes(self, place: FileNode) -> None:
        """Add the mesh of a node, a part for each primitive, or its instances."""
        instances = self._instances(place)
        if instances is not None:
            self._add_instances(place, instances)
            return
        for part, mesh in enumerate(self._meshes.read(place.entry["mesh"])):
            label = f"{place.name} part {part + 1}" if part else place.name
            if part:
                node = self.scene.add(mesh, None, label, parent=self._groups[place.number])
                self._moving.know_drawn(place.number, place.entry, node)
                continue
            parent = self._group_above(place)
            with self._naming(label):
                node = self.scene.add(mesh, np.array(place.parent_from_node), label, parent=parent)
            self._groups[place.number] = node
            self._moving.know_drawn(place.number, place.entry, node)

    def _instances(self, place: FileNode) -> list[list[list[float]]] | None:
        """Return where the instances of a node stand, or None, with a note if they are damaged."""
        try:
            found = instances_of(self._file, place.entry)
            return None if found is None else [parent_from_node(one) for one in found]
        except (ValueError, LookupError) as error:
            self._left_out.note(f"{INSTANCING} of node {place.number}: {reason_of(error)}")
            return None

    def _add_instances(self, place: FileNode, instances: list[list[list[float]]]) -> None:
        """Add a group and, below it, a node for each part of each instance."""
        meshes = self._meshes.read(place.entry["mesh"])
        if not meshes or not instances:
            return
        above = self._group_above(place)
        with self._naming(place.name):
            group = Node(None, place.parent_from_node, place.name, parent=above)
            if above is None:
                self.scene.add(group)
            self._groups[place.number] = group
            for number, node_from_instance in enumerate(instances):
                for part, mesh in enumerate(meshes):
                    label = f"{place.name} instance {number + 1}"
                    label += f" part {part + 1}" if part else ""
                    self.scene.add(mesh, np.array(node_from_instance), label, parent=group)

    @contextmanager
    def _naming(self, node: str) -> Iterator[None]:
        """Let errors name the file and a node."""
        try:
            yield
        except ValueError as error:
            raise MeshFileError(f"{self._source}: node {node!r}: {error}") from error

    def _group_above(self, place: FileNode) -> Node | None:
        """Return what a node hangs below; groups are made where a mesh hangs below them."""
        return None if place.above is None else self._group_at(place.above)

    def _group_at(self, place: FileNode) -> Node:
        """Return what stands for a node of the file; it is made, with all above, if it is not."""
        if place.number in self._groups:
            return self._groups[place.number]
        missing = [place]
        while place.above is not None and place.above.number not in self._groups:
            place = place.above
            missing.append(place)
        node = None if place.above is None else self._groups[place.above.number]
        for one in reversed(missing):
            with self._naming(one.name):
                group = Node(None, one.parent_from_node, one.name, parent=node)
            node = self._groups[one.number] = self.scene.add(group) if node is None else group
        return self._groups[missing[0].number]

    def _add_camera(self, number: Any, world_from_node: NDArray) -> None:
        """Keep the first camera, which looks along its node's -z; a mirroring node has none."""
        if self.scene.camera is not None:
            self._left_out.note("further camera")
            return
        eye, ahead, up = world_from_node[:3, 3], -world_from_node[:3, 2], world_from_node[:3, 1]
        try:
            camera = self._file.entry("cameras", number)
            if mirrors(world_from_node):
                raise ValueError("its node must not mirror, got a determinant below 0")
            kind = needed(camera, "type")
            if kind not in ("orthographic", "perspective"):
                raise ValueError(f"type must be orthographic or perspective, got {shown(kind)}")
            values = object_of(camera, kind)
            far = finite_of(values, "zfar") if "zfar" in values else math.inf
            clip = {"near": finite_of(values, "znear"), "far": far}
            if kind == "orthographic":
                height = 2.0 * finite_of(values, "ymag")
                self.scene.camera = OrthographicCamera(eye, eye + ahead, up, height=height, **clip)
            else:
                fov_y = math.degrees(finite_of(values, "yfov"))
                self.scene.camera = PerspectiveCamera(eye, eye + ahead, up, fov_y=fov_y, **clip)
        except (LookupError, ValueError) as error:
            self._left_out.note(f"camera {shown(number)}, which cannot be used: {reason_of(error)}")

    def _add_light(self, number: Any, world_from_node: NDArray) -> None:
        """
        Add a light, which shines along its node's -z or from its origin.

        glTF's diffuse surface sends back 1/pi of the light that falls on it (lux, or candela over
        distance squared); ours, all of it. So intensities are divided by pi.
        """
        position, direction = world_from_node[:3, 3], -world_from_node[:3, 2]
        try:
            found = object_of(object_of(self._file.header, "extensions"), LIGHTS)
            lights = list_of(found, "lights")
            is_place = isinstance(number, int) and not isinstance(number, bool)
            if not is_place or not 0 <= number < len(lights):
                raise LookupError(f"the file has {len(lights)} lights")
            light = object_of({"it": lights[number]}, "it")
            kind, color = needed(light, "type"), finite_numbers_of(light, "color", (1.0, 1.0, 1.0))
            intensity = _intensity(light) / math.pi
            reach = finite_of(light, "range") if "range" in light else None
            if kind == "directional":
                self.scene.lights.append(DirectionalLight(direction, color, intensity))
            elif kind == "point":
                self.scene.lights.append(PointLight(position, color, intensity, range=reach))
            elif kind == "spot":
                cone = object_of(light, "spot")
                inner = math.degrees(finite_of(cone, "innerConeAngle", 0.0))
                outer = math.degrees(finite_of(cone, "outerConeAngle", math.pi / 4.0))
                self.scene.lights.append(
                    SpotLight(position, direction, color, intensity, inner, outer, reach)
                )
            else:
                self._left_out.note(f"{str(kind)[:80]} light")
        except (LookupError, ValueError) as error:
            self._left_out.note(f"light {shown(number)}, which cannot be used: {reason_of(error)}")


def _attributes_of(header: dict[str, Any]) -> Iterator[str]:
    """Yield the name of each attribute of each primitive; what is damaged has none."""
    for mesh in list_of(header, "meshes"):
        primitives = mesh.get("primitives") if isinstance(mesh, dict) else None
        for primitive in primitives if isinstance(primitives, list) else ():
            said = primitive.get("attributes") if isinstance(primitive, dict) else None
            yield from said if isinstance(said, dict) else ()


def count_extensions(header: dict[str, Any]) -> dict[str, int]:
    """Return how often each extension is used, declared or not: 1 for one that is declared only."""
    counts: Counter[str] = Counter()
    waiting: list[Any] = [header]
    while waiting:
        one = waiting.pop()
        if isinstance(one, dict):
            held = one.get("extensions")
            counts.update(map(str, held) if isinstance(held, dict) and one is not header else ())
            waiting += [
                value
                for key, value in one.items()
                if isinstance(value, (dict, list)) and key != "extras"
            ]
        else:
            waiting += [value for value in one if isinstance(value, (dict, list))]
    declared = [*list_of(header, "extensionsUsed"), *object_of(header, "extensions")]
    return {**dict.fromkeys(map(str, declared), 1), **counts}


def _intensity(light: dict[str, Any]) -> float:
    """Return how bright a light is, as the file says it, or raise ``ValueError``."""
    value = finite_of(light, "intensity", 1.0)
    if value < 0.0:
        raise ValueError(f"intensity must be a number at least 0, got {shown(light['intensity'])}")
    return value


class FileNode(NamedTuple):
    """A node of the file."""

    number: int
    entry: dict[str, Any]
    above: FileNode | None
    """What it hangs below."""
    parent_from_node: list[list[float]]
    """Rows of its own transform."""
    is_hidden: bool
    """Whether it, or a node above it, is said to be invisible."""

    @property
    def name(self) -> str:
        """What the file calls it, or its number."""
        return str(self.entry.get("name", self.number))


def walk_nodes(header: dict[str, Any]) -> Iterator[FileNode]:
    """
    Yield every node of the file's scene, each before those below it.

    Raises
    ------
    ValueError
        Naming the node, the key and the value that is not of the kind that it must be.
    """
    nodes, scenes = list_of(header, "nodes"), list_of(header, "scenes")
    if scenes:
        number = whole_of(header, "scene", 0)
        if number >= len(scenes):
            raise ValueError(f"scene must be below {len(scenes)}, got {shown(number)}")
        roots = _numbers_of_nodes({"its scene": scenes[number]}, "its scene", "nodes", nodes)
    else:
        # A file without scenes is shown whole.
        named = {f"node {number}": node for number, node in enumerate(nodes)}
        hanging = {
            child for name in named for child in _numbers_of_nodes(named, name, "children", nodes)
        }
        roots = [number for number in range(len(nodes)) if number not in hanging]
    waiting: list[tuple[int, FileNode | None]] = [(number, None) for number in reversed(roots)]
    seen: set[int] = set()
    while waiting:
        number, above = waiting.pop()
        if number in seen:
            continue
        seen.add(number)
        name = f"node {number}"
        node = object_of({name: nodes[number]}, name)
        children = _numbers_of_nodes({name: node}, name, "children", nodes)
        try:
            rows = parent_from_node(node)
            said = extension_of(node, VISIBILITY)
            is_hidden = said.get("visible") is False or (above is not None and above.is_hidden)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
        if above is None:
            # As those of all others that are products: none is below zero.
            rows = [[value + 0.0 for value in row] for row in rows]
        place = FileNode(number, node, above, rows, is_hidden)
        yield place
        waiting += [(child, place) for child in reversed(children)]


def _numbers_of_nodes(named: dict[str, Any], name: str, key: str, nodes: list[Any]) -> list[int]:
    """Return the numbers of nodes that an entry lists, or raise ``ValueError`` naming it."""
    entry = object_of(named, name)
    if key not in entry:
        return []
    try:
        found = list_of(entry, key)
        for number in found:
            if whole_of({key: number}, key) >= len(nodes):
                if not nodes:
                    raise ValueError(f"{key} names {shown(number)}, but the file has no nodes")
                raise ValueError(f"{key} must be below {len(nodes)}, got {shown(number)}")
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    return [int(number) for number in found]
