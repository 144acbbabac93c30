"""
Lenses: where on a picture a direction is seen, where a pinhole would not show it there.

The axes of a lens are OpenCV's: x to the right, y down, z ahead. A lens takes directions to places
and back: points of the plane z = 1 for the two models of OpenCV, which a camera's focal lengths and
principal point then take to pixels; longitude and latitude for a panorama.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, fields
from itertools import pairwise, zip_longest
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rasterjit.forks import cached_property
from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Bool, Float64
from rasterjit.scene.attribute_guard import says_replace, store
from rasterjit.scene.portable_trig import arc_tangent, polynomial, sine_cosine

Coefficients = tuple[float, ...]

NODES = 4096
"""Places at which a radial curve is known, to begin the search for its inverse."""

STEPS = 5
"""Of Newton's method, whose error is squared by each."""

MORE_STEPS = 20
"""Where these were not enough."""

MIN_STEP = 1e-13
"""Most that is left of a place, as a share of its size and 1, where the inverse is found."""

BLOCK = 4096
"""Places at once: the columns in use stay in the caches."""

MAX = 1e15
"""Largest coefficient, and coordinate of a point that is asked for: products are numbers still."""

FARTHEST = 1e4
"""Largest radius that is looked at, tangent of the angle from the axis."""


@says_replace
@dataclass(frozen=True)
class PinholeDistortion:
    """
    OpenCV's model of a camera with lens: radial, tangential, thin prism and tilt [1]_.

    The coefficients are in the order of OpenCV's ``distCoeffs``, so that
    ``PinholeDistortion(*dist.ravel())`` takes its 4, 5, 8, 12 or 14 numbers. All are 0 by default,
    which distorts nothing.

    Parameters
    ----------
    k1, k2, k3, k4, k5, k6 : float
        Radial: a point at distance r from the axis, on the plane z = 1, is moved to r times
        ``(1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)``.
    p1, p2 : float
        Tangential.
    s1, s2, s3, s4 : float
        Thin prism.
    tau_x, tau_y : float, radians
        Tilt of the sensor, as OpenCV has it; each within -1.5..1.5.

    Raises
    ------
    ValueError
        If a coefficient is no finite number.

    References
    ----------
    .. [1] OpenCV 4, "Camera Calibration and 3D Reconstruction": distortion coefficients.

    Examples
    --------
    >>> import rasterjit as rj
    >>> lens = rj.PinholeDistortion(k1=-0.28, k2=0.07, p1=2e-4)
    >>> frame = rj.render(rj.load("models/teapot.obj"), size=(320, 240), lens=lens)
    """

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    s1: float = 0.0
    s2: float = 0.0
    s3: float = 0.0
    s4: float = 0.0
    tau_x: float = 0.0
    tau_y: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            number = check.bounded_number(field.name, getattr(self, field.name), -MAX, MAX)
            if field.name.startswith("tau"):
                number = check.bounded_number(field.name, number, -1.5, 1.5)
            store(self, **{field.name: number})

    def distort(self, points: ArrayLike) -> Float64:
        """
        Return where points of the plane z = 1 are seen on it.

        Parameters
        ----------
        points : (..., 2) array_like of float
            x / z to the right and y / z down, without unit.

        Returns
        -------
        (..., 2) float64
            Times the focal lengths, plus the principal point: pixels.
        """
        x, y = _points("points", points)
        u, v = self._bent(x, y)[:2]
        a, b, c = self._tilt
        scale = (c[0] * u + c[1] * v) + c[2]
        places = ((a[0] * u + a[1] * v) + a[2]) / scale, ((b[0] * u + b[1] * v) + b[2]) / scale
        return np.stack(places, axis=-1)

    def undistort(self, places: ArrayLike) -> Float64:
        """
        Return the points of the plane z = 1 that are seen at places on it: the inverse.

        Parameters
        ----------
        places : (..., 2) array_like of float

        Returns
        -------
        (..., 2) float64
            To some 1e-15 of a radius of 1, and less exactly next to a fold.

        Raises
        ------
        ValueError
            If nothing is seen at one of them, as the distortion folds before: naming the radius.
        """
        points = self.directions(np.stack(_points("places", places), axis=-1))[..., :2]
        if not np.isfinite(points).all():
            raise ValueError(f"places must be where the lens shows something: {self.limit}")
        return points

    def directions(self, places: ArrayLike) -> Float64:
        """Return what is seen at places, (..., 2): directions (..., 3), NaN where nothing is."""
        return _in_blocks(self._directions, _columns("places", places, 2))

    def _directions(self, u: Float64, v: Float64) -> Float64:
        """Return the directions, (N, 3), at places (N,)."""
        # The tilt is a projection of the plane to itself: its inverse is one, too.
        a, b, c = self._untilt
        scale = (c[0] * u + c[1] * v) + c[2]
        u, v = ((a[0] * u + a[1] * v) + a[2]) / scale, ((b[0] * u + b[1] * v) + b[2]) / scale
        # Begin as if the lens were round.
        radius = np.sqrt(u * u + v * v)
        begin = self._curve.inverse(radius) / np.where(radius > 0.0, radius, 1.0)
        x, y = u * begin, v * begin
        with np.errstate(all="ignore"):
            x, y, is_found = self._refined(u, v, x, y, STEPS)
            lost = ~is_found
            if lost.any():
                # Some are far from where a round lens would show them.
                x[lost], y[lost], is_found[lost] = self._refined(
                    u[lost], v[lost], x[lost], y[lost], MORE_STEPS
                )
            is_found &= (scale > 0.0) & (x * x + y * y < self._curve.fold * self._curve.fold)
        x, y = np.where(is_found, x, np.nan), np.where(is_found, y, np.nan)
        return np.stack((x, y, np.where(is_found, 1.0, np.nan)), axis=-1)

    def _refined(
        self, u: Float64, v: Float64, x: Float64, y: Float64, steps: int
    ) -> tuple[Float64, Float64, Bool]:
        """Return points that are seen nearer to places than given ones, and which are there."""
        for _ in range(steps):
            at_u, at_v, (xx, xy, yx, yy) = self._bent(x, y)
            left_u, left_v, turn = u - at_u, v - at_v, xx * yy - xy * yx
            x = x + (yy * left_u - xy * left_v) / turn
            y = y + (xx * left_v - yx * left_u) / turn
        at_u, at_v, (xx, xy, yx, yy) = self._bent(x, y)
        left, size = np.abs(u - at_u) + np.abs(v - at_v), 1.0 + np.abs(u) + np.abs(v)
        return x, y, (left <= MIN_STEP * size) & (xx * yy - xy * yx > 0.0)

    def places(self, directions: ArrayLike) -> Float64:
        """Return where directions, (..., 3), are seen: places (..., 2), NaN where they are not."""
        x, y, z = _columns("directions", directions, 3)
        with np.errstate(all="ignore"):
            x, y = x / z, y / z
            is_seen = (z > 0.0) & (x * x + y * y < self._curve.fold * self._curve.fold)
            is_seen &= np.maximum(np.abs(x), np.abs(y)) <= MAX
            points = np.where(is_seen[..., np.newaxis], np.stack((x, y), -1), 0.0)
            return np.where(is_seen[..., np.newaxis], self.distort(points), np.nan)

    @property
    def limit(self) -> str:
        """The radius beyond which it folds, in words."""
        fold = self._curve.fold
        if fold == math.inf:
            return "beyond, the distortion is not invertible"
        return (
            f"the radial distortion folds beyond a radius of {fold:.4g} (tangent of the angle from "
            f"the axis), which it shows at {float(self._curve.at(np.array(fold))):.4g} focal "
            "lengths from the principal point"
        )

    @property
    def reach(self) -> float:
        """Largest angle from the axis that it shows, radians."""
        return math.pi / 2.0

    @cached_property
    def _curve(self) -> _Curve:
        above, below = (1.0, self.k1, self.k2, self.k3), (1.0, self.k4, self.k5, self.k6)
        return _Curve(above, below, FARTHEST)

    def _bent(self, x: Float64, y: Float64) -> tuple[Float64, Float64, tuple[Float64, ...]]:
        """Return where points are seen before the tilt, and how both places change with both."""
        curve, q = self._curve, x * x + y * y
        scale, growth = curve.scale(q)
        prism_x, prism_y = self.s1 + self.s2 * q, self.s3 + self.s4 * q
        u = x * scale + 2.0 * self.p1 * x * y + self.p2 * (q + 2.0 * x * x) + prism_x * q
        v = y * scale + self.p1 * (q + 2.0 * y * y) + 2.0 * self.p2 * x * y + prism_y * q
        more_x, more_y = self.s1 + 2.0 * self.s2 * q, self.s3 + 2.0 * self.s4 * q
        mixed = 2.0 * x * y * growth
        slopes = (
            scale + 2.0 * x * x * growth + 2.0 * self.p1 * y + 6.0 * self.p2 * x + 2.0 * x * more_x,
            mixed + 2.0 * self.p1 * x + 2.0 * self.p2 * y + 2.0 * y * more_x,
            mixed + 2.0 * self.p1 * x + 2.0 * self.p2 * y + 2.0 * x * more_y,
            scale + 2.0 * y * y * growth + 6.0 * self.p1 * y + 2.0 * self.p2 * x + 2.0 * y * more_y,
        )
        return u, v, slopes

    @cached_property
    def _tilt(self) -> list[list[float]]:
        (sine_x, sine_y), (cosine_x, cosine_y) = (
            part.tolist() for part in sine_cosine(np.array([self.tau_x, self.tau_y]))
        )
        # The rotation about y after that about x, then back to the plane along the axis.
        turn = [
            [cosine_y, sine_y * sine_x, -sine_y * cosine_x],
            [0.0, cosine_x, sine_x],
            [sine_y, -cosine_y * sine_x, cosine_y * cosine_x],
        ]
        a, b, c = turn
        deep = c[2]
        return [
            [deep * a[k] - a[2] * c[k] for k in range(3)],
            [deep * b[k] - b[2] * c[k] for k in range(3)],
            c,
        ]

    @cached_property
    def _untilt(self) -> list[list[float]]:
        (a, b, c), (d, e, f), (g, h, i) = self._tilt
        rows = [
            [e * i - f * h, c * h - b * i, b * f - c * e],
            [f * g - d * i, a * i - c * g, c * d - a * f],
            [d * h - e * g, b * g - a * h, a * e - b * d],
        ]
        # Of a projection only ratios matter, but the sign tells what lies behind.
        volume = (a * rows[0][0] + b * rows[1][0]) + c * rows[2][0]
        return [[entry / volume for entry in row] for row in rows]


