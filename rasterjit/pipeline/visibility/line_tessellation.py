"""
Tessellate wide segments into screen-space triangles ("pieces"): bodies, joins and caps.

A segment is clipped to the near and the far plane and to a band around the image, in float64; its
ends are snapped to the sub-pixel grid as vertices are. Its *body* is a quadrilateral whose corners
are each end plus and minus half the width along the line's normal, rounded outward to the grid:
bodies are never narrower than the width, so that a line of a pixel's width or more has no gap. All
corners have the depth of their end, so depth is that of the line, exactly, and constant across.

Where two joined segments hardly bend, they share corners on the bisector (a miter). Elsewhere a
round join, a *wedge*, fills the gap on the outer side. Ends that are joined to nothing, or to
another width, have round or butt caps. Round parts are fans whose corners lie on the circle, within
`FLATNESS_PX` of it; within `THIN_FLATNESS_PX` for lines up to two pixels wide. Where a round
segment of no length and a pixel's width or more would miss all pixel centres, it becomes a square
of one pixel around its point.

Pieces of one segment touch along edges with common ends, so no sample is covered twice; those of
two joined segments overlap on the inner side of a bend.

Angles are halved by sums of unit vectors: all is made of +, -, *, / and square roots, which have
the same bits on every CPU.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.clipping import PLANE_COUNT, plane_distance
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
"""Largest half width, pixels; wider lines, which only world widths give, are clamped."""

GUARD_MARGIN_PX = MAX_HALF_WIDTH_PX + 256.0
"""Distance inside the guard band at which segments are clipped: their corners stay in the band."""

FLATNESS_PX = 0.0625
"""Largest distance of a fan's side from its circle, pixels."""

THIN_FLATNESS_PX = 0.3
"""The same for lines up to two pixels wide: a half circle takes one triangle."""

MAX_MITER_PX = 0.125
"""Greatest distance, along the line, from a joint to corners that joined segments share."""

MAX_HALVINGS = 9
"""Most times that a half circle is halved."""

SCRATCH_SHAPE = ((1 << MAX_HALVINGS) + 1, 2)
"""Shape of the scratch memory for a fan's unit vectors."""

HIDDEN, VISIBLE, START_CUT, END_CUT = 0, 1, 2, 4
"""States of a segment: clipped away; or visible, and which of its ends were clipped."""

FREE, SHARED, WEDGE, CAPPED = 0, 1, 2, 3
"""Kinds of ends: butt; mitered with its neighbour; round join on one side; round cap."""

HALF_A, HALF_B, DEPTH_A, DEPTH_B = 0, 1, 2, 3
"""Columns of a segment's data: half its width, sub-pixel units, and depth, at both ends."""


