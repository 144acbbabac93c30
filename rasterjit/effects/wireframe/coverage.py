"""
Draw antialiased lines by area coverage.

A line is a rectangle one pixel wide. Its flat ends lie half a pixel beyond its two end points, as
the first and the last pixel of a Bresenham line reach beyond them: so lines that continue each
other leave no gap, and one of length 0 is a dot. All lines have one colour, so the largest coverage
by one of them counts at a pixel: neither their order nor that of threads matters, and a line that
is drawn twice looks like one. Then the colour is blended over the picture by that coverage.

The part of a pixel on one side of a straight line is a sum of squares of the distance to the
pixel's centre (`find_side_area`). Between the two long sides of a line it is the difference of two
of these, between its ends of two others. Their product is the area that the line covers: exactly
where one of both factors is 0 or 1, that is all along the line. Where an end and a long side cut
one pixel the product is off by less than 1/40 of the pixel.

Both factors depend on the distances from the middle of the line, without their signs, and are made
of exact differences and of products whose signs alone change when a picture is mirrored or turned
by right angles, or when a line is given from its other end: so the bits are the same.

A pixel is hidden where the line's point nearest to the pixel's centre lies behind the surface
there, by more than that surface's change of depth in between (``stage.fill_slack``).

References
----------
.. [1] S. Gupta and R. Sproull, "Filtering Edges for Gray-Scale Displays", SIGGRAPH 1981: lines of
   one pixel by the part of each pixel that they cover.
"""

from __future__ import annotations

import numpy as np

from rasterjit.effects.wireframe.stage import cut_segment, divide_by_w, write_depths
from rasterjit.pipeline.fragments.srgb_compositing import composite_over as over_codes
from rasterjit.pipeline.geometry.projection import snap_vertex
from rasterjit.pipeline.geometry.setup import CLIPPED, FAR, INVALID, NEAR, get_picture_size
from rasterjit.pipeline.records import Geometry, Viewport
from rasterjit.pipeline.srgb_encoding import composite_over, encode_alpha, encode_pixel
from rasterjit.runtime.jit import disjoint_helper, helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64, uint32

HALF_WIDTH_PX = 0.5
"""Half the width of a line, pixels, and its extension beyond both end points."""

BAND_BITS = 5
"""Binary logarithm of a band's rows: a band's coverage stays in L2."""

BAND_ROWS = 1 << BAND_BITS

PIXELS_PER_GROUP = 8
"""Pixels of a row that are covered together: the float64 lanes of a vector register."""

MARGIN_PX = 1.0 / 16.0
"""Margin, pixels, so that rounding never excludes a covered pixel."""

MAX_SIDE_DISTANCE_PX = 1.25
"""Largest distance from a line to the centres of pixels that it covers, pixels in x or y."""


@helper
def snap_end(x, y, w, viewport):
    """Snap a clip position in front of the eye to the sub-pixel grid."""
    x, y = divide_by_w(x, y, w, viewport)
    width, height = get_picture_size(viewport)
    return snap_vertex(x, y, (1.0, 0.5 * width, 0.5 * height), viewport)


@helper
def project_edge(start, stop, line, ends, depths, depth_coefficients, geometry):
    """Clip an edge and write its ends, sub-pixel grid, and depths; return whether any is left."""
    viewport, codes = geometry.viewport, geometry.codes
    a, b = geometry.clip_positions[start], geometry.clip_positions[stop]
    if (codes[start] | codes[stop]) & CLIPPED:
        is_seen, cut_a, cut_b = cut_segment(a, b, viewport)
        if not is_seen:
            return False
        ends[line, 0], ends[line, 1] = snap_end(cut_a[0], cut_a[1], cut_a[3], viewport)
        ends[line, 2], ends[line, 3] = snap_end(cut_b[0], cut_b[1], cut_b[3], viewport)
        write_depths(depths, line, cut_a, cut_b, depth_coefficients)
        return True
    ends[line, 0], ends[line, 1] = geometry.xy[start, 0], geometry.xy[start, 1]
    ends[line, 2], ends[line, 3] = geometry.xy[stop, 0], geometry.xy[stop, 1]
    write_depths(depths, line, a, b, depth_coefficients)
    return True


