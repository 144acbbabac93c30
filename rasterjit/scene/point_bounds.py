"""
How far points reach: the box and the sphere around them, and the frustum that they fit into.

For a frustum, points are in the axes of the camera, x to the right, y up, z towards the eye, about
any origin. An eye at (ex, ey, ez) sees a point at the slopes (x - ex) / (ez - z) and (y - ey) /
(ez - z). A side of the frustum, ``k * (x - ex) <= ez - z``, holds for all points if it holds for
the one that reaches farthest along (k, 1). So two opposite sides say in closed form how near the
eye may come.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from rasterjit.scene.arrays import Float64

Chunks = Callable[[], Iterable[tuple[Float64, Float64 | None]]]
"""
Returns points, some at a time: positions (N, 3), and half the size of what is drawn at each,
(N, 1), or ``None`` if they have no sizes.
"""

MIN_CLEARANCE = 2.0**-6
"""Least distance of the eye from what is nearest to it, in radii of the scene: neither a line seen
from its end nor the tip of a cone has a width that keeps the eye away."""

_MAX_STEPS = 64
"""Newton steps, each of which comes nearer to the root from below; a few are usual."""

_STEP = 2.0**-48
"""Share of a slope by which a step must change it to be worth another one."""

_MAX_KEPT = 1 << 22
"""Points that are kept in memory; more are transformed again whenever they are looked at."""


def kept(chunks: Chunks) -> Chunks:
    """Return a callable that yields the same points; it transforms few of them only once."""
    found, count = [], 0
    for one in chunks():
        count += len(one[0])
        if count > _MAX_KEPT:
            return chunks
        found.append(one)
    return lambda: found


def box_around(chunks: Chunks) -> tuple[Float64, Float64]:
    """
    Return the smallest axis-parallel box around points, and half their sizes.

    Returns
    -------
    low, high : (3,) float64

    Raises
    ------
    ValueError
        If there is no point.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    with np.errstate(over="ignore", invalid="ignore"):
        for positions, halves in chunks():
            lows, highs = positions, positions
            if halves is not None:
                lows, highs = positions - halves, positions + halves
            np.minimum(low, lows.min(axis=0), out=low)
            np.maximum(high, highs.max(axis=0), out=high)
    if not (low <= high).all():
        raise ValueError("scene has no face with a finite vertex, so it has no bounds")
    return low, high


def sphere_around(chunks: Chunks) -> tuple[Float64, float]:
    """Return the middle of the box around points, (3,) float64, and the radius around all."""
    low, high = box_around(chunks)
    with np.errstate(invalid="ignore"):
        center = low / 2.0 + high / 2.0
        scale = float((high / 2.0 - low / 2.0).max())
    if scale == 0.0:
        return center, 0.0
    largest = 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        for positions, halves in chunks():
            # Measured in units of the box, so that squares neither overflow nor vanish.
            offset = (positions - center) / scale
            x, y, z = offset.T
            squares = x * x + y * y + z * z
            if halves is None:
                largest = max(largest, math.sqrt(float(squares.max())))
            else:
                reaches = np.sqrt(squares) + halves[:, 0] / scale
                largest = max(largest, float(reaches.max()))
    return center, scale * largest


class Row(NamedTuple):
    """Some points in the axes of a camera, in radii of the scene."""

    x: Float64
    y: Float64
    z: Float64
    halves: Float64 | None
    """Radius of the ball that is drawn at each; ``None``: of no size."""


class AxisSpan(NamedTuple):
    """How an axis of the picture is filled."""

    offset: float
    """Of the eye from the origin along it."""
    slope: float
    """At which the points reach farthest from the middle, the same on both sides; of a parallel
    camera half their extent."""


