"""Coverage by exact arithmetic, depth by the exact plane, and one result whatever the order."""

from __future__ import annotations

from fractions import Fraction

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit import oracle

SCREEN = (128, 128)
R09 = [(2.3, 1.7), (9.1, 3.2), (4.4, 10.6)]


def dyadic(points, bits=14):
    """Round points to 2**-bits pixel, so that they reach the kernels exactly."""
    return np.round(np.asarray(points, float) * 2**bits) / 2**bits


def draw(points, faces, size=SCREEN, bits=8, z=0.0, w=1.0, **options):
    """Rasterize faces of screen points."""
    positions = naive.clip_from_screen(dyadic(points), size, z, w)
    quality = rj.Quality(subpixel_bits=bits)
    return rj.rasterize(positions, faces, size, quality=quality, threads=1, **options)


def pixels(points, size=SCREEN, bits=8):
    """Return the pixels (column, row) that one triangle covers."""
    rows, columns = np.nonzero(draw(points, [[0, 1, 2]], size, bits).face_id == 0)
    return set(zip(columns.tolist(), rows.tolist(), strict=True))


def counts(points, faces, size):
    """Draw each triangle alone; return how often each pixel was hit, and hits by triangle."""
    positions = naive.clip_from_screen(dyadic(points), size)
    total, each = np.zeros((size[1], size[0]), int), []
    for face in faces:
        hit = rj.rasterize(positions, [face], size, threads=1).face_id == 0
        total += hit
        each.append(int(hit.sum()))
    return total, each


def fan(hub, ring, closed=True):
    """Return points and faces of a fan around a hub."""
    faces = [[0, n, n % len(ring) + 1] for n in range(1, len(ring) + (1 if closed else 0))]
    return [hub, *ring], faces


# --- coverage against the exact oracle ------------------------------------------------------------


def random_triangles(kind, rng):
    """Yield seeded screen triangles of one kind, in a 128 x 128 image."""
    if kind == "tiny":
        for _ in range(150):
            yield rng.uniform(0, 128, 2) + rng.uniform(-1.2, 1.2, (3, 2))
    elif kind == "around eight pixels":
        # The number of pixels in the box decides which of two ways rows are filled.
        for width in (6, 7, 8, 9, 10):
            for _ in range(25):
                corner = rng.uniform(-4, 124, 2)
                box = rng.uniform(0, 1, (3, 2)) * [width, rng.uniform(2, 30)]
                box[0, 0], box[1, 0] = 0.0, width
                yield corner + box
    elif kind == "half-pixel corners":
        # Edges and corners that pass through centres, where the fill rule decides.
        for _ in range(150):
            yield rng.integers(-4, 40, (3, 2)) / 2.0
    elif kind == "across tiles":
        for _ in range(30):
            yield rng.uniform(40, 90, (3, 2))
    elif kind == "huge":
        for _ in range(10):
            angles = rng.uniform(0, 7) + np.arange(3) * 2.1 + rng.uniform(-0.9, 0.9, 3)
            reach = 10.0 ** rng.uniform(1.7, 3.9, 3)
            yield 64 + np.stack([reach * np.cos(angles), reach * np.sin(angles)], axis=1)
    elif kind == "sliver":
        for _ in range(60):
            a, b = rng.uniform(-10, 138, (2, 2))
            yield [a, b, (a + b) / 2 + rng.uniform(-0.3, 0.3, 2)]


@pytest.mark.parametrize("bits", [0, 4, 8, 12])
@pytest.mark.parametrize(
    "kind", ["tiny", "around eight pixels", "half-pixel corners", "across tiles", "huge", "sliver"]
)
def test_coverage_is_exact(kind, bits):
    rng = np.random.default_rng(100 + bits)
    drawn = 0
    for triangle in random_triangles(kind, rng):
        points = dyadic(triangle)
        have = pixels(points, bits=bits)
        assert have == oracle.covered_pixels(points, SCREEN, subpixel_bits=bits), points
        drawn += len(have)
    assert drawn > 0


coordinate = st.integers(-40 * 256, 168 * 256).map(lambda n: n / 256)
point = st.tuples(coordinate, coordinate)


@settings(max_examples=60, derandomize=True, deadline=None, database=None)
@given(point, point, point)
def test_triangle_covers_what_the_oracle_says(a, b, c):
    assert pixels([a, b, c]) == oracle.covered_pixels([a, b, c], SCREEN)


