"""
The figures of Direct3D's rasterization rules.

Sources: Microsoft Learn, "Rasterization Rules" of Direct3D 9 (the page of 2021-02-04: figures with
coordinates and counts) and of Direct3D 10 and 11 (top and left edges, the diamond of lines, several
samples, centroid); microsoft/DirectX-Specs, ``d3d/archive/D3D11_3_FunctionalSpec.htm`` (9a31a844),
sections 3.4.1 and 3.4.2, and its standard sample positions. The figures of the newer pages give no
coordinates, so they are re-made from their text.

What it checks: a square of 5 x 5 has 25 pixels, its two halves 15 and 10, as the left half has the
shared edge on its right; a rectangle of 2 x 4 between centres has 8 pixels of four triangles, by no
rule at all; an edge is a top one only if it is level; a triangle can have one or two left edges.

What differs
- Direct3D 9 has pixel centres at whole numbers: half a pixel is added.
- Lines: Direct3D draws a pixel when a line leaves its diamond, which leaves the last pixel out and
  gives a tie between two rows to the upper one. RasterJIT draws Bresenham's line with both ends and
  gives the tie to the lower one. The difference is held here so that nobody takes one for the
  other.
- Samples: RasterJIT has one in the centre. Several are held by moving the triangle so that each
  sample comes to the centre in turn, and centroid sampling by the weights found there.
"""

from __future__ import annotations

from fractions import Fraction

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle

SIZE = (8, 8)
HALF = Fraction(1, 2)
FOUR_SAMPLES = [(Fraction(x, 16), Fraction(y, 16)) for x, y in [(6, 2), (14, 6), (2, 10), (10, 14)]]
"""The standard positions of four samples, from the upper left corner of the pixel."""


def draw(points, faces=((0, 1, 2),), offset=(HALF, HALF)):
    """Rasterize faces of screen points moved by an offset."""
    moved = [(x + offset[0], y + offset[1]) for x, y in points]
    return rj.rasterize(naive.clip_from_screen(moved, SIZE), faces, SIZE, threads=1)


def pixels(points, **options):
    """Return the pixels of one triangle, which must be those of the oracle."""
    seen = draw(points, **options)
    offset = options.get("offset", (HALF, HALF))
    exact = oracle.covered_pixels([(x + offset[0], y + offset[1]) for x, y in points], SIZE)
    found = {(column, row) for row, column in np.argwhere(seen.face_id == 0).tolist()}
    assert found == exact
    return found


def block(left, top, right, bottom):
    return {(column, row) for column in range(left, right) for row in range(top, bottom)}


# --- triangles ------------------------------------------------------------------------------------


@pytest.mark.parametrize("cut", [((0, 1, 2), (0, 2, 3)), ((0, 1, 3), (1, 2, 3))])
def test_square_from_centre_to_centre_has_25_pixels(cut):
    corners = [(0, 0), (5, 0), (5, 5), (0, 5)]
    one, other = (pixels([corners[n] for n in face]) for face in cut)
    assert one | other == block(0, 0, 5, 5)
    assert not one & other


def test_the_half_whose_left_edge_is_shared_gets_15_pixels_and_the_other_10():
    upper = pixels([(0, 0), (5, 0), (5, 5)])
    lower = pixels([(0, 5), (0, 0), (5, 5)])
    assert upper == {(column, row) for column, row in block(0, 0, 5, 5) if column >= row}
    assert lower == {(column, row) for column, row in block(0, 0, 5, 5) if column < row}
    assert (len(upper), len(lower)) == (15, 10)


def test_rectangle_between_centres_needs_no_rule():
    # Four triangles around the middle of the rectangle, which lies between the pixels.
    ring = [(HALF, HALF), (5 * HALF, HALF), (5 * HALF, 9 * HALF), (HALF, 9 * HALF)]
    hub = (3 * HALF, 5 * HALF)
    drawn = [pixels([hub, ring[n], ring[(n + 1) % 4]]) for n in range(4)]
    assert set.union(*drawn) == block(1, 1, 3, 5)
    assert sum(map(len, drawn)) == 8
    # Every centre is strictly inside its triangle: no edge has to be asked.
    for n, found in enumerate(drawn):
        corners = hub, ring[n], ring[(n + 1) % 4]
        for pixel in found:
            assert min(oracle.affine_weights(corners, pixel)) > 0


def test_level_edge_owns_its_centres_only_on_top():
    top = pixels([(1, 2), (5, 2), (3, 6)])
    bottom = pixels([(1, 6), (5, 6), (3, 2)])
    assert {pixel for pixel in top if pixel[1] == 2} == block(1, 2, 5, 3)
    assert not {pixel for pixel in bottom if pixel[1] == 6}


