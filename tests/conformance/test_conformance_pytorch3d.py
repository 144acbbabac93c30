"""
Re-creation of the literal pictures of PyTorch3D's rasterizer tests.

Source: facebookresearch/pytorch3d, ``tests/test_rasterize_meshes.py`` (read at 8fc28ba): the
helpers ``_test_back_face_culling``, ``_simple_triangle_raster``, ``_test_perspective_correct``,
``_test_behind_camera`` and ``_simple_blurry_raster``. The barycentric clipping of 5 x 5 pixels and
``test_order_of_ties`` are of a later revision and re-made from their description.

What it checks: which face, and which depth, each pixel of a small image shows; the second layer
behind it; back faces; depth with and without perspective; that nothing after the camera is drawn;
that the order of faces does not matter; that equal depths go by face number.

What differs, and how it is mapped
- Their x points left and their depth grows away from the viewer: x is negated, z is scaled.
- They draw a centre only if it is strictly inside; RasterJIT has the top-left rule. Both agree on
  these meshes: one centre lies on a lower edge of the two crossing triangles, three lie on the
  lower edge of the 5 x 5 image and one at its top, and the top-left rule leaves them out as well,
  since a lower edge owns nothing and a top vertex is on a right edge.
- They take a vertex as it is; RasterJIT puts it on a grid of 1/256 pixel, which moves a published
  depth by less than half such a step along its slope.
- They can blur the outline and so draw pixels beyond it, with extrapolated values. RasterJIT has
  no counterpart: only pixels inside are compared.
- They return several layers; the last one is what ``depth="reversed"`` shows.
"""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
import pytest
from drawn import covered, draw, exactly_covered, picture

from rasterjit.inspect import oracle

NEAR = 0.05

ROUNDED = 0.5e-4
"""Published depths are rounded to four decimals."""

OFF_GRID = 0.5 / 256
"""How far a vertex is moved to be on the grid, at most, pixels."""

HALF_ULP = 2.0**-24
"""Rounding of a float32 in 1/2..1 is at most half of 2**-24; the sum before it is in float64."""

PYRAMID = [(-0.5, 0, 0.5), (0.5, 0, 0.5), (0.5, 0, 1.5), (-0.5, 0, 1.5), (0, 1, 1)]
PYRAMID_FACES = [(2, 1, 0), (3, 2, 0), (1, 0, 4), (2, 4, 3), (3, 4, 0), (1, 4, 2)]
PYRAMID_FRONT = picture("""
    ..........
    ....22....
    ....22....
    ...2222...
    ...2222...
    ..........
    ..........
    ..........
    ..........
    ..........
""")

ONE = [(-0.3, -0.4, 0.1), (0.0, 0.6, 0.1), (0.9, -0.4, 0.1)]
ONE_PICTURE = picture("""
    ..........
    ..........
    ..........
    ....0.....
    ...000....
    ..0000....
    .00000....
    ..........
    ..........
    ..........
""")

TWO = [
    (-0.9, -0.2, 0.1), (0.0, 0.6, 0.1), (0.7, -0.4, 0.1),
    (-0.7, 0.4, 0.5), (0.0, -0.6, 0.5), (0.7, 0.4, 0.5),
]  # fmt: skip
TWO_FACES = [(1, 0, 2), (3, 4, 5)]
TWO_PICTURE = picture("""
    ..........
    ..........
    .....0....
    ..110001..
    ...00000..
    ...000000.
    ..0001....
    ..........
    ..........
    ..........
""")
TWO_BEHIND = picture("""
    ..........
    ..........
    ..........
    ....111...
    ...1111...
    ...1111...
    ....1.....
    ..........
    ..........
    ..........
""")

SLOPED = [(-0.4, -0.4, 10.0), (0.4, -0.4, 10.0), (0.0, 0.4, 20.0)]
SLOPED_PICTURE = picture("""
    ...........
    ...........
    ...........
    .....0.....
    .....0.....
    ....000....
    ....000....
    ...00000...
    ...........
    ...........
    ...........
""")
# Depths of the rows 2 to 8; those of 2 and 8 lie in the blur, but show the slope beside them.
SLOPED_ON_SCREEN = [21.8182, 19.5455, 17.2727, 15.0, 12.7273, 10.4545, 8.1818]
SLOPED_IN_SPACE = [24.4444, 19.1304, 15.7143, 13.3333, 11.5789, 10.2326, 9.1667]

