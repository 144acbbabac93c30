"""
Shadows by shadow maps.

A frame has shadows where something may stand between a light with a shadow and a surface that it
reaches. Maps are rasterized like any picture and fitted to the visible surfaces: a map of n x n
texels takes 4 n n bytes, and the time of a picture of that size. Each sample is compared with the
map of each light.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.shadows import filters, maps, receivers, visible_cells
from rasterjit.effects.shadows import stage as shadows_stage
from rasterjit.pipeline.lighting import light_stages
from rasterjit.pipeline.passes import KernelRow, Pass, Rows, ShadingArrays, ShadingNeeds, fixed
from rasterjit.pipeline.surface import point_normals
from rasterjit.pipeline.surface.sample_block import OFFSET_POINT, RECEIVER_POINT
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.scene.camera import Camera
from rasterjit.scene.light import AmbientLight, Light, Shadow
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.batched_views import ViewGroup
from rasterjit.survey.effect import (
    UNDECIDED,
    BatchedEffect,
    FrameContext,
    Planning,
    ScreenEffect,
    ViewArrays,
    with_field,
)
from rasterjit.survey.facts import Facts, describe_changed_settings
from rasterjit.survey.light_culling import (
    BYTES_PER_TEXEL,
    CastingLight,
    are_all_shadows_cast,
    has_cube,
)
from rasterjit.survey.object_transforms import transform_boxes
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.quality_overrides import override_shadow

MAX_SUGGESTED_TEXELS = 1 << 26
"""Largest number of texels of maps suggested to users: 268 MB."""

NO_LIGHT = np.empty(0, np.float32)
"""Argument in place of a light where no samples are skipped."""

Shadows: TypeAlias = maps.ShadowRecord | maps.PlannedShadows

Views = Sequence[tuple[Camera, visible_cells.DepthRanges]]


def describe_shadows(lights: Sequence[Light]) -> str:
    """Say the number and size of the lights' maps, and their bytes in total."""
    maps: Counter[int] = Counter()
    for light in lights:
        shadow = getattr(light, "shadow", None)
        if shadow is not None:
            maps[shadow.size] += 6 if has_cube(light) else 1
    texels = sum(count * size * size for size, count in maps.items())
    listed = ", ".join(
        f"{count} map{'s' if count > 1 else ''} of {size} x {size}" for size, count in maps.items()
    )
    return f"{listed}, {texels * BYTES_PER_TEXEL / 1e6:.1f} MB"


def list_mapped_lights(facts: Facts) -> list[CastingLight]:
    """Return the lights that have a row in ``Lighting.lights``."""
    return [light for light in facts.lights.lights if not isinstance(light, AmbientLight)]


def list_receiver_passes(needs: ShadingNeeds) -> list[Pass]:
    """Return the passes that find shadow receivers, once for all lights."""
    has_microfacets = int(needs.microfacets)

    def arguments(a: ShadingArrays) -> tuple[Any, ...]:
        return a.placement.positions, a.placement.relative_from_model, has_microfacets

    passes = [Pass(receivers.find_receivers, arguments)]
    if needs.points:
        passes.append(
            Pass(point_normals.find_point_receivers, lambda a: (*a.surface.points, a.placement))
        )
    return passes


def can_skip_turned_away(needs: ShadingNeeds) -> bool:
    """Return whether a light adds nothing to samples whose normals turn away from it."""
    # Coats have normals of their own; sheen, glass and pyrender's shader may add light there.
    return not (needs.layers or needs.transmission or needs.pyrender)


