"""
Find the nearest face at every sample: coverage, depth test, depth and face number.

For each tile, every triangle of its list is drawn into two small squares that stay in L1 (depth,
face number), which are written to the frame once, background included.

Coverage is exact. With the interior on the positive side of all three edges a sample is inside
where ``E_k + bias_k >= 0`` (bias 0 on top and left edges, -1 on others). Stepping one pixel adds a
multiple of ``2**grid_bits``, so ``(E_k + bias_k) >> grid_bits`` has the same sign and steps by the
edge's own integer slope.

Triangles at most ``SMALL_PIXELS`` wide are tested four samples of a row at once, in float64. Their
edge functions there stay below 2**44 (16 pixels by 2**15 pixels on a 12-bit grid, twice), so
float64 holds them exactly. Samples tested beyond the tile land in spare columns that nobody reads.
Wider triangles get, for each row, the first and the last covered column from where the edges cross
it: ``floor(e / s)``, found by one division for each edge at the first row (of integers below 2**47
it is exact in float64, for a quotient that is not whole misses the next whole number by at least
1/s, more than half an ulp), and from there by adding quotient and remainder of the edge's step, as
Bresenham does.

Depth is interpolated linearly on the screen, in float64, by differences from one vertex,
``d = d2 + b0 (d0 - d2) + b1 (d1 - d2)`` with exact edge functions in the weights ``b``, so equal
vertex depths give exactly that depth. Along a row of a wide triangle it steps from the first
covered sample of each 64 columns, where ``|steps * slope|`` stays below the depth's own range;
these blocks of columns are the same for every tile size up to 64. It is held inside the range of
the vertices. Vertices are taken in a
fixed order (topmost, then leftmost first, clockwise), so neither rotation nor winding of the face
changes a bit.

A sample keeps the first of equal depths. Lists ascend by face: the lower face number wins a tie.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import disjoint_stage, kernel, stage
from rasterjit.kernels.records import Faces, ScreenVertices, Viewport
from rasterjit.kernels.setup import (
    TILE_BITS,
    TILE_SIZE,
    edge,
    edge_at,
    edge_bias,
    first_sample,
    last_sample,
    sign_at,
    triangle_of,
)

SMALL_PIXELS = 8
"""Triangles with a bounding box up to this many pixels wide are tested sample by sample."""

BLOCK_BITS = 6
"""Depth along a row starts anew every 2**6 = 64 columns; tiles are no wider."""

SCRATCH_SHAPE = (TILE_SIZE, TILE_SIZE + SMALL_PIXELS)
"""A tile in scratch memory: its rows have room for groups that start in the last column."""

CORNER_ROUNDINGS = 64.0 * 2.0**-53
"""
What two depths of a plane may be off by, in units of its range and its largest depth together.

