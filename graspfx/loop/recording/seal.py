"""The last line of a recording: a digest of all bytes before it, so that a change of any of them is an error.

It stands behind what HDF5 calls the file's end, where HDF5 does not look. `head -c -80 recording.h5 | sha256sum` gives
it too.
"""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from typing import Protocol

PREFIX = b"graspfx sha256 "
LENGTH = len(PREFIX) + 64 + 1
PIECE = 1 << 20  # bytes read at once


class Readable(Protocol):
    def read(self, size: int, /) -> bytes | None: ...


def seal(file: Readable, size: int) -> bytes:
    """Make the line that goes behind the first `size` bytes of a file, which are read from where it stands."""
    digest = sha256()
    while size > 0 and (piece := file.read(min(PIECE, size))):
        digest.update(piece)
        size -= len(piece)
    return PREFIX + digest.hexdigest().encode() + b"\n"


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
        if not line.startswith(PREFIX):
            return False
        file.seek(0)
        if seal(file, size) != line:
            raise ValueError("its bytes were changed since it was written: they do not have its digest")
    return True
