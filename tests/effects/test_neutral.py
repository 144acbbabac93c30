"""An effect with neutral data changes no bit: what `explain_pixel` takes for a frame without it."""

from __future__ import annotations

import pytest
import switched_off
from cubes import CUBE_FACES, CUBE_VERTICES

import rasterjit as rj
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.survey.effect import Effect

SIZE = (61, 40)

NEUTRAL = [effect for effect in EFFECTS if type(effect).neutral is not Effect.neutral]


def drawn(scene):
    # Beneath an environment all is found in float64, and some objects in float32 without one.
    exact = rj.Quality(interpolation_precision="float64")
    options = {"size": SIZE, "outputs": ("color", "linear"), "threads": 1, "quality": exact}
    return rj.render(scene, switched_off.CAMERA, **options)


def bits(frame):
    return frame.color.tobytes(), frame.linear.tobytes()


@pytest.fixture(scope="module")
def scene():
    """One scene, so that its sky is filtered once; a cube goes through its squares: corners."""
    made = switched_off.full_scene()
    made.add(rj.Mesh(CUBE_VERTICES, CUBE_FACES, material=rj.Material("phong")))
    return made


def test_effects_on_lit_samples_have_neutral_data():
    asked = {"rows", "light", "around", "sample"}
    assert [effect.name for effect in EFFECTS if not asked.isdisjoint(effect.places)] == [
        effect.name for effect in NEUTRAL if not asked.isdisjoint(effect.places)
    ]
    assert all(effect.places for effect in NEUTRAL)


@pytest.mark.parametrize("effect", NEUTRAL, ids=lambda effect: effect.name)
def test_neutral_data_leave_the_bits_of_a_frame_without_the_effect(effect, scene, monkeypatch):
    without = drawn(effect.without(scene))
    assert not without.plan.has(effect.name)
    assert bits(drawn(scene)) != bits(without)
    acted = []

    def neutralized(place, act):
        def act_neutrally(record, *arguments):
            acted.append(place)
            return act(effect.neutral(record), *arguments)

        return act_neutrally

    places = {place: neutralized(place, act) for place, act in effect.places.items()}
    monkeypatch.setattr(type(effect), "places", places)
    frame = drawn(scene)
    assert frame.plan.has(effect.name)
    assert {*acted} == {*places}
    assert bits(frame) == bits(without)
