"""
4x4 matrices and point transforms: pure NumPy, float64, column vectors, degrees.

Matrices are named *target from source*; ``compose(c, b, a)`` applies ``a`` first. World and view
space are right-handed with y up, the camera looks down its -z. NDC is [-1, 1]^3 with -1 at the
near plane. Screen space has x to the right, y **down** and the centre of pixel (column i, row j)
at (i + 0.5, j + 0.5).

The same input gives the same bits on every machine: no BLAS and no vectorised or libm
trigonometry, whose roundings differ between CPUs, only IEEE operations in a fixed order.
"""

from __future__ import annotations

import functools
import itertools
import math
from fractions import Fraction
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Float64
from rasterjit.scene.vectors import cross, dot, rotation_rows

Matrix = Float64
_Triple = tuple[float, float, float]

ViewportConvention: TypeAlias = Literal["edges", "centers"]
VIEWPORT_CONVENTIONS: tuple[ViewportConvention, ...] = get_args(ViewportConvention)
"""Where NDC -1 and 1 lie: on the borders of the picture; on the centres of its outer pixels."""

_BITS = 128
"""Fractional bits of the fixed-point series: 75 more than a float64 keeps."""

_PI = 0x3243F6A8885A308D313198A2E03707344
"""Pi times 2^128, rounded down."""

_LAST_TERM = 28
"""Highest power of the series: 45 degrees to the 30th over 30! is below 2^-117."""

_ARC_TERMS = 28
"""Terms of the arc tangent's series: 5.625 degrees, a tangent of 0.0985, to the 57th is below
2^-190 and over 57 smaller still."""

_PARALLEL_SINE = 1e-10
"""Sine of the angle below which directions count as parallel: the cross product of unit vectors
carries a rounding error of about 2e-16, so its direction keeps six digits down to here."""

MIN_NEAR = 1e-13
"""Least ratio of near to far distance at which float64 still clips at the far plane: to
about 1/1000 of its distance."""

_ROUND_UP = 1.01
"""Factor on a lower limit, so that its first three digits are not too small."""

_MIN_FOV = 1e-300
"""Least field of view, degrees: below it the focal length 1/tan(fov/2) overflows float64."""

_MAX_EXPONENT = 1000
"""Largest exponent of the powers of two that rows are scaled by: larger ones overflow."""

_LAST_ROW = (0.0, 0.0, 0.0, 1.0)

_IDENTITY = [[float(row == column) for column in range(4)] for row in range(4)]

_POINTS_PER_BLOCK = 16384
"""Points per block: 128 KiB per float64 coordinate, so a block's five columns stay in a 1 MiB
second-level cache. 500 k points took 5.0 ms; 12.8 ms with 1024."""


def sine_cosine(degrees: float) -> tuple[float, float]:
    """
    Return the sine and cosine of an angle in degrees, correctly rounded on every machine.

    Multiples of 30 degrees with rational results are exact: ``sine_cosine(90) == (1, 0)``.

    Parameters
    ----------
    degrees : float

    Raises
    ------
    ValueError
        If ``degrees`` is not a finite number.

    Notes
    -----
    The angle is reduced to +-45 degrees without rounding, then both Taylor series are summed in
    128-bit fixed point. The sine is the angle times the series of sin(x)/x, so it keeps its
    relative precision for tiny angles.
    """
    reduced = math.remainder(check.finite_number("degrees", degrees), 360.0)
    quadrant = round(reduced / 90.0)
    numerator, denominator = (reduced - 90.0 * quadrant).as_integer_ratio()
    radians = numerator * _PI // (180 * denominator)
    square = radians * radians >> _BITS
    one = 1 << _BITS
    sine_ratio = cosine_sum = one
    for k in range(_LAST_TERM, 0, -2):
        sine_ratio = one - (square * sine_ratio // (k * (k + 1)) >> _BITS)
        cosine_sum = one - (square * cosine_sum // (k * (k - 1)) >> _BITS)
    sine = numerator * _PI * sine_ratio / (180 * denominator << 2 * _BITS)
    cosine = cosine_sum / one
    by_quadrant = ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))[quadrant % 4]
    return by_quadrant[0] + 0.0, by_quadrant[1] + 0.0


