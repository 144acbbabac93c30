"""Name what trimesh passes over in silence in COLLADA and XAML files."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from rasterjit.io.resources import shown_name
from rasterjit.io.skipped import LeftOut

_SHOWN_BRUSH = "SolidColorBrush"


def note_what_is_not_read(path: Path, extension: str, left_out: LeftOut) -> None:
    """
    Note what a file that trimesh has read has besides.

    Parameters
    ----------
    path : Path
    extension : str
        ``"dae"`` or ``"xaml"``; of others nothing is known.
    left_out : LeftOut
    """
    note = {"dae": _note_other_files, "xaml": _note_brushes}.get(extension)
    if note is None:
        return
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, ValueError):
        # What trimesh could read all the same, such as a packed file.
        return
    note(root, left_out)


def _note_other_files(root: ElementTree.Element, left_out: LeftOut) -> None:
    """Note references of a COLLADA file to libraries in other files."""
    for element in root.iter():
        kind = _name(element)
        if not kind.startswith("instance_"):
            continue
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
            if not _name(material).endswith("Material"):
                continue
            brushes = [brush for holder in material for brush in holder]
            for brush in brushes:
                kind = _name(brush)
                if kind.endswith("Brush") and kind != _SHOWN_BRUSH:
                    picture = brush.get("ImageSource")
                    named = f" {shown_name(picture)}" if picture else ""
                    left_out.note(f"{kind}{named} of a {_name(material)}")


def _name(element: ElementTree.Element) -> str:
    """Return the name of an element without its name space."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""
