"""Dimensions: lines with a number beside them that says what they measure, as in drawings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from rasterjit.scene import validation as check
from rasterjit.scene.color import ColorLike, rgba
from rasterjit.scene.label import Label
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import Material
from rasterjit.scene.node import Node
from rasterjit.scene.portable_trig import polar_angle, sin_cos
from rasterjit.scene.validation import VectorLike
from rasterjit.scene.vectors import cross, dot, length, unit

Point = tuple[float, float, float]

HEAD_SHARE = 0.05
"""Length of an arrow's head, relative to the line."""

HEAD_SLOPE = 0.3
"""Half the width of an arrow's head, relative to its length."""

ARC_SEGMENTS = 48
"""Segments of the arc of an angle."""

MAX_DECIMALS = 12
"""Most digits behind the point."""

DEGREES_PER_RADIAN = 57.29577951308232


def length_dimension(
    start: VectorLike, end: VectorLike, *, offset: VectorLike = (0.0, 0.0, 0.0),
    units: str = "", scale: float = 1.0, decimals: int = 2, size: float = 14.0,
    color: ColorLike = "black", background: ColorLike | None = "white",
) -> Node:  # fmt: skip
    """
    Return a node that measures the distance between two points.

    It is an arrow with two heads, `Lines` one and a half pixels wide, with a `Label` in its middle,
    and thin lines from the points to its ends where it is moved aside; sections leave it whole. Its
    text is the number that follows from the points: add it at the top of a scene, for one that
    hangs below a scaled node would measure what was there before.

    Parameters
    ----------
    start, end : (3,) array_like, scene units
        Two points that differ.
    offset : (3,) array_like, scene units
        How far the arrow stands aside of the points.
    units : str
        Follows the number: ``"mm"``.
    scale : float
        What a scene unit is of these: 1000 for mm in a scene of metres; above 0.
    decimals : int
        Digits behind the point, 0..12.
    size : float
        Of the text, pixels: points times dpi / 72.
    color, background : colour
        Of lines and text, and of the box behind the text; ``None``: no box.

    Returns
    -------
    Node
        Its ``label.text`` is the measure.

    Raises
    ------
    ValueError
        Naming an argument that is not what it must be.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene = rj.load("models/torus_knot.obj")
    >>> node = scene.add(rj.length_dimension((0, 0, 0), (3, 4, 0), units="mm", decimals=1))
    >>> node.label and node.label.text
    '5.0 mm'
    """
    a, b = _two_points("start", start, "end", end)
    aside = check.triple("offset", offset)
    along = _between(a, b)
    strips = [[a, _add(a, aside)], [b, _add(b, aside)]] if any(aside) else []
    first, last = _add(a, aside), _add(b, aside)
    _check_finite("offset", aside, [*first, *last])
    across = _perpendicular(along, aside)
    size_of_head = HEAD_SHARE * _measure(along)
    inward = unit(along)
    strips += [[first, last], _make_head(first, inward, across, size_of_head)]
    strips.append(_make_head(last, _times(inward, -1.0), across, size_of_head))
    text = _write(_measure(along), units, scale, decimals)
    return _make_node(strips, _add(first, _times(along, 0.5)), text, size, color, background)


