"""
Triangulate the caps of a sectioned solid: the inside of its outlines on the cutting plane.

Outline points are snapped to an integer grid, so every predicate is exact. `find_contacts` finds
where edges cross or touch other than at their ends; edges are split there, until none do.
`fill_outlines` is a plane sweep as in [1]_: between two neighbouring edges on the sweep line lies
a strip of one winding number, inside the solid where it is not zero. Each strip keeps a reflex
chain of points not yet triangulated. The next point of the sweep is joined to all points of the
chain that are visible from it, splits a chain at its newest point, or merges two. So outlines may
be nested, touch, and belong to several shells. No vertices are added and triangles share whole
edges, so there are no cracks.

References
----------
.. [1] M. de Berg and others, "Computational Geometry", 3rd ed., Springer 2008, chapter 3.
"""

from __future__ import annotations

from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import int64


@helper
def signed_area(points, a, b, c):
    """Return twice the area of a triangle, above 0 if it is counter-clockwise."""
    x, y = points[a, 0], points[a, 1]
    return (points[b, 0] - x) * (points[c, 1] - y) - (points[b, 1] - y) * (points[c, 0] - x)


@kernel
def find_contacts(
    points: int64[:, ::1], edges: int64[:, ::1], active: int64[::1], contacts: int64[:, ::1]
):
    """
    Find where edges meet, to within a grid step, other than at an end of both.

    Parameters
    ----------
    points : (N, 2) int64, ascending by y, then by x; coordinates below 2**29 in size
    edges : (E, 3) int64
        The lower point, the upper one, and a winding; ascending by lower point.
    active : (E,) int64, scratch
    contacts : (C, 3) int64
        Writes as many as fit: an edge, a point in it, -1; or two edges that cross, 1.

    Returns
    -------
    int
        Number of contacts, even if fewer fit.
    """
    count = 0
    active_count = 0
    for edge_a in range(edges.shape[0]):
        a, b = edges[edge_a, 0], edges[edge_a, 1]
        left, right = min(points[a, 0], points[b, 0]), max(points[a, 0], points[b, 0])
        kept_count = 0
        for k in range(active_count):
            other = active[k]
            c, d = edges[other, 0], edges[other, 1]
            if d <= a:
                continue
            active[kept_count] = other
            kept_count += 1
            if min(points[c, 0], points[d, 0]) > right or max(points[c, 0], points[d, 0]) < left:
                continue
            at_a, at_b = signed_area(points, c, d, a), signed_area(points, c, d, b)
            at_c, at_d = signed_area(points, a, b, c), signed_area(points, a, b, d)
            # Points are numbered along the sweep, so a point on an edge's line lies in the edge if
            # its number lies between the ends'. A grid step beside the line counts, too: splitting
            # nearly collinear edges only at crossings would make new crossings for ever.
            for end in range(4):
                edge, point, area = other, a, at_a
                if end == 1:
                    point, area = b, at_b
                elif end == 2:
                    edge, point, area = edge_a, c, at_c
                elif end == 3:
                    edge, point, area = edge_a, d, at_d
                low, high = edges[edge, 0], edges[edge, 1]
                x, start, stop = points[point, 0], points[low, 0], points[high, 0]
                length = max(abs(stop - start), points[high, 1] - points[low, 1])
                is_near = abs(area) <= length and min(start, stop) <= x and x <= max(start, stop)
                if is_near and low < point and point < high:
                    if count < contacts.shape[0]:
                        contacts[count, 0] = edge
                        contacts[count, 1] = point
                        contacts[count, 2] = -1
                    count += 1
            is_beside = at_a != 0 and at_b != 0 and at_c != 0 and at_d != 0
            if is_beside and (at_a > 0) != (at_b > 0) and (at_c > 0) != (at_d > 0):
                if count < contacts.shape[0]:
                    contacts[count, 0] = edge_a
                    contacts[count, 1] = other
                    contacts[count, 2] = 1
                count += 1
        active[kept_count] = edge_a
        active_count = kept_count + 1
    return count


@helper
def write_triangle(a, b, c, winding, counts, triangles):
    """Write a triangle, flipped where the winding is negative."""
    n = counts[1]
    counts[1] = n + 1
    triangles[n, 0] = a
    triangles[n, 1] = b if winding > 0 else c
    triangles[n, 2] = c if winding > 0 else b
    triangles[n, 3] = abs(winding)


@helper
def append_point(edge, point, side, points, strips, nodes, counts, triangles):
    """
    Add a point to the left (0) or right end (1) of a strip's chain, with triangles to what it sees.

    ``strips`` (4, E) has the first, the last and the newest node of the chain of the strip to the
    right of each edge, and its winding; ``nodes`` (3, M) the point of each, and the nodes before
    and behind it.
    """
    node = counts[0]
    counts[0] = node + 1
    inward, outward = 2 - side, 1 + side
    nodes[0, node] = point
    end = strips[side, edge]
    while nodes[inward, end] >= 0:
        beyond = nodes[inward, end]
        a, b = nodes[0, end], nodes[0, beyond]
        if side == 1:
            a, b = b, a
        # Counter-clockwise: point, end, beyond on the left; beyond, end, point on the right.
        area = signed_area(points, point, a, b)
        if area < 0:
            break
        write_triangle(point, a, b, strips[3, edge], counts, triangles)
        end = beyond
    nodes[outward, end] = node
    nodes[inward, node] = end
    nodes[outward, node] = -1
    strips[side, edge] = node
    strips[2, edge] = node