@helper
def find_bands(ends, line, reach, viewport):
    """
    Return the first and the last band that a line may touch; first > last if there is none.

    It reaches less than ``reach``, units of the sub-pixel grid, beyond its ends.
    """
    bits = viewport.grid_bits
    left, right = min(ends[line, 0], ends[line, 2]), max(ends[line, 0], ends[line, 2])
    top, bottom = min(ends[line, 1], ends[line, 3]), max(ends[line, 1], ends[line, 3])
    if right + reach < 0 or (left - reach) >> bits >= viewport.width:
        return np.int64(1), np.int64(0)
    first = max((top - reach) >> bits, np.int64(0))
    last = min((bottom + reach) >> bits, np.int64(viewport.height - 1))
    return first >> BAND_BITS, last >> BAND_BITS


@kernel
def project_lines(
    edges: int32[:, ::1], first: int64, geometry: Geometry,
    depth_coefficients: (float64, float64, float64), reach: int64, ends: int32[:, ::1],
    depths: float64[:, ::1], counts: int32[::1],
):  # fmt: skip
    """
    Clip edges, find their ends on the sub-pixel grid, and count the lines that touch each band.

    Parameters
    ----------
    edges : (N, 2) int32, vertex numbers
    first : int
        Number of the first line to write.
    geometry : Geometry
        With clip positions.
    depth_coefficients : (float, float, float)
        The stored depth is ``(c0 + c1 z + c2 w) / w``; greater is nearer.
    reach : int
        How far lines reach at most beyond their ends, units of the sub-pixel grid.
    ends : (E, 4) int32, units of the sub-pixel grid
        Writes x0, y0, x1, y1 of the edges that may be seen, side by side from ``first`` on.
    depths : (E, 2) float64, or (0, 2)
        Writes the stored depth at both ends, if there is room.
    counts : (bands + 1,) int32
        Added to; the last column is left.

    Returns
    -------
    int
        Number of lines written.
    """
    viewport, codes = geometry.viewport, geometry.codes
    line = np.int64(first)
    for n in range(np.uintp(edges.shape[0])):
        start, stop = np.uintp(edges[n, 0]), np.uintp(edges[n, 1])
        code_a, code_b = codes[start], codes[stop]
        # A line beside the picture may reach into it, so that only depth culls lines here.
        if (code_a | code_b) & INVALID or code_a & code_b & (NEAR | FAR):
            continue
        if not project_edge(start, stop, line, ends, depths, depth_coefficients, geometry):
            continue
        top, bottom = find_bands(ends, line, reach, viewport)
        for band in range(top, bottom + 1):
            counts[band] += 1
        line += np.int64(top <= bottom)
    return line - np.int64(first)


@kernel
def list_lines(
    lines: (int64, int64), ends: int32[:, ::1], reach: int64, viewport: Viewport,
    cursors: int64[::1], line_list: int32[::1],
):  # fmt: skip
    """
    Write each line into the list of every band that it may touch.

    Parameters
    ----------
    lines : (int, int)
        The first, and one past the last.
    ends : (E, 4) int32, units of the sub-pixel grid
    reach : int
        As `project_lines` takes it.
    viewport : Viewport
    cursors : (bands,) int64
        Where the next line goes in each band's list. Advanced.
    line_list : (M,) int32
        Writes numbers of lines.
    """
    for line in range(lines[0], lines[1]):
        top, bottom = find_bands(ends, line, reach, viewport)
        for band in range(top, bottom + 1):
            line_list[np.uintp(cursors[band])] = np.int32(line)
            cursors[band] += 1


@helper
def make_profile(along_x, along_y):
    """
    Return the coverage of a pixel by a half-plane as a function of distance, by its direction.

    Returns the distance from which coverage is constant, the one up to which it is linear, and the
    factors of both parts.
    """
    long = max(abs(along_x), abs(along_y))
    short = min(abs(along_x), abs(along_y))
    product = 2.0 * long * short
    return (
        np.float32(0.5 * (long + short)),
        np.float32(0.5 * (long - short)),
        np.float32(1.0 / long),
        np.float32(1.0 / product if product > 0.0 else 0.0),
    )


@helper
def find_side_area(distance, profile):
    """Return the area of a pixel between its centre and a line at a signed distance."""
    outer, inner, per_long, per_product = profile
    far = abs(distance)
    far = far if far < outer else outer
    rest = outer - far
    part = far * per_long if far <= inner else np.float32(0.5) - rest * rest * per_product
    return part if distance > np.float32(0.0) else -part


