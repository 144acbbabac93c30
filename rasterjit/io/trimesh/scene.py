"""Convert trimesh's scenes: meshes, nodes, cameras and lights."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io import cameras
from rasterjit.io.gltf.meshes_materials import TEXTURE_PROPERTIES
from rasterjit.io.gltf.scene import GLTF_FORMATS
from rasterjit.io.images import convert_pillow_image, take_texel_memory
from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
from rasterjit.io.primitives import Cloud, Context, convert_path
from rasterjit.io.text import mesh_builder
from rasterjit.io.text.mtl import MAX_SHININESS, MtlMaterial, convert_mtl_material
from rasterjit.scene.camera import PerspectiveCamera, mirrors
from rasterjit.scene.color import srgb_to_linear
from rasterjit.scene.light import (
    MAX_CONE_ANGLE,
    MAX_RADIANCE,
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

_PLACEHOLDER_COLOR = (100, 100, 100, 255)
"""Colour of the 2×2 image that trimesh puts where a material has no image."""


def material_from_trimesh(
    material: Any,
    is_gltf: bool,
    left_out: LeftOut,
    textures: TextureReader | None = None,
) -> Material | None:
    """
    Convert a material of trimesh to `Material`.

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
        mtl_material = MtlMaterial(
            material.name, material.diffuse, material.specular, material.glossiness, material.kwargs
        )
        return convert_mtl_material(mtl_material, texture, False, left_out)
    if kind == "PBRMaterial":
        loaded = {
            field: textures.read(getattr(material, name, None), f"{field} of {label}", color_space)
            for field, (name, color_space) in TEXTURE_PROPERTIES.items()
        }
        if is_gltf:
            return _convert_gltf(material, loaded)
        return _convert_pbr(material, loaded, left_out)
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
    return mesh_builder.to_linear_rgba(colors, linear_bytes)


def _convert_gltf(material: Any, textures: dict[str, Any]) -> Material:
    """Convert a metallic-roughness material of glTF."""
    mode = ALPHA_MODES.get(material.alphaMode, "opaque")
    red, green, blue, alpha = _read_base_color(material, True)
    cutoff = 0.5 if material.alphaCutoff is None else material.alphaCutoff
    emissive = (0.0, 0.0, 0.0) if material.emissiveFactor is None else material.emissiveFactor
    return Material(
        shading="pbr",
        base_color=(red, green, blue, 1.0 if mode == "opaque" else alpha),
        metallic=_clamp_factor(material.metallicFactor),
        roughness=_clamp_factor(material.roughnessFactor),
        emissive=np.clip(np.nan_to_num(np.asarray(emissive, np.float64)), 0.0, MAX_RADIANCE),
        name=material.name,
        alpha_mode=mode,
        alpha_cutoff=min(max(float(cutoff), 0.0), 1.0),
        double_sided=bool(material.doubleSided),
        **textures,
    )


def _read_base_color(material: Any, linear_bytes: bool) -> tuple[float, float, float, float]:
    """Return the base colour of a PBR material, linear RGBA."""
    factor = material.baseColorFactor
    if factor is None:
        return (1.0, 1.0, 1.0, 1.0)
    rgba = (np.asarray(factor, dtype=np.float64) / 255.0).tolist()
    if not linear_bytes:
        rgba[:3] = srgb_to_linear(np.asarray(factor, dtype=np.uint8)[:3]).tolist()
    return tuple(rgba)


def _clamp_factor(factor: float | None) -> float:
    """Return a factor of a PBR material, default 1, clamped to 0..1."""
    return 1.0 if factor is None else min(max(float(factor), 0.0), 1.0)


