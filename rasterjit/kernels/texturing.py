"""
Look up textures: place the sample on the picture, move, wrap, filter, choose the mip level.

Coordinate u runs right and v up. They are reduced to one period in float64 before they are scaled
to texels, so nothing is lost far from 0 but what float32 coordinates have lost already. Texels lie
row by row from the top of the picture, as linear RGBA.

The level of detail is ``log2 rho``; rho is the longer of the two steps on the picture, in texels,
that one pixel to the right and one pixel down make. They are the exact derivatives of the
perspective-correct coordinates at the pixel's centre: with weights ``W_k / sum W`` whose parts are
linear on the screen, ``u = sum W_k u_k / sum W`` has the derivative ``sum W_k' (u_k - u) / sum W``.
Where a texture is moved, turned or scaled, so are the steps.

Anisotropic filtering divides the footprint of a pixel along its longer step. With the lengths of
both steps, the shorter counted as one texel at least, and ``parts = min(longer / shorter,
anisotropy)``, the level of detail is ``log2 (longer / parts)``, and ``N = ceil(parts)`` trilinear
taps lie along the longer step, at ``i / (N + 1) - 1/2`` of it for i in 1..N [3]_. Their mean is
found one by one, so that equal taps give exactly theirs. One tap is the trilinear filter, bit for
bit.

References
----------
.. [1] L. Williams, "Pyramidal Parametrics", SIGGRAPH 1983.
.. [2] The Khronos Group, "Vulkan 1.4 Specification", section 16.5.8, "Level of Detail Operation".
.. [3] The Khronos Group, "EXT_texture_filter_anisotropic", and section 16.6.1 of [2]_, "Texel
   Anisotropic Filtering".
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import stage
from rasterjit.kernels.lighting import log2
from rasterjit.kernels.setup import CLIPPED, edge

BASE_COLOR, NORMAL, METALLIC_ROUGHNESS, OCCLUSION, EMISSIVE = 0, 1, 2, 3, 4
"""What a texture is for, as ``Textures.table`` numbers it."""
KINDS = 5

REPEAT, CLAMP, MIRROR = 0, 1, 2
"""What lies outside the picture, as ``Textures.table`` numbers it."""

NEAREST, BILINEAR, TRILINEAR = 0, 1, 2
"""Filters, as ``Textures.table`` numbers them."""

FIRST_LEVEL, LEVEL_COUNT, WRAP_U, WRAP_V, FILTER, ANISOTROPY = 0, 1, 2, 3, 4, 5
"""Columns of ``Textures.table``."""
TABLE_COLUMNS = 6

FIRST_TEXEL, LEVEL_WIDTH, LEVEL_HEIGHT = 0, 1, 2
"""Columns of ``Textures.levels``."""

TEXEL_STEPS = 2.0**24
"""
Positions are rounded to 1/TEXEL_STEPS texel.

So fine a step fits float32 weights exactly, and is far above the rounding errors of interpolated
coordinates: a sample on the middle of a texel shows that texel alone, one on a border is on it.
"""

LARGEST_STEP_SQUARED = 1e30
"""Squared texels a pixel: beyond the coarsest level of any texture, and finite in float32."""


@stage
def wrap_index(i, size, wrap):
    """Return the texel, 0..size-1, that stands at any whole number along an axis."""
    if 0 <= i < size:
        return i
    if wrap == CLAMP:
        return np.int64(0) if i < 0 else size - 1
    if wrap == REPEAT:
        return i % size
    turned = i % (2 * size)
    return min(turned, 2 * size - 1 - turned)


@stage
def texel_position(u, size, wrap):
    """
    Return where a coordinate lies along an axis, in texels, within about one period.

    The middle of texel 0 stands for NaN and infinity.
    """
    if not abs(u) < np.inf:
        return 0.5
    if wrap == CLAMP:
        reduced = min(max(u, 0.0), 1.0)
    elif wrap == REPEAT:
        reduced = u - np.floor(u)
    else:
        reduced = 2.0 * (0.5 * u - np.floor(0.5 * u))
    return np.floor(reduced * size * TEXEL_STEPS + 0.5) / TEXEL_STEPS


@stage
def texel_number(level, column, row):
    """Return a texel's number; rows count from the bottom here, and only here are turned."""
    first, width, height = level
    return first + (height - 1 - row) * width + column


