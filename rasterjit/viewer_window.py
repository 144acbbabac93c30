"""The viewer in a window: of Qt, where it is installed, else of GLFW."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from typing import Any

from rasterjit.viewer import Viewer
from rasterjit.viewer_canvas import FRAME_RATE, Connection

TOOLKITS = ("PySide6", "PyQt6", "PySide2", "PyQt5", "glfw")
"""Packages that open windows, the preferred first. Qt shows pictures without a GPU's driver."""

NO_TOOLKIT = (
    'a window needs a toolkit: pip install "rasterjit[viewer]" for GLFW, or '
    '"rasterjit[viewer-qt]" for Qt'
)


def toolkit() -> str | None:
    """Return the first package that is installed of those that open windows; None if none is."""
    # One that runs already has the event loop.
    names = sorted(TOOLKITS, key=lambda name: name not in sys.modules)
    return next((name for name in names if importlib.util.find_spec(name) is not None), None)


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
    name = toolkit()
    if name is None:
        raise ImportError(NO_TOOLKIT)
    if not has_display():
        raise ValueError(
            "backend must be one that needs no display here (browser, terminal or notebook), got "
            "'window': neither DISPLAY nor WAYLAND_DISPLAY is set"
        )
    try:
        backend = importlib.import_module(f"rendercanvas.{name.lower()}")
        canvas = backend.RenderCanvas(size=viewer.size, title=title, max_fps=FRAME_RATE)
        Connection(viewer, canvas)
    except ModuleNotFoundError as error:
        raise ImportError(f"{NO_TOOLKIT}: {error}") from error
    return canvas, backend.loop
