"""Look-ups equal the twins; white under white light is white; functions keep their errors."""

from __future__ import annotations

import math

import blocks
import naive_environment as naive
import numpy as np
import pytest
import skies

import rasterjit as rj
from rasterjit.effects.environment import prefilter as maps
from rasterjit.effects.environment import stage as environment_stage
from rasterjit.pipeline.lighting.pbr import approximate_env_brdf
from rasterjit.pipeline.surface import sample_block as block
from rasterjit.runtime.threads import Workers

VIEWER = np.array([0.0, 0.0, 0.0, 1.0], np.float32)
PARALLEL = np.array([0.6, 0.0, 0.8, 0.0], np.float32)


def units(rng, count):
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def samples_of(rng, count, *, faceted):
    """Return random samples; normals of length one."""
    samples = np.zeros((block.SAMPLE_ROWS, count), np.float32)
    samples[block.RED : block.ALPHA + 1] = rng.uniform(0, 1, (4, count))
    samples[block.NORMAL_X : block.NORMAL_Z + 1] = units(rng, count).T
    samples[block.POINT_X : block.POINT_Z + 1] = -3.0 * units(rng, count).T
    samples[block.METALLIC] = rng.uniform(0, 1, count)
    samples[block.ROUGHNESS] = rng.uniform(0, 1, count)
    samples[block.MICROFACET] = faceted
    samples[block.LIT] = 1.0 - faceted
    samples[block.OUT_RED : block.OUT_BLUE + 1] = rng.uniform(0, 1, (3, count))
    return samples


def add(samples, environment, *, viewer=VIEWER, occlusion=None):
    """Return what the environment adds."""
    before = samples[block.OUT_RED : block.OUT_BLUE + 1].copy()
    samples[block.OCCLUSION] = 1.0 if occlusion is None else occlusion
    light = environment.irradiance, environment.yaw, environment.intensity
    blocks.run(
        samples, (environment_stage.add_sky, *light),
        (environment_stage.add_reflections, environment, viewer),
    )  # fmt: skip
    return samples[block.OUT_RED : block.OUT_BLUE + 1] - before


def record(environment, is_mirrored=True):
    return maps.make_light_record(environment, is_mirrored, Workers(1))


def test_angles_keep_their_error():
    rng = np.random.default_rng(1)
    pairs = np.concatenate(
        [rng.normal(size=(3000, 2)), rng.normal(size=(500, 2)) * [1e-20, 1e15]]
    ).astype(np.float32)
    for y, x in pairs:
        exact = math.atan2(float(y), float(x)) / (2.0 * math.pi)
        assert abs(float(environment_stage.compute_turns(y, x)) - exact) <= 6e-8
    eighths = {(0, 1): 0, (1, 1): 1, (1, 0): 2, (1, -1): 3, (-1, -1): -3, (-1, 0): -2, (-1, 1): -1}
    for (y, x), eighth in eighths.items():
        assert environment_stage.compute_turns(np.float32(y), np.float32(x)) == eighth / 8
    assert environment_stage.compute_turns(np.float32(0.0), np.float32(-2.0)) == 0.5
    assert environment_stage.compute_turns(np.float32(0.0), np.float32(0.0)) == 0.0


@pytest.mark.parametrize(("width", "height"), [(1, 1), (2, 1), (8, 4), (33, 20)])
def test_a_picture_is_looked_up_like_its_twin(width, height):
    rng = np.random.default_rng(width)
    image = rng.uniform(0, 5, (height, width, 3)).astype(np.float32)
    around = record(rj.Environment(image), False)
    poles = [(0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1), (-1, 0, -1e-9)]
    for x, y, z in np.concatenate([units(rng, 100), poles]).astype(np.float32):
        found = environment_stage.sample_sky(
            x, y, z, around.texels, around.width, around.height, around.gradient
        )
        # Five values of light a texel, and places good to 1e-6 of the picture.
        bound = 5.0 * 1.5e-6 * (width + height)
        assert np.abs(found - naive.look_up(image, (x, y, z))).max() <= bound