@settings(max_examples=40, derandomize=True, deadline=None, database=None)
@given(point, point, point, point)
def test_shared_edge_is_drawn_once(a, b, c, d):
    # c and d on different sides of the edge a b.
    p, q, r, s = [(oracle.snap(x), oracle.snap(y)) for x, y in (a, b, c, d)]
    if oracle.edge(p, q, r) > 0:
        c, d, r, s = d, c, s, r
    if not oracle.edge(p, q, r) < 0 < oracle.edge(p, q, s):
        return
    one, other = pixels([a, b, c]), pixels([b, a, d])
    assert not one & other
    assert pixels([c, d, a]) | pixels([c, d, b]) >= set()
    on_edge = {
        (i, j)
        for i, j in oracle.covered_pixels([a, b, c], SCREEN)
        | oracle.covered_pixels([b, a, d], SCREEN)
        if oracle.edge(p, q, naive.centre(i, j)) == 0
    }
    assert on_edge <= one | other


def test_coverage_of_a_small_triangle_can_be_seen():
    drawn = draw(R09, [[0, 1, 2]], (16, 16)).face_id + 1
    picture = ["".join(".#"[value] for value in row) for row in drawn[:11, :11]]
    assert picture == [
        "...........",
        "...........",
        "..####.....",
        "...######..",
        "...#####...",
        "...#####...",
        "...####....",
        "....##.....",
        "....##.....",
        "....#......",
        "...........",
    ]


# --- the catalogue (hard_cases.md, B1) ------------------------------------------------------------


@pytest.mark.parametrize(
    ("faces", "each"),
    [([[0, 1, 2], [0, 2, 3]], [136, 120]), ([[0, 1, 3], [1, 2, 3]], [120, 136])],
)
def test_quad_is_covered_once_along_either_diagonal(faces, each):
    total, drawn = counts([(0, 0), (16, 0), (16, 16), (0, 16)], faces, (16, 16))
    assert (total == 1).all()
    assert drawn == each


@pytest.mark.parametrize("faces", [[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]])
def test_edges_through_centres_own_left_and_top(faces):
    total, _ = counts([(0.5, 0.5), (15.5, 0.5), (15.5, 15.5), (0.5, 15.5)], faces, (16, 16))
    assert (total[:15, :15] == 1).all()
    assert total.sum() == 225


