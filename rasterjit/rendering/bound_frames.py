"""
Draw small frames of a reused `Renderer` from recorded calls (a command buffer).

For small frames, Python overhead dominates. From the third frame of one kind on, the plan's kernels
and stages are recorded with fixed memory (`CommandBuffer`, as for batches). Then a frame copies its
matrices and lights there, and is drawn by one call into machine code. Frames that
`batch_scheduler.can_batch` rejects are drawn step by step, like the first two of each kind.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.outputs.frame import Frame, FrameStats
from rasterjit.outputs.output_table import find_array_spec
from rasterjit.pipeline.batch_driver import COVERED, CUT, LIT_PIXELS, LIT_WHITE_PIXELS
from rasterjit.rendering.batch_scheduler import (
    KNOWN_CAMERAS,
    can_batch,
    depth_conversion,
    kind_of_plan,
    serves,
)
from rasterjit.rendering.command_buffer import LIGHT_ROWS, CommandBuffer, memory_of, view_fields
from rasterjit.rendering.planning import PlannedFrame
from rasterjit.runtime import jit
from rasterjit.runtime.threads import Memory
from rasterjit.survey.batched_views import BatchTransforms, ViewGroup
from rasterjit.survey.effect import BatchedEffect
from rasterjit.survey.plan import RenderPlan

MAX_PIXELS = 1 << 15
"""Pixels of the largest pictures: of larger ones Python is a small part of the time."""

MAX_FACES = 1 << 14
"""The same for faces."""

FRAMES_BEFORE = 2
"""Frames of one kind before calls are recorded, which takes the time of about two."""

MAX_MEMORY = 1 << 26
"""Bytes that one renderer may keep for this."""


class FrameDrawn(NamedTuple):
    """A frame that was drawn by recorded calls."""

    arrays: dict[str, NDArray[Any]]
    """The outputs, (H, W, ...)."""
    totals: NDArray[np.int64]
    """(9,): as ``pipeline/batch_driver.py`` counts."""


class _LastFrame(NamedTuple):
    """The properties by which frames are compared; does not keep the scene alive."""

    plan: RenderPlan
    shapes: Any
    tables: Any


class BoundFrames:
    """The recorded calls of a renderer, for one kind of frame at a time."""

    def __init__(self) -> None:
        self._last: _LastFrame | None = None
        self._alike, self._clears = 0, 0
        self._commands: CommandBuffer | None = None

    @property
    def bytes(self) -> int:
        """Memory in which they draw, about, bytes."""
        return 0 if self._commands is None else self._commands.bytes

    def clear(self) -> None:
        """Release everything; another thread may still draw."""
        self._clears += 1
        self._last, self._alike, self._commands = None, 0, None

    def draw(self, planned: PlannedFrame, memory: Memory) -> FrameDrawn | None:
        """Draw a frame if its calls are recorded, or recording pays now; else return None."""
        commands, outputs = self._commands_of(planned), {}
        if commands is None:
            return None
        memory.next_frame()
        for name in planned.plan.outputs:
            shape, dtype = find_array_spec(name, planned.plan.size, planned.plan.facts.attributes)
            outputs[name] = memory.empty(shape, np.dtype(dtype))
        commands.write_to(outputs)
        totals = commands.draw_one(dict(fields_of(planned)))
        if totals is None:
            # It exceeds the capacity, as the next of its kind probably would.
            self._commands = None
            return None
        return FrameDrawn(outputs, totals)

    def _commands_of(self, planned: PlannedFrame) -> CommandBuffer | None:
        """Return the memory that a frame is drawn in; make it when it pays."""
        plan, cache, clears = planned.plan, planned.cache, self._clears
        last, self._last = self._last, _LastFrame(plan, cache.shapes, cache.tables)
        if last is None or planned.earlier is not None or not _are_alike(last, self._last):
            self._alike, self._commands = 0, None
            return None
        self._alike += 1
        if self._alike == FRAMES_BEFORE and _can_be_bound(planned):
            count = 0 if plan.lighting is None else len(plan.lighting.lights)
            with suppress(MemoryError):
                commands = CommandBuffer(plan, cache, range(count))
                if clears == self._clears:
                    self._commands = commands
        return self._commands


def is_small(planned: PlannedFrame) -> bool:
    """Tell whether a frame is so small that it may pay to bind its calls."""
    width, height = planned.plan.size
    arrays = planned.cache.shapes.arrays
    is_few = max(len(arrays.faces), len(arrays.positions)) <= MAX_FACES
    return width * height <= MAX_PIXELS and is_few and not (jit.DISABLED or jit.CHECKED)


def _can_be_bound(planned: PlannedFrame) -> bool:
    """Tell whether a frame is eligible: drawn from its plan alone, in little memory."""
    plan, cache = planned.plan, planned.cache
    return (
        type(plan.camera) in KNOWN_CAMERAS
        and can_batch(plan, planned.scene, cache)
        and memory_of(plan, cache) <= MAX_MEMORY
    )


def _are_alike(one: _LastFrame, other: _LastFrame) -> bool:
    """Tell whether two frames differ in nothing but what a `CommandBuffer` loads of each."""
    before, now = one.plan, other.plan
    if one.shapes is not other.shapes or one.tables is not other.tables:
        return False
    if type(before.camera) is not type(now.camera):
        return False
    if before.facts is now.facts and before.effects is now.effects and before.size == now.size:
        return before.background.tobytes() == now.background.tobytes()
    return kind_of_plan(before) == kind_of_plan(now) and serves(before, now)


def fields_of(planned: PlannedFrame) -> Iterator[tuple[str, Any]]:
    """Yield the arrays that commands read of a frame, by name: `BatchScheduler.prepare` of one."""
    plan, cache, views = planned.plan, planned.cache, planned.views
    axis = np.asarray(plan.camera.view_matrix())[2, :3]
    yield from view_fields(
        views, views, cache.transforms.world_from_model, views.screen_winding, plan.cull,
        cache.tables.is_single_sided, axis,
    ).items()  # fmt: skip
    yield "coefficients", plan.camera.depth_coefficients()
    if plan.lighting is not None:
        yield LIGHT_ROWS, plan.lighting.lights
    if "depth" in plan.outputs:
        way, *factors = depth_conversion(plan.camera)
        yield "depth_conversion", way
        yield "depth_factors", factors
    changed = [one.effect for one in plan.planned if isinstance(one.effect, BatchedEffect)]
    if changed:
        eye = np.asarray(plan.camera.eye_position(), np.float64)[np.newaxis]
        own = BatchTransforms(
            views.relative_from_model[np.newaxis], views.clip_from_relative[np.newaxis],
            views.toward_viewer[np.newaxis], np.array([views.screen_winding]), np.ones(1, np.bool_),
        )  # fmt: skip
        in_view, boxes = plan.facts.in_view[np.newaxis], cache.shapes.boxes
        group = ViewGroup(
            [plan.camera], plan.size, eye, own, in_view, boxes, lambda: [planned.scene]
        )
        for effect in changed:
            for name, values in effect.compute_view_arrays(planned.scene, group).items():
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
    lit, white = counted[LIT_PIXELS], counted[LIT_WHITE_PIXELS]
    frame._white_share = white / lit if lit else 0.0
    return frame
