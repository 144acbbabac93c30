"""The viewer in a web page: a browser drags, and sees what the controls foretell."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import chromium
import pytest
from cubes import CUBE_FACES, CUBE_VERTICES
from viewing import (
    PATIENCE,
    ask,
    command,
    cookie,
    join,
    mouse,
    next_picture,
    next_told,
    place_of,
    press,
    say,
    serving,
    shown,
    viewing,
    wait_for,
    wait_until,
)

import rasterjit as rj
from rasterjit.viewer import browser
from rasterjit.viewer.viewer import Viewer

pytestmark = pytest.mark.takes_long

PROMPT = 3.0
"""Seconds in which a process ends that promises to in one, on a loaded machine."""


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "cube.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in CUBE_VERTICES]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in CUBE_FACES]
    path.write_text("\n".join(lines) + "\n")
    return path


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
def drawing():
    """A viewer whose first picture takes longer than any test."""
    with viewing("-c", program("time.sleep(1000)")) as found:
        yield found


COMPILES = (
    "from rasterjit.runtime.progress import _TEXT_SHOWERS as t; time.sleep(1); t[-1]('1 of 2')"
)


@pytest.fixture
def compiling():
    """A viewer that says how far compiling is, and gets no farther."""
    with viewing("-c", program(f"{COMPILES}; time.sleep(1000)")) as found:
        yield found


@pytest.fixture(scope="module")
def page(server, tmp_path_factory):
    path = chromium.program()
    if path is None and not os.environ.get("CI"):
        pytest.skip("no Chromium")
    assert path is not None
    with chromium.chromium(path, tmp_path_factory.mktemp("profile")) as page:
        yield page


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
def test_page_shows_what_the_controls_foretell(page, server, model):
    _, address = server
    page.open(address, 320)
    size = tuple(page.evaluate("[innerWidth, innerHeight]"))
    scene = rj.load(model)
    mine = Viewer(scene, size=size)
    first = reference(scene, mine.camera, size)
    wait_for(page, first)
    drag(page, mine, (100, 100), (160, 70))
    turned = reference(scene, mine.camera, size)
    assert (turned != first).any(axis=2).mean() > 0.1
    wait_for(page, turned)
    page.call("Input.dispatchMouseEvent", type="mouseWheel", x=80, y=60, deltaX=0, deltaY=-400)
    mine.draw()
    mine.handle({"event_type": "wheel", "x": 80, "y": 60, "dx": 0, "dy": -400})
    settle(mine)
    wait_for(page, reference(scene, mine.camera, size))
    # Keys work though nothing was clicked but the picture.
    press(page, "r")
    wait_for(page, first)
    mine.close()


def test_page_comes_from_this_machine_alone(page, server):
    _, address = server
    page.open(address, 320)
    address = f"http://{place_of(address)[0]}/"
    local = (address, "blob:", "data:", address.replace("http", "ws"))
    assert all(one.startswith(local) for one in page.requested)


UPGRADE = [
    "Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
]  # fmt: skip


def test_other_sites_are_kept_out(server):
    own, token = place_of(server[1])
    known = f"Cookie: {cookie(token)}"
    for path in (f"/{token}/", "/"):
        page = [f"GET {path} HTTP/1.1", known]
        assert " 200 " in ask(server[1], [*page, f"Host: {own}"])[0]
        assert " 403 " in ask(server[1], [*page, "Host: elsewhere.example"])[0]
    page = ["GET /socket HTTP/1.1", f"Host: {own}", known, *UPGRADE]
    assert " 101 " in ask(server[1], [*page, f"Origin: http://{own}"])[0]
    host = own.split(":")[0]
    for other in ("http://elsewhere.example", f"http://{host}:1", f"http://{own}.example", "null"):
        assert " 403 " in ask(server[1], [*page, f"Origin: {other}"])[0], other


def test_nothing_is_told_without_the_token(server):
    own, token = place_of(server[1])
    name, _ = cookie(token).split("=")
    paths = (
        "/", "/viewer.html", "/viewer.js", "/socket", f"/{token}", f"/{token[:-1]}/", f"/{token}x/",
        f"//{token}/", f"/x/{token}/", f"/?token={token}", "/%ff/", f"/{token}/x/viewer.js",
    )  # fmt: skip
    wrong = (
        "x=y",
        f"{name}={token[:-1]}",
        f"{name}x={token}",
        f"x={token}",
        name,
        f"{name}=",
        "=;",
    )
    for path in paths:
        for header in ("Accept: text/html", *(f"Cookie: {one}" for one in wrong)):
            page = [f"GET {path} HTTP/1.1", f"Host: {own}", header]
            for lines in (page, [*page, *UPGRADE, f"Origin: http://{own}"]):
                assert " 403 " in ask(server[1], lines)[0], (path, header)
    script = ["GET /viewer.js HTTP/1.1", f"Host: {own}", f"Cookie: a=b; {cookie(token)}; c=d"]
    assert " 200 " in ask(server[1], script)[0]
    # With it there is the page and its socket, and nothing else.
    for path, status in (("/none", " 404 "), ("/../tab.py", " 404 "), ("/%2e%2e/tab.py", " 404 ")):
        assert status in ask(server[1], [f"GET {path} HTTP/1.1", *script[1:]])[0]
    assert " 405 " in ask(server[1], ["POST / HTTP/1.1", *script[1:]])[0]
    # The address lets in the page alone.
    page = [f"GET /{token}/ HTTP/1.1", f"Host: {own}", *UPGRADE, f"Origin: http://{own}"]
    assert " 403 " in ask(server[1], page)[0]


def test_token_becomes_a_cookie_that_no_script_and_no_other_site_gets(server):
    own, token = place_of(server[1])
    _, headers = ask(server[1], [f"GET /{token}/ HTTP/1.1", f"Host: {own}"])
    told = cookie(token).lower()
    assert headers["set-cookie"] == f"{told}; path=/; httponly; samesite=strict"
    for known in ("Cookie: x=y", f"Cookie: {cookie(token)}"):
        _, headers = ask(server[1], ["GET / HTTP/1.1", f"Host: {own}", known])
        assert "set-cookie" not in headers


def test_answers_are_not_framed_guessed_kept_or_told_of(server):
    own, token = place_of(server[1])
    for asked in (f"/{token}/", "/", "/viewer.css", "/viewer.js", "/none"):
        for known in ("x=y", cookie(token)):
            request = [f"GET {asked} HTTP/1.1", f"Host: {own}", f"Cookie: {known}"]
            _, headers = ask(server[1], request)
            policy = headers["content-security-policy"]
            assert headers["x-frame-options"] == "deny"
            assert "frame-ancestors 'none'" in policy
            assert "default-src 'none'; script-src 'self'; style-src 'self';" in policy
            assert "unsafe" not in policy
            assert headers["x-content-type-options"] == "nosniff"
            assert headers["referrer-policy"] == "no-referrer"
            assert headers["cache-control"] == "no-store"
            assert headers["content-type"].startswith("text/")


def wait_for_size(page, size):
    while next_picture(page).size != size:
        pass


@pytest.mark.needs_jit
def test_page_cannot_end_it_nor_take_the_view_of_another(running):
    process, address = running
    with join(address) as first, join(address) as second:
        say(first, "resize", pwidth=64, pheight=48, ratio=1)
        wait_for_size(first, (64, 48))
        for text in ("{", "[]", '{"type": []}', '{"type": "close"}', '{"type": "view", "eye": 3}'):
            second.send(text)
        say(second, "resize", pwidth=640, pheight=16, ratio=1)
        wait_for_size(second, (640, 16))
        second.close()
        # The first one is still there, and has its own size.
        press = {"key": "ArrowLeft", "modifiers": []}
        say(first, "key_down", **press)
        say(first, "key_up", **press)
        assert next_picture(first).size == (64, 48)
    with join(address) as third:
        exceptions = pytest.importorskip("websockets.exceptions")
        third.send("x" * (browser.MAX_MESSAGE_BYTES + 1))
        with pytest.raises(exceptions.ConnectionClosed):
            next_told(third, lambda told: False)
        assert third.close_code == 1009
    assert process.poll() is None


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_page_is_there_while_it_is_drawn_and_ends_at_once(drawing, number):
    process, address = drawing
    own, token = place_of(address)
    assert " 200 " in ask(address, [f"GET /{token}/ HTTP/1.1", f"Host: {own}"])[0]
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
def test_page_says_what_it_waits_for_until_there_is_a_picture(page, server, drawing, compiling):
    page.open(drawing[1], 320)
    assert wait_until(page, WAITING)
    # Nothing compiles: that is not said either.
    assert wait_until(page, "waiting.innerText") == "Drawing the first picture."
    page.open(compiling[1], 320)
    wait_until(page, "waiting.innerText === 'Drawing the first picture: 1 of 2.'")
    page.open(server[1], 320)
    wait_until(page, f"!({WAITING})")
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
    first, *more = browser.describe_address(host, 80, "abc")
    assert f"open {address} in" in first
    assert bool(more) == bool(warned)
    assert all(warned in line and "encrypted" in line and "abc" not in line for line in more)


def test_page_has_shown_no_picture_that_was_not_sent():
    async def send(message):
        said.append(message["bytes"])
        await asyncio.Event().wait()

    async def fill():
        outbox = browser._Outbox()
        sending = asyncio.create_task(outbox.send_all(send))
        for number in range(5):
            outbox.put(bytes([0, 0, 1, number]))
        while not said:
            await asyncio.sleep(0)
        sending.cancel()
        return outbox.sent

    said = []
    assert asyncio.run(fill()) == 256
    assert said == [bytes([0, 0, 1, 0])]


def test_more_pages_than_there_may_be_are_kept_out():
    async def app(scope, receive, send):
        await release.wait()

    async def send(message):
        said.append(message["type"])

    async def crowd():
        nonlocal release
        release = asyncio.Event()
        guard = browser.authorize(app, "127.0.0.1", "abc")
        headers = [(b"host", b"localhost"), (b"cookie", cookie("abc").encode())]
        scope = {"type": "websocket", "path": "/socket", "headers": headers, "client": ("a", 1)}
        pages = [
            asyncio.create_task(guard(scope, None, send)) for _ in range(browser.MAX_PAGES + 1)
        ]
        await asyncio.wait(pages, timeout=PATIENCE, return_when=asyncio.FIRST_COMPLETED)
        assert said == ["websocket.close"]
        release.set()
        await asyncio.gather(*pages)
        await guard(scope, None, send)
        assert said == ["websocket.close"]

    release, said = None, []
    asyncio.run(crowd())


def status_of(headers, path="/abc/", bound="localhost"):
    """Return the status with which a page that is served at a host answers a request."""

    async def app(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message):
        said.append(message)

    said = []
    scope = {"type": "http", "path": path, "headers": headers}
    asyncio.run(browser.authorize(app, bound, "abc")(scope, None, send))
    return said[0]["status"]


def status(bound, asked, origin=None):
    """Return the status for what the headers of a request say."""
    headers = [(b"host", asked), (b"origin", origin)]
    return status_of([(name, as_bytes(it)) for name, it in headers if it is not None], bound=bound)


def as_bytes(text):
    return text if isinstance(text, bytes) else text.encode()


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


@pytest.mark.parametrize(
    "asked",
    [
        "[::1]@elsewhere.example", "[::1]elsewhere.example", "localhost@elsewhere.example",
        "elsewhere.example@localhost", "elsewhere.example:80@127.0.0.1:8765", "localhost:x",
        "localhost:80@elsewhere.example", "localhost:", "localhost:80:80", "localhost:123456",
        "[::1%25@elsewhere.example]", "[::1%x]", "[127.0.0.1]", "[localhost]", "::1", "[::1",
        "localhost/elsewhere.example", "localhost#", "localhost ", "localhost,127.0.0.1", "", "[]",
        "127.0.0.1\u00b2", "http://localhost",
    ],
)  # fmt: skip
def test_host_is_a_name_or_an_address_and_a_port_alone(asked):
    for bound in ("localhost", "127.0.0.1", "0.0.0.0", "::1"):
        assert status(bound, asked.encode("latin-1")) == 403, bound


@pytest.mark.parametrize(
    "origin",
    [
        "http://localhost:8765@elsewhere.example", "http://elsewhere.example@localhost:8765",
        "chrome-extension://localhost:8765", "localhost:8765", "//localhost:8765", "http://",
        "http://localhost:8765/", "http://x://localhost:8765", "null", "",
    ],
)  # fmt: skip
def test_origin_is_this_page_alone(origin):
    asked = b"localhost:8765"
    assert status("localhost", asked, b"http://LocalHost:8765") == 200
    # Where another server, which encrypts, stands before this one.
    assert status("localhost", asked, b"https://localhost:8765") == 200
    assert status("localhost", asked, origin.encode()) == 403


@pytest.mark.parametrize("name", [b"host", b"origin"])
def test_header_that_comes_twice_is_none(name):
    own = {b"host": b"localhost", b"origin": b"http://localhost"}
    assert status_of([*own.items()]) == 200
    assert status_of([*own.items(), (name.title(), own[name])]) == 403


def test_long_requests_are_refused():
    def status(field, path="/abc/"):
        return status_of([(b"host", b"localhost"), field], path)

    assert status((b"x", b"y" * (browser.MAX_REQUEST_BYTES - 100))) == 200
    for field in (
        (b"x", b"y" * browser.MAX_REQUEST_BYTES),
        (b"y" * browser.MAX_REQUEST_BYTES, b"x"),
    ):
        assert status(field) == 431
    assert status((b"x", b"y"), "/" * browser.MAX_REQUEST_BYTES) == 431


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


def test_server_in_a_thread_ends_when_it_is_told(cube):
    with serving(Viewer(cube, size=(8, 6)), token="a-token-that-is-kept") as (address, stop):
        own, token = place_of(address)
        assert token == "a-token-that-is-kept"
        assert " 200 " in ask(address, [f"GET /{token}/ HTTP/1.1", f"Host: {own}"])[0]
        with join(address) as page:
            say(page, "resize", pwidth=64, pheight=48, ratio=1)
            wait_for_size(page, (64, 48))
            stop()


def test_program_that_holds_its_scene_keeps_nobody_else_waiting(cube):
    class Held(Viewer):
        def twin(self):
            asked.set()
            assert release.wait(PATIENCE)
            return super().twin()

    asked, release = threading.Event(), threading.Event()
    with serving(Held(cube, size=(8, 6))) as (address, _):
        own, token = place_of(address)
        with join(address) as page:
            say(page, "resize", pwidth=64, pheight=48, ratio=1)
            assert asked.wait(PATIENCE)
            assert " 200 " in ask(address, [f"GET /{token}/ HTTP/1.1", f"Host: {own}"])[0]
            release.set()
            wait_for_size(page, (64, 48))


@pytest.mark.parametrize(
    "token",
    [
        "",
        "short",
        "x" * 129,
        "x" * 16,
        "0123" * 8,
        "with spaces in it",
        "a/b/c/d/e/f/g/h/i",
        "ä" * 16,
        5,
        b"x" * 16,
    ],
)
def test_token_that_is_none_is_refused(cube, token, monkeypatch):
    monkeypatch.setattr(Viewer, "draw", lambda self: pytest.fail("drawn"))
    with pytest.raises(ValueError, match="token must be 16 to 128 letters, digits, - and _"):
        rj.show(cube, backend="browser", token=token, size=(8, 6))
    with pytest.raises(ValueError, match="token must be"):
        browser.serve(Viewer(cube, size=(8, 6)), port=0, token=token)


def test_token_is_taken_from_the_environment(model, monkeypatch):
    monkeypatch.setenv("RASTERJIT_TOKEN", "a-token-from-the-environment")
    with viewing(*command(model)) as (_, address):
        assert place_of(address)[1] == "a-token-from-the-environment"


def test_interrupt_ends_it(server):
    process, address = server
    process.send_signal(signal.SIGINT)
    process.wait(timeout=PATIENCE)
    with pytest.raises(ConnectionRefusedError):
        ask(address, ["GET / HTTP/1.1"])
    assert "Traceback" not in process.stderr.read()
