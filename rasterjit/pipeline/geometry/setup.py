"""
Triangle setup: cull faces, and find the tiles that the others touch.

Screen space is y down; the centre of pixel (column i, row j) lies at (i + 1/2, j + 1/2). Vertices
come rounded to the sub-pixel grid (see ``projection``), and everything after (winding, culling,
coverage, barycentric weights) is integer arithmetic on the rounded coordinates.

Edge function: ``E(a, b, p) = (bx - ax)(py - ay) - (by - ay)(px - ax)``; a triangle with
``E(a, b, c) > 0`` runs clockwise as seen on the screen.

Bounds. The guard band ends ``GUARD_PIXELS`` beyond each side of an image of at most 16384 pixels,
so two coordinates differ by at most 2**15 pixels. On a grid of at most 12 bits a difference is at
most 2**27 units, a product of two at most 2**54, and an edge function, the difference of two such
products, at most 2**55: int64 holds all of them with 8 bits to spare. (Twice the area of a triangle
inside a square is at most the square, so no edge function really exceeds 2**54.)
``E >> grid_bits`` is at most 2**43, so a float64 division finds its quotients exactly (see
``tile_rasterizer``).

A part of a larger picture keeps to the same 2**27 units: the whole is at most 2**17 pixels wide and
high, and smaller where the grid is so fine that it and its guard band would leave them (see
``validation.tiled_size``). Then ``E >> grid_bits`` is at most 2**47 on any grid, which a float64
division still finds exactly, and a snapped vertex, moved by the part's origin, fits int32.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.records import Faces, Objects, ScreenVertices, Viewport
from rasterjit.runtime.intrinsics import copy_pair, part, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import int32, int64, uint8

GUARD_PIXELS = 8192
"""Width of the guard band around the image, pixels: inside it nothing is clipped in x or y."""

TILE_BITS = 6
"""Tiles are squares of 2**6 = 64 pixels: the depth and face numbers of one (32 KiB) fit L1."""

TILE_SIZE = 1 << TILE_BITS

MIN_LARGE_SPAN_TILES = 3
"""
Least columns plus rows of tiles that a large triangle's box spans beyond its first tile.

One that covers a whole tile is at least twice as wide or high. The box of a small one across the
corner of four tiles spans 2.
"""

MAX_COORDINATE = 1e150
"""Clip coordinates beyond it are invalid, as NaN is: products of two stay finite in float64."""

LEFT, RIGHT, BOTTOM, TOP, NEAR, FAR = 1, 2, 4, 8, 16, 32
"""Outcode bits: outside that plane of the view volume ``-w <= x, y, z <= w``."""
GUARD = 64
"""Outcode bit: outside the guard band, or not in front of the eye (``w <= 0``)."""
INVALID = 128
"""Outcode bit: a coordinate is NaN, infinite, or beyond ``MAX_COORDINATE``."""
FRUSTUM = LEFT | RIGHT | BOTTOM | TOP | NEAR | FAR
"""A face whose three vertices share one of these bits cannot be seen."""
ANY_CODE = FRUSTUM | GUARD | INVALID
"""All outcode bits."""
CLIPPED = NEAR | FAR | GUARD
"""A face with one of these bits at any vertex must be cut before the divide."""


@helper
def find_last_at_most(starts, number):
    """Return the index of the last of ascending starts that is not above a number; -1 if none."""
    low, high = 0, len(starts)
    while low < high:
        middle = (low + high) >> 1
        if starts[middle] <= number:
            low = middle + 1
        else:
            high = middle
    return low - 1


@helper
def get_picture_size(viewport):
    """Return the width and the height of the whole picture, pixels."""
    return (
        viewport.left + viewport.width + viewport.right,
        viewport.top + viewport.height + viewport.bottom,
    )


@helper
def edge(ax, ay, bx, by, px, py):
    """Return the edge function of a -> b at p, exactly."""
    return (bx - ax) * (py - ay) - (by - ay) * (px - ax)


@helper
def narrow_edge(ax, ay, bx, by, px, py):
    """Return `edge` of int32 coordinates; differences fit 32 bits, and their products are cheap."""
    along_x, along_y = np.int32(bx - ax), np.int32(by - ay)
    away_x, away_y = np.int32(px - ax), np.int32(py - ay)
    return np.int64(along_x) * np.int64(away_y) - np.int64(along_y) * np.int64(away_x)


@helper
def edge_bias(ax, ay, bx, by):
    """Return 0 for a top or left edge, which ties belong to, and -1 for any other."""
    dx, dy = bx - ax, by - ay
    if dy < 0 or (dy == 0 and dx > 0):
        return np.int64(0)
    return np.int64(-1)


@helper
def edge_at(ax, ay, bx, by, column, row, grid_bits):
    """Return the edge function of a -> b at a pixel's centre."""
    half = np.int64(1) << (grid_bits - 1)
    return edge(ax, ay, bx, by, (column << grid_bits) + half, (row << grid_bits) + half)


