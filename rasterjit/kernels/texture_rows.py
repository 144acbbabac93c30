"""
Look up textures for a part of a row: in passes over rows of scratch memory, that vectorize.

The formulas are described in ``texturing``; here they are without branches. What tells wraps apart
are numbers (`axis_rule`), and every sample has the size of its own level.
Positions and texel numbers are whole numbers in float64, exact below 2**52. Only the texels are
read one sample after the other, four channels at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.kernels import texturing
from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.patches import whole_vectors
from rasterjit.kernels.texturing import (
    ANISOTROPY,
    CLAMP,
    FILTER,
    FIRST_LEVEL,
    FIRST_TEXEL,
    LEVEL_COUNT,
    LEVEL_HEIGHT,
    LEVEL_WIDTH,
    NEAREST,
    REPEAT,
    TEXEL_STEPS,
    TRILINEAR,
    WRAP_U,
    WRAP_V,
)
from rasterjit.kernels.vectors import CHANNELS, copy_texel, mix_colors, mix_texels

U, V = 0, 1
"""Rows of places: texture coordinates."""
CORNERS = 2
"""Three rows: vertex numbers of the face, lowest first; only for maps."""
OWNER = 5
"""Row: the object."""
SHOWN = 6
"""Four rows: what the texture shows, linear RGBA."""
MATT = 10
"""Three rows: the part of the colour that the texture absorbs light from, linear."""
STEPS = 13
"""Four rows: what a pixel to the right adds to u and v, and a pixel down; for levels of detail."""
MOVED_U, MOVED_V = 17, 18
"""Rows: coordinates as the texture at hand sees them."""
TAP_U, TAP_V = 19, 20
"""Rows: those of one tap of a footprint."""
WAY_U, WAY_V = 21, 22
"""Rows: the way along which the taps of a footprint lie."""
WIDTH, HEIGHT = 23, 24
"""Rows: size of the level that is read, texels."""
SCRATCH_ROWS = 25

LEVEL, FIRST, TAPS = 0, 1, 2
"""Rows of whole numbers: the finer level, its first texel, and the taps of a footprint."""
LEFT, RIGHT, LOW, HIGH = 3, 4, 5, 6
"""Rows of whole numbers: columns of texels around a place, and the first texels of their rows."""
WHOLE_ROWS = 7

COARSER, ALONG, UPWARD = 0, 1, 2
"""Rows of shares: of the coarser level, of the texels to the right, and of those above."""
SHARE_ROWS = 3

MIXED, COARSE, TAP = 0, 1, 2
"""Rows of colours, four channels a sample: the result, a coarser level, one tap."""
COLOR_ROWS = 3

WHOLE_SHIFT = 2.0**52
"""A float64 of this size or more, below twice that, holds a whole number in its last bits."""
SHIFT_BITS = np.int64(0x4330000000000000)


@stage
def whole_number(x):
    """Return a float64 that is a whole number in 0..2**52 - 1 as int64."""
    return np.float64(x + WHOLE_SHIFT).view(np.int64) - SHIFT_BITS


@stage
def axis_rule(wrap):
    """
    Return what tells a wrap from others, as numbers.

    Bounds of the coordinate; what it is scaled by before whole periods are taken off, the periods
    taken off, and what it is scaled by after; periods that a texel is moved by where it lies
    outside; pictures in a period, and 1 if the last is turned.
    """
    if wrap == CLAMP:
        return 0.0, 1.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0
    if wrap == REPEAT:
        return -np.inf, np.inf, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0
    return -np.inf, np.inf, 0.5, 1.0, 2.0, 0.0, 2.0, 1.0


@stage
def place_on_axis(u, size, rule):
    """
    Return where a coordinate lies along an axis, in texels, within about one period.

    The middle of texel 0 stands for NaN and infinity.
    """
    lowest, highest, before, periods, after, _, _, _ = rule
    scaled = before * min(max(u, lowest), highest)
    reduced = after * (scaled - periods * np.floor(scaled))
    position = np.floor(reduced * size * TEXEL_STEPS + 0.5) / TEXEL_STEPS
    return position if abs(u) < np.inf else 0.5


@stage
def texel_on_axis(i, size, rule):
    """Return the texel that stands at a whole number along an axis, at most one off a period."""
    _, _, _, _, _, moved, pictures, turned = rule
    by = moved * size
    i = i + (by if i < 0.0 else 0.0) - (by if i >= size else 0.0)
    return max(min(i, pictures * size - 1.0 - turned * i), 0.0)


@disjoint_stage
def find_texels(
    u, v, widths, heights, firsts, rules, offset, left, right, low, high, along, upward
):  # fmt: skip
    """
    Write the columns of the texels around each place, the first texels of their rows, and shares.

    With an offset of 0 instead of half a texel, left and low are the texel that holds the place.
    """
    for n in range(u.shape[0]):
        width, height = widths[n], heights[n]
        x = place_on_axis(u[n], width, rules[0]) - offset
        y = place_on_axis(v[n], height, rules[1]) - offset
        column, row = np.floor(x), np.floor(y)
        along[n], upward[n] = np.float32(x - column), np.float32(y - row)
        left[n] = whole_number(texel_on_axis(column, width, rules[0]))
        right[n] = whole_number(texel_on_axis(column + 1.0, width, rules[0]))
        row0 = height - 1.0 - texel_on_axis(row, height, rules[1])
        row1 = height - 1.0 - texel_on_axis(row + 1.0, height, rules[1])
        low[n] = firsts[n] + whole_number(row0 * width)
        high[n] = firsts[n] + whole_number(row1 * width)


@stage
def find_level_texels(u, v, size, rules, offset, places, numbers, shares):
    """Write the texels around each place on its level."""
    find_texels(
        u, v, places[WIDTH, :size], places[HEIGHT, :size], numbers[FIRST, :size], rules, offset,
        numbers[LEFT, :size], numbers[RIGHT, :size], numbers[LOW, :size], numbers[HIGH, :size],
        shares[ALONG, :size], shares[UPWARD, :size],
    )  # fmt: skip


@disjoint_stage
def fill_level(level, firsts, widths, heights):
    """Write first texel and size of one level for all samples."""
    width, height = np.float64(level[1]), np.float64(level[2])
    for n in range(firsts.shape[0]):
        firsts[n], widths[n], heights[n] = level[0], width, height


@stage
def differences(values, count):
    """Return 0 if the first values are all the same."""
    found, first = np.int64(0), values[0]
    for n in range(count):
        found |= np.int64(values[n] != first)
    return found


@stage
def take_levels(count, size, up, last, levels, places, numbers):
    """Write first texel and size of each sample's level, or of one ``up``, at most the last."""
    if differences(numbers[LEVEL], count) == 0:
        level = texturing.level_at(levels, np.uintp(min(numbers[LEVEL, 0] + up, last)))
        fill_level(level, numbers[FIRST, :size], places[WIDTH, :size], places[HEIGHT, :size])
        return
    for n in range(np.uintp(count)):
        level = np.uintp(min(numbers[LEVEL, n] + up, last))
        numbers[FIRST, n] = levels[level, FIRST_TEXEL]
        places[WIDTH, n] = np.float64(levels[level, LEVEL_WIDTH])
        places[HEIGHT, n] = np.float64(levels[level, LEVEL_HEIGHT])


