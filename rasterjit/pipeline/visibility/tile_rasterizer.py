"""
Rasterize tiles into the visibility buffer: coverage, depth test, depth and face number.

Every triangle of a tile's list is drawn into a depth tile and a face-number tile that stay in L1
and are written to the frame once, background included. Alpha-tested triangles go to a scratch tile
first; see ``alpha_test``.

Coverage is exact. With the interior on the positive side of all three edges a sample is inside
where ``E_k + bias_k >= 0`` (bias 0 on top and left edges, -1 on others). Stepping one pixel adds a
multiple of ``2**grid_bits``, so ``(E_k + bias_k) >> grid_bits`` has the same sign and steps by the
edge's own integer slope.

Triangles at most ``MAX_SMALL_PIXELS`` wide are tested a row of their box at a time. Inside the box
(9 pixels by 2**15 pixels on a 12-bit grid at most) the signs fit ``int32`` and the edge functions
themselves float64. Lanes beyond the box are masked: they may overflow, and end in padding columns.
Wider triangles get, for each row, the first and the last covered column from ``floor(e / s)`` of
each edge, integers below 2**47 and 2**27, several rows at once. No row divides: the floor of
``(e + 1/2) * (1 / s)`` in float64 is the same, for the exact product misses every whole number by
at least 1/(2 s), and two roundings move it by less than 2**-51 of itself, or 2**-4 / s.
Rows that the triangle does not touch inside the tile are skipped, as far as
``triangle_batches.cut_rows`` finds them; an extra row has no columns.

All of this is float64 and 32-bit integers, since x86 before AVX-512 has no vector conversion from
64-bit integers to float64. Rows of samples are explicit vectors (``intrinsics.draw_box``,
``fill_rows``), since LLVM does not vectorize such short loops. Where no row has more than one
sample, as in most slivers, a vector holds samples of several rows.

Depth is interpolated linearly on the screen, in float64, by differences from one vertex,
``d = d2 + b0 (d0 - d2) + b1 (d1 - d2)`` with exact edge functions in the weights ``b``, so equal
vertex depths give exactly that depth. Along a row of a wide triangle it steps from the first
covered sample of each 64 columns, where ``|steps * slope|`` stays below the depth's own range;
these blocks of columns are the same for every tile size up to 64. It is clamped to the range of
the vertices. Vertices are taken in a fixed order (topmost, then leftmost first, clockwise), so
neither rotation nor winding of the face changes a bit.

Hierarchical Z: the least depth of each cell of 8 by 8 samples culls triangles behind it. Long lists
are sorted first, roughly front to back by nearest depth (`draw_sorted`), and hidden triangles are
culled before setup, most of them where depth complexity is high. Where half of the triangles are
visible, sorting takes as long as it saves, so a thread goes by its recent lists (`should_sort`).
Short lists, and alpha-tested objects, are drawn as they are listed. Then cell depths are updated
each time the number of triangles drawn has doubled, and only wide triangles are tested: for small
ones the test costs as much as it saves.

The lower face number wins a tie. Lists ascend by face, so the first of equal depths stays; for
triangles in another order, face numbers are compared.

Depths are compared in the type they are stored in: rounded (float32, float64) or truncated (int32).
Both are monotonic, so that bounds on depths stay bounds afterwards.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.geometry.setup import TILE_BITS, TILE_SIZE, biased_edge_at, edge_at
from rasterjit.pipeline.geometry.triangle_batches import (
    ACROSS,
    AX,
    AY,
    BOTTOM,
    BOTTOM_ROW,
    BX,
    BY,
    CELL_BITS,
    CELLS_PER_ROW,
    COLUMN_BLOCK_BITS,
    CX,
    CY,
    DEPTH,
    DOWN,
    DRAW_END,
    DRAW_FIRST,
    EDGE,
    FACE,
    FIRST_LISTED,
    FLOAT_ROWS,
    FLOAT_ROWS_TYPE,
    GRID_BITS,
    INT_ROWS,
    IS_UNORDERED,
    LEFT,
    LEFT_COLUMN,
    LISTED_COUNT,
    MAX_SMALL_PIXELS,
    MAX_SORTED,
    ORDER,
    PARTS_PER_BUCKET,
    PREFETCH,
    RANGE,
    REQUEST_SIZE,
    RIGHT,
    RIGHT_COLUMN,
    ROW_STRIDE,
    SHIFT_X,
    SHIFT_Y,
    SIDE,
    SORTED,
    SORTED_DRAWN,
    TOP,
    TOP_ROW,
    TRIANGLES_PER_BATCH,
    WEIGHT,
    WIDE,
    allocate_order_memory,
    flat_index,
    order_triangles,
    set_up_batch,
)
from rasterjit.pipeline.records import AlphaTests, Faces, ScreenVertices, Viewport
from rasterjit.pipeline.visibility import alpha_test
from rasterjit.pipeline.visibility.alpha_test import AlphaQueue, TileAlphaTest
from rasterjit.runtime.intrinsics import (
    add_to_element_atomically,
    call_bound,
    draw_box,
    fill_rows,
    find_min_in_rows,
    flat,
)
from rasterjit.runtime.jit import Bound, disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float64, int32, int64, stored

SCRATCH_SHAPE = (TILE_SIZE, TILE_SIZE + MAX_SMALL_PIXELS)
"""Shape of a tile in scratch memory: rows are padded for groups that start in the last column."""

CORNER_ROUNDINGS = 64.0 * 2.0**-53
"""
Rounding error of two depths of a plane, relative to its range plus its largest depth.

