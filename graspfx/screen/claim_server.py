"""Server of pages and streams; a client may claim items, such as fingers, until it releases them or is lost."""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from http import HTTPStatus
from itertools import count
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from graspfx.errors import DeviceError, MissingPackageError
from graspfx.screen.gate import Admission, Bucket, Gate, single
from graspfx.screen.touch_orders import Kind

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

PATIENCE = 5.0  # timeout of handshakes, and interval and timeout of pings [s]
FAREWELL = 1.0  # timeout of closing handshakes [s]
SILENCE = 0.5  # silence of a client after which its items are released [s]
LOOK = 0.05  # interval between checks for silence [s]
TURN = 32  # messages of one client before other clients get a turn
MOST_CLIENTS = 16
QUEUE = 64  # longest queue of incoming messages
SILENT = logging.Logger("websockets", logging.CRITICAL + 1)
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Connection": "close",
}


def response(status: HTTPStatus, body: bytes, more: Mapping[str, str] | None = None) -> Response:
    """Return an HTTP response; the body is plain text unless `more` contains another Content-Type."""
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    headers = Headers(HEADERS | {"Content-Length": str(len(body)), "Content-Type": "text/plain; charset=utf-8"})
    for name, value in (more or {}).items():
        if name in headers:
            del headers[name]
        headers[name] = value
    return Response(status.value, status.phrase, headers, body)


def require_websockets(wanted_by: str = "a touch screen", extra: str = "touch") -> None:
    """Require that the package websockets is installed.

    Args:
        wanted_by: Feature that needs the package, for the error message.
        extra: Extra of GraspFX that installs the package, for the error message.

    Raises:
        MissingPackageError: If websockets is not installed.
    """
    try:
        import websockets.asyncio.server  # noqa: F401 (whether it is there)
    except ImportError as error:
        raise MissingPackageError.of_extra("websockets", wanted_by, extra) from error


class Terms(NamedTuple):
    """Limits for the messages between a client and the server.

    Attributes:
        path: Path of the WebSocket.
        longest: Largest length of a message from a client, in bytes; a longer message ends the connection.
        rate: Largest mean rate of a client's orders [Hz].
        burst: Largest number of orders that a client may send at once.
        unsent: Size of the send buffer of a client, in bytes. If it is full, a waiting message is replaced by a newer
            one.
    """

    path: str
    longest: int
    rate: float
    burst: float
    unsent: int = 1 << 16


class Client:
    """State of a connected client of a server.

    Attributes:
        number: Number of the client, from 1, in the order of connections.
        abort: Function that ends the connection without a closing handshake.
        last: Number of the last valid order of the client; the number of a later order must be larger.
        silence: Time since the last valid order [s].
        dropped: Number of orders that were dropped.
        reason: Reason for which the last dropped order was dropped.
        budget: Limiter of the rate of orders.
        news: Event that is set while a message has to be sent.
        has_hello: Whether the present hello message was sent.
        sent: Version of the last frame that was sent.
    """

    def __init__(self, number: int, abort: Callable[[], object], budget: Bucket) -> None:
        self.number, self.last, self.silence, self.dropped, self.reason = number, 0, 0.0, 0, ""
        self.abort = abort
        self.budget = budget
        self.news = asyncio.Event()
        self.news.set()
        self.has_hello, self.sent = False, 0


