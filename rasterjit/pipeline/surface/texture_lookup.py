"""
Look up textures for a part of a row, in vectorized passes over rows of scratch memory.

``texture_filters`` has the formulas; here they are branchless. Wrap modes are numbers (`axis_rule`,
`texel_rule`), and every sample has the size of its own mip level. Positions are float64, texel
indices int32, from the texture's first. Only the texel fetch goes sample by sample: four channels
at once of floats, code by code of codes. Colours come out as one row per channel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.pipeline.records import GOURAUD, MATERIAL_MODEL, Textures
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface import texture_filters as texturing
from rasterjit.pipeline.surface.gather_samples import whole_vectors
from rasterjit.pipeline.surface.sample_block import PLACE_OWNER, SEGMENTS, START, STOP, Block
from rasterjit.runtime.intrinsics import (
    CHANNELS,
    HALVES,
    copy_texels,
    mix_texels,
    part,
    range_end,
)
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int64

U, V = 0, 1
"""Rows of places: texture coordinates."""
OWNER = PLACE_OWNER
"""Row: the object."""
RIGHT_U, RIGHT_V, DOWN_U, DOWN_V = 3, 4, 5, 6
"""Rows: what the next sample to the right adds to u and v, and the next down; for mip levels."""
MOVED_U, MOVED_V = 7, 8
"""Rows: coordinates after the current texture's transform."""
TAP_U, TAP_V = 9, 10
"""Rows: those of one tap. While mip levels are chosen, these four hold moved steps."""
AXIS_U, AXIS_V = 11, 12
"""Rows: the axis along which the taps of a footprint lie."""
STEP_SQUARED = 13
"""Row: the squared length that determines the level of detail, texels."""
SCRATCH_ROWS = 14

LEVEL, TAPS = 0, 1
"""Rows of whole numbers: the finer level, and the taps of a footprint."""
FIRST, WIDTH, HEIGHT = 2, 3, 4
"""Rows of whole numbers: first texel and size of the level that is read."""
COLUMN, ROW = 5, 6
"""Integer rows: the texel left of and below a position, before wrapping."""
CORNERS = 7
"""
Four rows of whole numbers: the texels around a place, lower left first, upper right last.

In `HALVES` from the first of the picture.
"""
INT_ROWS = 11

COARSER, ALONG, UPWARD = 0, 1, 2
"""Rows of weights: of the coarser level, of the texels to the right, and of those above."""
SHARE_ROWS = 3

SHOWN, COARSE, TAP = 0, CHANNELS, 2 * CHANNELS
"""Four rows of colours each: what the texture shows, linear RGBA; a coarser level; one tap."""
COLOR_ROWS = 3 * CHANNELS

EVEN_RUN = 16
"""Least average run of samples of one mip level for reading level by level."""

NEAR_TEXELS = 1 << 15
"""Textures of up to so many texels, 512 KiB, stay in the caches near the core."""

CODES = 256
"""Entries of a curve: codes of 8 bits."""


@helper
def axis_rule(wrap):
    """
    Return the numbers that encode how a wrap mode reduces a coordinate.

    Bounds of the coordinate; its scale before whole periods are subtracted, the number subtracted,
    and its scale after.
    """
    if wrap == texturing.CLAMP:
        return 0.0, 1.0, 1.0, 0.0, 1.0
    if wrap == texturing.REPEAT:
        return -np.inf, np.inf, 1.0, 1.0, 1.0
    return -np.inf, np.inf, 0.5, 1.0, 2.0


@helper
def texel_rule(wrap):
    """
    Return the integers that encode how a wrap mode treats texels outside the texture.

    Periods that a texel is moved by; textures in a period, and 1 if the last is mirrored.
    """
    if wrap == texturing.CLAMP:
        return np.int32(0), np.int32(1), np.int32(0)
    if wrap == texturing.REPEAT:
        return np.int32(1), np.int32(1), np.int32(0)
    return np.int32(0), np.int32(2), np.int32(1)


