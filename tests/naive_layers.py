"""The slow, obvious twin of the layers: every surface of a pixel in a list, sorted, laid over."""

from __future__ import annotations

from fractions import Fraction

import naive
import naive_visibility
import numpy as np

import rasterjit as rj
from rasterjit import oracle

CAMERA = rj.MatrixCamera(np.eye(4), np.eye(4))
"""A parallel projection whose clip space is the world: depth grows with z."""


def mesh_of(points, depths, size, **material):
    """Return the mesh of one triangle at exact screen points, (3, 2), with depths -1..1."""
    positions = naive.clip_from_screen(points, size, depths)
    return rj.Mesh(positions[:, :3], [[0, 1, 2]], material=rj.Material("unlit", **material))


def scene_of(meshes):
    """Return a scene of some meshes."""
    scene = rj.Scene()
    for mesh in meshes:
        scene.add(mesh)
    return scene


def stored(depths):
    """Return the stored depth of depths: greater is nearer."""
    return [-0.5 * float(z) - 0.5 for z in depths]


def exact_surfaces(triangles, size, place=(Fraction(1, 2), Fraction(1, 2))):
    """
    Return the faces at a place of each pixel with exact depths, nearest first.

    Parameters
    ----------
    triangles : list of (points (3, 2), depths (3,))
        Points in pixels, depths smaller is nearer; the lower number wins a tie.
    size : (int, int)
    place : (Fraction, Fraction)
        From the upper left corner of the pixel.

    Returns
    -------
    dict of (column, row): [(depth, face), ...]
    """
    found = {}
    for face, (points, depths) in enumerate(triangles):
        corners = oracle.snap_triangle(points)
        for column, row in oracle.covered_pixels(points, size, sample=place):
            where = (column + place[0]) * 256, (row + place[1]) * 256
            depth = oracle.depth_at(corners, depths, where)
            found.setdefault((column, row), []).append((depth, face))
    return {pixel: sorted(surfaces) for pixel, surfaces in found.items()}


def rounded_surfaces(triangles, size):
    """Return the same at the centres, by depths as they are stored: (minus depth, face)."""
    found = {}
    for face, (points, depths) in enumerate(triangles):
        seen = naive_visibility.stored_depths(points, stored(depths), size)
        for row, column in np.argwhere(seen > -np.inf).tolist():
            found.setdefault((column, row), []).append((-seen[row, column], face))
    return {pixel: sorted(surfaces) for pixel, surfaces in found.items()}


def seen_faces(surfaces, is_blended):
    """Return the faces down to the first opaque one."""
    faces = []
    for _, face in surfaces:
        faces.append(face)
        if not is_blended[face]:
            break
    return faces


def over(faces, colors, background):
    """
    Return straight RGBA, float64, of faces over a background, each with straight alpha.

    By Porter and Duff's formula of premultiplied colours, from the farthest to the nearest.
    """
    seen = np.array([*background[:3], 1.0], float) * background[3]
    for face in reversed(faces):
        color = np.asarray(colors[face], float)
        seen = np.array([*color[:3], 1.0]) * color[3] + (1.0 - color[3]) * seen
    return np.append(seen[:3] / seen[3], seen[3]) if seen[3] > 0.0 else np.append(seen[:3], 0.0)
