"""
Show a mesh as a viewer does, for ``benchmarks.viewing``: ``viewing_worker.py PATH SCENE W H``.

With ``page`` it serves the page and prints its address. With ``widget`` it is a notebook's front
end to a widget: it sends the events that a hand would cause, by the messages that a notebook sends,
decodes what comes, and prints the times as JSON. It runs with the sources of any commit.
"""

from __future__ import annotations

import asyncio
import base64
import io
import json
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from PIL import Image

import rasterjit as rj

ROUNDS, DRAG_SECONDS, EVENTS_A_SECOND, PAUSE, WAIT = 30, 4.0, 60.0, (0.3, 0.6), 3.5


def main() -> None:
    path, scene, width, height = sys.argv[1:]
    what, size = rj.load(scene), (int(width), int(height))
    if path == "page":
        rj.show(what, backend="browser", size=size, port=0)
        return
    print(json.dumps(asyncio.run(hold(what, size))), flush=True)


async def hold(what: Any, size: tuple[int, int]) -> dict[str, Any]:
    """Be the front end of a widget, and return what was seen and when."""
    front = FrontEnd()
    widget = front.show(what, size)
    width, height = size
    front.tell({"_has_visible_views": True})
    told = {"width": width, "height": height, "pwidth": width, "pheight": height, "ratio": 1.0}
    front.send(widget, {"type": "resize", **told, "timestamp": 0})
    for kind in ("key_down", "key_up"):
        front.send(widget, {"type": kind, "key": "i", "modifiers": [], "timestamp": 0})
    await asyncio.sleep(WAIT)
    random = np.random.default_rng(1)
    latencies = []
    for number in range(ROUNDS):
        await asyncio.sleep(random.uniform(*PAUSE))
        start, count = time.perf_counter(), len(front.seen)
        front.send(widget, {
            "type": "wheel", "x": width / 2, "y": height / 2, "dx": 0.0,
            "dy": -20.0 if number % 2 else 20.0, "buttons": [], "modifiers": [], "timestamp": 0,
        })  # fmt: skip
        while len(front.seen) == count and time.perf_counter() < start + WAIT:
            await asyncio.sleep(0.0005)
        latencies.append(time.perf_counter() - start)
    await asyncio.sleep(WAIT)
    frames, last = await drag(front, widget, size)
    await asyncio.sleep(WAIT)
    after = [(when - last, data) for when, data in front.seen if when > last]
    return {
        "frames": frames, "latencies": latencies,
        "after": [(when, base64.b64encode(data).decode()) for when, data in after],
    }  # fmt: skip


async def drag(front: FrontEnd, widget: Any, size: tuple[int, int]) -> tuple[float, float]:
    """Drag, and return the frames a second, and when the last event was."""
    width, height = size

    def send(kind: str, x: float, y: float) -> None:
        front.send(widget, {
            "type": f"pointer_{kind}", "x": x, "y": y, "button": 1,
            "buttons": [1] if kind != "up" else [], "modifiers": [], "ntouches": 0, "touches": {},
            "timestamp": 0,
        })  # fmt: skip

    send("down", 0.3 * width, 0.4 * height)
    start, count, number = time.perf_counter(), len(front.seen), 0
    while (now := time.perf_counter()) < start + DRAG_SECONDS:
        share = (now - start) / DRAG_SECONDS
        send("move", (0.3 + 0.4 * share) * width, (0.4 + 0.1 * share) * height)
        number += 1
        await asyncio.sleep(max(0.0, start + number / EVENTS_A_SECOND - time.perf_counter()))
    frames = (len(front.seen) - count) / (time.perf_counter() - start)
    send("up", 0.7 * width, 0.5 * height)
    return frames, time.perf_counter()


class FrontEnd:
    """What a notebook is to a widget: takes its messages, and shows pictures in a thread."""

    def __init__(self) -> None:
        self.seen: list[tuple[float, bytes]] = []
        self.decoder = ThreadPoolExecutor(1)
        self._comms: list[Any] = []

    def show(self, what: Any, size: tuple[int, int]) -> Any:
        """Return the widget of a viewer, with its messages coming here."""
        import comm
        from comm.base_comm import BaseComm

        front = self

        class Comm(BaseComm):
            def publish_msg(
                self, msg_type: str, data: Any = None, metadata: Any = None, buffers: Any = None,
                **keys: Any,
            ) -> None:  # fmt: skip
                content = (data or {}).get("content") or {}
                if content.get("type") == "framebufferdata":
                    asyncio.get_running_loop().run_in_executor(
                        front.decoder, front.take, content, bytes(buffers[0])
                    ).add_done_callback(front.confirm)

        comm.create_comm = lambda *arguments, **keys: self._kept(Comm(*arguments, **keys))
        return rj.show(what, backend="notebook", size=size)

    def take(self, content: dict[str, Any], data: bytes) -> dict[str, Any]:
        """Decode a picture, as the page of a notebook does."""
        Image.open(io.BytesIO(data)).load()
        self.seen.append((time.perf_counter(), data))
        return content

    def confirm(self, taken: asyncio.Future[dict[str, Any]]) -> None:
        """Tell the widget that a picture is shown."""
        content = taken.result()
        feedback = {"index": content["index"], "timestamp": content.get("timestamp", 0.0)}
        self.tell({"_frame_feedback": {**feedback, "localtime": time.time()}})

    def tell(self, state: dict[str, Any]) -> None:
        """Change traits of the widget as its page would."""
        for one in self._comms:
            one.handle_msg(
                {"content": {"data": {"method": "update", "state": state}}, "buffers": []}
            )

    def send(self, widget: Any, event: dict[str, Any]) -> None:
        """Send an event."""
        for one in self._comms:
            one.handle_msg(
                {"content": {"data": {"method": "custom", "content": event}}, "buffers": []}
            )

    def _kept(self, one: Any) -> Any:
        self._comms.append(one)
        return one


if __name__ == "__main__":
    main()
