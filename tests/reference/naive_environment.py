"""Slow, obvious twins: light from all around, fog and tone curves, in float64 and one at a time."""

from __future__ import annotations

import math

import numpy as np
from skies import directions, solid_angles


def look_up(image, direction):
    """Return the bilinear mix of a panorama's texels towards a direction."""
    x, y, z = np.array(direction, np.float64) / np.linalg.norm(direction)
    height, width = image.shape[:2]
    column = (math.atan2(z, x) / (2.0 * math.pi) + 0.5) * width - 0.5
    row = (0.5 - math.asin(min(max(y, -1.0), 1.0)) / math.pi) * height - 0.5
    held = min(max(row, 0.0), height - 1.0)
    row, beyond = held, abs(row - held)
    left, top = math.floor(column), math.floor(row)
    total = np.zeros(3)
    for i, across in ((left, 1.0 - (column - left)), (left + 1, column - left)):
        for j, down in ((top, 1.0 - (row - top)), (min(top + 1, height - 1), row - top)):
            total += across * down * image[j, i % width].astype(np.float64)
    # Beyond the middle of the last row it becomes the row's mean, which the pole shows.
    pole = image[round(held)].astype(np.float64).mean(axis=0)
    return total + 2.0 * beyond * (pole - total)


def gradient(sky, direction):
    """Return what a sky without picture shows towards a direction."""
    y = direction[1] / np.linalg.norm(direction)
    end = np.array(sky.zenith if y > 0.0 else sky.ground)
    return (1.0 - abs(y)) * np.array(sky.horizon) + abs(y) * end


def irradiance(image, normal):
    """Return the light on a surface over pi: the sum over all texels in front of it."""
    height, width = image.shape[:2]
    cosines = np.maximum(directions(width, height) @ normal, 0.0) * solid_angles(width, height)
    return np.einsum("hw,hwc->c", cosines, image.astype(np.float64)) / math.pi


def mirrored(image, direction, roughness):
    """Return the mean around a direction that facets of a roughness mirror, texel by texel."""
    height, width = image.shape[:2]
    cosines = directions(width, height) @ direction
    alpha = roughness * roughness
    # Facets bisect the directions to the light and to the viewer, who is where the mean is taken.
    half = np.cos(np.arccos(np.clip(cosines, -1.0, 1.0)) / 2.0)
    facets = alpha**2 / (math.pi * (half**2 * (alpha**2 - 1.0) + 1.0) ** 2)
    weights = facets * np.maximum(cosines, 0.0) * solid_angles(width, height)
    return np.einsum("hw,hwc->c", weights, image.astype(np.float64)) / weights.sum()


def fog_share(fog, point, eye):
    """Return the share of a colour that fog lets through, the ray cut into short pieces."""
    point, eye = np.array(point, np.float64), np.array(eye, np.float64)
    distance = float(np.linalg.norm(point - eye))
    if fog.mode == "linear":
        return min(max((fog.end - distance) / (fog.end - fog.start), 0.0), 1.0)
    if fog.mode == "exp2":
        return math.exp(-((fog.density * distance) ** 2))
    if fog.height is None:
        return math.exp(-fog.density * distance)
    pieces = 20000
    y = eye[1] + (np.arange(pieces) + 0.5) / pieces * (point[1] - eye[1])
    densities = fog.density * np.exp(-fog.falloff * (y - fog.height))
    return math.exp(-float(densities.mean()) * distance)


def tone(curve, color, exposure=0.0, white=math.inf):
    """Return a colour through exposure and tone curve."""
    r, g, b = (max(channel, 0.0) * 2.0**exposure for channel in color)
    if curve == "reinhard":
        luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b
        if luminance == 0.0:
            return 0.0, 0.0, 0.0
        shown = luminance * (1.0 + luminance / white**2) / (1.0 + luminance)
        return tuple(channel * shown / luminance for channel in (r, g, b))
    if curve == "aces":
        enter = [[0.59719, 0.35458, 0.04823], [0.076, 0.90834, 0.01566], [0.0284, 0.13383, 0.83777]]
        leave = [
            [1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605],
            [-0.00327, -0.07276, 1.07602],
        ]  # fmt: skip
        v = np.array(enter) @ (r, g, b)
        v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
        return tuple(np.array(leave) @ v)
    if curve == "neutral":
        # The formulas of the specification, not those of its sample code.
        f90, ks, kd = 0.04, 0.8 - 0.04, 0.15
        x = min(r, g, b)
        f = x - x**2 / (4.0 * f90) if x <= 2.0 * f90 else f90
        p = max(r - f, g - f, b - f)
        if p <= ks:
            return r - f, g - f, b - f
        pn = 1.0 - (1.0 - ks) ** 2 / (p + 1.0 - 2.0 * ks)
        kept = 1.0 / (kd * (p - pn) + 1.0)
        return tuple((channel - f) * pn / p * kept + pn * (1.0 - kept) for channel in (r, g, b))
    return r, g, b
