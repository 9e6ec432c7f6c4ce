"""The lock on a file that is being written: the system holds it, and lets go when the process ends, however it ends."""

from __future__ import annotations

import os
import sys
from io import FileIO
from pathlib import Path

from graspfx.errors import RecordingError
from graspfx.system.file_lock import lock


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
