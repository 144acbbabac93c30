"""
Find colours, normals and points of lit samples in float32, as accurate as 8 bits call for.

Weights are those of ``float32_weights``: whatever the face, each is off by little of itself.
Colours are weighted means of the vertices'. Of normals and points float32 holds the first vertex's
and the ways to the others, so that an error is a share of how much they change over the face. Where
a normal or a point is too short beside that, which a bound for each face tells, and so a direction
is not sure to a sixteenth of an 8-bit step, both are found in float64 (see ``survey.precision``).

A run of neighbours that show one face is a loop over vectors; what it reads of the face is kept
from one row to the next. Where faces show about one sample a row, that costs more than it saves:
vertices are gathered there, a face for each lane. Both take the same steps, and what a sample shows
depends on its face and its pixel alone.

Samples at jumps and steep places of light (``steep``) are found in float64 as well. In the light of
lamps a face that is not sure (``lamps``) is doubtful as a whole, and samples are not found in
float64 one by one, but by stages that follow (``set_aside``). Objects that take float64 whatever
they show, such as those with textures, are left to these stages at once.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import (
    has_its_back_turned,
    matrix_of,
    place,
    place_sample,
    sample_weights,
    smooth_normal,
)
from rasterjit.pipeline.geometry.setup import CLIPPED, whole_size
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.surface import samples as row
from rasterjit.pipeline.surface.attributes import fill_row, gather_values
from rasterjit.pipeline.surface.float32_colors import edges_along_row, goes_on
from rasterjit.pipeline.surface.float32_weights import (
    is_wide,
    weigh_mixed,
    weights_at,
)
from rasterjit.pipeline.surface.lamps import (
    BY_LAMPS,
    MORE_BENT,
    MORE_NORMAL,
    facing_of,
    lamp_on_face,
    limits_on_face,
    square,
    start_lamps,
)
from rasterjit.pipeline.surface.listing import whole_vectors
from rasterjit.pipeline.surface.samples import (
    AX,
    AY,
    BX,
    BY,
    COLUMN,
    COLUMN_OF,
    CX,
    CY,
    EDGE_ELEMENTS,
    END_PATCH,
    FACE,
    FIRST,
    FIRST_PATCH,
    KIND,
    KNOWS_PLANES,
    OWNER,
    PLANES,
    ROW,
    ROW_OF,
    SEGMENTS,
    SPAN,
    START,
    STOP,
    VECTOR,
    A,
    B,
    Block,
    C,
)
from rasterjit.pipeline.surface.steep import (
    GLOSS,
    MATT,
    MOST_STEEP,
    add_steep,
    is_calm,
    normal_error,
    note_steep,
    point_error,
)
from rasterjit.pipeline.surface.weights import may_be_wide
from rasterjit.runtime.intrinsics import (
    COLORS,
    IS_CALM,
    LEAST_NORMAL,
    LEAST_POINT,
    NORMALS,
    OFF_NORMAL,
    OFF_POINT,
    PLANE_ELEMENTS,
    POINTS,
    RATIO_B,
    RATIO_C,
    SIDE,
    blend_planes,
    part,
)
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state import float32

LONG_RUN = 2.5
"""Samples of a patch, on average, from which on runs are worked on one by one."""

PLAIN, CUT, ODD = 0, 1, 2
"""How weights of a face are found: by its edges, by its clip positions, sample by sample."""

EDGES, RIGHT, DOWN, COLUMN_THERE, ROW_THERE = 0, 3, 6, 9, 10
"""Elements of ``edges``: edge functions at a pixel, their steps, that pixel."""

LIGHT, OFF, EXACT = 0, 1, 2
"""Rows of ``shares``: light of lamps on a face, what that moves, and what is found in float64."""

SURE, DOUBTFUL, FOREIGN = np.float32(0.0), np.float32(1.0), np.float32(2.0)
"""What `EXACT` holds: nothing is found in float64, normals and points are, all is."""

NORMAL_ERRORS, POINT_ERRORS, STEEP = 5, 6, 7
"""Rows of ``colors``: what normals and points are off by, and what light comes to at jumps."""

LEAST_RATIO, LARGEST_RATIO = np.float32(2.0**-60), np.float32(2.0**60)
"""Ratios of w between these keep sums of weights far from the ends of float32."""

VAST = np.float32(2.0**123)
"""
Squared distances from here on take float64: scenes of 1e18 units, whose lamps, too far for float32
to tell that they shine, must not change a bit either.
"""


@helper
def turned(x, y, z, m):
    """Return a vector times a matrix."""
    return (
        m[0] * x + m[1] * y + m[2] * z,
        m[3] * x + m[4] * y + m[5] * z,
        m[6] * x + m[7] * y + m[8] * z,
    )


@helper
def rounded(m):
    """Return the elements of a matrix in float32."""
    f = np.float32
    return f(m[0]), f(m[1]), f(m[2]), f(m[3]), f(m[4]), f(m[5]), f(m[6]), f(m[7]), f(m[8])


@helper
def put(plane, at, x, y, z):
    """Write three numbers."""
    plane[at], plane[at + 1], plane[at + 2] = x, y, z


@helper
def lay_colors(plane, corner, base, colors):
    """Write a base colour times those of the vertices, and the range of these."""
    a, b, c = corner
    for k in range(3):
        own = base[k]
        first, second, third = own, own, own
        if colors.shape[0] > 0:
            first, second, third = own * colors[a, k], own * colors[b, k], own * colors[c, k]
        plane[COLORS + k], plane[COLORS + 4 + k], plane[COLORS + 8 + k] = first, second, third
        plane[COLORS + 12 + k] = max(first, max(second, third))
        plane[COLORS + 16 + k] = min(first, min(second, third))


@helper
def least_square(first, bent, light, own, by_lamps):
    """
    Return the least squared length of a normal that is sure.

    Takes those of the first vertex's normal, and of the longer way from there to another; the light
    of lamps; the limits of the face, and what that light adds to them.
    """
    least = (own[0] + light * by_lamps[MORE_NORMAL]) * np.sqrt(first)
    least += (own[1] + light * by_lamps[MORE_BENT]) * np.sqrt(bent)
    return least * least


@helper
def lay_normals(plane, corner, turn, side, normals, light, own, by_lamps):
    """Write the first vertex's normal, world axes, and ways to the others; return the longer."""
    a, b, c = corner
    x, y, z = normals[a, 0], normals[a, 1], normals[a, 2]
    ux, uy, uz = turned(normals[b, 0] - x, normals[b, 1] - y, normals[b, 2] - z, turn)
    vx, vy, vz = turned(normals[c, 0] - x, normals[c, 1] - y, normals[c, 2] - z, turn)
    x, y, z = turned(x, y, z, turn)
    put(plane, NORMALS, side * x, side * y, side * z)
    put(plane, NORMALS + 4, side * ux, side * uy, side * uz)
    put(plane, NORMALS + 8, side * vx, side * vy, side * vz)
    bent, first = max(square(ux, uy, uz), square(vx, vy, vz)), square(x, y, z)
    plane[LEAST_NORMAL] = least_square(first, bent, light, own, by_lamps)
    plane[OFF_NORMAL] = normal_error(first, bent)
    return np.sqrt(bent)


