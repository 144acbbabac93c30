"""
Read MTL files [1]_: the materials of OBJ files, and their pictures.

References
----------
.. [1] Wavefront Technologies, "Object Files (.obj)" and "MTL material format", version 4.2, 1995.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.images import in_16_bits, resized
from rasterjit.io.load_warnings import LeftOut, MissingFileError, reason_of
from rasterjit.io.resources import RefusedFileError, Resources, shown_name
from rasterjit.io.text.mesh_builder import srgb_bytes
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.material import Material
from rasterjit.scene.memory_limits import FileSizeError
from rasterjit.scene.texture import FARTHEST_MOVE, Texture
from rasterjit.scene.validation import in_short

GREY = (102, 102, 102, 255)
"""The colour that a material has whose file names none, as in trimesh."""

_STATEMENT_BYTES = 64
"""What a byte of an MTL file takes at most, as statements."""

MAX_SHININESS = 1000.0
"""Largest exponent: a highlight of about two degrees, which pixels still resolve."""

_MAPS = ("map_kd", "map_d")
"""Pictures that are shown: of the colour, and of the opacity."""

_COMMENT_LENGTH = 400
"""Characters of an MTL file among which its writer is named."""

_OPTIONS = {
    "-blendu": ("on",), "-blendv": ("on",), "-cc": ("off",), "-clamp": ("off",), "-imfchan": ("",),
    "-bm": ("1",), "-boost": ("0",), "-texres": ("",), "-mm": ("0", "1"), "-o": ("0", "0", "0"),
    "-s": ("1", "1", "1"), "-t": ("0", "0", "0"),
}  # fmt: skip
"""Options before the name of a picture: as many words as may follow, those that change nothing."""

_CHANNEL = "-imfchan"
"""The option that names the channel of a picture."""

_LAID = {"-s": "scale", "-o": "offset", "-clamp": "wrap"}
"""Options that a texture keeps, and as what."""

_NUMBERS, _OPACITIES = ("kd", "ks", "ns"), ("d", "tr")

_NEUTRAL = {
    "ke": 0.0, "tf": 1.0, "pr": 0.0, "pm": 0.0, "ps": 0.0, "pc": 0.0, "pcr": 0.0, "aniso": 0.0,
    "anisor": 0.0,
}  # fmt: skip
"""Numbers that are not shown, and their value that changes nothing."""

_WITHOUT_EFFECT = ("ka", "illum", "ni", "sharpness", "map_aat")
"""Statements that other lights, or rays, would need."""

_PICTURES = ("bump", "disp", "decal", "refl", "norm")
"""Pictures that are not shown, besides those whose statements begin with ``map_``."""


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
    unread: list[str] = field(default_factory=list)
    """Statements that are not shown."""

    def take(self, statement: str, words: list[str]) -> None:
        """Keep what a statement says; one without the numbers that belong there is not shown."""
        key = statement.lower()
        if key in _MAPS:
            self.said[key] = PictureUse.of(words)
            return
        words = without_comment(words)
        if key in _OPACITIES and words and _is_finite(words[-1]):
            self.said[key] = words
            self.unread += [f"{' '.join(words[:-1])} of {statement}"] * (len(words) > 1)
        elif key in _OPACITIES:
            self.unread.append(_in_words(statement, words))
        elif key.startswith("map_") or key in _PICTURES or key not in _NUMBERS:
            is_neutral = key in _NEUTRAL and all(_is_number(one, _NEUTRAL[key]) for one in words)
            if key not in _WITHOUT_EFFECT and not is_neutral:
                self.unread.append(statement)
        elif key in _NUMBERS:
            numbers = [float(word) for word in words] if all(map(_is_finite, words)) else []
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
                self.unread.append(_in_words(statement, words))
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
    if "ns" in said and material.glossiness is not None:
        shininess = min(max(material.glossiness, 1.0), MAX_SHININESS)
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
    if "d" in said:
        opacity = float(said["d"][-1])
    elif "tr" in said:
        opacity = float(said["tr"][-1])
        opacity = opacity if tr_is_opacity else 1.0 - opacity
    else:
        return 1.0
    return min(max(opacity, 0.0), 1.0)


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
        for line in dict.fromkeys(names):
            self._read_all(line)
        self._known_as: dict[str, str] = {}
        """What the MTL files call a material, by its name with and without a comment behind it."""
        for known in self.said:
            for name in (known, _before_comment(known)):
                self._known_as.setdefault(name, known)
        used = dict.fromkeys(used)
        for name in used:
            if self._find(name) is None:
                left_out.note(f"reference to material {name!r}, which no MTL file of it has")
        # MeshLab writes ``Tr 1`` for opaque surfaces, where others mean invisible ones. A file of
        # which nothing would be seen is taken as MeshLab's.
        found = (self._find(name) for name in used)
        said = [{} if name is None else self.said[name].said for name in found]
        self.tr_is_opacity = self._is_from_meshlab or (
            bool(said) and all("d" not in one and _is_one(one.get("tr")) for one in said)
        )

    def _read_all(self, line: str) -> None:
        """
        Keep the materials of the MTL files that a line names.

        Names may have blanks, and a comment may stand behind them: the first way to take the line
        apart that leads to a file is the right one.
        """
        said: dict[str, Exception] = {}
        for names in library_names(line):
            contents = {}
            for name in names:
                try:
                    contents[name] = self._resources.read(name)
                except FileSizeError:
                    raise
                except ValueError as error:
                    said[name] = error
            if contents:
                for content in contents.values():
                    self._read(content)
                missing = [name for name in names if name not in contents]
                break
        else:
            missing = named_as_mtl(line) or [_before_comment(line)]
        for name in missing:
            why = said[name]
            if isinstance(why, RefusedFileError):
                self._left_out.note(f"MTL file: {reason_of(why)}")
            else:
                self._left_out.note(f"MTL file {shown_name(name)}: {reason_of(why)}")

    def _read(self, content: bytes) -> None:
        """Keep the materials of an MTL file, unless one before has those of their names."""
        self._resources.budget.take("an MTL file", _STATEMENT_BYTES * len(content))
        text = content.decode("utf-8-sig", "replace")
        self._is_from_meshlab |= "meshlab" in text[:_COMMENT_LENGTH].lower()
        material, found = None, {}
        for line in text.splitlines():
            words = line.split()
            if not words or words[0].startswith("#"):
                continue
            if len(words) == 1 and words[0].lower() not in (*_NUMBERS, *_OPACITIES):
                # It says nothing.
                continue
            if words[0].lower() == "newmtl":
                name = " ".join(words[1:])
                material = found[name] = MtlMaterial(name)
            elif material is not None:
                material.take(words[0], words[1:])
        self.said = {**found, **self.said}

    def _find(self, name: str | None) -> str | None:
        """Return what the MTL files call a material that is used; None if none has it."""
        if name is None or name in self.said:
            return name
        return self._known_as.get(_before_comment(name))

    def material(self, name: str | None) -> Material | None:
        """Return a material, one for all meshes that share it; None if no MTL file has it."""
        name = self._find(name)
        if name is None:
            return None
        if name not in self._materials:
            said = self.said[name]
            for statement in said.unread:
                self._left_out.note(f"{statement} of material {name!r}")
            self._materials[name] = material_from_mtl(
                said, self.texture(name), "map_d" in said.said, self._left_out, self.tr_is_opacity
            )
        return self._materials[name]

    def texture(self, material: str) -> Texture | None:
        """Return the texture of a material: colour and opacity in one; None if it has none."""
        uses = self.said[material].said
        key = uses.get("map_kd"), uses.get("map_d")
        if key not in self._textures:
            self._textures[key] = self._join(*key, f"material {material!r}")
        return self._textures[key]

    def _join(
        self, of_color: PictureUse | None, of_opacity: PictureUse | None, label: str
    ) -> Texture | None:
        """Return a texture of the pictures that can be read, laid as the first of them is."""
        color = self._pixels(of_color, "map_Kd", label)
        opacity = self._pixels(of_opacity, "map_d", label)
        first = of_opacity if color is None else of_color
        laid = {} if first is None else first.laid()
        for use, key, pixels in ((of_color, "map_Kd", color), (of_opacity, "map_d", opacity)):
            if use is not None and pixels is not None:
                kept = laid if use.laid() == laid else {}
                for option, said in use.options.items():
                    is_channel = key == "map_d" and option == _CHANNEL and said[0] in "rgbm"
                    if not is_channel and _LAID.get(option) not in kept:
                        self._left_out.note(f"option {option} of {key} of {label}")
        if opacity is None:
            return None if color is None else Texture(color, **laid)
        alpha = _channel(opacity, of_opacity)
        if color is None:
            color = np.full((*alpha.shape, 3), 255, np.uint8)
        if color.dtype != alpha.dtype:
            color, alpha = in_16_bits(color), in_16_bits(alpha)
        color = color[..., np.newaxis] if color.ndim == 2 else color
        red_green_blue = color[..., :3] if color.shape[2] >= 3 else np.repeat(color[..., :1], 3, 2)
        alpha = resized(alpha, (color.shape[1], color.shape[0]))
        return Texture(np.dstack([red_green_blue, alpha]), **laid)

    def _pixels(self, use: PictureUse | None, key: str, label: str) -> NDArray[Any] | None:
        """Return a picture's pixels; None, with a note if it has a name and cannot be read."""
        if use is None:
            return None
        name = use.name
        try:
            try:
                content = self._resources.read(name)
            except MissingFileError:
                if (plain := _before_comment(name)) == name:
                    raise
                content, name = self._resources.read(plain), plain
            decoder, what = self._resources.decoder, f"picture {shown_name(name)}"
            pixels: NDArray[Any] = decoder.decode("picture", content, what, ())
            return pixels
        except Exception as error:
            # Pillow raises what it likes about a damaged picture.
            self._left_out.note(
                f"{key} of {label}, {shown_name(name)}, that cannot be read: {reason_of(error)}"
            )
            return None


