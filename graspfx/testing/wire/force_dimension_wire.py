"""Force Dimension's devices behind a stand-in for their library: four of them, which nothing moves but a test."""

from __future__ import annotations

import mmap
import time
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.realtime.pacing import Clock, WallClock
from graspfx.testing.wire.fake_library import DEVICES, NUMBERS, SIZE, FakeDevice, library
from graspfx.testing.wire.wire import Failure, Wire

FloatArray = NDArray[np.float64]

HOME = 0.01, -0.02, 0.03  # [m]
STEP = 0.003  # of `move`, along every axis [m]
SERIAL = 101  # of the first device, and so on
NO_NEW_DATA, ERROR = 1, -1  # what the functions return
MOTORS_ON = {0: 1, 1: 1, 2: 1, 4: 1, 5: 1}  # power, connected, started, idle, force
FORCE, CAUSE = 5, 14  # entries of the status
UNIT = 125e-6  # of a watchdog [s]


class ForceDimensionWire(Wire):
    """Devices 101 to 104 behind a fake library: every call is counted, and returns what a test wishes.

    Other programs that load the library meet the same devices, where this machine has a compiler that links it.
    `settings`, `position`, `force` and `torque` are those of the first device.

    Args:
        slowness: seconds in which a second of the devices' watchdogs goes by; above 1 they wait for tests on a busy
            machine.
        clock: of the watchdogs, from the look on that first sees a force; the machine's if it is left out.

    Attributes:
        devices: the state of each, as the library has it.
    """

    kinds: frozenset[Failure] = frozenset({"late", "drop", "garbage", "unplugged", "blocked"})
    limit = 12.0  # [N]

    def __init__(self, *, slowness: float = 1.0, clock: Clock | None = None) -> None:
        super().__init__(clock)
        self.slowness = slowness
        self._seen = 0.0, 0.0  # when the force was set that was seen last: by the library's time and by the clock [s]
        self._folder = Path(mkdtemp(prefix="graspfx-wire-"))
        state = self._folder / "state"
        state.write_bytes(bytes(DEVICES * SIZE))
        with state.open("r+b") as file:
            self.devices = (FakeDevice * DEVICES).from_buffer(mmap.mmap(file.fileno(), 0))
        self.library = library(state, self._folder)
        for k, device in enumerate(self.devices):
            device.serial = SERIAL + k
            device.text = b"communication error"
            for entry, value in MOTORS_ON.items():
                device.status[entry] = value
        self.home()

    @property
    def settings(self) -> dict[str, Any]:
        return {"serial": SERIAL, "library": self.library}

    @property
    def torque(self) -> FloatArray:
        """Force that was set last (3,) [N]; zero once the watchdog, if it is on, has seen none for its time.

        The brakes of dhdStop do not make it zero: only dhdSetForce does.
        """
        device = self.devices[0]
        age = self._age(device.written[0] + 1e-9 * device.written[1])
        if device.watchdog and age > UNIT * device.watchdog * self.slowness:
            return np.zeros(3)
        return np.array([device.force0, device.force1, device.force2])

    def _age(self, written: float) -> float:
        """Compute how long ago a force was set [s]; the library writes down the machine's time."""
        if isinstance(self.clock, WallClock):
            return time.clock_gettime(time.CLOCK_MONOTONIC) - written
        if written != self._seen[0]:
            self._seen = written, self.clock.now()
        return self.clock.now() - self._seen[1]

    @property
    def position(self) -> FloatArray:
        device = self.devices[0]
        return np.array([[device.position0, device.position1, device.position2]])

    @property
    def force(self) -> FloatArray:
        return self.torque[None, :]

    def calls(self, function: str, device: int = 0) -> int:
        """Count how often a function was called, for one device."""
        return int(self.devices[device].calls[NUMBERS[function]])

    def answer(self, function: str, code: int, device: int = 0) -> None:
        """Have a function return this code for one device, without doing anything if it is negative."""
        self.devices[device].codes[NUMBERS[function]] = code

    def switch_off(self, cause: int, device: int = 0) -> None:
        """Switch the motors off, for a cause as dhdGetStatus has it: 1 button, 2 velocity, 3 watchdog, 6 deadman."""
        self.devices[device].status[FORCE], self.devices[device].status[CAUSE] = 0, cause

    def move(self) -> None:
        self.place(np.array(HOME) + STEP)

    def home(self) -> None:
        self.place(np.array(HOME))

    def place(self, position: FloatArray, device: int = 0) -> None:
        """Put the handle of a device at a position (3,) [m]."""
        for i, x in enumerate(position.tolist()):
            setattr(self.devices[device], f"position{i}", x)

    def _change(self) -> None:
        """Have all functions of the first device return what the failure makes of them."""
        if self.failure == "unplugged":  # no power, and nobody's
            device = self.devices[0]
            device.owner = device.enabled = 0
            device.force0 = device.force1 = device.force2 = 0.0
        lost, silent = self.failure == "unplugged", self.failure in ("late", "drop", "blocked")
        for name in NUMBERS:
            self.answer(name, ERROR if lost else NO_NEW_DATA if silent and name == "dhdGetPosition" else 0)
        if self.failure == "garbage":
            self.place(np.full(3, np.nan))
        elif np.isnan(self.position).any():
            self.home()

    def close(self) -> None:
        rmtree(self._folder, ignore_errors=True)
