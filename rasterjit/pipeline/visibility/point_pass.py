"""
Run the rasterization of points: split them among threads, or expand squares to triangles.

See ``point_rasterizer`` for which pixels they cover. With one sample a pixel, all points are drawn
as such, after all triangles. For transparency or several samples, which draw triangles again,
squares are two triangles each; discs and spheres have none, and are a picture that is depth-tested
with the triangles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.geometry.projection import allocate_scratch
from rasterjit.pipeline.geometry.setup import GUARD_PIXELS
from rasterjit.pipeline.records import AlphaTests, ScreenVertices, Viewport
from rasterjit.pipeline.visibility.point_rasterizer import (
    DISC,
    IN_PIXELS,
    IN_UNITS,
    MAX_GRID_SIZE,
    NOT_POINTS,
    SPHERE,
    SQUARE,
    UNDRAWN_CODES,
    PointRows,
    PointView,
    draw_points,
    merge_pictures,
)
from rasterjit.pipeline.visibility.primitive_expansion import (
    Expansion,
    PointRule,
    Primitive,
    Primitives,
    Projected,
    find_pixels_per_unit,
)
from rasterjit.pipeline.visibility.tile_rasterizer import NOTHING, get_empty_depth
from rasterjit.runtime.threads import Workers, split_into_bands

MIN_POINTS_PER_THREAD = 1 << 16
"""Fewest points per thread: each thread draws a separate picture."""

SHAPE_COST = 16
"""Cost of a point of any other size or shape, in squares of one pixel."""

MAX_MERGED_BYTES = 1 << 29
"""Most memory for the threads' pictures."""


SHAPES = {"square": SQUARE, "disc": DISC, "sphere": SPHERE}


class PicturePoints(NamedTuple):
    """The points of a picture, for passes that need positions and normals on them."""

    rows: PointRows
    view: PointView
    viewport: Viewport
    picture: tuple[NDArray[Any], NDArray[np.int32]] | None = None
    """Depth and face number, (H, W), of points that are not triangles; ``None`` if no transparency
    or multisampling needs them."""

    @property
    def read(self) -> tuple[PointRows, PointView, Viewport]:
        """The arguments of stages and kernels."""
        return self.rows, self.view, self.viewport

    @property
    def has_spheres(self) -> bool:
        """Whether any points are spheres."""
        return bool((self.rows.shapes[:, 0] == SPHERE).any())


class DrawnPoints(NamedTuple):
    """All points of a picture, and their transforms."""

    positions: NDArray[np.float64] | NDArray[np.float32]
    """(V, 3), model space; projected in float64 for both types."""
    relative_from_model: NDArray[np.float64]
    """(O, 4, 4): to world axes with the origin at the eye."""
    points: PointRows
    view: PointView
    depth_coefficients: tuple[float, float, float]


def make_point_view(
    clip_from_relative: NDArray[np.float64],
    depth_coefficients: tuple[float, float, float],
    viewport: Viewport,
) -> PointView:
    """Compute the camera's rays through a picture, or through a part of one."""
    right, up, deeper, further = (row[:3] for row in clip_from_relative.tolist())
    # Away from the eye w grows, or, where w is constant, the stored depth falls.
    if any(further):
        away = _orientation_sign(right, up, further)
    else:
        away = -_orientation_sign(right, up, deeper) * math.copysign(1.0, depth_coefficients[1])
    width = viewport.left + viewport.width + viewport.right
    height = viewport.top + viewport.height + viewport.bottom
    across, down = find_pixels_per_unit(clip_from_relative, (width, height))
    return PointView(np.ascontiguousarray(clip_from_relative), away, across, down)


def _orientation_sign(a: list[float], b: list[float], c: list[float]) -> float:
    """Return the sign of the determinant of three rows."""
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return math.copysign(1.0, x * c[0] + y * c[1] + z * c[2])


