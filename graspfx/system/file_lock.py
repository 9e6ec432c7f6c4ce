"""Locks on files: the system holds them, and lets go when the process ends, however it ends."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import sleep

FAR = 1 << 62  # where Windows locks a byte: readers there could not read one that is locked
BUSY = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK)
NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)
PAUSE = 0.05  # between two attempts [s]


def lock(descriptor: int, *, lockless: bool = True) -> bool:
    """Take the lock of an open file; False where another has it.

    Args:
        descriptor: of the file.
        lockless: the answer of a system or file system without locks: it may let everyone in, where something else
            than the lock keeps a second program out as well.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(descriptor, FAR, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
            os.lseek(descriptor, 0, os.SEEK_SET)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except ImportError:
        return lockless
    except OSError as error:
        if error.errno in NO_LOCKS:
            return lockless
        if error.errno in BUSY:
            return False
        raise
    return True


@contextmanager
def alone(folder: Path | None, name: str) -> Iterator[bool]:
    """Do something while no other process does the same; give whether one did, so that it may be done already.

    Args:
        folder: in which all processes look for the lock; None, or one that cannot be written, lets everyone in.
        name: of the lock.
    """
    descriptor = None
    if folder is not None:
        with suppress(OSError):
            descriptor = os.open(folder / f"{name}.lock", os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
    waited = False
    try:
        while descriptor is not None and not lock(descriptor):
            waited = True
            sleep(PAUSE)
        yield waited
    finally:
        if descriptor is not None:
            os.close(descriptor)
