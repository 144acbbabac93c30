"""Apply a quality's overrides to materials, textures and lights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

from rasterjit.scene.light import AmbientLight, Light, Shadow
from rasterjit.scene.material import TEXTURE_FIELDS, Material, UnsaidMaterial
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.quality import Quality
from rasterjit.scene.texture import Texture

COARSER: dict[str, dict[str, str]] = {
    "pixel": {},
    "vertex": {"phong": "gouraud"},
    "face": {"phong": "flat", "gouraud": "flat"},
}
"""Replacements of finer shading models, by ``Quality.shading``."""

TAPS = {1: "hard", 9: "pcf"}
"""The filter of shadows with so many comparisons."""

AS_MESHES_SAY = ("pixel", None, False)
"""`look_of` what leaves all meshes as they are."""


class OverriddenMesh:
    """A proxy of a mesh with another material."""

    def __init__(self, mesh: Mesh, material: Material) -> None:
        self.mesh = mesh
        self.material = material

    def __getattr__(self, name: str) -> Any:
        """Return what the mesh has."""
        return getattr(self.mesh, name)


def look_of(quality: Quality, has_environment: bool) -> tuple[str, str | None, bool]:
    """Return all of a quality and of what is around that decides what meshes look like."""
    return quality.shading, quality.texture_filter, has_environment


def meshes_under(
    meshes: Sequence[Mesh], quality: Quality, has_environment: bool = False
) -> list[Mesh]:
    """
    Return the meshes as they look under a quality, each with the material in force.

    ``has_environment`` says whether the scene has one, which some materials depend on.

    A mesh whose material is not changed is returned itself; one that is there several times comes
    back several times.
    """
    if look_of(quality, has_environment) == AS_MESHES_SAY:
        return list(meshes)
    textures: dict[Texture, Texture] = {}
    found: dict[Mesh, Mesh] = {}
    for mesh in dict.fromkeys(meshes):
        material = mesh.material
        if has_environment and isinstance(material, UnsaidMaterial):
            material = material.in_environment()
        # A point has one normal: there is no coarser way.
        own = quality if mesh.primitive != "points" else replace(quality, shading="pixel")
        material = _material_under(material, own, textures)
        same = material is mesh.material
        found[mesh] = mesh if same else cast(Mesh, OverriddenMesh(mesh, material))
    return [found[mesh] for mesh in meshes]


def _material_under(
    material: Material, quality: Quality, known: dict[Texture, Texture]
) -> Material:
    """Return a material in force; ``known`` are the textures in force of those met before."""
    changes: dict[str, Any] = {}
    if material.shading in COARSER[quality.shading]:
        changes["shading"] = COARSER[quality.shading][material.shading]
    if quality.texture_filter is not None:
        for name in TEXTURE_FIELDS:
            texture = getattr(material, name)
            if texture is None:
                continue
            if texture not in known:
                known[texture] = texture.with_filter(*filter_of(quality.texture_filter))
            changes[name] = known[texture]
    return replace(material, **changes) if changes else material


def filter_of(setting: str) -> tuple[str, int]:
    """Return filter and anisotropy of a ``Quality.texture_filter``."""
    parts = setting.removeprefix("anisotropic")
    return (setting, 1) if parts == setting else ("trilinear", int(parts))


def lights_under(lights: Sequence[Light], quality: Quality) -> Sequence[Light]:
    """Return the lights as they are under a quality, each with the shadow in force."""
    if quality.shadow_size is None and quality.shadow_taps is None:
        return lights
    return [
        light
        if isinstance(light, AmbientLight) or light.shadow is None
        else replace(light, shadow=shadow_under(light.shadow, quality))
        for light in lights
    ]


def shadow_under(shadow: Shadow, quality: Quality) -> Shadow:
    """Return a shadow in force."""
    changes: dict[str, Any] = {}
    if quality.shadow_size is not None:
        changes["size"] = quality.shadow_size
    if quality.shadow_taps is not None:
        changes |= {"filter": TAPS[quality.shadow_taps], "light_size": None}
    return replace(shadow, **changes)
