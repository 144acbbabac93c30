"""Start viewers that serve pages, and look at their pages: with Chromium, or as a socket."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import io
import json
import os
import queue
import re
import socket
import struct
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from PIL import Image

from rasterjit.viewer import browser

PATIENCE = 300.0
"""Seconds to wait for a picture: as good as it becomes, it takes a loaded machine a minute."""

VIEW = """
from rasterjit.cli import main
from rasterjit.viewer import canvas
canvas.ADDED_NICENESS = 0
main()
"""
"""Runs the command line; its viewers make pictures better as if nobody else wanted a processor."""


def address_in(said):
    """Return the address that was printed."""
    found = re.search(r"http://127\.0\.0\.1:\d+/[\w-]{16,}/", said)
    assert found, said
    return found[0]


@contextlib.contextmanager
def viewing(*arguments):
    """Yield the process of a viewer, and the address of its page."""
    if not os.environ.get("CI"):
        pytest.importorskip("uvicorn")
    process = subprocess.Popen(
        [sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    try:
        yield process, address_in(process.stdout.readline())
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


@contextlib.contextmanager
def serving(viewer, **options):
    """Yield the address of a page that a thread of this process serves, and what ends it."""
    stops, said = queue.SimpleQueue(), []
    thread = threading.Thread(
        target=browser.serve, args=(viewer, "127.0.0.1", 0, said.append),
        kwargs={"on_start": stops.put, **options},
    )  # fmt: skip
    thread.start()
    stop = stops.get(timeout=PATIENCE)
    try:
        yield address_in(said[0]), stop
    finally:
        stop()
        thread.join(PATIENCE)
    assert not thread.is_alive()


def command(model, *more):
    """Return the arguments of Python that show a model."""
    view = "-c", VIEW, "view", str(model)
    return *view, "--backend", "browser", "--quiet", *(more or ("--port", "0"))


def place_of(address):
    """Return host:port, and the token."""
    host, _, path = address.removeprefix("http://").partition("/")
    return host, path.strip("/")


def cookie(token):
    """Return the header with which a page shows that it was let in."""
    return f"rasterjit-{hashlib.sha256(token.encode()).hexdigest()[:8]}={token}"


def ask(address, lines):
    """Send a request, and return the first line of the answer, and its headers."""
    host, port = place_of(address)[0].split(":")
    with socket.create_connection((host, int(port)), timeout=PATIENCE) as connection:
        connection.sendall("\r\n".join([*lines, "", ""]).encode())
        answer = connection.makefile(encoding="latin-1")
        first = answer.readline()
        return first, dict(
            line.strip().lower().split(": ", 1) for line in iter(answer.readline, "\n")
        )


def join(address):
    """Return an open socket of a page."""
    client = pytest.importorskip("websockets.sync.client")
    own, token = place_of(address)
    host, port = own.split(":")
    # Not by a proxy.
    reached = socket.create_connection((host, int(port)), timeout=PATIENCE)
    return client.connect(
        f"ws://{own}/socket", origin=f"http://{own}", sock=reached,
        additional_headers={"Cookie": cookie(token)},
    )  # fmt: skip


def say(page, kind, /, **message):
    page.send(json.dumps({"type": kind, **message}))


def next_picture(page):
    """Return the next picture, whatever else is told before, and say that it was shown."""
    while isinstance(told := page.recv(timeout=PATIENCE), str):
        pass
    say(page, "shown", number=struct.unpack(">I", told[:4])[0])
    return Image.open(io.BytesIO(told[4:]))


def next_told(page, wanted):
    """Return the next of what is told that is wanted; pictures are shown meanwhile."""
    while True:
        told = page.recv(timeout=PATIENCE)
        if isinstance(told, bytes):
            say(page, "shown", number=struct.unpack(">I", told[:4])[0])
        elif wanted(json.loads(told)):
            return json.loads(told)


def shown(page):
    """Return the picture in the page, (H, W, 3) uint8, and how it was coded; None before it."""
    kind, _, data = page.evaluate(
        "(({dataset: {kind = ''}}, data) => kind + ',' + data)(picture, picture.toDataURL())"
    ).split(",", 2)
    if not kind:
        return None, ""
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")), kind


def wait_until(page, expression):
    """Wait until a JavaScript expression is true, and return its value."""
    limit = time.monotonic() + PATIENCE
    while not (value := page.evaluate(expression)):
        assert time.monotonic() < limit, expression
        time.sleep(0.05)
    return value


def wait_for(page, wanted, most=0):
    """Wait until the page shows a picture exactly, but for as many pixels at most."""
    limit, far = time.monotonic() + PATIENCE, None
    while time.monotonic() < limit:
        picture, kind = shown(page)
        if picture is not None and picture.shape == wanted.shape:
            far = np.abs(picture.astype(int) - wanted).max(axis=2)
            if kind == "png" and (far > 0).sum() <= most:
                return
        time.sleep(0.1)
    pytest.fail(f"{kind} differs in {None if far is None else (far > 0).sum()} pixels")


def mouse(page, kind, x, y, **more):
    page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)


def click(page, x, y):
    mouse(page, "mousePressed", x, y, button="left", buttons=1, clickCount=1)
    mouse(page, "mouseReleased", x, y, button="left", buttons=0, clickCount=1)


def touch(page, kind, *places):
    """Put fingers on a page, move or lift them: kind is touchStart, touchMove or touchEnd."""
    points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(places)]
    page.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)


CODES = {"Enter": ("Enter", 13, "\r"), "Escape": ("Escape", 27, ""), "Tab": ("Tab", 9, "")}


def press(page, key):
    code, number, text = CODES.get(key, ("", 0, key if len(key) == 1 else ""))
    for kind in ("keyDown", "keyUp"):
        page.call(
            "Input.dispatchKeyEvent", type=kind, key=key, code=code, windowsVirtualKeyCode=number,
            text=text if kind == "keyDown" else "",
        )  # fmt: skip


def picture_of_window(page, path):
    """Save a picture of what the window shows, in its own pixels."""
    found = page.call("Page.captureScreenshot", format="png")
    path.write_bytes(base64.b64decode(found["data"]))
    return np.asarray(Image.open(path).convert("RGB"))
