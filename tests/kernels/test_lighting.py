"""Light equals Blinn-Phong in float64; elementary functions keep their stated errors."""

from __future__ import annotations

import math
import subprocess
import sys

import blocks
import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rasterjit as rj
from rasterjit.pipeline.lighting import blinn_phong, light_stages
from rasterjit.pipeline.records import Lighting
from rasterjit.pipeline.surface import sample_block as block
from rasterjit.runtime import float_math
from rasterjit.scene.light import MAX_RADIANCE
from rasterjit.survey.light_culling import pack_lights

VIEWER = np.array([0.0, 0.0, 0.0, 1.0], np.float32)


def every_binade(rng, low, high, each=40):
    """Return float32 samples spread over binades low..high."""
    exponents = np.repeat(np.arange(low, high), each)
    return np.ldexp(rng.uniform(1.0, 2.0, len(exponents)), exponents).astype(np.float32)


def test_log2_keeps_its_error():
    rng = np.random.default_rng(1)
    near_one = (1.0 + rng.uniform(-1e-3, 1e-3, 400)).astype(np.float32)
    split = np.float32(math.sqrt(0.5)) + np.arange(-20, 21).astype(np.float32) * np.float32(6e-8)
    for x in np.concatenate([every_binade(rng, -126, 40), near_one, split]):
        exact = math.log2(float(x))
        assert abs(float(float_math.log2(x)) - exact) <= 1.2e-7 * (1.0 + abs(exact))
    for k in range(-126, 40):
        assert float_math.log2(np.float32(2.0**k)) == k


def test_exp2_keeps_its_error():
    rng = np.random.default_rng(2)
    halves = np.arange(-126, 126).astype(np.float32) + np.float32(0.5)
    samples = np.concatenate(
        [
            rng.uniform(-126, 126, 4000).astype(np.float32),
            halves,
            np.nextafter(halves, np.float32(0)),
        ]
    )
    for x in samples:
        exact = 2.0 ** float(x)
        assert abs(float(float_math.exp2(x)) - exact) <= 2e-7 * exact
    for k in range(-126, 127):
        assert float_math.exp2(np.float32(k)) == 2.0**k
    for x in (-127.0, -1e6, -np.inf):
        assert float_math.exp2(np.float32(x)) == np.float32(2.0**-126)


def test_power_equals_the_math_library():
    rng = np.random.default_rng(3)
    for exponent in (0.25, 1.0, 2.2, 32.0, 50.0, 500.0, 1e4):
        for x in rng.uniform(0.0, 1.0, 300).astype(np.float32):
            exact = math.pow(float(x), exponent)
            # log2's error, times the exponent, plus exp2's own.
            bound = 2e-7 + exponent * 1.3e-7 * (1.0 + abs(math.log2(max(float(x), 1e-38))))
            have = float(float_math.power(x, np.float32(exponent)))
            assert abs(have - exact) <= exact * bound * 1.5 + 2.0**-125
    assert float_math.power(np.float32(1.0), np.float32(50.0)) == 1.0
    assert 0.0 <= float_math.power(np.float32(0.0), np.float32(50.0)) < 1e-30
    assert float_math.power(np.float32(0.0), np.float32(1e-3)) <= 1.0


def random_samples(rng, count):
    samples = np.zeros((block.SAMPLE_ROWS, count), np.float32)
    samples[block.RED : block.ALPHA + 1] = rng.uniform(0, 1, (4, count))
    samples[block.NORMAL_X : block.NORMAL_Z + 1] = rng.normal(size=(3, count))
    samples[block.POINT_X : block.POINT_Z + 1] = rng.normal(size=(3, count)) * 2 + [[0], [0], [-5]]
    samples[block.SPECULAR] = rng.uniform(0, 1, count)
    samples[block.SHININESS] = rng.uniform(1, 60, count)
    samples[block.LIT] = 1.0
    return samples


