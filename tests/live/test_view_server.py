"""The server of a page: who is let in, what malformed messages do, and that no tunnel leads out of this machine."""

from __future__ import annotations

import gc
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

import pytest

from graspfx.errors import InputError, MissingPackageError
from graspfx.live.view import page_server as module
from graspfx.live.view.gate import FIELDS, LARGEST, MOST_BAD, message_in
from graspfx.live.view.page_server import Server, listen, page_server
from graspfx.screen.own_page import refusal
from tests.support.waiting import wait_until

viser = pytest.importorskip("viser", reason="the view needs viser: pip install 'graspfx[view]'")
msgspec = pytest.importorskip("msgspec")
PROTOCOL = f"viser-v{viser.__version__}"
MESSAGES, PATIENCE = 100_000, 60.0  # [s]
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, 0.0, 1.0],
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 1.0, 0.0], "fov": 1.0, "near": 0.1, "far": 10.0, "image_height": 100, "image_width": 100,
}  # fmt: skip


class Orders(list[Any]):
    """Values that controls of a page received."""


@pytest.fixture
def server() -> Iterator[Server]:
    server = page_server("a page", 0)
    try:
        yield server
    finally:
        server.stop()


def controls(server: Server) -> tuple[Orders, Any, Any, Any]:
    """Give a page a slider, buttons and a gizmo."""
    orders = Orders()

    async def take(event: Any) -> None:
        if event.client_id is not None:
            orders.append(getattr(event.target, "value", None))

    slider = server.viser.gui.add_slider("gain", 0.0, 10.0, 0.1, 5.0)
    group = server.viser.gui.add_button_group("run", ("Run", "Pause"))
    gizmo = server.viser.scene.add_transform_controls("/hands/0")
    for handle, subscribe in ((slider, slider.on_update), (group, group.on_click), (gizmo, gizmo.on_update)):
        assert handle is not None
        subscribe(take)
    return orders, slider, group, gizmo


def line(server: Server, origin: str | None = "", subprotocol: str = PROTOCOL, **headers: str) -> Any:
    """Open a socket as the page does."""
    from websockets.sync.client import connect

    url = server.url.replace("http", "ws")
    own: Any = server.url if origin == "" else origin
    return connect(
        url, origin=own, subprotocols=[subprotocol], compression=None, additional_headers=headers, proxy=None,  # type: ignore[list-item]
        max_size=None,
    )  # fmt: skip


def encoded(message: Any) -> bytes:
    return bytes(msgspec.msgpack.encode(message))


def read_on(socket: Any) -> None:
    """Read until the connection ends."""
    while True:
        socket.recv(timeout=PATIENCE)


def status_of(server: Server, host: str) -> int:
    """Ask for the page under a name, and give the answer's status."""
    request = urllib.request.Request(server.url, headers={"Host": host})
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE) as reply:
            policy = reply.headers["Content-Security-Policy"]
            assert "default-src 'none'" in policy
            assert "frame-ancestors 'none'" in policy
            return int(reply.status)
    except urllib.error.HTTPError as error:
        return error.code