BEHIND = [
    (-0.5, 0.0, -0.1), (0.0, 0.6, -0.1), (0.5, 0.0, -0.1),
    (-0.25, 0.0, -0.9), (0.25, 0.5, -0.9), (0.75, 0.0, -0.9),
    (-0.4, 0.0, -0.5), (0.6, 0.6, -0.5), (0.8, 0.0, -0.5),
    (-0.2, 0.0, -0.5), (0.3, 0.6, -0.5), (0.4, 0.0, -0.5),
]  # fmt: skip
MIXED = [
    (-0.3, 0.0, 0.1), (0.0, 0.6, 0.1), (0.8, 0.0, 0.1),
    (-0.25, 0.0, 0.9), (0.25, 0.5, 0.9), (0.75, 0.0, 0.9),
    (-0.4, 0.0, 0.5), (0.6, 0.6, 0.5), (0.8, 0.0, 0.5),
    (-0.2, 0.0, -0.5), (0.3, 0.6, -0.5), (0.4, 0.0, -0.5),
]  # fmt: skip
FOUR_FACES = [(1, 0, 2), (4, 3, 5), (7, 6, 8), (10, 9, 11)]


def on_screen(vertices, scale=1.0):
    """Return clip positions with w = 1 and depth z / scale."""
    x, y, z = np.array(vertices, float).T
    return np.column_stack([-x, y, z / scale, np.ones(len(x))])


def in_space(vertices, near=NEAR):
    """Return clip positions with w = z, for a near plane and none far; x and y stay as given."""
    x, y, z = np.array(vertices, float).T
    return np.column_stack([-x * z, y * z, z - 2 * near, z])


def assert_exact(positions, faces, size):
    """Assert that each face alone has exactly the pixels of the oracle."""
    for face in faces:
        assert (covered(positions, face, size) == exactly_covered(positions, face, size)).all()


# --- pictures -------------------------------------------------------------------------------------


def test_pyramid_shows_its_front_and_its_back_behind_it():
    positions = on_screen(PYRAMID, 4.0)
    assert (draw(positions, PYRAMID_FACES, (10, 10)).face_id == PYRAMID_FRONT).all()
    behind = draw(positions, PYRAMID_FACES, (10, 10), depth="reversed").face_id
    assert (behind == np.where(PYRAMID_FRONT == 2, 3, -1)).all()
    assert_exact(positions, PYRAMID_FACES, (10, 10))


def test_culling_takes_the_back_of_the_pyramid_and_leaves_its_front():
    positions = on_screen(PYRAMID, 4.0)
    # With backs culled there is no second layer: the farthest face is the front itself.
    for depth in ("standard", "reversed"):
        seen = draw(positions, PYRAMID_FACES, (10, 10), cull="back", depth=depth).face_id
        assert (seen == PYRAMID_FRONT).all()
    seen = draw(positions, PYRAMID_FACES, (10, 10), cull="front").face_id
    assert (seen == np.where(PYRAMID_FRONT == 2, 3, -1)).all()


def test_simple_triangle_has_its_13_pixels_and_its_depth():
    seen = draw(on_screen(ONE), [(1, 0, 2)], (10, 10))
    assert (seen.face_id == ONE_PICTURE).all()
    assert (ONE_PICTURE == 0).sum() == 13
    assert (seen.depth == np.where(ONE_PICTURE == 0, np.float32(0.1), np.float32(np.inf))).all()
    assert_exact(on_screen(ONE), [(1, 0, 2)], (10, 10))


def test_two_crossing_triangles_show_the_nearer_one():
    seen = draw(on_screen(TWO), TWO_FACES, (10, 10))
    assert (seen.face_id == TWO_PICTURE).all()
    depths = np.array([0.1, 0.5, np.inf], np.float32)[TWO_PICTURE]
    assert (seen.depth == depths).all()
    assert_exact(on_screen(TWO), TWO_FACES, (10, 10))


def test_second_layer_is_what_lies_behind():
    positions = on_screen(TWO)
    both = covered(positions, TWO_FACES[0], (10, 10)) & covered(positions, TWO_FACES[1], (10, 10))
    seen = draw(positions, TWO_FACES, (10, 10), depth="reversed")
    assert (np.where(both, seen.face_id, -1) == TWO_BEHIND).all()
    assert (seen.depth[both] == np.float32(0.5)).all()


# --- depth ----------------------------------------------------------------------------------------