@pytest.mark.parametrize("n", [8, 10, 16, 100])
def test_half_of_a_square_and_its_complement(n):
    points = [(0, 0), (n, 0), (0, n), (n, n)]
    total, each = counts(points, [[0, 1, 2], [1, 3, 2]], SCREEN)
    assert each == [n * (n - 1) // 2, n * (n + 1) // 2]
    assert (total[:n, :n] == 1).all()


def test_two_by_two_square_between_centres():
    assert pixels([(1.5, 1.5), (3.5, 1.5), (3.5, 3.5)]) == {(1, 1), (2, 1), (2, 2)}
    assert pixels([(1.5, 1.5), (3.5, 3.5), (1.5, 3.5)]) == {(1, 2)}


def test_fan_around_a_centre_is_covered_once():
    ring = [(0, 0), (4, -1), (9, 0), (10, 4), (9, 9), (5, 10), (0, 9), (-1, 5)]
    points, faces = fan((4.5, 4.5), ring)
    total, each = counts(points, faces, (16, 16))
    assert total.max() == 1
    assert total.sum() == 90
    assert each == [10, 10, 12, 17, 8, 17, 6, 10]
    assert (4, 4) in pixels([points[k] for k in faces[3]], (16, 16))


def test_fan_with_every_edge_through_centres_is_covered_once():
    ring = [
        (8.5, 4.5), (8.5, 8.5), (4.5, 8.5), (0.5, 8.5), (0.5, 4.5), (0.5, 0.5), (4.5, 0.5),
        (8.5, 0.5),
    ]  # fmt: skip
    points, faces = fan((4.5, 4.5), ring)
    total, each = counts(points, faces, (16, 16))
    assert (total[:8, :8] == 1).all()
    assert total.sum() == 64
    assert each == [10, 6, 6, 10, 6, 10, 10, 6]
    assert (4, 4) in pixels([points[k] for k in faces[0]], (16, 16))


@pytest.mark.parametrize("b", [-1, 0, 1])
@pytest.mark.parametrize("a", [-1, 0, 1])
def test_four_tiny_triangles_share_one_centre(a, b):
    middle, reach = (0.5 + a / 16, 0.5 + b / 16), 3 / 16
    owners = []
    for beside, x in (("left", -reach), ("right", reach)):
        for above, y in (("top", -reach), ("bottom", reach)):
            corners = [middle, (middle[0] + x, middle[1]), (middle[0], middle[1] + y)]
            if pixels(corners, (4, 4)):
                owners.append(f"{above}-{beside}")
    vertical = "top" if b == 1 else "bottom"
    assert owners == [f"{vertical}-{'left' if a == 1 else 'right'}"]


@pytest.mark.parametrize(("shift", "count"), [((3, 2), 29), ((-3, -2), 28), ((5, 4), 29)])
def test_whole_pixel_translation_shifts_the_pixels(shift, count):
    original = pixels(R09, (16, 16))
    assert len(original) == 29
    moved = pixels(np.array(R09) + shift, (16, 16))
    shifted = {(i + shift[0], j + shift[1]) for i, j in original}
    assert moved == {(i, j) for i, j in shifted if 0 <= i < 16 and 0 <= j < 16}
    assert len(moved) == count


def test_slivers_to_a_corner_are_covered_once():
    ring = [(64, 64 * k / 1000) for k in range(1001)]
    points, faces = fan((0, 0), ring, closed=False)
    total, each = counts(points, faces, (64, 64))
    whole = draw([(0, 0), (64, 0), (64, 64)], [[0, 1, 2]], (64, 64)).face_id == 0
    assert total.tolist() == whole.astype(int).tolist()
    assert total.sum() == 2080
    assert sum(hits > 0 for hits in each) == 880


def test_triangles_smaller_than_a_pixel_cover_the_image_once():
    # 8192 of them. Drawn together they must cover all; the number drawn bounds the overlap.
    n = 64
    grid = [(i / 4, j / 4) for j in range(n + 1) for i in range(n + 1)]
    faces = []
    for j in range(n):
        for i in range(n):
            a = j * (n + 1) + i
            faces += [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
    seen = draw(grid, faces, (16, 16))
    assert (seen.face_id >= 0).all()
    # Each pixel is owned by one face: taking those away leaves nothing.
    kept = np.setdiff1d(np.arange(len(faces)), seen.face_id)
    rest = draw(grid, np.array(faces)[kept], (16, 16))
    assert (rest.face_id == -1).all()


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
    total, _ = counts(points, faces, (64, 64))
    assert (total == 1).all()


@pytest.mark.parametrize("seed", range(3))
def test_random_fan_is_covered_once(seed):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 24))
    far = 100 / np.maximum(abs(np.cos(angles)), abs(np.sin(angles)))
    hub = dyadic(rng.uniform(20, 44, 2), 8)
    ring = [hub + [r * np.cos(t), r * np.sin(t)] for r, t in zip(far, angles, strict=True)]
    points, faces = fan(hub, ring)
    total, _ = counts(points, faces, (64, 64))
    assert (total == 1).all()


def test_triangle_within_one_pixel_draws_it_if_it_holds_the_centre():
    small = np.array([(4.25, 4.25), (4.875, 4.25), (4.25, 4.875)])
    assert pixels(small) == {(4, 4)}
    assert pixels(small + 0.375) == set()


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (2, 2), (255, 257)])
def test_full_screen_quad_covers_every_pixel_once(size):
    positions = [[-1, -1, 0, 1], [1, -1, 0, 1], [1, 1, 0, 1], [-1, 1, 0, 1]]
    total = sum(
        (rj.rasterize(positions, [face], size, threads=1).face_id == 0).astype(int)
        for face in ([0, 1, 2], [0, 2, 3])
    )
    assert (total == 1).all()


def test_split_edge_on_the_grid_is_covered_once():
    a, b, c, d = (43.328125, 18.11328125), (14.5, 61.60546875), (60, 60), (2, 10)
    m = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
    assert Fraction(m[0]) * 512 % 1 == 0
    # Only if the middle is itself a grid point is it on the snapped edge.
    if all(Fraction(v) * 256 % 1 == 0 for v in m):
        total, _ = counts([a, b, c, d, m], [[0, 1, 2], [0, 4, 3], [4, 1, 3]], (64, 64))
        assert total.max() == 1
    whole = [(40.0, 8.0), (8.0, 40.0), (60, 60), (2, 2), (24.0, 24.0)]
    total, _ = counts(whole, [[0, 1, 2], [0, 3, 4], [4, 3, 1]], (64, 64))
    union = draw(whole, [[0, 1, 2], [0, 3, 1]], (64, 64)).face_id >= 0
    assert total.tolist() == union.astype(int).tolist()


