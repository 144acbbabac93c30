"""Windows that do not open: what is missing is said, and the process goes on."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import rasterjit as rj
from rasterjit.runtime import progress
from rasterjit.viewer import canvas, show, window_probe
from rasterjit.viewer.viewer import Viewer

PATIENCE = 120
"""Seconds for a trial on a loaded machine."""

ABORTING = """
import os, sys
sys.stderr.write({words!r})
sys.stderr.flush()
os.abort()
"""

QT_WORDS = (
    "qt.qpa.plugin: From 6.5.0, xcb-cursor0 or libxcb-cursor0 is needed to load the Qt xcb "
    'platform plugin.\nqt.qpa.plugin: Could not load the Qt platform plugin "xcb" in "" even '
    "though it was found.\n"
)

CHOOSE = """
import sys
from rasterjit.viewer import show
print(show.choose_backend(sys.argv[1]))
"""

NO_DRIVER = {"VK_ICD_FILENAMES": "/nothing/there.json", "VK_DRIVER_FILES": "/nothing/there.json"}


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """Return where trials are remembered, and forget what this process knows."""
    monkeypatch.setattr(window_probe, "user_cache_folder", lambda: tmp_path)
    window_probe._get_trial_result.cache_clear()
    yield window_probe.get_results_path()
    window_probe._get_trial_result.cache_clear()


@pytest.fixture
def display(monkeypatch, kept):
    """Say that there is a display that answers, and GLFW alone."""
    monkeypatch.setattr(window_probe, "has_display", lambda: True)
    monkeypatch.setattr(window_probe, "is_display_open", lambda: True)
    monkeypatch.setattr(window_probe, "list_toolkits", lambda: ["glfw"])
    monkeypatch.setattr(progress, "in_notebook", lambda: False)


def needs(*programs):
    """Skip where a program is missing, but in CI."""
    missing = [name for name in programs if shutil.which(name) is None]
    if missing or importlib.util.find_spec("glfw") is None:
        assert not os.environ.get("CI"), missing
        pytest.skip(f"needs {missing or 'glfw'}")


def free_display():
    """Return a display on which nobody listens."""
    taken = {path.name for path in Path("/tmp/.X11-unix").glob("X*")}
    return next(f":{number}" for number in range(4000, 5000) if f"X{number}" not in taken)


def run(arguments, tmp_path, under_xvfb=True, **variables):
    """Run Python with a cache folder of its own."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), **variables}
    environment.setdefault("RASTERJIT_CACHE_DIR", str(tmp_path / "kernels"))
    under = ["xvfb-run", "-a", "-s", "-screen 0 240x190x24"] if under_xvfb else []
    return subprocess.run(
        [*under, sys.executable, *arguments], capture_output=True, text=True, timeout=PATIENCE,
        check=False, env=environment,
    )  # fmt: skip


@pytest.mark.takes_long
def test_without_a_driver_it_goes_on_with_a_page_and_one_line(tmp_path):
    needs("xvfb-run")
    done = run(["-c", CHOOSE, "auto"], tmp_path, **NO_DRIVER)
    assert (done.returncode, done.stdout) == (0, "browser\n"), done.stderr
    (line,) = [line for line in done.stderr.splitlines() if "rasterjit" in line]
    assert "GLFW: it misses a Vulkan driver: apt install mesa-vulkan-drivers" in line
    assert line.endswith("Showing a page instead")
    kept = json.loads((tmp_path / "rasterjit" / "windows.json").read_text())
    assert all("Vulkan" in problem or "misses" in problem for problem, _ in kept.values())


@pytest.mark.takes_long
def test_with_a_driver_a_window_opens(tmp_path):
    needs("xvfb-run")
    done = run(["-c", CHOOSE, "auto"], tmp_path)
    assert (done.returncode, done.stdout) == (0, "window\n"), done.stderr
    kept = json.loads((tmp_path / "rasterjit" / "windows.json").read_text())
    assert [problem for problem, _ in kept.values()] == [""]


