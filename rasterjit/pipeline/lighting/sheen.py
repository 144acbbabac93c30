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

from rasterjit.pipeline.lighting.blinn_phong import unit_scale
from rasterjit.pipeline.lighting.light_stages import LIGHT, VIEWER, directions_of, three_rows
from rasterjit.pipeline.lighting.pbr import MIN_COSINE, is_any_above_zero
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.float_math import clamped, exp2, power
from rasterjit.runtime.intrinsics import part
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int64

MIN_ROUGHNESS = np.float32(0.07)
"""Least roughness; lower ones are clamped to it."""

LEANING = np.float32(0.6)
"""Share of the viewer's tangential direction in the bent normal."""

LOG2_E = np.float32(1.442695)

TABLE_STEPS = np.float32(15.0)
"""Steps along each side of the table."""

THOUSANDTHS = (
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
E in thousandths: a row for each roughness from 0 to 1 in equal steps, `MIN_ROUGHNESS` in place of
less; a column for each cosine, whose roots go from 0 to 1 in equal steps, 0.001 in place of 0.
"""

ALBEDO = np.array(THOUSANDTHS, np.float32) / np.float32(1000.0)


@helper
def albedo(table, cosine, roughness):
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
def hidden(cosine, share):
    """Return Charlie's lambda, the masking of fibres from one direction."""
    half, held = np.float32(0.5), clamped(cosine, np.float32(0.0), np.float32(1.0))
    a = np.float32(21.5473) + share * np.float32(25.3245 - 21.5473)
    b = np.float32(3.82987) + share * np.float32(3.32435 - 3.82987)
    c = np.float32(0.19823) + share * np.float32(0.16801 - 0.19823)
    d = np.float32(-1.97760) + share * np.float32(1.97760 - 1.27393)
    e = np.float32(-4.32054) + share * np.float32(4.32054 - 4.85967)
    x = min(held, np.float32(1.0) - held)
    own = a / (np.float32(1.0) + b * power(x, c)) + d * x + e
    middle = a / (np.float32(1.0) + b * exp2(-c)) + d * half + e
    return exp2(LOG2_E * (own if held < half else np.float32(2.0) * middle - own))


@disjoint_helper
def find_fibres(parts, nx, ny, nz, roughness, vx, vy, vz, facing, shining, grazed):
    """
    Replace the facets' terms of a light by the BRDF of white sheen times n·l.

    Takes what `pbr.find_facet_angles` writes: the fifth root of the last is ``1 - v h``. The half
    vector is the sum of two unit vectors over ``2 v h``, so ``n h`` is that of the cosines. Writes
    the cosine between normal and viewer in its place.
    """
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    for i in range(nx.shape[0]):
        n_l = facing[i]
        n_v = max(MIN_COSINE, nx[i] * vx[i] + ny[i] * vy[i] + nz[i] * vz[i])
        v_h = max(MIN_COSINE, one - power(grazed[i], np.float32(0.2)))
        n_h = half * (n_l + n_v) / v_h
        alpha = clamped(roughness[i], MIN_ROUGHNESS, one)
        alpha *= alpha
        sharp = half / alpha
        density = (one + sharp) * power(max(zero, one - n_h * n_h), sharp)
        share = (one - alpha) * (one - alpha)
        others = one + hidden(n_v, share) + hidden(n_l, share)
        shown = parts[1] * density / (np.float32(4.0) * n_v * others)
        shining[i], grazed[i] = shown if n_l > zero else zero, n_v


@disjoint_helper
def lay_fibres(
    light, table, facing, shining, seen, falloff, microfacet, reached, roughness, red, green, blue,
    below_red, below_green, below_blue, out_red, out_green, out_blue,
):  # fmt: skip
    """Blend sheen over the light added to samples since rows BELOW_RED were copied."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(out_red.shape[0]):
        r, g, b = min(red[i], one), min(green[i], one), min(blue[i], one)
        most = max(r, max(g, b))
        if microfacet[i] * most > zero:
            taken = max(
                albedo(table, seen[i], roughness[i]), albedo(table, facing[i], roughness[i])
            )
            left = one - most * taken
            arriving = falloff[i] * reached[i] * shining[i]
            out_red[i] = below_red[i] + (out_red[i] - below_red[i]) * left + arriving * light[4] * r
            added = (out_green[i] - below_green[i]) * left + arriving * light[5] * g
            out_green[i] = below_green[i] + added
            added = (out_blue[i] - below_blue[i]) * left + arriving * light[6] * b
            out_blue[i] = below_blue[i] + added


@stage
def light_fibres(
    block: Block, count, lights: float32[:, ::1], number: int64, parts: float32[::1],
    table: float32[:, ::1],
):  # fmt: skip
    """
    Add the sheen of one light, and scale the base layer's part of it.

    Behind `light_stages.add_lights_on_facets` of this light alone, which leaves the directions to
    the viewer, and how the light falls, in ``single``.
    """
    s = block.samples
    if not is_any_above_zero(part(s, rows.MICROFACET, 0, count)):
        return
    roughness = part(s, rows.SHEEN_ROUGHNESS, 0, count)
    facing, shining, seen, falloff = directions_of(block.single, LIGHT, count)
    find_fibres(
        parts, *three_rows(s, rows.NORMAL_X, count), roughness,
        *three_rows(block.single, VIEWER, count), facing, shining, seen,
    )  # fmt: skip
    lay_fibres(
        lights[number], table, facing, shining, seen, falloff, part(s, rows.MICROFACET, 0, count),
        part(s, rows.SHADOW, 0, count), roughness, *three_rows(s, rows.SHEEN_RED, count),
        *three_rows(s, rows.BELOW_RED, count), *three_rows(s, rows.OUT_RED, count),
    )  # fmt: skip


@disjoint_helper
def lean(toward_viewer, nx, ny, nz, px, py, pz, x, y, z):
    """Write normals bent toward the viewer."""
    for i in range(x.shape[0]):
        vx, vy, vz = (
            toward_viewer[0] - toward_viewer[3] * px[i],
            toward_viewer[1] - toward_viewer[3] * py[i],
            toward_viewer[2] - toward_viewer[3] * pz[i],
        )
        scale = unit_scale(vx, vy, vz)
        vx, vy, vz = vx * scale, vy * scale, vz * scale
        own = np.float32(1.0) - LEANING * (nx[i] * vx + ny[i] * vy + nz[i] * vz)
        mx, my, mz = (
            own * nx[i] + LEANING * vx, own * ny[i] + LEANING * vy, own * nz[i] + LEANING * vz
        )  # fmt: skip
        scale = unit_scale(mx, my, mz)
        x[i], y[i], z[i] = mx * scale, my * scale, mz * scale


@stage
def lean_normals(block: Block, count, toward_viewer: float32[::1]):
    """Write the bent normals for the sheen's ambient light to rows LEANING_X to Z."""
    s = block.samples
    lean(
        toward_viewer, *three_rows(s, rows.NORMAL_X, count), *three_rows(s, rows.POINT_X, count),
        *three_rows(s, rows.LEANING_X, count),
    )  # fmt: skip


@disjoint_helper
def show_fibres(
    toward_viewer, table, nx, ny, nz, px, py, pz, microfacet, roughness, red, green, blue, even_red,
    even_green, even_blue, below_red, below_green, below_blue, out_red, out_green, out_blue,
):  # fmt: skip
    """Blend sheen over the ambient light of samples."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(out_red.shape[0]):
        r, g, b = min(red[i], one), min(green[i], one), min(blue[i], one)
        most = max(r, max(g, b))
        if microfacet[i] * most > zero:
            vx, vy, vz = (
                toward_viewer[0] - toward_viewer[3] * px[i],
                toward_viewer[1] - toward_viewer[3] * py[i],
                toward_viewer[2] - toward_viewer[3] * pz[i],
            )
            n_v = (nx[i] * vx + ny[i] * vy + nz[i] * vz) * unit_scale(vx, vy, vz)
            taken = albedo(table, n_v, roughness[i])
            left = one - most * taken
            added = (out_red[i] - below_red[i]) * left + taken * r * even_red[i]
            out_red[i] = below_red[i] + added
            added = (out_green[i] - below_green[i]) * left + taken * g * even_green[i]
            out_green[i] = below_green[i] + added
            added = (out_blue[i] - below_blue[i]) * left + taken * b * even_blue[i]
            out_blue[i] = below_blue[i] + added


@stage
def show_around_on_fibres(block: Block, count, toward_viewer: float32[::1], table: float32[:, ::1]):
    """Blend sheen over ambient light; rows LAYER_OUT hold the irradiance."""
    s = block.samples
    if not is_any_above_zero(part(s, rows.MICROFACET, 0, count)):
        return
    show_fibres(
        toward_viewer, table, *three_rows(s, rows.NORMAL_X, count),
        *three_rows(s, rows.POINT_X, count), part(s, rows.MICROFACET, 0, count),
        part(s, rows.SHEEN_ROUGHNESS, 0, count), *three_rows(s, rows.SHEEN_RED, count),
        *three_rows(s, rows.LAYER_OUT, count), *three_rows(s, rows.BELOW_RED, count),
        *three_rows(s, rows.OUT_RED, count),
    )  # fmt: skip