@helper
def least_distance(first, moved, limit):
    """
    Return the least squared distance of a point that is sure.

    Takes the squared lengths of the first vertex and of the longer way from there to another. None
    is sure on a face that is vast.
    """
    return limit * moved if first + moved < VAST else np.float32(np.inf)


@helper
def lay_points(plane, corner, owner, matrix, placement, lamps, limits):
    """
    Write where the first vertex lies, and the ways to the others.

    Returns the light of lamps, the limits of the face, and the longer way.
    """
    p, (a, b, c) = placement.positions, corner
    ax, ay, az = p[a, 0], p[a, 1], p[a, 2]
    f = np.float32
    ux, uy, uz = turned(f(p[b, 0] - ax), f(p[b, 1] - ay), f(p[b, 2] - az), matrix)
    vx, vy, vz = turned(f(p[c, 0] - ax), f(p[c, 1] - ay), f(p[c, 2] - az), matrix)
    x, y, z = place(ax, ay, az, owner, placement.relative_from_model)
    x, y, z = f(x), f(y), f(z)
    put(plane, POINTS, x, y, z)
    put(plane, POINTS + 4, ux, uy, uz)
    put(plane, POINTS + 8, vx, vy, vz)
    moved = max(square(ux, uy, uz), square(vx, vy, vz))
    first, way = square(x, y, z), np.sqrt(moved)
    plane[OFF_POINT] = point_error(first, moved)
    light, off = f(0.0), f(0.0)
    if lamps.shape[0] > 0:
        ways = (ux, uy, uz), (vx, vy, vz)
        facing, away = facing_of(ways[0], ways[1]), np.sqrt(first)
        for n in range(lamps.shape[0]):
            more = lamp_on_face(lamps[n], (x, y, z), ways, facing, away, way, limits[1])
            light += more[0]
            off += more[1]
    own = limits_on_face(light, off, limits)
    plane[LEAST_POINT] = least_distance(first, moved, own[2]) if own[3] else f(np.inf)
    return light, own, way


@helper
def is_calm_everywhere(plane, bent, way, lights, viewer, limits):
    """Return 1 if no sample of a face is at a jump or a steep place of any light, else 0."""
    calm = np.float32(1.0)
    if limits[GLOSS] != MATT:
        first = plane[NORMALS], plane[NORMALS + 1], plane[NORMALS + 2]
        point = plane[POINTS], plane[POINTS + 1], plane[POINTS + 2]
        errors = plane[OFF_NORMAL], plane[OFF_POINT]
        for n in range(lights.shape[0]):
            if not is_calm(first, bent, point, way, errors, lights[n], viewer, limits):
                calm = np.float32(0.0)
    return calm


