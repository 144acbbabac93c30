"""What is prepared of a sky: irradiance and filtered pictures equal sums over all texels."""

from __future__ import annotations

import gc
from functools import cache

import naive_environment as naive
import numpy as np
import pytest
import skies

import rasterjit as rj
from rasterjit.effects.environment import prefilter as maps
from rasterjit.effects.environment.stage import ROUGH_LEVELS
from rasterjit.runtime.threads import Workers


def irradiance(light, normal):
    """Return the irradiance over pi for a normal, from its three parts."""
    x, y, z = normal
    build_basis = np.array([1, x, y, z, x * y, y * z, z * x, 3 * y * y - 1, x * x - z * z])
    total = build_basis @ light.terms.astype(np.float64)
    if len(light.bands):
        bands = [np.polynomial.legendre.Legendre.basis(degree)(y) for degree in (4, 6)]
        total += np.array(bands) @ light.bands.astype(np.float64)
    for spot in light.spots.astype(np.float64):
        total += max(spot[:3] @ normal, 0.0) * spot[3:]
    return np.maximum(total, 0.0)


def units(seed, count):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def levels_of(reflections):
    for first, width, height in reflections.levels.tolist():
        yield reflections.texels[first : first + width * height].reshape(height, width, 3)


@pytest.mark.parametrize("size", [(64, 32), (100, 37), (7, 5), (1, 1)])
def test_a_picture_of_one_colour_is_that_colour(size):
    color = np.array([0.25, 0.5, 3.0], np.float32)
    sky = rj.Environment(np.broadcast_to(color, (size[1], size[0], 3))).sky
    light = maps._compute_irradiance(sky)
    assert light.terms[0] == pytest.approx(color, rel=1e-6)
    assert np.abs(light.terms[1:]).max() < 1e-6
    assert np.abs(light.bands).max() < 1e-6
    assert len(light.spots) == 0
    for level in levels_of(maps._filter_reflections(sky, Workers(1))):
        assert np.abs(level / color - 1.0).max() < 3e-5


def test_smooth_light_is_met_closely():
    d = skies.directions(256, 128)
    image = (2.0 + d[..., :1] + 0.5 * d[..., 1:2] * d[..., 2:] + 0.25 * d[..., 2:] ** 2).repeat(
        3, 2
    )
    light = maps._compute_irradiance(rj.Environment(image).sky)
    for normal in units(2, 100):
        assert irradiance(light, normal) == pytest.approx(naive.irradiance(image, normal), rel=3e-4)


def test_a_gradient_is_projected_in_closed_form():
    environment = rj.Environment.gradient((0.1, 0.2, 0.9), (0.9, 0.8, 0.7), (0.3, 0.2, 0.1))
    sky = environment.sky
    closed = maps._compute_irradiance(sky)
    image = np.array([[naive.gradient(sky, d) for d in row] for row in skies.directions(2, 256)])
    summed = maps._compute_irradiance(rj.Environment(image.repeat(64, axis=1)).sky)
    assert np.abs(closed.terms - summed.terms).max() < 2e-4
    assert np.abs(closed.bands - summed.bands).max() < 5e-5
    assert len(closed.spots) == len(summed.spots) == 0


def test_bright_spots_are_few_and_lie_where_the_light_is():
    sun, brightness = np.array([0.6, 0.55, 0.5]) / np.linalg.norm([0.6, 0.55, 0.5]), 4000.0
    image = skies.sunny(256, 128, sun=sun, brightness=brightness, degrees=3.0)
    spots = maps._find_bright_spots(maps._resize(image, 128))
    assert len(spots) == 1
    assert np.degrees(np.arccos(spots[0, :3] @ sun)) < 0.5
    solid_angle = 2.0 * np.pi * (1.0 - np.cos(np.radians(3.0)))
    want = brightness * np.array([1.0, 0.9, 0.75]) * solid_angle / np.pi
    assert spots[0, 3:] == pytest.approx(want, rel=0.03)
    # Far more small lights than there may be spots: the brightest are taken.
    many = np.zeros((64, 128, 3), np.float32)
    many[8:-8:8, ::12] = 1.0
    assert len(maps._find_bright_spots(many)) == maps.MAX_SPOTS


