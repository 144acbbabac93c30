"""Interpolate attributes at a block's samples: colours, highlights, normals, points, alpha."""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import (
    blend,
    compute_face_normal,
    compute_normal,
    get_linear_part,
    interpolate,
    interpolate_point,
    read_triple,
    transform_point,
    transform_vertex,
)
from rasterjit.pipeline.records import (
    FLAT,
    GOURAUD,
    MATERIAL_MODEL,
    MATERIAL_SHININESS,
    MATERIAL_SPECULAR,
    PBR,
    PHONG,
    Placement,
)
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.gather_samples import (
    fill_row,
    get_patch_samples,
    get_patch_vertices,
    round_up_to_vectors,
)
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.pipeline.surface.texture_lookup import TEXTURE_RED, multiply_diffuse_part
from rasterjit.runtime.intrinsics import nine_parts, part, spread, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, float64, int64, uint8

TEXTURE_ALPHA = TEXTURE_RED + 3
"""Row of colours: a texture's alpha."""


@helper
def blend_normal(second, third, normal):
    """Return the interpolated normal in world axes, on the visible side, not normalized."""
    (na, nb, nc), m, side = normal
    weights = (0.0, second, third)
    x = blend(weights, na[0], nb[0], nc[0])
    y = blend(weights, na[1], nb[1], nc[1])
    z = blend(weights, na[2], nb[2], nc[2])
    return (
        np.float32(side * (m[0] * x + m[1] * y + m[2] * z)),
        np.float32(side * (m[3] * x + m[4] * y + m[5] * z)),
        np.float32(side * (m[6] * x + m[7] * y + m[8] * z)),
    )


@helper
def blend_point(second, third, point):
    """Return a sample's position, as `interpolate_point` does."""
    first, ab, ac, m = point
    x = second * ab[0] + third * ac[0]
    y = second * ab[1] + third * ac[1]
    z = second * ab[2] + third * ac[2]
    return (
        np.float32(first[0] + (m[0] * x + m[1] * y + m[2] * z)),
        np.float32(first[1] + (m[3] * x + m[4] * y + m[5] * z)),
        np.float32(first[2] + (m[6] * x + m[7] * y + m[8] * z)),
    )


@helper
def gather_vertex_values(segment, values, ints, out):
    """Gather three numbers of each vertex of some patches' faces."""
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        a, b, c = get_patch_vertices(ints, r)
        n = np.uintp(ints[rows.FIRST_SAMPLE, r])
        spread(out[0], n, values[a, 0])
        spread(out[1], n, values[a, 1])
        spread(out[2], n, values[a, 2])
        spread(out[3], n, values[b, 0])
        spread(out[4], n, values[b, 1])
        spread(out[5], n, values[b, 2])
        spread(out[6], n, values[c, 0])
        spread(out[7], n, values[c, 1])
        spread(out[8], n, values[c, 2])


@helper
def get_span_vertices(segment, ints):
    """Return the vertex numbers of a span's face."""
    return get_patch_vertices(ints, np.uintp(segment[rows.FIRST_PATCH]))


@helper
def find_object_end(block, k):
    """
    Return one past the last of the segments from ``k`` on that belong to the same object.

    The samples of these follow each other without a gap.
    """
    owner, stop = block.segments[k, rows.OWNER], block.segments[k, rows.START]
    while k < block.counts[rows.SEGMENT_COUNT]:
        if block.segments[k, rows.OWNER] != owner or block.segments[k, rows.START] != stop:
            return k
        stop = block.segments[k, rows.STOP]
        k += 1
    return k


@stage
def fill_base_colors(block: Block, count, materials: float32[:, ::1]):
    """Write the base colour of each sample's material."""
    samples, k = block.samples, np.int64(0)
    while k < block.counts[rows.SEGMENT_COUNT]:
        end = find_object_end(block, k)
        s, owner = np.int64(block.segments[k, rows.START]), np.uintp(block.segments[k, rows.OWNER])
        e = s + round_up_to_vectors(block.segments[end - 1, rows.STOP] - s)
        fill_row(part(samples, rows.RED, s, e), materials[owner, 0])
        fill_row(part(samples, rows.GREEN, s, e), materials[owner, 1])
        fill_row(part(samples, rows.BLUE, s, e), materials[owner, 2])
        k = end


