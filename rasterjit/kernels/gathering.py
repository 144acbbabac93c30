"""
Gather the samples of a row, part by part: long runs of one face, and what lies between them.

Both leave what lighting needs in scratch memory, one row for each quantity (``lighting``).
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import runs
from rasterjit.kernels.interpolation import find_object
from rasterjit.kernels.jit import stage
from rasterjit.kernels.stretches import gather_stretch

LONG = runs.LANES
"""Columns that must show one face to make a run, counted from a multiple of this number on."""


@stage
def shows_one_face(faces, column):
    """Return whether a number of columns show one face."""
    face = faces[np.uintp(column)]
    return (
        column + LONG <= faces.shape[0]
        and faces[np.uintp(column + LONG - 1)] == face
        and runs.differences(faces[column : column + LONG], face) == 0
    )


@stage
def stretch_end(faces, column, first, last):
    """Return where neighbours end that show faces first..last - 1, or where a long run begins."""
    end = column + 1
    while end < faces.shape[0] and first <= faces[np.uintp(end)] < last:
        if end % LONG == 0 and shows_one_face(faces, end):
            break
        end += 1
    return end


@stage
def gather_row(
    faces, samples, weights, places, whole, real, gathered, left, row, geometry, placement,
    surface, lighting,
):  # fmt: skip
    """Gather the covered samples of a part of a row, which starts at ``left``; count them."""
    count, at, owner = np.int64(0), np.int64(0), np.int64(0)
    starts, (numbers, doubles, singles) = placement.face_starts, gathered
    while at < faces.shape[0]:
        face = np.int64(faces[np.uintp(at)])
        if face < 0:
            at = runs.run_end(faces, at)
            continue
        owner = find_object(face, starts, owner)
        if at % LONG == 0 and shows_one_face(faces, at):
            end = runs.run_end(faces, at)
            slot = runs.slot_of(face)
            if whole[slot, runs.FACE] != face:
                runs.set_up_face(
                    face, owner, whole[slot], real[slot], geometry, placement, surface, lighting
                )
            runs.gather_run(
                samples, weights, places, count, end - at, left + at, row, whole[slot],
                real[slot], geometry, placement, surface, lighting,
            )  # fmt: skip
        else:
            end = stretch_end(faces, at, starts[owner], starts[owner + 1])
            gather_stretch(
                faces[at:end], samples, weights, places, count, left + at, row, owner,
                numbers, doubles, singles, geometry, placement, surface, lighting,
            )  # fmt: skip
        count += end - at
        at = end
    return count
