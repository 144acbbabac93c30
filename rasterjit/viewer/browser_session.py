"""
The session of a web page: its messages go into a viewer, pictures and state come out.

Each page has a viewer and three threads: one handles messages and draws, one refines pictures at
rest, and one encodes a picture while the next is drawn. Moving pictures are sent as JPEG, those at
rest as PNG.
"""

from __future__ import annotations

import math
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rasterjit.inspect.pixel_report import PixelExplanation
from rasterjit.io.images import encode_png
from rasterjit.runtime.heap import give_back_memory
from rasterjit.scene.camera import PerspectiveCamera
from rasterjit.viewer import effect_switches
from rasterjit.viewer.canvas import MAX_FRAME_RATE, Worker
from rasterjit.viewer.controls import Event
from rasterjit.viewer.overlay import as_rows, pick_colors
from rasterjit.viewer.protocol import (
    MAX_LISTED,
    SHOWN,
    ShortView,
    encode_jpeg,
    format_camera_code,
)
from rasterjit.viewer.viewer import KIND_KEYS, KIND_NAMES, Viewer

MAX_IN_FLIGHT = 3
"""Most pictures drawn but not shown yet: one is encoded, one transmitted, one decoded."""

SETTLE_SECONDS = 0.05
"""Time after the last change from which on pictures are sent losslessly: sooner, a better one
follows."""

SLOW_SECONDS = 1.0 / 40.0
"""Time between pictures above which a page is slow, if the next picture waited for it."""

MAX_SLOW_FRAMES = 4
"""Slow pictures before a page gets smaller ones; a fast picture cancels a slow one."""

HALF_SIZE_SECONDS = 10.0
"""Time for which a slow page gets pictures of half the size."""

STATE_INTERVAL_SECONDS = 0.1
"""Seconds between state messages while something moves."""

LIVE_INTERVAL_SECONDS = 1.0 / 30.0
"""Seconds between checks of a viewer that may change by itself."""

MAX_QUEUED = 1000
"""Most messages queued while a picture is drawn: the latest. No user makes so many."""

MERGEABLE = {
    "pointer_move": ("buttons", "modifiers"),
    "wheel": ("x", "y", "modifiers"),
    "resize": (),
    "view": (),
    "look": (),
    "visibility": (),
}
"""Messages that merge with the one before if these fields are equal, by type."""

Send = Callable[[dict[str, Any] | bytes], None]
"""Function that sends a message, or a picture: its big-endian number and a file."""

PICTURE_NUMBER_BYTES = 4
"""Bytes of a picture's number."""


