"""
Put the faces of a pixel together in 8-bit sRGB codes, as programs do that know no linear light.

Every colour is shaded, fogged, tone mapped and rounded to codes by itself, alpha included. Then
codes are mixed as if they were light: transparent faces are laid over what lies behind them, from
the farthest to the nearest, and samples are averaged; the result is rounded to codes half up each
time. What is linear is, in the end, what these codes stand for.

The bands and layers are those of ``layers``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.fragments import (
    bands,
    compositing,
    drawing_order,
    encoded,
    plain_codes,
)
from rasterjit.pipeline.fragments.bands import MOST_BYTES, Band, Lists
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.passes import KernelRow, Rows, rows_where
from rasterjit.pipeline.visibility.draw import Coverage
from rasterjit.rendering import layers
from rasterjit.rendering.layers import ROWS_AT_ONCE, ColorRows, Shader
from rasterjit.runtime.threads import Memory, Workers
from rasterjit.scene.imitation import shown_by_codes
from rasterjit.survey.blending import PixelLayers
from rasterjit.survey.plan import RenderPlan

BYTES_PER_COLOR = 4
"""Codes of red, green, blue and alpha."""


def rows_at_once(images: int, width: int) -> int:
    """Return how many rows of so many images are held at once."""
    per_row = images * width * BYTES_PER_COLOR
    return min(max(MOST_BYTES // 16 // per_row, 1), ROWS_AT_ONCE)


def lay_layers(band: Band, shader: Shader, color: NDArray[np.uint32], memory: Memory) -> None:
    """Write the colour of some rows, (R, W), one sample each: layers over each other."""
    levels, width = band.transparent.shape[1], color.shape[1]
    for part in layers.parts_of(len(color), rows_at_once(levels + 1, width)):
        first, target = band.first_row + part.start, color[part]
        images = [*band.transparent[0, :, part], band.opaque[0, part]]
        if levels == 0:
            shader.code_last(images[0], first, target)
            continue
        stack = memory.empty((levels + 1, *target.shape), np.uint32)
        # From front to back, for nothing is shaded behind what is opaque.
        for level in range(levels):
            shader.code(images[level], first, stack[level])
            encoded.hide_behind(stack, level, images[level + 1])
        shader.code_last(images[levels], first, stack[levels])
        encoded.lay_codes(stack, target)


def mix_layers(band: Band, shader: Shader, color: NDArray[np.uint32], memory: Memory) -> None:
    """Write the colour of some rows, (R, W), of layers at several samples."""
    samples, levels, _, width = band.transparent.shape
    most = samples * (levels + 1)
    # What is known of one face in one pixel: its number and its colour.
    for part in layers.parts_of(len(color), rows_at_once(2 * most, width)):
        first, target = band.first_row + part.start, color[part]
        opaque = np.ascontiguousarray(band.opaque[:, part])
        transparent = np.ascontiguousarray(band.transparent[:, :, part])
        shown = memory.empty((most, *target.shape), np.int32)
        count = int(compositing.list_faces(opaque, transparent, shown))
        colors = memory.empty((count, *target.shape), np.uint32)
        behind = memory.empty(target.shape, np.uint32)
        if count > 0:
            shader.code(shown[:count], first, colors)
        shader.code_backdrop(first, behind)
        encoded.mix_codes(opaque, transparent, colors, behind, target)


def code_rows(
    rows: tuple[int, int],
    plan: PixelLayers,
    lists: Lists,
    shader: Shader,
    color: NDArray[np.uint32],
    memory: Memory,
) -> None:
    """Write the colour of one row of tiles, (R, W)."""
    no_linear = np.empty((len(color), 0, 4), np.float32)
    if plan.samples == "area":
        layers.mix_areas(rows, lists, shader, ColorRows(no_linear, color), memory)
        return
    samples = int(plan.samples)
    for band in bands.find_layers(rows, lists, samples, shader, memory, plan.most):
        start = band.first_row - rows[0]
        part = slice(start, start + band.opaque.shape[1])
        if plan.in_order and band.transparent.shape[1] > 1:
            drawing_order.keep_drawn(band.transparent)
        if samples == 1:
            lay_layers(band, shader, color[part], memory)
        elif shader.plain is not None:
            starts = shader.placement.face_starts
            plain_codes.mix_plain_codes(band.opaque, *shader.plain, starts, color[part])
        elif band.transparent.shape[1] == 0:
            target = ColorRows(no_linear[part], color[part])
            layers.mix_opaque(band, shader, target, memory)
        else:
            mix_layers(band, shader, color[part], memory)


def kernels_of(plan: RenderPlan) -> Rows:
    """Return the kernels that `shade` calls besides stages."""
    rows, kernels = layers.shared_kernels(plan), []
    has_samples = plan.layers.samples != 1
    if plan.layers.has_blended:
        kernels = [encoded.hide_behind, encoded.lay_codes]
        if has_samples:
            kernels = [compositing.list_faces, encoded.mix_codes]
        if plan.layers.in_order:
            kernels = [drawing_order.keep_drawn, *kernels]
    rows += rows_where(layers.SEVERAL, *kernels)
    if "linear" in plan.outputs:
        rows.append(KernelRow(encoded.decode_rows))
    return rows


def shade(
    plan: PixelLayers,
    coverage: Coverage,
    shader: Shader,
    linear: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    workers: Workers,
) -> None:
    """
    Shade a frame whose pixels show several faces, over each other or beside each other.

    Takes what ``layers.shade`` takes.

    Raises
    ------
    ValueError
        If a pixel has more layers than are sorted, and all are seen.
    """
    shader = shader._replace(has_codes=True)
    if shader.plain is not None:
        shader = bands.at_samples(shader, plan.samples)
    elif plan.at_centers:
        shader = bands.at_samples(shader.ready(), plan.samples)
    else:
        shader = bands.at_samples(shader, plan.samples).ready()
    viewport = shader.geometry.viewport
    lists = bands.part_lists(coverage, viewport, plan.is_blended, workers)
    packed = None if color is None else color.view(np.uint32)[:, :, 0]
    light = shown_by_codes(shader.encoding).copy()

    def code_tiles(first: int) -> None:
        last = min(first + TILE_SIZE, viewport.height)
        if packed is None:
            rows = workers.memory.empty((last - first, viewport.width), np.uint32)
        else:
            rows = packed[first:last]
        code_rows((first, last), plan, lists, shader, rows, workers.memory)
        if linear is not None:
            encoded.decode_rows(rows, light, linear[first:last])

    workers.run(code_tiles, [(first,) for first in range(0, viewport.height, TILE_SIZE)])