def arc_tangent(y: float, x: float) -> float:
    """
    Return the angle of (x, y) from the x axis in degrees, correctly rounded on every machine.

    The inverse of `sine_cosine`: multiples of 45 degrees are exact.

    Parameters
    ----------
    y, x : float
        Of any length.

    Returns
    -------
    float
        Degrees in -180..180, with the sign of ``y``; 0 if both are 0.

    Raises
    ------
    ValueError
        If a component is not a finite number.

    Notes
    -----
    The smaller component over the larger is halved in angle three times, by
    ``tan(a/2) = t / (1 + sqrt(1 + t^2))``, and the Taylor series of the arc tangent, of which 28
    terms reach 2^-128, is summed in fixed point with 128 bits behind the leading one.
    """
    rise, run = Fraction(check.finite_number("y", y)), Fraction(check.finite_number("x", x))
    low, high = sorted((abs(rise), abs(run)))
    if low == 0:
        degrees = Fraction(90 if rise else 0)
    elif low == high:
        degrees = Fraction(45)
    else:
        degrees = _arc_tangent_degrees(low / high)
        if abs(rise) > abs(run):
            degrees = 90 - degrees
    if run < 0:
        degrees = 180 - degrees
    return float(-degrees if rise < 0 else degrees)


def _arc_tangent_degrees(ratio: Fraction) -> Fraction:
    """Return the arc tangent of a ratio in 0..1, in degrees, to 2^-120 of itself."""
    # As many bits more as the ratio is small.
    bits = _BITS + ratio.denominator.bit_length() - ratio.numerator.bit_length() + 1
    one = 1 << bits
    tangent = (ratio.numerator << bits) // ratio.denominator
    for _ in range(3):
        root = math.isqrt((one << bits) + tangent * tangent)
        tangent = (tangent << bits) // (one + root)
    square = tangent * tangent >> bits
    series = 0
    for k in range(2 * _ARC_TERMS - 1, 0, -2):
        series = one // k - (square * series >> bits)
    return Fraction(8 * 180 * tangent * series << _BITS, _PI << 2 * bits)


def focal_length(fov_y: float) -> float:
    """
    Return 1/tan(fov_y / 2), the distance at which the view is 2 units high; exactly 1 at 90.

    Parameters
    ----------
    fov_y : float, degrees
        Vertical field of view, strictly between 0 and 180.

    Raises
    ------
    ValueError
        If ``fov_y`` is not a finite number between 0 and 180 (or is below 1e-300).
    """
    angle = check.finite_number("fov_y", fov_y)
    if not _MIN_FOV <= angle < 180.0:
        raise ValueError(f"fov_y must be above 0 and below 180 degrees, got {angle!r}")
    return _focal_length(angle)


@functools.lru_cache(maxsize=256)
def _focal_length(angle: float) -> float:
    """Return the focal length of an angle in range; most cameras of a program have one."""
    sine, cosine = sine_cosine(angle)
    # Take the half-angle formula that does not cancel.
    return (1.0 + cosine) / sine if cosine >= 0.0 else sine / (1.0 - cosine)


def unit_vector(name: str, value: ArrayLike) -> Float64:
    """
    Return ``value`` scaled to length one.

    Scaled by a power of two first, so that neither 1e-160 nor 1e+160 underflows or overflows.

    Parameters
    ----------
    name : str
        What the message calls the argument.
    value : (3,) array_like

    Returns
    -------
    (3,) float64

    Raises
    ------
    ValueError
        If ``value`` is zero, not finite or not three numbers.
    """
    return np.array(unit_triple(name, value))


