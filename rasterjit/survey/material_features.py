"""Define the rows of ``explain`` about materials, lights and diagnostics, which add no passes."""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from rasterjit.scene.material import IOR, TEXTURE_FIELDS, Material
from rasterjit.scene.mesh import Mesh
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.texture import Texture
from rasterjit.survey.effect import Effect, Planning, UnusedEffect, UsedEffect
from rasterjit.survey.facts import (
    NORMAL_OUTPUTS,
    Facts,
    describe_changed_settings,
    explain_float64,
    explain_other_float64,
    explain_unlit,
)
from rasterjit.survey.object_counts import SMOOTH, ObjectCounts, describe_count


class MaterialRow(Effect):
    """A row whose decision depends on facts alone."""

    needs_facts_only = True

    def decide(self, facts: Facts, planning: Planning) -> UsedEffect | UnusedEffect:
        """Decide whether a frame has the feature."""
        return UsedEffect(self, facts) if self.is_in(facts) else UnusedEffect(self, facts)

    def is_in(self, facts: Facts) -> bool:
        """Tell whether a frame has the feature."""
        raise NotImplementedError


class ShadingRow(MaterialRow):
    """The colours of faces."""

    name = "shading"
    is_explained = True
    settings = (
        "samples", "interpolation", "shading", "renormalize", "interpolation_precision",
    )  # fmt: skip

    def is_in(self, facts: Facts) -> bool:
        """Tell whether the colour of a face in view is an output."""
        return facts.shades

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Say why faces are shaded or not."""
        if not facts.is_colored:
            return "no output shows colour"
        if not facts.draws_faces:
            return "only the wireframe is drawn"
        shadings = ", ".join(sorted(facts.visible.shadings))
        if not shadings:
            return "no object is in view"
        why = explain_float64(facts)
        colors = "colours in float32" if why is None else f"colours in float64: {why}"
        others = explain_other_float64(facts)
        if others is not None:
            colors += f", others in float64: {others}"
        if facts.reference is not None:
            colors += f"; as pyrender's shader does, in codes of {facts.encoding!r}"
        return f"{shadings}{describe_changed_settings(facts, 'shading')}; {colors}"


class LightsRow(MaterialRow):
    """The lights that reach what is seen."""

    name = "lights"
    is_explained = True

    def is_in(self, facts: Facts) -> bool:
        """Tell whether any light reaches visible objects, other than the environment."""
        return facts.is_lit and (facts.has_headlight or bool(facts.lights.lights))

    def reason(self, facts: Facts, is_used: bool) -> str:
        """List the lights, or say why none is needed."""
        if not facts.is_lit:
            return explain_unlit(facts)
        if facts.has_headlight:
            return "a headlight, for the scene has no lights"
        if not facts.has_lights:
            return "no headlight, for the scene has an environment"
        kinds = describe_counts([type(light).__name__ for light in facts.lights.lights])
        return "; ".join(filter(None, (kinds, *facts.lights.notes)))


class SmoothNormalsRow(MaterialRow):
    """Normals between those of vertices."""

    name = "smooth normals"
    is_explained = True

    def is_in(self, facts: Facts) -> bool:
        """Tell whether vertex normals are read."""
        return facts.needs_normals

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Say which shading models and outputs read vertex normals, or why none does."""
        smooth = sorted(SMOOTH & facts.visible.shadings)
        if facts.shows_normals:
            is_shaded = facts.shades_smoothly
            shading = (
                f"shading {', '.join(smooth)}{_describe_scaling(facts)}; " if is_shaded else ""
            )
            shown = " and ".join(name for name in NORMAL_OUTPUTS if name in facts.outputs)
            return f"{shading}output {shown}, of every object"
        if smooth:
            return "shading " + ", ".join(smooth) + _describe_scaling(facts)
        hidden = not SMOOTH.isdisjoint(facts.counts.shadings)
        return "no object in view is smooth" if hidden else "no object is smooth"


def _describe_scaling(facts: Facts) -> str:
    """Describe the scaling of interpolated normals, if the quality turns it off."""
    if facts.quality.renormalize or {"phong", "pbr"}.isdisjoint(facts.visible.shadings):
        return ""
    if facts.visible.textured["normal_texture"]:
        return "; quality.renormalize is False, but not under normal maps"
    if facts.has_uneven_scale:
        return "; quality.renormalize is False, but not where an object is scaled unevenly"
    return "; quality.renormalize is False"


