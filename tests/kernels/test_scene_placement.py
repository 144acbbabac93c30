"""Matrices have the bits of products in Python; boxes are measured as their eight corners lie."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from rasterjit.pipeline.geometry import scene_placement
from rasterjit.scene import transforms as tf
from rasterjit.survey.object_transforms import (
    measure_boxes,
    move_objects,
    place_views,
    transform_objects,
)


def random_matrices(rng):
    """Return matrices, (600, 4, 4): common ones, singular, mirrored, of all sizes, of zeros."""
    linear = rng.normal(size=(600, 4, 4))
    linear[:, 3] = 0.0, 0.0, 0.0, 1.0
    linear[100:200] = np.round(linear[100:200])  # Singular ones, and zeros of both signs.
    linear[200:300, :3] *= 10.0 ** rng.integers(-160, 160, (100, 1, 1))
    linear[300:400, :3] *= 10.0 ** rng.integers(-300, 300, (100, 3, 4))
    linear[400:450, rng.integers(3)] *= -0.0
    linear[450:475, :3] *= 5e-324 / 1e-2
    linear[475:500, :3] *= 1e307
    linear[500, :3, :3] = 0.0
    return linear


def exact_determinant(matrix):
    """Return the determinant of a 3x3 part, and the size of its terms."""
    (a, b, c), (d, e, f), (g, h, i) = [[Fraction(x) for x in row[:3]] for row in matrix[:3]]
    terms = a * e * i, -a * f * h, -b * d * i, b * f * g, c * d * h, -c * e * g
    return sum(terms), max(map(abs, terms))


def test_normals_have_the_bits_of_one_matrix_alone():
    matrices = random_matrices(np.random.default_rng(11))
    found = transform_objects(list(matrices))
    told = 0
    for n, matrix in enumerate(matrices):
        wanted = tf.normal_matrix(matrix)
        largest = np.abs(wanted).max()
        wanted = wanted / largest if largest > 0.0 else wanted
        assert found.normal_matrices[n].tobytes() == wanted.tobytes(), n
        determinant, size = exact_determinant(matrix.tolist())
        if abs(determinant) > size / 10**12:
            assert found.mirrored[n] == (-1.0 if determinant < 0 else 1.0)
            told += 1
        else:
            assert abs(found.mirrored[n]) == 1.0
    assert told > 400


def test_only_what_was_turned_is_found_anew():
    before, rng = random_matrices(np.random.default_rng(2)), np.random.default_rng(3)
    after = before.copy()
    after[:, :3, 3] += 1.0
    after[::2, :3, :3] = rng.normal(size=(300, 3, 3))
    after[1, :3, :3][before[1, :3, :3] == 0.0] *= -1.0
    known, wanted = transform_objects(list(before)), transform_objects(list(after))
    found = move_objects(known, list(after), range(600))
    for own, other in zip(found, wanted, strict=True):
        assert own.tobytes() == other.tobytes()
    results = found.normal_matrices.copy(), found.mirrored.copy()
    count = scene_placement.transform_normals(
        after, known.world_from_model, *results, np.empty((3, 3))
    )
    assert count == 300
    some = list(before[:3])
    some[1] = after[1]
    shifted = move_objects(transform_objects(list(before[:3])), some, [1])
    assert shifted.world_from_model[1].tobytes() == after[1].tobytes()


def test_views_are_products_of_their_matrices():
    rng, count = np.random.default_rng(8), 60
    eyes = rng.normal(size=(count, 3)) * 10.0 ** rng.integers(-3, 8, (count, 1))
    views = np.array([tf.rotate(rng.normal(size=3), 50.0 * k) for k in range(count)])
    views[:, :3, 3] = rng.normal(size=(count, 3))
    clips = np.array([tf.perspective(50.0, 1.5, 0.1, 10.0)] * count)
    clips[::2] = tf.orthographic(-1.0, 2.0, -1.0, 1.0, 0.5, 9.0)
    clips[::3, 0] *= -1.0  # As seen in a mirror.
    clips[1::5, :3] *= 1e200
    clips[4] *= 1e308
    eyes[4] = 10.0
    found = place_views(eyes, views, clips)
    assert found.is_finite.tolist() == [n != 4 for n in range(count)]
    for n in np.flatnonzero(found.is_finite).tolist():
        relative = tf.translate(eyes[n])
        wanted = tf.compose(clips[n], tf.compose(views[n], relative))
        assert found.clip_from_relative[n].tolist() == wanted.tolist()
        assert found.screen_winding[n] == (-1 if n % 3 == 0 else 1)
        if n % 2:
            assert found.toward_viewer[n].tolist() == [0.0, 0.0, 0.0, 1.0]
        else:
            away = clips[n, 2, :3] @ views[n, :3, :3]
            assert np.allclose(found.toward_viewer[n, :3], -away, rtol=1e-12)
            assert found.toward_viewer[n, 3] == 0.0


def test_boxes_lie_where_their_corners_lie():
    rng, views, count = np.random.default_rng(5), 40, 6
    bounds = np.sort(rng.normal(size=(count, 2, 3)), axis=1)
    bounds[2], bounds[3, 1] = np.nan, bounds[3, 0]
    matrices = np.tile(np.eye(4), (views, count, 1, 1))
    matrices[..., :3, :] = rng.normal(size=(views, count, 3, 4)) * (2.0, 2.0, 2.0, 6.0)
    clip = rng.normal(size=(views, 4, 4))
    found = measure_boxes(bounds, matrices, clip)
    assert 50 < found.in_view.sum() < 150
    for n in range(views):
        single = measure_boxes(bounds, matrices[n : n + 1], clip[n : n + 1])
        for own, other in zip(found.select_views(n), single.select_views(0), strict=True):
            assert own.tobytes() == other.tobytes()
        all_corners = []
        for o in range(count):
            if o == 2:
                assert found.is_beside[n, o]
                assert not found.in_view[n, o]
                continue
            ends = [bounds[o, [k & 1, k >> 1 & 1, k >> 2 & 1], range(3)] for k in range(8)]
            corners = [matrices[n, o] @ [*end, 1.0] for end in ends]
            all_corners += [corner[:3] for corner in corners]
            x, y, z, w = clip[n] @ np.transpose(corners)
            distances = np.array([w - x, w - y, w - z, w + x, w + y, w + z])
            inside = distances.max(axis=1)
            assert np.allclose(found.inside[:, n, o], inside, rtol=0.0, atol=1e-12)
            assert found.in_view[n, o] == (inside >= 0.0).all()
            assert found.is_beside[n, o] == (inside[[0, 1, 3, 4]] < 0.0).any()
            spans = 2.0 * found.half_depths[:, :, n, o].sum(axis=1)
            assert np.allclose(spans, np.ptp(distances[[2, 5]], axis=1), rtol=1e-12)
            for bound, coordinate in zip(found.clip_bounds[:, n, o], (x, y, z), strict=True):
                assert (np.abs(w) + np.abs(coordinate)).max() <= bound * (1.0 + 1e-12)
        low, high = np.min(all_corners, axis=0), np.max(all_corners, axis=0)
        assert np.allclose(found.ends[n], [*low, *high], rtol=0.0, atol=1e-12)


def test_what_overflows_is_in_view_and_anywhere():
    bounds = np.array([[[-1e308] * 3, [1e308] * 3], [[-1.0] * 3, [1.0] * 3]])
    matrices = np.tile(np.eye(4), (1, 2, 1, 1))
    matrices[0, 0] *= 1e10
    found = measure_boxes(bounds, matrices, np.eye(4)[np.newaxis])
    assert found.in_view.tolist() == [[True, True]]
    assert found.ends.tolist() == [[-np.inf] * 3 + [np.inf] * 3]
