"""Ticks on the wall's clock, by absolute deadlines."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Protocol

from graspfx.loop.realtime.lateness import Lateness

SLICE = 0.005  # [s]: a sleep is cut into pieces, between which a run may be stopped


class Clock(Protocol):
    """A clock that can be waited on."""

    def now(self) -> float:
        """Tell the time, which never runs back [s]."""
        ...

    def sleep(self, duration: float) -> None:
        """Wait for about so long [s]."""
        ...


class WallClock:
    """The clock of the machine."""

    def now(self) -> float:
        return time.perf_counter()

    def sleep(self, duration: float) -> None:
        time.sleep(duration)


class Pacer:
    """Waits for the deadline of each tick: t_0 + k T, whatever a tick took.

    A tick that comes too late leaves out the whole periods that have passed: the next deadlines stay on the grid of the
    first, so that no lateness adds up. `skipped` counts them; `row` counts those in a row, up to the last tick in time.

    Args:
        period: T [s].
        clock: to wait on.

    Attributes:
        start: of the first tick [s].
        wall: time of the last tick since that of the first [s].
        late: of it, after its deadline [s].
        left_out: periods before it that were left out.
        lateness: of all ticks but the first, with the periods that they left out.
    """

    def __init__(self, period: float, clock: Clock | None = None) -> None:
        self.period, self.clock = period, clock or WallClock()
        self.deadline: float | None = None  # of the last tick [s]
        self.skipped = self.row = 0
        self.wall = self.late = 0.0
        self.left_out = 0
        self.start = 0.0
        self.latest = 0.0  # the most that a tick began after its deadline [s]
        self.lateness = Lateness()

    @property
    def outcome(self) -> dict[str, Any]:
        """Entries of the run's `Outcome`: periods left out, and how late ticks began."""
        return {"skipped": self.skipped, "late": self.lateness.figures}

    def wait(self, stop: Callable[[], bool] | None = None) -> int:
        """Wait for the next tick's deadline; return how many periods it leaves out.

        The first tick is at once, and its time is the grid's.

        Args:
            stop: asked every few milliseconds; where it is True the wait is over.
        """
        clock = self.clock
        if self.deadline is None:
            self.deadline = self.start = clock.now()
            return 0
        self.deadline += self.period
        is_early, late = self._sleep(stop)
        skipped = math.floor(late / self.period) if late >= self.period else 0
        self.deadline += skipped * self.period
        self.skipped += skipped
        self.row = 0 if is_early and not skipped else self.row + skipped
        self.late, self.left_out = late - skipped * self.period, skipped
        self.wall = self.deadline + self.late - self.start
        self.latest = max(self.latest, self.late)
        self.lateness.add(late)
        return skipped

    def finish(self) -> None:
        """Wait for what is left to the deadline, where `stop` ended the wait."""
        assert self.deadline is not None
        _, self.late = self._sleep(None)
        self.wall = self.deadline + self.late - self.start

    def _sleep(self, stop: Callable[[], bool] | None) -> tuple[bool, float]:
        """Wait for the deadline; tell whether there was a wait, and how late it is [s]."""
        assert self.deadline is not None
        clock, is_early = self.clock, False
        while (left := self.deadline - clock.now()) > 0.0 and not (stop is not None and stop()):
            is_early = True
            clock.sleep(min(max(self.deadline - clock.now(), 0.0), SLICE))  # as `stop` took its time
        return is_early, -left  # a sleep may have been as long as the machine was away


def late_text(row: int, period: float, most: int) -> str:
    """Say that ticks came too late for hardware.

    Args:
        row: periods in a row that were left out.
        period: T [s].
        most: that may be.
    """
    return (
        f"{row} periods of {period:g} s in a row were left out, {most} at most: this machine was too late for the "
        "hardware; all forces are zero"
    )