@helper
def lay_edges(edge, corner, pixel, has_wide, plane, geometry):
    """Write edge functions, positive on the face, and ratios of w; return how it is weighed."""
    xy, codes, w = geometry.xy, geometry.codes, geometry.w
    (a, b, c), one = corner, np.float32(1.0)
    plane[RATIO_B], plane[RATIO_C] = one, one
    edge[COLUMN_THERE], edge[ROW_THERE] = np.float64(pixel[0]), np.float64(pixel[1])
    if np.int32((codes[a] | codes[b] | codes[c]) & CLIPPED) != 0:
        return CUT
    if has_wide and is_wide(a, b, c, xy):
        return ODD
    bits = geometry.viewport.grid_bits
    (e0, e1, e2), (r0, r1, r2) = edges_along_row(a, b, c, pixel[0], pixel[1], bits, xy)
    s = -1.0 if e0 + e1 + e2 < 0.0 else 1.0
    ax, bx, cx = np.float64(xy[a, 0]), np.float64(xy[b, 0]), np.float64(xy[c, 0])
    edge[EDGES], edge[EDGES + 1], edge[EDGES + 2] = s * e0, s * e1, s * e2
    edge[RIGHT], edge[RIGHT + 1], edge[RIGHT + 2] = s * r0, s * r1, s * r2
    s *= np.float64(np.int32(1) << bits)
    edge[DOWN], edge[DOWN + 1], edge[DOWN + 2] = s * (cx - bx), s * (ax - cx), s * (bx - ax)
    if w.shape[0] == 0:
        return PLAIN
    ratio_b, ratio_c = np.float32(w[a] / w[b]), np.float32(w[a] / w[c])
    plane[RATIO_B], plane[RATIO_C] = ratio_b, ratio_c
    least, largest = min(ratio_b, ratio_c), max(ratio_b, ratio_c)
    return PLAIN if (least > LEAST_RATIO) & (largest < LARGEST_RATIO) else ODD


@helper
def turn_of(ax, ay, bx, by, cx, cy):
    """Return the edge function of a whole face."""
    ux, uy = np.float64(np.int32(bx - ax)), np.float64(np.int32(by - ay))
    vx, vy = np.float64(np.int32(cx - ax)), np.float64(np.int32(cy - ay))
    return ux * vy - uy * vx


@helper
def shows_back(corner, kind, owner, geometry, placement):
    """Return whether the back of a face is seen."""
    a, b, c = corner
    if kind == CUT:
        return has_its_back_turned(a, b, c, owner, placement)
    xy = geometry.xy
    turn = turn_of(xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1])
    return turn * placement.front_turns[owner] < 0.0


@helper
def meet_face(face, corner, pixel, owned, has_wide, block, geometry, placement, look):
    """Find the planes of a face, unless they are known; return where they are."""
    slot = np.uintp(face) & np.uintp(PLANES - 1)
    if block.faces[0, slot] == face:
        return slot
    (owner, turn, matrix, base), (normals, colors, lamps, lights, viewer, limits) = owned, look
    plane = part(block.planes, slot, 0, PLANE_ELEMENTS)
    edge = part(block.edges, slot, 0, EDGE_ELEMENTS)
    kind = lay_edges(edge, corner, pixel, has_wide, plane, geometry)
    side = np.float32(-1.0 if shows_back(corner, kind, owner, geometry, placement) else 1.0)
    plane[SIDE] = side
    lay_colors(plane, corner, base, colors)
    light, own, way = lay_points(plane, corner, owner, matrix, placement, lamps, limits)
    bent = lay_normals(plane, corner, turn, side, normals, light, own, limits[1])
    plane[IS_CALM] = is_calm_everywhere(plane, bent, way, lights, viewer, limits[1])
    block.faces[0, slot], block.faces[1, slot] = face, kind
    return slot


@helper
def cut_row(corner, line, geometry):
    """
    Return edge functions along a row of a clipped face, and their steps.

    Both for numbers that are twice a column of the whole picture plus one.
    """
    a, b, c = corner
    clip, viewport = geometry.clip_positions, geometry.viewport
    width, height = whole_size(viewport)
    y = 1.0 - (2.0 * (viewport.top + line) + 1.0) / height
    wa, wb, wc = clip[a, 3], clip[b, 3], clip[c, 3]
    va, vb, vc = clip[a, 1] - y * wa, clip[b, 1] - y * wb, clip[c, 1] - y * wc
    ua, ub, uc = clip[a, 0] + wa, clip[b, 0] + wb, clip[c, 0] + wc
    over = -1.0 / width
    return (
        (ub * vc - uc * vb, uc * va - ua * vc, ua * vb - ub * va),
        (over * (wb * vc - wc * vb), over * (wc * va - wa * vc), over * (wa * vb - wb * va)),
    )


