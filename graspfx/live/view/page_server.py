"""Server of pages on 127.0.0.1: HTML documents, and a WebSocket for the frames and orders of a live run."""

from __future__ import annotations

import asyncio
import json
import math
from collections import deque
from collections.abc import Awaitable, Mapping
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx.screen.claim_server import ClaimServer, Client, Terms, require_websockets, response
from graspfx.screen.gate import HOST, Admission, gate_for, listen

if TYPE_CHECKING:
    from websockets.http11 import Response

FloatArray = NDArray[np.float64]

FIRST = 8080  # first port to try
SOCKET = "/live"
LONGEST = 512  # longest order in bytes
RATE, BURST = 500.0, 200.0  # limits for a page's orders [1/s], at once
UNSENT = 1 << 18  # send buffer of a browser in bytes; newer states replace those that wait for it
KEPT = 600  # newest frames, which a page gets when it is opened
MOST_STEPS = 100_000  # largest number of ticks of one step
PLAIN = ("run", "pause", "reset", "record", "stop")  # orders without arguments


class Order(NamedTuple):
    """Order that a page sends.

    Attributes:
        act: One of `PLAIN`, or "step", "set", "lead", "squeeze" or "answer".
        number: Number of ticks for "step", number of the slider for "set", number of the hand for "lead" and "squeeze".
        finger: For "lead", number of the finger within the hand; None for all fingers of the hand.
        offset: For "lead", operator offset (d,) [m].
        value: For "set", value of the slider; for "squeeze", additional squeeze [m].
        key: For "answer", key of the answer.
    """

    act: str
    number: int = 0
    finger: int | None = None
    offset: tuple[float, ...] = ()
    value: float = 0.0
    key: str = ""


KEYS = {
    **{act: {"act"} for act in PLAIN}, "step": {"act", "count"}, "set": {"act", "slider", "value"},
    "lead": {"act", "hand", "finger", "offset"}, "squeeze": {"act", "hand", "value"}, "answer": {"act", "key"},
}  # fmt: skip


def read_page_order(data: bytes | str) -> Order | str:
    """Parse a message from a page; if the message is invalid, return the name of the invalid part."""
    if not isinstance(data, str) or len(data) > LONGEST:
        return "length"
    try:
        table = json.loads(data)
    except (ValueError, RecursionError):
        return "json"
    act = table.get("act") if isinstance(table, dict) else None
    if not isinstance(act, str) or table.keys() != KEYS.get(act):
        return "act"
    number = next((table[key] for key in ("count", "slider", "hand") if key in table), 0)
    finger, offset = table.get("finger"), table.get("offset", [])
    value, key = table.get("value", 0.0), table.get("key", "")
    if type(number) is not int or not (1 if act == "step" else 0) <= number <= MOST_STEPS:
        return "number"
    if finger is not None and (type(finger) is not int or not 0 <= finger <= MOST_STEPS):
        return "finger"
    if not (isinstance(offset, list) and len(offset) <= 3 and all(map(_is_finite, [*offset, value]))):
        return "value"
    if not isinstance(key, str):
        return "key"
    return Order(act, number, finger, tuple(map(float, offset)), float(value), key)


def _is_finite(value: object) -> bool:
    return type(value) in (int, float) and abs(value) < 1e300 and math.isfinite(value)  # type: ignore[arg-type]


class Shown(Protocol):
    """Content that a server shows. The server calls the methods in its own threads."""

    def document(self, path: str, host: str) -> str | None:
        """Return the HTML document at a path, or None if the path is unknown; the call may take long.

        Args:
            path: Path in the address.
            host: Name and port by which the browser addresses this machine.
        """

    def order(self, order: Order) -> bool:
        """Start the execution of an order without waiting for its end; return False if the order is not valid."""


class PageServer(ClaimServer):
    """Server of pages, which listens when it is created and answers within a `with` block.

    A slow browser does not delay other browsers: frames that a slow browser has not yet received are sent together
    later, and the oldest of them may be omitted.

    Args:
        shown: Content that the server shows.
        port: Port number on 127.0.0.1; None for the first free port from 8080 on, 0 for any free port.

    Attributes:
        url: Address of the page.

    Raises:
        MissingPackageError: If websockets is not installed.
        InputError: If the port is in use or not permitted.
    """

    def __init__(self, shown: Shown, port: int | None = None) -> None:
        require_websockets("a page", "view")
        line = listen(HOST, port, FIRST, "--port")
        super().__init__(line, "pages", gate_for(line, lan=False), Terms(SOCKET, LONGEST, RATE, BURST, UNSENT))
        self.url = f"http://{HOST}:{line.getsockname()[1]}"
        self._shown = shown
        self._frames: deque[tuple[int, int, FloatArray]] = deque(maxlen=KEPT)  # version, number, frame
        self._shown_run, self._newest = -1, 0

    def tell(self, state: Mapping[str, Any]) -> None:
        """Send the state of the page to every browser; a slow browser later receives only the newest state."""
        self._post(self._set_state, json.dumps(state, separators=(",", ":"), allow_nan=False))

    def show(self, run: int, first: int, frames: FloatArray) -> None:
        """Send frames (k, w) of a run; frames from the number `first` on that were sent before are replaced."""
        self._post(self._add, run, first, frames)

    # In the server's thread ---------------------------------------------------------------------------------------

    def _page(self, path: str, headers: Mapping[str, str], admission: Admission) -> Awaitable[Response]:
        return asyncio.to_thread(self._document, path, headers["Host"])

    def _document(self, path: str, host: str) -> Response:
        if path == "/favicon.ico":
            return response(HTTPStatus.NO_CONTENT, b"")
        text = self._shown.document(path, host)
        if text is None:
            return response(HTTPStatus.NOT_FOUND, b"there is no such page\n")
        policy = {"Content-Type": "text/html; charset=utf-8", "Content-Security-Policy": "frame-ancestors 'none'"}
        return response(HTTPStatus.OK, text.encode(), policy)

    def _take(self, client: Client, data: bytes | str) -> str:
        order = read_page_order(data)
        if isinstance(order, str):
            return order
        if not client.budget.take(self.gate.clock()):
            return "rate"
        return "taken" if self._shown.order(order) else "order"

    def _set_state(self, state: str) -> None:
        if state != self._hello:
            self._set_hello(state)

    def _add(self, run: int, first: int, frames: FloatArray) -> None:
        if run != self._shown_run:
            self._shown_run = run
            self._frames.clear()
        while self._frames and self._frames[-1][1] >= first:
            self._frames.pop()
        for k, frame in enumerate(frames):
            self._newest += 1
            self._frames.append((self._newest, first + k, frame))
        self._tell_all()

    def _message(self, client: Client) -> bytes:
        """Return the frames that a client has not received, preceded by run, number of the first frame, and count.

        The result is empty if there are no new frames.
        """
        every = [each for each in self._frames if each[0] > client.sent]
        new = [each for k, each in enumerate(every) if each[1] == every[0][1] + k]  # up to a gap
        if not new:
            return b""
        client.sent = new[-1][0]
        if len(new) < len(every):
            client.news.set()
        head = np.array([self._shown_run, new[0][1], len(new)], dtype="<f8").tobytes()
        return head + np.stack([frame for *_, frame in new]).astype("<f4").tobytes()
