import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from made_trials import study as made_study
from made_trials import trial

import rasterjit as rj
from rasterjit.accuracy.test_scenes import SCENES
from rasterjit.cli import accuracy as cli_accuracy
from rasterjit.cli import commands, program
from rasterjit.scene.quality import LEVELS

CUBE = Path(__file__).parents[2] / "models" / "cube.ply"
SMALL = ("--size", "24x16", "--quiet")


def run(*arguments):
    return CliRunner().invoke(commands.program, [str(argument) for argument in arguments])


def assert_one_line(result, *words, code=2):
    assert result.exit_code == code
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    for word in words:
        assert word in result.stderr


class Studies:
    """Stands for the study, and notes what it was asked for."""

    def __init__(self, **found):
        self.asked, self.found = [], found

    def __call__(self, scene, camera, **options):
        self.asked.append((scene, camera, options))
        return made_study([trial("samples=4", (1.5,) * 3, rj.Quality(samples=4))], **self.found)


@pytest.fixture
def studies(monkeypatch):
    stand_in = Studies()
    monkeypatch.setattr(cli_accuracy, "study", stand_in)
    return stand_in


def accuracy(tmp_path, *arguments):
    return run("accuracy", *arguments, "-o", tmp_path / "report")


# The study


def test_a_file_is_studied_and_the_report_written(tmp_path):
    result = run(
        "accuracy", CUBE, "-o", tmp_path / "report", "--knobs", "subpixel_bits", "--budget", "2",
        "--size", "24x16", "--threads", "1",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    held = json.loads((tmp_path / "report" / "accuracy.json").read_text())
    assert (held["scene"], held["size"], held["threads"]) == ("cube.ply", [24, 16], 1)
    assert "cube.ply, 24 x 16 pixels, 1 threads" in result.stdout
    assert result.stdout.startswith("Take ")
    assert "On this scene standard is " in result.stdout
    assert "worth choosing: " in result.stdout
    assert f"wrote {tmp_path / 'report' / 'accuracy.csv'}" in result.stdout


def test_options_reach_the_study(tmp_path, studies):
    options = ("--knobs", "shading,samples", "--budget", "7.5", "--size", "40x30", "--threads", 2)
    assert accuracy(tmp_path, CUBE, *options).exit_code == 0
    (scene, camera, asked) = studies.asked[0]
    assert len(scene.nodes) == 1
    assert camera is None
    assert asked["knobs"] == ("samples", "shading")
    assert (asked["budget"], asked["size"], asked["threads"]) == (7.5, (40, 30), 2)
    assert (asked["name"], asked["output"]) == ("cube.ply", tmp_path / "report")


def test_a_made_scene_brings_its_camera_and_size(tmp_path, studies):
    assert accuracy(tmp_path, "--scene", "floor").exit_code == 0
    made = SCENES["floor"]()
    _, camera, asked = studies.asked[0]
    assert camera == made.camera
    assert (asked["name"], asked["size"]) == ("floor", made.size)


def test_camera_and_effects_may_be_chosen(tmp_path, studies):
    options = ("--position", "2,3,5", "--shadows", "--shading", "gouraud")
    assert accuracy(tmp_path, CUBE, *options).exit_code == 0
    scene, camera, _ = studies.asked[0]
    assert camera.eye == (2.0, 3.0, 5.0)
    assert scene.lights[-1].shadow is not None
    assert scene.nodes[0].mesh.material.shading == "gouraud"


def test_the_terminal_shows_table_sentences_and_what_is_missing(tmp_path, studies):
    result = accuracy(tmp_path, CUBE)
    assert "4 samples instead of 1 sample: +50 % time, the same error." in result.stdout
    assert "shadow_size changes nothing here: no light casts them." in result.stdout
    assert "left out (no time left): samples=256" in result.stdout
    rows = [line.split() for line in result.stdout.splitlines()]
    assert ["samples", "4", "15.00", "1.50", "±0.00", "1.00e-01", "20.0", "-", "0"] in rows


def test_the_terminal_shows_no_factor_of_too_few_rounds(tmp_path, studies, monkeypatch):
    once = made_study([trial("samples=4", (5.8,), rj.Quality(samples=4))])
    monkeypatch.setattr(cli_accuracy, "study", lambda *_, **__: once)
    result = accuracy(tmp_path, CUBE)
    assert "5.8" not in result.stdout
    rows = [line.split() for line in result.stdout.splitlines()]
    assert ["samples", "4", "58.00", "?", "1.00e-01", "20.0", "-", "0"] in rows


def test_an_interrupted_study_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(cli_accuracy, "study", Studies(interrupted=True))
    result = accuracy(tmp_path, CUBE)
    assert result.exit_code == program.INTERRUPTED
    assert "left out (interrupted): samples=256" in result.stdout


def test_quiet_prints_nothing(tmp_path, studies):
    assert accuracy(tmp_path, CUBE, "--quiet").output == ""


def test_without_matplotlib_the_extra_is_named(tmp_path, studies, monkeypatch):
    monkeypatch.setattr(cli_accuracy, "can_make_page", lambda: False)
    assert 'pip install "rasterjit[accuracy]"' in accuracy(tmp_path, CUBE).stdout


# Its bad input


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), ["either a FILE or --scene NAME"]),
        ((CUBE, "--scene", "floor"), ["either a FILE or --scene NAME"]),
        (("--scene", "roof"), ["'roof' is none of floor", "wireframe"]),
        ((CUBE, "--knobs", "colour"), ["'colour'", "subpixel_bits", "lines"]),
        ((CUBE, "--knobs", ""), ["''", "subpixel_bits"]),
        ((CUBE, "--budget", "0"), ["--budget", "0"]),
        ((CUBE, "--budget", "-2"), ["--budget", "-2"]),
        ((CUBE, "--budget", "nan"), ["--budget", "finite"]),
        ((CUBE, "--budget", "long"), ["--budget", "'long'"]),
        ((CUBE, "--threads", "0"), ["--threads"]),
        ((CUBE, "--size", "0x4"), ["'0x4'"]),
        ((CUBE, "--samples", "4"), ["--samples"]),
        (("--scene", "floor", "--on-damage", "warn"), ["--on-damage", "--scene reads no file"]),
    ],
)
def test_bad_options_are_named(tmp_path, studies, options, words):
    assert_one_line(accuracy(tmp_path, *options), *words)
    assert studies.asked == []


