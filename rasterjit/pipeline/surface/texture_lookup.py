"""
Look up textures for a part of a row, in vectorized passes over rows of scratch memory.

``texture_filters`` has the formulas; here they are branchless. Wrap modes are numbers
(`encode_coordinate_wrap`, `encode_texel_wrap`), and every sample has the size of its mip level.
Positions are float64, texel indices int32, from the texture's first. Only the texel fetch goes
sample by sample: four channels at once of floats, code by code of codes. Colours come out as one
row per channel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.pipeline.records import GOURAUD, MATERIAL_MODEL, Textures
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface import texture_filters as texturing
from rasterjit.pipeline.surface.gather_samples import fill_row, four_parts, round_up_to_vectors
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.intrinsics import (
    CHANNELS,
    HALVES,
    copy_texels,
    find_range_end,
    mix_texels,
    part,
)
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int64

U, V, UV_OWNER = 0, 1, 2
"""Rows of ``uv_rows``: texture coordinates; the sample's object."""
RIGHT_U, RIGHT_V, DOWN_U, DOWN_V = 3, 4, 5, 6
"""Rows of ``uv_rows``: what the next sample to the right adds to u and v, and the next down."""
TRANSFORMED_U, TRANSFORMED_V = 7, 8
"""Rows of ``uv_rows``: coordinates after the current texture's transform."""
TAP_U, TAP_V = 9, 10
"""
Rows of ``uv_rows``: coordinates of one tap.

While mip levels are chosen, the four rows from `TRANSFORMED_U` on hold transformed steps.
"""
AXIS_U, AXIS_V = 11, 12
"""Rows of ``uv_rows``: the axis along which the taps of a footprint lie."""
STEP_SQUARED = 13
"""Row of ``uv_rows``: the squared length that determines the level of detail, texels."""

LEVEL, TAPS = 0, 1
"""Rows of ``lookup_ints``: the finer level, and the number of taps of a footprint."""
LEVEL_TEXEL, LEVEL_WIDTH, LEVEL_HEIGHT = 2, 3, 4
"""Rows of ``lookup_ints``: first texel and size of the level that is read."""
TEXEL_COLUMN, TEXEL_ROW = 5, 6
"""Rows of ``lookup_ints``: the texel left of and below a position, before wrapping."""
CORNERS = 7
"""
Four rows of ``lookup_ints``: the texels around a position, lower left first, upper right last.

In `HALVES` from the first of the picture.
"""

COARSER_WEIGHT, RIGHT_WEIGHT, UPPER_WEIGHT = 0, 1, 2
"""Rows of ``lookup_weights``: of the coarser level, of the texels to the right, of those above."""

TEXTURE_RED, COARSER_RED, TAP_RED = 0, CHANNELS, 2 * CHANNELS
"""First of four rows of ``colors``: the filtered colour, linear RGBA; a coarser level; one tap."""

MIN_MEAN_RUN_SAMPLES = 16
"""Least average run of samples of one mip level for reading level by level."""

MAX_CACHED_TEXELS = 1 << 15
"""Textures of up to so many texels, 512 KiB, stay in the caches near the core."""

CODES_PER_CURVE = 256
"""Entries of a curve: codes of 8 bits."""


@helper
def encode_coordinate_wrap(wrap):
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
def encode_texel_wrap(wrap):
    """
    Return the integers that encode how a wrap mode treats texels outside the texture.

    Periods that a texel is shifted by; textures in a period; 1 if the last is mirrored.
    """
    if wrap == texturing.CLAMP:
        return np.int32(0), np.int32(1), np.int32(0)
    if wrap == texturing.REPEAT:
        return np.int32(1), np.int32(1), np.int32(0)
    return np.int32(0), np.int32(2), np.int32(1)


@helper
def wrap_coordinate(u, size, rule):
    """
    Wrap a coordinate along an axis; return the position in texels, within about one period.

    NaN and infinity give the middle of texel 0.
    """
    lowest, highest, scale_before, subtracted_periods, scale_after = rule
    scaled = scale_before * min(max(u, lowest), highest)
    reduced = scale_after * (scaled - subtracted_periods * np.floor(scaled))
    position = (
        np.floor(reduced * (np.float64(size) * texturing.STEPS_PER_TEXEL) + 0.5)
        / texturing.STEPS_PER_TEXEL
    )
    return position if abs(u) < np.inf else 0.5


