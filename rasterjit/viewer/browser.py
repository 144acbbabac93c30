"""
The viewer in a web page, which this process serves.

A random token lets people in: the address that is printed has it, and the page that is opened
there keeps it as a cookie. `authorize` asks for it, for the page and its socket alike, and keeps
other sites out. Each page has a viewer of its own, which `Tab` drives; what it may say,
``protocol`` lists.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import hmac
import ipaddress
import json
import logging
import re
import secrets
import socket
from collections import deque
from collections.abc import Awaitable, Callable, Iterator, Sequence
from concurrent.futures import Future
from functools import partial
from importlib import resources
from typing import Any, cast

from rasterjit.runtime.progress import also_show_progress_by
from rasterjit.scene.validation import brief, needs_extra
from rasterjit.viewer.browser_session import PICTURE_NUMBER_BYTES, BrowserSession, Send
from rasterjit.viewer.canvas import Worker
from rasterjit.viewer.protocol import MAX_MESSAGE_BYTES, read_message
from rasterjit.viewer.viewer import Viewer

LOGGER = logging.getLogger("rasterjit.viewer")

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8765

MAX_PORT = 65535

STOP_TIMEOUT_SECONDS = 0.3
"""Seconds that the server waits for pages when it stops."""

TOKEN_BYTES = 16

TOKEN = re.compile(r"[A-Za-z0-9_-]{16,128}")
"""Format of a given token."""

MIN_DISTINCT_CHARACTERS = 5
"""Least number of different characters in a token: one in 10,000 of 16 random digits has fewer."""

COOKIE_HASH_DIGITS = 8
"""Of a hash of the token, in the name of its cookie: cookies of all ports of a host are sent to
each, so viewers beside each other need names of their own."""

MAX_PAGES = 16
"""Most pages open at a time."""

MAX_REQUEST_BYTES = 32768
"""Most bytes of a request's path and headers; cookies of all ports of a host come along."""

HOST_HEADER = re.compile(r"(?:\[(?P<number>[0-9a-f:.]+)\]|(?P<name>[a-z0-9_.-]+))(?::[0-9]{1,5})?")
"""Format of the header ``Host``: an address of IPv6 in brackets or a name, and a port."""

HTTP_OK, FORBIDDEN, NOT_FOUND, NOT_ALLOWED, TOO_LARGE = 200, 403, 404, 405, 431
"""HTTP status codes."""

POLICY_VIOLATION = 1008
"""Websocket close code for unauthorized clients."""

CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)

HEADERS = [
    (b"content-security-policy", CONTENT_POLICY.encode()),
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"no-referrer"),
    (b"cache-control", b"no-store"),
]
"""Headers of all answers: no other page frames or embeds them, nothing is cached or referred to."""

SCRIPTS = ("address", "connection", "gestures", "viewer")

HTML = "text/html; charset=utf-8"

SCRIPT = "text/javascript; charset=utf-8"

FILES = {
    "/": ("viewer.html", HTML),
    "/viewer.css": ("viewer.css", "text/css; charset=utf-8"),
    **{f"/{name}.js": (f"{name}.js", SCRIPT) for name in SCRIPTS},
}
"""Files of the folder ``page`` by URL path."""

SOCKET_PATH = "/socket"
"""Path of the websocket."""

App = Callable[[dict[str, Any], Any, Any], Awaitable[None]]


def bind(host: str, port: int) -> socket.socket:
    """
    Return a socket that listens at a host and port; at any free port for 0.

    Raises
    ------
    ValueError
        If the port is none or in use, or the host is not one of this machine.
    """
    if not isinstance(host, str):
        raise ValueError(f"host must be a name or address of this machine, got {host!r}")
    if isinstance(port, bool) or not isinstance(port, int) or not 0 <= port <= MAX_PORT:
        raise ValueError(f"port must be a whole number in 0..{MAX_PORT}, got {port!r}")
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


def check_token(token: Any) -> str:
    """
    Check a token, and return it.

    Raises
    ------
    ValueError
        If it is not 16 to 128 letters, digits, ``-`` and ``_``, at least five of them different.
    """
    is_one = isinstance(token, str) and TOKEN.fullmatch(token)
    if not is_one or len(set(token)) < MIN_DISTINCT_CHARACTERS:
        raise ValueError(
            "token must be 16 to 128 letters, digits, - and _, at least "
            f"{MIN_DISTINCT_CHARACTERS} of them different (or not given, for a random one), got "
            + brief(token)
        )
    return token


