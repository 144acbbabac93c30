"""
Compute exact area coverage: the visible area of each face in each pixel.

A triangle clipped to a pixel's square is a convex polygon. The part hidden by another triangle is
convex too: where the other is nearer, bounded by a line, since depth is linear on the screen. So
the visible part is a convex polygon minus convex polygons, computed as a list of convex pieces.
Vertices are those on the sub-pixel grid; everything after is float64, until areas become
shares: whole numbers of parts, as those of samples are, of which there are 2**24 in a pixel.

If depths differ by less than float32 resolves all over the pixel, the lower face number is nearer,
as it is for samples.

References
----------
.. [1] I. Sutherland and G. Hodgman, "Reentrant Polygon Clipping", CACM 17(1), 1974.
.. [2] E. Catmull, "A Hidden-Surface Algorithm with Anti-Aliasing", SIGGRAPH 1978.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.pipeline.fragments.compositing import empty_row
from rasterjit.pipeline.geometry.setup import TILE_BITS, triangle_of
from rasterjit.pipeline.records import Faces, ScreenVertices, Viewport
from rasterjit.pipeline.visibility.alpha_test import Question, is_hole
from rasterjit.pipeline.visibility.tile_rasterizer import tile_window
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64

MAX_CORNERS = 40
"""Most corners of a piece."""

MAX_PIECES = 512
"""Most pieces of a triangle's visible part in a pixel."""

CORNERS = 3
"""Polygons with fewer corners have no area."""

MIN_AREA = 2.0**-46
"""Smaller pieces, in pixels, are dropped: they come from rounding."""

PARTS = 1 << 24
"""
Parts of a pixel. Coverage is a whole number of them: as float32 it is 1 exactly if nothing else
is visible in the pixel, and 0 exactly if the face is not.
"""

DEPTH_STEP = 2.0**-24
"""Depths are equal within this relative difference: half a step of float32."""

FACE, DEPTH, SLOPE_X, SLOPE_Y = 0, 1, 2, 3
"""Columns of a triangle: face; stored depth at its first corner, and the slopes of the depth."""
X, Y = 4, 7
"""Three columns each: corners, pixels."""
TRIANGLE_COLUMNS = 10


@helper
def area_of(polygon, count):
    """Return the area of a polygon, positive if it runs clockwise as seen on the screen."""
    doubled = 0.0
    for n in range(1, count - 1):
        ux, uy = polygon[n, 0] - polygon[0, 0], polygon[n, 1] - polygon[0, 1]
        vx, vy = polygon[n + 1, 0] - polygon[0, 0], polygon[n + 1, 1] - polygon[0, 1]
        doubled += ux * vy - uy * vx
    return 0.5 * doubled


@helper
def cut(polygon, count, line, target):
    """Clip a convex polygon to the half plane ``a x + b y + c >= 0``; return its corner count."""
    a, b, c = line
    kept = np.int64(0)
    if count == 0:
        return kept
    last_x, last_y = polygon[count - 1, 0], polygon[count - 1, 1]
    before = a * last_x + b * last_y + c
    for n in range(count):
        x, y = polygon[n, 0], polygon[n, 1]
        here = a * x + b * y + c
        if (before < 0.0 < here) | (here < 0.0 < before):
            t = before / (before - here)
            target[kept, 0], target[kept, 1] = last_x + t * (x - last_x), last_y + t * (y - last_y)
            kept += 1
        if here >= 0.0:
            target[kept, 0], target[kept, 1] = x, y
            kept += 1
        last_x, last_y, before = x, y, here
    return kept


@helper
def edge_line(polygon, count, n):
    """Return the line through an edge, positive inside."""
    following = n + 1 if n + 1 < count else 0
    x, y = polygon[n, 0], polygon[n, 1]
    a, b = y - polygon[following, 1], polygon[following, 0] - x
    return a, b, -(a * x + b * y)


@helper
def turned(line):
    """Return a line with its sign flipped."""
    return -line[0], -line[1], -line[2]


@helper
def copy_polygon(polygon, count, target):
    """Copy a polygon."""
    for n in range(count):
        target[n, 0], target[n, 1] = polygon[n, 0], polygon[n, 1]