class BrowserSession:
    """
    Shows a viewer in a web page.

    Parameters
    ----------
    viewer : Viewer
        For this page alone; closed with it.
    compiled : Future
        Done when kernels are compiled: nothing is drawn before.
    send : callable
        Called in other threads.

    Attributes
    ----------
    sent : int
        Number of pictures sent so far.
    """

    def __init__(self, viewer: Viewer, compiled: Future[Any], send: Send) -> None:
        # The page enlarges small pictures itself: they are encoded and decoded faster.
        viewer.writes_text = viewer.enlarges = False
        self.sent = 0
        self._viewer, self._compiled, self._send = viewer, compiled, send
        self._condition = threading.Condition()
        self._is_closed = False
        self._messages: deque[Event] = deque(maxlen=MAX_QUEUED)
        self._last_shown = 0
        self._has_size = False
        self._refiner, self._encoder = Worker(low_priority=True), Worker()
        self._step: Future[bool] | None = None
        now = time.perf_counter()
        self._time = self._due = self._changed_at = self._sent_at = now
        self._version = viewer.version
        self._stamp: tuple[Any, ...] | None = None
        # The last picture that was sent as PNG, and whether the last one was a JPEG.
        self._lossless: NDArray[np.uint8] | None = None
        self._is_lossy = False
        # When the last one was drawn, whether the next one waited for the page, and how often.
        self._drawn_at, self._has_waited, self._slow_frames = now, False, 0
        self._half_size_until = now
        self._state: dict[str, Any] = {}
        self._isolated: int | None = None
        self._explanation: PixelExplanation | None = None
        self._pick: dict[str, Any] | None = None
        self._picks = 0
        self._effects_of: tuple[Any, list[dict[str, Any]]] = None, []
        send(make_welcome_message(viewer))
        # The future outlives the pages: it must not keep this session alive.
        weak_wake = weakref.WeakMethod(self._wake)
        compiled.add_done_callback(lambda _: (wake := weak_wake()) and wake())
        self._thread = threading.Thread(target=self._run, name="rasterjit-page", daemon=True)
        self._thread.start()

    def queue_message(self, message: dict[str, Any]) -> None:
        """Queue a message of the page."""
        with self._condition:
            if message["type"] == SHOWN:
                self._last_shown = max(self._last_shown, message["number"])
            else:
                fields = {name: value for name, value in message.items() if name != "type"}
                add_event(self._messages, {"event_type": message["type"], **fields})
            self._condition.notify()

    def close(self) -> None:
        """Close the session and stop drawing."""
        with self._condition:
            self._is_closed = True
            self._condition.notify()

    def _wake(self) -> None:
        with self._condition:
            self._condition.notify()

    def _run(self) -> None:
        """Handle messages, draw and send until the page is gone."""
        while self._wait_for_work():
            for act in (self._update, self._send_state):
                try:
                    act()
                except Exception as error:
                    # Show the error, and do not try again before something changes.
                    self._viewer.fail(error)
                    self._stamp, self._is_lossy = self._viewer.stamp, False
        self._release()

    def _release(self) -> None:
        """Release the viewer and the threads once nothing is drawn any more."""
        self._viewer.close()
        self._refiner.close()
        self._encoder.close()
        if self._step is not None and not self._step.cancel():
            wait([self._step])
        # Break the reference cycle.
        self._step = self._lossless = None
        give_back_memory()

    def _wait_for_work(self) -> bool:
        """Wait until there is something to do; False when the page is gone."""
        with self._condition:
            while not self._is_closed:
                delay = self._compute_delay()
                if delay is not None and delay <= 0.0:
                    return True
                self._condition.wait(delay)
        return False

    def _compute_delay(self) -> float | None:
        """Return the seconds until there is something to do; None until woken."""
        viewer = self._viewer
        if not self._compiled.done():
            return None
        if self._messages or (self._step is not None and self._step.done()):
            return 0.0
        if not self._can_draw:
            self._has_waited = viewer.is_moving
            return None
        if self._can_refine:
            return 0.0
        now = time.perf_counter()
        if viewer.is_moving or viewer.stamp != self._stamp:
            return self._due - now
        delays = []
        if self._is_lossy or self._has_unsent_state:
            delays.append(self._changed_at + SETTLE_SECONDS - now)
        if viewer.is_live:
            delays.append(self._time + LIVE_INTERVAL_SECONDS - now)
        return min(delays, default=None)

    @property
    def _can_draw(self) -> bool:
        """Whether the page has a size, and few enough pictures are in flight."""
        return self._has_size and self.sent - self._last_shown < MAX_IN_FLIGHT

    @property
    def _can_refine(self) -> bool:
        """Whether a refinement step may start: the picture at rest is drawn and not final."""
        viewer = self._viewer
        is_idle = self._step is None and viewer.stamp == self._stamp
        return is_idle and not viewer.is_moving and not viewer.is_done

    @property
    def _has_unsent_state(self) -> bool:
        """Whether the state has changed since it was sent."""
        return self._sent_at < self._changed_at

    def _update(self) -> None:
        """Handle messages, and draw the picture that is due."""
        viewer = self._viewer
        with self._condition:
            messages, self._messages = self._messages, deque(maxlen=MAX_QUEUED)
        self._advance_clock()
        for message in messages:
            self._apply(message)
        self._finish_step()
        now = time.perf_counter()
        if viewer.is_moving or viewer.version != self._version:
            self._changed_at, self._version = now, viewer.version
        is_settled = not viewer.is_moving and now - self._changed_at >= SETTLE_SECONDS
        is_new = viewer.stamp != self._stamp and now >= self._due
        if self._can_draw and (is_new or (self._is_lossy and is_settled)):
            self._due = now + 1.0 / MAX_FRAME_RATE
            self._draw(is_settled)
        if self._can_refine:
            self._step = self._refiner.submit(viewer.step)
            self._step.add_done_callback(lambda _: self._wake())

    def _advance_clock(self) -> None:
        """Advance the viewer by the time since the last call."""
        now = time.perf_counter()
        self._viewer.advance(now - self._time)
        self._time = now

    def _finish_step(self) -> None:
        """Handle the result of a finished step."""
        if self._step is not None and self._step.done():
            error = self._step.exception()
            self._step = None
            if isinstance(error, Exception):
                self._viewer.fail(error)

    def _draw(self, is_exact: bool) -> None:
        """Draw a picture; encode and send it in another thread."""
        stamp = self._viewer.stamp
        self._adapt_resolution()
        picture = self._viewer.draw()
        self._stamp = stamp
        if is_exact and self._lossless is not None and np.array_equal(picture, self._lossless):
            return
        self._lossless, self._is_lossy = (picture, False) if is_exact else (None, True)
        self.sent += 1
        number = self.sent

        def encode_and_send() -> None:
            try:
                file = encode_png(picture[:, :, :3]) if is_exact else encode_jpeg(picture)
            except Exception as error:
                # Count it as shown, so that the page does not wait, and show the error.
                self._viewer.fail(error)
                self.queue_message({"type": SHOWN, "number": number})
                return
            self._send(number.to_bytes(PICTURE_NUMBER_BYTES, "big") + file)

        self._encoder.submit(encode_and_send)

    def _adapt_resolution(self) -> None:
        """Choose smaller pictures while something moves, for some time, if the page is slow."""
        now = time.perf_counter()
        is_slow = self._has_waited and now - self._drawn_at > SLOW_SECONDS
        self._slow_frames = max(0, self._slow_frames + (1 if is_slow else -1))
        self._drawn_at, self._has_waited = now, False
        if self._slow_frames >= MAX_SLOW_FRAMES:
            self._slow_frames, self._half_size_until = 0, now + HALF_SIZE_SECONDS
        self._viewer.is_hurried = now < self._half_size_until

    def _apply(self, message: Event) -> None:
        """Apply a message of the page; ignore what is not possible."""
        viewer, kind = self._viewer, message["event_type"]
        if kind == "resize":
            viewer.resize((message["pwidth"], message["pheight"]), message["ratio"])
            self._has_size = True
        elif kind == "pick":
            column, row = (math.floor(message[axis] * viewer.ratio) for axis in ("x", "y"))
            viewer.pick(column, row)
        elif kind == "view":
            try:
                camera = PerspectiveCamera(
                    message["eye"], message["target"], message["up"], message["fov_y"]
                )
            except ValueError:
                return
            viewer.look_from(camera)
        elif kind == "look":
            viewer.set_look(message["kind"], message["switched"], message["modes"])
        elif kind == "visibility":
            count, self._isolated = len(viewer.scene.nodes), message["only"]
            hidden = {number for number in message["hidden"] if number < count}
            if self._isolated is not None and self._isolated < count:
                hidden = set(range(count)) - {self._isolated}
            viewer.set_hidden(hidden)
        else:
            if kind == "key_down" and message["key"] == "Escape":
                self._pick = None
            viewer.handle(message)

    def _send_state(self) -> None:
        """Send the state to the page if it changed."""
        now = time.perf_counter()
        if not self._has_size or (
            self._viewer.is_moving and now - self._sent_at < STATE_INTERVAL_SECONDS
        ):
            return
        self._sent_at = now
        self._update_pick()
        state = self._make_state()
        if state != self._state:
            self._state = state
            self._send(state)

    def _make_state(self) -> dict[str, Any]:
        """Return the state message."""
        viewer = self._viewer
        camera = viewer.camera
        kind, switched, modes = viewer.look
        return {
            "type": "state",
            "line": viewer.line,
            "kind": kind,
            "switched": list(switched),
            "modes": modes,
            "effects": self._list_effects(),
            "hidden": sorted(viewer.hidden)[:MAX_LISTED],
            "only": self._isolated,
            "view": ShortView.of(camera)._asdict(),
            "code": format_camera_code(camera),
            "picked": self._pick,
            "costs": viewer.cost_rows,
            "number": self.sent,
            "is_done": viewer.is_done and viewer.stamp == self._stamp and not self._is_lossy,
        }

    def _list_effects(self) -> list[dict[str, Any]]:
        """Return the effects that can be switched, and whether each is on."""
        viewer = self._viewer
        of, effects = self._effects_of
        if of is not viewer.shown:
            used = effect_switches.find_used_effects(viewer.shown, viewer.camera, viewer.size)
            effects = [
                {
                    "name": name,
                    "is_on": name in used,
                    "is_possible": effect_switches.toggle(viewer.shown, name, used) is not None,
                }
                for name in effect_switches.EFFECT_KEYS.values()
            ]
            self._effects_of = viewer.shown, effects
        return effects

    def _update_pick(self) -> None:
        """Store the explanation of a picked pixel, with the distance to the one before."""
        explanation = self._viewer.explanation
        if explanation is None or explanation is self._explanation:
            return
        self._explanation = explanation
        face, before = explanation.winner, self._pick and self._pick["position"]
        self._picks += 1
        self._pick = {
            "count": self._picks,
            "object": None, "name": "background", "face": None, "position": None,
            "distance": None, "rows": as_rows(explanation),
        }  # fmt: skip
        if face is not None:
            position = face.position
            self._pick |= {
                "object": self._viewer.numbers[face.object_number],
                "name": str(face.object_name),
                "face": face.mesh_face,
                "position": position,
                "distance": None if before is None else math.dist(position, before),
            }


