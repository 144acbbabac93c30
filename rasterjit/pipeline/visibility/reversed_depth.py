"""
Compute float32 reversed depth of the visible faces, for frames depth-tested in another format.

Passes that read depth (shadows, ambient occlusion, outlines, hidden lines) then work as in any
frame, on depths not rounded to that format.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import compute_clipped_weights, interpolate
from rasterjit.pipeline.geometry.projection import compute_stored_depth
from rasterjit.pipeline.geometry.setup import CLIPPED, edge, get_face_vertices
from rasterjit.pipeline.records import Geometry
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64


@helper
def compute_clipped_depth(a, b, c, column, row, geometry, depth_coefficients):
    """Return the depth of a clipped face at a pixel's centre; 0 behind the eye."""
    clip = geometry.clip_positions
    w0, w1, w2 = compute_clipped_weights(a, b, c, column, row, clip, geometry.viewport)
    z = w0 * clip[a, 2] + w1 * clip[b, 2] + w2 * clip[c, 2]
    w = w0 * clip[a, 3] + w1 * clip[b, 3] + w2 * clip[c, 3]
    c0, c1, c2 = depth_coefficients
    if not w > 0.0:
        return 0.0
    return compute_stored_depth(z, w, ((w0 + w1 + w2) * c0, c1, c2))


@helper
def compute_unclipped_depth(a, b, c, column, row, geometry, vertex_depths):
    """Return the depth of an unclipped face at a pixel's centre."""
    xy, bits = geometry.xy, geometry.viewport.grid_bits
    half = np.int64(1) << (bits - 1)
    px, py = (np.int64(column) << bits) + half, (np.int64(row) << bits) + half
    ax, ay = np.int64(xy[a, 0]), np.int64(xy[a, 1])
    bx, by = np.int64(xy[b, 0]), np.int64(xy[b, 1])
    cx, cy = np.int64(xy[c, 0]), np.int64(xy[c, 1])
    inverse = 1.0 / np.float64(edge(ax, ay, bx, by, cx, cy))
    second = np.float64(edge(cx, cy, ax, ay, px, py)) * inverse
    third = np.float64(edge(ax, ay, bx, by, px, py)) * inverse
    return interpolate((0.0, second, third), vertex_depths[a], vertex_depths[b], vertex_depths[c])


@kernel
def fill_reversed_depths(
    face_id: int32[:, ::1], row_range: (int64, int64), geometry: Geometry,
    vertex_depths: float64[:], depth_coefficients: (float64, float64, float64),
    depth: float32[:, ::1],
):  # fmt: skip
    """
    Write the stored depth of the face at each pixel's centre.

    Parameters
    ----------
    face_id : (H, W) int32
    row_range : (int, int)
        First row, and one past the last.
    geometry : Geometry
    vertex_depths : (V+E,) float64
        Stored depth of the vertices; for clipped faces, clip positions are used instead.
    depth_coefficients : (float, float, float)
        The stored depth is ``(c0 + c1 z + c2 w) / w``; greater is nearer.
    depth : (H, W) float32
        Written; -inf where nothing is.
    """
    for row in range(row_range[0], row_range[1]):
        for column in range(face_id.shape[1]):
            face = face_id[row, column]
            if face < 0:
                depth[row, column] = -np.inf
                continue
            a, b, c = get_face_vertices(geometry.faces, face)
            if (geometry.codes[a] | geometry.codes[b] | geometry.codes[c]) & CLIPPED:
                value = compute_clipped_depth(a, b, c, column, row, geometry, depth_coefficients)
            else:
                value = compute_unclipped_depth(a, b, c, column, row, geometry, vertex_depths)
            depth[row, column] = value
