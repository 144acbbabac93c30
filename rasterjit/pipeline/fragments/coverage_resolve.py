"""
Resolve opaque faces: average the faces of a pixel by coverage, in linear light or in codes.

Each face of a pixel is shaded once. Faces are stored in layers: the first face of every pixel, the
second one ... `list_coverage` lists the faces of several samples with their coverage,
``area_coverage`` those of exact areas. Layers are shaded like any visibility buffer, and
`accumulate_layers` sums colours.

Sums are premultiplied. A pixel with one face, or none, keeps every bit of its colour.

Whole pictures are accumulated here as well, for their mean in linear light. A product of two
float32 is exact in float64 and a sum of some hundred nearly so; the mean of equal colours has their
bits.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.fragments.compositing import empty_row, multiply_weight
from rasterjit.pipeline.srgb_encoding import encode, encode_channels
from rasterjit.pipeline.surface.sample_block import (
    ALPHA,
    INTERVAL_COLUMN,
    INTERVAL_COUNT,
    INTERVAL_ROW,
    INTERVAL_START,
    INTERVAL_STOP,
    Block,
)
from rasterjit.pipeline.visibility.tile_rasterizer import NOTHING
from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.intrinsics import flat
from rasterjit.runtime.jit import disjoint_helper, helper, kernel, stage
from rasterjit.runtime.state_block import float32, float64, int32, int64, uint32

COLUMNS_PER_BLOCK = 128
"""Columns whose samples are listed together."""


@disjoint_helper
def start_layers(faces, part, layers, weights, rest):
    """Start the layers of a row with the faces at the first sample, of weight ``part``."""
    zero = np.float32(0.0)
    for i in range(faces.shape[0]):
        face = faces[i]
        layers[i] = face
        weights[i] = zero if face < 0 else part
        rest[i] = part if face < 0 else zero


@helper
def add_to_layer(face, layer_face, weight, part):
    """
    Add a sample's face to a layer that holds the same face, or none.

    Returns the layer's face and coverage, and the face if it belongs to a later layer.
    """
    is_added = (face == layer_face) | (layer_face < 0)
    return (
        face if is_added else layer_face,
        weight + part if is_added & (face >= 0) else weight,
        np.int32(NOTHING) if is_added else face,
    )


@disjoint_helper
def add_first(faces, part, layers, weights, rest, remaining):
    """Add a sample to the first layer, and to the background's share; see `add_sample`."""
    any_left = np.int32(NOTHING)
    for i in range(faces.shape[0]):
        face = faces[i]
        layers[i], weights[i], remaining[i] = add_to_layer(face, layers[i], weights[i], part)
        rest[i] += part if face < 0 else np.float32(0.0)
        any_left = np.int32(any_left & remaining[i])
    return any_left >= 0


@disjoint_helper
def add_sample(faces, part, layers, weights, remaining):
    """Add the faces of a sample to a layer; return whether any belongs to a later layer."""
    any_left = np.int32(NOTHING)
    for i in range(faces.shape[0]):
        layers[i], weights[i], remaining[i] = add_to_layer(faces[i], layers[i], weights[i], part)
        any_left = np.int32(any_left & remaining[i])
    return any_left >= 0


@disjoint_helper
def clear_layer(layers, weights):
    """Clear a row of a layer."""
    for i in range(layers.shape[0]):
        layers[i] = NOTHING
        weights[i] = np.float32(0.0)


@disjoint_helper
def differ(faces, others):
    """Return whether two samples of a row of pixels show different faces anywhere."""
    bits = np.int32(0)
    for i in range(faces.shape[0]):
        bits = np.int32(bits | np.int32(faces[i] ^ others[i]))
    return bits != 0


@helper
def are_alike(opaque, row, left, right):
    """Return whether all samples of each pixel of a part of a row show one face."""
    for sample in range(1, opaque.shape[0]):
        if differ(opaque[0, row, left:right], opaque[sample, row, left:right]):
            return False
    return True


