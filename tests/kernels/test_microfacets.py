"""Microfacets equal glTF's BRDF in float64; they keep energy, and are the same both ways round."""

from __future__ import annotations

import math

import blocks
import naive
import naive_materials
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rasterjit.pipeline.lighting import blinn_phong, light_stages, pbr
from rasterjit.pipeline.surface import sample_block as block

VIEWER = np.array([0.0, 0.0, 0.0, 1.0], np.float32)
DARK = np.zeros(3, np.float32)
PARTS = np.ones(2, np.float32)
"""All of the light is shown."""


def random_samples(rng, count, least_roughness=0.2):
    samples = np.zeros((block.SAMPLE_ROWS, count), np.float32)
    samples[block.RED : block.ALPHA + 1] = rng.uniform(0, 1, (4, count))
    normals = rng.normal(size=(3, count))
    samples[block.NORMAL_X : block.NORMAL_Z + 1] = normals / np.linalg.norm(normals, axis=0)
    samples[block.POINT_X : block.POINT_Z + 1] = rng.normal(size=(3, count)) * 2 + [[0], [0], [-5]]
    samples[block.METALLIC] = rng.uniform(0, 1, count)
    samples[block.ROUGHNESS] = rng.uniform(least_roughness, 1, count)
    samples[block.MICROFACET] = 1.0
    return samples


def light_rows(*rows):
    """Return lights without cone and range, given x, y, z, w, red, green, blue."""
    lights = np.zeros((len(rows), blinn_phong.LIGHT_COLUMNS), np.float32)
    for n, row in enumerate(rows):
        lights[n, :7] = row
    lights[:, blinn_phong.CONE_OFFSET] = 1.0
    return lights


def start_light(samples, ambient, viewer=VIEWER):
    """Write what ambient light shows, as row OCCLUSION lets it."""
    blocks.run(
        samples, (light_stages.start_with_ambient, ambient), (light_stages.normalize_normals,),
        (light_stages.write_microfacet_ambient, ambient, viewer),
    )  # fmt: skip


def add_lights(samples, lights, viewer=VIEWER, parts=PARTS):
    """Add lights, as row SHADOW lets them."""
    lit = lights, 0, len(lights), viewer, parts
    blocks.run(samples, (light_stages.add_microfacet_lights, *lit))


def light(samples, lights, ambient=DARK, viewer=VIEWER):
    """Return the seen colours, (N, 3), as the shading step makes them."""
    samples[block.OCCLUSION] = samples[block.SHADOW] = 1.0
    start_light(samples, np.asarray(ambient, np.float32), viewer)
    add_lights(samples, lights, viewer)
    return samples[block.OUT_RED : block.OUT_BLUE + 1].T.copy()


def one_sample(base=(1.0, 1.0, 1.0), metallic=0.0, roughness=0.5, normal=(0, 0, 1), count=1):
    samples = np.zeros((block.SAMPLE_ROWS, count), np.float32)
    for k in range(3):
        samples[block.RED + k] = base[k]
        samples[block.NORMAL_X + k] = normal[k]
    samples[block.POINT_Z] = -4.0
    samples[block.METALLIC], samples[block.ROUGHNESS], samples[block.MICROFACET] = (
        metallic,
        roughness,
        1,
    )
    return samples


@pytest.mark.parametrize("viewer", [[0, 0, 0, 1], [0.3, 0.1, 1, 0]])
@pytest.mark.parametrize("row", [(0.4, 0.5, 0.9, 0, 1, 0.5, 0.2), (1.0, 2.0, -1.0, 1, 3, 2, 9)])
def test_light_equals_naive(viewer, row):
    rng = np.random.default_rng(1)
    samples, viewer = random_samples(rng, 600), np.array(viewer, np.float32)
    columns = samples.astype(np.float64).T
    have = light(samples, light_rows(row), viewer=viewer)
    compared = 0
    for n, column in enumerate(columns):
        normal = column[block.NORMAL_X : block.NORMAL_Z + 1]
        point = column[block.POINT_X : block.POINT_Z + 1]
        seen = normal @ (viewer[:3] - viewer[3] * point)
        if seen <= 0.02:
            # A normal that turns away from the viewer is where the engine goes its own way.
            continue
        want = naive_materials.lit_by(
            column[block.RED : block.ALPHA], column[block.METALLIC], column[block.ROUGHNESS],
            normal,
            point, np.float32(row).astype(float), viewer.astype(float),
        )  # fmt: skip
        assert have[n] == pytest.approx(want, rel=2e-4, abs=1e-6)
        compared += max(want) > 0.0
    assert compared > 100


