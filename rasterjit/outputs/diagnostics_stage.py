"""
Find the fate of every face, count its samples, and bound the error of interpolation.

Runs after visibility, only when requested, on the tile lists of the frame. Each triangle of a tile
is drawn alone, by the code that drew the frame, so its samples and depths are those of the frame
bit for bit; then they are compared with the frame.

Error bounds
------------
With ``u = 2**-53``, ``g(n) = n u / (1 - n u)`` bounds the relative error of n roundings one after
the other [1]_. ``M`` is the largest magnitude of the three vertex values, b the exact weights and
b' the computed ones. ``interpolate`` adds to ``v0`` two products of a weight and a difference
``v1 - v0`` of at most ``2 M``. The difference, the product and the sums are at most four roundings
of each product and two of ``v0``, so with relative errors g(n) of the weights the value is off by

``M g(2) + 2 M (b1 + b2) g(n + 4)``.

*A face that was not clipped.* The edge functions are exact integers below 2**55: turning one into
float64 rounds once, as do (smallest w) / w and their product: 3. All three have one sign, so the
sum of the three is off by two more: 5. The quotient of a term (3) and the sum (5) rounds once: n =
9. With ``b1 + b2 <= 1`` the value is within ``M (2 + 26) u``, up to terms in u**2, for which
``UNCLIPPED_ERROR`` has a spare u.

*A face that was clipped.* The sample's x is ``(2 i + 1) / W - 1``, off by 3 u: the quotient is
below 2, the difference below 1. With ``p = |x_k| + |w_k|`` in clip space, ``x_k - x w_k`` is off by
``3 u |w_k|`` through x, ``u |w_k|`` through the product and ``u p`` through the difference: within
``5 u p``. A weight is a difference of two products of such terms, so it is off by

``s_0 = u (5 (p_1 |v_2| + |u_1| q_2 + p_2 |v_1| + |u_2| q_1) + 2 (|u_1 v_2| + |u_2 v_1|))``,

with q for y as p for x. Where terms cancel to zero a product of two errors counts as well, and so
does an error in the term it is relative to: ``3 (5 u)**2 p q``, within 5 u times 16 u p q.
Clamping the weights to zero from below brings them no farther from the exact
ones clamped likewise. Let s be the sum of the three, T that of the computed weights. After the
division ``|b'_k - b_k| <= (s_k + b'_k s) / (T - s) + 3 u b'_k``. The value is within

``2 M ((s_1 + s_2 + (b'_1 + b'_2) s) / (T - s) + 7 u) + 2 M u``,

where 7 u are the three of the sum and the division and the four of ``interpolate``.
``WEIGHT_ROUNDING`` enlarges s by a part in 1024, and ``INTERPOLATION_ROUNDING`` has two spare u,
for the terms in u**2. If the sum of the weights before they are clamped is not above 2 s, even its
sign may be wrong: the bound is infinite.

The bounds are for the worst of all roundings at once. Of random faces compared with exact
arithmetic the worst sample reaches 0.15 of the bound where they are not clipped, however far apart
their w, and 0.09 where they are.

References
----------
.. [1] N. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd edition, 2002, lemma 3.1.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry import setup
from rasterjit.pipeline.geometry.barycentric import offset_from_sample
from rasterjit.pipeline.geometry.triangle_batches import BOTTOM, FACE, LEFT, RIGHT, TOP
from rasterjit.pipeline.records import Faces, Geometry, Objects, ScreenVertices, Viewport
from rasterjit.pipeline.visibility import tile_rasterizer
from rasterjit.pipeline.visibility.tile_rasterizer import TileDrawing
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float64, int32, int64, stored, uint8

DROPPED, DEGENERATE, OUTSIDE, CULLED, SUB_PIXEL, HIDDEN, VISIBLE = 0, 1, 2, 3, 4, 5, 6
"""Fates of a face. Of the pieces that a face was cut into, the greatest fate is the face's."""
FATE_COUNT = 7

ROUNDING = 2.0**-53
"""u: the largest relative error of one float64 operation."""
UNCLIPPED_ERROR = 29.0 * ROUNDING
"""Error bound of a value on a face that was not clipped, in units of the largest vertex value."""
WEIGHT_ROUNDING = ROUNDING * (1.0 + 2.0**-10)
"""u, enlarged for terms in u**2, in the error bound of a weight of a clipped face."""
INTERPOLATION_ROUNDING = 18.0 * ROUNDING
"""Part of the error bound on a clipped face that does not come from the weights."""


