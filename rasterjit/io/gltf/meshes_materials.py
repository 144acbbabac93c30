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

from rasterjit.io.gltf.animations import read_posable, with_morph_weights
from rasterjit.io.gltf.compression import SIGNATURE, decode_draco, ktx2_pixels
from rasterjit.io.gltf.extensions import (
    DRACO,
    FURTHER_FORMATS,
    LAYER_TEXTURES,
    PICTURES,
    layers_of,
    mapped_materials,
    variant_names,
)
from rasterjit.io.gltf.file import GltfFile
from rasterjit.io.gltf.json_checks import (
    extension_of,
    finite_numbers_of,
    finite_of,
    list_of,
    needed,
    number_of,
    object_of,
    shown,
    whole_of,
)
from rasterjit.io.load_warnings import LeftOut, MeshFileError, reason_of
from rasterjit.io.primitives import (
    Cloud,
    LineDrawing,
    Reading,
    lines_of,
    mesh_of,
    points_of,
    usable_attributes,
)
from rasterjit.scene.color import linear_rows
from rasterjit.scene.light import BRIGHTEST
from rasterjit.scene.material import TEXTURE_FIELDS, Material, UnsaidMaterial, with_textures
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.texture import UV_SETS, ColorSpace, Texture, turned_over
from rasterjit.scene.validation import in_short

_REPEAT = 10497
WRAPS = {_REPEAT: "repeat", 33071: "clamp", 33648: "mirror"}
NEAREST, LINEAR = 9728, 9729
"""Numbers of OpenGL, which glTF samplers use."""

UNLIT = "KHR_materials_unlit"
STRENGTH = "KHR_materials_emissive_strength"
_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"

MODES = {"OPAQUE": "opaque", "MASK": "mask", "BLEND": "blend"}
MODE_NAMES = {mode: name for name, mode in MODES.items()}

TEXTURES: dict[str, tuple[str, ColorSpace]] = {
    "base_color_texture": ("baseColorTexture", "srgb"),
    "normal_texture": ("normalTexture", "linear"),
    "metallic_roughness_texture": ("metallicRoughnessTexture", "linear"),
    "occlusion_texture": ("occlusionTexture", "linear"),
    "emissive_texture": ("emissiveTexture", "srgb"),
}
"""What a field of `Material` is called in glTF and by trimesh, and what its numbers are."""

TRIANGLES, STRIP, FAN = 4, 5, 6
POINTS, LINES, LINE_LOOP, LINE_STRIP = 0, 1, 2, 3
"""How the vertices of a primitive are joined, as OpenGL numbers it."""

_DRACO_BYTES = 64
"""What a row of an accessor takes, as it is decoded, and as it is read."""

