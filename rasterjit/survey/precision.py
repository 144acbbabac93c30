"""
Which lit objects may take float32, and what bounds the errors of their normals and points.

That depends on the material of an object, on the exposure, and on the lights that the plan has,
those with a place as far as they reach a face: not on what stands beside it, nor on what is out.
Its bits are the same in whatever company.

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
all lamps stays below `LAMP_SHARE`.

At jumps and steep places
-------------------------
Highlights move by a share of themselves but where they end, where light or viewer graze the
surface, and where both are opposite: samples there take float64 (``surface.steep``), as far as they
come to more than `STEEP_SHARE`. Ambient light on facets, fog and tone curves add their largest
slopes (`Brightness`). All shares together are a sixteenth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.pipeline.surface.lamps import (
    ALL_LIMITS,
    BY_LAMPS,
    CODES_PER_SHARE,
    CONE,
    ENDING,
    LAMP_COLUMNS,
    LIGHT,
    PYRAMID,
    RAMP,
    ROUNDING,
    SLOPE,
)
from rasterjit.pipeline.surface.steep import BLINN, EXPOSED, GLOSS, MATT, STEEP_SHARE
from rasterjit.scene.fog import Fog
from rasterjit.scene.light import AmbientLight, DirectionalLight, Light, PointLight, SpotLight
from rasterjit.scene.material import Material
from rasterjit.scene.tone_map import ToneMap

RELATIVE_SLOPE = 255.0 / 2.4
NORMAL_SHARE, POINT_SHARE = 5.0 / 128.0, 2.0 / 128.0
"""Of a code that errors of normals, and of points, may come to; `STEEP_SHARE` is the rest."""

NORMAL_SHARE_BY_LAMPS, POINT_SHARE_BY_LAMPS = 3.0 / 128.0, 1.0 / 128.0
"""The same in scenes that have lamps, which take `LAMP_SHARE`."""

LARGEST_LIMIT_BY_LAMPS, MOST_BENT = 0.25, 0.5
"""As `LARGEST_LIMIT`, in scenes that have lamps, and on the brightest faces that take float32."""

CODES_PER_RAMP = 370.0

MOST_STOPS = 1.0
"""Exposures above this take float64; those below are reckoned as this: ``steep.EXPOSED``."""

LOG_2 = 0.6931472
"""A little above the logarithm."""

LEAST_ALPHA = 0.002
"""As ``lighting.pbr`` has it."""

ROUGH = 0.09
"""Alpha from which on facets are rough: of a roughness of 0.3."""

BOUNCED, BOUNCED_CODES = 0.4, 950.0
"""See `bounced_slopes`."""

LARGEST_LIMIT = 0.15
"""
A limit above this, for normals that do not change over a face, leaves too little to float32.

That of `LARGEST_LIMIT_BY_LAMPS` over both shares: what takes float32 by lamps does without them.
"""


LEAST_SHININESS, STEADY_SHININESS = 1.0, 10.0
"""
Highlights that are wider than the first begin with an endless slope, and take float64.

From the second on they are nearly Gaussian, which the shares of `steepest` hold for.
"""

AMBIENT_SLOPE, AMBIENT_CODES = 3.0, 1100.0
"""
By which ambient light on facets changes with the cosine of the viewer, over itself.

And codes by which it does at most, over the root of that light if it is above 1: both found by
trying all cosines and widths.
"""


FOG_SLOPE = 0.43
"""By which fog changes with the distance, over its share: at most where it falls as exp2 does."""

CURVE_GAINS = {"none": 1.0, "reinhard": 2.0, "neutral": 2.0, "aces": 4.0}
"""
By how much more of itself what is seen may change than light does, by the name of a tone curve.

