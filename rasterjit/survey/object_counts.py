"""Count the objects of a scene by property, and check their attributes and textures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.scene.contours import Contours
from rasterjit.scene.material import SHADINGS, TEXTURE_FIELDS, Material
from rasterjit.scene.mesh import ATTRIBUTE, Mesh
from rasterjit.scene.node import Node, check_no_groups, meshes_of
from rasterjit.scene.points import Points
from rasterjit.scene.quality import Quality
from rasterjit.scene.scalar_field import ColorScale
from rasterjit.scene.texture import UV_NAMES, WEIGHTED, AlphaUse, Texture
from rasterjit.survey.object_transforms import compute_mesh_boxes
from rasterjit.survey.quality_overrides import override_meshes

SMOOTH = frozenset(("gouraud", "phong", "pbr"))
"""Shading models that read vertex normals."""

BLINN_PHONG = frozenset(("flat", "gouraud", "phong"))
"""Shading models that have a Blinn-Phong highlight."""


class ObjectCounts(NamedTuple):
    """
    Numbers of objects with each property that decides what a frame needs.

    The first fields are those of ``SHADINGS``.
    """

    unlit: int
    flat: int
    gouraud: int
    phong: int
    pbr: int
    objects: int
    with_uv: int
    """With texture coordinates."""
    without_uv: int
    """With a texture, but without its texture coordinates."""
    highlights: int
    """With a specular highlight."""
    tinted_highlights: int
    """Gouraud-shaded with a highlight, and multiplied by a texture or face colours."""
    masked: int
    """Whose material has an alpha mask."""
    cut_out: int
    """That can fail the alpha test somewhere."""
    textured_holes: int
    """Of those, with a base colour texture."""
    cutouts_without_uv: int
    """Of those, without texture coordinates."""
    blended: int
    """Whose material is blended."""
    see_through: int
    """That are transparent."""
    casting: int
    """That cast shadows."""
    emitting: int
    """That send out light."""
    coated: int
    """With a clearcoat."""
    with_sheen: int
    """With a sheen."""
    custom_specular: int
    """Microfacet materials whose dielectric F0 is not 4 % white."""
    single_sided: int
    """Whose back faces are not drawn."""
    vertex_colored: int
    """With a colour of each vertex."""
    face_colored: int
    """With a colour of each face."""
    with_field: int
    """With a scalar of each vertex, shown by a colour map."""
    contoured: int
    """Of those, with iso-lines."""
    masked_fields: int
    """Of those, with an alpha mask, while the map has colours that are not opaque."""
    lines: int
    """Whose faces are segments."""
    points: int
    """Whose faces are points."""
    spheres: int
    """Whose points are spheres."""
    discs: int
    """Whose points are discs."""
    pixel_sized: int
    """Lines and points with sizes in pixels."""
    transmitting: int
    """That transmit light, refracted."""
    clear_panes: int
    """Of those, that are thin and transmit more light than they block."""
    rough_glass: int
    """Of those, that blur the background."""
    skinned: int
    """Posed by a skin."""
    mipped: int
    """With a mipmapped texture."""
    coded: int
    """Unlit, opaque all over, with a texture without mip levels and no other colours."""
    textured: dict[str, int]
    """With a texture that is read, by field of the material, in the order of ``TEXTURE_FIELDS``."""

    @classmethod
    def from_row(cls, row: Sequence[int]) -> ObjectCounts:
        """Build from a row of numbers."""
        count = len(cls._fields) - 1
        return cls(*row[:count], dict(zip(TEXTURE_FIELDS, row[count:], strict=True)))

    @property
    def row(self) -> list[int]:
        """All numbers in order; those of textures are the last."""
        return [*self[:-1], *self.textured.values()]

    @property
    def shadings(self) -> frozenset[str]:
        """The shading models that occur."""
        return frozenset([name for name in SHADINGS if getattr(self, name)])

    @property
    def primitives(self) -> tuple[str, ...]:
        """The kinds of faces that occur, besides triangles."""
        return tuple([name for name in ("lines", "points") if getattr(self, name)])

    @property
    def has_textures(self) -> bool:
        """Whether any object has a texture that is read."""
        return any(self.textured.values())

    @property
    def has_layers(self) -> bool:
        """Whether any object has a clearcoat, sheen or custom specular."""
        return self.coated + self.with_sheen + self.custom_specular > 0

    @property
    def has_maps(self) -> bool:
        """Whether any object has material maps besides base colour."""
        textures = sum(self.textured.values()) - self.textured["base_color_texture"]
        return textures + self.emitting > 0


class Attribute(NamedTuple):
    """Columns of a custom attribute, and whether it belongs to vertices or faces."""

    columns: int
    of_vertices: bool
    """Whether any mesh has it for each vertex."""
    of_faces: bool
    """Whether any mesh has it for each face."""


class Inventory:
    """
    Properties of the objects of a scene; each mesh is analysed once.

    Parameters
    ----------
    meshes : sequence of Mesh
        Of each object, with their current materials.
    """

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        numbers: dict[Mesh, int] = {}
        self._numbers = np.array([numbers.setdefault(mesh, len(numbers)) for mesh in meshes])
        self._textures = [list_textures(mesh.material) for mesh in numbers]
        counted = map(_count_mesh, numbers, self._textures)
        self._rows = np.array([one.row for one in counted], np.int64)
        self._alpha_uses = [find_alpha_use(mesh) for mesh in numbers]
        self._pixels = max(map(_max_pixel_size, numbers), default=0.0)
        self._scales = [None if mesh.field is None else mesh.field.scale for mesh in numbers]

    @cached_property
    def contents(self) -> ObjectCounts:
        """Counts over all objects."""
        return self._sum_counts(self._numbers)

    def count_chosen(self, chosen: NDArray[np.bool_]) -> ObjectCounts:
        """Return the counts over some objects, (O,) bool."""
        return self.contents if chosen.all() else self._sum_counts(self._numbers[chosen])

    def _sum_counts(self, numbers: NDArray[np.int64]) -> ObjectCounts:
        """Add up the rows of some meshes."""
        counts = np.bincount(numbers, minlength=len(self._rows))
        return ObjectCounts.from_row((counts[:, np.newaxis] * self._rows).sum(axis=0).tolist())

    def _has(self, field: str) -> NDArray[np.bool_]:
        """Tell whether each object, (O,), counts in a field of `ObjectCounts`."""
        return self._rows[self._numbers, ObjectCounts._fields.index(field)] > 0

    @cached_property
    def is_bare(self) -> NDArray[np.bool_]:
        """Whether each object shows only vertex colours, (O,)."""
        textured = [len(read) > 0 for read in self._textures]
        has_more = self._has("blended") | self._has("with_field")
        has_more |= np.array(textured, np.bool_)[self._numbers]
        return self._has("unlit") & self._has("vertex_colored") & ~has_more

    @cached_property
    def is_coded(self) -> NDArray[np.bool_]:
        """Whether each object's texture may be read as codes, (O,)."""
        return self._has("coded")

    @cached_property
    def is_see_through(self) -> NDArray[np.bool_]:
        """Whether each object is transparent, (O,)."""
        return self._has("see_through")

    @cached_property
    def shows_light(self) -> NDArray[np.bool_]:
        """Whether each object is lit and opaque, (O,)."""
        return ~(self._has("unlit") | self.is_see_through | self.is_transmitting)

    @cached_property
    def is_wall(self) -> NDArray[np.bool_]:
        """Whether each object blocks light from both sides, (O,)."""
        return ~(
            self.is_see_through | self.is_transmitting | self._has("cut_out")
            | self._has("single_sided") | self.is_primitive | ~self.casts_shadows
        )  # fmt: skip

    @cached_property
    def is_primitive(self) -> NDArray[np.bool_]:
        """Whether the faces of each object are segments or points, (O,)."""
        return self._has("lines") | self._has("points")

    @cached_property
    def casts_shadows(self) -> NDArray[np.bool_]:
        """Whether each object casts shadows, (O,)."""
        return self._has("casting")

    def pixel_overhang(
        self, size: tuple[int, int]
    ) -> tuple[NDArray[np.bool_], float, float] | None:
        """Return ``overhang`` of `Boxes`: which objects have sizes in pixels, and how large."""
        if self.contents.pixel_sized == 0:
            return None
        width, height = (self._pixels / length for length in size)
        return self._has("pixel_sized"), width, height

    @cached_property
    def is_transmitting(self) -> NDArray[np.bool_]:
        """Whether each object transmits light, refracted, (O,)."""
        return self._has("transmitting")

    @cached_property
    def is_gouraud(self) -> NDArray[np.bool_]:
        """Whether each object is lit at its vertices, (O,)."""
        return self._has("gouraud")

    @cached_property
    def interpolates_normals(self) -> NDArray[np.bool_]:
        """Whether each object is lit per pixel with interpolated normals, (O,)."""
        return self._has("phong") | self._has("pbr")

    @cached_property
    def kinds_apart(self) -> tuple[bool, ...]:
        """Whether any texture of each kind uses other coordinates than its base colour."""
        sets = np.array([list_uv_sets(textures) for textures in self._textures])
        return tuple((sets != sets[:, :1]).any(axis=0).tolist())

    @property
    def color_scales(self) -> list[ColorScale | None]:
        """How each object shows its scalars; None where it has none."""
        return [self._scales[number] for number in self._numbers.tolist()]

    def describe_textures(self, chosen: NDArray[np.bool_]) -> list[str]:
        """Describe the use of each texture of some objects, (O,) bool."""
        meshes = dict.fromkeys(self._numbers[chosen].tolist())
        textures = dict.fromkeys(
            (name, texture, self._alpha_uses[mesh] if name == TEXTURE_FIELDS[0] else None)
            for mesh in meshes
            for name, texture in self._textures[mesh].items()
        )
        return [_describe_texture(*one) for one in textures]


