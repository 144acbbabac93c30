"""
Pack the meshes, materials and textures of a scene into the arrays that kernels read.

All arrays that kernels read are cast and joined here, once.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import records
from rasterjit.pipeline.records import (
    AlphaTests,
    Fields,
    Layers,
    Levels,
    Maps,
    Microfacets,
    Placement,
    Surface,
    Textures,
    TransmissionRows,
)
from rasterjit.pipeline.surface import texture_filters as texturing
from rasterjit.pipeline.visibility.primitive_expansion import LineRule, PointRule, Primitive
from rasterjit.scene.color import decoding_table
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import SHADINGS
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.mip_levels import level_sizes
from rasterjit.scene.normals import GROUPS
from rasterjit.scene.points import Points
from rasterjit.scene.texture import WEIGHTED, AlphaUse, Pyramid, Texture
from rasterjit.survey.object_counts import (
    Attribute,
    alpha_use_of,
    base_color_of,
    contours_of,
    is_transmissive,
    may_have_holes,
    sets_of,
    textures_read,
)
from rasterjit.survey.object_transforms import ViewTransforms

MODELS = {
    "unlit": records.UNLIT,
    "flat": records.FLAT,
    "gouraud": records.GOURAUD,
    "phong": records.PHONG,
    "pbr": records.PBR,
}

MIN_VERTICES = 1 << 16
"""Fewest vertices of a mesh that is searched for unused ones."""

VERTEX_BLOCK = 1 << 12
"""Consecutive vertices that are skipped together, if no face uses any of them."""

_WHITE, _BLACK, _UNLIT = (1.0,) * 3, (0.0,) * 3, (0.0,) * 4

NORMAL = 1
"""Index of normal maps among the textures of a material."""

WRAPS = {"repeat": texturing.REPEAT, "clamp": texturing.CLAMP, "mirror": texturing.MIRROR}

FILTERS = {
    "nearest": texturing.NEAREST,
    "bilinear": texturing.BILINEAR,
    "trilinear": texturing.TRILINEAR,
}

CURVES = {"srgb": texturing.SRGB, "linear": texturing.SHARES}

NO_TEXTURE_ROW = (-1,) + (0,) * (texturing.TABLE_COLUMNS - 1)
"""Row of the table for an object without a texture of a kind."""

_Picture: TypeAlias = tuple[Pyramid, AlphaUse]
"""A mip pyramid, and the use of its alpha."""

_Place: TypeAlias = tuple[int, int]
"""The first level of a picture, and how many it has."""

_Codes: TypeAlias = tuple[int, int, int]
"""Channels of a picture of codes, its first code and their curve; 0 channels: it has none."""

IDENTITY_TRANSFORM = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
"""The identity transform."""


class SceneArrays(NamedTuple):
    """The meshes of a scene, joined into one; a scene of one mesh is joined without a copy."""

    positions: NDArray[np.float64]
    """(V, 3), model space."""
    faces: NDArray[np.int32]
    """(F, 3), vertex numbers, of triangles the least corner first: `first_corners.least_first`."""
    vertex_starts: NDArray[np.int64]
    """(O+1,): object ``o`` owns vertices ``vertex_starts[o]:vertex_starts[o+1]``."""
    face_starts: NDArray[np.int64]
    """(O+1,): object ``o`` owns faces ``face_starts[o]:face_starts[o+1]``."""
    primitives: tuple[Primitive, ...] = ()
    """The objects whose faces are segments or points."""
    unused: tuple[tuple[int, int], ...] = ()
    """Runs of vertices that no face uses, ascending: the first, and one past the last."""

    @property
    def primitive_numbers(self) -> tuple[int, ...]:
        """Numbers of the objects whose faces are segments or points."""
        return tuple([one.number for one in self.primitives])


def join_geometry(meshes: Sequence[Mesh]) -> SceneArrays:
    """Join positions and faces; faces are renumbered, triangles begin with their least corners."""
    runs = runs_of(meshes)
    repeats = [count for _, count in runs]
    vertex_starts = _starts([len(mesh.vertices) for mesh, _ in runs], repeats)
    face_starts = _starts([len(mesh.faces) for mesh, _ in runs], repeats)
    if max(vertex_starts[-1], face_starts[-1]) >= 2**31 - 2**28:
        raise ValueError(
            f"scene must have fewer than {2**31 - 2**28} vertices and faces in all, got "
            f"{vertex_starts[-1]} and {face_starts[-1]}"
        )
    if len(meshes) == 1:
        positions, faces = writable(meshes[0].vertices), writable(meshes[0]._faces_to_draw())
        primitives = _join_primitives(meshes, vertex_starts, face_starts)
        unused = _unused_runs(meshes, vertex_starts)
        return SceneArrays(positions, faces, vertex_starts, face_starts, primitives, unused)
    positions = _concatenate([(mesh.vertices, count) for mesh, count in runs])
    faces = np.empty((face_starts[-1], 3), np.int32)
    place = 0
    for mesh, count in runs:
        firsts = vertex_starts[place : place + count].astype(np.int32)[:, np.newaxis, np.newaxis]
        rows = faces[face_starts[place] : face_starts[place + count]]
        np.add(mesh._faces_to_draw(), firsts, out=rows.reshape(count, -1, 3))
        place += count
    primitives = _join_primitives(meshes, vertex_starts, face_starts)
    unused = _unused_runs(meshes, vertex_starts)
    return SceneArrays(positions, faces, vertex_starts, face_starts, primitives, unused)


def _unused_runs(
    meshes: Sequence[Mesh], vertex_starts: NDArray[np.int64]
) -> tuple[tuple[int, int], ...]:
    """Return the runs of ``SceneArrays.unused``, of meshes with many more vertices than faces."""
    found: list[tuple[int, int]] = []
    masks: dict[Mesh, list[tuple[int, int]]] = {}
    for mesh, start in zip(meshes, vertex_starts.tolist(), strict=False):
        count = len(mesh.vertices)
        if count < MIN_VERTICES or count <= len(mesh.faces):
            continue
        if mesh not in masks:
            blocks = np.arange(0, count, VERTEX_BLOCK)
            is_unused = ~np.logical_or.reduceat(mesh.used_vertices(), blocks)
            edges = np.flatnonzero(np.diff(is_unused, prepend=False, append=False)) * VERTEX_BLOCK
            masks[mesh] = np.minimum(edges, count).reshape(-1, 2).tolist()
        found += [(start + first, start + end) for first, end in masks[mesh]]
    return tuple(found)


def _join_primitives(
    meshes: Sequence[Mesh], vertex_starts: NDArray[np.int64], face_starts: NDArray[np.int64]
) -> tuple[Primitive, ...]:
    """Return the records of objects whose faces are segments or points."""
    found = []
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
        found.append(
            Primitive(mesh.primitive, number, vertices, faces, writable(sizes), is_world, rule)
        )
    return tuple(found)


def runs_of(meshes: Sequence[Mesh]) -> list[tuple[Mesh, int]]:
    """Run-length encode the meshes: return each with its number of consecutive instances."""
    return [(mesh, len([*group])) for mesh, group in itertools.groupby(meshes)]


def _starts(sizes: Sequence[int], repeats: Sequence[int]) -> NDArray[np.int64]:
    """Return the running sum from 0 of sizes that repeat, (O+1,)."""
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

    parts = [(normals(mesh), len(mesh.vertices), count) for mesh, count in runs_of(meshes)]
    return _join(parts, np.zeros(3, np.float32))


def join_uv(meshes: Sequence[Mesh], kind: int | None = None) -> NDArray[np.float32]:
    """
    Join the texture coordinates, (V, 2); NaN where an object has none.

    For each object its ``uv``, or the set that its texture of a kind uses.
    """
    parts = [
        (
            mesh.uv if kind is None else mesh.uv_sets[sets_of(textures_read(mesh.material))[kind]],
            len(mesh.vertices),
            count,
        )
        for mesh, count in runs_of(meshes)
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
        The last row, which face -1 finds, has no values. NaN stands for those of the objects
        that have none; None where no object has any.
    """
    runs, nothing = runs_of(meshes), np.full(attribute.columns, np.nan, np.float32)
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
    """Join materials and colours; a kind of colour that no object has is ``None``."""
    runs = runs_of(meshes)
    rows = [
        (
            *base_color_of(mesh),
            mesh.material.specular,
            mesh.material.shininess,
            MODELS[mesh.material.shading],
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


def single_sided(meshes: Sequence[Mesh]) -> NDArray[np.bool_]:
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
    Return the array in the one layout that kernels are compiled for, without a copy if it can be.

    A read-only array is a type of its own to Numba; kernels never write to a mesh, so it is passed
    as a writable view of the same memory.
    """
    return array if array.flags.writeable else np.asarray(_WritableView(array))


class _WritableView:
    """Shows the memory of a read-only array to NumPy as writable, and keeps it alive."""

    def __init__(self, array: NDArray[Any]) -> None:
        self.array = array
        interface = dict(array.__array_interface__)
        interface["data"] = (interface["data"][0], False)
        self.__array_interface__ = interface


def join_microfacets(meshes: Sequence[Mesh]) -> Microfacets:
    """Join metallic and roughness of the objects."""
    runs = runs_of(meshes)
    rows = [(mesh.material.metallic, mesh.material.roughness) for mesh, _ in runs]
    return Microfacets(_repeat(rows, runs, np.float32), np.ones(2, np.float32))


def join_transmission(meshes: Sequence[Mesh]) -> TransmissionRows:
    """Join the transmission of the objects."""
    runs = runs_of(meshes)
    rows, factors = [], []
    for mesh, _ in runs:
        own = mesh.material
        mirrored = min(_dielectric_f0(own.ior) * max(own.specular_color), 1.0), own.specular_factor
        inside = *own.attenuation_color, 1.0 / own.attenuation_distance
        rows.append((own.transmission * is_transmissive(mesh), own.thickness * _joint_scale(mesh)))
        factors.append((own.ior, *mirrored, *inside))
    return TransmissionRows(_repeat(rows, runs, np.float32), _repeat(factors, runs, np.float32))


def _joint_scale(mesh: Mesh) -> float:
    """
    Return the scale that joints give a posed mesh: the root mean square over the axes of each.

    Joints without vertices do not count. A mesh without joints has scale 1.
    """
    if mesh._skin_source is None:
        return 1.0
    rest, matrices = mesh._skin_source
    followed = np.unique(rest.joints[rest.weights > 0.0])
    total = 0.0
    # Sum in a fixed order.
    for part in (matrices[followed, :3, :3] ** 2).ravel().tolist():
        total += part
    return math.sqrt(total / (3 * max(len(followed), 1)))


def join_layers(meshes: Sequence[Mesh]) -> Layers:
    """Join the material layers of glTF's extensions."""
    from rasterjit.pipeline.lighting.sheen import ALBEDO

    runs = runs_of(meshes)
    own = [mesh.material for mesh, _ in runs]
    # In the order of sample rows: white, not lit as diffuse, black so far, metal, roughness.
    coats = [
        (one.clearcoat * one.has_clearcoat, *_WHITE, *_UNLIT, 1.0, one.clearcoat_roughness)
        for one in own
    ]
    sheens = [(*(one.sheen_color if one.has_sheen else _BLACK), one.sheen_roughness) for one in own]
    dielectrics = [
        (*(_dielectric_f0(one.ior) * part for part in one.specular_color), one.specular_factor,
         one.has_custom_specular)
        for one in own
    ]  # fmt: skip
    probe_rows = [(*_WHITE, one.shading == "pbr", *_BLACK, 1.0, 0.0) for one in own]
    has_maps = any(one.textures_read()[texturing.CLEARCOAT_NORMAL] is not None for one in own)
    none = np.zeros((0, GROUPS, 4), np.float32)
    return Layers(
        _repeat(coats, runs, np.float32),
        _repeat([(one.clearcoat_normal_scale,) for one in own], runs, np.float32),
        _join_tangents(runs, texturing.CLEARCOAT_NORMAL) if has_maps else none,
        _repeat(sheens, runs, np.float32),
        _repeat(dielectrics, runs, np.float32),
        _repeat(probe_rows, runs, np.float32),
        ALBEDO,
    )


def _dielectric_f0(ior: float) -> float:
    """Return F0 of a dielectric."""
    return ((ior - 1.0) / (ior + 1.0)) ** 2


def join_fields(meshes: Sequence[Mesh]) -> Fields:
    """Join the scalars of vertices, NaN where an object has none, and the maps that show them."""
    runs = runs_of(meshes)
    colors, rules, entries, first = [], [], [], 0
    for mesh, _ in runs:
        field = mesh.vertex_field
        rules.append((0.0, 1.0) if field is None else field.range_start_width)
        entries.append((first, 0 if field is None else len(field.colormap)))
        if field is not None:
            colors.append(field.table)
            first += len(field.table)
    return Fields(
        join_scalars(meshes),
        _repeat(rules, runs, np.float64),
        _repeat(entries, runs, np.int64),
        np.concatenate(colors),
        _join_contours(runs) if any(contours_of(mesh) for mesh, _ in runs) else None,
    )


def _join_contours(runs: Sequence[tuple[Mesh, int]]) -> Levels:
    """Join the iso-lines of all objects."""
    levels, places, lines, first = [], [], [], 0
    for mesh, _ in runs:
        contours, found = contours_of(mesh), np.empty(0)
        if contours is not None and mesh.field is not None:
            found = mesh.field.levels
        levels.append(found)
        places.append((first, len(found)))
        lines.append(
            (0.0,) * 4 if contours is None else (contours.width / 2.0, *contours.color[:3])
        )
        first += len(found)
    return Levels(
        np.concatenate(levels), _repeat(places, runs, np.int64), _repeat(lines, runs, np.float32)
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
    Join the scalars of faces, (F+1,); NaN where an object has none, and in the last row.

    None where no object has any.
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

    ``kinds_apart`` is that of the `Inventory`.
    """
    runs = runs_of(meshes)
    factors = [
        (mesh.material.normal_scale, mesh.material.occlusion_strength, *mesh.material.emissive)
        for mesh, _ in runs
    ]
    used = [[texture is not None for texture in mesh.material.textures_read()] for mesh, _ in runs]
    counts = np.count_nonzero(_repeat(used, runs, np.int64), axis=0).astype(np.int64)
    return Maps(
        _repeat(factors, runs, np.float32),
        counts,
        _join_tangents(runs, NORMAL) if counts[NORMAL] else np.zeros((0, GROUPS, 4), np.float32),
        tuple(join_uv(meshes, kind) if apart else None for kind, apart in enumerate(kinds_apart)),
    )


def _join_tangents(runs: Sequence[tuple[Mesh, int]], kind: int) -> NDArray[np.float32]:
    """Join the tangents of the objects with normal maps of a kind, (V, 2, 4); zero for others."""
    parts = []
    for mesh, count in runs:
        texture = mesh.material.textures_read()[kind]
        tangents = np.zeros((len(mesh.vertices), GROUPS, 4), np.float32)
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
    runs = runs_of(meshes)
    counts = [count for _, count in runs]
    kinds = [mesh.material.textures_read() for mesh, _ in runs]
    if not any(texture is not None for row in kinds for texture in row[texturing.CORE_KINDS :]):
        kinds = [row[: texturing.CORE_KINDS] for row in kinds]
    textures = [texture for row in kinds for texture in row if texture is not None]
    # Only the alpha of base colours is used.
    others = (None,) * (len(kinds[0]) - 1)
    uses = [(_merge_alpha_use(mesh), *others) for mesh, _ in runs]
    pairs = [list(zip(*row, strict=True)) for row in zip(kinds, uses, strict=True)]
    texels, codes, levels, places = _join_texels(
        [(texture, use) for row in pairs for texture, use in row if texture is not None]
    )
    table = [[_table_row(texture, use, places) for texture, use in row] for row in pairs]
    transforms = np.zeros((0, len(kinds[0]), 6))
    if any(texture.transform is not None for texture in textures):
        rows = [[_transform_row(texture) for texture in row] for row in kinds]
        transforms = np.repeat(np.array(rows, np.float64), counts, axis=0)
    return Textures(
        texels,
        codes,
        curves_of_codes(),
        levels,
        np.repeat(np.array(table, np.int64), counts, axis=0),
        join_uv(meshes, texturing.BASE_COLOR),
        transforms,
    )


@cache
def curves_of_codes() -> NDArray[np.float32]:
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
    """Return the alpha-tested objects, and the inputs of the test; no textures if it needs none."""
    cutoffs = {
        mesh: mesh.material.alpha_cutoff if may_have_holes(mesh) else 0.0
        for mesh in dict.fromkeys(meshes)
    }
    plain = np.empty((0, 4), np.float32)
    return AlphaTests(
        np.array([cutoffs[mesh] for mesh in meshes], np.float32),
        face_starts,
        surface.materials,
        plain if surface.vertex_colors is None else surface.vertex_colors,
        plain if surface.face_colors is None else surface.face_colors,
        NO_TEXTURES if textures is None else textures,
    )


def _merge_alpha_use(mesh: Mesh) -> AlphaUse:
    """Return `alpha_use_of`, merging cutoffs that select the same texels."""
    use, texture = alpha_use_of(mesh), mesh.material.base_color_texture
    if texture is None or not isinstance(use, float):
        return use
    return texture.pyramid.least_alpha_from(use)


def _join_texels(
    textures: Sequence[tuple[Texture, AlphaUse]],
) -> tuple[
    NDArray[np.float32], NDArray[np.uint8], NDArray[np.int64], dict[_Picture, tuple[_Place, _Codes]]
]:
    """Return the texels, codes and levels of all images, and where those of each are."""
    has_levels: dict[_Picture, bool] = {}
    for texture, use in textures:
        picture, wants = (texture.pyramid, use), texture.filter == "trilinear"
        has_levels[picture] = has_levels.get(picture, False) or wants
    levels: list[tuple[int, int, int]] = []
    texels, codes, places = [], [np.empty(0, np.uint8)], {}
    first_texel, first_code = 0, 0
    for (pyramid, use), wants in has_levels.items():
        texels.append(pyramid.prepared_chain(use, wants))
        sizes = level_sizes(*pyramid.size) if wants else [pyramid.size]
        coded: _Codes = (0, 0, 0)
        if use is None and pyramid.codes is not None:
            codes.append(pyramid.codes.reshape(-1))
            coded = (pyramid.codes.shape[2], first_code, CURVES[pyramid.color_space])
            first_code += pyramid.codes.size
        places[pyramid, use] = (len(levels), len(sizes)), coded
        start = first_texel + len(texels[-1]) - sum(width * height for width, height in sizes)
        for width, height in sizes:
            levels.append((start, width, height))
            start += width * height
        first_texel = start
    return _join_arrays(texels), _join_arrays(codes), np.array(levels, np.int64), places


def _join_arrays(arrays: list[NDArray[Any]]) -> NDArray[Any]:
    """Return arrays one after another; what is one alone is not copied."""
    filled = [array for array in arrays if array.size] or arrays
    return writable(filled[0]) if len(filled) == 1 else np.concatenate(filled)


def _table_row(
    texture: Texture | None, use: AlphaUse, places: dict[_Picture, tuple[_Place, _Codes]]
) -> tuple[int, ...]:
    """Return the row of ``Textures.table`` for one texture of one object."""
    if texture is None:
        return NO_TEXTURE_ROW
    wraps = (WRAPS[wrap] for wrap in texture.wrap)
    alpha = {None: texturing.PLAIN, WEIGHTED: texturing.WEIGHTED}.get(use, texturing.MASK)
    place, coded = places[texture.pyramid, use]
    return (*place, *wraps, FILTERS[texture.filter], texture.anisotropy, alpha, *coded)


def _transform_row(texture: Texture | None) -> tuple[float, ...]:
    """Return the row of ``Textures.transforms`` for one texture of one object."""
    return IDENTITY_TRANSFORM if texture is None else texture.transform or IDENTITY_TRANSFORM


def front_windings_of(screen_winding: int, mirrored: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sign of the edge function of each object's front faces on the screen, (O,)."""
    return -screen_winding * mirrored


def placement_of(arrays: SceneArrays, views: ViewTransforms) -> Placement:
    """Return the record of the objects' transforms."""
    return Placement(
        arrays.face_starts,
        arrays.positions,
        np.ascontiguousarray(views.relative_from_model[:, :3, :]),
        views.normal_matrices,
        views.mirrored,
        front_windings_of(views.screen_winding, views.mirrored),
        views.toward_viewer,
    )
