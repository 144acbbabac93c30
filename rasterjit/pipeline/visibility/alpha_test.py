"""
Alpha test: discard samples whose alpha is below a cutoff ("holes").

An alpha-tested triangle is rasterized into a scratch tile, by the code that draws every triangle,
so its coverage and depths are those of an untested one, bit for bit. Samples that pass the depth
test queue until a batch of one object is full. Then their alphas are computed together, and those
that pass the alpha test move to the frame's tile, if they are still nearer. They keep their order,
so that the first of equal depths is seen, as without alpha test.

Alpha is the product of the material's, the vertex or face colours' and the base colour texture's,
each as in shading: the same weights, also on clipped faces, and the same filter, with the mip level
of the picture being drawn (a shadow map has its own). Samples off a pixel's centre have their own
alpha, at the centre's mip level.

Other kernels call these by address (``jit.Bound``): they are compiled once for all of them, and
only where an object is alpha-tested.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from rasterjit.pipeline.geometry import barycentric
from rasterjit.pipeline.geometry.setup import CLIPPED, TILE_SIZE, corners_of, last_at_most
from rasterjit.pipeline.geometry.triangle_batches import BOTTOM, LEFT, RIGHT, TOP
from rasterjit.pipeline.geometry.triangle_batches import FACE as NUMBER
from rasterjit.pipeline.records import AlphaTests
from rasterjit.pipeline.surface import sample_block as at
from rasterjit.pipeline.surface import texture_lookup, uv_derivatives
from rasterjit.pipeline.surface.barycentric_weights import weigh
from rasterjit.pipeline.surface.gather_samples import whole_vectors
from rasterjit.pipeline.surface.texture_filters import (
    ALPHA_USE,
    BASE_COLOR,
    FILTER,
    FIRST_LEVEL,
    MASK,
    TRILINEAR,
)
from rasterjit.pipeline.surface.texture_lookup import DOWN_V, RIGHT_U, SHOWN, U, V, show_textures
from rasterjit.pipeline.visibility.hashed_alpha import keep_share
from rasterjit.runtime.intrinsics import (
    LANES,
    call_bound,
    flat,
    part,
    six_parts,
    spread,
    three_parts,
)
from rasterjit.runtime.jit import Bound, disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64, stored

ALPHA = 3
"""Column of colours and of materials."""

ENOUGH = 192
"""Queued samples that trigger the computation of their alphas."""

PART = 256
"""Most samples of one alpha computation."""

COLUMN_BITS = 7
"""A sample's index in a tile is ``row << COLUMN_BITS | column``."""

ALPHA_MEMORY = (
    int32[:, ::1], float64[:, ::1], float32[:, ::1], float32[::1], float64[:, ::1],
    float64[:, ::1], int32[:, ::1], float32[:, ::1], float32[:, ::1],
)  # fmt: skip
"""The types of `alpha_memory`."""

FIRST_SAMPLE, SAMPLES, OBJECT, SHIFT_X, SHIFT_Y = range(5)
"""
Elements of ``Question.asked``: the first sample in the list and how many, their object, and their
offset from the pixels' centres, sub-pixel units.
"""

NTH, BATCH_COUNT, LAST_OWNER, WAITING, LEFT_COLUMN, TOP_ROW, MOVED_X, MOVED_Y = range(8)
"""
Elements of ``Holes.asked``: a triangle's index in its batch, the batch's size, its object, how many
samples are queued, the tile's first pixel, and the offset added to vertices, sub-pixel units.
"""


class Question(NamedTuple):
    """Arguments by which a kernel requests the alphas of samples of one object."""

    face_starts: int64[::1]
    cutoffs: float32[::1]
    """As ``AlphaTests`` has them; of no objects where none has holes."""
    asked: int64[::1]
    faces: int32[::1]
    """The face of each sample."""
    pixels: int32[:, ::1]
    """In rows ``COLUMN`` and ``ROW``: the pixel of each sample."""
    alphas: float32[::1]
    """Result: the alpha of each sample."""
    call: int64[::1]
    """How to call `find_alphas`."""


