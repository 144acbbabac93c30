"""
Convert the materials and meshes of glTF files to `Material` and `Mesh`.

Materials keep their textures; core properties follow [1]_, extensions [2]_. Each primitive of
triangles becomes one `Mesh`, of lines `Lines` and of points `Points`; those without normals are
unlit, as section 3.7.2.1 has it.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), sections 3.8 and 3.9.
.. [2] The Khronos Group, "KHR_texture_transform", "KHR_materials_unlit",
   "KHR_materials_emissive_strength", "EXT_texture_webp", "KHR_materials_pbrSpecularGlossiness";
   those that lay something over a material are in ``extensions``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.io.gltf.animations import read_joints_and_targets, set_morph_weights
from rasterjit.io.gltf.compression import KTX2_SIGNATURE, decode_draco, decode_ktx2
from rasterjit.io.gltf.extensions import (
    DRACO,
    EXTENSION_FORMATS,
    EXTENSION_TEXTURES,
    IMAGE_EXTENSIONS,
    read_extensions,
    read_variant_materials,
    read_variant_names,
)
from rasterjit.io.gltf.file import GltfFile
from rasterjit.io.gltf.json_checks import (
    get_clamped,
    get_clamped_numbers,
    get_extension,
    get_integer,
    get_list,
    get_number,
    get_numbers,
    get_object,
    quote,
    require,
)
from rasterjit.io.load_warnings import MAX_REASON_LENGTH, LeftOut, MeshFileError, reason_of
from rasterjit.io.primitives import (
    Cloud,
    Context,
    LineSet,
    make_lines,
    make_mesh,
    make_points,
    select_finite,
)
from rasterjit.scene.color import linear_rows
from rasterjit.scene.light import MAX_RADIANCE
from rasterjit.scene.material import TEXTURE_FIELDS, DefaultMaterial, Material, with_textures
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.texture import UV_SETS, ColorSpace, Texture, flip_v
from rasterjit.scene.validation import brief

_REPEAT = 10497
WRAPS = {_REPEAT: "repeat", 33071: "clamp", 33648: "mirror"}
NEAREST, LINEAR = 9728, 9729
"""Numbers of OpenGL, which glTF samplers use."""

UNLIT = "KHR_materials_unlit"
EMISSIVE_STRENGTH = "KHR_materials_emissive_strength"
SPECULAR_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"

ALPHA_MODES = {"OPAQUE": "opaque", "MASK": "mask", "BLEND": "blend"}
ALPHA_MODE_NAMES = {mode: name for name, mode in ALPHA_MODES.items()}

TEXTURE_PROPERTIES: dict[str, tuple[str, ColorSpace]] = {
    "base_color_texture": ("baseColorTexture", "srgb"),
    "normal_texture": ("normalTexture", "linear"),
    "metallic_roughness_texture": ("metallicRoughnessTexture", "linear"),
    "occlusion_texture": ("occlusionTexture", "linear"),
    "emissive_texture": ("emissiveTexture", "srgb"),
}
"""Name in glTF and trimesh, and colour space, of the texture fields of `Material`."""

TRIANGLES, STRIP, FAN = 4, 5, 6
POINTS, LINES, LINE_LOOP, LINE_STRIP = 0, 1, 2, 3
"""Modes of primitives, by their OpenGL numbers."""

_MEMORY_PER_DRACO_ROW = 64
"""Bytes of memory for a row of an accessor that Draco decodes."""

_MEMORY_PER_FACE, _MEMORY_PER_SPLIT_FACE = 64, 512
"""Bytes of memory for a face with normals, and for one without, whose creases are split."""


class MaterialReader:
    """
    Read the materials of a file, each once.

    Parameters
    ----------
    file : GltfFile
    left_out : LeftOut
        Notes what cannot be shown, by the name of the material and the field.
    """

    def __init__(self, file: GltfFile, left_out: LeftOut) -> None:
        self._file = file
        self._left_out = left_out
        self._materials: dict[Any, tuple[Material, list[int]]] = {}
        self._textures: dict[tuple, Texture | ValueError] = {}
        """Textures by image and sampler, or why they cannot be read."""

    def read(self, number: Any) -> tuple[Material | None, list[int]]:
        """
        Return a material, or None if it cannot be read, and the numbers of its UV sets.

        A mesh has two sets at most: the first that textures of the material use. Textures that use
        a third are left out.
        """
        try:
            entry = self._file.get_entry("materials", number)
        except LookupError:
            self._left_out.note(f"reference to material {quote(number)}, which the file has not")
            return None, []
        except ValueError as error:
            self._left_out.note(str(error))
            return None, []
        if number not in self._materials:
            label = f"material {brief(entry.get('name', number))}"
            try:
                self._materials[number] = self._convert_material(entry, label)
            except ValueError as error:
                self._left_out.note(f"{label}, which is damaged: {reason_of(error)}")
                return None, []
        return self._materials[number]

    def _convert_material(self, entry: dict[str, Any], label: str) -> tuple[Material, list[int]]:
        """Return an entry as a material, and the numbers of the UV sets that it uses."""
        extensions = get_object(entry, "extensions")
        values = {**entry, **get_object(entry, "pbrMetallicRoughness")}
        if SPECULAR_GLOSSINESS in extensions:
            values.update(_convert_specular_glossiness(get_object(extensions, SPECULAR_GLOSSINESS)))
            self._left_out.note(f"specular colour of {label}")
        *color, alpha = get_clamped_numbers(values, "baseColorFactor", (1.0, 1.0, 1.0, 1.0), 1.0)
        mode = ALPHA_MODES.get(str(entry.get("alphaMode")), "opaque")
        options: dict[str, Any] = {
            "base_color": (*color, 1.0 if mode == "opaque" else alpha),
            "name": entry.get("name"),
            "alpha_mode": mode,
            "alpha_cutoff": get_clamped(entry, "alphaCutoff", 0.5, 1e6),
            "double_sided": bool(entry.get("doubleSided", False)),
        }
        fields, infos = read_extensions(extensions)
        textures, uv_sets = self._read_textures({**values, **infos}, UNLIT in extensions, label)
        if UNLIT in extensions:
            return Material(shading="unlit", **options, **textures), uv_sets
        emission = get_object(extensions, EMISSIVE_STRENGTH)
        strength = get_clamped(emission, "emissiveStrength", 1.0, MAX_RADIANCE)
        emissive = get_clamped_numbers(values, "emissiveFactor", (0.0, 0.0, 0.0), 1.0)
        material = Material(
            shading="pbr",
            metallic=get_clamped(values, "metallicFactor", 1.0, 1.0),
            roughness=get_clamped(values, "roughnessFactor", 1.0, 1.0),
            normal_scale=get_clamped(get_object(values, "normalTexture"), "scale", 1.0, 1e3, -1e3),
            occlusion_strength=get_clamped(
                get_object(values, "occlusionTexture"), "strength", 1.0, 1.0
            ),
            emissive=tuple(strength * part for part in emissive),
            **fields,
            **options,
            **textures,
        )
        return material, uv_sets

    def _read_textures(
        self, values: dict[str, Any], is_unlit: bool, label: str
    ) -> tuple[dict[str, Any], list[int]]:
        """Return the textures of a material by field, and the UV sets that they use."""
        textures: dict[str, Any] = {}
        uv_sets: list[int] = []
        for field, (key, color_space) in (TEXTURE_PROPERTIES | EXTENSION_TEXTURES).items():
            if values.get(key) is None or (is_unlit and field != "base_color_texture"):
                continue
            try:
                use = get_object(values, key)
                transform = get_extension(use, "KHR_texture_transform")
                number = get_integer({**use, **transform}, "texCoord", 0)
                texture = self._make_texture(use, transform, color_space)
            except Exception as error:
                # Pictures of files are decoded by Pillow, which raises what it likes.
                reason = reason_of(error)
                self._left_out.note(f"{field} of {label} that cannot be read: {reason}")
                continue
            if number not in uv_sets:
                if len(uv_sets) == len(UV_SETS):
                    self._left_out.note(f"{field} of {label}: third set of texture coordinates")
                    continue
                uv_sets.append(number)
            position = uv_sets.index(number)
            textures[field] = texture.with_uv_set(UV_SETS[position]) if position else texture
        return textures, uv_sets

    def _make_texture(
        self, use: dict[str, Any], transform: dict[str, Any], color_space: ColorSpace
    ) -> Texture:
        """Return a texture of a material; textures of one image share its texels."""
        entry = self._file.get_entry("textures", require(use, "index"))
        options = self._read_sampler(entry.get("sampler"))
        texture = self._read_first_image(self._list_sources(entry), color_space, options)
        if not transform:
            return texture
        x, y = get_numbers(transform, "offset", (0.0, 0.0))
        across, up = get_numbers(transform, "scale", (1.0, 1.0))
        degrees = math.degrees(get_number(transform, "rotation", 0.0))
        return texture.with_transform(*flip_v((x, y), degrees, (across, up)))

    def _list_sources(self, entry: dict[str, Any]) -> list[tuple[str, Any]]:
        """Return the images of a texture with their extensions, its own image last."""
        extensions = get_object(entry, "extensions")
        pairs = [(name, get_object(extensions, name).get("source")) for name in IMAGE_EXTENSIONS]
        sources = [*pairs, ("", entry.get("source"))]
        present = [(name, number) for name, number in sources if number is not None]
        if not present:
            kinds = ", ".join(extensions) or "no source"
            raise ValueError(f"its picture is given by {kinds}")
        return present

    def _read_first_image(
        self, sources: list[tuple[str, Any]], color_space: ColorSpace, options: dict[str, Any]
    ) -> Texture:
        """Return the first image that can be read; note those before it."""
        for extension, number in sources[:-1]:
            try:
                return self._read_image_texture(extension, number, color_space, options)
            except ValueError as error:
                self._file.budget.check()
                self._left_out.note(f"{extension} of a texture, which has another: {error}")
        return self._read_image_texture(*sources[-1], color_space, options)

    def _read_image_texture(
        self, extension: str, number: Any, color_space: ColorSpace, options: dict[str, Any]
    ) -> Texture:
        """Return an image as a texture, read once, or raise ``ValueError`` naming it."""
        self._file.get_entry("images", number)
        key = (number, color_space, *options.values())
        if key not in self._textures:
            try:
                pixels = self._decode_pixels(number, EXTENSION_FORMATS.get(extension, ()))
                self._textures[key] = Texture(pixels, color_space=color_space, **options)
            except ValueError as error:
                self._textures[key] = error
        texture = self._textures[key]
        if isinstance(texture, ValueError):
            raise texture
        return texture

    def _decode_pixels(self, number: Any, extra_formats: tuple[str, ...]) -> NDArray[Any]:
        """Return the texels of an image, or raise ``ValueError`` naming it."""
        name = self._file.describe_image(number)
        try:
            content = self._file.read_image(number)
            decoder = self._file.decoder
            if content.startswith(KTX2_SIGNATURE):
                return decode_ktx2(content, name, self._file.budget, decoder)
            pixels: NDArray[Any] = decoder.decode("picture", content, name, extra_formats)
            return pixels
        except Exception as error:
            # Pillow raises what it likes about a damaged picture.
            raise ValueError(f"its picture, {name}: {reason_of(error)}") from error

    def _read_sampler(self, number: int | None) -> dict[str, Any]:
        """
        Return the wrap modes and the filter of a sampler, as `Texture` takes them.

        A magnification filter NEAREST is taken as ``"nearest"``, a minification filter without
        mip levels as ``"bilinear"``.
        """
        sampler = {} if number is None else self._file.get_entry("samplers", number)
        wrap = tuple(
            WRAPS.get(get_integer(sampler, key, _REPEAT), "repeat") for key in ("wrapS", "wrapT")
        )
        if sampler.get("magFilter") == NEAREST:
            return {"wrap": wrap, "filter": "nearest"}
        unmipped = sampler.get("minFilter") in (NEAREST, LINEAR)
        return {"wrap": wrap, "filter": "bilinear" if unmipped else "trilinear"}


def _convert_specular_glossiness(values: dict[str, Any]) -> dict[str, Any]:
    """Approximate a specular-glossiness material by a dielectric of the same roughness."""
    properties = {
        "baseColorFactor": values.get("diffuseFactor", (1.0, 1.0, 1.0, 1.0)),
        "metallicFactor": 0.0,
        "roughnessFactor": 1.0 - get_clamped(values, "glossinessFactor", 1.0, 1.0),
    }
    if "diffuseTexture" in values:
        properties["baseColorTexture"] = values["diffuseTexture"]
    return properties


class MeshReader:
    """
    Read the meshes of a file, each once.

    Parameters
    ----------
    file : GltfFile
    materials : MaterialReader
    context : Context
    """

    def __init__(self, file: GltfFile, materials: MaterialReader, context: Context) -> None:
        self._file, self._materials = file, materials
        # The memory of buffers was counted where they were read.
        self._context, self._left_out = context._replace(budget=None), context.left_out
        self._meshes: dict[Any, list[Mesh]] = {}
        self._untextured: dict[tuple[Material, tuple[str, ...]], Material] = {}
        self._remapped: dict[tuple[Material, tuple[int, ...]], Material] = {}
        self._variant_names = read_variant_names(file.document, self._left_out)

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of the file's variants, in its order."""
        return tuple(name for name in self._variant_names if name is not None)

    @property
    def is_empty(self) -> bool:
        """Whether none of the meshes read so far has faces, lines or points."""
        return not any(self._meshes.values())

    def read(self, number: Any) -> list[Mesh]:
        """Return the meshes of a mesh of the file, one for each primitive; [] for a damaged one."""
        try:
            entry = self._file.get_entry("meshes", number)
        except LookupError:
            self._left_out.note(f"reference to mesh {quote(number)}, which the file has not")
            return []
        except ValueError as error:
            self._left_out.note(str(error))
            return []
        if number not in self._meshes:
            self._meshes[number] = []
            label = f"mesh {brief(entry.get('name', number))}"
            try:
                require(entry, "primitives")
                primitives = get_list(entry, "primitives")
            except ValueError as error:
                self._left_out.note(f"{label}, which cannot be read: {error}")
                return []
            read = (self._read_primitive(primitive, label) for primitive in primitives)
            meshes = [mesh for mesh in read if mesh is not None]
            self._meshes[number] = set_morph_weights(entry, meshes, label, self._left_out)
        return self._meshes[number]

    def _read_primitive(self, primitive: dict[str, Any], label: str) -> Mesh | None:
        """Return a primitive as a mesh, lines or points; None, with a note, if it is damaged."""
        try:
            overrides = self._decode_draco(primitive)
            with self._file.override_accessors(overrides):
                arrays = self._read_arrays(primitive, label, TRIANGLES if overrides else None)
        except (ValueError, TypeError, LookupError, AttributeError, OSError, MemoryError) as error:
            reason = " ".join(str(error).split())[:MAX_REASON_LENGTH] or type(error).__name__
            self._left_out.note(label, reason=f", which cannot be read: {reason}")
            return None
        if arrays is None:
            return None
        if isinstance(arrays, Cloud):
            return make_points(arrays, self._context)
        if isinstance(arrays, LineSet):
            return make_lines(arrays, self._context)
        variants = arrays.pop("variants")
        try:
            mesh = make_mesh(label, self._left_out, **arrays, on_invalid=self._context.on_invalid)
            if mesh.normals is None:
                mesh = mesh.split_creases(self._context.crease_angle)
            if variants:
                mesh.variants = variants
            return mesh
        except ValueError as error:
            raise MeshFileError(f"{self._context.source}: {label}: {error}") from error

    def _read_arrays(
        self, primitive: dict[str, Any], label: str, mode: int | None
    ) -> dict[str, Any] | Cloud | LineSet | None:
        """Return the arguments of `Mesh`, lines or points; None, with a note, for no geometry."""
        # Vertices and corners.
        if mode is None:
            mode = get_integer(primitive, "mode", TRIANGLES)
        attributes = get_object(primitive, "attributes")
        vertices = self._file.read_array(require(attributes, "POSITION"))
        if "indices" in primitive:
            corners = self._file.read_array(primitive["indices"])[:, 0].astype(np.int64)
        else:
            corners = np.arange(len(vertices))
        # Faces; points and lines have none.
        if mode in (POINTS, LINES, LINE_LOOP, LINE_STRIP):
            return self._make_points_or_lines(primitive, attributes, vertices, corners, mode, label)
        face_count = len(corners) if mode != TRIANGLES else len(corners) // 3
        memory_per_face = _MEMORY_PER_FACE if "NORMAL" in attributes else _MEMORY_PER_SPLIT_FACE
        self._file.budget.take(f"the faces of {label}", face_count * memory_per_face)
        faces = list_triangles(corners, mode)
        if not len(faces) or not len(vertices):
            self._left_out.note(f"{label}, which has no faces")
            return None
        # Materials, and the UV sets that their textures use.
        count = len(vertices)
        material, uv_sets = self._read_material(primitive)
        variants, uv_sets = self._read_variants(primitive, uv_sets, label)
        colors = self._read_colors(attributes, count, label)
        if primitive.get("material") is None:
            material = DefaultMaterial()
        # Attributes of the vertices.
        normals = self._read_attribute(attributes, "NORMAL", count, (3,), label)
        uv = [self._read_uv(attributes, uv_set, count, label) for uv_set in uv_sets or [0]]
        tangents = None
        materials = [one for one in (material, *variants.values()) if one is not None]
        if normals is not None and any(one.has_normal_map for one in materials):
            tangents = self._read_attribute(attributes, "TANGENT", count, (4,), label)
        # Textures without coordinates are left out.
        missing_sets = [number for number, values in enumerate(uv) if values is None]
        if material is not None:
            material = self._drop_textures(material, missing_sets, label)
        variants = {
            name: self._drop_textures(one, missing_sets, f"{label}, variant {brief(name)}")
            for name, one in variants.items()
        }
        return {
            "vertices": vertices,
            "faces": faces,
            "normals": normals,
            "uv": uv[0],
            "uv1": uv[1] if len(uv) > 1 else None,
            "colors": colors,
            "tangents": tangents,
            "attributes": self._read_custom_attributes(attributes, count, label),
            "material": material,
            "variants": variants,
            **read_joints_and_targets(
                self._file, primitive, count, (normals, tangents), label, self._left_out
            ),
        }

    def _read_variants(
        self, primitive: dict[str, Any], uv_sets: list[int], label: str
    ) -> tuple[dict[str, Material], list[int]]:
        """
        Return the materials of a primitive's variants by name, and the UV sets of all materials.

        A mesh has two sets: those of its default material come first.
        """
        numbers = read_variant_materials(primitive, self._variant_names, label, self._left_out)
        materials = {name: self._materials.read(number) for name, number in numbers.items()}
        used_sets = dict.fromkeys(uv_sets)
        for _, material_sets in materials.values():
            used_sets |= dict.fromkeys(material_sets)
        mesh_sets = list(used_sets)[: len(UV_SETS)]
        variants = {}
        for name, (material, material_sets) in materials.items():
            if material is not None:
                variant_label = f"{label}, variant {brief(name)}"
                variants[name] = self._remap_uv_sets(
                    material, material_sets, mesh_sets, variant_label
                )
        return variants, mesh_sets

    def _remap_uv_sets(
        self, material: Material, material_sets: list[int], mesh_sets: list[int], label: str
    ) -> Material:
        """Return a material whose textures number their UV sets as the mesh does."""
        if material_sets == mesh_sets[: len(material_sets)]:
            return material
        remapped: dict[str, Texture | None] = {}
        for field, texture in _get_textures(material).items():
            uv_set = material_sets[texture.uv_set]
            if uv_set in mesh_sets:
                remapped[field] = texture.with_uv_set(UV_SETS[mesh_sets.index(uv_set)])
            else:
                remapped[field] = None
                self._left_out.note(f"{field} of {label}: third set of texture coordinates")
        key = material, tuple(mesh_sets)
        if key not in self._remapped:
            self._remapped[key] = with_textures(material, remapped)
        return self._remapped[key]

    def _make_points_or_lines(
        self, primitive: dict[str, Any], attributes: dict[str, Any], vertices: NDArray[Any],
        corners: NDArray[np.int64], mode: int, label: str,
    ) -> Cloud | LineSet | None:  # fmt: skip
        """Return the points or lines of a primitive; None, with a note, if it has none."""
        count = len(vertices)
        if read_variant_materials(primitive, self._variant_names, label, self._left_out):
            self._left_out.note(f"variants of {label}, which has no faces")
        if len(corners) and not 0 <= corners.min() <= corners.max() < count:
            raise ValueError(f"indices must be below {count}, got {int(corners.max())}")
        kind = "points" if mode == POINTS else "lines"
        if len(corners) < (1 if mode == POINTS else 2):
            self._left_out.note(f"{label}, which has no {kind}")
            return None
        self._left_out.note(f"morph target of {kind}", len(get_list(primitive, "targets")))
        if any(name.startswith("JOINTS_") for name in attributes):
            self._left_out.note(f"joints of {kind}")
        self._file.budget.take(f"the points of {label}", count * _MEMORY_PER_SPLIT_FACE)
        colors = self._read_colors(attributes, count, label)
        rgba = None if colors is None else linear_rows("COLOR_0", colors)
        custom = self._read_custom_attributes(attributes, count, label)
        normals = None
        if mode == POINTS:
            normals = self._read_attribute(attributes, "NORMAL", count, (3,), label)
        material = self._read_material(primitive)[0]
        if material is not None:
            if any(texture is not None for texture in material.textures_read()):
                self._left_out.note(f"textures of {label}, which are those of faces")
            if normals is None:
                material = make_unlit(material)
            else:
                material = with_textures(material, dict.fromkeys(TEXTURE_FIELDS))
        if mode != POINTS:
            return LineSet(
                label, vertices, list_segments(corners, mode), rgba, False, custom, {}, material
            )
        if "indices" in primitive:
            vertices = vertices[corners]
            rgba = None if rgba is None else rgba[corners]
            normals = None if normals is None else normals[corners]
            custom = {name: values[corners] for name, values in custom.items()}
        return Cloud(label, vertices, rgba, normals, custom, material)

    def _decode_draco(self, primitive: Any) -> dict[int, NDArray[Any]]:
        """Return the arrays of a Draco primitive's accessors, as triangles; {} for others."""
        if not isinstance(primitive, dict):
            raise ValueError(f"a primitive must be an object, got {quote(primitive)}")
        extensions = get_object(primitive, "extensions")
        if DRACO not in extensions or self._has_uncompressed(primitive):
            return {}
        mode = get_integer(primitive, "mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP):
            raise ValueError(f"{DRACO}: mode must be {TRIANGLES} or {STRIP}, got {mode}")
        draco, accessors = get_object(extensions, DRACO), get_object(primitive, "attributes")
        numbers = {name: get_integer(accessors, name) for name in get_object(draco, "attributes")}
        corners = require(primitive, "indices")
        max_corners = get_integer(self._file.get_entry("accessors", corners), "count")
        for number in (corners, *numbers.values()):
            count = get_integer(self._file.get_entry("accessors", number), "count")
            self._file.budget.take("a Draco stream", count * _MEMORY_PER_DRACO_ROW)
        stream = self._file.read_view(require(draco, "bufferView"))
        mesh = decode_draco(stream, max_corners, self._file.decoder)
        decoded: dict[int, NDArray[Any]] = {corners: mesh.corners[:, None]}
        for name, number in numbers.items():
            attribute_id = get_integer(draco["attributes"], name)
            if attribute_id not in mesh.attributes:
                raise ValueError(f"{DRACO}: its stream has no attribute {attribute_id}, {name}")
            decoded[number] = mesh.attributes[attribute_id]
        return decoded

    def _has_uncompressed(self, primitive: dict[str, Any]) -> bool:
        """Tell whether the accessors of a compressed primitive have uncompressed data as well."""
        numbers = [*primitive["attributes"].values()]
        numbers += [primitive["indices"]] if "indices" in primitive else []
        accessors = [self._file.get_entry("accessors", number) for number in numbers]
        return all("bufferView" in one or "sparse" in one for one in accessors)

    def _read_material(self, primitive: dict[str, Any]) -> tuple[Material | None, list[int]]:
        """Return the material of a primitive, if it has one, and its UV sets."""
        if primitive.get("material") is None:
            return None, []
        return self._materials.read(primitive["material"])

    def _read_attribute(
        self, attributes: dict[str, int], name: str, count: int, widths: tuple[int, ...], label: str
    ) -> NDArray[np.float64] | None:
        """Return an attribute of all vertices; None if it is missing or, with a note, unusable."""
        if name not in attributes:
            return None
        return self._file.read_vertex_rows(
            attributes[name], count, widths, f"{name} of {label}", self._left_out
        )

    def _read_colors(
        self, attributes: dict[str, int], count: int, label: str
    ) -> NDArray[np.float64] | None:
        """Return the colours of the vertices, linear."""
        colors = self._read_attribute(attributes, "COLOR_0", count, (3, 4), label)
        return None if colors is None else np.clip(colors, 0.0, 1.0)

    def _read_custom_attributes(
        self, attributes: dict[str, int], count: int, label: str
    ) -> dict[str, NDArray[np.float32]]:
        """Return the custom attributes by name, without the ``_`` with which they begin."""
        arrays = {}
        for name, number in attributes.items():
            if not name.startswith("_"):
                continue
            try:
                arrays[name[1:]] = self._file.read_array(number)
            except (ValueError, TypeError, LookupError, OSError) as error:
                self._left_out.note(f"{name} of {label}, which cannot be read: {reason_of(error)}")
        return select_finite(arrays, count, self._left_out)

    def _read_uv(
        self, attributes: dict[str, int], uv_set: int, count: int, label: str
    ) -> NDArray[np.float64] | None:
        """Return a UV set with v upwards."""
        uv = self._read_attribute(attributes, f"TEXCOORD_{uv_set}", count, (2,), label)
        return None if uv is None else np.column_stack([uv[:, 0], 1.0 - uv[:, 1]])

    def _drop_textures(
        self, material: Material, missing_sets: Sequence[int], label: str
    ) -> Material:
        """Return a material without the textures whose UV set the mesh lacks."""
        textures = _get_textures(material)
        fields = tuple(name for name, one in textures.items() if one.uv_set in missing_sets)
        if not fields:
            return material
        dropped = "textures" if len(fields) == len(textures) else ", ".join(fields)
        self._left_out.note(f"{dropped} of {label}, which has no coordinates for them")
        if (material, fields) not in self._untextured:
            self._untextured[material, fields] = with_textures(material, dict.fromkeys(fields))
        return self._untextured[material, fields]


def _get_textures(material: Material) -> dict[str, Texture]:
    """Return the textures of a material by field."""
    textures = {field: getattr(material, field) for field in TEXTURE_FIELDS}
    return {field: texture for field, texture in textures.items() if texture is not None}


def make_unlit(material: Material) -> Material:
    """Return the unlit material of points and lines without normals: base colour plus emission."""
    *rgb, alpha = material.base_color_over(False)
    rgb_shown = [min(1.0, part + add) for part, add in zip(rgb, material.emissive, strict=True)]
    if material.shading == "unlit":
        rgb_shown = rgb
    return Material(
        shading="unlit", base_color=(*rgb_shown, alpha), name=material.name,
        alpha_mode=material.alpha_mode, alpha_cutoff=material.alpha_cutoff,
        double_sided=material.double_sided,
    )  # fmt: skip


def list_segments(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """
    Return the segments, (S, 2), of a primitive of lines.

    Parameters
    ----------
    corners : (N,) int
        Vertex numbers, two or more. The last one of an odd number of ``LINES`` is dropped.
    mode : int
        ``LINES``, ``LINE_LOOP`` or ``LINE_STRIP``.
    """
    if mode == LINES:
        return corners[: len(corners) // 2 * 2].reshape(-1, 2)
    strip = np.column_stack([corners[:-1], corners[1:]])
    if mode == LINE_STRIP:
        return strip
    return np.concatenate([strip, [[corners[-1], corners[0]]]])


def list_triangles(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """
    Return the triangles, (F, 3), of a primitive of triangles.

    Parameters
    ----------
    corners : (N,) int
        Vertex numbers. Those of a last, incomplete triangle are dropped.
    mode : int
        ``TRIANGLES``, ``STRIP`` or ``FAN``.

    Raises
    ------
    ValueError
        If the mode is none of these.
    """
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if mode not in (STRIP, FAN):
        raise ValueError(f"mode must be one of 0..6, got {mode}")
    steps = np.arange(max(len(corners) - 2, 0))
    if mode == FAN:
        center = np.full(len(steps), corners[0] if len(corners) else 0)
        return np.column_stack([corners[steps + 1], corners[steps + 2], center])
    # Every second triangle of a strip is turned over.
    odd = steps % 2
    return np.column_stack([corners[steps], corners[steps + 1 + odd], corners[steps + 2 - odd]])