@pytest.mark.takes_long
@pytest.mark.parametrize("under_xvfb", [True, False])
def test_window_asked_for_by_name_is_an_error_of_status_1(tmp_path, under_xvfb):
    needs("xvfb-run")
    place = Path(__file__).parents[2] / "models" / "teapot.obj"
    variables = NO_DRIVER if under_xvfb else {"DISPLAY": free_display(), "WAYLAND_DISPLAY": ""}
    done = run(
        ["-m", "rasterjit", "view", str(place), "--backend", "window"], tmp_path, under_xvfb,
        **variables,
    )  # fmt: skip
    said = [line for line in done.stderr.splitlines() if not line.startswith("xvfb-run")]
    assert done.returncode == 1, done.stderr
    assert len(said) == 1
    assert said[0].startswith("error: --backend must be one that works here")
    what = "mesa-vulkan-drivers" if under_xvfb else f"{variables['DISPLAY']} does not answer"
    assert what in said[0]


@pytest.mark.skipif(sys.platform != "linux", reason="X servers listen so on Linux")
def test_display_that_does_not_answer_is_said_before_anything_is_tried(kept, monkeypatch, capsys):
    monkeypatch.setattr(window_probe, "list_toolkits", lambda: ["glfw"])
    monkeypatch.setattr(window_probe, "run_trial", lambda name: pytest.fail("tried"))
    monkeypatch.setattr(progress, "in_notebook", lambda: False)
    place = free_display()
    monkeypatch.setenv("DISPLAY", place)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert show.choose_backend("auto") == "browser"
    assert f"the display {place} does not answer" in capsys.readouterr().err
    with pytest.raises(ValueError, match=f"the display {place} does not answer"):
        show.choose_backend("window")


@pytest.mark.parametrize("display", ["nonsense", ":", ":x.0", "host-that-is-none.invalid:1"])
def test_display_that_is_none_does_not_answer(monkeypatch, display):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", display)
    assert not window_probe.is_display_open()


def test_qt_without_its_libraries_is_said_and_the_next_is_taken(
    kept, display, monkeypatch, tmp_path
):
    # What ends the process of Qt's trial is Qt's own way: its words, and an abort.
    place = tmp_path / "packages" / "PySide6"
    place.mkdir(parents=True)
    (place / "__init__.py").write_text(ABORTING.format(words=QT_WORDS))
    monkeypatch.syspath_prepend(place.parent)
    monkeypatch.setattr(window_probe, "list_toolkits", lambda: ["PySide6", "glfw"])
    real = window_probe.run_trial
    monkeypatch.setattr(
        window_probe, "run_trial", lambda name: real(name) if name == "PySide6" else ""
    )
    assert "libxcb-cursor0" in window_probe.try_toolkit("PySide6")
    assert window_probe.find_toolkit() == ("glfw", "")
    monkeypatch.setattr(window_probe, "list_toolkits", lambda: ["PySide6"])
    with pytest.raises(ValueError, match="PySide6: it misses libraries of the system: apt install"):
        show.choose_backend("window")