@helper
def list_columns(opaque, row, left, right, y, layers, weights, rest, remaining):
    """List the faces of a part of a row with their coverage; return the number of layers in use."""
    samples, count = np.int64(opaque.shape[0]), right - left
    part, used = np.float32(1.0) / np.float32(samples), np.int64(1)
    if are_alike(opaque, row, left, right):
        part, samples = np.float32(1.0), np.int64(1)
    start_layers(
        opaque[0, row, left:right], part, layers[0, y, left:right], weights[0, y, left:right],
        rest[y, left:right],
    )  # fmt: skip
    for sample in range(1, samples):
        faces = opaque[sample, row, left:right]
        has_left = add_first(
            faces, part, layers[0, y, left:right], weights[0, y, left:right],
            rest[y, left:right], remaining[0, :count],
        )  # fmt: skip
        layer = np.int64(1)
        while has_left:
            if layer == used:
                clear_layer(layers[layer, y, left:right], weights[layer, y, left:right])
                used += 1
            # Leftover faces alternate between two rows: arrays must not overlap.
            has_left = add_sample(
                remaining[(layer - 1) & 1, :count], part, layers[layer, y, left:right],
                weights[layer, y, left:right], remaining[layer & 1, :count],
            )  # fmt: skip
            layer += 1
    return used


@kernel
def list_coverage(
    opaque: int32[:, :, ::1], row_range: (int64, int64), layers: int32[:, :, ::1],
    weights: float32[:, :, ::1], rest: float32[:, ::1], remaining: int32[:, ::1],
):  # fmt: skip
    """
    List the faces of each pixel's samples, with their coverage.

    Parameters
    ----------
    opaque : (N, H, W) int32
        The face at each sample, -1 where there is none.
    row_range : (int, int)
        The first row, and one past the last.
    layers : (N, R, W) int32
        Written: the faces of each pixel of these rows, -1 after the last; as many layers as have
        any.
    weights : (N, R, W) float32
        Written: their shares, where there is a face.
    rest : (R, W) float32
        Written: the share of the samples that show no face.
    remaining : (2, C) int32
        Scratch memory; C is `COLUMNS_PER_BLOCK`.

    Returns
    -------
    int
        Number of layers with any face; at least 1.
    """
    most, columns = np.int64(1), opaque.shape[2]
    for row in range(row_range[0], row_range[1]):
        y = row - row_range[0]
        for left in range(0, columns, COLUMNS_PER_BLOCK):
            right = min(left + COLUMNS_PER_BLOCK, columns)
            used = list_columns(opaque, row, left, right, y, layers, weights, rest, remaining)
            for layer in range(most, used):
                # No earlier pixel has so many.
                for above in range(y):
                    empty_row(layers[layer, above])
                empty_row(layers[layer, y, :left])
            for layer in range(used, most):
                empty_row(layers[layer, y, left:right])
            most = max(most, used)
    return most


@helper
def is_mixed(weight, rest):
    """Return whether a pixel shows several faces, or a face and the background."""
    one = np.float32(1.0)
    return (weight != one) & (rest != one)


@disjoint_helper
def start_span(
    red, green, blue, alphas, has_alpha, weights, rest, mixed_red, mixed_green, mixed_blue,
    mixed_alpha,
):  # fmt: skip
    """Start the sums of a span of pixels: its first faces and the background, by coverage."""
    for i in range(weights.shape[0]):
        weight, uncovered = weights[i], rest[i]
        is_mix = is_mixed(weight, uncovered)
        back = uncovered * mixed_alpha[i]
        alpha = np.float32(1.0) - (uncovered - back)
        red1 = weight * red[i] + multiply_weight(back, mixed_red[i])
        green1 = weight * green[i] + multiply_weight(back, mixed_green[i])
        blue1 = weight * blue[i] + multiply_weight(back, mixed_blue[i])
        mixed_red[i] = red1 if is_mix else red[i]
        mixed_green[i] = green1 if is_mix else green[i]
        mixed_blue[i] = blue1 if is_mix else blue[i]
        face_alpha = alphas[i] if has_alpha != 0 else np.float32(1.0)
        mixed_alpha[i] = alpha if is_mix else face_alpha


@disjoint_helper
def add_span(red, green, blue, weights, mixed_red, mixed_green, mixed_blue):
    """Add another face to the sums of a span of pixels, by coverage; coverage 0 adds nothing."""
    for i in range(weights.shape[0]):
        weight = weights[i]
        mixed_red[i] += multiply_weight(weight, red[i])
        mixed_green[i] += multiply_weight(weight, green[i])
        mixed_blue[i] += multiply_weight(weight, blue[i])


