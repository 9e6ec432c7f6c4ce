"""An emulator of the Haply Inverse service: a WebSocket server with several devices that answers each message once."""

from __future__ import annotations

import json
import select
import socket
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.protocols import MissingPackageError
from graspfx.testing.wire import Clock, Damage, Failure, Wire

if TYPE_CHECKING:
    from websockets.sync.server import Server, ServerConnection

FloatArray = NDArray[np.float64]

HOME = 0.03, -0.1, 0.15  # position of the first device [m]
APART = 0.1  # distance between devices along x [m]
STEP = 0.003  # displacement of `move` along every axis [m]
IDLE = 0.001  # time between two checks of a connection for pending answers [s]


class InverseWire(Wire):
    """A service whose devices are moved only by tests; a force persists until another force is set.

    This is the worst case, because it is unknown whether the real service removes the force of a crashed program.
    Answers omit coordinates that are exactly zero. A client that does not read loses answers.

    Args:
        devices: Ids of the devices.
        config: Configuration of every device in the first message; None for an empty one.
        stall: Additional delay of every thousandth answer [s].
        seed: Seed of the random damage to data.
        clock: Clock of the service; None for the system's clock. If a clock is given, the service has no thread, and
            messages must be passed to `answer`.

    Attributes:
        messages: Received texts of all connections, at most the last 10 000.

    Raises:
        MissingPackageError: If websockets is not installed.
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
        clock: Clock | None = None,
    ) -> None:
        super().__init__(clock)
        self._is_served = clock is None
        self.devices, self.config, self.stall = tuple(devices), dict(config or {}), stall
        self.messages: list[str] = []
        self._places: dict[str, FloatArray] = {
            name: np.array(HOME) + APART * k * np.eye(3)[0] for k, name in enumerate(devices)
        }
        self._forces: dict[str, FloatArray] = {name: np.zeros(3) for name in devices}
        self._damage, self._lock = Damage(seed), threading.Lock()
        self._turn = threading.Lock()  # held while answering, so that a failure begins between two answers
        self._answers = 0
        self._lines: set[ServerConnection] = set()
        self._socket: socket.socket | None = None  # only while the service runs
        self._server: Server | None = None
        self._thread = threading.Thread()
        self._port = 0
        self._listen()

    @property
    def url(self) -> str:
        """Address of the service; it does not change after a restart."""
        return f"ws://127.0.0.1:{self._port}"

    @property
    def settings(self) -> dict[str, Any]:
        return {"url": self.url, "device": self.devices[0]}

    @property
    def torque(self) -> FloatArray:
        """Force of the first device (3,) [N]."""
        return self._forces[self.devices[0]].copy()

    @property
    def position(self) -> FloatArray:
        return self._places[self.devices[0]][None, :].copy()

    @property
    def force(self) -> FloatArray:
        return self.torque[None, :]

    def force_of(self, name: str) -> FloatArray:
        """Return the force of a device (3,) [N]."""
        return self._forces[name].copy()

    def move(self) -> None:
        self.place(self.devices[0], np.array(HOME) + STEP)

    def home(self) -> None:
        self.place(self.devices[0], np.array(HOME))

    def place(self, name: str, position: FloatArray) -> None:
        """Place the handle of a device at a position (3,) [m]."""
        self._places[name] = np.array(position, dtype=float)

    def remove(self, name: str) -> None:
        """Remove a device from the service, as if unplugged."""
        self._places.pop(name, None)

    def _change(self) -> None:
        with self._turn, self._lock:
            self._damage.number, self._damage.kind = self.number, self.failure
        if self.failure == "unplugged":
            self._shut()
            for name in self._forces:
                self._forces[name] = np.zeros(3)
        elif self._socket is None:
            self._listen()

    def close(self) -> None:
        self._shut()

    def _listen(self) -> None:
        try:
            from websockets.sync.server import serve
        except ImportError as error:
            raise MissingPackageError.of_extra(
                "websockets", "the emulator of the Inverse service", "inverse"
            ) from error
        self._socket = socket.create_server(("127.0.0.1", self._port))
        self._port = int(self._socket.getsockname()[1])
        if self._is_served:
            self._server = serve(self._serve, sock=self._socket, compression=None, close_timeout=0.0)
            self._thread = threading.Thread(target=self._server.serve_forever, name=type(self).__name__, daemon=True)
            self._thread.start()

    def _shut(self) -> None:
        """Close the service and all connections without a closing handshake."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self._server is not None:
            self._server.shutdown()
            self._thread.join()
            self._server = None
        while self._lines:
            for line in list(self._lines):
                with suppress(OSError):
                    line.socket.shutdown(socket.SHUT_RDWR)
            self.clock.sleep(IDLE)

    def _serve(self, line: ServerConnection) -> None:
        from websockets.exceptions import ConnectionClosed

        due, unread = list[tuple[float, bytes]](), list[bytes]()
        self._lines.add(line)
        try:
            line.send(self.state(first=True), text=True)
            while True:
                with suppress(TimeoutError):
                    wait = min([IDLE, *(max(0.0, when - self.clock.now()) for when, _ in due[:1])])
                    unread.append(line.recv(wait, decode=False))
                with self._turn:
                    if self._damage.kind == "blocked":
                        continue
                    while unread:
                        due += self.answer(unread.pop(0))
                    while due and due[0][0] <= self.clock.now():
                        answer = due.pop(0)[1]
                        if select.select([], [line.socket], [], 0.0)[1]:  # otherwise the client does not read
                            line.send(answer, text=True)
        except (ConnectionClosed, OSError, ValueError):  # the last: `select` of a closed socket
            return
        finally:
            self._lines.discard(line)

    def answer(self, text: bytes) -> Iterator[tuple[float, bytes]]:
        """Process a message; yield the parts of the answer, each with the time at which it is to be sent [s]."""
        self.messages.append(text.decode(errors="replace"))
        del self.messages[:-10_000]
        self._act(text)
        with self._lock:
            self._answers += 1
            stalled = self.stall if self.stall and self._answers % 1000 == 0 else 0.0
            name = "FFFF" if self._damage.kind == "wrong-id" else None
            answer = self.state(name=name)
            parts = [(0.0, answer)] if name else list(self._damage.apply(answer))
        for delay, part in parts:
            yield self.clock.now() + delay + stalled, part

    def _act(self, text: bytes) -> None:
        try:
            for device in json.loads(text)["inverse3"]:
                values = device["commands"]["set_cursor_force"]["values"]
                force = np.array([values.get(axis, 0.0) for axis in "xyz"], dtype=float)
                if device["device_id"] in self._forces and np.isfinite(force).all():
                    self._forces[device["device_id"]] = np.clip(force, -self.limit, self.limit)
        except (ValueError, KeyError, TypeError, AttributeError):
            return  # a message without forces also gets an answer

    def state(self, *, first: bool = False, name: str | None = None) -> bytes:
        """Return a message with the state of all devices.

        Args:
            first: Whether to add the configuration of the devices.
            name: Id that replaces the id of every device; None to keep the ids.
        """
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
