"""Join the textures of a scene into the one record that kernels read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rasterjit.kernels import texturing
from rasterjit.kernels.records import Cutouts, Surface, Textures
from rasterjit.plan_arrays import join_uv, runs_of, writable
from rasterjit.plan_contents import may_have_holes
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.texture import Pyramid, Texture, level_sizes

WRAPS = {"repeat": texturing.REPEAT, "clamp": texturing.CLAMP, "mirror": texturing.MIRROR}

FILTERS = {
    "nearest": texturing.NEAREST,
    "bilinear": texturing.BILINEAR,
    "trilinear": texturing.TRILINEAR,
}

ABSENT = (-1,) + (0,) * (texturing.TABLE_COLUMNS - 1)
"""Row of the table for an object without a texture of a kind."""

UNMOVED = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
"""The transform that changes nothing."""


def join_textures(meshes: Sequence[Mesh]) -> Textures:
    """Join the textures of the objects, each picture once, and their texture coordinates."""
    runs = runs_of(meshes)
    counts = [count for _, count in runs]
    kinds = [mesh.material.textures_read() for mesh, _ in runs]
    textures = [texture for row in kinds for texture in row if texture is not None]
    texels, levels, places = _join_texels(textures)
    table = [[_table_row(texture, places) for texture in row] for row in kinds]
    transforms = None
    if any(texture.transform is not None for texture in textures):
        rows = [[_transform_row(texture) for texture in row] for row in kinds]
        transforms = np.repeat(np.array(rows, np.float64), counts, axis=0)
    anisotropic = sum(texture.anisotropy > 1 for texture in dict.fromkeys(textures))
    return Textures(
        texels,
        levels,
        np.repeat(np.array(table, np.int64), counts, axis=0),
        join_uv(meshes),
        transforms,
        anisotropic or None,
    )


def join_cutouts(
    meshes: Sequence[Mesh],
    face_starts: NDArray[np.int64],
    surface: Surface,
    textures: Textures | None,
) -> Cutouts:
    """Return which objects have holes, and what decides where; no textures if none has any."""
    cutoffs = {
        mesh: mesh.material.alpha_cutoff if may_have_holes(mesh) else 0.0
        for mesh in dict.fromkeys(meshes)
    }
    return Cutouts(
        np.array([cutoffs[mesh] for mesh in meshes], np.float32),
        face_starts,
        surface.materials,
        surface.vertex_colors,
        surface.face_colors,
        textures,
    )


def _join_texels(
    textures: Sequence[Texture],
) -> tuple[NDArray[np.float32], NDArray[np.int64], dict[Pyramid, tuple[int, int]]]:
    """Return the texels and levels of all pictures, and the first level and how many of each."""
    has_levels: dict[Pyramid, bool] = {}
    for texture in textures:
        wants = texture.filter == "trilinear"
        has_levels[texture.pyramid] = has_levels.get(texture.pyramid, False) or wants
    texels, levels, places, first_texel = [], [], {}, 0
    for pyramid, wants in has_levels.items():
        texels.append(pyramid.chain() if wants else pyramid.image.reshape(-1, 4))
        sizes = level_sizes(*pyramid.size) if wants else [pyramid.size]
        places[pyramid] = (len(levels), len(sizes))
        for width, height in sizes:
            levels.append((first_texel, width, height))
            first_texel += width * height
    joined = writable(texels[0]) if len(texels) == 1 else np.concatenate(texels)
    return joined, np.array(levels, np.int64), places


def _table_row(texture: Texture | None, places: dict[Pyramid, tuple[int, int]]) -> tuple[int, ...]:
    """Return what ``Textures.table`` holds of one texture of one object."""
    if texture is None:
        return ABSENT
    wraps = (WRAPS[wrap] for wrap in texture.wrap)
    return (*places[texture.pyramid], *wraps, FILTERS[texture.filter], texture.anisotropy)


def _transform_row(texture: Texture | None) -> tuple[float, ...]:
    """Return what ``Textures.transforms`` holds of one texture of one object."""
    return UNMOVED if texture is None else texture.transform or UNMOVED
