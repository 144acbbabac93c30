"""Weights of faces that were clipped, in float64, have the bits of one sample after the other."""

from __future__ import annotations

import numpy as np
import pytest

from rasterjit.pipeline.geometry.barycentric import fill_barycentric
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.surface.listing import list_samples
from rasterjit.pipeline.surface.samples import (
    BEHIND,
    COUNTS,
    INTERVAL_COLUMN,
    INTERVAL_ROW,
    INTERVAL_START,
    INTERVAL_STOP,
    INTERVALS,
    Block,
)
from rasterjit.pipeline.surface.weights import find_weights
from rasterjit.pipeline.visibility import draw
from rasterjit.pipeline.visibility.draw import viewport_of
from rasterjit.rendering.stage_list import BLOCK, BLOCKS
from rasterjit.runtime import threads
from rasterjit.runtime.driver import StageList, Step
from rasterjit.runtime.jit import stage
from rasterjit.runtime.state import float64

SIZE = 64, 64
TOWARD = np.array([0.0, 0.0, 1.0, 0.0])
"""A viewer far away."""
TRIANGLES = {
    "passes the eye": [(-9.0, -4.0, 0.0, 1.0), (9.0, -5.0, 0.0, 1.0), (0.3, 2.0, -1.0, -0.5)],
    "is wider than the guard band": [
        (-9000.0, -4.0, 0.0, 1.0),
        (9000.0, -5.0, 0.0, 1.0),
        (0.3, 9.0, 0.5, 2.0),
    ],
}
"""Clip positions, x y z w, of triangles that are cut."""


@stage
def take_weights(block: Block, count, taken: float64[:, :, ::1]):
    """Write the weights of a block to the pixels of its samples, and which side is seen."""
    for k in range(block.counts[INTERVALS]):
        interval = block.intervals[k]
        row, column = interval[INTERVAL_ROW], interval[INTERVAL_COLUMN]
        start = interval[INTERVAL_START]
        for n in range(interval[INTERVAL_STOP] - start):
            taken[row, column + n, 0] = block.weights[0, start + n]
            taken[row, column + n, 1] = block.weights[1, start + n]
            taken[row, column + n, 2] = block.whole[BEHIND, start + n]


def weigh(positions, face_id, mirrored=1.0):
    """Return the weights of the second and third vertex and the side seen, and all in float32."""
    faces = np.array([(0, 1, 2)], np.int32)
    viewport = viewport_of(SIZE, 8)
    screen, _ = draw.project(positions, (0.0, -1.0, 0.0), viewport, threads.Workers(1))
    assert screen.codes.any()
    geometry = Geometry(faces, screen.xy, screen.codes, screen.w, positions, viewport)
    same = np.eye(3, 4)[np.newaxis]
    placement = Placement(
        np.array([0, 1]), np.ascontiguousarray(positions[:, :3]), same,
        np.ascontiguousarray(same[:, :, :3]), np.array([mirrored]), np.array([1.0]),
        TOWARD,
    )  # fmt: skip
    taken, slow = np.full((*SIZE, 3), np.nan), np.empty((*SIZE, 3), np.float32)
    listed = (
        face_id, 0, SIZE[1], faces, np.array([0, 1]), np.zeros(4, np.float32), 0,
        np.empty((SIZE[1], 0, 4), np.float32), np.empty((SIZE[1], 0), np.uint32),
    )  # fmt: skip
    BLOCKS.block[:COUNTS] = 0
    steps = [
        Step(list_samples, listed), Step(find_weights, (geometry, placement)),
        Step(take_weights, (taken,)),
    ]  # fmt: skip
    StageList(steps).run(BLOCKS.block, BLOCK)
    fill_barycentric(face_id, (0, SIZE[1]), geometry, slow)
    return taken, slow


@pytest.mark.parametrize("triangle", TRIANGLES)
def test_weights_of_a_clipped_face_are_those_of_each_sample_in_runs_of_any_length(triangle):
    positions = np.array(TRIANGLES[triangle])
    whole, slow = weigh(positions, np.zeros(SIZE, np.int32))
    assert len(np.unique(whole[:, :, 0])) > 1000
    assert np.float32(whole[:, :, :2]).tobytes() == slow[:, :, 1:].tobytes()
    for step in (2, 3, 6, 11, 17, 40):
        face_id = np.zeros(SIZE, np.int32)
        face_id[:, step - 1 :: step] = -1
        taken, _ = weigh(positions, face_id)
        assert taken[face_id == 0].tobytes() == whole[face_id == 0].tobytes()


def test_a_clipped_face_shows_one_side_which_a_mirrored_object_turns_round():
    positions = np.array(TRIANGLES["passes the eye"])
    face_id = np.zeros(SIZE, np.int32)
    sides = [weigh(positions, face_id, mirrored)[0][:, :, 2] for mirrored in (1.0, -1.0)]
    assert [len(np.unique(side)) for side in sides] == [1, 1]
    assert sides[0][0, 0] != sides[1][0, 0]
