"""Reach of fingers that a touch screen leads: their goals stay where the devices can go, with room to overshoot."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo

FloatArray = NDArray[np.float64]

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