@helper
def cut_to_pixel(triangle, column, row, spare, target):
    """Clip a triangle to a pixel, relative to the pixel's corner; return its number of corners."""
    for n in range(3):
        spare[n, 0], spare[n, 1] = triangle[X + n] - column, triangle[Y + n] - row
    count = cut(spare, np.int64(3), (1.0, 0.0, 0.0), target)
    count = cut(target, count, (-1.0, 0.0, 1.0), spare)
    count = cut(spare, count, (0.0, 1.0, 0.0), target)
    count = cut(target, count, (0.0, -1.0, 1.0), spare)
    copy_polygon(spare, count, target)
    return count


@helper
def depth_at(triangle, x, y):
    """Return the depth of a triangle's plane at a point."""
    way_x, way_y = x - triangle[X], y - triangle[Y]
    return triangle[DEPTH] + (triangle[SLOPE_X] * way_x + triangle[SLOPE_Y] * way_y)


@helper
def depth_line(one, other, column, row):
    """Return how much nearer one triangle is than another in a pixel: a line, and depth's size."""
    a, b = one[SLOPE_X] - other[SLOPE_X], one[SLOPE_Y] - other[SLOPE_Y]
    here, there = depth_at(one, column, row), depth_at(other, column, row)
    return (a, b, here - there), max(abs(here), abs(there))


@helper
def is_tied(line, size):
    """Return whether two depths are equal all over the pixel, to float32."""
    a, b, c = line
    most = max(max(abs(c), abs(c + a)), max(abs(c + b), abs(c + a + b)))
    return most <= DEPTH_STEP * size


@helper
def find_levels(count, candidates, triangles, column, row, levels):
    """
    Write whose depths stand for each candidate's: the first that it is tied with, or its own.

    Ties are not transitive: compared by their own depths, three faces might hide each other in a
    cycle, and none would be visible.
    """
    for n in range(count):
        levels[n] = n
        for k in range(n):
            if levels[k] == k:
                line, size = depth_line(
                    triangles[candidates[n]], triangles[candidates[k]], column, row
                )
                if is_tied(line, size):
                    levels[n] = k
                    break


@helper
def subtract(pieces, sizes, count, hiding, hiding_size, spare, lists):
    """
    Subtract a convex polygon from pieces; return how many are left, -1 without room.

    ``lists`` has the source and target list: (0, 1) or (1, 0).
    """
    source, target = lists
    left = np.int64(0)
    for n in range(count):
        piece, size = pieces[source, n], sizes[source, n]
        if size + hiding_size >= MAX_CORNERS:
            return np.int64(-1)
        # Skip a piece that the polygon does not touch.
        copy_polygon(piece, size, spare[0])
        inside, side = size, 0
        for k in range(hiding_size):
            inside = cut(spare[side], inside, edge_line(hiding, hiding_size, k), spare[1 - side])
            side = 1 - side
            if inside < CORNERS:
                break
        if area_of(spare[side], inside) <= MIN_AREA:
            if left == MAX_PIECES:
                return np.int64(-1)
            copy_polygon(piece, size, pieces[target, left])
            sizes[target, left] = size
            left += 1
            continue
        # Cut off what lies beyond each edge in turn.
        copy_polygon(piece, size, spare[0])
        inside, side = size, 0
        for k in range(hiding_size):
            if left == MAX_PIECES:
                return np.int64(-1)
            line = edge_line(hiding, hiding_size, k)
            outside = cut(spare[side], inside, turned(line), pieces[target, left])
            if area_of(pieces[target, left], outside) > MIN_AREA:
                sizes[target, left] = outside
                left += 1
            inside = cut(spare[side], inside, line, spare[1 - side])
            side = 1 - side
    return left


@helper
def seen_area(n, candidates, count, triangles, column, row, polygons, corners, levels, work):
    """Return the visible area of a candidate in a pixel; -1 if it has too many pieces."""
    pieces, sizes, spare = work
    face, level = triangles[candidates[n], FACE], triangles[candidates[levels[n]]]
    copy_polygon(polygons[n], corners[n], pieces[0, 0])
    sizes[0, 0] = corners[n]
    left, source = np.int64(1), 0
    for k in range(count):
        other = triangles[candidates[k], FACE]
        is_level = levels[k] == levels[n]
        if (other == face) | (is_level & (other > face)):
            continue
        hiding, size = polygons[k], corners[k]
        if not is_level:
            # Where the other is nearer.
            line, _ = depth_line(triangles[candidates[levels[k]]], level, column, row)
            size = cut(polygons[k], corners[k], line, spare[2])
            hiding = spare[2]
        if area_of(hiding, size) <= MIN_AREA:
            continue
        left = subtract(pieces, sizes, left, hiding, size, spare, (source, 1 - source))
        source = 1 - source
        if left <= 0:
            break
    if left < 0:
        return -1.0
    total = 0.0
    for k in range(left):
        total += area_of(pieces[source, k], sizes[source, k])
    return total


