"""Mesh files, trimesh objects and meshes become scenes; trimesh is imported only when needed."""

from __future__ import annotations

import math
import os
import sys
import warnings
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.gltf import GltfExtras, read_gltf_header
from rasterjit.io.left_out import LeftOut, LoadWarning
from rasterjit.io.trimesh_materials import colors_from_trimesh, material_from_trimesh
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.light import DirectionalLight, PointLight
from rasterjit.scene.material import Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.scene import Scene

if TYPE_CHECKING:
    import trimesh

__all__ = ["LoadWarning", "MeshFileError", "as_scene", "from_trimesh", "load"]

_GLTF = ("gltf", "glb")
_SHOWN_FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf", "3mf", "dae")
_TRIMESH_FAR = 1000.0
"""The far distance of a trimesh camera that nobody set; taken as no far plane at all."""


class MeshFileError(ValueError):
    """A file is missing, unreadable, of no known format, or holds nothing to draw."""


def load(
    path: str | os.PathLike[str], *, on_invalid: str = "raise", crease_angle: float = 40.0
) -> Scene:
    """
    Read a mesh file: OBJ, PLY, STL, OFF, glTF, GLB and whatever else trimesh reads.

    Faces keep the file's order; polygons are triangulated. The scene has one `Mesh` for each mesh
    of the file and one node for each place where it stands, with vertex and face colours, uv,
    materials, lights and camera as far as the file has them.

    Parameters
    ----------
    path : str or path-like
    on_invalid : {"raise", "drop"}
        What to do about NaN or infinite vertices, as in `Mesh`.
    crease_angle : float
        Degrees in 0..180. Meshes whose file gives no normals get them from
        ``Mesh.split_creases(crease_angle)``.

    Returns
    -------
    Scene

    Raises
    ------
    MeshFileError
        A ``ValueError``: if the file is missing, cannot be read or holds no faces. The message
        names the file and what it holds.

    Warns
    -----
    LoadWarning
        Once, naming what the file has and the scene has not, such as texture images.
    """
    file = _checked_path(path)
    loaded = _read(file)
    left_out = LeftOut()
    extras = None
    if _extension(file) in _GLTF:
        # trimesh drops lights, unlit materials and most cameras: read the header again.
        try:
            extras = GltfExtras(read_gltf_header(file), left_out)
        except (ValueError, LookupError, TypeError, AttributeError):
            left_out.note("lights and cameras")
    scene = _Adapter(str(file), on_invalid, crease_angle, left_out, extras).scene(loaded)
    left_out.warn(str(file))
    return scene


def from_trimesh(
    what: trimesh.Trimesh | trimesh.Scene,
    *,
    on_invalid: str = "raise",
    crease_angle: float = 40.0,
) -> Scene:
    """
    Turn a trimesh object into a scene, with its colours, materials, camera and lights.

    Parameters
    ----------
    what : trimesh.Trimesh or trimesh.Scene
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
        A ``ValueError``: if it holds no faces or an invalid mesh.
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
    scene = _Adapter(source, on_invalid, crease_angle, left_out, None).scene(what)
    left_out.warn(source)
    return scene


def as_scene(what: Any) -> Scene:
    """
    Return anything that can be drawn as a scene.

    Parameters
    ----------
    what : Scene, Mesh, trimesh.Trimesh or trimesh.Scene
        A scene is returned as it is.

    Raises
    ------
    ValueError
        If it is none of these, or a trimesh object without faces.
    """
    if isinstance(what, Scene):
        return what
    if isinstance(what, Mesh):
        scene = Scene()
        scene.add(what)
        return scene
    if _is_trimesh(what):
        return from_trimesh(what)
    hint = "; rasterjit.load reads files" if isinstance(what, (str, os.PathLike)) else ""
    raise ValueError(
        "what must be a Scene, a Mesh, a trimesh.Trimesh or a trimesh.Scene, "
        f"got {type(what).__name__}{hint}"
    )


def _is_trimesh(what: Any) -> bool:
    """Tell trimesh's objects, which only exist if somebody has imported it."""
    trimesh = sys.modules.get("trimesh")
    return trimesh is not None and isinstance(what, (trimesh.parent.Geometry, trimesh.Scene))


