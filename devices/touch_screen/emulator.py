"""An emulator of a touch screen: it opens the device's page like a browser, and puts fingers on it."""

from __future__ import annotations

import random
import socket
import struct
import time
from contextlib import suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.protocols import DeviceError, MissingPackageError
from graspfx.testing.wire import Failure, Wire

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection

FloatArray = NDArray[np.float64]

ORDER = struct.Struct("<BBHIdd")  # kind, finger, zero, number, x [m], y [m]
ALIVE, PRESS, MOVE, LIFT = range(4)  # kinds of orders: the page is alive; a finger touches, moves, lifts
START = [[-0.05, 0.0], [0.05, 0.0]]
WAY = 0.004, 0.003  # displacement of `move` [m]
PATIENCE = 5.0  # longest wait for the page to answer [s]


class ScreenWire(Wire):
    """A touch screen with two fingers that a test moves, without force feedback; it needs the package websockets.

    Args:
        seed: Seed of the random damage to data.
    """

    kinds: frozenset[Failure] = frozenset({"drop", "garbage"})
    limit = 0.0

    def __init__(self, *, seed: int = 0) -> None:
        super().__init__()
        if find_spec("websockets") is None:
            raise MissingPackageError.of_extra("websockets", "the emulator of a touch screen", "touch")
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self._port = int(probe.getsockname()[1])
        self._random = random.Random(seed)
        self._place = np.array(START)
        self._line: ClientConnection | None = None
        self.number_of_last = 0

    @property
    def settings(self) -> dict[str, Any]:
        return {"port": self._port, "fingers": len(START), "start": START}

    @property
    def torque(self) -> FloatArray:
        """Zero: there are no motors."""
        return np.zeros(1)

    @property
    def position(self) -> FloatArray:
        """Positions of the fingers on the screen (2, 2) [m]."""
        return self._place.copy()

    def touch(self, finger: int, x: float, y: float) -> None:
        """Put a finger on the screen at x, y [m], or move a finger that is on the screen to x, y."""
        self._send(PRESS, finger, x, y)
        self._place[finger] = x, y

    def lift(self, finger: int) -> None:
        """Lift a finger from the screen."""
        self._send(LIFT, finger)

    def leave(self) -> None:
        """Close the connection without a closing handshake, as when a browser crashes."""
        line, self._line = self._line, None
        if line is not None:
            with suppress(OSError):
                line.socket.close()
            line.close()

    def move(self) -> None:
        for finger, place in enumerate(np.array(START) + WAY):
            self.touch(finger, *place.tolist())

    def home(self) -> None:
        """Close the page, which lifts the fingers; a device that is opened afterwards has its fingers at `start`."""
        self.leave()
        self._place = np.array(START)

    def _change(self) -> None:
        if self.failure == "drop":
            self.number_of_last += 3
            self._send(ALIVE, 0)
        elif self.failure == "garbage":
            for _ in range(round(self.number)):
                self._connected().send(self._random.randbytes(self._random.choice((0, 3, ORDER.size, 40))))

    def _send(self, kind: int, finger: int, x: float = 0.0, y: float = 0.0) -> None:
        line = self._connected()
        self.number_of_last += 1
        line.send(ORDER.pack(kind, finger, 0, self.number_of_last, x, y))

    def _connected(self) -> ClientConnection:
        """Return the connection to the page, and connect if necessary."""
        from websockets.exceptions import WebSocketException
        from websockets.protocol import State
        from websockets.sync.client import connect

        if self._line is not None and self._line.state is State.OPEN:
            return self._line
        host, deadline = f"127.0.0.1:{self._port}", time.monotonic() + PATIENCE
        own: Any = f"http://{host}"
        while True:
            try:
                line = connect(f"ws://{host}/socket", origin=own, compression=None, proxy=None)
                self._line = line.__enter__()  # left by `leave`
            except (OSError, WebSocketException) as error:
                if time.monotonic() > deadline:
                    raise DeviceError(f"no page answers at {host} within {PATIENCE:g} s: {error}") from error
                time.sleep(0.01)
            else:
                self.number_of_last = 0
                return self._line

    def close(self) -> None:
        self.leave()