@disjoint_stage
def fill_details(level, levels, shares, taps):
    """Write one level, with no share of the coarser, and one tap for all samples."""
    for n in range(levels.shape[0]):
        levels[n], shares[n], taps[n] = level, np.float32(0.0), np.int64(1)


@stage
def copy_texels(count, texels, numbers, colors):
    """Write the texel that holds each place."""
    for n in range(np.uintp(count)):
        copy_texel(texels, numbers[LOW, n] + numbers[LEFT, n], colors, n)


@stage
def mix_around(count, texels, numbers, shares, colors):
    """Write the bilinear mix of the texels around each place."""
    for n in range(np.uintp(count)):
        left, right = numbers[LEFT, n], numbers[RIGHT, n]
        low, high = numbers[LOW, n], numbers[HIGH, n]
        four = low + left, low + right, high + left, high + right
        mix_texels(texels, four, shares[ALONG, n], shares[UPWARD, n], colors, n)


@stage
def add_coarse(count, shares, coarse, colors):
    """Mix the coarser level into the finer one, where it has a share."""
    for n in range(np.uintp(count)):
        share = shares[COARSER, n]
        if share > np.float32(0.0):
            mix_colors(colors, coarse, share, n)


@stage
def move_places(u, v, owner, kind, transforms, moved_u, moved_v):
    """Write coordinates as a texture sees them and return those; as they are without transforms."""
    if transforms is None:
        return u, v
    move_all(u, v, transforms[owner, kind], moved_u, moved_v)
    return moved_u, moved_v


