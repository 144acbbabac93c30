"""
Lay the colours of a pixel over each other, or mix them, in linear light.

What is summed up is premultiplied: colour times alpha. A pixel's sum lies in four numbers: red,
green, blue, and the share of light that comes through from behind (`lay_over`) or that is accounted
for (`add_share`). What changes nothing leaves every bit of a colour as it is.

References
----------
.. [1] T. Porter and T. Duff, "Compositing Digital Images", SIGGRAPH 1984: the over operator.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import kernel, stage
from rasterjit.kernels.visibility import NOTHING

THROUGH = 3
"""Column of a sum: the share of light that comes through from behind."""


@stage
def held_alpha(alpha):
    """Return an alpha held in 0..1; NaN gives 0."""
    alpha = alpha if alpha > np.float32(0.0) else np.float32(0.0)
    return alpha if alpha < np.float32(1.0) else np.float32(1.0)


@kernel
def start_sums(sums):
    """
    Begin with nothing in front.

    Parameters
    ----------
    sums : (R, W, 4) float32
        Written.
    """
    for row in range(sums.shape[0]):
        for i in range(sums.shape[1]):
            for k in range(3):
                sums[row, i, k] = 0.0
            sums[row, i, THROUGH] = 1.0


@kernel
def lay_under(colors, faces, behind, sums):
    """
    Lay a layer behind those that were laid before.

    Parameters
    ----------
    colors : (R, W, 4) float32, linear, with alpha
    faces : (R, W) int32
        The faces of the layer, -1 where there is none.
    behind : (R, W) int32
        Those of the next layer; -1 is written where nothing comes through to it.
    sums : (R, W, 4) float32
        Changed: premultiplied colour, and the share of light that comes through.
    """
    one, none = np.float32(1.0), np.float32(0.0)
    for row in range(faces.shape[0]):
        for i in range(faces.shape[1]):
            through = sums[row, i, THROUGH]
            if faces[row, i] >= 0:
                alpha = held_alpha(colors[row, i, 3])
                share = through * alpha
                # What is not seen is not multiplied: its colour may be infinite.
                if share > none:
                    for k in range(3):
                        sums[row, i, k] += share * colors[row, i, k]
                    through *= one - alpha
                    sums[row, i, THROUGH] = through
            if through == none:
                behind[row, i] = NOTHING


@stage
def over_background(total, through, color):
    """Return straight RGBA of a premultiplied sum over a colour with straight alpha."""
    one, none = np.float32(1.0), np.float32(0.0)
    if through == none:
        return total[0], total[1], total[2], one
    alpha = one - through * (one - color[3])
    if alpha == none:
        return color[0], color[1], color[2], none
    share = through * color[3]
    if share == none:
        return total[0] / alpha, total[1] / alpha, total[2] / alpha, alpha
    return (
        (total[0] + share * color[0]) / alpha,
        (total[1] + share * color[1]) / alpha,
        (total[2] + share * color[2]) / alpha,
        alpha,
    )


@kernel
def finish_sums(sums, linear):
    """
    Lay the sums over what lies behind all layers.

    Parameters
    ----------
    sums : (R, W, 4) float32
        As `lay_under` leaves them.
    linear : (R, W, 4) float32
        Opaque surfaces and background; changed where a layer lies before it.
    """
    for row in range(sums.shape[0]):
        for i in range(sums.shape[1]):
            through = sums[row, i, THROUGH]
            if through == np.float32(1.0):
                continue
            total = sums[row, i, 0], sums[row, i, 1], sums[row, i, 2]
            own = linear[row, i, 0], linear[row, i, 1], linear[row, i, 2], linear[row, i, 3]
            shown = over_background(total, through, own)
            for k in range(4):
                linear[row, i, k] = shown[k]
