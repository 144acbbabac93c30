"""Products, lengths and rotations of vectors of three numbers, or arrays, summed left to right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the dot product."""
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


def cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    """Return the cross product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def length(a: Sequence[float]) -> float:
    """Return the length."""
    return math.sqrt(dot(a, a))


def unit(a: Sequence[float]) -> tuple[float, float, float]:
    """Return a vector that is not 0 at length 1, however large or small it is."""
    largest = max(map(abs, a))
    # So that squares neither overflow nor vanish.
    x, y, z = (part / largest for part in a)
    size = length((x, y, z))
    return (x / size, y / size, z / size)


def rotation_rows(axis: tuple[float, float, float], sine: Any, cosine: Any) -> list[list[Any]]:
    """Return the rows of rotations about a unit axis, given floats or arrays of sines, cosines."""
    x, y, z = axis
    rest = 1.0 - cosine
    # x² + c(y² + z²) is Rodrigues' c + (1 - c)x² without its cancellation.
    return [
        [x * x + cosine * (y * y + z * z), rest * x * y - sine * z, rest * x * z + sine * y],
        [rest * x * y + sine * z, y * y + cosine * (x * x + z * z), rest * y * z - sine * x],
        [rest * x * z - sine * y, rest * y * z + sine * x, z * z + cosine * (x * x + y * y)],
    ]
