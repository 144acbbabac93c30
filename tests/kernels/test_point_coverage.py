"""Points cover the pixels that slow, exact rules say, nearest first, for any number of threads."""

from __future__ import annotations

from fractions import Fraction
from math import ceil

import numpy as np
import pytest

from rasterjit.pipeline.visibility import point_pass as drawing
from rasterjit.pipeline.visibility import point_rasterizer, tile_rasterizer
from rasterjit.pipeline.visibility.visibility_pass import Region, make_viewport
from rasterjit.runtime.threads import Workers
from rasterjit.scene.transforms import perspective, translate

WIDTH, HEIGHT = SIZE = 29, 23
COEFFICIENTS = (0.0, -0.5, 0.5)
FLAT = np.eye(4)
"""Clip positions are model positions: NDC, and sizes in units are of the picture's half height."""


def rows_of(shape, sizes, unit=point_rasterizer.IN_PIXELS, count=None, scale=1.0):
    """Return the record of one object of points."""
    sizes = np.atleast_1d(np.array(sizes, float))
    count = len(sizes) if count is None else count
    starts = np.array([0, count])
    return point_rasterizer.PointRows(
        starts, starts.copy(), np.array([[shape, unit]]), np.array([[0, int(len(sizes) > 1)]]),
        sizes, np.array([scale]),
    )  # fmt: skip


def cloud_of(positions, points, matrix=FLAT, viewport=None, kind=np.float64):
    """Return a cloud whose positions are relative to the eye."""
    viewport = make_viewport(SIZE, 8) if viewport is None else viewport
    count = len(points.scales)
    return drawing.DrawnPoints(
        np.ascontiguousarray(positions, kind), np.tile(np.eye(4), (count, 1, 1)), points,
        drawing.make_point_view(matrix, COEFFICIENTS, viewport), COEFFICIENTS,
    )  # fmt: skip


def draw(cloud, viewport=None, kind=np.float32, threads=1):
    """Return depth, face numbers, and what became of the points."""
    viewport = make_viewport(SIZE, 8) if viewport is None else viewport
    shape = viewport.height, viewport.width
    frame = (
        np.full(shape, tile_rasterizer.get_empty_depth(kind), kind),
        np.full(shape, -1, np.int32),
    )
    workers = Workers(threads)
    counts = drawing.draw_all_points(cloud, viewport, frame, workers)
    workers.close()
    return *frame, counts.tolist()


def at(places):
    """Return model positions of places in pixels and depths in NDC, (N, 3)."""
    x, y, z = np.array(places, float).T
    return np.stack([2.0 * x / WIDTH - 1.0, 1.0 - 2.0 * y / HEIGHT, z], axis=1)


def exact_pixels(shape, x, y, size):
    """Return the pixels of a square or a disc, by the rule, in rational numbers of pixels."""
    half, found = size / 2, set()
    for row in range(HEIGHT):
        for column in range(WIDTH):
            across, down = column + Fraction(1, 2) - x, row + Fraction(1, 2) - y
            if shape == point_rasterizer.SQUARE:
                is_in = -half <= across < half and -half <= down < half
            else:
                is_in = across * across + down * down <= half * half
            if is_in:
                found.add((column, row))
    alone = ceil(x) - 1, ceil(y) - 1
    middle = [place + Fraction(1, 2) - own for place, own in zip(alone, (x, y), strict=True)]
    is_missed = middle[0] ** 2 + middle[1] ** 2 > half * half
    if shape == point_rasterizer.DISC and size >= 1 and is_missed:
        found = {alone} if 0 <= alone[0] < WIDTH and 0 <= alone[1] < HEIGHT else set()
    return found


def snapped(value, bits=8):
    """Return a number of pixels on the sub-pixel grid, rounded half to even."""
    return Fraction(round(Fraction(value) * 2**bits), 2**bits)