def unit_triple(name: str, value: ArrayLike) -> _Triple:
    """Return three floats scaled to length one, or raise ``ValueError`` as `unit_vector` does."""
    x, y, z = check.triple(name, value)
    if not (x or y or z):
        raise ValueError(f"{name} must not be the zero vector")
    return unit_numbers(x, y, z)


def unit_numbers(x: float, y: float, z: float) -> _Triple:
    """Return three finite floats, not all 0, scaled as `unit_vector` scales them."""
    largest = max(abs(x), abs(y), abs(z))
    exponent = math.frexp(largest)[1]
    x, y, z = math.ldexp(x, -exponent), math.ldexp(y, -exponent), math.ldexp(z, -exponent)
    length = math.sqrt((x * x + y * y) + z * z)
    return x / length, y / length, z / length


def are_parallel(a: ArrayLike, b: ArrayLike) -> bool:
    """
    Tell whether two non-zero vectors point the same or opposite ways, to within 1e-10 radian.

    Parameters
    ----------
    a, b : (3,) array_like

    Raises
    ------
    ValueError
        If either is zero, not finite or not three numbers.
    """
    normal = cross(unit_triple("a", a), unit_triple("b", b))
    return math.sqrt(dot(normal, normal)) <= _PARALLEL_SINE


def identity() -> Matrix:
    """Return the (4, 4) identity."""
    return np.eye(4)


def translate(offset: ArrayLike) -> Matrix:
    """
    Return the matrix that moves points by ``offset``.

    Parameters
    ----------
    offset : (3,) array_like
        One vector: ``translate((x, y, z))``.

    Raises
    ------
    ValueError
        If ``offset`` is not three finite numbers.
    """
    matrix = np.eye(4)
    matrix[:3, 3] = check.vector("offset", offset)
    return matrix


def scale(factor: float | ArrayLike) -> Matrix:
    """
    Return the matrix that scales about the origin.

    Parameters
    ----------
    factor : float or (3,) array_like
        One factor for all axes or one per axis; a negative factor mirrors.

    Raises
    ------
    ValueError
        If a factor is not finite, or is zero (the matrix would be singular).
    """
    given = check.unmasked_array("factor", factor)
    if given.ndim == 0:
        factors = np.full(3, check.finite_number("factor", factor))
    else:
        factors = check.vector("factor", given)
    if not factors.all():
        raise ValueError(f"factor must not be 0, got {factor!r}")
    return np.diag([*factors.tolist(), 1.0])


def rotate(axis: ArrayLike, degrees: float) -> Matrix:
    """
    Return the right-handed rotation about an axis through the origin.

    Seen against the axis's direction, positive angles turn counter-clockwise. About a coordinate
    axis, quarter turns have entries of exactly 0 and +-1.

    Parameters
    ----------
    axis : (3,) array_like
        Any non-zero length.
    degrees : float

    Raises
    ------
    ValueError
        If ``axis`` is zero or not finite, or ``degrees`` is not finite.
    """
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_rows(unit_triple("axis", axis), *sine_cosine(degrees))
    return matrix + 0.0


def rotate_x(degrees: float) -> Matrix:
    """Return the rotation about x that turns y towards z; see :func:`rotate`."""
    return rotate((1.0, 0.0, 0.0), degrees)


def rotate_y(degrees: float) -> Matrix:
    """Return the rotation about y that turns z towards x; see :func:`rotate`."""
    return rotate((0.0, 1.0, 0.0), degrees)


def rotate_z(degrees: float) -> Matrix:
    """Return the rotation about z that turns x towards y; see :func:`rotate`."""
    return rotate((0.0, 0.0, 1.0), degrees)


