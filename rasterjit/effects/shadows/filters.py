"""
Filter shadow maps: hard, PCF 3 x 3, or percentage-closer soft shadows (PCSS).

A texel occludes where it is nearer to the light than the plane of the sample's face there, by more
than the bias (receiver plane depth bias) [3]_. The maps of a light with several lie one below the
other; outside of them all is lit.

References
----------
.. [1] W. Reeves, D. Salesin, R. Cook, "Rendering Antialiased Shadows with Depth Maps",
   SIGGRAPH 1987: percentage-closer filtering.
.. [2] R. Fernando, "Percentage-Closer Soft Shadows", SIGGRAPH 2005 sketches.
.. [3] J. Isidoro, "Shadow Mapping: GPU-based Tips and Techniques", GDC 2006: receiver planes.
"""

from __future__ import annotations

import numpy as np

from rasterjit.runtime.jit import disjoint_helper, helper

HARD, PCF, SOFT = 0, 1, 2
"""Filters, as ``ShadowRecord.places`` numbers them."""

DEPTH_ROUNDING = np.float32(2.0**-20)
"""Share of a stored depth that rounding of it, of the plane and of their difference may reach:
sixteen roundings of float32."""

SEARCHED = np.float32(2.5)
"""Least blocker search radius, texels: the narrowest penumbra, and gaps between search points."""

SPREAD = np.float32(1.5)
"""How many times as far aside as the light's disk reaches is searched: what the points that are
looked at miss at that radius hides none of the disk yet."""

NARROWEST = np.float32(1.5)
"""Least radius of a penumbra, texels: its edge is as smooth as that of 3 x 3 comparisons."""

MAX_RADIUS = np.float32(0.25)
"""Largest radius of a penumbra, sides of a map."""

CELLS = 16
"""Cells along the side of a map of a soft light: of each, the greatest stored depth is known."""

NARROWINGS = 3
"""How often what lies too far to shade some samples is left out, by the cells."""


@helper
def limits(v, size, sides):
    """Return the first row of the map that a sample lies in; ``sides`` None: there is one map."""
    if sides is None:
        return np.float32(0.0)
    length = np.float32(size)
    side = np.floor(v / length)
    side = min(max(side, np.float32(0.0)), np.float32(sides - np.float32(1.0)))
    return side * length


@helper
def last_row(size, sides):
    """Return the last row of all maps of a light."""
    if sides is None:
        return np.float32(size) - np.float32(1.0)
    return sides * np.float32(size) - np.float32(1.0)


@helper
def cell_side(size):
    """Return the side of a cell of a map, texels; those at the end may be smaller."""
    return (size + CELLS - 1) // CELLS


@helper
def is_nearer(texels, i, j, size, plane):
    """Return 1 where a texel holds something nearer to the light than the plane, else 0."""
    stored = texels[np.uintp(np.int32(j) * np.int32(size) + np.int32(i))]
    return np.float32(1.0) if stored > plane else np.float32(0.0)


@disjoint_helper
def read_hard(u, v, depth, across, down, bias, texels, size, sides, share):
    """Compare each sample with the texel it lies in."""
    half, last = np.float32(0.5), np.float32(size - 1)
    for i in range(share.shape[0]):
        top = limits(v[i], size, sides)
        row, column = np.floor(v[i]), np.floor(u[i])
        inside = (column >= np.float32(0.0)) & (column <= last) & (row >= top) & (row <= top + last)
        column = min(max(column, np.float32(0.0)), last)
        row = min(max(row, top), top + last)
        plane = depth[i] + across[i] * (column + half - u[i]) + down[i] * (row + half - v[i])
        plane += bias[i] + DEPTH_ROUNDING * abs(depth[i])
        shaded = is_nearer(texels, column, row, size, plane)
        share[i] = np.float32(1.0) - (shaded if inside else np.float32(0.0))


@helper
def compare_four(texels, at, plane, step, first, last):
    """Return the weighted comparisons with four texels of a row: weights first, 1, 1, last."""
    zero, one = np.float32(0.0), np.float32(1.0)
    two = np.float32(2.0) * step
    total = first if texels[np.uintp(at)] > plane else zero
    total += one if texels[np.uintp(at + np.int32(1))] > plane + step else zero
    total += one if texels[np.uintp(at + np.int32(2))] > plane + two else zero
    total += last if texels[np.uintp(at + np.int32(3))] > plane + (two + step) else zero
    return total


