"""
Try which toolkits open windows here, where it can fail: in a process of its own.

Without a driver, a display or a library, GLFW and Qt end their process; nothing can be caught. What
a trial tells is remembered, in this process and in the cache folder, until something changes that
it depends on: the display, variables, packages, drivers or libraries of the system.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import json
import os
import platform
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from importlib import metadata
from pathlib import Path

from rasterjit.io.atomic_write import atomic_file
from rasterjit.runtime.store import cache_folder

TOOLKITS = {
    "glfw": ("glfw", "wgpu"),
    **{name: (name,) for name in ("PySide6", "PyQt6", "PySide2", "PyQt5")},
}
"""Packages that open windows, the preferred first, and what each one needs. Pictures come into a
window of GLFW by wgpu, which needs a driver for the GPU, or for the CPU in its place; Qt needs
libraries of the system."""

NO_TOOLKIT = (
    'a window needs a toolkit: pip install "rasterjit[viewer]" for GLFW, or '
    '"rasterjit[viewer-qt]" for Qt'
)

LONGEST_TRIAL = 60.0
"""Seconds that a trial may take; loading a toolkit takes one, on a quiet machine."""

LONGEST_CONNECT = 2.0
"""Seconds for a display to answer."""

SUCCESS_KEPT_FOR, FAILURE_KEPT_FOR = 30 * 24 * 3600.0, 24 * 3600.0
"""Seconds that a trial is remembered; a failure shorter, as it may have been mended."""

MAX_KEPT = 100
"""Trials that are remembered, the latest."""

FIRST_PORT = 6000
"""TCP port of an X server's display 0."""

VARIABLES = (
    "DISPLAY", "WAYLAND_DISPLAY", "XAUTHORITY", "XDG_RUNTIME_DIR", "XDG_SESSION_TYPE",
    "LD_LIBRARY_PATH", "LD_PRELOAD", "LIBGL_ALWAYS_SOFTWARE", "PYGLFW_LIBRARY",
    "PYGLFW_LIBRARY_VARIANT", "PYGLFW_PREVIEW",
)  # fmt: skip
"""Variables that say how windows are opened ..."""

PREFIXES = ("QT_", "VK_", "WGPU_", "MESA_", "DRI_", "__GL", "RENDERCANVAS_")
"""... and how the names of others begin."""

PLACES = (
    "/etc/ld.so.cache", "/etc/vulkan/icd.d", "/usr/share/vulkan/icd.d",
    "/usr/local/share/vulkan/icd.d", "/usr/share/glvnd/egl_vendor.d", "/dev/dri",
)  # fmt: skip
"""What changes when a driver or a library of the system is installed."""

SHOWN = "a picture was shown"

TRIAL = f"""
import sys
sys.path[:] = sys.argv[2:]
import importlib, os
import numpy as np
backend = importlib.import_module("rendercanvas." + sys.argv[1].lower())
canvas = backend.RenderCanvas(size=(64, 48), title="RasterJIT tries this toolkit", max_fps=30)
context = canvas.get_bitmap_context()
drawn = []
def draw():
    context.set_bitmap(np.zeros((48, 64, 4), np.uint8))
    drawn.append(None)
async def end():
    from rendercanvas.utils.asyncs import sleep
    while len(drawn) < 2:
        canvas.request_draw(draw)
        await sleep(0.02)
    if hasattr(canvas, "windowHandle"):
        from rendercanvas.qt import QtGui
        if QtGui.QGuiApplication.platformName() in ("offscreen", "minimal", "minimalegl"):
            sys.stderr.write("its platform shows nothing: " + QtGui.QGuiApplication.platformName())
            sys.stderr.flush()
            os._exit(1)
    print({SHOWN!r}, flush=True)
    os._exit(0)
backend.loop.add_task(end)
backend.loop.run()
"""
"""Shows two pictures in a window: some failures come with the first one that reaches the screen."""

QT_LIBRARIES = (
    "apt install libxcb-cursor0 libxkbcommon-x11-0 libxcb-icccm4 libxcb-image0 libxcb-keysyms1 "
    "libxcb-render-util0 libxcb-xinerama0 libegl1"
)

