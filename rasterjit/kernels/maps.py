"""
Read what else lies over a surface: normals, metallic and roughness, occlusion, emission.

All as glTF 2.0 defines them. A normal map holds normals in tangent space: x along the tangent,
where u grows, y to the side of it where v grows, z along the shading normal. What tangents are, and
that they may differ on both sides of a mirrored seam, is told in ``scene.tangents``; here they are
interpolated and made perpendicular to the shading normal. Where there is no tangent (no area on the
picture, or along the normal), the shading normal stays as it is.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), sections 3.7.2.1 and 3.9.3.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels import texture_rows, texturing
from rasterjit.kernels.interpolation import blend, matrix_of, seen_from_behind
from rasterjit.kernels.jit import disjoint_stage, stage

NORMAL_SCALE, OCCLUSION_STRENGTH, EMITTED = 0, 1, 2
"""Columns of ``Maps.factors``; the last begins three."""

LEAST_TANGENT = 1e-10
"""Share of a tangent's squared length that must be left when it is made perpendicular."""

KEPT_ALPHA = texture_rows.MATT
"""Scratch row, which is free by then: the alpha that the base colour's texture shows."""


@stage
def write_emission(samples, run, owner, maps):
    """Write the light that an object sends out along a run, and that no ambient light is held."""
    if maps is None:
        return
    factors = maps.factors
    red, green, blue = (
        factors[owner, EMITTED], factors[owner, EMITTED + 1], factors[owner, EMITTED + 2]
    )  # fmt: skip
    for n in range(np.uintp(run[0]), np.uintp(run[1])):
        samples[lit.OCCLUSION, n] = np.float32(1.0)
        samples[lit.EMISSIVE_RED, n] = red
        samples[lit.EMISSIVE_GREEN, n] = green
        samples[lit.EMISSIVE_BLUE, n] = blue


@stage
def is_mirrored(a, b, c, uv):
    """Return whether the picture is seen mirrored on a face, from its front."""
    ua, va = np.float64(uv[a, 0]), np.float64(uv[a, 1])
    across = (np.float64(uv[b, 0]) - ua) * (np.float64(uv[c, 1]) - va)
    back = (np.float64(uv[c, 0]) - ua) * (np.float64(uv[b, 1]) - va)
    return across < back


@stage
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


@stage
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


@stage
def bend_normals(samples, weights, count, places, geometry, placement, textures, maps):
    """Bend the gathered normals by what the normal maps show."""
    table, uv, tangents, factors = textures.table, textures.uv, maps.tangents, maps.factors
    a, b, c = np.int64(-1), np.int64(-1), np.int64(-1)
    side, handed, group = 1.0, 1.0, np.int64(0)
    for n in range(count):
        owner = np.int64(places[texture_rows.OWNER, n])
        if table[owner, texturing.NORMAL, texturing.FIRST_LEVEL] < 0:
            continue
        scale = 2.0 * np.float64(factors[owner, NORMAL_SCALE])
        along = scale * (places[texture_rows.SHOWN, n] - 0.5)
        aside = scale * (places[texture_rows.SHOWN + 1, n] - 0.5)
        if along == 0.0 and aside == 0.0:
            continue
        corner = np.int64(places[texture_rows.CORNERS, n])
        second, third = (
            np.int64(places[texture_rows.CORNERS + 1, n]),
            np.int64(places[texture_rows.CORNERS + 2, n]),
        )  # fmt: skip
        if corner != a or second != b or third != c:
            a, b, c = corner, second, third
            group = np.int64(1 if is_mirrored(a, b, c, uv) else 0)
            side = -1.0 if seen_from_behind(a, b, c, owner, geometry, placement) else 1.0
            handed = np.float64(tangents[a, group, 3]) * placement.mirrored[owner]
        tangent = tangent_at(
            weights[0, n], weights[1, n], a, b, c, group, tangents,
            matrix_of(placement.relative_from_model, owner),
        )  # fmt: skip
        normal = (
            np.float64(samples[lit.NORMAL_X, n]), np.float64(samples[lit.NORMAL_Y, n]),
            np.float64(samples[lit.NORMAL_Z, n]),
        )  # fmt: skip
        # A back shows the same surface: its normal, which is the other way round there.
        ahead = 2.0 * places[texture_rows.SHOWN + 2, n] - 1.0
        bent = bent_normal(normal, tangent, side * along, handed * aside, ahead)
        samples[lit.NORMAL_X, n] = np.float32(bent[0])
        samples[lit.NORMAL_Y, n] = np.float32(bent[1])
        samples[lit.NORMAL_Z, n] = np.float32(bent[2])


