"""Connections that ask for nothing, or never to the end, are few, short, and keep no page out."""

from __future__ import annotations

import logging
import socket
import time
from contextlib import suppress

import pytest
from viewing import PATIENCE, ask, cookie, join, next_picture, place_of, say, serving

from rasterjit.viewer import browser
from rasterjit.viewer.viewer import Viewer

pytest.importorskip("simplejpeg")
connections = pytest.importorskip("rasterjit.viewer.connections")

FEW = 5
"""Connections."""

SHORT, LONG = 0.5, 3.0
"""Seconds for who asks for nothing, and for who is answered on a loaded machine."""


@pytest.fixture
def address(cube, monkeypatch):
    monkeypatch.setattr(connections, "MAX_CONNECTIONS", FEW)
    monkeypatch.setattr(connections, "MAX_AGE_SECONDS", 1000.0)
    with serving(Viewer(cube, size=(8, 6))) as (address, _):
        yield address


def connect(address):
    host, port = place_of(address)[0].split(":")
    return socket.create_connection((host, int(port)), timeout=PATIENCE)


def is_closed(connection):
    """Tell whether a connection was closed, without an answer, before one could wait for it."""
    connection.settimeout(0.05)
    try:
        return connection.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionError:
        return True


def answers(address):
    own, token = place_of(address)
    return " 200 " in ask(address, [f"GET /{token}/ HTTP/1.1", f"Host: {own}"])[0]


def rest_of(connection):
    """Return all that comes until the other end closes a connection."""
    said = b""
    with suppress(ConnectionError):
        while part := connection.recv(1 << 16):
            said += part
    return said


BEGUN = b"GET / HTTP/1.1\r\nHost: localhost\r\n"

SOCKET = (
    b"Host: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)
NEVER_SOCKETS = (
    b"GET /" + b"a" * 9000 + b" HTTP/1.1\r\n" + SOCKET,
    b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 200 + SOCKET,
    b"GET / HTTP/1.1\r\nContent-Length: 9\r\n" + SOCKET,
)


@pytest.mark.parametrize("begun", [b"", b"G", BEGUN, BEGUN + b"X: y", *NEVER_SOCKETS])
def test_unfinished_requests_end_after_a_while(address, monkeypatch, begun):
    with connect(address) as patient:
        # It is there before the one that asks.
        assert answers(address)
        monkeypatch.setattr(connections, "MAX_AGE_SECONDS", SHORT)
        with connect(address) as connection, suppress(ConnectionError):
            connection.sendall(begun)
            assert connection.recv(1) == b""
        assert not is_closed(patient)


def test_a_request_that_comes_byte_by_byte_ends_too(address, monkeypatch):
    monkeypatch.setattr(connections, "MAX_AGE_SECONDS", SHORT)
    with connect(address) as connection:
        connection.sendall(BEGUN + b"X: ")
        limit = time.monotonic() + PATIENCE
        while not is_closed(connection):
            assert time.monotonic() < limit
            try:
                connection.sendall(b"y")
            except ConnectionError:
                break


def test_answered_requests_keep_no_connection(address, monkeypatch):
    monkeypatch.setattr(connections, "MAX_AGE_SECONDS", LONG)
    own, token = place_of(address)
    known = f"Host: {own}\r\nCookie: {cookie(token)}\r\n\r\n"
    for begun in ("GET / HTTP/1.1\r\n", "POST / HTTP/1.1\r\nContent-Length: 9\r\n"):
        with connect(address) as connection:
            connection.sendall((begun + known).encode())
            assert rest_of(connection).startswith(b"HTTP/1.1 ")


def test_of_too_many_connections_the_oldest_end(address):
    many = []
    try:
        for _ in range(4 * FEW):
            many.append(connect(address))
            many[-1].sendall(BEGUN)
        # Whoever asks properly is answered meanwhile.
        assert answers(address)
        limit = time.monotonic() + PATIENCE
        while sum(map(is_closed, many)) < 3 * FEW:
            assert time.monotonic() < limit
        left = [not is_closed(one) for one in many]
        assert sum(left) <= FEW
        assert not any(left[: 3 * FEW])
        # One made room for who asked properly.
        assert sum(left) >= FEW - 1
    finally:
        for one in many:
            one.close()


def test_socket_of_a_page_stays(address, monkeypatch):
    monkeypatch.setattr(connections, "MAX_AGE_SECONDS", LONG)
    with join(address) as page:
        say(page, "resize", pwidth=64, pheight=48, ratio=1)
        assert next_picture(page).size == (64, 48)
        crowd = [connect(address) for _ in range(2 * FEW)]
        # Another page that joins lets no one in but itself.
        with join(address):
            pass
        limit = time.monotonic() + PATIENCE
        while not all(map(is_closed, crowd)):
            assert time.monotonic() < limit
        say(page, "resize", pwidth=32, pheight=48, ratio=1)
        while next_picture(page).size != (32, 48):
            pass
        for one in crowd:
            one.close()


@pytest.mark.parametrize("version", [13, 99])
@pytest.mark.parametrize("path", ["/socket", "/none"])
def test_socket_that_is_refused_is_closed(address, path, version):
    own, token = place_of(address)
    request = [
        f"GET {path} HTTP/1.1", f"Host: {own}", "Connection: Upgrade", "Upgrade: websocket",
        f"Sec-WebSocket-Version: {version}", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
    ]  # fmt: skip
    known = [f"Cookie: {cookie(token)}"]
    # With the token only what is a socket stays.
    for lines in (request, *[[*request, *known]] * (path == "/none" or version == 99)):
        with connect(address) as connection:
            connection.sendall("\r\n".join([*lines, "", ""]).encode())
            assert rest_of(connection).startswith(b"HTTP/1.1 40")


def test_long_headers_end_the_connection(address):
    with connect(address) as connection:
        with suppress(ConnectionError):
            connection.sendall(BEGUN + b"X: " + b"y" * (2 * browser.MAX_REQUEST_BYTES))
        said = rest_of(connection)
        assert not said or b" 400 " in said.split(b"\r\n")[0]
    assert answers(address)


MESSAGES = (
    '{"type": "visibility", "hidden": []}', '{"type": "view"}', '{"type": "wheel"}', "{}", "", "[]",
    '{"type": "resize"}', '{"type": "shown"}', '{"type": "pick", "x": 1}', '{"type": "key_down"}',
)  # fmt: skip


def test_wrong_messages_are_said_once_and_the_page_lives(address, monkeypatch):
    said = []
    monkeypatch.setattr(browser.LOGGER, "warning", lambda text, *rest: said.append(text % rest))
    logger = logging.getLogger("uvicorn.error")
    monkeypatch.setattr(logger, "error", lambda *told, **more: said.append(told))
    with join(address) as page:
        for one in MESSAGES:
            page.send(one)
        page.send(b"\x00")
        say(page, "resize", pwidth=64, pheight=48, ratio=1)
        while next_picture(page).size != (64, 48):
            pass
    assert said == [f"passed over what a page may not say: {MESSAGES[0]!r}"]