@helper
def start_chain(edge, point, strips, nodes, counts):
    """Start the chain of a strip with one point."""
    node = counts[0]
    counts[0] = node + 1
    nodes[0, node] = point
    nodes[1, node] = -1
    nodes[2, node] = -1
    strips[0, edge] = node
    strips[1, edge] = node
    strips[2, edge] = node


@kernel
def fill_outlines(
    points: int64[:, ::1], edges: int64[:, ::1], active: int64[::1], strips: int64[:, ::1],
    nodes: int64[:, ::1], counts: int64[::1], triangles: int64[:, ::1],
):  # fmt: skip
    """
    Triangulate the inside of outlines (winding number not 0) whose edges meet only at their ends.

    Parameters
    ----------
    points : (N, 2) int64, ascending by y, then by x; coordinates below 2**29 in size
    edges : (E, 3) int64
        The lower point, the upper one, and how often it goes upward, more than downward, not 0;
        ascending by lower point. At each point as many begin as end.
    active : (E,) int64, scratch
    strips : (4, E) int64, scratch
    nodes : (3, E + 4 N) int64, scratch
    counts : (2,) int64, scratch
    triangles : (E + 4 N, 4) int64
        Writes three points, counter-clockwise where the winding number is above 0, and the size of
        that number.

    Returns
    -------
    int
        Number of triangles; -1 if edges meet elsewhere than at their ends.
    """
    counts[0] = 0
    counts[1] = 0
    active_count = 0
    first = 0
    for point in range(points.shape[0]):
        # Find the edges to the left of the point, then those that end and begin there.
        low, high = 0, active_count
        while low < high:
            middle = (low + high) // 2
            edge = active[middle]
            if signed_area(points, edges[edge, 0], edges[edge, 1], point) < 0:
                low = middle + 1
            else:
                high = middle
        stop = low
        while stop < active_count and edges[active[stop], 1] == point:
            stop += 1
        last = first
        while last < edges.shape[0] and edges[last, 0] == point:
            last += 1
        started, ended = last - first, stop - low
        if started == 0 and ended == 0:
            # Edges that met here cancelled each other.
            continue
        if stop < active_count:
            edge = active[stop]
            if signed_area(points, edges[edge, 0], edges[edge, 1], point) <= 0:
                return -1
        # Find the winding numbers at both sides.
        left = active[low - 1] if low > 0 else -1
        left_winding = strips[3, left] if low > 0 else 0
        right = active[stop - 1] if ended > 0 else left
        right_winding = strips[3, right] if right >= 0 else 0
        # Close the strips between edges that end.
        for k in range(low, stop - 1):
            edge = active[k]
            if strips[3, edge] != 0:
                # A strip ends: the point sees all of its chain.
                node = strips[0, edge]
                while nodes[2, node] >= 0:
                    behind = nodes[2, node]
                    a, b = nodes[0, node], nodes[0, behind]
                    if signed_area(points, a, b, point) >= 0:
                        write_triangle(a, b, point, strips[3, edge], counts, triangles)
                    node = behind
        # Join the point to the strips beside it, or split the strip that it lies in.
        split_at = -1
        if ended > 0:
            if left_winding != 0:
                append_point(left, point, 1, points, strips, nodes, counts, triangles)
            if right_winding != 0:
                append_point(right, point, 0, points, strips, nodes, counts, triangles)
        elif left_winding != 0:
            split_at = strips[2, left]
        # Replace the edges that end by those that begin here, from left to right.
        if started > ended:
            for k in range(active_count - 1, stop - 1, -1):
                active[k + started - ended] = active[k]
        elif started < ended:
            for k in range(stop, active_count):
                active[k + started - ended] = active[k]
        active_count += started - ended
        for n in range(started):
            edge = first + n
            slot = low + n
            while slot > low:
                previous = active[slot - 1]
                if signed_area(points, point, edges[previous, 1], edges[edge, 1]) <= 0:
                    break
                active[slot] = previous
                slot -= 1
            active[slot] = edge
        # Start a strip between each two edges that begin.
        winding = left_winding
        for n in range(started):
            edge = active[low + n]
            winding -= edges[edge, 2]
            strips[3, edge] = winding
            if winding != 0 and n < started - 1:
                start_chain(edge, point, strips, nodes, counts)
        if winding != right_winding:
            return -1
        # Pass the right strip on to the last edge.
        if started > 0:
            edge = active[low + started - 1]
            if ended > 0 and right_winding != 0:
                for k in range(3):
                    strips[k, edge] = strips[k, right]
            elif split_at >= 0:
                # The right part gets its own node for the point where the chain is split.
                start_chain(edge, nodes[0, split_at], strips, nodes, counts)
                split_node, behind = strips[0, edge], nodes[2, split_at]
                if behind >= 0:
                    nodes[2, split_node] = behind
                    nodes[1, behind] = split_node
                    strips[1, edge] = strips[1, left]
                nodes[2, split_at] = -1
                strips[1, left] = split_at
                append_point(left, point, 1, points, strips, nodes, counts, triangles)
                append_point(edge, point, 0, points, strips, nodes, counts, triangles)
        elif left_winding != 0:
            # Merge two strips.
            node, behind = strips[1, left], nodes[2, strips[0, right]]
            nodes[2, node] = behind
            if behind >= 0:
                nodes[1, behind] = node
                strips[1, left] = strips[1, right]
            strips[2, left] = node
        first = last
    return counts[1]
