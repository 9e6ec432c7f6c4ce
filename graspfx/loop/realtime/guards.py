"""Guards of a run with hardware: how fast, how late and how old a reading may be before it is a fault."""

from __future__ import annotations

import math
from dataclasses import dataclass

from graspfx.errors import InputError

MOST_STILL = 1.0  # for a loop without a tick, and
STILL_PERIODS = 20  # periods at least [s]
HANGS = 0.1  # for a call of a device to return, and
WATCHDOGS = 3  # times what the scene's watchdog lets a tick be late


@dataclass(frozen=True)
class Guards:
    """Figures beyond which a run with hardware ends in a fault.

    Attributes:
        speed: the fastest motion of a fingertip along an axis that a reading may tell [m/s]; a hand reaches 5.
        hold: readings in a row without a new sample.
        late: periods in a row that may be skipped.
        soft_start: over which what stands in the way at the start is let in [s].
    """

    speed: float = 10.0
    hold: int = 3
    late: int = 5
    soft_start: float = 0.5

    def __post_init__(self) -> None:
        if not (math.isfinite(self.speed) and self.speed > 0.0):
            raise InputError("speed", self.speed, "a finite speed above zero [m/s]")
        if self.hold < 0 or self.late < 0:
            raise InputError("hold", (self.hold, self.late), "counts of zero or more")
        if not (math.isfinite(self.soft_start) and self.soft_start >= 0.0):
            raise InputError("soft_start", self.soft_start, "a finite time of zero or more [s]")


def patience(period: float, watchdog: float) -> float:
    """Give the time in which a call of a device has to return, while forces are there [s].

    It is some times what a tick may be late, and no more than a loop without a tick is given.

    Args:
        period: T [s].
        watchdog: time by which a tick may be late [s].
    """
    return min(max(MOST_STILL, STILL_PERIODS * period), max(HANGS, WATCHDOGS * watchdog))


GUARDS = Guards()
