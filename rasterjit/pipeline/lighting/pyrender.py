"""
Light metallic-roughness samples as the fragment shader of pyrender 0.1.45 does.

Used by `compat.pyrender`; a microfacet model that differs from glTF's (``lighting.pbr``). With the
cosines between normal n, light l, viewer v and their half vector h, each clamped (n·l and |n·v| to
0.001..1), base colour b, metallic m and roughness r, clamped to 0.04..1:

- specular is F G D / (4 n·l n·v + 0.001): Schlick's F of 0.04 (1 - m) + b m; Schlick's form of
  Smith's G, with k = (r + 1)² / 8; the GGX density D with alpha r²;
- diffuse is (1 - F) 0.96 (1 - m) b / pi;
- both times n·l and the light's colour and intensity, over the squared distance of a lamp, times
  the squared ramp of a cone.

A light with a shadow map is filtered by PCF of 3 x 3 taps, with a bias of
max(0.001 (1 - n·l), 0.0001) / w in window coordinates.

Surfaces that face away are not black: n·l is never below 0.001. Ambient light multiplies the base
colour, for any metallic. Then occlusion multiplies the sum, emission is added, and vertex colours
multiply all.

References
----------
.. [1] M. Matl, pyrender 0.1.45: ``shaders/mesh.frag``, for the formulas and constants.
.. [2] B. Karis, "Real Shading in Unreal Engine 4", SIGGRAPH 2013 courses: where k comes from.
"""

from __future__ import annotations

import math

import numpy as np

from rasterjit.pipeline.geometry.barycentric import place
from rasterjit.pipeline.lighting import blinn_phong
from rasterjit.pipeline.lighting.blinn_phong import unit_scale
from rasterjit.pipeline.lighting.light_stages import LIGHT, VIEWER, directions_of, three_rows
from rasterjit.pipeline.records import Placement
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.attributes import owner_end
from rasterjit.pipeline.surface.sample_block import OWNER, SEGMENTS, START, STOP, Block
from rasterjit.pipeline.surface.texture_lookup import SHOWN
from rasterjit.runtime.float_math import clamped, power
from rasterjit.runtime.intrinsics import part, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int32, int64, uint8

COLOR_RED = rows.TINT_RED
"""Rows, three: vertex colours. They reuse the rows of transmission, which this model lacks."""

MIN_COSINE = np.float32(0.001)
MIN_ROUGHNESS = np.float32(0.04)
DIELECTRIC = np.float32(0.04)
SPARE = np.float32(0.001)
"""Constant added to the denominator of the specular term."""
FARTHEST = np.float32(64.0)
"""Positions outside a shadow map are clamped at this distance, in its sizes."""
OVER_PI = np.float32(1.0 / math.pi)


@stage
def face_viewer(block: Block, count, faces_viewer: uint8[::1], toward_viewer: float32[::1]):
    """Turn the normals of some objects toward the viewer."""
    s = block.samples
    for k in range(block.counts[SEGMENTS]):
        segment = block.segments[k]
        if faces_viewer[np.uintp(segment[OWNER])] == 0:
            continue
        for n in range(segment[START], segment[STOP]):
            for axis in range(3):
                s[rows.NORMAL_X + axis, n] = (
                    toward_viewer[axis] - toward_viewer[3] * s[rows.POINT_X + axis, n]
                )


@helper
def between(one, other):
    """Return the midpoint of two points, and their squared distance."""
    x, y, z = other[0] - one[0], other[1] - one[1], other[2] - one[2]
    middle = one[0] + 0.5 * x, one[1] + 0.5 * y, one[2] + 0.5 * z
    return middle, x * x + y * y + z * z


@stage
def place_in_squares(
    block: Block, count, are_squares: uint8[::1], faces: int32[:, ::1], placement: Placement
):
    """Move samples of triangles of a square to its centre: the middle of the longest edge."""
    s, whole, m, p = block.samples, block.whole, placement.relative_from_model, placement.positions
    for k in range(block.counts[SEGMENTS]):
        segment = block.segments[k]
        owner = np.uintp(segment[OWNER])
        if are_squares[owner] == 0:
            continue
        for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
            face = np.uintp(whole[rows.FACE, r])
            a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
            pa = place(p[a, 0], p[a, 1], p[a, 2], owner, m)
            pb = place(p[b, 0], p[b, 1], p[b, 2], owner, m)
            pc = place(p[c, 0], p[c, 1], p[c, 2], owner, m)
            middle, longest = between(pa, pb)
            other, way = between(pb, pc)
            if way > longest:
                middle, longest = other, way
            other, way = between(pc, pa)
            if way > longest:
                middle, longest = other, way
            for n in range(
                np.uintp(whole[rows.FIRST, r]), np.uintp(whole[rows.FIRST, r + np.uintp(1)])
            ):
                s[rows.POINT_X, n] = np.float32(middle[0])
                s[rows.POINT_Y, n] = np.float32(middle[1])
                s[rows.POINT_Z, n] = np.float32(middle[2])


