"""
Write a scene to a glTF 2.0 file, ``.glb`` or ``.gltf``, and name what glTF has no word for.

What is written is what this folder reads: nodes, meshes, metallic-roughness and unlit materials,
textures with their samplers, punctual lights and a camera.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022).
.. [2] The Khronos Group, "KHR_lights_punctual", "KHR_materials_unlit",
   "KHR_materials_emissive_strength", "KHR_texture_transform".
"""

from __future__ import annotations

import base64
import io
import json
import math
import os
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.atomic_write import atomic_file
from rasterjit.io.gltf.extensions import (
    EXTENSION_TEXTURES,
    LIGHTS,
    VARIANTS,
    make_variant_mappings,
    write_extensions,
)
from rasterjit.io.gltf.file import BINARY_CHUNK, GLB_MAGIC, JSON_CHUNK, WIDTHS
from rasterjit.io.gltf.meshes_materials import (
    ALPHA_MODE_NAMES,
    EMISSIVE_STRENGTH,
    LINEAR,
    LINES,
    NEAREST,
    POINTS,
    TEXTURE_PROPERTIES,
    UNLIT,
    WRAPS,
)
from rasterjit.io.images import check_save_path, quantize
from rasterjit.io.load_warnings import SaveNotes
from rasterjit.io.primitives import DEFAULT_POINT_SIZE, choose_point_size
from rasterjit.scene.camera import OrthographicCamera, PerspectiveCamera
from rasterjit.scene.decomposed_transform import compose_trs
from rasterjit.scene.keyframes import VALUE_WIDTHS as CHANNEL_WIDTHS
from rasterjit.scene.light import AmbientLight, DirectionalLight, Light, PointLight, SpotLight
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import DefaultMaterial, Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.normals import unit_rows
from rasterjit.scene.points import Points
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
from rasterjit.scene.skin import MorphTargets, Skin
from rasterjit.scene.texture import Texture, flip_v
from rasterjit.scene.validation import VectorLike

GLTF_SUFFIXES = (".glb", ".gltf")

_ALIGNMENT = 4
"""Alignment of data in the buffer, bytes."""

_VERTICES, _CORNERS = 34962, 34963
"""Targets of buffer views, by their OpenGL numbers."""

_FLOAT, _UINT, _SHORT = 5126, 5125, 5123
"""Component types by their OpenGL numbers: float32, uint32, uint16."""

_DTYPES = {_FLOAT: "<f4", _UINT: "<u4", _SHORT: "<u2"}

_JOINTS_PER_SET = 4
"""Joints of a vertex in one attribute."""

_MAX_JOINTS = 1 << 16
"""Most joints that uint16 can number."""

_SHEAR_TOLERANCE = 1e-6
"""Share of an animated node's transform that may be lost as translation, rotation and scale."""

_LINEAR_MIPMAP_LINEAR = 9987
_FILTER_NUMBERS = {
    "nearest": (NEAREST, NEAREST), "bilinear": (LINEAR, LINEAR),
    "trilinear": (LINEAR, _LINEAR_MIPMAP_LINEAR),
}  # fmt: skip
"""OpenGL's numbers of magnification and minification, by the filter of a texture."""

_ACCESSOR_TYPES = {width: kind for kind, width in WIDTHS.items() if width <= 4}
"""Accessor types by their width."""

_MAX_LENGTH_TRIALS, _LENGTH_STEP = 1024, 2.0**-20
"""Number of lengths that are tried for a normal, and their difference."""

_ROUNDING_TOLERANCE = 1e-5
"""Share of a mesh's extent by which positions may be rounded without a warning."""

_DEFAULT_LINE_WIDTH = 1.5
"""Default width of `Lines`, pixels."""

_TRANSFORM = "KHR_texture_transform"
_WRAP_NUMBERS = {name: number for number, name in WRAPS.items()}


def save_gltf(scene: Scene, path: str | os.PathLike[str]) -> None:
    """
    Write a scene to a ``.glb`` or ``.gltf`` file; see `Scene.save`.

    Parameters
    ----------
    scene : Scene
    path : str or path-like
        An existing file is replaced when the new one is whole.

    Raises
    ------
    ValueError
        If the path ends otherwise or its folder does not exist, the scene is empty, or a mesh has
        vertices that are not finite or do not fit float32. Nothing is written.
    OSError
        If the file cannot be written; an existing one is left as it was.

    Warns
    -----
    SaveWarning
        Once, naming what the file has not or has otherwise.
    """
    target = check_save_path(path, GLTF_SUFFIXES)
    writer = _Writer(scene)
    is_text = target.suffix.lower() == ".gltf"
    content = writer.encode_gltf() if is_text else writer.encode_glb()
    with atomic_file(target) as temporary:
        temporary.write_bytes(content)
    writer.notes.warn(str(target))


