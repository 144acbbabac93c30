"""What is kept of each view of a batch, beside NumPy."""

from __future__ import annotations

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.pipeline import batch_driver
from rasterjit.rendering.batch_scheduler import depth_conversion

FACES = np.array([[0, -1, 2], [3, 3, -1]], np.int32)


def test_pictures_are_copied_to_their_rows():
    kept = np.zeros((3, 6), np.uint32)
    picture = np.arange(6, dtype=np.uint32) << np.uint32(28)
    batch_driver.copy_picture(1, picture, kept)
    assert kept.tolist() == [[0] * 6, picture.tolist(), [0] * 6]


def test_numbers_are_those_of_faces():
    kept = np.zeros((2, 2, 3), np.int32)
    batch_driver.write_face_values(1, FACES, 1, np.array([5, 6, 7, 8, -1], np.int32), kept)
    assert kept.tolist() == [[[0] * 3] * 2, [[5, -1, 7], [8, 8, -1]]]


def test_numbers_are_of_every_few_rows_and_columns():
    faces, kept = np.arange(35, dtype=np.int32).reshape(5, 7), np.zeros((1, 3, 4), np.int32)
    batch_driver.write_face_values(0, faces, 2, 10 * np.arange(36, dtype=np.int32), kept)
    assert kept[0].tolist() == (10 * faces[::2, ::2]).tolist()


def test_white_is_counted_where_it_is_lit():
    codes = np.random.default_rng(3).choice([253, 254, 255], (6, 9, 4)).astype(np.uint8)
    lit = np.random.default_rng(4).integers(-1, 2, (1, 2, 3)).astype(np.int32)
    counts = np.full(2, 7)
    batch_driver.count_white(lit, 3, codes.view(np.uint32)[..., 0], counts)
    seen = codes[::3, ::3][lit[0] == 1]
    assert counts.tolist() == [len(seen), sum(min(code[:3]) >= 254 for code in seen.tolist())]


@pytest.mark.parametrize(
    "camera",
    [
        rj.PerspectiveCamera((0, 0, 4), (0, 0, 0), near=0.3),
        rj.OrthographicCamera((0, 0, 4), (0, 0, 0), near=-1.0, far=7.0),
        rj.MatrixCamera(np.eye(4), 2.0 * rj.PerspectiveCamera(
            (0, 0, 4), (0, 0, 0), near=0.3).projection_matrix((2, 2))),
        rj.MatrixCamera(np.eye(4), 2.0 * rj.OrthographicCamera(
            (0, 0, 4), (0, 0, 0)).projection_matrix((2, 2))),
    ],
    ids=["perspective", "parallel", "matrix", "parallel matrix"],
)  # fmt: skip
def test_depths_have_the_bits_of_the_camera(camera):
    stored = np.random.default_rng(1).random((2, 3)).astype(np.float32)
    way, *factors = depth_conversion(camera)
    found = np.zeros((2, 2, 3), np.float32)
    batch_driver.measure_depths(1, np.array([way]), np.array(factors), stored, FACES, found)
    wanted = np.where(FACES >= 0, camera.view_depth(stored), np.inf).astype(np.float32)
    assert found[1].tobytes() == wanted.tobytes()


@pytest.mark.parametrize("is_parallel", [0, 1])
def test_distances_are_from_the_eye_or_its_plane(is_parallel):
    points = np.random.default_rng(2).normal(0.0, 3.0, (2, 3, 3)).astype(np.float32)
    points[0, 1] = np.nan
    found = np.zeros((2, 2, 3), np.float32)
    axis = np.array([0.0, 0.6, 1.6, 2.0])
    batch_driver.measure_distances(1, np.array([is_parallel]), axis, points, found)
    x, y, z = np.moveaxis(points.astype(np.float64), 2, 0)
    wanted = -(0.6 * y + 1.6 * z) / 2.0 if is_parallel else np.sqrt((x * x + y * y) + z * z)
    assert np.isinf(found[1, 0, 1])
    wanted[0, 1] = np.inf
    np.testing.assert_allclose(found[1], wanted, rtol=1e-6)
