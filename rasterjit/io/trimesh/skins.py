"""
Put the shapes that skins and morphs of a COLLADA file bind where they were bound.

References
----------
.. [1] The Khronos Group, "COLLADA - Digital Asset Schema Release 1.4.1", chapters 4 and 5.
"""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Container
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.load_warnings import LeftOut
from rasterjit.io.resources import MAX_NAME_LENGTH, quote_name
from rasterjit.scene.transforms import compose, rotate, scale, translate

SKINNED = "skinned or morphed geometry"

_UNREAD_INSTANCES = {
    "instance_controller": SKINNED, "instance_camera": "camera", "instance_light": "light",
}  # fmt: skip
"""Instances in a COLLADA scene that trimesh does not read."""

_SVG = "{http://www.w3.org/2000/svg"

_SVG_ELEMENTS = (
    "path", "circle", "rect", "line", "polyline", "polygon", "svg", "g", "a", "defs", "symbol",
    "title", "desc", "metadata", "style", "namedview",
)  # fmt: skip
"""Elements of an SVG file that trimesh reads, and those that show nothing by themselves."""

_READ_BRUSH = "SolidColorBrush"


def note_unread_elements(path: Path, extension: str, left_out: LeftOut) -> None:
    """
    Note the elements of a file that trimesh does not read.

    Parameters
    ----------
    path : Path
    extension : str
        ``"dae"``, ``"zae"``, ``"xaml"`` or ``"svg"``; of others nothing is known.
    left_out : LeftOut
    """
    note = {
        "dae": _note_collada, "zae": _note_collada, "xaml": _note_brushes, "svg": _note_shapes,
    }.get(extension)  # fmt: skip
    if note is None:
        return
    try:
        if extension == "zae":
            with zipfile.ZipFile(path) as archive:
                name = next(one for one in archive.namelist() if one.lower().endswith(".dae"))
                root = ElementTree.fromstring(archive.read(name))
        else:
            root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, ValueError, StopIteration):
        # What trimesh could read all the same.
        return
    note(root, left_out)


def _note_collada(root: ElementTree.Element, left_out: LeftOut) -> None:
    """Note animations and external references of a COLLADA file, and numbers that drop faces."""
    _note_other_files(root, left_out)
    for library in root:
        for element in library if _strip_name_space(library) == "library_animations" else ():
            if _strip_name_space(element) == "animation":
                left_out.note("animation")
    for element in root.iter():
        if _strip_name_space(element) == "float_array" and not _are_finite(element.text or ""):
            left_out.note("faces at vertices that are no finite numbers, if any")


_FACES = ("triangles", "polylist", "polygons", "tristrips", "trifans")
"""Elements of a COLLADA geometry that hold faces."""


def unbind_broken_materials(
    content: bytes, read: Container[str], left_out: LeftOut
) -> bytes | None:
    """
    Remove the materials of geometries of a COLLADA file that were not read for their sake.

    A material that refers to nothing, such as a picture that is not declared, makes the reader
    pass over all faces that it is bound to.

    Parameters
    ----------
    content : bytes
    read : container of str
        Names of the geometries that were read.
    left_out : LeftOut
        Notes the materials.

    Returns
    -------
    bytes or None
        None if no such geometry was passed over.
    """
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError:
        return None
    with_faces = {
        element.get("id", "")
        for element in root.iter()
        if _strip_name_space(element) == "geometry"
        and any(_strip_name_space(one) in _FACES for one in element.iter())
    }
    count = 0
    for instance in root.iter():
        name = instance.get("url", "")[1:]
        if _strip_name_space(instance) != "instance_geometry" or name not in with_faces:
            continue
        bound = [one for one in instance if _strip_name_space(one) == "bind_material"]
        if bound and name not in read:
            left_out.note(f"materials of geometry {name[:MAX_NAME_LENGTH]!r}, which are broken")
            instance[:] = [one for one in instance if one not in bound]
            count += 1
    return ElementTree.tostring(root) if count else None


