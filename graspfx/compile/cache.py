"""What is kept on disk from one run to the next: a folder of bounded size that no fault of the disk can spoil."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
from pathlib import Path

from graspfx.errors import InputError

LIMIT = 200_000_000  # [bytes]; what was used longest ago goes first
SUFFIX = ".machine"


def folder() -> Path:
    """`$GRASPFX_CACHE`, or `graspfx` in the folder that the platform has for such things.

    Raises:
        OSError: the user has no folder, and the environment names none.
    """
    if chosen := os.environ.get("GRASPFX_CACHE"):
        return Path(chosen)
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


def shown() -> str:
    """The folder in words."""
    try:
        return str(folder())
    except OSError:
        return "the folder that GRASPFX_CACHE names"


def stored(key: str) -> bytes | None:
    """What was kept under a key; None if there is nothing, or if it is not what was written."""
    try:
        path = folder() / f"{key}{SUFFIX}"
        found = path.read_bytes()
    except OSError:
        return None
    digest, content = found[:32], found[32:]
    if hashlib.sha256(key.encode() + content).digest() != digest:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)  # used now
    return content


def store(key: str, content: bytes) -> str:
    """Keeps something under a key; what stood in the way, or nothing."""
    import tempfile  # takes longer to load than most of what is kept

    here: Path | str = "the user's folder"
    try:
        here = folder()
        here.mkdir(parents=True, exist_ok=True)
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
        return f"nothing can be kept in {here}: {error.strerror or error}"
    return ""


def require_room() -> None:
    """Nothing is lost where the folder cannot be written, but for the time to compile again.

    Raises:
        InputError: it cannot be written.
    """
    import tempfile

    here: Path | str = "the user's folder"
    try:
        here = folder()
        here.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=here):
            pass
    except OSError as error:
        raise InputError(
            "GRASPFX_CACHE", str(here), "a folder that can be written", f"{error.strerror or error}: name another"
        ) from error


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
