"""Where a recording's rows are: in memory, in blocks of a part, or in the data sets of an HDF5 file."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.loop.recording.checks import NUMBER, check_of, rows_sum

FloatArray = NDArray[np.float64]

BLOCK = 1 << 20  # bytes of rows in memory that are looked at together


class RowStore(Protocol):
    """Rows of a recording."""

    step: int  # rows that are best read together

    def __len__(self) -> int: ...

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        """Give these rows, and of these the numbers `where`, (stop - first, w)."""
        ...


class MemoryRows:
    """Rows in memory, of which views are given."""

    def __init__(self, rows: FloatArray) -> None:
        self.rows = rows
        self.rows.flags.writeable = False
        self.step = max(1, BLOCK // (NUMBER.itemsize * max(rows.shape[1], 1)))

    def __len__(self) -> int:
        return len(self.rows)

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        return self.rows[first:stop, where]


class DataSetRows:
    """Rows in data sets of an HDF5 file, each of a few neighbouring numbers of a row.

    Args:
        path: of the file, for errors.
        data: by place in a row, data sets (N, ...) in the order of these.
        count: N.
        step: rows of a chunk.
    """

    def __init__(self, path: Path, data: Sequence[tuple[slice, Any]], count: int, step: int) -> None:
        self._path, self._data, self._count, self.step = path, data, count, step

    def __len__(self) -> int:
        return self._count

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        first, stop = (min(max(k, 0), self._count) for k in (first, stop))
        count = max(stop - first, 0)
        parts = [(place, data) for place, data in self._data if place.start < where.stop and where.start < place.stop]
        whole = np.empty((count, where.stop - where.start))
        try:
            for place, data in parts if count else ():
                low, high = max(place.start, where.start), min(place.stop, where.stop)
                values = data[first:stop].reshape(count, -1)
                whole[:, low - where.start : high - where.start] = values[:, low - place.start : high - place.start]
        except OSError as error:  # as where a chunk does not have its checksum
            text = " ".join(str(error).split())
            raise RecordingError(f"{self._path}: its bytes were changed since it was written; {text}") from error
        return whole


@dataclass(frozen=True)
class Piece:
    """A block of rows in a file.

    Attributes:
        first: number of its first row.
        count: rows.
        offset: of its head in the file.
        lead: bytes before the rows.
        check: `check_of` what is before the rows and of these; empty if that is not needed.
    """

    first: int
    count: int
    offset: int
    lead: int = 0
    check: bytes = b""


class BlockRows:
    """Rows in blocks of a file, each compared with its check when it is first read.

    The file stays open, so that it can be read also after it was moved, removed or replaced.

    Args:
        path: of the file, for errors.
        file: its descriptor, which is closed when the rows are no longer needed.
        wide: numbers of a row there; in format 4 the two forces stand behind those of the layout.
        pieces: the blocks, in order.

    Raises:
        RecordingError: the blocks do not follow one another, or are more than the file holds.
    """

    def __init__(self, path: Path, file: int, wide: int, pieces: Sequence[Piece]) -> None:
        self._path, self._file, self._wide, self._pieces = path, file, wide, list(pieces)
        finalize(self, os.close, file)
        self._starts = np.array([piece.first for piece in pieces], dtype=np.int64)
        self.step = max(1, BLOCK // (NUMBER.itemsize * max(wide, 1)))
        row, first, size = NUMBER.itemsize * wide, 0, os.fstat(file).st_size
        for piece in pieces:
            end = piece.offset + piece.lead + piece.count * row
            if piece.first != first or min(piece.count, piece.offset, piece.lead, wide) < 0 or end > size:
                raise RecordingError(
                    f"{path}: {piece.count} rows of {row} bytes from row {piece.first} on, at byte {piece.offset}, do "
                    f"not fit: row {first} comes next, and the file has {size} bytes"
                )
            first += piece.count
        self._count = first
        self._checked = [not piece.check for piece in pieces]

    def __len__(self) -> int:
        return self._count

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        rows = np.empty((max(stop - first, 0), where.stop - where.start))
        begin = int(np.searchsorted(self._starts, first, side="right")) - 1
        end = int(np.searchsorted(self._starts, stop, side="left"))
        for number in range(begin, end) if stop > first else ():
            piece = self._pieces[number]
            low, high = max(first, piece.first), min(stop, piece.first + piece.count)
            own = self._rows(piece, number, low - piece.first, high - piece.first)
            rows[low - first : high - first] = own[:, where]
        return rows

    def _rows(self, piece: Piece, number: int, first: int, stop: int) -> FloatArray:
        """Read some rows of a piece; all of it where it is to be checked."""
        size = NUMBER.itemsize * self._wide
        if self._checked[number]:
            content = self._bytes(piece.offset + piece.lead + first * size, (stop - first) * size)
            return np.frombuffer(content, NUMBER).reshape(-1, self._wide)
        whole = memoryview(self._bytes(piece.offset, piece.lead + piece.count * size))
        if check_of(bytes(whole[: piece.lead]), rows_sum(whole[piece.lead :], self._wide)) != piece.check:
            raise RecordingError(
                f"{self._path}: its bytes were changed since it was written, in the rows from {piece.first} up to "
                f"{piece.first + piece.count}"
            )
        self._checked[number] = True
        return np.frombuffer(whole[piece.lead :], NUMBER).reshape(-1, self._wide)[first:stop]

    def _bytes(self, offset: int, count: int) -> bytes:
        """Read bytes.

        Raises:
            RecordingError: the file is shorter.
        """
        parts: list[bytes] = []
        while count > 0 and (part := pread(self._file, count, offset)):
            parts.append(part)
            offset, count = offset + len(part), count - len(part)
        if count:
            raise RecordingError(f"{self._path}: ends at byte {offset}, in the middle of its rows")
        return parts[0] if len(parts) == 1 else b"".join(parts)


def opened(path: Path) -> int:
    """Open a file for reading; give its descriptor."""
    return os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))


def pread(file: int, count: int, offset: int) -> bytes:
    """Read from a place of a file."""
    if hasattr(os, "pread"):
        return os.pread(file, count, offset)
    os.lseek(file, offset, os.SEEK_SET)
    return os.read(file, count)


def gather(count: int, shape: Sequence[int], parts: Iterable[NDArray[Any]]) -> FloatArray:
    """Put arrays (r, ...), one behind the other, into one of `count` rows, which is all that stays in memory."""
    values, first = np.empty((count, *shape)), 0
    for part in parts:
        values[first : first + len(part)] = part
        first += len(part)
    return values
