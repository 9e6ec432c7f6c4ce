"""Goals on their way to where a screen is touched: at once while a finger drags, at a bounded speed where it lands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.screen.approach import approach

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo

SOFTEST = 1.0  # stiffness of a hand that is counted with [N/m]


class FingerReach:
    """Places that a finger reaches: those that its device tells (`RangedDevice`), within the box of its workspace.

    A finger whose goal stops overshoots it, as a mass m on a spring k does that goes at v, by no more than v sqrt(m/k):
    that room is left.

    Args:
        servo: that moves it.
        finger: its number.
        speed: of its goal, the largest [m/s].
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
        """Give the place (d,) nearest to another one that the finger reaches [m]."""
        if self._box is not None:
            place = np.clip(place, *self._box)
        if hasattr(self._device, "nearest"):
            place = np.asarray(self._device.nearest(self._finger, place, self.room))
        return place


FloatArray = NDArray[np.float64]

LONGEST = 0.02  # that counts as passed since the last step: a goal that rested does not leap [s]


class GoalWalk:
    """The goal of one finger.

    It goes to where the finger is touched, no faster than `speed`: a touch that lands far from the fingertip brings it
    there over a time, so that neither the hand's damper nor a collision on the way has a force that a person would not
    have. Slower fingers are followed without delay.

    Args:
        speed: the largest [m/s].
    """

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self._goal: FloatArray | None = None
        self._aim = np.zeros(0)
        self._time = 0.0

    @property
    def is_led(self) -> bool:
        """Whether it has somewhere to go."""
        return self._goal is not None

    def aim(self, place: FloatArray, start: FloatArray, now: float) -> FloatArray:
        """Head for a place (d,) [m]; give the goal (d,) of now.

        Args:
            place: that is touched.
            start: where the fingertip is; the goal sets out from there.
            now: time [s].
        """
        if self._goal is None:
            self._goal, self._time = start.copy(), now - LONGEST
        self._aim = place
        return self._advanced(now)

    def step(self, now: float) -> FloatArray | None:
        """Give the goal of now if it has moved; None if it is where it should be."""
        if self._goal is None or np.array_equal(self._goal, self._aim):
            self._time = now
            return None
        return self._advanced(now)

    def end(self) -> None:
        """Go nowhere any more."""
        self._goal = None

    def _advanced(self, now: float) -> FloatArray:
        assert self._goal is not None
        approach(self._goal, self._aim, self.speed * min(max(now - self._time, 0.0), LONGEST))
        self._time = now
        return self._goal.copy()
