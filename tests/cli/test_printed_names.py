"""Names of files as they come: what terminals obey and streams cannot encode is escaped."""

import json
import os
import re
import sys
import unicodedata
from pathlib import Path

import pytest
from click.testing import CliRunner

from rasterjit.cli import commands, report

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\ncurv 0 1 1 2\n"
NAMES = {
    os.fsdecode(b"\xff"): r"\udcff",
    "a\x1b[31mb": r"a\u001b[31mb",
    "a\u202eb": r"a\u202eb",
    "a\nb": r"a\u000ab",
}
"""Names, and how every stream shows them."""


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such names")


def run(*words, charset="utf-8"):
    return CliRunner(charset).invoke(commands.program, [str(word) for word in words])


@pytest.fixture
def folder(tmp_path):
    for name in NAMES:
        Path(tmp_path, name + ".obj").write_text(TRIANGLE)
        Path(tmp_path, name + ".ply").write_text("none")
    return tmp_path


@pytest.mark.parametrize("charset", ["utf-8", "cp1252", "ascii"])
@pytest.mark.parametrize(("name", "shown"), [*NAMES.items(), ("猫", "")])
def test_a_name_is_escaped_where_its_stream_needs_it(tmp_path, name, shown, charset):
    path = tmp_path / f"{name}.obj"
    path.write_text(TRIANGLE)
    told = run("info", path, charset=charset)
    expected = shown or (name if charset == "utf-8" else r"\u732b")
    assert f"{expected}.obj (" in told.stdout.split("\n")[0]
    assert told.exit_code == 0
    assert json.loads(run("info", path, "--json", charset=charset).stdout)["file"] == str(path)


@pytest.mark.parametrize("charset", ["utf-8", "ascii"])
def test_what_is_said_of_a_folder_holds_no_character_that_a_terminal_obeys(folder, charset):
    done = run("render", folder, "-o", folder / "made", "--size", "8x8", charset=charset)
    assert len(list(Path(folder, "made").glob("*.png"))) == len(NAMES)
    obeyed = {one for one in done.output if unicodedata.category(one) in ("Cc", "Cs")}
    assert obeyed == {"\n"}
    shown = [one for one in NAMES.values() if "000a" not in one]
    assert all(f"{one}.obj: left out curve (1)" in done.output for one in shown)


def test_a_data_set_of_any_names_is_made(folder):
    out = folder / "made"
    run("dataset", folder, "-o", out, "--views", "1", "--size", "8x8", "--workers", "1")
    assert len(list(out.rglob("transforms.json"))) == len(NAMES)
    failures = json.loads((out / "failures.json").read_text(encoding="utf-8"))
    assert {Path(one["file"]).stem for one in failures} == set(NAMES)


def test_all_that_commands_print_goes_through_one_door():
    allowed = {"report.py", "wheels.py"}
    printed = [
        f"{file.name}: {line.strip()}"
        for file in Path(report.__file__).parent.glob("*.py")
        if file.name not in allowed
        for line in file.read_text(encoding="utf-8").splitlines()
        if re.search(r"\bclick\.s?echo\(|(?<!\.)\bprint\(", line)
    ]
    own = ("get_help(", ".source(")
    assert [line for line in printed if not any(one in line for one in own)] == []
