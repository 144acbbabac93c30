"""
Find the edges of shapes on the screen and draw them as lines of some width.

On one surface, the depths of neighbouring pixels differ by an amount between the slopes of their
faces. A larger difference, beyond vertex rounding and a pixel's footprint, is a jump; so planes
at grazing angles have none, at any scale. A jump, or an edge against the background, is drawn on
the nearer pixel, an object boundary on that of the later object, a crease on the left or upper one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.pipeline.geometry.barycentric import compute_face_normal, find_object
from rasterjit.pipeline.geometry.setup import CLIPPED, INVALID, get_face_vertices
from rasterjit.pipeline.geometry.unproject import scaled_derivative, unproject_pixel
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.runtime.float_math import clamped
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64, uint8, uint32

SILHOUETTE, OBJECT, CREASE = 1, 2, 4
"""Kinds of edges, as bits of a whole number."""

EDGE_BITS = {"silhouette": SILHOUETTE, "object": OBJECT, "crease": CREASE}
"""The bit of each kind of edge that an outline may follow."""

MIN_JUMP_FOOTPRINTS = np.float32(2.0)
"""Least difference of depths, in footprints of a pixel, where a surface ends before another."""

DEPTH_ROUNDING = np.float32(2.0**-21)
"""Slack for the rounding of two float32 depths and their slopes, as a share of the depth."""

MAX_FACES_PER_PIXEL = np.float32(2.0)
"""
Largest number of faces of one surface between neighbouring pixels, if they bend equally far.

So a face that is seen edge-on, whose slope is meaningless, hides no jump.
"""

MIN_WIDTH = 2.0
"""Pixels: faces that are wider meet at a crease even if they have no corner in common."""

TINY = np.float32(1e-30)
"""Added to divisors; the matrix has entries up to 1."""

NORMAL = 0
"""Rows of scratch: normal of the face, toward the viewer, world axes."""
SLOPE_X, SLOPE_Y, SLACK = 3, 4, 5
"""Rows: change of stored depth to the next column and the next row, and its tolerance."""
SCRATCH_ROWS = 6


def make_scratch(width: int) -> tuple[Any, Any]:
    """Return a thread's scratch memory for an image of a width in pixels."""
    return np.empty((2, SCRATCH_ROWS, width), np.float32), np.empty((2, width), np.int32)


@helper
def compute_max_slope(a, b, c, axis, codes, xy, grid_bits, depths):
    """Return the largest change of stored depth between neighbouring pixels on a face."""
    if (codes[a] | codes[b] | codes[c]) & (CLIPPED | INVALID):
        return np.float32(np.inf)
    nearest = max(depths[a], max(depths[b], depths[c]))
    span = np.float32(nearest - min(depths[a], min(depths[b], depths[c])))
    first = min(xy[a, axis], min(xy[b, axis], xy[c, axis]))
    last = max(xy[a, axis], max(xy[b, axis], xy[c, axis]))
    pixel = np.float32(np.int64(1) << grid_bits)
    return (
        MAX_FACES_PER_PIXEL
        * span
        * max(pixel / max(np.float32(last - first), np.float32(1.0)), np.float32(1.0))
    )


@helper
def compute_slopes(matrix, viewer, column, row, depth, normal):
    """Return the normal toward the viewer, both slopes of the depth, and a footprint in depth."""
    parts = matrix[0], matrix[1], matrix[2], matrix[3]
    x, y, z, _ = unproject_pixel(parts, column, row, depth)
    across, down = scaled_derivative(matrix[0], x, y, z), scaled_derivative(matrix[1], x, y, z)
    deeper = scaled_derivative(matrix[2], x, y, z)
    nx, ny, nz = normal
    toward = (
        nx * (viewer[0] - viewer[3] * x)
        + ny * (viewer[1] - viewer[3] * y)
        + nz * (viewer[2] - viewer[3] * z)
    )
    sign = np.float32(1.0) if toward >= np.float32(0.0) else np.float32(-1.0)
    rise_x = nx * across[0] + ny * across[1] + nz * across[2]
    rise_y = nx * down[0] + ny * down[1] + nz * down[2]
    rise = nx * deeper[0] + ny * deeper[1] + nz * deeper[2]
    rise = rise + TINY if rise >= np.float32(0.0) else rise - TINY
    step = across[0] * across[0] + across[1] * across[1] + across[2] * across[2]
    deep = deeper[0] * deeper[0] + deeper[1] * deeper[1] + deeper[2] * deeper[2]
    footprint = np.sqrt(step / (deep + TINY))
    return (sign * nx, sign * ny, sign * nz), -rise_x / rise, -rise_y / rise, footprint


