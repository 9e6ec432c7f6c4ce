"""A device on its wire, as the conformance kit uses it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import DeviceError
from graspfx.loop.device import Device, Features

if TYPE_CHECKING:
    from graspfx.testing.wire.wire import Wire

FloatArray = NDArray[np.float64]

PATIENCE = 0.3  # for an emulator to act [s]


class WireBench:
    """A device on its wire: opened with the fingers at home, and ticked."""

    def __init__(self, device: Device, wire: Wire, period: float, force: float) -> None:
        self.device, self.wire, self.period = device, wire, period
        self.features: Features = device.features
        self.shape = self.features.fingers, self.features.dimensions
        peak = self.features.peak_force
        self.size = force if peak is None else min(force, 0.5 * peak)
        self.forces: FloatArray = np.full(self.shape, self.size / math.sqrt(self.shape[1]))

    def open(self) -> None:
        """Open the device, afresh, with the fingers at home."""
        self.device.close()
        self.wire.home()
        self.device.open(self.period)

    def tick(self, forces: FloatArray | None = None) -> tuple[FloatArray, FloatArray, float]:
        p, v, now = self.device.read()
        p, v = p.copy(), v.copy()
        self.device.write(np.zeros(self.shape) if forces is None else forces)
        return p, v, now

    @property
    def patience(self) -> float:
        """Time in which the wire must show something before a watchdog of the hardware would [s]."""
        watchdog = self.device.features.watchdog
        return PATIENCE if watchdog is None else min(PATIENCE, 0.5 * watchdog * self.wire.slowness)

    def push(self) -> None:
        """Write a small force until it is on the wire."""
        there = self.becomes(lambda: bool(self.wire.torque.any()), lambda: self.tick(self.forces))
        if not there:
            raise DeviceError(f"{self.size} N are written, and the motors hold nothing")

    def becomes(
        self, state: Callable[[], bool], act: Callable[[], Any] | None = None, within: float | None = None
    ) -> bool:
        """Tell whether the wire comes into a state in time, while the device is ticked by `act` or left alone."""
        wait = within if within is not None else PATIENCE if act is not None else self.patience
        deadline = self.wire.clock.now() + wait
        while True:
            if act is not None:
                act()
            if state():
                return True
            if self.wire.clock.now() > deadline:
                return False
            self.wire.clock.sleep(min(self.period, 1e-3))

    def place_error(self, seen: FloatArray) -> float:
        """Compute how far fingers are from where they are read, at most [m]; the wire knows where they are."""
        return float(np.abs(seen - np.asarray(self.wire.position, dtype=float)).max())

    def force_error(self, forces: FloatArray) -> float:
        """Compute how far the forces on the wire are from those that were written, at most [N]; it knows them."""
        return float(np.abs(np.asarray(self.wire.force, dtype=float) - forces).max())

    def is_quiet(self) -> bool:
        return not self.wire.torque.any()

    def falls_silent(self) -> bool:
        """Tell whether the motors hold nothing soon, and then stay so."""
        if not self.becomes(self.is_quiet, within=self.patience):
            return False
        self.wire.clock.sleep(0.005)
        return self.is_quiet()