@helper
def set_up_triangles(listed, parts, screen, bits, triangles):
    """Write faces, corners clockwise and depth planes of a tile's triangles."""
    unit = 1.0 / np.float64(np.int64(1) << bits)
    for n in range(listed.shape[0]):
        (i, j, k), face = triangle_of(parts[0], parts[1], parts[2], np.int64(listed[n]))
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


@helper
def is_beside(triangle, first, place):
    """Return whether a triangle lies beside a column (first is X) or a row (first is Y)."""
    low = min(triangle[first], min(triangle[first + 1], triangle[first + 2]))
    high = max(triangle[first], max(triangle[first + 1], triangle[first + 2]))
    return (high <= place) | (low >= place + 1.0)


@helper
def reach_of(triangle, polygon, corners, column, row):
    """Return the lowest and the highest depth of a polygon in a pixel."""
    lowest, highest = np.inf, -np.inf
    for n in range(corners):
        depth = depth_at(triangle, column + polygon[n, 0], row + polygon[n, 1])
        lowest, highest = min(lowest, depth), max(highest, depth)
    return lowest, highest


@helper
def find_candidates(
    in_row, many, triangles, column, row, candidates, polygons, corners, work, question
):  # fmt: skip
    """List the triangles in a pixel that no nearer one hides completely; return how many."""
    count, floor = np.int64(0), -np.inf
    for n in range(many):
        triangle = triangles[in_row[n]]
        if is_beside(triangle, X, column):
            continue
        if is_hole(np.int64(triangle[FACE]), column, row, question):
            continue
        size = cut_to_pixel(triangle, column, row, work[2][0], polygons[count])
        area = area_of(polygons[count], size)
        if area <= MIN_AREA:
            continue
        lowest, highest = reach_of(triangle, polygons[count], size, column, row)
        slack = DEPTH_STEP * abs(highest)
        if highest < floor - slack:
            continue
        if area >= 1.0:
            floor = max(floor, lowest)
        candidates[count], corners[count] = in_row[n], size
        count += 1
    # Once more, with the final depth bound.
    kept = np.int64(0)
    for n in range(count):
        triangle = triangles[candidates[n]]
        _, highest = reach_of(triangle, polygons[n], corners[n], column, row)
        if highest < floor - DEPTH_STEP * abs(highest):
            continue
        if kept < n:
            candidates[kept], corners[kept] = candidates[n], corners[n]
            copy_polygon(polygons[n], corners[n], polygons[kept])
        kept += 1
    return kept


@helper
def share_pixel(count, candidates, triangles, column, row, polygons, corners, levels, work, areas):
    """Write the visible areas of candidates, summed per face at its first; False without room."""
    find_levels(count, candidates, triangles, column, row, levels)
    for n in range(count):
        area = seen_area(
            n, candidates, count, triangles, column, row, polygons, corners, levels, work
        )
        if area < 0.0:
            return False
        areas[n] = area
        face = triangles[candidates[n], FACE]
        # Pieces of one face follow each other.
        if n > 0 and triangles[candidates[n - 1], FACE] == face:
            first = n - 1
            while first > 0 and triangles[candidates[first - 1], FACE] == face:
                first -= 1
            areas[first] += area
            areas[n] = 0.0
    return True


@helper
def write_pixel(count, candidates, triangles, areas, shown, shares, rest, row, i):
    """Write the faces of a pixel and their shares, as far as there is room; return how many."""
    faces, before, total = np.int64(0), np.int64(0), 0.0
    for n in range(count):
        # Round running sums, not shares: then shares and the rest add up to the pixel.
        total += areas[n]
        upto = min(np.int64(total * PARTS + 0.5), np.int64(PARTS))
        if upto > before:
            if faces < shown.shape[0]:
                shown[faces, row, i] = np.int32(triangles[candidates[n], FACE])
                shares[faces, row, i] = np.float32((upto - before) / PARTS)
            faces, before = faces + 1, upto
    rest[row, i] = np.float32((PARTS - before) / PARTS)
    return faces


