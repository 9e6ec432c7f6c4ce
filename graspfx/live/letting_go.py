"""Release of an object: a hand withdraws its fingers smoothly along their forces until they are free."""

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

CLEARANCE = 0.003  # distance of a released finger from the object [m]
GROWTH = 2.0  # factor of the clearance in each further step
SLACK = 1.5  # factor of the estimated distance, because the object follows the finger
LAGS = 6.0  # time between steps, in lags of the follower
OFTEN = 1.0  # time after a step during which every row is checked [s]
SELDOM = 0.05  # interval between later checks [s]
SOFTEST = 1.0  # smallest hand stiffness used in the estimate [N/m]


class Watched(Protocol):
    """Run whose rows are watched."""

    run_number: int

    @property
    def state(self) -> str:
        """State of the run: "running", "paused" or "ended"."""
        ...

    @property
    def ticks(self) -> int:
        """Number of ticks with available rows."""
        ...

    @property
    def tick(self) -> int:
        """Tick of the newest row."""
        ...

    @property
    def period(self) -> float:
        """Sampling period T [s]."""
        ...

    def row(self) -> FloatArray | None:
        """Copy the newest row."""
        ...

    def await_row(self, after: int, seconds: float) -> bool:
        """Wait for a newer row."""
        ...


class Release:
    """Release by a guide; a thread supervises it until the guide is moved again.

    The first step is immediate. If a finger still touches after six time constants, because the object has followed it,
    another step follows. Time is counted in ticks, so that pauses have no effect.

    Args:
        run: Run whose rows are watched.
        session: Session of the run.
        guide: Guide that releases the object.
        lag: Time constant of the guide's follower [s].
    """

    def __init__(self, run: Watched, session: LiveSession, guide: Guide, lag: float) -> None:
        self._run, self._session, self._guide, self._lag = run, session, guide, lag
        self._lock, self._is_over, self._clearance = Lock(), False, CLEARANCE

    def begin(self) -> None:
        """Withdraw the fingers, and start supervision."""
        if self._withdraw():
            Thread(target=self._watch, name="graspfx-release", daemon=True).start()

    def end(self) -> None:
        """Stop withdrawing."""
        with self._lock:
            self._is_over = True

    @property
    def _places(self) -> Sequence[int]:
        return range(len(self._guide.all_fingers)) if self._guide.place is None else [self._guide.place]

    def _withdraw(self) -> bool:
        """Move touching fingers away from their objects; return whether there are any."""
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
                self._clearance *= GROWTH  # larger, in case the object follows
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
    """Compute the displacement (d,) of a finger's target that frees the finger [m]; None for a free finger.

    The displacement is parallel to the object's force on the finger. Its length is 1.5 times the sum of the deflection
    |f|/k of the hand's spring and the penetration depth |p - c|, plus a clearance.

    Args:
        session: Running session.
        row: Present row.
        finger: Number of the finger.
        clearance: Clearance [m].
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
