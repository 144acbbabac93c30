"""
Build the sorted layers of transparent fragments (an A-buffer [1]_) in front of the opaque surface.

Triangles are rasterized as by ``tile_rasterizer``, with the same coverage and bits of depth, so
transparent and opaque surfaces tie as opaque ones do: the lower face is nearer. Each transparent
triangle is rasterized into a scratch tile; its rows are then inserted into the layers: the first
holds the nearest surface of every sample, the next the second nearest, and so on. A row of samples
is compared with a layer at once, and farther fragments go on to the next layer: an insertion sort
without branches, per sample, so intersecting triangles are right.

A tile gets a layer once a sample needs it. Fragments beyond the last available layer are counted
and dropped; the caller sees the count and tries again with more.

`drop_discarded_in_place` removes fragments that fail the alpha test.

References
----------
.. [1] L. Carpenter, "The A-buffer, an Antialiased Hidden Surface Method", SIGGRAPH 1984.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.geometry.setup import TILE_BITS, TILE_SIZE
from rasterjit.pipeline.geometry.triangle_batches import (
    BOTTOM,
    FACE,
    LEFT,
    MAX_SMALL_PIXELS,
    RIGHT,
    TOP,
    TRIANGLES_PER_BATCH,
)
from rasterjit.pipeline.records import AlphaTests, Faces, Viewport
from rasterjit.pipeline.visibility import alpha_test, tile_rasterizer
from rasterjit.pipeline.visibility.alpha_test import AlphaComputation, AlphaQuery, AlphaQueue
from rasterjit.pipeline.visibility.point_rasterizer import depth_test
from rasterjit.pipeline.visibility.tile_rasterizer import TileDrawer, TileDrawing
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import int32, int64, stored, uint8


@kernel
def split_lists(
    starts: int64[::1], binned: int32[::1], faces: Faces, face_starts: int64[::1],
    is_blended: uint8[::1], partitioned: int32[::1], middles: int64[::1],
):  # fmt: skip
    """
    Partition each tile's list: opaque triangles first, then transparent ones.

    Parameters
    ----------
    starts : (tiles + 1,) int64
    binned : (M,) int32
        As in ``visibility_pass.TileLists``.
    faces : Faces
    face_starts : (O+1,) int64
    is_blended : (O,) uint8
        1 for each object that is transparent.
    partitioned : (M,) int32
        Written: the lists, each in the same order within its two parts.
    middles : (tiles,) int64
        Written: where the transparent triangles of each tile begin.
    """
    face_count = np.int64(faces.faces.shape[0])
    for tile in range(middles.shape[0]):
        end, middle = starts[tile], starts[tile]
        for is_second in range(2):
            owner = np.int64(0)
            for n in range(starts[tile], starts[tile + 1]):
                triangle = np.int64(binned[n])
                face = triangle
                if triangle >= face_count:
                    face = np.int64(faces.piece_faces[triangle - face_count])
                while face >= face_starts[owner + 1]:
                    owner += 1
                if np.int64(is_blended[owner]) == is_second:
                    partitioned[end] = binned[n]
                    end += 1
            if is_second == 0:
                middle = end
        middles[tile] = middle


@disjoint_helper
def extract_row(drawn, empty_depth, face, opaque_depth, opaque_face, counts, depths, faces):
    """
    Move a triangle's visible samples out of a row of the scratch tile; clear the row.

    Returns whether any sample is in front of the opaque surface; counts these samples.
    """
    any_left = np.int32(0)
    for i in range(drawn.shape[0]):
        depth = drawn[i]
        is_seen = (depth > opaque_depth[i]) | ((depth == opaque_depth[i]) & (face < opaque_face[i]))
        drawn[i] = empty_depth
        depths[i] = depth if is_seen else empty_depth
        faces[i] = face
        counts[i] += np.int32(is_seen)
        # Not ``|=``: that would be 64 bits wide, and halve the vectors.
        any_left = np.int32(any_left | np.int32(is_seen))
    return any_left


@helper
def clear_beside(drawn, empty_depth, row, first):
    """Clear the columns right of a box that drawing in groups of columns also wrote."""
    for k in range(MAX_SMALL_PIXELS):
        drawn[row, np.uintp(first + k)] = empty_depth


@disjoint_helper
def insert_row(layer_depths, layer_faces, depths, empty_depth, faces):
    """Keep the nearer fragments in the layer, and the others in the row; return if any is left."""
    any_left = np.int32(0)
    for i in range(depths.shape[0]):
        layer_depth, depth = layer_depths[i], depths[i]
        layer_face, face = layer_faces[i], faces[i]
        # Empty samples are deepest and are never exchanged: in a layer their face is -1.
        is_nearer = (depth > layer_depth) | ((depth == layer_depth) & (face < layer_face))
        layer_depths[i] = depth if is_nearer else layer_depth
        layer_faces[i] = face if is_nearer else layer_face
        left = layer_depth if is_nearer else depth
        depths[i] = left
        faces[i] = layer_face if is_nearer else face
        any_left = np.int32(any_left | np.int32(left > empty_depth))
    return any_left


@helper
def clear_layer(layers, empty_depth, sample, level, left, right):
    """Empty some columns of a layer."""
    depths, faces = layers
    for row in range(depths.shape[2]):
        # Slice rows from the whole array: from a view, Numba forgets that they are contiguous.
        depth_row = depths[sample, level, row, left:right]
        face_row = faces[sample, level, row, left:right]
        for i in range(depth_row.shape[0]):
            depth_row[i] = empty_depth
        for i in range(face_row.shape[0]):
            face_row[i] = tile_rasterizer.NOTHING


@helper
def insert_triangle(
    n, ints, window, drawn, empty_depth, opaque, counts, layers, sample, used, row_memory
):  # fmt: skip
    """Insert the fragments of one triangle into a tile's layers; return the number in use."""
    # A wide triangle's box begins where its block of columns does, which may be left of the tile.
    left = max(np.int64(ints[LEFT, n]) - window[0], np.int64(0))
    right = np.int64(ints[RIGHT, n]) - window[0]
    top, bottom = np.int64(ints[TOP, n]) - window[1], np.int64(ints[BOTTOM, n]) - window[1]
    face, count = np.int32(ints[FACE, n]), right + 1 - left
    layer_depths, layer_faces = layers
    if count <= 0:
        return used
    depths, faces = row_memory[0][:count], row_memory[1][:count]
    first_column, end_column = window[0] + left, window[0] + right + 1
    for row in range(top, bottom + 1):
        any_left = extract_row(
            drawn[row, left : right + 1], empty_depth, face, opaque[0][row, left : right + 1],
            opaque[1][row, left : right + 1], counts[row, left : right + 1], depths, faces,
        )  # fmt: skip
        clear_beside(drawn, empty_depth, row, right + 1)
        level = np.int64(0)
        while any_left != 0 and level < layer_depths.shape[1]:
            if level == used:
                clear_layer(layers, empty_depth, sample, level, window[0], window[2] + 1)
                used += 1
            any_left = insert_row(
                layer_depths[sample, level, row, first_column:end_column],
                layer_faces[sample, level, row, first_column:end_column], depths, empty_depth,
                faces,
            )  # fmt: skip
            level += 1
    return used


