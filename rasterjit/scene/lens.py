"""
Lens models: project directions to positions on the image plane, and back.

The axes of a lens are OpenCV's: x to the right, y down, z ahead. Positions of the two models of
OpenCV lie on the plane z = 1; a camera's focal lengths and principal point take them to pixels.
Those of a panorama are longitude and latitude.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from itertools import pairwise, zip_longest
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rasterjit.forks import cached_property
from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Bool, Float64
from rasterjit.scene.attribute_guard import store, suggests_replace
from rasterjit.scene.portable_trig import polar_angle, polynomial, sin_cos

Coefficients = tuple[float, ...]

CURVE_SAMPLES = 4096
"""Samples of a radial curve, from which the search for its inverse starts."""

NEWTON_STEPS = 5
"""Steps of Newton's method, each of which squares the error."""

EXTRA_NEWTON_STEPS = 20
"""Further steps for positions that have not converged."""

MAX_RESIDUAL = 1e-13
"""Largest error of a position, relative to its size plus 1, at which an inverse has converged."""

POSITIONS_PER_BLOCK = 4096
"""Positions computed at once: the columns in use stay in the caches."""

MAX_MAGNITUDE = 1e15
"""Largest coefficient, and coordinate of a point: their products stay finite."""

MAX_RADIUS = 1e4
"""Largest radius of a curve, tangent of the angle from the axis."""


