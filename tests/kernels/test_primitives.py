import itertools
import math

import naive_lines as naive
import numpy as np
import pytest

from rasterjit.classics import primitives
from rasterjit.inspect import oracle
from rasterjit.runtime import jit

JIT = not jit.DISABLED
METHODS = (primitives.fill_triangle, primitives.fill_triangle_scanline)
BIAS = {"top-left": primitives.EXCLUSIVE_BIAS, "inclusive": primitives.INCLUSIVE_BIAS}
WHITE = ((255,) * 4,) * 3
LIMIT = primitives.MAX_COORDINATE


def target(size):
    image = np.zeros((size[1], size[0], 4), np.uint8)
    return image, image.view(np.uint32).reshape(size[1], size[0])


def packed(colors):
    return tuple(np.array(colors, np.uint8).view("<u4")[:, 0].tolist())


def fill(vertices, size, colors=WHITE, edges="top-left", method=METHODS[0], depth=None, z=None):
    image, pixels = target(size)
    z = [math.nan] * 3 if z is None else map(float, z)
    corners = zip(np.array(vertices).tolist(), packed(colors), z, strict=True)
    method(
        pixels,
        np.empty((0, 0), np.float32) if depth is None else depth,
        tuple((*place, pixel, own) for place, pixel, own in corners),
        BIAS[edges],
    )
    return image


def covered(vertices, size, **options):
    return {(int(x), int(y)) for y, x in np.argwhere(fill(vertices, size, **options).any(axis=2))}


def count_fan(center, ring, size, **options):
    """Count how often each pixel is covered by the triangles of a closed fan."""
    count = np.zeros((size[1], size[0]), int)
    for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
        count += fill((center, a, b), size, **options).any(axis=2)
    return count


def random_triangles(seed, count, low=-6, high=18):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield rng.integers(low, high, (3, 2)).tolist(), rng.integers(0, 256, (3, 4)).tolist()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("edges", BIAS)
def test_pixels_and_colors_are_the_exact_ones(method, edges):
    size = (13, 11)
    drawn = 0
    for vertices, colors in random_triangles(1, 150 if JIT else 25):
        expected = np.zeros((11, 13, 4), np.uint8)
        found = naive.triangle_pixels(vertices, colors, size, edges)
        for (x, y), color in found.items():
            expected[y, x] = color
        image = fill(vertices, size, colors, edges, method)
        np.testing.assert_array_equal(image, expected, err_msg=f"{vertices} {colors}")
        drawn += len(found)
    assert drawn > 300


def test_scanline_gives_the_same_bits_as_barycentric():
    size = (40, 30)
    rng = np.random.default_rng(2)
    for reach in (20, 60, 3000, LIMIT):
        for _ in range(200 if JIT else 10):
            vertices = np.clip(rng.integers(-reach, reach + 1, (3, 2)), -LIMIT, LIMIT).tolist()
            colors, z = rng.integers(0, 256, (3, 4)).tolist(), rng.uniform(0, 1, 3)
            for edges in BIAS:
                stores = [np.full((30, 40), 0.5, np.float32) for _ in METHODS]
                images = [
                    fill(vertices, size, colors, edges, method, depth, z)
                    for method, depth in zip(METHODS, stores, strict=True)
                ]
                np.testing.assert_array_equal(*images)
                np.testing.assert_array_equal(*stores)


@pytest.mark.parametrize("method", METHODS)
def test_largest_coordinates_are_exact(method):
    colors = [(0, 255, 7, 255), (255, 0, 250, 3), (128, 77, 1, 254)]
    far = LIMIT
    for vertices in (
        [(-far, -far), (far, -far), (far, far)],
        [(-far, -far), (far, far), (-far, far)],
        [(-far, -far + 1), (far, far), (far - 1, far)],
        [(-far, 3), (far, 4), (5, 4)],
        [(0, -far), (7, far), (3, -5)],
    ):
        image = fill(vertices, (9, 8), colors, "inclusive", method)
        expected = np.zeros((8, 9, 4), np.uint8)
        for (x, y), color in naive.triangle_pixels(vertices, colors, (9, 8), "inclusive").items():
            expected[y, x] = color
        np.testing.assert_array_equal(image, expected, err_msg=str(vertices))


