"""
Apply exposure and a tone curve, to 0..1.

The curve is data: each has its own loop, so that the loops vectorize. Negative values and NaN count
as zero.

References
----------
.. [1] E. Reinhard, M. Stark, P. Shirley, J. Ferwerda, "Photographic Tone Reproduction for Digital
   Images", SIGGRAPH 2002, equation 4.
.. [2] S. Hill, "ACES fitted", in M. Pettineo's BakingLab, 2016.
.. [3] The Khronos Group, "Khronos PBR Neutral Tone Mapper", 2024.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rasterjit.pipeline.srgb_encoding import composite_over
from rasterjit.pipeline.surface.sample_block import NORMAL_X, Block
from rasterjit.runtime.float_math import clamped, exp2
from rasterjit.runtime.intrinsics import three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, kernel, stage
from rasterjit.runtime.state_block import float32, int64

NONE, REINHARD, ACES, NEUTRAL = 0, 1, 2, 3
"""Curves, as ``ToneRecord.curve`` numbers them."""

UNMAPPED = -1
"""No tone mapping: neither exposed nor clamped."""

MAX_LIGHT = np.float32(1e12)
"""Largest exposed light: float32 holds its square, and every curve has reached its limit."""

NEUTRAL_START = np.float32(0.76)
"""Largest channel that the neutral curve leaves uncompressed: 0.8 - `DIELECTRIC_REFLECTANCE`."""

DIELECTRIC_REFLECTANCE = np.float32(0.04)
"""Reflectance of dielectrics at normal incidence: the neutral curve subtracts it."""

DESATURATION = np.float32(0.15)
"""How fast colours desaturate above the start of the neutral curve."""


class ToneRecord(NamedTuple):
    """The tone map of a frame."""

    curve: int64
    stops: float32
    """Exposure, stops."""
    inverse_white: float32
    """One over the square of the luminance that becomes white."""


NO_TONES = ToneRecord(UNMAPPED, 0.0, 0.0)
"""The record of a frame without a tone map."""


@helper
def expose(value, factor):
    """Return exposed light clamped to 0..MAX_LIGHT; NaN gives 0."""
    return clamped(value * factor, np.float32(0.0), MAX_LIGHT)


@helper
def apply_reinhard(red, green, blue, inverse_white):
    """Return a colour scaled so that its luminance L becomes L (1 + L inverse_white) / (1 + L)."""
    one = np.float32(1.0)
    luminance = np.float32(0.2126) * red + np.float32(0.7152) * green + np.float32(0.0722) * blue
    scale = (one + luminance * inverse_white) / (one + luminance)
    return red * scale, green * scale, blue * scale


@helper
def evaluate_filmic(x):
    """Evaluate the rational curve of Hill's fit."""
    above = x * (x + np.float32(0.0245786)) - np.float32(0.000090537)
    below = x * (np.float32(0.983729) * x + np.float32(0.4329510)) + np.float32(0.238081)
    return above / below


@helper
def sum_weighted(red, green, blue, weights):
    """Return the weighted sum of three channels."""
    return (
        np.float32(weights[0]) * red
        + np.float32(weights[1]) * green
        + np.float32(weights[2]) * blue
    )


@helper
def apply_aces(red, green, blue):
    """Apply Hill's fit of the transforms from scene light to an sRGB display, without clamping."""
    r = evaluate_filmic(sum_weighted(red, green, blue, (0.59719, 0.35458, 0.04823)))
    g = evaluate_filmic(sum_weighted(red, green, blue, (0.07600, 0.90834, 0.01566)))
    b = evaluate_filmic(sum_weighted(red, green, blue, (0.02840, 0.13383, 0.83777)))
    return (
        sum_weighted(r, g, b, (1.60475, -0.53108, -0.07367)),
        sum_weighted(r, g, b, (-0.10208, 1.10813, -0.00605)),
        sum_weighted(r, g, b, (-0.00327, -0.07276, 1.07602)),
    )


@helper
def apply_neutral(red, green, blue):
    """Apply Khronos' neutral curve: subtract the reflectance, and compress above the start."""
    one = np.float32(1.0)
    least = min(red, min(green, blue))
    offset = least - np.float32(6.25) * least * least
    offset = (
        offset
        if least < DIELECTRIC_REFLECTANCE + DIELECTRIC_REFLECTANCE
        else DIELECTRIC_REFLECTANCE
    )
    red, green, blue = red - offset, green - offset, blue - offset
    peak = max(red, max(green, blue))
    span = one - NEUTRAL_START
    high = max(peak, NEUTRAL_START)
    lowered = one - span * span / (high + span - NEUTRAL_START)
    weight = one / (DESATURATION * (high - lowered) + one)
    is_high = peak >= NEUTRAL_START
    scale = weight * lowered / high if is_high else one
    pale = lowered * (one - weight) if is_high else np.float32(0.0)
    return red * scale + pale, green * scale + pale, blue * scale + pale


