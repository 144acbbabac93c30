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
from rasterjit.pipeline.geometry.setup import (
    CLIPPED,
    TILE_SIZE,
    find_last_at_most,
    get_face_vertices,
)
from rasterjit.pipeline.geometry.triangle_batches import BOTTOM, FACE, LEFT, RIGHT, TOP
from rasterjit.pipeline.records import AlphaTests
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface import texture_lookup, uv_derivatives
from rasterjit.pipeline.surface.barycentric_weights import weigh_samples
from rasterjit.pipeline.surface.gather_samples import get_patch_vertices, round_up_to_vectors
from rasterjit.pipeline.surface.texture_filters import (
    ALPHA_USE,
    BASE_COLOR,
    FILTER,
    FIRST_LEVEL,
    MASK,
    TRILINEAR,
)
from rasterjit.pipeline.surface.texture_lookup import (
    DOWN_V,
    RIGHT_U,
    TEXTURE_RED,
    U,
    V,
    look_up_textures,
)
from rasterjit.pipeline.visibility.hashed_alpha import apply_hashed_alpha
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

FLUSH_SAMPLES = 192
"""Queued samples that trigger the computation of their alphas."""

MAX_BATCH_SAMPLES = 256
"""Most samples whose alphas are computed together."""

COLUMN_BITS = 7
"""A sample's index in a tile is ``row << COLUMN_BITS | column``."""

ALPHA_MEMORY = (
    int32[:, ::1], float64[:, ::1], float32[:, ::1], float32[::1], float64[:, ::1],
    float64[:, ::1], int32[:, ::1], float32[:, ::1], float32[:, ::1],
)  # fmt: skip
"""Types of `allocate_alpha_memory`."""

FIRST_SAMPLE, SAMPLE_COUNT, SAMPLE_OBJECT, SHIFT_X, SHIFT_Y = range(5)
"""
Elements of ``AlphaQuery.request``: first sample in the list and how many, their object, and their
offset from the pixels' centres, sub-pixel units.
"""

TRIANGLE, BATCH_COUNT, LAST_OWNER, QUEUED, LEFT_COLUMN, TOP_ROW, OFFSET_X, OFFSET_Y = range(8)
"""
Elements of ``AlphaQueue.request``: a triangle's index in its batch, the batch's size, its object,
how many samples are queued, the tile's first pixel, and the offset added to vertices, sub-pixel
units.
"""


class AlphaQuery(NamedTuple):
    """Arguments of a query for the alphas of samples of one object."""

    face_starts: int64[::1]
    cutoffs: float32[::1]
    """As ``AlphaTests`` has them; of no objects where none is alpha-tested."""
    request: int64[::1]
    faces: int32[::1]
    """The face of each sample."""
    pixels: int32[:, ::1]
    """In rows ``COLUMN`` and ``ROW``: the pixel of each sample."""
    alphas: float32[::1]
    """Result: the alpha of each sample."""
    call: int64[::1]
    """How to call `find_alphas`."""


class AlphaQueue(NamedTuple):
    """Arguments by which a kernel that rasterizes a tile queues samples for the alpha test."""

    face_starts: int64[::1]
    cutoffs: float32[::1]
    """As ``AlphaTests`` has them; of no objects where none is alpha-tested."""
    depth: stored[:, ::1]
    numbers: int32[:, ::1]
    """Face numbers of the scratch tile for alpha-tested triangles; depths are cleared after use."""
    request: int64[::1]
    call: int64[::1]
    """How to call `queue_triangle`."""


