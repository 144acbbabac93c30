"""
Shade a row of samples by Blinn-Phong: ambient, Lambertian diffuse and specular highlight.

Samples are rows of scratch memory, one row for each quantity (structure of arrays), float32, so
that the loops vectorize. ``power`` is built from IEEE operations alone: it has the same bits on
every CPU, which a math library's ``pow`` has not.

Light beyond the range of float32 is black: lamps whose squared distance overflows, highlights on
points so far from the eye, and all light where a point or a normal is NaN. Where NaN is to give
a constant, that comes first: ``max(a, NaN)`` is ``a``, ``max(NaN, a)`` is NaN.

References
----------
.. [1] J. Blinn, "Models of Light Reflection for Computer Synthesized Pictures", SIGGRAPH 1977.
.. [2] glTF 2.0 extension KHR_lights_punctual: range and cones.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.runtime.float_math import power
from rasterjit.runtime.intrinsics import three_parts
from rasterjit.runtime.jit import disjoint_helper, helper

MIN_LENGTH_SQUARED = np.float32(1e-29)
"""Least squared distance, scene units squared: keeps the brightest light finite at its position."""

MAX_IRRADIANCE, MIN_LIMITED_INTENSITY = np.float32(1e38), np.float32(1e9)
"""Largest irradiance; intensities of up to the second number cannot exceed it."""

IS_POSITIONAL = 3
"""Column of ``Lighting.lights``: 1 for a positional light, 0 for a directional one."""
DIRECTION_X, DIRECTION_Y, DIRECTION_Z = 7, 8, 9
"""Columns of ``Lighting.lights``: the axis of a cone, unit length, away from the light."""
CONE_SCALE, CONE_OFFSET = 10, 11
"""
Columns: the ramp ``offset - scale v``, clamped to 0..1 and squared; (0, 1) for no cone.

``v`` is one less the cosine from the axis, computed as half the squared distance of both unit
vectors: float32 resolves angles by it that have the same cosine.
"""
INVERSE_RANGE_SQUARED = 12
"""Column: one over the range squared; 0 for no limit."""
LIGHT_COLUMNS = 13


@disjoint_helper
def write_ambient(red, green, blue, lit, ambient, occlusion, out_red, out_green, out_blue):
    """Write the colour of unlit samples, and ambient light on the others."""
    for i in range(out_red.shape[0]):
        unlit, ambient_weight = np.float32(1.0) - lit[i], lit[i] * occlusion[i]
        out_red[i] = red[i] * (unlit + ambient_weight * ambient[0])
        out_green[i] = green[i] * (unlit + ambient_weight * ambient[1])
        out_blue[i] = blue[i] * (unlit + ambient_weight * ambient[2])


@disjoint_helper
def normalize_rows(x, y, z):
    """Scale vectors to length one; a vector of length zero stays zero."""
    for i in range(x.shape[0]):
        squared = x[i] * x[i] + y[i] * y[i] + z[i] * z[i]
        scale = np.float32(1.0) / np.sqrt(max(squared, MIN_LENGTH_SQUARED))
        x[i] *= scale
        y[i] *= scale
        z[i] *= scale


@helper
def invert_length(x, y, z):
    """Return one over a vector's length; 0 where its square overflows."""
    return np.float32(1.0) / np.sqrt(max(MIN_LENGTH_SQUARED, x * x + y * y + z * z))


@helper
def range_attenuation(squared, inverse_range_squared):
    """Return a light's attenuation by its range at a squared distance; NaN gives 0."""
    one, zero = np.float32(1.0), np.float32(0.0)
    ratio = squared * inverse_range_squared
    return max(zero, min(one - ratio * ratio, one))


@helper
def cone_attenuation(dx, dy, dz, scale, offset):
    """
    Return a spot light's attenuation by its cone, 0 for NaN.

    Takes the difference between its direction and its axis, both of unit length.
    """
    one, zero = np.float32(1.0), np.float32(0.0)
    versine = np.float32(0.5) * (dx * dx + dy * dy + dz * dz)
    ramp = max(zero, min(offset - versine * scale, one))
    return ramp * ramp


