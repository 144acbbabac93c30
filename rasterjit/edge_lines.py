"""Find the edges of faces and draw them as lines, shared among threads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rasterjit import stages
from rasterjit.kernels import binning, line_coverage, wireframe
from rasterjit.kernels.line_coverage import BAND_ROWS
from rasterjit.kernels.records import Geometry
from rasterjit.kernels.resolve import encoding_table
from rasterjit.workers import Workers

EDGES_PER_TASK = 1 << 14
"""Edges of a wireframe drawn by one task: where they end, 640 KiB, stays in a core's own cache."""


def unique_edges(faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return every edge of the faces once, (N, 2), lower vertex number first, ascending."""
    keys = np.empty((3, len(faces)), np.int64)
    for k in range(3):
        # One number for each edge, its lower vertex in the upper half.
        a, b = faces[:, k], faces[:, (k + 1) % 3]
        np.minimum(a, b, out=keys[k])
        keys[k] <<= 32
        keys[k] |= np.maximum(a, b)
    ascending = np.sort(keys, axis=None)
    is_new = np.append(True, ascending[1:] != ascending[:-1])
    edges = ascending[is_new[: len(ascending)]]
    return np.stack([edges >> 32, edges & 0xFFFFFFFF], axis=1).astype(np.int32)


def hiding(
    hidden_by: tuple[NDArray[np.int32], NDArray[np.float32]] | None,
    geometry: Geometry,
    depth_coefficients: tuple[float, float, float],
    workers: Workers,
) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """Return the stored depth that hides edges and its slack, (H, W); ``None`` if nothing does."""
    if hidden_by is None:
        return None, None
    face_id, depth = hidden_by
    slack = workers.memory.empty(depth.shape, np.float32)
    arguments = depth, geometry, depth_coefficients, slack
    stages.fill_rows(wireframe.fill_slack, face_id, arguments, workers)
    return depth, slack


def draw_edges(
    edges: NDArray[np.int32],
    geometry: Geometry,
    depth_coefficients: tuple[float, float, float],
    rgba: NDArray[np.uint8],
    color: NDArray[np.uint8],
    hidden_by: tuple[NDArray[np.int32], NDArray[np.float32]] | None,
    workers: Workers,
) -> None:
    """
    Draw edges as Bresenham lines into the colour.

    All have one colour and none hides another. So tasks may draw them in any order, and even meet
    in a pixel: both write the same value.

    Parameters
    ----------
    edges : (N, 2) int32, vertex numbers
    geometry : Geometry
    depth_coefficients : (float, float, float)
    rgba : (4,) uint8
    color : (H, W, 4) uint8
        Written.
    hidden_by : (face_id (H, W) int32, depth (H, W) float32) or None
        The surfaces that hide edges; ``None`` draws all of them.
    workers : Workers
    """
    count, empty = len(geometry.clip_positions), workers.memory.empty
    pixels = empty((count, 2), np.int32)
    vertices = geometry.clip_positions, geometry.codes, pixels
    workers.run(
        wireframe.find_pixels,
        [
            (
                (n, min(n + stages.VERTICES_PER_TASK, count)),
                *vertices[:2],
                geometry.viewport,
                pixels,
            )
            for n in range(0, count, stages.VERTICES_PER_TASK)
        ],
    )
    depth, slack = hiding(hidden_by, geometry, depth_coefficients, workers)
    target = color.view(np.uint32)[:, :, 0]

    def draw_some(first: int) -> None:
        some = edges[first : first + EDGES_PER_TASK]
        ends = np.empty((len(some), 4), np.int32)
        depths = None if depth is None else np.empty((len(some), 2), np.float64)
        seen = wireframe.project_edges(
            some, vertices, depth_coefficients, geometry.viewport, ends, depths
        )
        line_depths = None if depths is None else depths[:seen]
        wireframe.draw_edges(target, depth, slack, ends[:seen], line_depths, rgba)

    workers.run(draw_some, [(n,) for n in range(0, len(edges), EDGES_PER_TASK)])


def cover_edges(
    edges: NDArray[np.int32],
    geometry: Geometry,
    depth_coefficients: tuple[float, float, float],
    rgba: NDArray[np.uint8],
    color: NDArray[np.uint8],
    hidden_by: tuple[NDArray[np.int32], NDArray[np.float32]] | None,
    light: NDArray[np.float32] | None,
    workers: Workers,
) -> None:
    """
    Lay edges over the colour by how much of each pixel they cover.

    Takes what `draw_edges` takes, and

    light : (256,) float32 or None
        Linear light of each code; ``None``: codes are mixed, not light.
    """
    depth, slack = hiding(hidden_by, geometry, depth_coefficients, workers)
    viewport, empty = geometry.viewport, workers.memory.empty
    ends = empty((len(edges), 4), np.int32)
    depths = None if depth is None else empty((len(edges), 2), np.float64)
    starts, listed = list_by_bands(edges, geometry, depth_coefficients, ends, depths, workers)
    target, table = color.view(np.uint32)[:, :, 0], encoding_table()

    def cover_band(band: int) -> None:
        rows = band * BAND_ROWS, min((band + 1) * BAND_ROWS, viewport.height)
        own = listed[starts[band] : starts[band + 1]]
        cover = empty((rows[1] - rows[0], viewport.width), np.float32)
        line_coverage.cover_lines(own, ends, depths, rows, viewport, depth, slack, cover)
        some = target[rows[0] : rows[1]]
        line_coverage.lay_lines(cover, rgba.view(np.uint32), light, table, some)

    workers.run(cover_band, [(band,) for band in range(len(starts) - 1)])


def list_by_bands(
    edges: NDArray[np.int32],
    geometry: Geometry,
    depth_coefficients: tuple[float, float, float],
    ends: NDArray[np.int32],
    depths: NDArray[np.float64] | None,
    workers: Workers,
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """
    Take edges to the screen and list them by the bands of rows that they may touch.

    Writes ends and depths as ``line_coverage.project_lines`` does; returns where the list of each
    band starts, (bands + 1,), and the lists, numbers of lines.
    """
    viewport = geometry.viewport
    bands = -(-viewport.height // BAND_ROWS)
    firsts = range(0, len(edges), EDGES_PER_TASK)
    counts = np.zeros((len(firsts), bands + 1), np.int32)
    lines = workers.run(
        line_coverage.project_lines,
        [
            (
                edges[first : first + EDGES_PER_TASK], first, geometry, depth_coefficients, ends,
                depths, counts[n],
            )
            for n, first in enumerate(firsts)
        ],
    )  # fmt: skip
    starts, cursors = np.empty(bands + 1, np.int64), np.empty((len(firsts), bands), np.int64)
    binning.start_lists(counts, starts, cursors)
    listed = workers.memory.empty((int(starts[-1]),), np.int32)
    workers.run(
        line_coverage.list_lines,
        [
            ((first, first + lines[n]), ends, viewport, cursors[n], listed)
            for n, first in enumerate(firsts)
        ],
    )
    return starts, listed
