"""Show a scene to somebody: in a window, a browser, a notebook or a terminal."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from typing import Any, Literal, TypeAlias, get_args

from rasterjit.rendering.planning import Cull
from rasterjit.runtime import progress
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera
from rasterjit.scene.validation import one_of
from rasterjit.viewer import browser, canvas, notebook, terminal, window_probe
from rasterjit.viewer.viewer import FRAME_BUDGET_SECONDS, Viewer

Backend: TypeAlias = Literal["auto", "window", "browser", "notebook", "terminal"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)

SERVER_PACKAGES = ("uvicorn", "websockets", "simplejpeg")
"""Packages that a page needs."""


def show(
    what: Any,
    camera: Camera | None = None,
    *,
    backend: Backend = "auto",
    size: tuple[int, int] = (640, 480),
    background: Background = None,
    cull: Cull = "none",
    up: Any = None,
    time_budget: float = FRAME_BUDGET_SECONDS,
    title: str = "RasterJIT",
    host: str = browser.DEFAULT_HOST,
    port: int = browser.DEFAULT_PORT,
    token: str | None = None,
    threads: int | None = None,
) -> Any:
    """
    Show a scene to somebody who moves the camera; H tells how.

    While something moves, the quality of the picture follows from the time budget. Until the times
    of the scene are known, and for depth, normals and numbers, it is a draft. When nothing moves,
    the picture becomes that of ``Quality.reference()``. The scene must stay as it is meanwhile.

    Parameters
    ----------
    what, camera, background, cull, threads
        As `rasterjit.render` takes them. The camera is where it starts.
    backend : {"auto", "window", "browser", "notebook", "terminal"}
        ``"auto"``: a widget in a notebook; else a window, if one opens here; else a page for the
        browser; else the terminal. Where there is a display and no window opens, a line on standard
        error says what to install. Whether one opens is tried in a process of its own and
        remembered: a window of a moment, the first time.
    size : (int, int)
        Width and height at first, pixels; pages and terminals have their own.
    up : (3,) array_like, world space, optional
        What stays up when the camera turns. Default: ``Scene.up``, which files of some formats
        give, else y.
    time_budget : float
        Seconds for a picture while something moves: its quality is the best that is drawn in that
        time, or the fastest.
    title : str
        Of the window.
    host, port : str, int
        Where the page is served: by default where only this machine reaches it. Port 0 takes any
        that is free.
    token : str, optional
        Part of the page's address, without which nobody comes in: 16 to 128 letters, digits, ``-``
        and ``_``, hard to guess. Default: a random one. With the same token and port, pages
        that are open find a viewer again that is started anew.

    Returns
    -------
    widget or None
        In a notebook, where the last line of a cell displays it; with ``"auto"`` a picture, if
        packages are missing. The others return when the window is closed or the process is
        interrupted.

    Raises
    ------
    ImportError
        If the backend needs a package, naming what to install.
    ValueError
        Naming the argument that is wrong, before anything is shown; of a backend that does not
        work here, what it needs.
    """
    if token is not None:
        browser.check_token(token)
    chosen = choose_backend(one_of("backend", backend, BACKENDS))
    viewer = Viewer(
        what, camera, size=size, background=background, cull=cull, up=up, time_budget=time_budget,
        name=title, threads=threads,
    )  # fmt: skip
    if chosen == "notebook":
        return notebook.make_widget(viewer, is_needed=backend == "notebook")
    run: dict[str, Callable[[], None]] = {
        "window": lambda: canvas.open_window(viewer, title),
        "browser": lambda: browser.serve(viewer, host, port, token=token),
        "terminal": lambda: terminal.run_in_terminal(viewer, title),
    }
    try:
        return run[chosen]()
    finally:
        viewer.close()


def choose_backend(backend: str) -> str:
    """
    Return a backend: the best that works here for ``"auto"``; a line says what windows need.

    Raises
    ------
    ImportError, ValueError
        If the backend is ``"window"``, or ``"auto"``, and none opens here, saying what it needs.
    """
    if backend == "window":
        window_probe.choose_toolkit()
    if backend != "auto":
        return backend
    if progress.in_notebook():
        return "notebook"
    toolkit, problem = window_probe.find_toolkit()
    if toolkit:
        return "window"
    other = _choose_without_window(problem)
    if window_probe.has_display():
        words = {"browser": "a page", "terminal": "the terminal"}
        print(f"rasterjit: no window opens: {problem}. Showing {words[other]} instead",
              file=sys.stderr)  # fmt: skip
    return other


def _choose_without_window(problem: str) -> str:
    """Return the best backend where no window opens."""
    if all(importlib.util.find_spec(name) is not None for name in SERVER_PACKAGES):
        return "browser"
    if canvas.has_terminal():
        return "terminal"
    raise ImportError(
        'showing needs a page: pip install "rasterjit[browser]"; or a window, but '
        + (problem if problem != window_probe.MISSING_TOOLKIT else
           'no toolkit for one is installed: pip install "rasterjit[viewer]"')
    )  # fmt: skip
