"""Turn trimesh's scenes into ours: meshes, places, cameras and lights."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io import cameras
from rasterjit.io.assembly import Assembly, Place, scene_of_assembly
from rasterjit.io.drawings import drawing_of_path
from rasterjit.io.gltf.scene import GLTF_FORMATS
from rasterjit.io.point_clouds.cloud import Cloud
from rasterjit.io.skipped import LeftOut, MeshFileError
from rasterjit.io.text.parts import Part, Thing, linear_rgba, srgb_bytes
from rasterjit.io.trimesh.materials import (
    TextureReader,
    colors_from_trimesh,
    material_from_trimesh,
)
from rasterjit.scene.camera import PerspectiveCamera, mirrors
from rasterjit.scene.light import WIDEST_CONE, DirectionalLight, Light, PointLight, SpotLight
from rasterjit.scene.material import Material
from rasterjit.scene.memory import MemoryBudget
from rasterjit.scene.mesh import OnInvalid
from rasterjit.scene.scene import Scene
from rasterjit.scene.transforms import compose

_SUMMATION = 1e-12
"""By how much averages may differ that are summed in another order; float32 is coarser."""

_SAME_TRANSFORM = 1e-4
"""Share of its largest entry by which two ways to compute a transform may differ: ten times what
trimesh repairs."""


class TrimeshAdapter:
    """
    Turn trimesh objects into a scene.

    Parameters
    ----------
    source : str
        What messages call the file or object.
    from_file : bool
        Whether trimesh has just read it, so that all its normals are the file's.
    on_invalid : {"raise", "drop"}
        What to do about NaN or infinite vertices, as in `Mesh`.
    crease_angle : float
        Degrees in 0..180, for meshes without normals of their own.
    left_out : LeftOut
        Notes what is not shown.
    budget : MemoryBudget, optional
        Counts the texels of pictures.
    """

    def __init__(
        self,
        source: str,
        from_file: bool,
        on_invalid: OnInvalid,
        crease_angle: float,
        left_out: LeftOut,
        budget: MemoryBudget | None = None,
    ) -> None:
        self.source = source
        self.on_invalid = on_invalid
        self.crease_angle = crease_angle
        self.left_out = left_out
        self.budget = budget
        self.textures = TextureReader(left_out, budget)
        self.materials: dict[int, Material | None] = {}
        self.from_file = from_file

    def scene(self, loaded: Any) -> Scene:
        """Return a trimesh geometry or scene as a `Scene`, or raise `MeshFileError`."""
        found = self.assembly(loaded)
        return scene_of_assembly(
            found, self.source, self.on_invalid, self.crease_angle, self.left_out, self.budget
        )

    def assembly(self, loaded: Any) -> Assembly:
        """Return what a trimesh geometry or scene holds, or raise `MeshFileError`."""
        import trimesh

        if not isinstance(loaded, trimesh.Scene):
            return self.assembly(trimesh.Scene(loaded))
        things: list[Thing] = []
        numbers: dict[str, int] = {}
        left: Counter[str] = Counter()
        for name, geometry in loaded.geometry.items():
            made = self._thing(name, geometry)
            if made is None:
                left[_describe(geometry)] += 1
            else:
                numbers[name] = len(things)
                things.append(made)
        if not things:
            held = f"{' and '.join(left)}, " if left else ""
            named = f" ({self.left_out})" if str(self.left_out) else ""
            raise MeshFileError(f"{self.source} holds {held}no faces, lines or points{named}")
        for what, count in left.items():
            self.left_out.note(what, count)
        places, drawn = self._places(loaded.graph, numbers)
        if not drawn:
            raise MeshFileError(f"{self.source} holds meshes but places none of them in its scene")
        return Assembly(things, places, drawn, self._camera(loaded), self._lights(loaded))

    def _thing(self, name: str, geometry: Any) -> Thing | None:
        """Return a geometry as a mesh, lines or points; None if there is nothing in it."""
        import trimesh

        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            return self._mesh(name, geometry)
        if isinstance(geometry, (trimesh.Trimesh, trimesh.PointCloud)) and len(geometry.vertices):
            return self._cloud(name, geometry)
        if isinstance(geometry, trimesh.path.path.Path):
            return drawing_of_path(
                name, geometry, self.source, self.on_invalid, self.left_out, self.budget
            )
        return None

    def _cloud(self, name: str, geometry: Any) -> Cloud:
        """Return the points of a geometry without faces."""
        colors = getattr(geometry, "colors", None)
        rgba = None
        if colors is not None and np.shape(colors) == (len(geometry.vertices), 4):
            rgba = linear_rgba(srgb_bytes(np.asarray(colors)), False)
        attributes = getattr(geometry, "vertex_attributes", None) or {}
        return Cloud(name, np.asarray(geometry.vertices), rgba, None, dict(attributes))

    def _places(self, graph: Any, numbers: dict[str, int]) -> tuple[list[Place], list[int]]:
        """Return where meshes stand and what they hang below, and which places have one."""
        places: list[Place] = []
        made: dict[Any, int] = {}
        drawn = []
        for key in graph.nodes_geometry:
            try:
                rough, name = graph[key]
            except ValueError:
                self.left_out.note("node that hangs on no other")
                continue
            if name in numbers:
                number = self._place(graph, key, rough, made, places)
                places[number] = replace(places[number], thing=numbers[name])
                drawn.append(number)
        return places, drawn

    def _place(
        self, graph: Any, key: Any, rough: NDArray[np.float64], made: dict[Any, int],
        places: list[Place],
    ) -> int:  # fmt: skip
        """
        Return the number of a key's place; it and those above are made unless they are.

        Transforms are multiplied in an order that is the same on every CPU: trimesh takes products
        from BLAS, drops transforms within 1e-8 of the identity and passes what is nearly rigid
        through an SVD. ``rough`` is its transform; where the steps do not lead to it, the node
        stands there, below none.
        """
        if key in made:
            return made[key]
        edges = graph.transforms.edge_data
        path = graph.transforms.shortest_path(graph.base_frame, key)
        steps = [edges.get(pair, {}).get("matrix") for pair in pairwise(path)]
        if _leads_to(steps, rough):
            # A product has other zeros than its factor: all are products.
            steps[0] = compose(steps[0])
        else:
            path, steps = [key], [rough]
        number = None
        # Everything hangs below trimesh's base, which is the world: it is no node.
        for name, step in zip(path[-len(steps) :], steps, strict=True):
            if name not in made:
                made[name] = len(places)
                places.append(Place(str(name), np.asarray(step), number))
            number = made[name]
        return made[key]

    def _mesh(self, name: str, geometry: Any) -> Part:
        """Return one trimesh.Trimesh as a `Part`."""
        source = getattr(geometry.source, "file_type", None)
        colors = colors_from_trimesh(geometry, source in GLTF_FORMATS, self.left_out)
        material, uv = None, None
        if geometry.visual.kind == "texture":
            # A PBR material made in memory is glTF's, as trimesh documents it.
            material = self._material(geometry.visual.material, source in (None, *GLTF_FORMATS))
            uv = self._finite_rows("uv", geometry.visual.uv, (len(geometry.vertices), 2))
        return Part(
            str(name), np.asarray(geometry.vertices), np.asarray(geometry.faces),
            self._own_normals(geometry), uv, colors, material,
            dict(geometry.vertex_attributes), dict(geometry.face_attributes),
        )  # fmt: skip

    def _material(self, material: Any, is_gltf: bool) -> Material | None:
        """Return a trimesh material as a `Material`, one for all meshes that share it."""
        if id(material) not in self.materials:
            self.materials[id(material)] = material_from_trimesh(
                material, is_gltf, self.left_out, self.textures
            )
        return self.materials[id(material)]

    def _own_normals(self, geometry: Any) -> NDArray[np.float64] | None:
        """Return the normals that somebody gave the mesh, not those that trimesh averaged."""
        if "vertex_normals" not in geometry._cache:
            return None
        normals = np.asarray(geometry.vertex_normals)
        if not self.from_file and _are_averaged(normals, geometry):
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

    def _camera(self, loaded: Any) -> PerspectiveCamera | None:
        """Return the camera that a trimesh scene has, never the one it would make up."""
        if not loaded.has_camera:
            return None
        try:
            pose = np.asarray(loaded.camera_transform, dtype=np.float64)
            if mirrors(pose):
                self.left_out.note("camera whose pose mirrors")
                return None
            return cameras.perspective_from_trimesh(loaded.camera, pose)
        except ValueError:
            self.left_out.note("camera that is not a usable perspective")
            return None

    def _lights(self, loaded: Any) -> list[Light]:
        """Return the lights somebody gave a trimesh scene; their bytes are linear light."""
        found: list[Light] = []
        lights = getattr(loaded, "_lights", None) or []
        if _made_up(loaded, lights):
            return found
        for light in lights:
            pose = np.eye(4)
            if light.name in loaded.graph.nodes:
                pose = np.asarray(loaded.graph[light.name][0], dtype=np.float64)
            color = np.asarray(light.color[:3], dtype=np.float64) / 255.0
            kind = type(light).__name__
            if kind == "DirectionalLight":
                found.append(DirectionalLight(-pose[:3, 2], color, light.intensity))
            elif kind == "PointLight":
                found.append(PointLight(pose[:3, 3], color, light.intensity))
            elif kind == "SpotLight":
                found += self._spot(light, pose, color)
            else:
                self.left_out.note(kind)
        return found

    def _spot(
        self, light: Any, pose: NDArray[np.float64], color: NDArray[np.float64]
    ) -> list[SpotLight]:
        """Return a spot light, whose angles trimesh has in radians, if its cone is usable."""
        try:
            return [
                SpotLight(
                    pose[:3, 3],
                    -pose[:3, 2],
                    color,
                    light.intensity,
                    inner_angle=math.degrees(light.innerConeAngle),
                    outer_angle=min(math.degrees(light.outerConeAngle), WIDEST_CONE),
                )
            ]
        except ValueError:
            self.left_out.note("SpotLight without a usable cone")
            return []


def _leads_to(steps: list[Any], rough: NDArray[np.float64]) -> bool:
    """Tell whether a product is a transform but for the rounding of float32 and of a repair."""
    if not steps or any(step is None for step in steps):
        return False
    try:
        product = compose(*steps)
    except ValueError:
        return False
    largest = np.abs(rough).max(initial=0.0)
    return bool((np.abs(product - rough) <= _SAME_TRANSFORM * largest).all())


def _are_averaged(normals: NDArray[np.float64], geometry: Any) -> bool:
    """
    Tell whether normals are those of the faces around each vertex, weighted by their angles.

    So trimesh averages them: with SciPy, or much slower and in another order without.
    """
    from trimesh.util import unitize

    sound = (geometry.face_normals**2).sum(axis=1) > 0.5
    corners = geometry.faces[sound].ravel()
    angles = geometry.face_angles[sound][:, :, np.newaxis]
    shares = (angles * geometry.face_normals[sound][:, np.newaxis]).reshape(-1, 3)
    count = len(geometry.vertices)
    sums = [np.bincount(corners, column, count) for column in shares.T]
    averaged = unitize(np.stack(sums, axis=1))
    if averaged.shape != normals.shape:
        return False
    return bool((np.abs(normals - averaged) <= _SUMMATION).all())


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
