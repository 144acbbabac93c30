"""Draw clip-space faces, and say what exact arithmetic draws: shared by the conformance tests."""

from __future__ import annotations

import math

import numpy as np

import rasterjit as rj
from rasterjit.inspect import oracle


def triangle_list(count):
    """Return the faces of an unindexed list of vertices."""
    return [(n, n + 1, n + 2) for n in range(0, count - 2, 3)]


def triangle_strip(count):
    """Return the faces of a strip; every second one is turned round, as OpenGL does."""
    return [(n + n % 2, n + 1 - n % 2, n + 2) for n in range(count - 2)]


def triangle_fan(count):
    """Return the faces of a fan around vertex 0."""
    return [(0, n, n + 1) for n in range(1, count - 1)]


PRIMITIVES = {"list": triangle_list, "strip": triangle_strip, "fan": triangle_fan}


def flat(points, z=0.0):
    """Return points (x, y) of normalized device coordinates as clip positions with w = 1."""
    points = np.asarray(points, float)
    return np.column_stack([points, np.full(len(points), z), np.ones(len(points))])


def draw(positions, faces, size, **options):
    """Rasterize clip positions on one thread."""
    return rj.rasterize(positions, faces, size, threads=1, **options)


def covered(positions, face, size, **options):
    """Return which pixels the engine draws of one face alone; (H, W) bool."""
    return draw(positions, [face], size, **options).face_id == 0


def exactly_covered(positions, face, size):
    """
    Return which pixels exact arithmetic draws of one face; (H, W) bool.

    Clipped and snapped as `rasterjit.oracle.render_faces` describes. Only pixels around what the
    view volume leaves of the face are looked at: snapping moves an edge by less than one.
    """
    mask = np.zeros((size[1], size[0]), bool)
    corners = [positions[n].tolist() for n in face]
    visible = [oracle.screen_position(v, size) for v in oracle.clip_polygon(corners)]
    if not visible:
        return mask
    xs, ys = zip(*visible, strict=True)
    left, top = max(0, math.floor(min(xs)) - 1), max(0, math.floor(min(ys)) - 1)
    right, bottom = min(size[0], math.ceil(max(xs)) + 1), min(size[1], math.ceil(max(ys)) + 1)
    cut = oracle.clip_polygon(corners, oracle.guard_band(size))
    screen = [oracle.screen_position(v, size) for v in cut]
    for n in range(1, len(screen) - 1):
        piece = screen[0], screen[n], screen[n + 1]
        pixels = oracle.covered_pixels(piece, size, window=(left, top, right, bottom))
        for column, row in pixels:
            mask[row, column] = True
    return mask


def hits_as_exact(positions, faces, size, **options):
    """
    Return how many of the faces hit each pixel, (H, W) int, each drawn alone.

    Every face must have exactly the pixels of the oracle.
    """
    total = np.zeros((size[1], size[0]), int)
    for face in faces:
        mask = covered(positions, face, size, **options)
        assert (mask == exactly_covered(positions, face, size)).all()
        total += mask
    return total


def picture(text):
    """Return the face numbers that a drawing of digits and dots shows; (H, W) int."""
    rows = text.split()
    return np.array([[-1 if c == "." else int(c) for c in row] for row in rows])
