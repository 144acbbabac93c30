"""
Look up textures for a part of a row: in passes over rows of scratch memory, that vectorize.

The formulas are described in ``textures``; here they are without branches. What tells wraps apart
are numbers (`axis_rule`), and every sample has the size of its own level.
Positions and texel numbers are whole numbers in float64, exact below 2**52. Only the texels are
read one sample after the other, four channels at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.pipeline.records import GOURAUD, MATERIAL_MODEL, Textures
from rasterjit.pipeline.surface import samples as rows
from rasterjit.pipeline.surface import textures as texturing
from rasterjit.pipeline.surface.listing import whole_vectors
from rasterjit.pipeline.surface.samples import OWNER as OF
from rasterjit.pipeline.surface.samples import SEGMENTS, START, STOP, Block
from rasterjit.pipeline.surface.textures import (
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
from rasterjit.runtime.intrinsics import CHANNELS, copy_texel, mix_colors, mix_texels, part
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state import float32, int64

U, V = 0, 1
"""Rows of places: texture coordinates."""
OWNER = 2
"""Row: the object."""
SHOWN = 3
"""Four rows: what the texture shows, linear RGBA."""
STEPS = 7
"""Four rows: what the next sample to the right adds to u and v, and the next down; for levels."""
MOVED_U, MOVED_V = 11, 12
"""Rows: coordinates as the texture at hand sees them."""
TAP_U, TAP_V = 13, 14
"""Rows: those of one tap of a footprint."""
WAY_U, WAY_V = 15, 16
"""Rows: the way along which the taps of a footprint lie."""
WIDTH, HEIGHT = 17, 18
"""Rows: size of the level that is read, texels."""
MOVED_STEPS = (MOVED_U, MOVED_V, TAP_U, TAP_V)
"""Rows, which are free as long as levels are found: steps as the texture at hand sees them."""
LONGEST = WIDTH
"""Row, which is free by then: the squared length that the level of detail goes by, in texels."""
SCRATCH_ROWS = 19

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


@helper
def whole_number(x):
    """Return a float64 that is a whole number in 0..2**52 - 1 as int64."""
    return np.float64(x + WHOLE_SHIFT).view(np.int64) - SHIFT_BITS


@helper
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


@helper
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


@helper
def texel_on_axis(i, size, rule):
    """Return the texel that stands at a whole number along an axis, at most one off a period."""
    _, _, _, _, _, moved, pictures, turned = rule
    by = moved * size
    i = i + (by if i < 0.0 else 0.0) - (by if i >= size else 0.0)
    return max(min(i, pictures * size - 1.0 - turned * i), 0.0)


@disjoint_helper
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


@disjoint_helper
def fill_level(level, firsts, widths, heights):
    """Write first texel and size of one level for all samples."""
    width, height = np.float64(level[1]), np.float64(level[2])
    for n in range(firsts.shape[0]):
        firsts[n], widths[n], heights[n] = level[0], width, height


@helper
def differences(values, count):
    """Return 0 if the first values are all the same."""
    found, first = np.int64(0), values[0]
    for n in range(count):
        found |= np.int64(values[n] != first)
    return found


@helper
def take_levels(count, size, up, last, levels, places, numbers):
    """Write first texel and size of each sample's level, or of one ``up``, at most the last."""
    if differences(numbers[LEVEL], count) == 0:
        level = min(numbers[LEVEL, 0] + up, last)
        fill_level(
            texturing.level_at(levels, level), part(numbers, FIRST, 0, size),
            part(places, WIDTH, 0, size), part(places, HEIGHT, 0, size),
        )  # fmt: skip
        return
    for n in range(np.uintp(count)):
        level = np.uintp(min(numbers[LEVEL, n] + up, last))
        numbers[FIRST, n] = levels[level, FIRST_TEXEL]
        places[WIDTH, n] = np.float64(levels[level, LEVEL_WIDTH])
        places[HEIGHT, n] = np.float64(levels[level, LEVEL_HEIGHT])


@disjoint_helper
def fill_details(level, levels, shares, taps):
    """Write one level, with no share of the coarser, and one tap for all samples."""
    for n in range(levels.shape[0]):
        levels[n], shares[n], taps[n] = level, np.float32(0.0), np.int64(1)


