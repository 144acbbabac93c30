"""
Apply material maps: normal, metallic-roughness, occlusion and emissive textures.

All as glTF 2.0 defines them. A normal map holds normals in tangent space: x along the tangent,
where u grows, y to the side of it where v grows, z along the shading normal. ``scene.normals``
defines tangents, which may differ across a mirrored seam; here they are interpolated and
orthogonalized against the shading normal. Without a tangent (no area in the texture, or parallel to
the normal), the shading normal is kept.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), sections 3.7.2.1 and 3.9.3.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import blend, matrix_of
from rasterjit.pipeline.records import Placement
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface import texture_filters as texturing
from rasterjit.pipeline.surface import texture_lookup
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.intrinsics import LANES, part, spread, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int64

NORMAL_SCALE, OCCLUSION_STRENGTH, EMITTED = 0, 1, 2
"""Columns of ``Maps.factors``; the last begins three."""

MIN_TANGENT = 1e-10
"""Least part of a tangent's squared length left after orthogonalization; below, there is none."""


@helper
def is_mirrored(a, b, c, uv):
    """Return whether the texture is mirrored on a face, seen from the front."""
    ua, va = np.float64(uv[a, 0]), np.float64(uv[a, 1])
    across = (np.float64(uv[b, 0]) - ua) * (np.float64(uv[c, 1]) - va)
    back = (np.float64(uv[c, 0]) - ua) * (np.float64(uv[b, 1]) - va)
    return across < back


@disjoint_helper
def bend_normals(
    nx, ny, nz, xa, ya, za, xb, yb, zb, xc, yc, zc, handed, second, third, behind, right, up, out,
    scale, matrix,
):  # fmt: skip
    """
    Write normals perturbed by a normal map, world axes, any length, and 1 where there is one, or 0.

    Takes the shading normals and the tangents of the vertices, none of them normalized. Writes the
    normals in place of the first vertex's tangents, and whether there is one in place of x of the
    second's: not where there is no direction to bend to, or the map shows the shading normal.
    """
    m = matrix
    for n in range(nx.shape[0]):
        along = scale * (np.float64(right[n]) - 0.5)
        aside = scale * (np.float64(up[n]) - 0.5)
        ahead = 2.0 * np.float64(out[n]) - 1.0
        is_flat = (along == 0.0) & (aside == 0.0)
        # A back face gets the bent normal of its front, flipped.
        along = (1.0 - 2.0 * np.float64(behind[n])) * along
        aside = handed[n] * aside
        # Interpolate the tangent.
        weights = (0.0, second[n], third[n])
        x = blend(weights, np.float64(xa[n]), np.float64(xb[n]), np.float64(xc[n]))
        y = blend(weights, np.float64(ya[n]), np.float64(yb[n]), np.float64(yc[n]))
        z = blend(weights, np.float64(za[n]), np.float64(zb[n]), np.float64(zc[n]))
        tx = m[0] * x + m[1] * y + m[2] * z
        ty = m[3] * x + m[4] * y + m[5] * z
        tz = m[6] * x + m[7] * y + m[8] * z
        # Make it perpendicular to the normal.
        ux, uy, uz = np.float64(nx[n]), np.float64(ny[n]), np.float64(nz[n])
        length = np.sqrt(ux * ux + uy * uy + uz * uz)
        ux, uy, uz = ux / length, uy / length, uz / length
        full = tx * tx + ty * ty + tz * tz
        share = tx * ux + ty * uy + tz * uz
        tx, ty, tz = tx - share * ux, ty - share * uy, tz - share * uz
        left = tx * tx + ty * ty + tz * tz
        is_told = (length > 0.0) & (MIN_TANGENT * full < left) & (left < np.inf)
        length = np.sqrt(left)
        tx, ty, tz = tx / length, ty / length, tz / length
        bx = along * tx + aside * (uy * tz - uz * ty) + ahead * ux
        by = along * ty + aside * (uz * tx - ux * tz) + ahead * uy
        bz = along * tz + aside * (ux * ty - uy * tx) + ahead * uz
        is_told &= (bx * bx + by * by + bz * bz > 0.0) & (not is_flat)
        xa[n], ya[n], za[n] = np.float32(bx), np.float32(by), np.float32(bz)
        xb[n] = np.float32(1.0 if is_told else 0.0)


@disjoint_helper
def take_bent(bent, is_told, normal):
    """Write one component of the perturbed normals where there are any."""
    for n in range(normal.shape[0]):
        normal[n] = bent[n] if is_told[n] > np.float32(0.0) else normal[n]


@helper
def scale_facets(samples, count, shown):
    """Multiply metallic and roughness by what the textures show in blue and green."""
    for n in range(count):
        samples[rows.METALLIC, n] *= shown[texture_lookup.SHOWN + 2, n]
        samples[rows.ROUGHNESS, n] *= shown[texture_lookup.SHOWN + 1, n]


@helper
def scale_occlusion(samples, count, places, colors, factors):
    """Hold back ambient light by what the textures show in red."""
    one = np.float32(1.0)
    for n in range(count):
        owner = np.int64(places[texture_lookup.OWNER, n])
        shown = colors[texture_lookup.SHOWN, n]
        share = one + factors[owner, OCCLUSION_STRENGTH] * (shown - one)
        samples[rows.OCCLUSION, n] *= max(min(share, one), np.float32(0.0))