def _count_mesh(mesh: Mesh, read: dict[str, Texture]) -> ObjectCounts:
    """Count the properties of one object, given the textures that are read."""
    material = mesh.material
    without_uv = [name for name, texture in read.items() if mesh.uv_sets[texture.uv_set] is None]
    is_painted = "base_color_texture" in read
    has_hole, field = may_have_holes(mesh), mesh.vertex_field
    is_lit = material.shading in BLINN_PHONG and material.specular > 0.0
    return ObjectCounts(
        # Shading and textures.
        **{name: material.shading == name for name in SHADINGS},
        objects=1,
        with_uv=mesh.uv is not None,
        without_uv=bool(without_uv),
        highlights=is_lit,
        tinted_highlights=(
            (is_painted or mesh.face_colors is not None or field is not None)
            and material.shading == "gouraud"
            and is_lit
        ),
        # Transparency and transmission.
        masked=material.alpha_mode == "mask",
        cut_out=has_hole,
        textured_holes=has_hole and is_painted,
        cutouts_without_uv=has_hole and "base_color_texture" in without_uv,
        blended=material.alpha_mode == "blend",
        see_through=is_see_through(mesh),
        casting=_casts_shadow(mesh),
        emitting=material.emits,
        coated=material.has_clearcoat,
        with_sheen=material.has_sheen,
        custom_specular=material.has_custom_specular,
        single_sided=not material.double_sided,
        # Attributes of the mesh.
        vertex_colored=mesh.vertex_colors is not None,
        face_colored=mesh.face_colors is not None,
        with_field=field is not None,
        contoured=find_contours(mesh) is not None,
        masked_fields=has_masked_field(mesh),
        lines=mesh.primitive == "lines",
        points=mesh.primitive == "points",
        spheres=getattr(mesh, "shape", None) == "sphere",
        discs=getattr(mesh, "shape", None) == "disc",
        pixel_sized=getattr(mesh, "unit", None) == "pixel",
        transmitting=is_transmissive(mesh),
        clear_panes=is_transmissive(mesh) and material.is_clear_pane,
        rough_glass=is_transmissive(mesh) and material.roughness > 0.0 and material.ior != 1.0,
        skinned=mesh._is_in_world,
        mipped=any(texture.filter == "trilinear" for texture in read.values()),
        coded=_shows_texture_only(mesh),
        textured={name: name in read for name in TEXTURE_FIELDS},
    )


