"""Draw triangles that are given on the screen, and hold what is drawn against the oracle."""

from __future__ import annotations

import naive
import numpy as np
import screen

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.geometry import setup
from rasterjit.pipeline.records import Faces, Objects
from rasterjit.pipeline.visibility import tile_rasterizer
from rasterjit.pipeline.visibility import visibility_pass as drawing
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads

EXACT_BITS = 14
"""Points are rounded to this many bits, finer than any grid, so that they reach the engine as they
are."""

MAX = (16384, 16384)
"""The largest image, pixels."""

TILE = setup.TILE_SIZE


def dyadic(points):
    """Round points to 2**-EXACT_BITS pixel."""
    return np.round(np.asarray(points, float) * 2**EXACT_BITS) / 2**EXACT_BITS


def fan(hub, ring, *, closed):
    """Return points and faces of a fan around a hub."""
    faces = [[0, n, n % len(ring) + 1] for n in range(1, len(ring) + closed)]
    return [hub, *ring], faces


def draw(points, faces, size, bits=8, **options):
    """Rasterize faces of screen points; sizes are powers of two."""
    quality = rj.Quality(subpixel_bits=bits)
    return screen.draw(dyadic(points), faces, size, quality=quality, **options)


def pixels_of(face_id, face=0):
    """Return the pixels (column, row) that show a face."""
    rows, columns = np.nonzero(face_id == face)
    return set(zip(columns.tolist(), rows.tolist(), strict=True))


def pixels(points, size, bits=8):
    """Return the pixels of one triangle, on which the engine and the oracle must agree."""
    drawn = pixels_of(draw(points, [[0, 1, 2]], size, bits).face_id)
    assert drawn == oracle.covered_pixels(dyadic(points), size, subpixel_bits=bits)
    return drawn


def owners(points, faces, size, bits=8):
    """
    Return which face owns each pixel, (H, W), -1 where none does; none may be covered twice.

    All depths are equal, so the first face wins, and the last one if the faces are reversed: both
    pictures are the same only where at most one face covers the pixel. The oracle must agree that
    the face which is seen owns the pixel.
    """
    face_id = draw(points, faces, size, bits).face_id
    last = draw(points, faces[::-1], size, bits).face_id
    assert (face_id == np.where(last < 0, -1, len(faces) - 1 - last)).all()
    snapped = [(oracle.snap(x, bits), oracle.snap(y, bits)) for x, y in dyadic(points)]
    for row, column in np.argwhere(face_id >= 0).tolist():
        corners = [snapped[n] for n in faces[face_id[row, column]]]
        assert oracle.covers(corners, naive.centre(column, row, bits))
    return face_id


def counts(face_id, faces):
    """Return how many pixels show each face."""
    return np.bincount(face_id[face_id >= 0], minlength=len(faces)).tolist()


def draw_tile(positions, faces, column, row, bits=8):
    """
    Draw one tile of the largest image; return its face numbers, (64, 64) int32.

    The kernels get the whole image, but write to that tile alone: the system backs only the memory
    that is touched.
    """
    positions, faces = np.asarray(positions, float), np.asarray(faces, np.int32)
    viewport, workers = make_viewport(MAX, bits), threads.Workers(1)
    depth_coefficients = (0.0, -1.0, 0.0)
    screen, seen = drawing.project_to_screen(positions, depth_coefficients, viewport, workers)
    drawn = Faces(faces, np.empty((0, 3), np.int32), np.empty(0, np.int32))
    if seen & setup.CLIPPED:
        drawn, screen, _ = drawing.clip_faces(
            positions, faces, depth_coefficients, viewport, screen, workers
        )
    objects = Objects(np.array([0, len(faces)], np.int64), np.zeros(1, np.int8))
    starts, binned, tile_depths, _ = drawing.set_up_and_bin(
        drawn, objects, screen, viewport, workers
    )
    frame = np.empty(MAX, np.float32), np.empty(MAX, np.int32)
    drawer = tile_rasterizer.make_tile_drawer(binned, drawn, screen)
    tiles = np.array([row * (MAX[0] // TILE) + column], np.int32)
    tile_rasterizer.draw_tiles(
        tiles, tile_rasterizer.NO_COUNTER, starts, tile_depths, viewport, frame, *drawer[:3]
    )
    return frame[1][row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE].copy()