@helper
def read_screen_corners(corners, xy):
    """Return x and y of each corner of a triangle, as int64."""
    a, b, c = corners
    return (
        np.int64(xy[a, 0]), np.int64(xy[a, 1]), np.int64(xy[b, 0]), np.int64(xy[b, 1]),
        np.int64(xy[c, 0]), np.int64(xy[c, 1]),
    )  # fmt: skip


@helper
def count_triangle_samples(face, box, origin, tile, empty, frame, ties):
    """Count and clear the samples of the only triangle in a tile; mark where it lost a tie."""
    depths, numbers = tile
    frame_depth, face_id = frame
    count = np.int32(0)
    for y in range(box[1], box[3] + 1):
        for x in range(box[0], box[2] + 1):
            row, column = y - origin[1], x - origin[0]
            if numbers[row, column] == tile_rasterizer.NOTHING:
                continue
            count += np.int32(1)
            if face_id[y, x] != face and frame_depth[y, x] == depths[row, column]:
                ties[row, column] = 1
            depths[row, column] = empty
            numbers[row, column] = tile_rasterizer.NOTHING
    return count


@helper
def count_and_clear_ties(ties):
    """Count the marked ties of a tile, and clear the marks."""
    count = np.int64(0)
    for row in range(ties.shape[0]):
        for column in range(ties.shape[1]):
            count += np.int64(ties[row, column])
            ties[row, column] = 0
    return count


@kernel
def count_samples(
    tiles: int32[::1], starts: int64[::1], viewport: Viewport,
    frame: (stored[:, ::1], int32[:, ::1]), scratch: tile_rasterizer.SCRATCH, drawing: TileDrawing,
    ties: uint8[:, ::1], counts: (int32[::1], int64[::1]),
):  # fmt: skip
    """
    Count the samples of every triangle in some of the frame's tiles.

    Parameters
    ----------
    tiles : (N,) int32
    starts : (tiles + 1,) int64
        As ``tile_rasterizer.draw_tiles`` takes them.
    viewport : Viewport
    frame : (depth (H, W), face_id (H, W) int32)
        What ``tile_rasterizer.draw_tiles`` wrote.
    scratch, drawing
        Those of this thread's ``tile_rasterizer.make_tile_drawer``, of the same type of depths.
    ties : (64, 64) uint8
        Scratch memory, zero.
    counts : (samples (M,) int32, ties (tiles,) int64)
        Writes the samples that each entry of the lists covers in its tile, seen or not; and for
        each tile the pixels where a face lost to another of exactly equal depth.
    """
    samples, tied = counts
    depths, numbers, empty = scratch[0], scratch[1], scratch[tile_rasterizer.EMPTY_DEPTH_INDEX][0]
    columns = (np.int64(viewport.width) + setup.TILE_SIZE - 1) >> setup.TILE_BITS
    bounds = scratch[2]
    tile_rasterizer.clear_tile(depths, numbers, empty)
    for n in range(tiles.shape[0]):
        tile = np.int64(tiles[n])
        window = tile_rasterizer.get_tile_window(tile, columns, viewport)
        origin = window[0], window[1]
        tile_rasterizer.begin_tile(drawing, window, viewport.grid_bits, (0, 0), empty)
        for k in range(starts[tile], starts[tile + 1]):
            tile_rasterizer.set_up_listed(drawing, k, 1)
            tile_rasterizer.draw_range(drawing, drawing.tile, 0, 1)
            # The box of a wide triangle may begin left of the tile.
            left, top = max(np.int64(bounds[LEFT, 0]), origin[0]), np.int64(bounds[TOP, 0])
            box = left, top, np.int64(bounds[RIGHT, 0]), np.int64(bounds[BOTTOM, 0])
            samples[k] = count_triangle_samples(
                bounds[FACE, 0], box, origin, (depths, numbers), empty, frame, ties
            )
        tied[tile] = count_and_clear_ties(ties)