def _shows_texture_only(mesh: Mesh) -> bool:
    """Tell whether an unlit mesh shows a texture, all opaque and without mip levels, alone."""
    texture = mesh.material.base_color_texture
    if texture is None or texture.filter == "trilinear" or has_own_colors(mesh):
        return False
    is_solid = not (is_see_through(mesh) or may_have_holes(mesh))
    return mesh.material.shading == "unlit" and is_solid


def _max_pixel_size(mesh: Mesh) -> float:
    """Return the largest size of points or width of lines, pixels; 0 for others."""
    if getattr(mesh, "unit", None) != "pixel":
        return 0.0
    sizes = mesh.sizes if isinstance(mesh, Points) else getattr(mesh, "widths", np.zeros(1))
    return float(sizes.max())


def list_textures(material: Material) -> dict[str, Texture]:
    """Return the textures of a material that are read, by field."""
    textures = zip(TEXTURE_FIELDS, material.textures_read(), strict=True)
    return {name: texture for name, texture in textures if texture is not None}


def has_own_colors(mesh: Mesh) -> bool:
    """Tell whether a mesh has colours of vertices or faces, or scalars."""
    return not (mesh.vertex_colors is None and mesh.face_colors is None and mesh.field is None)


def find_base_color(mesh: Mesh) -> tuple[float, float, float, float]:
    """Return the base colour factor of a mesh, linear RGBA."""
    return mesh.material.base_color_over(has_own_colors(mesh))


