"""Snapping, outcodes, culling and what the degenerate, huge and non-finite are worth."""

from __future__ import annotations

from fractions import Fraction

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit import oracle, stages
from rasterjit.kernels import setup, visibility
from rasterjit.kernels.records import Faces, Objects
from rasterjit.plan import viewport_of

HUGE = setup.LARGEST_COORDINATE


def project(positions, size=(64, 64), bits=8):
    """Return the screen vertices of clip positions, and the outcode bits seen."""
    positions = np.ascontiguousarray(positions, np.float64)
    screen, seen = stages.project(
        positions, (0.0, -1.0, 0.0), viewport_of(size, bits), stages.Workers(1)
    )
    return stages.ScreenVertices(*(array[: len(positions)] for array in screen)), seen


def covered(positions, size=(64, 64), **options):
    """Return where one triangle of clip positions is drawn, (H, W) bool."""
    return rj.rasterize(positions, [[0, 1, 2]], size, threads=1, **options).face_id == 0


def on_screen(points, size=(128, 128)):
    """Return where one screen triangle is drawn; its points are first rounded to 2**-14 pixel."""
    dyadic = [(round(x * 2**14) / 2**14, round(y * 2**14) / 2**14) for x, y in points]
    return covered(naive.clip_from_screen(dyadic, size), size)


def test_snapping_rounds_half_to_even():
    steps = np.array([0.5, 1.5, 2.5, -0.5, -1.5, 3.49, 3.51, 1000.5, 1001.5])
    points = [(step / 256, 0.0) for step in steps]
    screen, _ = project(
        naive.clip_from_screen(np.round(np.array(points) * 2**20) / 2**20, (64, 64))
    )
    assert screen.xy[:, 0].tolist() == [0, 2, 2, 0, -2, 3, 4, 1000, 1002]


@pytest.mark.parametrize("bits", [0, 4, 8, 12])
def test_snapping_equals_naive(bits):
    rng = np.random.default_rng(bits)
    points = np.round(rng.uniform(-8000, 8000, (400, 2)) * 2**14) / 2**14
    points[::2] = np.round(points[::2] * 2 ** (bits + 1)) / 2 ** (bits + 1)  # many ties
    screen, _ = project(naive.clip_from_screen(points, (64, 32)), (64, 32), bits)
    extra = max(bits, 1) - bits
    for row, (x, y) in zip(screen.xy.tolist(), points, strict=True):
        # y counts from below before it is flipped, so ties in it round on -y + H.
        assert row == [oracle.snap(x, bits) << extra, oracle.snap(y, bits) << extra]


@settings(max_examples=60, derandomize=True, deadline=None, database=None)
@given(
    st.floats(-60.0, 60.0), st.floats(-60.0, 60.0), st.floats(1e-3, 1e3),
    st.sampled_from([(64, 64), (255, 257), (1, 7)]),
)  # fmt: skip
def test_snapped_vertex_lies_within_half_a_step(x, y, w, size):
    position = np.array([[x * w, y * w, 0.0, w]])
    screen, seen = project(position, size)
    assert not seen & setup.GUARD
    exact = oracle.screen_position(position[0], size)
    for have, want in zip(screen.xy[0].tolist(), exact, strict=True):
        assert abs(Fraction(have, 256) - want) <= Fraction(1, 512) + abs(want) / 2**48 + 1 / 2**40


def test_outcodes_equal_the_plane_distances():
    rng = np.random.default_rng(3)
    positions = rng.normal(size=(2000, 4)) * 10.0 ** rng.integers(-3, 6, (2000, 1))
    positions[:200] = rng.integers(-1, 2, (200, 4))  # many on a plane, many with w = 0
    viewport = viewport_of((64, 32), 8)
    screen, seen = project(positions, (64, 32))
    planes = oracle.VIEW_VOLUME
    guards = oracle.view_planes(viewport.guard_x, viewport.guard_y)[2:]
    bits = (
        setup.NEAR, setup.FAR, setup.LEFT, setup.RIGHT, setup.BOTTOM, setup.TOP,
    )  # fmt: skip
    union = 0
    for code, position in zip(screen.codes.tolist(), positions, strict=True):
        exact = [Fraction(c) for c in position.tolist()]
        want = sum(
            bit
            for bit, plane in zip(bits, planes, strict=True)
            if oracle.plane_distance(plane, exact) < 0
        )
        # Guard distances are products of floats: leave out what lies within their rounding.
        slack = Fraction(1, 2**50) * abs(exact[3]) * 1000
        if not exact[3] > 0 or any(
            oracle.plane_distance(plane, exact) < -slack for plane in guards
        ):
            want |= setup.GUARD
        elif any(oracle.plane_distance(plane, exact) < slack for plane in guards):
            want |= code & setup.GUARD
        assert code == want
        union |= code
    assert seen == union


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1.01 * HUGE, -1e300])
@pytest.mark.parametrize("component", range(4))
def test_invalid_vertex_drops_its_face_and_no_other(bad, component):
    good = naive.clip_from_screen([(0, 0), (64, 0), (0, 64), (64, 64)], (64, 64))
    broken = np.concatenate([good, good[:1]])
    broken[4, component] = bad
    both = rj.rasterize(broken, [[0, 1, 2], [4, 1, 3]], (64, 64), threads=1)
    alone = rj.rasterize(good, [[0, 1, 2]], (64, 64), threads=1)
    assert both.totals.invalid == 1
    assert both.face_id.tobytes() == alone.face_id.tobytes()
    assert both.depth.tobytes() == alone.depth.tobytes()
    assert not np.isnan(both.depth).any()
    assert not np.isnan(both.barycentric).any()