@says_replace
@dataclass(frozen=True)
class FisheyeLens:
    """
    OpenCV's fisheye model [1]_: the angle from the axis is bent, not its tangent.

    What lies at an angle t from the axis, in radians, is seen at a distance of
    ``t (1 + k1 t² + k2 t⁴ + k3 t⁶ + k4 t⁸)`` focal lengths from the principal point. With four
    zeros, the default, it is the equidistant fisheye.

    Parameters
    ----------
    k1, k2, k3, k4 : float
    field : float, degrees
        Field of view of the lens, above 0 and at most 360: what lies farther from the axis than
        half of it is not seen, and the picture is empty there, as around a circular fisheye.

    Raises
    ------
    ValueError
        If a coefficient is no finite number, or the field is not in that range.

    References
    ----------
    .. [1] OpenCV 4, "Fisheye camera model", after J. Kannala, S. Brandt, "A Generic Camera Model
       and Calibration Method for Conventional, Wide-Angle, and Fish-Eye Lenses", PAMI 28(8), 2006.

    Examples
    --------
    >>> import rasterjit as rj
    >>> lens = rj.FisheyeLens(k1=-0.02, k2=0.003, field=190.0)
    >>> frame = rj.render(rj.load("models/teapot.obj"), size=(320, 240), lens=lens)
    """

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    _: KW_ONLY
    field: float = 360.0

    def __post_init__(self) -> None:
        for name in ("k1", "k2", "k3", "k4"):
            store(self, **{name: check.bounded_number(name, getattr(self, name), -MAX, MAX)})
        field = check.bounded_number("field", self.field, 0.0, 360.0)
        if field == 0.0:
            raise ValueError(f"field must be above 0, got {self.field!r}")
        store(self, field=field)

    def distort(self, points: ArrayLike) -> Float64:
        """
        Return where points of the plane z = 1 are seen on it.

        Parameters
        ----------
        points : (..., 2) array_like of float
            x / z to the right and y / z down, without unit. `places` takes directions to the side
            and backwards as well.

        Returns
        -------
        (..., 2) float64
            Times the focal lengths, plus the principal point: pixels.
        """
        x, y = _points("points", points)
        return self._shown(x, y, np.ones_like(x))[0]

    def undistort(self, places: ArrayLike) -> Float64:
        """
        Return the points of the plane z = 1 that are seen at places on it: the inverse.

        Parameters
        ----------
        places : (..., 2) array_like of float

        Returns
        -------
        (..., 2) float64

        Raises
        ------
        ValueError
            If nothing in front of the camera is seen at one of them.
        """
        found = self.directions(np.stack(_points("places", places), axis=-1))
        if not (found[..., 2] > 0.0).all():
            raise ValueError(
                "places must be where the lens shows something less than 90 degrees from the "
                f"axis: {self.limit}"
            )
        return found[..., :2] / found[..., 2:]

    def directions(self, places: ArrayLike) -> Float64:
        """
        Return what is seen at places, (..., 2).

        Returns
        -------
        (..., 3) float64
            Unit vectors; NaN beyond a fold, and 0 beyond the field.
        """
        return _in_blocks(self._directions, _columns("places", places, 2))

    def _directions(self, u: Float64, v: Float64) -> Float64:
        """Return the directions, (N, 3), at places (N,)."""
        radius = np.sqrt(u * u + v * v)
        angle = self._curve.inverse(radius)
        with np.errstate(all="ignore"):
            for _ in range(STEPS):
                scale, growth = self._curve.scale(angle * angle)
                slope = scale + 2.0 * angle * angle * growth
                angle = angle + (radius - angle * scale) / slope
            left = np.abs(radius - angle * self._curve.scale(angle * angle)[0])
            is_found = (left <= MIN_STEP * (1.0 + radius)) & (angle < self._curve.fold)
        half = self.reach
        edge = float(self._curve.at(np.array(half))) if self._curve.fold > half else math.inf
        is_beyond = radius > edge
        sine, cosine = sine_cosine(np.where(is_found & ~is_beyond, angle, 0.0))
        along = sine / np.where(radius > 0.0, radius, 1.0)
        found = np.stack((u * along, v * along, cosine), axis=-1)
        found[~is_found & ~is_beyond] = np.nan
        found[is_beyond] = 0.0
        return found

    def places(self, directions: ArrayLike) -> Float64:
        """Return where directions, (..., 3), are seen: places (..., 2), NaN where they are not."""
        shown, angle = self._shown(*_columns("directions", directions, 3))
        is_seen = (angle < self._curve.fold) & (angle <= self.reach)
        return np.where(is_seen[..., np.newaxis], shown, np.nan)

    @property
    def limit(self) -> str:
        """The angle beyond which it shows nothing, in words."""
        fold = self._curve.fold
        if fold > self.reach:
            return f"its field is {self.field:g} degrees"
        return (
            f"it folds beyond an angle of {math.degrees(fold):.4g} degrees from the axis, "
            f"which it shows at a radius of {float(self._curve.at(np.array(fold))):.4g} focal "
            "lengths: field= ends it before"
        )

    @property
    def reach(self) -> float:
        """Largest angle from the axis that it shows, radians."""
        return self.field / 360.0 * math.pi

    @cached_property
    def _curve(self) -> _Curve:
        return _Curve((1.0, self.k1, self.k2, self.k3, self.k4), (1.0,), 2.0 * math.pi)

    def _shown(self, x: Float64, y: Float64, z: Float64) -> tuple[Float64, Float64]:
        """Return where directions are seen, (..., 2), and their angles from the axis."""
        across = np.sqrt(x * x + y * y)
        angle = arc_tangent(across, z)
        # On the axis the angle over its sine is 1.
        length = np.sqrt(x * x + y * y + z * z)
        ratio = np.where(across > 0.0, angle / np.where(across > 0.0, across, 1.0), 1.0 / length)
        scale = ratio * self._curve.scale(angle * angle)[0]
        return np.stack((x * scale, y * scale), axis=-1), angle


