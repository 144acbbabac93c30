"""Guarantee: coverage is the oracle's at every sample, up to the largest image and guard band."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import naive
import numpy as np
import pytest
from screen_triangles import MAX, TILE, draw_tile, pixels_of

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.geometry import setup, triangle_batches
from rasterjit.pipeline.visibility import tile_rasterizer, visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads
from rasterjit.scene.validation import MAX_SIZE

BITS = (0, 4, 8, 12)
GRIDS = {bits: make_viewport(MAX, bits).grid_bits for bits in BITS}
"""Bits of the grid that coordinates are counted on, by sub-pixel bits."""

MAX_APART = MAX_SIZE + 2 * setup.GUARD_PIXELS
"""Pixels between opposite sides of the guard band around the largest image."""


# --- nothing overflows ----------------------------------------------------------------------------


def largest_edge(vertex_box, sample_box):
    """
    Return the largest edge function of vertices and samples in boxes (left, top, right, bottom).

    It is linear in each coordinate alone, so it is largest where all of them are at an end.
    """
    ends = [
        list(itertools.product(box[::2], box[1::2])) for box in (vertex_box, vertex_box, sample_box)
    ]
    return max(abs(oracle.edge(a, b, p)) for a, b, p in itertools.product(*ends))


@pytest.mark.parametrize("bits", BITS)
def test_vertices_reach_the_corners_of_the_guard_band(bits):
    corners = list(itertools.product((-2.0, 2.0), (-2.0, 2.0), (0.0,), (1.0,)))
    viewport = make_viewport(MAX, bits)
    screen, seen = visibility_pass.project_to_screen(
        np.array(corners), (0.0, -1.0, 0.0), viewport, threads.Workers(1)
    )
    assert not seen & setup.GUARD
    reached = screen.xy[:4].astype(object)
    assert (reached.min(), reached.max()) == (
        -setup.GUARD_PIXELS << GRIDS[bits], (MAX_SIZE + setup.GUARD_PIXELS) << GRIDS[bits],
    )  # fmt: skip
    assert MAX_APART == 2**15


@pytest.mark.parametrize("grid", GRIDS.values())
def test_edge_functions_fit_64_bits(grid):
    apart = MAX_APART << grid
    box = (0, 0, apart, apart)
    assert apart <= 2**27
    assert apart * apart <= 2**54  # each product of two differences
    assert largest_edge(box, box) == apart * apart
    assert 2 * apart * apart <= 2**55 < 2**63  # even if the two products had opposite signs


@pytest.mark.parametrize("grid", GRIDS.values())
def test_vertices_fit_32_bits(grid):
    assert (MAX_SIZE + setup.GUARD_PIXELS) << grid < 2**31


@pytest.mark.parametrize("grid", GRIDS.values())
def test_edge_functions_of_small_triangles_are_exact_in_float64(grid):
    # Columns of centres, and the parts of pixels beside them; groups of four samples end at most
    # three columns further right.
    wide, high = (triangle_batches.MAX_SMALL_PIXELS + 1) << grid, MAX_APART << grid
    further = wide + (3 << grid)
    reached = largest_edge((0, 0, wide, high), (0, 0, further, high))
    assert reached < 2**44
    # A step beyond the last row is added, but never looked at.
    assert reached + (wide << grid) < 2**53


@pytest.mark.parametrize("grid", GRIDS.values())
def test_quotients_of_spans_are_below_half_an_ulp_from_exact(grid):
    # e / s that is not whole misses the next whole number by 1 / s at least; float64 rounds it by
    # half an ulp at most, 2**-53 of itself.
    most = (MAX_APART << grid) ** 2 >> grid
    assert most < 2**47
    assert Fraction(most, 2**53) < 1


def test_spans_end_where_exact_arithmetic_says():
    prepare_crossing = getattr(
        tile_rasterizer.prepare_crossing, "function", tile_rasterizer.prepare_crossing
    )
    bound_span = getattr(tile_rasterizer.bound_span, "function", tile_rasterizer.bound_span)
    rng = np.random.default_rng(1)
    for _ in range(4000):
        slope = int(2 ** rng.uniform(0, 27))
        most = min(2**47 // slope, 2**30)
        column = int(rng.integers(0, most + 1)) if rng.random() < 0.5 else int(rng.integers(0, 64))
        value = slope * column + int(rng.choice([-1, 0, 1, slope // 2]))
        if abs(value) >= 2**47:
            continue
        # The last column x with value - x slope >= 0, the first with -value + x slope >= 0.
        begins = prepare_crossing((np.int64(-value), np.int64(slope), np.int64(0)))
        ends = prepare_crossing((np.int64(value), np.int64(-slope), np.int64(0)))
        first, last = bound_span(-(2.0**48), 2.0**48, begins, np.int64(0))
        first, last = bound_span(first, last, ends, np.int64(0))
        assert last == value // slope
        assert first == -(-value // slope)


# --- every sample is the oracle's -----------------------------------------------------------------


def bezout(x, y):
    """Return whole s and t with s x + t y = gcd(x, y)."""
    if y == 0:
        return (1 if x >= 0 else -1), 0
    s, t = bezout(y, x % y)
    return t, s - (x // y) * t


def guard_box(size, bits):
    """Return the guard band, (left, top, right, bottom), in grid steps."""
    margin = setup.GUARD_PIXELS
    return tuple(n << bits for n in (-margin, -margin, size[0] + margin, size[1] + margin))


def within(box, point):
    return box[0] <= point[0] <= box[2] and box[1] <= point[1] <= box[3]


def centre_of(pixel, bits):
    """Return a pixel's centre in grid steps; its upper left corner where no step names it."""
    return tuple((n << bits) + ((1 << bits) >> 1) for n in pixel)


