"""Load files, objects of other packages and meshes as scenes."""

from __future__ import annotations

import os
import re
import sys
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
from rasterjit.io.text.mesh_builder import SceneRecord, build_scene, convert_record
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
"""Extensions of meshes that need ``rasterjit[formats]`` or ``[robots]``; else `load` says so."""

AMBIGUOUS_SUFFIXES = (".xml", ".dat", ".node")
"""Extensions of meshes, and of many other files."""


def mesh_files(folder: str | Path) -> list[Path]:
    """
    Return the mesh files in a folder and the folders below it, by their extensions, sorted by path.

    Leaves out hidden files and folders, and ``.xml``, ``.dat`` and ``.node``: many such files are
    no meshes, or parts of one.

    Parameters
    ----------
    folder : str or path-like

    Returns
    -------
    list of pathlib.Path
        Absolute.

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
"""What to do about a damaged file: refuse it, or load the rest and warn."""

_BUILTIN_READERS = {
    "obj": read_obj, "ply": read_ply, "stl": read_stl, "off": read_off, "pcd": read_pcd,
    **dict.fromkeys(XYZ_FORMATS, read_xyz),
}  # fmt: skip
"""Readers of text formats and point clouds, by the extension."""

BUILTIN_FORMATS = tuple(_BUILTIN_READERS)

EXTRA_MODULES = ("lxml", "networkx", "collada", "svg", "ezdxf")
"""Modules that the extra ``rasterjit[formats]`` installs."""

_MESH_SUFFIXES = frozenset(
    (".3mf", ".obj", ".off", ".ply", ".stl", ".xyz", *(f".{name}" for name in GLTF_FORMATS),
     *EXTRA_SUFFIXES)
)  # fmt: skip
"""Extensions of meshes that are known without importing trimesh, which takes a second."""

_OTHER_SUFFIXES = frozenset(
    ("", ".bin", ".bmp", ".csv", ".html", ".jpeg", ".jpg", ".json", ".log", ".md", ".mtl", ".pdf",
     ".png", ".py", ".rst", ".sh", ".tga", ".tif", ".tiff", ".toml", ".txt", ".webp",
     ".yaml", ".yml", ".zip", *AMBIGUOUS_SUFFIXES)
)  # fmt: skip
"""Extensions that are often found beside meshes: known to be none without importing trimesh."""


def _is_mesh_suffix(suffix: str) -> bool:
    """Tell whether an extension, lower case with its dot, is of meshes alone."""
    if suffix in _MESH_SUFFIXES or suffix in _OTHER_SUFFIXES:
        return suffix in _MESH_SUFFIXES
    return suffix[1:] in _trimesh_formats()


@cache
def _trimesh_formats() -> frozenset[str]:
    """Return the formats that trimesh reads."""
    from trimesh.exchange.load import mesh_formats

    return frozenset(mesh_formats())


_Z_UP_FORMATS = ("3mf", "urdf", *LAS_FORMATS)
"""Formats whose definition says that z is up."""

_UP_AXIS = re.compile(rb"<up_axis>\s*([XYZ])_UP\s*</up_axis>")
"""The up axis in the header of a COLLADA file."""

_COLLADA_HEADER_BYTES = 1 << 16
"""Bytes of a COLLADA file that are searched for the up axis."""

_CREASE_ANGLE = 40.0
"""Default angle between faces, degrees, from which an edge is sharp in meshes without normals."""


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
    Robots: URDF, with a node for each link and ``scene.joints``; collision shapes are left out.
    Objects of trimesh, PyVista, Open3D and meshio are converted as their files would be.

    Faces keep the file's order; polygons are triangulated. The scene has one `Mesh` for each mesh
    of the file and one node for each place where it stands, with vertex and face colours, uv,
    materials with textures, lights and camera as far as the file has them. ``up`` is y for glTF, z
    for 3MF, URDF and LAS, what the file says for COLLADA, and None for others. Materials of glTF
    stay metallic-roughness; those of OBJ and other formats become Blinn-Phong. Further numbers of
    vertices and faces become attributes of the meshes: other properties of a PLY file by their
    names, ``_NAME`` of a glTF file as ``NAME``, and those that trimesh reads.

    Points keep the file's order too. Those whose position is NaN, as depth cameras write them where
    they measured nothing, are not drawn and are counted in the warning. Points have a size of 3
    pixels; in clouds of more than 160 thousand 2, of more than 444 thousand 1, of fewer than 400 up
    to 12. Without colours and normals they show their intensity, if they have one, else grey. Cells
    show the active scalars, or the first array with one number for each point or cell; all arrays
    become attributes.

    Two things of glTF are as in every other format rather than by its standard. A primitive without
    a material has the default one; only in a scene with an environment is it glTF's rough white
    metal, which shows little without. One without normals has smooth ones; ``crease_angle=0`` gives
    the standard's flat faces.

    Parameters
    ----------
    path : str, path-like, or an object of trimesh, PyVista, Open3D or meshio
        An object takes ``on_invalid`` and ``crease_angle`` alone.
    on_invalid : {"raise", "drop"}
        What to do about NaN or infinite vertices, as in `Mesh`; in clouds, about infinite ones.
    on_damage : {"error", "warn"}
        What to do about damage: refuse the file, naming the line and what was expected there, or
        load the rest and warn. Damaged is a file of OBJ, PLY, STL, OFF, PCD, LAS or rows of points
        that is cut short, has lines that cannot be read, or faces with vertices that it lacks; and
        a robot with meshes that are missing or cannot be read.
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
        Memory that this file and all that it names may take together. Headers give the sizes before
        anything is read or unpacked: at its peak, loading takes at most twice this. A face of an
        OBJ, PLY, STL or OFF file counts 250 to 600 bytes. Default: 8 GiB.
    isolate : bool or "all"
        Whether other packages run in a separate process: those that read whole files (LAS, LAZ,
        DXF, and all that trimesh, meshio and PyVista do) and those that unpack meshes and textures
        of glTF files (Draco, meshopt, KTX 2). It may take as much memory as ``max_bytes`` allows,
        10 seconds of the processor and 10 for each megabyte that it reads, reaches no network and,
        on Linux, no file but those of ``resource_root``. It starts when it is first needed and
        waits for the next file. ``"all"``: Pillow decodes images there as well, as it does for
        ``rasterjit render FOLDER`` and data sets. False: all of them work in this process, without
        these limits, which is for files that you trust.

    Returns
    -------
    Scene

    Raises
    ------
    MeshFileError
        A ``ValueError``: if the file is missing, cannot be read or holds nothing to draw, or its
        reader, or the decoder of a part of it, crashes or reaches a limit. The message names the
        file and what it holds.
    ValueError
        If ``resource_root`` is no folder, ``isolate`` is another value, an option for files is
        given for an object, or more than ``max_bytes`` are needed: the message says by what.

    Warns
    -----
    LoadWarning
        Once, naming what the file has and the scene has not, such as further cameras; and if every
        material is fully transparent.
    """
    # Arguments.
    check.bounded_number("crease_angle", crease_angle, 0.0, 180.0)
    check.one_of("on_invalid", on_invalid, ON_INVALID)
    check.one_of("on_damage", on_damage, ON_DAMAGE)
    if not isinstance(isolate, bool) and not (isinstance(isolate, str) and isolate == "all"):
        raise ValueError(f"isolate must be True, False or 'all', got {check.brief(isolate)}")
    # An object of another package.
    package = "trimesh" if _is_trimesh(path) else find_package(path)
    if package is not None:
        for name, value, default in (
            ("on_damage", on_damage, "error"),
            ("resource_root", resource_root, None),
            ("max_bytes", max_bytes, DEFAULT_MAX_BYTES),
            ("isolate", isolate, True),
        ):
            if value != default:
                raise ValueError(
                    f"{name} must not be given for an object of {package}, got {value!r}"
                )
        return _convert_and_warn(path, on_invalid, crease_angle)
    # A file.
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
        # The reason may be the memory limit, or a content that is not what the name says.
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
    """Read a file of any format into a scene, without checks of arguments and warnings."""
    extension = extension_of(file)
    context = Context(str(file), on_invalid, crease_angle, left_out, resources.budget)
    if extension in GLTF_FORMATS:
        return load_gltf(file, resources, context)
    if extension == "3mf":
        return load_3mf(file, resources, context)
    if extension == "binvox":
        return load_binvox(file, resources, left_out)
    # Formats that are read into records first, by our readers or those of other packages.
    if extension in BUILTIN_FORMATS:
        damage = Damage(file, on_damage, left_out)
        with raise_mesh_file_error(file, extension):
            data: Any = _BUILTIN_READERS[extension](file, resources, damage, left_out)
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
    build = convert_record if isinstance(data, SceneRecord) else build_scene
    try:
        return build(data, context)
    except READER_ERRORS as error:
        if extension in BUILTIN_FORMATS or not isolate:
            raise
        # Malformed data of the isolated process is an error like a damaged file.
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
    """Return the up axis by a file or the definition of its format; None if neither has one."""
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


