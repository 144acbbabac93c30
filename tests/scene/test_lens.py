"""Lenses follow OpenCV's formulas, can be inverted, and say where they fold."""

from __future__ import annotations

import math

import naive_lens
import numpy as np
import pytest

import rasterjit as rj

COEFFICIENTS = {
    "none": (),
    "four": (-0.28, 0.07, 2e-4, -3e-4),
    "five": (0.12, -0.05, 1e-3, 2e-3, 0.01),
    "rational": (0.1, 0.02, 1e-3, 2e-3, 0.01, 0.05, 0.02, 0.001),
    "prism": (-0.1, 0.05, 1e-3, 2e-3, 0.01, 0.02, 0.01, 0.003, 0.002, -0.001, 0.003, 0.001),
    "tilted": (-0.1, 0.05, 0, 0.002, 0.01, 0.02, 0.01, 0, 0.002, 0, 0.003, 0.001, 0.05, -0.08),
}  # fmt: skip
FISHEYE = (-0.02, 0.003, 0.001, -0.0005)
POINTS = np.random.default_rng(3).uniform(-0.8, 0.8, (200, 2))
DIRECTIONS = np.random.default_rng(4).normal(size=(200, 3))


@pytest.mark.parametrize("name", COEFFICIENTS)
def test_pinhole_model_is_that_of_opencv(name):
    lens = rj.PinholeDistortion(*COEFFICIENTS[name])
    naive = [naive_lens.distort(point, COEFFICIENTS[name]) for point in POINTS]
    np.testing.assert_allclose(lens.distort(POINTS), naive, atol=2e-15)


@pytest.mark.parametrize("name", COEFFICIENTS)
def test_pinhole_model_agrees_with_opencv_itself(name):
    cv2 = pytest.importorskip("cv2")
    spread = np.column_stack((POINTS, np.ones(len(POINTS))))
    given = np.array(COEFFICIENTS[name] or (0.0,) * 4)
    seen, _ = cv2.projectPoints(spread, np.zeros(3), np.zeros(3), np.eye(3), given)
    lens = rj.PinholeDistortion(*COEFFICIENTS[name])
    np.testing.assert_allclose(lens.distort(POINTS), seen[:, 0], atol=2e-15)


def test_fisheye_model_is_that_of_opencv():
    lens = rj.FisheyeLens(*FISHEYE)
    flat = np.column_stack((POINTS, np.ones(len(POINTS))))
    naive = [naive_lens.distort_fisheye(one, FISHEYE) for one in flat]
    np.testing.assert_allclose(lens.distort(POINTS), naive, atol=2e-15)
    cv2 = pytest.importorskip("cv2")
    seen = cv2.fisheye.distortPoints(POINTS[:, np.newaxis], np.eye(3), np.array(FISHEYE))
    np.testing.assert_allclose(lens.distort(POINTS), seen[:, 0], atol=2e-15)


def test_a_fifth_coefficient_of_a_fisheye_is_no_field_of_view():
    with pytest.raises(TypeError, match="positional"):
        rj.FisheyeLens(*FISHEYE, 0.001)
    assert rj.FisheyeLens(*FISHEYE, fov=190.0).fov == 190.0


def test_fisheye_sees_behind_itself():
    lens = rj.FisheyeLens(k1=0.01)
    naive = [naive_lens.distort_fisheye(one, (0.01,)) for one in DIRECTIONS]
    np.testing.assert_allclose(lens.project(DIRECTIONS), naive, atol=5e-15)
    assert (DIRECTIONS[:, 2] < 0).sum() > 50
    found = lens.unproject(lens.project(DIRECTIONS))
    lengths = np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
    np.testing.assert_allclose(found, DIRECTIONS / lengths, atol=5e-15)
    assert lens.unproject([0.0, 0.0]).tolist() == [0, 0, 1]


@pytest.mark.parametrize("name", COEFFICIENTS)
def test_inverse_of_the_pinhole_model(name):
    lens = rj.PinholeDistortion(*COEFFICIENTS[name])
    np.testing.assert_allclose(lens.undistort(lens.distort(POINTS)), POINTS, atol=5e-15)


def test_inverse_of_lenses_at_random():
    random, checked = np.random.default_rng(7), 0
    for _ in range(200):
        radial, sides = random.normal(size=6) * 0.15, random.normal(size=2) * 0.003
        k1, k2, k3, k4, k5, k6 = radial.tolist()
        lens = rj.PinholeDistortion(k1, k2, *sides.tolist(), k3, k4, k5, k6)
        inside = POINTS[np.hypot(*POINTS.T) < 0.85 * lens._curve.fold]
        np.testing.assert_allclose(lens.undistort(lens.distort(inside)), inside, atol=1e-12)
        checked += len(inside)
    assert checked > 20_000


