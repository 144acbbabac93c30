"""
Set up the triangles of a tile in batches: gather their vertices, then work out what drawing takes.

Gathering does nothing else, so that the CPU waits for many vertices at once; the arithmetic is done
for several triangles at once. What is known of a batch lies in two small arrays, one row for each
quantity.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.setup import (
    edge_bias,
    first_sample,
    last_sample,
    narrow_edge,
    triangle_of,
)
from rasterjit.runtime.intrinsics import flat
from rasterjit.runtime.jit import disjoint_helper, helper

SMALL_PIXELS = 8
"""Triangles with a bounding box up to this many pixels wide are tested sample by sample."""

BLOCK_BITS = 6
"""Depth along a row starts anew every 2**6 = 64 columns; tiles are no wider."""

BATCH = 64
"""Triangles set up at once: what is known of them, 14 KiB, stays in L1 beside their samples."""

FACE, AX, AY, BX, BY, CX, CY, LEFT, TOP, RIGHT, BOTTOM, WIDE = range(12)
"""Rows of whole numbers: face, vertices on the sub-pixel grid, box of samples, wide or small."""
WHOLE_ROWS = 12

DEPTH, EDGE, ACROSS, DOWN, LEAST, WEIGHT, RANGE = 0, 3, 6, 9, 12, 15, 17
"""
Rows of real numbers.

