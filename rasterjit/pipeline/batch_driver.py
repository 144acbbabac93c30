"""
Draw a batch of views in machine code, without returning to Python between them.

All views of a thread use the same memory, so that argument blocks of kernels and stages are packed
once. For each view a few arrays are copied into that memory (`LOAD_FROM` ...: matrices, lights),
then the kernels are called by address. A view that exceeds the capacity for clipped faces or tile
lists is skipped and reported: the caller draws it as a single frame.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.setup import CLIPPED
from rasterjit.pipeline.surface.sample_block import COUNT_ELEMENTS
from rasterjit.runtime.intrinsics import call_at, call_bound, load_int64, store_int64
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import WORD, float32, float64, int32, int64, uint8, uint32

LOAD_FROM, LOAD_STEP, LOAD_TO, LOAD_WORDS = range(4)
"""Columns of a copy: address of the first view's words, stride between views in bytes, target
address, number of words."""

(
    TRANSFORM, FIND_CLIPPED, TRANSFORM_POSITIONS, COUNT_VERTICES, CLIP, PROJECT_CLIPPED, SET_UP,
    START_LISTS, BIN, FIND_TILE_DEPTHS, DRAW_TILES, SET_UP_SAMPLES, START_SAMPLES, BIN_SAMPLES,
    END_OF_SAMPLES,
) = range(15)  # fmt: skip
"""Rows of the visibility kernels, as words of ``jit.Bound``. The last three build the lists for
several samples a pixel, and exist only then. Then the number of rows."""

CALL_ADDRESS, CALL_STATE, CALL_BLOCK, CALL_NUMBER, CALL_WHEN, CALL_MIN, CALL_MAX = range(7)
"""Columns of a call after visibility: machine code, its state; the address of a block of samples to
clear first, or 0; the address of a word to which the view's number is written, or 0; the address of
a word that must lie between the next two for the call to happen, or 0."""

LIMIT_OF, LIMIT = range(2)
"""Columns of a check after all calls: the address of a word, and its largest value; above it, some
capacity was exceeded."""

OUTSIDE, DEGENERATE, CULLED, UNSAMPLED, INVALID, COVERED, CUT, LIT, LIT_WHITE, TOTALS = range(10)
"""Columns of the totals: faces, as ``setup`` counts them; pixels that show a face; faces that were
cut; what `count_white` counts. The last is how many columns there are."""

MIN_WHITE = 254
"""Least code of red, green and blue that counts as white (overexposed)."""

RATIO, BETWEEN, SCALED = range(3)
"""Ways from stored to metric depth, see `measure_depths`."""


@helper
def load_view(number, loads):
    """Copy a view's arrays to the memory that kernels read."""
    for k in range(loads.shape[0]):
        source = loads[k, LOAD_FROM] + number * loads[k, LOAD_STEP]
        for n in range(loads[k, LOAD_WORDS]):
            store_int64(loads[k, LOAD_TO] + n * WORD, load_int64(source + n * WORD))


@helper
def clip_faces(visibility, clipping):
    """Clip faces to the near and far plane and the guard band; return how many, -1: no room."""
    counts, vertex_starts, piece_starts, lengths, capacity = clipping
    count = call_bound(visibility[FIND_CLIPPED])
    if count == 0:
        return count
    if count > counts.shape[0]:
        return np.int64(-1)
    for n in range(lengths.shape[0]):
        store_int64(lengths[n], count)
    call_bound(visibility[TRANSFORM_POSITIONS])
    call_bound(visibility[COUNT_VERTICES])
    vertex_starts[0], piece_starts[0] = 0, 0
    for n in range(count):
        vertex_starts[n + 1] = vertex_starts[n] + counts[n]
        piece_starts[n + 1] = piece_starts[n] + max(counts[n] - 2, np.int64(0))
    if vertex_starts[count] > capacity:
        return np.int64(-1)
    call_bound(visibility[CLIP])
    call_bound(visibility[PROJECT_CLIPPED])
    return count