class TextureRow(MaterialRow):
    """Textures of all kinds."""

    name = "textures"
    key = "x"
    is_explained = True
    settings = ("texture_filter",)

    def is_in(self, facts: Facts) -> bool:
        """Tell whether textures are read."""
        return facts.needs_textures

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Describe the textures, or say why none is read."""
        if not facts.counts.has_textures:
            return "no material has a texture that is read"
        if not facts.colors_faces:
            return "nothing is shaded"
        if not facts.visible.has_textures:
            return "no object in view has a texture that is read"
        described = describe_counts(facts.inventory.describe_textures(facts.in_view))
        if facts.reads_srgb8_textures:
            described += f"; of {facts.visible.coded} unlit mixed in 8-bit codes, by float32 places"
        return described + describe_changed_settings(facts, *self.settings)

    def without(self, scene: Scene) -> Scene:
        """Return the scene with no texture."""
        return with_fields(scene, dict.fromkeys(TEXTURE_FIELDS))

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Return the scene with trilinear textures; None if the quality overrides filters."""
        known: dict[Texture, Texture] = {}

        def filtered(texture: Texture | None) -> Texture | None:
            if texture is None or texture.filter == "trilinear":
                return texture
            if texture not in known:
                known[texture] = texture.with_filter("trilinear")
            return known[texture]

        def changes(material: Material) -> dict[str, Any]:
            return {name: filtered(getattr(material, name)) for name in TEXTURE_FIELDS}

        changed = with_materials(scene, lambda material: replace(material, **changes(material)))
        is_open = known and quality.texture_filter is None
        return f"mip levels for {len(known)} of them", changed if is_open else None


class AlphaMaskRow(MaterialRow):
    """Holes where alpha is below a cutoff."""

    name = "alpha masks"

    def is_in(self, facts: Facts) -> bool:
        """Tell whether holes of visible faces or shadow casters are tested."""
        return facts.needs_alpha_tests or facts.alpha_tests_shadow_maps

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Say which objects have holes, or why none has."""
        contents, seen = facts.counts, facts.visible
        if contents.masked == 0:
            return "no material has the alpha_mode 'mask'"
        if contents.cut_out == 0:
            return "no alpha of an object with a mask is below its alpha_cutoff"
        if not facts.finds_faces:
            return "only the wireframe is drawn"
        if seen.cut_out > 0:
            return f"{seen.cut_out} of {seen.masked} objects with a mask can have holes"
        outside = describe_count(0, contents.cut_out)
        return f"{outside}, in shadows alone" if facts.alpha_tests_shadow_maps else outside

    def without(self, scene: Scene) -> Scene:
        """Return the scene with opaque materials."""
        return with_opaque_materials(scene)


class CountedRow(MaterialRow):
    """A row about a feature of objects, in if any in view has it."""

    none = ""
    """The reason if no object has the feature."""
    count_field = ""
    """Field of `ObjectCounts` that counts the objects with the feature."""

    def count(self, contents: ObjectCounts) -> int:
        """Return how many objects have the feature."""
        return getattr(contents, self.count_field)

    def is_needed(self, facts: Facts) -> bool:
        """Tell whether the frame shows the feature, if an object in view has it."""
        return facts.shades

    def is_in(self, facts: Facts) -> bool:
        """Tell whether a frame shows the feature."""
        return bool(self.count(facts.visible)) and self.is_needed(facts)

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Say how many objects have the feature, and how many of them are in view."""
        seen, count = self.count(facts.visible), self.count(facts.counts)
        if not count:
            return self.none
        return describe_count(seen, count) if is_used or not seen else "nothing is shaded"


class ScalarFieldRow(CountedRow):
    """Scalars of vertices, shown by colour maps."""

    name = "scalar fields"
    none = "no mesh has scalars of its vertices"
    count_field = "with_field"

    def without(self, scene: Scene) -> Scene:
        """Return the scene with meshes without scalars of vertices."""
        return with_meshes(
            scene, lambda mesh: mesh if mesh.vertex_field is None else mesh.without_colors()
        )


class MicrofacetRow(CountedRow):
    """Metallic-roughness materials."""

    name = "microfacets"
    none = "no material is shaded pbr"
    count_field = "pbr"

    def is_needed(self, facts: Facts) -> bool:
        """Tell whether light falls on anything."""
        return facts.is_lit


