"""
Find the depth range of the visible parts of faces, to choose near and far planes.

The part of a face inside the four sides of the frustum has its extreme depths at its vertices,
where its edges cross sides, or where the frustum's own edges pierce it. Segments and points are
faces with two and one distinct vertices.
"""

from __future__ import annotations

import numpy as np

from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float64, int32, int64

FACES_PER_BOX = 256
"""Consecutive faces in one bounding box."""

SIDES, DEPTH_ROW = 4, 4
"""Sides of the frustum, the first rows, in an order around it; then the row of depths."""

MIN_DEPTH, MAX_DEPTH, COUNT_BEFORE_NEAR, COUNT_BEYOND_FAR = 0, 1, 2, 3
"""Elements of the result: least and greatest visible depth; numbers of faces that reach before
the near plane, and beyond the far one."""

RELATIVE_ERROR = 2.0**-30
"""Assumed relative error: far more than the rounding of float64."""


@helper
def multiply_row(rows, row, point):
    """Return the product of a matrix row and a point."""
    x, y, z = rows[row, 0] * point[0], rows[row, 1] * point[1], rows[row, 2] * point[2]
    return x + y + z + rows[row, 3]


@helper
def is_visible(distances, tolerances, w):
    """Tell if a face's point, by weights, is inside all sides; ``distances``: (row, corner)."""
    for side in range(SIDES):
        value = w[0] * distances[side, 0] + w[1] * distances[side, 1] + w[2] * distances[side, 2]
        if not value >= -tolerances[side]:
            return False
    return True


@helper
def extend_range(distances, tolerances, w, depth_range):
    """Extend the depth range by the point of a face with three given weights, if it is visible."""
    if is_visible(distances, tolerances, w):
        depths = distances[DEPTH_ROW]
        depth = w[0] * depths[0] + w[1] * depths[1] + w[2] * depths[2]
        depth_range[0] = min(depth_range[0], depth)
        depth_range[1] = max(depth_range[1], depth)


@helper
def may_be_visible(distances, tolerances, corner_count):
    """Tell whether a face is neither outside the frustum nor edge-on; write error tolerances."""
    tolerance_sum = 0.0
    for side in range(SIDES):
        a, b, c = distances[side, 0], distances[side, 1], distances[side, 2]
        if not (a >= 0.0 or b >= 0.0 or c >= 0.0):
            return False
        tolerances[side] = RELATIVE_ERROR * (abs(a) + abs(b) + abs(c))
        tolerance_sum += tolerances[side]
    if corner_count < 3:
        return tolerance_sum < np.inf
    volume, terms = 0.0, 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        plus_term = distances[0, i] * (distances[1, j] * distances[2, k])
        minus_term = distances[0, i] * (distances[1, k] * distances[2, j])
        volume += plus_term - minus_term
        terms += abs(plus_term) + abs(minus_term)
    # NaN is not drawn.
    return abs(volume) > RELATIVE_ERROR * terms


@helper
def may_skip_point(rows, vertices, vertex, near, far):
    """Tell whether a point lies between near and far, behind the eye or beside the view."""
    x, y, z = vertices[vertex, 0], vertices[vertex, 1], vertices[vertex, 2]
    depth = (
        rows[DEPTH_ROW, 0] * x
        + rows[DEPTH_ROW, 1] * y
        + rows[DEPTH_ROW, 2] * z
        + rows[DEPTH_ROW, 3]
    )
    # One branch, well predicted.
    if not ((depth > 0.0) & ((depth < near) | (depth > far))):
        return True
    is_in = True
    for side in range(DEPTH_ROW):
        inside = rows[side, 0] * x + rows[side, 1] * y + rows[side, 2] * z + rows[side, 3]
        is_in &= inside >= 0.0
    return not is_in


