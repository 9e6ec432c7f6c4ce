"""Paths that come from outside: of the right type, and errors of ours where the operating system has its own."""

from __future__ import annotations

from os import PathLike, fspath
from pathlib import Path

from graspfx.errors import InputError


def to_path(name: str, given: object, expected: str = "the path of a file", folder: Path | None = None) -> Path:
    """Return a path with `~` resolved; a relative one starts in `folder` (the current one if None).

    Args:
        name: the argument, as its caller wrote it.
        given: a text or a path.
        expected: for the error.
        folder: where relative paths start.

    Raises:
        InputError: neither a text nor a path, a NUL in it, or the home of a user who is not known.
    """
    path = fspath(given) if isinstance(given, str | PathLike) else None
    if not isinstance(path, str):
        raise InputError(name, given, expected)
    if "\0" in path:
        raise InputError(name, path, expected, "leave the NUL character out")
    try:
        return (folder or Path()) / Path(path).expanduser()
    except RuntimeError as error:
        raise InputError(name, path, expected, "no user of that name has a home here: write the folder out") from error


def require_file(name: str, path: Path, do: str = "", expected: str = "the path of a file") -> None:
    """Require a regular file; a pipe, a socket or a device could keep its reader waiting for ever.

    Raises:
        InputError: nothing there, no regular file, or a name that the operating system refuses.
    """
    try:
        if path.is_file():
            return
        there = path.exists()
    except OSError as error:  # such as a name of more than 255 letters
        raise InputError(name, str(path), expected, error.strerror or "") from error
    raise InputError(name, str(path), expected, "it is no regular file" if there else do)
