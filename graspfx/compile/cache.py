"""Disk cache: a folder of limited size to which only the user can write. Entries are verified when they are read."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import stat
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

from graspfx import log
from graspfx.errors import InputError

LIMIT = 200_000_000  # largest size [bytes]; the least recently used entries are removed first
SUFFIX = ".machine"
ROOT = 0
MOST_LINKS = 40
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


class CacheWarning(UserWarning):
    """Warning that the cache is not used, because other users could write forged programs or scenes to it."""


def folder() -> Path:
    """Return the path of the cache: `$GRASPFX_CACHE` or, if this is not set, `graspfx` in the user's cache folder.

    Raises:
        OSError: If the user has no home folder, and the environment does not contain a path.
    """
    if override := os.environ.get("GRASPFX_CACHE"):
        return Path(override)
    try:
        return _own()
    except RuntimeError as error:  # for example a container's user without an entry in the user table
        raise OSError(f"{error} Set GRASPFX_CACHE to a folder") from error


def _own() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "graspfx" / "Cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "graspfx"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "graspfx"


def lock_folder() -> Path | None:
    """Create and return the folder of the cache, in which locks are stored.

    The result is None if the folder cannot be created, or if other users can write to it.
    """
    try:
        make_own(here := folder())
        return None if intrusion(here) else here
    except OSError:
        return None


def folder_text() -> str:
    """Return the path of the cache as text for messages, also if there is no path."""
    try:
        return str(folder())
    except OSError:
        return "the folder of GRASPFX_CACHE, which must be set"


def load(key: str) -> bytes | None:
    """Return the content of an entry of the cache; None if the entry is missing, damaged or not readable.

    The result is also None, with a warning, if other users can write to the folder or to the file of the entry.
    """
    try:
        path = folder() / f"{key}{SUFFIX}"
        stranger = intrusion(path.parent)
        entry = None if stranger else read_own(path)
    except FileNotFoundError:
        return None
    except OSError as error:
        log.info("the cache cannot be read: %s", error.strerror or error)
        return None
    if entry is None:
        _warn(path.parent, stranger or f"other users can write to {path.name}, or it is not a regular file")
        return None
    digest, content = entry[:32], entry[32:]
    if hashlib.sha256(key.encode() + content).digest() != digest:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)  # marks the entry as used now
    return content


def store(key: str, content: bytes) -> str:
    """Write an entry to the cache, and return the reason if this fails; the text is empty on success."""
    import tempfile  # importing it takes longer than storing most entries

    here: Path | str = "the user's folder"
    try:
        here = folder()
        make_own(here)
        if stranger := intrusion(here):
            _warn(here, stranger)
            return f"cannot write to the cache {here}: {stranger}"
        handle, name = tempfile.mkstemp(dir=here, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(hashlib.sha256(key.encode() + content).digest() + content)
            Path(name).replace(here / f"{key}{SUFFIX}")  # atomic: another process sees the complete file or none
        except OSError:
            with contextlib.suppress(OSError):
                Path(name).unlink()
            raise
        _trim(here)
    except OSError as error:
        log.info("cannot write to the cache %s: %s", here, error.strerror or error)
        return f"cannot write to the cache {here}: {error.strerror or error}"
    log.debug("stored %s, %d bytes, in %s", key[:12], len(content), here)
    return ""


def require_room() -> None:
    """Check that the cache can be used; otherwise each run would compile again.

    Raises:
        InputError: If the cache is not writable, or other users can write to it.
    """
    import tempfile

    here: Path | str = "the user's folder"
    try:
        here = folder()
        make_own(here)
        if stranger := intrusion(here):
            expected = "a folder to which other users cannot write"
            raise InputError("GRASPFX_CACHE", str(here), expected, f"{stranger}: use another folder")
        with tempfile.TemporaryFile(dir=here):
            pass
    except OSError as error:
        raise InputError(
            "GRASPFX_CACHE", str(here), "a writable folder", f"{error.strerror or error}: use another folder"
        ) from error


def _warn(here: Path, why: str) -> None:
    text = f"the cache {here} is not used: {why}; correct this, or set GRASPFX_CACHE to another folder"
    warnings.warn(text, CacheWarning, stacklevel=2)  # from a fixed line of this module: Python shows it once


def _trim(here: Path) -> None:
    entries = []
    for path in [*here.glob(f"*{SUFFIX}"), *here.glob("*.part")]:
        with contextlib.suppress(OSError):  # another process may have removed it
            status = path.stat()
            entries.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in entries)
    for _, size, path in sorted(entries):
        if total <= LIMIT:
            return
        with contextlib.suppress(OSError):
            path.unlink()
        total -= size


# Files and folders to which only the user can write, whose content is trusted without further checks ------------------


def intrusion(folder: Path) -> str:
    """Return a reason why other users could write to a folder or replace it; empty if they cannot.

    The folder must belong to the user, and no other user may have permission to write to it. Every parent folder and
    every link on the path must belong to the user or to root. No other user may have permission to write to a parent
    folder, unless users can remove only their own entries there, as in /tmp. On systems without user IDs, nothing is
    checked.

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
        return f"others may write to {last} (mode {stat.S_IMODE(status.st_mode):o}; correct this with `chmod 700`)"
    for place, status in above:
        if status.st_uid not in (user, ROOT):
            return f"{place}, on the path to this folder, belongs to user {status.st_uid}"
        if stat.S_ISDIR(status.st_mode) and status.st_mode & OTHERS_WRITE and not status.st_mode & stat.S_ISVTX:
            return f"others may write to {place}, on the path to this folder (mode {stat.S_IMODE(status.st_mode):o})"
    return ""


def read_own(file: Path) -> bytes | None:
    """Return the content of a regular file to which only the user can write; None for other files, links and pipes.

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
    """Create a folder and its missing parents. Only the user has access to the folders that are created.

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
    """Yield every folder and link on a path, with its status, from the root to the last item of the path."""
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
