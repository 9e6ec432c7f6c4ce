"""A lock that one program of this machine has: for hardware behind a service or a library, which many may reach."""

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
    """A lock by the name of a piece of hardware; it goes with the program that has it, however that ends.

    Args:
        name: of the hardware, the same in every program that reaches it.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._descriptor = -1

    def take(self) -> None:
        """Take the lock, or raise DeviceError if another program, or another part of this one, has it."""
        self.release()
        file = Path(gettempdir()) / f"graspfx-{NAME.sub('-', self.name)}.lock"
        descriptor = _opened(file)
        try:
            is_ours = lock(descriptor, lockless=False)
        except OSError as error:
            os.close(descriptor)
            raise DeviceError(f"the lock {file} is refused: {error.strerror}") from error
        if not is_ours:
            os.close(descriptor)
            text = f"{self.name} is taken by another program; end that one first: two must not drive one device"
            raise DeviceError(text)
        self._descriptor = descriptor

    def release(self) -> None:
        """Let go of the lock; returns also when it is not held."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            with suppress(OSError):
                os.close(descriptor)


def _opened(file: Path) -> int:
    """Open the file of a lock, also one that another user has made."""
    flags = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
    try:
        return os.open(file, os.O_RDWR | os.O_CREAT | flags, 0o644)
    except OSError:
        try:
            return os.open(file, os.O_RDONLY | flags)
        except OSError as error:
            raise DeviceError(f"the lock {file} does not open: {error.strerror}") from error
