"""
Find the nearest face at every sample: coverage, depth test, depth and face number.

For each tile, every triangle of its list is drawn into two small squares that stay in L1 (depth,
face number), which are written to the frame once, background included.

Coverage is exact. With the interior on the positive side of all three edges a sample is inside
where ``E_k + bias_k >= 0`` (bias 0 on top and left edges, -1 on others). Stepping one pixel adds a
multiple of ``2**grid_bits``, so ``(E_k + bias_k) >> grid_bits`` has the same sign and steps by the
edge's own integer slope.

Triangles at most ``SMALL_PIXELS`` wide are tested sample by sample. Wider ones get, for each row,
the first and the last covered column from one division for each edge: ``floor(e / s)`` of
integers below 2**47 in float64 is exact, for a quotient that is not whole misses the next whole
number by at least 1/s, more than half an ulp.

Depth is interpolated linearly on the screen, in float64, by differences from one vertex,
``d = d2 + b0 (d0 - d2) + b1 (d1 - d2)`` with exact edge functions in the weights ``b``, so equal
vertex depths give exactly that depth. Along a row of a wide triangle it steps from the row's first
covered sample, where ``|steps * slope|`` stays below the depth's own range. It is held inside the
range of the vertices, and depends on the sample alone, never on the tile. Vertices are taken in a
fixed order (topmost, then leftmost first, clockwise), so neither rotation nor winding of the face
changes a bit.

A sample keeps the first of equal depths. Lists ascend by face: the lower face number wins a tie.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import kernel, stage
from rasterjit.kernels.records import Faces, ScreenVertices, Viewport
from rasterjit.kernels.setup import TILE_BITS, edge, edge_bias, first_sample, last_sample

TILE_SIZE = 1 << TILE_BITS

SMALL_PIXELS = 8
"""Triangles with a bounding box up to this many pixels wide are tested sample by sample."""

NOTHING = -1
"""Face number of a sample that no face covers."""


@stage
def clockwise_from_top(corners, screen):
    """
    Return the vertex numbers clockwise on the screen, starting at the topmost, then leftmost.

    The order depends on the geometry alone, so that every spelling of a face is drawn alike.
    """
    a, b, c = np.int64(corners[0]), np.int64(corners[1]), np.int64(corners[2])
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
def edge_at(ax, ay, bx, by, column, row, grid_bits):
    """Return the biased edge function of a -> b at a pixel's centre, in steps of one pixel."""
    half = np.int64(1) << (grid_bits - 1)
    px, py = (column << grid_bits) + half, (row << grid_bits) + half
    return (edge(ax, ay, bx, by, px, py) + edge_bias(ax, ay, bx, by)) >> grid_bits


@stage
def first_inside(value, slope, first):
    """Return the first column at or after ``first`` with ``value + column * slope >= 0``."""
    if slope <= 0:
        return first
    return max(first, -np.int64(np.floor(np.float64(value) / np.float64(slope))))


@stage
def last_inside(value, slope, last):
    """Return the last column at or before ``last`` with ``value + column * slope >= 0``."""
    if slope < 0:
        return min(last, np.int64(np.floor(np.float64(value) / np.float64(-slope))))
    if slope == 0 and value < 0:
        return np.int64(-1)
    return last


@stage
def fill_span(depths, numbers, skipped, plane, face):
    """
    Depth-test one row of samples.

    ``plane`` is the depth at the row's first covered sample, its step, and the range it is held
    in; ``skipped`` samples lie between that first one and the first one here.
    """
    depth, slope, low, high = plane
    for i in range(depths.shape[0]):
        d = depth + np.float64(np.int32(i) + skipped) * slope
        d = low if d < low else d
        d = high if d > high else d
        stored = np.float32(d)
        if stored > depths[i]:
            depths[i] = stored
            numbers[i] = face


