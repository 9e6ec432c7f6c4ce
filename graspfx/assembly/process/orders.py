"""Messages to a servo's process: its task, orders to stop or pause, letters with new values, and goals of hands."""

from __future__ import annotations

import os
import pickle
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.assembly.hands import holdings
from graspfx.environment import is_granted
from graspfx.errors import InputError
from graspfx.loop.motion.motion import floats
from graspfx.loop.plant import FusedHand
from graspfx.loop.realtime.pacing import Clock, Pacer
from graspfx.loop.realtime.ring import SLOTS, FloatArray, Ring, RingRecorder, Word, fence, read_letter
from graspfx.loop.servo import CarriedPlant, Servo, Steerable, Update

if TYPE_CHECKING:
    from graspfx.scene.model import Scene


@dataclass(frozen=True)
class Errand:
    """Task of a servo's process.

    The process is a new interpreter with the `sys.path` and working folder of the recording process, which sends the
    task. It imports the modules of drivers and hands by their names, but not the main program.

    Attributes:
        scene: Scene to run.
        ticks: Number of ticks to run.
        width: Number of entries of a row.
        selected: Whether the servo writes only the columns and ticks that the scene's `record` selects.
        live: Keys whose values may change during the run.
        goals: Number of entries of all guided hands' goals.
        trust: Whether all files that the scene names may be used.
        verbosity: Lowest level of log messages to pass on; None to pass on none.
        path: Search path of modules.
        parent: Process identifier of the recording process.
    """

    scene: Scene
    ticks: int
    width: int
    selected: bool = True
    live: Sequence[str] = ()
    goals: int = 0
    trust: bool = field(default_factory=is_granted)
    verbosity: int | None = field(default_factory=lambda: _verbosity())
    path: Sequence[str] = field(default_factory=lambda: list(sys.path))
    parent: int = field(default_factory=os.getpid)

    def text(self) -> bytes:
        """Serialise the task for the servo's process.

        Raises:
            InputError: If the scene holds an object that cannot be serialised.
        """
        self.scene.to_dict()  # names the key of an object that is not data
        try:
            return pickle.dumps(self)
        except Exception as error:
            raise InputError(
                "scene", self.scene, "numbers, texts, lists and tables, which can be sent to another process",
                f"a scene with hardware runs in a separate process ({error}): create the object in a driver instead",
            ) from error  # fmt: skip


def _verbosity() -> int | None:
    return next((level for level in (log.DEBUG, log.INFO) if log.is_heard(level)), None)


Index = NDArray[np.intp]
FARTHEST = 1.0  # largest offset along an axis, and largest squeeze, of a goal [m]
TRIES = 4  # attempts to read goals that are being overwritten


class GoalPlace(NamedTuple):
    """Place of one guided hand's goals.

    Attributes:
        memory: Block of the hand.
        entries: Indices of the goals in this block: offsets of the fingers, (n d,), and the squeeze.
    """

    memory: FloatArray
    entries: Index


def goal_places(servo: Servo) -> list[GoalPlace]:
    """List the places of the goals of a servo's guided hands, plant by plant and hand by hand."""
    hands: list[Any] = [wiring.hand for wiring in servo.plants]
    return [GoalPlace(hand.state, entries) for hand in hands for entries in getattr(hand, "goals", ())]