28 roundings each (``tests/hard_cases/test_bounded.py`` counts them), and a margin.
"""

MIN_SORTED_TRIANGLES = 128
"""Fewest triangles of a tile for which sorting pays."""

MAX_HISTORY_TRIANGLES = 1 << 16
"""Most sorted triangles in a thread's statistics of how many were visible."""

RETRY_BITS = 4
"""One in 2**4 unsorted triangles counts as sorted and hidden, so that sorting is retried."""

NOTHING = -1
"""Face number of a sample that no face covers."""


@helper
def edges_at(a, b, c, column, row, grid_bits):
    """Return three edges as (biased value at a pixel, step to the next column, to the next row)."""
    return (
        (biased_edge_at(b[0], b[1], c[0], c[1], column, row, grid_bits), b[1] - c[1], c[0] - b[0]),
        (biased_edge_at(c[0], c[1], a[0], a[1], column, row, grid_bits), c[1] - a[1], a[0] - c[0]),
        (biased_edge_at(a[0], a[1], b[0], b[1], column, row, grid_bits), a[1] - b[1], b[0] - a[0]),
    )


@helper
def prepare_crossing(edge):
    """
    Return an edge as (value + 1/2, step down, columns per unit of value, side).

    The edge crosses a row at ``value * columns``; side is 1 if the inside is to the right. A
    horizontal edge crosses beyond the block of columns, on the side given by its sign.
    """
    value, across, down = edge
    columns = 1.0 / np.float64(abs(across)) if across != 0 else np.float64(2 << COLUMN_BLOCK_BITS)
    return np.float64(value) + 0.5, np.float64(down), columns, np.int64(across > 0)


@helper
def bound_span(first, last, line, row):
    """Narrow a row's first and last column, float64, to the inside of one edge."""
    value, down, columns, begins = line
    crossing = np.floor((value + row * down) * columns)
    return (
        max(first, -crossing) if begins else first,
        last if begins else min(last, crossing),
    )


@disjoint_helper
def find_spans(begins, ends, depths, lanes, lines, columns, inside_bc, inside_ca, plane):
    """
    Write, row by row, the first covered column, one past the last, and the depth at the first.

    Returns the most samples of a row. Takes three edges from `prepare_crossing`, and two from
    `prepare_inside` at the corner of the box. The columns are exact: see the notes above.
    """
    longest, width = np.int32(0), np.float64(columns)
    for i in range(lanes):
        row = np.float64(np.int32(i))
        first, last = 0.0, width - 1.0
        first, last = bound_span(first, last, lines[0], row)
        first, last = bound_span(first, last, lines[1], row)
        first, last = bound_span(first, last, lines[2], row)
        first = min(first, width)
        begins[i], ends[i] = np.int32(first), np.int32(max(last, -1.0)) + np.int32(1)
        longest = max(longest, np.int32(ends[i] - begins[i]))
        depths[i] = evaluate_depth(
            plane, evaluate_inside(inside_bc, first, row), evaluate_inside(inside_ca, first, row)
        )
    return np.int64(longest)


@helper
def prepare_inside(ax, ay, bx, by, left, top, grid_bits):
    """
    Return an edge function at a pixel in units of 2**grid_bits, the remainder, and its steps.

    All are float64. Steps are whole such units, below 2**45, so that sums are exact, and
    `evaluate_inside` rounds once.
    """
    value = edge_at(ax, ay, bx, by, left, top, grid_bits)
    whole = value >> grid_bits
    return (
        np.float64(whole), np.float64(ay - by), np.float64(bx - ax),
        np.float64(np.int64(1) << grid_bits), np.float64(value - (whole << grid_bits)),
    )  # fmt: skip


