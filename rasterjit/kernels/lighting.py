"""
Add up the light on a row of samples: ambient, Lambert's diffuse and Blinn's highlight.

Samples are rows of scratch memory, one row for each quantity (structure of arrays), float32, so
that the loops vectorize. ``power`` is built from IEEE operations alone: it has the same bits on
every CPU, which a math library's ``pow`` has not. That one is used where it is asked for.

References
----------
.. [1] J. Blinn, "Models of Light Reflection for Computer Synthesized Pictures", SIGGRAPH 1977.
.. [2] glTF 2.0 extension KHR_lights_punctual: range and cones.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.library_math import library_exp2, library_power

RED, GREEN, BLUE, ALPHA = 0, 1, 2, 3
"""Rows: base colour, linear."""
NORMAL_X, NORMAL_Y, NORMAL_Z = 4, 5, 6
"""Rows: normal in world axes, any length."""
POINT_X, POINT_Y, POINT_Z = 7, 8, 9
"""Rows: position in world axes, relative to the eye."""
SPECULAR, SHININESS = 10, 11
"""Rows: strength and exponent of the highlight."""
LIT = 12
"""Row: 1 where light falls on the base colour, 0 where it is the final colour."""
OUT_RED, OUT_GREEN, OUT_BLUE = 13, 14, 15
"""Rows: the colour that is seen, linear."""
PLAIN_ROWS = 16
"""Rows of a scene without any of the effects that the rows below are for."""
METALLIC, ROUGHNESS, MICROFACET = 16, 17, 18
"""Rows: metallic and roughness, 0..1; 1 where the object is shaded by microfacets, else 0."""
OCCLUSION = 19
"""Row: share of ambient and environment light that reaches the sample, 0..1."""
EMISSIVE_RED, EMISSIVE_GREEN, EMISSIVE_BLUE = 20, 21, 22
"""Rows: light that the surface sends out by itself, linear."""
SHADOW = 23
"""Row: share of the light at hand that reaches the sample, 0..1."""
SAMPLE_ROWS = 24

SHORTEST_SQUARED = np.float32(1e-30)
"""Least squared length, scene units squared: a light at the very point it lights stays finite."""

DIRECTION_X, DIRECTION_Y, DIRECTION_Z = 7, 8, 9
"""Columns of ``Lighting.lights``: the axis of a cone, unit length, away from the light."""
CONE_SCALE, CONE_OFFSET = 10, 11
"""Columns: ramp in the cosine from the axis, held in 0..1 and squared; (0, 1) for no cone."""
ENDING = 12
"""Column: one over the range squared; 0 for no end."""
LIGHT_COLUMNS = 13

MANTISSA_BITS = np.int32(0x7FFFFF)
SQRT_HALF_BITS = np.int32(0x3F3504F3)
SMALLEST_NORMAL = np.float32(1.1754944e-38)


@stage
def log2(x):
    """
    Return log2 of a float32, x >= 2**-126, to 1.2e-7 of 1 + |log2 x|.

    Splits x = m 2**e with m in [sqrt(1/2), sqrt(2)); then with t = (m - 1) / (m + 1),
    log2 m = (2 / ln 2) (t + t**3/3 + t**5/5 + ...), where |t| < 0.172.
    """
    offset = np.int32(np.float32(x).view(np.int32) - SQRT_HALF_BITS)
    exponent = np.int32(offset >> np.int32(23))
    m = np.int32((offset & MANTISSA_BITS) + SQRT_HALF_BITS).view(np.float32)
    t = (m - np.float32(1.0)) / (m + np.float32(1.0))
    u = t * t
    series = np.float32(0.32059890) * u + np.float32(0.41219858)
    series = series * u + np.float32(0.57707802)
    series = series * u + np.float32(0.96179669)
    series = series * u + np.float32(2.8853901)
    return np.float32(exponent) + t * series


@stage
def exp2(x):
    """
    Return 2**x of a float32 in [-126, 126], to 2e-7 relative; below, 2**-126.

    Splits x = n + f with n whole and |f| <= 1/2; 2**f by its Taylor series.
    """
    held = max(min(np.float32(x), np.float32(126.0)), np.float32(-126.0))
    whole = np.floor(held + np.float32(0.5))
    y = (held - whole) * np.float32(0.69314718)
    series = np.float32(1.0 / 5040.0) * y + np.float32(1.0 / 720.0)
    series = series * y + np.float32(1.0 / 120.0)
    series = series * y + np.float32(1.0 / 24.0)
    series = series * y + np.float32(1.0 / 6.0)
    series = series * y + np.float32(0.5)
    series = series * y + np.float32(1.0)
    series = series * y + np.float32(1.0)
    scale = np.int32((np.int32(whole) + np.int32(127)) << np.int32(23)).view(np.float32)
    return series * scale


@stage
def power(x, exponent):
    """Return x**exponent for x in [0, 1] and exponent > 0, float32; 0 gives (nearly) 0."""
    return exp2(exponent * log2(max(x, SMALLEST_NORMAL)))


@stage
def exp2_by(x, library):
    """Return `exp2`, or 2**x by the math library where it is asked for."""
    if library is None:
        return exp2(x)
    return library_exp2(x)


@stage
def power_by(x, exponent, library):
    """Return `power`, or that of the math library where it is asked for."""
    if library is None:
        return power(x, exponent)
    return library_power(x, exponent)


@stage
def occlusion_share(occlusion, i):
    """Return the share of ambient light that reaches a sample: all of it if there are none."""
    if occlusion is None:
        return np.float32(1.0)
    return occlusion[i]


@disjoint_stage
def start_colors(red, green, blue, lit, ambient, occlusion, out_red, out_green, out_blue):
    """Write the unlit colour, or the share of it that ambient light shows."""
    for i in range(out_red.shape[0]):
        shown, reached = np.float32(1.0) - lit[i], lit[i] * occlusion_share(occlusion, i)
        out_red[i] = red[i] * (shown + reached * ambient[0])
        out_green[i] = green[i] * (shown + reached * ambient[1])
        out_blue[i] = blue[i] * (shown + reached * ambient[2])


@disjoint_stage
def normalize_rows(x, y, z):
    """Scale vectors to length one; a vector of length zero stays zero."""
    for i in range(x.shape[0]):
        squared = x[i] * x[i] + y[i] * y[i] + z[i] * z[i]
        scale = np.float32(1.0) / np.sqrt(max(squared, SHORTEST_SQUARED))
        x[i] *= scale
        y[i] *= scale
        z[i] *= scale


@stage
def unit_scale(x, y, z):
    """Return one over a vector's length."""
    return np.float32(1.0) / np.sqrt(max(x * x + y * y + z * z, SHORTEST_SQUARED))