Three depths; of three edges the value at the corner of the box, the steps to the next column and
row, and the least value inside; two weights of the depth; the lowest and the highest depth.
"""
REAL_ROWS = 19

ROOM = BATCH + 8
"""Columns of those rows; more than are used, or the rows would share few lines of the cache."""

(
    FACE_AT, AX_AT, AY_AT, BX_AT, BY_AT, CX_AT, CY_AT, LEFT_AT, TOP_AT, RIGHT_AT, BOTTOM_AT, WIDE_AT
) = range(0, ROOM * WHOLE_ROWS, ROOM)  # fmt: skip
DEPTH_0, DEPTH_1, DEPTH_2 = (ROOM * (DEPTH + k) for k in range(3))
EDGE_0, EDGE_1, EDGE_2 = (ROOM * (EDGE + k) for k in range(3))
ACROSS_0, ACROSS_1, ACROSS_2 = (ROOM * (ACROSS + k) for k in range(3))
DOWN_0, DOWN_1, DOWN_2 = (ROOM * (DOWN + k) for k in range(3))
LEAST_0, LEAST_1, LEAST_2 = (ROOM * (LEAST + k) for k in range(3))
WEIGHT_0, WEIGHT_1 = (ROOM * (WEIGHT + k) for k in range(2))
RANGE_0, RANGE_1 = (ROOM * (RANGE + k) for k in range(2))
"""Where those rows begin, one behind the other."""


@helper
def gather_triangles(listed, faces, screen, whole, real):
    """Gather the faces of some listed triangles, where their vertices lie, and how deep."""
    own, pieces, piece_faces = faces
    xy, depth = screen.xy, screen.depth
    count = np.uintp(listed.shape[0])
    for n in range(count):
        (a, b, c), face = triangle_of(own, pieces, piece_faces, np.int64(listed[n]))
        whole[FACE, n] = face
        whole[AX, n], whole[BX, n], whole[CX, n] = a, b, c
    for k in range(3):
        for n in range(count):
            vertex = np.uintp(whole[AX + 2 * k, n])
            whole[AX + 2 * k, n], whole[AY + 2 * k, n] = xy[vertex, 0], xy[vertex, 1]
            real[DEPTH + k, n] = depth[vertex]


@helper
def is_above(ax, ay, bx, by):
    """Return whether a lies above b, or left of it in the same row."""
    return (ay < by) | ((ay == by) & (ax < bx))


@disjoint_helper
def plan_all(count, window, bits, whole, real):
    """
    Work out what drawing the gathered triangles takes, several at once.

    Takes the rows one behind the other: that they lie ``ROOM`` apart tells the compiler that no
    store changes a later load, so that it makes vectors of the loop.

    Vertices are put clockwise on the screen, starting at the topmost, then leftmost. The order
    depends on the geometry alone, so that every spelling of a face is drawn alike.

    The box of samples lies inside a window, a tile's (left, top, right, bottom). Triangles wider
    than ``SMALL_PIXELS`` begin where their block of columns does. For the weights of E_bc and E_ca
    in the depth see `depth_plane`.
    """
    unit, half = np.float64(np.int64(1) << bits), np.int64(1) << (bits - 1)
    block = (window[0] >> BLOCK_BITS) << BLOCK_BITS
    for i in range(count):
        n = np.uintp(i)
        # Loaded before anything is chosen: what is loaded by choice is not loaded in vectors.
        x0, y0, d0 = whole[AX_AT + n], whole[AY_AT + n], real[DEPTH_0 + n]
        bx0, by0, db0 = whole[BX_AT + n], whole[BY_AT + n], real[DEPTH_1 + n]
        cx0, cy0, dc0 = whole[CX_AT + n], whole[CY_AT + n], real[DEPTH_2 + n]
        is_turned = narrow_edge(x0, y0, bx0, by0, cx0, cy0) < 0
        x1, y1, d1 = (
            cx0 if is_turned else bx0,
            cy0 if is_turned else by0,
            dc0 if is_turned else db0,
        )
        x2, y2, d2 = (
            bx0 if is_turned else cx0,
            by0 if is_turned else cy0,
            db0 if is_turned else dc0,
        )
        second = is_above(x1, y1, x0, y0) & is_above(x1, y1, x2, y2)
        third = is_above(x2, y2, x0, y0) & is_above(x2, y2, x1, y1)
        ax = x1 if second else (x2 if third else x0)
        ay = y1 if second else (y2 if third else y0)
        da = d1 if second else (d2 if third else d0)
        bx = x2 if second else (x0 if third else x1)
        by = y2 if second else (y0 if third else y1)
        db = d2 if second else (d0 if third else d1)
        cx = x0 if second else (x1 if third else x2)
        cy = y0 if second else (y1 if third else y2)
        dc = d0 if second else (d1 if third else d2)
        whole[AX_AT + n], whole[AY_AT + n], real[DEPTH_0 + n] = ax, ay, da
        whole[BX_AT + n], whole[BY_AT + n], real[DEPTH_1 + n] = bx, by, db
        whole[CX_AT + n], whole[CY_AT + n], real[DEPTH_2 + n] = cx, cy, dc
        # The box.
        first = first_sample(min(ax, min(bx, cx)), bits)
        last = last_sample(max(ax, max(bx, cx)), bits)
        is_wide = last - first >= SMALL_PIXELS
        left = np.int32(max(first, block if is_wide else window[0]))
        top = np.int32(max(first_sample(ay, bits), window[1]))
        whole[WIDE_AT + n] = is_wide
        whole[LEFT_AT + n], whole[TOP_AT + n] = left, top
        whole[RIGHT_AT + n] = min(last, window[2])
        whole[BOTTOM_AT + n] = min(last_sample(max(by, cy), bits), window[3])
        # The plane of depths.
        area = np.float64(narrow_edge(ax, ay, bx, by, cx, cy))
        real[WEIGHT_0 + n] = (da - dc) / area
        real[WEIGHT_1 + n] = (db - dc) / area
        real[RANGE_0 + n] = min(da, min(db, dc))
        real[RANGE_1 + n] = max(da, max(db, dc))
        # The edges at the corner of the box, their steps, and their least value inside.
        px, py = np.int32((left << bits) + half), np.int32((top << bits) + half)
        real[EDGE_0 + n] = np.float64(narrow_edge(bx, by, cx, cy, px, py))
        real[EDGE_1 + n] = np.float64(narrow_edge(cx, cy, ax, ay, px, py))
        real[EDGE_2 + n] = np.float64(narrow_edge(ax, ay, bx, by, px, py))
        real[ACROSS_0 + n] = np.float64(np.int32(by - cy)) * unit
        real[ACROSS_1 + n] = np.float64(np.int32(cy - ay)) * unit
        real[ACROSS_2 + n] = np.float64(np.int32(ay - by)) * unit
        real[DOWN_0 + n] = np.float64(np.int32(cx - bx)) * unit
        real[DOWN_1 + n] = np.float64(np.int32(ax - cx)) * unit
        real[DOWN_2 + n] = np.float64(np.int32(bx - ax)) * unit
        real[LEAST_0 + n] = np.float64(-edge_bias(bx, by, cx, cy))
        real[LEAST_1 + n] = np.float64(-edge_bias(cx, cy, ax, ay))
        real[LEAST_2 + n] = np.float64(-edge_bias(ax, ay, bx, by))


@helper
def plan_triangles(count, window, bits, whole, real):
    """Work out what drawing the gathered triangles takes: `plan_all`."""
    plan_all(count, window, bits, flat(whole), flat(real))
