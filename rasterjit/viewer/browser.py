"""
The viewer in a web page, which this process serves.

A random token in the page's address lets people in. `guarded` asks for it, for the page and its
socket alike, and passes on only what ``messages`` lists.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import ipaddress
import json
import secrets
import socket
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from typing import Any

from rasterjit.viewer.canvas import FRAME_RATE, PatientConnection, Worker
from rasterjit.viewer.messages import CLOSE, LONGEST_MESSAGE, read_message
from rasterjit.viewer.viewer import Viewer

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8765

LARGEST_PORT = 65535

GRACE = 0.3
"""Time for pages to go when the server is stopped, seconds."""

LOSSLESS = 100
"""Quality of a picture that is sent as it is."""

TOKEN_BYTES = 16

MOST_PAGES = 16
"""Pages that may watch at a time."""

FORBIDDEN, POLICY_VIOLATION, NORMAL_CLOSURE = 403, 1008, 1000
"""Status of HTTP, and code of a websocket, for who may not come in; code for who goes."""

CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src blob: data:; "
    "connect-src 'self' blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)

HEADERS = [
    (b"content-security-policy", CONTENT_POLICY.encode()),
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"no-referrer"),
    (b"cache-control", b"no-store"),
]
"""Of all answers: no other page frames or embeds them, and the token is neither told nor kept."""

PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
  <meta charset="utf-8">
  <meta name="viewport" content="width=device-width, initial-scale=1">
  <title>RasterJIT</title>
  <link rel="icon" href="data:,">
  <link rel="stylesheet" href="renderview.css">
  <style>
    html, body {margin: 0; height: 100%; overflow: hidden; background: #222;}
    #canvas {border: none;}
    #waiting {position: fixed; inset: 0; margin: 0; display: flex; color: #ccc;
      align-items: center; justify-content: center; font: 1.2em sans-serif; pointer-events: none;}
    #canvas:has(img[src]) + #waiting {display: none;}
  </style>
  <script type="module" src="renderview.js"></script>
  <script type="module" src="renderview-client.js"></script>
</head>
<body><div id="canvas" class="renderview-wrapper" style="width: 100%; height: 100%"></div>
<p id="waiting">Drawing the first picture. Compiling kernels for it may take a minute, once.</p>
</body>
</html>
"""

App = Callable[[dict[str, Any], Any, Any], Awaitable[None]]


def bind(host: str, port: int) -> socket.socket:
    """
    Return a socket that listens at a place, or at any free port for 0.

    Raises
    ------
    ValueError
        If the port is none or in use, or the host is not one of this machine.
    """
    if not isinstance(host, str):
        raise ValueError(f"host must be a name or address of this machine, got {host!r}")
    if isinstance(port, bool) or not isinstance(port, int) or not 0 <= port <= LARGEST_PORT:
        raise ValueError(f"port must be a whole number in 0..{LARGEST_PORT}, got {port!r}")
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except (socket.gaierror, UnicodeError) as error:
        raise ValueError(f"host must be a name or address of this machine, got {host!r}") from error
    except PermissionError as error:
        raise ValueError(
            f"port must be one that may be opened, got {port}: {error.strerror}"
        ) from error
    except OSError as error:
        raise ValueError(
            f"port must be free to listen at, got {host}:{port} ({error.strerror}); port "
            "0 takes any that is free"
        ) from error


