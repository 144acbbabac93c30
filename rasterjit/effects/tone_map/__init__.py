"""
Tone mapping: exposure, and a curve from scene to display light.

A frame is tone mapped where colour is 8-bit and the tone map changes it. Linear output is not
mapped. Pixels of several faces are resolved first, unless codes are blended.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.tone_map import stage
from rasterjit.effects.tone_map.stage import NO_TONES, ToneRecord
from rasterjit.pipeline.passes import Pass, Rows, fixed, rows_where
from rasterjit.pipeline.surface.sample_block import NORMAL_X
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.tone_map import ToneMap
from rasterjit.survey.effect import BatchedEffect, Calls, Planning, add_to_field
from rasterjit.survey.facts import Facts
from rasterjit.survey.plan import RenderPlan

CURVES = {
    "none": stage.NONE,
    "reinhard": stage.REINHARD,
    "aces": stage.ACES,
    "neutral": stage.NEUTRAL,
}


def make_tone_record(tone_map: ToneMap) -> ToneRecord:
    """Return the record of a tone map."""
    return ToneRecord(
        CURVES[tone_map.curve],
        np.float32(tone_map.exposure),
        np.float32(1.0 / (tone_map.white * tone_map.white)),
    )


class ToneMapping(BatchedEffect):
    """Map scene light to display light where colour is 8-bit."""

    name = "tone mapping"
    field = "tone_map"
    key = "t"
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why colour is not tone mapped."""
        if facts.tone_map is not None:
            return ""
        is_neutral = facts.fields[self.field].is_neutral
        return "curve none, exposure 0" if is_neutral else "no output shows colour in 8 bits"

    def plan_data(self, facts: Facts, planning: Planning) -> ToneRecord:
        """Return the tone map's record."""
        return make_tone_record(facts.fields[self.field])

    def describe(self, facts: Facts) -> str:
        """Say the curve and the exposure."""
        tone_map = facts.fields[self.field]
        return f"curve {tone_map.curve}, exposure {tone_map.exposure:g}"

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Return the scene with the neutral curve."""
        return "curve neutral", add_to_field(scene, self.field, ToneMap())

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernel that maps resolved light."""
        is_colored = plan.facts.background_image is None
        return {
            "mixed": rows_where("", stage.map_over_color if is_colored else stage.map_over_picture)
        }

    @staticmethod
    def map_rows(tone: ToneRecord, first: int) -> tuple[list[Pass], int]:
        """Return the stages that map three rows of samples, and the first row of the result."""
        return [fixed(stage.map_samples, first, tone)], NORMAL_X

    @staticmethod
    def map_mixed(
        tone: ToneRecord,
        calls: Calls,
        linear: NDArray[np.float32],
        background: NDArray[np.float32],
        display: NDArray[np.float32],
    ) -> None:
        """
        Map rows of resolved light, (R, W, 4), and composite them over a background.

        A background image is given in ``display``.
        """
        if background is display:
            calls.call(stage.map_over_picture, linear, display, tone)
        else:
            calls.call(stage.map_over_color, linear, background, tone, display)

    places: ClassVar = {"pixel": map_rows, "mixed": map_mixed}


TONE_MAPPING = ToneMapping()


def get_tone(plan: RenderPlan) -> ToneRecord:
    """Return a frame's tone map; `NO_TONES` if it has none."""
    tone = plan.data(TONE_MAPPING.name)
    return NO_TONES if tone is None else tone