@disjoint_helper
def expose_span(factor, red, green, blue, out_red, out_green, out_blue):
    """Write exposed light."""
    for i in range(out_red.shape[0]):
        out_red[i] = expose(red[i], factor)
        out_green[i] = expose(green[i], factor)
        out_blue[i] = expose(blue[i], factor)


@disjoint_helper
def apply_reinhard_span(inverse_white, red, green, blue):
    """Apply Reinhard's curve in place."""
    for i in range(red.shape[0]):
        red[i], green[i], blue[i] = apply_reinhard(red[i], green[i], blue[i], inverse_white)


@disjoint_helper
def apply_aces_span(red, green, blue):
    """Apply Hill's fit in place."""
    for i in range(red.shape[0]):
        red[i], green[i], blue[i] = apply_aces(red[i], green[i], blue[i])


@disjoint_helper
def apply_neutral_span(red, green, blue):
    """Apply Khronos' neutral curve in place."""
    for i in range(red.shape[0]):
        red[i], green[i], blue[i] = apply_neutral(red[i], green[i], blue[i])


@helper
def map_tones(tone, red, green, blue, out_red, out_green, out_blue):
    """Write the display light of a span of scene light; the arrays do not overlap."""
    factor = exp2(tone.stops)
    expose_span(factor, red, green, blue, out_red, out_green, out_blue)
    if tone.curve == REINHARD:
        apply_reinhard_span(tone.inverse_white, out_red, out_green, out_blue)
    elif tone.curve == ACES:
        apply_aces_span(out_red, out_green, out_blue)
    elif tone.curve == NEUTRAL:
        apply_neutral_span(out_red, out_green, out_blue)


@helper
def map_pixel(tone, red, green, blue):
    """Return the display light of one colour; the colour itself without a tone map."""
    if tone.curve == UNMAPPED:
        return red, green, blue
    factor = exp2(tone.stops)
    red, green, blue = expose(red, factor), expose(green, factor), expose(blue, factor)
    if tone.curve == REINHARD:
        return apply_reinhard(red, green, blue, tone.inverse_white)
    if tone.curve == ACES:
        return apply_aces(red, green, blue)
    if tone.curve == NEUTRAL:
        return apply_neutral(red, green, blue)
    return red, green, blue


@stage
def map_samples(block: Block, count, first: int64, tone: ToneRecord):
    """
    Map the tones of the three rows of samples from ``first`` on.

    Writes the result over the normals, rows NORMAL_X.., which nothing needs any more.
    """
    s = block.samples
    map_tones(tone, *three_parts(s, first, 0, count), *three_parts(s, NORMAL_X, 0, count))


@helper
def composite_pixel(linear, display, tone, background):
    """Composite a pixel, (4,), over its background, as light and tone mapped."""
    alpha = linear[3]
    if not alpha > np.float32(0.0):
        # Most pixels of many pictures show the background alone.
        for k in range(4):
            linear[k], display[k] = background[k], background[k]
        return
    color = linear[0], linear[1], linear[2]
    mapped = composite_over(alpha, map_pixel(tone, color[0], color[1], color[2]), background)
    blend = composite_over(alpha, color, background)
    for k in range(4):
        linear[k], display[k] = blend[k], mapped[k]


@kernel
def map_over_color(
    linear: float32[:, :, ::1], background: float32[::1], tone: ToneRecord,
    display: float32[:, :, ::1],
):  # fmt: skip
    """
    Map the tones of rows, and composite them over a background that is not mapped.

    Parameters
    ----------
    linear : (R, W, 4) float32
        Straight alpha; changed: composited over the background in linear light.
    background : (4,) float32, linear
    tone : ToneRecord
    display : (R, W, 4) float32
        Written: tone mapped, composited over the background.
    """
    rgba = background[0], background[1], background[2], background[3]
    for row in range(linear.shape[0]):
        for column in range(linear.shape[1]):
            composite_pixel(linear[row, column], display[row, column], tone, rgba)


@kernel
def map_over_picture(linear: float32[:, :, ::1], picture: float32[:, :, ::1], tone: ToneRecord):
    """
    Map the tones of rows, and composite them over a picture, (R, W, 4) float32, linear, in place.

    One kernel for this and `map_over_color` would take a tenth longer.
    """
    for row in range(linear.shape[0]):
        for column in range(linear.shape[1]):
            pixel = picture[row, column]
            rgba = pixel[0], pixel[1], pixel[2], pixel[3]
            composite_pixel(linear[row, column], pixel, tone, rgba)
