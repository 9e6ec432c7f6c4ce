"""How changed bytes are found: checks of blocks of rows, and the digest in the last line of a file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from hashlib import blake2b, sha256
from pathlib import Path
from typing import Protocol
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

NUMBER = np.dtype("<f8")
SIZE = 16  # bytes of a check
WHOLE, PARTS, CHUNKS = b"graspfx sha256 ", b"graspfx parts  ", b"graspfx chunks "
DIGITS = 64
LENGTH = len(WHOLE) + DIGITS + 1  # bytes of the last line
PLACE, NUMBERS = 32, 16  # bytes of a stretch before it, and of how many there are
PIECE = 1 << 20  # bytes read at once


def rows_sum(content: bytes | memoryview, width: int) -> bytes:
    """Sum up rows: BLAKE2b of their CRC-32 and of a weighted sum of each column.

    The numbers count as whole ones of 64 bits, modulo 2^64, each row times an odd weight: a change in one number always
    shows in its column's sum, and what cancels there is left to the CRC. A cryptographic digest of the rows themselves
    would take several times as long as the ticks.

    Args:
        content: rows of `width` numbers, little-endian.
        width: numbers in a row.
    """
    view = memoryview(content).cast("B")
    words = np.frombuffer(view, "<u8").reshape(-1, width)
    digest = blake2b(crc32(view).to_bytes(4, "little"), digest_size=SIZE)
    digest.update(np.einsum("i,ij->j", _weights(1 << len(words).bit_length())[: len(words)], words).astype("<u8"))
    return digest.digest()


def check_of(head: bytes, rows: bytes) -> bytes:
    """Compute the check of a block from its head and the `rows_sum` of its rows."""
    return blake2b(head + rows, digest_size=SIZE).digest()


@cache
def _weights(count: int) -> NDArray[np.uint64]:
    """List odd numbers without a pattern, by the mixing step of splitmix64 (Steele, Lea and Flood, OOPSLA 2014)."""
    z = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray((z ^ (z >> np.uint64(31))) | np.uint64(1))


class Readable(Protocol):
    def seek(self, offset: int, /) -> int: ...

    def read(self, size: int, /) -> bytes | None: ...


def seal(file: Readable, size: int, apart: Sequence[tuple[int, int]] | None = None) -> bytes:
    """Make what goes behind the first `size` bytes of a file: a line with their SHA-256.

    It stands behind what HDF5 calls the file's end, where HDF5 does not look. Stretches of rows that have checksums of
    their own can be left out, so that a recording is opened without reading them: before the line stands where they
    are, which is under the digest too.

    Args:
        file: whose bytes are read.
        size: of the file, without the line.
        apart: where stretches with checksums of their own begin and end, in order.
    """
    if apart is None:
        return WHOLE + _digest(file, [(0, size)], b"") + b"\n"
    where = b"".join(b"%016x%016x" % each for each in apart) + b"%016x" % len(apart)
    return where + CHUNKS + _digest(file, _between(apart, size), where) + b"\n"


def has_digest(path: Path) -> bool:
    """Say whether a file ends in its digest; False for one that ends otherwise.

    Raises:
        ValueError: the digest is another's: bytes were changed.
    """
    size = path.stat().st_size - LENGTH
    if size < 0:
        return False
    with path.open("rb") as file:
        file.seek(size)
        line = file.read()
        kind, digest = line[: len(WHOLE)], line[len(WHOLE) : -1]
        if kind not in (WHOLE, PARTS, CHUNKS):
            return False
        apart: list[tuple[int, int]] = []
        where = b""
        if kind != WHOLE:
            count, end = 1, b""  # in format 4 the rows are one stretch
            if kind == CHUNKS:
                file.seek(max(size - NUMBERS, 0))
                end = file.read(NUMBERS)
                count, size = _number(end), size - NUMBERS
            size -= count * PLACE
            if size < 0:
                raise ValueError("its bytes were changed since it was written: its last line is wrong")
            file.seek(size)
            where = file.read(count * PLACE) + end
            numbers = [_number(where[k : k + NUMBERS]) for k in range(0, count * PLACE, NUMBERS)]
            apart = list(zip(numbers[::2], numbers[1::2], strict=True))
            if numbers != sorted(numbers) or any(number > size for number in numbers):
                raise ValueError("its bytes were changed since it was written: its last line is wrong")
        if line[-1:] != b"\n" or _digest(file, _between(apart, size), where) != digest:
            raise ValueError("its bytes were changed since it was written: they do not have its digest")
    return True


def _number(text: bytes) -> int:
    return int(text, 16)


def _between(apart: Iterable[tuple[int, int]], size: int) -> Iterator[tuple[int, int]]:
    """List the stretches of a file between others."""
    start = 0
    for first, stop in apart:
        yield start, first
        start = stop
    yield start, size


def _digest(file: Readable, stretches: Iterable[tuple[int, int]], where: bytes) -> bytes:
    digest = sha256(where)
    for start, end in stretches:
        file.seek(start)
        while start < end and (piece := file.read(min(PIECE, end - start))):
            digest.update(piece)
            start += len(piece)
    return digest.hexdigest().encode()
