"""Disk cache: a folder of bounded size whose entries are verified when they are read."""

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

LIMIT = 200_000_000  # largest size [bytes]; the least recently used entries are removed first
SUFFIX = ".machine"


class CacheWarning(UserWarning):
    """Warning that the cache is not used, because other users could write forged programs or scenes to it."""


def folder() -> Path:
    """Return the cache's folder: `$GRASPFX_CACHE`, or `graspfx` in the platform's cache folder.

    Raises:
        OSError: If the user has no home folder, and the environment names no folder.
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
    """Create the cache's folder, which also contains locks; return None if it is not writable."""
    try:
        make_own(here := folder())
        return None if intrusion(here) else here
    except OSError:
        return None


def folder_text() -> str:
    """Return the location of the cache, for messages."""
    try:
        return str(folder())
    except OSError:
        return "the folder that GRASPFX_CACHE names"


def load(key: str) -> bytes | None:
    """Read an entry of the cache; None if it is missing or damaged.

    Warn if other users can write to the folder or the file, which is then not used.
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
    """Write an entry to the cache; return the reason for a failure, or an empty text."""
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
    """Require that the cache is writable; without it, each run would compile again.

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
    warnings.warn(text, CacheWarning, stacklevel=2)  # always from this line: Python warns once per line


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
