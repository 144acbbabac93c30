"""Tell objects of PyVista, Open3D and meshio without importing these packages."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from rasterjit.io.foreign.cells import things_of_cells
from rasterjit.io.foreign.open3d import things_of_open3d
from rasterjit.io.foreign.pyvista import things_of_pyvista
from rasterjit.io.skipped import LeftOut
from rasterjit.io.text.parts import Thing, scene_of_parts
from rasterjit.scene.memory import MemoryBudget
from rasterjit.scene.mesh import OnInvalid
from rasterjit.scene.scene import Scene

_READERS: dict[str, Callable[[Any, str, LeftOut], list[Thing]]] = {
    "pyvista": things_of_pyvista,
    "open3d": things_of_open3d,
    "meshio": things_of_cells,
}
"""What reads the objects of a package."""


def foreign_package(what: Any) -> str | None:
    """Return the package that an object is of: one of PyVista's, Open3D's, meshio's, or None."""
    for kind in type(what).__mro__:
        package = kind.__module__.partition(".")[0]
        if package in _READERS:
            return package
    return None


def foreign_name(what: Any) -> str:
    """Return what messages call an object of another package, such as ``pyvista PolyData``."""
    return f"{foreign_package(what)} {type(what).__name__}"


def scene_of_foreign(
    what: Any, on_invalid: OnInvalid, crease_angle: float, left_out: LeftOut
) -> Scene:
    """
    Return a scene of what an object of another package holds, or raise `MeshFileError`.

    Its arrays are read where they are; each is copied once, into the mesh that owns it.
    """
    source = foreign_name(what)
    things = _READERS[str(foreign_package(what))](what, source, left_out)
    # What is in memory already has been paid for.
    budget = MemoryBudget(source, sys.maxsize)
    return scene_of_parts(things, source, on_invalid, crease_angle, left_out, budget)
