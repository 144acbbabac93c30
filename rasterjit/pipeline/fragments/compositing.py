"""
Composite the layers of a pixel (over operator), or average its samples, in linear light.

Sums are of premultiplied colours. No-ops keep every bit of a colour: a layer with alpha 0, anything
behind one with alpha 1, and the mean of equal samples.

With several samples a pixel has several faces, each shaded once. With transparency, the weight of a
face depends on the alpha of those in front, so `list_faces` keeps the faces of each sample;
``coverage_resolve`` handles opaque ones.

References
----------
.. [1] T. Porter and T. Duff, "Compositing Digital Images", SIGGRAPH 1984: the over operator.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.visibility.tile_rasterizer import NOTHING
from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float32, int32

TRANSMITTANCE = 3
"""Column of a sum: transmittance, the share of light from behind."""

MAX_TRANSMITTANCE = np.float32(1.0 - 2.0**-24)
"""Largest transmittance of a visible layer: less than 1, which stands for no layer."""


@helper
def attenuate(transmittance, alpha):
    """Return the transmittance behind a layer whose alpha is not 0."""
    return min(transmittance * (np.float32(1.0) - alpha), MAX_TRANSMITTANCE)


@kernel
def start_sums(sums: float32[:, :, ::1]):
    """
    Clear the sums: no layer yet.

    Parameters
    ----------
    sums : (R, W, 4) float32
        Written.
    """
    for row in range(sums.shape[0]):
        for i in range(sums.shape[1]):
            for k in range(3):
                sums[row, i, k] = 0.0
            sums[row, i, TRANSMITTANCE] = 1.0


@kernel
def composite_under(
    colors: float32[:, :, ::1], faces: int32[:, :], below: int32[:, :], sums: float32[:, :, ::1]
):
    """
    Composite a layer under the nearer ones (front to back).

    Parameters
    ----------
    colors : (R, W, 4) float32, linear, with alpha
    faces : (R, W) int32
        The faces of the layer, -1 where there is none.
    below : (R, W) int32
        The faces of the next layer; -1 is written where no light passes to it.
    sums : (R, W, 4) float32
        Changed: premultiplied colour, and transmittance.
    """
    zero = np.float32(0.0)
    for row in range(faces.shape[0]):
        for i in range(faces.shape[1]):
            transmittance = sums[row, i, TRANSMITTANCE]
            if faces[row, i] >= 0:
                alpha = clamped(colors[row, i, 3], np.float32(0.0), np.float32(1.0))
                weight = transmittance * alpha
                # Skip hidden layers: their colour may be infinite.
                if weight > zero:
                    for k in range(3):
                        sums[row, i, k] += weight * colors[row, i, k]
                    transmittance = attenuate(transmittance, alpha)
                    sums[row, i, TRANSMITTANCE] = transmittance
            if transmittance == zero:
                below[row, i] = NOTHING


@helper
def composite_over_background(total, transmittance, color):
    """Composite a premultiplied sum over a straight-alpha colour; return straight RGBA."""
    one, zero = np.float32(1.0), np.float32(0.0)
    if transmittance == zero:
        return total[0], total[1], total[2], one
    alpha = one - transmittance * (one - color[3])
    if alpha == zero:
        return color[0], color[1], color[2], zero
    weight = transmittance * color[3]
    if weight == zero:
        return total[0] / alpha, total[1] / alpha, total[2] / alpha, alpha
    return (
        (total[0] + weight * color[0]) / alpha,
        (total[1] + weight * color[1]) / alpha,
        (total[2] + weight * color[2]) / alpha,
        alpha,
    )


@kernel
def finish_sums(sums: float32[:, :, ::1], linear: float32[:, :, ::1]):
    """
    Composite the sums over the opaque surfaces and the background.

    Parameters
    ----------
    sums : (R, W, 4) float32
        From `composite_under`.
    linear : (R, W, 4) float32
        Opaque surfaces and background; changed where a layer lies in front.
    """
    for row in range(sums.shape[0]):
        for i in range(sums.shape[1]):
            transmittance = sums[row, i, TRANSMITTANCE]
            if transmittance == np.float32(1.0):
                continue
            total = sums[row, i, 0], sums[row, i, 1], sums[row, i, 2]
            background = linear[row, i, 0], linear[row, i, 1], linear[row, i, 2], linear[row, i, 3]
            result = composite_over_background(total, transmittance, background)
            for k in range(4):
                linear[row, i, k] = result[k]


@disjoint_helper
def empty_row(faces):
    """Mark a row of a layer as empty."""
    for i in range(faces.shape[0]):
        faces[i] = NOTHING


@helper
def multiply_weight(weight, value):
    """Return a weight times a value, which may be infinite if the weight is 0."""
    zero = np.float32(0.0)
    return weight * value if weight > zero else zero


@helper
def find_or_append(face, faces, count, row, i):
    """Return the index of a face in a pixel's list, appending it if it is new."""
    if face < 0:
        return np.int32(NOTHING), count
    layer = np.int64(0)
    while layer < count and faces[layer, row, i] != face:
        layer += 1
    if layer == count:
        faces[layer, row, i] = face
        count += 1
    return np.int32(layer), count


