"""
Draw Bresenham lines, exactly, at a cost bounded by the pixels that are seen.

A line of ``n = max(|dx|, |dy|)`` steps visits pixels ``k = 0..n``, both ends included. Along the
longer (*major*) axis it moves one pixel a step; along the other (*minor*) axis pixel ``k`` lies at
``floor(minor0 + k * dminor / n + 1/2)``, in absolute coordinates: a tie between two pixels goes
towards the larger coordinate whichever end comes first, so A to B and B to A visit the same
pixels. Each channel of its colour is ``floor(c0 + k * (c1 - c0) / n + 1/2)``: rounded half up,
exact at both ends. A line of zero length is one pixel of the start colour.

Everything about position and colour is integer arithmetic, and equals rational arithmetic for any
end points in [-2**31, 2**31 - 1].

Targets are ``(H, W) uint32`` views of ``(H, W, 4) uint8`` RGBA pictures, red in the lowest byte
(little-endian, as is every platform that Numba supports). Both sides are at most 16384.

How clipping keeps the pixels
-----------------------------
The visible pixels of a line are one run of steps, first to last. Both are found by division, and
the line is entered with the minor coordinate and the colours it has there: nothing is walked that
is not seen, and nothing that is seen moves.

How five running numbers stay exact
-----------------------------------
The minor coordinate and the four channels are fixed-point numbers with 48 fraction bits that gain
a constant each step: Bresenham's error term is the fraction, its overflow a carry. There is
nothing to test in the loop, so it is vectorised (twice as fast as the error term, measured).

Let ``v = a + k * b / n + 1/2`` be the exact value whose floor is wanted, ``a``, ``b``, ``k``, ``n``
integers. The running value is never below ``v``: the entry value and the gain are rounded up. It
is above ``v`` by less than ``1 / (2 n)``, because at most 16383 steps follow the entry and

* for ``n > 2**14`` entry and gain are each less than ``2**-48`` too large, together less than
  ``2**14 * 2**-48 = 2**-34 < 1 / (2 n)``, as ``n < 2**32``;
* for ``n <= 2**14`` the gain, ``b`` times a shared reciprocal, is at most ``|b| * 2**-48 <=
  2**-34`` too large, together less than ``2**14 * 2**-34 + 2**-48 < 2**-15 <= 1 / (2 n)``.

Now ``v`` is a multiple of ``1 / (2 n)``: it is an integer, or at least ``1 / (2 n)`` below the next
one. So both values have the same floor, at every pixel.

References
----------
.. [1] J. E. Bresenham, "Algorithm for computer control of a digital plotter", IBM Systems Journal
   4(1), 1965: the pixels.
.. [2] Y. P. Kuzmin, "Bresenham's line generation algorithm with built-in clipping", Computer
   Graphics Forum 14(5), 1995: entering a clipped line without moving its pixels.
"""

from __future__ import annotations

import numpy as np

from rasterjit.runtime.intrinsics import flat
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import int64, uint8, uint32

FRACTION_BITS = 48
"""Fraction bits of a running number; 14 bits of coordinate and a sign still fit ``int64``."""

FIXED_HALF = 1 << (FRACTION_BITS - 1)
"""One half in fixed point."""

MAX_SHARED_STEPS = 1 << 14
"""Most steps for which the five gains may share one reciprocal; see the module's notes."""

CHUNK_BITS = FRACTION_BITS // 2
"""Bits of a quotient found by one division: a remainder below 2**32, so shifted, fits ``int64``."""


@helper
def multiply_divide(a, b, divisor):
    """
    Return quotient and remainder of ``a * b / divisor``; no product exceeds ``int64``.

    For ``0 <= a, b < 2**34``, ``0 < divisor < 2**34`` and a quotient below ``2**47``.
    """
    high = a * (b >> 16)
    high_quotient = high // divisor
    low = ((high - high_quotient * divisor) << 16) + a * (b & 0xFFFF)
    low_quotient = low // divisor
    return (high_quotient << 16) + low_quotient, low - low_quotient * divisor


