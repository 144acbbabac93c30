"""
Sort the surviving triangles into tiles.

Count, then fill; nothing grows. The counts come from ``setup``, one row for each chunk of faces;
their running sum gives every chunk its own place in every tile's list, so chunks are filled by
different threads in any order and a tile's list still ascends by face.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import kernel


@kernel
def bin_triangles(triangles, boxes, columns, cursors, binned):
    """
    Write each triangle into the list of every tile that its box touches.

    Parameters
    ----------
    triangles : (T,) int32
        Survivors of one chunk, ascending.
    boxes : (T, 4) uint8
        Inclusive tile columns and rows: left, top, right, bottom.
    columns : int
        Tiles in a row of the image.
    cursors : (tiles,) int64
        Where this chunk's next triangle goes in each tile's list. Advanced.
    binned : (N,) int32
        Writes the lists of all tiles, one after the other.
    """
    for n in range(triangles.shape[0]):
        triangle = triangles[n]
        if boxes[n, 0] == boxes[n, 2] and boxes[n, 1] == boxes[n, 3]:
            tile = np.uintp(np.int64(boxes[n, 1]) * columns + np.int64(boxes[n, 0]))
            binned[np.uintp(cursors[tile])] = triangle
            cursors[tile] += 1
            continue
        for row in range(np.int64(boxes[n, 1]), np.int64(boxes[n, 3]) + 1):
            for column in range(np.int64(boxes[n, 0]), np.int64(boxes[n, 2]) + 1):
                tile = row * columns + column
                binned[cursors[tile]] = triangle
                cursors[tile] += 1
