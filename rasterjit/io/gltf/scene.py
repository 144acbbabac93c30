"""
Convert a glTF file to a scene: nodes, meshes, materials, cameras and lights.

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

from rasterjit.io.gltf.animations import AnimationReader, parent_from_node, read_trs
from rasterjit.io.gltf.extensions import (
    INSTANCING,
    LIGHTS,
    SUPPORTED_EXTENSIONS,
    VISIBILITY,
    MissingLibraryError,
    check_library,
)
from rasterjit.io.gltf.file import ENTRY_NAMES, GltfFile
from rasterjit.io.gltf.json_checks import (
    get_extension,
    get_integer,
    get_list,
    get_number,
    get_numbers,
    get_object,
    quote,
    require,
)
from rasterjit.io.gltf.meshes_materials import MaterialReader, MeshReader
from rasterjit.io.load_warnings import MeshFileError, reason_of
from rasterjit.io.primitives import Context
from rasterjit.io.resources import Resources
from rasterjit.scene.camera import OrthographicCamera, PerspectiveCamera, mirrors
from rasterjit.scene.light import DirectionalLight, PointLight, SpotLight
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene
from rasterjit.scene.transforms import product_of
from rasterjit.scene.validation import brief

MEMORY_PER_NODE = 4096
"""Bytes of memory for a node of a scene."""

_IDENTITY = np.eye(4).tolist()

_TRS_WIDTHS = {"TRANSLATION": 3, "ROTATION": 4, "SCALE": 3}


def read_instances(file: GltfFile, node: dict[str, Any]) -> list[dict[str, Any]] | None:
    """
    Return each instance's transform, as a dict like a node's entry; None without instances.

    Parameters
    ----------
    file : GltfFile
    node : dict
        An entry of the file's nodes.

    Returns
    -------
    list of dict, or None
        Those of ``translation``, ``rotation`` and ``scale`` that the file has.

    Raises
    ------
    ValueError, LookupError
        If the arrays are damaged, or of different lengths.
    """
    extensions = get_object(node, "extensions")
    if INSTANCING not in extensions:
        return None
    accessor_by_name = get_object(get_object(extensions, INSTANCING), "attributes")
    arrays = {
        name: file.read_array(number)
        for name, number in accessor_by_name.items()
        if name in _TRS_WIDTHS
    }
    counts = {name: len(values) for name, values in arrays.items()}
    if len(set(counts.values())) != 1:
        raise ValueError(f"attributes must be of one length, got {counts or 'none'}")
    for name, values in arrays.items():
        if values.shape[1] != _TRS_WIDTHS[name]:
            raise ValueError(f"{name} must be {_TRS_WIDTHS[name]} numbers, got {values.shape[1]}")
    count = next(iter(counts.values()))
    file.budget.take("instances", count * MEMORY_PER_NODE)
    listed = {name.lower(): values.astype(np.float64).tolist() for name, values in arrays.items()}
    return [{name: values[number] for name, values in listed.items()} for number in range(count)]


GLTF_FORMATS = ("gltf", "glb", "vrm")
"""Extensions of glTF files; a .vrm is a GLB file of an avatar."""


_DOCUMENT_KEYS = {
    *ENTRY_NAMES, "animations", "asset", "extensions", "extensionsRequired", "extensionsUsed",
    "extras", "scene", "scenes",
}  # fmt: skip
"""Keys of the document that the standard defines."""

_READ_ATTRIBUTE = re.compile(r"POSITION|NORMAL|TANGENT|COLOR_0|(?:TEXCOORD|JOINTS|WEIGHTS)_\d+|_.*")
"""Names of vertex attributes that are read."""


def load_gltf(path: Path, resources: Resources, context: Context) -> Scene:
    """
    Read a glTF file (`GLTF_FORMATS`).

    Parameters
    ----------
    path : Path
    resources : Resources
        The files that it may name.
    context : Context

    Raises
    ------
    MeshFileError
        If the file cannot be read or shows nothing.
    """
    try:
        return _GltfScene(GltfFile(path, resources), context).scene
    except MeshFileError:
        raise
    except Exception as error:
        # A damaged file may have a value of any type anywhere.
        reason = " ".join(str(error).split())[:300] or type(error).__name__
        kind = path.suffix.lower()
        raise MeshFileError(f"{path} could not be read as {kind}: {reason}") from error


class _GltfScene:
    """Builds ``scene`` from the file's default scene."""

    def __init__(self, file: GltfFile, context: Context) -> None:
        self.scene = Scene()
        self._file = file
        self._source, self._left_out = context.source, context.left_out
        self._meshes = MeshReader(file, MaterialReader(file, self._left_out), context)
        self.scene.set_file_variants(self._meshes.variants)
        self._check_required_extensions()
        self._note_unread()
        self._nodes: dict[int, Node] = {}
        """Nodes of the scene, by their numbers in the file."""
        self._world_transforms: dict[int, tuple[list[list[float]], bool]] = {}
        """Rows of ``world_from_node`` by number, and whether an animation moves the node."""
        self._animations = AnimationReader(file, self._left_out)
        for file_node in walk_nodes(file.document):
            try:
                self._add_node(file_node)
            except MeshFileError:
                raise
            except ValueError as error:
                raise ValueError(f"node {file_node.number}: {error}") from error
        self._animations.finish(self.scene, self._nodes)
        if not self.scene.nodes:
            content = (
                "no faces, lines or points"
                if self._meshes.is_empty
                else "meshes but places none in its scene"
            )
            notes = f" ({self._left_out})" if str(self._left_out) else ""
            raise MeshFileError(f"{self._source} holds {content}{notes}")

    def _check_required_extensions(self) -> None:
        """Raise `MeshFileError` if the file requires an extension that is not supported."""
        required = dict.fromkeys(map(str, get_list(self._file.document, "extensionsRequired")))
        unknown = [name for name in required if name not in SUPPORTED_EXTENSIONS]
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

    def _note_unread(self) -> None:
        """Note the extensions, attributes, document keys and scenes that are not read."""
        document = self._file.document
        for name, count in count_extensions(document).items():
            if name not in SUPPORTED_EXTENSIONS:
                self._left_out.note(f"extension {name[:80]}", count)
        for key in document.keys() - _DOCUMENT_KEYS:
            self._left_out.note(f"entry {brief(key)}")
        for name in _iterate_attribute_names(document):
            if not _READ_ATTRIBUTE.fullmatch(name):
                self._left_out.note(f"attribute {brief(name)}")
        default = document.get("scene", 0)
        for number, scene in enumerate(get_list(document, "scenes")):
            if number != default and scene != {}:
                called = scene.get("name", number) if isinstance(scene, dict) else number
                self._left_out.note(f"scene {brief(called)}", reason=" beside the one shown")

    def _add_node(self, file_node: FileNode) -> None:
        """Add the camera, light and meshes of a node; make joints and moving nodes anyway."""
        if "camera" in file_node.entry:
            world_from_node = self._compute_world_transform(file_node, "camera")
            self._add_camera(file_node.entry["camera"], world_from_node)
        light = get_extension(file_node.entry, LIGHTS).get("light")
        if light is not None and not file_node.is_hidden:
            self._add_light(light, self._compute_world_transform(file_node, "light"))
        if "mesh" in file_node.entry and not file_node.is_hidden:
            self._add_meshes(file_node)
        if file_node.number in self._animations.joint_or_animated_nodes:
            self._get_or_make_node(file_node)
        if file_node.number in self._animations.animated_nodes and "matrix" not in file_node.entry:
            self._nodes[file_node.number]._trs = read_trs(file_node.entry)

    def _compute_world_transform(self, file_node: FileNode, kind: str) -> NDArray[np.float64]:
        """Return ``world_from_node``; note if animations would move this camera or light."""
        missing: list[FileNode] = []
        parent: FileNode | None = file_node
        while parent is not None and parent.number not in self._world_transforms:
            missing.append(parent)
            parent = parent.parent
        rows, is_animated = _IDENTITY, False
        if parent is not None:
            rows, is_animated = self._world_transforms[parent.number]
        for node in reversed(missing):
            rows = product_of(rows, node.parent_from_node)
            is_animated = is_animated or node.number in self._animations.animated_nodes
            self._world_transforms[node.number] = rows, is_animated
        if is_animated:
            self._left_out.note(f"movement of a {kind}")
        return np.array(rows)

    def _add_meshes(self, file_node: FileNode) -> None:
        """Add a node for each primitive of a node's mesh, or for each of its instances."""
        instances = self._try_read_instances(file_node)
        if instances is not None:
            self._add_instances(file_node, instances)
            return
        for part, mesh in enumerate(self._meshes.read(file_node.entry["mesh"])):
            label = f"{file_node.name} part {part + 1}" if part else file_node.name
            if part:
                node = self.scene.add(mesh, None, label, parent=self._nodes[file_node.number])
                self._animations.add_mesh_node(file_node.number, file_node.entry, node)
                continue
            parent = self._get_or_make_parent(file_node)
            with self._name_node_in_errors(label):
                node = self.scene.add(
                    mesh, np.array(file_node.parent_from_node), label, parent=parent
                )
            self._nodes[file_node.number] = node
            self._animations.add_mesh_node(file_node.number, file_node.entry, node)

    def _try_read_instances(self, file_node: FileNode) -> list[list[list[float]]] | None:
        """Return the transforms of a node's instances; None, with a note, if they are damaged."""
        try:
            entries = read_instances(self._file, file_node.entry)
            return None if entries is None else [parent_from_node(one) for one in entries]
        except (ValueError, LookupError) as error:
            self._left_out.note(f"{INSTANCING} of node {file_node.number}: {reason_of(error)}")
            return None

    def _add_instances(self, file_node: FileNode, instances: list[list[list[float]]]) -> None:
        """Add a group with a node for each primitive of each instance."""
        meshes = self._meshes.read(file_node.entry["mesh"])
        if not meshes or not instances:
            return
        parent = self._get_or_make_parent(file_node)
        with self._name_node_in_errors(file_node.name):
            group = Node(None, file_node.parent_from_node, file_node.name, parent=parent)
            if parent is None:
                self.scene.add(group)
            self._nodes[file_node.number] = group
            for number, node_from_instance in enumerate(instances):
                for part, mesh in enumerate(meshes):
                    label = f"{file_node.name} instance {number + 1}"
                    label += f" part {part + 1}" if part else ""
                    self.scene.add(mesh, np.array(node_from_instance), label, parent=group)

    @contextmanager
    def _name_node_in_errors(self, node_name: str) -> Iterator[None]:
        """Let errors name the file and a node."""
        try:
            yield
        except ValueError as error:
            raise MeshFileError(f"{self._source}: node {node_name!r}: {error}") from error

    def _get_or_make_parent(self, file_node: FileNode) -> Node | None:
        """Return the parent of a file's node, made if it does not exist; None for a root."""
        return None if file_node.parent is None else self._get_or_make_node(file_node.parent)

    def _get_or_make_node(self, file_node: FileNode) -> Node:
        """Return the scene's node of a file's node, made with its ancestors if it is missing."""
        if file_node.number in self._nodes:
            return self._nodes[file_node.number]
        missing = [file_node]
        while file_node.parent is not None and file_node.parent.number not in self._nodes:
            file_node = file_node.parent
            missing.append(file_node)
        node = None if file_node.parent is None else self._nodes[file_node.parent.number]
        for one in reversed(missing):
            with self._name_node_in_errors(one.name):
                group = Node(None, one.parent_from_node, one.name, parent=node)
            node = self._nodes[one.number] = self.scene.add(group) if node is None else group
        return self._nodes[missing[0].number]

    def _add_camera(self, number: Any, world_from_node: NDArray) -> None:
        """Set the scene's camera, which looks along its node's -z; note further cameras."""
        if self.scene.camera is not None:
            self._left_out.note("further camera")
            return
        eye, ahead, up = world_from_node[:3, 3], -world_from_node[:3, 2], world_from_node[:3, 1]
        try:
            camera = self._file.get_entry("cameras", number)
            if mirrors(world_from_node):
                raise ValueError("its node must not mirror, got a determinant below 0")
            kind = require(camera, "type")
            if kind not in ("orthographic", "perspective"):
                raise ValueError(f"type must be orthographic or perspective, got {quote(kind)}")
            values = get_object(camera, kind)
            far = get_number(values, "zfar") if "zfar" in values else math.inf
            clip = {"near": get_number(values, "znear"), "far": far}
            if kind == "orthographic":
                height = 2.0 * get_number(values, "ymag")
                self.scene.camera = OrthographicCamera(eye, eye + ahead, up, height=height, **clip)
            else:
                fov_y = math.degrees(get_number(values, "yfov"))
                self.scene.camera = PerspectiveCamera(eye, eye + ahead, up, fov_y=fov_y, **clip)
        except (LookupError, ValueError) as error:
            self._left_out.note(f"camera {quote(number)}, which cannot be used: {reason_of(error)}")

    def _add_light(self, number: Any, world_from_node: NDArray) -> None:
        """
        Add a light, which shines along its node's -z or from its origin.

        glTF's diffuse surface sends back 1/pi of the light that falls on it (lux, or candela over
        distance squared); ours, all of it. So intensities are divided by pi.
        """
        position, direction = world_from_node[:3, 3], -world_from_node[:3, 2]
        try:
            extension = get_object(get_object(self._file.document, "extensions"), LIGHTS)
            lights = get_list(extension, "lights")
            if type(number) is not int or not 0 <= number < len(lights):
                raise LookupError(f"the file has {len(lights)} lights")
            light = get_object({"it": lights[number]}, "it")
            kind, color = require(light, "type"), get_numbers(light, "color", (1.0, 1.0, 1.0))
            intensity = _read_intensity(light) / math.pi
            light_range = get_number(light, "range") if "range" in light else None
            if kind == "directional":
                self.scene.lights.append(DirectionalLight(direction, color, intensity))
            elif kind == "point":
                self.scene.lights.append(PointLight(position, color, intensity, range=light_range))
            elif kind == "spot":
                cone = get_object(light, "spot")
                inner = math.degrees(get_number(cone, "innerConeAngle", 0.0))
                outer = math.degrees(get_number(cone, "outerConeAngle", math.pi / 4.0))
                self.scene.lights.append(
                    SpotLight(position, direction, color, intensity, inner, outer, light_range)
                )
            else:
                self._left_out.note(f"{str(kind)[:80]} light")
        except (LookupError, ValueError) as error:
            self._left_out.note(f"light {quote(number)}, which cannot be used: {reason_of(error)}")


