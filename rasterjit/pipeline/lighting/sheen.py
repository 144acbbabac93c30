"""
Shade the sheen layer of ``KHR_materials_sheen``: cloth fibres.

The sheen is ``color D V``: Charlie's distribution ``D = (2 + 1/a) sin(h)**(1/a) / (2 pi)``, where
h is the angle between normal and half vector and ``a = roughness**2``, and the fitted shadowing
``V = 1 / ((1 + L(n l) + L(n v)) 4 n_l n_v)`` [1]_, [2]_. As everywhere here, it is multiplied by
pi. The base layer is scaled by ``1 - max(color) max(E(n v), E(n l))``: E is the directional albedo
of ``D V``, from a table, clamped to 1, which very smooth fibres exceed at grazing angles.

Ambient light adds ``color E(n v)`` times the irradiance along a normal bent toward the viewer,
since fibres scatter back; the lobe is so wide that no prefiltered map is needed. Under a sky with a
bright horizon that differs from the integral by a third of it for a roughness of 0.2, by an eighth
for 0.8. Sheen over white is at most white under white light.

References
----------
.. [1] The Khronos Group, "KHR_materials_sheen".
.. [2] A. Conty Estevez, C. Kulla, "Production Friendly Microfacet Sheen BRDF", SIGGRAPH 2017.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.lighting.blinn_phong import invert_length
from rasterjit.pipeline.lighting.light_stages import LIGHT_DIR, VIEW_DIR
from rasterjit.pipeline.lighting.pbr import MIN_COSINE, is_any_above_zero
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import four_parts
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.float_math import clamped, exp2, power
from rasterjit.runtime.intrinsics import part, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int64

MIN_ROUGHNESS = np.float32(0.07)
"""Least roughness; lower ones are clamped to it."""

BEND_WEIGHT = np.float32(0.6)
"""Share of the viewer's tangential direction in the bent normal."""

LOG2_E = np.float32(1.442695)

TABLE_STEPS = np.float32(15.0)
"""Steps along each side of the table."""

ALBEDO_THOUSANDTHS = (
    (1000, 1000, 1000, 1000, 720, 336, 129, 38, 8, 1, 0, 0, 0, 0, 0, 0),
    (1000, 1000, 1000, 1000, 720, 336, 129, 38, 8, 1, 0, 0, 0, 0, 0, 0),
    (1000, 1000, 1000, 1000, 754, 500, 307, 172, 86, 37, 13, 4, 1, 0, 0, 0),
    (1000, 1000, 1000, 882, 690, 518, 372, 254, 163, 97, 52, 24, 9, 3, 0, 0),
    (935, 984, 913, 781, 643, 513, 398, 299, 215, 147, 94, 55, 29, 13, 4, 0),
    (825, 876, 829, 728, 618, 513, 416, 330, 254, 188, 133, 88, 55, 30, 13, 2),
    (769, 822, 790, 705, 611, 520, 435, 357, 287, 224, 169, 121, 83, 51, 27, 9),
    (747, 802, 778, 704, 619, 536, 458, 386, 319, 258, 203, 153, 111, 76, 45, 20),
    (746, 804, 786, 717, 637, 558, 484, 415, 351, 291, 235, 185, 141, 102, 67, 35),
    (760, 821, 807, 740, 662, 586, 514, 446, 383, 323, 267, 215, 169, 128, 90, 54),
    (784, 848, 836, 770, 693, 617, 545, 477, 414, 354, 297, 244, 197, 154, 113, 75),
    (813, 880, 868, 801, 724, 647, 575, 507, 443, 383, 325, 271, 223, 178, 136, 96),
    (842, 911, 899, 831, 752, 675, 602, 533, 469, 408, 350, 295, 246, 200, 157, 116),
    (865, 934, 923, 853, 773, 695, 622, 554, 489, 428, 369, 314, 265, 219, 176, 135),
    (875, 944, 932, 863, 783, 706, 633, 565, 501, 441, 383, 328, 280, 235, 192, 151),
    (864, 933, 922, 854, 777, 702, 631, 566, 504, 445, 389, 336, 289, 245, 204, 164),
)
"""
E in thousandths: a row for each roughness from 0 to 1 in equal steps, at least `MIN_ROUGHNESS`; a
column for each cosine, whose roots go from 0 to 1 in equal steps, 0.001 in place of 0.
"""

ALBEDO = np.array(ALBEDO_THOUSANDTHS, np.float32) / np.float32(1000.0)