@helper
def lay_plainly(first, stop, slot, corner, pixel, block, geometry):
    """
    Write the samples of a run in float32; return not 0 if any may be doubtful.

    Returns -1, and writes nothing, where a clipped face is seen so nearly from its edge that sums
    of weights are nothing but rounding.
    """
    edge = part(block.edges, slot, 0, EDGE_ELEMENTS)
    plane = part(block.planes, slot, 0, PLANE_ELEMENTS)
    gains = edge[RIGHT], edge[RIGHT + 1], edge[RIGHT + 2]
    if block.faces[1, slot] == PLAIN:
        right = np.float64(pixel[0]) - edge[COLUMN_THERE]
        down = np.float64(pixel[1]) - edge[ROW_THERE]
        at = (
            edge[EDGES] + right * gains[0] + down * edge[DOWN],
            edge[EDGES + 1] + right * gains[1] + down * edge[DOWN + 1],
            edge[EDGES + 2] + right * gains[2] + down * edge[DOWN + 2],
        )
        way = 0.0, 1.0
    else:
        at, gains = cut_row(corner, pixel[1], geometry)
        way = np.float64(2 * (geometry.viewport.left + pixel[0]) + 1), 2.0
        slope, total = gains[0] + gains[1] + gains[2], at[0] + at[1] + at[2]
        total += way[0] * slope
        last = total + 2.0 * np.float64(stop - first - 1) * slope
        if total < 0.0:
            at, gains = (-at[0], -at[1], -at[2]), (-gains[0], -gains[1], -gains[2])
        if not total * last > 0.0:
            return np.int32(-1)
    unsure = blend_planes(block.samples, first, stop - first, at, gains, way, plane)
    if geometry.viewport.reach != 0 and block.faces[1, slot] == PLAIN:
        unsure |= lay_outside(first, stop, at, gains, plane, block)
    return unsure


@helper
def lay_sample(n, weights, plane, samples):
    """Write a sample with given weights."""
    w0, w1, w2 = weights
    for k in range(3):
        value = w0 * plane[COLORS + k] + w1 * plane[COLORS + 4 + k] + w2 * plane[COLORS + 8 + k]
        most, least = plane[COLORS + 12 + k], plane[COLORS + 16 + k]
        value = value if value > least else least
        samples[row.RED + k, n] = value if value < most else most
        bent = w1 * plane[NORMALS + 4 + k] + w2 * plane[NORMALS + 8 + k]
        samples[row.NORMAL_X + k, n] = plane[NORMALS + k] + bent
        moved = w1 * plane[POINTS + 4 + k] + w2 * plane[POINTS + 8 + k]
        samples[row.POINT_X + k, n] = plane[POINTS + k] + moved


@helper
def held_to_face(n, weights, block):
    """Return weights, or those of `find_weights` where a sample lies beside its face."""
    if min(weights[0], min(weights[1], weights[2])) >= np.float32(0.0):
        return weights
    second, third = block.weights[0, n], block.weights[1, n]
    return np.float32(1.0 - second - third), np.float32(second), np.float32(third)


@helper
def lay_oddly(first, stop, corner, pixel, plane, block, geometry):
    """Write the samples of a run with weights that are found one by one."""
    a, b, c = corner
    for n in range(np.uintp(first), np.uintp(stop)):
        column = pixel[0] + np.int64(n) - first
        weights = weights_at(a, b, c, column, pixel[1], geometry)
        if geometry.viewport.reach != 0:
            weights = held_to_face(n, weights, block)
        lay_sample(n, weights, plane, block.samples)


@helper
def lay_outside(first, stop, at, gains, plane, block):
    """
    Write the samples of a run that lie beside their face anew, given edge functions.

    Returns not 0 if there are any.
    """
    last = np.float64(stop - first - 1)
    least = min(at[0], min(at[1], at[2]))
    ends = min(at[0] + last * gains[0], min(at[1] + last * gains[1], at[2] + last * gains[2]))
    if min(least, ends) >= 0.0:
        return np.int32(0)
    outside = np.float32(-1.0), np.float32(0.0), np.float32(0.0)
    for n in range(np.uintp(first), np.uintp(stop)):
        way = np.float64(np.int64(n) - first)
        e0, e1, e2 = at[0] + way * gains[0], at[1] + way * gains[1], at[2] + way * gains[2]
        if min(e0, min(e1, e2)) < 0.0:
            lay_sample(n, held_to_face(n, outside, block), plane, block.samples)
    return np.int32(1)


@helper
def is_doubtful(x, y, z, least):
    """Return whether a vector is too short for what it may be off by."""
    return not square(x, y, z) >= least


@helper
def mend(first, stop, corner, pixel, owner, side, block, geometry, placement, normals):
    """Find normals and points of the doubtful samples of a run in float64."""
    s, (a, b, c) = block.samples, corner
    for n in range(np.uintp(first), np.uintp(stop)):
        if block.shares[EXACT, n] == SURE:
            continue
        column = pixel[0] + np.int64(n) - first
        weights = sample_weights(a, b, c, column, pixel[1], geometry)
        normal = smooth_normal(weights, a, b, c, normals, placement.normal_matrices, owner)
        point = place_sample(weights, a, b, c, owner, placement)
        for k in range(3):
            s[row.NORMAL_X + k, n] = np.float32(np.float64(side) * normal[k])
            s[row.POINT_X + k, n] = np.float32(point[k])


@disjoint_helper
def mark(nx, ny, nz, px, py, pz, exact, least_normal, least_point):
    """Note which samples of a face are doubtful."""
    for n in range(exact.shape[0]):
        is_unsure = is_doubtful(nx[n], ny[n], nz[n], least_normal)
        is_unsure |= is_doubtful(px[n], py[n], pz[n], least_point)
        exact[n] = np.float32(1.0 if is_unsure else 0.0)


