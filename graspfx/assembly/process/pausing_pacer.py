"""Pace of simulations that may pause: the time of a pause is not late, and no burst of ticks follows it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from graspfx.loop.realtime.pacing import Clock, Pacer

LOOK = 0.002  # between two looks whether a pause is over [s]


class Pause(Protocol):
    """Tells whether ticks are to wait."""

    @property
    def is_paused(self) -> bool:
        """Whether the coming tick is to wait."""
        ...


class PausingPacer(Pacer):
    """A pacer whose ticks wait as long as orders say so; after a pause the grid of deadlines begins anew.

    Args:
        period: T [s].
        clock: to wait on.

    Attributes:
        orders: that say so; None for none.
    """

    def __init__(self, period: float, clock: Clock | None = None) -> None:
        super().__init__(period, clock)
        self.orders: Pause | None = None

    def wait(self, stop: Callable[[], bool] | None = None) -> int:
        skipped = super().wait(stop)
        orders = self.orders
        if orders is None or not orders.is_paused:
            return skipped
        while not (stop is not None and stop()) and orders.is_paused:
            self.clock.sleep(LOOK)
        self.deadline = self.clock.now()
        self.late, self.left_out, self.row = 0.0, 0, 0
        self.wall = self.deadline - self.start
        return 0