@helper
def clip_range(a, b, clip, band_x, band_y):
    """Return the range of a segment inside all planes, in 0..1; first > last if empty."""
    first, last = 0.0, 1.0
    for plane in range(PLANE_COUNT):
        distance_a = plane_distance(plane, clip[a], band_x, band_y)
        distance_b = plane_distance(plane, clip[b], band_x, band_y)
        if distance_a < 0.0 and distance_b < 0.0:
            return 1.0, 0.0
        if distance_a < 0.0:
            first = max(first, distance_a / (distance_a - distance_b))
        elif distance_b < 0.0:
            last = min(last, distance_a / (distance_a - distance_b))
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
    codes: uint8[:], sizes: (float64[::1], float64, int64), depth_offset: (float64, float64),
    depth_coefficients: (float64, float64, float64), viewport: Viewport,
    screen_segments: (int32[:, ::1], float64[:, ::1], uint8[::1], float64[:, ::1]),
):  # fmt: skip
    """
    Clip segments, and project them to the screen.

    Parameters
    ----------
    segments : (int, int)
        The object's first segment, and one past the last.
    source : (int, (F, 3) int32)
        The first face of the object, and all faces.
    clip : (V, 4) float64, clip space
    codes : (V,) uint8, outcodes
    sizes : (widths (1,) or (S,) float64, factor, is_world)
        The factor from widths to pixels; for world widths, at w = 1.
    depth_offset : (float, float)
        Offset right and down from each sample to where its depth is evaluated, pixels.
    depth_coefficients : (float, float, float)
    viewport : Viewport
    screen_segments : (ends (S, 4) int32, measures (S, 4), states (S,) uint8, ranges (S or 0, 4))
        Writes the ends, x, y, x, y, sub-pixel units; columns ``HALF_A`` to ``DEPTH_B``; ``HIDDEN``,
        or ``VISIBLE`` with bits; and, unless it has no rows, the range of the segment that is left,
        in 0..1, and the w of its ends.
    """
    first_face, faces = source
    widths, factor, is_world = sizes
    ends, measures, states, ranges = screen_segments
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
        # Project its ends to the screen.
        x0, y0, d0, w0 = project_end(
            first, a, b, clip, (band_x, band_y), depth_coefficients, extents, viewport
        )
        x1, y1, d1, w1 = project_end(
            last, a, b, clip, (band_x, band_y), depth_coefficients, extents, viewport
        )
        if not (w0 > 0.0 and w1 > 0.0):
            continue
        ends[s, 0], ends[s, 1], ends[s, 2], ends[s, 3] = x0, y0, x1, y1
        # Compute half the width at each end.
        half = 0.5 * widths[s if widths.shape[0] > 1 else np.uintp(0)] * factor
        h0, h1 = half, half
        if is_world:
            h0, h1 = half / w0, half / w1
        measures[s, HALF_A] = min(h0, MAX_HALF_WIDTH_PX) * unit
        measures[s, HALF_B] = min(h1, MAX_HALF_WIDTH_PX) * unit
        # Apply the depth offset.
        if depth_offset[0] != 0.0 or depth_offset[1] != 0.0:
            step = np.float64(x1 - x0) / unit, np.float64(y1 - y0) / unit
            d0, d1 = extrapolate_depths(d0, d1, step, depth_offset, depth_coefficients[0] > 0.0)
        measures[s, DEPTH_A], measures[s, DEPTH_B] = d0, d1
        # Mark ends that were clipped.
        state = VISIBLE
        if first > 0.0:
            state |= START_CUT
        if last < 1.0:
            state |= END_CUT
        states[s] = state
        if ranges.shape[0] != 0:
            ranges[s, 0], ranges[s, 1], ranges[s, 2], ranges[s, 3] = (first, last, w0, w1)


@helper
def get_normal(ends, s):
    """Return a segment's unit normal on the screen, to its right, and its length; zeros if 0."""
    dx, dy = np.float64(ends[s, 2] - ends[s, 0]), np.float64(ends[s, 3] - ends[s, 1])
    length = np.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return 0.0, 0.0, 0.0
    return -dy / length, dx / length, length


@helper
def round_outward(offset):
    """Round an offset away from zero to whole units, ignoring rounding errors."""
    size = np.ceil(abs(offset) - 1e-6)
    return np.int32(size) if offset >= 0.0 else np.int32(-size)


@helper
def classify_joint(s, other, at_end, links, screen_segments, is_round, unit):
    """
    Classify a segment's end; return its kind, and the offset to its corner, x and y.

    Parameters
    ----------
    s : int
        The segment.
    other : int
        The segment joined there; -1 for none.
    at_end : bool
        Whether it is the end, else the start.
    """
    ends, measures, states = screen_segments[0], screen_segments[1], screen_segments[2]
    nx, ny, length = get_normal(ends, s)
    half = measures[s, HALF_B if at_end else HALF_A]
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
    if measures[o, HALF_A if at_end else HALF_B] != half:
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
def bisect(ux, uy, vx, vy, rotation):
    """
    Return the unit vector midway between two.

    For opposite vectors, a quarter turn from the first, in the direction ``rotation`` (1 or -1).
    """
    x, y = ux + vx, uy + vy
    length = np.sqrt(x * x + y * y)
    if length < 1e-6:
        return -rotation * uy, rotation * ux
    return x / length, y / length