@helper
def mark_run(first, stop, plane, block):
    """Note which samples of a run are doubtful, to be found in float64 by stages that follow."""
    s = block.samples
    mark(
        part(s, row.NORMAL_X, first, stop), part(s, row.NORMAL_Y, first, stop),
        part(s, row.NORMAL_Z, first, stop), part(s, row.POINT_X, first, stop),
        part(s, row.POINT_Y, first, stop), part(s, row.POINT_Z, first, stop),
        part(block.shares, EXACT, first, stop), plane[LEAST_NORMAL], plane[LEAST_POINT],
    )  # fmt: skip


@disjoint_helper
def doubt_steep(steep, exact, count):
    """Note that samples at jumps and steep places are doubtful; return not 0 if one of them is."""
    found = np.int32(0)
    for n in range(exact.shape[0]):
        is_steep = (not steep[n] <= MOST_STEEP) & (np.int32(n) < count)
        exact[n] = DOUBTFUL if is_steep else exact[n]
        found = np.int32(found | np.int32(is_steep))
    return found


@helper
def mark_steep(first, stop, count, look, block):
    """
    Note which samples lie at jumps and steep places of light, of those that may.

    Returns not 0 if any of ``count`` does.
    """
    (_, _, _, lights, viewer, (_, limits)), found = look, np.int32(0)
    for start in range(first, stop, VECTOR):
        end = min(start + VECTOR, stop)
        steep = part(block.colors, STEEP, start, end)
        if any_doubtful(steep) != 0:
            fill_row(steep, np.float32(0.0))
            for n in range(lights.shape[0]):
                add_steep(*seen_of(start, end, block), lights[n], viewer, limits)
            left = count - np.int32(start - first)
            found |= doubt_steep(steep, part(block.shares, EXACT, start, end), left)
    return found


@helper
def note_steep_samples(first, stop, look, block):
    """Note which samples may lie there, given what they are off by; return not 0 if any may."""
    _, _, _, lights, viewer, (_, limits) = look
    fill_row(part(block.colors, STEEP, first, stop), np.float32(0.0))
    for n in range(lights.shape[0]):
        note_steep(*seen_of(first, stop, block), lights[n], viewer, limits)
    return any_doubtful(part(block.colors, STEEP, first, stop))


@helper
def seen_of(first, stop, block):
    """Return rows of normals and points, of what both are off by, and of what light comes to."""
    s, memory = block.samples, block.colors
    return (
        part(s, row.NORMAL_X, first, stop), part(s, row.NORMAL_Y, first, stop),
        part(s, row.NORMAL_Z, first, stop), part(s, row.POINT_X, first, stop),
        part(s, row.POINT_Y, first, stop), part(s, row.POINT_Z, first, stop),
        part(memory, NORMAL_ERRORS, first, stop), part(memory, POINT_ERRORS, first, stop),
        part(memory, STEEP, first, stop),
    )  # fmt: skip


@disjoint_helper
def any_doubtful(exact):
    """Return not 0 if any sample is."""
    found = np.int32(0)
    for n in range(exact.shape[0]):
        found |= np.int32(exact[n] > SURE)
    return found


@helper
def lay_runs(segment, owned, block, geometry, placement, look, has_wide):
    """Write the samples of a segment, run by run."""
    whole, r, end = block.whole, np.uintp(segment[FIRST_PATCH]), np.uintp(segment[END_PATCH])
    while r < end:
        start, following = np.uintp(whole[FIRST, r]), r + np.uintp(1)
        while following < end and goes_on(whole, r, following, start):
            following += np.uintp(1)
        pixel = np.int64(segment[COLUMN_OF]), np.int64(segment[ROW_OF])
        if segment[KIND] != SPAN:
            pixel = np.int64(whole[COLUMN, start]), np.int64(whole[ROW, start])
        corner = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        slot = meet_face(
            whole[FACE, r], corner, pixel, owned, has_wide, block, geometry, placement, look
        )
        first, stop, unsure = np.int64(start), np.int64(whole[FIRST, following]), np.int32(-1)
        if block.faces[1, slot] != ODD:
            unsure = lay_plainly(first, stop, slot, corner, pixel, block, geometry)
        plane = part(block.planes, slot, 0, PLANE_ELEMENTS)
        if unsure < 0:
            lay_oddly(first, stop, corner, pixel, plane, block, geometry)
        is_calm_there = plane[IS_CALM] == np.float32(1.0)
        may_be_steep = False
        if not is_calm_there:
            fill_row(part(block.colors, NORMAL_ERRORS, first, stop), plane[OFF_NORMAL])
            fill_row(part(block.colors, POINT_ERRORS, first, stop), plane[OFF_POINT])
            may_be_steep = note_steep_samples(first, stop, look, block) != 0
        if unsure != 0 or may_be_steep:
            mark_run(first, stop, plane, block)
        if may_be_steep:
            unsure |= mark_steep(first, stop, np.int32(stop - first), look, block)
        if (unsure != 0) & (look[2].shape[0] == 0):
            mend(
                first, stop, corner, pixel, owned[0], plane[SIDE], block, geometry, placement,
                look[0],
            )  # fmt: skip
        r = following


@disjoint_helper
def mix_base(red, green, blue, base):
    """Write one colour."""
    for n in range(red.shape[0]):
        red[n], green[n], blue[n] = base