def angle_dimension(
    first: VectorLike, vertex: VectorLike, second: VectorLike, *, radius: float | None = None,
    decimals: int = 1, size: float = 14.0, color: ColorLike = "black",
    background: ColorLike | None = "white",
) -> Node:  # fmt: skip
    """
    Return a node that measures the angle of three points, degrees, 0 to 180.

    Parameters
    ----------
    first, vertex, second : (3,) array_like, scene units
        The angle lies at ``vertex``, which the others differ from.
    radius : float, optional
        Of the arc, scene units. Default: half the shorter arm.
    decimals, size, color, background
        As `length_dimension` takes them.

    Returns
    -------
    Node
        Its ``label.text`` is the measure.

    Raises
    ------
    ValueError
        Naming an argument that is not what it must be.

    Examples
    --------
    >>> import rasterjit as rj
    >>> node = rj.angle_dimension((1, 0, 0), (0, 0, 0), (0, 2, 0))
    >>> node.label and node.label.text
    '90.0°'
    """
    corner, a = _two_points("vertex", vertex, "first", first)
    _, b = _two_points("vertex", vertex, "second", second)
    one, other = _between(corner, a), _between(corner, b)
    reach = 0.5 * min(_measure(one), _measure(other))
    if radius is not None:
        reach = check.positive_number("radius", radius)
    start, stop = unit(one), unit(other)
    across = _perpendicular(start, stop)
    angle = float(polar_angle(length(cross(start, stop)), dot(start, stop)))
    sines, cosines = sin_cos(np.linspace(0.0, angle, ARC_SEGMENTS + 1))
    arc = [
        _add(corner, _add(_times(start, reach * cosine), _times(across, reach * sine)))
        for sine, cosine in zip(sines.tolist(), cosines.tolist(), strict=True)
    ]
    arms = [[corner, _add(corner, _times(way, 1.15 * reach))] for way in (start, stop)]
    name, value = ("vertex", corner) if radius is None else ("radius", radius)
    _check_finite(name, value, np.concatenate([arc, *arms]).ravel().tolist())
    text = f"{DEGREES_PER_RADIAN * angle:.{_check_decimals(decimals)}f}°"
    return _make_node([arc, *arms], arc[ARC_SEGMENTS // 2], text, size, color, background)


def radius_dimension(
    center: VectorLike, point: VectorLike, *, units: str = "", scale: float = 1.0,
    decimals: int = 2, size: float = 14.0, color: ColorLike = "black",
    background: ColorLike | None = "white",
) -> Node:  # fmt: skip
    """
    Return a node that measures the radius of a circle or an arc, as ``R 1.25 mm``.

    Parameters
    ----------
    center, point : (3,) array_like, scene units
        The middle of the circle, and a point on it, which the arrow points to.
    units, scale, decimals, size, color, background
        As `length_dimension` takes them.

    Returns
    -------
    Node
        Its ``label.text`` is the measure.

    Raises
    ------
    ValueError
        Naming an argument that is not what it must be.

    Examples
    --------
    >>> import rasterjit as rj
    >>> node = rj.radius_dimension((0, 0, 0), (0, 0.5, 0), units="mm", scale=1000)
    >>> node.label and node.label.text
    'R 500.00 mm'
    """
    middle, rim = _two_points("center", center, "point", point)
    along = _between(middle, rim)
    across, back = _perpendicular(along, (0.0, 0.0, 0.0)), _times(unit(along), -1.0)
    head = _make_head(rim, back, across, HEAD_SHARE * _measure(along))
    text = f"R {_write(_measure(along), units, scale, decimals)}"
    place = _add(middle, _times(along, 0.5))
    return _make_node([[middle, rim], head], place, text, size, color, background)


def _two_points(
    name: str, value: VectorLike, other: str, second: VectorLike
) -> tuple[Point, Point]:
    """Return two points that differ, or raise ``ValueError``."""
    a, b = check.triple(name, value), check.triple(other, second)
    if a == b:
        raise ValueError(f"{other} must differ from {name}, got {b} for both")
    if not math.isfinite(_measure(_between(a, b))):
        raise ValueError(f"{other} must be at a finite distance from {name}, got {b} and {a}")
    return a, b


def _check_finite(name: str, value: object, numbers: Iterable[float]) -> None:
    """Raise ``ValueError`` if an argument moves coordinates beyond the largest float."""
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"{name} must leave the lines' coordinates finite, got {value!r}")


def _measure(a: Point) -> float:
    """Return the length of a vector, however large or small; infinite if above all floats."""
    largest = max(map(abs, a))
    if not math.isfinite(largest):
        return math.inf
    # By powers of two, so that nothing is rounded.
    _, exponent = math.frexp(largest)
    share = length([math.ldexp(part, -exponent) for part in a])
    try:
        return math.ldexp(share, exponent)
    except OverflowError:
        return math.inf


def _check_decimals(value: int) -> int:
    """Return a number of digits, or raise ``ValueError``."""
    return check.whole_number("decimals", value, 0, MAX_DECIMALS)


def _write(value: float, units: str, scale: float, decimals: int) -> str:
    """Return a number of scene units as a text."""
    number = value * check.positive_number("scale", scale)
    if not math.isfinite(number):
        raise ValueError(f"scale must leave the measure finite, got {scale!r} of length {value!r}")
    return f"{number:.{_check_decimals(decimals)}f} {check.string('units', units)}".rstrip()


def _add(a: Sequence[float], b: Sequence[float]) -> Point:
    """Return the sum of vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _between(a: Point, b: Point) -> Point:
    """Return the vector from one point to another."""
    return b[0] - a[0], b[1] - a[1], b[2] - a[2]


def _times(a: Sequence[float], factor: float) -> Point:
    """Return a vector at another length."""
    return a[0] * factor, a[1] * factor, a[2] * factor


def _perpendicular(along: Point, toward: Point) -> Point:
    """Return the direction at right angles to a vector that comes nearest to another one."""
    way = unit(along)
    for wanted in (toward, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)):
        if any(wanted):
            goal = unit(wanted)
            rest = _add(goal, _times(way, -dot(goal, way)))
            # What is nearly parallel has no direction aside.
            if length(rest) > 1e-6:
                return unit(rest)
    raise AssertionError("one of two axes is aside of any direction")


def _make_head(tip: Point, back: Point, across: Point, size: float) -> list[Point]:
    """Return the head of an arrow, as a strip of three points."""
    base = _add(tip, _times(back, size))
    sides = (_add(base, _times(across, sign * HEAD_SLOPE * size)) for sign in (1.0, -1.0))
    left, right = sides
    return [left, tip, right]


def _make_node(
    strips: Sequence[Sequence[Point]], place: Point, text: str, size: float, color: ColorLike,
    background: ColorLike | None,
) -> Node:  # fmt: skip
    """Return a node of lines with a label."""
    points = np.concatenate([np.array(strip) for strip in strips])
    counts = np.cumsum([0, *(len(strip) for strip in strips)]).tolist()
    numbers = [list(range(a, b)) for a, b in pairwise(counts)]
    ink = rgba("color", color)
    material = Material("unlit", ink, casts_shadow=False)
    label = Label(place, text, size, color=ink, background=background)
    lines = Lines(points, strips=numbers, material=material)
    return Node(lines, name=text, label=label, section=False)
