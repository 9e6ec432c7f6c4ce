"""The server of pages: who is let in, what malformed messages do, and what a page that does not read costs."""

from __future__ import annotations

import gc
import json
import os
import random
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspfx.errors import InputError, MissingPackageError
from graspfx.live.view.page_server import KEYS, LONGEST, PLAIN, Order, PageServer, read_page_order
from graspfx.screen.claim_server import MOST_CLIENTS
from graspfx.screen.gate import refusal
from tests.support.waiting import wait_until

pytest.importorskip("websockets", reason="the page needs websockets: pip install 'graspfx[view]'")
MESSAGES, PATIENCE = 30_000, 60.0  # [s]
GOOD = (
    {"act": "run"}, {"act": "step", "count": 4}, {"act": "set", "slider": 0, "value": 6.5},
    {"act": "lead", "hand": 1, "finger": None, "offset": [0.0, 0.01]},
    {"act": "lead", "hand": 1, "finger": 2, "offset": [0.0, 0.01, 1]}, {"act": "squeeze", "hand": 0, "value": -0.001},
    {"act": "answer", "key": "s"},
)  # fmt: skip


class Shown:
    """A page that notes its orders."""

    def __init__(self) -> None:
        self.orders: list[Order] = []

    def document(self, path: str, host: str) -> str | None:
        return f"<!doctype html><title>{host}</title>" if path == "/" else None

    def order(self, order: Order) -> bool:
        self.orders.append(order)
        return True


@pytest.fixture
def shown() -> Shown:
    return Shown()


@pytest.fixture
def server(shown: Shown) -> Iterator[PageServer]:
    with PageServer(shown, 0) as server:
        yield server


def line(server: PageServer, origin: str | None = "", **options: Any) -> Any:
    """Open a socket as the page does."""
    from websockets.sync.client import connect

    own: Any = server.url if origin == "" else origin
    url = f"{server.url.replace('http', 'ws')}/live"
    return connect(url, origin=own, compression=None, proxy=None, max_size=None, **options)


def status_of(server: PageServer, host: str, path: str = "/") -> int:
    """Ask for the page under a name, and give the answer's status."""
    request = urllib.request.Request(server.url + path, headers={"Host": host})
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE) as reply:
            assert "frame-ancestors 'none'" in reply.headers["Content-Security-Policy"]
            assert reply.headers["X-Content-Type-Options"] == "nosniff"
            return int(reply.status)
    except urllib.error.HTTPError as error:
        return error.code