@helper
def wrap_texel(i, size, rule):
    """Wrap a texel index along an axis, at most one outside a period."""
    shifted_periods, textures_per_period, is_mirrored = rule
    shift, zero = np.int32(shifted_periods * size), np.int32(0)
    added, subtracted = shift if i < zero else zero, shift if i >= size else zero
    i = np.int32(np.int32(i + added) - subtracted)
    last = np.int32(np.int32(textures_per_period * size) - np.int32(1))
    return max(min(i, np.int32(last - np.int32(is_mirrored * i))), zero)


@disjoint_helper
def locate_texels(
    u, v, widths, heights, rules, offset, columns, rows, right_weights, upper_weights
):
    """
    Write the texel left of and below each position, not wrapped, and the weights of the next.

    With an offset of 0 instead of half a texel, write the texel that holds the position.
    """
    for n in range(u.shape[0]):
        x = wrap_coordinate(u[n], widths[n], rules[0]) - offset
        y = wrap_coordinate(v[n], heights[n], rules[1]) - offset
        column, row = np.floor(x), np.floor(y)
        right_weights[n], upper_weights[n] = np.float32(x - column), np.float32(y - row)
        columns[n], rows[n] = np.int32(column), np.int32(row)


@disjoint_helper
def find_corner_texels(
    columns, rows, firsts, widths, heights, rules, low_left, low_right, high_left, high_right
):  # fmt: skip
    """Write the indices of the four texels around each position, wrapped."""
    one = np.int32(1)
    for n in range(columns.shape[0]):
        width, height = widths[n], heights[n]
        left = wrap_texel(columns[n], width, rules[0])
        right = wrap_texel(np.int32(columns[n] + one), width, rules[0])
        # Rows of texels run down.
        bottom, top = np.int32(height - one), np.int32(rows[n] + one)
        low = np.int32(bottom - wrap_texel(rows[n], height, rules[1]))
        high = np.int32(bottom - wrap_texel(top, height, rules[1]))
        low = np.int32(firsts[n] + np.int32(low * width))
        high = np.int32(firsts[n] + np.int32(high * width))
        left, right = np.int32(HALVES * left), np.int32(HALVES * right)
        low, high = np.int32(HALVES * low), np.int32(HALVES * high)
        low_left[n], low_right[n] = np.int32(low + left), np.int32(low + right)
        high_left[n], high_right[n] = np.int32(high + left), np.int32(high + right)


@disjoint_helper
def find_repeated_corner_texels(
    u, v, level, right_weights, upper_weights, low_left, low_right, high_left, high_right
):  # fmt: skip
    """
    Write what `locate_texels` and `find_corner_texels` do, for one level of a repeated texture.

    Takes the level's first texel, width and height.
    """
    first, width, height = level
    across = np.float64(width) * texturing.STEPS_PER_TEXEL
    up = np.float64(height) * texturing.STEPS_PER_TEXEL
    one, zero = np.int32(1), np.int32(0)
    last_column, last_row = np.uint32(width - one), np.uint32(height - one)
    # Rows of texels run down.
    bottom = np.int32(HALVES * np.int32(first + np.int32(np.int32(height - one) * width)))
    step = np.int32(-HALVES * width)
    for n in range(u.shape[0]):
        x, y = u[n] - np.floor(u[n]), v[n] - np.floor(v[n])
        # NaN and infinity give the middle of texel 0.
        x = (np.floor(x * across + 0.5) / texturing.STEPS_PER_TEXEL if x == x else 0.5) - 0.5
        y = (np.floor(y * up + 0.5) / texturing.STEPS_PER_TEXEL if y == y else 0.5) - 0.5
        column, row = np.floor(x), np.floor(y)
        right_weights[n], upper_weights[n] = np.float32(x - column), np.float32(y - row)
        # Indices begin at -1, the largest unsigned integer.
        i, j = np.int32(column), np.int32(row)
        left, low = min(np.uint32(i), last_column), min(np.uint32(j), last_row)
        right, top = np.int32(i + one), np.int32(j + one)
        right, top = right if right < width else zero, top if top < height else zero
        left, right = np.int32(HALVES * np.int32(left)), np.int32(HALVES * right)
        low = np.int32(bottom + np.int32(np.int32(low) * step))
        high = np.int32(bottom + np.int32(top * step))
        low_left[n], low_right[n] = np.int32(low + left), np.int32(low + right)
        high_left[n], high_right[n] = np.int32(high + left), np.int32(high + right)


