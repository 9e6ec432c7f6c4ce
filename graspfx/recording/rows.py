"""Storage of the rows of a recording: in memory, in blocks of a file, or in data sets of an HDF5 file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from hashlib import blake2b
from pathlib import Path
from typing import Any
from weakref import finalize
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError

FloatArray = NDArray[np.float64]

NUMBER = np.dtype("<f8")
SIZE = 16  # bytes of a check
BLOCK = 1 << 20  # bytes of rows that are processed together


class RowStore:
    """Rows of a recording, which can be read in ranges.

    Attributes:
        step: Number of rows that are best read in one call.
        by_column: Whether a column can be read without reading the other columns.
    """

    step, by_column = 1, False

    def __len__(self) -> int:
        raise NotImplementedError

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        """Return the columns `where` of the rows `first` to `stop - 1`, (stop - first, w)."""
        raise NotImplementedError

    def beside(self, name: str, first: int, stop: int) -> FloatArray | None:
        """Return a variable stored in addition to the rows, such as `internal_force`; None if it is not stored."""
        return None


def step_of(width: int) -> int:
    """Return the number of rows with `width` numbers that fit in a block of about 1 MB."""
    return max(1, BLOCK // (NUMBER.itemsize * max(width, 1)))


class MemoryRows(RowStore):
    """Rows in memory; `read` returns views of them."""

    def __init__(self, rows: FloatArray) -> None:
        self.rows, self.step = rows, step_of(rows.shape[1])
        self.rows.flags.writeable = False

    def __len__(self) -> int:
        return len(self.rows)

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        return self.rows[first:stop, where]


class Window(RowStore):
    """The rows `first` to `stop - 1` of another store."""

    def __init__(self, store: RowStore, first: int, stop: int) -> None:
        self._store, self._first, self._count = store, first, max(stop - first, 0)
        self.step, self.by_column = store.step, store.by_column

    def __len__(self) -> int:
        return self._count

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        return self._store.read(self._first + first, self._first + stop, where)

    def beside(self, name: str, first: int, stop: int) -> FloatArray | None:
        return self._store.beside(name, self._first + first, self._first + stop)


class DataSetRows(RowStore):
    """Rows in data sets of an HDF5 file, each of which contains some adjacent columns.

    Args:
        path: Path of the file, for error messages.
        data: Data sets (N, ...), each with the position of its columns in a row, in ascending order.
        count: Number of rows N.
        step: Number of rows per chunk.
        others: Data sets that are stored in addition to the rows, by name.
    """

    def __init__(
        self, path: Path, data: Sequence[tuple[slice, Any]], count: int, step: int, others: dict[str, Any]
    ) -> None:  # fmt: skip
        self._path, self._data, self._count, self.step, self._others = path, data, count, step, others
        self.by_column = len(data) > 1

    def __len__(self) -> int:
        return self._count

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        parts = [(place, data) for place, data in self._data if place.start < where.stop and where.start < place.stop]
        if len(parts) == 1 and parts[0][0] == where:
            return self._values(parts[0][1], first, stop).reshape(max(stop - first, 0), where.stop - where.start)
        whole = np.empty((max(stop - first, 0), where.stop - where.start))
        for place, data in parts:
            low, high = max(place.start, where.start), min(place.stop, where.stop)
            values = self._values(data, first, stop).reshape(len(whole), place.stop - place.start)
            whole[:, low - where.start : high - where.start] = values[:, low - place.start : high - place.start]
        return whole

    def beside(self, name: str, first: int, stop: int) -> FloatArray | None:
        return self._values(self._others[name], first, stop) if name in self._others else None

    def _values(self, data: Any, first: int, stop: int) -> FloatArray:
        values = np.empty((max(stop - first, 0), *data.shape[1:]))
        try:
            if values.size:
                data.read_direct(values, np.s_[first:stop])
        except OSError as error:  # for example if the checksum of a chunk does not match
            text = " ".join(str(error).split())
            raise RecordingError(f"{self._path}: its bytes were changed since it was written; {text}") from error
        return values


@dataclass(frozen=True)
class Piece:
    """A block of rows in a file.

    Attributes:
        first: Index of the first row.
        count: Number of rows.
        offset: Position of the block in the file, in bytes.
        lead: Number of bytes between the start of the block and its first row.
        check: Checksum of the block, as returned by `check_of`; empty if the block need not be verified.
    """

    first: int
    count: int
    offset: int
    lead: int = 0
    check: bytes = b""


class BlockRows(RowStore):
    """Rows in blocks of a file; a block with a checksum is verified when it is first read.

    The file stays open, so that its rows can be read even after the file is moved, removed or replaced.

    Args:
        path: Path of the file, for error messages.
        file: Descriptor of the open file, which is closed when this object is deleted.
        wide: Number of entries of a stored row. In format 4 a row contains the external and internal forces in addition
            to the columns of the layout.
        pieces: Blocks, in order.
        pieces: blocks in order.

    Raises:
        RecordingError: The blocks are not contiguous, or extend beyond the end of the file.
    """

    def __init__(self, path: Path, file: int, wide: int, pieces: Sequence[Piece]) -> None:
        self._path, self._file, self._wide, self._pieces = path, file, wide, list(pieces)
        finalize(self, os.close, file)
        self._starts = np.array([piece.first for piece in pieces], dtype=np.int64)
        self.step = step_of(wide)
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

    def __len__(self) -> int:
        return self._count

    def read(self, first: int, stop: int, where: slice) -> FloatArray:
        rows = np.empty((max(stop - first, 0), where.stop - where.start))
        begin = int(np.searchsorted(self._starts, first, side="right")) - 1
        end = int(np.searchsorted(self._starts, stop, side="left"))
        for number in range(begin, end) if stop > first else ():
            piece = self._pieces[number]
            low, high = max(first, piece.first), min(stop, piece.first + piece.count)
            own = self._rows(number, low - piece.first, high - piece.first)
            if high - low == len(rows):
                return own[:, where]
            rows[low - first : high - first] = own[:, where]
        return rows

    def _rows(self, number: int, first: int, stop: int) -> FloatArray:
        """Return rows of a block, after verifying the block if it has a checksum that was not verified yet."""
        size, piece = NUMBER.itemsize * self._wide, self._pieces[number]
        if not piece.check:
            content = self._bytes(piece.offset + piece.lead + first * size, (stop - first) * size)
            return content.view(NUMBER).reshape(-1, self._wide)
        whole = self._bytes(piece.offset, piece.lead + piece.count * size)
        rows = whole[piece.lead :].view(NUMBER).reshape(-1, self._wide)
        if check_of(whole[: piece.lead].tobytes(), rows_sum(rows)) != piece.check:
            raise RecordingError(
                f"{self._path}: its bytes were changed since it was written, in the rows from {piece.first} up to "
                f"{piece.first + piece.count}"
            )
        self._pieces[number] = replace(piece, check=b"")
        return rows[first:stop]

    def _bytes(self, offset: int, count: int) -> NDArray[np.uint8]:
        """Return bytes of the file.

        Raises:
            RecordingError: The file ends before these bytes.
        """
        content, done = np.empty(count, np.uint8), 0
        while done < count and (more := _read_into(self._file, memoryview(content)[done:], offset + done)):
            done += more
        if done < count:
            raise RecordingError(f"{self._path}: the file ends at byte {offset + done}, within its rows")
        return content


def opened(path: Path) -> int:
    """Open a file for reading, and return its descriptor."""
    return os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))


def _read_into(file: int, buffer: memoryview, offset: int) -> int:
    if hasattr(os, "preadv"):
        return os.preadv(file, [buffer], offset)
    os.lseek(file, offset, os.SEEK_SET)
    content = os.read(file, len(buffer))
    buffer[: len(content)] = content
    return len(content)


def rows_sum(rows: FloatArray) -> bytes:
    """Return a checksum of contiguous rows (r, width): BLAKE2b of their CRC-32 and of a weighted sum of each column.

    The sums are of 64-bit integers modulo 2^64, with an odd weight for each row. A change of a single number always
    changes the sum of its column. The CRC detects changes whose effects on a sum cancel. A cryptographic digest of all
    rows would take several times as long as the ticks.
    """
    digest = blake2b(crc32(memoryview(rows).cast("B")).to_bytes(4, "little"), digest_size=SIZE)
    weights = _weights(1 << len(rows).bit_length())[: len(rows)]
    digest.update(np.einsum("i,ij->j", weights, rows.view("<u8")).astype("<u8"))
    return digest.digest()


def check_of(head: bytes, rows: bytes) -> bytes:
    """Return the checksum of a block, from its bytes before the rows and from the `rows_sum` of its rows."""
    return blake2b(head + rows, digest_size=SIZE).digest()


@cache
def _weights(count: int) -> NDArray[np.uint64]:
    """Return pseudorandom odd weights, by the mixing step of splitmix64 (Steele, Lea and Flood, OOPSLA 2014)."""
    z = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray((z ^ (z >> np.uint64(31))) | np.uint64(1))