@stage
def multiply_face_colors(block: Block, count, face_colors: float32[:, ::1]):
    """Multiply the base colours by those of the faces."""
    samples, ints = block.samples, block.ints
    for r in range(np.uintp(block.counts[rows.PATCH_COUNT])):
        face = np.uintp(ints[rows.FACE, r])
        start, end = get_patch_samples(ints, r)
        for n in range(start, end):
            for k in range(3):
                samples[rows.RED + k, n] *= face_colors[face, k]


@stage
def multiply_face_colors_below_highlights(
    block: Block, count, face_colors: float32[:, ::1], materials: float32[:, ::1], first: int64
):
    """
    Multiply the lit colours by those of the faces, except for the highlights in them.

    The diffuse light on the vertices of Gouraud-shaded objects is in three rows of samples from
    ``first`` on; it is multiplied too.
    """
    samples, ints = block.samples, block.ints
    for s in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[s]
        is_gouraud = np.int64(materials[np.uintp(segment[rows.OWNER]), MATERIAL_MODEL]) == GOURAUD
        for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
            face = np.uintp(ints[rows.FACE, r])
            start, end = get_patch_samples(ints, r)
            for n in range(start, end):
                for k in range(3):
                    color, factor = samples[rows.RED + k, n], face_colors[face, k]
                    if is_gouraud:
                        diffuse = samples[first + k, n]
                        samples[rows.RED + k, n] = multiply_diffuse_part(color, factor, diffuse)
                        samples[first + k, n] = diffuse * factor
                    else:
                        samples[rows.RED + k, n] = color * factor


@helper
def weighted_mean(weights, value0, value1, value2):
    """
    Return the weighted mean of non-negative values, clamped to their range.

    No cancellation: its relative error is little more than that of the weights. Equal values give
    exactly themselves.
    """
    lowest, highest = min(value0, min(value1, value2)), max(value0, max(value1, value2))
    value = weights[0] * value0 + weights[1] * value1 + weights[2] * value2
    value = value if value >= lowest else lowest
    return value if value <= highest else highest


@disjoint_helper
def interpolate_colors(
    red, green, blue, ra, ga, ba, rb, gb, bb, rc, gc, bc, second, third, base
):  # fmt: skip
    """Write a base colour times those of the vertices, interpolated."""
    for n in range(red.shape[0]):
        weights = (0.0, second[n], third[n])
        r = interpolate(weights, np.float64(ra[n]), np.float64(rb[n]), np.float64(rc[n]))
        g = interpolate(weights, np.float64(ga[n]), np.float64(gb[n]), np.float64(gc[n]))
        b = interpolate(weights, np.float64(ba[n]), np.float64(bb[n]), np.float64(bc[n]))
        red[n], green[n] = base[0] * np.float32(r), base[1] * np.float32(g)
        blue[n] = base[2] * np.float32(b)


@disjoint_helper
def interpolate_span_colors(red, green, blue, second, third, at_a, at_b, at_c, base):
    """Write a base colour times those of the vertices of one face, interpolated."""
    for n in range(red.shape[0]):
        weights = (0.0, second[n], third[n])
        red[n] = base[0] * np.float32(interpolate(weights, at_a[0], at_b[0], at_c[0]))
        green[n] = base[1] * np.float32(interpolate(weights, at_a[1], at_b[1], at_c[1]))
        blue[n] = base[2] * np.float32(interpolate(weights, at_a[2], at_b[2], at_c[2]))