@suggests_replace
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
        for coefficient in fields(self):
            name = coefficient.name
            value = check.bounded_number(name, getattr(self, name), -MAX_MAGNITUDE, MAX_MAGNITUDE)
            if name.startswith("tau"):
                value = check.bounded_number(name, value, -1.5, 1.5)
            store(self, **{name: value})

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
        x, y = _split_points("points", points)
        u, v, _ = _apply_homography(self._tilt_matrix, *self._distort_with_jacobian(x, y)[:2])
        return np.stack((u, v), axis=-1)

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
        points = self.unproject(np.stack(_split_points("places", places), axis=-1))[..., :2]
        if not np.isfinite(points).all():
            raise ValueError(f"places must be where the lens shows something: {self.visible_range}")
        return points

    def unproject(self, positions: ArrayLike) -> Float64:
        """Return the directions, (..., 3), seen at positions, (..., 2): NaN where none is seen."""
        return _apply_in_blocks(self._unproject_block, _split_columns("positions", positions, 2))

    def _unproject_block(self, u: Float64, v: Float64) -> Float64:
        """Return the directions, (N, 3), at positions (N,) each."""
        u, v, w = _apply_homography(self._inverse_tilt_matrix, u, v)
        # Begin as if the lens were round.
        radius = np.sqrt(u * u + v * v)
        start_ratio = self._curve.estimate_radius(radius) / np.where(radius > 0.0, radius, 1.0)
        x, y = u * start_ratio, v * start_ratio
        with np.errstate(all="ignore"):
            x, y, converged = self._refine_points(u, v, x, y, NEWTON_STEPS)
            missing = ~converged
            if missing.any():
                # Some are far from where a round lens would show them.
                x[missing], y[missing], converged[missing] = self._refine_points(
                    u[missing], v[missing], x[missing], y[missing], EXTRA_NEWTON_STEPS
                )
            converged &= (w > 0.0) & (x * x + y * y < self._curve.fold * self._curve.fold)
        x, y = np.where(converged, x, np.nan), np.where(converged, y, np.nan)
        return np.stack((x, y, np.where(converged, 1.0, np.nan)), axis=-1)

    def _refine_points(
        self, u: Float64, v: Float64, x: Float64, y: Float64, steps: int
    ) -> tuple[Float64, Float64, Bool]:
        """Refine points (x, y) by Newton's method to be seen at (u, v); tell which converged."""
        for _ in range(steps):
            guess_u, guess_v, (xx, xy, yx, yy) = self._distort_with_jacobian(x, y)
            error_u, error_v, determinant = u - guess_u, v - guess_v, xx * yy - xy * yx
            x = x + (yy * error_u - xy * error_v) / determinant
            y = y + (xx * error_v - yx * error_u) / determinant
        guess_u, guess_v, (xx, xy, yx, yy) = self._distort_with_jacobian(x, y)
        error, size = np.abs(u - guess_u) + np.abs(v - guess_v), 1.0 + np.abs(u) + np.abs(v)
        return x, y, (error <= MAX_RESIDUAL * size) & (xx * yy - xy * yx > 0.0)

    def project(self, directions: ArrayLike) -> Float64:
        """Return the positions, (..., 2), of directions, (..., 3): NaN where they are not seen."""
        x, y, z = _split_columns("directions", directions, 3)
        with np.errstate(all="ignore"):
            x, y = x / z, y / z
            is_seen = (z > 0.0) & (x * x + y * y < self._curve.fold * self._curve.fold)
            is_seen &= np.maximum(np.abs(x), np.abs(y)) <= MAX_MAGNITUDE
            points = np.where(is_seen[..., np.newaxis], np.stack((x, y), -1), 0.0)
            return np.where(is_seen[..., np.newaxis], self.distort(points), np.nan)

    @property
    def visible_range(self) -> str:
        """Description of the radius beyond which the lens folds."""
        fold = self._curve.fold
        if fold == math.inf:
            return "beyond, the distortion is not invertible"
        return (
            f"the radial distortion folds beyond a radius of {fold:.4g} (tangent of the angle from "
            f"the axis), which it shows at {float(self._curve.distort_radius(np.array(fold))):.4g} "
            "focal lengths from the principal point"
        )

    @cached_property
    def _curve(self) -> _RadialCurve:
        numerator, denominator = (1.0, self.k1, self.k2, self.k3), (1.0, self.k4, self.k5, self.k6)
        return _RadialCurve(numerator, denominator, MAX_RADIUS)

    def _distort_with_jacobian(
        self, x: Float64, y: Float64
    ) -> tuple[Float64, Float64, tuple[Float64, ...]]:
        """Distort points without the tilt; return u, v and (du/dx, du/dy, dv/dx, dv/dy)."""
        q = x * x + y * y
        ratio, slope = self._curve.ratio_and_slope(q)
        prism_x, prism_y = self.s1 + self.s2 * q, self.s3 + self.s4 * q
        u = x * ratio + 2.0 * self.p1 * x * y + self.p2 * (q + 2.0 * x * x) + prism_x * q
        v = y * ratio + self.p1 * (q + 2.0 * y * y) + 2.0 * self.p2 * x * y + prism_y * q
        rate_x, rate_y = self.s1 + 2.0 * self.s2 * q, self.s3 + 2.0 * self.s4 * q
        cross = 2.0 * x * y * slope
        jacobian = (
            ratio + 2.0 * x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x + 2.0 * x * rate_x,
            cross + 2.0 * self.p1 * x + 2.0 * self.p2 * y + 2.0 * y * rate_x,
            cross + 2.0 * self.p1 * x + 2.0 * self.p2 * y + 2.0 * x * rate_y,
            ratio + 2.0 * y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x + 2.0 * y * rate_y,
        )
        return u, v, jacobian

    @cached_property
    def _tilt_matrix(self) -> list[list[float]]:
        (sine_x, sine_y), (cosine_x, cosine_y) = (
            values.tolist() for values in sin_cos(np.array([self.tau_x, self.tau_y]))
        )
        # The rotation about y after that about x, then back to the plane along the axis.
        rotation = [
            [cosine_y, sine_y * sine_x, -sine_y * cosine_x],
            [0.0, cosine_x, sine_x],
            [sine_y, -cosine_y * sine_x, cosine_y * cosine_x],
        ]
        a, b, c = rotation
        depth = c[2]
        return [
            [depth * a[k] - a[2] * c[k] for k in range(3)],
            [depth * b[k] - b[2] * c[k] for k in range(3)],
            c,
        ]

    @cached_property
    def _inverse_tilt_matrix(self) -> list[list[float]]:
        (a, b, c), (d, e, f), (g, h, i) = self._tilt_matrix
        rows = [
            [e * i - f * h, c * h - b * i, b * f - c * e],
            [f * g - d * i, a * i - c * g, c * d - a * f],
            [d * h - e * g, b * g - a * h, a * e - b * d],
        ]
        # Of a projection only ratios matter, but the sign tells what lies behind.
        determinant = (a * rows[0][0] + b * rows[1][0]) + c * rows[2][0]
        return [[entry / determinant for entry in row] for row in rows]