def link(source, target):
    """Copy a file, by a link where that can be."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


@pytest.mark.takes_long
@pytest.mark.parametrize("is_whole", [True, False])
def test_qt_itself_is_tried(tmp_path, is_whole):
    needs("xvfb-run")
    if importlib.util.find_spec("PySide6") is None:
        pytest.skip("needs PySide6")
    variables = {}
    if not is_whole:
        # Without its plugin for X11 it ends as it does without a library that the plugin needs.
        packages = tmp_path / "packages"
        for name in ("PySide6", "shiboken6"):
            installed = Path(importlib.util.find_spec(name).origin).parent
            shutil.copytree(installed, packages / name, copy_function=link)
        (packages / "PySide6/Qt/plugins/platforms/libqxcb.so").unlink()
        variables = {
            "PYTHONPATH": os.pathsep.join([str(packages), os.environ.get("PYTHONPATH", "")])
        }
    script = "from rasterjit.viewer import window_probe; print(window_probe.run_trial('PySide6'))"
    done = run(["-c", script], tmp_path, **variables)
    assert done.returncode == 0, done.stderr
    if not is_whole:
        assert "it misses libraries of the system: apt install" in done.stdout
    elif os.environ.get("CI"):
        assert done.stdout == "\n"


def test_qt_that_shows_nothing_opens_no_window():
    said = window_probe.explain_output("PySide6", "its platform shows nothing: offscreen")
    assert said == "leave QT_QPA_PLATFORM out"


def test_trial_is_made_once_and_remembered(kept, display, monkeypatch):
    tried = []
    monkeypatch.setattr(window_probe, "run_trial", lambda name: tried.append(name) or "")
    for _ in range(3):
        window_probe._get_trial_result.cache_clear()
        assert window_probe.find_toolkit() == ("glfw", "")
    assert tried == ["glfw"]
    # Another display may tell something else.
    monkeypatch.setenv("DISPLAY", ":4711")
    window_probe.find_toolkit()
    assert tried == ["glfw", "glfw"]


def test_failure_is_remembered_for_a_day(kept, display, monkeypatch):
    tried = []
    monkeypatch.setattr(window_probe, "run_trial", lambda name: tried.append(name) or "no")
    now = window_probe.time.time()
    for hours, count in ((0, 1), (23, 1), (25, 2)):
        monkeypatch.setattr(window_probe.time, "time", lambda hours=hours: now + 3600 * hours)
        window_probe._get_trial_result.cache_clear()
        assert window_probe.find_toolkit() == ("", "GLFW: no")
        assert len(tried) == count


def test_trial_that_takes_long_is_not_remembered(kept, display, monkeypatch):
    monkeypatch.setattr(window_probe, "TRIAL_SECONDS", 0.2)
    monkeypatch.setattr(window_probe, "TRIAL_SCRIPT", "import time; time.sleep(60)")
    assert window_probe.find_toolkit() == ("", "GLFW: it did not show a picture in 0 s")
    assert not kept.exists()


@pytest.mark.parametrize("content", ["", "[]", '{"a": 3}', '{"a": ["", "x"]}', "null", "\x00"])
def test_damaged_memory_is_passed_over(kept, display, monkeypatch, content):
    kept.write_text(content)
    monkeypatch.setattr(window_probe, "run_trial", lambda name: "")
    assert window_probe.find_toolkit() == ("glfw", "")
    assert [problem for problem, _ in json.loads(kept.read_text()).values()] == [""]


def test_memory_that_cannot_be_written_is_no_matter(display, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(window_probe, "user_cache_folder", lambda: tmp_path / "file")
    window_probe._get_trial_result.cache_clear()
    monkeypatch.setattr(window_probe, "run_trial", lambda name: "")
    assert window_probe.find_toolkit() == ("glfw", "")


def test_without_window_and_server_it_is_the_terminal(display, monkeypatch, capsys):
    monkeypatch.setattr(window_probe, "list_toolkits", list)
    monkeypatch.setattr(show, "SERVER_PACKAGES", ("no_such_server",))
    monkeypatch.setattr(canvas, "has_terminal", lambda: True)
    assert show.choose_backend("auto") == "terminal"
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert 'pip install "rasterjit[viewer]"' in said
    assert said.endswith("Showing the terminal instead\n")
    monkeypatch.setattr(canvas, "has_terminal", lambda: False)
    with pytest.raises(ImportError, match=r'pip install "rasterjit\[browser\]"'):
        show.choose_backend("auto")


def test_nothing_is_drawn_where_no_window_opens(cube, display, monkeypatch):
    monkeypatch.setattr(window_probe, "run_trial", lambda name: "it is broken")
    monkeypatch.setattr(Viewer, "draw", lambda self: pytest.fail("drawn"))
    with pytest.raises(ValueError, match="got 'window': GLFW: it is broken"):
        rj.show(cube, backend="window", size=(8, 6))
