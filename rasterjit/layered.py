"""
Shade a frame whose pixels show more than one face, and put their colours together.

The frame is done in bands: rows of one row of tiles. Of each band the layers are found, images of
face numbers, which are shaded as any frame is, one after the other, and laid over each other. So no
more memory is taken than for the layers of one band for each thread; a band with so many layers
that they take more than ``MOST_BYTES`` is cut into bands with fewer rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit import stages
from rasterjit.kernels import backgrounds, layers, resolve, shading, transparency
from rasterjit.kernels.records import (
    Cutouts,
    Encoding,
    Faces,
    Geometry,
    Lighting,
    Placement,
    ScreenVertices,
    Surface,
)
from rasterjit.kernels.setup import TILE_SIZE
from rasterjit.memory import Memory
from rasterjit.plan_layers import Layers
from rasterjit.stages import Coverage
from rasterjit.workers import Workers

FIRST_GUESS = 16
"""Layers that there is room for at first; more are made where a band has more."""

MOST_LAYERS = 4096
"""Transparent surfaces behind each other that are sorted; more are an error, never left out."""

MOST_BYTES = 1 << 28
"""Memory that the layers of one band may take, of each thread."""

BYTES_PER_FRAGMENT = 8
"""A float32 depth and an int32 face number."""

ROWS_AT_ONCE = 16
"""Rows of a band that are shaded and put together at once: their colours stay in L2."""

CENTRE = np.zeros((1, 2), np.int32)
"""The one sample of a pixel, as `transparency.find_layers` takes it."""


class Shader(NamedTuple):
    """What it takes to shade an image of face numbers."""

    geometry: Geometry
    placement: Placement
    surface: Surface
    lighting: Lighting | None
    background: NDArray[np.float32]
    """(4,) linear."""
    encoding: Encoding
    sky: stages.Sky | None = None
    """The environment, if it is seen where no face is."""


class Lists(NamedTuple):
    """The triangles of each tile, the opaque ones first."""

    starts: NDArray[np.int64]
    """(tiles + 1,)."""
    middles: NDArray[np.int64]
    """(tiles,): where the transparent ones begin."""
    parted: NDArray[np.int32]
    """(M,)."""
    faces: Faces
    screen: ScreenVertices
    cutouts: Cutouts | None


class Band(NamedTuple):
    """The layers of some rows of the frame."""

    first_row: int
    opaque: NDArray[np.int32]
    """(R, W), the opaque face at each pixel, -1 where there is none."""
    transparent: NDArray[np.int32]
    """(K, R, W), the transparent faces in front of it, nearest first, -1 where there are fewer."""


def part_lists(
    coverage: Coverage, face_starts: NDArray[np.int64], is_blended: NDArray[np.uint8]
) -> Lists:
    """Return the tiles' lists with the opaque triangles before the transparent ones."""
    lists = coverage.lists
    if lists is None:
        raise ValueError("coverage must hold the lists of its tiles, got None")
    parted = np.empty(len(lists.binned), np.int32)
    middles = np.empty(len(lists.starts) - 1, np.int64)
    transparency.split_lists(
        lists.starts, lists.binned, lists.faces, face_starts, is_blended, parted, middles
    )
    return Lists(lists.starts, middles, parted, lists.faces, coverage.screen, coverage.cutouts)


