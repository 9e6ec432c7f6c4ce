"""Mail to a servo's process: new numbers for its parts by a copy of the servo here, posted and taken one by one."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.process.hold import Hold, is_carried
from graspfx.assembly.process.orders import memories
from graspfx.assembly.process.relay import Relay
from graspfx.errors import InputError
from graspfx.loop.realtime.ring import Letter, Ring, Word, fence, write_letter
from graspfx.loop.servo import Servo
from graspfx.loop.update import CarriedPlant, Update

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

LOOK = 5e-4  # between two looks whether a letter was taken [s]


def letter_of(servo: Servo, update: Update) -> Letter:
    """Write an update as a letter.

    Args:
        servo: a copy of the one that runs, whose parts the update is of.
        update: of its parts.

    Raises:
        InputError: it changes a part that is more than numbers.
    """
    own = memories(servo)
    places = {id(memory): i for i, memory in enumerate(own)}
    objects = {id(part.grasped): i for i, part in enumerate(servo.objects)}
    holders = {id(part) for j in update.plants for part in (servo.plants[j].hand, servo.plants[j].plant)}
    if not all(id(part) in objects or id(part) in holders for part, _ in update.parts):
        raise _refusal(update.values)
    entries = [
        (places[id(memory)], where, numbers) for memory, where, numbers in update.entries if id(memory) in places
    ]
    if servo.ticks == 0:  # a copy that has not run either has the same numbers: a mesh has a hundred thousand
        entries = [_news(own[i], i, where, numbers) for i, where, numbers in entries]
    anew = {id(part): new for part, new in update.parts}
    for j, wiring in ((j, servo.plants[j]) for j in update.plants):
        hand: Any = anew.get(id(wiring.hand), wiring.hand)
        plant = anew.get(id(wiring.plant), wiring.plant)
        if not is_carried(hand) or (id(wiring.plant) in anew and not isinstance(plant, CarriedPlant)):
            raise _refusal(update.values)
        hold = Hold(hand, plant)
        entries += [(len(own) + 3 * j + i, where, numbers) for i, where, numbers in hold.numbers()]
    return Letter(entries, [objects[id(part)] for part, _ in update.parts if id(part) in objects], update.plants)


def _news(memory: FloatArray, number: int, where: Index, numbers: FloatArray) -> tuple[int, Index, FloatArray]:
    """Leave out numbers that a memory has already, to the bit."""
    differ = memory[where].view(np.int64) != np.asarray(numbers, dtype=float).view(np.int64)
    return number, where[differ], numbers[differ]


def _refusal(values: Mapping[str, Any]) -> InputError:
    return InputError(
        ", ".join(values), list(values.values()), "gains, friction and numbers of objects without planes",
        "a run in real time has such parts in another process; begin with such values",
    )  # fmt: skip


class Mail:
    """Posts letters to a servo, each once the one before was taken.

    Args:
        ring: shared with the servo.
        relay: that records what holds from which tick on.
    """

    def __init__(self, ring: Ring, relay: Relay) -> None:
        self._ring, self._relay = ring, relay
        self._number = int(ring.words[Word.MAIL])

    def post(self, letter: Letter, values: Mapping[str, Any], require: Callable[[], object]) -> int:
        """Post a letter and wait until it was taken; give the tick from which on it holds.

        Args:
            letter: to the servo.
            values: that are recorded for it, by key.
            require: called again and again; raises where the servo takes no letters any more.
        """
        ring, number = self._ring, self._number + 1
        require()
        write_letter(letter, ring.letters[number % 2])
        self._relay.letters[number] = values
        fence()
        ring.words[Word.MAIL] = self._number = number
        while int(ring.words[Word.DONE]) != number:
            require()
            time.sleep(LOOK)
        return int(ring.words[Word.TICK])
