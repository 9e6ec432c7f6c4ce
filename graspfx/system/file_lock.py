"""Locks on files. The operating system releases a lock when the process that holds it ends, for any reason."""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import sleep

from graspfx.errors import DeviceError

FAR = 1 << 62  # offset of the locked byte on Windows, where locked bytes cannot be read
BUSY = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK)
NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)
OTHERS = re.compile(r"[^A-Za-z0-9._-]+")  # characters that the name of a lock's file must not have
PAUSE = 0.05  # interval between attempts [s]


def lock(descriptor: int, *, lockless: bool = True) -> bool:
    """Lock an open file without waiting; return False if another process holds the lock.

    Args:
        descriptor: Descriptor of the file.
        lockless: Value to return if the system or the file system has no locks. Use True only if a second program is
            excluded by other means.
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
    """Hold a lock within the `with` block, so that other processes wait before their blocks.

    Args:
        folder: Folder of the lock's file. If it is None or not writable, no process is excluded.
        name: Name of the lock.

    Yields:
        Whether this process had to wait, so that another process may already have done the work.
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


class ProgramLock:
    """Lock that allows only one program to use a piece of hardware.

    The operating system releases the lock when the program ends, for any reason.

    Args:
        name: Name of the hardware; all programs that use the hardware must give the same name.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._descriptor = -1

    def take(self) -> None:
        """Acquire the lock.

        Raises:
            DeviceError: If another program, or another part of this program, holds the lock.
        """
        from tempfile import gettempdir  # loads half a dozen modules, which few programs need

        self.release()
        file = Path(gettempdir()) / f"graspfx-{OTHERS.sub('-', self.name)}.lock"
        descriptor = _opened(file)
        try:
            is_ours = lock(descriptor, lockless=False)
        except OSError as error:
            os.close(descriptor)
            raise DeviceError(f"{file} cannot be locked: {error.strerror}") from error
        if not is_ours:
            os.close(descriptor)
            text = f"{self.name} is taken by another program; end that program first: only one may drive a device"
            raise DeviceError(text)
        self._descriptor = descriptor

    def release(self) -> None:
        """Release the lock; do nothing if this object does not hold it."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            with suppress(OSError):
                os.close(descriptor)


def _opened(file: Path) -> int:
    """Open or create the file of a lock; if another user created it and it is not writable, open it for reading."""
    flags = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
    try:
        return os.open(file, os.O_RDWR | os.O_CREAT | flags, 0o644)
    except OSError:
        try:
            return os.open(file, os.O_RDONLY | flags)
        except OSError as error:
            raise DeviceError(f"the lock file {file} cannot be opened: {error.strerror}") from error
