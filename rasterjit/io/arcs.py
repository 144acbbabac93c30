"""Arcs of circles through three points: how far they reach, and points along them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_SAGITTA = 1e-4
"""Share of a drawing's extent by which segments may lie beside an arc: .4 pixels of 4096."""

_LONGEST_STEP = 0.08
"""Radians of a segment at most: of circles that are small in their drawing, but looked at."""

_FEWEST = 4
"""Segments of an arc."""

_STRAIGHT = 1e-7
"""Sine of the angle at which an arc is a line: its middle is seen nowhere else, and its centre lies
so far away that points around it are no longer exact."""


class Arc(NamedTuple):
    """
    An arc of a circle, in two or three dimensions.

    Parameters
    ----------
    center : (D,) float
    radius : float
    first, second : (D,) float
        Unit vectors at right angles: towards where the arc begins, and where it goes from there.
    span : float
        Radians, up to 2 pi.
    """

    center: NDArray[np.float64]
    radius: float
    first: NDArray[np.float64]
    second: NDArray[np.float64]
    span: float

    def at(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points, (N, D), at angles from the beginning."""
        along = np.cos(angles)[:, None] * self.first + np.sin(angles)[:, None] * self.second
        return self.center + self.radius * along

    def bounds(self) -> NDArray[np.float64]:
        """Return the corners of the box around the arc, (2, D)."""
        # Along each axis it reaches farthest where it begins or ends, or turns back.
        turns = np.arctan2(self.second, self.first)
        angles = np.concatenate([turns, turns + np.pi]) % (2.0 * np.pi)
        reached = self.at(np.append(angles[angles <= self.span], [0.0, self.span]))
        return np.array([reached.min(axis=0), reached.max(axis=0)])

    def segments(self, scale: float) -> int:
        """Return in how many segments it is cut in a drawing of an extent, which holds it."""
        beside = min(_SAGITTA * scale / self.radius, 1.0)
        step = min(4.0 * math.asin(math.sqrt(0.5 * beside)), _LONGEST_STEP)
        return max(math.ceil(self.span / step), _FEWEST)

    def points(
        self, segments: int, through: NDArray[np.float64], is_closed: bool
    ) -> NDArray[np.float64]:
        """Return points along it, (segments + 1, D), the ends just as they were given."""
        points = self.at(np.linspace(0.0, self.span, segments + 1))
        points[0] = through[0]
        points[-1] = through[0 if is_closed else -1]
        return points


def arc_through(points: NDArray[np.float64], is_closed: bool) -> Arc | None:
    """
    Return the arc from one point through a second to a third; None if they lie on a line.

    Parameters
    ----------
    points : (3, D) float
        Finite; D is 2 or 3.
    is_closed : bool
        The whole circle.

    Raises
    ------
    ValueError
        If there are not three points, they lie too far apart, or a circle's are on a line.
    """
    if len(points) != 3:
        raise ValueError(f"it must have 3 points, got {len(points)}")
    with np.errstate(over="ignore"):
        sides = points - points[0]
    size = float(np.abs(sides).max())
    if not math.isfinite(size):
        raise ValueError("its points lie too far apart")
    # Of size 1, no product is too large or too small for a float.
    flat = sides / size if size > 0.0 else sides
    middle, end = (np.append(side, 0.0)[:3] for side in flat[1:])
    normal = np.cross(middle, end)
    area, lengths = math.hypot(*normal), math.hypot(*middle) * math.hypot(*end)
    if area <= _STRAIGHT * lengths:
        if is_closed:
            raise ValueError(f"a circle's points must not lie on a line, got {points.tolist()}")
        return None
    across = (end @ end) * np.cross(normal, middle) - (middle @ middle) * np.cross(normal, end)
    center = across / (2.0 * area * area)
    radius = math.hypot(*center)
    first = -center / radius
    second = np.cross(normal / area, first)
    to_end = end - center
    angle = math.atan2(to_end @ second, to_end @ first) % (2.0 * math.pi)
    span = 2.0 * math.pi if is_closed else angle
    kept = points.shape[1]
    return Arc(points[0] + size * center[:kept], size * radius, first[:kept], second[:kept], span)