@helper
def find_face_range(distances, tolerances, w, depth_range):
    """Write the range of visible depths of a face: inf and -inf if none is visible."""
    depth_range[0], depth_range[1] = np.inf, -np.inf
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        # Vertices.
        w[i], w[j], w[k] = 1.0, 0.0, 0.0
        extend_range(distances, tolerances, w, depth_range)
        # Edges crossing sides of the frustum.
        for side in range(SIDES):
            start, stop = distances[side, i], distances[side, j]
            if (start < 0.0) != (stop < 0.0):
                t = start / (start - stop)
                w[i], w[j] = 1.0 - t, t
                extend_range(distances, tolerances, w, depth_range)
    # Edges of the frustum piercing the face.
    for p in range(DEPTH_ROW):
        q = (p + 1) % DEPTH_ROW
        total = 0.0
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            w[i] = distances[p, j] * distances[q, k] - distances[p, k] * distances[q, j]
            total += w[i]
        if total != 0.0:
            for i in range(3):
                w[i] /= total
            if w[0] >= 0.0 and w[1] >= 0.0 and w[2] >= 0.0:
                extend_range(distances, tolerances, w, depth_range)


@kernel
def bound_faces(
    vertices: float64[:, ::1], faces: int32[:, ::1], lows: float64[:, ::1], highs: float64[:, ::1]
):  # fmt: skip
    """
    Compute bounding boxes, each of ``FACES_PER_BOX`` consecutive faces.

    Parameters
    ----------
    vertices : (V, 3) float64, model space
    faces : (F, 3) int32
    lows, highs : (3, B) float64
        Writes the boxes' corners; NaN is left out, as no such face is drawn.
    """
    for box in range(lows.shape[1]):
        for axis in range(3):
            low, high = np.inf, -np.inf
            for face in range(box * FACES_PER_BOX, min((box + 1) * FACES_PER_BOX, faces.shape[0])):
                for i in range(3):
                    value = vertices[faces[face, i], axis]
                    low = value if value < low else low
                    high = value if value > high else high
            lows[axis, box], highs[axis, box] = low, high


@kernel
def find_visible_depths(
    vertices: float64[:, ::1], faces: int32[:, ::1], boxes: int64[::1], rows: float64[:, ::1],
    planes: (float64, float64), corner_count: int64, result: float64[::1], scratch: float64[:, ::1],
):  # fmt: skip
    """
    Find the visible depth range of the faces that reach before a near or beyond a far plane.

    Parameters
    ----------
    vertices : (V, 3) float64, model space
    faces : (F, 3) int32
    boxes : (N,) int64
        The boxes of faces to search.
    rows : (5, 4) float64
        Matrix from model space to a point's distances inside each side of the view, and its depth
        along the viewing axis.
    planes : (float, float)
        Depths of the near and the far plane.
    corner_count : int
        Corners of a face: 3; of a segment 2, of a point 1. Point ``n`` is vertex ``n``.
    result : (4,) float64
        Extended by these faces: see ``MIN_DEPTH``.
    scratch : (8, 4) float64
        Not shared with other calls.
    """
    distances, tolerances, w, depth_range = scratch[:5], scratch[5], scratch[6], scratch[7]
    near, far = planes
    for n in range(boxes.shape[0]):
        box = boxes[n]
        for face in range(box * FACES_PER_BOX, min((box + 1) * FACES_PER_BOX, faces.shape[0])):
            if corner_count == 1 and may_skip_point(rows, vertices, np.uintp(face), near, far):
                continue
            a, b, c = vertices[faces[face, 0]], vertices[faces[face, 1]], vertices[faces[face, 2]]
            first, second = multiply_row(rows, DEPTH_ROW, a), multiply_row(rows, DEPTH_ROW, b)
            third = multiply_row(rows, DEPTH_ROW, c)
            low, high = min(first, second, third), max(first, second, third)
            if not high > 0.0 or not (low < near or high > far):
                continue
            for row in range(DEPTH_ROW + 1):
                distances[row, 0] = multiply_row(rows, row, a)
                distances[row, 1] = multiply_row(rows, row, b)
                distances[row, 2] = multiply_row(rows, row, c)
            if not may_be_visible(distances, tolerances, corner_count):
                continue
            find_face_range(distances, tolerances, w, depth_range)
            least, most = depth_range[0], depth_range[1]
            if most > 0.0:
                least = max(least, 0.0)
                result[MIN_DEPTH] = min(result[MIN_DEPTH], least)
                result[MAX_DEPTH] = max(result[MAX_DEPTH], most)
                result[COUNT_BEFORE_NEAR] += 1.0 if least < near else 0.0
                result[COUNT_BEYOND_FAR] += 1.0 if most > far else 0.0
