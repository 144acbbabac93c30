"""Programs and commands of the pages for readers run as they are printed; links lead somewhere."""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
from pathlib import Path

import programs
import pytest

from rasterjit.cli import commands

ROOT = Path(__file__).parents[2]
README = "README.md"
PAGES = [
    README,
    "models/README.md",
    *sorted(str(page.relative_to(ROOT)) for page in ROOT.glob("docs/**/*.md")),
    *sorted(str(page.relative_to(ROOT)) for page in ROOT.glob(".github/*.md")),
]
QUIET = ("-W", "error::UserWarning", "-W", "error::FutureWarning", "-W", "ignore:time_budget")
"""Programs for readers warn of nothing, but that the machine may not be calibrated yet."""
SET_UP = "pip install"
"""Commands that make an environment of their own: ``.ci/run`` runs them."""
OWN = (("python", ""), ("pytest", "-m pytest"), ("rasterjit", "-m rasterjit"))
"""Commands that are those of this environment, and how Python runs them."""
PROGRAM = re.compile(r"^(import|from) rasterjit", re.MULTILINE)
"""What makes a block a program. Others go on from the block of Python right before them."""


def text_of(page):
    """Return the text of a page."""
    return (ROOT / page).read_text(encoding="utf-8")


def steps(page):
    """Return what a page runs, in order: ("python" or "sh", text); less what the README runs."""
    found = []
    for language, text in re.findall(r"^```(python|sh)\n(.*?)^```", text_of(page), re.M | re.S):
        follows = found and found[-1][0] == language == "python"
        if follows and not PROGRAM.search(text):
            found[-1] = ("python", f"{found[-1][1]}\n{text}")
        elif SET_UP not in text:
            found.append((language, text))
    return found if page == README else [step for step in found if step not in steps(README)]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return an empty folder to work in, with the models and a robot."""
    (tmp_path / "models").symlink_to(ROOT / "models")
    (tmp_path / "arm.urdf").symlink_to(ROOT / "docs" / "examples" / "arm.urdf")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(arguments, folder):
    """Run a process in a folder, which finds this package there; return what it prints."""
    done = subprocess.run(
        arguments, cwd=folder, capture_output=True, text=True, timeout=600,
        # pytest loads what a page names alone: every plug-in of these tests takes a second.
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("page", [page for page in PAGES if steps(page)])
def test_programs_and_commands_of_a_page_run(page, folder):
    for language, parts in itertools.groupby(enumerate(steps(page), 1), lambda part: part[1][0]):
        texts = {f"{language}_{n}": text for n, (_, text) in parts}
        if language == "python":
            run_programs(texts, folder)
        else:
            own = "".join(f'{name}() {{ {sys.executable} {way} "$@"; }}\n' for name, way in OWN)
            for text in texts.values():
                run(["bash", "-ec", own + text], folder)


def run_programs(texts, folder):
    """Run programs in one process; each has to print something, and to write what it saves."""
    names = [f"{name}.py" for name in texts]
    for name, text in zip(names, texts.values(), strict=True):
        (folder / name).write_text(text, encoding="utf-8")
    printed = run([sys.executable, *QUIET, programs.__file__, *names], folder)
    for part in printed.split(programs.BEGIN)[1:]:
        name, *lines = part.splitlines()
        assert any(line.strip() for line in lines), name
        text = texts[name.removesuffix(".py")]
        for saved in re.findall(r'(?:save|save_\w+|render_large)\((?:[^()"]*, )?"(.*?)"', text):
            assert (folder / saved).stat().st_size > 300, (name, saved)
    assert printed.count(programs.BEGIN) == len(names)


def anchors(page):
    """Return what a link to a heading of a page may name, as GitHub makes it."""
    text = re.sub(r"^```.*?^```", "", text_of(page), flags=re.M | re.S)
    found = set()
    for heading in re.findall(r"^#+ (.*)$", text, re.M):
        plain = re.sub(r"\[(.*?)\]\(.*?\)", r"\1", heading)
        found.add(re.sub(r"[^\w\- ]", "", plain.lower()).strip().replace(" ", "-"))
    return found


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    text = re.sub(r"^```.*?^```", "", text_of(page), flags=re.M | re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"\w+:", target):
            continue
        path, _, anchor = target.partition("#")
        place = (ROOT / page).parent / path if path else ROOT / page
        assert place.exists(), target
        if anchor:
            assert anchor in anchors(place.resolve().relative_to(ROOT)), target


@pytest.mark.parametrize("page", PAGES)
def test_a_code_span_holds_no_line_of_a_list(page):
    text = re.sub(r"```.*?```", "", text_of(page), flags=re.DOTALL)
    spans = [span for block in text.split("\n\n") for span in re.findall(r"`([^`]+)`", block)]
    assert [span for span in spans if re.search(r"\S  +\S", span)] == []


def test_the_list_of_commands_has_them_all():
    page = (ROOT / "docs/guides/command_line.md").read_text("utf-8")
    (listed,) = re.findall(r"## Commands\n\n```text\n(.*?)```", page, re.DOTALL)
    lines = [line.split()[1:3] for line in listed.splitlines()]
    assert {name for name, _ in lines} == set(commands.program.commands)
    assert {what for name, what in lines if name == "render"} == {"FILE", "FOLDER"}


def test_the_readme_is_short_and_its_pictures_are_small():
    text = text_of(README)
    assert len(text.splitlines()) <= 200
    pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text)
    assert len(pictures) > 12
    assert max((ROOT / picture).stat().st_size for picture in pictures) <= 300_000