@pytest.mark.parametrize("shape", [point_rasterizer.SQUARE, point_rasterizer.DISC])
def test_pixels_are_those_of_the_exact_rule(shape):
    rng = np.random.default_rng(3)
    for n in range(120):
        x, y = rng.uniform(-6.0, WIDTH + 6.0), rng.uniform(-6.0, HEIGHT + 6.0)
        size = float(rng.choice([0.3, 1.0, 1.2, rng.uniform(0.0, 3.0), rng.uniform(0.0, 20.0)]))
        if n % 3 == 0:
            x, y, size = round(2 * x) / 2, round(2 * y) / 2, max(round(size), 1)
        depth, faces, counts = draw(cloud_of(at([(x, y, 0.5)]), rows_of(shape, size)))
        # The way to NDC and back may round at a tie: ask where the kernel has it.
        seen = {(int(c), int(r)) for r, c in np.argwhere(faces == 0)}
        exact = exact_pixels(shape, snapped(x), snapped(y), snapped(size))
        assert seen == exact, (x, y, size)
        assert np.isfinite(depth).sum() == len(exact)
        is_drawn = counts[point_rasterizer.POINTS_DRAWN] == 1
        assert is_drawn == bool(exact)
        assert sum(counts) == 1


def test_squares_of_a_pixel_have_a_way_of_their_own():
    rng = np.random.default_rng(5)
    places = np.column_stack(
        [rng.uniform(-2, WIDTH + 2, 700), rng.uniform(-2, HEIGHT + 2, 700), rng.uniform(-1, 1, 700)]
    )
    one = draw(cloud_of(at(places), rows_of(point_rasterizer.SQUARE, 1.0, count=700)))
    each = draw(cloud_of(at(places), rows_of(point_rasterizer.SQUARE, np.ones(700))))
    np.testing.assert_array_equal(one[0], each[0])
    np.testing.assert_array_equal(one[1], each[1])
    assert one[2] == each[2]
    # The nearest in each pixel, the first of equals.
    expected = np.full((HEIGHT, WIDTH), -1)
    best = np.full((HEIGHT, WIDTH), -np.inf)
    for n, (x, y, z) in enumerate(places):
        column, row = ceil(snapped(x)) - 1, ceil(snapped(y)) - 1
        if 0 <= column < WIDTH and 0 <= row < HEIGHT:
            depth = np.float32((COEFFICIENTS[1] * z + COEFFICIENTS[2]) / 1.0)
            if depth > best[row, column]:
                best[row, column], expected[row, column] = depth, n
    np.testing.assert_array_equal(one[1], expected)


def test_squares_side_by_side_share_no_pixel():
    columns, rows = np.meshgrid(np.arange(7), np.arange(5))
    places = [
        (3.25 + 2.5 * c, 4.75 + 2.5 * r, 0.0) for c, r in zip(columns.flat, rows.flat, strict=True)
    ]
    _, faces, _ = draw(cloud_of(at(places), rows_of(point_rasterizer.SQUARE, 2.5, count=35)))
    own = [
        exact_pixels(point_rasterizer.SQUARE, *map(Fraction, place[:2]), Fraction(5, 2))
        for place in places
    ]
    assert sum(map(len, own)) == len(set().union(*own)) == (faces >= 0).sum()


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int32])
def test_equal_depths_go_to_the_lower_number(kind):
    places = [(5.5, 5.5, 0.25), (5.5, 5.5, 0.25), (5.5, 5.5, 0.5), (9.5, 5.5, 0.5), (9.5, 5.5, 0.0)]
    cloud = cloud_of(at(places), rows_of(point_rasterizer.SQUARE, 1.0, count=5))
    cloud = cloud._replace(depth_coefficients=(0.0, -500.0, 1000.0))
    _, faces, _ = draw(cloud, kind=kind)
    assert faces[5, 5] == 0
    assert faces[5, 9] == 4


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_invalid_points_and_those_out_of_view_are_counted(precision):
    places = at([(5, 5, 0), (5, 5, -1.5), (5, 5, 1.5), (900, 5, 0), (1e9, 5, 0), (7, 7, 0)])
    places[0] = np.nan
    for sizes in (1.0, np.ones(6)):
        points = rows_of(point_rasterizer.SQUARE, sizes, count=6)
        _, faces, counts = draw(cloud_of(places, points, kind=precision))
        assert counts == [4, 0, 1, 1]
        assert set(np.unique(faces)) == {-1, 5}