def memory() -> int:
    """Read how much memory this process has [bytes]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def malformed(rng: random.Random, uuid: str, group: str) -> Iterator[bytes | str]:
    """Make up messages that are none: bytes, torn and wrong ones, controls that are not there, values out of range."""
    good = [encoded(CAMERA), encoded({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": 6.0}})]
    odd: tuple[Any, ...] = (
        None, True, "x", 11.0, -1.0, float("nan"), float("inf"), 1e308, -(2**63), 2**64 - 1, [], {}, [1.0] * 4, b"\xff",
    )  # fmt: skip
    while True:
        kind = rng.randrange(9)
        if kind == 0:
            yield rng.randbytes(rng.randrange(200))
        elif kind == 1:
            text = rng.choice(good)
            yield text[: rng.randrange(len(text))]
        elif kind == 2:
            yield "text"
        elif kind == 3:
            yield encoded({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": rng.choice(odd)}})
        elif kind == 4:
            prop = rng.choice(("max", "min", "removed", "update_cb", "is_button", "_impl", "disabled", "visible"))
            yield encoded({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {prop: rng.choice(odd)}})
        elif kind == 5:
            yield encoded({"type": "GuiUpdateMessage", "uuid": group, "updates": {"value": rng.choice(odd)}})
        elif kind == 6:
            place = [rng.choice(odd), 0.0, 0.0]
            gizmo = {"name": rng.choice(("/hands/0", "/hands/7", "/")), "owner": "", "wxyz": [1.0, 0.0, 0.0, 0.0]}
            wrong = not isinstance(place[0], float) or not abs(place[0]) <= 1e6
            name = gizmo["name"] if wrong else "/nobody"
            yield encoded({"type": "TransformControlsUpdateMessage", **gizmo, "name": name, "position": place})
        elif kind == 7:
            names = ("ShareUrlRequest", "ShareUrlDisconnect", "ResetGuiMessage", "Message", "RunJavascriptMessage", "")
            yield encoded({"type": rng.choice(names)})
        else:
            fields = dict(CAMERA)
            fields[rng.choice([*fields, "further"])] = rng.choice(odd[:3])
            yield encoded(fields)


def test_a_hundred_thousand_malformed_messages_change_nothing(
    server: Server, capfd: pytest.CaptureFixture[str]
) -> None:
    from websockets.exceptions import ConnectionClosed

    orders, slider, group, gizmo = controls(server)
    rng = random.Random(15)
    messages = malformed(rng, slider._impl.uuid, group._impl.uuid)
    sent, start = 0, 0
    while sent < MESSAGES:
        with suppress(ConnectionClosed, OSError), line(server) as socket:
            for _ in range(MOST_BAD):
                socket.send(next(messages))
                sent += 1
        if sent >= 10_000 and not start:
            gc.collect()
            start = memory()
    # of a connection that was closed the last ones are not read
    wait_until(lambda: server.gate.bad >= 0.9 * sent)
    gc.collect()
    assert memory() - start < 24 << 20
    assert orders == []
    assert slider.value == 5.0
    assert slider.max == 10.0
    assert tuple(gizmo.position) == (0.0, 0.0, 0.0)
    assert server.viser._share_tunnel is None
    with line(server) as socket:
        socket.send(encoded(CAMERA))
        socket.send(encoded({"type": "GuiUpdateMessage", "uuid": slider._impl.uuid, "updates": {"value": 6.5}}))
        wait_until(lambda: orders)
    assert orders == [6.5]
    out, err = capfd.readouterr()
    assert len(out + err) < 200


def test_huge_messages_and_foreign_versions_end_their_connection_only(server: Server) -> None:
    from websockets.exceptions import ConnectionClosed

    with line(server) as watcher:
        watcher.send(encoded(CAMERA))
        with line(server) as socket:
            with suppress(ConnectionClosed):
                socket.send(b"\xc6" + bytes(LARGEST + 1))
            with pytest.raises(ConnectionClosed):
                read_on(socket)
        with line(server, subprotocol="viser-v0.0.1") as socket, pytest.raises(ConnectionClosed):
            read_on(socket)
        wait_until(lambda: server.pages == 1)
        assert watcher.ping().wait(PATIENCE)


def test_orders_are_taken_from_its_own_page_only(server: Server) -> None:
    """From no other page, and under no name that was made to lead here; a tunnel may have another port."""
    from websockets.exceptions import InvalidStatus

    for origin in (None, "http://example.org", "null", "http://127.0.0.1:1", "https://localhost"):
        with pytest.raises(InvalidStatus) as error, line(server, origin=origin):
            pass
        assert error.value.response.status_code == 403
    assert status_of(server, "localhost:9000") == 200
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


def test_it_listens_to_this_machine_only_and_says_which_port_is_in_use(server: Server) -> None:
    assert server._line.getsockname()[0] == "127.0.0.1"
    port = server._line.getsockname()[1]
    with pytest.raises(InputError, match="in use"):
        listen(port)
    with pytest.raises(InputError, match="65535"):
        listen(1 << 16)
    with listen() as one, listen() as other:
        assert one.getsockname()[1] != other.getsockname()[1]


def test_without_viser_it_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "find_spec", lambda _: None)
    with pytest.raises(MissingPackageError, match=r"pip install 'graspfx\[view\]'"):
        page_server("a page", 0)


def test_a_viser_that_starts_otherwise_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    from graspfx.errors import GraspFXError

    class Other:
        __version__ = "9.9"

        class ViserServer:
            def __init__(self, *_: object, **__: object) -> None: ...

            def stop(self) -> None: ...

    with listen(0) as socket, pytest.raises(GraspFXError, match=r"viser 9\.9 .* cannot be guarded"):
        Server(Other, socket, "a page", None)


def test_every_message_has_its_check() -> None:
    assert message_in(encoded(CAMERA)) == CAMERA
    assert message_in("text") is None
    for kind in FIELDS:
        assert message_in(encoded({"type": kind})) is None
    assert refusal({"Host": "localhost"}, is_socket=False) == ""
    assert refusal({}, is_socket=False) != ""


def test_a_page_that_does_not_read_slows_nobody_and_takes_no_memory(server: Server) -> None:
    """A page that reads gets the last of 1500 frames of 30 kB; those of the other one are left out."""
    from websockets.sync.client import connect

    text = server.viser.gui.add_html("")
    url = server.url.replace("http", "ws")
    buffer = server.viser._websock_server._broadcast_buffer
    deaf = socket.socket()
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf.connect(("127.0.0.1", server._line.getsockname()[1]))
    options: dict[str, Any] = {"origin": server.url, "subprotocols": [PROTOCOL], "compression": None, "max_size": None}
    with connect(url, sock=deaf, max_queue=1, **options) as slow, line(server) as quick:
        for each in (slow, quick):
            each.send(encoded(CAMERA))
        seen = threading.Event()

        def read() -> None:
            with suppress(Exception):
                while b"frame 1499" not in zstd(quick.recv()):
                    pass
                seen.set()

        reader = threading.Thread(target=read)
        reader.start()
        start = 0
        noise = [random.Random(k).randbytes(30_000).hex() for k in range(7)]  # which nothing packs into less than half
        for k in range(1500):
            if k == 200:
                gc.collect()
                start = memory()
            text.content = f"frame {k} {noise[k % len(noise)]}"
            time.sleep(0.0005)
        server.viser.flush()
        assert seen.wait(PATIENCE)
        reader.join()
        assert len(buffer.message_from_id) < 60
        assert memory() - start < 16 << 20
        assert server.pages == 2  # nobody waited for the page that does not read: it is there, and has not read


def zstd(data: Any) -> bytes:
    """Unpack the first part of a frame of viser's."""
    import zstandard

    size, packed = (int.from_bytes(data[at : at + 8], "little") for at in (0, 8))
    return bytes(zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=size))


def test_a_header_that_stands_twice_lets_nobody_in(server: Server) -> None:
    port = int(server.url.rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as line:
        line.sendall(f"GET / HTTP/1.1\r\nHost: evil.example\r\nhost: 127.0.0.1:{port}\r\n\r\n".encode())
        assert line.recv(100).startswith(b"HTTP/1.1 400 ")
