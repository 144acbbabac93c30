"""
Remove light leaks at contacts: filters leak light where a wall meets the floor behind it.

Texels beyond the contact line are lit, and some before it are nearer than the sample's plane by
less than the bias. So a filter blurs the shadow's edge across the line, up to three texels wide,
and light leaks in at the edges of a box.

But the stored depth of a plane is linear over a map: three texels in a row tell whether they show a
plane, its height over the sample, and where it meets the sample's plane. A sample whose own texel
is nearer than its plane is in shadow if such an occluding plane meets its own close by without gap.
"""

from __future__ import annotations

import numpy as np

from rasterjit.effects.shadows.filters import DEPTH_ROUNDING, is_nearer, limits
from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.jit import disjoint_helper, helper

SNAPPING = np.float32(1.0 / 64.0)
"""What a plane may be off in a map, as a share of its slope, texels: four times what vertices are
rounded by there."""

FLAT = np.float32(1.0 / 16.0)
"""Most that three texels in a row bend, as a share of their gain in depth, if they show a plane."""

SURE = np.float32(0.25)
"""Distance behind the contact line at which a sample is surely in shadow, texels."""

TOUCHING = np.float32(4.0)
"""How far along a row or a column a plane may go on from a sample until it comes down, texels: what
is 3 texels away, in a row at 45 degrees. Farther in, no filter finds any light."""

FARTHEST = np.float32(7.0)
"""Texels from the first of a plane to the second one that lies behind where it comes down."""

DROP = np.float32(6.0)
"""How far below a sample's plane what the map shows does not go on from a plane above it, texels of
the gain of that one."""


@helper
def least_height(depth, across, down):
    """Return how far from a plane what is stored of it may lie, in stored depth."""
    return SNAPPING * (abs(across) + abs(down)) + DEPTH_ROUNDING * abs(depth)


@helper
def height_at(texels, at, aside, share, plane):
    """Return the height over a plane, between a texel and the next one across, by their weight."""
    near, far = texels[np.uintp(at)], texels[np.uintp(at + aside)]
    return near * (np.float32(1.0) - share) + far * share - plane


@helper
def is_above(texels, at, aside, low, high):
    """Tell whether a texel is nearer than one depth, and the next one across than another."""
    return (texels[np.uintp(at)] > low) & (texels[np.uintp(at + aside)] > high)


@helper
def side_of(first, second, third, last, beyond, away, is_above_both, least):
    """
    Return the gain of a plane on one side of a sample, and whether it may cover the sample.

    Parameters
    ----------
    first, second, third : float32
        Heights over the sample's plane, in stored depth, of three texels on that side.
    last, beyond : float32
        Heights of the two next texels on the other side.
    away : float32
        From the sample to the first of the three, texels.
    is_above_both : bool
        Whether the first is nearer than the sample's plane on both sides of the sample.
    least : float32
        How far two planes may lie apart and be the same.

    Returns
    -------
    gain : float32
        A texel away from the sample; 0 where there is no plane.
    covers : bool
    """
    zero = np.float32(0.0)
    gain = (third - first) * np.float32(0.5)
    room = FLAT * gain + least
    # Where nothing is, infinitely far, this is no number.
    is_plane = abs(third - second - second + first) <= room
    here = first - gain * away
    is_close = (here > SURE * gain + least) & (here <= TOUCHING * gain)
    # It is there all the way if nothing lower is seen.
    lower, lowest = first - gain, first - gain - gain
    is_there = (lower <= zero) | (last >= lower - room)
    is_there = is_there & ((lowest <= zero) | (beyond >= lowest - room))
    return (gain if is_plane else zero), is_close & is_there & is_above_both


@helper
def sides_along(texels, at, stride, aside, x, y, plane, step, rise, least):
    """
    Return the steeper one of the planes on both sides of a sample, along a row or a column.

    Parameters
    ----------
    texels : (N,) float32
    at : int32
        The texel before the sample.
    stride, aside : int32
        To the next texel along, and to the next one across.
    x, y : float32
        Where the sample is, from that texel, along and across.
    plane, step, rise : float32
        Stored depth of the sample's plane beside that texel, its gain by a texel along and across.
    least : float32

    Returns
    -------
    gain : float32
    first : float32
        Height of the texel next to the sample on that side.
    is_ahead : bool
        Whether that is the side of the next texel.
    covers : bool
    """
    two, one = np.int32(2), np.float32(1.0)
    double = step + step
    a = height_at(texels, at - two * stride, aside, y, plane - double)
    b = height_at(texels, at - stride, aside, y, plane - step)
    c = height_at(texels, at, aside, y, plane)
    d = height_at(texels, at + stride, aside, y, plane + step)
    e = height_at(texels, at + two * stride, aside, y, plane + double)
    f = height_at(texels, at + two * stride + stride, aside, y, plane + (double + step))
    # What covers the sample goes on to both sides of it.
    low, high = plane - rise * y + least, plane + rise * (one - y) + least
    has_c = is_above(texels, at, aside, low, high)
    has_d = is_above(texels, at + stride, aside, low + step, high + step)
    ahead, covers_ahead = side_of(d, e, f, c, b, one - x, has_d, least)
    back, covers_back = side_of(c, b, a, d, e, x, has_c, least)
    is_ahead = ahead >= back
    return (
        (ahead if is_ahead else back), (d if is_ahead else c), is_ahead,
        (covers_ahead if is_ahead else covers_back),
    )  # fmt: skip


