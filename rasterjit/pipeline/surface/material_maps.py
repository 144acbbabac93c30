"""
Apply material maps: normal, metallic-roughness, occlusion and emissive textures.

All as glTF 2.0 defines them. A normal map holds normals in tangent space: x along the tangent,
where u grows, y to the side of it where v grows, z along the shading normal. ``scene.normals``
defines tangents, which may differ across a mirrored seam; here they are interpolated and
orthogonalized against the shading normal. Without a tangent (no area in the texture, or parallel to
the normal), the shading normal stays.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), sections 3.7.2.1 and 3.9.3.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import blend, get_linear_part
from rasterjit.pipeline.records import Placement
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface import texture_filters as texturing
from rasterjit.pipeline.surface import texture_lookup
from rasterjit.pipeline.surface.gather_samples import get_patch_vertices
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.intrinsics import LANES, part, spread, three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32, int64

NORMAL_SCALE, OCCLUSION_STRENGTH, EMISSIVE = 0, 1, 2
"""Columns of ``Maps.factors``; the last begins three."""

TANGENT_A, TANGENT_B, TANGENT_C = 0, 3, 6
"""First of three rows of ``Block.floats`` for the tangents of each vertex of a patch."""

MIN_TANGENT_SHARE = 1e-10
"""Least share of a tangent's squared length left by orthogonalization; with less, there is none."""


@helper
def is_mirrored(a, b, c, uv):
    """Return whether the texture is mirrored on a face, seen from the front."""
    ua, va = np.float64(uv[a, 0]), np.float64(uv[a, 1])
    right = (np.float64(uv[b, 0]) - ua) * (np.float64(uv[c, 1]) - va)
    left = (np.float64(uv[c, 0]) - ua) * (np.float64(uv[b, 1]) - va)
    return right < left


@disjoint_helper
def perturb_normals(
    nx, ny, nz, xa, ya, za, xb, yb, zb, xc, yc, zc, bitangent_signs, weight_b, weight_c, backface,
    red, green, blue, double_scale, matrix,
):  # fmt: skip
    """
    Write normals perturbed by a normal map, world axes, any length, and 1 where valid, else 0.

    Takes the shading normals and the tangents of the vertices, none of them normalized. Writes the
    normals over the first vertex's tangents, and their validity over x of the second's: invalid
    without a tangent, and where the map holds the shading normal.
    """
    m = matrix
    for n in range(nx.shape[0]):
        map_x = double_scale * (np.float64(red[n]) - 0.5)
        map_y = double_scale * (np.float64(green[n]) - 0.5)
        map_z = 2.0 * np.float64(blue[n]) - 1.0
        is_flat = (map_x == 0.0) & (map_y == 0.0)
        # A back face gets the perturbed normal of its front, flipped.
        map_x = (1.0 - 2.0 * np.float64(backface[n])) * map_x
        map_y = bitangent_signs[n] * map_y
        # Interpolate the tangent; ``blend`` ignores the first weight.
        weights = (0.0, weight_b[n], weight_c[n])
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
        squared = tx * tx + ty * ty + tz * tz
        projection = tx * ux + ty * uy + tz * uz
        tx, ty, tz = tx - projection * ux, ty - projection * uy, tz - projection * uz
        remaining = tx * tx + ty * ty + tz * tz
        is_valid = (length > 0.0) & (MIN_TANGENT_SHARE * squared < remaining) & (remaining < np.inf)
        length = np.sqrt(remaining)
        tx, ty, tz = tx / length, ty / length, tz / length
        px = map_x * tx + map_y * (uy * tz - uz * ty) + map_z * ux
        py = map_x * ty + map_y * (uz * tx - ux * tz) + map_z * uy
        pz = map_x * tz + map_y * (ux * ty - uy * tx) + map_z * uz
        is_valid &= (px * px + py * py + pz * pz > 0.0) & (not is_flat)
        xa[n], ya[n], za[n] = np.float32(px), np.float32(py), np.float32(pz)
        xb[n] = np.float32(1.0 if is_valid else 0.0)


@disjoint_helper
def replace_perturbed(perturbed, is_valid, normal):
    """Replace one component of the normals by the perturbed one, where valid."""
    for n in range(normal.shape[0]):
        normal[n] = perturbed[n] if is_valid[n] > np.float32(0.0) else normal[n]


@disjoint_helper
def add_colors(emitted_red, emitted_green, emitted_blue, red, green, blue):
    """Add emitted light to three rows of colours."""
    for i in range(red.shape[0]):
        red[i] += emitted_red[i]
        green[i] += emitted_green[i]
        blue[i] += emitted_blue[i]


