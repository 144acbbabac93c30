"""
Hatch the caps of cross sections: lines over the finished picture, in 8-bit colour.

The lines depend on the place of a pixel in the whole picture, and on which cap its centre shows. So
parts of a picture are hatched as the whole would be, under lenses too. A line covers of a pixel
what it covers of one as wide, across the line.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.wireframe import blending_space, find_light
from rasterjit.effects.wireframe.coverage import blend_lines
from rasterjit.pipeline.passes import KernelRow, Rows
from rasterjit.pipeline.srgb_encoding import make_encoding_table
from rasterjit.runtime.threads import split_into_bands
from rasterjit.scene.color import opaque_codes
from rasterjit.scene.portable_trig import sin_cos_degrees
from rasterjit.scene.scene import Scene
from rasterjit.scene.section import SectionPlane, planes_in, replace_planes
from rasterjit.survey.effect import FrameContext, Planning, ScreenEffect, with_field
from rasterjit.survey.facts import Facts
from rasterjit.survey.plan import RenderPlan
from rasterjit.survey.transparency import describe_blending

TURNS = np.array([0.0, 90.0, 30.0, 120.0, 60.0, 150.0, 15.0, 105.0, 45.0, 135.0, 75.0, 165.0])
"""Angles between the lines of objects that meet, degrees: by their numbers, in turn."""


class SectionHatching(ScreenEffect):
    """Draw hatchings of caps over the finished picture."""

    name = "section hatching"
    field = "section"
    scope = "sample"
    needs_facts_only = True

    def unused_reason(self, facts: Facts) -> str:
        """Say why no cap is hatched."""
        planes = planes_in(facts.fields[self.field])
        if not any(plane.hatch is not None and plane.cap for plane in planes):
            return "no plane's caps have a hatching" if planes else "scene.section is None"
        if "color" not in facts.outputs:
            return "no output shows colour in 8 bits"
        return "" if facts.draws_faces else "only the wireframe is drawn"

    def plan_data(self, facts: Facts, planning: Planning) -> tuple[SectionPlane, ...]:
        """Return the planes."""
        return planes_in(facts.fields[self.field])

    def describe(self, facts: Facts) -> str:
        """Say how far apart the lines are."""
        planes = planes_in(facts.fields[self.field])
        spacings = [f"{plane.hatch:g}" for plane in planes if plane.hatch is not None]
        apart = ", ".join(dict.fromkeys(spacings))
        return f"lines {apart} pixels apart{describe_blending(facts.quality)}"

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernel that blends lines."""
        return {"overlay": [KernelRow(blend_lines, blending_space(plan.quality))]}

    def buffers(self, plan: RenderPlan) -> list[tuple[str, int, str, tuple[int, int]]]:
        """Return the image of what lines cover."""
        return [("coverage of hatchings", 1, "float32", plan.size)]

    def without(self, scene: Scene) -> Scene:
        """Return the scene cut without hatchings."""
        return with_field(scene, self.field, replace_planes(scene.section, hatch=None))

    @staticmethod
    def draw_over(
        planes: tuple[SectionPlane, ...], context: FrameContext, color: NDArray[np.uint8]
    ) -> None:
        """Draw the lines over the colour, (H, W, 4)."""
        plan, cut, workers = context.plan, context.cache.cut, context.workers
        if cut is None:
            return
        target = color.view(np.uint32)[:, :, 0]
        light, table = find_light(plan.quality), make_encoding_table()
        face_id, first_cap = context.seen.coverage.face_id, int(cut.face_starts[-1])

        def hatch_band(rows: tuple[int, int]) -> None:
            band = slice(*rows)
            numbers = cut.face_numbers[face_id[band]] - first_cap
            for number, plane in enumerate(planes):
                y, x = np.nonzero((numbers >= 0) & (numbers % len(planes) == number))
                if plane.hatch is None or not len(y):
                    continue
                turns = cut.hatchings[numbers[y, x] // len(planes)]
                coverage = np.zeros(numbers.shape, np.float32)
                column, row = plan.corner
                coverage[y, x] = _cover(plane, x + column, y + rows[0] + row, turns)
                rgba = opaque_codes(plane.hatch_color).view(np.uint32)
                blend_lines(coverage, rgba, light, table, target[band])

        workers.run(hatch_band, [(rows,) for rows in split_into_bands(color.shape, workers)])

    places: ClassVar = {"overlay": draw_over}


def _cover(
    plane: SectionPlane, columns: NDArray[np.int64], rows: NDArray[np.int64],
    turns: NDArray[np.int64],
) -> NDArray[np.float64]:  # fmt: skip
    """Return how much of pixels the lines of a plane's hatching cover, (N,), 0..1."""
    assert plane.hatch is not None
    sines, cosines = sin_cos_degrees(plane.hatch_angle + TURNS)
    which = turns % len(TURNS)
    across = (columns + 0.5) * sines[which] + (rows + 0.5) * cosines[which]
    periods = across / plane.hatch
    distance = np.abs(periods - np.floor(periods) - 0.5) * plane.hatch
    # The part of an interval of a pixel's width that a line covers.
    half = plane.hatch_width / 2.0
    low, high = np.maximum(distance - 0.5, -half), np.minimum(distance + 0.5, half)
    return np.maximum(high - low, 0.0)


SECTION_HATCHING = SectionHatching()