def memory() -> int:
    """Read how much memory this process has [bytes]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def malformed(rng: random.Random) -> Iterator[bytes | str]:
    """Make up messages that are none: bytes, torn and wrong ones, missing and further keys, values that are none."""
    odd: tuple[Any, ...] = (
        None, True, "x", -1, 1.5, float("nan"), float("inf"), -(2**63), 2**64, 10**400, [], {}, [1.0] * 4, "\x00",
    )  # fmt: skip
    while True:
        good = dict(rng.choice(GOOD))
        kind = rng.randrange(6)
        if kind == 0:
            yield rng.randbytes(rng.randrange(200))
        elif kind == 1:
            text = json.dumps(good)
            yield text[: rng.randrange(len(text))]
        elif kind == 2:
            yield json.dumps({**good, rng.choice(("number", "__proto__", "x" * 50)): 1})
        elif kind == 3:
            yield json.dumps({"act": rng.choice(["", "quit", "eval", None, 1, ["run"], {"act": "run"}])})
        elif kind == 4:
            del good[rng.choice([*good])]
            if good.keys() not in [KEYS[act] for act in PLAIN] or "act" not in good:
                yield json.dumps(good)
        else:
            key = rng.choice([each for each in good if each != "act"] or ["further"])
            value = rng.choice(odd)
            fits = {
                "count": value == 4, "value": value in (-1, 1.5), "finger": value is None, "offset": value == [],
                "key": value in ("x", "\x00"), "slider": False, "hand": False,
            }  # fmt: skip
            if not (fits.get(key) or (key == "value" and value == -(2**63)) or (key == "value" and value == 2**64)):
                yield json.dumps({**good, key: value})


def test_thirty_thousand_malformed_messages_change_nothing(
    server: PageServer, shown: Shown, capfd: pytest.CaptureFixture[str]
) -> None:
    from websockets.exceptions import ConnectionClosed

    messages = malformed(random.Random(15))
    sent, start = 0, 0
    while sent < MESSAGES:
        with suppress(ConnectionClosed, OSError), line(server) as socket:
            for _ in range(1000):
                socket.send(next(messages))
                sent += 1
        if sent >= 10_000 and not start:
            gc.collect()
            start = memory()
    wait_until(lambda: sum(server.counts.values()) >= 0.98 * sent)  # the last ones of a connection may not be read
    gc.collect()
    assert memory() - start < 24 << 20
    assert shown.orders == [] and server.counts["taken"] == 0
    with line(server) as socket:
        socket.send(json.dumps(GOOD[2]))
        wait_until(lambda: shown.orders)
    assert shown.orders == [Order("set", 0, value=6.5)]
    out, err = capfd.readouterr()
    assert len(out + err) < 200


def test_orders_are_read() -> None:
    assert [read_page_order(json.dumps(each)) for each in GOOD] == [
        Order("run"), Order("step", 4), Order("set", 0, value=6.5), Order("lead", 1, None, (0.0, 0.01)),
        Order("lead", 1, 2, (0.0, 0.01, 1.0)), Order("squeeze", 0, value=-0.001), Order("answer", key="s"),
    ]  # fmt: skip
    assert read_page_order(b"{}") == read_page_order("x" * (LONGEST + 1)) == "length"
    assert read_page_order("[" * 500) == "json"


def test_a_flood_is_cut_off_and_others_are_served(server: PageServer, shown: Shown) -> None:
    text = json.dumps({"act": "run"})
    with line(server) as flood, line(server) as other:
        for _ in range(5000):
            flood.send(text)
        other.send(json.dumps({"act": "pause"}))
        wait_until(lambda: Order("pause") in shown.orders)
        wait_until(lambda: sum(server.counts.values()) == 5001)
    assert server.counts["rate"] > 2000


def test_huge_messages_end_their_connection_only(server: PageServer) -> None:
    from websockets.exceptions import ConnectionClosed

    with line(server) as watcher:
        with line(server) as socket:
            with suppress(ConnectionClosed):
                socket.send("x" * 100_000)
            with pytest.raises(ConnectionClosed):
                socket.recv(timeout=PATIENCE)
        wait_until(lambda: server.clients == 1)
        assert watcher.ping().wait(PATIENCE)


def test_orders_are_taken_from_its_own_page_only(server: PageServer) -> None:
    """From no other page, and under no name that was made to lead here; a tunnel may have another port."""
    from websockets.exceptions import InvalidStatus

    for origin in (None, "http://example.org", "null", "http://127.0.0.1:1", "https://localhost"):
        with pytest.raises(InvalidStatus) as error, line(server, origin=origin):
            pass
        assert error.value.response.status_code == 403
    assert status_of(server, "localhost:9000") == 200
    assert status_of(server, "localhost", "/other") == 404
    for host in (
        "example.org",
        "127.0.0.1.example.org",
        "[",
        "user@127.0.0.1:8080",
        "127.0.0.1/x",
        "[::1]",
        "127.0.0.1:",
    ):
        assert status_of(server, host) in (400, 403)
    assert refusal({"Host": "localhost"}, is_socket=False) == ""
    assert refusal({}, is_socket=False) != ""


def test_no_more_pages_than_are_allowed(server: PageServer) -> None:
    from contextlib import ExitStack

    from websockets.exceptions import InvalidStatus

    with ExitStack() as stack:
        for _ in range(MOST_CLIENTS):
            stack.enter_context(line(server))
        with pytest.raises(InvalidStatus), line(server):
            pass


def test_it_listens_to_this_machine_only_and_says_which_port_is_in_use(server: PageServer, shown: Shown) -> None:
    assert server.line.getsockname()[0] == "127.0.0.1"
    with pytest.raises(InputError, match="in use"):
        PageServer(shown, server.line.getsockname()[1])
    with pytest.raises(InputError, match="65535"):
        PageServer(shown, 1 << 16)
    with PageServer(shown) as one, PageServer(shown) as other:
        assert one.line.getsockname()[1] != other.line.getsockname()[1]


def test_without_websockets_it_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch, shown: Shown) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    with pytest.raises(MissingPackageError, match=r"pip install 'graspfx\[view\]'"):
        PageServer(shown, 0)


def test_a_header_that_stands_twice_lets_nobody_in(server: PageServer) -> None:
    port = int(server.url.rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as line:
        line.sendall(f"GET / HTTP/1.1\r\nHost: evil.example\r\nhost: 127.0.0.1:{port}\r\n\r\n".encode())
        assert line.recv(100).startswith(b"HTTP/1.1 400 ")


def read(data: bytes) -> tuple[int, int, Any]:
    """Unpack a message of frames: number of the run, number of the first frame, and the frames."""
    run, first, count = np.frombuffer(data[:24])
    return int(run), int(first), np.frombuffer(data[24:], "<f4").reshape(int(count), -1)


def test_frames_come_in_order_and_the_last_one_may_come_again(server: PageServer) -> None:
    """A page that is opened later gets the newest frames at once; a gap begins another message; a run begins anew."""
    server.show(0, 5, np.full((2, 3), 1.0))
    server.tell({"going": True})
    with line(server) as page:
        assert json.loads(page.recv(timeout=PATIENCE)) == {"going": True}
        run, first, frames = read(page.recv(timeout=PATIENCE))
        assert (run, first, frames.tolist()) == (0, 5, [[1.0] * 3] * 2)
        server.show(0, 6, np.full((2, 3), 2.0))
        run, first, frames = read(page.recv(timeout=PATIENCE))
        assert (first, frames.tolist()) == (6, [[2.0] * 3] * 2)
        server.show(0, 20, np.full((1, 3), 3.0))
        assert read(page.recv(timeout=PATIENCE))[1] == 20
        with line(server) as other:
            other.recv(timeout=PATIENCE)
            assert [read(other.recv(timeout=PATIENCE))[1:2] for _ in range(2)] == [(5,), (20,)]
        server.show(1, 0, np.zeros((1, 3)))
        assert read(page.recv(timeout=PATIENCE))[:2] == (1, 0)


def test_a_page_that_does_not_read_slows_nobody_and_takes_no_memory(server: PageServer) -> None:
    """A page that reads gets the last of 1000 messages of 30 kB; of those for the other one the oldest are left out."""
    deaf = socket.socket()
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf.connect(("127.0.0.1", server.line.getsockname()[1]))
    with line(server, sock=deaf, max_queue=1, close_timeout=0.1), line(server) as quick:
        seen = threading.Event()

        def follow() -> None:
            with suppress(Exception):
                while True:
                    _, first, frames = read(quick.recv())
                    if first + len(frames) == 1000:
                        break
                seen.set()

        reader = threading.Thread(target=follow)
        reader.start()
        start = 0
        for k in range(1000):
            if k == 700:  # more than are kept
                gc.collect()
                start = memory()
            server.show(0, k, np.full((1, 7500), float(k)))
            time.sleep(0.0005)
        assert seen.wait(PATIENCE)
        reader.join()
        gc.collect()
        assert memory() - start < 16 << 20
        assert server.clients == 2  # nobody waited for the page that does not read: it is there, and has not read
