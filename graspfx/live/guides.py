"""Guides of a live run: handles that move a hand or a finger, and goals that move with limited speed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.hands import holdings
from graspfx.assembly.live import value_of
from graspfx.screen.touch_screen import approach

if TYPE_CHECKING:
    from graspfx.assembly.real_time_session import LiveSession
    from graspfx.loop.servo import Servo
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

SOFTEST = 1.0  # smallest hand stiffness used in estimates [N/m]
LONGEST = 0.02  # longest time step of a goal [s], so that it does not jump after a rest
SLACK = 1.5  # factor of the estimated distance, because the object follows the finger


@dataclass(frozen=True, eq=False)
class Guide:
    """Handle of a hand or of a finger.

    Attributes:
        name: Name of the hand or finger.
        fingers: Numbers of the fingers that the handle moves.
        position: Mean of the initial positions of these fingers (d,) [m].
        hand: Number of the hand among the guided hands.
        place: Index of the moved finger in the hand; None for all fingers.
        all_fingers: Numbers of all fingers of the hand.
        lag: Time constant with which the hand follows the guide [s].
    """

    name: str
    fingers: list[int]
    position: FloatArray
    hand: int
    place: int | None
    all_fingers: list[int]
    lag: float


def guided_scene(scene: Scene) -> Scene:
    """Return the scene with a guide added to each hand without a guide, except for hands from plug-ins."""
    changes: dict[str, Any] = {
        ".".join(map(str, (*each.at, "guide"))): {}
        for each in holdings(scene)
        if each.table is not None and each.table.form != "made" and each.table.guide is None
    }
    return scene.replace(changes) if changes else scene


def hand_name(scene: Scene, table: str, fingers: Sequence[int]) -> str:
    """Return the name of a hand.

    A hand in a table such as `hand.0` has the name in this table; a hand defined for one finger has the finger's name.
    """
    return scene.hand[int(table.split(".")[1])].name if table.startswith("hand.") else scene.finger_names[fingers[0]]


def guides_of(session: LiveSession, kind: Literal["hands", "fingers"] | None) -> Sequence[Guide]:
    """List the guides of a run: one per guided hand ("hands"), one per finger of these hands ("fingers"), or none."""
    names, start = session.scene.finger_names, session.start
    guides: list[Guide] = []
    for number, (table, fingers) in enumerate(session.guided if kind else []):
        lag = value_of(session.scene, f"{table}.guide.lag")
        if kind == "hands":
            hand = hand_name(session.scene, table, fingers)
            guides.append(Guide(hand, fingers, start[fingers].mean(axis=0), number, None, fingers, lag))
            continue
        guides += [Guide(names[f], [f], start[f].copy(), number, i, fingers, lag) for i, f in enumerate(fingers)]
    return guides


class FingerReach:
    """Reach of a finger: positions allowed by its device (`RangedDevice`) and by the box of its workspace.

    A finger of mass m on a spring of stiffness k follows a goal. If finger and goal both move at the speed v and the
    goal stops, the finger overshoots by at most v sqrt(m/k); the reach leaves this distance to its boundary. A lightly
    damped finger may move faster than the goal and thus overshoot further.

    Args:
        servo: Servo that moves the finger.
        finger: Number of the finger.
        speed: Highest speed v of the goal [m/s].
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
        """Return the position within reach that is nearest to `place` (d,) [m]."""
        if self._box is not None:
            place = np.clip(place, *self._box)
        if hasattr(self._device, "nearest"):
            place = np.asarray(self._device.nearest(self._finger, place, self.room))
        return place


class GoalWalk:
    """Goal of one finger or hand, which follows a target.

    The goal moves no faster than `speed`, so a distant target does not cause unrealistically large forces of the hand's
    damper or of collisions on the way. A target that moves more slowly than `speed` is followed without delay.

    Args:
        speed: Highest speed [m/s].

    Attributes:
        target: Target of the goal (d,) [m].
    """

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self._goal: FloatArray | None = None
        self.target = np.zeros(0)
        self._time = 0.0

    @property
    def is_led(self) -> bool:
        """Whether the goal has a target."""
        return self._goal is not None

    def aim(self, place: FloatArray, start: FloatArray, now: float) -> FloatArray:
        """Set the target; return the present position of the goal (d,) [m].

        Args:
            place: Position of the target (d,) [m].
            start: Position at which the goal starts if it has had no target (d,) [m].
            now: Present time [s].
        """
        if self._goal is None:
            self._goal, self._time = start.copy(), now - LONGEST
        self.target = place
        return self._advanced(now)

    def step(self, now: float) -> FloatArray | None:
        """Move the goal towards its target; return its position (d,) [m], or None if it does not move."""
        if self._goal is None or np.array_equal(self._goal, self.target):
            self._time = now
            return None
        return self._advanced(now)

    def end(self) -> None:
        """Remove the target."""
        self._goal = None

    def _advanced(self, now: float) -> FloatArray:
        assert self._goal is not None
        approach(self._goal, self.target, self.speed * min(max(now - self._time, 0.0), LONGEST))
        self._time = now
        return self._goal.copy()


def withdrawal(session: LiveSession, row: FloatArray, finger: int, clearance: float) -> FloatArray | None:
    """Compute the displacement of a finger's target that separates the finger from the object (d,) [m].

    The displacement is parallel to the object's force on the finger. Its length is 1.5 (|f|/k + |p - c|) plus the
    clearance, with the force f of the finger, the stiffness k of the hand's spring, and the penetration depth |p - c|.
    The result is None if the finger exerts no force.

    Args:
        session: Running session.
        row: Present row of the recording.
        finger: Number of the finger.
        clearance: Additional distance [m].
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
