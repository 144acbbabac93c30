"""Snapping, outcodes, culling, and what becomes of every face."""

from __future__ import annotations

from fractions import Fraction

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline import records
from rasterjit.pipeline.geometry import setup
from rasterjit.pipeline.records import Faces, Objects
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads


def project(positions, size=(64, 64), bits=8):
    """Return the screen vertices of clip positions, and the outcode bits seen."""
    positions = np.ascontiguousarray(positions, np.float64)
    screen, seen = visibility_pass.project_to_screen(
        positions, (0.0, -1.0, 0.0), make_viewport(size, bits), threads.Workers(1)
    )
    return records.ScreenVertices(*(array[: len(positions)] for array in screen)), seen


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


@settings(max_examples=60)
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
    viewport = make_viewport((64, 32), 8)
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


def tiny_faces(rng, count, size, bits):
    """Return points on the grid: corners within 2 x 2 samples, many on edges through centres."""
    steps = 1 << bits
    middles = rng.integers(-1, np.array(size) + 1, (count, 1, 2))
    return (middles * steps + rng.integers(-steps, steps + 1, (count, 3, 2))) / steps


@pytest.mark.parametrize("bits", [0, 4, 12])
@pytest.mark.parametrize("cull", ["none", "back"])
def test_tiny_faces_go_on_exactly_if_they_cover_a_sample(bits, cull):
    rng = np.random.default_rng(bits)
    size = (16, 8)
    points = tiny_faces(rng, 600, size, bits)
    faces = np.arange(1800, dtype=np.int32).reshape(-1, 3)
    seen = rj.rasterize(
        naive.clip_from_screen(points.reshape(-1, 2), size), faces, size, cull=cull, threads=1,
        quality=rj.Quality(subpixel_bits=bits),
    ).totals  # fmt: skip
    a, b, c = points.transpose(1, 0, 2)
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    turns = ux * vy - uy * vx
    kept = turns < 0 if cull == "back" else turns != 0
    drawn = sum(
        bool(oracle.covered_pixels(triangle, size, subpixel_bits=bits))
        for triangle in points[kept].tolist()
    )
    assert seen.drawn == drawn > 50
    assert seen.unsampled > 50
    assert seen.outside + seen.unsampled + seen.drawn + seen.culled + seen.degenerate == 600


def test_a_batch_ends_where_an_object_does():
    # Faces of 300 objects, every other one turned away: each has its own turn within one task.
    rng = np.random.default_rng(5)
    counts = rng.integers(0, 5, 300) * rng.choice([1, 1, 60], 300)
    starts = np.concatenate(([0], np.cumsum(counts)))
    turns = rng.integers(-1, 2, 300).astype(np.int8)
    corners = naive.clip_from_screen([(4, 4), (20, 4), (4, 20)], (64, 64))
    screen, _ = project(corners)
    faces = np.tile(np.array([[0, 1, 2]], np.int32), (starts[-1], 1))
    everything = Faces(faces, np.empty((0, 3), np.int32), np.empty(0, np.int32))
    _, binned, _, sums = visibility_pass.set_up_and_bin(
        everything, Objects(starts, turns), screen, make_viewport((64, 64), 8), threads.Workers(1)
    )
    kept = np.repeat(turns, counts) != 1
    assert binned.tolist() == np.flatnonzero(kept).tolist()
    assert sums.tolist() == [0, 0, int((~kept).sum()), 0, 0]
    assert 0 < len(binned) < len(faces)


def test_outcodes_are_not_read_if_no_vertex_has_any():
    rng = np.random.default_rng(6)
    points, size = rng.uniform(0, 64, (900, 2)), (64, 64)
    screen, seen = project(naive.clip_from_screen(points, size), size)
    assert seen == 0
    faces = rng.integers(0, 900, (1000, 3), np.int32)
    everything = Faces(faces, np.empty((0, 3), np.int32), np.empty(0, np.int32))
    objects = Objects(np.array([0, 1000], np.int64), np.zeros(1, np.int8))

    def listed(screen, **possible_codes):
        """Return the lists of the tiles and what became of the other faces."""
        starts, binned, _, sums = visibility_pass.set_up_and_bin(
            everything, objects, screen, make_viewport(size, 8), threads.Workers(1), None,
            np.float32, **possible_codes,
        )  # fmt: skip
        return starts.tolist(), binned.tolist(), sums.tolist()

    expected = listed(screen)
    assert len(expected[1]) > 500
    screen.codes[:] = setup.LEFT
    assert listed(screen, possible_codes=0) == expected
    assert listed(screen, possible_codes=setup.ANY_CODE)[1] == []
    assert listed(screen)[1] == []


def test_the_last_start_is_found_as_numpy_finds_it():
    starts = np.array([0, 0, 3, 3, 3, 7, 12], np.int64)
    for number in range(-2, 15):
        expected = np.searchsorted(starts, number, side="right") - 1
        assert setup.find_last_at_most(starts, number) == expected
    assert setup.find_last_at_most(starts[:0], 5) == -1