Of the last one channel may be the difference of others that are much larger.
"""

LEAST_WHITE = 1.0
"""Curves whose white is darker are steeper than light itself."""


class Brightness(NamedTuple):
    """What there is of light, as far as it is known without looking at places."""

    straight: float
    """The sum of all light from directions."""
    around: float = 0.0
    """Of ambient light."""
    gain: float = 1.0
    """Of `CURVE_GAINS`."""
    fog: float = 0.0
    """By how much the share of fog moves over that by which a distance does; infinite: by any."""


class Gloss(NamedTuple):
    """The highlights of an object."""

    specular: float
    shininess: float
    alpha: float
    """Width of the facets of metallic-roughness materials; infinite for others."""
    metallic: float = 0.0

    @property
    def mirrored(self) -> float:
        """What facets mirror of light straight on at most."""
        return 0.04 + 0.96 * self.metallic


def gloss_of(material: Material) -> Gloss:
    """Return the highlights of a material without textures."""
    if material.shading == "pbr":
        alpha = max(material.roughness * material.roughness, LEAST_ALPHA)
        return Gloss(0.0, 1.0, alpha, material.metallic)
    if material.specular > 0.0:
        return Gloss(material.specular, material.shininess, math.inf)
    return Gloss(0.0, 1.0, math.inf)


def brightness_of(
    lights: Sequence[Light], tones: ToneMap | None = None, fog: Fog | None = None
) -> Brightness:
    """Return what there is of light, by the lights of a scene and what they are seen through."""
    totals = {DirectionalLight: 0.0, AmbientLight: 0.0}
    for light in lights:
        if type(light) in totals:
            totals[type(light)] += light.intensity * max(light.color)
    gain = 1.0 if tones is None else CURVE_GAINS[tones.curve]
    return Brightness(totals[DirectionalLight], totals[AmbientLight], gain, fog_slope(fog))


def fog_slope(fog: Fog | None) -> float:
    """Return by how much the share of fog moves over that by which a distance does."""
    if fog is None:
        return 0.0
    if fog.height is not None:
        return math.inf
    return FOG_SLOPE if fog.mode != "linear" else fog.end / (fog.end - fog.start)


def is_steep(tones: ToneMap | None) -> bool:
    """Tell whether a tone curve makes dark light change more than `EXPOSED` times itself."""
    if tones is None:
        return False
    return tones.exposure > MOST_STOPS or tones.white < LEAST_WHITE


def lamps_among(lights: Sequence[Light]) -> tuple[Light, ...]:
    """Return the lights that have a place."""
    return tuple([light for light in lights if isinstance(light, PointLight | SpotLight)])


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
    facets = 0.5 / (gloss.alpha * gloss.alpha * gloss.alpha)
    return 1.0 + max(gloss.specular, facets)


def rows_of_lamps(
    rows: NDArray[np.float32], pyramids: NDArray[np.float64], exposed: float
) -> NDArray[np.float32]:
    """
    Return what bounds are worked out from, (..., P, 18) float32: see ``surface.lamps``.

    Parameters
    ----------
    rows : (..., P, 13) float32
        The lamps as ``Lighting.lights`` has them.
    pyramids : (P, 11) float64
        Around their cones: ``lights.pyramids_of``.
    exposed : float
        What light is multiplied by at most before it is shown.
    """
    found = np.empty((*rows.shape[:-1], LAMP_COLUMNS), np.float32)
    colors, scale, offset = rows[..., 4:7].astype(np.float64), rows[..., 10], rows[..., 11]
    light = exposed * colors.max(axis=-1)
    versine = offset.astype(np.float64) / np.where(scale > 0.0, scale, np.float32(1.0))
    sine = np.sqrt(np.maximum(versine * (2.0 - versine), 0.0))
    found[..., :3] = rows[..., :3]
    found[..., LIGHT] = light
    found[..., RAMP] = CODES_PER_RAMP * np.sqrt(light) * scale
    found[..., CONE] = found[..., RAMP] * sine
    found[..., ENDING] = rows[..., 12]
    found[..., PYRAMID:] = pyramids
    return found


def limits_of(gloss: Gloss, brightness: Brightness, has_lamps: bool) -> NDArray[np.float32] | None:
    """
    Return what lengths of normals and points are compared with, (12,) float32.

    A normal is to be as long as the first times that of the first vertex, plus the second times
    the longer way from there to another vertex's; the square of a point's distance as large as the
    third times that of the longer way to another vertex. The fourth and fifth are what the light of
    lamps adds to the first and second; the sixth is most of that light. What an error of a point
    does to a code: the seventh, times light, near the end of a range, and the eighth; the ninth is
    what a cone's is multiplied by. The others tell jumps and steep places: see ``surface.steep``.
    None if float32 is good for nothing.
    """
    light = brightness.straight * float(EXPOSED)
    shares = NORMAL_SHARE, POINT_SHARE
    if has_lamps:
        shares = NORMAL_SHARE_BY_LAMPS, POINT_SHARE_BY_LAMPS
    steep, rooted = bounced_slopes(gloss)
    slope = SLOPE * (1.0 + steep)
    more = slope * ROUNDING / shares[0]
    most = MOST_BENT / (5.0 * more) if has_lamps else 0.0
    peak = (light + most) * gloss.specular
    if peak > 0.0 and gloss.shininess < LEAST_SHININESS:
        return None
    shine = 4.0 / gloss.alpha * RELATIVE_SLOPE
    if peak > 0.0:
        shine += steepest(gloss.shininess, peak)
    shine = brightness.gain * (shine + rooted * max(1.0, math.sqrt(light + most)))
    around = 0.0
    if gloss.alpha < math.inf:
        ambient = brightness.around * float(EXPOSED)
        around = min(SLOPE * AMBIENT_SLOPE * ambient, AMBIENT_CODES * math.sqrt(max(ambient, 1.0)))
    bent = (slope * light + around + shine) * ROUNDING / shares[0]
    turned = shine + SLOPE * (steep * (light + most) + brightness.fog)
    moved = 20.0 * turned * ROUNDING / shares[1]
    largest = (LARGEST_LIMIT_BY_LAMPS, 8.0) if has_lamps else (LARGEST_LIMIT, 4.0)
    if 5.0 * bent > largest[0] or moved > largest[1]:
        return None
    limits = [5.0 * bent, 17.0 * bent, moved * moved, *[0.0] * 9]
    if has_lamps:
        limits[3:6] = 5.0 * more, 17.0 * more, most - bent / more
        peak = peak_of(gloss)
        limits[6:9] = SLOPE * peak, 2.0 * CODES_PER_SHARE + shine, math.sqrt(peak)
    limits[9:] = float(MATT), 0.0, shine / shares[1]
    if gloss.alpha < math.inf:
        limits[9:11] = gloss.alpha, gloss.mirrored
    elif gloss.specular > 0.0:
        limits[9:11] = float(BLINN), least_shown(gloss.shininess, (light + most) * gloss.specular)
    return np.array(limits, np.float32)


def steepest(shininess: float, peak: float) -> float:
    """
    Return the codes by which a highlight that is ``peak`` at most moves over an angle, at most.

    Logarithms of the peak are those of the next power of two, which has the same bits everywhere.
    """
    doublings = math.frexp(peak)[1] if peak > 1.0 else 0
    if shininess >= STEADY_SHININESS:
        root = math.sqrt(2.0 * LOG_2 * doublings)
        wider = 1.02 if shininess >= 30.0 else 1.25
        return wider * RELATIVE_SLOPE * math.sqrt(shininess) * (1.0 + root)
    # In the dark the power's slope counts; else the tangent, at the end of what is white at most.
    dark = SLOPE * peak * shininess
    if shininess <= 3.0:
        return dark
    tangent = math.sqrt(math.ldexp(1.0, math.ceil(2.0 * doublings / shininess)) - 1.0)
    wide = 1.0 / math.sqrt(shininess / 2.4 - 1.0)
    return min(dark, CODES_PER_SHARE * shininess * (wide + tangent))


def least_shown(shininess: float, peak: float) -> float:
    """
    Return a cosine below which a highlight is darker than `STEEP_SHARE` of a code.

    A little below the root of it, and of the same bits everywhere.
    """
    dark = math.frexp(STEEP_SHARE / (SLOPE * peak))[1] - 1 if peak > 0.0 else 0
    if dark >= 0:
        return 2.0
    # 2**-t is convex: it lies above its tangent.
    octaves = -dark / shininess
    return 1.0 - LOG_2 * octaves if octaves < 1.0 else math.ldexp(1.0, -math.ceil(octaves))


def limits_of_all(
    glosses: Sequence[Gloss | None], brightness: Brightness, is_dimmed: bool
) -> NDArray[np.float32]:
    """
    Return what bounds the errors of each of some objects, (O, 15) float32.

    The first three are those of `limits_of` on faces that no lamp reaches, -1 where an object takes
    float64 as a whole; then come those on faces that any does. So a lamp counts where its light
    falls, and nowhere else; the last, at jumps and steep places, are of both. ``is_dimmed``: no
    face that a lamp reaches is sure.
    """
    none = np.full(ALL_LIMITS, -1.0, np.float32)
    rows = {None: none}
    for gloss in {*glosses} - {None}:
        own, lit = limits_of(gloss, brightness, False), limits_of(gloss, brightness, True)
        row = rows[gloss] = none.copy()
        if own is None:
            continue
        row[:BY_LAMPS] = own[:BY_LAMPS]
        if lit is not None and not is_dimmed:
            row[BY_LAMPS:] = lit
        row[BY_LAMPS + GLOSS :] = (own if lit is None else lit)[GLOSS:]
    return np.array([rows[gloss] for gloss in glosses], np.float32).reshape(-1, ALL_LIMITS)
