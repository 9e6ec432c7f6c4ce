"""The server of a stream: states go out, the newest to each client; goals come in, one client for each guide."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from http import HTTPStatus
from typing import TYPE_CHECKING, NamedTuple, Protocol

from graspfx.screen.claim_server import ClaimServer, Client, Terms
from graspfx.screen.socket_thread import require_websockets, response
from graspfx.screen.stream_gate import StreamGate
from graspfx.screen.stream_orders import LONGEST, StreamOrder, read_stream_order
from graspfx.screen.touch_claims import Claims
from graspfx.screen.touch_gate import Admission
from graspfx.screen.touch_orders import Kind

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Response

SOCKET = "/stream"
RATE, BURST = 500.0, 200.0  # orders of a client
UNSENT = 1 << 16  # bytes on their way to a client; what is newer replaces what waits behind them
KINDS = {"alive": Kind.ALIVE, "goal": Kind.PRESS, "release": Kind.LIFT}  # a goal claims its guide, as a touch a finger


class Led(Protocol):
    """The hands that clients lead. It is called in the server's thread, and must not wait."""

    def lead(self, order: StreamOrder) -> None:
        """Follow a goal."""

    def release(self, guide: int) -> None:
        """Lead a guide no more: its client says so, or is lost. It stays where it is."""


class Bounds(NamedTuple):
    """Bounds of what clients may ask for.

    Attributes:
        guides: how many may be led; 0 for none.
        farthest: that a component of an offset may be [m].
        closest: that a squeeze may be, either way [m].
    """

    guides: int = 0
    farthest: float = 0.0
    closest: float = 0.0


class StreamServer(ClaimServer):
    """A server of states and goals.

    Args:
        line: a socket that listens; it is closed at the end.
        gate: before it.
        led: what clients lead.

    Raises:
        MissingPackageError: websockets is not installed.
    """

    def __init__(self, line: socket.socket, gate: StreamGate, led: Led) -> None:
        require_websockets("a stream")
        super().__init__(line, "stream", gate, Terms(SOCKET, LONGEST, RATE, BURST), 0)
        self._led, self._bounds, self._state = led, Bounds(), ""

    def describe(self, hello: str, bounds: Bounds) -> None:
        """Say what streams from now on, JSON of an object: all clients are told, and lead nothing any more."""
        self._post(self._begin, hello, bounds)

    def show(self, state: str) -> None:
        """Send a state, JSON of an object, to every client; one that is slow is sent the newest when it can take it."""
        self._post(self._set_state, state)

    def conclude(self, state: str) -> None:
        """Send the last state of what was described; nothing may be led any more."""
        self._post(self._set_bounds, Bounds())
        if state:
            self.show(state)

    # In the server's thread ---------------------------------------------------------------------------------------

    def _page(self, path: str, headers: Mapping[str, str], admission: Admission) -> Response:
        return response(HTTPStatus.NOT_FOUND, f"the stream is at {SOCKET}\n".encode())

    async def _attend(self, connection: ServerConnection) -> None:
        line = connection.transport.get_extra_info("socket")
        if line is not None:
            line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNSENT)
        await super()._attend(connection)

    def _take(self, client: Client, data: bytes | str) -> str:
        order = read_stream_order(data, *self._bounds)
        if isinstance(order, str):
            return order
        fate = self._judge(client, order.number, KINDS[order.kind], order.guide)
        if fate == "taken" and order.kind == "goal":
            self._led.lead(order)
        return fate

    def _let_go(self, thing: int, reason: str) -> None:
        self._led.release(thing)

    def _begin(self, hello: str, bounds: Bounds) -> None:
        self._state = ""
        self._set_bounds(bounds)
        self._set_hello(hello)

    def _set_bounds(self, bounds: Bounds) -> None:
        self._bounds, self._claims = bounds, Claims(bounds.guides)

    def _set_state(self, state: str) -> None:
        self._state = state
        self._tell_all()

    def _message(self, client: Client) -> str:
        if not self._state:
            return ""
        own = list(self._claims.fingers_of(client.number))
        you = f'"last":{client.last},"leads":{own},"dropped":{client.dropped},"why":"{client.reason}"'
        return f'{self._state[:-1]},"you":{{{you}}}}}'
