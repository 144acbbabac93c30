"""
Compute exact area coverage: the visible area of each face in each pixel.

A triangle clipped to a pixel's square is a convex polygon. The part hidden by another triangle is
convex, too: where the other is nearer, bounded by a line, since depth is linear on the screen. So
the visible part is a convex polygon minus convex polygons, computed as a list of convex pieces.
Vertices lie on the sub-pixel grid; everything after is float64, until areas become coverage in
whole steps of 2**-24 pixel.

Bounds and corners tell whether polygons are apart, or one is nearer everywhere. Candidates are
processed nearest first, until their visible areas fill the pixel; the others are hidden.

If depths are equal to float32 all over the pixel, the lower face number is nearer, as for samples.

References
----------
.. [1] I. Sutherland and G. Hodgman, "Reentrant Polygon Clipping", CACM 17(1), 1974.
.. [2] E. Catmull, "A Hidden-Surface Algorithm with Anti-Aliasing", SIGGRAPH 1978.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.pipeline.geometry.setup import TILE_BITS, get_triangle
from rasterjit.pipeline.records import Faces, ScreenVertices, Viewport
from rasterjit.pipeline.visibility.alpha_test import AlphaQuery, is_discarded
from rasterjit.pipeline.visibility.tile_rasterizer import get_tile_window
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64

MAX_CORNERS = 40
"""Most corners of a piece."""

MAX_PIECES = 512
"""Most pieces of a triangle's visible part in a pixel."""

MIN_AREA = 2.0**-46
"""Least area of a piece, square pixels; smaller ones come from rounding and are dropped."""

FULL_PIXEL_AREA = 1.0 - 2.0**-42
"""Sum of visible areas that fills a pixel: the rest are pieces to be dropped."""

MIN_EDGE_LENGTH = 2.0**-40
"""Least length of an edge, pixels; shorter ones come from rounding, and have no direction."""

MAX_ROUNDING_OVERLAP = 2.0**-50
"""Pixels by which rounding may make disjoint polygons overlap."""

COVERAGE_STEPS = 1 << 24
"""
Steps of coverage in a pixel.

As float32, coverage is 1 exactly if nothing else is visible in the pixel, and 0 exactly if the face
is hidden.
"""

DEPTH_TOLERANCE = 2.0**-24
"""Relative difference within which depths are equal: half a step of float32."""

BEHIND_TOLERANCE = 2.0**-20
"""Relative depth difference from which a face is behind another, whatever depths are tied."""

FACE, DEPTH, SLOPE_X, SLOPE_Y = 0, 1, 2, 3
"""
Columns of a triangle and of a candidate: face; stored depth at the triangle's first corner, or the
pixel's, and the slopes of the depth.
"""
X, Y = 4, 7
"""Columns of a triangle, three each: corners, pixels."""
TRIANGLE_COLUMNS = 10
LOWEST, HIGHEST = 4, 5
"""Columns of a candidate: its least and greatest depth in the pixel."""
BOUNDS = 6
"""Four columns of a candidate: the bounds of its polygon, in the order of `LEFT` and so on."""
CANDIDATE_COLUMNS = 10
LEFT, RIGHT, TOP, BOTTOM = 0, 1, 2, 3
"""Rows of the bounds of triangles, pixels."""

TILE, STRIP, ROW, BLOCK, PIXEL = 0, 1, 2, 3, 4
"""Regions for which triangles are listed, each inside the previous one."""

STRIP_BITS = 3
"""Rows of a strip, and columns of a block, as a power of two."""


@helper
def compute_area(polygon, count):
    """Return the area of a polygon, positive if it runs clockwise as seen on the screen."""
    doubled = 0.0
    for n in range(1, count - 1):
        ux, uy = polygon[n, 0] - polygon[0, 0], polygon[n, 1] - polygon[0, 1]
        vx, vy = polygon[n + 1, 0] - polygon[0, 0], polygon[n + 1, 1] - polygon[0, 1]
        doubled += ux * vy - uy * vx
    return 0.5 * doubled


