"""
Shade transmission: look up the opaque pass where the refracted ray leads.

Of the light that is not reflected, ``transmission`` is the share that passes, tinted by the base
colour; the rest is diffuse. The background is the opaque pass in linear light [1]_: at the same
pixel for thin walls, else where the ray, refracted by Snell's law, leaves the volume after its
thickness [2]_. Beer's law attenuates light in a volume.

Rough surfaces blur the background: the picture is halved repeatedly, by the weights 1, 3, 3, 1 over
8 in both directions, and a level is chosen by roughness and index of refraction, as the sample
implementation of glTF does. Lookups interpolate between two levels, and four texels of each.

References
----------
.. [1] The Khronos Group, "KHR_materials_transmission", "Implementation notes".
.. [2] The Khronos Group, "KHR_materials_volume" and the sample implementation of both in
   "glTF-Sample-Renderer".
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.lighting.light_stages import read_interval
from rasterjit.pipeline.lighting.pbr import approximate_env_brdf, scattering_albedos
from rasterjit.pipeline.records import ATTENUATION_COLOR, F0, F90, INVERSE_DISTANCE, IOR
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.layer_rows import FOG_RED
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.float_math import clamped, log2, power
from rasterjit.runtime.jit import helper, kernel, stage
from rasterjit.runtime.state_block import float32, float64, int64

FIRST_TEXEL, WIDTH, HEIGHT = 0, 1, 2
"""Columns of ``levels``."""

RIGHT, DOWN = 0, 1
"""Rows of ``doubles``: offset of a sample's lookup from its pixel, pixels."""

LEVEL = 0
"""Row of ``floats``: mip level of the lookup."""

MAX_OFFSET = 1e6
"""Largest offset, pixels: beyond the edges of any picture."""


@stage
def remove_transmitted(block: Block, count, amount: float32):
    """
    Remove transmitted light from the base colour, and write its tint.

    Parameters
    ----------
    block : Block
        Reads rows TRANSMISSION and MICROFACET; changes rows RED.., the factor of all
        reflected light, and METALLIC, so that metal reflects as much as before. Writes rows
        TINT...
    count : int
    amount : float32
        Factor on transmission: 1, or 0 to transmit nothing.
    """
    s = block.samples
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(count):
        # A metal transmits nothing; its base colour tints reflections.
        metal = clamped(s[rows.METALLIC, i], zero, one)
        transmitted = s[rows.TRANSMISSION, i] * (one - metal)
        transmitted = amount * clamped(transmitted * s[rows.MICROFACET, i], zero, one)
        if transmitted > zero:
            s[rows.METALLIC, i] = metal / max(one - transmitted, metal) if metal > zero else zero
        for k in range(3):
            base = s[rows.RED + k, i]
            s[rows.TINT_RED + k, i] = transmitted * base
            s[rows.RED + k, i] = base * (one - transmitted)


@helper
def project_point(x, y, z, clip, width, height):
    """Project a point relative to the eye to pixels and w; a w up to 0 is not visible."""
    w = clip[3, 0] * x + clip[3, 1] * y + clip[3, 2] * z + clip[3, 3]
    scale = 1.0 / w if w > 0.0 else 0.0
    ndc_x = (clip[0, 0] * x + clip[0, 1] * y + clip[0, 2] * z + clip[0, 3]) * scale
    ndc_y = (clip[1, 0] * x + clip[1, 1] * y + clip[1, 2] * z + clip[1, 3]) * scale
    return 0.5 * ndc_x * width, -0.5 * ndc_y * height, w


@helper
def refract(normal, viewer, ior):
    """
    Return the unit direction of the refracted ray behind a surface.

    The normal and the direction to the viewer are of unit length; with an index of refraction of 0
    the ray goes straight on.
    """
    nx, ny, nz = normal
    vx, vy, vz = viewer
    facing = nx * vx + ny * vy + nz * vz
    eta = 1.0 / ior if ior > 0.0 else 1.0
    rest = 1.0 - eta * eta * (1.0 - facing * facing)
    along = eta * facing - np.sqrt(rest if rest > 0.0 else 0.0)
    is_bent = (eta != 1.0) & (facing > 0.0)
    x, y, z = along * nx - eta * vx, along * ny - eta * vy, along * nz - eta * vz
    return x if is_bent else -vx, y if is_bent else -vy, z if is_bent else -vz


@helper
def normalize(x, y, z):
    """Return a direction of unit length; zero for the zero vector."""
    length = np.sqrt(x * x + y * y + z * z)
    scale = 1.0 / length if length > 0.0 else 0.0
    return x * scale, y * scale, z * scale


