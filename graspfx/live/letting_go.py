"""How far a hand has to withdraw so that a finger of it is free."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from graspfx.build.live_session import LiveSession

FloatArray = NDArray[np.float64]

CLEARANCE = 0.003  # between a finger that was let go and its object [m]
SLACK = 1.5  # times the way that a finger is estimated to go, as its object comes after it


def withdrawal(session: LiveSession, row: FloatArray, finger: int) -> FloatArray | None:
    """Give the way (d,) by which a finger's target goes so that the finger is free [m]; None for one that is.

    It is along the object's force on the finger: |f|/k of the hand's spring, the depth |p - c| to which the finger is
    inside, and a clearance.

    Args:
        session: that runs.
        row: of now.
        finger: its number.
    """
    columns = session.servo.layout.columns

    def of_finger(name: str) -> FloatArray:
        column = columns[name]
        return np.asarray(row[column.where].reshape(column.shape)[finger])

    force = of_finger("finger_force")
    size = float(np.linalg.norm(force))
    if not size:
        return None
    wiring = next(each for each in session.servo.plants if finger in each.fingers)
    place = wiring.fingers.tolist().index(finger)
    stiffness = max(float(wiring.hand.stiffness[:, place, place].mean()), 1.0)
    depth = float(np.linalg.norm(of_finger("finger_position") - of_finger("contact_position")))
    way = size / stiffness + (depth if np.isfinite(depth) else 0.0)
    return -force / size * (SLACK * way + CLEARANCE)
