"""Goals of guided hands on their way to a running servo: the newest wins, and each that was taken is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.holdings import holdings
from graspfx.errors import InputError
from graspfx.loop.motion.motion import floats
from graspfx.loop.realtime.ring import SLOTS, Ring, Word, fence

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

FARTHEST = 1.0  # that a goal may be from where the hand means to be by itself, along an axis, and of a squeeze [m]
TRIES = 4  # to read goals that are being written over


class GoalPlace(NamedTuple):
    """Goals of one guided hand.

    Attributes:
        plant: the number of the plant that it moves.
        memory: a hand's block.
        entries: of the goals there: offsets, (n d,), then the squeeze.
    """

    plant: int
    memory: FloatArray
    entries: Index


def goal_places(servo: Servo) -> list[GoalPlace]:
    """List where the goals of a servo's guided hands stand: plant by plant, hand by hand."""
    places = []
    for j, wiring in enumerate(servo.plants):
        hand: Any = wiring.hand
        places += [GoalPlace(j, hand.state, entries) for entries in getattr(hand, "goals", ())]
    return places


class GuideKeys(NamedTuple):
    """Keys of a guided hand.

    Attributes:
        table: its key, as `hand.0`, with a number for the name.
        fingers: numbers of its fingers.
    """

    table: str
    fingers: list[int]


def guide_keys(scene: Scene, servo: Servo) -> list[GuideKeys]:
    """List the guided hands of a scene in the order of `goal_places`."""
    keys = []
    for wiring in servo.plants:
        fingers = set(wiring.fingers.tolist())
        for holding in holdings(scene):
            if holding.fingers[0] in fingers and getattr(holding.table, "guide", None) is not None:
                keys.append(GuideKeys(".".join(map(str, holding.at)), holding.fingers))
    return keys


class GoalSender:
    """Sends goals of guided hands to a servo in another process; nothing here waits for it.

    Args:
        ring: shared with the servo.
        servo: a copy of the one that runs, at its beginning.
        keys: of the guided hands.
    """

    def __init__(self, ring: Ring, servo: Servo, keys: Sequence[GuideKeys]) -> None:
        self._ring, self.keys, self._dimensions = ring, list(keys), servo.layout.dimensions
        places = goal_places(servo)
        counts = [len(place.entries) for place in places]
        self._starts = np.cumsum([0, *counts]).tolist()
        self._goals = np.concatenate([place.memory[place.entries] for place in places]) if places else np.zeros(0)
        self._last = self._goals.copy()
        self._number, self._lock = 0, Lock()

    def values(self, number: int) -> tuple[FloatArray, float]:
        """Give the last goals of a hand: offsets (n, d) [m], and the squeeze [m]."""
        own = self._goals[self._starts[number] : self._starts[number + 1]].copy()
        return own[:-1].reshape(-1, self._dimensions), float(own[-1])

    def send(self, number: int, offset: Any = None, squeeze: float | None = None, finger: int | None = None) -> None:
        """Send a hand's goals; what is left out stays.

        Args:
            number: of the hand.
            offset: (d,) for all its fingers, or (n, d) [m].
            squeeze: [m].
            finger: the place among its fingers of the one that `offset` is of; None for all.

        Raises:
            InputError: goals that are not finite, of another shape, or beyond `FARTHEST`.
        """
        with self._lock:
            offsets, closing = self.values(number)
            if offset is not None:
                part = offsets if finger is None else offsets[finger]
                new = floats("offset", offset)
                if new.shape not in (part.shape, (self._dimensions,)) or not _is_near(new):
                    shapes = f"{part.shape} or ({self._dimensions},)"
                    raise InputError(
                        "offset", offset, f"finite components of shape {shapes}, none beyond {FARTHEST:g} m"
                    )
                part[...] = new
            if squeeze is not None:
                distance = floats("squeeze", squeeze)
                if distance.ndim or not _is_near(distance):
                    raise InputError("squeeze", squeeze, f"a finite distance, not beyond {FARTHEST:g} m")
                closing = float(distance)
            self._goals[self._starts[number] : self._starts[number + 1]] = np.append(offsets.ravel(), closing)
            self._post()

    def send_all(self, servo: Servo) -> None:
        """Send the goals that stand in a copy of the servo."""
        with self._lock:
            self._goals = np.concatenate([place.memory[place.entries] for place in goal_places(servo)])
            self._post()

    def _post(self) -> None:
        number = self._number + 1
        self._ring.goals[number % 2] = self._goals
        fence()
        self._ring.words[Word.GOAL] = self._number = number

    def by_key(self, goals: FloatArray) -> Mapping[str, Any]:
        """Give goals that the servo has taken by the keys of the scene, those that are others than before."""
        values: dict[str, Any] = {}
        for i, (table, _) in enumerate(self.keys):
            first, last = self._starts[i], self._starts[i + 1]
            own, before = goals[first:last], self._last[first:last]
            if own[:-1].tobytes() != before[:-1].tobytes():
                values[f"{table}.guide.offset"] = own[:-1].reshape(-1, self._dimensions).tolist()
            if own[-1:].tobytes() != before[-1:].tobytes():
                values[f"{table}.guide.squeeze"] = float(own[-1])
        self._last = goals.copy()
        return values


class GoalTaker:
    """Takes goals over into the hands of a running servo, between two ticks.

    Args:
        ring: with the goals.
        servo: that runs.
    """

    def __init__(self, ring: Ring, servo: Servo) -> None:
        self._ring, self._servo, self._places = ring, servo, goal_places(servo)
        self._words = memoryview(ring.memory).cast("q")
        self._number = int(self._words[Word.GOAL])

    def take(self) -> None:
        """Take the newest goals over, if there are any."""
        words = self._words
        if words[Word.GOAL] == self._number:
            return
        for _ in range(TRIES):  # goals that are written over meanwhile are left to the next time
            number = int(words[Word.GOAL])
            goals = self._ring.goals[number % 2].copy()
            if words[Word.GOAL] == number:
                self._write(goals)
                self._number = number
                return

    def _write(self, goals: FloatArray) -> None:
        at = 0
        for place in self._places:
            place.memory[place.entries] = goals[at : at + len(place.entries)]
            at += len(place.entries)
        count = int(self._words[Word.GOALS])
        row = self._ring.goal_log[count % SLOTS]
        row[0], row[1:] = self._servo.ticks, goals
        fence()
        self._words[Word.GOALS] = count + 1


def _is_near(value: Any) -> bool:
    return bool((np.abs(value) <= FARTHEST).all())
