"""
Turn, pan and zoom a camera around a target as a trackball does.

References
----------
pyrender 0.1.45, module ``trackball``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_TURN_SHARE_PER_RADIAN = 0.3
"""Share of the window's shorter side over which a drag turns by a radian."""
_PAN_DIVISOR = 5.0
"""Diagonal of the scene over the movement by a drag that would turn by a radian."""
_ZOOM_PER_CLICK = 0.9
"""Factor on the distance for each click of the wheel."""

Float64 = NDArray[np.float64]


class Trackball:
    """
    The pose of a camera that drags of the mouse turn, roll, move and zoom.

    Parameters
    ----------
    pose : (4, 4) array_like
        Of the camera, in the world.
    size : (float, float), pixels
        Width and height of the window.
    scale : float, scene units
        Diagonal of the scene: how fast drags move.
    target : (3,) array_like, scene units
        Point that the camera turns around.
    """

    STATE_ROTATE, STATE_PAN, STATE_ROLL, STATE_ZOOM = 0, 1, 2, 3

    def __init__(
        self,
        pose: ArrayLike,
        size: ArrayLike,
        scale: float,
        target: ArrayLike = np.array([0.0, 0.0, 0.0]),  # noqa: B008
    ) -> None:
        self._size = np.array(size)
        self._scale = float(scale)
        self._pose = self._n_pose = np.asarray(pose, np.float64)
        self._target = self._n_target = np.asarray(target, np.float64)
        self._state = self.STATE_ROTATE
        self._pressed = np.zeros(2)

    @property
    def pose(self) -> Float64:
        """(4, 4) float64: the camera's pose in the world."""
        return self._n_pose

    def set_state(self, state: int) -> None:
        """Set what drags do: one of ``STATE_ROTATE``, ``_PAN``, ``_ROLL`` and ``_ZOOM``."""
        self._state = state

    def resize(self, size: ArrayLike) -> None:
        """Set the width and height of the window, pixels."""
        self._size = np.array(size)

    def down(self, point: ArrayLike) -> None:
        """Begin a drag at a pixel (x, y), y up."""
        self._pressed = np.array(point, np.float64)
        self._pose, self._target = self._n_pose, self._n_target

    def drag(self, point: ArrayLike) -> None:
        """Drag to a pixel (x, y), y up, from where the drag began."""
        here = np.array(point, np.float64)
        pose, target = self._pose, self._target
        right, up, back, eye = pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3]
        step = here - self._pressed
        turned = step / (_TURN_SHARE_PER_RADIAN * self._size.min())
        if self._state == self.STATE_ROTATE:
            around_up = _make_rotation(-turned[0], up, target)
            self._n_pose = _make_rotation(turned[1], right, target) @ around_up @ pose
        elif self._state == self.STATE_ROLL:
            middle = self._size / 2.0
            before, after = _compute_angle(self._pressed - middle), _compute_angle(here - middle)
            self._n_pose = _make_rotation(before - after, back, target) @ pose
        elif self._state == self.STATE_PAN:
            x, y = -turned / _PAN_DIVISOR * self._scale
            move = x * right + y * up
            self._n_target = target + move
            self._n_pose = _translate_pose(pose, move)
        elif self._state == self.STATE_ZOOM:
            # The distance grows exponentially as the mouse goes down, and shrinks as it goes up.
            dy = step[1] / (0.5 * self._size[1])
            share = np.expm1(dy) if dy > 0.0 else 1.0 - np.exp(dy)
            move = -np.sign(dy) * share * _compute_length(eye - target) * back
            self._n_pose = _translate_pose(pose, move)

    def scroll(self, clicks: float) -> None:
        """Move closer by clicks of the wheel; away if they are negative."""
        self._n_pose = self._scroll_pose(self._n_pose, clicks)
        self._pose = self._scroll_pose(self._pose, clicks)

    def rotate(self, azimuth: float, axis: ArrayLike | None = None) -> None:
        """Turn by an angle in radians around an axis, (3,); default: the camera's up."""
        self._n_pose = self._rotate_pose(self._n_pose, azimuth, axis)
        self._pose = self._rotate_pose(self._pose, azimuth, axis)

    def _scroll_pose(self, pose: Float64, clicks: float) -> Float64:
        distance = _compute_length(pose[:3, 3] - self._target)
        return _translate_pose(pose, (_ZOOM_PER_CLICK**clicks - 1.0) * distance * pose[:3, 2])

    def _rotate_pose(self, pose: Float64, azimuth: float, axis: ArrayLike | None) -> Float64:
        around = pose[:3, 1] if axis is None else np.asarray(axis, np.float64)
        return _make_rotation(azimuth, around, self._target) @ pose


def _make_rotation(angle: float, axis: Float64, center: Float64) -> Float64:
    """Return a rotation by radians around an axis through a point, (4, 4)."""
    from trimesh.transformations import rotation_matrix

    turn: Any = rotation_matrix(angle, axis, center)
    return np.asarray(turn, np.float64)


def _translate_pose(pose: Float64, move: Float64) -> Float64:
    """Return a pose moved in the world."""
    moved = pose.copy()
    moved[:3, 3] += move
    return moved


def _compute_angle(vector: Float64) -> float:
    """Return the direction of a vector, radians."""
    return float(np.arctan2(vector[1], vector[0]))


def _compute_length(vector: Float64) -> float:
    """Return the length of a vector."""
    return float(np.sqrt((vector * vector).sum()))
