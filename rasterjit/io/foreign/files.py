"""Files of simulations, which meshio and PyVista read."""

from __future__ import annotations

import contextlib
import io
import warnings
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rasterjit.io.foreign.cells import things_of_cells
from rasterjit.io.foreign.pyvista import noting_what_vtk_says, things_of_pyvista
from rasterjit.io.resources import Resources
from rasterjit.io.skipped import LONGEST_REASON, LeftOut, MeshFileError, reason_of
from rasterjit.io.text.parts import Thing

CELL_FORMATS = (
    "vtk", "vtu", "xdmf", "xmf", "msh", "mesh", "meshb", "inp", "bdf", "nas", "fem", "su2", "med",
    "cgns", "exo", "ex2", "e", "avs", "ugrid", "tec", "dat", "vol", "f3grid", "mdpa", "h5m", "hmf",
    "ele", "node", "post", "dato", "wkt", "xml",
)  # fmt: skip
"""Formats that meshio reads."""

VTK_FORMATS = ("vtp", "vti", "vtr", "vts", "vtm")
"""Formats of VTK's that meshio does not read, and PyVista does."""

_WARNING, _UNREAD = "Warning:", "cannot handle"
"""What meshio prints before a warning, and in one about cells that it drops."""

_BYTES = 12
"""What a byte of a file takes, with all that is made of it."""


def read_cells(path: Path, resources: Resources, left_out: LeftOut) -> list[Thing]:
    """
    Return what a file of `CELL_FORMATS` holds, or raise `MeshFileError`.

    meshio reads unstructured grids alone of ``.vtk`` files, and of these and ``.vtu`` files neither
    strips nor some other cells; where PyVista is installed, it reads what meshio does not.
    """
    form = path.suffix.lower()
    is_vtk = form in (".vtk", ".vtu")
    resources.budget.take("the file", path.stat().st_size * _BYTES)
    try:
        import meshio
    except ImportError as error:
        if is_vtk and find_spec("pyvista") is not None:
            return _by_pyvista(path, left_out)
        raise MeshFileError(
            f"{path}: reading {form} needs a package that is not installed ({error}); "
            "pip install 'rasterjit[vtk]' brings it"
        ) from error
    said = io.StringIO()
    try:
        # It says why it cannot read a file, and ends the program.
        with (
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
            warnings.catch_warnings(record=True) as told,
        ):
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", UserWarning)
            mesh: Any = meshio.read(path)
    except MemoryError:
        # VTK, which would need as much, ends the process.
        raise
    except (Exception, SystemExit) as error:
        if is_vtk and find_spec("pyvista") is not None:
            return _by_pyvista(path, left_out)
        if isinstance(error, ImportError):
            raise MeshFileError(
                f"{path}: reading {form} needs a package that is not installed ({error}); "
                "pip install 'meshio[all]' brings it"
            ) from error
        text = said.getvalue() if isinstance(error, SystemExit) else reason_of(error)
        reason = " ".join(text.split())[:200] or "it is damaged or something else"
        has_other = is_vtk and find_spec("pyvista") is None
        other = "; PyVista may read it: pip install pyvista" if has_other else ""
        raise MeshFileError(f"{path} could not be read as {form}: {reason}{other}") from error
    if _UNREAD in " ".join(said.getvalue().split()) and is_vtk and find_spec("pyvista") is not None:
        return _by_pyvista(path, left_out)
    for text in [*said.getvalue().split(_WARNING)[1:], *(str(one.message) for one in told)]:
        left_out.note(f"what meshio says: {' '.join(text.split())[:LONGEST_REASON]}")
    return things_of_cells(mesh, str(path), left_out)


def read_vtk(path: Path, resources: Resources, left_out: LeftOut) -> list[Thing]:
    """Return what a file of `VTK_FORMATS` holds, or raise `MeshFileError`."""
    resources.budget.take("the file", path.stat().st_size * _BYTES)
    if find_spec("pyvista") is None:
        raise MeshFileError(
            f"{path}: reading {path.suffix.lower()} needs a package that is not installed "
            "(pyvista, for meshio does not read it); pip install pyvista brings it"
        )
    return _by_pyvista(path, left_out)


def _by_pyvista(path: Path, left_out: LeftOut) -> list[Thing]:
    """Return what a file holds that PyVista reads, or raise `MeshFileError`."""
    import pyvista

    said = LeftOut()
    try:
        # PyVista prints, too, what is wrong with a file.
        with noting_what_vtk_says(said), contextlib.redirect_stderr(io.StringIO()):
            found = pyvista.read(path)
    except Exception as error:
        raise MeshFileError(
            f"{path} could not be read as {path.suffix.lower()}: {reason_of(error)}"
        ) from error
    left_out.add_all(said.all())
    try:
        return things_of_pyvista(found, str(path), left_out)
    except MeshFileError as error:
        if not str(said):
            raise
        lack = str(error).removeprefix(f"{path} ")
        raise MeshFileError(
            f"{path} could not be read as {path.suffix.lower()}: it {lack}; {said}"
        ) from error
