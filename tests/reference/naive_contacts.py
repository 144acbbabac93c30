"""Where surfaces touch in a shadow map, one sample at a time, in Python; see `contacts`."""

from __future__ import annotations

import itertools
import math

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


class Row:
    """The heights of texels along the row that a sample lies in, between those above and below."""

    def __init__(self, texels, u, v, plane):
        left, upper = (int(np.clip(np.floor(at - f32(0.5)), 2, len(texels) - 4)) for at in (u, v))
        self.texels, self.sample = texels, (u, v, plane)
        self.left, self.upper = left, upper
        self.x, self.y = float(u) - 0.5 - left, float(v) - 0.5 - upper

    def both(self, k):
        """Return the heights of a texel and of that below it; None off the map."""
        if not 0 <= self.left + k < len(self.texels):
            return None
        return [height(self.texels, self.left + k, self.upper + n, *self.sample) for n in (0, 1)]

    def at(self, k):
        """Return the height between both, by their weight."""
        above, below = self.both(k)
        with np.errstate(invalid="ignore"):
            return above * (1.0 - self.y) + below * self.y


def ends_at(row, first, toward, gain, least):
    """Tell whether a plane, from its first texel on, ends where it comes down; None if unsure."""
    texels_down = (row.at(first) - least) / gain
    if abs(texels_down - round(texels_down)) < 1e-4:
        return None
    k = first - toward * min(math.ceil(texels_down) + 1, 7)
    if row.both(k) is None:
        return False
    seen, room = row.at(k), gain / 16.0 + least
    if min(abs(abs(seen) - room), abs(seen + 6.0 * gain + room)) < 1e-6:
        return None
    return abs(seen) <= room or not seen >= -6.0 * gain - room


def is_dark(texels, u, v, plane):
    """
    Tell whether a sample is covered by a plane that comes down close by, and ends there.

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
    rows = Row(texels, u, v, plane), Row(texels.T, v, u, (depth, down, across))
    for row, (first, toward) in itertools.product(rows, ((1, 1), (0, -1))):
        near = [row.at(first + n * toward) for n in range(3)]
        if not np.isfinite(near).all():
            continue
        gain = (near[2] - near[0]) / 2.0
        room, bend = gain / 16.0 + least, abs(near[2] - 2.0 * near[1] + near[0])
        # A plane, and steeper than all others.
        if bend > room + 1e-6 or gain <= steepest - 1e-6:
            continue
        is_sure &= abs(bend - room) > 1e-6 and abs(gain - steepest) > 1e-6
        here = near[0] - gain * (first - row.x) * toward
        limits = [here - gain / 4.0 - least, 4.0 * gain - here, min(row.both(first)) - least]
        # It is there as far as it is above the plane of the sample.
        for n in (1, 2):
            expected = near[0] - n * gain
            limits.append(max(-expected, row.at(first - n * toward) - expected + room))
        steepest, answer = gain, min(limits) > 0.0
        is_sure &= min(abs(limit) for limit in limits) > 1e-6 or min(limits) < -1e-6
        if answer:
            ends = ends_at(row, first, toward, gain, least)
            is_sure &= ends is not None
            answer = bool(ends)
    return answer if is_sure else None