REFUSED_DISPLAY = "the display refuses it: see DISPLAY and XAUTHORITY"

ADVICE = (
    ("its platform shows nothing", "leave QT_QPA_PLATFORM out"),
    ("Could not connect to display", REFUSED_DISPLAY),
    ("could not connect to display", REFUSED_DISPLAY),
    ("Failed to open display", REFUSED_DISPLAY),
)
"""What a failed trial's output holds, and what that says; the first that fits."""

QT_ADVICE = (
    ("platform plugin", f"it misses libraries of the system: {QT_LIBRARIES}"),
    ("cannot open shared object file", f"it misses libraries of the system: {QT_LIBRARIES}"),
)

GLFW_ADVICE = (("wgpu", "it misses a Vulkan driver: apt install mesa-vulkan-drivers"),)


def has_display() -> bool:
    """Tell whether there is said to be a screen for windows."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def toolkits() -> list[str]:
    """Return the packages that are installed of those that open windows, the preferred first."""
    if importlib.util.find_spec("rendercanvas") is None:
        return []
    # One that runs already has the event loop.
    names = sorted(TOOLKITS, key=lambda name: name not in sys.modules)
    return [
        name
        for name in names
        if all(importlib.util.find_spec(needed) is not None for needed in TOOLKITS[name])
    ]


def choose_toolkit() -> str:
    """
    Return the first toolkit that opens a window here.

    Raises
    ------
    ImportError
        If no toolkit is installed, naming what to install.
    ValueError
        If there is no display, or no toolkit opens a window: in one line, what each one needs.
    """
    toolkit, problem = find_toolkit()
    if toolkit:
        return toolkit
    if problem == NO_TOOLKIT:
        raise ImportError(problem)
    raise ValueError(
        "backend must be one that works here (browser, terminal or notebook), got 'window': "
        + problem
    )


def find_toolkit() -> tuple[str, str]:
    """Return the first toolkit that opens a window here, and why none does; one of them empty."""
    found = toolkits()
    if not found:
        return "", NO_TOOLKIT
    if not has_display():
        return "", "neither DISPLAY nor WAYLAND_DISPLAY is set"
    if not display_answers():
        place = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
        return "", f"the display {place} does not answer"
    problems = []
    for name in found:
        problem = try_toolkit(name)
        if not problem:
            return name, ""
        problems.append(f"{'GLFW' if name == 'glfw' else name}: {problem}")
    return "", "; ".join(problems)


def display_answers() -> bool:
    """Tell whether somebody listens where the display is said to be."""
    if sys.platform in ("win32", "darwin"):
        return True
    places = [*_wayland_places(), *_x_places()]
    return not places or any(_answers(place) for place in places)


def _wayland_places() -> Iterator[str | tuple[str, int]]:
    name = os.environ.get("WAYLAND_DISPLAY")
    if name:
        yield str(Path(os.environ.get("XDG_RUNTIME_DIR", "")) / name)


def _x_places() -> Iterator[str | tuple[str, int]]:
    """Yield where an X server may listen, by the rules of Xlib for ``host:display.screen``."""
    display = os.environ.get("DISPLAY", "")
    host, _, rest = display.rpartition(":")
    number = rest.split(".")[0]
    if not display:
        return
    if not number.isdecimal():
        yield display
        return
    if host in ("", "unix"):
        # The abstract name of Linux first, as Xlib does.
        yield f"\0/tmp/.X11-unix/X{number}"
        yield f"/tmp/.X11-unix/X{number}"
    if host != "unix":
        yield host.strip("[]") or "localhost", FIRST_PORT + int(number)


def _answers(place: str | tuple[str, int]) -> bool:
    """Tell whether a connection to a place is taken."""
    try:
        if isinstance(place, tuple):
            socket.create_connection(place, LONGEST_CONNECT).close()
            return True
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(LONGEST_CONNECT)
            connection.connect(place)
            return True
    except (OSError, OverflowError, UnicodeError, AttributeError):
        return False


def try_toolkit(name: str) -> str:
    """Return why a toolkit opens no window here, in a few words; an empty text if it does."""
    return _try_once(name, what_it_depends_on(name))


@functools.cache
def _try_once(name: str, key: str) -> str:
    """Return what is remembered of a trial, or what it tells now."""
    kept = _read_kept()
    if key in kept:
        return kept[key][0]
    problem = try_now(name)
    if problem is None:
        # A machine that is too busy is so for a while.
        return f"it did not show a picture in {LONGEST_TRIAL:.0f} s"
    _write_kept({**kept, key: (problem, time.time())})
    return problem


def try_now(name: str) -> str | None:
    """Try a toolkit, and return what is wrong; an empty text if nothing; None if it takes long."""
    if not sys.executable:
        # A program that holds Python inside cannot be asked to be Python alone.
        return ""
    try:
        done = subprocess.run(
            [sys.executable, "-c", TRIAL, name, *sys.path],
            stdin=subprocess.DEVNULL, capture_output=True, timeout=LONGEST_TRIAL, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None
    except OSError:
        return ""
    if SHOWN.encode() in done.stdout:
        return ""
    return explain_output(name, done.stderr.decode(errors="replace"))


def explain_output(name: str, output: str) -> str:
    """Return what the output of a toolkit's failed trial says, in a few words."""
    for sign, advice in (*ADVICE, *(GLFW_ADVICE if name == "glfw" else QT_ADVICE)):
        if sign in output:
            return advice
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    return f"it ended without a window ({lines[-1][:200]})" if lines else "it ended without a word"