def assert_row_depths(depth, published):
    """Assert that the rows 3 to 7 have published depths, given those of the rows 2 to 8."""
    for row, (above, here, below) in enumerate(
        zip(published, published[1:], published[2:], strict=False), start=3
    ):
        slope = max(abs(above - here), abs(here - below))
        inside = SLOPED_PICTURE[row] == 0
        assert (abs(depth[row, inside] - here) <= OFF_GRID * slope + ROUNDED).all()


def test_depth_without_perspective_is_linear_on_the_screen():
    # A scale that is a power of two leaves every bit of the depth.
    seen = draw(on_screen(SLOPED, 32.0), [(0, 1, 2)], (11, 11))
    assert (seen.face_id == SLOPED_PICTURE).all()
    assert_row_depths(seen.depth * 32.0, SLOPED_ON_SCREEN)


def test_depth_with_perspective_is_that_of_the_plane_in_space():
    positions = in_space(SLOPED)
    seen = draw(positions, [(0, 1, 2)], (11, 11))
    assert (seen.face_id == SLOPED_PICTURE).all()
    # From the weights of the vertices, as theirs is ...
    assert_row_depths(seen.barycentric @ np.array([10.0, 10.0, 20.0]), SLOPED_IN_SPACE)
    # ... and from the depth that is stored, z / w = 1 - 2 near / z.
    stored = 2 * NEAR / (1.0 - seen.depth.astype(float))
    inside = SLOPED_PICTURE == 0
    # One rounding to float32 of a number just below 1.
    slack = HALF_ULP / (2 * NEAR) * stored[inside] ** 2
    from_weights = (seen.barycentric @ np.array([10.0, 10.0, 20.0]))[inside]
    assert (abs(stored[inside] - from_weights) <= slack + 20 * HALF_ULP).all()


def test_weights_are_exact_with_and_without_perspective():
    points = [((1 - x) * 11 / 2, (1 - y) * 11 / 2) for x, y, _ in SLOPED]
    corners = [(Fraction(x, 256), Fraction(y, 256)) for x, y in oracle.snap_triangle(points)]
    for positions, ws in ((on_screen(SLOPED, 32.0), (1, 1, 1)), (in_space(SLOPED), (10, 10, 20))):
        have = draw(positions, [(0, 1, 2)], (11, 11)).barycentric
        for row, column in np.argwhere(SLOPED_PICTURE == 0).tolist():
            centre = column + Fraction(1, 2), row + Fraction(1, 2)
            want = [float(w) for w in oracle.perspective_weights(corners, ws, centre)]
            assert (abs(have[row, column] - want) <= HALF_ULP).all()


def test_the_centre_of_5_by_5_pixels_has_these_weights():
    seen = draw(on_screen(SLOPED, 32.0), [(0, 1, 2)], (5, 5))
    assert np.argwhere(seen.face_id == 0).tolist() == [[2, 2]]
    assert seen.barycentric[2, 2].tolist() == [0.25, 0.25, 0.5]
    # The four centres on the outline are not drawn, and have no weights.
    assert not seen.barycentric[seen.face_id < 0].any()


# --- faces ----------------------------------------------------------------------------------------


def test_nothing_behind_the_camera_is_drawn():
    seen = draw(in_space(BEHIND), FOUR_FACES, (16, 16))
    assert (seen.face_id == -1).all()
    assert np.isinf(seen.depth).all()


@pytest.mark.parametrize("order", list(itertools.permutations(range(4))))
def test_order_of_faces_does_not_matter(order):
    positions = in_space(MIXED)
    first = draw(positions, FOUR_FACES, (10, 10))
    assert set(np.unique(first.face_id)) == {-1, 0, 2}
    seen = draw(positions, [FOUR_FACES[n] for n in order], (10, 10))
    assert (np.where(seen.face_id < 0, -1, np.array(order)[seen.face_id]) == first.face_id).all()
    assert (seen.depth == first.depth).all()


def test_of_a_hundred_equal_faces_each_is_next_when_those_before_it_are_gone():
    positions = np.concatenate([on_screen(ONE)] * 100)
    faces = [(3 * n + 1, 3 * n, 3 * n + 2) for n in range(100)]
    numbers = [draw(positions, faces[n:], (10, 10)).face_id + n for n in range(100)]
    shown = np.stack(numbers)[:, ONE_PICTURE == 0]
    assert (shown == np.arange(100)[:, None]).all()
    # The farthest of them is a tie as well.
    assert (draw(positions, faces, (10, 10), depth="reversed").face_id == ONE_PICTURE).all()