@disjoint_helper
def find_repeated_texels(u, v, level, texels):
    """
    Write the index of the texel that holds each position, for one level of a repeated texture.

    Takes the level's first texel, width and height.
    """
    first, width, height = level
    across = np.float64(width) * texturing.STEPS_PER_TEXEL
    up = np.float64(height) * texturing.STEPS_PER_TEXEL
    zero, bottom = np.int32(0), np.int32(height - np.int32(1))
    for n in range(u.shape[0]):
        x, y = u[n] - np.floor(u[n]), v[n] - np.floor(v[n])
        # NaN and infinity give the middle of texel 0.
        x = np.floor(x * across + 0.5) / texturing.STEPS_PER_TEXEL if x == x else 0.5
        y = np.floor(y * up + 0.5) / texturing.STEPS_PER_TEXEL if y == y else 0.5
        column, row = np.int32(x), np.int32(y)
        # Rounded up, a position may lie in the first texel of the next period.
        column, row = column if column < width else zero, row if row < height else zero
        # Rows of texels run down.
        row = np.int32(np.int32(bottom - row) * width)
        texels[n] = np.int32(HALVES * np.int32(first + np.int32(row + column)))


@disjoint_helper
def fill_level(first, width, height, firsts, widths, heights):
    """Write first texel and size of one level for all samples."""
    for n in range(firsts.shape[0]):
        firsts[n], widths[n], heights[n] = first, width, height


@helper
def differs_from_first(values, count):
    """Return whether any of the first ``count`` values differs from the first one."""
    differs, first = np.int32(0), values[0]
    for n in range(count):
        differs |= np.int32(values[n] != first)
    return differs != 0


@disjoint_helper
def count_equal_runs(values):
    """Return the number of runs of equal values."""
    count = np.int32(1)
    for n in range(values.shape[0] - 1):
        count += np.int32(values[n] != values[n + 1])
    return count


@helper
def gather_levels(size, level_offset, first, last, levels, ints):
    """
    Write first texel and size of each sample's mip level, or of that one coarser (offset 1).

    Takes the texture's first level, whose first texel the others' are counted from, and its last.
    """
    base = levels[first, texturing.FIRST_TEXEL]
    for n in range(np.uintp(size)):
        level = np.uintp(min(np.int64(ints[LEVEL, n]) + level_offset, last))
        ints[LEVEL_TEXEL, n] = np.int32(levels[level, texturing.FIRST_TEXEL] - base)
        ints[LEVEL_WIDTH, n] = np.int32(levels[level, texturing.LEVEL_WIDTH])
        ints[LEVEL_HEIGHT, n] = np.int32(levels[level, texturing.LEVEL_HEIGHT])


@disjoint_helper
def blend_coarser_level(weights, coarser, finer):
    """Blend one channel of the coarser level into the finer one, where its weight is not 0."""
    for n in range(finer.shape[0]):
        mixed = finer[n] + weights[n] * (coarser[n] - finer[n])
        finer[n] = mixed if weights[n] > np.float32(0.0) else finer[n]


@disjoint_helper
def accumulate_tap(k, taps, tap_colors, mean):
    """Add tap ``k`` of each footprint to the running mean, one channel."""
    weight = np.float32(1.0) / np.float32(k + 1)
    for n in range(tap_colors.shape[0]):
        previous = tap_colors[n] if k == 0 else mean[n]
        mixed = previous + weight * (tap_colors[n] - previous)
        mean[n] = mixed if np.int32(k) < taps[n] else previous


@disjoint_helper
def unpremultiply(colors, alphas):
    """Divide one premultiplied channel by alpha; alpha 0 gives black."""
    zero = np.float32(0.0)
    for n in range(colors.shape[0]):
        alpha = alphas[n]
        colors[n] = colors[n] / alpha if alpha > zero else zero


@disjoint_helper
def transform_uv(u, v, transform, transformed_u, transformed_v):
    """Apply a texture's transform to coordinates."""
    for n in range(u.shape[0]):
        transformed_u[n] = transform[0] * u[n] + transform[1] * v[n] + transform[2]
        transformed_v[n] = transform[3] * u[n] + transform[4] * v[n] + transform[5]


