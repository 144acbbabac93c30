"""Effects are weighed against references that are known: closed forms, and each other."""

import math

import numpy as np
import pytest
from made_trials import errors

import rasterjit as rj
from rasterjit.accuracy import effect_references as references
from rasterjit.accuracy import effects
from rasterjit.accuracy.settings_to_try import Attempt
from rasterjit.accuracy.study import Studio
from rasterjit.accuracy.timing import Contestant

SIZE = (48, 36)
STANDARD = rj.Quality.standard()
GROUND = [(-4, 0, 4), (4, 0, 4), (4, 0, -4), (-4, 0, -4)], [(0, 1, 2), (0, 2, 3)]
CAMERA = rj.PerspectiveCamera((0.0, 3.0, 4.0), (0.0, 0.3, 0.0))


def scene(**fields):
    """A ball on a white ground, lit by ambient light unless other lights are given."""
    made = rj.Scene()
    white = rj.Material(base_color="white", specular=0.0)
    made.add(rj.Mesh(*GROUND, material=white), name="ground")
    ball = rj.Mesh(*sphere(), material=white)
    made.add(ball, rj.transforms.translate((0.0, 0.8, 0.0)), name="ball")
    made.lights.append(rj.AmbientLight(intensity=0.8))
    for name, value in fields.items():
        setattr(made, name, value)
    return made


def sphere(rows=12, columns=18, radius=0.7):
    rings = np.linspace(0.0, math.pi, rows + 1)
    turns = np.linspace(0.0, 2.0 * math.pi, columns + 1)
    ring, turn = np.meshgrid(rings, turns, indexing="ij")
    points = np.stack(
        [np.sin(ring) * np.cos(turn), np.cos(ring), -np.sin(ring) * np.sin(turn)], -1
    ).reshape(-1, 3)
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    low = first + columns + 1
    faces = np.concatenate(
        [np.stack([first, low, low + 1], 1), np.stack([first, low + 1, first + 1], 1)]
    )
    return radius * points, faces


def weighed(made, lens=None):
    plan = rj.explain(made, CAMERA, size=SIZE)
    usual = Attempt("standard", "standard", STANDARD)
    standard = Contestant(usual, errors(), None, None, {"shade": 1.0}, 1.0)
    with Studio(made, CAMERA, SIZE, 1, lens) as studio:
        return {
            cost.effect: effects.measure_effect(studio, cost, standard, 1e3)
            for cost in effects.list_effect_trials(made, plan, lens)
        }


def levels(found):
    return {level.attempt.level: level.errors.rmse for level in found.levels}


def soft(size):
    return rj.DirectionalLight((-0.6, -1.0, -0.3), shadow=rj.Shadow(512, "soft", light_size=size))


def test_an_effect_that_is_out_is_not_weighed():
    assert weighed(scene()) == {}


def test_soft_shadows_are_nearer_to_the_light_they_stand_for_than_hard_ones():
    found = weighed(scene(lights=[rj.AmbientLight(intensity=0.2), soft(12.0)]))["shadows"]
    errors = levels(found)
    assert found.rmse < 0.5 * errors["hard edges"]
    assert errors["hard edges"] < errors["without"]
    assert "places all over each light" in found.reference


def test_a_point_of_a_light_is_as_far_off_as_the_light_is_large():
    middle = np.zeros(3)
    spread = references.spread_over_disk(4000)
    assert np.hypot(*spread.T).max() <= 1.0
    assert np.hypot(*spread.T).mean() == pytest.approx(2.0 / 3.0, abs=2e-3)
    sun = references._sample_light(soft(10.0), 1.0, 0.0, middle)
    angle = math.degrees(math.acos(np.dot(sun.direction, soft(10.0).direction)))
    assert (angle, sun.shadow.filter) == (pytest.approx(5.0), "hard")
    lamp = rj.PointLight((0, 3, 0), shadow=rj.Shadow(filter="soft", light_size=0.5))
    moved = references._sample_light(lamp, 0.0, -1.0, middle)
    assert np.linalg.norm(np.subtract(moved.position, lamp.position)) == pytest.approx(0.25)
    assert moved.position[1] == pytest.approx(3.0)


def test_larger_maps_come_nearer_to_sharp_shadows():
    sun = rj.DirectionalLight((-0.6, -1.0, -0.3), shadow=rj.Shadow(64, "hard"))
    found = weighed(scene(lights=[sun]))["shadows"]
    assert levels(found)["shadow_size=2048"] < 0.7 * found.rmse


