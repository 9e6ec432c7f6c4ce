"""An open file for HDF5, which must not see that a write fails: the failure is noted here, and told to the caller."""

from __future__ import annotations

import os
from io import FileIO
from pathlib import Path


class Stream:
    """Reads and writes a file; from the first failure on, what is written stays in memory.

    HDF5 2.0 ends the process with a segmentation fault when it closes a file of which a write has failed. So it never
    sees one: the writer asks `require()` between blocks, and leaves.

    Args:
        path: of the file, replaced if it is there.
    """

    def __init__(self, path: Path) -> None:
        self._file = FileIO(path, "w+b")
        self._place = self._size = 0
        self._failure: OSError | None = None
        self._overlay: list[tuple[int, bytes]] = []

    def require(self) -> None:
        """Raise the first failure, if there was one."""
        if self._failure is not None:
            raise self._failure

    def finish(self) -> None:
        """Make the disk keep all of it.

        Raises:
            OSError: it does not.
        """
        self.require()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        self._file.close()

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._place = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._size}[whence]
        return self._place

    def tell(self) -> int:
        return self._place

    def read(self, size: int = -1, /) -> bytes:
        size = max(0, self._size - self._place) if size < 0 else min(size, max(0, self._size - self._place))
        buffer = bytearray(size)
        self.readinto(memoryview(buffer))
        return bytes(buffer)

    def readinto(self, buffer: memoryview) -> int:
        """Fill a buffer; with zeros where nothing was written."""
        start, end = self._place, self._place + len(buffer)
        count = self._pull(buffer)
        buffer[count:] = bytes(len(buffer) - count)
        for place, data in self._overlay:
            low, high = max(start, place), min(end, place + len(data))
            if low < high:
                buffer[low - start : high - start] = data[low - place : high - place]
        self._place = end
        return len(buffer)

    def write(self, data: bytes | memoryview) -> int:
        """Write all of it: into the file, or into memory after a failure."""
        size = len(data)
        if self._failure is None:
            try:
                self._push(memoryview(data))
            except OSError as error:
                self._failure = error
        if self._failure is not None:
            self._overlay.append((self._place, bytes(data)))
        self._place += size
        self._size = max(self._size, self._place)
        return size

    def truncate(self, size: int | None = None) -> int:
        self._size = self._place if size is None else size
        if self._failure is None:
            try:
                self._file.truncate(self._size)
            except OSError as error:
                self._failure = error
        return self._size

    def flush(self) -> None:
        """Flush nothing: writes go to the system at once."""

    def _push(self, data: memoryview) -> None:
        self._file.seek(self._place)
        while data:
            data = data[self._file.write(data) :]

    def _pull(self, buffer: memoryview) -> int:
        self._file.seek(self._place)
        count = 0
        while count < len(buffer) and (more := self._file.readinto(buffer[count:])):
            count += more
        return count