class GuideKeys(NamedTuple):
    """Key and fingers of a guided hand.

    Attributes:
        table: Key of the hand's table with its number, such as `hand.0`.
        fingers: Indices of the hand's fingers.
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
    """Sender of guided hands' goals to a servo in another process; sending does not wait for the servo.

    Args:
        ring: Ring buffer shared with the servo.
        servo: Copy, in its initial state, of the running servo.
        keys: Guided hands, in the order of `goal_places`.
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
        """Return the goals of hand `number` that were sent last: offsets (n, d) [m], and squeeze [m]."""
        own = self._goals[self._starts[number] : self._starts[number + 1]].copy()
        return own[:-1].reshape(-1, self._dimensions), float(own[-1])

    def send(self, number: int, offset: Any = None, squeeze: float | None = None, finger: int | None = None) -> None:
        """Send the goals of a guided hand.

        Args:
            number: Index of the hand in `keys`.
            offset: Offset (d,) of all fingers, or offsets (n, d) [m]; unchanged if None.
            squeeze: Squeeze [m]; unchanged if None.
            finger: Index, among the hand's fingers, of the only finger whose offset changes; None for all fingers.

        Raises:
            InputError: If goals are not finite, have another shape, or exceed `FARTHEST`.
        """
        with self._lock:
            offsets, closing = self.values(number)
            if offset is not None:
                part = offsets if finger is None else offsets[finger]
                new = floats("offset", offset)
                if new.shape not in (part.shape, (self._dimensions,)) or not _is_near(new):
                    shapes = f"{part.shape} or ({self._dimensions},)"
                    raise InputError(
                        "offset", offset, f"finite components of shape {shapes}, of at most {FARTHEST:g} m in magnitude"
                    )
                part[...] = new
            if squeeze is not None:
                distance = floats("squeeze", squeeze)
                if distance.ndim or not _is_near(distance):
                    raise InputError("squeeze", squeeze, f"a finite distance of at most {FARTHEST:g} m in magnitude")
                closing = float(distance)
            self._goals[self._starts[number] : self._starts[number + 1]] = np.append(offsets.ravel(), closing)
            self._post()

    def send_all(self, servo: Servo) -> None:
        """Send the goals of all guided hands that a copy of the servo contains."""
        with self._lock:
            self._goals = np.concatenate([place.memory[place.entries] for place in goal_places(servo)])
            self._post()

    def _post(self) -> None:
        number = self._number + 1
        self._ring.goals[number % 2] = self._goals
        fence()
        self._ring.words[Word.GOAL] = self._number = number

    def by_key(self, goals: FloatArray) -> Mapping[str, Any]:
        """Return the accepted values in `goals` that differ from the previous call, as a dict by key of the scene."""
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
    """Receiver of goals, which are written into the hands of a running servo between two ticks.

    Args:
        ring: Ring buffer with the goals.
        servo: Running servo.
    """

    def __init__(self, ring: Ring, servo: Servo) -> None:
        self._ring, self._servo, self._places = ring, servo, goal_places(servo)
        self._words = memoryview(ring.memory).cast("q")
        self._number = int(self._words[Word.GOAL])

    def take(self) -> None:
        """Accept the newest goals, unless they are accepted already or are being overwritten."""
        words = self._words
        if words[Word.GOAL] == self._number:
            return
        for _ in range(TRIES):  # goals that are being overwritten are left to the next call
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


class Hold:
    """Values of a plant and its hand that a letter may change.

    Args:
        hand: Hand that holds the plant.
        plant: Plant.

    Attributes:
        memories: Three arrays: the hand's block, its stiffnesses and dampings, and the plant's masses and dampings. An
            array is empty if its values cannot change.
    """

    def __init__(self, hand: Any, plant: Any) -> None:
        self._plant, self._hand = plant, hand
        block, gains, mechanics = np.zeros(0), np.zeros(0), np.zeros(0)
        if is_carried(hand):
            block, gains = hand.state, np.concatenate([hand.stiffness.ravel(), hand.damping.ravel()])
        if isinstance(plant, CarriedPlant):
            mechanics = plant.mechanics.ravel().copy()
        self.memories: list[FloatArray] = [block, gains, mechanics]

    def numbers(self) -> Iterator[tuple[int, Index, FloatArray]]:
        """Yield the content of a letter: index in `memories`, indices of entries and values of these entries.

        The states of followers of a guided hand are excluded, because an update must not change them. Goals are
        excluded, because they are sent separately.
        """
        block, _, _ = self.memories
        if len(block):
            hand: Any = self._hand
            own = [*hand.followers, *(entry for goals in hand.goals for entry in goals.tolist())]
            places = np.setdiff1d(np.arange(len(block)), np.array(own, dtype=np.intp))
            yield 0, places, block[places]
            gains = np.concatenate([hand.stiffness.ravel(), hand.damping.ravel()])
            yield 1, np.arange(len(gains)), gains
        if isinstance(self._plant, CarriedPlant):
            mechanics = self._plant.mechanics.ravel()
            yield 2, np.arange(len(mechanics)), mechanics

    def adopt(self, other: Any) -> None:
        """Copy gains and mechanics from `memories` to hand and plant; the plant's `hold` must be called afterwards."""
        _, gains, mechanics = self.memories
        if len(gains):
            hand: Any = self._hand
            hand.regain(*gains.copy().reshape(2, *hand.stiffness.shape))
        if isinstance(self._plant, CarriedPlant):
            self._plant.mechanics = mechanics.copy().reshape(2, -1)