class ScenePoints:
    """
    All points of a scene in the axes of a camera.

    Parameters
    ----------
    chunks : Chunks
        In world space.
    axes : (3, 3) float64
        Rows: right, up and towards the camera.
    center : (3,) float64
        Becomes the origin.
    radius : float
        Of the scene, its unit from here on.

    Attributes
    ----------
    nearest, farthest : float
        The largest and the least z.
    """

    def __init__(
        self,
        chunks: Chunks,
        axes: Float64,
        center: Float64,
        radius: float,
    ) -> None:
        self._chunks, self._axes = chunks, axes.tolist()
        self._center, self._radius = center, radius
        self._kept: list[Row] | None = []
        self.nearest, self.farthest = -math.inf, math.inf
        count = 0
        for row in self._project():
            count += len(row.x)
            if count > _MAX_KEPT:
                self._kept = None
            elif self._kept is not None:
                self._kept.append(row)
            halves = 0.0 if row.halves is None else row.halves
            self.nearest = max(self.nearest, float((row.z + halves).max()))
            self.farthest = min(self.farthest, float((row.z - halves).min()))

    def _project(self) -> Iterator[Row]:
        """Yield the points, some at a time."""
        for positions, halves in self._chunks():
            a, b, c = ((positions - self._center) / self._radius).T
            x, y, z = ((row[0] * a + row[1] * b) + row[2] * c for row in self._axes)
            yield Row(x, y, z, None if halves is None else halves[:, 0] / self._radius)

    def reach(self, axis: str, across: float, along: float) -> tuple[float, float]:
        """
        Return how far the points reach along (across, along), and how that grows with ``along``.

        Parameters
        ----------
        axis : {"x", "y"}
            Of the picture.
        across, along : float
            Components along it and towards the camera.
        """
        best, growth = -math.inf, 0.0
        length = math.sqrt(across * across + along * along)
        for row in self._project() if self._kept is None else self._kept:
            reached = across * (row.x if axis == "x" else row.y)
            if along != 0.0:
                reached += along * row.z
            if row.halves is not None:
                reached += length * row.halves
            place = int(reached.argmax())
            if reached[place] > best:
                best = float(reached[place])
                growth = float(row.z[place])
                if row.halves is not None:
                    growth += float(row.halves[place]) * (along / length)
        return best, growth


def fit_perspective(
    cloud: ScenePoints, focal_x: float, focal_y: float
) -> tuple[float, tuple[AxisSpan, AxisSpan]]:
    """
    Return where the eye of a pinhole is that sees all points as large as possible, in the middle.

    Parameters
    ----------
    cloud : ScenePoints
    focal_x, focal_y : float
        One over the slope that the points may reach, of each axis.

    Returns
    -------
    eye_z : float
    spans : (AxisSpan, AxisSpan)
        Of x and y. At least one of them has the slope ``1 / focal``, unless `MIN_CLEARANCE`
        keeps the eye away.
    """
    focals = {"x": focal_x, "y": focal_y}
    sides = {
        axis: [cloud.reach(axis, sign * focal, 1.0)[0] for sign in (1.0, -1.0)]
        for axis, focal in focals.items()
    }
    needs = {axis: 0.5 * (low + high) for axis, (high, low) in sides.items()}
    eye = max(*needs.values(), cloud.nearest + MIN_CLEARANCE)
    spans = []
    for axis, focal in focals.items():
        if needs[axis] == eye:
            high, low = sides[axis]
            spans.append(AxisSpan(0.5 * (high - low) / focal, 1.0 / focal))
        else:
            spans.append(_centered(cloud, axis, eye, 1.0 / focal))
    return eye, (spans[0], spans[1])


def fit_parallel(cloud: ScenePoints) -> tuple[AxisSpan, AxisSpan]:
    """Return the middle and half the extent of all points along x and y."""
    spans = []
    for axis in ("x", "y"):
        high, low = (cloud.reach(axis, sign, 0.0)[0] for sign in (1.0, -1.0))
        spans.append(AxisSpan(0.5 * (high - low), 0.5 * (high + low)))
    return spans[0], spans[1]


def _centered(cloud: ScenePoints, axis: str, eye: float, slope: float) -> AxisSpan:
    """
    Return how an axis is filled that has room, seen from a given z.

    The slope t on both sides is the root of ``2 * t * eye - reach(1, t) - reach(-1, t)``, which is
    concave and grows. Newton's steps come to it from below, wherever they begin.
    """
    for step in range(_MAX_STEPS):
        (high, right), (low, left) = (cloud.reach(axis, sign, slope) for sign in (1.0, -1.0))
        missing = (high - slope * eye) + (low - slope * eye)
        change = missing / ((eye - right) + (eye - left))
        if step and change <= _STEP * slope:
            break
        slope = max(slope + change, 0.0)
    return AxisSpan(0.5 * (high - low), slope)
