"""Ctrl-C ends the command line with status 130 and one line, whenever it comes."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import trimesh
from click.testing import CliRunner

from rasterjit import cli, interrupts
from rasterjit.cli import commands

pytestmark = [
    pytest.mark.takes_long,
    pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process"),
]

ROOT = Path(__file__).parents[2]

INTERRUPTING = """
import os, signal, sys

class Finder:
    def find_spec(self, name, path, target=None):
        if name == os.environ["INTERRUPT_AT"]:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder())
"""
"""Presses Ctrl-C when a module begins to be imported; Python runs this as it starts."""

AT_THE_END = """
import os, signal, sys

class Last:
    def __del__(self, kill=os.kill, process=os.getpid(), number=signal.SIGINT, write=os.write):
        kill(process, number)
        write(2, b"after all")

sys.last = Last()
"""
"""Presses Ctrl-C when Python takes its modules apart."""

CONSOLE_SCRIPT = """
import sys
from rasterjit.cli import main
sys.exit(main())
"""

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def run_interrupted(folder, at, words):
    """Run a command that is interrupted at the import of a module."""
    (folder / "sitecustomize.py").write_text(INTERRUPTING)
    search = [str(folder), str(ROOT)]
    return subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, cwd=folder, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(search), "INTERRUPT_AT": at},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("way", "at"),
    [
        ("script", "rasterjit.cli"), ("script", "click"), ("module", "numpy"),
        ("module", "rasterjit.runtime"), ("script", "rasterjit.runtime.versions"),
        ("module", "rasterjit.scene.quality"), ("module", "atexit"), ("script", "atexit"),
    ],
)  # fmt: skip
def test_while_the_program_is_imported(tmp_path, way, at):
    script = tmp_path / "bin" / "rasterjit"
    script.parent.mkdir()
    script.write_text(CONSOLE_SCRIPT)
    words = [str(script)] if way == "script" else ["-m", "rasterjit"]
    done = run_interrupted(tmp_path, at, [*words, "--help"])
    assert (done.returncode, done.stderr, done.stdout) == (130, "error: interrupted\n", "")


@pytest.mark.parametrize(("option", "status"), [("--help", 0), ("--wrong", 2)])
def test_while_python_ends_all_is_done(tmp_path, option, status):
    (tmp_path / "sitecustomize.py").write_text(AT_THE_END)
    done = subprocess.run(
        [sys.executable, "-m", "rasterjit", option], capture_output=True, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
    )  # fmt: skip
    assert done.returncode == status
    assert done.stderr.endswith(b"after all")
    assert b"interrupted" not in done.stderr


@pytest.mark.parametrize("at", ["rasterjit.io.resources", "trimesh.constants", "PIL.Image"])
def test_while_a_command_imports(tmp_path, at):
    # A format that trimesh reads, here in the command's own process.
    trimesh.creation.box().export(tmp_path / "a.dae")
    words = ["-m", "rasterjit", "render", "a.dae", "-o", "a.png", "--size", "9x9", "--no-isolate"]
    done = run_interrupted(tmp_path, at, words)
    # Click goes to a new line after the terminal's ^C.
    assert (done.returncode, done.stderr.strip()) == (130, "error: interrupted")
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize("name", ["a.gif", "a.mp4"])
def test_while_an_encoder_begins(tmp_path, name):
    (tmp_path / "a.obj").write_text(TRIANGLE)
    words = ["-m", "rasterjit", "turntable", "a.obj", "-o", name, "--size", "32x32"]
    words += ["--frames", "400", "--quiet"]
    at = "PIL.GifImagePlugin" if name == "a.gif" else "imageio_ffmpeg"
    done = run_interrupted(tmp_path, at, words)
    assert (done.returncode, done.stderr.strip()) == (130, "error: interrupted")
    assert not [path for path in tmp_path.iterdir() if path.suffix in (".gif", ".mp4")]


def test_a_library_is_left_to_who_imports_it(tmp_path):
    done = run_interrupted(
        tmp_path, "rasterjit.scene.quality", ["-c", "import rasterjit; rasterjit.Quality"]
    )
    assert done.stderr.endswith("KeyboardInterrupt\n")


@pytest.fixture
def handled(monkeypatch):
    """Handle Ctrl-C in this process as the command line does."""
    monkeypatch.setattr(interrupts._FirstInterrupt, "time", None)
    before = signal.signal(signal.SIGINT, interrupts.interrupt)
    yield
    signal.signal(signal.SIGINT, before)


def test_an_import_that_raises_an_interrupt_ends_the_program(monkeypatch):
    class Ended(BaseException):
        pass

    def end(status):
        raise Ended(status)

    class Interrupting:
        @staticmethod
        def find_spec(name, path, target=None):
            if name == "rasterjit.cli.commands":
                raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(interrupts.os, "_exit", end)
    monkeypatch.setattr(sys, "meta_path", [Interrupting, *sys.meta_path])
    monkeypatch.delitem(sys.modules, "rasterjit.cli.commands", raising=False)
    try:
        with pytest.raises(Ended, match="130"):
            cli.main()
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("is_told", [True, False])
def test_an_interrupt_that_a_reader_took_for_an_error(handled, tmp_path, monkeypatch, is_told):
    def load(*arguments, **options):
        try:
            signal.raise_signal(signal.SIGINT)
        except BaseException as error:
            if is_told:
                raise ValueError("cannot be read") from error
        return "half a scene"

    monkeypatch.setattr("rasterjit.io.meshes.load", load)
    words = ["render", "a.obj", "-o", str(tmp_path / "a.png")]
    done = CliRunner().invoke(commands.program, words)
    assert (done.exit_code, done.stderr.strip()) == (130, "error: interrupted")


def test_an_interrupt_in_a_destructor_comes_again(handled, capfd):
    with pytest.raises(KeyboardInterrupt):
        interrupted_in_a_destructor()
    assert capfd.readouterr().err == ""


def interrupted_in_a_destructor():
    interrupts.print_unraisable(SimpleNamespace(exc_type=KeyboardInterrupt))
    for _ in range(1000):
        time.sleep(0.01)


def test_an_import_that_never_ends_is_interrupted_all_the_same(handled, tmp_path, monkeypatch):
    monkeypatch.setattr(interrupts, "MAX_IMPORT_WAIT", 0.2)
    path = tmp_path / "never_ends.py"
    path.write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(20)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        importlib.import_module(path.stem)
    assert 0.2 <= time.monotonic() - began < 10.0


@pytest.mark.parametrize(
    ("started", "shown", "expected"),
    [
        (["python", "-m", "rasterjit", "render"], ["-m", "render"], True),
        (["python", "-mrasterjit"], ["-m"], True),
        (["python", "-X", "dev", "/bin/rasterjit", "--help"], ["/bin/rasterjit", "--help"], True),
        (["python", "C:/rasterjit-script.py"], ["C:/rasterjit-script.py"], True),
        (["python", "C:/rasterjit.exe", "a"], ["C:/rasterjit.exe", "a"], True),
        (["python", "-m", "pytest"], ["-m"], False),
        (["python", "mine.py", "rasterjit"], ["mine.py", "rasterjit"], False),
        (["python", "-c", "from multiprocessing ...", "--x"], ["/bin/rasterjit", "a"], False),
        (["python"], [""], False),
        ([], [], False),
    ],
)
def test_the_program_is_known_by_how_it_was_started(monkeypatch, started, shown, expected):
    monkeypatch.setattr(sys, "orig_argv", started)
    monkeypatch.setattr(sys, "argv", shown)
    assert interrupts.is_program() == expected
