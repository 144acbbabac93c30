"""
Find the runs of a row: neighbours that show one face, and how their weights begin and go on.

In three passes over small arrays, one row for each quantity: list the runs, gather what their
vertices have on the screen, turn that into edge functions. Gathering does nothing else, so that
the CPU waits for many vertices at once; the arithmetic is done for several runs at once.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.interpolation import lowest_first
from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.setup import CLIPPED

COLUMN, COUNT, FACE = 0, 1, 2
"""Rows of whole numbers: first column, number of samples, face."""
CORNER_A, CORNER_B, CORNER_C, IS_CLIPPED = 3, 4, 5, 6
"""Vertices, the lowest number first; not 0 if the face was cut."""
AX, AY, BX, BY, CX, CY = 7, 8, 9, 10, 11, 12
"""Their places on the sub-pixel grid."""
EDGE, STEP = 13, 16
"""Three rows each: the edge functions at the first sample, and what they gain to the next."""
WHOLE_ROWS = 19

RATIO = 0
"""Three rows of real numbers: w of the vertices, then the smallest w over each."""
REAL_ROWS = 3

LANES = 16
"""Samples compared at once: face numbers in a 512-bit register."""


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


@stage
def list_runs(faces, whole):
    """List the runs of a row that show a face, left to right; return how many there are."""
    count, column = np.uintp(0), np.int64(0)
    while column < faces.shape[0]:
        end = run_end(faces, column)
        face = faces[np.uintp(column)]
        whole[COLUMN, count] = column
        whole[COUNT, count] = end - column
        whole[FACE, count] = face
        count += np.uintp(face >= 0)
        column = end
    return np.int64(count)


@stage
def gather_corners(whole, real, count, geometry):
    """Gather the vertices of the runs and where they lie."""
    xy, w, codes = geometry.xy, geometry.w, geometry.codes
    for n in range(np.uintp(count)):
        a, b, c = lowest_first(geometry.faces, np.uintp(whole[FACE, n]))
        whole[CORNER_A, n], whole[CORNER_B, n], whole[CORNER_C, n] = a, b, c
        whole[IS_CLIPPED, n] = (codes[a] | codes[b] | codes[c]) & CLIPPED
        whole[AX, n], whole[AY, n] = xy[a, 0], xy[a, 1]
        whole[BX, n], whole[BY, n] = xy[b, 0], xy[b, 1]
        whole[CX, n], whole[CY, n] = xy[c, 0], xy[c, 1]
        real[RATIO, n], real[RATIO + 1, n], real[RATIO + 2, n] = w[a], w[b], w[c]


@disjoint_stage
def start_edge(column, left, py, bits, ax, ay, bx, by, value, step):
    """Write the edge function of a -> b at the first sample of each run, and its gain."""
    half = np.int64(1) << (bits - 1)
    for n in range(value.shape[0]):
        px = ((column[n] + left) << bits) + half
        value[n] = (bx[n] - ax[n]) * (py - ay[n]) - (by[n] - ay[n]) * (px - ax[n])
        step[n] = (ay[n] - by[n]) << bits


@disjoint_stage
def divide_smallest(wa, wb, wc):
    """Replace w by the smallest of the three over it."""
    for n in range(wa.shape[0]):
        a, b, c = wa[n], wb[n], wc[n]
        smallest = min(a, min(b, c))
        wa[n], wb[n], wc[n] = smallest / a, smallest / b, smallest / c


@stage
def start_weights(whole, real, count, left, row, bits):
    """Write how the weights of each run begin and what they gain from one sample to the next."""
    py = (np.int64(row) << bits) + (np.int64(1) << (bits - 1))
    column = whole[COLUMN, :count]
    ax, ay = whole[AX, :count], whole[AY, :count]
    bx, by = whole[BX, :count], whole[BY, :count]
    cx, cy = whole[CX, :count], whole[CY, :count]
    start_edge(
        column, left, py, bits, bx, by, cx, cy, whole[EDGE, :count], whole[STEP, :count]
    )  # fmt: skip
    start_edge(
        column, left, py, bits, cx, cy, ax, ay, whole[EDGE + 1, :count], whole[STEP + 1, :count]
    )
    start_edge(
        column, left, py, bits, ax, ay, bx, by, whole[EDGE + 2, :count], whole[STEP + 2, :count]
    )
    divide_smallest(
        real[RATIO, :count], real[RATIO + 1, :count], real[RATIO + 2, :count]
    )  # fmt: skip


@stage
def row_start(whole, real, n):
    """Return what `interpolation.weights_along_row` takes, of one run."""
    return (
        (whole[EDGE, n], whole[EDGE + 1, n], whole[EDGE + 2, n]),
        (whole[STEP, n], whole[STEP + 1, n], whole[STEP + 2, n]),
        (real[RATIO, n], real[RATIO + 1, n], real[RATIO + 2, n]),
    )