def what_it_depends_on(name: str) -> str:
    """Return a text that changes whenever a trial of a toolkit might tell something else."""
    variables = {
        key: value
        for key, value in os.environ.items()
        if key in VARIABLES or key.startswith(PREFIXES)
    }
    places = [*PLACES, os.environ.get("XAUTHORITY", ""), *map(str, _wayland_places())]
    places += [
        place.lstrip("\0") for place in _x_places() if isinstance(place, str) and place[:1] == "/"
    ]
    parts = [
        name, TRIAL, sys.executable, platform.platform(), platform.node(),
        sorted(variables.items()), [_state_of(place) for place in places],
        [_version_of(package) for package in ("rendercanvas", "numpy", *TOOLKITS[name])],
    ]  # fmt: skip
    return hashlib.sha256(json.dumps(parts).encode(errors="surrogateescape")).hexdigest()[:32]


def _state_of(place: str) -> list[int]:
    """Return what is another when a file or folder has changed."""
    try:
        found = os.stat(place) if place else None
    except (OSError, ValueError):
        found = None
    return [] if found is None else [found.st_ino, found.st_mtime_ns]


def _version_of(package: str) -> str:
    """Return the version of a package; PySide6 may be there in parts."""
    for name in (package, f"{package}_Essentials"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            return metadata.version(name)
    return ""


def kept_file() -> Path:
    """Return where trials are remembered."""
    return cache_folder() / "windows.json"


def _read_kept() -> Mapping[str, tuple[str, float]]:
    """Return the trials that are remembered: by key, what was wrong and when."""
    now = time.time()
    try:
        content = json.loads(kept_file().read_text(encoding="utf-8"))
        return {
            str(key): (str(problem), float(then))
            for key, (problem, then) in content.items()
            if now - float(then) <= (FAILURE_KEPT_FOR if problem else SUCCESS_KEPT_FOR)
        }
    except (OSError, RuntimeError, ValueError, TypeError, AttributeError):
        return {}


def _write_kept(kept: Mapping[str, tuple[str, float]]) -> None:
    """Remember trials, where that is possible."""
    latest = sorted(kept.items(), key=lambda item: item[1][1])[-MAX_KEPT:]
    with contextlib.suppress(OSError, RuntimeError):
        path = kept_file()
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with atomic_file(path) as temporary:
            temporary.write_text(json.dumps(dict(latest)), encoding="utf-8")
