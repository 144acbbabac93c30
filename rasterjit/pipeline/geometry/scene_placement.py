"""
Place objects and views: matrices of normals and of projections, and boxes against planes of views.

These run before anything is drawn, for one view or for many.
"""

from __future__ import annotations

import numpy as np

from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float64, int64, uint8

CULLING_MARGIN = 2.0**-40
"""Distance beyond a plane required for culling, relative to the terms summed: far above float64's
rounding error. Snapping moves no vertex over the border of the picture."""

INSIDE, HALF_DEPTHS, CLIP_BOUNDS, MEASURES = 0, 6, 12, 15
"""Rows of what `measure_boxes` writes, and their number; see `object_transforms.BoxMeasures`."""

IS_BESIDE, IN_VIEW, FLAGS = 0, 1, 2
"""Rows of the flags that it writes, and their number."""

CENTER, BOUND, BOX_COLUMNS = 3, 4, 5
"""Columns of a box placed by `place_box`, after its axes, and their number."""

LOW, HIGH, ENDS = 0, 3, 6
"""Columns of the ends of the box around all objects, and their number."""


@helper
def power_of_two(exponent):
    """Return 2**exponent for -1074 <= exponent <= 1023."""
    if exponent < -1022:
        return np.int64(np.int64(1) << np.int64(exponent + 1074)).view(np.float64)
    return np.int64(np.int64(exponent + 1023) << np.int64(52)).view(np.float64)


@helper
def scale_factors(largest):
    """Return two powers of two whose product brings a number above 0 into [1, 2)."""
    bits = np.float64(largest).view(np.int64)
    exponent = (bits >> np.int64(52)) - np.int64(1023)
    if exponent == -1023:  # Subnormal.
        exponent = np.int64(-1074)
        rest = bits >> np.int64(1)
        while rest > 0:
            exponent += np.int64(1)
            rest >>= np.int64(1)
    first = min(-exponent, np.int64(1023))
    return power_of_two(first), power_of_two(-exponent - first)


@helper
def determinant_sign(first, second, third):
    """Return the sign of the determinant of three rows, (3,) or longer, scaled against overflow."""
    x = max(abs(first[0]), abs(first[1]), abs(first[2]))
    y = max(abs(second[0]), abs(second[1]), abs(second[2]))
    z = max(abs(third[0]), abs(third[1]), abs(third[2]))
    if not (x > 0.0 and y > 0.0 and z > 0.0):
        return 0.0
    d, e, f = second[0] / y, second[1] / y, second[2] / y
    g, h, i = third[0] / z, third[1] / z, third[2] / z
    terms = (first[0] / x) * (e * i - f * h) - (first[1] / x) * (d * i - f * g)
    terms += (first[2] / x) * (d * h - e * g)
    return 1.0 if terms > 0.0 else (-1.0 if terms < 0.0 else 0.0)


@helper
def write_normal_matrix(matrix, normals):
    """Write `transforms.normal_matrix` of a matrix, scaled so that its largest entry is 1."""
    largest = 0.0
    for i in range(3):
        for j in range(3):
            largest = max(largest, abs(matrix[i, j]))
    one, other = scale_factors(largest) if largest > 0.0 else (1.0, 1.0)
    # Cofactors of a matrix whose largest entry lies in [1, 2): no product underflows.
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            c, d = (j + 1) % 3, (j + 2) % 3
            p, q = matrix[a, c] * one * other, matrix[b, d] * one * other
            r, s = matrix[b, c] * one * other, matrix[a, d] * one * other
            normals[i, j] = p * q - r * s
    determinant = (
        matrix[0, 0] * one * other * normals[0, 0] + matrix[1, 0] * one * other * normals[1, 0]
    ) + matrix[2, 0] * one * other * normals[2, 0]
    is_finite = determinant != 0.0
    for i in range(3):
        for j in range(3):
            is_finite &= np.isfinite(normals[i, j] / determinant * one * other)
    largest = 0.0
    for i in range(3):
        for j in range(3):
            if is_finite:
                normals[i, j] = normals[i, j] / determinant * one * other + 0.0
            else:
                normals[i, j] = (-normals[i, j] if determinant < 0.0 else normals[i, j]) + 0.0
            largest = max(largest, abs(normals[i, j]))
    # So that normals keep a length near 1 in float32.
    if largest > 0.0:
        for i in range(3):
            for j in range(3):
                normals[i, j] /= largest


