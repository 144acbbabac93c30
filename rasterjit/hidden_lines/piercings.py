"""Find the lines along which faces of a scene pierce each other."""

from __future__ import annotations

import numpy as np

from rasterjit.hidden_lines import piercing_stage
from rasterjit.hidden_lines.cells import find_pairs, sort_into_cells
from rasterjit.hidden_lines.edges import KINDS, FeatureEdges, SurfaceFaces, find_neighbours
from rasterjit.runtime.threads import Workers
from rasterjit.scene.arrays import Float64
from rasterjit.scene.normals import unit_rows

TOLERANCE = 2.0**-22
"""Largest distance of faces that touch, relative to their reach: rounding of float32 positions."""

GRID_UNITS = 1 << 24
"""Units of the grid of cells, along the longest side of the scene."""


def find_intersections(faces: SurfaceFaces, workers: Workers) -> tuple[FeatureEdges, Float64]:
    """
    Return the lines along which faces pierce each other, as edges, and their ends.

    Faces with a common vertex do not count. The ends, (2 E, 3), relative to the eye, world axes,
    are the vertices that the edges number.
    """
    corners = faces.positions[faces.corners]
    low, high = corners.min(axis=1), corners.max(axis=1)
    origin = low.min(axis=0, initial=np.inf)
    size = float((high.max(axis=0, initial=-np.inf) - origin).max())
    if not 0.0 < size < np.inf:
        return _make_edges(faces, np.empty((0, 2), np.int32)), np.empty((0, 3))
    scale = GRID_UNITS / size
    units = [np.floor((side - origin) * scale).astype(np.int32) for side in (low, high)]
    cells = sort_into_cells(units[0], units[1], (GRID_UNITS + 1,) * 3)
    triangles = (
        np.ascontiguousarray(corners.reshape(-1, 9)), faces.corners.astype(np.int32),
        unit_rows(faces.normals), np.concatenate([low, high], axis=1),
        find_neighbours(faces.corners),
    )  # fmt: skip
    ranges = np.ascontiguousarray(cells.ranges.reshape(-1, 6).astype(np.int32))
    pairs, lines = find_pairs(
        piercing_stage.find_piercings, len(corners),
        (triangles, ranges, cells[:2], cells.counts[:2], TOLERANCE * faces.reaches),
        (len(corners), 6), workers,
    )  # fmt: skip
    return _make_edges(faces, pairs), lines.reshape(-1, 3)


def _make_edges(faces: SurfaceFaces, pairs: np.ndarray) -> FeatureEdges:
    """Return the lines between pairs of faces as edges."""
    count = len(pairs)
    return FeatureEdges(
        np.arange(2 * count, dtype=np.int32).reshape(-1, 2),
        np.full(count, KINDS.index("intersection")), faces.objects[pairs[:, 0]],
        ~faces.is_drawn[pairs].any(axis=1),
    )  # fmt: skip
