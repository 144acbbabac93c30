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
from rasterjit.pipeline.records import Viewport
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64

SQUARED, NORMAL_X, NORMAL_Y = 0, 1, 2
"""Rows of scratch: squared distance to the nearest line, and a direction across it, any length."""
SCRATCH_ROWS = 3

VISIBLE, HIDDEN = 0, 1
"""Which parts of lines are drawn: those that no surface hides, or those that one does."""

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
def is_wanted(share, ramp, depth, slack, row, column):
    """Return whether a pixel shows the point at a share of a piece; see `approach_wanted`."""
    if depth.shape[0] == 0:
        return True
    near, rise, distance, part = ramp
    # Without occluders, depth has a single row.
    row = min(row, depth.shape[0] - 1)
    allowed = np.float64(depth[row, column]) - distance * np.float64(slack[row, column])
    is_seen = near + share * rise >= allowed
    return is_seen == (part == VISIBLE)


@helper
def approach_wanted(piece, ramp, depth, slack, first_row, reach, nearest):
    """
    Take a straight piece of a line where it is wanted, and nearer than all before.

    Parameters
    ----------
    piece : (float, float, float, float)
        x0, y0, x1, y1, pixels.
    ramp : (float, float, float, int)
        Stored depth at the first end, its change to the second, the largest distance from pixels
        to the line, pixels in x or y, and which part is wanted: `VISIBLE` or `HIDDEN`.
    depth, slack : (H, W), (1, W) or (0, W) float32
        As `stroke_lines` takes them; without rows all of the piece is wanted.
    first_row : int
        Of ``nearest``.
    reach : float
        Pixels farther than this may be left.
    nearest : (R, 3, W) float32
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
            if distance < found[SQUARED, column] and is_wanted(
                share, ramp, depth, slack, row, column
            ):
                is_beyond = (share == 0.0 or share == 1.0) and distance > MAX_SQUARED_AT_END
                is_beyond |= squared == 0.0
                found[SQUARED, column] = distance
                found[NORMAL_X, column] = np.float32(off_x if is_beyond else -along_y)
                found[NORMAL_Y, column] = np.float32(off_y if is_beyond else along_x)


@helper
def approach_piece(piece, first_row, reach, nearest):
    """Take a piece that nothing hides; see `approach_wanted`."""
    nothing = nearest[0][:0]
    ramp = 0.0, 0.0, 0.0, np.int64(VISIBLE)
    approach_wanted(piece, ramp, nothing, nothing, first_row, reach, nearest)


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


@kernel
def stroke_lines(
    line_list: int32[::1], ends: int32[:, ::1], depths: float64[:, ::1], rows: (int64, int64),
    viewport: Viewport, depth: float32[:, ::1], slack: float32[:, ::1], half_width: float64,
    part: int64, nearest: float32[:, :, ::1], area: float32[:, ::1],
):  # fmt: skip
    """
    Find the coverage of each pixel of a band by lines with round ends.

    Parameters
    ----------
    line_list, ends, depths, rows, viewport, depth, slack
        As `coverage.cover_lines` takes them.
    half_width : float
        Half the width of the lines, pixels.
    part : int
        Which parts of them: `VISIBLE` or `HIDDEN`.
    nearest : (R, 3, W) float32
        Scratch, from `make_scratch`.
    area : (R, W) float32
        Written: the share of each pixel, 0..1.
    """
    start_rows(nearest)
    per_pixel = 1.0 / np.float64(np.int64(1) << viewport.grid_bits)
    reach = half_width + REACH_PX
    hiding = depth if depths.shape[0] != 0 else depth[:0]
    for n in range(line_list.shape[0]):
        line = np.int64(line_list[n])
        piece = (
            np.float64(ends[line, 0]) * per_pixel, np.float64(ends[line, 1]) * per_pixel,
            np.float64(ends[line, 2]) * per_pixel, np.float64(ends[line, 3]) * per_pixel,
        )  # fmt: skip
        near = rise = 0.0
        if depths.shape[0] != 0:
            near, rise = depths[line, 0], depths[line, 1] - depths[line, 0]
        ramp = near, rise, reach, part
        approach_wanted(piece, ramp, hiding, slack, rows[0], reach, nearest)
    cover_rows(nearest, half_width, area)
