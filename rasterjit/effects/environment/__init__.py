"""
Environments: image-based lighting, and the background where no face is.

Two effects. The light adds diffuse irradiance (a polynomial of nine terms in the normal) and
specular reflections of microfacets (a panorama prefiltered for eight roughnesses) to lit samples.
The background is written to pixels without a face. The panorama is filtered on first use.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.environment import prefilter_stage
from rasterjit.effects.environment import stage as environment_stage
from rasterjit.effects.environment.prefilter import make_background_record, make_light_record
from rasterjit.effects.environment.stage import EnvironmentRecord
from rasterjit.effects.tone_map import get_tone
from rasterjit.effects.tone_map.stage import ToneRecord
from rasterjit.pipeline.passes import Pass, Rows, ShadingNeeds, rows_where
from rasterjit.pipeline.srgb_encoding import make_encoding_table
from rasterjit.runtime.threads import Workers
from rasterjit.scene.camera import Camera
from rasterjit.scene.environment import Environment
from rasterjit.scene.pixel_projection import clip_from_relative
from rasterjit.scene.scene import Scene
from rasterjit.survey.batched_views import ViewGroup
from rasterjit.survey.effect import (
    BatchedEffect,
    Calls,
    FrameContext,
    Planning,
    ViewArrays,
    with_field,
)
from rasterjit.survey.facts import Facts, explain_unlit
from rasterjit.survey.plan import RenderPlan

RAYS = "rays through the background"
"""Key of a view's rays in recorded calls."""


class Sky(NamedTuple):
    """The arguments of ``stage.show_environment`` for a frame."""

    rays: NDArray[np.float64]
    """(3, 3): direction at the middle of the frame, and its change with x and y."""
    size: tuple[int, int]
    """Width and height of the whole frame, pixels."""
    environment: EnvironmentRecord
    tone: ToneRecord
    corner: tuple[int, int] = (0, 0)
    """Column and row of the first pixel that is drawn, in the whole frame."""

    def show(
        self,
        calls: Calls,
        face_id: NDArray[np.int32],
        first_row: int,
        linear: NDArray[np.float32],
        color: NDArray[np.uint32],
    ) -> None:
        """
        Write the environment to the pixels of some rows that show no face.

        Parameters
        ----------
        calls : Calls
        face_id : (R, W) int32
        first_row : int
            Of these rows, in the part that is drawn.
        linear : (R, W, 4) float32, or (R, 0, 4)
        color : (R, W) uint32, or (R, 0)
            Written.
        """
        left, top = self.corner
        calls.call(
            environment_stage.show_environment, face_id, (left, top + first_row), self.rays,
            self.size, self.environment, self.tone, make_encoding_table(), linear, color,
        )  # fmt: skip


def compute_background_rays(camera: Camera, size: tuple[int, int]) -> NDArray[np.float64]:
    """
    Return the rays of a camera's pixels, (3, 3) float64, in world axes.

    Row 0 is the direction at the middle of the frame, rows 1 and 2 its change with x and y in
    normalized device coordinates; see ``stage.sample_environment``. Only their ratios matter.
    """
    return compute_rays(clip_from_relative(camera, size))