@helper
def evaluate_inside(line, column, row):
    """Evaluate an edge from `prepare_inside` at an offset of columns and rows, rounded once."""
    return (line[0] + column * line[1] + row * line[2]) * line[3] + line[4]


@helper
def evaluate_depth(plane, edge_bc, edge_ca):
    """Return the depth where two edge functions have the given exact values."""
    return plane[0] + (np.float64(edge_bc) * plane[1] + np.float64(edge_ca) * plane[2])


@helper
def bound_depths(plane, a, b, c, box, grid_bits):
    """
    Return bounds on the depths of a box of samples, before they are stored.

    A plane has its extremes at corners of the box. A bound on rounding is added.
    """
    lowest, highest = np.inf, -np.inf
    for row in (box[1], box[3]):
        for column in (box[0], box[2]):
            depth = evaluate_depth(
                plane,
                edge_at(b[0], b[1], c[0], c[1], column, row, grid_bits),
                edge_at(c[0], c[1], a[0], a[1], column, row, grid_bits),
            )
            lowest, highest = min(lowest, depth), max(highest, depth)
    slack = CORNER_ROUNDINGS * (plane[5] - plane[4] + max(abs(plane[4]), abs(plane[5])))
    return clamp_depth(lowest - slack, plane), clamp_depth(highest + slack, plane)


@helper
def clamp_depth(depth, plane):
    """Return the depth clamped to the range of the vertices."""
    depth = plane[4] if depth < plane[4] else depth
    return plane[5] if depth > plane[5] else depth


@helper
def draw_small(n, ints, floats, plane, origin, tile, is_unordered):
    """Rasterize a small triangle: test the samples of its box, row by row."""
    left, top = np.int64(ints[flat_index(LEFT, n)]), np.int64(ints[flat_index(TOP, n)])
    first = (top - origin[1]) * SCRATCH_SHAPE[1] + left - origin[0]
    rows = np.int64(ints[flat_index(BOTTOM, n)]) - top + 1
    columns = np.int32(ints[flat_index(RIGHT, n)] - left + 1)
    ax, ay, bx, by = (
        ints[flat_index(AX, n)], ints[flat_index(AY, n)], ints[flat_index(BX, n)],
        ints[flat_index(BY, n)],
    )  # fmt: skip
    cx, cy = ints[flat_index(CX, n)], ints[flat_index(CY, n)]
    edges = (
        ints[flat_index(SIDE, n)], ints[flat_index(SIDE + 1, n)], ints[flat_index(SIDE + 2, n)],
        np.int32(by - cy), np.int32(cy - ay), np.int32(ay - by),
        np.int32(cx - bx), np.int32(ax - cx), np.int32(bx - ax),
    )  # fmt: skip
    depth = (
        floats[flat_index(EDGE, n)], floats[flat_index(EDGE + 1, n)], floats[flat_index(ACROSS, n)],
        floats[flat_index(ACROSS + 1, n)], floats[flat_index(DOWN, n)],
        floats[flat_index(DOWN + 1, n)], plane[0], plane[1], plane[2], plane[4], plane[5],
    )  # fmt: skip
    draw_box(
        tile[0], tile[1], first, np.int64(SCRATCH_SHAPE[1]), rows, columns, edges, depth,
        np.int32(ints[flat_index(FACE, n)]), is_unordered,
    )  # fmt: skip


@helper
def draw_spans(a, b, c, plane, box, face, origin, grid_bits, tile, spans, is_unordered):
    """Rasterize a wide triangle: find the covered span of each row, and fill it."""
    ax, ay, bx, by, cx, cy = a[0], a[1], b[0], b[1], c[0], c[1]
    left, top, right, bottom = box
    columns, rows = right - left + 1, bottom - top + 1
    if rows <= 0:
        return
    edges = edges_at(a, b, c, left, top, grid_bits)
    lines = (prepare_crossing(edges[0]), prepare_crossing(edges[1]), prepare_crossing(edges[2]))
    inside_bc = prepare_inside(bx, by, cx, cy, left, top, grid_bits)
    inside_ca = prepare_inside(cx, cy, ax, ay, left, top, grid_bits)
    # Whole groups of rows: results beyond the last are not read.
    lanes = ((rows - 1) | 7) + 1
    longest = find_spans(
        spans[0], spans[1], spans[2], lanes, lines, columns, inside_bc, inside_ca, plane
    )
    before = np.int32(origin[0] - left)
    first = (top - origin[1]) * SCRATCH_SHAPE[1] - np.int64(before)
    fill_rows(
        tile[0], tile[1], spans, first, np.int64(SCRATCH_SHAPE[1]), rows, before, longest,
        (plane[3], plane[4], plane[5]), face, is_unordered,
    )  # fmt: skip


