"""
Join a viewer to a canvas of ``rendercanvas``: its events go in, pictures come out.

The canvas is a window of GLFW or Qt, a widget of a notebook, or a terminal (`terminal`).
"""

from __future__ import annotations

import importlib.util
import os
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, wait
from queue import SimpleQueue
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.viewer.controls import Event
from rasterjit.viewer.viewer import Viewer

FRAME_RATE = 60.0
"""Most pictures a second."""

PROMPT = 0.1
"""How long a patient connection waits for a picture before it lets the canvas do something else,
seconds."""

MOST_WAITING = 1000
"""Events that are kept while a picture is drawn, the latest; no hand makes as many."""

MERGED = {"pointer_move": ("buttons", "modifiers"), "wheel": ("x", "y", "modifiers")}
"""Events of which several in a row are as good as one, where these fields are the same."""

Result = TypeVar("Result")

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


class DrawCancelled(Exception):  # noqa: N818
    """The picture would be the one that is shown; rendercanvas knows this by its name."""


class Worker:
    """A thread that does one thing after the other; nobody waits for it when the process ends."""

    def __init__(self) -> None:
        self._tasks: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        threading.Thread(
            target=_work, args=(self._tasks,), name="rasterjit-viewer", daemon=True
        ).start()
        self._finish = weakref.finalize(self, self._tasks.put, None)

    def submit(self, task: Callable[[], Result]) -> Future[Result]:
        """Do something after all else."""
        future: Future[Result] = Future()
        self._tasks.put((future, task))
        return future

    def close(self) -> None:
        """Let the thread go when it has done everything."""
        self._finish()


def _work(tasks: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None]) -> None:
    """Do what comes, up to the first None."""
    while (one := tasks.get()) is not None:
        future, task = one
        try:
            future.set_result(task())
        except BaseException as error:
            future.set_exception(error)
        # While it waits, it keeps nothing alive.
        del one, future, task


class Connection:
    """
    What keeps a canvas showing a viewer.

    Pictures while something moves are drawn where the canvas asks for them. What comes at rest runs
    in a thread of its own, so that the canvas answers all the time.

    Parameters
    ----------
    viewer : Viewer
    canvas : rendercanvas.BaseRenderCanvas
        With no context yet; its events and its drawing are the viewer's from now on.
    """

    def __init__(self, viewer: Viewer, canvas: Any) -> None:
        self.viewer = viewer
        self._canvas = canvas
        self._context = canvas.get_bitmap_context()
        self._worker = Worker()
        self._step: Future[bool] | None = None
        self._time = time.perf_counter()
        self._stamp: tuple[Any, ...] | None = None
        self.frames = 0
        canvas.add_event_handler(
            self._handle, "pointer_down", "pointer_move", "pointer_up", "wheel", "key_down",
            "key_up",
        )  # fmt: skip
        canvas.add_event_handler(self._close, "close")
        canvas.request_draw(self._draw)

    def _handle(self, event: Event) -> None:
        """Pass an event on, at the time it comes."""
        self._pass_time()
        self.viewer.handle(event)
        # A page takes the wish for another picture as a reason not to send this one uncompressed.
        if self.viewer.is_moving or self.viewer.stamp != self._stamp:
            self._canvas.request_draw()

    def _pass_time(self) -> None:
        """Let the time since the last call pass in the viewer."""
        now = time.perf_counter()
        self.viewer.advance(now - self._time)
        self._time = now

    def _draw(self) -> None:
        """Show the picture that is due; ask for another call if there is more to come."""
        stamp = self._prepare()
        self._show(self.viewer.draw(), stamp)

    def _prepare(self) -> tuple[Any, ...]:
        """Return the stamp of the picture that is due, or raise where it is the one shown."""
        viewer, canvas = self.viewer, self._canvas
        viewer.resize(canvas.get_physical_size(), canvas.get_pixel_ratio())
        self._pass_time()
        self._work()
        if viewer.is_moving or self._step is not None:
            canvas.request_draw()
        # Before the drawing: what the thread changes meanwhile is for the next picture.
        stamp = viewer.stamp
        if stamp == self._stamp:
            raise DrawCancelled
        return stamp

    def _show(self, picture: NDArray[np.uint8], stamp: tuple[Any, ...]) -> None:
        """Show a picture that was drawn from when the viewer had a stamp."""
        self._context.set_bitmap(picture)
        self._stamp = stamp
        if self.viewer.stamp != stamp:
            self._canvas.request_draw()
        self.frames += 1

    def _work(self) -> None:
        """Keep the thread busy with what is to be done at rest."""
        viewer = self.viewer
        if self._step is not None and self._step.done():
            error = self._step.exception()
            self._step = None
            if error is not None:
                viewer.fail(error)
        if self._step is None and not viewer.is_moving and not viewer.is_done:
            self._step = self._worker.submit(viewer.step)

    def _close(self, event: Event) -> None:
        """End what is being rendered."""
        self.viewer.close()
        self._worker.close()


