"""Put triangles, and meshes, at exact places of the screen."""

from __future__ import annotations

from fractions import Fraction

import naive
import numpy as np

import rasterjit as rj

UNIT = Fraction(1, 2**53)
"""Largest relative error of one float64 operation."""


def draw(points, faces, size, z=0.0, w=1.0, **options):
    """Rasterize faces of screen points; ``z`` is the depth z / w."""
    positions = naive.clip_from_screen(points, size, z, w)
    return rj.rasterize(positions, faces, size, threads=1, **options)


def camera(near):
    """Return a camera at the origin whose image is the square |x|, |y| <= -z, far at infinity."""
    clip = np.diag([1.0, 1.0, -1.0, 0.0])
    clip[2, 3], clip[3, 2] = -2.0 * near, -1.0
    return rj.MatrixCamera(np.eye(4), clip)


def mesh(points, faces, size, w=1.0, **attributes):
    """Return the mesh that `camera` sees at screen points, at the distances w."""
    positions = naive.clip_from_screen(points, size, 0.0, w)
    vertices = np.column_stack([positions[:, :2], -positions[:, 3]])
    material = rj.Material(shading="unlit", base_color="white")
    return rj.Mesh(vertices, faces, material=material, **attributes)


def centre(column, row):
    """Return a pixel's centre, pixels."""
    return column + Fraction(1, 2), row + Fraction(1, 2)


def corners(points):
    """Return screen points as they are after snapping, pixels."""
    return [(Fraction(x, 256), Fraction(y, 256)) for x, y in rj.oracle.snap_triangle(points)]


def covered(seen):
    """Return the pixels (column, row) that show a face, as ints."""
    rows, columns = np.nonzero(seen.face_id >= 0)
    return list(zip(columns.tolist(), rows.tolist(), strict=True))


def is_rounded(have, exact, slack):
    """Tell whether a float32 is the rounding of a number within ``slack`` of the exact one."""
    lowest, highest = float(exact - slack), float(exact + slack)
    with np.errstate(over="ignore"):
        return np.float32(lowest) <= have <= np.float32(highest)


def bits(value):
    """Return the bit pattern of a float32."""
    return int(np.float32(value).view(np.uint32))
