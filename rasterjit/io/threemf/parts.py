"""Split the mesh of a 3MF object by texture, and its vertices by colour; build beam lattices."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TypeAlias
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.foreign.codecs import Decoder
from rasterjit.io.load_warnings import LeftOut, reason_of
from rasterjit.io.text.mesh_builder import MeshData, number_rows, srgb_to_rgba
from rasterjit.io.threemf.package import Package, find_all, strip_prefix
from rasterjit.scene.arrows import compute_perpendiculars
from rasterjit.scene.material import Material
from rasterjit.scene.memory_limits import MemoryBudget
from rasterjit.scene.portable_trig import sin_cos
from rasterjit.scene.texture import Filter, Texture, Wrap

_MATERIAL_GROUPS = ("basematerials", "compositematerials")
"""Groups of materials; other properties are layered over these."""

PROPERTY_GROUPS = (*_MATERIAL_GROUPS, "colorgroup", "texture2dgroup", "multiproperties")

_WRAPS: dict[str, Wrap] = {"wrap": "repeat", "mirror": "mirror", "clamp": "clamp", "none": "clamp"}
_FILTERS: dict[str, Filter] = {"auto": "trilinear", "linear": "bilinear", "nearest": "nearest"}

_ENTRY_MEMORY = 96
"""Memory of an entry of a group for each material or group that it mixes."""

_MAX_MIXED_TEXTURES = 16
"""Most textures that one multi-property mixes, each with other colours."""

_Floats: TypeAlias = "NDArray[np.float32]"


@dataclass(frozen=True)
class PropertyGroup:
    """
    The N entries of a property group, as corners of triangles refer to them.

    Parameters
    ----------
    colors : (N, 4) float32
        Linear RGBA; multiplies the texture, if there is one.
    names : list of str or None
        What each is called.
    uv : (N, 2) float64, optional
        v upwards.
    textures : list of Texture or None
    texture_ids : (N,) int
        The texture of each.
    """

    colors: _Floats
    names: list[str | None]
    uv: NDArray[np.float64] | None
    textures: list[Texture | None]
    texture_ids: NDArray[np.int64]


@dataclass(frozen=True)
class _MixLayer:
    """A group that a multi-property mixes: the colours or texture of its entries."""

    colors: _Floats
    uv: NDArray[np.float64] | None = None
    texture: Texture | None = None
    is_material: bool = False


class Properties:
    """
    Reads the property groups of one model.

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
            if strip_prefix(one.tag) in (*PROPERTY_GROUPS, "texture2d")
        }
        self._package = package
        self._left_out = left_out
        self._budget, self._decoder = budget, decoder
        self._groups: dict[str, PropertyGroup] = {}
        self._layers: dict[str, _MixLayer] = {}
        self._textures: dict[str, Texture | None] = {}

    def group(self, group: str) -> PropertyGroup:
        """Return a property group, or raise ``ValueError`` if it does not exist."""
        if group not in self._groups:
            element = self._find_group(group)
            if strip_prefix(element.tag) == "multiproperties":
                self._groups[group] = self._read_multiproperties(element)
            else:
                mix_layer = self._read_layer(element)
                names = [one.get("name") for one in element]
                opaque = mix_layer.colors.copy()
                if not mix_layer.is_material:
                    opaque[:, 3] = 1.0
                self._groups[group] = PropertyGroup(
                    opaque, names, mix_layer.uv, [mix_layer.texture], np.zeros(len(names), np.int64)
                )
        return self._groups[group]

    def _find_group(self, group: str) -> ElementTree.Element:
        """Return the element of a group, or raise ``ValueError``."""
        element = self._elements.get(group)
        if element is None or strip_prefix(element.tag) not in PROPERTY_GROUPS:
            raise ValueError(f"there is no group of properties {group[:80]!r}")
        return element

    def _get_layer(self, group: str) -> _MixLayer:
        """Return a group as a layer of a multi-property, read once."""
        if group not in self._layers:
            self._layers[group] = self._read_layer(self._find_group(group))
        return self._layers[group]

    def _read_layer(self, element: ElementTree.Element) -> _MixLayer:
        """Return a group that is no multi-property as a layer."""
        kind, count = strip_prefix(element.tag), len(element)
        if kind == "texture2dgroup":
            uv = np.array([[float(one.get(key, "")) for key in "uv"] for one in element])
            texture = self._read_texture(element.get("texid", ""))
            white = np.ones((count, 4), np.float32)
            return _MixLayer(white, None if texture is None else uv.reshape(-1, 2), texture)
        if kind == "compositematerials":
            return _MixLayer(self._mix_composites(element), is_material=True)
        key = "displaycolor" if kind == "basematerials" else "color"
        colors = [_parse_color(one.get(key)) for one in element]
        rgba = srgb_to_rgba(np.array(colors, np.uint8).reshape(-1, 4))
        return _MixLayer(rgba, is_material=kind == "basematerials")

    def _mix_composites(self, element: ElementTree.Element) -> _Floats:
        """Return the colours of composite materials: means weighted by their shares."""
        indices = element.get("matindices", "").split()
        base = self._get_layer(element.get("matid", "")).colors
        self._budget.take(
            "each of its mixtures of materials", len(element) * len(indices) * _ENTRY_MEMORY
        )
        colors = base[[_parse_index(one, len(base)) for one in indices]]
        shares = np.zeros((len(element), len(colors)))
        for row, one in zip(shares, element, strict=True):
            values = [float(value) for value in one.get("values", "").split()][: len(row)]
            row[: len(values)] = values
        total = shares.sum(axis=1, keepdims=True)
        shares = np.where(total > 0.0, shares, 1.0) / np.where(total > 0.0, total, len(colors))
        # A sum over a row each: the same bits on every CPU.
        return (shares[:, :, None] * colors).sum(axis=1).astype(np.float32)

    def _read_multiproperties(self, element: ElementTree.Element) -> PropertyGroup:
        """Return a multi-property as a group, its layers mixed for every entry."""
        layers = [self._get_layer(one) for one in element.get("pids", "").split()]
        self._budget.take(
            "each of its multi-properties", len(element) * len(layers) * _ENTRY_MEMORY
        )
        if not layers:
            raise ValueError("a multi-property must mix at least one group")
        methods = ["mix", *element.get("blendmethods", "").split()][: len(layers)]
        methods += ["mix"] * (len(layers) - len(methods))
        rows = np.zeros((len(element), len(layers)), np.int64)
        for row, one in zip(rows, element, strict=True):
            indices = one.get("pindices", "").split()
            for index, layer in enumerate(layers[: len(indices)]):
                row[index] = _parse_index(indices[index], len(layer.colors))
        colors = [layer.colors[row] for layer, row in zip(layers, rows.T, strict=True)]
        has_material = layers[0].is_material
        textured = {
            index: (layer.texture, layer.uv[rows[:, index]])
            for index, layer in enumerate(layers)
            if layer.texture is not None and layer.uv is not None
        }
        names: list[str | None] = [None] * len(rows)
        if not textured:
            mixed = _blend(colors, methods, has_material)
            return PropertyGroup(mixed, names, None, [None], np.zeros(len(rows), np.int64))
        uv = textured[max(textured)][1]
        plain = [index for index in range(len(layers)) if index not in textured]
        mixable = self._select_mixable(textured)
        textures, texture_ids = self._mix_textures(colors, methods, has_material, mixable, plain)
        return PropertyGroup(np.ones((len(rows), 4), np.float32), names, uv, textures, texture_ids)

    def _select_mixable(
        self, textured: dict[int, tuple[Texture, NDArray[np.float64]]]
    ) -> dict[int, Texture]:
        """Return the textures that match the last one texel by texel; note the others."""
        last, uv = textured[max(textured)]
        mixed = {
            index: texture
            for index, (texture, layer_uv) in textured.items()
            if texture.size == last.size and np.array_equal(layer_uv, uv)
        }
        self._left_out.note("texture below another of a multi-property", len(textured) - len(mixed))
        return mixed

    def _mix_textures(
        self, colors: list[_Floats], methods: list[str], has_material: bool,
        textured: dict[int, Texture], plain: list[int],
    ) -> tuple[list[Texture | None], NDArray[np.int64]]:  # fmt: skip
        """Return textures with the colours of other layers mixed in, and that of each entry."""
        order = sorted({*plain, *textured})
        flat = np.concatenate([colors[index] for index in plain] or [colors[0]], axis=1)
        rows, texture_ids = np.unique(flat, axis=0, return_inverse=True)
        if len(rows) > _MAX_MIXED_TEXTURES:
            self._left_out.note("colour of a multi-property under a texture", len(rows) - 1)
            rows, texture_ids = rows.mean(axis=0, keepdims=True), np.zeros(len(flat), np.int64)
        texture = textured[max(textured)]
        textures: list[Texture | None] = []
        for row in rows.reshape(len(rows), -1, 4):
            constant = dict(zip(plain, row, strict=False))
            stack = [
                textured[index].image
                if index in textured
                else np.broadcast_to(constant[index], (*texture.size[::-1], 4))
                for index in order
            ]
            mixed = _blend(stack, [methods[index] for index in order], has_material)
            self._budget.take("a mixed texture", mixed.nbytes * 2)
            textures.append(Texture(mixed, wrap=texture.wrap, filter=texture.filter))
        return textures, texture_ids.reshape(-1)

    def _read_texture(self, number: str) -> Texture | None:
        """Return a texture, or None, with a note, if it cannot be read."""
        if number not in self._textures:
            element = self._elements.get(number)
            label = f"texture {number[:80]!r}"
            try:
                if element is None or strip_prefix(element.tag) != "texture2d":
                    raise ValueError("there is none of that number")
                tiles = [element.get(f"tilestyle{axis}", "wrap") for axis in "uv"]
                self._left_out.note("tile style 'none' of a texture", int("none" in tiles))
                content = self._package.content(element.get("path", ""))
                self._textures[number] = Texture(
                    self._decoder.decode("picture", content, label, ()),
                    wrap=(_WRAPS[tiles[0]], _WRAPS[tiles[1]]),
                    filter=_FILTERS[element.get("filter", "auto")],
                )
            except Exception as error:
                # Pillow raises what it likes about a damaged picture.
                self._left_out.note(f"{label} that cannot be read: {reason_of(error)}")
                self._textures[number] = None
        return self._textures[number]


