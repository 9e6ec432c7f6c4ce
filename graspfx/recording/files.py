"""Files of a run: names, folders, the lock of a file that is being written, and the digest at the end of a file."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from hashlib import sha256
from io import FileIO
from itertools import chain, count
from os import PathLike
from pathlib import Path
from typing import Protocol

from graspfx.errors import InputError, RecordingError
from graspfx.system.file_lock import lock

NAME = "recording.h5"  # name of the file in a run's folder
PART = ".part"  # suffix of a recording that is being written, or whose run was killed
LATEST = "latest"  # in a folder of runs, the link to the latest run, or a file that contains its name
LONGEST_NAME = 4096  # largest size of a file that replaces a link, in bytes

WHOLE, PARTS, CHUNKS = b"graspfx sha256 ", b"graspfx parts  ", b"graspfx chunks "
LENGTH = len(WHOLE) + 64 + 1  # length of the last line in bytes, including 64 hex digits
NUMBERS = 16  # bytes per integer before the last line: the count and the bounds of the ranges left out
PIECE = 1 << 17  # bytes read at once


def make_folder(path: str | PathLike[str]) -> Path:
    """Create a folder for files of a run, unless it exists, and return its path.

    Raises:
        RecordingError: The folder cannot be created.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder}: no folder can be made there; {obstacle(error)}") from error
    return folder


def new_folder(home: Path, name: str) -> Path:
    """Create a folder within `home`, and return its path: the first of `name`, `name`-2, `name`-3, ... that is unused.

    Raises:
        RecordingError: The folder cannot be created.
    """
    make_folder(home)
    for number in count(1):
        folder = home / (name if number == 1 else f"{name}-{number}")
        try:
            folder.mkdir()
        except FileExistsError:
            continue
        except OSError as error:
            raise RecordingError(f"{folder}: no folder can be made there; {obstacle(error)}") from error
        return folder
    raise AssertionError


def obstacle(error: OSError) -> str:
    """Return the reason why a folder cannot be created."""
    in_the_way = isinstance(error, FileExistsError | NotADirectoryError)
    return "a file is in its way" if in_the_way else str(error.strerror)


@contextmanager
def placing(place: Path, otherwise: str = "") -> Iterator[Path]:
    """Yield the path of a draft beside a file, and move the draft to the path of the file at the end of the block.

    Args:
        place: Path of the file.
        otherwise: Text that is appended to the error message.

    Raises:
        RecordingError: The file cannot be written. An existing file is unchanged.
    """
    draft = place.with_name(f".{place.stem}.{os.getpid()}{place.suffix}")
    try:
        yield draft
        draft.replace(place)
    except OSError as error:
        raise RecordingError(f"{place}: cannot be written; {error.strerror}{otherwise}") from error
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Flush the entries of a folder to disk, on systems that can open a folder."""
    with suppress(OSError):  # Windows cannot open a folder
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def part_of(place: Path) -> Path:
    """Return the path of a recording's part, which contains the rows until the recording is written."""
    return place.with_name(place.name + PART)


def is_part(place: Path) -> bool:
    """Return whether the name of a file is that of a part."""
    return place.name.endswith(PART)


def recording_path(path: str | PathLike[str], name: str = "recording") -> Path:
    """Return an argument as a path; `name` is the name of the argument in the error message.

    Raises:
        InputError: The argument is not a path.
    """
    if not isinstance(path, str | PathLike):
        raise InputError(name, path, "the path of a file or of its folder")
    return Path(path)


def recording_file(path: str | PathLike[str]) -> Path:
    """Return the path of the file to read: the recording, or its part if the recording does not exist.

    If `path` is a folder, the recording is recording.h5 in this folder. `latest` may be a file that contains the name
    of a folder.
    """
    place = recording_path(path)
    if place.name == LATEST and place.is_file() and place.stat().st_size <= LONGEST_NAME:
        place = place.parent / place.read_text(encoding="utf-8", errors="replace").strip()
    if place.is_dir():
        place = place / NAME
    part = part_of(place)
    return part if part.is_file() and not place.exists() else place


def require_vacancy(files: Iterable[Path], remedy: str = "choose another place, or pass overwrite=True") -> None:
    """Require that none of the files exists; an empty part of a recording is ignored.

    Raises:
        RecordingError: A file exists; the message names the first such file and the remedy.
    """
    for file in files:
        if is_part(file):
            if file.exists() and (file.is_dir() or file.stat().st_size > 0):
                raise RecordingError(f"{file}: exists already, from a run that is active or was killed; {remedy}")
        elif file.exists() or file.is_symlink():
            raise RecordingError(f"{file}: exists already; {remedy}")


