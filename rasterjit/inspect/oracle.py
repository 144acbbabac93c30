"""
Answer what a picture must be, exactly and slowly, with nothing but whole numbers and fractions.

This is the reference that RasterJIT is tested against, and yours to check a frame, or any other
rasterizer, with. It is written to be read: Python ints and ``fractions.Fraction`` only, no NumPy,
no rounding but where a rule of rasterization rounds. Floats and NumPy scalars are taken at their
exact value. Expect some microseconds for each triangle and pixel: use it on small images.

>>> import rasterjit as rj
>>> clip_positions = [(-0.5, -0.5, 0, 1), (0.75, -0.25, 0, 1), (0, 0.75, 0, 1)]
>>> seen = rj.rasterize(clip_positions, [(0, 1, 2)], (32, 24))
>>> exact = rj.oracle.render_faces(clip_positions, [(0, 1, 2)], (32, 24))
>>> {(i, j) for j, i in zip(*(seen.face_id == 0).nonzero())} == set(exact)
True

Conventions
-----------
Screen space: x right, y down, in pixels; pixel (column i, row j) is the square from (i, j) to
(i + 1, j + 1), and its centre is at (i + 1/2, j + 1/2). Clip space is OpenGL's: the view volume is
``-w <= x, y, z <= w`` and y points up. A vertex is put on the sub-pixel grid once: its screen
coordinates are rounded, half to even, to multiples of ``2**-subpixel_bits`` pixel, and all that
follows uses the rounded ones. "Snapped" coordinates are ints that count those steps.

Top-left rule: go round a triangle clockwise as seen on the screen; an edge that goes straight to
the right is a *top* edge, one that goes upwards a *left* one. A sample on an edge belongs to the
triangle only if that edge is a top or a left one. So a sample on an edge that two triangles share
belongs to exactly one of them.

Lines are Bresenham's with both ends; a tie goes to the larger minor coordinate. 8-bit colours are
rounded half up.

References
----------
.. [1] J. Pineda, "A Parallel Algorithm for Polygon Rasterization", SIGGRAPH 1988: edge functions.
.. [2] Microsoft, "Direct3D 11.3 Functional Specification", sections 3.4.1 (triangle rasterization
   rules: the top-left rule) and 15.16 (the sub-pixel grid).
.. [3] I. Sutherland and G. Hodgman, "Reentrant Polygon Clipping", CACM 17(1), 1974.
.. [4] J. E. Bresenham, "Algorithm for computer control of a digital plotter", IBM Systems Journal
   4(1), 1965.
.. [5] T. Porter and T. Duff, "Compositing Digital Images", SIGGRAPH 1984: the over operator.
"""

from __future__ import annotations

import math
import operator
from collections import Counter
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Literal, NamedTuple, TypeAlias

__all__ = [
    "VIEW_VOLUME", "WrongPixel", "affine_weights", "clip_near", "clip_polygon", "clip_weights",
    "colormap_entry", "composite", "covered_pixels", "covers", "depth_at", "edge", "explain_fill",
    "explain_line", "guard_band", "interpolate", "line_colors", "line_pixels",
    "perspective_weights", "pixel_area", "plane_distance", "polygon_area", "render_faces",
    "round_half_up", "screen_position", "snap", "snap_triangle", "view_planes", "visible_faces",
]  # fmt: skip

Number: TypeAlias = int | Fraction | float
"""Type of inputs; NumPy scalars do as well."""
Exact: TypeAlias = int | Fraction
"""Type of results."""
Numbers: TypeAlias = Sequence[Number]
Points: TypeAlias = Sequence[Numbers]
Pixel: TypeAlias = tuple[int, int]
Weights: TypeAlias = tuple[Fraction, Fraction, Fraction]
Vertex: TypeAlias = tuple[Fraction, Fraction, Fraction, Fraction]

CENTRE = (Fraction(1, 2), Fraction(1, 2))
"""Sample position in a pixel, from its upper left corner."""

MAX_SUBPIXEL_BITS = 1074
"""Bits of the finest sub-pixel grid: every float64 is a multiple of 2**-1074."""

GUARD_PIXELS = 8192
"""Width of the engine's guard band around the image, pixels."""


# --- taking numbers at their exact value ----------------------------------------------------------


def _to_exact(name: str, value: Number) -> Exact:
    """Return a number at its exact value, or raise ``ValueError``."""
    try:
        return value if isinstance(value, Fraction) else operator.index(value)
    except TypeError:
        pass
    if not hasattr(value, "as_integer_ratio"):
        raise ValueError(f"{name} must be a number, got {value!r}")
    try:
        return Fraction(*value.as_integer_ratio())
    except (OverflowError, ValueError):
        raise ValueError(f"{name} must be finite, got {value!r}") from None


def _to_rows(name: str, rows: Iterable, length: int | None = None) -> list:
    """Return rows, of a given number if any, as a list, or raise ``ValueError``."""
    try:
        entries = list(rows)
    except TypeError:
        raise ValueError(f"{name} must be a sequence, got {rows!r}") from None
    if length is not None and len(entries) != length:
        raise ValueError(f"{name} must have {length} entries, got {len(entries)}")
    return entries


def _to_vector(name: str, values: Iterable[Number], length: int | None) -> tuple[Exact, ...]:
    """Return numbers at their exact values, or raise ``ValueError``."""
    numbers = _to_rows(name, values, length)
    return tuple(_to_exact(f"{name}[{n}]", value) for n, value in enumerate(numbers))


