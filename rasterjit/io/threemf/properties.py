"""
Find the colours and textures that the property groups of a 3MF file give to corners.

References
----------
.. [1] 3MF Consortium, "3MF Core Specification", chapter 5.
.. [2] 3MF Consortium, "3MF Materials and Properties Extension", version 1.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.foreign.codecs import Decoder
from rasterjit.io.skipped import LeftOut, reason_of
from rasterjit.io.text.parts import linear_rgba
from rasterjit.io.threemf.package import Package, local_name
from rasterjit.scene.memory import MemoryBudget
from rasterjit.scene.texture import Filter, Texture, Wrap

_MATERIALS = ("basematerials", "compositematerials")
"""Groups that say what a body is made of: others are laid over them."""

GROUPS = (*_MATERIALS, "colorgroup", "texture2dgroup", "multiproperties")

_TILES: dict[str, Wrap] = {"wrap": "repeat", "mirror": "mirror", "clamp": "clamp", "none": "clamp"}
_FILTERS: dict[str, Filter] = {"auto": "trilinear", "linear": "bilinear", "nearest": "nearest"}

_MOST_MIXED = 16
"""Most textures that are mixed for one group, each with other colours below or above it."""

_Floats: TypeAlias = "NDArray[np.float32]"


@dataclass(frozen=True)
class Look:
    """
    What a group gives to the corners that name one of its N entries.

    Parameters
    ----------
    colors : (N, 4) float32
        Linear RGBA; multiplies the texture, if there is one.
    names : list of str or None
        What each is called.
    uv : (N, 2) float64, optional
        v upwards.
    textures : list of Texture or None
    which : (N,) int
        The texture of each.
    """

    colors: _Floats
    names: list[str | None]
    uv: NDArray[np.float64] | None
    textures: list[Texture | None]
    which: NDArray[np.int64]


@dataclass(frozen=True)
class _Layer:
    """One of the groups that a multi-property mixes, by its entries: colours or a texture."""

    colors: _Floats
    uv: NDArray[np.float64] | None = None
    texture: Texture | None = None
    is_material: bool = False


class Properties:
    """
    The property groups of one model.

    Parameters
    ----------
    resources : list of Element
        What stands below the ``resources`` of the model.
    package : Package
        Has the pictures.
    left_out : LeftOut
        Notes what is not shown.
    budget : MemoryBudget
        Counts the texels of pictures.
    decoder : Decoder
        Decodes these.
    """

    def __init__(
        self,
        resources: list[ElementTree.Element],
        package: Package,
        left_out: LeftOut,
        budget: MemoryBudget,
        decoder: Decoder,
    ) -> None:
        self._elements = {
            one.get("id", ""): one
            for one in resources
            if local_name(one.tag) in (*GROUPS, "texture2d")
        }
        self._package = package
        self._left_out = left_out
        self._budget, self._decoder = budget, decoder
        self._looks: dict[str, Look] = {}
        self._textures: dict[str, Texture | None] = {}

    def look(self, group: str) -> Look:
        """Return what a group gives, or raise ``ValueError`` if there is none of that number."""
        if group not in self._looks:
            element = self._group(group)
            if local_name(element.tag) == "multiproperties":
                self._looks[group] = self._mixed(element)
            else:
                layer = self._layer(element)
                names = [one.get("name") for one in element]
                opaque = layer.colors.copy()
                if not layer.is_material:
                    opaque[:, 3] = 1.0
                self._looks[group] = Look(
                    opaque, names, layer.uv, [layer.texture], np.zeros(len(names), np.int64)
                )
        return self._looks[group]

    def _group(self, group: str) -> ElementTree.Element:
        """Return the element of a group."""
        element = self._elements.get(group)
        if element is None or local_name(element.tag) not in GROUPS:
            raise ValueError(f"there is no group of properties {group[:80]!r}")
        return element

    def _layer(self, element: ElementTree.Element) -> _Layer:
        """Return a group that mixes no others."""
        kind, count = local_name(element.tag), len(element)
        if kind == "texture2dgroup":
            uv = np.array([[float(one.get(key, "")) for key in "uv"] for one in element])
            texture = self._texture(element.get("texid", ""))
            white = np.ones((count, 4), np.float32)
            return _Layer(white, None if texture is None else uv.reshape(-1, 2), texture)
        if kind == "compositematerials":
            return _Layer(self._composites(element), is_material=True)
        key = "displaycolor" if kind == "basematerials" else "color"
        colors = [_color(one.get(key)) for one in element]
        rgba = linear_rgba(np.array(colors, np.uint8).reshape(-1, 4), False)
        return _Layer(rgba, is_material=kind == "basematerials")

    def _composites(self, element: ElementTree.Element) -> _Floats:
        """Return the colours of mixtures: those of their materials by their shares."""
        said = element.get("matindices", "").split()
        below = self._layer(self._group(element.get("matid", ""))).colors
        colors = below[[_place(one, len(below)) for one in said]]
        shares = np.zeros((len(element), len(colors)))
        for row, one in zip(shares, element, strict=True):
            values = [float(value) for value in one.get("values", "").split()][: len(row)]
            row[: len(values)] = values
        total = shares.sum(axis=1, keepdims=True)
        shares = np.where(total > 0.0, shares, 1.0) / np.where(total > 0.0, total, len(colors))
        # A sum over a row each: the same bits on every CPU.
        return (shares[:, :, None] * colors).sum(axis=1).astype(np.float32)

    def _mixed(self, element: ElementTree.Element) -> Look:
        """Return what a multi-property gives, its layers mixed for every entry."""
        layers = [self._layer(self._group(one)) for one in element.get("pids", "").split()]
        if not layers:
            raise ValueError("a multi-property must mix at least one group")
        methods = ["mix", *element.get("blendmethods", "").split()][: len(layers)]
        methods += ["mix"] * (len(layers) - len(methods))
        rows = np.zeros((len(element), len(layers)), np.int64)
        for row, one in zip(rows, element, strict=True):
            said = one.get("pindices", "").split()
            for place, layer in enumerate(layers[: len(said)]):
                row[place] = _place(said[place], len(layer.colors))
        colors = [layer.colors[row] for layer, row in zip(layers, rows.T, strict=True)]
        has_material = layers[0].is_material
        textured = {
            place: (layer.texture, layer.uv[rows[:, place]])
            for place, layer in enumerate(layers)
            if layer.texture is not None and layer.uv is not None
        }
        names: list[str | None] = [None] * len(rows)
        if not textured:
            mixed = _blend(colors, methods, has_material)
            return Look(mixed, names, None, [None], np.zeros(len(rows), np.int64))
        uv = textured[max(textured)][1]
        plain = [place for place in range(len(layers)) if place not in textured]
        shown = self._mixable(textured)
        textures, which = self._mixed_textures(colors, methods, has_material, shown, plain)
        return Look(np.ones((len(rows), 4), np.float32), names, uv, textures, which)

    def _mixable(
        self, textured: dict[int, tuple[Texture, NDArray[np.float64]]]
    ) -> dict[int, Texture]:
        """Return the textures that lie texel upon texel on the last one; note the others."""
        last, uv = textured[max(textured)]
        shown = {
            place: texture
            for place, (texture, at) in textured.items()
            if texture.size == last.size and np.array_equal(at, uv)
        }
        self._left_out.note("texture below another of a multi-property", len(textured) - len(shown))
        return shown

    def _mixed_textures(
        self, colors: list[_Floats], methods: list[str], has_material: bool,
        shown: dict[int, Texture], plain: list[int],
    ) -> tuple[list[Texture | None], NDArray[np.int64]]:  # fmt: skip
        """Return textures with the colours below and above mixed in, and which each entry shows."""
        kept = sorted({*plain, *shown})
        beside = np.concatenate([colors[place] for place in plain] or [colors[0]], axis=1)
        kinds, which = np.unique(beside, axis=0, return_inverse=True)
        if len(kinds) > _MOST_MIXED:
            self._left_out.note("colour of a multi-property under a texture", len(kinds) - 1)
            kinds, which = kinds.mean(axis=0, keepdims=True), np.zeros(len(beside), np.int64)
        texture = shown[max(shown)]
        made: list[Texture | None] = []
        for kind in kinds.reshape(len(kinds), -1, 4):
            constant = dict(zip(plain, kind, strict=False))
            stack = [
                shown[place].image
                if place in shown
                else np.broadcast_to(constant[place], texture.image.shape)
                for place in kept
            ]
            mixed = _blend(stack, [methods[place] for place in kept], has_material)
            self._budget.take("a mixed texture", mixed.nbytes * 2)
            made.append(Texture(mixed, wrap=texture.wrap, filter=texture.filter))
        return made, which.reshape(-1)

    def _texture(self, number: str) -> Texture | None:
        """Return a texture, or None, with a note, if it cannot be read."""
        if number not in self._textures:
            element = self._elements.get(number)
            label = f"texture {number[:80]!r}"
            try:
                if element is None or local_name(element.tag) != "texture2d":
                    raise ValueError("there is none of that number")
                tiles = [element.get(f"tilestyle{axis}", "wrap") for axis in "uv"]
                self._left_out.note("tile style 'none' of a texture", int("none" in tiles))
                content = self._package.content(element.get("path", ""))
                self._textures[number] = Texture(
                    self._decoder.decode("picture", content, label, ()),
                    wrap=(_TILES[tiles[0]], _TILES[tiles[1]]),
                    filter=_FILTERS[element.get("filter", "auto")],
                )
            except Exception as error:
                # Pillow raises what it likes about a damaged picture.
                self._left_out.note(f"{label} that cannot be read: {reason_of(error)}")
                self._textures[number] = None
        return self._textures[number]


def _blend(layers: list[_Floats], methods: list[str], has_material: bool) -> _Floats:
    """
    Mix layers, (..., 4) linear RGBA, from the lowest on.

    What lies on a material is mixed first, alone, and then laid over it.
    """
    first = 1 if has_material and len(layers) > 1 else 0
    color, alpha = layers[first][..., :3], layers[first][..., 3:]
    if first == 0 or methods[first] == "multiply":
        alpha = np.ones_like(alpha)
    for layer, method in zip(layers[first + 1 :], methods[first + 1 :], strict=True):
        over, share = layer[..., :3], layer[..., 3:]
        if method == "multiply":
            color, alpha = over * color, share * alpha
        else:
            color = over * share + color * (np.float32(1.0) - share)
            alpha = share + alpha * (np.float32(1.0) - share)
    if first:
        color = color * alpha + layers[0][..., :3] * (np.float32(1.0) - alpha)
    return np.concatenate([color, np.ones_like(alpha)], axis=-1)


def _color(said: str | None) -> list[int]:
    """Return a colour, ``#RRGGBB`` or ``#RRGGBBAA``, as bytes; white if none is said."""
    if said is None:
        return [255, 255, 255, 255]
    code = said.strip().removeprefix("#")
    if len(code) not in (6, 8):
        raise ValueError(f"a colour must be #RRGGBB or #RRGGBBAA, got {said[:80]!r}")
    return list(bytes.fromhex(code.ljust(8, "F")))


def _place(said: str, count: int) -> int:
    """Return the number of an entry, or raise ``ValueError`` if there are not that many."""
    number = int(said)
    if not 0 <= number < count:
        raise ValueError(f"a property must be below {count}, got {number}")
    return number
