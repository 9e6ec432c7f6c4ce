"""Lock held by one program on this machine, for hardware that several programs could access."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path
from tempfile import gettempdir

from graspfx.errors import DeviceError
from graspfx.system.file_lock import lock

NAME = re.compile(r"[^A-Za-z0-9._-]+")


class ProgramLock:
    """Lock named after a piece of hardware. The operating system releases it when the program ends, for any reason.

    Args:
        name: Name of the hardware, equal in all programs that use it.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._descriptor = -1

    def take(self) -> None:
        """Acquire the lock.

        Raises:
            DeviceError: If another program, or another part of this program, holds the lock.
        """
        self.release()
        file = Path(gettempdir()) / f"graspfx-{NAME.sub('-', self.name)}.lock"
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
        """Release the lock; do nothing if it is not held."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            with suppress(OSError):
                os.close(descriptor)


def _opened(file: Path) -> int:
    """Open the file of a lock, even if another user created it."""
    flags = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
    try:
        return os.open(file, os.O_RDWR | os.O_CREAT | flags, 0o644)
    except OSError:
        try:
            return os.open(file, os.O_RDONLY | flags)
        except OSError as error:
            raise DeviceError(f"the lock file {file} cannot be opened: {error.strerror}") from error
