"""
Turn a 3MF file into a scene: the objects of its build, their colours, textures and lattices.

References
----------
.. [1] 3MF Consortium, "3MF Core Specification", version 1.3.
.. [2] 3MF Consortium, "3MF Production Extension", version 1.2: parts of other models.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
from rasterjit.io.primitives import Context
from rasterjit.io.resources import Resources, quote_name
from rasterjit.io.text.mesh_builder import MeshData, convert_data
from rasterjit.io.threemf.package import Package, find_all, find_attribute, strip_prefix
from rasterjit.io.threemf.parts import PROPERTY_GROUPS, Properties, make_beams, make_surfaces
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene

_RESOURCE_ELEMENTS = ("object", "texture2d", *PROPERTY_GROUPS)
_OBJECT_ELEMENTS = ("mesh", "displacementmesh", "components", "metadatagroup")
_MESH_ELEMENTS = ("vertices", "triangles", "beamlattice")

_MAX_COMPONENT_DEPTH = 1000
"""Most nested components; more count as a cycle."""

_INSTANCE_MEMORY = 16_384
"""Memory of an instance of an object: its node, and its row in each frame."""


def load_3mf(path: Path, resources: Resources, context: Context) -> Scene:
    """
    Read a ``.3mf`` file, in its own unit.

    Parameters
    ----------
    path : Path
    resources : Resources
        Has the budget of memory; the file names only what is inside it.
    context : Context

    Raises
    ------
    MeshFileError
        If the file cannot be read or shows nothing.
    """
    try:
        package = Package(path, resources.budget)
        try:
            return _SceneBuilder(package, resources, context).scene()
        finally:
            package.close()
    except MeshFileError:
        raise
    except Exception as error:
        # A damaged file can put anything in the place of anything.
        raise MeshFileError(f"{path} could not be read as .3mf: {reason_of(error)}") from error


class _Item(NamedTuple):
    """An instance of an object: a build item or a component."""

    part: str
    """Name of the model's part in the package."""
    number: str
    parent_from_object: NDArray[np.float64]
    parent: Node | None
    depth: int


class _ModelPart:
    """The objects and property groups of one model of the package."""

    def __init__(self, root: ElementTree.Element, package: Package, left_out: LeftOut,
                 resources: Resources) -> None:  # fmt: skip
        resource_elements = [one for group in find_all(root, "resources") for one in group]
        for one in resource_elements:
            if strip_prefix(one.tag) not in _RESOURCE_ELEMENTS:
                left_out.note(f"{strip_prefix(one.tag)} of a model")
        self.unit = root.get("unit", "millimeter")
        self.items = find_all(root, "build", "item")
        self.objects: dict[str, ElementTree.Element] = {}
        for one in find_all(root, "resources", "object"):
            number = one.get("id", "")
            if number in self.objects:
                raise ValueError(f"it has two objects {number[:80]!r}")
            self.objects[number] = one
        self.properties = Properties(
            resource_elements, package, left_out, resources.budget, resources.decoder
        )


