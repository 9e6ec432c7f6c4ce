"""Force Dimension devices (delta, omega, sigma, lambda): one finger in space, through the vendor's library.

The driver was written from the function names and constants of the vendor's interface. It was tested only against an
emulator (`graspfx.testing.wire.ForceDimensionWire`). The vendor's library, libdrd, is part of the vendor's SDK and not
of GraspFX; `open` loads it.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._device import Handle, library_functions, library_path, load_library
from graspfx.devices._settings import whole
from graspfx.protocols import WINDOW, Calls, DeviceError, Features, MissingPackageError, adapt

__all__ = ["Delta", "connect", "quench"]

FloatArray = NDArray[np.float64]

MOST_FORCE = 40.0  # [N]
PERIOD = 0.001  # period of `quench`, without effect because `quench` reads only once [s]
WATCHDOG, UNIT = 255, 125e-6  # largest setting of a device's watchdog, and the unit of the setting [s]

TITLE = "Force Dimension's library"
NAMES = {"win32": ("drd64.dll", "dhd64.dll"), "darwin": ("libdrd.dylib", "libdhd.dylib")}
ELSEWHERE = "libdrd.so", "libdrd.so.3", "libdhd.so"

# Return values of the library's functions: a negative value is an error.
NO_NEW_DATA = 1  # result of a reading within the library's time guard: the last sample is repeated

STATUS = 17  # number of entries of dhdGetStatus
FORCE, OFF_CAUSE = 5, 14
OFF = {
    0: "no cause reported: the force may not have been switched on, or the encoders not initialised",
    1: "the button on the device was pressed",
    2: "the velocity was above the device's safety threshold",
    3: "the device's watchdog: no force arrived in time",
    4: "a program disabled the force",
    5: "the USB connection failed: check the cable",
    6: "the deadman switch was released",
}

_int, _char, _byte, _double = ctypes.c_int, ctypes.c_byte, ctypes.c_ubyte, ctypes.c_double
_numbers = ctypes.POINTER(_double)
SIGNATURES: dict[str, tuple[Any, ...]] = {  # result, then arguments
    "dhdErrorGetLastStr": (ctypes.c_char_p,),
    "dhdOpen": (_int,),
    "dhdOpenSerial": (_int, _int),
    "dhdClose": (_int, _char),
    "dhdStop": (_int, _char),
    "dhdEnableForce": (_int, _byte, _char),
    "dhdSetMaxForce": (_int, _double, _char),
    "dhdGetPosition": (_int, _numbers, _numbers, _numbers, _char),
    "dhdSetForce": (_int, _double, _double, _double, _char),
    "dhdGetStatus": (_int, ctypes.POINTER(_int), _char),
}
EXPERT: dict[str, tuple[Any, ...]] = {  # functions that only some versions of the library have
    "dhdEnableExpertMode": (_int,),
    "dhdDisableExpertMode": (_int,),
    "dhdGetWatchdog": (_int, ctypes.POINTER(_byte), _char),
    "dhdSetWatchdog": (_int, _byte, _char),
}


class Dhd:
    """Functions of the library (DHD) by name; a failed call raises a DeviceError.

    Args:
        path: Path of the library, the loaded library, or None to try the library's usual file names.

    Attributes:
        library: Loaded library.
        expert: Whether the library has the functions in `EXPERT`.
    """

    def __init__(self, path: str | ctypes.CDLL | None) -> None:
        self.library = load_library(path, TITLE, NAMES, ELSEWHERE)
        self.expert = all(hasattr(self.library, name) for name in EXPERT)
        signatures = SIGNATURES | EXPERT if self.expert else SIGNATURES
        self._functions = library_functions(self.library, TITLE, "libdrd", signatures)

    def call(self, name: str, *arguments: object) -> int:
        """Call a function and return its non-negative result.

        Raises:
            DeviceError: If the result is negative.
        """
        code = int(self._functions[name](*arguments))
        if code < 0:
            text = (self._functions["dhdErrorGetLastStr"]() or b"").decode(errors="replace")
            raise DeviceError(f"{name} of {TITLE} returned {code}: {text}")
        return code


class Delta(Handle):  # type: ignore[misc] # mypy does not see devices from inside the package
    """A delta, omega, sigma or lambda: one finger in space, x towards the operator, y to the right, z up.

    Each call of the library is checked, and a negative result is a fault. If the library has no new data, `read`
    returns the last sample and the time of this sample again. Velocities are estimated from positions.

    `open` sets the largest force of the vendor's library to `force_limit`, and changes no other limit or threshold of
    the vendor. If the device supports a watchdog, `open` sets the watchdog to the longest time, and `close` restores
    the previous setting.
    """

    def __init__(
        self, *, serial: int | None, library: object, now: Callable[[], float] = time.perf_counter, **handle: object
    ) -> None:  # fmt: skip
        super().__init__(MOST_FORCE, **handle)
        self.serial = None if serial is None else whole("serial", serial, 0, 2**31 - 1)
        self.library, self.now = library_path(library, TITLE), now
        self._dhd: Dhd | None = None  # None unless the device is open
        self._id = -1
        self._calls: Calls | None = None
        self._factory_watchdog: int | None = None  # setting before `open`; None if `open` has not changed it
        self._xyz, self._status = (ctypes.c_double * 3)(), (ctypes.c_int * STATUS)()
        self._places = [ctypes.cast(ctypes.byref(self._xyz, 8 * i), ctypes.POINTER(ctypes.c_double)) for i in range(3)]

    @property
    def features(self) -> Features:
        """Features of the device; `watchdog` is None until the device has accepted the watchdog setting at `open`."""
        return Features(
            fingers=1,
            dimensions=3,
            peak_force=self.force_limit,
            resolution=self.resolution,
            watchdog=None if self._factory_watchdog is None else UNIT * WATCHDOG,
            rate=4000.0,
        )

    @property
    def calls(self) -> Calls | None:
        """C functions of the library, for a loop without Python; None if the device is not open, or without LLVM."""
        return self._calls

    def open(self, period: float) -> None:
        self.begin(period)
        with suppress(MissingPackageError):  # without LLVM the Python loop is used
            self._calls = adapt(
                self._opened().library,
                read=f"int dhdGetStatus(i32[{STATUS}] status, i8 id); int dhdGetPosition(out 0, out 1, out 2, i8 id)",
                write="int dhdSetForce(in 0, in 1, in 2, i8 id)",
                stop="int dhdSetForce(double 0, double 0, double 0, i8 id)",
                fault=f"< 0 or status[{FORCE}] == 0",
                held=f"== {NO_NEW_DATA}",
                velocity=self._estimator,
                id=self._id,
            )

    def begin(self, period: float) -> None:
        """Open the device without preparing `calls`, whose compilation takes time."""
        self.close()
        self._estimator = self._estimator_at(period)
        dhd = Dhd(self.library)
        self._id = dhd.call("dhdOpen") if self.serial is None else dhd.call("dhdOpenSerial", self.serial)
        self._dhd = dhd
        try:
            dhd.call("dhdSetForce", 0.0, 0.0, 0.0, self._id)
            dhd.call("dhdSetMaxForce", self.force_limit, self._id)
            self._watch()
            dhd.call("dhdEnableForce", 1, self._id)
            dhd.call("dhdSetForce", 0.0, 0.0, 0.0, self._id)
            self._time, self._began = 0.0, self.now()
            if not self._refresh():
                raise DeviceError("the device returned no initial position")
            self._follow()
        except DeviceError:
            self.close()
            raise

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return position (1, 3) [m], velocity (1, 3) [m/s] and time [s].

        If the library has no new data, the last sample is returned again.
        """
        self._opened().call("dhdGetStatus", self._status, self._id)
        if not self._status[FORCE]:
            raise DeviceError(_off_text(self._status[OFF_CAUSE]))
        if not self._refresh():
            self._estimator.miss()
            return self._position, self._velocity, self._time
        self._time = self.now() - self._began
        self._follow()
        return self._position, self._velocity, self._time

    def stop(self) -> None:
        if self._dhd is not None:
            self._dhd.call("dhdSetForce", 0.0, 0.0, 0.0, self._id)

    def close(self) -> None:
        """Set zero force, apply the brakes, restore the watchdog and close the device.

        Each step is attempted even if another step fails.
        """
        dhd, self._dhd, self._calls = self._dhd, None, None
        if dhd is None:
            return
        calls: list[tuple[Any, ...]] = [("dhdSetForce", 0.0, 0.0, 0.0, self._id), ("dhdStop", self._id)]
        if self._factory_watchdog is not None:
            calls += [("dhdSetWatchdog", self._factory_watchdog, self._id), ("dhdDisableExpertMode",)]
        for call in [*calls, ("dhdClose", self._id)]:
            with suppress(DeviceError):  # the hardware may be disconnected
                dhd.call(*call)
        self._factory_watchdog = None

    def fault_text(self, code: int) -> str:
        """Return the error message for a negative code of the C functions."""
        assert self._calls is not None
        adapter = self._calls.keep
        text: str = adapter.fault_text(code)
        return _off_text(adapter.buffer("status")[OFF_CAUSE]) if text.startswith("dhdGetStatus gives") else text

    def _display(self, force: FloatArray) -> None:
        self._opened().call("dhdSetForce", *force.tolist(), self._id)

    def _watch(self) -> None:
        """Set the watchdog to its longest time, if the library and the device support a watchdog."""
        dhd, before = self._opened(), ctypes.c_ubyte(0)
        if not dhd.expert:
            return
        with suppress(DeviceError):
            dhd.call("dhdEnableExpertMode")
            dhd.call("dhdGetWatchdog", ctypes.byref(before), self._id)
            dhd.call("dhdSetWatchdog", WATCHDOG, self._id)
            self._factory_watchdog = before.value

    def _refresh(self) -> bool:
        """Read a position into `_xyz`; return whether the position is a new sample."""
        fresh: bool = self._opened().call("dhdGetPosition", *self._places, self._id) != NO_NEW_DATA
        if fresh and not np.isfinite(self._xyz).all():
            raise DeviceError(f"the device returned the position {list(self._xyz)}, which is not finite")
        return fresh

    def _follow(self) -> None:
        """Update position and velocity from `_xyz`; the estimator interpolates missed samples linearly."""
        self._position[0] = self._xyz
        self._velocity[0] = self._estimator.update(self._position[0])

    def _opened(self) -> Dhd:
        if self._dhd is None:
            raise DeviceError("the device is not open: call open(period) first")
        return self._dhd


