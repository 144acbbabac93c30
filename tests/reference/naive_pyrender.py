"""
Slow and obvious twin of how pyrender 0.1.45's fragment shader lights a point: float64, by itself.

Written down from the formulas of its ``shaders/mesh.frag``.
"""

from __future__ import annotations

import math

from naive import dot, unit


def held(value, least, most):
    return min(max(value, least), most)


def sent_on(base, metallic, roughness, normal, to_light, to_viewer):
    """Return the share of a light's colour that a point sends on, red, green and blue."""
    half = unit([p + q for p, q in zip(to_light, to_viewer, strict=True)])
    n_l = held(dot(normal, to_light), 0.001, 1.0)
    n_v = held(abs(dot(normal, to_viewer)), 0.001, 1.0)
    n_h, v_h = held(dot(normal, half), 0.0, 1.0), held(dot(to_viewer, half), 0.0, 1.0)
    roughness, metallic = held(roughness, 0.04, 1.0), held(metallic, 0.0, 1.0)
    k = (roughness + 1.0) ** 2 / 8.0
    masking = math.prod(cosine / (cosine * (1.0 - k) + k) for cosine in (n_l, n_v))
    width = roughness**4
    density = width / (math.pi * (n_h * n_h * (width - 1.0) + 1.0) ** 2)
    colors = []
    for channel in base:
        head_on = 0.04 * (1.0 - metallic) + channel * metallic
        mirrored = head_on + (1.0 - head_on) * (1.0 - v_h) ** 5
        inside = channel * (1.0 - 0.04) * (1.0 - metallic)
        shine = mirrored * masking * density / (4.0 * n_l * n_v + 0.001)
        colors.append(n_l * ((1.0 - mirrored) * inside / math.pi + shine))
    return colors


def arriving(light, point):
    """
    Return the unit direction toward a light, and the factor on its colour at a point.

    Takes a row of ``Lighting.lights``: place or direction, whether it is a place, colour, the axis
    of a cone, scale and offset.
    """
    if light[3] == 0.0:
        return unit(light[:3]), 1.0
    way = [p - q for p, q in zip(light[:3], point, strict=True)]
    toward, factor = unit(way), 1.0 / dot(way, way)
    if light[10] != 0.0:
        factor *= held(light[11] - (1.0 + dot(toward, light[7:10])) * light[10], 0.0, 1.0) ** 2
    return toward, factor


def lit(base, metallic, roughness, normal, point, lights, ambient):
    """Return what a point shows in some lights, seen from the origin; linear."""
    to_viewer = unit([-p for p in point])
    total = [b * a for b, a in zip(base, ambient, strict=True)]
    for light in lights:
        toward, factor = arriving(light, point)
        share = sent_on(base, metallic, roughness, normal, toward, to_viewer)
        for k in range(3):
            total[k] += factor * light[4 + k] * share[k]
    return total


def shadow(point, facing, clip_from_world, window_depths):
    """
    Return the share of a light that does not reach a point.

    Parameters
    ----------
    point : (3,)
    facing : float
        Cosine between normal and light.
    clip_from_world : (4, 4)
    window_depths : (S, S)
        0..1, the lowest row first.
    """
    size = len(window_depths)
    x, y, z, w = (dot(row, [*point, 1.0]) for row in clip_from_world)
    u, v, depth = (part / w * 0.5 + 0.5 for part in (x, y, z))
    if depth > 1.0:
        return 0.0
    compared = depth - max(0.001 * (1.0 - held(facing, 0.0, 1.0)), 0.0001) / w

    def is_behind(column, row):
        return float(compared > window_depths[row % size][column % size])

    total = 0.0
    for across in (-1, 0, 1):
        for up in (-1, 0, 1):
            a, b = u * size + across + 0.5, v * size + up + 0.5
            i, j = math.floor(a), math.floor(b)
            for k, share in ((0, 1.0 - (a - i)), (1, a - i)):
                for n, part in ((0, 1.0 - (b - j)), (1, b - j)):
                    total += share * part * is_behind(i + k, j + n)
    return total / 9.0


def code(value):
    """Return the code of a linear value."""
    return math.floor(held(max(value, 0.0) ** (1.0 / 2.2), 0.0, 1.0) * 255.0 + 0.5)