class PatientConnection(Connection):
    """
    A connection that draws in a thread of its own, so that its canvas answers meanwhile.

    The first picture is begun at once. Events wait while one is drawn: a viewer is for one thread.

    Attributes
    ----------
    first : Future
        The first picture.
    """

    def __init__(self, viewer: Viewer, canvas: Any) -> None:
        super().__init__(viewer, canvas)
        self._waiting: deque[Event] = deque(maxlen=MOST_WAITING)
        self._due = viewer.stamp
        self._drawer = Worker()
        self._drawing: Future[NDArray[np.uint8]] | None = self._drawer.submit(viewer.draw)
        self.first = self._drawing

    def _handle(self, event: Event) -> None:
        """Pass an event on, or keep it while a picture is drawn."""
        if self._drawing is None:
            super()._handle(event)
        else:
            add_event(self._waiting, event)

    def _draw(self) -> None:
        """Begin the picture that is due, or show it if it is there soon; else ask to come again."""
        viewer, canvas = self.viewer, self._canvas
        patience = 0.0
        if self._drawing is None:
            self._due = self._prepare()
            self._drawing = self._drawer.submit(viewer.draw)
            patience = PROMPT
        wait([self._drawing], patience)
        if not self._drawing.done():
            canvas.request_draw()
            raise DrawCancelled
        drawn, self._drawing = self._drawing, None
        waiting, self._waiting = self._waiting, deque(maxlen=MOST_WAITING)
        try:
            picture = drawn.result()
            if picture.shape[1::-1] != tuple(canvas.get_physical_size()):
                canvas.request_draw()
                raise DrawCancelled
            self._show(picture, self._due)
        finally:
            for event in waiting:
                self._handle(event)

    def _close(self, event: Event) -> None:
        """End what is being rendered."""
        super()._close(event)
        self._drawer.close()


def add_event(waiting: deque[Event], event: Event) -> None:
    """Add an event to those that wait; moves and turns of the wheel in a row become one."""
    last = waiting[-1] if waiting else {}
    kind = event.get("event_type")
    same = MERGED.get(kind, ())
    if not same or any(last.get(name) != event.get(name) for name in ("event_type", *same)):
        waiting.append(event)
    elif kind == "wheel":
        turned = {name: last.get(name, 0.0) + event.get(name, 0.0) for name in ("dx", "dy")}
        waiting[-1] = {**event, **turned}
    else:
        waiting[-1] = event


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


def in_notebook() -> bool:
    """Tell whether this process is the kernel of a notebook."""
    shell = sys.modules.get("IPython")
    running = shell.get_ipython() if shell is not None else None
    return running is not None and getattr(running, "kernel", None) is not None


def widget(viewer: Viewer) -> Any:
    """
    Return a widget that shows a viewer: the last line of a cell displays it.

    Raises
    ------
    ImportError
        If what it needs is not installed, naming what to install.
    """
    try:
        from rendercanvas.anywidget import RenderCanvas
    except ImportError as error:
        raise ImportError(
            f'a widget needs packages: pip install "rasterjit[notebook]" ({error})'
        ) from error
    # What has to be compiled is compiled before a widget stands there, not answering.
    viewer.draw()
    canvas = RenderCanvas(size=viewer.size, max_fps=FRAME_RATE)
    Connection(viewer, canvas)
    return canvas