@helper
def held(w0, w1, w2, base, a, b, c):
    """Return the weighted mean of a base times three colours, held to their range."""
    a, b, c = base * a, base * b, base * c
    value, most, least = w0 * a + w1 * b + w2 * c, max(a, max(b, c)), min(a, min(b, c))
    value = value if value > least else least
    return value if value < most else most


@disjoint_helper
def mix_colors(
    red, green, blue, ra, ga, ba, rb, gb, bb, rc, gc, bc, first, second, third, base
):  # fmt: skip
    """Write base colours times those of vertices, each of a face of its own."""
    for n in range(red.shape[0]):
        w0, w1, w2 = first[n], second[n], third[n]
        red[n] = held(w0, w1, w2, base[0], ra[n], rb[n], rc[n])
        green[n] = held(w0, w1, w2, base[1], ga[n], gb[n], gc[n])
        blue[n] = held(w0, w1, w2, base[2], ba[n], bb[n], bc[n])


@disjoint_helper
def find_sides(ax, ay, bx, by, cx, cy, front, sides):
    """Write -1 where the back of a sample's face is seen, else 1."""
    one = np.float32(1.0)
    for n in range(ax.shape[0]):
        is_behind = turn_of(ax[n], ay[n], bx[n], by[n], cx[n], cy[n]) * front < 0.0
        sides[n] = -one if is_behind else one


@disjoint_helper
def mix_normals(
    nx, ny, nz, xa, ya, za, xb, yb, zb, xc, yc, zc, sides, second, third, light, off, exact, errors,
    turn, limits, count,
):  # fmt: skip
    """
    Write normals of faces, and note in ``exact`` which are doubtful, in ``errors`` how far.

    Returns not 0 if any of ``count`` is.
    """
    found = np.int32(0)
    for n in range(nx.shape[0]):
        x, y, z, w1, w2, side = xa[n], ya[n], za[n], second[n], third[n], sides[n]
        ux, uy, uz = turned(xb[n] - x, yb[n] - y, zb[n] - z, turn)
        vx, vy, vz = turned(xc[n] - x, yc[n] - y, zc[n] - z, turn)
        x, y, z = turned(x, y, z, turn)
        bent = max(square(ux, uy, uz), square(vx, vy, vz))
        first = square(x, y, z)
        errors[n] = normal_error(first, bent)
        own = limits_on_face(light[n], off[n], limits)
        least = least_square(first, bent, light[n], own, limits[1])
        x, y, z = x + (w1 * ux + w2 * vx), y + (w1 * uy + w2 * vy), z + (w1 * uz + w2 * vz)
        nx[n], ny[n], nz[n] = side * x, side * y, side * z
        is_unsure = is_doubtful(x, y, z, least) & (np.int32(n) < count)
        exact[n] = np.float32(1.0) if is_unsure else exact[n]
        found = np.int32(found | np.int32(is_unsure))
    return found


@disjoint_helper
def round_ways(xa, ya, za, xb, yb, zb, xc, yc, zc, ux, uy, uz, vx, vy, vz):
    """Write the ways from the first vertex to the others, model space, in float32."""
    f = np.float32
    for n in range(xa.shape[0]):
        x, y, z = xa[n], ya[n], za[n]
        ux[n], uy[n], uz[n] = f(xb[n] - x), f(yb[n] - y), f(zb[n] - z)
        vx[n], vy[n], vz[n] = f(xc[n] - x), f(yc[n] - y), f(zc[n] - z)


@disjoint_helper
def place_first(px, py, pz, xa, ya, za, owner, matrices):
    """Write where the first vertices lie."""
    f = np.float32
    for n in range(px.shape[0]):
        x, y, z = place(xa[n], ya[n], za[n], owner, matrices)
        px[n], py[n], pz[n] = f(x), f(y), f(z)


@disjoint_helper
def measure_faces(
    px, py, pz, xb, yb, zb, xc, yc, zc, facing_x, facing_y, facing_z, away, way, matrix
):  # fmt: skip
    """Write what `lamp_on_face` takes of faces, each of a lane."""
    for n in range(px.shape[0]):
        u, v = turned(xb[n], yb[n], zb[n], matrix), turned(xc[n], yc[n], zc[n], matrix)
        facing_x[n], facing_y[n], facing_z[n] = facing_of(u, v)
        way[n] = np.sqrt(max(square(u[0], u[1], u[2]), square(v[0], v[1], v[2])))
        away[n] = np.sqrt(square(px[n], py[n], pz[n]))


@disjoint_helper
def add_lamp(
    px, py, pz, xb, yb, zb, xc, yc, zc, facing_x, facing_y, facing_z, away, way, light, off, lamp,
    matrix, limits,
):  # fmt: skip
    """Add the light of a lamp on faces, and what it moves: `lamp_on_face`."""
    for n in range(px.shape[0]):
        first, facing = (px[n], py[n], pz[n]), (facing_x[n], facing_y[n], facing_z[n])
        ways = turned(xb[n], yb[n], zb[n], matrix), turned(xc[n], yc[n], zc[n], matrix)
        more = lamp_on_face(lamp, first, ways, facing, away[n], way[n], limits)
        light[n] += more[0]
        off[n] += more[1]


