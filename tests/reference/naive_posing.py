"""
Poses by the equations of the glTF 2.0 specification, one number after the other.

Skins: section 3.7.3.3; morph targets: 3.7.2.2; animations: 3.11 and Appendix C.
"""

from __future__ import annotations

import bisect
import math


def product(a, b):
    """Return the product of two 4x4 matrices, given and returned as rows."""
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def trs_matrix(translation, rotation, scale):
    """Return T R S as rows; the rotation is a unit quaternion x, y, z, w."""
    x, y, z, w = rotation
    turned = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    rows = [[turned[i][j] * scale[j] for j in range(3)] + [translation[i]] for i in range(3)]
    return [*rows, [0.0, 0.0, 0.0, 1.0]]


def morphed(base, targets, weights):
    """Return vectors moved by the weighted sum of their displacements."""
    return [
        [
            float(base[v][k])
            + sum(float(w) * float(t[v][k]) for w, t in zip(weights, targets, strict=True))
            for k in range(3)
        ]
        for v in range(len(base))
    ]


def blended(joints, weights, joint_worlds, inverse_binds):
    """Return the matrix of one vertex: the weighted sum of those of its joints."""
    total = [[0.0] * 4 for _ in range(4)]
    for joint, weight in zip(joints, weights, strict=True):
        matrix = product(joint_worlds[int(joint)], inverse_binds[int(joint)])
        for i in range(4):
            for j in range(4):
                total[i][j] += float(weight) * matrix[i][j]
    return total


def moved(matrix, point):
    """Return a point moved by a matrix."""
    x, y, z = map(float, point)
    return [row[0] * x + row[1] * y + row[2] * z + row[3] for row in matrix[:3]]


def moved_normal(matrix, normal):
    """Return a unit normal moved by the inverse transpose of a matrix's axes."""
    m = [row[:3] for row in matrix[:3]]
    cofactors = [
        [
            m[(i + 1) % 3][(j + 1) % 3] * m[(i + 2) % 3][(j + 2) % 3]
            - m[(i + 1) % 3][(j + 2) % 3] * m[(i + 2) % 3][(j + 1) % 3]
            for j in range(3)
        ]
        for i in range(3)
    ]
    determinant = sum(m[0][j] * cofactors[0][j] for j in range(3))
    return unit(
        [
            sum(c * float(n) for c, n in zip(row, normal, strict=True)) / determinant
            for row in cofactors
        ]
    )


def moved_direction(matrix, direction):
    """Return a unit tangent moved by a matrix's axes."""
    return unit([sum(row[k] * float(direction[k]) for k in range(3)) for row in matrix[:3]])


def unit(vector):
    """Return a vector of length one."""
    length = math.sqrt(sum(part * part for part in vector))
    return [part / length for part in vector]


def value_at(path, times, values, interpolation, time):
    """Return what a sampler gives at a time, seconds."""
    times = [float(one) for one in times]
    is_spline = interpolation == "CUBICSPLINE"
    keys = [list(map(float, value[1] if is_spline else value)) for value in values]

    def done(value):
        return unit(value) if path == "rotation" else value

    if time <= times[0]:
        return done(keys[0])
    if time >= times[-1]:
        return done(keys[-1])
    k = bisect.bisect_right(times, time) - 1
    if interpolation == "STEP":
        return done(keys[k])
    span = times[k + 1] - times[k]
    t = (time - times[k]) / span
    if is_spline:
        ahead, behind = values[k][2], values[k + 1][0]
        return done(
            [
                (2 * t**3 - 3 * t**2 + 1) * keys[k][n]
                + span * (t**3 - 2 * t**2 + t) * float(ahead[n])
                + (-2 * t**3 + 3 * t**2) * keys[k + 1][n]
                + span * (t**3 - t**2) * float(behind[n])
                for n in range(len(keys[k]))
            ]
        )
    if path == "rotation":
        return spherical(unit(keys[k]), unit(keys[k + 1]), t)
    return [(1 - t) * a + t * b for a, b in zip(keys[k], keys[k + 1], strict=True)]


def spherical(first, second, t):
    """Return the spherical linear interpolation of two unit quaternions, Appendix C.4."""
    d = sum(a * b for a, b in zip(first, second, strict=True))
    angle, sign = math.acos(min(abs(d), 1.0)), math.copysign(1.0, d)
    if angle < 1e-9:
        return unit([(1 - t) * a + sign * t * b for a, b in zip(first, second, strict=True)])
    one, other = math.sin(angle * (1 - t)) / math.sin(angle), math.sin(angle * t) / math.sin(angle)
    return [one * a + sign * other * b for a, b in zip(first, second, strict=True)]
