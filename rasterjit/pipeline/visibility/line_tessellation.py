"""
Tessellate wide segments into screen-space triangles ("pieces"): bodies, joins and caps.

A segment is clipped to the near and the far plane and to a band around the image, in float64; its
ends are snapped to the sub-pixel grid as vertices are. Its *body* is a quadrilateral whose corners
are each end plus and minus half the width along the line's normal, rounded outward to the grid:
bodies are never narrower than the width, so that a line of a pixel's width or more has no gap. All
corners have the depth of their end, so depth is that of the line, exactly, and constant across.

Where two joined segments hardly bend, they share corners on the bisector (a miter). Elsewhere a
round join, a *wedge*, fills the gap on the outer side. Ends that are joined to nothing, or to
another width, have round or butt caps. Round parts are fans whose corners lie on the circle, with a
flatness of `FLATNESS_PX` pixels at most; `THIN_FLATNESS_PX` for lines up to two pixels wide. Where a
round segment of no length and a pixel's width or more would miss all pixel centres, it becomes a
square of one pixel around its point.

Pieces of one segment touch along edges with common ends, so no sample is covered twice; those of
two joined segments overlap on the inner side of a bend.

Angles are halved by sums of unit vectors: all is made of +, -, *, / and square roots, which have
the same bits on every CPU.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.projection import (
    compute_stored_depth,
    get_half_extents,
    snap_vertex,
)
from rasterjit.pipeline.geometry.setup import INVALID, get_picture_size
from rasterjit.pipeline.records import ScreenVertices, Viewport
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float64, int32, int64, uint8

MAX_HALF_WIDTH_PX = 3840.0
"""Largest half of a width, pixels; wider lines, which only world widths can give, are cut to it."""

GUARD_MARGIN_PX = MAX_HALF_WIDTH_PX + 256.0
"""How far inside the guard band segments are clipped, pixels: their corners stay in it."""

FLATNESS_PX = 0.0625
"""Largest distance of a fan's side from its circle, pixels."""

THIN_FLATNESS_PX = 0.3
"""The same, of lines up to two pixels wide: a half circle takes one triangle."""

MAX_MITER_PX = 0.125
"""Joined segments share corners that lie at most this far along the line from the joint, pixels."""

MAX_HALVINGS = 9
"""How often a half circle is halved at most."""

SCRATCH_SHAPE = ((1 << MAX_HALVINGS) + 1, 2)
"""Shape of the scratch memory for a fan's unit vectors."""

HIDDEN, VISIBLE, START_CUT, END_CUT = 0, 1, 2, 4
"""States of a segment: clipped away; or visible, and which of its ends were clipped."""

FREE, SHARED, WEDGE, CAPPED = 0, 1, 2, 3
"""Kinds of ends: butt; mitered with its neighbour; round join on one side; round cap."""

HALF_A, HALF_B, DEPTH_A, DEPTH_B = 0, 1, 2, 3
"""Columns of a segment's data: half its width, sub-pixel units, and depth, at both ends."""


@helper
def line_distance(plane, x, y, z, w, band_x, band_y):
    """Return the signed distance of a clip position to a plane, >= 0 inside (unnormalized)."""
    if plane == 0:
        return w + z
    if plane == 1:
        return w - z
    if plane == 2:
        return band_x * w + x
    if plane == 3:
        return band_x * w - x
    if plane == 4:
        return band_y * w + y
    return band_y * w - y


@helper
def clip_range(a, b, clip, band_x, band_y):
    """Return the part of a segment inside all planes, in 0..1; first > last if there is none."""
    first, last = 0.0, 1.0
    ax, ay, az, aw = clip[a, 0], clip[a, 1], clip[a, 2], clip[a, 3]
    bx, by, bz, bw = clip[b, 0], clip[b, 1], clip[b, 2], clip[b, 3]
    for plane in range(6):
        here = line_distance(plane, ax, ay, az, aw, band_x, band_y)
        there = line_distance(plane, bx, by, bz, bw, band_x, band_y)
        if here < 0.0 and there < 0.0:
            return 1.0, 0.0
        if here < 0.0:
            first = max(first, here / (here - there))
        elif there < 0.0:
            last = min(last, here / (here - there))
    return first, last