def shear(
    *,
    xy: float = 0.0,
    xz: float = 0.0,
    yx: float = 0.0,
    yz: float = 0.0,
    zx: float = 0.0,
    zy: float = 0.0,
) -> Matrix:
    """
    Return the shear that adds to each coordinate a multiple of the others.

    Parameters
    ----------
    xy, xz, yx, yz, zx, zy : float
        ``xy`` is how much of y is added to x, ``yx`` how much of x to y, and so on. All six
        read the unsheared point.

    Raises
    ------
    ValueError
        If a coefficient is not finite.
    """
    given = {"xy": xy, "xz": xz, "yx": yx, "yz": yz, "zx": zx, "zy": zy}
    matrix = np.eye(4)
    for name, amount in given.items():
        matrix["xyz".index(name[0]), "xyz".index(name[1])] = check.finite_number(name, amount)
    return matrix


def compose(*matrices: ArrayLike) -> Matrix:
    """
    Return the product of the matrices: the leftmost is applied last.

    Parameters
    ----------
    *matrices : (4, 4) array_like
        None at all gives the identity.

    Raises
    ------
    ValueError
        If one is not a finite 4x4 matrix, or the product overflows.
    """
    rows = [
        check.finite_array(f"matrices[{number}]", matrix, (4, 4)).tolist()
        for number, matrix in enumerate(matrices)
    ]
    return np.array(product_of(_IDENTITY, *rows))


def product_of(first: list[list[float]], *others: list[list[float]]) -> list[list[float]]:
    """Return the product of finite matrices as rows, as rows; raise as `compose` does."""
    product = first
    for matrix in others:
        product = _product(product, matrix)
        if not all(map(math.isfinite, itertools.chain.from_iterable(product))):
            raise ValueError(f"matrices must have a finite product, got {product}")
    return product


def product_of_each(first: Float64, second: Float64) -> Float64:
    """
    Return the product of two matrices each, the same bits as `product_of`.

    Parameters
    ----------
    first, second : (N, 4, 4) float64

    Returns
    -------
    (N, 4, 4) float64
        Not finite where the product overflows.
    """
    x, y, z, w = (first[:, :, k, np.newaxis] for k in range(4))
    a, b, c, d = (second[:, k, np.newaxis, :] for k in range(4))
    with np.errstate(all="ignore"):
        return ((x * a + y * b) + z * c) + w * d


def _product(a: list[list[float]], b: list[list[float]]) -> list[list[float]]:
    """Return the product of two 4x4 matrices, summed left to right; plain floats are faster."""
    (a0, a1, a2, a3), (b0, b1, b2, b3), (c0, c1, c2, c3), (d0, d1, d2, d3) = b
    return [
        [
            ((x * a0 + y * b0) + z * c0) + w * d0,
            ((x * a1 + y * b1) + z * c1) + w * d1,
            ((x * a2 + y * b2) + z * c2) + w * d2,
            ((x * a3 + y * b3) + z * c3) + w * d3,
        ]
        for x, y, z, w in a
    ]


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike) -> Matrix:
    """
    Return ``view_from_world`` of a UVN camera: eye at the origin, target on -z, up towards +y.

    Parameters
    ----------
    eye, target : (3,) array_like, world space
    up : (3,) array_like
        Any length; need not be perpendicular to the view.

    Raises
    ------
    ValueError
        If ``target`` equals ``eye``, or ``up`` is zero or within 1e-10 radian of the line of
        sight, or an entry is not finite.
    """
    eye_x, eye_y, eye_z = origin = check.triple("eye", eye)
    x, y, z = check.triple("target", target)
    if origin == (x, y, z):
        raise ValueError(f"target must differ from eye, both are {origin}")
    back = unit_triple("eye - target", (eye_x - x, eye_y - y, eye_z - z))
    upward = unit_triple("up", up)
    side = cross(upward, back)
    if math.sqrt(dot(side, side)) <= _PARALLEL_SINE:
        raise ValueError(f"up must not be parallel to the line of sight, got {up!r}")
    side = unit_numbers(*side)
    # Remove what cancellation in the cross product left along the line of sight.
    tilt = dot(side, back)
    side = unit_numbers(
        side[0] - tilt * back[0], side[1] - tilt * back[1], side[2] - tilt * back[2]
    )
    rows = [(*row, -dot(row, origin)) for row in (side, cross(back, side), back)]
    return np.array([*rows, _LAST_ROW]) + 0.0