@helper
def interpolate_segment_colors(segment, block, vertex_colors, materials):
    """Write the base colour of a segment's material times those of the vertices, interpolated."""
    samples, ints, weights, floats = block.samples, block.ints, block.weights, block.floats
    s, owner = np.int64(segment[rows.START]), np.uintp(segment[rows.OWNER])
    e = s + round_up_to_vectors(segment[rows.STOP] - s)
    base = materials[owner, 0], materials[owner, 1], materials[owner, 2]
    red, green, blue = three_parts(samples, rows.RED, s, e)
    second, third = part(weights, 0, s, e), part(weights, 1, s, e)
    if segment[rows.KIND] == rows.MIXED:
        gather_vertex_values(segment, vertex_colors, ints, floats)
        interpolate_colors(red, green, blue, *nine_parts(floats, 0, s, e), second, third, base)
    else:
        a, b, c = get_span_vertices(segment, ints)
        interpolate_span_colors(
            red, green, blue, second, third, read_triple(vertex_colors, a),
            read_triple(vertex_colors, b), read_triple(vertex_colors, c), base,
        )  # fmt: skip


@stage
def interpolate_vertex_colors(
    block: Block, count, vertex_colors: float32[:, ::1], materials: float32[:, ::1]
):
    """Write the base colour of each sample's material times those of the vertices, interpolated."""
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        interpolate_segment_colors(block.segments[k], block, vertex_colors, materials)


@disjoint_helper
def multiply_float32_colors(
    red, green, blue, ra, ga, ba, rb, gb, bb, rc, gc, bc, first, second, third
):  # fmt: skip
    """Multiply colours by those of the vertices, interpolated in float32."""
    for n in range(red.shape[0]):
        weights = first[n], second[n], third[n]
        red[n] *= weighted_mean(weights, ra[n], rb[n], rc[n])
        green[n] *= weighted_mean(weights, ga[n], gb[n], gc[n])
        blue[n] *= weighted_mean(weights, ba[n], bb[n], bc[n])


@disjoint_helper
def multiply_float32_span(red, green, blue, first, second, third, at_a, at_b, at_c):
    """Multiply the colours of one face by those of its vertices, interpolated in float32."""
    for n in range(red.shape[0]):
        weights = first[n], second[n], third[n]
        red[n] *= weighted_mean(weights, at_a[0], at_b[0], at_c[0])
        green[n] *= weighted_mean(weights, at_a[1], at_b[1], at_c[1])
        blue[n] *= weighted_mean(weights, at_a[2], at_b[2], at_c[2])


@helper
def read_vertex_color(vertex_colors, vertex):
    """Return red, green and blue of a vertex."""
    return vertex_colors[vertex, 0], vertex_colors[vertex, 1], vertex_colors[vertex, 2]


@helper
def gather_vertex_light(segment, lit_vertices, ints, out):
    """Gather the light on some patches' vertices, on the visible side."""
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        a, b, c = get_patch_vertices(ints, r)
        n = np.uintp(ints[rows.FIRST_SAMPLE, r])
        side = np.uintp(ints[rows.BACKFACE, n])
        for k in range(3):
            spread(out[k], n, lit_vertices[a, side, k])
            spread(out[3 + k], n, lit_vertices[b, side, k])
            spread(out[6 + k], n, lit_vertices[c, side, k])


@stage
def interpolate_lit_vertices(
    block: Block, count, lit_vertices: float32[:, :, ::1], materials: float32[:, ::1], first: int64
):
    """
    Write the light on the vertices, interpolated, on objects shaded by Gouraud.

    Three rows of samples from ``first`` on.
    """
    samples, ints, weights, floats = block.samples, block.ints, block.weights, block.floats
    white = np.float32(1.0), np.float32(1.0), np.float32(1.0)
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        if np.int64(materials[np.uintp(segment[rows.OWNER]), MATERIAL_MODEL]) != GOURAUD:
            continue
        s, e = np.int64(segment[rows.START]), np.int64(segment[rows.STOP])
        if segment[rows.KIND] == rows.MIXED:
            gather_vertex_light(segment, lit_vertices, ints, floats)
        red, green, blue = three_parts(samples, first, s, e)
        if segment[rows.KIND] == rows.MIXED:
            interpolate_colors(
                red, green, blue, *nine_parts(floats, 0, s, e), part(weights, 0, s, e),
                part(weights, 1, s, e), white,
            )  # fmt: skip
        else:
            a, b, c = get_span_vertices(segment, ints)
            side = np.uintp(ints[rows.BACKFACE, s])
            interpolate_span_colors(
                red, green, blue, part(weights, 0, s, e), part(weights, 1, s, e),
                read_triple(lit_vertices[a], side), read_triple(lit_vertices[b], side),
                read_triple(lit_vertices[c], side), white,
            )  # fmt: skip


