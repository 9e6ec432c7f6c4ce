"""The board of a two-link arm: encoder counts as input, motor torques as output."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from graspfx.devices.two_link.arm import Pair
from graspfx.protocols import InputError


class Board(Protocol):
    """Two encoders and two motors; counts and torques refer to the motors' shafts, before the gears.

    A board with lost hardware raises OSError or DeviceError; a run then stops with zero force.
    """

    def open(self, period: float) -> None:
        """Prepare for one `counts` and one `torque` every `period` seconds, and enable the motors at zero torque."""

    def counts(self) -> tuple[int, int]:
        """Return the counts of the two encoders relative to the arm's `zero`; they must not overflow."""
        ...

    def torque(self, first: float, second: float) -> None:
        """Set the torques of the two motors [N m], which are held until the next call."""

    def close(self) -> None:
        """Disable the motors and release the hardware."""


@runtime_checkable
class TimedBoard(Protocol):
    """A board that reports the time of its counts; for other boards, the time of the call is used."""

    @property
    def time(self) -> float:
        """Time of the last counts on any non-decreasing clock [s]; if it is unchanged, there are no new counts."""
        ...


@dataclass(frozen=True)
class Wiring:
    """Encoders, gears and motors between the two joints and the board.

    Args:
        counts: Counts of the encoder per revolution of its motor.
        gear: Revolutions of the motor per revolution of the joint; negative if the joint turns the other way.
        zero: Joint position at zero counts [rad].
        torque_limit: Torque limit of the motor [N m].
    """

    counts: Pair
    gear: Pair
    zero: Pair
    torque_limit: Pair

    def __post_init__(self) -> None:
        if 0.0 in self.gear:
            raise InputError("gear", self.gear, "ratios other than zero")

    @property
    def step(self) -> Pair:
        """Angle of each joint per count [rad]."""
        return math.tau / (self.counts[0] * self.gear[0]), math.tau / (self.counts[1] * self.gear[1])
