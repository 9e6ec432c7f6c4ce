"""Files of a session: BIDS names for behavioural data, and a table whose rows survive a power failure.

https://bids-specification.readthedocs.io/en/stable/modality-specific-files/behavioral-experiments.html
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from graspfx.errors import InputError, RecordingError
from graspfx.recording.files import make_folder, new_folder, obstacle, sync_folder
from graspfx.resource import Resource
from graspfx.system.file_lock import lock

MISSING = "n/a"


@dataclass(frozen=True)
class SessionFiles:
    """Paths of one participant's session.

    Attributes:
        root: Folder of the study.
        participant, session, task: Labels of letters and digits.
        run: Number of the run in the session, from 1.
    """

    root: Path
    participant: str
    session: str
    task: str
    run: int = 1

    @property
    def folder(self) -> Path:
        """Folder of the tables."""
        return self.root / f"sub-{self.participant}" / f"ses-{self.session}" / "beh"

    @property
    def stem(self) -> str:
        """Common beginning of the file names."""
        return f"sub-{self.participant}_ses-{self.session}_task-{self.task}_run-{self.run:02d}"

    @property
    def table(self) -> Path:
        """Table of trials."""
        return self.folder / f"{self.stem}_beh.tsv"

    @property
    def table_description(self) -> Path:
        """Description of the table's columns, and the complete experiment."""
        return self.folder / f"{self.stem}_beh.json"

    @property
    def events(self) -> Path:
        """Table of events."""
        return self.folder / f"{self.stem}_events.tsv"

    @property
    def events_description(self) -> Path:
        """Description of the columns of events."""
        return self.folder / f"{self.stem}_events.json"

    @property
    def recordings(self) -> Path:
        """Folder of the recordings."""
        return self.folder / f"{self.stem}_recordings"

    @property
    def study(self) -> Path:
        """Description of the study, required by BIDS."""
        return self.root / "dataset_description.json"

    def trial_folder(self, number: int) -> Path:
        """Create the folder of a trial; a repeated trial gets a new folder."""
        return new_folder(self.recordings, f"trial-{number:03d}")


class RowFile(Resource):
    """Tab-separated file, locked against other processes. Each row is on the disk before `write` returns.

    Args:
        path: Path of the file.
        columns: Names of the columns, which are the header of a new file.
        resume: Whether to append to an existing file.

    Attributes:
        rows: Rows of the existing file, as dictionaries by column, without an incomplete last row.

    Raises:
        RecordingError: If the file exists and `resume` is false, or does not exist and `resume` is true; if the file
            cannot be written or has other columns; or if another process is writing to it.
        InputError: If the file is not UTF-8.
    """

    def __init__(self, path: Path, columns: list[str], *, resume: bool = False) -> None:
        self.path, self.columns = path, columns
        make_folder(path.parent)
        flags = os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0)
        try:
            self._file = os.open(path, flags if resume else flags | os.O_CREAT | os.O_EXCL, 0o666)
        except OSError as error:
            there = "exists already; --resume continues it, and --run N begins another session"
            text = there if isinstance(error, FileExistsError) else f"cannot be opened; {obstacle(error)}"
            raise RecordingError(f"{path}: {text}") from error
        try:
            if not lock(self._file):
                raise RecordingError(f"{path}: another process is writing to it")
            self.rows = self._read() if resume else []
            if not resume:
                self._append("\t".join(columns))
                sync_folder(path.parent)
        except BaseException:
            os.close(self._file)
            raise

    def _read(self) -> list[dict[str, str]]:
        data = b""
        while piece := os.read(self._file, 1 << 20):
            data += piece
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):
            os.ftruncate(self._file, len(whole))
        head, *lines = text_of(self.path, whole).splitlines() or [""]
        if not head:  # killed before the first line
            self._append("\t".join(self.columns))
        elif head.split("\t") != self.columns:
            raise RecordingError(f"{self.path}: its columns differ from those of this experiment")
        return [dict(zip(self.columns, line.split("\t"), strict=False)) for line in lines]

    def write(self, row: dict[str, str]) -> None:
        """Write a row, and wait until it is on the disk."""
        self._append("\t".join(row.get(name) or MISSING for name in self.columns))

    def _append(self, line: str) -> None:
        data, size = memoryview(f"{line}\n".encode()), os.fstat(self._file).st_size
        try:
            while data:
                data = data[os.write(self._file, data) :]
            os.fsync(self._file)
        except OSError as error:
            with suppress(OSError):  # otherwise the next row would be appended to half a row
                os.ftruncate(self._file, size)
            raise RecordingError(f"{self.path}: cannot be written; {error.strerror}") from error

    def close(self) -> None:
        """Close the file; closing it again does nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def text_of(path: Path, data: bytes) -> str:
    """Decode a table's content from UTF-8.

    Raises:
        InputError: If the table is not UTF-8.
    """
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start)
        do = "another program may have saved it: use the original file, or save it as UTF-8"
        content = data.split(b"\n")[line]
        raise InputError(f"{path}, line {line + 1}", content, "a table in UTF-8", do) from error


def cell(value: object) -> str:
    """Format a value as a cell: one line without tabs, n/a for a missing value, true and false as in JSON."""
    if value is None or value == "" or (isinstance(value, float) and value != value):
        return MISSING
    if isinstance(value, bool):
        return "true" if value else "false"
    return " ".join((repr(value) if isinstance(value, float) else str(value)).split())


def place_file(path: Path, text: str) -> None:
    """Create a small file atomically, and wait until it is on the disk.

    Raises:
        RecordingError: If the file exists or cannot be written.
    """
    make_folder(path.parent)
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with draft.open("x", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.link(draft, path)  # fails if the file exists
        draft.unlink()
    except FileExistsError as error:
        draft.unlink(missing_ok=True)
        raise RecordingError(f"{path}: exists already") from error
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise RecordingError(f"{path}: cannot be written; {error.strerror}") from error
    sync_folder(path.parent)