def _channel(opacity: NDArray[Any], use: PictureUse | None) -> NDArray[Any]:
    """
    Return the channel of a picture that is the opacity.

    Without an option that names it, grey counts, or else alpha: a picture in colour with alpha is
    mostly that of map_Kd.
    """
    if opacity.ndim == 2:
        return opacity
    named = () if use is None else use.options.get(_CHANNEL, ())
    width = opacity.shape[2]
    if named in (("r",), ("g",), ("b",)) and width > 2:
        return opacity[..., "rgb".index(named[0])]
    return opacity[..., width - 1 if width > 3 or (width == 2 and named == ("m",)) else 0]


def _is_one(words: list[str] | None) -> bool:
    """Tell the number 1 in an MTL file."""
    return bool(words and _is_number(words[-1], 1.0))


class PictureUse(NamedTuple):
    """
    A picture, and how it is laid.

    Parameters
    ----------
    name : str
        It may have blanks.
    options : dict of str to words
        Those that change anything.
    """

    name: str
    options: dict[str, tuple[str, ...]]

    def __hash__(self) -> int:
        return hash((self.name, *self.options.items()))

    @classmethod
    def of(cls, words: list[str]) -> PictureUse:
        """
        Take apart the options of a picture and its name behind them.

        An option takes up to three numbers; what is none belongs to the name.
        """
        at, options = 0, {}
        while at < len(words) and words[at].lower() in _OPTIONS:
            option, at = words[at].lower(), at + 1
            usual = _OPTIONS[option]
            begin = at
            while at < min(begin + len(usual), len(words) - 1) and _is_option_value(words[at]):
                at += 1
            said = tuple(words[begin:at])
            if not all(map(_is_same, said, usual)):
                options[option] = said
        return cls(" ".join(words[at:]), options)

    def laid(self) -> dict[str, Any]:
        """Return how a `Texture` is laid: its scale, offset and wrap."""
        found: dict[str, Any] = {}
        for option in ("-s", "-o"):
            if option in self.options:
                usual = [float(word) for word in _OPTIONS[option][:2]]
                said = [float(word) for word in self.options[option][:2]]
                pair = tuple(said + usual[len(said) :])
                if all(abs(number) <= FARTHEST_MOVE for number in pair):
                    found[_LAID[option]] = pair
        return {**found, **({"wrap": "clamp"} if "-clamp" in self.options else {})}


