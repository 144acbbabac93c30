"""
Compute the matrices of many views at once: ``object_transforms`` batched, with the same bits.

Every operation is that of the function named, in its order; N views, O objects.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.pipeline.geometry.unproject_matrix import lens_of
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera
from rasterjit.scene.scene import Scene
from rasterjit.survey.clip_planes import SURE
from rasterjit.survey.object_transforms import Places, place_boxes, place_objects

Float64 = NDArray[np.float64]


class BatchedViews(NamedTuple):
    """`object_transforms.Views` of each view."""

    relative_from_model: Float64
    """(N, O, 4, 4): world axes, origin at the eye."""
    clip_from_relative: Float64
    """(N, 4, 4)."""
    toward_viewer: Float64
    """(N, 4)."""
    screen_winding: NDArray[np.int64]
    """(N,): 1 or -1."""
    is_finite: NDArray[np.bool_]
    """(N,): whether the matrices are; `object_transforms.view_places` refuses others."""


class Group:
    """
    Views of a scene for effects and lights: `object_transforms.Boxes` batched.

    Parameters
    ----------
    cameras : sequence of Camera
        With planes that are put already.
    size : (int, int)
        Width and height of the pictures, pixels.
    eyes : (N, 3) float64, world space
    views : BatchedViews
    in_view : (N, O) bool
        Which objects may be seen.
    bounds : (O, 2, 3) float64
        Low and high corner of each object, model space; NaN for one without any.
    scenes : callable
        Returns the scene as it is in each view, or one for all.
    """

    def __init__(
        self, cameras: Sequence[Camera], size: tuple[int, int], eyes: Float64, views: BatchedViews,
        in_view: NDArray[np.bool_], bounds: Float64, scenes: Callable[[], Sequence[Scene]],
    ) -> None:  # fmt: skip
        self.cameras, self.size, self.scenes = cameras, size, scenes
        self.eyes, self.views, self.in_view = eyes, views, in_view
        self._bounds = bounds

    @cached_property
    def corners(self) -> Float64:
        """The corners of all boxes, (N, O, 8, 3), world axes, relative to the eye."""
        matrices = self.views.relative_from_model
        count, objects = matrices.shape[:2]
        boxes = np.broadcast_to(self._bounds, (count, objects, 2, 3)).reshape(-1, 2, 3)
        corners = place_boxes(boxes, matrices.reshape(-1, 4, 4)[:, :3])
        return corners.reshape(count, objects, 8, 3)

    @cached_property
    def is_unsure(self) -> NDArray[np.bool_]:
        """Whether each object may be visible but has no known bounds, (N, O)."""
        return self.in_view & ~np.isfinite(self.corners).all(axis=(2, 3))

    def lenses(self, units: Sequence[float]) -> NDArray[np.float32]:
        """Return `lens_of` each view, (N, 4, 4), in its own unit or a common one; 0 if empty."""
        count = len(self.cameras)
        lenses, is_asked = np.zeros((count, 4, 4), np.float32), self.in_view.any(axis=1)
        for n in np.flatnonzero(is_asked & self.views.is_finite).tolist():
            lenses[n] = lens_of(self.cameras[n], self.size, units[n if len(units) == count else 0])
        return lenses

    def farthest(self) -> Float64:
        """Return the distance from each eye, (N,), scene units, of the farthest point in view."""
        with np.errstate(over="ignore", invalid="ignore"):
            x, y, z = np.moveaxis(self.corners, 3, 0)
            squares = (x * x + y * y) + z * z
        squares = np.where(np.isfinite(squares), squares, np.inf)
        squares = np.where(self.in_view[:, :, np.newaxis], squares, 0.0)
        return np.sqrt(squares.max(axis=(1, 2), initial=0.0))


def place_many(world_from_model: Float64) -> Places:
    """Return the transforms of objects in N views: `place_objects`, (N, O, ...) each."""
    shape = world_from_model.shape[:2]
    places = place_objects(world_from_model.reshape(-1, 4, 4)) if 0 not in shape else Places(
        world_from_model, np.empty((*shape, 3, 3)), np.empty(shape)
    )  # fmt: skip
    return Places(*(part.reshape(*shape, *part.shape[1:]) for part in places))


def view_many(
    world_from_model: Float64, eyes: Float64, view_from_world: Float64, clip_from_view: Float64
) -> BatchedViews:
    """
    Return the matrices that take objects to the screen, as `object_transforms.view_places` finds
    them.

    Parameters
    ----------
    world_from_model : (N, O, 4, 4), or (1, O, 4, 4) float64
    eyes : (N, 3) float64, world space
    view_from_world, clip_from_view : (N, 4, 4) float64
    """
    count = len(eyes)
    relative = np.repeat(world_from_model, count // len(world_from_model), axis=0)
    relative[:, :, :3, 3] -= eyes[:, np.newaxis]
    moves = np.tile(np.eye(4), (count, 1, 1))
    moves[:, :3, 3] = eyes
    view_from_relative = transforms.product_of_each(view_from_world, moves)
    is_parallel = ~clip_from_view[:, 3, :3].any(axis=1)
    away = np.where(is_parallel[:, np.newaxis], clip_from_view[:, 2, :3], clip_from_view[:, 3, :3])
    toward_viewer = np.tile((0.0, 0.0, 0.0, 1.0), (count, 1))
    with np.errstate(all="ignore"):
        parts = clip_from_view[:, 2, :3, np.newaxis] * view_from_relative[:, :3, :3]
        along = -((parts[:, 0] + parts[:, 1]) + parts[:, 2])
    toward_viewer[is_parallel, :3], toward_viewer[is_parallel, 3] = along[is_parallel], 0.0
    screen = np.concatenate((clip_from_view[:, :2, :3], away[:, np.newaxis]), axis=1)
    handedness = _handedness(screen) * _handedness(view_from_relative[:, :3, :3])
    clip_from_relative = transforms.product_of_each(clip_from_view, view_from_relative)
    finite = (view_from_relative, clip_from_relative)
    return BatchedViews(
        relative, clip_from_relative, toward_viewer, np.where(handedness < 0.0, 1, -1),
        np.all([np.isfinite(one).all(axis=(1, 2)) for one in finite], axis=0),
    )  # fmt: skip


def _handedness(rows: Float64) -> Float64:
    """Return the sign of each 3x3 determinant, (N,): `object_transforms._turn`."""
    largest = np.abs(rows).max(axis=2, keepdims=True)
    with np.errstate(all="ignore"):
        scaled = np.divide(rows, largest, out=np.zeros_like(rows), where=largest > 0.0)
        (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(scaled, 0, 2)
        return np.sign(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def scene_bounds(bounds: Float64, world_from_model: Float64) -> tuple[Float64, Float64]:
    """
    Return the corners of a box around all objects in each view, (N, 3) each, world space.

    Takes the box of each object, (O, 2, 3), and where they stand, (N, O, 4, 4).
    """
    count, objects = world_from_model.shape[:2]
    boxes = np.broadcast_to(bounds, (count, objects, 2, 3)).reshape(-1, 2, 3)
    corners = place_boxes(boxes, world_from_model.reshape(-1, 4, 4)[:, :3])
    corners = corners.reshape(count, -1, 3)
    return (
        np.fmin.reduce(corners, axis=1, initial=np.inf),
        np.fmax.reduce(corners, axis=1, initial=-np.inf),
    )


def are_boxes_between(
    low: Float64, high: Float64, view_from_world: Float64, near: Float64, far: Float64
) -> NDArray[np.bool_]:
    """
    Tell of each view, (N,), whether a box surely lies between two planes.

    Parameters
    ----------
    low, high : (N, 3) float64, world space
    view_from_world : (N, 4, 4) float64
    near, far : (N,) float64
        Distances along the viewing axis; -inf and inf -> anywhere.
    """
    rows = -view_from_world[:, 2]
    with np.errstate(all="ignore"):
        corners = np.stack((rows[:, :3] * low, rows[:, :3] * high))
        nearest = rows[:, 3] + _row_sums(corners.min(axis=0))
        farthest = rows[:, 3] + _row_sums(corners.max(axis=0))
        error = SURE * (np.abs(rows[:, 3]) + _row_sums(np.abs(corners).max(axis=0)))
        # NaN counts as unsure.
        return (nearest >= near + error) & (farthest <= far - error)


def _row_sums(terms: Float64) -> Float64:
    """Sum each row of (N, 3), from the left."""
    return (terms[:, 0] + terms[:, 1]) + terms[:, 2]