@helper
def gather_patches(faces, faces_of, xy, codes, w, ints, doubles):
    """
    List the patches of samples, and gather the positions and w of their faces' vertices.

    A patch is a run of neighbouring samples of one face. For affine interpolation w is 1. Returns
    the number of patches.
    """
    patches, last_face = np.uintp(0), np.int32(-1)
    for i in range(np.uintp(faces.shape[0])):
        # Branchless: the next sample overwrites one that starts no patch.
        face = faces[i]
        ints[rows.FIRST_SAMPLE, patches], ints[rows.FACE, patches] = i, face
        patches += np.uintp((face != last_face) | (i % np.uintp(LANES) == np.uintp(0)))
        last_face = face
    ints[rows.FIRST_SAMPLE, patches] = faces.shape[0]
    is_affine = w.shape[0] == 0
    for r in range(patches):
        n = np.uintp(ints[rows.FIRST_SAMPLE, r])
        a, b, c = get_face_vertices(faces_of, np.uintp(ints[rows.FACE, r]))
        ints[rows.A, r], ints[rows.B, r], ints[rows.C, r] = a, b, c
        spread(ints[rows.INEXACT], n, np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED))
        for k in range(3):
            vertex = a if k == 0 else (b if k == 1 else c)
            spread(ints[rows.AX + 2 * k], n, xy[vertex, 0])
            spread(ints[rows.AY + 2 * k], n, xy[vertex, 1])
            spread(doubles[k], n, 1.0 if is_affine else w[vertex])
    return patches


@helper
def find_weights(weights, count, patches, shift, ints, doubles, geometry):
    """Write the barycentric weights of samples from gathered vertices and pixels."""
    size, bits = round_up_to_vectors(count), geometry.viewport.grid_bits
    half = np.int32(1) << (bits - 1)
    inexact = weigh_samples(
        *six_parts(ints, rows.AX, 0, size), *three_parts(doubles, 0, 0, size),
        part(ints, rows.COLUMN, 0, size), part(ints, rows.ROW, 0, size), count,
        (half - shift[0], half - shift[1]), bits, geometry.viewport.sample_radius,
        geometry.w.shape[0] == 0, 1.0, part(ints, rows.INEXACT, 0, size),
        part(ints, rows.BACKFACE, 0, size), part(weights, 0, 0, size), part(weights, 1, 0, size),
    )  # fmt: skip
    if inexact != 0:
        for r in range(patches):
            a, b, c = get_patch_vertices(ints, r)
            for i in range(ints[rows.FIRST_SAMPLE, r], ints[rows.FIRST_SAMPLE, r + np.uintp(1)]):
                if ints[rows.INEXACT, i] != 0:
                    column, row = ints[rows.COLUMN, i], ints[rows.ROW, i]
                    exact = barycentric.compute_shifted_weights(
                        a, b, c, column, row, shift, geometry
                    )
                    weights[0, i], weights[1, i] = exact[1], exact[2]


@disjoint_helper
def multiply_interpolated(alphas, at_a, at_b, at_c, second, third):
    """Multiply alphas by interpolated vertex alphas."""
    for n in range(alphas.shape[0]):
        weights = 0.0, second[n], third[n]
        ends = np.float64(at_a[n]), np.float64(at_b[n]), np.float64(at_c[n])
        alphas[n] *= np.float32(barycentric.interpolate(weights, ends[0], ends[1], ends[2]))


@helper
def multiply_vertex_alphas(alphas, patches, size, weights, ints, floats, vertex_colors):
    """Multiply alphas by those of the vertex colours."""
    for r in range(patches):
        n = np.uintp(ints[rows.FIRST_SAMPLE, r])
        for k in range(3):
            spread(floats[k], n, vertex_colors[np.uintp(ints[rows.A + k, r]), ALPHA])
    multiply_interpolated(
        alphas[:size], *three_parts(floats, 0, 0, size), part(weights, 0, 0, size),
        part(weights, 1, 0, size),
    )  # fmt: skip


