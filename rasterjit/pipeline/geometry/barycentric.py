"""
Compute barycentric weights of samples, and interpolate vertex attributes with them.

The weights are perspective-correct, those of the face's own three vertices even when it was
clipped. A face that needed no clipping has exact weights: integer edge functions of its snapped
vertices, over w. A clipped one has vertices that were never snapped; its weights follow from
its clip positions: the sample with normalized device coordinates (X, Y) lies on the face where
``sum b_k (x_k - X w_k) = sum b_k (y_k - Y w_k) = 0``, so ``b`` is the cross product of the two
coefficient rows. They are clamped to zero from below, for the sample may lie a rounding outside.

Without w (``Geometry.w`` has no elements) the weights are affine: linear on the screen, edge
functions over their sum, one division for a whole face. A clipped face always gets
perspective-correct ones, for its vertices have no screen positions.

Faces list their vertices with the lowest number first: see ``scene/first_corners.py``.

References
----------
.. [1] M. Olano and T. Greer, "Triangle Scan Conversion using 2D Homogeneous Coordinates",
   Graphics Hardware 1997.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.setup import (
    CLIPPED,
    edge,
    find_last_at_most,
    get_face_vertices,
    get_picture_size,
)
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.runtime.jit import helper, kernel
from rasterjit.runtime.state_block import float32, float64, int32, int64, uint8

UNDERFLOW = 2.0**-900
"""
Sums of weights above this are accurate; smaller ones may have lost terms to underflow.

