"""Join what materials have beyond colours into the records that kernels read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rasterjit.kernels.records import Maps, Microfacets
from rasterjit.plan_arrays import runs_of
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.tangents import GROUPS

NORMAL = 1
"""Place of normal maps among the textures of a material."""


def join_microfacets(meshes: Sequence[Mesh]) -> Microfacets:
    """Join metallic and roughness of the objects."""
    runs = runs_of(meshes)
    rows = [(mesh.material.metallic, mesh.material.roughness) for mesh, _ in runs]
    return Microfacets(_repeat(rows, runs, np.float32), np.ones(2, np.float32))


def join_maps(meshes: Sequence[Mesh]) -> Maps:
    """Join what lies over the objects besides a base colour, and the tangents it needs."""
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
        _join_tangents(runs) if counts[NORMAL] else np.zeros((0, GROUPS, 4), np.float32),
    )


def _join_tangents(runs: Sequence[tuple[Mesh, int]]) -> NDArray[np.float32]:
    """Join the tangents of the objects with normal maps, (V, 2, 4); zero for the others."""
    parts = []
    for mesh, count in runs:
        texture = mesh.material.textures_read()[NORMAL]
        tangents = np.zeros((len(mesh.vertices), GROUPS, 4), np.float32)
        if texture is not None and (mesh.uv is not None or mesh.tangents is not None):
            tangents = mesh.vertex_tangents(texture.transform)
        parts += [tangents] * count
    return np.concatenate(parts)


def _repeat(
    rows: Sequence[Sequence[float]], runs: Sequence[tuple[Mesh, int]], dtype: type
) -> NDArray:
    """Return one row for each object, given one for each run of instances."""
    return np.repeat(np.array(rows, dtype), [count for _, count in runs], axis=0)
