"""Where the files of a run stand: the recording, the part that a run writes until it ends, and who may write them."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from itertools import count
from os import PathLike
from pathlib import Path

from graspfx.errors import InputError, RecordingError
from graspfx.system.file_lock import lock

NAME = "recording.h5"  # of the file in a run's folder
PART = ".part"  # ending of a recording that is being written, or whose run was killed
LATEST = "latest"  # in a folder of runs, the link to the last of them, or a file with its name
LONGEST_NAME = 4096  # bytes of a file that stands for a link


def make_folder(path: str | PathLike[str]) -> Path:
    """Make a folder for files of a run, if it is not there.

    Raises:
        RecordingError: it cannot be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder}: no folder can be made there; {obstacle(error)}") from error
    return folder


def new_folder(home: Path, name: str) -> Path:
    """Make a folder in another that is not there yet: NAME, NAME-2, ...

    Raises:
        RecordingError: none can be made.
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
    """Say why no folder can be made."""
    in_the_way = isinstance(error, FileExistsError | NotADirectoryError)
    return "a file is in its way" if in_the_way else str(error.strerror)


@contextmanager
def placing(place: Path, otherwise: str = "") -> Iterator[Path]:
    """Offer a file beside a place to write to, and move it there when it is whole.

    Args:
        place: of the file.
        otherwise: what else the error says.

    Raises:
        RecordingError: it cannot be written; what stood there still does.
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
    """Make the disk keep the names in a folder, where the system can."""
    with suppress(OSError):  # Windows opens no folder
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def part_of(place: Path) -> Path:
    """Name the file that a run writes until it ends and there is a recording."""
    return place.with_name(place.name + PART)


def is_part(place: Path) -> bool:
    """Say whether a file's name is that of a part."""
    return place.name.endswith(PART)


def recording_path(path: str | PathLike[str], name: str = "recording") -> Path:
    """Take a path as it came, or say what is expected of the argument of that name.

    Raises:
        InputError: not a path.
    """
    if not isinstance(path, str | PathLike):
        raise InputError(name, path, "the path of a file or of its folder")
    return Path(path)


def recording_file(path: str | PathLike[str]) -> Path:
    """Choose the file that is read for a path: the recording, or its part where there is no other.

    A folder stands for recording.h5 in it; `latest` may be a file that names a folder.
    """
    place = recording_path(path)
    if place.name == LATEST and place.is_file() and place.stat().st_size <= LONGEST_NAME:
        place = place.parent / place.read_text(encoding="utf-8", errors="replace").strip()
    if place.is_dir():
        place = place / NAME
    part = part_of(place)
    return part if part.is_file() and not place.exists() else place


def require_vacancy(files: Iterable[Path], remedy: str = "choose another place, or pass overwrite=True") -> None:
    """Refuse to write where a file is already, also the part of a recording; a part without a byte is none.

    Raises:
        RecordingError: the first file in the way, and what to do.
    """
    for file in files:
        if is_part(file):
            if file.exists() and (file.is_dir() or file.stat().st_size > 0):
                raise RecordingError(f"{file}: is there already, of a run that goes on or was killed; {remedy}")
        elif file.exists() or file.is_symlink():
            raise RecordingError(f"{file}: is there already; {remedy}")


def require_vacancy_of(place: Path, remedy: str = "choose another place, or pass overwrite=True") -> None:
    """Refuse to write a recording where it, or its part, is already.

    Raises:
        RecordingError: the file in the way, and what to do.
    """
    require_vacancy([place, part_of(place)], remedy)


# The lock on a file that is being written: the system lets go of it when the process ends, however it ends -----------


def claim(path: Path) -> FileIO:
    """Open a file for writing, make it if need be, and lock it until it is closed or the process ends.

    Raises:
        RecordingError: another run writes it.
        OSError: it cannot be opened.
    """
    while True:
        file = FileIO(os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "r+b")
        try:
            if not lock(file.fileno()):
                raise RecordingError(f"{path}: another run is writing there; wait for its end, or choose another place")
            if stands_at(file, path):  # else its owner ended between the two lines above, and removed it
                return file
        except BaseException:
            file.close()
            raise
        file.close()


def stands_at(file: FileIO, path: Path) -> bool:
    """Say whether an open file is still the one of that path: not removed, moved or replaced."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def release(file: FileIO, path: Path) -> None:
    """Remove a file of one's own, and let go of its lock: in this order, so that nobody else's is removed."""
    if sys.platform == "win32":  # where an open file cannot be removed
        file.close()
        path.unlink(missing_ok=True)
        return
    if stands_at(file, path):
        path.unlink(missing_ok=True)
    file.close()
