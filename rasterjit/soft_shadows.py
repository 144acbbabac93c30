"""
Make what soft shadows are looked for with: points around a sample, and the highest of a map.

References
----------
.. [1] H. Vogel, "A better way to construct the sunflower head", Mathematical Biosciences 44, 1979.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rasterjit import transforms
from rasterjit.kernels import shadow_filters

COMPARISONS = 32
"""Points of the disk where soft shadows are compared."""

SPIRAL_GROWTH = 1.0905077326652577
"""Growth of the radius between two points of a spiral: eight to an octave."""

GOLDEN_TURN = 137.50776405003785
"""Degrees between the points of a sunflower: 180 (3 - sqrt 5)."""


def disk_points() -> NDArray[np.float32]:
    """Return points spread evenly over the unit disk, (COMPARISONS, 2), as in a sunflower [1]_."""
    points = []
    for n in range(COMPARISONS):
        radius = math.sqrt((n + 0.5) / COMPARISONS)
        sine, cosine = transforms.sine_cosine(n * GOLDEN_TURN)
        points.append((radius * cosine, radius * sine))
    return np.array(points, np.float32)


def spiral(size: int) -> NDArray[np.float32]:
    """
    Return points around a sample in a map of a side, (S, 2), texels: as dense as they are near.

    What shades a sample may be just above it or far: of each, the points see the same share.
    """
    points, radius = [], 1.0
    while radius <= float(shadow_filters.LARGEST_RADIUS) * size + 1.0:
        sine, cosine = transforms.sine_cosine(len(points) * GOLDEN_TURN)
        points.append((radius * cosine, radius * sine))
        radius *= SPIRAL_GROWTH
    return np.array(points, np.float32)


def write_highest(texels: NDArray[np.float32], highest: NDArray[np.float32]) -> None:
    """
    Write the greatest stored depth in each cell of a map.

    Parameters
    ----------
    texels : (S, S) float32
    highest : (CELLS, CELLS) float32
        Written; cells beyond the map keep what they hold.
    """
    side = -(-len(texels) // shadow_filters.CELLS)
    for row, top in enumerate(range(0, len(texels), side)):
        columns = texels[top : top + side].max(axis=0)
        for column, left in enumerate(range(0, len(texels), side)):
            highest[row, column] = columns[left : left + side].max()
