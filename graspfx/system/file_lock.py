"""Locks on files. The system releases them when the process ends, however it ends."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import sleep

FAR = 1 << 62  # offset of the locked byte on Windows, where locked bytes cannot be read
BUSY = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK)
NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)
PAUSE = 0.05  # interval between attempts [s]


def lock(descriptor: int, *, lockless: bool = True) -> bool:
    """Lock an open file; return False if another program has locked the file.

    Args:
        descriptor: Descriptor of the file.
        lockless: Result on a system or file system without locks. True admits every caller; use it only if
            something else excludes a second program.
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
    """Exclude other processes within the block; yield whether another process held the lock and may have done the work.

    Args:
        folder: Folder of the lock; None, or a folder that is not writable, excludes no other process.
        name: Name of the lock.
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
