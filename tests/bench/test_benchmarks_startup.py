"""``python -m benchmarks startup``: who starts, what is timed, and which pictures count."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))
starting = importlib.import_module("benchmarks.starting")
command = importlib.import_module("benchmarks.__main__")

DRAW = """
import json, pathlib, sys
from PIL import Image
view = json.loads(sys.argv[1])
picture = Image.new("RGB", tuple(view["size"]), "white")
picture.paste((9, 9, 9), ({left}, 100, {left} + 300, 300))
picture.save(view["picture"])
"""


def drawer(folder, name, left=100, **more):
    """Return a starter whose program draws a rectangle."""
    program = folder / f"{name}.py"
    program.write_text(DRAW.format(left=left))
    return starting.Starter(name, sys.executable, "json", program, **more)


def picture_at(path, left=100, size=starting.SIZE):
    picture = Image.new("RGB", size, "white")
    picture.paste((9, 9, 9), (left, 100, left + 300, 300))
    picture.save(path)
    return path


def test_each_part_is_timed_in_as_many_processes_as_rounds_after_the_first(tmp_path):
    alone = starting.Starter("Python alone", sys.executable, "")
    found = starting.measure([alone, drawer(tmp_path, "one")], 2, tmp_path)
    assert [each.name for each in found] == ["Python alone", "one"]
    assert {part: len(times) for part, times in found[0].seconds.items()} == {"import": 2}
    assert {part: len(times) for part, times in found[1].seconds.items()} == {"import": 2, "API": 2}
    assert found[1].first.keys() == {"import", "API"}
    assert not found[1].remarks
    row = starting.row_of(found[1])
    assert len(row) == len(starting.COLUMNS)
    assert row[3] == row[5] == row[6] == row[7] == row[8] == ""
    assert float(row[2]) > 0.0


def test_nothing_compiled_is_found_by_the_first_process_and_kept_for_those_after_it(tmp_path):
    """Each part of each starter has folders of its own."""
    code = (
        "import os, pathlib, sys\n"
        "places = {os.environ[name] for name in ('RASTERJIT_CACHE_DIR', 'MESA_SHADER_CACHE_DIR')}\n"
        "(place,) = map(pathlib.Path, places)\n"
        "print(len(list(place.iterdir())), file=sys.stderr)\n"
        "(place / f'{os.getpid()}').touch()\n"
        "sys.exit(len(list(place.iterdir())) == 3)"
    )
    counts = starting.Starter(
        "counts", sys.executable, "", None, lambda python, picture: [python, "-c", code]
    )
    starting.check, kept = lambda *given: None, starting.check
    try:
        first, second = starting.measure([counts, counts], 2, tmp_path)
    finally:
        starting.check = kept
    assert first.remarks == second.remarks == {"command": "failed: 2"}
    assert list(first.first) == ["import", "command"]


def test_a_program_that_fails_or_draws_something_else_is_named_and_the_others_stay(tmp_path):
    fails = drawer(tmp_path, "fails")
    fails.program.write_text("raise OSError('no display')")
    other, away = drawer(tmp_path, "other", 101), drawer(tmp_path, "away", 300)
    found = starting.measure([drawer(tmp_path, "own"), fails, other, away], 1, tmp_path)
    assert [each.remarks.get("API") for each in found] == [
        None, "failed: OSError: no display", None, "the picture differs: covered 74.0%",
    ]  # fmt: skip
    assert ["API" in each.seconds for each in found] == [True, False, True, False]
    assert all("import" in each.seconds for each in found)


def test_a_picture_must_show_something_in_the_size_asked_for(tmp_path):
    path = tmp_path / "picture.png"
    reference = []
    starting.check(picture_at(path), reference, True)
    assert reference[0].mean() == pytest.approx(300 * 200 / (640 * 480))
    Image.new("RGB", starting.SIZE, "white").save(path)
    with pytest.raises(ValueError, match=r"shows something at 0\.0%"):
        starting.check(path, reference, False)
    with pytest.raises(ValueError, match="the picture is 320x240"):
        starting.check(picture_at(path, size=(320, 240)), reference, False)
    with pytest.raises(ValueError, match="the picture differs"):
        starting.check(picture_at(path, 300), reference, True)
    # A camera of its own, before a background that fades from row to row.
    faded = np.asarray(Image.open(picture_at(path, 300))).copy()
    faded[:, :, 2] = np.arange(480)[:, np.newaxis] // 2
    faded[100:300, 300:600] = 9
    Image.fromarray(faded).save(path)
    starting.check(path, reference, False)


def test_who_is_not_installed_is_left_out_by_name(monkeypatch, tmp_path):
    monkeypatch.setattr(starting, "is_installed", lambda python, module: module == "moderngl")
    monkeypatch.setattr(starting, "newest_wheel", lambda folder: None)
    found, left_out = starting.entrants(tmp_path, None, {}, [], None)
    assert [starter.name for starter in found] == [
        "Python alone", "NumPy alone", "RasterJIT, clone", "moderngl",
    ]  # fmt: skip
    assert left_out.keys() == {"RasterJIT, wheel", "F3D", "PyVista", "Panda3D tinydisplay"}
    assert "pip install f3d" in left_out["F3D"]


def test_an_environment_is_asked_what_it_has_without_importing_it():
    assert starting.is_installed(sys.executable, "antigravity")
    assert not starting.is_installed(sys.executable, "no_such_module")
    assert not starting.is_installed(sys.executable, "no_such_package.module")


def test_the_newest_wheel_for_this_machine_is_taken_and_one_that_fails_is_told(
    monkeypatch, tmp_path
):
    monkeypatch.setattr(starting.platform, "machine", lambda: "x86_64")
    assert starting.newest_wheel(tmp_path / "nowhere") is None
    # The newest first.
    tags = ("any", "manylinux_2_17_aarch64", "manylinux_2_17_x86_64", "manylinux_2_28_x86_64")
    for n, tag in enumerate(tags):
        path = tmp_path / f"rasterjit-0.1.0-py3-none-{tag}.whl"
        path.write_bytes(b"no wheel")
        os.utime(path, (0, 100 - n))
    wheel = starting.newest_wheel(tmp_path)
    assert wheel.stem.endswith("manylinux_2_17_x86_64")

    def fails(line, **options):
        raise subprocess.CalledProcessError(1, line, stderr="noise\nERROR: it is no wheel\n\n")

    monkeypatch.setattr(starting.subprocess, "run", fails)
    monkeypatch.setattr(starting, "is_installed", lambda *given: False)
    _, left_out = starting.entrants(tmp_path, None, {}, [wheel], None)
    told = left_out[f"RasterJIT, {tmp_path.name}/manylinux_2_17_x86_64"]
    assert told == "pip failed: ERROR: it is no wheel"
    # What brings code is installed once more, with the least that it needs.
    for tag, least in ((tags[2], 3), ("any", 4)):
        wheel = tmp_path / f"rasterjit-0.1.0-py3-none-{tag}.whl"
        with zipfile.ZipFile(wheel, "w") as archive:
            archive.writestr("rasterjit/machine_code/some.ll.xz", "")
        assert [*map(len, starting.package_choices(wheel))] == [0, least]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--rounds", "0"], ["--rounds", "0"]),
        (["--python", "blender=python"], ["--python", "'blender' is no peer", "f3d"]),
        (["--python", "f3d"], ["--python", "'' is no program", "f3d=ENVIRONMENT/bin/python"]),
        (["--python", "f3d=/"], ["--python", "'/' is no program"]),
        (["--wheel", "nowhere.whl"], ["--wheel", "nowhere.whl"]),
        (["--against", "no-such-commit"], ["--against", "'no-such-commit' is not a commit"]),
    ],
)
def test_wrong_options_are_refused_by_name_before_anything_starts(monkeypatch, arguments, words):
    monkeypatch.setattr(starting, "measure", lambda *given: pytest.fail("it measured"))
    done = CliRunner().invoke(command.main, ["startup", *arguments])
    assert done.exit_code == 2, done.output
    assert all(word in done.output for word in words), done.output


def test_results_are_printed_and_written_and_a_wrong_picture_ends_it_with_status_1(
    monkeypatch, tmp_path
):
    own = drawer(tmp_path, "RasterJIT, clone")
    others = [drawer(tmp_path, "PyVista", 300)]
    reasons = {"F3D": "the package f3d is not installed"}
    monkeypatch.setattr(starting, "entrants", lambda *given: ([own, *others], reasons))
    path = tmp_path / "startup.json"
    arguments = ["startup", "--rounds", "1", "--results", str(path)]
    done = CliRunner().invoke(command.main, arguments)
    assert done.exit_code == 1, done.output
    for words in ("RasterJIT, clone", "the picture differs", "left out: F3D: the package f3d"):
        assert words in done.output
    content = json.loads(path.read_text())
    assert content["left_out"] == reasons
    assert [each["name"] for each in content["found"]] == ["RasterJIT, clone", "PyVista"]
    del others[:]
    assert CliRunner().invoke(command.main, arguments).exit_code == 0
    own.program.write_text("raise SystemExit('no kernels')")
    assert CliRunner().invoke(command.main, arguments).exit_code == 1


@pytest.mark.takes_long
def test_the_programs_of_all_that_are_here_draw_the_same_teapot(tmp_path):
    found, _ = starting.entrants(tmp_path, None, {}, [], None)
    for each in starting.measure(found, 1, tmp_path):
        assert not each.remarks, each


def test_an_installation_counts_from_pip_to_the_picture_and_only_where_packages_are_named(
    monkeypatch, tmp_path
):
    """Pip is replaced: it notes what it is asked for, and takes a second to install."""
    asked = []

    def pip(python, action, *arguments):
        asked.append((action, arguments[-1]))
        if action == "install":
            assert arguments[:2] == ("--no-index", "--find-links")
            time.sleep(1.0)

    monkeypatch.setattr(starting, "run_pip", pip)
    monkeypatch.setattr(starting, "new_environment", lambda place: sys.executable)
    with_packages = drawer(tmp_path, "one", packages=("thing",))
    fails = drawer(tmp_path, "fails", packages=("other",))
    fails.program.write_text("raise OSError('no display')")
    starters = [drawer(tmp_path, "none"), with_packages, fails]
    found = [starting.Found(starter.name) for starter in starters]
    starting.measure_installing(starters, found, tmp_path)
    assert asked == [
        (action, name) for name in ("thing", "other") for action in ("download", "install")
    ]
    assert [each.first.get("install", 0.0) > 1.0 for each in found] == [False, True, False]
    assert found[2].remarks == {"install": "failed: OSError: no display"}
    assert float(starting.row_of(found[1])[7]) > 1.0


def test_processes_may_write_bytecode_whatever_the_shell_says(monkeypatch, tmp_path):
    monkeypatch.setenv(starting.NO_BYTECODE, "1")
    code = f"import os, sys; sys.exit({starting.NO_BYTECODE!r} in os.environ)"
    alone = starting.Starter("Python alone", sys.executable, "")
    starting.time_line([sys.executable, "-c", code], alone, tmp_path)