@disjoint_helper
def transform_uv_steps(step_u, step_v, transform, transformed_u, transformed_v):
    """Apply a texture's transform to steps."""
    for n in range(step_u.shape[0]):
        transformed_u[n] = transform[0] * step_u[n] + transform[1] * step_v[n]
        transformed_v[n] = transform[3] * step_u[n] + transform[4] * step_v[n]


@disjoint_helper
def measure_footprints(right_u, right_v, down_u, down_v, width, height, squared, taps):
    """Write the squared length of the longer step of each sample, in texels, and one tap."""
    for n in range(squared.shape[0]):
        right = texturing.square_length((right_u[n], right_v[n]), width, height)
        down = texturing.square_length((down_u[n], down_v[n]), width, height)
        squared[n], taps[n] = max(right, down), np.int32(1)


@disjoint_helper
def divide_footprints(
    right_u, right_v, down_u, down_v, size, max_parts, squared, taps, axis_u, axis_v
):
    """Write length, taps and axis of each footprint; return the most taps of the first samples."""
    width, height, count = size
    max_taps = np.int64(1)
    for n in range(count):
        right, down = (right_u[n], right_v[n]), (down_u[n], down_v[n])
        squared[n], parts, (axis_u[n], axis_v[n]) = texturing.make_anisotropic_footprint(
            texturing.square_length(right, width, height),
            texturing.square_length(down, width, height), right, down, max_parts,
        )  # fmt: skip
        taps[n] = np.int32(parts)
        max_taps = max(max_taps, parts)
    return max_taps


@disjoint_helper
def choose_levels(squared, count, first, levels, coarser_weights):
    """Write the finer level of each sample, and the share of the coarser."""
    for n in range(squared.shape[0]):
        detail = texturing.level_of_detail(squared[n])
        finer, coarser_weights[n] = texturing.split_level_of_detail(detail, count)
        levels[n] = np.int32(first + finer)


@helper
def needs_coarser_level(weights, count):
    """Return whether any of the first samples needs a coarser level."""
    any_coarser = np.int64(0)
    for n in range(count):
        any_coarser |= np.int64(weights[COARSER_WEIGHT, n] > np.float32(0.0))
    return any_coarser != 0


@disjoint_helper
def position_taps(u, v, k, taps, axis_u, axis_v, tap_u, tap_v):
    """Write the position of tap ``k`` of each footprint."""
    for n in range(u.shape[0]):
        tap_u[n], tap_v[n] = texturing.position_tap(
            (u[n], v[n]), (axis_u[n], axis_v[n]), k, taps[n]
        )


