"""
The crack of DRTK's rasterizer, which RasterJIT must not have.

Source: facebookresearch/DRTK, issue 9 ("Edge case", open when read, of 2024-11-05).

What it checks: a square of 6 x 6 pixels is cut along its diagonal into faces (0, 1, 2) and
(3, 2, 1). In DRTK the six pixels of the diagonal belong to neither; written as (0, 1, 2) and
(3, 1, 2) the holes go away. Whatever the order of the vertices, each of the 36 pixels must be
drawn once.

What differs: DRTK has pixel centres at whole numbers, RasterJIT half a pixel further, so half a
pixel is added. The vertices lie 2**-14 pixel off the grid of RasterJIT, which rounds them; the
exact vertices are held too, by the oracle. The coordinates are the issue's; the two pictures below
are drawn by the top-left rule.
"""

from __future__ import annotations

import itertools
from fractions import Fraction

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle

SIZE = (8, 8)
OFF = Fraction(1, 2**14)
POINTS = [(1, 1 - OFF), (1, 7), (7 + OFF, 1 - OFF), (7 + OFF, 7)]
SQUARE = np.zeros((8, 8), int)
SQUARE[1:7, 1:7] = 1
DIAGONAL = [(column, 7 - column) for column in range(1, 7)]
"""The pixels that DRTK leaves out."""

ORDERS = list(
    itertools.product(itertools.permutations((0, 1, 2)), itertools.permutations((1, 2, 3)))
)


def draw(face, bits=8):
    positions = naive.clip_from_screen(POINTS, SIZE)
    quality = rj.Quality(subpixel_bits=bits)
    return rj.rasterize(positions, [face], SIZE, quality=quality, threads=1).face_id == 0


def exactly(face):
    """Return the pixels of a face whose vertices are not rounded."""
    corners = [POINTS[n] for n in face]
    half = Fraction(1, 2)
    return np.array([[oracle.covers(corners, (i + half, j + half)) for i in range(8)]
                     for j in range(8)])  # fmt: skip


def test_the_diagonal_runs_exactly_through_six_centres():
    # Otherwise the other tests could not fail.
    half = Fraction(1, 2)
    on_edge = [
        (i, j)
        for i, j in itertools.product(range(8), repeat=2)
        if oracle.edge(POINTS[1], POINTS[2], (i + half, j + half)) == 0 and SQUARE[j, i]
    ]
    assert on_edge == DIAGONAL


@pytest.mark.parametrize("bits", [4, 8, 12])
def test_square_is_covered_once_for_every_order_of_the_vertices(bits):
    for one, other in ORDERS:
        assert (draw(one, bits).astype(int) + draw(other, bits) == SQUARE).all()


def test_square_of_unrounded_vertices_is_covered_once_for_every_order():
    upper, lower = exactly((0, 1, 2)), exactly((3, 2, 1))
    assert (upper.astype(int) + lower == SQUARE).all()
    for one, other in ORDERS:
        assert (exactly(one) == upper).all()
        assert (exactly(other) == lower).all()


def test_the_diagonal_belongs_to_the_face_on_its_right():
    positions = naive.clip_from_screen(POINTS, SIZE)
    seen = rj.rasterize(positions, [(0, 1, 2), (3, 2, 1)], SIZE, threads=1).face_id
    # It leaves the face on its right with a left edge.
    want = np.where(SQUARE, np.add.outer(np.arange(8), np.arange(8)) >= 7, -1)
    assert (seen == want).all()
