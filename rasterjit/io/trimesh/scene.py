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
from rasterjit.io.gltf.meshes_materials import TEXTURES
from rasterjit.io.gltf.scene import GLTF_FORMATS
from rasterjit.io.images import image_pixels, take_texels
from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
from rasterjit.io.primitives import Cloud, Reading, drawing_of_path
from rasterjit.io.text import mesh_builder
from rasterjit.io.text.mtl import MAX_SHININESS, MtlMaterial, material_from_mtl
from rasterjit.scene.camera import PerspectiveCamera, mirrors
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.light import (
    BRIGHTEST,
    WIDEST_CONE,
    DirectionalLight,
    Light,
    PointLight,
    SpotLight,
)
from rasterjit.scene.material import AlphaMode, Material
from rasterjit.scene.memory_limits import MemoryBudget
from rasterjit.scene.scene import Scene
from rasterjit.scene.texture import ColorSpace, Texture
from rasterjit.scene.transforms import compose

ALPHA_MODES: dict[str, AlphaMode] = {"MASK": "mask", "BLEND": "blend"}

_DIELECTRIC = 0.04
"""Reflectance of a non-metal seen head-on, as glTF 2.0 fixes it (appendix B)."""

_PLACEHOLDER = (100, 100, 100, 255)
"""The colour of the 2×2 pixels that trimesh puts where a material has no picture."""


def material_from_trimesh(
    material: Any,
    is_gltf: bool,
    left_out: LeftOut,
    textures: TextureReader | None = None,
) -> Material | None:
    """
    Translate a material as trimesh has it.

    Parameters
    ----------
    material : trimesh.visual.material.Material
    is_gltf : bool
        Whether a PBR material is one as glTF has them, or, as in COLLADA, another model's values
        under its names: then its factors are sRGB, and it becomes Blinn-Phong.
    left_out : LeftOut
        Notes what is not shown.
    textures : TextureReader, optional

    Returns
    -------
    Material or None
        None for a kind that says nothing.
    """
    kind = type(material).__name__
    textures = TextureReader(left_out) if textures is None else textures
    label = f"material {material.name!r}"
    if kind == "SimpleMaterial":
        texture = textures.read(material.image, f"base_color_texture of {label}")
        said = MtlMaterial(
            material.name, material.diffuse, material.specular, material.glossiness, material.kwargs
        )
        return material_from_mtl(said, texture, False, left_out)
    if kind == "PBRMaterial":
        found = {
            field: textures.read(getattr(material, name, None), f"{field} of {label}", color_space)
            for field, (name, color_space) in TEXTURES.items()
        }
        return _from_gltf(material, found) if is_gltf else _from_pbr(material, found, left_out)
    left_out.note(kind)
    return None


def colors_from_trimesh(
    mesh: Any, linear_bytes: bool, left_out: LeftOut
) -> NDArray[np.float32] | None:
    """
    Return a trimesh's vertex or face colours as linear RGBA.

    Parameters
    ----------
    mesh : trimesh.Trimesh
    linear_bytes : bool
        Whether the bytes are linear light, as in glTF, or sRGB, as elsewhere.
    left_out : LeftOut
        Notes colours whose number fits neither vertices nor faces.

    Returns
    -------
    (V, 4) or (F, 4) float32, or None
    """
    visual = mesh.visual
    if visual.kind in ("vertex", "face"):
        colors = getattr(visual, f"{visual.kind}_colors")
        rows = len(mesh.vertices) if visual.kind == "vertex" else len(mesh.faces)
    else:
        attributes = getattr(visual, "vertex_attributes", None)
        colors = None if attributes is None else attributes.get("color")
        rows = len(mesh.vertices)
    if colors is None:
        return None
    colors = np.asarray(colors)
    if colors.ndim != 2 or colors.shape[0] != rows or colors.shape[1] not in (3, 4):
        left_out.note("colours that fit neither vertices nor faces")
        return None
    return mesh_builder.linear_rgba(colors, linear_bytes)