@helper
def fill_scratch_row(
    faces, depth, row, matrix, viewer, snap_slack, vertex_depths, geometry, placement, s, owners
):  # fmt: skip
    """Write normal, slopes, slack and object of each pixel of a row; object -1 where nothing is."""
    last_face, owner = np.int64(-1), np.int64(0)
    normal = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    max_x = max_y = np.float32(0.0)
    codes, xy, bits = geometry.codes, geometry.xy, geometry.viewport.grid_bits
    for column in range(np.uintp(faces.shape[0])):
        face = np.int64(faces[column])
        owners[column] = -1
        if face < 0:
            continue
        if face != last_face:
            last_face = face
            owner = find_object(face, placement.face_starts, owner)
            a, b, c = get_face_vertices(geometry.faces, face)
            x, y, z = compute_face_normal(a, b, c, owner, placement)
            normal = np.float32(x), np.float32(y), np.float32(z)
            max_x = compute_max_slope(a, b, c, 0, codes, xy, bits, vertex_depths)
            max_y = compute_max_slope(a, b, c, 1, codes, xy, bits, vertex_depths)
        stored = depth[column]
        facing, slope_x, slope_y, footprint = compute_slopes(
            matrix, viewer, np.float32(column), np.float32(row), stored, normal
        )
        for k in range(3):
            s[NORMAL + k, column] = facing[k]
        s[SLOPE_X, column] = clamped(slope_x, -max_x, max_x)
        s[SLOPE_Y, column] = clamped(slope_y, -max_y, max_y)
        s[SLACK, column] = (
            MIN_JUMP_FOOTPRINTS * footprint
            + snap_slack * (abs(s[SLOPE_X, column]) + abs(s[SLOPE_Y, column]))
            + DEPTH_ROUNDING * abs(stored)
        )
        owners[column] = np.int32(owner)


@helper
def share_corner(face, other, faces, positions):
    """Return whether two faces of one object have a corner in the same place."""
    for i in range(3):
        for j in range(3):
            p, q = faces[face, i], faces[other, j]
            if (
                positions[p, 0] == positions[q, 0]
                and positions[p, 1] == positions[q, 1]
                and positions[p, 2] == positions[q, 2]
            ):
                return True
    return False


@helper
def is_wide(face, geometry):
    """Return whether a face is `MIN_WIDTH` pixels wide on the screen, across its longest side."""
    a, b, c = get_face_vertices(geometry.faces, face)
    if (geometry.codes[a] | geometry.codes[b] | geometry.codes[c]) & (CLIPPED | INVALID):
        return False
    xy = geometry.xy
    ux, uy = np.float64(xy[b, 0] - xy[a, 0]), np.float64(xy[b, 1] - xy[a, 1])
    vx, vy = np.float64(xy[c, 0] - xy[a, 0]), np.float64(xy[c, 1] - xy[a, 1])
    longest = max(ux * ux + uy * uy, vx * vx + vy * vy)
    longest = max(longest, (vx - ux) * (vx - ux) + (vy - uy) * (vy - uy))
    area = ux * vy - uy * vx
    width = MIN_WIDTH * np.float64(np.int64(1) << geometry.viewport.grid_bits)
    return area * area >= width * width * longest


@helper
def is_crease(difference, slope, face, other, cosine, min_cosine, geometry, positions):
    """
    Return whether two faces meet at an angle.

    If they bend toward the viewer, they may also intersect. If away, they must have a corner in
    common, or be so wide that only a sliver can lie between them: the end of what is round bends as
    much from one pixel to the next.
    """
    if not cosine < min_cosine:
        return False
    if difference > slope or share_corner(face, other, geometry.faces, positions):
        return True
    return is_wide(face, geometry) and is_wide(other, geometry)


@helper
def compute_cosine(s, t, m, n):
    """Return the cosine of the angle between the normals at two pixels."""
    return (
        s[NORMAL, m] * t[NORMAL, n]
        + s[NORMAL + 1, m] * t[NORMAL + 1, n]
        + s[NORMAL + 2, m] * t[NORMAL + 2, n]
    )


@helper
def is_jump(difference, s, t, m, n, slope_row):
    """Return whether two depths differ by more than the slopes of their faces."""
    low = min(s[slope_row, m], t[slope_row, n])
    high = max(s[slope_row, m], t[slope_row, n])
    slack = max(s[SLACK, m], t[SLACK, n])
    return difference < low - slack or difference > high + slack


