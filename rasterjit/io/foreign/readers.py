"""Read files by other packages: laspy, meshio, PyVista, ezdxf, yourdfpy and trimesh."""

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

from rasterjit.io.dxf import note_unread_entities, read_dxf
from rasterjit.io.foreign.objects import convert_meshio, convert_pyvista, note_vtk_messages
from rasterjit.io.load_warnings import (
    DAMAGED,
    MAX_REASON_LENGTH,
    LeftOut,
    MeshFileError,
    make_missing_package_error,
    raise_mesh_file_error,
    reason_of,
)
from rasterjit.io.point_clouds.las import LAS_FORMATS, read_las
from rasterjit.io.primitives import Context
from rasterjit.io.resources import Resources, extension_of, take_members
from rasterjit.io.text.mesh_builder import Geometry, SceneRecord
from rasterjit.io.text.number_parser import Damage
from rasterjit.io.threemf.package import MEMORY_PER_XML_BYTE
from rasterjit.io.trimesh.resolver import make_resolver, note_trimesh_warnings
from rasterjit.io.trimesh.scene import TrimeshAdapter
from rasterjit.io.trimesh.skins import (
    bake_controllers,
    note_unread_elements,
    unbind_broken_materials,
)
from rasterjit.io.urdf import RobotRecord, read_urdf
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

_EXTERNAL_PROGRAM_FORMAT = "drc"
"""Format that trimesh reads by an external program, which not all machines have: not read."""

_WARNING, _DROPPED_CELLS = "Warning:", "cannot handle"
"""Prefix of meshio's printed warnings, and part of one about cells that it drops."""

_MEMORY_PER_FILE_BYTE = 12
"""Bytes of memory for a byte of a file and the arrays made of it."""

_XDMF_SUFFIXES = (".xdmf", ".xmf")


def read_cells(path: Path, resources: Resources, left_out: LeftOut) -> list[Geometry]:
    """
    Return the geometries of a file of `CELL_FORMATS`, or raise `MeshFileError`.

    meshio reads unstructured grids alone of ``.vtk`` files, and of these and ``.vtu`` files neither
    strips nor some other cells; where PyVista is installed, it reads what meshio does not.
    """
    suffix = path.suffix.lower()
    is_vtk = suffix in (".vtk", ".vtu")
    can_use_pyvista = is_vtk and find_spec("pyvista") is not None
    resources.budget.take("the file", path.stat().st_size * _MEMORY_PER_FILE_BYTE)
    try:
        import meshio
    except ImportError as error:
        if can_use_pyvista:
            return _read_by_pyvista(path, left_out)
        raise make_missing_package_error(path, suffix[1:], error, "'rasterjit[vtk]'") from error
    output = io.StringIO()
    try:
        # meshio prints why it cannot read a file, and exits.
        with (
            contextlib.redirect_stdout(output),
            contextlib.redirect_stderr(output),
            warnings.catch_warnings(record=True) as caught,
        ):
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", UserWarning)
            mesh: Any = _read_xdmf(path) if suffix in _XDMF_SUFFIXES else meshio.read(path)
    except MemoryError:
        # VTK, which would need as much, ends the process.
        raise
    except (Exception, SystemExit) as error:
        if can_use_pyvista:
            return _read_by_pyvista(path, left_out)
        if isinstance(error, ImportError):
            raise make_missing_package_error(path, suffix[1:], error, "'meshio[all]'") from error
        text = output.getvalue() if isinstance(error, SystemExit) else reason_of(error)
        reason = " ".join(text.split())[:MAX_REASON_LENGTH] or DAMAGED
        remedy = "; PyVista may read it: pip install pyvista" if is_vtk else ""
        raise MeshFileError(f"{path} could not be read as {suffix}: {reason}{remedy}") from error
    if can_use_pyvista and _DROPPED_CELLS in " ".join(output.getvalue().split()):
        return _read_by_pyvista(path, left_out)
    messages = [*output.getvalue().split(_WARNING)[1:], *(str(one.message) for one in caught)]
    for text in messages:
        left_out.note(f"what meshio says: {' '.join(text.split())[:MAX_REASON_LENGTH]}")
    return convert_meshio(mesh, str(path), left_out)


def _read_xdmf(path: Path) -> Any:
    """Return the mesh of an XDMF file by meshio; its binary files lie beside it."""
    from meshio.xdmf.main import XdmfReader

    class Reader(XdmfReader):
        def _read_data_item(self, data_item: Any, root: Any = None) -> Any:
            if data_item.get("Format") == "Binary":
                data_item.text = str(path.absolute().parent / (data_item.text or "").strip())
            return super()._read_data_item(data_item, root)

    return Reader(path).read()


