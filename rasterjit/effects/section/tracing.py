"""
Draw lines through a lens: trace them in pinhole pictures, and draw what is seen of them anew.

A lens bends straight lines, and its pixels are not those of the pinhole pictures that it resamples.
So edges are cut into short pieces. In a pinhole picture the pieces are kept whose middle lies in a
pixel that a visible line of one pixel passes, or beside one. Their ends are projected through the
lens, and drawn over the finished picture, as wide as its pixels say.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.records import Geometry, Viewport
from rasterjit.scene.arrays import Bool, Float64, Int32
from rasterjit.scene.pixel_projection import clip_from_relative
from rasterjit.survey.effect import FrameContext

PIECE_PIXELS = 2.0
"""Length of the pieces that edges are cut into, pixels of the pinhole picture."""

MAX_PIECES = 4096
"""Most pieces of an edge; as many where an end is behind the eye."""


def place_edges(edges: Int32, owners: Int32, context: FrameContext) -> Float64:
    """Return the ends of edges, (E, 2), of objects, (E,), relative to the eye, (E, 2, 3)."""
    placement = context.placement
    m = placement.relative_from_model[owners][:, np.newaxis]
    x, y, z = (placement.positions[edges][..., k, np.newaxis] for k in range(3))
    return ((m[..., 0] * x + m[..., 1] * y) + m[..., 2] * z) + m[..., 3]


def keep_visible(ends: Float64, marks: Bool, context: FrameContext) -> Float64:
    """
    Return the visible pieces of edges in a picture, (N, 2, 3), relative to the eye.

    Parameters
    ----------
    ends : (E, 2, 3) float64
        As `place_edges` returns them.
    marks : (H, W) bool
        The pixels of visible lines.
    context : FrameContext
        Of the picture.
    """
    plan = context.plan
    matrix = clip_from_relative(plan.camera, plan.size)
    pixels, is_ahead = _project(matrix, ends, plan.size)
    long = np.abs(pixels[:, 1] - pixels[:, 0]).max(axis=1)
    counts = np.where(is_ahead.all(axis=1), np.ceil(long / PIECE_PIXELS), MAX_PIECES)
    counts = counts.clip(1, MAX_PIECES).astype(np.int64)
    which = np.repeat(np.arange(len(ends)), counts)
    number = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    first, along = ends[which, 0], ends[which, 1] - ends[which, 0]
    shares = ((number + step) / counts[which] for step in (0.0, 0.5, 1.0))
    start, middle, stop = (first + share[:, np.newaxis] * along for share in shares)
    pixels, is_ahead = _project(matrix, middle, plan.size)
    column, row = np.floor(pixels.clip(-1.0, max(plan.size))).astype(np.int64).T
    height, width = marks.shape
    is_inside = is_ahead & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    near = _widen(marks)
    is_seen = is_inside & near[row.clip(0, height - 1), column.clip(0, width - 1)]
    return np.stack([start[is_seen], stop[is_seen]], axis=1)


def _project(
    matrix: Float64, points: Float64, size: tuple[int, int]
) -> tuple[Float64, NDArray[np.bool_]]:
    """Return the pixels of points relative to the eye, (..., 2), and which are before it, (...)."""
    x, y, z = (points[..., k] for k in range(3))
    right, up, w = (((m[0] * x + m[1] * y) + m[2] * z) + m[3] for m in matrix[[0, 1, 3]])
    is_ahead = w > 0.0
    w = np.where(is_ahead, w, 1.0)
    columns, rows = (right / w + 1.0) * (0.5 * size[0]), (1.0 - up / w) * (0.5 * size[1])
    return np.stack([columns, rows], axis=-1), is_ahead


def _widen(marks: Bool) -> Bool:
    """Return marks with all pixels beside them."""
    padded = np.pad(marks, 1)
    height, width = marks.shape
    parts = [padded[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.logical_or.reduce(parts)


def make_lines(pieces: Float64, size: tuple[int, int], like: Viewport) -> tuple[Int32, Geometry]:
    """
    Return lines between pixels, (N, 2, 2), as edges of a geometry that nothing hides.

    Parameters
    ----------
    pieces : (N, 2, 2) float64
        Column and row of both ends, pixels.
    size : (int, int)
        Of the picture.
    like : Viewport
        With the grid that vertices are rounded to.
    """
    width, height = size
    ends = pieces.reshape(-1, 2)
    viewport = like._replace(width=width, height=height, left=0, top=0, right=0, bottom=0)
    clip_positions = np.zeros((len(ends), 4))
    clip_positions[:, 0] = ends[:, 0] / (0.5 * width) - 1.0
    clip_positions[:, 1] = 1.0 - ends[:, 1] / (0.5 * height)
    clip_positions[:, 3] = 1.0
    xy = np.rint(ends * float(1 << viewport.grid_bits)).astype(np.int32)
    geometry = Geometry(
        np.zeros((0, 3), np.int32), xy, np.zeros(len(ends), np.uint8), np.ones(len(ends)),
        clip_positions, viewport,
    )  # fmt: skip
    return np.arange(len(ends), dtype=np.int32).reshape(-1, 2), geometry
