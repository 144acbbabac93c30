"""
Compute the bounding box and sphere of points, and the smallest frustum around them.

For a frustum, points are in the axes of the camera, x to the right, y up, z towards the eye, about
any origin. An eye at (ex, ey, ez) sees a point at the slopes (x - ex) / (ez - z) and (y - ey) /
(ez - z). All points are inside a plane of the frustum, ``k * (x - ex) <= ez - z``, if the one
farthest along (k, 1) is. So two opposite planes give the nearest eye in closed form.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from rasterjit.scene.arrays import Float64

Chunks = Callable[[], Iterable[tuple[Float64, Float64 | None]]]
"""
Function that yields points block by block: positions, (N, 3), and radii, (N, 1), or ``None`` for
points without a size, all float64 and in one space.
"""

MIN_CLEARANCE = 2.0**-6
"""Least distance of the eye from the nearest point, in radii of the scene. It matters for a line
seen from its end, or the tip of a cone: they are so narrow that the eye would touch them."""

_MAX_NEWTON_STEPS = 64
"""Largest number of Newton steps, which approach the root from below; a few are usual."""

_MIN_STEP_RATIO = 2.0**-48
"""Least relative change of a slope after which another step follows."""

_MAX_CACHED_POINTS = 1 << 22
"""Largest number of cached points; more are transformed again on each pass."""


def cache_points(chunks: Chunks) -> Chunks:
    """Return a function that yields the same points, from memory if they are few."""
    blocks, count = [], 0
    for block in chunks():
        count += len(block[0])
        if count > _MAX_CACHED_POINTS:
            return chunks
        blocks.append(block)
    return lambda: blocks


def bound_points(chunks: Chunks) -> tuple[Float64, Float64]:
    """
    Return the smallest axis-aligned box around points and their radii.

    Returns
    -------
    low, high : (3,) float64
        In the space of the points.

    Raises
    ------
    ValueError
        If there is no point, or a coordinate is NaN.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    with np.errstate(over="ignore", invalid="ignore"):
        for positions, radii in chunks():
            lows, highs = positions, positions
            if radii is not None:
                lows, highs = positions - radii, positions + radii
            np.minimum(low, lows.min(axis=0), out=low)
            np.maximum(high, highs.max(axis=0), out=high)
    if not (low <= high).all():
        raise ValueError("scene has no face with a finite vertex, so it has no bounds")
    return low, high


def bound_points_by_sphere(chunks: Chunks) -> tuple[Float64, float]:
    """Return a bounding sphere: the centre of the points' box, (3,) float64, and its radius."""
    low, high = bound_points(chunks)
    with np.errstate(invalid="ignore"):
        center = low / 2.0 + high / 2.0
        scale = float((high / 2.0 - low / 2.0).max())
    if scale == 0.0:
        return center, 0.0
    largest = 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        for positions, radii in chunks():
            # In units of half the box's longest side, so that squares neither overflow nor vanish.
            offset = (positions - center) / scale
            x, y, z = offset.T
            squares = x * x + y * y + z * z
            if radii is None:
                largest = max(largest, math.sqrt(float(squares.max())))
            else:
                distances = np.sqrt(squares) + radii[:, 0] / scale
                largest = max(largest, float(distances.max()))
    return center, scale * largest


class PointBlock(NamedTuple):
    """A block of points in the axes of a camera, in radii of the scene."""

    x: Float64
    y: Float64
    z: Float64
    radii: Float64 | None
    """Radius of each point, (N,); ``None`` if all are 0."""


