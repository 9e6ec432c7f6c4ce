"""An emulator of the Haply Inverse service: a WebSocket that answers each message once, for several devices."""

from __future__ import annotations

import base64
import hashlib
import json
import select
import socket
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.testing.wire.damage import Damage
from graspfx.testing.wire.wire import Failure, Wire

FloatArray = NDArray[np.float64]

MAGIC = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
HOME = 0.03, -0.1, 0.15  # of the first device [m]
APART = 0.1  # from one device to the next, along x [m]
STEP = 0.003  # of `move`, along every axis [m]
IDLE = 0.001  # between two looks of a connection at what is due [s]
TEXT, CLOSE, PING, PONG = 1, 8, 9, 10


class InverseWire(Wire):
    """A service with devices that nothing moves but a test; a force stays until another one is set.

    That is the worst that a service can do: of the real one nobody has seen whether it drops the force of a program
    that has died. Coordinates of exactly zero are left out of its answers.

    Args:
        devices: their ids.
        config: of each device, as its first message says it.
        stall: of one answer in a thousand [s].
        seed: of the damage that failures do.

    Attributes:
        messages: texts that have come, all connections together; the last thousands.
    """

    kinds: frozenset[Failure] = frozenset({"late", "drop", "cut", "garbage", "wrong-id", "unplugged", "blocked"})
    limit = 20.0  # [N]

    def __init__(
        self,
        devices: Sequence[str] = ("049D",),
        *,
        config: Mapping[str, Any] | None = None,
        stall: float = 0.0,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.devices, self.config, self.stall = tuple(devices), dict(config or {}), stall
        self.messages: list[str] = []
        self._places: dict[str, FloatArray] = {
            name: np.array(HOME) + APART * k * np.eye(3)[0] for k, name in enumerate(devices)
        }
        self._forces: dict[str, FloatArray] = {name: np.zeros(3) for name in devices}
        self._damage, self._lock = Damage(seed), threading.Lock()
        self._answers = 0
        self._lines: set[socket.socket] = set()
        self._threads: list[threading.Thread] = []
        self._server: socket.socket | None = None
        self._port = 0
        self._listen()

    @property
    def url(self) -> str:
        """Address of the service, the same after it was gone."""
        return f"ws://127.0.0.1:{self._port}"

    @property
    def settings(self) -> dict[str, Any]:
        return {"url": self.url, "device": self.devices[0]}

    @property
    def torque(self) -> FloatArray:
        """Force of the first device, (3,) [N]."""
        return self._forces[self.devices[0]].copy()

    @property
    def position(self) -> FloatArray:
        return self._places[self.devices[0]][None, :].copy()

    @property
    def force(self) -> FloatArray:
        return self.torque[None, :]

    def force_of(self, name: str) -> FloatArray:
        """Give the force of a device, (3,) [N]."""
        return self._forces[name].copy()

    def move(self) -> None:
        self.place(self.devices[0], np.array(HOME) + STEP)

    def home(self) -> None:
        self.place(self.devices[0], np.array(HOME))

    def place(self, name: str, position: FloatArray) -> None:
        """Put the handle of a device at a position (3,) [m]."""
        self._places[name] = np.array(position, dtype=float)

    def remove(self, name: str) -> None:
        """Take a device away from the service, as its cable does."""
        self._places.pop(name, None)

    def _change(self) -> None:
        with self._lock:
            self._damage.number, self._damage.kind = self.number, self.failure
        if self.failure == "unplugged":
            self._shut()
            for name in self._forces:
                self._forces[name] = np.zeros(3)
        elif self._server is None:
            self._listen()

    def close(self) -> None:
        self._shut()

    def _listen(self) -> None:
        server = socket.create_server(("127.0.0.1", self._port))
        self._port = int(server.getsockname()[1])
        self._server = server
        self._start(self._welcome, server)

    def _start(self, work: Any, *arguments: Any) -> None:
        thread = threading.Thread(target=work, args=arguments, name=type(self).__name__, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _shut(self) -> None:
        """Close the service and every connection to it."""
        server, self._server = self._server, None
        if server is not None:
            with suppress(OSError):
                server.shutdown(socket.SHUT_RDWR)
            server.close()
        for line in list(self._lines):
            with suppress(OSError):
                line.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        self._threads.clear()

    def _welcome(self, server: socket.socket) -> None:
        while self._server is server:
            try:
                line, _ = server.accept()
            except OSError:
                return
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._lines.add(line)
            self._start(self._serve, line)

    def _serve(self, line: socket.socket) -> None:
        data, due = bytearray(), list[tuple[float, bytes]]()
        try:
            _greet(line, data)
            line.sendall(_frame(TEXT, self._state(first=True)))
            while self._server is not None:
                if self._damage.kind == "blocked":
                    time.sleep(IDLE)
                    continue
                wait = min([IDLE, *(max(0.0, when - time.monotonic()) for when, _ in due[:1])])
                if select.select([line], [], [], wait)[0]:
                    part = line.recv(1 << 16)
                    if not part:
                        return
                    data += part
                    for kind, text in _frames(data):
                        if kind == CLOSE:
                            return
                        if kind == PING:
                            line.sendall(_frame(PONG, text))
                        elif kind == TEXT:
                            due += self._answer(text)
                while due and due[0][0] <= time.monotonic():
                    line.sendall(_frame(TEXT, due.pop(0)[1]))
        except OSError:
            return
        finally:
            self._lines.discard(line)
            line.close()

    def _answer(self, text: bytes) -> Iterator[tuple[float, bytes]]:
        """Act on a message, and give what comes of its one answer, with times [s]."""
        self.messages.append(text.decode(errors="replace"))
        del self.messages[:-10_000]
        self._act(text)
        with self._lock:
            self._answers += 1
            stalled = self.stall if self.stall and self._answers % 1000 == 0 else 0.0
            name = "FFFF" if self._damage.kind == "wrong-id" else None
            answer = self._state(name=name)
            parts = [(0.0, answer)] if name else list(self._damage.apply(answer))
        for delay, part in parts:
            yield time.monotonic() + delay + stalled, part

    def _act(self, text: bytes) -> None:
        try:
            for device in json.loads(text)["inverse3"]:
                values = device["commands"]["set_cursor_force"]["values"]
                force = np.array([values.get(axis, 0.0) for axis in "xyz"], dtype=float)
                if device["device_id"] in self._forces and np.isfinite(force).all():
                    self._forces[device["device_id"]] = np.clip(force, -self.limit, self.limit)
        except (ValueError, KeyError, TypeError, AttributeError):
            return  # a message that sets no force is answered like any other

    def _state(self, *, first: bool = False, name: str | None = None) -> bytes:
        """Write where the devices are; the first message of a connection says how they are set, too."""
        devices = []
        for own, place in list(self._places.items()):
            position = {axis: x for axis, x in zip("xyz", place.tolist(), strict=True) if x}
            device = {
                "device_id": name or own,
                "state": {"cursor_position": position, "cursor_velocity": {}},
                "status": {},
            }
            devices.append(device | ({"config": self.config} if first else {}))
        return json.dumps({"session_id": 7, "inverse3": devices}).encode()


def _greet(line: socket.socket, data: bytearray) -> None:
    """Answer a client's request for a WebSocket; what it sends after that stays in `data`."""
    while b"\r\n\r\n" not in data:
        part = line.recv(1 << 16)
        if not part:
            raise ConnectionError
        data += part
    head, _, rest = bytes(data).partition(b"\r\n\r\n")
    data[:] = rest
    fields = dict(field.split(": ", 1) for field in head.decode("latin-1").split("\r\n")[1:] if ": " in field)
    key = next((value for name, value in fields.items() if name.lower() == "sec-websocket-key"), "")
    accept = base64.b64encode(hashlib.sha1(key.encode() + MAGIC).digest()).decode()
    lines = (
        "HTTP/1.1 101 Switching Protocols", "Upgrade: websocket", "Connection: Upgrade",
        f"Sec-WebSocket-Accept: {accept}", "", "",
    )  # fmt: skip
    line.sendall("\r\n".join(lines).encode())


def _frame(kind: int, data: bytes) -> bytes:
    """Write a frame of a server's, whole and without a mask."""
    size = len(data)
    if size < 126:
        return bytes([0x80 | kind, size]) + data
    width, mark = (2, 126) if size < 1 << 16 else (8, 127)
    return bytes([0x80 | kind, mark]) + size.to_bytes(width, "big") + data


def _frames(data: bytearray) -> Iterator[tuple[int, bytes]]:
    """Take the whole frames of a client's from the beginning of what has come."""
    while len(data) >= 2:
        size, start = data[1] & 0x7F, 2
        if size > 125:
            start += 2 if size == 126 else 8
            size = int.from_bytes(data[2:start], "big")
        if len(data) < start + 4 + size:
            return
        mask = data[start : start + 4]
        text = bytes(byte ^ mask[i % 4] for i, byte in enumerate(data[start + 4 : start + 4 + size]))
        kind = data[0] & 0xF
        del data[: start + 4 + size]
        yield kind, text
