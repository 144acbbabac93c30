"""Gather the covered samples of a band of rows into blocks: the first stage of shading."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.setup import find_last_at_most
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.intrinsics import LANES, find_range_end, part
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int32, int64, uint32

MIN_SPAN_SAMPLES = 16
"""
Least length of a span (a run of one face): as many face numbers as a 512-bit register holds.

After shorter runs a span may begin at multiples of this only.
"""


@helper
def round_up_to_vectors(count):
    """Return a count rounded up to whole vectors."""
    return (np.int64(count) + (rows.MAX_VECTOR_SAMPLES - 1)) & -rows.MAX_VECTOR_SAMPLES


@disjoint_helper
def fill_row(row, value):
    """Write one number to all samples of a row."""
    for n in range(row.shape[0]):
        row[n] = value


@helper
def four_parts(rows, first, start, stop):
    """Return a part of each of four rows that follow each other."""
    return (
        part(rows, first, start, stop), part(rows, first + 1, start, stop),
        part(rows, first + 2, start, stop), part(rows, first + 3, start, stop),
    )  # fmt: skip


@helper
def get_patch_vertices(ints, r):
    """Return the vertex numbers of a patch's face."""
    return np.uintp(ints[rows.A, r]), np.uintp(ints[rows.B, r]), np.uintp(ints[rows.C, r])


@helper
def get_patch_samples(ints, r):
    """Return a patch's first sample, and one past its last."""
    return np.uintp(ints[rows.FIRST_SAMPLE, r]), np.uintp(ints[rows.FIRST_SAMPLE, r + np.uintp(1)])


@helper
def get_pixel(n, segment, ints):
    """Return the column and the row of a sample."""
    if segment[rows.KIND] == rows.SPAN:
        column = np.int64(segment[rows.SPAN_COLUMN]) + np.int64(n) - np.int64(segment[rows.START])
        return column, np.int64(segment[rows.SPAN_ROW])
    return np.int64(ints[rows.COLUMN, n]), np.int64(ints[rows.ROW, n])


@helper
def find_run_end(faces, column):
    """Return the first column to the right that shows another face than ``column`` does."""
    face = faces[np.uintp(column)]
    return find_range_end(faces, column, face, np.int32(face + 1))


@helper
def find_mixed_end(faces, column, first, end):
    """Return where a mixed segment of faces first..end - 1 ends, or where a span begins."""
    stop = find_range_end(faces, column, np.int32(first), np.int32(end))
    for start in range(
        (column | (MIN_SPAN_SAMPLES - 1)) + 1, stop - MIN_SPAN_SAMPLES + 1, MIN_SPAN_SAMPLES
    ):
        # One comparison usually rules a span out.
        is_same = faces[np.uintp(start)] == faces[np.uintp(start + MIN_SPAN_SAMPLES - 1)]
        if is_same and find_run_end(faces, start) >= start + MIN_SPAN_SAMPLES:
            return start
    return stop


@helper
def list_patches(faces, n, r, ints):
    """List patches of neighbouring samples from sample ``n`` on; return the next patch's number."""
    previous = np.int32(-1)
    for i in range(np.uintp(faces.shape[0])):
        # Branchless: the next sample overwrites one that starts no patch.
        face = faces[i]
        ints[rows.FIRST_SAMPLE, r], ints[rows.FACE, r] = n + i, face
        r += np.uintp((face != previous) | (i % np.uintp(LANES) == np.uintp(0)))
        previous = face
    return r


@disjoint_helper
def write_pixels(pixel_columns, pixel_rows, column, row):
    """Write the pixels of neighbouring samples, given the first."""
    for n in range(pixel_columns.shape[0]):
        pixel_columns[n], pixel_rows[n] = column + n, row


@helper
def gather_vertex_numbers(patch_count, faces, ints):
    """Gather the vertex numbers of each patch's face."""
    for r in range(np.uintp(patch_count)):
        face = np.uintp(ints[rows.FACE, r])
        for k in range(3):
            ints[rows.A + k, r] = faces[face, k]


@helper
def paint_background(background, code, linear, color):
    """Write the background to a part of a row."""
    for i in range(color.shape[0]):
        color[i] = code
    for i in range(linear.shape[0]):
        for k in range(4):
            linear[i, k] = background[k]


