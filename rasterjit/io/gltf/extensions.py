"""
Read and write glTF's material extensions and variants; list the other extensions by name.

A row of ``MATERIAL_EXTENSIONS`` says which fields of `Material` an extension holds, under which
names. ``docs/guides/gltf.md`` has the table of all extensions, and
``tests/io/test_gltf_extensions.py`` checks each of its rows.

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

from rasterjit.io.gltf.json_checks import (
    get_clamped,
    get_clamped_numbers,
    get_extension,
    get_integer,
    get_list,
    get_object,
    quote,
)
from rasterjit.io.load_warnings import LeftOut
from rasterjit.scene.material import MAX_IOR, MAX_THICKNESS, MAX_TINT, Material
from rasterjit.scene.texture import ColorSpace
from rasterjit.scene.validation import brief

MIN_ATTENUATION_DISTANCE = 1e-6
"""Attenuation distance, scene units, that replaces a file's 0."""

_EMPTY: Mapping[str, Any] = MappingProxyType({})


class MaterialExtension(NamedTuple):
    """The properties of a material extension; keys are fields of `Material`."""

    numbers: Mapping[str, tuple[str, float, float]] = _EMPTY
    """A number's name in the file, default and largest value."""
    colors: Mapping[str, tuple[str, float, float]] = _EMPTY
    """A colour's name in the file, default of all channels and largest value."""
    textures: Mapping[str, tuple[str, ColorSpace]] = _EMPTY
    """A texture's name in the file, and its colour space."""