@pytest.mark.parametrize("method", METHODS)
def test_two_halves_of_a_square_cover_it_once(method):
    a, b, c, d = (0, 0), (16, 0), (16, 16), (0, 16)
    first, second = (covered(t, (20, 20), method=method) for t in ((a, b, c), (a, c, d)))
    assert (len(first), len(second), len(first & second)) == (136, 120, 0)
    assert first | second == {(x, y) for x in range(16) for y in range(16)}
    first, second = (covered(t, (20, 20), method=method) for t in ((a, b, d), (b, c, d)))
    assert (len(first), len(second), len(first & second)) == (136, 120, 0)
    assert first | second == {(x, y) for x in range(16) for y in range(16)}


@pytest.mark.parametrize("n", [8, 10, 16, 100])
def test_right_triangle_has_its_top_and_left_sides(n):
    corner = covered(((0, 0), (n, 0), (0, n)), (n + 2, n + 2))
    other = covered(((n, 0), (n, n), (0, n)), (n + 2, n + 2))
    assert corner == {(x, y) for x in range(n) for y in range(n) if x + y < n}
    assert other == {(x, y) for x in range(n) for y in range(n) if x + y >= n}


def test_small_square_by_hand():
    assert covered(((1, 1), (3, 1), (3, 3)), (5, 5)) == {(1, 1), (2, 1), (2, 2)}
    assert covered(((1, 1), (3, 3), (1, 3)), (5, 5)) == {(1, 2)}
    assert covered(((1, 1), (3, 3), (1, 3)), (5, 5), edges="inclusive") == {
        (1, 1),
        (1, 2),
        (2, 2),
        (1, 3),
        (2, 3),
        (3, 3),
    }


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "ring",
    [
        [(0, 0), (4, -1), (9, 0), (10, 4), (9, 9), (5, 10), (0, 9), (-1, 5)],
        [(8, 4), (8, 8), (4, 8), (0, 8), (0, 4), (0, 0), (4, 0), (8, 0)],
        [(11, 3), (6, 12), (-4, 9), (-2, -5)],
    ],
)
def test_fan_around_a_pixel_covers_every_pixel_once(ring, method):
    center, size = (4, 4), (12, 12)
    count = count_fan(center, ring, size, method=method)
    assert count.max() == 1
    assert count[4, 4] == 1
    inside = count_fan(center, ring, size, edges="inclusive", method=method)
    assert not count[inside == 0].any()
    # Every pixel strictly inside the ring is covered
    for y, x in np.argwhere(inside > 0):
        sides = zip(ring, ring[1:] + ring[:1], strict=True)
        if all(oracle.edge(a, b, (x, y)) > 0 for a, b in sides):
            assert count[y, x] == 1


def test_order_and_winding_of_the_vertices_change_no_bit():
    rng = np.random.default_rng(3)
    for vertices, colors in random_triangles(4, 60 if JIT else 8):
        z = rng.uniform(-1, 1, 3)
        results = []
        for order in itertools.permutations(range(3)):
            depth = np.full((11, 13), 0.1, np.float32)
            image = fill(
                [vertices[i] for i in order],
                (13, 11),
                [colors[i] for i in order],
                depth=depth,
                z=[z[i] for i in order],
            )
            results.append(image.tobytes() + depth.tobytes())
        assert len(set(results)) == 1


def test_moved_triangle_is_the_same_triangle_moved():
    vertices = np.array([(2, 1), (9, 3), (4, 10)])
    here = covered(vertices, (16, 16))
    for move in ((3, 2), (-3, -2), (5, 4), (-9, 0)):
        moved = {(x + move[0], y + move[1]) for x, y in here}
        wanted = {(x, y) for x, y in moved if 0 <= x < 16 and 0 <= y < 16}
        assert covered(vertices + move, (16, 16)) == wanted