@helper
def split_polygon(polygon, count, line, kept, dropped):
    """
    Clip a convex polygon to both half planes of a line; return both corner counts.

    ``kept`` lies where ``a x + b y + c >= 0``; ``dropped`` may be None.
    """
    a, b, c = line
    inside, outside = np.int64(0), np.int64(0)
    if count == 0:
        return inside, outside
    last_x, last_y = polygon[count - 1, 0], polygon[count - 1, 1]
    last_side = a * last_x + b * last_y + c
    for n in range(count):
        x, y = polygon[n, 0], polygon[n, 1]
        side = a * x + b * y + c
        if (last_side < 0.0 < side) | (side < 0.0 < last_side):
            t = last_side / (last_side - side)
            new_x, new_y = last_x + t * (x - last_x), last_y + t * (y - last_y)
            kept[inside, 0], kept[inside, 1] = new_x, new_y
            inside += 1
            if dropped is not None:
                dropped[outside, 0], dropped[outside, 1] = new_x, new_y
                outside += 1
        if side >= 0.0:
            kept[inside, 0], kept[inside, 1] = x, y
            inside += 1
        if dropped is not None and side <= 0.0:
            dropped[outside, 0], dropped[outside, 1] = x, y
            outside += 1
        last_x, last_y, last_side = x, y, side
    return inside, outside


@helper
def clip_polygon(polygon, count, line, target):
    """Clip a convex polygon to the half plane ``a x + b y + c >= 0``; return its corner count."""
    return split_polygon(polygon, count, line, target, None)[0]


@helper
def find_distance_range(polygon, count, line):
    """Return the least and the greatest distance of a polygon's corners inside a line."""
    a, b, c = line
    least, most = np.inf, -np.inf
    for n in range(count):
        distance = a * polygon[n, 0] + b * polygon[n, 1] + c
        least, most = min(least, distance), max(most, distance)
    return least, most


@helper
def get_edge_line(polygon, count, n):
    """Return the line through an edge, positive inside."""
    following = n + 1 if n + 1 < count else 0
    x, y = polygon[n, 0], polygon[n, 1]
    a, b = y - polygon[following, 1], polygon[following, 0] - x
    return a, b, -(a * x + b * y)


@helper
def is_beyond(polygon, count, other, other_count):
    """Return whether a polygon lies beyond an edge of another, but for rounding."""
    for n in range(other_count):
        line = get_edge_line(other, other_count, n)
        length = abs(line[0]) + abs(line[1])
        _, most = find_distance_range(polygon, count, line)
        if length > MIN_EDGE_LENGTH and most <= MAX_ROUNDING_OVERLAP * length:
            return True
    return False


@helper
def copy_polygon(polygon, count, target):
    """Copy a polygon."""
    for n in range(count):
        target[n, 0], target[n, 1] = polygon[n, 0], polygon[n, 1]


@helper
def clip_to_pixel(triangle, column, row, is_over, spare, target):
    """
    Clip a triangle to a pixel, relative to the pixel's corner; return its number of corners.

    ``is_over``: whether the triangle crosses the left, right, upper and lower side.
    """
    left, right, above, below = is_over
    for n in range(3):
        spare[0, n, 0], spare[0, n, 1] = triangle[X + n] - column, triangle[Y + n] - row
    count, side = np.int64(3), 0
    if left:
        count = clip_polygon(spare[side], count, (1.0, 0.0, 0.0), spare[1 - side])
        side = 1 - side
    if right:
        count = clip_polygon(spare[side], count, (-1.0, 0.0, 1.0), spare[1 - side])
        side = 1 - side
    if above:
        count = clip_polygon(spare[side], count, (0.0, 1.0, 0.0), spare[1 - side])
        side = 1 - side
    if below:
        count = clip_polygon(spare[side], count, (0.0, -1.0, 1.0), spare[1 - side])
        side = 1 - side
    copy_polygon(spare[side], count, target)
    return count


@helper
def evaluate_depth(triangle, x, y):
    """Return the depth of a triangle's plane at a point."""
    dx, dy = x - triangle[X], y - triangle[Y]
    return triangle[DEPTH] + (triangle[SLOPE_X] * dx + triangle[SLOPE_Y] * dy)


@helper
def find_intersection_line(p, q):
    """Return the line where two candidates meet, positive where ``p`` is nearer; and depth."""
    a, b = p[SLOPE_X] - q[SLOPE_X], p[SLOPE_Y] - q[SLOPE_Y]
    return (a, b, p[DEPTH] - q[DEPTH]), max(abs(p[DEPTH]), abs(q[DEPTH]))


