"""What the guide says of `interpolation_precision`, scene by scene: a script of models/."""

import re
from pathlib import Path

import numpy as np
import pytest

import rasterjit as rj

MODELS = Path(__file__).parents[2] / "models"
SIZE = (48, 36)


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(MODELS)
    import make_accuracy

    return make_accuracy


def sentence(script, name, **material):
    scene = script.precision_scenes()[name]
    if material:
        scene.nodes[0].mesh.material = rj.Material("unlit", **material)
    return script.precision_sentence(name, scene, SIZE, 5.0)


def test_scenes_are_of_one_kind_of_colour_each(script):
    scenes = script.precision_scenes()
    facts = [rj.explain(scene, size=SIZE).facts for scene in scenes.values()]
    assert [one.is_lit for one in facts] == [False, True, False]
    assert [one.counts.vertex_colored for one in facts] == [1, 0, 0]
    assert [one.needs_textures for one in facts] == [False, False, True]
    (texture,) = (
        node.mesh.material.base_color_texture
        for scene in scenes.values()
        for node in scene.nodes
        if node.mesh.material.base_color_texture is not None
    )
    assert texture.filter == "bilinear"


def test_a_sentence_tells_what_it_costs_and_how_far_it_moves(script):
    text = sentence(script, "unlit colours of vertices")
    assert text.startswith("Unlit colours of vertices: float64 interpolation of colours instead of")
    found = re.search(
        r"From one to the other (no code moves|[\d,]+ of 5,184 codes move, by 1 at most), and "
        r"linear light by (\S+)\.$",
        text,
    )
    assert found, text
    assert 0.0 < float(found[2]) < 1e-5


def test_a_scene_that_keeps_float64_says_why(script):
    text = sentence(script, "unlit colours of vertices", alpha_mode="blend")
    assert text == (
        "Unlit colours of vertices: interpolation_precision changes nothing here: an object is "
        "blended."
    )


def test_codes_that_move_are_counted(script, monkeypatch):
    draw = rj.render

    def moved(*arguments, **options):
        frame = draw(*arguments, **options)
        if options["quality"].interpolation_precision == "float64":
            frame.color[:2, :3, 0] ^= 1
        return frame

    monkeypatch.setattr(script.rj, "render", moved)
    text = sentence(script, "unlit colours of vertices")
    assert "6 of 5,184 codes move, by 1 at most" in text


def test_sentences_stand_between_the_marks_of_the_page(script):
    text = script.PAGE.read_text(encoding="utf-8")
    assert text.count(script.BEGIN) == text.count(script.END) == 1
    assert np.all(np.diff([text.index(script.BEGIN), text.index(script.END)]) > 0)