@stage
def bend_normals_if_lit(
    samples, weights, count, places, geometry, placement, textures, lighting, maps
):  # fmt: skip
    """Bend the gathered normals; without light there are none."""
    if lighting is None:
        return
    bend_normals(samples, weights, count, places, geometry, placement, textures, maps)


@stage
def scale_facets(samples, count, places):
    """Multiply metallic and roughness by what the textures show in blue and green."""
    for n in range(count):
        samples[lit.METALLIC, n] *= np.float32(places[texture_rows.SHOWN + 2, n])
        samples[lit.ROUGHNESS, n] *= np.float32(places[texture_rows.SHOWN + 1, n])


@stage
def scale_occlusion(samples, count, places, factors):
    """Hold back ambient light by what the textures show in red."""
    one = np.float32(1.0)
    for n in range(count):
        owner = np.int64(places[texture_rows.OWNER, n])
        shown = np.float32(places[texture_rows.SHOWN, n])
        share = one + factors[owner, OCCLUSION_STRENGTH] * (shown - one)
        samples[lit.OCCLUSION, n] *= max(min(share, one), np.float32(0.0))


@stage
def scale_emission(samples, count, places):
    """Multiply the light that is sent out by what the textures show."""
    for k in range(3):
        for n in range(count):
            samples[lit.EMISSIVE_RED + k, n] *= np.float32(places[texture_rows.SHOWN + k, n])


@stage
def copy_row(places, count, source, target):
    """Copy one row of scratch to another."""
    for n in range(count):
        places[target, n] = places[source, n]


@stage
def read_textured_maps(
    samples, weights, lookup, count, places, geometry, placement, textures, lighting, maps
):  # fmt: skip
    """Apply the textures of all kinds but base colour; nothing if no object has a texture."""
    if textures is None:
        return
    alpha = texture_rows.SHOWN + 3
    copy_row(places, count, alpha, KEPT_ALPHA)
    for kind in range(texturing.NORMAL, texturing.KINDS):
        if maps.counts[kind] == 0:
            continue
        texture_rows.read_textures(places, lookup, count, kind, textures)
        if kind == texturing.NORMAL:
            bend_normals_if_lit(
                samples, weights, count, places, geometry, placement, textures, lighting, maps
            )
        elif kind == texturing.METALLIC_ROUGHNESS:
            scale_facets(samples, count, places)
        elif kind == texturing.OCCLUSION:
            scale_occlusion(samples, count, places, maps.factors)
        else:
            scale_emission(samples, count, places)
    copy_row(places, count, KEPT_ALPHA, alpha)


@stage
def read_maps(
    samples, weights, lookup, count, places, geometry, placement, surface, lighting, maps
):  # fmt: skip
    """
    Apply what lies over the gathered samples of a part of a row; nothing if there are no maps.

    Parameters
    ----------
    samples : (SAMPLE_ROWS, N) float32
        Changes the normals and rows METALLIC, ROUGHNESS, OCCLUSION and EMISSIVE_*.
    weights : (2, N) float64
    lookup : tuple, or None without textures
        What `texture_rows.lookup_memory` gave.
    count : int
    places : (texture_rows.SCRATCH_ROWS, N) float64, or None without textures
        Rows U..OWNER are read, rows SHOWN.. and MATT.. are overwritten, but for the alpha shown.
    geometry, placement, surface, lighting, maps : records
    """
    if maps is None:
        return
    read_textured_maps(
        samples, weights, lookup, count, places, geometry, placement, surface.textures,
        lighting, maps,
    )  # fmt: skip


@stage
def occlusion_of(samples, count, maps):
    """Return the shares of ambient light that reach the gathered samples; None if it is all."""
    if maps is None:
        return None
    return samples[lit.OCCLUSION, :count]


@disjoint_stage
def add_emission(
    emitted_red, emitted_green, emitted_blue, red, green, blue
):  # fmt: skip
    """Add the light that surfaces send out."""
    for i in range(red.shape[0]):
        red[i] += emitted_red[i]
        green[i] += emitted_green[i]
        blue[i] += emitted_blue[i]


@stage
def add_emission_row(samples, count, first, maps):
    """Add what the gathered samples send out to three rows from ``first`` on; nothing without."""
    if maps is None:
        return
    add_emission(
        samples[lit.EMISSIVE_RED, :count], samples[lit.EMISSIVE_GREEN, :count],
        samples[lit.EMISSIVE_BLUE, :count],
        samples[first, :count], samples[first + 1, :count], samples[first + 2, :count],
    )  # fmt: skip