def _blend(layers: list[_Floats], methods: list[str], has_material: bool) -> _Floats:
    """
    Mix layers, (..., 4) linear RGBA, from the lowest to the highest.

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


def _parse_color(text: str | None) -> list[int]:
    """Parse a colour, ``#RRGGBB`` or ``#RRGGBBAA``, to bytes; white if it is missing."""
    if text is None:
        return [255, 255, 255, 255]
    code = text.strip().removeprefix("#")
    if len(code) not in (6, 8):
        raise ValueError(f"a colour must be #RRGGBB or #RRGGBBAA, got {text[:80]!r}")
    return list(bytes.fromhex(code.ljust(8, "F")))


def _parse_index(text: str, count: int) -> int:
    """Parse the index of an entry, or raise ``ValueError`` if it is out of range."""
    number = int(text)
    if not 0 <= number < count:
        raise ValueError(f"a property must be below {count}, got {number}")
    return number


_BEAM_SIDES = ((5_000, 12), (50_000, 8))
"""Most beams of a lattice, and the number of sides that they get."""

_MIN_SIDES = 6

_LATITUDES = np.radians([90.0, 60.0, 30.0, 0.0])
"""Latitudes of the rings of a hemisphere cap, from its pole to the beam."""

_FLAT_CAP_RADII = np.array([0.0, 1.0, 1.0, 1.0])
"""Radii of the same rings of a flat cap."""