def draw_all_points(
    cloud: DrawnPoints, viewport: Viewport, frame: tuple[NDArray[Any], NDArray[np.int32]],
    workers: Workers,
) -> NDArray[np.int64]:  # fmt: skip
    """
    Draw all points into a picture, with the same bits for any number of threads.

    Parameters
    ----------
    cloud : DrawnPoints
    viewport : Viewport
    frame : (depth (H, W), face_id (H, W) int32)
        Changed where points are nearer.
    workers : Workers

    Returns
    -------
    (4,) int64
        Number of points by outcome: see ``POINTS_OUTSIDE``.
    """
    points = cloud.points
    starts = points.vertex_starts
    owners = np.flatnonzero(points.shapes[:, 0] != NOT_POINTS)
    first, end = int(starts[owners[0]]), int(starts[owners[-1] + 1])
    is_square = points.shapes[owners, 0] == SQUARE
    costs = np.where(is_square & (points.size_ranges[owners, 1] == 0), 1, SHAPE_COST)
    cost = int(np.add.reduce((starts[owners + 1] - starts[owners]) * costs))
    picture_bytes = frame[0].nbytes + frame[1].nbytes
    min_cost = max(MIN_POINTS_PER_THREAD, frame[1].size // 4)
    chunks = max(min(workers.threads, cost // min_cost, MAX_MERGED_BYTES // picture_bytes + 1), 1)
    edges = [first + (end - first) * n // chunks for n in range(chunks + 1)]
    height, width = frame[1].shape
    pictures = (
        workers.memory.empty((chunks - 1, height, width), frame[0].dtype),
        workers.memory.empty((chunks - 1, height, width), np.int32),
    )
    clear_pictures(pictures)
    counts = np.zeros((chunks, 4), np.int64)
    shared = (
        np.ascontiguousarray(cloud.positions, np.float64),
        np.ascontiguousarray(cloud.relative_from_model), points, cloud.view,
        cloud.depth_coefficients, viewport,
    )  # fmt: skip
    workers.call(
        draw_points,
        [
            (
                (edges[n], edges[n + 1]), *shared,
                frame if n == 0 else (pictures[0][n - 1], pictures[1][n - 1]), counts[n],
                allocate_scratch(),
            )
            for n in range(chunks)
        ],
    )  # fmt: skip
    if chunks > 1:
        merge_into_frame(pictures, frame, workers)
    return np.add.reduce(counts, axis=0)


def clear_pictures(frame: tuple[NDArray[Any], NDArray[np.int32]]) -> None:
    """Clear a picture, or several."""
    frame[0].fill(get_empty_depth(frame[0].dtype))
    frame[1].fill(NOTHING)


def merge_into_frame(
    pictures: tuple[NDArray[Any], NDArray[np.int32]],
    frame: tuple[NDArray[Any], NDArray[np.int32]],
    workers: Workers,
) -> None:
    """Merge pictures (N, H, W) into the frame: the nearest sample of each pixel wins."""
    bands = split_into_bands(frame[1].shape, workers)
    workers.call(merge_pictures, [(rows, pictures, frame) for rows in bands])


def is_drawn_as_points(obj: Primitive, keeps_lists: bool, alpha_tests: AlphaTests | None) -> bool:
    """
    Tell whether an object consists of points that are drawn as points.

    Squares become two triangles where triangles are drawn again from lists, and for alpha tests.
    """
    if not isinstance(obj.rule, PointRule):
        return False
    is_tested = alpha_tests is not None and alpha_tests.cutoffs[obj.number] > 0.0
    return not ((keeps_lists or is_tested) and obj.rule.shape == "square")


def collect_points(
    primitives: Primitives,
    face_starts: NDArray[np.int64],
    vertex_starts: NDArray[np.int64],
    clip_from_relative: NDArray[np.float64],
    depth_coefficients: tuple[float, float, float],
    viewport: Viewport,
) -> PicturePoints:
    """Collect the points among the objects of a picture, and the camera's rays."""
    count = len(vertex_starts) - 1
    shapes, places = np.zeros((count, 2), np.int64), np.zeros((count, 2), np.int64)
    scales, sizes, first = np.zeros(count), [], 0
    for obj in primitives.objects:
        if not isinstance(obj.rule, PointRule):
            continue
        shapes[obj.number] = SHAPES[obj.rule.shape], IN_UNITS if obj.is_world else IN_PIXELS
        places[obj.number] = first, int(len(obj.sizes) > 1)
        is_scaled = obj.is_world
        scales[obj.number] = primitives.scales[obj.number] if is_scaled else primitives.pixels
        sizes.append(obj.sizes)
        first += len(obj.sizes)
    joined = sizes[0] if len(sizes) == 1 else np.concatenate(sizes)
    rows = PointRows(vertex_starts, face_starts, shapes, places, joined, scales)
    view = make_point_view(clip_from_relative, depth_coefficients, viewport)
    return PicturePoints(rows, view, viewport)


def select_points(rows: PointRows, objects: Sequence[Primitive]) -> PointRows:
    """Return the rows with points of some objects alone."""
    shapes = np.zeros_like(rows.shapes)
    for obj in objects:
        shapes[obj.number] = rows.shapes[obj.number]
    return rows._replace(shapes=shapes)


def count_skipped(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Convert counts of points not drawn to the totals of `set_up_triangles`, (5,)."""
    outside, unsampled, invalid, _ = counts.tolist()
    return np.array([outside, 0, 0, unsampled, invalid], np.int64)


def expand_squares(
    obj: Primitive, primitives: Primitives, projected: Projected, workers: Workers
) -> Expansion:
    """
    Count the pieces of squares: two triangles each, which cover the pixels of `draw_points`.

    A `primitive_expansion.Expand`.
    """
    viewport, (first, end) = projected.viewport, obj.vertices
    numbers = np.flatnonzero((projected.codes[first:end] & UNDRAWN_CODES) == 0)
    w = projected.clip_positions[first:end, 3][numbers]
    sizes = obj.sizes[numbers] if len(obj.sizes) > 1 else np.broadcast_to(obj.sizes, numbers.shape)
    if obj.is_world:
        across, down = primitives.lengths
        pixels = sizes * float(primitives.scales[obj.number]) / w
        sides = pixels * across, pixels * down
    else:
        sides = (sizes * primitives.pixels,) * 2
    unit = float(1 << viewport.grid_bits)
    wide, high = (
        np.rint(np.minimum(side * unit, MAX_GRID_SIZE)).astype(np.int64) for side in sides
    )
    is_any = (wide > 0) & (high > 0)
    numbers, wide, high = numbers[is_any], wide[is_any], high[is_any]

    def write_squares(
        start: int, screen: ScreenVertices, pieces: NDArray[np.int32], faces: NDArray[np.int32]
    ) -> None:
        """Write the corners, and the triangles between them."""
        rows = slice(start, start + 4 * len(numbers))
        centres = screen.xy[first:end][numbers].astype(np.int64)
        xy = np.empty((len(numbers), 2, 2, 2), np.int64)
        for k, (side, length) in enumerate(((wide, viewport.width), (high, viewport.height))):
            low, high_end = ((2 * centres[:, k] + sign * side + 1) >> 1 for sign in (-1, 1))
            ends = np.stack([low, high_end], axis=1)
            most = GUARD_PIXELS << viewport.grid_bits
            ends = np.clip(ends, -most, (length << viewport.grid_bits) + most)
            xy[..., k] = ends[:, np.newaxis, :] if k == 0 else ends[:, :, np.newaxis]
        screen.xy[rows] = xy.reshape(-1, 2)
        screen.depth[rows] = np.repeat(screen.depth[first:end][numbers], 4)
        screen.w[rows] = np.repeat(screen.w[first:end][numbers], 4)
        corners = start + 4 * np.arange(len(numbers), dtype=np.int32)[:, np.newaxis]
        pieces[0::2] = corners + np.array([0, 1, 2], np.int32)
        pieces[1::2] = corners + np.array([1, 3, 2], np.int32)
        faces[:] = np.repeat(obj.faces[0] + numbers, 2)

    return Expansion(4 * len(numbers), 2 * len(numbers), write_squares)
