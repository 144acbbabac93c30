"""
Put the shapes that skins and morphs of a COLLADA file bind where they were bound.

References
----------
.. [1] The Khronos Group, "COLLADA - Digital Asset Schema Release 1.4.1", chapters 4 and 5.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.skipped import LeftOut
from rasterjit.io.trimesh.xml import SKINNED
from rasterjit.scene.transforms import compose, rotate, scale, translate

_MOST_BOUND = 8
"""Controllers that bind one another: a skin of a morph, and room."""


def with_bound_shapes(path: Path, left_out: LeftOut) -> bytes | None:
    """
    Return a COLLADA file in which geometry stands for what deforms it, or None if nothing does.

    A skin is placed by its bind shape and by its first joint, as the file's nodes stand: exact
    where all joints stand as they were bound.

    Parameters
    ----------
    path : Path
    left_out : LeftOut
        Counts what is shown, and notes that it does not move.
    """
    content = path.read_bytes()
    if b"instance_controller" not in content:
        return None
    try:
        file = _Collada(ElementTree.fromstring(content))
    except ElementTree.ParseError:
        # Its reader says what is wrong.
        return None
    for instance in file.instances():
        shape = file.shape(instance.get("url", ""))
        if shape is not None:
            file.replace(instance, shape)
            left_out.read(SKINNED)
            kind = "skin" if shape.is_skin else "morph"
            left_out.note(f"movement of a {kind}, which is shown as it was bound")
    file.remove_controllers()
    return ElementTree.tostring(file.root)


class _Shape(NamedTuple):
    """A geometry as a controller bound it."""

    geometry: str
    matrix: NDArray[np.float64]
    """Relative to the world or, if it has no joints, to the node that it hangs below."""
    is_in_world: bool
    is_skin: bool


class _Collada:
    """The elements of a file, by what names them."""

    def __init__(self, root: ElementTree.Element) -> None:
        self.root = root
        self._space = root.tag.rpartition("}")[0] + "}" if "}" in root.tag else ""
        self._above = {child: parent for parent in root.iter() for child in parent}
        self._by_id = {one.get("id"): one for one in root.iter() if one.get("id")}
        self._nodes = {
            one.get(key): one
            for key in ("name", "id", "sid")
            for one in root.iter(f"{self._space}node")
        }

    def instances(self) -> list[ElementTree.Element]:
        """Return what nodes show of controllers."""
        return list(self.root.iter(f"{self._space}instance_controller"))

    def shape(self, name: str) -> _Shape | None:
        """Return the geometry below a controller; None if there is none."""
        placed, is_in_world, is_skin = np.eye(4), False, False
        for _ in range(_MOST_BOUND):
            element = self._by_id.get(name.removeprefix("#"))
            if element is None:
                return None
            if element.tag == f"{self._space}geometry":
                return _Shape(name, placed, is_in_world, is_skin)
            skin, morph = (element.find(f"{self._space}{kind}") for kind in ("skin", "morph"))
            binding = morph if skin is None else skin
            if binding is None:
                return None
            if skin is not None:
                is_skin, joint = True, self._world_from_bound(skin)
                placed = _matrix(skin.findtext(f"{self._space}bind_shape_matrix", ""))
                if joint is not None:
                    is_in_world, placed = True, compose(joint, placed)
            name = binding.get("source", "")
        return None

    def replace(self, instance: ElementTree.Element, shape: _Shape) -> None:
        """Put a geometry in the place of what was to deform it."""
        parent = self._above[instance]
        parent.remove(instance)
        if shape.is_in_world:
            while parent in self._above and parent.tag != f"{self._space}visual_scene":
                parent = self._above[parent]
        node = ElementTree.SubElement(parent, f"{self._space}node")
        matrix = ElementTree.SubElement(node, f"{self._space}matrix")
        matrix.text = " ".join(map(repr, shape.matrix.ravel().tolist()))
        said = ElementTree.SubElement(node, f"{self._space}instance_geometry", url=shape.geometry)
        said.extend(instance.findall(f"{self._space}bind_material"))

    def remove_controllers(self) -> None:
        """Remove what nothing needs any more, and what could be refused."""
        for library in self.root.findall(f"{self._space}library_controllers"):
            self.root.remove(library)

    def _world_from_bound(self, skin: ElementTree.Element) -> NDArray[np.float64] | None:
        """Return where the first joint of a skin puts what is bound to it, if its node is there."""
        names = self._values(skin, "JOINT")
        node = self._nodes.get(names[0]) if names else None
        inverse = self._values(skin, "INV_BIND_MATRIX")[:16]
        if node is None or len(inverse) < 16:
            return None
        matrix = _matrix(" ".join(inverse))
        above: ElementTree.Element | None = node
        while above is not None and above.tag == f"{self._space}node":
            matrix = compose(self._parent_from_node(above), matrix)
            above = self._above.get(above)
        # Below what is instanced elsewhere, the world is not known.
        is_placed = above is not None and above.tag == f"{self._space}visual_scene"
        return matrix if is_placed else None

    def _values(self, skin: ElementTree.Element, semantic: str) -> list[str]:
        """Return the words of a source of the joints of a skin."""
        for one in skin.findall(f"{self._space}joints/{self._space}input"):
            source = self._by_id.get(one.get("source", "").removeprefix("#"))
            if one.get("semantic") == semantic and source is not None and len(source):
                return (source[0].text or "").split()
        return []

    def _parent_from_node(self, node: ElementTree.Element) -> NDArray[np.float64]:
        """Return the transform of a node: the product of its steps."""
        matrix = np.eye(4)
        for one in node:
            kind = one.tag.removeprefix(self._space)
            if kind == "matrix":
                matrix = compose(matrix, _matrix(one.text or ""))
            elif kind in ("translate", "rotate", "scale"):
                numbers = [float(word) for word in (one.text or "").split()]
                if kind == "rotate":
                    matrix = compose(matrix, rotate(numbers[:3], numbers[3]))
                else:
                    step = translate if kind == "translate" else scale
                    matrix = compose(matrix, step(numbers))
        return matrix


def _matrix(said: str) -> NDArray[np.float64]:
    """Return a matrix of 16 numbers, row by row; the identity where nothing is said."""
    if not said.strip():
        return np.eye(4)
    return np.array([float(word) for word in said.split()]).reshape(4, 4)