@helper
def list_triangles(binning, pieces, set_up, start, bin_all):
    """List the triangles of each tile; return how many there are, or -1 where room was missing."""
    counts, sums, starts, capacity, piece_count, lengths = binning
    store_int64(piece_count, pieces)
    tiles = starts.shape[0] - 1
    for n in range(tiles + 1):
        counts[0, n] = 0
    for n in range(sums.shape[0]):
        sums[n] = 0
    end = call_bound(set_up)
    call_bound(start)
    if starts[tiles] > capacity:
        return np.int64(-1)
    for n in range(lengths.shape[0]):
        store_int64(lengths[n], end)
    call_bound(bin_all)
    return end


@helper
def find_faces(visibility, clipping, binning, tile_depths):
    """Find the face at every pixel; return how many were cut, or -1 where room was missing."""
    counts, tiles = binning[0], tile_depths.shape[0]
    seen = call_bound(visibility[TRANSFORM])
    cut = np.int64(0)
    if seen & CLIPPED:
        cut = clip_faces(visibility, clipping)
        if cut < 0:
            return cut
    pieces = clipping[2][cut] if cut > 0 else np.int64(0)
    listed = list_triangles(
        binning, pieces, visibility[SET_UP], visibility[START_LISTS], visibility[BIN]
    )  # fmt: skip
    if listed < 0:
        return listed
    for n in range(tiles):
        tile_depths[n] = -np.inf
    if counts[0, tiles] > 0:
        call_bound(visibility[FIND_TILE_DEPTHS])
    call_bound(visibility[DRAW_TILES])
    return cut


@helper
def list_for_samples(visibility, clipping, binning, cut):
    """List the triangles of each tile once more, if pixels have several samples; -1: no room."""
    if visibility.shape[0] == END_OF_SAMPLES:
        pieces = clipping[2][cut] if cut > 0 else np.int64(0)
        listed = list_triangles(
            binning, pieces, visibility[SET_UP_SAMPLES], visibility[START_SAMPLES],
            visibility[BIN_SAMPLES]
        )  # fmt: skip
        if listed < 0:
            return listed
    return cut


@helper
def is_called(call):
    """Tell whether a call happens in this view."""
    if call[CALL_WHEN] == 0:
        return True
    value = load_int64(call[CALL_WHEN])
    return call[CALL_MIN] <= value <= call[CALL_MAX]


@helper
def call_all(calls, limits, number):
    """Run the calls that follow visibility; return whether no capacity was exceeded."""
    for k in range(calls.shape[0]):
        if not is_called(calls[k]):
            continue
        block, number_address = calls[k, CALL_BLOCK], calls[k, CALL_NUMBER]
        if block != 0:
            for n in range(COUNT_ELEMENTS):
                store_int64(block + n * WORD, np.int64(0))
        if number_address != 0:
            store_int64(number_address, number)
        call_at(calls[k, CALL_ADDRESS], calls[k, CALL_STATE], block, np.int64(0))
    has_room = True
    for k in range(limits.shape[0]):
        has_room &= load_int64(limits[k, LIMIT_OF]) <= limits[k, LIMIT]
    return has_room


@helper
def count_covered(face_id):
    """Return the number of pixels covered by a face."""
    covered = np.int64(0)
    for row in range(face_id.shape[0]):
        in_row = np.int32(0)
        for column in range(face_id.shape[1]):
            in_row += np.int32(face_id[row, column] >= 0)
        covered += in_row
    return covered