@helper
def interpolate_uv(
    uv_rows, size, patches, weights, owner, ints, doubles, floats, geometry, textures
):  # fmt: skip
    """Write the texture coordinates of samples, and their derivatives if a texture needs them."""
    uv = textures.uv
    for r in range(patches):
        n = np.uintp(ints[rows.FIRST_SAMPLE, r])
        for k in range(3):
            vertex = np.uintp(ints[rows.A + k, r])
            spread(floats[2 * k], n, uv[vertex, 0])
            spread(floats[2 * k + 1], n, uv[vertex, 1])
    uv_derivatives.interpolate_mixed_uv(
        *three_parts(uv_rows, U, 0, size), *six_parts(floats, 0, 0, size),
        part(weights, 0, 0, size), part(weights, 1, 0, size), np.float64(owner),
    )  # fmt: skip
    if not uv_derivatives.has_mipmapped_texture(owner, textures.table):
        return
    viewport = geometry.viewport
    uv_derivatives.write_mixed_uv_steps(
        *three_parts(uv_rows, RIGHT_U, 0, size), part(uv_rows, DOWN_V, 0, size),
        part(uv_rows, U, 0, size), part(uv_rows, V, 0, size), *six_parts(floats, 0, 0, size),
        *six_parts(ints, rows.AX, 0, size), *three_parts(doubles, 0, 0, size),
        part(ints, rows.COLUMN, 0, size), part(ints, rows.ROW, 0, size), viewport.grid_bits,
        viewport.spacing, geometry.w.shape[0] == 0,
    )  # fmt: skip
    if geometry.clip_positions.shape[0] == 0:
        return
    for r in range(patches):
        a, b, c = get_patch_vertices(ints, r)
        if (geometry.codes[a] | geometry.codes[b] | geometry.codes[c]) & CLIPPED:
            for i in range(ints[rows.FIRST_SAMPLE, r], ints[rows.FIRST_SAMPLE, r + np.uintp(1)]):
                column, row = ints[rows.COLUMN, i], ints[rows.ROW, i]
                uv_derivatives.write_clipped_uv_step(
                    uv_rows, i, a, b, c, column, row, uv, geometry.clip_positions, viewport
                )


@kernel
def find_alphas(
    request: int64[::1], listed: int32[::1], memory: ALPHA_MEMORY, alpha_tests: AlphaTests,
):  # fmt: skip
    """
    Write the alphas of samples of one object, whose pixels are in the memory.

    Parameters
    ----------
    request : (5,) int64
        As ``AlphaQuery.request``.
    listed : (N,) int32
        The face of each sample.
    memory : tuple
        From `allocate_alpha_memory`, of this thread alone.
    alpha_tests : AlphaTests
    """
    owner, count = request[SAMPLE_OBJECT], request[SAMPLE_COUNT]
    shift = np.int32(request[SHIFT_X]), np.int32(request[SHIFT_Y])
    faces = listed[request[FIRST_SAMPLE] : request[FIRST_SAMPLE] + count]
    geometry, textures = alpha_tests.geometry, alpha_tests.textures
    ints, doubles, floats, alphas, weights, uv_rows = memory[:6]
    patches = gather_patches(
        faces, geometry.faces, geometry.xy, geometry.codes, geometry.w, ints, doubles
    )
    find_weights(weights, count, patches, shift, ints, doubles, geometry)
    for n in range(count):
        alphas[n] = alpha_tests.materials[owner, ALPHA]
    if alpha_tests.vertex_colors.shape[0] > 0:
        multiply_vertex_alphas(
            alphas, patches, round_up_to_vectors(count), weights, ints, floats,
            alpha_tests.vertex_colors,
        )  # fmt: skip
    if alpha_tests.face_colors.shape[0] > 0:
        for n in range(count):
            alphas[n] *= alpha_tests.face_colors[np.int64(faces[n]), ALPHA]
    if textures.table.shape[0] == 0 or textures.table[owner, BASE_COLOR, FIRST_LEVEL] < 0:
        return
    interpolate_uv(
        uv_rows, round_up_to_vectors(count), patches, weights, owner, ints, doubles, floats,
        geometry, textures,
    )  # fmt: skip
    look_up_textures(uv_rows, memory[6:], count, BASE_COLOR, textures)
    row = textures.table[owner, BASE_COLOR]
    if row[ALPHA_USE] == MASK and row[FILTER] == TRILINEAR:
        cutoff = alpha_tests.cutoffs[owner] / alpha_tests.materials[owner, ALPHA]
        apply_hashed_alpha(count, cutoff, textures, owner, BASE_COLOR, uv_rows, memory[6:])
    for n in range(count):
        alphas[n] *= memory[8][TEXTURE_RED + ALPHA, n]


