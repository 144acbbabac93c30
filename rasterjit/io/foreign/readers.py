"""Files that packages of others read: LAS, cells of simulations, drawings, and all of trimesh's."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from rasterjit.io.dxf import note_entities, read_dxf
from rasterjit.io.foreign.objects import noting_what_vtk_says, things_of_cells, things_of_pyvista
from rasterjit.io.load_warnings import (
    DAMAGED,
    LONGEST_REASON,
    LeftOut,
    MeshFileError,
    as_mesh_file_error,
    reason_of,
)
from rasterjit.io.point_clouds.las import LAS_FORMATS, read_las
from rasterjit.io.primitives import Reading
from rasterjit.io.resources import Resources, extension_of, take_members
from rasterjit.io.text.mesh_builder import Assembly, Thing
from rasterjit.io.text.number_parser import Damage
from rasterjit.io.threemf.package import XML_BYTES
from rasterjit.io.trimesh.resolver import resolver_of, trimesh_told
from rasterjit.io.trimesh.scene import TrimeshAdapter
from rasterjit.io.trimesh.skins import note_what_is_not_read, with_bound_shapes
from rasterjit.scene.mesh import OnInvalid
from rasterjit.scene.transforms import compose

CELL_FORMATS = (
    "vtk", "vtu", "xdmf", "xmf", "msh", "mesh", "meshb", "inp", "bdf", "nas", "fem", "su2", "med",
    "cgns", "exo", "ex2", "e", "avs", "ugrid", "tec", "dat", "vol", "f3grid", "mdpa", "h5m", "hmf",
    "ele", "node", "post", "dato", "wkt", "xml",
)  # fmt: skip
"""Formats that meshio reads."""

VTK_FORMATS = ("vtp", "vti", "vtr", "vts", "vtm")
"""Formats of VTK's that meshio does not read, and PyVista does."""

_BY_PROGRAM = "drc"
"""Format that trimesh reads by a program, where PATH has it: not alike on all machines."""

_WARNING, _UNREAD = "Warning:", "cannot handle"
"""What meshio prints before a warning, and in one about cells that it drops."""

_BYTES = 12
"""What a byte of a file takes, with all that is made of it."""


_XDMF = (".xdmf", ".xmf")


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
            mesh: Any = _read_xdmf(path) if form in _XDMF else meshio.read(path)
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


def _read_xdmf(path: Path) -> Any:
    """Return what meshio reads of an XDMF file; binary numbers that it names lie beside it."""
    from meshio.xdmf.main import XdmfReader

    class Reader(XdmfReader):
        def _read_data_item(self, data_item: Any, root: Any = None) -> Any:
            if data_item.get("Format") == "Binary":
                data_item.text = str(path.absolute().parent / (data_item.text or "").strip())
            return super()._read_data_item(data_item, root)

    return Reader(path).read()


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


_ENCODING_GUESSERS = ("charset_normalizer", "chardet")
"""Modules that trimesh asks for when a file is not the text it should be."""

_NEEDED = {"svg": ("svg.path", "lxml")}
"""Modules without which trimesh takes a format for one that it does not know."""

_XML_FORMATS = ("3dxml", "dae", "svg", "xaml", "zae", "zip", "tar.gz", "tar.bz2", "bz2")
"""Formats that are XML or may hold it, packed or not."""

_OTHER_BYTES = 4
"""What a byte takes of a file that trimesh reads and that is no XML."""

_UPWARDS = np.diag([1.0, -1.0, 1.0, 1.0])
"""Turns a page over, whose y points down."""

_EXPECTED = {
    "3dxml": "a ZIP archive whose Manifest.xml names a Root",
    "xaml": "XML with MeshGeometry3D elements of Positions, Normals and TriangleIndices",
    "dae": "XML with a COLLADA element",
    "zae": "a ZIP archive with a .dae file",
    "svg": "XML with an svg element, whose shapes have all their numbers",
    "zip": "a ZIP archive with files of meshes or drawings",
}
"""What is there in a file of formats whose readers do not say what they look for."""

_SHOWN_FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf", "3mf", "dae", "dxf")

_SHOWN_OWN = ("xyz", "pcd", "las", "vtk")
"""Others that messages name."""


def read_file(
    file: Path, resources: Resources, on_invalid: OnInvalid, on_damage: str, left_out: LeftOut
) -> Sequence[Thing] | Assembly:
    """Return what a file holds, or raise `MeshFileError`; ``on_invalid`` is for curves."""
    extension = extension_of(file)
    with as_mesh_file_error(file, extension):
        if extension in LAS_FORMATS:
            damage = Damage(file, on_damage, left_out)
            clouds = read_las(file, resources, damage, left_out)
            damage.note()
            return clouds
        if extension in VTK_FORMATS:
            return read_vtk(file, resources, left_out)
        if extension in CELL_FORMATS:
            return read_cells(file, resources, left_out)
        if extension == "dxf" and find_spec("ezdxf") is not None:
            return read_dxf(file, resources, left_out)
        return _read_by_trimesh(file, extension, resources, on_invalid, left_out)