@kernel
def draw_views(
    chosen: int64[:, ::1], loads: int64[:, ::1], visibility: int64[:, ::1],
    clipping: (int64[::1], int64[::1], int64[::1], int64[::1], int64),
    binning: (int32[:, ::1], int64[::1], int64[::1], int64, int64, int64[::1]),
    sample_binning: (int32[:, ::1], int64[::1], int64[::1], int64, int64, int64[::1]),
    tile_depths: float32[::1], face_id: int32[:, ::1], calls: int64[:, ::1], limits: int64[:, ::1],
    white: int64[::1], totals: int64[:, ::1], is_drawn: uint8[::1],
):  # fmt: skip
    """
    Draw some views, one after the other.

    Parameters
    ----------
    chosen : (n, 2) int64
        For each view, which of those at hand it is, and its number, as it is told.
    loads : (K, 4) int64
        What is copied before each, see ``LOAD_FROM``; the first at hand is number 0.
    visibility : (11, 2) or (14, 2) int64
        How to call the kernels that find the faces, see ``TRANSFORM``.
    clipping : (counts (C,), vertex_starts (C+1,), piece_starts (C+1,), addresses (n,), int)
        Of at most C faces that are cut: how many vertices each has then, and running sums of these
        and of its pieces; words that are told how many faces are cut; the room for new vertices.
    binning : (counts (1, tiles + 1), sums (5,), starts (tiles + 1,), int, int, lengths (n,))
        What those kernels count, the room for the lists of all tiles, the address of the word that
        tells how many pieces there are, and those of words that are told how many triangles were
        listed.
    listing_samples
        The same of those that list what reaches any sample.
    tile_depths : (tiles,) float32
        Scratch memory of theirs.
    face_id : (H, W) int32
        The faces that they find; colours may be written over them.
    calls : (C, 7) int64
        What is called then, see ``CALL_ADDRESS``.
    limits : (L, 2) int64
        What must hold after that, see ``LIMIT``; else the view is left out.
    white : (2,) int64
        What `count_white` counts, if it is called; else zeros.
    totals : (n, 9) int64
        Written for those drawn: see ``OUTSIDE``.
    is_drawn : (n,) uint8
        Written: 1 for those drawn, 0 for those left out.
    """
    for n in range(chosen.shape[0]):
        load_view(chosen[n, 0], loads)
        cut = find_faces(visibility, clipping, binning, tile_depths)
        # Later calls may overwrite the faces.
        covered = count_covered(face_id)
        if cut >= 0:
            cut = list_for_samples(visibility, clipping, sample_binning, cut)
        if cut < 0 or not call_all(calls, limits, chosen[n, 1]):
            is_drawn[n] = 0
            continue
        for k in range(COVERED):
            totals[n, k] = binning[1][k]
        totals[n, COVERED], totals[n, CUT] = covered, cut
        totals[n, LIT], totals[n, LIT_WHITE] = white[0], white[1]
        is_drawn[n] = 1


@kernel
def start_resolve(
    call: int64[::1], rows: int64, background: float32[:, :, ::1], sums: float32[:, :, ::1]
):
    """
    List the faces of some rows with several samples a pixel, and start sums with the background.

    Parameters
    ----------
    call : (2,) int64
        How to call ``coverage_resolve.list_coverage`` for these rows.
    rows : int
        Address of the word that is told how many rows all images of faces have together.
    background : (R, W, 4) float32, or (1, 1, 4) if all is alike
        What is behind all faces, linear.
    sums : (R, 4, W) float32
        Written.
    """
    layers = call_bound(call)
    store_int64(rows, layers * sums.shape[0])
    down, right = np.int64(background.shape[0] > 1), np.int64(background.shape[1] > 1)
    for row in range(sums.shape[0]):
        for k in range(sums.shape[1]):
            part = sums[row, k]
            for i in range(part.shape[0]):
                part[i] = background[row * down, i * right, k]


@kernel
def copy_picture(number: int64, picture: uint32[::1], pictures: uint32[:, ::1]):
    """
    Copy a view's output into the batch's array.

    Parameters
    ----------
    number : int
        That of the view.
    picture : (P,) uint32
        Its output, whatever the numbers are.
    pictures : (N, P) uint32
        Writes the row of the view.
    """
    row = pictures[number]
    for n in range(picture.shape[0]):
        row[n] = picture[n]