def _warn_if_invisible(file: Path, scene: Scene) -> None:
    """Warn if all materials of a file are fully transparent."""
    materials = [node.mesh.material for node in scene.nodes]
    if all(
        material.alpha_mode == "blend" and material.base_color_over(False)[3] == 0.0
        for material in materials
    ):
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
    Convert a trimesh object to a scene, with its colours, materials, camera and lights.

    Parameters
    ----------
    what : trimesh.Trimesh, trimesh.PointCloud, trimesh.path.Path or trimesh.Scene
        Its arrays are shared, not copied, where their type allows.
    on_invalid : {"raise", "drop"}
        What to do about NaN or infinite vertices, as in `Mesh`.
    crease_angle : float
        Degrees in 0..180. Meshes without normals of their own get them from
        ``Mesh.split_creases(crease_angle)``; normals that trimesh averaged do not count.

    Returns
    -------
    Scene
        Without the lights that trimesh adds to scenes that have none.

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
    return _convert_and_warn(what, on_invalid, crease_angle)


def _convert_and_warn(
    what: Any, on_invalid: OnInvalid = "raise", crease_angle: float = _CREASE_ANGLE
) -> Scene:
    """Convert an object of another package to a scene; warn of what is left out."""
    left_out = LeftOut()
    scene = _convert_object(what, left_out, on_invalid, crease_angle)
    left_out.warn(_describe_object(what))
    return scene


