"""``rasterjit FILE -o drawing.svg`` writes lines, and refuses what is none."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

import rasterjit as rj
from rasterjit.cli import commands

CUBE = Path(__file__).parents[2] / "models" / "cube.ply"


def run(*arguments):
    return CliRunner().invoke(commands.program, [str(argument) for argument in arguments])


@pytest.mark.parametrize("style", ["technical", "wireframe", ""])
def test_the_file_is_that_of_the_style(tmp_path, style):
    place, is_wireframe = tmp_path / "a.svg", style == "wireframe"
    options = ["--style", style] if style else []
    options += ["--size", "200x150", "--background", "white"]
    result = run("render", CUBE, "-o", place, *options)
    assert result.exit_code == 0, result.output
    assert f"wrote {place}  200x150 points" in result.output
    styled = rj.styles.STYLES[style or "technical"](rj.load(CUBE))
    kinds = {"edges": ("silhouette", "crease", "wireframe")} if is_wireframe else {}
    wanted = rj.line_drawing(styled.scene, None, (200, 150), **kinds)
    wanted.save(tmp_path / "b.svg", background="white")
    assert place.read_text() == (tmp_path / "b.svg").read_text()
    assert ('class="wireframe"' in place.read_text()) == is_wireframe


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--style", "studio"), "holds lines, technical or wireframe"),
        (("--samples", "4"), "--samples has no effect here"),
        (("--outputs", "depth"), "--outputs has no effect here"),
        (("--lens", "fisheye:0,0,0,0"), "--lens has no effect here"),
        (("--shadows",), "--shadows has no effect here"),
        (("--tone-map", "aces"), "--tone-map has no effect here"),
        (("--environment", "sky"), "--environment has no effect here"),
        (("--light", "sun"), "--light has no effect here"),
        (("--ambient-occlusion",), "--ambient-occlusion has no effect here"),
        (("--vignette", "0.5"), "--vignette has no effect here"),
        (("--exposure", "1"), "--exposure has no effect here"),
        (("--shading", "flat"), "--shading has no effect here"),
        (("--color", "red"), "--color has no effect here"),
        (("--wireframe", "only"), "--wireframe has no effect here"),
        (("--wireframe-color", "red"), "--wireframe-color has no effect here"),
    ],
)
def test_what_is_no_line_is_refused(tmp_path, options, words):
    result = run("render", CUBE, "-o", tmp_path / "a.pdf", *options)
    assert result.exit_code == 2
    assert words in result.output
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("style", ["technical", "wireframe"])
def test_options_of_outlines_are_those_of_lines(tmp_path, style):
    place = tmp_path / "a.svg"
    options = ("--hidden-lines", "--outline-width", "3", "--outline", "red")
    result = run("render", CUBE, "-o", place, "--size", "200x150", "--style", style, *options)
    assert result.exit_code == 0, result.output
    groups = re.findall(
        r'<g class="(\w+)".*stroke="(#\w+)" stroke-width="(\d+)"', place.read_text()
    )
    assert groups[0] == ("hidden", "#ff0000", "3")
    assert {group[1:] for group in groups} == {("#ff0000", "3")}


def test_several_files_go_to_no_drawing(tmp_path):
    result = run("render", CUBE, CUBE.with_name("pyramid.off"), "-o", tmp_path / "a.svg")
    assert result.exit_code == 2
    assert "go into a folder" in result.output