@suggests_replace
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
    fov : float, degrees
        Field of view of the lens, above 0 and at most 360: what lies farther from the axis than
        half of it is not seen, and the picture is empty there, as around a circular fisheye.

    Raises
    ------
    ValueError
        If a coefficient is no finite number, or ``fov`` is not in that range.

    References
    ----------
    .. [1] OpenCV 4, "Fisheye camera model", after J. Kannala, S. Brandt, "A Generic Camera Model
       and Calibration Method for Conventional, Wide-Angle, and Fish-Eye Lenses", PAMI 28(8), 2006.

    Examples
    --------
    >>> import rasterjit as rj
    >>> lens = rj.FisheyeLens(k1=-0.02, k2=0.003, fov=190.0)
    >>> frame = rj.render(rj.load("models/teapot.obj"), size=(320, 240), lens=lens)
    """

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    _: KW_ONLY
    fov: float = 360.0

    def __post_init__(self) -> None:
        for name in ("k1", "k2", "k3", "k4"):
            value = check.bounded_number(name, getattr(self, name), -MAX_MAGNITUDE, MAX_MAGNITUDE)
            store(self, **{name: value})
        fov = check.bounded_number("fov", self.fov, 0.0, 360.0)
        if fov == 0.0:
            raise ValueError(f"fov must be above 0, got {self.fov!r}")
        store(self, fov=fov)

    def distort(self, points: ArrayLike) -> Float64:
        """
        Return where points of the plane z = 1 are seen on it.

        Parameters
        ----------
        points : (..., 2) array_like of float
            x / z to the right and y / z down, without unit. `project` takes directions to the side
            and backwards as well.

        Returns
        -------
        (..., 2) float64
            Times the focal lengths, plus the principal point: pixels.
        """
        x, y = _split_points("points", points)
        return self._project_with_angle(x, y, np.ones_like(x))[0]

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
        directions = self.unproject(np.stack(_split_points("places", places), axis=-1))
        if not (directions[..., 2] > 0.0).all():
            raise ValueError(
                "places must be where the lens shows something less than 90 degrees from the "
                f"axis: {self.visible_range}"
            )
        return directions[..., :2] / directions[..., 2:]

    def unproject(self, positions: ArrayLike) -> Float64:
        """
        Return the directions seen at positions, (..., 2).

        Returns
        -------
        (..., 3) float64
            Unit vectors; NaN beyond a fold, and 0 beyond the field of view.
        """
        return _apply_in_blocks(self._unproject_block, _split_columns("positions", positions, 2))

    def _unproject_block(self, u: Float64, v: Float64) -> Float64:
        """Return the directions, (N, 3), at positions (N,) each."""
        radius = np.sqrt(u * u + v * v)
        angle = self._curve.estimate_radius(radius)
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS):
                ratio, slope = self._curve.ratio_and_slope(angle * angle)
                angle_slope = ratio + 2.0 * angle * angle * slope
                angle = angle + (radius - angle * ratio) / angle_slope
            residual = np.abs(radius - self._curve.distort_radius(angle))
            converged = (residual <= MAX_RESIDUAL * (1.0 + radius)) & (angle < self._curve.fold)
        edge = math.inf
        if self._curve.fold > self._max_angle:
            edge = float(self._curve.distort_radius(np.array(self._max_angle)))
        is_beyond = radius > edge
        sine, cosine = sin_cos(np.where(converged & ~is_beyond, angle, 0.0))
        sine_by_radius = sine / np.where(radius > 0.0, radius, 1.0)
        directions = np.stack((u * sine_by_radius, v * sine_by_radius, cosine), axis=-1)
        directions[~converged & ~is_beyond] = np.nan
        directions[is_beyond] = 0.0
        return directions

    def project(self, directions: ArrayLike) -> Float64:
        """Return the positions, (..., 2), of directions, (..., 3): NaN where they are not seen."""
        columns = _split_columns("directions", directions, 3)
        positions, angle = self._project_with_angle(*columns)
        is_seen = (angle < self._curve.fold) & (angle <= self._max_angle)
        return np.where(is_seen[..., np.newaxis], positions, np.nan)

    @property
    def visible_range(self) -> str:
        """Description of the angle beyond which the lens shows nothing."""
        fold = self._curve.fold
        if fold > self._max_angle:
            return f"its field of view is {self.fov:g} degrees"
        return (
            f"it folds beyond an angle of {math.degrees(fold):.4g} degrees from the axis, "
            f"which it shows at a radius of {float(self._curve.distort_radius(np.array(fold))):.4g}"
            " focal lengths: fov= ends it before"
        )

    @property
    def _max_angle(self) -> float:
        """Largest visible angle from the axis, radians."""
        return self.fov / 360.0 * math.pi

    @cached_property
    def _curve(self) -> _RadialCurve:
        return _RadialCurve((1.0, self.k1, self.k2, self.k3, self.k4), (1.0,), 2.0 * math.pi)

    def _project_with_angle(self, x: Float64, y: Float64, z: Float64) -> tuple[Float64, Float64]:
        """Project directions; return positions, (..., 2), and angles from the axis."""
        radius = np.sqrt(x * x + y * y)
        angle = polar_angle(radius, z)
        # On the axis the angle over its sine is 1.
        length = np.sqrt(x * x + y * y + z * z)
        bend = np.where(radius > 0.0, angle / np.where(radius > 0.0, radius, 1.0), 1.0 / length)
        factor = bend * self._curve.ratio_and_slope(angle * angle)[0]
        return np.stack((x * factor, y * factor), axis=-1), angle


@suggests_replace
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
    def unproject(positions: ArrayLike) -> Float64:
        """Return the unit vectors, (..., 3), at longitude and latitude down, (..., 2), radians."""
        longitude, latitude = _split_columns("positions", positions, 2)
        (across, ahead), (down, level) = sin_cos(longitude), sin_cos(latitude)
        return np.stack((across * level, down, ahead * level), axis=-1)

    @staticmethod
    def project(directions: ArrayLike) -> Float64:
        """Return longitude and latitude down, (..., 2), radians, of directions, (..., 3)."""
        x, y, z = _split_columns("directions", directions, 3)
        level = np.sqrt(x * x + z * z)
        return np.stack((polar_angle(x, z), polar_angle(y, level)), axis=-1)

    @property
    def visible_range(self) -> str:
        """Description of the visible directions: all."""
        return "it shows everything"


Lens = PinholeDistortion | FisheyeLens | Equirectangular


def check_lens(name: str, lens: Any) -> Lens:
    """Return ``lens`` if it is one, or raise ``ValueError``."""
    if not isinstance(lens, (PinholeDistortion, FisheyeLens, Equirectangular)):
        raise ValueError(
            f"{name} must be a PinholeDistortion, FisheyeLens or Equirectangular, got "
            f"{type(lens).__name__}"
        )
    return lens


class _RadialCurve:
    """
    A radial distortion curve: r times a ratio of polynomials of r².

    Attributes
    ----------
    fold : float
        Radius where the curve stops growing, or has a pole; infinite if none up to ``max_radius``.
    """

    def __init__(
        self, numerator: Coefficients, denominator: Coefficients, max_radius: float
    ) -> None:
        self.numerator, self.denominator = numerator, denominator
        # The derivative times the square of the denominator, of q = r².
        quotient_rule = _add_polynomials(
            _multiply_polynomials(_differentiate(numerator), denominator),
            _multiply_polynomials(numerator, _differentiate(denominator)),
            -1.0,
        )
        derivative = _add_polynomials(
            _multiply_polynomials(numerator, denominator),
            _multiply_polynomials((0.0, 2.0), quotient_rule),
        )
        folds = [
            root
            for coefficients in (derivative, denominator)
            for root in _find_sign_changes(coefficients, max_radius * max_radius)[:1]
        ]
        self.fold = math.sqrt(min(folds)) if folds else math.inf
        t = np.arange(CURVE_SAMPLES) / CURVE_SAMPLES
        end = min(self.fold, max_radius)
        # Dense at 0, whatever the end.
        self._radii = end * t / (1.0 + (1.0 - t) * max(end - 1.0, 0.0))
        self._distorted_radii = self.distort_radius(self._radii)

    def ratio_and_slope(self, q: Float64) -> tuple[Float64, Float64]:
        """Return the distorted radius by the radius, at r² = q, and its derivative by q."""
        top, bottom = polynomial(self.numerator, q), polynomial(self.denominator, q)
        top_slope = polynomial(_differentiate(self.numerator), q)
        bottom_slope = polynomial(_differentiate(self.denominator), q)
        return top / bottom, (top_slope * bottom - top * bottom_slope) / (bottom * bottom)

    def distort_radius(self, radius: Float64) -> Float64:
        """Return the distorted radii."""
        return radius * self.ratio_and_slope(radius * radius)[0]

    def estimate_radius(self, distorted: Float64) -> Float64:
        """Return approximate radii below the fold, given distorted ones."""
        table = self._distorted_radii
        clamped = np.minimum(np.where(distorted == distorted, distorted, 0.0), table[-1])
        right = np.clip(np.searchsorted(table, clamped), 1, CURVE_SAMPLES - 1)
        low, high = table[right - 1], table[right]
        t = (clamped - low) / np.where(high > low, high - low, 1.0)
        return self._radii[right - 1] + t * (self._radii[right] - self._radii[right - 1])


def _differentiate(coefficients: Coefficients) -> Coefficients:
    """Return the coefficients of a polynomial's derivative, from the constant one on."""
    return tuple(n * c for n, c in enumerate(coefficients) if n) or (0.0,)


