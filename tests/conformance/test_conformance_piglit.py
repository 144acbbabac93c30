"""
Re-creation of piglit's triangle rasterization test.

Source: piglit, ``tests/general/triangle-rasterization.cpp`` (read in Igalia/piglit 15e7655).

What it checks: 36 fixed triangles, the four right-angled ones with legs of 3/16 pixel that meet at
a pixel centre, each shifted by -1/16, 0 and 1/16 pixel in x and y; then 100 random triangles on a
grid of 1/16 pixel, whose box is 1, 2, 4 ... pixels wide; against an integer rasterizer that works
on the same grid. A pixel must be drawn by both or by none.

What differs: OpenGL's y points up, so its rule is a bottom-left one; here y is flipped, which
makes it RasterJIT's top-left one. The generator of random numbers is NumPy's, so the triangles are
others. The 36 triangles also have their owners written down, from the rule alone.
"""

from __future__ import annotations

from fractions import Fraction

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle

GRID = 16
"""Steps of piglit's grid to the pixel."""

LEG = Fraction(3, GRID)
SIZE = (4, 4)
BITS = [4, 8, 12]
"""Grids of RasterJIT that hold piglit's."""


def pixels(points, size, bits=8):
    """Return the pixels of one triangle of screen points."""
    positions = naive.clip_from_screen(points, size)
    quality = rj.Quality(subpixel_bits=bits)
    seen = rj.rasterize(positions, [(0, 1, 2)], size, quality=quality, threads=1)
    rows, columns = np.nonzero(seen.face_id == 0)
    return set(zip(columns.tolist(), rows.tolist(), strict=True))


def integer_pixels(points, size):
    """Return the pixels of a triangle on the grid, in integer arithmetic of NumPy alone."""
    corners = (np.asarray(points, float) * GRID).astype(np.int64)
    columns, rows = (np.arange(n) * GRID + GRID // 2 for n in size)
    (ax, ay), (bx, by), (cx, cy) = corners.tolist()
    if (bx - ax) * (cy - ay) < (cx - ax) * (by - ay):
        corners = corners[::-1]
    inside = np.ones((size[1], size[0]), bool)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        value = (bx - ax) * (rows[:, None] - ay) - (by - ay) * (columns - ax)
        # An edge that owns its points is moved out by the smallest step there is.
        inside &= value + bool(by < ay or (by == ay and bx > ax)) > 0
    return {(column, row) for row, column in np.argwhere(inside).tolist()}


@pytest.mark.parametrize("pixel", [(0, 0), (2, 1), (3, 3)])
@pytest.mark.parametrize("bits", BITS)
def test_each_of_the_36_fixed_triangles_has_the_centre_that_the_rule_gives_it(bits, pixel):
    for shift_x in (-1, 0, 1):
        for shift_y in (-1, 0, 1):
            x = pixel[0] + Fraction(1, 2) + Fraction(shift_x, GRID)
            y = pixel[1] + Fraction(1, 2) + Fraction(shift_y, GRID)
            # The centre is on the other side of the shift; on a border it goes right and down.
            owner = (1 if shift_x <= 0 else -1), (1 if shift_y <= 0 else -1)
            for side_x in (-1, 1):
                for side_y in (-1, 1):
                    points = [(x + side_x * LEG, y), (x, y + side_y * LEG), (x, y)]
                    want = {pixel} if (side_x, side_y) == owner else set()
                    assert pixels(points, SIZE, bits) == want
                    assert oracle.covered_pixels(points, SIZE, subpixel_bits=bits) == want
                    assert integer_pixels(points, SIZE) == want


def test_random_triangles_on_the_grid_have_the_pixels_of_integer_arithmetic():
    rng = np.random.default_rng(0xFACEBEEF)
    size, drawn = (256, 256), 0
    for _ in range(100):
        side = 2 ** int(rng.integers(0, 9))
        points = rng.integers(0, side * GRID, (3, 2)) / GRID
        want = integer_pixels(points, size)
        drawn += bool(want)
        for bits in BITS:
            assert pixels(points, size, bits) == want
        if side <= 32:
            assert oracle.covered_pixels(points, size) == want
    # Most of them must show something, or nothing was tested.
    assert drawn > 50
