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

from rasterjit.pipeline.lighting.light_stages import BOUNCED, LIGHT, directions_of, three_rows
from rasterjit.pipeline.lighting.pbr import bounces, find_shares, is_any_above_zero
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.intrinsics import part
from rasterjit.runtime.jit import disjoint_helper, stage
from rasterjit.runtime.state_block import float32, int64

MIN_ALBEDO = np.float32(0.05)
"""Least albedo of the white mirror's single scattering, against division by small numbers."""


@disjoint_helper
def light_channel(
    bright, parts, facing, shining, grazed, falloff, microfacet, reached, metallic, own, edge, red,
    green, blue, head_on, base, bounced, before, out,
):  # fmt: skip
    """Write a light's contribution to one channel of samples with custom specular."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(out.shape[0]):
        weight, bent, metal = min(edge[i], one), grazed[i], metallic[i]
        largest, f0 = min(max(red[i], max(green[i], blue[i])), one), min(head_on[i], one)
        inside = (one - metal) * (one - weight * (largest + (one - largest) * bent)) * parts[0]
        mirrored = (one - metal) * weight * (f0 + (one - f0) * bent)
        mirrored += metal * (base[i] + (one - base[i]) * bent)
        mirrored *= shining[i]
        mirrored += parts[1] * bounced[i]
        arriving = microfacet[i] * falloff[i] * facing[i] * reached[i] * bright
        seen = before[i] + arriving * (base[i] * inside + mirrored)
        out[i] = seen if own[i] * microfacet[i] > zero else out[i]


@stage
def light_own_mirrors(
    block: Block, count, lights: float32[:, ::1], number: int64, parts: float32[::1]
):
    """
    Light samples with custom specular again, from rows BEFORE_RED on.

    Right after `light_stages.add_lights_on_facets` of this light alone, which leaves the terms
    of `pbr.find_facet_angles` in ``single``, and the multiple scattering of metals in ``shares``.
    """
    s = block.samples
    if not is_any_above_zero(part(s, rows.MICROFACET, 0, count)):
        return
    for k in range(3):
        light_channel(
            lights[number, 4 + k], parts, *directions_of(block.single, LIGHT, count),
            part(s, rows.MICROFACET, 0, count), part(s, rows.SHADOW, 0, count),
            part(s, rows.METALLIC, 0, count), part(s, rows.OWN_MIRROR, 0, count),
            part(s, rows.EDGE, 0, count), *three_rows(s, rows.HEAD_ON_RED, count),
            part(s, rows.HEAD_ON_RED + k, 0, count), part(s, rows.RED + k, 0, count),
            part(block.shares, BOUNCED + k, 0, count),
            part(s, rows.BEFORE_RED + k, 0, count), part(s, rows.OUT_RED + k, 0, count),
        )  # fmt: skip


@disjoint_helper
def show_channel(
    scale, offset, microfacet, metallic, own, edge, red, green, blue, head_on, base, white, even,
    before, out,
):  # fmt: skip
    """Write one channel of reflected ambient light."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(out.shape[0]):
        shares, metal = (scale[i], offset[i]), clamped(metallic[i], zero, one)
        weight = min(edge[i], one)
        albedo = shares[0] + shares[1]
        mirrored = (white[i] - (one - albedo) * even[i]) / max(albedo, MIN_ALBEDO)
        mirrored = max(zero, mirrored)
        most = min(max(red[i], max(green[i], blue[i])), one)
        largest, often_largest = bounces(most, shares)
        inside = one - weight * (largest + often_largest)
        once, often = bounces(min(head_on[i], one), shares)
        seen = weight * (once * mirrored + often * even[i]) + inside * base[i] * even[i]
        once, often = bounces(base[i], shares)
        seen = (one - metal) * seen + metal * (once * mirrored + often * even[i])
        out[i] = before[i] + seen if own[i] * microfacet[i] > zero else out[i]


@stage
def show_around_on_own_mirrors(block: Block, count, toward_viewer: float32[::1]):
    """
    Add ambient light to samples with custom specular again, from rows BEFORE_RED on.

    Reads the probes in rows WHITE_RED and LAYER_OUT.
    """
    s, r = block.samples, block.single
    if not is_any_above_zero(part(s, rows.MICROFACET, 0, count)):
        return
    scale, offset = part(r, 0, 0, count), part(r, 1, 0, count)
    find_shares(
        toward_viewer, *three_rows(s, rows.NORMAL_X, count), *three_rows(s, rows.POINT_X, count),
        part(s, rows.ROUGHNESS, 0, count), scale, offset,
    )  # fmt: skip
    for k in range(3):
        show_channel(
            scale, offset, part(s, rows.MICROFACET, 0, count), part(s, rows.METALLIC, 0, count),
            part(s, rows.OWN_MIRROR, 0, count), part(s, rows.EDGE, 0, count),
            *three_rows(s, rows.HEAD_ON_RED, count), part(s, rows.HEAD_ON_RED + k, 0, count),
            part(s, rows.RED + k, 0, count),
            part(s, rows.WHITE_RED + k, 0, count), part(s, rows.LAYER_OUT + k, 0, count),
            part(s, rows.BEFORE_RED + k, 0, count), part(s, rows.OUT_RED + k, 0, count),
        )  # fmt: skip
