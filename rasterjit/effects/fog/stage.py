"""
Apply fog: blend each sample with the fog's colour by transmittance.

Transmittance is 2**-x of an optical depth x: along a ray of length d through fog of even density it
is d times the density. Where the density falls exponentially with height, its mean along the ray is
the difference of the densities at both ends over that of their exponents [1]_.

References
----------
.. [1] I. Quílez, "Better Fog", 2010.
"""

from __future__ import annotations

import numpy as np

from rasterjit.pipeline.lighting.blinn_phong import invert_length
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.float_math import exp2
from rasterjit.runtime.intrinsics import three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32

MIN_RISE = np.float32(0.25)
"""Change of the density's binary exponent along a ray, below which a series gives the mean."""

MAX_OPTICAL_DEPTH = np.float32(1e9)
"""Optical depths are clamped to this: their squares stay finite."""

LN_2 = np.float32(0.69314718)


@helper
def compute_distance(px, py, pz, toward_viewer):
    """
    Return a point's distance from the eye, or from a parallel camera's plane (0 behind it).

    A parallel camera's direction to the viewer must have a length of one.
    """
    from_eye = np.sqrt(px * px + py * py + pz * pz)
    from_plane = -(px * toward_viewer[0] + py * toward_viewer[1] + pz * toward_viewer[2])
    return from_eye if toward_viewer[3] > np.float32(0.0) else max(from_plane, np.float32(0.0))


@helper
def compute_start_height(py, distance, toward_viewer):
    """Return the height above the eye where a ray starts: 0, or on a parallel camera's plane."""
    on_plane = py + distance * toward_viewer[1]
    return np.float32(0.0) if toward_viewer[3] > np.float32(0.0) else on_plane


@helper
def compute_mean_density(low, rise):
    """
    Return the mean of 2**-t for t from ``low`` to ``low + rise``, to 1e-6; float32.

    The mean is at least the lesser of the ends, which also holds where both are beyond float32.
    """
    first, last = exp2(-low), exp2(-(low + rise))
    is_level = abs(rise) < MIN_RISE
    y = rise * LN_2
    series = np.float32(-1.0 / 120.0) * y + np.float32(1.0 / 24.0)
    series = series * y - np.float32(1.0 / 6.0)
    series = np.float32(1.0) + y * (y * (-series) - np.float32(0.5))
    divided = (first - last) / (np.float32(1.0) if is_level else y)
    return first * series if is_level else max(divided, min(first, last))


@disjoint_helper
def blend_linear(end, inv_range, color, viewer, px, py, pz, red, green, blue):
    """Blend samples with fog that grows linearly with distance."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(red.shape[0]):
        distance = compute_distance(px[i], py[i], pz[i], viewer)
        transmittance = min(max(zero, (end - distance) * inv_range), one)
        opacity = one - transmittance
        red[i] = red[i] * transmittance + color[0] * opacity
        green[i] = green[i] * transmittance + color[1] * opacity
        blue[i] = blue[i] * transmittance + color[2] * opacity


@disjoint_helper
def blend_exponential(
    density, is_squared, eye_y, falloff, color, viewer, px, py, pz, red, green, blue
):  # fmt: skip
    """Blend samples with fog of transmittance 2**-x, or 2**-(x**2)."""
    one = np.float32(1.0)
    for i in range(red.shape[0]):
        distance = compute_distance(px[i], py[i], pz[i], viewer)
        start = compute_start_height(py[i], distance, viewer)
        low, rise = (eye_y + start) * falloff, (py[i] - start) * falloff
        depth = density * distance * compute_mean_density(low, rise)
        depth = min(depth, MAX_OPTICAL_DEPTH)
        depth *= depth * is_squared + (one - is_squared)
        transmittance = exp2(-depth)
        opacity = one - transmittance
        red[i] = red[i] * transmittance + color[0] * opacity
        green[i] = green[i] * transmittance + color[1] * opacity
        blue[i] = blue[i] * transmittance + color[2] * opacity


@helper
def normalize_viewer(toward_viewer):
    """Return the direction to the viewer with a length of one, if there is one, and w."""
    x, y, z, w = toward_viewer[0], toward_viewer[1], toward_viewer[2], toward_viewer[3]
    scale = invert_length(x, y, z)
    return x * scale, y * scale, z * scale, w


@stage
def apply_linear_fog(
    block: Block, count, end: float32, inv_range: float32, color: float32[::1],
    toward_viewer: float32[::1],
):  # fmt: skip
    """
    Apply fog that grows linearly with distance.

    Parameters
    ----------
    block : Block
        Reads rows POINT_X.., changes rows OUT_RED...
    count : int
    end, inv_range : float32
        Distance where nothing is left, and one over that from start to end, scene units.
    color : (3,) float32, linear
    toward_viewer : (4,) float32
        A point p, relative to the eye, is seen along ``xyz - w p``.
    """
    s = block.samples
    blend_linear(
        end, inv_range, color, normalize_viewer(toward_viewer),
        *three_parts(s, rows.POINT_X, 0, count), *three_parts(s, rows.OUT_RED, 0, count),
    )  # fmt: skip


@stage
def apply_exp_fog(
    block: Block, count, density: float32, is_squared: float32, eye_y: float32[::1],
    falloff: float32, color: float32[::1], toward_viewer: float32[::1],
):  # fmt: skip
    """
    Apply fog of transmittance 2**-x, or 2**-(x**2), of an optical depth x.

    Parameters
    ----------
    block, count, color, toward_viewer
        As `apply_linear_fog` takes them.
    density, falloff : float32
        Per scene unit, times log2(e); the density's root of that where the depth is squared.
    eye_y : (1,) float32, scene units
        Height of the eye over where the fog has its density.
    is_squared : float32
        1 to square the optical depth, 0 to leave it.
    """
    s = block.samples
    blend_exponential(
        density, is_squared, eye_y[0], falloff, color, normalize_viewer(toward_viewer),
        *three_parts(s, rows.POINT_X, 0, count), *three_parts(s, rows.OUT_RED, 0, count),
    )  # fmt: skip