_FACE_BYTES, _SPLIT_FACE_BYTES = 64, 512
"""What a face takes, of a primitive with normals and of one that gets them."""


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
        self._known: dict[Any, tuple[Material, list[int]]] = {}
        self._textures: dict[tuple, Texture | ValueError] = {}
        """Each picture as it is used, or why it cannot be read."""

    def read(self, number: Any) -> tuple[Material | None, list[int]]:
        """
        Return a material, or None if it cannot be read, and its sets of texture coordinates.

        A mesh has two sets at most: the first that textures of the material use. Textures that use
        a third are left out.
        """
        try:
            entry = self._file.entry("materials", number)
        except LookupError:
            self._left_out.note(f"reference to material {shown(number)}, which the file has not")
            return None, []
        except ValueError as error:
            self._left_out.note(str(error))
            return None, []
        if number not in self._known:
            label = f"material {in_short(entry.get('name', number))}"
            try:
                self._known[number] = self._material(entry, label)
            except ValueError as error:
                self._left_out.note(f"{label}, which is damaged: {reason_of(error)}")
                return None, []
        return self._known[number]

    def _material(self, entry: dict[str, Any], label: str) -> tuple[Material, list[int]]:
        """Return an entry as a material, and its sets of texture coordinates."""
        extensions = object_of(entry, "extensions")
        values = {**entry, **object_of(entry, "pbrMetallicRoughness")}
        if _GLOSSINESS in extensions:
            values.update(_of_glossiness(object_of(extensions, _GLOSSINESS)))
            self._left_out.note(f"specular colour of {label}")
        *color, alpha = _numbers(values, "baseColorFactor", (1.0, 1.0, 1.0, 1.0), 1.0)
        mode = MODES.get(str(entry.get("alphaMode")), "opaque")
        options: dict[str, Any] = {
            "base_color": (*color, 1.0 if mode == "opaque" else alpha),
            "name": entry.get("name"),
            "alpha_mode": mode,
            "alpha_cutoff": number_of(entry, "alphaCutoff", 0.5, 1e6),
            "double_sided": bool(entry.get("doubleSided", False)),
        }
        laid, uses = layers_of(extensions)
        textures, uv_sets = self._read_textures({**values, **uses}, UNLIT in extensions, label)
        if UNLIT in extensions:
            return Material(shading="unlit", **options, **textures), uv_sets
        strength = number_of(object_of(extensions, STRENGTH), "emissiveStrength", 1.0, BRIGHTEST)
        emitted = _numbers(values, "emissiveFactor", (0.0, 0.0, 0.0), 1.0)
        material = Material(
            shading="pbr",
            metallic=number_of(values, "metallicFactor", 1.0, 1.0),
            roughness=number_of(values, "roughnessFactor", 1.0, 1.0),
            normal_scale=number_of(object_of(values, "normalTexture"), "scale", 1.0, 1e3, -1e3),
            occlusion_strength=number_of(
                object_of(values, "occlusionTexture"), "strength", 1.0, 1.0
            ),
            emissive=tuple(strength * part for part in emitted),
            **laid,
            **options,
            **textures,
        )
        return material, uv_sets

    def _read_textures(
        self, values: dict[str, Any], is_unlit: bool, label: str
    ) -> tuple[dict[str, Any], list[int]]:
        """Return the textures of a material by field, and their sets of texture coordinates."""
        found: dict[str, Any] = {}
        uv_sets: list[int] = []
        for field, (key, color_space) in (TEXTURES | LAYER_TEXTURES).items():
            if values.get(key) is None or (is_unlit and field != "base_color_texture"):
                continue
            try:
                use = object_of(values, key)
                transform = extension_of(use, "KHR_texture_transform")
                number = whole_of({**use, **transform}, "texCoord", 0)
                texture = self._texture(use, transform, color_space)
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
            place = uv_sets.index(number)
            found[field] = texture.with_uv_set(UV_SETS[place]) if place else texture
        return found, uv_sets

    def _texture(
        self, use: dict[str, Any], transform: dict[str, Any], color_space: ColorSpace
    ) -> Texture:
        """Return one use of a texture; uses of one picture share its texels."""
        entry = self._file.entry("textures", needed(use, "index"))
        options = self._sampler(entry.get("sampler"))
        texture = self._first_readable(self._sources(entry), color_space, options)
        if not transform:
            return texture
        x, y = finite_numbers_of(transform, "offset", (0.0, 0.0))
        across, up = finite_numbers_of(transform, "scale", (1.0, 1.0))
        degrees = math.degrees(finite_of(transform, "rotation", 0.0))
        return texture.with_transform(*turned_over((x, y), degrees, (across, up)))

    def _sources(self, entry: dict[str, Any]) -> list[tuple[str, Any]]:
        """Return the pictures that a texture names, those of extensions first, and what of."""
        extensions = object_of(entry, "extensions")
        named = [(name, object_of(extensions, name).get("source")) for name in PICTURES]
        sources = [*named, ("", entry.get("source"))]
        found = [(name, number) for name, number in sources if number is not None]
        if not found:
            kinds = ", ".join(extensions) or "no source"
            raise ValueError(f"its picture is given by {kinds}")
        return found

    def _first_readable(
        self, sources: list[tuple[str, Any]], color_space: ColorSpace, options: dict[str, Any]
    ) -> Texture:
        """Return the first picture that can be read, noting those before it."""
        for extension, number in sources[:-1]:
            try:
                return self._picture(extension, number, color_space, options)
            except ValueError as error:
                self._file.budget.check()
                self._left_out.note(f"{extension} of a texture, which has another: {error}")
        return self._picture(*sources[-1], color_space, options)

    def _picture(
        self, extension: str, number: Any, color_space: ColorSpace, options: dict[str, Any]
    ) -> Texture:
        """Return a picture as a texture, or raise ``ValueError`` naming it; each is read once."""
        self._file.entry("images", number)
        key = (number, color_space, *options.values())
        if key not in self._textures:
            try:
                pixels = self._pixels(number, FURTHER_FORMATS.get(extension, ()))
                self._textures[key] = Texture(pixels, color_space=color_space, **options)
            except ValueError as error:
                self._textures[key] = error
        found = self._textures[key]
        if isinstance(found, ValueError):
            raise found
        return found

    def _pixels(self, picture: Any, further: tuple[str, ...]) -> NDArray[Any]:
        """Return the texels of a picture, or raise ``ValueError`` naming it."""
        name = self._file.picture_name(picture)
        try:
            content = self._file.picture(picture)
            decoder = self._file.decoder
            if content.startswith(SIGNATURE):
                return ktx2_pixels(content, name, self._file.budget, decoder)
            pixels: NDArray[Any] = decoder.decode("picture", content, name, further)
            return pixels
        except Exception as error:
            # Pillow raises what it likes about a damaged picture.
            raise ValueError(f"its picture, {name}: {reason_of(error)}") from error

    def _sampler(self, number: int | None) -> dict[str, Any]:
        """
        Return how a sampler wraps and filters.

        A magnification filter NEAREST is taken as ``"nearest"``, a minification filter without
        mip levels as ``"bilinear"``.
        """
        sampler = {} if number is None else self._file.entry("samplers", number)
        wrap = tuple(
            WRAPS.get(whole_of(sampler, side, _REPEAT), "repeat") for side in ("wrapS", "wrapT")
        )
        if sampler.get("magFilter") == NEAREST:
            return {"wrap": wrap, "filter": "nearest"}
        unmipped = sampler.get("minFilter") in (NEAREST, LINEAR)
        return {"wrap": wrap, "filter": "bilinear" if unmipped else "trilinear"}