def serve(
    viewer: Viewer,
    host: str = DEFAULT_HOST,
    port: int = DEFAULT_PORT,
    announce: Callable[[str], None] = print,
    *,
    token: str | None = None,
    on_start: Callable[[Callable[[], None]], None] | None = None,
) -> None:
    """
    Serve a viewer as a web page until the process is interrupted.

    Who knows the address may look: it has a token. Each page is a twin of the viewer, with its own
    size and view. The page is there while the first picture is compiled and drawn.

    Parameters
    ----------
    viewer : Viewer
    host : str
        Default: the machine itself, which no other reaches.
    port : int
        0 takes any that is free.
    announce : callable
        Is told where the page is, in words.
    token : str, optional
        16 to 128 letters, digits, ``-`` and ``_``, hard to guess. Default: a random one. Pages
        that are open find a viewer again that is started anew with the same one, at the same port.
    on_start : callable, optional
        Is handed a function that ends the server, from any thread.

    Raises
    ------
    ImportError
        If what it needs is not installed, naming what to install.
    ValueError
        If it cannot listen there, or the token is none; before anything is drawn.
    """
    with needs_extra("browser", "the browser needs a server"):
        import simplejpeg  # noqa: F401
        import uvicorn
        import websockets  # noqa: F401

        from rasterjit.viewer.connections import Connections, ShortConnection
    secret = secrets.token_urlsafe(TOKEN_BYTES) if token is None else check_token(token)
    with bind(host, port) as listening:
        drawer, notice = Worker(), CompileStatus()
        first = drawer.submit(viewer.draw)
        others = Connections()
        app = authorize(make_application(viewer, first, notice), host, secret, others.keep)
        # What is sent are pictures, which are compressed. Whoever asks for nonsense is answered,
        # and fills nobody's terminal.
        config = uvicorn.Config(
            app, log_level="error", access_log=False, server_header=False, proxy_headers=False,
            http=cast(Any, partial(ShortConnection, others)),
            h11_max_incomplete_event_size=MAX_REQUEST_BYTES,
            ws_max_size=MAX_MESSAGE_BYTES, ws_per_message_deflate=False,
            timeout_graceful_shutdown=STOP_TIMEOUT_SECONDS,
        )  # fmt: skip
        server = uvicorn.Server(config)

        def stop() -> None:
            server.should_exit = True

        def stop_without_picture(first: Future[Any]) -> None:
            if first.exception() is not None:
                stop()

        first.add_done_callback(stop_without_picture)
        try:
            # Who interrupts it wants nothing else.
            with contextlib.suppress(KeyboardInterrupt), also_show_progress_by(notice.send):
                for line in describe_address(host, listening.getsockname()[1], secret):
                    announce(line)
                if on_start is not None:
                    on_start(stop)
                server.run(sockets=[listening])
        finally:
            # One that is still drawn is told that nobody wants it.
            is_there = first.done()
            viewer.close()
            drawer.close()
        if is_there:
            first.result()


def describe_address(host: str, port: int, token: str) -> list[str]:
    """Return lines that tell the address of the page."""
    address = _parse_address(host)
    is_everywhere = address is not None and address.is_unspecified
    name = socket.gethostname() if is_everywhere else host
    authority = f"[{name}]" if ":" in name else name
    lines = [f"open http://{authority}:{port}/{token}/ in a browser; Ctrl-C ends it"]
    if not _is_loopback(host):
        where = "all networks of this machine" if is_everywhere else "the network"
        lines.append(
            f"--host {host} opens the page to {where}: whoever has its address looks and moves the "
            "camera, and who listens on the way reads it, since nothing is encrypted"
        )
    return lines


class CompileStatus:
    """The progress of compiling, sent to all pages."""

    def __init__(self) -> None:
        self._text = ""
        self._listeners: set[Send] = set()

    def send(self, text: str) -> None:
        """Send a text to all pages; an empty text when nothing compiles."""
        self._text = text
        for listener in tuple(self._listeners):
            listener({"type": "compiling", "text": text})

    @contextlib.contextmanager
    def attach(self, tell: Send) -> Iterator[None]:
        """Send texts to a page, too, inside the context."""
        self._listeners.add(tell)
        tell({"type": "compiling", "text": self._text})
        try:
            yield
        finally:
            self._listeners.discard(tell)


