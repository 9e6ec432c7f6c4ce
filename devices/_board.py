"""The board of a two-link arm: encoder counts in, motor torques out; and one whose arm is simulated."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from graspfx.devices._arm import Mechanics, Pair
from graspfx.devices._dynamics import ArmPlant
from graspfx.errors import InputError


class Board(Protocol):
    """Two encoders and two motors; counts and torques are those of the motors' shafts, before the gears.

    A board that has lost its hardware raises OSError or DeviceError; a run then stops with zero force.
    """

    def open(self, period: float) -> None:
        """Make ready for one `counts` and one `torque` every `period` seconds, and enable the motors at zero torque."""

    def counts(self) -> tuple[int, int]:
        """What the two encoders have counted since they stood at the arm's `zero`; never rolled over."""
        ...

    def torque(self, first: float, second: float) -> None:
        """Torques of the two motors [N m], held until the next call."""

    def close(self) -> None:
        """Disable the motors and let go of the hardware."""


@dataclass(frozen=True)
class Wiring:
    """What stands between the joints and the board, for each of the two.

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
        """What a joint turns by for one count [rad]."""
        return math.tau / (self.counts[0] * self.gear[0]), math.tau / (self.counts[1] * self.gear[1])


class SimulatedBoard:
    """The encoders and motors of an arm that an ArmPlant moves: counts rounded, torques `delay` samples late."""

    def __init__(self, mechanics: Mechanics, wiring: Wiring, delay: int = 0) -> None:
        self.mechanics = mechanics
        self._wiring, self._step = wiring, wiring.step
        self._late: deque[Pair] = deque([(0.0, 0.0)] * delay)
        self.effort = np.zeros((1, 2))  # torques at the joints, held over the coming sample [N m]
        self.wire(ArmPlant([mechanics]), 0)  # at rest, until a plant that moves takes over

    def wire(self, plant: ArmPlant, i: int) -> None:
        """Be the board of the plant's arm i from now on."""
        self.plant, self._angles = plant, plant.angles(i)

    def open(self, period: float) -> None:
        self.halt()

    def counts(self) -> tuple[int, int]:
        q1, q2 = self.mechanics.arm.turned(self._angles[0], self._angles[1])
        zero, step = self._wiring.zero, self._step
        return math.floor((q1 - zero[0]) / step[0] + 0.5), math.floor((q2 - zero[1]) / step[1] + 0.5)

    def torque(self, first: float, second: float) -> None:
        self._late.append((first, second))
        first, second = self._late.popleft()
        self.effort[0, 0] = first * self._wiring.gear[0]
        self.effort[0, 1] = second * self._wiring.gear[1]

    def halt(self) -> None:
        """No torque now, and none on its way."""
        for _ in range(len(self._late) + 1):
            self.torque(0.0, 0.0)

    def close(self) -> None:
        self.halt()