Edges are whole numbers, so a sum is below 1 only if the edge opposite the smallest w is 0.
"""


@helper
def compute_weights_of_nonzero_edges(edges, ws):
    """Return edges times (smallest w / w); the smallest is that of vertices whose edge is not 0."""
    smallest = np.inf
    for k in range(3):
        if edges[k] != 0.0:
            smallest = min(smallest, ws[k])
    return (
        edges[0] * (smallest / ws[0]) if edges[0] != 0.0 else 0.0,
        edges[1] * (smallest / ws[1]) if edges[1] != 0.0 else 0.0,
        edges[2] * (smallest / ws[2]) if edges[2] != 0.0 else 0.0,
    )


@helper
def multiply_gradients(right, down, other_right, other_down):
    """Return the dot product of the gradients of two edges, given per pixel right and down."""
    return np.float64(right) * np.float64(other_right) + np.float64(down) * np.float64(other_down)


@helper
def clamp_to_edge(value, other_values, products):
    """
    Return two edge functions at the point on a third edge that is nearest the sample.

    Takes the third's value at the sample, and dot products of its gradient with itself and with
    both others'. Inside the third edge, where its value is positive, the others are unchanged.
    """
    distance = min(value, 0.0) / products[0]
    return other_values[0] - distance * products[1], other_values[1] - distance * products[2]


@helper
def clamp_edges(edges, right, down):
    """
    Return the edge functions at a pixel's centre, clamped to the face if the centre is outside.

    With several samples a pixel, the centre may lie outside a face that covers one of them. Then
    the values are those of a nearby border point: the foot of the perpendicular on the edge, or a
    vertex. Only scaling the weights to sum 1 could move that point along the whole length of a
    sliver. Signs are positive inside; there the values are unchanged.

    Parameters
    ----------
    edges : tuple of 3 whole numbers
    right, down : tuple of 3 whole numbers
        How edges change from pixel to pixel, in any unit.
    """
    sign = 1.0 if edges[0] + edges[1] + edges[2] > 0 else -1.0
    e0, e1 = sign * np.float64(edges[0]), sign * np.float64(edges[1])
    e2 = sign * np.float64(edges[2])
    d01 = multiply_gradients(right[0], down[0], right[1], down[1])
    d12 = multiply_gradients(right[1], down[1], right[2], down[2])
    d20 = multiply_gradients(right[2], down[2], right[0], down[0])
    d00 = multiply_gradients(right[0], down[0], right[0], down[0])
    d11 = multiply_gradients(right[1], down[1], right[1], down[1])
    d22 = multiply_gradients(right[2], down[2], right[2], down[2])
    k1, k2 = clamp_to_edge(e0, (e1, e2), (d00, d01, d20))
    k0 = max(e0, 0.0)
    k2, k0 = clamp_to_edge(k1, (k2, k0), (d11, d12, d01))
    k1 = max(k1, 0.0)
    k0, k1 = clamp_to_edge(k2, (k0, k1), (d22, d20, d12))
    return max(k0, 0.0), max(k1, 0.0), max(k2, 0.0)


@helper
def divide_by_sum(w0, w1, w2):
    """Return weights over their sum; if that is 0, all goes to the first."""
    total = w0 + w1 + w2
    if total == 0.0:
        return 1.0, 0.0, 0.0
    return w0 / total, w1 / total, w2 / total


@helper
def apply_perspective(e0, e1, e2, total, a, b, c, w):
    """
    Return the weights of three vertices, given the edge functions opposite them, and their sum.

    Edges are multiplied by smallest w / w, in 0..1, and 1 where all are equal. A vertex whose
    edge function is 0 does not count for the smallest. Without w the weights are affine.
    """
    if w.shape[0] == 0:
        inverse = 1.0 / np.float64(total)
        return e0 * inverse, e1 * inverse, e2 * inverse
    wa, wb, wc = w[a], w[b], w[c]
    smallest = min(wa, min(wb, wc))
    w0, w1, w2 = e0 * (smallest / wa), e1 * (smallest / wb), e2 * (smallest / wc)
    if abs(w0 + w1 + w2) > UNDERFLOW:
        return divide_by_sum(w0, w1, w2)
    w0, w1, w2 = compute_weights_of_nonzero_edges((e0, e1, e2), (wa, wb, wc))
    return divide_by_sum(w0, w1, w2)


@helper
def compute_snapped_weights(a, b, c, px, py, xy, w, sample_radius):
    """Return the weights on a face that was not clipped, at a point of the sub-pixel grid."""
    ax, ay = np.int64(xy[a, 0]), np.int64(xy[a, 1])
    bx, by = np.int64(xy[b, 0]), np.int64(xy[b, 1])
    cx, cy = np.int64(xy[c, 0]), np.int64(xy[c, 1])
    e0, e1, e2 = (
        edge(bx, by, cx, cy, px, py), edge(cx, cy, ax, ay, px, py), edge(ax, ay, bx, by, px, py),
    )  # fmt: skip
    k0, k1, k2, total = np.float64(e0), np.float64(e1), np.float64(e2), np.float64(e0 + e1 + e2)
    if sample_radius != 0:
        right, down = (by - cy, cy - ay, ay - by), (cx - bx, ax - cx, bx - ax)
        k0, k1, k2 = clamp_edges((e0, e1, e2), right, down)
        total = k0 + k1 + k2
    return apply_perspective(k0, k1, k2, total, a, b, c, w)


@helper
def offset_from_sample(a, b, c, column, row, clip, viewport):
    """Return x - X w and y - Y w of three vertices, (X, Y) being a pixel's centre in NDC."""
    width, height = get_picture_size(viewport)
    x = (2.0 * (viewport.left + column) + 1.0) / width - 1.0
    y = 1.0 - (2.0 * (viewport.top + row) + 1.0) / height
    u0 = clip[a, 0] - x * clip[a, 3]
    u1 = clip[b, 0] - x * clip[b, 3]
    u2 = clip[c, 0] - x * clip[c, 3]
    v0 = clip[a, 1] - y * clip[a, 3]
    v1 = clip[b, 1] - y * clip[b, 3]
    v2 = clip[c, 1] - y * clip[c, 3]
    return (u0, u1, u2), (v0, v1, v2)


@helper
def find_segment_parameter(first, second, first_w, second_w):
    """
    Return the weight of the second end of a segment, in 0..1; 0 where it has no length.

    Takes each end's signed distance from the sample along the segment, times w; and each end's w.
    Beyond an end, where the line may be behind the eye, the weight is clamped to that end.
    """
    length = first - second
    t = first / (length if length != 0.0 else 1.0)
    # NaN counts as the first end.
    t = t if (t > 0.0) & (length != 0.0) else 0.0
    t = t if t < 1.0 else 1.0
    t = 1.0 if (second <= 0.0) & (second_w > 0.0) & (length != 0.0) else t
    return 0.0 if (first >= 0.0) & (first_w > 0.0) else t