def test_edge_aimed_at_a_centre_is_owned_by_one_side():
    # Unsnapped float32 edge functions are negative from both sides here: a hole.
    a, b = (427.8309326171875, 2344.186279296875), (1983.7698974609375, 195.29629990722656)
    p = (1826, 412)
    size = (2048, 512)
    one = draw([a, b, (0, 0)], [[0, 1, 2]], size).face_id == 0
    other = draw([a, b, (2048, 2048)], [[0, 1, 2]], size).face_id == 0
    assert int(one[p[1], p[0]]) + int(other[p[1], p[0]]) == 1
    assert not (one & other).any()


# --- depth ----------------------------------------------------------------------------------------


def test_depth_is_within_two_ulp_of_the_exact_plane():
    rng = np.random.default_rng(21)
    for _ in range(40):
        middle = rng.uniform(10, 118, 2)
        reach = rng.choice([3.0, 8.0, 40.0, 400.0])
        points = dyadic(middle + rng.uniform(-reach, reach, (3, 2)))
        depths = rng.uniform(0.1, 0.9, 3)
        seen = draw(points, [[0, 1, 2]], z=depths)
        corners = oracle.snap_triangle(points)
        if abs(oracle.edge(*corners)) < (reach * 256) ** 2 / 20:
            continue
        low, high = np.float32(depths.min()), np.float32(depths.max())
        for row, column in np.argwhere(seen.face_id == 0)[::7]:
            exact = oracle.depth_at(corners, depths.tolist(), naive.centre(int(column), int(row)))
            have = seen.depth[row, column]
            assert abs(Fraction(float(have)) - exact) <= 2 * Fraction(float(np.spacing(have)))
            assert low <= have <= high


def test_depth_never_leaves_the_range_of_the_vertices():
    rng = np.random.default_rng(22)
    for _ in range(150):
        a, b = rng.uniform(-20, 148, (2, 2))
        points = [a, b, (a + b) / 2 + rng.uniform(-0.4, 0.4, 2)]
        depths = rng.uniform(-1, 1, 3)
        seen = draw(points, [[0, 1, 2]], z=depths)
        drawn = seen.depth[seen.face_id == 0]
        assert (drawn >= np.float32(depths.min())).all()
        assert (drawn <= np.float32(depths.max())).all()


def test_rounding_does_not_step_over_the_depth_of_a_vertex():
    # At a vertex on a pixel's centre with depth 0 the least rounding error has the wrong sign.
    rng = np.random.default_rng(28)
    owned = 0
    for _ in range(800):
        reach = rng.choice([7, 60])
        points = rng.integers(0, reach, (3, 2)) + 0.5
        points = points[np.lexsort((points[:, 0], points[:, 1]))]  # the top vertex owns its centre
        sign = rng.choice([-1.0, 1.0])
        depths = np.append(0.0, sign * rng.uniform(0.1, 0.9, 2))
        seen = draw(points, [[0, 1, 2]], z=depths)
        drawn = seen.depth[seen.face_id == 0]
        assert (sign * drawn >= 0.0).all()
        column, row = (points[0] - 0.5).astype(int)
        owned += seen.face_id[row, column] == 0
    assert owned > 50


@pytest.mark.parametrize("reach", [4, 60, 700])
def test_rotation_and_winding_change_no_bit(reach):
    rng = np.random.default_rng(23)
    for _ in range(15):
        points = rng.uniform(64 - reach, 64 + reach, (3, 2))
        depths = rng.uniform(0.1, 0.9, 3)
        spellings = ([0, 1, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0], [1, 0, 2], [0, 2, 1])
        drawn = [draw(points, [spelling], z=depths) for spelling in spellings]
        for other in drawn[1:]:
            assert other.face_id.tobytes() == drawn[0].face_id.tobytes()
            assert other.depth.tobytes() == drawn[0].depth.tobytes()


def test_moving_the_vertices_to_other_numbers_changes_no_bit():
    rng = np.random.default_rng(24)
    points, depths = rng.uniform(0, 128, (3, 2)), rng.uniform(0.1, 0.9, 3)
    order = [2, 0, 1]
    one = draw(points, [[0, 1, 2]], z=depths)
    other = draw(points[order], [[0, 1, 2]], z=depths[order])
    assert one.depth.tobytes() == other.depth.tobytes()


