"""One object's chain of transforms, from object space to pixels, under a simple interface."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import transforms
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.validation import finite_array, finite_number, image_size, positive_number

ROUNDING = 1e-14
"""Errors of numbers, as a share of what they are computed with; what is below is written as 0."""


class Projection(NamedTuple):
    """
    Projected points: pixels, depth and visibility.

    Attributes
    ----------
    pixels : (N, 2) float64, screen space
        x to the right, y down; the centre of pixel (column i, row j) is at (i + 0.5, j + 0.5).
        NaN where the point is not in front of the camera (clip w <= 0).
    depth : (N,) float64
        NDC z, -1 at the near plane and +1 at the far plane; NaN where ``pixels`` is.
    on_screen : (N,) bool
        True where the point is in front of the camera, between the near and far planes and
        inside the image, 0 <= x < width and 0 <= y < height.
    """

    pixels: NDArray[np.float64]
    depth: NDArray[np.float64]
    on_screen: NDArray[np.bool_]


class PipelineStage(NamedTuple):
    """A stage of the pipeline, for one vertex."""

    name: str
    """``"scale"`` ... ``"projection"``, ``"divide by w"``, ``"viewport"``."""
    space: str
    """The space that it leads to."""
    matrix: NDArray[np.float64] | None
    """(4, 4); None where w divides, which no matrix does."""
    position: NDArray[np.float64]
    """(4,) x, y, z and w after it."""


class PipelineStages(tuple[PipelineStage, ...]):
    """
    What each stage of a pipeline makes of a vertex: as text, one line each.

    A notebook shows it as formulas, which `latex` returns.
    """

    __slots__ = ()

    def __str__(self) -> str:
        columns = [
            (one.name, _write_matrix(one.matrix), _write_row(one.position, rounding), one.space)
            for one, rounding in zip(self, self._bound_rounding(), strict=True)
        ]
        widths = [max(map(len, column)) for column in zip(*columns, strict=True)]
        lines = (
            "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True))
            for row in columns
        )
        return "\n".join(line.rstrip() for line in lines)

    def latex(self) -> str:
        """Return a line of LaTeX a stage, in an ``aligned`` environment, without dollars."""
        lines = []
        roundings = self._bound_rounding()
        for (before, old), (stage, new) in pairwise(zip(self, roundings, strict=True)):
            inner = _write_latex(before.position[:, np.newaxis], old[:, np.newaxis])
            if stage.matrix is None:
                product = rf"\frac{{1}}{{{before.position[3]:.4g}}} {inner}"
            else:
                factor = _write_latex(stage.matrix, ROUNDING * _group_sizes(stage.matrix))
                product = f"{factor} {inner}"
            result = _write_latex(stage.position[:, np.newaxis], new[:, np.newaxis])
            lines.append(rf"\mathbf{{p}}_{{\text{{{stage.space}}}}} &= {product} = {result}")
        return "\\begin{aligned}\n" + " \\\\\n".join(lines) + "\n\\end{aligned}"

    def _bound_rounding(self) -> list[NDArray[np.float64]]:
        """Return about how far rounding may have moved each position, (4,) a stage."""
        bounds = [np.zeros(4)]
        for before, stage in pairwise(self):
            matrix = np.eye(4) / before.position[3] if stage.matrix is None else stage.matrix
            with np.errstate(over="ignore"):
                before_bound = bounds[-1] + ROUNDING * np.abs(before.position)
                bounds.append((_group_sizes(matrix) * before_bound).max(axis=1))
        return bounds

    def _repr_latex_(self) -> str:
        return f"$\\displaystyle {self.latex()}$"


class ClassicPipeline(Guarded):
    """
    The classic chain: scale, rotate, translate, camera, projection, viewport.

    Every setter replaces its step and returns the pipeline, so that calls chain. The order of
    the calls does not matter; the order of the steps is fixed. Steps that are not set are the
    identity, so the camera starts at the origin and looks down -z.

    Examples
    --------
    >>> pipeline = (
    ...     ClassicPipeline()
    ...     .world_pos((1.0, 2.0, -4.0))
    ...     .perspective(90.0, width=64, height=64, near=1.0, far=10.0)
    ... )
    >>> pipeline.project([[0.0, 0.0, 0.0]]).pixels
    array([[40., 16.]])
    """

    _ADVICE = "its methods set its steps"

    def __init__(self) -> None:
        self._scale = transforms.identity()
        self._rotate = transforms.identity()
        self._translate = transforms.identity()
        self._view_from_world = transforms.identity()
        self._clip_from_view = transforms.identity()
        self._size: tuple[int, int] | None = None

    def scale(self, factor: float | ArrayLike) -> ClassicPipeline:
        """
        Set the object's size: one factor, or one per axis; a negative one mirrors.

        Raises
        ------
        ValueError
            If a factor is zero or not finite.
        """
        self._scale = transforms.scale(factor)
        return self

    def rotate(
        self, x_degrees: float = 0.0, y_degrees: float = 0.0, z_degrees: float = 0.0
    ) -> ClassicPipeline:
        """
        Set the object's rotation: about the world's x axis first, then y, then z.

        Raises
        ------
        ValueError
            If an angle is not finite.
        """
        self._rotate = transforms.compose(
            transforms.rotate_z(finite_number("z_degrees", z_degrees)),
            transforms.rotate_y(finite_number("y_degrees", y_degrees)),
            transforms.rotate_x(finite_number("x_degrees", x_degrees)),
        )
        return self

    def world_pos(self, position: ArrayLike) -> ClassicPipeline:
        """
        Set where in the world the object's origin is, a vector (x, y, z).

        Raises
        ------
        ValueError
            If ``position`` is not three finite numbers.
        """
        self._translate = transforms.translate(finite_array("position", position, (3,)))
        return self

    def camera(
        self, position: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)
    ) -> ClassicPipeline:
        """
        Set the camera: where it is, the point it looks at and which way is up (world space).

        Raises
        ------
        ValueError
            If ``target`` equals ``position``, or ``up`` is zero or parallel to the line of sight,
            or an entry is not finite.
        """
        origin = finite_array("position", position, (3,))
        if (origin == finite_array("target", target, (3,))).all():
            raise ValueError(f"target must differ from position, both are {origin.tolist()}")
        self._view_from_world = transforms.look_at(origin, target, up)
        return self

    def perspective(
        self, fov_y: float, width: int, height: int, near: float, far: float
    ) -> ClassicPipeline:
        """
        Set a perspective projection onto an image of width x height pixels.

        Parameters
        ----------
        fov_y : float, degrees
            Vertical field of view.
        width, height : int, pixels
        near, far : float, scene units
            Distances of the near and far plane; ``far`` may be ``math.inf``.

        Raises
        ------
        ValueError
            If ``fov_y`` is outside (0, 180), a side is not in 1..16384, ``near`` is not above 0 or
            ``far`` not above ``near``.
        """
        w, h = image_size("width, height", (width, height))
        self._clip_from_view = transforms.perspective(fov_y, w / h, near, far)
        self._size = (w, h)
        return self

    def orthographic(
        self, view_height: float, width: int, height: int, near: float, far: float
    ) -> ClassicPipeline:
        """
        Set a parallel projection onto an image of width x height pixels.

        Parameters
        ----------
        view_height : float, scene units
            What the image shows from its bottom to its top; the width follows from its aspect.
        width, height : int, pixels
        near, far : float, scene units
            Distances of the near and far plane, both finite.

        Raises
        ------
        ValueError
            If ``view_height`` is not above 0, a side is not in 1..16384, or ``far`` is not above
            ``near``.
        """
        w, h = image_size("width, height", (width, height))
        top = positive_number("view_height", view_height) / 2.0
        right = top * (w / h)
        self._clip_from_view = transforms.orthographic(-right, right, -top, top, near, far)
        self._size = (w, h)
        return self

    @property
    def world_from_object(self) -> transforms.Matrix:
        """Return translate · rotate · scale, (4, 4)."""
        return transforms.compose(self._translate, self._rotate, self._scale)

    @property
    def view_from_world(self) -> transforms.Matrix:
        """Return the camera's matrix, (4, 4)."""
        return self._view_from_world.copy()

    @property
    def clip_from_view(self) -> transforms.Matrix:
        """Return the projection, (4, 4)."""
        return self._clip_from_view.copy()

    @property
    def matrix(self) -> transforms.Matrix:
        """Return projection · camera · translate · rotate · scale, (4, 4)."""
        return transforms.compose(
            self._clip_from_view, self._view_from_world, self.world_from_object
        )

    def explain(self, vertex: ArrayLike) -> PipelineStages:
        """
        Return what each stage makes of one vertex; print it to see a line each.

        Parameters
        ----------
        vertex : (3,) array_like, object space

        Returns
        -------
        PipelineStages
            Beginning with the vertex itself; the last position is that of `project`, with NDC z.

        Raises
        ------
        ValueError
            If it is not three finite numbers, no projection was set, or it is behind the camera,
            where there is nothing to divide by (clip w <= 0).

        Examples
        --------
        >>> pipeline = ClassicPipeline().world_pos((1, 2, -4)).perspective(90, 64, 32, 1, 10)
        >>> print(pipeline.explain((0, 0, 0))[-1].position[:2])
        [36.  8.]
        """
        if self._size is None:
            raise ValueError("perspective or orthographic must be set before explain: no size")
        position = np.append(finite_array("vertex", vertex, (3,)), 1.0)
        stages = [PipelineStage("vertex", "object", None, position)]
        for name, space, matrix in (
            ("scale", "scaled", self._scale), ("rotate", "rotated", self._rotate),
            ("translate", "world", self._translate), ("camera", "view", self._view_from_world),
            ("projection", "clip", self._clip_from_view),
        ):  # fmt: skip
            position = transforms.transform_points(matrix, position[np.newaxis, :3])[0]
            stages.append(PipelineStage(name, space, matrix.copy(), position))
        if not position[3] > 0.0:
            raise ValueError(
                f"vertex must be in front of the camera, got {vertex!r}, whose clip w is "
                f"{position[3]:g}"
            )
        position = position / position[3]
        stages.append(PipelineStage("divide by w", "NDC", None, position))
        half_width, half_height = self._size[0] / 2.0, self._size[1] / 2.0
        viewport = np.eye(4)
        viewport[0, [0, 3]], viewport[1, [1, 3]] = half_width, (-half_height, half_height)
        position = np.append(
            self.project(stages[0].position[np.newaxis, :3]).pixels[0], position[2:]
        )
        stages.append(PipelineStage("viewport", "pixels", viewport, position))
        return PipelineStages(stages)

    def project(self, points: ArrayLike) -> Projection:
        """
        Take object-space points to pixel coordinates.

        Parameters
        ----------
        points : (N, 3) array_like, object space
            A point with a NaN or infinite coordinate is reported as not on screen.

        Raises
        ------
        ValueError
            If ``points`` has another shape, or no projection was set.
        """
        if self._size is None:
            raise ValueError("perspective or orthographic must be set before project: no size")
        width, height = self._size
        clip = transforms.transform_points(self.matrix, points)
        with np.errstate(all="ignore"):
            ndc = np.where(clip[:, 3:] > 0.0, clip[:, :3] / clip[:, 3:], np.nan)
            pixels = np.stack(
                [(ndc[:, 0] + 1.0) * (width / 2.0), (1.0 - ndc[:, 1]) * (height / 2.0)], axis=1
            )
            inside = (pixels >= 0.0) & (pixels < (width, height))
            in_depth = (ndc[:, 2] >= -1.0) & (ndc[:, 2] <= 1.0)
        return Projection(pixels, ndc[:, 2].copy(), inside.all(axis=1) & in_depth)