def _iterate_attribute_names(document: dict[str, Any]) -> Iterator[str]:
    """Yield the attribute names of all primitives; damaged entries are skipped."""
    for mesh in get_list(document, "meshes"):
        primitives = mesh.get("primitives") if isinstance(mesh, dict) else None
        for primitive in primitives if isinstance(primitives, list) else ():
            attributes = primitive.get("attributes") if isinstance(primitive, dict) else None
            yield from attributes if isinstance(attributes, dict) else ()


def count_extensions(document: dict[str, Any]) -> dict[str, int]:
    """Count the uses of each extension; 1 for one that is only declared."""
    counts: Counter[str] = Counter()
    pending: list[Any] = [document]
    while pending:
        one = pending.pop()
        if isinstance(one, dict):
            used = one.get("extensions")
            counts.update(map(str, used) if isinstance(used, dict) and one is not document else ())
            pending += [
                value
                for key, value in one.items()
                if isinstance(value, (dict, list)) and key != "extras"
            ]
        else:
            pending += [value for value in one if isinstance(value, (dict, list))]
    declared = [*get_list(document, "extensionsUsed"), *get_object(document, "extensions")]
    return {**dict.fromkeys(map(str, declared), 1), **counts}


def _read_intensity(light: dict[str, Any]) -> float:
    """Return the intensity of a light, or raise ``ValueError``."""
    value = get_number(light, "intensity", 1.0)
    if value < 0.0:
        raise ValueError(f"intensity must be a number at least 0, got {quote(light['intensity'])}")
    return value


