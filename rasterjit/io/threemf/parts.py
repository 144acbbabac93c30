"""Split the mesh of a 3MF object by texture, and its corners by colour; make its lattice."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TypeAlias
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.foreign.codecs import Decoder
from rasterjit.io.load_warnings import LeftOut, reason_of
from rasterjit.io.text.mesh_builder import Part, joined, linear_rgba
from rasterjit.io.threemf.package import Package, children, local_name
from rasterjit.scene.material import Material
from rasterjit.scene.memory_limits import MemoryBudget
from rasterjit.scene.portable_trig import sine_cosine
from rasterjit.scene.texture import Filter, Texture, Wrap

_MATERIALS = ("basematerials", "compositematerials")
"""Groups that say what a body is made of: others are laid over them."""

GROUPS = (*_MATERIALS, "colorgroup", "texture2dgroup", "multiproperties")

_TILES: dict[str, Wrap] = {"wrap": "repeat", "mirror": "mirror", "clamp": "clamp", "none": "clamp"}
_FILTERS: dict[str, Filter] = {"auto": "trilinear", "linear": "bilinear", "nearest": "nearest"}

_ENTRY_BYTES = 96
"""What an entry of a group takes for each material or group that it mixes."""

_MAX_MIXED = 16
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
        self._layers: dict[str, _Layer] = {}
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

    def _layer_of(self, group: str) -> _Layer:
        """Return a group that others mix, made once."""
        if group not in self._layers:
            self._layers[group] = self._layer(self._group(group))
        return self._layers[group]

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
        below = self._layer_of(element.get("matid", "")).colors
        self._budget.take(
            "each of its mixtures of materials", len(element) * len(said) * _ENTRY_BYTES
        )
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
        layers = [self._layer_of(one) for one in element.get("pids", "").split()]
        self._budget.take("each of its multi-properties", len(element) * len(layers) * _ENTRY_BYTES)
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
        if len(kinds) > _MAX_MIXED:
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


_SIDES = ((5_000, 12), (50_000, 8))
"""Sides of the beams of lattices with up to so many of them."""

_MIN_SIDES = 6

_CAP = np.radians([90.0, 60.0, 30.0, 0.0])
"""Latitudes of the rings of a round end, from its pole to where the beam begins."""

_FLAT_RADII = np.array([0.0, 1.0, 1.0, 1.0])
"""Radii of the same rings of a flat end."""


def lengths(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of vectors, (N,), given (N, 3)."""
    x, y, z = vectors.T
    return np.sqrt(x * x + y * y + z * z)


def beam_sides(count: int) -> int:
    """Return how many sides each beam of a lattice has."""
    return next((sides for most, sides in _SIDES if count <= most), _MIN_SIDES)


def beam_faces(count: int) -> int:
    """Return how many faces the beams of a lattice have together."""
    return count * 2 * beam_sides(count) * (2 * len(_CAP) - 1)


