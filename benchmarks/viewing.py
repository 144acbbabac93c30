"""
Measure the viewer in a page and in a notebook: pictures a second, and how long one waits for them.

``python -m benchmarks.viewing [--against COMMIT] [--only page] [--output FILE]``

A real Chromium without a screen opens the page of ``rasterjit view``; a notebook's widget is told
events, and its pictures decoded, by the messages of a notebook (``viewing_worker``). A torus of
70,000 faces at 1280x800 and the teapot at 640x480 are dragged for four seconds; the wheel is turned
by a notch at thirty moments at rest, or while the picture becomes better; and the last drag is
waited for until the picture is sharp: from then on no picture differs by more than `SHARP` from
that at the end. The line at the bottom is hidden. With ``--against`` commits take part beside the
working tree, by turns.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import importlib.util
import io
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmarks.checkouts import WORKING_TREE, checkouts
from benchmarks.meshes import torus
from benchmarks.pairing import ROOT
from benchmarks.report import processors
from benchmarks.viewing_worker import (
    DRAG_SECONDS,
    EVENTS_A_SECOND,
    PAUSE,
    ROUNDS,
    WAIT,
)

SHARP = 1.3
"""Largest root mean square difference of a sharp picture from the last one, 8-bit codes. Of both
scenes, four samples a pixel coded as JPEG differ by 1.2 at most, two by 1.4 at least as they are,
and one by 2.1."""

PATHS = ("page", "widget")

MARKS = {"page": 45.0, "widget": 30.0}
"""Pictures a second that the torus should be shown with, on two quiet cores."""

LATENCY_MARK, SHARP_MARK = 50.0, 300.0
"""Milliseconds from an event to its picture, in the median, and from the last to a sharp one."""

WATCH = """
window.seen = [];
window.events = [];
window.arrived = [];
window.pressed = 0;
const Socket = window.WebSocket;
window.WebSocket = function (...given) {
  const socket = new Socket(...given);
  socket.addEventListener('message', event => {
    if (typeof event.data !== 'string') { window.arrived.push([performance.now(), event.data]); }
  });
  return socket;
};
window.WebSocket.prototype = Socket.prototype;
Object.assign(window.WebSocket, {OPEN: 1, CONNECTING: 0, CLOSING: 2, CLOSED: 3});
const note = () => window.seen.push(performance.now());
document.addEventListener('load', event => {
  if (event.target.tagName === 'IMG') { note(); }
}, true);
for (const [kind, name] of [[CanvasRenderingContext2D, 'drawImage'],
                            [ImageBitmapRenderingContext, 'transferFromImageBitmap']]) {
  const own = kind.prototype[name];
  kind.prototype[name] = function (...given) { note(); return own.apply(this, given); };
}
for (const kind of ['wheel', 'pointermove', 'pointerup']) {
  window.addEventListener(kind, () => window.events.push(performance.now()), true);
}
"""
"""Notes when pictures come and are shown, and when events come, in milliseconds."""

KEPT = """
(async () => {
  const from = window.events[window.events.length - 1];
  const kept = [];
  for (const [when, data] of window.arrived.filter(([when, data]) => when > from)) {
    const bytes = new Uint8Array(data instanceof Blob ? await data.arrayBuffer() : data);
    const shown = window.seen.find(other => other > when);
    let text = '';
    for (let k = 0; k < bytes.length; k += 8192) {
      text += String.fromCharCode(...bytes.subarray(k, k + 8192));
    }
    if (shown) { kept.push([(shown - from) / 1000, btoa(text)]); }
  }
  return kept;
})()
"""
"""Returns the pictures since the last event, and when each was shown, seconds."""

LAST_EVENT = "window.events[window.events.length - 1]"


class Row(NamedTuple):
    """What one revision did on one path with one scene."""

    revision: str
    path: str
    scene: str
    frames: float
    """Pictures a second while dragging."""
    median: float
    """Milliseconds from an event to the next picture; so are those that follow."""
    late: float
    """Of 95 % of the events."""
    sharp: float
    """From the last event to a sharp picture."""


def rows_of(folder: Path, place: Path, revision: str, paths: Sequence[str]) -> Iterator[Row]:
    """Measure a checkout."""
    for scene, file, size in scenes(folder):
        for path in paths:
            measured = page if path == "page" else widget
            found = measured(place, file, size, folder)
            times = sorted(found["latencies"])
            yield Row(
                revision, path, scene, found["frames"], 1e3 * statistics.median(times),
                1e3 * times[int(0.95 * len(times))], 1e3 * sharp_after(found["after"]),
            )  # fmt: skip


def scenes(folder: Path) -> list[tuple[str, Path, tuple[int, int]]]:
    """Return what is shown: its name, its file and the size of its pictures."""
    path = folder / "torus.obj"
    vertices, faces = torus(250, 140)
    lines = [f"v {x} {y} {z}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    path.write_text("\n".join(lines) + "\n")
    teapot = ROOT / "models" / "teapot.obj"
    return [("torus 70 k", path, (1280, 800)), ("teapot", teapot, (640, 480))]


def sharp_after(after: Sequence[tuple[float, str]]) -> float:
    """Return the seconds after which a picture was as good as the last one; nan without any."""
    pictures = [(when, decoded(data)) for when, data in after]
    when = float("nan")
    for shown, picture in reversed(pictures):
        if root_mean_square(picture, pictures[-1][1]) > SHARP:
            break
        when = shown
    return when


def decoded(data: str) -> NDArray[np.float32]:
    """Return a picture that a page got, (H, W, 3)."""
    raw = base64.b64decode(data)
    starts = [raw.find(sign) for sign in (b"\x89PNG", b"\xff\xd8\xff")]
    first = min(start for start in starts if start >= 0)
    image = Image.open(io.BytesIO(raw[first:]))
    return np.asarray(image.convert("RGB"), dtype=np.float32)


def root_mean_square(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Return how far two pictures differ, 8-bit codes."""
    if one.shape != other.shape:
        return float("inf")
    return float(np.sqrt(np.mean(np.square(one - other))))


