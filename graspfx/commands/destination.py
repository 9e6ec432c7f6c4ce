"""Where a command's files go: a folder of its own in out/, or the one that --out names; over nothing that is there."""

from __future__ import annotations

import os
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from graspfx.commands.output import note
from graspfx.recording.files import LATEST, make_folder, new_folder, require_vacancy, require_vacancy_of

OUT = Path("out")
REMEDY = "choose another --out, or write over it with --overwrite"


def add_destination(parser: ArgumentParser, metavar: str, meaning: str, kind: type[Path] | type[str] = Path) -> None:
    """Add --out, as a path or as it was typed, and --overwrite."""
    parser.add_argument("--out", metavar=metavar, type=kind, help=meaning)
    parser.add_argument("--overwrite", action="store_true", help="write over files that are there")


def add_file(parser: ArgumentParser, meaning: str) -> None:
    """Add --out of a command that writes one file, for `file_in`, and --overwrite."""
    add_destination(parser, "FILE", meaning, str)


def file_in(options: Namespace, home: Path, name: str) -> Path:
    """Choose the file that --out names, or one of this name: in the folder of --out, or without it at home."""
    if options.out is None:
        return home / name
    path = Path(options.out)
    return path / name if options.out.endswith(("/", os.sep)) or path.is_dir() else path


def require_room(options: Namespace, files: Iterable[Path]) -> None:
    """Refuse, unless with --overwrite, where a file that the command would write is there.

    Raises:
        RecordingError: it is.
    """
    if not options.overwrite:
        require_vacancy(files, REMEDY)


def require_room_of(options: Namespace, recording: Path) -> None:
    """Refuse, unless with --overwrite, where a recording, or the part of a run, is there.

    Raises:
        RecordingError: it is.
    """
    if not options.overwrite:
        require_vacancy_of(recording, REMEDY)


@contextmanager
def destination(options: Namespace, name: str, *, latest: bool = False) -> Iterator[Path]:
    """Choose the folder of --out, or a new one: out/NAME, out/NAME-2, ... (out/NAME with --overwrite).

    A new folder that stays empty is removed again.

    Args:
        options: has `out` and `overwrite`.
        name: of the scene.
        latest: whether out/latest is to point to the new folder.
    """
    if options.out is not None:
        yield options.out
        return
    folder = make_folder(OUT / name) if options.overwrite else new_folder(OUT, name)
    previous = _point_to(folder) if latest else None
    try:
        yield folder
    finally:
        with suppress(OSError):
            folder.rmdir()  # which an empty one can be
            if latest:
                _point_to(previous)
            OUT.rmdir()


def _point_to(folder: Path | None) -> Path | None:
    """Make out/latest lead to a folder (to none: remove it), and return the folder to which it led.

    A link, or where there are none, as for most users of Windows, a file with the folder's name, which every command
    that reads recordings follows.
    """
    link, draft = OUT / LATEST, OUT / f".{LATEST}.{os.getpid()}"
    previous = _target(link)
    if folder is None:
        link.unlink(missing_ok=True)
        return previous
    try:
        if link.is_dir() and not link.is_symlink():
            raise FileExistsError(None, "a folder is in its way")
        try:
            draft.symlink_to(folder.name, target_is_directory=True)
        except (OSError, NotImplementedError):
            draft.write_text(folder.name + "\n", encoding="utf-8")
        draft.replace(link)
    except OSError as error:
        note([f"{link}: cannot be made to lead to {folder.name}; {error.strerror}"])
    return previous


def _target(link: Path) -> Path | None:
    if link.is_symlink():
        return OUT / link.readlink()
    return OUT / link.read_text(encoding="utf-8").strip() if link.is_file() else None