@says_replace
@dataclass(frozen=True)
class Equirectangular:
    """
    A panorama of all directions: columns are longitudes, rows are latitudes.

    The camera looks at the middle of the picture, which shows 360 degrees from left to right and
    180 from top, where the camera's up is, to bottom. Its field of view does not matter. The
    picture is twice as wide as high.

    Examples
    --------
    >>> import rasterjit as rj
    >>> camera = rj.PerspectiveCamera(eye=(0, 4, 0), target=(1, 4, 0))
    >>> scene, lens = rj.load("models/teapot.obj"), rj.Equirectangular()
    >>> frame = rj.render(scene, camera, size=(512, 256), lens=lens)
    """

    @staticmethod
    def directions(places: ArrayLike) -> Float64:
        """Return the unit vectors, (..., 3), at longitude and latitude down, (..., 2), radians."""
        longitude, latitude = _columns("places", places, 2)
        (across, ahead), (down, level) = sine_cosine(longitude), sine_cosine(latitude)
        return np.stack((across * level, down, ahead * level), axis=-1)

    @staticmethod
    def places(directions: ArrayLike) -> Float64:
        """Return longitude and latitude down, (..., 2), radians, of directions, (..., 3)."""
        x, y, z = _columns("directions", directions, 3)
        level = np.sqrt(x * x + z * z)
        return np.stack((arc_tangent(x, z), arc_tangent(y, level)), axis=-1)

    @property
    def limit(self) -> str:
        """Nothing, in words."""
        return "it shows everything"

    @property
    def reach(self) -> float:
        """Largest angle from the axis that it shows, radians."""
        return math.pi


