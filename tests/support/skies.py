"""Skies made up for tests and pictures: a sun in a blue sky over ground, as linear light."""

from __future__ import annotations

import numpy as np


def directions(width, height):
    """Return the direction of each texel's centre of an equirectangular picture, (H, W, 3)."""
    longitude = 2.0 * np.pi * ((np.arange(width) + 0.5) / width - 0.5)
    latitude = np.pi * (0.5 - (np.arange(height) + 0.5) / height)
    cosine = np.cos(latitude)[:, np.newaxis]
    return np.stack(
        [
            cosine * np.cos(longitude),
            np.repeat(np.sin(latitude)[:, np.newaxis], width, axis=1),
            cosine * np.sin(longitude),
        ],
        axis=-1,
    )


def solid_angles(width, height):
    """Return the solid angle of each texel, (H, 1)."""
    edges = np.sin(np.pi * (0.5 - np.arange(height + 1) / height))
    return ((edges[:-1] - edges[1:]) * 2.0 * np.pi / width)[:, np.newaxis]


def sunny(width=512, height=256, sun=(0.6, 0.55, 0.5), brightness=400.0, degrees=2.0):
    """Return a sky with a sun, (H, W, 3) float32; its towers at the horizon tell directions."""
    d = directions(width, height)
    up = d[:, :, 1]
    sky = np.array([0.16, 0.33, 0.72]) + np.exp(-4.0 * np.maximum(up, 0.0))[..., None] * np.array(
        [0.6, 0.5, 0.25]
    )
    ground = (
        np.array([0.22, 0.18, 0.13]) * (0.6 + 0.4 * np.exp(6.0 * np.minimum(up, 0.0)))[..., None]
    )
    image = np.where(up[..., None] > 0.0, sky, ground)
    longitude = np.degrees(np.arctan2(d[:, :, 2], d[:, :, 0]))
    latitude = np.degrees(np.arcsin(up))
    for at, color in ((0, (0.8, 0.1, 0.1)), (90, (0.1, 0.1, 0.8)), (-90, (0.1, 0.7, 0.1))):
        tower = (np.abs(longitude - at) < 6.0) & (latitude > 0.0) & (latitude < 14.0)
        image = np.where(tower[..., None], np.array(color), image)
    toward = np.array(sun) / np.linalg.norm(sun)
    is_sun = d @ toward > np.cos(np.radians(degrees))
    return np.where(is_sun[..., None], brightness * np.array([1.0, 0.9, 0.75]), image).astype(
        np.float32
    )
