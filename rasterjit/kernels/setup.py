"""
Decide which faces go on, and which tiles they reach.

Screen space is y down; the centre of pixel (column i, row j) lies at (i + 1/2, j + 1/2). Vertices
come rounded to the sub-pixel grid (see ``projection``), and everything after (turn, culling,
coverage, barycentric weights) is integer arithmetic on the rounded coordinates.

Edge function: ``E(a, b, p) = (bx - ax)(py - ay) - (by - ay)(px - ax)``; a triangle with
``E(a, b, c) > 0`` runs clockwise as seen on the screen.

Bounds. The guard band ends ``GUARD_PIXELS`` beyond each side of an image of at most 16384 pixels,
so two coordinates differ by at most 2**15 pixels. On a grid of at most 12 bits a difference is at
most 2**27 units, a product of two at most 2**54, and an edge function, the difference of two such
products, at most 2**55: int64 holds all of them with 8 bits to spare. (Twice the area of a triangle
inside a square is at most the square, so no edge function really exceeds 2**54.)
``E >> grid_bits`` is at most 2**43, so a float64 division finds its quotients exactly (see
``visibility``).
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import kernel, stage
from rasterjit.kernels.records import Faces, Objects

GUARD_PIXELS = 8192
"""Width of the guard band around the image, pixels: what lies inside it is not cut in x or y."""

TILE_BITS = 6
"""Tiles are squares of 2**6 = 64 pixels: the depth and face numbers of one (32 KiB) fit L1."""

TILE_SIZE = 1 << TILE_BITS

LARGE_SPAN = 3
"""
Tiles that a large triangle's box reaches beyond its first, right and down together.

One that covers a whole tile is at least twice as wide or high. Small ones that lie across the
corner of four tiles reach 2.
"""

LARGEST_COORDINATE = 1e150
"""Clip coordinates beyond it are invalid, as NaN is: products of two stay finite in float64."""

LEFT, RIGHT, BOTTOM, TOP, NEAR, FAR = 1, 2, 4, 8, 16, 32
"""Outcode bits: outside that plane of the view volume ``-w <= x, y, z <= w``."""
GUARD = 64
"""Outcode bit: outside the guard band, or not in front of the eye (``w <= 0``)."""
INVALID = 128
"""Outcode bit: a coordinate is NaN, infinite, or beyond ``LARGEST_COORDINATE``."""
FRUSTUM = LEFT | RIGHT | BOTTOM | TOP | NEAR | FAR
"""A face whose three vertices share one of these bits cannot be seen."""
CLIPPED = NEAR | FAR | GUARD
"""A face with one of these bits at any vertex must be cut before the divide."""


@stage
def edge(ax, ay, bx, by, px, py):
    """Return the edge function of a -> b at p, exactly."""
    return (bx - ax) * (py - ay) - (by - ay) * (px - ax)


@stage
def edge_bias(ax, ay, bx, by):
    """Return 0 for a top or left edge and -1 for any other: a tie belongs to top and left."""
    dx, dy = bx - ax, by - ay
    if dy < 0 or (dy == 0 and dx > 0):
        return np.int64(0)
    return np.int64(-1)


@stage
def edge_at(ax, ay, bx, by, column, row, grid_bits):
    """Return the edge function of a -> b at a pixel's centre."""
    half = np.int64(1) << (grid_bits - 1)
    return edge(ax, ay, bx, by, (column << grid_bits) + half, (row << grid_bits) + half)


@stage
def sign_at(ax, ay, bx, by, column, row, grid_bits):
    """Return the biased edge function at a pixel's centre, in steps of one pixel."""
    value = edge_at(ax, ay, bx, by, column, row, grid_bits)
    return (value + edge_bias(ax, ay, bx, by)) >> grid_bits


@stage
def corners_of(faces, face):
    """Return the three vertex numbers of a face."""
    return np.uintp(faces[face, 0]), np.uintp(faces[face, 1]), np.uintp(faces[face, 2])


