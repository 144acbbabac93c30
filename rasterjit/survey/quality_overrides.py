"""Apply a quality's overrides to materials, textures and lights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

from rasterjit.scene.light import AmbientLight, Light, Shadow
from rasterjit.scene.material import TEXTURE_FIELDS, DefaultMaterial, Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.quality import Quality
from rasterjit.scene.texture import Texture

COARSER_SHADING: dict[str, dict[str, str]] = {
    "pixel": {},
    "vertex": {"phong": "gouraud"},
    "face": {"phong": "flat", "gouraud": "flat"},
}
"""Replacements of finer shading models, by ``Quality.shading``."""

SHADOW_FILTERS = {1: "hard", 9: "pcf"}
"""Shadow filters by their number of comparisons."""

NO_OVERRIDES = ("pixel", None, False)
"""`override_key` of qualities that leave all meshes as they are."""


class OverriddenMesh:
    """A proxy of a mesh with another material."""

    def __init__(self, mesh: Mesh, material: Material) -> None:
        self.mesh = mesh
        self.material = material

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the mesh."""
        return getattr(self.mesh, name)


def override_key(quality: Quality, has_environment: bool) -> tuple[str, str | None, bool]:
    """Return the settings of a quality that change meshes, as a key of caches."""
    return quality.shading, quality.texture_filter, has_environment


def override_meshes(
    meshes: Sequence[Mesh], quality: Quality, has_environment: bool = False
) -> list[Mesh]:
    """
    Return the meshes with the materials overridden by a quality and by the scene's environment.

    Meshes whose material is not changed are returned themselves.
    """
    if override_key(quality, has_environment) == NO_OVERRIDES:
        return list(meshes)
    textures: dict[Texture, Texture] = {}
    overridden: dict[Mesh, Mesh] = {}
    for mesh in dict.fromkeys(meshes):
        material = mesh.material
        if has_environment and isinstance(material, DefaultMaterial):
            material = material.in_environment()
        # A point has one normal: there is no coarser shading.
        mesh_quality = quality if mesh.primitive != "points" else replace(quality, shading="pixel")
        material = _override_material(material, mesh_quality, textures)
        is_same = material is mesh.material
        overridden[mesh] = mesh if is_same else cast(Mesh, OverriddenMesh(mesh, material))
    return [overridden[mesh] for mesh in meshes]


def _override_material(
    material: Material, quality: Quality, textures: dict[Texture, Texture]
) -> Material:
    """Return a material as overridden; ``textures`` caches overridden textures by the original."""
    changes: dict[str, Any] = {}
    if material.shading in COARSER_SHADING[quality.shading]:
        changes["shading"] = COARSER_SHADING[quality.shading][material.shading]
    if quality.texture_filter is not None:
        for name in TEXTURE_FIELDS:
            texture = getattr(material, name)
            if texture is None:
                continue
            if texture not in textures:
                textures[texture] = texture.with_filter(*parse_filter(quality.texture_filter))
            changes[name] = textures[texture]
    return replace(material, **changes) if changes else material


def parse_filter(setting: str) -> tuple[str, int]:
    """Return filter and anisotropy of a ``Quality.texture_filter``."""
    anisotropy = setting.removeprefix("anisotropic")
    return (setting, 1) if anisotropy == setting else ("trilinear", int(anisotropy))


def override_lights(lights: Sequence[Light], quality: Quality) -> Sequence[Light]:
    """Return the lights with their shadows overridden by a quality."""
    if quality.shadow_size is None and quality.shadow_taps is None:
        return lights
    return [
        light
        if isinstance(light, AmbientLight) or light.shadow is None
        else replace(light, shadow=override_shadow(light.shadow, quality))
        for light in lights
    ]


def override_shadow(shadow: Shadow, quality: Quality) -> Shadow:
    """Return a shadow as a quality overrides it."""
    changes: dict[str, Any] = {}
    if quality.shadow_size is not None:
        changes["size"] = quality.shadow_size
    if quality.shadow_taps is not None:
        changes |= {"filter": SHADOW_FILTERS[quality.shadow_taps], "light_size": None}
    return replace(shadow, **changes)
