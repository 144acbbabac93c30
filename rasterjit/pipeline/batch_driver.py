"""
Draw a batch of views in machine code, without returning to Python between them.

All views of a thread use the same memory, so that argument blocks of kernels and stages are packed
once. For each view a few arrays are copied into that memory (`LOAD_SOURCE` ...: matrices, lights),
then the kernels are called by address. A view that exceeds the capacity for clipped faces or tile
lists is skipped and reported: the caller draws it as a single frame. Effects that work in Python on
what a view sees split its calls: `draw_views` makes those before, `finish_view` those after.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.setup import CLIPPED
from rasterjit.pipeline.surface.sample_block import COUNT_ELEMENTS
from rasterjit.runtime.intrinsics import call_at, call_bound, load_int64, store_int64
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import WORD, float32, float64, int32, int64, uint8, uint32

LOAD_SOURCE, LOAD_STRIDE, LOAD_TARGET, LOAD_WORDS = range(4)
"""Columns of a copy: address of the first view's words, stride between views in bytes, target
address, number of words."""

(
    TRANSFORM, FIND_CLIPPED, TRANSFORM_POSITIONS, COUNT_VERTICES, CLIP, PROJECT_CLIPPED, SET_UP,
    START_LISTS, BIN, FIND_TILE_DEPTHS, DRAW_TILES, SET_UP_SAMPLES, START_SAMPLES, BIN_SAMPLES,
    ROW_COUNT,
) = range(15)  # fmt: skip
"""Rows of the visibility kernels, as words of ``jit.Bound``; then the number of rows. The last
three build the lists for several samples a pixel, and exist only then."""

CALL_ADDRESS, CALL_STATE, CALL_BLOCK, CALL_NUMBER, CALL_CONDITION, CALL_MIN, CALL_MAX = range(7)
"""Columns of a call after visibility: machine code, its state; the address of a block of samples to
clear first, or 0; the address of a word to which the view's number is written, or 0; the address of
a word that must lie between the next two for the call to happen, or 0."""

LIMITED_WORD, MAX_VALUE = range(2)
"""Columns of a check after all calls: address of a word, and its largest value; above, a capacity
was exceeded."""

(
    OUTSIDE,
    DEGENERATE,
    CULLED,
    UNSAMPLED,
    INVALID,
    COVERED,
    CUT,
    LIT_PIXELS,
    LIT_WHITE_PIXELS,
    TOTAL_COUNT,
) = range(10)
"""Columns of the totals: faces, as ``setup`` counts them; pixels that show a face; faces that were
clipped; the counts of `count_white`; then the number of columns."""

MIN_WHITE_CODE = 254
"""Least code of red, green and blue that counts as white (overexposed)."""

RATIO, BETWEEN, SCALED = range(3)
"""Formulas from stored to metric depth, see `measure_depths`."""


@helper
def load_view(number, loads):
    """Copy a view's arrays to the memory that kernels read."""
    for k in range(loads.shape[0]):
        source = loads[k, LOAD_SOURCE] + number * loads[k, LOAD_STRIDE]
        for n in range(loads[k, LOAD_WORDS]):
            store_int64(loads[k, LOAD_TARGET] + n * WORD, load_int64(source + n * WORD))


@helper
def clip_faces(visibility, clipping):
    """Clip faces to near and far plane and guard band; return their number, -1: too many."""
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
def bin_triangles(binning, pieces, set_up, start, bin_all):
    """List the triangles of each tile; return their number, or -1: too many."""
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
def find_visible_faces(visibility, clipping, binning, tile_depths):
    """Find the face at every pixel; return the number of clipped faces, or -1: too many."""
    counts, tiles = binning[0], tile_depths.shape[0]
    codes = call_bound(visibility[TRANSFORM])
    clipped = np.int64(0)
    if codes & CLIPPED:
        clipped = clip_faces(visibility, clipping)
        if clipped < 0:
            return clipped
    pieces = clipping[2][clipped] if clipped > 0 else np.int64(0)
    triangles = bin_triangles(
        binning, pieces, visibility[SET_UP], visibility[START_LISTS], visibility[BIN]
    )  # fmt: skip
    if triangles < 0:
        return triangles
    for n in range(tiles):
        tile_depths[n] = -np.inf
    if counts[0, tiles] > 0:
        call_bound(visibility[FIND_TILE_DEPTHS])
    call_bound(visibility[DRAW_TILES])
    return clipped


@helper
def bin_for_samples(visibility, clipping, binning, clipped):
    """List the triangles of each tile again, if pixels have several samples; -1: too many."""
    if visibility.shape[0] == ROW_COUNT:
        pieces = clipping[2][clipped] if clipped > 0 else np.int64(0)
        triangles = bin_triangles(
            binning, pieces, visibility[SET_UP_SAMPLES], visibility[START_SAMPLES],
            visibility[BIN_SAMPLES]
        )  # fmt: skip
        if triangles < 0:
            return triangles
    return clipped


@helper
def is_due(call):
    """Tell whether a call happens in this view."""
    if call[CALL_CONDITION] == 0:
        return True
    value = load_int64(call[CALL_CONDITION])
    return call[CALL_MIN] <= value <= call[CALL_MAX]


@helper
def run_calls(calls, limits, number):
    """Run the calls that follow visibility; return whether no capacity was exceeded."""
    for k in range(calls.shape[0]):
        if not is_due(calls[k]):
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
        has_room &= load_int64(limits[k, LIMITED_WORD]) <= limits[k, MAX_VALUE]
    return has_room