@helper
def max_edge_value(ax, ay, bx, by, width, height):
    """Return the greatest value of an edge function over the image."""
    px = np.int64(0) if by > ay else width
    py = height if bx > ax else np.int64(0)
    return setup.edge(ax, ay, bx, by, px, py)


@helper
def find_fate(corners, screen, viewport, winding, samples):
    """Return the fate of one triangle that was set up, visible or not."""
    ax, ay, bx, by, cx, cy = read_screen_corners(corners, screen.xy)
    area = setup.edge(ax, ay, bx, by, cx, cy)
    if area == 0:
        return DEGENERATE
    if (area > 0 and winding > 0) or (area < 0 and winding < 0):
        return CULLED
    if samples > 0:
        return HIDDEN
    if area < 0:
        bx, by, cx, cy = cx, cy, bx, by
    width = np.int64(viewport.width) << viewport.grid_bits
    height = np.int64(viewport.height) << viewport.grid_bits
    # The triangle misses the image if a line separates the two.
    is_missed = (
        max(ax, max(bx, cx)) <= 0
        or min(ax, min(bx, cx)) >= width
        or max(ay, max(by, cy)) <= 0
        or min(ay, min(by, cy)) >= height
        or max_edge_value(ax, ay, bx, by, width, height) <= 0
        or max_edge_value(bx, by, cx, cy, width, height) <= 0
        or max_edge_value(cx, cy, ax, ay, width, height) <= 0
    )
    return OUTSIDE if is_missed else SUB_PIXEL


@kernel
def find_fates(
    faces: Faces, objects: Objects, screen: ScreenVertices, viewport: Viewport,
    coverage: (int64[::1], uint8[::1]), fates: uint8[::1],
):  # fmt: skip
    """
    Write the fate of each face.

    Parameters
    ----------
    faces, objects, screen, viewport : records
        As `setup.set_up_triangles` took them.
    coverage : (samples (F + P,) int64, shown (F,) uint8)
        The samples that each triangle covers, faces first, then pieces; and which faces are visible
        at a pixel.
    fates : (F,) uint8
        Written: ``DROPPED`` .. ``VISIBLE``.
    """
    samples, is_visible = coverage
    vertices, codes = faces.faces, screen.codes
    face_count = np.int64(vertices.shape[0])
    piece = 0
    owner = 0
    for face in range(face_count):
        while face >= objects.face_starts[owner + 1]:
            owner += 1
        corners = setup.get_face_vertices(vertices, face)
        code0, code1, code2 = codes[corners[0]], codes[corners[1]], codes[corners[2]]
        any_code = code0 | code1 | code2
        winding = objects.culled_windings[owner]
        if any_code & setup.INVALID:
            fate = DROPPED
        elif code0 & code1 & code2 & setup.FRUSTUM:
            fate = OUTSIDE
        elif not any_code & setup.CLIPPED:
            fate = find_fate(corners, screen, viewport, winding, samples[face])
        else:
            has_pieces = piece < faces.pieces.shape[0] and faces.piece_faces[piece] == face
            fate = DEGENERATE if has_pieces else OUTSIDE
            while piece < faces.pieces.shape[0] and faces.piece_faces[piece] == face:
                corners = setup.get_face_vertices(faces.pieces, piece)
                covered = samples[face_count + piece]
                fate = max(fate, find_fate(corners, screen, viewport, winding, covered))
                piece += 1
        fates[face] = VISIBLE if is_visible[face] else fate


@helper
def bound_weight_error(p1, u1, q1, v1, p2, u2, q2, v2):
    """Return the error bound of one weight of a clipped face."""
    operands = p1 * abs(v2) + abs(u1) * q2 + p2 * abs(v1) + abs(u2) * q1
    operands += 16.0 * ROUNDING * (p1 * q2 + p2 * q1)
    return WEIGHT_ROUNDING * (5.0 * operands + 2.0 * (abs(u1 * v2) + abs(u2 * v1)))