@stage
def nearest_texel(level, u, v, wraps):
    """Return the texel that holds a coordinate; a border is part of the one right or above."""
    _, width, height = level
    x, y = texel_position(u, width, wraps[0]), texel_position(v, height, wraps[1])
    column = wrap_index(np.int64(np.floor(x)), width, wraps[0])
    row = wrap_index(np.int64(np.floor(y)), height, wraps[1])
    return texel_number(level, column, row)


@stage
def surrounding_texels(level, u, v, wraps):
    """Return the four texels around a coordinate, lower left first, and its shares right and up."""
    _, width, height = level
    x = texel_position(u, width, wraps[0]) - 0.5
    y = texel_position(v, height, wraps[1]) - 0.5
    left, low = np.floor(x), np.floor(y)
    column0 = wrap_index(np.int64(left), width, wraps[0])
    column1 = wrap_index(np.int64(left) + 1, width, wraps[0])
    row0 = wrap_index(np.int64(low), height, wraps[1])
    row1 = wrap_index(np.int64(low) + 1, height, wraps[1])
    return (
        texel_number(level, column0, row0),
        texel_number(level, column1, row0),
        texel_number(level, column0, row1),
        texel_number(level, column1, row1),
        np.float32(x - left),
        np.float32(y - low),
    )


@stage
def mix(one, other, share):
    """Return the colour between two; equal ones give exactly themselves."""
    return (
        one[0] + share * (other[0] - one[0]),
        one[1] + share * (other[1] - one[1]),
        one[2] + share * (other[2] - one[2]),
        one[3] + share * (other[3] - one[3]),
    )


@stage
def texel(texels, n):
    """Return one texel, linear RGBA."""
    return texels[n, 0], texels[n, 1], texels[n, 2], texels[n, 3]


@stage
def mix_texels(texels, taps):
    """Return the bilinear mix of `surrounding_texels`."""
    lower = mix(texel(texels, taps[0]), texel(texels, taps[1]), taps[4])
    upper = mix(texel(texels, taps[2]), texel(texels, taps[3]), taps[4])
    return mix(lower, upper, taps[5])


@stage
def level_at(levels, n):
    """Return first texel, width and height of a level."""
    return levels[n, FIRST_TEXEL], levels[n, LEVEL_WIDTH], levels[n, LEVEL_HEIGHT]


@stage
def snapped_slopes(at, ws, column, row, bits):
    """
    Return how the weights of a face that was not clipped change at a pixel, over their sum.

    Takes the vertices' positions on the sub-pixel grid and their w. See `weight_slopes`.
    """
    (ax, ay), (bx, by), (cx, cy) = at
    half = np.int64(1) << (bits - 1)
    px, py = (np.int64(column) << bits) + half, (np.int64(row) << bits) + half
    smallest = min(ws[0], min(ws[1], ws[2]))
    p, q, r = smallest / ws[0], smallest / ws[1], smallest / ws[2]
    total = (
        np.float64(edge(bx, by, cx, cy, px, py)) * p
        + np.float64(edge(cx, cy, ax, ay, px, py)) * q
        + np.float64(edge(ax, ay, bx, by, px, py)) * r
    )
    return scaled_slopes(
        np.float64(np.int64(1) << bits) / total,
        (p, q, r),
        (np.float64(by - cy), np.float64(cy - ay), np.float64(ay - by)),
        (np.float64(cx - bx), np.float64(ax - cx), np.float64(bx - ax)),
    )


@stage
def scaled_slopes(per_sum, ratios, across, down):
    """
    Return the slopes of weights whose edge functions gain so much by a pixel right and down.

    Takes one over the weights' sum, in the unit of the gains, and the smallest w over each.
    """
    p, q, r = ratios[0] * per_sum, ratios[1] * per_sum, ratios[2] * per_sum
    return (
        (p * across[0], q * across[1], r * across[2]),
        (p * down[0], q * down[1], r * down[2]),
    )


@stage
def clipped_slopes(at, ws, column, row, width, height):
    """
    Return how the weights of a clipped face change at a pixel, over their sum.

    Takes the vertices' clip positions x, y and their w. See `weight_slopes`.
    """
    x, y = (2.0 * column + 1.0) / width - 1.0, 1.0 - (2.0 * row + 1.0) / height
    (ax, ay), (bx, by), (cx, cy) = at
    wa, wb, wc = ws
    ax, bx, cx = ax - x * wa, bx - x * wb, cx - x * wc
    ay, by, cy = ay - y * wa, by - y * wb, cy - y * wc
    total = (bx * cy - cx * by) + (cx * ay - ax * cy) + (ax * by - bx * ay)
    right, down = 2.0 / width / total, -2.0 / height / total
    return (
        (right * (wc * by - wb * cy), right * (wa * cy - wc * ay), right * (wb * ay - wa * by)),
        (down * (cx * wb - bx * wc), down * (ax * wc - cx * wa), down * (bx * wa - ax * wb)),
    )


