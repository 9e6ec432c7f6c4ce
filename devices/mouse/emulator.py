"""An emulator of a Linux mouse or gamepad: its events arrive through a named pipe in the kernel's format."""

from __future__ import annotations

import os
import random
import struct
from contextlib import suppress
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.protocols import InputError
from graspfx.testing.wire import Clock, Failure, Plug, Wire

FloatArray = NDArray[np.float64]

EVENT = "@llHHi"  # seconds, microseconds, kind, code, value
SYNC, KEY, RELATIVE, ABSOLUTE = range(4)
REPORT, DROPPED = 0, 3
ELSE = 0x04, 0x11, 0x12, 0x14, 0x15, 0x17  # kinds that drivers ignore: scan codes, lights, sounds, repeats, forces
COUNTS = 120, -80  # motion of a mouse by `move`, to the right and up
STICK = 12000, -9000  # deflection of a stick by `move`, to the right and up
HALF = 32767.5  # half of a stick's range
DEAD, REACH = 0.1, 0.1  # default dead zone and half-width of the workspace of a gamepad, [1] and [m]
INCH, DPI = 0.0254, 1000.0


class EventWire(Wire):
    """A mouse or a gamepad that a test moves, without force feedback.

    Args:
        kind: Emulated device, "mouse" or "gamepad".
        seed: Seed of the random damage to data.
        clock: Clock of the conformance kit; by default the system's.
    """

    kinds: frozenset[Failure] = frozenset({"drop", "garbage", "unplugged"})
    limit = 0.0

    def __init__(
        self, kind: Literal["mouse", "gamepad"] = "mouse", *, seed: int = 0, clock: Clock | None = None
    ) -> None:
        super().__init__(clock)
        if kind not in ("mouse", "gamepad"):
            raise InputError("kind", kind, "'mouse' or 'gamepad'")
        self.kind = kind
        self._plug, self._random = Plug(), random.Random(seed)
        self._place = np.zeros(2)
        self._pipe = -1
        self._insert()

    @property
    def settings(self) -> dict[str, Any]:
        return {"port": self._plug.port}

    @property
    def torque(self) -> FloatArray:
        """Zero: there are no motors."""
        return np.zeros(1)

    @property
    def position(self) -> FloatArray:
        """Position of the finger (1, 2) [m] if the driver has its default settings."""
        return self._place[None, :].copy()

    def send(self, *events: tuple[int, int, int]) -> None:
        """Send a report of events, each given by kind, code and value."""
        data = b"".join(struct.pack(EVENT, 0, 0, *event) for event in (*events, (SYNC, REPORT, 0)))
        if self._pipe >= 0:
            with suppress(BlockingIOError):  # the pipe is full, because the reader has not read for a long time
                os.write(self._pipe, data)

    def press(self, button: int, *, down: bool = True) -> None:
        """Press or release a button: 0 to 2 of a mouse, 0 to 14 of a gamepad."""
        self.send((KEY, (0x110 if self.kind == "mouse" else 0x130) + button, int(down)))

    def move(self) -> None:
        if self.kind == "mouse":
            self.send((RELATIVE, 0, COUNTS[0]), (RELATIVE, 1, COUNTS[1]))
            self._place += np.array([COUNTS[0], -COUNTS[1]]) * INCH / DPI
        else:
            self.send((ABSOLUTE, 0, STICK[0]), (ABSOLUTE, 1, STICK[1]))
            part = np.array([STICK[0] + 0.5, -STICK[1] - 0.5]) / HALF
            self._place = REACH * np.sign(part) * (np.abs(part) - DEAD) / (1.0 - DEAD)

    def home(self) -> None:
        """Centre the sticks of a gamepad; for a mouse, only set `position` to zero, where an opened driver starts."""
        self._place = np.zeros(2)
        if self.kind == "gamepad":
            self.send((ABSOLUTE, 0, 0), (ABSOLUTE, 1, 0))

    def _change(self) -> None:
        if self.failure == "unplugged":
            self._pull()
            return
        if self._pipe < 0:
            self._insert()
        if self.failure == "drop":
            kind = RELATIVE if self.kind == "mouse" else ABSOLUTE
            self.send((kind, 0, 3000), (SYNC, DROPPED, 0), (kind, 1, 3000))
        elif self.failure == "garbage":
            for _ in range(round(self.number)):
                code, value = self._random.randrange(1 << 16), self._random.randrange(-(1 << 31), 1 << 31)
                self.send((self._random.choice(ELSE), code, value))

    def _insert(self) -> None:
        os.mkfifo(self._plug.port)
        self._pipe = os.open(self._plug.port, os.O_RDWR | os.O_NONBLOCK)

    def _pull(self) -> None:
        if self._pipe >= 0:
            os.close(self._pipe)
            self._pipe = -1
        self._plug.pull()

    def close(self) -> None:
        self._pull()
        self._plug.remove()
