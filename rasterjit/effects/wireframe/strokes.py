"""
Draw antialiased lines of any width, with round ends and joints, by the distance to their middle.

For each pixel the nearest point of all lines is found. The pixel is covered as by a straight,
endless line through that point, at right angles to the direction there: exactly along a line,
whatever pieces it is made of, and nearly so around ends and corners. So pieces that continue each
other look like one line, and neither gaps nor dark spots tell where they meet.
"""

from __future__ import annotations

import numpy as np

from rasterjit.effects.wireframe.coverage import find_side_area, make_profile
from rasterjit.runtime.jit import helper

SQUARED, NORMAL_X, NORMAL_Y = 0, 1, 2
"""Rows of scratch: squared distance to the nearest line, and a direction across it, any length."""
SCRATCH_ROWS = 3

REACH_PX = 0.75
"""Distance beyond half the width to the centres of pixels that a line covers, with a margin."""

MAX_SQUARED_AT_END = np.float32(1.0 / 16.0)
"""Squared distance to an end up to which the direction across the line is that beside it."""


def make_scratch(rows: int, width: int) -> np.ndarray:
    """Return scratch memory for rows of an image of a width in pixels."""
    return np.empty((rows, SCRATCH_ROWS, width), np.float32)


def round_width(width: float) -> int:
    """Return a width in whole pixels, at least one, for lines that are not smooth."""
    return max(int(width + 0.5), 1)


@helper
def start_rows(nearest):
    """Set all pixels infinitely far from any line."""
    for row in range(nearest.shape[0]):
        for i in range(np.uintp(nearest.shape[2])):
            nearest[row, SQUARED, i] = np.float32(np.inf)


@helper
def approach_piece(piece, first_row, reach, nearest):
    """
    Take a straight piece of a line, (x0, y0, x1, y1) pixels, where it is nearer than all before.

    ``nearest`` holds rows from ``first_row`` on; pixels farther than ``reach`` are left.
    """
    x0, y0, x1, y1 = piece
    along_x, along_y = x1 - x0, y1 - y0
    squared = along_x * along_x + along_y * along_y
    per_squared = 1.0 / squared if squared > 0.0 else 0.0
    top = max(np.int64(np.ceil(min(y0, y1) - reach - 0.5)), first_row)
    bottom = min(np.int64(np.floor(max(y0, y1) + reach - 0.5)), first_row + nearest.shape[0] - 1)
    left = max(np.int64(np.ceil(min(x0, x1) - reach - 0.5)), 0)
    right = min(np.int64(np.floor(max(x0, x1) + reach - 0.5)), nearest.shape[2] - 1)
    for row in range(top, bottom + 1):
        y = np.float64(row) + 0.5 - y0
        found = nearest[row - first_row]
        for column in range(left, right + 1):
            x = np.float64(column) + 0.5 - x0
            share = (x * along_x + y * along_y) * per_squared
            share = min(max(share, 0.0), 1.0)
            off_x, off_y = x - share * along_x, y - share * along_y
            distance = np.float32(off_x * off_x + off_y * off_y)
            if distance < found[SQUARED, column]:
                is_beyond = (share == 0.0 or share == 1.0) and distance > MAX_SQUARED_AT_END
                is_beyond |= squared == 0.0
                found[SQUARED, column] = distance
                found[NORMAL_X, column] = np.float32(off_x if is_beyond else -along_y)
                found[NORMAL_Y, column] = np.float32(off_y if is_beyond else along_x)


@helper
def cover_rows(nearest, half_width, area):
    """Write the coverage of each pixel by a line of half a width, (R, W), 0..1."""
    half = np.float32(half_width)
    limit = np.float32(half_width + REACH_PX)
    limit *= limit
    for row in range(area.shape[0]):
        for i in range(np.uintp(area.shape[1])):
            squared = nearest[row, SQUARED, i]
            if not squared < limit:
                area[row, i] = np.float32(0.0)
                continue
            x = np.float64(nearest[row, NORMAL_X, i])
            y = np.float64(nearest[row, NORMAL_Y, i])
            length = np.sqrt(x * x + y * y)
            is_direction = length > 0.0
            profile = make_profile(
                x / length if is_direction else 1.0, y / length if is_direction else 0.0
            )
            distance = np.sqrt(squared)
            area[row, i] = find_side_area(half - distance, profile) + find_side_area(
                half + distance, profile
            )