@kernel
def list_faces(opaque: int32[:, :, ::1], transparent: int32[:, :, :, ::1], faces: int32[:, :, ::1]):
    """
    List the distinct faces of each pixel's samples, and replace faces by their indices.

    Parameters
    ----------
    opaque : (N, R, W) int32
        The opaque face at each sample; -1 where there is none. Replaced by its index.
    transparent : (N, K, R, W) int32
        The transparent faces in front of it, nearest first. Replaced by their indices.
    faces : (N (K + 1), R, W) int32
        Written: the distinct faces of each pixel, -1 after the last.

    Returns
    -------
    int
        The most faces in a pixel.
    """
    samples, levels, rows, columns = transparent.shape
    most = np.int64(0)
    for row in range(rows):
        for layer in range(faces.shape[0]):
            empty_row(faces[layer, row])
        for i in range(columns):
            count = np.int64(0)
            for sample in range(samples):
                for level in range(levels):
                    face = transparent[sample, level, row, i]
                    number, count = find_or_append(face, faces, count, row, i)
                    transparent[sample, level, row, i] = number
                number, count = find_or_append(opaque[sample, row, i], faces, count, row, i)
                opaque[sample, row, i] = number
            most = max(most, count)
    return most


@helper
def are_alike(opaque, transparent, row, i):
    """Return whether all samples of a pixel show the same faces in the same order."""
    for sample in range(1, opaque.shape[0]):
        if opaque[sample, row, i] != opaque[0, row, i]:
            return False
        for level in range(transparent.shape[1]):
            if transparent[sample, level, row, i] != transparent[0, level, row, i]:
                return False
    return True


@helper
def composite_sample(sample, opaque, transparent, colors, back, row, i):
    """Return the colour of a sample, linear RGBA with straight alpha."""
    one, zero = np.float32(1.0), np.float32(0.0)
    red, green, blue, transmittance = zero, zero, zero, one
    for level in range(transparent.shape[1]):
        layer = transparent[sample, level, row, i]
        if layer < 0:
            break
        alpha = clamped(colors[layer, row, i, 3], np.float32(0.0), np.float32(1.0))
        weight = transmittance * alpha
        if weight > zero:
            red += weight * colors[layer, row, i, 0]
            green += weight * colors[layer, row, i, 1]
            blue += weight * colors[layer, row, i, 2]
            transmittance = attenuate(transmittance, alpha)
    layer = opaque[sample, row, i]
    if layer >= 0:
        color = colors[layer, row, i, 0], colors[layer, row, i, 1], colors[layer, row, i, 2], one
    else:
        color = back[row, i, 0], back[row, i, 1], back[row, i, 2], back[row, i, 3]
    if transmittance == one:
        return color
    return composite_over_background((red, green, blue), transmittance, color)


@kernel
def mix_samples(
    opaque: int32[:, :, ::1],
    transparent: int32[:, :, :, ::1],
    colors: float32[:, :, :, ::1],
    back: float32[:, :, ::1],
    linear: float32[:, :, ::1],
):
    """
    Write the mean colour of each pixel's samples.

    Parameters
    ----------
    opaque : (N, R, W) int32
    transparent : (N, K, R, W) int32
        Indices of faces, from `list_faces`.
    colors : (J, R, W, 4) float32
        The colours of these faces in each pixel.
    back : (R, W, 4) float32
        The background.
    linear : (R, W, 4) float32
        Written: linear RGBA with straight alpha.
    """
    samples, zero = opaque.shape[0], np.float32(0.0)
    part = np.float32(1.0) / np.float32(samples)
    for row in range(linear.shape[0]):
        for i in range(linear.shape[1]):
            color = composite_sample(0, opaque, transparent, colors, back, row, i)
            if not are_alike(opaque, transparent, row, i):
                red, green, blue, alpha = zero, zero, zero, zero
                for sample in range(samples):
                    color = composite_sample(sample, opaque, transparent, colors, back, row, i)
                    weight = part * color[3]
                    red += multiply_weight(weight, color[0])
                    green += multiply_weight(weight, color[1])
                    blue += multiply_weight(weight, color[2])
                    alpha += weight
                scale = alpha if alpha > zero else np.float32(1.0)
                color = red / scale, green / scale, blue / scale, alpha
            for k in range(4):
                linear[row, i, k] = color[k]
