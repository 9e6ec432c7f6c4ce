"""Devices of the Haply Inverse service (Inverse3): one finger in space each, over a WebSocket.

The driver was tested only against an emulator (`graspfx.testing.wire.InverseWire`); the service's messages about a
device's basis, mount, damping and force gate are assumptions. The service sends a list of devices when a program
connects, then answers each message once. All devices of a program share one connection, and each message contains the
forces of all these devices.

It is unknown whether the service removes a force when the program crashes; `quench` connects again and sets zero force.
"""

from __future__ import annotations

import itertools
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._device import Handle
from graspfx.devices._settings import number
from graspfx.devices.haply_inverse.service import IDENTITY, Service, service_at
from graspfx.protocols import SMALLEST, WINDOW, DeviceError, Features, InputError, ProgramLock

__all__ = ["Inverse", "connect", "quench"]

FloatArray = NDArray[np.float64]

URL = "ws://localhost:10001"
MOST_FORCE = 20.0  # [N]
BASES = frozenset("".join(letters) for letters in itertools.permutations(IDENTITY))
FASTEST = 5.0  # speed limit of a hand; a position that implies a higher speed is rejected [m/s]
NEAR = 1e-3  # additional tolerance of a position [m]
SILENCE = 0.1  # time without a new sample after which the device counts as lost [s]
FIRST = 1.0  # longest wait for the first sample [s]
QUIET = 2.0  # longest wait for an answer to `quench` [s]


class Inverse(Handle):  # type: ignore[misc] # mypy does not see devices from inside the package
    """An Inverse3 as one finger, accessed through the service; positions and forces are in the service's axes, z up.

    `ask` sends the last forces again to request a position, so that a reading is only as old as one exchange. A
    position is rejected if a hand cannot have moved there since the last sample. Without a new position, `read` returns
    the last sample and the time of this sample again.

    Args:
        service: Service shared by all devices of this program.
        device, basis, damping, timeout: Settings of the driver.
        handle: Settings of `Handle`.
    """

    def __init__(
        self, service: Service, *, device: object, basis: object, damping: object, timeout: object, **handle: object
    ) -> None:  # fmt: skip
        super().__init__(MOST_FORCE, **handle)
        if device is not None and (not isinstance(device, str) or not device or not device.isprintable()):
            raise InputError("device", device, "the id of a device of the service, such as '049D'")
        if not isinstance(basis, str) or basis not in BASES:
            raise InputError("basis", basis, f"one of {', '.join(sorted(BASES))}")
        self.service, self.device, self.basis = service, device, basis
        self.damping, self.timeout = number("damping", damping, 0.0), number("timeout", timeout, SMALLEST, 1.0)
        self._name = ""  # empty unless the device is open
        self._lock: ProgramLock | None = None

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
        self._estimator = self._estimator_at(period)
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
                raise DeviceError(f"{name} reported no initial position within {FIRST:g} s")
            (self._position[0], self._time), self._velocity[0] = sample, 0.0
        except DeviceError:
            self.close()
            raise
        self._estimator.update(self._position[0], self._time - self._began)

    def ask(self) -> None:
        self._opened()
        self._question, self._waiting = self.service.now(), True
        self.service.ask(self._name)

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return position (1, 3) [m], velocity (1, 3) [m/s] and time [s].

        If there is no new sample, the last sample is returned again.
        """
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

    def _display(self, force: FloatArray) -> None:
        x, y, z = force.tolist()
        self.service.write(self._name, (x, y, z))

    def _abandon(self) -> None:
        with suppress(DeviceError):  # the service may have ended
            self.stop()

    def _can_be(self, position: tuple[float, float, float], when: float) -> bool:
        """Tell whether a hand can have moved from the last sample to a position [m] by the time `when` [s]."""
        way = float(np.linalg.norm(self._position[0] - position))
        return bool(way <= NEAR + FASTEST * (when - self._time))

    def _opened(self) -> None:
        if not self._name:
            raise DeviceError("the Inverse is not open: call open(period) first")


def connect(
    *,
    url: str = URL,
    device: str | None = None,
    basis: str = IDENTITY,
    damping: float = 0.0,
    force_limit: float = 3.0,
    resolution: float = 1e-5,
    velocity_window: int = WINDOW,
    timeout: float = 0.002,
) -> Inverse:
    """Connect a device of the Haply Inverse service.

    Args:
        url: Address of the service.
        device: Id of the device, as shown by the service's tools; None if the service has only one device.
        basis: Basis that the service must report for the device, such as "XYZ"; if it differs, `open` raises
            DeviceError.
        damping: Damping that the service must report for the device [N s/m], treated as damping b of the device.
        force_limit: Largest force at the handle [N]; the service documents no limit.
        resolution: Resolution of the measured positions [m].
        velocity_window: Largest number of samples in the window of the velocity estimate.
        timeout: Longest wait for an answer [s], less than the sampling period; after it the last sample is returned.

    Raises:
        MissingPackageError: If websockets is not installed; `pip install graspfx[inverse]` installs it.
    """
    return Inverse(
        service_at(url), device=device, basis=basis, damping=damping, timeout=timeout, force_limit=force_limit,
        resolution=resolution, velocity_window=velocity_window,
    )  # fmt: skip


def quench(*, url: str = URL, device: str | None = None, **_: object) -> None:
    """Remove the force from a device whose program has crashed.

    A new connection sends zero force until the service answers.

    Args:
        url, device: Same as for `connect`; other settings are ignored.

    Raises:
        MissingPackageError: If websockets is not installed.
        DeviceError: If the service does not answer, so that the force may persist.
    """
    service = Service(url)
    name = service.join(device)
    lock = lock_of(service, name)
    try:
        lock.take()
        deadline = service.now() + QUIET
        while service.now() < deadline:
            service.stop(name)
            service.ask(name)
            if service.sample(name, service.now() + 0.05) is not None:
                return
    finally:
        service.leave(name)
        lock.release()
    raise DeviceError(f"the service at {url} does not answer: switch {name} off, because its force may persist")


def lock_of(service: Service, name: str) -> ProgramLock:
    """Return the lock of a device, which only one program on this machine can hold at a time."""
    return ProgramLock(f"the device {name} of {service.url}")