def _from_gltf(material: Any, textures: dict[str, Any]) -> Material:
    """Return a metallic-roughness material of glTF as one of ours."""
    mode = ALPHA_MODES.get(material.alphaMode, "opaque")
    red, green, blue, alpha = _base_color(material, True)
    cutoff = 0.5 if material.alphaCutoff is None else material.alphaCutoff
    emitted = (0.0, 0.0, 0.0) if material.emissiveFactor is None else material.emissiveFactor
    return Material(
        shading="pbr",
        base_color=(red, green, blue, 1.0 if mode == "opaque" else alpha),
        metallic=_share(material.metallicFactor),
        roughness=_share(material.roughnessFactor),
        emissive=np.clip(np.nan_to_num(np.asarray(emitted, np.float64)), 0.0, BRIGHTEST),
        name=material.name,
        alpha_mode=mode,
        alpha_cutoff=min(max(float(cutoff), 0.0), 1.0),
        double_sided=bool(material.doubleSided),
        **textures,
    )


def _base_color(material: Any, linear_bytes: bool) -> tuple[float, float, float, float]:
    """Return the base colour of a PBR material, linear RGBA."""
    factor = material.baseColorFactor
    if factor is None:
        return (1.0, 1.0, 1.0, 1.0)
    rgba = (np.asarray(factor, dtype=np.float64) / 255.0).tolist()
    if not linear_bytes:
        rgba[:3] = srgb_to_linear(np.asarray(factor, dtype=np.uint8)[:3]).tolist()
    return tuple(rgba)


def _share(factor: float | None) -> float:
    """Return a factor of a PBR material, 1 where there is none, clamped to 0..1."""
    return 1.0 if factor is None else min(max(float(factor), 0.0), 1.0)


def _from_pbr(material: Any, textures: dict[str, Any], left_out: LeftOut) -> Material:
    """
    Translate a metallic-roughness material, its colours in sRGB, to Blinn-Phong.

    With roughness r, the microfacet width is α = r², the exponent n = 2/α² - 2, limited to
    1..1000. The strength is ``min(1, F0 (n + 8) / 8)``, the height of the normalised lobe over
    reflectance F0. That is 0.04, and for metals goes to the mean base colour as far as they are
    smooth: ``F0 = 0.04 + (mean - 0.04) metallic (1 - r)``. (A rough metal's lobe is so wide that
    Blinn-Phong would only wash its colour out.)

    References
    ----------
    B. Walter et al., "Microfacet models for refraction through rough surfaces", EGSR 2007.
    T. Akenine-Möller et al., "Real-Time Rendering", 4th edition, section 9.8.
    """
    rgba = _base_color(material, False)
    mode = ALPHA_MODES.get(material.alphaMode, "opaque")
    if mode == "opaque":
        rgba = (*rgba[:3], 1.0)
    emitted = (0.0, 0.0, 0.0) if material.emissiveFactor is None else material.emissiveFactor
    if textures["metallic_roughness_texture"] is not None:
        left_out.note(f"metallic_roughness_texture of material {material.name!r}")
    roughness, metallic = _share(material.roughnessFactor), _share(material.metallicFactor)
    shininess = MAX_SHININESS
    # A power is the math library's affair; products have the same bits everywhere.
    alpha = roughness * roughness
    if alpha * alpha > 0.0:
        shininess = min(max(2.0 / (alpha * alpha) - 2.0, 1.0), MAX_SHININESS)
    mean = sum(rgba[:3]) / 3.0
    reflectance = _DIELECTRIC + (mean - _DIELECTRIC) * metallic * (1.0 - roughness)
    return Material(
        base_color=rgba,
        specular=min(1.0, max(0.0, reflectance) * (shininess + 8.0) / 8.0),
        shininess=shininess,
        name=material.name,
        emissive=np.clip(np.nan_to_num(np.asarray(emitted, np.float64)), 0.0, BRIGHTEST),
        alpha_mode=mode,
        **{**textures, "metallic_roughness_texture": None},
    )


