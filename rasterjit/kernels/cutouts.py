"""
Leave out the samples where a surface has a hole: where its alpha is below a cutoff.

A triangle of an object with holes is drawn into a tile of its own, by the code that draws every
triangle, so that its samples and depths are those of the same triangle without holes, bit for bit.
What is nearer there than the tile at hand waits, until there are enough samples of one object:
their alphas are found together, and those that pass the test move to the tile at hand, if they are
still nearer. They keep their order, so that of equal depths the first is seen, as without holes.

Alpha is that of the material times that of the vertex or face colours times that of the base colour
texture, each as shading would show it at that sample: the same weights, also where a face was
clipped, and the same filter, with the mip level that the picture at hand calls for (a shadow map
has levels of its own). Samples beside a pixel's centre have their own alpha, at the centre's level.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rasterjit.kernels import patches, texture_rows
from rasterjit.kernels.alpha import face_alpha, texel_alpha
from rasterjit.kernels.batches import BOTTOM, FACE, LEFT, RIGHT, TOP
from rasterjit.kernels.interpolation import find_object, interpolate
from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.patches import COLUMN, FIRST, ROW, A, B, C, whole_vectors
from rasterjit.kernels.setup import TILE_SIZE, last_at_most
from rasterjit.kernels.stretches import find_patches, find_weights
from rasterjit.kernels.texture_places import note_stretch
from rasterjit.kernels.texturing import BASE_COLOR, FIRST_LEVEL
from rasterjit.kernels.vectors import LANES, spread

ALPHA = 3
"""Column of colours and of materials."""

EMPTY, OWN_DEPTH, OWN_NUMBERS, WAITING = 9, 10, 11, 12
"""
Where scratch memory holds the depth of nothing, the tile that a triangle with holes is drawn into,
and what waits.
"""

ENOUGH = 192
"""Samples that wait no longer."""

PART = 256
"""Samples whose alphas are found together."""

COLUMN_BITS = 7
"""The place of a sample in a tile is its row there, shifted by so much, and its column."""


@stage
def has_holes(face, cutouts):
    """Return whether the object of a face has holes; none has if there are no cut-outs."""
    if cutouts is None:
        return False
    owner = last_at_most(cutouts.face_starts, np.int64(face))
    return cutouts.cutoffs[owner] > np.float32(0.0)


@stage
def owner_of(face, guess, cutouts):
    """Return the object that owns a face, if that makes a difference; a guess is tried first."""
    if cutouts is None:
        return guess
    return find_object(np.int64(face), cutouts.face_starts, guess)


@stage
def own_tile(tile, scratch, cutouts):
    """Return the tile that triangles with holes are drawn into, flat; the tile at hand if none."""
    if cutouts is None:
        return tile
    return scratch[OWN_DEPTH].reshape(-1), scratch[OWN_NUMBERS].reshape(-1)


@stage
def tile_for(owner, tile, own, cutouts):
    """Return the tile that an object is drawn into: one of its own if it has holes."""
    if cutouts is None:
        return tile
    if not cutouts.cutoffs[owner] > np.float32(0.0):
        return tile
    return own


# What the alpha of a sample is made of


@disjoint_stage
def fill_alphas(alphas, alpha):
    """Write one alpha for all samples."""
    for n in range(alphas.shape[0]):
        alphas[n] = alpha


@disjoint_stage
def multiply_mixed(alphas, at_a, at_b, at_c, second, third):
    """Multiply alphas by those of vertices, interpolated."""
    for n in range(alphas.shape[0]):
        weights = 0.0, second[n], third[n]
        ends = np.float64(at_a[n]), np.float64(at_b[n]), np.float64(at_c[n])
        alphas[n] *= np.float32(interpolate(weights, ends[0], ends[1], ends[2]))


@stage
def multiply_vertex_alphas(alphas, patches, size, weights, whole, single, vertex_colors):
    """Multiply alphas by those of the vertex colours; nothing if there are none."""
    if vertex_colors is None:
        return
    for r in range(patches):
        n = np.uintp(whole[FIRST, r])
        spread(single[0], n, vertex_colors[np.uintp(whole[A, r]), ALPHA])
        spread(single[1], n, vertex_colors[np.uintp(whole[B, r]), ALPHA])
        spread(single[2], n, vertex_colors[np.uintp(whole[C, r]), ALPHA])
    multiply_mixed(
        alphas[:size], single[0, :size], single[1, :size], single[2, :size], weights[0, :size],
        weights[1, :size],
    )  # fmt: skip


@stage
def multiply_face_alphas(alphas, faces, face_colors):
    """Multiply alphas by those of the face colours; nothing if there are none."""
    if face_colors is None:
        return
    for n in range(faces.shape[0]):
        alphas[n] *= face_alpha(np.int64(faces[n]), face_colors)


@stage
def multiply_texture_alphas(
    alphas, count, owner, patches, weights, whole, real, single, places, lookup, geometry, textures
):  # fmt: skip
    """Multiply alphas by those that the object's texture shows; nothing if it has none."""
    if textures is None:
        return
    if textures.table[owner, BASE_COLOR, FIRST_LEVEL] < 0:
        return
    run = np.int64(0), whole_vectors(count)
    note_stretch(
        places, run, patches, weights, owner, whole, real, single, geometry, textures
    )  # fmt: skip
    texture_rows.read_textures(places, lookup, count, BASE_COLOR, textures)
    for n in range(count):
        alphas[n] *= texel_alpha(places, n)