def library_names(text: str) -> Iterator[list[str]]:
    """Yield the names of MTL files that a line may mean, the likeliest first."""
    plain = _before_comment(text)
    yield [text]
    yield [plain]
    yield named_as_mtl(text)
    yield plain.split()


def named_as_mtl(text: str) -> list[str]:
    """Return the names that end in ``.mtl``."""
    plain, begin, names = _before_comment(text), 0, []
    for end in re.finditer(r"\.mtl\b[\"']?(?=\s|$)", plain, re.IGNORECASE):
        if plain[begin : end.start()].strip():
            names.append(plain[begin : end.end()].strip("\"' \t"))
            begin = end.end()
    return names


def without_comment(words: list[str]) -> list[str]:
    """Return the words before one that begins a comment."""
    end = next((at for at, word in enumerate(words) if word.startswith("#")), len(words))
    return words[:end]


def _before_comment(text: str) -> str:
    """Return what stands before a comment, if anything does."""
    return re.split(r"(?<=\s)#", text, maxsplit=1)[0].strip() or text


def _is_number(word: str, number: float) -> bool:
    """Tell a word that is a number."""
    try:
        return float(word) == number
    except ValueError:
        return False


def _is_finite(word: str) -> bool:
    """Tell a word that is a finite number."""
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def _in_words(statement: str, words: list[str]) -> str:
    """Return a statement with what it says, in short."""
    return f"{statement} {in_short(' '.join(words))}" if words else f"{statement} without a value"


def _is_same(word: str, usual: str) -> bool:
    """Tell whether two words are the same, or the same number."""
    return word == usual or (usual.isdecimal() and _is_number(word, float(usual)))


def _is_option_value(word: str) -> bool:
    """Tell a number or a switch from the beginning of a name."""
    return word in ("on", "off", "r", "g", "b", "m", "l", "z") or bool(
        re.fullmatch(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)(e[-+]?[0-9]+)?", word, re.I)
    )