@helper
def find_lookup(block, i, factors, owner, scale, clip, size, viewer, width_levels):
    """Write offset and mip level of the lookup of sample ``i``, and scale its tint."""
    s = block.samples
    zero, one = np.float32(0.0), np.float32(1.0)
    px, py, pz = (
        np.float64(s[rows.POINT_X, i]), np.float64(s[rows.POINT_Y, i]),
        np.float64(s[rows.POINT_Z, i]),
    )  # fmt: skip
    toward = normalize(
        np.float64(viewer[0]) - np.float64(viewer[3]) * px,
        np.float64(viewer[1]) - np.float64(viewer[3]) * py,
        np.float64(viewer[2]) - np.float64(viewer[3]) * pz,
    )
    normal = normalize(
        np.float64(s[rows.NORMAL_X, i]), np.float64(s[rows.NORMAL_Y, i]),
        np.float64(s[rows.NORMAL_Z, i]),
    )  # fmt: skip

    # Trace the refracted ray through the volume to the screen.
    ior = np.float64(factors[owner, IOR])
    length = np.float64(s[rows.THICKNESS, i]) * scale
    right, down = 0.0, 0.0
    if length > 0.0 and ior != 1.0:
        dx, dy, dz = refract(normal, toward, ior)
        x0, y0, w0 = project_point(px, py, pz, clip, size[0], size[1])
        x1, y1, w1 = project_point(
            px + length * dx, py + length * dy, pz + length * dz, clip, size[0], size[1]
        )
        is_seen = (w0 > 0.0) & (w1 > 0.0)
        right = clamped(x1 - x0, -MAX_OFFSET, MAX_OFFSET) if is_seen else 0.0
        down = clamped(y1 - y0, -MAX_OFFSET, MAX_OFFSET) if is_seen else 0.0
    block.doubles[RIGHT, i], block.doubles[DOWN, i] = right, down

    # Choose the level, and tint by transmittance.
    rough = clamped(s[rows.ROUGHNESS, i], zero, one)
    bending = clamped(np.float32(2.0 * ior - 2.0), zero, one)
    block.floats[LEVEL, i] = width_levels * rough * bending
    facing = normal[0] * toward[0] + normal[1] * toward[1] + normal[2] * toward[2]
    brdf = approximate_env_brdf(clamped(np.float32(facing), zero, one), rough)
    single, multiple = scattering_albedos(factors[owner, F0], brdf)
    transmitted = clamped(one - factors[owner, F90] * (single + multiple), zero, one)
    distance = np.float32(length) * factors[owner, INVERSE_DISTANCE]
    for k in range(3):
        tint = (
            attenuate(factors[owner, ATTENUATION_COLOR + k], distance) if distance > zero else one
        )
        s[rows.TINT_RED + k, i] *= transmitted * tint


@helper
def attenuate(base, exponent):
    """Return the transmittance of a volume by Beer's law."""
    return np.float32(1.0) if base >= np.float32(1.0) else power(base, exponent)


@helper
def find_texels(levels, level, x, y):
    """Return the four texels of a level around a point, and their bilinear weights."""
    first, width, height = levels[level, FIRST_TEXEL], levels[level, WIDTH], levels[level, HEIGHT]
    x, y = clamped(x - 0.5, 0.0, width - 1.0), clamped(y - 0.5, 0.0, height - 1.0)
    left, top = np.int64(x), np.int64(y)
    right, below = min(left + 1, width - 1), min(top + 1, height - 1)
    upper, lower = first + top * width, first + below * width
    return (
        np.uintp(upper + left), np.uintp(upper + right), np.uintp(lower + left),
        np.uintp(lower + right), np.float32(x - left), np.float32(y - top),
    )  # fmt: skip


@helper
def interpolate(texels, corners, k):
    """Interpolate one channel of four texels bilinearly."""
    a, b, c, d, across, down = corners
    upper = texels[a, k] + across * (texels[b, k] - texels[a, k])
    lower = texels[c, k] + across * (texels[d, k] - texels[c, k])
    return upper + down * (lower - upper)


