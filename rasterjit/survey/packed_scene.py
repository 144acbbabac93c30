"""Pack the meshes, materials and textures of a scene into the arrays that kernels read."""

from __future__ import annotations

import itertools
import math
import weakref
from collections.abc import Collection, Sequence
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import records
from rasterjit.pipeline.records import (
    AlphaTests,
    CodedTextures,
    IsoLines,
    Layers,
    Maps,
    Microfacets,
    Placement,
    Surface,
    Textures,
    TransmissionRows,
    VertexScalars,
)
from rasterjit.pipeline.srgb_encoding import encode_color, encode_rows, make_encoding_table
from rasterjit.pipeline.surface import texture_filters as texturing
from rasterjit.pipeline.surface.texture_codes import TABLE_COLUMNS as CODED_COLUMNS
from rasterjit.pipeline.surface.texture_codes import WHITE
from rasterjit.pipeline.visibility.primitive_expansion import LineRule, PointRule, Primitive
from rasterjit.scene.color import decoding_table
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import SHADINGS
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.mip_levels import level_sizes
from rasterjit.scene.normals import TANGENT_GROUPS
from rasterjit.scene.points import Points
from rasterjit.scene.texture import WEIGHTED, AlphaUse, Pyramid, Texture
from rasterjit.survey import object_counts
from rasterjit.survey.object_counts import Attribute
from rasterjit.survey.object_transforms import ViewTransforms

SHADING_CODES = {
    "unlit": records.UNLIT,
    "flat": records.FLAT,
    "gouraud": records.GOURAUD,
    "phong": records.PHONG,
    "pbr": records.PBR,
}

MIN_SEARCHED_VERTICES = 1 << 16
"""Fewest vertices of a mesh that is searched for unused vertices."""

VERTICES_PER_BLOCK = 1 << 12
"""Consecutive vertices that are skipped together if all are unused."""

_NO_TANGENTS = np.zeros((0, TANGENT_GROUPS, 4), np.float32)

_WHITE, _BLACK, _UNLIT = (1.0,) * 3, (0.0,) * 3, (0.0,) * 4

NORMAL_MAP = 1
"""Index of normal maps among the textures of a material."""

WRAP_CODES = {"repeat": texturing.REPEAT, "clamp": texturing.CLAMP, "mirror": texturing.MIRROR}

FILTER_CODES = {
    "nearest": texturing.NEAREST,
    "bilinear": texturing.BILINEAR,
    "trilinear": texturing.TRILINEAR,
}

CURVE_CODES = {"srgb": texturing.SRGB, "linear": texturing.LINEAR}

NO_TEXTURE_ROW = (-1,) + (0,) * (texturing.TABLE_COLUMNS - 1)
"""Row of ``Textures.table`` for an object without a texture of a kind."""

_PreparedImage: TypeAlias = tuple[Pyramid, AlphaUse]
"""A mip pyramid, and the use of its alpha."""

_LevelRange: TypeAlias = tuple[int, int]
"""First level of an image, and their number."""

_Codes: TypeAlias = tuple[int, int, int]
"""Channels of an image of codes, its first code and its curve; 0 channels: it has none."""

_Location: TypeAlias = tuple[_LevelRange, _Codes]

IDENTITY_TRANSFORM = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


class SceneArrays(NamedTuple):
    """The meshes of a scene, joined into one; a single mesh is not copied."""

    positions: NDArray[np.float64]
    """(V, 3), model space."""
    faces: NDArray[np.int32]
    """(F, 3), vertex numbers; triangles begin with their least corner: see ``first_corners``."""
    vertex_starts: NDArray[np.int64]
    """(O+1,): object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``."""
    face_starts: NDArray[np.int64]
    """(O+1,): object ``o`` owns faces ``face_starts[o]:face_starts[o+1]``."""
    primitives: tuple[Primitive, ...] = ()
    """The objects whose faces are segments or points."""
    unused: tuple[tuple[int, int], ...] = ()
    """Runs of unused vertices, ascending: the first, and one past the last."""

    @property
    def primitive_numbers(self) -> tuple[int, ...]:
        """Numbers of the objects whose faces are segments or points."""
        return tuple([primitive.number for primitive in self.primitives])