@helper
def scale_emission(samples, count, shown):
    """Multiply the light that is sent out by what the textures show."""
    for k in range(3):
        for n in range(count):
            samples[rows.EMISSIVE_RED + k, n] *= shown[texture_lookup.SHOWN + k, n]


@disjoint_helper
def add_emission(
    emitted_red, emitted_green, emitted_blue, red, green, blue
):  # fmt: skip
    """Add the light that surfaces send out."""
    for i in range(red.shape[0]):
        red[i] += emitted_red[i]
        green[i] += emitted_green[i]
        blue[i] += emitted_blue[i]


@helper
def gather_tangents(segment, block, uv, tangents, mirrored):
    """Gather the tangents of a segment's vertices, and the sign of the bitangent."""
    whole, rows_of, handed = block.whole, block.single, block.real[0]
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        a, b, c = (
            np.uintp(whole[rows.A, r]), np.uintp(whole[rows.B, r]), np.uintp(whole[rows.C, r])
        )  # fmt: skip
        group = np.int64(1 if is_mirrored(a, b, c, uv) else 0)
        way = np.float64(tangents[a, group, 3]) * mirrored
        first, end = np.int64(whole[rows.FIRST, r]), np.int64(whole[rows.FIRST, r + np.uintp(1)])
        for n in range(first, end, LANES):
            start = np.uintp(n)
            spread(handed, start, way)
            for k in range(3):
                spread(rows_of[k], start, tangents[a, group, k])
                spread(rows_of[3 + k], start, tangents[b, group, k])
                spread(rows_of[6 + k], start, tangents[c, group, k])


@helper
def bend_segment(segment, block, uv, tangents, scale, matrix, mirrored):
    """Perturb the normals of a segment by a normal map."""
    gather_tangents(segment, block, uv, tangents, mirrored)
    s, r, w, shown = block.samples, block.single, block.weights, block.colors
    a, e = np.int64(segment[rows.START]), np.int64(segment[rows.STOP])
    nx, ny, nz = three_parts(s, rows.NORMAL_X, a, e)
    bx, by, bz, told = part(r, 0, a, e), part(r, 1, a, e), part(r, 2, a, e), part(r, 3, a, e)
    bend_normals(
        nx, ny, nz, bx, by, bz, told, *three_parts(r, 4, a, e), part(r, 7, a, e), part(r, 8, a, e),
        part(block.real, 0, a, e), part(w, 0, a, e), part(w, 1, a, e),
        part(block.whole, rows.BEHIND, a, e), *three_parts(shown, texture_lookup.SHOWN, a, e),
        scale, matrix,
    )  # fmt: skip
    take_bent(bx, told, nx)
    take_bent(by, told, ny)
    take_bent(bz, told, nz)


@stage
def bend_normals_by_maps(
    block: Block, count, table: int64[:, :, ::1], uv: float32[:, ::1],
    tangents: float32[:, :, ::1], factors: float32[:, ::1], placement: Placement,
):  # fmt: skip
    """Perturb the normals by normal maps."""
    for k in range(block.counts[rows.SEGMENTS]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        if table[owner, texturing.NORMAL, texturing.FIRST_LEVEL] >= 0:
            bend_segment(
                segment, block, uv, tangents, 2.0 * np.float64(factors[owner, NORMAL_SCALE]),
                matrix_of(placement.relative_from_model, owner), placement.mirrored[owner],
            )  # fmt: skip


@stage
def scale_facets_by_maps(block: Block, count):
    """Multiply metallic and roughness by what the textures show in blue and green."""
    scale_facets(block.samples, count, block.colors)


@stage
def scale_occlusion_by_maps(block: Block, count, factors: float32[:, ::1]):
    """Hold back ambient light by what the textures show in red."""
    scale_occlusion(block.samples, count, block.places, block.colors, factors)


@stage
def find_emission(block: Block, count, factors: float32[:, ::1]):
    """Write the objects' emissive factors."""
    samples = block.samples
    for k in range(block.counts[rows.SEGMENTS]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        red, green, blue = (
            factors[owner, EMITTED], factors[owner, EMITTED + 1], factors[owner, EMITTED + 2]
        )  # fmt: skip
        for n in range(np.uintp(segment[rows.START]), np.uintp(segment[rows.STOP])):
            samples[rows.EMISSIVE_RED, n] = red
            samples[rows.EMISSIVE_GREEN, n] = green
            samples[rows.EMISSIVE_BLUE, n] = blue


@stage
def scale_emission_by_maps(block: Block, count):
    """Multiply the light that is sent out by what the textures show."""
    scale_emission(block.samples, count, block.colors)


@stage
def show_emission(block: Block, count, shown: int64):
    """Add emission to the three rows of samples from ``shown`` on."""
    s = block.samples
    add_emission(
        s[rows.EMISSIVE_RED, :count], s[rows.EMISSIVE_GREEN, :count], s[rows.EMISSIVE_BLUE, :count],
        *three_parts(s, shown, 0, count),
    )  # fmt: skip