Lens = PinholeDistortion | FisheyeLens | Equirectangular


def check_lens(name: str, lens: Any) -> Lens:
    """Return a lens, or raise ``ValueError`` naming what is none."""
    if not isinstance(lens, (PinholeDistortion, FisheyeLens, Equirectangular)):
        raise ValueError(
            f"{name} must be a PinholeDistortion, FisheyeLens or Equirectangular, got "
            f"{type(lens).__name__}"
        )
    return lens


class _Curve:
    """
    A distance that depends on another one: r times a ratio of polynomials of r².

    Attributes
    ----------
    fold : float
        Where it stops growing, or has a pole; infinite if it does not up to ``farthest``.
    """

    def __init__(self, above: Coefficients, below: Coefficients, farthest: float) -> None:
        self.above, self.below = above, below
        # The derivative times the square of the denominator, of q = r².
        grown = _product(_derivative(above), below), _product(above, _derivative(below))
        derivative = _sum(_product(above, below), _product((0.0, 2.0), _sum(*grown, -1.0)))
        ends = [
            root for one in (derivative, below) for root in _roots(one, farthest * farthest)[:1]
        ]
        self.fold = math.sqrt(min(ends)) if ends else math.inf
        share = np.arange(NODES) / NODES
        end = min(self.fold, farthest)
        # Dense at 0, whatever the end.
        self._radii = end * share / (1.0 + (1.0 - share) * max(end - 1.0, 0.0))
        self._shown = self.at(self._radii)

    def scale(self, q: Float64) -> tuple[Float64, Float64]:
        """Return the ratio at r² = q, and its derivative with q."""
        above, below = polynomial(self.above, q), polynomial(self.below, q)
        slope_above = polynomial(_derivative(self.above), q)
        slope_below = polynomial(_derivative(self.below), q)
        return above / below, (slope_above * below - above * slope_below) / (below * below)

    def at(self, radius: Float64) -> Float64:
        """Return the distances that distances are taken to."""
        return radius * self.scale(radius * radius)[0]

    def inverse(self, shown: Float64) -> Float64:
        """Return about where distances come from, below the fold."""
        known = self._shown
        held = np.minimum(np.where(shown == shown, shown, 0.0), known[-1])
        right = np.clip(np.searchsorted(known, held), 1, NODES - 1)
        low, high = known[right - 1], known[right]
        share = (held - low) / np.where(high > low, high - low, 1.0)
        return self._radii[right - 1] + share * (self._radii[right] - self._radii[right - 1])


