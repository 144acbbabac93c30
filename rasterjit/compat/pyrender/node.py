"""Nodes of the scene's tree."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.compat.pyrender.camera import Camera
from rasterjit.compat.pyrender.fields import Field, anything, text_or_none
from rasterjit.compat.pyrender.light import Light
from rasterjit.compat.pyrender.mesh import Mesh
from rasterjit.scene.validation import in_short

_LENGTH_TOLERANCE = 1e-3
"""How far from 1 the length of a quaternion may be."""


def _held(kind: type) -> Any:
    """Return the field of what a node holds: an object of a class, or None."""

    def checked(value: Any) -> Any:
        if value is not None and not isinstance(value, kind):
            raise TypeError(f"must be a {kind.__name__} or None")
        return value

    return Field(checked, f"{kind.__name__} or None: what stands there.")


class Node:
    """
    A place that holds a mesh, a camera or a light, and further nodes.

    Parameters
    ----------
    name : str, optional
    camera, mesh, light : optional
        What stands there.
    children : list of Node, optional
        Kept, not copied.
    skin, weights : optional
        Kept and without effect.
    matrix : (4, 4) array_like, optional
        Pose relative to the parent, for column vectors. As in pyrender it is taken apart into
        rotation, scale and translation, which have no place for shears and mirrors:
        `Scene.set_pose` keeps these. Without it:
    rotation : (4,) array_like, optional
        Quaternion x, y, z, w.
    scale : (3,) array_like, optional
    translation : (3,) array_like, optional

    Raises
    ------
    TypeError
        If ``camera``, ``mesh`` or ``light`` is something else.
    ValueError
        If one of the poses is not such numbers.
    """

    def __init__(
        self,
        name: str | None = None,
        camera: Camera | None = None,
        children: list[Node] | None = None,
        skin: Any = None,
        matrix: ArrayLike | None = None,
        mesh: Mesh | None = None,
        rotation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        translation: ArrayLike | None = None,
        weights: Any = None,
        light: Light | None = None,
    ) -> None:
        if matrix is None:
            self.rotation = np.array([0.0, 0.0, 0.0, 1.0]) if rotation is None else rotation
            self.translation = np.zeros(3) if translation is None else translation
            self.scale = np.ones(3) if scale is None else scale
        else:
            self.matrix = matrix
        self.name = name
        self.camera, self.mesh, self.light = camera, mesh, light
        self.children = [] if children is None else children
        self.skin, self.weights = skin, weights

    _matrix: NDArray[Any] | None
    _rotation: NDArray[Any]
    _scale: NDArray[Any]
    _translation: NDArray[Any]

    def __repr__(self) -> str:
        return f"Node({self.name!r})"

    name = Field(text_or_none, "str or None: the node's name.")
    camera: Field[Camera | None] = _held(Camera)
    mesh: Field[Mesh | None] = _held(Mesh)
    light: Field[Light | None] = _held(Light)
    children = Field[list["Node"]](anything, "list of Node: what stands below it.")
    skin = Field(anything, "As it was given: nothing here has skins.")
    weights = Field(anything, "As they were given: nothing here changes shape.")

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) float64: pose relative to the parent, a copy."""
        if self._matrix is None:
            made = np.eye(4)
            made[:3, :3] = _turn(self._rotation) * self._scale
            made[:3, 3] = self._translation
            self._matrix = made
        return np.array(self._matrix, np.float64)

    @matrix.setter
    def matrix(self, value: ArrayLike) -> None:
        pose = _numbers("matrix", value, (4, 4))
        if not np.allclose(pose[3], (0.0, 0.0, 0.0, 1.0)):
            raise ValueError(f"matrix must have last row (0, 0, 0, 1), got {pose[3].tolist()}")
        self._rotation, self._scale = _parts_of(pose)
        self._translation = pose[:3, 3]
        self._matrix = None

    @property
    def rotation(self) -> NDArray[Any]:
        """(4,) array: quaternion x, y, z, w."""
        return self._rotation

    @rotation.setter
    def rotation(self, value: ArrayLike) -> None:
        given = _numbers("rotation", value, (4,))
        length = float(np.sqrt((given * given).sum()))
        if not abs(length - 1.0) <= _LENGTH_TOLERANCE:
            raise ValueError(f"rotation must be a quaternion of length 1, got {length:g}")
        self._rotation, self._matrix = given, None

    @property
    def scale(self) -> NDArray[Any]:
        """(3,) array: factors of x, y and z, before the rotation."""
        return self._scale

    @scale.setter
    def scale(self, value: ArrayLike) -> None:
        self._scale, self._matrix = _numbers("scale", value, (3,)), None

    @property
    def translation(self) -> NDArray[Any]:
        """(3,) array: where the node is, relative to its parent."""
        return self._translation

    @translation.setter
    def translation(self, value: ArrayLike) -> None:
        self._translation, self._matrix = _numbers("translation", value, (3,)), None

    def _keep(self, pose: ArrayLike) -> None:
        """Stand at a pose as it is; rotation, scale and translation stay as they were."""
        self._matrix = _numbers("pose", pose, (4, 4))


def _numbers(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return an array of a shape, no copy, or raise ``ValueError``."""
    try:
        given = np.asarray(value)
    except ValueError:
        raise ValueError(f"{name} must have shape {shape}, got {in_short(value)}") from None
    if given.shape != shape or given.dtype.kind not in "buif":
        raise ValueError(f"{name} must be numbers of shape {shape}, got {in_short(given)}")
    return given


def _turn(rotation: NDArray[Any]) -> NDArray[np.float64]:
    """Return the rotation of a quaternion of any length but 0, (3, 3) float64."""
    from trimesh.transformations import quaternion_matrix

    return np.asarray(quaternion_matrix(np.roll(rotation, 1)))[:3, :3]


def _parts_of(matrix: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rotation and scale of a matrix, those that are nearest."""
    from trimesh.transformations import quaternion_from_matrix

    x, y, z = matrix[:3, :3].astype(np.float64)
    scale = np.sqrt((x * x + y * y) + z * z)
    if not scale.all():
        # What is flat may be turned anyhow.
        return np.array([0.0, 0.0, 0.0, 1.0]), scale
    turn = np.eye(4)
    turn[:3, :3] = matrix[:3, :3] / scale
    return np.roll(quaternion_from_matrix(turn), -1), scale