@helper
def comes_down(
    texels, at, stride, aside, y, plane, step, first, gain, is_ahead, before, after, least
):
    """
    Tell whether the map shows that a plane ends where it comes down to the sample's own.

    There, a texel farther, it shows that plane, or far below it what lies behind: not a surface
    that goes on below it, such as a rough one does all over.

    Parameters
    ----------
    texels, at, stride, aside, y, plane, step, least
        As `sides_along` takes them.
    first, gain, is_ahead
        As it returns them.
    before, after : float32
        How many texels of the map lie before the one ``at``, and after it.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    # Count from the first texel to the second one below the sample's plane.
    count = np.ceil((first - least) / (gain if gain > zero else one)) + one
    count = clamped(count, zero, FARTHEST)
    k = (one - count) if is_ahead else count
    is_on_map = (k >= -before) & (k <= after)
    k = k if is_on_map else zero
    beyond = height_at(texels, at + np.int32(k) * stride, aside, y, plane + step * k)
    room = FLAT * gain + least
    # Where nothing is, this is infinite or no number.
    is_far_below = not (beyond >= -(DROP * gain + room))
    return is_on_map & ((abs(beyond) <= room) | is_far_below)


@disjoint_helper
def darken_covered(u, v, depth, across, down, texels, size, sides, unsure, share):
    """
    Set unsure samples to shadow if a touching surface covers them.

    Of the planes around a sample the steepest one decides: across the line where it comes down.
    """
    zero, half, two = np.float32(0.0), np.float32(0.5), np.float32(2.0)
    length, four, one = np.float32(size), np.float32(4.0), np.float32(1.0)
    for i in range(share.shape[0]):
        top = limits(v[i], size, sides)
        left = clamped(np.floor(u[i] - half), two, length - four)
        upper = clamped(np.floor(v[i] - half), top + two, top + length - four)
        x, y = u[i] - half - left, v[i] - half - upper
        at, row = np.int32(upper) * np.int32(size) + np.int32(left), np.int32(size)
        least = least_height(depth[i], across[i], down[i])
        beside, below = depth[i] - across[i] * x, depth[i] - down[i] * y
        gain, first, is_ahead, covers = sides_along(
            texels, at, np.int32(1), row, x, y, beside, across[i], down[i], least
        )
        other, its_first, its_ahead, it_covers = sides_along(
            texels, at, row, np.int32(1), y, x, below, down[i], across[i], least
        )
        is_row = gain >= other
        ends = comes_down(
            texels, at, (np.int32(1) if is_row else row), (row if is_row else np.int32(1)),
            (y if is_row else x), (beside if is_row else below),
            (across[i] if is_row else down[i]), (first if is_row else its_first),
            (gain if is_row else other), (is_ahead if is_row else its_ahead),
            (left if is_row else upper - top),
            (length - one - left if is_row else top + length - one - upper), least,
        )  # fmt: skip
        is_dark = (covers if is_row else it_covers) & ends & (unsure[i] > zero)
        share[i] = zero if is_dark else share[i]


@disjoint_helper
def mark_within_bias(u, v, depth, across, down, texels, size, sides, share, unsure):
    """Write 1 where the texel of a lit sample is nearer than its plane, else 0; tell if any is."""
    zero, half, last = np.float32(0.0), np.float32(0.5), np.float32(size - 1)
    found = np.int32(0)
    for i in range(share.shape[0]):
        top = limits(v[i], size, sides)
        at_u, at_v = np.floor(u[i]), np.floor(v[i])
        column, row = clamped(at_u, zero, last), clamped(at_v, top, top + last)
        plane = depth[i] + across[i] * (column + half - u[i]) + down[i] * (row + half - v[i])
        plane += least_height(depth[i], across[i], down[i])
        is_unsure = (share[i] > zero) & (is_nearer(texels, column, row, size, plane) > zero)
        is_unsure = is_unsure & (at_u == column) & (at_v == row)
        unsure[i] = np.float32(1.0) if is_unsure else zero
        found = np.int32(found | np.int32(is_unsure))
    return found


@helper
def close_contacts(u, v, depth, across, down, texels, size, sides, unsure, share):
    """Remove the light that a filter leaks where surfaces touch."""
    if mark_within_bias(u, v, depth, across, down, texels, size, sides, share, unsure) != 0:
        darken_covered(u, v, depth, across, down, texels, size, sides, unsure, share)