@helper
def is_tied(line, size):
    """Return whether two depths are equal all over the pixel, to float32."""
    a, b, c = line
    if abs(c) > DEPTH_TOLERANCE * size:
        return False
    most = max(max(abs(c), abs(c + a)), max(abs(c + b), abs(c + a + b)))
    return most <= DEPTH_TOLERANCE * size


@helper
def find_tied_candidates(count, candidates, tied):
    """
    Write, for each candidate, the first one with tied depths, or itself.

    Ties are not transitive: compared by their own depths, three faces might hide each other in a
    cycle, and none would be visible.
    """
    for n in range(count):
        tied[n] = n
        for k in range(n):
            if tied[k] == k:
                line, size = find_intersection_line(candidates[n], candidates[k])
                if is_tied(line, size):
                    tied[n] = k
                    break


@helper
def subtract(pieces, sizes, count, hiding, hiding_size, spare, lists):
    """
    Subtract a convex polygon from pieces; return the number left, -1 beyond the capacity.

    ``lists`` are the source and target list: (0, 1) or (1, 0).
    """
    source, target = lists
    left = np.int64(0)
    for n in range(count):
        piece, size, before = pieces[source, n], sizes[source, n], left
        if size + hiding_size >= MAX_CORNERS:
            return np.int64(-1)
        is_touched = not is_beyond(piece, size, hiding, hiding_size)
        if is_touched:
            # Cut off what lies beyond each edge in turn.
            copy_polygon(piece, size, spare[0])
            inside, side = size, 0
            for k in range(hiding_size):
                line = get_edge_line(hiding, hiding_size, k)
                least, most = find_distance_range(spare[side], inside, line)
                if least >= 0.0 or abs(line[0]) + abs(line[1]) <= MIN_EDGE_LENGTH:
                    continue
                if most <= 0.0:
                    inside = np.int64(0)
                    break
                inside, outside = split_polygon(
                    spare[side], inside, line, spare[1 - side], pieces[target, left]
                )
                side = 1 - side
                if compute_area(pieces[target, left], outside) > MIN_AREA:
                    sizes[target, left] = outside
                    left += 1
            is_touched = compute_area(spare[side], inside) > MIN_AREA
        if not is_touched:
            # The piece stays whole.
            left = before
            copy_polygon(piece, size, pieces[target, left])
            sizes[target, left] = size
            left += 1
        if left > MAX_PIECES:
            return np.int64(-1)
    return left


@helper
def is_behind(a, b):
    """Return whether a candidate lies behind another everywhere, whatever depths are tied."""
    return a[HIGHEST] < b[LOWEST] - BEHIND_TOLERANCE * abs(b[LOWEST])


@helper
def are_disjoint(a, b):
    """Return whether bounds of two candidates do not overlap."""
    beside = (a[BOUNDS + RIGHT] <= b[BOUNDS + LEFT]) | (b[BOUNDS + RIGHT] <= a[BOUNDS + LEFT])
    above = (a[BOUNDS + BOTTOM] <= b[BOUNDS + TOP]) | (b[BOUNDS + BOTTOM] <= a[BOUNDS + TOP])
    return beside | above


@helper
def compute_visible_area(n, candidates, count, polygons, corners, tied, work):
    """Return the visible area of a candidate in a pixel; -1 if it has too many pieces."""
    pieces, sizes, spare = work
    face, level = candidates[n, FACE], candidates[tied[n]]
    copy_polygon(polygons[n], corners[n], pieces[0, 0])
    sizes[0, 0] = corners[n]
    left, source = np.int64(1), 0
    for k in range(count):
        other, hiding, size = candidates[k, FACE], polygons[k], corners[k]
        is_tied_depth = tied[k] == tied[n]
        if (other == face) | (is_tied_depth & (other > face)):
            continue
        if is_behind(candidates[k], candidates[n]) or are_disjoint(candidates[k], candidates[n]):
            continue
        if is_beyond(polygons[n], corners[n], hiding, size):
            continue
        if is_beyond(hiding, size, polygons[n], corners[n]):
            continue
        if not is_tied_depth:
            # Clip the other to where it is nearer.
            line, _ = find_intersection_line(candidates[tied[k]], level)
            size = clip_polygon(hiding, size, line, spare[2])
            hiding = spare[2]
            if compute_area(hiding, size) <= MIN_AREA:
                continue
        left = subtract(pieces, sizes, left, hiding, size, spare, (source, 1 - source))
        source = 1 - source
        if left <= 0:
            break
    if left < 0:
        return -1.0
    total = 0.0
    for k in range(left):
        total += compute_area(pieces[source, k], sizes[source, k])
    return total


