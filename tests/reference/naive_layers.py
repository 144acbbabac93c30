"""The slow, obvious twin of the layers: every surface of a pixel in a list, sorted, laid over."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import naive
import naive_visibility
import numpy as np

import rasterjit as rj
from rasterjit.inspect import oracle

CENTRE = (Fraction(1, 2), Fraction(1, 2))
"""Where a pixel is sampled, from its upper left corner."""

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


def exact_surfaces(triangles, size, place=CENTRE):
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


def rounded_surfaces(triangles, size, place=CENTRE):
    """Return the same by depths as they are stored: (minus depth, face)."""
    found = {}
    way = [float(CENTRE[axis] - place[axis]) for axis in (0, 1)]
    for face, (points, depths) in enumerate(triangles):
        seen = naive_visibility.stored_depths(np.add(points, way), stored(depths), size)
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


def mean(colors):
    """Return the mean of straight RGBA colours, (N, 4): of what is emitted, and of alpha."""
    colors = np.asarray(colors, float)
    premultiplied = colors[:, :3] * colors[:, 3:]
    alpha = colors[:, 3].mean()
    return np.append(premultiplied.mean(axis=0) / (alpha if alpha > 0.0 else 1.0), alpha)


def crossings(lines):
    """Return the heights where two of some lines ``a x + b y + c = 0`` meet, in 0..1."""
    found = set()
    for n, (a, b, c) in enumerate(lines):
        for d, e, f in lines[:n]:
            if a * e != b * d:
                y = (c * d - a * f) / (a * e - b * d)
                if 0 < y < 1:
                    found.add(y)
    return found


def exact_shares(triangles, column, row):
    """
    Return the area of a pixel that shows each triangle, exactly.

    The pixel is cut into strips between all heights where two edges, or an edge and a line of equal
    depths, meet. In each strip the widths of what is seen are linear, so their mean is that at half
    the height.

    Parameters
    ----------
    triangles : list of (points (3, 2) pixels, depths (3,))
        Points on 1/256 pixel. The smaller depth is nearer, the lower number wins a tie.
    column, row : int

    Returns
    -------
    dict of face: Fraction
    """
    half, planes, edges = Fraction(1, 2), [], []
    for face, (points, depths) in enumerate(triangles):
        corners = [
            (Fraction(x, 256) - column, Fraction(y, 256) - row)
            for x, y in oracle.snap_triangle(points)
        ]
        if oracle.edge(*corners) == 0 or oracle.pixel_area(corners, 0, 0) == 0:
            continue
        if oracle.edge(*corners) < 0:
            corners, depths = corners[::-1], depths[::-1]
        own = [
            (p[1] - q[1], q[0] - p[0], (q[1] - p[1]) * p[0] - (q[0] - p[0]) * p[1])
            for p, q in zip(corners, corners[1:] + corners[:1], strict=True)
        ]
        here, right, down = (
            oracle.depth_at(corners, depths, place) for place in ((0, 0), (1, 0), (0, 1))
        )
        planes.append((right - here, down - here, here))
        edges.append((face, own))
    equal = [
        tuple(p - q for p, q in zip(planes[n], planes[k], strict=True))
        for n in range(len(planes)) for k in range(n)
    ]  # fmt: skip
    lines = [(1, 0, 0), (1, 0, -1), *(line for _, own in edges for line in own), *equal]
    level = {-c / Fraction(b) for a, b, c in lines if a == 0 and b != 0}
    heights = sorted({0, 1, *crossings(lines), *(y for y in level if 0 < y < 1)})
    shares = {}
    for low, high in pairwise(heights):
        y = (low + high) * half
        xs = {-(b * y + c) / Fraction(a) for a, b, c in lines if a != 0}
        xs = sorted(x for x in xs if 0 <= x <= 1)
        for left, right in pairwise(xs):
            x = (left + right) * half
            seen = [
                (a * x + b * y + c, face)
                for (a, b, c), (face, own) in zip(planes, edges, strict=True)
                if all(p * x + q * y + r > 0 for p, q, r in own)
            ]
            if seen:
                face = min(seen)[1]
                shares[face] = shares.get(face, 0) + (right - left) * (high - low)
    return shares