def make_application(viewer: Viewer, first: Future[Any], notice: CompileStatus) -> App:
    """Return the ASGI application for the page; each client gets a twin of the viewer."""
    # Making a twin may take long, or wait for a program that holds its scene.
    maker = Worker()

    async def serve_page(scope: dict[str, Any], receive: Any, send: Any) -> None:
        if scope["type"] == "websocket":
            await _serve_socket(maker.submit(viewer.twin), first, notice, receive, send)
            return
        file = FILES.get(scope["path"])
        if scope["method"] != "GET":
            await _send_answer(send, NOT_ALLOWED, b"GET it")
        elif file is None:
            await _send_answer(send, NOT_FOUND, b"there is nothing")
        else:
            name, kind = file
            await _send_answer(send, HTTP_OK, _read_page_file(name), kind)

    return serve_page


async def _serve_socket(
    twin: Future[Viewer], first: Future[Any], notice: CompileStatus, receive: Any, send: Any
) -> None:
    """Serve a twin of a viewer, which is being made, over a websocket until the page closes."""
    await receive()
    await send({"type": "websocket.accept"})
    loop, outbox = asyncio.get_running_loop(), _Outbox()

    def put(message: dict[str, Any] | bytes) -> None:
        # The server may have ended.
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(outbox.put, message)

    sending = asyncio.create_task(outbox.send_all(send))
    try:
        with notice.attach(put):
            # The worker does not know of anybody who waits no more.
            tab = BrowserSession(await asyncio.shield(asyncio.wrap_future(twin)), first, put)
            with contextlib.closing(tab):
                is_said = False
                while (event := await receive())["type"] == "websocket.receive":
                    message = read_message(text := event.get("text"), outbox.sent)
                    if message is not None:
                        tab.queue_message(message)
                    elif not is_said:
                        is_said = True
                        LOGGER.warning("passed over what a page may not say: %s", brief(text))
    finally:
        sending.cancel()


class _Outbox:
    """
    Send queue of a page: pictures, and the latest message of each type.

    A page that reads nothing makes it no longer: pictures wait until others were shown, and what
    was not sent was not shown, whatever the page says.

    Attributes
    ----------
    sent : int
        Number of the last picture that went.
    """

    def __init__(self) -> None:
        self.sent = 0
        self._pictures: deque[bytes] = deque()
        self._messages: dict[str, dict[str, Any]] = {}
        self._is_filled = asyncio.Event()

    def put(self, message: dict[str, Any] | bytes) -> None:
        """Add a picture, or a message that replaces the last one of its type."""
        if isinstance(message, bytes):
            self._pictures.append(message)
        else:
            self._messages[message["type"]] = message
        self._is_filled.set()

    async def send_all(self, send: Any) -> None:
        """Send queued messages until cancelled or the page is gone."""
        with contextlib.suppress(OSError, RuntimeError):
            while True:
                await self._is_filled.wait()
                self._is_filled.clear()
                while self._pictures or self._messages:
                    if self._messages:
                        text = json.dumps(self._messages.pop(next(iter(self._messages))))
                        await send({"type": "websocket.send", "text": text})
                    if self._pictures:
                        picture = self._pictures.popleft()
                        self.sent = int.from_bytes(picture[:PICTURE_NUMBER_BYTES], "big")
                        await send({"type": "websocket.send", "bytes": picture})