class Holes(NamedTuple):
    """Arguments by which a kernel that rasterizes a tile runs the alpha test."""

    face_starts: int64[::1]
    cutoffs: float32[::1]
    """As ``AlphaTests`` has them; of no objects where none has holes."""
    depth: stored[:, ::1]
    numbers: int32[:, ::1]
    """Face numbers of the scratch tile for alpha-tested triangles; depths are cleared after use."""
    asked: int64[::1]
    call: int64[::1]
    """How to call `keep_shown`."""


# Alpha of samples


@helper
def gather_patches(faces, own, xy, codes, w, whole, real):
    """
    List the patches of samples, and gather the positions and w of their faces' vertices.

    A patch is a run of neighbours that show one face. For affine interpolation w is 1. Returns the
    number of patches.
    """
    patches, before = np.uintp(0), np.int32(-1)
    for i in range(np.uintp(faces.shape[0])):
        # Without a branch: the next overwrites what starts no patch.
        face = faces[i]
        whole[at.FIRST, patches], whole[at.FACE, patches] = i, face
        patches += np.uintp((face != before) | (i % np.uintp(LANES) == np.uintp(0)))
        before = face
    whole[at.FIRST, patches] = faces.shape[0]
    is_affine = w.shape[0] == 0
    for r in range(patches):
        n = np.uintp(whole[at.FIRST, r])
        a, b, c = corners_of(own, np.uintp(whole[at.FACE, r]))
        whole[at.A, r], whole[at.B, r], whole[at.C, r] = a, b, c
        spread(whole[at.INEXACT], n, np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED))
        for k in range(3):
            vertex = a if k == 0 else (b if k == 1 else c)
            spread(whole[at.AX + 2 * k], n, xy[vertex, 0])
            spread(whole[at.AY + 2 * k], n, xy[vertex, 1])
            spread(real[k], n, 1.0 if is_affine else w[vertex])
    return patches


@helper
def find_weights(weights, count, patches, shift, whole, real, geometry):
    """Write the barycentric weights of samples from gathered vertices and pixels."""
    size, bits = whole_vectors(count), geometry.viewport.grid_bits
    half = np.int32(1) << (bits - 1)
    unsure = weigh(
        *six_parts(whole, at.AX, 0, size), *three_parts(real, 0, 0, size),
        part(whole, at.COLUMN, 0, size), part(whole, at.ROW, 0, size), count,
        (half - shift[0], half - shift[1]), bits, geometry.viewport.reach, geometry.w.shape[0] == 0,
        1.0, part(whole, at.INEXACT, 0, size), part(whole, at.BACKFACE, 0, size),
        part(weights, 0, 0, size), part(weights, 1, 0, size),
    )  # fmt: skip
    if unsure != 0:
        for r in range(patches):
            a, b, c = np.uintp(whole[at.A, r]), np.uintp(whole[at.B, r]), np.uintp(whole[at.C, r])
            for i in range(whole[at.FIRST, r], whole[at.FIRST, r + np.uintp(1)]):
                if whole[at.INEXACT, i] != 0:
                    column, row = whole[at.COLUMN, i], whole[at.ROW, i]
                    exact = barycentric.shifted_weights(a, b, c, column, row, shift, geometry)
                    weights[0, i], weights[1, i] = exact[1], exact[2]


@disjoint_helper
def multiply_mixed(alphas, at_a, at_b, at_c, second, third):
    """Multiply alphas by interpolated vertex alphas."""
    for n in range(alphas.shape[0]):
        weights = 0.0, second[n], third[n]
        ends = np.float64(at_a[n]), np.float64(at_b[n]), np.float64(at_c[n])
        alphas[n] *= np.float32(barycentric.interpolate(weights, ends[0], ends[1], ends[2]))


