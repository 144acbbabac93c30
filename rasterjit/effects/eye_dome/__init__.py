"""
Eye-dome lighting: darken pixels that lie behind their neighbours.

A frame has eye-dome lighting where faces are shaded, lit or not. The shading is computed once per
picture from the depth buffer; a sample reads that of its pixel. No positions or normals are needed;
it costs a few nanoseconds a pixel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.eye_dome import stage as eye_dome_stage
from rasterjit.pipeline.passes import Pass, Rows, fixed, rows_where
from rasterjit.runtime.threads import Workers, split_into_bands
from rasterjit.scene.camera import Camera
from rasterjit.scene.eye_dome import EyeDome
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import FrameContext, ScreenEffect, add_to_field
from rasterjit.survey.facts import Facts, explain_unlit
from rasterjit.survey.plan import RenderPlan

LN_2 = 0.6931471805599453

LOG_GAIN = 300.0
"""Usual factor of the mean of the logarithms."""

NEIGHBOUR_DIRECTIONS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""To the 8 neighbours: columns to the right, rows down."""

VIEW_HEIGHT_PER_DISTANCE = 2.0 * (math.sqrt(2.0) - 1.0)
"""Height of a view of 45 degrees over its distance, assumed for parallel projections."""


def list_neighbour_offsets(radius: float) -> NDArray[np.int64]:
    """Return the offsets of the 8 neighbours to the right and down, (8, 2) pixels."""
    straight = math.floor(radius + 0.5)
    slant = math.floor(radius * math.sqrt(0.5) + 0.5)
    lengths = [slant if x and y else straight for x, y in NEIGHBOUR_DIRECTIONS]
    return np.array(NEIGHBOUR_DIRECTIONS, np.int64) * np.array(lengths, np.int64)[:, np.newaxis]


def is_perspective(camera: Camera) -> bool:
    """Tell whether the stored depth is one over the distance from an eye."""
    return camera.depth_coefficients()[0] != 0.0


def compute_nearness_per_depth(camera: Camera, size: tuple[int, int]) -> float:
    """Return the change of nearness per unit of a parallel projection's stored depth."""
    _, vertical, along, _ = np.asarray(camera.projection_matrix(size)).tolist()
    height, depth = (2.0 / math.sqrt(x * x + y * y + z * z) for x, y, z, _ in (vertical, along))
    return depth * VIEW_HEIGHT_PER_DISTANCE / (height * LN_2)


def compute_shading(
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
    bands = [(rows,) for rows in split_into_bands(depth.shape, workers)]
    nearness = workers.memory.empty(depth.shape, np.float32)
    if is_perspective(camera):
        workers.run(lambda rows: eye_dome_stage.compute_nearness(depth, rows, nearness), bands)
    else:
        np.multiply(depth, np.float32(compute_nearness_per_depth(camera, size)), out=nearness)
    shading = workers.memory.empty(depth.shape, np.float32)
    offsets = list_neighbour_offsets(effect.radius)
    factor = np.float32(LOG_GAIN * effect.strength / (len(offsets) * LN_2))

    def find_band(rows: tuple[int, int]) -> None:
        total = np.empty(depth.shape[1], np.float32)
        eye_dome_stage.compute_shading(nearness, rows, offsets, factor, shading, total)

    workers.run(find_band, bands)
    return shading


class EyeDomeLighting(ScreenEffect):
    """Darken pixels that lie behind their neighbours."""

    name = "eye-dome lighting"
    field = "eye_dome"
    key = "y"
    joins_faces = True
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why pixels behind their neighbours are not darkened."""
        if facts.fields[self.field].strength == 0.0:
            return "its strength is 0"
        return "" if facts.shades else explain_unlit(facts)

    def describe(self, facts: Facts) -> str:
        """Say how much pixels behind their neighbours are darkened."""
        effect = facts.fields[self.field]
        return f"strength {effect.strength:g}, radius {effect.radius:g}"

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Return True: the shading reads the depths around each pixel."""
        return True

    def read_radius(self, data: EyeDome) -> int:
        """Return how far away its neighbours are, pixels."""
        return int(list_neighbour_offsets(data.radius).max())

    def prepare(
        self, context: FrameContext, data: EyeDome, seen: Sequence[Any]
    ) -> NDArray[np.float32]:
        """Return the share of its light that each pixel keeps, (H, W) float32."""
        plan, depth = context.plan, context.seen.coverage.reversed_depth
        return compute_shading(data, plan.camera, plan.size, depth, context.workers)

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that compute the shading."""
        kernels = [eye_dome_stage.compute_nearness] if is_perspective(plan.camera) else []
        return {"prepare": rows_where("", *kernels, eye_dome_stage.compute_shading)}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the images that the shading is computed in."""
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