@kernel
def transform_normals(
    world_from_model: float64[:, :, ::1], known: float64[:, :, ::1],
    normal_matrices: float64[:, :, ::1], mirrored: float64[::1],
):  # fmt: skip
    """
    Find the matrices of normals of objects that were rotated or scaled.

    Parameters
    ----------
    world_from_model : (O, 4, 4) float64
    known : (O, 4, 4) float64
        Matrices before, whose results the next two hold; NaN where they hold none.
    normal_matrices : (O, 3, 3) float64
        Writes `transforms.normal_matrix`, scaled so that its largest entry is 1.
    mirrored : (O,) float64
        Writes -1 where a transform turns faces inside out, else 1.

    Returns
    -------
    int
        Number of objects that were rotated or scaled; signs of zeros do not count.
    """
    count = 0
    for n in range(world_from_model.shape[0]):
        is_changed = False
        for i in range(3):
            for j in range(3):
                is_changed |= world_from_model[n, i, j] != known[n, i, j]
        if is_changed:
            write_normal_matrix(world_from_model[n], normal_matrices[n])
            sign = determinant_sign(
                world_from_model[n, 0], world_from_model[n, 1], world_from_model[n, 2]
            )
            mirrored[n] = -1.0 if sign < 0.0 else 1.0
            count += 1
    return count


@helper
def multiply_matrices(a, b, product):
    """Write the product of two matrices, (4, 4); each entry is summed left to right."""
    for i in range(4):
        for j in range(4):
            product[i, j] = ((a[i, 0] * b[0, j] + a[i, 1] * b[1, j]) + a[i, 2] * b[2, j]) + (
                a[i, 3] * b[3, j]
            )


@kernel
def place_views(
    world_from_relative: float64[:, :, ::1], view_from_world: float64[:, :, ::1],
    clip_from_view: float64[:, :, ::1], view_from_relative: float64[:, :, ::1],
    clip_from_relative: float64[:, :, ::1], toward_viewer: float64[:, ::1], windings: int64[::1],
):  # fmt: skip
    """
    Find the matrices of N views, and where their viewers are.

    Parameters
    ----------
    world_from_relative : (N, 4, 4) float64
        From world axes with the origin at the eye.
    view_from_world, clip_from_view : (N, 4, 4) float64
    view_from_relative, clip_from_relative : (N, 4, 4) float64
        Written; not finite where the products overflow.
    toward_viewer : (N, 4) float64
        Writes xyzw: a point p, relative to the eye, is seen along ``xyz - w p``.
    windings : (N,) int64
        Writes 1 if a view shows counter-clockwise faces counter-clockwise, -1 if it mirrors.
    """
    for n in range(len(windings)):
        view, clip = view_from_relative[n], clip_from_view[n]
        multiply_matrices(view_from_world[n], world_from_relative[n], view)
        multiply_matrices(clip, view, clip_from_relative[n])
        is_parallel = clip[3, 0] == 0.0 and clip[3, 1] == 0.0 and clip[3, 2] == 0.0
        for j in range(3):
            # In a parallel projection, depth grows with clip z, away from the viewer.
            along = (clip[2, 0] * view[0, j] + clip[2, 1] * view[1, j]) + clip[2, 2] * view[2, j]
            toward_viewer[n, j] = -along if is_parallel else 0.0
        toward_viewer[n, 3] = 0.0 if is_parallel else 1.0
        sign = determinant_sign(clip[0], clip[1], clip[2] if is_parallel else clip[3])
        windings[n] = 1 if sign * determinant_sign(view[0], view[1], view[2]) < 0.0 else -1


@helper
def place_box(bounds, matrix, box):
    """
    Write the centre of a box, half its axes, and bounds of its coordinates, (3, 5), by world axis.

    ``matrix`` takes model space to world axes from the eye.
    """
    for i in range(3):
        center, bound = 0.0, 0.0
        for j in range(3):
            low, high, entry = bounds[0, j] / 2.0, bounds[1, j] / 2.0, matrix[i, j]
            middle, half = low + high, high - low
            center += entry * middle
            bound += abs(entry) * (abs(middle) + half)
            box[i, j] = entry * half
        box[i, CENTER], box[i, BOUND] = matrix[i, 3] + center, abs(matrix[i, 3]) + bound