@helper
def set_up_triangles(listed, parts, screen, bits, triangles, lists):
    """Write faces, corners clockwise, depth planes and bounds of a tile's triangles."""
    all_bounds, numbers = lists
    unit = 1.0 / np.float64(np.int64(1) << bits)
    for n in range(listed.shape[0]):
        (i, j, k), face = get_triangle(parts[0], parts[1], parts[2], np.int64(listed[n]))
        ax, ay = np.float64(screen.xy[i, 0]) * unit, np.float64(screen.xy[i, 1]) * unit
        bx, by = np.float64(screen.xy[j, 0]) * unit, np.float64(screen.xy[j, 1]) * unit
        cx, cy = np.float64(screen.xy[k, 0]) * unit, np.float64(screen.xy[k, 1]) * unit
        da, db, dc = screen.depth[i], screen.depth[j], screen.depth[k]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area < 0.0:
            bx, by, db, cx, cy, dc = cx, cy, dc, bx, by, db
            area = -area
        row = triangles[n]
        row[FACE] = face
        row[SLOPE_X] = ((db - da) * (cy - ay) - (dc - da) * (by - ay)) / area
        row[SLOPE_Y] = ((dc - da) * (bx - ax) - (db - da) * (cx - ax)) / area
        row[DEPTH] = da
        row[X], row[X + 1], row[X + 2] = ax, bx, cx
        row[Y], row[Y + 1], row[Y + 2] = ay, by, cy
        bounds, numbers[TILE, n] = all_bounds[TILE], n
        bounds[LEFT, n], bounds[RIGHT, n] = min(ax, min(bx, cx)), max(ax, max(bx, cx))
        bounds[TOP, n], bounds[BOTTOM, n] = min(ay, min(by, cy)), max(ay, max(by, cy))


@helper
def filter_list(lists, region, count, side, low, high):
    """
    List the triangles of the enclosing region that overlap a range; return their number.

    ``side`` is LEFT for columns, TOP for rows.
    """
    all_bounds, numbers = lists
    source, bounds = all_bounds[region - 1], all_bounds[region]
    length = np.int64(0)
    for n in range(count):
        if (source[side + 1, n] > low) & (source[side, n] < high):
            numbers[region, length] = numbers[region - 1, n]
            for k in range(4):
                bounds[k, length] = source[k, n]
            length += 1
    return length


@helper
def write_bounds(triangle, polygon, corners, column, row, candidate):
    """Write depths and bounds of a candidate's polygon in a pixel."""
    lowest, highest = np.inf, -np.inf
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    for n in range(corners):
        x, y = polygon[n, 0], polygon[n, 1]
        depth = evaluate_depth(triangle, column + x, row + y)
        lowest, highest = min(lowest, depth), max(highest, depth)
        left, right, top, bottom = min(left, x), max(right, x), min(top, y), max(bottom, y)
    candidate[LOWEST], candidate[HIGHEST] = lowest, highest
    candidate[BOUNDS + LEFT], candidate[BOUNDS + RIGHT] = left, right
    candidate[BOUNDS + TOP], candidate[BOUNDS + BOTTOM] = top, bottom


