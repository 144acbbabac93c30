"""A machine is measured once, on scenes of its own, for the dial to choose from."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

import rasterjit as rj
from rasterjit.accuracy import calibration
from rasterjit.cli.commands import program
from rasterjit.rendering import quality_selection as profiles
from rasterjit.rendering.quality_selection import load_profile
from rasterjit.scene.quality import Quality

SMALL_LADDER = (Quality.draft(), Quality.standard(), Quality(samples=4), Quality.reference())


@pytest.fixture(autouse=True)
def small(tmp_path, monkeypatch):
    monkeypatch.setattr(profiles, "user_cache_folder", lambda: tmp_path)
    monkeypatch.setattr(calibration, "LADDER", SMALL_LADDER)
    monkeypatch.setattr(calibration, "SCENES_USED", ("small",))
    monkeypatch.setattr(calibration, "ROUNDS", 1)
    monkeypatch.setattr(calibration, "make", lambda name: rj.accuracy.MadeScene(*made()))


def made():
    scene = rj.Scene()
    scene.add(rj.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]))
    return scene, rj.PerspectiveCamera((0.3, 0.3, 2), (0.3, 0.3, 0)), (32, 24)


def test_the_profile_holds_a_front_and_is_kept():
    told = []
    profile, path = rj.accuracy.calibrate(threads=1, progress=lambda *what: told.append(what))
    assert path.name == "profile.json"
    assert load_profile() == profile
    assert told == [("drawing small", 0, 1)]
    errors = [step.error for step in profile.steps]
    assert errors == sorted(errors, reverse=True)
    assert profile.steps[-1].quality == Quality.reference()
    assert profile.steps[-1].error == 0.0
    assert profile.threads == 1


def test_the_command_prints_it_and_says_where_it_is_kept(tmp_path):
    done = CliRunner().invoke(program, ["accuracy", "--calibrate", "--threads", "1"])
    assert done.exit_code == 0, done.output
    assert "reference" in done.output
    assert str(tmp_path / "profile.json") in done.output
    assert load_profile() is not None


@pytest.mark.parametrize("more", [["models/teapot.obj"], ["--scene", "floor"], ["-o", "x"]])
def test_calibrating_takes_no_scene(more):
    done = CliRunner().invoke(program, ["accuracy", "--calibrate", *more])
    assert done.exit_code == 2
    assert "--calibrate draws scenes of its own" in done.output
