"""
Mix the opaque faces of a pixel by the shares of it that show them, in linear light or in codes.

A pixel shows several faces, each shaded once. Layers hold them: the first face of every pixel, the
second one ... `find_shares` lists the faces of several samples with the share of the samples that
show them; ``area`` lists those of exact areas.

What is summed up is premultiplied: colour times alpha. A pixel that shows one face, or none, keeps
every bit of its colour.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.kernels import runs
from rasterjit.kernels.alpha import alpha_at, alpha_row
from rasterjit.kernels.jit import disjoint_stage, kernel, stage
from rasterjit.kernels.layers import seen_share
from rasterjit.kernels.records import Encoding, Geometry, Lighting, Placement, Surface
from rasterjit.kernels.resolve import between, encode, encode_channels
from rasterjit.kernels.shading import BLOCK_COLUMNS, shade_part, span_end, viewer_of
from rasterjit.kernels.tone_mapping import toned
from rasterjit.kernels.transparency import copy_row
from rasterjit.kernels.visibility import NOTHING

FILLED_COLUMNS = 8
"""Columns of a gap between faces that is filled."""


@disjoint_stage
def is_empty(faces):
    """Return whether a row of a layer is empty."""
    found = np.int32(NOTHING)
    for i in range(faces.shape[0]):
        found = np.int32(found & faces[i])
    return found < 0


@disjoint_stage
def start_shares(faces, part, shown, shares, rest):
    """Write what a row of pixels shows at the first sample, which is a part of the pixel."""
    none = np.float32(0.0)
    for i in range(faces.shape[0]):
        face = faces[i]
        shown[i] = face
        shares[i] = none if face < 0 else part
        rest[i] = part if face < 0 else none


@stage
def add_to_layer(face, here, share, part):
    """
    Add a face to a layer if it is there already, or if the layer has none yet.

    Returns the layer's face and its share, and the face if it is left to the layers behind.
    """
    is_here = (face == here) | (here < 0)
    more = share + part
    return (
        face if is_here else here,
        more if is_here & (face >= 0) else share,
        np.int32(NOTHING) if is_here else face,
    )


@disjoint_stage
def add_first(faces, part, shown, shares, rest, others):
    """Add a sample to the first layer, and to the share that shows no face; see `add_sample`."""
    found = np.int32(NOTHING)
    for i in range(faces.shape[0]):
        face = faces[i]
        shown[i], shares[i], others[i] = add_to_layer(face, shown[i], shares[i], part)
        rest[i] += part if face < 0 else np.float32(0.0)
        found = np.int32(found & others[i])
    return found >= 0


@disjoint_stage
def add_sample(faces, part, shown, shares, others):
    """Add the faces of a sample to a layer; return whether any are left to the layers behind."""
    found = np.int32(NOTHING)
    for i in range(faces.shape[0]):
        shown[i], shares[i], others[i] = add_to_layer(faces[i], shown[i], shares[i], part)
        found = np.int32(found & others[i])
    return found >= 0


@disjoint_stage
def clear_layer(shown, shares):
    """Begin with a row of a layer that holds no face."""
    for i in range(shown.shape[0]):
        shown[i] = NOTHING
        shares[i] = np.float32(0.0)


@stage
def fill_gaps(faces, shares):
    """
    Fill gaps of a few columns with the face before them, and a share of 0.

    Neighbours are shaded together, which is faster than to begin anew behind each gap.
    """
    last, i = np.int64(-FILLED_COLUMNS - 1), np.int64(0)
    while i < faces.shape[0]:
        face = faces[np.uintp(i)]
        if face >= 0:
            if i - last <= FILLED_COLUMNS:
                for k in range(last + 1, i):
                    faces[np.uintp(k)] = faces[np.uintp(last)]
                    shares[np.uintp(k)] = np.float32(0.0)
            last = i
        elif i % runs.LANES == 0 and is_empty(faces[i : i + runs.LANES]):
            i += runs.LANES - 1
        i += 1


@disjoint_stage
def differ(faces, others):
    """Return whether two samples of a row of pixels show different faces anywhere."""
    found = np.int32(0)
    for i in range(faces.shape[0]):
        found = np.int32(found | np.int32(faces[i] ^ others[i]))
    return found != 0


@stage
def are_alike(opaque, row, left, right):
    """Return whether all samples of each pixel of a part of a row show one face."""
    for sample in range(1, opaque.shape[0]):
        if differ(opaque[0, row, left:right], opaque[sample, row, left:right]):
            return False
    return True


@stage
def share_samples(opaque, row, left, right, shown, shares, rest, others):
    """List the faces of a part of a row with their shares; return how many layers have any."""
    samples, count = np.int64(opaque.shape[0]), right - left
    part, used = np.float32(1.0) / np.float32(samples), np.int64(1)
    if are_alike(opaque, row, left, right):
        part, samples = np.float32(1.0), np.int64(1)
    start_shares(
        opaque[0, row, left:right], part, shown[0, 0, :count], shares[0, 0, :count],
        rest[0, :count],
    )  # fmt: skip
    for sample in range(1, samples):
        faces = opaque[sample, row, left:right]
        goes_on = add_first(
            faces, part, shown[0, 0, :count], shares[0, 0, :count], rest[0, :count],
            others[0, :count],
        )  # fmt: skip
        layer = np.int64(1)
        while goes_on:
            if layer == used:
                clear_layer(shown[layer, 0, :count], shares[layer, 0, :count])
                used += 1
            # What is left over goes back and forth between two rows: arrays must not overlap.
            goes_on = add_sample(
                others[(layer - 1) & 1, :count], part, shown[layer, 0, :count],
                shares[layer, 0, :count], others[layer & 1, :count],
            )  # fmt: skip
            layer += 1
    for layer in range(1, used):
        fill_gaps(shown[layer, 0, :count], shares[layer, 0, :count])
    return used


@stage
def find_shares(opaque, row, left, right, shown, shares, rest, others):
    """
    Find the faces of a part of a row and their shares: those of its samples, if there are any.

    Returns how many layers there are, and where in them the part begins: row and column.
    """
    if opaque is None:
        return shown.shape[0], row, left
    used = share_samples(opaque, row, left, right, shown, shares, rest, others)
    return used, np.int64(0), np.int64(0)


@stage
def is_mixed(share, rest):
    """Return whether a pixel shows more than one face, or a face and what is behind all."""
    one = np.float32(1.0)
    return (share != one) & (rest != one)


@disjoint_stage
def start_span(
    red, green, blue, alphas, shares, rest, mixed_red, mixed_green, mixed_blue, mixed_alpha
):
    """Lay the first faces of a span of pixels, as far as they show them, over what is behind."""
    for i in range(shares.shape[0]):
        own, other = shares[i], rest[i]
        mixed = is_mixed(own, other)
        through = other * mixed_alpha[i]
        alpha = np.float32(1.0) - (other - through)
        red1 = own * red[i] + seen_share(through, mixed_red[i])
        green1 = own * green[i] + seen_share(through, mixed_green[i])
        blue1 = own * blue[i] + seen_share(through, mixed_blue[i])
        mixed_red[i] = red1 if mixed else red[i]
        mixed_green[i] = green1 if mixed else green[i]
        mixed_blue[i] = blue1 if mixed else blue[i]
        mixed_alpha[i] = alpha if mixed else alpha_at(alphas, i)


@disjoint_stage
def add_span(red, green, blue, shares, mixed_red, mixed_green, mixed_blue):
    """Add the shares of another face to a span of pixels; one with a share of 0 adds nothing."""
    for i in range(shares.shape[0]):
        share = shares[i]
        mixed_red[i] += seen_share(share, red[i])
        mixed_green[i] += seen_share(share, green[i])
        mixed_blue[i] += seen_share(share, blue[i])


@disjoint_stage
def divide_row(shares, rest, red, green, blue, alphas):
    """Divide the mixed pixels of a row by their alpha; without branches."""
    one, none = np.float32(1.0), np.float32(0.0)
    for i in range(shares.shape[0]):
        alpha = alphas[i]
        is_divided = is_mixed(shares[i], rest[i]) & (none < alpha) & (alpha < one)
        alpha = alpha if is_divided else one
        red[i] /= alpha
        green[i] /= alpha
        blue[i] /= alpha


@disjoint_stage
def shows_both(rest):
    """Return whether any pixel of a row shows a face and what is behind all."""
    found = np.int32(0)
    for i in range(rest.shape[0]):
        found |= np.int32((rest[i] != np.float32(0.0)) & (rest[i] != np.float32(1.0)))
    return found != 0


@stage
def some_alphas(alphas, start, stop):
    """Return the alphas of some gathered samples; ``None`` if all are opaque."""
    if alphas is None:
        return None
    return alphas[start:stop]


@stage
def mix_layer(layer, faces, colors, alphas, shares, rest, mixed):
    """Mix the gathered samples of a layer into a part of a row, given by channel."""
    n, at, columns = np.int64(0), np.int64(0), faces.shape[0]
    while at < columns:
        end = span_end(faces, at)
        if faces[at] >= 0:
            stop = n + end - at
            own = colors[0][n:stop], colors[1][n:stop], colors[2][n:stop]
            red, green, blue = mixed[0, at:end], mixed[1, at:end], mixed[2, at:end]
            if layer == 0:
                start_span(
                    own[0], own[1], own[2], some_alphas(alphas, n, stop), shares[at:end],
                    rest[at:end], red, green, blue, mixed[3, at:end],
                )  # fmt: skip
            else:
                add_span(own[0], own[1], own[2], shares[at:end], red, green, blue)
            n = stop
        at = end


@disjoint_stage
def to_codes(red, green, blue, table):
    """Replace light by its codes, 0..255, as float32."""
    for i in range(red.shape[0]):
        red[i] = np.float32(encode(red[i], table))
        green[i] = np.float32(encode(green[i], table))
        blue[i] = np.float32(encode(blue[i], table))


@stage
def colors_to_mix(samples, count, colors, coding):
    """Return the rows of red, green and blue to mix: light, or codes of what is to be shown."""
    if coding is None:
        return colors
    shown = toned(samples, count, colors, coding.tone)
    to_codes(shown[0][:count], shown[1][:count], shown[2][:count], coding.table)
    return shown


@stage
def whole_code(value):
    """Return a mixed code rounded half up; what rounding left above 255 gives 255."""
    value = value if value < np.float32(255.0) else np.float32(255.0)
    return np.uint32(np.int32(value + np.float32(0.5)))


@disjoint_stage
def pack_codes(red, green, blue, alpha, color):
    """Write mixed codes, given by channel; alpha is 0..1."""
    for i in range(color.shape[0]):
        share = between(alpha[i], np.float32(0.0))
        color[i] = (
            whole_code(red[i])
            | whole_code(green[i]) << np.uint32(8)
            | whole_code(blue[i]) << np.uint32(16)
            | np.uint32(np.int32(np.float64(share) * 255.0 + 0.5)) << np.uint32(24)
        )


@stage
def write_mixed(mixed, encoding, linear, color, coding):
    """Write a part of a row of mixed colours, given by channel."""
    count = color.shape[0]
    if coding is not None:
        pack_codes(mixed[0, :count], mixed[1, :count], mixed[2, :count], mixed[3, :count], color)
        return
    encode_channels(
        mixed[0, :count], mixed[1, :count], mixed[2, :count], mixed[3, :count], encoding.table,
        color,
    )  # fmt: skip
    for i in range(linear.shape[0]):
        for k in range(4):
            linear[i, k] = mixed[k, i]


def samples_memory(samples: int) -> tuple[NDArray[Any], ...]:
    """Return room for the faces of a part of a row, their shares, and the share of nothing."""
    return (
        np.empty((samples, 1, BLOCK_COLUMNS), np.int32),
        np.empty((samples, 1, BLOCK_COLUMNS), np.float32),
        np.empty((1, BLOCK_COLUMNS), np.float32),
    )


def scratch_memory() -> tuple[NDArray[Any], ...]:
    """Return the memory that a thread needs to mix a part of a row."""
    return np.empty((2, BLOCK_COLUMNS), np.int32), np.empty((4, BLOCK_COLUMNS), np.float32)


@kernel
def mix_faces(
    opaque, first_row, found, geometry: Geometry, placement: Placement, surface: Surface,
    lighting: Lighting | None, behind, encoding: Encoding, linear, color, scratch,
    room, coding: Encoding | None,
):  # fmt: skip
    """
    Write the colour of rows whose pixels show shares of several opaque faces.

    Parameters
    ----------
    opaque : (N, R, W) int32 or None
        The face at each sample, -1 where there is none; ``None`` if the shares are known.
    first_row : int
        Where the rows lie in the frame.
    found : (shown (J, R, W) int32, shares (J, R, W) float32, rest (R, W) float32)
        The faces of each pixel, -1 behind the last; their shares, read where there is a face; the
        share that shows no face. With samples, scratch memory from `samples_memory`.
    geometry, placement, surface : records
    lighting : Lighting or None
        ``None``: every object shows its own colour.
    behind : (R or 1, 4, W) float32, linear, straight alpha
        What is seen where no face is: of each row, or one that is the same in all. In codes, but
        for alpha, if codes are mixed.
    encoding : Encoding
        Tones are not mapped.
    linear : (R, W, 4) float32
        Written: linear RGBA with straight alpha. Unless it is not wanted, then W is 0.
    color : (R, W) uint32
        Written: the same in sRGB codes, RGBA bytes from the lowest up. Or W is 0, too.
    scratch : tuple
        This thread's own, from ``shading.scratch_memory``.
    room : tuple
        As well, from `scratch_memory`.
    coding : Encoding or None
        ``None``: light is mixed. Else the tones of each colour are mapped, it is rounded to codes,
        and codes are mixed; no linear colour is wanted then.
    """
    shown, shares, rest = found
    toward_viewer, (others, mixed) = viewer_of(placement), room
    runs.forget_faces(scratch[4])
    columns = behind.shape[2]
    for row in range(linear.shape[0]):
        for left in range(0, columns, BLOCK_COLUMNS):
            right = min(left + BLOCK_COLUMNS, columns)
            for k in range(4):
                copy_row(
                    behind[min(row, behind.shape[0] - 1), k, left:right], mixed[k, : right - left]
                )
            layers, at, start = find_shares(opaque, row, left, right, shown, shares, rest, others)
            stop = start + right - left
            other = rest[at, start:stop]
            for layer in range(layers):
                faces = shown[layer, at, start:stop]
                if is_empty(faces):
                    continue
                count, colors = shade_part(
                    faces, left, first_row + row, geometry, placement, surface, lighting,
                    toward_viewer, scratch,
                )  # fmt: skip
                colors = colors_to_mix(scratch[0], count, colors, coding)
                mix_layer(
                    layer, faces, colors, alpha_row(scratch[0], surface.alphas),
                    shares[layer, at, start:stop], other, mixed,
                )  # fmt: skip
            if shows_both(other):
                divide_row(shares[0, at, start:stop], other, mixed[0], mixed[1], mixed[2], mixed[3])
            write_mixed(mixed, encoding, linear[row, left:right], color[row, left:right], coding)