def _to_points(
    name: str, rows: Iterable[Iterable[Number]], length: int, count: int | None = None
) -> tuple[tuple[Exact, ...], ...]:
    """Return points at their exact values, or raise ``ValueError``."""
    points = _to_rows(name, rows, count)
    return tuple(_to_vector(f"{name}[{n}]", row, length) for n, row in enumerate(points))


def _to_int(name: str, value: int, minimum: int | None = None) -> int:
    """Return an int that is not below ``minimum``, or raise ``ValueError``."""
    try:
        number = operator.index(value)
    except TypeError:
        raise ValueError(f"{name} must be a whole number, got {value!r}") from None
    if minimum is not None and number < minimum:
        raise ValueError(f"{name} must be at least {minimum}, got {number}")
    return number


def _to_int_pair(name: str, pair: Sequence[int], minimum: int | None = None) -> tuple[int, int]:
    """Return two ints that are not below ``minimum``, or raise ``ValueError``."""
    first, second = _to_rows(name, pair, 2)
    return _to_int(f"{name}[0]", first, minimum), _to_int(f"{name}[1]", second, minimum)


def _check_bits(subpixel_bits: int) -> int:
    """Return the bits of a sub-pixel grid, or raise ``ValueError``."""
    bits = _to_int("subpixel_bits", subpixel_bits, 0)
    if bits > MAX_SUBPIXEL_BITS:
        raise ValueError(f"subpixel_bits must be at most {MAX_SUBPIXEL_BITS}, got {bits}")
    return bits


def round_half_up(value: Number) -> int:
    """
    Round to the nearest whole number, a tie upwards, as 8-bit colours and lines are.

    Parameters
    ----------
    value : number

    Returns
    -------
    int

    Raises
    ------
    ValueError
        If the value is NaN, infinite or no number.
    """
    return math.floor(_to_exact("value", value) + Fraction(1, 2))


# --- the sub-pixel grid ---------------------------------------------------------------------------


def snap(value: Number, subpixel_bits: int = 8) -> int:
    """
    Snap a screen coordinate to the sub-pixel grid, half to even.

    Parameters
    ----------
    value : number, screen, pixels
    subpixel_bits : int
        The grid has ``2**subpixel_bits`` steps to the pixel.

    Returns
    -------
    int
        In steps of the grid.

    Raises
    ------
    ValueError
        If the value is not finite or the number of bits is not in 0 to 1074.
    """
    return round(_to_exact("value", value) * (1 << _check_bits(subpixel_bits)))


def snap_triangle(
    points: Points, subpixel_bits: int = 8
) -> tuple[tuple[int, int], tuple[int, int], tuple[int, int]]:
    """
    Snap the three points of a triangle to the sub-pixel grid, half to even.

    Parameters
    ----------
    points : three (x, y), screen, pixels
    subpixel_bits : int
        The grid has ``2**subpixel_bits`` steps to the pixel.

    Returns
    -------
    three (int, int)
        In steps of the grid; points may coincide.

    Raises
    ------
    ValueError
        If there are not three points, one is not finite, or the bits are not in 0 to 1074.
    """
    return _snap_points("points", points, subpixel_bits)


def _snap_points(name, points, subpixel_bits) -> tuple[Pixel, Pixel, Pixel]:
    """Return three points on the grid, or raise ``ValueError`` naming the argument."""
    first, second, third = (
        (snap(x, subpixel_bits), snap(y, subpixel_bits)) for x, y in _to_points(name, points, 2, 3)
    )
    return first, second, third


# --- coverage -------------------------------------------------------------------------------------