@helper
def insert_listed(first, end, window, layers, sample, scratch, layer_scratch, drawing):
    """
    Insert transparent triangles ``first`` to ``end`` of the lists into the layers of one tile.

    Returns the number of layers in use.
    """
    opaque, ints, used = scratch[:2], scratch[2], np.int64(0)
    empty_depth = scratch[tile_rasterizer.EMPTY_DEPTH_INDEX][0]
    for begin in range(first, end, TRIANGLES_PER_BATCH):
        count = min(TRIANGLES_PER_BATCH, end - begin)
        tile_rasterizer.set_up_listed(drawing, begin, count)
        for n in range(np.uintp(count)):
            tile_rasterizer.draw_range(drawing, layer_scratch.draw_words, n, n + np.uintp(1))
            used = insert_triangle(
                n, ints, window, layer_scratch.depths, empty_depth, opaque, layer_scratch.counts,
                layers, sample, used, (layer_scratch.row_depths, layer_scratch.row_faces),
            )  # fmt: skip
    return used


@helper
def find_deepest(counts, window, deepest):
    """Return ``deepest`` (count, column, row), or a tile's, if its count is larger."""
    for row in range(window[3] + 1 - window[1]):
        for column in range(window[2] + 1 - window[0]):
            if counts[row, column] > deepest[0]:
                deepest = np.int64(counts[row, column]), window[0] + column, window[1] + row
    return deepest


