"""
The passes of a frame that follow visibility: colour and edges.

Each makes some of the frame's outputs from the visibility buffer, or does nothing if the plan has
no use for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit import (
    edge_lines,
    layered,
    layered_codes,
    screen_effects,
    shadow_cells,
    shadow_maps,
    stages,
)
from rasterjit.backdrops import Sky, show_environment
from rasterjit.environment_maps import backdrop_record, environment_record
from rasterjit.kernels.records import (
    Alphas,
    Cutouts,
    Geometry,
    Lighting,
    Placement,
    Shadows,
    Surface,
)
from rasterjit.plan import RenderPlan
from rasterjit.plan_atmosphere import background_rays
from rasterjit.plan_boxes import place_boxes
from rasterjit.plan_views import unit_matrices
from rasterjit.prepared import Prepared
from rasterjit.scene.color import linear_to_srgb
from rasterjit.scene.light import AmbientLight
from rasterjit.scene.srgb import decoding_table


def shade_faces(
    plan: RenderPlan,
    prepared: Prepared,
    geometry: Geometry,
    placement: Placement,
    coverage: stages.Coverage,
    workers: stages.Workers,
) -> dict[str, NDArray[Any]]:
    """Make the colour outputs, if there are any."""
    result: dict[str, NDArray[Any]] = {}
    if not plan.needs_color:
        return result
    height, width = coverage.face_id.shape
    linear = (
        workers.memory.empty((height, width, 4), np.float32) if "linear" in plan.outputs else None
    )
    color = workers.memory.empty((height, width, 4), np.uint8) if "color" in plan.outputs else None
    placement = placement_to_light(plan, placement)
    lighting = find_lighting(plan, prepared, geometry, placement, coverage, workers)
    surface = find_surface(plan, prepared, placement, lighting, workers)
    sky = find_sky(plan)
    if plan.layers is not None:
        shader = layered.Shader(
            geometry,
            placement,
            surface,
            lighting,
            plan.background,
            plan.encoding,
            sky,
            find_cutouts(plan, prepared),
        )
        shade = layered_codes.shade if plan.layers.mixes_codes else layered.shade
        shade(plan.layers, coverage, shader, linear, color, workers)
    else:
        # Without faces all rows are alike: the first is shaded, the others are copies of it.
        shown = coverage.face_id if plan.draws_faces else np.full((1, width), -1, np.int32)
        stages.shade(
            shown, geometry, placement, surface, lighting, plan.background,
            None if linear is None else linear[: len(shown)],
            None if color is None else color[: len(shown)], plan.encoding, workers,
        )  # fmt: skip
        for picture in (linear, color):
            if picture is not None:
                picture[len(shown) :] = picture[0]
        if sky is not None:
            empty = shown if plan.draws_faces else np.full((height, width), -1, np.int32)
            show_environment(empty, sky, plan.encoding, linear, color, workers)
    if linear is not None:
        result["linear"] = linear
    if color is not None:
        result["color"] = color
    return result


def placement_to_light(plan: RenderPlan, placement: Placement) -> Placement:
    """Return a placement that keeps the length of normals, if no pixel scales them to one."""
    if plan.lighting is None or plan.lighting.renormalizes:
        return placement
    return placement._replace(normal_matrices=unit_matrices(placement.normal_matrices))


def find_cutouts(plan: RenderPlan, prepared: Prepared) -> Cutouts | None:
    """Return what has holes in view; ``None`` if nothing has."""
    return prepared.looks.cutouts(plan.has_textured_holes) if plan.needs_cutouts else None


def find_sky(plan: RenderPlan) -> Sky | None:
    """Return the environment, if it is seen where no face is."""
    if plan.backdrop is None:
        return None
    rays = background_rays(plan.camera, plan.size)
    return Sky(rays, plan.size, backdrop_record(plan.backdrop), plan.corner)


def find_lighting(
    plan: RenderPlan,
    prepared: Prepared,
    geometry: Geometry,
    placement: Placement,
    coverage: stages.Coverage,
    workers: stages.Workers,
) -> Lighting | None:
    """Return the light of the plan, with what depends on what is visible; None without light."""
    lighting = plan.lighting
    if lighting is None:
        return None
    if plan.needs_microfacets:
        lighting = lighting._replace(microfacets=prepared.looks.microfacets)
    if plan.environment is not None:
        is_mirrored = plan.needs_microfacets
        environment = environment_record(plan.environment, is_mirrored, workers)
        lighting = lighting._replace(environment=environment)
    # Draw the shadow maps.
    if plan.casts_shadows:
        if plan.shadow_maps is not None:
            (shadows,) = plan.shadow_maps
        else:
            seen = see_receivers(plan, coverage, placement, workers)
            shadows = find_shadows(plan, prepared, placement, seen, workers)
        lighting = lighting._replace(shadows=shadows)
    # Find how much ambient light reaches each pixel.
    if plan.ambient_occlusion is not None:
        occlusion = screen_effects.find_occlusion(
            plan.ambient_occlusion, plan.camera, geometry, placement, coverage, workers
        )
        lighting = lighting._replace(occlusion=occlusion)
    return lighting


def see_receivers(
    plan: RenderPlan, coverage: stages.Coverage, placement: Placement, workers: stages.Workers
) -> shadow_cells.SeenDepth:
    """Return what shadow maps are fitted to, as far as the depth of a picture tells."""
    is_open = plan.layers is not None and not plan.layers.has_blended
    faces = int(placement.face_starts[-1]) if is_open else None
    return shadow_cells.see_depth(coverage, workers, faces)


def find_shadows(
    plan: RenderPlan,
    prepared: Prepared,
    placement: Placement,
    seen: shadow_cells.SeenDepth,
    workers: stages.Workers,
    more_cells: Sequence[NDArray[np.float64]] = (),
) -> Shadows | None:
    """
    Fit the shadow maps to what is seen and draw them; None if there is nothing to draw.

    ``more_cells``, (N, 8, 3) each, hold what is seen besides, see `shadow_cells.seen_cells`.
    """
    arrays = prepared.shapes.arrays
    grounds = plan.grounds
    # The vertices of an object are lit wherever they are.
    is_whole = plan.in_view & grounds.facts.is_gouraud
    # Behind glass, and between the centres of pixels, more is seen than the depth tells.
    is_open = plan.in_view & (plan.layers is not None)
    if plan.layers is not None and not plan.layers.has_blended:
        boxes = place_boxes(prepared.shapes.boxes, placement.relative_from_model)
        is_open &= shadow_cells.missed_objects(plan.camera, boxes, placement.face_starts, seen)
    vertices = stages.ModelVertices(
        arrays.positions, arrays.vertex_starts, placement.relative_from_model, np.eye(4)
    )
    cutouts = None
    if grounds.shades_through_holes:
        cutouts = prepared.looks.cutouts(grounds.contents.textured_holes > 0)
    scenery = shadow_maps.scenery_of(
        vertices, arrays.faces, placement, prepared.shapes.boxes, ~grounds.facts.is_see_through,
        is_whole, is_open,
        np.concatenate([shadow_cells.seen_cells(plan.camera, seen), *more_cells]),
        plan.camera, plan.size, cutouts,
    )  # fmt: skip
    lights = [light for light in plan.lights.lights if not isinstance(light, AmbientLight)]
    normals = prepared.looks.normals if plan.needs_normals else None
    eye = plan.camera.eye_position()
    return shadow_maps.draw_shadows(lights, eye, scenery, normals, workers)


def find_surface(
    plan: RenderPlan,
    prepared: Prepared,
    placement: Placement,
    lighting: Lighting | None,
    workers: stages.Workers,
) -> Surface:
    """Return what the objects look like, as far as the plan has a use for it."""
    looks = prepared.looks
    surface = looks.surface._replace(normals=looks.normals if plan.needs_normals else None)
    if plan.needs_gouraud and lighting is not None:
        light = prepared.shapes.arrays.vertex_starts, placement, surface
        # Vertices are lit without what is known of pixels.
        lighting = lighting._replace(occlusion=None)
        lit, matt = stages.light_vertices(*light, lighting, workers), None
        if plan.needs_matt_light:
            matt = stages.light_vertices(*light, lighting._replace(highlights=None), workers)
        surface = surface._replace(lit_vertices=lit, matt_vertices=matt)
    if plan.needs_textures:
        surface = surface._replace(textures=looks.textures)
    if plan.layers is not None and plan.layers.has_blended:
        surface = surface._replace(alphas=Alphas(plan.layers.is_blended))
    if plan.needs_maps:
        surface = surface._replace(maps=looks.maps)
    return surface


def draw_outline(
    plan: RenderPlan,
    geometry: Geometry,
    placement: Placement,
    coverage: stages.Coverage,
    result: dict[str, NDArray[Any]],
    workers: stages.Workers,
) -> None:
    """Draw the edges of shapes over the colour."""
    if plan.outline is not None:
        screen_effects.draw_outlines(
            plan.outline, plan.camera, geometry, placement, coverage, result["color"], workers
        )


def draw_wireframe(
    plan: RenderPlan,
    edges: NDArray[np.int32],
    geometry: Geometry,
    coefficients: tuple[float, float, float],
    coverage: stages.Coverage,
    result: dict[str, NDArray[Any]],
    workers: stages.Workers,
) -> None:
    """Draw the edges over the colour."""
    if plan.wireframe is None:
        return
    encoded = linear_to_srgb(np.array(plan.wireframe.color[:3]))
    rgba = np.append(np.floor(255.0 * encoded + 0.5), 255.0).astype(np.uint8)
    hidden_by = (coverage.face_id, coverage.reversed_depth) if plan.draws_faces else None
    lines = edges, geometry, coefficients, rgba, result["color"], hidden_by
    if plan.quality.lines == "bresenham":
        edge_lines.draw_edges(*lines, workers)
        return
    light = None if plan.quality.blending == "srgb8" else decoding_table().copy()
    edge_lines.cover_edges(*lines, light, workers)