def test_a_folder_that_is_none_is_named_before_anything_is_read(tmp_path, studies):
    (tmp_path / "report").write_text("mine")
    assert_one_line(accuracy(tmp_path, "missing.obj"), "--output", "report", "is a file")
    assert (tmp_path / "report").read_text() == "mine"


def test_a_missing_file_is_named(tmp_path, studies):
    assert_one_line(accuracy(tmp_path, "missing.obj"), "missing.obj", code=1)


# Quality of pictures


def picture(tmp_path, *options):
    result = run(
        "render", CUBE, "-o", tmp_path / "out.npz", "--style", "plain", *SMALL, *options
    )  # fmt: skip
    assert (result.exit_code, result.output) == (0, "")
    return np.load(tmp_path / "out.npz")["color"]


def drawn(**settings):
    return rj.render(rj.load(CUBE), size=(24, 16), quality=rj.Quality(**settings)).color


def test_set_changes_a_setting(tmp_path):
    assert np.array_equal(picture(tmp_path, "--set", "samples=4"), drawn(samples=4))
    several = picture(tmp_path, "--set", "samples=4", "--set", "subpixel_bits=4")
    assert np.array_equal(several, drawn(samples=4, subpixel_bits=4))


def test_samples_are_short_for_set(tmp_path):
    assert np.array_equal(picture(tmp_path, "--samples", "4"), drawn(samples=4))


def plan(*options):
    result = run("explain", CUBE, *options)
    assert result.exit_code == 0, result.output
    return result.stdout


def test_quality_names_a_preset_and_set_changes_it():
    assert "8 samples a pixel" in plan("--quality", "high")
    assert "quality.samples is 1" in plan("--quality", "standard")
    assert "4 samples a pixel" in plan("--quality", "high", "--set", "samples=4")
    assert "2 samples a pixel" in plan("--quality", "high", "--samples", "2")


@pytest.mark.parametrize("command", ["render", "turntable", "explain"])
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--set", "colour=4"), ["colour=4", *LEVELS]),
        (("--set", "samples"), ["NAME=LEVEL", "'samples'"]),
        (("--set", "samples=5"), ["samples must be one of 1, 2, 4, 8", "'5'"]),
        (("--set", "shadow_size=9"), ["shadow_size", "9"]),
        (("--quality", "best"), ["'best'", "draft", "reference"]),
        (("--set", "samples=4", "--set", "samples=8"), ["samples is given twice: 4 and 8"]),
        (("--samples", "4", "--set", "samples=8"), ["samples is given twice: 4 and 8"]),
        (("--set", "subpixel_bits=0", "--samples", "4"), ["samples must be 1", "got 4"]),
    ],
)
def test_bad_settings_are_named(tmp_path, command, options, words):
    output = {"render": ("-o", tmp_path / "o.png"), "turntable": ("-o", tmp_path / "o.gif")}
    assert_one_line(run(command, CUBE, *output.get(command, ()), *options), *words)


def test_area_with_glass_is_refused_with_what_is_possible(tmp_path):
    scene = tmp_path / "glass.obj"
    scene.write_text("mtllib glass.mtl\nusemtl glass\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "glass.mtl").write_text("newmtl glass\nKd 1 0 0\nd 0.5\n")
    result = run("render", scene, "-o", tmp_path / "o.png", "--set", "samples=area")
    assert_one_line(result, "samples must be 1, 2, 4, 8", "'area'", code=1)


def test_the_help_names_all_scenes_and_settings():
    told = CliRunner().invoke(commands.program, ["accuracy", "--help-all"]).output
    # Lines end within names, too.
    told = "".join(told.split())
    assert f"inplaceofFILE:{','.join(rj.accuracy.SCENES)}." in told
    assert f"default:all:{','.join(LEVELS)}." in told
