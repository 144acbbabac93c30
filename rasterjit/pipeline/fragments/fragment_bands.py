"""
Find the fragments of bands of pixel rows: several samples, layers or areas per pixel.

A band is a row of tiles, or fewer rows where fragments would take more than ``MAX_BYTES``.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.fragments import a_buffer, area_coverage
from rasterjit.pipeline.fragments.compositing import NOTHING
from rasterjit.pipeline.geometry.setup import TILE_SIZE
from rasterjit.pipeline.passes import KernelRow, Rows, rows_where
from rasterjit.pipeline.records import AlphaTests, Faces, Geometry, ScreenVertices, Viewport
from rasterjit.pipeline.visibility import alpha_test, tile_rasterizer, visibility_pass
from rasterjit.pipeline.visibility.alpha_test import AlphaComputation
from rasterjit.pipeline.visibility.visibility_pass import Coverage
from rasterjit.runtime.threads import Memory, Workers

START_CAPACITY = 16
"""Initial capacity, layers; grown where a band has more."""

MAX_LAYERS = 4096
"""Most transparent layers of a pixel; more are an error, never dropped."""

MAX_BYTES = 1 << 28
"""Most memory for the layers of one band, per thread."""

BYTES_PER_FACE = 8
"""Memory of a face number and its coverage."""

STEPS_PER_PIXEL = 16
"""Unit of sample positions: a sixteenth of a pixel."""

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
Sample positions relative to the pixel's centre, right and down, in sixteenths of a pixel.

References
----------
.. [1] Microsoft, "D3D11_STANDARD_MULTISAMPLE_QUALITY_LEVELS".
.. [2] The Khronos Group, "Vulkan 1.4 Specification", "Standard sample locations": the same.
"""


class Finder(NamedTuple):
    """Inputs for finding the faces of an image, without shading."""

    geometry: Geometry
    alpha_tests: AlphaTests | None


AnyFinder = TypeVar("AnyFinder", bound=NamedTuple)
"""A `Finder`, or another tuple with its fields."""


class PartitionedLists(NamedTuple):
    """The triangles of each tile, the opaque ones first."""

    starts: NDArray[np.int64]
    """(tiles + 1,)."""
    middles: NDArray[np.int64]
    """(tiles,): start of the transparent triangles."""
    partitioned: NDArray[np.int32]
    """(M,)."""
    faces: Faces
    screen: ScreenVertices
    depth_type: Any
    """Type that depths are rounded to before they are compared."""
    points: tuple[NDArray[Any], NDArray[np.int32]]
    """Depth and face number, (H, W), of opaque discs and spheres; (0, 0) without."""
    first_depth: NDArray[Any]
    """(H, W), written: the depth of the nearest surface at the first sample; (0, 0) without."""


class Band(NamedTuple):
    """The layers of some rows of the frame, for N samples of each pixel."""

    first_row: int
    opaque: NDArray[np.int32]
    """(N, R, W), the opaque face at each sample, -1 where there is none."""
    transparent: NDArray[np.int32]
    """(N, K, R, W), the transparent faces in front of it, nearest first, -1 where there are
    fewer."""
    depths: NDArray[Any] | None = None
    """(N, K, R, W), stored depths of the transparent faces."""