@helper
def place_on_axis(u, size, rule):
    """
    Return a coordinate's position along an axis, texels, within about one period.

    NaN and infinity give the middle of texel 0.
    """
    lowest, highest, before, periods, after = rule
    scaled = before * min(max(u, lowest), highest)
    reduced = after * (scaled - periods * np.floor(scaled))
    position = (
        np.floor(reduced * (np.float64(size) * texturing.TEXEL_STEPS) + 0.5) / texturing.TEXEL_STEPS
    )
    return position if abs(u) < np.inf else 0.5


@helper
def texel_on_axis(i, size, rule):
    """Wrap a texel index along an axis, at most one outside a period."""
    moved, pictures, turned = rule
    by, none = np.int32(moved * size), np.int32(0)
    before, behind = by if i < none else none, by if i >= size else none
    i = np.int32(np.int32(i + before) - behind)
    last = np.int32(np.int32(pictures * size) - np.int32(1))
    return max(min(i, np.int32(last - np.int32(turned * i))), none)


@disjoint_helper
def find_positions(u, v, widths, heights, rules, offset, columns, rows, along, upward):
    """
    Write the texel left of and below each position, not wrapped, and the weights of the next.

    With an offset of 0 instead of half a texel it is the texel that holds the position.
    """
    for n in range(u.shape[0]):
        x = place_on_axis(u[n], widths[n], rules[0]) - offset
        y = place_on_axis(v[n], heights[n], rules[1]) - offset
        column, row = np.floor(x), np.floor(y)
        along[n], upward[n] = np.float32(x - column), np.float32(y - row)
        columns[n], rows[n] = np.int32(column), np.int32(row)


@disjoint_helper
def find_corners(
    columns, rows, firsts, widths, heights, rules, low_left, low_right, high_left, high_right
):  # fmt: skip
    """Write the numbers of the texels around each place, wrapped."""
    one = np.int32(1)
    for n in range(columns.shape[0]):
        width, height = widths[n], heights[n]
        left = texel_on_axis(columns[n], width, rules[0])
        right = texel_on_axis(np.int32(columns[n] + one), width, rules[0])
        # Rows of texels run down.
        bottom, top = np.int32(height - one), np.int32(rows[n] + one)
        low = np.int32(bottom - texel_on_axis(rows[n], height, rules[1]))
        high = np.int32(bottom - texel_on_axis(top, height, rules[1]))
        low = np.int32(firsts[n] + np.int32(low * width))
        high = np.int32(firsts[n] + np.int32(high * width))
        left, right = np.int32(HALVES * left), np.int32(HALVES * right)
        low, high = np.int32(HALVES * low), np.int32(HALVES * high)
        low_left[n], low_right[n] = np.int32(low + left), np.int32(low + right)
        high_left[n], high_right[n] = np.int32(high + left), np.int32(high + right)


@disjoint_helper
def find_repeated(
    u, v, level, along, upward, low_left, low_right, high_left, high_right
):  # fmt: skip
    """
    Write what `find_positions` and `find_corners` do, of one level of a picture that is repeated.

    Takes its first texel, its width and its height.
    """
    first, width, height = level
    across, up = (
        np.float64(width) * texturing.TEXEL_STEPS,
        np.float64(height) * texturing.TEXEL_STEPS,
    )
    one, none = np.int32(1), np.int32(0)
    last_column, last_row = np.uint32(width - one), np.uint32(height - one)
    # Rows of texels run down.
    bottom = np.int32(HALVES * np.int32(first + np.int32(np.int32(height - one) * width)))
    step = np.int32(-HALVES * width)
    for n in range(u.shape[0]):
        x, y = u[n] - np.floor(u[n]), v[n] - np.floor(v[n])
        # NaN and infinity give the middle of texel 0.
        x = (np.floor(x * across + 0.5) / texturing.TEXEL_STEPS if x == x else 0.5) - 0.5
        y = (np.floor(y * up + 0.5) / texturing.TEXEL_STEPS if y == y else 0.5) - 0.5
        column, row = np.floor(x), np.floor(y)
        along[n], upward[n] = np.float32(x - column), np.float32(y - row)
        # They begin at -1, the largest unsigned integer.
        i, j = np.int32(column), np.int32(row)
        left, low = min(np.uint32(i), last_column), min(np.uint32(j), last_row)
        right, top = np.int32(i + one), np.int32(j + one)
        right, top = right if right < width else none, top if top < height else none
        left, right = np.int32(HALVES * np.int32(left)), np.int32(HALVES * right)
        low = np.int32(bottom + np.int32(np.int32(low) * step))
        high = np.int32(bottom + np.int32(top * step))
        low_left[n], low_right[n] = np.int32(low + left), np.int32(low + right)
        high_left[n], high_right[n] = np.int32(high + left), np.int32(high + right)


