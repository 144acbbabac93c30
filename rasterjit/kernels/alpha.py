"""
Find the alpha of gathered samples: that of the material, the colours and the texture, multiplied.

Only objects that are blended have one; that of all others is 1.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels import texture_rows
from rasterjit.kernels.interpolation import find_object, interpolate, lowest_first
from rasterjit.kernels.jit import stage

OPACITY = 3
"""Column of a colour: alpha."""


@stage
def face_alpha(face, face_colors):
    """Return the alpha of a face's colour; 1 if there are none."""
    if face_colors is None:
        return np.float32(1.0)
    return face_colors[face, OPACITY]


@stage
def vertex_alpha(face, weights, n, faces, vertex_colors):
    """Return the alpha of the vertices' colours, interpolated; 1 if there are none."""
    if vertex_colors is None:
        return np.float32(1.0)
    a, b, c = lowest_first(faces, face)
    return np.float32(
        interpolate(
            (0.0, weights[0, n], weights[1, n]),
            np.float64(vertex_colors[a, OPACITY]),
            np.float64(vertex_colors[b, OPACITY]),
            np.float64(vertex_colors[c, OPACITY]),
        )
    )


@stage
def texel_alpha(places, n):
    """Return the alpha that the texture shows; 1 if there are none."""
    if places is None:
        return np.float32(1.0)
    return np.float32(places[texture_rows.SHOWN + OPACITY, n])


@stage
def find_alphas(samples, weights, faces, places, geometry, placement, surface, alphas):
    """Write the alpha of each gathered sample of a part of a row; nothing if all are opaque."""
    if alphas is None:
        return
    n, owner = np.int64(0), np.int64(0)
    for i in range(faces.shape[0]):
        face = np.int64(faces[np.uintp(i)])
        if face < 0:
            continue
        owner = find_object(face, placement.face_starts, owner)
        alpha = np.float32(1.0)
        if alphas.is_blended[owner] != 0:
            alpha = surface.materials[owner, OPACITY]
            alpha *= face_alpha(face, surface.face_colors)
            alpha *= vertex_alpha(face, weights, n, geometry.faces, surface.vertex_colors)
            alpha *= texel_alpha(places, n)
        samples[lit.ALPHA, n] = alpha
        n += 1


@stage
def alpha_row(samples, alphas):
    """Return the alphas of the gathered samples; ``None`` if all are opaque."""
    if alphas is None:
        return None
    return samples[lit.ALPHA]


@stage
def alpha_at(alphas, n):
    """Return the alpha of a sample; 1 if all are opaque."""
    if alphas is None:
        return np.float32(1.0)
    return alphas[n]
