"""Join a viewer to a canvas of ``rendercanvas``: its events go in, pictures come out."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from rasterjit.controls import Event
from rasterjit.viewer import Viewer

FRAME_RATE = 60.0
"""Most pictures a second."""


class DrawCancelled(Exception):  # noqa: N818
    """The picture would be the one that is shown; rendercanvas knows this by its name."""


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
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="rasterjit-viewer")
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
        self._context.set_bitmap(viewer.draw())
        self._stamp = stamp
        if viewer.stamp != stamp:
            canvas.request_draw()
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
        self._worker.shutdown(wait=False, cancel_futures=True)
