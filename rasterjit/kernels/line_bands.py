"""
Draw many lines band by band, each band of rows small enough to stay in a core's own cache.

Random lines touch the whole picture, and a picture of 8 MB waits for memory at most pixels. So the
lines are first *binned*: each band of rows gets the list of the lines that may touch it, in order.
A band then draws its list, each line clipped to the band; a clipped line has the pixels of the
whole one (``rasterjit.kernels.lines``), and no two bands share a pixel. So the picture does not
depend on the bands, on the order in which they are drawn, nor on how many are drawn at once.

References
----------
.. [1] L. Seiler et al., "Larrabee: A Many-Core x86 Architecture for Visual Computing", ACM TOG
   27(3), 2008: bins that a core's cache holds.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import kernel, stage
from rasterjit.kernels.lines import draw_line_in_chunks, new_chunk

RECORD = 6
"""Words of a binned line: x0, y0, x1, y1, and RGBA of the start and of the end."""


@stage
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
def bin_lines(ends, colors, band_of_row, width, bands):
    """
    List the lines that may touch each band, in order.

    Parameters
    ----------
    ends : (N, 4) int64, pixels
        x and y of the start, x and y of the end; each in [-2**31, 2**31 - 1].
    colors : (N, 2) int32
        RGBA of the start and of the end, red in the lowest byte.
    band_of_row : (H,) int32
        Number of the band of each row of the target, ascending from 0.
    width, bands : int
        Columns of the target; bands in all.

    Returns
    -------
    starts : (bands + 1,) int64
        Band ``b`` has ``records[starts[b]:starts[b + 1]]``.
    records : (M, 6) int32
        Ends and colours of a line, once for each band that it may touch.
    """
    starts = np.zeros(bands + 1, np.int64)
    for line in range(ends.shape[0]):
        first, last = bands_of_line(ends, line, band_of_row, width)
        for band in range(first, last + 1):
            starts[band + 1] += 1
    for band in range(bands):
        starts[band + 1] += starts[band]
    records = np.empty((starts[bands], RECORD), np.int32)
    places = starts.copy()
    for line in range(ends.shape[0]):
        first, last = bands_of_line(ends, line, band_of_row, width)
        for band in range(first, last + 1):
            place = np.uintp(places[band])
            for k in range(4):
                records[place, k] = ends[line, k]
            records[place, 4], records[place, 5] = colors[line, 0], colors[line, 1]
            places[band] += 1
    return starts, records


@stage
def unpacked_color(rgba):
    """Return the four channels of a pixel, red in its lowest byte, as ``int64``."""
    bits = np.int64(rgba)
    return bits & 255, (bits >> 8) & 255, (bits >> 16) & 255, (bits >> 24) & 255


@kernel
def draw_band(band_pixels, top, records):
    """
    Draw the lines of one band, in order.

    Parameters
    ----------
    band_pixels : (rows, W) uint32, C-contiguous
        RGBA pixels of the band, red in the lowest byte. Written.
    top : int
        Row of the target at which the band begins.
    records : (M, 6) int32
        The band's part of what ``bin_lines`` returned.
    """
    height, width = band_pixels.shape
    pixels = band_pixels.reshape(-1)
    chunk = new_chunk()
    for line in range(records.shape[0]):
        x0, y0 = np.int64(records[line, 0]), np.int64(records[line, 1]) - top
        x1, y1 = np.int64(records[line, 2]), np.int64(records[line, 3]) - top
        start, end = unpacked_color(records[line, 4]), unpacked_color(records[line, 5])
        draw_line_in_chunks(pixels, chunk, width, height, (x0, y0, x1, y1), start, end)