@helper
def project_end(t, a, b, clip, band, depth_coefficients, extents, viewport):
    """Return the snapped position, depth and w of a point of a segment; w is 0 behind the eye."""
    x, y, z, w = clip[a, 0], clip[a, 1], clip[a, 2], clip[a, 3]
    if t == 1.0:
        x, y, z, w = clip[b, 0], clip[b, 1], clip[b, 2], clip[b, 3]
    elif t != 0.0:
        x, y = x + t * (clip[b, 0] - x), y + t * (clip[b, 1] - y)
        z, w = z + t * (clip[b, 2] - z), w + t * (clip[b, 3] - w)
    if not w > 0.0:
        return np.int32(0), np.int32(0), 0.0, 0.0
    z = min(max(z, -w), w)
    ndc_x = min(max(x / w, -band[0]), band[0])
    ndc_y = min(max(y / w, -band[1]), band[1])
    column, row = snap_vertex(ndc_x, ndc_y, extents, viewport)
    return column, row, compute_stored_depth(z, w, depth_coefficients), w


@helper
def extrapolate_depths(first, last, step, offset, is_perspective):
    """
    Return the depths at both ends of a segment, extrapolated by an offset along it.

    Extrapolation is linear and goes at most one segment length; in perspective, at most down to
    half the lower depth, so that depths stay above 0.
    """
    squared = step[0] * step[0] + step[1] * step[1]
    if squared == 0.0:
        return first, last
    t = min(max((offset[0] * step[0] + offset[1] * step[1]) / squared, -1.0), 1.0)
    rise, floor = t * (last - first), 0.5 * min(first, last)
    if is_perspective:
        return max(first + rise, floor), max(last + rise, floor)
    return first + rise, last + rise


