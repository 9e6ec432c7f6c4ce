"""Process environment: paths, number of processors, and whether the user trusts scene files.

Functions that take a path check the type of the path, and replace errors of the operating system by InputError. A scene
file may use files outside its folder only if the user allows it; the scene file itself cannot allow it.
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
    """Return a path with `~` expanded; a relative path is appended to `folder` (default: the current folder).

    Args:
        name: Name of the argument in error messages.
        value: Path as text or as a path object.
        expected: Description of a valid value in error messages.
        folder: Folder to which a relative path refers; None for the current folder.

    Raises:
        InputError: If the value is not a path, contains NUL, or refers to the home folder of an unknown user.
    """
    path = fspath(value) if isinstance(value, str | PathLike) else None
    if not isinstance(path, str):
        raise InputError(name, value, expected)
    if "\0" in path:
        raise InputError(name, path, expected, "remove the NUL character")
    try:
        return (folder or Path()) / Path(path).expanduser()
    except RuntimeError as error:
        raise InputError(
            name, path, expected, "no user of that name has a home folder here: write the full path"
        ) from error


def resolved(name: str, path: Path) -> Path:
    """Resolve all symbolic links in a path; the path need not exist.

    Raises:
        InputError: If the links form a loop, or the operating system refuses the name.
    """
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:
        raise InputError(name, str(path), "a valid path", str(error)) from error


def require_file(name: str, value: str, path: Path, expected: str = "the path of a file", do: str = "") -> None:
    """Raise an error unless a path is a regular file; reading a pipe, a socket or a device could block forever.

    Args:
        name: Name of the argument in error messages.
        value: Path as the user wrote it, for error messages.
        path: Path to check.
        expected, do: Description of a valid value, and advice if the file does not exist, for error messages.

    Raises:
        InputError: If the file does not exist or is not regular, or the operating system refuses the name.
    """
    try:
        if path.is_file():
            return
        why = "this is not a regular file" if path.exists() else do or f"there is no file {path}"
    except OSError as error:  # for example for a name of more than 255 letters
        why = error.strerror or str(error)
    raise InputError(name, value, expected, why)


def is_granted() -> bool:
    """Return whether scene files are trusted.

    They are trusted in a block of `granted`, and if the environment variable GRASPFX_TRUST has a value other than 0.
    """
    return _granted.get() or os.environ.get(VARIABLE, "0") not in ("", "0")


@contextmanager
def granted(yes: bool = True) -> Iterator[None]:
    """Trust scene files within a `with` block if `yes` is true; otherwise change nothing."""
    token = _granted.set(yes or _granted.get())
    try:
        yield
    finally:
        _granted.reset(token)
