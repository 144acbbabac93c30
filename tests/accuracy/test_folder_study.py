"""One quality for many scenes: what holds on each of them, and is fastest over all."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import rasterjit as rj
from rasterjit.accuracy import timing
from rasterjit.cli.commands import program

SIZE = (32, 24)
FEW = {"size": SIZE, "threads": 1, "budget": 60.0, "knobs": ("subpixel_bits", "samples")}


@pytest.fixture(autouse=True)
def few_rounds(monkeypatch):
    monkeypatch.setattr(timing, "MAX_ROUNDS", 2)


def scene(turn):
    made = rj.Scene()
    vertices = np.array([(-1.0, -1, 0), (1, -0.8, 0), (0.2, 1, 0)])
    material = rj.Material(shading="unlit", base_color="cyan")
    made.add(rj.Mesh(vertices, [(0, 1, 2)], material=material), rj.transforms.rotate_z(turn))
    return made


@pytest.fixture(scope="module")
def found():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(timing, "MAX_ROUNDS", 2)
        scenes = {"a": scene(0.0), "b": lambda: (scene(40.0), None)}
        return rj.accuracy.study_folder(scenes, max_error=0.03, name="two", **FEW)


def test_every_candidate_was_tried_on_every_scene(found):
    assert list(found.studies) == ["a", "b"]
    assert {"standard", "high"} <= set(found.candidates)
    assert {len(trials) for trials in found.candidates.values()} == {2}
    for label, trials in found.candidates.items():
        assert {trial.quality for trial in trials} == {trials[0].quality}, label


def test_the_choice_holds_the_error_on_all_scenes(found):
    taken = found.candidates[found.take.trial.label]
    assert found.take.holds
    assert max(trial.errors.rmse for trial in taken) <= 0.03
    usual = found.candidates["standard"]
    assert max(trial.errors.rmse for trial in usual) > 0.03, "else there is nothing to choose"


def test_the_total_of_a_quality_is_the_mean_time_and_the_worst_error(found):
    for total in found.totals:
        trials = found.candidates[total.label]
        assert total.errors.rmse == max(trial.errors.rmse for trial in trials)
        low, high = sorted(trial.ratio for trial in trials)
        assert low * 0.7 <= total.ratio <= high * 1.4


def test_without_a_bound_nothing_is_taken_that_is_worse_anywhere():
    scenes = {"a": scene(0.0), "b": scene(40.0)}
    found = rj.accuracy.study_folder(scenes, **{**FEW, "knobs": ("subpixel_bits",)})
    taken = found.candidates[found.take.trial.label]
    for one, usual in zip(taken, found.candidates["standard"], strict=True):
        assert one.errors.rmse <= usual.errors.rmse * 1.005


def test_a_folder_gets_one_page_and_one_for_each_scene(tmp_path):
    meshes = tmp_path / "meshes"
    (meshes / "more").mkdir(parents=True)
    for place in (meshes / "a.obj", meshes / "more" / "b & c.obj"):
        place.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (meshes / "broken.obj").write_text("v 0 0 zero\nf 1 2 3\n")
    result = CliRunner().invoke(
        program,
        ["accuracy", str(meshes), "-o", str(tmp_path / "out"), "--knobs", "subpixel_bits",
         "--size", "24x16", "--budget", "20", "--threads", "1"],
    )  # fmt: skip
    assert result.exit_code == 1, result.output
    assert "1 of 3 mesh files could not be studied" in result.stderr
    assert "Take " in result.stdout
    assert "for all 2 scenes" in result.stdout
    assert "not studied: broken.obj: " in result.stdout
    held = json.loads((tmp_path / "out" / "accuracy.json").read_text())
    assert list(held["scenes"]) == ["a.obj", "more/b & c.obj"]
    assert held["take"]["label"] in held["scenes"]["a.obj"]
    text = (tmp_path / "out" / "index.html").read_text()
    assert 'href="more/b%20%26%20c.obj/index.html">more/b &amp; c.obj' in text
    assert (tmp_path / "out" / "more" / "b & c.obj" / "index.html").exists()


@pytest.mark.parametrize(
    ("folder", "words"),
    [
        ({}, "folder must hold scenes, got an empty mapping"),
        ({"../a": rj.Scene()}, "folder must have names of scenes without '..', got '../a'"),
        ("nowhere", "folder must be a folder, but 'nowhere' does not exist"),
        (3, "folder must be the name of a folder, got 3"),
    ],
)
def test_what_is_no_folder_is_named(folder, words):
    with pytest.raises(ValueError, match=words):
        rj.accuracy.study_folder(folder, **FEW)


def test_a_folder_without_meshes_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"folder must hold mesh files, got .*, without any"):
        rj.accuracy.study_folder(tmp_path, **FEW)
    result = CliRunner().invoke(program, ["accuracy", str(tmp_path), "-o", str(tmp_path / "o")])
    assert result.exit_code == 2
    assert "no mesh files in" in result.output


def test_scenes_of_which_none_can_be_drawn_are_named():
    def broken():
        raise ValueError("it is broken")

    with pytest.raises(ValueError, match="none to study: a: it is broken"):
        rj.accuracy.study_folder({"a": broken}, **FEW)
