"""The lock on a file that is being written: the system holds it, and lets go when the process ends, however it ends."""

from __future__ import annotations

import errno
import os
import sys
from io import FileIO
from pathlib import Path

from graspfx.errors import RecordingError

FAR = 1 << 62  # where Windows locks a byte: readers there could not read one that is locked
BUSY = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK)
NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)


def claim(path: Path) -> FileIO:
    """Open a file for writing, make it if need be, and lock it until it is closed or the process ends.

    Raises:
        RecordingError: another run writes it.
        OSError: it cannot be opened.
    """
    while True:
        file = FileIO(os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "r+b")
        try:
            if not lock(file.fileno()):
                raise RecordingError(f"{path}: another run is writing there; wait for its end, or choose another place")
            if stands_at(file, path):  # else its owner ended between the two lines above, and removed it
                return file
        except BaseException:
            file.close()
            raise
        file.close()


def lock(descriptor: int) -> bool:
    """Take the lock of an open file; False where another has it.

    A file system without locks takes everyone: there it is the part's presence that keeps a second run out.
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
    except OSError as error:
        if error.errno in NO_LOCKS:
            return True
        if error.errno in BUSY:
            return False
        raise
    return True


def stands_at(file: FileIO, path: Path) -> bool:
    """Say whether an open file is still the one of that path: not removed, moved or replaced."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def release(file: FileIO, path: Path) -> None:
    """Remove a file of one's own, and let go of its lock: in this order, so that nobody else's is removed."""
    if sys.platform == "win32":  # where an open file cannot be removed
        file.close()
        path.unlink(missing_ok=True)
        return
    if stands_at(file, path):
        path.unlink(missing_ok=True)
    file.close()