def perspective(fov_y: float, aspect: float, near: float, far: float) -> Matrix:
    """
    Return ``clip_from_view`` of a symmetric perspective camera (OpenGL's NDC).

    Parameters
    ----------
    fov_y : float, degrees
        Vertical field of view, strictly between 0 and 180.
    aspect : float
        Width over height.
    near, far : float, scene units
        Distances along -z that map to NDC z of -1 and +1; ``far`` may be ``math.inf``, else it is
        at most 1e13 times ``near``.

    Raises
    ------
    ValueError
        If ``fov_y`` is outside (0, 180), ``aspect`` or ``near`` not above 0, ``far`` not above
        ``near`` or more than 1e13 times as far, or a number is not finite.
    """
    matrix = lens_matrix(fov_y, aspect, near, far)
    perspective_depth(near, far)
    return matrix


def lens_matrix(fov_y: float, aspect: float, near: float, far: float) -> Matrix:
    """Return what `perspective` does; a ``far`` that it refuses as too far is infinite."""
    focal = focal_length(fov_y)
    ratio = check.positive_number("aspect", aspect)
    z_scale, z_offset = _depth_row(near, far)
    return np.array(
        [
            [focal / ratio, 0.0, 0.0, 0.0],
            [0.0, focal, 0.0, 0.0],
            [0.0, 0.0, z_scale, z_offset],
            [0.0, 0.0, -1.0, 0.0],
        ]
    )


def perspective_depth(near: float, far: float) -> tuple[float, float]:
    """
    Return the scale and offset of view z in the third row of a perspective matrix.

    Parameters
    ----------
    near, far : float, scene units
        ``far`` may be ``math.inf``.

    Raises
    ------
    ValueError
        If ``near`` is not above 0, ``far`` not above ``near`` or finite and more than 1e13 times
        as far, or either is NaN.
    """
    row = _depth_row(near, far)
    if near < MIN_NEAR * far < math.inf:
        raise ValueError(
            f"near must be at least {rounded_up(MIN_NEAR * far)}, or far math.inf: a matrix in "
            f"float64 cannot hold far = {far!r} with near = {near!r}"
        )
    return row


def rounded_up(limit: float) -> str:
    """Format a lower limit for messages: three digits, rounded up."""
    return f"{limit * _ROUND_UP:.3g}"


def _depth_row(near: float, far: float) -> tuple[float, float]:
    """Return what `perspective_depth` does; a ``far`` that it refuses as too far is infinite."""
    n = check.positive_number("near", near)
    is_infinite = isinstance(far, (float, np.floating)) and far == math.inf
    f = math.inf if is_infinite else check.finite_number("far", far)
    if f <= n:
        raise ValueError(f"far must be above near = {n!r}, got {f!r}")
    if f == math.inf or n < MIN_NEAR * f:
        return -1.0, -2.0 * n
    return -(f + n) / (f - n), -2.0 * n * (f / (f - n))


def perspective_focal(d: float) -> Matrix:
    """
    Return the textbook projection from the origin onto the view plane z = -d.

    The last row is (0, 0, -1/d, 0): after the divide, (x, y, z) becomes (-dx/z, -dy/z, -d).
    The matrix is singular; it keeps no depth.

    Parameters
    ----------
    d : float, scene units
        Distance of the view plane.

    Raises
    ------
    ValueError
        If ``d`` is not finite and above 0.
    """
    matrix = np.eye(4)
    matrix[3] = [0.0, 0.0, -1.0 / check.positive_number("d", d), 0.0]
    return matrix