@kernel
def write_face_values(
    number: int64, face_id: int32[:, ::1], step: int64, face_values: int32[::1],
    values: int32[:, :, ::1],
):  # fmt: skip
    """
    Write a per-face table's value at each pixel, -1 where nothing is.

    Parameters
    ----------
    number : int
        That of the view.
    face_id : (H, W) int32
    step : int
        Every how many rows and columns it is looked at.
    face_values : (F+1,) int32
        Of each face.
    values : (N, H / step, W / step) int32
        Rounded up. Writes the picture of the view.
    """
    for row in range(values.shape[1]):
        for column in range(values.shape[2]):
            face = face_id[row * step, column * step]
            values[number, row, column] = face_values[face] if face >= 0 else np.int32(-1)


@kernel
def count_white(
    lit: int32[:, :, ::1], step: int64, color: uint32[:, ::1], counts: int64[::1]
):  # fmt: skip
    """
    Count the lit pixels of a view, and those of them that are white.

    Parameters
    ----------
    lit : (1, H / step, W / step) int32
        As `write_face_values` writes it: 1 where what is seen is lit.
    step : int
        Every how many rows and columns it is looked at.
    color : (H, W) uint32
        Codes of red, green, blue and alpha, from the lowest bits on.
    counts : (2,) int64
        Written.
    """
    counts[0], counts[1] = 0, 0
    for row in range(lit.shape[1]):
        for column in range(lit.shape[2]):
            if lit[0, row, column] <= 0:
                continue
            code = color[row * step, column * step]
            least = min(code & 255, code >> 8 & 255, code >> 16 & 255)
            counts[0] += 1
            counts[1] += np.int64(least >= MIN_WHITE)


@kernel
def measure_depths(
    number: int64, method: int64[::1], factors: float64[::1], stored: float32[:, ::1],
    face_id: int32[:, ::1], depths: float32[:, :, ::1],
):  # fmt: skip
    """
    Write the metric depth of a view, inf where nothing is.

    Parameters
    ----------
    number : int
        That of the view.
    method, factors : (1,) int64, (3,) float64
        Of stored depth s: ``RATIO`` a / s / b; ``BETWEEN`` a (1 + s) - b s; ``SCALED``
        ((-2 s - 1) a - b) / c.
    stored : (H, W) float32
    face_id : (H, W) int32
    depths : (N, H, W) float32, scene units
        Writes the picture of the view.
    """
    a, b, c = factors[0], factors[1], factors[2]
    kind = method[0]
    for row in range(face_id.shape[0]):
        for column in range(face_id.shape[1]):
            s = np.float64(stored[row, column])
            if kind == RATIO:
                depth = a / s / b
            elif kind == BETWEEN:
                depth = a * (1.0 - -s) + b * -s
            else:
                depth = ((-2.0 * s - 1.0) * a - b) / c
            is_seen = face_id[row, column] >= 0
            depths[number, row, column] = np.float32(depth if is_seen else np.inf)


@kernel
def measure_distances(
    number: int64, is_parallel: int64[::1], axis: float64[::1], relative: float32[:, :, ::1],
    distances: float32[:, :, ::1],
):  # fmt: skip
    """
    Write the distance from the eye at each pixel, inf where nothing is.

    Parameters
    ----------
    number : int
        That of the view.
    is_parallel, axis : (1,) int64, (4,) float64
        Whether lines of sight are parallel: then distances are along an axis x, y, z, of a length.
    relative : (H, W, 3) float32
        The points, relative to the eye; NaN where nothing is.
    distances : (N, H, W) float32, scene units
        Writes the picture of the view.
    """
    x, y, z, length = axis[0], axis[1], axis[2], axis[3]
    for row in range(relative.shape[0]):
        for column in range(relative.shape[1]):
            right = np.float64(relative[row, column, 0])
            up = np.float64(relative[row, column, 1])
            back = np.float64(relative[row, column, 2])
            if is_parallel[0] != 0:
                far = -((x * right + y * up) + z * back) / length
            else:
                far = np.sqrt((right * right + up * up) + back * back)
            far = np.inf if np.isnan(far) else far
            distances[number, row, column] = np.float32(far)