@disjoint_helper
def divide_row(weights, rest, red, green, blue, alphas):
    """Divide the mixed pixels of a row by their alpha; branchless."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(weights.shape[0]):
        alpha = alphas[i]
        is_divided = is_mixed(weights[i], rest[i]) & (zero < alpha) & (alpha < one)
        alpha = alpha if is_divided else one
        red[i] /= alpha
        green[i] /= alpha
        blue[i] /= alpha


@disjoint_helper
def is_partly_covered(rest):
    """Return whether any pixel of a row shows a face and the background."""
    bits = np.int32(0)
    for i in range(rest.shape[0]):
        bits |= np.int32((rest[i] != np.float32(0.0)) & (rest[i] != np.float32(1.0)))
    return bits != 0


@stage
def accumulate_layers(
    block: Block, count, color_row: int64, has_alpha: int64, weights: float32[:, :, ::1],
    rest: float32[:, ::1], sums: float32[:, :, ::1],
):  # fmt: skip
    """
    Add the shaded faces to the sums of a band of rows, layer by layer.

    Parameters
    ----------
    block : Block
        Samples of the layers of a band, one layer below the other.
    color_row : int
        First of the three rows of colours to average: light or codes.
    has_alpha : int
        Not 0 if alphas may differ from 1.
    weights : (J, R, W) float32
        Coverage of the face in its pixel, layer by layer.
    rest : (R, W) float32
        The share that shows no face.
    sums : (R, 4, W) float32
        The background, straight alpha; changed.
    """
    s, height = block.samples, rest.shape[0]
    for k in range(block.counts[INTERVAL_COUNT]):
        interval = block.intervals[k]
        row, left = np.int64(interval[INTERVAL_ROW]), np.int64(interval[INTERVAL_COLUMN])
        first, end = np.int64(interval[INTERVAL_START]), np.int64(interval[INTERVAL_STOP])
        layer, right = row // height, left + end - first
        row -= layer * height
        if layer == 0:
            start_span(
                s[color_row, first:end], s[color_row + 1, first:end], s[color_row + 2, first:end],
                s[ALPHA, first:end], has_alpha, weights[layer, row, left:right],
                rest[row, left:right], sums[row, 0, left:right], sums[row, 1, left:right],
                sums[row, 2, left:right], sums[row, 3, left:right],
            )  # fmt: skip
        else:
            add_span(
                s[color_row, first:end], s[color_row + 1, first:end], s[color_row + 2, first:end],
                weights[layer, row, left:right], sums[row, 0, left:right],
                sums[row, 1, left:right], sums[row, 2, left:right],
            )  # fmt: skip


@kernel
def finish_light(
    weights: float32[:, ::1],
    rest: float32[:, ::1],
    sums: float32[:, :, ::1],
    table: int32[::1],
    linear: float32[:, :, ::1],
    color: uint32[:, ::1],
):
    """
    Write resolved colours, linear.

    Parameters
    ----------
    weights : (R, W) float32
        Weights of the first layer.
    rest : (R, W) float32
        The share that shows no face.
    sums : (R, 4, W) float32
        From `accumulate_layers`; overwritten.
    table : (65536,) int32
        `make_encoding_table`.
    linear : (R, W, 4) float32
        Written: linear RGBA with straight alpha; not if W is 0.
    color : (R, W) uint32
        Written: sRGB codes, RGBA bytes from the lowest up; not if W is 0.
    """
    for row in range(rest.shape[0]):
        red, green, blue, alpha = sums[row, 0], sums[row, 1], sums[row, 2], sums[row, 3]
        if is_partly_covered(rest[row]):
            divide_row(weights[row], rest[row], red, green, blue, alpha)
        encode_channels(red, green, blue, alpha, table, color[row])
        for i in range(linear.shape[1]):
            for k in range(4):
                linear[row, i, k] = sums[row, k, i]


@kernel
def finish_codes(
    weights: float32[:, ::1], rest: float32[:, ::1], sums: float32[:, :, ::1], color: uint32[:, ::1]
):
    """Write resolved colours as codes, as `finish_light` writes light: (R, W) uint32."""
    for row in range(rest.shape[0]):
        red, green, blue, alpha = sums[row, 0], sums[row, 1], sums[row, 2], sums[row, 3]
        if is_partly_covered(rest[row]):
            divide_row(weights[row], rest[row], red, green, blue, alpha)
        pack_codes(red, green, blue, alpha, color[row])


@disjoint_helper
def replace_by_codes(red, green, blue, table):
    """Replace light by its codes, 0..255, as float32."""
    for i in range(red.shape[0]):
        red[i] = np.float32(encode(red[i], table))
        green[i] = np.float32(encode(green[i], table))
        blue[i] = np.float32(encode(blue[i], table))


@stage
def encode_samples(block: Block, count, first_row: int64, table: int32[::1]):
    """Replace the light in the three rows of samples from ``first_row`` on by its codes."""
    s = block.samples
    replace_by_codes(
        s[first_row, :count], s[first_row + 1, :count], s[first_row + 2, :count], table
    )


@helper
def round_code(value):
    """Return a resolved code, rounded half up and clamped to 255."""
    value = value if value < np.float32(255.0) else np.float32(255.0)
    return np.uint32(np.int32(value + np.float32(0.5)))


@disjoint_helper
def pack_codes(red, green, blue, alpha, color):
    """Write mixed codes, given by channel; alpha is 0..1."""
    for i in range(color.shape[0]):
        opacity = clamped(alpha[i], np.float32(0.0), np.float32(1.0))
        color[i] = (
            round_code(red[i])
            | round_code(green[i]) << np.uint32(8)
            | round_code(blue[i]) << np.uint32(16)
            | np.uint32(np.int32(np.float64(opacity) * 255.0 + 0.5)) << np.uint32(24)
        )


@disjoint_helper
def is_opaque(linear):
    """Return whether alpha is 1 in all of a row of linear colour, four numbers each."""
    bits = np.uint32(0)
    for i in range(linear.shape[0] >> 2):
        bits |= np.uint32(linear[np.uintp(4 * i + 3)] != np.float32(1.0))
    return bits == np.uint32(0)


@disjoint_helper
def add_opaque_row(linear, sums):
    """Add a row in which alpha is 1: the same bits as `add_row`, in half the time."""
    for i in range(sums.shape[0]):
        sums[i] += np.float64(linear[i])


@disjoint_helper
def add_row(linear, sums):
    """Add a row of linear colour, four numbers each, to its sums; without branches."""
    for i in range(sums.shape[0] >> 2):
        n = np.uintp(4 * i)
        alpha = np.float64(linear[n + np.uintp(3)])
        red = alpha * np.float64(linear[n])
        green = alpha * np.float64(linear[n + np.uintp(1)])
        blue = alpha * np.float64(linear[n + np.uintp(2)])
        # Skip invisible colours: they may be infinite.
        is_seen = alpha > 0.0
        sums[n] += red if is_seen else 0.0
        sums[n + np.uintp(1)] += green if is_seen else 0.0
        sums[n + np.uintp(2)] += blue if is_seen else 0.0
        sums[n + np.uintp(3)] += alpha


@kernel
def add_picture(linear: float32[:, :, ::1], sums: float64[:, :, ::1]):
    """
    Add rows of linear colour to their sums.

    Parameters
    ----------
    linear : (R, W, 4) float32
        Straight alpha, 0..1.
    sums : (R, W, 4) float64
        Changed: the sums of colour times alpha, and of alpha.
    """
    for row in range(linear.shape[0]):
        row_colors, total = flat(linear[row]), flat(sums[row])
        if is_opaque(row_colors):
            add_opaque_row(row_colors, total)
        else:
            add_row(row_colors, total)


@kernel
def write_mean(
    sums: float64[:, :, ::1], count: int64, background: float32[::1], linear: float32[:, :, ::1]
):  # fmt: skip
    """
    Write the mean of pictures.

    Parameters
    ----------
    sums : (R, W, 4) float64
        From `add_picture`.
    count : int
        Number of pictures.
    background : (4,) float32
        Their background: its colour is kept where alpha is 0 in all of them.
    linear : (R, W, 4) float32
        Written: linear colour with straight alpha.
    """
    for row in range(linear.shape[0]):
        for i in range(linear.shape[1]):
            alpha = sums[row, i, 3]
            is_seen = alpha > 0.0
            for k in range(3):
                mean = sums[row, i, k] / (alpha if is_seen else 1.0)
                linear[row, i, k] = np.float32(mean) if is_seen else background[k]
            linear[row, i, 3] = np.float32(alpha / count)
