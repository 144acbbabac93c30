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

from rasterjit.pipeline.lighting.pbr import is_any_above_zero
from rasterjit.runtime.jit import disjoint_helper, helper

HARD, PCF, SOFT = 0, 1, 2
"""Filters, as ``ShadowRecord.layouts`` numbers them."""

DEPTH_ROUNDING = np.float32(2.0**-20)
"""Largest rounding error of a stored depth, the plane and their difference, as a share of the
depth: sixteen roundings of float32."""

MIN_SEARCH_RADIUS = np.float32(2.5)
"""Least blocker search radius, texels: the narrowest penumbra, and gaps between search points."""

SEARCH_RATIO = np.float32(1.5)
"""Search radius over that of the light's disk on the map: what search points miss at that radius
hides none of the disk."""

MIN_PENUMBRA_RADIUS = np.float32(1.5)
"""Least radius of a penumbra, texels: its edge is as smooth as that of 3 x 3 comparisons."""

MAX_PENUMBRA_RADIUS = np.float32(0.25)
"""Largest radius of a penumbra, sides of a map."""

CELL_TEXELS = 4
"""Side of the cells of the first level of a map, texels: see ``maps.find_occlusion_limits``."""

NEAR_RADIUS = np.float32(5.0)
"""Search radius that no level of cells shortens, texels. Blockers farther away are higher above a
sample than its own face mostly is."""


@helper
def find_map_top(v, size, sides):
    """Return the first row of a sample's map; ``sides``: number of stacked maps, None for one."""
    if sides is None:
        return np.float32(0.0)
    length = np.float32(size)
    side = np.floor(v / length)
    side = min(max(side, np.float32(0.0)), np.float32(sides - np.float32(1.0)))
    return side * length


@helper
def count_cells(size, sides, side):
    """Return the number of cells of a side, texels, in all maps of a light."""
    count = (size + side - 1) // side
    if sides is None:
        return count * count
    return np.int64(sides) * count * count


@helper
def get_texel_number(i, j, size):
    """
    Return the number of a texel, given its column and row.

    The number is kept 32 bits wide, as products of 32-bit numbers are not by themselves: vectors of
    numbers are split to read texels, which takes most of a filter's time.
    """
    return np.uint32(np.int32(j) * np.int32(size) + np.int32(i))


@helper
def is_nearer(texels, i, j, size, plane):
    """Return 1 where a texel is nearer to the light than the plane, else 0."""
    stored = texels[np.uintp(get_texel_number(i, j, size))]
    return np.float32(1.0) if stored > plane else np.float32(0.0)


@disjoint_helper
def read_hard(u, v, depth, dz_du, dz_dv, bias, texels, size, sides, lit):
    """Compare each sample with the texel it lies in."""
    half, last = np.float32(0.5), np.float32(size - 1)
    for i in range(lit.shape[0]):
        top = find_map_top(v[i], size, sides)
        row, column = np.floor(v[i]), np.floor(u[i])
        inside = (column >= np.float32(0.0)) & (column <= last) & (row >= top) & (row <= top + last)
        column = min(max(column, np.float32(0.0)), last)
        row = min(max(row, top), top + last)
        plane = depth[i] + dz_du[i] * (column + half - u[i]) + dz_dv[i] * (row + half - v[i])
        plane += bias[i]
        shaded = is_nearer(texels, column, row, size, plane)
        lit[i] = np.float32(1.0) - (shaded if inside else np.float32(0.0))


@helper
def compare_four(texels, index, plane, step, first, last):
    """Return the weighted comparisons with four texels of a row: weights first, 1, 1, last."""
    zero, one = np.float32(0.0), np.float32(1.0)
    two = np.float32(2.0) * step
    total = first if texels[np.uintp(index)] > plane else zero
    total += one if texels[np.uintp(np.uint32(index + np.uint32(1)))] > plane + step else zero
    total += one if texels[np.uintp(np.uint32(index + np.uint32(2)))] > plane + two else zero
    total += (
        last if texels[np.uintp(np.uint32(index + np.uint32(3)))] > plane + (two + step) else zero
    )
    return total


