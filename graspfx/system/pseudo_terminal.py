"""Pseudo-terminals: serial lines whose other end a program has."""

from __future__ import annotations

from graspfx.errors import GraspFXError


def pair() -> tuple[int, int]:
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


def release(line: int) -> None:
    """Take a dead program's claim back, that nobody else may open the line."""
    import fcntl
    import termios

    fcntl.ioctl(line, termios.TIOCNXCL)
