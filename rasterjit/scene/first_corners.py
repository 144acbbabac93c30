"""
Which corner of a face comes first.

Kernels take the corners of a face as they are listed, and what they add up depends on where they
begin. So that spelling a face from another corner on changes no bit, nor numbering or sharing
vertices otherwise, a face begins with the corner whose coordinates are the least.
"""

from __future__ import annotations

import numpy as np

from rasterjit.scene.arrays import Bool, Float64, Int32, UInt8


def least_first(vertices: Float64, faces: Int32) -> Int32:
    """
    Rotate faces so that each begins with its least corner: by x, or where that is one by y, by z.

    Parameters
    ----------
    vertices : (V, K) float64
    faces : (F, 3) int32

    Returns
    -------
    (F, 3) int32
        The faces themselves if all begin so. One of which two corners are at one place, or not a
        number, stays as it is unless another is less.
    """
    a, b, c = faces.T
    x = np.ascontiguousarray(vertices[:, 0])
    of_a, of_b, of_c = x.take(a), x.take(b), x.take(c)
    is_last = _are_less(vertices, c, b, of_c < of_b, of_c == of_b)
    is_middle = _are_less(vertices, b, a, of_b < of_a, of_b == of_a) & ~is_last
    is_last &= _are_less(vertices, c, a, of_c < of_a, of_c == of_a)
    rotated = None
    for is_first, corners in ((is_middle, (b, c, a)), (is_last, (c, a, b))):
        moved = np.flatnonzero(is_first)
        if len(moved):
            rotated = faces.copy() if rotated is None else rotated
            for place, corner in enumerate(corners):
                rotated[moved, place] = corner[moved]
    return faces if rotated is None else rotated


def _are_less(vertices: Float64, some: Int32, others: Int32, less: Bool, same: Bool) -> Bool:
    """Tell of pairs of vertices, (F,), whether the first has the lesser coordinates, x known."""
    tied = np.flatnonzero(same)
    for axis in range(1, vertices.shape[1]):
        if not len(tied):
            break
        own, other = vertices[some[tied], axis], vertices[others[tied], axis]
        less[tied] = own < other
        tied = tied[own == other]
    return less


def listed_places(listed: Int32, rotated: Int32) -> UInt8:
    """Return at which place of a face, as it is listed, its first corner is: 0, 1 or 2, (F,)."""
    first = rotated[:, :1] == listed
    return np.argmax(first, axis=1).astype(np.uint8)