@helper
def is_discarded(face, column, row, query):
    """Return whether a face fails the alpha test at a pixel's centre; False for untested faces."""
    if query.cutoffs.shape[0] == 0:
        return False
    owner = find_last_at_most(query.face_starts, face)
    cutoff, request = query.cutoffs[owner], query.request
    if not cutoff > np.float32(0.0):
        return False
    request[FIRST_SAMPLE], request[SAMPLE_COUNT], request[SAMPLE_OBJECT] = 0, 1, owner
    request[SHIFT_X], request[SHIFT_Y] = 0, 0
    query.faces[0] = face
    query.pixels[rows.COLUMN, 0], query.pixels[rows.ROW, 0] = column, row
    call_bound(query.call)
    return not query.alphas[0] >= cutoff


@helper
def queue_neighbours(scratch, depths, empty, i, j, last, indices, stored, queued):
    """
    Queue the samples of a vector that pass the depth test, and clear them.

    Takes row and column in the tile, and the triangle's last column. Returns the queue's length.
    """
    any_nearer = np.int32(0)
    for k in range(LANES):
        column = np.uintp(j + k)
        any_nearer |= np.int32(scratch[i, column] > depths[i, column])
    if any_nearer != 0:
        for k in range(LANES):
            column, slot = np.uintp(j + k), np.uintp(queued)
            # Branchless: the next sample overwrites a hidden one.
            indices[slot] = np.int32((np.int64(i) << COLUMN_BITS) | (j + k))
            stored[slot] = scratch[i, column]
            queued += np.int64((scratch[i, column] > depths[i, column]) & (j + k <= last))
    for k in range(LANES):
        scratch[i, np.uintp(j + k)] = empty
    return queued


@helper
def queue_nearer(n, queued, batch, left, top, depths, scratch, empty, lists):
    """Queue the samples of a triangle that pass the depth test; return the queue's length."""
    indices, faces, queued_depths = lists
    start = queued
    first = max(np.int64(batch[LEFT, n]) - left, np.int64(0))
    last = np.int64(batch[RIGHT, n]) - left
    for row in range(np.int64(batch[TOP, n]) - top, np.int64(batch[BOTTOM, n]) - top + 1):
        for column in range(first, last + 1, LANES):
            queued = queue_neighbours(
                scratch, depths, empty, np.uintp(row), column, last, indices, queued_depths, queued
            )
    for k in range(start, queued, LANES):
        spread(faces, np.uintp(k), batch[FACE, n])
    return queued


@disjoint_helper
def locate_samples(xs, ys, indices, left, top):
    """Write the pixels of samples, given their indices in a tile and the tile's first pixel."""
    for n in range(xs.shape[0]):
        xs[n] = np.int32((indices[n] & ((1 << COLUMN_BITS) - 1)) + left)
        ys[n] = np.int32((indices[n] >> COLUMN_BITS) + top)


@disjoint_helper
def write_passed(depths, numbers, width, indices, stored, faces, alphas, cutoff):
    """Write samples that pass the alpha test to a tile, flat, where they are nearer."""
    # The last sample of a tile is padding, never read.
    spare = np.uintp(depths.shape[0] - 1)
    for n in range(indices.shape[0]):
        row, column = indices[n] >> COLUMN_BITS, indices[n] & ((1 << COLUMN_BITS) - 1)
        sample = np.uintp(row * width + column)
        is_seen = (alphas[n] >= cutoff) & (stored[n] > depths[sample])
        sample = sample if is_seen else spare
        depths[sample] = stored[n]
        numbers[sample] = faces[n]


