"""
Compute the transforms of O objects in N views at once, as ``object_transforms`` does for one view.

Each operation and its order are those of the function for one view: the bits are the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.pipeline.geometry.unproject_matrix import build_unprojection_matrix
from rasterjit.scene.camera import Camera
from rasterjit.scene.scene import Scene
from rasterjit.scene.vectors import cross, dot
from rasterjit.survey.clip_planes import RELATIVE_ERROR
from rasterjit.survey.object_counts import Inventory
from rasterjit.survey.object_transforms import (
    ObjectTransforms,
    compute_max_distance,
    place_views,
    transform_boxes,
    transform_objects,
)

Float64 = NDArray[np.float64]


class BatchTransforms(NamedTuple):
    """`object_transforms.ViewTransforms` of each view."""

    relative_from_model: Float64
    """(N, O, 4, 4): world axes, origin at the eye."""
    clip_from_relative: Float64
    """(N, 4, 4)."""
    toward_viewer: Float64
    """(N, 4)."""
    screen_winding: NDArray[np.int64]
    """(N,): 1 or -1."""
    is_finite: NDArray[np.bool_]
    """(N,): whether the matrices of a view are; `transform_to_view` refuses others."""


class ViewGroup:
    """
    Views of a scene for effects and lights: `object_transforms.Boxes` batched.

    Parameters
    ----------
    cameras : sequence of Camera
        With near and far planes chosen.
    size : (int, int)
        Width and height of the pictures, pixels.
    eyes : (N, 3) float64, world space
    views : BatchTransforms
    in_view : (N, O) bool
        Which objects may be seen.
    bounds : (O, 2, 3) float64
        Low and high corner of each object, model space; NaN for one without any.
    scenes : callable
        Returns the scene of each view, or one for all.
    inventory : Inventory
        Of the objects.
    """

    def __init__(
        self, cameras: Sequence[Camera], size: tuple[int, int], eyes: Float64,
        views: BatchTransforms, in_view: NDArray[np.bool_], bounds: Float64,
        scenes: Callable[[], Sequence[Scene]], inventory: Inventory,
    ) -> None:  # fmt: skip
        self.cameras, self.size, self.scenes = cameras, size, scenes
        self.eyes, self.views, self.in_view = eyes, views, in_view
        self.bounds, self.inventory = bounds, inventory

    @cached_property
    def corners(self) -> Float64:
        """The corners of all boxes, (N, O, 8, 3), world axes, relative to the eye."""
        matrices = self.views.relative_from_model
        boxes = np.broadcast_to(self.bounds, (*matrices.shape[:2], 2, 3)).reshape(-1, 2, 3)
        corners = transform_boxes(boxes, matrices.reshape(-1, 4, 4)[:, :3])
        return corners.reshape(*matrices.shape[:2], 8, 3)

    @cached_property
    def is_unsure(self) -> NDArray[np.bool_]:
        """Whether each object may be visible but has no known bounds, (N, O)."""
        return self.in_view & ~np.isfinite(self.corners).all(axis=(2, 3))

    def lens_matrices(self, units: Sequence[float]) -> NDArray[np.float32]:
        """Return the unprojection matrix of each view, (N, 4, 4), by its unit; 0 if it is empty."""
        count = len(self.cameras)
        matrices, has_objects = np.zeros((count, 4, 4), np.float32), self.in_view.any(axis=1)
        for n in np.flatnonzero(has_objects & self.views.is_finite).tolist():
            unit = units[n if len(units) == count else 0]
            matrices[n] = build_unprojection_matrix(self.cameras[n], self.size, unit)
        return matrices

    def compute_near_middles(self) -> Float64:
        """Return the middle of each near plane, (N, 3), world axes, relative to the eye, or NaN."""
        clip = self.views.clip_from_relative
        # Three planes meet there: x = 0, y = 0, and z + w = 0.
        planes = np.stack((clip[:, 0], clip[:, 1], clip[:, 2] + clip[:, 3]))
        right, up, near = np.moveaxis(planes[..., :3], 2, 1)
        with np.errstate(all="ignore"):
            crossed = np.array([cross(up, near), cross(near, right), cross(right, up)])
            weighted = crossed * planes[:, np.newaxis, :, 3]
            middles = -((weighted[0] + weighted[1]) + weighted[2]) / dot(right, crossed[0])
        return middles.T

    def compute_max_distance(self) -> Float64:
        """Return the distance from each eye, (N,), scene units, of the farthest point in view."""
        return compute_max_distance(self.corners, self.in_view)


def transform_batched_objects(world_from_model: Float64) -> ObjectTransforms:
    """Return `transform_objects` of N views, arrays (N, O, ...), given (N, O, 4, 4)."""
    shape = world_from_model.shape[:2]
    if 0 in shape:
        return ObjectTransforms(world_from_model, np.empty((*shape, 3, 3)), np.empty(shape))
    arrays = transform_objects(world_from_model.reshape(-1, 4, 4))
    return ObjectTransforms(*(array.reshape(*shape, *array.shape[1:]) for array in arrays))


def transform_to_views(
    world_from_model: Float64, eyes: Float64, view_from_world: Float64, clip_from_view: Float64
) -> BatchTransforms:
    """
    Return the transforms of objects to each of N views, as `object_transforms.transform_to_view`.

    Parameters
    ----------
    world_from_model : (N, O, 4, 4), or (1, O, 4, 4) float64
    eyes : (N, 3) float64, world space
    view_from_world, clip_from_view : (N, 4, 4) float64
    """
    count = len(eyes)
    relative = np.repeat(world_from_model, count // len(world_from_model), axis=0)
    relative[:, :, :3, 3] -= eyes[:, np.newaxis]
    return BatchTransforms(relative, *place_views(eyes, view_from_world, clip_from_view))


def are_boxes_between(
    ends: Float64, view_from_world: Float64, near: Float64, far: Float64
) -> NDArray[np.bool_]:
    """
    Tell of each view, (N,), whether a box surely lies between two planes.

    Parameters
    ----------
    ends : (N, 6) float64
        Low and high corner, world axes, relative to the eye.
    view_from_world : (N, 4, 4) float64
    near, far : (N,) float64
        Distances along the viewing axis; -inf and inf -> anywhere.
    """
    rows = -view_from_world[:, 2, :3]
    with np.errstate(all="ignore"):
        corners = np.stack((rows * ends[:, :3], rows * ends[:, 3:]))
        nearest, farthest = _row_sums(corners.min(axis=0)), _row_sums(corners.max(axis=0))
        error = RELATIVE_ERROR * _row_sums(np.abs(corners).max(axis=0))
        # NaN counts as unsure.
        return (nearest >= near + error) & (farthest <= far - error)


def _row_sums(terms: Float64) -> Float64:
    """Sum each row of (N, 3), from the left."""
    return (terms[:, 0] + terms[:, 1]) + terms[:, 2]