def _of_glossiness(values: dict[str, Any]) -> dict[str, Any]:
    """Return a specular-glossiness material as what is nearest to it: a dielectric as rough."""
    nearest = {
        "baseColorFactor": values.get("diffuseFactor", (1.0, 1.0, 1.0, 1.0)),
        "metallicFactor": 0.0,
        "roughnessFactor": 1.0 - number_of(values, "glossinessFactor", 1.0, 1.0),
    }
    if "diffuseTexture" in values:
        nearest["baseColorTexture"] = values["diffuseTexture"]
    return nearest


def _numbers(
    values: dict[str, Any], key: str, default: tuple[float, ...], most: float
) -> tuple[float, ...]:
    """Return as many numbers as the default has, held within 0..most."""
    given = values.get(key, default)
    if not isinstance(given, (list, tuple)) or len(given) != len(default):
        raise ValueError(f"{key} must be {len(default)} numbers, got {shown(given)}")
    return tuple(number_of({key: part}, key, 0.0, most) for part in given)


class MeshReader:
    """
    Read the meshes of a file, each once.

    Parameters
    ----------
    file : GltfFile
    materials : MaterialReader
    reading : Reading
    """

    def __init__(self, file: GltfFile, materials: MaterialReader, reading: Reading) -> None:
        self._file, self._materials = file, materials
        # The bytes of its buffers have been paid for where they were read.
        self._reading, self._left_out = reading._replace(budget=None), reading.left_out
        self._known: dict[Any, list[Mesh]] = {}
        self._plain: dict[tuple[Material, tuple[str, ...]], Material] = {}
        self._moved: dict[tuple[Material, tuple[int, ...]], Material] = {}
        self._variant_names = variant_names(file.header, self._left_out)

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of the variants that the file has, in its order."""
        return tuple(name for name in self._variant_names if name is not None)

    @property
    def is_empty(self) -> bool:
        """Whether no mesh of the file has faces, as far as they were asked for."""
        return not any(self._known.values())

    def read(self, number: Any) -> list[Mesh]:
        """Return the meshes that stand for one of the file; none if it cannot be read."""
        try:
            entry = self._file.entry("meshes", number)
        except LookupError:
            self._left_out.note(f"reference to mesh {shown(number)}, which the file has not")
            return []
        except ValueError as error:
            self._left_out.note(str(error))
            return []
        if number not in self._known:
            self._known[number] = []
            label = f"mesh {in_short(entry.get('name', number))}"
            try:
                needed(entry, "primitives")
                primitives = list_of(entry, "primitives")
            except ValueError as error:
                self._left_out.note(f"{label}, which cannot be read: {error}")
                return []
            found = (self._primitive(primitive, label) for primitive in primitives)
            meshes = [mesh for mesh in found if mesh is not None]
            self._known[number] = with_morph_weights(entry, meshes, label, self._left_out)
        return self._known[number]

    def _primitive(self, primitive: dict[str, Any], label: str) -> Mesh | None:
        """Return a primitive as a mesh, lines or points; None, with a note, if it is no use."""
        try:
            decoded = self._decoded(primitive)
            with self._file.standing_in(decoded):
                arrays = self._arrays(primitive, label, TRIANGLES if decoded else None)
        except (ValueError, TypeError, LookupError, AttributeError, OSError, MemoryError) as error:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            self._left_out.note(label, reason=f", which cannot be read: {reason}")
            return None
        if arrays is None:
            return None
        if isinstance(arrays, Cloud):
            return points_of(arrays, self._reading)
        if isinstance(arrays, LineDrawing):
            return lines_of(arrays, self._reading)
        variants = arrays.pop("variants")
        try:
            mesh = mesh_of(label, self._left_out, **arrays, on_invalid=self._reading.on_invalid)
            if mesh.normals is None:
                mesh = mesh.split_creases(self._reading.crease_angle)
            if variants:
                mesh.variants = variants
            return mesh
        except ValueError as error:
            raise MeshFileError(f"{self._reading.source}: {label}: {error}") from error

    def _arrays(
        self, primitive: dict[str, Any], label: str, mode: int | None
    ) -> dict[str, Any] | Cloud | LineDrawing | None:
        """Return what `Mesh` takes, lines or points; None, with a note, if it has none of them."""
        # Vertices and corners.
        if mode is None:
            mode = whole_of(primitive, "mode", TRIANGLES)
        attributes = object_of(primitive, "attributes")
        vertices = self._file.array(needed(attributes, "POSITION"))
        if "indices" in primitive:
            corners = self._file.array(primitive["indices"])[:, 0].astype(np.int64)
        else:
            corners = np.arange(len(vertices))
        # Faces; points and lines have none.
        if mode in (POINTS, LINES, LINE_LOOP, LINE_STRIP):
            return self._without_faces(primitive, attributes, vertices, corners, mode, label)
        face_count = len(corners) if mode != TRIANGLES else len(corners) // 3
        each = _FACE_BYTES if "NORMAL" in attributes else _SPLIT_FACE_BYTES
        self._file.budget.take(f"the faces of {label}", face_count * each)
        faces = join_corners(corners, mode)
        if not len(faces) or not len(vertices):
            self._left_out.note(f"{label}, which has no faces")
            return None
        # Materials, and the textures' coordinates that they name.
        count = len(vertices)
        material, uv_sets = self._material(primitive)
        variants, uv_sets = self._variants(primitive, uv_sets, label)
        colors = self._colors(attributes, count, label)
        if primitive.get("material") is None:
            material = UnsaidMaterial()
        # Attributes of the vertices.
        normals = self._rows(attributes, "NORMAL", count, (3,), label)
        uv = [self._coordinates(attributes, uv_set, count, label) for uv_set in uv_sets or [0]]
        tangents = None
        every = [one for one in (material, *variants.values()) if one is not None]
        if normals is not None and any(one.has_normal_map for one in every):
            tangents = self._rows(attributes, "TANGENT", count, (4,), label)
        # Textures without coordinates are left out.
        missing = [n for n, values in enumerate(uv) if values is None]
        if material is not None:
            material = self._without_textures(material, missing, label)
        variants = {
            name: self._without_textures(one, missing, f"{label}, variant {in_short(name)}")
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
            "attributes": self._own_attributes(attributes, count, label),
            "material": material,
            "variants": variants,
            **read_posable(
                self._file, primitive, count, (normals, tangents), label, self._left_out
            ),
        }

    def _variants(
        self, primitive: dict[str, Any], uv_sets: list[int], label: str
    ) -> tuple[dict[str, Material], list[int]]:
        """
        Return the materials of a primitive's variants by name, and all sets of coordinates.

        A mesh has two sets: the material's own come first.
        """
        numbers = mapped_materials(primitive, self._variant_names, label, self._left_out)
        found = {name: self._materials.read(number) for name, number in numbers.items()}
        every = dict.fromkeys(uv_sets)
        for _, own in found.values():
            every |= dict.fromkeys(own)
        sets = list(every)[: len(UV_SETS)]
        variants = {}
        for name, (material, own) in found.items():
            if material is not None:
                said = f"{label}, variant {in_short(name)}"
                variants[name] = self._with_sets(material, own, sets, said)
        return variants, sets

    def _with_sets(
        self, material: Material, own: list[int], sets: list[int], label: str
    ) -> Material:
        """Return a material whose textures count their coordinates as the mesh does."""
        if own == sets[: len(own)]:
            return material
        textures = {field: getattr(material, field) for field in TEXTURE_FIELDS}
        used = {field: one for field, one in textures.items() if one is not None}
        lost = [field for field, one in used.items() if own[one.uv_set] not in sets]
        for field in lost:
            self._left_out.note(f"{field} of {label}: third set of texture coordinates")
        key = material, tuple(sets)
        if key not in self._moved:
            moved = {
                field: None if field in lost else one.with_uv_set(sets.index(own[one.uv_set]))
                for field, one in used.items()
            }
            self._moved[key] = with_textures(material, moved)
        return self._moved[key]

    def _without_faces(
        self, primitive: dict[str, Any], attributes: dict[str, Any], vertices: NDArray[Any],
        corners: NDArray[np.int64], mode: int, label: str,
    ) -> Cloud | LineDrawing | None:  # fmt: skip
        """Return the points or lines of a primitive, or None, with a note."""
        count = len(vertices)
        if mapped_materials(primitive, self._variant_names, label, self._left_out):
            self._left_out.note(f"variants of {label}, which has no faces")
        if len(corners) and not 0 <= corners.min() <= corners.max() < count:
            raise ValueError(f"indices must be below {count}, got {int(corners.max())}")
        if len(corners) < (1 if mode == POINTS else 2):
            what = "points" if mode == POINTS else "lines"
            self._left_out.note(f"{label}, which has no {what}")
            return None
        what = "points" if mode == POINTS else "lines"
        if list_of(primitive, "targets"):
            self._left_out.note(f"morph target of {what}", len(primitive["targets"]))
        if any(name.startswith("JOINTS_") for name in attributes):
            self._left_out.note(f"joints of {what}")
        self._file.budget.take(f"the points of {label}", count * _SPLIT_FACE_BYTES)
        colors = self._colors(attributes, count, label)
        rgba = None if colors is None else linear_rows("COLOR_0", colors)
        own = self._own_attributes(attributes, count, label)
        normals = None
        if mode == POINTS:
            normals = self._rows(attributes, "NORMAL", count, (3,), label)
        material = self._material(primitive)[0]
        if material is not None:
            if any(texture is not None for texture in material.textures_read()):
                self._left_out.note(f"textures of {label}, which are those of faces")
            material = without_light(material) if normals is None else _untextured(material)
        if mode != POINTS:
            return LineDrawing(
                label, vertices, join_ends(corners, mode), rgba, False, own, {}, material
            )
        if "indices" in primitive:
            vertices = vertices[corners]
            rgba = None if rgba is None else rgba[corners]
            normals = None if normals is None else normals[corners]
            own = {name: values[corners] for name, values in own.items()}
        return Cloud(label, vertices, rgba, normals, own, material)

    def _decoded(self, primitive: Any) -> dict[int, NDArray[Any]]:
        """Return what stands for accessors of a compressed primitive, all as triangles; or none."""
        if not isinstance(primitive, dict):
            raise ValueError(f"a primitive must be an object, got {shown(primitive)}")
        extensions = object_of(primitive, "extensions")
        if DRACO not in extensions or self._is_plain(primitive):
            return {}
        mode = whole_of(primitive, "mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP):
            raise ValueError(f"{DRACO}: mode must be {TRIANGLES} or {STRIP}, got {mode}")
        packed, accessors = object_of(extensions, DRACO), object_of(primitive, "attributes")
        numbers = {name: whole_of(accessors, name) for name in object_of(packed, "attributes")}
        corners = needed(primitive, "indices")
        most = whole_of(self._file.entry("accessors", corners), "count")
        for number in (corners, *numbers.values()):
            count = whole_of(self._file.entry("accessors", number), "count")
            self._file.budget.take("a Draco stream", count * _DRACO_BYTES)
        stream = self._file.view_bytes(needed(packed, "bufferView"))
        mesh = decode_draco(stream, most, self._file.decoder)
        decoded: dict[int, NDArray[Any]] = {corners: mesh.corners[:, None]}
        for name, number in numbers.items():
            place = whole_of(packed["attributes"], name)
            if place not in mesh.attributes:
                raise ValueError(f"{DRACO}: its stream has no attribute {place}, {name}")
            decoded[number] = mesh.attributes[place]
        return decoded

    def _is_plain(self, primitive: dict[str, Any]) -> bool:
        """Tell whether the accessors of a compressed primitive hold it uncompressed as well."""
        numbers = [*primitive["attributes"].values()]
        numbers += [primitive["indices"]] if "indices" in primitive else []
        accessors = [self._file.entry("accessors", number) for number in numbers]
        return all("bufferView" in one or "sparse" in one for one in accessors)

    def _material(self, primitive: dict[str, Any]) -> tuple[Material | None, list[int]]:
        """Return the material of a primitive, if it names one, and its sets of coordinates."""
        if primitive.get("material") is None:
            return None, []
        return self._materials.read(primitive["material"])

    def _rows(
        self, attributes: dict[str, int], name: str, count: int, widths: tuple[int, ...], label: str
    ) -> NDArray[np.float64] | None:
        """Return a finite attribute of every vertex; None, with a note if it is no use."""
        if name not in attributes:
            return None
        with np.errstate(invalid="ignore"):
            # A signalling NaN.
            values = self._file.array(attributes[name]).astype(np.float64)
        if len(values) != count or values.shape[1] not in widths:
            self._left_out.note(f"{name} of {label}, which does not fit the vertices")
            return None
        if not np.isfinite(values).all():
            self._left_out.note(f"{name} of {label}, which has NaN or infinity")
            return None
        return values

    def _colors(
        self, attributes: dict[str, int], count: int, label: str
    ) -> NDArray[np.float64] | None:
        """Return the colours of the vertices, linear."""
        colors = self._rows(attributes, "COLOR_0", count, (3, 4), label)
        return None if colors is None else np.clip(colors, 0.0, 1.0)

    def _own_attributes(
        self, attributes: dict[str, int], count: int, label: str
    ) -> dict[str, NDArray[np.float32]]:
        """Return the attributes whose meaning is the author's, which begin with ``_``, without."""
        found = {}
        for name, number in attributes.items():
            if not name.startswith("_"):
                continue
            try:
                found[name[1:]] = self._file.array(number)
            except (ValueError, TypeError, LookupError, OSError) as error:
                self._left_out.note(f"{name} of {label}, which cannot be read: {reason_of(error)}")
        return usable_attributes(found, count, self._left_out)

    def _coordinates(
        self, attributes: dict[str, int], uv_set: int, count: int, label: str
    ) -> NDArray[np.float64] | None:
        """Return a set of texture coordinates, v upwards."""
        uv = self._rows(attributes, f"TEXCOORD_{uv_set}", count, (2,), label)
        return None if uv is None else np.column_stack([uv[:, 0], 1.0 - uv[:, 1]])

    def _without_textures(self, material: Material, missing: Sequence[int], label: str) -> Material:
        """Return a material for a mesh without some texture coordinates: without their textures."""
        textures = {field: getattr(material, field) for field in TEXTURE_FIELDS}
        given = {field: one.uv_set for field, one in textures.items() if one is not None}
        fields = tuple(field for field, uv_set in given.items() if uv_set in missing)
        if not fields:
            return material
        what = "textures" if len(fields) == len(given) else ", ".join(fields)
        self._left_out.note(f"{what} of {label}, which has no coordinates for them")
        if (material, fields) not in self._plain:
            self._plain[material, fields] = with_textures(material, dict.fromkeys(fields))
        return self._plain[material, fields]


