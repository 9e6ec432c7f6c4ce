"""Where a recording's rows are: in memory, or in a file of which only what is asked for is read."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.loop.recording.check import NUMBER, check_of, rows_sum

FloatArray = NDArray[np.float64]

BLOCK = 1 << 20  # bytes of rows that are looked at together


class RowStore(Protocol):
    """Rows of a recording."""

    def __len__(self) -> int: ...

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        """Give these rows, and of these the numbers `where`, (stop - first, w)."""
        ...


class MemoryRows:
    """Rows in memory, of which views are given."""

    def __init__(self, rows: FloatArray) -> None:
        self.rows = rows
        self.rows.flags.writeable = False

    def __len__(self) -> int:
        return len(self.rows)

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        return self.rows[first:stop, where]


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


class StoredRows:
    """Rows in blocks of a file, each compared with its check when it is first read.

    The file stays open, so that it can be read also after it was moved, removed or replaced.

    Args:
        path: of the file.
        wide: numbers of a row there, with those that follow from it.
        pieces: the blocks, in order.

    Raises:
        RecordingError: the blocks do not follow one another, or are more than the file holds.
    """

    def __init__(self, path: Path, wide: int, pieces: Sequence[Piece]) -> None:
        self._path, self._wide = path, wide
        self._pieces = list(pieces)
        self._starts = np.array([piece.first for piece in pieces], dtype=np.int64)
        row, first, size = NUMBER.itemsize * wide, 0, path.stat().st_size
        for piece in pieces:
            end = piece.offset + piece.lead + piece.count * row
            if piece.first != first or min(piece.count, piece.offset, piece.lead, wide) < 0 or end > size:
                raise RecordingError(
                    f"{path}: {piece.count} rows of {row} bytes from row {piece.first} on, at byte {piece.offset}, do "
                    f"not fit: row {first} comes next, and the file has {size} bytes"
                )
            first += piece.count
        self._file = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        finalize(self, os.close, self._file)
        self._checked = [not piece.check for piece in pieces]

    def __len__(self) -> int:
        return self._pieces[-1].first + self._pieces[-1].count if self._pieces else 0

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        rows = np.empty((max(stop - first, 0), where.stop - where.start))
        for piece, number in self._between(first, stop):
            low, high = max(first, piece.first), min(stop, piece.first + piece.count)
            block = self._rows(piece, number, low - piece.first, high - piece.first)
            rows[low - first : high - first] = block[:, where]
        return rows

    def _between(self, first: int, stop: int) -> Iterator[tuple[Piece, int]]:
        if stop > first:
            begin = int(np.searchsorted(self._starts, first, side="right")) - 1
            end = int(np.searchsorted(self._starts, stop, side="left"))
            yield from ((self._pieces[number], number) for number in range(begin, end))

    def _rows(self, piece: Piece, number: int, first: int, stop: int) -> FloatArray:
        """Read some rows of a piece; all of it where it is to be checked."""
        size = NUMBER.itemsize * self._wide
        if self._checked[number]:
            return self._numbers(self._bytes(piece.offset + piece.lead + first * size, (stop - first) * size))
        whole = memoryview(self._bytes(piece.offset, piece.lead + piece.count * size))
        if check_of(bytes(whole[: piece.lead]), rows_sum(whole[piece.lead :], self._wide)) != piece.check:
            raise RecordingError(
                f"{self._path}: its bytes were changed since it was written, in the rows from {piece.first} up to "
                f"{piece.first + piece.count}"
            )
        self._checked[number] = True
        return self._numbers(whole[piece.lead :])[first:stop]

    def _numbers(self, content: bytes | memoryview) -> FloatArray:
        return np.frombuffer(content, NUMBER).reshape(-1, self._wide)

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


def pread(file: int, count: int, offset: int) -> bytes:
    """Read from a place of a file."""
    if hasattr(os, "pread"):
        return os.pread(file, count, offset)
    os.lseek(file, offset, os.SEEK_SET)
    return os.read(file, count)


class PackedRows:
    """Rows in a compressed data set of HDF5.

    Args:
        file: of HDF5, which stays open for as long as there are these rows.
        data: (N, wide).
    """

    def __init__(self, file: Any, data: Any) -> None:
        self._data = data
        finalize(self, file.close)

    def __len__(self) -> int:
        return len(self._data)

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        rows = np.empty((max(stop - first, 0), where.stop - where.start))
        step = max(1, BLOCK // (NUMBER.itemsize * self._data.shape[1]))
        for low in range(first, stop, step):
            high = min(low + step, stop)
            rows[low - first : high - first] = self._data[low:high, where]
        return rows


def gather(count: int, shape: Sequence[int], parts: Iterable[NDArray[Any]]) -> FloatArray:
    """Put arrays (r, ...), one behind the other, into one of `count` rows, which is all that stays in memory."""
    values, first = np.empty((count, *shape)), 0
    for part in parts:
        values[first : first + len(part)] = part
        first += len(part)
    return values
