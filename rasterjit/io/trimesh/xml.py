"""Name what trimesh passes over in silence in COLLADA, XAML and SVG files."""

from __future__ import annotations

import warnings
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from rasterjit.io.resources import shown_name
from rasterjit.io.skipped import LeftOut

SKINNED = "skinned or morphed geometry"

_NOT_SHOWN = {
    "instance_controller": SKINNED, "instance_camera": "camera", "instance_light": "light",
}  # fmt: skip
"""What is placed in a COLLADA scene that trimesh does not read."""

_SVG = "{http://www.w3.org/2000/svg"

_READ_OF_SVG = (
    "path", "circle", "rect", "line", "polyline", "polygon", "svg", "g", "a", "defs", "symbol",
    "title", "desc", "metadata", "style", "namedview",
)  # fmt: skip
"""Elements of an SVG file that trimesh reads, and those that hold them or show nothing."""

_SHOWN_BRUSH = "SolidColorBrush"


def note_what_is_not_read(path: Path, extension: str, left_out: LeftOut) -> None:
    """
    Note what a file that trimesh has read has besides.

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
    """Note what of a COLLADA file moves or is elsewhere, and numbers that drop faces."""
    _note_other_files(root, left_out)
    for library in root:
        for element in library if _name(library) == "library_animations" else ():
            if _name(element) == "animation":
                left_out.note("animation")
    for element in root.iter():
        if _name(element) == "float_array" and not _are_finite(element.text or ""):
            left_out.note("faces at vertices that are no finite numbers, if any")


def _are_finite(text: str) -> bool:
    """Tell whether all numbers of a text are finite as float32, and are numbers."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            return bool(np.isfinite(np.fromstring(text, np.float32, sep=" ")).all())
    except (ValueError, DeprecationWarning):
        return False


def _note_other_files(root: ElementTree.Element, left_out: LeftOut) -> None:
    """Note references of a COLLADA file to libraries in other files."""
    for element in root.iter():
        kind = _name(element)
        if not kind.startswith("instance_"):
            continue
        if kind in _NOT_SHOWN:
            left_out.found(_NOT_SHOWN[kind])
        for key in ("url", "target"):
            place = element.get(key, "").strip()
            if place and not place.startswith("#"):
                left_out.note(f"{kind} of a library in another file, {shown_name(place)}")


def _note_brushes(root: ElementTree.Element, left_out: LeftOut) -> None:
    """Note brushes of materials of a XAML file that are more than one colour."""
    for model in root.iter():
        if _name(model) != "GeometryModel3D":
            continue
        for material in model.iter():
            # A name with a dot is a field that holds materials.
            if not _name(material).endswith("Material") or "." in _name(material):
                continue
            brushes = [brush for holder in material for brush in holder]
            for brush in brushes:
                kind = _name(brush)
                if kind.endswith("Brush") and kind != _SHOWN_BRUSH:
                    picture = brush.get("ImageSource")
                    named = f" {shown_name(picture)}" if picture else ""
                    left_out.note(f"{kind}{named} of a {_name(material)}")


def _note_shapes(root: ElementTree.Element, left_out: LeftOut) -> None:
    """Note elements of an SVG file that are no shapes that are read, and hold none."""
    for element in root.iter():
        space = element.tag.rpartition("}")[0] if isinstance(element.tag, str) else "{other"
        if space in ("", _SVG) and _name(element) not in _READ_OF_SVG:
            left_out.note(f"{_name(element)} element")


def _name(element: ElementTree.Element) -> str:
    """Return the name of an element without its name space."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""
