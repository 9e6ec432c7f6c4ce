"""An emulator of Force Dimension's devices: four behind a stand-in for their library, which a test moves."""

from __future__ import annotations

import ctypes
import time
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.testing.wire import Clock, Failure, WallClock, Wire, build, shared_page

FloatArray = NDArray[np.float64]

FUNCTIONS = (
    "dhdOpen", "dhdOpenSerial", "dhdClose", "dhdStop", "dhdEnableForce", "dhdSetMaxForce", "dhdGetPosition",
    "dhdSetForce", "dhdGetStatus", "dhdEnableExpertMode", "dhdDisableExpertMode", "dhdGetWatchdog", "dhdSetWatchdog",
    "dhdSetTimeGuard",
)  # fmt: skip
NUMBERS = {name: k for k, name in enumerate(FUNCTIONS)}
DEVICES = 4
STATUS = 17  # entries of dhdGetStatus
HOME = 0.01, -0.02, 0.03  # [m]
STEP = 0.003  # of `move`, along every axis [m]
SERIAL = 101  # of the first device, and so on
NO_NEW_DATA, ERROR = 1, -1  # what the functions return
MOTORS_ON = {0: 1, 1: 1, 2: 1, 4: 1, 5: 1}  # power, connected, started, idle, force
FORCE, CAUSE = 5, 14  # entries of the status
UNIT = 125e-6  # of a watchdog [s]


class FakeDevice(ctypes.Structure):
    """State of one device, which the library works on: `struct device` of libdrd.c."""

    _fields_ = (
        *((f"{name}{i}", ctypes.c_double) for name in ("position", "velocity", "force") for i in range(3)),
        ("max_force", ctypes.c_double),
        ("written", ctypes.c_int64 * 2),  # when the force was set last, by the monotonic clock [s, ns]
        ("calls", ctypes.c_int64 * len(FUNCTIONS)),
        ("codes", ctypes.c_int32 * len(FUNCTIONS)),  # that the functions return
        ("status", ctypes.c_int32 * STATUS),
        ("serial", ctypes.c_int32),
        ("owner", ctypes.c_int32),  # the process that has it open, 0 for none
        ("enabled", ctypes.c_int32),
        ("braking", ctypes.c_int32),
        ("watchdog", ctypes.c_int32),
        ("guard", ctypes.c_int32),
        ("text", ctypes.c_char * 64),
    )


class FakeDevices(ctypes.Structure):
    """State of all devices."""

    _fields_ = (("devices", FakeDevice * DEVICES),)


class ForceDimensionWire(Wire):
    """Devices 101 to 104 behind a fake library: every call is counted, and returns what a test wishes.

    Other programs that load the library meet the same devices. `settings`, `position`, `force` and `torque` are those
    of the first device.

    Args:
        slowness: seconds in which a second of the devices' watchdogs goes by; above 1 they wait for tests on a busy
            machine.
        clock: of the watchdogs, from the look on that first sees a force; the machine's if it is left out.

    Attributes:
        library: its path.
        devices: the state of each, as the library has it.

    Raises:
        MissingPackageError: this machine has no C compiler.
    """

    kinds: frozenset[Failure] = frozenset({"late", "drop", "garbage", "unplugged", "blocked"})
    limit = 12.0  # [N]

    def __init__(self, *, slowness: float = 1.0, clock: Clock | None = None) -> None:
        super().__init__(clock)
        self.slowness = slowness
        self._seen = 0.0, 0.0  # when the force was set that was seen last: by the library's time and by the clock [s]
        self._folder = Path(mkdtemp(prefix="graspfx-wire-"))
        state, library = self._folder / "state", self._folder / "libdrd.so"
        self.devices = shared_page(FakeDevices, state).devices
        names = ", ".join(f'"{name}"' for name in FUNCTIONS)
        options = ["-shared", "-fPIC", f'-DSTATE="{state}"', f"-DNAMES={names}"]
        self.library = str(build([*options, "libdrd.c"], library, Path(__file__).parent))
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