def _edge_value(a, b, p):
    """Return the edge function of exact points."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def _covers_point(triangle, point) -> bool:
    """Tell whether a triangle of exact points owns an exact point."""
    a, b, c = triangle
    area = _edge_value(a, b, c)
    if area == 0:
        return False
    if area < 0:
        b, c = c, b
    for start, end in ((a, b), (b, c), (c, a)):
        value = _edge_value(start, end, point)
        is_left, is_top = end[1] < start[1], end[1] == start[1] and end[0] > start[0]
        if value < 0 or (value == 0 and not (is_left or is_top)):
            return False
    return True


def edge(a: Numbers, b: Numbers, p: Numbers) -> Exact:
    """
    Return the edge function of the line from a to b at p: twice the area of the triangle a, b, p.

    Positive where a, b, p run clockwise as seen on the screen (y down), zero on the line or if a
    and b coincide.

    Parameters
    ----------
    a, b, p : (x, y), all in one unit

    Returns
    -------
    int or Fraction
        In that unit, squared.

    Raises
    ------
    ValueError
        If a point is not two finite numbers.
    """
    return _edge_value(_to_vector("a", a, 2), _to_vector("b", b, 2), _to_vector("p", p, 2))


def covers(triangle: Points, point: Numbers) -> bool:
    """
    Tell whether a triangle covers a point, by the top-left rule.

    The triangle is taken as it is: snap it first where vertices are on a grid.

    Parameters
    ----------
    triangle : three (x, y), y down, of either winding
    point : (x, y), in the same unit

    Returns
    -------
    bool
        False if the triangle has no area.

    Raises
    ------
    ValueError
        If there are not three points, or one is not two finite numbers.
    """
    return _covers_point(_to_points("triangle", triangle, 2, 3), _to_vector("point", point, 2))


def covered_pixels(
    triangle: Points,
    size: tuple[int, int],
    *,
    subpixel_bits: int = 8,
    window: tuple[int, int, int, int] | None = None,
    sample: Numbers = CENTRE,
) -> set[Pixel]:
    """
    List the pixels whose sample a triangle covers, after its vertices are snapped.

    Parameters
    ----------
    triangle : three (x, y), screen, pixels, of either winding
        It may reach beyond the image by any distance.
    size : (int, int)
        Width and height of the image, pixels.
    subpixel_bits : int
        The grid has ``2**subpixel_bits`` steps to the pixel.
    window : (left, top, right, bottom), optional
        The pixels to look at instead of the whole image, right and bottom excluded.
    sample : (x, y), pixels
        The sample's place from the upper left corner of the pixel; its centre by default.

    Returns
    -------
    set of (column, row)
        Empty if the snapped triangle has no area.

    Raises
    ------
    ValueError
        If an argument has a wrong length or value, or a number is not finite.
    """
    width, height = _to_int_pair("size", size, 1)
    left, top, right, bottom = 0, 0, width, height
    if window is not None:
        left, top, right, bottom = (
            _to_int(f"window[{n}]", side) for n, side in enumerate(_to_vector("window", window, 4))
        )
    corners = _snap_points("triangle", triangle, subpixel_bits)
    offset = _to_vector("sample", sample, 2)
    return set(_list_covered(corners, (left, top, right, bottom), subpixel_bits, offset))


def _list_covered(corners, window, subpixel_bits, sample=CENTRE):
    """Yield the pixels of a window, row by row, whose sample a snapped triangle covers."""
    left, top, right, bottom = window
    scale = 1 << subpixel_bits
    # Only pixels whose sample lies in the box of the triangle can be covered.
    xs, ys = (
        [Fraction(corner[axis], scale) - sample[axis] for corner in corners] for axis in (0, 1)
    )
    columns = range(max(left, math.ceil(min(xs))), min(right, math.floor(max(xs)) + 1))
    rows = range(max(top, math.ceil(min(ys))), min(bottom, math.floor(max(ys)) + 1))
    # Count on a grid so fine that the samples are whole numbers too.
    subdivision = math.lcm(*(Fraction(coordinate).denominator for coordinate in sample))
    corners = [(x * subdivision, y * subdivision) for x, y in corners]
    step = scale * subdivision
    first_x, first_y = (int(coordinate * subdivision) * scale for coordinate in sample)
    for row in rows:
        for column in columns:
            if _covers_point(corners, (column * step + first_x, row * step + first_y)):
                yield column, row


# --- interpolation and depth ----------------------------------------------------------------------


def affine_weights(triangle: Points, point: Numbers) -> Weights:
    """
    Return the weights of the three vertices at a point, linear on the screen.

    Depth z / w is interpolated with these, attributes only if all w are equal.

    Parameters
    ----------
    triangle : three (x, y), of either winding
        Snapped, to get what an image shows.
    point : (x, y), in the same unit, inside the triangle or not

    Returns
    -------
    three Fraction
        Their sum is 1; none is negative inside.

    Raises
    ------
    ValueError
        If the triangle has no area, or an argument is not of finite numbers.
    """
    a, b, c = _to_points("triangle", triangle, 2, 3)
    p = _to_vector("point", point, 2)
    area = Fraction(_edge_value(a, b, c))
    if area == 0:
        raise ValueError(f"triangle must have an area, got {triangle!r}")
    return _edge_value(b, c, p) / area, _edge_value(c, a, p) / area, _edge_value(a, b, p) / area


def perspective_weights(triangle: Points, ws: Numbers, point: Numbers) -> Weights:
    """
    Return the perspective-correct weights of the three vertices at a point.

    Parameters
    ----------
    triangle : three (x, y), of either winding
        Snapped, to get what an image shows.
    ws : three numbers above zero
        The clip-space w of the vertices.
    point : (x, y), in the unit of the triangle

    Returns
    -------
    three Fraction
        Their sum is 1.

    Raises
    ------
    ValueError
        If the triangle has no area, a w is not above zero (clip first), an argument is not of
        finite numbers, or the point, outside the triangle, is on the horizon of its plane.
    """
    weights = affine_weights(triangle, point)
    w = _to_vector("ws", ws, 3)
    if min(w) <= 0:
        raise ValueError(f"ws must be above zero, got {ws!r}")
    return _normalize([weight / at for weight, at in zip(weights, w, strict=True)], point)


def clip_weights(clip_positions: Points, point: Numbers, size: tuple[int, int]) -> Weights:
    """
    Return the weights of the three vertices of a face in clip space at a point of the screen.

    Nothing is snapped and nothing is clipped, so any vertex may lie behind the eye: the weights of
    the face's own vertices at a pixel of a clipped face.

    Parameters
    ----------
    clip_positions : three (x, y, z, w), clip space
    point : (x, y), screen, pixels
    size : (int, int)
        Width and height of the image, pixels.

    Returns
    -------
    three Fraction
        Perspective-correct; their sum is 1.

    Raises
    ------
    ValueError
        If the face is seen edge-on, the point is on the horizon of its plane, or an argument is
        not of finite numbers.
    """
    corners = [(x, y, w) for x, y, _, w in _to_points("clip_positions", clip_positions, 4, 3)]
    width, height = _to_int_pair("size", size, 1)
    x, y = _to_vector("point", point, 2)
    ray = (2 * Fraction(x) / width - 1, 1 - 2 * Fraction(y) / height, Fraction(1))
    a, b, c = corners
    return _normalize([_determinant(ray, *pair) for pair in ((b, c), (c, a), (a, b))], point)


def _determinant(a, b, c):
    """Return the determinant of three rows."""
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


def _normalize(weights, point) -> Weights:
    """Return three shares divided by their sum."""
    total = Fraction(sum(weights))
    if total == 0:
        raise ValueError(f"point must not be on the horizon of the plane, got {point!r}")
    first, second, third = (weight / total for weight in weights)
    return first, second, third


def interpolate(
    weights: Numbers, values: Sequence[Number] | Sequence[Numbers]
) -> Fraction | tuple[Fraction, ...]:
    """
    Return the weighted sum of the values at the vertices.

    Parameters
    ----------
    weights : (N,) numbers
    values : (N,) or (N, K) numbers

    Returns
    -------
    Fraction or tuple of K Fraction

    Raises
    ------
    ValueError
        If the lengths differ or a number is not finite.
    """
    exact_weights = _to_vector("weights", weights, None)
    values = _to_rows("values", values, len(exact_weights))
    if values and hasattr(values[0], "__len__"):
        rows = _to_points("values", values, len(values[0]))
        return tuple(_sum_weighted(exact_weights, column) for column in zip(*rows, strict=True))
    return _sum_weighted(exact_weights, _to_vector("values", values, None))


def _sum_weighted(weights, values) -> Fraction:
    """Return the weighted sum of exact numbers."""
    return sum((w * v for w, v in zip(weights, values, strict=True)), Fraction(0))


def colormap_entry(value: Number, low: Number, high: Number, count: int) -> int:
    """
    Return which entry of a colour map stands for a value.

    Parameters
    ----------
    value : number
    low, high : numbers
        The range, low <= high. What is outside has the entry of its nearer end; without a width
        all values have entry 0.
    count : int
        Number of entries.

    Returns
    -------
    int
        In 0..count-1.

    Raises
    ------
    ValueError
        If a number is not finite, the range goes down, or there is no entry.
    """
    number, start, end = (
        _to_exact(name, given) for name, given in (("value", value), ("low", low), ("high", high))
    )
    count = _to_int("count", count, 1)
    if start > end:
        raise ValueError(f"low must not be above high, got {low!r} and {high!r}")
    if start == end:
        return 0
    entry = math.floor(Fraction(count * (number - start)) / (end - start))
    return min(max(entry, 0), count - 1)


def depth_at(triangle: Points, depths: Numbers, point: Numbers) -> Fraction:
    """
    Return the depth at a point of the plane through three vertices.

    Parameters
    ----------
    triangle : three (x, y)
        Snapped, to get what an image shows.
    depths : three numbers
        Anything that is linear on the screen, such as z / w or 1 / w.
    point : (x, y), in the unit of the triangle

    Returns
    -------
    Fraction

    Raises
    ------
    ValueError
        If the triangle has no area, or an argument is not of finite numbers.
    """
    return _sum_weighted(affine_weights(triangle, point), _to_vector("depths", depths, 3))


# --- visibility -----------------------------------------------------------------------------------


def visible_faces(
    triangles: Sequence[Points],
    depths: Sequence[Numbers],
    size: tuple[int, int],
    *,
    subpixel_bits: int = 8,
) -> dict[Pixel, tuple[int, Fraction]]:
    """
    Find the visible triangle at every pixel centre, and its depth there.

    Parameters
    ----------
    triangles : (F,) of three (x, y), screen, pixels
        Snapped first; those without area then are left out.
    depths : (F,) of three numbers
        At the vertices, linear on the screen. The smaller depth wins, the lower face a tie.
    size : (int, int)
        Width and height of the image, pixels.
    subpixel_bits : int
        The grid has ``2**subpixel_bits`` steps to the pixel.

    Returns
    -------
    dict of (column, row): (face, depth)
        Depths are Fractions; pixels that show nothing are absent.

    Raises
    ------
    ValueError
        If an argument has a wrong length or value, or a number is not finite.
    """
    image_window = (0, 0, *_to_int_pair("size", size, 1))
    triangles = _to_rows("triangles", triangles)
    depths = _to_rows("depths", depths, len(triangles))
    visible: dict[Pixel, tuple[int, Fraction]] = {}
    for face, triangle in enumerate(triangles):
        corners = _snap_points(f"triangles[{face}]", triangle, subpixel_bits)
        corner_depths = _to_vector(f"depths[{face}]", depths[face], 3)
        _draw_triangle(visible, face, (corners, corner_depths), image_window, subpixel_bits)
    return visible


def _draw_triangle(visible, face, snapped, window, subpixel_bits) -> None:
    """Enter the pixels where a snapped triangle is nearer than what is shown."""
    corners, depths = snapped
    scale = 1 << subpixel_bits
    for column, row in _list_covered(corners, window, subpixel_bits):
        centre = ((column + CENTRE[0]) * scale, (row + CENTRE[1]) * scale)
        depth = depth_at(corners, depths, centre)
        if (column, row) not in visible or depth < visible[column, row][1]:
            visible[column, row] = (face, depth)


def screen_position(clip_position: Numbers, size: tuple[int, int]) -> tuple[Fraction, Fraction]:
    """
    Return where a clip position lies on the screen; not snapped.

    Parameters
    ----------
    clip_position : (x, y, z, w), clip space
    size : (int, int)
        Width and height of the image, pixels.

    Returns
    -------
    (Fraction, Fraction)
        Pixels, y down.

    Raises
    ------
    ValueError
        If w is not above zero (clip first), or a number is not finite.
    """
    x, y, _, w = _to_vector("clip_position", clip_position, 4)
    width, height = _to_int_pair("size", size, 1)
    if w <= 0:
        raise ValueError(f"clip_position must have w above zero, got {clip_position!r}")
    return (Fraction(x) / w + 1) * width / 2, (1 - Fraction(y) / w) * height / 2


def render_faces(
    clip_positions: Sequence[Numbers],
    faces: Sequence[Sequence[int]],
    size: tuple[int, int],
    *,
    subpixel_bits: int = 8,
) -> dict[Pixel, tuple[int, Fraction]]:
    """
    Find the visible face at every pixel, as ``rasterjit.rasterize`` does: the exact answer to it.

    A face is snapped as it is if it lies between near and far and inside the guard band (8192
    pixels around the image). Any other is first cut to those six planes, exactly; the vertices
    that are left are snapped, and the polygon is drawn as a fan from its first vertex. A face
    starts with its least corner: by x, or where that is the same by y, z and w.

    The engine rounds where this does not, so it may rightly differ

    - near a tie of the grid: it finds ``(x / w + 1) * width / 2`` in float64, so a vertex whose
      exact place is within some ``2**-52`` of its coordinate from the middle of two grid points may
      land on the other one (never if w and the sizes are powers of two and x, y short dyadic
      numbers);
    - for the same reason at vertices that clipping makes, which are rounded to float64 themselves;
    - where two depths are closer than float32 tells apart: it compares depths rounded to float32.

    It also leaves out a face with a coordinate that is not finite, which is an error here, or
    beyond 1e150.

    Parameters
    ----------
    clip_positions : (V,) of (x, y, z, w), clip space
    faces : (F,) of three vertex numbers
        Both windings are drawn.
    size : (int, int)
        Width and height of the image, pixels.
    subpixel_bits : int
        The grid has ``2**subpixel_bits`` steps to the pixel.

    Returns
    -------
    dict of (column, row): (face, depth)
        Depths are z / w as Fractions; the smaller wins, the lower face a tie. Pixels that show
        nothing are absent.

    Raises
    ------
    ValueError
        If an argument has a wrong length or value, a face points outside the vertices, or a number
        is not finite.
    """
    positions = _to_points("clip_positions", clip_positions, 4)
    bits = _check_bits(subpixel_bits)
    image_window = (0, 0, *_to_int_pair("size", size, 1))
    planes = guard_band(size)
    visible: dict[Pixel, tuple[int, Fraction]] = {}
    for face, numbers in enumerate(_to_rows("faces", faces)):
        corners = [_to_int(f"faces[{face}]", n, 0) for n in _to_rows(f"faces[{face}]", numbers)]
        if len(corners) != 3 or max(corners) >= len(positions):
            raise ValueError(
                f"faces[{face}] must be three vertices below {len(positions)}, got {numbers!r}"
            )
        # Cut the face, the least corner first; one inside the planes stays as it is.
        first = min(range(3), key=lambda n: positions[corners[n]])
        rotated = corners[first:] + corners[:first]
        polygon = clip_polygon([positions[n] for n in rotated], planes)
        # Divide by w and snap every vertex once.
        screen = [screen_position(vertex, size) for vertex in polygon]
        snapped = [(snap(x, bits), snap(y, bits)) for x, y in screen]
        depths = [Fraction(z) / w for _, _, z, w in polygon]
        # Draw the fan.
        for n in range(1, len(polygon) - 1):
            piece = snapped[0], snapped[n], snapped[n + 1]
            corner_depths = depths[0], depths[n], depths[n + 1]
            _draw_triangle(visible, face, (piece, corner_depths), image_window, bits)
    return visible


# --- clipping -------------------------------------------------------------------------------------

Plane: TypeAlias = tuple[Exact, Exact, Exact, Exact]
"""Factors (a, b, c, d): the inner side is ``a x + b y + c z + d w >= 0``."""


def view_planes(guard_x: Number = 1, guard_y: Number = 1) -> tuple[Plane, ...]:
    """
    Return the planes near, far, left, right, bottom, top of a view volume, in this order.

    Parameters
    ----------
    guard_x, guard_y : number
        The volume is ``|x| <= guard_x w``, ``|y| <= guard_y w``, ``|z| <= w``.

    Returns
    -------
    six (a, b, c, d)
        The inner side is ``a x + b y + c z + d w >= 0``.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    gx, gy = _to_exact("guard_x", guard_x), _to_exact("guard_y", guard_y)
    return (
        (0, 0, 1, 1), (0, 0, -1, 1),
        (1, 0, 0, gx), (-1, 0, 0, gx),
        (0, 1, 0, gy), (0, -1, 0, gy),
    )  # fmt: skip