def test_parts_of_a_picture_have_the_pixels_of_the_whole():
    rng = np.random.default_rng(8)
    count = 60
    matrix = perspective(60.0, WIDTH / HEIGHT, 0.5, 20.0) @ translate((0.0, 0.0, -4.0))
    for shape, unit, size in (
        (point_rasterizer.SQUARE, point_rasterizer.IN_PIXELS, rng.uniform(0.5, 6.0, count)),
        (point_rasterizer.DISC, point_rasterizer.IN_UNITS, rng.uniform(0.05, 0.8, count)),
        (point_rasterizer.SPHERE, point_rasterizer.IN_UNITS, rng.uniform(0.05, 1.5, count)),
    ):
        cloud = cloud_of(rng.uniform(-2, 2, (count, 3)), rows_of(shape, size, unit), matrix)
        depth, faces, _ = draw(cloud)
        assert (faces >= 0).sum() > 50
        for region in (Region(0, 0, 11, 9), Region(11, 5, 18, 18), Region(28, 22, 1, 1)):
            viewport = make_viewport(SIZE, 8, region)
            part = cloud._replace(view=drawing.make_point_view(matrix, COEFFICIENTS, viewport))
            some = draw(part, viewport)
            rows = slice(region.top, region.top + region.height)
            columns = slice(region.left, region.left + region.width)
            np.testing.assert_array_equal(some[0], depth[rows, columns])
            np.testing.assert_array_equal(some[1], faces[rows, columns])


def test_threads_change_no_bit(monkeypatch):
    monkeypatch.setattr(drawing, "MIN_POINTS_PER_THREAD", 10)
    rng = np.random.default_rng(9)
    for shape, size in (
        (point_rasterizer.SQUARE, 1.0),
        (point_rasterizer.DISC, rng.uniform(0.5, 8.0, 1500)),
    ):
        places = np.column_stack([rng.uniform(0, WIDTH, 1500), rng.uniform(0, HEIGHT, 1500),
                                  rng.integers(-3, 3, 1500) / 4.0])  # fmt: skip
        cloud = cloud_of(at(places), rows_of(shape, size, count=1500))
        one = draw(cloud)
        for threads in (2, 3, 7):
            several = draw(cloud, threads=threads)
            np.testing.assert_array_equal(several[0], one[0])
            np.testing.assert_array_equal(several[1], one[1])
            assert several[2] == one[2]


def sphere_twin(centre, radius, matrix, column, row):
    """
    Return the NDC z at which a line of sight meets a sphere in view, or None; in long doubles.

    The line goes through two points that the inverse matrix finds; the nearer root in front of
    the near plane counts.
    """
    inverse = np.linalg.inv(matrix)
    x, y = 2.0 * (column + 0.5) / WIDTH - 1.0, 1.0 - 2.0 * (row + 0.5) / HEIGHT
    ends = [inverse @ np.array([x, y, z, 1.0]) for z in (-1.0, 0.5)]
    first, second = (np.longdouble(end[:3]) / np.longdouble(end[3]) for end in ends)
    way = second - first
    way = way / np.sqrt((way * way).sum())
    to = first - np.longdouble(centre)
    b = (to * way).sum()
    left = b * b - ((to * to).sum() - np.longdouble(radius) ** 2)
    if left < 0:
        return None, left
    for root in (-b - np.sqrt(left), -b + np.sqrt(left)):
        if root >= 0.0:
            clip = np.longdouble(matrix) @ np.append(first + root * way, 1.0)
            depth = clip[2] / clip[3]
            return (depth if depth <= 1.0 else None), left
    return None, left