@pytest.mark.parametrize("method", METHODS)
def test_inclusive_adds_exactly_the_pixels_on_edges(method):
    for vertices, _ in random_triangles(5, 60 if JIT else 10):
        own = covered(vertices, (13, 11), method=method)
        all_pixels = covered(vertices, (13, 11), edges="inclusive", method=method)
        assert own <= all_pixels
        for pixel in all_pixels - own:
            assert min(oracle.affine_weights(vertices, pixel)) == 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("edges", BIAS)
@pytest.mark.parametrize(
    "vertices",
    [[(3, 3)] * 3, [(0, 0), (5, 5), (9, 9)], [(1, 2), (1, 2), (7, 2)], [(4, 0), (4, 9), (4, 3)]],
)
def test_triangle_without_area_draws_nothing(vertices, edges, method):
    assert not covered(vertices, (12, 12), edges=edges, method=method)


@pytest.mark.parametrize("method", METHODS)
def test_equal_colors_stay_exactly_equal(method):
    for vertices, colors in random_triangles(6, 40 if JIT else 8):
        image = fill(vertices, (13, 11), [colors[0]] * 3, "inclusive", method)
        found = {tuple(p) for p in image.reshape(-1, 4).tolist()} - {(0,) * 4}
        assert found <= {tuple(colors[0])}


def test_vertices_have_their_own_color_under_the_inclusive_rule():
    vertices, colors = [(1, 1), (9, 2), (4, 8)], [(1, 2, 3, 4), (250, 6, 7, 8), (9, 200, 255, 0)]
    image = fill(vertices, (12, 12), colors, "inclusive")
    for (x, y), color in zip(vertices, colors, strict=True):
        assert image[y, x].tolist() == list(color)


# Depth


@pytest.mark.parametrize("method", METHODS)
def test_nearer_triangle_hides_whichever_comes_first(method):
    near, far = [(0, 0), (9, 1), (2, 8)], [(0, 5), (9, 0), (8, 9)]
    results = []
    for order in ((0, 1), (1, 0)):
        image = np.zeros((10, 10, 4), np.uint8)
        depth = np.full((10, 10), np.inf, np.float32)
        for i in order:
            z = ((0.1, 0.2, 0.3), (0.4, 0.9, 0.8))[i]
            colors = [(i + 1,) * 4] * 3
            own = fill((near, far)[i], (10, 10), colors, method=method, depth=depth, z=z)
            image = np.where(own > 0, own, image)
        results.append(image.tobytes() + depth.tobytes())
        assert {1, 2} == set(image[image > 0].tolist())
    assert results[0] == results[1]


@pytest.mark.parametrize("method", METHODS)
def test_depth_is_affine_over_the_triangle(method):
    vertices, z = [(0, 0), (16, 0), (0, 16)], (1.0, 3.0, 2.0)
    depth = np.full((17, 17), np.inf, np.float32)
    image = fill(vertices, (17, 17), edges="inclusive", method=method, depth=depth, z=z)
    y, x = np.nonzero(image.any(axis=2))
    np.testing.assert_array_equal(depth[y, x], (1 + x * (2 / 16) + y * (1 / 16)).astype(np.float32))
    assert np.isinf(depth[~image.any(axis=2)]).all()


@pytest.mark.parametrize("method", METHODS)
def test_equal_depth_keeps_what_is_there(method):
    depth = np.full((8, 8), 0.5, np.float32)
    assert not fill([(0, 0), (8, 0), (0, 8)], (8, 8), method=method, depth=depth, z=[0.5] * 3).any()


# Circles


def circle(center, radius, size):
    image, pixels = target(size)
    primitives.draw_circle(pixels, *center, radius, 0xFFFFFFFF)
    return {(int(x), int(y)) for y, x in np.argwhere(image.any(axis=2))}


