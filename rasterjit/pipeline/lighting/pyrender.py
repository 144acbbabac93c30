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

from rasterjit.pipeline.geometry.barycentric import transform_point
from rasterjit.pipeline.lighting import blinn_phong
from rasterjit.pipeline.lighting.blinn_phong import invert_length
from rasterjit.pipeline.lighting.light_stages import LIGHT_DIR, VIEW_DIR
from rasterjit.pipeline.records import Placement
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.attributes import find_object_end
from rasterjit.pipeline.surface.gather_samples import four_parts, get_patch_samples
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.pipeline.surface.texture_lookup import TEXTURE_RED
from rasterjit.runtime.float_math import clamped, power
from rasterjit.runtime.intrinsics import part, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int32, int64, uint8

VERTEX_COLOR_RED = rows.TINT_RED
"""Rows, three: vertex colours. They reuse the rows of transmission, which this model lacks."""

MIN_COSINE = np.float32(0.001)
MIN_ROUGHNESS = np.float32(0.04)
DIELECTRIC_F0 = np.float32(0.04)
DENOMINATOR_BIAS = np.float32(0.001)
"""Constant added to the denominator of the specular term."""
MAX_MAP_SIZES_OUTSIDE = np.float32(64.0)
"""Largest distance outside a shadow map, in map sizes; positions are clamped to it."""
INVERSE_PI = np.float32(1.0 / math.pi)


@stage
def point_normals_at_viewer(
    block: Block, count, faces_viewer: uint8[::1], toward_viewer: float32[::1]
):
    """Replace the normals of some objects by the directions to the viewer."""
    s = block.samples
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        if faces_viewer[np.uintp(segment[rows.OWNER])] == 0:
            continue
        for n in range(segment[rows.START], segment[rows.STOP]):
            for axis in range(3):
                s[rows.NORMAL_X + axis, n] = (
                    toward_viewer[axis] - toward_viewer[3] * s[rows.POINT_X + axis, n]
                )


@helper
def measure_edge(a, b):
    """Return the midpoint of an edge, and its squared length."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    middle = a[0] + 0.5 * x, a[1] + 0.5 * y, a[2] + 0.5 * z
    return middle, x * x + y * y + z * z


@stage
def move_to_square_centers(
    block: Block, count, are_squares: uint8[::1], faces: int32[:, ::1], placement: Placement
):
    """Move samples of a square's triangles to its centre, the midpoint of the longest edge."""
    s, ints, m, p = block.samples, block.ints, placement.relative_from_model, placement.positions
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        if are_squares[owner] == 0:
            continue
        for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
            face = np.uintp(ints[rows.FACE, r])
            a, b, c = np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])
            pa = transform_point(p[a, 0], p[a, 1], p[a, 2], owner, m)
            pb = transform_point(p[b, 0], p[b, 1], p[b, 2], owner, m)
            pc = transform_point(p[c, 0], p[c, 1], p[c, 2], owner, m)
            longest_center, longest_squared = measure_edge(pa, pb)
            center, squared = measure_edge(pb, pc)
            if squared > longest_squared:
                longest_center, longest_squared = center, squared
            center, squared = measure_edge(pc, pa)
            if squared > longest_squared:
                longest_center, longest_squared = center, squared
            start, end = get_patch_samples(ints, r)
            for n in range(start, end):
                s[rows.POINT_X, n] = np.float32(longest_center[0])
                s[rows.POINT_Y, n] = np.float32(longest_center[1])
                s[rows.POINT_Z, n] = np.float32(longest_center[2])


@disjoint_helper
def decode_srgb(codes):
    """Decode a row of sRGB codes, 0..1, to linear light."""
    for i in range(codes.shape[0]):
        curved = power((codes[i] + np.float32(0.055)) * np.float32(1.0 / 1.055), np.float32(2.4))
        linear = codes[i] * np.float32(1.0 / 12.92)
        codes[i] = curved if codes[i] >= np.float32(0.04045) else linear


@stage
def decode_textures(block: Block, count):
    """Decode texture colours, which were filtered as sRGB codes."""
    for k in range(3):
        decode_srgb(part(block.colors, TEXTURE_RED + k, 0, count))


@stage
def write_ambient_on_base(block: Block, count, ambient: float32[::1]):
    """Write the base colour times ambient light."""
    s = block.samples
    for k in range(3):
        for n in range(count):
            s[rows.OUT_RED + k, n] = s[rows.RED + k, n] * ambient[k]