def _untextured(material: Material) -> Material:
    """Return a material without textures."""
    return with_textures(material, dict.fromkeys(TEXTURE_FIELDS))


def without_light(material: Material) -> Material:
    """Return what points and lines without normals are drawn as: base colour and emission."""
    *rgb, alpha = material.base_color_over(False)
    shown = [min(1.0, part + add) for part, add in zip(rgb, material.emissive, strict=True)]
    if material.shading == "unlit":
        shown = rgb
    return Material(
        shading="unlit", base_color=(*shown, alpha), name=material.name,
        alpha_mode=material.alpha_mode, alpha_cutoff=material.alpha_cutoff,
        double_sided=material.double_sided,
    )  # fmt: skip


def join_ends(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """
    Return the segments, (S, 2), that a list of corners stands for.

    Parameters
    ----------
    corners : (N,) int
        Vertex numbers, two or more. The last one of an odd number of ``LINES`` has no part.
    mode : int
        ``LINES``, ``LINE_LOOP`` or ``LINE_STRIP``.
    """
    if mode == LINES:
        return corners[: len(corners) // 2 * 2].reshape(-1, 2)
    strip = np.column_stack([corners[:-1], corners[1:]])
    if mode == LINE_STRIP:
        return strip
    return np.concatenate([strip, [[corners[-1], corners[0]]]])


def join_corners(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """
    Return the triangles that a list of corners stands for, (F, 3).

    Parameters
    ----------
    corners : (N,) int
        Vertex numbers. Those of a last, incomplete triangle have no part.
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
        return np.column_stack(
            [
                corners[steps + 1],
                corners[steps + 2],
                np.full(len(steps), corners[0] if len(corners) else 0),
            ]
        )
    # Every second triangle of a strip is turned over.
    odd = steps % 2
    return np.column_stack([corners[steps], corners[steps + 1 + odd], corners[steps + 2 - odd]])
