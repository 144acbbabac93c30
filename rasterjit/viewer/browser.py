"""The viewer in a web page, which this process serves."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Awaitable, Callable
from typing import Any

from rasterjit.viewer.canvas import FRAME_RATE, Connection
from rasterjit.viewer.viewer import Viewer

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8765

LARGEST_PORT = 65535

GRACE = 1
"""Time for pages to go when the server is stopped, seconds."""

BAD_REQUEST, POLICY_VIOLATION = 400, 1008
"""Status of HTTP, and code of a websocket, for who may not come in."""

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
  </style>
  <script type="module" src="renderview.js"></script>
  <script type="module" src="renderview-client.js"></script>
</head>
<body><div id="canvas" class="renderview-wrapper" style="width: 100%; height: 100%"></div></body>
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
            f"host and port must be free to listen at, got {host}:{port} ({error.strerror}); port "
            "0 takes any that is free"
        ) from error


def serve(
    viewer: Viewer,
    host: str = DEFAULT_HOST,
    port: int = DEFAULT_PORT,
    announce: Callable[[str], None] = print,
) -> None:
    """
    Serve a page that shows a viewer, until the process is interrupted.

    Who opens the page first moves the camera; others see the same. Pages of other sites are kept
    out, but not people: whoever reaches the host may look.

    Parameters
    ----------
    viewer : Viewer
    host : str
        Default: the machine itself, which no other reaches.
    port : int
        0 takes any that is free.
    announce : callable
        Is told where the page is, in words.

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
        place = listening.getsockname()[1]
        # What has to be compiled is compiled before a page can ask for it.
        viewer.draw()
        http.resources["index.html"] = "text/html", PAGE
        canvas = _complete(http.RenderCanvas)(
            size=viewer.size, title=viewer.name, max_fps=FRAME_RATE
        )
        Connection(viewer, canvas)
        shown = f"[{host}]" if ":" in host else host
        announce(f"open http://{shown}:{place} in a browser; Ctrl-C ends it")
        if not _is_loopback(host):
            announce(f"whoever reaches {host} can look at it and move the camera")
        config = uvicorn.Config(
            guarded(http.asgi, host), log_level="warning", timeout_graceful_shutdown=GRACE
        )
        server = uvicorn.Server(config)

        def stop(event: dict[str, Any]) -> None:
            server.should_exit = True

        # The canvas takes Ctrl-C for itself, and closes.
        canvas.add_event_handler(stop, "close")
        try:
            server.run(sockets=[listening])
        finally:
            canvas.close()


def _complete(canvas: type) -> type:
    """
    Return a kind of canvas whose last picture always arrives.

    That of rendercanvas 2.7 drops a picture that is ready while two are on their way, if no other
    follows: the page would keep the compressed one.
    """

    class Page(canvas):
        """Looks for a picture that waits whenever the page has shown one."""

        def _maybe_draw(self) -> None:
            super()._maybe_draw()
            self._send_last_frame_to_ready_clients()

    return Page


def guarded(app: App, host: str) -> App:
    """
    Return an application that pages of other sites cannot use.

    A page may open a websocket to any address, this machine's own too, and a name of another site
    may be made to lead here; both say so in the headers ``Origin`` and ``Host``. Addresses in
    numbers are nobody's name.
    """
    own = {host.casefold(), "localhost"}
    if not _is_loopback(host):
        own |= _names_of_this_machine()

    async def guard(scope: dict[str, Any], receive: Any, send: Any) -> None:
        if scope["type"] == "lifespan" or _may_enter(scope, host, own):
            await app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": POLICY_VIOLATION})
        else:
            headers = [(b"content-type", b"text/plain")]
            start = {"type": "http.response.start", "status": BAD_REQUEST, "headers": headers}
            await send(start)
            await send({"type": "http.response.body", "body": b"unknown host"})

    return guard


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
