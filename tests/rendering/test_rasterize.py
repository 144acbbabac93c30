"""The visibility stage alone: one result for any spelling, any thread count and any order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.runtime import threads as sharing

SIZE = (96, 80)


def soup(seed, count, reach=0.4, clipped=True):
    """Return clip positions and faces of random triangles, some of which cross the near plane."""
    rng = np.random.default_rng(seed)
    w = rng.uniform(0.5, 4.0, (count, 1))
    middles = rng.uniform(-1.2, 1.2, (count, 1, 3)) * [1.0, 1.0, 0.9]
    ndc = middles + rng.uniform(-reach, reach, (count, 3, 3)) * [1.0, 1.0, 0.2]
    positions = np.concatenate(
        [ndc * w[:, None], np.broadcast_to(w[:, None], (count, 3, 1))], axis=2
    )
    if clipped:
        positions[::13, 0, 3] *= -1.0
        positions[5::17, 1, 2] -= 3.0
    return positions.reshape(-1, 4), np.arange(3 * count).reshape(-1, 3)


def bits(seen):
    return seen.face_id.tobytes(), seen.depth.tobytes(), seen.barycentric.tobytes()


def test_threads_change_no_bit():
    positions, faces = soup(1, 400)
    one = bits(rj.rasterize(positions, faces, SIZE, threads=1))
    for threads in (2, 3, 8, None):
        for _ in range(2):
            assert bits(rj.rasterize(positions, faces, SIZE, threads=threads)) == one


def test_several_set_up_tasks_change_no_bit(monkeypatch):
    # More faces than one task takes, some of them clipped.
    positions, faces = soup(2, visibility_pass.FACES_PER_TASK + 9000, reach=0.02)
    frames = [rj.rasterize(positions, faces, SIZE, threads=n) for n in (1, 2, 3, 8)]
    monkeypatch.setattr(visibility_pass, "FACES_PER_TASK", 10**9)
    frames.append(rj.rasterize(positions, faces, SIZE, threads=1))
    monkeypatch.setattr(visibility_pass, "FACES_PER_TASK", 997)
    frames.append(rj.rasterize(positions, faces, SIZE, threads=2))
    assert frames[0].totals.clipped > 1000
    assert (frames[0].face_id > visibility_pass.FACES_PER_TASK).any()
    for frame in frames[1:]:
        assert bits(frame) == bits(frames[0])
        assert frame.totals == frames[0].totals


@pytest.mark.parametrize("per_task", [1, 3])
def test_order_of_tasks_changes_no_bit(monkeypatch, per_task):
    positions, faces = soup(3, 300)
    size = (300, 200)
    expected = bits(rj.rasterize(positions, faces, size, threads=1))

    def run_backwards(self, task, arguments):
        calls = list(arguments)
        return [task(*call) for call in calls[::-1]][::-1]

    monkeypatch.setattr(sharing.Workers, "run", run_backwards)
    monkeypatch.setattr(visibility_pass, "TILES_PER_TASK", per_task)
    monkeypatch.setattr(visibility_pass, "FACES_PER_TASK", 50)
    monkeypatch.setattr(visibility_pass, "VERTICES_PER_TASK", 64)
    monkeypatch.setattr(sharing, "MIN_PIXELS_PER_TASK", 7)
    assert bits(rj.rasterize(positions, faces, size, threads=2)) == expected


def test_larger_image_holds_the_smaller():
    # Two to one in size, the coarse sub-pixel grid of the larger being the grid of the smaller.
    positions, faces = soup(6, 60, clipped=False)
    positions = np.round(positions * 2**6) / 2**6
    positions[:, 3] = 1.0
    small = rj.rasterize(positions, faces, (64, 64), threads=1)
    large = rj.rasterize(positions, faces, (192, 192), threads=1)
    # The centre of each small pixel is a centre of the large image.
    assert small.face_id.tolist() == large.face_id[1::3, 1::3].tolist()


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 150), st.integers(1, 150))
def test_any_size_is_filled_exactly(seed, width, height):
    positions, faces = soup(seed, 12, reach=2.0)
    seen = rj.rasterize(positions, faces, (width, height), threads=1)
    assert seen.face_id.shape == seen.depth.shape == (height, width)
    assert seen.barycentric.shape == (height, width, 3)
    nothing = seen.face_id == -1
    assert (np.isinf(seen.depth) == nothing).all()
    assert ((seen.barycentric.sum(axis=2) == 0) == nothing).all()
    assert seen.face_id.max() < 12


def test_depth_is_ndc_z_as_given():
    positions = np.array([[-1, -1, 0.3, 1], [3, -1, 0.3, 1], [-1, 3, 0.3, 1]])
    seen = rj.rasterize(positions, [[0, 1, 2]], (8, 8), threads=1)
    assert (seen.depth == np.float32(0.3)).all()
    positions *= 5.0
    seen = rj.rasterize(positions, [[0, 1, 2]], (8, 8), threads=1, depth="reversed")
    np.testing.assert_allclose(seen.depth, 0.3, rtol=1e-7)


def test_culling_keeps_counter_clockwise():
    positions = [[-1, -1, 0, 1], [1, -1, 0, 1], [-1, 1, 0, 1]]
    for face, kept in (([0, 1, 2], "back"), ([0, 2, 1], "front")):
        for cull in ("none", "back", "front"):
            seen = rj.rasterize(positions, [face], (8, 8), cull=cull, threads=1)
            assert (seen.face_id >= 0).any() == (cull in ("none", kept))


def test_input_is_not_changed():
    positions, faces = soup(7, 30)
    before = positions.copy(), faces.copy()
    rj.rasterize(positions, faces, SIZE, threads=1)
    assert (positions == before[0]).all()
    assert (faces == before[1]).all()


GOOD = np.array([[-1.0, -1, 0, 1], [1, -1, 0, 1], [0, 1, 0, 1]])


@pytest.mark.parametrize(
    ("arguments", "options", "name"),
    [
        ((GOOD[:, :3], [[0, 1, 2]], (8, 8)), {}, "clip_positions"),
        ((GOOD[0], [[0, 1, 2]], (8, 8)), {}, "clip_positions"),
        (("no", [[0, 1, 2]], (8, 8)), {}, "clip_positions"),
        ((GOOD, [[0, 1]], (8, 8)), {}, "faces"),
        ((GOOD, [[0, 1, 3]], (8, 8)), {}, "faces"),
        ((GOOD, [[0, 1, -1]], (8, 8)), {}, "faces"),
        ((GOOD, [[0, 1, 0.5]], (8, 8)), {}, "faces"),
        ((GOOD, np.zeros((0, 3), int), (8, 8)), {}, "faces"),
        ((np.zeros((0, 4)), [[0, 1, 2]], (8, 8)), {}, "faces|clip_positions"),
        ((GOOD, [[0, 1, 2]], (0, 8)), {}, "size"),
        ((GOOD, [[0, 1, 2]], (0, 0)), {}, "size"),
        ((GOOD, [[0, 1, 2]], (16385, 8)), {}, "size"),
        ((GOOD, [[0, 1, 2]], (8.5, 8)), {}, "size"),
        ((GOOD, [[0, 1, 2]], 8), {}, "size"),
        ((GOOD, [[0, 1, 2]], (8, 8)), {"cull": "both"}, "cull"),
        ((GOOD, [[0, 1, 2]], (8, 8)), {"depth": "less"}, "depth"),
        ((GOOD, [[0, 1, 2]], (8, 8)), {"threads": 0}, "threads"),
        ((GOOD, [[0, 1, 2]], (8, 8)), {"threads": -2}, "threads"),
        ((GOOD, [[0, 1, 2]], (8, 8)), {"quality": "high"}, "quality"),
    ],
)
def test_wrong_argument_is_named(arguments, options, name):
    with pytest.raises(ValueError, match=name):
        rj.rasterize(*arguments, **options)


def test_weights_are_finite_for_any_w():
    for w in (1e-310, 1e-300, 1.0, 1e140):
        corners = np.array([[-0.5, -0.5, 0.0, 1.0], [0.5, -0.5, 0.0, 1.0], [0.0, 0.5, 0.0, 1.0]])
        seen = rj.rasterize(corners * w, [[0, 1, 2]], (16, 16), threads=1)
        covered = seen.face_id >= 0
        assert covered.any()
        np.testing.assert_allclose(seen.barycentric[covered].sum(axis=1), 1.0, rtol=1e-6)


def test_later_changes_of_the_faces_change_nothing():
    corners = np.array([[-0.5, -0.5, 0.0, 1.0], [0.5, -0.5, 0.0, 1.0], [0.0, 0.5, 0.0, 1.0]])
    faces = np.array([[0, 1, 2]], np.int32)
    seen = rj.rasterize(corners, faces, (16, 16), threads=1)
    faces[:] = 1 << 30
    assert np.isfinite(seen.barycentric).all()


@pytest.mark.parametrize("bits", [8.0, True, False, "8", 7])
def test_quality_takes_listed_whole_numbers_only(bits):
    with pytest.raises(ValueError, match="subpixel_bits"):
        rj.Quality(subpixel_bits=bits)
    assert type(rj.Quality(subpixel_bits=np.uint8(8)).subpixel_bits) is int