def _checked_path(path: str | os.PathLike[str]) -> Path:
    """Return the path of an existing file, or raise `MeshFileError`."""
    if not isinstance(path, (str, os.PathLike)):
        raise MeshFileError(f"path must be a file name, got {type(path).__name__}")
    file = Path(path).expanduser()
    if file.is_dir():
        raise MeshFileError(f"{file} is a folder, not a mesh file")
    if not file.is_file():
        raise MeshFileError(f"{file} does not exist")
    if file.stat().st_size == 0:
        raise MeshFileError(f"{file} is empty")
    return file


def _extension(file: Path) -> str:
    """Return a file's extension as trimesh names it: lower case, no dot."""
    name = file.name.lower()
    double = [ending for ending in ("tar.gz", "tar.bz2") if name.endswith("." + ending)]
    return double[0] if double else file.suffix.lower().removeprefix(".")


def _read(file: Path) -> trimesh.Scene:
    """Read a file with trimesh, or raise `MeshFileError`."""
    import trimesh

    extension = _extension(file)
    loaders = trimesh.exchange.load
    known = loaders.available_formats() | set(loaders.voxel_loaders)
    if extension not in known and extension not in loaders.mesh_loaders:
        shown = ", ".join(f".{name}" for name in _SHOWN_FORMATS if name in known)
        kind = f"the extension .{extension}" if extension else "no extension"
        raise MeshFileError(f"{file} has {kind}; readable formats are {shown} and more")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return trimesh.load_scene(file, process=False)
    except ImportError as error:
        raise MeshFileError(
            f"{file}: reading .{extension} needs a package that is not installed ({error}); "
            "pip install 'rasterjit[formats]' brings them"
        ) from error
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise MeshFileError(f"{file} could not be read as .{extension}: {reason}") from error


