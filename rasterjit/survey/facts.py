"""Collect the facts about scene, camera and outputs that decide what a frame needs."""

from __future__ import annotations

import operator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.forks import cached_property
from rasterjit.pipeline.srgb_encoding import Encoding
from rasterjit.scene.background import Backdrop, BackgroundImage
from rasterjit.scene.environment import Environment
from rasterjit.scene.fog import Fog
from rasterjit.scene.light import AmbientLight
from rasterjit.scene.mesh import ATTRIBUTE
from rasterjit.scene.quality import STANDARD, SUPERSAMPLED, Quality
from rasterjit.scene.reference_shader import ReferenceShading
from rasterjit.scene.scene import EFFECT_FIELDS, Scene
from rasterjit.scene.tone_map import ToneMap
from rasterjit.scene.wireframe import Wireframe
from rasterjit.survey.batched_views import ViewGroup
from rasterjit.survey.blocked_lights import Enclosures
from rasterjit.survey.light_culling import NO_LIGHTS, PlannedLights, plan_lights
from rasterjit.survey.object_counts import (
    SMOOTH,
    Attribute,
    Inventory,
    ObjectCounts,
    find_attribute,
)
from rasterjit.survey.object_transforms import Boxes, ViewTransforms, have_uniform_scales
from rasterjit.survey.quality_overrides import override_lights
from rasterjit.survey.transparency import NO_TRANSPARENCY, Transparency, find_transparency

DISTANCE_ROUNDING = 1.0 + 2.0**-20
"""Factor on the farthest distance, for the rounding of positions and distances in float32."""

NORMAL_OUTPUTS = ("normal", "normal_camera")
"""Outputs that show vertex normals."""


