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

MAX_POWER = 2.0**1000
"""Beyond which a scale is split in two: the largest power of two is less than 2**1074."""

CENTER, BOUND, BOX_COLUMNS = 3, 4, 5
"""Columns of a box placed by `place_box`, after its axes, and their number."""

LOW, HIGH, ENDS = 0, 3, 6
"""Columns of the ends of the box around all objects, and their number."""


@helper
def find_largest(matrix, row):
    """Return the largest size of the first three entries of a row."""
    largest = 0.0
    for k in range(3):
        largest = max(largest, abs(matrix[row, k]))
    return largest


@helper
def determinant_sign(matrix, last):
    """Return the sign of the determinant of rows 0, 1 and ``last``, scaled against overflow."""
    x, y, z = find_largest(matrix, 0), find_largest(matrix, 1), find_largest(matrix, last)
    terms = 0.0
    if x > 0.0 and y > 0.0 and z > 0.0:
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            forward = (matrix[1, i] / y) * (matrix[last, j] / z)
            terms += (matrix[0, k] / x) * (forward - (matrix[1, j] / y) * (matrix[last, i] / z))
    return 1.0 if terms > 0.0 else (-1.0 if terms < 0.0 else 0.0)


@helper
def write_normal_matrix(matrix, normals, scaled):
    """Write `transforms.normal_matrix` of a matrix, scaled so that its largest entry is 1."""
    # Bring the largest entry into [1, 2) by powers of two, so that no product underflows.
    largest = 0.0
    for row in range(3):
        largest = max(largest, find_largest(matrix, row))
    one, other = 1.0, 1.0
    while 0.0 < largest < 1.0:
        largest *= 2.0
        if one < MAX_POWER:
            one *= 2.0
        else:
            other *= 2.0
    while 2.0 <= largest < np.inf:
        largest *= 0.5
        one *= 0.5
    for i in range(3):
        for j in range(3):
            scaled[i, j] = matrix[i, j] * one * other
    determinant = 0.0
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            c, d = (j + 1) % 3, (j + 2) % 3
            normals[i, j] = scaled[a, c] * scaled[b, d] - scaled[b, c] * scaled[a, d]
        determinant += scaled[i, 0] * normals[i, 0]
    # Else cofactors, which are finite and turn normals the same way.
    is_finite = determinant != 0.0
    for i in range(3):
        for j in range(3):
            scaled[i, j] = normals[i, j] / determinant * one * other
            is_finite &= abs(scaled[i, j]) < np.inf
    sign = -1.0 if determinant < 0.0 else 1.0
    for i in range(3):
        for j in range(3):
            normals[i, j] = (scaled[i, j] if is_finite else sign * normals[i, j]) + 0.0
    # So that normals keep a length near 1 in float32.
    largest = 0.0
    for row in range(3):
        largest = max(largest, find_largest(normals, row))
    if largest > 0.0:
        for i in range(3):
            for j in range(3):
                normals[i, j] /= largest


@kernel
def transform_normals(
    world_from_model: float64[:, :, ::1], known: float64[:, :, ::1],
    normal_matrices: float64[:, :, ::1], mirrored: float64[::1], scaled: float64[:, ::1],
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
    scaled : (3, 3) float64, scratch

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
            write_normal_matrix(world_from_model[n], normal_matrices[n], scaled)
            mirrored[n] = -1.0 if determinant_sign(world_from_model[n], 2) < 0.0 else 1.0
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
        sign = determinant_sign(clip, 2 if is_parallel else 3) * determinant_sign(view, 2)
        windings[n] = 1 if sign < 0.0 else -1


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
def multiply_column(plane, box, column):
    """Return a x + b y + c z of a plane for a column of a placed box."""
    x, y, z = box[0, column], box[1, column], box[2, column]
    return (plane[0] * x + plane[1] * y) + plane[2] * z


@kernel
def measure_boxes(
    bounds: float64[:, :, ::1], relative_from_model: float64[:, :, :, ::1],
    clip_from_relative: float64[:, :, ::1], measures: float64[:, :, ::1], flags: uint8[:, :, ::1],
    ends: float64[:, ::1], box: float64[:, ::1], plane: float64[::1],
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
    plane : (4,) float64, scratch
    """
    for n in range(measures.shape[1]):
        clip = clip_from_relative[n]
        for i in range(3):
            ends[n, LOW + i], ends[n, HIGH + i] = np.inf, -np.inf
        for o in range(measures.shape[2]):
            if bounds[o, 0, 0] != bounds[o, 0, 0]:
                for k in range(MEASURES):
                    measures[k, n, o] = np.nan
                flags[IS_BESIDE, n, o], flags[IN_VIEW, n, o] = 1, 0
                continue
            place_box(bounds[o], relative_from_model[n, o], box)
            is_beside, is_beyond = False, False
            for axis in range(3):
                # Of both rows: their difference may nearly cancel.
                for k in range(4):
                    plane[k] = abs(clip[3, k]) + abs(clip[axis, k])
                bound = multiply_column(plane, box, BOUND) + plane[3]
                measures[CLIP_BOUNDS + axis, n, o] = bound
                for side in range(2):
                    for k in range(4):
                        plane[k] = clip[3, k] + (2.0 * side - 1.0) * clip[axis, k]
                    reach = 0.0
                    for k in range(3):
                        extent = abs(multiply_column(plane, box, k))
                        reach += extent
                        if axis == 2:
                            measures[HALF_DEPTHS + 3 * side + k, n, o] = extent
                    inside = multiply_column(plane, box, CENTER) + plane[3] + reach
                    measures[INSIDE + 3 * side + axis, n, o] = inside
                    is_out = inside < -CULLING_MARGIN * bound
                    is_beyond |= is_out
                    is_beside |= is_out and axis < 2
                half = abs(box[axis, 0]) + abs(box[axis, 1]) + abs(box[axis, 2])
                low, high = box[axis, CENTER] - half, box[axis, CENTER] + half
                # NaN where numbers overflow.
                ends[n, LOW + axis] = min(ends[n, LOW + axis], low if low == low else -np.inf)
                ends[n, HIGH + axis] = max(ends[n, HIGH + axis], high if high == high else np.inf)
            flags[IS_BESIDE, n, o], flags[IN_VIEW, n, o] = is_beside, not is_beyond