@disjoint_helper
def find_repeated_texel(u, v, level, texels):
    """
    Write the texel that holds each position, of one level of a picture that is repeated.

    Takes its first texel, its width and its height.
    """
    first, width, height = level
    across, up = (
        np.float64(width) * texturing.TEXEL_STEPS,
        np.float64(height) * texturing.TEXEL_STEPS,
    )
    none, bottom = np.int32(0), np.int32(height - np.int32(1))
    for n in range(u.shape[0]):
        x, y = u[n] - np.floor(u[n]), v[n] - np.floor(v[n])
        # NaN and infinity give the middle of texel 0.
        x = np.floor(x * across + 0.5) / texturing.TEXEL_STEPS if x == x else 0.5
        y = np.floor(y * up + 0.5) / texturing.TEXEL_STEPS if y == y else 0.5
        column, row = np.int32(x), np.int32(y)
        # Rounded up, they may be the first of the next period.
        column, row = column if column < width else none, row if row < height else none
        # Rows of texels run down.
        row = np.int32(np.int32(bottom - row) * width)
        texels[n] = np.int32(HALVES * np.int32(first + np.int32(row + column)))


@disjoint_helper
def fill_level(first, width, height, firsts, widths, heights):
    """Write first texel and size of one level for all samples."""
    for n in range(firsts.shape[0]):
        firsts[n], widths[n], heights[n] = first, width, height


@helper
def differences(values, count):
    """Return 0 if the first ``count`` values are equal."""
    found, first = np.int32(0), values[0]
    for n in range(count):
        found |= np.int32(values[n] != first)
    return found


@disjoint_helper
def count_runs(values):
    """Return how many runs of equal values there are."""
    count = np.int32(1)
    for n in range(values.shape[0] - 1):
        count += np.int32(values[n] != values[n + 1])
    return count


@helper
def gather_levels(size, coarser_by, first, last, levels, numbers):
    """
    Write first texel and size of each sample's mip level, or of that ``coarser_by`` 1.

    Takes the texture's first level, whose first texel the others' are counted from, and its last.
    """
    base = levels[first, texturing.FIRST_TEXEL]
    for n in range(np.uintp(size)):
        level = np.uintp(min(np.int64(numbers[LEVEL, n]) + coarser_by, last))
        numbers[FIRST, n] = np.int32(levels[level, texturing.FIRST_TEXEL] - base)
        numbers[WIDTH, n] = np.int32(levels[level, texturing.LEVEL_WIDTH])
        numbers[HEIGHT, n] = np.int32(levels[level, texturing.LEVEL_HEIGHT])


@helper
def rows_of(rows, first, start, stop):
    """Return four neighbouring rows."""
    return (
        part(rows, first, start, stop), part(rows, first + 1, start, stop),
        part(rows, first + 2, start, stop), part(rows, first + 3, start, stop),
    )  # fmt: skip


@disjoint_helper
def add_coarse(share, coarse, own):
    """Blend one channel of the coarser level into the finer one, where its weight is not 0."""
    for n in range(own.shape[0]):
        mixed = own[n] + share[n] * (coarse[n] - own[n])
        own[n] = mixed if share[n] > np.float32(0.0) else own[n]


@disjoint_helper
def add_tap(k, taps, own, mean):
    """Add tap ``k`` of each footprint to the running mean, one channel."""
    share = np.float32(1.0) / np.float32(k + 1)
    for n in range(own.shape[0]):
        before = own[n] if k == 0 else mean[n]
        mixed = before + share * (own[n] - before)
        mean[n] = mixed if np.int32(k) < taps[n] else before