@helper
def compute_segment_weights(a, b, offsets, clip, viewport):
    """
    Return the weights of the ends of a segment at the foot of the perpendicular from a sample.

    Takes what `offset_from_sample` returns. The perpendicular lies in screen space; homogeneous
    coordinates allow an end behind the eye. A point, or a segment without length on the screen, has
    all weight at its first end.
    """
    (u0, u1, _), (v0, v1, _) = offsets
    width, height = get_picture_size(viewport)
    x = width * (clip[b, 0] * clip[a, 3] - clip[a, 0] * clip[b, 3])
    y = height * (clip[b, 1] * clip[a, 3] - clip[a, 1] * clip[b, 3])
    first = width * u0 * x + height * v0 * y
    second = width * u1 * x + height * v1 * y
    t = find_segment_parameter(first, second, clip[a, 3], clip[b, 3])
    return 1.0 - t, t, 0.0


@helper
def compute_clipped_weights(a, b, c, column, row, clip, viewport):
    """Return the weights on a clipped face, a segment or a point, not yet normalized."""
    if b == c:
        offsets = offset_from_sample(a, b, c, column, row, clip, viewport)
        return compute_segment_weights(a, b, offsets, clip, viewport)
    return compute_clipped_face_weights(a, b, c, column, row, clip, viewport)


@helper
def compute_clipped_face_weights(a, b, c, column, row, clip, viewport):
    """Return `compute_clipped_weights` of a face, branchless: loops along a row vectorize."""
    (u0, u1, u2), (v0, v1, v2) = offset_from_sample(a, b, c, column, row, clip, viewport)
    w0, w1, w2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    if w0 + w1 + w2 < 0.0:
        w0, w1, w2 = -w0, -w1, -w2
    return max(w0, 0.0), max(w1, 0.0), max(w2, 0.0)


@helper
def compute_sample_weights(a, b, c, column, row, geometry):
    """Return the weights of vertices a, b, c at a pixel's centre."""
    viewport = geometry.viewport
    if (geometry.codes[a] | geometry.codes[b] | geometry.codes[c]) & CLIPPED:
        w0, w1, w2 = compute_clipped_weights(
            a, b, c, column, row, geometry.clip_positions, viewport
        )
        return divide_by_sum(w0, w1, w2)
    half = np.int64(1) << (viewport.grid_bits - 1)
    px = (np.int64(column) << viewport.grid_bits) + half
    py = (np.int64(row) << viewport.grid_bits) + half
    return compute_snapped_weights(a, b, c, px, py, geometry.xy, geometry.w, viewport.sample_radius)


@helper
def compute_shifted_weights(a, b, c, column, row, shift, geometry):
    """
    Return the weights of vertices a, b, c at a sample of a pixel.

    Takes the offset from the sample to the pixel's centre, sub-pixel units; for no offset, returns
    what `compute_sample_weights` does.
    """
    bits, viewport = geometry.viewport.grid_bits, geometry.viewport
    unit, half = np.int64(1) << bits, np.int64(1) << (bits - 1)
    if (geometry.codes[a] | geometry.codes[b] | geometry.codes[c]) & CLIPPED:
        x = np.float64(column) - np.float64(shift[0]) / np.float64(unit)
        y = np.float64(row) - np.float64(shift[1]) / np.float64(unit)
        w0, w1, w2 = compute_clipped_weights(a, b, c, x, y, geometry.clip_positions, viewport)
        return divide_by_sum(w0, w1, w2)
    px = (np.int64(column) << bits) + half - np.int64(shift[0])
    py = (np.int64(row) << bits) + half - np.int64(shift[1])
    return compute_snapped_weights(a, b, c, px, py, geometry.xy, geometry.w, viewport.sample_radius)


@helper
def blend(weights, value0, value1, value2):
    """Return the weighted mean of the vertices' values; equal ones give exactly themselves."""
    return value0 + weights[1] * (value1 - value0) + weights[2] * (value2 - value0)


@helper
def interpolate(weights, value0, value1, value2):
    """Return `blend`, clamped to the range of the values, which rounding may leave by an ulp."""
    lowest, highest = min(value0, min(value1, value2)), max(value0, max(value1, value2))
    value = blend(weights, value0, value1, value2)
    value = value if value >= lowest else lowest
    return value if value <= highest else highest


@helper
def find_object(face, face_starts, guess):
    """Return the object that owns a face; ``guess`` is tried first."""
    if face_starts[guess] <= face < face_starts[guess + 1]:
        return guess
    return find_last_at_most(face_starts, face)


