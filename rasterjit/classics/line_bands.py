"""
Draw many lines binned by bands of rows, each small enough to stay in a core's own cache.

Random lines touch the whole picture, and a picture of 8 MB waits for memory at most pixels. So the
lines are first *binned*: each band of rows gets the list of the lines that may touch it, in order.
A band then draws its list, each line clipped to the band; a clipped line has the pixels of the
whole one (``rasterjit.pipeline.bresenham``), and no two bands share a pixel. So the picture does
not depend on the bands, on the order in which they are drawn, nor on how many are drawn at once.

How chunks of 32-bit lanes stay exact
-------------------------------------
A line of at most 2**14 steps is drawn in chunks of 128 pixels. First their colours and places are
computed, 16 pixels an instruction, then they are written one by one. Each chunk starts from the
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

RECORD = 6
"""Words of a binned line: x0, y0, x1, y1, and RGBA of the start and of the end."""

CHUNK = 128
"""Pixels whose colours and places are computed at once, before any of them is written."""

VECTOR = 16
"""Pixels in the widest vector register; a chunk is filled in multiples of it."""

LANE_BITS = 24
"""Fraction bits of a channel in a chunk: with its 8 whole bits it fills ``uint32``."""

LANE_ROUNDING = (1 << (bresenham.FRACTION_BITS - LANE_BITS)) - 1
"""Added before the surplus bits are cut off: rounds up."""

MINOR_BITS = 23
"""Fraction bits of the minor coordinate in a chunk: it moves up to 128 pixels either way."""

MINOR_ROUNDING = (1 << (bresenham.FRACTION_BITS - MINOR_BITS)) - 1
"""Added before the surplus bits are cut off: rounds up."""

FRACTION_MASK = (1 << bresenham.FRACTION_BITS) - 1
"""Mask of the fraction of a running number."""


@helper
def bands_of_line(ends, line, band_of_row, width):
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
        first, last = bands_of_line(ends, line, band_of_row, width)
        for band in range(first, last + 1):
            counts[band] += 1


@kernel
def list_lines(
    ends: int64[:, ::1], colors: int32[:, ::1], band_of_row: int32[::1], width: int64,
    places: int64[::1], records: int32[:, ::1],
):  # fmt: skip
    """
    List the lines that may touch each band, in order.

    Parameters
    ----------
    ends, band_of_row, width
        As `count_lines` takes them.
    colors : (N, 2) int32
        RGBA of the start and of the end, red in the lowest byte.
    places : (bands,) int64
        Where the next line of each band goes: at first, the sum of the counts before it. Advanced.
    records : (M, 6) int32
        Writes ends and colours of a line, once for each band that it may touch.
    """
    for line in range(ends.shape[0]):
        first, last = bands_of_line(ends, line, band_of_row, width)
        for band in range(first, last + 1):
            place = np.uintp(places[band])
            for k in range(4):
                records[place, k] = ends[line, k]
            records[place, 4], records[place, 5] = colors[line, 0], colors[line, 1]
            places[band] += 1


@helper
def record_ends(records, line, top):
    """Return the end points of a binned line in a target that begins at row ``top``."""
    return (
        np.int64(records[line, 0]),
        np.int64(records[line, 1]) - top,
        np.int64(records[line, 2]),
        np.int64(records[line, 3]) - top,
    )


@helper
def is_short(ends):
    """Return whether a line has at most ``SHORT_STEPS`` steps."""
    return max(abs(ends[2] - ends[0]), abs(ends[3] - ends[1])) <= bresenham.MAX_SHARED_STEPS


@helper
def lane(value):
    """Return a running number with ``LANE_BITS`` fraction bits, rounded up, modulo 2**32."""
    return np.uint32(
        ((value + LANE_ROUNDING) >> (bresenham.FRACTION_BITS - LANE_BITS)) & 0xFFFFFFFF
    )


@helper
def lanes(color):
    """Return the four channels of a colour or of its gain as ``lane`` does."""
    return lane(color[0]), lane(color[1]), lane(color[2]), lane(color[3])


@helper
def minor_lane(value):
    """Return a running number with ``MINOR_BITS`` fraction bits, rounded up."""
    return np.int32((value + MINOR_ROUNDING) >> (bresenham.FRACTION_BITS - MINOR_BITS))


@helper
def color_at(color, gain, steps):
    """Return the colour, in fixed point, some steps after a given one."""
    return (
        color[0] + steps * gain[0],
        color[1] + steps * gain[1],
        color[2] + steps * gain[2],
        color[3] + steps * gain[3],
    )


@helper
def channel_at(start, gain, step):
    """Return a lane ``step`` pixels after the start of a chunk; the channel is its high byte."""
    return np.uint32(start + np.uint32(step * gain))


@helper
def fill_chunk(colors, places, count, color, gain, minor, minor_gain, strides):
    """
    Compute the colours of ``count`` pixels and how far behind the first one's row they lie.

    Colours and gains are lanes; so are the fraction of the minor coordinate at the first pixel
    and its gain. ``strides`` are the distances of one pixel along the major and the minor axis.
    """
    for step in range(count):
        k, i = np.uint32(step), np.int32(step)
        red = channel_at(color[0], gain[0], k) >> np.uint32(24)
        green = channel_at(color[1], gain[1], k) >> np.uint32(16)
        blue = channel_at(color[2], gain[2], k) >> np.uint32(8)
        alpha = channel_at(color[3], gain[3], k)
        colors[step] = np.uint32(
            red
            | (green & np.uint32(0xFF00))
            | (blue & np.uint32(0xFF0000))
            | (alpha & np.uint32(0xFF000000))
        )
        minor_steps = np.int32(minor + np.int32(i * minor_gain)) >> np.int32(MINOR_BITS)
        places[step] = np.int32(
            np.int32(np.int32(minor_steps) * strides[1]) + np.int32(i * strides[0])
        )


@helper
def draw_short_line(pixels, colors, places, width, height, ends, start_color, end_color):
    """
    Draw one line of at most ``SHORT_STEPS`` steps into a flat target.

    ``colors`` and ``places`` are room for the pixels of one chunk.
    """
    (first, last, steps), strides, (minor_start, minor_end) = bresenham.find_visible_run(
        ends, width, height
    )
    reciprocal = (1 << bresenham.FRACTION_BITS) // max(steps, 1)
    minor_gain = bresenham.find_gain(minor_start, minor_end, steps, reciprocal)
    gain = bresenham.find_color_gain(start_color, end_color, steps, reciprocal)
    gain_lanes = lanes(gain)
    # Enter the line at its first visible step; what the minor coordinate gains is told apart
    minor = bresenham.FIXED_HALF + first * minor_gain
    color = color_at(bresenham.find_entry_color(start_color, end_color, 0, steps), gain, first)
    major_index, major_stride, minor_stride = strides
    for chunk in range(first, last + 1, CHUNK):
        count = min(last + 1 - chunk, CHUNK)
        # Fill whole vectors; what lies behind the count is not drawn
        filled = (count + VECTOR - 1) & -VECTOR
        fraction, lane_gain = minor_lane(minor & FRACTION_MASK), minor_lane(minor_gain)
        steps_apart = (np.int32(major_stride), np.int32(minor_stride))
        fill_chunk(
            colors, places, filled, lanes(color), gain_lanes, fraction, lane_gain, steps_apart
        )
        start = major_index + (minor_start + (minor >> bresenham.FRACTION_BITS)) * minor_stride
        for k in range(count):
            pixels[np.uintp(start + np.int64(places[k]))] = colors[k]
        major_index += CHUNK * major_stride
        minor += CHUNK * minor_gain
        color = color_at(color, gain, CHUNK)


def scratch_memory() -> tuple[NDArray[Any], ...]:
    """Return the memory that a thread needs to draw short lines: colours and places of a chunk."""
    return np.empty(CHUNK, np.uint32), np.empty(CHUNK, np.int32)


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
    scratch : (colours (CHUNK,) uint32, places (CHUNK,) int32)
        This thread's own.

    Returns
    -------
    int
        Number of the first line that is not drawn, for it has more than ``SHORT_STEPS`` steps; M
        if there is none.
    """
    height, width = band_pixels.shape
    pixels = flat(band_pixels)
    colors, places = scratch
    for number in range(line, records.shape[0]):
        ends = record_ends(records, number, top)
        if not is_short(ends):
            return number
        start, end = unpack_color(records[number, 4]), unpack_color(records[number, 5])
        draw_short_line(pixels, colors, places, width, height, ends, start, end)
    return records.shape[0]


@kernel
def draw_long_lines(
    band_pixels: uint32[:, ::1], top: int64, records: int32[:, ::1], line: int64
):  # fmt: skip
    """
    Draw the lines of one band in order, from number ``line`` up to the next short one.

    The counterpart of ``draw_short_lines``, of the same parameters but for the scratch. Apart,
    because a function that holds both paths has too few registers for the short one (a tenth
    slower, measured).

    Returns
    -------
    int
        Number of the first line that is not drawn; M if there is none.
    """
    height, width = band_pixels.shape
    pixels = flat(band_pixels)
    for number in range(line, records.shape[0]):
        ends = record_ends(records, number, top)
        if is_short(ends):
            return number
        start, end = unpack_color(records[number, 4]), unpack_color(records[number, 5])
        bresenham.draw_line(pixels, width, height, ends, start, end)
    return records.shape[0]
