"""
Shade a frame: compute its colour outputs from the visibility buffer.

`shade_faces` first prepares light and surface, each only if the plan has a use for it, and then
shades the pixels. It makes the outputs ``linear`` and ``color``, as the plan asks for them, and
does nothing if it asks for neither.
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
from rasterjit.runtime.threads import Kept, Workers, count_per_task, rows_per_task
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


def shared_memory(plan: RenderPlan, workers: Workers) -> NDArray[np.int32] | None:
    """
    Return memory that faces and colours of a picture share, if colours may overwrite faces.

    They may where no face is read again once it is shaded: it halves the memory traffic. Else
    ``None``.
    """
    if plan.keeps_faces:
        return None
    width, height = plan.size if plan.region is None else plan.region[2:]
    return workers.memory.empty((height, width), np.int32)


def shade_faces(
    context: FrameContext, kept: Kept | None = None, shared: NDArray[np.int32] | None = None
) -> dict[str, NDArray[Any]]:
    """
    Make the colour outputs of a picture, if there are any.

    Parameters
    ----------
    context : FrameContext
    kept : Kept, optional
        What the picture before left.
    shared : (H, W) int32, optional
        The picture's faces, to be written over: see `shared_memory`.
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
    placement = placement_to_light(plan, placement)
    effects = prepare_effects(context._replace(placement=placement))

    def light(surface: Surface, lighting: Lighting) -> NDArray[np.float32]:
        starts = cache.shapes.arrays.vertex_starts
        own = starts, placement, surface, lighting, effects
        return light_vertices(plan, *own, workers)

    kept = kept or Kept(workers.memory, lasts=False)
    surface = kept.made(
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
        shader = shader.of_plain_codes()
    # Shade each pixel, or resolve its several faces.
    if plan.layers is not None:
        shade = resolve_layers.shade_codes if plan.layers.mixes_codes else resolve_layers.shade
        shade(plan.layers, coverage, shader, linear, color, workers)
    elif plan.facts.draws_faces:
        shade_in_bands(coverage.face_id, shader, linear, color, workers, kept)
    else:
        shade_nothing(shader, linear, color, workers)
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


def placement_to_light(plan: RenderPlan, placement: Placement) -> Placement:
    """
    Return a placement that preserves the length of normals, if pixels do not normalize them.

    pyrender computes highlights from the camera's position, for any projection.
    """
    if plan.facts.reference is not None:
        placement = placement._replace(toward_viewer=_AT_EYE)
    if plan.lighting is None or plan.lighting.renormalizes:
        return placement
    return placement._replace(normal_matrices=normalize_normal_matrices(placement.normal_matrices))


def find_alpha_tests(plan: RenderPlan, cache: SceneCache) -> AlphaTests | None:
    """Return the alpha tests of objects in view; ``None`` without any."""
    return (
        cache.tables.alpha_tests(plan.facts.has_textured_holes)
        if plan.facts.needs_alpha_tests
        else None
    )


def find_hit_tests(plan: RenderPlan, cache: SceneCache) -> AlphaTests | None:
    """Return the tests of visible hits: alpha masks and least visible alpha; None without any."""
    facts = plan.facts
    if not facts.discards_faint:
        return find_alpha_tests(plan, cache)
    tests = cache.tables.alpha_tests(facts.counts.textured["base_color_texture"] > 0)
    least = np.float32(facts.quality.visible_alpha)
    cutoffs = np.where(facts.inventory.is_see_through, least, tests.cutoffs)
    return tests._replace(cutoffs=cutoffs.astype(np.float32))


def find_surface(plan: RenderPlan, tables: MaterialTables) -> Surface:
    """
    Return the objects' surface record, with the parts that the plan reads, unlit.

    Parameters
    ----------
    plan : RenderPlan
    tables : MaterialTables
        Or what else has its fields.
    """
    facts, shown = plan.facts, plan.layers
    alphas = None if shown is None or not shown.has_blended else Alphas(shown.is_blended)
    return tables.surface._replace(
        normals=tables.normals if facts.shades_smoothly else None,
        textures=tables.textures if facts.needs_textures else None,
        maps=tables.maps if facts.needs_maps else None,
        alphas=alphas,
        microfacets=tables.microfacets if facts.needs_microfacets else None,
        fields=tables.fields if facts.needs_fields else None,
        transmission=tables.transmission if facts.transmits else None,
        in_float32=facts.float32_objects,
        layers=layers_in_view(tables.layers, facts) if facts.needs_layers else None,
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
    Return a surface with lit vertices, if the plan reads them.

    Parameters
    ----------
    plan : RenderPlan
    surface : Surface
    lighting : Lighting or None
    light : callable
        Returns what vertices look like in a light, (V, 2, 3).
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
    """Light the vertices of the objects shaded by Gouraud; (V, 2, 3), zero for the others."""
    count = len(placement.positions)
    lit = np.zeros((count, 2, 3), np.float32)
    per_task = count_per_task(count, MIN_LIT_VERTICES, workers)

    def light_some(first: int) -> None:
        some = first, min(first + per_task, count)
        own = vertex_starts, placement, surface, lighting, effects
        pass_runner.light_vertices(plan.shading, some, *own, lit)

    workers.run(light_some, [(n,) for n in range(0, count, per_task)])
    return lit


def shade_in_bands(
    face_id: NDArray[np.int32],
    shader: resolve_layers.Shader,
    linear: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    workers: Workers,
    kept: Kept | None = None,
) -> None:
    """
    Shade and resolve the frame in bands of rows.

    Parameters
    ----------
    face_id : (H, W) int32
    shader : Shader
    linear : (H, W, 4) float32 or None
        Written, if the frame has it.
    color : (H, W, 4) uint8 or None
        Written, if the frame has it.
    workers : Workers
    kept : Kept, optional
        What the picture before left: its stages, if they read the same.
    """
    height = len(face_id)
    nothing = np.empty((height, 0), np.uint32)
    packed = nothing if color is None else color.view(np.uint32)[:, :, 0]
    if linear is None:
        linear = np.empty((height, 0, 4), np.float32)
    per_task = rows_per_task(face_id.shape, workers)
    shader = shader.ready(kept)

    in_machine_code = not (jit.DISABLED or jit.CHECKED)
    if in_machine_code and workers.threads > 1 and per_task < height and not shader.has_behind:
        shader.shading.shade_bands(face_id, per_task, linear, packed, workers)
        return

    def shade_band(first: int) -> None:
        band = slice(first, min(first + per_task, height))
        shader.shading.shade(face_id[band], first, linear[band], packed[band])
        shader.show_behind(IMMEDIATE, face_id[band], first, linear[band], packed[band])

    workers.run(shade_band, [(first,) for first in range(0, height, per_task)])


def shade_nothing(
    shader: resolve_layers.Shader,
    linear: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    workers: Workers,
) -> None:
    """Write a frame without faces: takes what `shade_in_bands` does, except faces."""
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
    # All rows are alike.
    for picture in pictures:
        picture[1:] = picture[0]


def glass_of(plan: RenderPlan) -> tuple[OpaquePassEffect, Any] | None:
    """Return the transmission effect of a frame, with its data; ``None`` without one."""
    around = list_screen_effects(plan.planned)
    return next(((one, data) for one, data in around if isinstance(one, OpaquePassEffect)), None)


def plan_behind(plan: RenderPlan, glass: OpaquePassEffect) -> RenderPlan:
    """Return the plan of the opaque pass that transmission reads."""
    layers, hidden = plan.layers, glass.hidden_objects(plan.facts)
    if layers is not None and layers.has_blended:
        hidden = hidden | (layers.is_blended > 0)
    if layers is not None:
        opaque = np.zeros_like(layers.is_blended)
        layers = layers._replace(is_blended=opaque, has_blended=False, mixes_codes=False)
        layers = None if layers.samples == 1 else layers
    drawn = None if plan.drawn_behind is None else (plan.drawn_behind,)

    def is_behind(planned: UsedEffect) -> bool:
        places = planned.effect.places
        return planned.effect is not glass and "overlay" not in places and "mixed" not in places

    return plan.for_picture(
        is_behind, outputs=("linear",), layers=layers, hidden=hidden, drawn=drawn
    )


def draw_behind(
    context: FrameContext, glass: OpaquePassEffect, find: Callable[[RenderPlan], RasterizedView]
) -> FrameContext:
    """Run the opaque pass that transmission reads, up to visibility."""
    plan = plan_behind(context.plan, glass)
    return context_of(plan, context.cache, find(plan), context.workers)


def look_behind(
    context: FrameContext, find: Callable[[RenderPlan], RasterizedView]
) -> FrameContext:
    """
    Return the context with the opaque pass that transmission reads; itself without transmission.

    Parameters
    ----------
    context : FrameContext
    find : callable
        Returns what the picture of another plan shows.
    """
    plan = context.plan
    own = glass_of(plan)
    if own is None:
        return context
    glass, data = own
    (done,) = plan.drawn or ({},)
    if glass.name in done:
        record = glass.crop_record(done[glass.name], plan.corner)
    else:
        linear = shade_faces(draw_behind(context, glass, find))["linear"]
        record = glass.prepare(context, data, [(plan.camera, linear)])
    return context._replace(plan=plan.for_picture(drawn=({**done, glass.name: record},)))