@disjoint_helper
def move_points(
    px, py, pz, xb, yb, zb, xc, yc, zc, second, third, light, off, exact, errors, matrix, limits,
    count,
):  # fmt: skip
    """
    Move points over their faces, and note in ``exact`` which are doubtful, in ``errors`` how far.

    Returns not 0 if any of ``count`` is.
    """
    found = np.int32(0)
    for n in range(px.shape[0]):
        w1, w2 = second[n], third[n]
        ux, uy, uz = turned(xb[n], yb[n], zb[n], matrix)
        vx, vy, vz = turned(xc[n], yc[n], zc[n], matrix)
        moved = max(square(ux, uy, uz), square(vx, vy, vz))
        first = square(px[n], py[n], pz[n])
        errors[n] = point_error(first, moved)
        own = limits_on_face(light[n], off[n], limits)
        least = least_distance(first, moved, own[2])
        least = least if own[3] else np.float32(np.inf)
        x, y, z = (
            px[n] + (w1 * ux + w2 * vx), py[n] + (w1 * uy + w2 * vy), pz[n] + (w1 * uz + w2 * vz)
        )  # fmt: skip
        px[n], py[n], pz[n] = x, y, z
        is_unsure = is_doubtful(x, y, z, least) & (np.int32(n) < count)
        exact[n] = np.float32(1.0 if is_unsure else 0.0)
        found = np.int32(found | np.int32(is_unsure))
    return found


@disjoint_helper
def hold_to_faces(first, second, third, exact_second, exact_third):
    """Take weights in float64, rounded, where samples lie beside their faces."""
    f = np.float32
    for n in range(first.shape[0]):
        is_beside = min(first[n], min(second[n], third[n])) < f(0.0)
        w1, w2 = exact_second[n], exact_third[n]
        first[n] = f(1.0 - w1 - w2) if is_beside else first[n]
        second[n] = f(w1) if is_beside else second[n]
        third[n] = f(w2) if is_beside else third[n]


@helper
def lay_patches(segment, owned, block, geometry, placement, look, has_wide):
    """
    Write the samples of a mixed segment, a face for each lane.

    Returns not 0 if any may be doubtful, or lies on a face whose weights are found otherwise; then
    what was written does not count.
    """
    if weigh_mixed(segment, block, geometry, has_wide) != 0:
        return np.int32(1)
    (owner, turn, matrix, base), (normals, colors, lamps, _, _, limits) = owned, look
    s, count = np.int64(segment[START]), np.int32(segment[STOP] - segment[START])
    e = s + whole_vectors(count)
    samples, weights, v, p = block.samples, block.float32_weights, block.single, block.real
    whole, patches = block.whole, (segment[FIRST_PATCH], segment[END_PATCH])
    first, second, third = (
        part(weights, 0, s, e), part(weights, 1, s, e), part(weights, 2, s, e)
    )  # fmt: skip
    if geometry.viewport.reach != 0:
        exact = block.weights
        hold_to_faces(first, second, third, part(exact, 0, s, e), part(exact, 1, s, e))
    red, green, blue = (
        part(samples, row.RED, s, e), part(samples, row.GREEN, s, e), part(samples, row.BLUE, s, e)
    )  # fmt: skip
    if colors.shape[0] == 0:
        mix_base(red, green, blue, base)
    else:
        gather_values(patches[0], patches[1], colors, whole, v)
        mix_colors(
            red, green, blue, part(v, 0, s, e), part(v, 1, s, e), part(v, 2, s, e),
            part(v, 3, s, e), part(v, 4, s, e), part(v, 5, s, e), part(v, 6, s, e),
            part(v, 7, s, e), part(v, 8, s, e), first, second, third, base,
        )  # fmt: skip
    gather_values(patches[0], patches[1], placement.positions, whole, p)
    px, py, pz = (
        part(samples, row.POINT_X, s, e), part(samples, row.POINT_Y, s, e),
        part(samples, row.POINT_Z, s, e),
    )  # fmt: skip
    xa, ya, za = part(p, 0, s, e), part(p, 1, s, e), part(p, 2, s, e)
    ways = (
        part(v, 0, s, e), part(v, 1, s, e), part(v, 2, s, e), part(v, 3, s, e), part(v, 4, s, e),
        part(v, 5, s, e),
    )  # fmt: skip
    round_ways(
        xa, ya, za, part(p, 3, s, e), part(p, 4, s, e), part(p, 5, s, e), part(p, 6, s, e),
        part(p, 7, s, e), part(p, 8, s, e), *ways,
    )  # fmt: skip
    place_first(px, py, pz, xa, ya, za, owner, placement.relative_from_model)
    light, off, exact = (
        part(block.shares, LIGHT, s, e), part(block.shares, OFF, s, e),
        part(block.shares, EXACT, s, e),
    )  # fmt: skip
    start_lamps(light, off)
    if lamps.shape[0] > 0:
        faces = (
            part(block.colors, 0, s, e), part(block.colors, 1, s, e), part(block.colors, 2, s, e),
            part(block.colors, 3, s, e), part(block.colors, 4, s, e),
        )  # fmt: skip
        measure_faces(px, py, pz, *ways, *faces, matrix)
        for n in range(lamps.shape[0]):
            add_lamp(px, py, pz, *ways, *faces, light, off, lamps[n], matrix, limits[1])
    errors = part(block.colors, NORMAL_ERRORS, s, e), part(block.colors, POINT_ERRORS, s, e)
    unsure = move_points(
        px, py, pz, *ways, second, third, light, off, exact, errors[1], matrix, limits, count
    )  # fmt: skip
    sides = first
    find_sides(
        part(whole, AX, s, e), part(whole, AY, s, e), part(whole, BX, s, e), part(whole, BY, s, e),
        part(whole, CX, s, e), part(whole, CY, s, e), placement.front_turns[owner], sides,
    )  # fmt: skip
    gather_values(patches[0], patches[1], normals, whole, v)
    unsure |= mix_normals(
        part(samples, row.NORMAL_X, s, e), part(samples, row.NORMAL_Y, s, e),
        part(samples, row.NORMAL_Z, s, e), part(v, 0, s, e), part(v, 1, s, e), part(v, 2, s, e),
        part(v, 3, s, e), part(v, 4, s, e), part(v, 5, s, e), part(v, 6, s, e), part(v, 7, s, e),
        part(v, 8, s, e), sides, second, third, light, off, exact, errors[0], turn, limits, count,
    )  # fmt: skip
    if limits[1][GLOSS] != MATT and note_steep_samples(s, e, look, block) != 0:
        unsure |= mark_steep(s, e, count, look, block)
    if (unsure != 0) & (lamps.shape[0] == 0):
        mend_patches(segment, owner, sides, block, geometry, placement, normals)
    return np.int32(0)


