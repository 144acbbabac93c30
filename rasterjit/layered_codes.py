"""
Put the faces of a pixel together in 8-bit sRGB codes, as programs do that know no linear light.

Every colour is shaded, fogged, tone mapped and rounded to codes by itself, alpha included. Then
codes are mixed as if they were light: transparent faces are laid over what lies behind them, from
the farthest to the nearest, and samples are averaged; the result is rounded to codes half up each
time. What is linear is, in the end, what these codes stand for.

The bands and layers are those of ``layered``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit import layered
from rasterjit.kernels import code_blending, layers, shading, shares
from rasterjit.kernels.setup import TILE_SIZE
from rasterjit.layered import MOST_BYTES, ROWS_AT_ONCE, Band, Lists, Shader, Target
from rasterjit.memory import Memory
from rasterjit.plan_layers import Layers
from rasterjit.scene.srgb import decoding_table
from rasterjit.stages import Coverage
from rasterjit.workers import Workers

BYTES_PER_COLOR = 4
"""Codes of red, green, blue and alpha."""


def rows_at_once(images: int, width: int) -> int:
    """Return how many rows of so many images are held at once."""
    per_row = images * width * BYTES_PER_COLOR
    return min(max(MOST_BYTES // 16 // per_row, 1), ROWS_AT_ONCE)


def lay_layers(
    band: Band, shader: Shader, color: NDArray[np.uint32], scratch: Any, memory: Memory
) -> None:
    """Write the colour of some rows, (R, W), one sample each: layers over each other."""
    levels, width = band.transparent.shape[1], color.shape[1]
    for part in layered.parts_of(len(color), rows_at_once(levels + 1, width)):
        first, target = band.first_row + part.start, color[part]
        images = [*band.transparent[0, :, part], band.opaque[0, part]]
        if levels == 0:
            shader.code_last(images[0], first, target, scratch)
            continue
        stack = memory.empty((levels + 1, *target.shape), np.uint32)
        # From front to back, for nothing is shaded behind what is opaque.
        for level in range(levels):
            shader.code(images[level], first, stack[level], scratch)
            code_blending.hide_behind(stack, level, images[level + 1])
        shader.code_last(images[levels], first, stack[levels], scratch)
        code_blending.lay_codes(stack, target)


def mix_layers(
    band: Band, shader: Shader, color: NDArray[np.uint32], scratch: Any, memory: Memory
) -> None:
    """Write the colour of some rows, (R, W), of layers at several samples."""
    samples, levels, _, width = band.transparent.shape
    most = samples * (levels + 1)
    # What is known of one face in one pixel: its number and its colour.
    for part in layered.parts_of(len(color), rows_at_once(2 * most, width)):
        first, target = band.first_row + part.start, color[part]
        opaque = np.ascontiguousarray(band.opaque[:, part])
        transparent = np.ascontiguousarray(band.transparent[:, :, part])
        shown = memory.empty((most, *target.shape), np.int32)
        count = int(layers.list_faces(opaque, transparent, shown))
        colors = memory.empty((count, *target.shape), np.uint32)
        behind = memory.empty(target.shape, np.uint32)
        for faces, own in zip(shown, colors, strict=False):
            shader.code(faces, first, own, scratch)
        shader.code_backdrop(first, behind)
        code_blending.mix_codes(opaque, transparent, colors, behind, target)


def code_rows(
    rows: tuple[int, int],
    plan: Layers,
    lists: Lists,
    shader: Shader,
    color: NDArray[np.uint32],
    memory: Memory,
) -> None:
    """Write the colour of one row of tiles, (R, W)."""
    scratch = shading.scratch_memory(
        shading.sample_rows(shader.surface, shader.lighting), shader.surface.textures is not None
    )
    no_linear = np.empty((len(color), 0, 4), np.float32)
    if plan.samples == "area":
        layered.mix_areas(rows, lists, shader, Target(no_linear, color), scratch, memory)
        return
    samples = int(plan.samples)
    found = shares.samples_memory(samples)
    for band in layered.find_layers(rows, lists, samples, shader, memory, plan.most):
        start = band.first_row - rows[0]
        part = slice(start, start + band.opaque.shape[1])
        if samples == 1:
            lay_layers(band, shader, color[part], scratch, memory)
        elif band.transparent.shape[1] == 0:
            target = Target(no_linear[part], color[part])
            layered.mix_faces(band.first_row, band.opaque, found, shader, target, scratch, memory)
        else:
            mix_layers(band, shader, color[part], scratch, memory)


def shade(
    plan: Layers,
    coverage: Coverage,
    shader: Shader,
    linear: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    workers: Workers,
) -> None:
    """
    Shade a frame whose pixels show several faces, over each other or beside each other.

    Takes what ``layered.shade`` takes.

    Raises
    ------
    ValueError
        If a pixel has more layers than are sorted, and all are seen.
    """
    shader = layered.at_samples(shader, plan.samples)._replace(coding=shader.encoding)
    viewport = shader.geometry.viewport
    lists = layered.part_lists(coverage, viewport, plan.is_blended, workers)
    packed = None if color is None else color.view(np.uint32)[:, :, 0]
    light = decoding_table().copy()

    def code_tiles(first: int) -> None:
        last = min(first + TILE_SIZE, viewport.height)
        if packed is None:
            rows = workers.memory.empty((last - first, viewport.width), np.uint32)
        else:
            rows = packed[first:last]
        code_rows((first, last), plan, lists, shader, rows, workers.memory)
        if linear is not None:
            code_blending.decode_rows(rows, light, linear[first:last])

    workers.run(code_tiles, [(first,) for first in range(0, viewport.height, TILE_SIZE)])
