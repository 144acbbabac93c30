"""The widget of notebooks: a canvas of rendercanvas that keeps its last view in the notebook."""

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

from rasterjit.viewer.canvas import FRAME_RATE, CanvasDriver
from rasterjit.viewer.protocol import QUALITY
from rasterjit.viewer.saved_view import Saved
from rasterjit.viewer.viewer import Viewer

NO_FRONT_END = (
    "Where this text stands in a running notebook, the view does not turn: run "
    '"pip install ipywidgets anywidget" in the environment of the Jupyter server, then reload the '
    "page."
)

REST = 0.7
"""A view that stays so long is the last one, for the time being; seconds."""

_HERE = Path(__file__).parent


class ViewWidget(RenderCanvas):
    """
    Shows a viewer in a notebook, and leaves a picture of its last view there.

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
        + (_HERE / "widget.js").read_text(encoding="utf-8")
    )  # fmt: skip
    _css = RenderCanvas._css + (_HERE / "widget.css").read_text(encoding="utf-8")

    _name = Unicode("").tag(sync=True)
    _alt = Unicode("").tag(sync=True)

    def __init__(self, viewer: Viewer) -> None:
        self._viewer, self._saved = viewer, Saved(viewer)
        self._cells = _running_loop()
        super().__init__(size=viewer.size, max_fps=FRAME_RATE)
        # With less, the first picture at rest is not sharp: the lossless one comes much later.
        self._quality = QUALITY
        self._name, self._alt = self._saved.name, self._saved.description
        self._connection = CanvasDriver(viewer, self)
        self._kept: tuple[Any, ...] = ()
        self._keeper: asyncio.Task[None] | None = None
        self.on_msg(self._take)

    def _soon(self, function: Callable[..., object], *arguments: Any) -> None:
        """Call a function in the thread of the cells, when no cell runs; at once without any."""
        if self._cells is None:
            self._cells = _running_loop()
        if self._cells is None:
            function(*arguments)
        elif not self._cells.is_closed():
            self._cells.call_soon_threadsafe(function, *arguments)

    def _rfb_handle_msg(self, widget: Any, content: dict[str, Any], buffers: Any) -> None:
        """Take a message of the front end."""
        self._soon(self._hear, widget, content, buffers)

    def _hear(self, *message: Any) -> None:
        """Take a message of the front end, and what it asks for at once, not when it is drawn."""
        super()._rfb_handle_msg(*message)
        if not self.get_closed():
            self._process_events()

    def _rfb_schedule_maybe_draw(self, *changes: Any) -> None:
        """Draw soon, if it is time to; nothing is drawn before there is a loop."""
        if self._cells is not None or _running_loop() is not None:
            self._soon(self._rfb_maybe_draw)

    def _take(self, widget: Any, content: dict[str, Any], buffers: Any) -> None:
        """Take a message of the front end that rendercanvas does not know."""
        self._soon(self._answer, content)

    def _answer(self, content: dict[str, Any]) -> None:
        """Answer the front end, which asks whether somebody is there, or for a lost picture."""
        kind = content.get("type")
        if kind == "rasterjit-ask":
            self.send({"type": "rasterjit-answer", "number": content.get("number")})
        elif kind == "rasterjit-again":
            now = time.time()
            shown = {"index": self._rfb_frame_index, "timestamp": now, "localtime": now}
            self._frame_feedback = shown
            self._connection.show_again()

    def _ipython_display_(self) -> None:
        """Show the picture that is kept, the widget in its place, and the camera."""
        bundle, metadata = self._repr_mimebundle_()
        self._saved.show({**bundle, "text/plain": NO_FRONT_END}, metadata)
        self._kept = self._viewer.stamp
        if self._keeper is None and self._cells is not None:
            self._keeper = self._cells.create_task(_keep(weakref.ref(self)))

    def _rest(self, before: tuple[Any, ...]) -> tuple[Any, ...]:
        """Keep the view if it is that of some time before; return its stamp."""
        viewer, now = self._viewer, self._viewer.stamp
        if now == before and now != self._kept and not viewer.is_moving:
            self._saved.update()
            self._kept = now
        return now


def _running_loop() -> asyncio.AbstractEventLoop | None:
    """Return the loop that runs in this thread, if any."""
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None


async def _keep(reference: weakref.ref[ViewWidget]) -> None:
    """Keep the views of a widget that come to rest, as long as it is there."""
    stamp: tuple[Any, ...] = ()
    while True:
        await asyncio.sleep(REST)
        widget = reference()
        if widget is None or widget.get_closed():
            return
        stamp = widget._rest(stamp)
        del widget
