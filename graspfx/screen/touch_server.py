"""Server of the touch-screen page and its WebSocket, which releases the fingers of a lost or silent screen."""

from __future__ import annotations

import secrets
import socket
import struct
from collections.abc import Callable, Mapping
from functools import cache
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from graspfx.screen.claim_server import ClaimServer, Client, Terms, require_websockets, response
from graspfx.screen.gate import Admission, Gate
from graspfx.screen.touch_orders import ORDER, Box, Kind, Order, read_order

if TYPE_CHECKING:
    from websockets.http11 import Response

PAGE = "touch_page.html"
NONCE = "@nonce@"


@cache
def _text() -> str:
    return (Path(__file__).parent / PAGE).read_text("utf-8")


def page_for(host: str) -> tuple[bytes, dict[str, str]]:
    """Return the page for a host, such as 127.0.0.1:8765, and HTTP headers that allow only the page's own script."""
    nonce = secrets.token_urlsafe(16)
    policy = (
        f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src ws://{host}; "
        "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return _text().replace(NONCE, nonce).encode(), {
        "Content-Type": "text/html; charset=utf-8",
        "Content-Security-Policy": policy,
    }


SOCKET = "/socket"
RATE, BURST = 1500.0, 500.0  # limits for a client's orders [1/s], at once
MOST_BYTES = 2 * ORDER.size  # longest message; a longer one ends the connection
HEAD = struct.Struct("<4d")  # number of the last order, bits of own and of claimed fingers, number of dropped orders


class Touched(Protocol):
    """Object that receives the touches of screens; its methods are called in the server's thread and must not block."""

    def press(self, finger: int, place: tuple[float, float]) -> None:
        """Set the position of a finger on the screen [m]."""

    def lift(self, finger: int) -> None:
        """Release a finger, which was lifted, or whose screen is lost or silent."""


class TouchServer(ClaimServer):
    """Server of a page that runs on touch screens.

    Args:
        line: Listening socket, which the server closes at its end.
        gate: Access control of the page.
        fingers: Number of fingers.
        box: Rectangle of valid positions [m].
        scenery: Content of the page that does not move, as JSON.
        touched: Object that receives the touches.
        note: Function that is called with each valid order: number of the client, order, and outcome of the order.

    Attributes:
        counts: Numbers as in `ClaimServer`, and also the numbers of orders that were lost ("lost") and of fingers that
            were released because their screen was lost or silent ("let go: lost", "let go: silence").
        last: Number of the last valid order.

    Raises:
        MissingPackageError: If websockets is not installed.
    """

    def __init__(
        self, line: socket.socket, gate: Gate, fingers: int, box: Box, scenery: str, touched: Touched,
        note: Callable[[int, Order, str], object] | None = None,
    ) -> None:  # fmt: skip
        require_websockets()
        super().__init__(line, "touch screens", gate, Terms(SOCKET, MOST_BYTES, RATE, BURST), scenery)
        self.box, self.last = box, 0
        self._fingers, self._touched, self._note, self._picture = fingers, touched, note, b""

    @property
    def has_touches(self) -> bool:
        """Whether a client has claimed a finger."""
        return bool(self.owners)

    def show(self, picture: bytes) -> None:
        """Send a picture to every screen; a slow screen skips pictures that it cannot receive."""
        self._post(self._set_picture, picture)

    def describe(self, scenery: str) -> None:
        """Send content that does not move to all present screens and to screens that connect later."""
        self._post(self._set_scenery, scenery)

    # In the server's thread ---------------------------------------------------------------------------------------

    def _page(self, path: str, headers: Mapping[str, str], admission: Admission) -> Response:
        if path != "/":
            return response(HTTPStatus.NOT_FOUND, b"this server has only the page /\n")
        body, more = page_for(headers["Host"])
        return response(HTTPStatus.OK, body, more | ({"Set-Cookie": admission.cookie} if admission.cookie else {}))

    def _take(self, client: Client, data: bytes | str) -> str:
        order = read_order(data, self._fingers, self.box)
        if isinstance(order, str):
            return order
        if order.number > client.last:
            self.counts["lost"] += order.number - client.last - 1
            self.last = order.number
        fate = self._judge(client, order.number, order.kind, order.finger)
        if fate == "taken" and order.kind in (Kind.PRESS, Kind.MOVE):
            self._touched.press(order.finger, order.place)
        if self._note is not None:
            self._note(client.number, order, fate)
        return fate

    def _let_go(self, thing: int, reason: str) -> None:
        self._touched.lift(thing)
        if reason:
            self.counts[f"let go: {reason}"] += 1

    def _set_scenery(self, scenery: str) -> None:
        self._picture = b""
        self._set_hello(scenery)

    def _set_picture(self, picture: bytes) -> None:
        self._picture = picture
        self._tell_all()

    def _message(self, client: Client) -> bytes:
        own, claimed = (sum(1 << finger for finger in each) for each in (self._items_of(client), self.owners))
        return HEAD.pack(client.last, own, claimed, client.dropped) + self._picture
