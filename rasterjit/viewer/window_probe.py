"""
Probe which toolkits open windows here, each in a process of its own.

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
from rasterjit.runtime.store import user_cache_folder

TOOLKITS = {
    "glfw": ("glfw", "wgpu"),
    **{name: (name,) for name in ("PySide6", "PyQt6", "PySide2", "PyQt5")},
}
"""Packages that open windows, the preferred first, and what each one needs. Pictures come into a
window of GLFW by wgpu, which needs a driver for the GPU, or for the CPU in its place; Qt needs
libraries of the system."""

MISSING_TOOLKIT = (
    'a window needs a toolkit: pip install "rasterjit[viewer]" for GLFW, or '
    '"rasterjit[viewer-qt]" for Qt'
)

TRIAL_SECONDS = 60.0
"""Most seconds of a trial; loading a toolkit takes one, on a quiet machine."""

CONNECT_SECONDS = 2.0
"""Most seconds for a display to answer."""

SUCCESS_AGE_SECONDS, FAILURE_AGE_SECONDS = 30 * 24 * 3600.0, 24 * 3600.0
"""Seconds that results are kept; failures shorter, as they may have been mended."""

MAX_RESULTS = 100
"""Most results kept, the latest."""

FIRST_PORT = 6000
"""TCP port of an X server's display 0."""

WINDOW_VARIABLES = (
    "DISPLAY", "WAYLAND_DISPLAY", "XAUTHORITY", "XDG_RUNTIME_DIR", "XDG_SESSION_TYPE",
    "LD_LIBRARY_PATH", "LD_PRELOAD", "LIBGL_ALWAYS_SOFTWARE", "PYGLFW_LIBRARY",
    "PYGLFW_LIBRARY_VARIANT", "PYGLFW_PREVIEW",
)  # fmt: skip
"""Environment variables that windows depend on ..."""

WINDOW_PREFIXES = ("QT_", "VK_", "WGPU_", "MESA_", "DRI_", "__GL", "RENDERCANVAS_")
"""... and the prefixes of others."""

DRIVER_PATHS = (
    "/etc/ld.so.cache", "/etc/vulkan/icd.d", "/usr/share/vulkan/icd.d",
    "/usr/local/share/vulkan/icd.d", "/usr/share/glvnd/egl_vendor.d", "/dev/dri",
)  # fmt: skip
"""Paths that change when a driver or a library of the system is installed."""

SUCCESS_TEXT = "a picture was shown"

TRIAL_SCRIPT = f"""
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
    print({SUCCESS_TEXT!r}, flush=True)
    os._exit(0)
backend.loop.add_task(end)
backend.loop.run()
"""
"""Script that shows two pictures in a window: some failures come with the first one on screen."""

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
"""Texts in the output of a failed trial, and the advice for each; the first match counts."""

QT_ADVICE = (
    ("platform plugin", f"it misses libraries of the system: {QT_LIBRARIES}"),
    ("cannot open shared object file", f"it misses libraries of the system: {QT_LIBRARIES}"),
)

GLFW_ADVICE = (("wgpu", "it misses a Vulkan driver: apt install mesa-vulkan-drivers"),)


