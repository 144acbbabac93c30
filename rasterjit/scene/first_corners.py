"""
Rotate the corners of faces, so that each begins with its least corner.

Kernels take the corners of a face as they are listed, and what they add up depends on where they
begin. So that spelling a face from another corner on changes no bit, nor numbering or sharing
vertices otherwise, a face begins with the corner whose coordinates are the least.
"""

from __future__ import annotations

import numpy as np

from rasterjit.scene.arrays import Bool, Float64, Int32, UInt8


def rotate_corners(vertices: Float64, faces: Int32) -> Int32:
    """
    Rotate faces so that each begins with its least corner: by x, then by y, then by z.

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
    x_a, x_b, x_c = x.take(a), x.take(b), x.take(c)
    is_last = _are_less(vertices, c, b, x_c < x_b, x_c == x_b)
    is_middle = _are_less(vertices, b, a, x_b < x_a, x_b == x_a) & ~is_last
    is_last &= _are_less(vertices, c, a, x_c < x_a, x_c == x_a)
    rotated = None
    for is_first, corners in ((is_middle, (b, c, a)), (is_last, (c, a, b))):
        face_ids = np.flatnonzero(is_first)
        if len(face_ids):
            rotated = faces.copy() if rotated is None else rotated
            for column, corner in enumerate(corners):
                rotated[face_ids, column] = corner[face_ids]
    return faces if rotated is None else rotated


def _are_less(vertices: Float64, first: Int32, second: Int32, less: Bool, same: Bool) -> Bool:
    """Tell whether the first vertex of each pair, (F,), is less, given how their x compare."""
    tied = np.flatnonzero(same)
    for axis in range(1, vertices.shape[1]):
        if not len(tied):
            break
        a, b = vertices[first[tied], axis], vertices[second[tied], axis]
        less[tied] = a < b
        tied = tied[a == b]
    return less


def corner_offsets(listed: Int32, rotated: Int32) -> UInt8:
    """Return the index in each listed face of its first corner after rotation: 0, 1 or 2, (F,)."""
    first = rotated[:, :1] == listed
    return np.argmax(first, axis=1).astype(np.uint8)
