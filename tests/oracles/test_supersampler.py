"""The reference is the most accurate level: held against another program's 256 points a pixel."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import rasterjit as rj
from rasterjit.accuracy.test_scenes import SCENES, MadeScene, make
from rasterjit.rendering.quality_selection import light_of

sys.path.append(str(Path(__file__).parents[2]))
program = importlib.import_module("benchmarks.supersampler")
true_light = importlib.import_module("benchmarks.true_pictures").true_light

SIZE = (96, 72)

NEAR = {"floor": 0.01, "checkerboard": 0.013, "coplanar": 0.012, "wireframe": 0.01}
"""
What the reference's error is below, where that is not 0.002.

Points far away show single texels of a pattern, which is not filtered; sheets move through each
other as their vertices are rounded to the grid; where lines end their areas are a little off.
"""


def checkerboard():
    """A checkerboard that reaches to the horizon, whose squares become far smaller than pixels."""
    dark = np.add.outer(np.arange(64) // 8, np.arange(64) // 8) % 2
    texels = np.repeat(np.where(dark, 0.05, 0.9)[..., np.newaxis], 3, axis=2)
    corners = [(-200, 0, 2), (200, 0, 2), (200, 0, -400), (-200, 0, -400)]
    uv = np.array(corners)[:, ::2] / 8.0
    material = rj.Material(shading="unlit", base_color_texture=rj.Texture(texels))
    scene = rj.Scene()
    scene.add(rj.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv, material=material))
    return MadeScene(scene, rj.PerspectiveCamera((0.0, 1.5, 0.0), (0.3, 0.5, -6.0)), SIZE)


@pytest.mark.takes_long
@pytest.mark.parametrize("name", [*SCENES, "checkerboard"])
def test_no_level_is_nearer_to_the_truth_than_the_reference(name):
    made = checkerboard() if name == "checkerboard" else make(name)
    errors = program.errors_of(made, SIZE)
    assert len(errors) > 12
    assert program.nearer_than_reference(errors) == []
    assert errors["reference"] < 0.5 * errors["standard"]
    assert errors["reference"] < NEAR.get(name, 0.002)


def test_the_reference_nears_the_mean_of_more_points():
    """What is left on a checkerboard is the error of points that are not filtered."""
    made, size = checkerboard(), (48, 36)
    frame = rj.render(made.scene, made.camera, size=size, quality=rj.Quality.reference(),
                      outputs=("linear",))  # fmt: skip
    errors = [
        np.sqrt(np.mean((light_of(frame) - true_light(made.scene, made.camera, size, side)) ** 2))
        for side in (4, 8, 16)
    ]
    assert errors[0] > 1.7 * errors[1] > 1.7**2 * errors[2]


def test_the_truth_refuses_what_it_cannot_draw():
    foggy, lamp = rj.Scene(), rj.Scene()
    foggy.fog = rj.Fog("grey", density=0.1)
    lamp.lights = [rj.PointLight((0, 0, 0))]
    camera = make("glass").camera
    for scene, what in ((foggy, r"scene\.fog"), (lamp, "lights")):
        with pytest.raises(ValueError, match=what):
            true_light(scene, camera, SIZE)


def test_the_program_prints_a_column_for_each_scene_and_names_what_is_nearer():
    done = CliRunner().invoke(program.main, ["--only", "highlights", "--size", "24", "18"])
    assert done.exit_code == 0, done.output
    assert "highlights" in done.output
    assert "renormalize=False" in done.output
    assert program.nearer_than_reference({"reference": 0.2, "high": 0.1, "draft": 0.3}) == ["high"]
