"""Terminals: keys as they are pressed, lines that a user types, and pseudo-terminals."""

from __future__ import annotations

import os
import select
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from graspfx.errors import GraspFXError

LOOK = 0.1  # between two looks whether it is over [s]
STEP = 0.005  # between two looks for a key, where a system cannot wait for one [s]
READY = "\n"


@contextmanager
def terminal_keys(press: Callable[[str], object], end: Callable[[], object]) -> Iterator[None]:
    """Tell of keys until the block ends, in a thread of its own; the terminal shows none of them meanwhile.

    Args:
        press: is called with each key; an empty line of input from elsewhere is Enter.
        end: is called once where input ends, as where a terminal is closed; no key comes after it.
    """
    over = threading.Event()
    stream = sys.stdin
    if stream is None:
        yield
        return
    try:
        file, is_open = stream.fileno(), stream.isatty()
    except (OSError, ValueError):  # as where a test stands in for it
        yield
        return
    if sys.platform == "win32" and is_open:
        target: Callable[..., None] = _windows
    else:
        target = _keys if is_open else _lines
    before = _quiet(file) if is_open else None
    thread = threading.Thread(target=target, args=(file, over, press, end), name="keys", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        _restore(file, before)


def _quiet(file: int) -> Any:
    """Let a terminal tell each key at once, and show none; Ctrl-C stays what it is."""
    with suppress(ImportError):
        import termios
        import tty

        before = termios.tcgetattr(file)
        tty.setcbreak(file)
        return before
    return None


def _restore(file: int, before: Any) -> None:
    if before is not None:
        import termios

        with suppress(termios.error):  # a terminal that was closed has nothing to restore
            termios.tcsetattr(file, termios.TCSADRAIN, before)


def _keys(file: int, over: threading.Event, press: Callable[[str], object], end: Callable[[], object]) -> None:
    while not over.is_set():
        if not select.select([file], [], [], LOOK)[0]:
            continue
        data = _read(file, 64)
        if not data:
            end()
            return
        for key in data.decode(errors="ignore"):
            press(key)


def _read(file: int, most: int) -> bytes:
    """Read what is there; nothing where there is no more to come, as from a terminal that was closed."""
    try:
        return os.read(file, most)
    except OSError:
        return b""


def _lines(file: int, over: threading.Event, press: Callable[[str], object], end: Callable[[], object]) -> None:
    rest = b""
    while not over.is_set():
        if not select.select([file], [], [], LOOK)[0]:
            continue
        data = _read(file, 4096)
        if not data:
            end()
            return
        *lines, rest = (rest + data).split(b"\n")
        for line in lines:
            press(line.decode(errors="ignore").strip()[:1] or READY)


def _windows(file: int, over: threading.Event, press: Callable[[str], object], end: Callable[[], object]) -> None:
    from importlib import import_module

    console: Any = import_module("msvcrt")
    while not over.is_set():
        if console.kbhit():
            press(console.getwch().replace("\r", READY))
        else:
            time.sleep(STEP)


def is_watched() -> bool:
    """Tell whether somebody sits at a terminal whose lines can be waited for: on Windows nobody's can."""
    return sys.platform != "win32" and sys.stdin is not None and sys.stdin.isatty()


def takes_line() -> bool:
    """Take a line that has been typed, without a wait; tell whether there was one."""
    return bool(select.select([sys.stdin], [], [], 0)[0] and sys.stdin.readline())


def pseudo_terminal() -> tuple[int, int]:
    """Open one that passes bytes on as they are; give the descriptors of the program's end and of the line's.

    Raises:
        GraspFXError: this system has none.
    """
    try:
        import pty
        import tty
    except ImportError as error:
        raise GraspFXError("a board on a serial line is emulated on Linux and macOS only") from error
    master, slave = pty.openpty()
    tty.setraw(slave)
    return master, slave


def release_terminal(line: int) -> None:
    """Take a dead program's claim back, that nobody else may open the line."""
    import fcntl
    import termios

    fcntl.ioctl(line, termios.TIOCNXCL)
