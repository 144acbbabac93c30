"""The viewer in a web page: a browser drags, and sees what the controls foretell."""

from __future__ import annotations

import asyncio
import base64
import io
import os
import re
import signal
import socket
import subprocess
import sys
import time

import chromium
import numpy as np
import pytest
from cubes import CUBE_FACES, CUBE_VERTICES
from PIL import Image

import rasterjit as rj
from rasterjit.viewer import browser
from rasterjit.viewer.viewer import Viewer

SIZE = (160, 120)
FOCUS = 0.5
"""Seconds after which a page that was clicked listens to keys."""

PATIENCE = 60.0
"""Seconds to wait for a picture; a loaded machine compiles slowly."""


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "cube.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in CUBE_VERTICES]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in CUBE_FACES]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def server(model):
    if not os.environ.get("CI"):
        pytest.importorskip("uvicorn")
    process = subprocess.Popen(
        [sys.executable, "-m", "rasterjit", "view", str(model), "--backend", "browser",
         "--port", "0", "--quiet"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    try:
        said = process.stdout.readline()
        found = re.search(r"http://127\.0\.0\.1:(\d+)", said)
        assert found, said + process.stderr.read()
        yield process, found[0]
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def page(server, tmp_path_factory):
    path = chromium.program()
    if path is None and not os.environ.get("CI"):
        pytest.skip("no Chromium")
    assert path is not None
    with chromium.chromium(path, tmp_path_factory.mktemp("profile")) as page:
        yield page


SHOWN = """
(async () => {
  const image = document.querySelector('#canvas img');
  if (!image || !image.src || !image.naturalWidth) { return null; }
  const bytes = await (await fetch(image.src)).blob();
  const reader = new FileReader();
  await new Promise(done => { reader.onload = done; reader.readAsDataURL(bytes); });
  return reader.result;
})()
"""


def shown(page):
    """Return the picture in the page, (H, W, 3) uint8, and how it is coded."""
    address = page.evaluate(SHOWN)
    if address is None:
        return None, ""
    kind, _, data = address.partition(",")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")), kind


def wait_for(page, wanted):
    """Wait until the page shows exactly that picture, and say how far off the last one was."""
    limit, far = time.monotonic() + PATIENCE, None
    while time.monotonic() < limit:
        picture, kind = shown(page)
        if picture is not None and picture.shape == wanted.shape:
            far = np.abs(picture.astype(int) - wanted).max(axis=2)
            if "png" in kind and not far.any():
                return
        time.sleep(0.1)
    pytest.fail(f"{kind} differs in {None if far is None else (far > 0).sum()} pixels")


def mouse(page, kind, x, y, **more):
    page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)


def press(page, key):
    for kind in ("keyDown", "keyUp"):
        page.call(
            "Input.dispatchKeyEvent", type=kind, key=key, text=key if kind == "keyDown" else ""
        )


def settle(viewer):
    """Let the camera come to rest."""
    while viewer.is_moving:
        viewer.advance(0.05)


def drag(page, viewer, start, end):
    """Drag in the page, and in a viewer of our own."""
    held = {"button": "left", "buttons": 1}
    mouse(page, "mouseMoved", *start)
    mouse(page, "mousePressed", *start, clickCount=1, **held)
    mouse(page, "mouseMoved", *end, **held)
    mouse(page, "mouseReleased", *end, clickCount=1, button="left", buttons=0)
    for kind, (x, y) in (("down", start), ("move", end), ("up", end)):
        event = {"event_type": f"pointer_{kind}", "x": x, "y": y, "button": 1, "modifiers": ()}
        viewer.handle(event)
    settle(viewer)


def reference(scene, camera, size):
    return rj.render(scene, camera, size=size, quality=rj.Quality.reference()).color[:, :, :3]


@pytest.mark.needs_jit
def test_page_shows_what_the_controls_foretell(page, server, model, tmp_path):
    _, address = server
    page.open(address, 320)
    size = tuple(page.evaluate("[innerWidth, innerHeight]"))
    scene = rj.load(model)
    mine = Viewer(scene, size=size)
    limit = time.monotonic() + PATIENCE
    while shown(page)[0] is None and time.monotonic() < limit:
        time.sleep(0.1)
    # The line at the bottom tells times, which nobody foretells.
    mouse(page, "mouseMoved", 10, 10)
    mouse(page, "mousePressed", 10, 10, button="right", buttons=2, clickCount=1)
    mouse(page, "mouseReleased", 10, 10, button="right", buttons=0, clickCount=1)
    time.sleep(FOCUS)
    press(page, "i")
    first = reference(scene, mine.camera, size)
    wait_for(page, first)
    drag(page, mine, (100, 100), (160, 70))
    turned = reference(scene, mine.camera, size)
    assert (turned != first).any(axis=2).mean() > 0.1
    wait_for(page, turned)
    page.call("Input.dispatchMouseEvent", type="mouseWheel", x=80, y=300, deltaX=0, deltaY=-400)
    mine.draw()
    mine.handle({"event_type": "wheel", "x": 80, "y": 300, "dx": 0, "dy": -400})
    settle(mine)
    wait_for(page, reference(scene, mine.camera, size))
    page.screenshot(tmp_path / "page.png")
    press(page, "r")
    wait_for(page, first)
    mine.close()


def test_page_comes_from_this_machine_alone(page, server):
    _, address = server
    page.open(address, 320)
    local = (address, "blob:", "data:", address.replace("http", "ws"))
    assert all(one.startswith(local) for one in page.requested)


def ask(address, lines):
    """Send a request, and return the first line of the answer."""
    host, port = address.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), timeout=PATIENCE) as connection:
        connection.sendall("\r\n".join([*lines, "", ""]).encode())
        return connection.makefile(encoding="latin-1").readline()


