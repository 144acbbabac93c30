"""The viewer in a web page: a browser drags, and sees what the controls foretell."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import io
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque

import chromium
import numpy as np
import pytest
from cubes import CUBE_FACES, CUBE_VERTICES
from PIL import Image

import rasterjit as rj
from rasterjit.viewer import browser
from rasterjit.viewer.canvas import MOST_WAITING, DrawCancelled, PatientConnection, add_event
from rasterjit.viewer.viewer import Viewer

pytestmark = pytest.mark.takes_long

SIZE = (160, 120)
FOCUS = 0.5
"""Seconds after which a page that was clicked listens to keys."""

PROMPT = 3.0
"""Seconds in which a process ends that promises to in one, on a loaded machine."""

PATIENCE = 60.0
"""Seconds to wait for a picture; a loaded machine compiles slowly."""


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "cube.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in CUBE_VERTICES]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in CUBE_FACES]
    path.write_text("\n".join(lines) + "\n")
    return path


def address_in(said):
    """Return the address that was printed."""
    found = re.search(r"http://127\.0\.0\.1:\d+/[\w-]{22}/", said)
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


def command(model):
    """Return the arguments of Python that show a model."""
    view = "-m", "rasterjit", "view", str(model)
    return *view, "--backend", "browser", "--port", "0", "--quiet"


def program(first):
    """Return a program that shows a triangle whose pictures are drawn by a line of Python."""
    return (
        "import time\n"
        "import rasterjit as rj\n"
        "from rasterjit.viewer.viewer import Viewer\n"
        "def draw(self):\n"
        f"    {first}\n"
        "Viewer.draw = draw\n"
        "mesh = rj.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])\n"
        "rj.show(mesh, backend='browser', port=0)\n"
    )


@pytest.fixture(scope="module")
def server(model):
    with viewing(*command(model)) as found:
        yield found


@pytest.fixture
def running(model):
    """A viewer that no other test looks at."""
    with viewing(*command(model)) as found:
        yield found


@pytest.fixture
def compiling():
    """A viewer whose first picture takes longer than any test."""
    with viewing("-c", program("time.sleep(1000)")) as found:
        yield found


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
    address = f"http://{place_of(address)[0]}/"
    local = (address, "blob:", "data:", address.replace("http", "ws"))
    assert all(one.startswith(local) for one in page.requested)


def place_of(address):
    """Return host:port, and the path that has the token."""
    host, _, path = address.removeprefix("http://").partition("/")
    return host, f"/{path}"


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


UPGRADE = [
    "Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
]  # fmt: skip


def test_other_sites_are_kept_out(server):
    own, path = place_of(server[1])
    page = [f"GET {path} HTTP/1.1", f"Host: {own}"]
    assert " 200 " in ask(server[1], page)[0]
    assert " 403 " in ask(server[1], [page[0], "Host: elsewhere.example"])[0]
    assert " 101 " in ask(server[1], [*page, *UPGRADE, f"Origin: http://{own}"])[0]
    assert " 403 " in ask(server[1], [*page, *UPGRADE, "Origin: http://elsewhere.example"])[0]


def test_nothing_is_told_without_the_token(server):
    own, path = place_of(server[1])
    token = path.strip("/")
    others = (
        "/", "/index.html", "/renderview.js", f"/{token}", f"/{token[:-1]}/", f"/{token}x/",
        f"//{token}/", f"/x/{token}/", f"/?token={token}", "/%ff/", f"/{token}/x/renderview.js",
    )  # fmt: skip
    for other in others:
        page = [f"GET {other} HTTP/1.1", f"Host: {own}"]
        for lines in (page, [*page, *UPGRADE, f"Origin: http://{own}"]):
            assert " 403 " in ask(server[1], lines)[0], other
    script = [f"GET {path}renderview.js HTTP/1.1", f"Host: {own}"]
    assert " 200 " in ask(server[1], script)[0]


def test_answers_are_not_framed_guessed_kept_or_told_of(server):
    own, path = place_of(server[1])
    for asked in (path, "/", f"{path}renderview.css", f"{path}none"):
        _, headers = ask(server[1], [f"GET {asked} HTTP/1.1", f"Host: {own}"])
        assert headers["x-frame-options"] == "deny"
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["cache-control"] == "no-store"
        assert headers["content-type"].startswith("text/")


def join(address):
    """Return an open socket of a page."""
    client = pytest.importorskip("websockets.sync.client")
    own, path = place_of(address)
    host, port = own.split(":")
    # Not by a proxy.
    reached = socket.create_connection((host, int(port)), timeout=PATIENCE)
    return client.connect(f"ws://{own}{path}", origin=f"http://{own}", sock=reached)


def say(page, **message):
    page.send(json.dumps({"timestamp": 0, **message}))


def next_told(page, kind):
    """Return the next message of a kind; a picture with its size."""
    while True:
        told = page.recv(timeout=PATIENCE)
        if isinstance(told, bytes):
            continue
        told = json.loads(told)
        if told.get("nbuffers"):
            told["size"] = Image.open(io.BytesIO(page.recv(timeout=PATIENCE))).size
            say(page, **{**told, "type": "_framefeedback"})
        if told["type"] == kind:
            return told


def end_of(page):
    """Return the code with which the other side closes."""
    exceptions = pytest.importorskip("websockets.exceptions")
    with pytest.raises(exceptions.ConnectionClosed):
        next_told(page, "none")
    return page.close_code


def wait_for_size(page, size):
    while next_told(page, "framebufferdata")["size"] != size:
        pass


@pytest.mark.needs_jit
def test_page_cannot_end_it_nor_take_the_view_of_another(running):
    process, address = running
    with join(address) as first, join(address) as second:
        assert next_told(first, "active")["value"]
        say(first, type="resize", pwidth=64, pheight=48, ratio=1)
        wait_for_size(first, (64, 48))
        for text in ("{", "[]", '{"type": []}', '{"type": "_clients_change", "ids": [2]}'):
            second.send(text)
        say(second, type="resize", pwidth=16384, pheight=16384, ratio=1)
        say(second, type="close")
        assert end_of(second) == 1000
        # The first one is still there, and says what size it is.
        say(first, type="resize", pwidth=72, pheight=40, ratio=1)
        wait_for_size(first, (72, 40))
        say(first, type="close")
        assert end_of(first) == 1000
    with join(address) as third:
        assert next_told(third, "active")["value"]
        third.send("x" * 10_000)
        assert end_of(third) == 1009
    assert process.poll() is None


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_page_is_there_while_kernels_compile_and_it_ends_at_once(compiling, number):
    process, address = compiling
    own, path = place_of(address)
    assert " 200 " in ask(address, [f"GET {path} HTTP/1.1", f"Host: {own}"])[0]
    # The page does not listen when it is asked to go.
    with join(address):
        process.send_signal(number)
        asked = time.monotonic()
        process.wait(timeout=PATIENCE)
        assert time.monotonic() - asked < PROMPT
    assert "Traceback" not in process.stderr.read()


WAITING = "getComputedStyle(document.getElementById('waiting')).display != 'none'"
"""Whether the page says that there is no picture yet."""


@pytest.mark.needs_jit
def test_page_says_that_kernels_compile_until_there_is_a_picture(page, server, compiling):
    page.open(compiling[1], 320)
    limit = time.monotonic() + PATIENCE
    while not page.evaluate("Boolean(window.websocket)") and time.monotonic() < limit:
        time.sleep(0.05)
    assert "Compiling kernels" in page.evaluate("document.body.innerText")
    assert page.evaluate(WAITING)
    page.open(server[1], 320)
    while page.evaluate(WAITING) and time.monotonic() < limit:
        time.sleep(0.05)
    assert shown(page)[0] is not None


def test_first_picture_that_fails_ends_it_and_is_told():
    done = subprocess.run(
        [sys.executable, "-c", program("raise MemoryError('too much')")],
        capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "MemoryError: too much" in done.stderr


@pytest.mark.parametrize(
    ("host", "address", "warned"),
    [
        ("127.0.0.1", "http://127.0.0.1:80/abc/", ""),
        ("::1", "http://[::1]:80/abc/", ""),
        ("0.0.0.0", "http://Box:80/abc/", "all networks of this machine"),
        ("::", "http://Box:80/abc/", "all networks of this machine"),
        ("192.168.1.5", "http://192.168.1.5:80/abc/", "to the network"),
    ],
)
def test_it_is_said_where_the_page_is_and_who_reaches_it(host, address, warned, monkeypatch):
    monkeypatch.setattr(socket, "gethostname", lambda: "Box")
    first, *more = browser.announcement(host, 80, "abc")
    assert f"open {address} in" in first
    assert bool(more) == bool(warned)
    assert all(warned in line and "encrypted" in line and "abc" not in line for line in more)


def test_more_pages_than_there_may_be_are_kept_out():
    async def app(scope, receive, send):
        await release.wait()

    async def send(message):
        said.append(message["type"])

    async def crowd():
        nonlocal release
        release = asyncio.Event()
        guard = browser.guarded(app, "127.0.0.1", "abc")
        scope = {"type": "websocket", "path": "/abc/", "headers": [(b"host", b"localhost")]}
        pages = [
            asyncio.create_task(guard(scope, None, send)) for _ in range(browser.MOST_PAGES + 1)
        ]
        await asyncio.wait(pages, timeout=PATIENCE, return_when=asyncio.FIRST_COMPLETED)
        assert said == ["websocket.close"]
        release.set()
        await asyncio.gather(*pages)
        await guard(scope, None, send)
        assert said == ["websocket.close"]

    release, said = None, []
    asyncio.run(crowd())


def status(bound, asked, origin=None):
    """Return the status with which a page that is served at a host answers a request."""

    async def app(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message):
        said.append(message)

    headers = [(b"host", asked.encode())] if asked is not None else []
    headers += [] if origin is None else [(b"origin", origin.encode())]
    said = []
    scope = {"type": "http", "path": "/abc/", "headers": headers}
    asyncio.run(browser.guarded(app, bound, "abc")(scope, None, send))
    return said[0]["status"]


EVERYWHERE = ("0.0.0.0", "::", "192.168.1.5", "fe80::1")
LOOPBACK = ("127.0.0.1", "127.0.0.2", "localhost", "LOCALHOST", "::1")


@pytest.mark.parametrize("bound", [*LOOPBACK, *EVERYWHERE])
def test_name_of_another_site_that_leads_here_is_kept_out(bound):
    for asked in ("elsewhere.example:8765", "elsewhere.example", "localhost.elsewhere.example"):
        assert status(bound, asked) == 403
        assert status(bound, asked, f"http://{asked}") == 403
    assert status(bound, None) == 403


@pytest.mark.parametrize("bound", LOOPBACK)
def test_this_machine_is_asked_by_all_its_own_names(bound):
    for asked in ("localhost:8765", "LocalHost", "127.0.0.1:8765", "127.0.0.2", "[::1]", "[::1]:8"):
        assert status(bound, asked) == 200
        assert status(bound, asked, f"http://{asked.upper()}") == 200
    assert status(bound, "192.168.1.5:8765") == 403
    assert status(bound, "localhost:8765", "http://elsewhere.example") == 403


@pytest.mark.parametrize("bound", EVERYWHERE)
def test_others_ask_by_an_address_or_a_name_of_this_machine(bound, monkeypatch):
    monkeypatch.setattr(socket, "gethostname", lambda: "Box")
    monkeypatch.setattr(socket, "getfqdn", lambda: "box.home.example")
    for asked in ("192.168.1.5:8765", "[fe80::1]", "box", "BOX.local:8765", "box.home.example"):
        assert status(bound, asked) == 200
    assert status(bound, "other.home.example") == 403


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
    port = place_of(address)[0].rsplit(":", 1)[1]
    done = subprocess.run(
        [sys.executable, "-m", "rasterjit", "view", str(model), "--backend", "browser",
         "--port", port, "--quiet"],
        capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith("error: --port must be free to listen at, got 127.0.0.1:")
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


class Canvas:
    """What a connection needs of a canvas."""

    def __init__(self, size):
        self.size, self.shown, self.wishes = size, [], 0

    def get_bitmap_context(self):
        return self

    def set_bitmap(self, picture):
        self.shown.append(picture)

    def add_event_handler(self, *arguments):
        pass

    def request_draw(self, draw=None):
        self.wishes += 1

    def get_physical_size(self):
        return self.size

    def get_pixel_ratio(self):
        return 1.0


def draw_until_shown(connection, canvas, count):
    while len(canvas.shown) < count:
        with contextlib.suppress(DrawCancelled):
            connection._draw()


def test_canvas_answers_while_a_picture_is_drawn(cube, monkeypatch):
    viewer, canvas = Viewer(cube, size=(8, 6)), Canvas((8, 6))
    release, handled, draw = threading.Event(), [], viewer.draw

    def draw_slowly():
        assert release.wait(PATIENCE)
        return draw()

    monkeypatch.setattr(viewer, "draw", draw_slowly)
    monkeypatch.setattr(viewer, "handle", handled.append)
    connection = PatientConnection(viewer, canvas)
    wishes = canvas.wishes
    with pytest.raises(DrawCancelled):
        connection._draw()
    assert canvas.wishes == wishes + 1
    event = {"event_type": "key_down", "key": "h"}
    connection._handle(event)
    assert not handled
    release.set()
    draw_until_shown(connection, canvas, 1)
    assert handled == [event]
    connection._handle(event)
    assert handled == [event, event]
    connection._close({})


def test_a_long_drag_while_the_first_picture_is_compiled_ends_where_it_ended(cube, monkeypatch):
    """Some 60 moves a second come: the release must not be lost behind them."""
    viewer, quick = (Viewer(cube, size=(80, 60)) for _ in range(2))
    release, draw = threading.Event(), viewer.draw

    def draw_slowly():
        assert release.wait(PATIENCE)
        return draw()

    monkeypatch.setattr(viewer, "draw", draw_slowly)
    canvas = Canvas((80, 60))
    connection = PatientConnection(viewer, canvas)
    place = {"button": 1, "buttons": [1], "modifiers": [], "x": 10.0, "y": 30.0}
    events = [{**place, "event_type": "pointer_down"}]
    events += [
        {**place, "event_type": "pointer_move", "x": 10.0 + 0.01 * n, "y": 30.0}
        for n in range(2 * MOST_WAITING)
    ]
    events += [{**place, "event_type": "pointer_up", "x": 30.0}]
    wheel = {"event_type": "wheel", "x": 40.0, "y": 30.0, "dx": 0.0, "dy": 0.01, "modifiers": []}
    events += [wheel] * (2 * MOST_WAITING)
    events += [{**wheel, "event_type": "key_down", "key": "l"}]
    for event in events:
        connection._handle(event)
        quick.handle(event)
    assert len(connection._waiting) == 5
    assert viewer.controls.goal == viewer.controls.home
    release.set()
    draw_until_shown(connection, canvas, 1)
    assert not viewer.controls.drag
    for name in ("azimuth", "elevation", "distance"):
        expected = getattr(quick.controls.goal, name)
        assert getattr(viewer.controls.goal, name) == pytest.approx(expected, rel=1e-6), name
        assert expected != getattr(quick.controls.home, name) or name == "elevation"
    connection._close({})


def test_of_too_many_events_the_latest_are_kept():
    waiting = deque(maxlen=3)
    for key in "abcde":
        add_event(waiting, {"event_type": "key_up", "key": key})
    assert [event["key"] for event in waiting] == ["c", "d", "e"]


def test_only_moves_with_the_same_buttons_and_keys_become_one():
    waiting = deque()
    for buttons, x in (([1], 1), ([1], 2), ([], 3), ([], 4), ([1], 5)):
        add_event(waiting, {"event_type": "pointer_move", "buttons": buttons, "x": x})
    assert [event["x"] for event in waiting] == [2, 4, 5]


def test_picture_of_a_size_that_is_gone_is_not_shown(cube):
    viewer, canvas = Viewer(cube, size=(8, 6)), Canvas((10, 4))
    connection = PatientConnection(viewer, canvas)
    draw_until_shown(connection, canvas, 1)
    assert [picture.shape for picture in canvas.shown] == [(4, 10, 4)]
    connection._close({})


def test_server_answers_while_a_picture_is_coded_without_loss(monkeypatch):
    encoders = pytest.importorskip("rendercanvas.core.encoders")
    release = threading.Event()

    def encode_slowly(array, quality):
        assert release.wait(PATIENCE)
        return "image/png", bytes([quality])

    class Base:
        """What a page does with pictures, of rendercanvas."""

        def __init__(self):
            self._lossless_draw_info, self._ref_index = (np.zeros((2, 2, 4)), None), 0
            self.sent = []

        def _send_last_frame_to_ready_clients(self):
            self.sent.append((self._last_frame[0]["mimetype"], self._last_frame[1]))

        def close(self):
            pass

    async def draw(is_late):
        page = browser._complete(Base, lambda: None)()
        page._lossless_draw()
        assert not page.sent
        if is_late:
            page._ref_index += 1
        release.set()
        limit = time.monotonic() + (0.1 if is_late else PATIENCE)
        while not page.sent and time.monotonic() < limit:
            await asyncio.sleep(0.01)
        page.end()
        release.clear()
        return page.sent

    monkeypatch.setattr(encoders, "encode_array", encode_slowly)
    assert asyncio.run(draw(False)) == [("image/png", [b"d"])]
    assert asyncio.run(draw(True)) == []


def test_interrupt_ends_it(server):
    process, address = server
    process.send_signal(signal.SIGINT)
    process.wait(timeout=PATIENCE)
    with pytest.raises(ConnectionRefusedError):
        ask(address, ["GET / HTTP/1.1"])
    assert "Traceback" not in process.stderr.read()