class _SceneBuilder:
    """Builds the scene of the root model."""

    def __init__(self, package: Package, resources: Resources, context: Context) -> None:
        self._package, self._resources = package, resources
        self._context, self._left_out = context, context.left_out
        self._models: dict[str, _ModelPart] = {}
        self._meshes: dict[tuple[str, str], list[Mesh]] = {}
        self._used: set[tuple[str, str]] = set()
        self._scene = Scene()

    def scene(self) -> Scene:
        """Return the scene, or raise `MeshFileError`."""
        root = self._package.find_root()
        items = self._get_model(root).items
        pending = [self._make_item(item, root, None, 0) for item in items]
        pending.reverse()
        while pending:
            pending += reversed(self._add_item(pending.pop()))
        self._note_unused()
        if not self._scene.nodes:
            content = "meshes but places none" if self._holds_meshes() else "no faces"
            notes = f" ({self._left_out})" if str(self._left_out) else ""
            raise MeshFileError(f"{self._context.source} holds {content} in its build{notes}")
        return self._scene

    def _get_model(self, part: str) -> _ModelPart:
        """Return the model of a part, read once."""
        key = part.lstrip("/").lower()
        if key not in self._models:
            root = self._package.read_xml(part)
            if strip_prefix(root.tag) != "model":
                raise ValueError(f"its part {quote_name(part)} is no model")
            model = _ModelPart(root, self._package, self._left_out, self._resources)
            if self._models and model.unit != next(iter(self._models.values())).unit:
                self._left_out.note("unit of a part that is not the root model's")
            self._models[key] = model
        return self._models[key]

    def _make_item(
        self, element: ElementTree.Element, part: str, parent: Node | None, depth: int
    ) -> _Item:
        """Return the instance that a build item or a component describes."""
        other = find_attribute(element, "path")
        part = (part if other is None else other).lstrip("/").lower()
        number = element.get("objectid", "")
        self._used.add((part, number))
        return _Item(part, number, _parse_transform(element.get("transform")), parent, depth)

    def _add_item(self, item: _Item) -> list[_Item]:
        """Add an object at an instance; return the instances of its components."""
        model = self._get_model(item.part)
        if item.number not in model.objects:
            raise ValueError(f"there is no object {item.number[:80]!r}")
        if item.depth > _MAX_COMPONENT_DEPTH:
            raise ValueError(
                f"its components nest more than {_MAX_COMPONENT_DEPTH} deep, or in a circle"
            )
        element = model.objects[item.number]
        name = element.get("name") or item.number
        self._resources.budget.take(f"a place of object {name[:80]!r}", _INSTANCE_MEMORY)
        meshes = self._get_meshes(item.part, item.number)
        node = None
        for number, mesh in enumerate(meshes):
            if node is None:
                node = self._scene.add(mesh, item.parent_from_object, name, parent=item.parent)
            else:
                self._scene.add(mesh, None, f"{name} part {number + 1}", parent=node)
        components = find_all(element, "components", "component")
        if node is None and components:
            node = Node(None, item.parent_from_object, name, parent=item.parent)
            if item.parent is None:
                self._scene.add(node)
        return [self._make_item(one, item.part, node, item.depth + 1) for one in components]

    def _get_meshes(self, part: str, number: str) -> list[Mesh]:
        """Return the meshes of an object, made once for all its instances."""
        key = part, number
        if key not in self._meshes:
            parts = self._make_parts(part, number)
            self._meshes[key] = [convert_data(one, self._context) for one in parts]
        return self._meshes[key]

    def _make_parts(self, part: str, number: str) -> list[MeshData]:
        """Return the surfaces and beam lattices of an object."""
        model, all_parts = self._get_model(part), list[MeshData]()
        element = model.objects[number]
        name = element.get("name") or number
        for one in element:
            kind = strip_prefix(one.tag)
            if kind not in _OBJECT_ELEMENTS:
                self._left_out.note(f"{kind} of an object")
            if kind == "displacementmesh":
                self._left_out.note("displacement of a mesh")
            if kind not in ("mesh", "displacementmesh"):
                continue
            for inside in one:
                if strip_prefix(inside.tag) not in _MESH_ELEMENTS:
                    self._left_out.note(f"{strip_prefix(inside.tag)} of a mesh")
            vertices = _read_vertices(one)
            parts = make_surfaces(name, element, one, vertices, model.properties, self._left_out)
            for lattice in find_all(one, "beamlattice"):
                for key in ("clippingmesh", "representationmesh"):
                    self._used.add((part, lattice.get(key, "")))
                parts += make_beams(
                    name, element, lattice, vertices, model.properties, self._left_out,
                    self._resources.budget,
                )  # fmt: skip
            if not parts:
                self._left_out.note("mesh without faces")
            all_parts += parts
        return all_parts

    def _note_unused(self) -> None:
        """Note the objects that the build does not use."""
        there = {(part, number) for part, one in self._models.items() for number in one.objects}
        self._left_out.note("object that the build does not use", len(there - self._used))

    def _holds_meshes(self) -> bool:
        """Tell whether any object has a mesh."""
        objects = [one for model in self._models.values() for one in model.objects.values()]
        return any(find_all(one, "mesh") for one in objects)


def _parse_transform(text: str | None) -> NDArray[np.float64]:
    """Parse a transform; the file has 12 numbers, for row vectors."""
    matrix = np.eye(4)
    if text is not None:
        numbers = np.array([float(word) for word in text.split()])
        if len(numbers) != 12 or not np.isfinite(numbers).all():
            raise ValueError(f"a transform must be 12 finite numbers, got {text[:80]!r}")
        matrix[:3] = numbers.reshape(4, 3).T
    return matrix


def _read_vertices(mesh: ElementTree.Element) -> NDArray[np.float64]:
    """Return the vertices of a mesh, (V, 3)."""
    rows = [
        (float(one.attrib["x"]), float(one.attrib["y"]), float(one.attrib["z"]))
        for one in find_all(mesh, "vertices", "vertex")
    ]
    return np.array(rows, np.float64).reshape(-1, 3)
