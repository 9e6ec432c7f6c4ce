"""The server of a touch screen: who is let in, who has a finger, and what becomes of orders that are not sound."""

from __future__ import annotations

import http.client
import json
import random
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from graspfx.errors import DeviceError
from graspfx.screen.claim_server import LOOK, MOST_CLIENTS, SILENCE, TURN
from graspfx.screen.gate import NAMES, Gate, listen, url
from graspfx.screen.touch_orders import ORDER, Box, Kind, Order
from graspfx.screen.touch_server import BURST, HEAD, TouchServer
from tests.support.hardware import VirtualClock
from tests.support.waiting import let_pass
from tests.support.waiting import wait_until as until

pytest.importorskip("websockets", reason="the page's socket: pip install 'graspfx[touch]'")
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection
from websockets.sync.client import connect as open_socket
from websockets.sync.connection import Connection

PATIENCE = 60.0  # [s]
FATES = ("taken", "length", "kind", "finger", "place", "number", "rate", "claim")
BOX = Box(-0.15, -0.1, 0.15, 0.1)
SCENERY = json.dumps({"title": "a test"})


class Fingers:
    """Fingers that note what is asked of them."""

    def __init__(self) -> None:
        self.places: dict[int, tuple[float, float]] = {}
        self.lifts: list[int] = []
        self.presses = 0

    def press(self, finger: int, place: tuple[float, float]) -> None:
        self.presses += 1
        self.places[finger] = place
        assert BOX.contains(*place)

    def lift(self, finger: int) -> None:
        del self.places[finger]
        self.lifts.append(finger)


class Server:
    """A server with its fingers, and clients of it."""

    def __init__(self, server: TouchServer, fingers: Fingers, notes: list[tuple[int, Order, str]]) -> None:
        self.server, self.fingers, self.notes = server, fingers, notes
        self.host = url(server.line).removeprefix("http://").rstrip("/")

    def get(self, path: str = "/", **headers: str) -> tuple[int, http.client.HTTPMessage, str]:
        name, port = self.host.split(":")
        line = http.client.HTTPConnection(name, int(port), timeout=PATIENCE)
        line.request("GET", path, headers=headers)
        answer = line.getresponse()
        text = answer.read().decode()
        line.close()
        return answer.status, answer.headers, text

    def client(self, origin: str | None = "", **headers: str) -> ClientConnection:
        own: Any = f"http://{self.host}" if origin == "" else origin
        line = open_socket(
            f"ws://{self.host}/socket", origin=own, additional_headers=headers, compression=None, proxy=None,
            open_timeout=PATIENCE,
        )  # fmt: skip
        return line.__enter__()


@contextmanager
def serving(gate: Gate | None = None) -> Iterator[Server]:
    """Serve a page on the virtual clock, or behind a gate with another one."""
    gate = gate or Gate(NAMES, 0, locked=False, clock=VirtualClock().now)
    fingers, notes = Fingers(), list[tuple[int, Order, str]]()
    with (
        listen("127.0.0.1", 0) as line,
        TouchServer(line, gate, 3, BOX, SCENERY, fingers, lambda *note: notes.append(note)) as server,
    ):
        yield Server(server, fingers, notes)


def read_all(client: Connection) -> None:
    while True:
        client.recv(timeout=PATIENCE)


def order(kind: Kind, finger: int, number: int, x: float = 0.0, y: float = 0.0) -> bytes:
    return ORDER.pack(kind, finger, 0, number, x, y)


def test_the_page_runs_nothing_but_itself() -> None:
    with serving() as site:
        status, headers, text = site.get()
        assert status == 200 and "<canvas" in text and "@nonce@" not in text
        assert "http://" not in text and "https://" not in text and " src=" not in text
        policy = headers["Content-Security-Policy"]
        assert (
            policy.startswith("default-src 'none'; script-src 'nonce-") and f"connect-src ws://{site.host};" in policy
        )
        assert headers["Cache-Control"] == "no-store" and headers["Referrer-Policy"] == "no-referrer"
        assert "Set-Cookie" not in headers
        assert site.get()[1]["Content-Security-Policy"] != policy  # a number once
        assert site.get("/other")[0] == 404


