"""A folder of meshes becomes a folder of pictures, each as if it were drawn alone."""

from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from click.testing import CliRunner

from rasterjit.cli import commands
from rasterjit.cli.thumbnails import SETTINGS_FILE

MODELS = Path(__file__).parents[2] / "models"
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def run(*arguments, style="plain"):
    words = [str(argument) for argument in arguments] + ["--style", style]
    return CliRunner().invoke(commands.program, words)


@pytest.fixture
def folder(tmp_path):
    """Two meshes of the same stem, one in a folder below, a text and a hidden mesh."""
    place = tmp_path / "meshes"
    (place / "below").mkdir(parents=True)
    (place / "a.ply").write_bytes((MODELS / "cube.ply").read_bytes())
    (place / "a.off").write_bytes((MODELS / "pyramid.off").read_bytes())
    (place / "below" / "b.obj").write_text(TRIANGLE)
    (place / "notes.txt").write_text("hello")
    (place / ".hidden.obj").write_text(TRIANGLE)
    return place


def written(out):
    files = (path for path in out.rglob("*") if path.is_file() and path.name != SETTINGS_FILE)
    return sorted(path.relative_to(out).as_posix() for path in files)


def test_each_picture_is_that_of_its_file_alone(folder, tmp_path):
    out, options = tmp_path / "out", ("--color", "teal", "--azimuth", "20", "--samples", "4")
    size = ("--size", "40x30", "-q")
    result = run("render", folder, "-o", f"{out}/", *size, *options, style="studio")
    assert (result.exit_code, result.output) == (0, "")
    assert written(out) == ["a.off.png", "a.ply.png", "below/b.obj.png"]
    for name in ("a.off", "a.ply", "below/b.obj"):
        alone = tmp_path / "alone.png"
        one = run("render", folder / name, "-o", alone, *size, *options, style="studio")
        assert one.exit_code == 0
        assert np.array_equal(iio.imread(out / f"{name}.png"), iio.imread(alone)), name


@pytest.mark.parametrize("spelled", ["meshes", "./meshes/", ".", "..", "../linked"])
def test_a_folder_may_be_relative_or_a_link(folder, tmp_path, monkeypatch, spelled):
    (folder / "bad.obj").write_text("o nothing\n")
    (tmp_path / "linked").symlink_to(folder, target_is_directory=True)
    places = {".": folder, "..": folder / "below", "../linked": folder}
    monkeypatch.chdir(places.get(spelled, tmp_path))
    result = run("render", spelled, "-o", tmp_path / "out", "--size", "8x8")
    assert result.exit_code == 1
    assert result.stderr.endswith("error: 1 of 4 mesh files could not be drawn\n")
    assert f"left out bad.obj: {Path(spelled) / 'bad.obj'}" in result.stderr
    assert written(tmp_path / "out") == ["a.off.png", "a.ply.png", "below/b.obj.png"]


def test_bad_files_are_named_the_others_drawn_and_the_status_is_not_zero(folder, tmp_path):
    (folder / "bad.obj").write_text(TRIANGLE.replace("v 1", "v nan"))
    (folder / "z.stl").write_bytes(b"nothing")
    out = tmp_path / "out"
    result = run("render", folder, "-o", out)
    assert result.exit_code == 1
    lines = result.stderr.splitlines()
    assert [line for line in lines if "left out bad.obj: " in line and "--on-invalid drop" in line]
    assert [line for line in lines if "left out z.stl: " in line]
    assert lines[-1] == "error: 2 of 5 mesh files could not be drawn"
    assert "wrote" in result.stdout
    assert "3 pictures" in result.stdout
    assert written(out) == ["a.off.png", "a.ply.png", "below/b.obj.png"]
    assert iio.imread(out / "a.ply.png").shape == (256, 256, 4)
    quiet = run("render", folder, "-o", out, "-q", "--size", "8x8")
    assert quiet.exit_code == 1
    assert quiet.stderr == "error: 2 of 5 mesh files could not be drawn\n"


