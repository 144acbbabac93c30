"""
Sort the surviving triangles into tiles.

Count, then fill; nothing grows. The counts come from ``setup``, one row for each chunk of faces;
their running sum gives every chunk its own place in every tile's list, so chunks are filled by
different threads in any order and a tile's list still ascends by face.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import kernel, stage
from rasterjit.kernels.records import Faces, ScreenVertices, Viewport
from rasterjit.kernels.setup import reaches_tile, tile_edges, triangle_of


@stage
def list_in_tile(triangle, tile, cursors, binned):
    """Write a triangle into the list of a tile."""
    binned[np.uintp(cursors[tile])] = triangle
    cursors[tile] += 1


@kernel
def bin_triangles(
    triangles, boxes, columns, faces: Faces, screen: ScreenVertices, viewport: Viewport, cursors,
    binned,
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
        Where this chunk's next triangle goes in each tile's list. Advanced.
    binned : (N,) int32
        Writes the lists of all tiles, one after the other.
    """
    own, pieces, piece_faces = faces.faces, faces.pieces, faces.piece_faces
    for n in range(triangles.shape[0]):
        triangle = triangles[n]
        left, top = np.int64(boxes[n, 0]), np.int64(boxes[n, 1])
        right, bottom = np.int64(boxes[n, 2]), np.int64(boxes[n, 3])
        if (left == right) | (top == bottom):
            for row in range(top, bottom + 1):
                for column in range(left, right + 1):
                    list_in_tile(triangle, np.uintp(row * columns + column), cursors, binned)
            continue
        corners, _ = triangle_of(own, pieces, piece_faces, np.int64(triangle))
        lines = tile_edges(corners[0], corners[1], corners[2], screen.xy, viewport.grid_bits)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                if reaches_tile(lines, column, row):
                    list_in_tile(triangle, np.uintp(row * columns + column), cursors, binned)
