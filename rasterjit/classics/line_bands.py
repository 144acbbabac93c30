"""
Draw many lines binned by bands of rows, each small enough to stay in a core's own cache.

Random lines touch the whole picture, and a picture of 8 MB waits for memory at most pixels. So the
lines are first *binned*: each band of rows gets the list of the lines that may touch it, in order.
A band then draws its list, each line clipped to the band; a clipped line has the pixels of the
whole one (``rasterjit.pipeline.bresenham``), and no two bands share a pixel. So the picture does
not depend on the bands, on the order in which they are drawn, nor on how many are drawn at once.

How chunks of 32-bit lanes stay exact
-------------------------------------
A line of at most 2**14 steps is drawn in chunks of 128 pixels. First their colours and offsets are
computed, 16 pixels an instruction, then written one by one. Each chunk starts from the
running numbers of ``bresenham``, 48 fraction bits, and goes on with 24 (channels) or 23 (minor
coordinate) of them, start and gain again rounded up. So no number is ever below its exact value
``v``. ``bresenham`` shows that only less than ``1 / (2 n)``, which is at least ``2**-15``, may be
added; it is

* in a channel, less than ``2**14 * 2**8 * 2**-48 = 2**-26`` by the shared reciprocal and less than
  ``128 * 2**-24 = 2**-17`` by the chunk;
* in the minor coordinate, at most ``2**14 * 2**14 * 2**-48 = 2**-20`` and less than
  ``128 * 2**-23 = 2**-16``.

The same bounds hold where the line is clipped, so it is entered without a division: with its start
and the gain times the first visible step.

References
----------
.. [1] J. E. Bresenham, "Algorithm for computer control of a digital plotter", IBM Systems Journal
   4(1), 1965: the pixels.
.. [2] L. Seiler et al., "Larrabee: A Many-Core x86 Architecture for Visual Computing", ACM TOG
   27(3), 2008: bins that a core's cache holds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import bresenham
from rasterjit.pipeline.bresenham import unpack_color
from rasterjit.runtime.intrinsics import flat
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import int32, int64, uint32

RECORD_WORDS = 6
"""Words of a binned line: x0, y0, x1, y1, and RGBA of the start and of the end."""

CHUNK_PIXELS = 128
"""Pixels whose colours and offsets are computed together, before any is written."""

VECTOR_PIXELS = 16
"""Pixels in the widest vector register; a chunk is filled in multiples of it."""

LANE_BITS = 24
"""Fraction bits of a channel in a chunk: with its 8 whole bits it fills ``uint32``."""

LANE_ROUNDING = (1 << (bresenham.FRACTION_BITS - LANE_BITS)) - 1
"""Added before surplus bits are shifted out, to round up."""

MINOR_BITS = 23
"""Fraction bits of the minor coordinate in a chunk: it moves up to 128 pixels either way."""

MINOR_ROUNDING = (1 << (bresenham.FRACTION_BITS - MINOR_BITS)) - 1
"""Added before surplus bits are shifted out, to round up."""

FRACTION_MASK = (1 << bresenham.FRACTION_BITS) - 1
"""Mask of the fraction of a running number."""


@helper
def find_bands(ends, line, band_of_row, width):
    """Return the first and the last band that a line may touch; first > last if there is none."""
    height = band_of_row.shape[0]
    left, right = min(ends[line, 0], ends[line, 2]), max(ends[line, 0], ends[line, 2])
    top, bottom = min(ends[line, 1], ends[line, 3]), max(ends[line, 1], ends[line, 3])
    if right < 0 or left >= width or bottom < 0 or top >= height:
        return 1, 0
    first = band_of_row[np.uintp(max(top, 0))]
    return np.int64(first), np.int64(band_of_row[np.uintp(min(bottom, height - 1))])


@kernel
def count_lines(
    ends: int64[:, ::1], band_of_row: int32[::1], width: int64, counts: int64[::1]
):  # fmt: skip
    """
    Count the lines that may touch each band.

    Parameters
    ----------
    ends : (N, 4) int64, pixels
        x and y of the start, x and y of the end; each in [-2**31, 2**31 - 1].
    band_of_row : (H,) int32
        Number of the band of each row of the target, ascending from 0.
    width : int
        Columns of the target.
    counts : (bands,) int64
        Added to.
    """
    for line in range(ends.shape[0]):
        first, last = find_bands(ends, line, band_of_row, width)
        for band in range(first, last + 1):
            counts[band] += 1


@kernel
def list_lines(
    ends: int64[:, ::1], colors: int32[:, ::1], band_of_row: int32[::1], width: int64,
    cursors: int64[::1], records: int32[:, ::1],
):  # fmt: skip
    """
    List the lines that may touch each band, in order.

    Parameters
    ----------
    ends, band_of_row, width
        As `count_lines` takes them.
    colors : (N, 2) int32
        RGBA of the start and of the end, red in the lowest byte.
    cursors : (bands,) int64
        Index of each band's next entry: at first, the sum of the counts before. Advanced.
    records : (M, 6) int32
        Writes ends and colours of a line, once for each band that it may touch.
    """
    for line in range(ends.shape[0]):
        first, last = find_bands(ends, line, band_of_row, width)
        for band in range(first, last + 1):
            entry = np.uintp(cursors[band])
            for k in range(4):
                records[entry, k] = ends[line, k]
            records[entry, 4], records[entry, 5] = colors[line, 0], colors[line, 1]
            cursors[band] += 1


@helper
def get_ends(records, line, top):
    """Return the end points of a binned line in a target that begins at row ``top``."""
    return (
        np.int64(records[line, 0]),
        np.int64(records[line, 1]) - top,
        np.int64(records[line, 2]),
        np.int64(records[line, 3]) - top,
    )


@helper
def is_short(ends):
    """Return whether a line has at most `MAX_SHARED_STEPS` steps."""
    return max(abs(ends[2] - ends[0]), abs(ends[3] - ends[1])) <= bresenham.MAX_SHARED_STEPS


@helper
def to_lane(value):
    """Convert a running number to ``LANE_BITS`` fraction bits, rounded up, modulo 2**32."""
    return np.uint32(
        ((value + LANE_ROUNDING) >> (bresenham.FRACTION_BITS - LANE_BITS)) & 0xFFFFFFFF
    )


@helper
def to_color_lanes(color):
    """Convert the four channels of a colour, or of its gain, as `to_lane` does."""
    return to_lane(color[0]), to_lane(color[1]), to_lane(color[2]), to_lane(color[3])


@helper
def to_minor_lane(value):
    """Convert a running number to ``MINOR_BITS`` fraction bits, rounded up."""
    return np.int32((value + MINOR_ROUNDING) >> (bresenham.FRACTION_BITS - MINOR_BITS))


@helper
def advance_color(color, gain, steps):
    """Return the colour, in fixed point, some steps after a given colour."""
    return (
        color[0] + steps * gain[0],
        color[1] + steps * gain[1],
        color[2] + steps * gain[2],
        color[3] + steps * gain[3],
    )


@helper
def advance_channel(start, gain, step):
    """Return a lane ``step`` pixels after the start of a chunk; the channel is its high byte."""
    return np.uint32(start + np.uint32(step * gain))


@helper
def fill_chunk(colors, offsets, count, color, gain, minor, minor_gain, strides):
    """
    Compute the colours of ``count`` pixels and their offsets from the first row's index.

    Colours and gains are lanes; so are the fraction of the minor coordinate at the first pixel
    and its gain. ``strides`` are the distances of one pixel along the major and the minor axis.
    """
    for step in range(count):
        k, i = np.uint32(step), np.int32(step)
        red = advance_channel(color[0], gain[0], k) >> np.uint32(24)
        green = advance_channel(color[1], gain[1], k) >> np.uint32(16)
        blue = advance_channel(color[2], gain[2], k) >> np.uint32(8)
        alpha = advance_channel(color[3], gain[3], k)
        colors[step] = np.uint32(
            red
            | (green & np.uint32(0xFF00))
            | (blue & np.uint32(0xFF0000))
            | (alpha & np.uint32(0xFF000000))
        )
        minor_steps = np.int32(minor + np.int32(i * minor_gain)) >> np.int32(MINOR_BITS)
        offsets[step] = np.int32(
            np.int32(np.int32(minor_steps) * strides[1]) + np.int32(i * strides[0])
        )


@helper
def draw_short_line(pixels, colors, offsets, width, height, ends, start_color, end_color):
    """
    Draw one line of at most `MAX_SHARED_STEPS` steps into a flat target.

    ``colors`` and ``offsets`` are scratch for one chunk.
    """
    (first, last, steps), strides, (minor_start, minor_end) = bresenham.find_visible_run(
        ends, width, height
    )
    reciprocal = (1 << bresenham.FRACTION_BITS) // max(steps, 1)
    minor_gain = bresenham.find_gain(minor_start, minor_end, steps, reciprocal)
    gain = bresenham.find_color_gain(start_color, end_color, steps, reciprocal)
    gain_lanes = to_color_lanes(gain)
    # Enter the line at its first visible step, with the minor coordinate's gain kept apart
    minor = bresenham.FIXED_HALF + first * minor_gain
    color = advance_color(bresenham.find_entry_color(start_color, end_color, 0, steps), gain, first)
    major_index, major_stride, minor_stride = strides
    for chunk in range(first, last + 1, CHUNK_PIXELS):
        count = min(last + 1 - chunk, CHUNK_PIXELS)
        # Fill whole vectors; pixels beyond the count are not drawn
        filled = (count + VECTOR_PIXELS - 1) & -VECTOR_PIXELS
        fraction, lane_gain = to_minor_lane(minor & FRACTION_MASK), to_minor_lane(minor_gain)
        steps_apart = (np.int32(major_stride), np.int32(minor_stride))
        fill_chunk(
            colors, offsets, filled, to_color_lanes(color), gain_lanes, fraction, lane_gain,
            steps_apart,
        )  # fmt: skip
        start = major_index + (minor_start + (minor >> bresenham.FRACTION_BITS)) * minor_stride
        for k in range(count):
            pixels[np.uintp(start + np.int64(offsets[k]))] = colors[k]
        major_index += CHUNK_PIXELS * major_stride
        minor += CHUNK_PIXELS * minor_gain
        color = advance_color(color, gain, CHUNK_PIXELS)


def make_scratch() -> tuple[NDArray[Any], ...]:
    """Return a thread's scratch memory for short lines: colours and offsets of a chunk."""
    return np.empty(CHUNK_PIXELS, np.uint32), np.empty(CHUNK_PIXELS, np.int32)