def guard_band(size: tuple[int, int]) -> tuple[Plane, ...]:
    """
    Return the planes that the engine cuts to: near, far, and the sides of the guard band.

    Parameters
    ----------
    size : (int, int)
        Width and height of the image, pixels; the band ends 8192 pixels beyond each side.

    Returns
    -------
    six (a, b, c, d)
        As `view_planes` returns them.

    Raises
    ------
    ValueError
        If the size is not two whole numbers above zero.
    """
    width, height = _to_int_pair("size", size, 1)
    return view_planes(
        1 + Fraction(2 * GUARD_PIXELS, width), 1 + Fraction(2 * GUARD_PIXELS, height)
    )


VIEW_VOLUME = view_planes()
"""OpenGL's view volume ``-w <= x, y, z <= w``: near, far, left, right, bottom, top."""


def _plane_value(plane, vertex):
    """Return the value of a plane at an exact vertex, of any dimension."""
    return sum(a * x for a, x in zip(plane, vertex, strict=True))


def _clip_polygon(polygon, planes):
    """Cut a polygon of exact vertices to the inner side of planes, of any dimension."""
    for plane in planes:
        clipped = []
        for n, start in enumerate(polygon):
            end = polygon[(n + 1) % len(polygon)]
            start_distance, end_distance = _plane_value(plane, start), _plane_value(plane, end)
            if start_distance >= 0:
                clipped.append(start)
            if start_distance * end_distance < 0:
                t = Fraction(start_distance) / (start_distance - end_distance)
                clipped.append(tuple(p + t * (q - p) for p, q in zip(start, end, strict=True)))
        polygon = clipped
    return polygon


