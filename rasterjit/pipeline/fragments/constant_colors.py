"""
Average samples of objects with one constant colour each, as 8-bit codes, without shading.

The bits are those of ``coverage_resolve``: means of at most 16 codes are exact in float32, too.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.setup import find_last_at_most
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import int32, int64, uint32

COLUMNS_PER_TEST = 16
"""Pixels of a row tested together: usually all their samples are equal."""


@disjoint_helper
def extend_range(least, most, faces):
    """Extend a range of face numbers by some faces."""
    for i in range(faces.shape[0]):
        least = min(least, faces[i])
        most = max(most, faces[i])
    return least, most


@disjoint_helper
def fill_codes(color, code):
    """Write a code to a part of a row."""
    for i in range(color.shape[0]):
        color[i] = code


@helper
def average_pixel(opaque, row, column, codes, background, face_starts, owner):
    """Return the mean code of a pixel's samples, half up, and the last object in it."""
    count = np.uint32(opaque.shape[0])
    red = green = blue = count >> np.uint32(1)
    code = background
    for sample in range(opaque.shape[0]):
        face = np.int64(opaque[sample, row, column])
        if face < 0:
            code = background
        else:
            if face < face_starts[owner] or face >= face_starts[owner + 1]:
                owner = find_last_at_most(face_starts, face)
            code = codes[owner]
        red += code & np.uint32(255)
        green += (code >> np.uint32(8)) & np.uint32(255)
        blue += (code >> np.uint32(16)) & np.uint32(255)
    opacity = code & np.uint32(0xFF000000)
    return (
        red // count | (green // count) << np.uint32(8) | (blue // count) << np.uint32(16) | opacity
    ), owner


@kernel
def average_codes(
    opaque: int32[:, :, ::1], codes: uint32[::1], background: int64, face_starts: int64[::1],
    color: uint32[:, ::1],
):  # fmt: skip
    """
    Write the mean code of each pixel of some rows.

    Parameters
    ----------
    opaque : (N, R, W) int32
        The face at each sample, -1 where there is none.
    codes : (O,) uint32
        The code of each object: RGBA bytes from the lowest up; alpha 255.
    background : int
        The code where no face is.
    face_starts : (O+1,) int64
        Object ``o`` owns faces ``face_starts[o]:face_starts[o+1]``.
    color : (R, W) uint32
        Written.
    """
    owner, nothing, width = np.int64(0), np.uint32(background), color.shape[1]
    for row in range(color.shape[0]):
        for left in range(0, width, COLUMNS_PER_TEST):
            right = min(left + COLUMNS_PER_TEST, width)
            least = most = opaque[0, row, left]
            for sample in range(opaque.shape[0]):
                least, most = extend_range(least, most, opaque[sample, row, left:right])
            if most < 0:
                fill_codes(color[row, left:right], nothing)
                continue
            if least >= 0:
                if least < face_starts[owner] or least >= face_starts[owner + 1]:
                    owner = find_last_at_most(face_starts, np.int64(least))
                if most < face_starts[owner + 1]:
                    fill_codes(color[row, left:right], codes[owner])
                    continue
            for column in range(left, right):
                color[row, column], owner = average_pixel(
                    opaque, row, column, codes, nothing, face_starts, owner
                )
