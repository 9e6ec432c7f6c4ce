"""Ctrl-C during a run: the first stops it at its next tick, the second ends the process."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Make Ctrl-C ask a run to stop; a second one ends the process at once.

    An exception that the signal raises can be lost inside a library's callback; a flag cannot.
    """

    def ask(number: int, frame: object) -> None:
        signals.append(number)
        signal.signal(number, signal.SIG_DFL)

    signals: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    ours = before is signal.default_int_handler and threading.current_thread() is threading.main_thread()
    if not ours:  # ignored, as in the background, or somebody else's
        yield lambda: False
        return
    signal.signal(signal.SIGINT, ask)
    try:
        yield lambda: bool(signals)
    finally:
        signal.signal(signal.SIGINT, before)