def plane_distance(plane: Numbers, clip_position: Numbers) -> Exact:
    """
    Return the signed distance of a clip position to a plane, not normalized.

    Parameters
    ----------
    plane : (a, b, c, d)
    clip_position : (x, y, z, w), clip space

    Returns
    -------
    int or Fraction
        ``a x + b y + c z + d w``: not negative on the inner side.

    Raises
    ------
    ValueError
        If an argument is not four finite numbers.
    """
    return _plane_value(
        _to_vector("plane", plane, 4), _to_vector("clip_position", clip_position, 4)
    )


def clip_polygon(
    polygon: Sequence[Numbers], planes: Sequence[Numbers] = VIEW_VOLUME
) -> list[Vertex]:
    """
    Cut a convex polygon in clip space to planes (Sutherland and Hodgman), before any division.

    Parameters
    ----------
    polygon : (N,) of (x, y, z, w), clip space
        Vertices may lie anywhere: behind the eye, or at infinity (``w == 0``).
    planes : (P,) of (a, b, c, d)
        Each keeps ``a x + b y + c z + d w >= 0``; vertices on a plane stay.

    Returns
    -------
    list of (x, y, z, w)
        Fractions, in the order of the polygon, all with ``w > 0``. Empty if fewer than three
        vertices are left, or if the polygon touches the eye itself (x = y = w = 0): it is seen
        edge-on then. A polygon without area stays one without area.

    Raises
    ------
    ValueError
        If a number is not finite, or what is left reaches infinity, or beyond it behind the eye:
        more planes are needed. Never with the planes of `VIEW_VOLUME`.
    """
    vertices = [tuple(map(Fraction, vertex)) for vertex in _to_points("polygon", polygon, 4)]
    # What is behind the eye is never seen; the view volume implies this plane.
    clipped = _clip_polygon(vertices, (*_to_points("planes", planes, 4), (0, 0, 0, 1)))
    at_the_eye = any(x == y == w == 0 for x, y, _, w in clipped)
    if len(clipped) < 3 or at_the_eye or all(w == 0 for *_, w in clipped):
        return []
    if any(w == 0 for *_, w in clipped):
        raise ValueError("polygon reaches infinity inside the planes: cut it to more of them")
    return clipped


