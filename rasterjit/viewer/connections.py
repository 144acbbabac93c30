"""
Connections of the page's server: few at a time, each for a short while.

Nobody has shown a token who has only connected, or sends a request byte by byte. A page loads its
few small files in no time; what stays is its socket, which ``browser.authorize`` lets in.
"""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_CONNECTIONS = 64
"""Most connections beside the sockets of pages; a browser opens six."""

MAX_AGE_SECONDS = 20.0
"""Time after which a connection that became no socket is closed, seconds: a browser opens another
one when it needs it."""


class Connections:
    """The connections of a server other than sockets of pages, by age."""

    def __init__(self) -> None:
        self._timers: dict[asyncio.Transport, asyncio.TimerHandle] = {}

    def add(self, transport: asyncio.Transport, loop: asyncio.AbstractEventLoop) -> None:
        """Close a connection after a while, and the oldest one now if there are too many."""
        self._timers[transport] = loop.call_later(MAX_AGE_SECONDS, self._abort, transport)
        if len(self._timers) > MAX_CONNECTIONS:
            self._abort(next(iter(self._timers)))

    def remove(self, transport: asyncio.Transport) -> None:
        """Unregister a connection."""
        timer = self._timers.pop(transport, None)
        if timer is not None:
            timer.cancel()

    def keep(self, client: tuple[str, int]) -> None:
        """Unregister the connection from an address, which became the socket of a page."""
        for transport in list(self._timers):
            if tuple(transport.get_extra_info("peername") or ())[:2] == tuple(client):
                self.remove(transport)

    def _abort(self, transport: asyncio.Transport) -> None:
        self.remove(transport)
        transport.abort()


class ShortConnection(H11Protocol):
    """
    A connection that is closed after a while, or when there are too many.

    One that asks to become a socket goes on by another protocol, and is counted until it is one:
    who never ends its request never becomes one.

    Parameters
    ----------
    others : Connections
    **of_server
        What uvicorn gives to each.
    """

    def __init__(self, others: Connections, **of_server: Any) -> None:
        super().__init__(**of_server)
        self._others = others

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Register the connection."""
        super().connection_made(transport)
        self._others.add(transport, self.loop)

    def connection_lost(self, error: Exception | None) -> None:
        """Unregister the connection."""
        self._others.remove(self.transport)
        super().connection_lost(error)
