"""An emulator of Force Dimension devices for tests: a replacement of the vendor's library, with four devices."""

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
STATUS = 17  # number of entries of dhdGetStatus
HOME = 0.01, -0.02, 0.03  # [m]
STEP = 0.003  # displacement of `move` along every axis [m]
SERIAL = 101  # serial number of the first device; the other devices have 102 to 104
NO_NEW_DATA, ERROR = 1, -1  # return values of the functions
MOTORS_ON = {0: 1, 1: 1, 2: 1, 4: 1, 5: 1}  # power, connected, started, idle, force
FORCE, CAUSE = 5, 14  # entries of the status
UNIT = 125e-6  # unit of a watchdog [s]


class FakeDevice(ctypes.Structure):
    """State of one device, shared with the library: `struct device` of libdrd.c."""

    _fields_ = (
        *((f"{name}{i}", ctypes.c_double) for name in ("position", "velocity", "force") for i in range(3)),
        ("max_force", ctypes.c_double),
        ("written", ctypes.c_int64 * 2),  # monotonic time when the force was last set [s, ns]
        ("calls", ctypes.c_int64 * len(FUNCTIONS)),
        ("codes", ctypes.c_int32 * len(FUNCTIONS)),  # return values of the functions
        ("status", ctypes.c_int32 * STATUS),
        ("serial", ctypes.c_int32),
        ("owner", ctypes.c_int32),  # id of the process that has opened the device; 0 for none
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
    """Devices with serial numbers 101 to 104 behind a fake library.

    The library counts every call, and returns the codes that a test sets. Other programs that load the library use the
    same devices. `settings`, `position`, `force` and `torque` refer to the first device.

    Args:
        slowness: Factor by which the devices' watchdog times are extended, for tests on a busy machine.
        clock: Clock by which the watchdogs measure the age of a force; by default the system's clock.

    Attributes:
        library: Path of the library.
        devices: State of each device, shared with the library.

    Raises:
        MissingPackageError: If there is no C compiler.
    """

    kinds: frozenset[Failure] = frozenset({"late", "drop", "garbage", "unplugged", "blocked"})
    limit = 12.0  # [N]

    def __init__(self, *, slowness: float = 1.0, clock: Clock | None = None) -> None:
        super().__init__(clock)
        self.slowness = slowness
        self._seen = 0.0, 0.0  # time when the last force was set, on the library's clock and on `clock` [s]
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
        """Force of the first device (3,) [N]: the force last set, or zero if an enabled watchdog has expired.

        dhdStop applies the brakes, but does not change this force; dhdSetForce does.
        """
        device = self.devices[0]
        age = self._age(device.written[0] + 1e-9 * device.written[1])
        if device.watchdog and age > UNIT * device.watchdog * self.slowness:
            return np.zeros(3)
        return np.array([device.force0, device.force1, device.force2])

    def _age(self, written: float) -> float:
        """Return the time since a force was set [s], given the system's monotonic time when it was set [s]."""
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
        """Return the number of calls of a function for one device."""
        return int(self.devices[device].calls[NUMBERS[function]])

    def answer(self, function: str, code: int, device: int = 0) -> None:
        """Let a function return `code` for one device; if `code` is negative, the function has no other effect."""
        self.devices[device].codes[NUMBERS[function]] = code

    def switch_off(self, cause: int, device: int = 0) -> None:
        """Switch the motors off for a cause of dhdGetStatus: 1 button, 2 velocity, 3 watchdog, 6 deadman switch."""
        self.devices[device].status[FORCE], self.devices[device].status[CAUSE] = 0, cause

    def move(self) -> None:
        self.place(np.array(HOME) + STEP)

    def home(self) -> None:
        self.place(np.array(HOME))

    def place(self, position: FloatArray, device: int = 0) -> None:
        """Place the handle of a device at a position (3,) [m]."""
        for i, x in enumerate(position.tolist()):
            setattr(self.devices[device], f"position{i}", x)

    def _change(self) -> None:
        """Apply the current failure to the first device: set its return codes, owner, force and position."""
        if self.failure == "unplugged":  # the device is closed and without force
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