@helper
def sheen_albedo(table, cosine, roughness):
    """Return the directional albedo of the sheen, from the table."""
    zero, one = np.float32(0.0), np.float32(1.0)
    y = clamped(roughness, zero, one) * TABLE_STEPS
    x = np.sqrt(clamped(cosine, zero, one)) * TABLE_STEPS
    row, column = min(np.int64(y), np.int64(14)), min(np.int64(x), np.int64(14))
    y, x = y - np.float32(row), x - np.float32(column)
    r, c = np.uintp(row), np.uintp(column)
    upper = table[r, c] + x * (table[r, c + np.uintp(1)] - table[r, c])
    r += np.uintp(1)
    lower = table[r, c] + x * (table[r, c + np.uintp(1)] - table[r, c])
    return upper + y * (lower - upper)


@helper
def charlie_lambda(cosine, smoothness):
    """Return Charlie's lambda, the masking of fibres from one direction."""
    half, c = np.float32(0.5), clamped(cosine, np.float32(0.0), np.float32(1.0))
    a = np.float32(21.5473) + smoothness * np.float32(25.3245 - 21.5473)
    b = np.float32(3.82987) + smoothness * np.float32(3.32435 - 3.82987)
    exponent = np.float32(0.19823) + smoothness * np.float32(0.16801 - 0.19823)
    d = np.float32(-1.97760) + smoothness * np.float32(1.97760 - 1.27393)
    e = np.float32(-4.32054) + smoothness * np.float32(4.32054 - 4.85967)
    x = min(c, np.float32(1.0) - c)
    log_lambda = a / (np.float32(1.0) + b * power(x, exponent)) + d * x + e
    log_half = a / (np.float32(1.0) + b * exp2(-exponent)) + d * half + e
    return exp2(LOG2_E * (log_lambda if c < half else np.float32(2.0) * log_half - log_lambda))


@disjoint_helper
def find_sheen_terms(lobes, nx, ny, nz, roughness, vx, vy, vz, n_ls, specular, schlick):
    """
    Overwrite the specular terms of a light by the BRDF of white sheen, and n·v.

    Takes what `pbr.find_specular_terms` writes: the fifth root of the last is ``1 - v h``. The half
    vector is the sum of two unit vectors over ``2 v h``, so ``n h`` is ``(n l + n v) / (2 v h)``.
    Writes the BRDF over the specular term, n·v over Schlick's weight.
    """
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    for i in range(nx.shape[0]):
        n_l = n_ls[i]
        n_v = max(MIN_COSINE, nx[i] * vx[i] + ny[i] * vy[i] + nz[i] * vz[i])
        v_h = max(MIN_COSINE, one - power(schlick[i], np.float32(0.2)))
        n_h = half * (n_l + n_v) / v_h
        alpha = clamped(roughness[i], MIN_ROUGHNESS, one)
        alpha *= alpha
        inverse = half / alpha
        density = (one + inverse) * power(max(zero, one - n_h * n_h), inverse)
        smoothness = (one - alpha) * (one - alpha)
        shadowing = one + charlie_lambda(n_v, smoothness) + charlie_lambda(n_l, smoothness)
        brdf = lobes[1] * density / (np.float32(4.0) * n_v * shadowing)
        specular[i], schlick[i] = brdf if n_l > zero else zero, n_v


