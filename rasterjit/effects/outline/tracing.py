"""
Trace the edges of shapes between pixels, and cover them with smooth lines.

Between the centres of two pixels that an edge parts (``stage.find_edge``), it crosses at a place
that the faces themselves tell. Where a surface ends before a farther one, the surface is walked
over from the nearer pixel, face by face, up to the edge at which it folds back or ends. Where two
surfaces meet, it is where their planes do. What has no faces to walk over (points, lines, holes of
a mask) is crossed halfway.

Each square of four centres joins the places on its sides by straight pieces, as marching squares
do: two by one piece, others at a common point. So the pieces are lines without gaps, and lie on a
straight edge exactly.

References
----------
.. [1] W. Lorensen and H. Cline, "Marching Cubes", SIGGRAPH 1987: in two dimensions.
"""

from __future__ import annotations

import numpy as np

from rasterjit.effects.outline.stage import (
    CREASE,
    SLOPE_X,
    SLOPE_Y,
    compute_cosine,
    fill_scratch_row,
    find_edge,
    is_crease,
    is_jump,
)
from rasterjit.effects.wireframe.strokes import REACH_PX, approach_piece, cover_rows, start_rows
from rasterjit.pipeline.geometry.barycentric import compute_face_normal
from rasterjit.pipeline.geometry.setup import (
    CLIPPED,
    INVALID,
    get_face_vertices,
    get_picture_size,
)
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64

MEETING, NEARER, FARTHER = 1, 2, 3
"""How a pixel and the next lie at an edge: as near as each other, or the first nearer or not."""

MIN_SHARE, HALF_WAY = 2.0**-10, 0.5
"""Least distance of a crossing from a pixel's centre, and where it is if nothing tells, pixels."""

MAX_PLACE = 1.0 + 1.0 / 16.0
"""
Farthest place of a surface's end: beyond the next pixel's centre by no more than rounding.

A surface that goes on farther would be seen there; holes of a mask may be in it.
"""

UNKNOWN, ONE_SURFACE = -1.0, -2.0
"""In place of where a surface ends between two pixels: nothing tells, or it does not."""

CREASED = -3.0
"""Less the place of a crease on the way, in place of where a surface ends."""

NO_CREASES = np.float32(-2.0)
"""Cosine that no angle is below."""

MAX_STEPS = 256
"""Most faces that are walked over between two pixels."""

MIN_EXTENDED_PX = 0.25
"""Least length of a piece that is extended where a line leaves the picture."""

MAX_EXTENSION = 8.0
"""Farthest, in margins beyond the picture, that a piece is extended in x or y."""


# --- where a surface ends -------------------------------------------------------------------------


@helper
def find_place(vertex, geometry):
    """
    Return where a vertex lies on the screen, x and y times w, pixels, and w.

    A w of NaN: it lies nowhere.
    """
    viewport, code = geometry.viewport, geometry.codes[vertex]
    if code & INVALID:
        return 0.0, 0.0, np.nan
    if code & CLIPPED:
        width, height = get_picture_size(viewport)
        w = geometry.clip_positions[vertex, 3]
        x = (geometry.clip_positions[vertex, 0] + w) * (0.5 * width) - viewport.left * w
        y = (w - geometry.clip_positions[vertex, 1]) * (0.5 * height) - viewport.top * w
        return x, y, w
    per_pixel = 1.0 / np.float64(np.int64(1) << viewport.grid_bits)
    x, y = np.float64(geometry.xy[vertex, 0]), np.float64(geometry.xy[vertex, 1])
    return x * per_pixel, y * per_pixel, 1.0


@helper
def locate(vertex, origin, axis, sign, geometry):
    """
    Return where a vertex lies from a pixel's centre: toward a neighbour, aside, and w.

    Both distances, in pixels, are multiplied by w. A w of NaN: it lies nowhere.
    """
    column, row = origin
    x, y, w = find_place(vertex, geometry)
    x, y = x - (np.float64(column) + 0.5) * w, y - (np.float64(row) + 0.5) * w
    return (sign * x, y, w) if axis == 0 else (sign * y, x, w)


@helper
def cross_line(p, q):
    """Return where the line between two places crosses the way to a neighbour, or infinity."""
    w = p[2] * q[1] - q[2] * p[1]
    place = p[0] * q[1] - q[0] * p[1]
    # Both have the sign of the difference of the distances aside.
    difference = q[1] - p[1]
    if not w * difference > 0.0:
        return np.inf
    return place / w