@stage
def list_samples(
    block: Block, count, face_id: int32[:, ::1], first_row: int64, height: int64,
    faces: int32[:, ::1], face_starts: int64[::1], background: float32[::1], code: int64,
    linear: float32[:, :, ::1], color: uint32[:, ::1],
):  # fmt: skip
    """
    Gather the next samples of a band of rows, and write the background between them.

    Parameters
    ----------
    block : Block
        ``counts`` is 0 where a band begins, and after its end. Writes segments, patches and
        intervals.
    face_id : (R, W) int32
        The visible faces of the band, -1 where nothing is; or several images of the band, one below
        the other.
    first_row : int
        The frame's row where the band begins.
    height : int
        Rows of the band.
    faces : (F, 3) int32, vertex numbers
    face_starts : (O+1,) int64
        Object ``o`` owns faces ``face_starts[o]:face_starts[o+1]``.
    background : (4,) float32, linear
    code : int
        The background in sRGB codes: RGBA bytes from the lowest up.
    linear : (R, W, 4) float32, or (R, 0, 4)
    color : (R, W) uint32, or (R, 0)
        May share memory with ``face_id``: no face is read after its pixel was written.

    Returns
    -------
    int
        Number of samples; -1 after the last one.
    """
    counts, segments, intervals, ints = block.counts, block.segments, block.intervals, block.ints
    row, column, owner = counts[rows.NEXT_ROW], counts[rows.NEXT_COLUMN], counts[rows.LAST_OWNER]
    first_face, end_face = face_starts[owner], face_starts[owner + 1]
    row_count, width = face_id.shape
    n, r, k, last_interval = np.int64(0), np.uintp(0), np.int64(0), np.int64(-1)
    is_mixed_open, interval_end = False, np.int64(-1)
    while row < row_count and n < rows.MAX_SAMPLES:
        row_faces, frame_row = face_id[row], first_row + row % height
        while column < width and n < rows.MAX_SAMPLES:
            face = np.int64(row_faces[np.uintp(column)])
            if face < 0:
                end = find_run_end(row_faces, column)
                paint_background(
                    background, np.uint32(code), linear[row, column:end], color[row, column:end]
                )
                column = end
                continue
            if not first_face <= face < end_face:
                owner = find_last_at_most(face_starts, face)
                first_face, end_face = face_starts[owner], face_starts[owner + 1]
                is_mixed_open = False
            # A block may be full before the row ends.
            unlisted_faces = row_faces[: min(width, column + rows.MAX_SAMPLES - n)]
            end = find_run_end(unlisted_faces, column)
            if end >= column + MIN_SPAN_SAMPLES:
                ints[rows.FIRST_SAMPLE, r], ints[rows.FACE, r] = n, face
                segments[k, rows.KIND], segments[k, rows.OWNER] = rows.SPAN, owner
                segments[k, rows.START], segments[k, rows.FIRST_PATCH] = n, r
                segments[k, rows.SPAN_COLUMN], segments[k, rows.SPAN_ROW] = column, frame_row
                r += np.uintp(1)
                k += 1
                is_mixed_open = False
            else:
                end = find_mixed_end(unlisted_faces, column, first_face, end_face)
                if not is_mixed_open:
                    segments[k, rows.KIND], segments[k, rows.OWNER] = rows.MIXED, owner
                    segments[k, rows.START], segments[k, rows.FIRST_PATCH] = n, r
                    k += 1
                    is_mixed_open = True
                stop = n + round_up_to_vectors(end - column)
                write_pixels(
                    part(ints, rows.COLUMN, n, stop), part(ints, rows.ROW, n, stop),
                    np.int32(column), np.int32(frame_row),
                )  # fmt: skip
                r = list_patches(unlisted_faces[column:end], n, r, ints)
            if interval_end != column:
                last_interval += 1
                interval = intervals[last_interval]
                interval[rows.INTERVAL_ROW], interval[rows.INTERVAL_COLUMN] = row, column
                interval[rows.INTERVAL_START], interval[rows.INTERVAL_FRAME_ROW] = n, frame_row
            n += end - column
            segments[k - 1, rows.STOP], segments[k - 1, rows.END_PATCH] = n, r
            intervals[last_interval, rows.INTERVAL_STOP] = n
            column = interval_end = end
        if column >= width:
            row, column, interval_end = row + 1, np.int64(0), np.int64(-1)
    counts[rows.NEXT_ROW], counts[rows.NEXT_COLUMN], counts[rows.LAST_OWNER] = row, column, owner
    counts[rows.SEGMENT_COUNT], counts[rows.PATCH_COUNT] = k, r
    counts[rows.INTERVAL_COUNT] = last_interval + 1
    if n == 0:
        for number in range(rows.COUNT_ELEMENTS):
            counts[number] = 0
        return np.int64(-1)
    ints[rows.FIRST_SAMPLE, r] = n
    gather_vertex_numbers(r, faces, ints)
    return n