def list_uv_sets(textures: dict[str, Texture]) -> list[int]:
    """
    Return the texture coordinate set of each kind of texture, given `list_textures`.

    Absent textures count as using the set of the first present one.
    """
    sets = {name: texture.uv_set for name, texture in textures.items()}
    first = next(iter(sets.values()), 0)
    return [sets.get(name, first) for name in TEXTURE_FIELDS]


def is_see_through(mesh: Mesh) -> bool:
    """Tell whether a mesh is transparent: blended, with an alpha below 1 somewhere."""
    return mesh.material.alpha_mode == "blend" and bool(_bound_min_alpha(mesh) < np.float32(1.0))


def _casts_shadow(mesh: Mesh) -> bool:
    """Tell whether a mesh casts shadows; one sized in pixels does not."""
    if getattr(mesh, "unit", None) == "pixel":
        return False
    if mesh.material.casts_shadow is not None:
        return mesh.material.casts_shadow
    is_clear_pane = is_transmissive(mesh) and mesh.material.is_clear_pane
    return not (is_see_through(mesh) or is_clear_pane)


def is_transmissive(mesh: Mesh) -> bool:
    """Tell whether a mesh of triangles transmits light, refracted."""
    return mesh.material.transmits and mesh.primitive == "triangles"


def may_have_holes(mesh: Mesh) -> bool:
    """Tell whether a mesh has an alpha mask, and alpha below the cutoff anywhere."""
    material = mesh.material
    if material.alpha_mode != "mask":
        return False
    return bool(_bound_min_alpha(mesh) < np.float32(material.alpha_cutoff))


def find_alpha_use(mesh: Mesh) -> AlphaUse:
    """Return the use of alpha in a mesh's base colour texture."""
    texture = mesh.material.base_color_texture
    if texture is None or texture.is_opaque:
        return None
    if is_see_through(mesh):
        return None if texture.filter == "nearest" else WEIGHTED
    alpha = np.float32(find_base_color(mesh)[3])
    if not may_have_holes(mesh) or not alpha > 0.0:
        return None
    return float(np.float32(mesh.material.alpha_cutoff) / alpha)


def find_contours(mesh: Mesh) -> Contours | None:
    """Return the iso-lines of a mesh's scalars, or None."""
    return None if mesh.vertex_field is None else mesh.vertex_field.contours


def has_masked_field(mesh: Mesh) -> bool:
    """Tell whether a mesh with an alpha mask has a colormap with alphas below the cutoff."""
    field = mesh.vertex_field
    is_masked = mesh.material.alpha_mode == "mask" and field is not None
    return is_masked and bool(field.min_alpha < np.float32(1.0))


def _bound_min_alpha(mesh: Mesh) -> np.float32:
    """Return a lower bound of a mesh's alpha: the product of the least values of all factors."""
    min_alpha = np.float32(find_base_color(mesh)[3])
    if mesh.vertex_field is not None:
        min_alpha = min_alpha * mesh.vertex_field.min_alpha
    for colors in (mesh.vertex_colors, mesh.face_colors):
        if colors is not None and len(colors) > 0:
            min_alpha = min_alpha * colors[:, 3].min()
    texture = mesh.material.base_color_texture
    return min_alpha if texture is None else min_alpha * np.float32(texture.lowest_alpha)