@disjoint_helper
def decode_row(shown):
    """Decode a row of sRGB's values, 0..1."""
    for i in range(shown.shape[0]):
        bright = power((shown[i] + np.float32(0.055)) * np.float32(1.0 / 1.055), np.float32(2.4))
        dark = shown[i] * np.float32(1.0 / 12.92)
        shown[i] = bright if shown[i] >= np.float32(0.04045) else dark


@stage
def decode_textures(block: Block, count):
    """Decode texture colours, which were filtered as sRGB codes."""
    for k in range(3):
        decode_row(part(block.colors, SHOWN + k, 0, count))


@stage
def show_ambient_on_base(block: Block, count, ambient: float32[::1]):
    """Write the base colour times ambient light."""
    s = block.samples
    for k in range(3):
        for n in range(count):
            s[rows.OUT_RED + k, n] = s[rows.RED + k, n] * ambient[k]


@helper
def mirrored_by(n_l, n_v, n_h, roughness):
    """Return the specular term for F = 1."""
    one = np.float32(1.0)
    k = (roughness + one) * (roughness + one) * np.float32(0.125)
    seen = n_v * n_l / ((n_v * (one - k) + k) * (n_l * (one - k) + k))
    alpha = roughness * roughness
    squared = alpha * alpha
    spread = n_h * n_h * (squared - one) + one
    density = squared * OVER_PI / (spread * spread)
    return seen * density / (np.float32(4.0) * n_l * n_v + SPARE)


@disjoint_helper
def find_facing(nx, ny, nz, roughness, vx, vy, vz, lx, ly, lz):
    """
    Replace a light's direction by the terms of its reflection.

    In turn: n·l; the specular term for F = 1; Schlick's weight (1 - v·h)**5.
    """
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(nx.shape[0]):
        hx, hy, hz = lx[i] + vx[i], ly[i] + vy[i], lz[i] + vz[i]
        scale = unit_scale(hx, hy, hz)
        x, y, z = nx[i], ny[i], nz[i]
        n_l = clamped(x * lx[i] + y * ly[i] + z * lz[i], MIN_COSINE, one)
        n_v = clamped(abs(x * vx[i] + y * vy[i] + z * vz[i]), MIN_COSINE, one)
        n_h = clamped((x * hx + y * hy + z * hz) * scale, zero, one)
        v_h = clamped((vx[i] * hx + vy[i] * hy + vz[i] * hz) * scale, zero, one)
        rest = one - v_h
        squared = rest * rest
        lx[i] = n_l
        ly[i] = mirrored_by(n_l, n_v, n_h, clamped(roughness[i], MIN_ROUGHNESS, one))
        lz[i] = squared * squared * rest


@helper
def sent_on(base, metallic, shine, bent):
    """Return the BRDF of one channel, without n·l."""
    one = np.float32(1.0)
    head_on = DIELECTRIC + metallic * (base - DIELECTRIC)
    mirrored = head_on + (one - head_on) * bent
    inside = base * (one - DIELECTRIC) * (one - metallic)
    return (one - mirrored) * inside * OVER_PI + mirrored * shine


@disjoint_helper
def add_light(
    light, facing, shine, bent, falloff, metallic, reached, red, green, blue, out_red, out_green,
    out_blue,
):  # fmt: skip
    """Add one light's reflection to samples, times its visibility."""
    for i in range(out_red.shape[0]):
        metal = clamped(metallic[i], np.float32(0.0), np.float32(1.0))
        arriving = falloff[i] * facing[i] * reached[i]
        out_red[i] += arriving * light[4] * sent_on(red[i], metal, shine[i], bent[i])
        out_green[i] += arriving * light[5] * sent_on(green[i], metal, shine[i], bent[i])
        out_blue[i] += arriving * light[6] * sent_on(blue[i], metal, shine[i], bent[i])


@helper
def parts_of_three(samples, first, s, e):
    """Return a part of three consecutive rows."""
    return three_parts(samples, first, s, e)


@stage
def add_lights_as_pyrender(
    block: Block, count, lights: float32[:, ::1], first: int64, end: int64, taken: uint8[:, ::1],
    toward_viewer: float32[::1],
):  # fmt: skip
    """Add lights ``first`` to ``end`` to the samples of those objects that take them."""
    samples, single = block.samples, block.single
    points = three_rows(samples, rows.POINT_X, count)
    blinn_phong.find_viewer(toward_viewer, *points, *directions_of(single, VIEWER, count))
    for n in range(first, end):
        blinn_phong.find_light(lights[n], *points, *directions_of(single, LIGHT, count))
        find_facing(
            *three_rows(samples, rows.NORMAL_X, count), part(samples, rows.ROUGHNESS, 0, count),
            *three_rows(single, VIEWER, count), *three_rows(single, LIGHT, count),
        )  # fmt: skip
        k = np.int64(0)
        while k < block.counts[SEGMENTS]:
            stop = owner_end(block, k)
            s, owner = np.int64(block.segments[k, START]), np.uintp(block.segments[k, OWNER])
            e = np.int64(block.segments[stop - 1, STOP])
            k = stop
            if taken[owner, n] != 0:
                add_light(
                    lights[n], *parts_of_three(single, LIGHT, s, e),
                    part(single, LIGHT + 3, s, e), part(samples, rows.METALLIC, s, e),
                    part(samples, rows.SHADOW, s, e), *parts_of_three(samples, rows.RED, s, e),
                    *parts_of_three(samples, rows.OUT_RED, s, e),
                )  # fmt: skip