def _convert_pbr(material: Any, textures: dict[str, Any], left_out: LeftOut) -> Material:
    """
    Convert a metallic-roughness material, with sRGB colours, to Blinn-Phong.

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
    rgba = _read_base_color(material, False)
    mode = ALPHA_MODES.get(material.alphaMode, "opaque")
    if mode == "opaque":
        rgba = (*rgba[:3], 1.0)
    emissive = (0.0, 0.0, 0.0) if material.emissiveFactor is None else material.emissiveFactor
    if textures["metallic_roughness_texture"] is not None:
        left_out.note(f"metallic_roughness_texture of material {material.name!r}")
    roughness = _clamp_factor(material.roughnessFactor)
    metallic = _clamp_factor(material.metallicFactor)
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
        emissive=np.clip(np.nan_to_num(np.asarray(emissive, np.float64)), 0.0, MAX_RADIANCE),
        alpha_mode=mode,
        **{**textures, "metallic_roughness_texture": None},
    )


class TextureReader:
    """
    Reads the images of trimesh's materials, each once.

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
        """Return a Pillow image as a texture; None for none and for a placeholder."""
        if image is None or is_placeholder(image):
            return None
        key = id(image), color_space
        if key not in self._known:
            try:
                if self._budget is not None:
                    take_texel_memory(image.size, label, self._budget)
                self._known[key] = Texture(convert_pillow_image(image), color_space=color_space)
            except (OSError, SyntaxError, ValueError, AttributeError) as error:
                self._left_out.note(f"{label} that cannot be read: {reason_of(error)}")
                self._known[key] = None
        return self._known[key]


def is_placeholder(image: Any) -> bool:
    """Tell whether an image is trimesh's placeholder for a missing one."""
    if getattr(image, "size", (2, 2)) != (2, 2):
        # Looking at it would decode it.
        return False
    try:
        pixels = np.asarray(image)
    except (OSError, SyntaxError):
        return False
    return pixels.shape == (2, 2, 4) and bool((pixels == _PLACEHOLDER_COLOR).all())


_NORMAL_TOLERANCE = 1e-12
"""Largest difference of averaged normals that were summed in another order."""

_TRANSFORM_TOLERANCE = 1e-4
"""Largest relative difference of a transform and the product of its steps: ten times what
trimesh repairs."""