def _describe_texture(name: str, texture: Texture, use: AlphaUse) -> str:
    """Describe the use of a texture, and its filter."""
    parts = f", {texture.anisotropy} times along" if texture.anisotropy > 1 else ""
    if use == WEIGHTED:
        parts += ", weighted by alpha"
    elif use is not None and texture.filter == "trilinear":
        parts += f", levels keep the share of alpha from {use:.3g} on"
    kind = name.removesuffix("_texture").replace("_", " ")
    return f"{texture.filter}{parts} ({kind})"


def describe_count(in_view: int, count: int, kind: str = "object") -> str:
    """Describe how many objects of a kind are in view, given how many there are."""
    if in_view == 0:
        return f"{_count_noun(count, kind)} outside the view"
    outside = count - in_view
    return _count_noun(in_view, kind) + (f", {outside} more outside the view" if outside else "")


def _count_noun(count: int, kind: str) -> str:
    """Return a number with its noun, plural if needed."""
    return f"{count} {kind}{'s' if count != 1 else ''}"


def take_inventory(
    nodes: Sequence[Node], quality: Quality, has_environment: bool = False
) -> tuple[Inventory, NDArray[np.float64]]:
    """Take the inventory of a scene's objects, as the quality overrides them, and their boxes."""
    check_no_groups(nodes)
    meshes = override_meshes(meshes_of(nodes), quality, has_environment)
    return Inventory(meshes), compute_mesh_boxes(meshes)


def check_textures(nodes: Sequence[Node], quality: Quality) -> None:
    """Raise ``ValueError`` naming an object with a texture but no texture coordinates."""
    for node, mesh in zip(nodes, override_meshes(meshes_of(nodes), quality), strict=True):
        for name, texture in list_textures(mesh.material).items():
            if mesh.uv_sets[texture.uv_set] is None:
                raise ValueError(
                    f"the mesh of {node.name!r} must have {UV_NAMES[texture.uv_set]}, for its "
                    f"material has a {name}; got none"
                )


def check_masked_fields(nodes: Sequence[Node]) -> None:
    """Raise ``ValueError`` naming a masked object whose colour map would make holes."""
    for node in nodes:
        if has_masked_field(node.mesh):
            raise ValueError(
                f"the material of {node.name!r} must have another alpha_mode than 'mask', for its "
                "scalars are those of vertices, and its colour map is not opaque: masks read "
                "colours and textures alone; 'blend' reads colour maps too"
            )


def find_attribute(nodes: Sequence[Node], name: str) -> Attribute:
    """
    Describe an attribute of meshes.

    Raises
    ------
    ValueError
        If no mesh has it, or two have different numbers of columns.
    """
    first: tuple[str, int] | None = None
    of_vertices = of_faces = False
    for node in nodes:
        of_vertex = node.mesh.vertex_attributes.get(name)
        values = node.mesh.face_attributes.get(name) if of_vertex is None else of_vertex
        if values is None:
            continue
        columns = values.shape[1]
        if first is None:
            first = node.name, columns
        if columns != first[1]:
            raise ValueError(
                f"the mesh of {node.name!r} must have {first[1]} columns in attributes[{name!r}], "
                f"as that of {first[0]!r} has, for one output shows both; got {columns}"
            )
        of_vertices |= of_vertex is not None
        of_faces |= of_vertex is None
    if first is None:
        raise ValueError(
            f"outputs has {ATTRIBUTE + name!r}, but no mesh of the scene has such an attribute; "
            f"{_list_attributes(nodes)}"
        )
    return Attribute(first[1], of_vertices, of_faces)


def _list_attributes(nodes: Sequence[Node]) -> str:
    """List the attributes of the meshes for a message."""
    meshes = dict.fromkeys(node.mesh for node in nodes)
    names = {name for mesh in meshes for name in (*mesh.vertex_attributes, *mesh.face_attributes)}
    return f"its meshes have {', '.join(sorted(names))}" if names else "its meshes have none"