def random_lights(rng):
    lights = np.zeros((4, 7), np.float32)
    lights[:, :3] = rng.normal(size=(4, 3)) * 3
    lights[:2, :3] /= np.linalg.norm(lights[:2, :3], axis=1, keepdims=True)
    lights[2:, 3] = 1.0
    lights[:, 4:] = rng.uniform(0, 1, (4, 3))
    return lights


def naive_colors(samples, lights, ambient, viewer, with_highlight=True):
    columns = samples.astype(float).T
    return np.array(
        [
            naive.blinn_phong(
                s[block.RED : block.ALPHA], s[block.NORMAL_X : block.NORMAL_Z + 1],
                s[block.POINT_X : block.POINT_Z + 1],
                (s[block.SPECULAR] if with_highlight else 0.0, s[block.SHININESS]),
                lights.astype(float), ambient.astype(float), viewer.astype(float),
            )
            for s in columns
        ]
    )  # fmt: skip


NO_CONE, NO_END = (0.0, 0.0, 0.0, 0.0, 1.0), 0.0


def light_samples(samples, lighting, viewer):
    """Turn base colours into seen colours, without shadows."""
    samples[block.OCCLUSION] = samples[block.SHADOW] = 1.0
    rows = lighting.lights, 0, len(lighting.lights)
    adds = light_stages.add_blinn_phong_lights, *rows, viewer
    if lighting.highlights is None:
        adds = light_stages.add_diffuse_lights, *rows
    blocks.run(
        samples, (light_stages.start_with_ambient, lighting.ambient),
        (light_stages.normalize_normals,), adds,
    )  # fmt: skip


def whole_rows(lights):
    """Return light rows of all columns; those of seven have neither cone nor range."""
    lights = np.asarray(lights, np.float32)
    if lights.size and lights.shape[-1] == blinn_phong.LIGHT_COLUMNS:
        return lights
    lights = lights.reshape(-1, 7)
    rest = np.array([*NO_CONE, NO_END], np.float32)
    return np.hstack([lights, np.tile(rest, (len(lights), 1))])


def light(samples, lights, ambient, viewer=VIEWER, highlights=1):
    lights = whole_rows(lights)
    record = Lighting(
        lights,
        np.asarray(ambient, np.float32),
        None if highlights is None else np.int64(highlights),
    )
    light_samples(samples, record, viewer)
    return samples[block.OUT_RED : block.OUT_BLUE + 1].T.copy()


AMBIENT = np.array([0.1, 0.05, 0.2], np.float32)


@pytest.mark.parametrize("viewer", [[0, 0, 0, 1], [0.3, 0.1, 1, 0]])
@pytest.mark.parametrize("highlights", [1, None])
def test_light_equals_naive(viewer, highlights):
    rng = np.random.default_rng(4)
    samples, lights = random_samples(rng, 400), random_lights(rng)
    viewer = np.array(viewer, np.float32)
    want = naive_colors(samples, lights, AMBIENT, viewer, highlights is not None)
    have = light(samples, lights, AMBIENT, viewer, highlights)
    assert np.abs(have - want).max() < 1e-5 * max(1.0, np.abs(want).max())
    assert want.max() > 0.3


def test_no_highlight_equals_zero_strength_bit_for_bit():
    rng = np.random.default_rng(5)
    samples, lights = random_samples(rng, 300), random_lights(rng)
    samples[block.SPECULAR] = 0.0
    present = light(samples.copy(), lights, AMBIENT, highlights=1)
    absent = light(samples.copy(), lights, AMBIENT, highlights=None)
    assert present.tobytes() == absent.tobytes()


def test_black_light_changes_no_bit():
    rng = np.random.default_rng(6)
    samples, lights = random_samples(rng, 100), random_lights(rng)
    dark = np.concatenate([lights, [[0, 1, 0, 0, 0, 0, 0], [5, 1, 0, 1, 0, 0, 0]]])
    one = light(samples.copy(), lights, AMBIENT)
    other = light(samples.copy(), dark, AMBIENT)
    assert one.tobytes() == other.tobytes()