@helper
def find_candidates(lists, listed, triangles, column, row, candidates, polygons, corners, work,
                    query):  # fmt: skip
    """List the triangles in a pixel that no nearer one hides completely; return their number."""
    bounds, numbers = lists[0][PIXEL], lists[1][PIXEL]
    count, hidden_depth = np.int64(0), -np.inf
    for n in range(listed):
        triangle, candidate = triangles[numbers[n]], candidates[count]
        if is_discarded(np.int64(triangle[FACE]), column, row, query):
            continue
        is_over = (
            bounds[LEFT, n] < column, bounds[RIGHT, n] > column + 1.0,
            bounds[TOP, n] < row, bounds[BOTTOM, n] > row + 1.0,
        )  # fmt: skip
        size = clip_to_pixel(triangle, column, row, is_over, work[2], polygons[count])
        area = compute_area(polygons[count], size)
        if area <= MIN_AREA:
            continue
        write_bounds(triangle, polygons[count], size, column, row, candidate)
        if candidate[HIGHEST] < hidden_depth - DEPTH_TOLERANCE * abs(candidate[HIGHEST]):
            continue
        if area >= 1.0:
            hidden_depth = max(hidden_depth, candidate[LOWEST])
        candidate[FACE], candidate[DEPTH] = triangle[FACE], evaluate_depth(triangle, column, row)
        candidate[SLOPE_X], candidate[SLOPE_Y] = triangle[SLOPE_X], triangle[SLOPE_Y]
        corners[count] = size
        count += 1
    # Once more, with the final depth bound.
    count_kept = np.int64(0)
    for n in range(count):
        highest = candidates[n, HIGHEST]
        if highest < hidden_depth - DEPTH_TOLERANCE * abs(highest):
            continue
        if count_kept < n:
            for k in range(CANDIDATE_COLUMNS):
                candidates[count_kept, k] = candidates[n, k]
            corners[count_kept] = corners[n]
            copy_polygon(polygons[n], corners[n], polygons[count_kept])
        count_kept += 1
    return count_kept


@helper
def sort_candidates(count, candidates, order):
    """Write the order of candidates, nearest first."""
    for n in range(count):
        k = n
        while k > 0 and candidates[order[k - 1], HIGHEST] < candidates[n, HIGHEST]:
            order[k] = order[k - 1]
            k -= 1
        order[k] = n


@helper
def compute_visible_areas(count, candidates, polygons, corners, orders, work, areas):
    """Write visible areas, summed at the first candidate of a face; False beyond the capacity."""
    tied, order = orders[0], orders[1]
    find_tied_candidates(count, candidates, tied)
    sort_candidates(count, candidates, order)
    seen = 0.0
    for k in range(count):
        n, area = order[k], 0.0
        if seen < FULL_PIXEL_AREA:
            area = compute_visible_area(n, candidates, count, polygons, corners, tied, work)
        if area < 0.0:
            return False
        areas[n] = area
        seen += area
    # Pieces of one face follow each other.
    first = np.int64(0)
    for n in range(1, count):
        if candidates[n, FACE] == candidates[first, FACE]:
            areas[first] += areas[n]
            areas[n] = 0.0
        else:
            first = n
    return True


@helper
def write_pixel(count, candidates, areas, shown, coverage, rest, row, i):
    """Write the faces of a pixel and their coverage, up to the capacity; return their number."""
    faces, written, total = np.int64(0), np.int64(0), 0.0
    for n in range(count):
        # Round running sums, so that coverage and the rest add up to the pixel.
        total += areas[n]
        end = min(np.int64(total * COVERAGE_STEPS + 0.5), np.int64(COVERAGE_STEPS))
        if end > written:
            if faces < shown.shape[0]:
                shown[faces, row, i] = np.int32(candidates[n, FACE])
                coverage[faces, row, i] = np.float32((end - written) / COVERAGE_STEPS)
            faces, written = faces + 1, end
    rest[row, i] = np.float32((COVERAGE_STEPS - written) / COVERAGE_STEPS)
    return faces


def allocate_scratch(max_triangles: int) -> tuple[Any, ...]:
    """Allocate a thread's memory for tiles of at max_triangles so many triangles."""
    return (
        np.empty((max_triangles, TRIANGLE_COLUMNS), np.float64), (np.empty((PIXEL + 1, 4,
        max_triangles), np.float64), np.empty((PIXEL + 1, max_triangles), np.int64)),
        np.empty((2, max_triangles), np.int64),
        np.empty((max_triangles, CANDIDATE_COLUMNS), np.float64),
        np.empty((max_triangles + 1, MAX_CORNERS, 2), np.float64),
        np.empty(max_triangles + 1, np.int64), np.empty(max_triangles, np.float64),
        np.empty((2, MAX_PIECES + MAX_CORNERS, MAX_CORNERS, 2), np.float64),
        np.empty((2, MAX_PIECES + MAX_CORNERS), np.int64),
        np.empty((3, MAX_CORNERS, 2), np.float64),
    )  # fmt: skip