@stage
def highlight(cosine, strength, shininess, highlights, library):
    """Return the strength of the highlight; none if no object has one."""
    if highlights is None:
        return np.float32(0.0)
    return strength * power_by(cosine, shininess, library)


@stage
def reach(squared, ending):
    """Return the share of light at a squared distance that its range lets through."""
    one, zero = np.float32(1.0), np.float32(0.0)
    share = squared * ending
    return max(min(one - share * share, one), zero)


@stage
def cone(cosine, scale, offset):
    """Return the share of light that its cone lets through at a cosine from its axis."""
    one, zero = np.float32(1.0), np.float32(0.0)
    share = max(min(cosine * scale + offset, one), zero)
    return share * share


@stage
def light_at(light, px, py, pz):
    """
    Return the unit direction toward a light from a point, and the share of it that arrives.

    A light without range and cone is multiplied by exactly 1 for them.
    """
    lx, ly, lz = light[0] - light[3] * px, light[1] - light[3] * py, light[2] - light[3] * pz
    scale = unit_scale(lx, ly, lz)
    falloff = light[3] * scale * scale + (np.float32(1.0) - light[3])
    falloff *= reach(lx * lx + ly * ly + lz * lz, light[ENDING])
    lx, ly, lz = lx * scale, ly * scale, lz * scale
    cosine = -(lx * light[DIRECTION_X] + ly * light[DIRECTION_Y] + lz * light[DIRECTION_Z])
    return lx, ly, lz, falloff * cone(cosine, light[CONE_SCALE], light[CONE_OFFSET])


