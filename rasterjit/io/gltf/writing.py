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

from rasterjit.io.atomic_write import replacing
from rasterjit.io.gltf.extensions import LAYER_TEXTURES, LIGHTS, VARIANTS, told_by, written_mappings
from rasterjit.io.gltf.file import BINARY_CHUNK, GLB_MAGIC, JSON_CHUNK, WIDTHS
from rasterjit.io.gltf.meshes_materials import (
    LINEAR,
    LINES,
    MODE_NAMES,
    NEAREST,
    POINTS,
    STRENGTH,
    TEXTURES,
    UNLIT,
    WRAPS,
)
from rasterjit.io.images import checked_path, nearest_codes
from rasterjit.io.load_warnings import NotSaved
from rasterjit.io.primitives import USUAL_SIZE, default_size
from rasterjit.scene.camera import OrthographicCamera, PerspectiveCamera
from rasterjit.scene.decomposed_transform import matrix_of
from rasterjit.scene.keyframes import WIDTHS as CHANNEL_WIDTHS
from rasterjit.scene.light import AmbientLight, DirectionalLight, Light, PointLight, SpotLight
from rasterjit.scene.lines import Lines
from rasterjit.scene.material import Material, UnsaidMaterial
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.node import Node
from rasterjit.scene.normals import unit_rows
from rasterjit.scene.points import Points
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
from rasterjit.scene.skin import MorphTargets, Skin
from rasterjit.scene.texture import Texture, turned_over
from rasterjit.scene.validation import VectorLike

FORMATS = (".glb", ".gltf")

_ALIGNMENT = 4
"""Bytes that what lies in a buffer begins at a multiple of."""

_VERTICES, _CORNERS = 34962, 34963
"""What a buffer view holds, as OpenGL numbers it."""

_FLOAT, _WHOLE, _SHORT = 5126, 5125, 5123
"""Types of numbers, float32, uint32 and uint16, as OpenGL numbers them."""

_STORED = {_FLOAT: "<f4", _WHOLE: "<u4", _SHORT: "<u2"}

_IN_A_SET = 4
"""Joints that one attribute has for each vertex."""

_MAX_JOINTS = 1 << 16
"""Joints that uint16 numbers."""

_SHEARED = 1e-6
"""Share of an animated node's transform that a translation, rotation and scale may not have."""

_MIPPED = 9987
"""OpenGL's number for mixing four texels of each of two mip levels."""

_KINDS = {width: kind for kind, width in WIDTHS.items() if width <= 4}
"""What rows of so many numbers are called."""

_LENGTHS, _LENGTH_STEP = 1024, 2.0**-20
"""How many lengths are tried for a normal, and how far apart."""

_SEEN_ROUNDING = 1e-5
"""Share of a mesh's extent by which its positions may be rounded without a warning."""

_USUAL_WIDTH = 1.5
"""Width of lines, pixels, that nobody said, as `Lines` has it."""

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
    place = checked_path(path, FORMATS)
    writer = _Writer(scene)
    content = writer.gltf() if place.suffix.lower() == ".gltf" else writer.glb()
    with replacing(place) as temporary:
        temporary.write_bytes(content)
    writer.left_out.warn(str(place))


