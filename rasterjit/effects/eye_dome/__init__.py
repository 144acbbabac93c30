"""
Eye-dome lighting: darken pixels that lie behind their neighbours.

A frame has it where faces are shaded, lit or not. It is computed once per picture from the depth
buffer; a sample reads that of its pixel. It needs no positions or normals, and costs a few
nanoseconds a pixel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.eye_dome import stage as eye_dome_stage
from rasterjit.pipeline.passes import Pass, Rows, fixed, rows_where
from rasterjit.runtime.threads import Workers, rows_per_task
from rasterjit.scene.camera import Camera
from rasterjit.scene.eye_dome import EyeDome
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import FrameContext, ScreenEffect, add_to_field
from rasterjit.survey.facts import Facts, explain_unlit
from rasterjit.survey.plan import RenderPlan

LN_2 = 0.6931471805599453

GAIN = 300.0
"""What the mean of the logarithms is multiplied by, as is usual."""

DIRECTIONS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Where neighbours lie: to the right and down."""

FIELD_OF_VIEW = 2.0 * (math.sqrt(2.0) - 1.0)
"""Height of a view of 45 degrees over its distance, assumed for parallel projections."""


def neighbour_offsets(radius: float) -> NDArray[np.int64]:
    """Return how far to the right and down the 8 neighbours lie, (8, 2) pixels."""
    straight = math.floor(radius + 0.5)
    slant = math.floor(radius * math.sqrt(0.5) + 0.5)
    lengths = [slant if x and y else straight for x, y in DIRECTIONS]
    return np.array(DIRECTIONS, np.int64) * np.array(lengths, np.int64)[:, np.newaxis]


def is_perspective(camera: Camera) -> bool:
    """Tell whether the stored depth is one over the distance from an eye."""
    return camera.depth_coefficients()[0] != 0.0


def nearness_of_depth(camera: Camera, size: tuple[int, int]) -> float:
    """Return by how much nearness grows with the stored depth of a parallel projection."""
    _, vertical, along, _ = np.asarray(camera.projection_matrix(size)).tolist()
    height, depth = (2.0 / math.sqrt(x * x + y * y + z * z) for x, y, z, _ in (vertical, along))
    return depth * FIELD_OF_VIEW / (height * LN_2)


def find_shading(
    effect: EyeDome,
    camera: Camera,
    size: tuple[int, int],
    depth: NDArray[np.float32],
    workers: Workers,
) -> NDArray[np.float32]:
    """
    Return the share of its light that each pixel keeps, (H, W), 0..1.

    Parameters
    ----------
    effect : EyeDome
    camera : Camera
    size : (int, int)
        Of the whole picture, pixels.
    depth : (H, W) float32
        Reversed depth of the picture, or of a part of it.
    workers : Workers
    """
    height, width = depth.shape
    per_task = rows_per_task(depth.shape, workers)
    bands = [((n, min(n + per_task, height)),) for n in range(0, height, per_task)]
    nearness = workers.memory.empty(depth.shape, np.float32)
    if is_perspective(camera):
        workers.run(lambda rows: eye_dome_stage.find_nearness(depth, rows, nearness), bands)
    else:
        np.multiply(depth, np.float32(nearness_of_depth(camera, size)), out=nearness)
    shading, offsets = (
        workers.memory.empty(depth.shape, np.float32),
        neighbour_offsets(effect.radius),
    )
    factor = np.float32(GAIN * effect.strength / (len(offsets) * LN_2))

    def find_band(rows: tuple[int, int]) -> None:
        total = np.empty(width, np.float32)
        eye_dome_stage.find_shading(nearness, rows, offsets, factor, shading, total)

    workers.run(find_band, bands)
    return shading


class EyeDomeLighting(ScreenEffect):
    """Darken what lies behind its neighbours."""

    name = "eye-dome lighting"
    field = "eye_dome"
    key = "y"
    joins_faces = True
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why what lies behind is not darkened."""
        if facts.fields[self.field].strength == 0.0:
            return "its strength is 0"
        return "" if facts.shades else explain_unlit(facts)

    def describe(self, facts: Facts) -> str:
        """Say how much what lies behind is darkened."""
        effect = facts.fields[self.field]
        return f"strength {effect.strength:g}, radius {effect.radius:g}"

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Tell that it looks at depths around each pixel."""
        return True

    def read_radius(self, data: EyeDome) -> int:
        """Return how far away its neighbours are, pixels."""
        return int(neighbour_offsets(data.radius).max())

    def prepare(
        self, context: FrameContext, data: EyeDome, seen: Sequence[Any]
    ) -> NDArray[np.float32]:
        """Return the share of its light that each pixel keeps, (H, W) float32."""
        plan, depth = context.plan, context.seen.coverage.reversed_depth
        return find_shading(data, plan.camera, plan.size, depth, context.workers)

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that compute it."""
        kernels = [eye_dome_stage.find_nearness] if is_perspective(plan.camera) else []
        return {"prepare": rows_where("", *kernels, eye_dome_stage.find_shading)}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the pictures that it is computed in."""
        return [("nearness and what it leaves of light", 2, "float32", plan.size)]

    def neutral(self, record: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return a shading of 1 for each pixel."""
        return np.ones_like(record)

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Return the scene with the usual eye-dome lighting."""
        return "on", add_to_field(scene, self.field, EyeDome())

    @staticmethod
    def darken(shading: NDArray[np.float32], first: int) -> list[Pass]:
        """Return the stage that multiplies three rows of colours."""
        return [fixed(eye_dome_stage.darken_samples, shading, first)]

    places: ClassVar = {"seen": darken}


EYE_DOME = EyeDomeLighting()