@stage
def unsnapped_corners(a, b, c, codes, geometry):
    """Return x, y of a clipped face's vertices in clip space, 0 for any other face, and all w."""
    clip, w = geometry.clip_positions, geometry.w
    if codes & CLIPPED:
        exact = (clip[a, 0], clip[a, 1]), (clip[b, 0], clip[b, 1]), (clip[c, 0], clip[c, 1])
        return exact, (clip[a, 3], clip[b, 3], clip[c, 3])
    return ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)), (w[a], w[b], w[c])


@stage
def weight_slopes(a, b, c, column, row, geometry):
    """
    Return how the weights of a face change at a pixel's centre, over their sum.

    Two times three numbers: by one pixel to the right, and by one pixel down, of the weights
    before they are divided by their sum.
    """
    xy, viewport = geometry.xy, geometry.viewport
    snapped = (
        (np.int64(xy[a, 0]), np.int64(xy[a, 1])),
        (np.int64(xy[b, 0]), np.int64(xy[b, 1])),
        (np.int64(xy[c, 0]), np.int64(xy[c, 1])),
    )
    codes = geometry.codes[a] | geometry.codes[b] | geometry.codes[c]
    exact, ws = unsnapped_corners(a, b, c, codes, geometry)
    width, height, bits = viewport.width, viewport.height, viewport.grid_bits
    return chosen_slopes(codes, snapped, exact, ws, (column, row), (width, height), bits)


@stage
def chosen_slopes(codes, snapped, exact, ws, pixel, size, bits):
    """Return the slopes of a clipped face or of one that was not."""
    if codes & CLIPPED:
        return clipped_slopes(exact, ws, pixel[0], pixel[1], size[0], size[1])
    return snapped_slopes(snapped, ws, pixel[0], pixel[1], bits)


@stage
def place_step(slopes, place, place0, place1, place2):
    """Return how far the coordinates move, u and v, where the weights change by the slopes."""
    rest = slopes[0] + slopes[1] + slopes[2]
    return (
        slopes[1] * (place1[0] - place0[0])
        + slopes[2] * (place2[0] - place0[0])
        - rest * (place[0] - place0[0]),
        slopes[1] * (place1[1] - place0[1])
        + slopes[2] * (place2[1] - place0[1])
        - rest * (place[1] - place0[1]),
    )


@stage
def length_squared(step, width, height):
    """Return the squared length of a step, in texels of a level."""
    u, v = step[0] * width, step[1] * height
    return u * u + v * v


@stage
def moved_place(place, owner, kind, transforms):
    """Return coordinates as the texture of an object sees them; as they are without transforms."""
    if transforms is None:
        return place
    u, v = place
    return (
        transforms[owner, kind, 0] * u + transforms[owner, kind, 1] * v
        + transforms[owner, kind, 2],
        transforms[owner, kind, 3] * u + transforms[owner, kind, 4] * v
        + transforms[owner, kind, 5],
    )  # fmt: skip


@stage
def moved_step(step, owner, kind, transforms):
    """Return a step as the texture of an object sees it; as it is without transforms."""
    if transforms is None:
        return step
    u, v = step
    return (
        transforms[owner, kind, 0] * u + transforms[owner, kind, 1] * v,
        transforms[owner, kind, 3] * u + transforms[owner, kind, 4] * v,
    )


@stage
def level_of_detail(squared):
    """Return log2 of the length of a step, given its square; 0 where a texel covers the pixel."""
    if not squared > 1.0:
        return np.float32(0.0)
    return np.float32(0.5) * log2(np.float32(min(squared, LARGEST_STEP_SQUARED)))


@stage
def vertex_place(uv, vertex):
    """Return the texture coordinates of a vertex."""
    return np.float64(uv[vertex, 0]), np.float64(uv[vertex, 1])


@stage
def plain_footprint(right, down):
    """Return the squared length of the longer of two steps, one tap, and no way between taps."""
    return max(right, down), np.int64(1), (0.0, 0.0)


@stage
def long_footprint(right, down, step_right, step_down, limit):
    """
    Return what stands for a pixel's footprint: a squared length, a number of taps, and their way.

    The footprint is divided along its longer step into at most ``limit`` parts, each as long as
    the shorter step, or as a texel if that is shorter. Takes squared lengths in texels, and steps.
    """
    longest, shortest = max(right, down), max(min(right, down), 1.0)
    if not (longest > shortest and limit > 1):
        return plain_footprint(right, down)
    parts = min(np.sqrt(longest / shortest), np.float64(limit))
    way = step_right if right > down else step_down
    return longest / (parts * parts), np.int64(np.ceil(parts)), way