@helper
def gather_tangents(segment, block, uv, tangents, mirror_sign):
    """Gather the tangents of a segment's vertices, and the sign of the bitangent."""
    ints, floats, bitangent_signs = block.ints, block.floats, block.doubles[0]
    for patch in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        a, b, c = get_patch_vertices(ints, patch)
        mirror_index = np.int64(1 if is_mirrored(a, b, c, uv) else 0)
        sign = np.float64(tangents[a, mirror_index, 3]) * mirror_sign
        first = np.int64(ints[rows.FIRST_SAMPLE, patch])
        end = np.int64(ints[rows.FIRST_SAMPLE, patch + np.uintp(1)])
        for n in range(first, end, LANES):
            start = np.uintp(n)
            spread(bitangent_signs, start, sign)
            for k in range(3):
                spread(floats[TANGENT_A + k], start, tangents[a, mirror_index, k])
                spread(floats[TANGENT_B + k], start, tangents[b, mirror_index, k])
                spread(floats[TANGENT_C + k], start, tangents[c, mirror_index, k])


@helper
def perturb_segment(segment, block, uv, tangents, double_scale, matrix, mirror_sign):
    """Perturb the normals of a segment by a normal map."""
    gather_tangents(segment, block, uv, tangents, mirror_sign)
    samples, floats, weights = block.samples, block.floats, block.weights
    s, e = np.int64(segment[rows.START]), np.int64(segment[rows.STOP])
    nx, ny, nz = three_parts(samples, rows.NORMAL_X, s, e)
    px, py, pz = three_parts(floats, TANGENT_A, s, e)
    # Shares memory with ``xb``.
    is_valid_row = part(floats, TANGENT_B, s, e)
    perturb_normals(
        nx, ny, nz, px, py, pz, is_valid_row, *three_parts(floats, TANGENT_B + 1, s, e),
        part(floats, TANGENT_C + 1, s, e), part(floats, TANGENT_C + 2, s, e),
        part(block.doubles, 0, s, e), part(weights, 0, s, e), part(weights, 1, s, e),
        part(block.ints, rows.BACKFACE, s, e),
        *three_parts(block.colors, texture_lookup.TEXTURE_RED, s, e), double_scale, matrix,
    )  # fmt: skip
    replace_perturbed(px, is_valid_row, nx)
    replace_perturbed(py, is_valid_row, ny)
    replace_perturbed(pz, is_valid_row, nz)


@stage
def apply_normal_maps(
    block: Block, count, texture_table: int64[:, :, ::1], uv: float32[:, ::1],
    tangents: float32[:, :, ::1], factors: float32[:, ::1], placement: Placement,
):  # fmt: skip
    """Perturb the normals by normal maps."""
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        if texture_table[owner, texturing.NORMAL, texturing.FIRST_LEVEL] >= 0:
            perturb_segment(
                segment, block, uv, tangents, 2.0 * np.float64(factors[owner, NORMAL_SCALE]),
                get_linear_part(placement.relative_from_model, owner), placement.mirrored[owner],
            )  # fmt: skip


@stage
def apply_metallic_roughness_maps(block: Block, count):
    """Multiply metallic and roughness by the blue and green channels of the textures."""
    samples, colors = block.samples, block.colors
    for n in range(count):
        samples[rows.METALLIC, n] *= colors[texture_lookup.TEXTURE_RED + 2, n]
        samples[rows.ROUGHNESS, n] *= colors[texture_lookup.TEXTURE_RED + 1, n]


@stage
def apply_occlusion_maps(block: Block, count, factors: float32[:, ::1]):
    """Multiply the occlusion factor by the red channel of the textures."""
    one = np.float32(1.0)
    for n in range(count):
        owner = np.int64(block.uv_rows[texture_lookup.UV_OWNER, n])
        texel = block.colors[texture_lookup.TEXTURE_RED, n]
        visible = one + factors[owner, OCCLUSION_STRENGTH] * (texel - one)
        block.samples[rows.OCCLUSION, n] *= max(min(visible, one), np.float32(0.0))


@stage
def fill_emission(block: Block, count, factors: float32[:, ::1]):
    """Write the objects' emissive factors."""
    samples = block.samples
    for k in range(block.counts[rows.SEGMENT_COUNT]):
        segment = block.segments[k]
        owner = np.uintp(segment[rows.OWNER])
        red, green, blue = (
            factors[owner, EMISSIVE], factors[owner, EMISSIVE + 1], factors[owner, EMISSIVE + 2]
        )  # fmt: skip
        for n in range(np.uintp(segment[rows.START]), np.uintp(segment[rows.STOP])):
            samples[rows.EMISSIVE_RED, n] = red
            samples[rows.EMISSIVE_GREEN, n] = green
            samples[rows.EMISSIVE_BLUE, n] = blue


@stage
def apply_emission_maps(block: Block, count):
    """Multiply emitted light by the textures."""
    for k in range(3):
        for n in range(count):
            texel = block.colors[texture_lookup.TEXTURE_RED + k, n]
            block.samples[rows.EMISSIVE_RED + k, n] *= texel


@stage
def add_emission(block: Block, count, first: int64):
    """Add emission to the three rows of samples from ``first`` on."""
    s = block.samples
    add_colors(
        s[rows.EMISSIVE_RED, :count], s[rows.EMISSIVE_GREEN, :count], s[rows.EMISSIVE_BLUE, :count],
        *three_parts(s, first, 0, count),
    )  # fmt: skip