def test_coordinates_up_to_the_limit_make_no_nan():
    rng = np.random.default_rng(5)
    signs = rng.choice([-1.0, 1.0], (300, 4))
    positions = signs * np.minimum(10.0 ** rng.uniform(-150, 150, (300, 4)), HUGE)
    faces = np.arange(300).reshape(-1, 3)
    seen = rj.rasterize(positions, faces, (16, 16), threads=1)
    assert not np.isnan(seen.depth).any()
    assert not np.isnan(seen.barycentric).any()
    assert (np.abs(seen.depth[seen.face_id >= 0]) <= 1.0).all()


def test_triangle_without_area_draws_nothing():
    for points in (
        [(1, 1), (1, 1), (9, 9)],
        [(5, 5), (5, 5), (5, 5)],
        [(0, 0), (8, 8), (16, 16)],
        [(0, 0), (100, 0.001), (100, 0.002)],  # snaps to no height at a pixel centre
    ):
        assert not on_screen(points).any()


def test_sliver_that_snaps_to_nothing_leaves_no_hole():
    a, b, c = (0, 0.5), (100, 0.5005), (100, 0.4995)
    pieces = [
        (a, b, c), ((0, 0), (100, 0), c), ((0, 0), c, a), (a, b, (100, 100)),
        (a, (100, 100), (0, 100)),
    ]  # fmt: skip
    counts = sum(on_screen(piece).astype(int) for piece in pieces)
    assert not on_screen(pieces[0]).any()
    assert (counts[:100, :100] == 1).all()
    assert counts.sum() == 10_000


def test_sliver_one_step_high_owns_the_centres_on_its_top_edge():
    row = on_screen([(0, 0.5), (100, 0.5), (100, 0.50390625)])
    assert row[0, :100].all()
    assert row.sum() == 100
    column = on_screen([(0.5, 0), (0.50390625, 0), (0.5, 100)])
    assert column[:100, 0].all()
    assert column.sum() == 100
    assert not on_screen([(0.5, 0), (0.49609375, 0), (0.5, 100)]).any()


def test_area_beyond_32_bits_is_exact():
    # 2A = 2**44 sub-pixels squared, which is 0 modulo 2**32. Only four tiles are drawn.
    side = 16384
    positions = naive.clip_from_screen([(0, 0), (side, 0), (0, side), (side, side)], (side, side))
    viewport, workers = viewport_of((side, side), 8), stages.Workers(1)
    screen, _ = stages.project(positions, (0.0, -1.0, 0.0), viewport, workers)
    frame = np.empty((side, side), np.float32), np.empty((side, side), np.int32)
    tiles = np.array([r * 256 + c for r in (127, 128) for c in (127, 128)], np.int32)
    scratch = np.empty((64, 64), np.float32), np.empty((64, 64), np.int32)
    none = np.empty((0, 3), np.int32), np.empty(0, np.int32)
    objects = Objects(np.array([0, 1], np.int64), np.zeros(1, np.int8))
    counts = np.zeros((5, 5), int)
    for corners in ([0, 1, 2], [1, 3, 2]):
        faces = Faces(np.array([corners], np.int32), *none)
        starts, binned, _ = stages.set_up_and_bin(faces, objects, screen, viewport, workers)
        visibility.draw_tiles(tiles, starts, binned, faces, screen, viewport, frame, scratch)
        window = frame[1][8190:8195, 8190:8195] == 0
        if corners[0] == 0:
            assert {(8190 + x, 8190 + y) for y, x in np.argwhere(window)} == {
                (8190, 8190), (8190, 8191), (8190, 8192), (8191, 8190), (8191, 8191), (8192, 8190),
            }  # fmt: skip
        counts += window
    assert (counts == 1).all()


def test_huge_clip_coordinates_cover_what_they_cover():
    spread = [[-1e30, -1e30, 0.5, 1.0], [1e30, -1e30, 0.5, 1.0], [0.0, 1e30, 0.5, 1.0]]
    assert covered(spread).all()
    scaled = [[-1e30, -1e30, 0.0, 1e30], [1e30, -1e30, 0.0, 1e30], [0.0, 1e30, 0.0, 1e30]]
    assert covered(scaled).sum() == 2048