@helper
def flush_queue(queued, request, tile, lists, query):
    """Run the alpha test on queued samples; write those that pass to the frame's tile if nearer."""
    indices, faces, queued_depths = lists
    owner, alpha_request = request[LAST_OWNER], query.request
    alpha_request[SAMPLE_OBJECT], alpha_request[SHIFT_X] = owner, request[OFFSET_X]
    alpha_request[SHIFT_Y] = request[OFFSET_Y]
    for first in range(0, queued, MAX_BATCH_SAMPLES):
        stop = min(first + MAX_BATCH_SAMPLES, queued)
        count = stop - first
        locate_samples(
            part(query.pixels, rows.COLUMN, 0, count), part(query.pixels, rows.ROW, 0, count),
            indices[first:stop], request[LEFT_COLUMN], request[TOP_ROW],
        )  # fmt: skip
        alpha_request[FIRST_SAMPLE], alpha_request[SAMPLE_COUNT] = first, count
        call_bound(query.call)
        write_passed(
            flat(tile[0]), flat(tile[1]), tile[0].shape[1], indices[first:stop],
            queued_depths[first:stop], faces[first:stop], query.alphas[:count],
            query.cutoffs[owner],
        )  # fmt: skip


@kernel
def queue_triangle(
    request: int64[::1], tile: (stored[:, ::1], int32[:, ::1]), scratch: stored[:, ::1],
    empty: stored[::1], batch: int32[:, ::1], lists: (int32[::1], int32[::1], stored[::1]),
    query: AlphaQuery,
):  # fmt: skip
    """
    Move an alpha-tested triangle from its scratch tile to the queue, flushing it when full.

    Parameters
    ----------
    request : (8,) int64
        As ``AlphaQueue.request``.
    tile : (depth, face numbers)
        The frame's tile.
    scratch : (rows, columns), stored depth
        The scratch tile; cleared.
    empty : (1,), stored depth
        Depth of empty samples.
    batch : (rows, columns) int32
        The triangles of the batch, as ``triangle_batches`` sets them up.
    lists : (indices in the tile, face numbers, stored depths)
        The queue.
    query : AlphaQuery

    Returns
    -------
    int
        The queue's length: 0 if it was flushed, because it was full, the batch ended or the next
        triangle is of another object.
    """
    n, owner = np.uintp(request[TRIANGLE]), request[LAST_OWNER]
    queued = queue_nearer(
        n, request[QUEUED], batch, request[LEFT_COLUMN], request[TOP_ROW], tile[0], scratch,
        empty[0], lists,
    )  # fmt: skip
    if queued < FLUSH_SAMPLES and request[TRIANGLE] + 1 < request[BATCH_COUNT]:
        face, starts = np.int64(batch[FACE, n + np.uintp(1)]), query.face_starts
        if starts[owner] <= face < starts[owner + 1]:
            return queued
    flush_queue(queued, request, tile, lists, query)
    return np.int64(0)


@helper
def begin_batch(alpha_queue, count, origin, shift):
    """Store the size, the tile origin and the offset of a batch of triangles."""
    request = alpha_queue.request
    request[BATCH_COUNT], request[QUEUED] = count, 0
    request[LEFT_COLUMN], request[TOP_ROW] = origin
    request[OFFSET_X], request[OFFSET_Y] = shift


@helper
def find_owner(face, guess, alpha_queue):
    """Return the object that owns a face, and whether it is alpha-tested; tries a guess first."""
    owner = barycentric.find_object(np.int64(face), alpha_queue.face_starts, guess)
    return owner, alpha_queue.cutoffs[owner] > np.float32(0.0)


@helper
def queue_from_scratch(n, owner, alpha_queue):
    """Move triangle ``n`` of the batch from its scratch tile to the queue; see `queue_triangle`."""
    alpha_queue.request[TRIANGLE], alpha_queue.request[LAST_OWNER] = n, owner
    alpha_queue.request[QUEUED] = call_bound(alpha_queue.call)


