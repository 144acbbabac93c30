"""Weights in float64 have the bits of one sample after the other, in runs of any length."""

from __future__ import annotations

import numpy as np
import pytest

from rasterjit.pipeline.geometry.barycentric import fill_barycentric
from rasterjit.pipeline.records import Geometry, Placement
from rasterjit.pipeline.surface.barycentric_weights import find_weights
from rasterjit.pipeline.surface.gather_samples import list_samples
from rasterjit.pipeline.surface.sample_block import (
    BACKFACE,
    COUNT_ELEMENTS,
    INTERVAL_COLUMN,
    INTERVAL_COUNT,
    INTERVAL_ROW,
    INTERVAL_START,
    INTERVAL_STOP,
    Block,
)
from rasterjit.pipeline.visibility import visibility_pass
from rasterjit.pipeline.visibility.visibility_pass import make_viewport
from rasterjit.rendering.pass_runner import BLOCK, THREAD_BLOCK
from rasterjit.runtime import threads
from rasterjit.runtime.jit import stage
from rasterjit.runtime.stage_runner import StageList, Step
from rasterjit.runtime.state_block import float64

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
    for k in range(block.counts[INTERVAL_COUNT]):
        interval = block.intervals[k]
        row, column = interval[INTERVAL_ROW], interval[INTERVAL_COLUMN]
        start = interval[INTERVAL_START]
        for n in range(interval[INTERVAL_STOP] - start):
            taken[row, column + n, 0] = block.weights[0, start + n]
            taken[row, column + n, 1] = block.weights[1, start + n]
            taken[row, column + n, 2] = block.ints[BACKFACE, start + n]


def weigh(positions, face_id, mirrored=1.0):
    """Return the weights of the second and third vertex and the side seen, and all in float32."""
    faces = np.array([(0, 1, 2)], np.int32)
    viewport = make_viewport(SIZE, 8)
    screen, _ = visibility_pass.project_to_screen(
        positions, (0.0, -1.0, 0.0), viewport, threads.Workers(1)
    )
    assert screen.codes.any()
    geometry = Geometry(faces, screen.xy, screen.codes, screen.w, positions, viewport)
    taken, slow = weigh_all(geometry, face_id, mirrored), np.empty((*SIZE, 3), np.float32)
    places = np.zeros(len(faces), np.uint8)
    fill_barycentric(face_id, (0, SIZE[1]), geometry, places, slow)
    return taken, slow


def weigh_all(geometry, face_id, mirrored=1.0):
    """Return the weights of the second and third vertex of a face, and the side seen."""
    faces, positions = geometry.faces, geometry.clip_positions
    same = np.eye(3, 4)[np.newaxis]
    placement = Placement(
        np.array([0, 1]), np.ascontiguousarray(positions[:, :3]), same,
        np.ascontiguousarray(same[:, :, :3]), np.array([mirrored]), np.array([1.0]),
        TOWARD,
    )  # fmt: skip
    taken = np.full((*SIZE, 3), np.nan)
    listed = (
        face_id, 0, SIZE[1], faces, np.array([0, 1]), np.zeros(4, np.float32), 0,
        np.empty((SIZE[1], 0, 4), np.float32), np.empty((SIZE[1], 0), np.uint32),
    )  # fmt: skip
    THREAD_BLOCK.block[:COUNT_ELEMENTS] = 0
    steps = [
        Step(list_samples, listed), Step(find_weights, (geometry, placement)),
        Step(take_weights, (taken,)),
    ]  # fmt: skip
    StageList(steps).run(THREAD_BLOCK.block, BLOCK)
    return taken


def weights_one_by_one(corners, w, bits):
    """Return what `weigh_all` should of each pixel: edge functions are whole numbers of Python."""
    found = np.empty((*SIZE, 3))
    for row, column in np.ndindex(*SIZE):
        px, py = ((2 * at + 1) << (bits - 1) for at in (column, row))
        edges = [
            (cx - bx) * (py - by) - (cy - by) * (px - bx)
            for (bx, by), (cx, cy) in ((corners[n - 2], corners[n - 1]) for n in range(3))
        ]
        parts = [float(edge) for edge in edges]
        if w is None:
            over = 1.0 / float(sum(edges))
            found[row, column, :2] = parts[1] * over, parts[2] * over
        else:
            parts = [part * (min(w) / own) for part, own in zip(parts, w, strict=True)]
            total = parts[0] + parts[1] + parts[2]
            found[row, column, :2] = parts[1] / total, parts[2] / total
        found[row, column, 2] = sum(edges) < 0
    return found


FACES = {
    "in view": (8, [(-3.25, -2.5), (150.0, -7.75), (-20.125, 180.5)]),
    "a sliver": (8, [(-3000.5, -2000.25), (3101.25, 2103.5), (31.0, 32.25)]),
    "from side to side": (12, [(-8180.0, -8180.0), (24500.25, -8100.5), (-8000.5, 24501.0)]),
    "larger than float64 holds": (12, [(-8.5, -8.25), (24492.25, -8.5), (-8.75, 21981.0)]),
}
"""Bits of the grid, and corners in pixels."""
ODD = (0, 0), (1, 0), (0, 1)


@pytest.mark.parametrize("w", [None, (1.0, 0.3, 5.7)], ids=["affine", "perspective"])
@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1)], ids=["front", "back"])
@pytest.mark.parametrize("face", FACES)
def test_weights_of_a_whole_face_are_those_of_whole_numbers_rounded_once(face, order, w):
    bits, points = FACES[face]
    # Some odd, so that edge functions call for all their bits.
    units = [
        [int(at * 2**bits) + own for at, own in zip(points[n], ODD[n], strict=True)]
        for n in range(3)
    ]
    corners = [units[n] for n in order]
    viewport = make_viewport((16384, 16384), bits, (0, 0, *SIZE))
    geometry = Geometry(
        np.array([(0, 1, 2)], np.int32), np.array(corners, np.int32), np.zeros(3, np.uint8),
        np.array([] if w is None else w), np.zeros((3, 4)), viewport,
    )  # fmt: skip
    want = weights_one_by_one(corners, w, bits)
    assert len(np.unique(want[:, :, 2])) == 1
    # A face is clipped to its samples by visibility; a sliver's are few.
    inside = (want[:, :, :2] >= 0).all(axis=2) & (want[:, :, 0] + want[:, :, 1] <= 1)
    assert inside.sum() > 30
    for step in (64, 41, 17, 6, 2):
        face_id = np.where(inside, np.int32(0), np.int32(-1))
        face_id[:, step - 1 :: step] = -1
        shown = face_id == 0
        assert weigh_all(geometry, face_id)[shown].tobytes() == want[shown].tobytes()


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