@disjoint_stage
def move_all(u, v, transform, moved_u, moved_v):
    """Write coordinates as a texture sees them."""
    for n in range(u.shape[0]):
        moved_u[n] = transform[0] * u[n] + transform[1] * v[n] + transform[2]
        moved_v[n] = transform[3] * u[n] + transform[4] * v[n] + transform[5]


@disjoint_stage
def find_details(
    right_u, right_v, down_u, down_v, owner, kind, transforms, size, limit, count, first,
    anisotropic, level, share, taps, way_u, way_v,
):  # fmt: skip
    """Write the finer level of each sample, the share of the coarser, and the footprint's taps."""
    for n in range(level.shape[0]):
        steps = (
            texturing.moved_step((right_u[n], right_v[n]), owner, kind, transforms),
            texturing.moved_step((down_u[n], down_v[n]), owner, kind, transforms),
        )
        squared, parts, way = texturing.footprint(steps, size, limit, anisotropic)
        finer, share[n] = texturing.split_detail(texturing.level_of_detail(squared), count)
        level[n] = first + np.int64(finer)
        taps[n], way_u[n], way_v[n] = parts, way[0], way[1]


@stage
def any_coarse(shares, count):
    """Return whether a coarser level has a share in any of the first samples."""
    found = np.int64(0)
    for n in range(count):
        found |= np.int64(shares[COARSER, n] > np.float32(0.0))
    return found != 0


@stage
def most_taps(taps, anisotropic):
    """Return the most taps that a sample takes; 1 if no texture is anisotropic."""
    if anisotropic is None:
        return np.int64(1)
    most = np.int64(1)
    for n in range(taps.shape[0]):
        most = max(most, taps[n])
    return most


@stage
def tap_places(u, v, k, taps, way_u, way_v, tap_u, tap_v, anisotropic):
    """Write where tap ``k`` of each footprint lies and return it; the middle if there is one."""
    if anisotropic is None:
        return u, v
    for n in range(u.shape[0]):
        place = texturing.tap_place((u[n], v[n]), (way_u[n], way_v[n]), k, taps[n])
        tap_u[n], tap_v[n] = place
    return tap_u, tap_v


@stage
def tap_colors(mixed, own, anisotropic):
    """Return where the colour of a tap is written: at once to the result if there is one tap."""
    if anisotropic is None:
        return mixed
    return own


@stage
def add_tap(k, count, taps, own, mixed, anisotropic):
    """Take tap ``k`` of each footprint into the mean; nothing if it is the result itself."""
    if anisotropic is None:
        return
    if k == 0:
        for n in range(CHANNELS * count):
            mixed[n] = own[n]
        return
    for n in range(np.uintp(count)):
        if k < taps[n]:
            mix_colors(mixed, own, np.float32(1.0) / np.float32(k + 1), n)


@stage
def read_level(u, v, count, up, last, is_smooth, rules, textures, places, numbers, shares, colors):
    """Write what a level, ``up`` from the finer one, shows at each place."""
    size = whole_vectors(count)
    take_levels(count, size, up, last, textures.levels, places, numbers)
    offset = 0.5 if is_smooth else 0.0
    find_level_texels(u, v, size, rules, offset, places, numbers, shares)
    if is_smooth:
        mix_around(count, textures.texels, numbers, shares, colors)
    else:
        copy_texels(count, textures.texels, numbers, colors)


@stage
def read_taps(u, v, count, last, is_smooth, rules, textures, places, numbers, shares, colors, out):
    """Write the colours of neighbouring samples of one texture whose levels are known."""
    size, anisotropic = whole_vectors(count), textures.anisotropic
    own = tap_colors(out, colors[TAP], anisotropic)
    depth = np.int64(2 if any_coarse(shares, count) else 1)
    for k in range(most_taps(numbers[TAPS, :count], anisotropic)):
        tap_u, tap_v = tap_places(
            u, v, k, numbers[TAPS, :size], places[WAY_U, :size], places[WAY_V, :size],
            places[TAP_U, :size], places[TAP_V, :size], anisotropic,
        )  # fmt: skip
        for up in range(depth):
            target = own if up == 0 else colors[COARSE]
            read_level(
                tap_u, tap_v, count, up, last, is_smooth, rules, textures, places, numbers, shares,
                target,
            )  # fmt: skip
        if depth > 1:
            add_coarse(count, shares, colors[COARSE], own)
        add_tap(k, count, numbers[TAPS], own, out, anisotropic)


