"""A Touch or Phantom: positions and forces of the tip of its handle, exchanged in the thread of OpenHaptics."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Self

import numpy as np
from numpy.typing import NDArray

from graspfx.devices.open_haptics.hd import RATE, error_text
from graspfx.devices.open_haptics.scheduler import Scheduler, library_key, scheduler_of
from graspfx.protocols import Calls, DeviceError, Features, InputError, Mailbox, VelocityEstimator

FloatArray = NDArray[np.float64]

NAP = 1e-4  # time between two checks for a sample [s]
LONGEST = 0.05  # time for zero force to be displayed [s]


class Stylus:
    """One finger in space: x to the right, y up, z towards the operator.

    The library's thread runs 1000 times a second. `read` waits for the thread's next sample, at most one period. A
    written force is displayed from the thread's next call on. If no message from this program arrives for 20 ms, the
    thread displays zero force. A loop that needs no Python runs in this thread. Velocities are estimated from
    positions. Every error of the library is a fault.
    """

    def __init__(
        self, *, unit: str | None, library: object, force_limit: float, resolution: float, velocity_window: int,
        now: Callable[[], float] = time.perf_counter, sleep: Callable[[float], None] = time.sleep,
    ) -> None:  # fmt: skip
        self.unit, self.library, self.force_limit, self.resolution = unit, library, force_limit, resolution
        self._window = velocity_window
        self.now, self.sleep = now, sleep
        self.handle = -1
        self._scheduler: Scheduler | None = None  # only while the device is open
        self._calls: Calls | None = None

    @property
    def features(self) -> Features:
        return Features(
            fingers=1, dimensions=3, peak_force=self.force_limit, resolution=self.resolution, rate=float(RATE)
        )

    @property
    def calls(self) -> Calls | None:
        """C functions for the library's thread while the device is open, else None."""
        return self._calls

    @property
    def thread(self) -> object:
        """The library, whose devices share one scheduler."""
        return library_key(self.library)

    @property
    def drives(self) -> bool:
        """Whether the library's thread can call a loop."""
        return self._scheduler is not None and self._scheduler.mailbox is not None

    def drive(self, function: int, context: int) -> None:
        """Let the library's thread call `unsigned function(void *context)` once a period."""
        self._started().drive(function, context)

    def release(self, wait: float) -> bool:
        """Stop the calls begun by `drive`; return whether the last call has ended within `wait` seconds."""
        mailbox = None if self._scheduler is None else self._scheduler.mailbox
        return mailbox is None or mailbox.release(wait)

    def open(self, period: float) -> None:
        self.close()
        scheduler = scheduler_of(self.library)
        self._calls = scheduler.add(self, self.unit, self._estimator(1.0 / RATE))
        self._scheduler = scheduler
        self._rate, self._period = self._estimator(period), period
        self._count, self._time = 0, 0.0
        self._mailbox: Mailbox | None = None
        self._position: FloatArray = np.zeros((1, 3))
        self._velocity: FloatArray = np.zeros((1, 3))

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return position (1, 3) [m], velocity (1, 3) [m/s] and time [s]; the last sample if there is no new one."""
        mailbox, i, end = self._started(), self._place, self.now() + self._period
        while True:
            if fault := mailbox.fault(i):
                raise DeviceError(self.fault_text(fault))
            count, position, _ = mailbox.read(i)
            now = self.now()
            if count != self._count or now > end:
                break
            self.sleep(NAP)
        if count != self._count:
            if not np.isfinite(position).all():
                raise DeviceError(f"the device returned the position {position[0].tolist()}, which is not finite")
            self._time += (count - self._count) / RATE
            self._count = count
            self._position[...] = position
            self._velocity[0] = self._rate.update(position[0], self._time)
        return self._position, self._velocity, self._time

    def write(self, forces: FloatArray) -> None:
        mailbox, i = self._started(), self._place
        if np.shape(forces) != (1, 3):
            raise InputError("forces", forces, "an array of shape (1, 3): one finger in space")
        force = np.array(forces, dtype=float)
        size = float(np.linalg.norm(force))
        if not np.isfinite(size):
            mailbox.write(i, np.zeros((1, 3)))
            raise DeviceError(
                f"a force of {force[0].tolist()} N is not finite and cannot be displayed: the motors are at zero force"
            )
        if size > self.force_limit:
            force *= self.force_limit / size
        mailbox.write(i, force)
        if fault := mailbox.fault(i):
            raise DeviceError(self.fault_text(fault))

    def stop(self) -> None:
        """Display zero force; raise DeviceError if the library's thread does not accept it."""
        mailbox = None if self._scheduler is None else self._scheduler.mailbox
        if mailbox is None:
            return
        mailbox.release(LONGEST)
        mailbox.write(self._place, np.zeros((1, 3)))
        if not mailbox.wait(2, LONGEST):
            raise DeviceError("the scheduler of OpenHaptics no longer calls back")

    def close(self) -> None:
        """Set zero force, remove the callback, stop and disable the device; attempt each step even if others fail."""
        scheduler, self._calls = self._scheduler, None
        if scheduler is not None:
            with suppress(DeviceError):
                self.stop()
            self._scheduler = None
            scheduler.remove(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def fault_text(self, code: int) -> str:
        """Explain a negative code of the C functions."""
        if self._calls is None:
            return f"code {code}"
        adapter = self._calls.keep
        function = adapter.fault_text(code).split()[0]
        return f"{function} of OpenHaptics: {error_text(int(adapter.value(code)))}"

    def _estimator(self, period: float) -> VelocityEstimator:
        return VelocityEstimator(period, (3,), 0.5 * self.resolution, self._window)

    @property
    def _place(self) -> int:
        assert self._scheduler is not None
        place: int = self._scheduler.place(self)
        return place

    def _started(self) -> Mailbox:
        """Return the mailbox of the library's thread, starting the thread if necessary."""
        if self._scheduler is None:
            raise DeviceError("the device is not open: call open(period) first")
        mailbox: Mailbox = self._scheduler.start()
        if mailbox is not self._mailbox:
            self._mailbox, self._count = mailbox, 0
        return mailbox
