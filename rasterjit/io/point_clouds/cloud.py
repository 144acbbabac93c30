"""What readers find of a point cloud, and the `Points` that it becomes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.attributes import usable_attributes
from rasterjit.io.resources import LONGEST_NAME
from rasterjit.io.skipped import LeftOut, MeshFileError
from rasterjit.scene.material import Material
from rasterjit.scene.memory import MemoryBudget
from rasterjit.scene.mesh import OnInvalid
from rasterjit.scene.points import Points

INTENSITY = "intensity"
"""The attribute that shows a cloud without colours."""

USUAL_SIZE, _LARGEST_SIZE = 3.0, 12.0
"""Pixels of a point of a cloud, and of one of a few points."""

_SPREAD_CUBED = 26.0 * 26.0 * 26.0
"""Pixels of a lone point, but for the largest size; sizes shrink as distances between them do."""

_PIXELS = 1e6
"""How many pixels the points of a large cloud cover, as squares side by side."""

_POINT_BYTES, _VALUE_BYTES = 160, 12
"""What a point takes besides its attributes, and what a value of these does."""

NOT_MEASURED = "point without a position (NaN)"
INFINITE = "point at infinity"


@dataclass(frozen=True)
class Cloud:
    """
    A point cloud as a file has it.

    Parameters
    ----------
    name : str
        Of its node.
    positions : (N, 3) float
        NaN where nothing was measured.
    colors : (N, 4) float32, optional
        Linear RGBA.
    normals : (N, 3) float, optional
    attributes : dict of str to (N,) or (N, D) array
        Values of one's own.
    material : Material, optional
    scalars : (N,) array, optional
        In the place of colours.
    """

    name: str
    positions: NDArray[Any]
    colors: NDArray[np.float32] | None = None
    normals: NDArray[Any] | None = None
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    material: Material | None = None
    scalars: NDArray[Any] | None = None


def default_size(count: int) -> float:
    """
    Return the size in pixels of the points of a cloud of so many.

    3, of large ones down to 1, of those of fewer than four hundred up to 12.
    """
    large = min(USUAL_SIZE, max(1.0, float(round(math.sqrt(_PIXELS / count)))))
    # The largest whole size whose cube, times the points, does not pass that of the spread.
    size = _LARGEST_SIZE
    while size > large and (size - 0.5) * (size - 0.5) * (size - 0.5) * count > _SPREAD_CUBED:
        size -= 1.0
    return max(large, size)


def points_of(
    cloud: Cloud,
    source: str,
    on_invalid: OnInvalid,
    left_out: LeftOut,
    budget: MemoryBudget | None = None,
) -> Points:
    """
    Return a cloud as `Points`, or raise `MeshFileError`, naming ``source``.

    All points keep their numbers; those that are NaN are there, but not drawn, and are noted. So
    are infinite ones if ``on_invalid`` is ``"drop"``. Clouds without colours and normals are shown
    by their intensity, if they have one.
    """
    name = cloud.name[:LONGEST_NAME]
    positions, count = cloud.positions, len(cloud.positions)
    if budget is not None:
        values = sum(one.size for one in cloud.attributes.values())
        budget.take(f"the points of {name!r}", _POINT_BYTES * count + _VALUE_BYTES * values)
    if not count:
        raise MeshFileError(f"{source} holds a point cloud of no points")
    sound = np.isfinite(positions).all(axis=1)
    if not sound.any():
        raise MeshFileError(
            f"{source} holds a point cloud of {count} points, none of which has a finite position"
        )
    attributes, normals = cloud.attributes, cloud.normals
    if not sound.all():
        infinite = int(np.count_nonzero(np.isinf(positions).any(axis=1)))
        if infinite and on_invalid == "raise":
            raise MeshFileError(
                f"{source}: points {name!r}: positions must be finite, or NaN where nothing was "
                f"measured, got {infinite} of {count} at infinity; on_invalid='drop' leaves them "
                "out"
            )
        for what, number in (
            (NOT_MEASURED, count - int(np.count_nonzero(sound)) - infinite), (INFINITE, infinite),
        ):  # fmt: skip
            if number:
                left_out.note(what, number)
        # What was measured nowhere has no values either.
        attributes = {key: _held(values, sound) for key, values in attributes.items()}
        normals = None if normals is None else _held(normals, sound)
    usable = usable_attributes(attributes, count, left_out)
    normals = _usable_normals(normals, left_out)
    scalars = cloud.scalars if cloud.colors is None else None
    if scalars is None and cloud.colors is None and normals is None and cloud.material is None:
        scalars = _shown_intensity(usable)
    try:
        return Points(
            positions, colors=cloud.colors, normals=normals,
            attributes=usable, size=default_size(count), scalars=scalars, material=cloud.material,
            on_invalid="drop",
        )  # fmt: skip
    except ValueError as error:
        raise MeshFileError(f"{source}: points {name!r}: {error}") from error


def _held(values: NDArray[Any], rows: NDArray[np.bool_]) -> NDArray[Any]:
    """Return values that are zero beside some rows; values that fit no rows as they are."""
    if len(values) != len(rows) or values.dtype.kind != "f":
        return values
    held = np.array(values)
    held[~rows] = 0
    return held


def _usable_normals(values: NDArray[Any] | None, left_out: LeftOut) -> NDArray[Any] | None:
    """Return normals, zero, with a note, where one is not finite; None if all are zero."""
    if values is None:
        return None
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        left_out.note("normals with NaN or infinity")
        values = np.where(finite[:, np.newaxis], values, 0.0)
    return values if values.any() else None


def _shown_intensity(attributes: dict[str, NDArray[np.float32]]) -> NDArray[np.float32] | None:
    """Return the intensity of points, (N,), if it is one number that differs between them."""
    values = next((rows for key, rows in attributes.items() if key.lower() == INTENSITY), None)
    if values is None or values.shape[1] != 1 or values.min() == values.max():
        return None
    return values[:, 0]