@cache
def small_sun():
    """Return a sky, and its filtered pictures."""
    image = skies.sunny(256, 128, brightness=50.0, degrees=4.0)
    return image, list(levels_of(maps._filter_reflections(rj.Environment(image).sky, Workers(2))))


@pytest.mark.parametrize("level", range(1, ROUGH_LEVELS + 1))
def test_a_filtered_picture_is_the_mean_over_its_lobe(level):
    image, filtered = small_sun()
    picture = filtered[level - 1]
    height, width = picture.shape[:2]
    roughness = 2.0 ** ((level - ROUGH_LEVELS) / 2)
    rng = np.random.default_rng(level)
    errors = []
    for row, column in zip(rng.integers(0, height, 30), rng.integers(0, width, 30), strict=True):
        exact = naive.mirrored(image, skies.directions(width, height)[row, column], roughness)
        errors.append(np.abs(picture[row, column] - exact) / exact)
    # Coarse copies blur the sun by a quarter of its distance from the middle of the lobe.
    assert np.median(errors) < 0.01
    assert np.max(errors) < 0.4


def test_the_roughest_is_the_light_on_a_matt_surface():
    image = skies.sunny(128, 64, brightness=5.0, degrees=10.0)
    roughest = list(levels_of(maps._filter_reflections(rj.Environment(image).sky, Workers(1))))[-1]
    height, width = roughest.shape[:2]
    for row, column in ((0, 0), (5, 20), (16, 60), (31, 3)):
        normal = skies.directions(width, height)[row, column]
        assert roughest[row, column] == pytest.approx(naive.irradiance(image, normal), rel=0.02)


def test_light_is_kept_when_a_picture_is_scaled():
    rng = np.random.default_rng(3)
    image = rng.uniform(0, 9, (37, 100, 3)).astype(np.float32)
    want = (image * skies.solid_angles(100, 37)[..., None]).sum(axis=(0, 1), dtype=np.float64)
    for width in (1024, 128, 64):
        scaled = maps._resize(image, width)
        areas = skies.solid_angles(width, width // 2)[..., None]
        assert scaled.shape == (width // 2, width, 3)
        assert (scaled * areas).sum(axis=(0, 1), dtype=np.float64) == pytest.approx(want, rel=1e-5)


def test_a_picture_that_fits_is_not_scaled():
    image = skies.sunny(128, 64)
    assert maps._resize(image, 128) is image


def test_any_number_of_threads_prepares_the_same_bits():
    sky = rj.Environment(skies.sunny(256, 128)).sky
    one, three = (maps._filter_reflections(sky, Workers(n)) for n in (1, 3))
    assert (one.texels == three.texels).all()
    assert (one.levels == three.levels).all()


def test_a_sky_is_prepared_once_and_let_go(monkeypatch):
    calls = []
    filtered = maps._filter_reflections
    monkeypatch.setattr(maps, "_filter_reflections", lambda *a: calls.append(a[0]) or filtered(*a))
    # Skies of other tests may be about to go.
    gc.collect()
    before = len(maps._filtered_skies)
    environment = rj.Environment(skies.sunny(64, 32))
    workers = Workers(1)
    unmirrored = maps.make_light_record(environment, False, workers)
    assert unmirrored.reflections is maps.NO_REFLECTIONS
    assert calls == []
    first = maps.make_light_record(environment, True, workers)
    turned = rj.Environment(environment.sky, intensity=2.0, rotation=90.0)
    second = maps.make_light_record(turned, True, workers)
    assert second.reflections is first.reflections
    assert len(calls) == 1
    assert (first.intensity, second.intensity) == (1.0, 2.0)
    assert second.yaw.tolist() == [0.0, 1.0]
    calls.clear()
    del environment, turned, first, second, unmirrored
    gc.collect()
    assert len(maps._filtered_skies) == before


def test_one_colour_is_not_filtered():
    reflections = maps._filter_reflections(rj.Environment.constant("red").sky, Workers(1))
    assert reflections.levels.shape == (0, 3)
