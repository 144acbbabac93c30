"""
Find lights that closed meshes around the camera block from all visible points.

Rays that cross no opaque mesh connect the near plane with all visible points. If a segment from the
near plane to a light crosses a closed mesh an odd number of times, the mesh separates them: each
other path crosses it, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.scene import transforms
from rasterjit.scene.mesh import Mesh

Float64 = NDArray[np.float64]

MAX_ENCLOSURE_FACES = 1 << 14
"""Most faces of a tested object, which takes 5 ms a frame; larger ones are left to shadow maps."""

MIN_VOLUME_RATIO = 2.0**-30
"""Least volume, relative to its terms, for a reliable sign: far above float64's rounding error."""

CLIP_ROUNDING = 2.0**-18
"""Relative error of clip coordinates where kernels clip in float32."""

SEGMENT_STARTS = ((0.0, 0.0), (0.31, 0.17), (-0.23, 0.41), (-0.37, -0.29))
"""Positions on the near plane, in -1..1, where segments to a light begin: if one hits an edge of a
mesh, the next is tried."""

NEAR_CORNERS = [(x, y, -1.0) for x in (-1.0, 1.0) for y in (-1.0, 1.0)]
"""Corners of the near plane, NDC. If any is behind the eye, part of the plane is not in view."""


class Enclosures:
    """
    The objects of a scene that may enclose everything visible.

    Parameters
    ----------
    meshes : sequence of Mesh
        Of each object.
    is_wall : (O,) bool
        Which objects are opaque from both sides.
    relative_from_model : (O, 4, 4) float64
        World axes, origin at the eye.
    clip_from_relative : (4, 4) float64
    """

    def __init__(
        self, meshes: Sequence[Mesh], is_wall: NDArray[np.bool_], relative_from_model: Float64,
        clip_from_relative: Float64,
    ) -> None:  # fmt: skip
        self._meshes = meshes
        self._is_wall = is_wall
        self._relative_from_model = relative_from_model
        self._clip_from_relative = clip_from_relative
        self._shells: dict[int, Float64 | None] = {}

    def find_separating_object(
        self, light: Float64, has_end: bool, low: Float64, high: Float64
    ) -> int | None:
        """
        Return the first closed object that separates everything visible from a light, if any.

        Parameters
        ----------
        light : (3,) float64
            Position of the light, relative to the eye, or the direction to a directional light.
        has_end : bool
            Whether it is a position.
        low, high : (O, 3) float64
            Corners of the boxes around the objects, relative to the eye.
        """
        if self.starts is None:
            return None
        is_enclosing = (low <= self.starts.min(axis=0)) & (high >= self.starts.max(axis=0))
        for k in np.flatnonzero(self._is_wall & is_enclosing.all(axis=1)).tolist():
            if k not in self._shells:
                self._shells[k] = self._find_closed_corners(k)
            corners = self._shells[k]
            if corners is not None and _separates(corners, self.starts, light, has_end):
                return k
        return None

    @cached_property
    def starts(self) -> Float64 | None:
        """Points of the near plane, (N, 3), relative to the eye; None if part is not in view."""
        try:
            relative_from_clip = transforms.inverse(self._clip_from_relative)
        except ValueError:
            return None
        corners = transforms.transform_points(relative_from_clip, NEAR_CORNERS)
        points = transforms.apply(relative_from_clip, [(x, y, -1.0) for x, y in SEGMENT_STARTS])
        is_in_view = (corners[:, 3] > 0.0).all() and np.isfinite(points).all()
        return points if is_in_view else None

    def _find_closed_corners(self, k: int) -> Float64 | None:
        """Return the corners, (3, F, 3), of an object if it is closed and not clipped."""
        mesh, matrix = self._meshes[k], self._relative_from_model[k]
        if len(mesh.faces) > MAX_ENCLOSURE_FACES or not mesh.is_closed():
            return None
        positions = transforms.transform_points(matrix, mesh.vertices)[:, :3]
        clip = transforms.transform_points(self._clip_from_relative, positions)
        if _meets_near_plane(clip[mesh.faces.T]):
            return None
        return positions[mesh.faces.T]


