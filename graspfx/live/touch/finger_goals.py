"""Goals of fingers on a touch screen: they follow touches at a bounded speed and stay within the devices' reach."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.screen.approach import approach

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo

SOFTEST = 1.0  # smallest hand stiffness used in the estimate [N/m]


class FingerReach:
    """Reach of a finger: positions allowed by its device (`RangedDevice`) and by the box of its workspace.

    When a goal that moves at speed v stops, a finger of mass m on a spring k overshoots it by at most v sqrt(m/k). The
    reach leaves room for this.

    Args:
        servo: Servo that moves the finger.
        finger: Number of the finger.
        speed: Highest speed of its goal [m/s].
    """

    def __init__(self, servo: Servo, finger: int, speed: float) -> None:
        station = next(each for each in servo.stations if finger in each.fingers)
        self._device: Any = station.device
        self._finger = list(station.fingers).index(finger)
        features = station.device.features
        wiring = next((each for each in servo.plants if finger in each.fingers), None)
        k = SOFTEST
        if wiring is not None:
            place = list(wiring.fingers).index(finger)
            k = max(float(wiring.hand.stiffness[:, place, place].min()), SOFTEST)
        self.room = speed * math.sqrt((features.mass or 0.0) / k)
        self._box = None
        if features.workspace is not None:
            lower, upper = features.workspace
            room = np.minimum(self.room, 0.5 * (upper - lower))
            self._box = lower + room, upper - room

    def nearest(self, place: FloatArray) -> FloatArray:
        """Return the position within reach that is nearest to `place` (d,) [m]."""
        if self._box is not None:
            place = np.clip(place, *self._box)
        if hasattr(self._device, "nearest"):
            place = np.asarray(self._device.nearest(self._finger, place, self.room))
        return place


FloatArray = NDArray[np.float64]

LONGEST = 0.02  # longest time step [s], so that a goal does not jump after a rest


class GoalWalk:
    """Goal of one finger.

    The goal moves to the touched position, no faster than `speed`. A touch far from the fingertip therefore moves the
    goal there gradually, and forces of the hand's damper and of collisions on the way stay realistic. Slower motions
    are followed without delay.

    Args:
        speed: Highest speed [m/s].
    """

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self._goal: FloatArray | None = None
        self._aim = np.zeros(0)
        self._time = 0.0

    @property
    def is_led(self) -> bool:
        """Whether the goal has a target."""
        return self._goal is not None

    def aim(self, place: FloatArray, start: FloatArray, now: float) -> FloatArray:
        """Set the target position (d,) [m]; return the present goal (d,).

        Args:
            place: Touched position.
            start: Position of the fingertip, where the goal starts.
            now: Time [s].
        """
        if self._goal is None:
            self._goal, self._time = start.copy(), now - LONGEST
        self._aim = place
        return self._advanced(now)

    def step(self, now: float) -> FloatArray | None:
        """Return the present goal if it has moved; None if it is at its target or has none."""
        if self._goal is None or np.array_equal(self._goal, self._aim):
            self._time = now
            return None
        return self._advanced(now)

    def end(self) -> None:
        """Remove the target."""
        self._goal = None

    def _advanced(self, now: float) -> FloatArray:
        assert self._goal is not None
        approach(self._goal, self._aim, self.speed * min(max(now - self._time, 0.0), LONGEST))
        self._time = now
        return self._goal.copy()
