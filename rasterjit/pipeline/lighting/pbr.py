"""
Shade metallic-roughness samples by the microfacet BRDF of glTF 2.0.

A surface is a mix of a dielectric and a metal with GGX-distributed facets. Light of intensity 1 at
normal incidence makes a white diffuse surface white, as with every other material here: diffuse
light has no factor 1/pi, so the specular term is multiplied by pi.

Masking-shadowing is Smith's term in its height-correlated form [2]_. Appendix B of glTF writes the
separable form and leaves the choice free; that one is never brighter, darkest at grazing
angles, and equal where light or viewer is at normal incidence.

Ambient light is uniform. Its single-scattering albedo [3]_ has no closed form; it is a fit.
Multiple scattering is added [4]_, and the rest enters the surface: under white ambient light a
white surface is white (white furnace), for any roughness and metallic.

Multiple scattering of metals is added for each light as well, as a diffuse lobe: a dome of lights
and an equal sky give the same. It depends on the viewer alone, so it is not reciprocal. For
dielectrics it is left out: below 0.002 of the light for glass, 0.02 for diamond.

References
----------
.. [1] The Khronos Group, "glTF 2.0 Specification" (ISO/IEC 12113:2022), appendix B.
.. [2] B. Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007;
   E. Heitz, "Understanding the Masking-Shadowing Function", JCGT 3(2), 2014.
.. [3] B. Karis, "Real Shading in Unreal Engine 4", SIGGRAPH 2013 courses: the split sum.
.. [4] C. Fdez-Agüera, "A Multiple-Scattering Microfacet Model for Real-Time Image-Based Lighting",
   JCGT 8(1), 2019.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.lighting.blinn_phong import invert_length
from rasterjit.runtime.jit import disjoint_helper, helper

DIELECTRIC_F0 = np.float32(0.04)
"""F0 of dielectrics: reflectance at normal incidence."""

MIN_ALPHA = np.float32(0.002)
"""Least GGX alpha: a perfect mirror would show no point light."""

MIN_COSINE = np.float32(1e-4)
"""Least n·v, for shading normals that turn away from the viewer."""


@helper
def ggx_distribution(n_h, cross_squared, alpha_squared):
    """
    Return pi times the GGX distribution D(h); 0 below the horizon.

    Takes the cosine and the squared sine between normal and half vector: near 0 the sine from a
    cross product is accurate where 1 minus a squared cosine is rounding error.
    """
    denominator = max(alpha_squared, cross_squared + n_h * n_h * alpha_squared)
    density = alpha_squared / (denominator * denominator)
    return density if n_h > np.float32(0.0) else np.float32(0.0)


@helper
def smith_visibility(n_l, n_v, alpha_squared):
    """
    Return Smith's masking-shadowing term over four times both cosines (visibility V).

    Height-correlated: ``2 n_l n_v / (n_v s(n_l) + n_l s(n_v))``, ``s(c)`` being the root of
    ``c**2 + alpha**2 (1 - c**2)``, where the separable form has
    ``4 n_l n_v / ((n_l + s(n_l)) (n_v + s(n_v)))``.
    """
    rest = np.float32(1.0) - alpha_squared
    light_part = n_v * np.sqrt(n_l * n_l * rest + alpha_squared)
    view_part = n_l * np.sqrt(n_v * n_v * rest + alpha_squared)
    return np.float32(0.5) / (light_part + view_part)


@helper
def schlick_weight(cosine):
    """Return Schlick's (1 - cosine)**5."""
    rest = np.float32(1.0) - min(cosine, np.float32(1.0))
    squared = rest * rest
    return squared * squared * rest


@helper
def specular_f0(base, metallic):
    """Return one channel of F0, by metallic."""
    return DIELECTRIC_F0 + metallic * (base - DIELECTRIC_F0)


@helper
def evaluate_cubic(x, a, b, c, d):
    """Return a + b x + c x**2 + d x**3, float32."""
    return np.float32(a) + x * (np.float32(b) + x * (np.float32(c) + x * np.float32(d)))