@helper
def add_background(block, i, column, row, texels, levels):
    """Add the tinted background at the lookup of sample ``i``, in a pixel."""
    s = block.samples
    last = np.float32(levels.shape[0] - 1)
    level = clamped(block.floats[LEVEL, i], np.float32(0.0), last)
    finer = np.int64(level)
    fraction, coarser = level - np.float32(finer), min(finer + 1, levels.shape[0] - 1)
    # Texels of a level lie twice as far apart as those of the finer one.
    step = 1.0 / np.float64(np.int64(1) << finer)
    x = (column + 0.5 + block.doubles[RIGHT, i]) * step
    y = (row + 0.5 + block.doubles[DOWN, i]) * step
    near, far = (
        find_texels(levels, finer, x, y), find_texels(levels, coarser, 0.5 * x, 0.5 * y)
    )  # fmt: skip
    for k in range(3):
        light = interpolate(texels, near, k)
        if fraction > np.float32(0.0):
            light += fraction * (interpolate(texels, far, k) - light)
        light = max(np.float32(0.0), light - s[FOG_RED + k, i])
        s[rows.OUT_RED + k, i] += s[rows.TINT_RED + k, i] * light


@helper
def has_tint(s, n):
    """Return whether a sample transmits any light."""
    red, green, blue = s[rows.TINT_RED, n], s[rows.TINT_RED + 1, n], s[rows.TINT_RED + 2, n]
    return red + green + blue > np.float32(0.0)


@stage
def transmit(
    block: Block, count, texels: float32[:, ::1], levels: int64[:, ::1], factors: float32[:, ::1],
    scales: float64[::1], clip: float64[:, ::1], size: float64[::1], corner: int64[::1],
    toward_viewer: float32[::1],
):  # fmt: skip
    """
    Add the transmitted background to samples.

    Parameters
    ----------
    block : Block
        Reads rows NORMAL_X.., POINT_X.., ROUGHNESS, TINT_RED.., THICKNESS and FOG_RED..; adds to
        rows OUT_RED...
    count : int
    texels : (N, 3) float32, linear RGB
        The opaque pass, level by level, row by row.
    levels : (M, 3) int64
        First texel, width and height of each level.
    factors : (O, 7) float32
        ``TransmissionRows.factors``.
    scales : (O,) float64
        Units of the world in one of each object.
    clip : (4, 4) float64
        To clip space from world axes with the origin at the eye.
    size : (2,) float64
        Width and height of the whole picture, pixels.
    corner : (2,) int64
        Column and row of the first pixel that is drawn.
    toward_viewer : (4,) float32
        A point p, relative to the eye, is seen along ``xyz - w p``.
    """
    s = block.samples
    width_levels = log2(np.float32(size[0]))
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        for n in range(np.uintp(segment[rows.START]), np.uintp(segment[rows.STOP])):
            if has_tint(s, n):
                find_lookup(
                    block, n, factors, owner, scales[owner], clip, size, toward_viewer, width_levels
                )
    for k in range(block.counts[rows.INTERVAL_COUNT]):
        _, column, start, stop = read_interval(block, k)
        row = np.int64(block.intervals[k, rows.INTERVAL_FRAME_ROW]) + corner[1]
        for n in range(start, stop):
            if has_tint(s, n):
                add_background(block, n, column + corner[0] + n - start, row, texels, levels)


@kernel
def downsample(
    texels: float32[:, ::1], levels: int64[:, ::1], level: int64, row_range: (int64, int64),
    scratch_row: float32[:, ::1],
):  # fmt: skip
    """
    Filter some rows of a mip level from those of the finer one.

    Parameters
    ----------
    texels : (N, 3) float32
        Writes these rows of the level.
    levels : (M, 3) int64
    level : int
        1 or more.
    row_range : (int, int)
        The first row, and one past the last.
    scratch_row : (W, 3) float32
        This thread's own, as wide as the finer level.
    """
    source, width, height = (
        levels[level - 1, FIRST_TEXEL], levels[level - 1, WIDTH], levels[level - 1, HEIGHT]
    )  # fmt: skip
    target, target_width = levels[level, FIRST_TEXEL], levels[level, WIDTH]
    eighth, three = np.float32(0.125), np.float32(3.0)
    for row in range(row_range[0], row_range[1]):
        y = 2 * row
        top, bottom = max(y - 1, 0), min(y + 2, height - 1)
        middle = min(y + 1, height - 1)
        for x in range(width):
            for k in range(3):
                outer = texels[source + top * width + x, k]
                outer += texels[source + bottom * width + x, k]
                inner = texels[source + y * width + x, k]
                inner += texels[source + middle * width + x, k]
                scratch_row[x, k] = eighth * (outer + three * inner)
        for column in range(target_width):
            x = 2 * column
            left, right = max(x - 1, 0), min(x + 2, width - 1)
            between = min(x + 1, width - 1)
            for k in range(3):
                outer = scratch_row[left, k] + scratch_row[right, k]
                inner = scratch_row[x, k] + scratch_row[between, k]
                texels[target + row * target_width + column, k] = eighth * (outer + three * inner)
