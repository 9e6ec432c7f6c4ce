"""A device of the Haply Inverse service: one finger in space."""

from __future__ import annotations

from contextlib import suppress
from typing import Self

import numpy as np
from numpy.typing import NDArray

from graspfx.devices.haply_inverse.service import Service
from graspfx.protocols import DeviceError, Features, InputError, ProgramLock, VelocityEstimator

FloatArray = NDArray[np.float64]

FASTEST = 5.0  # speed limit of a hand; a position that implies a higher speed is rejected [m/s]
NEAR = 1e-3  # additional tolerance of a position [m]
SILENCE = 0.1  # time without a sample after which the device is lost [s]
FIRST = 1.0  # time for the first sample [s]


def lock_of(service: Service, name: str) -> ProgramLock:
    """Return the lock of a device, which only one program on this machine can hold at a time."""
    return ProgramLock(f"the device {name} of {service.url}")


class Inverse:
    """An Inverse, accessed through its service: positions and forces in the service's axes, z up.

    `ask` repeats the last forces, so that a reading is only as old as one exchange. A position that a hand cannot have
    reached since the last sample is rejected. Without a new position, the last sample and its time are kept.

    Args:
        service: Service shared by all devices of this program.
        device: Id of the device; None for the only device.
        basis: Expected basis of the device's axes in the service.
        damping: Expected damping of the service [N s/m].
        force_limit: Largest force [N].
        resolution: Resolution of a position [m].
        velocity_window: Longest window of the velocity estimate [samples].
        timeout: Longest wait for an answer [s].
    """

    def __init__(
        self, service: Service, *, device: str | None, basis: str, damping: float, force_limit: float,
        resolution: float, velocity_window: int, timeout: float,
    ) -> None:  # fmt: skip
        self.service, self.device, self.basis, self.damping = service, device, basis, damping
        self.force_limit, self.resolution, self.timeout = force_limit, resolution, timeout
        self._window = velocity_window
        self._name = ""  # empty unless the device is open
        self._lock: ProgramLock | None = None
        self._position: FloatArray = np.zeros((1, 3))
        self._velocity: FloatArray = np.zeros((1, 3))

    @property
    def features(self) -> Features:
        return Features(
            fingers=1,
            dimensions=3,
            peak_force=self.force_limit,
            friction=self.damping or None,
            resolution=self.resolution,
        )

    def open(self, period: float) -> None:
        self.close()
        name = self.service.join(self.device, self.basis, self.damping)
        self._name = name
        try:
            lock = lock_of(self.service, name)
            lock.take()
            self._lock = lock
            self._began = self._time = self._question = self.service.now()
            self._waiting = False
            sample = None
            while sample is None and self.service.now() < self._began + FIRST:
                self.service.ask(name)
                sample = self.service.sample(name, self.service.now() + 0.05)
            if sample is None:
                raise DeviceError(f"{name} reported no initial position")
            (self._position[0], self._time), self._velocity[0] = sample, 0.0
        except DeviceError:
            self.close()
            raise
        self._estimator = VelocityEstimator(period, (3,), 0.5 * self.resolution, self._window)
        self._estimator.update(self._position[0], self._time - self._began)

    def ask(self) -> None:
        self._opened()
        self._question, self._waiting = self.service.now(), True
        self.service.ask(self._name)

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return position (1, 3) [m], velocity (1, 3) [m/s] and time [s]; the last sample if there is no new one."""
        self._opened()
        if not self._waiting:
            self.ask()
        self._waiting = False
        sample = self.service.sample(self._name, self._question + self.timeout)
        if sample is not None and sample[1] > self._time and self._can_be(*sample):
            self._position[0], self._time = sample
            self._velocity[0] = self._estimator.update(self._position[0], self._time - self._began)
        elif self.service.now() - self._time > SILENCE:
            self._abandon()
            raise DeviceError(f"{self._name} has reported no new position for {SILENCE:g} s")
        return self._position, self._velocity, self._time - self._began

    def write(self, forces: FloatArray) -> None:
        self._opened()
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
        x, y, z = force.tolist()
        self.service.write(self._name, (x, y, z))

    def stop(self) -> None:
        if self._name:
            self.service.stop(self._name)

    def close(self) -> None:
        name, self._name = self._name, ""
        lock, self._lock = self._lock, None
        if name:
            self.service.leave(name)
        if lock is not None:
            lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _abandon(self) -> None:
        with suppress(DeviceError):  # the service may be gone
            self.stop()

    def _can_be(self, position: tuple[float, float, float], when: float) -> bool:
        """Tell whether a hand can have moved this far since the last sample."""
        way = float(np.linalg.norm(self._position[0] - position))
        return bool(way <= NEAR + FASTEST * (when - self._time))

    def _opened(self) -> None:
        if not self._name:
            raise DeviceError("the Inverse is not open: call open(period) first")
