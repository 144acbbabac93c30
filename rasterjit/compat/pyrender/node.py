"""Nodes of the scene's tree."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit import transforms
from rasterjit.validation import finite_array

if TYPE_CHECKING:
    from rasterjit.compat.pyrender.cameras import Camera
    from rasterjit.compat.pyrender.lights import Light
    from rasterjit.compat.pyrender.meshes import Mesh


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
            self.matrix = _composed(*parts)

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

    @property
    def translation(self) -> NDArray[np.float64]:
        """(3,) float64: where the node is, relative to its parent."""
        return self._matrix[:3, 3].copy()

    @translation.setter
    def translation(self, value: ArrayLike) -> None:
        self._matrix[:3, 3] = finite_array("translation", value, (3,))


def _composed(
    rotation: ArrayLike | None, scale: ArrayLike | None, translation: ArrayLike | None
) -> NDArray[np.float64]:
    """Return the matrix of glTF's three parts: scaled first, moved last."""
    turn = np.eye(4)
    if rotation is not None:
        x, y, z, w = finite_array("rotation", rotation, (4,)).tolist()
        square = x * x + y * y + z * z + w * w
        if square == 0.0:
            raise ValueError(f"rotation must not be 0, got {rotation!r}")
        s = 2.0 / square
        turn[:3, :3] = [
            [1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)],
        ]
    if scale is not None:
        turn = transforms.compose(turn, transforms.scale(scale))
    if translation is not None:
        turn[:3, 3] = finite_array("translation", translation, (3,))
    return turn
