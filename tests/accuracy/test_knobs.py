import dataclasses

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.accuracy import settings_to_try
from rasterjit.accuracy.settings_to_try import (
    check_knobs,
    find_idle_settings,
    list_combined_attempts,
    list_preset_attempts,
    list_single_attempts,
)
from rasterjit.accuracy.test_scenes import MADE_FOR, SCENES, make
from rasterjit.scene.quality import LEVELS, differences

STANDARD = rj.Quality.standard()
TRIANGLE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], float), [(0, 1, 2)]


def idle(scene, camera=None):
    return find_idle_settings(rj.explain(scene, camera, size=(32, 24)), tuple(LEVELS))


def one(shading="phong", **material):
    scene = rj.Scene()
    scene.add(rj.Mesh(*TRIANGLE, material=rj.Material(shading=shading, **material)))
    return scene


def colored(shading):
    """Return a scene of a triangle with colours of its vertices."""
    scene = rj.Scene()
    material = rj.Material(shading=shading)
    scene.add(rj.Mesh(*TRIANGLE, colors=np.eye(3), material=material))
    return scene


def test_every_level_is_tried_one_at_a_time_from_the_standard():
    attempts = list_single_attempts(tuple(LEVELS))
    for attempt in attempts:
        changes = differences(attempt.quality, STANDARD)
        assert changes == {attempt.setting: getattr(attempt.quality, attempt.setting)}
        assert attempt.label == f"{attempt.setting}={attempt.level}"
    tried = {(attempt.setting, attempt.level) for attempt in attempts}
    wanted = {(name, str(level)) for name, levels in LEVELS.items() for level in levels}
    own = {(name, str(getattr(STANDARD, name))) for name in LEVELS}
    assert tried == wanted - own
    assert len({attempt.label for attempt in attempts}) == len(attempts)


def test_combinations_change_several_settings_and_are_not_too_many():
    presets = list_preset_attempts(tuple(LEVELS))
    assert [attempt.level for attempt in presets] == ["draft", "high"]
    attempts = presets + list_combined_attempts(tuple(LEVELS))
    assert 10 < len(attempts) <= settings_to_try.MAX_COMBINATIONS + 2
    for attempt in attempts:
        assert len(differences(attempt.quality, STANDARD)) > 1
    assert len({attempt.quality for attempt in attempts}) == len(attempts)
    assert len({attempt.label for attempt in attempts}) == len(attempts)


def test_a_label_of_a_combination_is_what_the_command_line_takes():
    for attempt in list_combined_attempts(tuple(LEVELS)):
        changes = {}
        for text in attempt.level.split():
            changes |= rj.scene.quality.parse_setting(text)
        assert dataclasses.replace(STANDARD, **changes) == attempt.quality


def test_only_what_was_asked_for_is_changed():
    for attempt in [
        *list_single_attempts(("samples",)),
        *list_combined_attempts(("samples", "shading")),
    ]:
        assert set(differences(attempt.quality, STANDARD)) <= {"samples", "shading"}
    assert list_combined_attempts(("samples",)) == []


def test_a_level_that_is_useless_by_itself_is_in_no_combination():
    useless = {"transparency_layers=2", "samples=16"}
    labels = [one.label for one in list_combined_attempts(tuple(LEVELS), useless)]
    assert labels
    assert not any(label in useless for text in labels for label in text.split())


def test_as_many_as_wanted_are_taken_evenly():
    assert settings_to_try.pick_evenly(range(5), 9) == [0, 1, 2, 3, 4]
    assert settings_to_try.pick_evenly(range(10), 5) == [0, 2, 4, 6, 8]


def test_knobs_come_in_the_order_of_the_settings():
    assert check_knobs(None) == tuple(LEVELS)
    assert check_knobs(["shading", "samples", "shading"]) == ("samples", "shading")
    assert check_knobs("samples") == ("samples",)


@pytest.mark.parametrize("name", ["sample", "", "Samples"])
def test_an_unknown_knob_is_named_and_the_known_are_listed(name):
    with pytest.raises(ValueError, match=f"knobs has '{name}'.*subpixel_bits, samples.*lines"):
        check_knobs([name])


def test_no_knobs_are_too_few():
    with pytest.raises(ValueError, match=r"at least one of subpixel_bits.*got none"):
        check_knobs([])


@pytest.mark.parametrize("name", list(SCENES))
def test_a_made_scene_needs_the_settings_that_it_was_made_for(name):
    made = make(name)
    wanted = {setting for setting, scene in MADE_FOR.items() if scene == name}
    assert wanted.isdisjoint(idle(made.scene, made.camera))


@pytest.mark.parametrize(
    ("setting", "scene", "words"),
    [
        ("texture_filter", one(), "no material has a texture"),
        ("shadow_size", one(), "no light casts them"),
        ("shadow_taps", one(), "no light casts them"),
        ("transparency_layers", one(), "no material is blended"),
        ("blending", one(), "no material is blended, and the standard has one sample"),
        ("texture_mixing", one(), "no material in view has a texture"),
        ("lines", one(), "wireframe is None"),
        ("lines", one(), "outline is None"),
        ("shading", one("flat"), "no material in view is gouraud or phong"),
        ("shading", one("unlit"), "every material in view is unlit"),
        ("renormalize", one("gouraud"), "no normals are interpolated"),
        ("renormalize", one("unlit"), "every material in view is unlit"),
        ("interpolation_precision", one("unlit"), "no mesh in view has colours of its vertices"),
        ("interpolation_precision", colored("gouraud"), "an object is lit"),
    ],
)
def test_a_setting_without_effect_has_its_reason(setting, scene, words):
    assert words in idle(scene)[setting]


def test_what_a_plain_scene_needs():
    assert set(LEVELS) - set(idle(one())) == {
        "subpixel_bits", "samples", "interpolation", "depth_format", "precision", "shading",
        "renormalize",
    }  # fmt: skip


def test_unlit_colours_of_vertices_need_a_precision():
    assert "interpolation_precision" not in idle(colored("unlit"))


def test_parallel_light_rays_need_no_perspective():
    camera = rj.OrthographicCamera((0, 0, 3), (0, 0, 0), height=2.0)
    assert "orthographic" in idle(one(), camera)["interpolation"]


def test_with_nothing_in_view_no_setting_has_an_effect():
    camera = rj.PerspectiveCamera((0, 0, 3), (0, 0, 6))
    assert idle(one(), camera) == dict.fromkeys(LEVELS, "no object is in view")