def beam_surfaces(
    ends: NDArray[np.float64], radii: NDArray[np.float64], is_flat: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """
    Return the surfaces of beams, rings of vertices from one pole to the other.

    Parameters
    ----------
    ends : (N, 2, 3) float64
        Where each begins and ends; one of no length is a ball.
    radii : (N, 2) float64
        There.
    is_flat : (N, 2) bool
        Which ends are cut off; the others have half a ball.

    Returns
    -------
    vertices, normals : (N, R, K, 3) float64
        Of each beam, R rings, half of them of each end, of K sides.
    faces : (F, 3) int64
        Counter-clockwise from outside; flat rings of no width are kept.
    """
    count, sides = len(ends), beam_sides(len(ends))
    along = ends[:, 1] - ends[:, 0]
    length = lengths(along)
    axis = np.where(length[:, None] > 0.0, along, [0.0, 0.0, 1.0])
    axis /= lengths(axis)[:, None]
    # Any direction that is not along the axis.
    least = np.eye(3)[np.abs(axis).argmin(axis=1)]
    across = np.cross(axis, least)
    across /= lengths(across)[:, None]
    other = np.cross(axis, across)
    turn = 2.0 * np.pi * np.arange(sides) / sides
    sine, cosine = (one[None, :, None] for one in sine_cosine(turn))
    around = across[:, None] * cosine + other[:, None] * sine
    rise, width = sine_cosine(_CAP)
    vertices = np.empty((count, 2 * len(_CAP), sides, 3))
    normals = np.empty_like(vertices)
    for end, sign in ((0, -1.0), (1, 1.0)):
        flat = is_flat[:, end, None]
        wide = np.where(flat, _FLAT_RADII, width)
        high = np.where(flat, 0.0, rise)
        # A flat end has its own normals but at its last ring, where the side begins.
        up = np.where(flat, [1.0, 1.0, 1.0, 0.0], rise)
        out = np.where(flat, [0.0, 0.0, 0.0, 1.0], width)
        radius = radii[:, end, None]
        ring = around[:, None] * (wide * radius)[:, :, None, None]
        ring = ring + (axis[:, None] * (sign * high * radius)[:, :, None])[:, :, None]
        normal = around[:, None] * out[:, :, None, None]
        normal = normal + (axis[:, None] * (sign * up)[:, :, None])[:, :, None]
        rows = slice(0, len(_CAP)) if end == 0 else slice(None, len(_CAP) - 1, -1)
        vertices[:, rows] = ring + ends[:, end, None, None]
        normals[:, rows] = normal
    return vertices, normals, _ring_faces(count, sides)


def _ring_faces(count: int, sides: int) -> NDArray[np.int64]:
    """Return the faces between the rings of each beam."""
    rings = 2 * len(_CAP)
    first = np.arange(rings - 1)[:, None] * sides + np.arange(sides)
    after = np.arange(rings - 1)[:, None] * sides + (np.arange(sides) + 1) % sides
    quads = np.stack([first, after, after + sides, first + sides], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return (np.arange(count)[:, None, None] * rings * sides + faces).reshape(-1, 3)


_READ_OF_TRIANGLES = {"v1", "v2", "v3", "p1", "p2", "p3", "pid"}

_BEAM_FACE_BYTES = 200
"""What a face of a beam takes, with its vertices and their normals."""

_CAPS = ("sphere", "hemisphere", "butt")


class _Corners:
    """
    What the corners of N triangles or beams show.

    Parameters
    ----------
    elements : list of Element
        Each with numbers of properties, one for each of its ``width`` corners.
    keys : tuple of str
        What they call these numbers.
    defaults : (str or None, str or None)
        ``pid`` and ``pindex`` of those that have none.
    """

    def __init__(
        self,
        elements: list[ElementTree.Element],
        keys: tuple[str, ...],
        defaults: tuple[str | None, str | None],
        properties: Properties,
        left_out: LeftOut,
    ) -> None:
        group, entry = defaults
        count, width = len(elements), len(keys)
        self.entries = np.zeros((count, width), np.int64)
        self.groups = np.zeros(count, np.int64)
        self.textures: list[Texture | None] = [None]
        self.which = np.zeros(count, np.int64)
        self.colors = np.empty((count, width, 4), np.float32)
        self.colors[:] = Material().base_color_over(False)
        self.uv = np.zeros((count, width, 2))
        self.names: set[str | None] = set()
        of_pid: dict[str, list[int]] = {}
        for row, one in enumerate(elements):
            said = one.get("pid", group)
            first = one.get(keys[0])
            if said is None:
                continue
            of_pid.setdefault(said, []).append(row)
            if first is None:
                # A group without a number of its own: the object's is one of another group.
                first = entry if said == group else "0"
            self.entries[row] = [int(one.get(key, first or "0")) for key in keys]
        self.is_plain = not of_pid
        if sum(map(len, of_pid.values())) < count:
            self.names.add(None)
        for number, (said, found) in enumerate(of_pid.items(), 1):
            rows = np.array(found)
            self._take(said, number, rows, properties, left_out)

    def _take(
        self, said: str, number: int, rows: NDArray[np.int64], properties: Properties,
        left_out: LeftOut,
    ) -> None:  # fmt: skip
        """Take what a group gives to some rows."""
        look, entries = properties.look(said), self.entries[rows]
        if entries.min() < 0 or entries.max() >= len(look.colors):
            raise ValueError(
                f"properties of group {said[:80]!r} must be below {len(look.colors)}, got "
                f"{int(entries.max())}"
            )
        self.groups[rows] = number
        self.colors[rows] = look.colors[entries]
        self.names |= {look.names[entry] for entry in np.unique(entries).tolist()}
        if look.uv is not None:
            self.uv[rows] = look.uv[entries]
        which = look.which[entries]
        differs = (which != which[:, :1]).any(axis=1)
        left_out.note("change of colour below a texture", int(np.count_nonzero(differs)))
        places = np.array([self._place(texture) for texture in look.textures])
        self.which[rows] = places[which[:, 0]]

    def _place(self, texture: Texture | None) -> int:
        """Return the number of a texture, a new one if it has none."""
        for place, one in enumerate(self.textures):
            if one is texture:
                return place
        self.textures.append(texture)
        return len(self.textures) - 1


def surface_parts(
    name: str, element: ElementTree.Element, mesh: ElementTree.Element,
    vertices: NDArray[np.float64], properties: Properties, left_out: LeftOut,
) -> list[Part]:  # fmt: skip
    """Return the triangles of a mesh, those of each texture as one part."""
    triangles = [
        one for group in children(mesh, "triangles") for one in children(group, "triangle")
    ]
    if not triangles:
        return []
    others = Counter(
        local_name(key)
        for one in triangles
        if len(one.attrib) > 3
        for key in one.attrib
        if key not in _READ_OF_TRIANGLES
    )
    for key, count in others.items():
        left_out.note(f"{key} of a triangle", count)
    faces = np.array(
        [(int(one.attrib["v1"]), int(one.attrib["v2"]), int(one.attrib["v3"])) for one in triangles]
    )
    _check_vertices(name, faces, len(vertices))
    defaults = element.get("pid"), element.get("pindex")
    corners = _Corners(triangles, ("p1", "p2", "p3"), defaults, properties, left_out)
    if corners.is_plain:
        return [Part(name, vertices, faces)]
    return [
        _colored(name, vertices, faces, corners, np.flatnonzero(corners.which == place))
        for place in np.unique(corners.which).tolist()
    ]


def _colored(
    name: str, vertices: NDArray[np.float64], faces: NDArray[np.int64], corners: _Corners,
    rows: NDArray[np.int64],
) -> Part:  # fmt: skip
    """Return some triangles, with one texture, as a part: vertices split where corners differ."""
    faces, colors = faces[rows], corners.colors[rows]
    texture = corners.textures[int(corners.which[rows[0]])]
    material, is_one = _material(colors, corners, texture)
    is_flat = is_one or bool((colors == colors[:, :1]).all())
    if texture is None and is_flat and (is_one or len(faces) != len(vertices)):
        return Part(name, vertices, faces, None, None, None if is_one else colors[:, 0], material)
    groups = np.broadcast_to(corners.groups[rows, None], faces.shape)
    keys = np.column_stack([faces.ravel(), groups.ravel(), corners.entries[rows].ravel()])
    kept, which = joined(keys)
    uv = None if texture is None else corners.uv[rows].reshape(-1, 2)[kept]
    shown = None if is_one else colors.reshape(-1, 4)[kept]
    return Part(
        name, vertices[keys[kept, 0]], which.reshape(-1, 3), None, uv, shown, material
    )  # fmt: skip


def _material(
    colors: NDArray[np.float32], corners: _Corners, texture: Texture | None
) -> tuple[Material, bool]:
    """Return the material of faces, with its name, and with their colour, if all have one."""
    color = colors.reshape(-1, 4)[0]
    is_one = bool((colors == color).all())
    material = Material(
        base_color=tuple(color.tolist()) if is_one else None,
        name=next(iter(corners.names)) if len(corners.names) == 1 else None,
        base_color_texture=texture,
        alpha_mode="blend" if colors[..., 3].min() < 1.0 else "opaque",
    )
    return material, is_one


def beam_part(
    name: str, element: ElementTree.Element, lattice: ElementTree.Element,
    vertices: NDArray[np.float64], properties: Properties, left_out: LeftOut, budget: MemoryBudget,
) -> list[Part]:  # fmt: skip
    """Return the beams and balls of a lattice as one part, or none if it has none."""
    # Beams: their ends, radii and caps.
    if lattice.get("clippingmode", "none") != "none":
        left_out.note("clipping of a beam lattice")
    beams = [one for group in children(lattice, "beams") for one in children(group, "beam")]
    radius, shortest = float(lattice.get("radius", "nan")), float(lattice.get("minlength", "0"))
    cap = lattice.get("cap", "sphere")
    ends = np.array([(int(one.attrib["v1"]), int(one.attrib["v2"])) for one in beams], np.int64)
    ends = ends.reshape(-1, 2)
    radii = np.empty((len(beams), 2))
    is_flat = np.zeros((len(beams), 2), bool)
    for row, one in enumerate(beams):
        first = float(one.get("r1", radius))
        radii[row] = first, float(one.get("r2", first))
        is_flat[row] = [_is_flat(one.get(key, cap)) for key in ("cap1", "cap2")]
    # Balls are beams of no length.
    balls = _balls(lattice, ends)
    if not len(beams) and not balls:
        return []
    defaults = lattice.get("pid", element.get("pid")), lattice.get("pindex", element.get("pindex"))
    places = np.array([int(one.attrib["vindex"]) for one in balls], np.int64)
    ends = np.concatenate([ends, np.column_stack([places, places])])
    sizes = [float(one.get("r", "") or lattice.get("ballradius", "nan")) for one in balls]
    radii = np.concatenate([radii, np.column_stack([sizes, sizes]).reshape(-1, 2)])
    is_flat = np.concatenate([is_flat, np.zeros((len(balls), 2), bool)])
    _check_vertices(name, ends, len(vertices))
    if not (np.isfinite(radii).all() and radii.min() >= 0.0):
        raise ValueError(f"radii of the beams of {name[:80]!r} must be finite and at least 0")
    # Colours of both.
    corners = _Corners(beams, ("p1", "p2"), defaults, properties, left_out)
    of_balls = _Corners(balls, ("p",), defaults, properties, left_out)
    if any(one is not None for one in (*corners.textures, *of_balls.textures)):
        left_out.note("texture of a beam lattice")
    colors = np.concatenate([corners.colors, np.repeat(of_balls.colors, 2, axis=1)])
    corners.names |= of_balls.names
    # Those that are long enough, as surfaces.
    stands = vertices[ends]
    length = lengths(stands[:, 1] - stands[:, 0])
    kept = (length >= shortest) & (length > 0.0)
    kept[len(beams) :] = True
    left_out.note("beam that is shorter than its lattice allows", int(np.count_nonzero(~kept)))
    if not kept.any():
        return []
    budget.take(
        f"the beams of {name[:80]!r}", beam_faces(int(np.count_nonzero(kept))) * _BEAM_FACE_BYTES
    )
    points, normals, faces = beam_surfaces(stands[kept], radii[kept], is_flat[kept])
    colors = colors[kept]
    # One material, or a colour for each vertex.
    material, shown = None, None
    if not (corners.is_plain and of_balls.is_plain):
        material, is_one = _material(colors, corners, None)
    if material is not None and not is_one:
        halves = np.repeat(colors, points.shape[1] // 2, axis=1)
        shown = np.repeat(halves, points.shape[2], axis=1).reshape(-1, 4)
    rows = points.reshape(-1, 3), faces, normals.reshape(-1, 3)
    return [Part(f"{name} beams", *rows, colors=shown, material=material)]


def _balls(lattice: ElementTree.Element, ends: NDArray[np.int64]) -> list[ElementTree.Element]:
    """Return the balls of a lattice; where all ends have one, those that it does not name too."""
    mode = lattice.get("ballmode", "none")
    if mode == "none":
        return []
    balls = [one for group in children(lattice, "balls") for one in children(group, "ball")]
    if mode == "all":
        named = {int(one.attrib["vindex"]) for one in balls}
        further = sorted(set(np.unique(ends).tolist()) - named)
        balls += [ElementTree.Element("ball", vindex=str(vertex)) for vertex in further]
    return balls


def _is_flat(cap: str) -> bool:
    """Tell whether a beam is cut off at an end, or raise ``ValueError``."""
    if cap not in _CAPS:
        raise ValueError(f"the cap of a beam must be one of {', '.join(_CAPS)}, got {cap[:80]!r}")
    return cap == "butt"


def _check_vertices(name: str, numbers: NDArray[np.int64], count: int) -> None:
    """Raise ``ValueError`` if a number is that of no vertex."""
    if len(numbers) and not 0 <= numbers.min() <= numbers.max() < count:
        wrong = numbers.max() if numbers.max() >= count else numbers.min()
        raise ValueError(
            f"mesh {name[:80]!r}: vertices must be numbered from 0 to {count - 1}, got {int(wrong)}"
        )
