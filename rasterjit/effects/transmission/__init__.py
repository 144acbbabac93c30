"""
Transmission: refraction through glass (``KHR_materials_transmission``).

A frame has transmission where a metallic-roughness material in view transmits light. An opaque pass
then comes first, without transmitting and blended objects, in linear light; transmitting samples
read the pass where the refracted ray leaves the volume (``stage``). So other glass, and blended
objects, are not visible through glass.
``rendering.frame_shading.with_opaque_pass`` draws the first picture, and hands it to
`Transmission.prepare`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.transmission import stage as transmission_stage
from rasterjit.pipeline.passes import Pass, Rows, ShadingArrays, ShadingNeeds, rows_where
from rasterjit.runtime.threads import Workers, split_into_bands, split_range
from rasterjit.scene.camera import Camera
from rasterjit.scene.pixel_projection import clip_from_relative
from rasterjit.scene.scene import Scene
from rasterjit.survey.effect import FrameContext, OpaquePassEffect
from rasterjit.survey.facts import Facts, explain_unlit
from rasterjit.survey.material_features import without_transmission
from rasterjit.survey.object_counts import describe_count
from rasterjit.survey.plan import RenderPlan

MIN_LEVEL_SIDE = 2
"""Levels are halved while the longer side has at least so many texels."""

MAX_LIGHT = np.float32(1e30)
"""Clamp for light seen through glass."""

MIN_ROWS_PER_TASK = 8
"""Least number of rows of a level that a task writes."""


class OpaquePass(NamedTuple):
    """The opaque pass in mip levels, as ``stage.transmit`` reads it."""

    texels: NDArray[np.float32]
    """(N, 3), linear RGB: level by level, row by row."""
    levels: NDArray[np.int64]
    """(M, 3): first texel, width and height of each level."""
    scales: NDArray[np.float64]
    """(O,): units of the world in one of each object."""
    clip: NDArray[np.float64]
    """(4, 4): to clip space from world axes with the origin at the eye."""
    size: NDArray[np.float64]
    """(2,): width and height of the whole picture, pixels."""
    corner: NDArray[np.int64]
    """(2,): column and row of the first pixel that is drawn."""
    amount: np.float32 = np.float32(1.0)
    """Factor on transmission: 1, or 0 to transmit nothing."""


def make_level_table(size: tuple[int, int], count: int) -> NDArray[np.int64]:
    """Return the first texel, width and height of up to ``count`` levels of a picture, (M, 3)."""
    (width, height), first, rows = size, 0, []
    for _ in range(count):
        rows.append((first, width, height))
        first += width * height
        if max(width, height) < MIN_LEVEL_SIDE:
            break
        width, height = -(-width // 2), -(-height // 2)
    return np.array(rows, np.int64)


def build_mip_levels(
    linear: NDArray[np.float32], is_blurred: bool, workers: Workers
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """
    Return a picture's mip levels, (N, 3) float32, and the table of the levels, (M, 3).

    Parameters
    ----------
    linear : (H, W, 4) float32
        Linear light with straight alpha, which is multiplied in.
    is_blurred : bool
        Whether any level below the picture itself is read.
    workers : Workers
    """
    height, width = linear.shape[:2]
    count = 1 + is_blurred * (max(width, height) - 1).bit_length()
    levels = make_level_table((width, height), count)
    first, last_width, last_height = levels[-1].tolist()
    texels = workers.memory.empty((first + last_width * last_height, 3), np.float32)
    base = texels[: height * width].reshape(height, width, 3)

    def start(*rows: int) -> None:
        band = slice(*rows)
        np.multiply(linear[band, :, :3], linear[band, :, 3:], out=base[band])
        # Light beyond float32 could not be interpolated.
        np.fmin(base[band], MAX_LIGHT, out=base[band])

    workers.run(start, split_into_bands(linear.shape, workers))
    for level in range(1, len(levels)):
        row_count = int(levels[level, transmission_stage.HEIGHT])
        step = max(MIN_ROWS_PER_TASK, -(-row_count // workers.threads))
        finer = int(levels[level - 1, transmission_stage.WIDTH])
        workers.call(
            transmission_stage.downsample,
            [
                (texels, levels, level, rows, np.empty((finer, 3), "f4"))
                for rows in split_range(row_count, step)
            ],
        )
    return texels, levels


def compute_mean_scales(relative_from_model: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the scales of transforms (O, 3, 4): the root mean square over three axes, (O,)."""
    # Sum in a fixed order, whatever a library would do.
    columns = np.moveaxis(relative_from_model[:, :, :3], (1, 2), (0, 1)).reshape(9, -1)
    total = np.zeros(columns.shape[1])
    for part in columns:
        total += part * part
    return np.sqrt(total / 3.0)


