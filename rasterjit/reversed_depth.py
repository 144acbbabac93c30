"""Give the passes that follow visibility the reversed depth, in whatever format it was compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rasterjit import stages
from rasterjit.kernels import depths
from rasterjit.kernels.records import Geometry
from rasterjit.plan_depth import DepthFormat
from rasterjit.scene.camera import Camera
from rasterjit.workers import Workers

SAMPLES_AT_ONCE = 1 << 15
"""Samples whose depth is converted at once: their float64 copies stay in L2, and a small frame
is done in one step."""


def add_reversed_depth(
    depth_format: DepthFormat,
    camera: Camera,
    geometry: Geometry,
    coverage: stages.Coverage,
    workers: Workers,
) -> stages.Coverage:
    """
    Return the coverage with the reversed depth of what is seen, and that of the vertices.

    Where depths were compared in another way they are found anew for the faces that were seen, so
    that nothing is rounded to the format.

    Parameters
    ----------
    depth_format : DepthFormat
    camera : Camera
    geometry : Geometry
    coverage : Coverage
        Its depth is kept.
    workers : Workers
    """
    depth, vertex_depths = coverage.depth, coverage.screen.depth
    if not depth_format.is_reversed:
        coefficients = camera.depth_coefficients()
        vertex_depths = _reversed_vertices(depth_format, coefficients, coverage)
        depth = workers.memory.empty(coverage.face_id.shape, np.float32)
        arguments = geometry, vertex_depths, coefficients, depth
        stages.fill_rows(depths.fill_depths, coverage.face_id, arguments, workers)
    elif depth.dtype != np.float32:
        depth = depth.astype(np.float32)
    return coverage._replace(reversed_depth=depth, reversed_vertex_depth=vertex_depths)


def _reversed_vertices(
    depth_format: DepthFormat,
    coefficients: tuple[float, float, float],
    coverage: stages.Coverage,
) -> NDArray[np.float64]:
    """Return the reversed depth of the vertices; of those behind the eye anything."""
    _, deeper, rest = depth_format.coefficients
    c0, c1, c2 = coefficients
    screen = coverage.screen
    with np.errstate(all="ignore"):
        return (c0 / screen.w + c1 * ((screen.depth - rest) / deeper)) + c2


def metric_depth(
    depth_format: DepthFormat,
    camera: Camera,
    coverage: stages.Coverage,
    size: tuple[int, int],
    corner: tuple[int, int] = (0, 0),
) -> NDArray[np.float32]:
    """
    Return the depth in scene units along the viewing axis; ``inf`` where nothing is.

    What the depth format holds: infinite beyond its last step before an infinite far plane. Takes
    the size of the whole picture, and column and row of the first pixel of this part of it.
    """
    depth = np.full(coverage.depth.shape, np.inf, np.float32)
    (width, height), (left, top) = size, corner
    rows = max(1, SAMPLES_AT_ONCE // depth.shape[1])
    for row in range(0, len(depth), rows):
        band = slice(row, row + rows)
        seen = coverage.face_id[band] >= 0
        stored = coverage.depth[band][seen]
        if not depth_format.is_reversed:
            down, across = np.nonzero(seen)
            x = (2.0 * (left + across) + 1.0) / width - 1.0
            y = 1.0 - (2.0 * (top + row + down) + 1.0) / height
            stored = depth_format.reversed_depth(stored, x, y)
        with np.errstate(over="ignore"):
            depth[band][seen] = camera.view_depth(stored)
    return depth
