"""
Hierarchical Z: compute tile depths, behind which everything in a tile is hidden.

A tile depth is the greatest of the lowest depths of triangles that cover every sample of the tile
(greater is nearer). Triangles below it are culled, anywhere in the list. The tile depth is a lower
bound of stored depths, rounding included, so culling changes no bit. Alpha-tested triangles do not
count.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry import setup
from rasterjit.pipeline.records import Faces, ScreenVertices, Viewport
from rasterjit.pipeline.visibility.tile_rasterizer import bound_depths
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, int32, int64, stored, uint8

MIN_COVERING_AREA = 2.0 * setup.TILE_SIZE * setup.TILE_SIZE
"""Area of the smallest triangle that covers a whole tile, square pixels."""


@helper
def sort_clockwise_from_top(corners, screen):
    """
    Return the vertex numbers clockwise on the screen, starting at the topmost, then leftmost.

    The order depends on positions alone, so a face is drawn alike whichever vertex it lists first.
    """
    a, b, c = corners
    ax, ay = np.int64(screen.xy[a, 0]), np.int64(screen.xy[a, 1])
    bx, by = np.int64(screen.xy[b, 0]), np.int64(screen.xy[b, 1])
    cx, cy = np.int64(screen.xy[c, 0]), np.int64(screen.xy[c, 1])
    if setup.edge(ax, ay, bx, by, cx, cy) < 0:
        b, c = c, b
        bx, by, cx, cy = cx, cy, bx, by
    if (by < ay or (by == ay and bx < ax)) and (by < cy or (by == cy and bx < cx)):
        a, b, c = b, c, a
    elif (cy < ay or (cy == ay and cx < ax)) and (cy < by or (cy == by and cx < bx)):
        a, b, c = c, a, b
    return a, b, c


@helper
def compute_depth_plane(da, db, dc, ax, ay, bx, by, cx, cy, grid_bits):
    """Return depth of c, weights of E_bc and E_ca, step per column, lowest and highest depth."""
    area = np.float64(setup.edge(ax, ay, bx, by, cx, cy))
    weight_a, weight_b = (da - dc) / area, (db - dc) / area
    unit = np.float64(np.int64(1) << grid_bits)
    step = unit * (np.float64(by - cy) * weight_a + np.float64(cy - ay) * weight_b)
    return dc, weight_a, weight_b, step, min(da, min(db, dc)), max(da, max(db, dc))


@helper
def min_along_side(value, step, count):
    """Return the least value of an edge along one side of a block of samples."""
    return value + min(step * (count - 1), np.int64(0))


@helper
def raise_tile_depths(triangle, box, columns, faces, screen, viewport, tile_depths, cutoffs):
    """Raise the depths of those tiles of its box that one large triangle covers."""
    bits = viewport.grid_bits
    corners, face = setup.get_triangle(faces[0], faces[1], faces[2], triangle)
    face_starts, object_cutoffs = cutoffs
    if (
        object_cutoffs.shape[0] > 0
        and object_cutoffs[setup.find_last_at_most(face_starts, np.int64(face))] > 0.0
    ):
        return
    i, j, k = sort_clockwise_from_top(corners, screen)
    ax, ay = np.int64(screen.xy[i, 0]), np.int64(screen.xy[i, 1])
    bx, by = np.int64(screen.xy[j, 0]), np.int64(screen.xy[j, 1])
    cx, cy = np.int64(screen.xy[k, 0]), np.int64(screen.xy[k, 1])
    grid_area = np.float64(np.int64(1) << (2 * bits))
    if np.float64(setup.edge(ax, ay, bx, by, cx, cy)) < 2.0 * MIN_COVERING_AREA * grid_area:
        return
    plane = compute_depth_plane(
        screen.depth[i], screen.depth[j], screen.depth[k], ax, ay, bx, by, cx, cy, bits
    )
    highest = tile_depths.dtype.type(plane[5])
    across, size = (by - cy, cy - ay, ay - by), np.int64(setup.TILE_SIZE)
    x = box[0] << setup.TILE_BITS
    for row in range(box[1], box[3] + 1):
        y = row << setup.TILE_BITS
        height = min(size, np.int64(viewport.height) - y)
        e0 = min_along_side(setup.biased_edge_at(bx, by, cx, cy, x, y, bits), cx - bx, height)
        e1 = min_along_side(setup.biased_edge_at(cx, cy, ax, ay, x, y, bits), ax - cx, height)
        e2 = min_along_side(setup.biased_edge_at(ax, ay, bx, by, x, y, bits), bx - ax, height)
        for column in range(box[0], box[2] + 1):
            left, tile = column << setup.TILE_BITS, row * columns + column
            width = min(size, np.int64(viewport.width) - left)
            is_covered = (
                min_along_side(e0, across[0], width)
                | min_along_side(e1, across[1], width)
                | min_along_side(e2, across[2], width)
            ) >= 0
            e0, e1, e2 = e0 + across[0] * size, e1 + across[1] * size, e2 + across[2] * size
            # A triangle that is nowhere nearer changes nothing.
            if is_covered and tile_depths[tile] < highest:
                tile_box = left, y, left + width - 1, y + height - 1
                lowest, _ = bound_depths(plane, (ax, ay), (bx, by), (cx, cy), tile_box, bits)
                tile_depths[tile] = max(tile_depths[tile], tile_depths.dtype.type(lowest))


@kernel
def find_tile_depths(
    triangles: int32[::1], boxes: uint8[:, ::1], columns: int64, faces: Faces,
    screen: ScreenVertices, viewport: Viewport, tile_depths: stored[::1],
    cutoffs: (int64[::1], float32[::1]),
):  # fmt: skip
    """
    Raise the depths of the tiles that large triangles cover.

    Parameters
    ----------
    triangles : (T,) int32
        Survivors of one chunk, as ``bin_triangles`` takes them.
    boxes : (T, 4) uint8
    columns : int
        Tiles in a row of the image.
    faces, screen, viewport : records
    tile_depths : (tiles,) float32, float64 or int32
        Stored depth (greater is nearer); raised in place.
    cutoffs : (face_starts (O+1,) int64, cutoffs (O,) float32)
        As in ``AlphaTests``; both empty if no object is alpha-tested.
    """
    parts = faces.faces, faces.pieces, faces.piece_faces
    for n in range(triangles.shape[0]):
        left, top = np.int64(boxes[n, 0]), np.int64(boxes[n, 1])
        box = left, top, np.int64(boxes[n, 2]), np.int64(boxes[n, 3])
        if setup.is_large(box):
            triangle = np.int64(triangles[n])
            raise_tile_depths(triangle, box, columns, parts, screen, viewport, tile_depths, cutoffs)
