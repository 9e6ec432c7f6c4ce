"""A server of clients that lead things: who claims one has it, until it gives it up, leaves or falls silent."""

from __future__ import annotations

import asyncio
import socket
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
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
    """Fingers and the clients that have them; a client has a number of its own.

    Args:
        fingers: how many there are.
    """

    def __init__(self, fingers: int) -> None:
        self._owners: list[int | None] = [None] * fingers

    @property
    def owners(self) -> Sequence[int | None]:
        """The client of each finger; None where nobody has it."""
        return tuple(self._owners)

    def claim(self, finger: int, client: int) -> bool:
        """Take a finger for a client; tell whether it is the client's now."""
        if self._owners[finger] is None:
            self._owners[finger] = client
        return self._owners[finger] == client

    def is_of(self, finger: int, client: int) -> bool:
        """Tell whether a client has a finger."""
        return self._owners[finger] == client

    def release(self, finger: int, client: int) -> bool:
        """Free a finger; tell whether the client had it."""
        if self._owners[finger] != client:
            return False
        self._owners[finger] = None
        return True

    def fingers_of(self, client: int) -> Iterator[int]:
        """List the fingers that a client has."""
        return (finger for finger, owner in enumerate(self.owners) if owner == client)

    def bits(self, client: int) -> tuple[int, int]:
        """Give the fingers of a client, and those of anybody, a bit for each."""
        own = sum(1 << i for i, owner in enumerate(self._owners) if owner == client)
        return own, sum(1 << i for i, owner in enumerate(self._owners) if owner is not None)


SILENCE = 0.5  # of a client that leads something, until it counts as lost [s]
LOOK = 0.05  # between two looks for it [s]
TURN = 32  # orders of a client, after which others have their turn
MOST_CLIENTS = 16
QUEUE = 64  # messages that wait for their turn


class Terms(NamedTuple):
    """Bounds of what clients may send.

    Attributes:
        path: of the WebSocket.
        longest: message, in bytes; a longer one ends the connection.
        rate: of orders of a client [Hz].
        burst: orders at once.
    """

    path: str
    longest: int
    rate: float
    burst: float


class Client:
    """A client of a server.

    Attributes:
        number: its own.
        last: number of its last order.
        silence: since the last order that was followed or could have been [s].
        dropped: orders of it that were not followed.
        reason: why the last of them was not.
        turn: messages of it.
        budget: of its orders.
        news: whether there is something that it has not been sent.
        has_hello: whether it was sent the newest.
    """

    def __init__(self, number: int, budget: Bucket) -> None:
        self.number, self.last, self.silence, self.dropped, self.turn, self.reason = number, 0, 0.0, 0, 0, ""
        self.budget = budget
        self.news = asyncio.Event()
        self.news.set()
        self.has_hello = False


class ClaimServer(SocketThread):
    """A server in a thread of its own; a context manager. A client that is slow delays nobody, and gets less news.

    Whatever a client leads is let go when it says so, when its connection ends, and when it has said nothing for half a
    second.

    Args:
        line: a socket that listens; it is closed at the end.
        name: of the thread.
        gate: before it; silence and rates are measured on its clock.
        terms: for clients.
        things: how many may be led.
        hello: a first message to every client; none while it is empty.

    Attributes:
        counts: of orders by what became of them: "taken", or why they were dropped; "fault" counts what was to be let
            go of a client that was lost, and raised an error instead.
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
        """How many clients there are."""
        return len(self._clients)

    # In the server's thread: what a server adds -------------------------------------------------------------------

    def _page(self, path: str, headers: Mapping[str, str], admission: Admission) -> Response:
        """Answer a request that was let in and opens no WebSocket."""
        raise NotImplementedError

    def _take(self, client: Client, data: bytes | str) -> str:
        """Follow a message and give "taken", or say why not."""
        raise NotImplementedError

    def _let_go(self, thing: int, reason: str) -> None:
        """Lead a thing no more; the reason is "" where its client says so."""
        raise NotImplementedError

    def _message(self, client: Client) -> bytes | str:
        """Write the news for a client; nothing where there is none."""
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

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request with a page or a refusal; None lets a WebSocket through."""
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
                    await asyncio.sleep(0)  # so that others are heard while one floods
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
        """Claim or release what a sound order means: give "taken", or why the order is not to be followed.

        A thing is let go however many orders came before.
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
        """Let go what a client has; an error of one keeps neither the others nor the watch of other clients."""
        for thing in list(self._claims.fingers_of(client.number)):
            self._claims.release(thing, client.number)
            try:
                self._let_go(thing, reason)
            except Exception:  # noqa: BLE001 - whatever a run raises that ends meanwhile
                self.counts["fault"] += 1

    async def _watch(self) -> None:
        """Release what silent clients have; time in which nobody listened here is no silence."""
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
