"""Shared memory: between two processes by a file descriptor, or between any programs of a user by a name."""

from __future__ import annotations

import mmap
import os
import tempfile
from contextlib import suppress
from pathlib import Path

from graspfx.system.file_lock import lock


def create(name: str, size: int) -> int:
    """Create shared memory filled with zeros, and return its file descriptor.

    The memory is freed when the last process that uses it ends. On Linux the memory has no file; on other systems it is
    a deleted temporary file.

    Args:
        name: Name of the memory in tools that inspect processes.
        size: Size in bytes.
    """
    if hasattr(os, "memfd_create"):
        file = os.memfd_create(name, getattr(os, "MFD_CLOEXEC", 0))
    else:
        with tempfile.TemporaryFile() as temporary:
            file = os.dup(temporary.fileno())
    os.ftruncate(file, size)
    return file


def file_of(name: str) -> Path:
    """Return the path of the file of this user's named memory, in /dev/shm or in the folder of temporary files."""
    folder = Path("/dev/shm") if Path("/dev/shm").is_dir() else Path(tempfile.gettempdir())
    return folder / f"graspfx-{os.getuid() if hasattr(os, 'getuid') else 0}-{name}"


class Named:
    """Shared memory that other programs of the same user can open by its name after `publish`.

    The program that creates the memory holds a lock on its file until `close` or until its process ends. The name is
    therefore available again after the program was killed.

    Args:
        name: Name of the memory.
        size: Size in bytes.

    Attributes:
        memory: Memory map, initially filled with zeros.
    """

    def __init__(self, name: str, size: int) -> None:
        self._path = file_of(name)
        self._file, temporary = tempfile.mkstemp(prefix=f"{self._path.name}-", dir=self._path.parent)  # of mode 0600
        self._temporary: Path | None = Path(temporary)
        os.ftruncate(self._file, size)
        self.memory = mmap.mmap(self._file, size)
        self._is_published = False

    def publish(self) -> bool:
        """Assign the name to the memory; return False if another running program has memory of this name."""
        if self._is_published:
            return True
        assert self._temporary is not None
        lock(self._file)
        for _ in range(2):
            try:
                os.link(self._temporary, self._path)
                break
            except FileExistsError:
                if not self._discard():
                    return False
        else:
            return False
        self._is_published = True
        self._temporary.unlink()
        self._temporary = None
        return True

    def _discard(self) -> bool:
        """Remove the file of the name if no program holds its lock; return whether the name is available."""
        try:
            file = os.open(self._path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
        except FileNotFoundError:
            return True
        except OSError:
            return False
        try:
            if not lock(file):
                return False
            self._path.unlink(missing_ok=True)
            return True
        finally:
            os.close(file)

    def close(self) -> None:
        """Remove the name; programs that have opened the memory can continue to use it. A second call does nothing."""
        if self._file < 0:
            return
        if self._is_published:
            self._path.unlink(missing_ok=True)
        if self._temporary is not None:
            with suppress(OSError):
                self._temporary.unlink()
        os.close(self._file)
        self._file = -1


def find(name: str) -> mmap.mmap | None:
    """Open memory of this user by its name; return None if there is no memory of this name."""
    try:
        file = os.open(file_of(name), os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
    except OSError:
        return None
    try:
        status = os.fstat(file)
        if hasattr(os, "getuid") and status.st_uid != os.getuid():
            return None
        return mmap.mmap(file, status.st_size) if status.st_size else None
    finally:
        os.close(file)
