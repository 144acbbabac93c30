"""
Re-creation of datashader's check that shared edges of triangles are drawn once.

Source: holoviz/datashader, ``datashader/tests/test_pandas.py``, the function
``test_trimesh_no_double_edge`` and ``test_trimesh_interp`` (read in two stored revisions; the
numbers are those of the one that samples pixel centres, the other moves vertices to pixels first).

What it checks: two triangles that share an edge, with the values 1 and 2 (3 and 1), aggregated on
20 x 20 (22 x 22) pixels must leave a given array; the shared edge runs through pixel centres. A
triangle over the whole width must have a given picture, and so must values between its vertices,
cut down to whole numbers.

What differs: datashader's y points up, and a centre on an edge belongs to the triangle on its left
(x) where RasterJIT's rule gives it to the one on its right. So the mirror image of the published
array must be matched to the pixel; the unmirrored one but for the centres on an edge, which are
listed. In the second pair no edge meets a centre after rounding, so both agree.
"""

from __future__ import annotations

import numpy as np
import pytest
from drawn import covered, draw, exactly_covered, flat, picture

SLANTED = [(4, 4), (1, 5), (5, 5), (5, 4)]
SLANTED_FACES = [(0, 1, 2), (2, 3, 0)]
SLANTED_PICTURE = picture("""
    ......00000000000000
    .........00000000001
    ............00000011
    ...............00111
""")

LEVEL = [(3, 4), (3, 1), (1, 4), (3, 5)]
LEVEL_FACES = [(0, 1, 2), (2, 3, 0)]
LEVEL_PICTURE = picture("""
    ......1...............
    ....111...............
    ..00000...............
    ...0000...............
    ....000...............
    ....000...............
    .....00...............
    ......0...............
    ......0...............
""")

TENT_PICTURE = picture("""
    ..........
    ....00....
    ....00....
    ...0000...
    ...0000...
    ..000000..
    ..000000..
    .00000000.
    .00000000.
    0000000000
""")


TENT_VALUES = picture("""
    ..........
    ....44....
    ....44....
    ...3344...
    ...3333...
    ..233333..
    ..222333..
    .22222333.
    .11222223.
    1111222223
""")
"""What lies between 1 at the left corner, 5 at the top and 3 at the right."""


def positions_of(points, side, mirror=False):
    """Return clip positions of points whose range is 0 to ``side`` in x and y, y up."""
    ndc = 2 * np.asarray(points, float) / side - 1
    return flat(ndc * (-1 if mirror else 1, 1))


def image(points, faces, side, size, mirror=False):
    """Return the face of each pixel, no pixel being drawn by two of them."""
    positions = positions_of(points, side, mirror)
    masks = [covered(positions, face, size) for face in faces]
    for face, mask in zip(faces, masks, strict=True):
        assert (mask == exactly_covered(positions, face, size)).all()
    assert np.sum(masks, axis=0).max() == 1
    return draw(positions, faces, size).face_id


def on_top(rows, size, first=0):
    """Return a picture whose rows from the first on are given, empty elsewhere."""
    whole = np.full((size[1], size[0]), -1)
    whole[first : first + len(rows)] = rows
    return whole


def test_shared_slanted_edge_is_drawn_once_as_published():
    seen = image(SLANTED, SLANTED_FACES, 5, (20, 20), mirror=True)
    assert (seen == on_top(SLANTED_PICTURE[:, ::-1], (20, 20))).all()


def test_unmirrored_only_centres_on_an_edge_change_their_owner():
    seen = image(SLANTED, SLANTED_FACES, 5, (20, 20))
    want = on_top(SLANTED_PICTURE, (20, 20))
    # The left edge is ours, and the shared one is the left edge of the triangle on its right.
    for row in range(4):
        want[row, 5 + 3 * row] = 0
        want[row, 19 - row] = 1
    assert (seen == want).all()


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 1, 0), (0, 2, 1)])
def test_winding_does_not_show(order):
    faces = [tuple(face[n] for n in order) for face in SLANTED_FACES]
    seen = image(SLANTED, faces, 5, (20, 20), mirror=True)
    assert (seen == on_top(SLANTED_PICTURE[:, ::-1], (20, 20))).all()


def test_shared_level_edge_is_drawn_once():
    seen = image(LEVEL, LEVEL_FACES, 10, (22, 22))
    assert (seen == on_top(LEVEL_PICTURE, (22, 22), 11)).all()


def test_triangle_over_the_whole_width_is_the_published_one():
    seen = image([(0, 0), (5, 10), (10, 0)], [(0, 1, 2)], 10, (10, 10))
    assert (seen == TENT_PICTURE).all()


def test_values_between_the_vertices_are_the_published_ones():
    positions = positions_of([(0, 0), (5, 10), (10, 0)], 10)
    seen = draw(positions, [(0, 1, 2)], (10, 10))
    values = np.floor(seen.barycentric @ np.array([1.0, 5.0, 3.0]))
    # No exact value is nearer than 1/20 to a whole number, so rounding cannot show.
    assert (np.where(seen.face_id == 0, values, -1) == TENT_VALUES).all()
