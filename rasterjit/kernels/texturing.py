"""
Look up textures: place the sample on the picture, wrap, filter, choose the mip level.

Coordinate u runs right and v up. They are reduced to one period in float64 before they are scaled
to texels, so nothing is lost far from 0 but what float32 coordinates have lost already. Texels lie
row by row from the top of the picture, as linear RGBA.

The level of detail is ``log2 rho``; rho is the longer of the two steps on the picture, in texels,
that one pixel to the right and one pixel down make. They are the exact derivatives of the
perspective-correct coordinates at the pixel's centre: with weights ``W_k / sum W`` whose parts are
linear on the screen, ``u = sum W_k u_k / sum W`` has the derivative ``sum W_k' (u_k - u) / sum W``.

References
----------
.. [1] L. Williams, "Pyramidal Parametrics", SIGGRAPH 1983.
.. [2] The Khronos Group, "Vulkan 1.4 Specification", section 16.5.8, "Level of Detail Operation".
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.interpolation import interpolate
from rasterjit.kernels.jit import stage
from rasterjit.kernels.lighting import log2
from rasterjit.kernels.setup import CLIPPED, edge

REPEAT, CLAMP, MIRROR = 0, 1, 2
"""What lies outside the picture, as ``Textures.table`` numbers it."""

NEAREST, BILINEAR, TRILINEAR = 0, 1, 2
"""Filters, as ``Textures.table`` numbers them."""

FIRST_LEVEL, LEVEL_COUNT, WRAP_U, WRAP_V, FILTER = 0, 1, 2, 3, 4
"""Columns of ``Textures.table``."""

FIRST_TEXEL, LEVEL_WIDTH, LEVEL_HEIGHT = 0, 1, 2
"""Columns of ``Textures.levels``."""

U, V = 0, 1
"""Scratch rows: texture coordinates."""
CORNERS = 2
"""Three scratch rows: vertex numbers of the face, lowest first."""
OWNER = 5
"""Scratch row: the object."""
SHOWN = 6
"""Four scratch rows: what the texture shows, linear RGBA."""
MATT = 10
"""Three scratch rows: the part of the colour that the texture absorbs light from, linear."""
SCRATCH_ROWS = 13

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
    per_sum = np.float64(np.int64(1) << bits) / total
    p, q, r = p * per_sum, q * per_sum, r * per_sum
    return (
        (p * np.float64(by - cy), q * np.float64(cy - ay), r * np.float64(ay - by)),
        (p * np.float64(cx - bx), q * np.float64(ax - cx), r * np.float64(bx - ax)),
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
def step_squared(slopes, place, place0, place1, place2, width, height):
    """Return the squared length, in texels, of the step that the slopes make on the picture."""
    rest = slopes[0] + slopes[1] + slopes[2]
    u = (
        slopes[1] * (place1[0] - place0[0])
        + slopes[2] * (place2[0] - place0[0])
        - rest * (place[0] - place0[0])
    ) * width
    v = (
        slopes[1] * (place1[1] - place0[1])
        + slopes[2] * (place2[1] - place0[1])
        - rest * (place[1] - place0[1])
    ) * height
    return u * u + v * v


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
def detail_at(corners, place, column, row, uv, level, geometry):
    """Return the level of detail of a sample on the face with these corners."""
    a, b, c = corners
    right, down = weight_slopes(a, b, c, column, row, geometry)
    pa, pb, pc = vertex_place(uv, a), vertex_place(uv, b), vertex_place(uv, c)
    _, width, height = level
    return level_of_detail(
        max(
            step_squared(right, place, pa, pb, pc, width, height),
            step_squared(down, place, pa, pb, pc, width, height),
        )
    )


@stage
def split_detail(detail, count):
    """Return the finer level of the two around a level of detail, and the share of the coarser."""
    finer = np.int64(detail)
    if finer >= count - 1:
        return count - 1, np.float32(0.0)
    return finer, detail - np.float32(finer)


@stage
def note_place(scratch, n, weights, a, b, c, owner, textures):
    """Write where on the picture a sample lies, and what it takes to find its level of detail."""
    if textures is None:
        return
    uv = textures.uv
    pa, pb, pc = vertex_place(uv, a), vertex_place(uv, b), vertex_place(uv, c)
    scratch[U, n] = interpolate(weights, pa[0], pb[0], pc[0])
    scratch[V, n] = interpolate(weights, pa[1], pb[1], pc[1])
    scratch[CORNERS, n], scratch[CORNERS + 1, n], scratch[CORNERS + 2, n] = a, b, c
    scratch[OWNER, n] = owner


@stage
def read_textures(scratch, where, count, row, textures, geometry):
    """
    Write what the textures show at each sample of a row; white where an object has none.

    Parameters
    ----------
    scratch : (SCRATCH_ROWS, W) float64
        Reads rows U..OWNER of ``count`` samples, writes rows SHOWN.. (linear RGBA).
    where : (W,) int32
        The columns that the samples lie in.
    count, row : int
    textures, geometry : records
    """
    # The arrays are taken out of their record, and branches handle numbers alone: a branch that
    # holds an array counts references to it, sample by sample.
    texels, levels, table, uv = textures.texels, textures.levels, textures.table, textures.uv
    one = np.float32(1.0)
    for n in range(count):
        owner = np.int64(scratch[OWNER, n])
        u, v = scratch[U, n], scratch[V, n]
        first, levels_held = table[owner, FIRST_LEVEL], table[owner, LEVEL_COUNT]
        wraps, kind = (table[owner, WRAP_U], table[owner, WRAP_V]), table[owner, FILTER]
        color = one, one, one, one
        if first >= 0:
            level = level_at(levels, first)
            if kind == NEAREST:
                color = texel(texels, nearest_texel(level, u, v, wraps))
            else:
                finer, share = np.int64(0), np.float32(0.0)
                if kind == TRILINEAR:
                    corners = (
                        np.int64(scratch[CORNERS, n]),
                        np.int64(scratch[CORNERS + 1, n]),
                        np.int64(scratch[CORNERS + 2, n]),
                    )
                    column = np.int64(where[n])
                    detail = detail_at(corners, (u, v), column, row, uv, level, geometry)
                    finer, share = split_detail(detail, levels_held)
                level = level_at(levels, first + finer)
                color = mix_texels(texels, surrounding_texels(level, u, v, wraps))
                if share > np.float32(0.0):
                    level = level_at(levels, first + finer + 1)
                    coarse = mix_texels(texels, surrounding_texels(level, u, v, wraps))
                    color = mix(color, coarse, share)
        for k in range(4):
            scratch[SHOWN + k, n] = color[k]
