"""
Shade dielectrics with custom specular: ``KHR_materials_specular`` and ``KHR_materials_ior``.

A dielectric reflects ``w F`` of the light and transmits ``1 - w max(F)`` into it, where
``F = f0 + (1 - f0) (1 - v h)**5`` and ``f0 = min(((ior - 1) / (ior + 1))**2 tint, 1)`` [1]_.
Such samples are lit like all others, then again from the colour they had before. Ambient light is
read from two probes: a white mirror and a white diffuse surface. The first contains a share E of
light reflected once, and for the rest the second.

References
----------
.. [1] The Khronos Group, "KHR_materials_specular", "KHR_materials_ior", and appendix B of the glTF
   2.0 specification: ``fresnel_mix``.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.lighting.light_stages import LIGHT_DIR, MULTIPLE_SCATTERING
from rasterjit.pipeline.lighting.pbr import find_env_brdf, is_any_above_zero, scattering_albedos
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import four_parts
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.intrinsics import part, three_parts
from rasterjit.runtime.jit import disjoint_helper, stage
from rasterjit.runtime.state_block import float32, int64

MIN_ALBEDO = np.float32(0.05)
"""Least albedo of the white mirror's single scattering, against division by small numbers."""


@disjoint_helper
def add_channel_light(
    intensity, lobes, n_l, specular, schlick, falloff, microfacet, visibility, metallic,
    is_dielectric, f90, red, green, blue, f0s, base, multiple, prior, out,
):  # fmt: skip
    """Write a light's contribution to one channel of samples with custom specular."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(out.shape[0]):
        w, fresnel, metal = min(f90[i], one), schlick[i], metallic[i]
        max_f0, f0 = min(max(red[i], max(green[i], blue[i])), one), min(f0s[i], one)
        diffuse = (one - metal) * (one - w * (max_f0 + (one - max_f0) * fresnel)) * lobes[0]
        reflected = (one - metal) * w * (f0 + (one - f0) * fresnel)
        reflected += metal * (base[i] + (one - base[i]) * fresnel)
        reflected *= specular[i]
        reflected += lobes[1] * multiple[i]
        weight = microfacet[i] * falloff[i] * n_l[i] * visibility[i] * intensity
        lit = prior[i] + weight * (base[i] * diffuse + reflected)
        out[i] = lit if is_dielectric[i] * microfacet[i] > zero else out[i]


@stage
def add_dielectric_light(
    block: Block, count, lights: float32[:, ::1], light: int64, lobes: float32[::1]
):
    """
    Light samples with custom specular again, from rows BEFORE_SPECULAR_RED on.

    Right after `light_stages.add_microfacet_lights` of this light alone, which leaves the terms of
    `pbr.find_specular_terms` in ``floats``, and metals' multiple scattering in ``lookup_weights``.
    """
    s = block.samples
    if not is_any_above_zero(part(s, rows.MICROFACET, 0, count)):
        return
    for k in range(3):
        add_channel_light(
            lights[light, 4 + k], lobes, *four_parts(block.floats, LIGHT_DIR, 0, count),
            part(s, rows.MICROFACET, 0, count), part(s, rows.SHADOW, 0, count),
            part(s, rows.METALLIC, 0, count), part(s, rows.IS_DIELECTRIC, 0, count),
            part(s, rows.F90, 0, count), *three_parts(s, rows.F0_RED, 0, count),
            part(s, rows.F0_RED + k, 0, count), part(s, rows.RED + k, 0, count),
            part(block.lookup_weights, MULTIPLE_SCATTERING + k, 0, count),
            part(s, rows.BEFORE_SPECULAR_RED + k, 0, count), part(s, rows.OUT_RED + k, 0, count),
        )  # fmt: skip


@disjoint_helper
def add_channel_ambient(
    scale, offset, microfacet, metallic, is_dielectric, f90, red, green, blue, f0, base, mirror,
    probe, prior, out,
):  # fmt: skip
    """Write one channel of reflected ambient light."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(out.shape[0]):
        env_brdf, metal = (scale[i], offset[i]), clamped(metallic[i], zero, one)
        weight = min(f90[i], one)
        albedo = env_brdf[0] + env_brdf[1]
        glossy = (mirror[i] - (one - albedo) * probe[i]) / max(albedo, MIN_ALBEDO)
        glossy = max(zero, glossy)
        max_f0 = min(max(red[i], max(green[i], blue[i])), one)
        single_max, multiple_max = scattering_albedos(max_f0, env_brdf)
        diffuse = one - weight * (single_max + multiple_max)
        single, multiple = scattering_albedos(min(f0[i], one), env_brdf)
        lit = weight * (single * glossy + multiple * probe[i]) + diffuse * base[i] * probe[i]
        single, multiple = scattering_albedos(base[i], env_brdf)
        lit = (one - metal) * lit + metal * (single * glossy + multiple * probe[i])
        out[i] = prior[i] + lit if is_dielectric[i] * microfacet[i] > zero else out[i]


@stage
def add_dielectric_ambient(block: Block, count, toward_viewer: float32[::1]):
    """
    Add ambient light to samples with custom specular again, from rows BEFORE_SPECULAR_RED on.

    Reads the probes in rows MIRROR_PROBE_RED and LAYER_OUT.
    """
    s, r = block.samples, block.floats
    if not is_any_above_zero(part(s, rows.MICROFACET, 0, count)):
        return
    scale, offset = part(r, 0, 0, count), part(r, 1, 0, count)
    find_env_brdf(
        toward_viewer, *three_parts(s, rows.NORMAL_X, 0, count),
        *three_parts(s, rows.POINT_X, 0, count), part(s, rows.ROUGHNESS, 0, count), scale, offset,
    )  # fmt: skip
    for k in range(3):
        add_channel_ambient(
            scale, offset, part(s, rows.MICROFACET, 0, count), part(s, rows.METALLIC, 0, count),
            part(s, rows.IS_DIELECTRIC, 0, count), part(s, rows.F90, 0, count),
            *three_parts(s, rows.F0_RED, 0, count), part(s, rows.F0_RED + k, 0, count),
            part(s, rows.RED + k, 0, count),
            part(s, rows.MIRROR_PROBE_RED + k, 0, count), part(s, rows.LAYER_OUT + k, 0, count),
            part(s, rows.BEFORE_SPECULAR_RED + k, 0, count), part(s, rows.OUT_RED + k, 0, count),
        )  # fmt: skip