@disjoint_helper
def divide_by_alpha(colors, alphas):
    """Divide one premultiplied channel by alpha; alpha 0 gives black."""
    none = np.float32(0.0)
    for n in range(colors.shape[0]):
        alpha = alphas[n]
        colors[n] = colors[n] / alpha if alpha > none else none


@disjoint_helper
def move_places(u, v, transform, moved_u, moved_v):
    """Apply a texture's transform to coordinates."""
    for n in range(u.shape[0]):
        moved_u[n] = transform[0] * u[n] + transform[1] * v[n] + transform[2]
        moved_v[n] = transform[3] * u[n] + transform[4] * v[n] + transform[5]


@disjoint_helper
def move_steps(u, v, transform, moved_u, moved_v):
    """Apply a texture's transform to steps."""
    for n in range(u.shape[0]):
        moved_u[n] = transform[0] * u[n] + transform[1] * v[n]
        moved_v[n] = transform[3] * u[n] + transform[4] * v[n]


@disjoint_helper
def measure_footprints(right_u, right_v, down_u, down_v, width, height, squared, taps):
    """Write the squared length of the longer step of each sample, in texels, and one tap."""
    for n in range(squared.shape[0]):
        right = texturing.length_squared((right_u[n], right_v[n]), width, height)
        down = texturing.length_squared((down_u[n], down_v[n]), width, height)
        squared[n], taps[n] = max(right, down), np.int32(1)


@disjoint_helper
def divide_footprints(right_u, right_v, down_u, down_v, size, limit, squared, taps, axis_u, axis_v):
    """Write length, taps and axis of each footprint; return the most taps of the first samples."""
    width, height, count = size
    most = np.int64(1)
    for n in range(count):
        right, down = (right_u[n], right_v[n]), (down_u[n], down_v[n])
        squared[n], parts, (axis_u[n], axis_v[n]) = texturing.long_footprint(
            texturing.length_squared(right, width, height),
            texturing.length_squared(down, width, height), right, down, limit,
        )  # fmt: skip
        taps[n] = np.int32(parts)
        most = max(most, parts)
    return most


@disjoint_helper
def split_details(squared, count, first, levels, shares):
    """Write the finer level of each sample, and the share of the coarser."""
    for n in range(squared.shape[0]):
        detail = texturing.level_of_detail(squared[n])
        finer, shares[n] = texturing.split_detail(detail, count)
        levels[n] = np.int32(first + finer)


@helper
def any_coarse(shares, count):
    """Return whether any of the first samples needs a coarser level."""
    found = np.int64(0)
    for n in range(count):
        found |= np.int64(shares[COARSER, n] > np.float32(0.0))
    return found != 0


@disjoint_helper
def place_taps(u, v, k, taps, axis_u, axis_v, tap_u, tap_v):
    """Write the position of tap ``k`` of each footprint."""
    for n in range(u.shape[0]):
        tap_u[n], tap_v[n] = texturing.tap_place((u[n], v[n]), (axis_u[n], axis_v[n]), k, taps[n])


