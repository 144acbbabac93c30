"""The viewer in a window: of GLFW, or of Qt."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from typing import Any

from rasterjit.viewer import Viewer
from rasterjit.viewer_canvas import FRAME_RATE, Connection

TOOLKITS = {
    "glfw": ("glfw", "wgpu"),
    **{name: (name,) for name in ("PySide6", "PyQt6", "PySide2", "PyQt5")},
}
"""Packages that open windows, the preferred first, and what each one needs. Pictures come into a
window of GLFW by wgpu, which needs a driver for the GPU, or for the CPU in its place; Qt needs none
but, where it misses a library of the system, ends the process."""

NO_TOOLKIT = (
    'a window needs a toolkit: pip install "rasterjit[viewer]" for GLFW, or '
    '"rasterjit[viewer-qt]" for Qt'
)


def toolkits() -> list[str]:
    """Return the packages that are installed of those that open windows, the preferred first."""
    # One that runs already has the event loop.
    names = sorted(TOOLKITS, key=lambda name: name not in sys.modules)
    return [
        name
        for name in names
        if all(importlib.util.find_spec(needed) is not None for needed in TOOLKITS[name])
    ]


def has_display() -> bool:
    """Tell whether there is a screen for windows."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_window(viewer: Viewer, title: str) -> None:
    """
    Show a viewer in a window until that is closed.

    Raises
    ------
    ImportError
        If no toolkit is installed, naming what to install.
    ValueError
        If there is no display.
    """
    canvas, loop = window(viewer, title)
    loop.run()
    if not canvas.get_closed():
        canvas.close()


def window(viewer: Viewer, title: str) -> tuple[Any, Any]:
    """Return a canvas in a new window that shows a viewer, and the loop that it needs."""
    found = toolkits()
    if not found:
        raise ImportError(NO_TOOLKIT)
    if not has_display():
        raise ValueError(
            "backend must be one that needs no display here (browser, terminal or notebook), got "
            "'window': neither DISPLAY nor WAYLAND_DISPLAY is set"
        )
    # What has to be compiled is compiled before a window stands there, not answering.
    viewer.draw()
    problems = []
    for name in found:
        canvas = None
        try:
            backend = importlib.import_module(f"rendercanvas.{name.lower()}")
            canvas = backend.RenderCanvas(size=viewer.size, title=title, max_fps=FRAME_RATE)
            Connection(viewer, canvas)
        except Exception as error:
            if canvas is not None:
                canvas.close()
            problems.append(f"{name}: {type(error).__name__}: {error}")
        else:
            return canvas, backend.loop
    raise ValueError(
        "backend must be one that works here (browser, terminal or notebook), got 'window': "
        + "; ".join(problems)
    )