@helper
def biased_edge_at(ax, ay, bx, by, column, row, grid_bits):
    """Return the biased edge function at a pixel's centre, in steps of one pixel."""
    value = edge_at(ax, ay, bx, by, column, row, grid_bits)
    return (value + edge_bias(ax, ay, bx, by)) >> grid_bits


@helper
def get_face_vertices(faces, face):
    """Return the three vertex numbers of a face."""
    return np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])


@helper
def get_triangle(faces, pieces, piece_faces, triangle):
    """Return the vertex numbers and the face of a triangle: below F a face, from F on a piece."""
    face_count = np.int64(faces.shape[0])
    if triangle < face_count:
        return get_face_vertices(faces, triangle), np.int32(triangle)
    piece = triangle - face_count
    return get_face_vertices(pieces, piece), np.int32(piece_faces[piece])


@helper
def find_first_pixel(coordinate, grid_bits):
    """Return the first pixel whose centre is at or beyond a coordinate."""
    return (coordinate + (np.int64(1) << (grid_bits - 1)) - 1) >> grid_bits


@helper
def find_last_pixel(coordinate, grid_bits):
    """Return the last pixel whose centre is at or before a coordinate."""
    return (coordinate - (np.int64(1) << (grid_bits - 1))) >> grid_bits


OUTSIDE, DEGENERATE, CULLED, UNSAMPLED, SURVIVES, SPREADS, CUT, DROPPED = range(8)
"""
Outcomes of a face; the first four index the totals.

A face that survives touches one tile, one that spreads several; pieces replace a cut one.
"""

FACES_PER_BATCH = 128
"""Faces of a batch: their data, 5 KiB, stays in L1 from one pass to the next."""

BATCH_SHAPE = (6, 2 * FACES_PER_BATCH)
"""A batch in scratch memory: three corners, x and y interleaved; codes, outcomes and boxes."""

TALLY_BITS = 8
"""Width of a counter of up to ``FACES_PER_BATCH``; four, one for each total, fill an int32."""

INVALID_TOTAL = 4
"""Index of the total that counts ``DROPPED`` faces."""

POSITIVE_OFFSET = np.uint32(1 << 30)
"""Offset, in sub-pixel units, that makes every coordinate positive: whole pixels on any grid."""


@helper
def sample_margin(grid_bits, sample_radius):
    """Return the least distance of a sample from the sides of its pixel, sub-pixel units."""
    return (1 << (grid_bits - 1)) - sample_radius


@helper
def bound_edge_rise(across, down, grid_bits, sample_radius):
    """Return a bound on an edge function at a pixel's samples less that at its centre."""
    if sample_radius == 0:
        return np.int64(0)
    return (((abs(across) + abs(down)) * sample_radius) >> grid_bits) + 1


@helper
def floor_to_pixel(coordinate, grid_bits):
    """Return a coordinate in whole pixels, rounded down, int32."""
    # Numba widens int32 to int64 before it shifts, and half as many go into a register.
    x = np.uint32(np.uint32(coordinate) + POSITIVE_OFFSET)
    return np.int32(np.uint32(x >> grid_bits)) - np.int32(np.uint32(POSITIVE_OFFSET >> grid_bits))


@helper
def find_pixel_range(a, b, c, grid_bits, sample_radius):
    """Return the first and last pixel with a sample in the range of three coordinates, int32."""
    half = np.int32(sample_margin(grid_bits, sample_radius))
    first = floor_to_pixel(np.int32(min(a, min(b, c)) + np.int32(half - 1)), grid_bits)
    last = floor_to_pixel(np.int32(max(a, max(b, c)) - half), grid_bits)
    return np.int32(first), np.int32(last)


@helper
def edge_at_origin(ax, ay, bx, by):
    """Return the biased edge function of a -> b at (0, 0); it must fit int32."""
    return np.int32(np.int32(ax * by) - np.int32(ay * bx) + edge_bias(ax, ay, bx, by))