@disjoint_helper
def read_pcf(u, v, depth, across, down, bias, texels, size, sides, share):
    """Compare each sample with 3 x 3 texels, each between four by their weight."""
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)
    length, last = np.float32(size), np.float32(size - 4)
    for i in range(share.shape[0]):
        top = limits(v[i], size, sides)
        inside = (u[i] >= zero) & (u[i] <= length) & (v[i] >= top) & (v[i] <= top + length)
        left, above = np.floor(u[i] - half), np.floor(v[i] - half)
        right, below = u[i] - half - left, v[i] - half - above
        column = min(max(left - one, zero), last)
        row = min(max(above - one, top), top + last)
        plane = depth[i] + across[i] * (column + half - u[i]) + down[i] * (row + half - v[i])
        plane += bias[i] + DEPTH_ROUNDING * abs(depth[i])
        at = np.int32(row) * np.int32(size) + np.int32(column)
        step, gain = across[i], down[i]
        total = (one - below) * compare_four(texels, at, plane, step, one - right, right)
        at += np.int32(size)
        total += compare_four(texels, at, plane + gain, step, one - right, right)
        at += np.int32(size)
        plane += np.float32(2.0) * gain
        total += compare_four(texels, at, plane, step, one - right, right)
        at += np.int32(size)
        total += below * compare_four(texels, at, plane + gain, step, one - right, right)
        shaded = total * np.float32(1.0 / 9.0)
        share[i] = one - (min(shaded, one) if inside else zero)


@disjoint_helper
def find_shading(
    u, v, depth, across, down, bias, texels, size, sides, widening, dx, dy, found, nearer
):  # fmt: skip
    """
    Test the texel ``dx``, ``dy`` texels from each sample as a blocker.

    It is one if it is nearer to the light than the plane of the sample's face, and occludes some of
    the light's disk as seen from the sample. It is weighted by the share of the disk that it hides,
    with the texels around it that no other search point covers.
    """
    half, zero = np.float32(0.5), np.float32(0.0)
    last = np.float32(size - 1)
    area = dx * dx + dy * dy
    for i in range(found.shape[0]):
        top = limits(v[i], size, sides)
        at_u, at_v = np.floor(u[i] + dx), np.floor(v[i] + dy)
        column, row = min(max(at_u, zero), last), min(max(at_v, top), top + last)
        right, below = column + half - u[i], row + half - v[i]
        plane = depth[i] + across[i] * right + down[i] * below
        plane += bias[i] + DEPTH_ROUNDING * abs(depth[i])
        stored = texels[np.uintp(np.int32(row) * np.int32(size) + np.int32(column))]
        reach = widening * (stored - depth[i])
        # Below the sample only SEARCHED counts: `farthest_shading` leaves out the rest of a block.
        looked = max(SPREAD * reach + SEARCHED, -SEARCHED)
        shades = (stored > plane) & (right * right + below * below <= looked * looked)
        shades = shades & (column == at_u) & (row == at_v)
        reach = max(reach, zero) + NARROWEST
        weight = area / (reach * reach) if shades else zero
        found[i] += weight
        nearer[i] += weight * (stored - depth[i]) if shades else zero


@helper
def compare_two(texels, at, plane, step, right):
    """Return the comparisons with two texels of a row, the second of weight ``right``."""
    zero, one = np.float32(0.0), np.float32(1.0)
    total = (one - right) if texels[np.uintp(at)] > plane else zero
    return total + (right if texels[np.uintp(at + np.int32(1))] > plane + step else zero)


@disjoint_helper
def read_penumbra(
    u, v, depth, across, down, bias, texels, size, sides, widening, dx, dy, found, nearer, share
):  # fmt: skip
    """Subtract what one comparison in the penumbra of each sample finds in shadow."""
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)
    last, most = np.float32(size - 2), MAX_RADIUS * np.float32(size)
    for i in range(share.shape[0]):
        top = limits(v[i], size, sides)
        above = nearer[i] / (found[i] if found[i] > zero else one)
        radius = min(max(NARROWEST, widening * above), most)
        at_u, at_v = u[i] + dx * radius - half, v[i] + dy * radius - half
        left, upper = np.floor(at_u), np.floor(at_v)
        right, below = at_u - left, at_v - upper
        column, row = min(max(left, zero), last), min(max(upper, top), top + last)
        plane = depth[i] + across[i] * (column + half - u[i]) + down[i] * (row + half - v[i])
        plane += bias[i] + DEPTH_ROUNDING * abs(depth[i])
        at = np.int32(row) * np.int32(size) + np.int32(column)
        total = (one - below) * compare_two(texels, at, plane, across[i], right)
        plane += down[i]
        total += below * compare_two(texels, at + np.int32(size), plane, across[i], right)
        share[i] -= total if found[i] > zero else zero