@helper
def compute_coverage(along, across, half_length, profile):
    """Return a pixel's coverage, from its centre's distances along and across a line."""
    half, aside = np.float32(HALF_WIDTH_PX), np.float32(across)
    ahead, behind = np.float32(half_length - along), np.float32(half_length + along)
    between_sides = find_side_area(half - aside, profile) + find_side_area(half + aside, profile)
    between_ends = find_side_area(ahead, profile) + find_side_area(behind, profile)
    return between_sides * between_ends


@helper
def mask_hidden(coverage, along, i, ramp, depth, slack):
    """Return the coverage of a pixel, or 0 where a surface hides the line."""
    middle, gain, half = ramp
    along = along if along > -half else -half
    along = along if along < half else half
    line_depth = middle + along * gain
    allowed = np.float64(depth[i]) - MAX_SIDE_DISTANCE_PX * np.float64(slack[i])
    return coverage if line_depth >= allowed else np.float32(0.0)


@disjoint_helper
def cover_run(area, x, y_along, y_across, direction, half_length, profile, ramp, depth, slack):
    """Raise the coverage of some pixels of a row to a line's, without branches."""
    along_x, along_y = direction
    for i in range(area.shape[0]):
        # The sum of an integer and a multiple of half a grid unit is exact.
        column = x + np.float64(np.int32(i))
        along = column * along_x + y_along
        across = abs(column * along_y - y_across)
        value = compute_coverage(abs(along), across, half_length, profile)
        value = mask_hidden(value, along, i, ramp, depth, slack)
        area[i] = value if value > area[i] else area[i]


@helper
def find_depth_ramp(depths, line, length):
    """Return depth at the middle of a line, its change a pixel, and half the line's length."""
    if depths.shape[0] == 0:
        return 0.0, 0.0, 0.0
    near, far = depths[line, 0], depths[line, 1]
    # Of a line seen end-on, the nearer end is visible.
    if length == 0.0:
        return max(near, far), 0.0, 0.0
    return 0.5 * (near + far), (far - near) / length, 0.5 * length


@helper
def find_strip(across, along, reach):
    """Return slope and half width of the columns ``x`` with ``|x across - y along| <= reach``."""
    if across == 0.0:
        return 0.0, np.inf
    return along / across, reach / abs(across)


@helper
def widen_to_groups(low, high, width):
    """Return the first column of low..high and one past the last, widened to whole groups."""
    first, stop = np.int64(np.ceil(low)), np.int64(np.floor(high)) + 1
    if first >= stop:
        return np.int64(0), np.int64(0)
    columns = ((stop - first - 1) | (PIXELS_PER_GROUP - 1)) + 1
    first = max(min(first, width - columns), np.int64(0))
    return first, min(first + columns, width)


@helper
def cover_line(line, ends, depths, rows, viewport, depth, slack, area):
    """Raise the coverage of the pixels of a band to a line's."""
    x0, y0 = np.int64(ends[line, 0]), np.int64(ends[line, 1])
    x1, y1 = np.int64(ends[line, 2]), np.int64(ends[line, 3])
    per_pixel = 1.0 / np.float64(np.int64(1) << viewport.grid_bits)
    dx, dy = np.float64(x1 - x0), np.float64(y1 - y0)
    steps = np.sqrt(dx * dx + dy * dy)
    along_x = dx / steps if steps > 0.0 else 1.0
    along_y = dy / steps if steps > 0.0 else 0.0
    length = steps * per_pixel
    half_length, profile = 0.5 * length + HALF_WIDTH_PX, make_profile(along_x, along_y)
    ramp, direction = find_depth_ramp(depths, line, length), (along_x, along_y)
    # Express positions relative to the middle of the line.
    middle_x = 0.5 - np.float64(x0 + x1) * (0.5 * per_pixel)
    middle_y = 0.5 - np.float64(y0 + y1) * (0.5 * per_pixel)
    reach = np.float64(profile[0]) + MARGIN_PX
    down = (half_length + reach) * abs(along_y) + (HALF_WIDTH_PX + reach) * abs(along_x)
    sides = find_strip(along_y, along_x, HALF_WIDTH_PX + reach)
    tips = find_strip(along_x, -along_y, half_length + reach)
    top = max(np.int64(np.ceil(-down - middle_y)), np.int64(rows[0]))
    bottom = min(np.int64(np.floor(down - middle_y)), np.int64(rows[1]) - 1)
    for row in range(top, bottom + 1):
        y = np.float64(row) + middle_y
        y_along, y_across = y * along_y, y * along_x
        aside, ahead = y * sides[0] - middle_x, y * tips[0] - middle_x
        low = max(max(aside - sides[1], ahead - tips[1]), 0.0)
        high = min(min(aside + sides[1], ahead + tips[1]), np.float64(viewport.width - 1))
        first, stop = widen_to_groups(low, high, viewport.width)
        if first < stop:
            # Without occluders, depth has a single row.
            depth_row = min(row, depth.shape[0] - 1)
            cover_run(
                area[row - rows[0], first:stop], np.float64(first) + middle_x, y_along, y_across,
                direction, half_length, profile, ramp, depth[depth_row, first:stop],
                slack[depth_row, first:stop],
            )  # fmt: skip