@kernel
def project_segments(
    segments: (int64, int64), source: (int64, int32[:, ::1]), clip: float64[:, ::1],
    codes: uint8[:], sizes: (float64[::1], float64, int64), depth_place: (float64, float64),
    depth_coefficients: (float64, float64, float64), viewport: Viewport,
    placed: (int32[:, ::1], float64[:, ::1], uint8[::1], float64[:, ::1]),
):  # fmt: skip
    """
    Clip segments, and project them to the screen.

    Parameters
    ----------
    segments : (int, int)
        The first of the object's, and one past the last.
    source : (int, (F, 3) int32)
        The first face of the object, and all faces.
    clip : (V, 4) float64, clip space
    codes : (V,) uint8, outcodes
    sizes : (widths (1,) or (S,) float64, factor, is_world)
        What takes half of the widths to pixels, of world widths at w = 1.
    depth_place : (float, float)
        Where depths are taken from: how far to the right of each sample and below it, pixels.
    depth_coefficients : (float, float, float)
    viewport : Viewport
    placed : (ends (S, 4) int32, numbers (S, 4) float64, states (S,) uint8, parts (S or 0, 4))
        Writes where the ends lie, x, y, x, y, units of the grid; ``HALF_A`` .. ``DEPTH_B``;
        ``HIDDEN``, or ``VISIBLE`` with bits; and, unless that has no rows, which part of the
        segment is left, from 0 to 1, and the w of its ends.
    """
    first_face, faces = source
    widths, factor, is_world = sizes
    ends, numbers, states, parts = placed
    width, height = get_picture_size(viewport)
    band_x = viewport.guard_x - 2.0 * GUARD_MARGIN_PX / width
    band_y = viewport.guard_y - 2.0 * GUARD_MARGIN_PX / height
    extents = get_half_extents(clip, viewport)
    unit = np.float64(np.int64(1) << viewport.grid_bits)
    for n in range(segments[0], segments[1]):
        # Clip to the planes and the guard band.
        s, face = np.uintp(n), np.uintp(first_face + n)
        a, b = np.uintp(faces[face, 0]), np.uintp(faces[face, 1])
        states[s] = HIDDEN
        if (codes[a] | codes[b]) & INVALID:
            continue
        first, last = clip_range(a, b, clip, band_x, band_y)
        if first > last:
            continue
        # Its ends on the screen.
        x0, y0, d0, w0 = project_end(
            first, a, b, clip, (band_x, band_y), depth_coefficients, extents, viewport
        )
        x1, y1, d1, w1 = project_end(
            last, a, b, clip, (band_x, band_y), depth_coefficients, extents, viewport
        )
        if not (w0 > 0.0 and w1 > 0.0):
            continue
        ends[s, 0], ends[s, 1], ends[s, 2], ends[s, 3] = x0, y0, x1, y1
        # Half its width at each end.
        half = 0.5 * widths[s if widths.shape[0] > 1 else np.uintp(0)] * factor
        h0, h1 = half, half
        if is_world:
            h0, h1 = half / w0, half / w1
        numbers[s, HALF_A] = min(h0, MAX_HALF_WIDTH_PX) * unit
        numbers[s, HALF_B] = min(h1, MAX_HALF_WIDTH_PX) * unit
        # Depths, with the offset applied.
        if depth_place[0] != 0.0 or depth_place[1] != 0.0:
            step = np.float64(x1 - x0) / unit, np.float64(y1 - y0) / unit
            d0, d1 = extrapolate_depths(d0, d1, step, depth_place, depth_coefficients[0] > 0.0)
        numbers[s, DEPTH_A], numbers[s, DEPTH_B] = d0, d1
        # Which ends were clipped.
        state = VISIBLE
        if first > 0.0:
            state |= START_CUT
        if last < 1.0:
            state |= END_CUT
        states[s] = state
        if parts.shape[0] != 0:
            parts[s, 0], parts[s, 1], parts[s, 2], parts[s, 3] = first, last, w0, w1


@helper
def get_normal(ends, s):
    """Return the unit normal of a segment on the screen, to its right; zero if it has no length."""
    dx, dy = np.float64(ends[s, 2] - ends[s, 0]), np.float64(ends[s, 3] - ends[s, 1])
    length = np.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return 0.0, 0.0, 0.0
    return -dy / length, dx / length, length


@helper
def round_outward(offset):
    """Return an offset rounded away from zero to whole units, ignoring rounding errors."""
    size = np.ceil(abs(offset) - 1e-6)
    return np.int32(size) if offset >= 0.0 else np.int32(-size)


@helper
def classify_joint(s, other, at_end, links, placed, is_round, unit):
    """
    Return the kind of a segment's end, and the offset from the end to its corner, x and y.

    Parameters
    ----------
    s : int
        The segment.
    other : int
        What it is joined to there; -1 for nothing.
    at_end : bool
        Whether it is the end, else the start.
    """
    ends, numbers, states = placed[0], placed[1], placed[2]
    nx, ny, length = get_normal(ends, s)
    half = numbers[s, HALF_B if at_end else HALF_A]
    x, y = nx * half, ny * half
    cut, other_cut = (END_CUT, START_CUT) if at_end else (START_CUT, END_CUT)
    if states[s] & cut:
        return FREE, x, y
    free = CAPPED if is_round else FREE
    if other < 0:
        return free, x, y
    o = np.uintp(other)
    if not states[o] & VISIBLE or states[o] & other_cut:
        return free, x, y
    if numbers[o, HALF_A if at_end else HALF_B] != half:
        return CAPPED, x, y
    ox, oy, other_length = get_normal(ends, o)
    if length == 0.0 or other_length == 0.0:
        return CAPPED, x, y
    # In the same order for either segment.
    sx, sy = (nx + ox, ny + oy) if at_end else (ox + nx, oy + ny)
    bx, by = nx - ox, ny - oy
    sum_squared = sx * sx + sy * sy
    bend = half * np.sqrt(bx * bx + by * by)
    is_long = length >= 2.0 * MAX_MITER_PX * unit and other_length >= 2.0 * MAX_MITER_PX * unit
    if is_long and sum_squared > 3.0 and bend <= MAX_MITER_PX * unit * np.sqrt(sum_squared):
        stretch = 2.0 * half / sum_squared
        return SHARED, sx * stretch, sy * stretch
    return WEDGE, x, y