@kernel
def draw_short_lines(
    band_pixels: uint32[:, ::1], top: int64, records: int32[:, ::1], line: int64,
    scratch: (uint32[::1], int32[::1]),
):  # fmt: skip
    """
    Draw the lines of one band in order, from number ``line`` up to the next long one.

    Parameters
    ----------
    band_pixels : (rows, W) uint32, C-contiguous
        RGBA pixels of the band, red in the lowest byte. Written.
    top : int
        Row of the target at which the band begins.
    records : (M, 6) int32
        The band's part of what `list_lines` wrote.
    line : int
        In 0..M.
    scratch : (colours (CHUNK_PIXELS,) uint32, offsets (CHUNK_PIXELS,) int32)
        This thread's own.

    Returns
    -------
    int
        Number of the first line that is not drawn, for it has more than `MAX_SHARED_STEPS` steps; M
        if there is none.
    """
    height, width = band_pixels.shape
    pixels = flat(band_pixels)
    colors, offsets = scratch
    for number in range(line, records.shape[0]):
        ends = get_ends(records, number, top)
        if not is_short(ends):
            return number
        start, end = unpack_color(records[number, 4]), unpack_color(records[number, 5])
        draw_short_line(pixels, colors, offsets, width, height, ends, start, end)
    return records.shape[0]


@kernel
def draw_long_lines(
    band_pixels: uint32[:, ::1], top: int64, records: int32[:, ::1], line: int64
):  # fmt: skip
    """
    Draw the lines of one band in order, from number ``line`` up to the next short one.

    Parameters are those of ``draw_short_lines``, without the scratch. One function for both would
    have too few registers for short lines, which would be a tenth slower.

    Returns
    -------
    int
        Number of the first line that is not drawn; M if there is none.
    """
    height, width = band_pixels.shape
    pixels = flat(band_pixels)
    for number in range(line, records.shape[0]):
        ends = get_ends(records, number, top)
        if is_short(ends):
            return number
        start, end = unpack_color(records[number, 4]), unpack_color(records[number, 5])
        bresenham.draw_line(pixels, width, height, ends, start, end)
    return records.shape[0]
