"""
Resample a picture under a warp, for another projection of the same view.

A pixel of the target covers a parallelogram of the source. Its colour is the mean of bilinear taps
spread evenly over that, about one per source sample along each side.
"""

from __future__ import annotations

import numpy as np

from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int64, uint8

MAX_TAPS_PER_SIDE = np.float64(16.0)


@helper
def count_taps(across, down):
    """Return the number of taps along a side with an extent across and down, samples."""
    length = np.sqrt(across * across + down * down)
    return np.int64(clamped(np.ceil(length - 1e-3), np.float64(1.0), MAX_TAPS_PER_SIDE))


@helper
def interpolate_bilinear(a, b, c, d, across, down):
    """Interpolate bilinearly between four values; equal ones give exactly themselves."""
    upper, lower = a + across * (b - a), c + across * (d - c)
    return np.float64(upper + down * (lower - upper))


@kernel
def filter_rows(
    source: float32[:, :, ::1], pictures: uint8[:, ::1], centers: float32[:, :, ::1],
    extents: float32[:, :, ::1], window: (int64, float64, float64, float64),
    row_range: (int64, int64), target: float32[:, :, ::1],
):  # fmt: skip
    """
    Write the filtered colours of some rows of pixels.

    Parameters
    ----------
    source : (h, w, C) float32
        The picture: one channel, or four, premultiplied by the last.
    pictures : (H, W) uint8
        Number of the picture that each pixel shows.
    centers : (H, W, 2) float32
        Position of each pixel's centre on the plane at distance 1 in front of its picture's eye.
    extents : (H, W, 4) float32
        Sides of each pixel's parallelogram on the plane, across and down: row's, then column's.
    window : (int, float, float, float)
        Number of this picture, samples for each unit of the plane, and the plane's origin.
    row_range : (int, int)
        First row, and one past the last.
    target : (H, W, C) float32
        Written where pixels show this picture.
    """
    picture, density, origin_x, origin_y = window
    height, width, channels = source.shape
    right_end, lower_end = np.float64(width - 1), np.float64(height - 1)
    for row in range(row_range[0], row_range[1]):
        for column in range(pictures.shape[1]):
            if np.int64(pictures[row, column]) != picture:
                continue
            x = np.float64(centers[row, column, 0]) * density + origin_x
            y = np.float64(centers[row, column, 1]) * density + origin_y
            xx = np.float64(extents[row, column, 0]) * density
            xy = np.float64(extents[row, column, 1]) * density
            yx = np.float64(extents[row, column, 2]) * density
            yy = np.float64(extents[row, column, 3]) * density
            row_taps, column_taps = count_taps(xx, xy), count_taps(yx, yy)
            step_x, step_y = 1.0 / np.float64(row_taps), 1.0 / np.float64(column_taps)
            red = green = blue = alpha = 0.0
            for j in range(column_taps):
                v = (np.float64(j) + 0.5) * step_y - 0.5
                for i in range(row_taps):
                    u = (np.float64(i) + 0.5) * step_x - 0.5
                    # Interpolate between samples' centres; clamp to the edge.
                    left = clamped(x + u * xx + v * yx - 0.5, 0.0, right_end)
                    top = clamped(y + u * xy + v * yy - 0.5, 0.0, lower_end)
                    first, upper = np.int64(left), np.int64(top)
                    p, q = np.float32(left - first), np.float32(top - upper)
                    second, lower = min(first + 1, width - 1), min(upper + 1, height - 1)
                    a, b = source[upper, first], source[upper, second]
                    c, d = source[lower, first], source[lower, second]
                    red += interpolate_bilinear(a[0], b[0], c[0], d[0], p, q)
                    if channels == 4:
                        green += interpolate_bilinear(a[1], b[1], c[1], d[1], p, q)
                        blue += interpolate_bilinear(a[2], b[2], c[2], d[2], p, q)
                        alpha += interpolate_bilinear(a[3], b[3], c[3], d[3], p, q)
            count = np.float64(row_taps * column_taps)
            target[row, column, 0] = np.float32(red / count)
            if channels == 4:
                target[row, column, 1] = np.float32(green / count)
                target[row, column, 2] = np.float32(blue / count)
                target[row, column, 3] = np.float32(alpha / count)