@helper
def find_texels(u, v, is_mipped, coarser_by, row, levels, numbers, shares):
    """
    Write the texels around each position, and their weights.

    They are of the sample's level, or of that ``coarser_by`` 1, in rows `CORNERS`; one texel if the
    texture is not filtered.
    """
    size, level, start = u.shape[0], row[texturing.FIRST_LEVEL], np.int64(0)
    base, last = levels[level, texturing.FIRST_TEXEL], level + row[texturing.LEVEL_COUNT] - 1
    is_smooth = row[texturing.FILTER] != texturing.NEAREST
    details, corners = part(numbers, LEVEL, 0, size), rows_of(numbers, CORNERS, 0, size)
    along, upward = part(shares, ALONG, 0, size), part(shares, UPWARD, 0, size)
    is_repeated = (
        row[texturing.WRAP_U] == texturing.REPEAT and row[texturing.WRAP_V] == texturing.REPEAT
    )
    # Repeated textures, in runs of samples of one level.
    if is_repeated and (not is_mipped or count_runs(details) * EVEN_RUN <= size):
        while start < size:
            end = size
            if is_mipped:
                finer = details[start]
                end = range_end(details, start, finer, np.int32(finer + np.int32(1)))
                level = min(np.int64(finer) + coarser_by, last)
            texel, width, height = texturing.level_at(levels, level)
            extent = np.int32(texel - base), np.int32(width), np.int32(height)
            if is_smooth:
                find_repeated(
                    u[start:end], v[start:end], extent,
                    part(shares, ALONG, start, end), part(shares, UPWARD, start, end),
                    part(numbers, CORNERS, start, end), part(numbers, CORNERS + 1, start, end),
                    part(numbers, CORNERS + 2, start, end), part(numbers, CORNERS + 3, start, end),
                )  # fmt: skip
            else:
                find_repeated_texel(u, v, extent, corners[0])
            start = end
        return
    # The level of each sample.
    firsts, widths, heights = (
        part(numbers, FIRST, 0, size), part(numbers, WIDTH, 0, size), part(numbers, HEIGHT, 0, size)
    )  # fmt: skip
    if is_mipped:
        gather_levels(size, coarser_by, level, last, levels, numbers)
    else:
        texel, width, height = texturing.level_at(levels, level)
        fill_level(
            np.int32(texel - base), np.int32(width), np.int32(height), firsts, widths, heights
        )
    # Texels, wrapped as the texture asks.
    wraps = row[texturing.WRAP_U], row[texturing.WRAP_V]
    columns, rows = part(numbers, COLUMN, 0, size), part(numbers, ROW, 0, size)
    find_positions(
        u, v, widths, heights, (axis_rule(wraps[0]), axis_rule(wraps[1])),
        0.5 if is_smooth else 0.0, columns, rows, along, upward,
    )  # fmt: skip
    find_corners(
        columns, rows, firsts, widths, heights, (texel_rule(wraps[0]), texel_rule(wraps[1])),
        corners[0], corners[1], corners[2], corners[3],
    )  # fmt: skip


@disjoint_helper
def fill_row(numbers, number):
    """Write a number at all samples."""
    for n in range(numbers.shape[0]):
        numbers[n] = number


@helper
def codes_of(row, textures):
    """Return the level 0 of a picture of codes, as `mix_texels` takes it; of floats, no texel."""
    step, count = row[texturing.CODE_CHANNELS], np.int64(0)
    if step > 0:
        _, width, height = texturing.level_at(textures.levels, row[texturing.FIRST_LEVEL])
        count = width * height
    # Grey has one code for all three colours.
    to_green = np.int64(1 if step > 2 else 0)
    alphas = np.int64(texturing.SHARES if step % 2 == 0 else texturing.OPAQUE)
    return (
        textures.codes, row[texturing.FIRST_CODE], step, (to_green, 2 * to_green, step - 1),
        textures.curves, CODES * row[texturing.CODE_CURVE], CODES * alphas, HALVES * count,
    )  # fmt: skip


@helper
def read_level(row, textures, numbers, shares, target):
    """Write the filtered colours at positions whose texels are known."""
    size = target[0].shape[0]
    start, width, height = texturing.level_at(textures.levels, row[texturing.FIRST_LEVEL])
    corners, coded = rows_of(numbers, CORNERS, 0, size), codes_of(row, textures)
    weights = part(shares, ALONG, 0, size), part(shares, UPWARD, 0, size)
    is_smooth = row[texturing.FILTER] != texturing.NEAREST
    is_far = width * height > NEAR_TEXELS
    for n in range(0, size, CHANNELS):
        if is_smooth:
            mix_texels(textures.texels, start, corners, coded, weights, is_far, target, n)
        else:
            copy_texels(textures.texels, start, corners[0], coded, target, n)