@helper
def approximate_env_brdf(n_v, roughness):
    """
    Return the scale and the offset of F0 in the directional albedo (split-sum BRDF).

    Their sum is the single-scattering albedo of perfectly reflecting facets. Both are polynomials,
    fitted to the integral of the model by least squares; their largest errors are 0.061 (the sum)
    and 0.069 (the offset), where the viewer's cosine is below 0.1.
    """
    c, r, zero, one = n_v, roughness, np.float32(0.0), np.float32(1.0)
    total = evaluate_cubic(
        c,
        evaluate_cubic(r, 1.03258, -1.20292, 2.74047, -1.69267),
        evaluate_cubic(r, -0.0462228, 4.95571, -15.7929, 9.5428),
        evaluate_cubic(r, -0.13758, -4.45289, 18.0092, -12.2217),
        evaluate_cubic(r, 0.126206, 1.18405, -6.3583, 4.58152),
    )
    offset = evaluate_cubic(
        c,
        evaluate_cubic(r, 1.01424, -2.06212, 0.775402, 0.347573),
        evaluate_cubic(r, -4.28602, 11.3499, -9.19793, 1.87035),
        evaluate_cubic(r, 5.91556, -18.5306, 19.3117, -6.39416),
        evaluate_cubic(r, -2.66093, 9.34343, -11.0615, 4.26546),
    )
    total = max(min(total, one), zero)
    offset = max(min(offset, total), zero)
    return total - offset, offset


@helper
def scattering_albedos(f0, env_brdf):
    """Return the albedo of a channel by single, and by multiple scattering, given F0."""
    one = np.float32(1.0)
    lost = one - (env_brdf[0] + env_brdf[1])
    single = max(f0 * env_brdf[0] + env_brdf[1], np.float32(0.0))
    mean = f0 + (one - f0) * np.float32(1.0 / 21.0)
    return single, lost * single * mean / (one - lost * mean)


@helper
def total_albedo(f0, env_brdf):
    """Return the albedo of a channel, by single and multiple scattering together."""
    single, multiple = scattering_albedos(f0, env_brdf)
    return single + multiple


@disjoint_helper
def find_env_brdf(toward_viewer, nx, ny, nz, px, py, pz, roughness, scale, offset):
    """Write the scale and the offset of F0 in each sample's directional albedo."""
    zero = np.float32(0.0)
    for i in range(nx.shape[0]):
        vx = toward_viewer[0] - toward_viewer[3] * px[i]
        vy = toward_viewer[1] - toward_viewer[3] * py[i]
        vz = toward_viewer[2] - toward_viewer[3] * pz[i]
        n_v = (nx[i] * vx + ny[i] * vy + nz[i] * vz) * invert_length(vx, vy, vz)
        scale[i], offset[i] = approximate_env_brdf(max(zero, n_v), roughness[i])


@disjoint_helper
def find_ambient(
    ambient, occlusion, metallic, scale, offset, red, green, blue, out_red, out_green, out_blue,
):  # fmt: skip
    """Write the ambient light that metallic-roughness samples reflect."""
    one = np.float32(1.0)
    for i in range(red.shape[0]):
        env_brdf = scale[i], offset[i]
        # Light that a dielectric does not reflect becomes diffuse.
        specular = total_albedo(DIELECTRIC_F0, env_brdf)
        diffuse = one - specular
        r = metallic[i] * total_albedo(red[i], env_brdf)
        g = metallic[i] * total_albedo(green[i], env_brdf)
        b = metallic[i] * total_albedo(blue[i], env_brdf)
        visible, dielectric = occlusion[i], one - metallic[i]
        out_red[i] = visible * ambient[0] * (r + dielectric * (specular + diffuse * red[i]))
        out_green[i] = visible * ambient[1] * (g + dielectric * (specular + diffuse * green[i]))
        out_blue[i] = visible * ambient[2] * (b + dielectric * (specular + diffuse * blue[i]))


@disjoint_helper
def write_microfacets(color, microfacet, out):
    """Write a channel of metallic-roughness samples; leave others."""
    for i in range(out.shape[0]):
        out[i] = color[i] if microfacet[i] > np.float32(0.0) else out[i]


