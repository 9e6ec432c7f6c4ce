"""An emulator of Touch and Phantom devices for tests: a replacement of OpenHaptics, with three devices."""

from __future__ import annotations

import ctypes
import time
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.testing.wire import Clock, Failure, Wire, build, shared_page

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HOME = 0.01, -0.02, 0.03  # [m]
STEP = 0.003  # displacement of `move` along every axis [m]
NAMES = "left", "right", "third"
COMM_ERROR = 0x302
MM = 1e-3  # [m]
TURN = 1.0  # longest wait for the thread to complete the callbacks that are due [s]
BINS = 2048  # number of bins of the callback's duration, of one microsecond each


class FakeDevice(ctypes.Structure):
    """State of one device: `struct device` of libhd.c."""

    _fields_ = (
        *((name, ctypes.c_double * 3) for name in ("position", "velocity", "force", "pending")),
        *((name, ctypes.c_int64) for name in ("owner", "enabled", "frame", "error", "refusal")),
        ("name", ctypes.c_char * 64),
    )


class FakeScheduler(ctypes.Structure):
    """State of the library: `struct state` of libhd.c."""

    _fields_ = (
        ("current", ctypes.c_int64),
        ("depth", ctypes.c_int64),
        ("stack", ctypes.c_int64 * len(NAMES)),
        ("error_count", ctypes.c_int64),
        ("errors", ctypes.c_int64 * 16),
        *((name, ctypes.c_int64) for name in ("rate", "turns", "violations", "starts", "stalled")),
        *((name, ctypes.c_int64) for name in ("paced", "due", "passed", "running")),
        ("bins", ctypes.c_int64 * BINS),
        ("devices", FakeDevice * len(NAMES)),
    )


class OpenHapticsWire(Wire):
    """Devices "left", "right" and "third" behind a fake library whose thread calls back 1000 times a second.

    Other programs that load the library use the same devices. `settings`, `position`, `force` and `torque` refer to the
    first device.

    Args:
        clock: Clock of the scheduler; None for the system's clock. If a clock is given, the scheduler calls back only
            during `sleep` of the wire's attribute `clock`.

    Attributes:
        library: Path of the library.
        state: Memory shared with the library: its scheduler and devices.

    Raises:
        MissingPackageError: If there is no C compiler.
    """

    kinds: frozenset[Failure] = frozenset({"late", "drop", "garbage", "unplugged", "blocked"})
    limit = 3.3  # [N]

    def __init__(self, *, clock: Clock | None = None) -> None:
        super().__init__(None if clock is None else _TurnsClock(clock, self))
        self._folder = Path(mkdtemp(prefix="graspfx-wire-"))
        file, library = self._folder / "state", self._folder / "libHD.so"
        self.state = shared_page(FakeScheduler, file)
        self.state.rate, self.state.paced = 1000, clock is not None
        for device, name in zip(self.state.devices, NAMES, strict=True):
            device.name = name.encode()
        options = ["-shared", "-fPIC", "-pthread", f'-DSTATE="{file}"']
        self.library = str(build([*options, "libhd.c"], library, Path(__file__).parent))
        self.home()

    @property
    def settings(self) -> dict[str, Any]:
        return {"unit": NAMES[0], "library": self.library}

    @property
    def torque(self) -> FloatArray:
        """Force that the first device displays (3,) [N]; it persists without further writes."""
        return self.forces(0)

    @property
    def position(self) -> FloatArray:
        return MM * np.array(self.state.devices[0].position)[None, :]

    @property
    def force(self) -> FloatArray:
        return self.torque[None, :]

    @property
    def turns(self) -> int:
        """Number of calls of the callback."""
        return int(self.state.turns)

    @property
    def violations(self) -> int:
        """Number of violations of the library's rules.

        Violations are calls outside a frame or a callback, frames that are not nested, and a second callback.
        """
        return int(self.state.violations)

    @property
    def durations(self) -> IntArray:
        """Histogram of the callback's duration in bins of a microsecond; the last bin counts all longer durations."""
        return np.ctypeslib.as_array(self.state.bins)

    def place(self, position: FloatArray, device: int = 0) -> None:
        """Place the handle of a device at a position (3,) [m]."""
        self.state.devices[device].position[:] = (np.asarray(position) / MM).tolist()

    def leave(self, error: int, device: int = 0) -> None:
        """Let every frame of a device leave the code `error` on the library's error stack; 0 for no error."""
        self.state.devices[device].error = error

    def refuse(self, error: int, device: int = 0) -> None:
        """Let a device reject every non-zero force with the code `error`; 0 to accept every force."""
        self.state.devices[device].refusal = error

    def forces(self, device: int) -> FloatArray:
        """Return the force that a device displays (3,) [N]."""
        return np.array(self.state.devices[device].force)

    def move(self) -> None:
        self.place(np.array(HOME) + STEP)

    def home(self) -> None:
        self.place(np.array(HOME))

    def _change(self) -> None:
        """Apply the current failure to the scheduler or the first device."""
        self.state.stalled = self.failure in ("late", "drop", "blocked")
        self.leave(COMM_ERROR if self.failure == "unplugged" else 0)
        if self.failure == "unplugged":  # the device is closed and without force
            self.state.devices[0].owner = 0
            self.state.devices[0].force[:] = [0.0] * 3
        if self.failure == "garbage":
            self.place(np.full(3, np.nan))
        elif np.isnan(self.position).any():
            self.home()

    def close(self) -> None:
        rmtree(self._folder, ignore_errors=True)


class _TurnsClock:
    """A clock whose `sleep` lets the scheduler complete the callbacks that become due."""

    def __init__(self, clock: Clock, wire: OpenHapticsWire) -> None:
        self.now = clock.now
        self._clock, self._wire, self._part = clock, wire, 0.0

    def sleep(self, duration: float) -> None:
        state = self._wire.state
        self._clock.sleep(duration)
        turns, self._part = divmod(self._part + duration * state.rate, 1.0)
        state.due += int(turns)
        end = time.monotonic() + TURN
        while state.running and state.passed < state.due and time.monotonic() < end:
            time.sleep(1e-5)
        if state.passed < state.due:  # the process of the library has ended
            state.running = 0