@stage
def shaded(arriving, reached, i):
    """Return the light that arrives at a sample where part of it is in shadow."""
    if reached is None:
        return arriving
    return arriving * reached[i]


@disjoint_stage
def add_light(
    light, toward_viewer, highlights, library, nx, ny, nz, px, py, pz, specular, shininess, lit,
    reached, red, green, blue, out_red, out_green, out_blue,
):  # fmt: skip
    """Add what one light contributes to each sample, as far as it is reached (None: wholly)."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(out_red.shape[0]):
        lx, ly, lz, falloff = light_at(light, px[i], py[i], pz[i])
        facing = max(nx[i] * lx + ny[i] * ly + nz[i] * lz, zero)
        # Find the half vector between light and viewer.
        vx, vy, vz = (
            toward_viewer[0] - toward_viewer[3] * px[i],
            toward_viewer[1] - toward_viewer[3] * py[i],
            toward_viewer[2] - toward_viewer[3] * pz[i],
        )
        scale = unit_scale(vx, vy, vz)
        hx, hy, hz = lx + vx * scale, ly + vy * scale, lz + vz * scale
        cosine = max((nx[i] * hx + ny[i] * hy + nz[i] * hz) * unit_scale(hx, hy, hz), zero)
        shine = highlight(min(cosine, one), specular[i], shininess[i], highlights, library)
        shine = shine if facing > zero else zero
        # Add the diffuse and the specular part.
        arriving = shaded(lit[i] * falloff, reached, i)
        out_red[i] += arriving * light[4] * (red[i] * facing + shine)
        out_green[i] += arriving * light[5] * (green[i] * facing + shine)
        out_blue[i] += arriving * light[6] * (blue[i] * facing + shine)


@stage
def scale_normals(samples, count):
    """Scale the normals to length one."""
    normalize_rows(samples[NORMAL_X, :count], samples[NORMAL_Y, :count], samples[NORMAL_Z, :count])


@stage
def start_light(samples, count, lighting, occlusion):
    """Scale the normals to length one and write what ambient light shows."""
    scale_normals(samples, count)
    show_ambient(samples, count, lighting, occlusion)


@stage
def show_ambient(samples, count, lighting, occlusion):
    """Write what ambient light shows."""
    start_colors(
        samples[RED, :count], samples[GREEN, :count], samples[BLUE, :count],
        samples[LIT, :count], lighting.ambient, occlusion,
        samples[OUT_RED, :count], samples[OUT_GREEN, :count], samples[OUT_BLUE, :count],
    )  # fmt: skip


@stage
def add_lights(samples, count, n, lighting, toward_viewer, reached):
    """Add what light number ``n`` contributes, as far as samples are reached (None: wholly)."""
    add_light(
        lighting.lights[n], toward_viewer, lighting.highlights, lighting.library,
        samples[NORMAL_X, :count], samples[NORMAL_Y, :count], samples[NORMAL_Z, :count],
        samples[POINT_X, :count], samples[POINT_Y, :count], samples[POINT_Z, :count],
        samples[SPECULAR, :count], samples[SHININESS, :count], samples[LIT, :count], reached,
        samples[RED, :count], samples[GREEN, :count], samples[BLUE, :count],
        samples[OUT_RED, :count], samples[OUT_GREEN, :count], samples[OUT_BLUE, :count],
    )  # fmt: skip
