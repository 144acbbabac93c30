"""
Set up the triangles of a tile in batches: gather their vertices, then compute edges and depths.

Gathering is a pass of its own, so that many cache misses overlap; the arithmetic is vectorized
over triangles. A batch is two small arrays, one row for each quantity (structure of arrays).

Long lists may be sorted before, roughly front to back: a counting sort by ranges of depth, in no
particular order within a range.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.geometry import setup
from rasterjit.pipeline.records import Faces, ScreenVertices
from rasterjit.runtime.intrinsics import copy_pair, flat, part, prefetch, store_bounds, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float64, int32, int64

MAX_SMALL_PIXELS = 8
"""Width of the bounding box, pixels, up to which a triangle is tested sample by sample."""

COLUMN_BLOCK_BITS = 6
"""Depth along a row is evaluated afresh every 2**6 = 64 columns; tiles are no wider."""

TRIANGLES_PER_BATCH = 64
"""Triangles of a batch: their data, 14 KiB, stays in L1 beside the tile's samples."""

FACE, AX, AY, BX, BY, CX, CY, LEFT, TOP, RIGHT, BOTTOM, WIDE, SIDE = range(13)
"""
Integer rows.

Face, vertices on the sub-pixel grid, box of samples, wide or small; for the three edges of a small
triangle the biased value at the corner of the box, in steps of one pixel: inside if not negative.
"""
MIN_CUT_ROWS = 16
"""Least height of a wide triangle in the tile, pixels, for which boxes are cut to rows."""

ROW_SCRATCH = 15
"""First of three integer rows that `cut_rows` uses as scratch memory."""
INT_ROWS = 18

DEPTH, EDGE, ACROSS, DOWN, WEIGHT, RANGE = 0, 3, 6, 9, 12, 14
"""
Float rows.

Three depths; for three edges the value at the corner of the box, exact for small triangles, and
the steps to the next column and row; two weights of the depth; the lowest and the highest depth.
"""
FLOAT_ROWS = 16

EDGE_ROUNDINGS = 64.0
"""
Bound on the rounding error of an edge function at the corner of a box, sub-pixel units.

There are five roundings, of numbers below 2**56, each off by 4 at most.
"""

MIN_INT32 = -(2.0**31)
"""Lowest int32."""

ROW_STRIDE = TRIANGLES_PER_BATCH + 8
"""Columns of a row, padded: with a power of two, rows would collide in few cache sets."""

PAIRS_A, PAIRS_B, PAIRS_C = LEFT * ROW_STRIDE, RIGHT * ROW_STRIDE, WIDE * ROW_STRIDE
"""
Flat offsets of the interleaved x and y of each vertex, before vertices are sorted.

Each takes two rows that are still unused then.
"""

FLOAT_ROWS_TYPE = float64[:, ::1]
"""Type of the float rows."""

(
    FIRST_LISTED,
    LISTED_COUNT,
    LEFT_COLUMN,
    TOP_ROW,
    RIGHT_COLUMN,
    BOTTOM_ROW,
    GRID_BITS,
    SHIFT_X,
    SHIFT_Y,
) = range(9)
"""
Elements of a batch's request: its start in the list, and length; the first and the last pixel of
the tile, inside the image; the offset added to vertices, sub-pixel units.
"""
DRAW_FIRST, DRAW_END = 9, 10
"""Elements: the range of triangles of the current batch to draw."""
PREFETCH = 11
"""Element: how many triangles after the batch to prefetch, up to two batches."""
IS_UNORDERED = 12
"""Element: not 0 if triangles are drawn in another order than by face number."""
SORTED, SORTED_DRAWN = 13, 14
"""Elements: how many triangles were sorted recently, and how many of them were then drawn."""
REQUEST_SIZE = 15

CELL_BITS = 3
"""A tile's cells are squares of 2**3 = 8 samples: a row of samples or of cells fits a vector."""

CELLS_PER_ROW = 1 << (COLUMN_BLOCK_BITS - CELL_BITS)
"""Cells in a row of a tile; the tile's cells are the bits of one word."""

