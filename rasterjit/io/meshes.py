"""Files, objects of other packages and meshes become scenes; packages are imported when needed."""

from __future__ import annotations

import io
import os
import re
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np

from rasterjit.io.archives import take_members
from rasterjit.io.binvox import load_binvox
from rasterjit.io.dxf import note_entities, read_dxf
from rasterjit.io.foreign.files import CELL_FORMATS, VTK_FORMATS, read_cells, read_vtk
from rasterjit.io.foreign.objects import foreign_name, foreign_package, scene_of_foreign
from rasterjit.io.gltf.scene import GLTF_FORMATS, load_gltf
from rasterjit.io.kinds import other_kind
from rasterjit.io.point_clouds.las import LAS_FORMATS, read_las
from rasterjit.io.point_clouds.pcd import read_pcd
from rasterjit.io.resources import Resources
from rasterjit.io.skipped import LeftOut, LoadWarning, MeshFileError, reason_of
from rasterjit.io.text.lines import Damage
from rasterjit.io.text.obj import read_obj
from rasterjit.io.text.off import read_off
from rasterjit.io.text.parts import Thing, scene_of_parts
from rasterjit.io.text.ply import read_ply
from rasterjit.io.text.stl import read_stl
from rasterjit.io.text.xyz import ROW_FORMATS, read_rows
from rasterjit.io.threemf.package import XML_BYTES
from rasterjit.io.threemf.scene import load_3mf
from rasterjit.io.trimesh.resolver import resolver_of
from rasterjit.io.trimesh.scene import TrimeshAdapter
from rasterjit.io.trimesh.skins import with_bound_shapes
from rasterjit.io.trimesh.told import trimesh_told
from rasterjit.io.trimesh.xml import note_what_is_not_read
from rasterjit.scene.memory import DEFAULT_MAX_BYTES, MemoryBudget
from rasterjit.scene.mesh import ON_INVALID, Mesh, OnInvalid
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
from rasterjit.scene.transforms import compose
from rasterjit.scene.validation import (
    bounded_number,
    existing_file,
    existing_folder,
    one_of,
)
from rasterjit.scene.warning import warn_caller

if TYPE_CHECKING:
    import trimesh

__all__ = ["LoadWarning", "MeshFileError", "as_scene", "from_trimesh", "load", "scene_to_add"]

OnDamage: TypeAlias = Literal["error", "warn"]
ON_DAMAGE: tuple[OnDamage, ...] = get_args(OnDamage)
"""What to do about a damaged file: refuse it; load what there is, and warn."""

OWN_FORMATS = ("obj", "ply", "stl", "off", "pcd", *LAS_FORMATS, *ROW_FORMATS)
"""Formats that `rasterjit.io.text` and `rasterjit.io.point_clouds` read."""

PART_FORMATS = (*OWN_FORMATS, *VTK_FORMATS, *CELL_FORMATS)
"""Those, and the ones that `rasterjit.io.foreign` reads."""

FORMATS_EXTRA = ("lxml", "networkx", "collada", "svg", "ezdxf")
"""Modules that the extra ``rasterjit[formats]`` brings."""

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

_Z_UP = ("3mf", *LAS_FORMATS)
"""Formats by whose definition z is up."""

_UP_AXIS = re.compile(rb"<up_axis>\s*([XYZ])_UP\s*</up_axis>")
"""What a COLLADA file says, near its beginning."""

_HEAD = 1 << 16
"""Bytes of a COLLADA file that are looked through for it."""

_CREASE_ANGLE = 40.0
"""Degrees between faces that an edge is seen from, of meshes without normals."""

_SHOWN_FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf", "3mf", "dae", "dxf")

_SHOWN_OWN = ("xyz", "pcd", "las", "vtk")
"""Others that messages name."""


