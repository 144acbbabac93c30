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

from rasterjit.effects.shadows.filters import DEPTH_ROUNDING, find_map_top, is_nearer
from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.jit import disjoint_helper, helper

SNAP_ERROR_TEXELS = np.float32(1.0 / 64.0)
"""Largest offset of a plane in a map, texels: four times the rounding of vertices there."""

MAX_BEND = np.float32(1.0 / 16.0)
"""Largest second difference of three texels on a plane, as a share of their gain in depth."""

MIN_BEHIND_TEXELS = np.float32(0.25)
"""Least distance behind the contact line of a sample surely in shadow, texels."""

MAX_CONTACT_TEXELS = np.float32(4.0)
"""Largest distance along a row or a column from a sample to the contact line, texels: one 3 texels
away at 45 degrees. Farther from the line, no filter finds any light."""

MAX_STEPS = np.float32(7.0)
"""Most texels to walk from a plane's first texel past its contact line."""

MIN_DROP_GAINS = np.float32(6.0)
"""How far below a sample's plane texels lie that do not continue an occluding plane, in units of
that plane's rise per texel."""


@helper
def compute_tolerance(depth, dz_du, dz_dv):
    """Return the error bound of stored depths on a plane."""
    return SNAP_ERROR_TEXELS * (abs(dz_du) + abs(dz_dv)) + DEPTH_ROUNDING * abs(depth)


@helper
def interpolate_height(texels, index, cross, weight, plane_depth):
    """Return the height over a plane, interpolated across; positive: nearer to the light."""
    near, far = texels[np.uintp(index)], texels[np.uintp(index + cross)]
    return near * (np.float32(1.0) - weight) + far * weight - plane_depth


@helper
def are_both_nearer(texels, index, cross, low, high):
    """Return whether a texel is nearer than ``low``, and the next one across than ``high``."""
    return (texels[np.uintp(index)] > low) & (texels[np.uintp(index + cross)] > high)


@helper
def fit_plane(first, second, third, next_below, second_below, distance, is_above_both, tolerance):
    """
    Fit a plane to texels on one side of a sample; return its gain, and if it may cover the sample.

    Parameters
    ----------
    first, second, third : float32
        Heights over the sample's plane, in stored depth, of three texels on that side.
    next_below, second_below : float32
        Heights of the two nearest texels on the other side.
    distance : float32
        From the sample to the first of the three, texels.
    is_above_both : bool
        Whether the first is nearer than the sample's plane in both rows across.
    tolerance : float32
        Largest distance of planes that count as the same.

    Returns
    -------
    gain : float32
        Of height per texel away from the sample; 0 where there is no plane.
    covers : bool
    """
    zero = np.float32(0.0)
    gain = (third - first) * np.float32(0.5)
    slack = MAX_BEND * gain + tolerance
    # Empty texels, at -inf, give NaN here.
    is_plane = abs(third - second - second + first) <= slack
    height = first - gain * distance
    is_close = height > MIN_BEHIND_TEXELS * gain + tolerance
    is_close = is_close & (height <= MAX_CONTACT_TEXELS * gain)
    # The plane has no gap if no lower texel is seen.
    lower, lowest = first - gain, first - gain - gain
    is_unbroken = (lower <= zero) | (next_below >= lower - slack)
    is_unbroken = is_unbroken & ((lowest <= zero) | (second_below >= lowest - slack))
    return (gain if is_plane else zero), is_close & is_unbroken & is_above_both


@helper
def fit_steeper_plane(texels, index, stride, cross, x, y, depth, slope, cross_slope, tolerance):
    """
    Fit planes on both sides of a sample, along a row or a column, and return the steeper one.

    Parameters
    ----------
    texels : (N,) float32
    index : int32
        The texel before the sample.
    stride, cross : int32
        To the next texel along, and to the next one across.
    x, y : float32
        Where the sample is, from that texel, along and across.
    depth, slope, cross_slope : float32
        Stored depth of the sample's plane beside that texel, its gain by a texel along and across.
    tolerance : float32

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
    two_steps, three_steps = slope + slope, slope + slope + slope
    a = interpolate_height(texels, index - two * stride, cross, y, depth - two_steps)
    b = interpolate_height(texels, index - stride, cross, y, depth - slope)
    c = interpolate_height(texels, index, cross, y, depth)
    d = interpolate_height(texels, index + stride, cross, y, depth + slope)
    e = interpolate_height(texels, index + two * stride, cross, y, depth + two_steps)
    f = interpolate_height(texels, index + two * stride + stride, cross, y, depth + three_steps)
    # A plane that covers the sample continues on both sides.
    low, high = depth - cross_slope * y + tolerance, depth + cross_slope * (one - y) + tolerance
    is_c_above = are_both_nearer(texels, index, cross, low, high)
    is_d_above = are_both_nearer(texels, index + stride, cross, low + slope, high + slope)
    ahead, covers_ahead = fit_plane(d, e, f, c, b, one - x, is_d_above, tolerance)
    back, covers_back = fit_plane(c, b, a, d, e, x, is_c_above, tolerance)
    is_ahead = ahead >= back
    return (
        (ahead if is_ahead else back), (d if is_ahead else c), is_ahead,
        (covers_ahead if is_ahead else covers_back),
    )  # fmt: skip


@helper
def ends_at_contact(
    texels, index, stride, cross, y, depth, slope, first, gain, is_ahead, before, after, tolerance
):  # fmt: skip
    """
    Return whether the map shows that an occluding plane ends at the sample's plane.

    A texel past the contact line must show the sample's plane, or be far below; a rough surface
    would continue just below.

    Parameters
    ----------
    texels, index, stride, cross, y, depth, slope, tolerance
        As `fit_steeper_plane` takes them.
    first, gain, is_ahead
        As `fit_steeper_plane` returns them.
    before, after : float32
        Numbers of texels of the map before ``index``, and after it.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    # Count from the first texel to the second one below the sample's plane.
    count = np.ceil((first - tolerance) / (gain if gain > zero else one)) + one
    count = clamped(count, zero, MAX_STEPS)
    k = (one - count) if is_ahead else count
    is_on_map = (k >= -before) & (k <= after)
    k = k if is_on_map else zero
    height = interpolate_height(texels, index + np.int32(k) * stride, cross, y, depth + slope * k)
    slack = MAX_BEND * gain + tolerance
    # Empty texels give -inf or NaN here.
    is_far_below = not (height >= -(MIN_DROP_GAINS * gain + slack))
    return is_on_map & ((abs(height) <= slack) | is_far_below)


