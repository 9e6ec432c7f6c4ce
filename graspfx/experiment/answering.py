"""Answering: keys that people press in a terminal or on a page, or a function that answers in their place."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from queue import Empty, SimpleQueue
from typing import NamedTuple, Protocol

from graspfx.errors import InputError
from graspfx.experiment.trial import Presentation

LOOK = 0.05  # between two looks whether to stop [s]
READY = "\n"  # key that says that a person is ready
QUIET = 0.7  # from a key to the same one, where it was pressed anew: one that is held down repeats itself sooner [s]


INTERRUPTION = "it was interrupted"
END_OF_INPUT = "the input that answers came from has ended"


class Stopped(Exception):
    """The session is to end here, for a reason in words; it can go on later."""


class Press(NamedTuple):
    """A key that was pressed, or a button that stands for it, and when, of `time.monotonic` [s]."""

    key: str
    clock: float


class Answer(NamedTuple):
    """A response, and when it came, of `time.monotonic` [s]."""

    response: str
    clock: float


class Answerer(Protocol):
    """Whoever answers."""

    def ready(self, text: str) -> None:
        """Wait until the person acts."""
        ...

    def listen(self, keys: Mapping[str, str]) -> None:
        """Take answers from now on; what came before counts for nothing."""
        ...

    def has_answered(self) -> bool:
        """Tell whether an answer has come."""
        ...

    def answer(self, presentation: Presentation) -> Answer:
        """Wait for the answer."""
        ...


class Keys:
    """Answers by keys, from every source that presses them.

    Args:
        tell: shows a text to the participant.
        stop: whether the session is to end.

    Attributes:
        presses: is where sources put what was pressed; None ends the session.
    """

    def __init__(self, tell: Callable[[str], object], stop: Callable[[], bool]) -> None:
        self.presses: SimpleQueue[Press | None] = SimpleQueue()
        self._tell, self._stop = tell, stop
        self._keys: Mapping[str, str] = {}
        self._answer: Answer | None = None
        self._clocks: dict[str, float] = {}  # when each key was pressed last

    def press(self, key: str) -> None:
        """Press a key, now."""
        self.presses.put(Press(key, time.monotonic()))

    def end(self) -> None:
        """End the session where it waits next."""
        self.presses.put(None)

    def ready(self, text: str) -> None:
        """Wait for Enter or the space bar, pressed anew after this was asked: one that is held down counts for nothing.

        Raises:
            Stopped: it is to end.
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
        """Take answers from now on."""
        self._clear()
        self._keys = keys

    def has_answered(self) -> bool:
        """Tell whether an answer has come."""
        while self._answer is None and (press := self._next(0.0)) is not None:
            self._take(press)
        return self._answer is not None

    def answer(self, presentation: Presentation) -> Answer:
        """Wait for the answer.

        Raises:
            Stopped: it is to end.
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
    """Answers by a function, as of a simulated observer.

    Args:
        respond: gives one of the question's answers.
        ready: is called before forces of hardware come, and returns once a person has acted; None without hardware.
    """

    def __init__(self, respond: Callable[[Presentation], str], ready: Callable[[str], object] | None = None) -> None:
        self._respond, self._ready = respond, ready
        self._answers: tuple[str, ...] = ()

    def ready(self, text: str) -> None:
        """Call what waits for a person."""
        if self._ready is not None:
            self._ready(text)

    def listen(self, keys: Mapping[str, str]) -> None:
        """Take the question's answers."""
        self._answers = tuple(keys.values())

    def has_answered(self) -> bool:
        """Say no: a function answers when it is asked."""
        return False

    def answer(self, presentation: Presentation) -> Answer:
        """Ask the function.

        Raises:
            InputError: its answer is none of the question's.
        """
        response = self._respond(presentation)
        if response not in self._answers:
            raise InputError("respond", response, f"one of the answers {', '.join(self._answers)}")
        return Answer(response, time.monotonic())
