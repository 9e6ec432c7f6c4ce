"""Server whose clients claim items to control them: a client keeps its items until release, exit or silence."""

from __future__ import annotations

import asyncio
import socket
from collections import Counter
from collections.abc import Awaitable, Iterator, Mapping, Sequence
from contextlib import suppress
from http import HTTPStatus
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

from graspfx.screen.gate import Admission, Bucket, Gate
from graspfx.screen.own_page import single
from graspfx.screen.socket_thread import PATIENCE, SILENT, SocketThread, response
from graspfx.screen.touch_orders import Kind

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response


class Claims:
    """Owners of fingers; clients are identified by numbers.

    Args:
        fingers: Number of fingers.
    """

    def __init__(self, fingers: int) -> None:
        self._owners: list[int | None] = [None] * fingers

    @property
    def owners(self) -> Sequence[int | None]:
        """Client of each finger; None if the finger is free."""
        return tuple(self._owners)

    def claim(self, finger: int, client: int) -> bool:
        """Claim a finger for a client; return whether the finger now belongs to the client."""
        if self._owners[finger] is None:
            self._owners[finger] = client
        return self._owners[finger] == client

    def is_of(self, finger: int, client: int) -> bool:
        """Tell whether a finger belongs to a client."""
        return self._owners[finger] == client

    def release(self, finger: int, client: int) -> bool:
        """Release a finger; return whether the finger belonged to the client."""
        if self._owners[finger] != client:
            return False
        self._owners[finger] = None
        return True

    def fingers_of(self, client: int) -> Iterator[int]:
        """List the fingers of a client."""
        return (finger for finger, owner in enumerate(self.owners) if owner == client)

    def bits(self, client: int) -> tuple[int, int]:
        """Return the fingers of a client, and the fingers of all clients, as bit masks."""
        own = sum(1 << i for i, owner in enumerate(self._owners) if owner == client)
        return own, sum(1 << i for i, owner in enumerate(self._owners) if owner is not None)


SILENCE = 0.5  # silence of a client after which its items are released [s]
LOOK = 0.05  # interval between checks for silence [s]
TURN = 32  # orders of one client before other clients get a turn
MOST_CLIENTS = 16
QUEUE = 64  # longest queue of incoming messages


class Terms(NamedTuple):
    """Limits for messages of clients.

    Attributes:
        path: Path of the WebSocket.
        longest: Length of the longest message in bytes; a longer one ends the connection.
        rate: Highest rate of a client's orders [Hz].
        burst: Largest number of orders at once.
    """

    path: str
    longest: int
    rate: float
    burst: float


class Client:
    """A client of a server.

    Attributes:
        number: Number of the client.
        last: Number of its last order.
        silence: Time since its last valid order [s].
        dropped: Number of orders that were dropped.
        reason: Reason why the last dropped order was dropped.
        turn: Number of messages received.
        budget: Rate limiter of its orders.
        news: Event that is set while there is something new to send.
        has_hello: Whether the newest hello message was sent to the client.
    """

    def __init__(self, number: int, budget: Bucket) -> None:
        self.number, self.last, self.silence, self.dropped, self.turn, self.reason = number, 0, 0.0, 0, 0, ""
        self.budget = budget
        self.news = asyncio.Event()
        self.news.set()
        self.has_hello = False


