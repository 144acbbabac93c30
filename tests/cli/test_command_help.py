"""Help in groups, and the short ways to render."""

import io
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

import rasterjit as rj
from rasterjit.cli import commands
from rasterjit.cli import help as helping
from rasterjit.cli.options import CameraOptions

CUBE = Path(__file__).parents[2] / "models" / "cube.ply"
SIZE = ("--size", "32x24")
LINES = 50
"""Of a screen that shows the short help."""


def run(*arguments):
    return CliRunner().invoke(commands.program, [str(argument) for argument in arguments])


def add_options(command):
    """Return the options of a command that help is to tell of."""
    return [
        one for one in command.params if isinstance(one, click.Option) and not one.hidden
    ]  # fmt: skip


@pytest.mark.parametrize("name", sorted(commands.program.commands))
def test_all_options_are_told_of_once(name):
    command = commands.program.commands[name]
    has_more = len(add_options(command)) > helping.MAX_SHORT_OPTIONS
    told = run(name, "--help-all" if has_more else "--help").output
    heads = re.findall(r"^  (-.*?)(?:  |$)", told, re.MULTILINE)
    names = [spelling.split()[0] for head in heads for spelling in head.split(", ")]
    assert len(names) == len(set(names))
    assert {max(one.opts, key=len) for one in add_options(command)} <= set(names)
    short = run(name, "--help").output
    assert short.count("\n") <= LINES
    assert ("--help-all says more" in short) == has_more


def test_no_group_names_an_option_that_there_is_not():
    known = {one.name for command in commands.program.commands.values() for one in command.params}
    named = [name for names in helping.OPTION_GROUPS.values() for name in names]
    assert len(named) == len(set(named))
    assert set(named) <= known
    assert set(helping.COMMON_OPTIONS) <= known


def test_short_help_says_the_first_clause():
    record = "--light X", "Light from far away (0,-1,0: down), beside dim light; or by name. More."
    assert (
        helping.shorten_record(record)[1] == "Light from far away (0,-1,0: down), beside dim light."
    )
    assert (
        helping.shorten_record(("--n", "How many.  [default: 3]"))[1] == "How many.  [default: 3]"
    )


def test_a_file_in_place_of_a_command_is_rendered_here_and_replaces_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(CUBE, *SIZE)
    assert result.exit_code == 0, result.output
    assert re.fullmatch(r"wrote cube\.png  32x24  12 triangles  \d+\.\d\d s\n", result.stdout)
    before = (tmp_path / "cube.png").read_bytes()
    again = run(CUBE, *SIZE, "--color", "red")
    assert again.exit_code == 2
    assert "cube.png exists: --force replaces it" in again.stderr
    assert (tmp_path / "cube.png").read_bytes() == before
    assert run(CUBE, *SIZE, "--color", "red", "--force").exit_code == 0
    assert (tmp_path / "cube.png").read_bytes() != before
    assert "does not exist" in run("nothing.obj").stderr
    assert "did you mean render" in run("rendr", CUBE).stderr
    assert "No such command or file 'cube'" in run("cube").stderr
    assert "'folder/cube' does not exist" in run("folder/cube", "--force").stderr
    assert "options stand behind it" in run(*SIZE, CUBE).stderr


def test_several_files_go_to_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    other = tmp_path / "other.ply"
    shutil.copy(CUBE, other)
    result = run("render", CUBE, other, "-o", "out", *SIZE)
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["cube.png", "other.png"]
    assert "--force" in run("render", CUBE, other, "-o", "out", *SIZE).stderr
    assert "would have the same name" in run("render", CUBE, "cube.obj").stderr
    assert "is a file" in run("render", CUBE, other, "-o", "out/cube.png").stderr
    assert "is the name of a file" in run("render", CUBE, other, "-o", "both.png").stderr
    assert "-o new.png names what is written" in run("render", CUBE, "new.png").stderr
    assert not (tmp_path / "both.png").exists()
    assert "is a folder: give it alone" in run("render", CUBE, "out").stderr
    assert "a folder for the pictures" in run("render", "out").stderr


def test_a_broken_one_of_several_files_stops_no_other(tmp_path):
    (tmp_path / "broken.obj").write_text("v 0 0 0\nf 1 2 3\n")
    shutil.copy(CUBE, tmp_path / "last.ply")
    files = tmp_path / "broken.obj", CUBE, tmp_path / "nothing.obj", tmp_path / "last.ply"
    result = run("render", *files, "-o", tmp_path / "out", *SIZE)
    assert (result.exit_code, len(result.stderr.splitlines())) == (1, 3)
    assert f"warning: left out {tmp_path / 'broken.obj'}: " in result.stderr
    assert "2 of 4 files could not be drawn" in result.output
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["cube.png", "last.png"]


def test_one_file_goes_into_a_folder_that_there_is(tmp_path):
    assert run("render", CUBE, "-o", tmp_path, *SIZE).exit_code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["cube.png"]
    assert "--force" in run("render", CUBE, "-o", tmp_path, *SIZE).stderr
    assert "must end in one of" in run("render", CUBE, "-o", tmp_path / "none").stderr


