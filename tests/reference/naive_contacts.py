"""Where surfaces touch in a shadow map, one sample at a time, in Python; see `contacts`."""

from __future__ import annotations

import numpy as np

f32 = np.float32


def height(texels, column, row, u, v, plane):
    """Return how much nearer a texel is than the plane of a sample, all of it in float32."""
    depth, across, down = plane
    return texels[row, column] - (depth + across * (f32(column + 0.5) - u)
                                  + down * (f32(row + 0.5) - v))  # fmt: skip


def stray(plane):
    """Return how far a plane may lie from what is stored of it."""
    depth, across, down = (abs(value) for value in plane)
    return (across + down) / 64.0 + depth / 2.0**20


def profile(texels, u, v, plane, is_row):
    """
    Return heights at six texels around a sample, along a row or a column, and where it is.

    Each is between two texels, by their weight: those on both sides of the sample across.
    """
    stored = texels if is_row else texels.T
    (depth, along, _), x, y = plane, u, v
    if not is_row:
        (depth, _, along), x, y = plane, v, u
    last = len(texels) - 4
    left = int(min(max(np.floor(x - f32(0.5)), 2), last))
    upper = int(min(max(np.floor(y - f32(0.5)), 2), last))
    x, y = x - f32(0.5) - f32(left), y - f32(0.5) - f32(upper)
    heights = []
    for k in range(-2, 4):
        between = stored[upper, left + k] * (f32(1) - y) + stored[upper + 1, left + k] * y
        # Float64 here: what decides below has to be farther from a limit than rounding.
        heights.append(float(between) - (float(depth) + float(along) * (k - float(x))))
    return heights, float(x)


def planes(heights, x):
    """Yield heights of three texels on one side of a sample, of two behind, and how far it is."""
    a, b, c, d, e, f = heights
    yield (d, e, f), (c, b), 1.0 - x
    yield (c, b, a), (d, e), x


def is_dark(texels, u, v, plane):
    """
    Tell whether a sample is covered by a plane that comes down close by.

    Returns
    -------
    bool or None
        None where rounding may say one or the other.
    """
    least, steepest, answer, is_sure = stray(plane), 0.0, False, True
    own = height(texels, int(np.floor(u)), int(np.floor(v)), u, v, plane)
    if not own > least:
        return None if np.isclose(own, least, rtol=1e-3, atol=1e-6) else False
    for is_row in (True, False):
        for near, behind, away in planes(*profile(texels, u, v, plane, is_row)):
            if not np.isfinite(near).all():
                continue
            gain = (near[2] - near[0]) / 2.0
            room, bend = gain / 16.0 + least, abs(near[2] - 2.0 * near[1] + near[0])
            # A plane, and steeper than all others.
            if bend > room + 1e-6 or gain <= steepest - 1e-6:
                continue
            is_sure &= abs(bend - room) > 1e-6 and abs(gain - steepest) > 1e-6
            here = near[0] - gain * away
            limits = [here - gain / 2.0 - least, 4.0 * gain - here]
            # It is there as far as it is above the plane of the sample.
            for n, seen in enumerate(behind, 1):
                expected = near[0] - n * gain
                limits.append(max(-expected, seen - expected + room))
            steepest, answer = gain, min(limits) > 0.0
            is_sure &= min(abs(limit) for limit in limits) > 1e-6 or min(limits) < -1e-6
    return answer if is_sure else None