@helper
def read_taps(
    u, v, first, is_mipped, level_count, tap_count, row, textures, places, lookup
):  # fmt: skip
    """
    Write the colours of neighbouring samples of one texture whose levels are known.

    Takes how many levels are mixed, one or two, and the most taps of any sample.
    """
    size, (numbers, shares, colors) = u.shape[0], lookup
    # The colour of a lone tap is the result.
    tap_row, start, tap_u, tap_v = np.int64(SHOWN), first, u, v
    if tap_count > 1:
        tap_row, start = np.int64(TAP), np.int64(0)
        tap_u, tap_v = part(places, TAP_U, 0, size), part(places, TAP_V, 0, size)
    taps = part(numbers, TAPS, 0, size)
    for k in range(tap_count):
        if tap_count > 1:
            place_taps(
                u, v, k, taps, part(places, AXIS_U, 0, size), part(places, AXIS_V, 0, size), tap_u,
                tap_v,
            )  # fmt: skip
        for coarser_by in range(level_count):
            find_texels(tap_u, tap_v, is_mipped, coarser_by, row, textures.levels, numbers, shares)
            is_finer = coarser_by == 0
            target_row = tap_row if is_finer else np.int64(COARSE)
            begin = start if is_finer else np.int64(0)
            target = rows_of(colors, target_row, begin, begin + size)
            read_level(row, textures, numbers, shares, target)
        for i in range(CHANNELS):
            tap = part(colors, tap_row + i, start, start + size)
            if level_count > 1:
                coarse = part(colors, COARSE + i, 0, size)
                add_coarse(part(shares, COARSER, 0, size), coarse, tap)
            if tap_count > 1:
                add_tap(k, taps, tap, part(colors, SHOWN + i, first, first + size))


@helper
def find_levels(first, count, owner, kind, textures, places, numbers, shares):
    """
    Choose the mip levels of neighbouring samples of one texture.

    Returns the most taps that any of them takes.
    """
    row, size = textures.table[owner, kind], whole_vectors(count)
    level, stop = np.int32(row[texturing.FIRST_LEVEL]), first + size
    levels, coarser, taps = (
        part(numbers, LEVEL, 0, size),
        part(shares, COARSER, 0, size),
        part(numbers, TAPS, 0, size),
    )
    right_u, right_v, down_u, down_v = rows_of(places, RIGHT_U, first, stop)
    if textures.transforms.shape[0] > 0:
        transform, moved = textures.transforms[owner, kind], rows_of(places, MOVED_U, 0, size)
        move_steps(right_u, right_v, transform, moved[0], moved[1])
        move_steps(down_u, down_v, transform, moved[2], moved[3])
        right_u, right_v, down_u, down_v = moved
    _, width, height = texturing.level_at(textures.levels, level)
    squared, tap_count = part(places, STEP_SQUARED, 0, size), np.int64(1)
    measure_footprints(right_u, right_v, down_u, down_v, width, height, squared, taps)
    if row[texturing.ANISOTROPY] > 1:
        tap_count = divide_footprints(
            right_u, right_v, down_u, down_v, (width, height, count), row[texturing.ANISOTROPY],
            squared, taps, part(places, AXIS_U, 0, size), part(places, AXIS_V, 0, size),
        )  # fmt: skip
    split_details(squared, np.int32(row[texturing.LEVEL_COUNT]), level, levels, coarser)
    return tap_count


@helper
def places_seen(first, size, owner, kind, textures, places):
    """Return the coordinates of neighbouring samples, with their texture's transform."""
    u, v = part(places, U, first, first + size), part(places, V, first, first + size)
    if textures.transforms.shape[0] > 0:
        moved_u, moved_v = part(places, MOVED_U, 0, size), part(places, MOVED_V, 0, size)
        move_places(u, v, textures.transforms[owner, kind], moved_u, moved_v)
        return moved_u, moved_v
    return u, v


@helper
def read_one_texture(first, count, owner, kind, textures, places, lookup):
    """Look up one object's texture at neighbouring samples; white without one."""
    numbers, shares, colors = lookup
    row, size = textures.table[owner, kind], whole_vectors(count)
    if row[texturing.FIRST_LEVEL] < 0:
        for i in range(CHANNELS):
            fill_row(part(colors, SHOWN + i, first, first + size), np.float32(1.0))
        return
    tap_count, level_count = np.int64(1), np.int64(1)
    is_mipped = row[texturing.FILTER] == texturing.TRILINEAR
    if is_mipped:
        tap_count = find_levels(first, count, owner, kind, textures, places, numbers, shares)
        level_count = np.int64(2 if any_coarse(shares, count) else 1)
    u, v = places_seen(first, size, owner, kind, textures, places)
    read_taps(u, v, first, is_mipped, level_count, tap_count, row, textures, places, lookup)
    if row[texturing.ALPHA_USE] == texturing.WEIGHTED:
        shown = rows_of(colors, SHOWN, first, first + size)
        for i in range(CHANNELS - 1):
            divide_by_alpha(shown[i], shown[3])