UPGRADE = [
    "Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
]  # fmt: skip


def test_other_sites_are_kept_out(server):
    _, address = server
    own = address.removeprefix("http://")
    page = ["GET / HTTP/1.1", f"Host: {own}"]
    assert " 200 " in ask(address, page)
    assert " 400 " in ask(address, ["GET / HTTP/1.1", "Host: elsewhere.example"])
    assert " 101 " in ask(address, [*page, *UPGRADE, f"Origin: http://{own}"])
    assert " 403 " in ask(address, [*page, *UPGRADE, "Origin: http://elsewhere.example"])


def status(bound, asked, origin=None):
    """Return the status with which a page that is served at a host answers a request."""

    async def app(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message):
        said.append(message)

    headers = [(b"host", asked.encode())] if asked is not None else []
    headers += [] if origin is None else [(b"origin", origin.encode())]
    said = []
    scope = {"type": "http", "headers": headers}
    asyncio.run(browser.guarded(app, bound)(scope, None, send))
    return said[0]["status"]


EVERYWHERE = ("0.0.0.0", "::", "192.168.1.5", "fe80::1")
LOOPBACK = ("127.0.0.1", "127.0.0.2", "localhost", "LOCALHOST", "::1")


@pytest.mark.parametrize("bound", [*LOOPBACK, *EVERYWHERE])
def test_name_of_another_site_that_leads_here_is_kept_out(bound):
    for asked in ("elsewhere.example:8765", "elsewhere.example", "localhost.elsewhere.example"):
        assert status(bound, asked) == 400
        assert status(bound, asked, f"http://{asked}") == 400
    assert status(bound, None) == 400


@pytest.mark.parametrize("bound", LOOPBACK)
def test_this_machine_is_asked_by_all_its_own_names(bound):
    for asked in ("localhost:8765", "LocalHost", "127.0.0.1:8765", "127.0.0.2", "[::1]", "[::1]:8"):
        assert status(bound, asked) == 200
        assert status(bound, asked, f"http://{asked.upper()}") == 200
    assert status(bound, "192.168.1.5:8765") == 400
    assert status(bound, "localhost:8765", "http://elsewhere.example") == 400


@pytest.mark.parametrize("bound", EVERYWHERE)
def test_others_ask_by_an_address_or_a_name_of_this_machine(bound, monkeypatch):
    monkeypatch.setattr(socket, "gethostname", lambda: "Box")
    monkeypatch.setattr(socket, "getfqdn", lambda: "box.home.example")
    for asked in ("192.168.1.5:8765", "[fe80::1]", "box", "BOX.local:8765", "box.home.example"):
        assert status(bound, asked) == 200
    assert status(bound, "other.home.example") == 400


def test_name_that_it_is_bound_to_is_its_own():
    assert status("Viewer.Example", "viewer.example:80") == 200


def test_nothing_is_drawn_before_the_place_is_there(cube, monkeypatch):
    def draw(self):
        pytest.fail("drawn")

    monkeypatch.setattr(Viewer, "draw", draw)
    places = ("127.0.0.1", -1, "port"), ("nowhere.invalid", 0, "host"), (5, 0, "host")
    for host, port, named in places:
        with pytest.raises(ValueError, match=f"{named} must be"):
            rj.show(cube, backend="browser", host=host, port=port, size=(8, 6))


def test_port_in_use_is_said(server, model):
    _, address = server
    port = address.rsplit(":", 1)[1]
    done = subprocess.run(
        [sys.executable, "-m", "rasterjit", "view", str(model), "--backend", "browser",
         "--port", port, "--quiet"],
        capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith("error: host and port must be free to listen at, got 127.0.0.1:")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("host", "port", "message"),
    [
        ("nowhere.invalid", 0, "host must be a name or address of this machine"),
        ("192.0.2.1", 0, "must be free to listen at, got 192.0.2.1:0"),
        ("127.0.0.1", -1, "port must be a whole number in 0..65535, got -1"),
        ("127.0.0.1", 65536, "port must be"),
        ("127.0.0.1", True, "port must be"),
        (5, 0, "host must be a name or address of this machine, got 5"),
        (None, 0, "host must be"),
    ],
)
def test_place_that_is_none_is_refused(host, port, message):
    with pytest.raises(ValueError, match=message):
        browser.bind(host, port)


def test_interrupt_ends_it(server):
    process, address = server
    process.send_signal(signal.SIGINT)
    process.wait(timeout=PATIENCE)
    with pytest.raises(ConnectionRefusedError):
        ask(address, ["GET / HTTP/1.1"])
    assert "Traceback" not in process.stderr.read()
