"""The counts of the source."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))
house = importlib.import_module("benchmarks.house")

SHORT = "".join(f"    x = {n}\n" for n in range(40))
LONG = SHORT + "    x = 40\n"


@pytest.fixture
def read(tmp_path):
    """Return a function that writes files of a package and reads them."""

    def write(**sources):
        for name, text in sources.items():
            path = tmp_path / "rasterjit" / f"{name.replace('__', '/')}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return house.read(tmp_path)

    return write


def test_code_is_counted_without_docstrings_comments_and_blank_lines(read):
    text = '"""Say.\n\nMore.\n"""\n\n# A step.\nX = (1,\n     2)\n"""What."""\n\ny = """a\nb"""\n'
    (file,) = read(a=text)
    assert file.count_code() == 4


def test_circles_are_found_through_other_modules_and_in_functions(read):
    files = read(
        a="from rasterjit import b",
        b="def f():\n    from rasterjit.c import g",
        c="import rasterjit.a",
        d="from rasterjit.a import h",
    )
    assert house.circles(files) == ["rasterjit.a - rasterjit.b - rasterjit.c"]


def test_what_type_checkers_alone_import_closes_no_circle(read):
    checked = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from rasterjit import a\n"
    assert house.circles(read(a="from rasterjit import b", b=checked)) == []


def test_long_signatures_are_found_but_in_kernels_and_keywords_of_public_functions(read):
    names = ", ".join(f"a{n}" for n in range(11))
    files = read(
        a=f"__all__ = ['shown']\ndef shown(x, *, {names}): ...\ndef hidden(x, *, {names}): ...\n"
        f"@kernel\ndef compiled({names}): ...\n@intrinsic(prefer=1)\ndef one({names}): ...\n",
        compat__pyrender__b=f"def theirs({names}): ...\n",
    )
    assert house.long_signatures(files) == ["rasterjit/a.py: hidden takes 12"]


def test_classes_that_two_files_define_are_named(read):
    files = read(
        a="class A: ...\nclass B: ...", b="class A: ...", compat__pyrender__c="class B: ..."
    )
    assert house.repeated_classes(files) == ["A: a, b"]


def test_a_heading_is_a_comment_on_a_line_of_its_own(read):
    files = read(
        a=f"def bare():\n{LONG}",
        b="def beside():\n" + LONG.replace("= 7\n", "= 7  # Seven.\n"),
        c="def headed():\n" + LONG.replace("x = 0", "# Nothing.\n    x = 0"),
        d=f'def short():\n    """Say.\n\n    More.\n    """\n{SHORT}',
    )
    assert house.headings(files) == {
        "rasterjit/a.py:1: bare": False,
        "rasterjit/b.py:1: beside": False,
        "rasterjit/c.py:1: headed": True,
    }


def test_a_version_is_measured(read, tmp_path):
    read(rendering__a="class Effect:\n    name: str\n    field = 1\n    def see(self): ...\n")
    (tmp_path / "CHANGELOG.md").write_text("one\ntwo\n")
    rows, named = house.measure(tmp_path, quick=True)
    assert rows["attributes, methods of Effect"] == "2, 1"
    assert rows["lines of CHANGELOG.md"] == 2
    assert all(found == [] for found in named.values())


def test_more_errors_of_mypy_than_a_room_may_have_are_told_and_no_others(monkeypatch):
    monkeypatch.setattr(house, "MAX_TYPE_ERRORS", {"viewer": 2})
    lines = ["rasterjit/a.py:1: error: One", "rasterjit/a.py:2: error: Two"]
    assert house.beyond({"viewer": lines}) == []
    assert house.beyond({"viewer": [*lines, lines[0]]})[1:] == [*lines, lines[0]]
    assert house.beyond({"scene": lines[:1], "viewer": lines})[1:] == lines[:1]


@pytest.mark.takes_long
def test_mypy_reads_types_of_kernels_and_finds_errors_where_they_are_passed(read, tmp_path):
    files = read(
        runtime__state="float32, stored = 1, 2\n",
        scene__a="from rasterjit.runtime.state_block import float32, stored\n"
        "def kernel(rows: float32[:, ::1], depth: stored[::1], count: float32): ...\n"
        "def use(rows: 'float32[3, 4]') -> None:\n    kernel(rows, rows, 2.0)\n"
        "    kernel(1, rows, 2.0)\n",
    )
    (tmp_path / "pyproject.toml").write_text((ROOT / "pyproject.toml").read_text("utf-8"))
    (tmp_path / ".ci").symlink_to(ROOT / ".ci")
    errors = house.type_errors(tmp_path, files)
    assert [line.split(":")[:2] for line in errors.pop("scene")] == [["rasterjit/scene/a.py", "5"]]
    assert not errors
