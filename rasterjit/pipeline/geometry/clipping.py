"""
Clip triangles to the near and far planes and the guard band, before the divide by w.

Sutherland-Hodgman in homogeneous clip space, float64. Each crossing is computed from the end that
is inside towards the end that is outside, and an edge meets the same planes in the same order in
both of its triangles, so neighbours get the same new vertex bit for bit and stay watertight. A
vertex at or behind the eye (``w <= 0``) needs no special case: it lies outside a plane, and
nothing is divided by w here.

What is left after the near plane and the guard band has ``w > 0`` (``guard * w >= |x|``); a piece
for which that fails by degeneracy (every vertex at the eye) is dropped.

References
----------
.. [1] I. Sutherland and G. Hodgman, "Reentrant Polygon Clipping", CACM 17(1), 1974.
.. [2] J. Blinn and M. Newell, "Clipping Using Homogeneous Coordinates", SIGGRAPH 1978.
"""

from __future__ import annotations

from rasterjit.pipeline.geometry.setup import CLIPPED, FRUSTUM, INVALID
from rasterjit.pipeline.records import Viewport
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float64, int32, int64, uint8

PLANE_COUNT = 6
"""Near, far, and the four sides of the guard band."""

MAX_VERTICES = 28
"""
Most vertices of a clipped polygon.

Exactly convex, a triangle cut by six planes has at most nine. Rounding may bend a degenerate one,
but a plane keeps the i inside vertices of n and adds one for each of at most 2 min(i, n - i) sign
changes, so n grows to at most 3n/2: 3, 4, 6, 9, 13, 19, 28.
"""


@helper
def plane_distance(plane, vertex, guard_x, guard_y):
    """Return the signed distance of a clip position to a plane, >= 0 inside (unnormalized)."""
    if plane == 0:
        return vertex[3] + vertex[2]
    if plane == 1:
        return vertex[3] - vertex[2]
    if plane == 2:
        return guard_x * vertex[3] + vertex[0]
    if plane == 3:
        return guard_x * vertex[3] - vertex[0]
    if plane == 4:
        return guard_y * vertex[3] + vertex[1]
    return guard_y * vertex[3] - vertex[1]


@helper
def cross_plane(inside, outside, plane, viewport, crossing):
    """Write where an edge crosses a plane, computed from its inside end."""
    inside_distance = plane_distance(plane, inside, viewport.guard_x, viewport.guard_y)
    outside_distance = plane_distance(plane, outside, viewport.guard_x, viewport.guard_y)
    t = inside_distance / (inside_distance - outside_distance)
    for k in range(4):
        crossing[k] = inside[k] + t * (outside[k] - inside[k])
    # Put the crossing exactly on the plane: far ends cancel, and rounding may leave it outside.
    if plane < 2:
        crossing[2] = crossing[3] if plane == 1 else -crossing[3]
    elif plane < 4:
        crossing[0] = viewport.guard_x * (crossing[3] if plane == 3 else -crossing[3])
    else:
        crossing[1] = viewport.guard_y * (crossing[3] if plane == 5 else -crossing[3])


@helper
def clip_polygon(polygon, count, plane, viewport, clipped):
    """Clip a convex polygon to the inner side of one plane; return its new number of vertices."""
    new_count = 0
    for n in range(count):
        vertex = polygon[n]
        next_vertex = polygon[n + 1 if n + 1 < count else 0]
        distance = plane_distance(plane, vertex, viewport.guard_x, viewport.guard_y)
        next_distance = plane_distance(plane, next_vertex, viewport.guard_x, viewport.guard_y)
        if distance >= 0.0:
            for k in range(4):
                clipped[new_count, k] = vertex[k]
            new_count += 1
            if not next_distance >= 0.0 and distance > 0.0:
                cross_plane(vertex, next_vertex, plane, viewport, clipped[new_count])
                new_count += 1
        elif next_distance > 0.0:
            cross_plane(next_vertex, vertex, plane, viewport, clipped[new_count])
            new_count += 1
    return new_count


