"""Read where the nodes of a glTF file stand below their parents."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.gltf.values import finite_numbers_of, shown
from rasterjit.scene.trs import TRS, matrix_of


def parent_from_node(node: dict[str, Any]) -> NDArray[np.float64]:
    """Return a node's own transform: its matrix, or translation, rotation and scale."""
    if "matrix" in node:
        # glTF writes matrices column by column.
        columns = finite_numbers_of(node, "matrix", (0.0,) * 16)
        return np.array(columns, dtype=np.float64).reshape(4, 4).T
    return matrix_of(trs_of(node))


def trs_of(node: dict[str, Any]) -> TRS:
    """Return a node's translation, rotation and scale."""
    x, y, z, w = finite_numbers_of(node, "rotation", (0.0, 0.0, 0.0, 1.0))
    if ((x * x + y * y) + z * z) + w * w == math.inf:
        raise ValueError(f"rotation must be a unit quaternion, got {shown(node['rotation'])}")
    sx, sy, sz = finite_numbers_of(node, "scale", (1.0, 1.0, 1.0))
    tx, ty, tz = finite_numbers_of(node, "translation", (0.0, 0.0, 0.0))
    return TRS((tx, ty, tz), (x, y, z, w), (sx, sy, sz))
