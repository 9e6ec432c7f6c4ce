"""Memory shared by two processes through a file descriptor, or by any program through a name."""

from __future__ import annotations

import mmap
import os
import tempfile
from contextlib import suppress
from pathlib import Path

from graspfx.system.file_lock import lock


def create(name: str, size: int) -> int:
    """Create zeroed shared memory; return its descriptor. The memory is freed with the last process that uses it.

    On Linux the memory has no file. On other systems it is a file without a directory entry.

    Args:
        name: Name shown by tools that inspect the process.
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
    """Return the file of a named memory of this user: in /dev/shm, or in the folder of temporary files."""
    folder = Path("/dev/shm") if Path("/dev/shm").is_dir() else Path(tempfile.gettempdir())
    return folder / f"graspfx-{os.getuid() if hasattr(os, 'getuid') else 0}-{name}"


class Named:
    """Zeroed memory that other programs of this user find by its name, once it is published.

    The owner of the memory holds a lock on the file until `close` or the end of its process, so that the name of a
    killed owner is free again.

    Args:
        name: Name of the memory.
        size: Size in bytes.

    Attributes:
        memory: The memory.
    """

    def __init__(self, name: str, size: int) -> None:
        self._path = file_of(name)
        self._file, temporary = tempfile.mkstemp(prefix=f"{self._path.name}-", dir=self._path.parent)  # of mode 0600
        self._temporary: Path | None = Path(temporary)
        os.ftruncate(self._file, size)
        self.memory = mmap.mmap(self._file, size)
        self._is_published = False

    def publish(self) -> bool:
        """Assign the name to the memory; return False if the name has another owner."""
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
        """Remove the file if its owner no longer exists."""
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
        """Remove the name; a second call does nothing. Programs that have the memory keep it."""
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
    """Find named memory of this user; return None if there is none."""
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
