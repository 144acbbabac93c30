"""Powers by the math library: where they are asked for, and how far they are from our own."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.kernels import fogging, tone_mapping
from rasterjit.kernels import lighting as lit
from rasterjit.kernels.library_math import library_exp2, library_power
from rasterjit.plan_atmosphere import fog_record, tone_record

LIBRARY = rj.Quality(math="library")
SIZE = (48, 40)
HALF_ULP = 2.0**-24
"""Relative error of what is rounded to float32 once."""
NEAR = 4e-7
"""How far the engine's own highlights and fog are from the library's, as a share of the whole."""


@pytest.fixture
def scene(sphere):
    scene = rj.Scene()
    material = rj.Material(base_color="#804020", specular=1.0, shininess=37.5)
    scene.add(rj.Mesh(sphere.vertices, sphere.faces, material=material))
    scene.lights = [rj.AmbientLight(), rj.PointLight((3, 4, 5), intensity=20.0)]
    return scene


def shown(scene, camera, quality=LIBRARY, outputs=("linear",)):
    return rj.render(scene, camera, size=SIZE, quality=quality, outputs=outputs, threads=1)


def libraries(plan):
    """Which records of a plan call for the library."""
    lighting, tone = plan.lighting, plan.encoding.tone
    return [
        record is not None and record.library is not None
        for record in (lighting, lighting.fog, tone)
    ]


def test_powers_of_the_library_are_rounded_once():
    rng = np.random.default_rng(1)
    for exponent in (0.25, 1.0, 2.2, 50.0, 1e4):
        exponent = np.float32(exponent)
        for x in rng.uniform(0.0, 1.0, 200).astype(np.float32):
            exact = float(x) ** float(exponent)
            error = abs(float(library_power(x, exponent)) - exact)
            assert error <= max(1.001 * HALF_ULP * exact, 2.0**-149)
    assert library_power(np.float32(0.0), np.float32(5.0)) == 0.0
    assert library_power(np.float32(1.0), np.float32(1e6)) == 1.0


def test_exponentials_of_the_library_are_rounded_once():
    for x in np.random.default_rng(2).uniform(-126, 126, 1000).astype(np.float32):
        exact = 2.0 ** float(x)
        assert abs(float(library_exp2(x)) - exact) <= 1.001 * HALF_ULP * exact
    for x in (-127.0, -1e30, -np.inf):
        assert library_exp2(np.float32(x)) == np.float32(2.0**-126)
    for x in (127.0, 1e30, np.inf):
        assert library_exp2(np.float32(x)) == np.float32(2.0**126)


def test_both_kinds_of_power_are_near_each_other():
    rng = np.random.default_rng(4)
    exponents = np.exp2(rng.uniform(-3, 12, 3000)).astype(np.float32)
    for x, exponent in zip(rng.random(3000).astype(np.float32), exponents, strict=True):
        own, library = lit.power(x, exponent), library_power(x, exponent)
        assert abs(float(own) - float(library)) <= NEAR


@pytest.mark.parametrize("shading", ["phong", "gouraud", "flat"])
def test_highlights_are_near_those_of_polynomials(scene, camera, shading):
    mesh = scene.nodes[0].mesh
    mesh.material = rj.Material(shading, "black", specular=1.0, shininess=3.7)
    own, library = shown(scene, camera, None).linear, shown(scene, camera).linear
    assert np.abs(own - library).max() <= NEAR * max(1.0, float(own.max()))
    assert own.tobytes() != library.tobytes()


@pytest.mark.parametrize("fog", [
    rj.Fog("red", "exp", density=0.17), rj.Fog("red", "exp2", density=0.11),
    rj.Fog("red", "exp", density=0.3, height=-1.0, falloff=0.7),
])  # fmt: skip
def test_fog_of_the_library_is_near_that_of_polynomials_and_its_formula(scene, camera, fog):
    scene.fog = fog
    own, library = shown(scene, camera, None).linear, shown(scene, camera).linear
    assert np.abs(own - library).max() <= 4 * NEAR
    assert own.tobytes() != library.tobytes()


def test_fog_of_the_library_is_its_exponential():
    rng = np.random.default_rng(5)
    fog = rj.Fog("red", "exp", density=0.2)
    camera = rj.PerspectiveCamera((0, 0, 0), (0, 0, -1))
    points = (rng.normal(size=(200, 3)) * 6.0).astype(np.float32)
    samples = np.zeros((lit.SAMPLE_ROWS, 200), np.float32)
    samples[lit.POINT_X : lit.POINT_Z + 1] = points.T
    record = fog_record(fog, camera, False, "library")
    fogging.cover_samples(samples, 200, record, np.array([0, 0, 0, 1], np.float32))
    distances = np.linalg.norm(points.astype(np.float64), axis=1)
    wanted = 1.0 - np.exp(-0.2 * distances)
    # The distance is rounded, a few times, and so is what it is multiplied by.
    assert samples[lit.OUT_RED] == pytest.approx(wanted, abs=8 * HALF_ULP)


@pytest.mark.parametrize("height", [-1e15, 0.0, 1e15])
def test_extreme_fog_of_the_library_stays_between_the_colours(height):
    points = np.array([[0, 0, 0], [0, 1e9, 0], [0, -1e9, 0], [1e12, 1, 1]], np.float32)
    fog = rj.Fog("red", "exp", density=1e9, height=height, falloff=1e9)
    record = fog_record(fog, rj.PerspectiveCamera((0, 0, 0), (0, 0, -1)), False, "library")
    samples = np.zeros((lit.SAMPLE_ROWS, 4), np.float32)
    samples[lit.POINT_X : lit.POINT_Z + 1] = points.T
    with np.errstate(over="ignore"):
        fogging.cover_samples(samples, 4, record, np.array([0, 0, 0, 1], np.float32))
    assert np.isfinite(samples[lit.OUT_RED]).all()
    assert samples[lit.OUT_RED].min() >= 0.0
    assert samples[lit.OUT_RED].max() <= 1.0


@pytest.mark.parametrize("curve", ["none", "reinhard", "aces", "neutral"])
def test_exposure_by_the_library_is_near_that_of_polynomials(curve):
    tone = rj.ToneMap(curve, 0.3)
    for light in np.random.default_rng(6).uniform(0, 4, (50, 3)).astype(np.float32):
        own = tone_mapping.map_pixel(tone_record(tone), *light)
        library = tone_mapping.map_pixel(tone_record(tone, "library"), *light)
        assert np.array(library) == pytest.approx(np.array(own), rel=2e-6)
    factor = tone_mapping.map_pixel(tone_record(rj.ToneMap("none", 0.3), "library"), *[
        np.float32(1.0)] * 3)  # fmt: skip
    assert float(factor[0]) == pytest.approx(math.exp(0.3 * math.log(2.0)), rel=1.001 * HALF_ULP)


def test_the_library_is_called_where_there_is_a_power(scene, camera):
    def found(quality=LIBRARY):
        return libraries(rj.explain(scene, camera, quality, size=SIZE))

    assert found() == [True, False, False]
    scene.fog, scene.tone_map = rj.Fog("red", "linear", start=1.0, end=9.0), rj.ToneMap()
    assert found() == [True, False, False]
    scene.fog, scene.tone_map = rj.Fog("red", "exp", density=0.1), rj.ToneMap(exposure=0.5)
    assert found() == [True, True, True]
    assert found(None) == [False, False, False]
    scene.nodes[0].mesh.material = rj.Material(specular=0.0)
    assert found() == [False, True, True]
    scene.nodes[0].mesh.material = rj.Material("pbr")
    assert found() == [False, True, True]


def test_explain_says_where_the_library_is_called(scene, camera):
    scene.fog, scene.tone_map = rj.Fog("red", "exp", density=0.1), rj.ToneMap(exposure=0.5)
    plan = rj.explain(scene, camera, LIBRARY, size=SIZE)
    told = {effect.name for effect in plan.effects if "quality.math is 'library'" in effect.reason}
    assert told == {"lights", "fog", "tone mapping"}
    assert "quality.math" not in str(rj.explain(scene, camera, size=SIZE))


def test_without_a_power_the_library_changes_no_bit(scene, camera):
    scene.nodes[0].mesh.material = rj.Material("pbr", "red")
    scene.tone_map = rj.ToneMap("aces", 2.0)
    outputs = ("color", "linear")
    own, library = shown(scene, camera, None, outputs), shown(scene, camera, LIBRARY, outputs)
    assert own.linear.tobytes() == library.linear.tobytes()
    assert own.color.tobytes() == library.color.tobytes()


def test_the_pixel_told_is_that_of_the_frame(scene, camera):
    frame = shown(scene, camera, outputs=("linear", "face_id"))
    y, x = np.argwhere(frame.face_id >= 0)[100]
    told = rj.explain_pixel(scene, camera, SIZE, int(x), int(y), quality=LIBRARY)
    assert told.linear.tobytes() == frame.linear[y, x].tobytes()