def read_vtk(path: Path, resources: Resources, left_out: LeftOut) -> list[Geometry]:
    """Return the geometries of a file of `VTK_FORMATS`, or raise `MeshFileError`."""
    resources.budget.take("the file", path.stat().st_size * _MEMORY_PER_FILE_BYTE)
    if find_spec("pyvista") is None:
        reason = "pyvista, for meshio does not read it"
        raise make_missing_package_error(path, path.suffix.lower()[1:], reason, "pyvista")
    return _read_by_pyvista(path, left_out)


def _read_by_pyvista(path: Path, left_out: LeftOut) -> list[Geometry]:
    """Return the geometries of a file by PyVista, or raise `MeshFileError`."""
    import pyvista

    messages = LeftOut()
    try:
        # VTK also prints what is wrong with a file.
        with note_vtk_messages(messages), contextlib.redirect_stderr(io.StringIO()):
            dataset = pyvista.read(path)
    except Exception as error:
        raise MeshFileError(
            f"{path} could not be read as {path.suffix.lower()}: {reason_of(error)}"
        ) from error
    left_out.extend(messages.entries())
    try:
        return convert_pyvista(dataset, str(path), left_out)
    except MeshFileError as error:
        if not str(messages):
            raise
        problem = str(error).removeprefix(f"{path} ")
        raise MeshFileError(
            f"{path} could not be read as {path.suffix.lower()}: it {problem}; {messages}"
        ) from error


_ENCODING_GUESSERS = ("charset_normalizer", "chardet")
"""Modules that trimesh imports when a text file is not UTF-8."""

_REQUIRED_MODULES = {"svg": ("svg.path", "lxml")}
"""Modules that a format needs, and without which trimesh does not list it."""

_XML_FORMATS = ("3dxml", "dae", "svg", "xaml", "zae", "zip", "tar.gz", "tar.bz2", "bz2")
"""Formats that are or may contain XML."""

_MEMORY_PER_BINARY_BYTE = 4
"""Bytes of memory for a byte of a file that trimesh reads and that is no XML."""

_FLIP_Y = np.diag([1.0, -1.0, 1.0, 1.0])
"""Mirrors y, which points down on an SVG page."""

_EXPECTED_CONTENT = {
    "3dxml": "a ZIP archive whose Manifest.xml names a Root",
    "xaml": "XML with MeshGeometry3D elements of Positions, Normals and TriangleIndices",
    "dae": "XML with a COLLADA element",
    "zae": "a ZIP archive with a .dae file",
    "svg": "XML with an svg element, whose shapes have all their numbers",
    "zip": "a ZIP archive with files of meshes or drawings",
}
"""Expected content, for messages, of formats whose readers do not describe it."""

_LISTED_FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf", "3mf", "dae", "dxf")

_LISTED_POINT_FORMATS = ("xyz", "pcd", "las", "vtk")
"""Further formats that messages list."""


def read_file(
    file: Path, resources: Resources, on_invalid: OnInvalid, on_damage: str, left_out: LeftOut
) -> Sequence[Geometry] | SceneRecord | RobotRecord:
    """Read a file by the package for its format, or raise `MeshFileError`."""
    extension = extension_of(file)
    with raise_mesh_file_error(file, extension):
        if extension in LAS_FORMATS:
            damage = Damage(file, on_damage, left_out)
            clouds = read_las(file, resources, damage, left_out)
            damage.add_to_left_out()
            return clouds
        if extension == "urdf":
            return read_urdf(file, resources, left_out)
        if extension in VTK_FORMATS:
            return read_vtk(file, resources, left_out)
        if extension in CELL_FORMATS:
            return read_cells(file, resources, left_out)
        if extension == "dxf" and find_spec("ezdxf") is not None:
            return read_dxf(file, resources, left_out)
        return _read_by_trimesh(file, extension, resources, on_invalid, left_out)


def list_foreign_formats() -> set[str]:
    """Return the extensions that the installed other packages read."""
    by_package = {
        "laspy": LAS_FORMATS, "meshio": CELL_FORMATS, "pyvista": VTK_FORMATS, "yourdfpy": ("urdf",),
    }  # fmt: skip
    known = [name for package, names in by_package.items() if find_spec(package) for name in names]
    return {*known, *_list_trimesh_formats()}


def _list_trimesh_formats() -> set[str]:
    """Return the extensions that trimesh reads with the packages that are installed."""
    from trimesh.exchange import load as loaders

    formats = loaders.available_formats() | set(loaders.voxel_loaders)
    # trimesh also lists formats of meshio, which are read by meshio itself, and some names that
    # are no extensions.
    formats -= {*CELL_FORMATS, _EXTERNAL_PROGRAM_FORMAT}
    return {name for name in formats if name == extension_of(Path(f"a.{name}"))}