def compute_norms(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of vectors, (N,), given (N, 3)."""
    x, y, z = vectors.T
    return np.sqrt(x * x + y * y + z * z)


def choose_beam_sides(count: int) -> int:
    """Return the number of sides of each beam of a lattice."""
    return next((sides for most, sides in _BEAM_SIDES if count <= most), _MIN_SIDES)


def count_beam_faces(count: int) -> int:
    """Return the number of faces of all beams of a lattice."""
    return count * 2 * choose_beam_sides(count) * (2 * len(_LATITUDES) - 1)


def make_beam_surfaces(
    ends: NDArray[np.float64], radii: NDArray[np.float64], is_flat: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """
    Return the surfaces of beams: rings of vertices from one pole to the other.

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
    count, sides = len(ends), choose_beam_sides(len(ends))
    along = ends[:, 1] - ends[:, 0]
    length = compute_norms(along)
    axis = np.where(length[:, None] > 0.0, along, [0.0, 0.0, 1.0])
    axis /= compute_norms(axis)[:, None]
    across = compute_perpendiculars(axis)
    other = np.cross(axis, across)
    angles = 2.0 * np.pi * np.arange(sides) / sides
    sine, cosine = (one[None, :, None] for one in sin_cos(angles))
    around = across[:, None] * cosine + other[:, None] * sine
    rise, width = sin_cos(_LATITUDES)
    vertices = np.empty((count, 2 * len(_LATITUDES), sides, 3))
    normals = np.empty_like(vertices)
    for end, sign in ((0, -1.0), (1, 1.0)):
        flat = is_flat[:, end, None]
        ring_radius = np.where(flat, _FLAT_CAP_RADII, width)
        ring_height = np.where(flat, 0.0, rise)
        # A flat end has its own normals but at its last ring, where the side begins.
        axis_weight = np.where(flat, [1.0, 1.0, 1.0, 0.0], rise)
        radial_weight = np.where(flat, [0.0, 0.0, 0.0, 1.0], width)
        radius = radii[:, end, None]
        ring = around[:, None] * (ring_radius * radius)[:, :, None, None]
        ring = ring + (axis[:, None] * (sign * ring_height * radius)[:, :, None])[:, :, None]
        normal = around[:, None] * radial_weight[:, :, None, None]
        normal = normal + (axis[:, None] * (sign * axis_weight)[:, :, None])[:, :, None]
        rows = slice(0, len(_LATITUDES)) if end == 0 else slice(None, len(_LATITUDES) - 1, -1)
        vertices[:, rows] = ring + ends[:, end, None, None]
        normals[:, rows] = normal
    return vertices, normals, _make_ring_faces(count, sides)


def _make_ring_faces(count: int, sides: int) -> NDArray[np.int64]:
    """Return the faces between the rings of each beam."""
    rings = 2 * len(_LATITUDES)
    first = np.arange(rings - 1)[:, None] * sides + np.arange(sides)
    after = np.arange(rings - 1)[:, None] * sides + (np.arange(sides) + 1) % sides
    quads = np.stack([first, after, after + sides, first + sides], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return (np.arange(count)[:, None, None] * rings * sides + faces).reshape(-1, 3)


_TRIANGLE_ATTRIBUTES = {"v1", "v2", "v3", "p1", "p2", "p3", "pid"}

_BEAM_FACE_MEMORY = 200
"""Memory of a face of a beam, with its vertices and their normals."""

_CAP_MODES = ("sphere", "hemisphere", "butt")


class _Corners:
    """
    Colours, textures and UV of the corners of N triangles or beams.

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
        self.texture_ids = np.zeros(count, np.int64)
        self.colors = np.empty((count, width, 4), np.float32)
        self.colors[:] = Material().base_color_over(False)
        self.uv = np.zeros((count, width, 2))
        self.names: set[str | None] = set()
        rows_by_pid: dict[str, list[int]] = {}
        for row, one in enumerate(elements):
            pid = one.get("pid", group)
            first = one.get(keys[0])
            if pid is None:
                continue
            rows_by_pid.setdefault(pid, []).append(row)
            if first is None:
                # A group without a number of its own: the object's is one of another group.
                first = entry if pid == group else "0"
            self.entries[row] = [int(one.get(key, first or "0")) for key in keys]
        self.has_default_color = not rows_by_pid
        if sum(map(len, rows_by_pid.values())) < count:
            self.names.add(None)
        for number, (pid, rows_of_pid) in enumerate(rows_by_pid.items(), 1):
            rows = np.array(rows_of_pid)
            self._read_group(pid, number, rows, properties, left_out)

    def _read_group(
        self, pid: str, number: int, rows: NDArray[np.int64], properties: Properties,
        left_out: LeftOut,
    ) -> None:  # fmt: skip
        """Set the properties of some rows from their group."""
        group, entries = properties.group(pid), self.entries[rows]
        if entries.min() < 0 or entries.max() >= len(group.colors):
            raise ValueError(
                f"properties of group {pid[:80]!r} must be below {len(group.colors)}, got "
                f"{int(entries.max())}"
            )
        self.groups[rows] = number
        self.colors[rows] = group.colors[entries]
        self.names |= {group.names[entry] for entry in np.unique(entries).tolist()}
        if group.uv is not None:
            self.uv[rows] = group.uv[entries]
        entry_textures = group.texture_ids[entries]
        differs = (entry_textures != entry_textures[:, :1]).any(axis=1)
        left_out.note("change of colour below a texture", int(np.count_nonzero(differs)))
        numbers = np.array([self._number_texture(texture) for texture in group.textures])
        self.texture_ids[rows] = numbers[entry_textures[:, 0]]

    def _number_texture(self, texture: Texture | None) -> int:
        """Return the number of a texture, appended if it is new."""
        for number, one in enumerate(self.textures):
            if one is texture:
                return number
        self.textures.append(texture)
        return len(self.textures) - 1


def make_surfaces(
    name: str, element: ElementTree.Element, mesh: ElementTree.Element,
    vertices: NDArray[np.float64], properties: Properties, left_out: LeftOut,
) -> list[MeshData]:  # fmt: skip
    """Return the triangles of a mesh as one part for each texture."""
    triangles = find_all(mesh, "triangles", "triangle")
    if not triangles:
        return []
    unread = Counter(
        strip_prefix(key)
        for one in triangles
        if len(one.attrib) > 3
        for key in one.attrib
        if key not in _TRIANGLE_ATTRIBUTES
    )
    for key, count in unread.items():
        left_out.note(f"{key} of a triangle", count)
    faces = np.array(
        [(int(one.attrib["v1"]), int(one.attrib["v2"]), int(one.attrib["v3"])) for one in triangles]
    )
    _check_vertices(name, faces, len(vertices))
    defaults = element.get("pid"), element.get("pindex")
    corners = _Corners(triangles, ("p1", "p2", "p3"), defaults, properties, left_out)
    if corners.has_default_color:
        return [MeshData(name, vertices, faces)]
    return [
        _make_textured_mesh(
            name, vertices, faces, corners, np.flatnonzero(corners.texture_ids == number)
        )
        for number in np.unique(corners.texture_ids).tolist()
    ]


def _make_textured_mesh(
    name: str, vertices: NDArray[np.float64], faces: NDArray[np.int64], corners: _Corners,
    rows: NDArray[np.int64],
) -> MeshData:  # fmt: skip
    """Return the triangles of one texture as a mesh, with vertices split where corners differ."""
    faces, colors = faces[rows], corners.colors[rows]
    texture = corners.textures[int(corners.texture_ids[rows[0]])]
    material, is_uniform = _make_material(colors, corners, texture)
    is_flat = is_uniform or bool((colors == colors[:, :1]).all())
    if texture is None and is_flat and (is_uniform or len(faces) != len(vertices)):
        return MeshData(
            name, vertices, faces, None, None, None if is_uniform else colors[:, 0], material
        )
    groups = np.broadcast_to(corners.groups[rows, None], faces.shape)
    keys = np.column_stack([faces.ravel(), groups.ravel(), corners.entries[rows].ravel()])
    picked, indices = number_rows(keys)
    uv = None if texture is None else corners.uv[rows].reshape(-1, 2)[picked]
    rgba = None if is_uniform else colors.reshape(-1, 4)[picked]
    return MeshData(
        name, vertices[keys[picked, 0]], indices.reshape(-1, 3), None, uv, rgba, material
    )  # fmt: skip


def _make_material(
    colors: NDArray[np.float32], corners: _Corners, texture: Texture | None
) -> tuple[Material, bool]:
    """Return the material of faces, and whether all have its colour."""
    color = colors.reshape(-1, 4)[0]
    is_uniform = bool((colors == color).all())
    material = Material(
        base_color=tuple(color.tolist()) if is_uniform else None,
        name=next(iter(corners.names)) if len(corners.names) == 1 else None,
        base_color_texture=texture,
        alpha_mode="blend" if colors[..., 3].min() < 1.0 else "opaque",
    )
    return material, is_uniform


def make_beams(
    name: str, element: ElementTree.Element, lattice: ElementTree.Element,
    vertices: NDArray[np.float64], properties: Properties, left_out: LeftOut, budget: MemoryBudget,
) -> list[MeshData]:  # fmt: skip
    """Return the beams and balls of a lattice as one mesh, or []."""
    # Beams: their ends, radii and caps.
    if lattice.get("clippingmode", "none") != "none":
        left_out.note("clipping of a beam lattice")
    beams = find_all(lattice, "beams", "beam")
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
    balls = _list_balls(lattice, ends)
    if not len(beams) and not balls:
        return []
    defaults = lattice.get("pid", element.get("pid")), lattice.get("pindex", element.get("pindex"))
    ball_vertices = np.array([int(one.attrib["vindex"]) for one in balls], np.int64)
    ends = np.concatenate([ends, np.column_stack([ball_vertices, ball_vertices])])
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
    end_positions = vertices[ends]
    length = compute_norms(end_positions[:, 1] - end_positions[:, 0])
    is_kept = (length >= shortest) & (length > 0.0)
    is_kept[len(beams) :] = True
    left_out.note("beam that is shorter than its lattice allows", int(np.count_nonzero(~is_kept)))
    if not is_kept.any():
        return []
    budget.take(
        f"the beams of {name[:80]!r}",
        count_beam_faces(int(np.count_nonzero(is_kept))) * _BEAM_FACE_MEMORY,
    )
    points, normals, faces = make_beam_surfaces(
        end_positions[is_kept], radii[is_kept], is_flat[is_kept]
    )
    colors = colors[is_kept]
    # One material, or a colour for each vertex.
    material, rgba = None, None
    if not (corners.has_default_color and of_balls.has_default_color):
        material, is_uniform = _make_material(colors, corners, None)
    if material is not None and not is_uniform:
        halves = np.repeat(colors, points.shape[1] // 2, axis=1)
        rgba = np.repeat(halves, points.shape[2], axis=1).reshape(-1, 4)
    rows = points.reshape(-1, 3), faces, normals.reshape(-1, 3)
    return [MeshData(f"{name} beams", *rows, colors=rgba, material=material)]


def _list_balls(lattice: ElementTree.Element, ends: NDArray[np.int64]) -> list[ElementTree.Element]:
    """Return the balls of a lattice, with those of the mode ``all``."""
    mode = lattice.get("ballmode", "none")
    if mode == "none":
        return []
    balls = find_all(lattice, "balls", "ball")
    if mode == "all":
        listed = {int(one.attrib["vindex"]) for one in balls}
        unlisted = sorted(set(np.unique(ends).tolist()) - listed)
        balls += [ElementTree.Element("ball", vindex=str(vertex)) for vertex in unlisted]
    return balls


def _is_flat(cap: str) -> bool:
    """Tell whether the cap of a beam is flat, or raise ``ValueError``."""
    if cap not in _CAP_MODES:
        raise ValueError(
            f"the cap of a beam must be one of {', '.join(_CAP_MODES)}, got {cap[:80]!r}"
        )
    return cap == "butt"


def _check_vertices(name: str, numbers: NDArray[np.int64], count: int) -> None:
    """Raise ``ValueError`` if vertex numbers are out of range."""
    if len(numbers) and not 0 <= numbers.min() <= numbers.max() < count:
        wrong = numbers.max() if numbers.max() >= count else numbers.min()
        raise ValueError(
            f"mesh {name[:80]!r}: vertices must be numbered from 0 to {count - 1}, got {int(wrong)}"
        )