class _Writer:
    """Turns a scene into a header and a buffer; ``left_out`` names what they lack."""

    def __init__(self, scene: Scene) -> None:
        self.left_out = NotSaved("glTF")
        self._parts: list[bytes] = []
        self._length = 0
        self._lists: dict[str, list[dict[str, Any]]] = {}
        self._extensions: list[str] = []
        self._lights: list[dict[str, Any]] = []
        self._variants = scene.variants
        self._known: dict[Any, int] = {}
        if not scene.nodes:
            raise ValueError("scene must hold at least one mesh to be saved, got an empty scene")
        self._animations = scene._own_animations()
        roots = self._add_nodes(scene)
        self._add_animations()
        for light in scene.lights:
            roots += self._light(light)
        roots += self._camera(scene.camera)
        self._scene = {"nodes": roots}
        for name in EFFECT_FIELDS:
            if getattr(scene, name) is not None:
                self.left_out.note(name)
        if scene.variant is not None:
            self.left_out.note(f"the choice of the variant {scene.variant!r}")

    def header(self, **buffer: Any) -> dict[str, Any]:
        """Return the JSON of the file, given what its buffer says besides its length."""
        header: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "RasterJIT"},
            "scene": 0,
            "scenes": [self._scene],
            **self._lists,
            "buffers": [{"byteLength": self._length, **buffer}],
        }
        if self._variants:
            self._use(VARIANTS)
            variants = [{"name": name} for name in self._variants]
            header["extensions"] = {VARIANTS: {"variants": variants}}
        if self._lights:
            header.setdefault("extensions", {})[LIGHTS] = {"lights": self._lights}
        if self._extensions:
            header["extensionsUsed"] = self._extensions
        return header

    def gltf(self) -> bytes:
        """Return the file as text, its buffer in it."""
        content = base64.b64encode(b"".join(self._parts)).decode("ascii")
        return _json(self.header(uri=f"data:application/octet-stream;base64,{content}"))

    def glb(self) -> bytes:
        """Return the file as bytes."""
        text, content = _padded(_json(self.header()), b" "), b"".join(self._parts)
        chunks = b"".join(
            struct.pack("<II", len(data), kind) + data
            for data, kind in ((text, JSON_CHUNK), (content, BINARY_CHUNK))
        )
        return struct.pack("<4sII", GLB_MAGIC, 2, 12 + len(chunks)) + chunks

    def _append(self, section: str, entry: dict[str, Any]) -> int:
        """Add an entry to a list of the header, and return its number."""
        entries = self._lists.setdefault(section, [])
        entries.append(entry)
        return len(entries) - 1

    def _once(self, key: Any, section: str, entry: dict[str, Any]) -> int:
        """Add an entry unless one of this key is there, and return its number."""
        if key not in self._known:
            self._known[key] = self._append(section, entry)
        return self._known[key]

    def _use(self, extension: str) -> None:
        """Name an extension among those that the file uses."""
        if extension not in self._extensions:
            self._extensions.append(extension)

    def _view(self, content: bytes, **said: Any) -> int:
        """Add bytes to the buffer, and return the number of their view."""
        entry = {"buffer": 0, "byteOffset": self._length, "byteLength": len(content), **said}
        self._parts.append(_padded(content, b"\0"))
        self._length += len(self._parts[-1])
        return self._append("bufferViews", entry)

    def _accessor(self, rows: NDArray[Any], kind: str, component: int, **said: Any) -> int:
        """Add rows of numbers, and return the number of their accessor."""
        content = np.ascontiguousarray(rows, _STORED[component])
        target = _CORNERS if component == _WHOLE else _VERTICES
        view = self._view(content.tobytes(), target=target)
        return self._append(
            "accessors",
            {
                "bufferView": view,
                "componentType": component,
                "count": len(content),
                "type": kind,
                **said,
            },
        )

    def _add_nodes(self, scene: Scene) -> list[int]:
        """Add all nodes, parents before their children, and return the topmost."""
        drawn, order = set(map(id, scene.nodes)), []
        moved = {id(one.node) for every in self._animations for one in every.channels}
        numbers: dict[int, int] = {}
        self._numbers = numbers
        every_node = list(scene._all_nodes())
        skinned: list[tuple[dict[str, Any], Skin]] = []
        for node in every_node:
            entry: dict[str, Any] = {"name": str(node.name)}
            if id(node) in moved:
                entry.update(self._placed(node))
            elif not np.array_equal(node.transform, np.eye(4)):
                entry["matrix"] = _columns(node.transform)
            if id(node) in drawn and node.mesh is not None:
                entry["mesh"] = self._mesh(node)
                order.append(node)
                if node.skin is not None:
                    skinned.append((entry, node.skin))
                if node.weights is not None:
                    entry["weights"] = node.weights.tolist()
            if node.label is not None:
                self.left_out.note("labels")
            numbers[id(node)] = number = self._append("nodes", entry)
            if node.parent is not None:
                above = self._lists["nodes"][numbers[id(node.parent)]]
                above.setdefault("children", []).append(number)
        if any(one is not other for one, other in zip(order, scene.nodes, strict=False)):
            self.left_out.note("order of the objects, which is that of the tree")
        for entry, skin in skinned:
            entry["skin"] = self._skin(skin)
        return [numbers[id(node)] for node in every_node if node.parent is None]

    def _placed(self, node: Node) -> dict[str, Any]:
        """Return what a node that is animated says of its transform: it has to have no matrix."""
        trs, entry = node.trs, {}
        difference = np.abs(matrix_of(trs) - node.transform).max()
        if difference > _SHEARED * np.abs(node.transform).max():
            self.left_out.note(f"shear of {node.name!r}, which is animated")
        if trs.translation != (0.0, 0.0, 0.0):
            entry["translation"] = list(trs.translation)
        if trs.rotation != (0.0, 0.0, 0.0, 1.0):
            entry["rotation"] = list(trs.rotation)
        if trs.scale != (1.0, 1.0, 1.0):
            entry["scale"] = list(trs.scale)
        return entry

    def _skin(self, skin: Skin) -> int:
        """Add a skin, once for all nodes that have it, and return its number."""
        key = "skin", id(skin)
        if key in self._known:
            return self._known[key]
        with np.errstate(over="ignore"):
            columns = skin.inverse_binds.transpose(0, 2, 1).reshape(-1, 16).astype(np.float32)
        if not np.isfinite(columns).all():
            raise ValueError(f"{skin!r} must have inverse_binds that fit float32 to be saved")
        entry: dict[str, Any] = {
            "joints": [self._numbers[id(joint)] for joint in skin.joints],
            "inverseBindMatrices": self._numbers_of(columns, "MAT4"),
        }
        if skin.name:
            entry["name"] = str(skin.name)
        return self._once(key, "skins", entry)

    def _numbers_of(self, rows: NDArray[Any], kind: str, **said: Any) -> int:
        """Add rows of float32 that are no vertices, and return the number of their accessor."""
        content = np.ascontiguousarray(rows, "<f4")
        entry = {
            "bufferView": self._view(content.tobytes()), "componentType": _FLOAT,
            "count": len(content), "type": kind, **said,
        }  # fmt: skip
        return self._append("accessors", entry)

    def _add_animations(self) -> None:
        """Add how the nodes move."""
        for animation in self._animations:
            channels: list[dict[str, Any]] = []
            samplers: list[dict[str, Any]] = []
            for one in animation.channels:
                with np.errstate(over="ignore"):
                    times, values = one.times.astype(np.float32), one.values.astype(np.float32)
                what = f"{one.path} of {one.node.name!r} in animation {animation.name!r}"
                if not (np.diff(times) > 0.0).all() or not np.isfinite(values).all():
                    self.left_out.note(f"{what}, whose keys float32 has not")
                    continue
                width = CHANNEL_WIDTHS.get(one.path, 1)
                bounds = {"min": [float(times[0])], "max": [float(times[-1])]}
                samplers.append(
                    {
                        "input": self._numbers_of(times, "SCALAR", **bounds),
                        "output": self._numbers_of(values.reshape(-1, width), _KINDS[width]),
                        "interpolation": one.interpolation,
                    }
                )
                target = {"node": self._numbers[id(one.node)], "path": one.path}
                channels.append({"sampler": len(samplers) - 1, "target": target})
            if channels:
                entry = {"name": str(animation.name), "channels": channels, "samplers": samplers}
                self._append("animations", entry)

    def _joints(self, mesh: Mesh, rows: NDArray[Any] | slice, attributes: dict[str, int]) -> None:
        """Add which joints vertices follow, and how much, four in each attribute."""
        if mesh.joints is None or mesh.weights is None:
            return
        if int(mesh.joints.max()) >= _MAX_JOINTS:
            self.left_out.note(f"joints of a mesh from number {_MAX_JOINTS} on")
            return
        count = -(-mesh.joints.shape[1] // _IN_A_SET) * _IN_A_SET
        missing = ((0, 0), (0, count - mesh.joints.shape[1]))
        joints, weights = (np.pad(one[rows], missing) for one in (mesh.joints, mesh.weights))
        for number in range(count // _IN_A_SET):
            columns = slice(number * _IN_A_SET, (number + 1) * _IN_A_SET)
            attributes[f"JOINTS_{number}"] = self._accessor(joints[:, columns], "VEC4", _SHORT)
            attributes[f"WEIGHTS_{number}"] = self._accessor(weights[:, columns], "VEC4", _FLOAT)

    def _targets(
        self, node: Node, targets: MorphTargets, rows: NDArray[Any] | slice
    ) -> list[dict[str, int]]:
        """Add morph targets, and return what their primitive says of them."""
        found: list[dict[str, int]] = [{} for _ in range(len(targets))]
        kinds = {
            "POSITION": targets.positions, "NORMAL": targets.normals, "TANGENT": targets.tangents,
        }  # fmt: skip
        for name, values in kinds.items():
            for entry, moved in zip(found, () if values is None else values, strict=False):
                with np.errstate(over="ignore"):
                    stored = moved[rows].astype(np.float32)
                if not np.isfinite(stored).all():
                    raise ValueError(
                        f"the morph targets of {node.name!r} must fit float32 to be saved"
                    )
                bounds = {}
                if name == "POSITION":
                    low, high = stored.min(axis=0), stored.max(axis=0)
                    bounds = {"min": low.tolist(), "max": high.tolist()}
                entry[name] = self._accessor(stored, "VEC3", _FLOAT, **bounds)
        return found

    def _mesh(self, node: Node) -> int:
        """Add a node's mesh, once for all its instances, and return its number."""
        mesh = node.mesh
        key = "mesh", id(mesh)
        if key in self._known:
            return self._known[key]
        if isinstance(mesh, Points):
            return self._once(key, "meshes", {"primitives": [self._points(node, mesh)]})
        if mesh.invalid_vertices:
            raise ValueError(
                f"the mesh of {node.name!r} must have finite vertices to be saved, got "
                f"{mesh.invalid_vertices} with NaN or infinity"
            )
        if isinstance(mesh, Lines):
            return self._once(key, "meshes", {"primitives": [self._lines(node, mesh)]})
        corners: NDArray[np.integer] = mesh.faces.ravel()
        colors: NDArray[np.float32] | None
        # glTF colours vertices alone: with colours by face, each face gets its own.
        rows: Any = slice(None) if mesh.face_colors is None else corners
        if mesh.face_colors is not None:
            colors, corners = np.repeat(mesh.face_colors, 3, axis=0), np.arange(len(corners))
        else:
            colors = mesh.shown_vertex_colors()
        if mesh.field is not None:
            self.left_out.note("scalars, but for their colours")
        attributes = {"POSITION": self._positions(node, mesh.vertices[rows])}
        normals = self._units(mesh.vertex_normals()[rows])
        attributes["NORMAL"] = self._accessor(normals, "VEC3", _FLOAT)
        if mesh.tangents is not None:
            tangents = mesh.tangents[rows].copy()
            tangents[:, :3] = self._units(tangents[:, :3])
            attributes["TANGENT"] = self._accessor(tangents, "VEC4", _FLOAT)
        for number, uv in enumerate(mesh.uv_sets):
            if uv is not None:
                values = self._coordinates(uv[rows])
                attributes[f"TEXCOORD_{number}"] = self._accessor(values, "VEC2", _FLOAT)
        if colors is not None:
            attributes["COLOR_0"] = self._accessor(colors, "VEC4", _FLOAT)
        self._add_own(mesh, rows, attributes)
        self._joints(mesh, rows, attributes)
        primitive: dict[str, Any] = {
            "attributes": attributes,
            "indices": self._accessor(corners, "SCALAR", _WHOLE),
        }
        said: dict[str, Any] = {}
        targets = mesh.morph_targets
        if targets is not None:
            primitive["targets"] = self._targets(node, targets, rows)
            if targets.weights is not None:
                said["weights"] = targets.weights.tolist()
            if targets.names:
                said["extras"] = {"targetNames": list(targets.names)}
        if (targets is not None or mesh.joints is not None) and mesh._makes_normals:
            self.left_out.note("normals that are made anew for each pose, but for those at rest")
        if mesh.default_material != UnsaidMaterial():
            primitive["material"] = self._material(mesh.default_material, colors is not None)
        if mesh.variants:
            numbers = {
                name: self._material(material, colors is not None)
                for name, material in mesh.variants.items()
            }
            mappings = written_mappings(numbers, self._variants)
            primitive["extensions"] = {VARIANTS: mappings}
        return self._once(key, "meshes", {"primitives": [primitive], **said})

    def _add_own(self, mesh: Mesh, rows: NDArray[Any] | slice, attributes: dict[str, int]) -> None:
        """Add the attributes of vertices, or of points, of some rows."""
        of_rows = mesh.attributes if isinstance(mesh, Points) else mesh.vertex_attributes
        for name, values in of_rows.items():
            if values.shape[1] in _KINDS:
                kind = _KINDS[values.shape[1]]
                attributes[f"_{name}"] = self._accessor(values[rows], kind, _FLOAT)
            else:
                self.left_out.note(f"attribute {name!r} of more than 4 numbers")
        for name in () if isinstance(mesh, Points) else mesh.face_attributes:
            self.left_out.note(f"attribute {name!r} of faces")

    def _points(self, node: Node, mesh: Points) -> dict[str, Any]:
        """Add points, those that are finite, and return their primitive."""
        rows = np.isfinite(mesh.vertices).all(axis=1)
        if mesh.invalid_vertices:
            self.left_out.note("points that are NaN or infinite")
        most = max(USUAL_SIZE, default_size(len(mesh)))
        if mesh.shape != "square" or mesh.unit != "pixel" or (mesh.sizes > most).any():
            self.left_out.note("sizes and shapes of points")
        attributes = {"POSITION": self._positions(node, mesh.vertices[rows])}
        if mesh.normals is not None:
            attributes["NORMAL"] = self._accessor(self._units(mesh.normals[rows]), "VEC3", _FLOAT)
        return self._without_faces(mesh, POINTS, rows, mesh.colors, attributes)

    def _lines(self, node: Node, mesh: Lines) -> dict[str, Any]:
        """Add segments, whose points are their own if they have colours; return their primitive."""
        ends, colors = mesh.segments.ravel(), mesh.shown_vertex_colors()
        rows: Any = slice(None)
        if mesh.unit != "pixel" or (mesh.widths != _USUAL_WIDTH).any() or len(mesh.dashes):
            self.left_out.note("widths and dashes of lines")
        if mesh.face_colors is not None:
            rows, colors = ends, np.repeat(mesh.face_colors, 2, axis=0)
            ends = np.arange(len(ends), dtype=ends.dtype)
        attributes = {"POSITION": self._positions(node, mesh.vertices[rows])}
        if mesh.face_colors is None and colors is not None:
            colors = colors[rows]
        primitive = self._without_faces(mesh, LINES, rows, colors, attributes)
        primitive["indices"] = self._accessor(ends, "SCALAR", _WHOLE)
        return primitive

    def _without_faces(
        self, mesh: Mesh, mode: int, rows: Any, colors: NDArray[np.float32] | None,
        attributes: dict[str, int],
    ) -> dict[str, Any]:  # fmt: skip
        """Add what points and lines have besides their places, and return their primitive."""
        if mesh.field is not None:
            self.left_out.note("scalars, but for their colours")
        if colors is not None:
            shown = colors[rows] if mode == POINTS else colors
            attributes["COLOR_0"] = self._accessor(shown, "VEC4", _FLOAT)
        self._add_own(mesh, rows, attributes)
        primitive: dict[str, Any] = {"attributes": attributes, "mode": mode}
        if mesh.default_material != UnsaidMaterial():
            primitive["material"] = self._material(mesh.default_material, colors is not None)
        if mesh.variants:
            self.left_out.note("variants of points and lines")
        return primitive

    def _units(self, normals: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return normals or tangents as they are stored."""
        return lasting_units(normals)[0]

    def _positions(self, node: Node, vertices: NDArray[np.float64]) -> int:
        """Add positions, with their bounds, and return the number of their accessor."""
        with np.errstate(over="ignore", under="ignore"):
            stored = vertices.astype(np.float32)
        if not np.isfinite(stored).all():
            raise ValueError(
                f"the mesh of {node.name!r} must have vertices that fit float32 to be saved, got "
                f"{float(np.abs(vertices).max())!r} in size"
            )
        error = float(np.abs(stored - vertices).max())
        if error > _SEEN_ROUNDING * float(np.ptp(vertices, axis=0).max()):
            self.left_out.note_rounded(
                f"positions of {node.name!r}, by {error:.2g}: so far from the origin float32 has "
                "no finer ones"
            )
        bounds = {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
        return self._accessor(stored, "VEC3", _FLOAT, **bounds)

    def _coordinates(self, uv: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return texture coordinates with v downwards."""
        given = uv.astype(np.float64)
        stored = np.column_stack([uv[:, 0], 1.0 - given[:, 1]]).astype(np.float32)
        return stored

    def _material(self, material: Material, has_colors: bool) -> int:
        """Add a material, and return its number."""
        color = material.base_color_over(has_colors)
        key = "material", id(material), color
        if key in self._known:
            return self._known[key]
        if ("material", id(material), material.base_color_over(not has_colors)) in self._known:
            self.left_out.note("one material of meshes with and without colours: it becomes two")
        core: dict[str, Any] = {"baseColorFactor": list(color)}
        entry: dict[str, Any] = {"pbrMetallicRoughness": core}
        if material.name is not None:
            entry["name"] = str(material.name)
        if material.alpha_mode != "opaque":
            entry["alphaMode"] = MODE_NAMES[material.alpha_mode]
        if material.alpha_mode == "mask":
            entry["alphaCutoff"] = material.alpha_cutoff
        if material.double_sided:
            entry["doubleSided"] = True
        is_unlit = material.shading == "unlit"
        core["metallicFactor"], core["roughnessFactor"] = _microfacets(material)
        if is_unlit:
            self._use(UNLIT)
            entry["extensions"] = {UNLIT: {}}
            if material.emits:
                self.left_out.note("emission of unlit materials")
        elif material.shading != "pbr" and not _has_default_highlights(material):
            self.left_out.note(
                f"{material.shading} shading, which becomes metallic-roughness as wide"
            )
        if not is_unlit:
            self._emission(material, entry)
        self._textures(material, entry, core, is_unlit)
        return self._once(key, "materials", entry)

    def _emission(self, material: Material, entry: dict[str, Any]) -> None:
        """Say what light a material sends out."""
        strength = max(material.emissive)
        if strength <= 0.0:
            return
        if strength > 1.0:
            self._use(STRENGTH)
            entry.setdefault("extensions", {})[STRENGTH] = {"emissiveStrength": strength}
        entry["emissiveFactor"] = [part / max(strength, 1.0) for part in material.emissive]

    def _textures(
        self, material: Material, entry: dict[str, Any], core: dict[str, Any], is_unlit: bool
    ) -> None:
        """Say the textures of a material, and what lies over it."""
        first, uses = True, {}
        for field, (key, color_space) in (TEXTURES | LAYER_TEXTURES).items():
            texture = getattr(material, field)
            if texture is None:
                continue
            if field in LAYER_TEXTURES and material.shading != "pbr":
                continue
            if is_unlit and field != "base_color_texture":
                if texture in material.textures_read():
                    self.left_out.note(f"{field} of unlit materials")
                continue
            use = self._texture(texture, color_space, field)
            if first and texture.uv_set:
                self.left_out.note("uv before uv1, which the first texture reads")
            first = False
            if field == "normal_texture":
                use["scale"] = material.normal_scale
            elif field == "occlusion_texture":
                use["strength"] = material.occlusion_strength
            inside = field in ("base_color_texture", "metallic_roughness_texture")
            if field in LAYER_TEXTURES:
                uses[field] = use
            else:
                (core if inside else entry)[key] = use
        if material.shading != "pbr":
            return
        for name, told in told_by(material, uses).items():
            self._use(name)
            entry.setdefault("extensions", {})[name] = told

    def _texture(self, texture: Texture, color_space: str, field: str) -> dict[str, Any]:
        """Add a texture, its picture and its sampler, and return how it is used."""
        number = self._once(
            ("texture", id(texture.pyramid), color_space, texture.wrap, texture.filter),
            "textures",
            {"source": self._picture(texture, color_space), "sampler": self._sampler(texture)},
        )
        use: dict[str, Any] = {"index": number}
        if texture.uv_set:
            use["texCoord"] = texture.uv_set
        if texture.anisotropy > 1:
            self.left_out.note(f"anisotropy of a {field}")
        if texture.transform is not None:
            self._use(_TRANSFORM)
            # The other way round about, what turns v over turns it back.
            offset, _, factors = turned_over(texture.offset, -texture.rotation, texture.scale)
            use["extensions"] = {
                _TRANSFORM: {
                    "offset": list(offset),
                    "rotation": math.radians(texture.rotation),
                    "scale": list(factors),
                }
            }
        return use

    def _picture(self, texture: Texture, color_space: str) -> int:
        """Add the picture of a texture as a PNG file of 8 bits, and return its number."""
        key = "image", id(texture.pyramid), color_space
        if key not in self._known:
            from PIL import Image

            codes, are_exact = nearest_codes(texture.image, color_space)
            if not are_exact:
                self.left_out.note_rounded("texels, to 8 bits from 0 to 1")
            if (codes[:, :, 3] == 255).all():
                codes = np.ascontiguousarray(codes[:, :, :3])
            file = io.BytesIO()
            Image.fromarray(codes).save(file, "PNG")
            view = self._view(file.getvalue())
            self._once(key, "images", {"bufferView": view, "mimeType": "image/png"})
        return self._known[key]

    def _sampler(self, texture: Texture) -> int:
        """Add how a texture wraps and filters, and return its number."""
        across, up = (_WRAP_NUMBERS[name] for name in texture.wrap)
        nearest, smooth = (NEAREST, NEAREST), (LINEAR, LINEAR)
        filters = {"nearest": nearest, "bilinear": smooth, "trilinear": (LINEAR, _MIPPED)}
        magnified, minified = filters[texture.filter]
        entry = {"magFilter": magnified, "minFilter": minified, "wrapS": across, "wrapT": up}
        return self._once(("sampler", *entry.values()), "samplers", entry)

    def _light(self, light: Light) -> list[int]:
        """Add a light and the node that it stands at, and return that; none if there is no word."""
        if isinstance(light, AmbientLight):
            self.left_out.note(type(light).__name__)
            return []
        if light.shadow is not None:
            self.left_out.note(f"shadow of a {type(light).__name__}")
        # As reading divides by it: a white surface sends back 1/pi of what falls on it.
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
        self._use(LIGHTS)
        self._lights.append(entry)
        node = {
            "matrix": _columns(looking_along(position, direction)),
            "extensions": {LIGHTS: {"light": len(self._lights) - 1}},
        }
        return [self._append("nodes", node)]

    def _camera(self, camera: Any) -> list[int]:
        """Add the camera and the node that it stands at, and return that; none if there is none."""
        if camera is None:
            return []
        if isinstance(camera, PerspectiveCamera):
            kind, lens = "perspective", {"yfov": math.radians(camera.fov_y)}
            near, far = camera.depth_coefficients()[0], camera.far
        elif isinstance(camera, OrthographicCamera) and camera.near >= 0.0:
            # The width is that of the picture; a file has to have one.
            kind, lens = "orthographic", {"ymag": camera.height / 2.0, "xmag": camera.height / 2.0}
            near, far = camera.view_depth([0.0, -1.0]).tolist()
        else:
            behind = ", whose near plane lies behind it" if hasattr(camera, "height") else ""
            self.left_out.note(type(camera).__name__ + behind)
            return []
        if camera.min_aspect:
            self.left_out.note("min_aspect of the camera")
        if isinstance(camera, PerspectiveCamera) and camera.pixel_aspect != 1.0:
            self.left_out.note("pixel_aspect of the camera")
        lens["znear"] = near
        if far != math.inf:
            lens["zfar"] = far
        matrix = np.eye(4)
        matrix[:3, :3] = camera.view_matrix()[:3, :3].T
        matrix[:3, 3] = camera.eye
        number = self._append("cameras", {"type": kind, kind: lens})
        return [self._append("nodes", {"camera": number, "matrix": _columns(matrix)})]


def _has_default_highlights(material: Material) -> bool:
    """Tell a Blinn-Phong material of whose shading nothing was said."""
    plain = Material()
    return all(
        getattr(material, name) == getattr(plain, name)
        for name in ("shading", "specular", "shininess")
    )


def _microfacets(material: Material) -> tuple[float, float]:
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


def lasting_units(normals: NDArray[np.float32]) -> tuple[NDArray[np.float32], int]:
    """
    Return normals that are the given ones when they have been brought to unit length again.

    Those rounded to float32 are not of unit length to the last bit, and one in a hundred would
    change. Of slightly other length it is rounded in other places, mostly so that it does not.

    Parameters
    ----------
    normals : (N, 3) float32
        As a mesh stores them.

    Returns
    -------
    lasting : (N, 3) float32
        Of unit length to a share of 0.0005.
    lost : int
        How many change all the same, by a last bit: eight in a million.
    """
    result = normals.copy()
    left = np.flatnonzero((rounded_units(result) != normals).any(axis=1))
    for step in range(1, _LENGTHS + 1):
        length = 1.0 + (step // 2 if step % 2 else -step // 2) * _LENGTH_STEP
        near = (normals[left].astype(np.float64) * length).astype(np.float32)
        found = (rounded_units(near) == normals[left]).all(axis=1)
        result[left[found]] = near[found]
        left = left[~found]
        if not len(left):
            break
    return result, len(left)


def rounded_units(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return vectors, (N, 3), of unit length or zero, as a mesh stores them."""
    return unit_rows(vectors.astype(np.float64)).astype(np.float32)


def looking_along(position: Any, direction: Any) -> NDArray[np.float64]:
    """Return the matrix, (4, 4), of something that stands somewhere, its -z a unit direction."""
    z = -np.array(direction, np.float64)
    least = np.zeros(3)
    least[np.abs(z).argmin()] = 1.0
    x = unit_rows(np.cross(least, z)[np.newaxis])[0]
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([x, np.cross(z, x), z, position])
    return matrix + 0.0


def _columns(matrix: NDArray[np.float64]) -> list[float]:
    """Return a matrix as glTF has it, column by column."""
    return matrix.T.ravel().tolist()


def _json(header: dict[str, Any]) -> bytes:
    """Return a header as UTF-8."""
    return json.dumps(header, separators=(",", ":"), allow_nan=False).encode("utf-8")


def _padded(content: bytes, filler: bytes) -> bytes:
    """Return bytes, filled up to a multiple of `_ALIGNMENT`."""
    return content + filler * (-len(content) % _ALIGNMENT)