def test_slanted_edge_owns_its_centres_only_on_the_left():
    # The upper edge of a triangle that is not level is no top edge.
    falling = [(0, 0), (6, 3)]
    below, above = pixels([*falling, (0, 3)]), pixels([*falling, (6, 0)])
    on_edge = {(2 * k, k) for k in range(1, 3)}
    assert on_edge.isdisjoint(below)
    assert on_edge <= above


def test_triangle_has_one_or_two_left_edges():
    two_left = pixels([(1, 3), (4, 0), (4, 6)])
    one_left = pixels([(5, 3), (2, 0), (2, 6)])
    on_left = {(1 + abs(3 - row), row) for row in range(1, 6)}
    assert on_left <= two_left
    assert {(2, row) for row in range(1, 6)} <= one_left
    # Mirrored, the two left edges are right ones and own nothing.
    assert {(5 - abs(3 - row), row) for row in range(7)}.isdisjoint(one_left)
    assert {(4, row) for row in range(7)}.isdisjoint(two_left)


# --- lines: what is not Direct3D's ----------------------------------------------------------------


def line(start, end):
    framebuffer = rj.Framebuffer(*SIZE)
    framebuffer.draw_line(start, end, (255, 255, 255))
    return {(column, row) for row, column in np.argwhere(framebuffer.color[..., 0] > 0).tolist()}


@pytest.mark.parametrize(("start", "end"), [((1, 2), (6, 2)), ((6, 2), (1, 2)), ((3, 1), (3, 6))])
def test_line_has_its_last_pixel_which_a_diamond_rule_leaves_out(start, end):
    drawn = line(start, end)
    assert end in drawn
    assert len(drawn) == 6


def test_tie_of_a_line_goes_down_where_a_diamond_rule_goes_up():
    # Half-way, the line meets the lower corner of the diamond of (2, 1), which Direct3D counts in.
    assert line((1, 1), (3, 2)) == {(1, 1), (2, 2), (3, 2)}
    assert line((3, 2), (1, 1)) == {(1, 1), (2, 2), (3, 2)}


# --- several samples ------------------------------------------------------------------------------


def to_centre(sample):
    """Return the offset that brings a sample to the centre of its pixel."""
    return HALF - sample[0], HALF - sample[1]


def masks(points):
    """Return which samples of which pixels a triangle covers, and the weights there."""
    seen = [draw(points, offset=to_centre(sample)) for sample in FOUR_SAMPLES]
    return np.stack([s.face_id == 0 for s in seen]), np.stack([s.barycentric for s in seen])


SLIM = [(Fraction(1, 2), Fraction(1, 4)), (Fraction(13, 2), 2), (Fraction(5, 4), Fraction(27, 4))]


def test_sample_is_covered_by_the_rule_of_the_centre():
    mask, _ = masks(SLIM)
    for sample, drawn in zip(FOUR_SAMPLES, mask, strict=True):
        exact = oracle.covered_pixels(SLIM, SIZE, sample=sample)
        assert {(i, j) for j, i in np.argwhere(drawn).tolist()} == exact


def test_samples_of_two_halves_are_shared_out():
    corners = [(0, 0), (5, 0), (5, 5), (0, 5)]
    one, _ = masks([corners[n] for n in (0, 1, 2)])
    other, _ = masks([corners[n] for n in (0, 2, 3)])
    assert not (one & other).any()
    assert (one | other)[:, :5, :5].all()
    assert (one | other).sum() == 4 * 25


def test_covered_sample_is_never_extrapolated_where_the_centre_is():
    mask, weights = masks(SLIM)
    centre = draw(SLIM, offset=(0, 0)).face_id == 0
    # Pixels that show the triangle though their centre lies outside it.
    only_samples = mask.any(axis=0) & ~centre
    assert only_samples.any()
    beside = [
        min(oracle.affine_weights(SLIM, (column + HALF, row + HALF)))
        for row, column in np.argwhere(only_samples).tolist()
    ]
    assert max(beside) <= 0
    assert min(beside) < 0
    # Centroid sampling takes a covered place instead: inside the range of the vertices.
    assert (weights[mask] >= 0).all()
    assert (weights[mask] <= 1).all()


def test_pixel_within_the_triangle_has_all_its_samples():
    mask, _ = masks(SLIM)
    whole = [(column, row) for column in range(8) for row in range(8)
             if oracle.pixel_area(SLIM, column, row) == 1]  # fmt: skip
    assert whole
    assert all(mask[:, row, column].all() for column, row in whole)
    empty = [(column, row) for column in range(8) for row in range(8)
             if oracle.pixel_area(SLIM, column, row) == 0]  # fmt: skip
    assert empty
    assert not any(mask[:, row, column].any() for column, row in empty)