def join_geometry(meshes: Sequence[Mesh]) -> SceneArrays:
    """Join positions and faces; faces are renumbered, triangles begin with their least corners."""
    runs = group_instances(meshes)
    repeats = [count for _, count in runs]
    vertex_starts = _accumulate_starts([len(mesh.vertices) for mesh, _ in runs], repeats)
    face_starts = _accumulate_starts([len(mesh.faces) for mesh, _ in runs], repeats)
    if max(vertex_starts[-1], face_starts[-1]) >= 2**31 - 2**28:
        raise ValueError(
            f"scene must have fewer than {2**31 - 2**28} vertices and faces in all, got "
            f"{vertex_starts[-1]} and {face_starts[-1]}"
        )
    if len(meshes) == 1:
        positions, faces = writable(meshes[0].vertices), writable(meshes[0]._faces_to_draw())
    else:
        positions = _concatenate([(mesh.vertices, count) for mesh, count in runs])
        faces = np.empty((face_starts[-1], 3), np.int32)
        number = 0
        for mesh, count in runs:
            firsts = vertex_starts[number : number + count].astype(np.int32)
            rows = faces[face_starts[number] : face_starts[number + count]]
            out = rows.reshape(count, -1, 3)
            np.add(mesh._faces_to_draw(), firsts[:, np.newaxis, np.newaxis], out=out)
            number += count
    primitives = _join_primitives(meshes, vertex_starts, face_starts)
    unused = _find_unused_runs(meshes, vertex_starts)
    return SceneArrays(positions, faces, vertex_starts, face_starts, primitives, unused)


def _find_unused_runs(
    meshes: Sequence[Mesh], vertex_starts: NDArray[np.int64]
) -> tuple[tuple[int, int], ...]:
    """Return ``SceneArrays.unused``, of large meshes with more vertices than faces."""
    runs: list[tuple[int, int]] = []
    runs_by_mesh: dict[Mesh, list[tuple[int, int]]] = {}
    for mesh, start in zip(meshes, vertex_starts.tolist(), strict=False):
        count = len(mesh.vertices)
        if count < MIN_SEARCHED_VERTICES or count <= len(mesh.faces):
            continue
        if mesh not in runs_by_mesh:
            blocks = np.arange(0, count, VERTICES_PER_BLOCK)
            is_unused = ~np.logical_or.reduceat(mesh.used_vertices(), blocks)
            edges = np.flatnonzero(np.diff(is_unused, prepend=False, append=False))
            ends = np.minimum(edges * VERTICES_PER_BLOCK, count)
            runs_by_mesh[mesh] = ends.reshape(-1, 2).tolist()
        runs += [(start + first, start + end) for first, end in runs_by_mesh[mesh]]
    return tuple(runs)


def _join_primitives(
    meshes: Sequence[Mesh], vertex_starts: NDArray[np.int64], face_starts: NDArray[np.int64]
) -> tuple[Primitive, ...]:
    """Return the records of objects whose faces are segments or points."""
    primitives = []
    for number, mesh in enumerate(meshes):
        rule: LineRule | PointRule
        if isinstance(mesh, Lines):
            sizes = mesh.widths
            rule = LineRule(mesh.links, mesh.dashes, mesh.caps == "round", mesh.depth_offset)
        elif isinstance(mesh, Points):
            sizes, rule = mesh.sizes, PointRule(mesh.shape)
        else:
            continue
        vertices, faces = (
            (int(starts[number]), int(starts[number + 1]))
            for starts in (vertex_starts, face_starts)
        )
        is_world = mesh.unit == "world"
        primitives.append(
            Primitive(mesh.primitive, number, vertices, faces, writable(sizes), is_world, rule)
        )
    return tuple(primitives)


