"""
Connections of the page's server: few at a time, each for a short while.

Nobody has shown a token who has only connected, or sends a request byte by byte. A page loads its
few small files in no time; what stays is its socket, which ``browser.guarded`` lets in.
"""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS = 64
"""Connections beside the sockets of pages; a browser opens six."""

CLOSED_AFTER = 20.0
"""Time after which a connection that became no socket is closed, seconds: a browser opens another
one when it needs it."""


class ShortConnection(H11Protocol):
    """
    A connection that is closed after a while, or when there are too many, unless it is a socket.

    Parameters
    ----------
    others : dict
        The connections of the server that are no sockets, by age: the oldest one goes first.
    **of_server
        What uvicorn gives to each.
    """

    def __init__(
        self, others: dict[ShortConnection, asyncio.TimerHandle], **of_server: Any
    ) -> None:
        super().__init__(**of_server)
        self._others = others

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin, and end the oldest one if there are too many."""
        super().connection_made(transport)
        self._others[self] = self.loop.call_later(CLOSED_AFTER, self._end)
        if len(self._others) > MOST_CONNECTIONS:
            next(iter(self._others))._end()

    def connection_lost(self, error: Exception | None) -> None:
        """Be one less."""
        self._leave()
        super().connection_lost(error)

    def data_received(self, data: bytes) -> None:
        """Take in what comes; a socket goes on as one, by another protocol."""
        super().data_received(data)
        if self.transport.get_protocol() is not self:
            self._leave()

    def _leave(self) -> None:
        timer = self._others.pop(self, None)
        if timer is not None:
            timer.cancel()

    def _end(self) -> None:
        self._leave()
        self.transport.abort()