def _derivative(coefficients: Coefficients) -> Coefficients:
    """Return those of a polynomial's derivative, from the constant one on."""
    return tuple(n * c for n, c in enumerate(coefficients) if n) or (0.0,)


def _product(one: Coefficients, other: Coefficients) -> Coefficients:
    """Return those of the product of two polynomials."""
    total = [0.0] * (len(one) + len(other) - 1)
    for n, a in enumerate(one):
        for m, b in enumerate(other):
            total[n + m] += a * b
    return tuple(total)


def _sum(one: Coefficients, other: Coefficients, factor: float = 1.0) -> Coefficients:
    """Return those of the sum of a polynomial and another one times a factor."""
    pairs = zip_longest(one, other, fillvalue=0.0)
    return tuple(a + factor * b for a, b in pairs)


def _roots(coefficients: Coefficients, most: float) -> list[float]:
    """Return where a polynomial changes its sign in 0..most, ascending."""
    if len(coefficients) < 2:
        return []
    # Between the roots of its derivative it only grows or only falls.
    ends = [0.0, *_roots(_derivative(coefficients), most), most]
    found = []
    for low, high in pairwise(ends):
        is_above = polynomial(coefficients, low) > 0.0
        if is_above == (polynomial(coefficients, high) > 0.0):
            continue
        while low < (middle := 0.5 * (low + high)) < high:
            if (polynomial(coefficients, middle) > 0.0) == is_above:
                low = middle
            else:
                high = middle
        found.append(low)
    return found