def is_carried(hand: Any) -> bool:
    """Return whether a letter may change the numbers of a hand in another process."""
    return isinstance(hand, Steerable) and isinstance(hand, FusedHand) and hasattr(hand, "regain")


LOOK = 0.002  # interval of checks whether a pause is over [s]


class PausingPacer(Pacer):
    """A pacer that delays ticks during pauses; after a pause, deadlines are counted from the end of the pause.

    Args:
        period: Sampling period [s].
        clock: Clock for waiting; the wall clock if None.

    Attributes:
        orders: Orders that determine the pauses; None without pauses.
    """

    def __init__(self, period: float, clock: Clock | None = None) -> None:
        super().__init__(period, clock)
        self.orders: Orders | None = None

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


SILENCE = 500_000_000  # silence after which the other process counts as dead [ns]
SIMULATED_SILENCE = 10_000_000_000  # as above, without hardware: a browser may occupy all processors [ns]
LETTER = "letter"  # key under which a change names the letter that carries its values
NO_RECORDER = "the recording process sends no heartbeat"


class ParentGone(BaseException):
    """The recording process has ended or sent an unexpected message, so that this process must end."""


class Orders:
    """Stop condition of a servo, which is evaluated before each tick and while the servo waits.

    Each evaluation also accepts new letters and goals. The run stops on request, or if heartbeats of the recording
    process are missing.

    Args:
        ring: Ring buffer with the status words, letters and goals.
        servo: Servo that runs.
        recorder: Recorder of the first tick of each letter.
        pacer: Pacer of the ticks.

    Attributes:
        cause: Text about missing heartbeats; empty if the run did not stop for this reason.
    """

    def __init__(self, ring: Ring, servo: Servo, recorder: RingRecorder, pacer: Pacer) -> None:
        self._ring, self._servo, self._recorder, self._pacer = ring, servo, recorder, pacer
        self._words = memoryview(ring.memory).cast("q")
        self._holds = [Hold(each.hand, each.plant) for each in servo.plants]
        self._memories = [*memories(servo), *(memory for hold in self._holds for memory in hold.memories)]
        self._number = int(self._words[Word.MAIL])
        self._silence = SILENCE if servo.hardware else SIMULATED_SILENCE
        self._goals = GoalTaker(ring, servo) if ring.goals.size else None
        self.cause = ""

    @property
    def has_news(self) -> bool:
        """Whether there is a letter that was not accepted yet."""
        return bool(self._words[Word.MAIL] != self._number)

    def __call__(self) -> bool:
        words = self._words
        if words[Word.MAIL] != self._number:
            self._take()
        if self._goals is not None:
            self._goals.take()
        words[Word.SKIPPED] = self._pacer.skipped
        if words[Word.STOP]:
            return True
        if time.monotonic_ns() - words[Word.BEAT] > self._silence:
            self.cause = NO_RECORDER
            return True
        return False

    @property
    def is_paused(self) -> bool:
        """Whether the next tick must wait for the end of a pause."""
        halt = self._words[Word.HALT]
        return bool(halt and self._servo.ticks >= halt - 1)

    def _take(self) -> None:
        """Write the values in the newest letter into the servo's memories."""
        number, servo = int(self._words[Word.MAIL]), self._servo
        letter = read_letter(self._ring.letters[number % 2])
        entries = [(self._memories[memory], places, numbers) for memory, places, numbers in letter.entries]
        objects = [servo.objects[i].grasped for i in letter.objects]
        holds = [self._holds[j] for j in letter.plants]
        parts: list[tuple[Steerable, Any]] = [*zip(objects, objects, strict=True), *zip(holds, holds, strict=True)]
        servo.write(Update({LETTER: number}, entries, parts, letter.plants), self._recorder)
        self._number = number
        self._words[Word.TICK] = servo.ticks
        fence()
        self._words[Word.DONE] = number


def memories(servo: Servo) -> list[FloatArray]:
    """List the memories of a servo that a letter may change: the objects' grasps, and the safety chain's buffers."""
    chain = servo.safety.buffers if servo.safety is not None else []
    return [*(part.grasped.block for part in servo.objects), *chain]