def make_welcome_message(viewer: Viewer) -> dict[str, Any]:
    """Return the first message to a page: names of objects, kinds, effects and keys."""
    nodes = viewer.scene.nodes
    listed = range(min(len(nodes), MAX_LISTED))
    colors = pick_colors(np.arange(len(listed))).tolist()
    return {
        "type": "welcome",
        "title": viewer.name,
        "help": viewer.help_rows,
        "help_key": viewer.help_key,
        "has_usual_keys": viewer.has_usual_keys,
        "kinds": [
            {"kind": kind, "name": KIND_NAMES[kind], "key": key} for key, kind in KIND_KEYS.items()
        ],
        "keys": {name: key for key, name in effect_switches.EFFECT_KEYS.items()},
        "modes": [
            {"key": key, "name": effect.name, "modes": dict(effect.modes)}
            for key, effect in effect_switches.MODAL_EFFECTS.items()
        ],
        "objects": [
            {"number": number, "name": str(nodes[number].name), "color": colors[number]}
            for number in listed
        ],
        "count": len(nodes),
    }


def add_event(waiting: deque[Event], event: Event) -> None:
    """Add an event to the queue, merged with the one before if possible."""
    last = waiting[-1] if waiting else {}
    kind = event["event_type"]
    is_same = kind in MERGEABLE and all(
        last.get(name) == event.get(name) for name in ("event_type", *MERGEABLE[kind])
    )
    if not is_same:
        waiting.append(event)
    elif kind == "wheel":
        turns = {name: last[name] + event[name] for name in ("dx", "dy")}
        waiting[-1] = {**event, **turns}
    else:
        waiting[-1] = event