def _meets_near_plane(corners: Float64) -> bool:
    """Tell whether faces, corners (3, F, 4) in clip space, may cross the near plane in view."""
    with np.errstate(all="ignore"):
        height = corners[..., 3] + corners[..., 2]
        error = CLIP_ROUNDING * np.abs(corners).max(axis=2)
        # NaN counts as unsure.
        is_apart = (height > error).all(axis=0) | (height < -error).all(axis=0)
        corners, height, error = (side[:, ~is_apart] for side in (corners, height, error))
        # Distances inside each side of the view.
        sides = [corners[..., 3] + sign * corners[..., n] for n in (0, 1) for sign in (1.0, -1.0)]
        largest = np.full((4, corners.shape[1]), -np.inf)
        for i, j in ((0, 1), (1, 2), (2, 0)):
            # At the end of an edge, where it lies in the plane, or where the edge passes through.
            passes = (height[i] < 0.0) != (height[j] < 0.0)
            t = np.where(passes, height[i] / (height[i] - height[j]), 0.0)
            on_plane = passes | ~(np.abs(height[i]) > error[i])
            for side, values in zip(largest, sides, strict=True):
                value = values[i] + t * (values[j] - values[i])
                np.maximum(side, value, out=side, where=on_plane)
        is_beside = (largest < -error.max(axis=0)).any(axis=0)
    return not is_beside.all()


def _separates(corners: Float64, starts: Float64, light: Float64, has_end: bool) -> bool:
    """Tell whether segments to a light surely cross an odd number of faces, corners (3, F, 3)."""
    for start in starts:
        ray = light - start if has_end else light
        with np.errstate(all="ignore"):
            count = count_crossings(corners - start, ray, has_end)
        if count is not None:
            return count % 2 == 1
    return False


def count_crossings(corners: Float64, ray: Float64, has_end: bool) -> int | None:
    """
    Count the triangles that the segment from the origin along a vector crosses; None if unsure.

    Parameters
    ----------
    corners : (3, F, 3) float64
    ray : (3,) float64
    has_end : bool
        Whether the segment ends where the vector does, or is a ray.
    """
    a, b, c = corners
    is_degenerate = (a == b).all(axis=1) | (b == c).all(axis=1) | (c == a).all(axis=1)
    # The sign of a volume tells on which side of an edge the segment passes,
    volumes, terms = zip(
        *(_signed_volume(*edge, ray) for edge in ((a, b), (b, c), (c, a))), strict=True
    )
    left = [(v > MIN_VOLUME_RATIO * t) for v, t in zip(volumes, terms, strict=True)]
    right = [(v < -MIN_VOLUME_RATIO * t) for v, t in zip(volumes, terms, strict=True)]
    is_left, is_right = left[0] & left[1] & left[2], right[0] & right[1] & right[2]
    is_beside = (left[0] | left[1] | left[2]) & (right[0] | right[1] | right[2])
    # and on which side of the face's plane it begins and ends.
    start_side, volume_bound = _signed_volume(a, b, c)
    total = volumes[0] + volumes[1] + volumes[2]
    end_side = start_side - total if has_end else -total
    error = MIN_VOLUME_RATIO * (volume_bound + terms[0] + terms[1] + terms[2])
    is_reliable = (abs(start_side) > error) & (abs(end_side) > error)
    passes = is_left | is_right
    if not (is_degenerate | is_beside | (passes & is_reliable)).all():
        return None
    return int(np.count_nonzero(passes & ~is_degenerate & ((start_side > 0.0) != (end_side > 0.0))))


def _signed_volume(a: Float64, b: Float64, c: Float64) -> tuple[Float64, Float64]:
    """Return six times the volume of the origin and three points, and a bound of its terms."""
    (p, q, r), (s, t, u), (x, y, z) = a.T, b.T, c.T
    bound = 1.0
    for point in (a, b, c):
        size = np.abs(point.T)
        bound = bound * (size[0] + size[1] + size[2])
    return (q * u - r * t) * x + (r * s - p * u) * y + (p * t - q * s) * z, bound