def group_instances(meshes: Sequence[Mesh]) -> list[tuple[Mesh, int]]:
    """Run-length encode the meshes: return each with its number of consecutive instances."""
    return [(mesh, len([*group])) for mesh, group in itertools.groupby(meshes)]


def _accumulate_starts(sizes: Sequence[int], repeats: Sequence[int]) -> NDArray[np.int64]:
    """Return the cumulative sum of repeated sizes, from 0, (O+1,)."""
    starts = np.zeros(sum(repeats) + 1, np.int64)
    np.cumsum(np.repeat(np.array(sizes, np.int64), repeats), out=starts[1:])
    return starts


def _concatenate(parts: Sequence[tuple[NDArray[Any], int]]) -> NDArray[Any]:
    """Concatenate arrays (n, k) along rows, each repeated as given."""
    total = sum(len(array) * count for array, count in parts)
    first = parts[0][0]
    joined = np.empty((total, first.shape[1]), first.dtype)
    start = 0
    for array, count in parts:
        stop = start + len(array) * count
        joined[start:stop].reshape(count, *array.shape)[:] = array
        start = stop
    return joined


def join_normals(
    meshes: Sequence[Mesh], shadings: Collection[str] = SHADINGS
) -> NDArray[np.float32]:
    """Join the vertex normals of objects with given shading models, (V, 3); zero for others."""

    def normals(mesh: Mesh) -> NDArray[np.float32] | None:
        return mesh.vertex_normals() if mesh.material.shading in shadings else None

    parts = [(normals(mesh), len(mesh.vertices), count) for mesh, count in group_instances(meshes)]
    return _join(parts, np.zeros(3, np.float32))


def join_uv(meshes: Sequence[Mesh], kind: int | None = None) -> NDArray[np.float32]:
    """
    Join the texture coordinates, (V, 2); NaN where an object has none.

    For each object its ``uv``, or the set that its texture of a kind uses.
    """
    parts = [
        (
            mesh.uv
            if kind is None
            else mesh.uv_sets[
                object_counts.list_uv_sets(object_counts.list_textures(mesh.material))[kind]
            ],
            len(mesh.vertices),
            count,
        )
        for mesh, count in group_instances(meshes)
    ]
    return _join(parts, np.full(2, np.nan, np.float32))


def join_attribute(
    meshes: Sequence[Mesh], name: str, attribute: Attribute
) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """
    Join a custom attribute.

    Returns
    -------
    of_vertices : (V, D) float32 or None
    of_faces : (F+1, D) float32 or None
        The last row is that of face -1. NaN for objects without the attribute, and face -1; None if
        no object has it.
    """
    runs, nothing = group_instances(meshes), np.full(attribute.columns, np.nan, np.float32)
    of_vertices = of_faces = None
    if attribute.of_vertices:
        of_vertices = _join(
            [(mesh.vertex_attributes.get(name), len(mesh.vertices), n) for mesh, n in runs], nothing
        )
    if attribute.of_faces:
        parts = [(mesh.face_attributes.get(name), len(mesh.faces), n) for mesh, n in runs]
        of_faces = np.vstack([_join(parts, nothing), nothing])
    return of_vertices, of_faces


