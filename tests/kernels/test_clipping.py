"""Cuts equal those of exact arithmetic, neighbours stay so, nothing at the eye is special."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import naive
import numpy as np
import pytest
from clipped import clip_all
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.geometry import clipping, setup
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads

SIZE = (64, 64)

# Distances of pixel centres to exact edges that snapping and rounding cannot decide, pixels: the
# snapped edge lies within a sub-pixel of the exact one inside the guard band.
INEXACT = Fraction(1, 64)


def covered(positions, size=SIZE, faces=((0, 1, 2),), **options):
    """Return how often the faces, each drawn alone, hit each pixel."""
    total = np.zeros((size[1], size[0]), int)
    for face in faces:
        total += rj.rasterize(positions, [face], size, threads=1, **options).face_id == 0
    return total


def from_d3d(positions):
    """Turn clip depth 0..w into clip depth -w..w."""
    positions = np.array(positions, float)
    positions[:, 2] = 2.0 * positions[:, 2] - positions[:, 3]
    return positions


def ideal(positions, size):
    """Return the exact pixels of one clipped triangle, and those too close to call."""
    polygon = naive.clipped_screen_polygon(positions, size)
    return naive.polygon_pixels(polygon, size, INEXACT) if polygon else (set(), set())


def assert_pixels(positions, size=SIZE):
    """Assert that one triangle covers what exact clipping says; return how many pixels."""
    hits = {(int(i), int(j)) for j, i in np.argwhere(covered(positions, size))}
    inside, unsure = ideal(positions, size)
    assert hits - unsure == inside - unsure
    return len(hits)


# --- the kernel against exact arithmetic ----------------------------------------------------------


def random_corner(rng):
    return rng.normal(size=4) * [1.5, 1.5, 1.2, 1.0] + [0.0, 0.0, 0.0, 0.6]


def test_clipped_polygons_equal_naive():
    rng = np.random.default_rng(1)
    positions = np.array([random_corner(rng) for _ in range(900)])
    counts, vertices, _, _ = clip_all(positions)
    first = 0
    for n, count in enumerate(counts):
        exact = oracle.clip_polygon(positions[3 * n : 3 * n + 3])
        assert count == len(exact)
        for have, want in zip(vertices[first : first + count], exact, strict=True):
            np.testing.assert_allclose(have, [float(c) for c in want], rtol=0, atol=1e-13)
        first += count
    assert {0, 3, 4, 5, 6, 7} <= set(counts)


component = st.integers(-8, 8).map(float)
corner = st.tuples(component, component, component, component)


@settings(max_examples=150)
@given(corner, corner, corner)
def test_clipped_vertices_lie_inside_all_planes(a, b, c):
    counts, vertices, pieces, _ = clip_all([a, b, c])
    assert counts[0] == 0 or 3 <= counts[0] <= 9
    assert len(pieces) == max(counts[0] - 2, 0)
    for x, y, z, w in vertices:
        assert w > 0.0
        slack = 1e-12 * max(1.0, w)
        assert abs(x) <= w + slack
        assert abs(y) <= w + slack
        assert abs(z) <= w + slack


def test_fans_have_the_area_of_their_polygon():
    rng = np.random.default_rng(2)
    positions = np.array([random_corner(rng) for _ in range(300)])
    _, vertices, pieces, sources = clip_all(positions)
    screen = [oracle.screen_position(vertex, SIZE) for vertex in vertices]
    for n in range(100):
        polygon = naive.clipped_screen_polygon(positions[3 * n : 3 * n + 3], SIZE)
        want = sum(oracle.edge(polygon[0], a, b) for a, b in pairwise(polygon[1:]))
        have = sum(
            oracle.edge(*(screen[k - len(positions)] for k in piece))
            for piece in pieces[sources == n].tolist()
        )
        assert abs(float(have - want)) < 1e-8


def test_pieces_are_grouped_by_face_in_order():
    rng = np.random.default_rng(3)
    positions = np.array([random_corner(rng) for _ in range(300)])
    _, _, pieces, sources = clip_all(positions)
    assert (np.diff(sources) >= 0).all()
    assert pieces.min() >= len(positions)


def test_only_faces_that_cross_are_found():
    rng = np.random.default_rng(4)
    positions = rng.normal(size=(600, 4)) * [1, 1, 0.7, 0.7] + [0, 0, 0, 0.8]
    positions[::97, 1] = np.nan
    faces = rng.integers(0, 600, (900, 3)).astype(np.int32)
    viewport = make_viewport(SIZE, 8)
    screen, _ = visibility_pass.project_to_screen(
        positions, (0.0, -1.0, 0.0), viewport, threads.Workers(1)
    )
    codes = screen.codes[:600]
    want = []
    for n, (a, b, c) in enumerate(faces):
        union, shared = codes[a] | codes[b] | codes[c], codes[a] & codes[b] & codes[c]
        if union & setup.INVALID or shared & setup.FRUSTUM:
            continue
        if union & (setup.NEAR | setup.FAR | setup.GUARD):
            want.append(n)
    found = np.full(900, -1, np.int32)
    count = clipping.find_clipped_faces(faces, codes, found)
    assert found[:count].tolist() == want
    short = np.full(3, -1, np.int32)
    assert clipping.find_clipped_faces(faces, codes, short) == len(want)
    assert short.tolist() == want[:3]


@pytest.mark.parametrize("seed", range(4))
def test_every_clipped_vertex_is_snapped_inside_the_guard_band(seed):
    # A cut lands on the guard band up to a rounding; it must be put on the screen all the same.
    rng = np.random.default_rng(seed)
    count = 300
    positions = rng.normal(size=(count, 4)) * 10.0 ** rng.uniform(0, 8, (count, 1))
    positions[:, 2:] = rng.uniform(-1, 1, (count, 2)) + [0.0, 0.7]
    faces = np.arange(count, dtype=np.int32).reshape(-1, 3)
    viewport, workers = make_viewport(SIZE, 8), threads.Workers(1)
    screen, _ = visibility_pass.project_to_screen(positions, (0.0, -1.0, 0.0), viewport, workers)
    # What is not written keeps this mark.
    mark = np.iinfo(np.int32).min
    screen.xy[count:], screen.depth[count:] = mark, np.nan
    all_faces, screen, cut = visibility_pass.clip_faces(
        positions, faces, (0.0, -1.0, 0.0), viewport, screen, workers
    )
    assert cut > 50
    used = np.unique(all_faces.pieces)
    assert used.min() >= count
    assert (screen.xy[used] != mark).all()
    assert not np.isnan(screen.depth[used]).any()
    limit = (64 + setup.GUARD_PIXELS) * 256
    assert np.abs(screen.xy[used]).max() <= limit


# --- through the engine ---------------------------------------------------------------------------


def test_triangle_with_one_edge_on_a_plane_and_nothing_inside():
    outside = [[-1, 0, 0, 1], [-1, 0.5, 0, 1], [-2, 0, 0, 1]]
    counts, _, _, _ = clip_all(outside)
    assert counts[0] in (0, 2) or counts[0] == 3
    assert not covered(outside).any()


def test_random_faces_cover_what_exact_clipping_says():
    rng = np.random.default_rng(9)
    drawn = 0
    for _ in range(20):
        scale = [1, 1, 1, 1] if rng.random() < 0.5 else [2000, 2000, 1, 1]
        positions = np.array([random_corner(rng) * scale for _ in range(3)])
        drawn += assert_pixels(positions, (32, 32))
    assert drawn > 250


def test_piece_of_a_clipped_face_reports_its_face():
    positions = np.concatenate(
        [
            from_d3d([[-0.5, 0, 0.5, 1], [0.5, 0, 0.5, 1], [0, -1, -0.5, -1]]),
            naive.clip_from_screen([(0, 0), (64, 0), (0, 31)], SIZE),
        ]
    )
    seen = rj.rasterize(positions, [[3, 4, 5], [0, 1, 2]], SIZE, threads=1)
    assert seen.totals.clipped == 1
    assert seen.totals.drawn == 2
    assert set(np.unique(seen.face_id)) == {-1, 0, 1}
    assert (seen.face_id[40, 20:40] == 1).all()


@pytest.mark.needs_jit
def test_many_more_clipped_faces_than_spare_room():
    # More new vertices than SPARE_VERTICES, so the arrays are copied to larger ones.
    count = visibility_pass.SPARE_VERTICES
    one = from_d3d([[-0.5, 0, 0.5, 1], [0.5, 0, 0.5, 1], [0, -1, -0.5, -1]])
    positions = np.tile(one, (count, 1))
    faces = np.arange(3 * count).reshape(-1, 3)
    seen = rj.rasterize(positions, faces, SIZE, threads=1)
    alone = rj.rasterize(one, [[0, 1, 2]], SIZE, threads=1)
    assert seen.totals.clipped == count
    assert seen.face_id.tobytes() == alone.face_id.tobytes()
    assert seen.depth.tobytes() == alone.depth.tobytes()


@pytest.mark.needs_jit
def test_threads_cut_the_same_pieces_at_the_same_places():
    # Enough faces for many tasks of finding them, and of cutting them.
    count = 3 * 30_000
    positions = np.random.default_rng(8).normal(size=(count, 4)) * (2.0, 2.0, 1.0, 1.0)
    faces = np.arange(count, dtype=np.int32).reshape(-1, 3)
    viewport, depth_coefficients = make_viewport(SIZE, 8), (0.0, -1.0, 0.0)
    found = []
    for number in (1, 2, 5):
        workers = threads.Workers(number)
        screen, _ = visibility_pass.project_to_screen(
            positions, depth_coefficients, viewport, workers
        )
        all_faces, screen, cut = visibility_pass.clip_faces(
            positions, faces, depth_coefficients, viewport, screen, workers
        )
        made = slice(count, count + int(np.unique(all_faces.pieces).size))
        found.append((cut, all_faces.pieces, all_faces.piece_faces, screen.xy[made].copy()))
    assert found[0][0] > 2 * visibility_pass.MIN_CLIPPED_PER_TASK
    for other in found[1:]:
        assert all(map(np.array_equal, found[0], other))
