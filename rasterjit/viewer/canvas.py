"""
Join a viewer to a canvas of ``rendercanvas``: its events go in, pictures come out.

The canvas is a window of GLFW or Qt, a widget of a notebook, or a terminal (`terminal`).
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
import threading
import time
import weakref
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rasterjit.runtime.progress import is_terminal
from rasterjit.viewer.controls import Event
from rasterjit.viewer.viewer import Viewer
from rasterjit.viewer.window_probe import choose_toolkit

MAX_FRAME_RATE = 60.0
"""Most pictures a second."""

ADDED_NICENESS = 10
"""Added niceness of a low-priority thread: it gets a tenth of a processor that another one
wants."""

Result = TypeVar("Result")


class DrawCancelled(Exception):  # noqa: N818
    """Raised to skip a draw that would change nothing; rendercanvas knows it by its name."""


class Worker:
    """
    A daemon thread that runs tasks in order.

    Parameters
    ----------
    low_priority : bool
        Whether it, and the threads that it begins, leave the processors to others that want them,
        where the system has that for threads.
    """

    def __init__(self, *, low_priority: bool = False) -> None:
        self._tasks: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        if low_priority:
            self.submit(lower_priority)
        threading.Thread(
            target=_run_tasks, args=(self._tasks,), name="rasterjit-viewer", daemon=True
        ).start()
        self._finish = weakref.finalize(self, self._tasks.put, None)

    def submit(self, task: Callable[[], Result]) -> Future[Result]:
        """Queue a task; return its future."""
        future: Future[Result] = Future()
        self._tasks.put((future, task))
        return future

    def close(self) -> None:
        """End the thread when all tasks are done."""
        self._finish()


def _run_tasks(tasks: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None]) -> None:
    """Run tasks up to the first None."""
    while (one := tasks.get()) is not None:
        future, task = one
        if future.set_running_or_notify_cancel():
            try:
                future.set_result(task())
            except BaseException as error:
                future.set_exception(error)
        # While it waits, it keeps nothing alive.
        del one, future, task


def lower_priority() -> None:
    """Lower the priority of this thread and of those that it starts."""
    if sys.platform == "linux":
        # Here, and in no other system, a thread has a niceness of its own.
        thread = threading.get_native_id()
        with suppress(OSError):
            before = os.getpriority(os.PRIO_PROCESS, thread)
            os.setpriority(os.PRIO_PROCESS, thread, before + ADDED_NICENESS)


class CanvasDriver:
    """
    Drives a canvas from a viewer: events in, pictures out.

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
        self._worker = Worker(low_priority=True)
        self._refinement: Future[bool] | None = None
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
        """Pass an event to the viewer, at the time it comes."""
        self._advance_clock()
        self.viewer.handle(event)
        # A widget takes the wish for another picture as a reason not to send this one uncompressed.
        if self.viewer.is_moving or self.viewer.stamp != self._stamp:
            self._canvas.request_draw()

    def _advance_clock(self) -> None:
        """Advance the viewer by the time since the last call."""
        now = time.perf_counter()
        self.viewer.advance(now - self._time)
        self._time = now

    def _draw(self) -> None:
        """Show the picture that is due; ask for another call if there is more to come."""
        stamp = self._prepare()
        self._show(self.viewer.draw(), stamp)

    def _prepare(self) -> tuple[Any, ...]:
        """Return the stamp of the picture that is due; raise `DrawCancelled` if it is shown."""
        viewer, canvas = self.viewer, self._canvas
        viewer.resize(canvas.get_physical_size(), canvas.get_pixel_ratio())
        self._advance_clock()
        self._schedule_refinement()
        if viewer.is_moving or viewer.is_live:
            canvas.request_draw()
        # Before the drawing: what the thread changes meanwhile is for the next picture.
        stamp = viewer.stamp
        if stamp == self._stamp:
            raise DrawCancelled
        return stamp

    def _show(self, picture: NDArray[np.uint8], stamp: tuple[Any, ...]) -> None:
        """Show a picture that was drawn at a stamp of the viewer."""
        self._context.set_bitmap(picture)
        self._stamp = stamp
        if self.viewer.stamp != stamp:
            self._canvas.request_draw()
        self.frames += 1

    def _schedule_refinement(self) -> None:
        """Let the thread refine the picture while nothing moves."""
        viewer = self.viewer
        if self._refinement is not None and self._refinement.done():
            error = self._refinement.exception()
            self._refinement = None
            if error is not None:
                viewer.fail(error)
        if self._refinement is None and not viewer.is_moving and not viewer.is_done:
            self._refinement = self._worker.submit(self._refine)
            # To ask before there is anything new is no way to wait: rendercanvas lets events wait
            # for a tenth of a second after a draw that shows nothing.
            self._refinement.add_done_callback(lambda _: self._canvas.request_draw())

    def _refine(self) -> bool:
        """Refine the picture until there is something new to see."""
        stamp = self.viewer.stamp
        while self.viewer.step():
            if self.viewer.stamp != stamp:
                return True
        return False

    def invalidate(self) -> None:
        """Show the picture once more, though it was shown: the canvas has lost it."""
        self._stamp = None
        self._canvas.request_draw()

    def _close(self, event: Event) -> None:
        """End what is being rendered."""
        self.viewer.close()
        self._worker.close()


def open_window(viewer: Viewer, title: str) -> None:
    """
    Show a viewer in a window until that is closed.

    Raises
    ------
    ImportError
        If no toolkit is installed, naming what to install.
    ValueError
        If there is no display, or no toolkit opens a window on it, with what each one needs.
    """
    canvas, loop = make_window(viewer, title)
    loop.run()
    if not canvas.get_closed():
        canvas.close()


def make_window(viewer: Viewer, title: str) -> tuple[Any, Any]:
    """Return a canvas in a new window that shows a viewer, and the loop that it needs."""
    toolkit = choose_toolkit()
    # What has to be compiled is compiled before a window stands there, not answering.
    viewer.draw()
    backend = importlib.import_module(f"rendercanvas.{toolkit.lower()}")
    canvas = backend.RenderCanvas(size=viewer.size, title=title, max_fps=MAX_FRAME_RATE)
    CanvasDriver(viewer, canvas)
    return canvas, backend.loop


def is_at_terminal() -> bool:
    """Tell whether standard input and output are a terminal."""
    return all(is_terminal(stream) for stream in (sys.__stdin__, sys.__stdout__))


def has_terminal() -> bool:
    """Tell whether there is a terminal, and the package that shows pictures in it."""
    return is_at_terminal() and importlib.util.find_spec("blessed") is not None
