"""
Map scalars to colours: interpolate a number per vertex, then look it up in a colormap.

Value x has entry ``floor(count (x - low) / width)``, clamped to the map, or that of the last
threshold that is not above it; ``scene.colormap`` and ``scene.norm`` have the rules. A face with a
NaN or infinite vertex has the colour for NaN, stored after the entries.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import compute_sample_weights, interpolate
from rasterjit.pipeline.geometry.setup import get_face_vertices
from rasterjit.pipeline.records import Geometry
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.attributes import get_span_vertices
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.pipeline.surface.texture_lookup import TEXTURE_RED
from rasterjit.runtime.intrinsics import part, spread, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, kernel, stage
from rasterjit.runtime.state_block import float32, float64, int32, int64, uint8

SCALAR = 3
"""Row of ``doubles``: the scalar of each sample; the three rows before hold its face's vertices."""

FIRST_ENTRY, ENTRIES, FIRST_THRESHOLD = 0, 1, 2
"""Columns of ``entries``: an object's first entry, their number, and the index of the threshold at
which the first begins; negative where entries are evenly spaced."""

LOW, WIDTH = 0, 1
"""Columns of ``intervals``: the scalar of the first entry, and the width of the interval."""


@helper
def is_finite(value):
    """Tell whether a number is finite."""
    return value - value == 0.0


@helper
def interpolate_scalar(weights, value0, value1, value2):
    """Interpolate a scalar between three vertices; NaN or infinite if any of these is."""
    value = interpolate(weights, value0, value1, value2)
    total = value0 + value1 + value2
    return value if is_finite(total) else total


@helper
def gather_scalars(segment, values, ints, doubles):
    """Gather the scalars of some patches' vertices."""
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        n = np.uintp(ints[rows.FIRST_SAMPLE, r])
        spread(doubles[0], n, values[np.uintp(ints[rows.A, r])])
        spread(doubles[1], n, values[np.uintp(ints[rows.B, r])])
        spread(doubles[2], n, values[np.uintp(ints[rows.C, r])])


@disjoint_helper
def interpolate_scalars(scalars, at_a, at_b, at_c, second, third):
    """Write the scalars of samples, each of its own face."""
    for n in range(scalars.shape[0]):
        weights = 0.0, second[n], third[n]
        scalars[n] = interpolate_scalar(weights, at_a[n], at_b[n], at_c[n])


@disjoint_helper
def interpolate_span_scalars(scalars, second, third, at_a, at_b, at_c):
    """Write the scalars of samples of one face."""
    for n in range(scalars.shape[0]):
        weights = 0.0, second[n], third[n]
        scalars[n] = interpolate_scalar(weights, at_a, at_b, at_c)


@helper
def find_entry(value, low, width, count):
    """Return the index of a value's entry in a colormap; ``count`` for NaN and infinity."""
    position = (value - low) / width * np.float64(count)
    clamped = position if position >= 0.0 else 0.0
    clamped = clamped if clamped <= np.float64(count - 1) else np.float64(count - 1)
    is_valid = is_finite(value) and position == position
    return np.int64(clamped if is_valid else np.float64(count))


@helper
def find_first_above(value, levels, first, count):
    """Return the index of the first of ``count`` ascending levels that is above a value."""
    low, high = first, first + count
    while low < high:
        middle = (low + high) >> 1
        if levels[np.uintp(middle)] <= value:
            low = middle + 1
        else:
            high = middle
    return low


@helper
def find_threshold_entry(value, thresholds, first, count):
    """Return the index of the last threshold not above a value; ``count`` if it has no colour."""
    entry = find_first_above(value, thresholds, first, count) - first - 1
    return entry if is_finite(value) and entry >= 0 else np.int64(count)


@helper
def look_up_colors(out, scalars, interval, thresholds, entries, colors):
    """Write the colours of scalars, by a colormap."""
    low, width = interval
    first, count, first_threshold = entries
    for n in range(scalars.shape[0]):
        if first_threshold < 0:
            entry = first + find_entry(scalars[n], low, width, count)
        else:
            entry = first + find_threshold_entry(scalars[n], thresholds, first_threshold, count)
        for k in range(4):
            out[k][n] = colors[np.uintp(entry), k]


@helper
def fill_white(out):
    """Write white to four rows."""
    one = np.float32(1.0)
    for k in range(4):
        for n in range(out[k].shape[0]):
            out[k][n] = one


@stage
def apply_colormaps(
    block: Block, count, values: float64[::1], intervals: float64[:, ::1], thresholds: float64[::1],
    entries: int64[:, ::1], colors: float32[:, ::1],
):  # fmt: skip
    """
    Write the colour of each sample's scalar to the rows of texture colours: linear RGBA.

    White on objects without scalars.
    """
    ints, weights, doubles = block.ints, block.weights, block.doubles
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        s, e = np.int64(segment[rows.START]), np.int64(segment[rows.STOP])
        out = (
            part(block.colors, TEXTURE_RED, s, e), part(block.colors, TEXTURE_RED + 1, s, e),
            part(block.colors, TEXTURE_RED + 2, s, e), part(block.colors, TEXTURE_RED + 3, s, e),
        )  # fmt: skip
        if entries[owner, ENTRIES] == 0:
            fill_white(out)
            continue
        scalars = part(doubles, SCALAR, s, e)
        second, third = part(weights, 0, s, e), part(weights, 1, s, e)
        if segment[rows.KIND] == rows.MIXED:
            gather_scalars(segment, values, ints, doubles)
            interpolate_scalars(scalars, *three_parts(doubles, 0, s, e), second, third)
        else:
            a, b, c = get_span_vertices(segment, ints)
            interpolate_span_scalars(scalars, second, third, values[a], values[b], values[c])
        look_up_colors(
            out, scalars, (intervals[owner, LOW], intervals[owner, WIDTH]), thresholds,
            (
                entries[owner, FIRST_ENTRY], entries[owner, ENTRIES],
                entries[owner, FIRST_THRESHOLD],
            ), colors,
        )  # fmt: skip


@stage
def multiply_colormap_alphas(block: Block, count, is_blended: uint8[::1]):
    """Multiply the alphas of blended objects by those that `apply_colormaps` has written."""
    samples, colors = block.samples, block.colors
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        if is_blended[np.uintp(segment[rows.OWNER])] != 0:
            for n in range(np.uintp(segment[rows.START]), np.uintp(segment[rows.STOP])):
                samples[rows.ALPHA, n] *= colors[TEXTURE_RED + 3, n]


@kernel
def fill_scalars(
    face_id: int32[:, ::1], row_range: (int64, int64), geometry: Geometry, values: float64[::1],
    scalar: float32[:, ::1],
):  # fmt: skip
    """
    Write the interpolated scalar of each sample.

    Parameters
    ----------
    face_id : (H, W) int32
    row_range : (int, int)
        First row, and one past the last.
    geometry : Geometry
    values : (V,) float64
    scalar : (H, W) float32
        Written; NaN where nothing is.
    """
    for row in range(row_range[0], row_range[1]):
        for column in range(face_id.shape[1]):
            face = face_id[row, column]
            if face < 0:
                scalar[row, column] = np.nan
                continue
            a, b, c = get_face_vertices(geometry.faces, face)
            weights = compute_sample_weights(a, b, c, column, row, geometry)
            value = interpolate_scalar(weights, values[a], values[b], values[c])
            scalar[row, column] = np.float32(value)