class _Writer:
    """Builds a file's document and buffer from a scene; ``notes`` names what it cannot hold."""

    def __init__(self, scene: Scene) -> None:
        self.notes = SaveNotes("glTF")
        self._parts: list[bytes] = []
        self._buffer_size = 0
        self._sections: dict[str, list[dict[str, Any]]] = {}
        self._extensions: list[str] = []
        self._lights: list[dict[str, Any]] = []
        self._variants = scene.variants
        self._cache: dict[Any, int] = {}
        if not scene.nodes:
            raise ValueError("scene must hold at least one mesh to be saved, got an empty scene")
        self._animations = scene._animations_in_scene()
        if scene._joints_in_scene():
            self.notes.note("joints of robots, but for the pose as it is")
        roots = self._add_nodes(scene)
        self._add_animations()
        for light in scene.lights:
            roots += self._add_light(light)
        roots += self._add_camera(scene.camera)
        self._scene = {"nodes": roots}
        for name in EFFECT_FIELDS:
            if getattr(scene, name) is not None:
                self.notes.note(name)
        if scene.variant is not None:
            self.notes.note(f"the choice of the variant {scene.variant!r}")

    def _make_header(self, **buffer: Any) -> dict[str, Any]:
        """Return the JSON document; ``buffer``: further fields of its buffer."""
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "RasterJIT"},
            "scene": 0,
            "scenes": [self._scene],
            **self._sections,
            "buffers": [{"byteLength": self._buffer_size, **buffer}],
        }
        if self._variants:
            self._declare_extension(VARIANTS)
            variants = [{"name": name} for name in self._variants]
            document["extensions"] = {VARIANTS: {"variants": variants}}
        if self._lights:
            document.setdefault("extensions", {})[LIGHTS] = {"lights": self._lights}
        if self._extensions:
            document["extensionsUsed"] = self._extensions
        return document

    def encode_gltf(self) -> bytes:
        """Return the content of a .gltf file with its buffer as a data URI."""
        content = base64.b64encode(b"".join(self._parts)).decode("ascii")
        uri = f"data:application/octet-stream;base64,{content}"
        return _encode_json(self._make_header(uri=uri))

    def encode_glb(self) -> bytes:
        """Return the content of a .glb file."""
        text, content = _pad(_encode_json(self._make_header()), b" "), b"".join(self._parts)
        chunks = b"".join(
            struct.pack("<II", len(data), kind) + data
            for data, kind in ((text, JSON_CHUNK), (content, BINARY_CHUNK))
        )
        return struct.pack("<4sII", GLB_MAGIC, 2, 12 + len(chunks)) + chunks

    def _append(self, section: str, entry: dict[str, Any]) -> int:
        """Append an entry to a list of the document; return its number."""
        entries = self._sections.setdefault(section, [])
        entries.append(entry)
        return len(entries) - 1

    def _append_once(self, key: Any, section: str, entry: dict[str, Any]) -> int:
        """Append an entry unless one with this key exists; return its number."""
        if key not in self._cache:
            self._cache[key] = self._append(section, entry)
        return self._cache[key]

    def _declare_extension(self, extension: str) -> None:
        """Declare that the file uses an extension."""
        if extension not in self._extensions:
            self._extensions.append(extension)

    def _add_view(self, content: bytes, **fields: Any) -> int:
        """Append bytes to the buffer; return the number of their buffer view."""
        entry = {"buffer": 0, "byteOffset": self._buffer_size, "byteLength": len(content), **fields}
        self._parts.append(_pad(content, b"\0"))
        self._buffer_size += len(self._parts[-1])
        return self._append("bufferViews", entry)

    def _add_accessor(
        self, rows: NDArray[Any], element_type: str, component: int,
        target: int | None = _VERTICES, **fields: Any,
    ) -> int:  # fmt: skip
        """Append rows of numbers; return the number of their accessor."""
        content = np.ascontiguousarray(rows, _DTYPES[component])
        view = self._add_view(content.tobytes(), **({} if target is None else {"target": target}))
        entry = {"bufferView": view, "componentType": component, "count": len(content)}
        return self._append("accessors", {**entry, "type": element_type, **fields})

    def _add_bounded_vectors(self, vectors: NDArray[np.float32]) -> int:
        """Append vectors, (N, 3), with their bounds; return the number of their accessor."""
        bounds = {"min": vectors.min(axis=0).tolist(), "max": vectors.max(axis=0).tolist()}
        return self._add_accessor(vectors, "VEC3", _FLOAT, **bounds)

    def _add_nodes(self, scene: Scene) -> list[int]:
        """Append all nodes, parents before their children; return the roots."""
        mesh_nodes, order = set(map(id, scene.nodes)), []
        animated = {id(one.node) for every in self._animations for one in every.channels}
        numbers: dict[int, int] = {}
        self._node_numbers = numbers
        nodes = list(scene._all_nodes())
        skinned: list[tuple[dict[str, Any], Skin]] = []
        for node in nodes:
            entry: dict[str, Any] = {"name": str(node.name)}
            if id(node) in animated:
                entry.update(self._make_transform_entry(node))
            elif not np.array_equal(node.transform, np.eye(4)):
                entry["matrix"] = _flatten_columns(node.transform)
            if id(node) in mesh_nodes and node.mesh is not None:
                entry["mesh"] = self._add_mesh(node)
                order.append(node)
                if node.skin is not None:
                    skinned.append((entry, node.skin))
                if node.weights is not None:
                    entry["weights"] = node.weights.tolist()
            if node.label is not None:
                self.notes.note("labels")
            numbers[id(node)] = number = self._append("nodes", entry)
            if node.parent is not None:
                parent_entry = self._sections["nodes"][numbers[id(node.parent)]]
                parent_entry.setdefault("children", []).append(number)
        if any(one is not other for one, other in zip(order, scene.nodes, strict=False)):
            self.notes.note("order of the objects, which is that of the tree")
        for entry, skin in skinned:
            entry["skin"] = self._add_skin(skin)
        return [numbers[id(node)] for node in nodes if node.parent is None]

    def _make_transform_entry(self, node: Node) -> dict[str, Any]:
        """Return the transform of an animated node, which must not be a matrix."""
        trs, entry = node.trs, {}
        difference = np.abs(compose_trs(trs) - node.transform).max()
        if difference > _SHEAR_TOLERANCE * np.abs(node.transform).max():
            self.notes.note(f"shear of {node.name!r}, which is animated")
        if trs.translation != (0.0, 0.0, 0.0):
            entry["translation"] = list(trs.translation)
        if trs.rotation != (0.0, 0.0, 0.0, 1.0):
            entry["rotation"] = list(trs.rotation)
        if trs.scale != (1.0, 1.0, 1.0):
            entry["scale"] = list(trs.scale)
        return entry

    def _add_skin(self, skin: Skin) -> int:
        """Append a skin, once for all nodes that share it; return its number."""
        key = "skin", id(skin)
        if key in self._cache:
            return self._cache[key]
        with np.errstate(over="ignore"):
            columns = skin.inverse_binds.transpose(0, 2, 1).reshape(-1, 16).astype(np.float32)
        if not np.isfinite(columns).all():
            raise ValueError(f"{skin!r} must have inverse_binds that fit float32 to be saved")
        entry: dict[str, Any] = {
            "joints": [self._node_numbers[id(joint)] for joint in skin.joints],
            "inverseBindMatrices": self._add_accessor(columns, "MAT4", _FLOAT, None),
        }
        if skin.name:
            entry["name"] = str(skin.name)
        return self._append_once(key, "skins", entry)

    def _add_animations(self) -> None:
        """Append the animations with their channels and samplers."""
        for animation in self._animations:
            channels: list[dict[str, Any]] = []
            samplers: list[dict[str, Any]] = []
            for one in animation.channels:
                with np.errstate(over="ignore"):
                    times, values = one.times.astype(np.float32), one.values.astype(np.float32)
                label = f"{one.path} of {one.node.name!r} in animation {animation.name!r}"
                if not (np.diff(times) > 0.0).all() or not np.isfinite(values).all():
                    self.notes.note(f"{label}, whose keys float32 has not")
                    continue
                width = CHANNEL_WIDTHS.get(one.path, 1)
                bounds = {"min": [float(times[0])], "max": [float(times[-1])]}
                samplers.append(
                    {
                        "input": self._add_accessor(times, "SCALAR", _FLOAT, None, **bounds),
                        "output": self._add_accessor(
                            values.reshape(-1, width), _ACCESSOR_TYPES[width], _FLOAT, None
                        ),
                        "interpolation": one.interpolation,
                    }
                )
                target = {"node": self._node_numbers[id(one.node)], "path": one.path}
                channels.append({"sampler": len(samplers) - 1, "target": target})
            if channels:
                entry = {"name": str(animation.name), "channels": channels, "samplers": samplers}
                self._append("animations", entry)

    def _add_joints(
        self, mesh: Mesh, rows: NDArray[Any] | slice, attributes: dict[str, int]
    ) -> None:
        """Append the joints and weights of vertices, four in each attribute."""
        if mesh.joints is None or mesh.weights is None:
            return
        if int(mesh.joints.max()) >= _MAX_JOINTS:
            self.notes.note(f"joints of a mesh from number {_MAX_JOINTS} on")
            return
        count = -(-mesh.joints.shape[1] // _JOINTS_PER_SET) * _JOINTS_PER_SET
        missing = ((0, 0), (0, count - mesh.joints.shape[1]))
        joints, weights = (np.pad(one[rows], missing) for one in (mesh.joints, mesh.weights))
        for number in range(count // _JOINTS_PER_SET):
            columns = slice(number * _JOINTS_PER_SET, (number + 1) * _JOINTS_PER_SET)
            attributes[f"JOINTS_{number}"] = self._add_accessor(joints[:, columns], "VEC4", _SHORT)
            attributes[f"WEIGHTS_{number}"] = self._add_accessor(
                weights[:, columns], "VEC4", _FLOAT
            )

    def _add_targets(
        self, node: Node, targets: MorphTargets, rows: NDArray[Any] | slice
    ) -> list[dict[str, int]]:
        """Append morph targets; return the entries of their primitive."""
        entries: list[dict[str, int]] = [{} for _ in range(len(targets))]
        offsets_by_name = {
            "POSITION": targets.positions, "NORMAL": targets.normals, "TANGENT": targets.tangents,
        }  # fmt: skip
        for name, values in offsets_by_name.items():
            for entry, offsets in zip(entries, () if values is None else values, strict=False):
                with np.errstate(over="ignore"):
                    stored = offsets[rows].astype(np.float32)
                if not np.isfinite(stored).all():
                    raise ValueError(
                        f"the morph targets of {node.name!r} must fit float32 to be saved"
                    )
                if name == "POSITION":
                    entry[name] = self._add_bounded_vectors(stored)
                else:
                    entry[name] = self._add_accessor(stored, "VEC3", _FLOAT)
        return entries

    def _add_mesh(self, node: Node) -> int:
        """Append a node's mesh, once for all nodes that share it; return its number."""
        mesh = node.mesh
        key = "mesh", id(mesh)
        if key in self._cache:
            return self._cache[key]
        if isinstance(mesh, Points):
            return self._append_once(key, "meshes", {"primitives": [self._add_points(node, mesh)]})
        if mesh.invalid_vertices:
            raise ValueError(
                f"the mesh of {node.name!r} must have finite vertices to be saved, got "
                f"{mesh.invalid_vertices} with NaN or infinity"
            )
        if isinstance(mesh, Lines):
            return self._append_once(key, "meshes", {"primitives": [self._add_lines(node, mesh)]})
        corners: NDArray[np.integer] = mesh.faces.ravel()
        colors: NDArray[np.float32] | None
        # glTF colours vertices alone: with colours by face, each face gets its own.
        rows: Any = slice(None) if mesh.face_colors is None else corners
        if mesh.face_colors is not None:
            colors, corners = np.repeat(mesh.face_colors, 3, axis=0), np.arange(len(corners))
        else:
            colors = mesh.shown_vertex_colors()
        if mesh.field is not None:
            self.notes.note("scalars, but for their colours")
        attributes = {"POSITION": self._add_positions(node, mesh.vertices[rows])}
        normals = stabilize_normals(mesh.vertex_normals()[rows])[0]
        attributes["NORMAL"] = self._add_accessor(normals, "VEC3", _FLOAT)
        if mesh.tangents is not None:
            tangents = mesh.tangents[rows].copy()
            tangents[:, :3] = stabilize_normals(tangents[:, :3])[0]
            attributes["TANGENT"] = self._add_accessor(tangents, "VEC4", _FLOAT)
        for number, uv in enumerate(mesh.uv_sets):
            if uv is not None:
                attributes[f"TEXCOORD_{number}"] = self._add_accessor(
                    _flip_v_axis(uv[rows]), "VEC2", _FLOAT
                )
        if colors is not None:
            attributes["COLOR_0"] = self._add_accessor(colors, "VEC4", _FLOAT)
        self._add_custom_attributes(mesh, rows, attributes)
        self._add_joints(mesh, rows, attributes)
        primitive: dict[str, Any] = {
            "attributes": attributes,
            "indices": self._add_accessor(corners, "SCALAR", _UINT, _CORNERS),
        }
        morph_fields: dict[str, Any] = {}
        targets = mesh.morph_targets
        if targets is not None:
            primitive["targets"] = self._add_targets(node, targets, rows)
            if targets.weights is not None:
                morph_fields["weights"] = targets.weights.tolist()
            if targets.names:
                morph_fields["extras"] = {"targetNames": list(targets.names)}
        if (targets is not None or mesh.joints is not None) and mesh._derives_normals:
            self.notes.note("normals that are made anew for each pose, but for those at rest")
        if mesh.default_material != DefaultMaterial():
            primitive["material"] = self._add_material(mesh.default_material, colors is not None)
        if mesh.variants:
            numbers = {
                name: self._add_material(material, colors is not None)
                for name, material in mesh.variants.items()
            }
            mappings = make_variant_mappings(numbers, self._variants)
            primitive["extensions"] = {VARIANTS: mappings}
        return self._append_once(key, "meshes", {"primitives": [primitive], **morph_fields})

    def _add_custom_attributes(
        self, mesh: Mesh, rows: NDArray[Any] | slice, attributes: dict[str, int]
    ) -> None:
        """Append the custom attributes of vertices or points."""
        values_by_name = mesh.attributes if isinstance(mesh, Points) else mesh.vertex_attributes
        for name, values in values_by_name.items():
            element_type = _ACCESSOR_TYPES.get(values.shape[1])
            if element_type is not None:
                attributes[f"_{name}"] = self._add_accessor(values[rows], element_type, _FLOAT)
            else:
                self.notes.note(f"attribute {name!r} of more than 4 numbers")
        for name in () if isinstance(mesh, Points) else mesh.face_attributes:
            self.notes.note(f"attribute {name!r} of faces")

    def _add_points(self, node: Node, mesh: Points) -> dict[str, Any]:
        """Append the finite points; return their primitive."""
        rows = np.isfinite(mesh.vertices).all(axis=1)
        if mesh.invalid_vertices:
            self.notes.note("points that are NaN or infinite")
        max_size = max(DEFAULT_POINT_SIZE, choose_point_size(len(mesh)))
        if mesh.shape != "square" or mesh.unit != "pixel" or (mesh.sizes > max_size).any():
            self.notes.note("sizes and shapes of points")
        attributes = {"POSITION": self._add_positions(node, mesh.vertices[rows])}
        if mesh.normals is not None:
            attributes["NORMAL"] = self._add_accessor(
                stabilize_normals(mesh.normals[rows])[0], "VEC3", _FLOAT
            )
        return self._add_points_or_lines(mesh, POINTS, rows, mesh.colors, attributes)

    def _add_lines(self, node: Node, mesh: Lines) -> dict[str, Any]:
        """Append segments, with points of their own if segments have colours."""
        ends, colors = mesh.segments.ravel(), mesh.shown_vertex_colors()
        rows: Any = slice(None)
        if mesh.unit != "pixel" or (mesh.widths != _DEFAULT_LINE_WIDTH).any() or len(mesh.dashes):
            self.notes.note("widths and dashes of lines")
        if mesh.face_colors is not None:
            rows, colors = ends, np.repeat(mesh.face_colors, 2, axis=0)
            ends = np.arange(len(ends), dtype=ends.dtype)
        attributes = {"POSITION": self._add_positions(node, mesh.vertices[rows])}
        if mesh.face_colors is None and colors is not None:
            colors = colors[rows]
        primitive = self._add_points_or_lines(mesh, LINES, rows, colors, attributes)
        primitive["indices"] = self._add_accessor(ends, "SCALAR", _UINT, _CORNERS)
        return primitive

    def _add_points_or_lines(
        self, mesh: Mesh, mode: int, rows: Any, colors: NDArray[np.float32] | None,
        attributes: dict[str, int],
    ) -> dict[str, Any]:  # fmt: skip
        """Append colours, attributes and material of points or lines; return their primitive."""
        if mesh.field is not None:
            self.notes.note("scalars, but for their colours")
        if colors is not None:
            row_colors = colors[rows] if mode == POINTS else colors
            attributes["COLOR_0"] = self._add_accessor(row_colors, "VEC4", _FLOAT)
        self._add_custom_attributes(mesh, rows, attributes)
        primitive: dict[str, Any] = {"attributes": attributes, "mode": mode}
        if mesh.default_material != DefaultMaterial():
            primitive["material"] = self._add_material(mesh.default_material, colors is not None)
        if mesh.variants:
            self.notes.note("variants of points and lines")
        return primitive

    def _add_positions(self, node: Node, vertices: NDArray[np.float64]) -> int:
        """Append positions with their bounds; return the number of their accessor."""
        with np.errstate(over="ignore", under="ignore"):
            stored = vertices.astype(np.float32)
        if not np.isfinite(stored).all():
            raise ValueError(
                f"the mesh of {node.name!r} must have vertices that fit float32 to be saved, got "
                f"{float(np.abs(vertices).max())!r} in size"
            )
        error = float(np.abs(stored - vertices).max())
        if error > _ROUNDING_TOLERANCE * float(np.ptp(vertices, axis=0).max()):
            self.notes.note_rounded(
                f"positions of {node.name!r}, by {error:.2g}: so far from the origin float32 has "
                "no finer ones"
            )
        return self._add_bounded_vectors(stored)

    def _add_material(self, material: Material, has_colors: bool) -> int:
        """Append a material; return its number."""
        color = material.base_color_over(has_colors)
        key = "material", id(material), color
        if key in self._cache:
            return self._cache[key]
        if ("material", id(material), material.base_color_over(not has_colors)) in self._cache:
            self.notes.note("one material of meshes with and without colours: it becomes two")
        core: dict[str, Any] = {"baseColorFactor": list(color)}
        entry: dict[str, Any] = {"pbrMetallicRoughness": core}
        if material.name is not None:
            entry["name"] = str(material.name)
        if material.alpha_mode != "opaque":
            entry["alphaMode"] = ALPHA_MODE_NAMES[material.alpha_mode]
        if material.alpha_mode == "mask":
            entry["alphaCutoff"] = material.alpha_cutoff
        if material.double_sided:
            entry["doubleSided"] = True
        if material.casts_shadow is not None:
            self.notes.note("casts_shadow")
        is_unlit = material.shading == "unlit"
        core["metallicFactor"], core["roughnessFactor"] = _convert_metallic_roughness(material)
        if is_unlit:
            self._declare_extension(UNLIT)
            entry["extensions"] = {UNLIT: {}}
            if material.emits:
                self.notes.note("emission of unlit materials")
        elif material.shading != "pbr" and not _has_default_highlights(material):
            self.notes.note(f"{material.shading} shading, which becomes metallic-roughness as wide")
        if not is_unlit:
            self._set_emission(material, entry)
        self._set_textures(material, entry, core, is_unlit)
        return self._append_once(key, "materials", entry)

    def _set_emission(self, material: Material, entry: dict[str, Any]) -> None:
        """Set the emissive factor and strength of a material's entry."""
        strength = max(material.emissive)
        if strength <= 0.0:
            return
        if strength > 1.0:
            self._declare_extension(EMISSIVE_STRENGTH)
            entry.setdefault("extensions", {})[EMISSIVE_STRENGTH] = {"emissiveStrength": strength}
        entry["emissiveFactor"] = [part / max(strength, 1.0) for part in material.emissive]

    def _set_textures(
        self, material: Material, entry: dict[str, Any], core: dict[str, Any], is_unlit: bool
    ) -> None:
        """Set the textures and extensions of a material's entry."""
        is_first, infos = True, {}
        for field, (key, color_space) in (TEXTURE_PROPERTIES | EXTENSION_TEXTURES).items():
            texture = getattr(material, field)
            if texture is None:
                continue
            if field in EXTENSION_TEXTURES and material.shading != "pbr":
                continue
            if is_unlit and field != "base_color_texture":
                if texture in material.textures_read():
                    self.notes.note(f"{field} of unlit materials")
                continue
            texture_info = self._add_texture(texture, color_space, field)
            if is_first and texture.uv_set:
                self.notes.note("uv before uv1, which the first texture reads")
            is_first = False
            if field == "normal_texture":
                texture_info["scale"] = material.normal_scale
            elif field == "occlusion_texture":
                texture_info["strength"] = material.occlusion_strength
            if field in EXTENSION_TEXTURES:
                infos[field] = texture_info
            elif field in ("base_color_texture", "metallic_roughness_texture"):
                core[key] = texture_info
            else:
                entry[key] = texture_info
        if material.shading != "pbr":
            return
        for name, extension in write_extensions(material, infos).items():
            self._declare_extension(name)
            entry.setdefault("extensions", {})[name] = extension

    def _add_texture(self, texture: Texture, color_space: str, field: str) -> dict[str, Any]:
        """Append a texture with its image and sampler; return its entry in the material."""
        number = self._append_once(
            ("texture", id(texture.pyramid), color_space, texture.wrap, texture.filter),
            "textures",
            {
                "source": self._add_image(texture, color_space),
                "sampler": self._add_sampler(texture),
            },
        )
        texture_info: dict[str, Any] = {"index": number}
        if texture.uv_set:
            texture_info["texCoord"] = texture.uv_set
        if texture.anisotropy > 1:
            self.notes.note(f"anisotropy of a {field}")
        if texture.transform is not None:
            self._declare_extension(_TRANSFORM)
            # Flipping v once more undoes the flip of reading.
            offset, _, factors = flip_v(texture.offset, -texture.rotation, texture.scale)
            texture_info["extensions"] = {
                _TRANSFORM: {
                    "offset": list(offset),
                    "rotation": math.radians(texture.rotation),
                    "scale": list(factors),
                }
            }
        return texture_info

    def _add_image(self, texture: Texture, color_space: str) -> int:
        """Append the image of a texture as a PNG file of 8 bits; return its number."""
        key = "image", id(texture.pyramid), color_space
        if key not in self._cache:
            from PIL import Image

            codes, are_exact = quantize(texture.image, color_space)
            if not are_exact:
                self.notes.note_rounded("texels, to 8 bits from 0 to 1")
            if (codes[:, :, 3] == 255).all():
                codes = np.ascontiguousarray(codes[:, :, :3])
            file = io.BytesIO()
            Image.fromarray(codes).save(file, "PNG")
            view = self._add_view(file.getvalue())
            self._append_once(key, "images", {"bufferView": view, "mimeType": "image/png"})
        return self._cache[key]

    def _add_sampler(self, texture: Texture) -> int:
        """Append a sampler; return its number."""
        wrap_s, wrap_t = (_WRAP_NUMBERS[name] for name in texture.wrap)
        mag_filter, min_filter = _FILTER_NUMBERS[texture.filter]
        entry = {"magFilter": mag_filter, "minFilter": min_filter, "wrapS": wrap_s, "wrapT": wrap_t}
        return self._append_once(("sampler", *entry.values()), "samplers", entry)

    def _add_light(self, light: Light) -> list[int]:
        """Append a light and its node; return the node, or [] if glTF has no such light."""
        if isinstance(light, AmbientLight):
            self.notes.note(type(light).__name__)
            return []
        if light.shadow is not None:
            self.notes.note(f"shadow of a {type(light).__name__}")
        # The inverse of reading: a white surface of glTF sends back 1/pi of what falls on it.
        entry: dict[str, Any] = {"color": list(light.color), "intensity": light.intensity * math.pi}
        position: VectorLike = (0.0, 0.0, 0.0)
        direction: VectorLike = (0.0, 0.0, -1.0)
        if isinstance(light, DirectionalLight):
            entry["type"], direction = "directional", light.direction
        else:
            position = light.position
            if light.range is not None:
                entry["range"] = light.range
        if isinstance(light, PointLight):
            entry["type"] = "point"
        elif isinstance(light, SpotLight):
            entry["type"], direction = "spot", light.direction
            entry["spot"] = {
                "innerConeAngle": math.radians(light.inner_angle),
                "outerConeAngle": math.radians(light.outer_angle),
            }
        self._declare_extension(LIGHTS)
        self._lights.append(entry)
        node = {
            "matrix": _flatten_columns(make_look_along(position, direction)),
            "extensions": {LIGHTS: {"light": len(self._lights) - 1}},
        }
        return [self._append("nodes", node)]

    def _add_camera(self, camera: Any) -> list[int]:
        """Append the camera and its node; return the node, or [] without a camera."""
        if camera is None:
            return []
        if isinstance(camera, PerspectiveCamera):
            kind, lens = "perspective", {"yfov": math.radians(camera.fov_y)}
            near, far = camera.depth_coefficients()[0], camera.far
        elif isinstance(camera, OrthographicCamera) and camera.near >= 0.0:
            # The picture's shape decides the width, but a file must have one.
            kind, lens = "orthographic", {"ymag": camera.height / 2.0, "xmag": camera.height / 2.0}
            near, far = camera.view_depth([0.0, -1.0]).tolist()
        else:
            reason = ", whose near plane lies behind it" if hasattr(camera, "height") else ""
            self.notes.note(type(camera).__name__ + reason)
            return []
        if camera.min_aspect:
            self.notes.note("min_aspect of the camera")
        if isinstance(camera, PerspectiveCamera) and camera.pixel_aspect != 1.0:
            self.notes.note("pixel_aspect of the camera")
        lens["znear"] = near
        if far != math.inf:
            lens["zfar"] = far
        matrix = np.eye(4)
        matrix[:3, :3] = camera.view_matrix()[:3, :3].T
        matrix[:3, 3] = camera.eye
        number = self._append("cameras", {"type": kind, kind: lens})
        return [self._append("nodes", {"camera": number, "matrix": _flatten_columns(matrix)})]


def _flip_v_axis(uv: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return texture coordinates with v downwards, as glTF has it."""
    return np.column_stack([uv[:, 0], 1.0 - uv[:, 1].astype(np.float64)]).astype(np.float32)


def _has_default_highlights(material: Material) -> bool:
    """Tell whether a material is Blinn-Phong with default highlights."""
    default = Material()
    return all(
        getattr(material, name) == getattr(default, name)
        for name in ("shading", "specular", "shininess")
    )


def _convert_metallic_roughness(material: Material) -> tuple[float, float]:
    """
    Return metallic and roughness of a material.

    The exponent n of a Blinn-Phong highlight is that of microfacets of width α = roughness²:
    n = 2/α² - 2.
    """
    if material.shading in ("pbr", "unlit"):
        return material.metallic, material.roughness
    if material.specular == 0.0:
        return 0.0, 1.0
    return 0.0, math.sqrt(math.sqrt(2.0 / (material.shininess + 2.0)))


def stabilize_normals(normals: NDArray[np.float32]) -> tuple[NDArray[np.float32], int]:
    """
    Return normals of slightly other length that give exactly the same normals once normalized.

    Normals rounded to float32 are not of unit length to the last bit, and normalizing them again
    changes one in a hundred. Scaled a little, that one is rounded otherwise, and mostly is not
    changed.

    Parameters
    ----------
    normals : (N, 3) float32
        As a mesh stores them.

    Returns
    -------
    stable : (N, 3) float32
        Of unit length to a share of 0.0005.
    unstable_count : int
        Normals that still change, by a last bit: eight in a million.
    """
    result = normals.copy()
    unstable = np.flatnonzero((normalize_as_float32(result) != normals).any(axis=1))
    for trial in range(1, _MAX_LENGTH_TRIALS + 1):
        length = 1.0 + (trial // 2 if trial % 2 else -trial // 2) * _LENGTH_STEP
        scaled = (normals[unstable].astype(np.float64) * length).astype(np.float32)
        is_stable = (normalize_as_float32(scaled) == normals[unstable]).all(axis=1)
        result[unstable[is_stable]] = scaled[is_stable]
        unstable = unstable[~is_stable]
        if not len(unstable):
            break
    return result, len(unstable)


def normalize_as_float32(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return vectors, (N, 3), normalized and rounded as a mesh stores them; zero ones stay."""
    return unit_rows(vectors.astype(np.float64)).astype(np.float32)


def make_look_along(position: Any, direction: Any) -> NDArray[np.float64]:
    """Return the pose, (4, 4), at a position whose -z axis points along a direction."""
    z = -np.array(direction, np.float64)
    smallest_axis = np.zeros(3)
    smallest_axis[np.abs(z).argmin()] = 1.0
    x = unit_rows(np.cross(smallest_axis, z)[np.newaxis])[0]
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([x, np.cross(z, x), z, position])
    return matrix + 0.0


def _flatten_columns(matrix: NDArray[np.float64]) -> list[float]:
    """Return a matrix in column-major order, as glTF has it."""
    return matrix.T.ravel().tolist()


def _encode_json(document: dict[str, Any]) -> bytes:
    """Return a document as JSON in UTF-8."""
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode("utf-8")


def _pad(content: bytes, filler: bytes) -> bytes:
    """Return bytes padded to a multiple of `_ALIGNMENT`."""
    return content + filler * (-len(content) % _ALIGNMENT)
