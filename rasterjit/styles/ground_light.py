"""Blur counts on the map of a ground, and darken a picture of it by the missing light."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.srgb_encoding import encode_row
from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.intrinsics import flat
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64, uint32


@helper
def sum_rows(source, radius, sums):
    """Write the sum of the texels around each in its row; the border is extended outside."""
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
def advance_sums(entering, leaving, sums, total):
    """Write running sums of columns, and advance them by a row."""
    for i in range(total.shape[0]):
        sums[i] = total[i]
        total[i] += entering[i] - leaving[i]


@helper
def sum_columns(source, radius, sums, total):
    """Write the sum of the texels around each in its column."""
    last = source.shape[0] - 1
    for i in range(np.uintp(total.shape[0])):
        total[i] = 0
        for row in range(-radius, radius + 1):
            total[i] += source[np.uintp(min(max(row, 0), last)), i]
    for row in range(last + 1):
        entering, leaving = min(row + radius + 1, last), max(row - radius, 0)
        advance_sums(source[entering], source[leaving], sums[row], total)


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
        The border is extended outside. Sums must fit into 32 bits.
    radius : int
        Texels on each side of the middle one.
    blurred : (H, W) int32
        Written.
    scratch, total : (H, W) int32, (W,) int32
    """
    sum_rows(counts, radius, scratch)
    sum_rows(scratch, radius, blurred)
    sum_columns(blurred, radius, scratch, total)
    sum_columns(scratch, radius, blurred, total)


@disjoint_helper
def find_remaining_light(columns_x, m, y, shade, side, shares):
    """Write the share of light that remains at each pixel of a row, bilinear between texels."""
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
        above = np.int32(top * last + left)
        below = np.int32(above + last)
        upper = shade[np.uintp(above)] * (one - a) + shade[np.uintp(above + np.int32(1))] * a
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
        From NDC (x, y, 1) to (u, v, 1) times w, u and v being 0..1 on the map. Behind the viewer w
        is below 0.
    shade : (S, S) float32
        Share of the light that is missing on the map.
    palette : (256, 4) float32, linear
        Colours of the picture by their red codes; of one colour, all are the same.
    table : (65536,) int32
        ``srgb_encoding.make_encoding_table``.
    codes : (H, W) uint32
        Changed: red, green, blue, alpha from the lowest byte up.
    light : (W, 4) float32
        Scratch memory.
    columns_x, shares : (W,) float64, (W,) float32
        Scratch memory: NDC x of columns, and the remaining share of light of pixels.

    Returns
    -------
    bool
        Whether any pixel is darkened.
    """
    side, has_shadow, one = shade.shape[0], False, np.float32(1.0)
    height, width = np.float64(codes.shape[0]), np.float64(codes.shape[1])
    for column in range(np.uintp(codes.shape[1])):
        columns_x[column] = 2.0 * (np.float64(column) + 0.5) / width - 1.0
    for row in range(np.uintp(codes.shape[0])):
        # Find the first and last pixel of the row that lack light.
        y = 1.0 - 2.0 * (np.float64(row) + 0.5) / height
        find_remaining_light(columns_x, map_from_screen, y, flat(shade), side, shares)
        first, end = np.int64(0), np.int64(codes.shape[1])
        while first < end and shares[np.uintp(first)] == one:
            first += 1
        while first < end and shares[np.uintp(end - 1)] == one:
            end -= 1
        if first == end:
            continue
        # Encode the remaining light from the first to the last.
        has_shadow = True
        for column in range(np.uintp(first), np.uintp(end)):
            code = np.uintp(codes[row, column] & np.uint32(255))
            for k in range(3):
                light[column, k] = palette[code, k] * shares[column]
            light[column, 3] = palette[code, 3]
        encode_row(flat(light[first:end]), table, codes[row, first:end])
    return has_shadow