class TextureMapRow(CountedRow):
    """
    Textures of one kind, such as normal maps.

    Parameters
    ----------
    name : str
        Of the row.
    texture : str
        One of ``TEXTURE_FIELDS``.
    """

    def __init__(self, name: str, texture: str) -> None:
        self.name, self._texture = name, texture
        self.none = f"no lit material has {'an' if texture[0] in 'aeiou' else 'a'} {texture}"

    def count(self, contents: ObjectCounts) -> int:
        """Return how many objects have such a texture that is read."""
        return contents.textured[self._texture]

    def without(self, scene: Scene) -> Scene:
        """Return the scene without these textures."""
        return with_fields(scene, {self._texture: None})


class EmissionRow(CountedRow):
    """Light that surfaces emit."""

    name = "emission"
    none = "no material is emissive"
    count_field = "emitting"

    def without(self, scene: Scene) -> Scene:
        """Return the scene with materials that emit none."""
        return with_fields(scene, {"emissive": (0.0, 0.0, 0.0), "emissive_texture": None})


class LayerRow(CountedRow):
    """
    A layer of metallic-roughness materials from a glTF extension.

    Parameters
    ----------
    name : str
        Of the row.
    none : str
        The reason if no material has the layer.
    count_field : str
        The field of `ObjectCounts` that counts objects with the layer.
    neutral_fields : dict
        Fields of a material without the layer.
    """

    def __init__(
        self, name: str, none: str, count_field: str, neutral_fields: dict[str, Any]
    ) -> None:
        self.name, self.none = name, none
        self.count_field, self._neutral_fields = count_field, neutral_fields

    def is_needed(self, facts: Facts) -> bool:
        """Tell whether light falls on anything."""
        return facts.is_lit

    def without(self, scene: Scene) -> Scene:
        """Return the scene with materials without the layer."""
        return with_fields(scene, self._neutral_fields)


LAYER_ROWS = (
    LayerRow("clearcoat", "no pbr material has a clearcoat", "coated", {"clearcoat": 0.0}),
    LayerRow(
        "sheen", "no pbr material has a sheen_color", "with_sheen",
        {"sheen_color": None, "sheen_color_texture": None},
    ),
    LayerRow(
        "specular and ior", "no pbr material has an ior or specular_ field of its own",
        "custom_specular",
        {
            "ior": IOR, "specular_factor": 1.0, "specular_factor_texture": None,
            "specular_color": None, "specular_color_texture": None,
        },
    ),
)  # fmt: skip
"""Rows of the layers of metallic-roughness materials."""


class SingleSidedRow(CountedRow):
    """Objects whose back faces are not drawn."""

    name = "single-sided objects"
    none = "every material is double_sided"
    count_field = "single_sided"

    def is_needed(self, facts: Facts) -> bool:
        """Return True: every frame culls back faces."""
        return True


class DiagnosticsRow(MaterialRow):
    """Diagnostics of all faces."""

    name = "diagnostics"
    is_explained = True

    def is_in(self, facts: Facts) -> bool:
        """Tell whether diagnostics are requested."""
        return facts.diagnose

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Return the argument that requests diagnostics."""
        return f"diagnose={facts.diagnose}"


def describe_counts(kinds: Sequence[str]) -> str:
    """Describe how many items of each kind a sequence has."""
    return ", ".join(f"{count} {kind}" for kind, count in Counter(kinds).items())


def with_materials(scene: Scene, change: Callable[[Material], Material]) -> Scene:
    """Return a scene with other materials, on copies of its meshes."""

    def changed(mesh: Mesh) -> Mesh:
        mesh = copy.copy(mesh)
        mesh.material = change(mesh.material)
        return mesh

    return with_meshes(scene, changed)


def with_fields(scene: Scene, fields: dict[str, Any]) -> Scene:
    """Return a scene whose materials have other values of some fields."""
    return with_materials(scene, lambda material: replace(material, **fields))


def with_meshes(scene: Scene, change: Callable[[Mesh], Mesh]) -> Scene:
    """Return a scene with other meshes, each changed once."""
    changed, known = copy.copy(scene), {}
    changed.nodes = []
    for node in scene.posed().nodes:
        if node.mesh not in known:
            known[node.mesh] = change(node.mesh)
        changed.nodes.append(node._with_mesh(known[node.mesh]))
    return changed


def without_transmission(scene: Scene) -> Scene:
    """Return a scene whose surfaces transmit no light."""
    return with_fields(scene, {"transmission": 0.0})


def with_opaque_materials(scene: Scene) -> Scene:
    """Return a scene in which nothing is cut out or blended."""
    return with_fields(scene, {"alpha_mode": "opaque"})
