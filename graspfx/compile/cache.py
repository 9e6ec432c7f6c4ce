"""Disk cache: a folder of bounded size that no fault of the disk can spoil."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import warnings
from pathlib import Path

from graspfx import log
from graspfx.compile.ownership import intrusion, make_own, read_own
from graspfx.errors import InputError

LIMIT = 200_000_000  # [bytes]; what was used longest ago goes first
SUFFIX = ".machine"


class CacheWarning(UserWarning):
    """A cache that is left alone, since others could have put a forged program or scene there."""


def folder() -> Path:
    """Name the cache's folder: `$GRASPFX_CACHE`, or `graspfx` in the platform's folder for caches.

    Raises:
        OSError: the user has no folder, and the environment names none.
    """
    if override := os.environ.get("GRASPFX_CACHE"):
        return Path(override)
    try:
        return _own()
    except RuntimeError as error:  # as of a container's user that no table knows
        raise OSError(f"{error} Name a folder with GRASPFX_CACHE") from error


def _own() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "graspfx" / "Cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "graspfx"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "graspfx"


def lock_folder() -> Path | None:
    """Make the cache's folder, where locks stand too; None where nothing can be kept."""
    try:
        make_own(here := folder())
        return None if intrusion(here) else here
    except OSError:
        return None


def folder_text() -> str:
    """Say in words where the cache is."""
    try:
        return str(folder())
    except OSError:
        return "the folder that GRASPFX_CACHE names"


def load(key: str) -> bytes | None:
    """Read an entry of the cache; None if there is none, or if it is not what was written.

    Warns where the folder or the file is not the user's alone: then it is not used.
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
        _warn(path.parent, stranger or f"{path.name} is no file of its user alone")
        return None
    digest, content = entry[:32], entry[32:]
    if hashlib.sha256(key.encode() + content).digest() != digest:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)  # used now
    return content


def store(key: str, content: bytes) -> str:
    """Write an entry to the cache; return what stood in the way, or an empty text."""
    import tempfile  # takes longer to load than most of what is kept

    here: Path | str = "the user's folder"
    try:
        here = folder()
        make_own(here)
        if stranger := intrusion(here):
            _warn(here, stranger)
            return f"nothing can be kept in {here}: {stranger}"
        handle, name = tempfile.mkstemp(dir=here, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(hashlib.sha256(key.encode() + content).digest() + content)
            Path(name).replace(here / f"{key}{SUFFIX}")  # at once: another process sees all of it or none
        except OSError:
            with contextlib.suppress(OSError):
                Path(name).unlink()
            raise
        _trim(here)
    except OSError as error:
        log.info("nothing can be kept in %s: %s", here, error.strerror or error)
        return f"nothing can be kept in {here}: {error.strerror or error}"
    log.debug("kept %s, %d bytes, in %s", key[:12], len(content), here)
    return ""


def require_room() -> None:
    """Check that the cache can be written; where it cannot, a run only compiles again.

    Raises:
        InputError: it cannot be written, or others could write to it too.
    """
    import tempfile

    here: Path | str = "the user's folder"
    try:
        here = folder()
        make_own(here)
        if stranger := intrusion(here):
            expected = "a folder to which nobody else can write"
            raise InputError("GRASPFX_CACHE", str(here), expected, f"{stranger}: name another")
        with tempfile.TemporaryFile(dir=here):
            pass
    except OSError as error:
        raise InputError(
            "GRASPFX_CACHE", str(here), "a folder that can be written", f"{error.strerror or error}: name another"
        ) from error


def _warn(here: Path, why: str) -> None:
    text = f"the cache {here} is not used: {why}; or name another folder with GRASPFX_CACHE"
    warnings.warn(text, CacheWarning, stacklevel=2)  # always from here: Python says the same line once


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
