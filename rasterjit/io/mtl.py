"""
Read what MTL files say about pictures, which trimesh drops where it is in doubt.

References
----------
.. [1] Wavefront Technologies, "Object Files (.obj)" and "MTL material format", version 4.2, 1995.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.left_out import LeftOut, reason_of
from rasterjit.io.pictures import picture_pixels, resized
from rasterjit.scene.texture import Texture

_STATEMENT = re.compile(rb"^[ \t]*(mtllib|usemtl)[ \t]+(.*?)[ \t\r]*$", re.MULTILINE)

_MAPS = ("map_kd", "map_d")
"""Pictures that are shown: of the colour, and of the opacity."""

_OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-bm": 1, "-boost": 1,
    "-texres": 1, "-mm": 2, "-o": 3, "-s": 3, "-t": 3,
}  # fmt: skip
"""Options before the name of a picture, and how many words follow each at most."""


class MtlPictures:
    """
    The pictures of an OBJ file's materials.

    Parameters
    ----------
    path : Path
        Of the OBJ file.
    left_out : LeftOut
        Notes pictures that are missing or damaged, and materials that no MTL file has.
    """

    def __init__(self, path: Path, left_out: LeftOut) -> None:
        self._folder = path.parent
        self._left_out = left_out
        self._names: dict[str, dict[str, str]] = {}
        self._textures: dict[tuple[str | None, ...], Texture | None] = {}
        used: dict[str, None] = {}
        for kind, rest in _STATEMENT.findall(path.read_bytes()):
            text = rest.decode("utf-8", "replace")
            if kind == b"usemtl":
                used[text] = None
            else:
                self._read_library(text)
        for name in used:
            if name not in self._names:
                left_out.note(f"reference to material {name!r}, which no MTL file of it has")

    def _read_library(self, name: str) -> None:
        """Keep the names of pictures in an MTL file; one that is missing gives none."""
        try:
            text = (self._folder / name.replace("\\", "/")).read_bytes().decode("utf-8", "replace")
        except (OSError, ValueError):
            return
        material: dict[str, str] = {}
        for line in text.splitlines():
            words = line.split()
            key = words[0].lower() if words else ""
            if key == "newmtl":
                material = self._names.setdefault(" ".join(words[1:]), {})
            elif key in _MAPS:
                material[key] = picture_name(words[1:])

    def texture(self, material: str | None) -> Texture | None:
        """Return the texture of a material: colour and opacity in one; None if it has none."""
        names = self._names.get(material, {}) if material is not None else {}
        key = tuple(names.get(kind) for kind in _MAPS)
        if key not in self._textures:
            self._textures[key] = self._join(names, f"material {material!r}")
        return self._textures[key]

    def has_opacity(self, material: str | None) -> bool:
        """Return whether a picture says how opaque a material is."""
        return material is not None and "map_d" in self._names.get(material, {})

    def _join(self, names: dict[str, str], label: str) -> Texture | None:
        """Return a texture of the pictures that can be read."""
        color = self._pixels(names.get("map_kd"), "map_Kd", label)
        opacity = self._pixels(names.get("map_d"), "map_d", label)
        if opacity is None:
            return None if color is None else Texture(color)
        # Grey counts, or else alpha: a picture in colour with alpha is the same as map_Kd.
        alpha = opacity if opacity.ndim == 2 else opacity[..., -1 if opacity.shape[2] > 3 else 0]
        alpha = alpha if alpha.dtype == np.uint8 else (alpha >> 8).astype(np.uint8)
        if color is None:
            color = np.full((*alpha.shape, 3), 255, np.uint8)
        if color.dtype != np.uint8:
            color = (color >> 8).astype(np.uint8)
        color = color[..., np.newaxis] if color.ndim == 2 else color
        red_green_blue = color[..., :3] if color.shape[2] >= 3 else np.repeat(color[..., :1], 3, 2)
        alpha = resized(alpha, (color.shape[1], color.shape[0]))
        return Texture(np.dstack([red_green_blue, alpha]))

    def _pixels(self, name: str | None, key: str, label: str) -> NDArray[Any] | None:
        """Return a picture's pixels; None, with a note if it has a name and cannot be read."""
        if name is None:
            return None
        place = self._folder / name.replace("\\", "/")
        try:
            return picture_pixels(place.read_bytes())
        except Exception as error:
            # Pillow raises what it likes about a damaged picture.
            self._left_out.note(
                f"{key} of {label}, {name!r}, that cannot be read: {reason_of(error)}"
            )
            return None


def picture_name(words: list[str]) -> str:
    """
    Return the name of a picture, which may have blanks, behind its options.

    An option takes up to three numbers; what is none belongs to the name.
    """
    at = 0
    while at < len(words) and words[at] in _OPTIONS:
        most, at = at + 1 + _OPTIONS[words[at]], at + 1
        while at < min(most, len(words) - 1) and _is_option_value(words[at]):
            at += 1
    return " ".join(words[at:])


def _is_option_value(word: str) -> bool:
    """Tell a number or a switch from the beginning of a name."""
    return word in ("on", "off", "r", "g", "b", "m", "l", "z") or bool(
        re.fullmatch(r"[-+]?[0-9.]+(e[-+]?[0-9]+)?", word)
    )
