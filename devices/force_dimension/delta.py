"""A Force Dimension device: positions and forces in space, through the vendor's library."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from graspfx.devices.force_dimension.dhd import FORCE, NO_NEW_DATA, OFF, OFF_CAUSE, STATUS, Dhd
from graspfx.protocols import (
    Calls,
    DeviceError,
    Features,
    InputError,
    MissingPackageError,
    VelocityEstimator,
    adapt,
)

FloatArray = NDArray[np.float64]

WATCHDOG, UNIT = 255, 125e-6  # largest watchdog setting of a device, and its unit [s]


class PlainDelta:
    """A delta, omega, sigma or lambda: one finger in space, x towards the operator, y to the right, z up.

    Each call of the library is checked: a negative result is a fault. If a reading has the result 1 (no new
    data), the last sample and its time are kept. Velocities are estimated from positions. The vendor's limits and
    thresholds are not changed. If the device supports a watchdog, `open` sets it and `close` restores it.
    """

    def __init__(
        self, *, serial: int | None, library: object, force_limit: float, resolution: float, velocity_window: int,
        now: Callable[[], float] = time.perf_counter,
    ) -> None:  # fmt: skip
        self.serial, self.library, self.force_limit, self.resolution = serial, library, force_limit, resolution
        self._window, self.now = velocity_window, now
        self._dhd: Dhd | None = None  # while the device is open
        self._id = -1
        self._factory_watchdog: int | None = None  # set if it was changed
        self._xyz, self._status = (ctypes.c_double * 3)(), (ctypes.c_int * STATUS)()
        self._places = [ctypes.cast(ctypes.byref(self._xyz, 8 * i), ctypes.POINTER(ctypes.c_double)) for i in range(3)]
        self._position: FloatArray = np.zeros((1, 3))
        self._velocity: FloatArray = np.zeros((1, 3))

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

    def open(self, period: float) -> None:
        self.close()
        dhd = Dhd(self.library)
        self._id = dhd.call("dhdOpen") if self.serial is None else dhd.call("dhdOpenSerial", self.serial)
        self._dhd = dhd
        try:
            dhd.call("dhdSetForce", 0.0, 0.0, 0.0, self._id)
            dhd.call("dhdSetMaxForce", self.force_limit, self._id)
            self._watch()
            dhd.call("dhdEnableForce", 1, self._id)
            dhd.call("dhdSetForce", 0.0, 0.0, 0.0, self._id)
            self._estimator = VelocityEstimator(period, (3,), 0.5 * self.resolution, self._window)
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
            raise DeviceError(f"the device has switched its force off: {self._cause}")
        if not self._refresh():
            self._estimator.miss()
            return self._position, self._velocity, self._time
        self._time = self.now() - self._began
        self._follow()
        return self._position, self._velocity, self._time

    def write(self, forces: FloatArray) -> None:
        dhd = self._opened()
        if np.shape(forces) != (1, 3):
            raise InputError("forces", forces, "an array of shape (1, 3): one finger in space")
        force = np.array(forces[0], dtype=float)
        size = float(np.linalg.norm(force))
        if not np.isfinite(size):
            self.stop()
            raise DeviceError(
                f"a force of {force.tolist()} N is not finite and cannot be displayed: the motors are at zero force"
            )
        if size > self.force_limit:
            force *= self.force_limit / size
        dhd.call("dhdSetForce", *force.tolist(), self._id)

    def stop(self) -> None:
        if self._dhd is not None:
            self._dhd.call("dhdSetForce", 0.0, 0.0, 0.0, self._id)

    def close(self) -> None:
        """Set zero force, apply the brakes, restore the watchdog and close; attempt each step even if others fail."""
        dhd, self._dhd = self._dhd, None
        if dhd is None:
            return
        calls: list[tuple[object, ...]] = [("dhdSetForce", 0.0, 0.0, 0.0, self._id), ("dhdStop", self._id)]
        if self._factory_watchdog is not None:
            calls += [("dhdSetWatchdog", self._factory_watchdog, self._id), ("dhdDisableExpertMode",)]
        for name, *arguments in [*calls, ("dhdClose", self._id)]:
            with suppress(DeviceError):  # the hardware may be gone
                dhd.call(str(name), *arguments)
        self._factory_watchdog = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

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
        """Update position and velocity; missed samples are interpolated linearly between the last sample and this."""
        self._position[0] = self._xyz
        self._velocity[0] = self._estimator.update(self._position[0])

    @property
    def _cause(self) -> str:
        return _cause_text(int(self._status[OFF_CAUSE]))

    def _opened(self) -> Dhd:
        if self._dhd is None:
            raise DeviceError("the device is not open: call open(period) first")
        return self._dhd


class Delta(PlainDelta):
    """A device that calls its library's C functions directly, so that its loop needs no Python."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._calls: Calls | None = None

    @property
    def calls(self) -> Calls | None:
        return self._calls

    def open(self, period: float) -> None:
        super().open(period)
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

    def close(self) -> None:
        self._calls = None
        super().close()

    def fault_text(self, code: int) -> str:
        """Explain a negative code of the C functions."""
        assert self._calls is not None
        adapter = self._calls.keep
        text: str = adapter.fault_text(code)
        if text.startswith("dhdGetStatus gives"):
            return f"the device has switched its force off: {_cause_text(int(adapter.buffer('status')[OFF_CAUSE]))}"
        return text


def _cause_text(cause: int) -> str:
    return str(OFF.get(cause, f"cause {cause}"))
