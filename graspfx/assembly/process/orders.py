"""Orders to a running servo from the process that records: to rest, or to go on with other numbers."""

from __future__ import annotations

import time
from typing import Any

from graspfx.assembly.process.goals import GoalTaker
from graspfx.assembly.process.hold import Hold
from graspfx.loop.realtime.pacing import Pacer
from graspfx.loop.realtime.ring import FloatArray, Ring, RingRecorder, Word, fence, read_letter
from graspfx.loop.servo import Servo
from graspfx.loop.update import Steerable, Update

SILENCE = 500_000_000  # of the other process, after which it is no more [ns]
SIMULATED_SILENCE = 10_000_000_000  # where no hand feels anything: a page and a browser may take all of a machine [ns]
LETTER = "letter"  # in place of keys: the number of the letter whose values hold
NO_RECORDER = "the process that records gives no sign of life"


class ParentGone(BaseException):
    """The process that began this one has gone away, or has no use for it."""


class Orders:
    """Tells a servo whether to stop, before each tick and while it waits for one; letters are taken then.

    Args:
        ring: with the words and letters.
        servo: that is told.
        recorder: that notes which letter holds from which tick on.
        pacer: of the ticks.

    Attributes:
        cause: of the end, where the other process is no more; else empty.
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
        """Whether a letter has come that was not taken yet."""
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
        """Whether the coming tick is to wait."""
        halt = self._words[Word.HALT]
        return bool(halt and self._servo.ticks >= halt - 1)

    def _take(self) -> None:
        """Write a letter's numbers into the servo's memories, between two ticks."""
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
    """List the memories that a letter may write to: of the objects' grasps, then of the safety chain beside each."""
    chain = servo.safety.buffers if servo.safety is not None else []
    return [*(part.grasped.block for part in servo.objects), *chain]
