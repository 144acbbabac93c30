"""
Unproject: find the point seen at a pixel from its stored depth, for any camera.

Clip x, y, w and the stored depth times w are linear in the homogeneous point. So the point is
linear in column, row, stored depth and 1: `relative_from_pixel` is the (4, 4) float32 matrix of
these, its rows homogeneous points in world axes relative to the eye. Visible points have w > 0.
"""

from __future__ import annotations

from rasterjit.runtime.jit import helper


@helper
def unproject_pixel(relative_from_pixel, column, row, depth):
    """Return the point seen at a pixel, and its w."""
    across, down, deeper, origin = relative_from_pixel
    w = origin[3] + column * across[3] + row * down[3] + depth * deeper[3]
    x = origin[0] + column * across[0] + row * down[0] + depth * deeper[0]
    y = origin[1] + column * across[1] + row * down[1] + depth * deeper[1]
    z = origin[2] + column * across[2] + row * down[2] + depth * deeper[2]
    return x / w, y / w, z / w, w


@helper
def scaled_derivative(matrix_row, x, y, z):
    """
    Return w times the derivative of a point by the column, row or depth of a matrix row.

    The offset to the point ``i`` columns, ``j`` rows and ``d`` of depth away is the sum of ``i``,
    ``j`` and ``d`` times the three derivatives, over that point's w; exact up to the differences.
    """
    return (
        matrix_row[0] - x * matrix_row[3],
        matrix_row[1] - y * matrix_row[3],
        matrix_row[2] - z * matrix_row[3],
    )
