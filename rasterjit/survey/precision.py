"""
Whether lit samples may take float32, and what bounds the errors of their normals and points.

An interpolated normal is off by at most ``u (5 |first| + 17 way)``, where ``u`` is 2**-24, the
first vertex's normal is 5 roundings off, and the ways from there to the others, which it is moved
by, are 17 in all: 10 of the weights (``float32_weights.WEIGHT_ERROR``), 4 of turning them, 3 of
adding them up. Divided by its length that is an angle. A point, relative to the eye, is off by
``u (2 |point| + 20 way)``: divided by its distance, an angle of the view.

An 8-bit sRGB code changes with the cosine of directional light by at most `SLOPE` times the light:
12.92 times 255 codes, in the dark. Of a highlight it changes by 255 / 2.4 of the highlight's share
of itself at most, which is ``sqrt(shininess) (1 + sqrt(2 ln peak))`` for Blinn's, as far as it
is not white, and 4 over the width of facets for GGX. Both together, times the angle, stay below
`NORMAL_SHARE` and `POINT_SHARE` of a code: where they may not, a sample takes float64.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterjit.scene.light import AmbientLight, DirectionalLight, Light
from rasterjit.scene.mesh import Mesh

ROUNDING = 2.0**-24
SLOPE = 12.92 * 255.0
RELATIVE_SLOPE = 255.0 / 2.4
NORMAL_SHARE, POINT_SHARE = 3.0 / 64.0, 1.0 / 64.0
"""Of a code that errors of normals, and of points, may come to."""

MOST_STOPS, EXPOSED = 1.0, 2.0
"""Exposures above this take float64; those below are reckoned as this. What it multiplies by."""

LOG_2 = 0.6931472

LEAST_ALPHA = 0.002
"""As ``lighting.pbr`` has it."""

LARGEST_LIMIT = 0.125
"""A limit above this, for normals that do not change over a face, leaves too little to float32."""


class Gloss(NamedTuple):
    """The sharpest highlights of some objects."""

    specular: float
    shininess: float
    alpha: float
    """Least width of the facets of metallic-roughness materials; infinite without any."""


def gloss_of(meshes: Sequence[Mesh]) -> Gloss:
    """Return the sharpest highlights of meshes."""
    specular, shininess, alpha = 0.0, 1.0, math.inf
    for material in {mesh.material for mesh in meshes}:
        if material.shading == "pbr":
            is_laid = material.metallic_roughness_texture is not None
            roughness = 0.0 if is_laid else material.roughness
            alpha = min(alpha, max(roughness * roughness, LEAST_ALPHA))
        elif material.specular > 0.0:
            specular = max(specular, material.specular)
            shininess = max(shininess, material.shininess)
    return Gloss(specular, shininess, alpha)


def brightness_of(lights: Sequence[Light]) -> float:
    """Return the sum of all light from directions; infinite if a light has a place."""
    total = 0.0
    for light in lights:
        if isinstance(light, DirectionalLight):
            total += light.intensity * max(light.color)
        elif not isinstance(light, AmbientLight) and light.intensity > 0.0:
            return math.inf
    return total


def limits_of(gloss: Gloss, brightness: float) -> NDArray[np.float32] | None:
    """
    Return what lengths of normals and points are compared with, (3,) float32.

    A normal is to be as long as the first times that of the first vertex, plus the second times
    the longer way from there to another vertex's; the square of a point's distance as large as the
    third times that of the longer way to another vertex. None if float32 is good for nothing.
    """
    if not math.isfinite(brightness):
        return None
    light = brightness * EXPOSED
    peak = light * gloss.specular
    # Its logarithm is below that of the next power of two, which has the same bits everywhere.
    doublings = math.frexp(peak)[1] if peak > 1.0 else 0
    shine = 4.0 / gloss.alpha
    if gloss.specular > 0.0:
        shine += math.sqrt(gloss.shininess) * (1.0 + math.sqrt(2.0 * LOG_2 * doublings))
    shine *= RELATIVE_SLOPE
    bent = (SLOPE * light + shine) * ROUNDING / NORMAL_SHARE
    moved = 20.0 * shine * ROUNDING / POINT_SHARE
    if 5.0 * bent > LARGEST_LIMIT or moved > 2.0:
        return None
    return np.array([5.0 * bent, 17.0 * bent, moved * moved], np.float32)
