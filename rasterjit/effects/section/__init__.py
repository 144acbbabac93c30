"""
Sections: say what a section does, and draw the lines along which it cuts.

A frame has it where the scene asks for it. The cut itself is geometry, made before anything is
planned (`rasterjit.survey.sections`), and costs a frame what its objects cost: nothing here.
Section lines are drawn over the finished picture, where colour is shown in 8 bits: as edges of a
wireframe, hidden by what is nearer, each pixel widened to a disc as those of outlines are.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.outline import disc_rows
from rasterjit.effects.outline.stage import draw_marks
from rasterjit.effects.wireframe import draw_edges
from rasterjit.runtime.threads import rows_per_task
from rasterjit.scene.color import opaque_codes
from rasterjit.scene.quality import Quality
from rasterjit.scene.scene import Scene
from rasterjit.scene.section import Plane, planes_of
from rasterjit.survey.effect import (
    Absent,
    Effect,
    FrameContext,
    Planned,
    Planning,
    Rows,
    with_field,
)
from rasterjit.survey.facts import Facts
from rasterjit.survey.plan import RenderPlan

MARK = np.array([255, 255, 255, 255], np.uint8)
"""What marks a pixel that a line goes through."""


class Sections(Effect):
    """Draw the lines along which planes cut over the finished picture."""

    name = "section"
    field = "section"
    key = "c"
    looks = "neighbours"
    joins_faces = True
    reads_clip_positions = True
    follows_facts = True

    def answer(self, facts: Facts, planning: Planning) -> Planned | Absent:
        """Say whether the scene is cut."""
        planes = planes_of(facts.asked[self.field])
        return Planned(self, facts, planes) if planes else Absent(self, facts)

    def reason(self, facts: Facts, is_used: bool) -> str:
        """Say by how many planes the scene is cut."""
        planes = planes_of(facts.asked[self.field])
        if not planes:
            return "scene.section is None"
        parts = [f"{len(planes)} planes" if len(planes) > 1 else "one plane"]
        capped = sum(plane.cap for plane in planes)
        lined = sum(plane.lines for plane in planes) if "color" in facts.outputs else 0
        for count, what in ((capped, "caps where meshes are closed"), (lined, "section lines")):
            some = f" of {count}" if 0 < count < len(planes) else ""
            parts.append(f"{what}{some}" if count else f"no {what.split()[-1] if count else what}")
        return ", ".join(parts)

    def reads_depth(self, plan: RenderPlan) -> bool:
        """Tell whether faces hide lines."""
        return _draws_lines(plan)

    def kernels(self, plan: RenderPlan) -> dict[str, Rows]:
        """Return the kernels that draw lines."""
        if not _draws_lines(plan):
            return {}
        hiding = "hidden lines removed"
        return {
            "overlay": [
                ("wireframe.find_pixels", "", ""),
                ("wireframe.fill_slack", "", ""),
                ("wireframe.project_edges", hiding, ""),
                ("wireframe.draw_edges", hiding, ""),
                ("outline.draw_marks", "", ""),
            ]
        }

    def reach(self, data: tuple[Plane, ...]) -> int | None:
        """Return how far from its middle a line goes."""
        return max((plane.line_width for plane in data if plane.lines), default=0)

    @staticmethod
    def draw_over(
        planes: tuple[Plane, ...], context: FrameContext, color: NDArray[np.uint8]
    ) -> None:
        """Draw the lines over the colour, (H, W, 4)."""
        plan, cache, geometry, _, coverage, workers = context
        if cache.cut is None or not plan.facts.draws_faces:
            return
        target, coefficients = color.view(np.uint32)[:, :, 0], plan.camera.depth_coefficients()
        hidden_by = coverage.face_id, coverage.reversed_depth
        height = len(target)
        per_task = rows_per_task(target.shape, workers)
        bands = [((n, min(n + per_task, height)),) for n in range(0, height, per_task)]
        for plane, edges in zip(planes, cache.cut.edges, strict=True):
            if not plane.lines or not len(edges):
                continue
            drawn = np.zeros(color.shape, np.uint8)
            draw_edges(edges, geometry, coefficients, MARK, drawn, hidden_by, workers)
            marks, reach = drawn[:, :, 0].copy(), disc_rows(plane.line_width)
            rgba = opaque_codes(plane.line_color).view(np.uint32)

            def draw_band(
                rows: tuple[int, int], marks: NDArray[np.uint8] = marks,
                reach: NDArray[np.int32] = reach, rgba: NDArray[np.uint32] = rgba,
            ) -> None:  # fmt: skip
                draw_marks(marks, rows, reach, rgba, target)

            workers.run(draw_band, bands)

    places: ClassVar = {"overlay": draw_over}

    def add(self, scene: Scene, quality: Quality) -> tuple[str, Scene | None]:
        """Return the scene cut through its middle, across the axis z."""
        if scene.section is not None:
            return "", None
        try:
            center, _ = scene.bounding_sphere()
        except ValueError:
            return "", None
        if not np.isfinite(center).all():
            return "", None
        cut = Plane(tuple(center.tolist()), (0.0, 0.0, 1.0))
        return "cut through the middle", with_field(scene, self.field, cut)


def _draws_lines(plan: RenderPlan) -> bool:
    """Tell whether any lines are drawn."""
    planes = planes_of(plan.facts.asked["section"])
    is_shown = "color" in plan.facts.outputs and plan.facts.draws_faces
    return is_shown and any(plane.lines for plane in planes)


SECTION = Sections()