@helper
def find_hidden_depth(n, ints, origin, cells):
    """Return the least depth of the cells that a triangle's box touches; all below is hidden."""
    left = max(np.int64(ints[flat_index(LEFT, n)]) - origin[0], np.int64(0)) >> CELL_BITS
    right = (np.int64(ints[flat_index(RIGHT, n)]) - origin[0]) >> CELL_BITS
    top = (np.int64(ints[flat_index(TOP, n)]) - origin[1]) >> CELL_BITS
    bottom = (np.int64(ints[flat_index(BOTTOM, n)]) - origin[1]) >> CELL_BITS
    return find_min_in_rows(
        cells, top * CELLS_PER_ROW, np.int64(CELLS_PER_ROW), bottom + 1 - top, np.int32(left),
        np.int32(right),
    )  # fmt: skip


@helper
def draw_triangle(n, ints, floats, origin, bits, tile_depth, cells, tile, spans, is_unordered):
    """
    Draw one triangle of a batch into a tile whose first pixel is ``origin`` (column, row).

    Culled below the tile depth; if wide, also below the depths of its cells.
    """
    lowest, highest = floats[flat_index(RANGE, n)], floats[flat_index(RANGE + 1, n)]
    if tile[0].dtype.type(highest) < tile_depth:
        return
    weight_a, weight_b = floats[flat_index(WEIGHT, n)], floats[flat_index(WEIGHT + 1, n)]
    step = floats[flat_index(ACROSS, n)] * weight_a + floats[flat_index(ACROSS + 1, n)] * weight_b
    plane = floats[flat_index(DEPTH + 2, n)], weight_a, weight_b, step, lowest, highest
    if not ints[flat_index(WIDE, n)]:
        draw_small(n, ints, floats, plane, origin, tile, is_unordered)
        return
    hidden = find_hidden_depth(n, ints, origin, cells)
    if tile[0].dtype.type(highest) < hidden:
        return
    a = (np.int64(ints[flat_index(AX, n)]), np.int64(ints[flat_index(AY, n)]))
    b = (np.int64(ints[flat_index(BX, n)]), np.int64(ints[flat_index(BY, n)]))
    c = (np.int64(ints[flat_index(CX, n)]), np.int64(ints[flat_index(CY, n)]))
    box = (
        np.int64(ints[flat_index(LEFT, n)]), np.int64(ints[flat_index(TOP, n)]),
        np.int64(ints[flat_index(RIGHT, n)]), np.int64(ints[flat_index(BOTTOM, n)]),
    )  # fmt: skip
    if tile[0].dtype.type(lowest) < hidden:
        _, nearest = bound_depths(plane, a, b, c, box, bits)
        if tile[0].dtype.type(nearest) < hidden:
            return
    face = np.int32(ints[flat_index(FACE, n)])
    draw_spans(a, b, c, plane, box, face, origin, bits, tile, spans, is_unordered)


SPAN_MEMORY = int32[::1], int32[::1], float64[::1]
"""Types of the scratch memory for the rows of a triangle."""


@kernel
def draw_batch(
    request: int64[::1], cell_depths: stored[:, ::1], depths: stored[:, ::1],
    numbers: int32[:, ::1], ints: int32[:, ::1], floats: FLOAT_ROWS_TYPE, spans: SPAN_MEMORY,
):  # fmt: skip
    """
    Draw triangles of a batch, one after the other, into a tile.

    Parameters
    ----------
    request : (15,) int64
        As ``triangle_batches`` numbers its elements: which triangles, the tile's first pixel, bits.
    cell_depths : (8, 8), stored depth
        For each cell of the tile, the depth below which nothing is visible.
    depths, numbers : (rows, columns)
        The tile; changed.
    ints, floats : (rows, columns)
        The batch, from ``triangle_batches.set_up_batch``.
    spans : tuple
        Scratch memory.
    """
    tile, origin = (flat(depths), flat(numbers)), (request[LEFT_COLUMN], request[TOP_ROW])
    bits, cells, is_unordered = request[GRID_BITS], flat(cell_depths), request[IS_UNORDERED] != 0
    tile_depth = find_min_in_rows(
        cells, np.int64(0), np.int64(CELLS_PER_ROW), np.int64(CELLS_PER_ROW), np.int32(0),
        np.int32(CELLS_PER_ROW - 1),
    )  # fmt: skip
    for n in range(np.uintp(request[DRAW_FIRST]), np.uintp(request[DRAW_END])):
        draw_triangle(
            n, flat(ints), flat(floats), origin, bits, tile_depth, cells, tile, spans, is_unordered
        )