def test_strangers_are_refused() -> None:
    with serving() as site:
        assert site.get(Host="evil.example")[0] == 403
        assert site.get(Origin="http://evil.example")[0] == 403
        for origin in ("http://evil.example", "null", None):
            with pytest.raises(InvalidStatus, match="403"):
                site.client(origin)
        with socket.create_connection(site.host.split(":")) as line:  # type: ignore[arg-type]
            line.sendall(f"GET / HTTP/1.1\r\nHost: {site.host}\r\nHost: evil.example\r\n\r\n".encode())
            assert line.recv(100).startswith(b"HTTP/1.1 400")
        with socket.create_connection(site.host.split(":")) as line:  # type: ignore[arg-type]
            line.sendall(b"\x16\x03\x01\x00" * 10 + b"\r\n\r\n")
            assert not line.recv(100).startswith(b"HTTP/1.1 200")
        assert not site.fingers.presses
        assert site.get()[0] == 200


def test_a_locked_page_is_for_whoever_has_the_token() -> None:
    gate = Gate({"127.0.0.1"}, 0, locked=True, clock=VirtualClock().now)
    token = gate.renew()
    with serving(gate) as site:
        assert site.get()[0] == 403
        with pytest.raises(InvalidStatus, match="403"):
            site.client()
        status, headers, _ = site.get(f"/?token={token}")
        assert status == 200
        assert site.get(f"/?token={token}")[0] == 403
        cookie = headers["Set-Cookie"].partition(";")[0]
        with site.client(Cookie=cookie) as client:
            assert json.loads(client.recv()) == {"title": "a test"}
        with pytest.raises(InvalidStatus, match="403"):
            site.client(Cookie=f"{cookie}x")
        statuses = [site.get("/?token=wrong")[0] for _ in range(6)]
        assert statuses[-1] == 429
        assert site.server.counts["refused 403"] >= 5


def test_the_first_who_touches_has_the_finger_and_pictures_say_so() -> None:
    with serving() as site, site.client() as one, site.client() as two:
        assert json.loads(one.recv()) == json.loads(two.recv()) == {"title": "a test"}
        one.send(order(Kind.PRESS, 1, 1, 0.01, 0.02))
        until(lambda: site.fingers.places == {1: (0.01, 0.02)})
        two.send(order(Kind.PRESS, 1, 1, -0.1, 0.0))
        two.send(order(Kind.LIFT, 1, 2))
        two.send(order(Kind.PRESS, 0, 5, 0.05, 0.0))
        until(lambda: 0 in site.fingers.places)
        assert site.fingers.places == {0: (0.05, 0.0), 1: (0.01, 0.02)} and not site.fingers.lifts
        assert site.server.counts["claim"] == 2 and site.server.counts["lost"] == 2
        picture = struct.pack("<d", 7.0)
        site.server.show(picture)

        def heads(client: Connection) -> tuple[float, ...]:
            while True:
                data = client.recv(timeout=PATIENCE)
                if isinstance(data, bytes) and data.endswith(picture) and len(data) == HEAD.size + 8:
                    return HEAD.unpack(data[: HEAD.size])

        assert heads(one) == (1.0, 0b010, 0b011, 0.0)
        assert heads(two) == (5.0, 0b001, 0b011, 2.0)
        one.send(order(Kind.LIFT, 1, 2))
        until(lambda: site.fingers.lifts == [1])
        assert [fate for _, _, fate in site.notes] == ["taken", "claim", "claim", "taken", "taken"]


def test_whoever_is_lost_lets_go() -> None:
    """A closed socket at once, one that is reset too, and a silent one half a second after its last sound order."""
    with serving() as site:
        with site.client() as client:
            client.send(order(Kind.PRESS, 0, 1))
            client.send(order(Kind.PRESS, 2, 2))
            until(lambda: len(site.fingers.places) == 2)
        until(lambda: sorted(site.fingers.lifts) == [0, 2])
        crashing = site.client()
        crashing.send(order(Kind.PRESS, 1, 1))
        until(lambda: 1 in site.fingers.places)
        crashing.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        crashing.socket.shutdown(socket.SHUT_RDWR)
        until(lambda: site.fingers.lifts[2:] == [1])
        crashing.close()
        with site.client() as client:
            client.send(order(Kind.PRESS, 0, 1))
            until(lambda: 0 in site.fingers.places)
            for number in range(2, 6):
                let_pass(site.server, 0.2)
                client.send(order(Kind.ALIVE, 0, number))
                until(lambda number=number: site.server.last == number)  # type: ignore[misc]
            assert len(site.fingers.lifts) == 3  # for 0.8 s: it is there
            for looks in (SILENCE / LOOK - 1, 2):
                assert len(site.fingers.lifts) == 3
                client.send(b"rubbish")  # which is no sign of life
                let_pass(site.server, looks * LOOK)
            assert len(site.fingers.lifts) == 4
            client.send(order(Kind.MOVE, 0, 10, 0.1, 0.0))  # its finger is nobody's now
            until(lambda: site.server.counts["claim"] == 1)
            client.send(order(Kind.PRESS, 0, 11, 0.1, 0.0))
            until(lambda: site.fingers.places == {0: (0.1, 0.0)})
        assert site.server.counts["let go: silence"] == 1


