"""
Read and write the extensions of glTF: layers of materials, variants, and what the others need.

A row of ``LAYERS`` for each extension of materials: which fields of `Material` it has, and what
they are called. ``docs/guides/gltf.md`` has the table of all extensions;
``tests/io/test_gltf_extensions.py`` goes through it.

References
----------
.. [1] The Khronos Group, "KHR_materials_clearcoat", "KHR_materials_sheen",
   "KHR_materials_specular", "KHR_materials_ior", "KHR_materials_transmission",
   "KHR_materials_volume", "KHR_materials_variants".
"""

from __future__ import annotations

import importlib.util
import math
import sys
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from rasterjit.io.gltf.json_checks import list_of, number_of, object_of, shown, whole_of
from rasterjit.io.load_warnings import LeftOut
from rasterjit.scene.material import BRIGHTEST_TINT, MAX_IOR, MAX_THICKNESS, Material
from rasterjit.scene.texture import ColorSpace
from rasterjit.scene.validation import in_short

MIN_DISTANCE = 1e-6
"""In place of 0, where a file says that light is tinted before it goes any way in a body."""

_NONE: Mapping[str, Any] = MappingProxyType({})


class Layer(NamedTuple):
    """The fields of one extension, by those of `Material`."""

    numbers: Mapping[str, tuple[str, float, float]] = _NONE
    """What a number is called, what it is where the file does not say, and its largest value."""
    colors: Mapping[str, tuple[str, float, float]] = _NONE
    """The same of three numbers, which are alike where the file does not say."""
    textures: Mapping[str, tuple[str, ColorSpace]] = _NONE
    """What a texture is called, and what its numbers are."""


LAYERS = {
    "KHR_materials_clearcoat": Layer(
        numbers={
            "clearcoat": ("clearcoatFactor", 0.0, 1.0),
            "clearcoat_roughness": ("clearcoatRoughnessFactor", 0.0, 1.0),
        },
        textures={
            "clearcoat_texture": ("clearcoatTexture", "linear"),
            "clearcoat_roughness_texture": ("clearcoatRoughnessTexture", "linear"),
            "clearcoat_normal_texture": ("clearcoatNormalTexture", "linear"),
        },
    ),
    "KHR_materials_sheen": Layer(
        numbers={"sheen_roughness": ("sheenRoughnessFactor", 0.0, 1.0)},
        colors={"sheen_color": ("sheenColorFactor", 0.0, 1.0)},
        textures={
            "sheen_color_texture": ("sheenColorTexture", "srgb"),
            "sheen_roughness_texture": ("sheenRoughnessTexture", "linear"),
        },
    ),
    "KHR_materials_specular": Layer(
        numbers={"specular_factor": ("specularFactor", 1.0, 1.0)},
        colors={"specular_color": ("specularColorFactor", 1.0, BRIGHTEST_TINT)},
        textures={
            "specular_factor_texture": ("specularTexture", "linear"),
            "specular_color_texture": ("specularColorTexture", "srgb"),
        },
    ),
    "KHR_materials_ior": Layer(numbers={"ior": ("ior", 1.5, MAX_IOR)}),
    "KHR_materials_transmission": Layer(
        numbers={"transmission": ("transmissionFactor", 0.0, 1.0)},
        textures={"transmission_texture": ("transmissionTexture", "linear")},
    ),
    "KHR_materials_volume": Layer(
        numbers={
            "thickness": ("thicknessFactor", 0.0, MAX_THICKNESS),
            "attenuation_distance": ("attenuationDistance", math.inf, math.inf),
        },
        colors={"attenuation_color": ("attenuationColor", 1.0, 1.0)},
        textures={"thickness_texture": ("thicknessTexture", "linear")},
    ),
}
"""The extensions that are read and written."""

NORMALS = {"clearcoat_normal_texture": "clearcoat_normal_scale"}
"""The factor on the normals of a texture: it stands beside the texture."""

LAYER_TEXTURES = {
    field: told for layer in LAYERS.values() for field, told in layer.textures.items()
}
"""The textures of all of them."""