@disjoint_helper
def darken_covered(u, v, depth, dz_du, dz_dv, texels, size, sides, candidates, lit):
    """
    Set candidates to shadow if a touching surface covers them.

    The steepest of the planes around a sample decides.
    """
    zero, half, two = np.float32(0.0), np.float32(0.5), np.float32(2.0)
    length, four, one = np.float32(size), np.float32(4.0), np.float32(1.0)
    for i in range(lit.shape[0]):
        top = find_map_top(v[i], size, sides)
        left = clamped(np.floor(u[i] - half), two, length - four)
        upper = clamped(np.floor(v[i] - half), top + two, top + length - four)
        x, y = u[i] - half - left, v[i] - half - upper
        index, stride = np.int32(upper) * np.int32(size) + np.int32(left), np.int32(size)
        tolerance = compute_tolerance(depth[i], dz_du[i], dz_dv[i])
        column_depth, row_depth = depth[i] - dz_du[i] * x, depth[i] - dz_dv[i] * y
        gain, first, is_ahead, covers = fit_steeper_plane(
            texels, index, np.int32(1), stride, x, y, column_depth, dz_du[i], dz_dv[i], tolerance
        )
        other, other_first, other_ahead, other_covers = fit_steeper_plane(
            texels, index, stride, np.int32(1), y, x, row_depth, dz_dv[i], dz_du[i], tolerance
        )
        is_row = gain >= other
        ends = ends_at_contact(
            texels, index, (np.int32(1) if is_row else stride), (stride if is_row else np.int32(1)),
            (y if is_row else x), (column_depth if is_row else row_depth),
            (dz_du[i] if is_row else dz_dv[i]), (first if is_row else other_first),
            (gain if is_row else other), (is_ahead if is_row else other_ahead),
            (left if is_row else upper - top),
            (length - one - left if is_row else top + length - one - upper), tolerance,
        )  # fmt: skip
        is_dark = (covers if is_row else other_covers) & ends & (candidates[i] > zero)
        lit[i] = zero if is_dark else lit[i]


@disjoint_helper
def mark_candidates(u, v, depth, dz_du, dz_dv, texels, size, sides, lit, candidates):
    """Write 1 where a lit sample's texel is nearer than its plane, else 0; return 1 if any is."""
    zero, half, last = np.float32(0.0), np.float32(0.5), np.float32(size - 1)
    is_any = np.int32(0)
    for i in range(lit.shape[0]):
        top = find_map_top(v[i], size, sides)
        texel_u, texel_v = np.floor(u[i]), np.floor(v[i])
        column, row = clamped(texel_u, zero, last), clamped(texel_v, top, top + last)
        plane_depth = depth[i] + dz_du[i] * (column + half - u[i]) + dz_dv[i] * (row + half - v[i])
        plane_depth += compute_tolerance(depth[i], dz_du[i], dz_dv[i])
        is_candidate = (lit[i] > zero) & (is_nearer(texels, column, row, size, plane_depth) > zero)
        is_candidate = is_candidate & (texel_u == column) & (texel_v == row)
        candidates[i] = np.float32(1.0) if is_candidate else zero
        is_any = np.int32(is_any | np.int32(is_candidate))
    return is_any


@helper
def remove_contact_leaks(u, v, depth, dz_du, dz_dv, texels, size, sides, candidates, lit):
    """Remove the light that a filter leaks where surfaces touch."""
    if mark_candidates(u, v, depth, dz_du, dz_dv, texels, size, sides, lit, candidates) != 0:
        darken_covered(u, v, depth, dz_du, dz_dv, texels, size, sides, candidates, lit)