@pytest.mark.parametrize("viewer", [[0, 0, 0, 1], [0.3, 0.1, 1, 0]])
@pytest.mark.parametrize("row", [(0.4, 0.5, 0.9, 0, 1, 0.5, 0.2), (1e18, 2.0, 1e18, 1, 3, 2, 9)])
def test_what_float32_cannot_tell_of_light_is_black(viewer, row):
    rng = np.random.default_rng(3)
    samples, viewer = random_samples(rng, 96), np.array(viewer, np.float32)
    offs = (1e18, -4e18, 1e19, 1e30, -3e38, math.inf, -math.inf, math.nan)
    for n in range(96):
        first = block.NORMAL_X if n % 4 == 0 else block.POINT_X
        rows = slice(first, first + 3) if n % 3 == 0 else first + n % 3
        samples[rows, n] = offs[n % 8]
    columns = samples.astype(np.float64).T.tolist()
    lit = light(samples.copy(), light_rows(row), viewer=viewer)
    assert np.isfinite(lit).all()
    for n, column in enumerate(columns):
        point = column[block.POINT_X : block.POINT_Z + 1]
        normal = column[block.NORMAL_X : block.NORMAL_Z + 1]
        toward = [viewer.tolist()[k] - viewer.tolist()[3] * point[k] for k in range(3)]
        is_told = naive.is_told(normal) and naive.is_told(toward)
        if is_told and naive.dot(naive.unit(normal), naive.unit(toward)) <= 0.02:
            # A normal that turns away from the viewer is where the engine goes its own way.
            continue
        want = naive_materials.lit_by(
            column[block.RED : block.ALPHA], column[block.METALLIC], column[block.ROUGHNESS],
            normal, point, np.float32(row).tolist(), viewer.tolist(),
        )  # fmt: skip
        assert lit[n] == pytest.approx(want, rel=2e-4, abs=1e-6)
    ambient = light(samples, light_rows(), (1, 1, 1), viewer)
    assert np.isfinite(ambient).all()
    assert (ambient >= 0.0).all()


def test_a_smooth_surface_equals_naive_in_the_middle_of_its_highlight():
    toward = np.array([0.0, 0.0, 1.0])
    for roughness in (0.0, 0.03, 0.1, 0.2):
        for tilt in (0.0, 1e-4, 1e-3, 1e-2, 0.1):
            normal = np.float32([math.sin(tilt), 0.0, math.cos(tilt)])
            samples = one_sample(roughness=roughness, metallic=1.0, normal=normal)
            normal = normal.astype(float) / np.linalg.norm(normal.astype(float))
            have = light(samples, light_rows((0, 0, 1, 0, 1, 1, 1)))[0, 0]
            once = naive_materials.brdf((1.0,) * 3, 1.0, roughness, normal, toward, toward)[0]
            often = naive_materials.bounced(1.0, roughness, normal[2])
            want = normal[2] * (math.pi * once + often)
            assert have == pytest.approx(want, rel=2e-3, abs=1e-6)


def test_a_white_matt_dielectric_facing_light_of_intensity_1_is_nearly_white():
    """0.04 of the light is mirrored; of that, little comes back from a rough surface."""
    seen = light(one_sample(roughness=1.0), light_rows((0, 0, 1, 0, 1, 1, 1)))
    assert seen[0] == pytest.approx([0.96 + 0.04 * 0.25] * 3, abs=1e-5)


