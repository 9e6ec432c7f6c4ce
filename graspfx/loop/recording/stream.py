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

    def finish(self, *, sync: bool = True) -> None:
        """Make sure that all of it was written, and that the disk keeps it.

        Raises:
            OSError: it does not.
        """
        self.require()
        if sync:
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


class Graft(Stream):
    """The end of a file that goes on behind `start`, and its first bytes, which are written last of all.

    What is between the two is there already, and what HDF5 writes there is dropped.

    Args:
        file: open for reading and writing; it stays open.
        start: where the new bytes begin.
        front: how many of the first bytes are new.
    """

    def __init__(self, file: FileIO, start: int, front: int) -> None:
        self._file, self._start = file, start
        self._place = self._size = 0
        self._failure: OSError | None = None
        self._overlay: list[tuple[int, bytes]] = []
        self._front = bytearray(front)
        self._place = 0
        self._before = bytearray(front)
        self._pull(memoryview(self._before))

    def write(self, data: bytes | memoryview) -> int:
        if self._place < len(self._front):
            end = self._place + len(data)
            if end > len(self._front):
                self._failure = self._failure or OSError("HDF5 writes beyond the room for it")
            self._front[self._place : end] = bytes(data)
            self._place = end
            self._size = max(self._size, end)
            return len(data)
        if self._place < self._start:  # a number by which room was taken
            self._place += len(data)
            self._size = max(self._size, self._place)
            return len(data)
        return super().write(data)

    def truncate(self, size: int | None = None) -> int:
        self._size = max(self._start, self._place if size is None else size)
        if self._failure is None:
            try:
                self._file.truncate(self._size)
            except OSError as error:
                self._failure = error
        return self._size

    def readinto(self, buffer: memoryview) -> int:
        place, count = self._place, super().readinto(buffer)
        if place < len(self._front):
            part = self._front[place : place + len(buffer)]
            buffer[: len(part)] = part
        return count

    def complete(self) -> None:
        """Write the first bytes, with which the file becomes HDF5.

        Raises:
            OSError: it cannot.
        """
        self.require()
        self._place = 0
        self._push(memoryview(bytes(self._front)))

    def withdraw(self) -> None:
        """Take back what was written, if anything was."""
        self._place = 0
        self._push(memoryview(bytes(self._before)))
        self._file.truncate(self._start)

    def close(self) -> None:
        """Close nothing: the file is another's."""