def orthographic(
    left: float, right: float, bottom: float, top: float, near: float, far: float
) -> Matrix:
    """
    Return ``clip_from_view`` of a parallel projection (OpenGL's NDC).

    Parameters
    ----------
    left, right, bottom, top : float, view space
        The values of x and y that map to -1 and +1. Swapping a pair mirrors the image.
    near, far : float, scene units
        Distances along -z that map to NDC z of -1 and +1; ``near`` may be 0 or negative.

    Raises
    ------
    ValueError
        If ``right`` equals ``left``, ``top`` equals ``bottom``, ``far`` is not above ``near``, or
        a number is not finite, here or in the matrix.
    """
    x0, x1 = check.finite_number("left", left), check.finite_number("right", right)
    y0, y1 = check.finite_number("bottom", bottom), check.finite_number("top", top)
    n, f = check.finite_number("near", near), check.finite_number("far", far)
    if x0 == x1:
        raise ValueError(f"right must differ from left, both are {x0!r}")
    if y0 == y1:
        raise ValueError(f"top must differ from bottom, both are {y0!r}")
    if f <= n:
        raise ValueError(f"far must be above near = {n!r}, got {f!r}")
    with np.errstate(over="ignore", invalid="ignore"):
        low, high = np.array([x0, y0, n]), np.array([x1, y1, f])
        scale, middle = 2.0 / (high - low), -(high + low) / (high - low)
    for name, one, other, k in (("right", x0, x1, 0), ("top", y0, y1, 1), ("far", n, f, 2)):
        if not (np.isfinite(scale[k]) and np.isfinite(middle[k])):
            raise ValueError(f"{name} is too close to {one!r} or too far from it: {other!r}")
    matrix = np.diag([scale[0], scale[1], -scale[2], 1.0])
    matrix[:3, 3] = middle
    return matrix + 0.0


def viewport(width: int, height: int, convention: ViewportConvention = "edges") -> Matrix:
    """
    Return ``screen_from_ndc``: x right, y down, pixels; depth passes through unchanged.

    Parameters
    ----------
    width, height : int, pixels
    convention : {"edges", "centers"}
        ``"edges"`` puts NDC +-1 at the image's edges, 0 and W (scale W/2). ``"centers"`` puts them
        at the centres of the first and last pixel, 0.5 and W - 0.5 (scale (W - 1)/2).

    Raises
    ------
    ValueError
        If a side is not a whole number in 1..16384, or the convention is unknown.
    """
    w, h = check.image_size("width, height", (width, height))
    inset = 0 if check.one_of("convention", convention, VIEWPORT_CONVENTIONS) == "edges" else 1
    matrix = np.diag([(w - inset) / 2.0, (inset - h) / 2.0, 1.0, 1.0])
    matrix[:2, 3] = w / 2.0, h / 2.0
    return matrix


def normal_matrix(matrix: ArrayLike) -> Float64:
    """
    Return the 3x3 matrix that carries normals: the inverse transpose, up to a positive factor.

    Parameters
    ----------
    matrix : (4, 4) array_like
        Only the upper-left 3x3 is used.

    Returns
    -------
    (3, 3) float64
        The inverse transpose where it exists and is finite. Else a positive multiple of the
        cofactor matrix times the sign of the determinant (+1 for 0), which turns normals the same
        way and is finite for singular matrices too: flattening by diag(1, 1, 0) keeps the normal
        (0, 0, 1). Below rank two every normal is lost and the result is zero.

    Raises
    ------
    ValueError
        If ``matrix`` is not a finite 4x4 matrix.
    """
    return np.array(normal_rows(check.finite_array("matrix", matrix, (4, 4)).tolist()))