@helper
def count_halvings(ux, uy, vx, vy, rotation, half, unit):
    """Return the number of times that a fan between two unit vectors is halved."""
    flatness = (THIN_FLATNESS_PX if half <= unit else FLATNESS_PX) * unit
    halvings = 0
    while halvings < MAX_HALVINGS:
        x, y = ux + vx, uy + vy
        if half * (1.0 - 0.5 * np.sqrt(x * x + y * y)) <= flatness:
            return halvings
        vx, vy = bisect(ux, uy, vx, vy, rotation)
        halvings += 1
    return halvings


@helper
def count_cap_halvings(half, unit):
    """Return the number of times that a half circle is halved, as `count_halvings` does."""
    flatness = (THIN_FLATNESS_PX if half <= unit else FLATNESS_PX) * unit
    halvings, total = 0, 0.0
    while halvings < MAX_HALVINGS and half * (1.0 - 0.5 * total) > flatness:
        # The length of the sum of two unit vectors, of half the angle.
        total = np.sqrt(2.0 + total)
        halvings += 1
    return halvings


@helper
def fill_fan(ux, uy, vx, vy, rotation, halvings, fan):
    """Write the unit vectors of a fan, from the first to the last."""
    count = np.int64(1) << halvings
    fan[0, 0], fan[0, 1] = ux, uy
    fan[count, 0], fan[count, 1] = vx, vy
    step = count
    while step > 1:
        middle = step >> 1
        for n in range(middle, count, step):
            i, j = np.uintp(n - middle), np.uintp(n + middle)
            x, y = bisect(fan[i, 0], fan[i, 1], fan[j, 0], fan[j, 1], rotation)
            fan[np.uintp(n), 0], fan[np.uintp(n), 1] = x, y
        step = middle


@helper
def plan_wedge(s, o, screen_segments, unit):
    """
    Return the fan of a round join: first and last unit vector, rotation, number of halvings.

    The joint is the end of the first segment.
    """
    ends, measures = screen_segments[0], screen_segments[1]
    ux, uy, _ = get_normal(ends, s)
    vx, vy, _ = get_normal(ends, o)
    # A bend of 180 degrees goes round the end of the first segment.
    rotation = -1.0
    if ux * vy - uy * vx > 0.0:
        ux, uy, vx, vy, rotation = -ux, -uy, -vx, -vy, 1.0
    half = measures[s, HALF_B]
    return ux, uy, vx, vy, rotation, count_halvings(ux, uy, vx, vy, rotation, half, unit)


@helper
def plan_cap(s, at_end, screen_segments, unit):
    """Return the fan of a round cap: first and last unit vector, rotation, number of halvings."""
    ends, measures = screen_segments[0], screen_segments[1]
    x, y, length = get_normal(ends, s)
    if length == 0.0:
        x, y = 0.0, 1.0
    rotation = -1.0 if at_end else 1.0
    half = measures[s, HALF_B if at_end else HALF_A]
    return x, y, -x, -y, rotation, count_cap_halvings(half, unit)


@helper
def overlaps_picture(s, screen_segments, viewport, unit):
    """Return whether the bounding box of a segment with its width overlaps the picture."""
    ends, measures = screen_segments[0], screen_segments[1]
    margin = 1.25 * max(measures[s, HALF_A], measures[s, HALF_B]) + 2.0
    left, right = min(ends[s, 0], ends[s, 2]) - margin, max(ends[s, 0], ends[s, 2]) + margin
    top, bottom = min(ends[s, 1], ends[s, 3]) - margin, max(ends[s, 1], ends[s, 3]) + margin
    return (
        right >= 0.0 and bottom >= 0.0
        and left <= viewport.width * unit and top <= viewport.height * unit
    )  # fmt: skip


