"""
Sort the surviving triangles into tiles.

Count, then fill; nothing grows. The counts come from ``setup``, one row for each chunk of faces.
Their prefix sum gives every chunk its own range in every tile's list, so that threads may fill
chunks in any order and a tile's list still ascends by face.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.setup import (
    TILE_BITS,
    bound_edge_in_tile,
    get_box,
    get_triangle,
    tile_edges,
)
from rasterjit.pipeline.records import Faces, ScreenVertices, Viewport
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import int32, int64, uint8


@kernel
def start_lists(counts: int32[:, ::1], starts: int64[::1], cursors: int64[:, ::1]):
    """
    Compute each chunk's range in each tile's list: the prefix sums of the counts.

    Parameters
    ----------
    counts : (chunks, tiles + 1) int32
        Triangles for each tile; the last column is not read.
    starts : (tiles + 1,) int64
        Written: where each tile's list starts, and the length of all.
    cursors : (chunks, tiles) int64
        Written: where each chunk's part of a list starts.
    """
    start = np.int64(0)
    for tile in range(cursors.shape[1]):
        starts[tile] = start
        for chunk in range(cursors.shape[0]):
            cursors[chunk, tile] = start
            start += np.int64(counts[chunk, tile])
    starts[cursors.shape[1]] = start


@helper
def append_to_tile(triangle, tile, cursors, binned):
    """Append a triangle to the list of a tile."""
    binned[np.uintp(cursors[tile])] = triangle
    cursors[tile] += 1


@kernel
def bin_triangles(
    triangles: int32[::1], boxes: uint8[:, ::1], columns: int64, faces: Faces,
    screen: ScreenVertices, viewport: Viewport, cursors: int64[::1], binned: int32[::1],
):  # fmt: skip
    """
    Write each triangle into the list of every tile that it reaches.

    Parameters
    ----------
    triangles : (T,) int32
        Survivors of one chunk, ascending.
    boxes : (T, 4) uint8
        Inclusive tile columns and rows: left, top, right, bottom.
    columns : int
        Tiles in a row of the image.
    faces, screen, viewport : records
    cursors : (tiles,) int64
        Index of this chunk's next triangle in each tile's list. Advanced.
    binned : (N,) int32
        Writes the lists of all tiles, one after the other.
    """
    all_faces, pieces, piece_faces = faces.faces, faces.pieces, faces.piece_faces
    # The last tile's cursor stays in a register: consecutive triangles often share a tile.
    tile, cursor = np.uintp(0), cursors[0]
    for n in range(triangles.shape[0]):
        triangle = triangles[n]
        left, top, right, bottom = get_box(boxes, np.uintp(n))
        if (left == right) & (top == bottom):
            only_tile = np.uintp(top * columns + left)
            if only_tile != tile:
                cursors[tile] = cursor
                tile, cursor = only_tile, cursors[only_tile]
            binned[np.uintp(cursor)] = triangle
            cursor += 1
            continue
        cursors[tile] = cursor
        if (left == right) | (top == bottom):
            for row in range(top, bottom + 1):
                for column in range(left, right + 1):
                    append_to_tile(triangle, np.uintp(row * columns + column), cursors, binned)
        else:
            corners, _ = get_triangle(all_faces, pieces, piece_faces, np.int64(triangle))
            edges = tile_edges(corners[0], corners[1], corners[2], screen.xy, viewport)
            steps = edges[0][1] << TILE_BITS, edges[1][1] << TILE_BITS, edges[2][1] << TILE_BITS
            for row in range(top, bottom + 1):
                e0 = bound_edge_in_tile(edges[0], left, row)
                e1 = bound_edge_in_tile(edges[1], left, row)
                e2 = bound_edge_in_tile(edges[2], left, row)
                for k in range(row * columns + left, row * columns + right + 1):
                    if (e0 | e1 | e2) >= 0:
                        append_to_tile(triangle, np.uintp(k), cursors, binned)
                    e0, e1, e2 = e0 + steps[0], e1 + steps[1], e2 + steps[2]
        cursor = cursors[tile]
    cursors[tile] = cursor
