"""
Read and write what glTF's extensions lay over metallic-roughness materials.

A row of ``LAYERS`` for each extension: which fields of `Material` it has, and what they are called.

References
----------
.. [1] The Khronos Group, "KHR_materials_clearcoat", "KHR_materials_sheen",
   "KHR_materials_specular", "KHR_materials_ior", "KHR_materials_transmission",
   "KHR_materials_volume".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from rasterjit.io.gltf.values import number_of, object_of, shown
from rasterjit.scene.material import (
    BRIGHTEST_TINT,
    LARGEST_IOR,
    LARGEST_THICKNESS,
    Material,
)
from rasterjit.scene.texture import ColorSpace

LEAST_DISTANCE = 1e-6
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
    "KHR_materials_ior": Layer(numbers={"ior": ("ior", 1.5, LARGEST_IOR)}),
    "KHR_materials_transmission": Layer(
        numbers={"transmission": ("transmissionFactor", 0.0, 1.0)},
        textures={"transmission_texture": ("transmissionTexture", "linear")},
    ),
    "KHR_materials_volume": Layer(
        numbers={
            "thickness": ("thicknessFactor", 0.0, LARGEST_THICKNESS),
            "attenuation_distance": ("attenuationDistance", math.inf, math.inf),
        },
        colors={"attenuation_color": ("attenuationColor", 1.0, 1.0)},
        textures={"thickness_texture": ("thicknessTexture", "linear")},
    ),
}
"""The extensions that are read and written."""

NORMALS = {"clearcoat_normal_texture": "clearcoat_normal_scale"}
"""The factor on the normals of a texture: it stands beside the texture."""

TEXTURES = {field: told for layer in LAYERS.values() for field, told in layer.textures.items()}
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
        fields["attenuation_distance"] = LEAST_DISTANCE
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