class FileNode(NamedTuple):
    """A node of the file."""

    number: int
    entry: dict[str, Any]
    parent: FileNode | None
    parent_from_node: list[list[float]]
    """Rows of its local transform."""
    is_hidden: bool
    """Whether it or an ancestor is invisible."""

    @property
    def name(self) -> str:
        """Its name, or its number if it has none."""
        return str(self.entry.get("name", self.number))


def walk_nodes(document: dict[str, Any]) -> Iterator[FileNode]:
    """
    Yield every node of the file's scene, each before those below it.

    Raises
    ------
    ValueError
        Naming the node, the key and the value that is not of the kind that it must be.
    """
    nodes, scenes = get_list(document, "nodes"), get_list(document, "scenes")
    if scenes:
        number = get_integer(document, "scene", 0)
        if number >= len(scenes):
            raise ValueError(f"scene must be below {len(scenes)}, got {quote(number)}")
        roots = _read_node_numbers({"its scene": scenes[number]}, "its scene", "nodes", nodes)
    else:
        # A file without scenes is shown whole.
        entries = {f"node {number}": node for number, node in enumerate(nodes)}
        inner = {
            child
            for name in entries
            for child in _read_node_numbers(entries, name, "children", nodes)
        }
        roots = [number for number in range(len(nodes)) if number not in inner]
    pending: list[tuple[int, FileNode | None]] = [(number, None) for number in reversed(roots)]
    visited: set[int] = set()
    while pending:
        number, parent = pending.pop()
        if number in visited:
            continue
        visited.add(number)
        name = f"node {number}"
        node = get_object({name: nodes[number]}, name)
        children = _read_node_numbers({name: node}, name, "children", nodes)
        try:
            rows = parent_from_node(node)
            flags = get_extension(node, VISIBILITY)
            is_hidden = flags.get("visible") is False or (parent is not None and parent.is_hidden)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
        if parent is None:
            # No negative zeros, as in the products of other nodes.
            rows = [[value + 0.0 for value in row] for row in rows]
        file_node = FileNode(number, node, parent, rows, is_hidden)
        yield file_node
        pending += [(child, file_node) for child in reversed(children)]


def _read_node_numbers(entries: dict[str, Any], name: str, key: str, nodes: list[Any]) -> list[int]:
    """Return the node numbers that an entry lists, or raise ``ValueError`` naming the entry."""
    entry = get_object(entries, name)
    if key not in entry:
        return []
    try:
        numbers = get_list(entry, key)
        for number in numbers:
            if get_integer({key: number}, key) >= len(nodes):
                if not nodes:
                    raise ValueError(f"{key} names {quote(number)}, but the file has no nodes")
                raise ValueError(f"{key} must be below {len(nodes)}, got {quote(number)}")
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    return [int(number) for number in numbers]