@helper
def bound_segment_error(a, b, column, row, geometry):
    """
    Return the error bound at a sample of a segment or a point.

    The terms of the two products behind a weight are at most ``max_x`` and ``max_y``; each
    product is off by at most 16 units of rounding of them.
    """
    clip = geometry.clip_positions
    width, height = setup.get_picture_size(geometry.viewport)
    (u0, u1, _), (v0, v1, _) = offset_from_sample(
        a, b, b, column, row, clip, geometry.viewport
    )  # fmt: skip
    w0, w1 = abs(clip[a, 3]), abs(clip[b, 3])
    x = width * (clip[b, 0] * clip[a, 3] - clip[a, 0] * clip[b, 3])
    y = height * (clip[b, 1] * clip[a, 3] - clip[a, 1] * clip[b, 3])
    max_x = width * (abs(clip[b, 0]) * w0 + abs(clip[a, 0]) * w1)
    max_y = height * (abs(clip[b, 1]) * w0 + abs(clip[a, 1]) * w1)
    first_product = width * u0 * x + height * v0 * y
    length = first_product - (width * u1 * x + height * v1 * y)
    if length == 0.0:
        return INTERPOLATION_ROUNDING
    first_error = 16.0 * ROUNDING * (
        width * (abs(clip[a, 0]) + w0) * max_x + height * (abs(clip[a, 1]) + w0) * max_y
    )  # fmt: skip
    second_error = 16.0 * ROUNDING * (
        width * (abs(clip[b, 0]) + w1) * max_x + height * (abs(clip[b, 1]) + w1) * max_y
    )  # fmt: skip
    length_error = first_error + second_error
    if not abs(length) > 2.0 * length_error:
        return np.inf
    error = 2.0 * (2.0 * first_error + second_error) / (abs(length) - length_error)
    error += INTERPOLATION_ROUNDING
    return error if error == error else np.inf


@helper
def bound_clipped_error(a, b, c, column, row, geometry):
    """Return the error bound at a sample of a face that was clipped."""
    if b == c:
        return bound_segment_error(a, b, column, row, geometry)
    clip = geometry.clip_positions
    w0, w1, w2 = abs(clip[a, 3]), abs(clip[b, 3]), abs(clip[c, 3])
    p0, p1, p2 = abs(clip[a, 0]) + w0, abs(clip[b, 0]) + w1, abs(clip[c, 0]) + w2
    q0, q1, q2 = abs(clip[a, 1]) + w0, abs(clip[b, 1]) + w1, abs(clip[c, 1]) + w2
    (u0, u1, u2), (v0, v1, v2) = offset_from_sample(a, b, c, column, row, clip, geometry.viewport)
    b0, b1, b2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    s0 = bound_weight_error(p1, u1, q1, v1, p2, u2, q2, v2)
    s1 = bound_weight_error(p2, u2, q2, v2, p0, u0, q0, v0)
    s2 = bound_weight_error(p0, u0, q0, v0, p1, u1, q1, v1)
    s = s0 + s1 + s2
    total = b0 + b1 + b2
    if not abs(total) > 2.0 * s:
        return np.inf
    winding = 1.0 if total > 0.0 else -1.0
    b0, b1, b2 = max(winding * b0, 0.0), max(winding * b1, 0.0), max(winding * b2, 0.0)
    total = b0 + b1 + b2
    weight_error = (s1 + s2 + (b1 + b2) / total * s) / (total - s)
    error = 2.0 * weight_error + INTERPOLATION_ROUNDING
    return error if error == error else np.inf


@kernel
def find_largest_error(
    face_id: int32[:, ::1], rows: (int64, int64), geometry: Geometry, largest: float64[::1]
):  # fmt: skip
    """
    Find the largest error bound of an interpolated value in some rows of pixels.

    Parameters
    ----------
    face_id : (H, W) int32
    rows : (int, int)
        First row, and one past the last.
    geometry : Geometry
    largest : (1,) float64
        Read and written: the larger of it and the bounds. In units of the largest magnitude of a
        face's three vertex values, in float64, before a value is stored; infinite if a face is seen
        exactly from its side.
    """
    bound = largest[0]
    for row in range(rows[0], rows[1]):
        for column in range(face_id.shape[1]):
            face = face_id[row, column]
            if face < 0:
                continue
            a, b, c = setup.get_face_vertices(geometry.faces, face)
            if (geometry.codes[a] | geometry.codes[b] | geometry.codes[c]) & setup.CLIPPED:
                bound = max(bound, bound_clipped_error(a, b, c, column, row, geometry))
            else:
                bound = max(bound, UNCLIPPED_ERROR)
    largest[0] = bound
