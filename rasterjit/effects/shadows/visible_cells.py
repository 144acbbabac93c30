"""
Bound all visible surfaces by cells of space, to which shadow maps are fitted.

Cells come from the depth buffer; where more is visible, behind glass and between pixel centres,
from the boxes of objects.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.effects.shadows import receivers
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.runtime.threads import Workers, rows_per_task
from rasterjit.scene import transforms
from rasterjit.scene.camera import Camera
from rasterjit.scene.pixel_projection import clip_from_relative, screen_from_relative
from rasterjit.survey.object_transforms import CORNER_ENDS

Float64 = NDArray[np.float64]
Counts = NDArray[np.int64]


class DepthRanges(NamedTuple):
    """The ranges of a picture's depth, in R x C cells."""

    size: tuple[int, int]
    """Width and height of the picture, pixels."""
    lowest: NDArray[np.float32]
    """(R, C), stored depth of the farthest face; inf for none."""
    highest: NDArray[np.float32]
    """(R, C), of the nearest face; -inf for none."""
    farthest: NDArray[np.float32] | None = None
    """(R, C), as ``lowest``, but -inf where any pixel is empty; ``None`` unless requested."""
    is_shown: NDArray[np.bool_] | None = None
    """(O,), whether a pixel shows an object; ``None`` unless requested."""


def read_depth_ranges(
    coverage: visibility_pass.Coverage, workers: Workers, face_starts: Counts | None = None
) -> DepthRanges:
    """
    Return the ranges of a picture's depth.

    With ``face_starts``, the first face of each object, also find ``farthest`` and ``is_shown``.
    """
    depth = coverage.reversed_depth
    height, width = depth.shape
    lowest, highest = find_depth_ranges(depth, workers)
    if face_starts is None:
        return DepthRanges((width, height), lowest, highest)
    side = receivers.CELL_PIXELS
    rows, columns = range(0, height, side), np.arange(0, width, side)
    least = np.array([depth[row : row + side].min(axis=0) for row in rows])
    farthest = np.minimum.reduceat(least, columns, axis=1)
    is_shown = _find_shown_objects(coverage.face_id, face_starts)
    return DepthRanges((width, height), lowest, highest, farthest, is_shown)


def _find_shown_objects(face_id: NDArray[np.int32], face_starts: Counts) -> NDArray[np.bool_]:
    """Return whether a pixel shows an object, (O,)."""
    first, end = face_starts[:-1], face_starts[1:]
    # Few pixels show most objects.
    for step in (8, 1):
        is_seen = np.zeros(end[-1] + 1, bool)
        # Pixels without a face, -1, mark the entry behind the last face.
        is_seen[face_id[::step, ::step]] = True
        counts = np.concatenate(([0], np.cumsum(is_seen[:-1])))
        is_shown = counts[end] > counts[first]
        if is_shown.all():
            break
    return is_shown


