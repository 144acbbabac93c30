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
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rasterjit import stages
from rasterjit.backdrops import Sky
from rasterjit.kernels import (
    area,
    backgrounds,
    layers,
    resolve,
    shading,
    shares,
    transparency,
)
from rasterjit.kernels.records import (
    Cutouts,
    Encoding,
    Faces,
    Geometry,
    Lighting,
    Placement,
    ScreenVertices,
    Surface,
    Viewport,
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
"""A depth of 32 bits and an int32 face number."""

ROWS_AT_ONCE = 16
"""Rows of a band that are shaded and put together at once: their colours stay in L2."""

STEPS = 16
"""Positions of samples are whole sixteenths of a pixel."""

SAMPLE_POSITIONS = {
    1: ((0, 0),),
    2: ((4, 4), (-4, -4)),
    4: ((-2, -6), (6, -2), (-6, 2), (2, 6)),
    8: ((1, -3), (-1, 3), (5, 1), (-3, -5), (-5, 5), (-7, -1), (3, 7), (7, -7)),
    16: (
        (1, 1), (-1, -3), (-3, 2), (4, -1), (-5, -2), (2, 5), (5, 3), (3, -5),
        (-2, 6), (0, -7), (-4, -6), (-6, 4), (-8, 0), (7, -4), (6, 7), (-7, -8),
    ),
}  # fmt: skip
"""
Where the samples of a pixel lie, from its centre to the right and down, in sixteenths of a pixel.

References
----------
.. [1] Microsoft, "D3D11_STANDARD_MULTISAMPLE_QUALITY_LEVELS".
.. [2] The Khronos Group, "Vulkan 1.4 Specification", "Standard sample locations": the same.
"""


class Shader(NamedTuple):
    """What it takes to shade an image of face numbers."""

    geometry: Geometry
    placement: Placement
    surface: Surface
    lighting: Lighting | None
    background: NDArray[np.float32]
    """(4,) linear."""
    encoding: Encoding
    sky: Sky | None = None
    """The environment, if it is seen where no face is."""
    cutouts: Cutouts | None = None
    """The objects that have holes."""
    coding: Encoding | None = None
    """How colours become codes before they are mixed; ``None`` -> light is mixed."""

    def shade(
        self, faces: NDArray[np.int32], first_row: int, linear: NDArray[np.float32], scratch: Any
    ) -> None:
        """Write the linear colour of an image of faces, (R, W), alone, as if in front of all."""
        no_color = np.empty((len(linear), 0), np.uint32)
        shading.shade_rows(
            faces, first_row, self.geometry, self.placement, self.surface, self.lighting,
            self.background, self.encoding, linear, no_color, scratch,
        )  # fmt: skip

    def shade_last(
        self, faces: NDArray[np.int32], first_row: int, linear: NDArray[np.float32], scratch: Any
    ) -> None:
        """Write the same, and the environment where no face is."""
        self.shade(faces, first_row, linear, scratch)
        if self.sky is not None:
            no_color = np.empty((len(linear), 0), np.uint32)
            backgrounds.show_environment(
                faces, *self.sky.from_row(first_row), self.encoding, linear, no_color
            )

    def backdrop(
        self, shape: tuple[int, int], first_row: int, memory: Memory
    ) -> NDArray[np.float32]:
        """Return what is seen behind all faces of some rows, (R, 4, W), or (1, 4, W) if alike."""
        height, width = shape
        if self.coding is not None:
            return self._coded_backdrop(shape, first_row, memory)
        if self.sky is None:
            return np.repeat(self.background, width).reshape(1, 4, width)
        linear = memory.empty((*shape, 4), np.float32)
        nothing = np.full((height, width), -1, np.int32)
        no_color = np.empty((height, 0), np.uint32)
        backgrounds.show_environment(
            nothing, *self.sky.from_row(first_row), self.encoding, linear, no_color
        )
        return np.ascontiguousarray(linear.transpose(0, 2, 1))

    def _coded_backdrop(
        self, shape: tuple[int, int], first_row: int, memory: Memory
    ) -> NDArray[np.float32]:
        """Return the same in codes, 0..255, as float32; alpha is divided by 255."""
        color = memory.empty(shape if self.sky is not None else (1, shape[1]), np.uint32)
        self.code_backdrop(first_row, color)
        codes = color.view(np.uint8).reshape(*color.shape, 4).transpose(0, 2, 1)
        codes = np.ascontiguousarray(codes, np.float32)
        codes[:, 3] /= np.float32(255.0)
        return codes

    def code_backdrop(self, first_row: int, color: NDArray[np.uint32]) -> None:
        """Write what is seen behind all faces of some rows, (R, W), in RGBA codes."""
        pixel = np.empty((1, 1), np.uint32)
        resolve.encode_rows(self.background.reshape(1, 1, 4), self.encoding.table, pixel)
        color[:] = pixel
        self._code_sky(np.full(color.shape, -1, np.int32), first_row, color)

    def code(
        self, faces: NDArray[np.int32], first_row: int, color: NDArray[np.uint32], scratch: Any
    ) -> None:
        """Write an image of faces, (R, W), alone, in RGBA codes; 0 where no face is."""
        nothing = np.zeros(4, np.float32)
        self._replace(background=nothing)._code(faces, first_row, color, scratch)

    def code_last(
        self, faces: NDArray[np.int32], first_row: int, color: NDArray[np.uint32], scratch: Any
    ) -> None:
        """Write the same, and what is seen behind all faces where no face is."""
        self._code(faces, first_row, color, scratch)
        self._code_sky(faces, first_row, color)

    def _code(
        self, faces: NDArray[np.int32], first_row: int, color: NDArray[np.uint32], scratch: Any
    ) -> None:
        """Write an image of faces in RGBA codes, and the background colour."""
        no_linear = np.empty((len(color), 0, 4), np.float32)
        shading.shade_rows(
            faces, first_row, self.geometry, self.placement, self.surface, self.lighting,
            self.background, self.encoding, no_linear, color, scratch,
        )  # fmt: skip

    def _code_sky(
        self, faces: NDArray[np.int32], first_row: int, color: NDArray[np.uint32]
    ) -> None:
        """Write the environment in RGBA codes where no face is, if it is seen."""
        if self.sky is not None:
            no_linear = np.empty((len(color), 0, 4), np.float32)
            backgrounds.show_environment(
                faces, *self.sky.from_row(first_row), self.encoding, no_linear, color
            )


class Sight(NamedTuple):
    """What it takes to find the faces of an image, without shading them."""

    geometry: Geometry
    cutouts: Cutouts | None


Seer = TypeVar("Seer", Shader, Sight)


class Target(NamedTuple):
    """Some rows of the picture, as far as they are wanted."""

    linear: NDArray[np.float32]
    """(R, W, 4), or (R, 0, 4)."""
    color: NDArray[np.uint32]
    """(R, W), or (R, 0)."""


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
    depth_type: Any
    """What depths are rounded to before they are compared."""


class Band(NamedTuple):
    """The layers of some rows of the frame, for N samples of each pixel."""

    first_row: int
    opaque: NDArray[np.int32]
    """(N, R, W), the opaque face at each sample, -1 where there is none."""
    transparent: NDArray[np.int32]
    """(N, K, R, W), the transparent faces in front of it, nearest first, -1 where there are
    fewer."""
    depths: NDArray[Any] | None = None
    """(N, K, R, W), their stored depths."""


def sample_shifts(samples: int, grid_bits: int) -> NDArray[np.int32]:
    """Return what moves each sample to the pixel's centre, (N, 2), units of the sub-pixel grid."""
    return np.array(SAMPLE_POSITIONS[samples], np.int32) * -((1 << grid_bits) // STEPS)


def sampled_viewport(viewport: Viewport, samples: int | str) -> Viewport:
    """Return the viewport of a frame whose samples may lie anywhere in their pixels."""
    if samples == 1:
        return viewport
    return viewport._replace(reach=1 << (viewport.grid_bits - 1))


def at_samples(shader: Seer, samples: int | str) -> Seer:
    """Return what it takes to see a frame whose samples may lie anywhere in their pixels."""
    geometry = shader.geometry
    geometry = geometry._replace(viewport=sampled_viewport(geometry.viewport, samples))
    cutouts = None if shader.cutouts is None else shader.cutouts._replace(geometry=geometry)
    return shader._replace(geometry=geometry, cutouts=cutouts)


def part_lists(
    coverage: Coverage, viewport: Viewport, is_blended: NDArray[np.uint8], workers: Workers
) -> Lists:
    """Return the tiles' lists with the opaque triangles before the transparent ones."""
    lists = coverage.lists
    if lists is None or lists.objects is None:
        raise ValueError("coverage must hold the lists of its tiles, got none")
    starts, binned = lists.starts, lists.binned
    if viewport.reach is not None:
        # More triangles reach a tile if samples lie beside the centres.
        starts, binned, _, _ = stages.set_up_and_bin(
            lists.faces, lists.objects, coverage.screen, viewport, workers
        )
    parted = workers.memory.empty((len(binned),), np.int32)
    middles = np.empty(len(starts) - 1, np.int64)
    transparency.split_lists(
        starts, binned, lists.faces, lists.objects.face_starts, is_blended, parted, middles
    )
    return Lists(starts, middles, parted, lists.faces, coverage.screen, coverage.depth.dtype)


def find_layers(
    rows: tuple[int, int],
    lists: Lists,
    samples: int,
    shader: Shader | Sight,
    memory: Memory,
    kept: int | None = None,
) -> Iterator[Band]:
    """
    Yield the layers of some rows, in parts if they have many.

    Parameters
    ----------
    rows : (int, int)
        First row, and one past the last, of one row of tiles.
    lists : Lists
    samples : int
    shader : Shader
    memory : Memory
    kept : int, optional
        Layers of a sample that are kept, the nearest ones: there is no room for others.

    Raises
    ------
    ValueError
        If a pixel has more layers than are sorted, and all are kept.
    """
    viewport = shader.geometry.viewport
    width, height = viewport.width, rows[1] - rows[0]
    shifts = sample_shifts(samples, viewport.grid_bits)
    scratch = transparency.scratch_memory(shader.cutouts is not None, lists.depth_type)
    room = 0 if len(lists.parted) == 0 else min(FIRST_GUESS, kept or FIRST_GUESS)
    while True:
        shape = samples, room, height, width
        found = memory.empty(shape, lists.depth_type), memory.empty(shape, np.int32)
        opaque = memory.empty((samples, height, width), np.int32)
        used = np.empty((samples, -(-width // TILE_SIZE)), np.int64)
        deepest = transparency.find_layers(
            rows, lists.starts, lists.middles, lists.parted, lists.faces, lists.screen, viewport,
            shifts, opaque, found, used, scratch, shader.cutouts,
        )  # fmt: skip
        needed, column, row = map(int, deepest)
        needed = needed if kept is None else min(needed, kept)
        most = min(MOST_LAYERS, MOST_BYTES // (BYTES_PER_FRAGMENT * samples * width))
        if needed > most:
            raise ValueError(
                f"the scene has {needed} transparent surfaces behind each other at the pixel in "
                f"column {column}, row {row}; at most {most} are sorted in a frame {width} wide "
                f"with {samples} samples"
            )
        if needed <= room:
            yield Band(rows[0], opaque, found[1][:, :needed], found[0][:, :needed])
            return
        if needed * samples * height * width * BYTES_PER_FRAGMENT > MOST_BYTES:
            middle = rows[0] + height // 2
            yield from find_layers((rows[0], middle), lists, samples, shader, memory, kept)
            yield from find_layers((middle, rows[1]), lists, samples, shader, memory, kept)
            return
        room = needed


def parts_of(height: int, most: int) -> list[slice]:
    """Return the parts of some rows that are shaded and put together at once."""
    return [slice(first, first + most) for first in range(0, height, most)]


def lay_layers(
    band: Band, shader: Shader, linear: NDArray[np.float32], scratch: Any, memory: Memory
) -> None:
    """Write the linear colour of some rows, (R, W, 4), one sample each: layers over each other."""
    for part in parts_of(len(linear), ROWS_AT_ONCE):
        first, target = band.first_row + part.start, linear[part]
        images = [*band.transparent[0, :, part], band.opaque[0, part]]
        if len(images) == 1:
            shader.shade_last(images[0], first, target, scratch)
            continue
        colors, sums = (memory.empty(target.shape, np.float32) for _ in range(2))
        layers.start_sums(sums)
        for faces, behind in pairwise(images):
            shader.shade(faces, first, colors, scratch)
            layers.lay_under(colors, faces, behind, sums)
        shader.shade_last(images[-1], first, target, scratch)
        layers.finish_sums(sums, target)


def mix_areas(
    rows: tuple[int, int],
    lists: Lists,
    shader: Shader,
    target: Target,
    scratch: Any,
    memory: Memory,
) -> None:
    """Write the colour of one row of tiles by the areas of opaque faces."""
    found = find_areas(rows, lists, shader, memory)
    mix_faces(rows[0], None, found, shader, target, scratch, memory)


def find_areas(
    rows: tuple[int, int], lists: Lists, shader: Shader | Sight, memory: Memory
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    """Return the faces that show in each pixel, their shares, and the share that shows none."""
    viewport = shader.geometry.viewport
    shape = rows[1] - rows[0], viewport.width
    own = area.scratch_memory(int(np.diff(lists.starts).max()))
    room = FIRST_GUESS
    while True:
        found = (
            memory.empty((room, *shape), np.int32),
            memory.empty((room, *shape), np.float32),
            memory.empty(shape, np.float32),
        )
        deepest = area.find_areas(
            rows, lists.starts, lists.parted, lists.faces, lists.screen, viewport, *found, own,
            shader.cutouts,
        )  # fmt: skip
        count, column, row = map(int, deepest)
        if count < 0 or count * shape[0] * shape[1] * BYTES_PER_FRAGMENT > MOST_BYTES:
            raise ValueError(
                f"samples must be 1, 2, 4, 8 or 16 for this scene, got 'area': the pixel in column "
                f"{column}, row {row} shows more faces than their areas can be found of"
            )
        if count <= room:
            break
        room = count
    return found[0][: max(count, 1)], found[1], found[2]


def mix_faces(
    first_row: int,
    opaque: NDArray[np.int32] | None,
    found: tuple[NDArray[Any], ...],
    shader: Shader,
    target: Target,
    scratch: Any,
    memory: Memory,
) -> None:
    """Write the colour of some rows whose pixels show shares of several opaque faces."""
    behind = shader.backdrop((len(target.color), shader.geometry.viewport.width), first_row, memory)
    shares.mix_faces(
        opaque, first_row, found, shader.geometry, shader.placement, shader.surface,
        shader.lighting, behind, shader.encoding, target.linear, target.color, scratch,
        shares.scratch_memory(), shader.coding,
    )  # fmt: skip


def mix_layers(
    band: Band, shader: Shader, linear: NDArray[np.float32], scratch: Any, memory: Memory
) -> None:
    """Write the linear colour of some rows, (R, W, 4), of layers at several samples."""
    samples, levels, _, width = band.transparent.shape
    # What is known of one face in one pixel: its number and its colour.
    per_row = samples * (levels + 1) * width * (4 + 16)
    rows = min(max(MOST_BYTES // 16 // per_row, 1), ROWS_AT_ONCE)
    for part in parts_of(len(linear), rows):
        first, target = band.first_row + part.start, linear[part]
        opaque = np.ascontiguousarray(band.opaque[:, part])
        transparent = np.ascontiguousarray(band.transparent[:, :, part])
        shown = memory.empty((samples * (levels + 1), *target.shape[:2]), np.int32)
        count = int(layers.list_faces(opaque, transparent, shown))
        colors = memory.empty((count, *target.shape), np.float32)
        behind = memory.empty(target.shape, np.float32)
        for faces, color in zip(shown, colors, strict=False):
            shader.shade(faces, first, color, scratch)
        shader.shade_last(np.full(target.shape[:2], -1, np.int32), first, behind, scratch)
        layers.mix_samples(opaque, transparent, colors, behind, target)


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
    encoding, behind = shader.encoding, shader.background
    shader = at_samples(shader, plan.samples)
    viewport = shader.geometry.viewport
    lists = part_lists(coverage, viewport, plan.is_blended, workers)
    if encoding.tone is not None:
        # Where tones are mapped the background, which is shown as given, comes behind at the end.
        shader = shader._replace(background=np.zeros(4, np.float32))

    nothing = np.empty((viewport.height, 0), np.uint32)
    packed = nothing if color is None else color.view(np.uint32)[:, :, 0]
    # Opaque faces are mixed and encoded at once.
    is_direct = plan.samples != 1 and not plan.has_blended and encoding.tone is None

    def shade_tiles(first: int) -> None:
        last = min(first + TILE_SIZE, viewport.height)
        shape = last - first, viewport.width * (linear is not None or not is_direct), 4
        rows = workers.memory.empty(shape, np.float32) if linear is None else linear[first:last]
        target = Target(rows, (packed if is_direct else nothing)[first:last])
        shade_rows((first, last), plan, lists, shader, target, workers.memory)
        if encoding.tone is not None:
            shown = workers.memory.empty(shape[:2], np.uint32)
            if color is not None:
                shown = packed[first:last]
            backgrounds.show_over(rows, behind, encoding, shown)
        elif color is not None and not is_direct:
            resolve.encode_rows(rows, encoding.table, packed[first:last])

    workers.run(shade_tiles, [(first,) for first in range(0, viewport.height, TILE_SIZE)])


def shade_rows(
    rows: tuple[int, int],
    plan: Layers,
    lists: Lists,
    shader: Shader,
    target: Target,
    memory: Memory,
) -> None:
    """Write the linear colour of one row of tiles; encoded as well if none is see-through."""
    scratch = shading.scratch_memory(
        shading.sample_rows(shader.surface, shader.lighting), shader.surface.textures is not None
    )
    if plan.samples == "area":
        mix_areas(rows, lists, shader, target, scratch, memory)
        return
    found = shares.samples_memory(int(plan.samples))
    for band in find_layers(rows, lists, int(plan.samples), shader, memory, plan.most):
        start = band.first_row - rows[0]
        part = Target(*(image[start : start + band.opaque.shape[1]] for image in target))
        if plan.samples == 1:
            lay_layers(band, shader, part.linear, scratch, memory)
        elif band.transparent.shape[1] == 0:
            mix_faces(band.first_row, band.opaque, found, shader, part, scratch, memory)
        else:
            mix_layers(band, shader, part.linear, scratch, memory)
