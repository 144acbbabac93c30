"""Fog equals its formula in float64; along a ray through fog that thins out, its integral."""

from __future__ import annotations

import dataclasses
import math

import blocks
import naive_environment as naive
import numpy as np
import pytest

import rasterjit as rj
from rasterjit.effects.fog import FOG, make_fog_record
from rasterjit.effects.fog import stage as fog_stage
from rasterjit.pipeline.passes import ShadingArrays, ShadingNeeds, bind
from rasterjit.pipeline.surface import sample_block as block

FOGS = [
    rj.Fog("#8090a0", "linear", start=2.0, end=9.0),
    rj.Fog("#8090a0", "linear", end=30.0),
    rj.Fog("red", "exp", density=0.2),
    rj.Fog("red", "exp2", density=0.15),
    rj.Fog("white", "exp", density=0.3, height=-1.0, falloff=0.5),
    rj.Fog("white", "exp", density=0.01, height=2.0, falloff=3.0),
    rj.Fog("white", "exp", density=0.4, height=0.0, falloff=1e-3),
]


def cover(samples, record, viewer):
    """Cover samples with fog."""
    arrays = ShadingArrays(None, None, None, None, viewer, None, None)
    passes = FOG.places["sample"](record, ShadingNeeds(0))
    blocks.run(samples, *((one, *own) for one, own in bind(passes, arrays)))


def covered(fog, eye, points, viewer=(0.0, 0.0, 0.0, 1.0)):
    """Return black and white samples at points relative to the eye, covered with fog."""
    camera = rj.PerspectiveCamera(eye=eye, target=(eye[0], eye[1], eye[2] - 1.0))
    samples = np.zeros((block.SAMPLE_ROWS, len(points)), np.float32)
    samples[block.POINT_X : block.POINT_Z + 1] = points.T
    samples[block.OUT_GREEN] = 1.0
    record = make_fog_record(fog, camera)
    # Without the compiler NumPy warns where a density overflows on purpose.
    with np.errstate(over="ignore"):
        cover(samples, record, np.array(viewer, np.float32))
    return samples[block.OUT_RED : block.OUT_BLUE + 1]


@pytest.mark.parametrize("fog", FOGS)
def test_fog_equals_its_formula(fog):
    rng = np.random.default_rng(1)
    eye = (3.0, 1.5, -2.0)
    points = rng.normal(size=(60, 3)) * rng.uniform(0.1, 12.0, (60, 1))
    points[:3] = (0.0, 0.0, 0.0), (0.0, 0.0, -5.0), (4.0, 1e-4, 0.0)
    seen = covered(fog, eye, points.astype(np.float32))
    for n, point in enumerate(points):
        share = naive.fog_share(fog, np.array(eye) + point, eye)
        for k, own in enumerate((0.0, 1.0, 0.0)):
            wanted = own * share + fog.color[k] * (1.0 - share)
            assert seen[k, n] == pytest.approx(wanted, abs=3e-6)


def test_fog_ends_where_it_should():
    points = np.array([[0, 0, -1.0], [0, 0, -2.0], [3.0, 0, -4.0], [0, 0, -1e6]], np.float32)
    fog = rj.Fog("red", "linear", start=2.0, end=5.0)
    red, green, _ = covered(fog, (0.0, 0.0, 0.0), points)
    assert red.tolist() == [0.0, 0.0, 1.0, 1.0]
    assert green.tolist() == [1.0, 1.0, 0.0, 0.0]


def test_a_parallel_view_measures_from_the_plane_of_the_camera():
    points = np.array([[7.0, -3.0, -4.0], [0.0, 0.0, -4.0], [1.0, 1.0, 5.0]], np.float32)
    fog = rj.Fog("red", "exp", density=0.25)
    red, _, _ = covered(fog, (0.0, 0.0, 0.0), points, viewer=(0.0, 0.0, 2.0, 0.0))
    assert red[:2] == pytest.approx(1.0 - math.exp(-1.0), abs=1e-6)
    assert red[0] == red[1]
    assert red[2] == 0.0


