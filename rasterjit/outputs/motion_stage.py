"""
Find where visible points were on the screen in an earlier view, and whether they were visible then.

A point of a face has the same weights at both times; it moves with its vertices. Both positions are
computed by the same arithmetic, so the motion of a still point is exactly 0.

A point was seen if its face was seen at the centre of the pixel that held it; or if no face hid it
that was seen there, or at the centre of one of the eight pixels around. A face hides it if it
covers the place of the point and is nearer there. Where faces are smaller than pixels, what covers
that place may not have been seen at any centre. So the face at the centre of the point's own pixel
hides it too, whatever it covers, if it is nearer both at that centre, than the plane of the point's
own face, and at the place of the point, there with its own plane. Of two faces that meet at an edge
one of the two does not hold, if the surface bends one way; faces that share a vertex hide nothing
but what they cover.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.geometry.setup import get_face_vertices
from rasterjit.pipeline.records import Geometry
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int8, int32, int64, uint8

COLUMN, ROW, CLIP_Z, CLIP_W, STORED_DEPTH = 0, 1, 2, 3, 4
"""
Rows of the matrices that take points of the model to the screen, all to be divided by ``CLIP_W``:
column and row in pixels, clip-space z, clip-space w, stored depth.
"""

DEPTH_TOLERANCE = 2.0**-22
"""Relative difference above which a depth is nearer: a step of float32, the type of the depth
buffer."""


@helper
def apply_row(matrices, owner, row, x, y, z):
    """Return one row of an object's matrix times a point."""
    m = matrices
    return m[owner, row, 0] * x + m[owner, row, 1] * y + m[owner, row, 2] * z + m[owner, row, 3]


@helper
def interpolate_point(weights, a, b, c, positions):
    """Return the point of a face in model space."""
    p = positions
    return (
        barycentric.interpolate(weights, p[a, 0], p[b, 0], p[c, 0]),
        barycentric.interpolate(weights, p[a, 1], p[b, 1], p[c, 1]),
        barycentric.interpolate(weights, p[a, 2], p[b, 2], p[c, 2]),
    )


@helper
def project_to_pixels(point, owner, matrices):
    """Return column and row of a point in pixels, and its w; undefined unless w > 0."""
    x, y, z = point
    w = apply_row(matrices, owner, CLIP_W, x, y, z)
    return (
        apply_row(matrices, owner, COLUMN, x, y, z) / w,
        apply_row(matrices, owner, ROW, x, y, z) / w,
        w,
    )


@helper
def offset_from_pixel(vertex, owner, positions, matrices, x, y):
    """Return a vertex's w times its offset from (x, y) in pixels, its w, and w times its depth."""
    p = positions
    px, py, pz = p[vertex, 0], p[vertex, 1], p[vertex, 2]
    w = apply_row(matrices, owner, CLIP_W, px, py, pz)
    return (
        apply_row(matrices, owner, COLUMN, px, py, pz) - x * w,
        apply_row(matrices, owner, ROW, px, py, pz) - y * w,
        w,
        apply_row(matrices, owner, STORED_DEPTH, px, py, pz),
    )


@helper
def evaluate_face(corners, owner, positions, matrices, x, y):
    """
    Return the stored depth of a face's plane at (x, y) in pixels, its winding, and if it covers it.

    The depth is NaN where the plane is seen edge on. The winding is positive if the corners run
    clockwise. That of a segment is 0, its depth that of the foot of the perpendicular, and a
    point's its own.
    """
    u0, v0, w0, d0 = offset_from_pixel(corners[0], owner, positions, matrices, x, y)
    u1, v1, w1, d1 = offset_from_pixel(corners[1], owner, positions, matrices, x, y)
    u2, v2, w2, d2 = offset_from_pixel(corners[2], owner, positions, matrices, x, y)
    if corners[1] == corners[2]:
        dx, dy = u1 * w0 - u0 * w1, v1 * w0 - v0 * w1
        first, second = u0 * dx + v0 * dy, u1 * dx + v1 * dy
        t = barycentric.find_segment_parameter(first, second, w0, w1)
        return ((1.0 - t) * d0 + t * d1) / ((1.0 - t) * w0 + t * w1), 0.0, False
    b0, b1, b2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    winding = b0 * w0 + b1 * w1 + b2 * w2
    if winding == 0.0:
        return np.nan, winding, False
    covers = min(b0 * winding, b1 * winding, b2 * winding) >= 0.0
    return (b0 * d0 + b1 * d1 + b2 * d2) / winding, winding, covers


@helper
def is_nearer(depth, other_depth):
    """Return whether a stored depth is nearer than another by more than rounding."""
    return depth - other_depth > DEPTH_TOLERANCE * (abs(depth) + abs(other_depth))


@helper
def share_vertex(corners, other_corners, positions):
    """Return whether two faces of an object have a corner at the same place."""
    is_shared = False
    for a in corners:
        for b in other_corners:
            has_same_xy = positions[a, 0] == positions[b, 0] and positions[a, 1] == positions[b, 1]
            is_shared = is_shared or (has_same_xy and positions[a, 2] == positions[b, 2])
    return is_shared


