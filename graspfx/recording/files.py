"""Files of a run: names, folders, the writer's lock, and the digest in the last line."""

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
    """Make a folder for files of a run unless it exists.

    Raises:
        RecordingError: the folder cannot be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder}: no folder can be made there; {obstacle(error)}") from error
    return folder


def new_folder(home: Path, name: str) -> Path:
    """Make a new folder within a folder: the first unused name of NAME, NAME-2, ...

    Raises:
        RecordingError: no folder can be made.
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
    """Return the reason why the folder cannot be made."""
    in_the_way = isinstance(error, FileExistsError | NotADirectoryError)
    return "a file is in its way" if in_the_way else str(error.strerror)


@contextmanager
def placing(place: Path, otherwise: str = "") -> Iterator[Path]:
    """Yield a draft file beside a path, and move it to the path when it is complete.

    Args:
        place: Path of the file.
        otherwise: Text appended to the error message.

    Raises:
        RecordingError: The file cannot be written; an existing file is unchanged.
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
    """Flush a folder's entries to disk, if the system supports it."""
    with suppress(OSError):  # Windows cannot open a folder
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def part_of(place: Path) -> Path:
    """Return the path of the part, which a run writes until its recording is complete."""
    return place.with_name(place.name + PART)


def is_part(place: Path) -> bool:
    """Tell whether a file name is that of a part."""
    return place.name.endswith(PART)


def recording_path(path: str | PathLike[str], name: str = "recording") -> Path:
    """Convert an argument to a path; `name` is the argument's name in the error.

    Raises:
        InputError: The argument is not a path.
    """
    if not isinstance(path, str | PathLike):
        raise InputError(name, path, "the path of a file or of its folder")
    return Path(path)


def recording_file(path: str | PathLike[str]) -> Path:
    """Return the file to read for a path: the recording, or its part if there is no recording.

    For a folder, the file is the recording.h5 in it. `latest` may be a file that contains the folder's name.
    """
    place = recording_path(path)
    if place.name == LATEST and place.is_file() and place.stat().st_size <= LONGEST_NAME:
        place = place.parent / place.read_text(encoding="utf-8", errors="replace").strip()
    if place.is_dir():
        place = place / NAME
    part = part_of(place)
    return part if part.is_file() and not place.exists() else place


def require_vacancy(files: Iterable[Path], remedy: str = "choose another place, or pass overwrite=True") -> None:
    """Require that the files, including parts of recordings, do not exist; an empty part is ignored.

    Raises:
        RecordingError: A file exists; the message names the first one and says what to do.
    """
    for file in files:
        if is_part(file):
            if file.exists() and (file.is_dir() or file.stat().st_size > 0):
                raise RecordingError(f"{file}: exists already, from a run that is active or was killed; {remedy}")
        elif file.exists() or file.is_symlink():
            raise RecordingError(f"{file}: exists already; {remedy}")


def require_vacancy_of(place: Path, remedy: str = "choose another place, or pass overwrite=True") -> None:
    """Require that neither the recording nor its part exists.

    Raises:
        RecordingError: A file exists; the message names it and says what to do.
    """
    require_vacancy([place, part_of(place)], remedy)


# The lock on a file that is being written: the system releases it when the process ends, even by a crash -----------


def claim(path: Path) -> FileIO:
    """Open or create a file for writing, and lock it until it is closed or the process ends.

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
    """Tell whether an open file is still the file at that path: not removed, moved or replaced."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def release(file: FileIO, path: Path) -> None:
    """Remove a locked file, then release its lock; the reverse order could remove the file of another run."""
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
    """Return the trailer of a file: a line with the SHA-256 of its first `size` bytes.

    The trailer follows the end of the HDF5 data, where HDF5 does not read. Ranges of rows that have their own checksums
    can be left out of the digest, so that a recording is opened without reading these rows. The bounds of the ranges
    precede the line, and the digest covers the bounds too.

    Args:
        file: File to read.
        size: Size of the file without the trailer, in bytes.
        apart: Bounds of the ranges that have their own checksums, in order.
    """
    if apart is None:
        return WHOLE + _digest(file, [0, size], b"") + b"\n"
    where = b"".join(b"%016x%016x" % each for each in apart) + b"%016x" % len(apart)
    return where + CHUNKS + _digest(file, [0, *chain.from_iterable(apart), size], where) + b"\n"


def has_digest(path: Path) -> bool:
    """Tell whether a file ends in its digest.

    Raises:
        ValueError: The digest does not match: bytes were changed.
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
    """Compute the digest of `where` and of the byte ranges whose starts and ends alternate in `edges`."""
    digest = sha256(where)
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        file.seek(start)
        while start < end and (piece := file.read(min(PIECE, end - start))):
            digest.update(piece)
            start += len(piece)
    return digest.hexdigest().encode()