@disjoint_helper
def read_pcf(u, v, depth, dz_du, dz_dv, bias, texels, size, sides, lit):
    """Compare each sample with 3 x 3 texels, each between four by their weight."""
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)
    length, last = np.float32(size), np.float32(size - 4)
    for i in range(lit.shape[0]):
        top = find_map_top(v[i], size, sides)
        inside = (u[i] >= zero) & (u[i] <= length) & (v[i] >= top) & (v[i] <= top + length)
        left, above = np.floor(u[i] - half), np.floor(v[i] - half)
        right, below = u[i] - half - left, v[i] - half - above
        column = min(max(left - one, zero), last)
        row = min(max(above - one, top), top + last)
        plane = depth[i] + dz_du[i] * (column + half - u[i]) + dz_dv[i] * (row + half - v[i])
        plane += bias[i]
        index = get_texel_number(column, row, size)
        step, gain = dz_du[i], dz_dv[i]
        total = (one - below) * compare_four(texels, index, plane, step, one - right, right)
        index = np.uint32(index + np.uint32(size))
        total += compare_four(texels, index, plane + gain, step, one - right, right)
        index = np.uint32(index + np.uint32(size))
        plane += np.float32(2.0) * gain
        total += compare_four(texels, index, plane, step, one - right, right)
        index = np.uint32(index + np.uint32(size))
        total += below * compare_four(texels, index, plane + gain, step, one - right, right)
        shaded = total * np.float32(1.0 / 9.0)
        lit[i] = one - (min(shaded, one) if inside else zero)


@helper
def is_blocker(
    u, v, depth, dz_du, dz_dv, bias, texels, size, sides, widening, dx, dy
):  # fmt: skip
    """
    Return whether the texel ``dx``, ``dy`` texels from a sample is a blocker, and its height above.

    A blocker is nearer to the light than the plane of the sample's face, and occludes some of the
    light's disk as seen from the sample.
    """
    half, zero = np.float32(0.5), np.float32(0.0)
    last, top = np.float32(size - 1), find_map_top(v, size, sides)
    texel_u, texel_v = np.floor(u + dx), np.floor(v + dy)
    column, row = min(max(texel_u, zero), last), min(max(texel_v, top), top + last)
    right, below = column + half - u, row + half - v
    plane = depth + dz_du * right + dz_dv * below
    plane += bias
    stored = texels[np.uintp(get_texel_number(column, row, size))]
    above = stored - depth
    # Texels below the sample's depth count where they are close by.
    radius = max(SEARCH_RATIO * (widening * above) + MIN_SEARCH_RADIUS, -MIN_SEARCH_RADIUS)
    shades = (stored > plane) & (right * right + below * below <= radius * radius)
    return shades & (column == texel_u) & (row == texel_v), above


@disjoint_helper
def add_blockers(
    u, v, depth, dz_du, dz_dv, bias, texels, size, sides, widening, dx, dy, weights, heights
):  # fmt: skip
    """
    Add up the weights, and the weighted heights, of blockers ``dx``, ``dy`` texels from samples.

    A blocker is weighted by the share of the disk that it hides, with the texels around it that no
    other search point covers.
    """
    zero, area = np.float32(0.0), dx * dx + dy * dy
    for i in range(weights.shape[0]):
        shades, above = is_blocker(
            u[i], v[i], depth[i], dz_du[i], dz_dv[i], bias[i], texels, size, sides, widening, dx, dy
        )
        radius = max(widening * above, zero) + MIN_PENUMBRA_RADIUS
        weight = area / (radius * radius) if shades else zero
        weights[i] += weight
        heights[i] += weight * above if shades else zero


@disjoint_helper
def mark_blockers(
    u, v, depth, dz_du, dz_dv, bias, texels, size, sides, widening, dx, dy, marks
):  # fmt: skip
    """Write 1 where the texel ``dx``, ``dy`` texels from a sample is a blocker."""
    for i in range(marks.shape[0]):
        shades, _ = is_blocker(
            u[i], v[i], depth[i], dz_du[i], dz_dv[i], bias[i], texels, size, sides, widening, dx, dy
        )
        marks[i] = np.float32(1.0) if shades else marks[i]


@helper
def compare_two(texels, index, plane, step, right):
    """Return the comparisons with two texels of a row, the second of weight ``right``."""
    zero, one = np.float32(0.0), np.float32(1.0)
    total = (one - right) if texels[np.uintp(index)] > plane else zero
    beside = texels[np.uintp(np.uint32(index + np.uint32(1)))]
    return total + (right if beside > plane + step else zero)


@disjoint_helper
def read_penumbra(
    u, v, depth, dz_du, dz_dv, bias, texels, size, sides, widening, dx, dy, weights, heights, lit
):  # fmt: skip
    """Subtract one comparison in the penumbra of each sample from its visibility."""
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)
    last, max_radius = np.float32(size - 2), MAX_PENUMBRA_RADIUS * np.float32(size)
    for i in range(lit.shape[0]):
        top = find_map_top(v[i], size, sides)
        above = heights[i] / (weights[i] if weights[i] > zero else one)
        radius = min(max(MIN_PENUMBRA_RADIUS, widening * above), max_radius)
        texel_u, texel_v = u[i] + dx * radius - half, v[i] + dy * radius - half
        left, upper = np.floor(texel_u), np.floor(texel_v)
        right, below = texel_u - left, texel_v - upper
        column, row = min(max(left, zero), last), min(max(upper, top), top + last)
        plane = depth[i] + dz_du[i] * (column + half - u[i]) + dz_dv[i] * (row + half - v[i])
        plane += bias[i]
        index = get_texel_number(column, row, size)
        total = (one - below) * compare_two(texels, index, plane, dz_du[i], right)
        plane += dz_dv[i]
        under = np.uint32(index + np.uint32(size))
        total += below * compare_two(texels, under, plane, dz_du[i], right)
        lit[i] -= total if weights[i] > zero else zero