@stage
def footprint(steps, size, limit, anisotropic):
    """Return `long_footprint` of two steps; that of one tap if no texture is anisotropic."""
    right = length_squared(steps[0], size[0], size[1])
    down = length_squared(steps[1], size[0], size[1])
    if anisotropic is None:
        return plain_footprint(right, down)
    return long_footprint(right, down, steps[0], steps[1], limit)


@stage
def steps_at(corners, place, column, row, owner, kind, uv, transforms, geometry):
    """Return the steps, u and v, that a pixel to the right and a pixel down make on a texture."""
    a, b, c = corners
    right, down = weight_slopes(a, b, c, column, row, geometry)
    pa, pb, pc = vertex_place(uv, a), vertex_place(uv, b), vertex_place(uv, c)
    return (
        moved_step(place_step(right, place, pa, pb, pc), owner, kind, transforms),
        moved_step(place_step(down, place, pa, pb, pc), owner, kind, transforms),
    )


@stage
def split_detail(detail, count):
    """Return the finer level of the two around a level of detail, and the share of the coarser."""
    finer = np.int64(detail)
    if finer >= count - 1:
        return count - 1, np.float32(0.0)
    return finer, detail - np.float32(finer)


@stage
def mix_levels(texels, levels, first, share, place, wraps):
    """Return the bilinear mix of a level and, if it has a share, the next, at a place."""
    level = level_at(levels, first)
    color = mix_texels(texels, surrounding_texels(level, place[0], place[1], wraps))
    if share > np.float32(0.0):
        level = level_at(levels, first + 1)
        coarse = mix_texels(texels, surrounding_texels(level, place[0], place[1], wraps))
        color = mix(color, coarse, share)
    return color


@stage
def tap_place(place, way, n, taps):
    """Return where tap ``n`` of a footprint lies; a lone one in the middle."""
    if taps == 1:
        return place
    shift = np.float64(2 * n + 1 - taps) / np.float64(2 * taps + 2)
    return place[0] + shift * way[0], place[1] + shift * way[1]


@stage
def mix_taps(texels, levels, first, share, place, wraps, taps, way, anisotropic):
    """Return the mean of the taps along a footprint; taps that are equal give exactly theirs."""
    if anisotropic is None:
        return mix_levels(texels, levels, first, share, place, wraps)
    one = np.float32(1.0)
    color = one, one, one, one
    for n in range(taps):
        tap = mix_levels(texels, levels, first, share, tap_place(place, way, n, taps), wraps)
        color = mix(color, tap, one / np.float32(n + 1)) if n > 0 else tap
    return color


@stage
def texture_color(owner, kind, place, corners, column, row, textures, geometry):
    """
    Return what the texture of an object shows at a sample, linear RGBA; white if it has none.

    Takes the coordinates u and v there and the vertices of its face.
    """
    # The arrays are taken out of their record, and branches handle numbers alone: a branch that
    # holds an array counts references to it, sample by sample.
    texels, levels, table, uv = textures.texels, textures.levels, textures.table, textures.uv
    transforms, anisotropic = textures.transforms, textures.anisotropic
    one = np.float32(1.0)
    color = one, one, one, one
    first = table[owner, kind, FIRST_LEVEL]
    if first >= 0:
        wraps = table[owner, kind, WRAP_U], table[owner, kind, WRAP_V]
        chosen = table[owner, kind, FILTER]
        level = level_at(levels, first)
        there = moved_place(place, owner, kind, transforms)
        if chosen == NEAREST:
            color = texel(texels, nearest_texel(level, there[0], there[1], wraps))
        else:
            finer, share, taps, way = np.int64(0), np.float32(0.0), np.int64(1), (0.0, 0.0)
            if chosen == TRILINEAR:
                steps = steps_at(corners, place, column, row, owner, kind, uv, transforms, geometry)
                size, limit = (level[1], level[2]), table[owner, kind, ANISOTROPY]
                squared, taps, way = footprint(steps, size, limit, anisotropic)
                finer, share = split_detail(
                    level_of_detail(squared), table[owner, kind, LEVEL_COUNT]
                )
            color = mix_taps(
                texels, levels, first + finer, share, there, wraps, taps, way, anisotropic
            )
    return color