def scratch_memory(most: int) -> tuple[Any, ...]:
    """Return a thread's memory for tiles of at most that many triangles."""
    return (
        np.empty((most, TRIANGLE_COLUMNS), np.float64),
        np.empty(most, np.int64),
        np.empty(most, np.int64),
        np.empty((most + 1, MAX_CORNERS, 2), np.float64),
        np.empty(most + 1, np.int64),
        np.empty(most, np.int64),
        np.empty(most, np.float64),
        np.empty((2, MAX_PIECES, MAX_CORNERS, 2), np.float64),
        np.empty((2, MAX_PIECES), np.int64),
        np.empty((3, MAX_CORNERS, 2), np.float64),
    )


SCRATCH = (
    float64[:, ::1], int64[::1], int64[::1], float64[:, :, ::1], int64[::1], int64[::1],
    float64[::1], float64[:, :, :, ::1], int64[:, ::1], float64[:, :, ::1],
)  # fmt: skip
"""The types of `scratch_memory`."""


@kernel
def find_areas(
    rows: (int64, int64), starts: int64[::1], binned: int32[::1], faces: Faces,
    screen: ScreenVertices, viewport: Viewport, shown: int32[:, :, ::1], shares: float32[:, :, ::1],
    rest: float32[:, ::1], deepest: int64[::1], scratch: SCRATCH,
    question: Question,
):  # fmt: skip
    """
    Find the faces visible in each pixel of some rows, and their area coverage.

    Parameters
    ----------
    rows : (int, int)
        The first, and one past the last, of one row of tiles.
    starts, binned : arrays
        The triangles that reach each tile, as ``visibility_pass.TileLists`` has them.
    faces, screen, viewport : records
    shown : (J, R, W) int32
        Written: the faces of each pixel, ascending; -1 behind the last.
    shares : (J, R, W) float32
        Written: their shares of the pixel's area; for a face -1 anything.
    rest : (R, W) float32
        Written: the share that shows no face.
    deepest : (3,) int64
        Written: the most faces in a pixel, with its column and row. If they are more than J, some
        are missing; -1 for a pixel that falls into too many pieces.
    scratch : tuple
        This thread's own, from `scratch_memory`, for the longest of the lists.
    question : Question
        Of an ``alpha_test.AlphaTest``. A face has one alpha in a pixel: at its centre.
    """
    triangles, in_row, candidates, polygons, corners, levels, areas = scratch[:7]
    work, parts = scratch[7:10], (faces.faces, faces.pieces, faces.piece_faces)
    columns = (np.int64(viewport.width) + (1 << TILE_BITS) - 1) >> TILE_BITS
    most = np.int64(0), np.int64(0), np.int64(0)
    for row in range(rows[1] - rows[0]):
        for layer in range(shown.shape[0]):
            empty_row(shown[layer, row])
    for tile_column in range(columns):
        tile = (rows[0] >> TILE_BITS) * columns + tile_column
        left, _, right, _ = tile_window(tile, columns, viewport)
        listed = binned[starts[tile] : starts[tile + 1]]
        set_up_triangles(listed, parts, screen, viewport.grid_bits, triangles)
        for row in range(rows[1] - rows[0]):
            y, many = np.float64(rows[0] + row), np.int64(0)
            for n in range(listed.shape[0]):
                if not is_beside(triangles[n], Y, y):
                    in_row[many] = n
                    many += 1
            for column in range(left, right + 1):
                x = np.float64(column)
                count = find_candidates(
                    in_row, many, triangles, x, y, candidates, polygons, corners, work, question
                )
                if not share_pixel(
                    count, candidates, triangles, x, y, polygons, corners, levels, work, areas
                ):
                    deepest[0], deepest[1], deepest[2] = -1, column, rows[0] + row
                    return
                found = write_pixel(
                    count, candidates, triangles, areas, shown, shares, rest, row, column
                )
                if found > most[0]:
                    most = found, np.int64(column), np.int64(rows[0] + row)
    deepest[0], deepest[1], deepest[2] = most