@disjoint_helper
def normalize_visibility(u, v, size, sides, comparisons, lit):
    """Divide the visibility by the number of comparisons; 1 outside of the map."""
    length, one, zero = np.float32(size), np.float32(1.0), np.float32(0.0)
    for i in range(lit.shape[0]):
        top = find_map_top(v[i], size, sides)
        inside = (u[i] >= zero) & (u[i] <= length) & (v[i] >= top) & (v[i] <= top + length)
        lit[i] = max(lit[i] / comparisons, zero) if inside else one


@disjoint_helper
def can_any_be_shaded(u, v, depth, facing, size, sides, cells, side):
    """Return whether blockers beyond a ring may shade any sample, by cells of a side."""
    zero, inverse = np.float32(0.0), np.float32(1.0) / np.float32(side)
    count = np.int32((size + side - 1) // side)
    last, is_any = np.float32(count) - np.float32(1.0), np.int32(0)
    for i in range(facing.shape[0]):
        top = find_map_top(v[i], size, sides)
        column = min(max(np.floor(u[i] * inverse), zero), last)
        row = min(max(np.floor((v[i] - top) * inverse), zero), last)
        row += np.floor(top / np.float32(size)) * np.float32(count)
        index = get_texel_number(column, row, count)
        is_deep = (depth[i] < cells[np.uintp(index)]) & (facing[i] > zero)
        is_any = np.int32(is_any | np.int32(is_deep))
    return is_any != 0


@helper
def mark_shaded(
    u, v, depth, dz_du, dz_dv, bias, texels, size, sides, widening, cells, spiral, facing, marks
):  # fmt: skip
    """
    Write 1 for samples with a blocker, 0 for others: ring by ring, as far as any may have one.

    Samples whose row ``facing`` is not above 0 get 0.
    """
    for i in range(marks.shape[0]):
        marks[i] = np.float32(0.0)
    if not is_any_above_zero(facing):
        return
    farthest, radius = MAX_PENUMBRA_RADIUS * np.float32(size) + np.float32(1.0), NEAR_RADIUS
    k, first, side = np.int64(0), np.int64(0), np.int64(CELL_TEXELS)
    while k < spiral.shape[0]:
        dx, dy = spiral[k, 0], spiral[k, 1]
        if dx * dx + dy * dy > farthest * farthest:
            break
        if dx * dx + dy * dy > radius * radius:
            if not can_any_be_shaded(u, v, depth, facing, size, sides, cells[first:], side):
                break
            first += count_cells(size, sides, side)
            radius = np.float32(2 * side)
            side *= 2
        mark_blockers(
            u, v, depth, dz_du, dz_dv, bias, texels, size, sides, widening, dx, dy, marks
        )  # fmt: skip
        k += 1
    for i in range(marks.shape[0]):
        marks[i] = marks[i] if facing[i] > np.float32(0.0) else np.float32(0.0)


@helper
def read_soft(
    u, v, depth, dz_du, dz_dv, bias, texels, size, sides, widening, pattern, spiral, weights,
    heights, lit,
):  # fmt: skip
    """Estimate the penumbra of samples that have blockers, and filter over it (PCSS)."""
    comparisons = np.float32(pattern.shape[0])
    farthest = MAX_PENUMBRA_RADIUS * np.float32(size) + np.float32(1.0)
    for i in range(lit.shape[0]):
        weights[i], heights[i], lit[i] = np.float32(0.0), np.float32(0.0), comparisons
    for k in range(spiral.shape[0]):
        dx, dy = spiral[k, 0], spiral[k, 1]
        if dx * dx + dy * dy <= farthest * farthest:
            add_blockers(
                u, v, depth, dz_du, dz_dv, bias, texels, size, sides, widening, dx, dy, weights,
                heights,
            )  # fmt: skip
    for k in range(pattern.shape[0]):
        read_penumbra(
            u, v, depth, dz_du, dz_dv, bias, texels, size, sides, widening, pattern[k, 0],
            pattern[k, 1], weights, heights, lit,
        )  # fmt: skip
    normalize_visibility(u, v, size, sides, comparisons, lit)
