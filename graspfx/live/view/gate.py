"""The gate between a page and viser: only messages in order come in, and a browser that reads slowly waits alone."""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

import msgspec

from graspfx.screen.own_page import refusal, single

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response
    from websockets.typing import Subprotocol

Check = Callable[[Any], bool]
FARTHEST = 1e6  # of a camera [m]
MOST_PIXELS = 1 << 16
LONGEST = 200  # letters of a name


def number(value: object) -> bool:
    """Tell whether a value is a finite number, and no camera is farther away."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= FARTHEST


def vector(length: int) -> Check:
    """Make the check of that many numbers."""
    return lambda value: isinstance(value, list) and len(value) == length and all(map(number, value))


def pixels(value: object) -> bool:
    """Tell whether a value is a count of pixels."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MOST_PIXELS


def name(value: object) -> bool:
    """Tell whether a value is a short text."""
    return isinstance(value, str) and len(value) <= LONGEST


def change(value: object) -> bool:
    """Tell whether a value changes the value of a control, and nothing else of it."""
    if not isinstance(value, dict) or list(value) != ["value"]:
        return False
    new = value["value"]
    return name(new) if isinstance(new, str) else isinstance(new, bool | int | float) and math.isfinite(new)


GIZMO: Mapping[str, Check] = {"name": name, "owner": lambda value: value == ""}
FIELDS: Mapping[str, Mapping[str, Check]] = {  # of each message by its type
    "ViewerCameraMessage": {
        "wxyz": vector(4), "position": vector(3), "look_at": vector(3), "up_direction": vector(3),
        "fov": number, "near": number, "far": number, "image_height": pixels, "image_width": pixels,
    },
    "GuiUpdateMessage": {"uuid": name, "updates": change},
    "TransformControlsUpdateMessage": {**GIZMO, "wxyz": vector(4), "position": vector(3)},
    "TransformControlsDragStartMessage": GIZMO,
    "TransformControlsDragEndMessage": GIZMO,
}  # fmt: skip


def message_in(data: str | bytes) -> dict[str, Any] | None:
    """Read a message; None where it is none, or none that has an effect here.

    Args:
        data: as it came from the socket.
    """
    if not isinstance(data, bytes):
        return None
    try:
        message = msgspec.msgpack.decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError):
        return None
    if not isinstance(message, dict):
        return None
    kind = message.get("type")
    checks = FIELDS.get(kind) if isinstance(kind, str) else None
    if checks is None or message.keys() - {"type"} != checks.keys():
        return None
    return message if all(check(message[key]) for key, check in checks.items()) else None


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