def test_light_is_the_same_both_ways_round():
    """
    Helmholtz: exchanging light and viewer changes nothing but the cosine at the light.

    Not so what metals send on after several bounces, which depends on the viewer's side alone.
    """
    rng = np.random.default_rng(2)
    for _ in range(200):
        one, other = rng.normal(size=(2, 3))
        one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
        one[2], other[2] = abs(one[2]) + 0.1, abs(other[2]) + 0.1
        one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
        metallic, roughness = rng.uniform(), rng.uniform(0.2, 1.0)
        sample = one_sample((0.9, 0.5, 0.1), metallic, roughness)
        there, back = (
            light(
                sample.copy(),
                light_rows((*a, 0, 1, 1, 1)),
                viewer=np.array([*b, 0], np.float32),
            )[0]
            / a[2]
            - metallic
            * np.array([naive_materials.bounced(c, roughness, b[2]) for c in (0.9, 0.5, 0.1)])
            for a, b in ((one, other), (other, one))
        )
        assert there == pytest.approx(back, rel=1e-4, abs=1e-5)


def albedo(metallic, roughness, cosine, steps=400):
    """Return the share of light from one side that is sent to all sides, as the engine has it."""
    i, j = np.divmod(np.arange(steps * steps), steps)
    squared, turn = (i + 0.5) / steps, 2.0 * np.pi * (j + 0.5) / steps
    sine, height = np.sqrt(squared), np.sqrt(1.0 - squared)
    viewer = np.array([math.sqrt(1.0 - cosine * cosine), 0.0, cosine, 0.0], np.float32)
    total = 0.0
    for direction in np.column_stack([sine * np.cos(turn), sine * np.sin(turn), height])[::97]:
        row = light_rows((*direction, 0, 1, 1, 1))
        seen = light(one_sample(metallic=metallic, roughness=roughness), row, viewer=viewer)[0, 0]
        total += seen / direction[2]
    return total / len(range(0, steps * steps, 97))


@pytest.mark.parametrize("roughness", [0.7, 1.0])
@pytest.mark.parametrize("cosine", [0.3, 0.8])
def test_a_dielectric_sends_on_what_the_brdf_does(roughness, cosine):
    """glTF's mix lets a white one send on up to 1.08 of what falls on it at grazing angles."""
    sent = albedo(0.0, roughness, cosine)
    want = naive_materials.directional_albedo(0.0, roughness, cosine, steps=64)[0]
    assert sent == pytest.approx(want, abs=0.002)
    assert 0.9 < sent < 1.02


@pytest.mark.parametrize("roughness", [0.7, 1.0])
@pytest.mark.parametrize("cosine", [0.2, 0.5, 0.8, 1.0])
def test_a_white_metal_sends_on_all_light(roughness, cosine):
    """
    In a furnace of white lights, one at a time: several bounces are counted as in ambient light.

    As far as the fit of what is sent on at once is the integral; of one bounce alone metals lose
    up to 70 %.
    """
    assert albedo(1.0, roughness, cosine) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("roughness", [0.0, 0.3, 0.6, 1.0])
def test_white_ambient_light_shows_a_white_surface_white(metallic, roughness):
    """The furnace of light from all sides: several bounces are counted, so none is lost."""
    for normal in ((0, 0, 1), (0.6, 0, 0.8), (0.99, 0, 0.14), (1, 0, 0)):
        sample = one_sample(metallic=metallic, roughness=roughness, normal=normal)
        seen = light(sample, light_rows(), ambient=(1, 1, 1))
        assert seen[0] == pytest.approx([1.0] * 3, abs=1e-5)


@pytest.mark.parametrize("metallic", [0.0, 1.0])
@pytest.mark.parametrize("roughness", [0.0, 0.5, 1.0])
def test_ambient_light_never_adds_nor_goes_below_zero(metallic, roughness):
    for base in ((0, 0, 0), (0.02, 0.5, 1.0), (1, 0, 0)):
        for normal in ((0, 0, 1), (0.9, 0, 0.44), (1, 0, 0)):
            sample = one_sample(base, metallic, roughness, normal)
            seen = light(sample, light_rows(), ambient=(1, 1, 1))[0]
            assert (seen >= 0.0).all()
            assert (seen <= 1.00001).all()


