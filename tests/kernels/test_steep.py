"""Samples at jumps and steep places of light take float64; a walk towards them finds no other."""

from __future__ import annotations

import os
import time

import numpy as np
import pytest
from float32_faces import SIXTEENTH, codes
from steepest import KINDS, Place, search

import rasterjit as rj
from rasterjit.pipeline.surface.steep import (
    MOST_STEEP,
    add_steep,
    is_calm,
    normal_error,
    point_error,
    smith_slope,
)
from rasterjit.survey.lights import lighting_of
from rasterjit.survey.precision import (
    Brightness,
    Gloss,
    gloss_of,
    least_shown,
    limits_of,
    steepest,
)

SEED = int(os.environ.get("STEEPEST_SEED", time.time_ns() % 2**32))
"""Another one every time; a test that fails prints it."""

FACETS = rj.Material("pbr", "white", roughness=0.71)
SHINY = rj.Material("phong", "white", specular=1.0, shininess=3.5)


def smith(n_l, n_v, alpha):
    """Return the cosine of the light times Smith's term, and half a factor."""
    s = [np.sqrt(c * c + alpha * alpha * (1.0 - c * c)) for c in (n_l, n_v)]
    return 0.5 * n_l / (n_v * s[0] + n_l * s[1])


@pytest.mark.parametrize("alpha", [0.03, 0.1, 0.3, 1.0])
def test_smiths_term_is_nowhere_steeper_than_its_bound(alpha):
    n_l, n_v = (10.0 ** np.random.default_rng(1).uniform(-4.0, 0.0, (2, 20000))) * 0.999
    step = 1e-7 * np.minimum(n_l, n_v)
    bound = (alpha + n_l) / (alpha**2 * (n_l + n_v))
    for moved in (
        smith(n_l + step, n_v, alpha) - smith(n_l - step, n_v, alpha),
        smith(n_l, n_v + step, alpha) - smith(n_l, n_v - step, alpha),
    ):
        assert (np.abs(moved) / (2.0 * step) <= 1.001 * bound).all()
    # Head on facets are densest: one over the square of their width.
    f = np.float32
    found = smith_slope(f(0.5), f(0.5), f(1.0), f(1.0), f(alpha), f(1.0))
    assert found == pytest.approx((alpha + 0.5) / alpha**4, rel=1e-4)


@pytest.mark.parametrize("shininess", [1.0, 1.7, 2.6, 4.0, 7.0, 10.0, 30.0, 50.0, 400.0])
@pytest.mark.parametrize("peak", [0.01, 0.3, 1.0, 4.0, 40.0])
def test_highlights_are_nowhere_steeper_than_their_bound(shininess, peak):
    angle = np.linspace(0.0, np.pi / 2, 100001)
    shown = codes(np.minimum(peak * np.cos(angle) ** shininess, 1.0)[:, np.newaxis])[:, 0]
    assert np.abs(np.diff(shown)).max() / angle[1] <= 1.001 * steepest(shininess, peak)
    dark = least_shown(shininess, peak)
    assert dark > 1.0 or 12.92 * 255.0 * peak * dark**shininess <= 1.0 / 128.0


def test_what_is_endlessly_steep_takes_float64():
    assert limits_of(Gloss(0.5, 0.9, np.inf), Brightness(1.0), False) is None
    assert limits_of(Gloss(0.5, 1.0, np.inf), Brightness(1.0), False) is not None
    assert limits_of(Gloss(0.0, 0.9, np.inf), Brightness(1.0), False) is not None


@pytest.mark.parametrize("fog", [
    rj.Fog("white", mode="linear", start=2.0, end=2.0001),
    rj.Fog("white", mode="exp", density=0.1, height=0.0, falloff=1.0),
])  # fmt: skip
def test_fog_like_a_wall_takes_float64(fog):
    from float32_faces import EYES, hills

    scene = hills()
    assert rj.explain(scene, EYES["above"]).facts.limits is not None
    scene.fog = fog
    assert rj.explain(scene, EYES["above"]).facts.limits is None


def rows_of(material, light, count, random):
    """Return limits, a light's row, a viewer, and normals and points of some faces' samples."""
    eye = rj.PerspectiveCamera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    limits = limits_of(gloss_of(material), Brightness(1.0), True)
    row = lighting_of([light], eye, 1).lights[0]
    viewer = np.array([0.0, 0.0, 0.0, 1.0], np.float32)
    first, point = random.normal(size=(2, 3)) * ((1.0,), (3.0,))
    ways = 10.0 ** random.uniform(-3.0, 0.0)
    u, v, bu, bv = random.normal(size=(4, 3)) * ways
    w = random.dirichlet((0.5, 0.5, 0.5), count).astype(np.float32)
    normals = np.float32(first + w[:, 1:2] * bu + w[:, 2:] * bv)
    points = np.float32(point + w[:, 1:2] * u + w[:, 2:] * v)
    bent, way = (max(np.linalg.norm(a), np.linalg.norm(b)) for a, b in ((bu, bv), (u, v)))
    return limits, row, viewer, (first, bent, normals), (point, way, points)


