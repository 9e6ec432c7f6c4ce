"""Progress of long computations, which a listener can display.

    with waiting("limits", total=len(points), unit="points") as wait:
        for point in points:
            wait.done += 1
            ...

The listener reads the progress in a thread of its own. This module does not display anything, and never waits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import perf_counter
from typing import Protocol


class Wait:
    """A computation that may take long.

    Attributes:
        text: Description of the computation, for users.
        total: Amount of work; None if unknown.
        unit: Unit of `total` and `done`, in the plural; empty if there is none.
        done: Amount of work that has been done.
        count: Function that returns the amount of work that has been done; None if `done` contains it.
        began: Start time of the computation, on the clock of `time.perf_counter` [s].
    """

    def __init__(self, text: str, total: float | None, unit: str, count: Callable[[], float] | None) -> None:
        self.text, self.total, self.unit, self.count = text, total, unit, count
        self.done, self.began = 0.0, perf_counter()

    def progress(self) -> float:
        """Return the amount of work that has been done."""
        return self.done if self.count is None else self.count()


class Listener(Protocol):
    """Display of the progress of computations. All methods are called by the thread that computes."""

    def begin(self, wait: Wait) -> None:
        """Show the progress of a computation, which may be part of another one that is shown."""
        ...

    def end(self, wait: Wait) -> None:
        """Remove a computation from the display."""
        ...

    def clear(self) -> None:
        """Hide the display for a time, because other text is printed."""
        ...


_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def waiting(
    text: str, total: float | None = None, unit: str = "", count: Callable[[], float] | None = None
) -> Iterator[Wait]:
    """Show a computation to the listener while the block runs, and yield it; the arguments are those of `Wait`."""
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
    """Hide the display before other text is printed; the display reappears afterwards."""
    listener = _listener.get()
    if listener is not None:
        listener.clear()


def is_heard() -> bool:
    """Return whether a listener displays the computations of this thread."""
    return _listener.get() is not None


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Let a listener display the computations of the block, and those of threads that run in a copy of its context."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def unheard() -> Iterator[None]:
    """Hide the computations within the block from the listener, because they are part of one that is displayed."""
    token = _listener.set(None)
    try:
        yield
    finally:
        _listener.reset(token)