def get_sample_shifts(samples: int, grid_bits: int) -> NDArray[np.int32]:
    """Return the offset from each sample to the pixel's centre, (N, 2), sub-pixel units."""
    return np.array(SAMPLE_POSITIONS[samples], np.int32) * -((1 << grid_bits) // STEPS_PER_PIXEL)


def make_sampled_viewport(viewport: Viewport, samples: int | str) -> Viewport:
    """Make the viewport of a frame whose samples may lie anywhere in their pixels."""
    if samples == 1:
        return viewport
    return viewport._replace(sample_radius=1 << (viewport.grid_bits - 1))


def make_sampled_finder(finder: AnyFinder, samples: int | str) -> AnyFinder:
    """Make the `Finder` of a frame whose samples may lie anywhere in their pixels."""
    geometry = finder.geometry
    geometry = geometry._replace(viewport=make_sampled_viewport(geometry.viewport, samples))
    alpha_tests = (
        None if finder.alpha_tests is None else finder.alpha_tests._replace(geometry=geometry)
    )
    return finder._replace(geometry=geometry, alpha_tests=alpha_tests)


def split_tile_lists(
    coverage: Coverage, viewport: Viewport, is_blended: NDArray[np.uint8], workers: Workers
) -> PartitionedLists:
    """Partition the tiles' lists: opaque triangles before transparent ones."""
    lists = coverage.lists
    if lists is None or lists.objects is None:
        raise ValueError("coverage must hold the lists of its tiles, got none")
    starts, binned = lists.starts, lists.binned
    if viewport.sample_radius != lists.sample_radius:
        # More triangles touch a tile if samples lie off the centres.
        starts, binned, _, _ = visibility_pass.set_up_and_bin(
            lists.faces, lists.objects, coverage.screen, viewport, workers, skipped=lists.skipped
        )
    partitioned = workers.memory.empty((len(binned),), np.int32)
    middles = np.empty(len(starts) - 1, np.int64)
    a_buffer.split_lists(
        starts, binned, lists.faces, lists.objects.face_starts, is_blended, partitioned, middles
    )
    kind = coverage.depth.dtype
    points = make_no_points(kind)
    if coverage.points is not None and coverage.points.picture is not None:
        points = coverage.points.picture
    first_depth = np.empty((0, 0), kind) if coverage.first_depth is None else coverage.first_depth
    return PartitionedLists(
        starts, middles, partitioned, lists.faces, coverage.screen, kind, points, first_depth
    )


def list_peeling_kernels(depth_type: Any, has_alpha_tests: bool) -> Rows:
    """List the kernels of depth peeling."""
    rows = list_kernels(1, depth_type)
    if has_alpha_tests:
        rows += rows_where("", a_buffer.drop_discarded_in_place, alpha_test.find_alphas)
    return rows


def list_kernels(samples: int | str, depth_type: Any) -> Rows:
    """List the kernels that partition the tiles' lists, and find faces at samples or areas."""
    finding = KernelRow(a_buffer.find_layers, visibility_pass.name_depth_variant(depth_type))
    if samples == "area":
        finding = KernelRow(area_coverage.find_areas)
    return [KernelRow(a_buffer.split_lists), finding]


def make_no_points(depth_type: Any) -> tuple[NDArray[Any], NDArray[np.int32]]:
    """Make `PartitionedLists.points` of a picture without discs and spheres."""
    return np.empty((0, 0), depth_type), np.empty((0, 0), np.int32)


def find_layers(
    rows: tuple[int, int],
    lists: PartitionedLists,
    samples: int,
    finder: Finder,
    memory: Memory,
    max_kept: int | None = None,
) -> Iterator[Band]:
    """
    Yield the layers of some rows, in parts if they have many.

    Parameters
    ----------
    rows : (int, int)
        First row, and one past the last, of one row of tiles.
    lists : PartitionedLists
    samples : int
    finder : Finder
        A `Finder`, or another tuple with its fields.
    memory : Memory
    max_kept : int, optional
        Most layers of a sample to keep, the nearest ones.

    Raises
    ------
    ValueError
        If a pixel has more layers than are sorted, and all are kept.
    """
    viewport = finder.geometry.viewport
    width, height = viewport.width, rows[1] - rows[0]
    shifts = get_sample_shifts(samples, viewport.grid_bits)
    drawer, layer_scratch = a_buffer.make_layer_drawer(
        tile_rasterizer.make_tile_drawer(
            lists.partitioned, lists.faces, lists.screen, lists.depth_type, finder.alpha_tests
        )
    )
    deepest = np.empty(3, np.int64)
    capacity = 0 if len(lists.partitioned) == 0 else min(START_CAPACITY, max_kept or START_CAPACITY)
    while True:
        shape = samples, capacity, height, width
        found = memory.empty(shape, lists.depth_type), memory.empty(shape, np.int32)
        opaque = memory.empty((samples, height, width), np.int32)
        used = np.empty((samples, -(-width // TILE_SIZE)), np.int64)
        a_buffer.find_layers(
            rows, lists.starts, lists.middles, lists.points, viewport, shifts, opaque,
            lists.first_depth[slice(*rows)], found, used, deepest, *drawer[:3], layer_scratch,
        )  # fmt: skip
        needed, column, row = map(int, deepest)
        needed = needed if max_kept is None else min(needed, max_kept)
        # A stored depth and a face number.
        bytes_per_fragment = np.dtype(lists.depth_type).itemsize + 4
        most = min(MAX_LAYERS, MAX_BYTES // (bytes_per_fragment * samples * width))
        if needed > most:
            raise ValueError(
                f"the scene has {needed} transparent surfaces behind each other at the pixel in "
                f"column {column}, row {row}; at most {most} are sorted in a frame {width} wide "
                f"with {samples} samples"
            )
        if needed <= capacity:
            yield Band(rows[0], opaque, found[1][:, :needed], found[0][:, :needed])
            return
        if needed * samples * height * width * bytes_per_fragment > MAX_BYTES:
            middle = rows[0] + height // 2
            yield from find_layers((rows[0], middle), lists, samples, finder, memory, max_kept)
            yield from find_layers((middle, rows[1]), lists, samples, finder, memory, max_kept)
            return
        capacity = needed


def find_areas(
    rows: tuple[int, int], lists: PartitionedLists, finder: Finder, memory: Memory
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    """Find the faces visible in each pixel, their area coverage, and the background's."""
    viewport = finder.geometry.viewport
    shape = rows[1] - rows[0], viewport.width
    scratch = area_coverage.allocate_scratch(int(np.diff(lists.starts).max()))
    test, rest = AlphaComputation(finder.alpha_tests), memory.empty(shape, np.float32)
    deepest, count, begin = np.zeros(3, np.int64), 0, 0
    found: list[NDArray[Any]] = [np.empty((0, *shape), kind) for kind in (np.int32, np.float32)]
    while begin >= 0:
        # Grow the arrays, and copy what is written.
        previous, capacity = found, max(START_CAPACITY, count + count // 2)
        found = [memory.empty((capacity, *shape), written.dtype) for written in previous]
        for grown, written in zip(found, previous, strict=True):
            grown[: len(written)] = written
        found[0][len(previous[0]) :] = NOTHING
        begin = area_coverage.find_areas(
            rows, lists.starts, lists.partitioned, lists.faces, lists.screen, viewport, begin,
            *found, rest, deepest, scratch, test.query,
        )  # fmt: skip
        count, column, row = map(int, deepest)
        if count < 0 or count * shape[0] * shape[1] * BYTES_PER_FACE > MAX_BYTES:
            raise ValueError(
                f"samples must be 1, 2, 4, 8 or 16 for this scene, got 'area': the pixel in column "
                f"{column}, row {row} shows more faces than their areas can be found of"
            )
    return found[0][: max(count, 1)], found[1], rest