@pytest.mark.parametrize("radius", [*range(41), 100, 255] if JIT else range(12))
def test_circle_is_the_nearest_pixels(radius):
    side = 2 * radius + 3
    center = (radius + 1, radius + 1)
    assert circle(center, radius, (side, side)) == naive.circle_pixels(center, radius)


def test_circle_by_hand():
    assert circle((2, 2), 0, (5, 5)) == {(2, 2)}
    assert circle((2, 2), 1, (5, 5)) == {(1, 2), (3, 2), (2, 1), (2, 3)}
    assert circle((2, 2), 2, (5, 5)) == {
        (1, 0),
        (2, 0),
        (3, 0),
        (0, 1),
        (4, 1),
        (0, 2),
        (4, 2),
        (0, 3),
        (4, 3),
        (1, 4),
        (2, 4),
        (3, 4),
    }


@pytest.mark.parametrize("center", [(0, 0), (-3, 4), (15, 15), (40, 40), (8, -20)])
def test_clipped_circle_is_the_whole_circle_inside(center):
    for radius in range(0, 45 if JIT else 12, 3):
        whole = naive.circle_pixels(center, radius)
        inside = {(x, y) for x, y in whole if 0 <= x < 16 and 0 <= y < 16}
        assert circle(center, radius, (16, 16)) == inside


def test_circle_writes_each_pixel_once(monkeypatch):
    writes = []

    def record(_, center_x, center_y, x, y, pixel):
        writes.extend([(x, y), (-y, x), (-x, -y), (y, -x)])

    monkeypatch.setattr(primitives, "put_rotations", record)
    plain_python = getattr(primitives.draw_circle, "function", primitives.draw_circle)
    for radius in range(1, 60):
        writes.clear()
        plain_python(np.zeros((1, 1), np.uint32), 0, 0, radius, 1)
        assert len(writes) == len(set(writes))
        assert set(writes) == naive.circle_pixels((0, 0), radius)


# Bezier curves

CURVES = [
    [(1, 1), (10, 25), (28, 3)],
    [(2, 28), (2, 2), (28, 2), (28, 28)],
    [(0, 0), (60, 31), (-30, 31), (31, 0)],
    [(3, 3), (9, 9), (15, 15), (29, 29)],
    [(-10, 5), (15.25, 40.5), (20, -30), (45, 12)],
]


def bezier(points, size, colors=((255,) * 4,) * 2):
    image, pixels = target(size)
    primitives.draw_bezier(pixels, np.array(points, np.float64), packed(colors))
    return image


SPECIAL = [
    [(0, 0), (20, 20), (0, 20), (20, 0)],  # a cusp
    [(0, 0), (30, 20), (-10, 20), (20, 0)],  # a loop
    [(20, 2), (2, 2), (20, 2)],  # out and back
    [(14, 2), (2, 14), (14, 2)],
    [(3.25, 9), (28, 9.5), (3.25, 10)],  # a sharp turn
    [(2, 8), (30, 8), (1, 9.25), (29, 9.25)],
    [(0, 0.5), (9, 9.5), (3, 3.5), (20, 20.5)],  # beside the diagonal, between pixels
    [(1, 1), (1, 1), (1, 1), (9, 5)],
    [(4.5, 4.5), (4.5, 9.5), (9.5, 4.5)],
    [(5.2, 5.1), (6.8, 6.9), (5.1, 6.7), (6.9, 5.4)],  # within two pixels
    [(5, 5), (5 + 5e-324, 5), (5, 5)],
    [(-5e-324, 3), (0, 3), (5e-324, 3), (8, 3)],
    [(3, 3), (3.0000001, 3), (3, 3.0000001), (9, 9)],
    [(-900, 4), (1000, 7), (-800, 9), (950, 22)],
    [(-70, -60), (95, 88), (14, 3)],
    [(LIMIT, LIMIT), (0, 0), (-LIMIT, -LIMIT)],
    [(-LIMIT, 12), (LIMIT, 13), (-LIMIT, 14), (LIMIT, 15)],
    [(-LIMIT, -LIMIT), (LIMIT, LIMIT), (LIMIT, -LIMIT), (-LIMIT, LIMIT)],
]
"""Curves of one place, curves that come back, and curves that are very long."""