@stage
def triangle_of(faces, pieces, piece_faces, triangle):
    """Return the vertex numbers and the face of a triangle: of F faces, then of their pieces."""
    face_count = np.int64(faces.shape[0])
    if triangle < face_count:
        return corners_of(faces, triangle), np.int32(triangle)
    piece = triangle - face_count
    return corners_of(pieces, piece), np.int32(piece_faces[piece])


@stage
def first_sample(coordinate, grid_bits):
    """Return the first pixel whose centre is at or beyond a coordinate."""
    return (coordinate + (np.int64(1) << (grid_bits - 1)) - 1) >> grid_bits


@stage
def last_sample(coordinate, grid_bits):
    """Return the last pixel whose centre is at or before a coordinate."""
    return (coordinate - (np.int64(1) << (grid_bits - 1))) >> grid_bits


# What becomes of a face; but for SURVIVES, these index the totals.
OUTSIDE, DEGENERATE, CULLED, UNSAMPLED, DROPPED, SURVIVES = 0, 1, 2, 3, 4, 5


@stage
def survey_triangle(v0, v1, v2, xy, viewport, culled_turn):
    """Decide whether a triangle can cover a sample; return that and its tile box."""
    x0, y0 = np.int64(xy[v0, 0]), np.int64(xy[v0, 1])
    x1, y1 = np.int64(xy[v1, 0]), np.int64(xy[v1, 1])
    x2, y2 = np.int64(xy[v2, 0]), np.int64(xy[v2, 1])
    bits = viewport.grid_bits
    left = max(first_sample(min(x0, min(x1, x2)), bits), np.int64(0))
    right = min(last_sample(max(x0, max(x1, x2)), bits), np.int64(viewport.width - 1))
    top = max(first_sample(min(y0, min(y1, y2)), bits), np.int64(0))
    bottom = min(last_sample(max(y0, max(y1, y2)), bits), np.int64(viewport.height - 1))
    area = edge(x0, y0, x1, y1, x2, y2)
    # No branches: what a face turns out to be is hard to predict.
    outcome = UNSAMPLED if (left > right) | (top > bottom) else SURVIVES
    if ((area > 0) & (culled_turn > 0)) | ((area < 0) & (culled_turn < 0)):
        outcome = CULLED
    if area == 0:
        outcome = DEGENERATE
    box = (left >> TILE_BITS, top >> TILE_BITS, right >> TILE_BITS, bottom >> TILE_BITS)
    return outcome, box


@stage
def is_large(box):
    """Return whether a box of tiles may hold a triangle that covers a whole tile."""
    return box[2] - box[0] + box[3] - box[1] >= LARGE_SPAN


@stage
def tile_edges(v0, v1, v2, xy, grid_bits):
    """
    Return the three edges of a triangle, positive inside.

    Of each the biased value at the first pixel of the image and what it gains by a pixel to the
    right and by one down.
    """
    ax, ay = np.int64(xy[v0, 0]), np.int64(xy[v0, 1])
    bx, by = np.int64(xy[v1, 0]), np.int64(xy[v1, 1])
    cx, cy = np.int64(xy[v2, 0]), np.int64(xy[v2, 1])
    if edge(ax, ay, bx, by, cx, cy) < 0:
        bx, by, cx, cy = cx, cy, bx, by
    zero = np.int64(0)
    return (
        (sign_at(bx, by, cx, cy, zero, zero, grid_bits), by - cy, cx - bx),
        (sign_at(cx, cy, ax, ay, zero, zero, grid_bits), cy - ay, ax - cx),
        (sign_at(ax, ay, bx, by, zero, zero, grid_bits), ay - by, bx - ax),
    )


@stage
def best_in_tile(line, column, row):
    """Return the greatest value of an edge at the samples of a tile."""
    value, across, down = line
    reach = np.int64(TILE_SIZE - 1)
    return (
        value
        + across * (column << TILE_BITS) + max(across * reach, np.int64(0))
        + down * (row << TILE_BITS) + max(down * reach, np.int64(0))
    )  # fmt: skip