@helper
def misses_samples(a, b, c, first, beyond, grid_bits):
    """
    Return whether a triangle whose box holds at most 2 x 2 samples covers none; exactly.

    Such a triangle is less than three pixels wide and high: its edge functions fit 32 bits.

    Parameters
    ----------
    a, b, c : (int32, int32)
        The corners, with ``edge(a, b, c) > 0``.
    first : (int32, int32)
        Column and row of the first sample.
    beyond : (int32, int32)
        -1 if the next column, and the next row, is outside the box, else 0.
    grid_bits : int
    """
    half = np.int32(np.int32(1) << (grid_bits - np.uint32(1)))
    x = np.int32(np.int32(first[0] << grid_bits) + half)
    y = np.int32(np.int32(first[1] << grid_bits) + half)
    ax, ay = np.int32(a[0] - x), np.int32(a[1] - y)
    bx, by = np.int32(b[0] - x), np.int32(b[1] - y)
    cx, cy = np.int32(c[0] - x), np.int32(c[1] - y)
    # Biased edge functions at the sample, one to the right, one down, and both: negative outside.
    e0, e1 = edge_at_origin(bx, by, cx, cy), edge_at_origin(cx, cy, ax, ay)
    e2 = edge_at_origin(ax, ay, bx, by)
    right0 = np.int32(e0 + np.int32(np.int32(by - cy) << grid_bits))
    right1 = np.int32(e1 + np.int32(np.int32(cy - ay) << grid_bits))
    right2 = np.int32(e2 + np.int32(np.int32(ay - by) << grid_bits))
    down0 = np.int32(np.int32(cx - bx) << grid_bits)
    down1 = np.int32(np.int32(ax - cx) << grid_bits)
    down2 = np.int32(np.int32(bx - ax) << grid_bits)
    column, row = beyond
    first_sign = np.int32(e0 | e1 | e2)
    right_sign = np.int32(right0 | right1 | right2 | column)
    down_sign = np.int32(np.int32(e0 + down0) | np.int32(e1 + down1) | np.int32(e2 + down2) | row)
    diagonal_sign = np.int32(right0 + down0) | np.int32(right1 + down1) | np.int32(right2 + down2)
    diagonal_sign = np.int32(diagonal_sign | column | row)
    return np.int32(first_sign & right_sign & down_sign & diagonal_sign) < 0


@helper
def get_winding(a, b, c):
    """Return the winding of a triangle: 1 clockwise on screen, -1 counter-clockwise, 0 no area."""
    area = narrow_edge(a[0], a[1], b[0], b[1], c[0], c[1])
    return np.int32(np.int32(area > 0) - np.int32(area < 0))


@helper
def classify_triangle(a, b, c, winding, viewport, culled_winding):
    """
    Return the outcome of a triangle, given its winding, and its tile box.

    Int32 and branchless throughout, to vectorize: outcomes of faces are hard to predict.
    """
    # The mask changes nothing, but tells the compiler that shifts stay within 32 bits.
    bits = np.uint32(viewport.grid_bits & 15)
    first_column, last_column = find_pixel_range(a[0], b[0], c[0], bits, viewport.sample_radius)
    first_row, last_row = find_pixel_range(a[1], b[1], c[1], bits, viewport.sample_radius)
    left, right = max(first_column, np.int32(0)), min(last_column, np.int32(viewport.width - 1))
    top, bottom = max(first_row, np.int32(0)), min(last_row, np.int32(viewport.height - 1))
    is_flipped = winding < 0
    second = c[0] if is_flipped else b[0], c[1] if is_flipped else b[1]
    third = b[0] if is_flipped else c[0], b[1] if is_flipped else c[1]
    beyond = np.int32(-np.int32(left == right)), np.int32(-np.int32(top == bottom))
    # Known only for samples at pixel centres.
    is_centred = viewport.sample_radius == 0
    is_missed = misses_samples(a, second, third, (left, top), beyond, bits) & is_centred
    is_narrow = np.int32(last_column - first_column) <= np.int32(1)
    is_tiny = is_narrow & (np.int32(last_row - first_row) <= np.int32(1))
    box = (
        np.int32(left >> TILE_BITS),
        np.int32(top >> TILE_BITS),
        np.int32(right >> TILE_BITS),
        np.int32(bottom >> TILE_BITS),
    )
    is_alone = (box[0] == box[2]) & (box[1] == box[3])
    outcome = np.int32(SURVIVES) if is_alone else np.int32(SPREADS)
    is_between = (left > right) | (top > bottom) | (is_tiny & is_missed)
    outcome = np.int32(UNSAMPLED) if is_between else outcome
    is_culled = ((winding > 0) & (culled_winding > 0)) | ((winding < 0) & (culled_winding < 0))
    outcome = np.int32(CULLED) if is_culled else outcome
    outcome = np.int32(DEGENERATE) if winding == 0 else outcome
    return outcome, box


