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

from rasterjit.io.images import resize_grey, to_uint16
from rasterjit.io.load_warnings import LeftOut, MissingFileError, reason_of
from rasterjit.io.resources import RefusedFileError, Resources, quote_name
from rasterjit.io.text.mesh_builder import to_srgb_bytes
from rasterjit.io.text.number_parser import parse_float
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.material import Material
from rasterjit.scene.memory_limits import FileSizeError
from rasterjit.scene.texture import MAX_UV_OFFSET, Texture
from rasterjit.scene.validation import brief

DEFAULT_COLOR = (102, 102, 102, 255)
"""Default colour of materials, sRGB, as trimesh has it."""

_MEMORY_PER_BYTE = 64
"""Most bytes of memory for a byte of an MTL file, as statements."""

MAX_SHININESS = 1000.0
"""Largest exponent: a highlight of about two degrees, which pixels still resolve."""

_MAP_STATEMENTS = ("map_kd", "map_d")
"""Statements of images that are shown: colour and opacity."""

_WRITER_SEARCH_LENGTH = 400
"""Characters of an MTL file that are searched for the program that wrote it."""

_OPTION_DEFAULTS = {
    "-blendu": ("on",), "-blendv": ("on",), "-cc": ("off",), "-clamp": ("off",), "-imfchan": ("",),
    "-bm": ("1",), "-boost": ("0",), "-texres": ("",), "-mm": ("0", "1"), "-o": ("0", "0", "0"),
    "-s": ("1", "1", "1"), "-t": ("0", "0", "0"),
}  # fmt: skip
"""Options of an image, with default values for each word that may follow."""

_CHANNEL_OPTION = "-imfchan"
"""Option of an image that selects its channel."""

_TEXTURE_OPTIONS = {"-s": "scale", "-o": "offset", "-clamp": "wrap"}
"""Options that become sampling fields of a texture."""

_NUMBER_STATEMENTS, _OPACITY_STATEMENTS = ("kd", "ks", "ns"), ("d", "tr")

_NEUTRAL_VALUES = {
    "ke": 0.0, "tf": 1.0, "pr": 0.0, "pm": 0.0, "ps": 0.0, "pc": 0.0, "pcr": 0.0, "aniso": 0.0,
    "anisor": 0.0,
}  # fmt: skip
"""Statements of numbers that are not shown, with the value that has no effect."""

_IGNORED_STATEMENTS = ("ka", "illum", "ni", "sharpness", "map_aat")
"""Statements without effect here: other lights or ray tracing need them."""

_UNREAD_MAPS = ("bump", "disp", "decal", "refl", "norm")
"""Statements of images that are not shown, besides those that begin with ``map_``."""


@dataclass
class MtlMaterial:
    """
    A material of an MTL file, in sRGB.

    Parameters
    ----------
    name : str
    diffuse, specular : four whole numbers
        Colours in bytes, sRGB.
    glossiness : float, optional
        Exponent of the highlight.
    statements : dict
        Words or numbers by the statement's name in lower case.
    """

    name: str
    diffuse: Any = DEFAULT_COLOR
    specular: Any = DEFAULT_COLOR
    glossiness: float | None = None
    statements: dict[str, Any] = field(default_factory=dict)
    unread: list[str] = field(default_factory=list)
    """Statements that are not shown."""

    def add_statement(self, statement: str, words: list[str]) -> None:
        """Store a statement; one with wrong numbers is not shown."""
        key = statement.lower()
        if key in _MAP_STATEMENTS:
            self.statements[key] = MtlTexture.parse(words)
            return
        words = strip_comment_words(words)
        if key in _OPACITY_STATEMENTS and words and _is_finite(words[-1]):
            self.statements[key] = words
            self.unread += [f"{' '.join(words[:-1])} of {statement}"] * (len(words) > 1)
        elif key in _OPACITY_STATEMENTS:
            self.unread.append(_describe_statement(statement, words))
        elif key.startswith("map_") or key in _UNREAD_MAPS or key not in _NUMBER_STATEMENTS:
            neutral = _NEUTRAL_VALUES.get(key)
            is_neutral = neutral is not None and all(parse_float(one) == neutral for one in words)
            if key not in _IGNORED_STATEMENTS and not is_neutral:
                self.unread.append(statement)
        elif key in _NUMBER_STATEMENTS:
            numbers = [float(word) for word in words] if all(map(_is_finite, words)) else []
            if key == "ns" and len(numbers) == 1:
                self.glossiness = numbers[0]
            elif key != "ns" and (len(numbers) in (3, 4) or numbers == [0.0]):
                # A single zero is no colour.
                rgba = DEFAULT_COLOR
                if len(numbers) > 1:
                    rgba = (*to_srgb_bytes(np.array(numbers)).tolist(), 255)[:4]
                if key == "kd":
                    self.diffuse = rgba
                else:
                    self.specular = rgba
            else:
                self.unread.append(_describe_statement(statement, words))
                return
            self.statements[key] = numbers