SMALL = [
    [(4.98990162446429, 2.517265873430474), (3.8303341258837627, 1.0801302570774476),
     (4.132596239536611, 4.044357923962259), (1.7156854295023045, 5.132182610719001)],
    [(1.9946236598702376, 1.4231327580997872), (1.173376374587358, 2.48812011165619),
     (1.3297059486072322, 1.01080515565073)],
]  # fmt: skip
"""Curves that turn between two columns or rows, with places a pixel from those around."""

RAMP = ((0, 255, 9, 255), (255, 3, 250, 0))

SEEN = math.sqrt(0.5) + 2 * primitives.TIE_PX
"""How far a pixel's centre may be from its curve: half a diagonal."""


def random_curves(seed, count):
    """Yield curves of all sizes to 400 pixels, some on whole or on half pixels or in a line."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        points = rng.uniform(0, rng.choice([3, 12, 40, 40, 150, 400]), (rng.integers(3, 5), 2))
        if number % 3 == 1:
            points = np.round(points * 2) / 2 if number % 2 else np.round(points)
        if number % 12 == 2:
            points = np.outer(points[:, 0], rng.integers(-2, 3, 2)) + rng.integers(0, 4, 2) / 2
        yield np.ascontiguousarray(points - np.floor(points.min(axis=0)) + 1)


def size_around(points):
    return tuple((np.ceil(np.max(points, axis=0)) + 3).astype(int).tolist())


def segments_of(points):
    """Count the chords, by the formula that the kernel's notes name."""
    points = np.array(points, np.float64)
    second = np.hypot(*np.diff(points, 2, axis=0).T).max()
    degree = len(points) - 1
    return max(1, math.ceil(math.sqrt(degree * (degree - 1) * second / primitives.FLATNESS_PX / 8)))


def powers(points):
    """Return the factors of t**3, t**2, t and 1 of a curve, (4, 2)."""
    p = np.array(points, np.float64)
    if len(p) == 3:
        return np.array([[0, 0], p[0] - 2 * p[1] + p[2], 2 * (p[1] - p[0]), p[0]])
    return np.array([p[3] - p[0] + 3 * (p[1] - p[2]), 3 * (p[0] - 2 * p[1] + p[2]),
                     3 * (p[1] - p[0]), p[0]])  # fmt: skip


def places(points, t):
    """Return the places (..., 2) of a curve at t (...)."""
    cubic, square, linear, start = powers(points)
    t = np.asarray(t)[..., None]
    return ((cubic * t + square) * t + linear) * t + start