@helper
def copy_texels(count, texels, numbers, colors):
    """Write the texel that holds each place."""
    for n in range(np.uintp(count)):
        copy_texel(texels, numbers[LOW, n] + numbers[LEFT, n], colors, n)


@helper
def mix_around(count, texels, numbers, shares, colors):
    """Write the bilinear mix of the texels around each place."""
    for n in range(np.uintp(count)):
        left, right = numbers[LEFT, n], numbers[RIGHT, n]
        low, high = numbers[LOW, n], numbers[HIGH, n]
        four = low + left, low + right, high + left, high + right
        mix_texels(texels, four, shares[ALONG, n], shares[UPWARD, n], colors, n)


@helper
def add_coarse(count, shares, coarse, colors):
    """Mix the coarser level into the finer one, where it has a share."""
    for n in range(np.uintp(count)):
        share = shares[COARSER, n]
        if share > np.float32(0.0):
            mix_colors(colors, coarse, share, n)


@disjoint_helper
def move_places(u, v, transform, moved_u, moved_v):
    """Write coordinates as a texture sees them."""
    for n in range(u.shape[0]):
        moved_u[n] = transform[0] * u[n] + transform[1] * v[n] + transform[2]
        moved_v[n] = transform[3] * u[n] + transform[4] * v[n] + transform[5]


@disjoint_helper
def move_steps(u, v, transform, moved_u, moved_v):
    """Write steps as a texture sees them."""
    for n in range(u.shape[0]):
        moved_u[n] = transform[0] * u[n] + transform[1] * v[n]
        moved_v[n] = transform[3] * u[n] + transform[4] * v[n]


@disjoint_helper
def find_longest(right_u, right_v, down_u, down_v, width, height, longest, taps):
    """Write the squared length of the longer step of each sample, in texels, and one tap."""
    for n in range(longest.shape[0]):
        right = texturing.length_squared((right_u[n], right_v[n]), width, height)
        down = texturing.length_squared((down_u[n], down_v[n]), width, height)
        longest[n], taps[n] = max(right, down), np.int64(1)


@helper
def divide_footprints(right_u, right_v, down_u, down_v, size, limit, longest, taps, way_u, way_v):
    """Write what stands for each footprint; return the most taps of the first samples."""
    width, height, count = size
    most = np.int64(1)
    for n in range(count):
        right, down = (right_u[n], right_v[n]), (down_u[n], down_v[n])
        longest[n], taps[n], (way_u[n], way_v[n]) = texturing.long_footprint(
            texturing.length_squared(right, width, height),
            texturing.length_squared(down, width, height), right, down, limit,
        )  # fmt: skip
        most = max(most, taps[n])
    return most


@disjoint_helper
def split_details(longest, count, first, levels, shares):
    """Write the finer level of each sample, and the share of the coarser."""
    for n in range(longest.shape[0]):
        detail = texturing.level_of_detail(longest[n])
        finer, shares[n] = texturing.split_detail(detail, count)
        levels[n] = first + np.int64(finer)


@helper
def any_coarse(shares, count):
    """Return whether a coarser level has a share in any of the first samples."""
    found = np.int64(0)
    for n in range(count):
        found |= np.int64(shares[COARSER, n] > np.float32(0.0))
    return found != 0


@disjoint_helper
def place_taps(u, v, k, taps, way_u, way_v, tap_u, tap_v):
    """Write where tap ``k`` of each footprint lies."""
    for n in range(u.shape[0]):
        tap_u[n], tap_v[n] = texturing.tap_place((u[n], v[n]), (way_u[n], way_v[n]), k, taps[n])


@helper
def add_tap(k, count, taps, own, mixed):
    """Take tap ``k`` of each footprint into the mean."""
    if k == 0:
        for n in range(CHANNELS * count):
            mixed[n] = own[n]
        return
    for n in range(np.uintp(count)):
        if k < taps[n]:
            mix_colors(mixed, own, np.float32(1.0) / np.float32(k + 1), n)


