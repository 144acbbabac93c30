import importlib
import json

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.accuracy import timing
from rasterjit.accuracy.results import STANDARD
from rasterjit.accuracy.study import Studio
from rasterjit.rendering.quality_selection import light_of, root_mean_square

study_module = importlib.import_module("rasterjit.accuracy.study")

SIZE = (32, 24)


@pytest.fixture(autouse=True)
def few_rounds(monkeypatch):
    monkeypatch.setattr(timing, "MAX_ROUNDS", 2)


def scene():
    made = rj.Scene()
    vertices = np.array([(-1.0, -1, 0), (1, -0.8, 0), (0.2, 1, 0), (-0.7, 0.5, 0.6)])
    material = rj.Material(shading="unlit", base_color="cyan")
    made.add(rj.Mesh(vertices, [(0, 1, 2), (0, 1, 3)], material=material))
    return made


def run(**options):
    options = {"knobs": ("subpixel_bits", "samples"), "budget": 1000.0} | options
    return rj.accuracy.study(scene(), size=SIZE, threads=1, **options)


def run_told(**options):
    """Return a study, and what was told on the way."""
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(timing, "MAX_ROUNDS", 2)
        return run(progress=lambda *what: told.append(what), **options), told


@pytest.fixture(scope="module")
def both_knobs():
    return run_told(name="two triangles", knobs=("samples", "subpixel_bits"))


@pytest.fixture(scope="module")
def found(both_knobs):
    return both_knobs[0]


@pytest.fixture(scope="module")
def one_knob():
    return run_told(knobs=("subpixel_bits",))


def test_a_study_tries_every_level_of_the_knobs(found):
    assert [trial.level for trial in found.of("subpixel_bits")] == ["0", "4", "12"]
    assert [trial.level for trial in found.of("samples")][:5] == ["2", "4", "8", "16", "area"]
    assert found.standard.label == STANDARD
    assert (found.scene, found.size, found.threads, found.rounds) == ("two triangles", SIZE, 1, 2)
    assert found.left_out == ()
    assert found.without_effect == {}
    assert not found.interrupted


def test_every_trial_has_times_errors_and_pictures(found):
    for trial in (found.standard, *found.trials):
        assert len(trial.seconds) == len(trial.ratios) > 0
        assert min(trial.seconds) > 0.0
        assert "compile" not in trial.stages
        assert sum(trial.stages.values()) > 0.0
        assert trial.color.shape == (*SIZE[::-1], 3)
        assert trial.error_map.max() == np.float32(trial.errors.largest)
    assert found.standard.ratio == 1.0
    assert found.reference_color.shape == (*SIZE[::-1], 3)
    assert found.reference_seconds > 0.0


def test_more_samples_and_finer_grids_are_more_accurate(found):
    errors = [found.standard, *found.of("samples")[:4]]
    rmse = [trial.errors.rmse for trial in errors]
    assert rmse == sorted(rmse, reverse=True)
    coarse, fine, exact = (trial.errors.wrong_faces for trial in found.of("subpixel_bits"))
    assert coarse > fine >= found.standard.errors.wrong_faces >= exact == 0


def test_errors_are_the_same_bits_in_every_run(found, one_knob):
    again, _ = one_knob
    for one, other in zip(
        (found.standard, *found.of("subpixel_bits")),
        (again.standard, *again.of("subpixel_bits")),
        strict=True,
    ):
        assert one.label == other.label
        # FLIP is found of what is worth choosing, which times decide.
        assert one.errors._replace(flip=None) == other.errors._replace(flip=None)
        assert one.color.tobytes() == other.color.tobytes()
        assert one.error_map.tobytes() == other.error_map.tobytes()


def test_the_front_is_of_trials_of_the_study(found):
    labels = {trial.label for trial in (found.standard, *found.trials)}
    assert set(found.front) <= labels
    assert rj.accuracy.choose(found).trial.label in labels
    assert all(trial.dominated_by in {None, *labels} for trial in found.trials)


def test_progress_is_told(one_knob):
    _, told = one_knob
    texts = [text for text, _, _ in told]
    assert texts[:2] == ["drawing standard", "drawing the reference"]
    assert texts[-1] == "timing"
    assert texts[2] == "drawing subpixel_bits=0"
    assert texts[3].startswith("drawing subpixel_bits=4; best so far: ")
    spent = [done for _, done, _ in told]
    assert spent[0] >= 0.0
    assert spent == sorted(spent)


def interrupt_at(text):
    def progress(what, done, count):
        if what.partition(";")[0] == text:
            raise KeyboardInterrupt

    return progress


def test_the_files_of_an_interrupted_study_are_readable(tmp_path):
    progress = interrupt_at("drawing samples=4")
    found = run(progress=progress, output=tmp_path / "report")
    assert found.interrupted
    assert [trial.label for trial in found.trials] == ["samples=2", "high"]
    assert found.left_out[:2] == ("subpixel_bits=0", "subpixel_bits=4")
    held = json.loads((tmp_path / "report" / "accuracy.json").read_text())
    assert held["take"]["label"] in ("standard", "samples=2", "high")
    assert held["interrupted"]
    assert len(held["trials"]) == 2
    assert held["left_out"] == list(found.left_out)