@helper
def is_large(box):
    """Return whether a box of tiles may hold a triangle that covers a whole tile."""
    return box[2] - box[0] + box[3] - box[1] >= MIN_LARGE_SPAN_TILES


@helper
def tile_edges(v0, v1, v2, xy, viewport):
    """
    Return the three edges of a triangle, positive inside.

    For each, the biased value at the first pixel of the image, and its steps right and down by a
    pixel. With several samples a pixel, the value is an upper bound on theirs.
    """
    bits, radius = viewport.grid_bits, viewport.sample_radius
    ax, ay = np.int64(xy[v0, 0]), np.int64(xy[v0, 1])
    bx, by = np.int64(xy[v1, 0]), np.int64(xy[v1, 1])
    cx, cy = np.int64(xy[v2, 0]), np.int64(xy[v2, 1])
    if edge(ax, ay, bx, by, cx, cy) < 0:
        bx, by, cx, cy = cx, cy, bx, by
    zero = np.int64(0)
    e0 = biased_edge_at(bx, by, cx, cy, zero, zero, bits)
    e1 = biased_edge_at(cx, cy, ax, ay, zero, zero, bits)
    e2 = biased_edge_at(ax, ay, bx, by, zero, zero, bits)
    e0 += bound_edge_rise(by - cy, cx - bx, bits, radius)
    e1 += bound_edge_rise(cy - ay, ax - cx, bits, radius)
    e2 += bound_edge_rise(ay - by, bx - ax, bits, radius)
    return (e0, by - cy, cx - bx), (e1, cy - ay, ax - cx), (e2, ay - by, bx - ax)


@helper
def bound_edge_in_tile(edge_and_steps, column, row):
    """Return the greatest value of an edge in a tile: below zero, the triangle misses the tile."""
    value, across, down = edge_and_steps
    last_pixel = np.int64(TILE_SIZE - 1)
    return (
        value
        + across * (column << TILE_BITS) + max(across * last_pixel, np.int64(0))
        + down * (row << TILE_BITS) + max(down * last_pixel, np.int64(0))
    )  # fmt: skip


@helper
def count_tiles(v0, v1, v2, xy, viewport, box, columns, tile_counts):
    """Add a triangle to the count of each tile that it touches, and to the last if it is large."""
    if (box[0] == box[2]) | (box[1] == box[3]):
        for row in range(box[1], box[3] + 1):
            for tile in range(row * columns + box[0], row * columns + box[2] + 1):
                tile_counts[np.uintp(tile)] += 1
    else:
        edges = tile_edges(v0, v1, v2, xy, viewport)
        steps = edges[0][1] << TILE_BITS, edges[1][1] << TILE_BITS, edges[2][1] << TILE_BITS
        for row in range(box[1], box[3] + 1):
            e0 = bound_edge_in_tile(edges[0], box[0], row)
            e1 = bound_edge_in_tile(edges[1], box[0], row)
            e2 = bound_edge_in_tile(edges[2], box[0], row)
            for tile in range(row * columns + box[0], row * columns + box[2] + 1):
                tile_counts[np.uintp(tile)] += np.int32((e0 | e1 | e2) >= 0)
                e0, e1, e2 = e0 + steps[0], e1 + steps[1], e2 + steps[2]
    if is_large(box):
        tile_counts[np.uintp(tile_counts.shape[0] - 1)] += 1


@helper
def pack_box(box):
    """Return a box of tiles as one number, a byte each."""
    return np.int32(box[0] | box[1] << 8 | box[2] << 16 | box[3] << 24)


@helper
def list_survivor(number, box, end, survivors):
    """Write a triangle and its packed box to the list."""
    triangles, boxes = survivors
    slot = np.uintp(end)
    triangles[slot] = number
    boxes[slot, 0] = np.uint8(box)
    boxes[slot, 1] = np.uint8(box >> 8)
    boxes[slot, 2] = np.uint8(box >> 16)
    boxes[slot, 3] = np.uint8(box >> 24)


