"""The server of a stream: states go out, the newest to each client; goals come in, one client for each guide."""

from __future__ import annotations

import asyncio
import socket
import time
from collections import Counter
from contextlib import suppress
from http import HTTPStatus
from itertools import count
from typing import TYPE_CHECKING, NamedTuple, Protocol

from graspfx.screen.own_page import single
from graspfx.screen.socket_thread import PATIENCE, SILENT, SocketThread, require_websockets, response
from graspfx.screen.stream_gate import StreamGate
from graspfx.screen.stream_orders import LONGEST, StreamOrder, read_stream_order
from graspfx.screen.touch_claims import Claims
from graspfx.screen.touch_gate import Bucket

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

SOCKET = "/stream"
SILENCE = 0.5  # of a client that leads a guide, until others may [s]
LOOK = 0.05  # between two looks for it [s]
RATE, BURST = 500.0, 200.0  # orders of a client
TURN = 32  # orders of a client, after which others have their turn
MOST_CLIENTS = 16
QUEUE = 64  # messages that wait for their turn
UNSENT = 1 << 16  # bytes on their way to a client; what is newer replaces what waits behind them


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


class StreamServer(SocketThread):
    """A server in a thread of its own; a context manager. A client that is slow delays nobody, and gets fewer states.

    Args:
        line: a socket that listens; it is closed at the end.
        gate: before it.
        led: what clients lead.

    Attributes:
        counts: of orders by what became of them: "taken", or why they were dropped.

    Raises:
        MissingPackageError: websockets is not installed.
    """

    def __init__(self, line: socket.socket, gate: StreamGate, led: Led) -> None:
        require_websockets("a stream")
        super().__init__(line, "stream")
        self.gate, self._led = gate, led
        self.counts: Counter[str] = Counter()
        self._bounds, self._claims = Bounds(), Claims(0)
        self._clients: dict[int, _Client] = {}
        self._numbers = count(1)
        self._hello, self._state = "", ""

    @property
    def clients(self) -> int:
        """How many clients there are."""
        return len(self._clients)

    def describe(self, hello: str, bounds: Bounds) -> None:
        """Say what streams from now on, JSON of an object: all clients are told, and lead nothing any more."""
        self._post(self._set_hello, hello, bounds)

    def show(self, state: str) -> None:
        """Send a state, JSON of an object, to every client; one that is slow is sent the newest when it can take it."""
        self._post(self._set_state, state)

    def conclude(self, state: str) -> None:
        """Send the last state of what was described; nothing may be led any more."""
        self._post(self._set_bounds, Bounds())
        if state:
            self.show(state)

    # In the server's thread ---------------------------------------------------------------------------------------

    async def _main(self) -> None:
        from websockets.asyncio.server import serve

        server = serve(
            self._attend, sock=self.line, process_request=self._answer, compression=None, max_size=LONGEST,
            max_queue=QUEUE, open_timeout=PATIENCE, close_timeout=1.0, ping_interval=PATIENCE, ping_timeout=PATIENCE,
            server_header=None, logger=SILENT,
        )  # fmt: skip
        async with server:
            watch = asyncio.create_task(self._watch())
            await self._serve_until_stopped()
            watch.cancel()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request with a refusal; None lets a WebSocket through."""
        headers = single(request.headers)
        if headers is None:
            return response(HTTPStatus.BAD_REQUEST, b"a header stands twice\n")
        peer = connection.remote_address
        admission = self.gate.admit(request.path, headers, str(peer[0]) if peer else "", is_socket=True)
        if admission.status != HTTPStatus.OK:
            self.counts[f"refused {admission.status.value}"] += 1
            return response(admission.status, f"{admission.reason}\n".encode())
        if request.path.partition("?")[0] != SOCKET:
            return response(HTTPStatus.NOT_FOUND, f"the stream is at {SOCKET}\n".encode())
        if len(self._clients) >= MOST_CLIENTS:
            return response(HTTPStatus.SERVICE_UNAVAILABLE, b"too many clients\n")
        return None

    async def _attend(self, connection: ServerConnection) -> None:
        """Serve a client until it leaves."""
        from websockets.exceptions import ConnectionClosed

        line = connection.transport.get_extra_info("socket")
        if line is not None:
            line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNSENT)
        number = next(self._numbers)
        client = self._clients[number] = _Client(number)
        sender = asyncio.create_task(self._send_states(connection, client))
        try:
            async for data in connection:
                self._take(client, data)
                client.turn += 1
                if client.turn % TURN == 0:
                    await asyncio.sleep(0)  # so that others are heard while one floods
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()
            del self._clients[number]
            self._release_all(client)

    def _take(self, client: _Client, data: bytes | str) -> None:
        order = read_stream_order(data, *self._bounds)
        fate = order if isinstance(order, str) else self._fate(client, order)
        self.counts[fate] += 1
        if fate != "taken":
            client.dropped, client.reason = client.dropped + 1, fate

    def _fate(self, client: _Client, order: StreamOrder) -> str:
        """Follow a sound order, or say why not. A guide is given up however many orders came before."""
        if order.number <= client.last:
            return "number"
        client.last = order.number
        if not client.budget.take(time.monotonic()) and order.kind != "release":
            return "rate"
        client.silence = 0.0
        if order.kind == "alive":
            return "taken"
        if order.kind == "release":
            if not self._claims.release(order.guide, client.number):
                return "claim"
            self._led.release(order.guide)
            return "taken"
        if not self._claims.claim(order.guide, client.number):
            return "claim"
        self._led.lead(order)
        return "taken"

    def _release_all(self, client: _Client) -> None:
        for guide in list(self._claims.fingers_of(client.number)):
            self._claims.release(guide, client.number)
            self._led.release(guide)

    async def _watch(self) -> None:
        """Give guides up whose client has fallen silent; time in which nobody listened here is no silence."""
        before = time.monotonic()
        while True:
            await asyncio.sleep(LOOK)
            now = time.monotonic()
            passed, before = min(now - before, 2.0 * LOOK), now
            for client in self._clients.values():
                client.silence += passed
                if client.silence > SILENCE:
                    self._release_all(client)

    def _set_hello(self, hello: str, bounds: Bounds) -> None:
        self._hello, self._state, self._bounds, self._claims = hello, "", bounds, Claims(bounds.guides)
        for client in self._clients.values():
            client.has_hello = False
            client.news.set()

    def _set_bounds(self, bounds: Bounds) -> None:
        self._bounds, self._claims = bounds, Claims(bounds.guides)

    def _set_state(self, state: str) -> None:
        self._state = state
        for client in self._clients.values():
            client.news.set()

    async def _send_states(self, connection: ServerConnection, client: _Client) -> None:
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            while True:
                await client.news.wait()
                client.news.clear()
                if not client.has_hello and self._hello:
                    client.has_hello = True
                    await connection.send(self._hello)
                if self._state:
                    own = list(self._claims.fingers_of(client.number))
                    you = f'"last":{client.last},"leads":{own},"dropped":{client.dropped},"why":"{client.reason}"'
                    await connection.send(f'{self._state[:-1]},"you":{{{you}}}}}')


class _Client:
    """A client.

    Attributes:
        number: its own.
        last: number of its last order.
        silence: since the last order that was followed or could have been [s].
        dropped: orders of it that were not followed.
        reason: why the last of them was not.
        turn: messages of it.
        news: whether there is a state or a hello that it has not been sent.
        has_hello: whether it was sent the newest.
    """

    def __init__(self, number: int) -> None:
        self.number, self.last, self.silence, self.dropped, self.turn, self.reason = number, 0, 0.0, 0, 0, ""
        self.news = asyncio.Event()
        self.news.set()
        self.has_hello = False
        self.budget = Bucket(RATE, BURST)