MATERIAL_EXTENSIONS = {
    "KHR_materials_clearcoat": MaterialExtension(
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
    "KHR_materials_sheen": MaterialExtension(
        numbers={"sheen_roughness": ("sheenRoughnessFactor", 0.0, 1.0)},
        colors={"sheen_color": ("sheenColorFactor", 0.0, 1.0)},
        textures={
            "sheen_color_texture": ("sheenColorTexture", "srgb"),
            "sheen_roughness_texture": ("sheenRoughnessTexture", "linear"),
        },
    ),
    "KHR_materials_specular": MaterialExtension(
        numbers={"specular_factor": ("specularFactor", 1.0, 1.0)},
        colors={"specular_color": ("specularColorFactor", 1.0, MAX_TINT)},
        textures={
            "specular_factor_texture": ("specularTexture", "linear"),
            "specular_color_texture": ("specularColorTexture", "srgb"),
        },
    ),
    "KHR_materials_ior": MaterialExtension(numbers={"ior": ("ior", 1.5, MAX_IOR)}),
    "KHR_materials_transmission": MaterialExtension(
        numbers={"transmission": ("transmissionFactor", 0.0, 1.0)},
        textures={"transmission_texture": ("transmissionTexture", "linear")},
    ),
    "KHR_materials_volume": MaterialExtension(
        numbers={
            "thickness": ("thicknessFactor", 0.0, MAX_THICKNESS),
            "attenuation_distance": ("attenuationDistance", math.inf, math.inf),
        },
        colors={"attenuation_color": ("attenuationColor", 1.0, 1.0)},
        textures={"thickness_texture": ("thicknessTexture", "linear")},
    ),
}
"""The material extensions that are read and written."""

NORMAL_SCALES = {"clearcoat_normal_texture": "clearcoat_normal_scale"}
"""For the field of a normal texture, the field of the scale that its entry also holds."""

EXTENSION_TEXTURES = {
    field: name_and_space
    for properties in MATERIAL_EXTENSIONS.values()
    for field, name_and_space in properties.textures.items()
}
"""For each texture field of all material extensions: name in the file, and colour space."""


def read_extensions(extensions: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """
    Read the extensions of a material.

    Parameters
    ----------
    extensions : dict
        The object ``extensions`` of the material, JSON.

    Returns
    -------
    fields : dict
        Values of fields of `Material`: numbers and colours.
    infos : dict
        The object ``textureInfo`` of each texture, by its name in the file; None if it has none.

    Raises
    ------
    ValueError
        If a number or a colour is of another type.
    """
    fields: dict[str, Any] = {}
    infos: dict[str, Any] = {}
    for name, properties in MATERIAL_EXTENSIONS.items():
        if name not in extensions:
            continue
        extension = get_object(extensions, name)
        for field, (key, default, limit) in properties.numbers.items():
            fields[field] = get_clamped(extension, key, default, limit)
        for field, (key, default, limit) in properties.colors.items():
            fields[field] = get_clamped_numbers(extension, key, (default,) * 3, limit)
        for field, (key, _) in properties.textures.items():
            infos[key] = extension.get(key)
            if field in NORMAL_SCALES:
                scale = get_clamped(get_object(extension, key), "scale", 1.0, 1e3, -1e3)
                fields[NORMAL_SCALES[field]] = scale
    if "ior" in fields and 0.0 < fields["ior"] < 1.0:
        # Below that of a vacuum: draw no reflection.
        fields["ior"] = 1.0
    if fields.get("attenuation_distance") == 0.0:
        fields["attenuation_distance"] = MIN_ATTENUATION_DISTANCE
    return fields, infos


def write_extensions(
    material: Material, infos: dict[str, dict[str, Any]]
) -> dict[str, dict[str, Any]]:
    """
    Return the object ``extensions`` of a material: only what differs from the default.

    Parameters
    ----------
    material : Material
    infos : dict
        The object ``textureInfo`` of each texture, by field. Scales of normal maps are added.
    """
    default_material, extensions = Material(), {}
    for name, properties in MATERIAL_EXTENSIONS.items():
        extension: dict[str, Any] = {}
        for field, (key, _, _) in properties.numbers.items():
            if getattr(material, field) != getattr(default_material, field):
                extension[key] = getattr(material, field)
        for field, (key, default, _) in properties.colors.items():
            if getattr(material, field) != (default,) * 3:
                extension[key] = list(getattr(material, field))
        for field, (key, _) in properties.textures.items():
            if field in infos:
                extension[key] = infos[field]
                if field in NORMAL_SCALES:
                    extension[key]["scale"] = getattr(material, NORMAL_SCALES[field])
        if extension:
            extensions[name] = extension
    return extensions


VARIANTS = "KHR_materials_variants"
"""Extension that gives a primitive other materials, by the name of a variant of the file."""


def read_variant_names(document: dict[str, Any], left_out: LeftOut) -> list[str | None]:
    """
    Return the names of a file's variants, in its order.

    Parameters
    ----------
    document : dict
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
        entries = get_list(get_extension(document, VARIANTS), "variants")
    except ValueError as error:
        left_out.note(f"{VARIANTS}, which cannot be read: {error}")
        return names
    for index, entry in enumerate(entries):
        name = entry.get("name") if isinstance(entry, dict) else None
        if not isinstance(name, str) or not name:
            left_out.note(f"variant {index}, which has no name")
            name = None
        elif name in names:
            left_out.note(f"second variant of the name {brief(name)}")
            name = None
        names.append(name)
    return names


def read_variant_materials(
    primitive: dict[str, Any], names: Sequence[str | None], label: str, left_out: LeftOut
) -> dict[str, int]:
    """
    Return the indices of a primitive's materials by the names of variants.

    Parameters
    ----------
    primitive : dict
    names : sequence of str or None
        As `read_variant_names` returns them.
    label : str
        What messages call the mesh.
    left_out : LeftOut
        Notes variants that the file does not list or that have two materials, and damaged entries.
    """
    materials: dict[str, int] = {}
    try:
        mappings = get_list(get_extension(primitive, VARIANTS), "mappings")
    except ValueError as error:
        left_out.note(f"variants of {label}, which cannot be read: {error}")
        return materials
    for index, mapping in enumerate(mappings):
        try:
            entry = get_object({"a mapping": mapping}, "a mapping")
            material = get_integer(entry, "material")
            variants = get_list(entry, "variants")
        except ValueError as error:
            left_out.note(f"mapping {index} of variants of {label}: {error}")
            continue
        for variant in variants:
            if type(variant) is not int or not 0 <= variant < len(names):
                left_out.note(
                    f"variant {quote(variant)} of {label}, which the file has not "
                    f"(it has {len(names)})"
                )
                continue
            name = names[variant]
            if name in materials:
                left_out.note(f"second material of {label} for the variant {brief(name)}")
            elif name is not None:
                # `read_variant_names` noted those without a name.
                materials[name] = material
    return materials


def make_variant_mappings(
    materials: Mapping[str, int], names: Sequence[str]
) -> dict[str, list[dict[str, Any]]]:
    """
    Return the object `VARIANTS` of a primitive.

    Parameters
    ----------
    materials : mapping of str to int
        Indices of materials in the file, by the names of variants.
    names : sequence of str
        All variants of the file, in its order.
    """
    variants_by_material: dict[int, list[int]] = {}
    for name, material in materials.items():
        variants_by_material.setdefault(material, []).append(names.index(name))
    return {
        "mappings": [
            {"material": material, "variants": sorted(variants)}
            for material, variants in variants_by_material.items()
        ]
    }


DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
BASIS = "KHR_texture_basisu"
INSTANCING = "EXT_mesh_gpu_instancing"
VISIBILITY = "KHR_node_visibility"
LIGHTS = "KHR_lights_punctual"

IMAGE_EXTENSIONS = (BASIS, "EXT_texture_avif", "EXT_texture_webp", "MSFT_texture_dds")
"""Extensions that offer another image for a texture; the first that can be read is used."""

EXTENSION_FORMATS = {"EXT_texture_avif": ("AVIF",), "MSFT_texture_dds": ("DDS",)}
"""For an extension, the formats, as Pillow names them, that only its images may have."""

LIBRARIES = {DRACO: "DracoPy", **dict.fromkeys(MESHOPT, "meshopt"), BASIS: "opengl_basisu"}
"""The module that decodes an extension's data; ``rasterjit[gltf]`` installs it."""

_MIN_PYTHON = {"meshopt": (3, 11)}
"""Oldest Python version that a module supports, where RasterJIT supports older ones."""

SHOWN_EXTENSIONS = frozenset(
    (
        DRACO, *MESHOPT, *IMAGE_EXTENSIONS, INSTANCING, VISIBILITY, LIGHTS, VARIANTS,
        "KHR_materials_unlit", "KHR_materials_emissive_strength", "KHR_texture_transform",
        "KHR_mesh_quantization", "KHR_materials_pbrSpecularGlossiness", *MATERIAL_EXTENSIONS,
    )
)  # fmt: skip
"""Extensions that are read and change the picture."""

INVISIBLE_EXTENSIONS = frozenset(
    (
        "KHR_collision_shapes", "KHR_node_hoverability", "KHR_node_selectability",
        "KHR_physics_rigid_bodies", "KHR_xmp", "KHR_xmp_json_ld", "EXT_instance_features",
        "EXT_mesh_features", "EXT_mesh_manifold", "EXT_structural_metadata", "AGI_stk_metadata",
        "FB_geometry_metadata", "GODOT_single_root", "MSFT_lod",
    )
)  # fmt: skip
"""Extensions that do not change the picture; of levels of detail, the finest is drawn."""

SUPPORTED_EXTENSIONS = SHOWN_EXTENSIONS | INVISIBLE_EXTENSIONS
"""Extensions that a file may require."""


class MissingLibraryError(ValueError):
    """A library that an extension needs is not installed."""


def check_library(extension: str) -> None:
    """Raise `MissingLibraryError` if an extension needs a library that is not installed."""
    module = LIBRARIES.get(extension)
    if module is None or importlib.util.find_spec(module) is not None:
        return
    oldest = _MIN_PYTHON.get(module, (0, 0))
    on = f" on Python {'.'.join(map(str, oldest))} or newer" if sys.version_info < oldest else ""
    raise MissingLibraryError(f'{extension} needs {module}{on}; pip install "rasterjit[gltf]"')
