"""The program that holds the dial to what was asked for."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import rasterjit as rj
from rasterjit.rendering import quality_selection

sys.path.append(str(Path(__file__).parents[2]))
program = importlib.import_module("benchmarks.dial")


@pytest.fixture(autouse=True)
def one_small_scene(tmp_path, monkeypatch):
    monkeypatch.setattr(quality_selection, "user_cache_folder", lambda: tmp_path)
    made = rj.accuracy.make("wireframe")
    orbit = program.Orbit("ground", made.scene, made.camera)
    monkeypatch.setattr(program, "orbits", lambda: iter([orbit]))
    picture = program.Picture("ground", lambda: (made.scene, made.camera), (24, 18))
    monkeypatch.setattr(program, "PICTURES", [picture])
    return orbit


def run(*options):
    return CliRunner().invoke(program.main, ["--size", "48", "36", "--frames", "2", *options])


def test_it_tells_times_and_errors_of_every_frame():
    done = run("--budget", "30")
    assert done.exit_code == 0, done.output
    assert done.output.count("100 %") == 2
    assert done.output.count("yes") >= len(program.BOUNDS)
    assert "median" in done.output


def test_an_error_beyond_its_bound_is_a_fault(monkeypatch):
    monkeypatch.setattr(
        quality_selection.Reference, "bound_error", lambda reference, frame: (0.0, 0.0)
    )
    done = run("--budget", "30")
    assert done.exit_code == 1
    assert "NO" in done.output


def test_frames_that_take_longer_are_counted():
    late = program.Kept((0.02, 0.024, 0.026, 0.03), (0.02,) * 4, (rj.Quality(),) * 4)
    assert late.share(0.02) == 0.5


def test_the_camera_goes_around_its_target(one_small_scene):
    camera = one_small_scene.camera
    turned = one_small_scene.turned(90.0)
    way, new = (np.subtract(one.eye, one.target) for one in (camera, turned))
    np.testing.assert_allclose(new, (way[2], way[1], -way[0]), atol=1e-12)
