"""Places of a session's files, named as BIDS names those of behavioural data; and rows that outlive a power cut.

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
    """Places of one participant's session.

    Attributes:
        root: of the study.
        participant, session, task: labels, letters and digits.
        run: of the session, from 1 on.
    """

    root: Path
    participant: str
    session: str
    task: str
    run: int = 1

    @property
    def folder(self) -> Path:
        """Where the tables stand."""
        return self.root / f"sub-{self.participant}" / f"ses-{self.session}" / "beh"

    @property
    def stem(self) -> str:
        """The beginning of every file's name."""
        return f"sub-{self.participant}_ses-{self.session}_task-{self.task}_run-{self.run:02d}"

    @property
    def table(self) -> Path:
        """The table of trials."""
        return self.folder / f"{self.stem}_beh.tsv"

    @property
    def table_description(self) -> Path:
        """The meaning of the columns of the table, and the whole experiment."""
        return self.folder / f"{self.stem}_beh.json"

    @property
    def events(self) -> Path:
        """The table of events."""
        return self.folder / f"{self.stem}_events.tsv"

    @property
    def events_description(self) -> Path:
        """The meaning of the columns of the events."""
        return self.folder / f"{self.stem}_events.json"

    @property
    def recordings(self) -> Path:
        """The folder of the recordings."""
        return self.folder / f"{self.stem}_recordings"

    @property
    def study(self) -> Path:
        """The description of the study that BIDS wants."""
        return self.root / "dataset_description.json"

    def trial_folder(self, number: int) -> Path:
        """Make the folder of a trial; one that was broken off and comes again has another."""
        return new_folder(self.recordings, f"trial-{number:03d}")


class RowFile(Resource):
    """A file of lines with tabs, each of which is on the disk before anything else happens; nobody else writes there.

    Args:
        path: of the file.
        columns: names, which a new file begins with.
        resume: whether it is there, and goes on.

    Attributes:
        rows: that were there, by column; a last one that was cut short by a kill is dropped.

    Raises:
        RecordingError: it is there, or is not; it has other columns; another process has it.
        InputError: it is not in UTF-8.
    """

    def __init__(self, path: Path, columns: list[str], *, resume: bool = False) -> None:
        self.path, self.columns = path, columns
        make_folder(path.parent)
        flags = os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0)
        try:
            self._file = os.open(path, flags if resume else flags | os.O_CREAT | os.O_EXCL, 0o666)
        except OSError as error:
            there = "is there already; --resume goes on with it, --run N begins another"
            text = there if isinstance(error, FileExistsError) else f"cannot be opened; {obstacle(error)}"
            raise RecordingError(f"{path}: {text}") from error
        try:
            if not lock(self._file):
                raise RecordingError(f"{path}: another process writes there")
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
            raise RecordingError(f"{self.path}: has other columns than this experiment")
        return [dict(zip(self.columns, line.split("\t"), strict=False)) for line in lines]

    def write(self, row: dict[str, str]) -> None:
        """Write a row, and wait until the disk has it."""
        self._append("\t".join(row.get(name) or MISSING for name in self.columns))

    def _append(self, line: str) -> None:
        data, size = memoryview(f"{line}\n".encode()), os.fstat(self._file).st_size
        try:
            while data:
                data = data[os.write(self._file, data) :]
            os.fsync(self._file)
        except OSError as error:
            with suppress(OSError):  # half a row would swallow the next one
                os.ftruncate(self._file, size)
            raise RecordingError(f"{self.path}: cannot be written; {error.strerror}") from error

    def close(self) -> None:
        """Close the file; a second time nothing happens."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def text_of(path: Path, data: bytes) -> str:
    """Decode a table.

    Raises:
        InputError: it is not in UTF-8.
    """
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start)
        do = "another program may have saved it: take the file as it was written, or save it as UTF-8"
        content = data.split(b"\n")[line]
        raise InputError(f"{path}, line {line + 1}", content, "a table in UTF-8", do) from error


def cell(value: object) -> str:
    """Write a value as a cell: on one line, without tabs; n/a for nothing, true and false as JSON has them."""
    if value is None or value == "" or (isinstance(value, float) and value != value):
        return MISSING
    if isinstance(value, bool):
        return "true" if value else "false"
    return " ".join((repr(value) if isinstance(value, float) else str(value)).split())


def place_file(path: Path, text: str) -> None:
    """Write a small file that is whole or not there, and wait until the disk has it.

    Raises:
        RecordingError: it is there already, or cannot be written.
    """
    make_folder(path.parent)
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with draft.open("x", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.link(draft, path)  # which refuses a file that is there
        draft.unlink()
    except FileExistsError as error:
        draft.unlink(missing_ok=True)
        raise RecordingError(f"{path}: is there already") from error
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise RecordingError(f"{path}: cannot be written; {error.strerror}") from error
    sync_folder(path.parent)
