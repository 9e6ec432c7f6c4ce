"""Force Dimension devices (delta, omega, sigma, lambda): one finger in space, through the vendor's library.

The driver was written from the function names and constants of the vendor's interface. It was tested only against an
emulator (`graspfx.testing.wire.ForceDimensionWire`). The library, libdrd, is part of the vendor's SDK; it is not
included, and is loaded at `open`.
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
PERIOD = 0.001  # arbitrary, because `quench` reads only once [s]
WATCHDOG, UNIT = 255, 125e-6  # largest watchdog setting of a device, and its unit [s]

TITLE = "Force Dimension's library"
NAMES = {"win32": ("drd64.dll", "dhd64.dll"), "darwin": ("libdrd.dylib", "libdhd.dylib")}
ELSEWHERE = "libdrd.so", "libdrd.so.3", "libdhd.so"

# Return values of the library's functions: a negative value is an error.
NO_NEW_DATA = 1  # from a reading within the library's time guard, which returns the last sample again

STATUS = 17  # number of entries of dhdGetStatus
FORCE, OFF_CAUSE = 5, 14
OFF = {
    0: "no cause reported: its force may not have been switched on, or its encoders not initialised",
    1: "the button on the device was pressed",
    2: "the velocity was above the device's safety threshold",
    3: "the device's watchdog: no force arrived in time",
    4: "a program disabled it",
    5: "the USB cable; check its connection",
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
        path: Path of the library; None to try its usual file names; or the loaded library.

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

    Each call of the library is checked: a negative result is a fault. If a reading has the result 1 (no new
    data), the last sample and its time are kept. Velocities are estimated from positions. Of the vendor's limits and
    thresholds, `open` sets only the largest force, to `force_limit`. If the device supports a watchdog, `open` sets it
    and `close` restores it.
    """

    def __init__(
        self, *, serial: int | None, library: object, now: Callable[[], float] = time.perf_counter, **handle: object
    ) -> None:  # fmt: skip
        super().__init__(MOST_FORCE, **handle)
        self.serial = None if serial is None else whole("serial", serial, 0, 2**31 - 1)
        self.library, self.now = library_path(library, TITLE), now
        self._dhd: Dhd | None = None  # while the device is open
        self._id = -1
        self._calls: Calls | None = None
        self._factory_watchdog: int | None = None  # set if it was changed
        self._xyz, self._status = (ctypes.c_double * 3)(), (ctypes.c_int * STATUS)()
        self._places = [ctypes.cast(ctypes.byref(self._xyz, 8 * i), ctypes.POINTER(ctypes.c_double)) for i in range(3)]

    @property
    def features(self) -> Features:
        """Features; the watchdog is unknown until the device has accepted it at `open`."""
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
        """C functions of the library while the device is open, for a loop without Python; otherwise None."""
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
        """Open the device without its C functions, which take time to compile."""
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
        """Return position (1, 3) [m], velocity (1, 3) [m/s] and time [s]; the last sample if there are no new data."""
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
        """Set zero force, apply the brakes, restore the watchdog and close; attempt each step even if others fail."""
        dhd, self._dhd, self._calls = self._dhd, None, None
        if dhd is None:
            return
        calls: list[tuple[Any, ...]] = [("dhdSetForce", 0.0, 0.0, 0.0, self._id), ("dhdStop", self._id)]
        if self._factory_watchdog is not None:
            calls += [("dhdSetWatchdog", self._factory_watchdog, self._id), ("dhdDisableExpertMode",)]
        for call in [*calls, ("dhdClose", self._id)]:
            with suppress(DeviceError):  # the hardware may be gone
                dhd.call(*call)
        self._factory_watchdog = None

    def fault_text(self, code: int) -> str:
        """Explain a negative code of the C functions."""
        assert self._calls is not None
        adapter = self._calls.keep
        text: str = adapter.fault_text(code)
        return _off_text(adapter.buffer("status")[OFF_CAUSE]) if text.startswith("dhdGetStatus gives") else text

    def _display(self, force: FloatArray) -> None:
        self._opened().call("dhdSetForce", *force.tolist(), self._id)

    def _watch(self) -> None:
        """Set the device's watchdog if its library and the device support it."""
        dhd, before = self._opened(), ctypes.c_ubyte(0)
        if not dhd.expert:
            return
        with suppress(DeviceError):
            dhd.call("dhdEnableExpertMode")
            dhd.call("dhdGetWatchdog", ctypes.byref(before), self._id)
            dhd.call("dhdSetWatchdog", WATCHDOG, self._id)
            self._factory_watchdog = before.value

    def _refresh(self) -> bool:
        """Read the position and tell whether it is new."""
        fresh: bool = self._opened().call("dhdGetPosition", *self._places, self._id) != NO_NEW_DATA
        if fresh and not np.isfinite(self._xyz).all():
            raise DeviceError(f"the device returned the position {list(self._xyz)}, which is not finite")
        return fresh

    def _follow(self) -> None:
        """Update position and velocity; missed samples are interpolated linearly between the last and this sample."""
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
    """Connect a device.

    Args:
        serial: Serial number, printed on the device and shown by the vendor's tools (device ids change between starts);
            None for the first free device.
        library: Path of libdrd; None to try its usual file names.
        force_limit: Largest force at the handle, also set in the vendor's library [N].
        resolution: Resolution of a position [m].
        velocity_window: Longest window of the velocity estimate [samples].
    """
    return Delta(
        serial=serial, library=library, force_limit=force_limit, resolution=resolution, velocity_window=velocity_window
    )


def quench(*, serial: int | None = None, library: object = None, **_: object) -> None:
    """Remove the force from a device whose program has died: reopen it, set zero force, apply the brakes, close.

    Args:
        serial, library: Same as for `connect`; other settings are ignored.

    Raises:
        DeviceError: If the device cannot be opened, or rejects zero force.
    """
    with Delta(serial=serial, library=library) as device:
        device.begin(PERIOD)
        device.stop()