@helper
def get_box(boxes, n):
    """Return the tile columns and rows (left, top, right, bottom) of a box of the list."""
    return (
        np.int64(boxes[n, 0]), np.int64(boxes[n, 1]), np.int64(boxes[n, 2]), np.int64(boxes[n, 3])
    )  # fmt: skip


@helper
def list_spread_triangle(number, corners, outcome, box, end, survivors, screen, viewport, counts):
    """List a triangle of several tiles if it survives, and count it; return the end of the list."""
    if outcome < SURVIVES:
        return end
    columns, tile_counts = counts
    list_survivor(number, pack_box(box), end, survivors)
    count_tiles(corners[0], corners[1], corners[2], screen.xy, viewport, box, columns, tile_counts)
    return end + 1


@helper
def gather_corners(all_faces, first, count, xy, batch):
    """Gather the corners of consecutive faces."""
    va, vb, vc = three_parts(batch, 0, 0, 2 * count)
    for n in range(count):
        i, face = np.uintp(n), np.uintp(first + n)
        a, b, c = get_face_vertices(all_faces, face)
        copy_pair(xy, a, va, i)
        copy_pair(xy, b, vb, i)
        copy_pair(xy, c, vc, i)


@helper
def gather_codes(all_faces, first, count, codes, batch):
    """Gather the outcodes of consecutive faces: OR of the corners plus 256 times their AND."""
    for n in range(count):
        i, face = np.uintp(n), np.uintp(first + n)
        a, b, c = get_face_vertices(all_faces, face)
        code0, code1, code2 = np.int32(codes[a]), np.int32(codes[b]), np.int32(codes[c])
        batch[3, i] = (code0 | code1 | code2) | (code0 & code1 & code2) << 8


@disjoint_helper
def find_windings(a, b, c, windings):
    """Find the winding of each face of a batch; a separate pass, since only this needs 64 bits."""
    for n in range(windings.shape[0]):
        i, j = np.uintp(n), np.uintp(2 * n)
        k = j + np.uintp(1)
        windings[i] = get_winding((a[j], a[k]), (b[j], b[k]), (c[j], c[k]))


@disjoint_helper
def classify_faces(a, b, c, codes, viewport, culled_winding, outcomes, boxes):
    """
    Cull the faces of a batch; return the totals of those dropped, by reason.

    ``outcomes`` holds the windings of the faces before, and their outcomes after.
    """
    tally = np.uint32(0)
    for n in range(outcomes.shape[0]):
        i, j = np.uintp(n), np.uintp(2 * n)
        k = j + np.uintp(1)
        outcome, box = classify_triangle(
            (a[j], a[k]), (b[j], b[k]), (c[j], c[k]), outcomes[i], viewport, culled_winding
        )
        code = codes[i]
        outcome = np.int32(CUT) if np.int32(code & CLIPPED) != 0 else outcome
        outcome = np.int32(OUTSIDE) if np.int32(code & (FRUSTUM << 8)) != 0 else outcome
        outcome = np.int32(DROPPED) if np.int32(code & INVALID) != 0 else outcome
        outcomes[i] = outcome
        # Dropped faces add 0 to the image's first tile.
        boxes[i] = pack_box(box) if outcome >= SURVIVES else np.int32(0)
        shift = np.uint32(np.uint32(outcome) * np.uint32(TALLY_BITS) & np.uint32(31))
        one = np.uint32(1) if outcome < np.int32(SURVIVES) else np.uint32(0)
        tally = np.uint32(tally + np.uint32(one << shift))
    return tally


@helper
def get_first_tile(box, columns):
    """Return the first tile of a packed box."""
    return np.uintp((box >> 8 & 255) * columns + (box & 255))


@helper
def unpack_box(box):
    """Return the tile columns and rows (left, top, right, bottom) of a packed box."""
    box = np.int64(box)
    return box & 255, box >> 8 & 255, box >> 16 & 255, box >> 24 & 255