@stage
def draw_triangle(corners, face, screen, viewport, origin, tile):
    """Draw one triangle into a tile whose first pixel is ``origin`` (column, row)."""
    depths, numbers = tile
    bits = viewport.grid_bits
    # Gather the vertices in their fixed order.
    a, b, c = clockwise_from_top(corners, screen)
    ax, ay = np.int64(screen.xy[a, 0]), np.int64(screen.xy[a, 1])
    bx, by = np.int64(screen.xy[b, 0]), np.int64(screen.xy[b, 1])
    cx, cy = np.int64(screen.xy[c, 0]), np.int64(screen.xy[c, 1])
    da, db, dc = screen.depth[a], screen.depth[b], screen.depth[c]
    low, high = min(da, min(db, dc)), max(da, max(db, dc))
    area = np.float64(edge(ax, ay, bx, by, cx, cy))
    # Bound it in pixels, and to the tile.
    left = first_sample(min(ax, min(bx, cx)), bits)
    right = last_sample(max(ax, max(bx, cx)), bits)
    tile_left, tile_top = origin
    tile_right = min(tile_left + TILE_SIZE, np.int64(viewport.width)) - 1
    first_row = max(first_sample(ay, bits), tile_top)
    last_row = min(last_sample(max(by, cy), bits), tile_top + TILE_SIZE - 1)
    last_row = min(last_row, np.int64(viewport.height) - 1)
    # Evaluate the edges at the left end of the first row, and their steps.
    e0 = edge_at(bx, by, cx, cy, left, first_row, bits)
    e1 = edge_at(cx, cy, ax, ay, left, first_row, bits)
    e2 = edge_at(ax, ay, bx, by, left, first_row, bits)
    across0, across1, across2 = by - cy, cy - ay, ay - by
    down0, down1, down2 = cx - bx, ax - cx, bx - ax
    # The weights step by this share of the depth differences.
    unit = np.float64(np.int64(1) << bits)
    weight_a, weight_b = (da - dc) / area, (db - dc) / area
    half = np.int64(1) << (bits - 1)
    slope = unit * (np.float64(across0) * weight_a + np.float64(across1) * weight_b)
    for row in range(first_row, last_row + 1):
        py = (row << bits) + half
        if right - left < SMALL_PIXELS:
            start = max(left, tile_left) - left
            f0, f1, f2 = e0 + start * across0, e1 + start * across1, e2 + start * across2
            for column in range(max(left, tile_left), min(right, tile_right) + 1):
                if (f0 | f1 | f2) >= 0:
                    px = (column << bits) + half
                    d = dc + (
                        np.float64(edge(bx, by, cx, cy, px, py)) * weight_a
                        + np.float64(edge(cx, cy, ax, ay, px, py)) * weight_b
                    )
                    d = low if d < low else d
                    d = high if d > high else d
                    stored = np.float32(d)
                    if stored > depths[row - tile_top, column - tile_left]:
                        depths[row - tile_top, column - tile_left] = stored
                        numbers[row - tile_top, column - tile_left] = face
                f0 += across0
                f1 += across1
                f2 += across2
        else:
            start = first_inside(e0, across0, np.int64(0))
            start = first_inside(e1, across1, start)
            start = left + first_inside(e2, across2, start)
            stop = last_inside(e0, across0, right - left)
            stop = last_inside(e1, across1, stop)
            stop = left + last_inside(e2, across2, stop)
            begin, end = max(start, tile_left), min(stop, tile_right)
            if begin <= end:
                px = (start << bits) + half
                d = dc + (
                    np.float64(edge(bx, by, cx, cy, px, py)) * weight_a
                    + np.float64(edge(cx, cy, ax, ay, px, py)) * weight_b
                )
                fill_span(
                    depths[row - tile_top, begin - tile_left : end - tile_left + 1],
                    numbers[row - tile_top, begin - tile_left : end - tile_left + 1],
                    np.int32(begin - start),
                    (d, slope, low, high),
                    face,
                )
        e0 += down0
        e1 += down1
        e2 += down2


@kernel
def draw_tiles(
    tiles, starts, binned, faces: Faces, screen: ScreenVertices, viewport: Viewport, frame, scratch
):
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
    faces, screen, viewport : records
    frame : (depth (H, W) float32, face_id (H, W) int32)
        Writes every pixel of the tiles: stored depth (greater is nearer, -inf where nothing is)
        and face number (-1 where nothing is).
    scratch : (depth (64, 64) float32, face numbers (64, 64) int32)
        This thread's own tile.
    """
    depth, face_id = frame
    tile_depth, tile_numbers = scratch
    columns = (np.int64(viewport.width) + TILE_SIZE - 1) >> TILE_BITS
    face_count = np.int64(faces.faces.shape[0])
    for n in range(tiles.shape[0]):
        tile = np.int64(tiles[n])
        origin = ((tile % columns) << TILE_BITS, (tile // columns) << TILE_BITS)
        tile_depth[:, :] = -np.inf
        tile_numbers[:, :] = NOTHING
        for k in range(starts[tile], starts[tile + 1]):
            triangle = np.int64(binned[k])
            if triangle < face_count:
                corners, face = faces.faces[triangle], np.int32(triangle)
            else:
                corners = faces.pieces[triangle - face_count]
                face = np.int32(faces.piece_faces[triangle - face_count])
            draw_triangle(
                corners, face, screen, viewport, origin, (tile_depth, tile_numbers)
            )
        # Write the tile to the frame.
        left, top = origin
        width = min(TILE_SIZE, viewport.width - left)
        for row in range(min(TILE_SIZE, viewport.height - top)):
            depth[top + row, left : left + width] = tile_depth[row, :width]
            face_id[top + row, left : left + width] = tile_numbers[row, :width]