SCRATCH = (
    float64[:, ::1], (float64[:, :, ::1], int64[:, ::1]), int64[:, ::1], float64[:, ::1],
    float64[:, :, ::1], int64[::1], float64[::1], float64[:, :, :, ::1], int64[:, ::1],
    float64[:, :, ::1],
)  # fmt: skip
"""Types of `allocate_scratch`."""


@kernel
def find_areas(
    row_range: (int64, int64), starts: int64[::1], binned: int32[::1], faces: Faces,
    screen: ScreenVertices, viewport: Viewport, begin: int64, shown: int32[:, :, ::1],
    coverage: float32[:, :, ::1], rest: float32[:, ::1], deepest: int64[::1], scratch: SCRATCH,
    query: AlphaQuery,
):  # fmt: skip
    """
    Find the faces visible in each pixel of some rows, and their area coverage.

    Parameters
    ----------
    row_range : (int, int)
        The first, and one past the last, of one row of tiles.
    starts, binned : arrays
        The triangles of each tile, as in ``visibility_pass.TileLists``.
    faces, screen, viewport : records
    begin : int
        The first pixel: 0, or the number that the previous call returned.
    shown : (J, R, W) int32
        Written: the faces of each pixel, ascending. Must be -1 before.
    coverage : (J, R, W) float32
        Written: their shares of the pixel's area; undefined for a face -1.
    rest : (R, W) float32
        Written: the share that shows no face.
    deepest : (3,) int64
        The most faces in a pixel so far, with its column and row; at first 0. Written; -1 for a
        pixel that falls into too many pieces.
    scratch : tuple
        From `allocate_scratch` for the longest list, of this thread alone.
    query : AlphaQuery
        From an ``alpha_test.AlphaComputation``. A face has one alpha in a pixel: at its centre.

    Returns
    -------
    int
        -1, or the number of a pixel that has more than J faces, or too many pieces.
    """
    triangles, lists, orders, candidates, polygons, corners, areas = scratch[:7]
    work, parts = scratch[7:10], (faces.faces, faces.pieces, faces.piece_faces)
    height, step = row_range[1] - row_range[0], np.int64(1) << STRIP_BITS
    columns = (np.int64(viewport.width) + (1 << TILE_BITS) - 1) >> TILE_BITS
    for tile_column in range(begin // (height << TILE_BITS), columns):
        tile = (row_range[0] >> TILE_BITS) * columns + tile_column
        left, _, right, _ = get_tile_window(tile, columns, viewport)
        listed = binned[starts[tile] : starts[tile + 1]]
        set_up_triangles(listed, parts, screen, viewport.grid_bits, triangles, lists)
        in_strip, in_row, in_block = np.int64(0), np.int64(0), np.int64(0)
        for row in range(height):
            y = np.float64(row_range[0] + row)
            if row % step == 0:
                in_strip = filter_list(lists, STRIP, listed.shape[0], TOP, y, y + step)
            in_row = filter_list(lists, ROW, in_strip, TOP, y, y + 1.0)
            for column in range(left, right + 1):
                x = np.float64(column)
                if (column - left) % step == 0:
                    in_block = filter_list(lists, BLOCK, in_row, LEFT, x, x + step)
                number = ((tile_column * height + row) << TILE_BITS) + column - left
                if number < begin:
                    continue
                in_pixel = filter_list(lists, PIXEL, in_block, LEFT, x, x + 1.0)
                count = find_candidates(
                    lists, in_pixel, triangles, x, y, candidates, polygons, corners, work, query
                )
                used = np.int64(-1)
                if compute_visible_areas(count, candidates, polygons, corners, orders, work, areas):
                    used = write_pixel(count, candidates, areas, shown, coverage, rest, row, column)
                if used > deepest[0] or used < 0:
                    deepest[0], deepest[1], deepest[2] = used, column, row_range[0] + row
                if used > shown.shape[0] or used < 0:
                    return number
    return np.int64(-1)
