"""A server of claims: each way in which a client can be lost lets go what it had, once, whatever else goes wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from graspfx.errors import DeviceError
from graspfx.screen.claim_server import LOOK, SILENCE, ClaimServer, Client, Terms
from graspfx.screen.gate import NAMES, Gate, listen
from graspfx.screen.touch_orders import Kind
from tests.support.hardware import VirtualClock
from tests.support.waiting import let_pass
from tests.support.waiting import wait_until as until

pytest.importorskip("websockets", reason="the server's socket: pip install 'graspfx[touch]'")
from websockets.sync.client import connect as open_socket

LOST = SILENCE + LOOK  # after which a silent client is looked at as lost [s]


class Things(ClaimServer):
    """Four things, that note when they are let go; those that stick raise an error then."""

    def __init__(self, line: Any) -> None:
        gate = Gate(NAMES, 0, locked=False, clock=VirtualClock().now)
        super().__init__(line, "things", gate, Terms("/things", 64, 500.0, 500.0))
        self.ends: list[tuple[int, str]] = []
        self.stuck: set[int] = set()

    def _take(self, client: Client, data: bytes | str) -> str:
        number, kind, thing = map(int, data.split())
        return self._judge(client, number, Kind(kind), thing)

    def _let_go(self, thing: int, reason: str) -> None:
        self.ends.append((thing, reason))
        if thing in self.stuck:
            raise DeviceError("it sticks")

    def _message(self, client: Client) -> str:
        return ""


@contextmanager
def serving() -> Iterator[tuple[Things, Callable[[], Any]]]:
    with listen("127.0.0.1", 0, 0) as line, Things(line) as server:
        host = f"127.0.0.1:{line.getsockname()[1]}"
        own: Any = f"http://{host}"
        yield server, lambda: open_socket(f"ws://{host}/things", origin=own, compression=None, proxy=None)


def claim(client: Any, number: int, thing: int, kind: Kind = Kind.PRESS) -> None:
    client.send(f"{number} {int(kind)} {thing}")


def test_each_way_to_be_lost_lets_go_once() -> None:
    """One says so, one closes, one falls silent, and one is there still when the server ends."""
    with serving() as (server, client):
        with client() as one:
            claim(one, 1, 0)
            claim(one, 2, 1)
            claim(one, 3, 0, Kind.LIFT)
            until(lambda: server.ends == [(0, "")])
        until(lambda: server.ends[1:] == [(1, "lost")])
        with client() as silent:
            claim(silent, 1, 2)
            until(lambda: server.counts["taken"] == 4)
            let_pass(server, SILENCE - LOOK)
            assert len(server.ends) == 2
            let_pass(server, 2.0 * LOOK)
            assert server.ends[2:] == [(2, "silence")]
            claim(silent, 2, 2, Kind.MOVE)  # nobody's now
            until(lambda: server.counts["claim"] == 1)
            claim(silent, 3, 3)
            until(lambda: server.counts["taken"] == 5)
            server.__exit__()
        assert server.ends[3:] == [(3, "lost")]


def test_one_that_cannot_be_let_go_keeps_no_other_and_clients_are_watched_on() -> None:
    with serving() as (server, client):
        server.stuck = {0, 2}
        with client() as one, client() as two:
            for number, thing in enumerate((0, 1)):
                claim(one, number + 1, thing)
            until(lambda: server.counts["taken"] == 2)
            let_pass(server, LOST)
            assert server.ends == [(0, "silence"), (1, "silence")]
            claim(two, 1, 2)
            claim(two, 2, 3)
            until(lambda: server.counts["taken"] == 4)
            let_pass(server, LOST)
            assert server.ends[2:] == [(2, "silence"), (3, "silence")]
            claim(one, 3, 1)
            until(lambda: server.counts["taken"] == 5)
            let_pass(server, LOST)
            assert server.ends[4:] == [(1, "silence")]
        assert server.counts["fault"] == 2


def test_time_in_which_nobody_listened_is_no_silence() -> None:
    """The server's thread is kept for longer than a silence, while the client goes on."""
    with serving() as (server, client), client() as one:
        claim(one, 1, 0)
        until(lambda: server.counts["taken"] == 1)
        (own,) = server._clients.values()
        VirtualClock.time += 2.0 * SILENCE
        assert until(lambda: own.silence) < 0.5 * SILENCE
        claim(one, 2, 0, Kind.ALIVE)
        until(lambda: server.counts["taken"] == 2)
        assert own.silence == 0.0 and not server.ends
