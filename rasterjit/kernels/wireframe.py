"""
Put the edges of faces on the screen as lines between pixels.

A segment is cut where a triangle is: at the near and far planes and the guard band, in homogeneous
clip space, before the divide. Its ends then go to the pixels that hold them.

A pixel of a line lies up to one pixel beside the edge itself, so the surface that the edge belongs
to may be nearer there by its own slope. ``fill_slack`` writes how much that is for the face seen at
each pixel: the change of depth over one pixel in x plus one in y, at most the face's whole range.

References
----------
.. [1] Y.-D. Liang and B. Barsky, "A New Concept and Method for Line Clipping", TOG 3(1), 1984.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.clipping import PLANES, plane_distance
from rasterjit.kernels.jit import kernel, stage
from rasterjit.kernels.projection import outcode
from rasterjit.kernels.records import Geometry, Viewport
from rasterjit.kernels.setup import FRUSTUM, INVALID

DEPTH_ROUNDING = np.float32(1e-6)
"""Slack for the rounding of float32 depths, as a share of the depth: 8 ulp."""


UNCUT = -1
"""Number of the plane that cut an end, where none did."""


@stage
def clip_segment(a, b, viewport):
    """Return the part (t0, t1) of a segment inside all planes, and the planes that cut its ends."""
    t0, t1 = 0.0, 1.0
    plane0 = plane1 = UNCUT
    for plane in range(PLANES):
        here, there = plane_distance(plane, a, viewport), plane_distance(plane, b, viewport)
        if not here >= 0.0 and not there >= 0.0:
            return 1.0, 0.0, plane, plane
        if not here >= 0.0 and here / (here - there) > t0:
            t0, plane0 = here / (here - there), plane
        elif not there >= 0.0 and here / (here - there) < t1:
            t1, plane1 = here / (here - there), plane
    return t0, t1, plane0, plane1


@stage
def cut_end(a, b, own, plane, viewport, k):
    """
    Return component k of one end of a segment: its own, or where the plane cuts it.

    The cut is the mean of both ends, weighted crosswise with their distances: swapping the ends
    only turns the signs of both terms, so it has the same bits in both directions.
    """
    if plane == UNCUT:
        return own[k]
    here, there = plane_distance(plane, a, viewport), plane_distance(plane, b, viewport)
    return (a[k] * there - b[k] * here) / (there - here)


@kernel
def project_edges(edges, clip_positions, depth_coefficients, viewport: Viewport, ends, depths):
    """
    Clip edges and find the pixels at their ends.

    Parameters
    ----------
    edges : (N, 2) int32, vertex numbers
    clip_positions : (V, 4) float64, clip space
    depth_coefficients : (float, float, float)
        The stored depth is ``(c0 + c1 z + c2 w) / w``; greater is nearer.
    viewport : Viewport
    ends : (N, 4) int64
        Writes the pixels x0, y0, x1, y1 of the edges that may be seen, packed to the front; all
        lie within the guard band.
    depths : (N, 2) float64
        Writes the stored depth at both ends.

    Returns
    -------
    int
        How many edges were written.
    """
    c0, c1, c2 = depth_coefficients
    count = 0
    for n in range(edges.shape[0]):
        a, b = clip_positions[edges[n, 0]], clip_positions[edges[n, 1]]
        code_a = outcode(a[0], a[1], a[2], a[3], viewport)
        code_b = outcode(b[0], b[1], b[2], b[3], viewport)
        if (code_a | code_b) & INVALID or code_a & code_b & FRUSTUM:
            continue
        t0, t1, plane0, plane1 = clip_segment(a, b, viewport)
        if t0 > t1:
            continue
        visible = True
        for end in range(2):
            own, plane = (b, plane1) if end else (a, plane0)
            x = cut_end(a, b, own, plane, viewport, 0)
            y = cut_end(a, b, own, plane, viewport, 1)
            z = cut_end(a, b, own, plane, viewport, 2)
            w = cut_end(a, b, own, plane, viewport, 3)
            if not w > 0.0:
                visible = False
                break
            # Rounding may leave a cut end a little outside the guard band, or far if w cancels.
            x = min(max(x / w, -viewport.guard_x), viewport.guard_x)
            y = min(max(y / w, -viewport.guard_y), viewport.guard_y)
            ends[count, 2 * end] = np.int64(np.floor((x + 1.0) * (0.5 * viewport.width)))
            ends[count, 2 * end + 1] = np.int64(np.floor((1.0 - y) * (0.5 * viewport.height)))
            depths[count, end] = (c0 + c1 * z + c2 * w) / w
        if visible:
            count += 1
    return count


@stage
def depth_slope(p, q, r, coefficients, viewport):
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
    return 2.0 * abs(along_x) / viewport.width + 2.0 * abs(along_y) / viewport.height


@kernel
def fill_slack(face_id, depth, geometry: Geometry, depth_coefficients, slack):
    """
    Write how far behind the stored depth a line may lie and still be seen.

    Parameters
    ----------
    face_id : (H, W) int32
    depth : (H, W) float32, stored depth
    geometry : Geometry
    depth_coefficients : (float, float, float)
    slack : (H, W) float32
        Written; 0 where nothing is.
    """
    c0, c1, c2 = depth_coefficients
    for row in range(face_id.shape[0]):
        for column in range(face_id.shape[1]):
            face = face_id[row, column]
            slack[row, column] = 0.0
            if face < 0:
                continue
            corners = geometry.faces[face]
            p, q, r = (
                geometry.clip_positions[corners[0]],
                geometry.clip_positions[corners[1]],
                geometry.clip_positions[corners[2]],
            )
            here = depth[row, column]
            allowed = np.float32(depth_slope(p, q, r, depth_coefficients, geometry.viewport))
            if p[3] > 0.0 and q[3] > 0.0 and r[3] > 0.0:
                d0 = (c0 + c1 * p[2] + c2 * p[3]) / p[3]
                d1 = (c0 + c1 * q[2] + c2 * q[3]) / q[3]
                d2 = (c0 + c1 * r[2] + c2 * r[3]) / r[3]
                span = max(d0, max(d1, d2)) - min(d0, min(d1, d2))
                allowed = min(allowed, np.float32(span))
            slack[row, column] = allowed + DEPTH_ROUNDING * abs(here)