class ClaimServer:
    """Server that runs in a separate thread with its own event loop while a `with` block runs.

    A slow client misses messages, but does not delay other clients. The items that a client has claimed are released on
    the client's request, when its connection ends, and after half a second without a valid order.

    Args:
        line: Listening socket, which the server closes at its end.
        name: Name of the thread.
        gate: Access control; its clock measures silence and rates.
        terms: Limits for messages.
        hello: First message to every client; empty for none.

    Attributes:
        counts: Number of orders by outcome ("taken", or the reason for dropping the order), of refused requests
            ("refused" and the HTTP status), and of errors on releasing the items of a lost or silent client ("fault").
        owners: Number of the client that has claimed an item, by item.

    Raises:
        DeviceError: If the server cannot start; the error is raised at the beginning of the `with` block.
    """

    def __init__(self, line: socket.socket, name: str, gate: Gate, terms: Terms, hello: str = "") -> None:
        self.line, self.gate = line, gate
        self.counts: Counter[str] = Counter()
        self.owners: dict[int, int] = {}
        self._terms, self._hello = terms, hello
        self._clients: dict[int, Client] = {}
        self._numbers = count(1)
        self._loop = asyncio.new_event_loop()
        self._stopping = asyncio.Event()
        self._ready, self._error = threading.Event(), list[BaseException]()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait()
        if self._error:
            self._thread.join()
            raise DeviceError(f"the server of the page cannot start: {self._error[0]}") from self._error[0]
        return self

    def __exit__(self, *exc: object) -> None:
        self._post(self._stopping.set)
        self._thread.join()

    def _post(self, call: Callable[..., object], *arguments: Any) -> None:
        """Call a function in the server's thread; do nothing if the thread has ended."""
        with suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(call, *arguments)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._main())
        except BaseException as error:  # noqa: BLE001 - raised by whoever waits
            self._error.append(error)
        finally:
            self._ready.set()
            self.line.close()
            self._loop.close()

    @property
    def clients(self) -> int:
        """Number of connected clients."""
        return len(self._clients)

    # In the server's thread: to be overridden --------------------------------------------------------------------

    def _page(self, path: str, headers: Mapping[str, str], admission: Admission) -> Response | Awaitable[Response]:
        """Return the response to an admitted request that does not open the WebSocket."""
        raise NotImplementedError

    def _take(self, client: Client, data: bytes | str) -> str:
        """Execute the order in a message; return "taken", or the reason for dropping the order."""
        raise NotImplementedError

    def _let_go(self, thing: int, reason: str) -> None:
        """Release an item; `reason` is "lost" or "silence", or empty if its client has released the item."""
        raise NotImplementedError

    def _message(self, client: Client) -> bytes | str:
        """Return the next message for a client; empty if there is none."""
        raise NotImplementedError

    # In the server's thread ---------------------------------------------------------------------------------------

    async def _main(self) -> None:
        from websockets.asyncio.server import serve

        server = serve(
            self._attend, sock=self.line, process_request=self._answer, compression=None, max_size=self._terms.longest,
            max_queue=QUEUE, open_timeout=PATIENCE, close_timeout=FAREWELL, ping_interval=PATIENCE,
            ping_timeout=PATIENCE, server_header=None, logger=SILENT,
        )  # fmt: skip
        async with server:
            watch = asyncio.create_task(self._watch())
            self._ready.set()
            await self._stopping.wait()
            watch.cancel()
            for client in self._clients.values():  # one that does not read never takes the closing frame
                self._loop.call_later(FAREWELL, client.abort)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | Awaitable[Response] | None:
        """Return the response to a request: a page or a refusal; None if the request may open a WebSocket."""
        headers = single(request.headers)
        if headers is None:
            return response(HTTPStatus.BAD_REQUEST, b"a header occurs twice\n")
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
        """Serve a client until its connection ends."""
        from websockets.exceptions import ConnectionClosed

        line = connection.transport.get_extra_info("socket")
        if line is not None:
            line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, self._terms.unsent)
        number, turn = next(self._numbers), 0
        budget = Bucket(self._terms.rate, self._terms.burst)
        client = self._clients[number] = Client(number, connection.transport.abort, budget)
        sender = asyncio.create_task(self._send_news(connection, client))
        try:
            async for data in connection:
                self._hear(client, data)
                turn += 1
                if turn % TURN == 0:
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
        """Apply a valid order to the claims of items; return "taken", or the reason for dropping the order.

        The order to release an item is never dropped because of the limit on the rate.
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
            if self.owners.get(thing) != client.number:
                return "claim"
            del self.owners[thing]
            self._let_go(thing, "")
            return "taken"
        if kind == Kind.PRESS:
            self.owners.setdefault(thing, client.number)
        return "taken" if self.owners.get(thing) == client.number else "claim"

    def _items_of(self, client: Client) -> list[int]:
        """Return the items that a client has claimed."""
        return sorted(thing for thing, owner in self.owners.items() if owner == client.number)

    def _release_all(self, client: Client, reason: str) -> None:
        """Release all items of a client; an error on releasing one item does not prevent the release of the others."""
        for thing in self._items_of(client):
            del self.owners[thing]
            try:
                self._let_go(thing, reason)
            except Exception:  # noqa: BLE001 - a run that is ending may raise anything
                self.counts["fault"] += 1

    async def _watch(self) -> None:
        """Release the items of silent clients; while the event loop is blocked, at most 2 LOOK [s] count as silence."""
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
