"""
A page that looks: what it says goes into a viewer of its own, pictures come out.

A thread for each page takes in what the page said and draws; a second one makes pictures better
at rest, a third one codes what was drawn while the next is drawn. While something moves, pictures
are sent as JPEG; at rest, as they are.
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
from rasterjit.viewer.canvas import FRAME_RATE, Worker
from rasterjit.viewer.controls import Event
from rasterjit.viewer.overlay import colors_of, rows_of
from rasterjit.viewer.protocol import (
    MAX_LISTED,
    SHOWN,
    ShortView,
    camera_code,
    encode_jpeg,
)
from rasterjit.viewer.viewer import KINDS, NAMES, Viewer

MAX_ON_WAY = 3
"""Pictures that were drawn and not shown yet: one is coded, one on its way, one decoded."""

SETTLED = 0.05
"""Time after the last change from which on pictures are sent as they are, seconds: sooner, a better
one follows."""

SLOW = 1.0 / 40.0
"""Time from a picture to the next from which on a page is slow, if that waited for it, seconds."""

MAX_SLOW = 4
"""Pictures that a page is slow with before it gets smaller ones; one in time makes up for one."""

SMALL_FOR = 10.0
"""Time for which it gets these before it is tried with larger ones again, seconds."""

TOLD_EVERY = 0.1
"""Time between what is said of pictures while something moves, seconds."""

LIVE_EVERY = 1.0 / 30.0
"""Time between looks at what may change by itself, seconds."""

MAX_WAITING = 1000
"""Messages that are kept while a picture is drawn, the latest; no hand makes as many."""

MERGED = {
    "pointer_move": ("buttons", "modifiers"),
    "wheel": ("x", "y", "modifiers"),
    "resize": (),
    "view": (),
    "look": (),
    "visibility": (),
}
"""Messages of which several in a row are as good as one, where these fields are the same."""

Tell = Callable[[dict[str, Any] | bytes], None]
"""Takes what a page is told, or a picture: its number, big end first, and a file."""

NUMBER_BYTES = 4
"""Of a picture's number."""