@helper
def bisect(ux, uy, vx, vy, around):
    """
    Return the unit vector in the middle of two.

    For opposite ones, a quarter turn from the first, in the direction ``around`` (1 or -1).
    """
    x, y = ux + vx, uy + vy
    length = np.sqrt(x * x + y * y)
    if length < 1e-6:
        return -around * uy, around * ux
    return x / length, y / length


@helper
def count_halvings(ux, uy, vx, vy, around, half, unit):
    """Return how often the angle of a fan between two unit vectors is halved."""
    flatness = (THIN_FLATNESS_PX if half <= unit else FLATNESS_PX) * unit
    halvings = 0
    while halvings < MAX_HALVINGS:
        x, y = ux + vx, uy + vy
        if half * (1.0 - 0.5 * np.sqrt(x * x + y * y)) <= flatness:
            return halvings
        vx, vy = bisect(ux, uy, vx, vy, around)
        halvings += 1
    return halvings


@helper
def count_cap_halvings(half, unit):
    """Return how often a half circle is halved: `count_halvings` of opposite vectors."""
    flatness = (THIN_FLATNESS_PX if half <= unit else FLATNESS_PX) * unit
    halvings, total = 0, 0.0
    while halvings < MAX_HALVINGS and half * (1.0 - 0.5 * total) > flatness:
        # The length of the sum of two unit vectors, of half the angle.
        total = np.sqrt(2.0 + total)
        halvings += 1
    return halvings


@helper
def fill_fan(ux, uy, vx, vy, around, halvings, fan):
    """Write the unit vectors of a fan, from the first to the last."""
    count = np.int64(1) << halvings
    fan[0, 0], fan[0, 1] = ux, uy
    fan[count, 0], fan[count, 1] = vx, vy
    step = count
    while step > 1:
        middle = step >> 1
        for n in range(middle, count, step):
            i, j = np.uintp(n - middle), np.uintp(n + middle)
            x, y = bisect(fan[i, 0], fan[i, 1], fan[j, 0], fan[j, 1], around)
            fan[np.uintp(n), 0], fan[np.uintp(n), 1] = x, y
        step = middle


@helper
def plan_wedge(s, o, placed, unit):
    """
    Return the fan of a round join: its first and last unit vector, direction, halvings.

    The joint is the end of the first segment.
    """
    ends, numbers = placed[0], placed[1]
    ux, uy, _ = get_normal(ends, s)
    vx, vy, _ = get_normal(ends, o)
    cross = ux * vy - uy * vx
    around = 1.0
    if cross > 0.0:
        ux, uy, vx, vy = -ux, -uy, -vx, -vy
    elif cross < 0.0:
        around = -1.0
    else:
        # A turn of 180 degrees: around the end of the first.
        around = -1.0
    half = numbers[s, HALF_B]
    return ux, uy, vx, vy, around, count_halvings(ux, uy, vx, vy, around, half, unit)


@helper
def plan_cap(s, at_end, placed, unit):
    """Return the fan of a round cap: its first and last unit vector, direction, halvings."""
    ends, numbers = placed[0], placed[1]
    x, y, length = get_normal(ends, s)
    if length == 0.0:
        x, y = 0.0, 1.0
    around = -1.0 if at_end else 1.0
    half = numbers[s, HALF_B if at_end else HALF_A]
    return x, y, -x, -y, around, count_cap_halvings(half, unit)


