"""Dot and cross products and lengths of vectors of three plain floats, summed left to right."""

from __future__ import annotations

import math
from collections.abc import Sequence


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the dot product."""
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


def cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    """Return the cross product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def length(a: Sequence[float]) -> float:
    """Return the length."""
    return math.sqrt(dot(a, a))
