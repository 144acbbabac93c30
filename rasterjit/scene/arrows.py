"""Arrows: vectors as solid shafts with cones, all in one mesh."""

from __future__ import annotations

import math
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Float32, Float64, Int32
from rasterjit.scene.color import ColorLike, linear_color, linear_rows
from rasterjit.scene.colormap import ColormapLike
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.norm import NormLike, RangeLike
from rasterjit.scene.transforms import sine_cosine

ArrowUnit: TypeAlias = Literal["length", "world"]
ARROW_UNITS: tuple[ArrowUnit, ...] = get_args(ArrowUnit)
"""Units of radii and heads."""

MIN_SIDES, MAX_SIDES = 3, 256
"""Limits of the number of sides of a shaft and its cone."""

FACES_PER_SIDE = 6
"""Faces for each side: foot 1, shaft 2, base of the cone 2, cone 1."""

MAX_HEAD_LENGTH = 1.0
"""Longest head, as a share of the arrow's length: a cone."""

MIN_HEAD_LENGTHS = 2.0
"""Least length of an arrow in lengths of its head; shorter arrows are scaled down."""


class Arrows(Mesh):
    """
    Vectors as solid arrows: a vector field, forces, normals, velocities.

    One mesh of closed arrows, each a shaft with a cone, smooth around and sharp at the edges.
    ``frame.face_id // arrows.faces_per_arrow`` is the number of the arrow at each pixel.

    Parameters
    ----------
    positions : (N, 3) array_like
        Model-space positions where the arrows begin, in scene units.
    vectors : (N, 3) array_like
        Where each points, and how far. Those of length zero, or whose length times ``scale`` is
        too small for a number, have no arrow: they are counted in ``dropped``, and the others keep
        their numbers.
    scale : float
        What lengths are multiplied by, above 0.
    shaft_radius, head_radius, head_length : float
        Radius of the shaft, radius and length of the cone; above 0. The cone is at least as wide as
        the shaft.
    unit : {"length", "world"}
        What these are in: shares of each arrow's length (with a head of 1 they are cones), or scene
        units, the same for all arrows. In scene units, arrows shorter than two heads are thinner,
        with shorter heads, in proportion.
    sides : int
        Of the shaft and the cone, 3..256.
    colors : colour or (N, 3|4) array_like, optional
        Of all arrows, or of each; see `Mesh`.
    scalars, colormap, range, norm, nan_color
        A number for each arrow, (N,), shown by a colour map in the place of ``colors``; see `Mesh`.
    material : Material, optional
        Default ``Material()``.

    Raises
    ------
    ValueError
        If an array has the wrong shape or type or is empty, holds NaN or infinity (scalars may),
        no arrow is left, or a measure is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import rasterjit as rj
    >>> x, y = (part.ravel() for part in np.meshgrid(np.arange(4.0), np.arange(3.0)))
    >>> speeds = np.stack([0.5 - y, x, 0 * x], axis=1)
    >>> arrows = rj.Arrows(np.stack([x, y, 0 * x], axis=1), speeds, scale=0.2, scalars=x)
    >>> arrows
    Arrows(12 arrows)
    """

    _ADVICE = "make other Arrows"

    def __init__(
        self,
        positions: ArrayLike,
        vectors: ArrayLike,
        *,
        scale: float = 1.0,
        shaft_radius: float = 0.04,
        head_radius: float = 0.1,
        head_length: float = 0.3,
        unit: ArrowUnit = "length",
        sides: int = 16,
        colors: ColorLike | None = None,
        scalars: ArrayLike | None = None,
        colormap: ColormapLike = "viridis",
        range: RangeLike | None = None,
        norm: NormLike | None = None,
        nan_color: ColorLike | None = None,
        material: Material | None = None,
    ) -> None:
        starts = check.finite_array("positions", positions, (None, 3))
        if not len(starts):
            raise ValueError("positions must have one row or more, got none")
        vectors_array = check.finite_array("vectors", vectors, (None, 3))
        if len(vectors_array) != len(starts):
            raise ValueError(
                f"vectors must have one row per position ({len(starts)}), got {len(vectors_array)}"
            )
        scale = self._scale = check.positive_number("scale", scale)
        measures = _check_radii(
            shaft_radius, head_radius, head_length, check.one_of("unit", unit, ARROW_UNITS)
        )
        self._sides = check.whole_number("sides", sides, MIN_SIDES, MAX_SIDES)
        self._count = len(starts)
        with np.errstate(over="ignore", under="ignore"):
            lengths, units = _normalize_vectors(vectors_array, scale)
            tips = starts + scale * vectors_array
        if not np.isfinite(tips).all() or not np.isfinite(lengths).all():
            raise ValueError("vectors times scale must reach finite places, got one too far")
        self._dropped = int(np.count_nonzero(lengths == 0.0))
        if self._dropped == len(starts):
            raise ValueError(f"vectors must have one that is not zero, got {len(starts)} that are")
        sizes = _compute_sizes(lengths, measures, unit)
        vertices, normals = _build_vertices(
            starts, tips, units, sizes, measures[1] / measures[2], self._sides
        )
        per_arrow = self.faces_per_arrow
        super().__init__(
            vertices, _build_faces(len(starts), self._sides), normals=normals,
            colors=None if colors is None else _expand_colors(colors, len(starts), per_arrow),
            scalars=None if scalars is None else _expand_scalars(scalars, len(starts), per_arrow),
            colormap=colormap, range=range, norm=norm,
            nan_color=nan_color, material=material,
        )  # fmt: skip

    @property
    def faces_per_arrow(self) -> int:
        """How many faces each arrow has: face f belongs to arrow ``f // faces_per_arrow``."""
        return FACES_PER_SIDE * self._sides

    @property
    def scale(self) -> float:
        """How long a vector of length 1 is, scene units."""
        return self._scale

    @property
    def dropped(self) -> int:
        """How many vectors have no arrow, for they are zero; their faces have no area."""
        return self._dropped

    def __len__(self) -> int:
        return self._count

    def __repr__(self) -> str:
        zero = f", {self._dropped} of them zero" if self._dropped else ""
        return f"{type(self).__name__}({len(self)} arrows{zero})"

    def split_creases(self, angle: float = 40.0) -> Arrows:
        """Return the arrows themselves, whose edges are sharp already."""
        return self