@stage
def find_levels(first, size, owner, kind, table, textures, places, numbers, shares):
    """Write the levels of neighbouring samples of one texture, and the taps of their footprints."""
    level = table[owner, kind, FIRST_LEVEL]
    if table[owner, kind, FILTER] != TRILINEAR:
        fill_details(level, numbers[LEVEL, :size], shares[COARSER, :size], numbers[TAPS, :size])
        return
    stop = first + size
    _, width, height = texturing.level_at(textures.levels, level)
    find_details(
        places[STEPS, first:stop], places[STEPS + 1, first:stop], places[STEPS + 2, first:stop],
        places[STEPS + 3, first:stop], owner, kind, textures.transforms, (width, height),
        table[owner, kind, ANISOTROPY], np.int32(table[owner, kind, LEVEL_COUNT]), level,
        textures.anisotropic, numbers[LEVEL, :size], shares[COARSER, :size], numbers[TAPS, :size],
        places[WAY_U, :size], places[WAY_V, :size],
    )  # fmt: skip


@stage
def read_one_texture(first, count, owner, kind, textures, places, numbers, shares, colors, out):
    """Write what a texture of one object shows at neighbouring samples; white without one."""
    table, size = textures.table, whole_vectors(count)
    if table[owner, kind, FIRST_LEVEL] < 0:
        for n in range(CHANNELS * count):
            out[n] = np.float32(1.0)
        return
    find_levels(first, size, owner, kind, table, textures, places, numbers, shares)
    u, v = move_places(
        places[U, first : first + size], places[V, first : first + size], owner, kind,
        textures.transforms, places[MOVED_U, :size], places[MOVED_V, :size],
    )  # fmt: skip
    rules = axis_rule(table[owner, kind, WRAP_U]), axis_rule(table[owner, kind, WRAP_V])
    last = table[owner, kind, FIRST_LEVEL] + table[owner, kind, LEVEL_COUNT] - 1
    is_smooth = table[owner, kind, FILTER] != NEAREST
    read_taps(u, v, count, last, is_smooth, rules, textures, places, numbers, shares, colors, out)


@stage
def owner_end(owners, first, count):
    """Return the first sample of another object than that of the sample ``first``."""
    if differences(owners[first:], count - first) == 0:
        return count
    end = first + 1
    while owners[end] == owners[first]:
        end += 1
    return end


@disjoint_stage
def show_colors(colors, red, green, blue, alpha):
    """Write colours channel by channel."""
    for n in range(red.shape[0]):
        at = CHANNELS * n
        red[n], green[n] = np.float64(colors[at]), np.float64(colors[at + 1])
        blue[n], alpha[n] = np.float64(colors[at + 2]), np.float64(colors[at + 3])


@stage
def read_textures(places, lookup, count, kind, textures):
    """
    Write what textures of one kind show at each sample of a row; white where an object has none.

    Parameters
    ----------
    places : (SCRATCH_ROWS, W) float64
        Reads rows U, V, OWNER and STEPS of ``count`` samples, writes rows SHOWN (linear RGBA).
    lookup : tuple
        What `lookup_memory` gave.
    count : int
    kind : int
        ``BASE_COLOR`` ... ``EMISSIVE``. All of this is compiled into every place that calls it: for
        several kinds, call it in a loop.
    textures : Textures
    """
    numbers, shares, colors = lookup
    first = np.int64(0)
    while first < count:
        end = owner_end(places[OWNER], first, count)
        read_one_texture(
            first, end - first, np.int64(places[OWNER, first]), kind, textures, places, numbers,
            shares, colors, colors[MIXED, CHANNELS * first :],
        )  # fmt: skip
        first = end
    show_colors(
        colors[MIXED, : CHANNELS * count], places[SHOWN, :count], places[SHOWN + 1, :count],
        places[SHOWN + 2, :count], places[SHOWN + 3, :count],
    )  # fmt: skip


def lookup_memory(room: int) -> tuple[Any, Any, Any]:
    """Return the memory that a thread needs to look up textures of so many samples."""
    return (
        np.empty((WHOLE_ROWS, room), np.int64),
        np.empty((SHARE_ROWS, room), np.float32),
        np.empty((COLOR_ROWS, CHANNELS * room), np.float32),
    )
