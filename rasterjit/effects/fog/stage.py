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

from rasterjit.pipeline.lighting.blinn_phong import unit_scale
from rasterjit.pipeline.surface import sample_block as rows
from rasterjit.pipeline.surface.sample_block import Block
from rasterjit.runtime.float_math import exp2
from rasterjit.runtime.intrinsics import three_parts
from rasterjit.runtime.jit import disjoint_helper, helper, stage
from rasterjit.runtime.state_block import float32

NEARLY_LEVEL = np.float32(0.25)
"""Change of the density's binary exponent along a ray, below which a series gives the mean."""

DEEPEST = np.float32(1e9)
"""Optical depths are clamped to this: their squares stay finite."""

LN_2 = np.float32(0.69314718)


@helper
def distance_to(px, py, pz, toward_viewer):
    """
    Return how far a point is: from the eye, or from the camera's plane for a parallel projection.

    Takes a viewer direction of length one, if there is one; behind the plane is at 0.
    """
    straight = np.sqrt(px * px + py * py + pz * pz)
    along = -(px * toward_viewer[0] + py * toward_viewer[1] + pz * toward_viewer[2])
    return straight if toward_viewer[3] > np.float32(0.0) else max(along, np.float32(0.0))


@helper
def start_height(py, distance, toward_viewer):
    """Return how far above the eye a ray starts: 0, or on the plane of a parallel camera."""
    on_plane = py + distance * toward_viewer[1]
    return np.float32(0.0) if toward_viewer[3] > np.float32(0.0) else on_plane


@helper
def mean_density(low, rise):
    """
    Return the mean of 2**-t for t from ``low`` to ``low + rise``, to 1e-6; float32.

    The mean is at least the lesser of the ends, which also holds where both are beyond float32.
    """
    first, last = exp2(-low), exp2(-(low + rise))
    is_level = abs(rise) < NEARLY_LEVEL
    y = rise * LN_2
    series = np.float32(-1.0 / 120.0) * y + np.float32(1.0 / 24.0)
    series = series * y - np.float32(1.0 / 6.0)
    series = np.float32(1.0) + y * (y * (-series) - np.float32(0.5))
    divided = (first - last) / (np.float32(1.0) if is_level else y)
    return first * series if is_level else max(divided, min(first, last))


@disjoint_helper
def cover_evenly(end, per_range, color, viewer, px, py, pz, red, green, blue):
    """Cover samples with fog whose share grows evenly with distance."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(red.shape[0]):
        distance = distance_to(px[i], py[i], pz[i], viewer)
        share = min(max(zero, (end - distance) * per_range), one)
        rest = one - share
        red[i] = red[i] * share + color[0] * rest
        green[i] = green[i] * share + color[1] * rest
        blue[i] = blue[i] * share + color[2] * rest


@disjoint_helper
def cover_by_powers(
    density, squares, above, falloff, color, viewer, px, py, pz, red, green, blue
):  # fmt: skip
    """Cover samples with fog that keeps a share 2**-x of the colour, or 2**-(x**2)."""
    one = np.float32(1.0)
    for i in range(red.shape[0]):
        distance = distance_to(px[i], py[i], pz[i], viewer)
        start = start_height(py[i], distance, viewer)
        low, rise = (above + start) * falloff, (py[i] - start) * falloff
        depth = density * distance * mean_density(low, rise)
        depth = min(depth, DEEPEST)
        depth *= depth * squares + (one - squares)
        share = exp2(-depth)
        rest = one - share
        red[i] = red[i] * share + color[0] * rest
        green[i] = green[i] * share + color[1] * rest
        blue[i] = blue[i] * share + color[2] * rest


@helper
def unit_viewer(toward_viewer):
    """Return the direction to the viewer with a length of one, if there is one, and w."""
    x, y, z, w = toward_viewer[0], toward_viewer[1], toward_viewer[2], toward_viewer[3]
    scale = unit_scale(x, y, z)
    return x * scale, y * scale, z * scale, w


@stage
def cover_linearly(
    block: Block, count, end: float32, per_range: float32, color: float32[::1],
    toward_viewer: float32[::1],
):  # fmt: skip
    """
    Cover samples with fog whose share grows evenly with distance.

    Parameters
    ----------
    block : Block
        Reads rows POINT_X.., changes rows OUT_RED...
    count : int
    end, per_range : float32
        Scene units, and one over them; see ``FogRecord``.
    color : (3,) float32, linear
    toward_viewer : (4,) float32
        A point p, relative to the eye, is seen along ``xyz - w p``.
    """
    s = block.samples
    cover_evenly(
        end, per_range, color, unit_viewer(toward_viewer), *three_parts(s, rows.POINT_X, 0, count),
        *three_parts(s, rows.OUT_RED, 0, count),
    )  # fmt: skip


@stage
def cover_exponentially(
    block: Block, count, density: float32, squares: float32, above: float32[::1], falloff: float32,
    color: float32[::1], toward_viewer: float32[::1],
):  # fmt: skip
    """
    Cover samples with fog that keeps a share 2**-x of the colour, or 2**-(x**2).

    Parameters
    ----------
    block, count, color, toward_viewer
        As `cover_linearly` takes them.
    density, falloff : float32
        See ``FogRecord``.
    above : (1,) float32, scene units
        Height of the eye over where the fog has its density.
    squares : float32
        1: the depth is squared, 0: it is not.
    """
    s = block.samples
    cover_by_powers(
        density, squares, above[0], falloff, color, unit_viewer(toward_viewer),
        *three_parts(s, rows.POINT_X, 0, count), *three_parts(s, rows.OUT_RED, 0, count),
    )  # fmt: skip