def _are_finite(text: str) -> bool:
    """Tell whether all numbers of a text are finite as float32."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            return bool(np.isfinite(np.fromstring(text, np.float32, sep=" ")).all())
    except (ValueError, DeprecationWarning):
        return False


def _note_other_files(root: ElementTree.Element, left_out: LeftOut) -> None:
    """Note references of a COLLADA file to libraries in other files."""
    for element in root.iter():
        kind = _strip_name_space(element)
        if not kind.startswith("instance_"):
            continue
        if kind in _UNREAD_INSTANCES:
            left_out.expect(_UNREAD_INSTANCES[kind])
        for key in ("url", "target"):
            address = element.get(key, "").strip()
            if address and not address.startswith("#"):
                left_out.note(f"{kind} of a library in another file, {quote_name(address)}")


def _note_brushes(root: ElementTree.Element, left_out: LeftOut) -> None:
    """Note brushes of a XAML file other than single colours."""
    for model in root.iter():
        if _strip_name_space(model) != "GeometryModel3D":
            continue
        for material in model.iter():
            # A name with a dot is a field that holds materials.
            if not _strip_name_space(material).endswith("Material") or "." in _strip_name_space(
                material
            ):
                continue
            brushes = [brush for holder in material for brush in holder]
            for brush in brushes:
                kind = _strip_name_space(brush)
                if kind.endswith("Brush") and kind != _READ_BRUSH:
                    picture = brush.get("ImageSource")
                    image = f" {quote_name(picture)}" if picture else ""
                    left_out.note(f"{kind}{image} of a {_strip_name_space(material)}")


def _note_shapes(root: ElementTree.Element, left_out: LeftOut) -> None:
    """Note elements of an SVG file that are not read."""
    for element in root.iter():
        space = element.tag.rpartition("}")[0] if isinstance(element.tag, str) else "{other"
        if space in ("", _SVG) and _strip_name_space(element) not in _SVG_ELEMENTS:
            left_out.note(f"{_strip_name_space(element)} element")


def _strip_name_space(element: ElementTree.Element) -> str:
    """Return the name of an element without its name space."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


_MAX_CONTROLLERS = 8
"""Most nested controllers: a skin of a morph, with a margin."""