def convert_mtl_material(
    material: MtlMaterial,
    texture: Texture | None,
    has_opacity: bool,
    left_out: LeftOut,
    tr_is_opacity: bool = False,
) -> Material:
    """
    Convert a material of an MTL file to `Material`.

    ``Kd`` and ``Ks`` are sRGB, ``Ns`` is the Blinn-Phong exponent, where 1 or less is no highlight;
    the strength of the highlight is the mean of ``Ks``. Properties that the file lacks have the
    engine's defaults.
    """
    statements = material.statements
    default = Material(base_color_texture=texture)
    color = None
    if "kd" in statements or tuple(material.diffuse) != DEFAULT_COLOR:
        rgb = srgb_to_linear(np.asarray(material.diffuse, dtype=np.uint8)[:3])
        color = (*rgb.tolist(), float(material.diffuse[3]) / 255.0)
    opacity = _compute_opacity(statements, tr_is_opacity)
    alpha = opacity if color is None else color[3] * opacity
    if color is None and alpha < 1.0:
        color = default.base_color_over(False)
    if texture is not None and not texture.is_opaque and not has_opacity:
        left_out.note(f"alpha of the map_Kd of material {material.name!r}, which has no map_d")
    specular, shininess = default.specular, default.shininess
    if "ks" in statements:
        ks = np.asarray(material.specular, dtype=np.uint8)[:3]
        specular = float(srgb_to_linear(ks).mean())
    if "ns" in statements and material.glossiness is not None:
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


def _compute_opacity(statements: dict[str, Any], tr_is_opacity: bool) -> float:
    """Return the opacity by ``d``, or by ``Tr``, which most files write as 1 - d."""
    if "d" in statements:
        opacity = float(statements["d"][-1])
    elif "tr" in statements:
        opacity = float(statements["tr"][-1])
        opacity = opacity if tr_is_opacity else 1.0 - opacity
    else:
        return 1.0
    return min(max(opacity, 0.0), 1.0)


