"""Load files, objects of other packages and meshes as scenes."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeGuard, get_args

from rasterjit.io.binvox import load_binvox
from rasterjit.io.foreign.codecs import Decoder, Isolation
from rasterjit.io.foreign.objects import convert_foreign, describe_object, find_package
from rasterjit.io.gltf.scene import GLTF_FORMATS, load_gltf
from rasterjit.io.load_warnings import (
    DAMAGED,
    READER_ERRORS,
    LeftOut,
    LoadWarning,
    MeshFileError,
    raise_mesh_file_error,
)
from rasterjit.io.point_clouds.las import LAS_FORMATS
from rasterjit.io.point_clouds.pcd import read_pcd
from rasterjit.io.primitives import Context
from rasterjit.io.resources import Resources, RobotResources, detect_kind, extension_of
from rasterjit.io.text.mesh_builder import Geometry, SceneRecord, build_scene, convert_record
from rasterjit.io.text.number_parser import Damage
from rasterjit.io.text.obj import read_obj
from rasterjit.io.text.off import read_off
from rasterjit.io.text.ply import read_ply
from rasterjit.io.text.stl import read_stl
from rasterjit.io.text.xyz import XYZ_FORMATS, read_xyz
from rasterjit.io.threemf.scene import load_3mf
from rasterjit.io.trimesh.scene import TrimeshAdapter
from rasterjit.scene import validation as check
from rasterjit.scene.memory_limits import DEFAULT_MAX_BYTES, MemoryBudget
from rasterjit.scene.mesh import ON_INVALID, Mesh, OnInvalid
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
from rasterjit.scene.warning import warn_caller

if TYPE_CHECKING:
    import trimesh

    from rasterjit.io.foreign.isolation import Session

__all__ = ["LoadWarning", "MeshFileError", "as_scene", "from_trimesh", "get_scene_to_add", "load"]

EXTRA_SUFFIXES = (".3dxml", ".dae", ".urdf", ".xaml", ".zae")
"""Mesh files that need ``rasterjit[formats]`` or ``[robots]``: without it, `load` says so."""

AMBIGUOUS_SUFFIXES = (".xml", ".dat", ".node")
"""Extensions that many files which are no meshes have too."""


def mesh_files(folder: str | Path) -> list[Path]:
    """
    Return all files below a folder whose names are those of meshes, in the order of their names.

    Hidden files and folders are left out, and ``.xml``, ``.dat`` and ``.node``: such names have
    many files that are no meshes, or are a part of one.

    Raises
    ------
    ValueError
        If there is no such folder.
    """
    top = check.existing_folder("folder", folder).resolve()
    meshes = []
    for root, folders, files in os.walk(top):
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            if not name.startswith(".") and _is_mesh_suffix(Path(name).suffix.lower()):
                meshes.append(Path(root, name))
    return sorted(meshes, key=lambda file: file.relative_to(top).as_posix())


OnDamage: TypeAlias = Literal["error", "warn"]
ON_DAMAGE: tuple[OnDamage, ...] = get_args(OnDamage)
"""For a damaged file: refuse it; or load the rest and warn."""

BUILTIN_FORMATS = ("obj", "ply", "stl", "off", "pcd", *XYZ_FORMATS)
"""Formats that `_read_builtin` reads."""

EXTRA_MODULES = ("lxml", "networkx", "collada", "svg", "ezdxf")
"""Modules that the extra ``rasterjit[formats]`` brings."""

_OWN_SUFFIXES = frozenset(
    (".3mf", ".obj", ".off", ".ply", ".stl", ".xyz", *(f".{name}" for name in GLTF_FORMATS),
     *EXTRA_SUFFIXES)
)  # fmt: skip
"""Extensions of meshes that are known without trimesh."""

_NO_MESH_SUFFIXES = frozenset(
    ("", ".bin", ".bmp", ".csv", ".html", ".jpeg", ".jpg", ".json", ".log", ".md", ".mtl", ".pdf",
     ".png", ".py", ".rst", ".sh", ".tga", ".tif", ".tiff", ".toml", ".txt", ".webp",
     ".yaml", ".yml", ".zip", *AMBIGUOUS_SUFFIXES)
)  # fmt: skip
"""Extensions of what often lies beside meshes: trimesh, which takes a second to import, is not
asked about them."""


def _is_mesh_suffix(suffix: str) -> bool:
    """Tell whether an extension, with its dot, always means a mesh."""
    if suffix in _OWN_SUFFIXES or suffix in _NO_MESH_SUFFIXES:
        return suffix in _OWN_SUFFIXES
    return suffix[1:] in _trimesh_formats()


@cache
def _trimesh_formats() -> frozenset[str]:
    """Return the formats that trimesh reads."""
    from trimesh.exchange.load import mesh_formats

    return frozenset(mesh_formats())


_Z_UP_FORMATS = ("3mf", "urdf", *LAS_FORMATS)
"""Formats that define z as up."""

_UP_AXIS = re.compile(rb"<up_axis>\s*([XYZ])_UP\s*</up_axis>")
"""The up axis in the header of a COLLADA file."""

_COLLADA_HEADER_BYTES = 1 << 16
"""Bytes of a COLLADA file that are searched for the up axis."""

_CREASE_ANGLE = 40.0
"""Angle between faces, degrees, from which an edge is sharp, for meshes without normals."""


def load(
    path: str | os.PathLike[str] | trimesh.Trimesh | trimesh.Scene | Any,
    *,
    on_invalid: OnInvalid = "raise",
    on_damage: OnDamage = "error",
    crease_angle: float = _CREASE_ANGLE,
    resource_root: str | os.PathLike[str] | None = None,
    max_bytes: int = DEFAULT_MAX_BYTES,
    isolate: Isolation = True,
) -> Scene:
    """
    Read a file of a mesh, a point cloud or a drawing, or take an object of another package.

    Meshes: OBJ, PLY, STL, OFF, glTF, GLB, 3MF, binvox and whatever else trimesh reads. Point
    clouds, as `Points`: PLY without faces, PCD, XYZ, PTS, ASC, TXT and CSV, LAS and LAZ, points of
    OBJ and glTF. Drawings, as `Lines`: DXF and SVG, edges of PLY, lines of OBJ and glTF. Cells of
    simulations, solids by their outer faces: VTK, VTU, VTP, MSH and whatever else meshio reads.
    Robots: URDF, with a node for each link and ``scene.joints``; collision shapes are passed over.
    Objects of trimesh, PyVista, Open3D and meshio are taken as their files would be.

    Faces keep the file's order; polygons are triangulated. The scene has one `Mesh` for each mesh
    of the file and one node for each place where it stands, with vertex and face colours, uv,
    materials with textures, lights and camera as far as the file has them. ``up`` is z for 3MF,
    URDF and LAS, and what a COLLADA file says; no other format tells one but y. Materials of glTF
    stay metallic-roughness; those of OBJ and other formats become Blinn-Phong. Further numbers of
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
        or has lines that cannot be read or faces among vertices that are not there, and about a
        robot's meshes that are missing or cannot be read: refuse it, naming the line and what was
        expected there, or load the rest and warn.
    crease_angle : float
        Degrees in 0..180. Meshes whose file gives no normals get them from
        ``Mesh.split_creases(crease_angle)``.
    resource_root : str or path-like, optional
        The folder that files named by this one must lie in: textures, buffers, MTL files. Default:
        the folder of this file, or of the ROS package or Gazebo model that it is in (the nearest of
        its own and the four above with a ``package.xml`` or ``model.config``); of a robot, the
        folder above that of the file, and every package that it names, in or beside a folder above,
        in ``ROS_PACKAGE_PATH`` or in ``AMENT_PREFIX_PATH``. Addresses, absolute paths, and links,
        pipes and devices that lead out of it are never opened.
    max_bytes : int
        Memory that this file and all that it names may take together. Sizes are told from headers
        before anything is read or unpacked: at its peak, loading takes at most twice this. A face
        of an OBJ, PLY, STL or OFF file counts 250 to 600 bytes. Default: 8 GiB.
    isolate : bool or "all"
        Whether other packages work in a process of its own: those that read whole files (LAS, LAZ,
        DXF, and all that trimesh, meshio and PyVista do) and those that unpack meshes and textures
        of glTF files (Draco, meshopt, KTX 2). It may take as much memory as ``max_bytes`` allows,
        10 seconds of the processor and 10 for each megabyte that it reads, reaches no network and,
        on Linux, no file but those of ``resource_root``. It starts when it is first needed and
        waits for the next file. ``"all"``: Pillow decodes pictures there as well, as it does for
        ``rasterjit render FOLDER`` and data sets. False: all of them work in this process, without
        these limits, which is for files that you trust.

    Returns
    -------
    Scene

    Raises
    ------
    MeshFileError
        A ``ValueError``: if the file is missing, cannot be read or holds nothing to draw, or its
        reader, or what decodes a part of it, crashes or reaches a limit. The message names the
        file and what it holds.
    ValueError
        If ``resource_root`` is no folder, ``isolate`` is no such choice, an option for files is
        given for an object, or more than ``max_bytes`` are needed: the message says by what.

    Warns
    -----
    LoadWarning
        Once, naming what the file has and the scene has not, such as further cameras; and if every
        material is fully transparent.
    """
    check.bounded_number("crease_angle", crease_angle, 0.0, 180.0)
    check.one_of("on_invalid", on_invalid, ON_INVALID)
    check.one_of("on_damage", on_damage, ON_DAMAGE)
    if not isinstance(isolate, bool) and not (isinstance(isolate, str) and isolate == "all"):
        raise ValueError(f"isolate must be True, False or 'all', got {check.brief(isolate)}")
    if _is_trimesh(path) or find_package(path) is not None:
        for name, value, default in (
            ("on_damage", on_damage, "error"),
            ("resource_root", resource_root, None),
            ("max_bytes", max_bytes, DEFAULT_MAX_BYTES),
            ("isolate", isolate, True),
        ):
            if value != default:
                source = (
                    "a trimesh object"
                    if _is_trimesh(path)
                    else f"an object of {find_package(path)}"
                )
                raise ValueError(f"{name} must not be given for {source}, got {value!r}")
        if _is_trimesh(path):
            return from_trimesh(path, on_invalid=on_invalid, crease_angle=crease_angle)
        return _from_foreign(path, on_invalid, crease_angle)
    root = None if resource_root is None else check.existing_folder("resource_root", resource_root)
    file = _check_path(path)
    budget = MemoryBudget(str(file), max_bytes)
    decoder = Decoder(budget, isolate, _begin_session)
    is_robot = extension_of(file) == "urdf"
    resources = (RobotResources if is_robot else Resources)(file, root, budget, decoder)
    left_out = LeftOut()
    try:
        scene = _load(file, resources, on_invalid, on_damage, crease_angle, left_out, isolate)
        scene.up = _find_up_axis(file)
    except Exception as error:
        # The real reason may be the memory limit, or a name that belies the content.
        budget.check()
        kind = detect_kind(file, extension_of(file))
        if kind is None:
            raise
        raise MeshFileError(f"{file} is {kind}; its name says .{extension_of(file)}") from error
    finally:
        decoder.close()
    budget.check()
    left_out.warn(str(file))
    _warn_if_invisible(file, scene)
    return scene


def _load(
    file: Path,
    resources: Resources,
    on_invalid: OnInvalid,
    on_damage: str,
    crease_angle: float,
    left_out: LeftOut,
    isolate: Isolation,
) -> Scene:
    """Read a mesh file with the reader of its format."""
    extension = extension_of(file)
    context = Context(str(file), on_invalid, crease_angle, left_out, resources.budget)
    if extension in GLTF_FORMATS:
        return load_gltf(file, resources, context)
    if extension == "3mf":
        return load_3mf(file, resources, context)
    if extension == "binvox":
        return load_binvox(file, resources, left_out)
    if extension in BUILTIN_FORMATS:
        damage = Damage(file, on_damage, left_out)
        data: Any = _read_builtin(file, resources, damage, left_out)
        damage.add_to_left_out()
    elif isolate:
        from rasterjit.io.foreign.isolation import read_isolated

        data = read_isolated(file, resources, on_invalid, on_damage, left_out)
    else:
        from rasterjit.io.foreign.readers import read_file

        data = read_file(file, resources, on_invalid, on_damage, left_out)
    if extension == "urdf":
        from rasterjit.io.urdf import build_robot

        def load_part(path: Path, root: Path) -> Scene:
            """Load a mesh file that the robot names."""
            part = Resources(path, root, resources.budget, resources.decoder)
            return _load(path, part, on_invalid, on_damage, crease_angle, left_out, isolate)

        assert isinstance(resources, RobotResources)
        return build_robot(data, context, resources, on_damage, load_part)
    make = convert_record if isinstance(data, SceneRecord) else build_scene
    try:
        return make(data, context)
    except READER_ERRORS as error:
        if extension in BUILTIN_FORMATS or not isolate:
            raise
        # Data from the isolated process may be malformed: same error as a damaged file.
        raise MeshFileError(f"{file} could not be read as .{extension}: {DAMAGED}") from error


def list_readable_formats() -> frozenset[str]:
    """Return the extensions that `load` takes with what is installed, in lower case, no dot."""
    from rasterjit.io.foreign.readers import list_foreign_formats

    return frozenset({*GLTF_FORMATS, "3mf", "binvox", *BUILTIN_FORMATS, *list_foreign_formats()})


def _begin_session(budget: MemoryBudget) -> Session:
    """Start a session that decodes the compressed data of a file in an isolated process."""
    from rasterjit.io.foreign.isolation import Session

    return Session(budget)


def _find_up_axis(file: Path) -> tuple[float, float, float] | None:
    """Return the up axis by a file or the definition of its format; None if unknown."""
    extension = extension_of(file)
    if extension == "dae":
        with file.open("rb") as opened:
            match = _UP_AXIS.search(opened.read(_COLLADA_HEADER_BYTES))
        axis = match[1] if match else b"Y"
    elif extension in GLTF_FORMATS:
        axis = b"Y"
    elif extension in _Z_UP_FORMATS:
        axis = b"Z"
    else:
        return None
    return {b"X": (1.0, 0.0, 0.0), b"Y": (0.0, 1.0, 0.0), b"Z": (0.0, 0.0, 1.0)}[axis]


def _read_builtin(
    file: Path, resources: Resources, damage: Damage, left_out: LeftOut
) -> Sequence[Geometry]:
    """Read a file of `BUILTIN_FORMATS`, or raise `MeshFileError`."""
    extension = extension_of(file)
    with raise_mesh_file_error(file, extension):
        if extension == "obj":
            return read_obj(file, resources, damage, left_out)
        if extension == "ply":
            return read_ply(file, resources, damage, left_out)
        if extension == "off":
            return read_off(file, resources, damage, left_out)
        if extension == "pcd":
            return read_pcd(file, resources, damage, left_out)
        if extension in XYZ_FORMATS:
            return read_xyz(file, resources, damage, left_out)
        return read_stl(file, resources, damage, left_out)


def _warn_if_invisible(file: Path, scene: Scene) -> None:
    """Warn if all materials of a file are fully transparent."""
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
    context = Context(source, on_invalid, crease_angle, left_out)
    scene = TrimeshAdapter(context, from_file=False).scene(what)
    left_out.warn(source)
    return scene


def _from_foreign(what: Any, on_invalid: OnInvalid, crease_angle: float) -> Scene:
    """Turn an object of another package into a scene; warn of what was left out."""
    left_out = LeftOut()
    scene = convert_foreign(what, on_invalid, crease_angle, left_out)
    left_out.warn(describe_object(what))
    return scene


def as_scene(what: Any, name: str = "what") -> Scene:
    """
    Convert anything that can be drawn to a scene.

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
    if find_package(what) is not None:
        return _from_foreign(what, "raise", _CREASE_ANGLE)
    hint = "; rasterjit.load reads files" if isinstance(what, (str, os.PathLike)) else ""
    raise ValueError(
        f"{name} must be a Scene, a Mesh, Points, Lines, or an object of trimesh's, PyVista's, "
        f"Open3D's or meshio's, got {type(what).__name__}{hint}"
    )


def get_scene_to_add(what: Any) -> Scene:
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
        context = Context(source, "raise", _CREASE_ANGLE, left_out)
        scene = TrimeshAdapter(context, from_file=False).scene(what)
    elif find_package(what) is not None:
        scene = convert_foreign(what, "raise", _CREASE_ANGLE, left_out)
    elif isinstance(what, Scene):
        scene = what
    else:
        hint = "; rasterjit.load reads files" if isinstance(what, (str, os.PathLike)) else ""
        raise ValueError(
            "mesh must be a rasterjit Mesh, Label, Node or Scene, or an object of trimesh's, "
            f"PyVista's, Open3D's or meshio's, got {type(what).__name__}{hint}"
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


def _is_trimesh(what: Any) -> TypeGuard[trimesh.Trimesh | trimesh.Scene]:
    """Tell whether this is an object of trimesh, which exists only if trimesh is imported."""
    trimesh = sys.modules.get("trimesh")
    return trimesh is not None and isinstance(what, (trimesh.parent.Geometry, trimesh.Scene))


def _check_path(path: Any) -> Path:
    """Return the path of an existing file, or raise `MeshFileError`."""
    try:
        return check.existing_file("path", path)
    except ValueError as error:
        raise MeshFileError(str(error)) from None
