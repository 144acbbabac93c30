"""
Which lit objects may take float32, and what bounds the errors of their normals and points.

That depends on the material of an object, on the lights and the exposure, but not on what stands
beside it: its bits are the same in whatever company.

In light from directions
------------------------

An interpolated normal is off by at most ``u (5 |first| + 17 way)``, where ``u`` is 2**-24, the
first vertex's normal is 5 roundings off, and the ways from there to the others, which it is moved
by, are 17 in all: 10 of the weights (``float32_weights.WEIGHT_ERROR``), 4 of turning them, 3 of
adding them up. Divided by its length that is an angle. A point, relative to the eye, is off by
``u (2 |point| + 20 way)``: divided by its distance, an angle of the view.

An 8-bit sRGB code changes with the cosine of directional light by at most `SLOPE` times the light:
12.92 times 255 codes, in the dark. Of a highlight it changes by 255 / 2.4 of the highlight's share
of itself at most, which is ``sqrt(shininess) (1 + sqrt(2 ln peak))`` for Blinn's, as far as it
is not white, and 4 over the width of facets for GGX. What metals send on after several bounces
changes with the cosine to the viewer, see `bounced_slopes`. All together, times the angle, stay
below `NORMAL_SHARE` and `POINT_SHARE` of a code: where they may not, a sample takes float64.

In the light of lamps
---------------------
Lamps are lights that have a place. How bright one is, and what an error does, differs from face to
face: kernels (``surface.lamps``) work both out for the point of the face that is nearest to it, at
a distance ``d``, and take float64 for a face that is too bright (`MOST_BENT`) or not sure.

A point on a face lies off by at most ``u (3 |first| + 23 way)``: as above, ``|point|`` being at
most ``|first| + way``, and rounded once more in float64. Over ``d`` that is an angle of the light,
``off``, and half the share of itself by which light that falls off with the square moves. With
``light`` that arrives at ``d``, a code moves, per ``off``, by at most

- ``SLOPE light`` for the cosine with the normal, as above;
- twice `CODES_PER_SHARE` for the falloff, and what a highlight moves by as the light turns;
- for a range ``r``, which lets ``1 - s`` through with ``s = (distance / r)**4``, four times ``s``
  times `CODES_PER_SHARE` over ``1 - s``, which is twice that at most as far as ``s`` is a half, and
  beyond times ``SLOPE peak light``, ``peak`` being what a white surface and its highlight make of
  light at most;
- for a cone, which lets the square of a ramp through, the root of ``peak light`` times
  `CODES_PER_RAMP`, the gain of the ramp and the sine at its outer end: ``code(k x**2)`` is nowhere
  steeper than `CODES_PER_RAMP` times the root of ``k``.

Roundings of the light itself, `LIGHT_ERROR`, move a code likewise, but for the sine. The sum over
all lamps stays below `LAMP_SHARE`. All shares together are a sixteenth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.surface.lamps import (
    CODES_PER_SHARE,
    CONE,
    ENDING,
    LAMP_COLUMNS,
    LIGHT,
    LIMITS,
    RAMP,
    ROUNDING,
    SLOPE,
)
from rasterjit.scene.light import DirectionalLight, Light, PointLight, SpotLight
from rasterjit.scene.material import Material

RELATIVE_SLOPE = 255.0 / 2.4
NORMAL_SHARE, POINT_SHARE = 3.0 / 64.0, 1.0 / 64.0
"""Of a code that errors of normals, and of points, may come to."""

NORMAL_SHARE_BY_LAMPS, POINT_SHARE_BY_LAMPS = 4.0 / 128.0, 1.0 / 128.0
"""The same in scenes that have lamps, which take the rest."""

LARGEST_LIMIT_BY_LAMPS, MOST_BENT = 0.25, 0.5
"""As `LARGEST_LIMIT`, in scenes that have lamps, and on the brightest faces that take float32."""

CODES_PER_RAMP = 370.0

MOST_STOPS, EXPOSED = 1.0, 2.0
"""Exposures above this take float64; those below are reckoned as this. What it multiplies by."""

LOG_2 = 0.6931472

LEAST_ALPHA = 0.002
"""As ``lighting.pbr`` has it."""

ROUGH = 0.09
"""Alpha from which on facets are rough: of a roughness of 0.3."""

BOUNCED, BOUNCED_CODES = 0.4, 950.0
"""See `bounced_slopes`."""

LARGEST_LIMIT = 0.125
"""A limit above this, for normals that do not change over a face, leaves too little to float32."""


class Gloss(NamedTuple):
    """The highlights of an object."""

    specular: float
    shininess: float
    alpha: float
    """Width of the facets of metallic-roughness materials; infinite for others."""
    metallic: float = 0.0


def gloss_of(material: Material) -> Gloss:
    """Return the highlights of a material without textures."""
    if material.shading == "pbr":
        alpha = max(material.roughness * material.roughness, LEAST_ALPHA)
        return Gloss(0.0, 1.0, alpha, material.metallic)
    if material.specular > 0.0:
        return Gloss(material.specular, material.shininess, math.inf)
    return Gloss(0.0, 1.0, math.inf)


def brightness_of(lights: Sequence[Light]) -> float:
    """Return the sum of all light from directions."""
    total = 0.0
    for light in lights:
        if isinstance(light, DirectionalLight):
            total += light.intensity * max(light.color)
    return total


def lamps_among(lights: Sequence[Light]) -> tuple[Light, ...]:
    """Return the lights that have a place and shine, whatever they reach."""
    return tuple(
        light for light in lights
        if isinstance(light, PointLight | SpotLight) and light.intensity > 0.0 and any(light.color)
    )  # fmt: skip


def bounced_slopes(gloss: Gloss) -> tuple[float, float]:
    """
    Return how far codes move at most, per cosine, by what metals send on after several bounces.

    The first times `SLOPE` and the light, plus the second times the root of the light, of 1 at
    least. That share of the light is at most 1, together with what a dielectric shows. Of smooth
    facets it may be next to nothing and changes by `BOUNCED` at most; of rough ones it is so large
    that codes are far from their steepest, and change by `BOUNCED_CODES` in light of 1.
    """
    if gloss.alpha < ROUGH:
        return BOUNCED * gloss.metallic, 0.0
    return 0.0, BOUNCED_CODES * gloss.metallic


def peak_of(gloss: Gloss) -> float:
    """Return what a white surface and its highlight make of light at most."""
    facets = 0.25 / (gloss.alpha * gloss.alpha * gloss.alpha)
    return 1.0 + max(gloss.specular, facets)


def rows_of_lamps(rows: NDArray[np.float32], exposed: float) -> NDArray[np.float32]:
    """
    Return what bounds are worked out from, (..., P, 7) float32: see ``surface.lamps``.

    Parameters
    ----------
    rows : (..., P, 13) float32
        The lamps as ``Lighting.lights`` has them.
    exposed : float
        What light is multiplied by at most before it is shown.
    """
    lamps = np.empty((*rows.shape[:-1], LAMP_COLUMNS), np.float32)
    colors, scale, offset = rows[..., 4:7].astype(np.float64), rows[..., 10], rows[..., 11]
    light = exposed * colors.max(axis=-1)
    versine = offset.astype(np.float64) / np.where(scale > 0.0, scale, np.float32(1.0))
    sine = np.sqrt(np.maximum(versine * (2.0 - versine), 0.0))
    lamps[..., :3] = rows[..., :3]
    lamps[..., LIGHT] = light
    lamps[..., RAMP] = CODES_PER_RAMP * np.sqrt(light) * scale
    lamps[..., CONE] = lamps[..., RAMP] * sine
    lamps[..., ENDING] = rows[..., 12]
    return lamps


def limits_of(gloss: Gloss, brightness: float, has_lamps: bool) -> NDArray[np.float32] | None:
    """
    Return what lengths of normals and points are compared with, (9,) float32.

    A normal is to be as long as the first times that of the first vertex, plus the second times
    the longer way from there to another vertex's; the square of a point's distance as large as the
    third times that of the longer way to another vertex. The fourth and fifth are what the light of
    lamps adds to the first and second; the sixth is most of that light. What an error of a point
    does to a code: the seventh, times light, near the end of a range, and the eighth; the ninth is
    what a cone's is multiplied by. None if float32 is good for nothing.
    """
    light = brightness * EXPOSED
    shares = NORMAL_SHARE, POINT_SHARE
    if has_lamps:
        shares = NORMAL_SHARE_BY_LAMPS, POINT_SHARE_BY_LAMPS
    steep, rooted = bounced_slopes(gloss)
    slope = SLOPE * (1.0 + steep)
    more = slope * ROUNDING / shares[0]
    most = MOST_BENT / (5.0 * more) if has_lamps else 0.0
    peak = (light + most) * gloss.specular
    # Its logarithm is below that of the next power of two, which has the same bits everywhere.
    doublings = math.frexp(peak)[1] if peak > 1.0 else 0
    shine = 4.0 / gloss.alpha
    if gloss.specular > 0.0:
        shine += math.sqrt(gloss.shininess) * (1.0 + math.sqrt(2.0 * LOG_2 * doublings))
    shine = shine * RELATIVE_SLOPE + rooted * max(1.0, math.sqrt(light + most))
    bent = (slope * light + shine) * ROUNDING / shares[0]
    moved = 20.0 * (shine + SLOPE * steep * (light + most)) * ROUNDING / shares[1]
    largest = (LARGEST_LIMIT_BY_LAMPS, 8.0) if has_lamps else (LARGEST_LIMIT, 2.0)
    if 5.0 * bent > largest[0] or moved > largest[1]:
        return None
    limits = [5.0 * bent, 17.0 * bent, moved * moved, *[0.0] * 6]
    if has_lamps:
        limits[3:6] = 5.0 * more, 17.0 * more, most - bent / more
        peak = peak_of(gloss)
        limits[6:] = SLOPE * peak, 2.0 * CODES_PER_SHARE + shine, math.sqrt(peak)
    return np.array(limits, np.float32)


def limits_of_all(
    glosses: Sequence[Gloss | None], brightness: float, has_lamps: bool
) -> NDArray[np.float32]:
    """Return `limits_of` each of some objects, (O, 9) float32; -1 where they take float64."""
    none = np.full(LIMITS, -1.0, np.float32)
    rows = {None: none}
    for gloss in {*glosses} - {None}:
        own = limits_of(gloss, brightness, has_lamps)
        rows[gloss] = none if own is None else own
    return np.array([rows[gloss] for gloss in glosses], np.float32).reshape(-1, LIMITS)
