"""Touch and Phantom devices with OpenHaptics: one finger in space each, served by the vendor library's scheduler.

The driver was written from the function names and constants of the library's interface. It was tested only against an
emulator (`graspfx.testing.wire.OpenHapticsWire`). The library, libHD, is part of the vendor's SDK and not of GraspFX;
`open` loads it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._device import Handle, library_path
from graspfx.devices.open_haptics.scheduler import RATE, Scheduler, error_text, scheduler_of
from graspfx.protocols import WINDOW, Calls, DeviceError, Features, InputError, Mailbox

__all__ = ["Stylus", "connect", "quench"]

FloatArray = NDArray[np.float64]

MOST_FORCE = 40.0  # [N]
PERIOD = 0.001  # period of the only reading of `quench` [s]
NAP = 1e-4  # time between two checks for a sample [s]
LONGEST = 0.05  # longest wait for zero force to be displayed [s]


class Stylus(Handle):  # type: ignore[misc] # mypy does not see devices from inside the package
    """One finger in space: x to the right, y up, z towards the operator.

    The library's thread calls a function of this driver 1000 times a second. `read` waits for the next sample of this
    thread, at most one period of the loop. A written force is displayed from the next call on. If this program writes
    no force for 20 ms, the thread displays zero force. A loop that needs no Python runs in the library's thread.
    Velocities are estimated from positions. Every error of the library is a fault.
    """

    def __init__(
        self, *, unit: object, library: object, now: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep, **handle: object,
    ) -> None:  # fmt: skip
        super().__init__(MOST_FORCE, **handle)
        if unit is not None and not (isinstance(unit, str) and unit):
            raise InputError("unit", unit, "the device's name in the vendor's setup tool, or None")
        self.unit, self.library = unit, library_path(library, "libHD")
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
        """C functions to call in the library's thread; None unless the device is open."""
        return self._calls

    @property
    def thread(self) -> object:
        """Owner of the thread: the setting `library`, because all devices of a library share its scheduler."""
        return self.library

    @property
    def drives(self) -> bool:
        """Whether the library's thread runs, so that it can call a loop."""
        return self._scheduler is not None and self._scheduler.mailbox is not None

    def drive(self, function: int, context: int) -> None:
        """Let the library's thread call `unsigned function(void *context)` once in each period of its scheduler."""
        self._opened().drive(function, context)

    def release(self, wait: float) -> bool:
        """Stop the calls that `drive` began; return whether the last call has ended within `wait` seconds."""
        mailbox = None if self._scheduler is None else self._scheduler.mailbox
        return mailbox is None or mailbox.release(wait)

    def open(self, period: float) -> None:
        self.close()
        scheduler = scheduler_of(self.library)
        self._calls = scheduler.add(self, self.unit, self._estimator_at(1.0 / RATE))
        self._scheduler = scheduler
        self._rate, self._period = self._estimator_at(period), period
        self._count, self._time = 0, 0.0
        self._mailbox: Mailbox | None = None
        self._position, self._velocity = np.zeros((1, 3)), np.zeros((1, 3))

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return position (1, 3) [m], velocity (1, 3) [m/s] and time [s].

        If there is no new sample, the last sample is returned again.
        """
        mailbox, i, end = self._opened(), self._place, self.now() + self._period
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
        """Set zero force, remove the callback, and stop and disable the device.

        Each step is attempted even if another step fails.
        """
        scheduler, self._calls = self._scheduler, None
        if scheduler is not None:
            with suppress(DeviceError):
                self.stop()
            self._scheduler = None
            scheduler.remove(self)

    def fault_text(self, code: int) -> str:
        """Return the error message for a negative code of the C functions."""
        if self._calls is None:
            return f"code {code}"
        adapter = self._calls.keep
        function = adapter.fault_text(code).split()[0]
        return f"{function} of OpenHaptics: {error_text(int(adapter.value(code)))}"

    def _display(self, force: FloatArray) -> None:
        mailbox, i = self._opened(), self._place
        mailbox.write(i, force[None, :])
        if fault := mailbox.fault(i):
            raise DeviceError(self.fault_text(fault))

    def _display_zero(self) -> None:
        self._opened().write(self._place, np.zeros((1, 3)))

    @property
    def _place(self) -> int:
        assert self._scheduler is not None
        place: int = self._scheduler.place(self)
        return place

    def _opened(self) -> Mailbox:
        """Return the mailbox of the library's thread; start the thread if it does not run."""
        if self._scheduler is None:
            raise DeviceError("the device is not open: call open(period) first")
        mailbox: Mailbox = self._scheduler.start()
        if mailbox is not self._mailbox:
            self._mailbox, self._count = mailbox, 0
        return mailbox


def connect(
    *,
    unit: str | None = None,
    library: object = None,
    force_limit: float = 3.0,
    resolution: float = 5.5e-5,
    velocity_window: int = WINDOW,
) -> Stylus:
    """Connect a Touch or Phantom device.

    Args:
        unit: Name of the device in the vendor's setup tool; None for the default device.
        library: Path of libHD; None to try its usual file names.
        force_limit: Largest force at the handle [N].
        resolution: Resolution of the measured positions [m].
        velocity_window: Largest number of samples in the window of the velocity estimate.
    """
    return Stylus(
        unit=unit, library=library, force_limit=force_limit, resolution=resolution, velocity_window=velocity_window
    )


def quench(*, unit: str | None = None, library: object = None, **_: object) -> None:
    """Remove the force from a device whose program has crashed: open it again, display zero force, and close it.

    Args:
        unit, library: Same as for `connect`; other settings are ignored.

    Raises:
        DeviceError: If the device cannot be opened, or its scheduler does not run.
    """
    with Stylus(unit=unit, library=library) as device:
        device.open(PERIOD)
        device.read()
        device.stop()