def serve(
    viewer: Viewer,
    host: str = DEFAULT_HOST,
    port: int = DEFAULT_PORT,
    announce: Callable[[str], None] = print,
    *,
    on_start: Callable[[Callable[[], None]], None] | None = None,
) -> None:
    """
    Serve a page that shows a viewer, until the process is interrupted.

    Who knows the address may look: it has a random token. Who opens the page first moves the
    camera; others see the same. The page is there while the first picture is compiled and drawn.

    Parameters
    ----------
    viewer : Viewer
    host : str
        Default: the machine itself, which no other reaches.
    port : int
        0 takes any that is free.
    announce : callable
        Is told where the page is, in words.
    on_start : callable, optional
        Is handed a function that ends the server, from any thread.

    Raises
    ------
    ImportError
        If what it needs is not installed, naming what to install.
    ValueError
        If it cannot listen there; before anything is drawn.
    """
    try:
        import uvicorn
        import websockets  # noqa: F401
        from rendercanvas import http
    except ImportError as error:
        raise ImportError(
            f'the browser needs a server: pip install "rasterjit[browser]" ({error})'
        ) from error
    with bind(host, port) as listening:
        token = secrets.token_urlsafe(TOKEN_BYTES)
        http.resources["index.html"] = "text/html; charset=utf-8", PAGE
        config = uvicorn.Config(
            guarded(http.asgi, host, token), log_level="warning", access_log=False,
            server_header=False, ws_max_size=LONGEST_MESSAGE, timeout_graceful_shutdown=GRACE,
        )  # fmt: skip
        server = uvicorn.Server(config)

        def stop() -> None:
            server.should_exit = True

        def stop_without_picture(first: Future[Any]) -> None:
            if first.exception() is not None:
                stop()

        canvas = _complete(http.RenderCanvas, stop)(
            size=viewer.size, title=viewer.name, max_fps=FRAME_RATE
        )
        first = PatientConnection(viewer, canvas).first
        first.add_done_callback(stop_without_picture)
        for line in announcement(host, listening.getsockname()[1], token):
            announce(line)
        if on_start is not None:
            on_start(stop)
        try:
            server.run(sockets=[listening])
        finally:
            # One that is still drawn is told that nobody wants it.
            is_there = first.done()
            canvas.end()
        if is_there:
            first.result()


def announcement(host: str, port: int, token: str) -> list[str]:
    """Return what is said of where the page is, as lines."""
    address = _address(host)
    is_everywhere = address is not None and address.is_unspecified
    name = socket.gethostname() if is_everywhere else host
    shown = f"[{name}]" if ":" in name else name
    lines = [f"open http://{shown}:{port}/{token}/ in a browser; Ctrl-C ends it"]
    if not _is_loopback(host):
        where = "all networks of this machine" if is_everywhere else "the network"
        lines.append(
            f"--host {host} opens the page to {where}: whoever has its address looks and moves the "
            "camera, and who listens on the way reads it, since nothing is encrypted"
        )
    return lines


def _complete(canvas: type, stop: Callable[[], None]) -> Any:
    """
    Return a kind of canvas whose last picture always arrives, and that ends after its server.

    That of rendercanvas 2.7 drops a picture that is ready while two are on their way, if no other
    follows: the page would keep the compressed one. It takes Ctrl-C for itself, and closes in the
    midst of whatever runs. It compresses without loss, which may take seconds, while all else
    waits, Ctrl-C too.
    """
    from rendercanvas.core.encoders import encode_array

    encoder = Worker()

    class Page(canvas):
        """Looks for a picture that waits whenever the page has shown one."""

        def _maybe_draw(self) -> None:
            super()._maybe_draw()
            self._send_last_frame_to_ready_clients()

        def _lossless_draw(self) -> None:
            if self._lossless_draw_info is None:
                return
            (picture, _), self._lossless_draw_info = self._lossless_draw_info, None
            number, loop = self._ref_index, asyncio.get_running_loop()

            def send(coded: Future[tuple[str, bytes]]) -> None:
                # No other picture came meanwhile.
                if self._ref_index == number:
                    self._send_lossless(*coded.result())

            def finish(coded: Future[tuple[str, bytes]]) -> None:
                # The server may have ended.
                with contextlib.suppress(RuntimeError):
                    loop.call_soon_threadsafe(send, coded)

            coding = encoder.submit(lambda: encode_array(picture, LOSSLESS))
            coding.add_done_callback(finish)

        def _send_lossless(self, kind: str, data: bytes) -> None:
            told = {"type": "framebufferdata", "nbuffers": 1, "mimetype": kind, "index": 0}
            self._last_frame = {**told, "timestamp": time.time()}, [data]
            self._ref_index += 1
            self._send_last_frame_to_ready_clients()

        def close(self) -> None:
            """Ask the server to end."""
            stop()

        def end(self) -> None:
            """Close, when the server has ended."""
            super().close()
            encoder.close()

    return Page


