"""The last line of a recording: a digest, so that a change of any byte is an error.

It stands behind what HDF5 calls the file's end, where HDF5 does not look. Of a compressed recording, and of formats 2
and 3, it is of all bytes before it. Else it is of all bytes but the blocks of rows, which have checks of their own,
so that a recording is opened without reading them: the line says where they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Protocol

WHOLE, PARTS = b"graspfx sha256 ", b"graspfx parts  "
DIGITS = 64
LENGTH = len(WHOLE) + DIGITS + 1  # bytes of the line
PIECE = 1 << 20  # bytes read at once


class Readable(Protocol):
    def seek(self, offset: int, /) -> int: ...

    def read(self, size: int, /) -> bytes | None: ...


def seal(file: Readable, size: int, rows: tuple[int, int] | None = None) -> bytes:
    """Make the line that goes behind the first `size` bytes of a file.

    Args:
        file: whose bytes are read.
        size: of the file, without the line.
        rows: where the blocks of rows begin and end, if they have checks of their own.
    """
    if rows is None:
        return WHOLE + _digest(file, [(0, size)], b"").encode() + b"\n"
    where = b"%016x%016x" % rows
    return where + PARTS + _digest(file, [(0, rows[0]), (rows[1], size)], where).encode() + b"\n"


def _digest(file: Readable, stretches: list[tuple[int, int]], where: bytes) -> str:
    digest = sha256(where)
    for start, end in stretches:
        for piece in _pieces(file, start, end):
            digest.update(piece)
    return digest.hexdigest()


def _pieces(file: Readable, start: int, end: int) -> Iterator[bytes]:
    file.seek(start)
    while start < end and (piece := file.read(min(PIECE, end - start))):
        yield piece
        start += len(piece)


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
        if not line.startswith((WHOLE, PARTS)):
            return False
        rows = None
        if line.startswith(PARTS):
            size -= 32
            file.seek(max(size, 0))
            where = file.read(32)
            rows = int(where[:16], 16), int(where[16:], 16)
            line = where + line
            if not 0 <= rows[0] <= rows[1] <= size:
                raise ValueError("its bytes were changed since it was written: its last line is wrong")
        if seal(file, size, rows) != line:
            raise ValueError("its bytes were changed since it was written: they do not have its digest")
    return True
