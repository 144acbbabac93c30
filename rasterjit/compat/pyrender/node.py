"""Nodes of the scene's tree."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.compat.pyrender.camera import Camera
from rasterjit.compat.pyrender.fields import (
    Field,
    OwnedField,
    check_named,
    keep_any,
    to_text_or_none,
)
from rasterjit.compat.pyrender.light import Light
from rasterjit.compat.pyrender.mesh import Mesh
from rasterjit.scene.decomposed_transform import TRS, compose_trs, quaternion_from_axes
from rasterjit.scene.validation import brief
from rasterjit.scene.vectors import cross, dot

_LENGTH_TOLERANCE = 1e-3
"""Largest difference of the length of a quaternion from 1."""
_ROTATION_TOLERANCE = 1e-6
"""Largest error of the products of a float32 rotation's axes."""
_OFF_DIAGONAL = (0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)
"""Rows and columns of the entries above the diagonal of a matrix, (4, 4)."""
_NEGLIGIBLE = 1e-18
"""Size of off-diagonal entries that count as 0, for a diagonal of about 1."""
_MAX_SWEEPS = 20
"""Most sweeps of Jacobi's method: far more than needed, as each doubles the correct digits."""


def _make_object_field(kind: type) -> Any:
    """Return a field that holds an object of a class, or None."""

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

    def __repr__(self) -> str:
        return f"Node({self.name!r})"

    name = Field(to_text_or_none, "str or None: the node's name.")
    camera: Field[Camera | None] = _make_object_field(Camera)
    mesh: Field[Mesh | None] = _make_object_field(Mesh)
    light: Field[Light | None] = _make_object_field(Light)
    children = Field[list["Node"]](keep_any, "list of Node: what stands below it.")
    skin = Field(keep_any, "As it was given: nothing here has skins.")
    weights = Field(keep_any, "As they were given: nothing here changes shape.")

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) float64: pose relative to the parent, a copy."""
        if self._matrix is None:
            parts = (self._translation, self._rotation, self._scale)
            self._matrix = compose_trs(TRS(*(tuple(part.tolist()) for part in parts)))
        return np.array(self._matrix, np.float64)

    @matrix.setter
    def matrix(self, value: ArrayLike) -> None:
        pose = check_named("matrix", lambda given: _check_array(given, (4, 4)), value)
        if not np.allclose(pose[3], (0.0, 0.0, 0.0, 1.0)):
            raise ValueError(f"matrix must have last row (0, 0, 0, 1), got {pose[3].tolist()}")
        self._rotation, self._scale = _decompose(pose)
        self._translation = pose[:3, 3]
        self._matrix = None

    def _check_quaternion(self, value: ArrayLike) -> NDArray[Any]:
        """Return a quaternion if its length is 1; drop the cached matrix."""
        given = _check_array(value, (4,))
        length = float(np.sqrt((given * given).sum()))
        if not abs(length - 1.0) <= _LENGTH_TOLERANCE:
            raise ValueError(f"must be a quaternion of length 1, got {length:g}")
        self._matrix = None
        return given

    def _check_vector(self, value: ArrayLike) -> NDArray[Any]:
        """Return an array of three numbers; drop the cached matrix."""
        given = _check_array(value, (3,))
        self._matrix = None
        return given

    rotation = OwnedField(_check_quaternion, "(4,) array: quaternion x, y, z, w.")
    scale = OwnedField(_check_vector, "(3,) array: factors of x, y and z, before the rotation.")
    translation = OwnedField(_check_vector, "(3,) array: where it is, relative to its parent.")

    def _set_pose(self, pose: ArrayLike) -> None:
        """Set the matrix alone: rotation, scale and translation keep their values."""
        self._matrix = check_named("pose", lambda given: _check_array(given, (4, 4)), pose)


def _check_array(value: ArrayLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return a value as an array of a shape, without a copy, or raise ``ValueError``."""
    try:
        given = np.asarray(value)
    except ValueError:
        raise ValueError(f"must have shape {shape}, got {brief(value)}") from None
    if given.shape != shape or given.dtype.kind not in "buif":
        raise ValueError(f"must be numbers of shape {shape}, got {brief(given)}")
    return given


def _decompose(matrix: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the nearest rotation, as a quaternion, and the scale of a matrix."""
    x, y, z = matrix[:3, :3].astype(np.float64)
    scale = np.sqrt((x * x + y * y) + z * z)
    if not scale.all():
        # The rotation of a flat matrix is not determined.
        return np.array([0.0, 0.0, 0.0, 1.0]), scale
    rotation = np.array(_find_nearest_rotation((matrix[:3, :3] / scale).tolist()))
    return -rotation if rotation[3] < 0.0 else rotation, scale


def _find_nearest_rotation(matrix: list[list[float]]) -> list[float]:
    """
    Return the quaternion x, y, z, w of the rotation nearest to a matrix, which may shear or mirror.

    For a matrix that is no rotation, it is the eigenvector of the largest eigenvalue of a symmetric
    matrix [1]_, computed by Jacobi's method in a fixed order, so that its last bits depend on no
    library.

    References
    ----------
    .. [1] I. Bar-Itzhack, "New Method for Extracting the Quaternion from a Rotation Matrix", 2000.
    """
    axes: Any = tuple(zip(*matrix, strict=True))
    products = [dot(axes[i], axes[j]) - float(i == j) for i in range(3) for j in range(i, 3)]
    if (
        max(map(abs, products)) <= _ROTATION_TOLERANCE
        and dot(axes[0], cross(axes[1], axes[2])) > 0.0
    ):
        return list(quaternion_from_axes(*axes))
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    rows = [
        [xx - yy - zz, xy + yx, xz + zx, zy - yz],
        [xy + yx, yy - xx - zz, yz + zy, xz - zx],
        [xz + zx, yz + zy, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz],
    ]
    vectors = np.eye(4).tolist()
    for _ in range(_MAX_SWEEPS):
        if max(abs(rows[p][q]) for p, q in _OFF_DIAGONAL) <= _NEGLIGIBLE:
            break
        for p, q in _OFF_DIAGONAL:
            if rows[p][q] != 0.0:
                _zero_entry(rows, vectors, p, q)
    # A mirror has three largest eigenvalues: take the one that LAPACK returns to pyrender.
    order, values = list(range(4)), [rows[k][k] for k in range(4)]
    least = values.index(min(values))
    order[0], order[least] = order[least], order[0]
    largest = max(order, key=values.__getitem__)
    return [row[largest] for row in vectors]


def _zero_entry(rows: list[list[float]], vectors: list[list[float]], p: int, q: int) -> None:
    """Rotate a symmetric matrix, and its eigenvectors so far, so that entry (p, q) becomes 0."""
    theta = (rows[q][q] - rows[p][p]) / (2.0 * rows[p][q])
    tangent = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    for table in (rows, vectors):
        for row in table:
            row[p], row[q] = cosine * row[p] - sine * row[q], sine * row[p] + cosine * row[q]
    a, b = rows[p], rows[q]
    rows[p] = [cosine * x - sine * y for x, y in zip(a, b, strict=True)]
    rows[q] = [sine * x + cosine * y for x, y in zip(a, b, strict=True)]
    rows[p][q] = rows[q][p] = 0.0
