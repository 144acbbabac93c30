"""
Frames of a kept `Renderer` whose calls are recorded: small ones, where Python would take longest.

From its third frame of one kind on, a plan's kernels and stages are bound to memory of their own
(`desk.Desk`, in which batches of views are drawn, too). Then a frame loads its matrices and lights
there, and is drawn by one call into machine code. Frames that `sharing.can_share` leaves out are
drawn step by step, as each first frame is.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.outputs.table import shape_of
from rasterjit.pipeline.views import COVERED, CUT, LIT, LIT_WHITE
from rasterjit.rendering.desk import LIGHT_ROWS, Desk, memory_of, view_fields
from rasterjit.rendering.kept import serves
from rasterjit.rendering.sharing import can_share, kind_of_plan
from rasterjit.rendering.together import KNOWN_CAMERAS, depth_way
from rasterjit.rendering.views import PlannedFrame
from rasterjit.runtime import jit
from rasterjit.runtime.threads import Memory
from rasterjit.survey.effect import InGroups
from rasterjit.survey.many_views import Group, ManyViews

MOST_PIXELS = 1 << 15
"""Pixels of the largest pictures that are recorded: larger ones take longer than their Python."""

MOST_FACES = 1 << 14
"""The same for faces."""

FRAMES_BEFORE = 2
"""Frames of one kind before one is recorded: what takes two frames' time must serve for several."""

MOST_MEMORY = 1 << 26
"""Bytes that a recorded frame may keep."""


class FrameDrawn(NamedTuple):
    """A frame that was drawn by recorded calls."""

    arrays: dict[str, NDArray[Any]]
    """The outputs, (H, W, ...)."""
    totals: NDArray[np.int64]
    """(9,): as ``pipeline/views.py`` counts."""


class Recorder:
    """What a renderer's frames are recorded in: one kind of frame at a time."""

    def __init__(self) -> None:
        self._last: PlannedFrame | None = None
        self._alike = 0
        self._desk: Desk | None = None

    def clear(self) -> None:
        """Forget what was recorded."""
        self._last, self._alike, self._desk = None, 0, None

    def draw(self, planned: PlannedFrame, memory: Memory) -> FrameDrawn | None:
        """Draw a frame if its calls are recorded, or are to be recorded now."""
        if not self._is_recorded(planned):
            return None
        desk, outputs = self._desk, {}
        for name in planned.plan.outputs:
            shape, dtype = shape_of(name, planned.plan.size, planned.plan.facts.attributes)
            outputs[name] = memory.empty(shape, np.dtype(dtype))
        desk.write_to(outputs)
        totals = desk.draw_one(dict(fields_of(planned)))
        return None if totals is None else FrameDrawn(outputs, totals)

    def _is_recorded(self, planned: PlannedFrame) -> bool:
        """Tell whether there is memory that a frame is drawn in; make it when it pays."""
        last, self._last = self._last, planned
        if last is None or not _are_alike(last, planned):
            self._alike, self._desk = 0, None
            return False
        self._alike += 1
        if self._alike == FRAMES_BEFORE and _can_be_recorded(planned):
            count = 0 if planned.plan.lighting is None else len(planned.plan.lighting.lights)
            self._desk = Desk(planned.plan, planned.cache, range(count))
        return self._desk is not None


def is_small(planned: PlannedFrame) -> bool:
    """Tell whether a frame is so small that it may be worth while to record its calls."""
    width, height = planned.plan.size
    arrays = planned.cache.shapes.arrays
    is_few = max(len(arrays.faces), len(arrays.positions)) <= MOST_FACES
    return width * height <= MOST_PIXELS and is_few and not (jit.DISABLED or jit.CHECKED)


def _can_be_recorded(planned: PlannedFrame) -> bool:
    """Tell whether all that draws a frame follows from its plan, and takes little memory."""
    plan, cache = planned.plan, planned.cache
    return (
        planned.earlier is None
        and type(plan.camera) in KNOWN_CAMERAS
        and can_share(plan, planned.scene, cache)
        and memory_of(plan, cache) <= MOST_MEMORY
    )


def _are_alike(one: PlannedFrame, other: PlannedFrame) -> bool:
    """Tell whether two frames differ in nothing but matrices, and what follows from these."""
    before, now = one.plan, other.plan
    if one.cache.shapes is not other.cache.shapes or one.cache.tables is not other.cache.tables:
        return False
    if type(before.camera) is not type(now.camera) or other.earlier is not None:
        return False
    if before.facts is now.facts and before.effects is now.effects and before.size == now.size:
        return before.background.tobytes() == now.background.tobytes()
    return kind_of_plan(before) == kind_of_plan(now) and serves(before, now)


def fields_of(planned: PlannedFrame) -> Iterator[tuple[str, Any]]:
    """Yield the arrays of a frame that its `Desk` loads, by name: `Together.prepare` of one."""
    plan, cache, views = planned.plan, planned.cache, planned.views
    axis = np.asarray(plan.camera.view_matrix())[2, :3]
    yield from view_fields(
        views, views, cache.places.world_from_model, views.screen_turn, plan.cull,
        cache.tables.is_single_sided, axis,
    ).items()  # fmt: skip
    yield "coefficients", plan.camera.depth_coefficients()
    if plan.lighting is not None:
        yield LIGHT_ROWS, plan.lighting.lights
    if "depth" in plan.outputs:
        way, *factors = depth_way(plan.camera)
        yield "depth_way", way
        yield "depth_factors", factors
    changed = [one.effect for one in plan.planned if isinstance(one.effect, InGroups)]
    if changed:
        eye = np.asarray(plan.camera.eye_position(), np.float64)[np.newaxis]
        own = ManyViews(
            *(part[np.newaxis] for part in views[:2]), views.toward_viewer[np.newaxis],
            np.array([views.screen_turn]), np.ones(1, np.bool_),
        )  # fmt: skip
        in_view, boxes = plan.facts.in_view[np.newaxis], cache.shapes.boxes
        group = Group([plan.camera], plan.size, eye, own, in_view, boxes)
        for effect in changed:
            for name, values in effect.differ(planned.scene, group).items():
                yield name, values[0]


def frame_of_totals(
    planned: PlannedFrame,
    arrays: dict[str, NDArray[Any]],
    totals: NDArray[np.int64],
    seconds: dict[str, float],
) -> Frame:
    """Return a frame of what was drawn, (H, W, ...) each, and counted, (9,)."""
    faces, counted = len(planned.cache.shapes.arrays.faces), totals.tolist()
    outside, degenerate, culled, unsampled, invalid = counted[:COVERED]
    drawn = faces - (outside + degenerate + culled + unsampled + invalid)
    stats = FrameStats(
        faces, outside, culled, degenerate, unsampled, invalid, drawn, counted[CUT],
        seconds=seconds, face_id=counted[COVERED],
    )  # fmt: skip
    frame = Frame(arrays, planned.plan, stats, None, planned.cache.face_starts)
    lit, white = counted[LIT], counted[LIT_WHITE]
    frame._white_share = white / lit if lit else 0.0
    return frame