@helper
def owner_end(owners, first, count):
    """Return the first sample of another object than that of the sample ``first``."""
    if differences(owners[first:], count - first) == 0:
        return count
    end = first + 1
    while owners[end] == owners[first]:
        end += 1
    return end


@helper
def show_textures(places, lookup, count, kind, textures):
    """
    Look up textures of one kind at each sample of a row; white where an object has none.

    Parameters
    ----------
    places : (SCRATCH_ROWS, W) float64
        Reads rows U, V, OWNER and RIGHT_U of ``count`` samples.
    lookup : tuple
        What `lookup_memory` gave. Writes rows SHOWN of the last: linear RGBA.
    count : int
    kind : int
        ``BASE_COLOR`` ... ``EMISSIVE``. All of this is compiled into every place that calls it.
    textures : Textures
    """
    first = np.int64(0)
    while first < count:
        end = owner_end(places[OWNER], first, count)
        read_one_texture(
            first, end - first, np.int64(places[OWNER, first]), kind, textures, places, lookup
        )
        first = end


@stage
def read_textures(block: Block, count, kind: int64, textures: Textures):
    """
    Look up textures of one kind, ``BASE_COLOR`` ... ``EMISSIVE``, at each sample.

    Into rows SHOWN of ``colors``, linear RGBA; white where an object has none. After
    `find_coordinates`, and `find_steps` where a texture is mipmapped.
    """
    lookup = block.numbers, block.shares, block.colors
    show_textures(block.places, lookup, count, kind, textures)


@stage
def multiply_textures(block: Block, count):
    """Multiply the base colours by the texture colours."""
    for k in range(3):
        multiply_row(
            part(block.samples, rows.RED + k, 0, count), part(block.colors, SHOWN + k, 0, count)
        )


@stage
def multiply_textures_below_highlights(
    block: Block, count, materials: float32[:, ::1], first: int64
):
    """
    Multiply the lit colours by the texture colours, except for the highlights in them.

    The diffuse light on the vertices of Gouraud-shaded objects is in three rows of samples from
    ``first`` on.
    """
    samples, shown = block.samples, block.colors
    for k in range(block.counts[SEGMENTS]):
        segment = block.segments[k]
        s, e, owner = (
            np.int64(segment[START]),
            np.int64(segment[STOP]),
            np.uintp(segment[rows.OWNER]),
        )
        is_lit = np.int64(materials[owner, MATERIAL_MODEL]) == GOURAUD
        for i in range(3):
            colors, texels = part(samples, rows.RED + i, s, e), part(shown, SHOWN + i, s, e)
            if is_lit:
                absorb_row(colors, texels, part(samples, first + i, s, e))
            else:
                multiply_row(colors, texels)


def lookup_memory(room: int) -> tuple[Any, Any, Any]:
    """Return a thread's memory for looking up textures of up to ``room`` samples."""
    return (
        np.empty((INT_ROWS, room), np.int32),
        np.empty((SHARE_ROWS, room), np.float32),
        np.empty((COLOR_ROWS, room), np.float32),
    )


@helper
def absorb(color, texel, diffuse):
    """
    Multiply the diffuse part of a lit colour by a texel; the highlight in it stays.

    Computed as the colour less ``(1 - texel)`` of its diffuse part: exactly the colour if the texel
    is white.
    """
    if diffuse == color:
        return color * texel
    return max(color - diffuse * (np.float32(1.0) - texel), np.float32(0.0))


@disjoint_helper
def multiply_row(colors, texels):
    """Multiply one channel of the base colours by what the textures show."""
    for n in range(colors.shape[0]):
        colors[n] *= texels[n]


@disjoint_helper
def absorb_row(colors, texels, diffuse):
    """Multiply one channel of the base colours, but for the highlights in it, by the textures."""
    for n in range(colors.shape[0]):
        colors[n] = absorb(colors[n], texels[n], diffuse[n])
