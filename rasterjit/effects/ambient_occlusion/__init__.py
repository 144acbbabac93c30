"""
Screen-space ambient occlusion: dim ambient light in corners and creases.

A frame has occlusion where ambient light falls on objects lit per pixel. Visibility is computed
once per picture from the depth buffer; a sample reads that of its pixel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.ambient_occlusion import stage
from rasterjit.pipeline.geometry.unproject_matrix import SNAP_SLACK_UNITS, build_unprojection_matrix
from rasterjit.pipeline.passes import Pass, Rows, ShadingNeeds, fixed, rows_where
from rasterjit.runtime.threads import rows_per_task
from rasterjit.scene.ambient_occlusion import DEFAULT_RADIUS_RATIO, AmbientOcclusion
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.batched_views import ViewGroup
from rasterjit.survey.effect import (
    BatchedEffect,
    FrameContext,
    Planning,
    ScreenEffect,
    add_to_field,
)
from rasterjit.survey.facts import Facts, explain_unlit
from rasterjit.survey.plan import RenderPlan

MATRIX = "unprojection for occlusion"
"""Key of a view's unprojection matrix in recorded calls: see `Occlusion.compute_view_arrays`."""


def find_occlusion(effect: AmbientOcclusion, context: FrameContext) -> NDArray[np.float32]:
    """
    Compute the visibility of ambient light at each pixel, (H, W), 0..1.

    Parameters
    ----------
    effect : AmbientOcclusion
        With a radius.
    context : FrameContext
        With the visible faces, and their reversed depth.
    """
    geometry, coverage, workers = context.seen.geometry, context.seen.coverage, context.workers
    face_id, depth, empty = coverage.face_id, coverage.reversed_depth, workers.memory.empty
    height, width = face_id.shape
    matrix = context.per_view(
        MATRIX, build_unprojection_matrix(context.plan.camera, (width, height), effect.radius)
    )
    snap_slack = math.ldexp(SNAP_SLACK_UNITS, -geometry.viewport.subpixel_bits)
    pattern = stage.make_screen_pattern()
    rough, tolerance = empty(face_id.shape, np.float32), empty(face_id.shape, np.float32)
    smooth = empty(face_id.shape, np.float32)
    per_task = rows_per_task(face_id.shape, workers)
    bands = [(n, min(n + per_task, height)) for n in range(0, height, per_task)]
    shared = geometry, context.placement, matrix, snap_slack, pattern, rough, tolerance
    # Keep bound kernels alive while others call them.
    bound, scratches = zip(*(stage.make_scratch(depth, matrix) for _ in bands), strict=True)
    workers.keep_alive(bound)
    calls = [
        (face_id, rows, depth, *shared, scratch)
        for rows, scratch in zip(bands, scratches, strict=True)
    ]
    workers.run(stage.find_occlusion, calls)
    for source, first, strength, target in (
        (rough, -2, 1.0, smooth), (smooth, -1, effect.strength, rough),
    ):  # fmt: skip
        rest = first, depth, tolerance, strength, target
        passes = [(source, rows, *rest, np.empty((2, width), np.float32)) for rows in bands]
        workers.run(stage.smooth_occlusion, passes)
    return rough


def get_radius(effect: AmbientOcclusion, scene: Scene) -> float:
    """Return the radius of a scene's ambient occlusion, scene units."""
    if effect.radius is not None:
        return effect.radius
    _, radius = scene.bounding_sphere()
    # A scene of one point has no size; nothing occludes there.
    return DEFAULT_RADIUS_RATIO * radius if radius > 0.0 else 1.0


class Occlusion(ScreenEffect, BatchedEffect):
    """Dim ambient light in corners and creases."""

    name = "ambient occlusion"
    field = "ambient_occlusion"
    key = "o"
    joins_faces = True

    def plan_data(self, facts: Facts, planning: Planning) -> AmbientOcclusion:
        """Return the effect, with a radius."""
        effect = facts.fields[self.field]
        return replace(effect, radius=get_radius(effect, planning.scene))

    def unused_reason(self, facts: Facts) -> str:
        """Say why no ambient light falls on faces lit pixel by pixel, or is not dimmed."""
        if facts.fields[self.field].strength == 0.0:
            return "its strength is 0"
        if not facts.is_lit:
            return explain_unlit(facts)
        if not facts.visible.shadings - {"unlit", "gouraud"}:
            return "what is lit is lit at its vertices"
        return "" if facts.has_ambient_light else "no light comes from all around"

    def describe(self, facts: Facts) -> str:
        """Say in what radius, and how much, ambient light is dimmed."""
        effect = facts.fields[self.field]
        radius = "a share of the scene's size" if effect.radius is None else f"{effect.radius:g}"
        return f"radius {radius}, strength {effect.strength:g}"

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Return True: occlusion reads the depths around each pixel."""
        return True

    def prepare(
        self, context: FrameContext, data: AmbientOcclusion, seen: Sequence[Any]
    ) -> NDArray[np.float32]:
        """Return the visibility of ambient light at each pixel, (H, W) float32."""
        return find_occlusion(data, context)

    def compute_view_arrays(self, scene: Scene, group: ViewGroup) -> dict[str, NDArray[Any]]:
        """Return the cameras' unprojection matrices, in radii."""
        if scene.ambient_occlusion is None:
            return {}
        radii = [get_radius(scene.ambient_occlusion, one) for one in group.scenes()]
        return {MATRIX: group.lens_matrices(radii)}

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that compute and smooth occlusion."""
        kernels = stage.find_occlusion, stage.trace_horizons, stage.smooth_occlusion
        return {"prepare": rows_where("", *kernels)}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the images that occlusion is computed in."""
        return [("ambient occlusion, smooth, rough and its range", 3, "float32", plan.size)]

    def neutral(self, record: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return a visibility of 1 for each pixel."""
        return np.ones_like(record)

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Return the scene with ambient occlusion."""
        return "on", add_to_field(scene, self.field, AmbientOcclusion())

    @staticmethod
    def dim(occlusion: NDArray[np.float32], needs: ShadingNeeds) -> list[Pass]:
        """Return the stage that multiplies row OCCLUSION."""
        return [fixed(stage.occlude_samples, occlusion)]

    places: ClassVar = {"rows": dim}


AMBIENT_OCCLUSION = Occlusion()
