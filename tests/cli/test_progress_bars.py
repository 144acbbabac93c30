"""Bars with the time left, where somebody looks at standard error; nothing of them elsewhere."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from rasterjit.cli import report
from rasterjit.runtime import jit

MODELS = Path(__file__).parents[2] / "models"

BAR = "━"

LEFT = r"-:--:--|\d:\d\d:\d\d"
"""How rich shows the time left; dashes until something is known of it."""

pytestmark = pytest.mark.skipif(jit.DISABLED or jit.CHECKED, reason="too slow in plain Python")

COMMANDS = {
    "accuracy": ("accuracy", "cube.ply", "-o", "out", "--size", "24x16", "--budget", "0.3",
                 "--knobs", "samples"),
    "turntable": ("turntable", "cube.ply", "-o", "out.gif", "--size", "24x16", "--frames", "6"),
    "dataset": ("dataset", "meshes", "-o", "out", "--size", "24x16", "--views", "2"),
}  # fmt: skip
"""What takes more than two seconds as a rule, made small."""


@pytest.fixture
def folder(tmp_path):
    """A folder with a mesh, and with a folder of meshes."""
    cube = (MODELS / "cube.ply").read_bytes()
    (tmp_path / "cube.ply").write_bytes(cube)
    (tmp_path / "meshes").mkdir()
    for name in ("one.ply", "two.ply"):
        (tmp_path / "meshes" / name).write_bytes(cube)
    return tmp_path


def said(folder, arguments, is_terminal):
    """Standard error of a command: what is written to a terminal, or into a pipe."""
    command = [sys.executable, "-m", "rasterjit", *arguments]
    settings = {**os.environ, "COLUMNS": "100", "TERM": "xterm"}
    if not is_terminal:
        done = subprocess.run(command, cwd=folder, env=settings, capture_output=True, check=True)
        return done.stderr.decode()
    ours, theirs = os.openpty()
    process = subprocess.Popen(
        command, cwd=folder, env=settings, stdout=subprocess.DEVNULL, stderr=theirs
    )
    os.close(theirs)
    parts = []
    try:
        while part := os.read(ours, 4096):
            parts.append(part)
    except OSError:
        # So a terminal ends whose other side is closed.
        pass
    finally:
        os.close(ours)
        assert process.wait() == 0
    return b"".join(parts).decode()


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="there is no terminal to imitate")
@pytest.mark.parametrize("command", COMMANDS)
def test_a_terminal_shows_a_bar_with_the_time_left(folder, command):
    text = said(folder, COMMANDS[command], is_terminal=True)
    lines = [line for line in re.split(r"[\r\n]", text) if BAR in line]
    assert lines
    # How much there is need not be known at first.
    assert re.search(LEFT, lines[-1])


@pytest.mark.parametrize("command", COMMANDS)
def test_a_pipe_gets_no_bar(folder, command):
    text = said(folder, COMMANDS[command], is_terminal=False)
    assert not re.search(f"{BAR}|\x1b|\r|{LEFT}", text)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="there is no terminal to imitate")
@pytest.mark.parametrize("command", ["turntable", "dataset"])
def test_quiet_shows_no_bar_on_a_terminal(folder, command):
    assert BAR not in said(folder, (*COMMANDS[command], "--quiet"), is_terminal=True)


def test_without_rich_there_is_no_bar(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rich.console", None)
    assert [*report.iterate_with_progress([1, 2], 2, "counting", False)] == [1, 2]
    with report.show_progress_bar("counting", False, is_told=True) as progress:
        progress(0, 2)
    assert capsys.readouterr().err == "counting (2 to do)\n"