@stage
def fill_highlights(block: Block, count, materials: float32[:, ::1]):
    """
    Write strength and exponent of the highlight, and whether light falls on a sample.

    Set ``SHADOW`` and ``OCCLUSION`` to 1; later stages lower them.
    """
    samples, k = block.samples, np.int64(0)
    while k < block.counts[rows.SEGMENT_COUNT]:
        end = find_object_end(block, k)
        s, owner = np.int64(block.segments[k, rows.START]), np.uintp(block.segments[k, rows.OWNER])
        e = s + round_up_to_vectors(block.segments[end - 1, rows.STOP] - s)
        model = np.int64(materials[owner, MATERIAL_MODEL])
        fill_row(part(samples, rows.SPECULAR, s, e), materials[owner, MATERIAL_SPECULAR])
        fill_row(part(samples, rows.SHININESS, s, e), materials[owner, MATERIAL_SHININESS])
        fill_row(part(samples, rows.LIT, s, e), np.float32(1.0 if model in (FLAT, PHONG) else 0.0))
        k = end
    padded = round_up_to_vectors(count)
    fill_row(part(samples, rows.OCCLUSION, 0, padded), np.float32(1.0))
    fill_row(part(samples, rows.SHADOW, 0, padded), np.float32(1.0))


@stage
def fill_microfacets(block: Block, count, factors: float32[:, ::1], materials: float32[:, ::1]):
    """Write metallic, roughness, and 1 where an object is shaded by microfacets, else 0."""
    samples, k = block.samples, np.int64(0)
    while k < block.counts[rows.SEGMENT_COUNT]:
        end = find_object_end(block, k)
        s, owner = np.int64(block.segments[k, rows.START]), np.uintp(block.segments[k, rows.OWNER])
        e = s + round_up_to_vectors(block.segments[end - 1, rows.STOP] - s)
        is_pbr = np.int64(materials[owner, MATERIAL_MODEL]) == PBR
        fill_row(part(samples, rows.METALLIC, s, e), factors[owner, 0])
        fill_row(part(samples, rows.ROUGHNESS, s, e), factors[owner, 1])
        fill_row(part(samples, rows.MICROFACET, s, e), np.float32(1.0 if is_pbr else 0.0))
        k = end


@stage
def gather_positions(block: Block, count, positions: float64[:, ::1]):
    """Gather the vertex positions of the faces of mixed segments, model space."""
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        if segment[rows.KIND] == rows.MIXED:
            gather_vertex_values(segment, positions, block.ints, block.doubles)


@disjoint_helper
def interpolate_normals(
    nx, ny, nz, xa, ya, za, xb, yb, zb, xc, yc, zc, second, third, backface, matrix
):  # fmt: skip
    """Write interpolated vertex normals in world axes."""
    for n in range(nx.shape[0]):
        normals = (
            (np.float64(xa[n]), np.float64(ya[n]), np.float64(za[n])),
            (np.float64(xb[n]), np.float64(yb[n]), np.float64(zb[n])),
            (np.float64(xc[n]), np.float64(yc[n]), np.float64(zc[n])),
        )
        sign = 1.0 - 2.0 * np.float64(backface[n])
        nx[n], ny[n], nz[n] = blend_normal(second[n], third[n], (normals, matrix, sign))


@disjoint_helper
def interpolate_span_normals(nx, ny, nz, second, third, normal):
    """Write the interpolated normals of samples of one face."""
    for n in range(nx.shape[0]):
        nx[n], ny[n], nz[n] = blend_normal(second[n], third[n], normal)


@helper
def is_smooth(owner, materials):
    """Return whether an object is shaded by interpolated normals."""
    return np.int64(materials[np.uintp(owner), MATERIAL_MODEL]) in (PHONG, PBR)