@pytest.mark.parametrize("fog", FOGS)
def test_parallel_rays_start_on_the_plane_of_the_camera(fog):
    # Each ray passes the densities between the plane and its own point, not those of the eye.
    rng = np.random.default_rng(5)
    eye, toward = np.array([3.0, 1.5, -2.0]), np.array([0.48, 0.64, 0.6])
    points = (rng.normal(size=(60, 3)) * rng.uniform(0.1, 6.0, (60, 1))).astype(np.float32)
    points = points[points @ toward < 0.0]
    camera = rj.OrthographicCamera(eye=eye, target=eye - toward, height=2.0)
    samples = np.zeros((block.SAMPLE_ROWS, len(points)), np.float32)
    samples[block.POINT_X : block.POINT_Z + 1] = points.T
    viewer = np.array([*toward, 0.0], np.float32)
    cover(samples, make_fog_record(fog, camera), viewer)
    for n, point in enumerate(points.astype(np.float64)):
        on_plane = eye + point - (point @ toward) * toward
        share = naive.fog_share(fog, eye + point, on_plane)
        for k in range(3):
            wanted = fog.color[k] * (1.0 - share)
            assert samples[block.OUT_RED + k, n] == pytest.approx(wanted, abs=3e-6)


@pytest.mark.parametrize("fog", FOGS[2:])
def test_fog_of_density_zero_changes_no_bit(fog):
    rng = np.random.default_rng(2)
    points = (rng.normal(size=(50, 3)) * 100.0).astype(np.float32)
    record = make_fog_record(fog, rj.PerspectiveCamera((0, 0, 1), (0, 0, 0)))
    samples = rng.uniform(0, 4, (block.SAMPLE_ROWS, 50)).astype(np.float32)
    samples[block.POINT_X : block.POINT_Z + 1] = points.T
    before = samples.copy()
    empty = record._replace(fog=dataclasses.replace(fog, density=0.0))
    cover(samples, empty, np.array([0, 0, 0, 1], np.float32))
    assert (samples == before).all()


@pytest.mark.parametrize("height", [-1e15, -1e4, 0.0, 1e4, 1e15])
@pytest.mark.parametrize("falloff", [1e-9, 1.0, 1e9])
def test_extreme_fog_stays_between_the_colours(height, falloff):
    points = np.array([[0, 0, 0], [0, 1e9, 0], [0, -1e9, 0], [1e12, 1, 1]], np.float32)
    fog = rj.Fog("red", "exp", density=1e9, height=height, falloff=falloff)
    seen = covered(fog, (0.0, 0.0, 0.0), points)
    assert np.isfinite(seen).all()
    assert seen.min() >= 0.0
    assert seen.max() <= 1.0
    assert (seen[0] + seen[1] == pytest.approx(1.0, abs=1e-6)) or seen[0, 0] == 0.0


@pytest.mark.parametrize("fog", FOGS)
@pytest.mark.parametrize("viewer", [(0.0, 0.0, 0.0, 1.0), (0.0, 0.6, 0.8, 0.0)])
def test_what_float32_cannot_place_lies_in_fog_or_before_it(fog, viewer):
    points = np.array([[0, 0, 1], [0, 1, 0], [1, -1, 1], [1, 1, -1]], np.float32)
    for bad in (1e30, math.inf, -math.inf, math.nan):
        with np.errstate(invalid="ignore"):
            seen = covered(fog, (0.0, 0.0, 0.0), points * np.float32(bad), viewer)
        assert np.isfinite(seen).all()
        assert (seen >= 0.0).all()
        assert (seen <= 1.0).all()


def test_far_below_its_height_fog_hides_everything():
    fog = rj.Fog("red", "exp", density=1.0, height=1e4, falloff=1.0)
    points = np.array([[0, 0, -1.0], [0, 3.0, -1.0], [0, -3.0, -1.0]], np.float32)
    assert (covered(fog, (0.0, 0.0, 0.0), points)[0] == 1.0).all()


def test_mean_density_keeps_its_error():
    rng = np.random.default_rng(3)
    rises = np.concatenate([rng.uniform(-20, 20, 300), rng.uniform(-0.3, 0.3, 300), [0.25, -0.25]])
    for low, rise in zip(rng.uniform(-9, 9, len(rises)), rises, strict=True):
        low, rise = np.float32(low), np.float32(rise)
        a, b = float(low), float(rise)
        exact = 2.0**-a * (-math.expm1(-b * math.log(2.0)) / (b * math.log(2.0)) if b else 1.0)
        # The density at the eye is good to 4e-7 of itself, the difference of two to 1e-6 over 1/4.
        assert float(fog_stage.compute_mean_density(low, rise)) == pytest.approx(exact, rel=4e-6)