def _off_text(cause: int) -> str:
    return f"the device has switched its force off: {OFF.get(int(cause), f'cause {cause}')}"


def connect(
    *,
    serial: int | None = None,
    library: object = None,
    force_limit: float = 3.0,
    resolution: float = 1e-5,
    velocity_window: int = WINDOW,
) -> Delta:
    """Connect a Force Dimension device.

    Args:
        serial: Serial number, which is printed on the device and shown by the vendor's tools; None for the first free
            device.
        library: Path of libdrd; None to try its usual file names.
        force_limit: Largest force at the handle [N]; `open` also sets it in the vendor's library.
        resolution: Resolution of the measured positions [m].
        velocity_window: Largest number of samples in the window of the velocity estimate.
    """
    return Delta(
        serial=serial, library=library, force_limit=force_limit, resolution=resolution, velocity_window=velocity_window
    )


def quench(*, serial: int | None = None, library: object = None, **_: object) -> None:
    """Remove the force from a device whose program has crashed.

    The device is opened again, set to zero force, braked and closed.

    Args:
        serial, library: Same as for `connect`; other settings are ignored.

    Raises:
        DeviceError: If the device cannot be opened, or the call that sets zero force fails.
    """
    with Delta(serial=serial, library=library) as device:
        device.begin(PERIOD)
        device.stop()