def test_inverse_does_not_depend_on_what_is_asked_for_besides():
    lens = rj.PinholeDistortion(*COEFFICIENTS["tilted"])
    many = np.random.default_rng(5).uniform(-0.6, 0.6, (5001, 2))
    alone = np.array([lens.undistort(one) for one in many[::50]])
    assert (lens.undistort(many)[::50] == alone).all()


def test_fold_is_named_and_refused():
    # r - r³/2 grows up to r = sqrt(2/3), where it is 0.5443.
    lens = rj.PinholeDistortion(k1=-0.5)
    assert lens._curve.fold == pytest.approx(math.sqrt(2 / 3), rel=1e-12)
    assert lens.undistort([0.544, 0.0])[0] < math.sqrt(2 / 3)
    with pytest.raises(ValueError, match=r"folds beyond a radius of 0\.8165 .* at 0\.5443"):
        lens.undistort([[0.1, 0.1], [0.5, 0.5]])
    fisheye = rj.FisheyeLens(k1=-0.2)
    with pytest.raises(ValueError, match=r"folds beyond an angle of 73\.97 degrees"):
        fisheye.undistort([0.9, 0.0])
    # A pole of the ratio ends it, too; no fold has none.
    assert rj.PinholeDistortion(k4=-0.25)._curve.fold <= 2.0
    assert rj.PinholeDistortion(k1=0.1)._curve.fold == math.inf


def test_field_of_view_ends_a_fisheye():
    lens = rj.FisheyeLens(fov=180.0)
    inside, outside = lens.unproject([[1.57, 0.0], [1.58, 0.0]])
    assert inside[0] == pytest.approx(1.0, abs=1e-6)
    assert outside.tolist() == [0, 0, 0]
    assert np.isnan(lens.project([0.0, 0.0, -1.0])).all()
    with pytest.raises(
        ValueError, match="less than 90 degrees from the axis: its field of view is 180"
    ):
        lens.undistort([1.6, 0.0])
    # It may end before the fold.
    assert rj.FisheyeLens(k1=-0.2, fov=140.0).unproject([3.0, 0.0]).tolist() == [0, 0, 0]
    assert np.isnan(rj.FisheyeLens(k1=-0.2, fov=150.0).unproject([3.0, 0.0])).all()


def test_panorama():
    lens = rj.Equirectangular()
    naive = [naive_lens.panorama(one) for one in DIRECTIONS]
    np.testing.assert_allclose(lens.project(DIRECTIONS), naive, atol=2e-15)
    found = lens.unproject(lens.project(DIRECTIONS))
    lengths = np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
    np.testing.assert_allclose(found, DIRECTIONS / lengths, atol=2e-15)
    # The right of the middle is right, its lower half is below.
    np.testing.assert_allclose(lens.unproject([math.pi / 2, 0]), [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(lens.unproject([0, math.pi / 2]), [0, 1, 0], atol=1e-15)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: rj.PinholeDistortion(k1=math.nan), "k1 must be finite, got nan"),
        (lambda: rj.PinholeDistortion(p2="a"), "p2 must be a number, got 'a'"),
        (lambda: rj.PinholeDistortion(tau_x=2.0), "tau_x must be in -1.5..1.5, got 2.0"),
        (lambda: rj.FisheyeLens(fov=0), "fov must be above 0, got 0"),
        (lambda: rj.FisheyeLens(fov=400), "fov must be in 0..360, got 400"),
        (lambda: rj.FisheyeLens().distort([1.0]), r"points must have shape \(..., 2\), got \(1,\)"),
        (lambda: rj.PinholeDistortion().undistort("ab"), "places must be an array of numbers, got"),
    ],
)
def test_what_is_wrong_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_directions_beside_a_pinhole_are_seen_nowhere():
    for lens in (rj.PinholeDistortion(k1=0.1), rj.PinholeDistortion(k1=-0.1)):
        directions = [[1, 0, 0], [0, -1, 0], [0, 0, 0], [1, 1, 1e-20], [0, 0, -1], [0, 0, 1]]
        places = lens.project(directions)
        assert np.isnan(places[:-1]).all()
        assert places[-1].tolist() == [0.0, 0.0]
