"""The notebook widget: a canvas of rendercanvas that saves its last view in the notebook."""

from __future__ import annotations

import asyncio
import json
import time
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rendercanvas.anywidget import RenderCanvas
from traitlets import Unicode

from rasterjit.viewer.canvas import MAX_FRAME_RATE, CanvasDriver
from rasterjit.viewer.protocol import JPEG_QUALITY
from rasterjit.viewer.saved_view import SavedView
from rasterjit.viewer.viewer import Viewer

MISSING_FRONT_END = (
    "Where this text stands in a running notebook, the view does not turn: run "
    '"pip install ipywidgets anywidget" in the environment of the Jupyter server, then reload the '
    "page."
)

REST_SECONDS = 0.7
"""Seconds without a change after which a view is saved."""

_FOLDER = Path(__file__).parent


class ViewWidget(RenderCanvas):
    """
    Shows a viewer in a notebook, and saves a picture of its last view there.

    Parameters
    ----------
    viewer : Viewer

    Notes
    -----
    JupyterLab has messages to widgets handled in a thread of the kernel that is not the one of its
    cells. Here they wait for that one: a canvas and a viewer are for one thread, and a picture that
    two threads draw at once is lost.
    """

    _esm = (
        f"const BASE = {json.dumps(RenderCanvas._esm)}\n"
        + (_FOLDER / "widget.js").read_text(encoding="utf-8")
    )  # fmt: skip
    _css = RenderCanvas._css + (_FOLDER / "widget.css").read_text(encoding="utf-8")

    _name = Unicode("").tag(sync=True)
    _alt = Unicode("").tag(sync=True)

    def __init__(self, viewer: Viewer) -> None:
        self._viewer, self._saved = viewer, SavedView(viewer)
        self._loop = _get_running_loop()
        super().__init__(size=viewer.size, max_fps=MAX_FRAME_RATE)
        # With less, the first picture at rest is not sharp: the lossless one comes much later.
        self._quality = JPEG_QUALITY
        self._name, self._alt = self._saved.name, self._saved.description
        self._connection = CanvasDriver(viewer, self)
        self._saved_stamp: tuple[Any, ...] = ()
        self._saver: asyncio.Task[None] | None = None
        self.on_msg(self._handle_message)

    def _call_in_loop(self, function: Callable[..., object], *arguments: Any) -> None:
        """Call a function in the event loop of the cells; at once without any."""
        if self._loop is None:
            self._loop = _get_running_loop()
        if self._loop is None:
            function(*arguments)
        elif not self._loop.is_closed():
            self._loop.call_soon_threadsafe(function, *arguments)

    def _rfb_handle_msg(self, widget: Any, content: dict[str, Any], buffers: Any) -> None:
        """Process a message of the front end in the event loop."""
        self._call_in_loop(self._process_message, widget, content, buffers)

    def _process_message(self, *message: Any) -> None:
        """Process a message of the front end, and its events at once."""
        super()._rfb_handle_msg(*message)
        if not self.get_closed():
            self._process_events()

    def _rfb_schedule_maybe_draw(self, *changes: Any) -> None:
        """Schedule a draw, if there is an event loop."""
        if self._loop is not None or _get_running_loop() is not None:
            self._call_in_loop(self._rfb_maybe_draw)

    def _handle_message(self, widget: Any, content: dict[str, Any], buffers: Any) -> None:
        """Handle a message of the front end that rendercanvas does not know."""
        self._call_in_loop(self._answer_message, content)

    def _answer_message(self, content: dict[str, Any]) -> None:
        """Answer the front end: that the kernel runs, or with a lost picture."""
        kind = content.get("type")
        if kind == "rasterjit-ask":
            self.send({"type": "rasterjit-answer", "number": content.get("number")})
        elif kind == "rasterjit-again":
            now = time.time()
            feedback = {"index": self._rfb_frame_index, "timestamp": now, "localtime": now}
            self._frame_feedback = feedback
            self._connection.invalidate()

    def _ipython_display_(self) -> None:
        """Display the saved picture, the widget in its place, and the camera."""
        bundle, metadata = self._repr_mimebundle_()
        self._saved.show({**bundle, "text/plain": MISSING_FRONT_END}, metadata)
        self._saved_stamp = self._viewer.stamp
        if self._saver is None and self._loop is not None:
            self._saver = self._loop.create_task(_save_views(weakref.ref(self)))

    def _save_at_rest(self, before: tuple[Any, ...]) -> tuple[Any, ...]:
        """Save the view if it has not changed since a stamp; return its stamp."""
        viewer, now = self._viewer, self._viewer.stamp
        if now == before and now != self._saved_stamp and not viewer.is_moving:
            self._saved.update()
            self._saved_stamp = now
        return now


def _get_running_loop() -> asyncio.AbstractEventLoop | None:
    """Return the running event loop of this thread, if any."""
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None


async def _save_views(reference: weakref.ref[ViewWidget]) -> None:
    """Save the views of a widget that come to rest, as long as it exists."""
    stamp: tuple[Any, ...] = ()
    while True:
        await asyncio.sleep(REST_SECONDS)
        widget = reference()
        if widget is None or widget.get_closed():
            return
        stamp = widget._save_at_rest(stamp)
        del widget
