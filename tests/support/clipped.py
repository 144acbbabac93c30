"""Run the clipping kernels on loose faces."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry import clipping
from rasterjit.pipeline.records import Viewport

WITHIN = Viewport(64, 64, 1.0, 1.0, 8, 8)
"""A viewport whose guard band is the image: clipping then cuts to the view volume itself."""


def clip_all(positions, viewport=WITHIN, faces=None):
    """Return how many vertices each face was cut to, those, the pieces, and the face of each."""
    positions = np.ascontiguousarray(positions, np.float64)
    if faces is None:
        faces = np.arange(len(positions)).reshape(-1, 3)
    faces = np.ascontiguousarray(faces, np.int32)
    cut = np.arange(len(faces), dtype=np.int32)
    counts = np.zeros(len(faces), np.int64)
    scratch = np.empty((2, clipping.MAX_VERTICES, 4))
    clipping.count_clipped_vertices(cut, faces, positions, viewport, counts, scratch)
    vertex_starts = np.concatenate(([0], np.cumsum(counts)))
    piece_starts = np.concatenate(([0], np.cumsum(np.maximum(counts - 2, 0))))
    vertices = np.full((vertex_starts[-1], 4), np.nan)
    pieces = np.full((piece_starts[-1], 3), -1, np.int32)
    sources = np.full(piece_starts[-1], -1, np.int32)
    clipping.clip_faces(
        cut, faces, positions, viewport, (vertex_starts, piece_starts),
        (vertices, pieces, sources), scratch,
    )  # fmt: skip
    assert not np.isnan(vertices).any()
    return counts.tolist(), vertices, pieces, sources
