"""Where surfaces touch in a shadow map, one sample at a time, in Python; see `contacts`."""

from __future__ import annotations

import numpy as np

f32 = np.float32


def height(texels, column, row, u, v, plane):
    """Return how much nearer to the light a texel is than the plane of a sample."""
    depth, across, down = (float(value) for value in plane)
    beside, below = column + 0.5 - float(u), row + 0.5 - float(v)
    return float(texels[row, column]) - (depth + across * beside + down * below)


def stray(plane):
    """Return how far a plane may lie from what is stored of it."""
    depth, across, down = (abs(value) for value in plane)
    return (across + down) / 64.0 + depth / 2.0**20


def profile(texels, u, v, plane):
    """
    Return heights at six texels around a sample along a row, (2, 6), and where it is among them.

    Those of the row above the sample, and of the one below.
    """
    left, upper = (
        int(np.clip(np.floor(at - f32(0.5)), 2, len(texels) - 4)) for at in (u, v)
    )  # fmt: skip
    rows = [
        [height(texels, left + k, upper + n, u, v, plane) for k in range(-2, 4)] for n in range(2)
    ]
    return np.array(rows), float(u) - 0.5 - left, float(v) - 0.5 - upper


def planes(rows, x, y):
    """
    Yield three heights on one side of a sample, two behind, the least of the first, how far it is.

    Each height is between those of both rows, by their weight.
    """
    with np.errstate(invalid="ignore"):
        a, b, c, d, e, f = rows[0] * (1.0 - y) + rows[1] * y
    yield (d, e, f), (c, b), rows[:, 3].min(), 1.0 - x
    yield (c, b, a), (d, e), rows[:, 2].min(), x


def is_dark(texels, u, v, plane):
    """
    Tell whether a sample is covered by a plane that comes down close by.

    Returns
    -------
    bool or None
        None where rounding may say one or the other.
    """
    least, steepest, answer, is_sure = stray(plane), 0.0, False, True
    if not (0.0 <= u < len(texels) and 0.0 <= v < len(texels)):
        return False
    own = height(texels, int(np.floor(u)), int(np.floor(v)), u, v, plane)
    if not own > least:
        return None if np.isclose(own, least, rtol=1e-3, atol=1e-6) else False
    depth, across, down = plane
    along_row = profile(texels, u, v, plane)
    along_column = profile(texels.T, v, u, (depth, down, across))
    for rows in (along_row, along_column):
        for near, behind, first, away in planes(*rows):
            if not np.isfinite(near).all():
                continue
            gain = (near[2] - near[0]) / 2.0
            room, bend = gain / 16.0 + least, abs(near[2] - 2.0 * near[1] + near[0])
            # A plane, and steeper than all others.
            if bend > room + 1e-6 or gain <= steepest - 1e-6:
                continue
            is_sure &= abs(bend - room) > 1e-6 and abs(gain - steepest) > 1e-6
            here = near[0] - gain * away
            limits = [here - gain / 2.0 - least, 4.0 * gain - here, first - least]
            # It is there as far as it is above the plane of the sample.
            for n, seen in enumerate(behind, 1):
                expected = near[0] - n * gain
                limits.append(max(-expected, seen - expected + room))
            steepest, answer = gain, min(limits) > 0.0
            is_sure &= min(abs(limit) for limit in limits) > 1e-6 or min(limits) < -1e-6
    return answer if is_sure else None