@helper
def find_edge(
    m, n, slope_row, face, other, depth, other_depth, s, t, owner, other_owner, kinds,
    min_cosine, geometry, positions,
):  # fmt: skip
    """Return -1 for an edge drawn on this pixel, 1 for one on the other pixel, 0 for none."""
    if other_owner < 0 or owner < 0:
        nearer = -1 if other_owner < 0 else 1
        return nearer if kinds & (SILHOUETTE | OBJECT) else 0
    difference = other_depth - depth
    nearer = 1 if difference > np.float32(0.0) else -1
    if is_jump(difference, s, t, m, n, slope_row):
        is_drawn = kinds & SILHOUETTE or (kinds & OBJECT and owner != other_owner)
        return nearer if is_drawn else 0
    if kinds & OBJECT and owner != other_owner:
        return 1 if other_owner > owner else -1
    if kinds & CREASE and owner == other_owner:
        cosine = compute_cosine(s, t, m, n)
        if is_crease(
            difference, s[slope_row, m], face, other, cosine, min_cosine, geometry, positions
        ):
            return -1
    return 0


@kernel
def find_edges(
    face_id: int32[:, ::1], rows: (int64, int64), depth: float32[:, ::1],
    vertex_depths: float64[:], geometry: Geometry, placement: Placement, matrix: float32[:, ::1],
    snap_slack: float64, kinds: int64, min_cosine: float64, marks: uint8[:, ::1],
    scratch: (float32[:, :, ::1], int32[:, ::1]),
):  # fmt: skip
    """
    Mark the pixels at edges.

    Parameters
    ----------
    face_id : (H, W) int32
    rows : (int, int)
        The first row, and one past the last; edges to the row behind them are found as well.
    depth : (H, W) float32, stored depth
    vertex_depths : (V+E,) float64, stored depth of the vertices
    geometry, placement : records
    matrix : (4, 4) float32
        See ``unproject``; in units in which its largest entry is about 1.
    snap_slack : float
        Slack for rounded vertices, as a share of the slopes.
    kinds : int
        The kinds of edges to mark, as bits.
    min_cosine : float
        Of the angle between the normals of two faces: below it is a crease.
    marks : (H, W) uint8
        1 is written to the pixels that an edge belongs to, in these rows and the one behind.
    scratch : tuple
        This thread's own, from `make_scratch`.
    """
    height, width = face_id.shape
    scratch_rows, owners = scratch
    positions = placement.positions
    v = placement.toward_viewer
    viewer = np.float32(v[0]), np.float32(v[1]), np.float32(v[2]), np.float32(v[3])
    slack, float32_cosine = np.float32(snap_slack), np.float32(min_cosine)
    for row in range(rows[0], min(rows[1] + 1, height)):
        this, other = row & 1, 1 - (row & 1)
        s, t = scratch_rows[this], scratch_rows[other]
        row_owners, previous_owners = owners[this], owners[other]
        fill_scratch_row(
            face_id[row], depth[row], row, matrix, viewer, slack, vertex_depths, geometry,
            placement, s, row_owners,
        )  # fmt: skip
        for i in range(np.uintp(width)):
            face = np.int64(face_id[row, i])
            if row > rows[0] and face_id[row - 1, i] != face:
                side = find_edge(
                    i, i, SLOPE_Y, np.int64(face_id[row - 1, i]), face, depth[row - 1, i],
                    depth[row, i], t, s, previous_owners[i], row_owners[i], kinds, float32_cosine,
                    geometry, positions,
                )  # fmt: skip
                if side != 0:
                    marks[row - 1 if side < 0 else row, i] = 1
            j = i + np.uintp(1)
            if row < rows[1] and j < width and face_id[row, j] != face:
                side = find_edge(
                    i, j, SLOPE_X, face, np.int64(face_id[row, j]), depth[row, i], depth[row, j], s,
                    s, row_owners[i], row_owners[j], kinds, float32_cosine, geometry, positions,
                )  # fmt: skip
                if side != 0:
                    marks[row, i if side < 0 else j] = 1


@kernel
def dilate_marks(
    marks: uint8[:, ::1], rows: (int64, int64), disc: int32[:, ::1], color: uint32[::1],
    target: uint32[:, ::1],
):  # fmt: skip
    """
    Draw a square or a disc around every mark.

    Parameters
    ----------
    marks : (H, W) uint8
        1 where a line runs.
    rows : (int, int)
        The rows to draw, first and one past the last.
    disc : (D, 3) int32
        For each row of the disc: how far down it lies from the mark, and its first column and the
        one past its last, relative to the mark.
    color : (1,) uint32
        RGBA bytes from the lowest up.
    target : (H, W) uint32
        Written in these rows.
    """
    height, width = marks.shape
    value = color[0]
    for row in range(rows[0], rows[1]):
        for n in range(disc.shape[0]):
            source = row - np.int64(disc[n, 0])
            if source < 0 or source >= height:
                continue
            for i in range(np.uintp(width)):
                if marks[source, i] == 0:
                    continue
                first = max(np.int64(i) + disc[n, 1], 0)
                last = min(np.int64(i) + disc[n, 2], width)
                for column in range(np.uintp(first), np.uintp(last)):
                    target[row, column] = value
