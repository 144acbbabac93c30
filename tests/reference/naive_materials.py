"""
Slow and obvious twins of microfacets and maps: float64, one sample at a time, other formulas.

The BRDF is written as glTF 2.0 prints it (appendix B), with angles, divided by pi and all, and then
multiplied by pi and the cosine: what the engine shows under light of intensity 1. What metals send
on after several bounces is added, by the fit of the engine, which has a test of its own.
"""

from __future__ import annotations

import math

import numpy as np
from naive import dot, is_told, unit

from rasterjit.pipeline.lighting import pbr

MIN_ALPHA = 0.002


def brdf(base, metallic, roughness, normal, to_light, to_viewer):
    """
    Return the reflected share per steradian, red, green and blue; all directions are unit vectors.

    The mix of a metal and a dielectric that is itself a mix of a diffuse and a specular part.
    """
    half = unit([p + q for p, q in zip(to_light, to_viewer, strict=True)])
    n_l, n_v = dot(normal, to_light), dot(normal, to_viewer)
    n_h, v_h = dot(normal, half), dot(to_viewer, half)
    if n_l <= 0.0 or n_v <= 0.0:
        return [0.0, 0.0, 0.0]
    alpha = max(roughness * roughness, MIN_ALPHA)
    specular = ggx(n_h, alpha) * masking_both(n_l, n_v, alpha)
    specular /= 4.0 * n_l * n_v
    result = []
    for channel in base:
        metal = specular * schlick(channel, v_h)
        share = schlick(0.04, v_h)
        dielectric = (1.0 - share) * channel / math.pi + share * specular
        result.append((1.0 - metallic) * dielectric + metallic * metal)
    return result


def bounced(color, roughness, n_v):
    """
    Return what a mirror sends on after its first bounce: the sum over all further ones.

    Each bounce leaves the facets with the share that a white mirror sends on at once, and takes
    the mean of Schlick's share over all angles.
    """
    scale, offset = map(float, pbr.approximate_env_brdf(np.float32(n_v), np.float32(roughness)))
    mean = color + (1.0 - color) / 21.0
    total, held = 0.0, color * scale + offset
    for _ in range(400):
        held *= (1.0 - (scale + offset)) * mean
        total += held
    return total


def ggx(n_h, alpha):
    """Return the density of facets, by the angle between half vector and normal."""
    if n_h <= 0.0:
        return 0.0
    angle = math.acos(min(n_h, 1.0))
    if angle >= math.pi / 2:
        return 0.0
    squared = math.tan(angle) ** 2
    return 1.0 / (math.pi * alpha**2 * math.cos(angle) ** 4 * (1.0 + squared / alpha**2) ** 2)


def slope_term(cosine, alpha):
    """Return Smith's Lambda."""
    tangent = math.tan(math.acos(min(cosine, 1.0)))
    return (math.sqrt(1.0 + (alpha * tangent) ** 2) - 1.0) / 2.0


def masking_both(n_l, n_v, alpha):
    """Return the share of facets that light reaches and the viewer sees, heights correlated."""
    return 1.0 / (1.0 + slope_term(n_l, alpha) + slope_term(n_v, alpha))


def schlick(head_on, cosine):
    return head_on + (1.0 - head_on) * (1.0 - min(max(cosine, 0.0), 1.0)) ** 5


def lit_by(base, metallic, roughness, normal, point, light, viewer):
    """
    Return what one light shows of a sample, linear; black where float32 cannot tell directions.

    Parameters
    ----------
    light : x, y, z, w, red, green, blue; light comes along ``xyz - w point``
    viewer : x, y, z, w; the point is seen along ``xyz - w point``
    """
    toward = [light[k] - light[3] * point[k] for k in range(3)]
    to_viewer = [viewer[k] - viewer[3] * point[k] for k in range(3)]
    if not (is_told(normal) and is_told(toward) and is_told(to_viewer)):
        return [0.0, 0.0, 0.0]
    distance = math.sqrt(dot(toward, toward))
    falloff = 1.0 / distance**2 if light[3] else 1.0
    to_light, to_viewer = unit(toward), unit(to_viewer)
    shares = brdf(base, metallic, roughness, unit(normal), to_light, to_viewer)
    facing, n_v = max(dot(unit(normal), to_light), 0.0), dot(unit(normal), to_viewer)
    often = [metallic * bounced(channel, roughness, n_v) for channel in base]
    return [facing * falloff * light[4 + k] * (math.pi * shares[k] + often[k]) for k in range(3)]


def directional_albedo(metallic, roughness, cosine, base=(1.0, 1.0, 1.0), steps=256):
    """Return the share of light from one direction that a surface sends to all sides at all."""
    to_viewer = [math.sqrt(1.0 - cosine * cosine), 0.0, cosine]
    total = [0.0, 0.0, 0.0]
    for i in range(steps):
        # Midpoints of equal steps of the squared sine: each stands for as much of the cosine.
        squared = (i + 0.5) / steps
        sine, height = math.sqrt(squared), math.sqrt(1.0 - squared)
        for j in range(steps):
            turn = 2.0 * math.pi * (j + 0.5) / steps
            to_light = [sine * math.cos(turn), sine * math.sin(turn), height]
            shares = brdf(base, metallic, roughness, [0.0, 0.0, 1.0], to_light, to_viewer)
            total = [t + math.pi * s / steps**2 for t, s in zip(total, shares, strict=True)]
    return total


def tangent_frame(corners, uv):
    """
    Return the directions in which u and v grow on a face, by solving for the map from the picture.

    Parameters
    ----------
    corners : three points
    uv : three pairs
    """
    (ua, va), (ub, vb), (uc, vc) = uv
    matrix = [[ub - ua, vb - va], [uc - ua, vc - va]]
    determinant = matrix[0][0] * matrix[1][1] - matrix[0][1] * matrix[1][0]
    along_u, along_v = [], []
    for k in range(3):
        b, c = corners[1][k] - corners[0][k], corners[2][k] - corners[0][k]
        along_u.append((b * matrix[1][1] - c * matrix[0][1]) / determinant)
        along_v.append((c * matrix[0][0] - b * matrix[1][0]) / determinant)
    return along_u, along_v


def bent(normal, along_u, along_v, texel, scale=1.0):
    """Return the normal that a normal map shows, unit length, for a frame of any lengths."""
    normal = unit(normal)
    share = dot(along_u, normal)
    tangent = unit([t - share * n for t, n in zip(along_u, normal, strict=True)])
    across = [
        normal[1] * tangent[2] - normal[2] * tangent[1],
        normal[2] * tangent[0] - normal[0] * tangent[2],
        normal[0] * tangent[1] - normal[1] * tangent[0],
    ]
    if dot(across, along_v) < 0.0:
        across = [-c for c in across]
    x, y, z = scale * (2.0 * texel[0] - 1.0), scale * (2.0 * texel[1] - 1.0), 2.0 * texel[2] - 1.0
    return unit([x * tangent[k] + y * across[k] + z * normal[k] for k in range(3)])
