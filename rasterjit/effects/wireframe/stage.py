"""
Project the edges of faces to lines between pixels.

A segment is cut where a triangle is: at the near and far planes and the guard band, in homogeneous
clip space, before the divide. Its ends then go to the pixels that hold them.

A pixel of a line lies up to one pixel beside the edge itself, so the surface that the edge belongs
to may be nearer there by its own slope. ``fill_slack`` writes that difference for the face seen at
each pixel: the change of depth over one pixel in x plus one in y, at most the face's whole range.

References
----------
.. [1] Y.-D. Liang and B. Barsky, "A New Concept and Method for Line Clipping", TOG 3(1), 1984.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.bresenham import draw_run, draw_visible_run, enter_line, pack_channels
from rasterjit.pipeline.geometry.clipping import PLANE_COUNT, plane_distance
from rasterjit.pipeline.geometry.projection import compute_stored_depth
from rasterjit.pipeline.geometry.setup import CLIPPED, FRUSTUM, INVALID, get_picture_size
from rasterjit.pipeline.records import Geometry, Viewport
from rasterjit.runtime.intrinsics import flat
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64, uint8, uint32

DEPTH_ROUNDING = np.float32(1e-6)
"""Slack for the rounding of float32 depths, as a share of the depth: 8 ulp."""


NO_PLANE = -1
"""In place of the number of the plane that cut an end."""


@helper
def find_inside_part(a, b, viewport):
    """Return the part (t0, t1) of a segment inside all planes, and the planes that cut its ends."""
    t0, t1 = 0.0, 1.0
    plane0 = plane1 = NO_PLANE
    for plane in range(PLANE_COUNT):
        here = plane_distance(plane, a, viewport.guard_x, viewport.guard_y)
        there = plane_distance(plane, b, viewport.guard_x, viewport.guard_y)
        if not here >= 0.0 and not there >= 0.0:
            return 1.0, 0.0, plane, plane
        if not here >= 0.0 and here / (here - there) > t0:
            t0, plane0 = here / (here - there), plane
        elif not there >= 0.0 and here / (here - there) < t1:
            t1, plane1 = here / (here - there), plane
    return t0, t1, plane0, plane1


@helper
def cut_end(a, b, end, plane, viewport, k):
    """
    Return component k of one end of a segment, or of the plane's cut.

    The cut is the mean of both ends, weighted crosswise with their distances: swapping the ends
    only flips the signs of both terms, so it has the same bits in both directions.
    """
    if plane == NO_PLANE:
        return end[k]
    here = plane_distance(plane, a, viewport.guard_x, viewport.guard_y)
    there = plane_distance(plane, b, viewport.guard_x, viewport.guard_y)
    return (a[k] * there - b[k] * here) / (there - here)


@helper
def cut_segment(a, b, viewport):
    """
    Cut a segment of clip space, (4,) float64 each end, at all planes.

    Returns whether any of it may be seen, and the clip positions (x, y, z, w) of both ends.
    """
    t0, t1, plane0, plane1 = find_inside_part(a, b, viewport)
    if t0 > t1:
        return False, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
    first = (
        cut_end(a, b, a, plane0, viewport, 0), cut_end(a, b, a, plane0, viewport, 1),
        cut_end(a, b, a, plane0, viewport, 2), cut_end(a, b, a, plane0, viewport, 3),
    )  # fmt: skip
    second = (
        cut_end(a, b, b, plane1, viewport, 0), cut_end(a, b, b, plane1, viewport, 1),
        cut_end(a, b, b, plane1, viewport, 2), cut_end(a, b, b, plane1, viewport, 3),
    )  # fmt: skip
    return first[3] > 0.0 and second[3] > 0.0, first, second


@helper
def divide_by_w(x, y, w, viewport):
    """Return x and y of a clip position over its w, clamped to the guard band."""
    # Rounding may leave a cut end a little outside the guard band, or far if w cancels.
    x = min(max(x / w, -viewport.guard_x), viewport.guard_x)
    y = min(max(y / w, -viewport.guard_y), viewport.guard_y)
    return x, y


@helper
def find_pixel(x, y, w, viewport):
    """Return column and row of the pixel that holds a clip position in front of the eye."""
    x, y = divide_by_w(x, y, w, viewport)
    width, height = get_picture_size(viewport)
    column = np.floor((x + 1.0) * (0.5 * width)) - viewport.left
    row = np.floor((1.0 - y) * (0.5 * height)) - viewport.top
    return np.int32(column), np.int32(row)


@helper
def write_depths(depths, n, a, b, depth_coefficients):
    """Write the stored depth of both ends, given in clip space, if ``depths`` has room."""
    if depths.shape[0] != 0:
        depths[n, 0] = compute_stored_depth(a[2], a[3], depth_coefficients)
        depths[n, 1] = compute_stored_depth(b[2], b[3], depth_coefficients)


@kernel
def find_pixels(
    vertices: (int64, int64), clip_positions: float64[:, ::1], codes: uint8[:],
    viewport: Viewport, pixels: int32[:, ::1],
):  # fmt: skip
    """
    Find the pixels that hold the vertices.

    Parameters
    ----------
    vertices : (int, int)
        The first, and one past the last.
    clip_positions : (V, 4) float64, clip space
    codes : (V,) uint8, outcodes
    viewport : Viewport
    pixels : (V, 2) int32
        Writes column and row of these vertices; any pixel for one that needs clipping.
    """
    for vertex in range(np.uintp(vertices[0]), np.uintp(vertices[1])):
        is_away = (codes[vertex] & (CLIPPED | INVALID)) != 0
        x = 0.0 if is_away else clip_positions[vertex, 0]
        y = 0.0 if is_away else clip_positions[vertex, 1]
        w = 1.0 if is_away else clip_positions[vertex, 3]
        pixels[vertex, 0], pixels[vertex, 1] = find_pixel(x, y, w, viewport)


@kernel
def project_edges(
    edges: int32[:, ::1], vertices: (float64[:, ::1], uint8[:], int32[:, ::1]),
    depth_coefficients: (float64, float64, float64), viewport: Viewport, ends: int32[:, ::1],
    depths: float64[:, ::1],
):  # fmt: skip
    """
    Clip edges and find the pixels at their ends.

    Parameters
    ----------
    edges : (N, 2) int32, vertex numbers
    vertices : (clip_positions (V, 4) float64, codes (V,) uint8, pixels (V, 2) int32)
        Clip positions, outcodes, and pixels from `find_pixels`.
    depth_coefficients : (float, float, float)
        The stored depth is ``(c0 + c1 z + c2 w) / w``; greater is nearer.
    viewport : Viewport
    ends : (N, 4) int32
        Writes the pixels x0, y0, x1, y1 of the edges that may be seen, packed to the front; all
        lie within the guard band.
    depths : (N, 2) float64, or (0, 2)
        Writes the stored depth at both ends, if there is room.

    Returns
    -------
    int
        Number of edges written.
    """
    clip_positions, codes, pixels = vertices
    count = np.uintp(0)
    for n in range(np.uintp(edges.shape[0])):
        first, second = np.uintp(edges[n, 0]), np.uintp(edges[n, 1])
        code_a, code_b = codes[first], codes[second]
        if (code_a | code_b) & INVALID or code_a & code_b & FRUSTUM:
            continue
        a, b = clip_positions[first], clip_positions[second]
        if (code_a | code_b) & CLIPPED:
            is_seen, cut_a, cut_b = cut_segment(a, b, viewport)
            if not is_seen:
                continue
            ends[count, 0], ends[count, 1] = find_pixel(cut_a[0], cut_a[1], cut_a[3], viewport)
            ends[count, 2], ends[count, 3] = find_pixel(cut_b[0], cut_b[1], cut_b[3], viewport)
            write_depths(depths, count, cut_a, cut_b, depth_coefficients)
        else:
            ends[count, 0], ends[count, 1] = pixels[first, 0], pixels[first, 1]
            ends[count, 2], ends[count, 3] = pixels[second, 0], pixels[second, 1]
            write_depths(depths, count, a, b, depth_coefficients)
        count += np.uintp(1)
    return np.int64(count)


@kernel
def draw_edges(
    target: uint32[:, ::1], depth: float32[:, ::1], slack: float32[:, ::1], ends: int32[:, ::1],
    line_depths: float64[:, ::1], rgba: uint8[::1],
):  # fmt: skip
    """
    Draw lines of one colour that do not hide each other.

    The order of lines, and other threads that draw in this colour, do not change any pixel.

    Parameters
    ----------
    target : (H, W) uint32, C-contiguous
        RGBA pixels, red in the lowest byte. Written.
    depth : (H, W) float32
        Stored depth of the occluding surfaces, greater is nearer. Not read without ``line_depths``.
    slack : (H, W) float32
        Largest distance behind ``depth`` at which a pixel is drawn. ``depth - slack`` must not be
        NaN. Not read without ``line_depths``.
    ends : (N, 4) int32
        As `project_edges` writes them.
    line_depths : (N, 2) float64, or (0, 2): nothing hides lines
        Stored depth at both ends. A NaN hides the whole line.
    rgba : (4,) uint8
    """
    height, width = target.shape
    pixels, stored, allowed = flat(target), flat(depth), flat(slack)
    pixel = pack_channels(
        (np.int64(rgba[0]), np.int64(rgba[1]), np.int64(rgba[2]), np.int64(rgba[3]))
    )
    is_hidden = line_depths.shape[0] != 0
    for line in range(np.uintp(ends.shape[0])):
        line_ends = (
            np.int64(ends[line, 0]),
            np.int64(ends[line, 1]),
            np.int64(ends[line, 2]),
            np.int64(ends[line, 3]),
        )
        run, minor, minor_gain, steps, _ = enter_line(line_ends, width, height)
        if run[0] > run[1]:
            continue
        if is_hidden:
            near, far = line_depths[line, 0], line_depths[line, 1]
            ramp = near, (far - near) / np.float64(max(steps, 1))
            draw_visible_run(pixels, stored, allowed, ramp, run, minor, minor_gain, pixel)
        else:
            draw_run(pixels, run, minor, minor_gain, pixel)


@helper
def compute_depth_slope(p, q, r, coefficients, viewport):
    """
    Return the change of stored depth over one pixel in x plus that over one pixel in y.

    Depth times w is linear in clip x, y, w: solve for its coefficients by Cramer's rule.
    """
    c0, c1, c2 = coefficients
    d0 = c0 + c1 * p[2] + c2 * p[3]
    d1 = c0 + c1 * q[2] + c2 * q[3]
    d2 = c0 + c1 * r[2] + c2 * r[3]
    determinant = (
        p[0] * (q[1] * r[3] - r[1] * q[3])
        - q[0] * (p[1] * r[3] - r[1] * p[3])
        + r[0] * (p[1] * q[3] - q[1] * p[3])
    )
    if determinant == 0.0:
        return 0.0
    along_x = (
        d0 * (q[1] * r[3] - r[1] * q[3])
        - d1 * (p[1] * r[3] - r[1] * p[3])
        + d2 * (p[1] * q[3] - q[1] * p[3])
    ) / determinant
    along_y = (
        p[0] * (d1 * r[3] - d2 * q[3])
        - q[0] * (d0 * r[3] - d2 * p[3])
        + r[0] * (d0 * q[3] - d1 * p[3])
    ) / determinant
    width, height = get_picture_size(viewport)
    return 2.0 * abs(along_x) / width + 2.0 * abs(along_y) / height


@helper
def compute_face_slack(corners, clip_positions, depth_coefficients, viewport):
    """Return how much nearer a face may be than its edge, at a pixel beside the edge."""
    p, q, r = clip_positions[corners[0]], clip_positions[corners[1]], clip_positions[corners[2]]
    allowed = np.float32(compute_depth_slope(p, q, r, depth_coefficients, viewport))
    if p[3] > 0.0 and q[3] > 0.0 and r[3] > 0.0:
        d0 = compute_stored_depth(p[2], p[3], depth_coefficients)
        d1 = compute_stored_depth(q[2], q[3], depth_coefficients)
        d2 = compute_stored_depth(r[2], r[3], depth_coefficients)
        span = max(d0, max(d1, d2)) - min(d0, min(d1, d2))
        allowed = min(allowed, np.float32(span))
    return allowed


@kernel
def fill_slack(
    face_id: int32[:, ::1], rows: (int64, int64), depth: float32[:, ::1], geometry: Geometry,
    depth_coefficients: (float64, float64, float64), slack: float32[:, ::1],
):  # fmt: skip
    """
    Write the largest distance behind the stored depth at which a line is visible.

    Parameters
    ----------
    face_id : (H, W) int32
    rows : (int, int)
        The first row, and one past the last.
    depth : (H, W) float32, stored depth
    geometry : Geometry
    depth_coefficients : (float, float, float)
    slack : (H, W) float32
        Writes these rows; 0 where nothing is.
    """
    last_face, allowed = np.int32(-1), np.float32(0.0)
    for row in range(rows[0], rows[1]):
        for column in range(face_id.shape[1]):
            face = face_id[row, column]
            if face < 0:
                slack[row, column] = 0.0
                continue
            # Neighbours mostly show the same face.
            if face != last_face:
                last_face = face
                allowed = compute_face_slack(
                    geometry.faces[face], geometry.clip_positions, depth_coefficients,
                    geometry.viewport,
                )  # fmt: skip
            slack[row, column] = allowed + DEPTH_ROUNDING * abs(depth[row, column])