def worker(path: str, file: Path, size: tuple[int, int]) -> list[str]:
    """Return the command of a process that shows a file."""
    script = Path(__file__).with_name("viewing_worker.py")
    return [sys.executable, str(script), path, str(file), *map(str, size)]


def environment(place: Path) -> dict[str, str]:
    """Return the environment of a process that runs the sources in a folder."""
    return {**os.environ, "PYTHONPATH": str(place), "PYTHONUNBUFFERED": "1"}


def widget(place: Path, file: Path, size: tuple[int, int], folder: Path) -> dict[str, Any]:
    """Return what a notebook sees of a widget."""
    done = subprocess.run(
        worker("widget", file, size), env=environment(place), capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def page(place: Path, file: Path, size: tuple[int, int], folder: Path) -> dict[str, Any]:
    """Return what Chromium sees of a page."""
    chromium = tests_chromium()
    program = chromium.program()
    if program is None:
        raise OSError("the page needs Chromium")
    with contextlib.ExitStack() as stack:
        process = subprocess.Popen(
            worker("page", file, size), env=environment(place), stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        stack.callback(process.wait)
        stack.callback(process.kill)
        assert process.stdout is not None
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address is not None
        profile = stack.enter_context(
            tempfile.TemporaryDirectory(dir=folder, ignore_cleanup_errors=True)
        )
        tab = stack.enter_context(chromium.chromium(program, profile))
        tab.call("Page.addScriptToEvaluateOnNewDocument", source=WATCH)
        width, height = size
        tab.open(address[0], width)
        tab.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        return watched(tab, size)


def watched(tab: Any, size: tuple[int, int]) -> dict[str, Any]:
    """Return what is seen in a tab while a hand turns the wheel and drags."""
    width, height = size

    def mouse(kind: str, x: float, y: float, **more: Any) -> None:
        tab.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    limit = time.monotonic() + 10.0 * WAIT
    while not tab.evaluate("window.seen.length") and time.monotonic() < limit:
        time.sleep(0.1)
    for kind in ("mousePressed", "mouseReleased"):
        mouse(kind, 2, 2, button="left", clickCount=1)
    time.sleep(0.5)
    for kind in ("keyDown", "keyUp"):
        tab.call("Input.dispatchKeyEvent", type=kind, key="Escape")
        tab.call("Input.dispatchKeyEvent", type=kind, key="i", text="i" * (kind == "keyDown"))
    time.sleep(WAIT)
    random = np.random.default_rng(1)
    latencies = []
    for number in range(ROUNDS):
        time.sleep(random.uniform(*PAUSE))
        count = tab.evaluate("window.events.length")
        turn = -20.0 if number % 2 else 20.0
        mouse("mouseWheel", width / 2, height / 2, deltaX=0, deltaY=turn)
        wait = f"window.seen.find(when => when > window.events[{count}])"
        limit = time.monotonic() + WAIT
        while (shown := tab.evaluate(wait)) is None and time.monotonic() < limit:
            time.sleep(0.05)
        if shown is not None:
            latencies.append((shown - tab.evaluate(f"window.events[{count}]")) / 1e3)
    time.sleep(WAIT)
    held = {"button": "left", "buttons": 1}
    mouse("mousePressed", 0.3 * width, 0.4 * height, clickCount=1, **held)
    tab.evaluate("void (window.arrived.length = window.seen.length = 0)")
    start, number = time.perf_counter(), 0
    while (now := time.perf_counter()) < start + DRAG_SECONDS:
        share = (now - start) / DRAG_SECONDS
        mouse("mouseMoved", (0.3 + 0.4 * share) * width, (0.4 + 0.1 * share) * height, **held)
        number += 1
        time.sleep(max(0.0, start + number / EVENTS_A_SECOND - time.perf_counter()))
    frames = tab.evaluate("window.seen.length") / (time.perf_counter() - start)
    mouse("mouseReleased", 0.7 * width, 0.5 * height, button="left", buttons=0, clickCount=1)
    time.sleep(WAIT)
    return {"frames": frames, "latencies": latencies, "after": tab.evaluate(KEPT)}


def tests_chromium() -> Any:
    """Return the module of the tests that opens pages in Chromium."""
    path = ROOT / "tests" / "support" / "chromium.py"
    found = importlib.util.spec_from_file_location("chromium", path)
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def table(rows: Sequence[Row]) -> str:
    """Return rows as a table."""
    lines = [
        f"{processors()} processors; marks for the torus: page {MARKS['page']:.0f} and widget "
        f"{MARKS['widget']:.0f} frames a second, {LATENCY_MARK:.0f} ms in the median, sharp after "
        f"{SHARP_MARK:.0f} ms",
        "",
        "| revision | path | scene | frames/s | event to picture, ms | 95 % | sharp after, ms |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.revision} | {row.path} | {row.scene} | {row.frames:.1f} | {row.median:.0f} | "
        f"{row.late:.0f} | {row.sharp:.0f} |"
        for row in rows
    ]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1] if __doc__ else None)
    parser.add_argument("--against", action="append", default=[], metavar="COMMIT")
    parser.add_argument("--only", choices=PATHS)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args(arguments)
    paths = [options.only] if options.only else list(PATHS)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        revisions = [*options.against, WORKING_TREE[0]]
        with checkouts(revisions, folder) as found:
            for revision, place in found:
                for row in rows_of(folder, place, revision, paths):
                    print(row, file=sys.stderr)
                    rows.append(row)
    text = table(rows)
    print(text)
    if options.output is not None:
        options.output.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