@dataclass(frozen=True, eq=False, repr=False)
class Facts:
    """
    What planning reads: properties of the scene, the view, the outputs and the quality.

    Settings of a scene are stored as given, whether used or not. Where a frame is averaged from
    several pictures, each has facts of its own: its outputs are its own, its transparency and
    lights those of the whole frame.
    """

    outputs: tuple[str, ...]
    """Names of the outputs, as in ``outputs.output_table``, without repeats."""
    inventory: Inventory
    """Properties of the objects."""
    in_view: NDArray[np.bool_]
    """Whether each object may be visible, (O,)."""
    counts: ObjectCounts
    """Counts over all objects."""
    visible: ObjectCounts
    """Counts over the objects in view."""
    has_lights: bool
    """Whether the scene has any light besides its environment."""
    fields: dict[str, Any]
    """Fields of the scene for effects, by name; ``None`` for an effect that is off."""
    diagnose: bool
    """Whether diagnostics of faces are requested."""
    quality: Quality
    transparency: Transparency
    has_background: bool
    """Whether the render was given a background."""
    background_image: BackgroundImage | None
    """The background, if it is a picture."""
    lights: PlannedLights
    """The scene's lights that reach visible objects."""
    has_uneven_scale: bool
    """Whether any object in view with interpolated normals has a non-uniform scale, beyond
    rounding."""
    attributes: dict[str, Attribute]
    """The attributes of meshes that are outputs, by the output's name."""
    fog: Fog | None
    """The fog, if it may cover anything in view."""
    frame_outputs: tuple[str, ...]
    """Names of the outputs of the whole frame, if these are the facts of one of its pictures."""
    reference: ReferenceShading | None = None
    """Another program's shading to reproduce, if any."""

    def __repr__(self) -> str:
        visible, count = int(self.in_view.sum()), len(self.in_view)
        return f"Facts({visible} of {count} objects in view: {', '.join(self.outputs)})"

    @property
    def encoding(self) -> Encoding:
        """Encoding of 8-bit colours."""
        return "srgb" if self.reference is None else self.reference.encoding

    @cached_property
    def wireframe(self) -> Wireframe | None:
        """The scene's wireframe, if any."""
        return self.fields["wireframe"]

    @cached_property
    def environment(self) -> Environment | None:
        """The scene's environment, if any."""
        return self.fields["environment"]

    @cached_property
    def is_colored(self) -> bool:
        """Whether any output shows colour."""
        return "color" in self.outputs or "linear" in self.outputs

    @cached_property
    def needs_no_buffers(self) -> bool:
        """Whether no output needs a buffer besides colours and face numbers."""
        return {"color", "linear", "coverage", "face_id"}.issuperset(self.outputs)

    @cached_property
    def draws_faces(self) -> bool:
        """Whether faces are drawn, not only their edges."""
        return self.wireframe is None or self.wireframe.mode == "overlay"

    @cached_property
    def colors_faces(self) -> bool:
        """Whether the colour of faces is an output."""
        return self.is_colored and self.draws_faces

    @cached_property
    def shades(self) -> bool:
        """Whether the colour of any face in view is an output."""
        return self.colors_faces and self.visible.objects > 0

    @cached_property
    def is_lit(self) -> bool:
        """Whether the colour of any face in view depends on light."""
        return self.shades and self.visible.unlit < self.visible.objects

    @cached_property
    def shades_points(self) -> bool:
        """Whether the colour of any point in view is an output."""
        return self.shades and self.visible.points > 0

    @cached_property
    def has_headlight(self) -> bool:
        """Whether the default light is used: the scene has no other."""
        return self.is_lit and not self.has_lights and self.environment is None

    @cached_property
    def has_ambient_light(self) -> bool:
        """Whether an ambient light, the headlight or the environment gives ambient light."""
        return (
            self.has_headlight
            or self.has_environment_light
            or any(isinstance(light, AmbientLight) for light in self.lights.lights)
        )

    @cached_property
    def shades_smoothly(self) -> bool:
        """Whether the colour of any face in view depends on vertex normals."""
        return self.is_lit and not SMOOTH.isdisjoint(self.visible.shadings)

    @cached_property
    def shows_normals(self) -> bool:
        """Whether vertex normals of all objects are an output."""
        return self.visible.objects > 0 and not set(NORMAL_OUTPUTS).isdisjoint(self.outputs)

    @cached_property
    def needs_normals(self) -> bool:
        """Whether vertex normals are read."""
        return self.shades_smoothly or self.shows_normals

    @cached_property
    def finds_faces(self) -> bool:
        """Whether the visible face of each pixel must be found: for colours, counts or a buffer."""
        return self.draws_faces or self.diagnose or bool({*self.outputs} - {"color", "linear"})

    @cached_property
    def float32_objects(self) -> NDArray[np.uint8] | None:
        """
        Whether each object's vertex colours are interpolated in float32, (O,); None if no object's.

        Those of `Inventory.is_bare` are. If all objects in view are unlit and plain, those out of
        view are marked as well.
        """
        quality, visible, is_bare = self.quality, self.visible, self.inventory.is_bare
        if (
            quality.interpolation_precision == "float64"
            or (quality.samples != 1 and self.supersamples is None)
            or not (visible.unlit and visible.vertex_colored and is_bare.any())
        ):
            return None
        all_unlit = visible.unlit == visible.objects
        has_others = visible.blended or visible.has_textures or visible.with_field
        all_eligible = all_unlit and not has_others
        return (np.ones_like(is_bare) if all_eligible else is_bare).astype(np.uint8)

    @cached_property
    def reads_srgb8_textures(self) -> bool:
        """Whether the texture of any object in view is mixed as 8-bit sRGB codes."""
        return self.shades and self.quality.texture_mixing == "srgb8" and self.visible.coded > 0

    @cached_property
    def tone_map(self) -> ToneMap | None:
        """The tone map; None if it changes nothing, or if no 8-bit colours are made."""
        tone_map = self.fields["tone_map"]
        has_codes = "color" in self.frame_outputs or self.blends_srgb8
        return None if tone_map is None or tone_map.is_neutral or not has_codes else tone_map

    @cached_property
    def needs_gouraud(self) -> bool:
        """Whether vertices are lit."""
        return self.is_lit and self.visible.gouraud > 0

    @cached_property
    def needs_diffuse_light(self) -> bool:
        """Whether vertices are also lit without highlights: textures tint that light alone."""
        return self.is_lit and self.visible.tinted_highlights > 0

    @cached_property
    def needs_alpha_tests(self) -> bool:
        """Whether faces are alpha-tested."""
        return self.finds_faces and self.visible.cut_out > 0

    @cached_property
    def discards_faint_fragments(self) -> bool:
        """Whether fragments below ``quality.visible_alpha`` are discarded."""
        is_see_through = self.inventory.is_see_through & self.in_view
        return self.finds_faces and self.quality.visible_alpha > 0.0 and bool(is_see_through.any())

    @cached_property
    def tests_alpha(self) -> bool:
        """Whether alpha is tested to find the nearest face."""
        return self.needs_alpha_tests or self.discards_faint_fragments

    @cached_property
    def has_textured_cutouts(self) -> bool:
        """Whether the alpha of a texture cuts holes into any face."""
        return self.visible.textured_holes > 0

    @cached_property
    def casts_shadows(self) -> bool:
        """Whether any light may cast shadows on visible objects."""
        return self.is_lit and self.lights.have_shadows

    @cached_property
    def alpha_tests_shadow_maps(self) -> bool:
        """Whether shadow maps are alpha-tested; objects out of view cast shadows, too."""
        return self.casts_shadows and self.counts.cut_out > 0

    @cached_property
    def needs_textures(self) -> bool:
        """Whether textures are read."""
        return self.shades and self.visible.has_textures

    @cached_property
    def needs_scalar_fields(self) -> bool:
        """Whether scalars of vertices are looked up in colour maps."""
        return self.shades and self.visible.with_field > 0

    @cached_property
    def has_round_points(self) -> bool:
        """Whether any object, in view or not, has points that are discs or spheres."""
        return self.counts.discs + self.counts.spheres > 0

    @cached_property
    def supersamples(self) -> int | None:
        """
        Number of pictures that supersampling averages; ``None`` without supersampling.

        Discs and spheres are found at one point of a pixel. Where they are in view, 2 or 4 samples
        are replaced by 4 pictures; 8 or 16 samples, and areas, by 16.
        """
        samples = self.quality.samples
        if samples in SUPERSAMPLED:
            return int(samples)
        if samples == 1 or self.visible.discs + self.visible.spheres == 0:
            return None
        return 4 if samples in (2, 4) else 16

    @cached_property
    def pictures(self) -> int:
        """Number of pictures that are averaged; 1 if neither face nor environment is drawn."""
        has_edges = self.shades or self.shows_environment
        samples = self.supersamples
        return samples if has_edges and samples is not None else 1

    @cached_property
    def mixes_samples(self) -> bool:
        """Whether pixels of one picture have several samples, or areas."""
        return self.shades and self.quality.samples != 1 and self.supersamples is None

    @cached_property
    def antialiases(self) -> bool:
        """Whether the colour of a pixel is a mean of samples, or of areas."""
        return self.mixes_samples or self.pictures > 1

    @cached_property
    def needs_microfacets(self) -> bool:
        """Whether light falls on metallic-roughness materials."""
        return self.is_lit and self.visible.pbr > 0

    @cached_property
    def transmits(self) -> bool:
        """Whether a lit object transmits light, refracted."""
        return self.is_lit and self.visible.transmitting > 0

    @cached_property
    def blurs_behind(self) -> bool:
        """Whether any object, in view or not, is rough glass, which blurs what is behind it."""
        return self.counts.rough_glass > 0

    @cached_property
    def needs_material_layers(self) -> bool:
        """Whether a lit object has a clearcoat, sheen or custom specular."""
        return self.is_lit and self.visible.has_layers

    @cached_property
    def needs_material_maps(self) -> bool:
        """Whether material maps besides base colour are read."""
        return self.shades and self.visible.has_maps

    @cached_property
    def renormalizes(self) -> bool:
        """Whether interpolated normals are scaled to length one, pixel by pixel."""
        has_normal_map = self.visible.textured["normal_texture"] > 0
        return self.quality.renormalize or has_normal_map or self.has_uneven_scale

    @cached_property
    def has_environment_light(self) -> bool:
        """Whether the environment lights any face in view."""
        return self.is_lit and self.environment is not None and self.environment.lights

    @cached_property
    def shows_environment(self) -> bool:
        """Whether the environment is the background."""
        is_background = self.environment is not None and self.environment.background
        return is_background and self.is_colored and not self.has_background

    @cached_property
    def blends_srgb8(self) -> bool:
        """Whether colours are blended as 8-bit sRGB codes."""
        is_mixed = self.transparency.used or self.antialiases
        return is_mixed and self.quality.blending == "srgb8"