def allocate_alpha_memory(capacity: int = MAX_BATCH_SAMPLES) -> tuple[Any, ...]:
    """Allocate a thread's memory for computing the alphas of up to ``capacity`` samples."""
    # Like `round_up_to_vectors`, which is compiled: calling it here would wait for Numba.
    capacity = -(-capacity // rows.MAX_VECTOR_SAMPLES) * rows.MAX_VECTOR_SAMPLES + LANES
    return (
        np.empty((rows.INT_ROWS, capacity), np.int32),
        np.empty((rows.VERTEX_ROWS, capacity), np.float64),
        np.empty((rows.VERTEX_ROWS, capacity), np.float32), np.empty(capacity, np.float32),
        np.empty((2, capacity), np.float64), np.empty((rows.UV_ROWS, capacity), np.float64),
        *texture_lookup.allocate_lookup_memory(capacity),
    )  # fmt: skip


class AlphaComputation:
    """
    A thread's state for computing alphas.

    Keep it alive while its query is in use: machine code holds addresses of its memory.

    Parameters
    ----------
    alpha_tests : AlphaTests or None
        None: no object is alpha-tested.
    listed : int
        The most samples in a list.
    together : int
        The most samples whose alphas are computed together.
    """

    def __init__(self, alpha_tests: AlphaTests | None, listed: int = 1, together: int = 1) -> None:
        if alpha_tests is None:
            self.query = NO_QUERY
            return
        faces, request = np.empty(listed, np.int32), np.zeros(5, np.int64)
        memory = allocate_alpha_memory(together)
        self._bound = Bound(find_alphas, request, faces, memory, alpha_tests)
        self.query = AlphaQuery(
            alpha_tests.face_starts, alpha_tests.cutoffs, request, faces, memory[0], memory[3],
            self._bound.words,
        )  # fmt: skip


NO_QUERY = AlphaQuery(
    np.empty(0, np.int64), np.empty(0, np.float32), np.empty(0, np.int64), np.empty(0, np.int32),
    np.empty((0, 0), np.int32), np.empty(0, np.float32), np.empty(0, np.int64),
)  # fmt: skip
"""The query of a scene without alpha test."""


class TileAlphaTest:
    """
    A thread's state for alpha-testing a tile.

    Keep it alive while its record is in use: machine code holds addresses of its memory.

    Parameters
    ----------
    alpha_tests : AlphaTests or None
        None: no object is alpha-tested.
    tile : (depth, face numbers)
        The tile that the thread draws into.
    empty : (1,)
        The stored depth of empty samples.
    batch : (rows, columns) int32
        The batch in which triangles are set up.
    """

    def __init__(
        self, alpha_tests: AlphaTests | None, tile: tuple[Any, Any], empty: Any, batch: Any
    ):
        if alpha_tests is None:
            self.alpha_queue = make_empty_queue(empty.dtype)
            return
        # All samples of one triangle may be queued beyond the flush size.
        capacity = FLUSH_SAMPLES + TILE_SIZE * TILE_SIZE + LANES
        self._test = AlphaComputation(alpha_tests, capacity, MAX_BATCH_SAMPLES)
        query, request = self._test.query, np.zeros(8, np.int64)
        scratch = np.full(tile[0].shape, empty[0]), np.empty(tile[0].shape, np.int32)
        lists = np.empty(capacity, np.int32), query.faces, np.empty(capacity, empty.dtype)
        self._bound = Bound(queue_triangle, request, tile, scratch[0], empty, batch, lists, query)
        self.alpha_queue = AlphaQueue(
            alpha_tests.face_starts, alpha_tests.cutoffs, *scratch, request, self._bound.words
        )


@functools.cache
def make_empty_queue(depth_type: np.dtype[Any]) -> AlphaQueue:
    """Make the `AlphaQueue` of a scene without alpha test, for depths of a type."""
    return AlphaQueue(
        NO_QUERY.face_starts, NO_QUERY.cutoffs, np.empty((0, 0), depth_type),
        np.empty((0, 0), np.int32), NO_QUERY.request, NO_QUERY.call,
    )  # fmt: skip
