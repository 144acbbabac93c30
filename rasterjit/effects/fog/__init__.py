"""
Fog by distance, and by height.

A frame has fog where a face in view is shaded and the fog begins before the farthest of them. It is
applied to each sample after lighting, and costs about a tenth of shading.
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.fog import stage as fog_stage
from rasterjit.pipeline.passes import Pass, ShadingNeeds
from rasterjit.pipeline.surface import attributes
from rasterjit.scene.camera import Camera
from rasterjit.scene.fog import Fog
from rasterjit.scene.scene import Scene
from rasterjit.survey.batched_views import ViewGroup
from rasterjit.survey.effect import BatchedEffect, Planning, ViewArrays
from rasterjit.survey.facts import Facts, may_fog_cover
from rasterjit.survey.plan import RenderPlan

LOG2_E = 1.4426950408889634
"""One over ln 2."""

SQRT_LOG2_E = 1.2011224087864498
"""Square root of `LOG2_E`, for a density that is squared afterwards."""

MAX_FLOAT32 = float(np.finfo(np.float32).max)


class FogRecord(NamedTuple):
    """The fog of a frame."""

    fog: Fog
    eye_y: NDArray[np.float32]
    """(1,) scene units: height of the eye over where the fog has its density."""
    finds_points: bool
    """Whether samples may be lit at centroids, so that fog must compute their positions."""


def make_fog_record(fog: Fog, camera: Camera, has_flat: bool = False) -> FogRecord:
    """Return the fog's record, for a scene with or without objects shaded flat."""
    return FogRecord(fog, _find_heights(fog, np.array(camera.eye_position()[1:2])), has_flat)


def _find_heights(fog: Fog, eyes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the heights of eyes, (N,), above where the fog has its density; float32."""
    return np.clip(eyes - (fog.height or 0.0), -MAX_FLOAT32, MAX_FLOAT32).astype(np.float32)


class FogEffect(BatchedEffect):
    """Apply fog to lit samples."""

    name = "fog"
    field = "fog"
    key = "n"

    def unused_reason(self, facts: Facts) -> str:
        """Say why no requested colour has fog."""
        if facts.shades and facts.fog is None:
            is_thin = facts.fields[self.field].density == 0.0
            return "its density is 0" if is_thin else "it begins beyond everything"
        return "" if facts.shades else "no face is shaded"

    def describe(self, facts: Facts) -> str:
        """Say the fog's mode, and whether it depends on height."""
        fog = facts.fields[self.field]
        return f"mode {fog.mode}" + (", by height" if fog.height is not None else "")

    def plan_data(self, facts: Facts, planning: Planning) -> FogRecord:
        """Return the fog's record."""
        return make_fog_record(facts.fields[self.field], planning.camera, facts.visible.flat > 0)

    def decide_views(self, scene: Scene, group: ViewGroup) -> Any:
        """Return which views have something behind the fog's start."""
        return may_fog_cover(scene.fog, group)

    def prepare_batch(
        self, plan: RenderPlan, data: FogRecord, view_arrays: ViewArrays
    ) -> FogRecord:
        """Return the record, with the height of each view's eye."""
        return data._replace(eye_y=view_arrays("height above fog", (1,), np.float32))

    def compute_view_arrays(self, scene: Scene, group: ViewGroup) -> dict[str, NDArray[np.float32]]:
        """Return the heights of the eyes."""
        fog = scene.fog
        return {} if fog is None else {"height above fog": _find_heights(fog, group.eyes[:, 1])}

    def neutral(self, record: FogRecord) -> FogRecord:
        """Return fog without density."""
        return record._replace(fog=Fog(record.fog.color, "exp", density=0.0))

    @staticmethod
    def apply(record: FogRecord, needs: ShadingNeeds) -> list[Pass]:
        """Return the passes that apply fog."""
        fog, passes, color = record.fog, [], np.array(record.fog.color, np.float32)
        if record.finds_points:
            find = Pass(attributes.find_points, lambda a: (a.placement, a.surface.materials, 1))
            passes = [Pass(attributes.gather_positions, lambda a: (a.placement.positions,)), find]
        if fog.mode == "linear":
            start, end = fog.start or 0.0, fog.end or 0.0
            inv_range = 1.0 / (end - start) if end > start else 0.0
            linear = np.float32(end), np.float32(inv_range), color
            return [*passes, Pass(fog_stage.apply_linear_fog, lambda a: (*linear, a.viewer))]
        scale = SQRT_LOG2_E if fog.mode == "exp2" else LOG2_E
        density, falloff = (fog.density or 0.0) * scale, (fog.falloff or 0.0) * LOG2_E
        exp = np.float32(density), np.float32(fog.mode == "exp2"), record.eye_y, np.float32(falloff)
        return [*passes, Pass(fog_stage.apply_exp_fog, lambda a: (*exp, color, a.viewer))]

    places: ClassVar = {"sample": apply}


FOG = FogEffect()