@helper
def get_dash(number, edges):
    """Return the start and the end of dash ``number`` of a strip."""
    dashes_per_period = (edges.shape[0] - 1) >> 1
    period = np.float64(number // dashes_per_period) * edges[edges.shape[0] - 1]
    n = np.uintp(2 * (number % dashes_per_period))
    return period + edges[n], period + edges[n + np.uintp(1)]


@helper
def find_first_dash(position, edges):
    """Return the first dash that ends beyond a position on a strip."""
    dashes_per_period = (edges.shape[0] - 1) >> 1
    number = dashes_per_period * np.int64(np.floor(position / edges[edges.shape[0] - 1]))
    while get_dash(number, edges)[1] <= position:
        number += 1
    return number


@helper
def is_dashed(s, screen_segments, strip_ranges, edges, unit):
    """Return whether a segment is dashed: the period of its dashes is at least a pixel."""
    if edges.shape[0] == 0:
        return False
    _, _, length = get_normal(screen_segments[0], s)
    periods = (strip_ranges[s, 1] - strip_ranges[s, 0]) / edges[edges.shape[0] - 1]
    return periods * unit <= length


@helper
def count_dashes(s, strip_ranges, edges):
    """Return the number of dashes that overlap a segment."""
    number, count = find_first_dash(strip_ranges[s, 0], edges), np.int64(0)
    while get_dash(number, edges)[0] < strip_ranges[s, 1]:
        number, count = number + 1, count + 1
    return count


@helper
def ends_on_dash(s, strip_ranges, edges):
    """Return whether a segment ends on a dash."""
    return get_dash(find_first_dash(strip_ranges[s, 1], edges), edges)[0] < strip_ranges[s, 1]


@helper
def find_parameter(position, s, screen_segments, strip_ranges):
    """Return the parameter on a segment, 0..1 in screen space, of a position on its strip."""
    first, last, ranges = strip_ranges[s, 0], strip_ranges[s, 1], screen_segments[3]
    t = (position - first) / (last - first)
    if ranges.shape[0] == 0:
        return t
    w0, w1 = ranges[s, 2], ranges[s, 3]
    return t * w1 / (w0 + t * (w1 - w0))


@helper
def has_body(s, ends):
    """Return whether a segment has a length on the screen."""
    return ends[s, 0] != ends[s, 2] or ends[s, 1] != ends[s, 3]


@helper
def neighbour_has_body(other, screen_segments):
    """Return whether a neighbour exists (not -1) and has a length on the screen."""
    if other < 0:
        return False
    o = np.uintp(other)
    return screen_segments[2][o] & VISIBLE != 0 and has_body(o, screen_segments[0])


@helper
def is_dot(s, start, stop, links, screen_segments, unit):
    """
    Return whether a segment is drawn as the pixel that holds its point.

    True if the segment and its neighbours have no length, and its round ends, a pixel or more wide,
    cover no pixel centre.
    """
    ends, measures = screen_segments[0], screen_segments[1]
    if has_body(s, ends) or start[0] != CAPPED or stop[0] != CAPPED:
        return False
    h0, h1 = measures[s, HALF_A], measures[s, HALF_B]
    if not 0.5 * unit <= max(h0, h1) <= unit:
        return False
    if neighbour_has_body(np.int64(links[s, 0]), screen_segments) or neighbour_has_body(
        np.int64(links[s, 1]), screen_segments
    ):
        return False
    # Both ends of so narrow a line cover |x| + |y| <= half, the start on the left.
    x, y = np.float64(ends[s, 0]), np.float64(ends[s, 1])
    to_x = (np.floor(x / unit) + 0.5) * unit - x
    to_y = (np.floor(y / unit) + 0.5) * unit - y
    return abs(to_x) + abs(to_y) >= (h0 if to_x < 0.0 else h1)


@helper
def classify_ends(s, links, screen_segments, is_round, viewport, unit):
    """Return the kinds of a segment's start and end, and the offsets to their corners."""
    start = classify_joint(s, np.int64(links[s, 0]), False, links, screen_segments, is_round, unit)
    stop = classify_joint(s, np.int64(links[s, 1]), True, links, screen_segments, is_round, unit)
    return start, stop


@helper
def classify_dashed_ends(start, stop, s, dashes):
    """Classify a dashed segment's ends: never round, a wedge only on a dash."""
    first = FREE if start[0] == CAPPED else start[0]
    last = FREE if stop[0] == CAPPED else stop[0]
    if last == WEDGE and not ends_on_dash(s, dashes[0], dashes[1]):
        last = FREE
    return (first, start[1], start[2]), (last, stop[1], stop[2])


@kernel
def count_pieces(
    segments: (int64, int64), links: int32[:, ::1],
    screen_segments: (int32[:, ::1], float64[:, ::1], uint8[::1], float64[:, ::1]), is_round: int64,
    viewport: Viewport, dashes: (float64[:, ::1], float64[::1]), counts: int32[:, ::1],
):  # fmt: skip
    """
    Count the vertices and the pieces of segments.

    Parameters
    ----------
    segments : (int, int)
    links : (S, 2) int32
        The segments joined to the start and the end of each; -1 for none.
    screen_segments : tuple
        From `project_segments`.
    is_round : int
        Not 0: caps are round.
    viewport : Viewport
    dashes : (strip_ranges (S, 2) float64, edges (D+1,) float64)
        Start and end of each clipped segment on its strip; positions where dashes and gaps begin,
        from 0 on. Both have no rows where lines are solid.
    counts : (S, 2) int32
        Writes vertices and pieces of each segment.
    """
    unit = np.float64(np.int64(1) << viewport.grid_bits)
    for n in range(segments[0], segments[1]):
        s = np.uintp(n)
        vertices, pieces = np.int64(0), np.int64(0)
        if screen_segments[2][s] & VISIBLE and overlaps_picture(s, screen_segments, viewport, unit):
            start, stop = classify_ends(s, links, screen_segments, is_round, viewport, unit)
            shows_dashes = is_dashed(s, screen_segments, dashes[0], dashes[1], unit)
            quads = np.int64(0)
            if has_body(s, screen_segments[0]):
                quads = count_dashes(s, dashes[0], dashes[1]) if shows_dashes else np.int64(1)
            vertices, pieces = 4 * quads, 2 * quads
            if shows_dashes:
                start, stop = classify_dashed_ends(start, stop, s, dashes)
            if is_dot(s, start, stop, links, screen_segments, unit):
                counts[s, 0], counts[s, 1] = 4, 2
                continue
            if start[0] == CAPPED:
                sides = np.int64(1) << count_cap_halvings(screen_segments[1][s, HALF_A], unit)
                vertices, pieces = vertices + sides + 1, pieces + sides - 1
            if stop[0] == CAPPED:
                sides = np.int64(1) << count_cap_halvings(screen_segments[1][s, HALF_B], unit)
                vertices, pieces = vertices + sides + 1, pieces + sides - 1
            elif stop[0] == WEDGE:
                sides = (
                    np.int64(1) << plan_wedge(s, np.uintp(links[s, 1]), screen_segments, unit)[5]
                )
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
def write_fan(fan_plan, x, y, half, depth, has_centre, vertex, piece, face, screen, out, fan):
    """Write a fan around a point, from centre or first corner; return next vertex and piece."""
    pieces, piece_faces = out
    ux, uy, vx, vy, rotation, halvings = fan_plan
    sides = np.int64(1) << halvings
    fill_fan(ux, uy, vx, vy, rotation, halvings, fan)
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
def get_body_end(s, at_end, joint, screen_segments):
    """Return an end of a body: position, offset to its corner, depth."""
    ends, measures = screen_segments[0], screen_segments[1]
    k, column = np.uintp(2 if at_end else 0), DEPTH_B if at_end else DEPTH_A
    return (
        ends[s, k], ends[s, k + np.uintp(1)], round_outward(joint[1]), round_outward(joint[2]),
        measures[s, column],
    )  # fmt: skip


@helper
def get_body_cut(t, s, screen_segments):
    """Return the cut of a body inside a segment, at 0..1 in screen space, like `get_body_end`."""
    ends, measures = screen_segments[0], screen_segments[1]
    nx, ny, _ = get_normal(ends, s)
    x = ends[s, 0] + t * np.float64(ends[s, 2] - ends[s, 0])
    y = ends[s, 1] + t * np.float64(ends[s, 3] - ends[s, 1])
    half = measures[s, HALF_A] + t * (measures[s, HALF_B] - measures[s, HALF_A])
    depth = measures[s, DEPTH_A] + t * (measures[s, DEPTH_B] - measures[s, DEPTH_A])
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
    screen_segments: (int32[:, ::1], float64[:, ::1], uint8[::1], float64[:, ::1]), is_round: int64,
    viewport: Viewport, dashes: (float64[:, ::1], float64[::1]),
    starts: (int64, int64, int64[:, ::1]), screen: ScreenVertices,
    out: (int32[:, ::1], int32[::1]), fan: float64[:, ::1],
):  # fmt: skip
    """
    Write the vertices and the pieces of segments.

    Parameters
    ----------
    segments, links, screen_segments, is_round, viewport, dashes
        As `count_pieces` takes them.
    starts : (int, int, (S+1, 2) int64)
        The first vertex and the first face of the object; running sums of the counts.
    screen : ScreenVertices
        Writes the vertices.
    out : (pieces (P, 3) int32, piece_faces (P,) int32)
        Written.
    fan : (513, 2) float64
        Scratch memory of this thread, ``SCRATCH_SHAPE``.
    """
    first_vertex, first_face, sums = starts
    ends, measures = screen_segments[0], screen_segments[1]
    unit = np.float64(np.int64(1) << viewport.grid_bits)
    for n in range(segments[0], segments[1]):
        s = np.uintp(n)
        vertex, piece = first_vertex + sums[s, 0], sums[s, 1]
        if sums[s + np.uintp(1), 0] == sums[s, 0]:
            continue
        face = np.int32(first_face + n)
        start, stop = classify_ends(s, links, screen_segments, is_round, viewport, unit)
        x0, y0, x1, y1 = ends[s, 0], ends[s, 1], ends[s, 2], ends[s, 3]
        h0, h1 = measures[s, HALF_A], measures[s, HALF_B]
        d0, d1 = measures[s, DEPTH_A], measures[s, DEPTH_B]
        # Write bodies: one for each dash, or a single one.
        shows_dashes = is_dashed(s, screen_segments, dashes[0], dashes[1], unit)
        if shows_dashes and has_body(s, ends):
            number = find_first_dash(dashes[0][s, 0], dashes[1])
            while True:
                begin, end = get_dash(number, dashes[1])
                if begin >= dashes[0][s, 1]:
                    break
                if begin > dashes[0][s, 0]:
                    first = get_body_cut(
                        find_parameter(begin, s, screen_segments, dashes[0]), s, screen_segments
                    )
                else:
                    first = get_body_end(s, False, start, screen_segments)
                if end < dashes[0][s, 1]:
                    last = get_body_cut(
                        find_parameter(end, s, screen_segments, dashes[0]), s, screen_segments
                    )
                else:
                    last = get_body_end(s, True, stop, screen_segments)
                write_body(vertex, piece, first, last, face, screen, out)
                vertex, piece, number = vertex + 4, piece + 2, number + 1
        elif has_body(s, ends):
            first = get_body_end(s, False, start, screen_segments)
            last = get_body_end(s, True, stop, screen_segments)
            write_body(vertex, piece, first, last, face, screen, out)
            vertex, piece = vertex + 4, piece + 2
        if shows_dashes:
            start, stop = classify_dashed_ends(start, stop, s, dashes)
        # Write squares for segments without length.
        if is_dot(s, start, stop, links, screen_segments, unit):
            side = np.int32(0.5 * unit)
            first, last = (x0, y0 - side, -side, 0, d0), (x0, y0 + side, -side, 0, d1)
            write_body(vertex, piece, first, last, face, screen, out)
            continue
        # Write caps, and wedges between segments.
        if start[0] == CAPPED:
            vertex, piece = write_fan(
                plan_cap(s, False, screen_segments, unit), x0, y0, h0, d0, False, vertex, piece,
                face, screen, out, fan,
            )  # fmt: skip
        if stop[0] == CAPPED:
            vertex, piece = write_fan(
                plan_cap(s, True, screen_segments, unit), x1, y1, h1, d1, False, vertex, piece,
                face, screen, out, fan,
            )  # fmt: skip
        elif stop[0] == WEDGE:
            vertex, piece = write_fan(
                plan_wedge(s, np.uintp(links[s, 1]), screen_segments, unit), x1, y1, h1, d1, True,
                vertex, piece, face, screen, out, fan,
            )  # fmt: skip
