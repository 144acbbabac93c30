"""
Cover what is seen with fog: each sample keeps a share of its colour that falls with distance.

The share is 2**-x of an optical depth x: along a ray of length d through fog of even density it is
d times the density. Where the density falls exponentially with height, its mean along the ray is
the difference of the densities at both ends over that of their exponents [1]_.

References
----------
.. [1] I. Quílez, "Better Fog", 2010.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels import lighting as lit
from rasterjit.kernels.interpolation import find_object, lowest_first, place_sample
from rasterjit.kernels.jit import disjoint_stage, stage
from rasterjit.kernels.lighting import exp2_by

LINEAR, EXPONENTIAL, EXPONENTIAL_SQUARED = 0, 1, 2
"""Modes, as ``Fog.mode`` numbers them."""

NEARLY_LEVEL = np.float32(0.25)
"""Change of the density's binary exponent along a ray, below which a series gives the mean."""

DEEPEST = np.float32(1e9)
"""Optical depths are held below: their squares stay finite."""

LN_2 = np.float32(0.69314718)


@stage
def distance_to(px, py, pz, toward_viewer):
    """
    Return how far a point is: from the eye, or from the camera's plane for a parallel projection.

    Takes a viewer direction of length one, if there is one; behind the plane is at 0.
    """
    straight = np.sqrt(px * px + py * py + pz * pz)
    along = -(px * toward_viewer[0] + py * toward_viewer[1] + pz * toward_viewer[2])
    return straight if toward_viewer[3] > np.float32(0.0) else max(along, np.float32(0.0))


@stage
def start_height(py, distance, toward_viewer):
    """Return how far above the eye a ray starts: 0, or on the plane of a parallel camera."""
    on_plane = py + distance * toward_viewer[1]
    return np.float32(0.0) if toward_viewer[3] > np.float32(0.0) else on_plane


@stage
def mean_density(low, rise, library):
    """
    Return the mean of 2**-t for t from ``low`` to ``low + rise``, to 1e-6; float32.

    The mean is at least the lesser of the ends, which also holds where both are beyond float32.
    Powers are those of the math library where ``library`` is not None.
    """
    first, last = exp2_by(-low, library), exp2_by(-(low + rise), library)
    is_level = abs(rise) < NEARLY_LEVEL
    y = rise * LN_2
    series = np.float32(-1.0 / 120.0) * y + np.float32(1.0 / 24.0)
    series = series * y - np.float32(1.0 / 6.0)
    series = np.float32(1.0) + y * (y * (-series) - np.float32(0.5))
    divided = (first - last) / (np.float32(1.0) if is_level else y)
    return first * series if is_level else max(divided, min(first, last))


@disjoint_stage
def cover_linearly(end, per_range, color, viewer, px, py, pz, red, green, blue):
    """Cover samples with fog whose share grows evenly with distance."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(red.shape[0]):
        distance = distance_to(px[i], py[i], pz[i], viewer)
        share = min(max((end - distance) * per_range, zero), one)
        rest = one - share
        red[i] = red[i] * share + color[0] * rest
        green[i] = green[i] * share + color[1] * rest
        blue[i] = blue[i] * share + color[2] * rest


@disjoint_stage
def cover_exponentially(
    density, squares, above, falloff, library, color, viewer, px, py, pz, red, green, blue
):  # fmt: skip
    """Cover samples with fog that keeps a share 2**-x of the colour, or 2**-(x**2)."""
    one = np.float32(1.0)
    for i in range(red.shape[0]):
        distance = distance_to(px[i], py[i], pz[i], viewer)
        start = start_height(py[i], distance, viewer)
        low, rise = (above + start) * falloff, (py[i] - start) * falloff
        depth = density * distance * mean_density(low, rise, library)
        depth = min(depth, DEEPEST)
        depth *= depth * squares + (one - squares)
        share = exp2_by(-depth, library)
        rest = one - share
        red[i] = red[i] * share + color[0] * rest
        green[i] = green[i] * share + color[1] * rest
        blue[i] = blue[i] * share + color[2] * rest


@stage
def place_samples(samples, weights, faces, geometry, placement, flat):
    """Write where the gathered samples lie; nothing if no face was lit at its middle."""
    if flat is None:
        return
    n, owner = np.uintp(0), np.int64(0)
    for column in range(np.uintp(faces.shape[0])):
        face = np.int64(faces[column])
        if face < 0:
            continue
        owner = find_object(face, placement.face_starts, owner)
        a, b, c = lowest_first(geometry.faces, face)
        at = 0.0, weights[0, n], weights[1, n]
        point = place_sample(at, a, b, c, owner, placement)
        for k in range(3):
            samples[lit.POINT_X + k, n] = point[k]
        n += np.uintp(1)


@stage
def find_places(samples, weights, faces, geometry, placement, fog):
    """
    Write where the gathered samples lie, if any may have been lit at the middle of its face.

    Parameters
    ----------
    samples : (SAMPLE_ROWS, N) float32
        Writes rows POINT_X...
    weights : (2 or more, N) float64
        Of the second and the third vertex.
    faces : (C,) int32
        The visible faces of the part of a row; those of the samples are not negative.
    geometry, placement : records
    fog : Fog or None
    """
    if fog is None:
        return
    place_samples(samples, weights, faces, geometry, placement, fog.flat)


@stage
def cover_samples(samples, count, fog, toward_viewer):
    """
    Cover a row of samples with fog; nothing without fog.

    Parameters
    ----------
    samples : (SAMPLE_ROWS, N) float32
        Reads rows POINT_X.., writes rows OUT_RED.., of the first ``count`` samples.
    count : int
    fog : Fog or None
    toward_viewer : (4,) float32
        A point p, relative to the eye, is seen along ``xyz - w p``.
    """
    if fog is None:
        return
    x, y, z, w = toward_viewer
    scale = lit.unit_scale(x, y, z)
    viewer = x * scale, y * scale, z * scale, w
    px, py, pz = (
        samples[lit.POINT_X, :count],
        samples[lit.POINT_Y, :count],
        (samples[lit.POINT_Z, :count]),
    )
    red, green, blue = (
        samples[lit.OUT_RED, :count],
        samples[lit.OUT_GREEN, :count],
        (samples[lit.OUT_BLUE, :count]),
    )
    if fog.mode == LINEAR:
        cover_linearly(fog.end, fog.per_range, fog.color, viewer, px, py, pz, red, green, blue)
        return
    squares = np.float32(1.0) if fog.mode == EXPONENTIAL_SQUARED else np.float32(0.0)
    cover_exponentially(
        fog.density, squares, fog.above, fog.falloff, fog.library, fog.color, viewer, px, py, pz,
        red, green, blue,
    )  # fmt: skip