class MtlLibrary:
    """
    The materials of all MTL files of an OBJ file.

    Parameters
    ----------
    names : iterable of str
        MTL files that the OBJ file names.
    used : iterable of str
        Names of the materials that it uses.
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
        self.materials: dict[str, MtlMaterial] = {}
        for line in dict.fromkeys(names):
            self._read_libraries(line)
        self._library_names: dict[str, str] = {}
        """Names of materials in the MTL files, with and without a trailing comment."""
        for library_name in self.materials:
            for name in (library_name, _strip_comment(library_name)):
                self._library_names.setdefault(name, library_name)
        used = dict.fromkeys(used)
        for name in used:
            if self._find_library_name(name) is None:
                left_out.note(f"reference to material {name!r}, which no MTL file of it has")
        # MeshLab writes ``Tr 1`` for opaque surfaces, where others mean invisible ones. A file of
        # which nothing would be seen is taken as MeshLab's.
        names_used = (self._find_library_name(name) for name in used)
        statements = [
            {} if name is None else self.materials[name].statements for name in names_used
        ]
        self.tr_is_opacity = self._is_from_meshlab or (
            bool(statements)
            and all("d" not in one and _is_one(one.get("tr")) for one in statements)
        )

    def _read_libraries(self, line: str) -> None:
        """
        Read the MTL files that an ``mtllib`` line names.

        Names may have blanks, and a comment may follow: the first splitting of the line that names
        an existing file is used.
        """
        errors: dict[str, Exception] = {}
        for names in list_candidates(line):
            contents = {}
            for name in names:
                try:
                    contents[name] = self._resources.read(name)
                except FileSizeError:
                    raise
                except ValueError as error:
                    errors[name] = error
            if contents:
                for content in contents.values():
                    self._read_library(content)
                missing = [name for name in names if name not in contents]
                break
        else:
            missing = split_file_names(line) or [_strip_comment(line)]
        for name in missing:
            reason = errors[name]
            if isinstance(reason, RefusedFileError):
                self._left_out.note(f"MTL file: {reason_of(reason)}")
            else:
                self._left_out.note(f"MTL file {quote_name(name)}: {reason_of(reason)}")

    def _read_library(self, content: bytes) -> None:
        """Add the materials of an MTL file; those of earlier files come first."""
        self._resources.budget.take("an MTL file", _MEMORY_PER_BYTE * len(content))
        text = content.decode("utf-8-sig", "replace")
        self._is_from_meshlab |= "meshlab" in text[:_WRITER_SEARCH_LENGTH].lower()
        material, materials = None, {}
        for line in text.splitlines():
            words = line.split()
            if not words or words[0].startswith("#"):
                continue
            if len(words) == 1 and words[0].lower() not in (
                *_NUMBER_STATEMENTS,
                *_OPACITY_STATEMENTS,
            ):
                # A statement without words has no effect.
                continue
            if words[0].lower() == "newmtl":
                name = " ".join(words[1:])
                material = materials[name] = MtlMaterial(name)
            elif material is not None:
                material.add_statement(words[0], words[1:])
        self.materials = {**materials, **self.materials}

    def _find_library_name(self, name: str | None) -> str | None:
        """Return the name in the MTL files of a material that the OBJ file uses, or None."""
        if name is None or name in self.materials:
            return name
        return self._library_names.get(_strip_comment(name))

    def material(self, name: str | None) -> Material | None:
        """Return a material, shared by all meshes that use it; None if no MTL file has it."""
        name = self._find_library_name(name)
        if name is None:
            return None
        if name not in self._materials:
            mtl_material = self.materials[name]
            for statement in mtl_material.unread:
                self._left_out.note(f"{statement} of material {name!r}")
            self._materials[name] = convert_mtl_material(
                mtl_material,
                self.texture(name),
                "map_d" in mtl_material.statements,
                self._left_out,
                self.tr_is_opacity,
            )
        return self._materials[name]

    def texture(self, material: str) -> Texture | None:
        """Return the texture of a material, colour and opacity combined; None if it has none."""
        statements = self.materials[material].statements
        key = statements.get("map_kd"), statements.get("map_d")
        if key not in self._textures:
            self._textures[key] = self._combine_maps(*key, f"material {material!r}")
        return self._textures[key]

    def _combine_maps(
        self, color_map: MtlTexture | None, opacity_map: MtlTexture | None, label: str
    ) -> Texture | None:
        """Combine the images that can be read to a texture, with the sampling of the first."""
        color = self._read_pixels(color_map, "map_Kd", label)
        opacity = self._read_pixels(opacity_map, "map_d", label)
        first = opacity_map if color is None else color_map
        sampling = {} if first is None else first.sampling()
        for image, key, pixels in ((color_map, "map_Kd", color), (opacity_map, "map_d", opacity)):
            if image is not None and pixels is not None:
                applied = sampling if image.sampling() == sampling else {}
                for option, words in image.options.items():
                    is_channel = key == "map_d" and option == _CHANNEL_OPTION and words[0] in "rgbm"
                    if not is_channel and _TEXTURE_OPTIONS.get(option) not in applied:
                        self._left_out.note(f"option {option} of {key} of {label}")
        if opacity is None:
            return None if color is None else Texture(color, **sampling)
        alpha = _select_opacity(opacity, opacity_map)
        if color is None:
            color = np.full((*alpha.shape, 3), 255, np.uint8)
        if color.dtype != alpha.dtype:
            color, alpha = to_uint16(color), to_uint16(alpha)
        color = color[..., np.newaxis] if color.ndim == 2 else color
        rgb = color[..., :3] if color.shape[2] >= 3 else np.repeat(color[..., :1], 3, 2)
        alpha = resize_grey(alpha, (color.shape[1], color.shape[0]))
        return Texture(np.dstack([rgb, alpha]), **sampling)

    def _read_pixels(self, image: MtlTexture | None, key: str, label: str) -> NDArray[Any] | None:
        """Return an image's pixels; None, with a note, if it cannot be read."""
        if image is None:
            return None
        name = image.name
        try:
            try:
                content = self._resources.read(name)
            except MissingFileError:
                if (stripped := _strip_comment(name)) == name:
                    raise
                content, name = self._resources.read(stripped), stripped
            decoder, picture_label = self._resources.decoder, f"picture {quote_name(name)}"
            pixels: NDArray[Any] = decoder.decode("picture", content, picture_label, ())
            return pixels
        except Exception as error:
            # Pillow raises any error about a damaged picture.
            self._left_out.note(
                f"{key} of {label}, {quote_name(name)}, that cannot be read: {reason_of(error)}"
            )
            return None