@helper
def find_texels_and_weights(u, v, is_mipped, level_offset, row, levels, ints, weights):
    """
    Write the texels around each position, and their weights.

    Of the sample's level, or of that one coarser (offset 1), in rows `CORNERS`; one texel if the
    texture is not filtered.
    """
    size, level, start = u.shape[0], row[texturing.FIRST_LEVEL], np.int64(0)
    base, last = levels[level, texturing.FIRST_TEXEL], level + row[texturing.LEVEL_COUNT] - 1
    is_smooth = row[texturing.FILTER] != texturing.NEAREST
    details, corners = part(ints, LEVEL, 0, size), four_parts(ints, CORNERS, 0, size)
    right_weights = part(weights, RIGHT_WEIGHT, 0, size)
    upper_weights = part(weights, UPPER_WEIGHT, 0, size)
    is_repeated = (
        row[texturing.WRAP_U] == texturing.REPEAT and row[texturing.WRAP_V] == texturing.REPEAT
    )
    # Repeated textures, in runs of samples of one level.
    if is_repeated and (not is_mipped or count_equal_runs(details) * MIN_MEAN_RUN_SAMPLES <= size):
        while start < size:
            end = size
            if is_mipped:
                finer = details[start]
                end = find_range_end(details, start, finer, np.int32(finer + np.int32(1)))
                level = min(np.int64(finer) + level_offset, last)
            texel, width, height = texturing.get_level(levels, level)
            extent = np.int32(texel - base), np.int32(width), np.int32(height)
            if is_smooth:
                find_repeated_corner_texels(
                    u[start:end], v[start:end], extent, part(weights, RIGHT_WEIGHT, start, end),
                    part(weights, UPPER_WEIGHT, start, end), part(ints, CORNERS, start, end),
                    part(ints, CORNERS + 1, start, end), part(ints, CORNERS + 2, start, end),
                    part(ints, CORNERS + 3, start, end),
                )  # fmt: skip
            else:
                find_repeated_texels(u, v, extent, corners[0])
            start = end
        return
    # The level of each sample.
    firsts, widths, heights = (
        part(ints, LEVEL_TEXEL, 0, size), part(ints, LEVEL_WIDTH, 0, size),
        part(ints, LEVEL_HEIGHT, 0, size)
    )  # fmt: skip
    if is_mipped:
        gather_levels(size, level_offset, level, last, levels, ints)
    else:
        texel, width, height = texturing.get_level(levels, level)
        fill_level(
            np.int32(texel - base), np.int32(width), np.int32(height), firsts, widths, heights
        )
    # Texels, wrapped as the texture asks.
    wraps = row[texturing.WRAP_U], row[texturing.WRAP_V]
    columns, rows = part(ints, TEXEL_COLUMN, 0, size), part(ints, TEXEL_ROW, 0, size)
    locate_texels(
        u, v, widths, heights, (encode_coordinate_wrap(wraps[0]), encode_coordinate_wrap(wraps[1])),
        0.5 if is_smooth else 0.0, columns, rows, right_weights, upper_weights,
    )  # fmt: skip
    find_corner_texels(
        columns, rows, firsts, widths, heights,
        (encode_texel_wrap(wraps[0]), encode_texel_wrap(wraps[1])), corners[0], corners[1],
        corners[2], corners[3],
    )  # fmt: skip


@helper
def describe_coded_level(row, textures):
    """Describe level 0 of a texture of codes for `mix_texels`; of floats, with no texels."""
    channels, texel_count = row[texturing.CODE_CHANNELS], np.int64(0)
    if channels > 0:
        _, width, height = texturing.get_level(textures.levels, row[texturing.FIRST_LEVEL])
        texel_count = width * height
    # Grey has one code for all three colours.
    to_green = np.int64(1 if channels > 2 else 0)
    alpha_curve = np.int64(texturing.LINEAR if channels % 2 == 0 else texturing.OPAQUE)
    return (
        textures.codes, row[texturing.FIRST_CODE], channels, (to_green, 2 * to_green, channels - 1),
        textures.curves, CODES_PER_CURVE * row[texturing.CODE_CURVE], CODES_PER_CURVE * alpha_curve,
        HALVES * texel_count,
    )  # fmt: skip


@helper
def read_level(row, textures, ints, weights, target):
    """Write the filtered colours at positions whose texels are known."""
    size = target[0].shape[0]
    start, width, height = texturing.get_level(textures.levels, row[texturing.FIRST_LEVEL])
    corners, coded = four_parts(ints, CORNERS, 0, size), describe_coded_level(row, textures)
    texel_weights = (
        part(weights, RIGHT_WEIGHT, 0, size),
        part(weights, UPPER_WEIGHT, 0, size),
    )
    is_smooth = row[texturing.FILTER] != texturing.NEAREST
    exceeds_cache = width * height > MAX_CACHED_TEXELS
    for n in range(0, size, CHANNELS):
        if is_smooth:
            mix_texels(
                textures.texels, start, corners, coded, texel_weights, exceeds_cache, target, n
            )
        else:
            copy_texels(textures.texels, start, corners[0], coded, target, n)