def authorize(
    app: App, host: str, token: str, on_socket: Callable[[Any], None] = lambda client: None
) -> App:
    """
    Wrap an application: only clients with the token, and only its own page, may use it.

    The page is opened as ``/token/``, and keeps the token as a cookie, which no script reads and
    which no other site's page sends along; its address loses it. Pages of other sites are kept out
    besides: a page may open a websocket to any address, this machine's own too, and a name of
    another site may be made to lead here; both say so in the headers ``Origin`` and ``Host``.
    Addresses in numbers are nobody's name. ``keep`` is told the address of each page whose socket
    is let in.
    """
    hosts = {host.casefold(), "localhost"}
    if not _is_loopback(host):
        hosts |= _list_host_names()
    pages: set[object] = set()
    name = "rasterjit-" + hashlib.sha256(token.encode()).hexdigest()[:COOKIE_HASH_DIGITS]
    cookie = f"{name}={token}; Path=/; HttpOnly; SameSite=Strict".encode()

    async def authorized(scope: dict[str, Any], receive: Any, send: Any) -> None:
        if scope["type"] == "lifespan":
            await app(scope, receive, send)
            return
        is_token_page = scope["type"] == "http" and _is_equal(scope["path"], f"/{token}/")
        is_long = _measure_request(scope) > MAX_REQUEST_BYTES
        may_enter = not is_long and _is_same_site(scope, host, hosts)
        has_token = is_token_page or _is_equal(_get_cookie(scope, name), token)
        if scope["type"] == "http":
            if is_long:
                await _send_answer(_add_headers(send), TOO_LARGE, b"the request is too long")
            elif not (may_enter and has_token):
                await _send_answer(_add_headers(send), FORBIDDEN, TOKEN_HINT)
            elif is_token_page:
                cookie_headers = [(b"set-cookie", cookie)]
                await app({**scope, "path": "/"}, receive, _add_headers(send, cookie_headers))
            else:
                await app(scope, receive, _add_headers(send))
        elif may_enter and has_token and scope["path"] == SOCKET_PATH and len(pages) < MAX_PAGES:
            page = object()
            pages.add(page)
            on_socket(scope["client"])
            try:
                await app(scope, receive, send)
            finally:
                pages.discard(page)
        else:
            await send({"type": "websocket.close", "code": POLICY_VIOLATION})

    return authorized


TOKEN_HINT = (
    b"Open the address that the viewer printed. If this browser did so before, put this one into "
    b"its address bar."
)
"""Body of the answer to a request without a token."""


async def _send_answer(
    send: Any, status: int, body: bytes, kind: str = "text/plain; charset=utf-8"
) -> None:
    """Answer a request."""
    headers = [(b"content-type", kind.encode()), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


def _read_page_file(name: str) -> bytes:
    """Return the bytes of a file of the page."""
    return (resources.files("rasterjit.viewer") / "page" / name).read_bytes()


def _add_headers(send: Any, others: Sequence[tuple[bytes, bytes]] = ()) -> Any:
    """Return a send function that adds the common headers to answers."""

    async def send_with_headers(message: dict[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message["headers"], *HEADERS, *others]}
        await send(message)

    return send_with_headers


def _is_equal(given: str, expected: str) -> bool:
    """Compare texts in constant time."""
    return hmac.compare_digest(given.encode(errors="replace"), expected.encode())


def _get_cookie(scope: dict[str, Any], name: str) -> str:
    """Return the value of a request's cookie, or an empty string."""
    for value in _get_headers(scope, b"cookie"):
        for one in value.split(";"):
            key, _, content = one.strip().partition("=")
            if key == name:
                return content
    return ""


def _get_headers(scope: dict[str, Any], header: bytes) -> list[str]:
    """Return the values of a request's headers of a name."""
    return [value.decode("latin-1") for name, value in scope["headers"] if name.lower() == header]


def _measure_request(scope: dict[str, Any]) -> int:
    """Return the length of a request's path and headers, bytes."""
    fields = [len(name) + len(value) + len(": \r\n") for name, value in scope["headers"]]
    return len(scope["path"]) + len(scope.get("query_string", b"")) + sum(fields)


def _is_same_site(scope: dict[str, Any], host: str, host_names: set[str]) -> bool:
    """Tell whether a request names this host and comes from its own page."""
    hosts, origins = _get_headers(scope, b"host"), _get_headers(scope, b"origin")
    requested = hosts[0].lower() if len(hosts) == 1 else ""
    match = HOST_HEADER.fullmatch(requested)
    if match is None or len(origins) > 1:
        return False
    name = match["name"] or match["number"]
    address = _parse_address(name)
    if (address is not None and address.version == 6) != (match["number"] is not None):
        return False
    # Who listens to this machine alone is asked by it alone.
    is_number = _is_loopback(name) if _is_loopback(host) else address is not None
    if name not in host_names and not is_number:
        return False
    return not origins or origins[0].lower() in (f"http://{requested}", f"https://{requested}")


def _parse_address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Parse an IP address; None for a name."""
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


def _is_loopback(host: str) -> bool:
    """Tell whether only programs on the same machine reach a host."""
    address = _parse_address(host)
    return host.casefold() == "localhost" if address is None else address.is_loopback


def _list_host_names() -> set[str]:
    """Return the host names of this machine, lower case."""
    name = socket.gethostname().casefold()
    return {name, socket.getfqdn().casefold(), f"{name.split('.', 1)[0]}.local"}