def test_what_one_file_alone_has_is_wrong_usage(folder, tmp_path):
    out = tmp_path / "out"
    for words in (("--depth", "d.png"), ("--mask", "m.png"), ("--outputs", "uv"), ("--diagnose",)):
        result = run("render", folder, "-o", out, *words)
        assert result.exit_code == 2, words
        assert words[0] in result.stderr
    assert not out.exists()
    (tmp_path / "file").write_text("mine")
    result = run("render", folder, "-o", tmp_path / "file")
    assert result.exit_code == 2
    assert (tmp_path / "file").read_text() == "mine"
    (tmp_path / "empty").mkdir()
    result = run("render", tmp_path / "empty", "-o", out)
    assert result.exit_code == 1
    assert "holds no mesh files" in result.stderr
    assert not out.exists()


@pytest.mark.parametrize("name", ["a.png", "a.JPG", "a.npz", "a.exr"])
def test_a_folder_is_not_made_under_the_name_of_a_picture(folder, tmp_path, name):
    result = run("render", folder, "-o", tmp_path / name)
    assert result.exit_code == 2
    assert result.stderr.startswith(f"error: --output: {tmp_path / name} is the name of a file")
    assert not (tmp_path / name).exists()
    # One that is there is meant.
    (tmp_path / name).mkdir()
    assert run("render", folder, "-o", tmp_path / name, "-q", "--size", "8x8").exit_code == 0
    assert len(written(tmp_path / name)) == 3


def test_pictures_may_lie_beside_the_meshes_and_are_no_meshes_themselves(folder):
    before = written(folder)
    for _ in range(2):
        result = run("render", folder, "-o", folder, "-q", "--size", "8x8")
        assert (result.exit_code, result.output) == (0, "")
    pictures = ["a.off.png", "a.ply.png", "below/b.obj.png"]
    assert written(folder) == sorted(before + pictures)
    assert (folder / "a.ply").read_bytes() == (MODELS / "cube.ply").read_bytes()


def test_pictures_that_are_there_stay_until_mesh_or_options_change(folder, tmp_path):
    out = tmp_path / "out"

    def drawn(*options):
        before = {name: (out / name).stat().st_mtime_ns for name in written(out)}
        result = run("render", folder, "-o", out, "--size", "8x8", "--format", "webp", *options)
        assert result.exit_code == 0, result.output
        present = [name for name, time in before.items() if (out / name).stat().st_mtime_ns == time]
        assert (f"{len(present)} were there" in result.stdout) == bool(present)
        return sorted(set(written(out)) - set(present))

    every = ["a.off.webp", "a.ply.webp", "below/b.obj.webp"]
    assert drawn() == every
    assert drawn() == []
    (out / "a.ply.webp").unlink()
    (folder / "below" / "b.obj").write_text(TRIANGLE)
    assert drawn() == ["a.ply.webp", "below/b.obj.webp"]
    assert drawn("--color", "teal") == every
    assert drawn("--color", "teal", "--force") == every
    assert iio.imread(out / "a.ply.webp").shape[:2] == (8, 8)
    opaque = run("render", folder, "-o", out, "--format", "jpg", "--background", "transparent")
    assert opaque.exit_code == 2
    assert "choose --format png" in opaque.stderr
    assert "'pdf' is none of png, jpg" in run("render", folder, "-o", out, "--format", "pdf").stderr


def test_files_of_one_name_keep_their_folders(tmp_path):
    files = [tmp_path / name for name in ("one/model.obj", "two/model.obj", "two/model.off")]
    for file in files:
        file.parent.mkdir(exist_ok=True)
        source = (MODELS / "pyramid.off").read_text() if file.suffix == ".off" else TRIANGLE
        file.write_text(source)
    for count, names in (
        (2, ["one/model.png", "two/model.png"]),
        (3, ["one/model.obj.png", "two/model.obj.png", "two/model.off.png"]),
    ):
        out = tmp_path / f"out{count}"
        result = run("render", *files[:count], "-o", out, "--size", "8x8")
        assert result.exit_code == 0, result.output
        assert written(out) == names


def test_what_is_not_in_view_is_said_of_its_file(folder, tmp_path):
    view = ("--position", "0,0,900", "--target", "0,0,999")
    result = run("render", folder, "-o", tmp_path / "out", "--size", "8x8", *view)
    assert result.exit_code == 0
    for name in ("a.ply", "a.off", "below/b.obj"):
        assert f"warning: {name}: nothing is in view" in result.stderr
    assert result.stderr.count("nothing is in view") == 3
