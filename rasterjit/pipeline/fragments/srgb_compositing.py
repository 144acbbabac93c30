"""
Composite or average colours as 8-bit sRGB codes, in integers.

A colour is a packed pixel: red, green, blue and alpha from the lowest byte up, alpha straight.
Codes are blended as if they were linear, and rounded half up after each blend. No-ops keep every
bit: a colour with alpha 0, anything behind alpha 255, the mean of equal samples.

References
----------
.. [1] T. Porter and T. Duff, "Compositing Digital Images", SIGGRAPH 1984: the over operator.
.. [2] J. Blinn, "Three Wrongs Make a Right", IEEE CG&A 15(6), 1995: dividing by 255 exactly.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.fragments.a_buffer import copy_row
from rasterjit.pipeline.fragments.compositing import are_alike
from rasterjit.pipeline.visibility.tile_rasterizer import NOTHING
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64, uint32

MAX_CODE = 255
"""Largest code; alpha of opaque colours."""

ALPHA_SHIFT = 24
"""Bit shift of alpha in a pixel."""


@helper
def get_channel(color, k):
    """Return a channel of a pixel, 0 for red to 3 for alpha."""
    return np.int64(color >> np.uint32(8 * k)) & MAX_CODE


@helper
def pack_pixel(red, green, blue, alpha):
    """Pack four channels into a pixel."""
    return np.uint32(red | green << 8 | blue << 16 | alpha << ALPHA_SHIFT)


@helper
def divide_rounded(numerator, denominator):
    """Return a quotient of whole numbers, rounded half up."""
    return (2 * numerator + denominator) // (2 * denominator)


@helper
def composite_over(front, back):
    """Composite a pixel with straight alpha over another one."""
    alpha, back_alpha = get_channel(front, 3), get_channel(back, 3)
    if alpha == MAX_CODE or (back_alpha == 0 and alpha > 0):
        return front
    if alpha == 0:
        return back
    front_weight, back_weight = MAX_CODE * alpha, (MAX_CODE - alpha) * back_alpha
    total = front_weight + back_weight
    return pack_pixel(
        divide_rounded(front_weight * get_channel(front, 0) + back_weight * get_channel(back, 0),
        total), divide_rounded(front_weight * get_channel(front,
        1) + back_weight * get_channel(back, 1), total),
        divide_rounded(front_weight * get_channel(front, 2) + back_weight * get_channel(back, 2),
        total), divide_rounded(total, MAX_CODE),
    )  # fmt: skip


@helper
def blend_channel(front, back, shift, alpha):
    """Blend one channel of a pixel over an opaque one; return the code shifted into place."""
    a = np.uint32(np.uint32(front >> shift) & np.uint32(MAX_CODE))
    b = np.uint32(np.uint32(back >> shift) & np.uint32(MAX_CODE))
    rest = np.uint32(np.uint32(MAX_CODE) - alpha)
    # x / 255 rounded half up is (x + 128) 257 / 65536, exactly, for the sums of two products.
    total = np.uint32(np.uint32(a * alpha) + np.uint32(b * rest))
    total = np.uint32(total + np.uint32(128))
    code = np.uint32(np.uint32(total + np.uint32(total >> np.uint32(8))) >> np.uint32(8))
    return np.uint32(code << shift)


@disjoint_helper
def composite_opaque_row(front, back):
    """Composite a row of pixels over opaque ones, in place; branchless."""
    for i in range(back.shape[0]):
        alpha = np.uint32(front[i] >> np.uint32(ALPHA_SHIFT))
        back[i] = (
            blend_channel(front[i], back[i], np.uint32(0), alpha)
            | blend_channel(front[i], back[i], np.uint32(8), alpha)
            | blend_channel(front[i], back[i], np.uint32(16), alpha)
            | np.uint32(0xFF000000)
        )


@helper
def composite_row(front, back):
    """Composite a row of pixels over others, in place."""
    for i in range(np.uintp(back.shape[0])):
        back[i] = composite_over(front[i], back[i])


@disjoint_helper
def is_opaque(color):
    """Return whether a row of pixels is opaque."""
    bits = np.uint32(0xFFFFFFFF)
    for i in range(color.shape[0]):
        bits = np.uint32(bits & color[i])
    return np.uint32(bits >> np.uint32(ALPHA_SHIFT)) == np.uint32(MAX_CODE)


@kernel
def mark_hidden(stack: uint32[:, :, ::1], level: int64, next_faces: int32[:, :]):
    """
    Mark the pixels that are hidden by a layer or a nearer one.

    Parameters
    ----------
    stack : (K+1, R, W) uint32
        Pixels of the layers, nearest first. Where a nearer layer hides this one, this one becomes
        opaque, invisibly, so that it hides the next in turn.
    level : int
        Number of the layer.
    next_faces : (R, W) int32
        Faces of the next layer; -1 is written where they are hidden.
    """
    previous = max(level - 1, 0)
    for row in range(next_faces.shape[0]):
        for i in range(np.uintp(next_faces.shape[1])):
            is_hidden = get_channel(stack[previous, row, i], 3) == MAX_CODE
            color = stack[previous, row, i] if is_hidden else stack[level, row, i]
            stack[level, row, i] = color
            if get_channel(color, 3) == MAX_CODE:
                next_faces[row, i] = NOTHING


@kernel
def composite_codes(stack: uint32[:, :, ::1], color: uint32[:, ::1]):
    """
    Composite layers back to front.

    Parameters
    ----------
    stack : (K+1, R, W) uint32
        Pixels of the layers, nearest first; 0 where there is none. The last is the background.
    color : (R, W) uint32
        Written.
    """
    last = stack.shape[0] - 1
    for row in range(color.shape[0]):
        copy_row(stack[last, row], color[row])
        if is_opaque(color[row]):
            for level in range(last - 1, -1, -1):
                composite_opaque_row(stack[level, row], color[row])
        else:
            for level in range(last - 1, -1, -1):
                composite_row(stack[level, row], color[row])


@helper
def composite_sample(sample, opaque, transparent, colors, background, row, i):
    """Return the colour of a sample, as a pixel."""
    layer = opaque[sample, row, i]
    color = colors[layer, row, i] if layer >= 0 else background[row, i]
    for level in range(transparent.shape[1] - 1, -1, -1):
        layer = transparent[sample, level, row, i]
        if layer >= 0:
            color = composite_over(colors[layer, row, i], color)
    return color


@kernel
def mix_codes(
    opaque: int32[:, :, ::1],
    transparent: int32[:, :, :, ::1],
    colors: uint32[:, :, ::1],
    background: uint32[:, ::1],
    color: uint32[:, ::1],
):
    """
    Write the mean of the codes of each pixel's samples.

    Parameters
    ----------
    opaque : (N, R, W) int32
    transparent : (N, K, R, W) int32
        Indices of faces, from ``compositing.list_faces``.
    colors : (J, R, W) uint32
        The pixels of these faces.
    background : (R, W) uint32
        The background.
    color : (R, W) uint32
        Written.
    """
    samples = np.int64(opaque.shape[0])
    for row in range(color.shape[0]):
        for i in range(np.uintp(color.shape[1])):
            code = composite_sample(0, opaque, transparent, colors, background, row, i)
            if not are_alike(opaque, transparent, row, i):
                red, green, blue, total = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
                for sample in range(samples):
                    code = composite_sample(sample, opaque, transparent, colors, background, row, i)
                    alpha = get_channel(code, 3)
                    red += alpha * get_channel(code, 0)
                    green += alpha * get_channel(code, 1)
                    blue += alpha * get_channel(code, 2)
                    total += alpha
                divisor = max(total, np.int64(1))
                code = pack_pixel(
                    divide_rounded(red, divisor), divide_rounded(green, divisor),
                    divide_rounded(blue, divisor), divide_rounded(total, samples),
                )  # fmt: skip
            color[row, i] = code


@kernel
def add_codes(color: uint32[:, :], sums: float64[:, :, ::1]):
    """
    Add rows of pixels to their sums.

    Parameters
    ----------
    color : (R, W) uint32
    sums : (R, W, 4) float64
        Changed: the sums of codes times alpha, and of alpha; whole numbers below 2**53.
    """
    for row in range(color.shape[0]):
        for i in range(np.uintp(color.shape[1])):
            alpha = get_channel(color[row, i], 3)
            for k in range(3):
                sums[row, i, k] += np.float64(alpha * get_channel(color[row, i], k))
            sums[row, i, 3] += np.float64(alpha)


@kernel
def write_mean_codes(
    sums: float64[:, :, ::1], count: int64, background: uint32[:, ::1], color: uint32[:, :]
):
    """
    Write the mean of pictures, each code rounded half up.

    Parameters
    ----------
    sums : (R, W, 4) float64
        From `add_codes`.
    count : int
        Number of pictures.
    background : (1, 1) uint32
        Their background: its colour is kept where alpha is 0 in all of them.
    color : (R, W) uint32
        Written.
    """
    for row in range(color.shape[0]):
        for i in range(np.uintp(color.shape[1])):
            total = np.int64(sums[row, i, 3])
            if total == 0:
                color[row, i] = np.uint32(background[0, 0] & np.uint32(0xFFFFFF))
                continue
            color[row, i] = pack_pixel(
                divide_rounded(np.int64(sums[row, i, 0]), total),
                divide_rounded(np.int64(sums[row, i, 1]), total),
                divide_rounded(np.int64(sums[row, i, 2]), total),
                divide_rounded(total, np.int64(count)),
            )


@kernel
def decode_rows(color: uint32[:, :], light: float32[::1], linear: float32[:, :, ::1]):
    """
    Decode codes to linear light, by a table.

    Parameters
    ----------
    color : (R, W) uint32
    light : (256,) float32
        Linear light of each code.
    linear : (R, W, 4) float32
        Written; alpha, which is linear, is divided by 255.
    """
    for row in range(color.shape[0]):
        for i in range(np.uintp(color.shape[1])):
            for k in range(3):
                linear[row, i, k] = light[np.uintp(get_channel(color[row, i], k))]
            alpha = np.float32(get_channel(color[row, i], 3))
            linear[row, i, 3] = alpha / np.float32(MAX_CODE)
