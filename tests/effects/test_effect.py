"""What an effect is: mistakes in its description are told where it is defined."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import pytest

import rasterjit as rj
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.survey.effect import PLACES, Effect


def test_a_place_that_there_is_not_is_refused():
    with pytest.raises(ValueError, match=r"Misspelt\.places has 'overlays'; possible are rows"):

        class Misspelt(Effect):
            places: ClassVar = {"overlays": print}


def test_some_effect_acts_at_every_place():
    assert {place for effect in EFFECTS for place in effect.places} == {*PLACES}


def test_settings_of_effects_are_those_of_the_quality():
    fields = {field.name for field in dataclasses.fields(rj.Quality)}
    assert {setting for effect in EFFECTS for setting in effect.settings} < fields