@helper
def compute_specular_term(n_l, n_v, n_h, roughness):
    """Return the specular term for F = 1."""
    one = np.float32(1.0)
    k = (roughness + one) * (roughness + one) * np.float32(0.125)
    visibility = n_v * n_l / ((n_v * (one - k) + k) * (n_l * (one - k) + k))
    alpha = roughness * roughness
    squared = alpha * alpha
    denominator = n_h * n_h * (squared - one) + one
    density = squared * INVERSE_PI / (denominator * denominator)
    return visibility * density / (np.float32(4.0) * n_l * n_v + DENOMINATOR_BIAS)


@disjoint_helper
def find_reflection_terms(nx, ny, nz, roughness, vx, vy, vz, lx, ly, lz):
    """
    Overwrite directions to a light by the terms of its reflection.

    In order: n·l; the specular term for F = 1; Schlick's weight (1 - v·h)**5.
    """
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(nx.shape[0]):
        hx, hy, hz = lx[i] + vx[i], ly[i] + vy[i], lz[i] + vz[i]
        scale = invert_length(hx, hy, hz)
        x, y, z = nx[i], ny[i], nz[i]
        n_l = clamped(x * lx[i] + y * ly[i] + z * lz[i], MIN_COSINE, one)
        n_v = clamped(abs(x * vx[i] + y * vy[i] + z * vz[i]), MIN_COSINE, one)
        n_h = clamped((x * hx + y * hy + z * hz) * scale, zero, one)
        v_h = clamped((vx[i] * hx + vy[i] * hy + vz[i] * hz) * scale, zero, one)
        rest = one - v_h
        squared = rest * rest
        lx[i] = n_l
        ly[i] = compute_specular_term(n_l, n_v, n_h, clamped(roughness[i], MIN_ROUGHNESS, one))
        lz[i] = squared * squared * rest


@helper
def evaluate_brdf_channel(base, metallic, specular, schlick):
    """Return a channel of the BRDF, without n·l."""
    one = np.float32(1.0)
    f0 = DIELECTRIC_F0 + metallic * (base - DIELECTRIC_F0)
    fresnel = f0 + (one - f0) * schlick
    diffuse = base * (one - DIELECTRIC_F0) * (one - metallic)
    return (one - fresnel) * diffuse * INVERSE_PI + fresnel * specular


@disjoint_helper
def add_light(
    light, n_l, specular, schlick, falloff, metallic, visibility, red, green, blue, out_red,
    out_green, out_blue,
):  # fmt: skip
    """Add one light's reflection to samples, times its visibility."""
    for i in range(out_red.shape[0]):
        metal = clamped(metallic[i], np.float32(0.0), np.float32(1.0))
        weight = falloff[i] * n_l[i] * visibility[i]
        out_red[i] += (
            weight * light[4] * evaluate_brdf_channel(red[i], metal, specular[i], schlick[i])
        )
        out_green[i] += (
            weight * light[5] * evaluate_brdf_channel(green[i], metal, specular[i], schlick[i])
        )
        out_blue[i] += (
            weight * light[6] * evaluate_brdf_channel(blue[i], metal, specular[i], schlick[i])
        )


@stage
def add_lights_as_pyrender(
    block: Block, count, lights: float32[:, ::1], first: int64, end: int64, falls_on: uint8[:, ::1],
    toward_viewer: float32[::1],
):  # fmt: skip
    """Add lights ``first`` to ``end``, each to the samples of the objects it falls on."""
    samples, floats = block.samples, block.floats
    points = three_parts(samples, rows.POINT_X, 0, count)
    blinn_phong.find_view_directions(
        toward_viewer, *points, *four_parts(floats, VIEW_DIR, 0, count)
    )
    for n in range(first, end):
        blinn_phong.find_light_directions(
            lights[n], *points, *four_parts(floats, LIGHT_DIR, 0, count)
        )
        find_reflection_terms(
            *three_parts(samples, rows.NORMAL_X, 0, count), part(samples, rows.ROUGHNESS, 0, count),
            *three_parts(floats, VIEW_DIR, 0, count), *three_parts(floats, LIGHT_DIR, 0, count),
        )  # fmt: skip
        k = np.int64(0)
        while k < block.counts[rows.SEGMENT_COUNT]:
            stop = find_object_end(block, k)
            s = np.int64(block.segments[k, rows.START])
            owner = np.uintp(block.segments[k, rows.OWNER])
            e = np.int64(block.segments[stop - 1, rows.STOP])
            k = stop
            if falls_on[owner, n] != 0:
                add_light(
                    lights[n], *three_parts(floats, LIGHT_DIR, s, e),
                    part(floats, LIGHT_DIR + 3, s, e), part(samples, rows.METALLIC, s, e),
                    part(samples, rows.SHADOW, s, e), *three_parts(samples, rows.RED, s, e),
                    *three_parts(samples, rows.OUT_RED, s, e),
                )  # fmt: skip


