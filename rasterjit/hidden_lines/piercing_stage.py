"""
Find the lines along which faces pierce each other.

Two triangles pierce each other where both have corners on both sides of the other's plane, and the
parts of the planes' common line that lie in each have a part in common. Corners nearer to a plane
than a tolerance lie in it, and count as in front of it: so solids that touch from outside do not
pierce each other, and where an edge of one solid lies in a face of another, one of its faces does.
Where an edge of each lies along the line, there is none if faces at those edges lie in one plane:
so surfaces that coincide have no lines.

References
----------
.. [1] T. Möller, "A Fast Triangle-Triangle Intersection Test", Journal of Graphics Tools 2(2),
   1997.
"""

from __future__ import annotations

import numpy as np

from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float64, int32, int64


@helper
def get_corner(corners, n, k):
    """Return a corner of a triangle."""
    return corners[n, 3 * k], corners[n, 3 * k + 1], corners[n, 3 * k + 2]


@helper
def find_sides(planes, corners, n, other, tolerance):
    """Return the distances of the corners of a triangle, n, from another's plane."""
    x, y, z = planes[other, 0], planes[other, 1], planes[other, 2]
    a, b, c = get_corner(corners, other, 0)
    sides = 0.0, 0.0, 0.0
    for k in range(3):
        p, q, r = get_corner(corners, n, k)
        side = x * (p - a) + y * (q - b) + z * (r - c)
        side = 0.0 if abs(side) <= tolerance else side
        sides = (sides[1], sides[2], side)
    return sides


@helper
def are_both_sides(sides):
    """Return whether some corners lie before a plane and others behind."""
    return max(sides[0], max(sides[1], sides[2])) >= 0.0 > min(sides[0], min(sides[1], sides[2]))


@helper
def find_edge_in_plane(sides):
    """Return which edge of a triangle lies in a plane, or -1."""
    for k in range(3):
        if sides[k] == 0.0 and sides[(k + 1) % 3] == 0.0:
            return k
    return -1


@helper
def lies_in_plane(planes, corners, n, other, tolerance):
    """Return whether all corners of a triangle, n, lie in another's plane; -1 is no triangle."""
    if n < 0 or other < 0:
        return False
    sides = find_sides(planes, corners, n, other, tolerance)
    return sides[0] == 0.0 and sides[1] == 0.0 and sides[2] == 0.0


@helper
def do_surfaces_coincide(planes, corners, neighbours, n, other, sides, other_sides, tolerance):
    """Return whether faces at edges of two triangles along one line lie in one plane."""
    k, j = find_edge_in_plane(sides), find_edge_in_plane(other_sides)
    if k < 0 or j < 0:
        return False
    beside, other_beside = np.int64(neighbours[n, k]), np.int64(neighbours[other, j])
    return (
        lies_in_plane(planes, corners, beside, other, tolerance)
        or lies_in_plane(planes, corners, other_beside, n, tolerance)
        or lies_in_plane(planes, corners, beside, other_beside, tolerance)
    )


@helper
def cut_by_plane(corners, vertices, n, sides):
    """Return both ends of a triangle's cut by a plane on both sides of which it has corners."""
    first = last = (0.0, 0.0, 0.0)
    for k in range(3):
        m = (k + 1) % 3
        if (sides[k] >= 0.0) == (sides[m] >= 0.0):
            continue
        # One way for both faces at an edge, so that the ends of their cuts are one.
        i, j = (k, m) if vertices[n, k] < vertices[n, m] else (m, k)
        along = sides[i] / (sides[i] - sides[j])
        a, b = get_corner(corners, n, i), get_corner(corners, n, j)
        first = last
        last = (
            a[0] + along * (b[0] - a[0]),
            a[1] + along * (b[1] - a[1]),
            a[2] + along * (b[2] - a[2]),
        )
    return first, last


@helper
def share_vertex(vertices, n, other):
    """Return whether two triangles have a vertex in common."""
    for i in range(3):
        for j in range(3):
            if vertices[n, i] == vertices[other, j]:
                return True
    return False


@helper
def do_boxes_meet(boxes, n, other):
    """Return whether the boxes around two triangles meet."""
    for k in range(3):
        if boxes[n, k] > boxes[other, k + 3] or boxes[other, k] > boxes[n, k + 3]:
            return False
    return True