def _in_blocks(function: Callable[..., Float64], columns: list[Float64]) -> Float64:
    """Return what a function of (N,) columns gives, (..., 3), some at once."""
    shape = columns[0].shape
    flat = [column.ravel() for column in columns]
    found = np.empty((flat[0].size, 3))
    for first in range(0, len(found), BLOCK):
        some = slice(first, first + BLOCK)
        found[some] = function(*(column[some] for column in flat))
    return found.reshape(*shape, 3)


def _points(name: str, values: ArrayLike) -> list[Float64]:
    """Return x and y of points, or raise ``ValueError`` if some lie nowhere that a lens leads."""
    found = _columns(name, values, 2)
    for column in found:
        if not (np.abs(column) <= MAX).all():
            raise ValueError(
                f"{name} must be finite and at most {MAX:g} from 0, got "
                f"{column[~(np.abs(column) <= MAX)].flat[0]!r}"
            )
    return found


def _columns(name: str, values: ArrayLike, count: int) -> list[Float64]:
    """Return the columns of an array, each (...,) float64, or raise ``ValueError``."""
    found = check.number_array(name, values)
    if found.ndim == 0 or found.shape[-1] != count:
        raise ValueError(f"{name} must have shape (..., {count}), got {found.shape}")
    return [found[..., k] for k in range(count)]
