"""Kernel of the vignette: darken the pixels of some rows by their distance from the middle."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.srgb_encoding import encode
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64, uint32


@helper
def find_factor(x, y, corner, strength, start):
    """Return the light's factor, float32, at an offset from the image centre, pixels."""
    radius = np.sqrt(x * x + y * y) / corner
    t = min(max((radius - start) / (1.0 - start), 0.0), 1.0)
    return np.float32(1.0 - strength * (t * t * (3.0 - 2.0 * t)))


@kernel
def darken_rows(
    color: uint32[:, ::1], rows: (int64, int64), corner: (int64, int64), size: (int64, int64),
    strength: float64, start: float64, light: float32[::1], table: int32[::1],
):  # fmt: skip
    """
    Darken some rows of a picture, or of a part of one.

    Parameters
    ----------
    color : (H, W) uint32
        RGBA bytes in sRGB codes from the lowest up; changed in these rows, but for alpha.
    rows : (int, int)
        The first, and one past the last.
    corner : (int, int)
        Column and row, in the whole picture, of the first pixel of ``color``.
    size : (int, int)
        Width and height of the whole picture.
    strength, start : float
        As `rasterjit.Vignette` has them; ``start`` below 1.
    light : (256,) float32
        Linear light of each code.
    table : (65536,) int32
        `srgb_encoding.make_encoding_table`.
    """
    width, height = np.float64(size[0]), np.float64(size[1])
    corner_distance = 0.5 * np.sqrt(width * width + height * height)
    for row in range(rows[0], rows[1]):
        y = np.float64(corner[1] + row) + 0.5 - 0.5 * height
        for i in range(np.uintp(color.shape[1])):
            x = np.float64(corner[0] + np.int64(i)) + 0.5 - 0.5 * width
            factor, code = find_factor(x, y, corner_distance, strength, start), color[row, i]
            if factor < np.float32(1.0):
                out = code & np.uint32(0xFF000000)
                for channel in range(3):
                    shift = np.uint32(8 * channel)
                    index = np.uintp(code >> shift & np.uint32(255))
                    out |= encode(light[index] * factor, table) << shift
                color[row, i] = out
