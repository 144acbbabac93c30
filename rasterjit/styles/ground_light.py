"""Blur counts of texels of a ground, and darken a picture of it where it lacks light."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.srgb_encoding import encode_row
from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.intrinsics import flat
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64, uint32


@helper
def add_across(source, radius, sums):
    """Write the sum of the texels around each in its row; those at the ends go on beyond."""
    last = source.shape[1] - 1
    for row in range(np.uintp(source.shape[0])):
        total = np.int32(0)
        for column in range(-radius, radius + 1):
            total += source[row, np.uintp(min(max(column, 0), last))]
        for column in range(last + 1):
            sums[row, np.uintp(column)] = total
            total += source[row, np.uintp(min(column + radius + 1, last))]
            total -= source[row, np.uintp(max(column - radius, 0))]


@disjoint_helper
def move_down(entering, leaving, sums, total):
    """Write running sums of columns, and move them on by a row."""
    for i in range(total.shape[0]):
        sums[i] = total[i]
        total[i] += entering[i] - leaving[i]


@helper
def add_down(source, radius, sums, total):
    """Write the sum of the texels around each in its column."""
    last = source.shape[0] - 1
    for i in range(np.uintp(total.shape[0])):
        total[i] = 0
        for row in range(-radius, radius + 1):
            total[i] += source[np.uintp(min(max(row, 0), last)), i]
    for row in range(last + 1):
        entering, leaving = min(row + radius + 1, last), max(row - radius, 0)
        move_down(source[entering], source[leaving], sums[row], total)


@kernel
def blur(
    counts: int32[:, ::1], radius: int64, blurred: int32[:, ::1], scratch: int32[:, ::1],
    total: int32[::1],
):  # fmt: skip
    """
    Blur counts by a box filter, twice.

    Parameters
    ----------
    counts : (H, W) int32
        Beyond them, those at the border go on. No sum leaves 32 bits.
    radius : int
        Texels of a side's half, without the one in the middle.
    blurred : (H, W) int32
        Written.
    scratch, total : (H, W) int32, (W,) int32
    """
    add_across(counts, radius, scratch)
    add_across(scratch, radius, blurred)
    add_down(blurred, radius, scratch, total)
    add_down(scratch, radius, blurred, total)


@disjoint_helper
def find_light_shares(columns_x, m, y, shade, side, shares):
    """Write the share of its light that each pixel of a row keeps: linear between texels."""
    one, last = np.float32(1.0), np.int32(side)
    u_row, v_row, w_row = m[0, 1] * y + m[0, 2], m[1, 1] * y + m[1, 2], m[2, 1] * y + m[2, 2]
    for i in range(shares.shape[0]):
        x = columns_x[i]
        u, v, w = m[0, 0] * x + u_row, m[1, 0] * x + v_row, m[2, 0] * x + w_row
        is_on = w > 0.0
        w = w if is_on else 1.0
        u, v = u / w, v / w
        is_on = is_on & (u > 0.0) & (u < 1.0) & (v > 0.0) & (v < 1.0)
        column = clamped(u * side - 0.5, 0.0, side - 1.0)
        row = clamped(v * side - 0.5, 0.0, side - 1.0)
        left, top = np.int32(column), np.int32(row)
        left = left if left < last - 2 else np.int32(last - 2)
        top = top if top < last - 2 else np.int32(last - 2)
        a, b = np.float32(column - np.float64(left)), np.float32(row - np.float64(top))
        at = np.int32(top * last + left)
        below = np.int32(at + last)
        upper = shade[np.uintp(at)] * (one - a) + shade[np.uintp(at + np.int32(1))] * a
        lower = shade[np.uintp(below)] * (one - a) + shade[np.uintp(below + np.int32(1))] * a
        shares[i] = one - (upper * (one - b) + lower * b) if is_on else one


@kernel
def darken_picture(
    map_from_screen: float64[:, ::1], shade: float32[:, ::1], palette: float32[:, ::1],
    table: int32[::1], codes: uint32[:, ::1], light: float32[:, ::1],
    columns_x: float64[::1], shares: float32[::1],
):  # fmt: skip
    """
    Darken a picture of the ground where light is missing.

    Parameters
    ----------
    map_from_screen : (3, 3) float64
        From (x, y, 1), each side of the screen from -1 to 1 and y up, to places on the map times w.
        What is behind the viewer has w below 0.
    shade : (S, S) float32
        Share of the light that is missing, of places in 0..1; beyond them none is.
    palette : (256, 4) float32, linear
        Colours of the picture by their red codes; of one colour, all are the same.
    table : (65536,) int32
        ``srgb_encoding.encoding_table``.
    codes : (H, W) uint32
        Changed: red, green, blue, alpha from the lowest byte up.
    light : (W, 4) float32
        Scratch memory.
    columns_x, shares : (W,) float64, (W,) float32
        The same: where columns are on the screen, and what share of its light a pixel keeps.

    Returns
    -------
    bool
        Whether any pixel lacks light.
    """
    side, is_dark, one = shade.shape[0], False, np.float32(1.0)
    height, width = np.float64(codes.shape[0]), np.float64(codes.shape[1])
    for column in range(np.uintp(codes.shape[1])):
        columns_x[column] = 2.0 * (np.float64(column) + 0.5) / width - 1.0
    for row in range(np.uintp(codes.shape[0])):
        # Find which pixels of the row lack light.
        y = 1.0 - 2.0 * (np.float64(row) + 0.5) / height
        find_light_shares(columns_x, map_from_screen, y, flat(shade), side, shares)
        first, end = np.int64(0), np.int64(codes.shape[1])
        while first < end and shares[np.uintp(first)] == one:
            first += 1
        while first < end and shares[np.uintp(end - 1)] == one:
            end -= 1
        if first == end:
            continue
        # Encode what is left, from the first of them to the last.
        is_dark = True
        for column in range(np.uintp(first), np.uintp(end)):
            code = np.uintp(codes[row, column] & np.uint32(255))
            for k in range(3):
                light[column, k] = palette[code, k] * shares[column]
            light[column, 3] = palette[code, 3]
        encode_row(flat(light[first:end]), table, codes[row, first:end])
    return is_dark