def foreign_formats() -> set[str]:
    """Return the extensions that packages of others read, as far as these are installed."""
    by_package = {"laspy": LAS_FORMATS, "meshio": CELL_FORMATS, "pyvista": VTK_FORMATS}
    known = [name for package, names in by_package.items() if find_spec(package) for name in names]
    return {*known, *_trimesh_formats()}


def _trimesh_formats() -> set[str]:
    """Return the extensions that trimesh reads with what is installed."""
    from trimesh.exchange import load as loaders

    found = loaders.available_formats() | set(loaders.voxel_loaders)
    # It has some of meshio's, too, which are read by meshio itself, or have no such extension.
    left_out = {*CELL_FORMATS, _BY_PROGRAM}
    return {name for name in found if name not in left_out and name == _extension(name)}


def _extension(name: str) -> str:
    """Return the extension of a file whose name ends in one, as `extension_of` tells it."""
    return extension_of(Path(f"a.{name}"))


def modules_for(extension: str) -> tuple[str, ...]:
    """Return the modules that a format is read with, as far as they are installed."""
    if extension in LAS_FORMATS:
        return "laspy", "lazrs", "laszip"
    if extension in VTK_FORMATS:
        return ("pyvista",)
    if extension in CELL_FORMATS:
        return "meshio", "h5py", "netCDF4"
    trimesh = "trimesh", "trimesh.path.path", "PIL.Image", "lxml.etree", "collada", "networkx"
    return ("ezdxf.recover", "ezdxf.path", "ezdxf.render") if extension == "dxf" else trimesh


def _read_by_trimesh(
    file: Path, extension: str, resources: Resources, on_invalid: OnInvalid, left_out: LeftOut
) -> Assembly:
    """Return what a file holds that trimesh reads."""
    loaded = _loaded(file, extension, resources, left_out)
    note_what_is_not_read(file, extension, left_out)
    if extension == "dxf":
        note_entities(file, left_out)
    adapter = TrimeshAdapter(Reading(str(file), on_invalid, 0.0, left_out, resources.budget), True)
    found = adapter.assembly(loaded)
    if extension == "svg":
        # Its y points down.
        places = [
            one if one.parent is not None else replace(
                one, transform=compose(_UPWARDS, one.transform)
            )
            for one in found.places
        ]  # fmt: skip
        found = replace(found, places=places)
    return found


def _loaded(file: Path, extension: str, resources: Resources, left_out: LeftOut) -> Any:
    """Read a file with trimesh, and what it names with a resolver, or raise `MeshFileError`."""
    import trimesh

    loaders = trimesh.exchange.load
    known = _trimesh_formats() | set(_NEEDED)
    if extension not in known and (
        extension == _BY_PROGRAM or extension not in loaders.mesh_loaders
    ):
        named = [*(name for name in _SHOWN_FORMATS if name in known), *_SHOWN_OWN]
        shown = ", ".join(f".{name}" for name in named)
        kind = f"the extension .{extension}" if extension else "no extension"
        raise MeshFileError(f"{file} has {kind}; readable formats are {shown} and more")
    factor = XML_BYTES if extension in _XML_FORMATS else _OTHER_BYTES
    resources.budget.take("the file", file.stat().st_size * factor)
    resolver = resolver_of(resources, left_out, extension == "dae")
    try:
        for module in _NEEDED.get(extension, ()):
            import_module(module)
        take_members(file, extension, factor, resources.budget)
        bound = with_bound_shapes(file, left_out) if extension == "dae" else None
        with warnings.catch_warnings(), trimesh_told(left_out):
            warnings.simplefilter("ignore")
            # NumPy only warns of numbers that end at a word that is none; what is behind is lost.
            warnings.filterwarnings("error", ".*could not be read to its end", DeprecationWarning)
            options: dict[str, Any] = {"resolver": resolver, "process": False}
            if bound is not None:
                return trimesh.load_scene(io.BytesIO(bound), file_type=extension, **options)
            if extension == "tar.bz2":
                # As such it unpacks no archive; as the other it tells itself how one is packed.
                options["file_type"] = "tar.gz"
            return trimesh.load_scene(file, **options)
    except ImportError as error:
        if error.name in _ENCODING_GUESSERS:
            # trimesh falls back on guessing the encoding of a text that is none.
            raise MeshFileError(f"{file} could not be read as .{extension}: {DAMAGED}") from error
        raise MeshFileError(
            f"{file}: reading .{extension} needs a package that is not installed ({error}); "
            "pip install 'rasterjit[formats]' brings them"
        ) from error
    except Exception as error:
        expected = f"; expected {_EXPECTED[extension]}" if extension in _EXPECTED else ""
        raise MeshFileError(
            f"{file} could not be read as .{extension}: {reason_of(error)}{expected}"
        ) from error
