"""Hard cases R01 to R19: coverage and the fill rule."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from screen_triangles import counts, draw, dyadic, fan, owners, pixels, pixels_of

import rasterjit as rj
from rasterjit.inspect import oracle

SMALL = (16, 16)
R09 = [(2.3, 1.7), (9.1, 3.2), (4.4, 10.6)]


# --- quads and squares ----------------------------------------------------------------------------

DIAGONALS = {"R01": [[0, 1, 2], [0, 2, 3]], "R02": [[0, 1, 3], [1, 2, 3]]}


@pytest.mark.parametrize(
    ("faces", "each"),
    [
        pytest.param(DIAGONALS["R01"], [136, 120], marks=pytest.mark.case("R01")),
        pytest.param(DIAGONALS["R02"], [120, 136], marks=pytest.mark.case("R02")),
    ],
)
def test_quad_is_covered_once_along_either_diagonal(faces, each):
    seen = owners([(0, 0), (16, 0), (16, 16), (0, 16)], faces, SMALL)
    assert (seen >= 0).all()
    assert counts(seen, faces) == each


@pytest.mark.case("R03")
@pytest.mark.parametrize("faces", DIAGONALS.values())
def test_edges_through_centres_own_left_and_top(faces):
    seen = owners([(0.5, 0.5), (15.5, 0.5), (15.5, 15.5), (0.5, 15.5)], faces, SMALL)
    assert (seen[:15, :15] >= 0).all()
    assert (seen >= 0).sum() == 225


@pytest.mark.case("R04")
@pytest.mark.parametrize(("n", "half", "rest"), [
    (8, 28, 36), (10, 45, 55), (16, 120, 136), (100, 4950, 5050),
])  # fmt: skip
def test_half_of_a_square_and_its_complement(n, half, rest):
    faces = [[0, 1, 2], [1, 3, 2]]
    seen = owners([(0, 0), (n, 0), (0, n), (n, n)], faces, (128, 128))
    assert (seen[:n, :n] >= 0).all()
    assert counts(seen, faces) == [half, rest]


@pytest.mark.case("R05")
def test_square_between_centres_is_split_along_its_diagonal():
    assert pixels([(1.5, 1.5), (3.5, 1.5), (3.5, 3.5)], SMALL) == {(1, 1), (2, 1), (2, 2)}
    assert pixels([(1.5, 1.5), (3.5, 3.5), (1.5, 3.5)], SMALL) == {(1, 2)}


@pytest.mark.case("R16")
@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (2, 2), (255, 257)])
def test_full_screen_quad_covers_every_pixel_once(size):
    positions = [[-1, -1, 0, 1], [1, -1, 0, 1], [1, 1, 0, 1], [-1, 1, 0, 1]]
    total = sum(
        (rj.rasterize(positions, [face], size, threads=1).face_id == 0).astype(int)
        for face in DIAGONALS["R01"]
    )
    assert total.shape == size[::-1]
    assert (total == 1).all()


# --- fans -----------------------------------------------------------------------------------------


@pytest.mark.case("R06")
def test_fan_around_a_centre_is_covered_once():
    ring = [(0, 0), (4, -1), (9, 0), (10, 4), (9, 9), (5, 10), (0, 9), (-1, 5)]
    points, faces = fan((4.5, 4.5), ring, closed=True)
    seen = owners(points, faces, SMALL)
    assert counts(seen, faces) == [10, 10, 12, 17, 8, 17, 6, 10]
    assert (seen >= 0).sum() == 90
    assert seen[4, 4] == 3


@pytest.mark.case("R07")
def test_fan_with_every_edge_through_centres_is_covered_once():
    ring = [
        (8.5, 4.5), (8.5, 8.5), (4.5, 8.5), (0.5, 8.5), (0.5, 4.5), (0.5, 0.5), (4.5, 0.5),
        (8.5, 0.5),
    ]  # fmt: skip
    points, faces = fan((4.5, 4.5), ring, closed=True)
    seen = owners(points, faces, SMALL)
    assert counts(seen, faces) == [10, 6, 6, 10, 6, 10, 10, 6]
    assert (seen >= 0).sum() == 64
    assert (seen[:8, :8] >= 0).all()
    assert seen[4, 4] == 0


@pytest.mark.case("R08")
@pytest.mark.parametrize("b", [-1, 0, 1])
@pytest.mark.parametrize("a", [-1, 0, 1])
def test_four_tiny_triangles_share_one_centre(a, b):
    (x, y), reach = (0.5 + a / 16, 0.5 + b / 16), 3 / 16
    owned_by = [
        f"{above}-{beside}"
        for beside, dx in (("left", -reach), ("right", reach))
        for above, dy in (("top", -reach), ("bottom", reach))
        if pixels([(x, y), (x + dx, y), (x, y + dy)], (4, 4)) == {(0, 0)}
    ]
    assert owned_by == [f"{'top' if b == 1 else 'bottom'}-{'left' if a == 1 else 'right'}"]


@pytest.mark.case("R12")
def test_slivers_to_a_corner_are_covered_once():
    ring = [(64, 64 * k / 1000) for k in range(1001)]
    points, faces = fan((0, 0), ring, closed=False)
    seen = owners(points, faces, (64, 64))
    whole = pixels([(0, 0), (64, 0), (64, 64)], (64, 64))
    assert len(whole) == 2080
    assert pixels_of(seen >= 0, True) == whole
    assert sum(hits > 0 for hits in counts(seen, faces)) == 880


# --- one small triangle ---------------------------------------------------------------------------


@pytest.mark.case("R09")
def test_small_triangle_has_these_29_pixels():
    assert oracle.snap_triangle(R09) == ((589, 435), (2330, 819), (1126, 2714))
    spans = {2: (2, 5), 3: (3, 8), 4: (3, 7), 5: (3, 7), 6: (3, 6), 7: (4, 5), 8: (4, 5), 9: (4, 4)}
    expected = {(x, y) for y, (first, last) in spans.items() for x in range(first, last + 1)}
    assert len(expected) == 29
    assert pixels(R09, SMALL) == expected


@pytest.mark.case("R10")
@pytest.mark.parametrize(("shift", "count"), [((3, 2), 29), ((-3, -2), 28), ((5, 4), 29)])
def test_whole_pixel_translation_shifts_the_pixels(shift, count):
    shifted = {(x + shift[0], y + shift[1]) for x, y in pixels(R09, SMALL)}
    moved = pixels(np.array(R09) + shift, SMALL)
    assert moved == {(x, y) for x, y in shifted if 0 <= x < 16 and 0 <= y < 16}
    assert len(moved) == count


@pytest.mark.case("R11")
@pytest.mark.parametrize("spelling", [[1, 2, 0], [2, 0, 1], [2, 1, 0], [1, 0, 2], [0, 2, 1]])
def test_neither_rotation_nor_winding_changes_a_bit(spelling):
    positions = naive.clip_from_screen(dyadic(R09), SMALL, z=[0.1, -0.3, 0.7])
    one = rj.rasterize(positions, [[0, 1, 2]], SMALL, threads=1)
    other = rj.rasterize(positions, [spelling], SMALL, threads=1)
    assert (one.face_id == 0).sum() == 29
    assert len(np.unique(one.depth)) == 30  # a depth of its own for each pixel, and nothing
    assert other.face_id.tobytes() == one.face_id.tobytes()
    assert other.depth.tobytes() == one.depth.tobytes()


@pytest.mark.case("R15")
def test_triangle_within_one_pixel_draws_it_if_it_holds_the_centre():
    small = np.array([(4.25, 4.25), (4.875, 4.25), (4.25, 4.875)])
    assert pixels(small, SMALL) == {(4, 4)}
    assert pixels(small + 0.375, SMALL) == set()


# --- meshes ---------------------------------------------------------------------------------------


@pytest.mark.case("R13")
def test_triangles_smaller_than_a_pixel_cover_the_image_once():
    n = 64
    points = [(i / 4, j / 4) for j in range(n + 1) for i in range(n + 1)]
    corners = [j * (n + 1) + i for j in range(n) for i in range(n)]
    faces = []
    for a in corners:
        faces += [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
    assert len(faces) == 8192
    assert (owners(points, faces, SMALL) >= 0).all()


@pytest.mark.case("R14")
def test_jittered_grid_is_covered_once():
    def place(i, j):
        if not (0 < i < 16 and 0 < j < 16):
            return 4.0 * i, 4.0 * j
        dx = ((37 * i + 101 * j) % 257 - 128) / 256
        dy = ((91 * i + 53 * j) % 257 - 128) / 256
        return 4.0 * i + dx, 4.0 * j + dy

    points = [place(i, j) for j in range(17) for i in range(17)]
    faces = []
    for j in range(16):
        for i in range(16):
            a, b, c, d = j * 17 + i, j * 17 + i + 1, (j + 1) * 17 + i + 1, (j + 1) * 17 + i
            faces += [[a, b, c], [a, c, d]] if (i + j) % 2 else [[a, b, d], [b, c, d]]
    seen = owners(points, faces, (64, 64))
    assert (seen >= 0).sum() == 4096


A, B = (43.328125, 18.11328125), (14.5, 61.60546875)
M = (A[0] + 0.66 * (B[0] - A[0]), A[1] + 0.66 * (B[1] - A[1]))
RIGHT, LEFT = (60.0, 60.0), (2.0, 10.0)


@pytest.mark.case("R17")
@pytest.mark.parametrize(("whole_side", "split_side", "hits"), [(RIGHT, LEFT, 0), (LEFT, RIGHT, 2)])
def test_split_edge_misses_or_doubles_only_the_sliver_it_leaves(whole_side, split_side, hits):
    # A vertex on the edge of a neighbour is rounded off that edge: no rule can mend that.
    pieces = ([A, B, whole_side], [A, M, split_side], [M, B, split_side])
    drawn = [pixels(piece, (64, 64)) for piece in pieces]
    sliver = pixels([A, M, B], (64, 64))
    assert sliver == {(26, 43)}
    assert sum((26, 43) in found for found in drawn) == hits
    # The quadrilateral's outline is split nowhere, so its two halves along A B are its pixels.
    union = drawn[0] | pixels([A, B, split_side], (64, 64))
    others = [pixel for found in drawn for pixel in found if pixel not in sliver]
    assert len(others) == len(set(others))
    assert set(others) == union - sliver


@pytest.mark.case("R17")
def test_edge_split_on_the_grid_is_covered_once():
    a, b = (40.0, 8.0), (8.0, 40.0)
    middle = (24.25, 23.75)  # on the edge, and a grid point
    points = [a, b, RIGHT, LEFT, middle]
    split = owners(points, [[0, 1, 2], [0, 3, 4], [4, 3, 1]], (64, 64))
    whole = owners(points, [[0, 1, 2], [0, 3, 1]], (64, 64))
    assert ((split >= 0) == (whole >= 0)).all()
    assert ((split == 0) == (whole == 0)).all()


@pytest.mark.case("R18")
def test_edge_that_cracks_in_float32_is_owned_by_one_side():
    a, b = (427.8309326171875, 2344.186279296875), (1983.7698974609375, 195.29629990722656)
    p = (1826.5, 412.5)

    def naive_edge(a, b, p):
        (ax, ay), (bx, by), (px, py) = (np.array(point, np.float32) for point in (a, b, p))
        return (bx - ax) * (py - ay) - (by - ay) * (px - ax)

    assert naive_edge(a, b, p) == -0.25
    assert naive_edge(b, a, p) == -0.03125
    points, size = [a, b, (0, 0), (2048, 2048)], (2048, 512)
    one = draw(points, [[0, 1, 2]], size).face_id == 0
    other = draw(points, [[1, 0, 3]], size).face_id == 0
    assert not (one & other).any()
    assert int(one[412, 1826]) + int(other[412, 1826]) == 1
    for mask, third in ((one, points[2]), (other, points[3])):
        exact = oracle.covered_pixels(dyadic([a, b, third]), size, window=(1826, 412, 1827, 413))
        assert bool(mask[412, 1826]) == ((1826, 412) in exact)


# --- culling --------------------------------------------------------------------------------------

STEP = 1 / 256
"""Sub-pixel step, pixels."""

TURNED = [(0, 128.5625 * STEP), (100, 127.5625 * STEP), (50, 128.25 * STEP)]
"""Runs one way round on the screen, but the other way once it is on the grid of 8 bits."""


@pytest.mark.case("R19")
def test_culling_goes_by_the_snapped_turn():
    snapped = oracle.snap_triangle(TURNED)
    assert snapped == ((0, 129), (25600, 128), (12800, 128))
    assert oracle.edge(*snapped) < 0 < oracle.edge(*map(tuple, dyadic(TURNED)))
    # Negative on a screen with y down is counter-clockwise: a front face.
    kept = draw(TURNED, [[0, 1, 2]], (128, 128), cull="back")
    dropped = draw(TURNED, [[0, 1, 2]], (128, 128), cull="front")
    assert pixels_of(kept.face_id) == {(x, 0) for x in range(50, 100)}
    assert pixels_of(kept.face_id) == pixels(TURNED, (128, 128))
    assert (kept.totals.culled, dropped.totals.culled) == (0, 1)
    assert (dropped.face_id == -1).all()


@pytest.mark.case("R19")
def test_culling_on_a_finer_grid_goes_by_that_grid():
    # 12 bits hold the vertices as they are.
    assert len(pixels(TURNED, (128, 128), bits=12)) == 12
    kept = draw(TURNED, [[0, 1, 2]], (128, 128), bits=12, cull="front")
    dropped = draw(TURNED, [[0, 1, 2]], (128, 128), bits=12, cull="back")
    assert (kept.face_id == 0).sum() == 12
    assert dropped.totals.culled == 1


@pytest.mark.case("R19")
@pytest.mark.parametrize("points", [
    [(10, 10), (20, 10 + 0.25 * STEP), (30, 10)],
    [(10 + 0.49 * STEP, 10), (10, 40), (10 - 0.49 * STEP, 20 + 0.49 * STEP)],
])  # fmt: skip
@pytest.mark.parametrize("cull", ["none", "back", "front"])
def test_face_that_snaps_to_nothing_is_no_front_face(points, cull):
    assert oracle.edge(*map(tuple, dyadic(points))) != 0
    assert oracle.edge(*oracle.snap_triangle(dyadic(points))) == 0
    for face in ([0, 1, 2], [0, 2, 1]):
        seen = draw(points, [face], (64, 64), cull=cull)
        assert (seen.face_id == -1).all()
        assert (seen.totals.degenerate, seen.totals.drawn) == (1, 0)