@helper
def clip_triangle(corners, clip_positions, viewport, polygon, spare):
    """Clip a triangle to all planes, into ``polygon``; return its number of vertices."""
    for n in range(3):
        for k in range(4):
            polygon[n, k] = clip_positions[corners[n], k]
    count = 3
    for plane in range(PLANE_COUNT):
        count = clip_polygon(polygon, count, plane, viewport, spare)
        for n in range(count):
            for k in range(4):
                polygon[n, k] = spare[n, k]
    for n in range(count):
        if not polygon[n, 3] > 0.0:
            return 0
    return count if count >= 3 else 0


@kernel
def find_clipped_faces(faces: int32[:, ::1], codes: uint8[:], clipped_faces: int32[::1]):
    """
    List the faces that cross the near or far plane or the guard band and may be seen.

    Parameters
    ----------
    faces : (F, 3) int32
    codes : (V,) uint8, outcodes
    clipped_faces : (N,) int32
        Writes the faces' numbers, ascending, as many as fit.

    Returns
    -------
    int
        How many there are, even if fewer fit.
    """
    count = 0
    for face in range(faces.shape[0]):
        code0, code1, code2 = codes[faces[face, 0]], codes[faces[face, 1]], codes[faces[face, 2]]
        any_code = code0 | code1 | code2
        if any_code & CLIPPED and not any_code & INVALID and not code0 & code1 & code2 & FRUSTUM:
            if count < clipped_faces.shape[0]:
                clipped_faces[count] = face
            count += 1
    return count


@kernel
def count_clipped_vertices(
    clipped_faces: int32[::1], faces: int32[:, ::1], clip_positions: float64[:, ::1],
    viewport: Viewport, counts: int64[::1], scratch: float64[:, :, ::1],
):  # fmt: skip
    """
    Count the vertices that each face has after clipping.

    Parameters
    ----------
    clipped_faces : (C,) int32
    faces : (F, 3) int32
    clip_positions : (V, 4) float64, clip space
    viewport : Viewport
    counts : (C,) int64
        Writes 0 for a face that is clipped away, else 3 to ``MAX_VERTICES``.
    scratch : (2, MAX_VERTICES, 4) float64
    """
    polygon, spare = scratch[0], scratch[1]
    for n in range(clipped_faces.shape[0]):
        counts[n] = clip_triangle(faces[clipped_faces[n]], clip_positions, viewport, polygon, spare)


@kernel
def clip_faces(
    clipped_faces: int32[::1], faces: int32[:, ::1], clip_positions: float64[:, ::1],
    viewport: Viewport, starts: (int64[::1], int64[::1]),
    clipped: (float64[:, ::1], int32[:, ::1], int32[::1]), scratch: float64[:, :, ::1],
):  # fmt: skip
    """
    Clip the faces, and write each clipped polygon as a fan of triangles.

    Parameters
    ----------
    clipped_faces : (C,) int32
    faces : (F, 3) int32
    clip_positions : (V, 4) float64, clip space
    viewport : Viewport
    starts : (vertices (C+1,) int64, pieces (C+1,) int64)
        Running sums of the counts: where each face's new vertices and pieces go.
    clipped : (positions (E, 4) float64, pieces (P, 3) int32, piece_faces (P,) int32)
        Writes the new vertices, in clip space; the pieces, with new vertex ``e`` numbered
        ``V + e``; and the face that each piece was cut from.
    scratch : (2, MAX_VERTICES, 4) float64
    """
    vertex_starts, piece_starts = starts
    positions, pieces, piece_faces = clipped
    polygon, spare = scratch[0], scratch[1]
    for n in range(clipped_faces.shape[0]):
        count = clip_triangle(faces[clipped_faces[n]], clip_positions, viewport, polygon, spare)
        first = vertex_starts[n]
        for k in range(count):
            for axis in range(4):
                positions[first + k, axis] = polygon[k, axis]
        number = clip_positions.shape[0] + first
        for k in range(count - 2):
            piece = piece_starts[n] + k
            pieces[piece, 0] = number
            pieces[piece, 1] = number + k + 1
            pieces[piece, 2] = number + k + 2
            piece_faces[piece] = clipped_faces[n]