@disjoint_helper
def copy_row(source, target):
    """Copy a row."""
    for i in range(target.shape[0]):
        target[i] = source[i]


class LayerScratch(NamedTuple):
    """Memory to rasterize a triangle into a scratch tile, and to insert it into layers."""

    depths: stored[:, ::1]
    """The scratch tile, cleared."""
    face_numbers: int32[:, ::1]
    counts: int32[:, ::1]
    """(64, 64): the transparent surfaces of each sample."""
    row_depths: stored[::1]
    """(64,): the row that is inserted into the layers."""
    row_faces: int32[::1]
    draw_words: int64[::1]
    """How to call ``tile_rasterizer.draw_batch`` for that tile."""


def make_layer_drawer(drawer: TileDrawer) -> tuple[TileDrawer, LayerScratch]:
    """
    Make a thread's state for building layers, given its `TileDrawer`.

    Keep both results alive while in use: machine code holds addresses of their memory.
    """
    depth_type = drawer.scratch[0].dtype
    tile = (
        np.full(tile_rasterizer.SCRATCH_SHAPE, tile_rasterizer.get_empty_depth(depth_type)),
        np.empty(tile_rasterizer.SCRATCH_SHAPE, np.int32),
    )
    request, cell_depths = drawer.drawing.request, drawer.drawing.cell_depths
    bound = tile_rasterizer.bind_drawing(tile, request, cell_depths, drawer.scratch)
    layer_scratch = LayerScratch(
        *tile, np.empty((TILE_SIZE, TILE_SIZE), np.int32), np.empty(TILE_SIZE, depth_type),
        np.empty(TILE_SIZE, np.int32), bound.words,
    )  # fmt: skip
    return drawer._replace(keep_alive=(*drawer.keep_alive, bound)), layer_scratch


@helper
def draw_points(points, window, scratch):
    """Depth-test discs and spheres into a tile."""
    depth, face_id = points
    left, top, right, bottom = window
    if depth.shape[0] == 0:
        return
    for row in range(top, bottom + 1):
        depths, faces = scratch[0][row - top], scratch[1][row - top]
        for column in range(left, right + 1):
            face = face_id[row, column]
            if face >= 0:
                depth_test(np.uintp(column - left), depth[row, column], face, depths, faces)


@helper
def write_first_depth(depths, layers, levels, window, first_depth):
    """Write the depth of the nearest surface of a tile, opaque or transparent, at one sample."""
    left, top, right, bottom = window
    for row in range(bottom + 1 - top):
        copy_row(depths[row, : right + 1 - left], first_depth[row, left : right + 1])
        if levels == 0 or layers[1].shape[1] == 0:
            continue
        for column in range(left, right + 1):
            if layers[1][0, 0, row, column] >= 0:
                first_depth[row, column] = layers[0][0, 0, row, column]