class Transmission(OpaquePassEffect):
    """Show what lies behind glass."""

    name = "transmission"
    term = "what is seen through it"
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why no lit object in view transmits light."""
        if facts.transmits:
            return ""
        if not facts.counts.transmitting:
            return "no pbr material has a transmission above 0"
        return explain_unlit(facts) if facts.visible.transmitting else self.describe(facts)

    def describe(self, facts: Facts) -> str:
        """Say how many objects transmit light."""
        seen, count = facts.visible.transmitting, facts.counts.transmitting
        return describe_count(seen, count, "transmitting object")

    def read_radius(self, data: Any) -> None:
        """Return ``None``: a refracted ray may lead to any pixel, see `OpaquePassEffect`."""

    def hidden_objects(self, facts: Facts) -> NDArray[np.bool_]:
        """Return which objects the opaque pass leaves out, besides blended ones."""
        return facts.inventory.is_transmitting

    def refusal(self) -> str:
        """Say what materials must have where transmission cannot be drawn."""
        return "the transmission of materials in view must be 0"

    def prepare(
        self, context: FrameContext, data: Any, seen: Sequence[tuple[Camera, Any]]
    ) -> OpaquePass | None:
        """
        Return the opaque pass in mip levels; ``None`` if it was not drawn.

        ``seen`` holds the pass as (H, W, 4) float32, linear.
        """
        plan, linear = context.plan, seen[0][1]
        if linear is None:
            return None
        texels, levels = build_mip_levels(linear, plan.facts.blurs_behind, context.workers)
        return OpaquePass(
            texels, levels, compute_mean_scales(context.placement.relative_from_model),
            np.ascontiguousarray(clip_from_relative(plan.camera, plan.size)),
            np.array(plan.size, np.float64), np.array(plan.corner, np.int64),
        )  # fmt: skip

    def crop_record(self, record: OpaquePass, corner: tuple[int, int]) -> OpaquePass:
        """Return the opaque pass for a part of the picture."""
        return record._replace(corner=np.array(corner, np.int64))

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernel that makes mip levels."""
        if not plan.facts.blurs_behind:
            return {}
        return {"prepare": rows_where("", transmission_stage.downsample)}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the buffers of the opaque pass; mip levels take a third more."""
        return [
            ("picture behind what transmits", 4, "float32", plan.size),
            ("what is looked up of it", 3, "float32", plan.size),
        ]

    def neutral(self, record: OpaquePass) -> OpaquePass:
        """Return the opaque pass with nothing transmitted."""
        return record._replace(amount=np.float32(0.0))

    def without(self, scene: Scene) -> Scene:
        """Return the scene with materials that transmit no light."""
        return without_transmission(scene)

    @staticmethod
    def remove_transmitted(record: OpaquePass, needs: ShadingNeeds) -> list[Pass]:
        """Return the pass that removes transmitted light from the base colour."""
        if not needs.transmission:
            return []
        return [Pass(transmission_stage.remove_transmitted, lambda _: (record.amount,))]

    @staticmethod
    def transmit(record: OpaquePass, needs: ShadingNeeds) -> list[Pass]:
        """Return the pass that adds the transmitted background, less the fog before samples."""
        if not needs.transmission:
            return []

        def arguments(a: ShadingArrays) -> tuple[Any, ...]:
            texels, levels, *rest, _ = record
            return texels, levels, a.surface.transmission.factors, *rest, a.viewer

        return [Pass(transmission_stage.transmit, arguments)]

    places: ClassVar = {"rows": remove_transmitted, "sample": transmit}


TRANSMISSION = Transmission()