class ClaimServer(SocketThread):
    """Server in its own thread; a context manager. A slow client misses messages, but does not delay other clients.

    A client's items are released on request, when the connection ends, and after half a second of silence.

    Args:
        line: Listening socket; the server closes it at the end.
        name: Name of the thread.
        gate: Access control; silence and rates are measured on its clock.
        terms: Limits for clients.
        things: Number of items that can be claimed.
        hello: First message to every client; empty for none.

    Attributes:
        counts: Number of orders by outcome ("taken", or the reason for dropping), of refused requests ("refused 403"),
            and of errors while items of a lost or silent client were released ("fault").
    """

    def __init__(self, line: socket.socket, name: str, gate: Gate, terms: Terms, things: int, hello: str = "") -> None:
        super().__init__(line, name)
        self.gate = gate
        self.counts: Counter[str] = Counter()
        self._terms, self._hello = terms, hello
        self._claims = Claims(things)
        self._clients: dict[int, Client] = {}
        self._numbers = count(1)

    @property
    def clients(self) -> int:
        """Number of clients."""
        return len(self._clients)

    # In the server's thread: what a server adds -------------------------------------------------------------------

    def _page(self, path: str, headers: Mapping[str, str], admission: Admission) -> Response | Awaitable[Response]:
        """Answer an admitted request that is not for the WebSocket."""
        raise NotImplementedError

    def _take(self, client: Client, data: bytes | str) -> str:
        """Execute a message; return "taken", or the reason for dropping it."""
        raise NotImplementedError

    def _let_go(self, thing: int, reason: str) -> None:
        """Release an item; the reason is empty if its client released it."""
        raise NotImplementedError

    def _message(self, client: Client) -> bytes | str:
        """Return the next message for a client; empty for none."""
        raise NotImplementedError

    # In the server's thread ---------------------------------------------------------------------------------------

    async def _main(self) -> None:
        from websockets.asyncio.server import serve

        server = serve(
            self._attend, sock=self.line, process_request=self._answer, compression=None, max_size=self._terms.longest,
            max_queue=QUEUE, open_timeout=PATIENCE, close_timeout=1.0, ping_interval=PATIENCE, ping_timeout=PATIENCE,
            server_header=None, logger=SILENT,
        )  # fmt: skip
        async with server:
            watch = asyncio.create_task(self._watch())
            await self._serve_until_stopped()
            watch.cancel()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | Awaitable[Response] | None:
        """Answer a request with a page or a refusal; None accepts a WebSocket."""
        headers = single(request.headers)
        if headers is None:
            return response(HTTPStatus.BAD_REQUEST, b"a header stands twice\n")
        path, peer = request.path.partition("?")[0], connection.remote_address
        is_socket = path == self._terms.path
        admission = self.gate.admit(request.path, headers, str(peer[0]) if peer else "", is_socket=is_socket)
        if admission.status != HTTPStatus.OK:
            self.counts[f"refused {admission.status.value}"] += 1
            return response(admission.status, f"{admission.reason}\n".encode())
        if not is_socket:
            return self._page(path, headers, admission)
        if len(self._clients) >= MOST_CLIENTS:
            return response(HTTPStatus.SERVICE_UNAVAILABLE, b"too many clients\n")
        return None

    async def _attend(self, connection: ServerConnection) -> None:
        """Serve a client until it leaves."""
        from websockets.exceptions import ConnectionClosed

        number = next(self._numbers)
        client = self._clients[number] = Client(number, Bucket(self._terms.rate, self._terms.burst))
        sender = asyncio.create_task(self._send_news(connection, client))
        try:
            async for data in connection:
                self._hear(client, data)
                client.turn += 1
                if client.turn % TURN == 0:
                    await asyncio.sleep(0)  # serves other clients while one client floods the server
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()
            del self._clients[number]
            self._release_all(client, "lost")

    def _hear(self, client: Client, data: bytes | str) -> None:
        fate = self._take(client, data)
        self.counts[fate] += 1
        if fate != "taken":
            client.dropped, client.reason = client.dropped + 1, fate

    def _judge(self, client: Client, number: int, kind: Kind, thing: int) -> str:
        """Claim or release the item of a valid order; return "taken", or the reason for dropping the order.

        A release is never dropped because of the rate limit.
        """
        if number <= client.last:
            return "number"
        client.last = number
        if not client.budget.take(self.gate.clock()) and kind != Kind.LIFT:
            return "rate"
        client.silence = 0.0
        if kind == Kind.ALIVE:
            return "taken"
        if kind == Kind.LIFT:
            if not self._claims.release(thing, client.number):
                return "claim"
            self._let_go(thing, "")
            return "taken"
        own = self._claims.claim if kind == Kind.PRESS else self._claims.is_of
        return "taken" if own(thing, client.number) else "claim"

    def _release_all(self, client: Client, reason: str) -> None:
        """Release all items of a client; an error for one item does not affect the others."""
        for thing in list(self._claims.fingers_of(client.number)):
            self._claims.release(thing, client.number)
            try:
                self._let_go(thing, reason)
            except Exception:  # noqa: BLE001 - a run that is ending may raise anything
                self.counts["fault"] += 1

    async def _watch(self) -> None:
        """Release the items of silent clients; time during which this loop was blocked is not counted as silence."""
        before = self.gate.clock()
        while True:
            await asyncio.sleep(LOOK)
            now = self.gate.clock()
            passed, before = min(now - before, 2.0 * LOOK), now
            for client in self._clients.values():
                client.silence += passed
                if client.silence > SILENCE:
                    self._release_all(client, "silence")

    def _set_hello(self, hello: str) -> None:
        self._hello = hello
        for client in self._clients.values():
            client.has_hello = False
        self._tell_all()

    def _tell_all(self) -> None:
        for client in self._clients.values():
            client.news.set()

    async def _send_news(self, connection: ServerConnection, client: Client) -> None:
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            while True:
                await client.news.wait()
                client.news.clear()
                if not client.has_hello and self._hello:
                    client.has_hello = True
                    await connection.send(self._hello)
                message = self._message(client)
                if message:
                    await connection.send(message)