@kernel
def cover_lines(
    line_list: int32[::1], ends: int32[:, ::1], depths: float64[:, ::1], rows: (int64, int64),
    viewport: Viewport, depth: float32[:, ::1], slack: float32[:, ::1], area: float32[:, ::1],
):  # fmt: skip
    """
    Find the coverage of each pixel of a band by visible lines.

    Parameters
    ----------
    line_list : (M,) int32
        Numbers of the lines that may touch the band.
    ends : (E, 4) int32, units of the sub-pixel grid
    depths : (E, 2) float64, or (0, 2): nothing hides lines
        Stored depth at both ends. A NaN hides the whole line.
    rows : (int, int)
        The band's first row, and one past the last.
    viewport : Viewport
    depth : (H, W) float32, or (1, W) of -inf: nothing hides lines
        Stored depth of the occluding surfaces, greater is nearer.
    slack : float32, of the shape of ``depth``
        Change of ``depth`` to the next column plus that to the next row.
    area : (R, W) float32
        Written: the share of each pixel, 0..1.
    """
    for row in range(area.shape[0]):
        for i in range(area.shape[1]):
            area[row, i] = 0.0
    for n in range(line_list.shape[0]):
        cover_line(line_list[n], ends, depths, rows, viewport, depth, slack, area)


@helper
def blend_pixel(coverage, rgba, linear, pixel, light, table):
    """Return a pixel blended with the line's colour; see `blend_lines`."""
    if light.shape[0] == 0:
        front = np.uint32((rgba & np.uint32(0xFFFFFF)) | encode_alpha(coverage) << np.uint32(24))
        return over_codes(front, pixel)
    back = (
        light[np.uintp(pixel & np.uint32(255))],
        light[np.uintp((pixel >> np.uint32(8)) & np.uint32(255))],
        light[np.uintp((pixel >> np.uint32(16)) & np.uint32(255))],
        np.float32(pixel >> np.uint32(24)) / np.float32(255.0),
    )
    return encode_pixel(composite_over(coverage, linear, back), table)


@helper
def decode_light(rgba, light):
    """Return the linear colour of a pixel; black if codes are mixed."""
    if light.shape[0] == 0:
        return np.float32(0.0), np.float32(0.0), np.float32(0.0)
    return (
        light[np.uintp(rgba & np.uint32(255))],
        light[np.uintp((rgba >> np.uint32(8)) & np.uint32(255))],
        light[np.uintp((rgba >> np.uint32(16)) & np.uint32(255))],
    )


@kernel
def blend_lines(
    area: float32[:, ::1], rgba: uint32[::1], light: float32[::1], table: int32[::1],
    color: uint32[:, ::1],
):  # fmt: skip
    """
    Blend the colour of the lines over a band by coverage.

    Parameters
    ----------
    area : (R, W) float32
    rgba : (1,) uint32
        Opaque; red in the lowest byte.
    light : (256,) float32, or (0,): codes are mixed, not light
        Linear light of each code.
    table : (65536,) int32, `srgb_encoding.make_encoding_table`
    color : (R, W) uint32
        Changed where lines are.
    """
    linear = decode_light(rgba[0], light)
    for row in range(area.shape[0]):
        for i in range(np.uintp(area.shape[1])):
            if area[row, i] > np.float32(0.0):
                color[row, i] = blend_pixel(
                    area[row, i], rgba[0], linear, color[row, i], light, table
                )