@helper
def read_level(
    u, v, count, up, last, is_smooth, rules, texels, levels, places, numbers, shares, colors
):  # fmt: skip
    """Write what a level, ``up`` from the finer one, shows at each place."""
    size = u.shape[0]
    take_levels(count, size, up, last, levels, places, numbers)
    find_texels(
        u, v, part(places, WIDTH, 0, size), part(places, HEIGHT, 0, size),
        part(numbers, FIRST, 0, size), rules, 0.5 if is_smooth else 0.0,
        part(numbers, LEFT, 0, size), part(numbers, RIGHT, 0, size), part(numbers, LOW, 0, size),
        part(numbers, HIGH, 0, size), part(shares, ALONG, 0, size), part(shares, UPWARD, 0, size),
    )  # fmt: skip
    if is_smooth:
        mix_around(count, texels, numbers, shares, colors)
    else:
        copy_texels(count, texels, numbers, colors)


@helper
def read_taps(
    u, v, count, most, last, is_smooth, rules, texels, levels, places, numbers, shares, colors, out
):  # fmt: skip
    """Write the colours of neighbouring samples of one texture whose levels are known."""
    size, depth = u.shape[0], np.int64(2 if any_coarse(shares, count) else 1)
    # The colour of a lone tap is the result.
    own, tap_u, tap_v = out, u, v
    if most > 1:
        own, tap_u, tap_v = colors[TAP], part(places, TAP_U, 0, size), part(places, TAP_V, 0, size)
    for k in range(most):
        if most > 1:
            place_taps(
                u, v, k, part(numbers, TAPS, 0, size), part(places, WAY_U, 0, size),
                part(places, WAY_V, 0, size), tap_u, tap_v,
            )  # fmt: skip
        for up in range(depth):
            target = own if up == 0 else colors[COARSE]
            read_level(
                tap_u, tap_v, count, up, last, is_smooth, rules, texels, levels, places, numbers,
                shares, target,
            )  # fmt: skip
        if depth > 1:
            add_coarse(count, shares, colors[COARSE], own)
        if most > 1:
            add_tap(k, count, numbers[TAPS], own, out)


@helper
def find_levels(first, count, owner, kind, textures, places, numbers, shares):
    """Write the levels of neighbouring samples of one texture; return the most taps they take."""
    row, size = textures.table[owner, kind], whole_vectors(count)
    level, stop = row[FIRST_LEVEL], first + size
    levels, coarser, taps = (
        part(numbers, LEVEL, 0, size),
        part(shares, COARSER, 0, size),
        part(numbers, TAPS, 0, size),
    )
    if row[FILTER] != TRILINEAR:
        fill_details(level, levels, coarser, taps)
        return np.int64(1)
    right_u, right_v = part(places, STEPS, first, stop), part(places, STEPS + 1, first, stop)
    down_u, down_v = part(places, STEPS + 2, first, stop), part(places, STEPS + 3, first, stop)
    if textures.transforms.shape[0] > 0:
        transform = textures.transforms[owner, kind]
        own, moved = (right_u, right_v, down_u, down_v), MOVED_STEPS
        right_u, right_v = places[moved[0], :size], places[moved[1], :size]
        down_u, down_v = places[moved[2], :size], places[moved[3], :size]
        move_steps(own[0], own[1], transform, right_u, right_v)
        move_steps(own[2], own[3], transform, down_u, down_v)
    _, width, height = texturing.level_at(textures.levels, level)
    longest, most = part(places, LONGEST, 0, size), np.int64(1)
    find_longest(right_u, right_v, down_u, down_v, width, height, longest, taps)
    if row[ANISOTROPY] > 1:
        most = divide_footprints(
            right_u, right_v, down_u, down_v, (width, height, count), row[ANISOTROPY], longest,
            taps, part(places, WAY_U, 0, size), part(places, WAY_V, 0, size),
        )  # fmt: skip
    split_details(longest, np.int32(row[LEVEL_COUNT]), level, levels, coarser)
    return most


@helper
def read_one_texture(first, count, owner, kind, textures, places, numbers, shares, colors, out):
    """Write what a texture of one object shows at neighbouring samples; white without one."""
    row, size = textures.table[owner, kind], whole_vectors(count)
    if row[FIRST_LEVEL] < 0:
        for n in range(CHANNELS * count):
            out[n] = np.float32(1.0)
        return
    most = find_levels(first, count, owner, kind, textures, places, numbers, shares)
    u, v = part(places, U, first, first + size), part(places, V, first, first + size)
    if textures.transforms.shape[0] > 0:
        moved_u, moved_v = part(places, MOVED_U, 0, size), part(places, MOVED_V, 0, size)
        move_places(u, v, textures.transforms[owner, kind], moved_u, moved_v)
        u, v = moved_u, moved_v
    rules = axis_rule(row[WRAP_U]), axis_rule(row[WRAP_V])
    last = row[FIRST_LEVEL] + row[LEVEL_COUNT] - 1
    read_taps(
        u, v, count, most, last, row[FILTER] != NEAREST, rules, textures.texels, textures.levels,
        places, numbers, shares, colors, out,
    )  # fmt: skip


