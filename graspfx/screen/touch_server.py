"""The server of a touch screen: one page, one WebSocket, and fingers that are let go when whoever has them is lost."""

from __future__ import annotations

import asyncio
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from itertools import count
from typing import TYPE_CHECKING, Protocol

from graspfx.screen.own_page import single
from graspfx.screen.socket_thread import PATIENCE, SILENT, SocketThread, require_websockets, response
from graspfx.screen.touch_claims import Claims
from graspfx.screen.touch_gate import Bucket, Gate
from graspfx.screen.touch_orders import ORDER, Box, Kind, Order, read_order
from graspfx.screen.touch_page import page_for

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

SILENCE = 0.5  # of a screen with fingers on it, until they count as lifted [s]
LOOK = 0.05  # between two looks for it [s]
RATE, BURST = 1500.0, 500.0  # orders of a client
TURN = 32  # orders of a client, after which others have their turn
MOST_CLIENTS = 16
MOST_BYTES = 2 * ORDER.size  # of a message: a longer one ends the connection
QUEUE = 64  # messages that wait for their turn
HEAD = struct.Struct("<4d")  # last order, own fingers, all that are claimed, orders dropped
SOCKET = "/socket"


class Touched(Protocol):
    """The fingers that screens move. It is called in the server's thread, and must not wait."""

    def press(self, finger: int, place: tuple[float, float]) -> None:
        """Lead a finger to a place on the screen [m]: one came down there, or went there."""

    def lift(self, finger: int) -> None:
        """Let a finger go: it went up, or the screen is lost."""


