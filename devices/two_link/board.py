"""The board of a two-link arm: encoder counts in, motor torques out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from graspfx.devices.two_link.arm import Pair
from graspfx.protocols import InputError


class Board(Protocol):
    """Two encoders and two motors; counts and torques are those of the motors' shafts, before the gears.

    A board that has lost its hardware raises OSError or DeviceError; a run then stops with zero force.
    """

    def open(self, period: float) -> None:
        """Make ready for one `counts` and one `torque` every `period` seconds, and enable the motors at zero torque."""

    def counts(self) -> tuple[int, int]:
        """Read the counts of the two encoders since they stood at the arm's `zero`; they never roll over."""
        ...

    def torque(self, first: float, second: float) -> None:
        """Set the torques of the two motors [N m], which hold them until the next call."""

    def close(self) -> None:
        """Disable the motors and let go of the hardware."""


@runtime_checkable
class TimedBoard(Protocol):
    """A board that knows when its counts were taken; those of any other are as old as the call."""

    @property
    def time(self) -> float:
        """Time of the last counts, on any clock that goes forward [s]; that of those before says that none are new."""
        ...


@dataclass(frozen=True)
class Wiring:
    """Encoders, gears and motors between the two joints and the board.

    Args:
        counts: of the encoder for a revolution of its motor.
        gear: revolutions of the motor for one of the joint; negative if it turns the other way.
        zero: where the joint is when the count is zero [rad].
        torque_limit: of the motor [N m].
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
        """Angle by which each joint turns for one count [rad]."""
        return math.tau / (self.counts[0] * self.gear[0]), math.tau / (self.counts[1] * self.gear[1])
