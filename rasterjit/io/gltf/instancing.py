"""
Read where the instances of a node stand, as EXT_mesh_gpu_instancing [1]_ says.

References
----------
.. [1] The Khronos Group, "EXT_mesh_gpu_instancing".
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.io.gltf.extensions import INSTANCING
from rasterjit.io.gltf.file import GltfFile
from rasterjit.io.gltf.values import object_of

NODE_BYTES = 4096
"""What a node of a scene takes."""

_WIDTHS = {"TRANSLATION": 3, "ROTATION": 4, "SCALE": 3}


def instances_of(file: GltfFile, node: dict[str, Any]) -> list[dict[str, Any]] | None:
    """
    Return what nodes below a node would say of its instances; None if it has no such.

    Parameters
    ----------
    file : GltfFile
    node : dict
        An entry of the file's nodes.

    Returns
    -------
    list of dict, or None
        Each with ``translation``, ``rotation`` and ``scale``, as far as the file has them.

    Raises
    ------
    ValueError, LookupError
        If the arrays are damaged, or of different lengths.
    """
    extensions = object_of(node, "extensions")
    if INSTANCING not in extensions:
        return None
    numbers = object_of(object_of(extensions, INSTANCING), "attributes")
    rows = {name: file.array(number) for name, number in numbers.items() if name in _WIDTHS}
    counts = {name: len(found) for name, found in rows.items()}
    if len(set(counts.values())) != 1:
        raise ValueError(f"attributes must be of one length, got {counts or 'none'}")
    for name, found in rows.items():
        if found.shape[1] != _WIDTHS[name]:
            raise ValueError(f"{name} must be {_WIDTHS[name]} numbers, got {found.shape[1]}")
    count = next(iter(counts.values()))
    file.budget.take("instances", count * NODE_BYTES)
    listed = {name.lower(): found.astype(np.float64).tolist() for name, found in rows.items()}
    return [{name: found[place] for name, found in listed.items()} for place in range(count)]