@helper
def aim_at_light(light, px, py, pz):
    """
    Return the unit direction from a point toward a light, and its attenuation there.

    A light without range and cone is multiplied by exactly 1 for them.
    """
    lx, ly, lz = light[0] - light[3] * px, light[1] - light[3] * py, light[2] - light[3] * pz
    scale = invert_length(lx, ly, lz)
    falloff = light[3] * scale * scale + (np.float32(1.0) - light[3])
    falloff = min(
        falloff, MAX_IRRADIANCE / max(MIN_LIMITED_INTENSITY, light[4], light[5], light[6])
    )
    falloff *= range_attenuation(lx * lx + ly * ly + lz * lz, light[INVERSE_RANGE_SQUARED])
    lx, ly, lz = lx * scale, ly * scale, lz * scale
    dx, dy, dz = lx + light[DIRECTION_X], ly + light[DIRECTION_Y], lz + light[DIRECTION_Z]
    return lx, ly, lz, falloff * cone_attenuation(dx, dy, dz, light[CONE_SCALE], light[CONE_OFFSET])


@disjoint_helper
def add_diffuse_light(
    light, nx, ny, nz, lx, ly, lz, falloff, lit, visibility, red, green, blue, out_red, out_green,
    out_blue,
):  # fmt: skip
    """Add the diffuse part of one light to each sample that it reaches."""
    for i in range(out_red.shape[0]):
        n_l = max(np.float32(0.0), nx[i] * lx[i] + ny[i] * ly[i] + nz[i] * lz[i])
        weight = lit[i] * falloff[i] * visibility[i]
        out_red[i] += weight * light[4] * (red[i] * n_l)
        out_green[i] += weight * light[5] * (green[i] * n_l)
        out_blue[i] += weight * light[6] * (blue[i] * n_l)


@disjoint_helper
def find_view_directions(toward_viewer, px, py, pz, vx, vy, vz, in_range):
    """Write unit directions toward the viewer, and 1; 0 where they exceed the range of float32."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(px.shape[0]):
        x = toward_viewer[0] - toward_viewer[3] * px[i]
        y = toward_viewer[1] - toward_viewer[3] * py[i]
        z = toward_viewer[2] - toward_viewer[3] * pz[i]
        scale = invert_length(x, y, z)
        vx[i], vy[i], vz[i] = x * scale, y * scale, z * scale
        in_range[i] = one if scale > zero else zero


@disjoint_helper
def find_light_directions(light, px, py, pz, lx, ly, lz, falloff):
    """Write the unit directions toward a light, and its attenuation, by `aim_at_light`."""
    zero = np.float32(0.0)
    if light[3] == zero:
        # A directional light is the same at every finite point.
        x, y, z, attenuation = aim_at_light(light, zero, zero, zero)
        for i in range(px.shape[0]):
            lx[i], ly[i], lz[i] = x, y, z
            falloff[i] = attenuation if zero * px[i] + zero * py[i] + zero * pz[i] == zero else zero
    else:
        for i in range(px.shape[0]):
            lx[i], ly[i], lz[i], falloff[i] = aim_at_light(light, px[i], py[i], pz[i])


@disjoint_helper
def find_cosines(nx, ny, nz, specular, vx, vy, vz, in_range, lx, ly, lz):
    """Overwrite directions to a light by n·l, n·h and the strength of the highlight."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(nx.shape[0]):
        n_l = max(zero, nx[i] * lx[i] + ny[i] * ly[i] + nz[i] * lz[i])
        # Find the half vector between light and viewer.
        hx, hy, hz = lx[i] + vx[i], ly[i] + vy[i], lz[i] + vz[i]
        n_h = max(zero, (nx[i] * hx + ny[i] * hy + nz[i] * hz) * invert_length(hx, hy, hz))
        lx[i], ly[i] = n_l, min(n_h, one)
        lz[i] = specular[i] if (n_l > zero) & (in_range[i] > zero) else zero


@disjoint_helper
def scale_highlights(shininess, n_h, highlight):
    """Scale the strength of highlights by n·h raised to the shininess."""
    for i in range(highlight.shape[0]):
        highlight[i] *= power(n_h[i], shininess[i])


@disjoint_helper
def add_blinn_phong_light(
    light, n_l, highlight, falloff, lit, visibility, red, green, blue, out_red, out_green, out_blue,
):  # fmt: skip
    """Add the diffuse part and the highlight of one light to each sample that it reaches."""
    for i in range(out_red.shape[0]):
        weight = lit[i] * falloff[i] * visibility[i]
        out_red[i] += weight * light[4] * (red[i] * n_l[i] + highlight[i])
        out_green[i] += weight * light[5] * (green[i] * n_l[i] + highlight[i])
        out_blue[i] += weight * light[6] * (blue[i] * n_l[i] + highlight[i])


@helper
def normalize_normals(samples, count):
    """Scale the normals to length one."""
    normalize_rows(*three_parts(samples, rows.NORMAL_X, 0, count))
