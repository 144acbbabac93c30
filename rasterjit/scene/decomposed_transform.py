"""Convert between matrices and translation, rotation and scale, as in glTF."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene.validation import finite_array, triple
from rasterjit.scene.vectors import cross, dot

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class TRS(NamedTuple):
    """A translation, a rotation and a scale; points are scaled first and moved last."""

    translation: Triple = (0.0, 0.0, 0.0)
    """In units of the parent."""
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """Quaternion x, y, z, w, of any length but 0."""
    scale: Triple = (1.0, 1.0, 1.0)
    """Factors along the axes before rotation."""

    def with_(
        self,
        translation: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
    ) -> TRS:
        """Return the same with some parts replaced, or raise ``ValueError`` naming the part."""
        return TRS(
            self.translation if translation is None else triple("translation", translation),
            self.rotation if rotation is None else _check_quaternion(rotation),
            self.scale if scale is None else triple("scale", scale),
        )


def compose_trs(trs: TRS) -> NDArray[np.float64]:
    """Return the matrix, (4, 4), of a translation, a rotation and a scale."""
    return np.array(compose_rows(trs))


def compose_rows(trs: TRS) -> list[list[float]]:
    """Return the matrix of a translation, a rotation and a scale, as rows."""
    x, y, z, w = trs.rotation
    # A quaternion in float32 is a unit one to seven digits only.
    squared = ((x * x + y * y) + z * z) + w * w
    double = 2.0 / squared if squared > 0.0 else 0.0
    (a, b, c), (right, up, back) = trs.scale, trs.translation
    return [
        [
            (1.0 - double * (y * y + z * z)) * a, double * (x * y - z * w) * b,
            double * (x * z + y * w) * c, right,
        ],
        [
            double * (x * y + z * w) * a, (1.0 - double * (x * x + z * z)) * b,
            double * (y * z - x * w) * c, up,
        ],
        [
            double * (x * z - y * w) * a, double * (y * z + x * w) * b,
            (1.0 - double * (x * x + y * y)) * c, back,
        ],
        [0.0, 0.0, 0.0, 1.0],
    ]  # fmt: skip


def decompose(matrix: NDArray[np.float64]) -> TRS:
    """
    Decompose an affine matrix, (4, 4), into translation, rotation and scale.

    Of one that shears, those whose axes come near its own; of one that mirrors, the first factor is
    below 0.
    """
    rows = matrix.tolist()
    axes = [(rows[0][k], rows[1][k], rows[2][k]) for k in range(3)]
    lengths = [_length(axis) for axis in axes]
    # Make them perpendicular, one after the other; those that vanish take what is left.
    second, third = _unit(axes[1]), _unit(axes[2])
    x = _unit(axes[0])
    if x is None and second is not None and third is not None:
        x = _unit(cross(second, third))
    x = x or _perpendicular(second or third or (0.0, 0.0, 1.0))
    along = dot(x, axes[1])
    y = _unit(tuple(b - along * a for a, b in zip(x, axes[1], strict=True)))
    if y is None and third is not None:
        y = _unit(cross(third, x))
    y = y or _perpendicular(x)
    z = cross(x, y)
    if dot(z, axes[2]) < 0.0:
        lengths[0], x = -lengths[0], (-x[0], -x[1], -x[2])
        z = cross(x, y)
    translation = rows[0][3], rows[1][3], rows[2][3]
    return TRS(translation, quaternion_from_axes(x, y, z), (lengths[0], lengths[1], lengths[2]))


def _check_quaternion(value: ArrayLike) -> Quaternion:
    """Return four finite numbers, not all 0, or raise ``ValueError``."""
    x, y, z, w = finite_array("rotation", value, (4,)).tolist()
    squared = ((x * x + y * y) + z * z) + w * w
    if not 0.0 < squared < math.inf:
        raise ValueError(f"rotation must be a quaternion of any length but 0, got {(x, y, z, w)}")
    return x, y, z, w


def quaternion_from_axes(x: Triple, y: Triple, z: Triple) -> Quaternion:
    """Return the quaternion of the rotation whose axes these are, of length 1."""
    # The largest of the four is found first: the others are divided by it.
    squares = (
        x[0] - y[1] - z[2], y[1] - x[0] - z[2], z[2] - x[0] - y[1], x[0] + y[1] + z[2],
    )  # fmt: skip
    largest = max(range(4), key=lambda k: squares[k])
    half = 0.5 * math.sqrt(max(0.0, 1.0 + squares[largest]))
    rest = 0.25 / half
    xy, xz, yz = x[1] + y[0], x[2] + z[0], y[2] + z[1]
    wx, wy, wz = y[2] - z[1], z[0] - x[2], x[1] - y[0]
    candidates = (
        (half, rest * xy, rest * xz, rest * wx),
        (rest * xy, half, rest * yz, rest * wy),
        (rest * xz, rest * yz, half, rest * wz),
        (rest * wx, rest * wy, rest * wz, half),
    )
    return candidates[largest]


def _length(vector: Triple) -> float:
    """Return the length of a vector, whatever its size."""
    largest = max(map(abs, vector))
    if largest == 0.0:
        return 0.0
    a, b, c = (part / largest for part in vector)
    return largest * math.sqrt((a * a + b * b) + c * c)


def _unit(vector: tuple[float, ...]) -> Triple | None:
    """Return a vector of length 1, None for one of length 0."""
    x, y, z = vector
    length = _length((x, y, z))
    return (x / length, y / length, z / length) if length > 0.0 else None


def _perpendicular(axis: Triple) -> Triple:
    """Return a unit vector perpendicular to another."""
    least = min(range(3), key=lambda k: abs(axis[k]))
    other = tuple(1.0 if k == least else 0.0 for k in range(3))
    unit = _unit(cross(axis, other))
    assert unit is not None
    return unit
