"""Convert meshes and scenes to trimesh's, and warn of what these cannot hold."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.cameras import to_trimesh as camera_to_trimesh
from rasterjit.io.gltf.meshes_materials import ALPHA_MODE_NAMES, TEXTURE_PROPERTIES
from rasterjit.io.gltf.writing import make_look_along, stabilize_normals
from rasterjit.io.images import quantize
from rasterjit.io.load_warnings import SaveNotes
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.scene.light import AmbientLight, DirectionalLight, Light, PointLight, SpotLight
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import DefaultMaterial, Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.points import Points
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
from rasterjit.scene.texture import Texture

if TYPE_CHECKING:
    import trimesh

_CAMERA_RESOLUTION = (640, 640)
"""Resolution of the camera, pixels, which trimesh requires: with equal fields of view."""


def to_trimesh(what: Mesh | Scene) -> Any:
    """
    Convert a mesh or scene to trimesh; see `Mesh.to_trimesh` and `Scene.to_trimesh`.

    Returns
    -------
    trimesh.Trimesh, trimesh.PointCloud, trimesh.path.Path3D or trimesh.Scene

    Warns
    -----
    SaveWarning
        Once, naming what it has not or has otherwise.
    """
    notes = SaveNotes("trimesh")
    converter = _Converter(notes)
    added = converter.mesh(what) if isinstance(what, Mesh) else converter.scene(what)
    notes.warn(f"trimesh {type(added).__name__}")
    return added


class _Converter:
    """Converts scenes and meshes, each once."""

    def __init__(self, notes: SaveNotes) -> None:
        self.notes = notes
        self._materials: dict[Any, Any] = {}
        self._names = {"world": 1}
        """Used names, with the last number that was appended to each."""

    def scene(self, scene: Scene) -> trimesh.Scene:
        """Return a scene with its nodes, camera and lights."""
        import trimesh

        posed = scene.posed()
        if posed is not scene:
            self.notes.note("skins and morph targets, but for the pose as it is")
            scene = posed
        if scene._animations_in_scene():
            self.notes.note("animations")
        if scene._joints_in_scene():
            self.notes.note("joints of robots, but for the pose as it is")
        result, geometries, names = trimesh.Scene(), {}, {}
        mesh_nodes = set(map(id, scene.nodes))
        # Objects are numbered as they come; what they hang below may come later.
        groups = [node for node in scene.every_node() if id(node) not in mesh_nodes]
        for node in (*scene.nodes, *groups):
            names[id(node)] = self._unique_name(str(node.name))
        for node in (*scene.nodes, *groups):
            fields = {}
            if id(node) in mesh_nodes:
                if id(node.mesh) not in geometries:
                    geometries[id(node.mesh)] = names[id(node)]
                    result.geometry[names[id(node)]] = self.mesh(node.mesh)
                fields = {"geometry": geometries[id(node.mesh)]}
            parent = "world" if node.parent is None else names[id(node.parent)]
            result.graph.update(names[id(node)], parent, matrix=np.array(node.transform), **fields)
        if list(result.graph.nodes_geometry) != [names[id(node)] for node in scene.nodes]:
            self.notes.note("order of the objects, which is that of the tree")
        self._add_camera(scene.camera, result)
        self._add_lights(scene.lights, result)
        for name in EFFECT_FIELDS:
            if getattr(scene, name) is not None:
                self.notes.note(name)
        if scene.labelled:
            self.notes.note("labels")
        return result

    def _unique_name(self, name: str) -> str:
        """Return a unique name: trimesh identifies nodes by their names."""
        unique = name or "node"
        if name in self._names:
            self.notes.note("name of a node that another has")
        while unique in self._names:
            self._names[name] = number = self._names.get(name, 1) + 1
            unique = f"{name or 'node'} {number}"
        self._names[unique] = 1
        return unique

    def mesh(self, mesh: Mesh) -> Any:
        """Return a mesh with its normals, colours, texture coordinates and material."""
        import trimesh

        if isinstance(mesh, Points):
            return self._make_points(mesh)
        if isinstance(mesh, Lines):
            return self._make_lines(mesh)
        normals, _ = stabilize_normals(mesh.vertex_normals())
        for name in ("uv1", "tangents", "joints", "morph_targets"):
            if getattr(mesh, name) is not None:
                self.notes.note(name)
        if mesh.field is not None:
            self.notes.note("scalars, but for their colours")
        return trimesh.Trimesh(
            mesh.vertices, mesh.faces, vertex_normals=normals, visual=self._make_visual(mesh),
            vertex_attributes=dict(mesh.vertex_attributes),
            face_attributes=dict(mesh.face_attributes),
            process=False, validate=False,
        )  # fmt: skip

    def _make_points(self, mesh: Points) -> trimesh.PointCloud:
        """Return the finite points with their colours."""
        import trimesh

        rows = np.isfinite(mesh.vertices).all(axis=1)
        if mesh.invalid_vertices:
            self.notes.note("points that are NaN or infinite")
        self._note_point_or_line_data(mesh)
        colors = mesh.colors
        codes = None if colors is None else self._quantize(colors[rows], "srgb", "colours")
        return trimesh.PointCloud(mesh.vertices[rows], colors=codes)

    def _make_lines(self, mesh: Lines) -> trimesh.path.Path3D:
        """Return lines as curves: runs of connected segments of one colour."""
        import trimesh
        from trimesh.path.entities import Line

        self._note_point_or_line_data(mesh)
        if mesh.shown_vertex_colors() is not None:
            self.notes.note("colours of points of lines")
        segments = mesh.segments
        breaks = segments[1:, 0] != segments[:-1, 1]
        codes = None
        if mesh.face_colors is not None:
            codes = self._quantize(mesh.face_colors, "srgb", "colours")
            breaks |= (codes[1:] != codes[:-1]).any(axis=1)
        begins = np.concatenate([[0], np.flatnonzero(breaks) + 1, [len(segments)]]).tolist()
        entities = [
            Line(
                np.append(segments[begin:end, 0], segments[end - 1, 1]),
                color=None if codes is None else codes[begin],
            )
            for begin, end in pairwise(begins)
        ]
        return trimesh.path.Path3D(entities=entities, vertices=mesh.vertices, process=False)

    def _note_point_or_line_data(self, mesh: Points | Lines) -> None:
        """Note what trimesh cannot hold of points and lines."""
        what = "points" if isinstance(mesh, Points) else "lines"
        self.notes.note(f"sizes of {what}" if what == "points" else "widths of lines")
        if mesh.normals is not None:
            self.notes.note(f"normals of {what}")
        if mesh.vertex_attributes or mesh.face_attributes:
            self.notes.note(f"attributes of {what}")
        if mesh.field is not None:
            self.notes.note("scalars, but for their colours")
        if mesh.material.base_color is not None:
            self.notes.note(f"base colour of {what}")

    def _make_visual(self, mesh: Mesh) -> Any:
        """Return colours, or a material and its texture coordinates."""
        from trimesh.visual import ColorVisuals, TextureVisuals

        vertex_colors, face_colors = (
            None if colors is None else self._quantize(colors, "srgb", "colours")
            for colors in (mesh.shown_vertex_colors(), mesh.face_colors)
        )
        is_plain = mesh.material in (Material(name=mesh.material.name), DefaultMaterial())
        if face_colors is not None or (is_plain and mesh.uv is None):
            if not is_plain:
                self.notes.note("material beside colours of faces")
            return ColorVisuals(vertex_colors=vertex_colors, face_colors=face_colors)
        material = self._make_material(mesh.material, vertex_colors is not None)
        visual = TextureVisuals(uv=mesh.uv, material=material)
        if vertex_colors is not None:
            visual.vertex_attributes["color"] = vertex_colors
        return visual

    def _quantize(self, colors: Any, color_space: str, what: str) -> NDArray[np.uint8]:
        """Return linear colours, (..., 4), as bytes, and note if that rounds them."""
        codes, are_exact = quantize(np.asarray(colors, np.float32), color_space)
        if not are_exact:
            self.notes.note_rounded(f"{what}, to 8 bits")
        return codes

    def _make_material(self, material: Material, has_colors: bool) -> Any:
        """Convert a material, once for all meshes that share it."""
        color = _get_base_color(material, has_colors)
        key = id(material), color
        if key not in self._materials:
            if material.casts_shadow is not None:
                self.notes.note("casts_shadow")
            make = self._make_pbr if material.shading == "pbr" else self._make_simple
            self._materials[key] = make(material, color)
        return self._materials[key]

    def _make_pbr(self, material: Material, base_color: tuple[float, ...]) -> Any:
        """Return a metallic-roughness material."""
        from trimesh.visual.material import PBRMaterial

        for name in ("normal_scale", "occlusion_strength"):
            if getattr(material, name) != 1.0:
                self.notes.note(name)
        for name, has_it in (
            ("clearcoat", material.has_clearcoat),
            ("sheen", material.has_sheen),
            ("specular and ior", material.has_custom_specular),
            ("transmission", material.transmits),
        ):
            if has_it:
                self.notes.note(name)
        pictures = {
            key: self._make_image(getattr(material, field), color_space, field)
            for field, (key, color_space) in TEXTURE_PROPERTIES.items()
        }
        (color,) = self._quantize([base_color], "linear", "base colours")
        return PBRMaterial(
            name=material.name, baseColorFactor=color, metallicFactor=material.metallic,
            roughnessFactor=material.roughness, emissiveFactor=list(material.emissive),
            doubleSided=material.double_sided, alphaMode=ALPHA_MODE_NAMES[material.alpha_mode],
            alphaCutoff=material.alpha_cutoff, **pictures,
        )  # fmt: skip

    def _make_simple(self, material: Material, base_color: tuple[float, ...]) -> Any:
        """Return a Blinn-Phong material, as those of MTL files are."""
        from trimesh.visual.material import SimpleMaterial

        if material.shading != "phong":
            self.notes.note(f"{material.shading} shading")
        if material.emits:
            self.notes.note("emission")
        if not material.double_sided:
            self.notes.note("single-sidedness")
        if material.alpha_mode == "mask":
            self.notes.note("alpha_mode 'mask'")
        for field in TEXTURE_PROPERTIES:
            if field != "base_color_texture" and getattr(material, field) is not None:
                self.notes.note(field)
        mtl_colors: dict[str, Any] = {}
        if material.base_color is not None:
            (color,) = self._quantize([base_color], "srgb", "base colours")
            mtl_colors["diffuse"] = mtl_colors["kd"] = color
        strength = min(material.specular, 1.0) if material.shading != "unlit" else 0.0
        (shine,) = self._quantize([(strength,) * 3 + (1.0,)], "srgb", "highlights")
        picture = self._make_image(material.base_color_texture, "srgb", "base_color_texture")
        return SimpleMaterial(
            image=picture, name=material.name, specular=shine, glossiness=material.shininess,
            ks=shine, ns=material.shininess, **mtl_colors,
        )  # fmt: skip

    def _make_image(self, texture: Texture | None, color_space: str, field: str) -> Any:
        """Return the image of a texture for Pillow."""
        if texture is None:
            return None
        from PIL import Image

        is_repeated = texture.wrap == ("repeat", "repeat") and texture.filter == "trilinear"
        if not is_repeated or texture.anisotropy > 1 or texture.transform is not None:
            self.notes.note(f"how a {field} is sampled")
        if texture.uv_set:
            self.notes.note(f"uv_set of a {field}")
        codes = self._quantize(texture.image, color_space, "textures")
        return Image.fromarray(codes[:, :, :3].copy() if texture.is_opaque else codes)

    def _add_camera(self, camera: Any, result: trimesh.Scene) -> None:
        """Add the camera of a scene, if it is a perspective."""
        if camera is None:
            return
        if not isinstance(camera, PerspectiveCamera):
            self.notes.note(type(camera).__name__)
            return
        if camera.min_aspect:
            self.notes.note("min_aspect of the camera")
        result.camera, result.camera_transform = camera_to_trimesh(camera, _CAMERA_RESOLUTION)

    def _add_lights(self, lights: list[Light], result: trimesh.Scene) -> None:
        """Add the lights of a scene, whose bytes are linear light."""
        from trimesh.scene import lighting

        added, poses = [], []
        for light in lights:
            if isinstance(light, AmbientLight):
                self.notes.note(type(light).__name__)
                continue
            kind = type(light).__name__
            if light.shadow is not None:
                self.notes.note(f"shadow of a {kind}")
            if not isinstance(light, DirectionalLight) and light.range is not None:
                self.notes.note(f"range of a {kind}")
            cone = {}
            if isinstance(light, SpotLight):
                cone = {
                    "innerConeAngle": math.radians(light.inner_angle),
                    "outerConeAngle": math.radians(light.outer_angle),
                }
            (color,) = self._quantize([(*light.color, 1.0)], "linear", "light")
            added.append(getattr(lighting, kind)(color=color, intensity=light.intensity, **cone))
            position = (0.0, 0.0, 0.0) if isinstance(light, DirectionalLight) else light.position
            direction = (0.0, 0.0, -1.0) if isinstance(light, PointLight) else light.direction
            poses.append(make_look_along(position, direction))
        if added:
            result.lights = added
        for light, pose in zip(added, poses, strict=True):
            result.graph.update(light.name, matrix=pose)


def _get_base_color(material: Material, has_colors: bool) -> tuple[float, ...]:
    """Return a base colour, linear RGBA; alpha is 1 for opaque materials."""
    *rgb, alpha = material.base_color_over(has_colors)
    return *rgb, 1.0 if material.alpha_mode == "opaque" else alpha