def test_samples_that_are_not_lit_keep_their_colour():
    rng = np.random.default_rng(7)
    samples, lights = random_samples(rng, 50), random_lights(rng)
    samples[block.LIT] = 0.0
    have = light(samples, lights, AMBIENT)
    assert have.tobytes() == samples[block.RED : block.ALPHA].T.copy().tobytes()


def one_sample(normal, point=(0, 0, -4), shininess=32.0, specular=1.0, color=(0, 0, 0)):
    sample = np.zeros((block.SAMPLE_ROWS, 1), np.float32)
    sample[block.RED : block.ALPHA, 0] = color
    sample[block.NORMAL_X : block.NORMAL_Z + 1, 0] = normal
    sample[block.POINT_X : block.POINT_Z + 1, 0] = point
    sample[block.SPECULAR], sample[block.SHININESS], sample[block.LIT] = specular, shininess, 1.0
    return sample


DARK = np.zeros(3)


def test_normal_is_brought_to_length_one():
    short = light(
        one_sample((0, 0, 0.01), color=(1, 1, 1), specular=0), [[0, 0, 1, 0, 1, 1, 1]], DARK
    )
    assert abs(short[0, 0] - 1.0) < 1e-6


def test_light_of_length_zero_gives_no_light():
    for shininess in (1e-3, 1.0, 1e6):
        sample = one_sample((0, 0, 1), shininess=shininess, color=(1, 1, 1))
        assert (light(sample, [[0, 0, 0, 0, 1, 1, 1]], DARK) == 0.0).all()


def test_light_falls_off_with_the_square_of_the_distance():
    near, far = (
        light(
            one_sample((0, 0, 1), (0, 0, -d), color=(1, 1, 1), specular=0.0),
            [[0, 0, 0, 1, 1, 1, 1]], DARK,
        )[0, 0]
        for d in (2.0, 6.0)
    )  # fmt: skip
    assert abs(near - 1 / 4) < 1e-6
    assert abs(far - 1 / 36) < 1e-6


def test_no_samples_is_nothing():
    kept = random_samples(np.random.default_rng(4), 2)
    before = kept.copy()
    lit = light(kept[:, 1:1], [[0, 0, 1, 0, 1, 1, 1]], DARK)
    assert lit.shape == (0, 3)
    assert (kept == before).all()


@settings(max_examples=60)
@given(st.lists(st.floats(-1e4, 1e4, width=32), min_size=9, max_size=9))
def test_light_is_never_negative_or_nan(numbers):
    sample = one_sample(numbers[:3], numbers[3:6], color=(1, 0.5, 0))
    have = light(sample, [[*numbers[6:9], 0, 1, 1, 1], [*numbers[6:9], 1, 1, 1, 1]], AMBIENT)
    assert not np.isnan(have).any()
    assert (have >= 0.0).all()


NOT_TOLD = (1e18, -4e18, 1e19, 1e30, -3e38, math.inf, -math.inf, math.nan)


def untold_samples(rng, count):
    """Return random samples, of each a coordinate of the normal or the point, or all, far off."""
    samples = random_samples(rng, count)
    for n in range(count):
        first = block.NORMAL_X if n % 4 == 0 else block.POINT_X
        rows = slice(first, first + 3) if n % 3 == 0 else first + n % 3
        samples[rows, n] = NOT_TOLD[n % len(NOT_TOLD)]
    return samples