def test_same_triangle_again_has_the_same_depth():
    rng = np.random.default_rng(25)
    points, depths = rng.uniform(-30, 160, (3, 2)), rng.uniform(0.1, 0.9, 3)
    once = draw(points, [[0, 1, 2]], z=depths)
    twice = draw(points, [[0, 1, 2], [2, 0, 1], [0, 2, 1]], z=depths)
    assert set(np.unique(twice.face_id)) <= {-1, 0}
    assert once.depth.tobytes() == twice.depth.tobytes()


def test_coplanar_quads_along_other_diagonals_tie_to_the_lower_face():
    square = [(3, 3), (120, 5), (118, 121), (4, 119)]
    faces = [[0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3]]
    seen = draw(square, faces, z=0.1)
    assert set(np.unique(seen.face_id)) == {-1, 0, 1}
    assert (seen.depth[seen.face_id >= 0] == np.float32(0.1)).all()


@pytest.mark.parametrize(
    "points", [R09, [(-50, -80), (300, 7), (20, 400)], [(1, 1), (120, 2), (5, 1.7)]]
)
def test_equal_depths_stay_exactly_equal(points):
    seen = draw(points, [[0, 1, 2]], z=0.1)
    drawn = seen.depth[seen.face_id == 0]
    assert len(drawn)
    assert (drawn == np.float32(0.1)).all()


def test_slivers_have_the_depth_of_their_plane():
    ring = [(64, 64 * k / 1000) for k in range(1001)]
    points, faces = fan((0, 0), ring, closed=False)
    z = np.ones(1002)
    z[0] = 0.0
    seen = draw(points, faces, (64, 64), z=z)
    rows, columns = np.nonzero(seen.face_id >= 0)
    drawn = seen.depth[rows, columns].astype(float)
    assert len(drawn) == 2080
    assert ((drawn >= 0.0) & (drawn <= 1.0)).all()
    assert np.abs(drawn - (columns + 0.5) / 64).max() <= 2**-20


def soup(rng, count, reach):
    """Return points and depths of random triangles in the image."""
    middles = np.repeat(rng.uniform(0, 128, (count, 2)), 3, axis=0)
    points = dyadic(middles + rng.uniform(-reach, reach, (3 * count, 2)))
    return points, np.round(rng.uniform(0.1, 0.9, 3 * count) * 2**20) / 2**20


@pytest.mark.parametrize("bits", [0, 4, 8, 12])
def test_nearest_face_is_seen(bits):
    rng = np.random.default_rng(26)
    size = (64, 64)
    points, depths = soup(rng, 60, 12)
    points = points / 2
    # Some faces lie at one depth, so that there are exact ties.
    depths[: 3 * 20] = np.repeat(rng.choice([0.25, 0.5], 20), 3)
    faces = np.arange(180).reshape(-1, 3)
    seen = draw(points, faces, size, bits, z=depths)
    triangles = [dyadic(points[face]).tolist() for face in faces]
    expected = oracle.visible_faces(triangles, depths[faces].tolist(), size, subpixel_bits=bits)
    have = {(int(i), int(j)): int(seen.face_id[j, i]) for j, i in np.argwhere(seen.face_id >= 0)}
    assert have == {pixel: face for pixel, (face, _) in expected.items()}


def test_larger_depth_wins_when_reversed():
    points = [(0, 0), (64, 0), (0, 64)] * 2
    z = [0.25] * 3 + [0.5] * 3
    faces = [[0, 1, 2], [3, 4, 5]]
    standard = draw(points, faces, (64, 64), z=z)
    reverse = draw(points, faces, (64, 64), z=z, depth="reversed")
    assert standard.face_id.max() == 0
    assert set(np.unique(reverse.face_id)) == {-1, 1}
    assert np.isinf(standard.depth[standard.face_id == -1]).all()
    assert np.isinf(reverse.depth[reverse.face_id == -1]).all()
    assert (reverse.depth[reverse.face_id == 1] == 0.5).all()


def test_order_of_distinct_depths_does_not_matter():
    rng = np.random.default_rng(27)
    points, depths = soup(rng, 40, 30)
    faces = np.arange(120).reshape(-1, 3)
    first = draw(points, faces, z=depths)
    order = rng.permutation(40)
    second = draw(points, faces[order], z=depths)
    # Where two depths are one float32, either face may be the lower.
    renamed = np.where(second.face_id >= 0, order[second.face_id], -1)
    assert first.depth.tobytes() == second.depth.tobytes()
    assert (renamed != first.face_id).mean() < 1e-3
