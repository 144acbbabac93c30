"""Find the edges of faces and draw them as lines, shared among threads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rasterjit import stages
from rasterjit.kernels import wireframe
from rasterjit.kernels.records import Geometry
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
    depth = slack = None
    if hidden_by is not None:
        face_id, depth = hidden_by
        slack = empty(depth.shape, np.float32)
        arguments = depth, geometry, depth_coefficients, slack
        stages.fill_rows(wireframe.fill_slack, face_id, arguments, workers)
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