@helper
def divide_fixed(a, b):
    """Return ``a / b`` in fixed point, rounded up, for ``|a| <= 2**32``, ``0 < b < 2**32``."""
    whole = a // b
    high_part = (a - whole * b) << CHUNK_BITS
    high = high_part // b
    low_part = (high_part - high * b) << CHUNK_BITS
    return (whole << FRACTION_BITS) + (high << CHUNK_BITS) - (-low_part // b)


@helper
def find_entry_value(start, end, step, steps):
    """Return ``start + step * (end - start) / steps + 1/2`` in fixed point, rounded up."""
    if step == 0:
        return (start << FRACTION_BITS) + FIXED_HALF
    quotient, remainder = multiply_divide(abs(end - start), step, steps)
    if end < start:
        quotient, remainder = -quotient, -remainder
    return ((start + quotient) << FRACTION_BITS) + FIXED_HALF + divide_fixed(remainder, steps)


@helper
def find_gain(start, end, steps, reciprocal):
    """Return ``(end - start) / steps`` in fixed point, rounded up; see the module's notes."""
    change = end - start
    if steps > MAX_SHARED_STEPS:
        return divide_fixed(change, steps)
    return change * reciprocal + max(change, 0)


@helper
def find_entry_color(start, end, step, steps):
    """Return the four channels at ``step`` of the ramp between two colours, in fixed point."""
    return (
        find_entry_value(start[0], end[0], step, steps),
        find_entry_value(start[1], end[1], step, steps),
        find_entry_value(start[2], end[2], step, steps),
        find_entry_value(start[3], end[3], step, steps),
    )


@helper
def find_color_gain(start, end, steps, reciprocal):
    """Return the gains of the four channels each step, in fixed point."""
    return (
        find_gain(start[0], end[0], steps, reciprocal),
        find_gain(start[1], end[1], steps, reciprocal),
        find_gain(start[2], end[2], steps, reciprocal),
        find_gain(start[3], end[3], steps, reciprocal),
    )


@helper
def pack_channels(color):
    """Pack four channels into one RGBA pixel, red in the lowest byte."""
    return color[0] | (color[1] << 8) | (color[2] << 16) | (color[3] << 24)


@helper
def pack_fixed_color(color):
    """Pack four fixed-point channels into one RGBA pixel, red in the lowest byte."""
    return (
        (color[0] >> FRACTION_BITS)
        | ((color[1] >> FRACTION_BITS) << 8)
        | ((color[2] >> FRACTION_BITS) << 16)
        | ((color[3] >> FRACTION_BITS) << 24)
    )


@helper
def get_channel(pixel, channel):
    """Return a channel of a pixel as ``int64``; red, number 0, is its lowest byte."""
    return (np.int64(pixel) >> (8 * channel)) & 255


@helper
def unpack_color(pixel):
    """Return the four channels of a pixel as ``int64``."""
    return (
        get_channel(pixel, 0),
        get_channel(pixel, 1),
        get_channel(pixel, 2),
        get_channel(pixel, 3),
    )


@helper
def find_first_step(offset, steps, minor_steps, bias):
    """
    Return the first step whose minor offset is at least ``offset``, for ``offset > 0``.

    Step ``k`` has the minor offset ``floor((2 k minor_steps + bias) / (2 steps))``. Returns
    ``steps + 1`` if no step has the offset.
    """
    if offset > minor_steps:
        return steps + 1
    if steps <= MAX_SHARED_STEPS:
        return (2 * (steps * offset + minor_steps) - bias - 1) // (2 * minor_steps)
    quotient, remainder = multiply_divide(steps, offset, minor_steps)
    return quotient + (2 * remainder - bias + 2 * minor_steps - 1) // (2 * minor_steps)


@helper
def find_visible_steps(major_start, major_end, major_size, minor_start, minor_end, minor_size):
    """
    Return the first and the last step inside the target; first > last if none is.

    Takes the coordinates of both ends by axis, with the extent of the target along each.
    """
    steps = abs(major_end - major_start)
    minor_steps = abs(minor_end - minor_start)
    # Bound the steps along the major axis, where each step is one pixel.
    if major_end >= major_start:
        first = max(-major_start, 0)
        last = min(major_size - 1 - major_start, steps)
    else:
        first = max(major_start - (major_size - 1), 0)
        last = min(major_start, steps)
    # Measure the target along the minor axis from the start, in the line's direction; mirroring
    # keeps ties.
    if minor_end >= minor_start:
        nearest = -minor_start
        furthest = minor_size - 1 - minor_start
        bias = steps
    else:
        nearest = minor_start - (minor_size - 1)
        furthest = minor_start
        bias = steps - 1
    if furthest < 0:
        return first, first - 1
    if nearest > 0:
        first = max(first, find_first_step(nearest, steps, minor_steps, bias))
    return first, min(last, find_first_step(furthest + 1, steps, minor_steps, bias) - 1)


@helper
def is_inside(ends, width, height):
    """Return whether both ends, and so all pixels of a line, lie inside the target."""
    x0, y0, x1, y1 = ends
    return 0 <= x0 < width and 0 <= x1 < width and 0 <= y0 < height and 0 <= y1 < height


@helper
def draw_gradient_run(pixels, run, minor, minor_gain, color, gain):
    """
    Write the pixels of one visible run, all of them inside the target.

    ``run`` is the first and the last step, the index of the first pixel's major coordinate in the
    flat target, and the distance in the flat target of one pixel along each axis.
    """
    first, last, major_index, major_stride, minor_stride = run
    red, green, blue, alpha = color
    for _ in range(first, last + 1):
        index = np.uintp(major_index + (minor >> FRACTION_BITS) * minor_stride)
        pixels[index] = pack_fixed_color((red, green, blue, alpha))
        major_index += major_stride
        minor += minor_gain
        red, green, blue, alpha = red + gain[0], green + gain[1], blue + gain[2], alpha + gain[3]


@helper
def draw_run(pixels, run, minor, minor_gain, pixel):
    """Write the pixels of one visible run of one colour."""
    first, last, major_index, major_stride, minor_stride = run
    for _ in range(first, last + 1):
        pixels[np.uintp(major_index + (minor >> FRACTION_BITS) * minor_stride)] = pixel
        major_index += major_stride
        minor += minor_gain


@helper
def draw_visible_run(pixels, depth, slack, ramp, run, minor, minor_gain, pixel):
    """
    Write the pixels of one visible run of one colour that pass the depth test.

    Pixel ``k`` has the depth ``d0 + k * gain`` in ``float64``, ``ramp`` being d0 and the gain, and
    is drawn where that is at least ``depth - slack``; a NaN hides the whole line.
    """
    first, last, major_index, major_stride, minor_stride = run
    for step in range(first, last + 1):
        index = np.uintp(major_index + (minor >> FRACTION_BITS) * minor_stride)
        line_depth = ramp[0] + ramp[1] * np.float64(step)
        if line_depth >= np.float64(depth[index]) - np.float64(slack[index]):
            pixels[index] = pixel
        major_index += major_stride
        minor += minor_gain


@helper
def find_visible_run(ends, width, height):
    """
    Return the visible steps of a line, its way through the flat target, and its minor coordinates.

    First and last step (first > last if none is visible), number of all steps; index of the first
    visible pixel's major coordinate in the flat target, strides along the major and the minor axis;
    the minor coordinate at both ends.
    """
    # Choose the longer axis as the major one.
    x0, y0, x1, y1 = ends
    if abs(x1 - x0) >= abs(y1 - y0):
        major_start, major_end, major_size, major_stride = x0, x1, width, 1
        minor_start, minor_end, minor_size, minor_stride = y0, y1, height, width
    else:
        major_start, major_end, major_size, major_stride = y0, y1, height, width
        minor_start, minor_end, minor_size, minor_stride = x0, x1, width, 1
    # Find the visible steps.
    steps = abs(major_end - major_start)
    first, last = np.int64(0), steps
    if not is_inside(ends, width, height):
        first, last = find_visible_steps(
            major_start, major_end, major_size, minor_start, minor_end, minor_size
        )
    major_sign = 1 if major_end >= major_start else -1
    major_index = (major_start + major_sign * first) * major_stride
    strides = (major_index, major_sign * major_stride, minor_stride)
    return (first, last, steps), strides, (minor_start, minor_end)


@helper
def enter_line(ends, width, height):
    """
    Set up a line from its first visible pixel on.

    Returns its run for `draw_gradient_run` (first > last if nothing is visible); the minor
    coordinate there and its gain; the number of all steps, and its fixed-point reciprocal.
    """
    (first, last, steps), strides, (minor_start, minor_end) = find_visible_run(ends, width, height)
    reciprocal = (1 << FRACTION_BITS) // max(steps, 1)
    minor_gain = find_gain(minor_start, minor_end, steps, reciprocal)
    minor = np.int64(0)
    if first <= last:
        minor = find_entry_value(minor_start, minor_end, first, steps)
    return (first, last, strides[0], strides[1], strides[2]), minor, minor_gain, steps, reciprocal


@helper
def draw_line(pixels, width, height, ends, start_color, end_color):
    """
    Draw one line into a flat target of ``width * height`` pixels.

    ``ends`` is x and y of the start, x and y of the end; the colours are four ``int64`` each.
    """
    run, minor, minor_gain, steps, reciprocal = enter_line(ends, width, height)
    if run[0] > run[1]:
        return
    if start_color == end_color:
        draw_run(pixels, run, minor, minor_gain, pack_channels(start_color))
        return
    color = find_entry_color(start_color, end_color, run[0], steps)
    gain = find_color_gain(start_color, end_color, steps, reciprocal)
    draw_gradient_run(pixels, run, minor, minor_gain, color, gain)


@helper
def get_line_ends(ends, line):
    """Return the end points of one line as x, y, x, y."""
    return ends[line, 0], ends[line, 1], ends[line, 2], ends[line, 3]


@helper
def get_line_color(colors, line, end):
    """Return the colour of one end (0 or 1) of one line as four ``int64``."""
    return (
        np.int64(colors[line, end, 0]),
        np.int64(colors[line, end, 1]),
        np.int64(colors[line, end, 2]),
        np.int64(colors[line, end, 3]),
    )


@kernel
def draw_lines(target: uint32[:, ::1], ends: int64[:, ::1], colors: uint8[:, :, ::1]):
    """
    Draw a batch of lines, in order, clipped to the target.

    Parameters
    ----------
    target : (H, W) uint32, C-contiguous
        RGBA pixels, red in the lowest byte: the view of an ``(H, W, 4) uint8`` array.
    ends : (N, 4) int64, pixels
        x and y of the start, x and y of the end; each in [-2**31, 2**31 - 1].
    colors : (N, 2, 4) uint8, RGBA
        Colours of the start and of the end; if equal, a faster path writes the same pixels.

    Writes ``target``. Later lines draw over earlier ones.

    Notes
    -----
    The pixels and their colours are those of the unclipped line (module notes). A line of zero
    length is one pixel of the start colour; N = 0 draws nothing.
    """
    height, width = target.shape
    pixels = flat(target)
    for line in range(ends.shape[0]):
        line_ends = get_line_ends(ends, line)
        start, end = get_line_color(colors, line, 0), get_line_color(colors, line, 1)
        draw_line(pixels, width, height, line_ends, start, end)


@kernel
def draw_one_line(
    target: uint32[:, ::1], start: (int64, int64), end: (int64, int64), colors: (int64, int64)
):  # fmt: skip
    """
    Draw one line as `draw_lines` does.

    Parameters
    ----------
    target : (H, W) uint32, C-contiguous
        Written.
    start, end : (x, y), pixels
    colors : two pixels
        Colours of the start and of the end.
    """
    height, width = target.shape
    ends = start[0], start[1], end[0], end[1]
    draw_line(flat(target), width, height, ends, unpack_color(colors[0]), unpack_color(colors[1]))
