"""Nodes of the scene's tree."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import transforms
from rasterjit.scene.validation import finite_array

if TYPE_CHECKING:
    from rasterjit.compat.pyrender.camera import Camera
    from rasterjit.compat.pyrender.light import Light
    from rasterjit.compat.pyrender.mesh import Mesh


class Node:
    """
    A place that holds a mesh, a camera or a light, and further nodes.

    Parameters
    ----------
    name : str, optional
    camera, mesh, light : optional
        What stands there.
    children : list of Node, optional
    matrix : (4, 4) array_like, optional
        Pose relative to the parent, for column vectors; in its place:
    rotation : (4,) array_like, optional
        Quaternion x, y, z, w.
    scale : float or (3,) array_like, optional
    translation : (3,) array_like, optional

    Raises
    ------
    ValueError
        If one of the poses is not such numbers.
    """

    def __init__(
        self,
        name: str | None = None,
        camera: Camera | None = None,
        children: list[Node] | None = None,
        skin: None = None,
        matrix: ArrayLike | None = None,
        mesh: Mesh | None = None,
        rotation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        translation: ArrayLike | None = None,
        weights: None = None,
        light: Light | None = None,
    ) -> None:
        self.name = name
        self.camera, self.mesh, self.light = camera, mesh, light
        self.children: list[Node] = [] if children is None else list(children)
        if skin is not None or weights is not None:
            raise ValueError("skin and weights must be None: shapes do not change here")
        parts = (rotation, scale, translation)
        if matrix is not None:
            if any(part is not None for part in parts):
                raise ValueError("matrix must be None where rotation, scale or translation is not")
            self.matrix = matrix
        else:
            self._rotation = _unit_quaternion(
                (0.0, 0.0, 0.0, 1.0) if rotation is None else rotation
            )
            self._scale = _scales(1.0 if scale is None else scale)
            self._place((0.0, 0.0, 0.0) if translation is None else translation)

    def __repr__(self) -> str:
        return f"Node({self.name!r})"

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) float64: pose relative to the parent."""
        return self._matrix

    @matrix.setter
    def matrix(self, value: ArrayLike) -> None:
        pose = finite_array("matrix", value, (4, 4)).copy()
        if pose[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            raise ValueError(f"matrix must have last row (0, 0, 0, 1), got {pose[3].tolist()}")
        self._matrix = pose
        self._rotation, self._scale = _parts_of(pose)

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(4,) float64: unit quaternion x, y, z, w; of a sheared matrix, what is nearest to it."""
        return self._rotation.copy()

    @rotation.setter
    def rotation(self, value: ArrayLike) -> None:
        self._rotation = _unit_quaternion(value)
        self._place(self.translation)

    @property
    def scale(self) -> NDArray[np.float64]:
        """(3,) float64: factors of x, y and z, before the rotation."""
        return self._scale.copy()

    @scale.setter
    def scale(self, value: ArrayLike) -> None:
        self._scale = _scales(value)
        self._place(self.translation)

    @property
    def translation(self) -> NDArray[np.float64]:
        """(3,) float64: where the node is, relative to its parent."""
        return self._matrix[:3, 3].copy()

    @translation.setter
    def translation(self, value: ArrayLike) -> None:
        self._matrix[:3, 3] = finite_array("translation", value, (3,))

    def _place(self, translation: ArrayLike) -> None:
        """Make the matrix of glTF's three parts: scaled first, moved last."""
        matrix = transforms.compose(_turn(self._rotation), transforms.scale(self._scale))
        matrix[:3, 3] = finite_array("translation", translation, (3,))
        self._matrix = matrix


def _unit_quaternion(value: ArrayLike) -> NDArray[np.float64]:
    """Return a rotation, (4,) float64, of length 1, or raise ``ValueError``."""
    given = finite_array("rotation", value, (4,))
    largest = float(np.abs(given).max())
    if largest == 0.0:
        raise ValueError(f"rotation must not be 0, got {value!r}")
    x, y, z, w = (given / largest).tolist()
    return np.array([x, y, z, w]) / math.sqrt(x * x + y * y + z * z + w * w)


def _scales(value: ArrayLike) -> NDArray[np.float64]:
    """Return three factors, (3,) float64, of one or three."""
    given = np.asarray(value)
    return finite_array("scale", np.repeat(given, 3) if given.ndim == 0 else given, (3,)).copy()


def _turn(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix of a unit quaternion, (4, 4) float64."""
    x, y, z, w = rotation.tolist()
    turn = np.eye(4)
    turn[:3, :3] = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return turn


def _parts_of(matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rotation and scale of a matrix; one that mirrors has a negative factor of x."""
    from trimesh.transformations import quaternion_from_matrix

    x, y, z = matrix[:3, :3]
    scale = np.sqrt((x * x + y * y) + z * z)
    if not scale.all():
        # What is flat may be turned anyhow.
        return np.array([0.0, 0.0, 0.0, 1.0]), scale
    turn = np.eye(4)
    turn[:3, :3] = matrix[:3, :3] / scale
    i, j, k = turn[:3, 0], turn[:3, 1], turn[:3, 2]
    x, y, z = (np.cross(i, j) * k).tolist()
    if (x + y) + z < 0.0:
        scale[0] = -scale[0]
        turn[:3, 0] = -i
    w, *vector = quaternion_from_matrix(turn, isprecise=True).tolist()
    return _unit_quaternion([*vector, w]), scale
