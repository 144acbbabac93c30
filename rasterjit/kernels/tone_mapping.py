"""
Expose light and bring it into what a screen shows, 0..1, by a tone curve.

The curve is data: a loop for each, so that the loops vectorize. What is below zero or no number
gives what zero gives.

References
----------
.. [1] E. Reinhard, M. Stark, P. Shirley, J. Ferwerda, "Photographic Tone Reproduction for Digital
   Images", SIGGRAPH 2002, equation 4.
.. [2] S. Hill, "ACES fitted", in M. Pettineo's BakingLab, 2016.
.. [3] The Khronos Group, "Khronos PBR Neutral Tone Mapper", 2024.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.lighting import exp2_by

NONE, REINHARD, ACES, NEUTRAL = 0, 1, 2, 3
"""Curves, as ``ToneMap.curve`` numbers them."""

MOST_LIGHT = np.float32(1e12)
"""Exposed light is held below: its square is finite in float32, and every curve is at its end."""

START = np.float32(0.76)
"""Largest channel that the neutral curve keeps: 0.8, less the 0.04 that it takes off."""

REFLECTANCE = np.float32(0.04)
"""Of common dielectrics head on: what the neutral curve takes off, so that base colours stay."""

DESATURATION = np.float32(0.15)
"""How fast colours pale beyond the start of the neutral curve."""


@stage
def exposed(value, factor):
    """Return exposed light held in 0..MOST_LIGHT; NaN gives 0."""
    value = value * factor
    value = value if value > np.float32(0.0) else np.float32(0.0)
    return min(value, MOST_LIGHT)


@stage
def reinhard(red, green, blue, per_white):
    """Return a colour scaled so that its luminance L becomes L (1 + L per_white) / (1 + L)."""
    one = np.float32(1.0)
    luminance = np.float32(0.2126) * red + np.float32(0.7152) * green + np.float32(0.0722) * blue
    scale = (one + luminance * per_white) / (one + luminance)
    return red * scale, green * scale, blue * scale


@stage
def filmic(x):
    """Return the rational curve of Hill's fit."""
    above = x * (x + np.float32(0.0245786)) - np.float32(0.000090537)
    below = x * (np.float32(0.983729) * x + np.float32(0.4329510)) + np.float32(0.238081)
    return above / below


@stage
def mixed(red, green, blue, weights):
    """Return the weighted sum of three channels."""
    return (
        np.float32(weights[0]) * red
        + np.float32(weights[1]) * green
        + np.float32(weights[2]) * blue
    )


@stage
def aces(red, green, blue):
    """Return Hill's fit of the transforms from scene light to an sRGB display, not cut off."""
    r = filmic(mixed(red, green, blue, (0.59719, 0.35458, 0.04823)))
    g = filmic(mixed(red, green, blue, (0.07600, 0.90834, 0.01566)))
    b = filmic(mixed(red, green, blue, (0.02840, 0.13383, 0.83777)))
    return (
        mixed(r, g, b, (1.60475, -0.53108, -0.07367)),
        mixed(r, g, b, (-0.10208, 1.10813, -0.00605)),
        mixed(r, g, b, (-0.00327, -0.07276, 1.07602)),
    )


@stage
def neutral(red, green, blue):
    """Return Khronos' neutral curve: less the reflectance, and compressed above the start."""
    one = np.float32(1.0)
    least = min(red, min(green, blue))
    offset = least - np.float32(6.25) * least * least
    offset = offset if least < REFLECTANCE + REFLECTANCE else REFLECTANCE
    red, green, blue = red - offset, green - offset, blue - offset
    peak = max(red, max(green, blue))
    rest = one - START
    over = max(peak, START)
    lowered = one - rest * rest / (over + rest - START)
    kept = one / (DESATURATION * (over - lowered) + one)
    is_over = peak >= START
    scale = kept * lowered / over if is_over else one
    pale = lowered * (one - kept) if is_over else np.float32(0.0)
    return red * scale + pale, green * scale + pale, blue * scale + pale


@disjoint_stage
def expose_span(factor, red, green, blue, out_red, out_green, out_blue):
    """Write exposed light."""
    for i in range(out_red.shape[0]):
        out_red[i] = exposed(red[i], factor)
        out_green[i] = exposed(green[i], factor)
        out_blue[i] = exposed(blue[i], factor)


@disjoint_stage
def reinhard_span(per_white, red, green, blue):
    """Apply Reinhard's curve in place."""
    for i in range(red.shape[0]):
        red[i], green[i], blue[i] = reinhard(red[i], green[i], blue[i], per_white)


@disjoint_stage
def aces_span(red, green, blue):
    """Apply Hill's fit in place."""
    for i in range(red.shape[0]):
        red[i], green[i], blue[i] = aces(red[i], green[i], blue[i])


@disjoint_stage
def neutral_span(red, green, blue):
    """Apply Khronos' neutral curve in place."""
    for i in range(red.shape[0]):
        red[i], green[i], blue[i] = neutral(red[i], green[i], blue[i])


@stage
def map_tones(tone, red, green, blue, out_red, out_green, out_blue):
    """Write what is to be shown of a span of light; the arrays do not overlap."""
    factor = exp2_by(tone.stops, tone.library)
    expose_span(factor, red, green, blue, out_red, out_green, out_blue)
    if tone.curve == REINHARD:
        reinhard_span(tone.per_white, out_red, out_green, out_blue)
    elif tone.curve == ACES:
        aces_span(out_red, out_green, out_blue)
    elif tone.curve == NEUTRAL:
        neutral_span(out_red, out_green, out_blue)


@stage
def map_pixel(tone, red, green, blue):
    """Return what is to be shown of one colour; the colour itself without a tone map."""
    if tone is None:
        return red, green, blue
    factor = exp2_by(tone.stops, tone.library)
    red, green, blue = exposed(red, factor), exposed(green, factor), exposed(blue, factor)
    if tone.curve == REINHARD:
        return reinhard(red, green, blue, tone.per_white)
    if tone.curve == ACES:
        return aces(red, green, blue)
    if tone.curve == NEUTRAL:
        return neutral(red, green, blue)
    return red, green, blue


@stage
def toned(samples, count, colors, tone):
    """
    Return the rows of red, green and blue to show: those given, without a tone map.

    With one they are written over the normals of the samples, which nothing needs any more.
    """
    if tone is None:
        return colors
    shown = samples[lit.NORMAL_X], samples[lit.NORMAL_Y], samples[lit.NORMAL_Z]
    map_tones(
        tone, colors[0][:count], colors[1][:count], colors[2][:count], shown[0][:count],
        shown[1][:count], shown[2][:count],
    )  # fmt: skip
    return shown
