"""The server of a stream: states go out, the newest to each client; goals come in, one client for each guide."""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Mapping
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from graspfx.screen.claim_server import Claims, ClaimServer, Client, Terms
from graspfx.screen.gate import Admission, StreamGate
from graspfx.screen.socket_thread import require_websockets, response
from graspfx.screen.touch_orders import Kind

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Response

LONGEST = 512  # bytes of an order
MOST_NUMBER = (1 << 53) - 1  # what every JSON reader has as a whole number
KEYS = {
    "goal": {"type", "number", "guide", "offset", "squeeze"},
    "release": {"type", "number", "guide"},
    "alive": {"type", "number"},
}


class StreamOrder(NamedTuple):
    """A sound order.

    Attributes:
        kind: "goal", "release" (which gives a guide up, and leaves its goal) or "alive".
        number: of the message; those of a connection rise.
        guide: that is meant; -1 of "alive".
        offset: by which it goes aside (3,) [m]; None leaves it.
        squeeze: that is added to its hand's [m]; None leaves it.
    """

    kind: str
    number: int
    guide: int = -1
    offset: tuple[float, float, float] | None = None
    squeeze: float | None = None


def read_stream_order(data: bytes | str, guides: int, farthest: float, closest: float) -> StreamOrder | str:
    """Read a message; a text says why it is none.

    Args:
        data: of the message.
        guides: how many there are.
        farthest: that a component of an offset may be [m].
        closest: that a squeeze may be, either way [m].
    """
    if not isinstance(data, str) or len(data) > LONGEST:
        return "length"
    try:
        table = json.loads(data, parse_constant=_refuse)
    except (ValueError, RecursionError):
        return "json"
    kind = table.get("type") if isinstance(table, dict) else None
    if not isinstance(kind, str) or kind not in KEYS or not table.keys() <= KEYS[kind]:
        return "kind"
    number, guide = table.get("number"), table.get("guide", -1)
    if type(number) is not int or not 0 < number <= MOST_NUMBER:
        return "number"
    if kind == "alive":
        return StreamOrder(kind, number)
    if type(guide) is not int or not 0 <= guide < guides:
        return "guide"
    if kind == "release":
        return StreamOrder(kind, number, guide)
    offset, squeeze = table.get("offset"), table.get("squeeze")
    if offset is not None:
        if not (isinstance(offset, list) and len(offset) == 3 and all(_is_within(each, farthest) for each in offset)):
            return "place"
        offset = tuple(map(float, offset))
    if squeeze is not None and not _is_within(squeeze, closest):
        return "place"
    return StreamOrder(kind, number, guide, offset, None if squeeze is None else float(squeeze))


def _is_within(value: Any, most: float) -> bool:
    return type(value) in (int, float) and math.isfinite(value) and abs(value) <= most


def _refuse(word: str) -> float:
    raise ValueError(word)


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