def list_reader_modules(extension: str) -> tuple[str, ...]:
    """Return the names of the modules that read a format."""
    if extension in LAS_FORMATS:
        return "laspy", "lazrs", "laszip"
    if extension == "urdf":
        return "yourdfpy", "lxml.etree"
    if extension in VTK_FORMATS:
        return ("pyvista",)
    if extension in CELL_FORMATS:
        return "meshio", "h5py", "netCDF4"
    if extension == "dxf":
        return "ezdxf.recover", "ezdxf.path", "ezdxf.render"
    return "trimesh", "trimesh.path.path", "PIL.Image", "lxml.etree", "collada", "networkx"


def _read_by_trimesh(
    file: Path, extension: str, resources: Resources, on_invalid: OnInvalid, left_out: LeftOut
) -> SceneRecord:
    """Return the scene of a file that trimesh reads."""
    loaded = _load_by_trimesh(file, extension, resources, left_out)
    note_unread_elements(file, extension, left_out)
    if extension == "dxf":
        note_unread_entities(file, left_out)
    adapter = TrimeshAdapter(Context(str(file), on_invalid, 0.0, left_out, resources.budget), True)
    record = adapter.scene_record(loaded)
    if extension == "svg":
        for number, node in enumerate(record.nodes):
            if node.parent is None:
                flipped = compose(_FLIP_Y, node.transform)
                record.nodes[number] = replace(node, transform=flipped)
    return record


def _load_by_trimesh(file: Path, extension: str, resources: Resources, left_out: LeftOut) -> Any:
    """Read a file, and the files it refers to, with trimesh, or raise `MeshFileError`."""
    import trimesh

    loaders = trimesh.exchange.load
    formats = _list_trimesh_formats() | set(_REQUIRED_MODULES)
    if extension not in formats and (
        extension == _EXTERNAL_PROGRAM_FORMAT or extension not in loaders.mesh_loaders
    ):
        listed = [*(name for name in _LISTED_FORMATS if name in formats), *_LISTED_POINT_FORMATS]
        listing = ", ".join(f".{name}" for name in listed)
        kind = f"the extension .{extension}" if extension else "no extension"
        raise MeshFileError(f"{file} has {kind}; readable formats are {listing} and more")
    is_xml = extension in _XML_FORMATS
    memory_per_byte = MEMORY_PER_XML_BYTE if is_xml else _MEMORY_PER_BINARY_BYTE
    resources.budget.take("the file", file.stat().st_size * memory_per_byte)
    try:
        for module in _REQUIRED_MODULES.get(extension, ()):
            import_module(module)
        take_members(file, extension, memory_per_byte, resources.budget)
        if extension != "dae":
            return _load_content(file, None, extension, resources, left_out)
        baked, notes = bake_controllers(file, left_out), LeftOut()
        loaded = _load_content(file, baked, extension, resources, notes)
        content = file.read_bytes() if baked is None else baked
        unbound = unbind_broken_materials(content, loaded.geometry, left_out)
        if unbound is not None:
            notes = LeftOut()
            loaded = _load_content(file, unbound, extension, resources, notes)
        left_out.extend(notes.entries())
        return loaded
    except ImportError as error:
        if error.name in _ENCODING_GUESSERS:
            # trimesh tries to guess the encoding of a file that is no text.
            raise MeshFileError(f"{file} could not be read as .{extension}: {DAMAGED}") from error
        raise make_missing_package_error(file, extension, error, "'rasterjit[formats]'") from error
    except Exception as error:
        expected = _EXPECTED_CONTENT.get(extension)
        hint = f"; expected {expected}" if expected else ""
        raise MeshFileError(
            f"{file} could not be read as .{extension}: {reason_of(error)}{hint}"
        ) from error


def _load_content(
    file: Path, content: bytes | None, extension: str, resources: Resources, left_out: LeftOut
) -> Any:
    """Return the trimesh scene of a file, or of what stands in its place."""
    import trimesh

    with warnings.catch_warnings(), note_trimesh_warnings(left_out):
        warnings.simplefilter("ignore")
        # NumPy only warns of a word that is no number, and drops all behind it.
        warnings.filterwarnings("error", ".*could not be read to its end", DeprecationWarning)
        resolver = make_resolver(resources, left_out, extension == "dae")
        options: dict[str, Any] = {"resolver": resolver, "process": False}
        if content is not None:
            return trimesh.load_scene(io.BytesIO(content), file_type=extension, **options)
        if extension == "tar.bz2":
            # trimesh does not unpack .tar.bz2, but finds the compression of .tar.gz itself.
            options["file_type"] = "tar.gz"
        return trimesh.load_scene(file, **options)