def has_display() -> bool:
    """Tell whether a display is configured."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def list_toolkits() -> list[str]:
    """Return the installed packages that open windows, the preferred first."""
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
    if problem == MISSING_TOOLKIT:
        raise ImportError(problem)
    raise ValueError(
        "backend must be one that works here (browser, terminal or notebook), got 'window': "
        + problem
    )


def find_toolkit() -> tuple[str, str]:
    """Return the first toolkit that opens a window, or the problem; the other one is empty."""
    installed = list_toolkits()
    if not installed:
        return "", MISSING_TOOLKIT
    if not has_display():
        return "", "neither DISPLAY nor WAYLAND_DISPLAY is set"
    if not is_display_open():
        address = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
        return "", f"the display {address} does not answer"
    problems = []
    for name in installed:
        problem = try_toolkit(name)
        if not problem:
            return name, ""
        problems.append(f"{'GLFW' if name == 'glfw' else name}: {problem}")
    return "", "; ".join(problems)


def is_display_open() -> bool:
    """Tell whether the display accepts connections."""
    if sys.platform in ("win32", "darwin"):
        return True
    addresses = [*_list_wayland_addresses(), *_list_x_addresses()]
    return not addresses or any(_can_connect(address) for address in addresses)


def _list_wayland_addresses() -> Iterator[str | tuple[str, int]]:
    name = os.environ.get("WAYLAND_DISPLAY")
    if name:
        yield str(Path(os.environ.get("XDG_RUNTIME_DIR", "")) / name)


def _list_x_addresses() -> Iterator[str | tuple[str, int]]:
    """Yield the addresses of an X server, by the rules of Xlib for ``host:display.screen``."""
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


def _can_connect(address: str | tuple[str, int]) -> bool:
    """Tell whether an address accepts connections."""
    try:
        if isinstance(address, tuple):
            socket.create_connection(address, CONNECT_SECONDS).close()
            return True
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(CONNECT_SECONDS)
            connection.connect(address)
            return True
    except (OSError, OverflowError, UnicodeError, AttributeError):
        return False


def try_toolkit(name: str) -> str:
    """Return the problem of a toolkit that opens no window here, in few words; empty if it does."""
    return _get_trial_result(name, make_trial_key(name))


@functools.cache
def _get_trial_result(name: str, key: str) -> str:
    """Return the cached result of a trial, or run it."""
    results = _read_results()
    if key in results:
        return results[key][0]
    problem = run_trial(name)
    if problem is None:
        # A machine that is too busy is so for a while.
        return f"it did not show a picture in {TRIAL_SECONDS:.0f} s"
    _write_results({**results, key: (problem, time.time())})
    return problem


def run_trial(name: str) -> str | None:
    """Run a trial; return its problem; an empty text if none; None if it takes too long."""
    if not sys.executable:
        # A program that holds Python inside cannot be asked to be Python alone.
        return ""
    try:
        trial = subprocess.run(
            [sys.executable, "-c", TRIAL_SCRIPT, name, *sys.path],
            stdin=subprocess.DEVNULL, capture_output=True, timeout=TRIAL_SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None
    except OSError:
        return ""
    if SUCCESS_TEXT.encode() in trial.stdout:
        return ""
    return explain_output(name, trial.stderr.decode(errors="replace"))


def explain_output(name: str, output: str) -> str:
    """Return the advice for the output of a failed trial."""
    for sign, advice in (*ADVICE, *(GLFW_ADVICE if name == "glfw" else QT_ADVICE)):
        if sign in output:
            return advice
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    return f"it ended without a window ({lines[-1][:200]})" if lines else "it ended without a word"


def make_trial_key(name: str) -> str:
    """Return a hash of all that a trial of a toolkit depends on."""
    variables = {
        key: value
        for key, value in os.environ.items()
        if key in WINDOW_VARIABLES or key.startswith(WINDOW_PREFIXES)
    }
    paths = [*DRIVER_PATHS, os.environ.get("XAUTHORITY", ""), *map(str, _list_wayland_addresses())]
    paths += [
        path.lstrip("\0")
        for path in _list_x_addresses()
        if isinstance(path, str) and path[:1] == "/"
    ]
    parts = [
        name, TRIAL_SCRIPT, sys.executable, platform.platform(), platform.node(),
        sorted(variables.items()), [_read_file_state(path) for path in paths],
        [_get_package_version(package) for package in ("rendercanvas", "numpy", *TOOLKITS[name])],
    ]  # fmt: skip
    return hashlib.sha256(json.dumps(parts).encode(errors="surrogateescape")).hexdigest()[:32]


def _read_file_state(path: str) -> list[int]:
    """Return the inode and time of a file or folder; an empty list if there is none."""
    try:
        status = os.stat(path) if path else None
    except (OSError, ValueError):
        status = None
    return [] if status is None else [status.st_ino, status.st_mtime_ns]


def _get_package_version(package: str) -> str:
    """Return the version of a package; PySide6 may be installed in parts."""
    for name in (package, f"{package}_Essentials"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            return metadata.version(name)
    return ""


def get_results_path() -> Path:
    """Return the path of the file of results."""
    return user_cache_folder() / "windows.json"


def _read_results() -> Mapping[str, tuple[str, float]]:
    """Return the results by key: problem and time."""
    now = time.time()
    try:
        content = json.loads(get_results_path().read_text(encoding="utf-8"))
        return {
            str(key): (str(problem), float(tried_at))
            for key, (problem, tried_at) in content.items()
            if now - float(tried_at) <= (FAILURE_AGE_SECONDS if problem else SUCCESS_AGE_SECONDS)
        }
    except (OSError, RuntimeError, ValueError, TypeError, AttributeError):
        return {}


def _write_results(results: Mapping[str, tuple[str, float]]) -> None:
    """Write the results, where that is possible."""
    latest = sorted(results.items(), key=lambda item: item[1][1])[-MAX_RESULTS:]
    with contextlib.suppress(OSError, RuntimeError):
        path = get_results_path()
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with atomic_file(path) as temporary:
            temporary.write_text(json.dumps(dict(latest)), encoding="utf-8")
