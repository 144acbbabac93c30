"""
Turn the materials of glTF files into ours, with their five textures.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), sections 3.8 and 3.9.
.. [2] The Khronos Group, "KHR_texture_transform", "KHR_materials_unlit",
   "KHR_materials_emissive_strength", "EXT_texture_webp", "KHR_materials_pbrSpecularGlossiness".
"""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

from rasterjit.io.gltf_file import GltfFile
from rasterjit.io.left_out import LeftOut, reason_of
from rasterjit.io.pictures import picture_pixels
from rasterjit.scene.material import BRIGHTEST_EMISSION, Material
from rasterjit.scene.texture import Texture, turned_over
from rasterjit.validation import in_short

_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_NEAREST, _LINEAR = 9728, 9729
"""Numbers of OpenGL, which glTF samplers use."""

_UNLIT = "KHR_materials_unlit"
_STRENGTH = "KHR_materials_emissive_strength"
_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"

_OTHER_SOURCES = ("EXT_texture_webp",)
"""Extensions that name another picture of a texture, of a kind that Pillow reads."""

MODES = {"OPAQUE": "opaque", "MASK": "mask", "BLEND": "blend"}

TEXTURES = {
    "base_color_texture": ("baseColorTexture", "srgb"),
    "normal_texture": ("normalTexture", "linear"),
    "metallic_roughness_texture": ("metallicRoughnessTexture", "linear"),
    "occlusion_texture": ("occlusionTexture", "linear"),
    "emissive_texture": ("emissiveTexture", "srgb"),
}
"""What a field of `Material` is called in glTF, and what the numbers of its picture are."""


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
        self._known: dict[Any, tuple[Material, int]] = {}
        self._textures: dict[tuple, Texture | None] = {}

    def read(self, number: Any) -> tuple[Material | None, int]:
        """
        Return a material, or None if it cannot be read, and its set of texture coordinates.

        A mesh has one set: what the first texture of the material uses. Textures that use another
        are left out.
        """
        if number not in self._known:
            try:
                entry = self._file.entry("materials", number)
            except LookupError:
                self._left_out.note(f"reference to material {number!r}, which the file has not")
                return None, 0
            label = f"material {entry.get('name', number)!r}"
            try:
                self._known[number] = self._material(entry, label)
            except (TypeError, ValueError, AttributeError) as error:
                self._left_out.note(f"{label}, which is damaged: {reason_of(error)}")
                return None, 0
        return self._known[number]

    def _material(self, entry: dict[str, Any], label: str) -> tuple[Material, int]:
        """Return an entry as a material, and its set of texture coordinates."""
        extensions = entry.get("extensions", {})
        values = {**entry, **entry.get("pbrMetallicRoughness", {})}
        if _GLOSSINESS in extensions:
            values.update(_of_glossiness(extensions[_GLOSSINESS]))
            self._left_out.note(f"specular colour of {label}")
        *color, alpha = _numbers(values, "baseColorFactor", (1.0, 1.0, 1.0, 1.0), 1.0)
        mode = MODES.get(entry.get("alphaMode", "OPAQUE"), "opaque")
        options: dict[str, Any] = {
            "base_color": (*color, 1.0 if mode == "opaque" else alpha),
            "name": entry.get("name"),
            "alpha_mode": mode,
            "alpha_cutoff": _number(entry, "alphaCutoff", 0.5, 1e6),
            "double_sided": bool(entry.get("doubleSided", False)),
        }
        textures, uv_set = self._read_textures(values, _UNLIT in extensions, label)
        if _UNLIT in extensions:
            return Material(shading="unlit", **options, **textures), uv_set
        strength = _number(
            extensions.get(_STRENGTH, {}), "emissiveStrength", 1.0, BRIGHTEST_EMISSION
        )
        emitted = _numbers(values, "emissiveFactor", (0.0, 0.0, 0.0), 1.0)
        material = Material(
            shading="pbr",
            metallic=_number(values, "metallicFactor", 1.0, 1.0),
            roughness=_number(values, "roughnessFactor", 1.0, 1.0),
            normal_scale=_number(_object(values, "normalTexture"), "scale", 1.0, 1e3, -1e3),
            occlusion_strength=_number(_object(values, "occlusionTexture"), "strength", 1.0, 1.0),
            emissive=tuple(strength * part for part in emitted),
            **options,
            **textures,
        )
        return material, uv_set

    def _read_textures(
        self, values: dict[str, Any], is_unlit: bool, label: str
    ) -> tuple[dict[str, Texture], int]:
        """Return the textures of a material by field, and their set of texture coordinates."""
        found: dict[str, Texture] = {}
        uv_set: int | None = None
        for field, (key, color_space) in TEXTURES.items():
            use = values.get(key)
            if use is None or (is_unlit and field != "base_color_texture"):
                continue
            try:
                transform = use.get("extensions", {}).get("KHR_texture_transform", {})
                number = transform.get("texCoord", use.get("texCoord", 0))
                texture = self._texture(use, transform, color_space)
            except Exception as error:
                # Pictures of files are decoded by Pillow, which raises what it likes.
                reason = reason_of(error)
                self._left_out.note(f"{field} of {label} that cannot be read: {reason}")
                continue
            if uv_set not in (None, number):
                self._left_out.note(f"{field} of {label}: second set of texture coordinates")
                continue
            uv_set = number
            found[field] = texture
        return found, 0 if uv_set is None else uv_set

    def _texture(self, use: dict[str, Any], transform: dict[str, Any], color_space: str) -> Texture:
        """Return one use of a texture; uses of one picture share its texels."""
        entry = self._file.entry("textures", use["index"])
        sources = [
            entry.get("extensions", {}).get(name, {}).get("source") for name in _OTHER_SOURCES
        ]
        picture = next((n for n in sources if n is not None), entry.get("source"))
        if picture is None:
            kinds = ", ".join(entry.get("extensions", {})) or "no source"
            raise ValueError(f"its picture is given by {kinds}")
        options = self._sampler(entry.get("sampler"))
        key = (picture, color_space, *options.values())
        if key not in self._textures:
            pixels = self._pixels(picture)
            self._textures[key] = Texture(pixels, color_space=color_space, **options)
        texture = self._textures[key]
        if not transform:
            return texture
        offset = _pair(transform.get("offset", (0.0, 0.0)))
        degrees = math.degrees(float(transform.get("rotation", 0.0)))
        return texture.with_transform(
            *turned_over(offset, degrees, _pair(transform.get("scale", (1.0, 1.0))))
        )

    def _pixels(self, picture: Any) -> NDArray[Any]:
        """Return the texels of a picture, or raise ``ValueError`` naming it."""
        name = self._file.picture_name(picture)
        try:
            return picture_pixels(self._file.picture(picture))
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
        wrap = tuple(_WRAPS.get(sampler.get(side), "repeat") for side in ("wrapS", "wrapT"))
        if sampler.get("magFilter") == _NEAREST:
            return {"wrap": wrap, "filter": "nearest"}
        unmipped = sampler.get("minFilter") in (_NEAREST, _LINEAR)
        return {"wrap": wrap, "filter": "bilinear" if unmipped else "trilinear"}