@helper
def covered_share(depths, across, down, depth):
    """
    Return the shadowed share of 3 x 3 PCF taps around a position.

    Each tap is bilinear. The map repeats.
    """
    one, size = np.float32(1.0), np.int64(depths.shape[0])
    left, low = np.floor(across), np.floor(down)
    x, y = across - left, down - low
    first, row = np.int64(np.int32(left)) - 1, np.int64(np.int32(low)) - 1
    total = np.float32(0.0)
    for j in range(4):
        line = np.uintp((row + j) & (size - 1))
        weight = one if 0 < j < 3 else (y if j == 3 else one - y)
        found = np.float32(0.0)
        for i in range(4):
            share = one if 0 < i < 3 else (x if i == 3 else one - x)
            is_behind = depth > depths[line, np.uintp((first + i) & (size - 1))]
            found += share if is_behind else np.float32(0.0)
        total += weight * found
    return total * np.float32(1.0 / 9.0)


@stage
def find_shadow(
    block: Block, count, light: float32[::1], view: float32[::1], depths: float32[:, ::1]
):
    """
    Write the visibility of a light at each sample, by its shadow map.

    Parameters
    ----------
    block : Block
    light : (13,) float32
        As ``Lighting.lights`` has it.
    view : (20,) float32
        ``survey.light_culling.view_of_light``.
    depths : (S, S) float32
        As ``DepthMap`` has them.
    """
    s, zero, one, half = block.samples, np.float32(0.0), np.float32(1.0), np.float32(0.5)
    size = np.float32(depths.shape[0])
    for n in range(count):
        x, y, z = s[rows.POINT_X, n], s[rows.POINT_Y, n], s[rows.POINT_Z, n]
        w = view[12] * x + view[13] * y + view[14] * z + view[15]
        inverse = one / w
        across = (view[0] * x + view[1] * y + view[2] * z + view[3]) * inverse
        down = (view[4] * x + view[5] * y + view[6] * z + view[7]) * inverse
        place = (view[8] * x + view[9] * y + view[10] * z + view[11]) * inverse
        lx, ly, lz = light[0] - light[3] * x, light[1] - light[3] * y, light[2] - light[3] * z
        facing = s[rows.NORMAL_X, n] * lx + s[rows.NORMAL_Y, n] * ly + s[rows.NORMAL_Z, n] * lz
        facing = clamped(facing * unit_scale(lx, ly, lz), zero, one)
        # The bias; the map has window coordinates there.
        bias = max(np.float32(0.001) * (one - facing), np.float32(0.0001)) * inverse
        held = place - (bias + bias)
        depth = (view[16] - view[17] * held) / (view[18] - view[19] * held)
        # Far outside, the position does not matter.
        u = clamped(across * half + half, -FARTHEST, FARTHEST) * size + half
        v = clamped(down * half + half, -FARTHEST, FARTHEST) * size + half
        covered = covered_share(depths, u, v, depth)
        s[rows.SHADOW, n] = one - (covered if place <= one else zero)


@stage
def let_all_through(block: Block, count):
    """Write visibility 1 of the next light."""
    for n in range(count):
        block.samples[rows.SHADOW, n] = np.float32(1.0)


@stage
def dim_by_occlusion(block: Block, count):
    """Multiply the sum of light by occlusion."""
    s = block.samples
    for k in range(3):
        for n in range(count):
            s[rows.OUT_RED + k, n] *= s[rows.OCCLUSION, n]


@stage
def brighten(block: Block, count, gains: float32[:, ::1], first: int64, row: int64):
    """Multiply three rows by factors of each object, which stand from column ``first`` on."""
    s = block.samples
    for k in range(block.counts[SEGMENTS]):
        segment = block.segments[k]
        owner = np.uintp(segment[OWNER])
        for channel in range(3):
            gain = gains[owner, np.uintp(first + channel)]
            for n in range(segment[START], segment[STOP]):
                s[np.uintp(row + channel), n] *= gain


@stage
def multiply_by_vertex_colors(block: Block, count):
    """Multiply the final colours by the vertex colours."""
    s = block.samples
    for k in range(3):
        for n in range(count):
            s[rows.OUT_RED + k, n] *= s[COLOR_RED + k, n]