def _multiply_polynomials(a: Coefficients, b: Coefficients) -> Coefficients:
    """Return the coefficients of the product of two polynomials."""
    product = [0.0] * (len(a) + len(b) - 1)
    for n, x in enumerate(a):
        for m, y in enumerate(b):
            product[n + m] += x * y
    return tuple(product)


def _add_polynomials(a: Coefficients, b: Coefficients, factor: float = 1.0) -> Coefficients:
    """Return the coefficients of ``a + factor * b``."""
    return tuple(x + factor * y for x, y in zip_longest(a, b, fillvalue=0.0))


def _find_sign_changes(coefficients: Coefficients, max_x: float) -> list[float]:
    """Return where a polynomial changes its sign in 0..max_x, ascending."""
    if len(coefficients) < 2:
        return []
    # Between the extrema a polynomial only grows or only falls.
    bounds = [0.0, *_find_sign_changes(_differentiate(coefficients), max_x), max_x]
    roots = []
    for low, high in pairwise(bounds):
        is_above = polynomial(coefficients, low) > 0.0
        if is_above == (polynomial(coefficients, high) > 0.0):
            continue
        while low < (middle := 0.5 * (low + high)) < high:
            if (polynomial(coefficients, middle) > 0.0) == is_above:
                low = middle
            else:
                high = middle
        roots.append(low)
    return roots


