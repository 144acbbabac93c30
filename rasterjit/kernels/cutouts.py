"""
Leave out the samples where a surface has a hole: where its alpha is below a cutoff.

A triangle of an object with holes is drawn into a tile of its own, by the code that draws every
triangle, and what passes the test is moved from there to the tile at hand. So samples and depths
are those of the same triangle without holes, bit for bit.

Alpha is that of the material times that of the vertex or face colours times that of the base colour
texture, each as shading would show it at that sample: the same weights, also where a face was
clipped, and the same filter, with the mip level that the picture at hand calls for (a shadow map
has levels of its own). Samples beside a pixel's centre have their own alpha, at the centre's level.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.batches import BOTTOM, FACE, LEFT, RIGHT, TOP
from rasterjit.kernels.interpolation import (
    clipped_weights,
    interpolate,
    lowest_first,
    snapped_weights_at,
)
from rasterjit.kernels.jit import stage
from rasterjit.kernels.setup import CLIPPED, last_at_most
from rasterjit.kernels.texturing import BASE_COLOR, texture_color, vertex_place

ALPHA = 3
"""Column of colours and of materials."""

OWN_DEPTH, OWN_NUMBERS = 9, 10
"""Where scratch memory holds the tile that a triangle with holes is drawn into."""


@stage
def has_holes(face, cutouts):
    """Return whether the object of a face has holes; none has if there are no cut-outs."""
    if cutouts is None:
        return False
    owner = last_at_most(cutouts.face_starts, np.int64(face))
    return cutouts.cutoffs[owner] > np.float32(0.0)


@stage
def tile_for(face, tile, scratch, cutouts):
    """Return the tile that a triangle is drawn into, flat: one of its own if it has holes."""
    if cutouts is None:
        return tile
    if not has_holes(face, cutouts):
        return tile
    return scratch[OWN_DEPTH].reshape(-1), scratch[OWN_NUMBERS].reshape(-1)


@stage
def vertex_alpha(weights, a, b, c, vertex_colors):
    """Return the interpolated alpha of the vertices; 1 if they have no colours."""
    if vertex_colors is None:
        return np.float32(1.0)
    return np.float32(
        interpolate(
            weights,
            np.float64(vertex_colors[a, ALPHA]),
            np.float64(vertex_colors[b, ALPHA]),
            np.float64(vertex_colors[c, ALPHA]),
        )
    )


@stage
def face_alpha(face, face_colors):
    """Return the alpha of a face; 1 if there are no face colours."""
    if face_colors is None:
        return np.float32(1.0)
    return face_colors[face, ALPHA]


@stage
def texture_alpha(owner, weights, a, b, c, column, row, textures, geometry):
    """Return the alpha that the texture shows at a sample; 1 if there is none."""
    if textures is None:
        return np.float32(1.0)
    uv = textures.uv
    pa, pb, pc = vertex_place(uv, a), vertex_place(uv, b), vertex_place(uv, c)
    place = (
        interpolate(weights, pa[0], pb[0], pc[0]),
        interpolate(weights, pa[1], pb[1], pc[1]),
    )
    corners = np.int64(a), np.int64(b), np.int64(c)
    color = texture_color(owner, BASE_COLOR, place, corners, column, row, textures, geometry)
    return color[ALPHA]


@stage
def shifted_weights(a, b, c, column, row, shift, geometry):
    """
    Return the perspective-correct weights of vertices a, b, c at a sample of a pixel.

    Takes its way to the pixel's centre in units of the sub-pixel grid. Where that is nothing they
    are those of `interpolation.sample_weights`.
    """
    bits = geometry.viewport.grid_bits
    unit, half = np.int64(1) << bits, np.int64(1) << (bits - 1)
    if (geometry.codes[a] | geometry.codes[b] | geometry.codes[c]) & CLIPPED:
        x = np.float64(column) - np.float64(shift[0]) / np.float64(unit)
        y = np.float64(row) - np.float64(shift[1]) / np.float64(unit)
        w0, w1, w2 = clipped_weights(a, b, c, x, y, geometry)
    else:
        px = (np.int64(column) << bits) + half - np.int64(shift[0])
        py = (np.int64(row) << bits) + half - np.int64(shift[1])
        w0, w1, w2 = snapped_weights_at(a, b, c, px, py, geometry)
    total = w0 + w1 + w2
    if total == 0.0:
        return 1.0, 0.0, 0.0
    return w0 / total, w1 / total, w2 / total


@stage
def sample_alpha(face, owner, column, row, shift, cutouts):
    """Return the alpha of a face at a sample of a pixel."""
    geometry = cutouts.geometry
    a, b, c = lowest_first(geometry.faces, face)
    weights = shifted_weights(a, b, c, column, row, shift, geometry)
    return (
        cutouts.materials[owner, ALPHA]
        * vertex_alpha(weights, a, b, c, cutouts.vertex_colors)
        * face_alpha(face, cutouts.face_colors)
        * texture_alpha(owner, weights, a, b, c, column, row, cutouts.textures, geometry)
    )


@stage
def keep_shown(n, whole, window, shift, scratch, cutouts):
    """
    Move what a triangle with holes shows from its own tile to the tile at hand, and clear it.

    Does nothing for any other triangle. Takes the triangle's number in its batch, the tile's
    window, and what the vertices were moved by on the sub-pixel grid.
    """
    if cutouts is None:
        return
    face = np.int64(whole[FACE, n])
    if not has_holes(face, cutouts):
        return
    owner = last_at_most(cutouts.face_starts, face)
    cutoff = cutouts.cutoffs[owner]
    depths, numbers, own = scratch[0], scratch[1], scratch[OWN_DEPTH]
    left, top = window[0], window[1]
    for row in range(np.int64(whole[TOP, n]), np.int64(whole[BOTTOM, n]) + 1):
        for column in range(max(np.int64(whole[LEFT, n]), left), np.int64(whole[RIGHT, n]) + 1):
            i, j = row - top, column - left
            stored = own[i, j]
            if stored > depths[i, j]:
                alpha = sample_alpha(face, owner, column, row, shift, cutouts)
                if alpha >= cutoff:
                    depths[i, j] = stored
                    numbers[i, j] = np.int32(face)
            own[i, j] = -np.inf
