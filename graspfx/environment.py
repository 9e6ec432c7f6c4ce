"""Environment of a process: paths, its processors, and whether its user trusts scene files.

Paths are of the right type, and where the operating system has errors of its own, ours stand in their place. Scene
files may name files outside of their folder if the user says so; a file never says it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from os import PathLike, fspath
from pathlib import Path

from graspfx.errors import InputError
from graspfx.system.scheduling import processors as processors

VARIABLE = "GRASPFX_TRUST"

_granted: ContextVar[bool] = ContextVar("granted", default=False)


def to_path(name: str, value: object, expected: str = "the path of a file", folder: Path | None = None) -> Path:
    """Return a path with `~` resolved; a relative one starts in `folder` (the current one if None).

    Args:
        name: the argument, as its caller wrote it.
        value: a text or a path.
        expected: for the error.
        folder: where relative paths start.

    Raises:
        InputError: neither a text nor a path, a NUL in it, or the home of a user who is not known.
    """
    path = fspath(value) if isinstance(value, str | PathLike) else None
    if not isinstance(path, str):
        raise InputError(name, value, expected)
    if "\0" in path:
        raise InputError(name, path, expected, "leave the NUL character out")
    try:
        return (folder or Path()) / Path(path).expanduser()
    except RuntimeError as error:
        raise InputError(name, path, expected, "no user of that name has a home here: write the folder out") from error


def resolved(name: str, path: Path) -> Path:
    """Follow all links of a path, which may lead to nothing.

    Raises:
        InputError: links that lead to themselves, or a name that the operating system refuses.
    """
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:
        raise InputError(name, str(path), "a path that leads somewhere", str(error)) from error


def require_file(name: str, value: str, path: Path, expected: str = "the path of a file", do: str = "") -> None:
    """Require a regular file; a pipe, a socket or a device could keep its reader waiting for ever.

    Args:
        name: the argument, as its caller wrote it.
        value: the path as it was written.
        path: where it leads.
        expected, do: for the error.

    Raises:
        InputError: nothing there, no regular file, or a name that the operating system refuses.
    """
    try:
        if path.is_file():
            return
        why = "that is no regular file" if path.exists() else do or f"there is none at {path}"
    except OSError as error:  # such as a name of more than 255 letters
        why = error.strerror or str(error)
    raise InputError(name, value, expected, why)


def is_granted() -> bool:
    """Tell whether scene files are trusted: within `granted`, or where the environment says GRASPFX_TRUST=1."""
    return _granted.get() or os.environ.get(VARIABLE, "0") not in ("", "0")


@contextmanager
def granted(yes: bool = True) -> Iterator[None]:
    """Trust scene files within the block, if `yes`; else leave it as it is."""
    token = _granted.set(yes or _granted.get())
    try:
        yield
    finally:
        _granted.reset(token)