@helper
def multiply_vertex_alphas(alphas, patches, size, weights, whole, single, vertex_colors):
    """Multiply alphas by those of the vertex colours."""
    for r in range(patches):
        n = np.uintp(whole[at.FIRST, r])
        for k in range(3):
            spread(single[k], n, vertex_colors[np.uintp(whole[at.A + k, r]), ALPHA])
    multiply_mixed(
        alphas[:size], *three_parts(single, 0, 0, size), part(weights, 0, 0, size),
        part(weights, 1, 0, size),
    )  # fmt: skip


@helper
def find_coordinates(
    places, size, patches, weights, owner, whole, real, single, geometry, textures
):  # fmt: skip
    """Write the texture coordinates of samples, and their derivatives if a texture needs them."""
    uv = textures.uv
    for r in range(patches):
        n = np.uintp(whole[at.FIRST, r])
        for k in range(3):
            vertex = np.uintp(whole[at.A + k, r])
            spread(single[2 * k], n, uv[vertex, 0])
            spread(single[2 * k + 1], n, uv[vertex, 1])
    uv_derivatives.mix_places(
        *three_parts(places, U, 0, size), *six_parts(single, 0, 0, size), part(weights, 0, 0, size),
        part(weights, 1, 0, size), np.float64(owner),
    )  # fmt: skip
    if not uv_derivatives.wants_steps(owner, textures.table):
        return
    viewport = geometry.viewport
    uv_derivatives.mix_steps(
        *three_parts(places, RIGHT_U, 0, size), part(places, DOWN_V, 0, size),
        part(places, U, 0, size), part(places, V, 0, size), *six_parts(single, 0, 0, size),
        *six_parts(whole, at.AX, 0, size), *three_parts(real, 0, 0, size),
        part(whole, at.COLUMN, 0, size), part(whole, at.ROW, 0, size), viewport.grid_bits,
        viewport.spacing, geometry.w.shape[0] == 0,
    )  # fmt: skip
    if geometry.clip_positions.shape[0] == 0:
        return
    for r in range(patches):
        a, b, c = np.uintp(whole[at.A, r]), np.uintp(whole[at.B, r]), np.uintp(whole[at.C, r])
        if (geometry.codes[a] | geometry.codes[b] | geometry.codes[c]) & CLIPPED:
            for i in range(whole[at.FIRST, r], whole[at.FIRST, r + np.uintp(1)]):
                column, row = whole[at.COLUMN, i], whole[at.ROW, i]
                uv_derivatives.note_clipped_steps(
                    places, i, a, b, c, column, row, uv, geometry.clip_positions, viewport
                )


@kernel
def find_alphas(
    asked: int64[::1], listed: int32[::1], memory: ALPHA_MEMORY, alpha_tests: AlphaTests,
):  # fmt: skip
    """
    Write the alphas of samples of one object, whose pixels are in the memory.

    Parameters
    ----------
    asked : (5,) int64
        As ``Question.asked``.
    listed : (N,) int32
        The face of each sample.
    memory : tuple
        This thread's own, from `alpha_memory`.
    alpha_tests : AlphaTests
    """
    owner, count = asked[OBJECT], asked[SAMPLES]
    shift = np.int32(asked[SHIFT_X]), np.int32(asked[SHIFT_Y])
    faces = listed[asked[FIRST_SAMPLE] : asked[FIRST_SAMPLE] + count]
    geometry, textures = alpha_tests.geometry, alpha_tests.textures
    whole, real, single, alphas, weights, places = memory[:6]
    patches = gather_patches(
        faces, geometry.faces, geometry.xy, geometry.codes, geometry.w, whole, real
    )
    find_weights(weights, count, patches, shift, whole, real, geometry)
    for n in range(count):
        alphas[n] = alpha_tests.materials[owner, ALPHA]
    if alpha_tests.vertex_colors.shape[0] > 0:
        multiply_vertex_alphas(
            alphas, patches, whole_vectors(count), weights, whole, single, alpha_tests.vertex_colors
        )
    if alpha_tests.face_colors.shape[0] > 0:
        for n in range(count):
            alphas[n] *= alpha_tests.face_colors[np.int64(faces[n]), ALPHA]
    if textures.table.shape[0] == 0 or textures.table[owner, BASE_COLOR, FIRST_LEVEL] < 0:
        return
    find_coordinates(
        places, whole_vectors(count), patches, weights, owner, whole, real, single, geometry,
        textures,
    )  # fmt: skip
    show_textures(places, memory[6:], count, BASE_COLOR, textures)
    row = textures.table[owner, BASE_COLOR]
    if row[ALPHA_USE] == MASK and row[FILTER] == TRILINEAR:
        cutoff = alpha_tests.cutoffs[owner] / alpha_tests.materials[owner, ALPHA]
        keep_share(count, cutoff, textures, owner, BASE_COLOR, places, memory[6:])
    for n in range(count):
        alphas[n] *= memory[8][SHOWN + ALPHA, n]


