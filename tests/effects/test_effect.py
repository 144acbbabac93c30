"""What an effect is: mistakes in its description are told where it is defined."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import changes
import pytest

import rasterjit as rj
from rasterjit.cli import help, options
from rasterjit.rendering.effect_registry import EFFECTS
from rasterjit.scene.scene import EFFECT_FIELDS
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


def test_a_field_that_no_scene_has_is_refused():
    with pytest.raises(ValueError, match=r"Misspelt\.field is 'saturat'; possible are wireframe, "):

        class Misspelt(Effect):
            field = "saturat"


# What else an effect needs; `rasterjit/README.md` lists it.


def test_every_effect_of_a_scene_is_complete():
    lacking = {*EFFECT_FIELDS} - {effect.field for effect in EFFECTS} - {"environment"}
    assert not lacking, f"add {lacking} to EFFECTS in rendering/effect_registry.py"
    lacking = {*EFFECT_FIELDS} - {*changes.EFFECTS}
    assert not lacking, f"add {lacking} to EFFECTS in tests/support/changes.py"
    lacking = {kind.__name__ for kind in EFFECT_FIELDS.values() if kind.__name__ not in rj.__doc__}
    assert not lacking, f"add {lacking} to the manual in rasterjit/__init__.py"


def test_every_option_of_an_effect_is_in_a_group_and_refused_where_it_would_be_idle():
    fields = {field.name for field in dataclasses.fields(options.Effects)} - {"style"}
    lacking = fields - {name for names in help.OPTION_GROUPS.values() for name in names}
    assert not lacking, f"add {lacking} to OPTION_GROUPS in rasterjit/cli/help.py"
    lacking = fields & {*EFFECT_FIELDS} - {"section", *options.COLOR_OPTIONS, *options.CODE_OPTIONS}
    assert not lacking, f"add {lacking} to COLOR_OPTIONS or CODE_OPTIONS in cli/options.py"
