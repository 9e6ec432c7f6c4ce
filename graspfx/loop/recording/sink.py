"""A run's rows on their way to a recording: into a part while it goes on, and from there into HDF5 when it ends."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.loop.recording.header import Header, KeyChange, Outcome, RunFault
from graspfx.loop.recording.journal import Journal
from graspfx.loop.recording.layout import Layout
from graspfx.loop.recording.lock import claim, release, stands_at
from graspfx.loop.recording.places import NAME, part_of, recording_path, require_vacancy_of
from graspfx.loop.recording.row_store import BLOCK, RowStore
from graspfx.loop.recording.signals import hold_signals
from graspfx.loop.recording.two_parts import wide_rows, wide_width

FloatArray = NDArray[np.float64]

FAILURES = (
    OSError,
    RuntimeError,
    ValueError,
    TypeError,
    MemoryError,
)  # of a disk, and of texts that HDF5 does not take


class FileSink:
    """Writes blocks of rows as they come, so that what was written can be read after the run was killed.

    Until `close` they stand in a part beside the recording's place, locked while this process lives.

    Args:
        path: of the recording.
        layout: the columns.
        header: of the recording.
        overwrite: whether a recording, or the part of a run that was killed, may be there already.
        compression: of the recording: "none", "lzf" or "gzip".

    Raises:
        RecordingError: a file is there, another run is writing there, or it cannot be written.
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
        self._journal = Journal(part_of(self._place), layout, header, wide_width(layout, header))
        self._layout, self._header, self._compression = layout, header, compression
        self._faults: list[RunFault] = []
        self._changes: list[KeyChange] = []
        self._failure: RecordingError | None = None
        self._room = np.empty((0, self._journal.wide))  # for rows with what follows from them

    @hold_signals()
    def note(self, changes: Sequence[KeyChange]) -> None:
        """Add changes of keys, before the rows that they hold in.

        Raises:
            RecordingError: the disk takes no more; the error says where the rows are.
        """
        self._add(np.empty((0, self._journal.wide)), [], changes)
        self._changes += changes

    @hold_signals()
    def write(self, rows: FloatArray, faults: Sequence[RunFault]) -> None:
        """Add rows (r, width) and faults.

        Raises:
            RecordingError: the disk takes no more, or the part was removed; the error says where the rows are.
        """
        if len(rows) > len(self._room):
            self._room = np.empty((len(rows), self._journal.wide))
        wide = wide_rows(rows, self._layout, self._header, self._changes, self._journal.rows, self._room)
        self._add(wide, faults)
        self._faults += faults
        if not stands_at(self._journal.file, self._journal.path):
            self._rescue(Outcome(tuple(self._faults), None, False, changes=tuple(self._changes)))

    def _add(self, rows: FloatArray, faults: Sequence[RunFault], changes: Sequence[KeyChange] = ()) -> None:
        if self._failure is not None:
            raise self._failure
        try:
            self._journal.write(rows, faults, changes)
        except OSError as error:
            self._fail(f"{self._journal.path}: cannot be written; {error.strerror}; {self._readable()}", error)
        except BaseException:  # whether these rows are there is not known, so none may follow
            self._failure = RecordingError(f"{self._journal.path}: could not be written; {self._readable()}")
            raise

    @hold_signals()
    def close(self, outcome: Outcome) -> None:
        """Note how the run went, and give the recording its name; nothing after a failure, which `write` has told.

        Raises:
            RecordingError: the disk takes no more, or the part was removed; the error says where the rows are.
        """
        if self._failure is not None:
            self._journal.file.close()
            return
        part = self._journal.path
        try:
            self._journal.conclude(outcome)
        except OSError as error:
            self._fail(f"{part}: cannot be written; {error.strerror}; {self._readable()}", error)
        if not stands_at(self._journal.file, part):
            self._rescue(outcome)
        try:
            self._convert(self._place, outcome)
        except FAILURES as error:
            self._fail(f"{self._place}: cannot be written; {_why(error)}; the run is whole in {part}", error)
        release(self._journal.file, part)

    def _convert(self, place: Path, outcome: Outcome) -> None:
        from graspfx.loop.recording.hdf5 import convert

        convert(self._journal, place, self._layout, self._header, outcome, self._compression)

    def _readable(self) -> str:
        rows = self._journal.rows
        return f"the {rows} rows before that can be read there" if rows else "no row was written"

    def _rescue(self, outcome: Outcome) -> None:
        """Save the rows of a part that was removed, which live while it is open, in the nearest folder there is."""
        from tempfile import gettempdir, mkdtemp

        text = f"{self._home}: was removed or moved while a run wrote there"
        roots = [each for each in self._home.parents if each.is_dir() and os.access(each, os.W_OK)][:1]
        for root in (*roots, Path(gettempdir())):
            with suppress(*FAILURES):
                place = Path(mkdtemp(prefix=f"{self._home.name}-", dir=root)) / NAME
                self._convert(place, outcome)
                break
        else:
            self._fail(f"{text}, and its rows fit nowhere else")
        self._fail(f"{text}; its {self._journal.rows} rows so far are in {place}")

    def _fail(self, text: str, error: Exception | None = None) -> None:
        self._failure = RecordingError(text)
        if self._journal.rows:
            self._journal.file.close()
        else:
            release(self._journal.file, self._journal.path)
        raise self._failure from error


def _why(error: Exception) -> str:
    """Write the system's message, or HDF5's, on one line."""
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
    """Write a recording at once.

    Raises:
        RecordingError: a file is there, another run is writing there, or it cannot be written.
    """
    from graspfx.loop.recording.hdf5 import write_hdf5

    place = recording_path(path)
    if not overwrite:
        require_vacancy_of(place)
    try:
        lock = claim(part_of(place))
    except OSError as error:
        raise RecordingError(f"{place}: cannot be written; {error.strerror}") from error
    wide = wide_width(layout, header)

    def blocks() -> Iterator[FloatArray]:
        step = max(1, BLOCK // (8 * max(wide, 1)))
        for first in range(0, len(rows), step):
            block = rows.read(first, min(first + step, len(rows)), slice(0, layout.width))
            yield wide_rows(block, layout, header, outcome.changes, first)

    try:
        write_hdf5(place, blocks(), len(rows), wide, layout, header, outcome, compression)
    except FAILURES as error:
        raise RecordingError(f"{place}: cannot be written; {_why(error)}") from error
    finally:
        release(lock, part_of(place))