def _select_opacity(pixels: NDArray[Any], image: MtlTexture | None) -> NDArray[Any]:
    """
    Return the channel of an image that is the opacity.

    Without an option that names the channel, it is the alpha of RGBA pictures, which are mostly
    those of map_Kd as well, else the first channel.
    """
    if pixels.ndim == 2:
        return pixels
    option = () if image is None else image.options.get(_CHANNEL_OPTION, ())
    channel_count = pixels.shape[2]
    if option in (("r",), ("g",), ("b",)) and channel_count > 2:
        return pixels[..., "rgb".index(option[0])]
    uses_last = channel_count > 3 or (channel_count == 2 and option == ("m",))
    return pixels[..., channel_count - 1 if uses_last else 0]


def _is_one(words: list[str] | None) -> bool:
    """Tell whether a statement's last word is the number 1."""
    return bool(words and parse_float(words[-1]) == 1.0)


class MtlTexture(NamedTuple):
    """
    An image of an MTL statement with its options.

    Parameters
    ----------
    name : str
        File name; may have blanks.
    options : dict of str to words
        Options that differ from their defaults.
    """

    name: str
    options: dict[str, tuple[str, ...]]

    def __hash__(self) -> int:
        return hash((self.name, *self.options.items()))

    @classmethod
    def parse(cls, words: list[str]) -> MtlTexture:
        """
        Parse the options of an image, and its name after them.

        An option takes up to three numbers; other words belong to the name.
        """
        at, options = 0, {}
        while at < len(words) and words[at].lower() in _OPTION_DEFAULTS:
            option, at = words[at].lower(), at + 1
            defaults = _OPTION_DEFAULTS[option]
            begin = at
            while at < min(begin + len(defaults), len(words) - 1) and _is_option_value(words[at]):
                at += 1
            values = tuple(words[begin:at])
            if not all(map(_is_equal, values, defaults)):
                options[option] = values
        return cls(" ".join(words[at:]), options)

    def sampling(self) -> dict[str, Any]:
        """Return the sampling fields of a `Texture`: scale, offset and wrap."""
        sampling: dict[str, Any] = {}
        for option in ("-s", "-o"):
            if option in self.options:
                defaults = [float(word) for word in _OPTION_DEFAULTS[option][:2]]
                values = [float(word) for word in self.options[option][:2]]
                pair = tuple(values + defaults[len(values) :])
                if all(abs(number) <= MAX_UV_OFFSET for number in pair):
                    sampling[_TEXTURE_OPTIONS[option]] = pair
        return {**sampling, **({"wrap": "clamp"} if "-clamp" in self.options else {})}


def list_candidates(text: str) -> Iterator[list[str]]:
    """Yield lists of MTL files that a line may name, the likeliest first."""
    stripped = _strip_comment(text)
    yield [text]
    yield [stripped]
    yield split_file_names(text)
    yield stripped.split()


def split_file_names(text: str) -> list[str]:
    """Return the names in a line that end in ``.mtl``."""
    stripped, begin, names = _strip_comment(text), 0, []
    for end in re.finditer(r"\.mtl\b[\"']?(?=\s|$)", stripped, re.IGNORECASE):
        if stripped[begin : end.start()].strip():
            names.append(stripped[begin : end.end()].strip("\"' \t"))
            begin = end.end()
    return names


def strip_comment_words(words: list[str]) -> list[str]:
    """Return the words before a comment."""
    end = next((at for at, word in enumerate(words) if word.startswith("#")), len(words))
    return words[:end]


def _strip_comment(text: str) -> str:
    """Return the text before a comment, or all if nothing is before it."""
    return re.split(r"(?<=\s)#", text, maxsplit=1)[0].strip() or text


def _is_finite(word: str) -> bool:
    """Tell whether a word is a finite number."""
    return math.isfinite(math.nan if (number := parse_float(word)) is None else number)


def _describe_statement(statement: str, words: list[str]) -> str:
    """Return a statement with its words, shortened, for a message."""
    return f"{statement} {brief(' '.join(words))}" if words else f"{statement} without a value"


def _is_equal(word: str, default: str) -> bool:
    """Tell whether two words are the same, or the same number."""
    return word == default or (default.isdecimal() and parse_float(word) == float(default))


def _is_option_value(word: str) -> bool:
    """Tell whether a word is a number, a switch or a channel, rather than part of a name."""
    return word in ("on", "off", "r", "g", "b", "m", "l", "z") or bool(
        re.fullmatch(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)(e[-+]?[0-9]+)?", word, re.I)
    )
