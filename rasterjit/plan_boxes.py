"""
Find which objects a camera may see: the one place where boxes are held against the view volume.

An object is out of view where the box around it surely lies beyond one of the six planes. What is
not sure counts as in view.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.mesh import Mesh

Float64 = NDArray[np.float64]

ROUNDING = 2.0**-40
"""What a box must lie beyond a plane by, as a share of the terms that are added up to say so: far
more than float64 rounds them by. Snapping moves no vertex over the border of the picture."""

CORNERS = np.array([[n & 1, n >> 1 & 1, n >> 2 & 1] for n in range(8)])
"""Which end of its box each corner lies at, by axis."""


class Boxes:
    """
    The boxes around the objects of a scene, seen from the eye of a camera.

    Parameters
    ----------
    bounds : (O, 2, 3) float64
        Low and high corner of each object, model space; NaN for one without a finite face.
    eye : (3,) float64, world space
    relative_from_model : (O, 4, 4) float64
        To world axes with the origin at the eye.
    clip_from_relative : (4, 4) float64

    Attributes
    ----------
    eye : (3,) float64, world space
    in_view : (O,) bool
        Which objects the camera may see.
    """

    def __init__(
        self, bounds: Float64, eye: Float64, relative_from_model: Float64,
        clip_from_relative: Float64,
    ) -> None:  # fmt: skip
        self.eye = eye
        self._bounds = bounds
        self._relative_from_model = relative_from_model
        self.in_view = self._may_be_seen(clip_from_relative)

    def _may_be_seen(self, matrix: Float64) -> NDArray[np.bool_]:
        """Tell which boxes are not all beyond a plane of the view volume."""
        low, high = np.ascontiguousarray(self._bounds.transpose(1, 2, 0))
        # Rows and columns of the matrices first, so that each entry is a row of all objects.
        m = np.ascontiguousarray(self._relative_from_model[:, :3].transpose(1, 2, 0))
        outside = np.isnan(low[0])
        with np.errstate(invalid="ignore", over="ignore"):
            middle, half = low / 2.0 + high / 2.0, high / 2.0 - low / 2.0
            farthest = np.abs(middle) + half
            sizes = np.abs(m[:, 0]) * farthest[0] + np.abs(m[:, 1]) * farthest[1]
            sizes += np.abs(m[:, 2]) * farthest[2]
            sizes += np.abs(m[:, 3])
            # A plane holds inside what has a x + b y + c z + d >= 0: rows w - x, w + x, and so on.
            planes = np.concatenate((matrix[3] - matrix[:3], matrix[3] + matrix[:3]))
            # Measure the corner of each box that lies farthest inside.
            along = _along(planes, m)
            parts = along[:, :3] * middle + np.abs(along[:, :3]) * half
            most = along[:, 3] + planes[:, 3, np.newaxis]
            for k in range(3):
                most += parts[:, k]
            # Of both rows: what is drawn compares them, and they may nearly cancel.
            rows = np.abs(matrix[3]) + np.abs(matrix[:3])
            reach = _along(rows, sizes) + rows[:, 3, np.newaxis]
            # What is not a number is not sure.
            beyond = most.reshape(2, 3, -1) < -ROUNDING * reach
        outside |= beyond.any(axis=(0, 1))
        return ~outside

    @cached_property
    def corners(self) -> Float64:
        """Corners, (O, 8, 3), in world axes, relative to the eye."""
        return place_boxes(self._bounds, self._relative_from_model)

    @cached_property
    def is_known(self) -> NDArray[np.bool_]:
        """Which boxes have finite corners, (O,)."""
        return np.isfinite(self.corners).all(axis=(1, 2))

    @cached_property
    def is_flat(self) -> NDArray[np.bool_]:
        """Which boxes have no inside, (O,)."""
        return (self._bounds[:, 0] == self._bounds[:, 1]).any(axis=1)

    def farthest(self) -> float:
        """Return a distance from the eye, scene units, that nothing in view is beyond."""
        corners = self.corners[self.in_view]
        with np.errstate(over="ignore"):
            x, y, z = (corners[..., k] for k in range(3))
            squares = (x * x + y * y) + z * z
        # Of what is not finite it is not known how far it reaches.
        squares = np.where(np.isfinite(squares), squares, np.inf)
        return float(np.sqrt(squares.max(initial=0.0)))


def _along(planes: Float64, points: Float64) -> Float64:
    """Return a x + b y + c z of planes (P, 4) for coordinates x, y, z: (P, ...) of (3, ...)."""
    a, b, c = planes[:, :3].T.reshape(3, -1, *(1,) * (points.ndim - 1))
    return (a * points[0] + b * points[1]) + c * points[2]


def mesh_boxes(meshes: Sequence[Mesh]) -> Float64:
    """Return the low and high corner of each object, (O, 2, 3), model space; NaN if it has none."""
    numbers: dict[Mesh, int] = {}
    which = [numbers.setdefault(mesh, len(numbers)) for mesh in meshes]
    return np.array([_box_of(mesh) for mesh in numbers]).reshape(-1, 2, 3)[which]


def _box_of(mesh: Mesh) -> Any:
    """Return the bounds of a mesh, NaN if no face has a finite vertex."""
    try:
        return mesh.bounds()
    except ValueError:
        return np.full((2, 3), np.nan)


def place_boxes(boxes: Float64, matrices: Float64) -> Float64:
    """Return the corners, (O, 8, 3), of boxes (O, 2, 3) that matrices (O, 3, 4) put somewhere."""
    corners = boxes[:, CORNERS, np.arange(3)]
    x, y, z = (corners[:, :, k, np.newaxis] for k in range(3))
    m = matrices[:, np.newaxis, :3, :]
    with np.errstate(invalid="ignore", over="ignore"):
        return x * m[..., 0] + y * m[..., 1] + z * m[..., 2] + m[..., 3]