def join_surface(meshes: Sequence[Mesh], normals: NDArray[np.float32] | None) -> Surface:
    """Join materials and colours of the objects; None for colours that no object has."""
    runs = group_instances(meshes)
    rows = [
        (
            *object_counts.find_base_color(mesh),
            mesh.material.specular,
            mesh.material.shininess,
            SHADING_CODES[mesh.material.shading],
        )
        for mesh, _ in runs
    ]
    materials = np.repeat(np.array(rows, np.float32), [count for _, count in runs], axis=0)
    white = np.ones(4, np.float32)
    vertex_colors = face_colors = None
    if any(mesh.vertex_colors is not None for mesh, _ in runs):
        parts = [(mesh.vertex_colors, len(mesh.vertices), count) for mesh, count in runs]
        vertex_colors = _join(parts, white)
    if any(mesh.face_colors is not None for mesh, _ in runs):
        parts = [(mesh.face_colors, len(mesh.faces), count) for mesh, count in runs]
        face_colors = _join(parts, white)
    return Surface(materials, vertex_colors, face_colors, normals, None, None, None)


def find_single_sided(meshes: Sequence[Mesh]) -> NDArray[np.bool_]:
    """Return whether back faces of each object are culled, (O,)."""
    return np.array([not mesh.material.double_sided for mesh in meshes], bool)