@disjoint_helper
def blend_sheen(
    light, table, n_l, brdf, n_v, falloff, microfacet, visibility, roughness, red, green, blue,
    below_red, below_green, below_blue, out_red, out_green, out_blue,
):  # fmt: skip
    """Blend sheen over the light added to samples since rows BEFORE_SHEEN_RED were copied."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(out_red.shape[0]):
        r, g, b = min(red[i], one), min(green[i], one), min(blue[i], one)
        largest = max(r, max(g, b))
        if microfacet[i] * largest > zero:
            energy = max(
                sheen_albedo(table, n_v[i], roughness[i]), sheen_albedo(table, n_l[i], roughness[i])
            )
            rest = one - largest * energy
            weight = falloff[i] * visibility[i] * brdf[i]
            out_red[i] = below_red[i] + (out_red[i] - below_red[i]) * rest + weight * light[4] * r
            lit = (out_green[i] - below_green[i]) * rest + weight * light[5] * g
            out_green[i] = below_green[i] + lit
            lit = (out_blue[i] - below_blue[i]) * rest + weight * light[6] * b
            out_blue[i] = below_blue[i] + lit


@stage
def add_sheen_light(
    block: Block, count, lights: float32[:, ::1], light: int64, lobes: float32[::1],
    table: float32[:, ::1],
):  # fmt: skip
    """
    Add the sheen of one light, and scale the base layer's part of it.

    After `light_stages.add_microfacet_lights` of this light alone, which leaves the directions to
    the viewer and the terms of the light in ``floats``.
    """
    s = block.samples
    if not is_any_above_zero(part(s, rows.MICROFACET, 0, count)):
        return
    roughness = part(s, rows.SHEEN_ROUGHNESS, 0, count)
    n_l, specular, schlick, falloff = four_parts(block.floats, LIGHT_DIR, 0, count)
    find_sheen_terms(
        lobes, *three_parts(s, rows.NORMAL_X, 0, count), roughness,
        *three_parts(block.floats, VIEW_DIR, 0, count), n_l, specular, schlick,
    )  # fmt: skip
    blend_sheen(
        lights[light], table, n_l, specular, schlick, falloff, part(s, rows.MICROFACET, 0, count),
        part(s, rows.SHADOW, 0, count), roughness, *three_parts(s, rows.SHEEN_RED, 0, count),
        *three_parts(s, rows.BEFORE_SHEEN_RED, 0, count), *three_parts(s, rows.OUT_RED, 0, count),
    )  # fmt: skip


@disjoint_helper
def write_bent_normals(toward_viewer, nx, ny, nz, px, py, pz, x, y, z):
    """Write normals bent toward the viewer."""
    for i in range(x.shape[0]):
        vx = toward_viewer[0] - toward_viewer[3] * px[i]
        vy = toward_viewer[1] - toward_viewer[3] * py[i]
        vz = toward_viewer[2] - toward_viewer[3] * pz[i]
        scale = invert_length(vx, vy, vz)
        vx, vy, vz = vx * scale, vy * scale, vz * scale
        weight = np.float32(1.0) - BEND_WEIGHT * (nx[i] * vx + ny[i] * vy + nz[i] * vz)
        mx, my, mz = (
            weight * nx[i] + BEND_WEIGHT * vx, weight * ny[i] + BEND_WEIGHT * vy,
            weight * nz[i] + BEND_WEIGHT * vz
        )  # fmt: skip
        scale = invert_length(mx, my, mz)
        x[i], y[i], z[i] = mx * scale, my * scale, mz * scale


@stage
def bend_normals(block: Block, count, toward_viewer: float32[::1]):
    """Write the bent normals for the sheen's ambient light to rows BENT_NORMAL_X to Z."""
    s = block.samples
    write_bent_normals(
        toward_viewer, *three_parts(s, rows.NORMAL_X, 0, count),
        *three_parts(s, rows.POINT_X, 0, count), *three_parts(s, rows.BENT_NORMAL_X, 0, count),
    )  # fmt: skip


@disjoint_helper
def blend_ambient_sheen(
    toward_viewer, table, nx, ny, nz, px, py, pz, microfacet, roughness, red, green, blue, lit_red,
    lit_green, lit_blue, below_red, below_green, below_blue, out_red, out_green, out_blue,
):  # fmt: skip
    """Blend sheen over the ambient light of samples."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(out_red.shape[0]):
        r, g, b = min(red[i], one), min(green[i], one), min(blue[i], one)
        largest = max(r, max(g, b))
        if microfacet[i] * largest > zero:
            vx = toward_viewer[0] - toward_viewer[3] * px[i]
            vy = toward_viewer[1] - toward_viewer[3] * py[i]
            vz = toward_viewer[2] - toward_viewer[3] * pz[i]
            n_v = (nx[i] * vx + ny[i] * vy + nz[i] * vz) * invert_length(vx, vy, vz)
            energy = sheen_albedo(table, n_v, roughness[i])
            rest = one - largest * energy
            lit = (out_red[i] - below_red[i]) * rest + energy * r * lit_red[i]
            out_red[i] = below_red[i] + lit
            lit = (out_green[i] - below_green[i]) * rest + energy * g * lit_green[i]
            out_green[i] = below_green[i] + lit
            lit = (out_blue[i] - below_blue[i]) * rest + energy * b * lit_blue[i]
            out_blue[i] = below_blue[i] + lit


@stage
def add_ambient_sheen(block: Block, count, toward_viewer: float32[::1], table: float32[:, ::1]):
    """Blend sheen over ambient light; rows LAYER_OUT hold the irradiance."""
    s = block.samples
    if not is_any_above_zero(part(s, rows.MICROFACET, 0, count)):
        return
    blend_ambient_sheen(
        toward_viewer, table, *three_parts(s, rows.NORMAL_X, 0, count),
        *three_parts(s, rows.POINT_X, 0, count), part(s, rows.MICROFACET, 0, count),
        part(s, rows.SHEEN_ROUGHNESS, 0, count), *three_parts(s, rows.SHEEN_RED, 0, count),
        *three_parts(s, rows.LAYER_OUT, 0, count), *three_parts(s, rows.BEFORE_SHEEN_RED, 0, count),
        *three_parts(s, rows.OUT_RED, 0, count),
    )  # fmt: skip
