"""
Set up a face for shading, and find the runs of a row: neighbours that show one face.

What belongs to a face (vertices, edge functions, colours ...) is worked out once for the runs that
show it in a block of rows, and kept in a small table, found by a hash of the face's number. A face
that finds another one in its place takes it.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.interpolation import lowest_first
from rasterjit.kernels.jit import stage
from rasterjit.kernels.setup import CLIPPED, edge

SLOT_BITS = 8
SLOTS = 1 << SLOT_BITS
"""Faces in the table: more than a row of a block shows."""

HASH = np.uint32(2654435769)
"""2**32 over the golden ratio: spreads numbers that are multiples of anything."""

FACE, IS_CLIPPED, OWNER, BEHIND = 0, 1, 2, 3
"""Columns of whole numbers: face, not 0 if it was cut, object, not 0 if its back is seen."""
CORNERS = 4
"""Three columns: vertices, the lowest number first."""
EDGE, ACROSS, DOWN = 7, 10, 13
"""Three columns each: edge functions at the first pixel, what they gain by a column and a row."""
WHOLE_COLUMNS = 16

RATIO = 0
"""Three columns of real numbers: the smallest w over each."""
REAL_COLUMNS = 3

NO_FACE = -1

LANES = 16
"""Samples compared at once: face numbers in a 512-bit register."""


@stage
def forget_faces(whole):
    """Empty the table."""
    for slot in range(SLOTS):
        whole[slot, FACE] = NO_FACE


@stage
def slot_of(face):
    """Return where in the table a face is kept."""
    return np.uintp(np.uint32(np.uint32(face) * HASH) >> np.uint32(32 - SLOT_BITS))


@stage
def put_edge(ax, ay, bx, by, k, bits, row):
    """Write the edge function of a -> b."""
    half = np.int64(1) << (bits - 1)
    row[EDGE + k] = edge(ax, ay, bx, by, half, half)
    row[ACROSS + k] = (ay - by) << bits
    row[DOWN + k] = (bx - ax) << bits


@stage
def put_corners(face, geometry, whole, real):
    """Write vertices, edge functions and ratios of a face into its rows; return the vertices."""
    a, b, c = lowest_first(geometry.faces, np.uintp(face))
    xy, w, bits = geometry.xy, geometry.w, geometry.viewport.grid_bits
    ax, ay = np.int64(xy[a, 0]), np.int64(xy[a, 1])
    bx, by = np.int64(xy[b, 0]), np.int64(xy[b, 1])
    cx, cy = np.int64(xy[c, 0]), np.int64(xy[c, 1])
    put_edge(bx, by, cx, cy, 0, bits, whole)
    put_edge(cx, cy, ax, ay, 1, bits, whole)
    put_edge(ax, ay, bx, by, 2, bits, whole)
    smallest = min(w[a], min(w[b], w[c]))
    real[RATIO], real[RATIO + 1], real[RATIO + 2] = (
        smallest / w[a],
        smallest / w[b],
        smallest / w[c],
    )
    whole[FACE] = face
    whole[IS_CLIPPED] = (geometry.codes[a] | geometry.codes[b] | geometry.codes[c]) & CLIPPED
    whole[CORNERS], whole[CORNERS + 1], whole[CORNERS + 2] = a, b, c
    return a, b, c


@stage
def row_start(whole, real, column, row):
    """Return what `interpolation.weights_along_row` takes, from a pixel on."""
    return (
        (
            whole[EDGE] + column * whole[ACROSS] + row * whole[DOWN],
            whole[EDGE + 1] + column * whole[ACROSS + 1] + row * whole[DOWN + 1],
            whole[EDGE + 2] + column * whole[ACROSS + 2] + row * whole[DOWN + 2],
        ),
        (whole[ACROSS], whole[ACROSS + 1], whole[ACROSS + 2]),
        (real[RATIO], real[RATIO + 1], real[RATIO + 2]),
    )


@stage
def differences(faces, face):
    """Return 0 if some samples all show one face."""
    found = np.int32(0)
    for i in range(faces.shape[0]):
        found |= np.int32(faces[i] ^ face)
    return found


@stage
def run_end(faces, column):
    """Return the first column that shows another face than this one."""
    end, face = column + 1, faces[np.uintp(column)]
    size = faces.shape[0]
    while end < size and faces[np.uintp(end)] == face:
        end += 1
        if end - column >= LANES:
            while end + LANES <= size and differences(faces[end : end + LANES], face) == 0:
                end += LANES
    return end
