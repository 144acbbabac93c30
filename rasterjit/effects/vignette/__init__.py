"""
Vignette: darken a picture towards its corners.

A frame has a vignette where colour is shown in 8 bits. It depends on a pixel's position alone, so
that parts of a picture are darkened as the whole would be; it costs about a nanosecond a pixel.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.vignette.stage import darken_rows
from rasterjit.pipeline.passes import Rows, rows_where
from rasterjit.pipeline.srgb_encoding import make_encoding_table
from rasterjit.runtime.threads import split_into_bands
from rasterjit.scene.color import decoding_table
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.vignette import Vignette
from rasterjit.survey.effect import BatchedEffect, FrameContext, add_to_field
from rasterjit.survey.facts import Facts
from rasterjit.survey.plan import RenderPlan


class Vignetting(BatchedEffect):
    """Darken the corners of the finished picture."""

    name = "vignette"
    field = "vignette"
    key = "z"
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why corners are not darkened."""
        if "color" not in facts.outputs:
            return "no output shows colour in 8 bits"
        return "it darkens nothing" if facts.fields[self.field].is_neutral else ""

    def describe(self, facts: Facts) -> str:
        """Say how much darker the corners are."""
        strength = facts.fields[self.field].strength
        return f"the corners lose {100.0 * strength:g} % of their light"

    def neutral(self, record: Vignette) -> Vignette:
        """Return a vignette of strength 0."""
        return Vignette(0.0, record.start)

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernel that darkens."""
        return {"overlay": rows_where("", darken_rows)}

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Return the scene with the usual vignette."""
        return "on", add_to_field(scene, self.field, Vignette())

    @staticmethod
    def darken(vignette: Vignette, context: FrameContext, color: NDArray[np.uint8]) -> None:
        """Darken the colour, (H, W, 4)."""
        plan, workers = context.plan, context.workers
        target, bands = color.view(np.uint32)[:, :, 0], split_into_bands(color.shape, workers)
        parameters = plan.corner, plan.size, vignette.strength, vignette.start
        tables = decoding_table().copy(), make_encoding_table()
        workers.run(darken_rows, [(target, rows, *parameters, *tables) for rows in bands])

    places: ClassVar = {"overlay": darken}


VIGNETTE = Vignetting()
