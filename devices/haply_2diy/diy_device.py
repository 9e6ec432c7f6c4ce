"""The Haply 2DIY as a device: handle motion from angles, torques from forces."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Self

import numpy as np
from numpy.typing import NDArray

from graspfx.devices.haply_2diy.diy_frames import ANGLES, angles_in, setup_frame, torque_frame
from graspfx.devices.haply_2diy.five_bar import FiveBar
from graspfx.protocols import DeviceError, Features, InputError, SerialPort, VelocityEstimator

FloatArray = NDArray[np.float64]

FASTEST = 30.0  # speed limit of a link, 2 m/s at its tip; a faster angle is a bit error [rad/s]
HARDEST = 5000.0  # acceleration limit of a link, 350 m/s^2 at its tip; no hand and no motor exceeds it [rad/s^2]
LONGEST = 5.0  # largest number of samples over which the limits are extrapolated
SILENCE = 20  # number of successive readings without an answer after which the board is lost
BLOCKED = 1.0  # time for which a board waits for the rest of a frame [s]


class Haply2Diy:
    """A 2DIY at a serial port: one finger in the plane.

        p = p(q),   v = J(q) q',   tau = J'(q) f

    The board answers a frame of torques with its angles. Therefore `ask` repeats the last torques, so that a reading is
    only as old as one exchange; the answer to `write` is discarded. Torques beyond the limit are scaled by a common
    factor, so that the force keeps its direction. An answer is rejected if it has the wrong length, comes from another
    device, or exceeds the speed or acceleration limit of a link since the last answer. In that case the line is
    flushed, the last sample is kept, and the next reading asks again.
    """

    def __init__(
        self,
        port: SerialPort,
        linkage: FiveBar,
        *,
        device: int,
        home: tuple[float, float],
        counts: float,
        torque_limit: float,
        velocity_window: int,
        timeout: float,
    ) -> None:
        self.port, self.linkage, self.device, self.home, self.counts = port, linkage, device, home, counts
        self.torque_limit, self.timeout = torque_limit, timeout
        self._window = velocity_window
        self._position, self._velocity, self._largest = np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(1)
        self._raw: FloatArray = np.zeros(2)
        self._estimator: VelocityEstimator | None = None  # only while the device is open
        self._torque = (0.0, 0.0)
        self._answering = False  # whether a frame is unanswered
        self._turn(*self._angles_at_home)

    @property
    def _angles_at_home(self) -> tuple[float, float]:
        return math.radians(self.home[0]), math.radians(self.home[1])

    @property
    def features(self) -> Features:
        """Features; peak force and resolution refer to home, while `largest_force` depends on the handle's position."""
        levers = self._levers(self.linkage.handle(*self._angles_at_home)[1])
        return Features(
            fingers=1,
            dimensions=2,
            workspace=self.linkage.reach,
            peak_force=float(self.torque_limit / levers.max()),
            resolution=float(math.tau / self.counts * levers.max()),
        )

    @property
    def largest_force(self) -> FloatArray:
        """Largest force that the motors reach in every direction at the last reading (1,) [N]."""
        return self._largest

    @property
    def raw(self) -> FloatArray:
        """Last angles of encoders 1 and 2 (2,) [rad]."""
        return self._raw

    def open(self, period: float) -> None:
        """Set the board up and take a first reading; the handle must be at home."""
        self.close()
        self.port.open()
        try:
            self._period, self._torque = period, (0.0, 0.0)
            self._drain()
            self.port.send(setup_frame(self.device, self.home, self.counts))
            self._angles = self._first_angles()
        except DeviceError:
            self.port.close()
            raise
        self._estimator = VelocityEstimator(period, (2,), math.pi / self.counts, self._window)
        self._began = self._asked_at = self.port.now()
        self._waiting, self._silent, self._answers, self._time = False, 0, 0, 0.0
        self._rates, self._last, self._count = (0.0, 0.0), 0.0, math.tau / self.counts
        self._follow(*self._angles)

    def ask(self) -> None:
        self._opened()
        if self._answering:
            self._bytes(self.port.now() + 0.5 * self.timeout)  # answer to the last `write`
        self.port.flush()  # discards remains of a failed transmission
        self._send()
        self._waiting, self._asked_at = True, self.port.now()

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return position (1, 2) [m], velocity (1, 2) [m/s] and time [s]; the last sample if there is no new answer."""
        self._opened()
        if not self._waiting:
            self.ask()
        self._waiting = False
        angles = self._answer(self._asked_at + self.timeout)
        now = self._asked_at - self._began
        if angles is None or not self._can_be(angles, now - self._time):
            self._silent += 1
            if self._silent > SILENCE and now - self._time > SILENCE * self._period:
                self._abandon()
                raise DeviceError(f"the board at {self.port.path} did not answer {self._silent} readings in a row")
            return self._position, self._velocity, self._time
        self._silent, self._time = 0, now
        try:
            self._follow(*angles)
        except DeviceError:  # out of reach
            self._abandon()
            raise
        return self._position, self._velocity, self._time

    def write(self, forces: FloatArray) -> None:
        self._opened()
        if np.shape(forces) != (1, 2):
            raise InputError("forces", forces, "an array of shape (1, 2): one finger in the plane")
        first, second = (self._J.T @ forces[0]).tolist()
        if not (math.isfinite(first) and math.isfinite(second)):
            self.stop()
            raise DeviceError(
                f"a force of {forces[0].tolist()} N is not finite and cannot be displayed: "
                "the motors are at zero torque"
            )
        excess = max(1.0, abs(first) / self.torque_limit, abs(second) / self.torque_limit)
        self._torque = first / excess, second / excess
        self._send()

    def stop(self) -> None:
        self._torque = (0.0, 0.0)
        if self._estimator is not None:
            self._send()

    def close(self) -> None:
        if self._estimator is not None:
            self._abandon()
        self._estimator = None
        self.port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _send(self) -> None:
        self.port.send(torque_frame(self.device, *self._torque))
        self._answering = True

    def _abandon(self) -> None:
        """Write zero torque twice; a board that waits for the rest of a frame interprets the first one as the rest."""
        self._torque = (0.0, 0.0)
        with suppress(DeviceError):  # the hardware may be gone
            for _ in range(2):
                self._send()

    def _drain(self) -> None:
        """Read until nothing arrives; an answer to the last `close` contains angles from before the set-up."""
        deadline = self.port.now() + BLOCKED
        while self.port.receive(self.port.now() + self.timeout) and self.port.now() < deadline:
            pass

    def _first_angles(self) -> tuple[float, float]:
        """Ask until the board answers, for as long as a board may be blocked."""
        deadline = self.port.now() + BLOCKED + 0.2
        while self.port.now() < deadline:
            self.port.flush()
            self._send()
            angles = self._answer(self.port.now() + 0.05)
            if angles is not None:
                return angles
        raise DeviceError(
            f"the board at {self.port.path} does not answer: is it a 2DIY, and is its device number {self.device}?"
        )

    def _answer(self, deadline: float) -> tuple[float, float] | None:
        """Wait for an answer and return its angles [rad]; None if it is late, truncated or from another device."""
        angles = angles_in(self._bytes(deadline), self.device)
        self._answering = False
        return None if angles is None else (math.radians(angles[0]), math.radians(angles[1]))

    def _bytes(self, deadline: float) -> bytes:
        """Wait for the bytes of an answer, or until the deadline."""
        data = b""
        while len(data) < ANGLES.size and (part := self.port.receive(deadline)):
            data += part
        return data

    def _can_be(self, angles: tuple[float, float], since: float) -> bool:
        """Tell whether the angles respect the links' speed and acceleration limits since the last sample."""
        time = min(max(since, self._period), LONGEST * self._period)
        step, off = FASTEST * time, HARDEST * time * time
        for new, old, rate in zip(angles, self._angles, self._rates, strict=True):
            if abs(new - old) > step + 4.0 * self._count:
                return False
            if abs(new - old - rate * time) > off + (2.0 + 2.0 * time / self._period) * self._count:
                return False
        return True

    def _follow(self, first: float, second: float) -> None:
        """Update position and velocity from new angles [rad], read at the present time."""
        assert self._estimator is not None
        rate = self._estimator.update((first, second), self._time)
        passed = max(self._time - self._last, self._period)
        self._rates = (first - self._angles[0]) / passed, (second - self._angles[1]) / passed
        self._angles, self._last = (first, second), self._time
        self._raw[:] = first, second
        self._turn(first, second)
        self._velocity[0] = self._J @ rate

    def _turn(self, q1: float, q2: float) -> None:
        self._position[0], self._J = self.linkage.handle(q1, q2)
        self._largest[0] = self.torque_limit / self._levers(self._J).max()

    @staticmethod
    def _levers(J: FloatArray) -> FloatArray:
        """Compute the displacement of the handle per radian of each motor (2,) [m]."""
        levers: FloatArray = np.hypot(J[0], J[1])
        return levers

    def _opened(self) -> None:
        if self._estimator is None:
            raise DeviceError("the 2DIY is not open: call open(period) first")
