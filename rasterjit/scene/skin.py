"""
Skins and morph targets: deform a mesh by joints and by weighted shapes.

A mesh says for each vertex which joints it follows and how much, and where morph targets take it; a
node says which nodes the joints are (`Skin`) and how strong the targets are. Targets move vertices
first, then joints do.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), sections 3.7.2.2 and
   3.7.3.3.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rasterjit.scene import validation as check
from rasterjit.scene.arrays import Float32, Float64, HoldsArrays, Int32
from rasterjit.scene.attribute_guard import Guarded
from rasterjit.scene.transforms import inverse, product_of_each

WEIGHT_ROUNDING = 1e-5
"""Largest distance of the sum of a vertex's weights from 1: the rounding in files."""

AFFINE_ROUNDING = 1e-6
"""Largest distance of an inverse bind matrix's last row from 0, 0, 0, 1: rounding of float32."""

_MIN_DETERMINANT = 1e-30
"""Least determinant of a matrix with an inverse, its rows scaled to 1."""


class Deformable:
    """Note whether this process has made a mesh with joints or morph targets: else skip posing."""

    any_made = False


class WorldObject:
    """Base class of nodes: an object with a world matrix."""

    _world_from_model: Float64


class Skin(HoldsArrays, Guarded):
    """
    The joints that a mesh follows.

    A node with a skin is drawn where the joints take its mesh: at the sum over a vertex's joints of
    ``weight * joint.world_matrix @ inverse_bind``. Its own transform, and those above it, do not
    count; the joints stand in the world by theirs. To pose it, joints are moved:
    ``joint.transform = ...``.

    Parameters
    ----------
    joints : sequence of Node
        Any nodes, in the scene or not. `Mesh.joints` numbers them in this order.
    inverse_binds : (J, 4, 4) array_like, optional
        ``joint_from_model`` of each joint in the bind pose; affine. Default: the
        inverses of the joints' ``world_matrix`` now, so that the mesh is in its bind pose where it
        stands in model space.
    name : str, optional

    Raises
    ------
    ValueError
        If there is no joint, one is no `Node`, or a matrix is not finite, not affine or without an
        inverse; without ``inverse_binds``, if the ``world_matrix`` of a joint has none.
    AttributeError
        If anything else than ``name`` is assigned.

    Examples
    --------
    >>> import rasterjit as rj
    >>> scene = rj.Scene()
    >>> root = scene.add(rj.Node(name="root"))
    >>> tip = scene.add(rj.Node(transform=rj.transforms.translate((1, 0, 0))), parent=root)
    >>> strip = rj.Mesh(
    ...     [[0, 0, 0], [2, 0, 0], [2, 1, 0]], [[0, 1, 2]],
    ...     joints=[[0], [1], [1]], weights=[[1.0], [1.0], [1.0]],
    ... )
    >>> node = scene.add(rj.Node(strip, skin=rj.Skin([root, tip])))
    >>> tip.transform = rj.transforms.translate((3, 0, 0))
    >>> scene.bounds()[1].tolist()
    [4.0, 1.0, 0.0]
    """

    _FIELDS = ("name",)
    _ADVICE = "make another Skin"

    def __init__(
        self, joints: Sequence[Any], inverse_binds: ArrayLike | None = None, name: str = ""
    ) -> None:
        self.name = name
        self._joints = _check_joints(joints)
        if inverse_binds is None:
            self._inverse_binds = _invert_joint_matrices(self._joints)
        else:
            self._inverse_binds = check.read_only(
                _check_inverse_binds(inverse_binds, len(self._joints))
            )
        self._cached_matrices: tuple[list[Float64], Float64] | None = None

    @property
    def joints(self) -> tuple[Any, ...]:
        """The nodes that move the mesh."""
        return self._joints

    @property
    def inverse_binds(self) -> Float64:
        """(J, 4, 4) float64, read-only: ``joint_from_model`` of each joint."""
        return self._inverse_binds

    def joint_matrices(self) -> Float64:
        """
        Return each joint's world matrix times its inverse bind matrix, ``world_from_model``.

        Returns
        -------
        (J, 4, 4) float64, read-only
            The same array as long as no joint moves. Not finite where the product overflows.
        """
        poses = [joint._world_from_model for joint in self._joints]
        cached = self._cached_matrices
        if cached is not None and all(map(operator.is_, cached[0], poses)):
            return cached[1]
        with np.errstate(over="ignore", invalid="ignore"):
            matrices = check.read_only(product_of_each(np.array(poses), self._inverse_binds))
        self._cached_matrices = poses, matrices
        return matrices

    def __getstate__(self) -> dict[str, Any]:
        """Return what is copied or pickled."""
        return {**self.__dict__, "_cached_matrices": None}

    def _with_joints(self, joints: Sequence[Any]) -> Skin:
        """Return a copy of the skin with other joints, as many."""
        return self._with(_joints=tuple(joints), _cached_matrices=None)

    def __repr__(self) -> str:
        return f"Skin({len(self._joints)} joints{f', {self.name!r}' if self.name else ''})"