class ShadowMaps(ScreenEffect, BatchedEffect):
    """Multiply each light by its visibility in its shadow map."""

    name = "shadows"
    key = "l"
    scope = "whole"
    settings = ("shadow_size", "shadow_taps")
    needs_facts_only = True
    fills_record = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why no light casts shadows on visible surfaces."""
        if facts.casts_shadows:
            return ""
        if not facts.is_lit:
            return "nothing is lit"
        return "; ".join(facts.lights.shadow_notes) or "no light casts them"

    def plan_data(self, facts: Facts, planning: Planning) -> Any:
        """Return the maps to draw."""
        return maps.plan_shadows(list_mapped_lights(facts))

    def describe(self, facts: Facts) -> str:
        """Say which maps are drawn."""
        drawn = describe_shadows(facts.lights.lights), *facts.lights.shadow_notes
        return "; ".join(drawn) + describe_changed_settings(facts, *self.settings)

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Return True: maps are fitted to visible surfaces, by depth."""
        return True

    def analyse(self, context: FrameContext) -> visible_cells.DepthRanges:
        """Return the picture's depth ranges, to which maps are fitted."""
        layers = context.plan.layers
        asks_objects = layers is not None and not layers.has_blended
        starts = context.placement.face_starts if asks_objects else None
        return visible_cells.read_depth_ranges(context.seen.coverage, context.workers, starts)

    def merge_parts(
        self,
        size: tuple[int, int],
        parts: Sequence[tuple[tuple[int, int], visible_cells.DepthRanges]],
    ) -> visible_cells.DepthRanges:
        """Return the depth ranges of a picture, from those of its parts."""
        return visible_cells.merge_depth_ranges(size, parts)

    def prepare(self, context: FrameContext, data: Any, seen: Views) -> maps.ShadowRecord | None:
        """Fit the maps to visible surfaces and draw them; ``None`` if there are none."""
        return self._draw(context, seen)

    def decide_views(self, scene: Scene, group: ViewGroup) -> NDArray[np.int8] | bool:
        """Return where the shadows of all lights are cast; where it is not sure, a plan decides."""
        if not any(getattr(light, "shadow", None) for light in scene.lights):
            return False
        return np.where(are_all_shadows_cast(scene, group), 1, UNDECIDED).astype(np.int8)

    def prepare_batch(
        self, plan: RenderPlan, data: maps.PlannedShadows, view_arrays: ViewArrays
    ) -> maps.ShadowRecord:
        """Return a record with memory for the maps."""
        return maps.allocate_record(list_mapped_lights(plan.facts))

    def fill_record(
        self, context: FrameContext, data: maps.PlannedShadows, record: maps.ShadowRecord
    ) -> bool:
        """Fit the maps to a view and draw them; return whether all lights have theirs."""
        drawn = self._draw(context, [(context.plan.camera, self.analyse(context))], record)
        if drawn is None:
            return False
        record.maps[:] = drawn.maps
        for target, values in zip(record.cells, drawn.cells, strict=True):
            if target is not None:
                target[:] = values
        return True

    @staticmethod
    def _draw(
        context: FrameContext, seen: Views, record: maps.ShadowRecord | None = None
    ) -> maps.ShadowRecord | None:
        """Return the maps, drawn into those of a record, if given; ``None`` if there are none."""
        plan, cache, placement, workers = context[:4]
        facts, arrays = plan.facts, cache.shapes.arrays
        # Objects lit at their vertices need shadows at all of them.
        always_lit = plan.facts.in_view & facts.inventory.is_gouraud
        # Behind glass, and between pixel centres, more is visible than the depth buffer holds.
        may_be_seen = plan.facts.in_view & (plan.layers is not None)
        if plan.layers is not None and not plan.layers.has_blended:
            boxes = transform_boxes(cache.shapes.boxes, placement.relative_from_model)
            may_be_seen &= visible_cells.find_unseen_objects(plan.camera, boxes, seen[0][1])
        vertices = visibility_pass.ModelVertices(
            arrays.positions, arrays.vertex_starts, placement.relative_from_model, np.eye(4)
        )
        alpha_tests = None
        if facts.alpha_tests_shadow_maps:
            alpha_tests = cache.tables.alpha_tests(facts.counts.textured_holes > 0)
        cells = [visible_cells.make_depth_cells(*view) for view in seen]
        casters = maps.Casters(
            vertices, arrays.faces, placement, cache.shapes.boxes, facts.inventory.casts_shadows,
            alpha_tests, arrays.primitives,
        )  # fmt: skip
        scenery = maps.collect_scenery(
            casters, always_lit, may_be_seen, np.concatenate(cells), plan.camera, plan.size
        )
        eye = plan.camera.eye_position()
        return maps.draw_shadows(list_mapped_lights(facts), eye, scenery, workers, record)

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that draw the maps: those of a picture, with the lights as cameras."""
        cast = "something casts a shadow on what is seen"
        facts = plan.facts
        drawn = visibility_pass.list_kernels(
            visibility_pass.VisibilityOptions(),
            facts.alpha_tests_shadow_maps,
            facts.counts.primitives,
        )
        rows = [
            row._replace(condition=f"{cast}, {row.condition}" if row.condition else cast)
            for row in drawn
        ]
        return {"prepare": [KernelRow(receivers.find_depth_ranges), *rows]}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the maps; that of a point light has up to six sides."""
        shadows = [
            (light.shadow, 6 if has_cube(light) else 1)
            for light in list_mapped_lights(plan.facts)
            if light.shadow is not None
        ]
        return [
            (f"shadow map, {shadow.size} texels", sides, "float32", (shadow.size, shadow.size))
            for shadow, sides in shadows
        ]

    def neutral(self, record: maps.ShadowRecord) -> maps.ShadowRecord:
        """Return the record with no light having a map."""
        layouts = record.layouts.copy()
        layouts[:, shadows_stage.FIRST_TEXEL] = -1
        return record._replace(layouts=layouts)

    def without(self, scene: Scene) -> Scene:
        """Return the scene with lights that cast no shadows."""
        lights = [
            light if isinstance(light, AmbientLight) else replace(light, shadow=None)
            for light in scene.lights
        ]
        return with_field(scene, "lights", lights)

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Return the scene with shadows of all lights that can cast them."""
        shadow = override_shadow(Shadow(), quality)
        casting = [light for light in scene.lights if not isinstance(light, AmbientLight)]
        count, size = sum(light.shadow is None for light in casting), shadow.size
        what = f"of {count} more light{'s' if count > 1 else ''}, maps of {size} x {size}"
        if count == len(casting):
            what = what.replace(" more", "")
        lights = [
            light
            if isinstance(light, AmbientLight) or light.shadow is not None
            else replace(light, shadow=shadow)
            for light in scene.lights
        ]
        number = sum(6 if has_cube(light) else 1 for light in casting)
        is_bounded = number * size * size <= MAX_SUGGESTED_TEXELS
        return what, with_field(scene, "lights", lights) if count and is_bounded else None

    @staticmethod
    def dim(shadows: Shadows, needs: ShadingNeeds, number: int, of_vertices: bool) -> list[Pass]:
        """Return the passes that write row SHADOW before a light is added; none if unchanged."""
        first, size, kind, sides = shadows.layouts[number].tolist()
        has_map = shadows.layouts[: number + 1, shadows_stage.FIRST_TEXEL] >= 0
        if first < 0:
            # Reset the row, which holds the shadow of the light before.
            return [fixed(light_stages.reset_visibility)] if has_map[:-1][-1:].any() else []
        passes = []
        if has_map.sum() == 1 and not of_vertices:
            passes += list_receiver_passes(needs)
        point = RECEIVER_POINT
        # A vertex's own plane faces the light where it is lit.
        if needs.normals and not of_vertices:

            def offset_arguments(a: ShadingArrays) -> tuple[Any, ...]:
                light, matrices = a.lighting.lights[number], a.placement.relative_from_model
                return light, a.surface.normals, matrices

            passes.append(Pass(receivers.offset_turned_away, offset_arguments))
            point = OFFSET_POINT
        if sides == 1:
            passes.append(
                Pass(shadows_stage.project_to_map, lambda _: (point, shadows.maps[number]))
            )
        else:
            passes.append(
                Pass(shadows_stage.project_to_cube, lambda _: (point, shadows.maps[number], size))
            )
        on_faces = int(not of_vertices)
        turns_away = not of_vertices and can_skip_turned_away(needs)

        def map_args(_: ShadingArrays) -> tuple[Any, ...]:
            texels = shadows.texels[first : first + sides * size * size]
            return texels, size, sides, on_faces

        def soft_arguments(a: ShadingArrays) -> tuple[Any, ...]:
            density = shadows.densities[number]
            points = maps.make_disk_points(density), maps.make_spiral(size, density)
            return (
                *map_args(a),
                shadows.maps[number],
                shadows.cells[number],
                *points,
                a.lighting.lights[number] if turns_away else NO_LIGHT,
            )

        if kind == filters.HARD:
            return [*passes, Pass(shadows_stage.filter_hard, map_args)]
        if kind == filters.PCF:
            return [*passes, Pass(shadows_stage.filter_pcf, map_args)]
        return [*passes, Pass(shadows_stage.filter_soft, soft_arguments)]

    places: ClassVar = {"light": dim}


SHADOWS = ShadowMaps()