@kernel
def find_layers(
    row_range: (int64, int64), starts: int64[::1], middles: int64[::1],
    points: (stored[:, ::1], int32[:, ::1]), viewport: Viewport, shifts: int32[:, ::1],
    opaque: int32[:, :, ::1], first_depth: stored[:, ::1],
    layers: (stored[:, :, :, ::1], int32[:, :, :, ::1]), layers_per_tile: int64[:, ::1],
    deepest_pixel: int64[::1], scratch: tile_rasterizer.SCRATCH, drawing: TileDrawing,
    alpha_queue: AlphaQueue, layer_scratch: LayerScratch,
):  # fmt: skip
    """
    Find the opaque surface and the transparent ones in front of it, for some rows of the frame.

    Parameters
    ----------
    row_range : (int, int)
        The first, and one past the last, of one row of tiles.
    starts, middles : arrays
        The tiles' lists, as in `split_lists`.
    points : (depth (H, W), face_id (H, W) int32)
        Opaque discs and spheres, which have one sample a pixel; (0, 0) without any.
    viewport : Viewport
    shifts : (N, 2) int32
        The offset from each sample to the pixel's centre, added to vertices, sub-pixel units.
    opaque : (N, R, W) int32
        Written: the nearest opaque face at each sample, -1 where there is none.
    first_depth : (R, W)
        Written: the stored depth of the nearest surface at the first sample; (0, 0) without.
    layers : (depths (N, K, R, W), faces (N, K, R, W) int32)
        Written: stored depth and face number of the transparent surfaces in front of it, nearest
        first, in as many layers as any sample has; -1 where a sample has fewer.
    layers_per_tile : (N, tiles in a row) int64
        Scratch memory.
    deepest_pixel : (3,) int64
        Written: the most transparent surfaces of a sample, and its pixel's column and row. Beyond
        K, some are missing.
    scratch, drawing, alpha_queue, layer_scratch
        From this thread's `make_layer_drawer`.
    """
    columns = layers_per_tile.shape[1]
    deepest = np.int64(0), np.int64(0), np.int64(0)
    counts, empty_depth = layer_scratch.counts, scratch[tile_rasterizer.EMPTY_DEPTH_INDEX][0]
    for sample in range(shifts.shape[0]):
        shift = shifts[sample, 0], shifts[sample, 1]
        for column in range(columns):
            tile = (row_range[0] >> TILE_BITS) * columns + column
            left, _, right, _ = tile_rasterizer.get_tile_window(tile, columns, viewport)
            window = left, np.int64(row_range[0]), right, np.int64(row_range[1]) - 1
            tile_rasterizer.clear_tile(scratch[0], scratch[1], empty_depth)
            tile_rasterizer.begin_tile(drawing, window, viewport.grid_bits, shift, empty_depth)
            start, middle, stop = starts[tile], middles[tile], starts[tile + 1]
            tile_rasterizer.draw_list(start, middle, scratch, drawing, alpha_queue)
            draw_points(points, window, scratch)
            layers_per_tile[sample, column] = 0
            if middle < stop:
                for row in range(TILE_SIZE):
                    for i in range(TILE_SIZE):
                        counts[row, i] = 0
                layers_per_tile[sample, column] = insert_listed(
                    middle, stop, window, layers, sample, scratch, layer_scratch, drawing
                )
                deepest = find_deepest(counts, window, deepest)
            for row in range(row_range[1] - row_range[0]):
                copy_row(scratch[1][row, : right + 1 - left], opaque[sample, row, left : right + 1])
            if sample == 0 and first_depth.shape[0] != 0:
                levels = layers_per_tile[sample, column]
                write_first_depth(scratch[0], layers, levels, window, first_depth)
    # Empty the layers that only other tiles use.
    needed = min(deepest[0], np.int64(layers[1].shape[1]))
    for sample in range(shifts.shape[0]):
        for column in range(columns):
            left, right = column << TILE_BITS, min((column + 1) << TILE_BITS, layers[1].shape[3])
            for level in range(layers_per_tile[sample, column], needed):
                clear_layer(layers, empty_depth, sample, level, left, right)
    deepest_pixel[0], deepest_pixel[1], deepest_pixel[2] = deepest


@kernel
def drop_discarded_in_place(
    first_row: int64, faces: int32[:, :, ::1], layer_indices: int64[:, :, ::1], query: AlphaQuery,
):  # fmt: skip
    """
    Remove in place from each pixel the layers that fail the alpha test, keeping their order.

    Parameters
    ----------
    first_row : int
        The frame's row of row 0 of the arrays.
    faces : (K, R, W) int32
        The faces of each pixel, nearest first; -1 behind the last. Changed.
    layer_indices : (K, R, W) int64
        Written: the former index of each remaining layer; valid for these.
    query : AlphaQuery
        From an ``alpha_test.AlphaComputation``.
    """
    levels, rows, columns = faces.shape
    for row in range(rows):
        for column in range(columns):
            count = np.int64(0)
            for level in range(levels):
                face = np.int64(faces[level, row, column])
                layer_indices[level, row, column] = level
                if face < 0 or alpha_test.is_discarded(face, column, first_row + row, query):
                    continue
                faces[count, row, column] = face
                layer_indices[count, row, column] = level
                count += 1
            for level in range(count, levels):
                faces[level, row, column] = -1


def remove_discarded(
    first_row: int, faces: NDArray[np.int32], depths: NDArray[Any], alpha_tests: AlphaTests
) -> tuple[NDArray[np.int32], NDArray[Any]]:
    """Return the layers of some rows, (K, R, W), that pass the alpha test; ``faces`` changes."""
    layer_indices = np.empty(faces.shape, np.int64)
    test = AlphaComputation(alpha_tests)
    drop_discarded_in_place(first_row, faces, layer_indices, test.query)
    return faces, np.take_along_axis(depths, layer_indices, axis=0)