def load(
    path: str | os.PathLike[str] | trimesh.Trimesh | trimesh.Scene | Any,
    *,
    on_invalid: OnInvalid = "raise",
    on_damage: OnDamage = "error",
    crease_angle: float = _CREASE_ANGLE,
    resource_root: str | os.PathLike[str] | None = None,
    max_bytes: int = DEFAULT_MAX_BYTES,
) -> Scene:
    """
    Read a file of a mesh, a point cloud or a drawing, or take an object of another package.

    Meshes: OBJ, PLY, STL, OFF, glTF, GLB, 3MF, binvox and whatever else trimesh reads. Point
    clouds, as `Points`: PLY without faces, PCD, XYZ, PTS, ASC, TXT and CSV, LAS and LAZ, points of
    OBJ and glTF. Drawings, as `Lines`: DXF and SVG, edges of PLY, lines of OBJ and glTF. Cells of
    simulations, solids by their outer faces: VTK, VTU, VTP, MSH and whatever else meshio reads.
    Objects of trimesh, PyVista, Open3D and meshio are taken as their files would be.

    Faces keep the file's order; polygons are triangulated. The scene has one `Mesh` for each mesh
    of the file and one node for each place where it stands, with vertex and face colours, uv,
    materials with textures, lights and camera as far as the file has them. ``up`` is z for 3MF and
    LAS, and what a COLLADA file says; no other format tells one but y. Materials of glTF stay
    metallic-roughness; those of OBJ and other formats become Blinn-Phong. Further numbers of
    vertices and faces become attributes of the meshes: other properties of a PLY file by their
    names, ``_NAME`` of a glTF file as ``NAME``, and those that trimesh reads.

    Points keep the file's order too. Those whose position is NaN, as depth cameras write them where
    they measured nothing, are not drawn and are counted in the warning. Points have a size of 3
    pixels, those of clouds of more than 160 thousand 2, and of more than 444 thousand 1, those of
    fewer than 400 up to 12; without colours and normals they are shown by their intensity, if they
    have one, else in grey. Cells are shown by the active scalars, or by the first that are one
    number for each point or cell, and all become attributes.

    Two things of glTF are as in every other format rather than by its standard. A primitive without
    a material has the default one; only in a scene with an environment is it glTF's rough white
    metal, which shows little without. One without normals has smooth ones; ``crease_angle=0`` gives
    the standard's flat faces.

    Parameters
    ----------
    path : str, path-like, or an object of trimesh, PyVista, Open3D or meshio
        An object takes ``on_invalid`` and ``crease_angle`` alone.
    on_invalid : {"raise", "drop"}
        What to do about NaN or infinite vertices, as in `Mesh`; of clouds, about infinite ones.
    on_damage : {"error", "warn"}
        What to do about a file of OBJ, PLY, STL, OFF, PCD, LAS or rows of points that is cut short,
        or has lines that cannot be read or faces among vertices that are not there: refuse it,
        naming the line and what was expected there, or load the rest and warn.
    crease_angle : float
        Degrees in 0..180. Meshes whose file gives no normals get them from
        ``Mesh.split_creases(crease_angle)``.
    resource_root : str or path-like, optional
        The folder that files named by this one must lie in: textures, buffers, MTL files. Default:
        the folder of this file, or of the ROS package or Gazebo model that it is in (the nearest of
        its own and the four above with a ``package.xml`` or ``model.config``). Addresses, absolute
        paths, and links, pipes and devices that lead out of it are never opened.
    max_bytes : int
        Memory that this file and all that it names may take together. Sizes are told from headers
        before anything is read or unpacked: at its peak, loading takes at most twice this. A face
        of an OBJ, PLY, STL or OFF file counts 250 to 600 bytes. Default: 8 GiB.

    Returns
    -------
    Scene

    Raises
    ------
    MeshFileError
        A ``ValueError``: if the file is missing, cannot be read or holds nothing to draw. The
        message names the file and what it holds.
    ValueError
        If ``resource_root`` is no folder, an option for files is given for an object, or more than
        ``max_bytes`` are needed: the message says by what.

    Warns
    -----
    LoadWarning
        Once, naming what the file has and the scene has not, such as further cameras; and if every
        material is fully transparent.
    """
    bounded_number("crease_angle", crease_angle, 0.0, 180.0)
    one_of("on_invalid", on_invalid, ON_INVALID)
    one_of("on_damage", on_damage, ON_DAMAGE)
    if _is_trimesh(path) or foreign_package(path) is not None:
        for name, value, default in (
            ("on_damage", on_damage, "error"),
            ("resource_root", resource_root, None),
            ("max_bytes", max_bytes, DEFAULT_MAX_BYTES),
        ):
            if value != default:
                said = (
                    "a trimesh object"
                    if _is_trimesh(path)
                    else f"an object of {foreign_package(path)}"
                )
                raise ValueError(f"{name} must not be given for {said}, got {value!r}")
        if _is_trimesh(path):
            return from_trimesh(path, on_invalid=on_invalid, crease_angle=crease_angle)
        return _from_foreign(path, on_invalid, crease_angle)
    root = None if resource_root is None else existing_folder("resource_root", resource_root)
    file = _checked_path(path)
    budget = MemoryBudget(str(file), max_bytes)
    left_out, resources = LeftOut(), Resources(file, root, budget)
    try:
        scene = _load(file, resources, on_invalid, on_damage, crease_angle, left_out)
        scene.up = _up_of(file)
    except Exception as error:
        # Readers name what they cannot read; this is the reason.
        budget.check()
        kind = other_kind(file, _extension(file))
        if kind is None:
            raise
        raise MeshFileError(f"{file} is {kind}; its name says .{_extension(file)}") from error
    budget.check()
    left_out.warn(str(file))
    _warn_if_invisible(file, scene)
    return scene