def may_fog_cover(fog: Fog | None, views: Boxes | ViewGroup) -> Any:
    """
    Tell whether fog has a density and begins before the farthest point in view.

    Returns a bool, or (N,) bool for a group of N views.
    """
    if fog is None or fog.density == 0.0:
        return False
    if fog.mode != "linear" or fog.start == 0.0:
        return True
    return views.compute_max_distance() * DISTANCE_ROUNDING > fog.start


def collect_facts(
    scene: Scene,
    boxes: Boxes,
    views: ViewTransforms,
    inventory: Inventory,
    quality: Quality,
    outputs: tuple[str, ...],
    background: Backdrop | None,
    diagnose: bool,
    cull: str,
    previous: Facts | None = None,
) -> Facts:
    """
    Collect the facts about a scene from a camera; lights only if anything is lit.

    Returns ``previous``, the facts of an earlier frame, if they still hold.
    """
    # All but transparency and lights.
    in_view = boxes.in_view
    has_uneven_scale = not quality.renormalize and _has_uneven_scale(views, in_view, inventory)
    fields = {name: getattr(scene, name) for name in EFFECT_FIELDS}
    fog = fields["fog"] if may_fog_cover(fields["fog"], boxes) else None
    image = background if isinstance(background, BackgroundImage) else None
    if (
        previous is not None
        # The same inventory means the same objects, meshes and effective materials.
        and previous.inventory is inventory
        and previous.quality is quality
        and previous.background_image is image
        and all(map(operator.is_, previous.fields.values(), fields.values()))
        and (previous.outputs, previous.diagnose, previous.has_uneven_scale)
        == (outputs, diagnose, has_uneven_scale)
        and previous.has_lights == bool(scene.lights)
        and previous.fog is fog
        and _is_same_shading(previous.reference, scene._reference_shading)
        and previous.has_background == (background is not None)
        and previous.in_view.tobytes() == in_view.tobytes()
    ):
        facts = previous
    else:
        facts = Facts(
            outputs=outputs,
            inventory=inventory,
            in_view=in_view,
            counts=inventory.contents,
            visible=inventory.count_chosen(in_view),
            has_lights=bool(scene.lights),
            fields=fields,
            diagnose=diagnose,
            quality=quality,
            transparency=NO_TRANSPARENCY,
            has_background=background is not None,
            background_image=image,
            lights=NO_LIGHTS,
            has_uneven_scale=has_uneven_scale,
            attributes={
                output: find_attribute(scene.nodes, output.removeprefix(ATTRIBUTE))
                for output in outputs
                if output.startswith(ATTRIBUTE)
            },
            fog=fog,
            frame_outputs=outputs,
            reference=scene._reference_shading,
        )
    # Transparency.
    transparency = facts.transparency
    if facts is not previous or facts.counts.blended > 0:
        transparency = find_transparency(
            scene.nodes, facts.colors_faces, facts.counts.blended > 0, inventory.is_see_through,
            in_view,
        )  # fmt: skip
    # Lights.
    lights = NO_LIGHTS
    if facts.is_lit and scene.lights and facts.lights.has_all(scene.lights):
        lights = facts.lights
    elif facts.is_lit and scene.lights:
        is_wall = inventory.is_wall & (cull == "none")
        meshes = [node.mesh for node in scene.nodes]
        enclosures = Enclosures(
            meshes, is_wall, views.relative_from_model, views.clip_from_relative
        )
        scene_lights = override_lights(scene.lights, quality)
        lights = plan_lights(scene_lights, boxes, inventory.casts_shadows, enclosures)
    has_same_transparency = transparency is facts.transparency or transparency.equals(
        facts.transparency
    )
    if has_same_transparency and (lights is facts.lights or lights == facts.lights):
        return facts
    return replace(facts, transparency=transparency, lights=lights)