def _apply_homography(
    matrix: Sequence[Sequence[float]], u: Float64, v: Float64
) -> tuple[Float64, Float64, Float64]:
    """Multiply positions by a 3x3 matrix and divide by w; return u, v and w."""
    a, b, c = matrix
    w = (c[0] * u + c[1] * v) + c[2]
    return ((a[0] * u + a[1] * v) + a[2]) / w, ((b[0] * u + b[1] * v) + b[2]) / w, w


def _apply_in_blocks(function: Callable[..., Float64], columns: list[Float64]) -> Float64:
    """Apply a function of (N,) columns block by block; return its results, (..., 3)."""
    flat = [column.ravel() for column in columns]
    result = np.empty((flat[0].size, 3))
    for first in range(0, len(result), POSITIONS_PER_BLOCK):
        block = slice(first, first + POSITIONS_PER_BLOCK)
        result[block] = function(*(column[block] for column in flat))
    return result.reshape(*columns[0].shape, 3)


def _split_points(name: str, values: ArrayLike) -> list[Float64]:
    """Return x and y of points, or raise ``ValueError`` if one is not finite or too large."""
    columns = _split_columns(name, values, 2)
    for column in columns:
        if not (np.abs(column) <= MAX_MAGNITUDE).all():
            raise ValueError(
                f"{name} must be finite and at most {MAX_MAGNITUDE:g} from 0, got "
                f"{column[~(np.abs(column) <= MAX_MAGNITUDE)].flat[0]!r}"
            )
    return columns


def _split_columns(name: str, values: ArrayLike, count: int) -> list[Float64]:
    """Return the columns of an array, each (...,) float64, or raise ``ValueError``."""
    array = check.number_array(name, values)
    if array.ndim == 0 or array.shape[-1] != count:
        raise ValueError(f"{name} must have shape (..., {count}), got {array.shape}")
    return [array[..., k] for k in range(count)]