@helper
def measure_plane(clip, axis, sign, box):
    """Return how far inside of w + sign * axis a box reaches, and its half extent by each axis."""
    a, b = clip[3, 0] + sign * clip[axis, 0], clip[3, 1] + sign * clip[axis, 1]
    c, d = clip[3, 2] + sign * clip[axis, 2], clip[3, 3] + sign * clip[axis, 3]
    x = abs(a * box[0, 0] + b * box[1, 0] + c * box[2, 0])
    y = abs(a * box[0, 1] + b * box[1, 1] + c * box[2, 1])
    z = abs(a * box[0, 2] + b * box[1, 2] + c * box[2, 2])
    middle = a * box[0, CENTER] + b * box[1, CENTER] + c * box[2, CENTER] + d
    return middle + (x + y + z), x, y, z


@helper
def bound_clip_position(clip, axis, box):
    """Return an upper bound of |w| plus the size of a coordinate in clip space."""
    bound = abs(clip[3, 3]) + abs(clip[axis, 3])
    for i in range(3):
        bound += (abs(clip[3, i]) + abs(clip[axis, i])) * box[i, BOUND]
    return bound


@kernel
def measure_boxes(
    bounds: float64[:, :, ::1], relative_from_model: float64[:, :, :, ::1],
    clip_from_relative: float64[:, :, ::1], measures: float64[:, :, ::1], flags: uint8[:, :, ::1],
    ends: float64[:, ::1], box: float64[:, ::1],
):  # fmt: skip
    """
    Measure the boxes of objects against the planes of each of N views.

    Parameters
    ----------
    bounds : (O, 2, 3) float64
        Low and high corner of each object, model space; NaN for one without a finite face.
    relative_from_model : (N, O, 4, 4) float64
        To world axes with the origin at the eye.
    clip_from_relative : (N, 4, 4) float64
    measures : (15, N, O) float64
        Writes rows from ``INSIDE``, ``HALF_DEPTHS`` and ``CLIP_BOUNDS``; NaN without a face.
    flags : (2, N, O) uint8
        Writes rows ``IS_BESIDE`` and ``IN_VIEW``, 0 or 1. NaN counts as in view.
    ends : (N, 6) float64
        Writes the low and the high corner of a box around all, world axes from the eye; infinite
        if one is not known; inf to -inf around nothing.
    box : (3, 5) float64, scratch
    """
    for n in range(measures.shape[1]):
        clip = clip_from_relative[n]
        for i in range(3):
            ends[n, LOW + i], ends[n, HIGH + i] = np.inf, -np.inf
        for o in range(measures.shape[2]):
            if np.isnan(bounds[o, 0, 0]):
                for k in range(MEASURES):
                    measures[k, n, o] = np.nan
                flags[IS_BESIDE, n, o], flags[IN_VIEW, n, o] = 1, 0
                continue
            place_box(bounds[o], relative_from_model[n, o], box)
            is_beside, is_beyond = False, False
            for axis in range(3):
                bound = bound_clip_position(clip, axis, box)
                measures[CLIP_BOUNDS + axis, n, o] = bound
                for side in range(2):
                    inside, x, y, z = measure_plane(clip, axis, 2.0 * side - 1.0, box)
                    measures[INSIDE + 3 * side + axis, n, o] = inside
                    if axis == 2:
                        first = HALF_DEPTHS + 3 * side
                        measures[first, n, o], measures[first + 1, n, o] = x, y
                        measures[first + 2, n, o] = z
                    is_out = inside < -CULLING_MARGIN * bound
                    is_beyond |= is_out
                    is_beside |= is_out and axis < 2
                half = abs(box[axis, 0]) + abs(box[axis, 1]) + abs(box[axis, 2])
                low, high = box[axis, CENTER] - half, box[axis, CENTER] + half
                # NaN where numbers overflow.
                ends[n, LOW + axis] = min(ends[n, LOW + axis], low if low == low else -np.inf)
                ends[n, HIGH + axis] = max(ends[n, HIGH + axis], high if high == high else np.inf)
            flags[IS_BESIDE, n, o], flags[IN_VIEW, n, o] = is_beside, not is_beyond