def _is_same_shading(a: ReferenceShading | None, b: ReferenceShading | None) -> bool:
    """Tell whether two reference shadings are the same, or both None."""
    return a is b or (a is not None and a.equals(b))


def _has_uneven_scale(
    views: ViewTransforms, in_view: NDArray[np.bool_], inventory: Inventory
) -> bool:
    """Tell whether any object in view with interpolated normals has a non-uniform scale."""
    is_checked = in_view & inventory.interpolates_normals
    return not have_uniform_scales(views.relative_from_model[is_checked]).all()


def explain_unlit(facts: Facts) -> str:
    """Say why nothing is lit."""
    if facts.shades:
        return "every material in view is unlit"
    return "no object is in view" if facts.colors_faces else "nothing is shaded"


UNKNOWN_REASON = "not all that is drawn allows float32"
"""What `explain_float64` says where it finds no other reason."""


def explain_float64(facts: Facts) -> str | None:
    """Say why colours are interpolated in float64; None where they are in float32."""
    quality, visible = facts.quality, facts.visible
    if facts.float32_objects is not None:
        return None
    reasons = (
        (
            quality.interpolation_precision == "float64",
            "quality.interpolation_precision is 'float64'",
        ),
        (
            quality.samples != 1 and facts.supersamples is None,
            f"quality.samples is {quality.samples!r}",
        ),
        (visible.blended > 0, "an object is blended"),
        (visible.unlit < visible.objects, "an object is lit"),
        (visible.has_textures, "an object has a texture"),
        (visible.with_field > 0, "an object has scalars of its vertices"),
        (visible.vertex_colored == 0, "no mesh in view has colours of its vertices"),
    )
    return next((reason for holds, reason in reasons if holds), UNKNOWN_REASON)