@helper
def transform_point(x, y, z, owner, matrices):
    """Transform a model-space point by its object's matrix."""
    m = matrices
    return (
        m[owner, 0, 0] * x + m[owner, 0, 1] * y + m[owner, 0, 2] * z + m[owner, 0, 3],
        m[owner, 1, 0] * x + m[owner, 1, 1] * y + m[owner, 1, 2] * z + m[owner, 1, 3],
        m[owner, 2, 0] * x + m[owner, 2, 1] * y + m[owner, 2, 2] * z + m[owner, 2, 3],
    )


@helper
def transform_vertex(vertex, owner, placement):
    """Return a vertex's position in world axes, relative to the eye."""
    p, relative_from_model = placement.positions, placement.relative_from_model
    return transform_point(p[vertex, 0], p[vertex, 1], p[vertex, 2], owner, relative_from_model)


@helper
def interpolate_point(weights, a, b, c, owner, placement):
    """
    Return the point of a face with the given weights in world axes, relative to the eye.

    The first vertex is transformed and the offset from it added: differences of large coordinates
    are exact, so a mesh far from the origin is lit as one near it.
    """
    p, m = placement.positions, placement.relative_from_model
    x = weights[1] * (p[b, 0] - p[a, 0]) + weights[2] * (p[c, 0] - p[a, 0])
    y = weights[1] * (p[b, 1] - p[a, 1]) + weights[2] * (p[c, 1] - p[a, 1])
    z = weights[1] * (p[b, 2] - p[a, 2]) + weights[2] * (p[c, 2] - p[a, 2])
    first = transform_point(p[a, 0], p[a, 1], p[a, 2], owner, m)
    return (
        first[0] + (m[owner, 0, 0] * x + m[owner, 0, 1] * y + m[owner, 0, 2] * z),
        first[1] + (m[owner, 1, 0] * x + m[owner, 1, 1] * y + m[owner, 1, 2] * z),
        first[2] + (m[owner, 2, 0] * x + m[owner, 2, 1] * y + m[owner, 2, 2] * z),
    )


@helper
def get_linear_part(matrices, owner):
    """Return the 3 by 3 part of an object's matrix, row by row."""
    m = matrices
    return (
        m[owner, 0, 0], m[owner, 0, 1], m[owner, 0, 2],
        m[owner, 1, 0], m[owner, 1, 1], m[owner, 1, 2],
        m[owner, 2, 0], m[owner, 2, 1], m[owner, 2, 2],
    )  # fmt: skip


@helper
def point_to_viewer(point, placement):
    """Return the direction from a point, relative to the eye, to the viewer, any length."""
    v = placement.toward_viewer
    return v[0] - v[3] * point[0], v[1] - v[3] * point[1], v[2] - v[3] * point[2]


@helper
def normalize(x, y, z):
    """Scale a vector to length one, unless zero; no square overflows or vanishes."""
    largest = max(abs(x), max(abs(y), abs(z)))
    shrink = 1.0 / largest if largest > 0.0 else 0.0
    x, y, z = x * shrink, y * shrink, z * shrink
    length = np.sqrt(x * x + y * y + z * z)
    scale = 1.0 / length if length > 0.0 else 0.0
    return x * scale, y * scale, z * scale


@helper
def find_view_direction(point, placement):
    """Return the unit vector from a point, relative to the eye, toward the viewer; or zero."""
    x, y, z = point_to_viewer(point, placement)
    return normalize(x, y, z)


@helper
def compute_face_normal(a, b, c, owner, placement):
    """
    Return the unit normal on the counter-clockwise side of a face, world axes, or zero.

    A segment or a point has the direction from its first vertex to the viewer.
    """
    pa = transform_vertex(a, owner, placement)
    if b == c:
        return find_view_direction(pa, placement)
    pb = transform_vertex(b, owner, placement)
    pc = transform_vertex(c, owner, placement)
    return compute_normal(pa, pb, pc, placement.mirrored[owner])


@helper
def compute_normal(pa, pb, pc, sign):
    """Return the unit normal of three points, times ``sign``; zero if they lie on a line."""
    ux, uy, uz = pb[0] - pa[0], pb[1] - pa[1], pb[2] - pa[2]
    vx, vy, vz = pc[0] - pa[0], pc[1] - pa[1], pc[2] - pa[2]
    # Scale the sides first: products of very long or very short ones overflow or vanish.
    size = max(max(abs(ux), max(abs(uy), abs(uz))), max(abs(vx), max(abs(vy), abs(vz))))
    shrink = 1.0 / size if size > 0.0 else 0.0
    ux, uy, uz = ux * shrink, uy * shrink, uz * shrink
    vx, vy, vz = vx * shrink, vy * shrink, vz * shrink
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = np.sqrt(x * x + y * y + z * z)
    scale = sign / length if length > 0.0 else 0.0
    return scale * x, scale * y, scale * z


