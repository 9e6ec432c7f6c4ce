"""Progress of waits: who computes says what goes on and how far it is; whoever listens shows it, else it costs nothing.

    with waiting("limits", total=len(points), unit="points") as wait:
        for point in points:
            wait.done += 1
            ...

A listener looks whenever it likes, from a thread of its own: nothing here draws, waits or asks for the time of day.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import perf_counter
from typing import Protocol


class Wait:
    """A wait of a user's.

    Attributes:
        text: what is done, as a user would name it.
        total: how much there is to do; None where nobody can tell.
        unit: of `total` and `done`, in the plural; empty where it means nothing to a user.
        done: how much is done.
        count: tells how much is done, where that is counted elsewhere; instead of `done`.
        began: when, on the clock of `time.perf_counter` [s].
    """

    def __init__(self, text: str, total: float | None, unit: str, count: Callable[[], float] | None) -> None:
        self.text, self.total, self.unit, self.count = text, total, unit, count
        self.done, self.began = 0.0, perf_counter()

    def progress(self) -> float:
        """Tell how much is done by now."""
        return self.done if self.count is None else self.count()


class Listener(Protocol):
    """A display of waits. Both methods are called by the thread that waits."""

    def begin(self, wait: Wait) -> None:
        """Begin to show a wait, which may lie within another one."""
        ...

    def end(self, wait: Wait) -> None:
        """Take away what is shown of a wait."""
        ...

    def clear(self) -> None:
        """Take away what is shown for the moment: something else is printed."""
        ...


_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def waiting(
    text: str, total: float | None = None, unit: str = "", count: Callable[[], float] | None = None
) -> Iterator[Wait]:
    """Announce a wait within the block, whose value takes what is done; the arguments are those of `Wait`."""
    listener = _listener.get()
    wait = Wait(text, total, unit, count)
    if listener is None:
        yield wait
        return
    listener.begin(wait)
    try:
        yield wait
    finally:
        listener.end(wait)


def clear() -> None:
    """Take away what is shown of waits, before something else is printed; it comes again."""
    listener = _listener.get()
    if listener is not None:
        listener.clear()


def is_heard() -> bool:
    """Tell whether somebody shows the waits of this thread."""
    return _listener.get() is not None


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Let a listener show the waits within the block: of this thread, and of those that copy its context."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def unheard() -> Iterator[None]:
    """Show no waits within the block: it is part of a wait that is shown as a whole."""
    token = _listener.set(None)
    try:
        yield
    finally:
        _listener.reset(token)