@helper
def get_tile_window(number, columns, viewport):
    """Return the first column and row of a tile, and the last ones inside the image."""
    left, top = (number % columns) << TILE_BITS, (number // columns) << TILE_BITS
    return (
        left,
        top,
        min(left + TILE_SIZE, np.int64(viewport.width)) - 1,
        min(top + TILE_SIZE, np.int64(viewport.height)) - 1,
    )


class TileDrawing(NamedTuple):
    """
    Arguments by which a kernel draws listed triangles.

    Other kernels are called by address (``jit.Bound``), so they are compiled once for all callers.
    """

    request: int64[::1]
    """(15,): as ``triangle_batches`` numbers its elements."""
    cell_depths: stored[:, ::1]
    """(8, 8): for each cell of the tile, the depth below which nothing is visible."""
    set_up: int64[::1]
    """(2,): how to call ``triangle_batches.set_up_batch``."""
    tile: int64[::1]
    """(2,): how to call `draw_batch` for the frame's tile."""
    scratch_tile: int64[::1]
    """(2,): the same for the scratch tile of alpha-tested triangles, if there are any."""
    sort: int64[::1]
    """(2,): how to call ``triangle_batches.order_triangles``."""
    set_up_sorted: int64[::1]
    """(2,): how to call ``triangle_batches.set_up_batch`` for sorted triangles."""
    order: ORDER
    """Sorted triangles."""
    cells: (int64[::1], int64[::1])
    """From `make_cell_masks`."""
    queue: int32[::1]
    """(192,): the next triangles to draw."""


@helper
def begin_tile(drawing, window, bits, shift, tile_depth):
    """Store a tile's window, the offset added to vertices, and the tile depth."""
    request = drawing.request
    request[LEFT_COLUMN], request[TOP_ROW], request[RIGHT_COLUMN], request[BOTTOM_ROW] = window
    request[GRID_BITS], request[SHIFT_X], request[SHIFT_Y] = bits, shift[0], shift[1]
    cells = flat(drawing.cell_depths)
    for n in range(cells.shape[0]):
        cells[n] = tile_depth


@helper
def set_up_listed(drawing, first, count):
    """Set up a batch of listed triangles."""
    drawing.request[FIRST_LISTED], drawing.request[LISTED_COUNT] = first, count
    call_bound(drawing.set_up)


@helper
def draw_range(drawing, words, first, end):
    """Draw triangles ``first`` to ``end`` of the current batch into the tile bound to ``words``."""
    drawing.request[DRAW_FIRST], drawing.request[DRAW_END] = first, end
    call_bound(words)


@helper
def draw_listed(first, count, ints, drawing, alpha_queue):
    """Draw a batch of listed triangles in order, with alpha test."""
    set_up_listed(drawing, first, count)
    if alpha_queue.cutoffs.shape[0] == 0:
        draw_range(drawing, drawing.tile, 0, count)
        return
    request = drawing.request
    origin, shift = (request[LEFT_COLUMN], request[TOP_ROW]), (request[SHIFT_X], request[SHIFT_Y])
    alpha_test.begin_batch(alpha_queue, count, origin, shift)
    owner = np.int64(0)
    for n in range(np.uintp(count)):
        owner, is_tested = alpha_test.find_owner(ints[FACE, n], owner, alpha_queue)
        draw_range(drawing, drawing.scratch_tile if is_tested else drawing.tile, n, n + np.uintp(1))
        if is_tested:
            alpha_test.queue_from_scratch(n, owner, alpha_queue)


@helper
def raise_cell_depths(depths, cell_depths, drawn):
    """Raise the depths of cells that were drawn to, to the least of their samples."""
    samples, stride = flat(depths), np.int64(SCRATCH_SHAPE[1])
    for row in range(CELLS_PER_ROW):
        for column in range(CELLS_PER_ROW):
            if drawn >> (row * CELLS_PER_ROW + column) & 1 == 0:
                continue
            first = (row * stride + column) << CELL_BITS
            least = find_min_in_rows(
                samples, first, stride, np.int64(1 << CELL_BITS), np.int32(0),
                np.int32((1 << CELL_BITS) - 1),
            )  # fmt: skip
            cell_depths[row, column] = max(cell_depths[row, column], least)


@helper
def mask_open_cells(nearest, cell_depths):
    """Return a bit mask of the cells in which a triangle of a nearest depth may be visible."""
    depths, mask = flat(cell_depths), np.int64(0)
    for n in range(depths.shape[0]):
        is_hidden = depths.dtype.type(nearest) < depths[n]
        mask |= np.int64(not is_hidden) << n
    return mask


@helper
def queue_visible(order, first, end, mask, tables, queue, count):
    """
    Append the triangles that touch cells of a mask to ``queue``.

    Returns how many ``queue`` holds, and the cells that any of them touches.
    """
    (of_columns, of_rows), touched = tables, np.int64(0)
    for n in range(np.uintp(first), np.uintp(end)):
        entry = order[n]
        box = np.uintp(entry >> 32)
        cells = of_columns[box & np.uintp(63)] & of_rows[box >> np.uintp(6)]
        queue[np.uintp(count)] = np.int32(entry & 0x7FFFFFFF)
        visible = cells & mask
        count += np.int64(visible != 0)
        touched |= visible
    return count, touched


@helper
def draw_queued(drawing, first, count):
    """Set up and draw sorted triangles."""
    drawing.request[FIRST_LISTED], drawing.request[LISTED_COUNT] = first, count
    call_bound(drawing.set_up_sorted)
    draw_range(drawing, drawing.tile, 0, count)


@helper
def draw_sorted(first, count, scratch, drawing):
    """Draw listed triangles front to back, culling hidden ones."""
    drawing.request[FIRST_LISTED], drawing.request[LISTED_COUNT] = first, count
    call_bound(drawing.sort)
    drawing.request[PREFETCH], drawing.request[IS_UNORDERED] = 0, 1
    order, ends, bounds = drawing.order
    queue, queued, begin, touched = drawing.queue, np.int64(0), np.int64(0), np.int64(0)
    bucket = 0
    while begin < count:
        while ends[(bucket + 1) * PARTS_PER_BUCKET - 1] <= begin:
            bucket += 1
        mask = mask_open_cells(bounds[bucket], drawing.cell_depths)
        stop = min(begin + 2 * TRIANGLES_PER_BATCH, ends[(bucket + 1) * PARTS_PER_BUCKET - 1])
        queued, cells = queue_visible(order, begin, stop, mask, drawing.cells, queue, queued)
        touched |= cells
        begin = stop
        drawn, least = np.int64(0), np.int64(TRIANGLES_PER_BATCH if begin < count else 1)
        while queued - drawn >= least:
            batch = min(np.int64(TRIANGLES_PER_BATCH), queued - drawn)
            draw_queued(drawing, drawn, batch)
            drawn += batch
        if drawn > 0:
            for n in range(queued - drawn):
                queue[n] = queue[drawn + n]
            queued -= drawn
            drawing.request[SORTED_DRAWN] += drawn
            raise_cell_depths(scratch[0], drawing.cell_depths, touched)
            touched = cells
    drawing.request[IS_UNORDERED] = 0
    drawing.request[SORTED] += count


@cache
def make_cell_masks() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return bit masks of a tile's cells by range of columns, and of rows, at 8 * last + first."""
    columns = np.zeros(CELLS_PER_ROW * CELLS_PER_ROW, np.int64)
    rows = np.zeros(CELLS_PER_ROW * CELLS_PER_ROW, np.int64)
    for last in range(CELLS_PER_ROW):
        for first in range(last + 1):
            is_in = np.zeros((CELLS_PER_ROW, CELLS_PER_ROW), bool)
            is_in[first : last + 1] = True
            for table, cells in ((rows, is_in), (columns, is_in.T)):
                table[last * CELLS_PER_ROW + first] = np.packbits(cells, bitorder="little").view(
                    np.int64
                )[0]
    return columns, rows


@helper
def should_sort(request, count):
    """
    Return whether to sort a list of triangles.

    True while half of the recently sorted triangles were hidden; else retried now and then.
    """
    if count < MIN_SORTED_TRIANGLES:
        return False
    if request[SORTED] > MAX_HISTORY_TRIANGLES:
        request[SORTED] >>= 1
        request[SORTED_DRAWN] >>= 1
    if 2 * request[SORTED_DRAWN] <= request[SORTED]:
        return True
    request[SORTED] += count >> RETRY_BITS
    return False


@helper
def draw_list(first, end, scratch, drawing, alpha_queue):
    """Draw listed triangles ``first`` to ``end`` into the thread's tile, with alpha test."""
    if alpha_queue.cutoffs.shape[0] == 0 and should_sort(drawing.request, end - first):
        for begin in range(first, end, MAX_SORTED):
            count = min(MAX_SORTED, end - begin)
            drawing.request[PREFETCH] = min(2 * TRIANGLES_PER_BATCH, end - begin - count)
            draw_sorted(begin, count, scratch, drawing)
        return
    raised = first + TRIANGLES_PER_BATCH
    for begin in range(first, end, TRIANGLES_PER_BATCH):
        if begin == raised:
            raise_cell_depths(scratch[0], drawing.cell_depths, np.int64(-1))
            raised += raised - first
        count = min(TRIANGLES_PER_BATCH, end - begin)
        drawing.request[PREFETCH] = min(2 * TRIANGLES_PER_BATCH, end - begin - count)
        draw_listed(begin, count, scratch[2], drawing, alpha_queue)


@helper
def clear_tile(depths, numbers, empty):
    """Mark every sample of a tile as empty."""
    for row in range(depths.shape[0]):
        for column in range(depths.shape[1]):
            depths[row, column] = empty
            numbers[row, column] = NOTHING


@helper
def clear_frame_tile(frame, window, empty):
    """Clear the window of a tile in the frame."""
    depth, face_id = frame
    for row in range(window[1], window[3] + 1):
        depths = depth[row, window[0] : window[2] + 1]
        numbers = face_id[row, window[0] : window[2] + 1]
        for column in range(depths.shape[0]):
            depths[column] = empty
        for column in range(numbers.shape[0]):
            numbers[column] = NOTHING


@cache
def get_empty_depth(depth_type: Any) -> Any:
    """Return the depth of empty samples, for a type of depths: below every stored one."""
    kind = np.dtype(depth_type)
    return kind.type(-1 if kind.kind == "i" else -np.inf)


EMPTY_DEPTH_INDEX = 7
"""Index of the depth of empty samples in the scratch memory."""


def allocate_scratch(depth_type: Any = np.float32) -> tuple[Any, ...]:
    """
    Allocate a thread's memory for rasterizing: a tile, and a batch.

    Depths are stored in the given type: float32, float64 or int32.
    """
    return (
        np.empty(SCRATCH_SHAPE, depth_type), np.empty(SCRATCH_SHAPE, np.int32),
        np.empty((INT_ROWS, ROW_STRIDE), np.int32), np.empty((FLOAT_ROWS, ROW_STRIDE), np.float64),
        np.empty(TILE_SIZE, np.int32), np.empty(TILE_SIZE, np.int32),
        np.empty(TILE_SIZE, np.float64), np.full(1, get_empty_depth(depth_type)),
    )  # fmt: skip


SCRATCH = (
    stored[:, ::1], int32[:, ::1], int32[:, ::1], FLOAT_ROWS_TYPE, *SPAN_MEMORY, stored[::1],
)  # fmt: skip
"""The types of `allocate_scratch`."""


class TileDrawer(NamedTuple):
    """A thread's state for rasterizing a tile; keep it alive while kernels hold its addresses."""

    scratch: tuple[Any, ...]
    """From `allocate_scratch`."""
    drawing: TileDrawing
    alpha_queue: AlphaQueue
    keep_alive: tuple[Any, ...]
    """Owners of the memory behind the addresses."""


class TileMemory(NamedTuple):
    """The memory of a `TileDrawer`; its former contents do not affect pictures."""

    scratch: tuple[Any, ...]
    """From `allocate_scratch`."""
    request: NDArray[np.int64]
    cell_depths: NDArray[Any]
    order: tuple[Any, ...]
    """From ``triangle_batches.allocate_order_memory``."""
    queue: NDArray[np.int32]


def allocate_tile_memory(depth_type: Any = np.float32) -> TileMemory:
    """Allocate the memory of a `TileDrawer`, for stored depths of a type."""
    return TileMemory(
        allocate_scratch(depth_type), np.zeros(REQUEST_SIZE, np.int64),
        np.empty((CELLS_PER_ROW, CELLS_PER_ROW), depth_type), allocate_order_memory(),
        np.empty(3 * TRIANGLES_PER_BATCH, np.int32),
    )  # fmt: skip


def make_tile_drawer(
    listed: NDArray[np.int32],
    faces: Faces,
    screen: ScreenVertices,
    depth_type: Any = np.float32,
    alpha_tests: AlphaTests | None = None,
    memory: TileMemory | None = None,
) -> TileDrawer:
    """
    Make a thread's state for rasterizing a tile.

    Parameters
    ----------
    listed : (M,) int32
        Triangle numbers: below F a face, ``F + p`` piece p.
    faces, screen : records
    depth_type : dtype
        The type in which depths are stored: float32, float64 or int32.
    alpha_tests : AlphaTests or None
        None: no object is alpha-tested.
    memory : TileMemory or None
        From `allocate_tile_memory` for the same type, for this thread alone; None: allocated here.
    """
    scratch, request, cell_depths, (order, survey), queue = memory or allocate_tile_memory(
        depth_type
    )
    test = TileAlphaTest(alpha_tests, scratch[:2], scratch[EMPTY_DEPTH_INDEX], scratch[2])
    set_up = Bound(set_up_batch, request, listed, faces, screen, *scratch[2:4])
    tile = scratch_tile = bind_drawing(scratch[:2], request, cell_depths, scratch)
    if alpha_tests is not None:
        scratch_tile = bind_drawing(
            (test.alpha_queue.depth, test.alpha_queue.numbers), request, cell_depths, scratch
        )
    sort = Bound(order_triangles, request, listed, faces, screen, *scratch[2:4], survey, order)
    queued = Bound(set_up_batch, request, queue, faces, screen, *scratch[2:4])
    drawing = TileDrawing(
        request, cell_depths, set_up.words, tile.words, scratch_tile.words, sort.words,
        queued.words, order, make_cell_masks(), queue,
    )  # fmt: skip
    return TileDrawer(
        scratch, drawing, test.alpha_queue, (test, set_up, tile, scratch_tile, sort, queued)
    )


def bind_drawing(
    tile: tuple[Any, ...],
    request: NDArray[np.int64],
    cell_depths: NDArray[Any],
    scratch: tuple[Any, ...],
) -> Bound:
    """Bind `draw_batch` to a tile."""
    return Bound(
        draw_batch, request, cell_depths, *tile, *scratch[2:4], scratch[4:EMPTY_DEPTH_INDEX]
    )


NO_COUNTER = np.empty(0, np.int64)
"""Replaces the shared counter of tiles where one thread draws all."""


@helper
def claim_tiles(counter, count):
    """Claim the next tiles from the shared counter; return the first, and one past the last."""
    if counter.shape[0] == 0:
        return np.int64(0), np.int64(0)
    first = min(add_to_element_atomically(counter, 0, counter[1]), np.int64(count))
    return first, min(first + counter[1], np.int64(count))


@kernel
def draw_tiles(
    tiles: int32[::1], counter: int64[::1], starts: int64[::1], tile_depths: stored[::1],
    viewport: Viewport, frame: (stored[:, ::1], int32[:, ::1]), scratch: SCRATCH,
    drawing: TileDrawing, alpha_queue: AlphaQueue,
):  # fmt: skip
    """
    Draw some of the frame's tiles.

    Parameters
    ----------
    tiles : (N,) int32
        Tile numbers, row by row.
    counter : (2,) int64, or (0,)
        Number of tiles that threads have claimed, changed, and how many each claims at a time;
        `NO_COUNTER`: all are for this thread.
    starts : (tiles + 1,) int64
        Tile ``k`` draws triangles ``starts[k]:starts[k + 1]`` of the drawer's list, which ascend.
    tile_depths : (tiles,) float32, float64 or int32, stored depth
        Triangles below it are skipped in a tile; `get_empty_depth` skips none.
    viewport : Viewport
    frame : (depth (H, W) of the same type, face_id (H, W) int32)
        Writes every pixel of the tiles: stored depth (greater is nearer, `get_empty_depth` where
        nothing is) and face number (-1 where nothing is). W = 0: not written.
    scratch, drawing, alpha_queue
        From this thread's `make_tile_drawer`; ``alpha_test.make_empty_queue`` tests nothing.

    Returns
    -------
    int
        Number of covered pixels; 0 if ``face_id`` is not written.
    """
    depth, face_id = frame
    depths, numbers, empty = scratch[0], scratch[1], scratch[EMPTY_DEPTH_INDEX][0]
    columns = (np.int64(viewport.width) + TILE_SIZE - 1) >> TILE_BITS
    n, stop = np.int64(0), np.int64(0 if counter.shape[0] else tiles.shape[0])
    covered = np.int64(0)
    while True:
        if n == stop:
            n, stop = claim_tiles(counter, tiles.shape[0])
            if n == stop:
                return covered
        number = np.int64(tiles[n])
        n += 1
        window = get_tile_window(number, columns, viewport)
        first, end = starts[number], starts[number + 1]
        if first == end:
            clear_frame_tile(frame, window, empty)
            continue
        clear_tile(depths, numbers, empty)
        begin_tile(drawing, window, viewport.grid_bits, (0, 0), tile_depths[number])
        draw_list(first, end, scratch, drawing, alpha_queue)
        # Write the tile to the frame.
        left, top = window[0], window[1]
        width = window[2] + 1 - left
        for row in range(window[3] + 1 - top):
            frame_depth = depth[top + row, left : left + width]
            frame_numbers = face_id[top + row, left : left + width]
            for column in range(frame_depth.shape[0]):
                frame_depth[column] = depths[row, column]
            row_covered = np.int32(0)
            for column in range(frame_numbers.shape[0]):
                face = numbers[row, column]
                frame_numbers[column] = face
                row_covered += np.int32(face != NOTHING)
            covered += row_covered