@stage
def find_smooth_normals(
    block: Block, count, normals: float32[:, ::1], normal_matrices: float64[:, :, :],
    materials: float32[:, ::1],
):  # fmt: skip
    """
    Write the interpolated vertex normals of objects that are smooth, world axes, any length.

    Before `find_face_normals`, because vectors overwrite the start of other objects' segments.
    """
    samples, ints, weights, floats = block.samples, block.ints, block.weights, block.floats
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        if not is_smooth(segment[rows.OWNER], materials):
            continue
        s, owner = np.int64(segment[rows.START]), np.uintp(segment[rows.OWNER])
        e = s + round_up_to_vectors(segment[rows.STOP] - s)
        matrix = get_linear_part(normal_matrices, owner)
        if segment[rows.KIND] == rows.MIXED:
            gather_vertex_values(segment, normals, ints, floats)
            interpolate_normals(
                *three_parts(samples, rows.NORMAL_X, s, e), *nine_parts(floats, 0, s, e),
                part(weights, 0, s, e), part(weights, 1, s, e), part(ints, rows.BACKFACE, s, e),
                matrix,
            )  # fmt: skip
        else:
            a, b, c = get_span_vertices(segment, ints)
            corners = read_triple(normals, a), read_triple(normals, b), read_triple(normals, c)
            sign = 1.0 - 2.0 * np.float64(ints[rows.BACKFACE, s])
            interpolate_span_normals(
                *three_parts(samples, rows.NORMAL_X, s, e), part(weights, 0, s, e),
                part(weights, 1, s, e), (corners, matrix, sign),
            )  # fmt: skip


@disjoint_helper
def find_mixed_face_normals(
    nx, ny, nz, xa, ya, za, xb, yb, zb, xc, yc, zc, second, third, backface, owner, m, mirrored
):  # fmt: skip
    """Write the geometric normals of faces, one for each sample."""
    unit = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    for n in range(nx.shape[0]):
        flat = compute_normal(
            transform_point(xa[n], ya[n], za[n], owner, m),
            transform_point(xb[n], yb[n], zb[n], owner, m),
            transform_point(xc[n], yc[n], zc[n], owner, m),
            mirrored,
        )
        sign = 1.0 - 2.0 * np.float64(backface[n])
        nx[n], ny[n], nz[n] = blend_normal(second[n], third[n], ((flat, flat, flat), unit, sign))


@stage
def find_face_normals(
    block: Block, count, placement: Placement, materials: float32[:, ::1], skips_smooth: int64
):
    """
    Write the geometric normals of faces, world axes.

    After `gather_positions`. If ``skips_smooth`` is not 0, skip objects with smooth normals, which
    `find_smooth_normals` has written.
    """
    samples, ints, weights, doubles = block.samples, block.ints, block.weights, block.doubles
    unit = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        if skips_smooth != 0 and is_smooth(segment[rows.OWNER], materials):
            continue
        s, e = np.int64(segment[rows.START]), np.int64(segment[rows.STOP])
        owner = np.int64(segment[rows.OWNER])
        if segment[rows.KIND] == rows.MIXED:
            find_mixed_face_normals(
                *three_parts(samples, rows.NORMAL_X, s, e), *nine_parts(doubles, 0, s, e),
                part(weights, 0, s, e), part(weights, 1, s, e), part(ints, rows.BACKFACE, s, e),
                owner, placement.relative_from_model, placement.mirrored[owner],
            )  # fmt: skip
        else:
            a, b, c = get_span_vertices(segment, ints)
            flat = compute_face_normal(a, b, c, owner, placement)
            sign = 1.0 - 2.0 * np.float64(ints[rows.BACKFACE, s])
            interpolate_span_normals(
                *three_parts(samples, rows.NORMAL_X, s, e), part(weights, 0, s, e),
                part(weights, 1, s, e), ((flat, flat, flat), unit, sign),
            )  # fmt: skip


