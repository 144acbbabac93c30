"""Slow, obvious twins of ambient occlusion and outlines: rays against triangles, pixel by pixel."""

from __future__ import annotations

import numpy as np


def cosine_directions(normal, count):
    """Return unit vectors around a normal, as dense as the cosine, (count, 3): a sunflower."""
    k = np.arange(count) + 0.5
    radius, turn = np.sqrt(k / count), k * np.pi * (3.0 - np.sqrt(5.0))
    disc = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1.0 - k / count)], 1)
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    return disc @ np.stack([first, np.cross(normal, first), normal])


def hit_distances(point, directions, triangles):
    """Return how far each ray goes until it meets one of the triangles (T, 3, 3), or inf."""
    nearest = np.full(len(directions), np.inf)
    for a, b, c in triangles:
        sides = [np.broadcast_to(side, directions.shape) for side in (b - a, c - a)]
        matrix = np.stack([*sides, -directions], axis=2)
        with np.errstate(all="ignore"):
            determinants = np.linalg.det(matrix)
            known = np.abs(determinants) > 1e-12
            u, v, t = np.linalg.solve(
                np.where(known[:, None, None], matrix, np.eye(3)),
                np.broadcast_to((point - a)[:, None], (len(directions), 3, 1)),
            )[:, :, 0].T
        hit = known & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6)
        nearest = np.where(hit & (t < nearest), t, nearest)
    return nearest


def open_share(point, normal, triangles, radius, count=600):
    """
    Return the cosine-weighted share of light that reaches a point.

    A surface takes away all of a direction's light up to sqrt(1/2) of the radius, and less and
    less of it from there to the radius.
    """
    start = point + 1e-4 * radius * normal
    share = hit_distances(start, cosine_directions(normal, count), triangles) / radius
    with np.errstate(over="ignore"):
        weights = np.clip(2.0 - 2.0 * share**2, 0.0, 1.0)
    return 1.0 - weights.mean()


def disc(width):
    """Return which pixels a disc of this diameter covers, (width, width) bool."""
    centers = np.arange(width) - (width - 1) / 2.0
    return centers[:, None] ** 2 + centers**2 <= (width / 2.0) ** 2


def jumps(position, normal, toward, axis, footprint):
    """
    Return where neighbours along an axis of the image are not of one surface.

    From world positions and the normals of faces (H, W, 3): the neighbour lies neither near the
    plane of this pixel's face, nor this pixel near the plane of the neighbour's.
    """
    here = [slice(None)] * 2
    there = [slice(None)] * 2
    here[axis], there[axis] = slice(None, -1), slice(1, None)
    here, there = tuple(here), tuple(there)
    way = position[there] - position[here]
    off_mine = np.abs((way * normal[here]).sum(2)) / np.abs((toward[here] * normal[here]).sum(2))
    off_theirs = np.abs((way * normal[there]).sum(2)) / np.abs(
        (toward[there] * normal[there]).sum(2)
    )
    return np.minimum(off_mine, off_theirs) > footprint
