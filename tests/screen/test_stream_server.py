"""The server of a stream: who is let in, whose goals count, and that a slow client delays nobody."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from graspfx.errors import InputError
from graspfx.screen import claim_server
from graspfx.screen.claim_server import LOOK, MOST_CLIENTS, SILENCE
from graspfx.screen.gate import NAMES, StreamGate, listen
from graspfx.screen.stream_server import BURST, LONGEST, SOCKET, Bounds, StreamOrder, StreamServer, read_stream_order
from tests.support.hardware import VirtualClock
from tests.support.waiting import let_pass
from tests.support.waiting import wait_until as until

pytest.importorskip("websockets", reason="the stream's socket: pip install 'graspfx[touch]'")
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection
from websockets.sync.client import connect as open_socket
from websockets.sync.connection import Connection

PATIENCE = 60.0  # [s]
TOKEN = "a-token-of-the-tests"
BOUNDS = Bounds(2, 0.2, 0.05)


class Hands:
    """Hands that note how they are led."""

    def __init__(self) -> None:
        self.orders: list[StreamOrder] = []
        self.releases: list[int] = []

    def lead(self, order: StreamOrder) -> None:
        self.orders.append(order)

    def release(self, guide: int) -> None:
        self.releases.append(guide)


class Stream:
    """A server with its hands, and clients of it."""

    def __init__(self, server: StreamServer, hands: Hands, host: str) -> None:
        self.server, self.hands, self.host = server, hands, host

    def client(
        self, token: str = TOKEN, path: str = SOCKET, origin: Any = None, sock: Any = None, **headers: str
    ) -> ClientConnection:
        line = open_socket(
            f"ws://{self.host}{path}?token={token}", origin=origin, additional_headers=headers, compression=None,
            proxy=None, sock=sock, open_timeout=PATIENCE,
        )  # fmt: skip
        return line.__enter__()

    def refusal(self, **choices: Any) -> int:
        with pytest.raises(InvalidStatus) as caught:
            self.client(**choices)
        return int(caught.value.response.status_code)


@contextmanager
def streaming(**choices: Any) -> Iterator[Stream]:
    hands = Hands()
    with listen("127.0.0.1", 0, 0) as line:
        port = line.getsockname()[1]
        gate = StreamGate(NAMES, 0, TOKEN, **choices, clock=VirtualClock().now)
        with StreamServer(line, gate, hands.lead, hands.release) as server:
            server.describe('{"type":"hello"}', BOUNDS)
            yield Stream(server, hands, f"127.0.0.1:{port}")


def goal(number: int, guide: int = 0, **more: Any) -> str:
    return json.dumps({"type": "goal", "number": number, "guide": guide, "offset": [0.01, 0.0, 0.0]} | more)


def test_a_program_brings_the_token() -> None:
    with streaming(origins=["http://localhost:5000"]) as stream:
        assert stream.refusal(token="wrong" * 4) == 403
        assert stream.refusal(token="") == 403
        assert stream.refusal(origin="https://elsewhere.example") == 403
        assert stream.refusal(Host="elsewhere.example") in (400, 403)
        assert stream.refusal(path="/other") == 404
        for origin in (None, f"http://{stream.host}", "http://localhost:5000"):
            with stream.client(origin=origin) as client:
                assert json.loads(client.recv(PATIENCE)) == {"type": "hello"}
        assert [stream.refusal(token="wrong" * 4) for _ in range(4)][-1] == 429
        with stream.client() as client:  # who has the token is let in, whatever others of there have brought
            assert json.loads(client.recv(PATIENCE)) == {"type": "hello"}
        assert stream.refusal(token="wrong" * 4) == 429


def test_tokens_and_origins_that_are_none() -> None:
    for token in ("short", "with a space in it", "a" * 16 + "&"):
        with pytest.raises(InputError, match="16 letters"):
            StreamGate(NAMES, 0, token)
    with pytest.raises(InputError, match=r"the address of a site"):
        StreamGate(NAMES, 0, origins=["*"])
    assert len({StreamGate(NAMES, 0).token for _ in range(3)}) == 3


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"\x00" * 10, "length"), ("x" * (LONGEST + 1), "length"), ("[" * LONGEST, "json"), ("{", "json"),
        ('{"type":"goal","number":1,"guide":0,"offset":[NaN,0,0]}', "json"), ("[]", "kind"), ('{"type":[]}', "kind"),
        ('{"type":"goal","number":1,"guide":0,"more":1}', "kind"), ('{"type":"let_go","number":1,"guide":0}', "kind"),
        ('{"type":"alive","number":true}', "number"), ('{"type":"alive","number":-1}', "number"),
        ('{"type":"alive","number":9007199254740992}', "number"), (goal(1, 2), "guide"), (goal(1, True), "guide"),
        (goal(1, offset=[0.0, 0.0]), "place"), (goal(1, offset=[0.3, 0.0, 0.0]), "place"),
        (goal(1, offset=[1e400, 0.0, 0.0]), "json"), (goal(1, offset=["0", 0, 0]), "place"),
        (goal(1, squeeze=0.06), "place"), (goal(1, squeeze=True), "place"),
        ('{"type":"goal","number":1,"guide":0,"offset":[1e999,0,0]}', "place"),
    ],
)  # fmt: skip
def test_orders_that_are_not_sound(data: bytes | str, reason: str) -> None:
    assert read_stream_order(data, *BOUNDS) == reason


def test_sound_orders() -> None:
    assert read_stream_order(goal(3, 1, squeeze=-0.01), *BOUNDS) == StreamOrder("goal", 3, 1, (0.01, 0.0, 0.0), -0.01)
    assert read_stream_order(goal(3, offset=None), *BOUNDS) == StreamOrder("goal", 3, 0)
    assert read_stream_order('{"type":"release","number":4,"guide":1}', *BOUNDS) == StreamOrder("release", 4, 1)
    assert read_stream_order('{"type":"alive","number":5}', *BOUNDS) == StreamOrder("alive", 5)


def last(client: Connection, stream: Stream) -> dict[str, Any]:
    """Have a state shown, and read what it says of the client."""
    stream.server.show('{"type":"state"}')
    while "you" not in (message := json.loads(client.recv(PATIENCE))):
        pass
    return dict(message["you"])


def test_one_client_leads_a_guide_until_it_leaves_or_falls_silent() -> None:
    with streaming() as stream, stream.client() as one, stream.client() as other:
        one.send(goal(1))
        until(lambda: len(stream.hands.orders) == 1)
        other.send(goal(1))
        other.send(goal(2, 1))
        until(lambda: len(stream.hands.orders) == 2)
        assert stream.server.counts["claim"] == 1
        one.send(goal(1))
        until(lambda: stream.server.counts["number"] == 1)
        assert last(other, stream) == {"last": 2, "leads": [1], "dropped": 1, "why": "claim"}
        one.send('{"type":"release","number":2,"guide":0}')
        until(lambda: stream.hands.releases == [0])
        other.send(goal(3))
        until(lambda: len(stream.hands.orders) == 3)
        other.close()
        until(lambda: sorted(stream.hands.releases) == [0, 0, 1])
        one.send(goal(3))
        until(lambda: len(stream.hands.orders) == 4)
        let_pass(stream.server, SILENCE - LOOK)
        assert stream.hands.releases.count(0) == 2
        let_pass(stream.server, 2.0 * LOOK)
        assert stream.hands.releases.count(0) == 3
        stream.server.describe('{"type":"hello"}', Bounds())
        one.send(goal(4))
        until(lambda: stream.server.counts["guide"] == 1)


def test_a_flood_is_dropped_and_a_long_message_ends_the_connection() -> None:
    with streaming() as stream:
        with stream.client() as client:
            for number in range(1, int(3 * BURST) + 1):
                client.send(goal(number))
            until(lambda: sum(stream.server.counts.values()) == 3 * BURST)
            assert stream.server.counts == {"taken": BURST, "rate": 2 * BURST}
        with stream.client() as client:
            client.send("x" * (LONGEST + 1))
            client.recv(PATIENCE)
            with pytest.raises(ConnectionClosed):
                client.recv(PATIENCE)


def test_a_slow_client_gets_the_newest_and_delays_nobody() -> None:
    """One never reads: others get every state all the while; when it reads, few old ones come before the newest."""
    pad = "x" * 40_000
    with streaming() as stream, socket.socket() as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        line.connect(stream.server.line.getsockname())
        with stream.client(sock=line) as slow, stream.client() as quick:
            slow.recv(PATIENCE), quick.recv(PATIENCE)
            slow.recv_messages.pause()
            for number in range(200):
                stream.server.show(f'{{"type":"state","number":{number},"pad":"{pad}"}}')
                while json.loads(quick.recv(PATIENCE))["number"] != number:
                    pass
            slow.recv_messages.resume()
            seen = 0
            while json.loads(slow.recv(PATIENCE))["number"] != 199:
                seen += 1
            assert seen < 30


def test_a_client_that_never_reads_does_not_hold_up_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page that sleeps does not take the closing frame either; pings, which end a lost one, do not come here."""
    monkeypatch.setattr(claim_server, "PATIENCE", 600.0)
    with streaming() as stream, socket.socket() as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        line.connect(stream.server.line.getsockname())
        line.sendall(
            f"GET {SOCKET}?token={TOKEN} HTTP/1.1\r\nHost: {stream.host}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
            .encode()
        )  # fmt: skip
        until(lambda: stream.server.clients)
        stream.server.show("x" * 20_000_000)  # more than the system takes
        time.sleep(0.3)
        ending = threading.Thread(target=stream.server.__exit__, daemon=True)
        ending.start()
        ending.join(20.0)
        assert not ending.is_alive()


def test_there_is_room_for_some_clients() -> None:
    with streaming() as stream:
        clients = [stream.client() for _ in range(MOST_CLIENTS)]
        assert stream.refusal() == 503
        for client in clients:
            client.close()