@helper
def is_back_facing(a, b, c, owner, geometry, placement):
    """
    Return whether a face is back-facing.

    Tested by the winding on the screen; by the plane if the face was clipped.
    """
    if not (geometry.codes[a] | geometry.codes[b] | geometry.codes[c]) & CLIPPED:
        xy = geometry.xy
        winding = edge(
            np.int64(xy[a, 0]), np.int64(xy[a, 1]), np.int64(xy[b, 0]), np.int64(xy[b, 1]),
            np.int64(xy[c, 0]), np.int64(xy[c, 1]),
        )  # fmt: skip
        return np.float64(winding) * placement.front_windings[owner] < 0.0
    return is_plane_back_facing(a, b, c, owner, placement)


@helper
def is_plane_back_facing(a, b, c, owner, placement):
    """Return whether the eye is behind the plane of a face."""
    p, m, viewer = placement.positions, placement.relative_from_model, placement.toward_viewer
    pa = transform_point(p[a, 0], p[a, 1], p[a, 2], owner, m)
    pb = transform_point(p[b, 0], p[b, 1], p[b, 2], owner, m)
    pc = transform_point(p[c, 0], p[c, 1], p[c, 2], owner, m)
    normal = compute_normal(pa, pb, pc, placement.mirrored[owner])
    return (
        normal[0] * (viewer[0] - viewer[3] * pa[0])
        + normal[1] * (viewer[1] - viewer[3] * pa[1])
        + normal[2] * (viewer[2] - viewer[3] * pa[2])
    ) < 0.0


@helper
def interpolate_normal(weights, a, b, c, normals, matrices, owner):
    """Return the interpolated vertex normal in world axes, not normalized."""
    x = blend(weights, np.float64(normals[a, 0]), np.float64(normals[b, 0]),
              np.float64(normals[c, 0]))  # fmt: skip
    y = blend(weights, np.float64(normals[a, 1]), np.float64(normals[b, 1]),
              np.float64(normals[c, 1]))  # fmt: skip
    z = blend(weights, np.float64(normals[a, 2]), np.float64(normals[b, 2]),
              np.float64(normals[c, 2]))  # fmt: skip
    return (
        matrices[owner, 0, 0] * x + matrices[owner, 0, 1] * y + matrices[owner, 0, 2] * z,
        matrices[owner, 1, 0] * x + matrices[owner, 1, 1] * y + matrices[owner, 1, 2] * z,
        matrices[owner, 2, 0] * x + matrices[owner, 2, 1] * y + matrices[owner, 2, 2] * z,
    )


@helper
def read_triple(values, vertex):
    """Return the three numbers of a vertex, such as its normal or colour, as float64."""
    return (
        np.float64(values[vertex, 0]),
        np.float64(values[vertex, 1]),
        np.float64(values[vertex, 2]),
    )


@kernel
def fill_barycentric(
    face_id: int32[:, ::1], row_range: (int64, int64), geometry: Geometry,
    first_corners: uint8[::1], barycentric: float32[:, :, ::1],
):  # fmt: skip
    """
    Write the weights of each sample, in the order in which its mesh lists the face's vertices.

    Parameters
    ----------
    face_id : (H, W) int32
    row_range : (int, int)
        First row, and one past the last.
    geometry : Geometry
    first_corners : (F,) uint8
        Index, in that order, of the first corner of each face.
    barycentric : (H, W, 3) float32
        Written; zero where nothing is, or a segment or a point.
    """
    for row in range(row_range[0], row_range[1]):
        for column in range(face_id.shape[1]):
            face = face_id[row, column]
            for k in range(3):
                barycentric[row, column, k] = 0.0
            if face < 0:
                continue
            a, b, c = get_face_vertices(geometry.faces, face)
            if b == c:
                continue
            weights = compute_sample_weights(a, b, c, column, row, geometry)
            for k in range(3):
                barycentric[row, column, (np.int64(first_corners[face]) + k) % 3] = weights[k]