@disjoint_helper
def find_multiple_scattering(
    vx, vy, vz, nx, ny, nz, roughness, metallic, red, green, blue, out_red, out_green, out_blue
):  # fmt: skip
    """Write the multiple-scattering albedo of metals, channel by channel."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(nx.shape[0]):
        n_v = nx[i] * vx[i] + ny[i] * vy[i] + nz[i] * vz[i]
        brdf, metal = approximate_env_brdf(max(zero, n_v), roughness[i]), metallic[i]
        out_red[i] = metal * scattering_albedos(min(red[i], one), brdf)[1]
        out_green[i] = metal * scattering_albedos(min(green[i], one), brdf)[1]
        out_blue[i] = metal * scattering_albedos(min(blue[i], one), brdf)[1]


@disjoint_helper
def write_zeros(red, green, blue):
    """Write zeros."""
    for i in range(red.shape[0]):
        red[i], green[i], blue[i] = np.float32(0.0), np.float32(0.0), np.float32(0.0)


@disjoint_helper
def find_specular_terms(
    lobes, nx, ny, nz, roughness, vx, vy, vz, in_range, lx, ly, lz
):  # fmt: skip
    """
    Overwrite directions to a light by the terms of its specular reflection.

    In order: n·l; the specular term for F = 1; Schlick's weight (1 - v·h)**5.
    """
    zero = np.float32(0.0)
    for i in range(nx.shape[0]):
        # Find the half vector between light and viewer, and the cosines.
        hx, hy, hz = lx[i] + vx[i], ly[i] + vy[i], lz[i] + vz[i]
        scale = invert_length(hx, hy, hz)
        hx, hy, hz = hx * scale, hy * scale, hz * scale
        x, y, z = nx[i], ny[i], nz[i]
        n_l = max(zero, x * lx[i] + y * ly[i] + z * lz[i]) if in_range[i] > zero else zero
        n_v = max(MIN_COSINE, x * vx[i] + y * vy[i] + z * vz[i])
        n_h = x * hx + y * hy + z * hz
        v_h = max(zero, vx[i] * hx + vy[i] * hy + vz[i] * hz)
        cx, cy, cz = y * hz - z * hy, z * hx - x * hz, x * hy - y * hx
        alpha = max(roughness[i] * roughness[i], MIN_ALPHA)
        squared = alpha * alpha
        specular = ggx_distribution(n_h, cx * cx + cy * cy + cz * cz, squared)
        specular *= lobes[1] * smith_visibility(n_l, n_v, squared)
        lx[i], ly[i], lz[i] = n_l, specular, schlick_weight(v_h)


@disjoint_helper
def add_microfacet_light(
    light, lobes, n_l, specular, schlick, falloff, metallic, microfacet, visibility, red, green,
    blue, multiple_red, multiple_green, multiple_blue, out_red, out_green, out_blue,
):  # fmt: skip
    """Add one light to each metallic-roughness sample, times its visibility."""
    one = np.float32(1.0)
    for i in range(out_red.shape[0]):
        lobe, fresnel = specular[i], schlick[i]
        # Light that is not reflected enters the surface: diffuse.
        diffuse = (one - metallic[i]) * (one - (DIELECTRIC_F0 + (one - DIELECTRIC_F0) * fresnel))
        diffuse *= lobes[0]
        weight = microfacet[i] * falloff[i] * n_l[i] * visibility[i]
        f0 = specular_f0(red[i], metallic[i])
        reflected = lobe * (f0 + (one - f0) * fresnel)
        reflected += lobes[1] * multiple_red[i]
        out_red[i] += weight * light[4] * (red[i] * diffuse + reflected)
        f0 = specular_f0(green[i], metallic[i])
        reflected = lobe * (f0 + (one - f0) * fresnel)
        reflected += lobes[1] * multiple_green[i]
        out_green[i] += weight * light[5] * (green[i] * diffuse + reflected)
        f0 = specular_f0(blue[i], metallic[i])
        reflected = lobe * (f0 + (one - f0) * fresnel)
        reflected += lobes[1] * multiple_blue[i]
        out_blue[i] += weight * light[6] * (blue[i] * diffuse + reflected)


@disjoint_helper
def is_any_above_zero(row):
    """Return whether any number of a row is above 0."""
    any_above = np.int32(0)
    for i in range(row.shape[0]):
        # ``|=`` would be 64 bits wide, and halve the vectors.
        any_above = np.int32(any_above | np.int32(row[i] > np.float32(0.0)))
    return any_above != 0
