"""
Read MTL files [1]_: the materials of OBJ files, and their pictures.

References
----------
.. [1] Wavefront Technologies, "Object Files (.obj)" and "MTL material format", version 4.2, 1995.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.pictures import picture_pixels, resized
from rasterjit.io.resources import RefusedFileError, Resources, shown_name
from rasterjit.io.skipped import LeftOut, reason_of
from rasterjit.io.text.parts import srgb_bytes
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.material import Material
from rasterjit.scene.memory import FileSizeError
from rasterjit.scene.texture import Texture

GREY = (102, 102, 102, 255)
"""The colour that a material has whose file names none, as in trimesh."""

_STATEMENT_BYTES = 64
"""What a byte of an MTL file takes at most, as statements."""

MOST_SHININESS = 1000.0
"""Largest exponent: a highlight of about two degrees, which pixels still resolve."""

_MAPS = ("map_kd", "map_d")
"""Pictures that are shown: of the colour, and of the opacity."""

_COMMENT_LENGTH = 400
"""Characters of an MTL file among which its writer is named."""

_OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-bm": 1, "-boost": 1,
    "-texres": 1, "-mm": 2, "-o": 3, "-s": 3, "-t": 3,
}  # fmt: skip
"""Options before the name of a picture, and how many words follow each at most."""

_NUMBERS = ("kd", "ks", "ns")


@dataclass
class MtlMaterial:
    """
    A material as an MTL file says it.

    Parameters
    ----------
    name : str
    diffuse, specular : four whole numbers
        Colours in bytes, sRGB.
    glossiness : float, optional
        Exponent of the highlight.
    said : dict
        What the file says, by the statement's name in lower case.
    """

    name: str
    diffuse: Any = GREY
    specular: Any = GREY
    glossiness: float | None = None
    said: dict[str, Any] = field(default_factory=dict)

    def take(self, key: str, words: list[str]) -> None:
        """Keep what a statement says, unless it is no number where one belongs."""
        if key in _MAPS:
            self.said[key] = picture_name(words)
        elif key in ("d", "tr"):
            self.said[key] = words
        elif key in _NUMBERS:
            try:
                numbers = [float(word) for word in words]
            except ValueError:
                return
            if not all(map(math.isfinite, numbers)):
                return
            if key == "ns" and len(numbers) == 1:
                self.glossiness = numbers[0]
            elif key != "ns" and (len(numbers) in (3, 4) or numbers == [0.0]):
                # A single zero is no colour.
                rgb = srgb_bytes(np.array(numbers)) if len(numbers) > 1 else np.array(GREY)
                rgba = (*rgb.tolist(), 255)[:4]
                if key == "kd":
                    self.diffuse = rgba
                else:
                    self.specular = rgba
            else:
                return
            self.said[key] = numbers


def material_from_mtl(
    material: MtlMaterial,
    texture: Texture | None,
    has_opacity: bool,
    left_out: LeftOut,
    tr_is_opacity: bool = False,
) -> Material:
    """
    Translate a material of an MTL file.

    ``Kd`` and ``Ks`` are sRGB, ``Ns`` is the Blinn-Phong exponent, where 1 or less is no highlight;
    the strength of the highlight is the mean of ``Ks``. What the file does not say keeps the
    engine's defaults.
    """
    said = material.said
    default = Material(base_color_texture=texture)
    color = None
    if "kd" in said or tuple(material.diffuse) != GREY:
        rgb = srgb_to_linear(np.asarray(material.diffuse, dtype=np.uint8)[:3])
        color = (*rgb.tolist(), float(material.diffuse[3]) / 255.0)
    opacity = _opacity(said, tr_is_opacity)
    alpha = opacity if color is None else color[3] * opacity
    if color is None and alpha < 1.0:
        color = default.base_color_over(False)
    if texture is not None and not texture.is_opaque and not has_opacity:
        left_out.note(f"alpha of the map_Kd of material {material.name!r}, which has no map_d")
    specular, shininess = default.specular, default.shininess
    if "ks" in said:
        ks = np.asarray(material.specular, dtype=np.uint8)[:3]
        specular = float(srgb_to_linear(ks).mean())
    if "ns" in said:
        shininess = min(max(material.glossiness, 1.0), MOST_SHININESS)
        if material.glossiness <= 1.0:
            # Exporters write 0 for no highlight; an exponent of 1 would wash over the whole object.
            specular = 0.0
    return Material(
        base_color=None if color is None else (*color[:3], alpha),
        alpha_mode="blend" if alpha < 1.0 or has_opacity else "opaque",
        specular=specular,
        shininess=shininess,
        name=material.name,
        base_color_texture=texture,
    )


def _opacity(said: dict[str, Any], tr_is_opacity: bool) -> float:
    """Return the opacity that ``d`` of an MTL file gives, or ``Tr``, which most write as 1 - d."""
    try:
        if "d" in said:
            opacity = float(said["d"][-1])
        elif "tr" in said:
            opacity = float(said["tr"][-1])
            opacity = opacity if tr_is_opacity else 1.0 - opacity
        else:
            return 1.0
    except (TypeError, ValueError, IndexError):
        return 1.0
    return min(max(opacity, 0.0), 1.0) if math.isfinite(opacity) else 1.0


class MtlLibrary:
    """
    The materials of an OBJ file.

    Parameters
    ----------
    names : iterable of str
        MTL files that it names.
    used : iterable of str
        Materials that it uses.
    resources : Resources
        The files that it may name.
    left_out : LeftOut
        Notes pictures that are missing or damaged, MTL files that may not be opened, and materials
        that no MTL file has.
    """

    def __init__(
        self, names: Iterable[str], used: Iterable[str], resources: Resources, left_out: LeftOut
    ) -> None:
        self._resources = resources
        self._left_out = left_out
        self._is_from_meshlab = False
        self._textures: dict[tuple[str | None, ...], Texture | None] = {}
        self._materials: dict[str, Material] = {}
        self.said: dict[str, MtlMaterial] = {}
        for name in dict.fromkeys(names):
            self._read(name)
        used = dict.fromkeys(used)
        for name in used:
            if name not in self.said:
                left_out.note(f"reference to material {name!r}, which no MTL file of it has")
        # MeshLab writes ``Tr 1`` for opaque surfaces, where others mean invisible ones. A file of
        # which nothing would be seen is taken as MeshLab's.
        said = [self.said[name].said if name in self.said else {} for name in used]
        self.tr_is_opacity = self._is_from_meshlab or (
            bool(said) and all("d" not in one and _is_one(one.get("tr")) for one in said)
        )

    def _read(self, name: str) -> None:
        """Keep the materials of an MTL file; one that is missing has none."""
        try:
            content = self._resources.read(name)
            self._resources.budget.take("an MTL file", _STATEMENT_BYTES * len(content))
            text = content.decode("utf-8-sig", "replace")
        except FileSizeError:
            raise
        except RefusedFileError as error:
            self._left_out.note(f"MTL file: {reason_of(error)}")
            return
        except ValueError:
            return
        self._is_from_meshlab |= "meshlab" in text[:_COMMENT_LENGTH].lower()
        material, found = None, {}
        for line in text.splitlines():
            words = line.split()
            if len(words) < 2:
                continue
            if words[0].lower() == "newmtl":
                name = " ".join(words[1:])
                material = found[name] = MtlMaterial(name)
            elif material is not None:
                material.take(words[0].lower(), words[1:])
        self.said = {**found, **self.said}

    def material(self, name: str | None) -> Material | None:
        """Return a material, one for all meshes that share it; None if no MTL file has it."""
        if name is None or name not in self.said:
            return None
        if name not in self._materials:
            said = self.said[name]
            self._materials[name] = material_from_mtl(
                said, self.texture(name), "map_d" in said.said, self._left_out, self.tr_is_opacity
            )
        return self._materials[name]

    def texture(self, material: str) -> Texture | None:
        """Return the texture of a material: colour and opacity in one; None if it has none."""
        names = self.said[material].said
        key = tuple(names.get(kind) for kind in _MAPS)
        if key not in self._textures:
            self._textures[key] = self._join(names, f"material {material!r}")
        return self._textures[key]

    def _join(self, names: dict[str, Any], label: str) -> Texture | None:
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
        try:
            content = self._resources.read(name)
            return picture_pixels(content, f"picture {shown_name(name)}", self._resources.budget)
        except Exception as error:
            # Pillow raises what it likes about a damaged picture.
            self._left_out.note(
                f"{key} of {label}, {shown_name(name)}, that cannot be read: {reason_of(error)}"
            )
            return None


def _is_one(words: list[str] | None) -> bool:
    """Tell the number 1 in an MTL file."""
    try:
        return words is not None and float(words[-1]) == 1.0
    except ValueError:
        return False


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
