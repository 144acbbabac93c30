"""
Draw small frames of a reused `Renderer` from recorded calls (a command buffer).

In small frames, Python takes most of the time. From the third frame of one kind on, the kernels and
stages of its plan are recorded with fixed memory (`CommandBuffer`, as for batches). Then a frame
only copies its matrices and lights there, and one call into machine code draws it. Frames that
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
    can_batch,
    depth_conversion,
    is_reusable,
    kind_of_plan,
)
from rasterjit.rendering.command_buffer import (
    LIGHT_ROWS,
    CommandBuffer,
    ViewContents,
    estimate_bytes,
    make_view_fields,
)
from rasterjit.rendering.planning import PlannedFrame
from rasterjit.runtime import jit
from rasterjit.runtime.threads import Memory
from rasterjit.survey.batched_views import BatchTransforms, ViewGroup
from rasterjit.survey.effect import BatchedEffect
from rasterjit.survey.object_transforms import KNOWN_CAMERAS
from rasterjit.survey.plan import RenderPlan

MAX_PIXELS = 1 << 15
"""Pixels of the largest recorded pictures: of larger ones, Python is a small part of the time."""

MAX_FACES = 1 << 15
"""Faces, and vertices, of the largest recorded scenes."""

MIN_ALIKE_FRAMES = 2
"""Frames of one kind before calls are recorded; recording takes the time of about two."""

MAX_BYTES = 1 << 26
"""Most memory of the recorded calls of one renderer."""


class _LastFrame(NamedTuple):
    """What `_are_alike` compares of a frame; does not keep the scene alive."""

    plan: RenderPlan
    shapes: Any
    tables: Any


class RecordedFrames:
    """The recorded calls of a renderer, for one kind of frame at a time."""

    def __init__(self) -> None:
        self._last: _LastFrame | None = None
        self._alike_count, self._clear_count = 0, 0
        self._commands: CommandBuffer | None = None

    @property
    def bytes(self) -> int:
        """Memory of the recorded calls, about."""
        return 0 if self._commands is None else self._commands.bytes

    def clear(self) -> None:
        """Release everything; another thread may still draw."""
        self._clear_count += 1
        self._last, self._alike_count, self._commands = None, 0, None

    def draw(
        self, planned: PlannedFrame, memory: Memory
    ) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64]] | None:
        """
        Draw a frame if its calls are recorded, or recording pays now; else return None.

        Returns
        -------
        outputs : dict of (H, W, ...) arrays
        totals : (9,) int64
            As ``pipeline/batch_driver.py`` counts.
        """
        commands, outputs = self._get_commands(planned), {}
        if commands is None:
            return None
        memory.next_frame()
        for name in planned.plan.outputs:
            shape, dtype = find_array_spec(name, planned.plan.size, planned.plan.facts.attributes)
            outputs[name] = memory.empty(shape, np.dtype(dtype))
        commands.write_to(outputs)
        contents = ViewContents(planned.plan.camera, planned.plan.facts.in_view)
        totals = commands.draw_one(dict(list_view_fields(planned)), contents)
        if totals is None:
            # The view exceeds the capacity, as the next of its kind probably would.
            self._commands = None
            return None
        return outputs, totals

    def _get_commands(self, planned: PlannedFrame) -> CommandBuffer | None:
        """Return the recorded calls of a frame's kind; record them once that pays."""
        plan, cache, clear_count = planned.plan, planned.cache, self._clear_count
        last, self._last = self._last, _LastFrame(plan, cache.shapes, cache.tables)
        if last is None or planned.previous is not None or not _are_alike(last, self._last):
            self._alike_count, self._commands = 0, None
            return None
        self._alike_count += 1
        if self._alike_count == MIN_ALIKE_FRAMES and _can_be_recorded(planned):
            count = 0 if plan.lighting is None else len(plan.lighting.lights)
            with suppress(MemoryError):
                commands = CommandBuffer(plan, cache, range(count))
                if clear_count == self._clear_count:
                    self._commands = commands
        return self._commands


