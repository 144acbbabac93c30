"""The viewer in a window, on a screen that is not there."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from cubes import CUBE_FACES, CUBE_VERTICES
from PIL import Image
from viewing import PATIENCE

import rasterjit as rj
from rasterjit.viewer import show, window_probe
from rasterjit.viewer.viewer import Viewer

pytestmark = pytest.mark.takes_long

SIZE = (200, 150)
SCRIPT = """
import json, sys, time
import numpy as np
from PIL import ImageGrab
import rasterjit as rj
from rasterjit.viewer import canvas as viewer_window
from rasterjit.viewer.viewer import Viewer

vertices, faces, folder = json.loads(sys.argv[1])
viewer_window.ADDED_NICENESS = 0
viewer = Viewer(rj.Mesh(vertices, faces), size=(200, 150))
viewer.handle({"event_type": "key_down", "key": "i"})
canvas, loop = viewer_window.make_window(viewer, "cube")
seen = []

def look():
    seen.append(np.asarray(ImageGrab.grab(xdisplay="").convert("RGB")))

def act(number):
    for kind, x, y in (("down", 50, 50), ("move", 90, 70), ("up", 90, 70)):
        canvas.submit_event({"event_type": "pointer_" + kind, "x": x, "y": y, "button": 1,
                             "buttons": (1,), "modifiers": ()})

async def play():
    from rendercanvas.utils.asyncs import sleep
    for number in range(2):
        limit = time.monotonic() + 100
        await sleep(0.5)
        while not viewer.is_done and time.monotonic() < limit:
            await sleep(0.1)
        await sleep(1.0)
        look()
        if number == 0:
            act(number)
    canvas.close()

loop.add_task(play)
loop.run()
np.savez(folder + "/seen.npz", first=seen[0], second=seen[1])
print(json.dumps([canvas.__class__.__module__, list(viewer.camera.eye)]))
"""


def found_in(screen, picture):
    """Tell whether a picture is somewhere on the screen, pixel by pixel."""
    height, width = picture.shape[:2]
    for top in range(screen.shape[0] - height + 1):
        for left in range(screen.shape[1] - width + 1):
            place = screen[top : top + height, left : left + width]
            middle = height // 2, width // 2
            if (place[middle] == picture[middle]).all() and (place == picture).all():
                return True
    return False


@pytest.mark.needs_jit
def test_window_shows_what_the_controls_foretell(tmp_path):
    missing = [name for name in ("Xvfb", "xvfb-run") if shutil.which(name) is None]
    if missing or not window_probe.list_toolkits():
        assert not os.environ.get("CI"), missing
        pytest.skip(f"needs {missing or 'glfw'}")
    mesh = json.dumps([CUBE_VERTICES.tolist(), CUBE_FACES.tolist(), str(tmp_path)])
    done = subprocess.run(
        ["xvfb-run", "-a", "-s", "-screen 0 240x190x24", sys.executable, "-c", SCRIPT, mesh],
        capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    _, eye = json.loads(done.stdout.splitlines()[-1])
    mine = Viewer(rj.Mesh(CUBE_VERTICES, CUBE_FACES), size=SIZE)
    with np.load(tmp_path / "seen.npz") as screens:
        for name in ("first", "second"):
            Image.fromarray(screens[name]).save(tmp_path / f"{name}.png")
            frame = rj.render(mine.scene, mine.camera, size=SIZE, quality=rj.Quality.reference())
            assert found_in(screens[name], frame.color[:, :, :3]), name
            for kind, x, y in (("down", 50, 50), ("move", 90, 70), ("up", 90, 70)):
                mine.handle({"event_type": f"pointer_{kind}", "x": x, "y": y, "button": 1})
            while name == "first" and mine.is_moving:
                mine.advance(0.05)
            if name == "first":
                assert mine.camera.eye == pytest.approx(eye)
    mine.close()


def test_no_display_is_said(cube, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(window_probe, "list_toolkits", lambda: ["glfw"])
    monkeypatch.setattr(window_probe, "is_display_open", lambda: True)
    monkeypatch.setattr(window_probe, "try_toolkit", lambda name: "")
    monkeypatch.setattr(Viewer, "draw", lambda self: pytest.fail("drawn"))
    with pytest.raises(ValueError, match="neither DISPLAY nor WAYLAND_DISPLAY is set"):
        rj.show(cube, backend="window", size=(8, 6))
    assert show.choose_backend("auto") == "browser"
    monkeypatch.setenv("DISPLAY", ":7")
    assert show.choose_backend("auto") == "window"
    monkeypatch.setattr(window_probe, "list_toolkits", list)
    assert show.choose_backend("auto") == "browser"


def forgotten(*missing):
    """Return the modules that are there and would not be without some libraries."""
    # The widget is defined where anywidget was found.
    roots = {*missing, "rendercanvas"}
    return [
        name
        for name in sys.modules
        if name.split(".")[0] in roots or name == "rasterjit.viewer.widget"
    ]


@pytest.fixture
def own_modules():
    """Let the modules of a toolkit be those of before, and no mixture with what a test imports."""
    before = {name: sys.modules[name] for name in forgotten()}
    yield
    for name in forgotten():
        del sys.modules[name]
    sys.modules.update(before)


@pytest.mark.usefixtures("own_modules")
@pytest.mark.parametrize(
    ("backend", "missing", "extra"),
    [
        ("window", ("glfw", "PySide6", "PyQt6", "PySide2", "PyQt5"), "viewer"),
        ("browser", ("uvicorn",), "browser"),
        ("terminal", ("blessed",), "terminal"),
        ("notebook", ("anywidget",), "notebook"),
        ("window", ("rendercanvas",), "viewer"),
    ],
)
def test_missing_extra_is_named(cube, monkeypatch, backend, missing, extra):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name in missing else find(name)
    )
    for name in forgotten(*missing):
        monkeypatch.delitem(sys.modules, name)
    for name in missing:
        monkeypatch.setitem(sys.modules, name, None)

    class Terminal:
        def isatty(self):
            return True

    # Nobody waits for a picture to hear of it.
    monkeypatch.setattr(Viewer, "draw", lambda self: pytest.fail("drawn"))
    monkeypatch.setattr(sys, "__stdout__", Terminal())
    monkeypatch.setattr(sys, "__stdin__", Terminal())
    with pytest.raises(ImportError, match=rf'pip install "rasterjit\[{extra}\]"'):
        rj.show(cube, backend=backend, size=(8, 6))


RESIZING = """
import json, subprocess, sys, time
import rasterjit as rj
from rasterjit.viewer import canvas as viewer_window
from rasterjit.viewer.viewer import Viewer