class Tab:
    """
    Shows a viewer to a page.

    Parameters
    ----------
    viewer : Viewer
        For this page alone; closed with it.
    first : Future
        Done when kernels are compiled: nothing is drawn before.
    tell : callable
        Is called in other threads.

    Attributes
    ----------
    sent : int
        Pictures so far.
    """

    def __init__(self, viewer: Viewer, first: Future[Any], tell: Tell) -> None:
        # A page enlarges small pictures itself: these are coded and decoded sooner.
        viewer.writes_text = viewer.enlarges = False
        self.sent = 0
        self._viewer, self._first, self._tell = viewer, first, tell
        self._changed = threading.Condition()
        self._is_closed = False
        self._messages: deque[Event] = deque(maxlen=MAX_WAITING)
        self._shown = 0
        self._has_size = False
        self._worker, self._coder = Worker(gives_way=True), Worker()
        self._step: Future[bool] | None = None
        now = time.perf_counter()
        self._time = self._due = self._changed_at = self._told_at = now
        self._version = viewer.version
        self._stamp: tuple[Any, ...] | None = None
        # The last picture that was sent as it is, and whether the last one was not.
        self._exact: NDArray[np.uint8] | None = None
        self._is_rough = False
        # When the last one was drawn, whether the page let the next one wait, and how many waited.
        self._drawn_at, self._has_waited, self._slow = now, False, 0
        self._small_until = now
        self._state: dict[str, Any] = {}
        self._only: int | None = None
        self._explained: PixelExplanation | None = None
        self._picked: dict[str, Any] | None = None
        self._picks = 0
        self._effects_of: tuple[Any, list[dict[str, Any]]] = None, []
        tell(welcome(viewer))
        # It stays, with all that it calls, longer than any page.
        wake = weakref.WeakMethod(self._wake)
        first.add_done_callback(lambda _: (found := wake()) and found())
        self._thread = threading.Thread(target=self._run, name="rasterjit-page", daemon=True)
        self._thread.start()

    def take(self, message: dict[str, Any]) -> None:
        """Take in what the page said: a message of the list."""
        with self._changed:
            if message["type"] == SHOWN:
                self._shown = max(self._shown, message["number"])
            else:
                rest = {name: value for name, value in message.items() if name != "type"}
                add_event(self._messages, {"event_type": message["type"], **rest})
            self._changed.notify()

    def close(self) -> None:
        """End what is being drawn."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify()

    def _run(self) -> None:
        """Take in, draw and tell, until the page is gone."""
        while self._wait():
            for act in (self._go_on, self._tell_state):
                try:
                    act()
                except Exception as error:
                    # What cannot be drawn is said, and not tried again before something changes.
                    self._viewer.fail(error)
                    self._stamp, self._is_rough = self._viewer.stamp, False
        self._end()

    def _end(self) -> None:
        """Let go what the page took, as soon as nothing is drawn for it any more."""
        self._viewer.close()
        self._worker.close()
        self._coder.close()
        if self._step is not None and not self._step.cancel():
            wait([self._step])
        # It knows this page, which knows it.
        self._step = self._exact = None
        give_back_memory()

    def _wait(self) -> bool:
        """Wait until there is something to do; False when the page is gone."""
        with self._changed:
            while not self._is_closed:
                delay = self._delay()
                if delay is not None and delay <= 0.0:
                    return True
                self._changed.wait(delay)
        return False

    def _delay(self) -> float | None:
        """Return how long there is nothing to do, seconds; None until somebody wakes it."""
        viewer = self._viewer
        if not self._first.done():
            return None
        if self._messages or (self._step is not None and self._step.done()):
            return 0.0
        if not self._has_room:
            self._has_waited = viewer.is_moving
            return None
        if self._may_step:
            return 0.0
        now = time.perf_counter()
        if viewer.is_moving or viewer.stamp != self._stamp:
            return self._due - now
        delays = []
        if self._is_rough or self._is_untold:
            delays.append(self._changed_at + SETTLED - now)
        if viewer.is_live:
            delays.append(self._time + LIVE_EVERY - now)
        return min(delays, default=None)

    @property
    def _has_room(self) -> bool:
        """Whether the page has a size, and not too many pictures are on their way."""
        return self._has_size and self.sent - self._shown < MAX_ON_WAY

    @property
    def _may_step(self) -> bool:
        """Whether there is something to do at rest: first comes a picture of what changed."""
        viewer = self._viewer
        is_idle = self._step is None and viewer.stamp == self._stamp
        return is_idle and not viewer.is_moving and not viewer.is_done

    @property
    def _is_untold(self) -> bool:
        """Whether something was not told, since it was to change at once."""
        return self._told_at < self._changed_at

    def _go_on(self) -> None:
        """Take in what was said, and draw what is due."""
        viewer = self._viewer
        with self._changed:
            messages, self._messages = self._messages, deque(maxlen=MAX_WAITING)
        self._pass_time()
        for message in messages:
            self._apply(message)
        self._end_step()
        now = time.perf_counter()
        if viewer.is_moving or viewer.version != self._version:
            self._changed_at, self._version = now, viewer.version
        is_settled = not viewer.is_moving and now - self._changed_at >= SETTLED
        is_new = viewer.stamp != self._stamp and now >= self._due
        if self._has_room and (is_new or (self._is_rough and is_settled)):
            self._due = now + 1.0 / FRAME_RATE
            self._draw(is_settled)
        if self._may_step:
            self._step = self._worker.submit(viewer.step)
            self._step.add_done_callback(lambda _: self._wake())

    def _pass_time(self) -> None:
        """Let the time since the last call pass in the viewer."""
        now = time.perf_counter()
        self._viewer.advance(now - self._time)
        self._time = now

    def _end_step(self) -> None:
        """Take in how a step ended, if one did."""
        if self._step is not None and self._step.done():
            error = self._step.exception()
            self._step = None
            if isinstance(error, Exception):
                self._viewer.fail(error)

    def _draw(self, is_exact: bool) -> None:
        """Draw a picture, and have it coded and sent."""
        stamp = self._viewer.stamp
        self._note_slowness()
        picture = self._viewer.draw()
        self._stamp = stamp
        if is_exact and self._exact is not None and np.array_equal(picture, self._exact):
            return
        self._exact, self._is_rough = (picture, False) if is_exact else (None, True)
        self.sent += 1
        number = self.sent

        def code() -> None:
            try:
                file = encode_png(picture[:, :, :3]) if is_exact else encode_jpeg(picture)
            except Exception as error:
                # The page does not wait for it, and reads why.
                self._viewer.fail(error)
                self.take({"type": SHOWN, "number": number})
                return
            self._tell(number.to_bytes(NUMBER_BYTES, "big") + file)

        self._coder.submit(code)

    def _note_slowness(self) -> None:
        """Have smaller pictures drawn while something moves, for some time, if a page is slow."""
        now = time.perf_counter()
        is_slow = self._has_waited and now - self._drawn_at > SLOW
        self._slow = max(0, self._slow + (1 if is_slow else -1))
        self._drawn_at, self._has_waited = now, False
        if self._slow >= MAX_SLOW:
            self._slow, self._small_until = 0, now + SMALL_FOR
        self._viewer.is_hurried = now < self._small_until

    def _apply(self, message: Event) -> None:
        """Do what a page asks for; what is not possible is passed over."""
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
            count, self._only = len(viewer.scene.nodes), message["only"]
            hidden = {number for number in message["hidden"] if number < count}
            if self._only is not None and self._only < count:
                hidden = set(range(count)) - {self._only}
            viewer.set_hidden(hidden)
        else:
            if kind == "key_down" and message["key"] == "Escape":
                self._picked = None
            viewer.handle(message)

    def _tell_state(self) -> None:
        """Tell the page what it shows, where that is news."""
        now = time.perf_counter()
        if not self._has_size or (self._viewer.is_moving and now - self._told_at < TOLD_EVERY):
            return
        self._told_at = now
        self._note_pick()
        state = self._describe()
        if state != self._state:
            self._state = state
            self._tell(state)

    def _describe(self) -> dict[str, Any]:
        """Return what the page is told of its picture."""
        viewer = self._viewer
        camera = viewer.camera
        kind, switched, modes = viewer.look
        return {
            "type": "state",
            "line": viewer.line,
            "kind": kind,
            "switched": list(switched),
            "modes": modes,
            "effects": self._effects(),
            "hidden": sorted(viewer.hidden)[:MAX_LISTED],
            "only": self._only,
            "view": ShortView.of(camera)._asdict(),
            "code": camera_code(camera),
            "picked": self._picked,
            "costs": viewer.cost_rows,
            "number": self.sent,
            "is_done": viewer.is_done and viewer.stamp == self._stamp and not self._is_rough,
        }

    def _effects(self) -> list[dict[str, Any]]:
        """Return what may be switched, and whether the picture has it."""
        viewer = self._viewer
        of, effects = self._effects_of
        if of is not viewer.shown:
            used = effect_switches.used_effects(viewer.shown, viewer.camera, viewer.size)
            effects = [
                {
                    "name": name,
                    "is_on": name in used,
                    "is_possible": effect_switches.switched(viewer.shown, name, used) is not None,
                }
                for name in effect_switches.KEYS.values()
            ]
            self._effects_of = viewer.shown, effects
        return effects

    def _note_pick(self) -> None:
        """Keep what is known of a pixel that was picked, and how far it is from the one before."""
        told = self._viewer.explanation
        if told is None or told is self._explained:
            return
        self._explained = told
        face, before = told.winner, self._picked and self._picked["position"]
        self._picks += 1
        self._picked = {
            "count": self._picks,
            "object": None, "name": "background", "face": None, "position": None,
            "distance": None, "rows": rows_of(told),
        }  # fmt: skip
        if face is not None:
            place = face.position
            self._picked |= {
                "object": self._viewer.numbers[face.object_number],
                "name": str(face.object_name),
                "face": face.mesh_face,
                "position": place,
                "distance": None if before is None else math.dist(place, before),
            }


def welcome(viewer: Viewer) -> dict[str, Any]:
    """Return what a page is told first: what there is to see, and how."""
    nodes = viewer.scene.nodes
    listed = range(min(len(nodes), MAX_LISTED))
    colors = colors_of(np.arange(len(listed))).tolist()
    return {
        "type": "welcome",
        "title": viewer.name,
        "help": viewer.help_rows,
        "help_key": viewer.help_key,
        "has_usual_keys": viewer.has_usual_keys,
        "kinds": [{"kind": kind, "name": NAMES[kind], "key": key} for key, kind in KINDS.items()],
        "keys": {name: key for key, name in effect_switches.KEYS.items()},
        "modes": [
            {"key": key, "name": effect.name, "modes": dict(effect.modes)}
            for key, effect in effect_switches.MODED.items()
        ],
        "objects": [
            {"number": number, "name": str(nodes[number].name), "color": colors[number]}
            for number in listed
        ],
        "count": len(nodes),
    }


def add_event(waiting: deque[Event], event: Event) -> None:
    """Add an event to those that wait; moves and turns of the wheel in a row become one."""
    last = waiting[-1] if waiting else {}
    kind = event["event_type"]
    is_same = kind in MERGED and all(
        last.get(name) == event.get(name) for name in ("event_type", *MERGED[kind])
    )
    if not is_same:
        waiting.append(event)
    elif kind == "wheel":
        turned = {name: last[name] + event[name] for name in ("dx", "dy")}
        waiting[-1] = {**event, **turned}
    else:
        waiting[-1] = event