def is_small(planned: PlannedFrame) -> bool:
    """Tell whether a frame is so small that recording its calls may pay."""
    width, height = planned.plan.size
    arrays = planned.cache.shapes.arrays
    has_few_faces = max(len(arrays.faces), len(arrays.positions)) <= MAX_FACES
    is_compiled = not (jit.DISABLED or jit.CHECKED)
    return width * height <= MAX_PIXELS and has_few_faces and is_compiled


def _can_be_recorded(planned: PlannedFrame) -> bool:
    """Tell whether a frame can be drawn by recorded calls, in little memory."""
    plan, cache = planned.plan, planned.cache
    return (
        type(plan.camera) in KNOWN_CAMERAS
        and can_batch(plan, planned.scene, cache)
        and estimate_bytes(plan, cache) <= MAX_BYTES
    )


def _are_alike(last: _LastFrame, current: _LastFrame) -> bool:
    """Tell whether two frames differ in nothing but what a `CommandBuffer` loads of each."""
    before, now = last.plan, current.plan
    if last.shapes is not current.shapes or last.tables is not current.tables:
        return False
    if type(before.camera) is not type(now.camera):
        return False
    if before.facts is now.facts and before.effects is now.effects and before.size == now.size:
        return before.background.tobytes() == now.background.tobytes()
    return kind_of_plan(before) == kind_of_plan(now) and is_reusable(before, now)


def list_view_fields(planned: PlannedFrame) -> Iterator[tuple[str, Any]]:
    """Yield the names and values of the arrays that a `CommandBuffer` loads for a frame."""
    plan, cache, views = planned.plan, planned.cache, planned.views
    axis = np.asarray(plan.camera.view_matrix())[2, :3]
    yield from make_view_fields(
        views, views, cache.transforms.world_from_model, views.screen_winding, plan.cull,
        cache.tables.is_single_sided, axis,
    ).items()  # fmt: skip
    yield "coefficients", plan.camera.depth_coefficients()
    if plan.lighting is not None:
        yield LIGHT_ROWS, plan.lighting.lights
    if "depth" in plan.outputs:
        conversion, *factors = depth_conversion(plan.camera)
        yield "depth_conversion", conversion
        yield "depth_factors", factors
    effects = [each.effect for each in plan.planned if isinstance(each.effect, BatchedEffect)]
    if effects:
        eye = np.asarray(plan.camera.eye_position(), np.float64)[np.newaxis]
        batched_views = BatchTransforms(
            views.relative_from_model[np.newaxis], views.clip_from_relative[np.newaxis],
            views.toward_viewer[np.newaxis], np.array([views.screen_winding]), np.ones(1, np.bool_),
        )  # fmt: skip
        in_view, boxes = plan.facts.in_view[np.newaxis], cache.shapes.boxes
        group = ViewGroup(
            [plan.camera], plan.size, eye, batched_views, in_view, boxes, lambda: [planned.scene],
            plan.facts.inventory,
        )  # fmt: skip
        for effect in effects:
            for name, values in effect.compute_view_arrays(planned.scene, group).items():
                yield name, values[0]


def assemble_frame(
    planned: PlannedFrame,
    outputs: dict[str, NDArray[Any]],
    totals: NDArray[np.int64],
    seconds: dict[str, float],
) -> Frame:
    """Return a frame of its outputs, (H, W, ...) each, and totals: see `RecordedFrames.draw`."""
    faces, counts = len(planned.cache.shapes.arrays.faces), totals.tolist()
    outside, degenerate, culled, unsampled, invalid = counts[:COVERED]
    drawn = faces - (outside + degenerate + culled + unsampled + invalid)
    stats = FrameStats(
        faces, outside, culled, degenerate, unsampled, invalid, drawn, counts[CUT],
        seconds=seconds, face_id=counts[COVERED],
    )  # fmt: skip
    frame = Frame(outputs, planned.plan, stats, None, planned.cache.face_starts)
    lit, white = counts[LIT_PIXELS], counts[LIT_WHITE_PIXELS]
    frame._white_share = white / lit if lit else 0.0
    return frame