@disjoint_helper
def interpolate_points(
    px, py, pz, xa, ya, za, xb, yb, zb, xc, yc, zc, second, third, owner, matrices, matrix
):  # fmt: skip
    """Write the positions of samples, each of its own face."""
    for n in range(px.shape[0]):
        point = (
            transform_point(xa[n], ya[n], za[n], owner, matrices),
            (xb[n] - xa[n], yb[n] - ya[n], zb[n] - za[n]),
            (xc[n] - xa[n], yc[n] - ya[n], zc[n] - za[n]),
            matrix,
        )
        px[n], py[n], pz[n] = blend_point(second[n], third[n], point)


@disjoint_helper
def find_mixed_centroids(
    px, py, pz, xa, ya, za, xb, yb, zb, xc, yc, zc, second, third, owner, matrices, matrix
):  # fmt: skip
    """Write the centroids of the faces."""
    m, third_part, zero = matrix, 1.0 / 3.0, (0.0, 0.0, 0.0)
    for n in range(px.shape[0]):
        first = transform_point(xa[n], ya[n], za[n], owner, matrices)
        x = third_part * (xb[n] - xa[n]) + third_part * (xc[n] - xa[n])
        y = third_part * (yb[n] - ya[n]) + third_part * (yc[n] - ya[n])
        z = third_part * (zb[n] - za[n]) + third_part * (zc[n] - za[n])
        centroid = (
            first[0] + (m[0] * x + m[1] * y + m[2] * z),
            first[1] + (m[3] * x + m[4] * y + m[5] * z),
            first[2] + (m[6] * x + m[7] * y + m[8] * z),
        )
        point = centroid, zero, zero, matrix
        px[n], py[n], pz[n] = blend_point(second[n], third[n], point)


@disjoint_helper
def interpolate_span_points(px, py, pz, second, third, point):
    """Write the positions of the samples of one face."""
    for n in range(px.shape[0]):
        px[n], py[n], pz[n] = blend_point(second[n], third[n], point)


@helper
def edge_vector(p, a, b):
    """Return the vector from one vertex to another, model space."""
    return p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]


@stage
def find_points(
    block: Block, count, placement: Placement, materials: float32[:, ::1], only_flat: int64
):  # fmt: skip
    """
    Write the positions of samples, world axes, relative to the eye. After `gather_positions`.

    Parameters
    ----------
    block : Block
    count : int
    placement : Placement
    materials : (O, M) float32
    only_flat : int
        Not 0: write positions of flat objects alone, once these are lit at their faces' centroids.
    """
    samples, ints, weights, doubles = block.samples, block.ints, block.weights, block.doubles
    p, matrices = placement.positions, placement.relative_from_model
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        s, e = np.int64(segment[rows.START]), np.int64(segment[rows.STOP])
        owner = np.int64(segment[rows.OWNER])
        if only_flat == 0:
            e = s + round_up_to_vectors(e - s)
        elif np.int64(materials[np.uintp(owner), MATERIAL_MODEL]) != FLAT:
            continue
        matrix = get_linear_part(matrices, owner)
        if segment[rows.KIND] == rows.MIXED:
            interpolate_points(
                *three_parts(samples, rows.POINT_X, s, e), *nine_parts(doubles, 0, s, e),
                part(weights, 0, s, e), part(weights, 1, s, e), owner, matrices, matrix,
            )  # fmt: skip
        else:
            a, b, c = get_span_vertices(segment, ints)
            first = transform_vertex(a, owner, placement)
            interpolate_span_points(
                *three_parts(samples, rows.POINT_X, s, e), part(weights, 0, s, e),
                part(weights, 1, s, e), (first, edge_vector(p, a, b), edge_vector(p, a, c), matrix),
            )  # fmt: skip