@helper
def filter_shadow(depths, u, v, depth):
    """
    Return the shadowed share of 3 x 3 bilinear PCF taps around a position.

    The map repeats.
    """
    one, size = np.float32(1.0), np.int64(depths.shape[0])
    first_u, first_v = np.floor(u), np.floor(v)
    fraction_u, fraction_v = u - first_u, v - first_v
    first_column, first_row = np.int64(np.int32(first_u)) - 1, np.int64(np.int32(first_v)) - 1
    total = np.float32(0.0)
    for j in range(4):
        texel_row = np.uintp((first_row + j) & (size - 1))
        weight_v = one if 0 < j < 3 else (fraction_v if j == 3 else one - fraction_v)
        row_total = np.float32(0.0)
        for i in range(4):
            weight_u = one if 0 < i < 3 else (fraction_u if i == 3 else one - fraction_u)
            is_behind = depth > depths[texel_row, np.uintp((first_column + i) & (size - 1))]
            row_total += weight_u if is_behind else np.float32(0.0)
        total += weight_v * row_total
    return total * np.float32(1.0 / 9.0)


@stage
def read_shadow_map(
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
        From ``survey.light_culling.pack_light_view``.
    depths : (S, S) float32
        As in ``DepthMap``.
    """
    s, zero, one, half = block.samples, np.float32(0.0), np.float32(1.0), np.float32(0.5)
    size = np.float32(depths.shape[0])
    for n in range(count):
        x, y, z = s[rows.POINT_X, n], s[rows.POINT_Y, n], s[rows.POINT_Z, n]
        w = view[12] * x + view[13] * y + view[14] * z + view[15]
        inverse = one / w
        ndc_x = (view[0] * x + view[1] * y + view[2] * z + view[3]) * inverse
        ndc_y = (view[4] * x + view[5] * y + view[6] * z + view[7]) * inverse
        window_z = (view[8] * x + view[9] * y + view[10] * z + view[11]) * inverse
        lx, ly, lz = light[0] - light[3] * x, light[1] - light[3] * y, light[2] - light[3] * z
        n_l = s[rows.NORMAL_X, n] * lx + s[rows.NORMAL_Y, n] * ly + s[rows.NORMAL_Z, n] * lz
        n_l = clamped(n_l * invert_length(lx, ly, lz), zero, one)
        # The bias; the map has window coordinates there.
        bias = max(np.float32(0.001) * (one - n_l), np.float32(0.0001)) * inverse
        biased = window_z - (bias + bias)
        depth = (view[16] - view[17] * biased) / (view[18] - view[19] * biased)
        # Far outside, the position does not matter.
        u = (
            clamped(ndc_x * half + half, -MAX_MAP_SIZES_OUTSIDE, MAX_MAP_SIZES_OUTSIDE) * size
            + half
        )
        v = (
            clamped(ndc_y * half + half, -MAX_MAP_SIZES_OUTSIDE, MAX_MAP_SIZES_OUTSIDE) * size
            + half
        )
        shadow = filter_shadow(depths, u, v, depth)
        s[rows.SHADOW, n] = one - (shadow if window_z <= one else zero)


@stage
def multiply_by_occlusion(block: Block, count):
    """Multiply the sum of light by occlusion."""
    s = block.samples
    for k in range(3):
        for n in range(count):
            s[rows.OUT_RED + k, n] *= s[rows.OCCLUSION, n]


@stage
def multiply_by_gains(block: Block, count, gains: float32[:, ::1], first: int64, row: int64):
    """Multiply three rows, from ``row`` on, by each object's factors, from column ``first`` on."""
    s = block.samples
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        for channel in range(3):
            gain = gains[owner, np.uintp(first + channel)]
            for n in range(segment[rows.START], segment[rows.STOP]):
                s[np.uintp(row + channel), n] *= gain


@stage
def multiply_by_vertex_colors(block: Block, count):
    """Multiply the final colours by the vertex colours."""
    s = block.samples
    for k in range(3):
        for n in range(count):
            s[rows.OUT_RED + k, n] *= s[VERTEX_COLOR_RED + k, n]