@pytest.mark.parametrize(("width", "height"), [(1, 1), (4, 1), (8, 4), (64, 32)])
@pytest.mark.parametrize("y", [1.0, -1.0])
def test_a_pole_has_one_colour_from_all_sides_the_mean_of_its_row(width, height, y):
    image = np.random.default_rng(5).uniform(0, 5, (height, width, 3)).astype(np.float32)
    around = record(rj.Environment(image), False)
    row = image[0 if y > 0.0 else -1].mean(axis=0)
    for longitude in np.linspace(0.0, 2.0 * np.pi, 23):
        x, z = 1e-5 * np.cos(longitude), 1e-5 * np.sin(longitude)
        found = environment_stage.sample_sky(
            *np.float32((x, y, z)), around.texels, around.width, around.height, around.gradient
        )
        assert np.abs(found - row).max() < 1e-3


def test_the_middle_of_a_texel_shows_that_texel():
    rng = np.random.default_rng(3)
    image = rng.uniform(0, 1, (16, 32, 3)).astype(np.float32)
    around = record(rj.Environment(image), False)
    for (row, column), _ in np.ndenumerate(image[:, :, 0]):
        x, y, z = skies.directions(32, 16)[row, column].astype(np.float32)
        found = environment_stage.sample_sky(x, y, z, around.texels, 32, 16, around.gradient)
        assert np.abs(found - image[row, column]).max() < 2e-5


def test_what_is_no_direction_reads_a_texel_all_the_same():
    image = np.full((4, 8, 3), 0.25, np.float32)
    around = record(rj.Environment(image), False)
    for bad in (np.nan, np.inf, -np.inf, 0.0, 3e38):
        place = (np.float32(bad),) * 3
        # Without the compiler NumPy warns of what these directions do.
        with np.errstate(all="ignore"):
            found = environment_stage.sample_sky(*place, around.texels, 8, 4, around.gradient)
            plain = environment_stage.sample_sky(*place, around.texels, 0, 0, around.gradient)
        assert found == (0.25, 0.25, 0.25)
        assert plain == tuple(around.gradient[environment_stage.HORIZON])


@pytest.mark.parametrize(
    ("first", "bad"),
    [(block.NORMAL_X, np.nan), *((block.POINT_X, bad) for bad in (np.nan, np.inf, 1e30))],
)
def test_what_cannot_be_told_of_an_environment_is_black(first, bad):
    rng = np.random.default_rng(9)
    image = rng.uniform(0.5, 1, (4, 8, 3)).astype(np.float32)
    for environment in (rj.Environment(image), rj.Environment.gradient("red", "blue", "green")):
        around = record(environment, False)
        for faceted in (0.0, 1.0):
            samples = samples_of(rng, 12, faceted=faceted)
            samples[block.METALLIC, ::2] = 1.0
            samples[first : first + 3] = bad
            added = add(samples, around)
            assert np.isfinite(added).all()
            if first == block.NORMAL_X:
                assert (added == 0.0).all()
            elif faceted:
                # What comes from all sides is left, and of that a metal gets less.
                assert added.max() < 0.5
            else:
                assert added.max() > 0.1


def test_a_gradient_is_looked_up_like_its_twin():
    environment = rj.Environment.gradient((0.1, 0.2, 0.9), (0.9, 0.8, 0.7), (0.3, 0.2, 0.1))
    around = record(environment, False)
    for x, y, z in units(np.random.default_rng(4), 50).astype(np.float32):
        found = environment_stage.sample_sky(x, y, z, around.texels, 0, 0, around.gradient)
        assert found == pytest.approx(naive.gradient(environment.sky, (x, y, z)), abs=3e-7)


