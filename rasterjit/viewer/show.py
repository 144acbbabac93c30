"""Show a scene to somebody: in a window, a browser, a notebook or a terminal."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any, Literal, TypeAlias, get_args

from rasterjit.rendering.plan import Cull
from rasterjit.scene.background import Background
from rasterjit.scene.camera import Camera
from rasterjit.scene.validation import one_of
from rasterjit.viewer import browser, canvas, terminal
from rasterjit.viewer.viewer import SMOOTH, Viewer

Backend: TypeAlias = Literal["auto", "window", "browser", "notebook", "terminal"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)


def show(
    what: Any,
    camera: Camera | None = None,
    *,
    backend: Backend = "auto",
    size: tuple[int, int] = (640, 480),
    background: Background = None,
    cull: Cull = "none",
    up: Any = None,
    time_budget: float = SMOOTH,
    title: str = "RasterJIT",
    host: str = browser.DEFAULT_HOST,
    port: int = browser.DEFAULT_PORT,
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
        ``"auto"``: a widget in a notebook; else a window, if there is a display and a toolkit; else
        a page for the browser.
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
        that is free. The address that is printed has a random token, without which nobody comes in.

    Returns
    -------
    widget or None
        In a notebook; the others return when the window is closed or the process interrupted.

    Raises
    ------
    ImportError
        If the backend needs a package, naming what to install.
    ValueError
        Naming the argument that is wrong, before anything is shown.
    """
    chosen = choose_backend(one_of("backend", backend, BACKENDS))
    if chosen != "terminal" and importlib.util.find_spec("rendercanvas") is None:
        extra = "viewer" if chosen == "window" else chosen
        raise ImportError(f'showing needs a canvas: pip install "rasterjit[{extra}]"')
    viewer = Viewer(
        what, camera, size=size, background=background, cull=cull, up=up, time_budget=time_budget,
        name=title, threads=threads,
    )  # fmt: skip
    if chosen == "notebook":
        return canvas.widget(viewer)
    run: dict[str, Callable[[], None]] = {
        "window": lambda: canvas.open_window(viewer, title),
        "browser": lambda: browser.serve(viewer, host, port),
        "terminal": lambda: terminal.run_in_terminal(viewer, title),
    }
    try:
        return run[chosen]()
    finally:
        viewer.close()


def choose_backend(backend: str) -> str:
    """Return a backend, the best there is for ``"auto"``."""
    if backend != "auto":
        return backend
    if canvas.in_notebook():
        return "notebook"
    if canvas.has_display() and canvas.toolkits():
        return "window"
    return "browser"