@stage
def find_alphas(owner, faces, shift, memory, cutouts):
    """
    Write the alphas of samples of one object, whose faces and pixels are known.

    Takes their way to the pixels' centres on the sub-pixel grid.
    """
    geometry, count = cutouts.geometry, faces.shape[0]
    alphas, weights, places, lookup, (whole, real, single) = memory
    run = np.int64(0), whole_vectors(count)
    patches = find_patches(faces, geometry.faces, whole)
    find_weights(weights, run, patches, shift, owner, whole, real, geometry, None, None)
    fill_alphas(alphas[: run[1]], cutouts.materials[owner, ALPHA])
    multiply_vertex_alphas(
        alphas, patches, run[1], weights, whole, single, cutouts.vertex_colors
    )  # fmt: skip
    multiply_face_alphas(alphas, faces, cutouts.face_colors)
    multiply_texture_alphas(
        alphas, count, owner, patches, weights, whole, real, single, places, lookup, geometry,
        cutouts.textures,
    )  # fmt: skip


@stage
def pixel_alpha(face, owner, column, row, memory, cutouts):
    """Return the alpha of a face at a pixel's centre."""
    listed, own = memory
    whole, centre = own[-1][0], (np.int32(0), np.int32(0))
    listed[0], whole[COLUMN, 0], whole[ROW, 0] = face, column, row
    find_alphas(owner, listed, centre, own, cutouts)
    return own[0][0]


# What waits


@stage
def note_neighbours(own, depths, empty, i, j, last, places, stored, waiting):
    """
    Note which of a few samples of a row are nearer than the tile at hand, and empty them.

    Takes row and column in the tile, and the last column of account. Returns how many wait then.
    """
    found = np.int32(0)
    for k in range(LANES):
        column = np.uintp(j + k)
        found |= np.int32(own[i, column] > depths[i, column])
    if found != 0:
        for k in range(LANES):
            column, place = np.uintp(j + k), np.uintp(waiting)
            # Without a branch: the next overwrites what is hidden.
            places[place] = np.int32((np.int64(i) << COLUMN_BITS) | (j + k))
            stored[place] = own[i, column]
            waiting += np.int64((own[i, column] > depths[i, column]) & (j + k <= last))
    for k in range(LANES):
        own[i, np.uintp(j + k)] = empty
    return waiting


@stage
def note_nearer(n, waiting, whole, window, scratch):
    """Let the samples of a triangle wait that are nearer than the tile at hand; count all."""
    depths, own, empty = scratch[0], scratch[OWN_DEPTH], scratch[EMPTY][0]
    places, faces, stored = scratch[WAITING][0]
    before = waiting
    first = max(np.int64(whole[LEFT, n]), window[0]) - window[0]
    last = np.int64(whole[RIGHT, n]) - window[0]
    top, bottom = np.int64(whole[TOP, n]) - window[1], np.int64(whole[BOTTOM, n]) - window[1]
    for row in range(top, bottom + 1):
        for column in range(first, last + 1, LANES):
            waiting = note_neighbours(
                own, depths, empty, np.uintp(row), column, last, places, stored, waiting
            )
    for k in range(before, waiting, LANES):
        spread(faces, np.uintp(k), whole[FACE, n])
    return waiting