def clip_near(polygon: Sequence[Numbers]) -> list[Vertex]:
    """
    Cut a convex polygon in clip space to the near plane ``z >= -w`` alone.

    Parameters
    ----------
    polygon : (N,) of (x, y, z, w), clip space

    Returns
    -------
    list of (x, y, z, w)
        As `clip_polygon` returns them.

    Raises
    ------
    ValueError
        If a number is not finite, or the polygon reaches infinity in front of the near plane,
        which a perspective or orthographic projection never makes.
    """
    return clip_polygon(polygon, VIEW_VOLUME[:1])


# --- area -----------------------------------------------------------------------------------------


def polygon_area(polygon: Points) -> Fraction:
    """
    Return the area of a simple polygon by the shoelace formula.

    Parameters
    ----------
    polygon : (N,) of (x, y), of either winding

    Returns
    -------
    Fraction
        Not negative; 0 for fewer than three points.

    Raises
    ------
    ValueError
        If a point is not two finite numbers.
    """
    points = _to_points("polygon", polygon, 2)
    following = points[1:] + points[:1]
    doubled = sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(points, following, strict=True))
    return Fraction(abs(doubled), 2)


def pixel_area(polygon: Points, column: int, row: int) -> Fraction:
    """
    Return the share of a pixel that a polygon covers: ideal anti-aliasing with a box filter.

    Parameters
    ----------
    polygon : (N,) of (x, y), screen, pixels, of either winding
        Simple; convex or not. Nothing is snapped.
    column, row : int

    Returns
    -------
    Fraction
        From 0 to 1; 0 for fewer than three points.

    Raises
    ------
    ValueError
        If a point is not two finite numbers, or the pixel not two whole ones.
    """
    i, j = _to_int("column", column), _to_int("row", row)
    square = (1, 0, -i), (-1, 0, i + 1), (0, 1, -j), (0, -1, j + 1)
    inside = _clip_polygon([(x, y, 1) for x, y in _to_points("polygon", polygon, 2)], square)
    return polygon_area([(x, y) for x, y, _ in inside])


# --- lines ----------------------------------------------------------------------------------------