@pytest.mark.parametrize("rotation", [0.0, 90.0, -33.0])
def test_matt_samples_get_the_irradiance_times_their_colour(rotation):
    rng = np.random.default_rng(5)
    image = skies.sunny(64, 32, brightness=20.0, degrees=12.0)
    around = record(rj.Environment(image, 0.5, rotation), False)
    samples = samples_of(rng, 40, faceted=0.0)
    samples[block.LIT, ::4] = 0.0
    occlusion = rng.uniform(0, 1, 40).astype(np.float32)
    added = add(samples, around, occlusion=occlusion)
    brightest = naive.irradiance(
        image, np.array([0.6, 0.55, 0.5]) / np.linalg.norm([0.6, 0.55, 0.5])
    )
    for n in range(40):
        normal = samples[block.NORMAL_X : block.NORMAL_Z + 1, n].astype(np.float64)
        turned = rj.transforms.rotate_y(-rotation)[:3, :3] @ normal
        share = samples[block.LIT, n] * occlusion[n] * 0.5 * samples[block.RED : block.ALPHA, n]
        wanted = share * naive.irradiance(image, turned)
        assert (np.abs(added[:, n] - wanted) <= share * 0.03 * brightest + 1e-6).all()


@pytest.mark.parametrize("viewer", [VIEWER, PARALLEL])
def test_white_under_white_light_is_white(viewer):
    rng = np.random.default_rng(6)
    around = record(rj.Environment.constant("white"))
    samples = samples_of(rng, 500, faceted=1.0)
    samples[block.RED : block.ALPHA] = 1.0
    samples[block.METALLIC, :100] = 0.0
    samples[block.METALLIC, 100:200] = 1.0
    samples[block.ROUGHNESS, 50:150] = 0.0
    samples[block.ROUGHNESS, 150:250] = 1.0
    added = add(samples, around, viewer=viewer)
    assert np.abs(added - 1.0).max() < 2e-6


def test_no_surface_gives_more_light_than_it_gets():
    rng = np.random.default_rng(7)
    samples = samples_of(rng, 2000, faceted=1.0)
    added = add(samples, record(rj.Environment.constant("white")))
    # A difference of sums up to 2 is rounded.
    assert added.min() >= -2e-7
    assert added.max() <= 1.0 + 2e-6


def test_a_matt_surface_under_one_colour_is_that_colour():
    color = (0.25, 0.5, 0.125)
    samples = samples_of(np.random.default_rng(8), 64, faceted=0.0)
    samples[block.RED : block.ALPHA] = 1.0
    samples[block.OUT_RED : block.OUT_BLUE + 1] = 0.0
    add(samples, record(rj.Environment.constant(color), False))
    assert (samples[block.OUT_RED : block.OUT_BLUE + 1] == np.float32(color)[:, None]).all()


@pytest.mark.needs_jit
def test_a_mirror_shows_what_lies_in_the_mirrored_direction():
    rng = np.random.default_rng(9)
    image = skies.sunny(128, 64, brightness=3.0)
    around = record(rj.Environment(image, rotation=40.0))
    samples = samples_of(rng, 60, faceted=1.0)
    samples[block.METALLIC], samples[block.ROUGHNESS] = 1.0, 0.0
    samples[block.RED : block.ALPHA] = 1.0
    added = add(samples, around)
    for n in range(60):
        normal = samples[block.NORMAL_X : block.NORMAL_Z + 1, n].astype(np.float64)
        point = samples[block.POINT_X : block.POINT_Z + 1, n].astype(np.float64)
        view = -point / np.linalg.norm(point)
        toward = rj.transforms.rotate_y(-40.0)[:3, :3] @ (2.0 * (normal @ view) * normal - view)
        # All of it but what the fit of the facets' integral leaves to several bounces.
        scale, offset = approximate_env_brdf(
            np.float32(np.clip(normal @ view, 0.0, 1.0)), np.float32(0.0)
        )
        rest = abs(1.0 - scale - offset)
        assert rest < 0.06
        assert np.abs(added[:, n] - naive.look_up(image, toward)).max() <= rest * 3.0 + 1e-3


def test_levels_follow_roughness_without_steps():
    steps = np.linspace(0.0, 1.0, 2001).astype(np.float32)
    levels = np.array([environment_stage.find_level(r) for r in steps])
    assert (levels[0], levels[-1]) == (0.0, 8.0)
    assert (np.diff(levels) >= 0.0).all()
    assert np.diff(levels).max() < 0.02
    for level in range(1, 9):
        roughness = np.float32(2.0 ** ((level - 8) / 2))
        assert environment_stage.find_level(roughness) == pytest.approx(level, abs=1e-5)
