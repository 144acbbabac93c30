"""
Mix the faces that the samples of a pixel show, in views that are drawn in groups.

What ``layers.mix_opaque`` does of one frame, called in machine code. Rows of tiles follow each
other in the same memory, and in each the parts that are mixed at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import encode
from rasterjit.pipeline import views as drawing_views
from rasterjit.pipeline.fragments import bands, fragments, weights
from rasterjit.pipeline.fragments.bands import Finder
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.records import Faces, Objects, ScreenVertices
from rasterjit.pipeline.visibility import nearest
from rasterjit.rendering.bound_calls import BoundCalls
from rasterjit.rendering.layers import ROWS_MIXED_AT_ONCE, parts_of
from rasterjit.rendering.shading import Shading
from rasterjit.runtime.state import WORD
from rasterjit.survey.effect import Active, PictureArrays, acting
from rasterjit.survey.plan import RenderPlan


class BoundLists(NamedTuple):
    """What the faces of each tile are listed from, and in."""

    faces: Faces
    screen: ScreenVertices
    objects: Objects
    triangles: NDArray[np.int32]
    """(T,)."""
    boxes: NDArray[np.uint8]
    """(T, 4)."""
    columns: int
    """Of tiles."""
    counts: NDArray[np.int32]
    """(1, tiles + 1)."""
    starts: NDArray[np.int64]
    """(tiles + 1,)."""
    binned: NDArray[np.int32]
    """(M,)."""


class _MixingMemory(NamedTuple):
    """What some rows are mixed in; see ``weights``."""

    opaque: NDArray[np.int32]
    """(N, R, W): the faces of a row of tiles at each sample; others are of R rows or fewer."""
    shown: NDArray[np.int32]
    """(N * R * W,)."""
    shares: NDArray[np.float32]
    """(N * R * W,)."""
    rest: NDArray[np.float32]
    """(R, W)."""
    mixed: NDArray[np.float32]
    """(R, 4, W)."""
    others: NDArray[np.int32]
    """(2, C)."""
    linear: NDArray[np.float32]
    """(2, R, W, 4): before and after effects act on what is mixed; R is 0 where none does."""


class _MixingCalls(NamedTuple):
    """How rows are mixed."""

    calls: BoundCalls
    shading: Shading
    toned: Sequence[Active]
    """Effects that act on what is mixed."""
    background: NDArray[np.float32]
    """(4,) linear."""
    behind: NDArray[np.float32]
    """(H, W, 4), or (1, 1, 4): what faces are mixed with, linear."""
    picture: PictureArrays
    block: NDArray[np.int64]


def memory_of(plan: RenderPlan) -> int:
    """Return how much memory mixing takes beside the picture, about, bytes."""
    of_sample, of_pixel = 4 * TILE_SIZE + 8 * ROWS_MIXED_AT_ONCE, 52 * ROWS_MIXED_AT_ONCE
    return plan.size[0] * (int(plan.layers.samples) * of_sample + of_pixel)


def _memory(samples: int, width: int, has_toned: bool) -> _MixingMemory:
    """Return memory for so many samples of a pixel, in rows so wide."""
    rows = ROWS_MIXED_AT_ONCE
    count = samples * rows * width
    return _MixingMemory(
        np.empty(samples * TILE_SIZE * width, np.int32),
        np.empty(count, np.int32), np.empty(count, np.float32),
        np.empty((rows, width), np.float32), np.empty((rows, 4, width), np.float32),
        np.empty((2, weights.BLOCK_COLUMNS), np.int32),
        np.empty((2, rows * has_toned, width, 4), np.float32),
    )  # fmt: skip


def add_mixing(
    calls: BoundCalls, lists: BoundLists, plan: RenderPlan, finder: Finder, shading: Shading,
    effects: Sequence[Active], picture: PictureArrays, block: NDArray[np.int64],
) -> None:  # fmt: skip
    """
    Call what writes the colours of opaque faces at several samples.

    Parameters
    ----------
    calls : BoundCalls
        Changed.
    lists : BoundLists
        Of what reaches any sample.
    plan : RenderPlan
    finder : Finder
        With the reach of samples.
    shading : Shading
        Of its geometry.
    effects : sequence of Active
    picture : PictureArrays
        Its colours are written.
    block : array
        A block of samples.
    """
    viewport = finder.geometry.viewport
    width, samples = viewport.width, int(plan.layers.samples)
    toned = acting(effects, "mixed")
    behind = np.zeros((1, 1, 4), np.float32)
    if not toned:
        behind[:] = plan.background
    hidden = acting(effects, "background")
    if hidden:
        behind = np.empty((viewport.height, width, 4), np.float32)
        nothing = np.full((viewport.height, width), -1, np.int32)
        empty = PictureArrays(nothing, behind, np.empty((viewport.height, 0), np.uint32))
        for one in hidden:
            for kernel, arguments in one.effect.calls(one.record, plan, empty):
                calls.call(calls.bound(kernel, *arguments))
    way = _MixingCalls(calls, shading, toned, plan.background, behind, picture, block)
    memory = _memory(samples, width, bool(toned))
    shifts = bands.sample_shifts(samples, viewport.grid_bits)
    drawer, alone = fragments.layer_drawer(
        nearest.tile_drawer(lists.binned, lists.faces, lists.screen, np.float32, finder.alpha_tests)
    )
    points = bands.no_points(np.float32)
    calls.kept += [drawer, alone, points, behind]
    none = np.empty((samples, 0, 0, width), np.float32), np.empty((samples, 0, 0, width), np.int32)
    used, deepest = np.empty((samples, lists.columns), np.int64), np.empty(3, np.int64)
    for top in range(0, viewport.height, TILE_SIZE):
        rows = top, min(top + TILE_SIZE, viewport.height)
        height = rows[1] - rows[0]
        opaque = memory.opaque[: samples * height * width].reshape(samples, height, width)
        # Of opaque faces alone, lists end where transparent ones would begin.
        found = calls.bound(
            fragments.find_layers, rows, lists.starts, lists.starts[1:], points, viewport, shifts,
            opaque, points[0], none, used, deepest, *drawer[:3], alone,
        )  # fmt: skip
        calls.call(found)
        for part in parts_of(height, ROWS_MIXED_AT_ONCE):
            _mix_part(way, opaque, (part.start, min(part.stop, height)), top, memory)


def _mix_part(
    way: _MixingCalls,
    opaque: NDArray[np.int32],
    rows: tuple[int, int],
    top: int,
    memory: _MixingMemory,
) -> None:
    """Call what mixes some rows of a row of tiles, whose first row is given."""
    calls, (samples, _, width) = way.calls, opaque.shape
    count, of_frame = rows[1] - rows[0], slice(top + rows[0], top + rows[1])
    shown, shares = (
        array[: samples * count * width].reshape(samples, count, width)
        for array in (memory.shown, memory.shares)
    )
    rest, mixed, table = memory.rest[:count], memory.mixed[:count], encode.encoding_table()
    sharing = calls.bound(
        weights.share_samples, opaque, rows, shown, shares, rest, memory.others
    )  # fmt: skip
    steps = way.shading.mixing(shown, of_frame.start, shares, rest, mixed, False)
    # How many images of faces there are is known when they are listed.
    told = steps.place_of(0) + WORD
    behind = way.behind if len(way.behind) == 1 else way.behind[of_frame]
    calls.call(calls.bound(drawing_views.begin_mix, sharing.words, told, behind, mixed))
    calls.run(steps, way.block)
    linear, color = way.picture.linear[of_frame], way.picture.color[of_frame]
    if not way.toned:
        calls.call(calls.bound(weights.finish_mix, shares[0], rest, mixed, table, linear, color))
        return
    before, after = memory.linear[:, :count]
    if linear.shape[1]:
        before = linear
    no_color = np.empty((count, 0), np.uint32)
    calls.call(calls.bound(weights.finish_mix, shares[0], rest, mixed, table, before, no_color))
    for one in way.toned:
        for kernel, arguments in one.effect.calls_mixed(one.record, before, way.background, after):
            calls.call(calls.bound(kernel, *arguments))
    calls.call(calls.bound(encode.encode_rows, after, table, color))
