"""
List the stages of a frame before it is drawn.

Calls the functions that list the stages of a real frame with nearly empty records: each field is
present exactly if it will be when the frame is drawn. So the list is that of the frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.encode import encoding_table
from rasterjit.pipeline.records import (
    MATERIAL_MODEL,
    Fields,
    Geometry,
    Layers,
    Levels,
    Lighting,
    Maps,
    Microfacets,
    Placement,
    Surface,
    Textures,
    Through,
    Viewport,
)
from rasterjit.pipeline.surface import textures
from rasterjit.pipeline.surface.listing import list_samples
from rasterjit.rendering import shade, stage_list, supersample
from rasterjit.runtime.driver import Step
from rasterjit.scene.material import SHADINGS
from rasterjit.survey.effect import Active
from rasterjit.survey.plan import RenderPlan


class StageTold(NamedTuple):
    """A stage that shades samples."""

    name: str
    """Module and function."""
    reads: tuple[str, ...]
    """What it reads besides the block of samples."""


def list_stages(plan: RenderPlan) -> tuple[StageTold, ...]:
    """
    Return the stages that shade the samples of a frame, in order.

    Those of vertices come first; those that shadows call for run if a map is drawn.
    """
    if not plan.facts.is_colored:
        return ()
    if plan.pictures > 1:
        plan = supersample.plan_picture(plan, {})
    if plan.layers is None and not plan.facts.draws_faces and not plan.at("background"):
        # All pixels are alike.
        return ()
    if plan.mixes_plain_codes:
        return ()
    return tuple(
        StageTold(f"{short_name(step.stage.__module__)}.{step.stage.__name__}", step.stage.names)
        for step in _steps(plan)
    )


def short_name(module: str) -> str:
    """Return how a plan names a module: the last part of its name, or its folder's."""
    parts = module.split(".")
    return parts[-2] if parts[-1] == "stage" else parts[-1]


def _steps(plan: RenderPlan) -> list[Step]:
    """Return the stages of vertices, of surfaces and lights, and of what becomes of colours."""
    effects = tuple(
        Active(one.effect, one.effect.sketch(plan.facts, one.data))
        for one in plan.planned
        if one.effect.places
    )
    placement, empty, steps = _placement(), np.empty((0, 4), np.float32), []

    def light(surface: Surface, lighting: Lighting) -> NDArray[np.float32]:
        listed = (0, 0), np.zeros(1, np.int64)
        steps.extend(stage_list.vertex_steps(listed, placement, surface, lighting, effects, empty))
        return empty

    surface = shade.find_surface(plan, _tables(plan))
    surface = shade.light_surface(plan, surface, plan.lighting, light)
    if plan.facts.shades_points:
        surface = surface._replace(points=(None, None, None))
    own = _geometry(plan), placement, surface, plan.lighting
    shading, shown = stage_list.shading_steps(*own, effects)
    steps += [Step(list_samples, ()), *shading]
    return steps + _output_steps(plan, surface, shown, effects)


def _output_steps(
    plan: RenderPlan, surface: Surface, shown: int, effects: Sequence[Active]
) -> list[Step]:
    """Return the stages that write colours, or mix them."""
    layers, steps = plan.layers, []
    has_linear, has_color = "linear" in plan.outputs, "color" in plan.outputs
    if layers is not None:
        has_linear, has_color = not layers.mixes_codes, layers.mixes_codes
        if layers.samples != 1:
            own = surface, shown, encoding_table(), effects
            steps = stage_list.mixing_steps(*own, layers.mixes_codes, ())
            if not layers.has_blended:
                return steps
    linear, color = np.empty((0, int(has_linear), 4)), np.empty((0, int(has_color)))
    table = encoding_table()
    return steps + stage_list.output_steps(surface, shown, table, effects, linear, color)


def _geometry(plan: RenderPlan) -> Geometry:
    """Return a geometry of no faces, with samples at the centres of pixels or beside them."""
    layers = plan.layers
    is_beside = layers is not None and layers.samples != 1 and not layers.at_centers
    viewport = Viewport(0, 0, 0.0, 0.0, 0, 0, reach=int(is_beside))
    w = np.empty(0 if plan.is_affine else 1)
    none = np.empty((0, 3), np.int32)
    return Geometry(none, none[:, :2], np.empty(0, np.uint8), w, np.empty((0, 4)), viewport)


def _placement() -> Placement:
    """Return where no objects stand."""
    none = np.empty(0)
    return Placement(
        np.zeros(1, np.int64), np.empty((0, 3)), np.empty((0, 3, 4)), np.empty((0, 3, 3)), none,
        none, np.zeros(4),
    )  # fmt: skip


class _Tables(NamedTuple):
    """What the objects of a scene look like, as `MaterialTables` tells."""

    surface: Surface
    normals: NDArray[np.float32]
    textures: Textures
    microfacets: Microfacets
    layers: Layers
    maps: Maps
    fields: Fields
    through: Through


def _tables(plan: RenderPlan) -> _Tables:
    """Return a material for each way of shading, with all that any object has."""
    contents, empty = plan.facts.contents, np.empty((0, 4), np.float32)
    counts = np.array([*contents.textured.values()])
    models = [n for n, name in enumerate(SHADINGS) if name in contents.shadings]
    materials = np.zeros((len(models), MATERIAL_MODEL + 1), np.float32)
    materials[:, MATERIAL_MODEL] = models
    surface = Surface(
        materials=materials,
        vertex_colors=empty if contents.vertex_colored else None,
        face_colors=empty if contents.face_colored else None,
        normals=None,
        lit_vertices=None,
        diffuse_vertices=None,
        textures=None,
    )
    apart = [empty[:, :2] if one else None for one in plan.facts.inventory.kinds_apart]
    maps, microfacets = Maps(empty, counts, empty, apart), Microfacets(empty[:, :2], np.ones(2))
    none = np.empty((0, 2), np.int64)
    lines = Levels(np.empty(0), none, empty) if contents.contoured else None
    fields = Fields(np.empty(0), np.empty((0, 2)), none, empty, lines)
    layers = Layers(empty, empty, empty, empty, empty, empty, empty)
    own = _textures(plan), microfacets, layers, maps, fields
    return _Tables(surface, empty[:, :3], *own, Through(empty, empty))


def _textures(plan: RenderPlan) -> Textures:
    """Return textures without texels: one row that has each kind that any object has."""
    contents = plan.facts.contents
    counts = np.array([*contents.textured.values()])
    table = np.zeros((1, textures.KINDS, textures.TABLE_COLUMNS), np.int64)
    table[0, :, textures.FIRST_LEVEL] = np.where(counts > 0, 0, -1)
    table[0, :, textures.FILTER] = textures.TRILINEAR if contents.mipped else textures.NEAREST
    none = np.empty((0, 4), np.float32)
    levels, transforms = np.empty((0, 3), np.int64), np.empty((0, textures.KINDS, 6))
    return Textures(none, levels, table, none[:, :2], transforms)