def test_up_turns_no_file_that_says_which_way_is_up(tmp_path):
    told = tmp_path / "box.glb"
    rj.load(CUBE).save(told)
    usual = ("-o", tmp_path / "usual.png", *SIZE, "--style", "plain")
    assert run("render", told, *usual).exit_code == 0
    turned = run("render", told, "-o", tmp_path / "up.png", *SIZE, "--style", "plain", "--up", "z")
    assert "--up is for files that do not say which way is up; this says 0,1,0" in turned.stderr
    assert (tmp_path / "up.png").read_bytes() == (tmp_path / "usual.png").read_bytes()
    # It still says what is up in the picture of a camera that is placed.
    placed = ("--style", "plain", "--position", "0,9,0.5", "--up", "x")
    aside = run("render", told, "-o", tmp_path / "aside.png", *SIZE, *placed)
    assert "--up" not in aside.stderr
    run("render", told, "-o", tmp_path / "placed.png", *SIZE, *placed[:4])
    assert (tmp_path / "aside.png").read_bytes() != (tmp_path / "placed.png").read_bytes()


@pytest.mark.parametrize(
    ("axis", "vector"), [("z", "0,0,1"), ("-Y", "0,-1,0"), ("+x", "1,0,0"), ("y", "0,1,0")]
)
def test_up_is_an_axis_or_a_vector(tmp_path, axis, vector):
    for name, up in (("axis.png", axis), ("vector.png", vector)):
        arguments = ("-o", tmp_path / name, *SIZE, "--style", "plain", "--up", up)
        assert run("render", CUBE, *arguments).exit_code == 0
    assert (tmp_path / "axis.png").read_bytes() == (tmp_path / "vector.png").read_bytes()
    assert "neither an axis, such as z" in run("render", CUBE, "--up", "north").stderr
    assert "is not X,Y,Z" in run("render", CUBE, "--up", "0,1").stderr


def test_the_ground_of_a_style_follows_up(tmp_path):
    y, z = (rj.load(CUBE) for _ in range(2))
    CameraOptions(up=(0.0, 0.0, 2.0)).camera(z, (32, 24))
    CameraOptions().camera(y, (32, 24))
    assert (z.up, y.up) == ((0.0, 0.0, 1.0), None)


def test_points_are_told_of_as_points(tmp_path):
    cloud = tmp_path / "cloud.ply"
    cloud.write_text(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n0 0 0\n1 1 0\n"
    )
    result = run("render", cloud, "-o", tmp_path / "cloud.png", *SIZE, "--stats")
    assert "  32x24  2 points  " in result.stdout
    assert "points in" in result.stdout


def test_a_mask_of_numbers_says_what_its_codes_are(tmp_path):
    arguments = ("--mask", tmp_path / "mask.png", "--mask-of", "object_id")
    result = run("render", CUBE, "-o", tmp_path / "cube.png", *SIZE, *arguments)
    assert f"{tmp_path / 'mask.png'}  16 bits, numbers plus one, 0 is nothing" in result.stdout
    ids = run("render", CUBE, "-o", tmp_path / "ids.png", *SIZE, "--outputs", "face_id")
    assert ids.stdout.endswith("16 bits, numbers plus one, 0 is nothing\n")


def test_a_dash_writes_the_picture_to_standard_output(tmp_path):
    result = run("render", CUBE, "-o", "-", *SIZE)
    assert result.exit_code == 0, result.stderr
    assert run("render", CUBE, "-o", tmp_path / "cube.png", *SIZE).exit_code == 0
    with Image.open(io.BytesIO(result.stdout_bytes)) as image:
        assert np.array_equal(np.asarray(image), np.asarray(Image.open(tmp_path / "cube.png")))
    depth = run("render", CUBE, "-o", "-", *SIZE, "--outputs", "depth")
    with Image.open(io.BytesIO(depth.stdout_bytes)) as image:
        assert image.mode.startswith("I")
    assert "one of --outputs" in run("render", CUBE, "-o", "-", "--outputs", "color,depth").stderr
    assert "leave --stats" in run("render", CUBE, "-o", "-", "--stats").stderr
    assert "of one FILE" in run("render", CUBE, CUBE, "-o", "-").stderr


def test_a_shell_completes_commands_options_and_files():
    assert "rasterjit" in run("completion", "bash").output
    words = {"COMP_WORDS": "rasterjit ren", "COMP_CWORD": "1"}
    asked = {**os.environ, "_RASTERJIT_COMPLETE": "bash_complete", **words}
    program = "from rasterjit.cli.commands import main; main()"
    command = [sys.executable, "-c", program]
    told = subprocess.run(command, env=asked, capture_output=True, text=True, check=True).stdout
    assert told.split() == ["plain,render", "file,ren"]
    asked |= {"COMP_WORDS": "rasterjit render x --ambi", "COMP_CWORD": "3"}
    told = subprocess.run(command, env=asked, capture_output=True, text=True, check=True).stdout
    assert told.split() == ["plain,--ambient-occlusion"]