def layers_of(extensions: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """
    Return the fields that a material's extensions tell, and what tells textures, by its name.

    Parameters
    ----------
    extensions : dict
        Of the material.

    Raises
    ------
    ValueError
        If what an extension tells is not a number where it has to be.
    """
    fields: dict[str, Any] = {}
    uses: dict[str, Any] = {}
    for name, layer in LAYERS.items():
        if name not in extensions:
            continue
        told = object_of(extensions, name)
        for field, (key, default, most) in layer.numbers.items():
            fields[field] = number_of(told, key, default, most)
        for field, (key, default, most) in layer.colors.items():
            fields[field] = _color(told, key, default, most)
        for field, (key, _) in layer.textures.items():
            uses[key] = told.get(key)
            if field in NORMALS:
                scale = number_of(object_of(told, key), "scale", 1.0, 1e3, -1e3)
                fields[NORMALS[field]] = scale
    if "ior" in fields and 0.0 < fields["ior"] < 1.0:
        # Less than the vacuum has: nothing is mirrored.
        fields["ior"] = 1.0
    if fields.get("attenuation_distance") == 0.0:
        fields["attenuation_distance"] = MIN_DISTANCE
    return fields, uses


def _color(told: dict[str, Any], key: str, default: float, most: float) -> tuple[float, ...]:
    """Return three numbers held within 0..most."""
    given = told.get(key, (default,) * 3)
    if not isinstance(given, (list, tuple)) or len(given) != 3:
        raise ValueError(f"{key} must be 3 numbers, got {shown(given)}")
    return tuple(number_of({key: part}, key, 0.0, most) for part in given)


def told_by(material: Material, uses: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """
    Return what the extensions of a material tell, by their names; only those that it needs.

    Parameters
    ----------
    material : Material
    uses : dict
        How its textures are used, by field.
    """
    plain, found = Material(), {}
    for name, layer in LAYERS.items():
        told: dict[str, Any] = {}
        for field, (key, _, _) in layer.numbers.items():
            if getattr(material, field) != getattr(plain, field):
                told[key] = getattr(material, field)
        for field, (key, default, _) in layer.colors.items():
            if getattr(material, field) != (default,) * 3:
                told[key] = list(getattr(material, field))
        for field, (key, _) in layer.textures.items():
            if field in uses:
                told[key] = uses[field]
                if field in NORMALS:
                    told[key]["scale"] = getattr(material, NORMALS[field])
        if told:
            found[name] = told
    return found


VARIANTS = "KHR_materials_variants"

_EXTENSIONS = "extensions"


def variant_names(header: dict[str, Any], left_out: LeftOut) -> list[str | None]:
    """
    Return the names of a file's variants, in its order.

    Parameters
    ----------
    header : dict
        The JSON of the file.
    left_out : LeftOut
        Notes variants without a name, or with that of an earlier one.

    Returns
    -------
    list of str or None
        ``None`` where a variant has no name of its own.
    """
    names: list[str | None] = []
    try:
        entries = list_of(object_of(object_of(header, _EXTENSIONS), VARIANTS), "variants")
    except ValueError as error:
        left_out.note(f"{VARIANTS}, which cannot be read: {error}")
        return names
    for number, entry in enumerate(entries):
        name = entry.get("name") if isinstance(entry, dict) else None
        if not isinstance(name, str) or not name:
            left_out.note(f"variant {number}, which has no name")
            name = None
        elif name in names:
            left_out.note(f"second variant of the name {in_short(name)}")
            name = None
        names.append(name)
    return names


def mapped_materials(
    primitive: dict[str, Any], names: Sequence[str | None], label: str, left_out: LeftOut
) -> dict[str, int]:
    """
    Return the numbers of a primitive's materials by the names of variants.

    Parameters
    ----------
    primitive : dict
    names : sequence of str or None
        As `variant_names` returns them.
    label : str
        What messages call the mesh.
    left_out : LeftOut
        Notes variants that the file has not, that have two materials, and what is damaged.
    """
    found: dict[str, int] = {}
    try:
        extension = object_of(object_of(primitive, _EXTENSIONS), VARIANTS)
        mappings = list_of(extension, "mappings")
    except ValueError as error:
        left_out.note(f"variants of {label}, which cannot be read: {error}")
        return found
    for number, mapping in enumerate(mappings):
        try:
            entry = object_of({"a mapping": mapping}, "a mapping")
            material = whole_of(entry, "material")
            variants = list_of(entry, "variants")
        except ValueError as error:
            left_out.note(f"mapping {number} of variants of {label}: {error}")
            continue
        for variant in variants:
            is_place = isinstance(variant, int) and not isinstance(variant, bool)
            if not is_place or not 0 <= variant < len(names):
                left_out.note(
                    f"variant {shown(variant)} of {label}, which the file has not "
                    f"(it has {len(names)})"
                )
                continue
            name = names[variant]
            if name is None:
                # Its name was noted, where the list was read.
                continue
            if name in found:
                left_out.note(f"second material of {label} for the variant {in_short(name)}")
                continue
            found[name] = material
    return found


def written_mappings(
    materials: Mapping[str, int], names: Sequence[str]
) -> dict[str, list[dict[str, Any]]]:
    """
    Return what a primitive says of its variants.

    Parameters
    ----------
    materials : mapping of str to int
        The numbers of the materials in the file, by the names of variants.
    names : sequence of str
        Those of the file, in its order.
    """
    variants: dict[int, list[int]] = {}
    for name, material in materials.items():
        variants.setdefault(material, []).append(names.index(name))
    return {
        "mappings": [
            {"material": material, "variants": sorted(numbers)}
            for material, numbers in variants.items()
        ]
    }


DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
BASIS = "KHR_texture_basisu"
INSTANCING = "EXT_mesh_gpu_instancing"
VISIBILITY = "KHR_node_visibility"
LIGHTS = "KHR_lights_punctual"

PICTURES = (BASIS, "EXT_texture_avif", "EXT_texture_webp", "MSFT_texture_dds")
"""Extensions that name another picture of a texture; the first one that can be read is taken."""

FURTHER_FORMATS = {"EXT_texture_avif": ("AVIF",), "MSFT_texture_dds": ("DDS",)}
"""Pillow's names of the formats that only an extension allows."""

LIBRARIES = {DRACO: "DracoPy", **dict.fromkeys(MESHOPT, "meshopt"), BASIS: "opengl_basisu"}
"""Modules that decode what an extension compresses; the extra ``gltf`` installs them."""

_OLDEST = {"meshopt": (3, 11)}
"""Versions of Python that a library needs, where they are newer than ours."""

DRAWN = frozenset(
    (
        DRACO, *MESHOPT, *PICTURES, INSTANCING, VISIBILITY, LIGHTS,
        "KHR_materials_unlit", "KHR_materials_emissive_strength", "KHR_texture_transform",
        "KHR_mesh_quantization", "KHR_materials_pbrSpecularGlossiness", VARIANTS, *LAYERS,
    )
)  # fmt: skip

NOTHING_TO_SHOW = frozenset(
    (
        "KHR_collision_shapes", "KHR_node_hoverability", "KHR_node_selectability",
        "KHR_physics_rigid_bodies", "KHR_xmp", "KHR_xmp_json_ld", "EXT_instance_features",
        "EXT_mesh_features", "EXT_mesh_manifold", "EXT_structural_metadata", "AGI_stk_metadata",
        "FB_geometry_metadata", "GODOT_single_root", "MSFT_lod",
    )
)  # fmt: skip
"""Extensions without which a picture is the same: a finest level of detail is shown as it is."""

UNDERSTOOD = DRAWN | NOTHING_TO_SHOW
"""Extensions that a file may require."""


class MissingLibraryError(ValueError):
    """A library that an extension needs is not installed."""


def check_library(extension: str) -> None:
    """Raise `MissingLibraryError` if an extension needs a library that is not installed."""
    name = LIBRARIES.get(extension)
    if name is None or importlib.util.find_spec(name) is not None:
        return
    oldest = _OLDEST.get(name, (0, 0))
    on = f" on Python {'.'.join(map(str, oldest))} or newer" if sys.version_info < oldest else ""
    raise MissingLibraryError(f'{extension} needs {name}{on}; pip install "rasterjit[gltf]"')
