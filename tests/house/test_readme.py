"""The programs and commands of the pages for readers run as they are printed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from rasterjit.cli import commands

ROOT = Path(__file__).parents[2]
NOTEBOOKS = ("docs/guides/point_clouds.md", "docs/guides/animation.md")
"""Pages whose programs go on from one to the next: they are one."""
PAGES = (
    "README.md",
    "models/README.md",
    "docs/guides/cameras.md",
    "docs/coming_from/pyrender.md",
    *NOTEBOOKS,
)
QUIET = ("-W", "error::UserWarning", "-W", "error::FutureWarning", "-W", "ignore:time_budget")
"""Programs for readers warn of nothing, but that the machine may not be calibrated yet."""
SET_UP = "pip install"
"""Commands that make an environment of their own: ``.ci/run`` runs them."""


def blocks(language):
    """Return the blocks of a language, each with its page and number."""
    found = []
    for page in PAGES:
        text = (ROOT / page).read_text(encoding="utf-8")
        texts = re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)
        if page in NOTEBOOKS:
            texts = ["\n".join(texts)] if texts else []
        found += [pytest.param(t, id=f"{page}-{n}") for n, t in enumerate(texts, 1)]
    return found


COMMANDS = [block for block in blocks("sh") if SET_UP not in block.values[0]]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return an empty folder to work in, with the models."""
    (tmp_path / "models").symlink_to(ROOT / "models")
    monkeypatch.chdir(tmp_path)
    return tmp_path


# A main program starts processes.
@pytest.mark.parametrize("program", blocks("python"))
def test_program_runs(program, folder):
    (folder / "program.py").write_text(program, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, *QUIET, "program.py"],
        cwd=folder, capture_output=True, text=True, env=environment(), timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    written = re.findall(r'(?:save|save_\w+|render_large)\((?:[^()"]*, )?"(.*?)"', program)
    for name in written:
        assert (folder / name).stat().st_size > 300


@pytest.mark.parametrize("command", COMMANDS)
def test_command_runs(command, folder):
    own = f'rasterjit() {{ {sys.executable} -m rasterjit "$@"; }}\n'
    done = subprocess.run(
        ["bash", "-ec", own + command],
        cwd=folder, capture_output=True, text=True, env=environment(), timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", PAGES)
def test_a_code_span_holds_no_line_of_a_list(page):
    text = re.sub(r"```.*?```", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.DOTALL)
    spans = [span for block in text.split("\n\n") for span in re.findall(r"`([^`]+)`", block)]
    assert spans
    assert [span for span in spans if re.search(r"\S  +\S", span)] == []


def test_the_list_of_commands_has_them_all():
    page = (ROOT / "docs/guides/command_line.md").read_text("utf-8")
    (listed,) = re.findall(r"## Commands\n\n```text\n(.*?)```", page, re.DOTALL)
    lines = [line.split()[1:3] for line in listed.splitlines()]
    assert {name for name, _ in lines} == set(commands.program.commands)
    assert {what for name, what in lines if name == "render"} == {"FILE", "FOLDER"}


def environment():
    """Return the environment of a process that finds this package, wherever it works."""
    return os.environ | {"PYTHONPATH": str(ROOT)}
