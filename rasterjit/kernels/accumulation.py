"""
Add up whole pictures and take their mean, in linear light.

What is summed up is premultiplied: colour times alpha. A product of two float32 is exact in float64
and a sum of some hundred of them nearly so; the mean of equal colours has their bits.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import disjoint_stage, kernel


@disjoint_stage
def is_opaque(linear):
    """Return whether alpha is 1 in all of a row of linear colour, four numbers each."""
    found = np.uint32(0)
    for i in range(linear.shape[0] >> 2):
        found |= np.uint32(linear[np.uintp(4 * i + 3)] != np.float32(1.0))
    return found == np.uint32(0)


@disjoint_stage
def add_opaque_row(linear, sums):
    """Add a row in which alpha is 1: the same bits as `add_row`, in half the time."""
    for i in range(sums.shape[0]):
        sums[i] += np.float64(linear[i])


@disjoint_stage
def add_row(linear, sums):
    """Add a row of linear colour, four numbers each, to its sums; without branches."""
    for i in range(sums.shape[0] >> 2):
        at = np.uintp(4 * i)
        alpha = np.float64(linear[at + np.uintp(3)])
        red = alpha * np.float64(linear[at])
        green = alpha * np.float64(linear[at + np.uintp(1)])
        blue = alpha * np.float64(linear[at + np.uintp(2)])
        # What is not seen counts nothing: its colour may be infinite.
        is_seen = alpha > 0.0
        sums[at] += red if is_seen else 0.0
        sums[at + np.uintp(1)] += green if is_seen else 0.0
        sums[at + np.uintp(2)] += blue if is_seen else 0.0
        sums[at + np.uintp(3)] += alpha


@kernel
def add_picture(linear, sums):
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
        own, total = linear[row].reshape(-1), sums[row].reshape(-1)
        if is_opaque(own):
            add_opaque_row(own, total)
        else:
            add_row(own, total)


@kernel
def write_mean(sums, count, behind, linear):
    """
    Write the mean of pictures.

    Parameters
    ----------
    sums : (R, W, 4) float64
        Of `add_picture`.
    count : int
        Number of pictures.
    behind : (4,) float32
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
                linear[row, i, k] = np.float32(mean) if is_seen else behind[k]
            linear[row, i, 3] = np.float32(alpha / count)