def guarded(app: App, host: str, token: str) -> App:
    """
    Return an application that only those use who know the token, and only as its page does.

    The token is the first part of the path, ``/token/``. Pages of other sites are kept out besides:
    a page may open a websocket to any address, this machine's own too, and a name of another site
    may be made to lead here; both say so in the headers ``Origin`` and ``Host``. Addresses in
    numbers are nobody's name.
    """
    own = {host.casefold(), "localhost"}
    if not _is_loopback(host):
        own |= _names_of_this_machine()
    pages: set[object] = set()

    async def guard(scope: dict[str, Any], receive: Any, send: Any) -> None:
        if scope["type"] == "lifespan":
            await app(scope, receive, send)
            return
        may_enter = _knows(scope["path"], token) and _may_enter(scope, host, own)
        if scope["type"] == "http":
            answer = app if may_enter else _forbid
            await answer(scope, receive, _with_headers(send))
        elif may_enter and len(pages) < MOST_PAGES:
            page = object()
            pages.add(page)
            try:
                await _listed(app, scope, receive, send)
            finally:
                pages.discard(page)
        else:
            await send({"type": "websocket.close", "code": POLICY_VIOLATION})

    return guard


async def _forbid(scope: dict[str, Any], receive: Any, send: Any) -> None:
    """Answer who may not come in."""
    headers = [(b"content-type", b"text/plain; charset=utf-8")]
    await send({"type": "http.response.start", "status": FORBIDDEN, "headers": headers})
    await send({"type": "http.response.body", "body": b"open the address that the viewer printed"})


def _with_headers(send: Any) -> Any:
    """Return what sends an answer with the headers of all answers."""

    async def send_with_headers(message: dict[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message["headers"], *HEADERS]}
        await send(message)

    return send_with_headers


async def _listed(app: App, scope: dict[str, Any], receive: Any, send: Any) -> None:
    """Let a page talk to an application in messages of the list; others are passed over."""
    sent, is_closed = 0, False

    async def receive_listed() -> dict[str, Any]:
        nonlocal is_closed
        while True:
            event = await receive()
            if event["type"] != "websocket.receive":
                return event
            message = read_message(event.get("text"), sent)
            if message is None:
                continue
            if message["type"] == CLOSE:
                # To the application it would mean that all is over.
                is_closed = True
                return {"type": "websocket.disconnect", "code": NORMAL_CLOSURE}
            return {"type": "websocket.receive", "text": json.dumps(message)}

    async def send_counted(message: dict[str, Any]) -> None:
        nonlocal sent
        # A picture is the only thing that is sent in bytes.
        sent += message.get("bytes") is not None
        await send(message)

    await app(scope, receive_listed, send_counted)
    if is_closed:
        await send({"type": "websocket.close", "code": NORMAL_CLOSURE})


def _knows(path: str, token: str) -> bool:
    """Tell whether a path begins with the token, in a time that does not depend on it."""
    parts = path.split("/")
    known = parts[1] if len(parts) == 3 and not parts[0] else ""
    return hmac.compare_digest(known.encode(errors="replace"), token.encode())


def _may_enter(scope: dict[str, Any], host: str, own: set[str]) -> bool:
    """Tell whether a request is for this host, by a name of its own, and from its own page."""
    headers = {name.lower(): value.decode("latin-1") for name, value in scope["headers"]}
    asked = headers.get(b"host", "").casefold()
    name = asked[1:].split("]", 1)[0] if asked.startswith("[") else asked.rsplit(":", 1)[0]
    # Who listens to this machine alone is asked by it alone.
    is_number = _is_loopback(name) if _is_loopback(host) else _address(name) is not None
    if name not in own and not is_number:
        return False
    origin = headers.get(b"origin")
    return origin is None or origin.casefold().split("://", 1)[-1] == asked


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Return an address in numbers; None for a name."""
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


def _is_loopback(host: str) -> bool:
    """Tell whether a host is one that only programs on the same machine reach."""
    address = _address(host)
    return host.casefold() == "localhost" if address is None else address.is_loopback


def _names_of_this_machine() -> set[str]:
    """Return the names by which others know this machine, lower case."""
    name = socket.gethostname().casefold()
    return {name, socket.getfqdn().casefold(), f"{name.split('.', 1)[0]}.local"}
