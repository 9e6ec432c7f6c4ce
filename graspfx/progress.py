"""Progress of long computations, shown by a listener if there is one.

    with waiting("limits", total=len(points), unit="points") as wait:
        for point in points:
            wait.done += 1
            ...

A listener reads the progress in its own thread; this module neither draws nor waits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import perf_counter
from typing import Protocol


class Wait:
    """A computation for which the user waits.

    Attributes:
        text: Description for users.
        total: Amount of work; None if unknown.
        unit: Unit of `total` and `done`, in the plural; empty if there is none.
        done: Amount of work done.
        count: Function that returns the amount of work done, used instead of `done`; None to use `done`.
        began: Start time, on the clock of `time.perf_counter` [s].
    """

    def __init__(self, text: str, total: float | None, unit: str, count: Callable[[], float] | None) -> None:
        self.text, self.total, self.unit, self.count = text, total, unit, count
        self.done, self.began = 0.0, perf_counter()

    def progress(self) -> float:
        """Return the amount done so far."""
        return self.done if self.count is None else self.count()


class Listener(Protocol):
    """Display of waits. All methods are called by the waiting thread."""

    def begin(self, wait: Wait) -> None:
        """Show a wait, which may be nested in another one."""
        ...

    def end(self, wait: Wait) -> None:
        """Remove a wait from the display."""
        ...

    def clear(self) -> None:
        """Hide the display temporarily, because other text is printed."""
        ...


_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def waiting(
    text: str, total: float | None = None, unit: str = "", count: Callable[[], float] | None = None
) -> Iterator[Wait]:
    """Announce a wait within the block, and yield it; the arguments are those of `Wait`."""
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
    """Hide the display before other text is printed; it reappears later."""
    listener = _listener.get()
    if listener is not None:
        listener.clear()


def is_heard() -> bool:
    """Return whether the waits of this thread are displayed."""
    return _listener.get() is not None


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Let a listener show the waits within the block, those of this thread and of threads that copy its context."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def unheard() -> Iterator[None]:
    """Hide waits within the block, which is part of a wait that is already shown."""
    token = _listener.set(None)
    try:
        yield
    finally:
        _listener.reset(token)
