"""Signals that wait: an exception that a handler raises, as Ctrl-C does, must not break off what has to be whole."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def hold_signals() -> Iterator[None]:
    """Hold back the handlers of all signals until the block ends, and call them then.

    Signals that end the process by themselves still do. Python calls handlers in the main thread only: in others there
    is nothing to hold back.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def keep(number: int, frame: FrameType | None) -> None:
        queue.append((number, frame))

    queue: list[tuple[int, FrameType | None]] = []
    handlers = {int(each): handler for each in signal.valid_signals() if callable(handler := signal.getsignal(each))}
    try:
        for number in handlers:
            signal.signal(number, keep)
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in queue:
            handlers[number](number, frame)