def require_vacancy_of(place: Path, remedy: str = "choose another place, or pass overwrite=True") -> None:
    """Require that neither a recording nor its part exists.

    Raises:
        RecordingError: One of the two exists; the message names the file and the remedy.
    """
    require_vacancy([place, part_of(place)], remedy)


# The lock on a file that is being written: the system releases it when the process ends, even by a crash -----------


def claim(path: Path) -> FileIO:
    """Open or create a file for writing, with a lock that is held until the file is closed or the process ends.

    Raises:
        RecordingError: Another run is writing the file.
        OSError: The file cannot be opened.
    """
    while True:
        file = FileIO(os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "r+b")
        try:
            if not lock(file.fileno()):
                raise RecordingError(f"{path}: another run is writing there; wait for its end, or choose another place")
            if stands_at(file, path):  # otherwise the owner of the lock removed the file between the two lines above
                return file
        except BaseException:
            file.close()
            raise
        file.close()


def stands_at(file: FileIO, path: Path) -> bool:
    """Return whether an open file is still the file at a path, and has not been removed, moved or replaced."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def release(file: FileIO, path: Path) -> None:
    """Remove a locked file, and then release the lock; the reverse order could remove the file of another run."""
    if sys.platform == "win32":  # on systems where an open file cannot be removed
        file.close()
        path.unlink(missing_ok=True)
        return
    if stands_at(file, path):
        path.unlink(missing_ok=True)
    file.close()


# The digest in the last line of a file: changed bytes are detected before HDF5 reads them -----------------------------


class Readable(Protocol):
    def seek(self, offset: int, /) -> int: ...

    def read(self, size: int, /) -> bytes | None: ...


def seal(file: Readable, size: int, apart: Sequence[tuple[int, int]] | None = None) -> bytes:
    """Return the bytes to append to a file, whose last line contains a SHA-256 digest of the file's first `size` bytes.

    HDF5 does not read these bytes, because they follow the end of its data. Ranges of the file that have checksums can
    be excluded from the digest, so that a recording can be opened without reading all rows. The bounds of these ranges
    precede the last line, and are included in the digest.

    Args:
        file: File to read.
        size: Size of the file without the appended bytes, in bytes.
        apart: Bounds of the ranges that have checksums, in ascending order; None to include all bytes.
    """
    if apart is None:
        return WHOLE + _digest(file, [0, size], b"") + b"\n"
    where = b"".join(b"%016x%016x" % each for each in apart) + b"%016x" % len(apart)
    return where + CHUNKS + _digest(file, [0, *chain.from_iterable(apart), size], where) + b"\n"


def has_digest(path: Path) -> bool:
    """Return whether a file ends in a digest, after comparing the digest with the file's bytes.

    Raises:
        ValueError: The digest does not match, because bytes of the file were changed.
    """
    size = path.stat().st_size - LENGTH
    with path.open("rb") as file:
        file.seek(max(size, 0))
        line = file.read()
        kind, digest, where = line[: len(WHOLE)], line[len(WHOLE) : -1], b""
        if size < 0 or kind not in (WHOLE, PARTS, CHUNKS):
            return False
        if kind == CHUNKS:
            size -= NUMBERS
            file.seek(max(size, 0))
            where = file.read(NUMBERS)
        numbers = 2 * (int(where, 16) if where else kind == PARTS)  # in format 4 the rows are one range
        size -= numbers * NUMBERS
        file.seek(max(size, 0))
        where = file.read(numbers * NUMBERS) + where
        edges = [0, *(int(where[k * NUMBERS : (k + 1) * NUMBERS], 16) for k in range(numbers)), size]
        if edges != sorted(edges):
            raise ValueError("its bytes were changed since it was written: its last line is wrong")
        if line[-1:] != b"\n" or _digest(file, edges, where) != digest:
            raise ValueError("its bytes were changed since it was written: its digest does not match")
    return True


def _digest(file: Readable, edges: Sequence[int], where: bytes) -> bytes:
    """Compute the digest of `where` and of byte ranges; `edges` contains the start and end of each range, in order."""
    digest = sha256(where)
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        file.seek(start)
        while start < end and (piece := file.read(min(PIECE, end - start))):
            digest.update(piece)
            start += len(piece)
    return digest.hexdigest().encode()