@kernel
def fill_attribute(
    face_id: int32[:, ::1], row_range: (int64, int64), geometry: Geometry, values: float32[:, ::1],
    attribute: float32[:, :, ::1],
):  # fmt: skip
    """
    Interpolate a vertex attribute at each sample.

    Parameters
    ----------
    face_id : (H, W) int32
    row_range : (int, int)
    geometry : Geometry
    values : (V, K) float32
    attribute : (H, W, K) float32
        Written; NaN where nothing is.
    """
    for row in range(row_range[0], row_range[1]):
        for column in range(face_id.shape[1]):
            face = face_id[row, column]
            if face < 0:
                for k in range(values.shape[1]):
                    attribute[row, column, k] = np.nan
                continue
            a, b, c = get_face_vertices(geometry.faces, face)
            weights = compute_sample_weights(a, b, c, column, row, geometry)
            for k in range(values.shape[1]):
                attribute[row, column, k] = interpolate(
                    weights,
                    np.float64(values[a, k]),
                    np.float64(values[b, k]),
                    np.float64(values[c, k]),
                )


@kernel
def fill_positions(
    face_id: int32[:, ::1], row_range: (int64, int64), geometry: Geometry, placement: Placement,
    world_from_model: float64[:, :, ::1], position: float32[:, :, ::1],
):  # fmt: skip
    """
    Write the world position of each sample.

    Parameters
    ----------
    face_id : (H, W) int32
    row_range : (int, int)
    geometry : Geometry
    placement : Placement
    world_from_model : (O, 3, 4) float64
        Eye space is avoided: adding a large eye position back would round small coordinates.
    position : (H, W, 3) float32
        Written; NaN where nothing is.
    """
    p = placement.positions
    owner = np.int64(0)
    for row in range(row_range[0], row_range[1]):
        for column in range(face_id.shape[1]):
            face = face_id[row, column]
            if face < 0:
                for k in range(3):
                    position[row, column, k] = np.nan
                continue
            owner = find_object(face, placement.face_starts, owner)
            a, b, c = get_face_vertices(geometry.faces, face)
            weights = compute_sample_weights(a, b, c, column, row, geometry)
            x = interpolate(weights, p[a, 0], p[b, 0], p[c, 0])
            y = interpolate(weights, p[a, 1], p[b, 1], p[c, 1])
            z = interpolate(weights, p[a, 2], p[b, 2], p[c, 2])
            point = transform_point(x, y, z, owner, world_from_model)
            for k in range(3):
                position[row, column, k] = point[k]


@kernel
def fill_normals(
    face_id: int32[:, ::1], row_range: (int64, int64), geometry: Geometry, placement: Placement,
    smooth: (float32[:, ::1], uint8[::1]), normal: float32[:, :, ::1],
):  # fmt: skip
    """
    Write the unit normal of each sample in world axes, on the side that is seen.

    Parameters
    ----------
    face_id : (H, W) int32
    row_range : (int, int)
    geometry : Geometry
    placement : Placement
    smooth : (normals (V, 3) float32, is_smooth (O,) uint8)
        Vertex normals in model space, and the objects that are shaded with them; the others have
        the normals of their faces.
    normal : (H, W, 3) float32
        Written; zero where nothing is, and where a face or its vertex normals have none. Segments
        and points without vertex normals turn toward the viewer.
    """
    normals, is_smooth = smooth
    owner = np.int64(0)
    for row in range(row_range[0], row_range[1]):
        for column in range(face_id.shape[1]):
            face = face_id[row, column]
            for k in range(3):
                normal[row, column, k] = 0.0
            if face < 0:
                continue
            owner = find_object(face, placement.face_starts, owner)
            a, b, c = get_face_vertices(geometry.faces, face)
            if is_smooth[owner]:
                weights = compute_sample_weights(a, b, c, column, row, geometry)
                vector = interpolate_normal(
                    weights, a, b, c, normals, placement.normal_matrices, owner
                )
            else:
                vector = compute_face_normal(a, b, c, owner, placement)
            length = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
            if b == c and not (length > 0.0 and is_smooth[owner]):
                weights = compute_sample_weights(a, b, c, column, row, geometry)
                vector = find_view_direction(
                    interpolate_point(weights, a, b, c, owner, placement), placement
                )
                length = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
            if not length > 0.0:
                continue
            side = -1.0 if is_back_facing(a, b, c, owner, geometry, placement) else 1.0
            for k in range(3):
                normal[row, column, k] = side * vector[k] / length