def line_pixels(
    start: Sequence[int], end: Sequence[int], *, steps: Iterable[int] | None = None
) -> list[Pixel]:
    """
    List the pixels of Bresenham's line, from the start to the end, both included.

    It moves one pixel a step along its longer axis; along the other it takes the nearest pixel, at
    a tie the one with the larger coordinate, so both directions give the same pixels.

    Parameters
    ----------
    start, end : (int, int)
        Pixels (column, row), of any size.
    steps : ints from 0 to ``max(|dx|, |dy|)``, optional
        The steps to list instead of all: for lines too long to walk.

    Returns
    -------
    list of (column, row)
        One pixel if start and end coincide.

    Raises
    ------
    ValueError
        If a coordinate is not a whole number, or a step is not one of the line's.
    """
    (x0, y0), (x1, y1) = _to_int_pair("start", start), _to_int_pair("end", end)
    return [
        (round_half_up(x0 + t * (x1 - x0)), round_half_up(y0 + t * (y1 - y0)))
        for t in _line_parameters(x1 - x0, y1 - y0, steps)
    ]


def line_colors(
    start: Sequence[int],
    end: Sequence[int],
    start_color: Numbers,
    end_color: Numbers,
    *,
    steps: Iterable[int] | None = None,
) -> list[tuple[int, ...]]:
    """
    List the colours of the pixels that `line_pixels` lists, linear in the steps, rounded half up.

    Parameters
    ----------
    start, end : (int, int)
        Pixels (column, row), of any size.
    start_color, end_color : numbers, as many in both
        Channels, in steps of the 8-bit picture.
    steps : ints from 0 to ``max(|dx|, |dy|)``, optional
        The steps to list instead of all.

    Returns
    -------
    list of tuple of int
        The start colour if start and end coincide.

    Raises
    ------
    ValueError
        If a coordinate is not a whole number, a step is not one of the line's, a channel is not
        finite, or the colours have different lengths.
    """
    (x0, y0), (x1, y1) = _to_int_pair("start", start), _to_int_pair("end", end)
    first = _to_vector("start_color", start_color, None)
    last = _to_vector("end_color", end_color, len(first))
    return [
        tuple(round_half_up(a + t * (b - a)) for a, b in zip(first, last, strict=True))
        for t in _line_parameters(x1 - x0, y1 - y0, steps)
    ]


def _line_parameters(dx: int, dy: int, steps: Iterable[int] | None) -> Iterable[Fraction]:
    """Yield the parameters of a line's steps, from 0 to 1."""
    count = max(abs(dx), abs(dy))
    for step in range(count + 1) if steps is None else _to_rows("steps", steps):
        if not 0 <= _to_int("steps", step) <= count:
            raise ValueError(f"steps must be from 0 to {count}, got {step!r}")
        yield Fraction(step, count) if count else Fraction(0)


# --- what is wrong with a line or a fill ----------------------------------------------------------


Fault: TypeAlias = Literal["missing", "extra", "twice"]


class WrongPixel(NamedTuple):
    """
    A pixel that is not as the rules have it; as text, one line.

    Parameters
    ----------
    pixel : (int, int)
        Column and row.
    fault : {"missing", "extra", "twice"}
        What is wrong with it.
    reason : str
        The rule, with the numbers of this pixel.
    """

    pixel: Pixel
    fault: Fault
    reason: str

    def __str__(self) -> str:
        words = {"missing": "is missing", "extra": "is too many", "twice": "is there twice"}
        return f"{self.pixel} {words[self.fault]}: {self.reason}"


def explain_line(
    pixels: Iterable[Sequence[int]], start: Sequence[int], end: Sequence[int]
) -> list[WrongPixel]:
    r"""
    Say which pixels of somebody's line are wrong, by the rules of `line_pixels`, and why.

    Parameters
    ----------
    pixels : iterable of (int, int)
        The line to judge: columns and rows, in any order.
    start, end : (int, int)
        Both ends, which belong to it.

    Returns
    -------
    list of WrongPixel
        By row and column; empty if all is right.

    Raises
    ------
    ValueError
        If a coordinate is not a whole number.

    Examples
    --------
    >>> import rasterjit as rj
    >>> print(*rj.oracle.explain_line([(0, 0), (1, 0), (2, 1)], (0, 0), (2, 1)), sep="\n")
    (1, 0) is too many: in column 1 the line is at row 1/2, and a tie goes to the larger row, 1
    (1, 1) is missing: in column 1 the line is at row 1/2, and a tie goes to the larger row, 1
    """
    ends = _to_int_pair("start", start), _to_int_pair("end", end)
    return _compare_pixels(pixels, line_pixels(*ends), lambda one: _line_reason(one, *ends))


def _line_reason(pixel: Pixel, start: Pixel, end: Pixel) -> str:
    """Return the pixel of a line in the column or row of another, in words."""
    along = int(abs(end[0] - start[0]) < abs(end[1] - start[1]))
    across, words = 1 - along, ("column", "row")
    low, high = sorted((start[along], end[along]))
    if not low <= pixel[along] <= high:
        return f"the line goes from {words[along]} {low} to {high}"
    length = end[along] - start[along]
    slope = Fraction(end[across] - start[across], length) if length else Fraction(0)
    exact = start[across] + slope * (pixel[along] - start[along])
    where = f"in {words[along]} {pixel[along]} the line is at {words[across]} {exact}"
    nearest = round_half_up(exact)
    if nearest - exact == Fraction(1, 2):
        return f"{where}, and a tie goes to the larger {words[across]}, {nearest}"
    return f"{where}, and the nearest {words[across]} is {nearest}"