def normal_rows(matrix: list[list[float]]) -> list[list[float]]:
    """Return what `normal_matrix` does, of a finite matrix as rows, as rows."""
    (xx, xy, xz, _), (yx, yy, yz, _), (zx, zy, zz, _) = matrix[:3]
    # Bring the largest entry into [1, 2) by a power of two, so that no product underflows.
    exponent = 1 - math.frexp(max(map(abs, (xx, xy, xz, yx, yy, yz, zx, zy, zz))))[1]
    a = math.ldexp(xx, exponent), math.ldexp(yx, exponent), math.ldexp(zx, exponent)
    b = math.ldexp(xy, exponent), math.ldexp(yy, exponent), math.ldexp(zy, exponent)
    c = math.ldexp(xz, exponent), math.ldexp(yz, exponent), math.ldexp(zz, exponent)
    columns = cross(b, c), cross(c, a), cross(a, b)
    determinant = dot(a, columns[0])
    if determinant != 0.0:
        try:
            inverse = [
                [math.ldexp(x / determinant, exponent) + 0.0 for x in column] for column in columns
            ]
        except OverflowError:
            inverse = [[math.inf]]
        if all(map(math.isfinite, itertools.chain.from_iterable(inverse))):
            return list(map(list, zip(*inverse, strict=True)))
    sign = -1.0 if determinant < 0.0 else 1.0
    return [[sign * x + 0.0 for x in row] for row in zip(*columns, strict=True)]


def normal_matrices(matrices: Float64) -> Float64:
    """
    Return the `normal_matrix` of each of many matrices, the same bits.

    Parameters
    ----------
    matrices : (N, 4, 4) float64, finite
        Only the upper-left 3x3 is used.

    Returns
    -------
    (N, 3, 3) float64
    """
    linear = matrices[:, :3, :3]
    exponents = 1 - np.frexp(np.abs(linear).max(axis=(1, 2), keepdims=True))[1]
    columns = np.ldexp(linear, exponents).transpose(2, 1, 0)
    cofactors = np.empty((3, 3, len(matrices)))
    for k in range(3):
        cofactors[:, k] = cross(columns[(k + 1) % 3], columns[(k + 2) % 3])
    determinants = dot(columns[0], list(cofactors[:, 0]))
    with np.errstate(all="ignore"):
        inverses = np.ldexp(cofactors / determinants, exponents[:, 0, 0])
    is_finite = np.isfinite(inverses).all(axis=(0, 1))
    fallback = np.where(determinants < 0.0, -cofactors, cofactors)
    return np.ascontiguousarray((np.where(is_finite, inverses, fallback) + 0.0).transpose(2, 0, 1))


def inverse(matrix: ArrayLike) -> Matrix:
    """
    Return the inverse of a matrix, such as world from camera of camera from world.

    By elimination in a fixed order, each pivot the entry that is largest beside its row: matrices
    whose rows are of different sizes, pixels beside depths, keep their digits.

    Parameters
    ----------
    matrix : (4, 4) array_like

    Returns
    -------
    (4, 4) float64

    Raises
    ------
    ValueError
        If ``matrix`` is not a finite 4x4 matrix, or has no finite inverse.
    """
    rows = check.finite_array("matrix", matrix, (4, 4)).tolist()
    # Powers of two are exact: rows whose largest entry is in [0.5, 1).
    exponents = [min(-math.frexp(max(map(abs, row)))[1], _MAX_EXPONENT) for row in rows]
    work = [
        [math.ldexp(entry, exponent) for entry in (*row, *unit)]
        for row, unit, exponent in zip(rows, _IDENTITY, exponents, strict=True)
    ]
    for k in range(4):
        pivot = max(range(k, 4), key=lambda n: abs(work[n][k]))
        work[k], work[pivot] = work[pivot], work[k]
        pivot_value = work[k][k]
        if pivot_value == 0.0:
            raise ValueError(f"matrix must have an inverse, got {rows}")
        work[k] = [entry / pivot_value for entry in work[k]]
        for n in range(4):
            if n != k:
                factor = work[n][k]
                work[n] = [a - factor * b for a, b in zip(work[n], work[k], strict=True)]
    result = np.array([row[4:] for row in work]) + 0.0
    if not np.isfinite(result).all():
        raise ValueError(f"matrix must have a finite inverse, got {rows}")
    return result