def _load(
    file: Path,
    resources: Resources,
    on_invalid: str,
    on_damage: str,
    crease_angle: float,
    left_out: LeftOut,
) -> Scene:
    """Read a mesh file with the reader of its format."""
    extension, budget = _extension(file), resources.budget
    if extension in GLTF_FORMATS:
        return load_gltf(file, resources, on_invalid, crease_angle, left_out)
    if extension == "3mf":
        return load_3mf(file, resources, on_invalid, crease_angle, left_out)
    if extension == "binvox":
        return load_binvox(file, resources, left_out)
    if extension in PART_FORMATS or (extension == "dxf" and find_spec("ezdxf") is not None):
        damage = Damage(file, on_damage, left_out)
        parts = _read_parts(file, resources, damage, left_out)
        scene = scene_of_parts(parts, str(file), on_invalid, crease_angle, left_out, budget)
        damage.note()
        return scene
    loaded = _read(file, resolver_of(resources, left_out, extension == "dae"), budget, left_out)
    note_what_is_not_read(file, extension, left_out)
    if extension == "dxf":
        note_entities(file, left_out)
    adapter = TrimeshAdapter(str(file), True, on_invalid, crease_angle, left_out, budget)
    scene = adapter.scene(loaded)
    if extension == "svg":
        # Its y points down.
        for node in scene.nodes:
            node.transform = compose(_UPWARDS, node.transform)
    return scene


def _up_of(file: Path) -> tuple[float, float, float] | None:
    """Return which way is up by a file or the definition of its format; None if neither tells."""
    extension = _extension(file)
    if extension == "dae":
        with file.open("rb") as opened:
            said = _UP_AXIS.search(opened.read(_HEAD))
        axis = said[1] if said else b"Y"
    elif extension in GLTF_FORMATS:
        axis = b"Y"
    elif extension in _Z_UP:
        axis = b"Z"
    else:
        return None
    return {b"X": (1.0, 0.0, 0.0), b"Y": (0.0, 1.0, 0.0), b"Z": (0.0, 0.0, 1.0)}[axis]


def _read_parts(
    file: Path, resources: Resources, damage: Damage, left_out: LeftOut
) -> Sequence[Thing]:
    """Read a file of `PART_FORMATS`, or raise `MeshFileError`."""
    extension = _extension(file)
    try:
        if extension == "obj":
            return read_obj(file, resources, damage, left_out)
        if extension == "ply":
            return read_ply(file, resources, damage, left_out)
        if extension == "off":
            return read_off(file, resources, damage, left_out)
        if extension == "pcd":
            return read_pcd(file, resources, damage, left_out)
        if extension in LAS_FORMATS:
            return read_las(file, resources, damage, left_out)
        if extension in ROW_FORMATS:
            return read_rows(file, resources, damage, left_out)
        if extension in VTK_FORMATS:
            return read_vtk(file, resources, left_out)
        if extension in CELL_FORMATS:
            return read_cells(file, resources, left_out)
        if extension == "dxf":
            return read_dxf(file, resources, left_out)
        return read_stl(file, resources, damage, left_out)
    except (OSError, MemoryError) as error:
        reason = reason_of(error) if isinstance(error, OSError) else "it needs too much memory"
        raise MeshFileError(f"{file} could not be read as .{extension}: {reason}") from error