28 roundings each (``tests/hard_cases/test_bounded.py`` counts them), and some to spare.
"""

NOTHING = -1
"""Face number of a sample that no face covers."""


@stage
def clockwise_from_top(corners, screen):
    """
    Return the vertex numbers clockwise on the screen, starting at the topmost, then leftmost.

    The order depends on the geometry alone, so that every spelling of a face is drawn alike.
    """
    a, b, c = corners
    ax, ay = np.int64(screen.xy[a, 0]), np.int64(screen.xy[a, 1])
    bx, by = np.int64(screen.xy[b, 0]), np.int64(screen.xy[b, 1])
    cx, cy = np.int64(screen.xy[c, 0]), np.int64(screen.xy[c, 1])
    if edge(ax, ay, bx, by, cx, cy) < 0:
        b, c = c, b
        bx, by, cx, cy = cx, cy, bx, by
    if (by < ay or (by == ay and bx < ax)) and (by < cy or (by == cy and bx < cx)):
        a, b, c = b, c, a
    elif (cy < ay or (cy == ay and cx < ax)) and (cy < by or (cy == by and cx < bx)):
        a, b, c = c, a, b
    return a, b, c


@stage
def edge_crossing(value, across, down):
    """
    Return where an edge crosses a row, and how that changes from one row to the next.

    With ``a = |across|`` that is ``(floor(value / a), value mod a, floor(down / a), down mod a,
    a)``. An edge along the row has ``a = 1`` and crosses far beyond the block on the side that
    its sign tells.
    """
    if across == 0:
        beyond = np.int64(2) << BLOCK_BITS
        return value * beyond + (beyond - 1), np.int64(0), down * beyond, np.int64(0), np.int64(1)
    a = abs(across)
    whole = np.int64(np.floor(np.float64(value) / np.float64(a)))
    step = np.int64(np.floor(np.float64(down) / np.float64(a)))
    return whole, value - whole * a, step, down - step * a, a


@stage
def next_crossing(crossing):
    """Return where the edge crosses the next row: a carry, no division."""
    whole, rest, step, rest_step, a = crossing
    rest += rest_step
    carry = np.int64(rest >= a)
    return whole + step + carry, rest - carry * a, step, rest_step, a


@stage
def first_inside(crossing, across, first):
    """Return the first column at or after ``first`` on the inside of an edge."""
    return max(first, -crossing[0]) if across > 0 else first


@stage
def last_inside(crossing, across, last):
    """Return the last column at or before ``last`` on the inside of an edge."""
    return last if across > 0 else min(last, crossing[0])


@stage
def worst(value, across, down, columns, rows):
    """Return the least value of an edge over a block of samples."""
    return value + min(across * (columns - 1), np.int64(0)) + min(down * (rows - 1), np.int64(0))


@stage
def depth_plane(da, db, dc, ax, ay, bx, by, cx, cy, grid_bits):
    """Return (depth of c, weights of E_bc and E_ca, step per column, lowest, highest depth)."""
    area = np.float64(edge(ax, ay, bx, by, cx, cy))
    weight_a, weight_b = (da - dc) / area, (db - dc) / area
    unit = np.float64(np.int64(1) << grid_bits)
    step = unit * (np.float64(by - cy) * weight_a + np.float64(cy - ay) * weight_b)
    return dc, weight_a, weight_b, step, min(da, min(db, dc)), max(da, max(db, dc))


@stage
def depth_from(plane, edge_bc, edge_ca):
    """Return the depth where two edge functions have the given exact values."""
    return plane[0] + (np.float64(edge_bc) * plane[1] + np.float64(edge_ca) * plane[2])


@stage
def depth_at_corners(plane, a, b, c, box, grid_bits):
    """
    Return the lowest and the highest depth that may be stored in a box of samples.

    A plane has them at corners of the box; what rounding may add is added.
    """
    lowest, highest = np.inf, -np.inf
    for row in (box[1], box[3]):
        for column in (box[0], box[2]):
            depth = depth_from(
                plane,
                edge_at(b[0], b[1], c[0], c[1], column, row, grid_bits),
                edge_at(c[0], c[1], a[0], a[1], column, row, grid_bits),
            )
            lowest, highest = min(lowest, depth), max(highest, depth)
    slack = CORNER_ROUNDINGS * (plane[5] - plane[4] + max(abs(plane[4]), abs(plane[5])))
    return held(lowest - slack, plane), held(highest + slack, plane)


@stage
def held(depth, plane):
    """Return the depth as it is stored, inside the range of the vertices."""
    depth = plane[4] if depth < plane[4] else depth
    depth = plane[5] if depth > plane[5] else depth
    return np.float32(depth)


@stage
def fill_span(depths, numbers, depth, steps, plane, face):
    """Depth-test one row of samples, which starts ``steps`` right of where the depth was taken."""
    for i in range(depths.shape[0]):
        stored = held(depth + np.float64(np.int32(np.int32(i) + steps)) * plane[3], plane)
        if stored > depths[i]:
            depths[i] = stored
            numbers[i] = face


@disjoint_stage
def test_row(depths, numbers, values, steps, thresholds, plane, face):
    """Test one row of samples against the three edges and the depth; without branches."""
    for i in range(depths.shape[0]):
        column = np.float64(np.int32(i))
        e0 = values[0] + column * steps[0]
        e1 = values[1] + column * steps[1]
        e2 = values[2] + column * steps[2]
        stored = held(depth_from(plane, e0, e1), plane)
        if (
            (e0 >= thresholds[0])
            & (e1 >= thresholds[1])
            & (e2 >= thresholds[2])
            & (stored > depths[i])
        ):
            depths[i] = stored
            numbers[i] = face


@stage
def draw_small(a, b, c, plane, box, face, origin, grid_bits, tile):
    """Test each row of the box in groups of four samples."""
    depths, numbers = tile
    ax, ay, bx, by, cx, cy = a[0], a[1], b[0], b[1], c[0], c[1]
    left, top, right, bottom = box
    lanes = ((right - left) | 3) + 1
    e0 = np.float64(edge_at(bx, by, cx, cy, left, top, grid_bits))
    e1 = np.float64(edge_at(cx, cy, ax, ay, left, top, grid_bits))
    e2 = np.float64(edge_at(ax, ay, bx, by, left, top, grid_bits))
    thresholds = (
        np.float64(-edge_bias(bx, by, cx, cy)),
        np.float64(-edge_bias(cx, cy, ax, ay)),
        np.float64(-edge_bias(ax, ay, bx, by)),
    )
    unit = np.float64(np.int64(1) << grid_bits)
    steps = (np.float64(by - cy) * unit, np.float64(cy - ay) * unit, np.float64(ay - by) * unit)
    begin = left - origin[0]
    for row in range(top - origin[1], bottom - origin[1] + 1):
        test_row(
            depths[row, begin : begin + lanes],
            numbers[row, begin : begin + lanes],
            (e0, e1, e2), steps, thresholds, plane, face,
        )  # fmt: skip
        e0 += np.float64(cx - bx) * unit
        e1 += np.float64(ax - cx) * unit
        e2 += np.float64(bx - ax) * unit


@stage
def draw_spans(a, b, c, plane, box, face, origin, grid_bits, tile):
    """Find the first and last covered column of each row, and fill what lies between."""
    depths, numbers = tile
    ax, ay, bx, by, cx, cy = a[0], a[1], b[0], b[1], c[0], c[1]
    left, top, right, bottom = box
    across0, across1, across2 = by - cy, cy - ay, ay - by
    e0 = sign_at(bx, by, cx, cy, left, top, grid_bits)
    e1 = sign_at(cx, cy, ax, ay, left, top, grid_bits)
    e2 = sign_at(ax, ay, bx, by, left, top, grid_bits)
    columns, rows = right - left + 1, bottom - top + 1
    covers_box = (
        worst(e0, across0, cx - bx, columns, rows)
        | worst(e1, across1, ax - cx, columns, rows)
        | worst(e2, across2, bx - ax, columns, rows)
    ) >= 0
    c0 = edge_crossing(e0, across0, cx - bx)
    c1 = edge_crossing(e1, across1, ax - cx)
    c2 = edge_crossing(e2, across2, bx - ax)
    inside0 = edge_at(bx, by, cx, cy, left, top, grid_bits)
    inside1 = edge_at(cx, cy, ax, ay, left, top, grid_bits)
    for row in range(top, bottom + 1):
        first, last = np.int64(0), columns - 1
        if not covers_box:
            first = first_inside(c0, across0, first)
            first = first_inside(c1, across1, first)
            first = first_inside(c2, across2, first)
            last = last_inside(c0, across0, last)
            last = last_inside(c1, across1, last)
            last = last_inside(c2, across2, last)
        begin, end = max(left + first - origin[0], np.int64(0)), left + last + 1 - origin[0]
        if begin < end:
            depth = depth_from(
                plane,
                inside0 + ((first * across0) << grid_bits),
                inside1 + ((first * across1) << grid_bits),
            )
            steps = np.int32(0)
            if TILE_BITS < BLOCK_BITS:
                steps = np.int32(origin[0] + begin - (left + first))
            fill_span(
                depths[row - origin[1], begin:end],
                numbers[row - origin[1], begin:end],
                depth, steps, plane, face,
            )  # fmt: skip
        c0, c1, c2 = next_crossing(c0), next_crossing(c1), next_crossing(c2)
        inside0 += (cx - bx) << grid_bits
        inside1 += (ax - cx) << grid_bits


@stage
def draw_triangle(corners, face, screen, viewport, origin, floor, tile):
    """
    Draw one triangle into a tile whose first pixel is ``origin`` (column, row).

    Nothing is drawn if it lies below ``floor`` in the whole tile.
    """
    bits = viewport.grid_bits
    # Gather the vertices in their fixed order.
    i, j, k = clockwise_from_top(corners, screen)
    ax, ay = np.int64(screen.xy[i, 0]), np.int64(screen.xy[i, 1])
    bx, by = np.int64(screen.xy[j, 0]), np.int64(screen.xy[j, 1])
    cx, cy = np.int64(screen.xy[k, 0]), np.int64(screen.xy[k, 1])
    plane = depth_plane(
        screen.depth[i], screen.depth[j], screen.depth[k], ax, ay, bx, by, cx, cy, bits
    )
    if np.float32(plane[5]) < floor:
        return
    # Bound it in pixels, and to the tile; spans, to the block of columns that holds the tile.
    left = first_sample(min(ax, min(bx, cx)), bits)
    right = last_sample(max(ax, max(bx, cx)), bits)
    is_small = right - left < SMALL_PIXELS
    start = origin[0] if is_small else (origin[0] >> BLOCK_BITS) << BLOCK_BITS
    box = (
        max(left, start),
        max(first_sample(ay, bits), origin[1]),
        min(right, min(origin[0] + TILE_SIZE, np.int64(viewport.width)) - 1),
        min(
            last_sample(max(by, cy), bits),
            min(origin[1] + TILE_SIZE, np.int64(viewport.height)) - 1,
        ),
    )
    a, b, c = (ax, ay), (bx, by), (cx, cy)
    if is_small:
        draw_small(a, b, c, plane, box, face, origin, bits, tile)
    else:
        if floor > -np.inf:
            _, highest = depth_at_corners(plane, a, b, c, box, bits)
            if highest < floor:
                return
        draw_spans(a, b, c, plane, box, face, origin, bits, tile)


@stage
def clear_tile(depths, numbers):
    """Mark every sample of a tile as empty."""
    for row in range(depths.shape[0]):
        for column in range(depths.shape[1]):
            depths[row, column] = -np.inf
            numbers[row, column] = NOTHING


@kernel
def draw_tiles(
    tiles, starts, binned, floors, faces: Faces, screen: ScreenVertices, viewport: Viewport, frame,
    scratch,
):  # fmt: skip
    """
    Draw some of the frame's tiles.

    Parameters
    ----------
    tiles : (N,) int32
        Tile numbers, row by row.
    starts : (tiles + 1,) int64
        Tile ``k`` draws ``binned[starts[k]:starts[k + 1]]``.
    binned : (M,) int32
        Triangle numbers, ascending within a tile: below F a face, ``F + p`` piece p.
    floors : (tiles,) float32
        Triangles below it are left out of a tile; -inf leaves out none.
    faces, screen, viewport : records
    frame : (depth (H, W) float32, face_id (H, W) int32)
        Writes every pixel of the tiles: stored depth (greater is nearer, -inf where nothing is)
        and face number (-1 where nothing is).
    scratch : (depth (64, 72) float32, face numbers (64, 72) int32)
        This thread's own tile, ``SCRATCH_SHAPE``.
    """
    depth, face_id = frame
    tile_depth, tile_numbers = scratch
    columns = (np.int64(viewport.width) + TILE_SIZE - 1) >> TILE_BITS
    # Taken out of the record once: inside the loop each use would count a reference.
    own, pieces, piece_faces = faces.faces, faces.pieces, faces.piece_faces
    for n in range(tiles.shape[0]):
        tile = np.int64(tiles[n])
        origin = ((tile % columns) << TILE_BITS, (tile // columns) << TILE_BITS)
        clear_tile(tile_depth, tile_numbers)
        for k in range(starts[tile], starts[tile + 1]):
            corners, face = triangle_of(own, pieces, piece_faces, np.int64(binned[k]))
            draw_triangle(
                corners, face, screen, viewport, origin, floors[tile], (tile_depth, tile_numbers)
            )
        # Write the tile to the frame.
        left, top = origin
        width = min(TILE_SIZE, viewport.width - left)
        for row in range(min(TILE_SIZE, viewport.height - top)):
            frame_depth = depth[top + row, left : left + width]
            frame_numbers = face_id[top + row, left : left + width]
            for column in range(width):
                frame_depth[column] = tile_depth[row, column]
                frame_numbers[column] = tile_numbers[row, column]
