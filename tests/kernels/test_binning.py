"""Every tile lists every triangle that may touch it, in ascending order."""

from __future__ import annotations

import naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.inspect import oracle
from rasterjit.pipeline.geometry import binning
from rasterjit.pipeline.records import Faces, Objects
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.runtime import threads

SIZE = (256, 128)
COLUMNS, ROWS = 4, 2


def random_screen(rng, count):
    middles = np.repeat(rng.uniform(-20, 270, (count, 2)), 3, axis=0)
    reach = np.repeat(rng.choice([2.0, 20.0, 150.0], count), 3)[:, np.newaxis]
    points = np.round((middles + rng.uniform(-1, 1, (3 * count, 2)) * reach) * 256) / 256
    return points, np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def bin_faces(points, faces):
    """Return the list of each tile."""
    viewport, workers = make_viewport(SIZE, 8), threads.Workers(1)
    positions = naive.clip_from_screen(points, SIZE)
    screen, _ = visibility_pass.project_to_screen(positions, (0.0, -1.0, 0.0), viewport, workers)
    objects = Objects(np.array([0, len(faces)], np.int64), np.zeros(1, np.int8))
    everything = Faces(faces, np.empty((0, 3), np.int32), np.empty(0, np.int32))
    starts, binned, _, _ = visibility_pass.set_up_and_bin(
        everything, objects, screen, viewport, workers
    )
    return [binned[starts[k] : starts[k + 1]].tolist() for k in range(len(starts) - 1)]


def run_kernel(triangles, boxes, cursors, length):
    """Bin triangles of 4 tiles a row; face 0 is the half of 2 x 2 tiles at their top left."""
    viewport, workers = make_viewport(SIZE, 8), threads.Workers(1)
    positions = naive.clip_from_screen([(0, 0), (128, 0), (0, 128)], SIZE)
    screen, _ = visibility_pass.project_to_screen(positions, (0.0, -1.0, 0.0), viewport, workers)
    faces = Faces(
        np.array([[0, 1, 2]], np.int32), np.empty((0, 3), np.int32), np.empty(0, np.int32)
    )
    binned = np.full(length, -1, np.int32)
    binning.bin_triangles(
        np.array(triangles, np.int32), np.array(boxes, np.uint8).reshape(-1, 4), COLUMNS, faces,
        screen, viewport, cursors, binned,
    )  # fmt: skip
    return binned.tolist()


def test_kernel_fills_the_boxes():
    boxes = [[0, 0, 1, 1], [1, 0, 1, 0], [0, 0, 2, 0], [1, 0, 1, 0], [2, 0, 2, 1]]
    # Lists of 2, 4, 2, 0 and 1, 0, 1, 0; the tile (1, 1) is beyond the hypotenuse.
    cursors = np.array([0, 2, 6, 8, 8, 9, 9, 10], np.int64)
    binned = run_kernel([0, 3, 5, 7, 8], boxes, cursors, 10)
    assert binned == [0, 5, 0, 3, 5, 7, 5, 8, 0, 8]
    assert cursors.tolist() == [2, 6, 8, 8, 9, 9, 10, 10]


def test_nothing_to_bin():
    cursors = np.zeros(8, np.int64)
    assert run_kernel([], [], cursors, 0) == []
    assert not cursors.any()


def test_every_chunk_has_its_own_place_in_every_list():
    counts = np.array([[2, 0, 1, 9], [1, 3, 0, 9]], np.int32)
    starts, cursors = np.full(4, -1, np.int64), np.full((2, 3), -1, np.int64)
    binning.start_lists(counts, starts, cursors)
    assert starts.tolist() == [0, 3, 6, 7]
    assert cursors.tolist() == [[0, 3, 6], [2, 3, 7]]


def test_tiles_list_the_faces_whose_pixels_they_hold():
    rng = np.random.default_rng(1)
    points, faces = random_screen(rng, 40)
    lists = bin_faces(points, faces)
    assert len(lists) == COLUMNS * ROWS
    for face, corners in enumerate(faces):
        touched = {
            (j // 64) * COLUMNS + i // 64
            for i, j in oracle.covered_pixels(points[corners].tolist(), SIZE)
        }
        listed = {tile for tile, members in enumerate(lists) if face in members}
        assert touched <= listed
        x, y = points[corners].T
        for tile in listed:
            left, top = tile % COLUMNS * 64, tile // COLUMNS * 64
            assert x.min() < left + 64
            assert x.max() > left
            assert y.min() < top + 64
            assert y.max() > top


@pytest.mark.parametrize("per_task", [1, 7, 1000])
def test_lists_ascend_whatever_the_tasks(monkeypatch, per_task):
    rng = np.random.default_rng(2)
    points, faces = random_screen(rng, 60)
    expected = bin_faces(points, faces)
    monkeypatch.setattr(visibility_pass, "FACES_PER_TASK", per_task)
    lists = bin_faces(points, faces)
    assert lists == expected
    for members in lists:
        assert members == sorted(set(members))


def test_image_of_many_tiles_lists_the_last_one():
    # 256 tiles a side: tile numbers of a row reach 255, the end of their uint8.
    size = (16384, 64)
    positions = naive.clip_from_screen([(16383, 0), (16384, 0), (16384, 64), (0, 0), (0, 64)], size)
    seen = rj.rasterize(positions, [[0, 1, 2], [3, 0, 4]], size, threads=1)
    assert seen.face_id[10, 16383] == 0
    assert seen.face_id[10, 0] == 1
