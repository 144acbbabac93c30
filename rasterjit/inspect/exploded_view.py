"""Exploded views: move the parts of a scene apart."""

from __future__ import annotations

import math
from typing import Any

from rasterjit.io.meshes import as_scene
from rasterjit.scene import validation as check
from rasterjit.scene.scene import Scene
from rasterjit.scene.transforms import transform_points
from rasterjit.scene.validation import VectorLike
from rasterjit.scene.vectors import dot, unit
from rasterjit.scene.warning import warn_caller
from rasterjit.survey.deformation import pose_scene
from rasterjit.survey.object_transforms import compute_mesh_boxes

ROUNDING = 1e-12
"""Largest move of a part that counts as none, relative to its coordinates."""


def explode(
    scene: Any, factor: float, *, axis: VectorLike | None = None, center: VectorLike | None = None
) -> Scene:
    """
    Return a copy of a scene with its parts moved apart, as in drawings of assemblies.

    Each object moves away from a centre, along the line to the middle of its own box, until that is
    ``factor`` times as far away: the box of its vertices, turned as the object is. Objects are not
    scaled or turned, and keep their numbers; what hangs below one and has no mesh, such as labels,
    moves with it. Skins and morph targets are applied. Meshes are those of the scene, which itself
    stays as it is.

    Parameters
    ----------
    scene : Scene, Mesh or anything else that `rasterjit.render` takes
    factor : float
        1 leaves all as it is, 2 moves the parts twice as far apart, 0 puts all on the centre.
    axis : (3,) array_like, optional
        Move along this direction only, world space, of any length but 0: that of a shaft.
    center : (3,) array_like, optional
        World space. Default: the middle of the scene's box, `Scene.bounds`.

    Returns
    -------
    Scene
        With nodes of its own. Parts whose boxes have the centre as their middle stay where they
        are, such as nested shells; a warning says if all do.

    Raises
    ------
    ValueError
        If ``factor`` is not a finite number from 0 on, ``axis`` or ``center`` is not three finite
        numbers, ``axis`` is zero, or ``scene`` holds nothing with a size.

    Examples
    --------
    >>> import rasterjit as rj, trimesh
    >>> scene = rj.Scene()
    >>> for x in (-1.0, 0.0, 1.0):
    ...     node = scene.add(trimesh.creation.box(), rj.transforms.translate((x, 0.0, 0.0)))
    >>> [float(node.world_matrix[0, 3]) for node in rj.explode(scene, 2.5).nodes]
    [-2.5, 0.0, 2.5]
    """
    amount = check.finite_number("factor", factor)
    if amount < 0.0:
        raise ValueError(f"factor must be at least 0, got {factor!r}")
    direction = None if axis is None else check.triple("axis", axis)
    if direction is not None and not any(direction):
        raise ValueError(f"axis must not be zero, got {direction}")
    given_center = None if center is None else check.triple("center", center)
    posed = pose_scene(as_scene(scene, "scene"))
    if given_center is None:
        low, high = posed.bounds()
        given_center = tuple((low / 2.0 + high / 2.0).tolist())
    result = posed._copy_with_values({})
    # Where each part stands now, before those above it move.
    matrices = {id(node): node.world_from_model.copy() for node in result.nodes}
    has_moved = amount == 1.0
    for node in result.every_node():
        matrix = matrices.get(id(node))
        if matrix is not None:
            low, high = compute_mesh_boxes([node.mesh])[0]
            middle = transform_points(matrix, [low / 2.0 + high / 2.0])[0, :3].tolist()
            offset = [a - b for a, b in zip(middle, given_center, strict=True)]
            move = _find_move(offset, amount - 1.0, direction)
            matrix[:3, 3] += move
            node.world_from_model = matrix
            reach = max(map(abs, [*middle, *given_center]))
            has_moved |= max(map(abs, move)) > ROUNDING * reach
    if not has_moved:
        warn_caller(
            "explode moved nothing: the boxes of all parts have their middle on the centre; give "
            "center= or another axis="
        )
    return result


def _find_move(
    offset: list[float], amount: float, direction: tuple[float, float, float] | None
) -> list[float]:
    """Return how far a part moves, (3,); not at all where it has no finite box."""
    if not all(map(math.isfinite, offset)):
        return [0.0, 0.0, 0.0]
    if direction is not None:
        axis = unit(direction)
        along = dot(axis, offset)
        offset = [along * part for part in axis]
    return [amount * part for part in offset]