def distances(points, pixels):
    """
    Return how far pixels (N, 2) are from a curve: where a derivative is zero, or at an end.

    Every place of the curve bounds its distance from above, however well the roots are found.
    """
    rows = powers(points)[None] - np.eye(4)[3][:, None] * np.array(pixels, float)[:, None]
    # Half the derivative of the squared distance has degree 5
    slopes = rows[:, :3] * np.array([3.0, 2, 1])[:, None]
    quintic = np.zeros((len(rows), 6))
    for i, j in itertools.product(range(4), range(3)):
        quintic[:, i + j] += (rows[:, i] * slopes[:, j]).sum(axis=1)
    # Where the leading factor vanishes a root lies at infinity: move it there
    companion = np.zeros((len(rows), 5, 5))
    companion[:, 1:, :4] = np.eye(4)
    lead = quintic[:, :1]
    lead = np.where(np.abs(lead) > 1e-9, lead, 1e-9)
    companion[:, 0] = -quintic[:, 1:] / lead
    t = np.clip(np.linalg.eigvals(companion).real, 0, 1)
    t = np.concatenate([t, np.zeros_like(lead), np.ones_like(lead)], axis=1)
    nearest = np.full(len(rows), np.inf)
    for _ in range(3):
        off = places(points, t) - np.array(pixels, float)[:, None]
        nearest = np.minimum(nearest, np.hypot(off[..., 0], off[..., 1]).min(axis=1))
        value, change = np.zeros_like(t), np.zeros_like(t)
        for factor in quintic.T:
            change = change * t + value
            value = value * t + factor[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.clip(np.nan_to_num(t - value / change), 0, 1)
    return nearest


@pytest.mark.parametrize("points", CURVES + SPECIAL[:15])
def test_curve_is_the_exact_path(points):
    expected = np.zeros((32, 32, 4), np.uint8)
    naive.draw_bezier(expected, points, segments_of(points), *RAMP)
    np.testing.assert_array_equal(bezier(points, (32, 32), RAMP), expected)


def test_many_curves_are_the_exact_paths():
    curves = [points for points in random_curves(7, 400 if JIT else 40) if points.max() < 99]
    assert len(curves) > (200 if JIT else 20)
    for points in curves:
        width, height = size_around(points)
        expected = np.zeros((height, width, 4), np.uint8)
        naive.draw_bezier(expected, points.tolist(), segments_of(points), *RAMP)
        image = bezier(points, (width, height), RAMP)
        np.testing.assert_array_equal(image, expected, err_msg=str(points.tolist()))


def test_every_pixel_is_near_the_curve_and_the_curve_near_pixels():
    furthest = 0.0
    for points in [*map(np.array, SMALL), *random_curves(8, 500 if JIT else 30)]:
        size = size_around(points)
        image = bezier(points, size).any(axis=2)
        pixels = np.argwhere(image)[:, ::-1]
        furthest = max(furthest, distances(points, pixels).max())
        # A sample lies at most a thirtieth of a pixel from any place of the curve
        length = np.hypot(*np.diff(points, axis=0).T).max() * 3
        along = places(points, np.linspace(0, 1, math.ceil(16 * length) + 2))
        nearest = np.full(len(along), np.inf)
        cell = np.floor(along + 0.5).astype(int)
        for i, j in itertools.product((-1, 0, 1), repeat=2):
            x, y = cell[:, 0] + i, cell[:, 1] + j
            gap = np.hypot(along[:, 0] - x, along[:, 1] - y)
            nearest = np.where(image[y, x], np.minimum(nearest, gap), nearest)
        assert nearest.max() < 0.96, points.tolist()
    assert 0.55 < furthest <= SEEN


@pytest.mark.parametrize("points", SPECIAL)
def test_every_pixel_of_a_special_curve_is_near_it(points):
    image = bezier(points, (32, 32))
    pixels = np.argwhere(image.any(axis=2))[:, ::-1]
    if len(pixels):
        assert distances(points, pixels).max() <= SEEN
    assert len(pixels) or max(map(max, points)) == LIMIT


def test_path_has_no_gap_and_comes_back_only_with_the_curve():
    returns = 0
    for points in [*random_curves(9, 150 if JIT else 20), *map(np.array, CURVES + SPECIAL[:13])]:
        if np.abs(points).max() > 99:
            continue
        visits = naive.BezierPath(points.tolist(), segments_of(points)).visits
        pixels = np.array([pixel for pixel, _ in visits])
        steps = np.abs(np.diff(pixels, axis=0)).max(axis=1)
        assert (steps == 1).all(), points.tolist()
        # At each visit the curve is in the pixel or beside it
        t = np.array([float(t) for _, t in visits])
        off = places(points, t) - pixels
        assert np.hypot(*off.T).max() <= math.sqrt(0.5) + primitives.FLATNESS_PX
        assert (np.diff(t) > 0).all()
        returns += len(pixels) - len(np.unique(pixels, axis=0))
    assert returns > 20


def test_curve_that_goes_one_way_visits_no_pixel_twice():
    for points in random_curves(10, 100 if JIT else 15):
        control = np.sort(points, axis=0)
        if control.max() > 99:
            continue
        control[:, 1] = control[::-1, 1] if points[0, 0] < points[0, 1] else control[:, 1]
        path = naive.BezierPath(control.tolist(), segments_of(control))
        pixels = [pixel for pixel, _ in path.visits]
        assert len(pixels) == len(set(pixels)), control.tolist()


def test_evenly_spaced_points_draw_the_line_of_their_ends():
    rng = np.random.default_rng(11)
    for _ in range(200 if JIT else 20):
        start, step = rng.integers(-40, 70, 2), rng.integers(-30, 31, 2)
        for count in (3, 4):
            points = [start + k * step for k in range(count)]
            expected = set(oracle.line_pixels(tuple(points[0]), tuple(points[-1])))
            drawn = np.argwhere(bezier(points, (32, 32)).any(axis=2))[:, ::-1]
            inside = {(x, y) for x, y in expected if 0 <= x < 32 and 0 <= y < 32}
            assert set(map(tuple, drawn.tolist())) == inside


def test_part_of_a_curve_that_is_seen_is_that_of_the_whole():
    for points in random_curves(12, 100 if JIT else 15):
        width, height = size_around(points)
        whole = bezier(points, (width, height), RAMP)
        move = np.array([width // 3, height // 4])
        # To move by whole pixels may round a place differently, and so its colour by one
        part = bezier(points - move, (width // 2, height // 2), RAMP).astype(int)
        same = whole[move[1] : move[1] + height // 2, move[0] : move[0] + width // 2]
        np.testing.assert_array_equal(part.any(axis=2), same.any(axis=2), str(points.tolist()))
        assert np.abs(part - same).max(initial=0) <= 1


def test_longest_curves_take_few_chords():
    far = float(LIMIT)
    points = np.array([(-far, -far), (far, far), (-far, -far), (far, far)])
    assert 5000 < primitives.count_segments(points) == segments_of(points) < 6000


@pytest.mark.parametrize("points", CURVES)
def test_chords_stay_within_the_bound(points):
    control = np.array(points, np.float64)
    segments = primitives.count_segments(control)
    degree = len(points) - 1

    def at(t):
        weights = [math.comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in range(degree + 1)]
        return sum(w * p for w, p in zip(weights, control, strict=True))

    for k in range(segments):
        a, b = at(k / segments), at((k + 1) / segments)
        for s in np.linspace(0, 1, 9):
            off = at((k + s) / segments) - (a + s * (b - a))
            assert np.hypot(*off) <= primitives.FLATNESS_PX + 1e-9


def test_curve_has_exact_end_colors_and_one_piece():
    colors = ((1, 2, 3, 4), (250, 251, 252, 253))
    image = bezier(CURVES[1], (32, 32), colors)
    assert image[28, 2].tolist() == list(colors[0])
    assert image[28, 28].tolist() == list(colors[1])
    left = {(int(x), int(y)) for y, x in np.argwhere(image.any(axis=2))}
    reached = [(2, 28)]
    while reached:
        x, y = reached.pop()
        near = {(x + i, y + j) for i in (-1, 0, 1) for j in (-1, 0, 1)} & left
        left -= near
        reached += near
    assert not left


def test_straight_control_points_draw_the_line():
    image = bezier([(1, 1), (8, 8), (15, 15)], (20, 20))
    assert {(x, y) for y, x in np.argwhere(image.any(axis=2)).tolist()} == {
        (k, k) for k in range(1, 16)
    }


def test_curve_of_one_point_is_one_pixel_of_the_end_color():
    image = bezier([(4, 5)] * 4, (9, 9), ((1,) * 4, (2,) * 4))
    assert np.argwhere(image.any(axis=2)).tolist() == [[5, 4]]
    assert image[5, 4].tolist() == [2] * 4