@helper
def reaches_picture(s, placed, viewport, unit):
    """Return whether the bounding box of a segment with its width overlaps the picture."""
    ends, numbers = placed[0], placed[1]
    reach = 1.25 * max(numbers[s, HALF_A], numbers[s, HALF_B]) + 2.0
    left, right = min(ends[s, 0], ends[s, 2]) - reach, max(ends[s, 0], ends[s, 2]) + reach
    top, bottom = min(ends[s, 1], ends[s, 3]) - reach, max(ends[s, 1], ends[s, 3]) + reach
    return (
        right >= 0.0 and bottom >= 0.0
        and left <= viewport.width * unit and top <= viewport.height * unit
    )  # fmt: skip


@helper
def get_dash(number, edges):
    """Return where dash ``number`` of a strip begins and ends."""
    each = (edges.shape[0] - 1) >> 1
    period = np.float64(number // each) * edges[edges.shape[0] - 1]
    n = np.uintp(2 * (number % each))
    return period + edges[n], period + edges[n + np.uintp(1)]


@helper
def find_first_dash(position, edges):
    """Return the first dash that ends beyond a position on a strip."""
    each = (edges.shape[0] - 1) >> 1
    number = each * np.int64(np.floor(position / edges[edges.shape[0] - 1]))
    while get_dash(number, edges)[1] <= position:
        number += 1
    return number


@helper
def is_dashed(s, placed, stretches, edges, unit):
    """Return whether a segment is dashed: the period of its dashes is at least a pixel."""
    if edges.shape[0] == 0:
        return False
    _, _, length = get_normal(placed[0], s)
    periods = (stretches[s, 1] - stretches[s, 0]) / edges[edges.shape[0] - 1]
    return periods * unit <= length


@helper
def count_dashes(s, stretches, edges):
    """Return how many dashes overlap a segment."""
    number, count = find_first_dash(stretches[s, 0], edges), np.int64(0)
    while get_dash(number, edges)[0] < stretches[s, 1]:
        number, count = number + 1, count + 1
    return count


@helper
def ends_on_dash(s, stretches, edges):
    """Return whether there is a dash where a segment ends."""
    return get_dash(find_first_dash(stretches[s, 1], edges), edges)[0] < stretches[s, 1]


@helper
def find_parameter(position, s, placed, stretches):
    """Return the parameter on a segment, 0..1 in screen space, of a position on its strip."""
    first, last, parts = stretches[s, 0], stretches[s, 1], placed[3]
    t = (position - first) / (last - first)
    if parts.shape[0] == 0:
        return t
    w0, w1 = parts[s, 2], parts[s, 3]
    return t * w1 / (w0 + t * (w1 - w0))


@helper
def has_body(s, ends):
    """Return whether a segment has a length on the screen."""
    return ends[s, 0] != ends[s, 2] or ends[s, 1] != ends[s, 3]


@helper
def next_has_body(other, placed):
    """Return whether a neighbour exists (not -1) and has a length on the screen."""
    if other < 0:
        return False
    o = np.uintp(other)
    return placed[2][o] & VISIBLE != 0 and has_body(o, placed[0])


@helper
def is_dot(s, start, stop, links, placed, unit):
    """
    Return whether a segment is drawn as the pixel that holds its point.

    So if it and its neighbours have no length, and its round ends, a pixel or more wide, cover
    no pixel centre.
    """
    ends, numbers = placed[0], placed[1]
    if has_body(s, ends) or start[0] != CAPPED or stop[0] != CAPPED:
        return False
    h0, h1 = numbers[s, HALF_A], numbers[s, HALF_B]
    if not 0.5 * unit <= max(h0, h1) <= unit:
        return False
    if next_has_body(np.int64(links[s, 0]), placed) or next_has_body(np.int64(links[s, 1]), placed):
        return False
    # So narrow, both ends together are |x| + |y| <= half, the start on the left.
    x, y = np.float64(ends[s, 0]), np.float64(ends[s, 1])
    to_x = (np.floor(x / unit) + 0.5) * unit - x
    to_y = (np.floor(y / unit) + 0.5) * unit - y
    return abs(to_x) + abs(to_y) >= (h0 if to_x < 0.0 else h1)


@helper
def classify_ends(s, links, placed, is_round, viewport, unit):
    """Return the kinds of a segment's start and end, and the offsets to their corners."""
    start = classify_joint(s, np.int64(links[s, 0]), False, links, placed, is_round, unit)
    stop = classify_joint(s, np.int64(links[s, 1]), True, links, placed, is_round, unit)
    return start, stop


@helper
def classify_dashed_ends(start, stop, s, dashes):
    """Return the kinds of a dashed segment's ends: never round, a wedge only on a dash."""
    first = FREE if start[0] == CAPPED else start[0]
    last = FREE if stop[0] == CAPPED else stop[0]
    if last == WEDGE and not ends_on_dash(s, dashes[0], dashes[1]):
        last = FREE
    return (first, start[1], start[2]), (last, stop[1], stop[2])


@kernel
def count_pieces(
    segments: (int64, int64), links: int32[:, ::1],
    placed: (int32[:, ::1], float64[:, ::1], uint8[::1], float64[:, ::1]), is_round: int64,
    viewport: Viewport, dashes: (float64[:, ::1], float64[::1]), counts: int32[:, ::1],
):  # fmt: skip
    """
    Count the vertices and the pieces of segments.

    Parameters
    ----------
    segments : (int, int)
    links : (S, 2) int32
        What each is joined to, before and behind; -1 for nothing.
    placed : tuple
        As `project_segments` wrote it.
    is_round : int
        Whether ends that are joined to nothing are round.
    viewport : Viewport
    dashes : (stretches (S, 2) float64, edges (D+1,) float64)
        Where on its strip what is left of each segment begins and ends; where dashes and gaps do,
        from 0 on. Of no rows, both, where lines are solid.
    counts : (S, 2) int32
        Writes vertices and pieces of each segment.
    """
    unit = np.float64(np.int64(1) << viewport.grid_bits)
    for n in range(segments[0], segments[1]):
        s = np.uintp(n)
        vertices, pieces = np.int64(0), np.int64(0)
        if placed[2][s] & VISIBLE and reaches_picture(s, placed, viewport, unit):
            start, stop = classify_ends(s, links, placed, is_round, viewport, unit)
            shows_dashes, quads = is_dashed(s, placed, dashes[0], dashes[1], unit), np.int64(0)
            if has_body(s, placed[0]):
                quads = count_dashes(s, dashes[0], dashes[1]) if shows_dashes else np.int64(1)
            vertices, pieces = 4 * quads, 2 * quads
            if shows_dashes:
                start, stop = classify_dashed_ends(start, stop, s, dashes)
            if is_dot(s, start, stop, links, placed, unit):
                counts[s, 0], counts[s, 1] = 4, 2
                continue
            if start[0] == CAPPED:
                sides = np.int64(1) << count_cap_halvings(placed[1][s, HALF_A], unit)
                vertices, pieces = vertices + sides + 1, pieces + sides - 1
            if stop[0] == CAPPED:
                sides = np.int64(1) << count_cap_halvings(placed[1][s, HALF_B], unit)
                vertices, pieces = vertices + sides + 1, pieces + sides - 1
            elif stop[0] == WEDGE:
                sides = np.int64(1) << plan_wedge(s, np.uintp(links[s, 1]), placed, unit)[5]
                vertices, pieces = vertices + sides + 2, pieces + sides
        counts[s, 0], counts[s, 1] = vertices, pieces


@helper
def write_vertex(vertex, x, y, depth, screen):
    """Write a vertex of a piece."""
    v = np.uintp(vertex)
    screen.xy[v, 0], screen.xy[v, 1] = np.int32(x), np.int32(y)
    screen.depth[v], screen.w[v], screen.codes[v] = depth, 1.0, 0


@helper
def write_piece(piece, a, b, c, face, pieces, piece_faces):
    """Write a piece."""
    p = np.uintp(piece)
    pieces[p, 0], pieces[p, 1], pieces[p, 2] = a, b, c
    piece_faces[p] = face


@helper
def write_fan(fan_of, x, y, half, depth, has_centre, vertex, piece, face, screen, out, fan):
    """Write a fan around a point, from its centre or first corner; return next vertex and piece."""
    pieces, piece_faces = out
    ux, uy, vx, vy, around, halvings = fan_of
    sides = np.int64(1) << halvings
    fill_fan(ux, uy, vx, vy, around, halvings, fan)
    first = vertex
    if has_centre:
        write_vertex(vertex, x, y, depth, screen)
        vertex += 1
    for n in range(sides + 1):
        i = np.uintp(n)
        write_vertex(
            vertex, x + round_outward(fan[i, 0] * half), y + round_outward(fan[i, 1] * half), depth,
            screen,
        )  # fmt: skip
        vertex += 1
    for corner in range(first + 1, vertex - 1):
        write_piece(piece, first, corner, corner + 1, face, pieces, piece_faces)
        piece += 1
    return vertex, piece


@helper
def get_body_end(s, at_end, joint, placed):
    """Return an end of a body: position, offset to its corner, depth."""
    ends, numbers = placed[0], placed[1]
    k, column = np.uintp(2 if at_end else 0), DEPTH_B if at_end else DEPTH_A
    return (
        ends[s, k], ends[s, k + np.uintp(1)], round_outward(joint[1]), round_outward(joint[2]),
        numbers[s, column],
    )  # fmt: skip


@helper
def get_body_cut(t, s, placed):
    """Return what `get_body_end` does for a point inside a segment, at 0..1 in screen space."""
    ends, numbers = placed[0], placed[1]
    nx, ny, _ = get_normal(ends, s)
    x = ends[s, 0] + t * np.float64(ends[s, 2] - ends[s, 0])
    y = ends[s, 1] + t * np.float64(ends[s, 3] - ends[s, 1])
    half = numbers[s, HALF_A] + t * (numbers[s, HALF_B] - numbers[s, HALF_A])
    depth = numbers[s, DEPTH_A] + t * (numbers[s, DEPTH_B] - numbers[s, DEPTH_A])
    return (
        np.int32(np.floor(x + 0.5)), np.int32(np.floor(y + 0.5)), round_outward(nx * half),
        round_outward(ny * half), depth,
    )  # fmt: skip


@helper
def write_body(vertex, piece, first, last, face, screen, out):
    """Write the quadrilateral between two ends of a body."""
    pieces, piece_faces = out
    write_vertex(vertex, first[0] + first[2], first[1] + first[3], first[4], screen)
    write_vertex(vertex + 1, first[0] - first[2], first[1] - first[3], first[4], screen)
    write_vertex(vertex + 2, last[0] - last[2], last[1] - last[3], last[4], screen)
    write_vertex(vertex + 3, last[0] + last[2], last[1] + last[3], last[4], screen)
    write_piece(piece, vertex, vertex + 1, vertex + 2, face, pieces, piece_faces)
    write_piece(piece + 1, vertex, vertex + 2, vertex + 3, face, pieces, piece_faces)


@kernel
def write_pieces(
    segments: (int64, int64), links: int32[:, ::1],
    placed: (int32[:, ::1], float64[:, ::1], uint8[::1], float64[:, ::1]), is_round: int64,
    viewport: Viewport, dashes: (float64[:, ::1], float64[::1]),
    starts: (int64, int64, int64[:, ::1]), screen: ScreenVertices,
    out: (int32[:, ::1], int32[::1]), fan: float64[:, ::1],
):  # fmt: skip
    """
    Write the vertices and the pieces of segments.

    Parameters
    ----------
    segments, links, placed, is_round, viewport, dashes
        As `count_pieces` takes them.
    starts : (int, int, (S+1, 2) int64)
        The first vertex and the first face of the object; running sums of the counts.
    screen : ScreenVertices
        Writes the vertices.
    out : (pieces (P, 3) int32, piece_faces (P,) int32)
        Written.
    fan : (513, 2) float64
        This thread's own scratch memory, ``SCRATCH_SHAPE``.
    """
    first_vertex, first_face, sums = starts
    ends, numbers = placed[0], placed[1]
    unit = np.float64(np.int64(1) << viewport.grid_bits)
    for n in range(segments[0], segments[1]):
        # Segments that have pieces.
        s = np.uintp(n)
        vertex, piece = first_vertex + sums[s, 0], sums[s, 1]
        if sums[s + np.uintp(1), 0] == sums[s, 0]:
            continue
        face = np.int32(first_face + n)
        start, stop = classify_ends(s, links, placed, is_round, viewport, unit)
        x0, y0, x1, y1 = ends[s, 0], ends[s, 1], ends[s, 2], ends[s, 3]
        h0, h1 = numbers[s, HALF_A], numbers[s, HALF_B]
        d0, d1 = numbers[s, DEPTH_A], numbers[s, DEPTH_B]
        # Bodies: one for each dash, or a single one.
        shows_dashes = is_dashed(s, placed, dashes[0], dashes[1], unit)
        if shows_dashes and has_body(s, ends):
            number = find_first_dash(dashes[0][s, 0], dashes[1])
            while True:
                begin, end = get_dash(number, dashes[1])
                if begin >= dashes[0][s, 1]:
                    break
                if begin > dashes[0][s, 0]:
                    first = get_body_cut(find_parameter(begin, s, placed, dashes[0]), s, placed)
                else:
                    first = get_body_end(s, False, start, placed)
                if end < dashes[0][s, 1]:
                    last = get_body_cut(find_parameter(end, s, placed, dashes[0]), s, placed)
                else:
                    last = get_body_end(s, True, stop, placed)
                write_body(vertex, piece, first, last, face, screen, out)
                vertex, piece, number = vertex + 4, piece + 2, number + 1
        elif has_body(s, ends):
            first, last = get_body_end(s, False, start, placed), get_body_end(s, True, stop, placed)
            write_body(vertex, piece, first, last, face, screen, out)
            vertex, piece = vertex + 4, piece + 2
        if shows_dashes:
            start, stop = classify_dashed_ends(start, stop, s, dashes)
        # Segments without length: squares.
        if is_dot(s, start, stop, links, placed, unit):
            side = np.int32(0.5 * unit)
            first, last = (x0, y0 - side, -side, 0, d0), (x0, y0 + side, -side, 0, d1)
            write_body(vertex, piece, first, last, face, screen, out)
            continue
        # Caps, and wedges between segments.
        if start[0] == CAPPED:
            vertex, piece = write_fan(
                plan_cap(s, False, placed, unit), x0, y0, h0, d0, False, vertex, piece, face,
                screen, out, fan,
            )  # fmt: skip
        if stop[0] == CAPPED:
            vertex, piece = write_fan(
                plan_cap(s, True, placed, unit), x1, y1, h1, d1, False, vertex, piece, face, screen,
                out, fan,
            )  # fmt: skip
        elif stop[0] == WEDGE:
            vertex, piece = write_fan(
                plan_wedge(s, np.uintp(links[s, 1]), placed, unit), x1, y1, h1, d1, True, vertex,
                piece, face, screen, out, fan,
            )  # fmt: skip