class TouchServer(SocketThread):
    """A server in a thread of its own; a context manager.

    Args:
        line: a socket that listens; it is closed at the end.
        gate: before the page.
        fingers: how many there are.
        box: in which they are touched [m].
        scenery: what the page draws, as JSON.
        touched: moves the fingers.
        note: is told of every order of a sound form with its client, and whether it was followed.

    Attributes:
        counts: of orders by what became of them: "taken", or why they were dropped; "lost", those that never came.
        last: number of the last order that came.

    Raises:
        MissingPackageError: websockets is not installed.
    """

    def __init__(
        self, line: socket.socket, gate: Gate, fingers: int, box: Box, scenery: str, touched: Touched,
        note: Callable[[int, Order, str], object] | None = None,
    ) -> None:  # fmt: skip
        require_websockets()
        super().__init__(line, "touch screens")
        self.gate, self.box = gate, box
        self.counts: Counter[str] = Counter()
        self._fingers, self._scenery, self._touched, self._note = fingers, scenery, touched, note
        self._claims = Claims(fingers)
        self._clients: dict[int, _Client] = {}
        self._numbers = count(1)
        self._picture, self.last = b"", 0

    @property
    def clients(self) -> int:
        """How many screens there are."""
        return len(self._clients)

    @property
    def has_touches(self) -> bool:
        """Whether any finger is touched."""
        return any(owner is not None for owner in self._claims.owners)

    def show(self, picture: bytes) -> None:
        """Send a picture to every screen; one that is slow is sent the newest when it can take it."""
        self._post(self._set_picture, picture)

    def describe(self, scenery: str) -> None:
        """Have every screen draw something else from now on, also those that come later."""
        self._post(self._set_scenery, scenery)

    # In the server's thread ---------------------------------------------------------------------------------------

    async def _main(self) -> None:
        from websockets.asyncio.server import serve

        server = serve(
            self._attend, sock=self.line, process_request=self._answer, compression=None, max_size=MOST_BYTES,
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
        path = request.path.partition("?")[0]
        if headers is None:
            return response(HTTPStatus.BAD_REQUEST, b"a header stands twice\n")
        peer = connection.remote_address
        admission = self.gate.admit(request.path, headers, str(peer[0]) if peer else "", is_socket=path == SOCKET)
        if admission.status != HTTPStatus.OK:
            self.counts[f"refused {admission.status.value}"] += 1
            return response(admission.status, f"{admission.reason}\n".encode())
        if path == SOCKET:
            if len(self._clients) < MOST_CLIENTS:
                return None
            return response(HTTPStatus.SERVICE_UNAVAILABLE, b"too many screens\n")
        if path != "/":
            return response(HTTPStatus.NOT_FOUND, b"there is one page only\n")
        body, more = page_for(headers["Host"])
        return response(HTTPStatus.OK, body, more | ({"Set-Cookie": admission.cookie} if admission.cookie else {}))

    async def _attend(self, connection: ServerConnection) -> None:
        """Serve a screen until it leaves."""
        from websockets.exceptions import ConnectionClosed

        number = next(self._numbers)
        client = self._clients[number] = _Client(number)
        sender = asyncio.create_task(self._send_pictures(connection, client))
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
            self._release_all(client, "lost")

    def _take(self, client: _Client, data: bytes | str) -> None:
        now = time.monotonic()
        order = read_order(data, self._fingers, self.box)
        if isinstance(order, str):
            self._drop(client, order)
            return
        fate = self._fate(client, order, now)
        if fate == "taken":
            self.counts["taken"] += 1
        else:
            self._drop(client, fate)
        if self._note is not None:
            self._note(client.number, order, fate)

    def _fate(self, client: _Client, order: Order, now: float) -> str:
        """Follow a sound order, or say why not. A finger that goes up does, however many orders came before."""
        if order.number <= client.last:
            return "number"
        self.counts["lost"] += order.number - client.last - 1
        client.last = self.last = order.number
        if not client.budget.take(now) and order.kind != Kind.LIFT:
            return "rate"
        client.silence = 0.0
        if order.kind == Kind.ALIVE:
            return "taken"
        if order.kind == Kind.LIFT:
            if not self._claims.release(order.finger, client.number):
                return "claim"
            self._touched.lift(order.finger)
            return "taken"
        own = self._claims.claim if order.kind == Kind.PRESS else self._claims.is_of
        if not own(order.finger, client.number):
            return "claim"
        self._touched.press(order.finger, order.place)
        return "taken"

    def _drop(self, client: _Client, reason: str) -> None:
        self.counts[reason] += 1
        client.dropped += 1

    def _release_all(self, client: _Client, reason: str) -> None:
        for finger in list(self._claims.fingers_of(client.number)):
            self._claims.release(finger, client.number)
            self._touched.lift(finger)
            self.counts[f"let go: {reason}"] += 1

    async def _watch(self) -> None:
        """Let fingers go whose screen has fallen silent; time in which nobody listened here is no silence."""
        before = time.monotonic()
        while True:
            await asyncio.sleep(LOOK)
            now = time.monotonic()
            passed, before = min(now - before, 2.0 * LOOK), now
            for client in self._clients.values():
                client.silence += passed
                if client.silence > SILENCE:
                    self._release_all(client, "silence")

    def _set_scenery(self, scenery: str) -> None:
        self._scenery, self._picture = scenery, b""
        for client in self._clients.values():
            client.has_scenery = False
            client.news.set()

    def _set_picture(self, picture: bytes) -> None:
        self._picture = picture
        for client in self._clients.values():
            client.news.set()

    async def _send_pictures(self, connection: ServerConnection, client: _Client) -> None:
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            while True:
                await client.news.wait()
                client.news.clear()
                if not client.has_scenery:
                    client.has_scenery = True
                    await connection.send(self._scenery)
                own, claimed = self._claims.bits(client.number)
                await connection.send(HEAD.pack(client.last, own, claimed, client.dropped) + self._picture)


class _Client:
    """A screen.

    Attributes:
        number: its own.
        last: number of its last order.
        silence: since the last order that was followed or could have been [s].
        dropped: orders of it that were not followed.
        turn: messages of it.
        news: whether there is a picture or a scenery that it has not been sent.
        has_scenery: whether it was sent the newest.
    """

    def __init__(self, number: int) -> None:
        self.number, self.last, self.silence, self.dropped, self.turn = number, 0, 0.0, 0, 0
        self.news = asyncio.Event()
        self.news.set()
        self.has_scenery = False
        self.budget = Bucket(RATE, BURST)
