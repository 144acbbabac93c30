"""
Read what bends the meshes of glTF files: joints with their weights, and morph targets.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), sections 3.7.2.2 and
   3.7.3.3.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.gltf.file import GltfFile
from rasterjit.io.gltf.values import finite_numbers_of, list_of, object_of, shown
from rasterjit.io.skipped import LeftOut, reason_of
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.skin import WEIGHT_ROUNDING, MorphTargets, sum_rows

_BYTE = 5121
"""Draco rounds numbers to eight bits or more, whatever their type."""

_ROUNDING = {5120: 4 / 127, _BYTE: 4 / 255, 5122: 4 / 32767, 5123: 4 / 65535}
"""How far four weights may be from 1 in all as whole numbers, by the types of these: each is
rounded by half a step, or cut off. They are scaled all the same."""

_TARGETS = {"POSITION": "positions", "NORMAL": "normals", "TANGENT": "tangents"}
"""What of a target `MorphTargets` has, by its name in glTF."""


def read_posable(
    file: GltfFile, primitive: dict[str, Any], count: int,
    shown_of: tuple[NDArray[Any] | None, NDArray[Any] | None], label: str, left_out: LeftOut,
) -> dict[str, Any]:  # fmt: skip
    """
    Return what `Mesh` takes of a primitive's joints and targets; nothing where it has none.

    Parameters
    ----------
    file : GltfFile
    primitive : dict
    count : int
        How many vertices there are.
    shown_of : (array or None, array or None)
        The normals and the tangents that the mesh has.
    label : str
        What messages call the mesh.
    left_out : LeftOut
        Notes what cannot be used.
    """
    attributes = object_of(primitive, "attributes")
    found = _joints(file, attributes, count, label, left_out)
    targets = list_of(primitive, "targets")
    if targets:
        morphs = _targets(file, targets, count, shown_of, label, left_out)
        if morphs is not None:
            found["morph_targets"] = morphs
    return found


def _joints(
    file: GltfFile, attributes: dict[str, Any], count: int, label: str, left_out: LeftOut
) -> dict[str, Any]:
    """Return joints and weights, (V, 4 n); empty if there are none of use."""
    # Sets of four joints and weights, JOINTS_0 and WEIGHTS_0 and on.
    joints, weights, rounding = [], [], WEIGHT_ROUNDING
    for number in itertools.count():
        names = f"JOINTS_{number}", f"WEIGHTS_{number}"
        missing = [name for name in names if name not in attributes]
        if len(missing) == 2:
            break
        if missing:
            (given,) = set(names) - set(missing)
            left_out.note(f"{given} of {label}, which has no {missing[0]}")
            continue
        rows = [_rows(file, attributes[name], name, count, 4, label, left_out) for name in names]
        if rows[0] is not None and rows[1] is not None:
            joints.append(rows[0])
            weights.append(rows[1])
            kind = file.entry("accessors", attributes[names[1]])["componentType"]
            if file.is_decoded(attributes[names[1]]):
                kind = _BYTE
            rounding += _ROUNDING.get(kind, 0.0)
    if not joints:
        return {}
    # Weights are at least 0 and add up to 1.
    shares = np.concatenate(weights, axis=1)
    if (shares < 0.0).any():
        left_out.note(f"weights of {label} below 0")
        shares = np.maximum(shares, 0.0)
    numbers, sums = np.concatenate(joints, axis=1), sum_rows(shares)
    is_lost = sums == 0.0
    if is_lost.any():
        left_out.note(
            f"weights of {label} that are all 0, whose vertices follow their first joint",
            int(np.count_nonzero(is_lost)),
        )
        shares[is_lost, 0] = 1.0
    is_off = np.abs(sums - 1.0) > rounding
    if (is_off & ~is_lost).any():
        left_out.note(
            f"sums of weights of {label}, which are not 1: weights are scaled",
            int(np.count_nonzero(is_off & ~is_lost)),
        )
    # Joints are whole numbers.
    is_wrong = (numbers < 0.0) | (numbers != np.floor(numbers))
    if (is_wrong & (shares > 0.0)).any():
        left_out.note(f"JOINTS of {label}, which are no whole numbers from 0")
        return {}
    return {"joints": np.where(is_wrong, 0.0, numbers), "weights": shares}


def _rows(
    file: GltfFile, number: Any, name: str, count: int, width: int, label: str, left_out: LeftOut
) -> NDArray[np.float64] | None:
    """Return finite rows of all vertices; None, with a note, if they are no use."""
    try:
        with np.errstate(invalid="ignore"):
            # A signalling NaN.
            values = file.array(number).astype(np.float64)
    except (ValueError, TypeError, LookupError, OSError) as error:
        left_out.note(f"{name} of {label}, which cannot be read: {reason_of(error)}")
        return None
    if values.shape != (count, width):
        left_out.note(f"{name} of {label}, which does not fit the vertices")
        return None
    if not np.isfinite(values).all():
        left_out.note(f"{name} of {label}, which has NaN or infinity")
        return None
    return values


def _targets(
    file: GltfFile, targets: list[Any], count: int,
    shown_of: tuple[NDArray[Any] | None, NDArray[Any] | None], label: str, left_out: LeftOut,
) -> MorphTargets | None:  # fmt: skip
    """Return the morph targets of a primitive, as many as it says, those of no use as nothing."""
    normals, tangents = shown_of
    is_read = {"POSITION": True, "NORMAL": normals is not None, "TANGENT": tangents is not None}
    found: dict[str, NDArray[Any]] = {}
    for place, target in enumerate(targets):
        if not isinstance(target, dict):
            left_out.note(f"morph target {place} of {label}, which is no object")
            continue
        for name, number in target.items():
            if name not in _TARGETS:
                left_out.note(f"{name[:80]} of morph targets")
                continue
            if not is_read[name]:
                continue
            what = f"{name} of morph target {place}"
            rows = _rows(file, number, what, count, 3, label, left_out)
            if rows is not None:
                if name not in found:
                    found[name] = _nothing(file, len(targets), count, label)
                with np.errstate(over="ignore"):
                    found[name][place] = rows
    if not found:
        found["POSITION"] = _nothing(file, len(targets), count, label)
    fields: dict[str, Any] = {_TARGETS[name]: rows for name, rows in found.items()}
    return MorphTargets(**fields)


def _nothing(file: GltfFile, targets: int, count: int, label: str) -> NDArray[np.float32]:
    """Return displacements of 0, (T, V, 3), that the file's budget has room for."""
    # They are copied when the mesh is made, and when its creases are split.
    file.budget.take(f"the morph targets of {label}", targets * count * 3 * 12)
    return np.zeros((targets, count, 3), np.float32)


def with_morph_weights(
    entry: dict[str, Any], meshes: Sequence[Mesh], label: str, left_out: LeftOut
) -> list[Mesh]:
    """Return meshes of an entry of the file with the weights and the names that it says."""
    if all(mesh.morph_targets is None for mesh in meshes):
        return list(meshes)
    weights: tuple[float, ...] | None = None
    names: tuple[str, ...] = ()
    try:
        if entry.get("weights") is not None:
            given = list_of(entry, "weights")
            weights = finite_numbers_of(entry, "weights", (0.0,) * len(given))
        extras = entry.get("extras")
        if isinstance(extras, dict) and isinstance(extras.get("targetNames"), list):
            names = tuple(map(str, extras["targetNames"]))
    except ValueError as error:
        left_out.note(f"weights of {label}: {reason_of(error)}")
    for mesh in meshes:
        targets = mesh.morph_targets
        if targets is None:
            continue
        fits = weights is None or len(weights) == len(targets)
        if not fits:
            left_out.note(
                f"weights of {label}, which has {len(targets)} morph targets, not "
                f"{shown(len(weights or ()))}"
            )
        mesh._morph_targets = targets.named(
            weights if fits else None, names if len(names) == len(targets) else ()
        )
    return list(meshes)
