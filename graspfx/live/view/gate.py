"""The gate between a page and viser: only messages in order come in, and a browser that reads slowly waits alone."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from graspfx.live.view.page_messages import message_in
from graspfx.screen.own_page import refusal, single

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response
    from websockets.typing import Subprotocol

LARGEST = 1 << 16  # bytes of a message from a page
MOST_PAGES = 16  # that look on at a time
MOST_BAD = 1000  # messages without effect, after which a connection is closed
UNSENT = 1 << 18  # bytes on their way to a browser; what is newer replaces what waits behind them
VIOLATION = 1008  # code of a closed connection, RFC 6455
POLICY = (  # whatever the page loads is in it, and no other site shows it in a frame
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; media-src data: blob:; worker-src blob: data:; "
    "connect-src 'self' ws://127.0.0.1:* ws://localhost:* data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


class Gate:
    """A gate that every connection passes through.

    Args:
        accepts: whether a message, in order by itself, fits the controls that there are.

    Attributes:
        pages: connections that are open.
        bad: messages that had no effect, of all connections.
    """

    def __init__(self, accepts: Callable[[dict[str, Any]], bool]) -> None:
        self.accepts = accepts
        self.pages = 0
        self.bad = 0

    def answer(
        self, connection: ServerConnection, request: Request, serve: Callable[[Any, Any], Response | None]
    ) -> Response | None:
        """Answer a request, or let it open a WebSocket (None), if it comes from this machine's own page."""
        is_socket = request.headers.get("Upgrade", "").lower() == "websocket"
        headers = single(request.headers)
        if headers is None:
            return connection.respond(HTTPStatus.BAD_REQUEST, "a header stands twice\n")
        if reason := refusal(headers, is_socket=is_socket):
            return connection.respond(HTTPStatus.FORBIDDEN, f"{reason}\n")
        if is_socket:
            full = f"{MOST_PAGES} pages look on already\n"
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, full) if self.pages >= MOST_PAGES else None
        response = serve(connection, request)
        if response is not None:
            response.headers["Content-Security-Policy"] = POLICY
            response.headers["X-Content-Type-Options"] = "nosniff"
            response.headers["Referrer-Policy"] = "no-referrer"
        return response

    async def enter(self, connection: ServerConnection, handle: Callable[[Any], Any], protocol: str) -> None:
        """Let viser have a connection through the gate until it ends."""
        if connection.subprotocol != protocol:
            await connection.close(VIOLATION, "this page is of another version: load it anew")
            return
        line = connection.transport.get_extra_info("socket")
        if line is not None:
            line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNSENT)
        self.pages += 1
        try:
            await handle(GuardedConnection(connection, self))
        finally:
            self.pages -= 1


class GuardedConnection:
    """A connection as viser has it: its messages are those that the gate lets in.

    Args:
        connection: to a page.
        gate: through which it came.
    """

    def __init__(self, connection: ServerConnection, gate: Gate) -> None:
        self._connection, self._gate = connection, gate
        self.subprotocol: Subprotocol | None = connection.subprotocol
        self.close = connection.close
        self.send = connection.send

    async def recv(self) -> bytes:
        """Wait for a message that is in order."""
        bad = 0
        while True:
            data = await self._connection.recv()
            message = message_in(data)
            if message is not None and isinstance(data, bytes) and self._gate.accepts(message):
                return data
            bad += 1
            self._gate.bad += 1
            if bad >= MOST_BAD:
                await self._connection.close(VIOLATION, "too many messages that are none")
            elif bad % 32 == 0:
                await asyncio.sleep(0)  # a flood lets the others have their turns
