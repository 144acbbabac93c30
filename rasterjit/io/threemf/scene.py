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
from rasterjit.io.primitives import Reading
from rasterjit.io.resources import Resources, shown_name
from rasterjit.io.text.mesh_builder import Part, mesh_of_part
from rasterjit.io.threemf.package import Package, attribute, children, local_name
from rasterjit.io.threemf.parts import GROUPS, Properties, beam_part, surface_parts
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.scene import Scene

_READ_RESOURCES = ("object", "texture2d", *GROUPS)
_READ_IN_OBJECTS = ("mesh", "displacementmesh", "components", "metadatagroup")
_READ_IN_MESHES = ("vertices", "triangles", "beamlattice")

_DEEPEST = 1000
"""Components within each other; more are taken for a circle."""

_PLACE_BYTES = 16_384
"""What an object takes at each place where it stands: its node, and its row in each frame."""


def load_3mf(path: Path, resources: Resources, reading: Reading) -> Scene:
    """
    Read a ``.3mf`` file, in its own unit.

    Parameters
    ----------
    path : Path
    resources : Resources
        Has the budget of memory; the file names only what is inside it.
    reading : Reading

    Raises
    ------
    MeshFileError
        If the file cannot be read or shows nothing.
    """
    try:
        package = Package(path, resources.budget)
        try:
            return _SceneBuilder(package, resources, reading).scene()
        finally:
            package.close()
    except MeshFileError:
        raise
    except Exception as error:
        # A damaged file can put anything in the place of anything.
        raise MeshFileError(f"{path} could not be read as .3mf: {reason_of(error)}") from error


class _Place(NamedTuple):
    """Where an object stands."""

    part: str
    """The part of the package whose model has it."""
    number: str
    parent_from_object: NDArray[np.float64]
    above: Node | None
    depth: int


class _ModelPart:
    """The objects and properties of one part of the package that is a model."""

    def __init__(self, root: ElementTree.Element, package: Package, left_out: LeftOut,
                 resources: Resources) -> None:  # fmt: skip
        found = [one for group in children(root, "resources") for one in group]
        for one in found:
            if local_name(one.tag) not in _READ_RESOURCES:
                left_out.note(f"{local_name(one.tag)} of a model")
        self.unit = root.get("unit", "millimeter")
        self.builds = children(root, "build")
        self.objects: dict[str, ElementTree.Element] = {}
        for one in found:
            if local_name(one.tag) == "object":
                number = one.get("id", "")
                if number in self.objects:
                    raise ValueError(f"it has two objects {number[:80]!r}")
                self.objects[number] = one
        self.properties = Properties(found, package, left_out, resources.budget, resources.decoder)


