"""Take the surfaces with a hole at a pixel out of its layers."""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.cutouts import has_holes, pixel_alpha
from rasterjit.kernels.jit import kernel, stage
from rasterjit.kernels.records import Cutouts
from rasterjit.kernels.setup import last_at_most


@stage
def is_hole(face, column, row, memory, cutouts):
    """Return whether a face has a hole at a pixel's centre."""
    if not has_holes(face, cutouts):
        return False
    owner = last_at_most(cutouts.face_starts, face)
    alpha = pixel_alpha(face, owner, np.int32(column), np.int32(row), memory, cutouts)
    return not alpha >= cutouts.cutoffs[owner]


@kernel
def drop_holes(first_row, faces, depths, memory, cutouts: Cutouts):
    """
    Leave the layers of each pixel that have no hole there, nearest first.

    Parameters
    ----------
    first_row : int
        Of the frame: row 0 of the arrays.
    faces : (K, R, W) int32
        The faces of each pixel, nearest first; -1 behind the last. Changed.
    depths : (K, R, W)
        Their stored depths. Changed.
    memory : tuple
        This thread's own, from ``cutouts.pixel_memory``.
    cutouts : Cutouts
    """
    levels, rows, columns = faces.shape
    for row in range(rows):
        for column in range(columns):
            kept = np.int64(0)
            for level in range(levels):
                face = np.int64(faces[level, row, column])
                if face < 0:
                    break
                if is_hole(face, column, first_row + row, memory, cutouts):
                    continue
                faces[kept, row, column] = faces[level, row, column]
                depths[kept, row, column] = depths[level, row, column]
                kept += 1
            for level in range(kept, levels):
                faces[level, row, column] = -1