def _of_glossiness(values: dict[str, Any]) -> dict[str, Any]:
    """Return a specular-glossiness material as what is nearest to it: a dielectric as rough."""
    nearest = {
        "baseColorFactor": values.get("diffuseFactor", (1.0, 1.0, 1.0, 1.0)),
        "metallicFactor": 0.0,
        "roughnessFactor": 1.0 - _number(values, "glossinessFactor", 1.0, 1.0),
    }
    if "diffuseTexture" in values:
        nearest["baseColorTexture"] = values["diffuseTexture"]
    return nearest


def _number(values: dict[str, Any], key: str, default: float, most: float, least=0.0) -> float:
    """Return a number held within its range; what is not one raises ``ValueError``."""
    value = values.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value):
        raise ValueError(f"{key} must be a number, got {in_short(value)}")
    return float(min(max(value, least), most))


def _object(values: dict[str, Any], key: str) -> dict[str, Any]:
    """Return an object of JSON, empty if there is none, or raise ``ValueError``."""
    value = values.get(key, {})
    if not isinstance(value, dict):
        raise ValueError(f"{key} must be an object, got {in_short(value)}")
    return value


def _numbers(
    values: dict[str, Any], key: str, default: tuple[float, ...], most: float
) -> tuple[float, ...]:
    """Return as many numbers as the default has, held within 0..most."""
    given = values.get(key, default)
    if not isinstance(given, (list, tuple)) or len(given) != len(default):
        got = f"{len(given)}" if isinstance(given, (list, tuple)) else in_short(given)
        raise ValueError(f"{key} must be {len(default)} numbers, got {got}")
    return tuple(_number({key: part}, key, 0.0, most) for part in given)


def _pair(values: Any) -> tuple[float, float]:
    """Return two numbers."""
    u, v = values
    return float(u), float(v)
