"""
Skin vertices (linear blend skinning), and morph them.

A vertex is transformed by the weighted sum of its joints' matrices, each operation rounded once
and joints in their order: the same bits on every CPU, for any number of threads. Normals take the
inverse transpose of its 3 by 3 part, tangents the part itself.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), section 3.7.3.3.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64


@helper
def write_unit_vector(x, y, z, row, vectors):
    """Write a vector with length 1; zero if it is zero, or not finite."""
    largest = max(abs(x), abs(y), abs(z))
    if not (largest > 0.0 and largest < np.inf and x == x and y == y and z == z):
        vectors[row, 0] = 0.0
        vectors[row, 1] = 0.0
        vectors[row, 2] = 0.0
        return
    x, y, z = x / largest, y / largest, z / largest
    length = math.sqrt((x * x + y * y) + z * z)
    vectors[row, 0] = x / length
    vectors[row, 1] = y / length
    vectors[row, 2] = z / length


@kernel
def skin_vertices(
    vertex_range: (int64, int64), matrices: float64[:, :, ::1], joints: int32[:, ::1],
    weights: float64[:, ::1], positions: float64[:, ::1], normals: float32[:, ::1],
    tangents: float32[:, ::1],
):  # fmt: skip
    """
    Skin vertices, with their normals and tangents, in place.

    Parameters
    ----------
    vertex_range : (int, int)
        The first vertex, and one past the last.
    matrices : (J, 4, 4) float64
        ``world_from_model`` of each joint; the last rows are not read.
    joints : (V, K) int32
    weights : (V, K) float64
    positions : (V, 3) float64
        Changed: model space before, world space after.
    normals : (V, 3) float32, or (0, 3)
        Changed likewise; of unit length after, or zero.
    tangents : (V, 4) float32, or (0, 4)
        Changed likewise; the last column changes sign where the vertex's matrix mirrors.
    """
    for vertex in range(vertex_range[0], vertex_range[1]):
        # Blend the matrices.
        m00, m01, m02, m03 = 0.0, 0.0, 0.0, 0.0
        m10, m11, m12, m13 = 0.0, 0.0, 0.0, 0.0
        m20, m21, m22, m23 = 0.0, 0.0, 0.0, 0.0
        for k in range(joints.shape[1]):
            weight = weights[vertex, k]
            if weight == 0.0:
                continue
            m = matrices[joints[vertex, k]]
            m00 += weight * m[0, 0]
            m01 += weight * m[0, 1]
            m02 += weight * m[0, 2]
            m03 += weight * m[0, 3]
            m10 += weight * m[1, 0]
            m11 += weight * m[1, 1]
            m12 += weight * m[1, 2]
            m13 += weight * m[1, 3]
            m20 += weight * m[2, 0]
            m21 += weight * m[2, 1]
            m22 += weight * m[2, 2]
            m23 += weight * m[2, 3]
        # Move the vertex.
        x, y, z = positions[vertex, 0], positions[vertex, 1], positions[vertex, 2]
        positions[vertex, 0] = ((m00 * x + m01 * y) + m02 * z) + m03
        positions[vertex, 1] = ((m10 * x + m11 * y) + m12 * z) + m13
        positions[vertex, 2] = ((m20 * x + m21 * y) + m22 * z) + m23
        if normals.shape[0] + tangents.shape[0] == 0:
            continue
        # Scale the axes, so that their products neither overflow nor vanish.
        largest = max(
            abs(m00), abs(m01), abs(m02), abs(m10), abs(m11), abs(m12), abs(m20), abs(m21), abs(m22)
        )
        if largest > 0.0 and largest < np.inf:
            m00, m01, m02 = m00 / largest, m01 / largest, m02 / largest
            m10, m11, m12 = m10 / largest, m11 / largest, m12 / largest
            m20, m21, m22 = m20 / largest, m21 / largest, m22 / largest
        c00, c01, c02 = m11 * m22 - m12 * m21, m12 * m20 - m10 * m22, m10 * m21 - m11 * m20
        side = 1.0
        if (m00 * c00 + m01 * c01) + m02 * c02 < 0.0:
            side = -1.0
        if normals.shape[0]:
            c10, c11, c12 = m02 * m21 - m01 * m22, m00 * m22 - m02 * m20, m01 * m20 - m00 * m21
            c20, c21, c22 = m01 * m12 - m02 * m11, m02 * m10 - m00 * m12, m00 * m11 - m01 * m10
            x = side * np.float64(normals[vertex, 0])
            y = side * np.float64(normals[vertex, 1])
            z = side * np.float64(normals[vertex, 2])
            write_unit_vector(
                (c00 * x + c01 * y) + c02 * z, (c10 * x + c11 * y) + c12 * z,
                (c20 * x + c21 * y) + c22 * z, vertex, normals,
            )  # fmt: skip
        if tangents.shape[0]:
            x = np.float64(tangents[vertex, 0])
            y = np.float64(tangents[vertex, 1])
            z = np.float64(tangents[vertex, 2])
            write_unit_vector(
                (m00 * x + m01 * y) + m02 * z, (m10 * x + m11 * y) + m12 * z,
                (m20 * x + m21 * y) + m22 * z, vertex, tangents,
            )  # fmt: skip
            tangents[vertex, 3] = np.float32(side) * tangents[vertex, 3]


def apply_morph_targets(
    base: NDArray[np.float64], targets: NDArray[np.floating] | None, weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """
    Return vertex attributes displaced by morph targets, added in their order.

    Parameters
    ----------
    base : (V, 3) float64
    targets : (T, V, 3) float64 or float32, or None
    weights : (T,) float64
    """
    displaced = base.copy()
    if targets is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            for target, weight in zip(targets, weights.tolist(), strict=True):
                if weight != 0.0:
                    displaced += weight * target.astype(np.float64)
    return displaced
