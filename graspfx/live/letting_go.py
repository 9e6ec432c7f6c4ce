"""Letting go: a hand withdraws along the forces of its fingers until they are free, smoothly."""

from __future__ import annotations

import time
from collections.abc import Sequence
from threading import Lock, Thread
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.process.orders import FARTHEST
from graspfx.live.guides import Guide

if TYPE_CHECKING:
    from graspfx.assembly.real_time_session import LiveSession

FloatArray = NDArray[np.float64]

CLEARANCE = 0.003  # between a finger that was let go and its object [m],
GROWTH = 2.0  # and times that with each step after the first
SLACK = 1.5  # times the way that a finger is estimated to go, as its object comes after it
LAGS = 6.0  # of the follower, after which a finger that is not free yet goes on
OFTEN = 1.0  # after a step in which each row is looked at [s],
SELDOM = 0.05  # and between two looks from then on [s]
SOFTEST = 1.0  # stiffness of a hand that is counted with [N/m]


class Watched(Protocol):
    """A run whose rows are looked at."""

    run_number: int

    @property
    def state(self) -> str:
        """Whether it runs, waits or has ended."""
        ...

    @property
    def ticks(self) -> int:
        """Count of ticks whose rows are there."""
        ...

    @property
    def tick(self) -> int:
        """Tick of the newest row."""
        ...

    @property
    def period(self) -> float:
        """T [s]."""
        ...

    def row(self) -> FloatArray | None:
        """Copy the newest row."""
        ...

    def await_row(self, after: int, seconds: float) -> bool:
        """Wait for a row that is newer."""
        ...


class Release:
    """A guide that lets go; a thread of its own looks after it until it is guided again.

    The first step is done at once. Where a finger still touches after some lags, as its object has come along, the next
    one follows. Time is counted in ticks: a pause is none.

    Args:
        run: whose rows are looked at.
        session: of the run.
        guide: that lets go.
        lag: of its follower [s].
    """

    def __init__(self, run: Watched, session: LiveSession, guide: Guide, lag: float) -> None:
        self._run, self._session, self._guide, self._lag = run, session, guide, lag
        self._lock, self._is_over, self._clearance = Lock(), False, CLEARANCE

    def begin(self) -> None:
        """Withdraw, and look after it from now on."""
        if self._withdraw():
            Thread(target=self._watch, name="graspfx-release", daemon=True).start()

    def end(self) -> None:
        """Withdraw no farther, from now on."""
        with self._lock:
            self._is_over = True

    @property
    def _places(self) -> Sequence[int]:
        return range(len(self._guide.all_fingers)) if self._guide.place is None else [self._guide.place]

    def _withdraw(self) -> bool:
        """Lead fingers that touch away from their objects; return whether there is one."""
        row, goals, guide = self._run.row(), self._session.goals, self._guide
        with self._lock:
            if row is None or self._is_over:
                return False
            offsets, _ = goals.values(guide.hand)
            has_touched = False
            for place in self._places:
                step = withdrawal(self._session, row, guide.all_fingers[place], self._clearance)
                if step is not None:
                    has_touched = True
                    goals.send(guide.hand, np.clip(offsets[place] + step, -FARTHEST, FARTHEST), finger=place)
            if has_touched:
                self._clearance *= GROWTH  # for an object that comes after it
            return has_touched

    def _watch(self) -> None:
        run, number = self._run, self._run.run_number
        wait, often = round(LAGS * self._lag / run.period), round(OFTEN / run.period)
        step = run.ticks
        while not self._is_over and run.state != "ended" and run.run_number == number:
            if run.ticks - step < often:
                run.await_row(run.tick, SELDOM)
            else:
                time.sleep(SELDOM)
            if run.ticks - step > wait and self._withdraw():
                step = run.ticks


def withdrawal(session: LiveSession, row: FloatArray, finger: int, clearance: float) -> FloatArray | None:
    """Give the way (d,) by which a finger's target goes so that the finger is free [m]; None for one that is.

    It is along the object's force on the finger: |f|/k of the hand's spring, the depth |p - c| to which the finger is
    inside, and a clearance.

    Args:
        session: that runs.
        row: of now.
        finger: its number.
        clearance: [m].
    """
    columns = session.servo.layout.columns

    def of_finger(name: str) -> FloatArray:
        column = columns[name]
        return np.asarray(row[column.where].reshape(column.shape)[finger])

    force = of_finger("finger_force")
    size = float(np.linalg.norm(force))
    if not (size > 0.0 and np.isfinite(size)):
        return None
    wiring = next(each for each in session.servo.plants if finger in each.fingers)
    place = wiring.fingers.tolist().index(finger)
    stiffness = max(float(wiring.hand.stiffness[:, place, place].mean()), SOFTEST)
    depth = float(np.linalg.norm(of_finger("finger_position") - of_finger("contact_position")))
    way = size / stiffness + (depth if np.isfinite(depth) else 0.0)
    return -force / size * (SLACK * way + clearance)