def _convert_object(
    what: Any,
    left_out: LeftOut,
    on_invalid: OnInvalid = "raise",
    crease_angle: float = _CREASE_ANGLE,
) -> Scene:
    """Convert an object of another package to a scene."""
    if not _is_trimesh(what):
        return convert_foreign(what, on_invalid, crease_angle, left_out)
    context = Context(_describe_object(what), on_invalid, crease_angle, left_out)
    return TrimeshAdapter(context, from_file=False).scene(what)


def _is_foreign(what: Any) -> bool:
    """Tell whether this is an object of trimesh, PyVista, Open3D or meshio."""
    return _is_trimesh(what) or find_package(what) is not None


def _describe_object(what: Any) -> str:
    """Return the package and type of an object, such as ``trimesh Scene``."""
    return f"trimesh {type(what).__name__}" if _is_trimesh(what) else describe_object(what)


def _describe_wrong_type(what: Any) -> str:
    """Return the end of an error message for what is neither ours nor of a package we know."""
    hint = "; rasterjit.load reads files" if isinstance(what, (str, os.PathLike)) else ""
    return (
        "or an object of trimesh's, PyVista's, Open3D's or meshio's, got "
        f"{type(what).__name__}{hint}"
    )


def as_scene(what: Any, name: str = "what") -> Scene:
    """
    Convert anything that can be drawn to a scene.

    Parameters
    ----------
    what : Scene, Mesh, Points, Lines, or an object of trimesh, PyVista, Open3D or meshio
        A scene is returned unchanged.
    name : str
        What error messages call it.

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
    if _is_foreign(what):
        return _convert_and_warn(what)
    raise ValueError(f"{name} must be a Scene, a Mesh, Points, Lines, {_describe_wrong_type(what)}")


def get_scene_to_add(what: Any) -> Scene:
    """
    Return a scene, or convert an object of another package to one, to add its nodes to another.

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
    if not isinstance(what, Scene) and not _is_foreign(what):
        raise ValueError(
            f"mesh must be a rasterjit Mesh, Label, Node or Scene, {_describe_wrong_type(what)}"
        )
    scene = what if isinstance(what, Scene) else _convert_object(what, left_out)
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
    """Tell whether this is an object of trimesh, without importing trimesh."""
    trimesh = sys.modules.get("trimesh")
    return trimesh is not None and isinstance(what, (trimesh.parent.Geometry, trimesh.Scene))


def _check_path(path: Any) -> Path:
    """Return the path of an existing file, or raise `MeshFileError`."""
    try:
        return check.existing_file("path", path)
    except ValueError as error:
        raise MeshFileError(str(error)) from None
