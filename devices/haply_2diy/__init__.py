"""The Haply 2DIY, open hardware: a planar five-bar linkage with two motors and two encoders, one finger.

The driver was written from the board's protocol, and tested only against an emulator (`graspfx.testing.wire.DiyWire`).

The board's firmware has **no watchdog: the last torques persist when the program crashes**. A truncated frame blocks
the board for up to a second with its motors on; each frame is therefore sent by a single call. `stop`, `close` and the
end of `with` send zero torques, and `quench` removes the torques after a program has crashed. The protocol has no
checksum: a bit error in an angle remains undetected if the links could have moved to the erroneous angle within their
speed and acceleration limits.

`open` sets the encoders to the angles of the home position, so the handle must be at home when `open` is called.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._device import Closing
from graspfx.devices._settings import number, pair, port_name, whole
from graspfx.protocols import (
    LARGEST,
    SMALLEST,
    WINDOW,
    DeviceError,
    Features,
    InputError,
    SerialPort,
    VelocityEstimator,
)

__all__ = ["Haply2Diy", "connect", "quench"]

FloatArray = NDArray[np.float64]

Pair = tuple[float, float]

FIRMWARE_LIMIT = 0.123  # torque limit of a motor in the board's firmware [N m]
TRIES = 10  # attempts to send zero torques and receive an answer
FASTEST = 30.0  # speed limit of a link, 2 m/s at its tip; a larger speed is due to a bit error [rad/s]
HARDEST = 5000.0  # acceleration limit of a link, 350 m/s^2 at its tip; no hand or motor exceeds this limit [rad/s^2]
LONGEST = 5.0  # largest number of samples over which the two limits are extrapolated
SILENCE = 20  # largest number of successive readings without an answer before the board counts as lost
BLOCKED = 1.0  # time for which a board waits for the rest of a frame [s]

# Frames of the serial line are little-endian, without start byte, length or checksum. Ports are in ascending order:
# port 1 is motor and encoder 2, port 2 is motor and encoder 1. The board answers a frame of torques with the device's
# number and the angles; it answers no other frame.
SETUP, TORQUE = 1, 2
PORTS = 0b11  # bits of the motors' and encoders' ports
COUNTERCLOCKWISE = 1

ANGLES = struct.Struct("<B2f")  # answer: device, then angles of encoders 2 and 1 [deg]


@dataclass(frozen=True)
class FiveBar:
    """Five-bar linkage: the handle's position p, and J = dp/dq, for the angles q1, q2 of the links at the motors.

        A = (-d/2, 0) + l (cos q1, sin q1),   B = (d/2, 0) + l (cos q2, sin q2),   |p - A| = |p - B| = L,
        J = [(p - A)'; (p - B)']^-1 diag((p - A)'dA/dq1, (p - B)'dB/dq2)

    A and B are the tips of the links at the motors. The origin is midway between the motors; x points from motor 1 to
    motor 2, y from the motors to the handle.

    Args:
        links: Lengths l at the motors and L to the handle [m].
        distance: Distance d between the motors [m]; 0 if the motors share an axis.
        margin: Smallest allowed height of the triangle A, p, B, which is zero in the stretched posture, and smallest
            allowed distance from A to B, which is zero in the folded posture [m].
    """

    links: Pair
    distance: float
    margin: float

    def __post_init__(self) -> None:
        if not 0.0 < self.margin < min(self.links):
            raise InputError("margin", self.margin, f"a length between 0 and the shorter link, {min(self.links):g} m")

    @property
    def reach(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper corner (2,) of a box around the positions that both sides of the linkage reach [m]."""
        far = sum(self.links)
        across = far - self.distance / 2.0
        return np.array([-across, 0.0]), np.array([across, math.sqrt(far**2 - self.distance**2 / 4.0)])

    def handle(self, q1: float, q2: float) -> tuple[Pair, FloatArray]:
        """Return the handle's position (x, y) [m] and J = dp/dq (2, 2) [m] at the motors' angles [rad].

        Raises:
            DeviceError: If the links do not meet, or are closer than `margin` to the stretched or folded posture.
        """
        (inner, outer), half = self.links, self.distance / 2.0
        c1, s1, c2, s2 = math.cos(q1), math.sin(q1), math.cos(q2), math.sin(q2)
        ax, ay, bx, by = inner * c1 - half, inner * s1, inner * c2 + half, inner * s2
        dx, dy = bx - ax, by - ay
        apart = math.hypot(dx, dy)
        height = outer * outer - 0.25 * apart * apart
        if not (height >= self.margin * self.margin and apart >= self.margin):
            raise DeviceError(
                f"the links at {math.degrees(q1):.1f} and {math.degrees(q2):.1f} degrees have their tips {apart:.4f} m "
                f"apart: the handle is at the end of its reach ({self.margin:g} m short of the stretched and folded "
                "postures), or was not at home when the device was opened"
            )
        away = math.sqrt(height) / apart
        x, y = 0.5 * (ax + bx) - away * dy, 0.5 * (ay + by) + away * dx
        ux, uy, vx, vy = x - ax, y - ay, x - bx, y - by
        first, second = inner * (uy * c1 - ux * s1), inner * (vy * c2 - vx * s2)
        scale = 1.0 / (ux * vy - uy * vx)
        J = np.array([[vy * first, -uy * second], [-vx * first, ux * second]]) * scale
        return (x, y), J


