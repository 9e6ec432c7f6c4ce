"""Output files of commands, in a new folder in out/ or at --out. Existing files are overwritten only by --overwrite."""

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
    """Add the options --out, whose value is converted to `kind`, and --overwrite."""
    parser.add_argument("--out", metavar=metavar, type=kind, help=meaning)
    parser.add_argument("--overwrite", action="store_true", help="overwrite existing files")


def add_file(parser: ArgumentParser, meaning: str) -> None:
    """Add the options --out, for a command that writes one file (see `file_in`), and --overwrite."""
    add_destination(parser, "FILE", meaning, str)


def file_in(options: Namespace, home: Path, name: str) -> Path:
    """Return the path of the output file of a command.

    The path is --out, or the file `name` in --out if this is a folder or ends with a slash. Without --out, it is the
    file `name` in the folder `home`.
    """
    if options.out is None:
        return home / name
    path = Path(options.out)
    return path / name if options.out.endswith(("/", os.sep)) or path.is_dir() else path


def require_room(options: Namespace, files: Sequence[Path], option: str = "--out") -> None:
    """Check that output files can be written: none is a folder, and none exists unless --overwrite is given.

    Raises:
        RecordingError: If a file is a folder, or exists although --overwrite is not given.
    """
    for file in files:
        _require_no_folder(file, option)
    if not options.overwrite:
        require_vacancy(files, REMEDY.format(option))


def require_room_of(options: Namespace, recording: Path) -> None:
    """Check that neither a recording nor its part file exists, unless --overwrite is given.

    Raises:
        RecordingError: If one of the two files exists although --overwrite is not given.
    """
    if not options.overwrite:
        require_vacancy_of(recording, REMEDY.format("--out"))


@contextmanager
def destination(options: Namespace, name: str, *, latest: bool = False) -> Iterator[Path]:
    """Yield the output folder of a command.

    The folder is --out. Without --out, it is out/NAME with --overwrite, and otherwise the first of out/NAME,
    out/NAME-2, ... that does not exist. If such a folder is empty at the end of the block, it is removed.

    Args:
        options: Parsed arguments with `out` and `overwrite`.
        name: Name of the folder in out/, usually that of the scene.
        latest: Whether out/latest is made to point to the folder in out/.
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
    """Make out/latest point to a folder, and return the folder to which out/latest pointed before, or None.

    out/latest is a symbolic link. If the system does not allow links, as for most users of Windows, it is a text file
    that contains the folder's name, which commands that read recordings accept.

    Args:
        folder: Folder in out/; None to remove out/latest.
    """
    link, draft = OUT / LATEST, OUT / f".{LATEST}.{os.getpid()}"
    previous = _target(link)
    if folder is None:
        link.unlink(missing_ok=True)
        return previous
    try:
        if link.is_dir() and not link.is_symlink():
            raise FileExistsError(None, "it is a folder")
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
    """Create the folder of a picture, and yield a temporary path, which is renamed to that of the picture at the end.

    Args:
        picture: Path of the picture.
        otherwise: Text that is appended to the error message if the picture cannot be written.

    Raises:
        RecordingError: If the path of the picture is a folder, or the picture cannot be written.
    """
    _require_no_folder(picture, "--out")
    make_folder(picture.parent)
    with waiting(f"drawing {picture.name}"), placing(picture, otherwise) as file:
        yield file


def draw(recordings: Sequence[Recording], picture: Path, otherwise: str = "", **options: Any) -> None:
    """Draw recordings and save the figure; `options` are further arguments of `graspfx.show.run_figures.sheet`."""
    with drawing(picture, otherwise) as file:
        from graspfx.show.run_figures import sheet
        from graspfx.show.style import save

        save(sheet(recordings, **options), file)


def name_files(paths: Iterable[Path]) -> None:
    """Print the paths of files that were written, unless -q or --json is given."""
    for path in () if is_quiet() or is_json() else paths:
        print(f"wrote {path}")


def _require_no_folder(file: Path, option: str) -> None:
    if file.is_dir():
        raise RecordingError(f"cannot write {file}, because it is a folder; choose another {option}")
