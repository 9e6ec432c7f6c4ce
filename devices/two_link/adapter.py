"""A two-link arm as a device: the part common to all arms, and a real arm with its board."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from graspfx.devices.two_link import arm_sample as sample
from graspfx.devices.two_link.arm import Arm, Both, Mechanics, Point
from graspfx.devices.two_link.arm_sample import ArmState
from graspfx.devices.two_link.board import Board, TimedBoard, Wiring
from graspfx.protocols import (
    WINDOW,
    DeviceError,
    Features,
    InputError,
    VelocityEstimator,
    estimate_size,
    size_for,
    start_of,
    zeros,
)

FloatArray = NDArray[np.float64]


class TwoLinkArm(ABC):
    """Convert counts to the finger's position, and forces to the motors' torques.

        q = zero + 2 pi counts/(counts per revolution x gear),   p = p(q),   v = J(q) q',   tau = J'(q) f / gear

    q' is estimated from the counts with a noise bound of half a count. Torques beyond `torque_limit` are scaled by a
    common factor, so that the force keeps its direction. A finger outside the arm's reach, or an elbow on the wrong
    side, raises DeviceError at `read`.
    """

    declaration = ArmState

    def __init__(
        self, arm: Arm, wiring: Wiring, mechanics: Mechanics | None, velocity_window: int, delay: int | None
    ) -> None:
        self.arm, self.wiring, self.mechanics = arm, wiring, mechanics
        self._window, self._delay = velocity_window, delay
        each, late = estimate_size(velocity_window), delay or 0
        self.state: FloatArray = zeros(size_for(ArmState, delay=late, estimate_size=each))
        self._entries: Any = self.state.data  # plain floats, because access to items of an array takes twice as long
        block = self._block = ArmState(self._entries)
        block.base, block.lengths = Point(*arm.base), Both(*arm.links)
        block.zero, block.step, block.gear = Both(*wiring.zero), Both(*wiring.step), Both(*wiring.gear)
        block.torque_limit = Both(*wiring.torque_limit)
        (block.low, block.high), block.bend = arm.reach, arm.bend
        block.elbow, block.delay, block.estimate_size = arm.drive == "elbow", late, each
        sample.place(block, *arm.angles(arm.base[0], arm.base[1] + math.hypot(*arm.links)))
        sample.limit_force(block)
        pairs = [start_of(ArmState, name) for name in ("position", "velocity", "command", "effort")]
        arrays = [self.state[start : start + 2].reshape(1, 2) for start in pairs]
        self._position, self._velocity, self._command, self._effort = arrays
        self._estimator: VelocityEstimator | None = None  # only while the device is open

    @property
    def features(self) -> Features:
        """Features; mass, damping, resolution and peak force refer to the elbow at a right angle.

        In this posture, mass and damping are the geometric means of their principal values. The peak force is the force
        that the motors reach in every direction. The resolution is the largest step of the tip per count. The workspace
        is the box around the arm's reach.
        """
        a1, a2 = self.arm.angles(self.arm.base[0], self.arm.base[1] + math.hypot(*self.arm.links))
        by_joint = self.arm.jacobian(a1, a2)
        if self.arm.drive == "elbow":
            by_joint[:, 0] += by_joint[:, 1]
        lever = np.hypot(*by_joint)  # displacement of the tip per radian of each joint [m]
        base, far = np.array(self.arm.base), self.arm.reach[1]
        m = self.mechanics
        return Features(
            fingers=1,
            dimensions=2,
            workspace=(base - far, base + far),
            peak_force=float((np.array(self.wiring.torque_limit) * np.abs(self.wiring.gear) / lever).min()),
            mass=None if m is None else math.sqrt(np.linalg.det(m.effective_mass(a1, a2))),
            friction=None if m is None else math.sqrt(np.linalg.det(m.effective_friction(a1, a2))),
            resolution=float((np.abs(self.wiring.step) * lever).max()),
            delay=self._delay,
        )

    def nearest(self, finger: int, place: FloatArray, room: float) -> FloatArray:
        """Return the nearest position (2,) whose distance from the base is within the arm's reach [m].

        Args:
            finger: Index of the finger, 0.
            place: Position (2,) [m].
            room: Margin from the smallest and the largest reach, at most half of their difference [m].
        """
        base, (low, high) = np.array(self.arm.base), self.arm.reach
        room = min(room, 0.5 * (high - low))
        away = np.asarray(place, dtype=float) - base
        r = float(np.hypot(*away))
        if not r:
            away, r = np.array([0.0, 1.0]), 1.0
        size = min(max(r, low + room), high - room)
        nearest: FloatArray = base + away * (size / r)
        return nearest

    @property
    def largest_force(self) -> FloatArray:
        """Largest force that the motors reach in every direction at the last reading (1,) [N].

        With both motors at the base, this force equals the peak force everywhere.
        """
        start = start_of(ArmState, "largest")
        return self.state[start : start + 1]

    def effective_mass(self, position: Sequence[float]) -> FloatArray:
        """Return Lambda = (J M^-1 J')^-1 (2, 2) [kg] with the finger at a position [m]; the mechanics must be known."""
        x, y = position
        mass: FloatArray = self._require_mechanics().effective_mass(*self.arm.angles(x, y))
        return mass

    def effective_friction(self, position: Sequence[float]) -> FloatArray:
        """Return J^-T D J^-1 (2, 2) [N s/m] with the finger at a position [m]; the mechanics must be known."""
        x, y = position
        damping: FloatArray = self._require_mechanics().effective_friction(*self.arm.angles(x, y))
        return damping

    def open(self, period: float) -> None:
        memory = self.state[self._block.estimates.offset :]
        self._estimator = VelocityEstimator(period, (2,), 0.5, self._window, memory)

    @abstractmethod
    def close(self) -> None:
        """Set zero torque and release the hardware, without an error if the hardware is lost or already closed."""

    def fault_text(self, code: int) -> str:
        """Explain a code of a kernel with the values in the block."""
        counts, links, force = self._block.counts, self._block.links, self._block.command
        if code == sample.NO_COUNTS:
            return f"the arm's board returned {counts.first:.17g}, {counts.second:.17g}: check encoders and cables"
        if code == sample.OUT_OF_REACH:
            return str(self.arm.reach_fault(links.x1 + links.x2, links.y1 + links.y2))
        if code == sample.OTHER_ELBOW:
            return str(self.arm.elbow_fault)
        return (
            f"a force of ({force.x}, {force.y}) N is not finite and cannot be displayed: "
            "the arm's motors are at zero torque"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _take(self, forces: FloatArray) -> None:
        self._opened()
        if np.shape(forces) != (1, 2):
            raise InputError("forces", forces, "an array of shape (1, 2): one finger in the plane")
        self._command[...] = forces

    def _opened(self) -> VelocityEstimator:
        if self._estimator is None:
            raise DeviceError("the arm is not open: call open(period) first")
        return self._estimator

    def _require_mechanics(self) -> Mechanics:
        if self.mechanics is None:
            raise InputError(
                "mechanics", None, "a device with known masses and damping", "give all five settings to connect"
            )
        return self.mechanics


class TwoLink(TwoLinkArm):
    """A real arm, whose board reads the encoders and drives the motors."""

    def __init__(
        self,
        arm: Arm,
        wiring: Wiring,
        board: Board,
        *,
        mechanics: Mechanics | None = None,
        velocity_window: int = WINDOW,
    ) -> None:
        super().__init__(arm, wiring, mechanics, velocity_window, None)
        self.board = board
        self._raw: NDArray[np.int64] = np.zeros(2, dtype=np.int64)

    def open(self, period: float) -> None:
        super().open(period)
        try:
            self.board.open(period)
        except OSError as error:
            self._estimator = None
            raise DeviceError(f"the arm's board cannot be opened: {error}") from error
        self._began, self._time = time.perf_counter(), -math.inf

    @property
    def raw(self) -> NDArray[np.int64]:
        """Counts of the two encoders (2,)."""
        return self._raw

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Read the board; if the time of the counts has not changed, return the last sample again."""
        estimator = self._opened()
        try:
            counts = self.board.counts()
        except OSError as error:
            raise DeviceError(f"the arm's board returns no counts: {error}") from error
        own = self.board.time if isinstance(self.board, TimedBoard) else None
        now = time.perf_counter() - self._began if own is None else own
        if now != self._time:
            self._take_counts(estimator, counts, now)
        return self._position, self._velocity, now

    def _take_counts(self, estimator: VelocityEstimator, counts: tuple[int, int], now: float) -> None:
        if not (math.isfinite(counts[0]) and math.isfinite(counts[1])):
            self._block.counts = Both(*counts)
            raise DeviceError(self.fault_text(sample.NO_COUNTS))
        rates = estimator.update(counts, now)
        self._time, self._block.counts = now, Both(*counts)
        self._raw[...] = counts
        code = sample.turn(self._block, float(rates[0]), float(rates[1]))
        if code:
            raise DeviceError(self.fault_text(code))

    def write(self, forces: FloatArray) -> None:
        self._take(forces)
        code = sample.drive(self._block)
        if code:
            self.stop()
            raise DeviceError(self.fault_text(code))
        self._send(self._block.torque[0], self._block.torque[1])

    def stop(self) -> None:
        if self._estimator is not None:
            self._send(0.0, 0.0)

    def close(self) -> None:
        if self._estimator is None:
            return
        self._estimator = None
        with suppress(OSError, DeviceError):  # the hardware may be gone
            self.board.torque(0.0, 0.0)
        with suppress(OSError, DeviceError):
            self.board.close()

    def _send(self, first: float, second: float) -> None:
        try:
            self.board.torque(first, second)
        except OSError as error:
            raise DeviceError(f"the arm's board accepts no torques: {error}") from error