@helper
def mend_patches(segment, owner, sides, block, geometry, placement, normals):
    """Find normals and points of the doubtful samples of a mixed segment in float64."""
    whole = block.whole
    for r in range(np.uintp(segment[FIRST_PATCH]), np.uintp(segment[END_PATCH])):
        corner = np.uintp(whole[A, r]), np.uintp(whole[B, r]), np.uintp(whole[C, r])
        for n in range(np.uintp(whole[FIRST, r]), np.uintp(whole[FIRST, r + np.uintp(1)])):
            if block.shares[EXACT, n] != SURE:
                pixel = np.int64(whole[COLUMN, n]), np.int64(whole[ROW, n])
                side = sides[n - np.uintp(segment[START])]
                mend(
                    n, n + np.uintp(1), corner, pixel, owner, side, block, geometry, placement,
                    normals,
                )  # fmt: skip


@helper
def bounds_of(own):
    """Return the limits of an object: on faces that no lamp reaches, and on others."""
    n = BY_LAMPS
    return (own[0], own[1], own[2]), (
        own[n], own[n + 1], own[n + 2], own[n + 3], own[n + 4], own[n + 5], own[n + 6], own[n + 7],
        own[n + 8], own[n + 9], own[n + 10], own[n + 11],
    )  # fmt: skip


@stage
def find_float32_surface(
    block: Block, count, geometry: Geometry, placement: Placement, normals: float32[:, ::1],
    materials: float32[:, ::1], colors: float32[:, ::1], lamps: float32[:, ::1],
    lights: float32[:, ::1], limits: float32[:, ::1],
):  # fmt: skip
    """
    Write base colours, normals and points of samples in float32.

    After `find_weights` where samples may lie beside their faces.
    ``colors`` are those of the vertices, (V, 4) or (0, 4); ``lamps``, (P, 18), see ``lamps``;
    ``lights``, (L, 13), those that shine; ``limits``, (O, 15), see
    ``survey.precision.limits_of_all``: nothing is written of objects that take float64.
    """
    has_wide = may_be_wide(geometry.viewport)
    f, toward = np.float32, placement.toward_viewer
    viewer = f(toward[0]), f(toward[1]), f(toward[2]), f(toward[3])
    if block.counts[KNOWS_PLANES] == 0:
        for n in range(PLANES):
            block.faces[0, n] = np.int32(-1)
        block.counts[KNOWS_PLANES] = 1
    if lamps.shape[0] > 0:
        fill_row(part(block.shares, EXACT, 0, count), SURE)
    for k in range(block.counts[SEGMENTS]):
        segment = block.segments[k]
        owner = np.uintp(segment[OWNER])
        own, s, e = limits[owner], np.int64(segment[START]), np.int64(segment[STOP])
        if own[0] < np.float32(0.0):
            fill_row(part(block.shares, EXACT, s, e), FOREIGN)
            continue
        look = normals, colors, lamps, lights, viewer, bounds_of(own)
        owned = (
            owner, rounded(matrix_of(placement.normal_matrices, owner)),
            rounded(matrix_of(placement.relative_from_model, owner)),
            (materials[owner, 0], materials[owner, 1], materials[owner, 2]),
        )  # fmt: skip
        is_short = (segment[KIND] != SPAN) & (
            np.float64(segment[STOP] - segment[START])
            < LONG_RUN * np.float64(segment[END_PATCH] - segment[FIRST_PATCH])
        )
        unsure = np.int32(1)
        if is_short:
            unsure = lay_patches(segment, owned, block, geometry, placement, look, has_wide)
        if unsure != 0:
            lay_runs(segment, owned, block, geometry, placement, look, has_wide)
        if lamps.shape[0] == 0:
            # Those in doubt are found already.
            fill_row(part(block.shares, EXACT, s, e), SURE)