@pytest.mark.parametrize("name", ["perspective", "parallel", "shifted"])
def test_spheres_are_where_lines_of_sight_meet_them(name):
    matrix = perspective(70.0, WIDTH / HEIGHT, 0.5, 20.0)
    if name == "shifted":
        matrix[0] += 0.3 * matrix[3]
        matrix[1] -= 0.2 * matrix[3]
    if name == "parallel":
        matrix = np.diag([0.5, 0.5, -0.1, 1.0])
        matrix[2, 3] = -0.9
    rng = np.random.default_rng(11)
    seen = 0
    for n in range(24):
        centre = rng.uniform((-3, -3, -9), (3, 3, 1.0))
        radius = rng.uniform(0.2, 2.5)
        if n == 0:
            centre, radius = np.zeros(3), 3.0
        points = rows_of(point_rasterizer.SPHERE, 2.0 * radius, point_rasterizer.IN_UNITS)
        depth, faces, _ = draw(cloud_of([centre], points, matrix), kind=np.float64)
        for row in range(HEIGHT):
            for column in range(WIDTH):
                z, left = sphere_twin(centre, radius, matrix, column, row)
                if abs(left) < 1e-9:
                    continue
                if z is None:
                    assert faces[row, column] == -1 or (faces >= 0).sum() == 1
                else:
                    assert faces[row, column] == 0, (n, column, row)
                    expected = float(COEFFICIENTS[1] * z + COEFFICIENTS[2])
                    assert depth[row, column] == pytest.approx(expected, abs=1e-9)
                    seen += 1
    assert seen > 1000


def test_a_sphere_of_a_pixel_covers_one():
    matrix = np.diag([2.0 / WIDTH, 2.0 / HEIGHT, -0.1, 1.0])
    for x, y in ((0.0, 0.0), (0.5, 0.25), (-3.5, 2.0), (0.49, -0.49)):
        points = rows_of(point_rasterizer.SPHERE, 1.0, point_rasterizer.IN_UNITS)
        depth, faces, counts = draw(cloud_of([(x, y, -2.0)], points, matrix))
        assert (faces == 0).sum() >= 1
        assert counts[point_rasterizer.POINTS_DRAWN] == 1
        row, column = np.argwhere(faces == 0)[0]
        assert abs(column + 0.5 - WIDTH / 2 - x) <= 0.5
        assert abs(row + 0.5 - HEIGHT / 2 + y) <= 0.5
        assert depth[row, column] >= np.float32(-0.5 * 0.2 + 0.5 - 1e-6)
    points = rows_of(point_rasterizer.SPHERE, 0.2, point_rasterizer.IN_UNITS)
    _, faces, counts = draw(cloud_of([(0.0, 0.0, -2.0)], points, matrix))
    # 29 by 23 pixels: a centre is in the middle, and a speck there is seen.
    assert (faces == 0).sum() == 1
    _, faces, counts = draw(cloud_of([(0.5, 0.5, -2.0)], points, matrix))
    assert (faces == 0).sum() == 0
    assert counts[point_rasterizer.POINTS_UNSAMPLED] == 1


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int32])
@pytest.mark.parametrize("name", ["perspective", "parallel"])
def test_spheres_may_be_drawn_in_any_order(kind, name):
    # Those behind others are passed over: what is seen, and what is counted, is the same.
    matrix, coefficients = perspective(60.0, WIDTH / HEIGHT, 0.5, 20.0), (1000.0, 0.0, 0.0)
    if name == "parallel":
        matrix, coefficients = np.diag([0.4, 0.4, -0.1, 1.0]), (0.0, -500.0, 1000.0)
    rng = np.random.default_rng(13)
    centres = rng.uniform((-2, -2, -9), (2, 2, -1), (60, 3))
    sizes = rng.uniform(0.1, 3.0, 60)
    seen = []
    for order in (np.arange(60), np.argsort(-centres[:, 2]), np.argsort(centres[:, 2])):
        points = rows_of(point_rasterizer.SPHERE, sizes[order], point_rasterizer.IN_UNITS)
        cloud = cloud_of(centres[order], points, matrix)
        depth, faces, counts = draw(cloud._replace(depth_coefficients=coefficients), kind=kind)
        seen.append((depth.tolist(), counts))
        owners = np.append(order, -1)[faces]
        if kind == np.float64:
            seen[-1] += (owners.tolist(),)
    assert seen[0] == seen[1] == seen[2]
