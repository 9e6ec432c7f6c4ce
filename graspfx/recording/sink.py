"""The file of a run, whose rows are written to a part during the run and converted to a recording at its end."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path
from types import FrameType

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError, RecordingError
from graspfx.loop.columns import Layout, RunFault
from graspfx.recording.files import NAME, claim, part_of, recording_path, release, require_vacancy_of, stands_at
from graspfx.recording.header import Header, KeyChange, Outcome
from graspfx.recording.part import PartWriter
from graspfx.recording.rows import RowStore

FloatArray = NDArray[np.float64]

FAILURES = OSError, RuntimeError, ValueError, TypeError, MemoryError  # disk errors, and texts that HDF5 refuses


@contextmanager
def hold_signals() -> Iterator[None]:
    """Defer the handlers of all signals to the end of the `with` block.

    Signals without a handler still end the process. In threads other than the main thread this function has no effect,
    because Python calls handlers in the main thread only.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def keep(number: int, frame: FrameType | None) -> None:
        queue.append((number, frame))

    queue: list[tuple[int, FrameType | None]] = []
    handlers = {int(each): handler for each in signal.valid_signals() if callable(handler := signal.getsignal(each))}
    try:
        for number in handlers:
            signal.signal(number, keep)
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in queue:
            handlers[number](number, frame)


class FileSink:
    """Sink that writes each block of rows to disk at once, so that the rows can be read even if the run is killed.

    Until the recording has been written and verified, the rows are in a part beside the path of the recording. This
    process holds a lock on the part.

    Args:
        path: Path of the recording.
        layout: Layout of the columns.
        header: Header of the recording.
        overwrite: Whether to replace an existing recording or part.
        compression: Compression of the recording: "none", "lzf" or "gzip".

    Raises:
        RecordingError: The file exists, another run is writing it, or it cannot be written.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        layout: Layout,
        header: Header,
        *,
        overwrite: bool = False,
        compression: str = "none",
    ) -> None:
        self._place = recording_path(path)
        self._home = self._place.absolute().parent
        if not overwrite:
            require_vacancy_of(self._place)
        self._part = PartWriter(part_of(self._place), layout, header)
        self._layout, self._header, self._compression = layout, header, compression
        self._faults: list[RunFault] = []
        self._changes: list[KeyChange] = []
        self._failure: RecordingError | None = None

    @hold_signals()
    def write(
        self, rows: FloatArray, faults: Sequence[RunFault], changes: Sequence[KeyChange] = ()
    ) -> None:  # fmt: skip
        """Append rows (r, width), faults and changes of keys; a change is written before the rows to which it applies.

        Raises:
            RecordingError: The rows cannot be written, or the part was removed; the message says where the rows are.
        """
        if self._failure is not None:
            raise self._failure
        self._faults += faults
        self._changes += changes
        try:
            self._part.write(rows, faults, changes)
        except OSError as error:
            self._fail(f"{self._part.path}: cannot be written; {error.strerror}; {self._readable()}", error)
        except BaseException:  # it is unknown whether these rows were written, so none may follow
            self._failure = RecordingError(f"{self._part.path}: could not be written; {self._readable()}")
            raise
        if not stands_at(self._part.file, self._part.path):
            self._rescue(Outcome(tuple(self._faults), None, False, changes=tuple(self._changes)))

    @hold_signals()
    def close(self, outcome: Outcome) -> None:
        """Append the outcome, and convert the part to the recording. After a failure of `write`, only close the part.

        Raises:
            RecordingError: The rows cannot be written, or the part was removed; the message says where the rows are.
        """
        if self._failure is not None:
            self._part.file.close()
            return
        part = self._part.path
        try:
            self._part.conclude(outcome)
        except OSError as error:
            self._fail(f"{part}: cannot be written; {error.strerror}; {self._readable()}", error)
        if not stands_at(self._part.file, part):
            self._rescue(outcome)
        try:
            self._convert(self._place, outcome)
        except (*FAILURES, RecordingError) as error:
            self._fail(f"{self._place}: cannot be written; {_why(error)}; the run is complete in {part}", error)
        release(self._part.file, part)

    def _convert(self, place: Path, outcome: Outcome) -> None:
        from graspfx.recording.file import write_recording

        rows, how = self._part.stored(), self._compression
        write_recording(place, rows, self._layout, self._header, outcome, how, sync=self._part.is_synced)

    def _readable(self) -> str:
        rows = self._part.rows
        return f"the {rows} rows before that can be read there" if rows else "no row was written"

    def _rescue(self, outcome: Outcome) -> None:
        """Save the rows of a removed part, which is still open, to the nearest folder that exists, and raise an error.

        If the rows cannot be saved there, they are saved to the folder for temporary files.
        """
        from tempfile import gettempdir, mkdtemp

        text = f"{self._home}: was removed or moved while a run wrote there"
        roots = [each for each in self._home.parents if each.is_dir() and os.access(each, os.W_OK)][:1]
        for root in (*roots, Path(gettempdir())):
            with suppress(*FAILURES):
                place = Path(mkdtemp(prefix=f"{self._home.name}-", dir=root)) / NAME
                self._convert(place, outcome)
                break
        else:
            self._fail(f"{text}, and its rows could not be written to another folder")
        self._fail(f"{text}; its {self._part.rows} rows so far are in {place}")

    def _fail(self, text: str, error: Exception | None = None) -> None:
        self._failure = RecordingError(text)
        if self._part.rows:
            self._part.file.close()
        else:
            release(self._part.file, self._part.path)
        raise self._failure from error


def _why(error: Exception) -> str:
    """Return the message of an error of the system or of HDF5 as one line."""
    return (isinstance(error, OSError) and error.strerror) or " ".join(str(error).split())


@hold_signals()
def save(
    path: str | PathLike[str],
    rows: RowStore,
    layout: Layout,
    header: Header,
    outcome: Outcome,
    *,
    overwrite: bool,
    compression: str = "none",
) -> None:
    """Write a complete recording to a file.

    Raises:
        RecordingError: The file exists, another run is writing it, or it cannot be written.
    """
    from graspfx.recording.file import write_recording

    place = recording_path(path, "path")
    if not place.name:
        raise InputError("path", path, "the path of a file")
    if not overwrite:
        require_vacancy_of(place)
    try:
        lock = claim(part_of(place))
    except OSError as error:
        raise RecordingError(f"{place}: cannot be written; {error.strerror}") from error
    try:
        write_recording(place, rows, layout, header, outcome, compression)
    except FAILURES as error:
        raise RecordingError(f"{place}: cannot be written; {_why(error)}") from error
    finally:
        release(lock, part_of(place))