def _join(
    parts: Sequence[tuple[NDArray[np.float32] | None, int, int]], fill: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Join (array, rows, repeats) row by row, with ``fill`` for the rows of an absent array."""
    array, _, count = parts[0]
    if len(parts) == 1 and count == 1 and array is not None:
        return writable(array)
    return _concatenate(
        [
            (np.broadcast_to(fill, (rows, len(fill))) if array is None else array, count)
            for array, rows, count in parts
        ]
    )


def writable(array: NDArray[Any]) -> NDArray[Any]:
    """
    Return a writable view of an array, as kernels are compiled for.

    Numba has another type for read-only arrays; kernels never write to a mesh.
    """
    return array if array.flags.writeable else np.asarray(_WritableView(array))


class _WritableView:
    """Array interface that marks a read-only array as writable, and keeps it alive."""

    def __init__(self, array: NDArray[Any]) -> None:
        self.array = array
        interface = dict(array.__array_interface__)
        interface["data"] = (interface["data"][0], False)
        self.__array_interface__ = interface


def join_microfacets(meshes: Sequence[Mesh]) -> Microfacets:
    """Join metallic and roughness of the objects."""
    runs = group_instances(meshes)
    rows = [(mesh.material.metallic, mesh.material.roughness) for mesh, _ in runs]
    return Microfacets(_repeat(rows, runs, np.float32), np.ones(2, np.float32))


def join_transmission(meshes: Sequence[Mesh]) -> TransmissionRows:
    """Join the transmission of the objects."""
    runs = group_instances(meshes)
    rows, factors = [], []
    for mesh, _ in runs:
        m, scale = mesh.material, _compute_joint_scale(mesh)
        rows.append((m.transmission * object_counts.is_transmissive(mesh), m.thickness * scale))
        f0 = min(_compute_dielectric_f0(m.ior) * max(m.specular_color), 1.0)
        attenuation = *m.attenuation_color, 1.0 / m.attenuation_distance
        factors.append((m.ior, f0, m.specular_factor, *attenuation))
    return TransmissionRows(_repeat(rows, runs, np.float32), _repeat(factors, runs, np.float32))


def _compute_joint_scale(mesh: Mesh) -> float:
    """
    Return the scale of a posed mesh by its joints: the root mean square over the axes of all used.

    1 for a mesh without joints.
    """
    if mesh._skin_source is None:
        return 1.0
    rest, matrices = mesh._skin_source
    used_joints = np.unique(rest.joints[rest.weights > 0.0])
    total = 0.0
    # Sum in a fixed order.
    for square in (matrices[used_joints, :3, :3] ** 2).ravel().tolist():
        total += square
    return math.sqrt(total / (3 * max(len(used_joints), 1)))


def join_layers(meshes: Sequence[Mesh]) -> Layers:
    """Join the material layers of glTF's extensions."""
    from rasterjit.pipeline.lighting.sheen import ALBEDO

    runs = group_instances(meshes)
    materials = [mesh.material for mesh, _ in runs]
    # In the order of sample rows: white, not lit as diffuse, black so far, metal, roughness.
    coats = [
        (m.clearcoat * m.has_clearcoat, *_WHITE, *_UNLIT, 1.0, m.clearcoat_roughness)
        for m in materials
    ]
    sheens = [(*(m.sheen_color if m.has_sheen else _BLACK), m.sheen_roughness) for m in materials]
    dielectrics = [
        (*(_compute_dielectric_f0(m.ior) * part for part in m.specular_color), m.specular_factor,
         m.has_custom_specular)
        for m in materials
    ]  # fmt: skip
    probe_rows = [(*_WHITE, m.shading == "pbr", *_BLACK, 1.0, 0.0) for m in materials]
    has_maps = any(m.textures_read()[texturing.CLEARCOAT_NORMAL] is not None for m in materials)
    return Layers(
        _repeat(coats, runs, np.float32),
        _repeat([(m.clearcoat_normal_scale,) for m in materials], runs, np.float32),
        _join_tangents(runs, texturing.CLEARCOAT_NORMAL) if has_maps else _NO_TANGENTS,
        _repeat(sheens, runs, np.float32),
        _repeat(dielectrics, runs, np.float32),
        _repeat(probe_rows, runs, np.float32),
        ALBEDO,
    )


def _compute_dielectric_f0(ior: float) -> float:
    """Return F0 of a dielectric."""
    return ((ior - 1.0) / (ior + 1.0)) ** 2


def join_fields(meshes: Sequence[Mesh]) -> VertexScalars:
    """Join the scalars of vertices, NaN where an object has none, and their colour maps."""
    runs = group_instances(meshes)
    colors, rules, entries, first = [], [], [], 0
    thresholds, first_threshold = [np.empty(0)], 0
    for mesh, _ in runs:
        field = mesh.vertex_field
        rules.append((0.0, 1.0) if field is None else field.range_start_width)
        if field is None:
            entries.append((first, 0, -1))
            continue
        is_even = field.thresholds is None
        entries.append((first, len(field.table) - 1, -1 if is_even else first_threshold))
        colors.append(field.table)
        first += len(field.table)
        if field.thresholds is not None:
            thresholds.append(field.thresholds)
            first_threshold += len(field.thresholds)
    return VertexScalars(
        join_scalars(meshes),
        _repeat(rules, runs, np.float64),
        np.concatenate(thresholds),
        _repeat(entries, runs, np.int64),
        np.concatenate(colors),
        _join_contours(runs)
        if any(object_counts.find_contours(mesh) for mesh, _ in runs)
        else None,
    )


def _join_contours(runs: Sequence[tuple[Mesh, int]]) -> IsoLines:
    """Join the iso-lines of all objects."""
    levels, ranges, lines, first = [], [], [], 0
    for mesh, _ in runs:
        contours, values = object_counts.find_contours(mesh), np.empty(0)
        if contours is not None and mesh.field is not None:
            values = mesh.field.levels
        levels.append(values)
        ranges.append((first, len(values)))
        lines.append(
            (0.0,) * 4 if contours is None else (contours.width / 2.0, *contours.color[:3])
        )
        first += len(values)
    return IsoLines(
        np.concatenate(levels), _repeat(ranges, runs, np.int64), _repeat(lines, runs, np.float32)
    )


def join_scalars(meshes: Sequence[Mesh]) -> NDArray[np.float64]:
    """Join the scalars of vertices, (V,); NaN where there are none."""
    return np.concatenate(
        [
            np.full(len(mesh.vertices), np.nan)
            if mesh.vertex_field is None
            else mesh.vertex_field.values
            for mesh in meshes
        ]
    )


def join_face_scalars(meshes: Sequence[Mesh]) -> NDArray[np.float32] | None:
    """
    Join the scalars of faces, (F+1,); None if no object has any.

    NaN where an object has none, and in the last row.
    """
    if not any(mesh.field is not None and mesh.field.of_faces for mesh in meshes):
        return None
    joined = np.concatenate(
        [
            mesh.field.values
            if mesh.field is not None and mesh.field.of_faces
            else np.full(len(mesh.faces), np.nan)
            for mesh in meshes
        ]
    )
    return np.append(joined, np.nan).astype(np.float32)


def join_maps(meshes: Sequence[Mesh], kinds_apart: Sequence[bool]) -> Maps:
    """
    Join the material maps besides base colour, with tangents and coordinates.

    ``kinds_apart`` is `Inventory.kinds_apart`.
    """
    runs = group_instances(meshes)
    factors = [
        (mesh.material.normal_scale, mesh.material.occlusion_strength, *mesh.material.emissive)
        for mesh, _ in runs
    ]
    is_read = [[one is not None for one in mesh.material.textures_read()] for mesh, _ in runs]
    counts = np.count_nonzero(_repeat(is_read, runs, np.int64), axis=0).astype(np.int64)
    return Maps(
        _repeat(factors, runs, np.float32),
        counts,
        _join_tangents(runs, NORMAL_MAP) if counts[NORMAL_MAP] else _NO_TANGENTS,
        tuple(join_uv(meshes, kind) if apart else None for kind, apart in enumerate(kinds_apart)),
    )


def _join_tangents(runs: Sequence[tuple[Mesh, int]], kind: int) -> NDArray[np.float32]:
    """Join the tangents of the objects with normal maps of a kind, (V, 2, 4); zero for others."""
    parts = []
    for mesh, count in runs:
        texture = mesh.material.textures_read()[kind]
        tangents = np.zeros((len(mesh.vertices), TANGENT_GROUPS, 4), np.float32)
        if texture is not None:
            uv = mesh.uv_sets[texture.uv_set]
            if uv is not None or mesh.tangents is not None:
                tangents = mesh.vertex_tangents(texture.transform, texture.uv_set)
        parts += [tangents] * count
    return np.concatenate(parts)


def _repeat(
    rows: Sequence[Sequence[float]], runs: Sequence[tuple[Mesh, int]], dtype: type
) -> NDArray:
    """Return one row for each object, given one for each run of instances."""
    return np.repeat(np.array(rows, dtype), [count for _, count in runs], axis=0)


def join_textures(meshes: Sequence[Mesh]) -> Textures:
    """Join the textures of the objects, each image once, and their texture coordinates."""
    runs = group_instances(meshes)
    counts = [count for _, count in runs]
    rows = [mesh.material.textures_read() for mesh, _ in runs]
    if not any(texture is not None for row in rows for texture in row[texturing.CORE_KINDS :]):
        rows = [row[: texturing.CORE_KINDS] for row in rows]
    textures = [texture for row in rows for texture in row if texture is not None]
    # Only the alpha of base colours is used.
    others = (None,) * (len(rows[0]) - 1)
    uses = [(_merge_alpha_use(mesh), *others) for mesh, _ in runs]
    pairs = [list(zip(*row, strict=True)) for row in zip(rows, uses, strict=True)]
    texels, codes, levels, locations = _join_texels(
        [(texture, use) for row in pairs for texture, use in row if texture is not None]
    )
    table = [[_pack_texture(texture, use, locations) for texture, use in row] for row in pairs]
    transforms = np.zeros((0, len(rows[0]), 6))
    if any(texture.transform is not None for texture in textures):
        packed = [[_pack_uv_transform(texture) for texture in row] for row in rows]
        transforms = np.repeat(np.array(packed, np.float64), counts, axis=0)
    return Textures(
        texels,
        codes,
        build_decoding_curves(),
        levels,
        np.repeat(np.array(table, np.int64), counts, axis=0),
        join_uv(meshes, texturing.BASE_COLOR),
        transforms,
    )


def join_coded_textures(meshes: Sequence[Mesh], is_coded: NDArray[np.bool_]) -> CodedTextures:
    """Join the textures that are read as codes, each image once; ``is_coded``: of objects, (O,)."""
    firsts: dict[Pyramid, int] = {}
    images: list[NDArray[np.uint32]] = []
    first = 0
    table = np.full((len(meshes), CODED_COLUMNS), -1, np.int64)
    transforms = np.tile(np.array(IDENTITY_TRANSFORM), (len(meshes), 1))
    for number in np.flatnonzero(is_coded).tolist():
        texture = meshes[number].material.base_color_texture
        assert texture is not None
        pyramid = texture.pyramid
        if pyramid not in firsts:
            firsts[pyramid] = first
            images.append(_encode_picture(pyramid))
            first += len(images[-1])
        wraps = (WRAP_CODES[wrap] for wrap in texture.wrap)
        factor = encode_color(np.array(object_counts.find_base_color(meshes[number]), np.float32))
        table[number] = (
            firsts[pyramid], *pyramid.size, *wraps, FILTER_CODES[texture.filter],
            factor & WHITE,
        )  # fmt: skip
        transforms[number] = _pack_uv_transform(texture)
    texels = images[0] if len(images) == 1 else np.concatenate(images)
    return CodedTextures(texels, table, transforms)


_PICTURE_CODES: weakref.WeakKeyDictionary[Pyramid, NDArray[np.uint32]] = weakref.WeakKeyDictionary()
"""Cache: the pictures of textures as `_encode_picture` returns them."""


def _encode_picture(pyramid: Pyramid) -> NDArray[np.uint32]:
    """Return the picture of a texture as sRGB codes, (H * W,), red in the lowest byte."""
    known = _PICTURE_CODES.get(pyramid)
    if known is not None:
        return known
    width, height = pyramid.size
    if pyramid.codes is not None and pyramid.color_space == "srgb":
        codes = np.full((height, width, 4), 255, np.uint8)
        # Grey has one code for all three colours.
        has_colors = pyramid.codes.shape[2] > 2
        codes[:, :, :3] = pyramid.codes[:, :, : 3 if has_colors else 1]
        packed = codes.view(np.uint32).ravel()
    else:
        packed = np.empty((height, width), np.uint32)
        encode_rows(pyramid.image, make_encoding_table(), packed)
        packed = packed.ravel()
    _PICTURE_CODES[pyramid] = packed
    return packed


@cache
def build_decoding_curves() -> NDArray[np.float32]:
    """Return ``Textures.curves``."""
    shares = np.arange(256, dtype=np.float32) / np.float32(255.0)
    return np.stack([decoding_table(), shares, np.ones_like(shares)])


NO_TEXTURES = Textures(
    np.empty((0, 4), np.float32), np.empty(0, np.uint8), np.empty((0, 256), np.float32),
    np.empty((0, 3), np.int64),
    np.empty((0, texturing.KINDS, texturing.TABLE_COLUMNS), np.int64), np.empty((0, 2), np.float32),
    np.empty((0, texturing.KINDS, 6)),
)  # fmt: skip
"""The textures of a scene without any."""


def join_alpha_tests(
    meshes: Sequence[Mesh],
    face_starts: NDArray[np.int64],
    surface: Surface,
    textures: Textures | None,
) -> AlphaTests:
    """Return the inputs of the alpha test; ``textures`` is None if the test needs none."""
    cutoffs = {
        mesh: mesh.material.alpha_cutoff if object_counts.may_have_holes(mesh) else 0.0
        for mesh in dict.fromkeys(meshes)
    }
    no_colors = np.empty((0, 4), np.float32)
    return AlphaTests(
        np.array([cutoffs[mesh] for mesh in meshes], np.float32),
        face_starts,
        surface.materials,
        no_colors if surface.vertex_colors is None else surface.vertex_colors,
        no_colors if surface.face_colors is None else surface.face_colors,
        NO_TEXTURES if textures is None else textures,
    )


def _merge_alpha_use(mesh: Mesh) -> AlphaUse:
    """Return `find_alpha_use` with one cutoff for all that select the same texels."""
    use, texture = object_counts.find_alpha_use(mesh), mesh.material.base_color_texture
    if texture is None or not isinstance(use, float):
        return use
    return texture.pyramid.min_alpha_above(use)


def _join_texels(
    textures: Sequence[tuple[Texture, AlphaUse]],
) -> tuple[
    NDArray[np.float32], NDArray[np.uint8], NDArray[np.int64], dict[_PreparedImage, _Location]
]:
    """Return the texels, codes and levels of all images, and the location of each image's."""
    has_levels: dict[_PreparedImage, bool] = {}
    for texture, use in textures:
        prepared, has_mip_levels = (texture.pyramid, use), texture.filter == "trilinear"
        has_levels[prepared] = has_levels.get(prepared, False) or has_mip_levels
    levels: list[tuple[int, int, int]] = []
    texels, codes, locations = [], [np.empty(0, np.uint8)], {}
    first_texel, first_code = 0, 0
    for (pyramid, use), has_mip_levels in has_levels.items():
        texels.append(pyramid.prepare_chain(use, has_mip_levels))
        sizes = level_sizes(*pyramid.size) if has_mip_levels else [pyramid.size]
        code_range: _Codes = (0, 0, 0)
        if use is None and pyramid.codes is not None:
            codes.append(pyramid.codes.reshape(-1))
            code_range = (pyramid.codes.shape[2], first_code, CURVE_CODES[pyramid.color_space])
            first_code += pyramid.codes.size
        locations[pyramid, use] = (len(levels), len(sizes)), code_range
        start = first_texel + len(texels[-1]) - sum(width * height for width, height in sizes)
        for width, height in sizes:
            levels.append((start, width, height))
            start += width * height
        first_texel = start
    table = np.array(levels, np.int64)
    return _concatenate_flat(texels), _concatenate_flat(codes), table, locations


def _concatenate_flat(arrays: list[NDArray[Any]]) -> NDArray[Any]:
    """Concatenate arrays; a single non-empty one is not copied."""
    nonempty = [array for array in arrays if array.size] or arrays
    return writable(nonempty[0]) if len(nonempty) == 1 else np.concatenate(nonempty)


def _pack_texture(
    texture: Texture | None, use: AlphaUse, locations: dict[_PreparedImage, _Location]
) -> tuple[int, ...]:
    """Return the row of ``Textures.table`` for one texture of one object."""
    if texture is None:
        return NO_TEXTURE_ROW
    wraps = (WRAP_CODES[wrap] for wrap in texture.wrap)
    alpha = {None: texturing.PLAIN, WEIGHTED: texturing.WEIGHTED}.get(use, texturing.MASK)
    levels, codes = locations[texture.pyramid, use]
    return (*levels, *wraps, FILTER_CODES[texture.filter], texture.anisotropy, alpha, *codes)


def _pack_uv_transform(texture: Texture | None) -> tuple[float, ...]:
    """Return the row of ``Textures.transforms`` for one texture of one object."""
    return IDENTITY_TRANSFORM if texture is None else texture.transform or IDENTITY_TRANSFORM


def compute_front_windings(
    screen_winding: int, mirrored: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the sign of the edge function of each object's front faces on the screen, (O,)."""
    return -screen_winding * mirrored


def make_placement(arrays: SceneArrays, views: ViewTransforms) -> Placement:
    """Return the record of the objects' vertices and transforms."""
    return Placement(
        arrays.face_starts,
        arrays.positions,
        np.ascontiguousarray(views.relative_from_model[:, :3, :]),
        views.normal_matrices,
        views.mirrored,
        compute_front_windings(views.screen_winding, views.mirrored),
        views.toward_viewer,
    )
