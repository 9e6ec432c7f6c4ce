"""Time in a run: a count of ticks, never a reading of the wall."""

from __future__ import annotations


class SimulatedClock:
    """time = ticks x period, so that two runs are bit-identical; it never waits."""

    def __init__(self, period: float) -> None:
        self.period = period
        self.ticks = 0

    @property
    def time(self) -> float:
        """[s]"""
        return self.ticks * self.period

    def advance(self) -> None:
        self.ticks += 1
