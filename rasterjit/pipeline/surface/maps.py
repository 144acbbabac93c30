"""
Read what else lies over a surface: normals, metallic and roughness, occlusion, emission.

All as glTF 2.0 defines them. A normal map holds normals in tangent space: x along the tangent,
where u grows, y to the side of it where v grows, z along the shading normal. What tangents are, and
that they may differ on both sides of a mirrored seam, is told in ``scene.normals``; here they are
interpolated and made perpendicular to the shading normal. Where there is no tangent (no area on the
picture, or along the normal), the shading normal stays as it is.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), sections 3.7.2.1 and 3.9.3.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.geometry.barycentric import blend, matrix_of
from rasterjit.pipeline.records import Placement
from rasterjit.pipeline.surface import samples as rows
from rasterjit.pipeline.surface import texture_lookup
from rasterjit.pipeline.surface import textures as texturing
from rasterjit.pipeline.surface.samples import Block
from rasterjit.runtime.intrinsics import part
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state import float32, int64

NORMAL_SCALE, OCCLUSION_STRENGTH, EMITTED = 0, 1, 2
"""Columns of ``Maps.factors``; the last begins three."""

LEAST_TANGENT = 1e-10
"""Share of a tangent's squared length that must be left when it is made perpendicular."""


@helper
def is_mirrored(a, b, c, uv):
    """Return whether the picture is seen mirrored on a face, from its front."""
    ua, va = np.float64(uv[a, 0]), np.float64(uv[a, 1])
    across = (np.float64(uv[b, 0]) - ua) * (np.float64(uv[c, 1]) - va)
    back = (np.float64(uv[c, 0]) - ua) * (np.float64(uv[b, 1]) - va)
    return across < back


@helper
def tangent_at(second, third, a, b, c, group, tangents, matrix):
    """Return the interpolated tangent in world axes, any length."""
    weights = (0.0, second, third)
    x = blend(weights, np.float64(tangents[a, group, 0]), np.float64(tangents[b, group, 0]),
              np.float64(tangents[c, group, 0]))  # fmt: skip
    y = blend(weights, np.float64(tangents[a, group, 1]), np.float64(tangents[b, group, 1]),
              np.float64(tangents[c, group, 1]))  # fmt: skip
    z = blend(weights, np.float64(tangents[a, group, 2]), np.float64(tangents[b, group, 2]),
              np.float64(tangents[c, group, 2]))  # fmt: skip
    m = matrix
    return (
        m[0] * x + m[1] * y + m[2] * z,
        m[3] * x + m[4] * y + m[5] * z,
        m[6] * x + m[7] * y + m[8] * z,
    )


@helper
def bent_normal(normal, tangent, along, aside, ahead):
    """
    Return the normal that has these parts in tangent space, world axes, any length.

    Takes the shading normal and the tangent, neither of them normalized; without a direction to
    bend to, the shading normal is returned as it is.
    """
    nx, ny, nz = normal
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    if not length > 0.0:
        return normal
    ux, uy, uz = nx / length, ny / length, nz / length
    tx, ty, tz = tangent
    full = tx * tx + ty * ty + tz * tz
    share = tx * ux + ty * uy + tz * uz
    tx, ty, tz = tx - share * ux, ty - share * uy, tz - share * uz
    left = tx * tx + ty * ty + tz * tz
    if not LEAST_TANGENT * full < left < np.inf:
        return normal
    length = np.sqrt(left)
    tx, ty, tz = tx / length, ty / length, tz / length
    bent = (
        along * tx + aside * (uy * tz - uz * ty) + ahead * ux,
        along * ty + aside * (uz * tx - ux * tz) + ahead * uy,
        along * tz + aside * (ux * ty - uy * tx) + ahead * uz,
    )
    if bent[0] * bent[0] + bent[1] * bent[1] + bent[2] * bent[2] > 0.0:
        return bent
    return normal


@helper
def put_bent_normal(samples, n, tangent, along, aside, side, handed, shown):
    """Bend the normal of a sample by what its texture shows, the first two parts of it scaled."""
    normal = (
        np.float64(samples[rows.NORMAL_X, n]), np.float64(samples[rows.NORMAL_Y, n]),
        np.float64(samples[rows.NORMAL_Z, n]),
    )  # fmt: skip
    # A back shows the same surface: its normal, which is the other way round there.
    ahead = 2.0 * np.float64(shown[texture_lookup.SHOWN + 2, n]) - 1.0
    bent = bent_normal(normal, tangent, side * along, handed * aside, ahead)
    samples[rows.NORMAL_X, n] = np.float32(bent[0])
    samples[rows.NORMAL_Y, n] = np.float32(bent[1])
    samples[rows.NORMAL_Z, n] = np.float32(bent[2])


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
def bend_segment(segment, block, uv, tangents, scale, matrix, mirrored):
    """Bend the normals of a segment by what a normal map shows."""
    samples, weights, shown, whole = block.samples, block.weights, block.colors, block.whole
    for r in range(np.uintp(segment[rows.FIRST_PATCH]), np.uintp(segment[rows.END_PATCH])):
        a, b, c = (
            np.uintp(whole[rows.A, r]), np.uintp(whole[rows.B, r]), np.uintp(whole[rows.C, r])
        )  # fmt: skip
        group = np.int64(1 if is_mirrored(a, b, c, uv) else 0)
        handed = np.float64(tangents[a, group, 3]) * mirrored
        first, end = whole[rows.FIRST, r], whole[rows.FIRST, r + np.uintp(1)]
        for n in range(np.uintp(first), np.uintp(end)):
            along = scale * (np.float64(shown[texture_lookup.SHOWN, n]) - 0.5)
            aside = scale * (np.float64(shown[texture_lookup.SHOWN + 1, n]) - 0.5)
            if along == 0.0 and aside == 0.0:
                continue
            side = 1.0 - 2.0 * np.float64(whole[rows.BEHIND, n])
            tangent = tangent_at(weights[0, n], weights[1, n], a, b, c, group, tangents, matrix)
            put_bent_normal(samples, n, tangent, along, aside, side, handed, shown)


@stage
def bend_normals_by_maps(
    block: Block, count, table: int64[:, :, ::1], uv: float32[:, ::1],
    tangents: float32[:, :, ::1], factors: float32[:, ::1], placement: Placement,
):  # fmt: skip
    """Bend the normals by what the normal maps show."""
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
    """Write the light that the objects send out."""
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
    """Add the light that is sent out to the three rows of samples from ``shown`` on."""
    s = block.samples
    add_emission(
        s[rows.EMISSIVE_RED, :count], s[rows.EMISSIVE_GREEN, :count],
        s[rows.EMISSIVE_BLUE, :count], part(s, shown, 0, count), part(s, shown + 1, 0, count),
        part(s, shown + 2, 0, count),
    )  # fmt: skip