class Haply2Diy(Closing):  # type: ignore[misc] # mypy does not see devices from inside the package
    """A 2DIY at a serial port: one finger in the plane.

        p = p(q),   v = J(q) q',   tau = J'(q) f

    p and v are the position and velocity of the handle, q the angles of the links at the motors, f the force and tau
    the torques of the motors; q' is a rate, and J' a transpose.

    The board sends its angles in answer to a frame of torques. `ask` sends the last torques again, so that a reading is
    only as old as one exchange; the answer to `write` is discarded. Torques beyond the limit are scaled by a common
    factor, which keeps the direction of the force. An answer is rejected if it has the wrong length, comes from another
    device, or implies that a link has exceeded its speed or acceleration limit since the last accepted answer. `read`
    then returns the last sample again, and the next reading flushes the line and asks again.
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
        """Features of the device; peak force and resolution are those at the home position."""
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
        """Largest force that the motors can display in every direction at the last position (1,) [N]."""
        return self._largest

    @property
    def raw(self) -> FloatArray:
        """Angles of encoders 1 and 2 in the last sample (2,) [rad]."""
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
            answer(self.port, self.port.now() + 0.5 * self.timeout)  # answer to the last `write`
        self.port.flush()  # discards remains of a failed transmission
        self._send()
        self._waiting, self._asked_at = True, self.port.now()

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return position (1, 2) [m], velocity (1, 2) [m/s] and time [s].

        If no valid answer has arrived, the last sample is returned again.
        """
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
                f"a force of {np.asarray(forces[0]).tolist()} N is not finite and cannot be displayed: "
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

    def _send(self) -> None:
        self.port.send(torque_frame(self.device, *self._torque))
        self._answering = True

    def _abandon(self) -> None:
        """Send two frames of zero torques; a board that waits for the rest of a frame takes the first as that rest."""
        self._torque = (0.0, 0.0)
        with suppress(DeviceError):  # the hardware may be disconnected
            for _ in range(2):
                self._send()

    def _drain(self) -> None:
        """Discard pending data: a late answer to a previous `close` has angles from before the set-up."""
        deadline = self.port.now() + BLOCKED
        while self.port.receive(self.port.now() + self.timeout) and self.port.now() < deadline:
            pass

    def _first_angles(self) -> tuple[float, float]:
        """Ask until the board answers, for the longest time that the board can be blocked; return the angles [rad]."""
        deadline = self.port.now() + BLOCKED + 0.2
        while self.port.now() < deadline:
            self.port.flush()
            self._send()
            angles = self._answer(self.port.now() + 0.05)
            if angles is not None:
                return angles
        raise DeviceError(
            f"the board at {self.port.path} does not answer: check that it is a 2DIY with device number {self.device}"
        )

    def _answer(self, deadline: float) -> tuple[float, float] | None:
        """Wait for an answer; return its angles [rad], or None if it is late, truncated or from another device."""
        angles = angles_in(answer(self.port, deadline), self.device)
        self._answering = False
        return None if angles is None else (math.radians(angles[0]), math.radians(angles[1]))

    def _can_be(self, angles: tuple[float, float], since: float) -> bool:
        """Tell whether the links can have reached the angles [rad] `since` seconds after the last sample.

        The links are assumed to stay within the speed limit FASTEST and the acceleration limit HARDEST.
        """
        time = min(max(since, self._period), LONGEST * self._period)
        step, off = FASTEST * time, HARDEST * time * time
        for new, old, rate in zip(angles, self._angles, self._rates, strict=True):
            if abs(new - old) > step + 4.0 * self._count:
                return False
            if abs(new - old - rate * time) > off + (2.0 + 2.0 * time / self._period) * self._count:
                return False
        return True

    def _follow(self, first: float, second: float) -> None:
        """Update position and velocity from the angles [rad] of the sample at `_time`."""
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