@helper
def is_hole(face, column, row, question):
    """Return whether a face fails the alpha test at a pixel's centre; False if it is not tested."""
    if question.cutoffs.shape[0] == 0:
        return False
    owner = last_at_most(question.face_starts, face)
    cutoff, asked = question.cutoffs[owner], question.asked
    if not cutoff > np.float32(0.0):
        return False
    asked[FIRST_SAMPLE], asked[SAMPLES], asked[OBJECT] = 0, 1, owner
    asked[SHIFT_X], asked[SHIFT_Y] = 0, 0
    question.faces[0] = face
    question.pixels[at.COLUMN, 0], question.pixels[at.ROW, 0] = column, row
    call_bound(question.call)
    return not question.alphas[0] >= cutoff


# The queue of samples


@helper
def note_neighbours(own, depths, empty, i, j, last, places, stored, waiting):
    """
    Queue those of a few samples of a row that pass the depth test, and clear them.

    Takes row and column in the tile, and the last column that counts. Returns the queue's length.
    """
    found = np.int32(0)
    for k in range(LANES):
        column = np.uintp(j + k)
        found |= np.int32(own[i, column] > depths[i, column])
    if found != 0:
        for k in range(LANES):
            column, place = np.uintp(j + k), np.uintp(waiting)
            # Branchless: the next sample overwrites a hidden one.
            places[place] = np.int32((np.int64(i) << COLUMN_BITS) | (j + k))
            stored[place] = own[i, column]
            waiting += np.int64((own[i, column] > depths[i, column]) & (j + k <= last))
    for k in range(LANES):
        own[i, np.uintp(j + k)] = empty
    return waiting


@helper
def note_nearer(n, waiting, batch, left, top, depths, own, empty, lists):
    """Queue the samples of a triangle that pass the depth test; return the queue's length."""
    places, faces, nearness = lists
    before = waiting
    first = max(np.int64(batch[LEFT, n]) - left, np.int64(0))
    last = np.int64(batch[RIGHT, n]) - left
    for row in range(np.int64(batch[TOP, n]) - top, np.int64(batch[BOTTOM, n]) - top + 1):
        for column in range(first, last + 1, LANES):
            waiting = note_neighbours(
                own, depths, empty, np.uintp(row), column, last, places, nearness, waiting
            )
    for k in range(before, waiting, LANES):
        spread(faces, np.uintp(k), batch[NUMBER, n])
    return waiting


@disjoint_helper
def place_pixels(columns, rows, places, left, top):
    """Write the pixels of samples, given their indices in a tile and the tile's first pixel."""
    for n in range(columns.shape[0]):
        columns[n] = np.int32((places[n] & ((1 << COLUMN_BITS) - 1)) + left)
        rows[n] = np.int32((places[n] >> COLUMN_BITS) + top)