@stage
def find_centroids(block: Block, count, placement: Placement, materials: float32[:, ::1]):
    """Write the centroids of faces as positions of flat objects. After `gather_positions`."""
    samples, ints, weights, doubles = block.samples, block.ints, block.weights, block.doubles
    zero, center = (0.0, 0.0, 0.0), (1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0)
    matrices = placement.relative_from_model
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        if np.int64(materials[np.uintp(segment[rows.OWNER]), MATERIAL_MODEL]) != FLAT:
            continue
        s, e = np.int64(segment[rows.START]), np.int64(segment[rows.STOP])
        owner = np.int64(segment[rows.OWNER])
        matrix = get_linear_part(matrices, owner)
        if segment[rows.KIND] == rows.MIXED:
            find_mixed_centroids(
                *three_parts(samples, rows.POINT_X, s, e), *nine_parts(doubles, 0, s, e),
                part(weights, 0, s, e), part(weights, 1, s, e), owner, matrices, matrix,
            )  # fmt: skip
        else:
            a, b, c = get_span_vertices(segment, ints)
            point = interpolate_point(center, a, b, c, owner, placement), zero, zero, matrix
            interpolate_span_points(
                *three_parts(samples, rows.POINT_X, s, e), part(weights, 0, s, e),
                part(weights, 1, s, e), point,
            )  # fmt: skip


@stage
def fill_placeholders(block: Block, count, is_placeholder: uint8[::1]):
    """
    Write placeholder normals and points on objects whose colour does not depend on them.

    Such objects are lit at their vertices, without fog. Light computed with the placeholders is not
    used, but must be finite.
    """
    samples, zero, one = block.samples, np.float32(0.0), np.float32(1.0)
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        if is_placeholder[np.uintp(segment[rows.OWNER])] == 0:
            continue
        for n in range(np.uintp(segment[rows.START]), np.uintp(segment[rows.STOP])):
            samples[rows.NORMAL_X, n], samples[rows.NORMAL_Y, n] = zero, zero
            samples[rows.NORMAL_Z, n] = one
            samples[rows.POINT_X, n], samples[rows.POINT_Y, n] = zero, zero
            samples[rows.POINT_Z, n] = zero


@helper
def multiply_vertex_alphas(samples, first, end, weights, corners, vertex_colors):
    """Multiply the alphas of some samples of one face by those of its vertices, interpolated."""
    a, b, c = corners
    at_a, at_b, at_c = (
        np.float64(vertex_colors[a, 3]), np.float64(vertex_colors[b, 3]),
        np.float64(vertex_colors[c, 3]),
    )  # fmt: skip
    for n in range(first, end):
        w = 0.0, weights[0, n], weights[1, n]
        samples[rows.ALPHA, n] *= np.float32(interpolate(w, at_a, at_b, at_c))


@stage
def find_alphas(
    block: Block, count, is_blended: uint8[::1], materials: float32[:, ::1],
    face_colors: float32[:, ::1], vertex_colors: float32[:, ::1], has_textures: int64,
):  # fmt: skip
    """
    Write the alpha of each sample: the product of material's, colours' and texture's.

    1 on objects that are not blended. Right after `read_textures` of base colours if
    ``has_textures`` is not 0.

    Parameters
    ----------
    is_blended : (O,) uint8
    materials : (O, 7) float32
    face_colors : (F, 4) float32, or (0, 4) without
    vertex_colors : (V, 4) float32, or (0, 4) without
    has_textures : int
    """
    samples, ints, weights = block.samples, block.ints, block.weights
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        s, e = np.uintp(segment[rows.START]), np.uintp(segment[rows.STOP])
        alpha = materials[owner, 3] if is_blended[owner] != 0 else np.float32(1.0)
        for n in range(s, e):
            samples[rows.ALPHA, n] = alpha
        if is_blended[owner] == 0:
            continue
        for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
            first, end = get_patch_samples(ints, r)
            if face_colors.shape[0] > 0:
                for n in range(first, end):
                    samples[rows.ALPHA, n] *= face_colors[np.uintp(ints[rows.FACE, r]), 3]
            if vertex_colors.shape[0] > 0:
                corners = get_patch_vertices(ints, r)
                multiply_vertex_alphas(samples, first, end, weights, corners, vertex_colors)
        if has_textures != 0:
            for n in range(s, e):
                samples[rows.ALPHA, n] *= block.colors[TEXTURE_ALPHA, n]