class Arrow(Arrows):
    """
    An arrow from one point to another: `Arrows` of one.

    Parameters
    ----------
    start, end : (3,) array_like
        Model-space positions of its foot and its tip, in scene units.
    shaft_radius, head_radius, head_length, unit, sides, material
        As `Arrows` takes them.
    color : colour, optional
        Default: that of the material.

    Raises
    ------
    ValueError
        If a point is not three finite numbers, both are the same, or a measure is out of range.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene = rj.load("models/teapot.obj")
    >>> node = scene.add(rj.Arrow((0, 0, 0), (0, 4, 0), color="crimson"), name="up")
    """

    _ADVICE = "make another Arrow"

    def __init__(
        self,
        start: ArrayLike,
        end: ArrayLike,
        *,
        shaft_radius: float = 0.04,
        head_radius: float = 0.1,
        head_length: float = 0.3,
        unit: ArrowUnit = "length",
        sides: int = 16,
        color: ColorLike | None = None,
        material: Material | None = None,
    ) -> None:
        foot, tip = np.array(check.triple("start", start)), np.array(check.triple("end", end))
        if (foot == tip).all():
            raise ValueError(f"end must be another point than start, got {tip.tolist()} twice")
        super().__init__(
            foot[np.newaxis], (tip - foot)[np.newaxis], shaft_radius=shaft_radius,
            head_radius=head_radius, head_length=head_length, unit=unit, sides=sides,
            colors=None if color is None else linear_color("color", color), material=material,
        )  # fmt: skip

    def __repr__(self) -> str:
        return "Arrow()"


def _check_radii(
    shaft_radius: float, head_radius: float, head_length: float, unit: ArrowUnit
) -> tuple[float, float, float]:
    """Check both radii and the length of the head; return them, or raise ``ValueError``."""
    shaft = check.positive_number("shaft_radius", shaft_radius)
    head = check.positive_number("head_radius", head_radius)
    length = check.positive_number("head_length", head_length)
    if head < shaft:
        raise ValueError(
            f"head_radius must be at least shaft_radius, {shaft:g}, got {head_radius!r}"
        )
    if unit == "length" and length > MAX_HEAD_LENGTH:
        raise ValueError(
            f"head_length must be at most {MAX_HEAD_LENGTH:g} of an arrow's length, got "
            f"{head_length!r}; in scene units with unit='world'"
        )
    return shaft, head, length


def _normalize_vectors(vectors: Float64, scale: float) -> tuple[Float64, Float64]:
    """Return the lengths of scaled vectors, (N,), and unit vectors, (N, 3); 0 for zero vectors."""
    largest = np.abs(vectors).max(axis=1)
    x, y, z = (vectors / np.where(largest > 0.0, largest, 1.0)[:, np.newaxis]).T
    relative = np.sqrt(x * x + y * y + z * z)
    lengths = scale * largest * relative
    divisor = np.where(lengths > 0.0, relative, np.inf)
    return lengths, np.stack([x / divisor, y / divisor, z / divisor], axis=1)


