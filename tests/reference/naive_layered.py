"""
Slow and obvious twins of varnish, fibres and own mirrors: float64, one sample at a time.

Written as glTF's extensions and appendix B print them, divided by pi and all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from naive import dot, unit
from naive_materials import MIN_ALPHA, bounced, ggx, masking_both, schlick

MIN_SHEEN_ROUGHNESS = 0.07


class Layered(NamedTuple):
    """A metallic-roughness material with layers."""

    base: tuple = (0.8, 0.8, 0.8)
    metallic: float = 0.0
    roughness: float = 0.5
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.0
    sheen_color: tuple = (0.0, 0.0, 0.0)
    sheen_roughness: float = 0.0
    specular_factor: float = 1.0
    specular_color: tuple = (1.0, 1.0, 1.0)
    ior: float = 1.5


def specular_brdf(roughness, normal, to_light, to_viewer):
    """Appendix B: V D of facets that mirror all light."""
    half = unit([p + q for p, q in zip(to_light, to_viewer, strict=True)])
    n_l, n_v = dot(normal, to_light), dot(normal, to_viewer)
    if n_l <= 0.0 or n_v <= 0.0:
        return 0.0
    alpha = max(roughness * roughness, MIN_ALPHA)
    return ggx(dot(normal, half), alpha) * masking_both(n_l, n_v, alpha) / (4.0 * n_l * n_v)


def mixed_brdf(own, normal, to_light, to_viewer):
    """
    Appendix B: mix of a metal and a dielectric, the latter by ior and specular.

    With what metals send on after several bounces.
    """
    half = unit([p + q for p, q in zip(to_light, to_viewer, strict=True)])
    v_h = dot(to_viewer, half)
    mirrored = specular_brdf(own.roughness, normal, to_light, to_viewer)
    plain = ((own.ior - 1.0) / (own.ior + 1.0)) ** 2
    fresnel = [schlick(min(plain * tint, 1.0), v_h) for tint in own.specular_color]
    inside = 1.0 - own.specular_factor * max(fresnel)
    n_v = max(dot(normal, to_viewer), 0.0)
    result = []
    for channel, share in zip(own.base, fresnel, strict=True):
        dielectric = inside * channel / math.pi + own.specular_factor * share * mirrored
        metal = mirrored * schlick(channel, v_h) + bounced(channel, own.roughness, n_v) / math.pi
        result.append((1.0 - own.metallic) * dielectric + own.metallic * metal)
    return result


def exponent(x, alpha):
    """The function l of KHR_materials_sheen."""
    squared = (1.0 - alpha) ** 2

    def mix(one, other):
        return one + squared * (other - one)

    a, b, c = mix(21.5473, 25.3245), mix(3.82987, 3.32435), mix(0.19823, 0.16801)
    return a / (1.0 + b * x**c) + mix(-1.97760, -1.27393) * x + mix(-4.32054, -4.85967)


def hidden(cosine, alpha):
    """lambdaSheen of KHR_materials_sheen."""
    if cosine < 0.5:
        return math.exp(exponent(cosine, alpha))
    return math.exp(2.0 * exponent(0.5, alpha) - exponent(1.0 - cosine, alpha))


def sheen_brdf(roughness, normal, to_light, to_viewer):
    """The sheen of white fibres."""
    half = unit([p + q for p, q in zip(to_light, to_viewer, strict=True)])
    n_l, n_v, n_h = dot(normal, to_light), dot(normal, to_viewer), dot(normal, half)
    if n_l <= 0.0 or n_v <= 0.0:
        return 0.0
    alpha = max(roughness, MIN_SHEEN_ROUGHNESS) ** 2
    sine_squared = max(0.0, 1.0 - n_h * n_h)
    density = (2.0 + 1.0 / alpha) * sine_squared ** (0.5 / alpha) / (2.0 * math.pi)
    return density / ((1.0 + hidden(n_v, alpha) + hidden(n_l, alpha)) * 4.0 * n_l * n_v)


def sheen_albedo(roughness, cosine, steps=96):
    """The share of light from all sides that white fibres send in a direction; it may pass 1."""
    to_viewer, total = [math.sqrt(1.0 - cosine * cosine), 0.0, cosine], 0.0
    for i in range(steps):
        # Finer towards the horizon, where fibres shine.
        root = (i + 0.5) / steps
        height = root * root
        sine = math.sqrt(1.0 - height * height)
        for j in range(steps):
            turn = math.pi * (j + 0.5) / steps
            to_light = [sine * math.cos(turn), sine * math.sin(turn), height]
            share = sheen_brdf(roughness, [0.0, 0.0, 1.0], to_light, to_viewer)
            total += share * height * 2.0 * root
    return total * 2.0 * math.pi / steps**2


def layered_brdf(own, normal, coat_normal, to_light, to_viewer, albedo):
    """
    All layers; ``albedo(roughness, cosine)`` is the share that fibres take.

    Varnish lies over fibres, and they lie over the rest.
    """
    result = mixed_brdf(own, normal, to_light, to_viewer)
    most = max(own.sheen_color)
    if most > 0.0:
        cosines = dot(normal, to_viewer), dot(normal, to_light)
        left = min(1.0 - most * albedo(own.sheen_roughness, cosine) for cosine in cosines)
        shine = sheen_brdf(own.sheen_roughness, normal, to_light, to_viewer)
        result = [
            channel * left + color * shine
            for channel, color in zip(result, own.sheen_color, strict=True)
        ]
    share = own.clearcoat * schlick(0.04, abs(dot(coat_normal, to_viewer)))
    shine = specular_brdf(own.clearcoat_roughness, coat_normal, to_light, to_viewer)
    n_v = max(dot(coat_normal, to_viewer), 0.0)
    shine += bounced(1.0, own.clearcoat_roughness, n_v) / math.pi
    # What lies below is lit where its own normal faces the light, varnish where its normal does.
    below, above = max(dot(normal, to_light), 0.0), max(dot(coat_normal, to_light), 0.0)
    return [
        math.pi * ((1.0 - share) * channel * below + share * shine * above) for channel in result
    ]