def test_faces_that_are_calm_hold_no_steep_sample():
    random, calm, steep = np.random.default_rng(SEED), 0, 0
    for number in range(400):
        place = random.normal(size=3) * 4.0
        light = random.choice(
            [rj.DirectionalLight(place, intensity=1.0), rj.PointLight(place, intensity=3.0)]
        )
        material = (FACETS, SHINY)[number % 2]
        limits, row, viewer, (first, bent, normals), (point, way, points) = rows_of(
            material, light, 30, random
        )
        f, found = np.float32, np.zeros(30, np.float32)
        errors = (
            normal_error(f(first @ first), f(bent * bent)), point_error(f(point @ point), f(way**2))
        )  # fmt: skip
        filled = [np.full(30, error, np.float32) for error in errors]
        with np.errstate(all="ignore"):
            add_steep(*normals.T, *points.T, *filled, found, row, viewer, limits)
            is_so = is_calm(
                tuple(map(f, first)), f(bent), tuple(map(f, point)), f(way), errors, row, viewer,
                limits,
            )  # fmt: skip
        assert not is_so or (found <= MOST_STEEP).all(), SEED
        calm += bool(is_so)
        steep += bool((found > MOST_STEEP).any())
    assert calm > 40
    assert steep > 0


@pytest.mark.needs_jit
def test_a_highlight_that_ends_at_a_normal_turned_away_has_the_bits_of_float64():
    # The light and the viewer are on opposite sides of the normal: facets end along a line.
    points = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (0.0, 1.0, 0.0)]
    normal, toward = np.array([0.0, 0.8, -0.6]), np.array([0.0, 0.0, 1.0])
    light = toward - 2.0 * (toward @ normal) * normal
    camera = rj.OrthographicCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), height=1.0)
    for turn in np.linspace(-1e-7, 1e-7, 41):
        scene = rj.Scene()
        scene.add(rj.Mesh(points, [(0, 1, 2)], normals=[normal] * 3, material=FACETS))
        scene.lights = [rj.DirectionalLight(-(light + (0.0, turn, 0.0)))]
        one, other = (
            rj.render(
                scene, camera, size=(4, 4), outputs=("linear",),
                quality=rj.Quality(interpolation_precision=level),
            ).linear
            for level in ("adaptive", "float64")
        )  # fmt: skip
        assert one.tobytes() == other.tobytes()


def worst(seed, walks):
    found = max(search(seed, walks), key=lambda one: one.codes)
    return found.codes, f"seed {seed}: {found}"


@pytest.mark.needs_jit
@pytest.mark.filterwarnings("ignore::rasterjit.ViewWarning")
def test_no_walk_finds_codes_that_move_by_more_than_a_sixteenth():
    print(f"STEEPEST_SEED={SEED}")
    apart, told = worst(SEED, 6 * len(KINDS))
    assert apart <= SIXTEENTH, told


@pytest.mark.takes_long
@pytest.mark.needs_jit
@pytest.mark.filterwarnings("ignore::rasterjit.ViewWarning")
@pytest.mark.parametrize("number", range(8))
def test_no_long_walk_finds_codes_that_move_by_more_than_a_sixteenth(number):
    print(f"STEEPEST_SEED={SEED}")
    apart, told = worst(SEED + number, 60 * len(KINDS))
    assert apart <= SIXTEENTH, told


@pytest.mark.needs_jit
@pytest.mark.filterwarnings("ignore::rasterjit.ViewWarning")
def test_steep_samples_have_the_same_bits_in_batches():
    found = [one for one in search(SEED, 2 * len(KINDS), climbs=2) if one.knobs is not None]
    random = np.random.default_rng(SEED)
    for one in found[:4]:
        place = Place(one.kind, random)
        scene = place.scene(place.start(random))
        batch = rj.render_batch(scene, [place.camera] * 3, size=(20, 16), outputs=("linear",))
        single = rj.render(scene, place.camera, size=(20, 16), outputs=("linear",))
        assert all(linear.tobytes() == single.linear.tobytes() for linear in batch.linear)
