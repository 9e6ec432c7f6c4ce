"""Files and folders to which only the user can write, for code and data that are trusted without further checks."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path

ROOT = 0
MOST_LINKS = 40
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def intrusion(folder: Path) -> str:
    """Return how other users could write to a folder; empty if they cannot, or on systems without user IDs.

    The folder must belong to the user, and nobody else may write to it. To prevent its replacement, every parent folder
    and every link on its path must belong to the user or to root, and others may not write there, unless users can
    remove only their own entries (as in /tmp).

    Raises:
        OSError: If the folder does not exist, or cannot be inspected.
    """
    if not hasattr(os, "getuid"):
        return ""
    user = os.getuid()
    *above, (last, status) = _way(folder)
    if status.st_uid != user:
        return f"{last} belongs to user {status.st_uid}"
    if status.st_mode & OTHERS_WRITE:
        return f"others may write to {last} (mode {stat.S_IMODE(status.st_mode):o}; `chmod 700` prevents that)"
    for place, status in above:
        if status.st_uid not in (user, ROOT):
            return f"{place}, on the way to it, belongs to user {status.st_uid}"
        if stat.S_ISDIR(status.st_mode) and status.st_mode & OTHERS_WRITE and not status.st_mode & stat.S_ISVTX:
            return f"others may write to {place}, on the way to it (mode {stat.S_IMODE(status.st_mode):o})"
    return ""


def read_own(file: Path) -> bytes | None:
    """Read a file to which only the user can write; None for any other file, including links and pipes.

    Raises:
        OSError: If the file cannot be read.
    """
    flags = (getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
    try:
        handle = os.open(file, os.O_RDONLY | sum(flags))
    except OSError as error:
        if error.errno == errno.ELOOP:
            return None
        raise
    with os.fdopen(handle, "rb") as content:
        status = os.fstat(content.fileno())
        strange = hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & OTHERS_WRITE)
        return None if strange or not stat.S_ISREG(status.st_mode) else content.read()


def make_own(folder: Path) -> None:
    """Create a folder and its missing parents, to which only the user has access.

    Raises:
        OSError: If the folder cannot be created.
    """
    missing = []
    while not folder.is_dir():
        missing.append(folder)
        if folder == folder.parent:
            break
        folder = folder.parent
    for each in reversed(missing):
        each.mkdir(mode=0o700, exist_ok=True)  # another process may have created it


def _way(path: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """Yield every folder and link on a path, from the root to the path itself."""
    whole = Path(os.path.abspath(path))  # noqa: PTH100 (`absolute` keeps "..", `resolve` hides links)
    place, names, links = Path(whole.anchor), list(reversed(whole.parts[1:])), 0
    end = place, place.lstat()
    while names:
        name = names.pop()
        if name == "..":
            place = place.parent
            end = place, place.lstat()
            continue
        step = place / name
        status = step.lstat()
        yield end
        end = step, status
        if not stat.S_ISLNK(status.st_mode):
            place = step
            continue
        links += 1
        if links > MOST_LINKS:
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
        target = step.readlink()
        if target.is_absolute():
            yield end
            place = Path(target.anchor)
            end = place, place.lstat()
        names += reversed(target.parts[1:] if target.is_absolute() else target.parts)
    yield end