@helper
def leave_face(places):
    """Return by which side a way leaves the face that it starts in, and where; side -1: by none."""
    side, farthest = -1, -np.inf
    for k in range(3):
        p, q = places[k], places[(k + 1) % 3]
        if (p[1] >= 0.0) != (q[1] >= 0.0):
            crossing = cross_line(p, q)
            if crossing > farthest:
                side, farthest = k, crossing
    return side, farthest


@helper
def turns(face, other, creases, faces):
    """Return whether two faces have normals whose cosine is below that of creases."""
    owner, min_cosine, placement = creases
    x, y, z = compute_face_normal(*get_face_vertices(faces, face), owner, placement)
    u, v, w = compute_face_normal(*get_face_vertices(faces, other), owner, placement)
    is_known = (x * x + y * y + z * z > 0.0) & (u * u + v * v + w * w > 0.0)
    return is_known & (x * u + y * v + z * w < min_cosine)


@helper
def find_end(face, target, origin, axis, sign, geometry, twins, creases):
    """
    Return how far from a pixel's centre, 0..1, its surface ends toward a neighbour.

    `UNKNOWN` if nothing tells; `ONE_SURFACE` if it goes on to the face that the neighbour shows;
    `CREASED` less the place if a crease comes first. ``creases`` are the object, the cosine of
    normals below which two faces meet at a crease (`NO_CREASES`: none do), and the placement.

    The surface is cut by the plane through the eye along the row or the column: a chain of points
    that goes on until it turns back, or has no other face.
    """
    faces = geometry.faces
    a = locate(faces[face, 0], origin, axis, sign, geometry)
    b = locate(faces[face, 1], origin, axis, sign, geometry)
    c = locate(faces[face, 2], origin, axis, sign, geometry)
    if not (a[2] == a[2] and b[2] == b[2] and c[2] == c[2]):
        return UNKNOWN
    side, crossing = leave_face((a, b, c))
    if side < 0:
        return UNKNOWN
    for _ in range(MAX_STEPS):
        if face == target:
            return ONE_SURFACE
        if not crossing < MAX_PLACE:
            return UNKNOWN
        twin = np.int64(twins[face, side])
        if twin < 0:
            return min(max(crossing, 0.0), 1.0)
        if creases[1] > NO_CREASES and turns(face, twin // 3, creases, faces):
            return CREASED - min(max(crossing, 0.0), 1.0)
        face, side = twin // 3, twin % 3
        first = locate(faces[face, side], origin, axis, sign, geometry)
        second = locate(faces[face, (side + 1) % 3], origin, axis, sign, geometry)
        third = locate(faces[face, (side + 2) % 3], origin, axis, sign, geometry)
        if third[2] != third[2]:
            return UNKNOWN
        if (third[1] >= 0.0) == (second[1] >= 0.0):
            side, following = (side + 2) % 3, cross_line(third, first)
        else:
            side, following = (side + 1) % 3, cross_line(second, third)
        if following < crossing:
            return min(max(crossing, 0.0), 1.0)
        crossing = following
    return UNKNOWN


# --- where an edge crosses ------------------------------------------------------------------------


@helper
def meet_planes(depth, other_depth, slope, other_slope):
    """Return where the planes of two faces meet between two pixels, 0..1, or halfway."""
    bend = np.float64(slope) - np.float64(other_slope)
    rise = np.float64(other_depth) - np.float64(depth) - np.float64(other_slope)
    place = rise / bend if bend != 0.0 else np.nan
    return min(max(place, 0.0), 1.0) if place == place else HALF_WAY


@helper
def encode_crossing(place, kind):
    """Return a crossing as one number: twice its kind, plus its place in 0..1, not 0."""
    return np.float32(2.0 * kind + min(max(place, MIN_SHARE), 1.0))


@helper
def find_end_between(side, face, other, origin, axis, geometry, twins, creases):
    """Return `find_end` from the first of two pixels if ``side`` is below 0, else the second."""
    if side < 0:
        return find_end(face, other, origin, axis, 1.0, geometry, twins, creases)
    column, row = origin
    there = (column + 1, row) if axis == 0 else (column, row + 1)
    place = find_end(other, face, there, axis, -1.0, geometry, twins, creases)
    return 1.0 - place if place >= 0.0 else place


@helper
def cross_meeting(face, other, is_crease, planes, origin, axis, geometry, twins, creases):
    """Return the crossing where two surfaces meet: where one ends there, or their planes cross."""
    depth, other_depth, slope, other_slope = planes
    if not is_crease:
        for side in (-1, 1):
            place = find_end_between(side, face, other, origin, axis, geometry, twins, creases)
            if place >= 0.0:
                return encode_crossing(place, MEETING)
    return encode_crossing(meet_planes(depth, other_depth, slope, other_slope), MEETING)


@helper
def find_crossing(
    m, n, slope_row, origin, axis, face, other, depth, other_depth, s, t, owner, other_owner, kinds,
    min_cosine, geometry, placement, twins,
):  # fmt: skip
    """Return where an edge crosses between a pixel's centre and the next one's; 0: nowhere."""
    positions = placement.positions
    side = find_edge(
        m, n, slope_row, face, other, depth, other_depth, s, t, owner, other_owner, kinds,
        min_cosine, geometry, positions,
    )  # fmt: skip
    difference = other_depth - depth
    is_seen = owner >= 0 and other_owner >= 0
    is_meeting = is_seen and not is_jump(difference, s, t, m, n, slope_row)
    if side == 0:
        # Fine faces may lie between two that have no corner in common.
        if not (kinds & CREASE and is_meeting and owner == other_owner):
            return np.float32(0.0)
        if not compute_cosine(s, t, m, n) < min_cosine:
            return np.float32(0.0)
        creases = np.int64(owner), min_cosine, placement
        place = find_end_between(-1, face, other, origin, axis, geometry, twins, creases)
        return encode_crossing(CREASED - place, MEETING) if place <= CREASED else np.float32(0.0)
    creases = np.int64(owner), NO_CREASES, placement
    planes = depth, other_depth, s[slope_row, m], t[slope_row, n]
    if is_meeting:
        return cross_meeting(
            face, other, owner == other_owner, planes, origin, axis, geometry, twins, creases
        )
    place = find_end_between(side, face, other, origin, axis, geometry, twins, creases)
    if place == ONE_SURFACE:
        # Faces that are as good as edge-on: the depths differ, and yet nothing ends.
        cosine = compute_cosine(s, t, m, n)
        if kinds & CREASE and is_crease(
            difference, s[slope_row, m], face, other, cosine, min_cosine, geometry, positions
        ):
            return cross_meeting(face, other, True, planes, origin, axis, geometry, twins, creases)
        return np.float32(0.0)
    kind = NEARER if side < 0 else FARTHER
    return encode_crossing(place if place >= 0.0 else HALF_WAY, kind)


@kernel
def find_crossings(
    face_id: int32[:, ::1], rows: (int64, int64), depth: float32[:, ::1],
    vertex_depths: float64[:], geometry: Geometry, placement: Placement, matrix: float32[:, ::1],
    snap_slack: float64, kinds: int64, min_cosine: float64, twins: int32[:, ::1],
    crossings: float32[:, :, ::1], scratch: (float32[:, :, ::1], int32[:, ::1]),
):  # fmt: skip
    """
    Find where edges cross between the centres of pixels.

    Parameters
    ----------
    face_id, rows, depth, vertex_depths, geometry, placement, matrix, snap_slack, kinds, min_cosine
        As ``stage.find_edges`` takes them; edges to the row behind are found as well.
    twins : (F, 3) int32
        As `scene.edge_twins.find_twins` returns them.
    crossings : (2, H, W) float32
        Writes these rows: between each pixel and the next one in its row, and in its column. 0
        where no edge is, else twice the kind, plus the distance from the pixel in 0..1, not 0.
    scratch : tuple
        This thread's own, from ``stage.make_scratch``.
    """
    height, width = face_id.shape
    scratch_rows, owners = scratch
    v = placement.toward_viewer
    viewer = np.float32(v[0]), np.float32(v[1]), np.float32(v[2]), np.float32(v[3])
    slack, float32_cosine = np.float32(snap_slack), np.float32(min_cosine)
    for row in range(rows[0], min(rows[1] + 1, height)):
        this, other = row & 1, 1 - (row & 1)
        s, t = scratch_rows[this], scratch_rows[other]
        row_owners, previous_owners = owners[this], owners[other]
        fill_scratch_row(
            face_id[row], depth[row], row, matrix, viewer, slack, vertex_depths, geometry,
            placement, s, row_owners,
        )  # fmt: skip
        if row > rows[0]:
            above = row - 1
            for i in range(np.uintp(width)):
                crossings[1, above, i] = np.float32(0.0)
                if face_id[above, i] != face_id[row, i]:
                    crossings[1, above, i] = find_crossing(
                        i, i, SLOPE_Y, (np.int64(i), above), 1, np.int64(face_id[above, i]),
                        np.int64(face_id[row, i]), depth[above, i], depth[row, i], t, s,
                        previous_owners[i], row_owners[i], kinds, float32_cosine, geometry,
                        placement, twins,
                    )  # fmt: skip
        if row < rows[1]:
            for i in range(np.uintp(width)):
                j = i + np.uintp(1)
                crossings[0, row, i] = np.float32(0.0)
                if j < width and face_id[row, i] != face_id[row, j]:
                    crossings[0, row, i] = find_crossing(
                        i, j, SLOPE_X, (np.int64(i), row), 0, np.int64(face_id[row, i]),
                        np.int64(face_id[row, j]), depth[row, i], depth[row, j], s, s,
                        row_owners[i], row_owners[j], kinds, float32_cosine, geometry,
                        placement, twins,
                    )  # fmt: skip
    if rows[1] >= height:
        for i in range(np.uintp(width)):
            crossings[1, height - 1, i] = np.float32(0.0)


# --- lines ----------------------------------------------------------------------------------------


@helper
def decode_crossing(value):
    """Return the kind of a crossing, 0 for none, and its place."""
    kind = np.int64(value * np.float32(0.5))
    place = np.float64(value) - 2.0 * kind
    # A place of exactly 1 leaves the kind as it is: 2 kind + 1 halved is rounded down.
    return kind, place


@helper
def read_square(crossings, row, column):
    """Return kinds and points, in pixels, on the top, right, bottom and left side of a square."""
    x, y = np.float64(column) + 0.5, np.float64(row) + 0.5
    top, top_place = decode_crossing(crossings[0, row, column])
    right, right_place = decode_crossing(crossings[1, row, column + 1])
    bottom, bottom_place = decode_crossing(crossings[0, row + 1, column])
    left, left_place = decode_crossing(crossings[1, row, column])
    kinds = top, right, bottom, left
    points = (
        (x + top_place, y), (x + 1.0, y + right_place), (x + bottom_place, y + 1.0),
        (x, y + left_place),
    )  # fmt: skip
    return kinds, points


@helper
def leave_picture(start, end, is_leaving, side, margin):
    """Return the end of a piece, moved on by a margin beyond the side where it leaves."""
    if not is_leaving:
        return end
    x, y = end[0] - start[0], end[1] - start[1]
    outward = abs(x) if side & 1 else abs(y)
    is_clear = x * x + y * y >= MIN_EXTENDED_PX * MIN_EXTENDED_PX and outward > 0.0
    far = min(1.0 / outward, MAX_EXTENSION / max(abs(x), abs(y))) * margin if is_clear else 0.0
    return end[0] + far * x, end[1] + far * y


@helper
def nearest_on(start, end, point):
    """Return the point of a piece that is nearest to another."""
    x, y = end[0] - start[0], end[1] - start[1]
    squared = x * x + y * y
    share = (point[0] - start[0]) * x + (point[1] - start[1]) * y
    share = min(max(share / squared, 0.0), 1.0) if squared > 0.0 else 0.0
    return start[0] + share * x, start[1] + share * y


@helper
def is_first_corner_nearer(kinds, side):
    """Return whether the corner where a side begins, clockwise, is nearer than where it ends."""
    # The kinds of the bottom and the left side run against the clock.
    return kinds[side] == (NEARER if side < 2 else FARTHER)


@helper
def is_last_corner_nearer(kinds, side):
    """Return whether the corner where a side ends, clockwise, is nearer than where it begins."""
    return kinds[side] == (FARTHER if side < 2 else NEARER)


@helper
def join_three(kinds, points, open_side, first_row, reach, nearest):
    """
    Join three crossings of a square.

    Where one surface is before both others, its edge runs through and the third ends at it; else
    all meet at their mean.
    """
    first, middle, last = (open_side + 1) % 4, (open_side + 2) % 4, (open_side + 3) % 4
    a, b, c = points[first], points[middle], points[last]
    if is_first_corner_nearer(kinds, first) and is_last_corner_nearer(kinds, last):
        approach_piece((a[0], a[1], c[0], c[1]), first_row, reach, nearest)
        joint, end = nearest_on(a, c, b), b
    elif is_last_corner_nearer(kinds, first) and is_first_corner_nearer(kinds, middle):
        approach_piece((a[0], a[1], b[0], b[1]), first_row, reach, nearest)
        joint, end = nearest_on(a, b, c), c
    elif is_last_corner_nearer(kinds, middle) and is_first_corner_nearer(kinds, last):
        approach_piece((b[0], b[1], c[0], c[1]), first_row, reach, nearest)
        joint, end = nearest_on(b, c, a), a
    else:
        joint, end = ((a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0), b
        approach_piece((a[0], a[1], joint[0], joint[1]), first_row, reach, nearest)
        approach_piece((c[0], c[1], joint[0], joint[1]), first_row, reach, nearest)
    approach_piece((end[0], end[1], joint[0], joint[1]), first_row, reach, nearest)


@helper
def join_two(kinds, points, border, margin, first_row, reach, nearest):
    """Join two crossings of a square, and go on where the line leaves the picture."""
    first = 0 if kinds[0] else (1 if kinds[1] else 2)
    last = 3 if kinds[3] else (2 if kinds[2] else 1)
    a, b = points[first], points[last]
    start = leave_picture(b, a, border[first], first, margin)
    end = leave_picture(a, b, border[last], last, margin)
    approach_piece((start[0], start[1], end[0], end[1]), first_row, reach, nearest)


@helper
def count_crossings(crossings, row, column):
    """Return how many sides of a square have a crossing; 2 outside of the picture."""
    is_inside = 0 <= row < crossings.shape[1] - 1 and 0 <= column < crossings.shape[2] - 1
    if not is_inside:
        return np.int64(2)
    none = np.float32(0.0)
    return (
        np.int64(crossings[0, row, column] > none) + np.int64(crossings[1, row, column] > none)
        + np.int64(crossings[0, row + 1, column] > none)
        + np.int64(crossings[1, row, column + 1] > none)
    )  # fmt: skip


@helper
def drop_stubs(kinds, crossings, row, column):
    """Return the kinds of crossings, 0 for those of a meeting that goes no further than a pixel."""
    top, right, bottom, left = kinds
    if top == MEETING and count_crossings(crossings, row - 1, column) == 1:
        top = np.int64(0)
    if right == MEETING and count_crossings(crossings, row, column + 1) == 1:
        right = np.int64(0)
    if bottom == MEETING and count_crossings(crossings, row + 1, column) == 1:
        bottom = np.int64(0)
    if left == MEETING and count_crossings(crossings, row, column - 1) == 1:
        left = np.int64(0)
    return top, right, bottom, left


@helper
def join_square(crossings, row, column, margin, first_row, reach, nearest):
    """Draw the pieces between the crossings of the square below and right of a pixel."""
    count = count_crossings(crossings, row, column)
    if count < 2:
        # A line ends here, or is none.
        return
    kinds, points = read_square(crossings, row, column)
    if count > 2:
        kinds = drop_stubs(kinds, crossings, row, column)
        count = (
            np.int64(kinds[0] > 0) + np.int64(kinds[1] > 0) + np.int64(kinds[2] > 0)
            + np.int64(kinds[3] > 0)
        )  # fmt: skip
    if count == 2:
        height, width = crossings.shape[1], crossings.shape[2]
        border = row == 0, column == width - 2, row == height - 2, column == 0
        join_two(kinds, points, border, margin, first_row, reach, nearest)
    elif count == 3:
        open_side = 0
        for side in range(4):
            open_side = side if kinds[side] == 0 else open_side
        join_three(kinds, points, open_side, first_row, reach, nearest)
    elif count == 4:
        x = 0.25 * (points[0][0] + points[1][0] + points[2][0] + points[3][0])
        y = 0.25 * (points[0][1] + points[1][1] + points[2][1] + points[3][1])
        for side in range(4):
            p = points[side]
            approach_piece((p[0], p[1], x, y), first_row, reach, nearest)


@kernel
def cover_crossings(
    crossings: float32[:, :, ::1], rows: (int64, int64), half_width: float64,
    nearest: float32[:, :, ::1], area: float32[:, ::1],
):  # fmt: skip
    """
    Find the coverage of each pixel of some rows by lines along the edges.

    Parameters
    ----------
    crossings : (2, H, W) float32
        From `find_crossings`.
    rows : (int, int)
        The first, and one past the last.
    half_width : float
        Half the width of the lines, pixels.
    nearest : (R, 3, W) float32
        Scratch, from ``strokes.make_scratch``.
    area : (R, W) float32
        Written: the share of each pixel, 0..1.
    """
    height, width = crossings.shape[1], crossings.shape[2]
    reach = half_width + REACH_PX
    margin = half_width + 1.0
    beside, around = np.int64(reach) + 2, np.int64(reach + MAX_EXTENSION * margin) + 2
    start_rows(nearest)
    for row in range(max(rows[0] - around, 0), min(rows[1] + around, height - 1)):
        # From farther away, only what leaves the picture at the left or right reaches here.
        is_near = rows[0] - beside <= row < rows[1] + beside
        for i in range(0, width - 1, 1 if is_near else max(width - 2, 1)):
            join_square(crossings, row, i, margin, rows[0], reach, nearest)
    cover_rows(nearest, half_width, area)