@helper
def find_piercing(corners, vertices, planes, neighbours, n, other, tolerance):
    """Return whether two triangles pierce each other, and both ends of the line."""
    nowhere = 0.0, 0.0, 0.0
    sides = find_sides(planes, corners, n, other, tolerance)
    if not are_both_sides(sides):
        return False, nowhere, nowhere
    other_sides = find_sides(planes, corners, other, n, tolerance)
    if not are_both_sides(other_sides):
        return False, nowhere, nowhere
    if do_surfaces_coincide(planes, corners, neighbours, n, other, sides, other_sides, tolerance):
        return False, nowhere, nowhere
    a, b = cut_by_plane(corners, vertices, n, sides)
    c, d = cut_by_plane(corners, vertices, other, other_sides)
    # Compare along the axis that the line is nearest to.
    axis = 0
    for k in range(3):
        axis = k if abs(b[k] - a[k]) > abs(b[axis] - a[axis]) else axis
    a, b = (a, b) if a[axis] <= b[axis] else (b, a)
    c, d = (c, d) if c[axis] <= d[axis] else (d, c)
    start, stop = a if a[axis] >= c[axis] else c, b if b[axis] <= d[axis] else d
    return stop[axis] - start[axis] > tolerance, start, stop


@kernel
def find_piercings(
    faces: (int64, int64),
    triangles: (float64[:, ::1], int32[:, ::1], float64[:, ::1], float64[:, ::1], int32[:, ::1]),
    ranges: int32[:, ::1], cells: (int64[::1], int32[::1]), grid: (int64, int64),
    tolerances: float64[::1], stamps: int32[::1], pairs: int32[:, ::1], lines: float64[:, ::1],
    count: int64[::1],
):  # fmt: skip
    """
    Find the lines along which faces pierce others of higher numbers.

    Parameters
    ----------
    faces : (int, int)
        The first, and one past the last.
    triangles : (corners (F, 9), vertices (F, 3) int32, planes (F, 3), boxes (F, 6), (F, 3) int32)
        Corners one after the other; the vertices' numbers, one for each position; unit normals,
        zero without an area; least and greatest coordinates; the face across each edge, or -1.
    ranges : (F, 6) int32
        The first cell along x, y and z that each face may meet, and the last.
    cells : (starts (C+1,) int64, lists (L,) int32)
        The faces that may meet each cell.
    grid : (columns, rows)
        Of cells along x and y.
    tolerances : (F,) float64
        Largest distance of each face from one that it touches, and largest length of a line that is
        none; of two faces the larger counts.
    stamps : (F,) int32
        Scratch memory, filled with -1.
    pairs : (M, 2) int32
        Writes the faces of each line.
    lines : (M, 6) float64
        Writes both ends of each line.
    count : (1,) int64
        Receives the number of lines.

    Returns
    -------
    int
        One past the last face whose lines had room.
    """
    corners, vertices, planes, boxes, neighbours = triangles
    starts, lists = cells
    columns, rows = grid
    total = np.int64(0)
    for n in range(faces[0], faces[1]):
        count[0] = total
        for layer in range(ranges[n, 2], ranges[n, 5] + 1):
            for row in range(ranges[n, 1], ranges[n, 4] + 1):
                cell = (np.int64(layer) * rows + row) * columns
                # The lists of a row of cells follow each other.
                for k in range(starts[cell + ranges[n, 0]], starts[cell + ranges[n, 3] + 1]):
                    other = np.int64(lists[k])
                    if other <= n or stamps[other] == n:
                        continue
                    stamps[other] = n
                    if not do_boxes_meet(boxes, n, other) or share_vertex(vertices, n, other):
                        continue
                    pierces, start, stop = find_piercing(
                        corners, vertices, planes, neighbours, n, other,
                        max(tolerances[n], tolerances[other]),
                    )  # fmt: skip
                    if not pierces:
                        continue
                    if total == pairs.shape[0]:
                        return np.int64(n)
                    pairs[total, 0], pairs[total, 1] = n, other
                    for axis in range(3):
                        lines[total, axis], lines[total, axis + 3] = start[axis], stop[axis]
                    total += 1
    count[0] = total
    return np.int64(faces[1])