class _Adapter:
    """Carry what one conversion needs: where it comes from, its settings, what is left out."""

    def __init__(
        self,
        source: str,
        on_invalid: str,
        crease_angle: float,
        left_out: LeftOut,
        extras: GltfExtras | None,
    ) -> None:
        self.source = source
        self.on_invalid = on_invalid
        self.crease_angle = crease_angle
        self.left_out = left_out
        self.extras = extras
        self.materials: dict[int, Material | None] = {}
        self.from_file = not source.startswith("trimesh ")

    def scene(self, loaded: Any) -> Scene:
        """Return a trimesh geometry or scene as a `Scene`, or raise `MeshFileError`."""
        import trimesh

        if not isinstance(loaded, trimesh.Scene):
            return self.scene(trimesh.Scene(loaded))
        meshes: dict[str, Mesh] = {}
        left: Counter[str] = Counter()
        for name, geometry in loaded.geometry.items():
            if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
                meshes[name] = self._mesh(name, geometry)
            else:
                left[_describe(geometry)] += 1
        if not meshes:
            held = f"{' and '.join(left)}, no faces" if left else "no faces"
            raise MeshFileError(f"{self.source} holds {held}")
        for what, count in left.items():
            self.left_out.note(what, count)
        scene = Scene()
        for node in loaded.graph.nodes_geometry:
            try:
                transform, name = loaded.graph[node]
            except ValueError:
                self.left_out.note("node that hangs on no other")
                continue
            if name in meshes:
                self._place(scene, meshes[name], transform, str(node))
        if not scene.nodes:
            raise MeshFileError(f"{self.source} holds meshes but places none of them in its scene")
        if self.extras is not None:
            scene.camera, scene.lights = self.extras.camera, self.extras.lights
        else:
            self._take_camera(loaded, scene)
            self._take_lights(loaded, scene)
        return scene

    def _place(self, scene: Scene, mesh: Mesh, transform: Any, name: str) -> None:
        """Add one node, naming it in errors."""
        try:
            scene.add(mesh, transform, name)
        except ValueError as error:
            raise MeshFileError(f"{self.source}: node {name!r}: {error}") from error

    def _mesh(self, name: str, geometry: Any) -> Mesh:
        """Return one trimesh.Trimesh as a `Mesh` with normals, naming it in errors."""
        source = getattr(geometry.source, "file_type", None)
        colors = colors_from_trimesh(geometry, source in _GLTF, self.left_out)
        material, uv = None, None
        if geometry.visual.kind == "texture":
            material = self._material(geometry.visual.material)
            uv = self._finite_rows("uv", geometry.visual.uv, (len(geometry.vertices), 2))
        normals = self._own_normals(geometry)
        try:
            mesh = Mesh(
                geometry.vertices,
                geometry.faces,
                normals=normals,
                uv=uv,
                material=material,
                colors=colors,
                on_invalid=self.on_invalid,
            )
            return mesh if normals is not None else mesh.split_creases(self.crease_angle)
        except ValueError as error:
            raise MeshFileError(f"{self.source}: mesh {name!r}: {error}") from error

    def _material(self, material: Any) -> Material | None:
        """Return one trimesh material as a `Material`, the same one for all meshes that share it."""
        if id(material) not in self.materials:
            unlit = set() if self.extras is None else self.extras.unlit
            self.materials[id(material)] = material_from_trimesh(material, unlit, self.left_out)
        return self.materials[id(material)]

    def _own_normals(self, geometry: Any) -> NDArray[np.float64] | None:
        """Return the normals that somebody gave the mesh, not those that trimesh averaged."""
        if "vertex_normals" not in geometry._cache:
            return None
        normals = np.asarray(geometry.vertex_normals)
        if not self.from_file:
            from trimesh.geometry import weighted_vertex_normals

            averaged = weighted_vertex_normals(
                len(geometry.vertices), geometry.faces, geometry.face_normals, geometry.face_angles
            )
            if np.array_equal(normals, averaged):
                return None
        if not normals.any():
            return None
        return self._finite_rows("normals", normals, (len(geometry.vertices), 3))

    def _finite_rows(
        self, name: str, values: Any, shape: tuple[int, int]
    ) -> NDArray[np.float64] | None:
        """Return values that fit the vertices, or None with a note if they do not."""
        if values is None:
            return None
        array = np.asarray(values, dtype=np.float64)
        if array.shape != shape:
            self.left_out.note(f"{name} that do not fit the vertices")
            return None
        if not np.isfinite(array).all():
            self.left_out.note(f"{name} with NaN or infinity")
            return None
        return array

    def _take_camera(self, loaded: Any, scene: Scene) -> None:
        """Take the camera that a trimesh scene has, never the one it would make up."""
        if not loaded.has_camera:
            return
        camera = loaded.camera
        try:
            pose = np.asarray(loaded.camera_transform, dtype=np.float64)
            eye = pose[:3, 3]
            scene.camera = PerspectiveCamera(
                eye,
                eye - pose[:3, 2],
                pose[:3, 1],
                fov_y=float(camera.fov[1]),
                near=camera.z_near,
                far=math.inf if camera.z_far == _TRIMESH_FAR else camera.z_far,
            )
        except ValueError:
            self.left_out.note("camera that is not a usable perspective")

    def _take_lights(self, loaded: Any, scene: Scene) -> None:
        """Take the lights somebody gave a trimesh scene; their bytes are linear light."""
        lights = getattr(loaded, "_lights", None) or []
        if _made_up(loaded, lights):
            return
        for light in lights:
            pose = np.eye(4)
            if light.name in loaded.graph.nodes:
                pose = np.asarray(loaded.graph[light.name][0], dtype=np.float64)
            color = np.asarray(light.color[:3], dtype=np.float64) / 255.0
            kind = type(light).__name__
            if kind == "DirectionalLight":
                scene.lights.append(DirectionalLight(-pose[:3, 2], color, light.intensity))
            elif kind == "PointLight":
                scene.lights.append(PointLight(pose[:3, 3], color, light.intensity))
            else:
                self.left_out.note(kind)


def _made_up(loaded: Any, lights: list[Any]) -> bool:
    """Tell the two point lights that trimesh puts at a scene's corners when asked for lights."""
    from trimesh.scene.lighting import PointLight as TrimeshPointLight

    plain = TrimeshPointLight()
    return len(lights) == 2 and all(
        type(light) is TrimeshPointLight
        and light.name.startswith("light_")
        and light.intensity == plain.intensity
        and np.array_equal(light.color, plain.color)
        and light.name in loaded.graph.nodes
        and np.array_equal(loaded.graph[light.name][0][:3, 3], corner)
        for light, corner in zip(lights, loaded.bounds, strict=True)
    )


def _describe(geometry: Any) -> str:
    """Say what a geometry without faces is."""
    kind = type(geometry).__name__
    vertices = len(getattr(geometry, "vertices", ()))
    if kind == "PointCloud":
        return f"a point cloud of {vertices} points"
    if kind == "Path2D":
        return f"a 2-D drawing of {len(geometry.entities)} curves"
    if kind == "Path3D":
        return f"a 3-D path of {len(geometry.entities)} curves"
    if kind == "Trimesh":
        return f"a mesh of {vertices} vertices"
    return f"a {kind}"
