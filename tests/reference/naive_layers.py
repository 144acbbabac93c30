"""The slow, obvious twin of the layers: every surface of a pixel in a list, sorted, laid over."""

from __future__ import annotations

import math
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
        In the order of the exact depths; each is rounded once, to float64.
    """
    x, y = naive_visibility.samples_of(size, 256, place)
    found, planes = [], []
    for points, depths in triangles:
        a, b, c = corners = oracle.snap_triangle(points)
        covered = naive_visibility.covers(corners, x, y)
        # Depth is a whole number over the area and the denominator of the three depths.
        exact = [Fraction(float(z)) for z in depths]
        whole = math.lcm(*(z.denominator for z in exact))
        edges = [naive_visibility.edge(*ends, x, y) for ends in ((b, c), (c, a), (a, b))]
        at = sum(
            values[covered].astype(object) * int(z * whole)
            for values, z in zip(edges, exact, strict=True)
        )
        under = oracle.edge(a, b, c) * whole
        planes.append((covered, at, under))
        # Python divides whole numbers with one rounding, so floats that differ are in order.
        depth = np.full(covered.shape, np.nan)
        depth[covered] = (at / under).astype(float) if len(at) else 0.0
        found.append(depth)
    surfaces = _by_pixel(found)
    for (column, row), here in surfaces.items():
        if any(one == other for (one, _), (other, _) in pairwise(here)):
            exact = {}
            for _, face in here:
                covered, at, under = planes[face]
                index = np.count_nonzero(covered[:row]) + np.count_nonzero(covered[row, :column])
                exact[face] = Fraction(at[index], under)
            here.sort(key=lambda surface, exact=exact: (exact[surface[1]], surface[1]))
    return surfaces


def rounded_surfaces(triangles, size, place=CENTRE):
    """Return the same by depths as they are stored: (minus depth, face)."""
    found = []
    way = [float(CENTRE[axis] - place[axis]) for axis in (0, 1)]
    for points, depths in triangles:
        seen = naive_visibility.stored_depths(np.add(points, way), stored(depths), size)
        found.append(np.where(seen > -np.inf, -seen, np.nan))
    return _by_pixel(found)


def _by_pixel(depths):
    """Return what covers each pixel, sorted, of the depths of faces, (H, W), NaN beside them."""
    depths = np.asarray(depths)
    faces, rows, columns = np.nonzero(~np.isnan(depths))
    values = depths[faces, rows, columns]
    order = np.lexsort((faces, values, columns, rows))
    surfaces = {}
    for row, column, value, face in zip(
        *(some[order].tolist() for some in (rows, columns, values, faces)), strict=True
    ):
        surfaces.setdefault((column, row), []).append((value, face))
    return surfaces


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


def picture(surfaces, seen, colors, background, size):
    """Return what the seen faces of each pixel's surfaces show, (H, W, 4) float64."""
    shown = np.empty((size[1], size[0], 4))
    shown[:] = background
    known = {}
    for (column, row), found in surfaces.items():
        faces = tuple(seen(found))
        if faces not in known:
            known[faces] = over(faces, colors, background)
        shown[row, column] = known[faces]
    return shown


def mean(colors):
    """Return the mean of straight RGBA colours, (..., N, 4): of what is emitted, and of alpha."""
    colors = np.asarray(colors, float)
    premultiplied = (colors[..., :3] * colors[..., 3:]).mean(axis=-2)
    alpha = colors[..., 3].mean(axis=-1)[..., np.newaxis]
    return np.concatenate([premultiplied / np.where(alpha > 0.0, alpha, 1.0), alpha], axis=-1)


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
        beside = any(max(along) <= 0 or min(along) >= 1 for along in zip(*corners, strict=True))
        if beside or oracle.edge(*corners) == 0 or oracle.pixel_area(corners, 0, 0) == 0:
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