class TrimeshAdapter:
    """
    Converts trimesh objects to scenes.

    Parameters
    ----------
    context : Context
    from_file : bool
        Whether trimesh has just read it, so that all its normals are the file's.
    """

    def __init__(self, context: Context, from_file: bool) -> None:
        self.context, self.source, self.left_out = context, context.source, context.left_out
        self.textures = TextureReader(context.left_out, context.budget)
        self.materials: dict[int, Material | None] = {}
        self.from_file = from_file

    def scene(self, loaded: Any) -> Scene:
        """Convert a trimesh geometry or scene to a `Scene`, or raise `MeshFileError`."""
        return mesh_builder.convert_record(self.scene_record(loaded), self.context)

    def scene_record(self, loaded: Any) -> mesh_builder.SceneRecord:
        """Convert a trimesh geometry or scene to plain data, or raise `MeshFileError`."""
        import trimesh

        if not isinstance(loaded, trimesh.Scene):
            return self.scene_record(trimesh.Scene(loaded))
        geometries: list[mesh_builder.Geometry] = []
        numbers: dict[str, int] = {}
        unshown: Counter[str] = Counter()
        for name, geometry in loaded.geometry.items():
            added = self._convert_geometry(name, geometry)
            if added is None:
                unshown[_describe(geometry)] += 1
            else:
                numbers[name] = len(geometries)
                geometries.append(added)
        if not geometries:
            content = f"{' and '.join(unshown)}, " if unshown else ""
            notes = f" ({self.left_out})" if str(self.left_out) else ""
            raise MeshFileError(f"{self.source} holds {content}no faces, lines or points{notes}")
        for what, count in unshown.items():
            self.left_out.note(what, count)
        nodes, mesh_nodes = self._convert_nodes(loaded.graph, numbers)
        if not mesh_nodes:
            raise MeshFileError(f"{self.source} holds meshes but places none of them in its scene")
        return mesh_builder.SceneRecord(
            geometries,
            nodes,
            mesh_nodes,
            self._convert_camera(loaded),
            self._convert_lights(loaded),
        )

    def _convert_geometry(self, name: str, geometry: Any) -> mesh_builder.Geometry | None:
        """Return a geometry as a mesh, line set or cloud; None if it is empty."""
        import trimesh

        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            return self._convert_mesh(name, geometry)
        if isinstance(geometry, (trimesh.Trimesh, trimesh.PointCloud)) and len(geometry.vertices):
            return self._convert_cloud(name, geometry)
        if isinstance(geometry, trimesh.path.path.Path):
            return convert_path(name, geometry, self.context)
        return None

    def _convert_cloud(self, name: str, geometry: Any) -> Cloud:
        """Return the vertices of a geometry without faces as a cloud."""
        colors = getattr(geometry, "colors", None)
        rgba = None
        if colors is not None and np.shape(colors) == (len(geometry.vertices), 4):
            rgba = mesh_builder.srgb_to_rgba(np.asarray(colors))
        attributes = getattr(geometry, "vertex_attributes", None) or {}
        return Cloud(name, np.asarray(geometry.vertices), rgba, None, dict(attributes))

    def _convert_nodes(
        self, graph: Any, numbers: dict[str, int]
    ) -> tuple[list[mesh_builder.NodeRecord], list[int]]:
        """Return the nodes of a scene graph, and the numbers of those with a geometry."""
        nodes: list[mesh_builder.NodeRecord] = []
        numbers_of_keys: dict[Any, int] = {}
        mesh_nodes = []
        for key in graph.nodes_geometry:
            try:
                transform, name = graph[key]
            except ValueError:
                self.left_out.note("node that hangs on no other")
                continue
            if name in numbers:
                number = self._get_node_number(graph, key, transform, numbers_of_keys, nodes)
                nodes[number] = replace(nodes[number], geometry=numbers[name])
                mesh_nodes.append(number)
        return nodes, mesh_nodes

    def _get_node_number(
        self, graph: Any, key: Any, transform: NDArray[np.float64], numbers_of_keys: dict[Any, int],
        nodes: list[mesh_builder.NodeRecord],
    ) -> int:  # fmt: skip
        """
        Return the number of a graph key's node, made with its ancestors if it does not exist.

        Transforms are multiplied in an order that is the same on every CPU: trimesh takes products
        from BLAS, drops transforms within 1e-8 of the identity and passes what is nearly rigid
        through an SVD. ``transform`` is its transform; where the steps do not lead to it, the node
        stands there, below none.
        """
        if key in numbers_of_keys:
            return numbers_of_keys[key]
        edges = graph.transforms.edge_data
        path = graph.transforms.shortest_path(graph.base_frame, key)
        steps = [edges.get(pair, {}).get("matrix") for pair in pairwise(path)]
        if _is_product(steps, transform):
            # A product has other zeros than its factor: all are products.
            steps[0] = compose(steps[0])
        else:
            path, steps = [key], [transform]
        number = None
        # Everything hangs below trimesh's base, which is the world: it is no node.
        for name, step in zip(path[-len(steps) :], steps, strict=True):
            if name not in numbers_of_keys:
                numbers_of_keys[name] = len(nodes)
                nodes.append(mesh_builder.NodeRecord(str(name), np.asarray(step), number))
            number = numbers_of_keys[name]
        return numbers_of_keys[key]

    def _convert_mesh(self, name: str, geometry: Any) -> mesh_builder.MeshData:
        """Return a trimesh.Trimesh as mesh data."""
        source = getattr(geometry.source, "file_type", None)
        colors = colors_from_trimesh(geometry, source in GLTF_FORMATS, self.left_out)
        material, uv = None, None
        if geometry.visual.kind == "texture":
            # A PBR material made in memory is glTF's, as trimesh documents it.
            material = self._convert_material(
                geometry.visual.material, source in (None, *GLTF_FORMATS)
            )
            uv = self._check_rows("uv", geometry.visual.uv, (len(geometry.vertices), 2))
        return mesh_builder.MeshData(
            str(name), np.asarray(geometry.vertices), np.asarray(geometry.faces),
            self._get_given_normals(geometry), uv, colors, material,
            dict(geometry.vertex_attributes), dict(geometry.face_attributes),
        )  # fmt: skip

    def _convert_material(self, material: Any, is_gltf: bool) -> Material | None:
        """Convert a material, once for all meshes that share it."""
        if id(material) not in self.materials:
            self.materials[id(material)] = material_from_trimesh(
                material, is_gltf, self.left_out, self.textures
            )
        return self.materials[id(material)]

    def _get_given_normals(self, geometry: Any) -> NDArray[np.float64] | None:
        """Return the normals that a mesh was given, not those that trimesh averaged."""
        if "vertex_normals" not in geometry._cache:
            return None
        normals = np.asarray(geometry.vertex_normals)
        if not self.from_file and _are_averaged(normals, geometry):
            return None
        return self._check_rows("normals", normals, (len(geometry.vertices), 3))

    def _check_rows(
        self, name: str, values: Any, shape: tuple[int, int]
    ) -> NDArray[np.float64] | None:
        """Return an array that fits the vertices; None, with a note, if it does not."""
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

    def _convert_camera(self, loaded: Any) -> PerspectiveCamera | None:
        """Return the camera of a trimesh scene, but not the one that trimesh makes up."""
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

    def _convert_lights(self, loaded: Any) -> list[Light]:
        """Return the lights of a trimesh scene, but not those that trimesh makes up."""
        added: list[Light] = []
        lights = getattr(loaded, "_lights", None) or []
        if _are_default_lights(loaded, lights):
            return added
        for light in lights:
            pose = np.eye(4)
            if light.name in loaded.graph.nodes:
                pose = np.asarray(loaded.graph[light.name][0], dtype=np.float64)
            color = np.asarray(light.color[:3], dtype=np.float64) / 255.0
            kind = type(light).__name__
            if kind == "DirectionalLight":
                added.append(DirectionalLight(-pose[:3, 2], color, light.intensity))
            elif kind == "PointLight":
                added.append(PointLight(pose[:3, 3], color, light.intensity))
            elif kind == "SpotLight":
                added += self._convert_spot(light, pose, color)
            else:
                self.left_out.note(kind)
        return added

    def _convert_spot(
        self, light: Any, pose: NDArray[np.float64], color: NDArray[np.float64]
    ) -> list[SpotLight]:
        """Return a spot light in a list, [] if its cone is not valid."""
        try:
            return [
                SpotLight(
                    pose[:3, 3],
                    -pose[:3, 2],
                    color,
                    light.intensity,
                    inner_angle=math.degrees(light.innerConeAngle),
                    outer_angle=min(math.degrees(light.outerConeAngle), MAX_CONE_ANGLE),
                )
            ]
        except ValueError:
            self.left_out.note("SpotLight without a usable cone")
            return []