@helper
def count_covered(face_id):
    """Return the number of pixels covered by a face."""
    covered = np.int64(0)
    for row in range(face_id.shape[0]):
        row_covered = np.int32(0)
        for column in range(face_id.shape[1]):
            row_covered += np.int32(face_id[row, column] >= 0)
        covered += row_covered
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
        For each view, its index in the arrays, and its number in the batch.
    loads : (K, 4) int64
        The copies before each view, see ``LOAD_SOURCE``; index 0 is the first view in the arrays.
    visibility : (11, 2) or (14, 2) int64
        The kernels that find the faces, see ``TRANSFORM``.
    clipping : (counts (C,), vertex_starts (C+1,), piece_starts (C+1,), addresses (n,), int)
        For at most C clipped faces: numbers of vertices, and running sums of these and of pieces;
        addresses of words to which the number of clipped faces is written; capacity for vertices.
    binning : (counts (1, tiles + 1), sums (5,), starts (tiles + 1,), int, int, lengths (n,))
        Counts of those kernels, capacity of the lists of all tiles, address of the word with the
        number of pieces, and addresses of words to which the number of triangles is written.
    sample_binning
        The same for the kernels that list what touches any sample.
    tile_depths : (tiles,) float32
        Scratch memory of the kernels.
    face_id : (H, W) int32
        The visible faces; colours may overwrite them.
    calls : (C, 7) int64
        The calls after that, see ``CALL_ADDRESS``.
    limits : (L, 2) int64
        Checks after all calls, see ``LIMITED_WORD``; if one fails, the view is skipped.
    white : (2,) int64
        Counts of `count_white`, if called; else zeros.
    totals : (n, 9) int64
        Written for drawn views: see ``OUTSIDE``.
    is_drawn : (n,) uint8
        Written: 1 for drawn views, 0 for skipped ones.
    """
    for n in range(chosen.shape[0]):
        load_view(chosen[n, 0], loads)
        clipped = find_visible_faces(visibility, clipping, binning, tile_depths)
        # Later calls may overwrite the faces.
        covered = count_covered(face_id)
        if clipped >= 0:
            clipped = bin_for_samples(visibility, clipping, sample_binning, clipped)
        if clipped < 0 or not run_calls(calls, limits, chosen[n, 1]):
            is_drawn[n] = 0
            continue
        for k in range(COVERED):
            totals[n, k] = binning[1][k]
        totals[n, COVERED], totals[n, CUT] = covered, clipped
        totals[n, LIT_PIXELS], totals[n, LIT_WHITE_PIXELS] = white[0], white[1]
        is_drawn[n] = 1


@kernel
def finish_view(number: int64, calls: int64[:, ::1], limits: int64[:, ::1]):
    """
    Run the calls of a view that follow a step in Python; return whether no capacity was exceeded.

    Parameters
    ----------
    number : int
        The view's number in the batch.
    calls, limits
        As `draw_views` takes them.
    """
    return run_calls(calls, limits, number)


@kernel
def start_resolve(
    call: int64[::1], rows: int64, background: float32[:, :, ::1], sums: float32[:, :, ::1]
):
    """
    List the faces of some rows with several samples a pixel, and start sums with the background.

    Parameters
    ----------
    call : (2,) int64
        ``coverage_resolve.list_coverage`` for these rows.
    rows : int
        Address of the word to which the number of rows of all layers is written.
    background : (R, W, 4) float32, or (1, 1, 4) if all is alike
        The background, linear.
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
        The view's number.
    picture : (P,) uint32
        The view's output, as 32-bit words.
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
    Write the value of each pixel's face, -1 where nothing is.

    Parameters
    ----------
    number : int
        The view's number.
    face_id : (H, W) int32
    step : int
        Stride between the rows, and the columns, that are read.
    face_values : (F+1,) int32
        The value of each face.
    values : (N, H / step, W / step) int32
        Rounded up. Writes the view's picture.
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
    Count the lit pixels of a view, and the white ones among them.

    Parameters
    ----------
    lit : (1, H / step, W / step) int32
        From `write_face_values`: 1 where the visible face is lit.
    step : int
        Stride between the rows, and the columns, that are read.
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
            counts[1] += np.int64(least >= MIN_WHITE_CODE)


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
        The view's number.
    method, factors : (1,) int64, (3,) float64
        Of stored depth s: ``RATIO`` a / s / b; ``BETWEEN`` a (1 + s) - b s; ``SCALED``
        ((-2 s - 1) a - b) / c.
    stored : (H, W) float32
    face_id : (H, W) int32
    depths : (N, H, W) float32, scene units
        Writes the view's picture.
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
        The view's number.
    is_parallel, axis : (1,) int64, (4,) float64
        Whether lines of sight are parallel; then distances are along the axis x, y, z, of a length.
    relative : (H, W, 3) float32
        Positions, relative to the eye; NaN where nothing is.
    distances : (N, H, W) float32, scene units
        Writes the view's picture.
    """
    x, y, z, length = axis[0], axis[1], axis[2], axis[3]
    for row in range(relative.shape[0]):
        for column in range(relative.shape[1]):
            right = np.float64(relative[row, column, 0])
            up = np.float64(relative[row, column, 1])
            back = np.float64(relative[row, column, 2])
            if is_parallel[0] != 0:
                distance = -((x * right + y * up) + z * back) / length
            else:
                distance = np.sqrt((right * right + up * up) + back * back)
            distance = np.inf if np.isnan(distance) else distance
            distances[number, row, column] = np.float32(distance)
