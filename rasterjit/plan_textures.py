"""Join the textures of a scene into the one record that kernels read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rasterjit.kernels import texturing
from rasterjit.kernels.records import Textures
from rasterjit.plan import join_uv, runs_of, writable
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.texture import level_sizes

WRAPS = {"repeat": texturing.REPEAT, "clamp": texturing.CLAMP, "mirror": texturing.MIRROR}

FILTERS = {
    "nearest": texturing.NEAREST,
    "bilinear": texturing.BILINEAR,
    "trilinear": texturing.TRILINEAR,
}


def join_textures(meshes: Sequence[Mesh]) -> Textures:
    """Join the textures of the objects, each picture once, and their texture coordinates."""
    textures = list(
        dict.fromkeys(
            mesh.material.base_color_texture
            for mesh in meshes
            if mesh.material.base_color_texture is not None
        )
    )
    levels, rows, first_texel = [], {}, 0
    for texture in textures:
        sizes = level_sizes(*texture.size) if texture.filter == "trilinear" else [texture.size]
        wraps = [WRAPS[wrap] for wrap in texture.wrap]
        rows[texture] = (len(levels), len(sizes), *wraps, FILTERS[texture.filter])
        for width, height in sizes:
            levels.append((first_texel, width, height))
            first_texel += width * height
    texels = [texture.texels() for texture in textures]
    absent = (-1, 0, 0, 0, 0)
    runs = runs_of(meshes)
    table = [rows.get(mesh.material.base_color_texture, absent) for mesh, _ in runs]
    return Textures(
        writable(texels[0]) if len(texels) == 1 else np.concatenate(texels),
        np.array(levels, np.int64),
        np.repeat(np.array(table, np.int64), [count for _, count in runs], axis=0),
        join_uv(meshes),
    )
