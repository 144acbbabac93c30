"""What files bring, as a mesh can take it: attributes of one's own, and normals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.resources import LONGEST_NAME
from rasterjit.io.skipped import LeftOut
from rasterjit.scene.mesh import Mesh, value_rows
from rasterjit.scene.warning import MADE_NORMALS, told_elsewhere


def usable_attributes(
    given: Mapping[Any, Any], count: int, left_out: LeftOut
) -> dict[str, NDArray[np.float32]]:
    """
    Return the attributes that are finite numbers.

    Parameters
    ----------
    given : mapping of str to (count, ...) array
        Rows of several axes are laid out in one.
    count : int
        Vertices or faces of the mesh.
    left_out : LeftOut
        Notes the others.

    Returns
    -------
    dict of str to (count, D) float32
    """
    usable = {}
    for name, values in given.items():
        said, array = f"attribute {str(name)[:LONGEST_NAME]!r}", np.asarray(values)
        is_numbers = array.dtype.kind in "buif" and array.shape[:1] == (count,) and array.size > 0
        if not (is_numbers and isinstance(name, str) and name):
            left_out.note(f"{said}, which is not a number for each vertex or face")
            continue
        rows = array.reshape(count, -1)
        try:
            usable[name] = value_rows(said, rows.astype(np.uint8) if rows.dtype == bool else rows)
        except ValueError:
            left_out.note(f"{said} with NaN, infinity or what no float32 holds")
    return usable


def mesh_of(label: str, left_out: LeftOut, **arrays: Any) -> Mesh:
    """Return the mesh of what `Mesh` takes, and note how many of its normals had to be made."""
    with told_elsewhere(MADE_NORMALS):
        mesh = Mesh(**arrays)
    if mesh._repaired_normals:
        left_out.note(f"normals of length 0 of {label}: made from faces", mesh._repaired_normals)
    return mesh
