"""Polygons, values and scalars as packages for simulations have them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.skipped import MeshFileError
from rasterjit.io.text.parts import linear_rgba, srgb_bytes
from rasterjit.scene.normals import is_creased, safe_scale

NONE = np.zeros(0, np.int64)


def padded_cells(padded: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Take apart cells that stand one behind the other, each behind the number of its corners.

    Returns
    -------
    corners : (N,) int64
    counts : (C,) int64
        How many of them each cell has.
    """
    cells = np.asarray(padded, np.int64).reshape(-1)
    if not len(cells):
        return NONE, NONE
    width = int(cells[0]) + 1
    if len(cells) % width == 0 and (cells[::width] == cells[0]).all():
        rows = cells.reshape(-1, width)
        return rows[:, 1:].reshape(-1), rows[:, 0].copy()
    begins, at = [], 0
    while at < len(cells):
        begins.append(at)
        at += int(cells[at]) + 1
    inner = np.ones(len(cells), bool)
    inner[begins] = False
    return cells[inner], cells[begins]


def check_corners(corners: NDArray[Any], count: int, source: str) -> None:
    """Raise `MeshFileError` if cells refer to points that are not there."""
    if len(corners) and not 0 <= corners.min() <= corners.max() < count:
        wrong = corners[(corners < 0) | (corners >= count)]
        raise MeshFileError(
            f"{source} must have cells of points from 0 to {count - 1}, got {int(wrong[0])}"
        )


def check_count(cells: str, counts: NDArray[Any], wanted: int, source: str) -> None:
    """Raise `MeshFileError` if cells of a kind have more or fewer points than all of it have."""
    wrong = counts[counts != wanted]
    if len(wrong):
        raise MeshFileError(
            f"{source} must have {wanted} points in each {cells} cell, got {int(wrong[0])}"
        )


def is_colors(values: NDArray[Any]) -> bool:
    """Tell colours in bytes."""
    return values.dtype == np.uint8 and values.ndim == 2 and values.shape[1] in (3, 4)


def is_scalar(values: NDArray[Any]) -> bool:
    """Tell a number for each of something."""
    single = values.ndim == 1 or (values.ndim == 2 and values.shape[1] == 1)
    return single and values.dtype.kind in "buif"


def rgba_of(values: NDArray[Any]) -> NDArray[np.float32]:
    """Return colours, which are sRGB, as linear RGBA."""
    return linear_rgba(srgb_bytes(values), False)


def own_normals(
    points: NDArray[Any], faces: NDArray[np.int64], normals: NDArray[Any] | None
) -> NDArray[Any] | None:
    """Return normals, or None if one is not there, or they are averages that round off edges."""
    if normals is None or not len(faces) or not np.isfinite(normals).all():
        return None
    if not normals.any(axis=1).all() or not np.isfinite(points).all():
        return None
    places = np.asarray(points, np.float64)
    scale = safe_scale(places.min(axis=0), places.max(axis=0))
    return None if is_creased(places, faces.astype(np.int32), scale) else normals


def rows_of(
    values: Mapping[str, NDArray[Any]], rows: NDArray[np.int64] | None
) -> dict[str, NDArray[Any]]:
    """Return some rows, or all, of values by name."""
    return {name: one if rows is None else one[rows] for name, one in values.items()}


def kept_by_name(values: dict[str, NDArray[Any]], shown: str | None) -> dict[str, NDArray[Any]]:
    """Return values by name: those that are shown only where they are finite, as attributes are."""
    return {
        name: one for name, one in values.items() if name != shown or bool(np.isfinite(one).all())
    }
