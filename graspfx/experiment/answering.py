"""Answers to trials, from keys pressed in a terminal or on a page, or from a function."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from queue import Empty, SimpleQueue
from typing import NamedTuple, Protocol

from graspfx.errors import InputError
from graspfx.experiment.trial import Presentation

LOOK = 0.05  # interval between checks whether to stop [s]
READY = "\n"  # key of a person who is ready
QUIET = 0.7  # shortest time between two presses of a key [s]; a key that is held down repeats faster


INTERRUPTION = "it was interrupted"
END_OF_INPUT = "the input of answers has ended"


class Stopped(Exception):
    """The session is stopped for the reason in the message; it can be resumed."""


class Press(NamedTuple):
    """A pressed key or button, and the time of the press on the clock of `time.monotonic` [s]."""

    key: str
    clock: float


class Answer(NamedTuple):
    """A response, and the time of the response on the clock of `time.monotonic` [s]."""

    response: str
    clock: float


class Answerer(Protocol):
    """Source of answers."""

    def ready(self, text: str) -> None:
        """Show a text, and wait until the person is ready."""
        ...

    def listen(self, keys: Mapping[str, str]) -> None:
        """Discard earlier answers, and start accepting the answers of `keys`, which maps keys to answers."""
        ...

    def has_answered(self) -> bool:
        """Return whether an answer has been given."""
        ...

    def answer(self, presentation: Presentation) -> Answer:
        """Wait for the answer, and return it."""
        ...


class Keys:
    """Answers by keys, from a terminal, a page or both.

    Args:
        tell: Function that shows a text to the participant.
        stop: Function that returns whether the session should end.

    Attributes:
        presses: Queue of pressed keys; an entry None ends the session.
    """

    def __init__(self, tell: Callable[[str], object], stop: Callable[[], bool]) -> None:
        self.presses: SimpleQueue[Press | None] = SimpleQueue()
        self._tell, self._stop = tell, stop
        self._keys: Mapping[str, str] = {}
        self._answer: Answer | None = None
        self._clocks: dict[str, float] = {}  # time of the last press of each key

    def press(self, key: str) -> None:
        """Record that a key is pressed now."""
        self.presses.put(Press(key, time.monotonic()))

    def end(self) -> None:
        """End the session the next time it waits for a key."""
        self.presses.put(None)

    def ready(self, text: str) -> None:
        """Show a text, and wait for a new press of Enter or the space bar; a key that is held down is ignored.

        Raises:
            Stopped: If the session should end.
        """
        self._clear()
        self._tell(text)
        while True:
            before = dict(self._clocks)
            press = self._next(LOOK)
            if press is None or press.key not in (READY, "\r", " ", ""):
                continue
            if press.clock - before.get(press.key, -math.inf) >= QUIET:
                return

    def listen(self, keys: Mapping[str, str]) -> None:
        """Start accepting answers."""
        self._clear()
        self._keys = keys

    def has_answered(self) -> bool:
        """Return whether an answer has been given."""
        while self._answer is None and (press := self._next(0.0)) is not None:
            self._take(press)
        return self._answer is not None

    def answer(self, presentation: Presentation) -> Answer:
        """Wait for the answer, and return it.

        Raises:
            Stopped: If the session should end.
        """
        while self._answer is None:
            press = self._next(LOOK)
            if press is not None:
                self._take(press)
        return self._answer

    def _take(self, press: Press) -> None:
        response = self._keys.get(press.key)
        if response is not None:
            self._answer = Answer(response, press.clock)

    def _next(self, seconds: float) -> Press | None:
        if self._stop():
            raise Stopped(INTERRUPTION)
        try:
            press = self.presses.get(timeout=seconds) if seconds else self.presses.get_nowait()
        except Empty:
            return None
        if press is None:
            raise Stopped(END_OF_INPUT)
        self._clocks[press.key] = press.clock
        return press

    def _clear(self) -> None:
        self._answer = None
        while True:
            try:
                press = self.presses.get_nowait()
            except Empty:
                return
            if press is None:
                raise Stopped(END_OF_INPUT)
            self._clocks[press.key] = press.clock


class Function:
    """Answers by a function, such as a simulated observer.

    Args:
        respond: Function that receives the presentation of a trial and returns an answer to the question.
        ready: Function called with a text if a person must be ready. It is called before hardware exerts forces and, in
            a session in real time, also at breaks and before trials that wait for a key. It returns when the person is
            ready. None if nobody must be ready.
    """

    def __init__(self, respond: Callable[[Presentation], str], ready: Callable[[str], object] | None = None) -> None:
        self._respond, self._ready = respond, ready
        self._answers: tuple[str, ...] = ()

    def ready(self, text: str) -> None:
        """Call the function `ready` with a text, if there is such a function."""
        if self._ready is not None:
            self._ready(text)

    def listen(self, keys: Mapping[str, str]) -> None:
        """Store the possible answers."""
        self._answers = tuple(keys.values())

    def has_answered(self) -> bool:
        """Return False, because the function is called only by `answer`."""
        return False

    def answer(self, presentation: Presentation) -> Answer:
        """Call the function, and return its answer.

        Raises:
            InputError: If the function's answer is not an answer to the question.
        """
        response = self._respond(presentation)
        if response not in self._answers:
            raise InputError("respond", response, f"one of the answers {', '.join(self._answers)}")
        return Answer(response, time.monotonic())