def test_a_flood_of_rubbish_leads_nowhere_and_no_other_screen_suffers() -> None:
    """10^4 damaged messages: the fingers stay inside the box; another screen goes on meanwhile."""
    chance = random.Random(2)
    messages = []
    for k in range(10_000):
        data = bytearray(order(Kind(chance.choice((1, 2))), chance.randrange(3), k + 1, 0.01, 0.02))
        for _ in range(chance.randrange(1, 5)):
            data[chance.randrange(24)] = chance.randrange(256)
        messages.append(bytes(data[: chance.choice((24, 24, 24, 0, 7, 23))]) + bytes(chance.choice((0, 0, 0, 3))))
    with serving() as site, site.client() as other, site.client() as flood:
        counts, kept, poured = site.server.counts, threading.Event(), threading.Event()
        heard: list[int] = []  # of the flood, with each order of the other screen

        def pour() -> None:
            for k, data in enumerate(messages):
                flood.send(data if len(data) % 2 == 0 else data.decode("latin-1"))
                if k == 1000:
                    poured.set()

        def press(finger: int, place: tuple[float, float]) -> None:
            if finger == 2:
                heard.append(sum(counts[each] for each in FATES))
            Fingers.press(site.fingers, finger, place)

        other.send(order(Kind.PRESS, 2, 1, 0.1, 0.1))
        until(lambda: site.fingers.places.get(2) == (0.1, 0.1))
        site.server._post(kept.wait, PATIENCE)
        thread = threading.Thread(target=pour)
        thread.start()
        assert poured.wait(PATIENCE)
        site.fingers.press = press  # type: ignore[method-assign]
        other.send(order(Kind.MOVE, 2, 2, 0.1, -0.1))
        kept.set()
        thread.join()
        until(lambda: sum(counts[each] for each in FATES) == 10_000 + 2)
        assert site.fingers.places[2] == (0.1, -0.1)
        assert counts["length"] > 3_000 and counts["place"] > 100 and counts["kind"] > 100 and counts["finger"] > 100
        assert heard[0] < 4 * TURN  # of a thousand that were there before


def test_orders_are_bounded_but_a_finger_can_always_go_up() -> None:
    with serving() as site, site.client() as client:
        most = 4 * int(BURST)
        client.send(order(Kind.PRESS, 0, 1))
        for number in range(2, most):
            client.send(order(Kind.MOVE, 0, number, 0.1, 0.0))
        client.send(order(Kind.LIFT, 0, most))
        until(lambda: site.fingers.lifts == [0])
        assert len(site.notes) == most  # they came, and were not followed
        assert site.server.counts == {"lost": 0, "taken": BURST + 1, "rate": most - BURST - 1}
        client.send(bytes(1000))  # longer than any order
        with pytest.raises(ConnectionClosed):
            read_all(client)


@pytest.mark.alone
def test_a_screen_is_silent_for_half_a_second_by_the_machine_s_clock() -> None:
    with serving(Gate(NAMES, 0, locked=False)) as site, site.client() as client:
        client.send(order(Kind.PRESS, 0, 1))
        until(lambda: 0 in site.fingers.places)
        began = time.monotonic()
        until(lambda: site.fingers.lifts == [0])
        assert 0.3 < time.monotonic() - began < 10.0


def test_screens_are_few_and_a_port_is_one_program_s() -> None:
    with serving() as site:
        clients = [site.client() for _ in range(MOST_CLIENTS)]
        with pytest.raises(InvalidStatus, match="503"):
            site.client()
        for client in clients:
            client.close()
        with pytest.raises(Exception, match="a free port"):
            listen("127.0.0.1", int(site.host.split(":")[1]))
    with listen("127.0.0.1", 0) as line:
        line.close()
        with (
            pytest.raises(DeviceError, match="server of the page cannot start"),
            TouchServer(line, Gate({"127.0.0.1"}, 0, locked=False), 1, BOX, SCENERY, Fingers()),
        ):
            pass