def near_miss(box, pixel, bits, rng, *, longest):
    """
    Return an edge across the guard band with E = -1, 0 or 1 at a centre, or None.

    The longest start near the corner farthest from the pixel: there products of two differences
    pass 2**53, on a grid of 12 bits in the largest image.
    """
    p = centre_of(pixel, bits)
    far = [box[0] if 2 * p[0] > box[0] + box[2] else box[2],
           box[1] if 2 * p[1] > box[1] + box[3] else box[3]]  # fmt: skip
    for _ in range(100):
        a = tuple(int(n) for n in far + rng.integers(-99, 100, 2))
        if not longest:
            a = a[0], int(rng.integers(box[1], box[3] + 1))
        x, y = p[0] - a[0], p[1] - a[1]
        if math.gcd(x, y) != 1 or not within(box, a):
            continue
        s, t = bezout(x, y)
        miss = int(rng.choice([-1, 1])) if longest else int(rng.choice([-1, 0, 1]))
        ends = [(a[0] + k * x + miss * t, a[1] + k * y - miss * s) for k in (1, 2, 3)]
        # Keep those beyond the centre.
        ends = [b for b in ends if within(box, b) and (b[0] - p[0]) * x + (b[1] - p[1]) * y > 0]
        if ends:
            assert abs(oracle.edge(a, ends[-1], p)) <= 1
            return a, ends[-1]
    return None


def through_centres(box, pixel, bits, rng):
    """Return an edge across the guard band through a centre and many others."""
    p = centre_of(pixel, bits)
    dx, dy = (int(n) << bits for n in rng.choice([-3, -2, -1, 1, 2, 3], 2))
    steps = [k for k in range(-40000, 40001) if within(box, (p[0] + k * dx, p[1] + k * dy))]
    return tuple((p[0] + k * dx, p[1] + k * dy) for k in (steps[0], steps[-1]))


def hard_triangles(size, pixel, bits, rng):
    """Yield triangles in grid steps that are hard to get right around a pixel."""
    box = guard_box(size, bits)
    corners = [(box[0], box[1]), (box[2], box[1]), (box[2], box[3]), (box[0], box[3])]

    def anywhere():
        return int(rng.integers(box[0], box[2] + 1)), int(rng.integers(box[1], box[3] + 1))

    # From corner to corner of the guard band, and the thinnest slivers along its diagonals.
    for n in range(4):
        a, b, c = (corners[(n + k) % 4] for k in range(3))
        yield a, b, c
        inward = 1 if c[0] == box[0] else -1
        yield a, c, (c[0] + inward, c[1])
        yield a, c, (c[0], c[1] + (1 if c[1] == box[1] else -1))
    # Edges as close to a centre as can be, and through it: thin and wide on either side.
    for _ in range(4):
        for edge in (
            near_miss(box, pixel, bits, rng, longest=True),
            near_miss(box, pixel, bits, rng, longest=False),
            through_centres(box, pixel, bits, rng),
        ):
            if edge is not None:
                yield *edge, anywhere()
                yield *edge, corners[int(rng.integers(4))]
                sliver = edge[1][0], edge[1][1] + (1 if edge[1][1] < box[3] else -1)
                yield *edge, sliver
    # Any three points, and a tall one of a few columns beside the pixel.
    for _ in range(3):
        yield anywhere(), anywhere(), anywhere()
    x, y = centre_of(pixel, bits)
    for width in (1, 3 << bits, 7 << bits):
        yield (x, box[1]), (x + width, box[3]), (x - 1, y)


