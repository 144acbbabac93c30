"""
Lay transparent faces over others, in views that are drawn in groups.

What ``layers.lay_layers`` does of one frame, called in machine code. How many layers rows of tiles
have is known when they are found: what is called for layers that there are not is left out, and a
view that has more than there is room for is drawn as any frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline import encode
from rasterjit.pipeline.fragments import bands, compositing, fragments
from rasterjit.pipeline.fragments.bands import Finder
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.visibility import nearest
from rasterjit.rendering.bound_calls import ALWAYS, BoundCalls, When
from rasterjit.rendering.layers import ROWS_AT_ONCE, parts_of
from rasterjit.rendering.mixing import BoundLists
from rasterjit.rendering.shading import Shading
from rasterjit.survey.effect import Active, PictureArrays, acting
from rasterjit.survey.plan import RenderPlan

MOST_LAYERS = 8
"""Transparent surfaces behind each other that there is room for; few pixels show more."""


class _LayerMemory(NamedTuple):
    """What rows are laid over each other in."""

    opaque: NDArray[np.int32]
    """(R * W,): the opaque faces of a row of tiles."""
    layers: tuple[NDArray[np.float32], NDArray[np.int32]]
    """(K * R * W,) each: the transparent ones before them."""
    colors: NDArray[np.float32]
    """(P, W, 4), of the rows that are laid at once."""
    sums: NDArray[np.float32]
    """(P, W, 4)."""
    linear: NDArray[np.float32]
    """(2, P, W, 4): before and after effects act on them."""


class _LayerCalls(NamedTuple):
    """How rows are laid."""

    calls: BoundCalls
    plan: RenderPlan
    shading: Shading
    toned: Sequence[Active]
    """Effects that act on what is laid."""
    hidden: Sequence[Active]
    """Effects that show something where no face is."""
    picture: PictureArrays
    block: NDArray[np.int64]
    memory: _LayerMemory


def memory_of(plan: RenderPlan) -> int:
    """Return how much memory laying takes beside the picture, about, bytes."""
    of_layers = 8 * MOST_LAYERS * TILE_SIZE + 4 * TILE_SIZE
    return plan.size[0] * (of_layers + 4 * 16 * ROWS_AT_ONCE)


def _memory(width: int) -> _LayerMemory:
    """Return memory for rows so wide."""
    count, shape = TILE_SIZE * width, (ROWS_AT_ONCE, width, 4)
    return _LayerMemory(
        np.empty(count, np.int32),
        (np.empty(MOST_LAYERS * count, np.float32), np.empty(MOST_LAYERS * count, np.int32)),
        np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty((2, *shape), np.float32),
    )  # fmt: skip


def add_layering(
    calls: BoundCalls, lists: BoundLists, plan: RenderPlan, finder: Finder, shading: Shading,
    effects: Sequence[Active], picture: PictureArrays, block: NDArray[np.int64],
) -> None:  # fmt: skip
    """
    Call what writes the colours of transparent faces over others, one sample a pixel.

    Parameters
    ----------
    calls : BoundCalls
        Changed.
    lists : BoundLists
        Of the picture.
    plan : RenderPlan
        Its layers say of each object whether it is blended, in view or not.
    finder : Finder
    shading : Shading
    effects : sequence of Active
    picture : PictureArrays
        Its colours are written.
    block : array
        A block of samples.
    """
    viewport, memory = finder.geometry.viewport, _memory(plan.size[0])
    own = acting(effects, "mixed"), acting(effects, "background")
    way = _LayerCalls(calls, plan, shading, *own, picture, block, memory)
    width, shifts = viewport.width, bands.sample_shifts(1, viewport.grid_bits)
    parted, middles = np.empty_like(lists.binned), np.empty(len(lists.starts) - 1, np.int64)
    split = calls.bound(
        fragments.split_lists, lists.starts, lists.binned, lists.faces, lists.objects.face_starts,
        plan.layers.is_blended, parted, middles,
    )  # fmt: skip
    calls.call(split)
    drawer, alone = fragments.layer_drawer(
        nearest.tile_drawer(parted, lists.faces, lists.screen, np.float32, finder.alpha_tests)
    )
    points = bands.no_points(np.float32)
    calls.kept += [drawer, alone, points]
    used = np.empty((1, lists.columns), np.int64)
    for top in range(0, viewport.height, TILE_SIZE):
        rows = top, min(top + TILE_SIZE, viewport.height)
        shape = rows[1] - rows[0], width
        count = shape[0] * shape[1]
        opaque = memory.opaque[:count].reshape(1, *shape)
        layers = tuple(
            array[: MOST_LAYERS * count].reshape(1, MOST_LAYERS, *shape) for array in memory.layers
        )
        deepest = np.zeros(3, np.int64)
        found = calls.bound(
            fragments.find_layers, rows, lists.starts, middles, points, viewport, shifts, opaque,
            points[0], layers, used, deepest, *drawer[:3], alone,
        )  # fmt: skip
        calls.call(found)
        calls.limit(deepest.ctypes.data, MOST_LAYERS)
        images = [*layers[1][0], opaque[0]]
        for part in parts_of(shape[0], ROWS_AT_ONCE):
            _lay_part(way, [image[part] for image in images], top + part.start, deepest)


def _lay_part(
    way: _LayerCalls, images: Sequence[NDArray[np.int32]], first: int, deepest: NDArray[np.int64]
) -> None:
    """Call what lays images of faces over each other, (P, W) each, the opaque one last."""
    calls, memory, place = way.calls, way.memory, deepest.ctypes.data
    *transparent, opaque = images
    count, of_frame = len(opaque), slice(first, first + len(opaque))
    sums, colors = memory.sums[:count], memory.colors[:count]
    target, after = memory.linear[:, :count]
    if way.picture.linear.shape[1]:
        target = way.picture.linear[of_frame]

    def shade(
        faces: NDArray[np.int32], linear: NDArray[np.float32],
        painted: tuple[NDArray[np.float32], int] | None = None, when: When = ALWAYS,
    ) -> None:  # fmt: skip
        no_color = np.empty((count, 0), np.uint32)
        stages = way.shading.listed(faces, first, count, painted, linear, no_color)
        calls.run(stages, way.block, when)

    any_layer = place, 1, MOST_LAYERS
    calls.call(calls.bound(compositing.start_sums, sums), when=any_layer)
    for level, faces in enumerate(transparent):
        shade(faces, colors, None, (place, level + 1, MOST_LAYERS))
        for behind, when in (
            (images[level + 1], (place, level + 2, MOST_LAYERS)),
            (opaque, (place, level + 1, level + 1)),
        ):
            laid = calls.bound(compositing.lay_under, colors, faces, behind, sums)
            calls.call(laid, when=when)
    # What is mapped comes over the background when it is mapped.
    shade(opaque, target, (np.zeros(4, np.float32), 0) if way.toned else None)
    behind_all = PictureArrays(opaque, target, np.empty((count, 0), np.uint32))
    for one in way.hidden:
        for kernel, arguments in one.effect.calls(one.record, way.plan, behind_all, first):
            calls.call(calls.bound(kernel, *arguments))
    calls.call(calls.bound(compositing.finish_sums, sums, target), when=any_layer)
    color, table = way.picture.color[of_frame], encode.encoding_table()
    for one in way.toned:
        own = one.effect.calls_mixed(one.record, target, way.plan.background, after)
        for kernel, arguments in own:
            calls.call(calls.bound(kernel, *arguments))
    if color.shape[1]:
        shown = after if way.toned else target
        calls.call(calls.bound(encode.encode_rows, shown, table, color))