vertices, faces = json.loads(sys.argv[1])
viewer = Viewer(rj.Mesh(vertices, faces), size=(200, 150))
canvas, loop = viewer_window.make_window(viewer, "cube")
kinds, seen = [], []

def tool(*words):
    subprocess.run(["xdotool", "search", "--name", "cube", *words], check=True)

async def until(wanted):
    from rendercanvas.utils.asyncs import sleep
    limit = time.monotonic() + 40
    while not wanted() and time.monotonic() < limit:
        await sleep(0.05)

async def play():
    await until(lambda: viewer.is_done)
    viewer.controls = viewer.controls.turn(40.0, 10.0).at_rest()
    viewer._invalidate()
    kinds.append(type(viewer.controls))
    tool("windowfocus", "mousemove", "50", "50")
    for _ in range(2):
        subprocess.run(["xdotool", "key", "c"], check=True)
        await until(lambda: type(viewer.controls) is not kinds[-1])
        kinds.append(type(viewer.controls))
    for size in ((230, 90), (120, 170)):
        seen.append(viewer.camera.eye)
        tool("windowsize", "%@", *map(str, size))
        await until(lambda: viewer.size == size)
        seen.append([*viewer.camera.eye, *viewer.size])
    canvas.close()

loop.add_task(play)
loop.run()
print(json.dumps([[kind.__name__ for kind in kinds], seen]))
"""


@pytest.mark.needs_jit
def test_window_that_is_resized_shows_the_same_view():
    missing = [name for name in ("Xvfb", "xvfb-run", "xdotool") if shutil.which(name) is None]
    if missing or not window_probe.list_toolkits():
        assert not os.environ.get("CI"), missing
        pytest.skip(f"needs {missing or 'glfw'}")
    mesh = json.dumps([CUBE_VERTICES.tolist(), CUBE_FACES.tolist()])
    done = subprocess.run(
        ["xvfb-run", "-a", "-s", "-screen 0 320x240x24", sys.executable, "-c", RESIZING, mesh],
        capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    kinds, seen = json.loads(done.stdout.splitlines()[-1])
    assert kinds == ["Orbit", "Fly", "Orbit"]
    for before, after, size in ((*seen[:2], [230, 90]), (*seen[2:], [120, 170])):
        assert after[3:] == size
        assert after[:3] == pytest.approx(before)