def test_interrupted_rounds_leave_the_first_times(tmp_path):
    found = run(knobs=("subpixel_bits",), progress=interrupt_at("timing"), output=tmp_path)
    assert found.rounds == 0
    assert {len(trial.seconds) for trial in found.trials} == {1}


def test_interrupted_before_there_is_anything_it_is_over():
    with pytest.raises(KeyboardInterrupt):
        run(progress=interrupt_at("drawing standard"))


def test_what_there_is_no_time_for_is_named():
    found = run(budget=1e-6)
    assert found.trials == ()
    assert "samples=8" in found.left_out
    assert len(found.standard.seconds) == 1


def test_a_setting_without_effect_is_not_tried():
    found = run(knobs=("subpixel_bits", "texture_filter", "shadow_size"))
    assert set(found.without_effect) == {"texture_filter", "shadow_size"}
    assert {trial.setting for trial in found.trials} == {"subpixel_bits"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"budget": 0.0}, "budget must be above 0, got 0.0"),
        ({"budget": -3}, "budget must be above 0, got -3"),
        ({"budget": float("nan")}, "budget must be finite"),
        ({"max_error": 0.0}, "max_error must be above 0, got 0.0"),
        ({"budget": "long"}, "budget must be a number, got 'long'"),
        ({"knobs": ["colour"]}, "knobs has 'colour', which is unknown"),
        ({"output": 3}, "output must be a folder, got 3"),
        ({"threads": 0}, "threads must be in 1..1024"),
    ],
)
def test_bad_arguments_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        rj.accuracy.study(scene(), **{"size": SIZE, "threads": 1, **options})


def test_a_size_that_is_none_is_named():
    with pytest.raises(ValueError, match=r"size must be \(width, height\)"):
        rj.accuracy.study(scene(), size=5)


def test_what_promises_most_is_tried_first(both_knobs):
    found, told = both_knobs
    drawn = [text.partition(";")[0].removeprefix("drawing ") for text, _, _ in told]
    assert drawn[2:12] == [
        "high", "samples=2", "samples=4", "samples=8", "samples=16", "subpixel_bits=0",
        "samples=area", "subpixel_bits=4", "subpixel_bits=12", "samples=64",
    ]  # fmt: skip
    assert [trial.label for trial in found.trials][:2] == ["subpixel_bits=0", "subpixel_bits=4"]


def test_what_is_or_turns_out_not_to_be_possible_is_named_and_the_rest_is_studied(monkeypatch):
    prepare = Studio.prepare

    def refuse(studio, attempt, reference):
        if attempt.label == "samples=4":
            raise ValueError("too many layers")
        return prepare(studio, attempt, reference)

    monkeypatch.setattr(Studio, "prepare", refuse)
    made = scene()
    glass = rj.Material(shading="unlit", base_color=(1, 0, 0, 0.5), alpha_mode="blend")
    made.nodes[0].mesh.material = glass
    found = rj.accuracy.study(made, size=SIZE, threads=1, knobs=("samples",), budget=1000.0)
    assert found.impossible.keys() == {"samples=area", "samples=4"}
    assert "blended" in found.impossible["samples=area"]
    assert found.impossible["samples=4"] == "too many layers"
    assert "samples=4" not in found.left_out
    assert "samples=8" in [trial.label for trial in found.trials]


def test_a_reference_without_time_has_fewer_samples_and_says_so(one_knob):
    found, (full, _) = run(budget=1e-6), one_knob
    assert found.reference_samples == 4
    assert (full.reference_samples, full.reference_error) == (256, 0.0)


def test_the_error_of_a_reference_of_fewer_samples_is_told(monkeypatch):
    made = scene()
    # Each step takes a second: the next one is expected to take four.
    monkeypatch.setattr(timing, "sum_stages", lambda stages: 1.0)
    with Studio(made, rj.fit_camera(made), (64, 48), 1) as studio:
        full, part = studio.draw_reference(1000.0), studio.draw_reference(5.5)
    true = root_mean_square(light_of(part.picture) - light_of(full.picture))
    assert (full.samples, full.error, part.samples) == (256, 0.0, 16)
    assert 0.3 * true < part.error < 3.0 * true


@pytest.mark.parametrize(
    ("per_pixel", "fixed", "size"), [(1.0, 0.0, (128, 96)), (0.0, 9e5, (512, 384))]
)
def test_where_no_reference_is_drawn_in_time_the_picture_is_made_smaller_if_that_helps(
    per_pixel, fixed, size
):
    made = scene()
    with Studio(made, rj.fit_camera(made), (512, 384), 1) as studio:
        studio.time_stages = lambda attempt: {
            "shade": fixed + per_pixel * studio.size[0] * studio.size[1]
        }
        studio.shrink(None, 16 * 1.5 * 128 * 96)
        assert studio.size == size


def test_a_study_through_a_lens_weighs_it():
    lens = rj.PinholeDistortion(k1=-0.2)
    found = rj.accuracy.study(
        scene(), size=SIZE, threads=1, knobs=("samples",), budget=1000.0, lens=lens
    )
    assert [trial.level for trial in found.of("samples")][:4] == ["2", "4", "8", "16"]
    (cost,) = [one for one in found.effects if one.effect == "lens"]
    assert {level.level: level.errors.rmse < cost.rmse for level in cost.levels} == {
        "samples=4": True, "samples=16": True,
    }  # fmt: skip