def apply(matrix: ArrayLike, points: ArrayLike) -> Float64:
    """
    Transform points and divide by w.

    Parameters
    ----------
    matrix : (4, 4) array_like
    points : (N, 3) or (3,) array_like

    Returns
    -------
    float64, the shape of ``points``
        A point with w = 0 (at infinity) gives infinite or NaN coordinates.

    Raises
    ------
    ValueError
        If ``matrix`` is not a finite 4x4 matrix, or ``points`` has another shape.
    """
    positions = check.unmasked_array("points", points)
    single = positions.ndim == 1
    positions = positions[None] if single else positions
    homogeneous = transform_points(check.finite_array("matrix", matrix, (4, 4)), positions)
    with np.errstate(all="ignore"):
        result = homogeneous[:, :3] / homogeneous[:, 3:]
    return result[0] if single else result


def transform_points(matrix: ArrayLike, points: ArrayLike) -> Float64:
    """
    Multiply points by a matrix, without the divide: row k is ``matrix`` times (x, y, z, 1).

    Parameters
    ----------
    matrix : (4, 4) array_like
    points : (N, 3) array_like of numbers
        Any dtype and strides; the arithmetic is float64.

    Returns
    -------
    (N, 4) float64
        NaN and infinite entries propagate, also through zeros of the matrix; nothing is raised for
        them.

    Raises
    ------
    ValueError
        If a shape differs.

    Notes
    -----
    Each entry is ((m0 x + m1 y) + m2 z) + m3 with every operation rounded once, so the result
    depends on neither the block size nor the CPU.
    """
    rows = check.number_array("matrix", matrix)
    if rows.shape != (4, 4):
        raise ValueError(f"matrix must have shape (4, 4), got {rows.shape}")
    source = check.unmasked_array("points", points)
    if source.dtype.kind not in "buif":
        source = check.number_array("points", points)
    if source.ndim != 2 or source.shape[1] != 3:
        raise ValueError(f"points must have shape (n, 3), got {source.shape}")
    count = len(source)
    result = np.empty((count, 4))
    scratch = np.empty((5, min(_POINTS_PER_BLOCK, count)))
    with np.errstate(all="ignore"):
        for start in range(0, count, _POINTS_PER_BLOCK):
            block = slice(start, start + _POINTS_PER_BLOCK)
            _transform_block(rows.tolist(), source[block], result[block], scratch)
    return result


def transform_instances(matrices: Float64, points: Float64) -> Float64:
    """
    Multiply points by each of many affine matrices; the bits of `transform_points`.

    Parameters
    ----------
    matrices : (K, 4, 4) float64
        The last row is not read.
    points : (N, 3) float64

    Returns
    -------
    (K, N, 3) float64
    """
    x, y, z = points.T
    columns = matrices[:, :3, :, np.newaxis]
    with np.errstate(all="ignore"):
        sums = columns[:, :, 0] * x + columns[:, :, 1] * y + columns[:, :, 2] * z
        return np.moveaxis(sums + columns[:, :, 3], 1, 2)


def _transform_block(
    rows: list[list[float]], source: NDArray[Any], out: Matrix, scratch: Matrix
) -> None:
    """Write the homogeneous product of one block of points to ``out``."""
    x, y, z, total, product = scratch[:, : len(source)]
    for column, coordinate in enumerate((x, y, z)):
        np.copyto(coordinate, source[:, column])
    for column, (m0, m1, m2, m3) in enumerate(rows):
        np.multiply(x, m0, out=total)
        np.multiply(y, m1, out=product)
        np.add(total, product, out=total)
        np.multiply(z, m2, out=product)
        np.add(total, product, out=total)
        np.add(total, m3, out=out[:, column])