@pytest.mark.parametrize("viewer", [[0, 0, 0, 1], [0.3, 0.1, 1, 0]])
@pytest.mark.parametrize("highlights", [1, None])
@pytest.mark.parametrize("ending", [0.0, 1e-3, 1e-37])
def test_what_float32_cannot_tell_of_light_is_black(viewer, highlights, ending):
    rng = np.random.default_rng(8)
    samples, viewer = untold_samples(rng, 240), np.array(viewer, np.float32)
    lights = np.tile(whole_rows(random_lights(rng)), (2, 1))
    lights[:, blinn_phong.INVERSE_RANGE_SQUARED] = ending
    lights[4:, blinn_phong.DIRECTION_X : blinn_phong.CONE_OFFSET + 1] = 0.6, 0.0, 0.8, 2.0, -1.0
    # A lamp beside points that are far away.
    lights[3, :3] = 1e18
    want = naive_colors(samples, lights, AMBIENT, viewer, highlights is not None)
    have = light(samples, lights, AMBIENT, viewer, highlights)
    assert np.isfinite(have).all()
    assert np.abs(have - want).max() < 1e-5 * max(1.0, want.max())
    ambient = samples[block.RED : block.ALPHA].T * AMBIENT
    assert 0 < (want > ambient + 1e-3).any(axis=1).sum() < 200


@pytest.mark.parametrize("cosine", [1.0, 0.0])
def test_the_brightest_light_at_the_very_point_it_lights_stays_finite(cosine):
    for distance in (0.0, 1e-38, 1e-20, 1e-15, 3e-15):
        sample = one_sample((0, 1.0 - cosine, cosine), (0, 0, -distance), 1e-3, color=(1, 1, 1))
        for bright in (1e9, 1e20, MAX_RADIANCE):
            have = light(sample, [[0, 0, 0, 1, bright, bright, bright]], DARK)
            assert np.isfinite(have).all()


def test_powers_of_nan_are_numbers():
    for bits in (0x7FC00000, 0xFFC00000, 0x7F800001, 0xFFFFFFFF):
        nan = np.array(bits, np.uint32).view(np.float32)[()]
        assert float_math.exp2(nan) == 2.0**-126
        assert float_math.power(nan, np.float32(50.0)) == float_math.power(
            np.float32(0.0), np.float32(50.0)
        )


def shown(light_of_scene, point=(0.0, 0.0, 0.0)):
    """Return the red that a light of a scene shows at a point, for an eye at the origin."""
    record = pack_lights([light_of_scene], rj.MatrixCamera(np.eye(4), np.eye(4)), 0)
    samples = one_sample((0, 0, 1), point, specular=0.0, color=(1, 1, 1))
    light_samples(samples, record, VIEWER)
    return float(samples[block.OUT_RED, 0])


@pytest.mark.parametrize("distance", [0.5, 1.0, 1.5, 1.9, 1.99, 2.0, 2.5, 1e6])
def test_range_is_the_window_of_khr_lights_punctual(distance):
    window = max(min(1.0 - (distance / 2.0) ** 4, 1.0), 0.0)
    found = shown(rj.PointLight((0, 0, distance), range=2.0))
    assert found == pytest.approx(window / distance**2, rel=1e-5, abs=1e-6)
    assert (found == 0.0) == (distance >= 2.0)


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1e3, 1e6, 1e9, 1e12])
def test_lamps_light_the_same_at_any_scale_of_lengths(scale):
    near = shown(rj.SpotLight((0.1, 0.2, 1.0), intensity=3.0))
    place = (0.1 * scale, 0.2 * scale, scale)
    light = rj.SpotLight(place, intensity=3.0 * scale * scale)
    assert shown(light) == pytest.approx(near, rel=1e-5)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e6, 1e9])
def test_range_is_the_same_at_any_scale(scale):
    near = shown(rj.PointLight((0, 0, 1.0), range=2.0))
    light = rj.PointLight((0, 0, scale), range=2.0 * scale)
    assert shown(light) * scale**2 == pytest.approx(near, rel=1e-5)


