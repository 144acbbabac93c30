"""One object's chain of transforms, from object space to pixels, under a simple interface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import transforms
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.validation import finite_array, finite_number, image_size, positive_number


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