def compute_rays(clip: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `compute_background_rays` of ``clip_from_relative``, with zeros of any sign."""
    with np.errstate(all="ignore"):
        rows = (clip[:, :3] + 0.0) / np.abs(clip[[0, 1, 3], :3]).max()
    x, y, depth, w = rows.tolist()
    middle = _cross(x, y)
    if any(w):
        rays = [middle, _cross(y, w), _cross(w, x)]
        forward = w
    else:
        # All rays of a parallel projection have the direction in which depth grows.
        rays = [middle, [0.0] * 3, [0.0] * 3]
        forward = depth
    toward = (forward[0] * middle[0] + forward[1] * middle[1]) + forward[2] * middle[2]
    return np.array(rays) * math.copysign(1.0, toward)


def _cross(a: Any, b: Any) -> list[float]:
    """Return the cross product of two vectors."""
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


class BackgroundOnly(Environment):
    """An environment that is only a background, without light."""

    lights = False


class EnvironmentLight(BatchedEffect):
    """Light samples by an environment."""

    name = "environment light"
    key = "v"
    term = "environment"
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why no requested colour is lit by the environment."""
        if facts.environment is None:
            return "scene.environment is None"
        if not facts.is_lit:
            return explain_unlit(facts)
        return "" if facts.environment.lights else "the environment is black"

    def plan_data(self, facts: Facts, planning: Planning) -> Environment | None:
        """Return the environment."""
        return facts.environment

    def describe(self, facts: Facts) -> str:
        """Say what the environment is, and whether surfaces reflect it."""
        mirrored = ", mirrored by pbr" if facts.visible.pbr else ""
        return f"{facts.fields['environment'].described}{mirrored}"

    def prepare(
        self, context: FrameContext, data: Environment, seen: Sequence[Any]
    ) -> EnvironmentRecord:
        """Return the environment, filtered for reflections where any object has them."""
        return make_light_record(data, context.plan.facts.needs_microfacets, context.workers)

    def prepare_batch(
        self, plan: RenderPlan, data: Environment, view_arrays: ViewArrays
    ) -> EnvironmentRecord:
        """Return the environment, the same for all views."""
        return make_light_record(data, plan.facts.needs_microfacets, Workers(1))

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that filter a panorama."""
        used = "a panorama is used for the first time"
        module = prefilter_stage
        kernels = module.average_columns, module.add_ring, module.project_rows
        return {"prepare": rows_where(used, *kernels)}

    def neutral(self, record: EnvironmentRecord) -> EnvironmentRecord:
        """Return an environment without light."""
        return record._replace(intensity=np.float32(0.0))

    def without(self, scene: Scene) -> Scene:
        """Return the scene with its environment shown but dark, so that no headlight is added."""
        environment = scene.environment
        if environment is None:
            return scene
        alone = BackgroundOnly(
            environment.sky, environment.intensity, environment.rotation, environment.background
        )
        return with_field(scene, "environment", alone)

    @staticmethod
    def add_light(environment: EnvironmentRecord, needs: ShadingNeeds) -> list[Pass]:
        """Return the passes that add irradiance, and reflections for microfacets."""
        light_pass = Pass(
            environment_stage.add_sky,
            lambda _: (environment.irradiance, environment.yaw, environment.intensity),
        )
        if not needs.microfacets:
            return [light_pass]
        reflection_pass = Pass(environment_stage.add_reflections, lambda a: (environment, a.viewer))
        if not needs.layers:
            return [light_pass, reflection_pass]
        from rasterjit.pipeline.lighting import layered_materials

        return [
            light_pass,
            *layered_materials.list_ambient_passes(needs, reflection_pass, light_pass),
        ]

    places: ClassVar = {"around": add_light}


class EnvironmentBackground(BatchedEffect):
    """Show the environment where no face is."""

    name = "environment background"
    key = "b"
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why the environment is not shown."""
        if facts.environment is None:
            return "scene.environment is None"
        if not facts.is_colored:
            return "no output shows colour"
        if facts.has_background:
            return "the render was given a background"
        return "" if facts.environment.background else "its background is False"

    def plan_data(self, facts: Facts, planning: Planning) -> Environment | None:
        """Return the environment."""
        return facts.environment

    def describe(self, facts: Facts) -> str:
        """Say where the environment is shown."""
        return "where no face is"

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernel that writes the background."""
        return {"background": rows_where("", environment_stage.show_environment)}

    def prepare(self, context: FrameContext, data: Environment, seen: Sequence[Any]) -> Sky:
        """Return the environment as the background of this picture."""
        plan = context.plan
        rays = compute_background_rays(plan.camera, plan.size)
        return Sky(rays, plan.size, make_background_record(data), get_tone(plan), plan.corner)

    def prepare_batch(self, plan: RenderPlan, data: Environment, view_arrays: ViewArrays) -> Sky:
        """Return the environment as the background of each view."""
        return Sky(
            view_arrays(RAYS, (3, 3), np.float64), plan.size, make_background_record(data),
            get_tone(plan),
        )  # fmt: skip

    def compute_view_arrays(self, scene: Scene, group: ViewGroup) -> dict[str, NDArray[np.float64]]:
        """Return the rays of each view."""
        if scene.environment is None or not scene.environment.background:
            return {}
        return {RAYS: np.array([compute_rays(clip) for clip in group.views.clip_from_relative])}

    def without(self, scene: Scene) -> Scene:
        """Return the scene with an environment that is not shown."""
        around = scene.environment
        unseen = None if around is None else replace(around, background=False)
        return with_field(scene, "environment", unseen)

    places: ClassVar = {"background": Sky.show}


LIGHT = EnvironmentLight()
BACKGROUND = EnvironmentBackground()