@disjoint_helper
def put_shown(depths, numbers, width, places, stored, faces, alphas, cutoff):
    """Write samples that pass the alpha test to a tile, flat, where they are nearer."""
    # The last sample of a tile is padding, never read.
    spare = np.uintp(depths.shape[0] - 1)
    for n in range(places.shape[0]):
        row, column = places[n] >> COLUMN_BITS, places[n] & ((1 << COLUMN_BITS) - 1)
        sample = np.uintp(row * width + column)
        is_seen = (alphas[n] >= cutoff) & (stored[n] > depths[sample])
        sample = sample if is_seen else spare
        depths[sample] = stored[n]
        numbers[sample] = faces[n]


@helper
def show_waiting(waiting, asked, tile, lists, question):
    """Run the alpha test on queued samples; write those that pass to the frame's tile if nearer."""
    places, faces, nearness = lists
    owner, query = asked[LAST_OWNER], question.asked
    query[OBJECT], query[SHIFT_X], query[SHIFT_Y] = owner, asked[MOVED_X], asked[MOVED_Y]
    for first in range(0, waiting, PART):
        stop = min(first + PART, waiting)
        count = stop - first
        place_pixels(
            part(question.pixels, at.COLUMN, 0, count), part(question.pixels, at.ROW, 0, count),
            places[first:stop], asked[LEFT_COLUMN], asked[TOP_ROW],
        )  # fmt: skip
        query[FIRST_SAMPLE], query[SAMPLES] = first, count
        call_bound(question.call)
        put_shown(
            flat(tile[0]), flat(tile[1]), tile[0].shape[1], places[first:stop],
            nearness[first:stop], faces[first:stop], question.alphas[:count],
            question.cutoffs[owner],
        )  # fmt: skip


@kernel
def keep_shown(
    asked: int64[::1], tile: (stored[:, ::1], int32[:, ::1]), own: stored[:, ::1],
    empty: stored[::1], batch: int32[:, ::1], lists: (int32[::1], int32[::1], stored[::1]),
    question: Question,
):  # fmt: skip
    """
    Move an alpha-tested triangle from its scratch tile to the queue, flushing it when full.

    Parameters
    ----------
    asked : (8,) int64
        As ``Holes.asked``.
    tile : (depth, face numbers)
        The frame's tile.
    own : (rows, columns), stored depth
        The scratch tile; cleared.
    empty : (1,), stored depth
        That of empty samples.
    batch : (rows, columns) int32
        The triangles of the batch, as ``triangle_batches`` sets them up.
    lists : (places, face numbers, stored depths)
        The queue.
    question : Question

    Returns
    -------
    int
        The queue's length: 0 if it was flushed, because it was full, the batch ended or the next
        triangle is of another object.
    """
    n, owner = np.uintp(asked[NTH]), asked[LAST_OWNER]
    waiting = note_nearer(
        n, asked[WAITING], batch, asked[LEFT_COLUMN], asked[TOP_ROW], tile[0], own, empty[0], lists
    )
    if waiting < ENOUGH and asked[NTH] + 1 < asked[BATCH_COUNT]:
        face, starts = np.int64(batch[NUMBER, n + np.uintp(1)]), question.face_starts
        if starts[owner] <= face < starts[owner + 1]:
            return waiting
    show_waiting(waiting, asked, tile, lists, question)
    return np.int64(0)


# Calls for each triangle


@helper
def begin_batch(holes, count, origin, shift):
    """Store what the triangles of a batch share: size, tile origin, offset."""
    asked = holes.asked
    asked[BATCH_COUNT], asked[WAITING] = count, 0
    asked[LEFT_COLUMN], asked[TOP_ROW] = origin
    asked[MOVED_X], asked[MOVED_Y] = shift


@helper
def find_owner(face, guess, holes):
    """Return the object that owns a face, and whether it is alpha-tested; tries a guess first."""
    owner = barycentric.find_object(np.int64(face), holes.face_starts, guess)
    return owner, holes.cutoffs[owner] > np.float32(0.0)