@helper
def owner_end(owners, first, count):
    """Return the first sample of another object than that of the sample ``first``."""
    if differences(owners[first:], count - first) == 0:
        return count
    end = first + 1
    while owners[end] == owners[first]:
        end += 1
    return end


@disjoint_helper
def show_colors(colors, red, green, blue, alpha):
    """Write colours channel by channel."""
    for n in range(red.shape[0]):
        at = CHANNELS * n
        red[n], green[n] = np.float64(colors[at]), np.float64(colors[at + 1])
        blue[n], alpha[n] = np.float64(colors[at + 2]), np.float64(colors[at + 3])


@helper
def show_textures(places, lookup, count, kind, textures):
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
        ``BASE_COLOR`` ... ``EMISSIVE``. All of this is compiled into every place that calls it.
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
        colors[MIXED, : CHANNELS * count], part(places, SHOWN, 0, count),
        part(places, SHOWN + 1, 0, count), part(places, SHOWN + 2, 0, count),
        part(places, SHOWN + 3, 0, count),
    )  # fmt: skip


@stage
def read_textures(block: Block, count, kind: int64, textures: Textures):
    """
    Write what textures of one kind, ``BASE_COLOR`` ... ``EMISSIVE``, show at each sample.

    Into rows SHOWN of ``places``, linear RGBA; white where an object has none. After
    `find_coordinates`, and `find_steps` where a texture has levels to choose from.
    """
    lookup = block.numbers, block.shares, block.colors
    show_textures(block.places, lookup, count, kind, textures)


@stage
def multiply_textures(block: Block, count):
    """Multiply the base colours by what the textures show."""
    for k in range(3):
        multiply_row(block.samples[rows.RED + k, :count], part(block.places, SHOWN + k, 0, count))


@stage
def multiply_textures_below_highlights(
    block: Block, count, materials: float32[:, ::1], first: int64
):
    """
    Multiply the base colours by what the textures show, but for the highlights in them.

    What is left of the light on the vertices of objects shaded by Gouraud without highlights is in
    three rows of samples from ``first`` on.
    """
    samples, places = block.samples, block.places
    for k in range(block.counts[SEGMENTS]):
        segment = block.segments[k]
        s, e, owner = np.int64(segment[START]), np.int64(segment[STOP]), np.uintp(segment[OF])
        is_lit = np.int64(materials[owner, MATERIAL_MODEL]) == GOURAUD
        for i in range(3):
            colors, texels = samples[rows.RED + i, s:e], part(places, SHOWN + i, s, e)
            if is_lit:
                absorb_row(colors, texels, part(samples, first + i, s, e))
            else:
                multiply_row(colors, texels)


def lookup_memory(room: int) -> tuple[Any, Any, Any]:
    """Return the memory that a thread needs to look up textures of so many samples."""
    return (
        np.empty((WHOLE_ROWS, room), np.int64),
        np.empty((SHARE_ROWS, room), np.float32),
        np.empty((COLOR_ROWS, CHANNELS * room), np.float32),
    )


@helper
def absorb(color, texel, diffuse):
    """
    Return a colour times a texel, but for the highlight in it, which lies on top.

    That is what is left of the colour when the texel has absorbed its share of the light without
    highlights: exactly the colour itself if the texel is white.
    """
    if diffuse == color:
        return color * texel
    return max(color - diffuse * (np.float32(1.0) - texel), np.float32(0.0))


@disjoint_helper
def multiply_row(colors, texels):
    """Multiply one channel of the base colours by what the textures show."""
    for n in range(colors.shape[0]):
        colors[n] *= np.float32(texels[n])


@disjoint_helper
def absorb_row(colors, texels, diffuse):
    """Multiply one channel of the base colours, but for the highlights in it, by the textures."""
    for n in range(colors.shape[0]):
        colors[n] = absorb(colors[n], np.float32(texels[n]), np.float32(diffuse[n]))
