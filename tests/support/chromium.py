"""
Open pages in headless Chromium, by the DevTools protocol over a pair of pipes.

Nothing but the browser is needed: no driver, no package, no network.
"""

from __future__ import annotations

import base64
import fcntl
import io
import json
import os
import select
import shutil
import subprocess
import time
from contextlib import contextmanager

import numpy as np
from PIL import Image

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome", "chrome")

OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
    "--disable-extensions", "--disable-background-networking", "--hide-scrollbars",
    "--force-color-profile=srgb", "--remote-debugging-pipe",
)  # fmt: skip

PATIENCE = 120.0
"""Seconds to wait for an answer: a loaded machine starts a browser slowly."""

FIRST_FREE = 10
"""File descriptors from here on are none of those that Chromium reads and writes: 3 and 4."""


def program():
    """Return the path of Chromium, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Page:
    """A tab of a running Chromium."""

    def __init__(self, commands, answers):
        self._commands, self._answers = commands, answers
        self._rest, self._count, self._session = b"", 0, None
        self.requested = []

    def call(self, method, **parameters):
        """Send a command and return its result."""
        self._count += 1
        command = {"id": self._count, "method": method, "params": parameters}
        if self._session is not None:
            command["sessionId"] = self._session
        os.write(self._commands, json.dumps(command).encode() + b"\0")
        answer = self._until(lambda message: message.get("id") == self._count)
        assert "error" not in answer, (method, answer["error"])
        return answer["result"]

    def attach(self):
        """Open the tab that all further commands go to."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        self.call("Page.enable")
        self.call("Network.enable")

    def open(self, url, width, *, scheme="light"):
        """Load a page in a window of the given width, CSS pixels; ``scheme`` is light or dark."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=800, deviceScaleFactor=1, mobile=width < 600,
        )  # fmt: skip
        self.call(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": scheme}],
        )
        self.requested = []
        self.call("Page.navigate", url=url)
        self._until(lambda message: message.get("method") == "Page.loadEventFired")

    def evaluate(self, expression):
        """Return the value of a JavaScript expression, waiting for promises."""
        found = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def screenshot(self, path):
        """Take a picture of the whole page, beyond the window too; (H, W, 3) uint8."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
        found = self.call(
            "Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip
        )
        data = base64.b64decode(found["data"])
        path.write_bytes(data)
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))

    def _until(self, wanted):
        """Read messages up to the first that is wanted, and return it."""
        limit = time.monotonic() + PATIENCE
        while True:
            while b"\0" not in self._rest:
                ready, _, _ = select.select(
                    [self._answers], [], [], max(0.0, limit - time.monotonic())
                )
                part = os.read(self._answers, 1 << 20) if ready else b""
                assert part, "Chromium does not answer"
                self._rest += part
            line, _, self._rest = self._rest.partition(b"\0")
            message = json.loads(line)
            if message.get("method") == "Network.requestWillBeSent":
                self.requested.append(message["params"]["request"]["url"])
            if wanted(message):
                return message


def _pipe():
    """Return both ends of a pipe, numbered beyond those that a child is given."""
    ends = os.pipe()
    moved = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, FIRST_FREE) for end in ends]
    for end in ends:
        os.close(end)
    return moved


@contextmanager
def chromium(path, profile):
    """Start Chromium with a profile in an empty folder, give a tab of it, and end it."""
    child_reads, commands = _pipe()
    answers, child_writes = _pipe()
    # The shell moves the two ends to where Chromium looks for them.
    script = f'exec "$0" "$@" 3<&{child_reads} 4>&{child_writes}'
    process = subprocess.Popen(
        ["bash", "-c", script, path, *OPTIONS, f"--user-data-dir={profile}", "about:blank"],
        pass_fds=(child_reads, child_writes),
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(child_reads)
    os.close(child_writes)
    try:
        page = Page(commands, answers)
        page.attach()
        yield page
    finally:
        os.close(commands)
        os.close(answers)
        process.terminate()
        try:
            process.wait(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