@helper
def read_taps(
    u, v, first_sample, is_mipped, level_count, tap_count, row, textures, uv_rows, lookup
):  # fmt: skip
    """
    Write the colours of neighbouring samples of one texture whose levels are known.

    Takes how many levels are mixed, one or two, and the most taps of any sample.
    """
    size, (ints, weights, colors) = u.shape[0], lookup
    # The colour of a lone tap is the result.
    tap_row, start, tap_u, tap_v = np.int64(TEXTURE_RED), first_sample, u, v
    if tap_count > 1:
        tap_row, start = np.int64(TAP_RED), np.int64(0)
        tap_u, tap_v = part(uv_rows, TAP_U, 0, size), part(uv_rows, TAP_V, 0, size)
    taps = part(ints, TAPS, 0, size)
    for k in range(tap_count):
        if tap_count > 1:
            position_taps(
                u, v, k, taps, part(uv_rows, AXIS_U, 0, size), part(uv_rows, AXIS_V, 0, size),
                tap_u, tap_v,
            )  # fmt: skip
        for level_offset in range(level_count):
            find_texels_and_weights(
                tap_u, tap_v, is_mipped, level_offset, row, textures.levels, ints, weights
            )
            is_finer = level_offset == 0
            target_row = tap_row if is_finer else np.int64(COARSER_RED)
            begin = start if is_finer else np.int64(0)
            target = four_parts(colors, target_row, begin, begin + size)
            read_level(row, textures, ints, weights, target)
        for i in range(CHANNELS):
            tap = part(colors, tap_row + i, start, start + size)
            if level_count > 1:
                coarser = part(colors, COARSER_RED + i, 0, size)
                blend_coarser_level(part(weights, COARSER_WEIGHT, 0, size), coarser, tap)
            if tap_count > 1:
                accumulate_tap(
                    k, taps, tap, part(colors, TEXTURE_RED + i, first_sample, first_sample + size)
                )


@helper
def find_levels(first, count, owner, kind, textures, uv_rows, ints, weights):
    """
    Choose the mip levels of neighbouring samples of one texture.

    Returns the most taps that any of them takes.
    """
    row, size = textures.table[owner, kind], round_up_to_vectors(count)
    level, stop = np.int32(row[texturing.FIRST_LEVEL]), first + size
    levels, coarser = part(ints, LEVEL, 0, size), part(weights, COARSER_WEIGHT, 0, size)
    taps = part(ints, TAPS, 0, size)
    right_u, right_v, down_u, down_v = four_parts(uv_rows, RIGHT_U, first, stop)
    if textures.transforms.shape[0] > 0:
        transform = textures.transforms[owner, kind]
        transformed = four_parts(uv_rows, TRANSFORMED_U, 0, size)
        transform_uv_steps(right_u, right_v, transform, transformed[0], transformed[1])
        transform_uv_steps(down_u, down_v, transform, transformed[2], transformed[3])
        right_u, right_v, down_u, down_v = transformed
    _, width, height = texturing.get_level(textures.levels, level)
    squared, tap_count = part(uv_rows, STEP_SQUARED, 0, size), np.int64(1)
    measure_footprints(right_u, right_v, down_u, down_v, width, height, squared, taps)
    if row[texturing.ANISOTROPY] > 1:
        tap_count = divide_footprints(
            right_u, right_v, down_u, down_v, (width, height, count), row[texturing.ANISOTROPY],
            squared, taps, part(uv_rows, AXIS_U, 0, size), part(uv_rows, AXIS_V, 0, size),
        )  # fmt: skip
    choose_levels(squared, np.int32(row[texturing.LEVEL_COUNT]), level, levels, coarser)
    return tap_count


@helper
def get_transformed_uv(first, size, owner, kind, textures, uv_rows):
    """Return the coordinates of neighbouring samples, with their texture's transform."""
    u, v = part(uv_rows, U, first, first + size), part(uv_rows, V, first, first + size)
    if textures.transforms.shape[0] > 0:
        transformed_u = part(uv_rows, TRANSFORMED_U, 0, size)
        transformed_v = part(uv_rows, TRANSFORMED_V, 0, size)
        transform_uv(u, v, textures.transforms[owner, kind], transformed_u, transformed_v)
        return transformed_u, transformed_v
    return u, v


@helper
def read_object_texture(first, count, owner, kind, textures, uv_rows, lookup):
    """Look up one object's texture at neighbouring samples; white without one."""
    ints, weights, colors = lookup
    row, size = textures.table[owner, kind], round_up_to_vectors(count)
    if row[texturing.FIRST_LEVEL] < 0:
        for i in range(CHANNELS):
            fill_row(part(colors, TEXTURE_RED + i, first, first + size), np.float32(1.0))
        return
    tap_count, level_count = np.int64(1), np.int64(1)
    is_mipped = row[texturing.FILTER] == texturing.TRILINEAR
    if is_mipped:
        tap_count = find_levels(first, count, owner, kind, textures, uv_rows, ints, weights)
        level_count = np.int64(2 if needs_coarser_level(weights, count) else 1)
    u, v = get_transformed_uv(first, size, owner, kind, textures, uv_rows)
    read_taps(u, v, first, is_mipped, level_count, tap_count, row, textures, uv_rows, lookup)
    if row[texturing.ALPHA_USE] == texturing.WEIGHTED:
        shown = four_parts(colors, TEXTURE_RED, first, first + size)
        for i in range(CHANNELS - 1):
            unpremultiply(shown[i], shown[3])


