"""
Project points to pixels and back, with the arithmetic of the pipeline.

Pixel coordinates are those of the screen: x right, y down, the centre of the pixel in column i and
row j at (i + 0.5, j + 0.5). OpenCV's are smaller by 0.5. Depth is what ``Frame.depth`` holds: scene
units along the viewing axis.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rasterjit.scene import transforms
from rasterjit.scene.arrays import Float64
from rasterjit.scene.transforms import Matrix
from rasterjit.scene.validation import number_array, picture_size

if TYPE_CHECKING:
    from rasterjit.scene.camera import Camera


class ProjectedPoints(NamedTuple):
    """Pixels and depths of points."""

    pixels: Float64
    """(..., 2): x right, y down; NaN for a point that is not in front of the eye."""
    depth: Float64
    """(...): scene units along the viewing axis, negative behind the eye."""


class Rays(NamedTuple):
    """Rays through pixels; an array that is the same for all may be read-only."""

    origins: Float64
    """(H, W, 3), world space: the eye; of a parallel view, points where the depth is 0."""
    directions: Float64
    """(H, W, 3), world space, of length one."""


class Projecting:
    """Base class of cameras: projects points to pixels and back."""

    _view_from_world: Float64
    """View matrix of a camera that is given by eye and target."""

    def project(self: Camera, points: ArrayLike, size: tuple[int, int]) -> ProjectedPoints:
        """
        Return where points are in an image, and their depth.

        Parameters
        ----------
        points : (..., 3) array_like, world space
            They may lie outside the image, or before the near or beyond the far plane.
        size : (int, int)
            Width and height of the image, pixels.

        Returns
        -------
        pixels : (..., 2) float64
            The centre of the pixel in column i and row j is at (i + 0.5, j + 0.5). NaN for points
            of a perspective that are not in front of the eye.
        depth : (...) float64
            Scene units along the viewing axis, as ``Frame.depth``; negative behind the eye.
            Points that are not finite have NaN.

        Raises
        ------
        ValueError
            If ``points`` has another shape or is not of numbers, or the size is wrong.

        Examples
        --------
        >>> import rasterjit as rj
        >>> camera = rj.PerspectiveCamera(eye=(0, 0, 5), target=(0, 0, 0), fov_y=90.0)
        >>> pixels, depth = camera.project((0, 1, 0), (640, 480))
        >>> print(pixels, depth)
        [320. 192.] 5.0
        """
        return project(self, points, size)

    def unproject(
        self: Camera, pixels: ArrayLike, depth: ArrayLike, size: tuple[int, int]
    ) -> Float64:
        """
        Return the points that are seen at places of an image.

        Parameters
        ----------
        pixels : (..., 2) array_like
            x right, y down; the centre of the pixel in column i and row j is at
            (i + 0.5, j + 0.5).
        depth : (...) array_like
            Scene units along the viewing axis, as ``Frame.depth``; one number serves all pixels.
        size : (int, int)
            Width and height of the image, pixels.

        Returns
        -------
        (..., 3) float64, world space
            NaN where ``depth`` is not finite (nothing is seen there), or in a perspective not
            above 0.

        Raises
        ------
        ValueError
            If an array has another shape or is not of numbers, the size is wrong, or the camera
            is a `MatrixCamera` that flattens space.

        Examples
        --------
        >>> import rasterjit as rj
        >>> camera = rj.PerspectiveCamera(eye=(0, 0, 5), target=(0, 0, 0), fov_y=90.0)
        >>> print(camera.unproject((320, 192), 5.0, (640, 480)))
        [0. 1. 0.]
        """
        return unproject(self, pixels, depth, size)

    def rays(self: Camera, size: tuple[int, int]) -> Rays:
        """
        Return what the centres of all pixels of an image look along.

        Parameters
        ----------
        size : (int, int)
            Width and height of the image, pixels.

        Returns
        -------
        origins : (height, width, 3) float64, world space
            The eye; of a parallel view, the points where the depth is 0. Read-only.
        directions : (height, width, 3) float64, world space
            Of length one. What ``Frame.distance`` is measured along, but for a parallel
            projection that is oblique.

        Raises
        ------
        ValueError
            If the size is wrong, or the camera is a `MatrixCamera` that flattens space.
        """
        return rays(self, size)


def clip_from_relative(camera: Camera, size: tuple[int, int]) -> Matrix:
    """Return the matrix, (4, 4), from positions relative to the eye to clip space."""
    view = transforms.compose(camera.view_matrix(), transforms.translate(camera.eye_position()))
    return transforms.compose(camera.projection_matrix(size), view)


def screen_from_relative(camera: Camera, size: tuple[int, int]) -> Matrix:
    """
    Return the matrix from positions relative to the eye to what a pixel stores of them.

    Parameters
    ----------
    camera : Camera
    size : (int, int)
        Width and height, pixels.

    Returns
    -------
    (4, 4) float64
        From (x, y, z, 1) in world axes to (NDC x, NDC y, stored depth, 1) times w.
    """
    matrix = clip_from_relative(camera, size)
    c0, c1, c2 = camera.depth_coefficients()
    matrix[2] = c1 * matrix[2] + c2 * matrix[3]
    matrix[2, 3] += c0
    return matrix


def project(camera: Camera, points: ArrayLike, size: tuple[int, int]) -> ProjectedPoints:
    """Project points, (..., 3), to pixels and depths; see `Projecting.project`."""
    width, height = picture_size("size", size)
    array = _check_numbers("points", points, 3)
    relative = array.reshape(-1, 3) - camera.eye_position()
    x, y, stored, w = transforms.transform_points(screen_from_relative(camera, size), relative).T
    with np.errstate(all="ignore"):
        depth = camera.view_depth(stored / w)
        pixels = np.stack([(x / w + 1.0) * (width / 2.0), (1.0 - y / w) * (height / 2.0)], axis=1)
    pixels[~(w > 0.0)] = np.nan
    return ProjectedPoints(pixels.reshape(*array.shape[:-1], 2), depth.reshape(array.shape[:-1]))


def unproject(
    camera: Camera, pixels: ArrayLike, depth: ArrayLike, size: tuple[int, int]
) -> Float64:
    """Return the points seen at pixels, (..., 2), at depths; see `Projecting.unproject`."""
    width, height = picture_size("size", size)
    positions = _check_numbers("pixels", pixels, 2)
    depth_array = _check_numbers("depth", depth)
    shape = positions.shape[:-1]
    try:
        depths = np.broadcast_to(depth_array, shape).reshape(-1)
    except ValueError:
        message = f"depth must have the shape of pixels, {shape}, got {depth_array.shape}"
        raise ValueError(message) from None
    x, y = positions.reshape(-1, 2).T
    unprojection = _Unprojection(camera, size)
    with np.errstate(all="ignore"):
        relative = unprojection.points(2.0 * x / width - 1.0, 1.0 - 2.0 * y / height, depths)
        relative[~(np.isfinite(depths) & (unprojection.is_parallel | (depths > 0.0)))] = np.nan
        return (relative + camera.eye_position()).reshape(*shape, 3)


def rays(camera: Camera, size: tuple[int, int]) -> Rays:
    """Return the rays through the centres of all pixels; see `Projecting.rays`."""
    width, height = picture_size("size", size)
    unprojection, eye = _Unprojection(camera, size), camera.eye_position()
    x = np.tile((2.0 * np.arange(width) + 1.0) / width - 1.0, height)
    y = np.repeat(1.0 - (2.0 * np.arange(height) + 1.0) / height, width)
    if unprojection.is_parallel:
        start = unprojection.points(x, y, np.zeros(len(x)))
        # The axis is the same everywhere.
        targets = unprojection.points(np.zeros(2), np.zeros(2), np.array([0.0, unprojection.unit]))
        direction = transforms.unit_vector("direction", targets[1] - targets[0])
        directions = np.broadcast_to(direction, start.shape)
        origins = start + eye
    else:
        targets = unprojection.points(x, y, np.full(len(x), unprojection.unit))
        right, up, backward = targets.T
        largest = np.abs(targets).max(axis=1)
        right, up, backward = right / largest, up / largest, backward / largest
        lengths = np.sqrt((right * right + up * up) + backward * backward)
        directions = np.stack([right, up, backward], axis=1) / lengths[:, np.newaxis]
        origins = np.broadcast_to(eye, directions.shape)
    shape = height, width, 3
    return Rays(origins.reshape(shape), directions.reshape(shape))


class _Unprojection:
    """Inverse projection: points relative to the eye from NDC x and y and a depth."""

    def __init__(self, camera: Camera, size: tuple[int, int]) -> None:
        screen = screen_from_relative(camera, size)
        self.is_parallel = not screen[3, :3].any()
        c0 = camera.depth_coefficients()[0]
        # Of a parallel view, the depth where 0 is stored, and one along the range of depths.
        self._first = 0.0 if not self.is_parallel else float(camera.view_depth(0.0))
        self.unit = (
            float(camera.view_depth(-1.0)) - self._first
            if self.is_parallel
            # Of a perspective, the depth where w is 1.
            else float(camera.view_depth(c0))
        )
        self._w = screen[3, 3]
        rows = screen[[0, 1, 2 if self.is_parallel else 3]]
        try:
            self._inverse = transforms.inverse(np.vstack([rows, (0.0, 0.0, 0.0, 1.0)]))
        except ValueError:
            raise ValueError(
                "camera must not flatten space where points follow from pixels, got a matrix "
                f"without inverse: {screen.tolist()}"
            ) from None

    def points(self, x: Float64, y: Float64, depths: Float64) -> Float64:
        """Return points, (N, 3), relative to the eye, given NDC x and y and depths, (N,) each."""
        ratio = (depths - self._first) / self.unit
        w, last = (self._w, -ratio * self._w) if self.is_parallel else (ratio, ratio)
        screen = np.stack([x * w, y * w, last], axis=1)
        return transforms.transform_points(self._inverse, screen)[:, :3]


def _check_numbers(name: str, value: ArrayLike, last: int | None = None) -> Float64:
    """Return an array as float64, NaN and infinity allowed, its last axis of a given length."""
    array = number_array(name, value)
    if last is not None and (array.ndim == 0 or array.shape[-1] != last):
        raise ValueError(f"{name} must have shape (..., {last}), got {array.shape}")
    return array
