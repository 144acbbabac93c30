"""Run the tessellation of an object's segments: allocate, split among threads, call kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.passes import Rows, rows_where
from rasterjit.pipeline.records import ScreenVertices, Viewport
from rasterjit.pipeline.visibility import line_tessellation
from rasterjit.pipeline.visibility.primitive_expansion import (
    Expansion,
    LineRule,
    Primitive,
    Primitives,
    Projected,
)
from rasterjit.runtime.threads import Workers, choose_task_size, split_range

SEGMENTS_PER_TASK = 65536
"""Most segments that one task tessellates."""

MIN_SEGMENTS_PER_TASK = 2048
"""Fewest segments of a task, if there are several threads."""

TASKS_PER_THREAD = 4


def kernel_rows() -> Rows:
    """Return the kernels that are called where there are lines."""
    from rasterjit.pipeline.visibility import line_tessellation as kernels

    return rows_where("", kernels.project_segments, kernels.count_pieces, kernels.write_pieces)


def expand_lines(
    obj: Primitive, primitives: Primitives, projected: Projected, workers: Workers
) -> Expansion:
    """Project the segments of an object to the screen, and count their pieces."""
    rule = obj.rule
    if not isinstance(rule, LineRule):
        raise ValueError(f"rule must be a LineRule, got {rule!r}")
    first_face, count = obj.faces[0], obj.faces[1] - obj.faces[0]
    empty, viewport = workers.memory.empty, projected.viewport
    parts = empty((count if len(rule.dashes) and obj.is_world else 0, 4), np.float64)
    screen_segments = (
        empty((count, 4), np.int32), empty((count, 4), np.float64), empty((count,), np.uint8), parts
    )  # fmt: skip
    per_task = min(
        choose_task_size(count, MIN_SEGMENTS_PER_TASK, workers, TASKS_PER_THREAD), SEGMENTS_PER_TASK
    )
    tasks = split_range(count, per_task)
    # Project the segments to the screen.
    sizes = obj.sizes, primitives.pixels_per_size(obj), int(obj.is_world)
    right, down = (step * primitives.pixels for step in rule.depth_offset)
    workers.call(
        line_tessellation.project_segments,
        [
            (
                task, (first_face, projected.faces), projected.clip_positions, projected.codes,
                sizes, (right, down), projected.depth_coefficients, viewport, screen_segments,
            )
            for task in tasks
        ],
    )  # fmt: skip
    if right or down:
        _shift_clip_positions(projected.clip_positions[slice(*obj.vertices)], right, down, viewport)
    # Count the vertices and pieces of each segment.
    counts = empty((count, 2), np.int32)
    dashes = _plan_dashes(obj, rule, primitives, projected, screen_segments)
    shared = rule.links, screen_segments, int(rule.is_round), viewport, dashes
    workers.call(line_tessellation.count_pieces, [(task, *shared, counts) for task in tasks])
    sums = np.zeros((count + 1, 2), np.int64)
    np.cumsum(counts, axis=0, out=sums[1:])

    def write_pieces(
        first: int, screen: ScreenVertices, pieces: NDArray[np.int32], faces: NDArray[np.int32]
    ) -> None:
        starts = first, first_face, sums
        workers.call(
            line_tessellation.write_pieces,
            [
                (
                    task,
                    *shared,
                    starts,
                    screen,
                    (pieces, faces),
                    np.empty(line_tessellation.SCRATCH_SHAPE),
                )
                for task in tasks
            ],
        )

    return Expansion(int(sums[-1, 0]), int(sums[-1, 1]), write_pieces)


def _shift_clip_positions(
    clip_positions: NDArray[np.float64], right: float, down: float, viewport: Viewport
) -> None:
    """Shift clip positions, so that samples interpolate at an offset of pixels right and down."""
    width = viewport.left + viewport.width + viewport.right
    height = viewport.top + viewport.height + viewport.bottom
    clip_positions[:, 0] -= 2.0 * right / width * clip_positions[:, 3]
    clip_positions[:, 1] += 2.0 * down / height * clip_positions[:, 3]


def _plan_dashes(
    obj: Primitive,
    rule: LineRule,
    primitives: Primitives,
    projected: Projected,
    screen_segments: tuple[NDArray[Any], ...],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each segment's range along its strip, (S, 2), and the ends of dashes."""
    if not len(rule.dashes):
        return np.empty((0, 2)), np.empty(0)
    ends, _, states, parts = screen_segments
    edges = np.append(0.0, np.cumsum(rule.dashes))
    if obj.is_world:
        a, b = projected.faces[slice(*obj.faces), :2].T
        vectors = primitives.positions[b].astype(np.float64) - primitives.positions[a]
        x, y, z = vectors.T
    else:
        edges *= primitives.pixels
        unit = float(1 << projected.viewport.grid_bits)
        x, y = ((ends[:, k + 2].astype(np.float64) - ends[:, k]) / unit for k in (0, 1))
        z = np.zeros(len(x))
    lengths = np.sqrt((x * x + y * y) + z * z)
    if not obj.is_world:
        # Clipped-away segments have no length in pixels.
        lengths[states == line_tessellation.HIDDEN] = 0.0
    lengths[~np.isfinite(lengths)] = 0.0
    starts = np.append(0.0, np.cumsum(lengths)[:-1])
    numbers = np.arange(len(starts))
    firsts = np.maximum.accumulate(np.where(rule.links[:, 0] == numbers - 1, 0, numbers))
    starts -= starts[firsts]
    ranges = np.stack([starts, starts + lengths], axis=1)
    if obj.is_world:
        is_drawn = states != line_tessellation.HIDDEN
        ranges[is_drawn] = (
            starts[is_drawn, np.newaxis] + parts[is_drawn, :2] * lengths[is_drawn, np.newaxis]
        )
    return ranges, edges
