"""Entry of a finger that is inside an object when a run begins: its depth is let in little by little."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Entry:
    """Offset of a device's fingers that fades out: p' = p - (1 - s) o, v' = v + s' o, s = u^2 (3 - 2 u), u = t / T_s.

    o leads from where a finger would just touch to where it is, so that the coupling meets it at the surface: the
    force of the first tick is zero, and from T_s on all of the depth counts. v' is the rate of p', as damping has it.

    Args:
        offset: o of each finger, (k, d) [m].
        period: of a tick [s].
        duration: T_s [s].

    Attributes:
        ticks: so far.
    """

    def __init__(self, offset: FloatArray, period: float, duration: float) -> None:
        self.offset, self.duration, self.ticks = offset, duration, 0
        self._period = period

    def apply(self, position: FloatArray, velocity: FloatArray) -> bool:
        """Set a tick's positions and velocities off, (k, d); return whether there is more to come."""
        time = self.ticks * self._period
        if time >= self.duration:
            return False
        u = time / self.duration
        position -= (1.0 - u * u * (3.0 - 2.0 * u)) * self.offset
        velocity += 6.0 * u * (1.0 - u) / self.duration * self.offset
        self.ticks += 1
        return True