def merge_depth_ranges(
    size: tuple[int, int], parts: Sequence[tuple[tuple[int, int], DepthRanges]]
) -> DepthRanges:
    """
    Return the depth ranges of a picture from those of its parts.

    Parameters
    ----------
    size : (int, int)
        Width and height of the whole, pixels.
    parts : sequence of ((int, int), DepthRanges)
        Column and row of the first pixel of each, multiples of ``receivers.CELL_PIXELS``, and its
        ranges. Together they are the whole.
    """
    side = receivers.CELL_PIXELS
    shape = -(-size[1] // side), -(-size[0] // side)
    first = parts[0][1]
    joined = {
        name: np.empty(shape, np.float32)
        for name in ("lowest", "highest", "farthest")
        if getattr(first, name) is not None
    }
    for (left, top), part in parts:
        column, row = left // side, top // side
        for name, values in joined.items():
            cells = getattr(part, name)
            values[row : row + cells.shape[0], column : column + cells.shape[1]] = cells
    is_shown = first.is_shown
    if is_shown is not None:
        is_shown = np.logical_or.reduce([part.is_shown for _, part in parts])
    return DepthRanges(size, **joined, is_shown=is_shown)


def make_depth_cells(camera: Camera, ranges: DepthRanges) -> Float64:
    """
    Return the corners, (N, 8, 3), of cells that hold all visible surfaces.

    Corners are in world axes, relative to the eye; each cell holds the surfaces of a block of
    pixels.
    """
    (width, height), lowest, highest = ranges[:3]
    screen = screen_from_relative(camera, (width, height))
    rows, columns = np.nonzero(lowest <= highest)
    try:
        relative_from_screen = transforms.inverse(screen)
    except ValueError:
        # The camera flattens space: pixels and depths give no points.
        return np.empty((0, 8, 3))
    side = receivers.CELL_PIXELS
    right, down, is_near = CORNER_ENDS.T
    corners = np.empty((len(rows), 8, 3))
    x = np.minimum((columns[:, np.newaxis] + right) * side, width)
    y = np.minimum((rows[:, np.newaxis] + down) * side, height)
    corners[:, :, 0] = 2.0 * x / width - 1.0
    corners[:, :, 1] = 1.0 - 2.0 * y / height
    depths = (depth[rows, columns][:, np.newaxis] for depth in (highest, lowest))
    corners[:, :, 2] = np.where(is_near, *depths)
    points = _project(relative_from_screen, corners)
    return points[np.isfinite(points).all(axis=(1, 2))]


def make_view_cells(camera: Camera, size: tuple[int, int], boxes: Float64) -> Float64:
    """
    Return the corners, (B, 8, 3), of cells that hold the visible parts of boxes (B, 8, 3).

    Corners are in world axes, relative to the eye. A cell is the intersection, along the world's
    axes, of a box and the part of the view around that box; or the box itself if that is no larger.
    """
    if not len(boxes):
        return boxes
    screen = screen_from_relative(camera, size)
    try:
        relative_from_screen = transforms.inverse(screen)
        nearest = _find_nearest_depth(camera, size, screen)
    except ValueError:
        return boxes
    if not np.isfinite(nearest):
        return boxes
    points, ahead = _project(screen, boxes), _multiply(screen[3:], boxes)[..., 0] > 0.0
    depth, is_ahead = points[..., 2], ahead.all(axis=1)[:, np.newaxis, np.newaxis]
    # Boxes that reach behind the eye may be anywhere on the screen.
    low = np.where(is_ahead, np.maximum(points.min(axis=1, keepdims=True), -1.0), -1.0)
    high = np.where(is_ahead, np.minimum(points.max(axis=1, keepdims=True), 1.0), 1.0)
    low[:, 0, 2] = depth.min(axis=1, where=ahead, initial=nearest)
    high[:, 0, 2] = np.where(is_ahead[:, 0, 0], np.minimum(depth.max(axis=1), nearest), nearest)
    parts = _project(relative_from_screen, np.where(CORNER_ENDS, high, low))
    low = np.maximum(parts.min(axis=1), boxes.min(axis=1))[:, np.newaxis]
    high = np.minimum(parts.max(axis=1), boxes.max(axis=1))[:, np.newaxis]
    cells = np.where(CORNER_ENDS, np.maximum(low, high), low)
    with np.errstate(invalid="ignore", over="ignore"):
        is_smaller = _square_diagonals(cells) < _square_diagonals(boxes)
        return np.where(is_smaller[:, np.newaxis, np.newaxis], cells, boxes)


def find_unseen_objects(camera: Camera, boxes: Float64, ranges: DepthRanges) -> NDArray[np.bool_]:
    """
    Return which objects, (O,), no pixel centre shows though they may be visible.

    An object all around the eye counts as hidden. Boxes, (O, 8, 3), are in world axes, relative to
    the eye.
    """
    (width, height), farthest = ranges.size, ranges.farthest
    is_unseen = ~ranges.is_shown
    screen, indices = screen_from_relative(camera, (width, height)), np.flatnonzero(is_unseen)
    points = _project(screen, boxes[indices])
    is_ahead = (_multiply(screen[3:], boxes[indices])[..., 0] > 0.0).all(axis=1)
    side, (rows, columns) = receivers.CELL_PIXELS, farthest.shape
    with np.errstate(invalid="ignore"):
        x = (points[..., 0] + 1.0) * (width / 2.0)
        y = (1.0 - points[..., 1]) * (height / 2.0)
        # Widen by a pixel: surfaces visible between centres may be hidden at each centre.
        ends = [
            np.clip(np.nan_to_num((edge + margin) // side), 0, count - 1).astype(np.int64)
            for edge, margin, count in (
                (y.min(axis=1), -1.0, rows), (y.max(axis=1), 1.0, rows),
                (x.min(axis=1), -1.0, columns), (x.max(axis=1), 1.0, columns),
            )
        ]  # fmt: skip
        # Leave out large objects around the eye: their boxes would widen maps too much.
        is_hidden = ~is_ahead | (
            points[..., 2].max(axis=1) < _find_rectangle_minima(farthest, *ends)
        )
    is_unseen[indices[is_hidden]] = False
    return is_unseen


def _find_rectangle_minima(
    values: NDArray[np.float32], top: Counts, bottom: Counts, left: Counts, right: Counts
) -> NDArray[np.float32]:
    """Return a lower bound of an image's values in rectangles, (B,), ends included."""
    result = np.empty(len(top), np.float32)
    span = np.maximum(bottom - top, right - left)
    for level in range((int(span.max(initial=1)) - 1).bit_length() + 1):
        # A rectangle has at most 2 x 2 entries of 2**level x 2**level values each.
        selected = np.flatnonzero((span <= 1 << level) & ((span > 1 << level >> 1) | (level == 0)))
        ends = [[end[selected] >> level for end in pair] for pair in ((top, bottom), (left, right))]
        result[selected] = np.minimum.reduce(
            [values[row, column] for row in ends[0] for column in ends[1]]
        )
        rows, columns = np.arange(0, values.shape[0], 2), np.arange(0, values.shape[1], 2)
        values = np.minimum.reduceat(np.minimum.reduceat(values, rows, axis=0), columns, axis=1)
    return result


def _square_diagonals(corners: Float64) -> Float64:
    """Return the square of the diagonal of the box around eight corners, (B,)."""
    x, y, z = (corners.max(axis=1) - corners.min(axis=1)).T
    return (x * x + y * y) + z * z


def _find_nearest_depth(camera: Camera, size: tuple[int, int], screen: Float64) -> float:
    """Return the largest stored depth on the near plane of the view."""
    relative_from_clip = transforms.inverse(clip_from_relative(camera, size))
    corners = np.array([[x, y, -1.0] for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
    return float(_project(screen, _project(relative_from_clip, corners))[:, 2].max())


def _multiply(rows: Float64, points: Float64) -> Float64:
    """Return the products of rows of a 4x4 matrix and the points (..., 3), with w 1."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    return np.stack([m[0] * x + m[1] * y + m[2] * z + m[3] for m in rows], axis=-1)


def _project(matrix: Float64, points: Float64) -> Float64:
    """Return points (..., 3) transformed by a 4x4 matrix, divided by w."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        homogeneous = _multiply(matrix, points)
        return homogeneous[..., :3] / homogeneous[..., 3:]


def find_depth_ranges(
    depth: NDArray[np.float32], workers: Workers
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the lowest and highest stored depth in cells of a frame; inf, -inf for empty ones."""
    height, width = depth.shape
    side = receivers.CELL_PIXELS
    rows, columns = -(-height // side), -(-width // side)
    lowest, highest = (np.empty((rows, columns), np.float32) for _ in range(2))
    per_task = -(-rows_per_task(depth.shape, workers) // side)

    def find_rows(first: int) -> None:
        cells, scratch = (first, min(first + per_task, rows)), np.empty((2, width), np.float32)
        receivers.find_depth_ranges(depth, cells, lowest, highest, scratch)

    workers.run(find_rows, [(n,) for n in range(0, rows, per_task)])
    return lowest, highest