def _compute_sizes(
    lengths: Float64, measures: tuple[float, float, float], unit: ArrowUnit
) -> Float64:
    """Return both radii and the length of the head of each arrow, (N, 3), scene units."""
    if unit == "length":
        return lengths[:, np.newaxis] * np.array(measures)
    shrunk = np.minimum(lengths / (MIN_HEAD_LENGTHS * measures[2]), 1.0)
    return shrunk[:, np.newaxis] * np.array(measures)


def _build_vertices(
    feet: Float64, tips: Float64, units: Float64, sizes: Float64, slope: float, sides: int
) -> tuple[Float64, Float64]:
    """
    Return the vertices of all arrows and their normals, (N (7 sides + 1), 3) each.

    For each arrow: the middle of its foot and the foot's rim; the lower and the upper rim of the
    shaft; the inner and the outer rim of the cone's base; the rim of the cone, and its tip, once
    for each side. Rims at one place are the same numbers, so that an arrow is closed. ``slope`` is
    the cone's radius by its length, the same for all.
    """
    across = compute_perpendiculars(units)
    beside = np.cross(units, across)
    turns = [sine_cosine(360.0 * n / sides) for n in range(sides)]
    half_turns = [sine_cosine(360.0 * (n + 0.5) / sides) for n in range(sides)]
    out, out_between = (
        np.stack([c * across + s * beside for s, c in some], axis=1) for some in (turns, half_turns)
    )
    shaft, head = (sizes[:, n, np.newaxis, np.newaxis] for n in range(2))
    slant = math.sqrt(1.0 + slope * slope)
    ahead, backward = units[:, np.newaxis], -units[:, np.newaxis]
    foot, base = feet[:, np.newaxis], (tips - sizes[:, 2:] * units)[:, np.newaxis]
    low, high, wide = foot + shaft * out, base + shaft * out, base + head * out
    tip = np.broadcast_to(tips[:, np.newaxis], out.shape)
    back = np.broadcast_to(backward, out.shape)
    parts = [
        (foot, backward), (low, back),
        (low, out), (high, out),
        (high, back), (wide, back),
        (wide, (out + slope * ahead) / slant),
        (tip, (out_between + slope * ahead) / slant),
    ]  # fmt: skip
    vertices, normals = (np.concatenate(some, axis=1) for some in zip(*parts, strict=True))
    return vertices.reshape(-1, 3), normals.reshape(-1, 3)


def compute_perpendiculars(units: Float64) -> Float64:
    """Return a unit vector perpendicular to each unit vector, (N, 3); zero for zero."""
    x, y, z = np.cross(units, np.eye(3)[np.abs(units).argmin(axis=1)]).T
    length = np.sqrt(x * x + y * y + z * z)
    return np.stack([x, y, z], axis=1) / np.where(length > 0.0, length, 1.0)[:, np.newaxis]


def _build_faces(count: int, sides: int) -> Int32:
    """Return the faces of arrows, (N 6 sides, 3), counter-clockwise from outside."""
    current = np.arange(sides)
    following = (current + 1) % sides
    rims = [1 + n * sides for n in range(7)]
    foot, low, high, inner, outer, cone, tip = rims
    arrow = np.concatenate(
        [
            np.stack([np.zeros_like(current), foot + following, foot + current], axis=1),
            *_build_band_faces(low, high, current, following),
            *_build_band_faces(inner, outer, current, following),
            np.stack([cone + current, cone + following, tip + current], axis=1),
        ]
    )
    firsts = (7 * sides + 1) * np.arange(count, dtype=np.int32)[:, np.newaxis, np.newaxis]
    return (arrow.astype(np.int32) + firsts).reshape(-1, 3)


def _build_band_faces(
    low: int, high: int, current: NDArray[np.int_], following: NDArray[np.int_]
) -> list[NDArray[np.int_]]:
    """Return the faces between two rims around the axis, counter-clockwise from outside."""
    return [
        np.stack([low + current, low + following, high + following], axis=1),
        np.stack([low + current, high + following, high + current], axis=1),
    ]


def _expand_colors(colors: Any, count: int, per_arrow: int) -> Float32:
    """Return the colour of each face, (F, 4) linear, given one colour or one per arrow."""
    if isinstance(colors, str) or check.unmasked_array("colors", colors).ndim == 1:
        return np.tile(linear_color("colors", colors), (count * per_arrow, 1))
    rows = linear_rows("colors", colors)
    if len(rows) != count:
        raise ValueError(f"colors must be one colour or one per arrow ({count}), got {len(rows)}")
    return np.repeat(rows, per_arrow, axis=0)


def _expand_scalars(scalars: ArrayLike, count: int, per_arrow: int) -> NDArray[Any]:
    """Return the scalar of each face, given one per arrow."""
    values = check.unmasked_array("scalars", scalars)
    if values.shape != (count,):
        raise ValueError(
            f"scalars must be one number per arrow ({count}), got {check.brief(values)}"
        )
    return np.repeat(values, per_arrow)