@helper
def was_visible(face, owner, point, corners, x, y, before, face_starts):
    """
    Return whether a point inside the previous picture was visible there.

    Parameters
    ----------
    face, owner : int
        Its face and object.
    point : (float, float, float)
        Its earlier position, model space.
    corners : (int, int, int)
        Vertices of its face then.
    x, y : float
        Its earlier position, pixels.
    before : tuple
        As `fill_motion_visible` takes it.
    face_starts : (O+1,) int64
    """
    positions, matrices, faces, face_id, culled_windings = before
    column, row = np.int64(x), np.int64(y)
    if face_id[row, column] == face:
        return True
    z = apply_row(matrices, owner, CLIP_Z, point[0], point[1], point[2])
    w = apply_row(matrices, owner, CLIP_W, point[0], point[1], point[2])
    if not abs(z) <= w:
        return False
    center_x, center_y = np.float64(column) + 0.5, np.float64(row) + 0.5
    own_depth, winding, _ = evaluate_face(corners, owner, positions, matrices, center_x, center_y)
    if winding * np.float64(culled_windings[owner]) > 0.0:
        return False
    depth = apply_row(matrices, owner, STORED_DEPTH, point[0], point[1], point[2]) / w
    # Is it hidden by a face seen nearby that covers it?
    last = np.int64(face)
    for i in range(max(row - 1, 0), min(row + 2, face_id.shape[0])):
        for j in range(max(column - 1, 0), min(column + 2, face_id.shape[1])):
            other = np.int64(face_id[i, j])
            is_known, last = other == last, other
            if other < 0 or other == face or is_known:
                continue
            other_owner = barycentric.find_object(other, face_starts, owner)
            other_corners = get_face_vertices(faces, other)
            other_depth, _, covers = evaluate_face(
                other_corners, other_owner, positions, matrices, x, y
            )
            if covers and is_nearer(other_depth, depth):
                return False
    # Is it behind the surface that was seen at the centre of its pixel?
    other = np.int64(face_id[row, column])
    if other < 0:
        return True
    other_owner = barycentric.find_object(other, face_starts, owner)
    other_corners = get_face_vertices(faces, other)
    if other_owner == owner and share_vertex(corners, other_corners, positions):
        return True
    nearest, _, _ = evaluate_face(
        other_corners, other_owner, positions, matrices, center_x, center_y
    )
    if not is_nearer(nearest, own_depth):
        return True
    other_depth, _, _ = evaluate_face(other_corners, other_owner, positions, matrices, x, y)
    return not is_nearer(other_depth, depth)


@kernel
def fill_motion(
    face_id: int32[:, ::1], rows: (int64, int64), geometry: Geometry, face_starts: int64[::1],
    now: (float64[:, ::1], float64[:, :, ::1]),
    before: (float64[:, ::1], float64[:, :, ::1], int32[:, ::1]), motion: float32[:, :, ::1],
):  # fmt: skip
    """
    Write the motion of each visible point across the screen.

    Parameters
    ----------
    face_id : (H, W) int32
    rows : (int, int)
        First row, and one past the last.
    geometry : Geometry
    face_starts : (O+1,) int64
    now : (positions (V, 3) float64, matrices (O, 5, 4) float64)
        Vertices in model space, and what takes them to the screen.
    before : (positions (U, 3) float64, matrices (O, 5, 4) float64, faces (F, 3) int32)
        The same as it was, and the vertices of the faces then.
    motion : (H, W, 2) float32
        Written, pixels: the position now less that before, right and down; NaN for the background,
        and where the point was not in front of the eye.
    """
    owner = np.int64(0)
    for row in range(rows[0], rows[1]):
        for column in range(face_id.shape[1]):
            face = np.int64(face_id[row, column])
            motion[row, column, 0] = np.nan
            motion[row, column, 1] = np.nan
            if face < 0:
                continue
            owner = barycentric.find_object(face, face_starts, owner)
            a, b, c = get_face_vertices(geometry.faces, face)
            weights = barycentric.compute_sample_weights(a, b, c, column, row, geometry)
            i, j, k = get_face_vertices(before[2], face)
            x, y, w = project_to_pixels(interpolate_point(weights, a, b, c, now[0]), owner, now[1])
            point = interpolate_point(weights, i, j, k, before[0])
            old_x, old_y, old_w = project_to_pixels(point, owner, before[1])
            if w > 0.0 and old_w > 0.0:
                motion[row, column, 0] = x - old_x
                motion[row, column, 1] = y - old_y


@kernel
def fill_motion_visible(
    face_id: int32[:, ::1], rows: (int64, int64), geometry: Geometry, face_starts: int64[::1],
    before: (float64[:, ::1], float64[:, :, ::1], int32[:, ::1], int32[:, ::1], int8[::1]),
    visible: uint8[:, ::1],
):  # fmt: skip
    """
    Write whether each visible point was visible before.

    Parameters
    ----------
    face_id : (H, W) int32
    rows : (int, int)
    geometry : Geometry
    face_starts : (O+1,) int64
    before : tuple
        ``positions`` (U, 3) float64 and ``matrices`` (O, 5, 4) float64 as they were, ``faces``
        (F, 3) int32, the visible ``face_id`` (H, W) int32, and ``culled_windings`` (O,) int8, the
        winding sign of the faces that were not drawn.
    visible : (H, W) uint8
        Written: 1 or 0; 0 for the background.
    """
    owner, (height, width) = np.int64(0), before[3].shape
    for row in range(rows[0], rows[1]):
        for column in range(face_id.shape[1]):
            face = np.int64(face_id[row, column])
            visible[row, column] = 0
            if face < 0:
                continue
            owner = barycentric.find_object(face, face_starts, owner)
            a, b, c = get_face_vertices(geometry.faces, face)
            weights = barycentric.compute_sample_weights(a, b, c, column, row, geometry)
            corners = get_face_vertices(before[2], face)
            point = interpolate_point(weights, corners[0], corners[1], corners[2], before[0])
            x, y, w = project_to_pixels(point, owner, before[1])
            if w > 0.0 and 0.0 <= x < width and 0.0 <= y < height:
                visible[row, column] = was_visible(
                    face, owner, point, corners, x, y, before, face_starts
                )