@disjoint_helper
def finish_penumbra(u, v, size, sides, comparisons, share):
    """Turn what is left of the comparisons into a share of light."""
    length, one, zero = np.float32(size), np.float32(1.0), np.float32(0.0)
    for i in range(share.shape[0]):
        top = limits(v[i], size, sides)
        inside = (u[i] >= zero) & (u[i] <= length) & (v[i] >= top) & (v[i] <= top + length)
        share[i] = max(share[i] / comparisons, zero) if inside else one


@helper
def cell_of(row, size):
    """Return the row of cells that a row of the maps lies in."""
    side = np.int64(row) // size
    return side * CELLS + (np.int64(row) - side * size) // cell_side(size)


@helper
def highest_between(highest, left, right, upper, lower, size):
    """Return the greatest stored depth of the cells from texel to texel, both included."""
    found, side = np.float32(-np.inf), cell_side(size)
    for j in range(cell_of(upper, size), cell_of(lower, size) + 1):
        for i in range(np.int64(left) // side, np.int64(right) // side + 1):
            found = max(found, highest[j, i])
    return found


@disjoint_helper
def range_of(x):
    """Return the lowest and the highest of some numbers."""
    low, high = x[0], x[0]
    for i in range(x.shape[0]):
        low = x[i] if x[i] < low else low
        high = x[i] if x[i] > high else high
    return low, high


@helper
def farthest_shading(u, v, depth, size, sides, widening, highest):
    """
    Return how far from any of the samples something may lie that shades it, texels.

    As far as the highest thing would, and then, as nothing farther shades them, the highest of
    what lies no farther from them than that.
    """
    zero, last = np.float32(0.0), np.float32(size - 1)
    lowest, _ = range_of(depth)
    left, right = range_of(u)
    upper, lower = range_of(v)
    farthest = MAX_RADIUS * np.float32(size)
    for _ in range(NARROWINGS):
        # A point looks at the texel that it lies in, whose middle is less than one away.
        around = farthest + np.float32(1.0)
        most = highest_between(
            highest,
            min(max(left - around, zero), last), min(max(right + around, zero), last),
            min(max(upper - around, zero), last_row(size, sides)),
            min(max(lower + around, zero), last_row(size, sides)),
            size,
        )  # fmt: skip
        reach = SPREAD * widening * max(most - lowest, zero) + SEARCHED
        farthest = min(farthest, reach)
    return farthest + np.float32(1.0)


@helper
def read_soft(
    u, v, depth, across, down, bias, texels, size, sides, widening, highest, pattern, spiral,
    facing, found, nearer, share,
):  # fmt: skip
    """
    Estimate each sample's penumbra from its blockers, and filter over it (PCSS).

    What does not face the light, by a row that is above 0 where it does, has none of it.
    """
    if share.shape[0] == 0:
        return
    if range_of(facing)[1] <= np.float32(0.0):
        for i in range(share.shape[0]):
            share[i] = np.float32(0.0)
        return
    comparisons = np.float32(pattern.shape[0])
    for i in range(share.shape[0]):
        found[i], nearer[i], share[i] = np.float32(0.0), np.float32(0.0), comparisons
    farthest = farthest_shading(u, v, depth, size, sides, widening, highest)
    for k in range(spiral.shape[0]):
        dx, dy = spiral[k, 0], spiral[k, 1]
        if dx * dx + dy * dy <= farthest * farthest:
            find_shading(
                u, v, depth, across, down, bias, texels, size, sides, widening, dx, dy, found,
                nearer,
            )  # fmt: skip
    shaded = np.float32(0.0)
    for i in range(share.shape[0]):
        found[i] = found[i] if facing[i] > np.float32(0.0) else np.float32(0.0)
        shaded = max(shaded, found[i])
    if shaded > np.float32(0.0):
        for k in range(pattern.shape[0]):
            read_penumbra(
                u, v, depth, across, down, bias, texels, size, sides, widening, pattern[k, 0],
                pattern[k, 1], found, nearer, share,
            )  # fmt: skip
    finish_penumbra(u, v, size, sides, comparisons, share)