def _warn_if_invisible(file: Path, scene: Scene) -> None:
    """Warn if a file's materials hide all that it holds."""
    materials = [node.mesh.material for node in scene.nodes]
    if all(one.alpha_mode == "blend" and one.base_color_over(False)[3] == 0.0 for one in materials):
        warn_caller(
            f"{file}: every material is fully transparent, so nothing of it is seen", LoadWarning
        )


def from_trimesh(
    what: trimesh.Trimesh | trimesh.Scene,
    *,
    on_invalid: OnInvalid = "raise",
    crease_angle: float = _CREASE_ANGLE,
) -> Scene:
    """
    Turn a trimesh object into a scene, with its colours, materials, camera and lights.

    Parameters
    ----------
    what : trimesh.Trimesh, trimesh.PointCloud, trimesh.path.Path or trimesh.Scene
        Its arrays are shared where their type allows.
    on_invalid : {"raise", "drop"}
        What to do about NaN or infinite vertices, as in `Mesh`.
    crease_angle : float
        Degrees in 0..180. Meshes without normals of their own get them from
        ``Mesh.split_creases(crease_angle)``; normals that trimesh averaged are not their own.

    Returns
    -------
    Scene
        Without the lights that trimesh makes up for scenes that have none.

    Raises
    ------
    MeshFileError
        A ``ValueError``: if it holds nothing to draw or an invalid mesh.
    ValueError
        If it is no object of trimesh's.

    Warns
    -----
    LoadWarning
        Once, naming what was left out.
    """
    if not _is_trimesh(what):
        raise ValueError(
            f"what must be a trimesh.Trimesh or a trimesh.Scene, got {type(what).__name__}"
        )
    left_out = LeftOut()
    source = f"trimesh {type(what).__name__}"
    scene = TrimeshAdapter(source, False, on_invalid, crease_angle, left_out).scene(what)
    left_out.warn(source)
    return scene


def _from_foreign(what: Any, on_invalid: OnInvalid, crease_angle: float) -> Scene:
    """Turn an object of another package into a scene; warn of what was left out."""
    left_out = LeftOut()
    scene = scene_of_foreign(what, on_invalid, crease_angle, left_out)
    left_out.warn(foreign_name(what))
    return scene


def as_scene(what: Any, name: str = "what") -> Scene:
    """
    Return anything that can be drawn as a scene.

    Parameters
    ----------
    what : Scene, Mesh, Points, Lines, or an object of trimesh, PyVista, Open3D or meshio
        A scene is returned as it is.
    name : str
        What errors call it.

    Raises
    ------
    ValueError
        If it is none of these, or holds nothing to draw.
    """
    if isinstance(what, Scene):
        return what
    if isinstance(what, Mesh):
        scene = Scene()
        scene.add(what)
        return scene
    if _is_trimesh(what):
        return from_trimesh(what)
    if foreign_package(what) is not None:
        return _from_foreign(what, "raise", _CREASE_ANGLE)
    hint = "; rasterjit.load reads files" if isinstance(what, (str, os.PathLike)) else ""
    raise ValueError(
        f"{name} must be a Scene, a Mesh, Points, Lines, or an object of trimesh's, PyVista's, "
        f"Open3D's or meshio's, got {type(what).__name__}{hint}"
    )