@helper
def keep(n, owner, holes):
    """Move triangle ``n`` of the batch from its scratch tile to the queue; see `keep_shown`."""
    holes.asked[NTH], holes.asked[LAST_OWNER] = n, owner
    holes.asked[WAITING] = call_bound(holes.call)


# Memory


def alpha_memory(room: int = PART) -> tuple[Any, ...]:
    """Return a thread's memory for computing the alphas of up to ``room`` samples together."""
    # As `whole_vectors`, which is compiled: calling it here would wait for Numba.
    room = -(-room // at.VECTOR) * at.VECTOR + LANES
    return (
        np.empty((at.INT_ROWS, room), np.int32),
        np.empty((at.VERTEX_ROWS, room), np.float64),
        np.empty((at.VERTEX_ROWS, room), np.float32),
        np.empty(room, np.float32),
        np.empty((2, room), np.float64),
        np.empty((texture_lookup.SCRATCH_ROWS, room), np.float64),
        *texture_lookup.lookup_memory(room),
    )


class AlphaTest:
    """
    A thread's state for computing alphas.

    Keep it alive while its question is in use: machine code holds addresses of its memory.

    Parameters
    ----------
    alpha_tests : AlphaTests or None
        None: no object has holes.
    listed : int
        The most samples in a list.
    together : int
        The most samples whose alphas are found together.
    """

    def __init__(self, alpha_tests: AlphaTests | None, listed: int = 1, together: int = 1) -> None:
        if alpha_tests is None:
            self.question = NO_QUESTION
            return
        faces, asked = np.empty(listed, np.int32), np.zeros(5, np.int64)
        memory = alpha_memory(together)
        self._bound = Bound(find_alphas, asked, faces, memory, alpha_tests)
        self.question = Question(
            alpha_tests.face_starts, alpha_tests.cutoffs, asked, faces, memory[0], memory[3],
            self._bound.words,
        )  # fmt: skip


NO_QUESTION = Question(
    np.empty(0, np.int64), np.empty(0, np.float32), np.empty(0, np.int64), np.empty(0, np.int32),
    np.empty((0, 0), np.int32), np.empty(0, np.float32), np.empty(0, np.int64),
)  # fmt: skip
"""No object has holes."""


class TileTest:
    """
    A thread's state for alpha-testing a tile.

    Keep it alive while its record is in use: machine code holds addresses of its memory.

    Parameters
    ----------
    alpha_tests : AlphaTests or None
        None: no object has holes.
    tile : (depth, face numbers)
        The tile that the thread draws into.
    empty : (1,)
        The depth where nothing is, as it is stored.
    batch : (rows, columns) int32
        Where triangles are set up.
    """

    def __init__(
        self, alpha_tests: AlphaTests | None, tile: tuple[Any, Any], empty: Any, batch: Any
    ):
        if alpha_tests is None:
            self.holes = no_holes(empty.dtype)
            return
        # All samples of one triangle may be queued, and some more.
        room = ENOUGH + TILE_SIZE * TILE_SIZE + LANES
        self._test = AlphaTest(alpha_tests, room, PART)
        question, asked = self._test.question, np.zeros(8, np.int64)
        own = np.full(tile[0].shape, empty[0]), np.empty(tile[0].shape, np.int32)
        lists = np.empty(room, np.int32), question.faces, np.empty(room, empty.dtype)
        self._bound = Bound(keep_shown, asked, tile, own[0], empty, batch, lists, question)
        self.holes = Holes(
            alpha_tests.face_starts, alpha_tests.cutoffs, *own, asked, self._bound.words
        )


@functools.cache
def no_holes(depth_type: np.dtype[Any]) -> Holes:
    """Return the `Holes` of a scene without alpha test, for depths of a type."""
    return Holes(
        NO_QUESTION.face_starts, NO_QUESTION.cutoffs, np.empty((0, 0), depth_type),
        np.empty((0, 0), np.int32), NO_QUESTION.asked, NO_QUESTION.call,
    )  # fmt: skip