@stage
def reaches_tile(lines, column, row):
    """Return whether no edge has a whole tile on its outside."""
    return (
        best_in_tile(lines[0], column, row)
        | best_in_tile(lines[1], column, row)
        | best_in_tile(lines[2], column, row)
    ) >= 0


@stage
def count_tiles(v0, v1, v2, xy, grid_bits, box, columns, tile_counts):
    """Add one triangle to the count of every tile it reaches, and to the last if it is large."""
    if (box[0] == box[2]) | (box[1] == box[3]):
        for row in range(box[1], box[3] + 1):
            for column in range(box[0], box[2] + 1):
                tile_counts[np.uintp(row * columns + column)] += 1
    else:
        lines = tile_edges(v0, v1, v2, xy, grid_bits)
        for row in range(box[1], box[3] + 1):
            for column in range(box[0], box[2] + 1):
                reached = reaches_tile(lines, column, row)
                tile_counts[np.uintp(row * columns + column)] += np.int32(reached)
    if is_large(box):
        tile_counts[np.uintp(tile_counts.shape[0] - 1)] += 1


@stage
def list_survivor(number, corners, outcome, box, end, survivors, screen, viewport, counts):
    """List a triangle and its box if it survives; return the end of the list."""
    if outcome != SURVIVES:
        return end
    columns, tile_counts = counts
    triangles, boxes = survivors
    slot = np.uintp(end)
    triangles[slot] = number
    boxes[slot, 0], boxes[slot, 1], boxes[slot, 2], boxes[slot, 3] = box
    count_tiles(
        corners[0], corners[1], corners[2], screen.xy, viewport.grid_bits, box, columns, tile_counts
    )
    return end + 1


@kernel
def set_up_triangles(
    face_range, piece_range, faces: Faces, objects: Objects, screen, viewport, survivors, counts
):
    """
    Drop the faces that no sample can see and list the others with the tiles they touch.

    Parameters
    ----------
    face_range, piece_range : (int, int)
        The faces to look at, and the pieces cut from them. A face that was cut is replaced by its
        pieces, in its place, so survivors ascend by face.
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

    Returns
    -------
    int
        One past the last survivor written.
    """
    columns, tile_counts, totals = counts
    listing = columns, tile_counts
    own, codes, xy = faces.faces, screen.codes, screen.xy
    face_count = own.shape[0]
    end = face_range[0] + piece_range[0]
    piece = piece_range[0]
    owner = np.searchsorted(objects.face_starts, face_range[0], side="right") - 1
    for face in range(face_range[0], face_range[1]):
        while face >= objects.face_starts[owner + 1]:
            owner += 1
        # Reject by outcodes.
        a, b, c = corners_of(own, np.uintp(face))
        code0, code1, code2 = codes[a], codes[b], codes[c]
        any_code = code0 | code1 | code2
        if any_code & INVALID:
            totals[DROPPED] += 1
            continue
        if code0 & code1 & code2 & FRUSTUM:
            totals[OUTSIDE] += 1
            continue
        # List the face itself, or the pieces it was cut into.
        turn = objects.culled_turns[owner]
        first = end
        if not any_code & CLIPPED:
            outcome, box = survey_triangle(a, b, c, xy, viewport, turn)
            end = list_survivor(
                face, (a, b, c), outcome, box, end, survivors, screen, viewport, listing
            )
        else:
            outcome = OUTSIDE
            while piece < piece_range[1] and faces.piece_faces[piece] == face:
                a, b, c = corners_of(faces.pieces, piece)
                outcome, box = survey_triangle(a, b, c, xy, viewport, turn)
                number = face_count + piece
                end = list_survivor(
                    number, (a, b, c), outcome, box, end, survivors, screen, viewport, listing
                )
                piece += 1
        if end == first:
            totals[outcome] += 1
    return end