class MorphTargets(HoldsArrays, Guarded):
    """
    Shapes that a mesh can be drawn towards, each by a weight.

    Vertex ``v`` is drawn at ``vertices[v] + sum over t of weights[t] * positions[t, v]``; normals
    and tangents alike, and of unit length again. A kind that is not given does not change, but for
    the normals of a mesh that was given none, which follow its faces.

    Parameters
    ----------
    positions : (T, V, 3) array_like, optional
        How far each of T targets moves each vertex, model space, scene units.
    normals : (T, V, 3) array_like, optional
        What each adds to the normals.
    tangents : (T, V, 3) array_like, optional
        What each adds to the tangents' directions.
    weights : (T,) array_like, optional
        How strong they are where a node says nothing. Default: 0.
    names : sequence of str, optional
        One for each target.

    Raises
    ------
    ValueError
        If no array is given, one has the wrong shape or type, or holds NaN or infinity, or there is
        not a name for each target.
    AttributeError
        If anything is assigned.
    """

    _ADVICE = "make another MorphTargets"

    def __init__(
        self,
        positions: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        tangents: ArrayLike | None = None,
        *,
        weights: ArrayLike | None = None,
        names: Sequence[str] = (),
    ) -> None:
        self._shape: tuple[int, int] | None = None
        self._positions = self._check_array("positions", positions)
        self._normals = self._check_array("normals", normals)
        self._tangents = self._check_array("tangents", tangents)
        if self._shape is None:
            raise ValueError("positions, normals or tangents must be given, got none of them")
        self._weights: Float64 | None = None
        if weights is not None:
            self._weights = morph_weights(weights, self._shape[0])
        self._names: tuple[str, ...] = check.strings("names", names)
        if len(self._names) not in (0, self._shape[0]):
            raise ValueError(
                f"names must have one for each of {self._shape[0]} targets, "
                f"got {check.brief(names)}"
            )

    def _check_array(self, name: str, value: ArrayLike | None) -> NDArray[Any] | None:
        """Return an array of all targets, of the others' shape, or raise ``ValueError``."""
        if value is None:
            return None
        given = check.unmasked_array(name, value)
        shape = (None, None, 3) if self._shape is None else (*self._shape, 3)
        array = check.finite_array(name, value, shape)
        if 0 in array.shape:
            raise ValueError(f"{name} must have a target and a vertex, got {array.shape}")
        self._shape = array.shape[0], array.shape[1]
        is_single = given.dtype == np.float32 or name != "positions"
        return check.read_only(np.array(array, np.float32 if is_single else np.float64, order="C"))

    @property
    def positions(self) -> NDArray[Any] | None:
        """(T, V, 3) float64, or float32 where such were given, read-only; or None."""
        return self._positions

    @property
    def normals(self) -> Float32 | None:
        """(T, V, 3) float32, read-only, or None."""
        return self._normals

    @property
    def tangents(self) -> Float32 | None:
        """(T, V, 3) float32, read-only, or None."""
        return self._tangents

    @property
    def weights(self) -> Float64 | None:
        """(T,) float64, read-only: weights for nodes that give none; None: 0."""
        return self._weights

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the targets; empty if none were given."""
        return self._names

    @property
    def vertex_count(self) -> int:
        """Number of vertices that the targets move."""
        assert self._shape is not None
        return self._shape[1]

    def __len__(self) -> int:
        assert self._shape is not None
        return self._shape[0]

    def of_vertices(self, rows: NDArray[np.integer]) -> MorphTargets:
        """Return the targets of some vertices, (W,) numbers, in their order."""
        indices = check.unmasked_array("rows", rows)
        if indices.ndim != 1 or (indices.size and indices.dtype.kind not in "iu"):
            raise ValueError(f"rows must be (W,) numbers of vertices, got {check.brief(rows)}")
        indices = indices.astype(np.int64, copy=False)
        check.index_below("rows", max(indices.tolist(), default=0), self.vertex_count)
        check.index_below("rows", min(indices.tolist(), default=0), self.vertex_count)
        arrays = ((name, self.__dict__[name]) for name in ("_positions", "_normals", "_tangents"))
        parts = {name: check.read_only(one[:, indices]) for name, one in arrays if one is not None}
        return self._with(_shape=(len(self), len(indices)), **parts)

    def with_weights(self, weights: ArrayLike | None, names: Sequence[str]) -> MorphTargets:
        """Return the same targets with other weights and names."""
        checked = None if weights is None else morph_weights(weights, len(self))
        return self._with(_weights=checked, _names=check.strings("names", names))

    def __repr__(self) -> str:
        return f"MorphTargets({len(self)} targets, {self.vertex_count} vertices)"


def morph_weights(value: ArrayLike, count: int) -> Float64:
    """Return weights of morph targets, (T,) float64, read-only, or raise ``ValueError``."""
    return check.read_only(np.array(check.finite_array("weights", value, (count,))))


def skin_arrays(joints: Any, weights: Any, vertex_count: int) -> tuple[Int32, Float64]:
    """
    Return which joints each vertex follows, (V, K) int32, and how much, (V, K) float64.

    Weights whose sum is not 1 are scaled, unless by rounding alone; joints of weight 0 are 0.

    Raises
    ------
    ValueError
        If one is given without the other, shapes or types are wrong, a joint number is negative or
        no whole number, a weight is NaN, infinite or negative, or all of a vertex are 0.
    """
    if joints is None or weights is None:
        given, missing = ("joints", "weights") if weights is None else ("weights", "joints")
        raise ValueError(f"{missing} must be given where {given} are, got None")
    values = check.number_array("weights", weights)
    if values.ndim != 2 or len(values) != vertex_count or not values.shape[1]:
        raise ValueError(f"weights must have shape ({vertex_count}, K), got {values.shape}")
    numbers = check.number_array("joints", joints)
    if numbers.shape != values.shape:
        raise ValueError(
            f"joints must have the shape of weights, {values.shape}, got {numbers.shape}"
        )
    if not (np.isfinite(values).all() and (values >= 0.0).all()):
        example = values[~(np.isfinite(values) & (values >= 0.0))][0]
        raise ValueError(f"weights must be finite and at least 0, got {float(example)!r}")
    is_used = values > 0.0
    if not is_used.any(axis=1).all():
        first = int(np.argmin(is_used.any(axis=1)))
        raise ValueError(f"weights must not all be 0 for a vertex, got so for vertex {first}")
    numbers = np.where(is_used, numbers, 0.0)
    largest = float(np.iinfo(np.int32).max)
    is_integer = (numbers >= 0.0) & (numbers <= largest) & (numbers == np.floor(numbers))
    if not is_integer.all():
        example = numbers[~is_integer][0]
        raise ValueError(f"joints must be whole numbers from 0, got {float(example)!r}")
    return check.read_only(numbers.astype(np.int32)), check.read_only(normalize_weights(values))


def normalize_weights(weights: Float64) -> Float64:
    """Return weights (V, K) with the rows scaled whose sum is not 1 by more than rounding."""
    sums = sum_rows(weights)
    is_off = np.abs(sums - 1.0) > WEIGHT_ROUNDING
    if not is_off.any():
        return np.array(weights)
    if np.isinf(sums).any():
        # Scaled by the largest first, they add up to no more than there are.
        largest = weights.max(axis=1)
        weights = weights / np.where(np.isinf(sums), largest, 1.0)[:, np.newaxis]
        sums = sum_rows(weights)
    return np.where(is_off[:, np.newaxis], weights / sums[:, np.newaxis], weights)


def sum_rows(values: Float64) -> Float64:
    """Return the sum of each row, in the order of the columns: the same bits on every CPU."""
    total = np.zeros(len(values))
    with np.errstate(over="ignore", invalid="ignore"):
        for column in values.T:
            total = total + column
    return total


def check_skin(value: Any, mesh: Any) -> Skin | None:
    """Return a skin that fits a mesh, or None, or raise ``ValueError``."""
    if value is None:
        return None
    if not isinstance(value, Skin):
        raise ValueError(f"skin must be a Skin or None, got {check.brief(value)}")
    if mesh is not None:
        if mesh.joints is None:
            raise ValueError(
                f"skin must be None for a mesh without joints and weights, got {value!r} for "
                f"{mesh!r}"
            )
        max_joint = int(mesh.joints.max())
        if max_joint >= len(value.joints):
            raise ValueError(
                f"skin must have a joint {max_joint}, which the mesh follows, got "
                f"{len(value.joints)} joints"
            )
    return value


def check_morph_weights(value: Any, mesh: Any) -> Float64 | None:
    """Return weights that fit the targets of a mesh, or None, or raise ``ValueError``."""
    if value is None:
        return None
    if mesh is not None and mesh.morph_targets is None:
        raise ValueError(
            f"weights must be None for a mesh without morph targets, got {check.brief(value)}"
        )
    count = check.unmasked_array("weights", value).size if mesh is None else len(mesh.morph_targets)
    return morph_weights(value, count)


def _check_joints(joints: Any) -> tuple[Any, ...]:
    """Return joints, or raise ``ValueError``."""
    if isinstance(joints, (str, bytes)) or not isinstance(joints, Sequence):
        raise ValueError(f"joints must be a sequence of nodes, got {check.brief(joints)}")
    if not joints:
        raise ValueError("joints must have a node, got none")
    for number, joint in enumerate(joints):
        if not isinstance(joint, WorldObject):
            raise ValueError(f"joints[{number}] must be a Node, got {check.brief(joint)}")
    return tuple(joints)


def _check_inverse_binds(value: ArrayLike, count: int) -> Float64:
    """Return inverse bind matrices, (J, 4, 4), with exact last rows, or raise ``ValueError``."""
    binds = np.array(check.finite_array("inverse_binds", value, (count, 4, 4)))
    is_off = (np.abs(binds[:, 3] - (0.0, 0.0, 0.0, 1.0)) > AFFINE_ROUNDING).any(axis=1)
    if is_off.any():
        number = int(is_off.argmax())
        raise ValueError(
            f"inverse_binds[{number}] must be affine, with the last row 0, 0, 0, 1; got "
            f"{binds[number, 3].tolist()}"
        )
    binds[:, 3] = 0.0, 0.0, 0.0, 1.0
    for number, matrix in enumerate(binds):
        if is_singular(matrix):
            raise ValueError(
                f"inverse_binds[{number}] must have an inverse, got {matrix[:3].tolist()}"
            )
    return binds


def is_singular(matrix: Float64) -> bool:
    """Tell whether an affine matrix, (4, 4), flattens everything."""
    axes = matrix[:3, :3]
    largest = np.abs(axes).max(axis=1, keepdims=True)
    if not (largest > 0.0).all():
        return True
    (a, b, c), (d, e, f), (g, h, i) = (axes / largest).tolist()
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return abs(determinant) < _MIN_DETERMINANT


def _invert_joint_matrices(joints: Sequence[Any]) -> Float64:
    """Return the inverse world matrices of joints, or raise ``ValueError``."""
    inverses = []
    for number, joint in enumerate(joints):
        try:
            inverses.append(inverse(joint._world_from_model))
        except ValueError as error:
            raise ValueError(
                f"joints[{number}] must have a world_matrix with an inverse where inverse_binds is "
                f"None: {error}"
            ) from None
    return check.read_only(np.array(inverses))
