"""Output files of a command: in a new folder in out/, or at --out. Only --overwrite overwrites existing files."""

from __future__ import annotations

import os
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.commands.output import is_json, is_quiet, note
from graspfx.errors import RecordingError
from graspfx.progress import waiting
from graspfx.recording.files import LATEST, make_folder, new_folder, placing, require_vacancy, require_vacancy_of

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

OUT = Path("out")
REMEDY = "choose another {}, or overwrite it with --overwrite"


def add_destination(parser: ArgumentParser, metavar: str, meaning: str, kind: type[Path] | type[str] = Path) -> None:
    """Add --out, as a path or as the text that was typed, and --overwrite."""
    parser.add_argument("--out", metavar=metavar, type=kind, help=meaning)
    parser.add_argument("--overwrite", action="store_true", help="overwrite existing files")


def add_file(parser: ArgumentParser, meaning: str) -> None:
    """Add --out for a command that writes one file (see `file_in`), and --overwrite."""
    add_destination(parser, "FILE", meaning, str)


def file_in(options: Namespace, home: Path, name: str) -> Path:
    """Return the output file: --out itself, or `name` in the folder --out; without --out, `name` in `home`."""
    if options.out is None:
        return home / name
    path = Path(options.out)
    return path / name if options.out.endswith(("/", os.sep)) or path.is_dir() else path


def require_room(options: Namespace, files: Sequence[Path], option: str = "--out") -> None:
    """Require that no output file exists, unless --overwrite is given, and that none is a folder.

    Raises:
        RecordingError: If a file exists or is a folder; the message names the option that chooses another file.
    """
    for file in files:
        _require_no_folder(file, option)
    if not options.overwrite:
        require_vacancy(files, REMEDY.format(option))


def require_room_of(options: Namespace, recording: Path) -> None:
    """Require that neither the recording nor its part file exists, unless --overwrite is given.

    Raises:
        RecordingError: If one of the two exists.
    """
    if not options.overwrite:
        require_vacancy_of(recording, REMEDY.format("--out"))


@contextmanager
def destination(options: Namespace, name: str, *, latest: bool = False) -> Iterator[Path]:
    """Yield the folder --out, or a new folder: out/NAME, out/NAME-2, ... (out/NAME with --overwrite).

    A new folder that stays empty is removed.

    Args:
        options: Parsed arguments with `out` and `overwrite`.
        name: Name of the new folder, usually that of the scene.
        latest: Whether to point out/latest to the new folder.
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
            folder.rmdir()  # succeeds only if the folder is empty
            if latest:
                _point_to(previous)
            OUT.rmdir()


def _point_to(folder: Path | None) -> Path | None:
    """Point out/latest to a folder, or remove out/latest if None; return the folder to which out/latest pointed.

    out/latest is a symbolic link. Where links are not allowed, as for most users of Windows, it is a text file that
    contains the folder's name; every command that reads recordings follows it.
    """
    link, draft = OUT / LATEST, OUT / f".{LATEST}.{os.getpid()}"
    previous = _target(link)
    if folder is None:
        link.unlink(missing_ok=True)
        return previous
    try:
        if link.is_dir() and not link.is_symlink():
            raise FileExistsError(None, "a folder has that name")
        try:
            draft.symlink_to(folder.name, target_is_directory=True)
        except (OSError, NotImplementedError):
            draft.write_text(folder.name + "\n", encoding="utf-8")
        draft.replace(link)
    except OSError as error:
        note([f"{link} cannot point to {folder.name}: {error.strerror}"])
    return previous


def _target(link: Path) -> Path | None:
    if link.is_symlink():
        return OUT / link.readlink()
    return OUT / link.read_text(encoding="utf-8").strip() if link.is_file() else None


@contextmanager
def drawing(picture: Path, otherwise: str = "") -> Iterator[Path]:
    """Make the picture's folder, and yield the path of a draft, which is renamed to the picture when the block ends.

    Args:
        picture: Path of the picture.
        otherwise: Text appended to the error message if the picture cannot be written.

    Raises:
        RecordingError: If the path is a folder, or the picture cannot be written.
    """
    _require_no_folder(picture, "--out")
    make_folder(picture.parent)
    with waiting(f"drawing {picture.name}"), placing(picture, otherwise) as file:
        yield file


def draw(recordings: Sequence[Recording], picture: Path, otherwise: str = "", **options: Any) -> None:
    """Draw recordings with `graspfx.show.run_figures.sheet`, which receives the options."""
    with drawing(picture, otherwise) as file:
        from graspfx.show.run_figures import sheet
        from graspfx.show.style import save

        save(sheet(recordings, **options), file)


def name_files(paths: Iterable[Path]) -> None:
    """Print the names of written files, unless -q or --json is given."""
    for path in () if is_quiet() or is_json() else paths:
        print(f"wrote {path}")


def _require_no_folder(file: Path, option: str) -> None:
    if file.is_dir():
        raise RecordingError(f"{file} is a folder, but the file needs this name; choose another {option}")
