"""
Add the clearcoat layer of ``KHR_materials_clearcoat`` over the base layer.

The coat is a specular layer with its own normal and roughness, lit by the same stages (as a white
metal, which reflects all light). Its weight is ``w = clearcoat (0.04 + 0.96 (1 - |n v|)**5)`` [1]_;
the base layer and its emission are scaled by ``1 - w``.

References
----------
.. [1] The Khronos Group, "KHR_materials_clearcoat", and appendix B of the glTF 2.0 specification:
   ``fresnel_coat``.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.lighting.blinn_phong import invert_length
from rasterjit.pipeline.lighting.pbr import DIELECTRIC_F0, schlick_weight
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.intrinsics import part, three_parts
from rasterjit.runtime.jit import disjoint_helper, stage
from rasterjit.runtime.state_block import float32, int64


@disjoint_helper
def blend_clearcoat(toward_viewer, nx, ny, nz, px, py, pz, coat, coat_color, below):
    """Blend one channel of the clearcoat over the base layer."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(below.shape[0]):
        vx = toward_viewer[0] - toward_viewer[3] * px[i]
        vy = toward_viewer[1] - toward_viewer[3] * py[i]
        vz = toward_viewer[2] - toward_viewer[3] * pz[i]
        n_v = (nx[i] * vx + ny[i] * vy + nz[i] * vz) * invert_length(vx, vy, vz)
        reflectance = DIELECTRIC_F0 + (one - DIELECTRIC_F0) * schlick_weight(max(zero, abs(n_v)))
        weight = max(zero, min(coat[i], one)) * reflectance
        blended = below[i] * (one - weight) + weight * coat_color[i]
        below[i] = blended if weight > zero else below[i]


@stage
def blend_clearcoats(
    block: Block, count, toward_viewer: float32[::1], coat_red: int64, below_red: int64
):
    """
    Blend the clearcoat over three rows of samples, from ``below_red`` on.

    Reads the clearcoat's rows, with unit normals, and its colour from row ``coat_red`` on.
    """
    s = block.samples
    for k in range(3):
        blend_clearcoat(
            toward_viewer, *three_parts(s, rows.COAT_NORMAL_X, 0, count),
            *three_parts(s, rows.POINT_X, 0, count), part(s, rows.COAT, 0, count),
            part(s, coat_red + k, 0, count), part(s, below_red + k, 0, count),
        )  # fmt: skip