@helper
def set_up_pieces(
    face, piece_range, piece, faces, screen, viewport, culled_winding, end, survivors, counts
):
    """List the pieces of a face; return the next piece, the end of the list, the last outcome."""
    outcome, xy = OUTSIDE, screen.xy
    while piece < piece_range[1] and faces.piece_faces[piece] == face:
        a, b, c = get_face_vertices(faces.pieces, np.uintp(piece))
        p, q, r = (xy[a, 0], xy[a, 1]), (xy[b, 0], xy[b, 1]), (xy[c, 0], xy[c, 1])
        outcome, box = classify_triangle(p, q, r, get_winding(p, q, r), viewport, culled_winding)
        number, box = faces.faces.shape[0] + piece, unpack_box(pack_box(box))
        end = list_spread_triangle(
            number, (a, b, c), np.int32(outcome), box, end, survivors, screen, viewport, counts
        )
        piece += 1
    return piece, end, outcome


@kernel
def set_up_triangles(
    face_range: (int64, int64), piece_range: (int64, int64), faces: Faces, objects: Objects,
    screen: ScreenVertices, viewport: Viewport, survivors: (int32[::1], uint8[:, ::1]),
    counts: (int64, int32[::1], int64[::1]), batch: int32[:, ::1], possible_codes: int64,
):  # fmt: skip
    """
    Drop the faces that cover no sample; list the others with the tiles they touch.

    Parameters
    ----------
    face_range, piece_range : (int, int)
        The faces, and the pieces cut from them. Pieces take the place of the face that was cut, so
        survivors ascend by face.
    faces : Faces
    objects : Objects
    screen : ScreenVertices
    viewport : Viewport
    survivors : (triangles (T,) int32, boxes (T, 4) uint8)
        Written from index ``face_range[0] + piece_range[0]``: numbers below F are faces, ``F + p``
        is piece p; boxes are inclusive tile columns and rows (left, top, right, bottom).
    counts : (tiles per row, (tiles + 1,) int32, (5,) int64)
        Adds to the number of survivors for each tile and of large ones, and to the totals: outside
        the view volume, degenerate, culled, without a sample, invalid.
    batch : (6, 256) int32
        Scratch memory of the thread, ``BATCH_SHAPE``.
    possible_codes : int
        Outcode bits that vertices may have; ``ANY_CODE`` if unknown.

    Returns
    -------
    int
        One past the last survivor written.
    """
    columns, tile_counts, totals = counts
    tile_counting = columns, tile_counts
    all_faces = faces.faces
    end = face_range[0] + piece_range[0]
    piece = piece_range[0]
    first = face_range[0]
    owner = find_last_at_most(objects.face_starts, first)
    for n in range(FACES_PER_BATCH):
        batch[3, n] = 0
    while first < face_range[1]:
        while first >= objects.face_starts[owner + 1]:
            owner += 1
        culled_winding = objects.culled_windings[owner]
        stop = min(first + FACES_PER_BATCH, min(face_range[1], objects.face_starts[owner + 1]))
        count = stop - first
        gather_corners(all_faces, first, count, screen.xy, batch)
        if possible_codes != 0:
            gather_codes(all_faces, first, count, screen.codes, batch)
        find_windings(*three_parts(batch, 0, 0, 2 * count), part(batch, 4, 0, count))
        tally = classify_faces(
            *three_parts(batch, 0, 0, 2 * count), part(batch, 3, 0, count), viewport,
            culled_winding, part(batch, 4, 0, count), part(batch, 5, 0, count),
        )  # fmt: skip
        for outcome in range(SURVIVES):
            totals[outcome] += np.int64(tally) >> (outcome * TALLY_BITS) & ((1 << TALLY_BITS) - 1)
        # List the survivors.
        for n in range(count):
            i = np.uintp(n)
            outcome, box, face = batch[4, i], batch[5, i], first + n
            if outcome <= SURVIVES:
                # Branchless: the next face overwrites one that did not survive.
                survives = np.int32(outcome == SURVIVES)
                list_survivor(face, box, end, survivors)
                tile_counts[get_first_tile(box, columns)] += survives
                end += np.int64(survives)
            elif outcome == SPREADS:
                end = list_spread_triangle(
                    face, get_face_vertices(all_faces, np.uintp(face)), outcome, unpack_box(box),
                    end, survivors, screen, viewport, tile_counting,
                )  # fmt: skip
            elif outcome == DROPPED:
                totals[INVALID_TOTAL] += 1
            else:
                start = end
                piece, end, outcome = set_up_pieces(
                    face, piece_range, piece, faces, screen, viewport, culled_winding, end,
                    survivors, tile_counting,
                )  # fmt: skip
                if end == start:
                    totals[outcome] += 1
        first = stop
    return end