class AxisFit(NamedTuple):
    """Fit of the points along an axis of the picture."""

    offset: float
    """Offset of the eye from the origin along the axis."""
    slope: float
    """Largest slope of the points, the same on both sides; for a parallel camera, half their
    extent."""


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

    def __init__(self, chunks: Chunks, axes: Float64, center: Float64, radius: float) -> None:
        self._chunks, self._axes = chunks, axes.tolist()
        self._center, self._radius = center, radius
        self._blocks: list[PointBlock] | None = []
        self.nearest, self.farthest = -math.inf, math.inf
        count = 0
        for block in self._project():
            count += len(block.x)
            if count > _MAX_CACHED_POINTS:
                self._blocks = None
            elif self._blocks is not None:
                self._blocks.append(block)
            radii = 0.0 if block.radii is None else block.radii
            self.nearest = max(self.nearest, float((block.z + radii).max()))
            self.farthest = min(self.farthest, float((block.z - radii).min()))

    def _project(self) -> Iterator[PointBlock]:
        """Yield the points in the camera's axes, block by block."""
        for positions, radii in self._chunks():
            a, b, c = ((positions - self._center) / self._radius).T
            x, y, z = ((axis[0] * a + axis[1] * b) + axis[2] * c for axis in self._axes)
            yield PointBlock(x, y, z, None if radii is None else radii[:, 0] / self._radius)

    def find_max_extent(self, axis: str, axis_part: float, z_part: float) -> tuple[float, float]:
        """
        Return the largest extent of the points in a direction, and its derivative by ``z_part``.

        Parameters
        ----------
        axis : {"x", "y"}
            Axis of the picture.
        axis_part, z_part : float
            Components of the direction: along that axis, and towards the camera.
        """
        max_extent, derivative = -math.inf, 0.0
        length = math.sqrt(axis_part * axis_part + z_part * z_part)
        for block in self._project() if self._blocks is None else self._blocks:
            extents = axis_part * (block.x if axis == "x" else block.y)
            if z_part != 0.0:
                extents += z_part * block.z
            if block.radii is not None:
                extents += length * block.radii
            index = int(extents.argmax())
            if extents[index] > max_extent:
                max_extent = float(extents[index])
                derivative = float(block.z[index])
                if block.radii is not None:
                    derivative += float(block.radii[index]) * (z_part / length)
        return max_extent, derivative


def fit_perspective(
    points: ScenePoints, focal_x: float, focal_y: float
) -> tuple[float, tuple[AxisFit, AxisFit]]:
    """
    Find the nearest eye of a pinhole that sees all points, and centre them in the picture.

    Parameters
    ----------
    points : ScenePoints
    focal_x, focal_y : float
        One over the largest slope that is seen, for each axis.

    Returns
    -------
    eye_z : float
        In radii of the scene.
    fits : (AxisFit, AxisFit)
        For x and y. At least one of them has the slope ``1 / focal``, unless `MIN_CLEARANCE`
        keeps the eye away.
    """
    focals = {"x": focal_x, "y": focal_y}
    extents = {
        axis: [points.find_max_extent(axis, sign * focal, 1.0)[0] for sign in (1.0, -1.0)]
        for axis, focal in focals.items()
    }
    min_eye_z = {axis: 0.5 * (low + high) for axis, (high, low) in extents.items()}
    eye_z = max(*min_eye_z.values(), points.nearest + MIN_CLEARANCE)
    fits = []
    for axis, focal in focals.items():
        if min_eye_z[axis] == eye_z:
            high, low = extents[axis]
            fits.append(AxisFit(0.5 * (high - low) / focal, 1.0 / focal))
        else:
            fits.append(_center_axis(points, axis, eye_z, 1.0 / focal))
    return eye_z, (fits[0], fits[1])


def fit_parallel(points: ScenePoints) -> tuple[AxisFit, AxisFit]:
    """Return the middle and half the extent of all points along x and y."""
    fits = []
    for axis in ("x", "y"):
        high, low = (points.find_max_extent(axis, sign, 0.0)[0] for sign in (1.0, -1.0))
        fits.append(AxisFit(0.5 * (high - low), 0.5 * (high + low)))
    return fits[0], fits[1]


def _center_axis(points: ScenePoints, axis: str, eye_z: float, slope: float) -> AxisFit:
    """
    Find where an eye at a given z sees the points centred along an axis; ``slope`` is a start.

    The slope t on both sides is the root of ``2 * t * eye_z - extent(1, t) - extent(-1, t)``, which
    is concave and grows. Newton's steps approach it from below, wherever they begin.
    """
    for step in range(_MAX_NEWTON_STEPS):
        (high, high_derivative), (low, low_derivative) = (
            points.find_max_extent(axis, sign, slope) for sign in (1.0, -1.0)
        )
        residual = (high - slope * eye_z) + (low - slope * eye_z)
        change = residual / ((eye_z - high_derivative) + (eye_z - low_derivative))
        if step and change <= _MIN_STEP_RATIO * slope:
            break
        slope = max(slope + change, 0.0)
    return AxisFit(0.5 * (high - low), slope)
