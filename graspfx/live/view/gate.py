"""Access control between browsers and viser: only valid messages pass, and a slow browser does not delay others."""

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
FARTHEST = 1e6  # farthest position of a camera [m]
MOST_PIXELS = 1 << 16
LONGEST = 200  # longest name


def number(value: object) -> bool:
    """Tell whether a value is a finite number within `FARTHEST`."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= FARTHEST


def vector(length: int) -> Check:
    """Return a check for a list of `length` numbers."""
    return lambda value: isinstance(value, list) and len(value) == length and all(map(number, value))


def pixels(value: object) -> bool:
    """Tell whether a value is a count of pixels."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MOST_PIXELS


def name(value: object) -> bool:
    """Tell whether a value is a short text."""
    return isinstance(value, str) and len(value) <= LONGEST


def change(value: object) -> bool:
    """Tell whether an update changes only the value of a control."""
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
    """Decode a message; None if it is invalid or not allowed.

    Args:
        data: Data received from the socket.
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


LARGEST = 1 << 16  # largest message from a page in bytes
MOST_PAGES = 16  # most pages at a time
MOST_BAD = 1000  # invalid messages after which a connection is closed
UNSENT = 1 << 18  # send buffer of a browser in bytes; newer data replace those that wait for it
VIOLATION = 1008  # close code of RFC 6455
POLICY = (  # the page loads nothing from elsewhere, and no other site may embed it
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; media-src data: blob:; worker-src blob: data:; "
    "connect-src 'self' ws://127.0.0.1:* ws://localhost:* data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


class Gate:
    """Access control for all connections of a page.

    Args:
        accepts: Function that tells whether a well-formed message fits the existing controls.

    Attributes:
        pages: Number of open connections.
        bad: Number of rejected messages of all connections.
    """

    def __init__(self, accepts: Callable[[dict[str, Any]], bool]) -> None:
        self.accepts = accepts
        self.pages = 0
        self.bad = 0

    def answer(
        self, connection: ServerConnection, request: Request, serve: Callable[[Any, Any], Response | None]
    ) -> Response | None:
        """Answer a request; None accepts a WebSocket from this machine's own page."""
        is_socket = request.headers.get("Upgrade", "").lower() == "websocket"
        headers = single(request.headers)
        if headers is None:
            return connection.respond(HTTPStatus.BAD_REQUEST, "a header occurs twice\n")
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
        """Pass a connection to viser, filtered, until it ends."""
        if connection.subprotocol != protocol:
            await connection.close(VIOLATION, "this page is of another version: reload it")
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
    """Connection for viser that delivers only valid messages.

    Args:
        connection: Connection to a page.
        gate: Access control.
    """

    def __init__(self, connection: ServerConnection, gate: Gate) -> None:
        self._connection, self._gate = connection, gate
        self.subprotocol: Subprotocol | None = connection.subprotocol
        self.close = connection.close
        self.send = connection.send

    async def recv(self) -> bytes:
        """Wait for a valid message."""
        bad = 0
        while True:
            data = await self._connection.recv()
            message = message_in(data)
            if message is not None and isinstance(data, bytes) and self._gate.accepts(message):
                return data
            bad += 1
            self._gate.bad += 1
            if bad >= MOST_BAD:
                await self._connection.close(VIOLATION, "too many invalid messages")
            elif bad % 32 == 0:
                await asyncio.sleep(0)  # serves others while one floods
