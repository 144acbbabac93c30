"""
Shade a frame: compute its colour outputs from the visibility buffer.

`shade_faces` first prepares light and surface, as far as the plan needs them, and then shades the
pixels into the outputs ``linear`` and ``color``, those of them that the plan has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.passes import Rows
from rasterjit.pipeline.records import (
    Alphas,
    AlphaTests,
    Layers,
    Lighting,
    Placement,
    Surface,
)
from rasterjit.pipeline.srgb_encoding import encode_color
from rasterjit.pipeline.visibility.visibility_pass import RasterizedView
from rasterjit.rendering import pass_runner, resolve_layers
from rasterjit.rendering.effect_registry import prepare_effects
from rasterjit.rendering.pass_runner import IMMEDIATE
from rasterjit.runtime import jit
from rasterjit.runtime.threads import (
    FrameCache,
    Workers,
    choose_task_size,
    rows_per_task,
    split_range,
)
from rasterjit.survey.cache import MaterialTables, SceneCache
from rasterjit.survey.effect import (
    ActiveEffect,
    FrameContext,
    OpaquePassEffect,
    UsedEffect,
    context_of,
    list_screen_effects,
    select_acting,
)
from rasterjit.survey.facts import Facts
from rasterjit.survey.object_transforms import normalize_normal_matrices
from rasterjit.survey.plan import RenderPlan

MIN_LIT_VERTICES = 4096
"""Fewest vertices lit by one task."""


_AT_EYE = np.array([0.0, 0.0, 0.0, 1.0])
"""``toward_viewer`` of a perspective, relative to the eye."""


def allocate_shared_pixels(plan: RenderPlan, workers: Workers) -> NDArray[np.int32] | None:
    """
    Allocate memory for a picture's faces that its colours then overwrite, or return ``None``.

    Only if no face is read after shading; it halves the memory traffic.
    """
    if plan.keeps_faces:
        return None
    width, height = plan.size if plan.region is None else plan.region[2:]
    return workers.memory.empty((height, width), np.int32)


def shade_faces(
    context: FrameContext,
    frame_cache: FrameCache | None = None,
    shared: NDArray[np.int32] | None = None,
) -> dict[str, NDArray[Any]]:
    """
    Shade the colour outputs of a picture, if there are any.

    Parameters
    ----------
    context : FrameContext
    frame_cache : FrameCache, optional
    shared : (H, W) int32, optional
        The picture's faces, to be overwritten: see `allocate_shared_pixels`.
    """
    plan, cache, placement, workers = context[:4]
    geometry, coverage = context.seen.geometry, context.seen.coverage
    if not plan.facts.is_colored:
        return {}
    height, width = coverage.face_id.shape
    linear = (
        workers.memory.empty((height, width, 4), np.float32) if "linear" in plan.outputs else None
    )
    color = None
    if shared is not None:
        color = shared.view(np.uint8).reshape(height, width, 4)
    elif "color" in plan.outputs:
        color = workers.memory.empty((height, width, 4), np.uint8)
    # Prepare what shading reads.
    placement = adjust_placement(plan, placement)
    effects = prepare_effects(context._replace(placement=placement))

    def light(surface: Surface, lighting: Lighting) -> NDArray[np.float32]:
        starts = cache.shapes.arrays.vertex_starts
        return light_vertices(plan, starts, placement, surface, lighting, effects, workers)

    frame_cache = frame_cache or FrameCache(workers.memory, is_enabled=False)
    surface = frame_cache.get_or_make(
        "surface", lambda *_: find_surface(plan, cache.tables), plan.facts, plan.layers,
        cache.tables,
    )  # fmt: skip
    surface = light_surface(plan, surface, plan.lighting, light)
    if plan.facts.shades_points and coverage.points is not None:
        surface = surface._replace(points=coverage.points.read)
    shader = resolve_layers.Shader(
        plan.shading, geometry, placement, surface, plan.lighting, plan.background, effects,
        find_alpha_tests(plan, cache), encoding=plan.facts.encoding,
    )  # fmt: skip
    if plan.mixes_plain_codes:
        shader = shader.with_constant_codes()
    # Shade each pixel, or resolve its several faces.
    if plan.layers is not None:
        shade = resolve_layers.shade_codes if plan.layers.blends_srgb8 else resolve_layers.shade
        shade(plan.layers, coverage, shader, linear, color, workers)
    elif plan.facts.draws_faces:
        shade_in_bands(coverage.face_id, shader, linear, color, workers, frame_cache)
    else:
        fill_background(shader, linear, color, workers)
    return {
        name: picture
        for name, picture in (("linear", linear), ("color", color))
        if picture is not None
    }


def kernels_of(plan: RenderPlan) -> Rows:
    """Return the kernels that resolve pixels with several faces."""
    if plan.layers is None or not plan.facts.is_colored:
        return []
    return resolve_layers.kernels_of(plan)


def adjust_placement(plan: RenderPlan, placement: Placement) -> Placement:
    """
    Return the placement that shading reads.

    Normals keep their length where pixels do not normalize them. pyrender computes highlights from
    the camera's position, for any projection.
    """
    if plan.facts.reference is not None:
        placement = placement._replace(toward_viewer=_AT_EYE)
    if plan.lighting is None or plan.lighting.renormalizes:
        return placement
    return placement._replace(normal_matrices=normalize_normal_matrices(placement.normal_matrices))


def find_alpha_tests(plan: RenderPlan, cache: SceneCache) -> AlphaTests | None:
    """Return the alpha tests of objects in view; ``None`` without any."""
    return (
        cache.tables.alpha_tests(plan.facts.has_textured_cutouts)
        if plan.facts.needs_alpha_tests
        else None
    )


def find_hit_tests(plan: RenderPlan, cache: SceneCache) -> AlphaTests | None:
    """Return the tests of visible faces: alpha masks and least visible alpha; None without any."""
    facts = plan.facts
    if not facts.discards_faint_fragments:
        return find_alpha_tests(plan, cache)
    tests = cache.tables.alpha_tests(facts.counts.textured["base_color_texture"] > 0)
    least = np.float32(facts.quality.visible_alpha)
    cutoffs = np.where(facts.inventory.is_see_through, least, tests.cutoffs)
    return tests._replace(cutoffs=cutoffs.astype(np.float32))


def find_surface(plan: RenderPlan, tables: MaterialTables) -> Surface:
    """
    Return the objects' surface record, with the parts that the plan reads, without lit vertices.

    Parameters
    ----------
    plan : RenderPlan
    tables : MaterialTables
        Or another object with the same fields.
    """
    facts, shown = plan.facts, plan.layers
    alphas = None if shown is None or not shown.has_blended else Alphas(shown.is_blended)
    return tables.surface._replace(
        normals=tables.normals if facts.shades_smoothly else None,
        textures=tables.textures if facts.needs_textures else None,
        maps=tables.maps if facts.needs_material_maps else None,
        alphas=alphas,
        microfacets=tables.microfacets if facts.needs_microfacets else None,
        fields=tables.fields if facts.needs_scalar_fields else None,
        transmission=tables.transmission if facts.transmits else None,
        coded=tables.coded_textures if facts.reads_srgb8_textures else None,
        in_float32=facts.float32_objects,
        layers=layers_in_view(tables.layers, facts) if facts.needs_material_layers else None,
    )


def layers_in_view(layers: Layers, facts: Facts) -> Layers:
    """Return the material layers of the objects in view."""
    seen = facts.visible
    return layers._replace(
        coats=layers.coats if seen.coated else None,
        sheens=layers.sheens if seen.with_sheen else None,
        dielectrics=layers.dielectrics if seen.custom_specular else None,
    )


def light_surface(
    plan: RenderPlan,
    surface: Surface,
    lighting: Lighting | None,
    light: Callable[[Surface, Lighting], NDArray[np.float32]],
) -> Surface:
    """
    Add lit vertices to a surface, if the plan reads them.

    Parameters
    ----------
    plan : RenderPlan
    surface : Surface
    lighting : Lighting or None
    light : callable
        Returns the colours of vertices lit by some lighting, (V, 2, 3).
    """
    if lighting is None or not plan.facts.needs_gouraud:
        return surface
    diffuse, lit = None, light(surface, lighting)
    if plan.facts.needs_diffuse_light:
        diffuse = light(surface, lighting._replace(highlights=None))
    return surface._replace(lit_vertices=lit, diffuse_vertices=diffuse)


def light_vertices(
    plan: RenderPlan,
    vertex_starts: NDArray[np.int64],
    placement: Placement,
    surface: Surface,
    lighting: Lighting,
    effects: Sequence[ActiveEffect],
    workers: Workers,
) -> NDArray[np.float32]:
    """Return the lit colours of vertices shaded by Gouraud, (V, 2, 3), zero for the others."""
    count = len(placement.positions)
    lit = np.zeros((count, 2, 3), np.float32)
    per_task = choose_task_size(count, MIN_LIT_VERTICES, workers)

    def light_some(first: int, last: int) -> None:
        inputs = vertex_starts, placement, surface, lighting, effects
        pass_runner.light_vertices(plan.shading, (first, last), *inputs, lit)

    workers.run(light_some, split_range(count, per_task))
    return lit


def shade_in_bands(
    face_id: NDArray[np.int32],
    shader: resolve_layers.Shader,
    linear: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    workers: Workers,
    frame_cache: FrameCache | None = None,
) -> None:
    """
    Shade a frame with one face per pixel, in bands of rows.

    Parameters
    ----------
    face_id : (H, W) int32
    shader : Shader
    linear : (H, W, 4) float32 or None
        Written, if the frame has it.
    color : (H, W, 4) uint8 or None
        Written, if the frame has it.
    workers : Workers
    frame_cache : FrameCache, optional
        May hold the stages.
    """
    height = len(face_id)
    nothing = np.empty((height, 0), np.uint32)
    packed = nothing if color is None else color.view(np.uint32)[:, :, 0]
    if linear is None:
        linear = np.empty((height, 0, 4), np.float32)
    per_task = rows_per_task(face_id.shape, workers)
    shader = shader.prepare_stages(frame_cache)

    is_compiled = not (jit.DISABLED or jit.CHECKED)
    if (
        is_compiled
        and workers.threads > 1
        and per_task < height
        and not shader.has_background_effects
    ):
        shader.shading.shade_bands(face_id, per_task, linear, packed, workers)
        return

    def shade_band(first: int, last: int) -> None:
        band = slice(first, last)
        shader.shading.shade(face_id[band], first, linear[band], packed[band])
        shader.draw_background(IMMEDIATE, face_id[band], first, linear[band], packed[band])

    workers.run(shade_band, split_range(height, per_task))


def fill_background(
    shader: resolve_layers.Shader,
    linear: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    workers: Workers,
) -> None:
    """Write a frame without faces; takes what `shade_in_bands` does, without ``face_id``."""
    pictures = [picture for picture in (linear, color) if picture is not None]
    height, width = pictures[0].shape[:2]
    if select_acting(shader.effects, "background"):
        nothing = np.full((height, width), -1, np.int32)
        shade_in_bands(nothing, shader, linear, color, workers)
        return
    if linear is not None:
        linear[0] = shader.background
    if color is not None:
        color.view(np.uint32)[0] = encode_color(shader.background, shader.encoding)
    # Copy the first row to the others.
    for picture in pictures:
        picture[1:] = picture[0]


def find_transmission(plan: RenderPlan) -> tuple[OpaquePassEffect, Any] | None:
    """Return the transmission effect of a frame, with its data; ``None`` without one."""
    effects = list_screen_effects(plan.planned)
    return next(
        ((effect, data) for effect, data in effects if isinstance(effect, OpaquePassEffect)), None
    )


def plan_opaque_pass(plan: RenderPlan, transmission: OpaquePassEffect) -> RenderPlan:
    """Return the plan of the opaque pass that transmission reads."""
    layers, hidden = plan.layers, transmission.hidden_objects(plan.facts)
    if layers is not None and layers.has_blended:
        hidden = hidden | (layers.is_blended > 0)
    if layers is not None:
        opaque = np.zeros_like(layers.is_blended)
        layers = layers._replace(is_blended=opaque, has_blended=False, blends_srgb8=False)
        layers = None if layers.samples == 1 else layers
    drawn = None if plan.drawn_behind is None else (plan.drawn_behind,)

    def is_in_opaque_pass(planned: UsedEffect) -> bool:
        places = planned.effect.places
        return (
            planned.effect is not transmission and "overlay" not in places and "mixed" not in places
        )

    return plan.for_picture(
        is_in_opaque_pass, outputs=("linear",), layers=layers, hidden=hidden, drawn=drawn
    )


def find_opaque_pass(
    context: FrameContext,
    transmission: OpaquePassEffect,
    find: Callable[[RenderPlan], RasterizedView],
) -> FrameContext:
    """Find the visible faces of the opaque pass that transmission reads."""
    plan = plan_opaque_pass(context.plan, transmission)
    return context_of(plan, context.cache, find(plan), context.workers)


def with_opaque_pass(
    context: FrameContext, find: Callable[[RenderPlan], RasterizedView]
) -> FrameContext:
    """
    Draw the opaque pass that transmission reads, if any; return the context with its record.

    Parameters
    ----------
    context : FrameContext
    find : callable
        Returns the visible faces for another plan.
    """
    plan = context.plan
    found = find_transmission(plan)
    if found is None:
        return context
    transmission, data = found
    (records,) = plan.drawn or ({},)
    if transmission.name in records:
        record = transmission.crop_record(records[transmission.name], plan.corner)
    else:
        linear = shade_faces(find_opaque_pass(context, transmission, find))["linear"]
        record = transmission.prepare(context, data, [(plan.camera, linear)])
    return context._replace(plan=plan.for_picture(drawn=({**records, transmission.name: record},)))