def test_lights_that_stand_for_a_sky_shed_its_light():
    sky = rj.Environment.gradient("#88aaff", "#ffffff", "#444422")
    lights = references.find_dome_lights(sky)
    assert len(lights) == references.MAX_DOME_LIGHTS
    image, _, areas = references.sample_sky(sky)
    power = (image * areas[:, None, None]).sum(axis=(0, 1))
    shed = np.pi * sum(np.multiply(light.intensity, light.color) for light in lights)
    assert shed == pytest.approx(power, rel=0.01)
    # On a surface that faces up, by the closed form of a gradient.
    zenith, horizon = np.array(sky.sky.zenith), np.array(sky.sky.horizon)
    above = sum(
        np.multiply(light.intensity * max(-light.direction[1], 0.0), light.color)
        for light in lights
    )
    assert above == pytest.approx(horizon / 3.0 + zenith * 2.0 / 3.0, rel=6e-3)


def test_a_turned_sky_has_its_lights_where_it_is_seen():
    image = np.zeros((32, 64, 3), np.float32)
    image[10:12, 30:34] = 50.0
    scenes = [scene(lights=[], environment=rj.Environment(image, rotation=90.0))]
    for light in references.find_dome_lights(scenes[0].environment):
        # What lay towards +x comes from -z.
        assert light.direction[2] > 0.7


def test_light_from_everywhere_and_of_a_small_sun_is_that_of_many_lamps():
    even = weighed(scene(lights=[], environment=rj.Environment.constant("#cccccc")))
    assert even["environment light"].rmse < 3e-3
    image = np.full((64, 128, 3), 0.2, np.float32)
    image[20:22, 40:42] = 300.0
    sunny = weighed(scene(lights=[], environment=rj.Environment(image)))["environment light"]
    assert sunny.rmse < 3e-3
    assert 10.0 * sunny.rmse < levels(sunny)["one colour"] < levels(sunny)["without"]


def test_half_spaces_are_blocked_as_closed_forms_say():
    corner = rj.Scene()
    wall = [(0, 0, -50), (0, 0, 50), (0, 100, 50), (0, 100, -50)]
    ceiling = [(-60, 1, -60), (60, 1, -60), (60, 1, 60), (-60, 1, 60)]
    up = np.array([(0.0, 1.0, 0.0)])
    corner.add(rj.Mesh(wall, GROUND[1]))
    # A wall at the foot of which one stands takes half.
    assert references.measure_occlusion(
        corner, np.array([(0.2, 0.0, 0.0)]), up, 20.0
    ) == pytest.approx(0.5, abs=0.03)
    lid = rj.Scene()
    lid.add(rj.Mesh(ceiling, GROUND[1]))
    # Of a ceiling at height 1 a radius of 2 reaches 60 degrees off the normal: sin² of that.
    assert references.measure_occlusion(lid, np.zeros((1, 3)), up, 2.0) == pytest.approx(
        0.75, abs=0.02
    )
    assert references.measure_occlusion(lid, np.zeros((1, 3)), -up, 2.0) == pytest.approx(0.0)


def test_ambient_occlusion_is_nearer_to_rays_than_none():
    made = scene(ambient_occlusion=rj.AmbientOcclusion(1.5))
    found = weighed(made)["ambient occlusion"]
    assert 0.0 < found.rmse < 0.6 * levels(found)["without"]


def test_smooth_edges_are_what_edges_are_measured_by():
    found = weighed(scene(wireframe=rj.Wireframe("red")))["wireframe"]
    assert levels(found)["lines=coverage"] == 0.0 < found.rmse < levels(found)["without"]


def test_lines_are_weighed_where_they_are_seen():
    made = scene()
    made.add(rj.Lines([(-2, 0.1, 2), (2, 2.0, -1)], [(0, 1)], width=2.0))
    found = weighed(made)["lines"]
    rmse = levels(found)
    assert rmse["samples=16"] < rmse["samples=4"] < found.rmse < rmse["without"]


def test_an_effect_without_a_row_is_left_out_and_has_no_error():
    found = weighed(scene(fog=rj.Fog(density=0.1)))["fog"]
    assert (found.rmse, found.reference) == (None, effects.NO_REFERENCE_NAME)
    assert levels(found)["without"] > 0.0


def test_every_row_of_the_table_is_an_effect():
    names = {one.name for one in rj.explain(scene(), CAMERA).effects}
    assert {options.effect for options in effects.EFFECT_OPTIONS} <= names | {
        effects.LINES_NAME,
        effects.LENS_NAME,
    }