def _group_sizes(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the sizes, (4, 4), that rounding errors of a matrix's entries are shares of.

    Of what a row multiplies x, y and z by, and of the translation, the largest; 0 for 0.
    """
    sizes = np.abs(matrix)
    sizes[:, :3] = sizes[:, :3].max(axis=1, keepdims=True)
    sizes[:3, 3] = sizes[:3, 3].max()
    return np.where(matrix == 0.0, 0.0, sizes)


def _write_numbers(numbers: NDArray[np.float64], rounding: NDArray[np.float64]) -> list[list[str]]:
    """Return rows of numbers as texts; 0 for what is but rounding."""
    shown = np.where(np.abs(numbers) < rounding, 0.0, numbers)
    return [[f"{one:.4g}" for one in row] for row in shown.tolist()]


def _write_row(numbers: NDArray[np.float64], rounding: NDArray[np.float64]) -> str:
    """Return numbers between parentheses."""
    return f"({', '.join(_write_numbers(numbers[np.newaxis], rounding)[0])})"


def _write_matrix(matrix: NDArray[np.float64] | None) -> str:
    """Return the rows of a matrix in a line; nothing for None."""
    if matrix is None:
        return ""
    return f"[{'; '.join(map(' '.join, _write_numbers(matrix, ROUNDING * _group_sizes(matrix))))}]"


def _write_latex(numbers: NDArray[np.float64], rounding: NDArray[np.float64]) -> str:
    """Return a matrix in LaTeX."""
    rows = map(" & ".join, _write_numbers(numbers, rounding))
    return r"\begin{bmatrix} " + r" \\ ".join(rows) + r" \end{bmatrix}"
