"""Terminals: single keys, lines of input, and pseudo-terminals."""

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

LOOK = 0.1  # interval between checks for the end [s]
STEP = 0.005  # interval between checks for a key, on systems that cannot wait for one [s]
READY = "\n"


@contextmanager
def terminal_keys(press: Callable[[str], object], end: Callable[[], object]) -> Iterator[None]:
    """Report pressed keys within the `with` block; the terminal does not echo them.

    A separate thread calls the functions. If the input is a file or a pipe, each line is reported as one key: its first
    letter, or Enter for an empty line.

    Args:
        press: Function that is called with each key.
        end: Function that is called once when the input ends, for example because the terminal is closed.
    """
    over = threading.Event()
    stream = sys.stdin
    if stream is None:
        yield
        return
    try:
        file, is_open = stream.fileno(), stream.isatty()
    except (OSError, ValueError):  # stdin is not a file, as in tests
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
    """Set a terminal to cbreak mode, in which keys are available immediately; return its previous attributes."""
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

        with suppress(termios.error):  # the terminal may be closed
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
    """Read the available input, up to `most` bytes; empty at the end of the input or if the terminal is closed."""
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
    """Return whether stdin is a terminal that `takes_line` can poll; always False on Windows."""
    return sys.platform != "win32" and sys.stdin is not None and sys.stdin.isatty()


def takes_line() -> bool:
    """Read a line from stdin without waiting; return whether a line was available."""
    return bool(select.select([sys.stdin], [], [], 0)[0] and sys.stdin.readline())


def pseudo_terminal() -> tuple[int, int]:
    """Open a pseudo-terminal in raw mode, to emulate a serial line.

    Returns:
        File descriptors of the emulator's end and of the serial line's end.

    Raises:
        GraspFXError: If this system has no pseudo-terminals.
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
    """Reset the exclusive mode of a serial line, which persists after the program that set it has ended.

    Args:
        line: File descriptor of the line.
    """
    import fcntl
    import termios

    fcntl.ioctl(line, termios.TIOCNXCL)
