"""Server of a stream: sends states to all clients, and accepts goals for each guide from one client at a time."""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, NamedTuple

from graspfx.screen.claim_server import ClaimServer, Client, Terms, require_websockets, response
from graspfx.screen.gate import Admission, StreamGate
from graspfx.screen.touch_orders import Kind

if TYPE_CHECKING:
    from websockets.http11 import Response

LONGEST = 512  # longest order in bytes
MOST_NUMBER = (1 << 53) - 1  # largest integer that every JSON reader represents exactly
KEYS = {
    "goal": {"type", "number", "guide", "offset", "squeeze"},
    "release": {"type", "number", "guide"},
    "alive": {"type", "number"},
}


class StreamOrder(NamedTuple):
    """Valid order of a client of a stream.

    Attributes:
        kind: Kind of order: "goal", "release" (of a guide, which keeps its goal) or "alive".
        number: Number of the order; the numbers on a connection increase.
        guide: Number of the guide; -1 for "alive".
        offset: Offset of the operator (3,) [m]; None to keep the present offset.
        squeeze: Squeeze to add to that of the hand [m]; None to keep the present value.
    """

    kind: str
    number: int
    guide: int = -1
    offset: tuple[float, float, float] | None = None
    squeeze: float | None = None


def read_stream_order(data: bytes | str, guides: int, farthest: float, closest: float) -> StreamOrder | str:
    """Return the order that a message contains, or the reason (str) for which the message is invalid.

    Args:
        data: Content of the message.
        guides: Number of guides.
        farthest: Largest absolute component of an offset [m].
        closest: Largest absolute squeeze [m].
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
RATE, BURST = 500.0, 200.0  # limits for a client's orders [1/s], at once
KINDS = {"alive": Kind.ALIVE, "goal": Kind.PRESS, "release": Kind.LIFT}  # a goal claims a guide


class Bounds(NamedTuple):
    """Limits for the goals of clients.

    Attributes:
        guides: Number of guides that clients may move; 0 for none.
        farthest: Largest absolute component of an offset [m].
        closest: Largest absolute value of the added squeeze [m].
    """

    guides: int = 0
    farthest: float = 0.0
    closest: float = 0.0


class StreamServer(ClaimServer):
    """Server that sends states to its clients and receives goals from them.

    Args:
        line: Listening socket, which the server closes at its end.
        gate: Access control.
        lead: Function that executes a goal. This function and `release` are called in the server's thread and must not
            block.
        release: Function that is called with the number of a guide when the guide's client releases it, is lost or is
            silent. The guide keeps its goal.

    Raises:
        MissingPackageError: If websockets is not installed.
    """

    def __init__(
        self, line: socket.socket, gate: StreamGate, lead: Callable[[StreamOrder], object],
        release: Callable[[int], object],
    ) -> None:  # fmt: skip
        require_websockets("a stream")
        super().__init__(line, "stream", gate, Terms(SOCKET, LONGEST, RATE, BURST))
        self._lead, self._release, self._bounds, self._state = lead, release, Bounds(), ""

    def describe(self, hello: str, bounds: Bounds) -> None:
        """Send a new hello message, which is a JSON object, to all clients, and release all claims of guides."""
        self._post(self._begin, hello, bounds)

    def show(self, state: str) -> None:
        """Send a state, which is a JSON object, to every client; a slow client skips states that it cannot receive."""
        self._post(self._set_state, state)

    def conclude(self, state: str) -> None:
        """Send the last state, and accept no more goals."""
        self._post(self._set_bounds, Bounds())
        if state:
            self.show(state)

    # In the server's thread ---------------------------------------------------------------------------------------

    def _page(self, path: str, headers: Mapping[str, str], admission: Admission) -> Response:
        return response(HTTPStatus.NOT_FOUND, f"the stream is at {SOCKET}\n".encode())

    def _take(self, client: Client, data: bytes | str) -> str:
        order = read_stream_order(data, *self._bounds)
        if isinstance(order, str):
            return order
        fate = self._judge(client, order.number, KINDS[order.kind], order.guide)
        if fate == "taken" and order.kind == "goal":
            self._lead(order)
        return fate

    def _let_go(self, thing: int, reason: str) -> None:
        self._release(thing)

    def _begin(self, hello: str, bounds: Bounds) -> None:
        self._state = ""
        self._set_bounds(bounds)
        self._set_hello(hello)

    def _set_bounds(self, bounds: Bounds) -> None:
        self._bounds = bounds
        self.owners.clear()

    def _set_state(self, state: str) -> None:
        self._state = state
        self._tell_all()

    def _message(self, client: Client) -> str:
        if not self._state:
            return ""
        you = (
            f'"last":{client.last},"leads":{self._items_of(client)},"dropped":{client.dropped},"why":"{client.reason}"'
        )
        return f'{self._state[:-1]},"you":{{{you}}}}}'