def test_denormal_coordinates():
    tiny = 1e-310
    assert not covered([[0, 0, 0, 1], [tiny, 0, 0, 1], [0, tiny, 0, 1]]).any()
    # A denormal w is a true divisor: NDC (0.5, 0).
    screen, _ = project([[0.5 * tiny, 0.0, 0.5 * tiny, tiny]])
    assert abs(screen.xy[0, 0] / 256 - 48) < 1e-6
    assert screen.xy[0, 1] == 32 * 256


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_w_of_zero_is_outside_and_never_divided(zero):
    screen, seen = project([[1.0, 2.0, 0.0, zero], [0.0, 0.0, 0.0, zero]])
    assert seen & setup.GUARD
    assert (screen.codes & setup.GUARD).all()
    points = np.array([[-0.5, -0.5, 0.0, 1.0], [0.5, -0.5, 0.0, 1.0], [0.0, 0.0, 0.0, zero]])
    seen = rj.rasterize(points, [[0, 1, 2]], (64, 64), threads=1)
    assert not np.isnan(seen.depth).any()


@pytest.mark.parametrize("shift", [(-64.25, 0), (64.25, 0), (0, -64.25), (0, 64.25)])
def test_box_outside_draws_nothing(shift):
    square = [(0, 0), (64, 0), (64, 64), (0, 64)]
    points = [(x + shift[0], y + shift[1]) for x, y in square]
    positions = naive.clip_from_screen(points, (64, 64))
    for face in ([0, 1, 2], [0, 2, 3]):
        seen = rj.rasterize(positions, [face], (64, 64), threads=1)
        assert (seen.face_id == -1).all()
        assert seen.totals.drawn == 0


def test_border_centres_belong_to_left_and_top():
    # Edges through the first and the last pixel centres of the image.
    inner = np.zeros((64, 64), int)
    corners = [(0.5, 0.5), (63.5, 0.5), (63.5, 63.5), (0.5, 63.5)]
    positions = naive.clip_from_screen(corners, (64, 64))
    for face in ([0, 1, 2], [0, 2, 3]):
        inner += rj.rasterize(positions, [face], (64, 64), threads=1).face_id == 0
    assert (inner[:63, :63] == 1).all()
    assert inner.sum() == 63 * 63


def test_culling_uses_the_snapped_area():
    # In real arithmetic counter-clockwise; on the grid nothing, or clockwise.
    flat = [(10, 10), (20, 10.001), (30, 10)]
    seen = rj.rasterize(
        naive.clip_from_screen(np.round(np.array(flat) * 2**14) / 2**14, (64, 64)),
        [[0, 1, 2]], (64, 64), cull="back", threads=1,
    )  # fmt: skip
    assert seen.totals.degenerate == 1
    turned = [(10 + 0.49 / 256, 10), (10, 40), (10 - 0.49 / 256, 20 + 0.49 / 256)]
    points = np.round(np.array(turned) * 2**20) / 2**20
    area = oracle.edge(*[tuple(oracle.snap(c, 8) for c in point) for point in points])
    assert area == 0
    for cull in ("none", "back", "front"):
        seen = rj.rasterize(
            naive.clip_from_screen(points, (64, 64)), [[0, 1, 2]], (64, 64), cull=cull, threads=1
        )
        assert (seen.face_id == -1).all()
        assert seen.totals.degenerate == 1


def test_every_face_is_counted_once():
    rng = np.random.default_rng(11)
    positions = rng.normal(size=(900, 4))
    positions[:, :2] *= 3.0
    positions[::50, 0] = np.nan
    faces = rng.integers(0, 900, (2000, 3))
    for cull in ("none", "back", "front"):
        totals = rj.rasterize(positions, faces, (40, 30), cull=cull, threads=1).totals
        parts = totals.outside, totals.degenerate, totals.culled, totals.unsampled, totals.invalid
        assert sum(parts) + totals.drawn == totals.faces_in == 2000
        assert totals.invalid > 0
        assert (totals.culled > 0) == (cull != "none")


def test_every_front_face_is_somebody_elses_back_face():
    rng = np.random.default_rng(12)
    positions = rng.normal(size=(300, 4)) * [1.0, 1.0, 0.5, 0.2] + [0.0, 0.0, 0.0, 1.0]
    faces = np.arange(300).reshape(-1, 3)
    front = rj.rasterize(positions, faces, (40, 30), cull="back", threads=1)
    mirrored = rj.rasterize(positions, faces[:, ::-1], (40, 30), cull="front", threads=1)
    assert front.face_id.tobytes() == mirrored.face_id.tobytes()
    assert front.totals.culled == mirrored.totals.culled > 0