@disjoint_stage
def place_pixels(columns, rows, places, left, top):
    """Write the pixels of samples, given their places in a tile and the tile's first pixel."""
    for n in range(columns.shape[0]):
        columns[n] = np.int32((places[n] & ((1 << COLUMN_BITS) - 1)) + left)
        rows[n] = np.int32((places[n] >> COLUMN_BITS) + top)


@disjoint_stage
def put_shown(depths, numbers, width, places, stored, faces, alphas, cutoff):
    """Move samples whose alpha is not below the cutoff to a tile, flat, where they are nearer."""
    # Nobody reads the last sample of a tile.
    spare = np.uintp(depths.shape[0] - 1)
    for n in range(places.shape[0]):
        row, column = places[n] >> COLUMN_BITS, places[n] & ((1 << COLUMN_BITS) - 1)
        sample = np.uintp(row * width + column)
        is_seen = (alphas[n] >= cutoff) & (stored[n] > depths[sample])
        sample = sample if is_seen else spare
        depths[sample] = stored[n]
        numbers[sample] = faces[n]


@stage
def show_waiting(owner, waiting, window, shift, scratch, cutouts):
    """Move the samples that wait to the tile at hand, where they are neither holes nor hidden."""
    (places, faces, stored), memory = scratch[WAITING]
    depths, numbers, whole = scratch[0].reshape(-1), scratch[1].reshape(-1), memory[-1][0]
    for first in range(0, waiting, PART):
        stop = min(first + PART, waiting)
        count = stop - first
        place_pixels(
            whole[COLUMN, :count], whole[ROW, :count], places[first:stop], window[0], window[1]
        )
        find_alphas(owner, faces[first:stop], shift, memory, cutouts)
        put_shown(
            depths, numbers, scratch[0].shape[1], places[first:stop], stored[first:stop],
            faces[first:stop], memory[0][:count], cutouts.cutoffs[owner],
        )  # fmt: skip


@stage
def keep_shown(n, count, owner, waiting, whole, window, shift, scratch, cutouts):
    """
    Move what a triangle with holes shows from its own tile to the tile at hand, now or later.

    Does nothing for any other triangle. Takes the triangle's number in its batch of ``count``, its
    object, how many samples wait, the tile's window, and what the vertices were moved by on the
    sub-pixel grid. Returns how many wait then: none where the next triangle is of another object.
    """
    if cutouts is None:
        return waiting
    if not cutouts.cutoffs[owner] > np.float32(0.0):
        return waiting
    waiting = note_nearer(n, waiting, whole, window, scratch)
    if waiting < ENOUGH and n + 1 < count:
        face, starts = np.int64(whole[FACE, n + np.uintp(1)]), cutouts.face_starts
        if starts[owner] <= face < starts[owner + 1]:
            return waiting
    show_waiting(owner, waiting, window, shift, scratch, cutouts)
    return np.int64(0)


def alpha_memory(room: int = PART) -> tuple[Any, ...]:
    """Return the memory that a thread needs to find the alphas of so many samples together."""
    room = whole_vectors(room) + LANES
    return (
        np.empty(room, np.float32),
        np.empty((2, room), np.float64),
        np.empty((texture_rows.SCRATCH_ROWS, room), np.float64),
        texture_rows.lookup_memory(room),
        (
            np.empty((patches.WHOLE_ROWS, room), np.int32),
            np.empty((patches.VERTEX_ROWS, room), np.float64),
            np.empty((patches.VERTEX_ROWS, room), np.float32),
        ),
    )


def pixel_memory() -> tuple[Any, ...]:
    """Return the memory that a thread needs to find the alpha of one pixel."""
    return np.empty(1, np.int32), alpha_memory(1)


def waiting_memory(depth_type: Any) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Return the memory for the samples that wait in one tile: all of one triangle, and some."""
    room = ENOUGH + TILE_SIZE * TILE_SIZE + LANES
    lists = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, depth_type)
    return lists, alpha_memory()