def explain_linear_textures(facts: Facts) -> str | None:
    """Say why no texture in view may be mixed as 8-bit sRGB codes; None where one may."""
    visible = facts.visible
    reasons = (
        (visible.coded > 0, None),
        (visible.textured["base_color_texture"] == 0, "no material in view has a texture"),
        (visible.unlit == 0, "every object is lit"),
        (
            True,
            "every texture has mip levels, or is on an object that is lit, transparent or coloured",
        ),
    )
    return next(reason for holds, reason in reasons if holds)


def explain_other_float64(facts: Facts) -> str | None:
    """Say why some objects are interpolated in float64 beside others in float32; else None."""
    in_float32, visible = facts.float32_objects, facts.visible
    if in_float32 is None or in_float32.all():
        return None
    reasons = (
        (visible.blended > 0, "an object is blended"),
        (visible.has_textures, "an object has a texture"),
        (visible.with_field > 0, "an object has scalars of its vertices"),
        (True, "an object is lit"),
    )
    return next(reason for holds, reason in reasons if holds)


def describe_changed_settings(facts: Facts, *names: str) -> str:
    """List the settings among ``names`` that differ from the standard, with their values."""
    values = {name: getattr(facts.quality, name) for name in names}
    return "".join(
        f"; quality.{name} is {value!r}"
        for name, value in values.items()
        if value != getattr(STANDARD, name)
    )
