"""
Slow, obvious twins of the shadows: rays against every triangle, in float64, without any map.

A point is in shadow where the segment to the light crosses a triangle other than its own.
"""

from __future__ import annotations

import math

import numpy as np

import rasterjit as rj
from rasterjit.scene import transforms


def world_triangles(scene):
    """Return the triangles of a scene, (F, 3, 3), world space, in the order of its face numbers."""
    parts = []
    for node in scene.nodes:
        points = transforms.apply(node.world_from_model, node.mesh.vertices)
        parts.append(points[node.mesh.faces])
    return np.concatenate(parts)


def toward(light, points):
    """Return the way from points, (N, 3), to a light; far beyond everything if it has no place."""
    if isinstance(light, rj.DirectionalLight):
        return np.broadcast_to(-np.array(light.direction), points.shape)
    return np.array(light.position) - points


def crosses(origins, ways, triangle, longest):
    """Tell which rays meet a triangle at more than 0 and less than ``longest`` ways from their
    origin, by the volumes of the tetrahedra that a ray spans with each side."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    along = ways @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((a - origins) @ normal) / along
    hit = origins + np.where(np.isfinite(t), t, 0.0)[:, np.newaxis] * ways
    inside = np.isfinite(t) & (t > 1e-9) & (t < longest)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= np.cross(q - p, hit - p) @ normal >= 0.0
    return inside


def in_shadow(points, own, triangles, light):
    """
    Tell which points something lies before, (N,) bool.

    Parameters
    ----------
    points : (N, 3), world space
    own : (N,) int
        The face that each point lies on, which does not shade it.
    triangles : (F, 3, 3), world space
    light : Light
    """
    ways = toward(light, points)
    longest = math.inf if isinstance(light, rj.DirectionalLight) else 1.0
    shaded = np.zeros(len(points), bool)
    for number, triangle in enumerate(triangles):
        shaded |= crosses(points, ways, triangle, longest) & (own != number)
    return shaded


def beside(points, own, triangles, light, aside):
    """
    Yield points moved on the planes of their faces, ``aside`` (N,) at right angles to the light.

    In eight directions; a plane that is seen from the light at a flat angle is moved on far.
    """
    ways = toward(light, points)
    ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    least = np.eye(3)[np.abs(ways).argmin(axis=1)]
    u = np.cross(ways, least)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(ways, u)
    a, b, c = np.moveaxis(triangles[own], 1, 0)
    normal = np.cross(b - a, c - a)
    for k in range(8):
        angle = k * math.pi / 4.0
        moved = points + aside[:, np.newaxis] * (math.cos(angle) * u + math.sin(angle) * v)
        back = ((moved - points) * normal).sum(axis=1) / (ways * normal).sum(axis=1)
        yield moved - back[:, np.newaxis] * ways


def clear_shadow(points, own, triangles, light, aside):
    """
    Tell where points and all beside them are in shadow, and where they are all in the light.

    Returns
    -------
    dark, bright : (N,) bool
        Neither, where an edge of the shadow is nearer than ``aside``.
    """
    dark = in_shadow(points, own, triangles, light)
    bright = ~dark
    for moved in beside(points, own, triangles, light, aside):
        shaded = in_shadow(moved, own, triangles, light)
        dark &= shaded
        bright &= ~shaded
    return dark, bright


def share_beside_ball(points, center, radius, light, lines=41):
    """
    Return the share of a directional light's round disk that a ball leaves, (N,).

    Rays to a square grid of ``lines`` times ``lines`` points, those of them on the disk.
    """
    ways = np.eye(3)
    toward_light = -np.array(light.direction)
    u = np.cross(toward_light, ways[np.abs(toward_light).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(toward_light, u)
    tangent = math.tan(math.radians(light.shadow.light_size / 2.0))
    steps = np.linspace(-1.0, 1.0, lines)
    left, rays = np.zeros(len(points)), 0
    for x in steps:
        for y in steps[np.abs(steps) <= math.sqrt(1.0 - x * x)]:
            way = toward_light + tangent * (x * u + y * v)
            way = way / np.linalg.norm(way)
            to_center = np.array(center) - points
            along = to_center @ way
            aside = (to_center**2).sum(axis=1) - along**2
            left += (along < 0.0) | (aside > radius**2)
            rays += 1
    return left / rays