class _SceneBuilder:
    """Builds the scene of the root model."""

    def __init__(self, package: Package, resources: Resources, reading: Reading) -> None:
        self._package, self._resources = package, resources
        self._reading, self._left_out = reading, reading.left_out
        self._models: dict[str, _ModelPart] = {}
        self._meshes: dict[tuple[str, str], list[Mesh]] = {}
        self._used: set[tuple[str, str]] = set()
        self._scene = Scene()

    def scene(self) -> Scene:
        """Return the scene, or raise `MeshFileError`."""
        root = self._package.root_model()
        waiting = [
            self._placed(item, root, None, 0)
            for build in self._model(root).builds
            for item in children(build, "item")
        ]
        waiting.reverse()
        while waiting:
            waiting += reversed(self._stand(waiting.pop()))
        self._note_unused()
        if not self._scene.nodes:
            held = "meshes but places none" if self._holds_meshes() else "no faces"
            named = f" ({self._left_out})" if str(self._left_out) else ""
            raise MeshFileError(f"{self._reading.source} holds {held} in its build{named}")
        return self._scene

    def _model(self, part: str) -> _ModelPart:
        """Return the model of a part."""
        key = part.lstrip("/").lower()
        if key not in self._models:
            root = self._package.tree(part)
            if local_name(root.tag) != "model":
                raise ValueError(f"its part {shown_name(part)} is no model")
            model = _ModelPart(root, self._package, self._left_out, self._resources)
            if self._models and model.unit != next(iter(self._models.values())).unit:
                self._left_out.note("unit of a part that is not the root model's")
            self._models[key] = model
        return self._models[key]

    def _placed(
        self, element: ElementTree.Element, part: str, above: Node | None, depth: int
    ) -> _Place:
        """Return where an item of the build, or a component, puts which object."""
        other = attribute(element, "path")
        part = (part if other is None else other).lstrip("/").lower()
        number = element.get("objectid", "")
        self._used.add((part, number))
        return _Place(part, number, _matrix(element.get("transform")), above, depth)

    def _stand(self, place: _Place) -> list[_Place]:
        """Add an object at its place; return where its components stand."""
        model = self._model(place.part)
        if place.number not in model.objects:
            raise ValueError(f"there is no object {place.number[:80]!r}")
        if place.depth > _DEEPEST:
            raise ValueError(f"its components nest more than {_DEEPEST} deep, or in a circle")
        element = model.objects[place.number]
        name = element.get("name") or place.number
        self._resources.budget.take(f"a place of object {name[:80]!r}", _PLACE_BYTES)
        meshes = self._meshes_of(place.part, place.number)
        node = None
        for number, mesh in enumerate(meshes):
            if node is None:
                node = self._scene.add(mesh, place.parent_from_object, name, parent=place.above)
            else:
                self._scene.add(mesh, None, f"{name} part {number + 1}", parent=node)
        components = [
            one for group in children(element, "components") for one in children(group, "component")
        ]
        if node is None and components:
            node = Node(None, place.parent_from_object, name, parent=place.above)
            if place.above is None:
                self._scene.add(node)
        return [self._placed(one, place.part, node, place.depth + 1) for one in components]

    def _meshes_of(self, part: str, number: str) -> list[Mesh]:
        """Return the meshes of an object, made once for all its places."""
        key = part, number
        if key not in self._meshes:
            self._meshes[key] = [
                mesh_of_part(one, self._reading) for one in self._parts(self._model(part), number)
            ]
        return self._meshes[key]

    def _parts(self, model: _ModelPart, number: str) -> list[Part]:
        """Return the surfaces and the lattice of an object."""
        element, found = model.objects[number], list[Part]()
        name = element.get("name") or number
        for one in element:
            kind = local_name(one.tag)
            if kind not in _READ_IN_OBJECTS:
                self._left_out.note(f"{kind} of an object")
            if kind == "displacementmesh":
                self._left_out.note("displacement of a mesh")
            if kind not in ("mesh", "displacementmesh"):
                continue
            for inside in one:
                if local_name(inside.tag) not in _READ_IN_MESHES:
                    self._left_out.note(f"{local_name(inside.tag)} of a mesh")
            vertices = _vertices(one)
            parts = surface_parts(name, element, one, vertices, model.properties, self._left_out)
            for lattice in children(one, "beamlattice"):
                for key in ("clippingmesh", "representationmesh"):
                    self._used.add((self._part_of(model), lattice.get(key, "")))
                parts += beam_part(
                    name, element, lattice, vertices, model.properties, self._left_out,
                    self._resources.budget,
                )  # fmt: skip
            if not parts:
                self._left_out.note("mesh without faces")
            found += parts
        return found

    def _part_of(self, model: _ModelPart) -> str:
        """Return the part that a model is read from."""
        return next(part for part, one in self._models.items() if one is model)

    def _note_unused(self) -> None:
        """Note the objects that stand nowhere."""
        there = {(part, number) for part, one in self._models.items() for number in one.objects}
        self._left_out.note("object that the build does not use", len(there - self._used))

    def _holds_meshes(self) -> bool:
        """Tell whether any object has a mesh."""
        objects = [one for model in self._models.values() for one in model.objects.values()]
        return any(children(one, "mesh") for one in objects)


def _matrix(said: str | None) -> NDArray[np.float64]:
    """Return a transform of column vectors; the file has 12 numbers, for row vectors."""
    matrix = np.eye(4)
    if said is not None:
        numbers = np.array([float(word) for word in said.split()])
        if len(numbers) != 12 or not np.isfinite(numbers).all():
            raise ValueError(f"a transform must be 12 finite numbers, got {said[:80]!r}")
        matrix[:3] = numbers.reshape(4, 3).T
    return matrix


def _vertices(mesh: ElementTree.Element) -> NDArray[np.float64]:
    """Return the vertices of a mesh, (V, 3)."""
    rows = [
        (float(one.attrib["x"]), float(one.attrib["y"]), float(one.attrib["z"]))
        for group in children(mesh, "vertices")
        for one in children(group, "vertex")
    ]
    return np.array(rows, np.float64).reshape(-1, 3)