@helper
def find_object_end(owners, first, count):
    """Return the first sample of another object than that of the sample ``first``."""
    if not differs_from_first(owners[first:], count - first):
        return count
    end = first + 1
    while owners[end] == owners[first]:
        end += 1
    return end


@helper
def look_up_textures(uv_rows, lookup, count, kind, textures):
    """
    Look up textures of one kind at each sample of a row; white where an object has none.

    Parameters
    ----------
    uv_rows : (UV_ROWS, W) float64
        Reads rows U to RIGHT_U of ``count`` samples.
    lookup : tuple
        From `allocate_lookup_memory`. Writes the four rows from TEXTURE_RED on of the last.
    count : int
    kind : int
        ``BASE_COLOR`` ... ``EMISSIVE``. Every caller compiles all of this again.
    textures : Textures
    """
    first = np.int64(0)
    while first < count:
        end = find_object_end(uv_rows[UV_OWNER], first, count)
        read_object_texture(
            first, end - first, np.int64(uv_rows[UV_OWNER, first]), kind, textures, uv_rows, lookup
        )
        first = end


@stage
def read_textures(block: Block, count, kind: int64, textures: Textures):
    """
    Look up textures of one kind, ``BASE_COLOR`` ... ``EMISSIVE``, at each sample.

    Into the four rows from TEXTURE_RED on of ``colors``, linear RGBA; white where an object has
    none. After `interpolate_uv`, and `find_uv_steps` where a texture is mipmapped.
    """
    lookup = block.lookup_ints, block.lookup_weights, block.colors
    look_up_textures(block.uv_rows, lookup, count, kind, textures)


@stage
def multiply_textures(block: Block, count):
    """Multiply the base colours by the texture colours."""
    for k in range(3):
        multiply_row(
            part(block.samples, rows.RED + k, 0, count),
            part(block.colors, TEXTURE_RED + k, 0, count),
        )


@stage
def multiply_textures_below_highlights(
    block: Block, count, materials: float32[:, ::1], first_diffuse_row: int64
):
    """
    Multiply the lit colours by the texture colours, except for the highlights in them.

    The diffuse light on the vertices of Gouraud-shaded objects is in three rows of samples from
    ``first_diffuse_row`` on.
    """
    samples, texture_colors = block.samples, block.colors
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        s, e = np.int64(segment[rows.START]), np.int64(segment[rows.STOP])
        owner = np.uintp(segment[rows.OWNER])
        is_lit = np.int64(materials[owner, MATERIAL_MODEL]) == GOURAUD
        for i in range(3):
            colors = part(samples, rows.RED + i, s, e)
            texels = part(texture_colors, TEXTURE_RED + i, s, e)
            if is_lit:
                multiply_diffuse_row(colors, texels, part(samples, first_diffuse_row + i, s, e))
            else:
                multiply_row(colors, texels)


def allocate_lookup_memory(max_samples: int) -> tuple[Any, Any, Any]:
    """Allocate a thread's memory for looking up textures of up to ``max_samples`` samples."""
    return (
        np.empty((rows.LOOKUP_INT_ROWS, max_samples), np.int32),
        np.empty((rows.LOOKUP_WEIGHT_ROWS, max_samples), np.float32),
        np.empty((rows.TEXTURE_COLOR_ROWS, max_samples), np.float32),
    )


@helper
def multiply_diffuse_part(color, texel, diffuse):
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
    """Multiply one channel of the base colours by the texture colours."""
    for n in range(colors.shape[0]):
        colors[n] *= texels[n]


@disjoint_helper
def multiply_diffuse_row(colors, texels, diffuse):
    """Multiply one channel of the base colours, but for the highlights in it, by the textures."""
    for n in range(colors.shape[0]):
        colors[n] = multiply_diffuse_part(colors[n], texels[n], diffuse[n])
