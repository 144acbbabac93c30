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
from rasterjit.runtime.threads import Workers, count_per_task

SEGMENTS_PER_TASK = 65536
"""Most segments that one task tessellates."""

MIN_SEGMENTS = 2048
"""Fewest, if there are several threads."""

EVEN_TASKS = 4
"""Tasks of each thread."""


def kernel_rows() -> Rows:
    """Return the kernels that are called where there are lines."""
    from rasterjit.pipeline.visibility import line_tessellation as kernels

    return rows_where("", kernels.project_segments, kernels.count_pieces, kernels.write_pieces)


def expand(
    obj: Primitive, primitives: Primitives, projected: Projected, workers: Workers
) -> Expansion:
    """Project the segments of an object to the screen, and count their pieces."""
    # Memory, and tasks of some segments each.
    rule = obj.rule
    if not isinstance(rule, LineRule):
        raise ValueError(f"rule must be a LineRule, got {rule!r}")
    first_face, count = obj.faces[0], obj.faces[1] - obj.faces[0]
    empty, viewport = workers.memory.empty, projected.viewport
    parts = empty((count if len(rule.dashes) and obj.is_world else 0, 4), np.float64)
    placed = (
        empty((count, 4), np.int32), empty((count, 4), np.float64), empty((count,), np.uint8), parts
    )  # fmt: skip
    per_task = min(count_per_task(count, MIN_SEGMENTS, workers, EVEN_TASKS), SEGMENTS_PER_TASK)
    tasks = [(n, min(n + per_task, count)) for n in range(0, count, per_task)]
    # Where the segments lie on the screen.
    sizes = obj.sizes, primitives.factor(obj), int(obj.is_world)
    right, down = (step * primitives.pixels for step in rule.depth_offset)
    workers.call(
        line_tessellation.project_segments,
        [
            (
                task, (first_face, projected.faces), projected.clip_positions, projected.codes,
                sizes, (right, down), projected.depth_coefficients, viewport, placed,
            )
            for task in tasks
        ],
    )  # fmt: skip
    if right or down:
        _move(projected.clip_positions[slice(*obj.vertices)], right, down, viewport)
    # How many vertices and pieces each one has.
    counts = empty((count, 2), np.int32)
    dashes = _dashes_of(obj, rule, primitives, projected, placed)
    shared = rule.links, placed, int(rule.is_round), viewport, dashes
    workers.call(line_tessellation.count_pieces, [(task, *shared, counts) for task in tasks])
    sums = np.zeros((count + 1, 2), np.int64)
    np.cumsum(counts, axis=0, out=sums[1:])

    def write(
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

    return Expansion(int(sums[-1, 0]), int(sums[-1, 1]), write)


def _move(
    clip_positions: NDArray[np.float64], right: float, down: float, viewport: Viewport
) -> None:
    """Shift clip positions, so that samples interpolate at an offset of pixels right and down."""
    width = viewport.left + viewport.width + viewport.right
    height = viewport.top + viewport.height + viewport.bottom
    clip_positions[:, 0] -= 2.0 * right / width * clip_positions[:, 3]
    clip_positions[:, 1] += 2.0 * down / height * clip_positions[:, 3]


def _dashes_of(
    obj: Primitive,
    rule: LineRule,
    primitives: Primitives,
    projected: Projected,
    placed: tuple[NDArray[Any], ...],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each segment's range on its strip, (S, 2), and the dashes, as kernels take them."""
    if not len(rule.dashes):
        return np.empty((0, 2)), np.empty(0)
    ends, _, states, parts = placed
    edges = np.append(0.0, np.cumsum(rule.dashes))
    if obj.is_world:
        a, b = projected.faces[slice(*obj.faces), :2].T
        steps = primitives.positions[b].astype(np.float64) - primitives.positions[a]
        x, y, z = steps.T
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
    stretches = np.stack([starts, starts + lengths], axis=1)
    if obj.is_world:
        drawn = states != line_tessellation.HIDDEN
        stretches[drawn] = starts[drawn, np.newaxis] + parts[drawn, :2] * lengths[drawn, np.newaxis]
    return stretches, edges