class TextureReader:
    """
    Read the pictures of trimesh's materials, each once for every use.

    They say nothing about sampling: they repeat, trilinear.

    Parameters
    ----------
    left_out : LeftOut
        Notes pictures that cannot be read.
    budget : MemoryBudget, optional
        Counts the texels of pictures that are yet to be decoded.
    """

    def __init__(self, left_out: LeftOut, budget: MemoryBudget | None = None) -> None:
        self._left_out = left_out
        self._budget = budget
        self._known: dict[tuple[int, str], Texture | None] = {}

    def read(self, image: Any, label: str, color_space: ColorSpace = "srgb") -> Texture | None:
        """Return a Pillow image as a texture; None if there is none to show."""
        if image is None or is_placeholder(image):
            return None
        key = id(image), color_space
        if key not in self._known:
            try:
                if self._budget is not None:
                    take_texels(image.size, label, self._budget)
                self._known[key] = Texture(image_pixels(image), color_space=color_space)
            except (OSError, SyntaxError, ValueError, AttributeError) as error:
                self._left_out.note(f"{label} that cannot be read: {reason_of(error)}")
                self._known[key] = None
        return self._known[key]


def is_placeholder(image: Any) -> bool:
    """Tell trimesh's stand-in for a missing image from a real one."""
    if getattr(image, "size", (2, 2)) != (2, 2):
        # Looking at it would decode it.
        return False
    try:
        pixels = np.asarray(image)
    except (OSError, SyntaxError):
        return False
    return pixels.shape == (2, 2, 4) and bool((pixels == _PLACEHOLDER).all())


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
    reading : Reading
    from_file : bool
        Whether trimesh has just read it, so that all its normals are the file's.
    """

    def __init__(self, reading: Reading, from_file: bool) -> None:
        self.reading, self.source, self.left_out = reading, reading.source, reading.left_out
        self.textures = TextureReader(reading.left_out, reading.budget)
        self.materials: dict[int, Material | None] = {}
        self.from_file = from_file

    def scene(self, loaded: Any) -> Scene:
        """Return a trimesh geometry or scene as a `Scene`, or raise `MeshFileError`."""
        return mesh_builder.scene_of_assembly(self.assembly(loaded), self.reading)

    def assembly(self, loaded: Any) -> mesh_builder.Assembly:
        """Return what a trimesh geometry or scene holds, or raise `MeshFileError`."""
        import trimesh

        if not isinstance(loaded, trimesh.Scene):
            return self.assembly(trimesh.Scene(loaded))
        things: list[mesh_builder.Thing] = []
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
        return mesh_builder.Assembly(
            things, places, drawn, self._camera(loaded), self._lights(loaded)
        )

    def _thing(self, name: str, geometry: Any) -> mesh_builder.Thing | None:
        """Return a geometry as a mesh, lines or points; None if there is nothing in it."""
        import trimesh

        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            return self._mesh(name, geometry)
        if isinstance(geometry, (trimesh.Trimesh, trimesh.PointCloud)) and len(geometry.vertices):
            return self._cloud(name, geometry)
        if isinstance(geometry, trimesh.path.path.Path):
            return drawing_of_path(name, geometry, self.reading)
        return None

    def _cloud(self, name: str, geometry: Any) -> Cloud:
        """Return the points of a geometry without faces."""
        colors = getattr(geometry, "colors", None)
        rgba = None
        if colors is not None and np.shape(colors) == (len(geometry.vertices), 4):
            rgba = mesh_builder.linear_rgba(mesh_builder.srgb_bytes(np.asarray(colors)), False)
        attributes = getattr(geometry, "vertex_attributes", None) or {}
        return Cloud(name, np.asarray(geometry.vertices), rgba, None, dict(attributes))

    def _places(
        self, graph: Any, numbers: dict[str, int]
    ) -> tuple[list[mesh_builder.Place], list[int]]:
        """Return where meshes stand and what they hang below, and which places have one."""
        places: list[mesh_builder.Place] = []
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
        places: list[mesh_builder.Place],
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
                places.append(mesh_builder.Place(str(name), np.asarray(step), number))
            number = made[name]
        return made[key]

    def _mesh(self, name: str, geometry: Any) -> mesh_builder.Part:
        """Return one trimesh.Trimesh as a `Part`."""
        source = getattr(geometry.source, "file_type", None)
        colors = colors_from_trimesh(geometry, source in GLTF_FORMATS, self.left_out)
        material, uv = None, None
        if geometry.visual.kind == "texture":
            # A PBR material made in memory is glTF's, as trimesh documents it.
            material = self._material(geometry.visual.material, source in (None, *GLTF_FORMATS))
            uv = self._finite_rows("uv", geometry.visual.uv, (len(geometry.vertices), 2))
        return mesh_builder.Part(
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