def bake_controllers(path: Path, left_out: LeftOut) -> bytes | None:
    """
    Replace the controllers of a COLLADA file by their bound geometry; None if it has none.

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
            left_out.mark_read(SKINNED)
            kind = "skin" if shape.is_skin else "morph"
            left_out.note(f"movement of a {kind}, which is shown as it was bound")
    file.remove_controllers()
    return ElementTree.tostring(file.root)


class _Shape(NamedTuple):
    """The geometry of a controller in its bind pose."""

    geometry: str
    matrix: NDArray[np.float64]
    """Relative to the world if the skin has joints, else to the node."""
    is_in_world: bool
    is_skin: bool


class _Collada:
    """A COLLADA document with indices by id and parent."""

    def __init__(self, root: ElementTree.Element) -> None:
        self.root = root
        self._xmlns = root.tag.rpartition("}")[0] + "}" if "}" in root.tag else ""
        self._parents = {child: parent for parent in root.iter() for child in parent}
        self._by_id = {one.get("id"): one for one in root.iter() if one.get("id")}
        self._nodes = {
            one.get(key): one
            for key in ("name", "id", "sid")
            for one in root.iter(f"{self._xmlns}node")
        }

    def instances(self) -> list[ElementTree.Element]:
        """Return the instances of controllers."""
        return list(self.root.iter(f"{self._xmlns}instance_controller"))

    def shape(self, name: str) -> _Shape | None:
        """Return the bound geometry of a controller, or None."""
        matrix, is_in_world, is_skin = np.eye(4), False, False
        for _ in range(_MAX_CONTROLLERS):
            element = self._by_id.get(name.removeprefix("#"))
            if element is None:
                return None
            if element.tag == f"{self._xmlns}geometry":
                return _Shape(name, matrix, is_in_world, is_skin)
            skin, morph = (element.find(f"{self._xmlns}{kind}") for kind in ("skin", "morph"))
            binding = morph if skin is None else skin
            if binding is None:
                return None
            if skin is not None:
                is_skin, joint = True, self._compute_world_from_bound(skin)
                matrix = _parse_matrix(skin.findtext(f"{self._xmlns}bind_shape_matrix", ""))
                if joint is not None:
                    is_in_world, matrix = True, compose(joint, matrix)
            name = binding.get("source", "")
        return None

    def replace(self, instance: ElementTree.Element, shape: _Shape) -> None:
        """Replace an instance of a controller by a node with its geometry."""
        parent = self._parents[instance]
        parent.remove(instance)
        if shape.is_in_world:
            while parent in self._parents and parent.tag != f"{self._xmlns}visual_scene":
                parent = self._parents[parent]
        node = ElementTree.SubElement(parent, f"{self._xmlns}node")
        matrix = ElementTree.SubElement(node, f"{self._xmlns}matrix")
        matrix.text = " ".join(map(repr, shape.matrix.ravel().tolist()))
        inner = ElementTree.SubElement(node, f"{self._xmlns}instance_geometry", url=shape.geometry)
        inner.extend(instance.findall(f"{self._xmlns}bind_material"))

    def remove_controllers(self) -> None:
        """Remove the controllers, which are not used any more."""
        for library in self.root.findall(f"{self._xmlns}library_controllers"):
            self.root.remove(library)

    def _compute_world_from_bound(self, skin: ElementTree.Element) -> NDArray[np.float64] | None:
        """Return the transform of the first joint times its inverse bind matrix, or None."""
        names = self._read_words(skin, "JOINT")
        node = self._nodes.get(names[0]) if names else None
        inverse = self._read_words(skin, "INV_BIND_MATRIX")[:16]
        if node is None or len(inverse) < 16:
            return None
        matrix = _parse_matrix(" ".join(inverse))
        ancestor: ElementTree.Element | None = node
        while ancestor is not None and ancestor.tag == f"{self._xmlns}node":
            matrix = compose(self._parent_from_node(ancestor), matrix)
            ancestor = self._parents.get(ancestor)
        # Below what is instanced elsewhere, the world is not known.
        is_placed = ancestor is not None and ancestor.tag == f"{self._xmlns}visual_scene"
        return matrix if is_placed else None

    def _read_words(self, skin: ElementTree.Element, semantic: str) -> list[str]:
        """Return the words of a source of a skin's joints."""
        for one in skin.findall(f"{self._xmlns}joints/{self._xmlns}input"):
            source = self._by_id.get(one.get("source", "").removeprefix("#"))
            if one.get("semantic") == semantic and source is not None and len(source):
                return (source[0].text or "").split()
        return []

    def _parent_from_node(self, node: ElementTree.Element) -> NDArray[np.float64]:
        """Return the local transform of a node."""
        matrix = np.eye(4)
        for one in node:
            kind = one.tag.removeprefix(self._xmlns)
            if kind == "matrix":
                matrix = compose(matrix, _parse_matrix(one.text or ""))
            elif kind in ("translate", "rotate", "scale"):
                numbers = [float(word) for word in (one.text or "").split()]
                if kind == "rotate":
                    matrix = compose(matrix, rotate(numbers[:3], numbers[3]))
                else:
                    step = translate if kind == "translate" else scale
                    matrix = compose(matrix, step(numbers))
        return matrix


def _parse_matrix(text: str) -> NDArray[np.float64]:
    """Parse a matrix of 16 numbers, row by row; the identity for an empty text."""
    if not text.strip():
        return np.eye(4)
    return np.array([float(word) for word in text.split()]).reshape(4, 4)