def find_layers(
    rows: tuple[int, int], lists: Lists, geometry: Geometry, scratch: Any, memory: Memory
) -> Iterator[Band]:
    """
    Yield the layers of some rows, in parts if they have many.

    Parameters
    ----------
    rows : (int, int)
        First row, and one past the last, of one row of tiles.
    lists : Lists
    geometry : Geometry
    scratch : tuple
        From ``transparency.scratch_memory``.
    memory : Memory

    Raises
    ------
    ValueError
        If a pixel has more layers than are sorted.
    """
    viewport = geometry.viewport
    width, height = viewport.width, rows[1] - rows[0]
    room = FIRST_GUESS
    while True:
        shape = 1, room, height, width
        found = memory.empty(shape, np.float32), memory.empty(shape, np.int32)
        opaque = memory.empty((1, height, width), np.int32)
        used = np.empty((1, -(-width // TILE_SIZE)), np.int64)
        needed, column, row = transparency.find_layers(
            rows, lists.starts, lists.middles, lists.parted, lists.faces, lists.screen, viewport,
            CENTRE, opaque, found, used, scratch, lists.cutouts,
        )  # fmt: skip
        if needed <= room:
            yield Band(rows[0], opaque[0], found[1][0, :needed])
            return
        most = min(MOST_LAYERS, MOST_BYTES // (BYTES_PER_FRAGMENT * width))
        if needed > most:
            raise ValueError(
                f"the scene has {needed} transparent surfaces behind each other at the pixel in "
                f"column {column}, row {row}; at most {most} are sorted in a frame {width} wide"
            )
        if needed * height * width * BYTES_PER_FRAGMENT > MOST_BYTES:
            middle = rows[0] + height // 2
            yield from find_layers((rows[0], middle), lists, geometry, scratch, memory)
            yield from find_layers((middle, rows[1]), lists, geometry, scratch, memory)
            return
        room = needed


def shade_band(
    band: Band, shader: Shader, linear: NDArray[np.float32], scratch: Any, memory: Memory
) -> None:
    """Write the linear colour of some rows, (R, W, 4), the layers over each other."""
    no_color = np.empty((len(linear), 0), np.uint32)

    def shade_image(faces: NDArray[np.int32], target: NDArray[np.float32]) -> None:
        shading.shade_rows(
            faces, band.first_row, shader.geometry, shader.placement, shader.surface,
            shader.lighting, shader.background, shader.encoding, target, no_color, scratch,
        )  # fmt: skip

    def shade_behind() -> None:
        shade_image(band.opaque, linear)
        if shader.sky is not None:
            backgrounds.show_environment(
                band.opaque, band.first_row, *shader.sky, shader.encoding, linear, no_color
            )

    if len(band.transparent) == 0:
        shade_behind()
        return
    colors, sums = memory.empty(linear.shape, np.float32), memory.empty(linear.shape, np.float32)
    layers.start_sums(sums)
    for faces, behind in pairwise([*band.transparent, band.opaque]):
        shade_image(faces, colors)
        layers.lay_under(colors, faces, behind, sums)
    shade_behind()
    layers.finish_sums(sums, linear)


def shade(
    plan: Layers,
    coverage: Coverage,
    shader: Shader,
    linear: NDArray[np.float32] | None,
    color: NDArray[np.uint8] | None,
    workers: Workers,
) -> None:
    """
    Shade a frame with transparent surfaces.

    Parameters
    ----------
    plan : Layers
    coverage : Coverage
        With its lists.
    shader : Shader
    linear : (H, W, 4) float32 or None
        Written, if the frame has it.
    color : (H, W, 4) uint8 or None
        Written, if the frame has it.
    workers : Workers

    Raises
    ------
    ValueError
        If a pixel has more layers than are sorted.
    """
    viewport, surface, memory = shader.geometry.viewport, shader.surface, workers.memory
    lists = part_lists(coverage, shader.placement.face_starts, plan.is_blended)
    rows = shading.sample_rows(surface, shader.lighting)
    encoding, behind = shader.encoding, shader.background
    if encoding.tone is not None:
        # What is given as a colour is shown as given: it comes behind when tones are mapped.
        shader = shader._replace(background=np.zeros(4, np.float32))

    def shade_tiles(first: int) -> None:
        scratch = shading.scratch_memory(rows, surface.textures is not None)
        all_rows = first, min(first + TILE_SIZE, viewport.height)
        drawing = transparency.scratch_memory(lists.cutouts is not None)
        for band in find_layers(all_rows, lists, shader.geometry, drawing, memory):
            for start in range(0, len(band.opaque), ROWS_AT_ONCE):
                part = slice(start, start + ROWS_AT_ONCE)
                some = Band(band.first_row + start, band.opaque[part], band.transparent[:, part])
                shape = (*some.opaque.shape, 4)
                place = slice(some.first_row, some.first_row + shape[0])
                target = memory.empty(shape, np.float32) if linear is None else linear[place]
                shade_band(some, shader, target, scratch, memory)
                if color is not None:
                    packed = color.view(np.uint32)[place, :, 0]
                    if encoding.tone is None:
                        resolve.encode_rows(target, encoding.table, packed)
                    else:
                        backgrounds.show_over(target, behind, encoding, packed)

    workers.run(shade_tiles, [(first,) for first in range(0, viewport.height, TILE_SIZE)])
