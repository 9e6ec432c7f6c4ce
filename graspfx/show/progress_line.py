"""Progress line in a terminal, for operations that take more than a second: percentage, rate and time left."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Event, Lock, Thread
from time import perf_counter
from typing import TextIO

from graspfx.progress import Wait, listening

PATIENCE = 1.0  # time before a wait is shown [s]
PAUSE = 0.2  # interval of updates [s]
START, CLEAR = "\r", "\x1b[K"  # move to the first column; erase from the cursor to the end of the line
USUAL = 80  # columns of a terminal
SCALES = ((1e9, "G"), (1e6, "M"), (1e3, "k"))


class ProgressLine:
    """Progress listener that writes the progress of the current wait to the last line of a terminal.

    A thread updates the line; the thread ends when the last wait ends.

    Args:
        terminal: Terminal for the output. The only escape sequence written is "erase to the end of the line".
    """

    def __init__(self, terminal: TextIO) -> None:
        self._terminal, self._lock, self._waits = terminal, Lock(), list[Wait]()
        self._visible, self._idle = False, Event()
        self._idle.set()
        self._thread: Thread | None = None

    def begin(self, wait: Wait) -> None:
        with self._lock:
            self._waits.append(wait)
        self._idle.clear()
        if self._thread is None:
            self._thread = Thread(target=self._draw_on, name="graspfx-progress", daemon=True)
            self._thread.start()

    def end(self, wait: Wait) -> None:
        with self._lock:
            self._waits.remove(wait)
            self._wipe()
            last = not self._waits
        if last:
            self._idle.set()
            thread, self._thread = self._thread, None
            if thread is not None:
                thread.join()

    def clear(self) -> None:
        with self._lock:
            self._wipe()

    def _draw_on(self) -> None:
        while not self._idle.wait(PAUSE):
            with self._lock:
                now = perf_counter()
                long = [wait for wait in self._waits if now - wait.began >= PATIENCE]
                if long:
                    self._write(text_of(long[-1], now)[: self._columns() - 1] + CLEAR + START)
                    self._visible = True

    def _wipe(self) -> None:
        if self._visible:
            self._write(START + CLEAR)
            self._visible = False

    def _write(self, text: str) -> None:
        with suppress(OSError, ValueError):  # a lost terminal must not end a run
            self._terminal.write(text)
            self._terminal.flush()

    def _columns(self) -> int:
        try:
            return os.get_terminal_size(self._terminal.fileno()).columns or USUAL  # a serial line reports no width
        except (OSError, ValueError):
            return USUAL


@contextmanager
def progress_line(terminal: TextIO) -> Iterator[None]:
    """Show a progress line for waits within the `with` block; do nothing if the stream is not a terminal."""
    if not terminal.isatty():
        yield
        return
    with listening(ProgressLine(terminal)):
        yield


def text_of(wait: Wait, now: float) -> str:
    """Format the progress of a wait at time `now` [s]: description, percentage, rate, and remaining time.

    The remaining time assumes that the mean rate since the start of the wait continues. If the progress is unknown or
    zero, the elapsed time is shown.
    """
    seconds, done = now - wait.began, wait.progress()
    if not wait.total or done <= 0:
        return f"{wait.text}: {duration_text(seconds)}"
    share = min(done / wait.total, 1.0)
    rate = f", {quantity_text(done / seconds)} {wait.unit}/s" if wait.unit and seconds > 0 else ""
    left = duration_text(seconds * (1.0 - share) / share)
    return f"{wait.text}: {100.0 * share:.0f} %{rate}, {left} left"


def quantity_text(value: float) -> str:
    """Format a number with three digits, from 1000 on with the suffix k, M or G."""
    for size, letter in SCALES:
        if value >= size:
            return f"{value / size:.3g} {letter}"
    return f"{value:.3g}"


def duration_text(seconds: float) -> str:
    """Format a time in seconds, in minutes and seconds, or in hours and minutes."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min"