def explain_fill(
    pixels: Iterable[Sequence[int]],
    triangle: Points,
    size: tuple[int, int],
    *,
    subpixel_bits: int = 8,
) -> list[WrongPixel]:
    """
    Say which pixels of somebody's filled triangle are wrong, by the top-left rule, and why.

    Parameters
    ----------
    pixels : iterable of (int, int)
        The fill to judge: columns and rows, in any order.
    triangle : three (x, y), screen, pixels, of either winding
    size : (int, int)
        Width and height of the image, pixels.
    subpixel_bits : int
        The grid that corners are snapped to has ``2**subpixel_bits`` steps to the pixel.

    Returns
    -------
    list of WrongPixel
        By row and column; empty if all is right. Corners are called a, b and c in their order.

    Raises
    ------
    ValueError
        If an argument has a wrong length or value, or a number is not finite.

    Examples
    --------
    >>> import rasterjit as rj
    >>> corners = (0, 0), (3, 0), (0, 3)
    >>> mine = {(0, 0), (1, 0), (0, 1), (2, 0)}
    >>> print(*rj.oracle.explain_fill(mine, corners, (4, 4)))
    (2, 0) is too many: its centre lies on the edge from b to c, neither a top nor a left edge
    """
    sides = _to_int_pair("size", size, 1)
    corners = _snap_points("triangle", triangle, subpixel_bits)
    # The centre of a pixel is a whole number on a grid of half the step.
    doubled = tuple((2 * x, 2 * y) for x, y in corners)
    return _compare_pixels(
        pixels,
        covered_pixels(triangle, size, subpixel_bits=subpixel_bits),
        lambda one: _fill_reason(one, doubled, sides, 2 << subpixel_bits),
    )


def _fill_reason(pixel: Pixel, corners, size: Pixel, step: int) -> str:
    """Return where the centre of a pixel lies beside the edges of a triangle, in words."""
    if not all(0 <= place < side for place, side in zip(pixel, size, strict=True)):
        return f"the picture has {size[0]} × {size[1]} pixels"
    area = _edge_value(*corners)
    if area == 0:
        return "the triangle has no area, and covers nothing"
    centre = tuple(place * step + step // 2 for place in pixel)
    turn, outside, on_edges = (1 if area > 0 else -1), [], []
    for n, name in enumerate(("a to b", "b to c", "c to a")):
        start, end = corners[n], corners[(n + 1) % 3]
        value = turn * _edge_value(start, end, centre)
        across, down = turn * (end[0] - start[0]), turn * (end[1] - start[1])
        if value < 0:
            distance = -value / math.hypot(across, down) / step
            outside.append(f"the edge from {name}, by {distance:.3g} pixels")
        elif value == 0:
            is_top, is_left = down == 0 and across > 0, down < 0
            kind = "a top edge" if is_top else "a left edge" if is_left else ""
            on_edges.append((name, kind or "neither a top nor a left edge"))
    if outside:
        return f"its centre lies outside {' and '.join(outside)}"
    if on_edges:
        return "its centre lies on " + " and on ".join(
            f"the edge from {name}, {kind}" for name, kind in on_edges
        )
    return "its centre lies inside all three edges"


def _compare_pixels(pixels, wanted, reason) -> list[WrongPixel]:
    """Return the pixels that are wrong, by row and column, each with its reason."""
    counts = Counter(
        _to_int_pair(f"pixels[{n}]", pixel) for n, pixel in enumerate(_to_rows("pixels", pixels))
    )
    faults: dict[Pixel, Fault] = {pixel: "twice" for pixel, count in counts.items() if count > 1}
    faults |= dict.fromkeys(counts.keys() - set(wanted), "extra")
    faults |= dict.fromkeys(set(wanted) - counts.keys(), "missing")
    places = sorted(faults, key=lambda pixel: (pixel[1], pixel[0]))
    return [WrongPixel(place, faults[place], reason(place)) for place in places]


# --- transparency ---------------------------------------------------------------------------------


def composite(
    layers: Iterable[tuple[Numbers, Number]], background: Numbers = (0, 0, 0)
) -> tuple[Fraction, ...]:
    """
    Lay colours over a background (Porter and Duff's over).

    Parameters
    ----------
    layers : of (color, alpha), the nearest first
        Straight alpha, from 0 to 1: the colour is not multiplied by it. Linear light, to look
        right.
    background : (K,) numbers
        Opaque; black by default. Every colour has as many channels.

    Returns
    -------
    tuple of K Fraction
        The background if there are no layers.

    Raises
    ------
    ValueError
        If an alpha is not from 0 to 1, a number is not finite, or the numbers of channels differ.
    """
    result = tuple(map(Fraction, _to_vector("background", background, None)))
    for n, layer in reversed(list(enumerate(_to_rows("layers", layers)))):
        color, alpha = _to_rows(f"layers[{n}]", layer, 2)
        source = _to_vector(f"layers[{n}] color", color, len(result))
        opacity = _to_exact(f"layers[{n}] alpha", alpha)
        if not 0 <= opacity <= 1:
            raise ValueError(f"layers[{n}] alpha must be from 0 to 1, got {alpha!r}")
        result = tuple(opacity * c + (1 - opacity) * b for c, b in zip(source, result, strict=True))
    return result