def _is_product(steps: list[Any], transform: NDArray[np.float64]) -> bool:
    """Tell whether a transform is the product of steps, but for rounding."""
    if not steps or any(step is None for step in steps):
        return False
    try:
        product = compose(*steps)
    except ValueError:
        return False
    largest = np.abs(transform).max(initial=0.0)
    return bool((np.abs(product - transform) <= _TRANSFORM_TOLERANCE * largest).all())


def _are_averaged(normals: NDArray[np.float64], geometry: Any) -> bool:
    """
    Tell whether normals are averages of the faces around each vertex, weighted by angle.

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
    return bool((np.abs(normals - averaged) <= _NORMAL_TOLERANCE).all())


def _are_default_lights(loaded: Any, lights: list[Any]) -> bool:
    """Tell whether lights are the two point lights that trimesh puts at a scene's corners."""
    from trimesh.scene.lighting import PointLight as TrimeshPointLight

    default = TrimeshPointLight()
    return len(lights) == 2 and all(
        type(light) is TrimeshPointLight
        and light.name.startswith("light_")
        and light.intensity == default.intensity
        and np.array_equal(light.color, default.color)
        and light.name in loaded.graph.nodes
        and np.array_equal(loaded.graph[light.name][0][:3, 3], corner)
        for light, corner in zip(lights, loaded.bounds, strict=True)
    )


def _describe(geometry: Any) -> str:
    """Describe a geometry without faces, for messages."""
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