def scene_to_add(what: Any) -> Scene:
    """
    Return a scene, or an object of another package as one, whose nodes are to be added to another.

    Raises
    ------
    ValueError
        If it is none of these, or holds nothing to draw.

    Warns
    -----
    LoadWarning
        Once, naming what it has besides nodes.
    """
    left_out = LeftOut()
    if _is_trimesh(what):
        source = f"trimesh {type(what).__name__}"
        scene = TrimeshAdapter(source, False, "raise", _CREASE_ANGLE, left_out).scene(what)
    elif foreign_package(what) is not None:
        scene = scene_of_foreign(what, "raise", _CREASE_ANGLE, left_out)
    elif isinstance(what, Scene):
        scene = what
    else:
        hint = "; rasterjit.load reads files" if isinstance(what, (str, os.PathLike)) else ""
        raise ValueError(
            "mesh must be a rasterjit Mesh, Node or Scene, or an object of trimesh's, PyVista's, "
            f"Open3D's or meshio's, got {type(what).__name__}{hint}"
        )
    if not scene.nodes:
        raise ValueError("mesh must be a scene with at least one mesh, got an empty one")
    for light in scene.lights:
        left_out.note(type(light).__name__)
    for name in ("camera", *EFFECT_FIELDS):
        if getattr(scene, name) is not None:
            left_out.note(name)
    left_out.warn(f"{type(what).__name__} added to a scene")
    return scene


def _is_trimesh(what: Any) -> bool:
    """Tell trimesh's objects, which only exist if somebody has imported it."""
    trimesh = sys.modules.get("trimesh")
    return trimesh is not None and isinstance(what, (trimesh.parent.Geometry, trimesh.Scene))


def _checked_path(path: str | os.PathLike[str]) -> Path:
    """Return the path of an existing file, or raise `MeshFileError`."""
    try:
        return existing_file("path", path)
    except ValueError as error:
        raise MeshFileError(str(error)) from None


def _extension(file: Path) -> str:
    """Return a file's extension as trimesh names it: lower case, no dot."""
    name = file.name.lower()
    double = [ending for ending in ("tar.gz", "tar.bz2") if name.endswith("." + ending)]
    return double[0] if double else file.suffix.lower().removeprefix(".")


def _read(file: Path, resolver: Any, budget: MemoryBudget, left_out: LeftOut) -> trimesh.Scene:
    """Read a file with trimesh, and what it names with a resolver, or raise `MeshFileError`."""
    import trimesh

    extension = _extension(file)
    loaders = trimesh.exchange.load
    known = loaders.available_formats() | set(loaders.voxel_loaders) | set(_NEEDED)
    if extension not in known and extension not in loaders.mesh_loaders:
        named = [*(name for name in _SHOWN_FORMATS if name in known), *_SHOWN_OWN]
        shown = ", ".join(f".{name}" for name in named)
        kind = f"the extension .{extension}" if extension else "no extension"
        raise MeshFileError(f"{file} has {kind}; readable formats are {shown} and more")
    factor = XML_BYTES if extension in _XML_FORMATS else _OTHER_BYTES
    budget.take("the file", file.stat().st_size * factor)
    try:
        for module in _NEEDED.get(extension, ()):
            import_module(module)
        take_members(file, extension, factor, budget)
        bound = with_bound_shapes(file, left_out) if extension == "dae" else None
        with warnings.catch_warnings(), trimesh_told(left_out):
            warnings.simplefilter("ignore")
            # NumPy only warns of numbers that end at a word that is none; what is behind is lost.
            warnings.filterwarnings("error", ".*could not be read to its end", DeprecationWarning)
            options: dict[str, Any] = {"resolver": resolver, "process": False}
            if bound is not None:
                return trimesh.load_scene(io.BytesIO(bound), file_type=extension, **options)
            return trimesh.load_scene(file, **options)
    except ImportError as error:
        if error.name in _ENCODING_GUESSERS:
            # trimesh falls back on guessing the encoding of a text that is none.
            raise MeshFileError(
                f"{file} could not be read as .{extension}: it is damaged or something else"
            ) from error
        raise MeshFileError(
            f"{file}: reading .{extension} needs a package that is not installed ({error}); "
            "pip install 'rasterjit[formats]' brings them"
        ) from error
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise MeshFileError(f"{file} could not be read as .{extension}: {reason}") from error