@pytest.mark.parametrize("roughness", [0.5, 0.75, 1.0])
@pytest.mark.parametrize("cosine", [0.2, 0.6, 1.0])
def test_what_facets_mirror_of_ambient_light_at_once_is_the_integral(roughness, cosine):
    """The fit against the integral of the naive BRDF, for perfect mirrors and for 0.04."""
    scale, offset = pbr.approximate_env_brdf(np.float32(cosine), np.float32(roughness))
    for base in (1.0, 0.04):
        want = naive_materials.directional_albedo(1.0, roughness, cosine, (base,) * 3, steps=64)[0]
        assert float(base * scale + offset) == pytest.approx(want, abs=0.05)


def test_samples_of_other_kinds_keep_every_bit():
    rng = np.random.default_rng(3)
    samples = random_samples(rng, 64)
    samples[block.MICROFACET] = 0.0
    samples[block.OUT_RED : block.OUT_BLUE + 1] = rng.uniform(0, 1, (3, 64))
    before = samples[block.OUT_RED : block.OUT_BLUE + 1].copy()
    samples[block.OCCLUSION] = samples[block.SHADOW] = 1.0
    ambient = np.float32([1, 1, 1])
    blocks.run(samples, (light_stages.write_microfacet_ambient, ambient, VIEWER))
    add_lights(samples, light_rows((0.1, 0.2, 1, 0, 1, 1, 1)))
    assert samples[block.OUT_RED : block.OUT_BLUE + 1].tobytes() == before.tobytes()


def test_occlusion_holds_back_ambient_light_alone():
    sample, row = one_sample((0.8, 0.4, 0.2), 0.3, 0.4), light_rows((0, 0, 1, 0, 1, 1, 1))
    shown = []
    for share in (0.0, 0.5, 1.0):
        samples = sample.copy()
        samples[block.OCCLUSION], samples[block.SHADOW] = share, 1.0
        start_light(samples, np.float32([0.5, 0.5, 0.5]))
        ambient = samples[block.OUT_RED, 0]
        add_lights(samples, row)
        shown.append((ambient, samples[block.OUT_RED, 0] - ambient))
    assert shown[0][0] == 0.0
    assert shown[1][0] == pytest.approx(0.5 * shown[2][0])
    assert shown[0][1] == pytest.approx(shown[2][1], rel=1e-6)


def test_both_parts_of_the_light_add_up():
    rng = np.random.default_rng(4)
    samples, row = random_samples(rng, 200), light_rows((0.4, 0.5, 0.9, 0, 1, 0.5, 0.2))
    whole = light(samples.copy(), row)
    shown = []
    for parts in np.eye(2, dtype=np.float32):
        some = samples.copy()
        some[block.SHADOW] = 1.0
        add_lights(some, row, parts=parts)
        shown.append(some[block.OUT_RED : block.OUT_BLUE + 1].T)
    assert shown[0] + shown[1] == pytest.approx(whole, rel=1e-5, abs=1e-6)
    assert (shown[0] > 0).sum() > 100
    assert (shown[1] > 0).sum() > 100


@settings(max_examples=80)
@given(
    st.lists(st.floats(-1e4, 1e4, width=32), min_size=9, max_size=9),
    st.floats(0, 1, width=32),
    st.floats(0, 1, width=32),
)
def test_light_is_never_negative_or_nan(numbers, metallic, roughness):
    sample = one_sample((1.0, 0.5, 0.0), metallic, roughness, numbers[:3])
    sample[block.POINT_X : block.POINT_Z + 1, 0] = numbers[3:6]
    rows = light_rows((*numbers[6:9], 0, 1, 1, 1), (*numbers[6:9], 1, 1, 1, 1))
    have = light(sample, rows, ambient=(0.1, 0.1, 0.1))
    assert not np.isnan(have).any()
    assert (have >= 0.0).all()