MAX_SORTED = 8192
"""Most triangles of a tile sorted together: their data, 160 KiB, stays in L2."""

BUCKET_COUNT = 16
"""Depth buckets of the sort, nearest first."""

PART_BITS = 2
PARTS_PER_BUCKET = 1 << PART_BITS
"""Parts of a bucket, filled by turns: incrementing one counter twice in a row stalls."""

BOX_BITS = 12
"""Bits of a packed box of cells; above them stands the part of a bucket."""

BUCKET_SLACK = 2.0**-20
"""Part of a bucket's depth range added to its nearest depth, against rounding."""

MIN_PREFETCH_VERTICES = 1 << 16
"""Fewest vertices of a scene for prefetching: fewer lie in the cache anyway."""


@helper
def flat_index(row, n):
    """Return the flat index of column ``n`` of a row: a constant offset from ``n``."""
    return np.uintp(row * ROW_STRIDE) + n


@helper
def gather_triangles(listed, faces, screen, ints, floats):
    """Gather the faces, vertex positions and vertex depths of listed triangles."""
    all_faces, pieces, piece_faces = faces
    xy, depth, row, depths = screen.xy, screen.depth, flat(ints), flat(floats)
    for n in range(np.uintp(listed.shape[0])):
        (a, b, c), face = setup.get_triangle(all_faces, pieces, piece_faces, np.int64(listed[n]))
        row[flat_index(FACE, n)] = face
        copy_pair(xy, a, row, np.uintp(PAIRS_A // 2) + n)
        copy_pair(xy, b, row, np.uintp(PAIRS_B // 2) + n)
        copy_pair(xy, c, row, np.uintp(PAIRS_C // 2) + n)
        depths[flat_index(DEPTH, n)], depths[flat_index(DEPTH + 1, n)] = depth[a], depth[b]
        depths[flat_index(DEPTH + 2, n)] = depth[c]


@helper
def prefetch_corners(listed, faces, depth, corners):
    """Look up the vertex numbers of listed triangles, and prefetch the vertices."""
    all_faces, pieces, piece_faces = faces
    for n in range(np.uintp(listed.shape[0])):
        (a, b, c), _ = setup.get_triangle(all_faces, pieces, piece_faces, np.int64(listed[n]))
        prefetch(depth, a)
        prefetch(depth, b)
        prefetch(depth, c)
        corners[0, n], corners[1, n], corners[2, n] = a, b, c


@helper
def enclose_prefetched(screen, corners, least, most, nearest):
    """Write bounding boxes and nearest depths of triangles whose vertex numbers are prefetched."""
    xy, depth = screen.xy, screen.depth
    for n in range(np.uintp(nearest.shape[0])):
        a, b, c = np.uintp(corners[0, n]), np.uintp(corners[1, n]), np.uintp(corners[2, n])
        store_bounds(xy, a, b, c, least, most, n)
        nearest[n] = max(depth[a], max(depth[b], depth[c]))


@helper
def enclose_listed(listed, faces, screen, least, most, nearest):
    """Write the bounding boxes and nearest depths of listed triangles."""
    all_faces, pieces, piece_faces = faces
    xy, depth = screen.xy, screen.depth
    for n in range(np.uintp(listed.shape[0])):
        (a, b, c), _ = setup.get_triangle(all_faces, pieces, piece_faces, np.int64(listed[n]))
        store_bounds(xy, a, b, c, least, most, n)
        nearest[n] = max(depth[a], max(depth[b], depth[c]))


@helper
def prefetch_faces(listed, faces):
    """Prefetch listed faces."""
    corners, face_count = flat(faces[0]), np.int64(faces[0].shape[0])
    for n in range(listed.shape[0]):
        prefetch(corners, np.uintp(3 * min(np.int64(listed[n]), face_count - 1)))


@helper
def prefetch_triangles(listed, faces, depth, end):
    """
    Prefetch the vertices of a batch of listed triangles, and the faces of those after it.

    ``end`` is how many triangles there are in both.
    """
    all_faces, pieces, piece_faces = faces
    for n in range(min(end, np.int64(TRIANGLES_PER_BATCH))):
        (a, b, c), _ = setup.get_triangle(all_faces, pieces, piece_faces, np.int64(listed[n]))
        prefetch(depth, a)
        prefetch(depth, b)
        prefetch(depth, c)
    prefetch_faces(listed[min(end, np.int64(TRIANGLES_PER_BATCH)) : end], faces)


@helper
def is_above(ax, ay, bx, by):
    """Return whether a lies above b, or left of it in the same row."""
    return (ay < by) | ((ay == by) & (ax < bx))


@helper
def load_shifted_vertex(pairs, index, shift):
    """Return x and y of a vertex, shifted."""
    x, y = pairs[index], pairs[index + np.uintp(1)]
    return np.int32(x + shift[0]), np.int32(y + shift[1])


@disjoint_helper
def sort_vertices(pairs, shift, ax, ay, bx, by, cx, cy, da, db, dc):
    """
    Sort the vertices clockwise on the screen, starting at the topmost, then leftmost.

    Reads the gathered, interleaved pairs, and adds the shift. The order depends on positions
    alone, so a face is drawn alike whichever vertex it lists first, and with either winding.
    """
    for n in range(ax.shape[0]):
        # Load before selecting: conditional loads do not vectorize.
        k = np.uintp(2) * np.uintp(n)
        x0, y0 = load_shifted_vertex(pairs, np.uintp(PAIRS_A) + k, shift)
        bx0, by0 = load_shifted_vertex(pairs, np.uintp(PAIRS_B) + k, shift)
        cx0, cy0 = load_shifted_vertex(pairs, np.uintp(PAIRS_C) + k, shift)
        d0, db0, dc0 = da[n], db[n], dc[n]
        is_flipped = setup.narrow_edge(x0, y0, bx0, by0, cx0, cy0) < 0
        x1, y1 = cx0 if is_flipped else bx0, cy0 if is_flipped else by0
        d1 = dc0 if is_flipped else db0
        x2, y2 = bx0 if is_flipped else cx0, by0 if is_flipped else cy0
        d2 = db0 if is_flipped else dc0
        second = is_above(x1, y1, x0, y0) & is_above(x1, y1, x2, y2)
        third = is_above(x2, y2, x0, y0) & is_above(x2, y2, x1, y1)
        ax[n] = x1 if second else (x2 if third else x0)
        ay[n] = y1 if second else (y2 if third else y0)
        da[n] = d1 if second else (d2 if third else d0)
        bx[n] = x2 if second else (x0 if third else x1)
        by[n] = y2 if second else (y0 if third else y1)
        db[n] = d2 if second else (d0 if third else d1)
        cx[n] = x0 if second else (x1 if third else x2)
        cy[n] = y0 if second else (y1 if third else y2)
        dc[n] = d0 if second else (d1 if third else d2)


@disjoint_helper
def bound_triangles(ax, ay, bx, by, cx, cy, window, bits, left, top, right, bottom, wide):
    """
    Write the box of samples of each triangle inside a window.

    The window is a tile's (left, top, right, bottom). Boxes of triangles wider than
    ``MAX_SMALL_PIXELS`` are cut at the block of columns that holds it, which may begin left of it.
    """
    for n in range(ax.shape[0]):
        first = setup.find_first_pixel(min(ax[n], min(bx[n], cx[n])), bits)
        last = setup.find_last_pixel(max(ax[n], max(bx[n], cx[n])), bits)
        is_wide = last - first >= MAX_SMALL_PIXELS
        wide[n] = is_wide
        left[n] = max(
            first, (window[0] >> COLUMN_BLOCK_BITS) << COLUMN_BLOCK_BITS if is_wide else window[0]
        )
        top[n] = max(setup.find_first_pixel(ay[n], bits), window[1])
        right[n] = min(last, window[2])
        bottom[n] = min(setup.find_last_pixel(max(by[n], cy[n]), bits), window[3])


@disjoint_helper
def set_up_depth_planes(ax, ay, bx, by, cx, cy, da, db, dc, weight_a, weight_b, lowest, highest):
    """Write depth planes (weights of E_bc and E_ca) and ranges, as ``compute_depth_plane`` does."""
    for n in range(ax.shape[0]):
        area = np.float64(setup.narrow_edge(ax[n], ay[n], bx[n], by[n], cx[n], cy[n]))
        weight_a[n], weight_b[n] = (da[n] - dc[n]) / area, (db[n] - dc[n]) / area
        lowest[n] = min(da[n], min(db[n], dc[n]))
        highest[n] = max(da[n], max(db[n], dc[n]))


@disjoint_helper
def set_up_edge(ax, ay, bx, by, left, top, bits, value, across, down, side):
    """
    Write the edge a -> b at the corner of the box, its steps, and on which side the corner lies.

    In float64, since few CPUs convert vectors of 64-bit integers.
    """
    unit, half = np.float64(np.int64(1) << bits), np.int64(1) << (bits - 1)
    pixel = 1.0 / unit
    for n in range(ax.shape[0]):
        px = np.int32((left[n] << bits) + half)
        py = np.int32((top[n] << bits) + half)
        along_x, along_y = np.int32(bx[n] - ax[n]), np.int32(by[n] - ay[n])
        away_x, away_y = np.int32(px - ax[n]), np.int32(py - ay[n])
        here = np.float64(along_x) * np.float64(away_y) - np.float64(along_y) * np.float64(away_x)
        value[n] = here
        across[n] = np.float64(np.int32(-along_y)) * unit
        down[n] = np.float64(along_x) * unit
        is_top_left = (along_y < 0) | ((along_y == 0) & (along_x > 0))
        whole = np.floor((here if is_top_left else here - 1.0) * pixel)
        # Not read for a wide triangle, where the value may not fit.
        side[n] = np.int32(min(max(whole, MIN_INT32), -MIN_INT32 - 1.0))


@disjoint_helper
def narrow_rows(value, across, down, left, right, rows, first, last):
    """
    Narrow the range of rows, from the top of the box, to those partly inside an edge.

    Takes an edge at the corner of the box and its steps, as `set_up_edge` writes them.
    Conservative: an extra row only costs time.
    """
    for n in range(value.shape[0]):
        width = np.float64(np.int32(right[n] - left[n]))
        max_value = value[n] + max(across[n] * width, 0.0) + EDGE_ROUNDINGS
        step = abs(down[n])
        rows_inside = np.floor(max_value / (step if step > 0.0 else 1.0))
        row_count = np.float64(rows[n])
        least = min(max(-rows_inside if down[n] > 0.0 else 0.0, 0.0), row_count)
        most = min(max(rows_inside if down[n] < 0.0 else row_count, -1.0), row_count)
        first[n] = max(first[n], np.int32(least))
        last[n] = min(last[n], np.int32(most))


@disjoint_helper
def count_rows(top, bottom, rows, first, last):
    """Write the number of rows of each box, and the first and the last row, from the top."""
    for n in range(top.shape[0]):
        rows[n] = bottom[n] - top[n] + 1
        first[n], last[n] = 0, bottom[n] - top[n]


@disjoint_helper
def cut_wide_boxes(wide, top, bottom, first, last):
    """Write boxes of wide triangles cut to a range of rows."""
    for n in range(wide.shape[0]):
        is_wide = wide[n] != 0
        begin = top[n]
        top[n] = begin + (first[n] if is_wide else 0)
        bottom[n] = begin + last[n] if is_wide else bottom[n]


@helper
def has_tall_wide_triangle(wide, top, bottom):
    """Return whether any wide triangle has enough rows for `cut_rows` to pay."""
    is_any = np.int32(0)
    for n in range(wide.shape[0]):
        is_any |= wide[n] & np.int32(bottom[n] - top[n] >= MIN_CUT_ROWS)
    return is_any != 0


@helper
def cut_rows(count, ints, floats):
    """Cut the boxes of wide triangles to the rows that they cover: few for thin ones."""
    top, bottom = part(ints, TOP, 0, count), part(ints, BOTTOM, 0, count)
    rows, first, last = three_parts(ints, ROW_SCRATCH, 0, count)
    count_rows(top, bottom, rows, first, last)
    for k in range(3):
        narrow_rows(
            part(floats, EDGE + k, 0, count), part(floats, ACROSS + k, 0, count),
            part(floats, DOWN + k, 0, count), part(ints, LEFT, 0, count),
            part(ints, RIGHT, 0, count), rows, first, last,
        )  # fmt: skip
    cut_wide_boxes(part(ints, WIDE, 0, count), top, bottom, first, last)


@helper
def set_up_gathered_triangles(count, window, bits, shift, ints, floats):
    """Compute boxes, edges and depth planes of the gathered triangles, vectorized."""
    ax, ay = part(ints, AX, 0, count), part(ints, AY, 0, count)
    bx, by = part(ints, BX, 0, count), part(ints, BY, 0, count)
    cx, cy = part(ints, CX, 0, count), part(ints, CY, 0, count)
    da, db = part(floats, DEPTH, 0, count), part(floats, DEPTH + 1, 0, count)
    dc = part(floats, DEPTH + 2, 0, count)
    left, top = part(ints, LEFT, 0, count), part(ints, TOP, 0, count)
    sort_vertices(flat(ints), shift, ax, ay, bx, by, cx, cy, da, db, dc)
    bound_triangles(
        ax, ay, bx, by, cx, cy, window, bits, left, top, *three_parts(ints, RIGHT, 0, count)
    )
    set_up_depth_planes(
        ax, ay, bx, by, cx, cy, da, db, dc, *three_parts(floats, WEIGHT, 0, count),
        part(floats, RANGE + 1, 0, count),
    )  # fmt: skip
    for k in range(3):
        # The edge opposite to each vertex.
        second, third = AX + 2 * ((k + 1) % 3), AX + 2 * ((k + 2) % 3)
        set_up_edge(
            part(ints, second, 0, count), part(ints, second + 1, 0, count),
            part(ints, third, 0, count), part(ints, third + 1, 0, count), left, top, bits,
            part(floats, EDGE + k, 0, count), part(floats, ACROSS + k, 0, count),
            part(floats, DOWN + k, 0, count), part(ints, SIDE + k, 0, count),
        )  # fmt: skip
    if has_tall_wide_triangle(part(ints, WIDE, 0, count), top, part(ints, BOTTOM, 0, count)):
        cut_rows(count, ints, floats)


@helper
def find_cell(pixel, origin):
    """Return the column or row of a tile's cells that holds a pixel, clamped to the tile."""
    offset = np.int32(pixel - np.int32(origin))
    last = np.int32((1 << COLUMN_BLOCK_BITS) - 1)
    return np.int32(max(min(offset, last), np.int32(0)) >> CELL_BITS)


@disjoint_helper
def find_cells(least, most, shift, origin, bits):
    """
    Write the first and the last column, and row, of a tile's cells around triangles.

    Takes the least and the greatest x and y, interleaved; writes both cells over the least, in one
    number.
    """
    bits = np.uint32(bits & 15)
    half = np.int32(np.int32(1) << np.int32(bits - np.uint32(1)))
    for n in range(least.shape[0]):
        is_row = np.int32(n) & np.int32(1) != 0
        offset = shift[1] if is_row else shift[0]
        begin = origin[1] if is_row else origin[0]
        first = setup.floor_to_pixel(
            np.int32(np.int32(least[n] + offset) + np.int32(half - 1)), bits
        )
        last = setup.floor_to_pixel(np.int32(np.int32(most[n] + offset) - half), bits)
        least[n] = np.int32(find_cell(first, begin) + np.int32(find_cell(last, begin) << 3))


@disjoint_helper
def pack_boxes(cells, nearest, lowest, highest, boxes):
    """
    Write the boxes of a tile's cells around triangles, and update the depth range.

    There is a least and a greatest depth for each lane.
    """
    for n in range(nearest.shape[0]):
        boxes[n] = np.int32(cells[2 * n] + np.int32(cells[2 * n + 1] << 6))
        depth = nearest[n]
        lowest[n], highest[n] = min(lowest[n], depth), max(highest[n], depth)


@disjoint_helper
def find_slots(nearest, nearest_depth, buckets_per_depth, boxes):
    """Add depth bucket and part of it to the packed boxes of triangles."""
    for n in range(nearest.shape[0]):
        position = (nearest_depth - nearest[n]) * buckets_per_depth
        bucket = np.int32(position if position < BUCKET_COUNT - 1.0 else BUCKET_COUNT - 1.0)
        slot = np.int32(
            np.int32(bucket << PART_BITS) | np.int32(np.int32(n) & (PARTS_PER_BUCKET - 1))
        )
        boxes[n] = np.int32(boxes[n] | np.int32(slot << BOX_BITS))


@helper
def sort_triangles(listed, nearest, boxes, lowest, highest, order):
    """Sort triangles front to back, by depth bucket."""
    triangles, starts, bounds = order
    farthest_depth, nearest_depth = np.inf, -np.inf
    for n in range(TRIANGLES_PER_BATCH):
        farthest_depth = min(farthest_depth, lowest[n])
        nearest_depth = max(nearest_depth, highest[n])
    width = (nearest_depth - farthest_depth) * (1.0 / BUCKET_COUNT)
    is_wide = (width > 0.0) & (width < np.inf)
    buckets_per_depth = 1.0 / width if is_wide else 0.0
    for k in range(starts.shape[0]):
        starts[k] = 0
    find_slots(nearest, nearest_depth, buckets_per_depth, boxes)
    for n in range(np.uintp(listed.shape[0])):
        starts[np.uintp(boxes[n] >> BOX_BITS) + np.uintp(1)] += 1
    for k in range(starts.shape[0] - 1):
        starts[k + 1] += starts[k]
    slack = max(abs(farthest_depth), abs(nearest_depth)) * 2.0**-50
    for k in range(BUCKET_COUNT):
        bounds[k] = (
            nearest_depth - (np.float64(k) - BUCKET_SLACK) * width + slack
            if is_wide
            else nearest_depth
        )
    for n in range(np.uintp(listed.shape[0])):
        box = np.int64(boxes[n])
        slot = np.uintp(box >> BOX_BITS)
        cells = box & ((1 << BOX_BITS) - 1)
        triangles[np.uintp(starts[slot])] = np.int64(listed[n]) | cells << 32
        starts[slot] += 1


ORDER = int64[::1], int64[::1], float64[::1]
"""
Types of sorted triangles: number and box of cells; the end of each part of each bucket; a bound
on the nearest depth of each bucket.
"""


SURVEY_MEMORY = float64[:, ::1], int32[:, ::1], int32[:, ::1]
"""
Types of scratch memory: nearest depths of triangles and their boxes of cells, (1, MAX_SORTED) each;
vertices of a batch, their least and their greatest x and y, (5, 2 * TRIANGLES_PER_BATCH).
"""


def allocate_order_memory() -> tuple[tuple[NDArray[Any], ...], tuple[NDArray[Any], ...]]:
    """Allocate `ORDER` and `SURVEY_MEMORY`."""
    starts = np.zeros(BUCKET_COUNT * PARTS_PER_BUCKET + 1, np.int64)
    return (
        (np.empty(MAX_SORTED, np.int64), starts, np.empty(BUCKET_COUNT)), (np.empty((1,
        MAX_SORTED)), np.empty((1, MAX_SORTED), np.int32), np.empty((5, 2 * TRIANGLES_PER_BATCH),
        np.int32)),
    )  # fmt: skip


@kernel
def order_triangles(
    request: int64[::1], listed: int32[::1], faces: Faces, screen: ScreenVertices,
    ints: int32[:, ::1], floats: FLOAT_ROWS_TYPE, survey: SURVEY_MEMORY, order: ORDER,
):  # fmt: skip
    """
    Sort listed triangles of a tile front to back, by depth bucket.

    Parameters
    ----------
    request : (15,) int64
        As for `set_up_batch`; at most ``MAX_SORTED`` triangles.
    listed : (M,) int32
    faces, screen : records
    ints, floats : (rows, columns)
        Scratch memory: a batch.
    survey : tuple
        Scratch memory: as `SURVEY_MEMORY` says.
    order : tuple
        Written: as `ORDER` says.
    """
    count, first = request[LISTED_COUNT], request[FIRST_LISTED]
    parts = faces.faces, faces.pieces, faces.piece_faces
    lowest = part(floats, WEIGHT, 0, TRIANGLES_PER_BATCH)
    highest = part(floats, WEIGHT + 1, 0, TRIANGLES_PER_BATCH)
    for n in range(TRIANGLES_PER_BATCH):
        lowest[n], highest[n] = np.inf, -np.inf
    nearest, boxes, corners = survey
    shift = np.int32(request[SHIFT_X]), np.int32(request[SHIFT_Y])
    origin = np.int32(request[LEFT_COLUMN]), np.int32(request[TOP_ROW])
    is_distant = screen.depth.shape[0] >= MIN_PREFETCH_VERTICES
    if is_distant:
        prefetch_corners(
            listed[first : first + min(TRIANGLES_PER_BATCH, count)], parts, screen.depth, corners
        )
    for begin in range(0, count, TRIANGLES_PER_BATCH):
        batch_count = min(TRIANGLES_PER_BATCH, count - begin)
        least, most = part(corners, 3, 0, 2 * batch_count), part(corners, 4, 0, 2 * batch_count)
        batch_nearest = part(nearest, 0, begin, begin + batch_count)
        following = first + begin + batch_count
        end = min(following + TRIANGLES_PER_BATCH, first + count)
        if is_distant:
            enclose_prefetched(screen, corners, least, most, batch_nearest)
            beyond = min(end + TRIANGLES_PER_BATCH, first + count + request[PREFETCH])
            prefetch_faces(listed[end:beyond], parts)
            prefetch_corners(listed[following:end], parts, screen.depth, corners)
        else:
            enclose_listed(
                listed[following - batch_count : following], parts, screen, least, most,
                batch_nearest,
            )  # fmt: skip
        find_cells(least, most, shift, origin, request[GRID_BITS])
        pack_boxes(
            least, batch_nearest, lowest, highest, part(boxes, 0, begin, begin + batch_count)
        )
    sort_triangles(
        listed[first : first + count], part(nearest, 0, 0, count), part(boxes, 0, 0, count),
        lowest, highest, order,
    )  # fmt: skip


@kernel
def set_up_batch(
    request: int64[::1], listed: int32[::1], faces: Faces, screen: ScreenVertices,
    ints: int32[:, ::1], floats: FLOAT_ROWS_TYPE,
):  # fmt: skip
    """
    Set up the triangles of a batch; kernels that draw triangles call it by its address.

    Parameters
    ----------
    request : (15,) int64
        `FIRST_LISTED`, ...
    listed : (M,) int32
        Triangle numbers: below F a face, ``F + p`` piece p.
    faces, screen : records
    ints, floats : (rows, columns)
        Written: the batch.
    """
    count, first = request[LISTED_COUNT], request[FIRST_LISTED]
    parts = faces.faces, faces.pieces, faces.piece_faces
    gather_triangles(listed[first : first + count], parts, screen, ints, floats)
    if request[PREFETCH] > 0 and screen.depth.shape[0] >= MIN_PREFETCH_VERTICES:
        following = first + count
        end = following + request[PREFETCH]
        prefetch_triangles(listed[following:end], parts, screen.depth, request[PREFETCH])
    shift = np.int32(request[SHIFT_X]), np.int32(request[SHIFT_Y])
    window = request[LEFT_COLUMN], request[TOP_ROW], request[RIGHT_COLUMN], request[BOTTOM_ROW]
    set_up_gathered_triangles(count, window, request[GRID_BITS], shift, ints, floats)