@pytest.mark.parametrize("angle", [0, 5, 10, 15, 20, 29, 30, 31, 60, 89, 120, 180])
@pytest.mark.parametrize(("inner", "outer"), [(0, 30), (10, 30), (0, 90), (29.9, 30), (5, 15)])
def test_cone_is_the_ramp_of_khr_lights_punctual(angle, inner, outer):
    width = math.cos(math.radians(inner)) - math.cos(math.radians(outer))
    share = (math.cos(math.radians(angle)) - math.cos(math.radians(outer))) / width
    expected = min(max(share, 0.0), 1.0) ** 2 / 4.0
    found = shown(tilted_spot(angle, inner, outer))
    assert found == pytest.approx(expected, rel=1e-5 if width > 0.01 else 2e-3, abs=1e-6)


@pytest.mark.parametrize("outer", [90.0, 40.0, 2.5, 1.0, 0.1, 0.01, 1e-6, 1e-300])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.999, 1.0])
def test_light_inside_the_inner_angle_is_full_and_outside_the_outer_one_none(outer, share):
    seen = max(outer, 1e-3)
    inside = 0.0 if outer < 1e-3 else 0.998 * share * outer
    spot = tilted_spot(inside, share * outer, outer)
    assert shown(spot) == pytest.approx(0.25, rel=1e-5)
    assert shown(tilted_spot(1.002 * seen, share * outer, outer)) == 0.0


@pytest.mark.parametrize("outer", [3.0, 1.0, 0.1, 0.02])
def test_narrow_cones_fall_off_as_wide_ones_do(outer):
    # As angles become small, one less the cosine goes with their square.
    for part in (0.2, 0.5, 0.8):
        expected = (1.0 - part * part) ** 2 / 4.0
        assert shown(tilted_spot(part * outer, 0.0, outer)) == pytest.approx(expected, rel=0.01)


def tilted_spot(angle, inner, outer):
    """Return a spot light that hangs 2 over the sample and looks down, tilted by an angle."""
    tilt = math.radians(angle)
    direction = (math.sin(tilt), 0, -math.cos(tilt))
    return rj.SpotLight((0, 0, 2), direction, inner_angle=inner, outer_angle=outer)


def test_cone_and_range_that_end_nothing_leave_the_bits_of_a_point_light():
    rng = np.random.default_rng(7)
    samples, lights = random_samples(rng, 200), random_lights(rng)
    wide = whole_rows(lights)
    wide[:, blinn_phong.DIRECTION_X : blinn_phong.DIRECTION_Z + 1] = (0.6, 0.0, 0.8)
    before = light(samples.copy(), lights, AMBIENT)
    after = light(samples.copy(), wide, AMBIENT)
    assert before.tobytes() == after.tobytes()


FIND_ROOTS = """
import re, sys
from rasterjit.effects.environment.stage import add_reflections
from rasterjit.pipeline.lighting import light_stages as lights
from rasterjit.pipeline.surface.material_maps import apply_normal_maps
from rasterjit.runtime import compiler, store

for own in (
    lights.add_blinn_phong_lights, lights.add_diffuse_lights, lights.write_microfacet_ambient,
    lights.add_microfacet_lights, add_reflections, apply_normal_maps,
)[: int(sys.argv[1])]:
    _, module = compiler.lower_to_llvm(own, own.kind, own.__name__, store.host())
    print(own.__name__, len(re.findall(r"call .*@llvm[.]sqrt[.]v[0-9]+f", str(module))))
"""
ROOTS = {
    "add_blinn_phong_lights": 3, "add_diffuse_lights": 1, "write_microfacet_ambient": 1,
    "add_microfacet_lights": 5, "add_reflections": 3, "apply_normal_maps": 2,
}  # fmt: skip
"""How many square roots a sample takes, at least, in each stage."""


@pytest.mark.needs_jit
@pytest.mark.parametrize("count", [2, pytest.param(6, marks=pytest.mark.takes_long)])
def test_loops_over_samples_take_roots_of_vectors(count):
    run = subprocess.run(
        [sys.executable, "-c", FIND_ROOTS, str(count)], capture_output=True, text=True, check=True
    )
    found = dict(line.split() for line in run.stdout.splitlines())
    assert [*found] == [*ROOTS][:count]
    for name, number in found.items():
        assert int(number) >= ROOTS[name], name