def in_pixels(triangle, bits):
    return [(x / (1 << bits), y / (1 << bits)) for x, y in triangle]


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("size", [(32, 32), (64, 8), (128, 32)])
def test_triangles_across_the_guard_band_are_exact(size, bits):
    rng = np.random.default_rng(size[0] + bits)
    quality = rj.Quality(subpixel_bits=bits)
    partly = 0
    pixel = (size[0] - 3, size[1] // 2)
    for triangle in hard_triangles(size, pixel, bits, rng):
        points = in_pixels(triangle, bits)
        positions = naive.clip_from_screen(points, size)
        seen = rj.rasterize(positions, [[0, 1, 2]], size, quality=quality, threads=1)
        exact = oracle.covered_pixels(points, size, subpixel_bits=bits)
        assert seen.totals.clipped == 0
        assert pixels_of(seen.face_id) == exact, triangle
        partly += 0 < len(exact) < size[0] * size[1]
    assert partly > 8


TILES = [(0, 0), (255, 255), (127, 128)]


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("tile", TILES)
def test_tiles_of_the_largest_image_are_exact(tile, bits):
    rng = np.random.default_rng(256 * tile[0] + tile[1] + bits)
    left, top = tile[0] * TILE, tile[1] * TILE
    window = (left, top, left + TILE, top + TILE)
    pixel = (left + int(rng.integers(TILE)), top + int(rng.integers(TILE)))
    triangles = list(hard_triangles(MAX, pixel, bits, rng))
    partly = 0
    for number in rng.permutation(len(triangles))[:15]:
        points = in_pixels(triangles[number], bits)
        positions = naive.clip_from_screen(points, MAX)
        drawn = pixels_of(draw_tile(positions, [[0, 1, 2]], *tile, bits))
        exact = oracle.covered_pixels(points, MAX, subpixel_bits=bits, window=window)
        assert {(x + left, y + top) for x, y in drawn} == exact, triangles[number]
        partly += 0 < len(exact) < TILE * TILE
    assert partly > 1


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("tile", TILES)
def test_fan_in_the_guard_band_of_the_largest_image_covers_its_tiles_once(tile, bits):
    # Its hub lies on a centre of the tile, its ring on the border of the guard band.
    rng = np.random.default_rng(100 + 256 * tile[0] + tile[1] + bits)
    left, top, right, bottom = guard_box(MAX, bits)
    sides = [
        [(int(x), y) for x in np.sort(rng.integers(left, right, 8))[::order]]
        for y, order in ((top, 1), (bottom, -1))
    ]
    ring = [(left, top), *sides[0], (right, top), (right, bottom), *sides[1], (left, bottom)]
    hub = centre_of([n * TILE + int(rng.integers(TILE)) for n in tile], bits)
    positions = naive.clip_from_screen(in_pixels([hub, *ring], bits), MAX)
    faces = [[0, n, n % len(ring) + 1] for n in range(1, len(ring) + 1)]
    one = draw_tile(positions, faces, *tile, bits)
    last = len(faces) - 1 - draw_tile(positions, faces[::-1], *tile, bits)
    assert (one >= 0).all()
    assert (one == last).all()
    assert len(np.unique(one)) > 1
    points = [hub, *ring]
    for row, column in itertools.product(range(0, TILE, 3), range(0, TILE, 3)):
        corners = [points[n] for n in faces[one[row, column]]]
        centre = naive.centre(tile[0] * TILE + column, tile[1] * TILE + row, bits)
        assert oracle.covers(corners, centre)


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("size", [(MAX_SIZE, 1), (1, MAX_SIZE)])
def test_longest_row_and_column_are_exact(size, bits):
    rng = np.random.default_rng(size[0] + bits)
    quality = rj.Quality(subpixel_bits=bits)
    partly = 0
    triangles = list(hard_triangles(size, (size[0] - 1, size[1] - 1), bits, rng))
    for number in rng.permutation(len(triangles))[:8]:
        points = in_pixels(triangles[number], bits)
        positions = naive.clip_from_screen(points, size)
        seen = rj.rasterize(positions, [[0, 1, 2]], size, quality=quality, threads=1)
        exact = oracle.covered_pixels(points, size, subpixel_bits=bits)
        assert pixels_of(seen.face_id) == exact, triangles[number]
        partly += 0 < len(exact) < MAX_SIZE
    assert partly > 0


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("size", [(1, 1), (1, 7), (37, 5), (65, 33)])
def test_random_triangles_in_images_of_any_size_are_exact(size, bits):
    # On the grid in an image whose sides are no powers of two, each vertex at its own w.
    rng = np.random.default_rng(size[0] * 13 + bits)
    quality = rj.Quality(subpixel_bits=bits)
    drawn = 0
    for n in range(36):
        low, high = -(4 << bits), (np.array(size) + 4) << bits
        xy = rng.integers(low, high + 1, (3, 2))
        if n % 3 == 1:  # a sliver
            xy[2] = (xy[0] + xy[1]) // 2 + rng.integers(-2, 3, 2)
        if n % 3 == 2:  # many ties
            half = max(bits - 1, 0)
            xy = xy >> half << half
        w = 10.0 ** rng.uniform(-3, 3, (3, 1))
        ndc = (2.0 * xy / (np.array(size) << bits) - 1.0) * [1.0, -1.0]
        positions = np.concatenate([ndc, rng.uniform(-1, 1, (3, 1)), np.ones((3, 1))], axis=1) * w
        seen = rj.rasterize(positions, [[0, 1, 2]], size, quality=quality, threads=1)
        exact = oracle.covered_pixels(in_pixels(xy.tolist(), bits), size, subpixel_bits=bits)
        assert pixels_of(seen.face_id) == exact, xy
        drawn += len(exact)
    assert drawn > 0
