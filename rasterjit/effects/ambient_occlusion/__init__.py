"""
Screen-space ambient occlusion: dim ambient light in corners and creases.

A frame has it where ambient light falls on objects lit per pixel. It is computed once per picture
from the depth buffer; a sample reads that of its pixel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.ambient_occlusion import stage as ambient_occlusion_stage
from rasterjit.pipeline.geometry.unproject_matrix import SNAP_SLACK, lens_of
from rasterjit.pipeline.passes import Pass, Rows, ShadingNeeds, fixed, rows_where
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.runtime.threads import Workers, rows_per_task
from rasterjit.scene.ambient_occlusion import RADIUS_OF_SCENE, AmbientOcclusion
from rasterjit.scene.camera import Camera
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import FrameContext, LooksAround, Planning, add_to_field
from rasterjit.survey.facts import Facts, unlit_reason
from rasterjit.survey.plan import RenderPlan


def find_occlusion(
    effect: AmbientOcclusion,
    camera: Camera,
    geometry: Geometry,
    placement: Placement,
    coverage: visibility_pass.Coverage,
    workers: Workers,
) -> NDArray[np.float32]:
    """
    Return the share of ambient light that reaches each pixel, (H, W), 0..1.

    Parameters
    ----------
    effect : AmbientOcclusion
        With a radius.
    camera : Camera
    geometry, placement, coverage
        Of the visible faces; with its reversed depth.
    workers : Workers
    """
    face_id, depth, empty = coverage.face_id, coverage.reversed_depth, workers.memory.empty
    height, width = face_id.shape
    lens = lens_of(camera, (width, height), effect.radius)
    snap = math.ldexp(SNAP_SLACK, -geometry.viewport.subpixel_bits)
    pattern = ambient_occlusion_stage.screen_pattern()
    rough, tolerance = empty(face_id.shape, np.float32), empty(face_id.shape, np.float32)
    smooth = empty(face_id.shape, np.float32)
    per_task = rows_per_task(face_id.shape, workers)
    bands = [((n, min(n + per_task, height)),) for n in range(0, height, per_task)]

    def find_band(rows: tuple[int, int]) -> None:
        # Keep the bound kernel alive while the other calls it.
        _bound, scratch = ambient_occlusion_stage.scratch_of(depth, lens)
        ambient_occlusion_stage.find_occlusion(
            face_id, rows, depth, geometry, placement, lens, snap, pattern, rough, tolerance,
            scratch,
        )  # fmt: skip

    def smooth_band(rows: tuple[int, int]) -> None:
        scratch = np.empty((2, width), np.float32)
        ambient_occlusion_stage.smooth_occlusion(
            rough, rows, -2, depth, tolerance, 1.0, smooth, scratch
        )

    def finish_band(rows: tuple[int, int]) -> None:
        scratch = np.empty((2, width), np.float32)
        ambient_occlusion_stage.smooth_occlusion(
            smooth, rows, -1, depth, tolerance, effect.strength, rough, scratch
        )

    for task in (find_band, smooth_band, finish_band):
        workers.run(task, bands)
    return rough


def sized_occlusion(effect: AmbientOcclusion, scene: Scene) -> AmbientOcclusion:
    """Return a scene's ambient occlusion, with a radius in scene units."""
    if effect.radius is not None:
        return effect
    _, radius = scene.bounding_sphere()
    # A scene of one point has no size; nothing occludes there.
    return replace(effect, radius=RADIUS_OF_SCENE * radius if radius > 0.0 else 1.0)


class Occlusion(LooksAround):
    """Dim the light from all around."""

    name = "ambient occlusion"
    field = "ambient_occlusion"
    key = "o"
    joins_faces = True

    def decide(self, facts: Facts, planning: Planning) -> AmbientOcclusion:
        """Return it, with a radius."""
        return sized_occlusion(facts.asked[self.field], planning.scene)

    def why_not(self, facts: Facts) -> str:
        """Say why no ambient light falls on faces lit pixel by pixel, or is not dimmed."""
        if facts.asked[self.field].strength == 0.0:
            return "its strength is 0"
        if not facts.is_lit:
            return unlit_reason(facts)
        if not facts.seen.shadings - {"unlit", "gouraud"}:
            return "what is lit is lit at its vertices"
        return "" if facts.has_ambient_light else "no light comes from all around"

    def describe(self, facts: Facts) -> str:
        """Say how far around corners ambient light is dimmed."""
        effect = facts.asked[self.field]
        radius = "a share of the scene's size" if effect.radius is None else f"{effect.radius:g}"
        return f"radius {radius}, strength {effect.strength:g}"

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Tell that it looks at depths around each pixel."""
        return True

    def prepare(
        self, context: FrameContext, data: AmbientOcclusion, seen: Sequence[Any]
    ) -> NDArray[np.float32]:
        """Return the share of ambient light that reaches each pixel, (H, W) float32."""
        camera, seen = context.plan.camera, context.seen
        own = seen.geometry, context.placement, seen.coverage, context.workers
        return find_occlusion(data, camera, *own)

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that find and smooth it."""
        own = ambient_occlusion_stage
        kernels = own.find_occlusion, own.look_around, own.smooth_occlusion
        return {"prepare": rows_where("", *kernels)}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return what it is found in."""
        return [("ambient occlusion, smooth, rough and its range", 3, "float32", plan.size)]

    def neutral(self, record: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return shares that let all light through."""
        return np.ones_like(record)

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Return the scene with ambient occlusion."""
        return "on", add_to_field(scene, self.field, AmbientOcclusion())

    @staticmethod
    def dim(occlusion: NDArray[np.float32], needs: ShadingNeeds) -> list[Pass]:
        """Return the stage that multiplies row OCCLUSION."""
        return [fixed(ambient_occlusion_stage.occlude_samples, occlusion)]

    places: ClassVar = {"rows": dim}


AMBIENT_OCCLUSION = Occlusion()