def connect(
    *,
    port: str,
    links: Sequence[float] = (0.07, 0.09),
    distance: float = 0.038,
    home: Sequence[float] = (168.0, 12.0),
    counts: float = 4880,
    torque_limit: float = 0.1,
    margin: float = 0.01,
    device: int = 5,
    timeout: float = 0.002,
    velocity_window: int = WINDOW,
) -> Haply2Diy:
    """Connect a 2DIY.

    The origin is midway between the motors; x points to the right, y from the motors to the handle. The defaults of
    `links` and `distance` are those of version 3 of the device; version 2 has links of 0.05 and 0.07 m, and a distance
    of 0.02 m.

    Args:
        port: Serial port, such as /dev/ttyACM0.
        links: Lengths of the links at the motors and of the links at the handle [m].
        distance: Distance between the motors [m].
        home: Directions of the links at the motors (encoders 1 and 2) in the home position, where the handle must be
            at `open` [deg].
        counts: Counts of an encoder per revolution.
        torque_limit: Torque limit of each motor [N m], at most 0.123, the limit in the firmware.
        margin: Smallest distance from the stretched and the folded posture [m]; for the definition see `FiveBar`.
        device: Number of the device on its serial line.
        timeout: Longest wait for an answer [s], less than the sampling period; after it the last sample is returned.
        velocity_window: Largest number of samples in the window of the velocity estimate.
    """
    inner, outer = pair("links", links, SMALLEST)
    first, second = pair("home", home, -LARGEST)
    linkage = FiveBar((inner, outer), number("distance", distance, 0.0), number("margin", margin, SMALLEST))
    try:
        linkage.handle(math.radians(first), math.radians(second))
    except DeviceError as error:
        raise InputError("home", (first, second), "angles at which the links meet", str(error)) from error
    return Haply2Diy(
        SerialPort(port_name(port)),
        linkage,
        device=whole("device", device, 0, 255),
        home=(first, second),
        counts=number("counts", counts, SMALLEST),
        torque_limit=number("torque_limit", torque_limit, SMALLEST, FIRMWARE_LIMIT),
        velocity_window=whole("velocity_window", velocity_window, 1),
        timeout=number("timeout", timeout, SMALLEST),
    )


def quench(*, port: str, device: int = 5, **_: object) -> None:
    """Remove the torques from a board whose program has crashed.

    Zero torques are sent until the board answers two successive frames. The board is not set up again, so the offsets
    of the encoders are kept. A board that waits for the rest of a truncated frame interprets the first zeros as that
    rest, which also sets zero torques.

    Args:
        port, device: Same as for `connect`; other settings are ignored.

    Raises:
        DeviceError: If another program has the port, or the board does not answer, so that its torques may persist.
    """
    line = SerialPort(port)
    line.open()
    try:
        if _quiet(line, device):
            return
        line.sleep(BLOCKED + 0.05)  # after this time a board discards a truncated frame
        if _quiet(line, device):
            return
    finally:
        line.close()
    raise DeviceError(f"the board at {port} does not answer: disconnect its power, because its motors may be on")


def _quiet(line: SerialPort, device: int) -> bool:
    """Send zero torques, at most TRIES times; return whether the board has answered two successive frames."""
    answers = 0
    for _ in range(TRIES):
        line.flush()
        line.send(torque_frame(device, 0.0, 0.0))
        answers = answers + 1 if angles_in(answer(line, line.now() + 0.02), device) is not None else 0
        if answers == 2:
            return True
    return False


# Frames ---------------------------------------------------------------------------------------------------------------


def setup_frame(device: int, home: tuple[float, float], counts: float) -> bytes:
    """Return the set-up frame for two motors and two encoders; `home` are the angles of encoders 1 and 2 [deg]."""
    first, second = home
    head = bytes([SETUP, device, PORTS, COUNTERCLOCKWISE, COUNTERCLOCKWISE, PORTS, COUNTERCLOCKWISE, COUNTERCLOCKWISE])
    return head + struct.pack("<BB4f", 0, 0, second, counts, first, counts)


def torque_frame(device: int, first: float, second: float) -> bytes:
    """Return the frame with the torques of motors 1 and 2 [N m]."""
    return struct.pack("<BB2f", TORQUE, device, second, first)


def angles_in(answer: bytes, device: int) -> tuple[float, float] | None:
    """Return the angles of encoders 1 and 2 [deg] in an answer; None if it is damaged or from another device."""
    if len(answer) != ANGLES.size:
        return None
    identity, second, first = ANGLES.unpack(answer)
    if identity != device or not (math.isfinite(first) and math.isfinite(second)):
        return None
    return first, second


def answer(port: SerialPort, deadline: float) -> bytes:
    """Return the bytes of an answer, or those that have arrived at a deadline on the port's clock [s]."""
    data = b""
    while len(data) < ANGLES.size and (part := port.receive(deadline)):
        data += part
    return data
